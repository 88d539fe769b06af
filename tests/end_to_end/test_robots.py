"""The bundled robots: the paper's printed data, moves inside limits, files that agree."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinfric as pf
from pinfric.model.robot import with_payloads

ROBOTS = Path(__file__).parents[2] / "robots"
SCENES = (
    "pendulum",
    "three_link",
    "panda_pick_and_place",
    "ur5_pick_and_place",
    "so101",
    "ur10_machine_tending",
)
pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")


def load(name):
    scene = pf.load_scene(ROBOTS / f"{name}.yaml")
    return scene, pf.load_trajectory(ROBOTS / f"{name}.waypoints.yaml", scene)


def com_motion(model, q, v):
    """Centres of mass and their velocities (ground axes), and angular velocities, of all links."""
    data = model.createData()
    pin.forwardKinematics(model, data, np.asarray(q, float), np.asarray(v, float))
    rows = []
    for joint in range(1, model.njoints):
        placement, twist = data.oMi[joint], data.v[joint]
        lever = model.inertias[joint].lever
        rotation = placement.rotation
        velocity = rotation @ (twist.linear + np.cross(twist.angular, lever))
        rows.append((placement.act(lever), velocity, rotation @ twist.angular))
    return [np.array(column) for column in zip(*rows, strict=True)]


def test_pendulum_is_the_papers():
    scene, _ = load("pendulum")
    model = scene.model
    assert list(model.names) == ["universe", "joint_1"]
    np.testing.assert_array_equal(model.gravity.linear, [9.81, 0, 0])
    assert model.inertias[1].mass == 1.0
    assert model.inertias[1].inertia[2, 2] == 0.4
    start = scene.simulation.start
    center, velocity, _ = com_motion(model, [start.q["joint_1"]], [start.v["joint_1"]])
    np.testing.assert_allclose(center[0], [0.217, 0.125, 0], atol=6e-4)  # printed digits
    np.testing.assert_allclose(velocity[0], [-0.125, 0.217, 0], atol=6e-4)


def test_three_link_is_the_papers():
    scene, _ = load("three_link")
    model = scene.model
    assert list(model.names) == ["universe", "joint_1", "joint_12", "joint_23"]
    np.testing.assert_array_equal(model.gravity.linear, [0, -9.81, 0])
    bodies = list(model.inertias)[1:]
    assert [body.mass for body in bodies] == [4.0, 3.0, 1.0]
    printed = [[0.5, 0.2, 0.5], [0.4, 0.4, 0.15], [0.1, 0.2, 0.2]]
    for body, moments in zip(bodies, printed, strict=True):
        np.testing.assert_array_equal(body.inertia, np.diag(moments))
    rates = [scene.simulation.start.v[name] for name in scene.joint_names]
    centers, velocities, angular = com_motion(model, np.zeros(3), rates)
    np.testing.assert_allclose(
        centers, [[0, 0.2, 0], [0, 0.4, -0.25], [0.15, 0.4, -0.5]], atol=1e-12
    )
    np.testing.assert_allclose(
        velocities, [[-0.2, 0, 0], [-0.4, -0.25, 0], [-0.4, -0.35, -0.15]], atol=1e-12
    )
    np.testing.assert_allclose(angular, [[0, 0, 1], [-1, 0, 1], [-1, 1, 1]], atol=1e-12)


@pytest.mark.parametrize("name", ["pendulum", "three_link"])
def test_the_papers_friction_and_drives(name):
    scene, _ = load(name)
    joint = {"pendulum": "joint_1", "three_link": "joint_12"}[name]
    assert list(scene.friction) == [joint]
    friction = scene.friction[joint]
    assert (friction.mu.static, friction.mu.kinetic) == (0.35, 0.30)
    assert (friction.bearing.radius, friction.bearing.length) == {
        "pendulum": (0.1, None),
        "three_link": (0.08, 0.1),
    }[name]
    sines = {key: effort.sine for key, effort in scene.simulation.effort.items()}
    printed = {
        "pendulum": {"joint_1": (2, 2)},
        "three_link": {"joint_1": (5, 1), "joint_12": (5, 2), "joint_23": (5, 3)},
    }
    assert {k: (s.amplitude, s.angular_frequency) for k, s in sines.items()} == printed[name]


@pytest.mark.parametrize("name", SCENES)
def test_moves_stay_inside_position_velocity_and_effort_limits(name):
    scene, motion = load(name)
    model = scene.model
    assert motion.warnings == ()  # velocities
    position = motion.joint_positions()
    assert (position >= model.lowerPositionLimit).all()
    assert (position <= model.upperPositionLimit).all()
    torque = frictionless_torque(scene, motion)
    result = pf.inverse_dynamics(scene, motion.q, motion.v, motion.a, t=motion.t)
    friction = np.abs(result.friction_upper).max(axis=0)
    sites = [scene.joint_names.index(site) for site in result.site_names]
    worst = np.abs(torque).max(axis=0)
    worst[sites] += friction
    assert (worst < model.effortLimit).all()
    if name == "so101":  # the URDF's 10 N m is a placeholder; the servo stalls at 1.91
        assert worst.max() < 1.91


def frictionless_torque(scene, motion):
    model = scene.model
    loaded = with_payloads(model, scene.payloads) if scene.payloads else model
    datas = {True: (loaded, loaded.createData()), False: (model, model.createData())}
    carries = motion.attached.any(axis=1)
    return np.array(
        [
            pin.rnea(*datas[bool(carry)], q, v, a)
            for carry, q, v, a in zip(carries, motion.q, motion.v, motion.a, strict=True)
        ]
    )


@pytest.mark.parametrize("name", SCENES)
def test_every_joint_that_should_hold_holds_exactly(name):
    _, motion = load(name)
    holds = [hold for hold in motion.holds() if hold.end - hold.start >= 0.15]
    assert len(holds) >= 3
    for hold in holds:
        assert (motion.v[hold.first : hold.last + 1] == 0).all()
        assert np.ptp(motion.q[hold.first : hold.last + 1], axis=0).max() == 0


@pytest.mark.parametrize("name", ["panda_pick_and_place", "ur5_pick_and_place"])
def test_csv_equals_the_way_points_it_came_from(name):
    scene, motion = load(name)
    path = ROBOTS / f"{name}.csv"
    assert path.stat().st_size < 1_500_000
    table = pf.load_trajectory(path, scene)
    assert table.warnings == ()
    for key in ("t", "q", "v", "a"):
        np.testing.assert_allclose(getattr(table, key), getattr(motion, key), rtol=1e-8, atol=1e-9)
    np.testing.assert_array_equal(table.attached, motion.attached)
    assert table.holds() == motion.holds()


@pytest.mark.parametrize(
    ("name", "frame", "reach", "picked", "placed"),
    [
        ("panda_pick_and_place", "panda_hand_tcp", 0.13, (0.45, -0.30, 0.0), (0.45, 0.35, 0.10)),
        ("ur5_pick_and_place", "tool0", 0.15, (0.45, -0.30, 0.0), (0.30, 0.45, 0.0)),
        ("so101", "gripper_frame_link", 0.015, (0.22, -0.12, 0.015), (0.20, 0.15, 0.015)),
    ],
)
def test_the_box_goes_from_a_to_b_upright(name, frame, reach, picked, placed):
    """`reach`: from the payload's bottom face up to the frame."""
    scene, motion = load(name)
    data, index = scene.model.createData(), scene.model.getFrameId(frame)
    poses = []
    for q in motion.q:
        pin.framesForwardKinematics(scene.model, data, q)
        poses.append(data.oMf[index].copy())
    carried = np.flatnonzero(motion.attached[:, 0])
    assert (np.diff(carried) == 1).all()
    bottom = np.array([pose.translation - [0, 0, reach] for pose in poses])
    np.testing.assert_allclose(bottom[carried[0]], picked, atol=5e-4)
    np.testing.assert_allclose(bottom[carried[-1] + 1], placed, atol=5e-4)
    assert (bottom[:, 2] > -5e-4).all()
    down = np.array([-pose.rotation[2, 2] for pose in poses])
    assert down[carried[[0, -1]]] == pytest.approx(1.0, abs=1e-3)
    # the SO-101 has too few joints to stay upright on the way
    assert np.degrees(np.arccos(np.clip(down[carried].min(), -1, 1))) < (
        20 if name == "so101" else 1
    )


