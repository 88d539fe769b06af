"""Dead centres: whether friction holds a mechanism, by four ways that must agree."""

from __future__ import annotations

import numpy as np
import pytest

import pinfric as pf

CRANK, ROD = 0.05, 0.15


def crank_at(scene: pf.Scene, offset: float, back: bool) -> np.ndarray:
    """The bundled slider-crank so far (rad) from its outer or inner dead centre."""
    model, q = scene.model, np.zeros(scene.model.nq)
    crank = offset + np.pi * back
    rod = -np.arcsin(CRANK * np.sin(crank) / ROD) - crank
    for name, angle in (("crank_pin", crank), ("rod_pin", rod)):
        i = model.joints[model.getJointId(name)].idx_q
        q[i : i + 2] = np.cos(angle), np.sin(angle)
    across = np.sqrt(ROD**2 - (CRANK * np.sin(crank)) ** 2)
    q[model.joints[model.getJointId("guide")].idx_q] = CRANK * np.cos(crank) + across
    return scene.close(q, ["crank_pin"])


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("offset", [0.0, 1e-13, 1e-12, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3])
def test_inverse_holds_forward_and_simulate_agree_about_what_a_crank_holds(offset, back):
    """The guide's friction at its dead centre moves nothing, but it loads the pins.

    So it counts for what they hold: the outer 9 % of the interval were said not to hold.
    """
    scene = pf.load_scene("slider_crank")
    q, still = crank_at(scene, offset, back), np.zeros(3)
    wanted = pf.inverse_dynamics(scene, q, still, still)
    lower, upper = wanted.effort_lower[0], wanted.effort_upper[0]
    for share in (-0.5, -0.005, 0.005, 0.05, 0.5, 0.95, 0.995, 1.005, 1.5):
        effort, inside = lower + share * (upper - lower), 0.0 < share < 1.0
        hold = pf.holds(scene, q, effort)
        assert (hold.held, hold.proved) == (inside, True)
        found = pf.forward_dynamics(scene, q, still, effort)
        assert (found.a == 0.0).all() == inside
        if share in (0.005, 0.995) and offset != 1e-9:  # there loops do not close again
            motion = pf.simulate(scene, q, still, effort, 0.02)
            np.testing.assert_allclose(motion.q[-1], q, rtol=0.0, atol=1e-10)
