"""Loops, and drives that are not on joints: pairs of frames between which forces act.

A loop closes at frame a (on link A) and frame b (on link B); a cylinder pushes between two points,
a force between a link and the world. Each is an *action*: a unit wrench of side a on side b at b's
origin, and its opposite, at the same place, on side a. An action of size x changes the wrench that
joint j transmits, and the generalized effort, by

    w_j += X_j x,     tau += J^T x,     J^T = -E^T X

(paper eq. 10-15; `notebooks/theory/wrench_twin.md`). The columns are: drives off the joints,
multipliers lambda of the loops, friction of the loops' joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeGuard

import numpy as np
import pinocchio as pin

from pinfric.errors import RobotError, SceneError
from pinfric.model.drives import Drive
from pinfric.model.robot import link_frame
from pinfric.model.schema import (
    Actuator,
    Friction,
    Loop,
    PointForce,
)
from pinfric.model.spring_entries import LineSpring, LinkPoint, Spring

#: Kinds of pairs. In a `SLIDING` loop frame b moves along frame a's axis. The moment of a
#: `UNIVERSAL` loop is about the common normal of two axes, which depends on the configuration, as
#: does the line of a cylinder.
LOOP, CYLINDER, FORCE, UNIVERSAL, SLIDING = range(5)
#: Directions closed: none, those across the axis, all, the common normal of two axes.
_NONE, _ACROSS, _ALL, _NORMAL = range(4)
#: Kind of a loop -> forces and moments it transmits, how it acts.
_KINDS = {
    "spherical": (_ALL, _NONE, LOOP),
    "revolute": (_ALL, _ACROSS, LOOP),
    "fixed": (_ALL, _ALL, LOOP),
    "planar_pin": (_ACROSS, _NONE, LOOP),
    "prismatic": (_ACROSS, _ALL, SLIDING),
    "cylindrical": (_ACROSS, _ACROSS, SLIDING),
    "universal": (_ALL, _NORMAL, UNIVERSAL),
}
#: Kind of a loop with one degree of freedom -> whether it slides (or else turns).
_ONE_WAY = {"revolute": False, "planar_pin": False, "prismatic": True}


@dataclass(frozen=True)
class Linkage:
    """All loops and drives off the joints as arrays for the kernels.

    Attributes:
        pair_kind: (np,) `LOOP`, `CYLINDER`, `FORCE`, `UNIVERSAL`, `SLIDING`; the loops come first.
        rotation: (np,) which rotations are closed: 0 none, 1 tilting of the axis, 2 all, 3 about
            the common normal of two axes.
        frame_joint: (np, 2) row of the joint that carries frame a, b; -1 is the ground.
        frame_p, frame_R: (np, 2, 3), (np, 2, 3, 3) the frame in that joint's frame; frame a of a
            universal loop is turned so that its axis has the coordinates of `axis_b` in frame b.
        pair_axis: (np, 3) unit axis in both frames.
        column_pair: (nx,) pair of each column.
        unit: (nx, 6) unit wrench of a on b in frame b, linear first; zero for a cylinder, whose
            force is along the line between its ends; `pair_axis` for the moment of a universal
            loop, which is about the common normal. `action_maps` computes the actual wrenches.
        support: (nx, nj) int8: 1 where a joint carries side b only, -1 side a only, 0 both or none.
        off_joint: columns [0, off_joint) are drives,
        multipliers: columns [off_joint, off_joint + multipliers) are lambda, the rest friction.
        friction_column: (np,) first friction column of each pair, -1 without friction; a spherical
            joint has three, a cylinder its drive's column.
        rods: names of the springs with friction along their line; their pairs come last.
        rest_gap: (nx,) the gap of a closed column: 0, except for cylinders that stand still.
        size: m, a length of the mechanism, with which gaps are compared.
        standing: columns of loops' joints and of cylinders that stand still, see `stand_still`.
    """

    loops: tuple[Loop, ...]
    drives: tuple[Drive, ...]
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
    rest_gap: np.ndarray
    size: float
    rods: tuple[str, ...] = ()
    standing: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def lambdas(self) -> slice:
        """The columns of the multipliers."""
        return slice(self.off_joint, self.off_joint + self.multipliers)

    @cached_property
    def closed(self) -> np.ndarray:
        """The columns (nc,) without motion: multipliers, then joints and drives at a standstill."""
        return np.concatenate([np.arange(self.off_joint, self.solved), self.standing])

    @cached_property
    def turning(self) -> np.ndarray:
        """Which closed columns (nc,) are moments; their gaps are angles."""
        return np.asarray(self.unit[self.closed, 3:].any(axis=1))

    @property
    def solved(self) -> int:
        """Number of the columns that are solved for: drives off the joints and multipliers."""
        return self.off_joint + self.multipliers

    @property
    def cylinders(self) -> dict[str, int]:
        """Name -> pair of the drives and springs along the line between two points."""
        pairs = {drive.name: int(self.column_pair[drive.column]) for drive in self.drives}
        pairs |= dict(
            zip(
                self.rods,
                range(len(self.pair_kind) - len(self.rods), len(self.pair_kind)),
                strict=True,
            )
        )
        return {name: pair for name, pair in pairs.items() if self.pair_kind[pair] == CYLINDER}

    def name_of_row(self, row: int) -> str:
        """Return the name of the loop (or cylinder) that a row of the closure belongs to."""
        column = self.closed[row]
        pair = int(self.column_pair[column])
        if pair < len(self.loops):
            return self.loops[pair].name
        rods = {number: name for name, number in self.cylinders.items()}
        return self.drives[column].name if column < self.off_joint else rods[pair]


def make_linkage(
    model: pin.Model,
    loops: Sequence[Loop],
    actuators: Sequence[Actuator],
    friction: Mapping[str, Friction],
    source: str,
    springs: Sequence[Spring] = (),
) -> Linkage:
    """Tabulate a scene's loops, its drives off the joints and the springs with friction.

    Actuators on joints of the tree and springs without friction are skipped. `friction` decides
    which loops and cylinders have friction columns.

    Raises:
        SceneError: an unknown or duplicate name, an axis or direction of length zero, both sides on
            one body, friction that does not fit its loop.
    """
    taken = set(tuple(model.names)[1:])
    pairs = []
    for loop in loops:
        if loop.name in taken:
            raise SceneError(
                f"{source}: loops: the name {loop.name!r} is taken by a joint or another loop"
            )
        taken.add(loop.name)
        where = f"{source}: {loop_place(loops, loop.name)}"
        sides = [loop_frame(model, loop, side, where) for side in ("a", "b")]
        axis, (_, rotation, kind) = loop_axis(loop, "b", where), _KINDS[loop.kind]
        if loop.kind == "universal":
            turn = turn_between(axis, loop_axis(loop, "a", where))
            sides[0][1].rotation = sides[0][1].rotation @ turn
        pairs.append(_pair(kind, rotation, axis, sides, where))
    drives, columns = _drives(model, loops, actuators, pairs, source)
    off_joint = len(columns)
    for row, loop in enumerate(loops):
        columns += [(row, unit) for unit in _closed_directions(loop.kind, pairs[row]["axis"])]
    multipliers = len(columns) - off_joint
    rods = [spring for spring in springs if rubs(spring, friction)]
    for rod in rods:
        where = f"{source}: springs: {rod.name}"
        sides = [
            _point(model, end, f"{where}.{side}.link") for side, end in (("a", rod.a), ("b", rod.b))
        ]
        pairs.append(_pair(CYLINDER, _NONE, np.array([0.0, 0.0, 1.0]), sides, where))
    friction_column = _friction_columns(loops, drives, friction, pairs, columns, source)
    for pair, rod in enumerate(rods, len(pairs) - len(rods)):
        check_bearing(friction[rod.name], "cylinder", f"{source}: friction.{rod.name}")
        friction_column[pair] = len(columns)
        columns.append((pair, np.zeros(6)))
    column_pair = np.array([pair for pair, _ in columns], dtype=np.int64)
    joints = np.array([pair["joint"] for pair in pairs], dtype=np.int64).reshape(-1, 2)
    support = np.zeros((len(columns), model.njoints - 1), dtype=np.int8)
    for column, (a, b) in enumerate(joints[column_pair].tolist()):
        for end, sign in ((b, 1), (a, -1)):
            for row in carriers(model, end):
                support[column, row] += sign
    lengths = [
        np.linalg.norm(model.jointPlacements[j].translation) for j in range(1, model.njoints)
    ]
    lengths += [np.linalg.norm(p) for pair in pairs for p in pair["p"]]
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
        support=support,
        off_joint=off_joint,
        multipliers=multipliers,
        friction_column=friction_column,
        rest_gap=np.zeros(len(columns)),
        size=float(max(lengths, default=0.0)) or 1.0,
        rods=tuple(rod.name for rod in rods),
    )


def rubs(spring: Spring, friction: Mapping[str, Friction]) -> TypeGuard[LineSpring]:
    """Return whether a spring between points has friction along its line."""
    return isinstance(spring, LineSpring) and spring.name in friction


def no_linkage(model: pin.Model) -> Linkage:
    """Return the empty tables of an open chain without drives off its joints."""
    return make_linkage(model, (), (), {}, "")


def _friction_columns(
    loops: Sequence[Loop],
    drives: Sequence[Drive],
    friction: Mapping[str, Friction],
    pairs: list[dict[str, Any]],
    columns: list[tuple[int, np.ndarray]],
    source: str,
) -> np.ndarray:
    """(np,) first friction column of each pair or -1; columns of loops' joints are added."""
    column_of = np.full(len(pairs), -1, dtype=np.int64)
    for drive in drives:
        pair = columns[drive.column][0]
        if pairs[pair]["kind"] == CYLINDER and drive.name in friction:
            check_bearing(friction[drive.name], "cylinder", f"{source}: friction.{drive.name}")
            column_of[pair] = drive.column
    for row, loop in enumerate(loops):
        if loop.name in friction:
            check_loop_friction(loop, friction[loop.name], f"{source}: friction.{loop.name}")
            column_of[row] = len(columns)
            free = (
                np.eye(6)[3:]
                if loop.kind == "spherical"
                else [_free_direction(loop.kind, pairs[row]["axis"])]
            )
            columns += [(row, unit) for unit in free]
    return column_of


