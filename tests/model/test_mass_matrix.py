"""Mass matrices of a batch against RNEA, Jacobians against velocities of frames."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump, random_inertia, random_states, random_tree
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.model.equivalent_box import equivalent_box
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


# Boxes with a body's mass and inertia.


pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def test_box_of_equal_inertia_has_the_bodys_moments():
    edges = np.array([0.3, 0.2, 0.7])
    mass, turn = 2.5, pin.exp3(np.array([0.4, -0.2, 0.9]))
    moments = mass / 12 * (edges @ edges - edges**2)
    body = pin.Inertia(mass, np.array([0.1, 0.2, 0.3]), turn @ np.diag(moments) @ turn.T)
    box = equivalent_box(body)
    assert_allclose(np.sort(box.edges), np.sort(edges), rtol=1e-9)
    axes = box.placement.rotation
    back = axes @ np.diag(mass / 12 * (box.edges @ box.edges - box.edges**2)) @ axes.T
    assert_allclose(back, body.inertia, atol=1e-12)
    assert_array_equal(box.placement.translation, body.lever)
    assert equivalent_box(pin.Inertia.Zero()) is None


@pytest.mark.parametrize(("mass", "drawn"), [(1.0, True), (1e-300, False), (1e-30, False)])
def test_an_inertia_without_mass_is_no_box_beyond_every_machine(mass, drawn):
    """0.1 kg m^2 with 1e-300 kg is a cube of 8e149 m, which single precision does not hold."""
    box = equivalent_box(lump(mass, moment=0.1))
    assert (box is not None) == drawn
    if drawn:
        assert_allclose(box.edges, np.sqrt(0.6), rtol=1e-12)
