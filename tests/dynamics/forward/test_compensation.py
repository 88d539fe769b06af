"""The solver's compensation is that of the C++ header."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from export_cases import (
    RICH,
    SETTINGS,
    assert_columns,
    configurations,
    sampled,
)

import pinfric as pf


@pytest.mark.parametrize("options", SETTINGS, ids=range(len(SETTINGS)))
@pytest.mark.parametrize("scene", RICH[2:], ids=lambda scene: scene.source)
def test_the_solver_compensates_as_the_header(headers, scene, options):
    q, v, a = sampled(scene, 4, 40)
    rng = np.random.default_rng(4)
    v_ref, v_now = v + rng.normal(scale=0.1, size=v.shape), v + rng.normal(scale=0.1, size=v.shape)
    error = rng.normal(scale=0.01, size=v.shape)
    solver, full = scene.solver(), configurations(scene, q)
    for moving in (True, False):
        state = (v, a) if moving else (None, None)
        found = headers.ask(scene, q, *state, v_ref, error=error, v_now=v_now, options=options)
        expected = [
            solver.compensate(
                full[i],
                *(x[i] if moving else None for x in (v, a)),
                v_ref[i],
                error=error[i],
                v_now=v_now[i],
                options=options,
            )
            for i in range(len(q))
        ]
        assert_columns(found["friction"], np.array(expected), "friction")


@pytest.mark.parametrize("ratio", [0.7, -0.7])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_mimic_joint_rubs_in_its_own_direction(ratio, way):
    """A leader and a follower, 2 N forward and 0.5 N backward in each."""
    fingers = ((f"finger_{k}", pin.JointModelPX(), lump(1.0, [0.1, 0.0, 0.0], 0.1)) for k in (1, 2))
    model = pin.transformJointIntoMimic(chain(*fingers, beside=True), 1, 2, ratio, 0.0)
    sizes = {1.0: 2.0, -1.0: 0.5}
    names = {1.0: "positive", -1.0: "negative"}
    both = {names[s]: {"static": size, "kinetic": size} for s, size in sizes.items()}
    friction = {name: {"coulomb": both} for name in ("finger_1", "finger_2")}
    scene = pf.Scene(model=model, friction=friction)
    found = scene.solver().compensate([0.0], [way], [0.0], [way])
    expected = way * (sizes[way] + abs(ratio) * sizes[way * np.sign(ratio)])
    np.testing.assert_allclose(found, [expected], rtol=1e-12)