def stand_still(
    linkage: Linkage, before: Linkage, columns: np.ndarray, place: Sequence[pin.SE3]
) -> Linkage:
    """Return the linkage with some joints of loops, or cylinders, fixed at their positions.

    Frame a is moved to frame b, so that their gaps are zero. A cylinder keeps its length. A point
    that a force drives has no position to keep and stays free.

    Args:
        linkage: in which nothing stands still.
        before: the same linkage with joints that stand still already; they keep their frames.
        columns: of the joints and drives that stand still.
        place: poses of the joints of the tree in the world, the ground first.
    """
    kind, rotation = linkage.pair_kind.copy(), linkage.rotation.copy()
    p, R, gap = linkage.frame_p.copy(), linkage.frame_R.copy(), linkage.rest_gap.copy()
    known = set(before.column_pair[before.standing].tolist())
    columns = columns[kind[linkage.column_pair[columns]] != FORCE]
    for column in columns:
        pair = linkage.column_pair[column]
        a, b = (place[joint + 1] for joint in linkage.frame_joint[pair].tolist())
        if kind[pair] == CYLINDER:
            gap[column] = (
                before.rest_gap[column]
                if pair in known
                else np.linalg.norm(b * p[pair, 1] - a * p[pair, 0])
            )
            continue
        kind[pair], rotation[pair] = LOOP, _ALL
        if pair in known:
            p[pair], R[pair] = before.frame_p[pair], before.frame_R[pair]
            continue
        frame = a.actInv(b * pin.SE3(R[pair, 1], p[pair, 1]))
        p[pair, 0], R[pair, 0] = frame.translation, frame.rotation
    return replace(
        linkage,
        pair_kind=kind,
        rotation=rotation,
        frame_p=p,
        frame_R=R,
        rest_gap=gap,
        standing=columns,
    )


