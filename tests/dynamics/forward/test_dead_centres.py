"""Dead centres: whether friction holds a mechanism, by four ways that must agree."""

import numpy as np
import pytest
from mechanisms import GROUND, LENGTHS, four_bar

import pinfric as pf

CRANK, ROD = 0.05, 0.15


def crank_at(scene: pf.Scene, offset: float, back: bool) -> np.ndarray:
    """The bundled slider-crank at an angle (rad) from its outer or inner dead centre."""
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

    Without it the outer 9 % of the interval were said not to hold.
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
        if share in (0.005, 0.995):
            motion = pf.simulate(scene, q, still, effort, 0.02)
            np.testing.assert_allclose(motion.q[-1], q, rtol=0.0, atol=1e-10)


def bars_at(offset: float, stretched: bool, way: int) -> np.ndarray:
    """The bars' angles of a four-bar with crank and coupler at an angle (rad) from one line."""
    crank, coupler, rocker = LENGTHS.values()
    reach = coupler + crank if stretched else coupler - crank
    along = (reach**2 + GROUND**2 - rocker**2) / (2.0 * reach * GROUND)
    angle = way * np.arccos(along) + (0.0 if stretched else np.pi) + offset
    pin = crank * np.array([np.cos(angle), np.sin(angle)])
    gap = np.array([GROUND, 0.0]) - pin
    far = np.hypot(*gap)
    turn = np.arccos((coupler**2 + far**2 - rocker**2) / (2.0 * coupler * far))
    second = np.arctan2(gap[1], gap[0]) + way * turn
    end = pin + coupler * np.array([np.cos(second), np.sin(second)]) - [GROUND, 0.0]
    return np.array([angle, second, np.arctan2(end[1], end[0])])


SLOW = [pytest.param(x, marks=pytest.mark.slow) for x in (0.0, *(10.0**-k for k in range(3, 12)))]


@pytest.mark.parametrize("offset", [1e-12, *SLOW])
@pytest.mark.parametrize(
    "mu", [*(pytest.param(mu, marks=pytest.mark.slow) for mu in (0.3, 0.6)), 1.0]
)
def test_inverse_holds_forward_and_simulate_agree_about_what_a_four_bar_holds(offset, mu):
    """The rocker's pin rests at its dead centre; its rate was rounding, taken for a motion."""
    still = np.zeros(3)
    for cut, stretched, way in ((c, s, w) for c in "BC" for s in (True, False) for w in (1, -1)):
        scene, joints = four_bar(cut=cut, mu=mu)
        q = scene.close(joints(bars_at(offset, stretched, way)), ["O"])
        wanted = pf.inverse_dynamics(scene, q[None], still[None], still[None])
        lower, upper = wanted.effort_lower[0, 0], wanted.effort_upper[0, 0]
        for share in (-0.05, -0.005, 0.005, 0.5, 0.995, 1.005, 1.05):
            effort, inside = [lower + share * (upper - lower)], 0.0 < share < 1.0
            hold = pf.holds(scene, q, effort)
            assert (hold.held, hold.proved) == (inside, True)
            found = pf.forward_dynamics(scene, q, still, effort)
            assert (found.a == 0.0).all() == inside
            if share in (0.005, 1.05):
                motion = pf.simulate(scene, q, still, effort, 0.01)
                assert (np.abs(motion.q[-1] - q).max() < 1e-10) == inside
