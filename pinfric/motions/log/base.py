"""Columns of a free base's pose, and of forces on the robot's frames.

A pose of three lengths and a quaternion becomes the six numbers that files have of a free base
(`floating.POSE`), which are then read, filtered and derived as any joint's.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from pinfric.errors import choose_from
from pinfric.model.arrays import FloatArray, IntArray
from pinfric.model.entry import Entry, key, optional
from pinfric.model.floating import MOST_PITCH, POSE, base_numbers
from pinfric.model.yamlfile import brief
from pinfric.motions.joint_columns import JointColumn, listing
from pinfric.motions.log.frame import LogFrame, OpenedLog, Remarks

#: What loggers call the parts of a pose, behind the name of whatever has it.
_PLACE = re.compile(r"(.*?)(?:position|pos|translation|p)[./_ \[(]*([xyz])[\])]?$", re.I)
_TURN = re.compile(
    r"(.*?)(?:orientation|quaternion|quat|rotation|q)[./_ \[(]*([xyzw])[\])]?$", re.I
)
#: And of a wrench on a frame: `foot.fx`, `foot/force/x`, `/foot/wrench/torque/z`.
_SHORT = re.compile(r"(.+)[./]([fm])([xyz])$")
_LONG = re.compile(r"(.+?)[./_](?:wrench[./_])?(force|torque|moment)[./_]?([xyz])$", re.I)
#: A quaternion whose length differs by more from 1 is none; from there on rounding is scaled out.
_LENGTH = 1e-2
#: Cosines of a base's tilt: below the first in every row it lies or hangs, above the second it
#: stands.
_LIES, _STANDS = 0.5, 0.9


class BaseMapping(Entry):
    """Where a log has the pose of a free base."""

    position: tuple[str, str, str] = key("its columns, m", ["px", "py", "pz"])
    quaternion: tuple[str, str, str, str] = key(
        "its columns in the order x, y, z, w", ["qx", "qy", "qz", "qw"]
    )


class WrenchMapping(Entry):
    """Where a log has the force and the moment on a frame, at its origin."""

    force: tuple[str, str, str] = key("its columns x, y, z, N", ["fx", "fy", "fz"])
    moment: tuple[str, str, str] | None = optional("its columns, N m", ["mx", "my", "mz"])
    axes: Literal["frame", "world"] = key(
        "in whose axes they are: the frame's own, or the world's", "world", default="frame"
    )


def with_base(
    log: OpenedLog, joints: Sequence[JointColumn], mapping: BaseMapping | None, said: Remarks
) -> OpenedLog:
    """Return the log with a free base's six columns, made of a position and a quaternion.

    Args:
        joints: the scene's columns. mapping: which columns they are; None: found by their names.
        said: what is missing, or can be no pose, is added here; what was taken, too.
    """
    free = [joint.name for joint in joints if joint.free]
    if not free:
        if mapping is not None:
            said.problems.append("columns: base: the scene's base is fixed (robot.floating)")
        return log
    if mapping is None and any(column.startswith(name) for name in free for column in log.header):
        return log
    used = _pose_columns(log.header, mapping, said)
    if used is None:
        return log

    def numbers(frame: LogFrame, problems: list[str]) -> FloatArray:
        q = frame.values[:, [frame.names.index(name) for name in used]]
        problems += (wrong := _no_pose(q, used, frame.lines))
        return np.full((len(q), 6), np.nan) if wrong else base_numbers(_normal(q))

    def read(names: Sequence[str], problems: list[str], may_lack: Collection[str]) -> LogFrame:
        own = [name for name in names if name in free]
        others = [name for name in names if name not in free]
        if not own:
            return log.read(names, problems, may_lack)
        frame = log.read([*others, *(x for x in used if x not in others)], problems, may_lack)
        pose = numbers(frame, problems)
        columns = [
            pose[:, free.index(name)] if name in free else frame.column(name) for name in names
        ]
        return replace(frame, names=tuple(names), values=np.column_stack(columns))

    said.notes.append(f"the base's pose is read from {listing(used)} (quaternion x, y, z, w)")
    header = [name for name in log.header if name not in used]
    at = [log.header.index(name) for name in header if name in log.header]
    first = [log.first[i] for i in at if i < len(log.first)]
    # behind the others, so that texts of the first row stay beside their names
    return replace(log, header=[*header, *free], first=first, read=read)


def _pose_columns(
    header: Sequence[str], mapping: BaseMapping | None, said: Remarks
) -> list[str] | None:
    """Return the columns x, y, z of a position and x, y, z, w of a quaternion; None: none."""
    if mapping is not None:
        used = [*mapping.position, *mapping.quaternion]
        for name in used:
            if name not in header:
                said.problems.append(
                    f"columns: base: there is no column {brief(name)}; {choose_from(name, header)}"
                )
        return None if said.problems else used
    places, turns = (_groups(header, pattern) for pattern in (_PLACE, _TURN))
    turned = {name: own for name, own in turns.items() if set(own) == set("xyzw")}
    placed = {name: own for name, own in places.items() if set(own) == set("xyz")}
    if len(placed) > 1:  # /odom/pose/position beside /imu/position
        near = {n: own for n, own in placed.items() if n in turned}
        placed = near or placed
    if len(turned) == len(placed) == 1:
        (place,), (turn,) = placed.values(), turned.values()
        return [*(place[x] for x in "xyz"), *(turn[x] for x in "xyzw")]
    several = len(turned) > 1 or len(placed) > 1
    what = "several groups of columns may be" if several else "no columns are"
    said.problems.append(
        f"{what} the pose of the free base: name them by --columns FILE, a YAML file with `base: "
        "{position: [PX, PY, PZ], quaternion: [QX, QY, QZ, QW]}`, or write "
        f"{', '.join(POSE)} of the base behind its joint's name"
    )
    return None


def _groups(header: Sequence[str], pattern: re.Pattern[str]) -> dict[str, dict[str, str]]:
    groups: dict[str, dict[str, str]] = {}
    for name in header:
        if match := pattern.fullmatch(name):
            groups.setdefault(match[1], {})[match[2].lower()] = name
    return groups


def _normal(q: FloatArray) -> FloatArray:
    return np.hstack([q[:, :3], q[:, 3:] / np.linalg.norm(q[:, 3:], axis=1, keepdims=True)])


def _no_pose(q: FloatArray, used: Sequence[str], lines: Sequence[int]) -> list[str]:
    """Return why numbers (T, 7) are no poses of a base that stands or walks."""
    if not np.isfinite(q).all():
        return []  # said of their columns
    columns, length = listing(used[3:]), np.linalg.norm(q[:, 3:], axis=1)
    if (wrong := np.flatnonzero(np.abs(length - 1.0) > _LENGTH)).size:
        return [
            f"columns {columns} are no quaternion: their length is {length[wrong[0]]:.4g} at line "
            f"{lines[wrong[0]]} (rows: {wrong.size}), and should be 1"
        ]
    upright, other = (_upright(_normal(x)) for x in (q, q[:, [0, 1, 2, 4, 5, 6, 3]]))
    if (upright < _LIES).all() and (other > _STANDS).all():
        w, x, y, z = used[3:]
        return [
            f"columns {columns} are read as x, y, z, w of a quaternion, by which the base hangs "
            f"upside down or lies; as w, x, y, z it stands: write `quaternion: [{x}, {y}, {z}, "
            f"{w}]` (x, y, z, w) in the file given by --columns"
        ]
    pitch = np.abs(base_numbers(_normal(q))[:, 4])
    if (pitch > MOST_PITCH).any():
        at = int(np.argmax(pitch))
        return [
            f"the base pitches by {np.degrees(pitch[at]):.3g} deg at line {lines[at]}, where roll "
            "and yaw are not determined; give such motions in Python: Trajectory.from_arrays"
        ]
    return []


def _upright(q: FloatArray) -> FloatArray:
    """Return the cosine of the base's tilt (T,)."""
    return np.asarray(1.0 - 2.0 * (q[:, 3] ** 2 + q[:, 4] ** 2))


