"""ROS 2 bags (SQLite, MCAP; a file or a bag's folder) with messages sensor_msgs/msg/JointState."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError
from pinfric.study.trajectory.joint_columns import listing
from pinfric.study.trajectory.log.files import OpenedLog, arrays_log

JOINT_STATE = "sensor_msgs/msg/JointState"
#: Endings of the quantities' columns, as the reader names them.
_FIELDS = (("", "position"), ("/velocity", "velocity"), ("/effort", "effort"))


def is_bag(path: Path) -> bool:
    """Whether a path is a bag's file or folder, and there."""
    is_file = path.suffix.lower() in (".db3", ".mcap") and path.is_file()
    return is_file or (path / "metadata.yaml").is_file()


def open_bag(path: Path, joint_names: Sequence[str]) -> OpenedLog:
    """Read the joint states of a bag.

    Times are those of the messages' headers; where these stand still, those at which the bag got
    the messages.

    Args:
        path: .db3 or .mcap, or the folder with metadata.yaml.
        joint_names: the joints that are looked for, where a bag has several such topics.

    Raises:
        TrajectoryError: damaged, no joint states, several topics to choose from, no `rosbags`.
    """
    topic, messages, others = _messages(path, joint_names)
    names = list(dict.fromkeys(itertools.chain.from_iterable(m.name for _, m in messages)))
    place = {name: i for i, name in enumerate(names)}
    columns: dict[str, Any] = {"t": _stamps(messages)}
    for ending, field in _FIELDS:
        values = np.full((len(messages), len(names)), np.nan)
        for row, (_, message) in enumerate(messages):
            numbers = getattr(message, field)
            if len(numbers) == len(message.name):
                values[row, [place[name] for name in message.name]] = numbers
        for i, name in enumerate(names):
            if not np.isnan(values[:, i]).all():
                columns[name + ending] = values[:, i]
    said = (f"joint states of topic {topic}; other topics: {listing(others)}",) if others else ()
    return arrays_log(columns, {"t": "ns"}, said, recorded=True)


def _messages(
    path: Path, joint_names: Sequence[str]
) -> tuple[str, list[tuple[int, Any]], list[str]]:
    """Return the topic of the joint states, its messages (received at ns), the other topics."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise TrajectoryError(
            f"{path}: ROS bags need rosbags: pip install 'pinfric[logs]'"
        ) from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            states = [c for c in reader.connections if c.msgtype == JOINT_STATE and c.msgcount]
            found = {c.topic: [(at, reader.deserialize(raw, JOINT_STATE))
                               for _, at, raw in reader.messages(connections=[c])]
                     for c in states}  # fmt: skip
            topics = [f"{c.topic} ({c.msgtype})" for c in reader.connections]
    except Exception as problem:  # SQLite's, struct's, zstd's, ...: whatever a cut file ends in
        reason = " ".join(f"{problem}".split())[:200] or type(problem).__name__
        raise TrajectoryError(
            f"{path}: the bag is damaged or cut off ({reason}); record it anew, or save what is "
            "left by `ros2 bag reindex`, `sqlite3 FILE .recover` or `mcap recover`"
        ) from None
    if not found:
        raise TrajectoryError(
            f"{path}: the bag has no {JOINT_STATE}; its topics: {listing(topics) or 'none'}"
        )
    topic = _chosen(path, found, joint_names)
    return topic, found[topic], [c for c in topics if not c.startswith(f"{topic} (")]


def _chosen(path: Path, found: dict[str, list[tuple[int, Any]]], joint_names: Sequence[str]) -> str:
    """The one topic whose messages name the most of the joints that are looked for."""
    named = {
        topic: len({name for _, m in messages[:100] for name in m.name} & set(joint_names))
        for topic, messages in found.items()
    }
    best = [topic for topic, count in named.items() if count == max(named.values())]
    if len(best) > 1:
        raise TrajectoryError(
            f"{path}: topics {listing(best)} all have joint states of this robot; keep one of "
            "them: ros2 bag convert, or a CSV file"
        )
    return best[0]


def _stamps(messages: Iterable[tuple[int, Any]]) -> NDArray[np.int64]:
    headers, received = [], []
    for at, message in messages:
        stamp = message.header.stamp
        headers.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
        received.append(at)
    own = np.array(headers, dtype=np.int64)
    return own if np.count_nonzero(np.diff(own)) > 0.9 * (own.size - 1) else np.array(received)