def loop_place(loops: Sequence[Loop], name: str) -> str:
    """Return how messages name a loop's (or drive's) place in a scene: loops[1] (rocker_pin)."""
    index = next((i for i, loop in enumerate(loops) if loop.name == name), None)
    return f"actuator {name!r}" if index is None else f"loops[{index}] ({name})"


def _drives(
    model: pin.Model,
    loops: Sequence[Loop],
    actuators: Sequence[Actuator],
    pairs: list[dict[str, Any]],
    source: str,
) -> tuple[list[Drive], list[tuple[int, np.ndarray]]]:
    """The drives off the joints and their columns; cylinders and forces are added to the pairs."""
    columns: list[tuple[int, np.ndarray]] = []
    drives: list[Drive] = []
    loop_rows = {loop.name: row for row, loop in enumerate(loops)}
    for index, actuator in enumerate(actuators):
        where = f"{source}: actuators[{index}]"
        if actuator.joint is not None:
            if actuator.joint not in loop_rows:
                continue
            row = loop_rows[actuator.joint]
            if actuator.couples:
                raise SceneError(
                    f"{where}: couples: {actuator.joint!r} is the joint of a loop; only "
                    "drives on joints of the tree can be coupled"
                )
            if loops[row].kind not in _ONE_WAY:
                raise SceneError(
                    f"{where}: loop {actuator.joint!r} is {loops[row].kind}: it has "
                    "no single axis to drive"
                )
            columns.append((row, _free_direction(loops[row].kind, pairs[row]["axis"])))
            pushes = slides(loops[row])
        elif actuator.cylinder is not None:
            pushes = True
            where = f"{where}: cylinder {actuator.drive_name!r}"
            ends = ("a", actuator.cylinder.a), ("b", actuator.cylinder.b)
            sides = [_point(model, end, f"{where}.{side}.link") for side, end in ends]
            pairs.append(_pair(CYLINDER, _NONE, np.array([0.0, 0.0, 1.0]), sides, where))
            columns.append((len(pairs) - 1, np.zeros(6)))
        else:
            assert actuator.force is not None  # the schema requires one of the three
            pushes = True
            where = f"{where}: force {actuator.drive_name!r}"
            sides = [(-1, pin.SE3.Identity()), _point(model, actuator.force, f"{where}.link")]
            direction = _direction(actuator.force.direction, f"{where}.direction")
            pairs.append(_pair(FORCE, _NONE, direction, sides, where))
            columns.append((len(pairs) - 1, np.concatenate([pairs[-1]["axis"], np.zeros(3)])))
        drives.append(
            Drive(
                actuator.drive_name,
                -1,
                pushes,
                actuator.transmission,
                actuator.share,
                column=len(drives),
                encoder=actuator.encoder,
            )
        )
    return drives, columns


