"""Forces of a scene's springs as wrenches on links, and their potential energy.

A spring in a joint turns its child link by a torque about its axis, and the parent link by the
opposite one; a spring between points a and b pulls b towards a and a towards b. Like wrenches from
outside,

    w_j -= X_j f,     tau -= J^T f,     J^T f = -dU/dq
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.errors import SceneError, StateError, choose_from
from pinfric.model.loops import carriers, two_points
from pinfric.model.schema import Friction
from pinfric.model.spring_entries import (
    JointSpring,
    LineSpring,
    Spring,
    TensionSpring,
    TorsionSpring,
)

#: m: ends nearer than this coincide.
_COINCIDE = 1e-9
#: Positions of a joint at which the length of the spring across it is looked at.
_LOOKS = 721


@dataclass(frozen=True)
class Springs:
    """The springs of a scene on the joints and links of its model.

    Attributes:
        in_joints: the springs in joints; joint, parent: (m,) rows of their joints, and of the
            joints that carry these (-1: the ground); axis: (m, 6) their unit motions.
        lines: the springs between points; ends: (n, 2) rows of the joints that carry them (-1: the
            ground); points: (n, 2, 3) where, in those joints' frames.
    """

    source: str
    in_joints: tuple[JointSpring, ...]
    joint: np.ndarray
    parent: np.ndarray
    axis: np.ndarray
    lines: tuple[LineSpring, ...]
    ends: np.ndarray
    points: np.ndarray

    def wrenches(
        self, moved: np.ndarray, p: np.ndarray, R: np.ndarray
    ) -> list[tuple[int, np.ndarray]]:
        """Return (row, (T, 6)): the wrench on the link of a joint, in its frame, linear first.

        Args:
            moved: (T, m) positions of `joint` (rad or m).
            p, R: (T, nj, 3), (T, nj, 3, 3) poses of the joints' child frames in the world.

        Raises:
            StateError: the ends of a spring coincide; the ends of a gas spring are beyond its
                reach.
        """
        wrenches: list[tuple[int, np.ndarray]] = []
        for k, spring in enumerate(self.in_joints):
            row, above = int(self.joint[k]), int(self.parent[k])
            on_child = spring.effort(moved[:, k])[:, None] * self.axis[k]
            wrenches.append((row, on_child))
            if above >= 0:  # the opposite one, at the joint, in the frame of what carries it
                force, moment = (_turned(R[:, row], on_child[:, i : i + 3]) for i in (0, 3))
                moment = moment + np.cross(p[:, row] - p[:, above], force)
                wrenches.append(
                    (above, -np.hstack([_back(R[:, above], x) for x in (force, moment)]))
                )
        for k in range(len(self.lines)):
            places = self._places(k, p, R)
            pull = self._pull(k, places)
            for (end, point), force in zip(
                zip(self.ends[k].tolist(), self.points[k], strict=True), (pull, -pull), strict=True
            ):
                if end >= 0:
                    own = _back(R[:, end], force)
                    wrenches.append((end, np.hstack([own, np.cross(point, own)])))
        return wrenches

    def _places(self, k: int, p: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World positions (T, 3) of the ends of a spring between points."""
        a, b = (
            np.broadcast_to(point, (len(p), 3)) if end < 0 else p[:, end] + R[:, end] @ point
            for end, point in zip(self.ends[k].tolist(), self.points[k], strict=True)
        )
        return a, b

    def _pull(self, k: int, places: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """(T, 3) force of a spring on its end a, towards b."""
        spring, line = self.lines[k], places[1] - places[0]
        length = np.linalg.norm(line, axis=1)
        least, most = spring.reach
        if (beyond := (length < least) | (length > most)).any():
            i = int(np.argmax(beyond))
            raise StateError(
                f"{self.source}: springs: {spring.name}: its ends are {length[i]:.4g} m apart"
                f"{f' at sample {i}' * (len(length) > 1)}, it is {least:.4g} to {most:.4g} m long: "
                "measure its ends' places and its stroke, or keep the joints where it can follow"
            )
        pull = spring.pull(length)
        if ((length < _COINCIDE) & (pull != 0.0)).any():
            i = int(np.argmax((length < _COINCIDE) & (pull != 0.0)))
            raise StateError(
                f"{self.source}: springs: {spring.name}: its ends coincide"
                f"{f' at sample {i}' * (len(length) > 1)}, and its force has no direction there"
            )
        return np.asarray((pull / np.maximum(length, _COINCIDE))[:, None] * line)

    def in_joint(self, row: int) -> tuple[float, float] | None:
        """Return stiffness and zero-torque position of a joint's torsion springs together."""
        own = [s for s, at in zip(self.in_joints, self.joint, strict=True) if at == row]
        coils = [s for s in own if isinstance(s, TorsionSpring) and s.stiffness > 0.0]
        stiffness = sum(coil.stiffness for coil in coils)
        at_zero = sum(coil.preload + coil.stiffness * coil.rest for coil in coils)
        return (stiffness, at_zero / stiffness) if coils else None

    def energy(self, moved: np.ndarray, p: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Return (T,) the potential energy (J) of all springs; arguments as `wrenches`."""
        total = np.zeros(len(p))
        for k, spring in enumerate(self.in_joints):
            total += spring.energy(moved[:, k])
        for k, line in enumerate(self.lines):
            a, b = self._places(k, p, R)
            total += line.energy(np.linalg.norm(b - a, axis=1))
        return total


def _turned(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """R x of each sample."""
    return np.asarray(np.einsum("trc,tc->tr", R, x))


def _back(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """R^T x of each sample."""
    return np.asarray(np.einsum("trc,tr->tc", R, x))


def make_springs(
    model: pin.Model,
    axis: np.ndarray,
    springs: Sequence[Spring],
    friction: Mapping[str, Friction],
    start: np.ndarray,
    source: str,
) -> Springs | None:
    """Return a scene's springs on its model; None without any.

    `axis` (nj, 6) is `Twin.axis`; at `start` (nq,) the ends of a spring must not coincide.

    Raises:
        SceneError: an unknown joint or link, a name given twice, a joint without a single axis or
            without ends, ends on one body or at one point, a spring that is always slack.
    """
    if not springs:
        return None
    names, taken = tuple(model.names)[1:], set[str]()
    in_joints, rows, lines, sides = [], [], [], []
    data = model.createData()
    pin.forwardKinematics(model, data, start)
    for i, spring in enumerate(springs):
        where, name = f"{source}: springs[{i}]", getattr(spring, "name", "")
        where += f" ({name})"
        if name in taken or name in names:
            raise SceneError(f"{where}: the name {name!r} is taken; give each spring its own")
        taken.add(name)
        if isinstance(spring, JointSpring):
            row = _axis_row(model, axis, spring.joint, where)
            if name in friction:
                raise SceneError(
                    f"{source}: friction.{name}: a {spring.kind} is in joint {spring.joint!r}; its "
                    f"friction is that of the joint, friction.{spring.joint}"
                )
            in_joints.append(spring)
            rows.append(row)
            continue
        assert isinstance(spring, LineSpring)
        (a, at_a), (b, at_b) = two_points(model, spring.a, spring.b, where)
        lines.append(spring)
        sides.append(((a, at_a), (b, at_b)))
        if np.linalg.norm(data.oMi[b + 1].act(at_b) - data.oMi[a + 1].act(at_a)) < _COINCIDE:
            raise SceneError(
                f"{where}: its ends {spring.a.link} {list(spring.a.xyz)} and {spring.b.link} "
                f"{list(spring.b.xyz)} are one point at the start; measure where each end is "
                "fastened, in its own link's frame"
            )
        longest = _longest(model, sides[-1])
        if (
            isinstance(spring, TensionSpring)
            and not spring.pushes
            and spring.free_length >= longest
        ):
            raise SceneError(
                f"{where}: free_length {spring.free_length:g} m, but its ends are never more than "
                f"{longest:.4g} m apart, so it is always slack; measure its length unhooked, and "
                "the places of its ends; a spring that also pushes has `pushes: true`"
            )
    joint = np.array(rows, dtype=np.int64)
    return Springs(
        source=source,
        in_joints=tuple(in_joints),
        joint=joint,
        parent=np.array([model.parents[row + 1] - 1 for row in rows], dtype=np.int64),
        axis=axis[joint].reshape(-1, 6),
        lines=tuple(lines),
        ends=np.array([[row for row, _ in pair] for pair in sides], dtype=np.int64).reshape(-1, 2),
        points=np.array([[at for _, at in pair] for pair in sides], dtype=float).reshape(-1, 2, 3),
    )


def _axis_row(model: pin.Model, axis: np.ndarray, joint: str, where: str) -> int:
    """The row of a joint with one axis and an angle that counts its turns."""
    names = tuple(model.names)[1:]
    if joint not in names:
        raise SceneError(f"{where}.joint: there is no joint {joint!r}; {choose_from(joint, names)}")
    row = names.index(joint)
    kind = model.joints[row + 1]
    if not axis[row].any() or kind.nq == 2:
        what = "turns without end" if kind.nq == 2 else f"is a {kind.shortname()}"
        raise SceneError(
            f"{where}.joint: {joint!r} {what}; springs and hoses are for joints with one axis and "
            "two ends: give it limits in the URDF (type revolute)"
        )
    return row


def _longest(model: pin.Model, pair: tuple[tuple[int, np.ndarray], ...]) -> float:
    """An upper bound of the distance (m) between two points; within its limits across one joint."""
    (a, at_a), (b, at_b) = pair
    between = sorted(carriers(model, a) ^ carriers(model, b))
    total = float(np.linalg.norm(at_a) + np.linalg.norm(at_b))
    for row in between:
        joint = model.joints[row + 1]
        if joint.nv != 1:
            return np.inf
        limits = model.lowerPositionLimit, model.upperPositionLimit
        low, high = (-np.pi, np.pi) if joint.nq == 2 else (float(x[joint.idx_q]) for x in limits)
        slides = "P" in joint.shortname().removeprefix("JointModel")
        if slides and not np.isfinite([low, high]).all():
            return np.inf
        total += float(np.linalg.norm(model.jointPlacements[row + 1].translation))
        total += max(abs(low), abs(high)) if slides else 0.0
    if len(between) > 1:
        return total
    data, step, most = model.createData(), np.zeros(model.nv), 0.0
    if not slides:
        low, high = max(low, -np.pi), min(high, np.pi)
    for step[joint.idx_v] in np.linspace(low, high, _LOOKS):
        pin.forwardKinematics(model, data, pin.integrate(model, pin.neutral(model), step))
        apart = data.oMi[b + 1].act(at_b) - data.oMi[a + 1].act(at_a)
        most = max(most, float(np.linalg.norm(apart)))
    return most
