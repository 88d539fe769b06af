"""ROS bags: of ROS 2 as a folder and as a file, of ROS 1."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from log_cases import (
    Q,
    T,
    arm,
)
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.errors import TrajectoryError
from pinfric.motions.log.formats.bags import _joint_states
from pinfric.motions.log.reading import ReadingOptions

NAMES = ["arm_lift", "gripper", "base_turn"]


def write_bag(
    folder, storage, topic="/joint_states", kind="sensor_msgs/msg/JointState", names=lambda i: NAMES
):
    """A bag of the arm's motion, as ros2 bag record writes it."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.LATEST)
    make, plugin = types.types, getattr(StoragePlugin, storage)
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection(topic, kind, typestore=types)
        for i, (t, q) in enumerate(zip(T, Q, strict=True)):
            at = 1_700_000_000_000_000_000 + round(t * 1e9)
            if kind.endswith("JointState"):
                stamp = make["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
                message = make[kind](
                    header=make["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
                    name=names(i),
                    position=np.array([q[1], 0.0, q[0]][: len(names(i))]),
                    velocity=np.array([]),
                    effort=np.array([1.0, 0.0, 2.0][: len(names(i))]),
                )
            else:
                message = make[kind](data=float(t))
            writer.write(connection, at, types.serialize_cdr(message, kind))
    return folder


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_bags_as_folder_and_as_file(storage, tmp_path):
    folder = write_bag(tmp_path / "bag", storage)
    file = next(p for p in folder.iterdir() if p.suffix in (".db3", ".mcap"))
    alone = shutil.copy(file, tmp_path / file.name)
    for path in (folder, file, alone):
        motion = pf.load_trajectory(path, arm())
        assert_allclose(motion.t, T, atol=1e-9)
        assert_array_equal(motion.q, Q)
        assert_array_equal(motion.reading.effort["base_turn"], 2.0)
        assert "columns not used: 'gripper', 'gripper/effort'" in motion.warnings
    renamed = {"arm_lift": "base_turn", "base_turn": "arm_lift"}
    (tmp_path / "names.yaml").write_text(f"joints: {renamed}")
    other = pf.load_trajectory(folder, arm(), ReadingOptions(columns=tmp_path / "names.yaml"))
    assert_array_equal(other.q, Q[:, ::-1])
    assert_array_equal(other.reading.effort["arm_lift"], 2.0)
    cut = tmp_path / f"cut{file.suffix}"
    cut.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(TrajectoryError, match="the bag is damaged or truncated") as caught:
        pf.load_trajectory(cut, arm())
    assert "\n" not in str(caught.value)


def test_a_bag_without_joint_states_says_what_it_has(tmp_path):
    folder = write_bag(tmp_path / "bag", "SQLITE3", "/battery", "std_msgs/msg/Float64")
    with pytest.raises(
        TrajectoryError,
        match=r"no sensor_msgs/msg/JointState; its topics: "
        r"/battery \(std_msgs/msg/Float64\)",
    ):
        pf.load_trajectory(folder, arm())


def test_messages_without_names_hold_nothing(tmp_path):
    bag = write_bag(tmp_path / "bag", "SQLITE3", names=lambda i: [] if i in (0, 7) else NAMES)
    motion = pf.load_trajectory(bag, arm())
    assert_allclose(motion.q[-1], Q[-1])
    assert_allclose(motion.t[-1], T[-1] - T[1], atol=1e-9)
    bare = write_bag(tmp_path / "bare", "SQLITE3", names=lambda i: [])
    with pytest.raises(TrajectoryError, match="no message of topic /joint_states names a joint"):
        pf.load_trajectory(bare, arm())


def test_a_bag_of_too_many_messages_is_refused_before_they_are_read():
    class Reader:
        connections = tuple(SimpleNamespace(topic="/a", msgcount=n) for n in (5_000_000, 1))

        def messages(self, connections):
            raise AssertionError("read")

    with pytest.raises(TrajectoryError, match=r"bag: has more than 5,000,000 rows; split it"):
        _joint_states(Path("bag"), Reader(), "/a")


def test_a_joint_named_twice_in_a_message_is_refused(tmp_path):
    twice = ["arm_lift", "base_turn", "base_turn"]
    bag = write_bag(tmp_path / "bag", "SQLITE3", names=lambda i: twice if i == 5 else NAMES)
    with pytest.raises(TrajectoryError, match="a message names joint 'base_turn' twice"):
        pf.load_trajectory(bag, arm())


def write_ros1(file, kinds=("sensor_msgs/msg/JointState",), names=NAMES, compression=None, times=T):
    """A bag of the arm's motion, as rosbag record of ROS 1 writes it; `times`: of its stamps."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    make, writer = types.types, Writer(file)
    if compression:
        writer.set_compression(getattr(Writer.CompressionFormat, compression))
    with writer:
        for kind in kinds:
            topic = "/joint_states" if kind.endswith("JointState") else "/battery"
            connection = writer.add_connection(topic, kind, typestore=types)
            for i, (t, q) in enumerate(zip(times, Q, strict=True)):
                at = 1_700_000_000_000_000_000 + round(t * 1e9)
                stamp = make["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
                values = dict(zip(NAMES, [q[1], 0.0, q[0]], strict=True))
                message = (
                    make[kind](
                        header=make["std_msgs/msg/Header"](seq=i, stamp=stamp, frame_id=""),
                        name=list(names),
                        position=np.array([values[name] for name in names]),
                        velocity=np.array([]),
                        effort=7.0 * np.array([values[name] for name in names]),
                    )
                    if topic == "/joint_states"
                    else make[kind](data=float(t))
                )
                writer.write(connection, at + 3_000_000, types.serialize_ros1(message, kind))
    return file


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
def test_bags_of_ros_1(compression, tmp_path):
    kinds = ("std_msgs/msg/Float64", "sensor_msgs/msg/JointState")
    bag = write_ros1(tmp_path / "log.bag", kinds, compression=compression)
    motion = pf.load_trajectory(bag, arm())
    assert_allclose(motion.t, T, atol=1e-9)
    assert_array_equal(motion.q, Q)
    assert_array_equal(motion.reading.effort["base_turn"], 7.0 * Q[:, 0])
    assert "other topics: /battery (std_msgs/msg/Float64)" in motion.warnings[0]


def test_bags_of_ros_1_that_are_cut_or_lack_a_joint(tmp_path):
    bag = write_ros1(tmp_path / "log.bag")
    whole = bag.read_bytes()
    for share in (0.0, 0.001, 0.3, 0.9, 0.999):
        bag.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(TrajectoryError, match=r"log\.bag: the bag is .*rosbag reindex") as e:
            pf.load_trajectory(bag, arm())
        assert "\n" not in str(e.value)
    bag.unlink()
    write_ros1(bag, names=("base_turn",))
    with pytest.raises(TrajectoryError, match="joints without a column: arm_lift"):
        pf.load_trajectory(bag, arm())
    bag.unlink()
    write_ros1(bag, times=np.tile(T[:200], 2))  # two recordings in one
    with pytest.raises(TrajectoryError, match="time must increase; it does not at line 2 ") as e:
        pf.load_trajectory(bag, arm())
    assert "\n" not in str(e.value)
    bag.unlink()
    write_ros1(bag, kinds=("std_msgs/msg/Float64",))
    with pytest.raises(TrajectoryError, match="JointState; its topics: /battery"):
        pf.load_trajectory(bag, arm())