def check_loop_friction(loop: Loop, friction: Friction, where: str) -> None:
    """Check that friction fits the joint that closes a loop.

    Raises:
        SceneError: a bearing of another kind of joint, friction of a fixed loop.
    """
    if loop.kind == "fixed":
        raise SceneError(f"{where}: a fixed loop cannot move, so it has no friction; remove it")
    if loop.kind in ("cylindrical", "universal"):
        raise SceneError(
            f"{where}: a {loop.kind} loop has two degrees of freedom and cannot have "
            "friction; replace it by two joints with a massless link between "
            "them, each joint with its own friction"
        )
    check_bearing(friction, f"{loop.kind} loop", where)
    for name, term in friction.named_terms.items() if loop.kind == "spherical" else ():
        if term.directed:
            raise SceneError(f"{where}.{name}: a ball has no positive and negative direction")


def check_bearing(friction: Friction, joint: str, where: str) -> None:
    """Check that a bearing, if there is one, fits its joint (see `Bearing.fits`).

    Raises:
        SceneError: a bearing of another kind of joint; begins with `where`, the entry's path.
    """
    if friction.bearing is not None and (wrong := friction.bearing.misfit(joint)):
        raise SceneError(f"{where}.bearing{wrong}")


def slides(loop: Loop) -> bool:
    """Return whether a loop's joint slides along its axis and moves in no other way."""
    return _ONE_WAY.get(loop.kind, False)


