"""Paths: positions of the joints without times; pieces between stops, holds and payloads.

A piece is a curve q(s) over the length s of its chords (rad and m alike), with the robot at rest at
both ends. Way-points passed without a stop are joined by a cubic spline with not-a-knot ends (de
Boor, A Practical Guide to Splines, 2001, chapter IV).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path as File

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PPoly

from pinfric.dynamics.inverse.result import runs
from pinfric.errors import TrajectoryError
from pinfric.model.arrays import real_numbers
from pinfric.model.scene import Scene
from pinfric.model.scene_file import find_file
from pinfric.motions.joint_columns import LIMIT_TOLERANCE, JointColumn, joint_columns
from pinfric.motions.tool_points import solve_tool_points
from pinfric.motions.trajectory import Trajectory, load_trajectory, read_trajectory
from pinfric.motions.waypoints import carried_on, read_waypoints, way_points

#: Points nearer than this part of the whole way are the same.
_SAME = 1.0e-9
#: A joint slower than this part of the fastest stands still: what is left is rounding.
_STILL = 1.0e-9
#: A motion slower than this part of its greatest speed has stopped.
_STOPPED = 1.0e-6
#: Cosine between velocities, turned round, from which on a motion turns back.
_BACK = 0.9
#: Where the way grows by less than this part of its fastest with s, it does not.
_TURNS = 1.0e-7
#: A direction that turns by more than this (rad) between two sections is a kink.
_KINK = 1.0e-4
#: Points of a trajectory's samples that a piece keeps.
_KEPT = 200


@dataclass(frozen=True)
class Path:
    """Curves between stops.

    Attributes:
        pieces: (n,) curves s -> (nj,) positions (rad or m), one number per joint as in a
            trajectory's file; each begins where the one before ends.
        holds: (n + 1,) how long the robot stays at each stop, s.
        attached: (n + 1, np) what is carried from each stop on; None: as the scene says.
        source: where it came from, for messages.
        given: the motion that it comes from; None: it had no times.

    Raises:
        TrajectoryError: pieces that do not meet, a kink inside a piece, a curve that stands still.
    """

    pieces: tuple[PPoly, ...]
    holds: tuple[float, ...] = ()
    attached: np.ndarray | None = None
    source: str = "path"
    given: Trajectory | None = None

    def __post_init__(self) -> None:
        if not self.holds:
            object.__setattr__(self, "holds", (0.0,) * (len(self.pieces) + 1))
        if len(self.holds) != len(self.pieces) + 1:
            raise TrajectoryError(
                f"{self.source}: {len(self.holds)} holds for "
                f"{len(self.pieces) + 1} stops; give one for each"
            )
        for i, hold in enumerate(self.holds):
            if not 0.0 <= hold < np.inf:
                raise TrajectoryError(
                    f"{self.source}: stop {i}: hold {hold:g} s, should be 0 or more"
                )
        if self.attached is not None and self.attached.ndim != 2:
            raise TrajectoryError(
                f"{self.source}: attached: shape {self.attached.shape}; should "
                "be a row for each stop, a column for each payload"
            )
        pieces = tuple(
            _checked(piece, f"{self.source}: piece {i}") for i, piece in enumerate(self.pieces)
        )
        object.__setattr__(self, "pieces", pieces)
        for i, (a, b) in enumerate(pairwise(pieces)):
            gap = np.abs(a(a.x[-1]) - b(b.x[0])).max()
            if gap > LIMIT_TOLERANCE:
                raise TrajectoryError(
                    f"{self.source}: piece {i + 1} begins {gap:.3g} rad or m "
                    f"from where piece {i} ends; they must meet"
                )

    @classmethod
    def from_waypoints(
        cls,
        q: ArrayLike,
        via: Sequence[bool] | None = None,
        holds: Sequence[float] | None = None,
        attached: np.ndarray | None = None,
        source: str = "path",
    ) -> Path:
        """Join way-points: straight in the joints between stops, a spline where points are via.

        Args:
            q: (m, nj) positions, one number per joint (rad or m).
            via: (m,) whether a point is passed without a stop; the first and last are stops.
            holds: (m,) time at each point, s; 0 at via points.
            attached: (m, np) what is carried from each point on; None: as the scene says.
            source: name for messages.

        Raises:
            TrajectoryError: fewer than two points, a point repeated, an end that is no stop.
        """
        points = _points(source, q)
        passed = np.zeros(len(points), bool) if via is None else np.asarray(via, dtype=bool)
        stay = np.zeros(len(points)) if holds is None else np.asarray(holds, dtype=float)
        rows = len(points) if attached is None else len(attached)
        if passed.shape != (len(points),) or stay.shape != (len(points),) or rows != len(points):
            raise TrajectoryError(
                f"{source}: via, holds and attached need one entry for each of {len(points)} points"
            )
        if stay[passed].any():
            raise TrajectoryError(
                f"{source}: a via point is passed without a stop and cannot have a hold; leave out "
                "`hold` or `via`"
            )
        if passed[0] or passed[-1]:
            raise TrajectoryError(
                f"{source}: points[{0 if passed[0] else len(points) - 1}].via: "
                "the motion starts and ends at rest; leave it out"
            )
        stops = np.flatnonzero(~passed)
        pieces = tuple(_through(points[a : b + 1]) for a, b in pairwise(stops))
        carried = None if attached is None else np.asarray(attached, dtype=bool)[stops]
        return cls(pieces, tuple(stay[stops].tolist()), carried, source)

    @classmethod
    def spline(cls, s: ArrayLike, q: ArrayLike, source: str = "path") -> Path:
        """Pass through points in one piece, a cubic spline over the given parameter.

        Args:
            s: (m,) increasing. q: (m, nj) positions, one number per joint (rad or m).
            source: name for messages.

        Raises:
            TrajectoryError: shapes that do not agree, s not increasing, a point repeated.
        """
        points, at = _points(source, q), real_numbers(f"{source}: s", s, TrajectoryError)
        if at.shape != (len(points),) or (np.diff(at) <= 0).any():
            raise TrajectoryError(
                f"{source}: s: should be {len(points)} increasing numbers, one for each point"
            )
        return cls((_spline(at, points),), source=source)

    @classmethod
    def from_trajectory(cls, trajectory: Trajectory) -> Path:
        """Take a motion's path, its stops and holds, without its times.

        It stops where every joint does (up to rounding), or all turn back between two samples.
        Straight pieces stay straight, others are cubic splines through up to 200 of their samples.

        Raises:
            TrajectoryError: it does not start and end at rest; joints without one position.
        """
        source, t = trajectory.source, trajectory.t
        stops, position = _stops(trajectory), trajectory.joint_positions()
        pieces = [_sampled(position[a[1] : b[0] + 1]) for a, b in pairwise(stops)]
        if not pieces:
            raise TrajectoryError(f"{source}: no joint moves; there is no path to retime")
        holds = tuple(float(t[last] - t[first]) for first, last in stops)
        carried = np.array([trajectory.attached[last] for _, last in stops])
        return cls(tuple(pieces), holds, carried, source, trajectory)

    def given_speeds(
        self, columns: Sequence[JointColumn]
    ) -> list[tuple[np.ndarray, np.ndarray]] | None:
        """Return of each piece (T,) places s of the given motion's samples, and (ds/dt)^2 there.

        None where it stops elsewhere. `columns`: the joints'.
        """
        if self.given is None or len(stops := _stops(self.given)) != len(self.pieces) + 1:
            return None
        q, v = self.given.joint_positions(), self.given.v[:, [c.index_v for c in columns]]
        speeds = []
        for piece, ((_, first), (last, _)) in zip(self.pieces, pairwise(stops), strict=True):
            way = np.linalg.norm(np.diff(q[first : last + 1], axis=0), axis=1)
            s = piece.x[0] + np.concatenate(([0.0], np.cumsum(way))) / way.sum() * np.ptp(piece.x)
            rate = piece(s, 1)
            z = (v[first : last + 1] * rate).sum(axis=1) / (rate * rate).sum(axis=1)
            speeds.append((s, z * z))
        return speeds

    @property
    def nj(self) -> int:
        """Number of joints."""
        return int(self.pieces[0].c.shape[2])

    def stop(self, i: int) -> np.ndarray:
        """Return where the robot stands at stop i: (nj,) rad or m."""
        last = i == len(self.pieces)
        piece = self.pieces[i - 1 if last else i]
        return piece(piece.x[-1 if last else 0])


def _stops(trajectory: Trajectory) -> list[tuple[int, int]]:
    """Return the first and last samples of a motion's stops.

    Raises:
        TrajectoryError: it does not start and end at rest; joints without one position.
    """
    source = trajectory.source
    speed = np.abs(trajectory.v).max(axis=1)
    still = speed <= _STOPPED * speed.max()
    # Where the whole motion turns back between two samples, the slower of them
    size = np.linalg.norm(trajectory.v, axis=1)
    along = (trajectory.v[1:] * trajectory.v[:-1]).sum(axis=1)
    at = np.flatnonzero(along < -_BACK * size[1:] * size[:-1])
    still[at + (size[at + 1] < size[at])] = True
    if not (still[0] and still[-1]):
        raise TrajectoryError(
            f"{source}: does not start and end at rest (v = 0): hold the "
            "first and last position for a few samples"
        )
    rests, position = runs(still), trajectory.joint_positions()
    stops = rests[:1]  # at a reversal of all joints a sample may be still
    for (_, before), waits in pairwise(rests):
        if np.abs(position[waits[0]] - position[before]).max() > LIMIT_TOLERANCE:
            stops.append(waits)
    return stops


def load_path(path: str | File, scene: Scene) -> Path:
    """Read a way-point file with its stops and via points, or take the path of a trajectory.

    Args:
        path: YAML way-points, where a point with `via: true` is passed without a stop; else what
            `load_trajectory` reads. A file, or the bundled one of that name.

    Raises:
        TrajectoryError: as `load_trajectory` and `Path` raise it.
    """
    file = find_file(path, (".csv", ".waypoints.yaml", ".yaml", ".yml"), TrajectoryError)
    if File(file).suffix.lower() not in (".yaml", ".yml"):
        return Path.from_trajectory(load_trajectory(path, scene))
    waypoints = read_waypoints(File(file))
    columns = joint_columns(scene.model, str(file))
    defaults = {name: bool(payload.attached) for name, payload in scene.payloads.items()}
    waypoints, lines = solve_tool_points(waypoints, scene, columns, str(file))
    if lines:
        raise TrajectoryError(
            f"{file}: points[{min(lines)}].tool.line: retiming joins points by splines of the "
            "joints: leave `line` out, and give `via` points along the line"
        )
    points = way_points(waypoints, columns, defaults, str(file))
    via, holds = (
        [point.via for point in waypoints.points],
        [point.hold for point in waypoints.points],
    )
    found = Path.from_waypoints(points, via, holds, carried_on(waypoints, defaults), str(file))
    if any(via):
        return found
    try:
        return replace(found, given=read_trajectory(file, scene))
    except TrajectoryError:  # a move that has no duration, of a joint without a velocity limit
        return found


def check_limits(path: Path, columns: Sequence[JointColumn]) -> None:
    """Refuse a path that does not fit the robot: other joints, or positions beyond limits.

    Raises:
        TrajectoryError: names the joint, the piece and the place.
    """
    if path.nj != len(columns):
        raise TrajectoryError(
            f"{path.source}: {path.nj} positions for {len(columns)} joints: "
            f"{', '.join(column.name for column in columns)}"
        )
    for i, piece in enumerate(path.pieces):
        s = np.union1d(np.linspace(piece.x[0], piece.x[-1], 500), piece.x)
        q = piece(s)
        for k, column in enumerate(columns):
            for worst, side, limit in (
                (q[:, k].argmax(), "upper", column.upper),
                (q[:, k].argmin(), "lower", column.lower),
            ):
                beyond = q[worst, k] - limit if side == "upper" else limit - q[worst, k]
                if beyond > LIMIT_TOLERANCE:
                    share = (s[worst] - piece.x[0]) / (piece.x[-1] - piece.x[0])
                    raise TrajectoryError(
                        f"{path.source}: joint {column.name}: {q[worst, k]:.6g} {column.unit} at "
                        f"{100 * share:.0f} % of piece {i} is beyond its {side} limit "
                        f"{limit:.6g}; move the way-points there"
                    )


def _roots(rate: PPoly) -> list[np.ndarray]:
    """Where each joint's q' is 0, and does not stay so."""
    roots = []
    for k in range(rate.c.shape[2]):
        component = PPoly(rate.c[:, :, k], rate.x)
        moves = len(component.c) > 1 and component.c.any()
        places = component.roots(discontinuity=True, extrapolate=False) if moves else np.empty(0)
        roots.append(places[np.isfinite(places)])
    return roots


def reversals(piece: PPoly) -> np.ndarray:
    """Return where any joint's velocity is 0 along a piece, unordered."""
    return np.concatenate(_roots(piece.derivative()))


