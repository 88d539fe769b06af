"""`pinfric new --floating`: robots stand and squat by name; Pinocchio judges their efforts."""

import numpy as np
import pinocchio as pin
import pytest
from mjcf_cases import BIPED, QUADRUPED
from standing_cases import biped, efforts

import pinfric as pf
from pinfric.dynamics.inverse.standing import LEVEL, stand
from pinfric.errors import RobotError
from pinfric.motions.trajectory import Trajectory
from pinfric.new_scene import write_new

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
#: Bundled robots: feet, and whether these are soles.
ROBOTS = {
    "go2_description/urdf/go2": (4, False),
    "solo_description/robots/solo12": (4, False),
    "anymal_b_simple_description/robots/anymal": (4, False),
    "hyq_description/robots/hyq_no_sensors": (4, False),
    "a1_description/urdf/a1": (4, False),
    "g1_description/urdf/g1_29dof_rev_1_0": (2, True),
    "talos_data/robots/talos_reduced": (2, True),
    "romeo_description/urdf/romeo_small": (2, True),
}
FAST = "solo_description/robots/solo12"


def thinned(scene, motion, count=9):
    """Every so many samples of a motion: a program at each takes some 50 ms."""
    at = np.unique(np.linspace(0, len(motion.t) - 1, count).astype(int))
    parts = (motion.t[at], motion.q[at], motion.v[at], motion.a[at])
    return Trajectory.from_arrays(scene, *parts)


def judge(scene, motion):
    """What a stand and a squat must be, whoever wrote them."""
    model, weight = scene.model, pin.computeTotalMass(scene.model) * 9.81
    data, feet = model.createData(), list(scene.feet)
    places = []
    for q in motion.q:
        pin.framesForwardKinematics(model, data, q)
        points = [(data.oMf[model.getFrameId(n)], np.array(scene.feet[n].xyz)) for n in feet]
        places.append([frame.act(point) for frame, point in points])
    assert np.ptp(np.array(places), axis=0).max() < 1e-4
    assert np.ptp(np.array(places)[0, :, 2]) < LEVEL
    assert np.ptp(motion.q[:, 2]) > 0.02  # it squats
    some = thinned(scene, motion)
    standing = stand(scene, some)
    own = efforts(model, some.q, some.v, some.a, standing.external)
    drives = [model.joints[model.getJointId(n)].idx_v for n in scene.actuator_names]
    scale = np.abs(own).max()
    found = standing.result.effort_frictionless
    np.testing.assert_allclose(found, own[:, drives], rtol=0, atol=1e-10 * scale)
    assert np.abs(own[:, :6]).max() < 1e-6 * weight
    assert (standing.frictionless_lower <= found + 1e-6 * scale).all()
    assert (found <= standing.frictionless_upper + 1e-6 * scale).all()
    return standing


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n == FAST else pytest.mark.slow) for n in ROBOTS]
)
def test_bundled_robots_stand_and_squat_by_name(tmp_path, name):
    scene_file, way_file = write_new(f"example-robot-data:{name}.urdf", tmp_path, floating=True)
    scene = pf.load_scene(scene_file)
    count, soles = ROBOTS[name]
    assert len(scene.feet) == count
    assert all((foot.length > 0) == soles for foot in scene.feet.values())
    judge(scene, pf.load_trajectory(way_file, scene))


def test_legs_whose_limits_allow_no_squat_stand(tmp_path):
    """The URDF's limits of this one's knees and ankles are of other joints."""
    name = "simple_humanoid_description/urdf/simple_humanoid"
    scene_file, way_file = write_new(f"example-robot-data:{name}.urdf", tmp_path, floating=True)
    assert "its legs reach no squat within their limits" in way_file.read_text()
    scene = pf.load_scene(scene_file)
    motion = pf.load_trajectory(way_file, scene)
    assert stand(scene, thinned(scene, motion, 2)).result.balance.share < 1e-6


def test_a_robot_of_ones_own_is_bent_and_stands(tmp_path):
    biped(tmp_path)
    (tmp_path / "new").mkdir()
    scene_file, way_file = write_new(tmp_path / "biped.urdf", tmp_path / "new", floating=True)
    scene = pf.load_scene(scene_file)
    assert list(scene.feet) == ["left_foot", "right_foot"]
    assert scene.actuator_names == scene.joint_names[1:]
    assert "legs a little bent" in way_file.read_text()
    standing = judge(scene, pf.load_trajectory(way_file, scene))
    knee = scene.actuator_names.index("left_knee")
    # knees bend to the front: the joint holds the robot up
    assert (standing.result.effort_frictionless[:, knee] < -10).all()


def test_an_mjcf_whose_base_is_free_stands_without_being_told(tmp_path):
    """Its feet are balls at the shanks, its pose the best of its keyframes."""
    (tmp_path / "dog.xml").write_text(QUADRUPED)
    scene_file, way_file = write_new(tmp_path / "dog.xml", tmp_path)
    scene, told = pf.load_scene(scene_file), scene_file.read_text()
    assert "floating: true" not in told
    assert "--floating" not in told
    assert {n: foot.xyz for n, foot in scene.feet.items()} == dict.fromkeys(
        ("fl_calf", "fr_calf", "hl_calf", "hr_calf"), (-0.01, 0.0, -0.25)
    )
    assert scene.actuator_names == scene.joint_names[1:]
    motion = pf.load_trajectory(way_file, scene)
    assert "keyframe home" in way_file.read_text()
    np.testing.assert_allclose(motion.q[0, 7:], 4 * [0, 0.8, -1.6], atol=1e-9)
    judge(scene, motion)
    # whoever says --floating means the same
    (tmp_path / "again").mkdir()
    again, _ = write_new(tmp_path / "dog.xml", tmp_path / "again", floating=True)
    assert pf.load_scene(again).feet == scene.feet


def test_a_sole_is_that_of_its_collision_shapes(tmp_path):
    (tmp_path / "walker.xml").write_text(BIPED)
    scene_file, way_file = write_new(tmp_path / "walker.xml", tmp_path)
    scene = pf.load_scene(scene_file)
    for name in ("left_foot", "right_foot"):
        foot = scene.feet[name]
        assert foot.xyz == (0.04, 0.0, -0.045)
        assert (foot.length, foot.width) == (0.18, 0.06)
    judge(scene, pf.load_trajectory(way_file, scene))


def test_an_ankle_that_does_not_roll_squats(tmp_path):
    """Its sole stays flat only straight below, where hip and foot are not in line."""
    text = BIPED
    for side, y in (("left", 0.04), ("right", -0.04)):
        text = text.replace(f'<joint name="{side}_ankle_roll" axis="1 0 0"/>', "")
        shifted = f'<body name="{side}_shank" pos="0 {y} -0.3">'
        text = text.replace(f'<body name="{side}_shank" pos="0 0 -0.3">', shifted)
    (tmp_path / "walker.xml").write_text(text)
    scene_file, way_file = write_new(tmp_path / "walker.xml", tmp_path)
    scene = pf.load_scene(scene_file)
    judge(scene, pf.load_trajectory(way_file, scene))


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("ur_description/urdf/ur5_robot.urdf", "no two branches from its base are called as legs"),
    ],
)
def test_robots_without_legs_do_not_stand(tmp_path, name, says):
    with pytest.raises(RobotError, match=says):
        write_new(f"example-robot-data:{name}", tmp_path, floating=True)
    assert not list(tmp_path.iterdir())
