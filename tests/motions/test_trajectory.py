"""Trajectories: profiles, way-points, CSV, and every kind of bad file in one message."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain
from numpy.testing import assert_allclose, assert_array_equal
from tables import arguments, table
from trajectory_cases import arm_scene, message, one_joint_scene, write

from pinfric.errors import TrajectoryError
from pinfric.motions.trajectory import Trajectory, load_trajectory


def test_arrays_without_a_scene_are_refused_in_one_line():
    t = np.linspace(0.0, 1.0, 5)
    with pytest.raises(TrajectoryError, match="scene is a ndarray, which has no Pinocchio model"):
        Trajectory.from_arrays(t, t, t, t)


def test_round_trip_keeps_every_bit(tmp_path):
    yaml = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
sample_rate: 250
points:
  - {q: [0.0, 0.1, 0.0], hold: 0.1}
  - {q: [1.0, 0.3, -7.0], duration: 2.0, hold: 0.1, attach: box}
""",
    )
    scene = arm_scene(box=False)
    first = load_trajectory(yaml, scene)
    second = load_trajectory(first.to_csv(tmp_path / "exact.csv", digits=17), scene)
    for name in ("t", "v", "a", "attached"):
        assert_array_equal(getattr(first, name), getattr(second, name))
    assert_array_equal(first.q[:, :2], second.q[:, :2])
    assert_allclose(first.q, second.q, atol=3e-15)  # cos, sin -> angle -> cos, sin
    third = load_trajectory(first.to_csv(tmp_path / "nine.csv"), scene)
    assert_allclose(first.a, third.a, rtol=1e-8)
    assert [(h.first, h.last) for h in third.holds()] == [(h.first, h.last) for h in first.holds()]
    assert "-0," not in (tmp_path / "nine.csv").read_text()


def test_one_sample_with_derivatives_is_fine(tmp_path):
    path = write(tmp_path, "m.csv", "t,a,a.v,a.a\n0,1,0.5,-3\n")
    motion = load_trajectory(path, one_joint_scene())
    assert (motion.duration, motion.v[0, 0], motion.a[0, 0]) == (0.0, 0.5, -3.0)


def test_planar_joints_are_for_python_only(tmp_path):
    model = chain(("base", pin.JointModelPlanar()), ("a", pin.JointModelRZ()))
    scene = SimpleNamespace(model=model, payloads={})
    path = write(tmp_path, "m.csv", "t,a\n0,0\n1,0\n")
    assert "not enough for base (3 degrees of freedom)" in message(path, scene)
    q = np.tile(pin.neutral(model), (3, 1))
    motion = Trajectory.from_arrays(scene, [0, 1, 2], q, np.zeros((3, 4)), np.zeros((3, 4)))
    assert motion.joint_names == ("base", "a")
    with pytest.raises(TrajectoryError, match="have several positions"):
        motion.to_csv(tmp_path / "out.csv")
    with pytest.raises(TrajectoryError, match="needs v and a given"):
        Trajectory.from_arrays(scene, [0, 1, 2], q)


def test_mimic_followers_have_no_column(tmp_path):
    urdf = """<robot name="hand"><link name="base"/>{}
<joint name="left" type="prismatic"><parent link="base"/><child link="l"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
<joint name="right" type="prismatic"><parent link="base"/><child link="r"/><axis xyz="-1 0 0"/>
<mimic joint="left"/><limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
</robot>""".format(
        "".join(
            f'<link name="{n}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" '
            'iyz="0" izz="1"/></inertial></link>'
            for n in "lr"
        )
    )
    model = pin.buildModelFromXML(urdf, mimic=True)
    scene = SimpleNamespace(model=model, payloads={})
    motion = load_trajectory(write(tmp_path, "m.csv", "t,left\n0,0.01\n1,0.01\n"), scene)
    assert motion.joint_names == ("left",)
    assert motion.q.shape == (2, model.nq) == (2, 1)
    path = write(tmp_path, "n.csv", "t,left,right\n0,0.01,0.01\n1,0.01,0.01\n")
    assert load_trajectory(path, scene).warnings == ("columns not used: 'right'",)


def test_with_speed_scales_time_and_derivatives():
    t = np.linspace(1, 3, 201)
    scene = one_joint_scene(box=True)
    slow = Trajectory.from_arrays(scene, t, np.sin(t)[:, None])
    fast = slow.with_speed(2.0)
    assert fast.duration == pytest.approx(1.0)
    again = Trajectory.from_arrays(scene, fast.t, fast.q)
    assert_allclose(fast.v, again.v, atol=1e-8)
    assert_allclose(fast.a, again.a, atol=1e-5)
    for bad in (0.0, -1.0, np.nan):
        with pytest.raises(TrajectoryError, match="speed scale"):
            slow.with_speed(bad)


GOOD = np.tile([0.0, 0.1, 1.0, 0.0], (3, 1))


WRONG = r"""
q=GOOD[:, :3], v=np.zeros((2, 3))  2 problems: q has shape \(3, 3\).*; v has shape
attached={"bix": True}             unknown payload 'bix'
t=[0, 1, 1]                        time must increase; it does not after samples 1
q=GOOD + np.array([9, 0, 0, 0])    joint a: 9 rad is above
q=GOOD * 1.1                       q\[2:4\] is \(cos, sin\).*samples 0, 1, 2
q=np.where([[0], [1], [0]], np.nan, GOOD)  q is not finite at samples 1
"""


@pytest.mark.parametrize(("change", "says"), table(WRONG, partial(arguments, GOOD=GOOD), str))
def test_from_arrays_checks_everything(change, says):
    with pytest.raises(TrajectoryError, match=says):
        Trajectory.from_arrays(arm_scene(box=True), **{"t": [0, 1, 2], "q": GOOD} | change)


def test_from_arrays_keeps_what_is_attached():
    scene = arm_scene(box=True)
    kept = Trajectory.from_arrays(scene, [0, 1, 2], GOOD, attached={"box": [1, 0, 1]})
    assert_array_equal(kept.attached[:, 0], [True, False, True])


def test_trajectory_refuses_arrays_that_do_not_agree():
    three, two = np.zeros((3, 1)), np.zeros((2, 1))
    none = np.zeros((3, 0), bool)
    with pytest.raises(TrajectoryError, match=r"here: a has shape \(2, 1\)"):
        Trajectory(np.arange(3), three, three, two, none, (), ("a",), "here")
    with pytest.raises(TrajectoryError, match="no samples"):
        Trajectory(np.empty(0), *(np.empty((0, 1)),) * 3, np.empty((0, 0)), (), ("a",), "here")


def test_time_steps_that_cannot_be_meant(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("t,a\n0,0\n1e-300,0.1\n1,0.2\n2,0.3\n")
    assert "time steps below 1e-09 s are refused: line 3" in message(file, one_joint_scene())


def test_a_motion_shows_its_joints_speeds(tmp_path):
    path = write(tmp_path, "m.csv", "t,a,a.v,a.a\n0,0,0.25,0\n1,0.25,0.25,0\n")
    assert "speeds  1: a 0.25 (largest, rad/s or m/s)" in repr(
        load_trajectory(path, one_joint_scene())
    )