def _points(source: str, q: ArrayLike) -> np.ndarray:
    points = np.asarray(real_numbers(f"{source}: q", q, TrajectoryError))
    if points.ndim != 2 or len(points) < 2 or not np.isfinite(points).all():
        raise TrajectoryError(
            f"{source}: q: shape {points.shape}; should be two or more points of "
            "finite numbers, one for each joint"
        )
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    for i in np.flatnonzero(chords <= _SAME * chords.sum()):
        raise TrajectoryError(
            f"{source}: points[{i + 1}]: the same position as points[{i}]; leave "
            "one out (`hold` makes the robot stay)"
        )
    return points


def _through(points: np.ndarray) -> PPoly:
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return _spline(np.concatenate(([0.0], np.cumsum(chords))), points)


def _spline(s: np.ndarray, points: np.ndarray) -> PPoly:
    if len(points) == 2:
        slope = (points[1] - points[0]) / (s[1] - s[0])
        return PPoly(np.stack([slope, points[0]])[:, None, :], s)
    spline = CubicSpline(s, points)
    return PPoly(spline.c, spline.x)


def _sampled(position: np.ndarray) -> PPoly:
    """A curve through the samples between two stops: straight if they are."""
    chords = np.linalg.norm(np.diff(position, axis=0), axis=1)
    s = np.concatenate(([0.0], np.cumsum(chords)))
    way = position[-1] - position[0]
    along = np.clip((position - position[0]) @ way / (way @ way), 0.0, 1.0) if way.any() else s * 0
    if np.abs(position[0] + np.outer(along, way) - position).max() <= LIMIT_TOLERANCE:
        return _through(position[[0, -1]])
    least = s[-1] / _KEPT
    kept = [0]
    for i in range(1, len(s) - 1):
        if s[i] - s[kept[-1]] >= least and s[-1] - s[i] >= 0.5 * least:
            kept.append(i)
    return _spline(s[[*kept, len(s) - 1]], position[[*kept, len(s) - 1]])