def _free_direction(kind: str, axis: np.ndarray) -> np.ndarray:
    """Unit wrench (6,) along the one free motion of a loop's joint."""
    none = np.zeros(3)
    return np.concatenate([axis, none] if _ONE_WAY[kind] else [none, axis])


def loop_frame(model: pin.Model, loop: Loop, side: str, where: str) -> tuple[int, pin.SE3]:
    """Return the row of the joint that carries side "a" or "b" of a loop, and the frame's pose.

    Raises:
        SceneError: unknown link; begins with `where`, the loop's entry.
    """
    entry = loop.a if side == "a" else loop.b
    local = pin.SE3(pin.rpy.rpyToMatrix(*entry.rpy), np.array(entry.xyz))
    return _frame(model, entry.link, local, f"{where}.{side}.link")


def loop_axis(loop: Loop, side: str, where: str) -> np.ndarray:
    """Return the unit axis (3,) of a loop in frame "a" or "b".

    Raises:
        SceneError: an axis of length zero; begins with `where`, the loop's entry.
    """
    if side == "b" and loop.axis_b is not None:
        return _direction(loop.axis_b, f"{where}.axis_b")
    return _direction(loop.axis, f"{where}.axis")


def turn_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the least rotation (3, 3) that takes one unit vector (3,) to another."""
    return np.asarray(pin.Quaternion.FromTwoVectors(start, end).toRotationMatrix())


def two_points(
    model: pin.Model, a: LinkPoint, b: LinkPoint, where: str
) -> list[tuple[int, np.ndarray]]:
    """Return of two points the row of the joint that carries each, and its place (3,) there.

    Raises:
        SceneError: an unknown link, both on one body; begins with `where`.
    """
    sides = [_point(model, end, f"{where}.{side}.link") for side, end in (("a", a), ("b", b))]
    if sides[0][0] == sides[1][0]:
        raise SceneError(
            f"{where}: its ends are on the same rigid body and move with it; name two links that "
            "a joint moves against each other"
        )
    return [(row, frame.translation) for row, frame in sides]


def _point(model: pin.Model, at: LinkPoint | PointForce, where: str) -> tuple[int, pin.SE3]:
    return _frame(model, at.link, pin.SE3(np.eye(3), np.array(at.xyz)), where)


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


def _direction(vector: Sequence[float], where: str) -> np.ndarray:
    direction = np.array(vector, dtype=float)
    length = float(np.linalg.norm(direction))
    if length < 1e-9:
        raise SceneError(f"{where}: {list(vector)} has no direction; its length must not be 0")
    return direction / length


def _closed_directions(kind: str, axis: np.ndarray) -> list[np.ndarray]:
    """Unit wrenches (6,) in frame b that a loop's joint transmits without friction."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    choice = {
        _NONE: [],
        _ACROSS: [first, np.cross(axis, first)],
        _ALL: list(np.eye(3)),
        _NORMAL: [axis],
    }
    forces, moments, _ = _KINDS[kind]
    return [np.concatenate([e, np.zeros(3)]) for e in choice[forces]] + [
        np.concatenate([np.zeros(3), e]) for e in choice[moments]
    ]


def carriers(model: pin.Model, joint: int) -> set[int]:
    """Return the rows of the joints between a joint's link and the ground; -1 is the ground."""
    rows = set()
    while joint >= 0:
        rows.add(joint)
        joint = model.parents[joint + 1] - 1
    return rows
