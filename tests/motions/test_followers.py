"""Limits of mimic followers, and what counts as a limit."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from pinfric.errors import TrajectoryError
from pinfric.model.robot import Robot
from pinfric.motions.trajectory import Trajectory, load_trajectory

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" '
    'iyz="0" izz="1"/></inertial></link>'
)


HAND = """<robot name="hand"><link name="base"/>{links}
<joint name="left" type="revolute"><parent link="base"/><child link="l"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="2"/></joint>
<joint name="right" type="revolute"><parent link="base"/><child link="r"/><axis xyz="-1 0 0"/>
<mimic joint="left" multiplier="10" offset="0.5"/>{limit}</joint>
</robot>"""


LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="3"/>'


def hand(tmp_path, limit=LIMIT):
    """What a scene has of a URDF: its model (Pinocchio's, without the follower's limits), and it"""
    path = tmp_path / "hand.urdf"
    path.write_text(HAND.format(links="".join(LINK.format(n) for n in "lr"), limit=limit))
    model = pin.buildModelFromUrdf(str(path), mimic=True)
    return SimpleNamespace(model=model, payloads={}, robot=Robot(model, path, (), {}, {}))


def motion(tmp_path, scene, positions):
    path = tmp_path / "m.csv"
    rates = np.gradient(positions)
    rows = "\n".join(
        f"{t},{q},{v},0" for t, (q, v) in enumerate(zip(positions, rates, strict=True))
    )
    path.write_text(f"t,left,left.v,left.a\n{rows}\n")
    return load_trajectory(path, scene)


def test_follower_beyond_its_limits_is_an_error_that_names_both_joints(tmp_path):
    scene = hand(tmp_path)
    with pytest.raises(TrajectoryError) as caught:
        motion(tmp_path, scene, [0, 0.1, 0.25, -0.2])
    text = str(caught.value)
    assert ": 2 problems:" in text
    assert "joint right: 3 rad is above its upper limit 1 (first at t = 1 s, sample 1;" in text
    assert "joint right: -1.5 rad is below its lower limit -1 (first at t = 3 s" in text
    assert text.count("it follows 10 x left +0.5") == 2
    with pytest.raises(TrajectoryError, match="joint right: 3 rad is above"):
        Trajectory.from_arrays(scene, [0, 1], [[0.0], [0.25]])


def test_leader_and_follower_stand_in_one_message(tmp_path):
    with pytest.raises(TrajectoryError, match=r"joint left: 1\.5 rad.*joint right: 15\.5 rad"):
        motion(tmp_path, hand(tmp_path), [0, 1.5])


def test_follower_within_its_limits_is_fine_and_its_speed_a_warning(tmp_path):
    slow = motion(tmp_path, hand(tmp_path), [-0.1, -0.05, 0.0])
    assert slow.warnings == ()
    fast = Trajectory.from_arrays(
        hand(tmp_path), [0, 1], [[0.0], [0.01]], [[0.0], [0.31]], [[0.0], [0.0]]
    )
    assert fast.warnings == (
        "joint right: reaches 3.1 rad/s, above its velocity limit 3 (first at t = 1 s; samples "
        "beyond it: 1); it follows 10 x left +0.5",
    )


@pytest.mark.parametrize("limit", ['<limit effort="1" velocity="0"/>'])
def test_follower_without_limits_may_go_anywhere(tmp_path, limit):
    assert motion(tmp_path, hand(tmp_path, limit), [0, 0.9]).t.size == 2
