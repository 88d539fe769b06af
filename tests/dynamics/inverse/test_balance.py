"""A free base: the joints' efforts are tau - J^T f; what the base's equations leave is a result."""

import numpy as np
import pinocchio as pin
import pytest
from standing_cases import FEET, balancing, biped, efforts, squat

import pinfric as pf
from pinfric.dynamics.inverse.balance import LIMIT
from pinfric.errors import StateError, UndrivenMotionError

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")


@pytest.mark.parametrize("low", [1.0, 0.97])
def test_forces_that_are_low_are_a_residual_at_the_base(tmp_path, low):
    scene = pf.load_scene(biped(tmp_path))
    motion, _, forces = squat(scene)
    forces = {foot: low * wrench for foot, wrench in forces.items()}
    result = pf.inverse_dynamics(scene, motion, external=forces)
    expected = efforts(scene.model, motion.q, motion.v, motion.a, forces)
    np.testing.assert_allclose(result.effort_frictionless, expected[:, 6:], rtol=0, atol=1e-11)
    np.testing.assert_allclose(result.base_residual, expected[:, :6], rtol=0, atol=1e-11)
    balance = result.balance
    assert balance.weight == pytest.approx(33 * 9.81)
    # upright, the forces are vertical at rest: they lack a share of the weight
    assert balance.force == pytest.approx((1 - low) * balance.weight, rel=0.2, abs=1e-9)
    assert balance.within
    assert result.check().passed()


def test_a_motion_brings_its_forces_and_none_are_an_undriven_base(tmp_path):
    scene = pf.load_scene(biped(tmp_path))
    motion, _, forces = squat(scene)
    own, given = pf.inverse_dynamics(scene, motion), pf.inverse_dynamics(scene, motion, None)
    assert np.array_equal(own.effort_upper, given.effort_upper)
    assert own.external[0].wrench.shape == forces[FEET[0]].shape
    with pytest.raises(UndrivenMotionError, match="root_joint"):
        pf.inverse_dynamics(scene, motion, external={})


@pytest.mark.parametrize(
    ("sign", "world", "says"),
    [
        (-1.0, False, "with the other sign, as forces of the ground on the robot they would"),
        (1.0, True, r"in the axes of the world \(`axes: world`\) they would balance"),
        (-1.0, True, "with the other sign and in the axes of the world they would"),
    ],
)
def test_forces_of_another_frame_are_named(tmp_path, sign, world, says):
    """On the shanks, which lean by 0.3 to 0.7 rad as those of quadrupeds do."""
    scene = pf.load_scene(biped(tmp_path))
    motion, shanks = squat(scene).motion, ("left_shank", "right_shank")
    forces = balancing(scene.model, motion.q, motion.v, motion.a, shanks)
    assert pf.inverse_dynamics(scene, motion, external=forces).base_residual.max() < 1e-9
    if world:
        data = scene.model.createData()
        for i, q in enumerate(motion.q):
            pin.framesForwardKinematics(scene.model, data, q)
            for name, wrench in forces.items():
                R = data.oMf[scene.model.getFrameId(name)].rotation
                wrench[i] = np.concatenate([R @ wrench[i, :3], R @ wrench[i, 3:]])
    with pytest.raises(StateError, match=says):
        pf.inverse_dynamics(scene, motion, external={n: sign * f for n, f in forces.items()})


def test_forces_that_fit_no_reading_are_beyond_the_condition(tmp_path):
    scene = pf.load_scene(biped(tmp_path))
    motion, _, forces = squat(scene)
    result = pf.inverse_dynamics(scene, motion, external={f: 0.5 * w for f, w in forces.items()})
    balance = result.balance
    assert not balance.within
    assert balance.share == pytest.approx(0.5, rel=0.1)
    assert balance.share > LIMIT
