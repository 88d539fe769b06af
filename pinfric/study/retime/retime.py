"""`pf.retime`: the fastest motion that a robot's real drives can do along a path.

Solve on a coarse grid, then on one whose points are even in time and in place, with every knot and
every reversal among them; judge the inside of all intervals, and the samples, by
`inverse_dynamics`, and refine where a limit is exceeded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args, get_type_hints

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import RetimeError
from pinfric.model.brief import file_name, listed, screen
from pinfric.model.couples import mixed
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.transmission import Transmission
from pinfric.model.upward import Shown
from pinfric.study.retime.limits import (
    KINDS,
    DriveLimits,
    LimitsLike,
    limited_scene,
    read_limits,
    scaled,
)
from pinfric.study.retime.path import Path, check_limits, load_path
from pinfric.study.retime.problem import Policy, Problem, modes, usage
from pinfric.study.retime.profile import Profile, Samples, columns_to_velocities, sample
from pinfric.study.retime.scan import box_scan, limit_curve
from pinfric.study.retime.tables import (
    distinct,
    make_grid,
    make_tables,
    natural_points,
    rates_of,
)
from pinfric.study.retime.thermal import Cycle, within_continuous
from pinfric.study.sizing.size import geared
from pinfric.study.summary import ends_by_magnitude, rests
from pinfric.study.summary import rms as root_mean_square
from pinfric.study.trajectory.joint_columns import JointColumn, configurations, joint_columns
from pinfric.study.trajectory.trajectory import Trajectory

#: Where the inside of an interval is judged.
_INSIDE = np.array([0.02, 0.25, 0.5, 0.75, 0.98])
#: Times that intervals over a limit are cut in two.
_ROUNDS = 10
#: A limit of which more than this part is used holds the motion back.
_AT_LIMIT = 0.995
#: What comes nearer than this may do so, on another grid.
_NEAR_LIMIT = 0.98
#: Times the points asked for, where fewer find no way along the path.
_FINER = 1, 4, 16
#: Fewest points of a piece; a zone about a reversal, in sample periods.
_FEWEST, _ZONE = 24, 0.65


@dataclass(frozen=True)
class RetimeResult(Shown):
    """The fastest motion along a path, and what holds it back.

    Attributes:
        trajectory: its samples, which every command takes.
        duration: s, holds included. moves: (pieces,) of each, s.
        before: how long the motion took that the path comes from, s; None: it had no times.
        limiting: drive -> limit -> part of the moving time in which more than 99.5 % are used.
        excess: the most by which a sample exceeds any limit, as a part of it (`inverse_dynamics`
            judges); 0.001 is 0.1 %.
        usage: (T, na, `limits.KINDS`) which part of each limit each sample uses.
        problem, profile: the grid with its limits, and the speed on it.
        rms: (na,) part of its continuous torque that each motor uses over the whole cycle; None
            where that was not asked for.
        uniform: s, how long the motion would take if it were slowed down as a whole until these
            torques are kept; None as `rms`.
        cycle: what the continuous torques count beside the moves; None as `rms`.
        smooth: s, of the moving mean; each move takes so much longer by it.
    """

    trajectory: Trajectory
    duration: float
    moves: np.ndarray
    before: float | None
    limiting: dict[str, dict[str, float]]
    excess: float
    usage: np.ndarray
    problem: Problem
    profile: Profile
    rms: np.ndarray | None = None
    uniform: float | None = None
    cycle: Cycle | None = None
    smooth: float = 0.0

    def __repr__(self) -> str:
        most = self.held_back()
        return screen("RetimeResult", f"{file_name(self.problem.path.source)}: "
                      f"{self.duration:.4g} s", {
            "moves": listed([f"{t:.4g} s" for t in self.moves]),
            "limits": listed([f"{d}: {k}" for d, k, _ in most],
                             [f"{100 * share:.0f} % of the time" for _, _, share in most]),
            "excess": f"{100 * self.excess:.3g} % over any limit",
            "more": ".trajectory .limiting .sensitivity() .sweep_ratio(joint, ratios) .plot()",
        })  # fmt: skip

    def held_back(self) -> list[tuple[str, str, float]]:
        """Return (drive, limit, part of the moving time), the greatest part first."""
        found = [(d, k, share) for d, kinds in self.limiting.items() for k, share in kinds.items()]
        return sorted(found, key=lambda entry: -entry[2])

    def limit_curve(self) -> np.ndarray:
        """Return (n,) the greatest (ds/dt)^2 with any acceleration within all limits.

        At the start of each interval of `profile.grid`; none above 100 times the
        greatest of the profile is looked for.
        """
        found = np.empty(len(self.profile.grid.step))
        most = 100.0 * max(float(self.profile.x.max()), 1e-9)
        limit_curve(box_scan(self.problem.scan()), most, found)
        return found

    def sensitivity(self, change: float = 0.01) -> dict[str, dict[str, float]]:
        """Return d ln T/d ln limit of the moving time T, drive -> limit, on the same grid.

        Central differences; only limits of which nearly all is used at some time are tried, the
        others are 0. Of the speed-torque line the stall torque is changed.

        Args:
            change: relative change of a limit.
        """

        def slope(d: int, kind: int | None) -> float:
            times = []
            for factor in (1.0 + change, 1.0 - change):
                problem, cycle = p, self.cycle
                if kind is not None:
                    problem = p.with_limits(d, scaled(p.limits[d], kind, factor))
                elif cycle is not None:
                    limit = cycle.limit.copy()
                    limit[d] *= factor
                    cycle = replace(cycle, limit=limit)
                times.append(self._moving_time(problem, cycle))
            return float(np.log(times[0] / times[1]) / np.log((1 + change) / (1 - change)))

        found: dict[str, dict[str, float]] = {}
        p, most = self.problem, self.usage.max(axis=0, initial=0.0)
        for d, drive in enumerate(p.scene.drives):
            near = [k for k in range(len(KINDS)) if most[d, k] > _NEAR_LIMIT]
            if near:
                found[drive.name] = {KINDS[k]: slope(d, k) for k in near}
            if self.rms is not None and self.rms[d] > _NEAR_LIMIT:
                found.setdefault(drive.name, {})["continuous torque"] = slope(d, None)
        return found

    def _moving_time(self, problem: Problem, cycle: Cycle | None) -> float:
        profile = problem.solve()
        if cycle is not None:
            profile, _ = within_continuous(problem, profile, cycle)
        return float(profile.duration.sum())

    def sweep_ratio(self, joint: str, ratios: Sequence[float]) -> dict[float, float | str]:
        """Return the duration (s, holds included) for other gear ratios of one drive.

        The gear's other figures stay: torques and inertia at the motor's shaft. On the same grid;
        where a ratio cannot follow the path, why.

        Args:
            joint: the drive's name. ratios: motor turns per joint turn.

        Raises:
            RetimeError: there is no such drive.
        """
        p = self.problem
        names = p.scene.actuator_names
        if joint not in names:
            raise RetimeError(f"sweep_ratio: there is no drive {joint!r}; there are: "
                              f"{', '.join(names)}")  # fmt: skip
        d = names.index(joint)
        gear = p.scene.drives[d].transmission or Transmission(ratio=1.0)
        found: dict[float, float | str] = {}
        for ratio in ratios:
            other_gear = {joint: gear.model_copy(update={"ratio": ratio})}
            try:
                scene = p.scene.with_(actuators=geared(p.scene, other_gear))
                other = p.with_limits(d, p.limits[d], scene)
                found[ratio] = self._moving_time(other, self.cycle) + sum(p.path.holds)
            except RetimeError as problem:
                found[ratio] = str(problem)
        return found


def retime(
    scene: Scene,
    path: Path | Trajectory | str,
    limits: LimitsLike = None,
    *,
    reversal: Literal["interval", "own sign"] = "interval",
    rest: Literal["worst", "needed"] = "worst",
    rms: bool = False,
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
        reversal, rest: what counts where a joint stands still, see `problem.Policy`.
        rms: keep each motor's continuous torque over the whole cycle, holds included (`thermal`).
        smooth: s; the place along the path becomes a moving mean over this time, so that
            accelerations ramp; each move takes so much longer.
        points: of the grid, all pieces together; refined where a limit would be exceeded.
        tolerance: part of a limit by which it may be exceeded between grid points.
        sample_rate: of the resulting trajectory, Hz.

    Raises:
        RetimeError: loops, cylinders or joints without a drive; limits missing; a drive that cannot
            hold, break away or follow, with the place and what it needs.
        TrajectoryError: a path that cannot be, or does not fit the robot.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> motion = pf.load_trajectory("pendulum", scene)
    >>> found = pf.retime(scene, motion, {"joint_1": {"effort": 20.0, "velocity": 2.0}})
    >>> round(found.duration, 2)
    2.29
    """
    expect_scene(scene, "retime")
    _check_scene(scene)
    if isinstance(path, Trajectory):
        path = Path.from_trajectory(path)
    elif not isinstance(path, Path):
        path = load_path(path, scene)
    if not (points >= 2 and sample_rate > 0.0 and tolerance > 0.0 and smooth >= 0.0):
        raise RetimeError(f"retime: points {points}, sample_rate {sample_rate:g}, tolerance "
                          f"{tolerance:g}, smooth {smooth:g}: should be positive")  # fmt: skip
    for name, value in (("reversal", reversal), ("rest", rest)):
        known = get_args(get_type_hints(Policy)[name])
        if value not in known:
            raise RetimeError(f"retime: {name} {value!r}; should be one of: {', '.join(known)}")
    given = read_limits(scene, limits)
    scene = limited_scene(scene, given)
    if path.attached is not None and path.attached.shape[1] != len(scene.payloads):
        raise RetimeError(f"{path.source}: attached: {path.attached.shape[1]} columns for "
                          f"{len(scene.payloads)} payloads")  # fmt: skip
    columns = joint_columns(scene.model, scene.source)
    check_limits(path, columns)
    policy = Policy(reversal, rest, sample_rate, tolerance)
    return _Retiming(scene, path, columns, given, policy).run(points, rms, smooth)