def wrench_columns(
    header: Sequence[str],
    frames: Collection[str],
    named: Mapping[str, WrenchMapping],
    problems: list[str],
) -> dict[str, dict[int, str]]:
    """Return frame -> component of its wrench, 0 to 5 (force, moment) -> its column.

    Args:
        frames: the robot's. named: by frame, what a person says; problems with it are added.
    """
    found: dict[str, dict[int, str]] = {}
    for name in header:
        match = _SHORT.fullmatch(name) or _LONG.fullmatch(name)
        if match is None:
            continue
        frame = match[1] if match[1] in frames else re.split(r"[./]", match[1].strip("/."))[-1]
        if frame in frames:
            component = "xyz".index(match[3].lower()) + 3 * (match[2].lower()[0] != "f")
            found.setdefault(frame, {}).setdefault(component, name)
    for frame, entry in named.items():
        if frame not in frames:
            problems.append(
                f"columns: external: there is no frame {frame!r}; {choose_from(frame, frames)}"
            )
        listed = [*(entry.force or (None,) * 3), *(entry.moment or (None,) * 3)]
        found[frame] = {k: name for k, name in enumerate(listed) if name is not None}
        for name in found[frame].values():
            if name not in header:
                problems.append(
                    f"columns: external.{frame}: there is no column {brief(name)}; "
                    f"{choose_from(name, header)}"
                )
    return found


def wrenches(
    found: dict[str, dict[int, str]], frame: LogFrame, kept: IntArray | slice
) -> dict[str, FloatArray]:
    """Return frame -> its wrench at the rows kept, (T, 6); components without a column are 0."""
    on = {}
    for name, parts in found.items():
        wrench = np.zeros((len(frame.values), 6))
        for component, column in parts.items():
            wrench[:, component] = frame.column(column)
        on[name] = wrench[kept]
    return on
