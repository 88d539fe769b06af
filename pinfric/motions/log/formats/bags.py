"""ROS bags of JointState: of ROS 2 (SQLite, MCAP; a file or a folder) and of ROS 1 (`.bag`)."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError
from pinfric.model.arrays import IntArray
from pinfric.model.yamlfile import brief
from pinfric.motions.joint_columns import listing
from pinfric.motions.log.formats.registry import opens
from pinfric.motions.log.frame import OpenedLog, arrays_log, check_size

JOINT_STATE = "sensor_msgs/msg/JointState"
#: Endings of the quantities' columns, as the reader names them, and the messages' fields.
_FIELDS = {"": "position", "/velocity": "velocity", "/effort": "effort"}
#: Messages that tell a free base's pose or the forces on a frame: their vectors, x, y, z (, w).
_BESIDE = {
    "nav_msgs/msg/Odometry": ("pose.pose.position", "pose.pose.orientation"),
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/WrenchStamped": ("wrench.force", "wrench.torque"),
}
#: Steps between a topic's messages beyond its ends up to which its first and last one hold.
_HOLDS = 3.0
#: Messages of a topic that say which joints it has.
_FEW = 100


#: Ends of the names of bags' files.
_ENDINGS = ".db3", ".mcap", ".bag"


def is_bag(path: Path) -> bool:
    """Whether a path is that of a bag's file or folder."""
    is_file = path.suffix.lower() in _ENDINGS and path.is_file()
    return is_file or (path / "metadata.yaml").is_file()


@dataclass
class _Messages:
    """Messages that name the same joints, as packed numbers: a message object takes 2 kB.

    `order`: their numbers in the topic; `values`: field -> numbers, message after message.
    """

    order: array[int] = field(default_factory=lambda: array("q"))
    values: dict[str, array[float]] = field(default_factory=dict)

    def add(self, number: int, message: Any) -> None:
        self.order.append(number)
        for name in _FIELDS.values():
            numbers = np.asarray(getattr(message, name), dtype=np.float64)
            if numbers.size != len(message.name):
                numbers = np.full(len(message.name), np.nan)
            self.values.setdefault(name, array("d")).frombytes(numbers.tobytes())