def _check_scene(scene: Scene) -> None:
    """Refuse robots whose efforts depend on friction through reactions."""
    if scene.linkage is not None:
        what = f"loop {scene.loops[0].name!r}" if scene.loops else "a drive off the joints"
        raise RetimeError(f"{scene.source}: retime is for open chains with drives on their joints; "
                          f"{what} couples efforts and friction")  # fmt: skip
    driven = [drive.velocity_index for drive in scene.drives]
    if driven != list(range(scene.model.nv)):
        raise RetimeError(f"{scene.source}: retime needs one drive on each of {scene.model.nv} "
                          f"degrees of freedom, found {len(driven)}")  # fmt: skip
    there = mixed(scene.drives, scene.model.nv)
    for site in scene.sites:
        if there[site.velocity_index]:
            raise RetimeError(f"{scene.source}: friction.{site.name}: retime knows friction of "
                              "coupled drives on their motors' sides only: move it to the "
                              "transmission (no_load_torque, motor_viscous)")  # fmt: skip


class _Retiming:
    """One run of `retime`."""

    def __init__(
        self, scene: Scene, path: Path, columns: tuple[JointColumn, ...],
        limits: tuple[DriveLimits, ...], policy: Policy,
    ) -> None:  # fmt: skip
        self.scene, self.path, self.columns = scene, path, columns
        self.limits, self.policy = limits, policy
        self.natural = [natural_points(piece, rates_of(scene, columns)) for piece in path.pieces]
        #: (piece, from s, to s): intervals of constant u; and zones about reversals.
        self.constant: list[tuple[int, float, float]] = []
        self.zones: list[tuple[int, int, float, float]] = []

    def run(self, points: int, rms: bool, smooth: float) -> RetimeResult:
        """Do what `retime` does; arguments see there."""
        self.check_stops()
        problem, profile, samples = self.solve(points)
        if not rms:
            if smooth:
                samples = sample(self.path, profile, self.policy.sample_rate, smooth)
            return self.result(problem, profile, samples, smooth)
        profile, uniform, cycle, use = self.cool(problem, profile)
        samples = sample(self.path, profile, self.policy.sample_rate, smooth)
        found = self.result(problem, profile, samples, smooth)
        return replace(found, rms=use, uniform=uniform, cycle=cycle)

    def solve(self, points: int) -> tuple[Problem, Profile, Samples]:
        """Solve; where no way is found, on finer grids: between far points it can be missed."""
        for finer in _FINER:
            try:
                return self.refine(self.coarse(finer * points), finer * points)
            except RetimeError as problem:
                last = problem
                self.constant, self.zones = [], []
        raise last

    def problem(self, points: list[np.ndarray]) -> Problem:
        """The problem on a grid."""
        grid = make_grid(self.scene, self.path, self.columns, points)
        middle, piece = 0.5 * (grid.s[grid.start] + grid.s[grid.end]), grid.piece[grid.start]
        constant = np.zeros(len(middle), dtype=bool)
        for p, first, last in self.constant:
            constant |= (piece == p) & (first < middle) & (middle < last)
        tables = make_tables(self.scene, self.path, self.columns, grid)
        return Problem(self.scene, self.path, self.columns, self.limits, self.policy, grid, tables,
                       modes(grid, self.policy, self.zones), constant)  # fmt: skip

    def check_stops(self) -> None:
        """Refuse stops at which a drive cannot hold, with what it carries before and after."""
        probe = self.problem([piece.x[[0, -1]] for piece in self.path.pieces])
        for p, curve in enumerate(self.path.pieces):
            for end, s in enumerate(curve.x[[0, -1]]):
                still = probe.states(np.array([s]), np.array([p]), np.zeros(1), np.zeros(1))
                use = usage(still, self.limits, replace(self.policy, rest="needed"))[0]
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

    def refine(self, coarse: Profile, points: int) -> tuple[Problem, Profile, Samples]:
        """Solve on the final grid, cut intervals over a limit in two, up to `_ROUNDS` times."""
        if self.policy.reversal == "interval":
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
            samples = sample(self.path, profile, self.policy.sample_rate)
            if attempt == _ROUNDS or not self._cut(problem, profile, samples, grids):
                break
        return problem, profile, samples

    def _zones(self, profile: Profile) -> list[tuple[int, int, float, float]]:
        """Where samples are beside a reversal: within half a sample period of it, and a reserve.

        At a stop that is left at once within a whole one: of the samples beside it the slower
        counts.
        """
        grid, found, period = profile.grid, [], 1.0 / self.policy.sample_rate
        for j in range(1, len(grid.step)):
            turning = np.flatnonzero(grid.way[j] * grid.way[j - 1] < 0.0).tolist()
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
                found += [(d, p, s - reach, s + reach) for d in turning]
                if not stop:
                    break
        return found

    def _cut(
        self, problem: Problem, profile: Profile, samples: Samples, grids: list[np.ndarray]
    ) -> bool:
        """Cut the intervals in which a limit is exceeded; False where there are none."""
        grid, most = problem.grid, 1.0 + 0.5 * self.policy.tolerance
        of, x, u = profile.inside(_INSIDE)
        rows = grid.start[of]
        s = grid.s[rows] + np.tile(_INSIDE, len(grid.step)) * grid.step[of]
        use = usage(problem.states(s, grid.piece[rows], x, u), self.limits, self.policy)
        over = set(of[(use > most).any(axis=(1, 2))].tolist())
        motion = self.motion(samples)
        judged = inverse_dynamics(self.scene, motion)
        wrong = (usage(judged, self.limits, self.policy) > most).any(axis=(1, 2))
        turning = np.asarray(judged.reversal.any(axis=1))
        for i in np.flatnonzero(wrong & samples.moving):
            p, place = int(samples.piece[i]), float(samples.s[i])
            here = np.flatnonzero((grid.piece[grid.start] == p) & (grid.s[grid.start] <= place))
            over.add(int(here[-1]))
            if turning[i]:
                self._widen(p, place, 2.0 * float(samples.rate[i]) / self.policy.sample_rate)
        for j in over:
            p, first, last = grid.piece[grid.start[j]], grid.s[grid.start[j]], grid.s[grid.end[j]]
            self.constant.append((int(p), float(first), float(last)))
            grids[p] = distinct(np.array([0.5 * (first + last)]), self.path.pieces[p], grids[p])
        return bool(over)

    def _widen(self, piece: int, s: float, near: float) -> None:
        """Let the zones of reversals beside a sample reach to it."""
        for i, (d, p, first, last) in enumerate(self.zones):
            if p == piece and first - near < s < last + near:
                self.zones[i] = d, p, min(first, s - 0.1 * near), max(last, s + 0.1 * near)

    def motion(self, samples: Samples) -> Trajectory:
        """The samples as a trajectory."""
        names = list(self.scene.payloads)
        attached = None
        if self.path.attached is not None:
            attached = {n: self.path.attached[samples.piece, k] for k, n in enumerate(names)}
        return Trajectory.from_arrays(
            self.scene, samples.t, configurations(self.columns, samples.q, self.scene.model.nq),
            columns_to_velocities(self.columns, samples.v),
            columns_to_velocities(self.columns, samples.a), attached,
            f"{self.path.source} retimed",
        )  # fmt: skip

    def cool(self, problem: Problem, fast: Profile) -> tuple[Profile, float, Cycle, np.ndarray]:
        """Keep continuous torques, as the samples show them; and the uniform motion's duration."""
        limit = np.array([x.continuous_torque for x in self.limits])
        if not np.isfinite(limit).any():
            raise RetimeError("rms: no drive has a continuous_torque; give it in the limits")
        path, n = self.path, len(self.path.pieces)
        piece = np.minimum(np.arange(n + 1), n - 1)
        ends = np.array([path.pieces[p].x[0 if i == p else -1] for i, p in enumerate(piece)])
        none = np.zeros(n + 1)
        still = problem.states(ends, piece, none, none, path.attached)
        torque = _counted(still, self.policy)
        stay = np.array(path.holds)
        asked = limit
        for _ in range(3):
            cycle = Cycle(asked, stay @ torque**2, float(stay.sum()))
            profile, uniform = within_continuous(problem, fast, cycle)
            motion = self.motion(sample(path, profile, self.policy.sample_rate))
            use = _mean_squares(inverse_dynamics(self.scene, motion), self.policy) / limit
            if use.max() <= 1.0 + 0.5 * self.policy.tolerance:
                break
            asked = asked / np.maximum(use, 1.0)
        return profile, uniform + float(stay.sum()), cycle, use

    def result(
        self, problem: Problem, profile: Profile, samples: Samples, smooth: float
    ) -> RetimeResult:
        """Judge the samples and say what holds them back."""
        trajectory = self.motion(samples)
        judged = inverse_dynamics(self.scene, trajectory)
        use = usage(judged, self.limits, self.policy)
        moving = use[samples.moving]
        shares = (moving > _AT_LIMIT).mean(axis=0) if len(moving) else np.zeros(use.shape[1:])
        limiting = {
            drive.name: {KINDS[k]: float(shares[d, k]) for k in np.flatnonzero(shares[d])}
            for d, drive in enumerate(self.scene.drives) if shares[d].any()
        }  # fmt: skip
        return RetimeResult(
            trajectory=trajectory,
            duration=float((profile.duration + smooth).sum() + sum(self.path.holds)),
            moves=profile.duration + smooth,
            before=self.path.duration,
            limiting=limiting,
            excess=max(0.0, float(moving.max(initial=0.0)) - 1.0),
            usage=use,
            problem=problem,
            profile=profile,
            smooth=smooth,
        )


def _counted(result: InverseResult, policy: Policy) -> np.ndarray:
    """(T, na) the motors' torques that heat: the worse end of each interval, or what is needed."""
    worst, least = ends_by_magnitude(result.motor_torque_lower, result.motor_torque_upper)
    if policy.rest == "worst":
        return worst
    still = [rests(result, d) for d in range(worst.shape[1])]
    return np.where(np.stack(still, axis=1), least, worst)


def _mean_squares(result: InverseResult, policy: Policy) -> np.ndarray:
    """(na,) root mean squares of the motors' torques over a motion, N m."""
    assert result.t is not None
    counted = _counted(result, policy)
    return np.array([root_mean_square(result.t, counted[:, d]) for d in range(counted.shape[1])])
