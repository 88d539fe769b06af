"""Mass matrices of a batch against RNEA, Jacobians against velocities of frames."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, random_inertia, random_states, random_tree
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.model.mass_matrix import frame_jacobians, mass_matrices
from pinfric.model.twin import make_twin


def by_rnea(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """M column by column: efforts of unit accelerations, without gravity and armature."""
    model = model.copy()
    model.gravity.linear = np.zeros(3)
    model.armature = np.zeros(model.nv)
    data, zero = model.createData(), np.zeros(model.nv)
    return np.array([pin.rnea(model, data, q, zero, column) for column in np.eye(model.nv)])


@pytest.mark.parametrize("seed", range(6))
def test_random_trees(seed):
    model = random_tree(seed, joints=7)
    q = random_states(model, seed, 8)[0]
    found = mass_matrices(make_twin(model), q)
    assert_allclose(found, [by_rnea(model, x) for x in q], atol=1e-12)


def test_joints_of_many_degrees_and_mimic_joints():
    model = pin.buildSampleModelHumanoidRandom()
    q = np.array(
        [pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)) for _ in range(3)]
    )
    found = mass_matrices(make_twin(model), q)
    assert_allclose(found, [by_rnea(model, x) for x in q], atol=1e-10)
    links = [
        (f"joint_{k}", turn(), random_inertia(np.random.default_rng(k)), [0.1, 0.2, 0.3])
        for k, turn in enumerate((pin.JointModelRX, pin.JointModelRY, pin.JointModelRX))
    ]
    led = pin.transformJointIntoMimic(chain(*links), 1, 3, -0.7, 0.1)
    q = random_states(led, 2, 4)[0]
    found = mass_matrices(make_twin(led), q)
    assert_allclose(found, [by_rnea(led, x) for x in q], atol=1e-12)


def test_samples_that_repeat_are_computed_once_and_payloads_count():
    scene = pf.load_scene("ur10_machine_tending")
    q = np.repeat(random_states(scene.model, 0, 3)[0], 2, axis=0)
    light, heavy = (mass_matrices(scene.twin(names), q) for names in ([], ["blank"]))
    assert_array_equal(light[::2], light[1::2])
    assert_allclose(heavy[2], by_rnea(scene.loaded_model(["blank"]), q[2]), atol=1e-10)
    assert (heavy[:, 0, 0] > light[:, 0, 0]).all()


def test_frames():
    model = random_tree(3, joints=6)
    frame = model.addFrame(pin.Frame("tip", 6, 0, pin.SE3.Random(), pin.FrameType.BODY))
    ground = model.addFrame(pin.Frame("floor", 0, 0, pin.SE3.Random(), pin.FrameType.BODY))
    q, twin, data = random_states(model, 1, 5)[0], make_twin(model), model.createData()
    v = np.random.default_rng(1).normal(size=model.nv)
    for x, J in zip(q, frame_jacobians(twin, q, frame), strict=True):
        pin.forwardKinematics(model, data, x, v)
        moved = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
        assert_allclose(J @ v, moved, atol=1e-13)
    assert not frame_jacobians(twin, q, ground).any()
