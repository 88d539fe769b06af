"""Correction of rounded mechanisms: axes of loops become exactly parallel or perpendicular.

A planar loop whose axes are parallel only to the file's digits cannot close: its redundant
equations contradict each other (`notebooks/theory/problem.md`). Frame b of each loop is then
shifted by the constant gap that remains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pinfric.model.closure import CLOSED, action_maps, approach, guesses, loop_state
from pinfric.model.loops import Linkage, carriers, loop_axis, loop_frame, loop_place, turn_between
from pinfric.model.robot import link_frame
from pinfric.model.schema import LinkFrame, Loop, LoopTolerance
from pinfric.model.twin import Twin, twist

#: Axes that differ by less than this (rad) but more than the tolerance are probably badly rounded.
_SUSPICIOUS = 1e-2
#: Turns below this (rad) change no printed digit and are not reported.
_MENTIONED = 1e-9
#: Axes nearer than this (rad) are equal to rounding.
_ROUNDING = 1e-14


@dataclass(frozen=True)
class Alignment:
    """A model and its loops with axes made parallel and perpendicular.

    Attributes:
        model, loops: copies with turned joints and frames.
        turned: joint or loop -> angle by which it was turned (rad), if more than rounding.
        doubts: loop -> text on axes just outside the tolerance, for the error if the loop cannot
            close.
    """

    model: pin.Model
    loops: tuple[Loop, ...]
    turned: dict[str, float]
    doubts: dict[str, str]


def align_axes(
    model: pin.Model, loops: Sequence[Loop], tolerance: LoopTolerance, source: str
) -> Alignment:
    """Make nearly parallel or perpendicular axes on the links of loops exactly so.

    Beside earlier axes e on its link, an axis d becomes +-e where |d x e| <= `tolerance.angle`;
    else its part in the span of those with |d.e| <= `tolerance.angle` is removed and its length
    restored. What the joint carries turns with it.

    Raises:
        SceneError: a loop on an unknown link, or with an axis of length zero.
    """
    where = [f"{source}: {loop_place(loops, loop.name)}" for loop in loops]
    ends = [
        [loop_frame(model, loop, side, place) for side in ("a", "b")]
        for loop, place in zip(loops, where, strict=True)
    ]
    paths = [carriers(model, a) ^ carriers(model, b) for (a, _), (b, _) in ends]
    carried = _Links(tolerance.angle, paths, [loop.name for loop in loops])
    model = model.copy()
    for joint in sorted(set().union(*paths)):
        axis = _joint_axis(model, model.joints[joint + 1])
        placement = model.jointPlacements[joint + 1]
        if axis is None:
            continue
        parent, name = model.parents[joint + 1] - 1, f"joint {model.names[joint + 1]!r}"
        turn = carried.turn(parent, joint, name, placement.rotation @ axis)
        placement.rotation = turn @ placement.rotation
        moved = model.joints[joint + 1]
        if moved.nv == 1 and not twist(model, moved)[3:].any():  # it slides
            carried.join(joint, parent, placement.rotation)
        else:
            carried.axes[joint] = [(name, axis)]
    aligned = []
    for row, loop in enumerate(loops):
        changed = {}
        for side, (joint, frame) in zip(("a", "b"), ends[row], strict=True):
            if loop.kind in ("spherical", "fixed"):
                continue
            axis = frame.rotation @ loop_axis(loop, side, where[row])
            turn = carried.turn(joint, row - len(loops), f"loop {loop.name!r} (side {side})", axis)
            if not np.array_equal(turn, np.eye(3)):
                frame.rotation = turn @ frame.rotation
                changed[side] = _entry(model, getattr(loop, side), frame)
        aligned.append(loop.model_copy(update=changed))
    return Alignment(model, tuple(aligned), carried.turned, carried.doubts)


class _Links:
    """The axes that links carry along the loops' paths; links joined by sliding joints turn as one.

    Attributes:
        axes: link -> names and axes (3,), in the frame of its joint; -1 is the ground.
        turned, doubts: see `Alignment`.
    """

    def __init__(self, tolerance: float, paths: list[set[int]], loops: list[str]) -> None:
        self.axes: dict[int, list[tuple[str, np.ndarray]]] = {}
        self.turned: dict[str, float] = {}
        self.doubts: dict[str, str] = {}
        self._tolerance, self._paths, self._loops = tolerance, paths, loops
        self._worst: dict[str, float] = {}
        self._joined: dict[int, tuple[int, np.ndarray]] = {}

    def join(self, link: int, other: int, R: np.ndarray) -> None:
        """Let a link turn with another; R (3, 3) is from its frame to the other's."""
        root, further = self._joined.get(other, (other, np.eye(3)))
        self._joined[link] = root, further @ R

    def turn(self, link: int, of: int, name: str, axis: np.ndarray) -> np.ndarray:
        """Return the least rotation that aligns an axis with those of its link, and record it.

        Args:
            link: row of the joint that carries it, -1 for the ground.
            of: row of the joint it belongs to; of a loop, its row minus the number of loops.
            name: of that joint or loop.
            axis: (3,) in the frame of the link's joint.
        """
        root, R = self._joined.get(link, (link, np.eye(3)))
        there, axis = self.axes.setdefault(root, []), R @ axis
        for other, e in there:
            across, along = float(np.linalg.norm(np.cross(axis, e))), abs(float(axis @ e))
            off, relation = (across, "parallel") if across < along else (along, "perpendicular")
            if self._tolerance < off < _SUSPICIOUS:
                self._doubt(
                    of,
                    off,
                    f"the axes of {other} and {name}, on one link, are {off:.3g} "
                    f"rad from {relation}",
                )
        aligned = _nearest_aligned(axis, [e for _, e in there], self._tolerance)
        there.append((name, aligned))
        off = float(np.linalg.norm(np.cross(axis, aligned)))
        if off <= _ROUNDING:
            return np.eye(3)
        if off > _MENTIONED:
            self.turned[name] = off
        return np.asarray(R.T @ turn_between(axis, aligned) @ R)

    def _doubt(self, of: int, off: float, text: str) -> None:
        for row, name in enumerate(self._loops):
            concerned = of in self._paths[row] if of >= 0 else of == row - len(self._loops)
            if concerned and off < self._worst.get(name, np.inf):
                self._worst[name] = off
                self.doubts[name] = f"{text} (loop_tolerance.angle allows {self._tolerance:g})"


