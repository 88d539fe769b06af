"""Loops and drives off the joints: pairs of frames between which forces act.

A loop closes at frame a (on link A) and frame b (on link B); a cylinder pushes between two points,
a force between a link and the world. All of them are *actions*: a unit wrench of side a on side b
at b's origin, and its opposite, at the same place, on side a. An action of size x changes the
wrench that joint j transmits, and the generalized effort, by

    w_j += X_j x,     tau += J^T x,     J^T = -E^T X

(paper eq. 10-15 for forces between two bodies). Joints that carry both sides feel
nothing: the two wrenches cancel there exactly. Columns stand in the order: drives off the joints,
multipliers lambda of the loops, friction of the loops' joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.errors import RobotError, SceneError
from pinfric.model.drives import Drive
from pinfric.model.robot import link_frame
from pinfric.model.schema import (
    Actuator,
    Cylinder,
    Friction,
    Loop,
    PointForce,
)

#: How a pair of frames acts.
LOOP, CYLINDER, FORCE = range(3)
#: Which rotations a loop forbids: none, those that tilt the axis, all.
_NO_ROTATION, _TILT, _ROTATION = range(3)


@dataclass(frozen=True)
class OffJointDrive(Drive):
    """A drive that does not sit on a joint of the tree; `velocity_index` is -1.

    Attributes:
        column: its column among the actions.
        unit: of its effort: "N" along a cylinder or a force, "N m" at a loop's joint.
    """

    column: int = 0
    unit: str = "N"


@dataclass(frozen=True)
class Linkage:
    """All loops and drives off the joints as arrays for the kernels.

    Attributes:
        loops, drives: what they came from.
        pair_kind: (np,) `LOOP`, `CYLINDER` or `FORCE`; the loops come first.
        rotation: (np,) which rotations are closed: 0 none, 1 tilting of the axis, 2 all.
        frame_joint: (np, 2) row of the joint that carries frame a, b; -1 is the ground.
        frame_p, frame_R: (np, 2, 3), (np, 2, 3, 3) the frame in that joint's frame.
        pair_axis: (np, 3) unit axis in both frames.
        column_pair: (nx,) pair of each column.
        unit: (nx, 6) unit wrench of a on b in frame b, linear first; zero for a cylinder, whose
            force follows the line between its ends.
        support: (nx, nj) int8: 1 where a joint carries side b only, -1 side a only, 0 both or none.
        off_joint: columns [0, off_joint) are drives,
        multipliers: columns [off_joint, off_joint + multipliers) are lambda, the rest friction.
        friction_column: (number of loops,) first friction column of each loop, -1 without
            friction; a spherical joint has three.
        size: m, a length of the mechanism that gaps are compared with.
    """

    loops: tuple[Loop, ...]
    drives: tuple[OffJointDrive, ...]
    pair_kind: np.ndarray
    rotation: np.ndarray
    frame_joint: np.ndarray
    frame_p: np.ndarray
    frame_R: np.ndarray  # noqa: N815 - a rotation matrix
    pair_axis: np.ndarray
    column_pair: np.ndarray
    unit: np.ndarray
    support: np.ndarray
    off_joint: int
    multipliers: int
    friction_column: np.ndarray
    size: float

    @property
    def lambdas(self) -> slice:
        """The columns of the multipliers."""
        return slice(self.off_joint, self.off_joint + self.multipliers)

    @property
    def solved(self) -> int:
        """Number of the columns that are solved for: drives off the joints and multipliers."""
        return self.off_joint + self.multipliers

    def loop_of_row(self, row: int) -> Loop:
        """Return the loop that a row of the closure belongs to."""
        return self.loops[self.column_pair[self.off_joint + row]]


def make_linkage(
    model: pin.Model,
    loops: Sequence[Loop],
    actuators: Sequence[Actuator],
    friction: Mapping[str, Friction],
    source: str,
) -> Linkage:
    """Tabulate a scene's loops and its drives off the joints.

    Args:
        model: the robot, locked joints removed.
        loops: of the scene.
        actuators: all of them; those on joints of the tree are passed over.
        friction: joint or loop name -> friction: which loops have friction columns.
        source: the scene, for messages.

    Raises:
        SceneError: a name that is not there or stands twice, an axis or direction of length zero,
            two sides on one body.
    """
    _check_names(model, loops, source)
    pairs = [_loop_pair(model, loop, f"{source}: loops.{loop.name}") for loop in loops]
    columns: list[tuple[int, np.ndarray]] = []
    drives: list[OffJointDrive] = []
    loop_rows = {loop.name: row for row, loop in enumerate(loops)}
    for index, actuator in enumerate(actuators):
        where = f"{source}: actuators[{index}]"
        if actuator.joint is not None:
            if actuator.joint not in loop_rows:
                continue
            row = loop_rows[actuator.joint]
            if loops[row].kind not in ("revolute", "planar_pin"):
                raise SceneError(f"{where}: loop {actuator.joint!r} is {loops[row].kind}: it has "
                                 "no single axis to drive")  # fmt: skip
            unit = np.concatenate([np.zeros(3), pairs[row]["axis"]])
            columns.append((row, unit))
            name, kind = actuator.joint, "N m"
        elif actuator.cylinder is not None:
            name, kind = actuator.cylinder.name, "N"
            pairs.append(_cylinder_pair(model, actuator.cylinder, where))
            columns.append((len(pairs) - 1, np.zeros(6)))
        else:
            assert actuator.force is not None  # the schema requires one of the three
            name, kind = actuator.force.name, "N"
            pairs.append(_force_pair(model, actuator.force, where))
            columns.append((len(pairs) - 1, np.concatenate([pairs[-1]["axis"], np.zeros(3)])))
        drives.append(OffJointDrive(name, -1, actuator.transmission, len(drives), kind))
    off_joint = len(columns)
    for row, loop in enumerate(loops):
        columns += [(row, unit) for unit in _closed_directions(loop.kind, pairs[row]["axis"])]
    multipliers = len(columns) - off_joint
    friction_column = np.full(len(loops), -1, dtype=np.int64)
    for row, loop in enumerate(loops):
        if loop.name in friction:
            friction_column[row] = len(columns)
            axes = np.eye(3) if loop.kind == "spherical" else pairs[row]["axis"][None]
            columns += [(row, np.concatenate([np.zeros(3), axis])) for axis in axes]
    column_pair = np.array([pair for pair, _ in columns], dtype=np.int64)
    joints = np.array([pair["joint"] for pair in pairs], dtype=np.int64).reshape(-1, 2)
    return Linkage(
        loops=tuple(loops),
        drives=tuple(drives),
        pair_kind=np.array([pair["kind"] for pair in pairs], dtype=np.int64),
        rotation=np.array([pair["rotation"] for pair in pairs], dtype=np.int64),
        frame_joint=joints,
        frame_p=np.array([pair["p"] for pair in pairs], dtype=float).reshape(-1, 2, 3),
        frame_R=np.array([pair["R"] for pair in pairs], dtype=float).reshape(-1, 2, 3, 3),
        pair_axis=np.array([pair["axis"] for pair in pairs], dtype=float).reshape(-1, 3),
        column_pair=column_pair,
        unit=np.array([unit for _, unit in columns], dtype=float).reshape(-1, 6),
        support=_support(model, joints[column_pair]),
        off_joint=off_joint,
        multipliers=multipliers,
        friction_column=friction_column,
        size=_size(model, pairs),
    )


def check_loop_friction(loop: Loop, friction: Friction, where: str) -> None:
    """Check that friction fits the joint that closes a loop.

    Raises:
        SceneError: a bearing of another kind of joint, friction where nothing moves.
    """
    if loop.kind == "fixed":
        raise SceneError(f"{where}: a {loop.kind} loop does not move: it has no friction")
    check_bearing(friction, f"{loop.kind} loop", where)
    for term in friction.terms if loop.kind == "spherical" else ():
        if term.directed:
            raise SceneError(f"{where}.{term.key}: a ball has no positive and negative direction")


def check_bearing(friction: Friction, joint: str, where: str) -> None:
    """Check that a bearing, if there is one, fits its joint.

    Args:
        friction: the joint's.
        joint: what it is; see `Bearing.fits`.
        where: path of the entry, for the message.

    Raises:
        SceneError: a bearing of another kind of joint.
    """
    if friction.bearing is not None and (wrong := friction.bearing.misfit(joint)):
        raise SceneError(f"{where}.bearing{wrong}")


def _check_names(model: pin.Model, loops: Sequence[Loop], source: str) -> None:
    taken = set(tuple(model.names)[1:])
    for loop in loops:
        if loop.name in taken:
            raise SceneError(f"{source}: loops: the name {loop.name!r} is taken by a joint or "
                             "another loop")  # fmt: skip
        taken.add(loop.name)


def _loop_pair(model: pin.Model, loop: Loop, where: str) -> dict[str, Any]:
    sides = []
    for side, entry in (("a", loop.a), ("b", loop.b)):
        local = pin.SE3(pin.rpy.rpyToMatrix(*entry.rpy), np.array(entry.xyz))
        sides.append(_frame(model, entry.link, local, f"{where}.{side}.link"))
    rotation = {"revolute": _TILT, "fixed": _ROTATION}.get(loop.kind, _NO_ROTATION)
    axis = _direction(loop.axis, f"{where}.axis")
    return _pair(LOOP, rotation, axis, sides, where)


def _cylinder_pair(model: pin.Model, cylinder: Cylinder, where: str) -> dict[str, Any]:
    where = f"{where}: cylinder {cylinder.name!r}"
    sides = [
        _frame(model, end.link, pin.SE3(np.eye(3), np.array(end.xyz)), f"{where}.{side}.link")
        for side, end in (("a", cylinder.a), ("b", cylinder.b))
    ]
    return _pair(CYLINDER, _NO_ROTATION, np.array([0.0, 0.0, 1.0]), sides, where)


def _force_pair(model: pin.Model, force: PointForce, where: str) -> dict[str, Any]:
    where = f"{where}: force {force.name!r}"
    at = _frame(model, force.link, pin.SE3(np.eye(3), np.array(force.xyz)), f"{where}.link")
    direction = _direction(force.direction, f"{where}.direction")
    return _pair(FORCE, _NO_ROTATION, direction, [(-1, pin.SE3.Identity()), at], where)


def _pair(
    kind: int, rotation: int, axis: np.ndarray, sides: list[tuple[int, pin.SE3]], where: str
) -> dict[str, Any]:
    if sides[0][0] == sides[1][0]:
        raise SceneError(f"{where}: both sides are on the same rigid body")
    return {
        "kind": kind,
        "rotation": rotation,
        "axis": axis,
        "joint": [joint for joint, _ in sides],
        "p": [placement.translation for _, placement in sides],
        "R": [placement.rotation for _, placement in sides],
    }


def _frame(model: pin.Model, link: str, local: pin.SE3, where: str) -> tuple[int, pin.SE3]:
    """(row of the joint that carries it, placement in that joint's frame)."""
    try:
        frame = model.frames[link_frame(model, link)]
    except RobotError as problem:
        raise SceneError(f"{where}: {problem}") from None
    return frame.parentJoint - 1, frame.placement * local


def _direction(given: Sequence[float], where: str) -> np.ndarray:
    direction = np.array(given, dtype=float)
    length = float(np.linalg.norm(direction))
    if length < 1e-9:
        raise SceneError(f"{where}: {list(given)} has no direction")
    return direction / length


def _closed_directions(kind: str, axis: np.ndarray) -> list[np.ndarray]:
    """Unit wrenches (6,) in frame b that a loop's joint transmits, friction left out."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    across = [first, np.cross(axis, first)]
    force = [np.concatenate([e, np.zeros(3)]) for e in np.eye(3)]
    moment = [np.concatenate([np.zeros(3), e]) for e in np.eye(3)]
    if kind == "planar_pin":
        return [np.concatenate([e, np.zeros(3)]) for e in across]
    if kind == "revolute":
        return force + [np.concatenate([np.zeros(3), e]) for e in across]
    return force + moment if kind == "fixed" else force


def _support(model: pin.Model, joints: np.ndarray) -> np.ndarray:
    """(nx, nj) which side of each column every joint carries."""
    nj = model.njoints - 1
    table = np.zeros((len(joints), nj), dtype=np.int8)
    for column, (a, b) in enumerate(joints.tolist()):
        for row, sign in ((b, 1), (a, -1)):
            while row >= 0:
                table[column, row] += sign
                row = model.parents[row + 1] - 1
    return table


def _size(model: pin.Model, pairs: list[dict[str, Any]]) -> float:
    lengths = [np.linalg.norm(model.jointPlacements[j].translation)
               for j in range(1, model.njoints)]  # fmt: skip
    lengths += [np.linalg.norm(p) for pair in pairs for p in pair["p"]]
    return float(max(lengths, default=0.0)) or 1.0