def _checked(piece: PPoly, where: str) -> PPoly:
    """The piece, with nearly still joints at rest; kinks and standstills are refused."""
    rate = piece.derivative()
    middle = 0.5 * (piece.x[:-1] + piece.x[1:])
    before = rate(np.nextafter(piece.x[1:-1], -np.inf))
    after = rate(piece.x[1:-1])
    fastest = np.abs(rate(np.concatenate((piece.x, middle)))).max()
    if not fastest > 0.0:
        raise TrajectoryError(
            f"{where}: no joint moves; leave it out (`hold` makes the robot stay)"
        )
    size = np.minimum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
    for i in np.flatnonzero(np.abs(after - before).max(axis=1, initial=0.0) > _KINK * size):
        raise TrajectoryError(
            f"{where}: a corner at s = {piece.x[i + 1]:.6g}, where the robot does "
            "not stop; end a piece there or round the corner"
        )
    turns = np.concatenate((piece.x[[0, -1]], *map(np.ravel, _roots(rate))))
    for s in turns[np.linalg.norm(rate(turns), axis=1) <= _TURNS * fastest]:
        raise TrajectoryError(
            f"{where}: no joint moves with s at s = {s:.6g} (dq/ds = 0): if the joints "
            "reverse there, make it a stop; if it is an end of the piece, "
            "choose a parameter with dq/ds > 0 there"
        )
    c = np.array(piece.c)
    width = np.diff(piece.x)[:, None]
    order = np.arange(len(c) - 1, 0, -1)[:, None, None]
    moved = np.abs(order * c[:-1] * width ** (order - 1)).sum(axis=0)  # a bound of |q'|
    c[:-1][:, moved <= _STILL * fastest] = 0.0
    return PPoly(c, np.array(piece.x))