def _nearest_aligned(
    axis: np.ndarray, others: Sequence[np.ndarray], tolerance: float
) -> np.ndarray:
    """The nearest unit vector that is parallel or perpendicular to the axes it nearly is."""
    for e in others:
        if np.linalg.norm(np.cross(axis, e)) <= tolerance:
            return np.copysign(1.0, axis @ e) * e
    normals = np.array([e for e in others if abs(axis @ e) <= tolerance]).reshape(-1, 3)
    # axes that are parallel within the tolerance span one direction, not a plane
    within = np.linalg.lstsq(normals, normals @ axis, rcond=_SUSPICIOUS)[0]
    aligned = axis - within
    return np.asarray(aligned / np.linalg.norm(aligned))


def _joint_axis(model: pin.Model, joint: pin.JointModel) -> np.ndarray | None:
    """The unit axis of a one-degree joint, or a planar joint's normal; None for other joints."""
    if joint.shortname() == "JointModelPlanar":
        return np.array([0.0, 0.0, 1.0])
    if joint.nv != 1:
        return None
    rate = twist(model, joint)
    axis = rate[3:] if rate[3:].any() else rate[:3]
    length = float(np.linalg.norm(axis))
    return axis / length if length > 0.0 else None  # `make_twin` refuses that


def shift_frames(
    twin: Twin, linkage: Linkage, start: np.ndarray, tolerance: LoopTolerance
) -> tuple[tuple[Loop, ...], float]:
    """Shift frame b of each loop by the constant gap, up to `tolerance`, that no motion closes.

    The search for closed configurations begins at `start` (nq,). Returned are the loops and the
    largest shift (m, or rad times the mechanism's size): 0 if they close without a shift or not
    even with one.
    """
    most = np.where(linkage.turning, tolerance.angle * linkage.size, tolerance.length)
    near: list[np.ndarray] = []
    shift = 0.0
    for guess in guesses(twin.model, start):
        q, gap = approach(twin, linkage, guess, np.zeros(twin.nv, dtype=bool))
        if np.abs(gap).max(initial=0.0) <= CLOSED * linkage.size:
            return linkage.loops, 0.0
        if (np.abs(gap) <= most).all():
            near.append(q)
            shift = max(shift, float(np.abs(gap).max()))
        if len(near) == 3:
            break
    else:
        return linkage.loops, 0.0
    moved = _shifted(twin, _shifted(twin, linkage, near[0]), near[0])
    for q in near:
        gap = approach(twin, moved, q, np.zeros(twin.nv, dtype=bool))[1]
        if not np.abs(gap).max() <= CLOSED * linkage.size:
            return linkage.loops, 0.0
    loops = []
    for row, loop in enumerate(linkage.loops):
        frame = pin.SE3(moved.frame_R[row, 1], moved.frame_p[row, 1])
        loops.append(loop.model_copy(update={"b": _entry(twin.model, loop.b, frame)}))
    return tuple(loops), shift


def _shifted(twin: Twin, linkage: Linkage, q: np.ndarray) -> Linkage:
    """The linkage with frame b of each loop moved by its gap at q (nq,)."""
    none = np.zeros((1, twin.nv))
    state = loop_state(twin, linkage, q[None], none, none)
    rows, p, R = linkage.lambdas, linkage.frame_p.copy(), linkage.frame_R.copy()
    X = action_maps(twin, linkage, state.p, state.R)[0][0, twin.n_joints :, :, rows]
    for row, gap in enumerate(X @ state.gap[0, rows]):  # (6,) in frame b
        frame = pin.SE3(R[row, 1], p[row, 1]) * pin.SE3(pin.exp3(-gap[3:]), -gap[:3])
        p[row, 1], R[row, 1] = frame.translation, frame.rotation
    return replace(linkage, frame_p=p, frame_R=R)


def _entry(model: pin.Model, entry: LinkFrame, frame: pin.SE3) -> LinkFrame:
    """A loop's side whose frame has this pose in the frame of the joint that carries its link."""
    local = model.frames[link_frame(model, entry.link)].placement.actInv(frame)
    xyz, rpy = local.translation.tolist(), pin.rpy.matrixToRpy(local.rotation).tolist()
    return entry.model_copy(update={"xyz": tuple(xyz), "rpy": tuple(rpy)})
