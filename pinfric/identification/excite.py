"""`pf.excite`: a motion within limits whose log will show the friction of each joint."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.errors import IdentificationError, choose_from
from pinfric.identification.excitation import (
    RAMP,
    SPEED_UP,
    Reach,
    Series,
    informative_moves,
    informative_series,
    move_time,
    staircases,
)
from pinfric.identification.information import Criterion
from pinfric.identification.recordings import check_scene
from pinfric.model.arrays import FloatArray
from pinfric.model.brief import file_name, listed, screen
from pinfric.model.described import EFFORT, PLACE, SPEED, described, quantity
from pinfric.model.files import write_folder
from pinfric.model.scene import Scene, expect_scene
from pinfric.motions.joint_columns import JointColumn, configurations, joint_columns, stated_limit
from pinfric.motions.trajectory import Trajectory
from pinfric.motions.waypoints import WayPoint, WayPointFile, sample_waypoints, waypoints_text

#: rad: half of the range of a joint whose range is wider, or not limited: nothing is known of what
#: stands around the robot. Share of a narrower range that is used.
_HALF_RANGE, _OF_RANGE = 0.5 * np.pi, 0.9
#: Share of the duration for staircases: alone, a joint shows less in a time than with all others.
_STAIRS = 0.2
#: Postures among which moves are sought.
_POSTURES = 200
#: Samples of the series that count as known before the first move, and as how many seconds.
_BEGUN, _BEGUN_TIME = 100, 5.0
#: Rounds in which a motion beyond an effort's limit is slowed down; least and largest step.
_ROUNDS, _STEPS = 12, (1.08, 1.5)
#: s: for each joint where no duration is given, for each at least; of all at most.
_A_JOINT, _LEAST, _LONGEST = 20.0, 10.0, 3600.0
#: Hz.
_LEAST_RATE, _MOST_RATE = 20.0, 1e4


@described
class JointExcitation:
    """How one joint moves in an excitation."""

    name: str = quantity("the joint", heading="joint", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    low: float = quantity("where it moves, from", PLACE, "from")
    high: float = quantity("to", PLACE, "to")
    speed: float = quantity("top speed", SPEED, "top\nspeed")
    acceleration: float = quantity("largest acceleration", "rad/s^2 or m/s^2", "acceler-\nation")
    effort: float = quantity("largest effort, with the scene's friction", EFFORT, "peak\neffort")
    effort_limit: float | None = quantity("what the URDF allows; none: no limit", EFFORT, "limit")


@described
class ExciteSummary:
    """A motion whose log will show friction."""

    duration: float = quantity("of the motion", "s")
    rate: float = quantity("of its samples", "Hz")
    period: float = quantity("of the Fourier series, which comes first", "s")
    staircases_from: float = quantity("when the joints begin to move one by one", "s")
    moves_duration: float = quantity("of the way-points", "s")
    slowed: float = quantity("factor by which it was slowed down for the limits of efforts", "1")
    joints: tuple[JointExcitation, ...] = quantity("in the order of the model")


@dataclass(frozen=True)
class Excitation:
    """A motion within limits whose log will show friction.

    Attributes:
        scene: the robot.
        trajectory: Fourier series of all joints, then staircases of speed of each joint alone; at
            rest at both ends.
        waypoints: the same from point to point, for controllers that take no samples.
        summary: its figures.
    """

    scene: Scene
    trajectory: Trajectory
    waypoints: WayPointFile
    summary: ExciteSummary

    def save(self, folder: str | Path) -> list[Path]:
        """Write excitation.csv and excitation.waypoints.yaml; create the folder where missing.

        Raises:
            PinfricError: it cannot be written.
        """
        return write_folder(folder, excitation_files(self))

    def __repr__(self) -> str:
        s = self.summary
        return screen(
            "Excitation",
            f"{file_name(self.scene.source)}, {s.duration:.4g} s at {s.rate:g} Hz",
            {
                "top speeds": listed(
                    [x.name for x in s.joints], [f"{x.speed:.3g}" for x in s.joints]
                ),
                "more": ".trajectory .waypoints .summary .save(folder)",
            },
        )


def excite(
    scene: Scene,
    *,
    duration: float | None = None,
    rate: float = 250.0,
    share: float = 0.8,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    speeds: Mapping[str, float] | None = None,
    accelerations: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Excitation:
    """Return a motion of an open chain's joints whose log will show their friction.

        maximize log det S over a few terms of a Fourier series,    S: see `information`

    For four fifths of the time the joints move together, along the series; then each joint moves
    alone, there and back, at speeds that rise from one so slow that it breaks away. Positions,
    speeds, accelerations and efforts stay within limits; collisions are not checked.

    Args:
        duration: s, about. Else 20 s a joint, 60 s at least.
        rate: of the samples, Hz.
        share: of the URDF's limits of speed and effort that is used, above 0 to 1.
        ranges: joint -> least and greatest position, rad or m. Else 90 % of the URDF's range, at
            most 90 degrees to either side of its middle.
        speeds: joint -> top speed, rad/s or m/s. Else `share` of the URDF's limit.
        accelerations: joint -> largest acceleration, rad/s^2 or m/s^2. Else top speed in 0.4 s.
        seed: of the search.

    Raises:
        IdentificationError: loops, unknown joints, limits that are missing or that cannot be, an
            effort's limit that does not hold the robot's weight.
    """
    expect_scene(scene, "excite")
    check_scene(scene)
    duration = max(_A_JOINT * scene.model.nv, 60.0) if duration is None else duration
    _check(scene, duration, rate, share)
    columns = joint_columns(scene.model)
    reach = _reach(scene, columns, share, ranges or {}, speeds or {}, accelerations or {})
    draws = np.random.default_rng(seed)
    postures = draws.uniform(reach.low, reach.high, (_POSTURES, len(columns)))
    criterion = Criterion.of(scene, postures)
    allowed = share * np.array([stated_limit(float(x)) for x in scene.model.effortLimit])
    _check_weight(scene, columns, postures, allowed / share)
    series = informative_series(criterion, reach, (1.0 - _STAIRS) * duration, seed)
    slowed, plan = 1.0, None
    for _ in range(_ROUNDS):
        plan = _plan(scene, criterion, reach.slower(slowed), series.slower(slowed), duration, rate)
        most = np.maximum(*(_peaks(scene, motion) for motion in (plan.trajectory, plan.stepped)))
        if (most <= allowed).all():
            break
        slowed *= float(np.clip(np.sqrt(np.max(most / allowed)), *_STEPS))
    else:
        j = int(np.argmax(most / allowed))
        raise IdentificationError(
            f"{scene.source}: joint {scene.joint_names[j]} needs {most[j]:.3g} "
            f"{scene.drives[j].unit} in a motion {slowed:.2g} times as slow; {100 * share:g} % of "
            f"its limit is {allowed[j]:.3g}: narrow the ranges, or use more of the limits (share)"
        )
    return Excitation(
        scene,
        plan.trajectory,
        plan.waypoints,
        ExciteSummary(
            duration=plan.trajectory.duration,
            rate=rate,
            period=plan.series.period,
            staircases_from=plan.turn,
            moves_duration=plan.stepped.duration,
            slowed=slowed,
            joints=_joints(scene, plan, most),
        ),
    )


@dataclass(frozen=True)
class _Plan:
    """A motion by samples and one from point to point, for one reach.

    `turn`: s, when the series ends and the staircases begin. `points`: way-points of `stepped`.
    """

    reach: Reach
    series: Series
    trajectory: Trajectory
    turn: float
    waypoints: WayPointFile
    stepped: Trajectory


def _plan(
    scene: Scene, criterion: Criterion, reach: Reach, series: Series, duration: float, rate: float
) -> _Plan:
    columns, together = joint_columns(scene.model), (1.0 - _STAIRS) * duration
    count = max(round(together / series.period), 1)
    samples = int(np.ceil(count * series.period * rate))
    series = replace(series, period=samples / (count * rate))
    t = np.arange(samples + 1) / rate
    motion = series.motion(reach, t)
    for rates in motion[1:]:
        rates[[0, -1]] = 0.0  # they are but for rounding
    home = motion[0][0]
    stairs = staircases(reach, home, _STAIRS * duration)
    alone = _evenly(_file(scene, (_resting(home), *stairs), rate), columns)
    whole = [np.concatenate(pair) for pair in zip(motion, alone[1:], strict=True)]
    trajectory = _trajectory(scene, columns, np.append(t, t[-1] + 1.0 / rate + alone[0]), whole)
    postures = motion[0][:: max(1, samples // (count * _POSTURES))]
    postures = postures[: _POSTURES + 1]
    # what little the series shows, so that the first moves are judged as the later ones
    begun = criterion.products(*(x[:: max(1, samples // _BEGUN)][:_BEGUN] for x in motion))
    moves = informative_moves(
        criterion, begun * (_BEGUN_TIME / _BEGUN), reach, postures, together, "trapezoidal"
    )
    ending = move_time(reach, np.array(moves[-1].q) - home, "trapezoidal")
    homing = WayPoint(q=tuple(home.tolist()), duration=max(ending, 0.2), hold=0.5)
    waypoints = _file(scene, (*moves, homing, *stairs), rate)
    times, *moved = _evenly(waypoints, columns)
    stepped = _trajectory(scene, columns, times, moved)
    return _Plan(reach, series, trajectory, float(t[-1]), waypoints, stepped)


def _resting(q: FloatArray) -> WayPoint:
    return WayPoint(q=tuple(q.tolist()), hold=0.5)


def _file(scene: Scene, points: tuple[WayPoint, ...], rate: float) -> WayPointFile:
    return WayPointFile(
        pinfric_trajectory=1,
        profile="trapezoidal",
        ramp=RAMP,
        sample_rate=rate,
        joints=scene.joint_names,
        points=points,
    )


def _evenly(file: WayPointFile, columns: Sequence[JointColumn]) -> list[FloatArray]:
    """Return t, q, v, a of way-points at all samples, those of long holds, too."""
    table = sample_waypoints(file, columns, {}, "excitation")
    t = np.arange(round(float(table.t[-1]) * file.sample_rate) + 1) / file.sample_rate
    at = np.searchsorted(table.t, t + 0.25 / file.sample_rate) - 1
    return [t, *(x[at] for x in (table.position, table.velocity, table.acceleration))]


def _trajectory(
    scene: Scene, columns: Sequence[JointColumn], t: FloatArray, motion: Sequence[FloatArray]
) -> Trajectory:
    position, v, a = motion
    q = configurations(columns, position, scene.model.nq)
    return Trajectory.from_arrays(scene, t, q, v, a, source="excitation")


def _peaks(scene: Scene, motion: Trajectory) -> FloatArray:
    """Return (nj,) the largest effort of each joint along a motion, N m or N."""
    result = inverse_dynamics(scene, motion)
    ends = [np.abs(x).max(axis=0) for x in (result.effort_lower, result.effort_upper)]
    return np.asarray(np.maximum(*ends))


def _joints(scene: Scene, plan: _Plan, peak: FloatArray) -> tuple[JointExcitation, ...]:
    q, v, a = plan.trajectory.joint_positions(), plan.trajectory.v, plan.trajectory.a
    limits = [stated_limit(float(x)) for x in scene.model.effortLimit]
    return tuple(
        JointExcitation(
            name=name,
            unit=scene.drives[j].unit,
            low=float(q[:, j].min()),
            high=float(q[:, j].max()),
            speed=float(np.abs(v[:, j]).max()),
            acceleration=float(np.abs(a[:, j]).max()),
            effort=float(peak[j]),
            effort_limit=limits[j] if np.isfinite(limits[j]) else None,
        )
        for j, name in enumerate(scene.joint_names)
    )


def _reach(
    scene: Scene,
    columns: Sequence[JointColumn],
    share: float,
    ranges: Mapping[str, tuple[float, float]],
    speeds: Mapping[str, float],
    accelerations: Mapping[str, float],
) -> Reach:
    rows, missing, wrong = [], [], []
    for option, given in (("range", ranges), ("speed", speeds), ("acceleration", accelerations)):
        for name in given:
            if name not in scene.joint_names:
                raise IdentificationError(
                    f"{option}: there is no joint {name!r}; {choose_from(name, scene.joint_names)}"
                )
    for column in columns:
        name = column.name
        low, high = column.lower, column.upper
        middle = 0.5 * (low + high) if np.isfinite([low, high]).all() else 0.0
        half = 0.5 * _OF_RANGE * (high - low)
        if column.unit == "rad":
            half = min(half, _HALF_RANGE)
        least, most = ranges.get(name, (middle - half, middle + half))
        speed = speeds.get(name, share * column.velocity_limit)
        bend = accelerations.get(name, speed / SPEED_UP)
        if not np.isfinite([least, most]).all():
            missing.append(f"range of {name}")
        elif name in ranges and not (low <= least < most <= high):
            limits = (
                f"; the URDF allows {low:g} to {high:g}" if np.isfinite([low, high]).any() else ""
            )
            wrong.append(f"range {name}={least:g}:{most:g}: should rise{limits}")
        elif least == most:
            missing.append(f"range of {name}, which stays at {least:g} (lock it: robot: locked)")
        if name not in speeds and not np.isfinite(speed):
            missing.append(f"speed of {name}")
        if name in speeds:
            wrong += _not_positive(f"speed {name}", speed, column.velocity_limit)
        if name in accelerations:
            wrong += _not_positive(f"acceleration {name}", bend, np.inf)
        rows.append((least, most, speed, bend))
    if wrong:
        raise IdentificationError(f"{scene.source}: {'; '.join(wrong)}")
    if missing:
        raise IdentificationError(
            f"{scene.source}: the URDF states no {', no '.join(missing)}: give it (a speed "
            "JOINT=VALUE, a range JOINT=LOW:HIGH)"
        )
    return Reach(*np.array(rows, dtype=float).T)


def _not_positive(what: str, value: float, most: float) -> list[str]:
    if np.isfinite(value) and 0.0 < value <= most:
        return []
    allowed = f"; the URDF allows {most:g}" if np.isfinite(most) else ""
    return [f"{what}={value:g}: should be above 0{allowed}"]


def _check(scene: Scene, duration: float, rate: float, share: float) -> None:
    least = _LEAST * scene.model.nv
    if not least <= duration <= _LONGEST:
        raise IdentificationError(
            f"duration {duration:g} s: should be {least:g} to {_LONGEST:g} s for "
            f"{scene.model.nv} joints"
        )
    if not _LEAST_RATE <= rate <= _MOST_RATE:
        raise IdentificationError(
            f"rate {rate:g} Hz: should be {_LEAST_RATE:g} to {_MOST_RATE:g} Hz"
        )
    if not 0.0 < share <= 1.0:
        raise IdentificationError(f"share {share:g}: should be above 0, at most 1")


def _check_weight(
    scene: Scene, columns: Sequence[JointColumn], postures: FloatArray, limits: FloatArray
) -> None:
    """Refuse ranges in which an effort's limit does not hold the robot."""
    q = configurations(columns, postures, scene.model.nq)
    none = np.zeros((len(q), scene.model.nv))
    held = np.abs(inverse_dynamics(scene, q, none, none).effort_frictionless).max(axis=0)
    heavy = [
        f"{scene.joint_names[j]} {held[j]:.3g} {scene.drives[j].unit}, limit {limits[j]:.3g}"
        for j in np.flatnonzero(held > limits).tolist()
    ]
    if heavy:
        raise IdentificationError(
            f"{scene.source}: efforts' limits do not hold the robot's weight everywhere in these "
            f"ranges: {'; '.join(heavy)}: narrow the ranges"
        )


def excitation_files(excitation: Excitation) -> dict[str, str | Callable[[Path], object]]:
    """Return file name -> text, or what writes it."""
    return {
        "excitation.csv": excitation.trajectory.to_csv,
        "excitation.waypoints.yaml": waypoints_text(
            excitation.waypoints,
            [
                "An excitation by `pinfric excite`: moves of all joints, each the one that tells",
                "most about friction; then each joint alone at rising speeds. Moves are straight",
                "in joint space; collisions were not checked.",
            ],
        ),
    }