@opens(*_ENDINGS)
def open_bag(path: Path, joint_names: Sequence[str] = ()) -> OpenedLog:
    """Read the joint states of a bag: of the topic that names most of the joints.

    Times are those of the messages' headers; where these stand still, those of their reception.
    Poses and wrenches (`_BESIDE`) are interpolated to them.

    Raises:
        TrajectoryError: damaged, no joint states, several topics to choose from, no `rosbags`.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise TrajectoryError(
            f"{path}: ROS bags need rosbags: pip install 'pinfric[logs]'"
        ) from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            topics = [f"{c.topic} ({c.msgtype})" for c in reader.connections]
            topic = _chosen_topic(path, reader, topics, joint_names)
            times, groups = _joint_states(path, reader, topic)
            beside = _beside(reader, times)
    except TrajectoryError:
        raise
    except Exception as problem:  # SQLite's, struct's, zstd's, ...: whatever a cut file ends in
        reason = " ".join(f"{problem}".split())[:200] or type(problem).__name__
        raise TrajectoryError(
            f"{path}: the bag is damaged or truncated ({reason}); record it again, or recover it "
            "by `ros2 bag reindex`, `sqlite3 FILE .recover`, `mcap recover`, or `rosbag reindex`"
        ) from None
    columns: dict[str, NDArray[Any]] = {"t": times}
    joints = list(dict.fromkeys(name for names in groups for name in names))
    for ending, quantity in _FIELDS.items():
        values = {joint: np.full(times.size, np.nan) for joint in joints}
        for names, group in groups.items():
            numbers = np.frombuffer(group.values[quantity]).reshape(-1, len(names))
            for joint, column in zip(names, numbers.T, strict=True):
                values[joint][np.frombuffer(group.order, dtype=np.int64)] = column
        columns |= {
            joint + ending: column for joint, column in values.items() if not np.isnan(column).all()
        }
    columns |= beside
    others = [other for other in topics if not other.startswith(f"{topic} (")]
    notes = (f"joint states of topic {topic}; other topics: {listing(others)}",) if others else ()
    return arrays_log(columns, {"t": "ns"}, notes, recorded=True)


def _chosen_topic(path: Path, reader: Any, topics: list[str], joint_names: Sequence[str]) -> str:
    """The one topic that names most of the joints."""
    states = [c for c in reader.connections if c.msgtype == JOINT_STATE and c.msgcount]
    if not states:
        raise TrajectoryError(
            f"{path}: the bag has no {JOINT_STATE}; its topics: {listing(topics) or 'none'}"
        )
    named: dict[str, set[str]] = {c.topic: set() for c in states}
    for connection in states if len(named) > 1 else ():
        for _, _, raw in islice(reader.messages(connections=[connection]), _FEW):
            named[connection.topic].update(reader.deserialize(raw, JOINT_STATE).name)
    counts = {topic: len(names & set(joint_names)) for topic, names in named.items()}
    best = [topic for topic, count in counts.items() if count == max(counts.values())]
    if len(best) > 1:
        raise TrajectoryError(
            f"{path}: topics {listing(best)} all have joint states of this robot; keep one of "
            "them: `ros2 bag convert`, `rosbag filter`, or a CSV file"
        )
    return best[0]


def _beside(reader: Any, times: IntArray) -> dict[str, NDArray[Any]]:
    """Return the columns of poses and wrenches at times (ns), NaN where a topic has no message."""
    columns: dict[str, NDArray[Any]] = {}
    for connection in reader.connections:
        vectors = _BESIDE.get(connection.msgtype, ())
        if not vectors or connection.msgcount < 2:
            continue
        topic = connection.topic.removesuffix("/wrench")
        names = [
            (vector, part, f"{topic}/{vector.replace('.', '/')}/{part}")
            for vector in vectors
            for part in ("xyzw" if vector.endswith("orientation") else "xyz")
        ]
        headers, received, rows = array("q"), array("q"), list[list[float]]()
        for _, at_reception, raw in reader.messages(connections=[connection]):
            message = reader.deserialize(raw, connection.msgtype)
            headers.append(_stamp(message))
            received.append(at_reception)
            rows.append(
                [float(attrgetter(f"{vector}.{part}")(message)) for vector, part, _ in names]
            )
        # whole ns are too long for a float
        stamps = _times(headers, received)
        own, at = ((x - times[0]).astype(np.float64) for x in (stamps, times))
        order, values = np.argsort(own, kind="stable"), np.array(rows)
        own, values = own[order], values[order]
        reach = _HOLDS * float(np.median(np.diff(own)))
        there = (at >= own[0] - reach) & (at <= own[-1] + reach)
        turns = len(names) == 7  # a pose: position and quaternion
        if turns:
            turn = values[:, 3:]  # q and -q are one attitude
            turned = np.cumprod(np.where((turn[1:] * turn[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
            turn[1:] *= turned[:, None]
        found = np.stack([np.where(there, np.interp(at, own, x), np.nan) for x in values.T])
        if turns:
            found[3:] /= np.linalg.norm(found[3:], axis=0)
        columns |= {name: x for (_, _, name), x in zip(names, found, strict=True)}
    return columns


def _joint_states(
    path: Path, reader: Any, topic: str
) -> tuple[IntArray, dict[tuple[str, ...], _Messages]]:
    """Return a topic's times (ns) and its messages by the joints they name."""
    headers, received = array("q"), array("q")
    groups: dict[tuple[str, ...], _Messages] = {}
    states = [c for c in reader.connections if c.topic == topic and c.msgcount]
    check_size(path, sum(c.msgcount for c in states))
    for _, at, raw in reader.messages(connections=states):
        message = reader.deserialize(raw, JOINT_STATE)
        names = tuple(message.name)
        if not names:
            continue
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise TrajectoryError(
                f"{path}: topic {topic}: a message names joint {brief(twice)} twice; which of its "
                "values counts, cannot be known"
            )
        headers.append(_stamp(message))
        received.append(at)
        groups.setdefault(names, _Messages()).add(len(received) - 1, message)
    if not groups:
        raise TrajectoryError(f"{path}: no message of topic {topic} names a joint")
    return _times(headers, received), groups


def _stamp(message: Any) -> int:
    """Return the time of a message's header, ns."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _times(headers: array[int], received: array[int]) -> IntArray:
    """Return the times of a topic's headers, ns; where these stand still, of its reception."""
    own = np.array(headers, dtype=np.int64)
    steps = np.count_nonzero(np.diff(own))
    return own if steps > 0.9 * (own.size - 1) else np.array(received, dtype=np.int64)
