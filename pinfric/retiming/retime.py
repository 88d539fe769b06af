"""`pf.retime`: the fastest motion that a robot's real drives can do along a path.

Solve on a coarse grid, then on one that is even in time and in place, with every knot and reversal;
judge all intervals and samples by `inverse_dynamics`, and refine where a limit is exceeded.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import NamedTuple

import numpy as np

from pinfric.drives.criterion import Criterion
from pinfric.drives.inertia import load_inertias
from pinfric.drives.limit import signals
from pinfric.drives.limits import instant_limits
from pinfric.drives.parts import criteria_over
from pinfric.drives.robot import holds
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import PinfricWarning, RetimeError, TrajectoryError
from pinfric.model.brief import file_name, listed, screen
from pinfric.model.couples import mixed
from pinfric.model.floating import stands
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.upward import Shown
from pinfric.motions.joint_columns import JointColumn, configurations, joint_columns
from pinfric.motions.summary import rms
from pinfric.motions.trajectory import Trajectory
from pinfric.retiming.limits import DriveLimits, LimitsLike, limited_scene, read_limits
from pinfric.retiming.path import Path, check_limits, load_path
from pinfric.retiming.problem import PathProblem, Policy, modes, usage
from pinfric.retiming.profile import Profile, RetimedSamples, columns_to_velocities, sample
from pinfric.retiming.scan import box_scan, limit_curve
from pinfric.retiming.tables import (
    Grid,
    distinct,
    make_grid,
    make_tables,
    natural_points,
    rates_of,
)
from pinfric.retiming.thermal import HeatBudget, within_continuous

#: Where the inside of an interval is judged.
_INSIDE = np.array([0.02, 0.25, 0.5, 0.75, 0.98])
#: Times that intervals over a limit are cut in two.
_ROUNDS = 10
#: A smoothed motion that would have to be run more slowly than by this factor is given up.
_SLOWEST = 0.05
#: Limits and continuous torques are used up to this part: a file's last digits do not exceed them.
_SETTLED = 1.0 - 1.0e-7
#: Part of the tolerance over a limit that the whole motion, run more slowly, takes off.
_NEAR = 0.2
#: A limit of which more than this part is used holds the motion back.
_AT_LIMIT = 0.995
#: Times the points asked for, where fewer find no way along the path.
_FINER = 1, 4, 16
#: Fewest points of a piece; a zone about a reversal, in sample periods.
_FEWEST, _ZONE = 24, 0.65


@dataclass(frozen=True)
class RetimeResult(Shown):
    """The fastest motion along a path, and the limits that hold it back.

    Attributes:
        trajectory: its samples, which every command takes.
        duration: s, holds included. moves: (pieces,) of each, s.
        before: duration of the motion that the path comes from, s; None: it had no times.
        limiting: drive -> limit -> part of the moving time in which more than 99.5 % are used; all
            of it for a continuous torque, which holds back the whole cycle.
        excess: largest excess of a sample over any limit, as a part of it (0.001: 0.1 %).
        usage: (T, na, `limits.instant_limits`) used part of each limit.
        problem, profile: the grid with its limits, and the speed on it.
        rms: (na,) used part of each motor's continuous torque over the whole cycle; None where heat
            is not judged.
        uniform: s, duration if the whole motion were slowed down until these torques are kept; None
            as `rms`.
        smooth: s, of the moving mean, by which each move takes longer.
        criteria: drive -> what `size` says of a drive of the catalogue that does this motion.
        notes: what is exceeded or was not judged, in sentences.
        fitted: the drives of a catalogue that the scene lacks, installed for the motion.
        failing: criteria of `size` that this motion, repeated, does not pass, with their drives.
    """

    trajectory: Trajectory
    duration: float
    moves: np.ndarray
    before: float | None
    limiting: dict[str, dict[str, float]]
    excess: float
    usage: np.ndarray
    problem: PathProblem
    profile: Profile
    rms: np.ndarray | None = None
    uniform: float | None = None
    smooth: float = 0.0
    criteria: Mapping[str, tuple[Criterion, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    failing: tuple[str, ...] = ()
    fitted: tuple[str, ...] = ()

    def __repr__(self) -> str:
        most = self.held_back()
        return screen(
            "RetimeResult",
            f"{file_name(self.problem.path.source)}: {self.duration:.4g} s",
            {
                "moves": listed([f"{t:.4g} s" for t in self.moves]),
                "limits": listed(
                    [f"{d}: {k}" for d, k, _ in most],
                    [f"{100 * share:.0f} % of the time" for _, _, share in most],
                ),
                "excess": f"{100 * self.excess:.3g} % over any limit",
                "more": ".trajectory .limiting .plot()",
            },
        )

    def held_back(self) -> list[tuple[str, str, float]]:
        """Return (drive, limit, part of the moving time), the greatest part first."""
        shares = [(d, k, share) for d, kinds in self.limiting.items() for k, share in kinds.items()]
        return sorted(shares, key=lambda entry: -entry[2])

    def limit_curve(self) -> np.ndarray:
        """Return (n,) the greatest (ds/dt)^2 with any acceleration within all limits.

        At the start of each interval of `profile.grid`, up to 100 times the greatest of the
        profile.
        """
        curve = np.empty(len(self.profile.grid.step))
        most = 100.0 * max(float(self.profile.x.max()), 1e-9)
        limit_curve(box_scan(self.problem.scan()), most, curve)
        return curve


def retime(
    scene: Scene,
    path: Path | Trajectory | str,
    limits: LimitsLike = None,
    *,
    heat: bool = True,
    smooth: float = 0.0,
    points: int = 300,
    tolerance: float = 1e-3,
    sample_rate: float = 1000.0,
) -> RetimeResult:
    """Return the fastest motion along a path within the limits of real drives.

    min int ds/sqrt(x) over x(s) = (ds/dt)^2 with every drive's torque, friction and gear losses
    included, within its limits (`limits`); see `scan` for the method and its sources.

    Args:
        scene: an open chain with one drive on each joint, its friction and payloads.
        path: a `Path`; a trajectory, whose path is taken; a file of either.
        limits: of the drives, see `limits.read_limits`; None: the URDF's effort and velocity.
        heat: keep each motor's continuous torque over the whole cycle, holds included (`thermal`),
            as the motion is repeated; False: it is done once.
        smooth: s; the place along the path becomes a moving mean over this time, so that
            accelerations ramp; each move takes so much longer, and more where the smoothed motion
            would exceed limits.
        points: of the grid, all pieces together; refined where a limit would be exceeded.
        tolerance: part of a limit by which it may be exceeded between grid points.
        sample_rate: of the resulting trajectory, Hz.

    Raises:
        RetimeError: loops, cylinders or joints without a drive; limits missing; a drive that cannot
            hold, break away or follow, with the place and what it needs.
        TrajectoryError: a path that cannot be, or does not fit the robot.

    Warns:
        PinfricWarning: a limit is exceeded all the same; a drive of the catalogue does not do what
            `size` asks of it for this motion.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> motion = pf.load_trajectory("pendulum", scene)
    >>> found = pf.retime(scene, motion, {"joint_1": {"effort": 20.0, "velocity": 2.0}})
    >>> round(found.duration, 2)
    2.29
    """
    expect_scene(scene, "retime")
    if stands(scene):
        raise RetimeError(
            f"{scene.source}: retime: forces at the feet hold this robot, and they change with the "
            "times that retime finds: retime it on a fixed base (`floating: false`)"
        )
    scene = scene.without_presliding
    _check_scene(scene)
    if isinstance(path, Trajectory):
        path = Path.from_trajectory(path)
    elif isinstance(path, str | os.PathLike):
        path = load_path(str(path), scene)
    elif not isinstance(path, Path):
        raise TrajectoryError(
            f"retime: the path is a {type(path).__name__}; give a trajectory, a file's name, or "
            "pf.Path.from_waypoints(q)"
        )
    numbers = (points, sample_rate, tolerance, smooth)
    if not (
        all(isinstance(number, Real) for number in numbers)
        and (points >= 2 and sample_rate > 0.0 and tolerance > 0.0 and smooth >= 0.0)
    ):
        raise RetimeError(
            f"retime: points {points!r}, sample_rate {sample_rate!r}, tolerance {tolerance!r}, "
            f"smooth {smooth!r}: should be positive numbers"
        )
    if path.attached is not None and path.attached.shape[1] != len(scene.payloads):
        raise RetimeError(
            f"{path.source}: attached: {path.attached.shape[1]} columns for "
            f"{len(scene.payloads)} payloads"
        )
    drive_limits = read_limits(scene, limits)
    given, scene = scene, limited_scene(scene, drive_limits)
    columns = joint_columns(scene.model, scene.source)
    check_limits(path, columns)
    policy = Policy(sample_rate, tolerance)
    result = _Retiming(scene, path, columns, drive_limits, policy).run(points, heat, smooth)
    pairs = zip(given.drives, scene.drives, drive_limits, strict=True)
    fitted = tuple(
        f"{old.name}: {limit.motor}"
        for old, new, limit in pairs
        if old.transmission is None and new.transmission is not None
    )
    result = replace(result, fitted=fitted)
    for text in result.notes:
        warnings.warn(text, PinfricWarning, stacklevel=2)
    return result


def _check_scene(scene: Scene) -> None:
    """Refuse robots whose efforts depend on friction through reactions."""
    if scene.closed_by:
        raise RetimeError(
            f"{scene.source}: retime is for open chains with drives at their joints; "
            f"{scene.closed_by} couples efforts and friction"
        )
    driven = [drive.velocity_index for drive in scene.drives]
    if driven != list(range(scene.model.nv)):
        raise RetimeError(
            f"{scene.source}: retime needs one drive on each of {scene.model.nv} "
            f"degrees of freedom, found {len(driven)}"
        )
    there = mixed(scene.drives, scene.model.nv)
    for site in scene.sites:
        if there[site.velocity_index]:
            raise RetimeError(
                f"{scene.source}: friction.{site.name}: retime accepts friction of "
                "coupled drives only on the motor's side: move it to the "
                "transmission (no_load_torque, motor_viscous)"
            )


class _Judged(NamedTuple):
    """A motion and what it uses of the limits: (T, na, limits), and (na,) of continuous torques."""

    trajectory: Trajectory
    result: InverseResult
    use: np.ndarray
    moving: np.ndarray
    heat: np.ndarray

    def most(self, heated: bool) -> float:
        """The largest used part, of continuous torques too where `heated`."""
        least = float(self.heat.max()) if heated else 0.0
        return max(least, float(self.use[self.moving].max(initial=0.0)))


class _Retiming:
    def __init__(
        self,
        scene: Scene,
        path: Path,
        columns: tuple[JointColumn, ...],
        limits: tuple[DriveLimits, ...],
        policy: Policy,
    ) -> None:
        self.scene, self.path, self.columns = scene, path, columns
        self.limits, self.policy = limits, policy
        self.natural = [natural_points(piece, rates_of(scene, columns)) for piece in path.pieces]
        #: (piece, from s, to s): intervals of constant u; and zones about reversals.
        self.constant: list[tuple[int, float, float]] = []
        self.zones: list[tuple[int, int, float, float]] = []
        #: (piece, from s, to s, used part of a limit) of smoothed samples, by the round of it.
        self.tight: list[list[tuple[int, float, float, float]]] = [[]]

    def run(self, points: int, heat: bool, smooth: float) -> RetimeResult:
        self.check_stops()
        given = None if smooth else self.given(heat)
        try:
            result = self.fastest(points, heat, smooth)
            if smooth:
                result = self.smoothed(result, points, heat)
            result = self.settled(result)
        except RetimeError:
            if given is None:
                raise
            result = given
        if given is not None and given.duration < result.duration:
            result = given
        names = {name: [c for c in own if c.fails] for name, own in result.criteria.items()}
        failing = tuple(f"{name}: {c.why}" for name, own in names.items() for c in own if heat)
        result = replace(result, failing=failing)
        return replace(result, notes=tuple(self.notes(result, heat)))

    def given(self, heat: bool) -> RetimeResult | None:
        """The motion that the path comes from, if it is within all limits: one that is possible."""
        motion, path = self.path.given, self.path
        if motion is None:
            return None
        judged = self.judge(motion, (motion.v != 0.0).any(axis=1))
        heated = heat and any(np.isfinite(x.over_time[0]) for x in self.limits)
        if judged.most(heated) > 1.0:
            return None
        grid = [
            distinct(np.linspace(curve.x[0], curve.x[-1], _FEWEST + 1), curve, natural)
            for curve, natural in zip(path.pieces, self.natural, strict=True)
        ]
        problem, used = self.problem(grid), judged.heat if heated else None
        if (profile := self.given_profile(problem.grid)) is None:
            return None
        result = self.result(problem, profile, judged, 0.0, None, used)
        moves = result.moves * (motion.duration - sum(path.holds)) / result.moves.sum()
        return replace(result, moves=moves, duration=motion.duration)

    def given_profile(self, grid: Grid) -> Profile | None:
        """The given motion's speeds on a grid; None where it is not known along the path."""
        if (speeds := self.path.given_speeds(self.columns)) is None:
            return None
        place, x = grid.s[np.append(grid.start, grid.end[-1])], np.zeros(len(grid.stop))
        piece = grid.piece[np.append(grid.start, grid.end[-1])]
        for p, (s, square) in enumerate(speeds):
            x[piece == p] = np.interp(place[piece == p], s, square)
        x[grid.stop] = 0.0
        u = np.diff(x) / (2.0 * grid.step)
        return Profile.of(grid, x, np.stack([u, u], axis=1))

    def settled(self, result: RetimeResult) -> RetimeResult:
        """Run the whole motion a little more slowly, until it is within all limits exactly.

        Each step is at most what `result` exceeds asks for: a sample that falls on a reversal
        exceeds much, and at a slightly lower speed samples fall beside it.
        """
        first, factor, most = result, 1.0, np.inf
        heated, smooth = result.rms is not None, result.smooth
        for attempt in range(_ROUNDS):
            samples = sample(self.path, first.profile.scaled(factor), self._rate, smooth)
            judged = self.judge(self.motion(samples), samples.moving)
            if (over := judged.most(heated) - _SETTLED) <= 0.0:
                break
            most = min(most, over)
            factor *= max(1.0 - 0.6 * 2.0**attempt * most, 0.9)
        else:  # friction that grows as the speed falls
            return first
        if factor == 1.0:
            return first
        heat, profile = (judged.heat if heated else None), first.profile.scaled(factor)
        return self.result(first.problem, profile, judged, smooth, result.uniform, heat)

    def fastest(self, points: int, heat: bool, smooth: float) -> RetimeResult:
        """The fastest motion, judged as it is smoothed; arguments see `retime`."""
        problem, profile, samples = self.solve(points)
        uniform, use = None, None
        if heat and any(np.isfinite(x.over_time[0]) for x in self.limits):
            profile, uniform, use = self.cool(problem, profile, smooth)
        if smooth or use is not None:
            samples = sample(self.path, profile, self._rate, smooth)
        judged = self.judge(self.motion(samples), samples.moving)
        return self.result(problem, profile, judged, smooth, uniform, use)

    def smoothed(self, result: RetimeResult, points: int, heat: bool) -> RetimeResult:
        """Tighten the limits where smoothing exceeds them; if that does not do, go more slowly.

        A smoothed sample has a time's mean speed and acceleration at one place: where the path
        bends it needs more than any of them.
        """
        best = result
        for _ in range(_ROUNDS):
            if best.excess <= _NEAR * self.policy.tolerance:
                return best
            # Where, and by which part, the smoothed motion exceeds a limit
            samples = sample(self.path, best.profile, self._rate, best.smooth)
            use = best.usage.max(axis=(1, 2))
            for i in np.flatnonzero(samples.moving & (use > 1.0)):
                reach = float(samples.rate[max(i - 1, 0) : i + 2].max()) * best.smooth
                s = float(samples.s[i])
                self.tight[-1].append((int(samples.piece[i]), s - reach, s + reach, float(use[i])))
            self.tight.append([])
            try:
                best = self.fastest(points, heat, result.smooth)
            except RetimeError:  # a limit that is needed to hold is no longer enough
                break
        factor, smooth = 1.0, result.smooth
        while best.excess > self.policy.tolerance and factor > _SLOWEST:
            factor *= max(0.9, 1.0 / np.sqrt(1.0 + 2.0 * best.excess))
            profile = result.profile.scaled(factor)
            samples = sample(self.path, profile, self._rate, smooth)
            judged = self.judge(self.motion(samples), samples.moving)
            use = None if result.rms is None else judged.heat
            best = self.result(result.problem, profile, judged, smooth, result.uniform, use)
        return best

    def notes(self, result: RetimeResult, heat: bool) -> Iterator[str]:
        """Say what is exceeded, what `size` does not accept, whose heat is unknown."""
        names = [drive.name for drive in self.scene.drives]
        if result.excess > 0.0:
            d, k = np.unravel_index(result.usage.max(axis=0).argmax(), result.usage.shape[1:])
            why = f"smoothing over {1e3 * result.smooth:g} ms" if result.smooth else "the motion"
            yield (
                f"{why} exceeds the {instant_limits()[k].name} of {names[d]} by "
                f"{100 * result.excess:.2g} %"
            )
        failing: dict[str, list[str]] = {}
        for line in result.failing:
            name, _, why = line.partition(": ")
            failing.setdefault(name, []).append(why)
        for name, reasons in failing.items():
            yield f"{name}: this motion, repeated, does not pass `size`: {'; '.join(reasons)}"
        cold = [
            n
            for n, x in zip(names, self.limits, strict=True)
            if x.motor and not np.isfinite(x.continuous_torque)
        ]
        if heat and cold:
            yield f"heat is not checked for {', '.join(cold)}: no continuous torque is known"

    def solve(self, points: int) -> tuple[PathProblem, Profile, RetimedSamples]:
        """Solve; if no way is found, on finer grids: far points may miss it."""
        for finer in _FINER:
            try:
                return self.refine(self.coarse(finer * points), finer * points)
            except RetimeError as problem:
                last = problem
                self.constant, self.zones = [], []
        raise last

    def problem(self, points: list[np.ndarray]) -> PathProblem:
        grid = make_grid(self.scene, self.path, self.columns, points)
        middle, piece = 0.5 * (grid.s[grid.start] + grid.s[grid.end]), grid.piece[grid.start]
        constant = np.zeros(len(middle), dtype=bool)
        for p, first, last in self.constant:
            constant |= (piece == p) & (first < middle) & (middle < last)
        share = np.ones(len(middle))
        for cut in self.tight:
            most = np.ones(len(middle))
            for p, first, last, used in cut:
                inside = (piece == p) & (first < grid.s[grid.end]) & (grid.s[grid.start] < last)
                most[inside] = np.maximum(most[inside], used)
            share /= most
        tables = make_tables(self.scene, self.path, self.columns, grid)
        return PathProblem(
            self.scene,
            self.path,
            self.columns,
            self.limits,
            self.policy,
            grid,
            tables,
            modes(grid, self.zones),
            constant,
            share,
        )

    def check_stops(self) -> None:
        """Refuse stops at which a drive cannot hold, with what it carries there."""
        probe = self.problem([piece.x[[0, -1]] for piece in self.path.pieces])
        for p, curve in enumerate(self.path.pieces):
            for end, s in enumerate(curve.x[[0, -1]]):
                still = probe.states(np.array([s]), np.array([p]), np.zeros(1), np.zeros(1))
                use = usage(still, self.limits, needed=True)[0]
                d, kind = divmod(int(use.argmax()), use.shape[1])
                if use[d, kind] > 1.0:
                    where = f"{self.path.source}: stop {p + end}{probe.carrying(p)}"
                    raise RetimeError(f"{where}: drive {probe.limits_text(still, d, kind, 'hold')}")

    def coarse(self, points: int) -> Profile:
        """A first profile on a grid that is even in place."""
        length = np.array([piece.x[-1] - piece.x[0] for piece in self.path.pieces])
        counts = np.maximum(points / 3 * length / length.sum(), _FEWEST / 2).astype(int)
        grids = [
            distinct(np.linspace(curve.x[0], curve.x[-1], n + 1), curve, natural)
            for curve, n, natural in zip(self.path.pieces, counts, self.natural, strict=True)
        ]
        return self.problem(grids).solve()

    def refine(self, coarse: Profile, points: int) -> tuple[PathProblem, Profile, RetimedSamples]:
        """Solve on the final grid, halving intervals over a limit up to `_ROUNDS` times."""
        self.zones = self._zones(coarse)
        share = coarse.duration / coarse.duration.sum()
        grids = []
        for p, (curve, natural) in enumerate(zip(self.path.pieces, self.natural, strict=True)):
            n = max(int(points * share[p]), _FEWEST)
            even = np.linspace(curve.x[0], curve.x[-1], n // 2 + 1)
            timed = coarse.at(p, np.linspace(0.0, coarse.duration[p], n - n // 2 + 1))[0]
            edges = [edge for _, q, *zone in self.zones if q == p for edge in zone]
            inside = np.concatenate((even, timed, edges))
            inside = inside[(inside > curve.x[0]) & (inside < curve.x[-1])]
            kept = np.union1d(natural, curve.x[[0, -1]])
            grids.append(distinct(inside, curve, kept))
        for attempt in range(_ROUNDS + 1):
            problem = self.problem(grids)
            profile = problem.solve()
            if (stalls := profile.stalls()).size and attempt < _ROUNDS:
                self._halve(problem.grid, stalls, grids)
                continue
            if stalls.size:
                raise RetimeError(problem.stalled(profile, int(stalls[0])))
            samples = sample(self.path, profile, self._rate)
            if attempt == _ROUNDS or not self._cut(problem, profile, samples, grids):
                break
        return problem, profile, samples

    def _zones(self, profile: Profile) -> list[tuple[int, int, float, float]]:
        """Where samples are beside a reversal: within half a sample period of it, and a reserve.

        At a stop that is left at once within a whole one: the slower of the samples beside counts.
        """
        grid, zones, period = profile.grid, [], 1.0 / self.policy.sample_rate
        for j in range(1, len(grid.step)):
            turning = np.flatnonzero(grid.direction[j] * grid.direction[j - 1] < 0.0).tolist()
            piece, stop = int(grid.piece[grid.start[j]]), bool(grid.stop[j])
            if stop and self.path.holds[piece] >= period:
                continue
            for row, u in (
                (grid.end[j - 1], profile.u[j - 1, 1]),
                (grid.start[j], profile.u[j, 0]),
            ):
                s, p = float(grid.s[row]), int(grid.piece[row])
                reach = _ZONE * period * float(np.sqrt(profile.x[j]))
                if stop:
                    reach = 0.5 * abs(float(u)) * (2.0 * _ZONE * period) ** 2
                reach = max(reach, 1e-6 * float(np.ptp(self.path.pieces[p].x[[0, -1]])))
                zones += [(d, p, s - reach, s + reach) for d in turning]
                if not stop:
                    break
        return zones

    def _cut(
        self,
        problem: PathProblem,
        profile: Profile,
        samples: RetimedSamples,
        grids: list[np.ndarray],
    ) -> bool:
        """Cut the intervals in which a limit is exceeded; False where there are none."""
        grid, most = problem.grid, 1.0 + _NEAR * self.policy.tolerance
        of, x, u = profile.inside(_INSIDE)
        rows = grid.start[of]
        s = grid.s[rows] + np.tile(_INSIDE, len(grid.step)) * grid.step[of]
        use = usage(problem.states(s, grid.piece[rows], x, u), self.limits)
        over = set(of[(use > most).any(axis=(1, 2))].tolist())
        motion = self.motion(samples)
        judged = inverse_dynamics(self.scene, motion)
        wrong = (usage(judged, self.limits) > most).any(axis=(1, 2))
        turning = np.asarray(judged.reversal.any(axis=1))
        for i in np.flatnonzero(wrong & samples.moving):
            p, place = int(samples.piece[i]), float(samples.s[i])
            here = np.flatnonzero((grid.piece[grid.start] == p) & (grid.s[grid.start] <= place))
            over.add(int(here[-1]))
            if turning[i]:
                near = 2.0 * float(samples.rate[i]) / self.policy.sample_rate
                for k, (d, piece, a, b) in enumerate(self.zones):  # let zones beside reach to it
                    if piece == p and a - near < place < b + near:
                        wider = min(a, place - 0.1 * near), max(b, place + 0.1 * near)
                        self.zones[k] = d, piece, *wider
        for j in over:
            p, first, last = grid.piece[grid.start[j]], grid.s[grid.start[j]], grid.s[grid.end[j]]
            self.constant.append((int(p), float(first), float(last)))
        self._halve(grid, over, grids)
        return bool(over)

    def _halve(self, grid: Grid, intervals: Iterable[int], grids: list[np.ndarray]) -> None:
        """Add the middle of intervals to the points of their pieces."""
        for j in intervals:
            p, ends = grid.piece[grid.start[j]], grid.s[[grid.start[j], grid.end[j]]]
            grids[p] = distinct(np.array([ends.mean()]), self.path.pieces[p], grids[p])

    def motion(self, samples: RetimedSamples) -> Trajectory:
        names = list(self.scene.payloads)
        attached = None
        if self.path.attached is not None:
            attached = {n: self.path.attached[samples.piece, k] for k, n in enumerate(names)}
        return Trajectory.from_arrays(
            self.scene,
            samples.t,
            configurations(self.columns, samples.q, self.scene.model.nq),
            columns_to_velocities(self.columns, samples.v),
            columns_to_velocities(self.columns, samples.a),
            attached,
            f"{self.path.source} retimed",
        )

    def cool(
        self, problem: PathProblem, fast: Profile, smooth: float
    ) -> tuple[Profile, float | None, np.ndarray]:
        """Keep continuous torques, as the samples show them; and the uniform motion's duration."""
        limit = np.array([x.over_time[0] for x in self.limits])
        path, n = self.path, len(self.path.pieces)
        piece = np.minimum(np.arange(n + 1), n - 1)
        ends = np.array([path.pieces[p].x[0 if i == p else -1] for i, p in enumerate(piece)])
        none = np.zeros(n + 1)
        still = problem.states(ends, piece, none, none, path.attached)
        torque = signals(still)["motor torque"]
        stay = np.array(path.holds)
        asked, near = limit, 0.5 * self.policy.tolerance
        given = self.given_profile(problem.grid)
        for _ in range(4):
            cycle = HeatBudget(asked, stay @ torque**2, float(stay.sum()))
            profile, uniform = within_continuous(problem, fast, cycle, given)
            samples = sample(path, profile, self._rate, smooth)
            use = self.judge(self.motion(samples), samples.moving).heat
            least = 0.0 if profile is fast else 1.0 - near  # smoothing cools: there may be room
            if least <= use.max() <= 1.0 + near:
                break
            asked = asked / np.maximum(use, min(use.max(), 1.0))
        whole = uniform + n * smooth + float(stay.sum())
        return profile, whole if np.isfinite(whole) else None, use

    @property
    def _rate(self) -> float:
        """Of the samples, Hz."""
        return self.policy.sample_rate

    def judge(self, trajectory: Trajectory, moving: np.ndarray) -> _Judged:
        """Return what a motion (T,) uses of all limits; `moving`: (T,)."""
        result = inverse_dynamics(self.scene, trajectory)
        used = [rms(result.times, torque) for torque in signals(result)["motor torque"].T]
        heat = np.array(used) / [x.over_time[0] for x in self.limits]
        return _Judged(trajectory, result, usage(result, self.limits), moving, heat)

    def result(
        self,
        problem: PathProblem,
        profile: Profile,
        judged: _Judged,
        smooth: float,
        uniform: float | None,
        heat: np.ndarray | None,
    ) -> RetimeResult:
        """Say what holds a judged motion back; `uniform`, `heat`: see `cool`."""
        trajectory, use = judged.trajectory, judged.use
        moving, rows = use[judged.moving], instant_limits()
        shares = (moving > _AT_LIMIT).mean(axis=0) if len(moving) else np.zeros(use.shape[1:])
        limiting = {
            drive.name: {rows[k].name: float(shares[d, k]) for k in np.flatnonzero(shares[d])}
            for d, drive in enumerate(self.scene.drives)
            if shares[d].any()
        }
        for d in np.flatnonzero(np.zeros(0) if heat is None else heat > _AT_LIMIT):
            kinds = limiting.setdefault(self.scene.drives[d].name, {})
            kinds[self.limits[d].over_time[1]] = 1.0
        named = [
            (i, x.from_catalog) for i, x in enumerate(self.limits) if x.from_catalog is not None
        ]
        holding = holds(self.scene, trajectory, judged.result.states.v)
        inertias = load_inertias(judged.result) if named else np.empty(0)
        return RetimeResult(
            trajectory=trajectory,
            duration=float((profile.duration + smooth).sum() + sum(self.path.holds)),
            moves=profile.duration + smooth,
            before=None if self.path.given is None else self.path.given.duration,
            limiting=limiting,
            excess=max(0.0, float(moving.max(initial=0.0)) - 1.0),
            usage=use,
            problem=problem,
            profile=profile,
            rms=heat,
            uniform=uniform,
            smooth=smooth,
            criteria={
                self.scene.drives[i].name: criteria_over(
                    judged.result, i, *drive, holding, float(inertias[i])
                )
                for i, drive in named
            },
        )