def test_the_ur10_takes_a_blank_from_tray_to_chuck_and_every_joint_turns_round():
    scene, motion = load("ur10_machine_tending")
    data, frame = scene.model.createData(), scene.model.getFrameId("tool0")
    carried = np.flatnonzero(motion.attached[:, 0])
    for sample, place, along in (
        (carried[0], (0.60, -0.55, 0.05), (0, 0, -1)),
        (carried[-1], (0.55, 0.75, 0.55), (0, 1, 0)),
    ):
        pin.framesForwardKinematics(scene.model, data, motion.q[sample])
        np.testing.assert_allclose(data.oMf[frame].translation, place, atol=5e-4)
        np.testing.assert_allclose(data.oMf[frame].rotation[:, 2], along, atol=1e-3)
    assert (motion.v.max(axis=0) > 0.5).all()
    assert (motion.v.min(axis=0) < -0.5).all()
    assert ((motion.v == 0).sum(axis=0) > 600).all()


@pytest.mark.parametrize(
    ("name", "identified"),
    [
        ("panda_pick_and_place", [0.245, 0.152, 0.183, 0.359, 0.267, 0.166, 0.211]),
        ("so101", [0.215, 0.318, 0.402, 0.296, 0.283, 0.312]),
    ],
)
def test_bearings_and_coulomb_together_are_what_was_identified(name, identified):
    """Under the arm's own weight, averaged over postures: the scene counts nothing twice."""
    scene, _ = load(name)
    model, count = scene.model, 20_000
    q = np.random.default_rng(0).uniform(
        model.lowerPositionLimit, model.upperPositionLimit, (count, model.nq)
    )
    zero = np.zeros((count, model.nv))
    loads = pf.inverse_dynamics(scene, q, zero, zero).normal_load.mean(axis=0)
    kinetic = [
        friction.mu.kinetic * load + friction.coulomb.kinetic
        for friction, load in zip(scene.friction.values(), loads, strict=True)
    ]
    np.testing.assert_allclose(kinetic, identified, atol=1.5e-3)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_begin_with_what_they_are_and_how_to_run_them(name):
    for path in (ROBOTS / f"{name}.yaml", ROBOTS / f"{name}.waypoints.yaml"):
        text = path.read_text()
        assert text.startswith("# ")
        assert f"pinfric inverse robots/{name}.yaml robots/{name}." in text
        assert max(map(len, text.splitlines())) <= 100
