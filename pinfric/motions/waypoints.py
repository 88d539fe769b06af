"""Way-points: a motion written as a list of positions, holds and payload phases (YAML).

Joints start and stop together at every way-point. With s = (t - t_start)/T, q = q_0 + b(s) D:

    quintic      b = 10 s^3 - 15 s^4 + 6 s^5,  peak velocity 15 |D| / (8 T)
    trapezoidal  b' = s/(r (1 - r)) up to 1/(1 - r), down alike,  peak velocity |D| / ((1 - r) T)

r is `ramp`, the part of T spent speeding up (0.5: a triangle). Without `duration`

    T = max over joints of k |D| / (speed x velocity limit),  k = 15/8 or 1/(1 - r),

rounded up to whole sample periods, four at least. Equations: Biagiotti & Melchiorri, Trajectory
Planning for Automatic Machines and Robots (2008), chapters 2 and 3.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from pinfric.errors import TrajectoryError, choose_from
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.brief import counted
from pinfric.model.entry import (
    Entry,
    NonNegative,
    Number,
    Positive,
    Text,
    Vector3,
    Version,
    key,
    optional,
    parse,
)
from pinfric.model.magnitudes import LONGEST_TIME
from pinfric.model.schema import Moments
from pinfric.model.yamlfile import read_yaml, yaml_line
from pinfric.motions.joint_columns import JointColumn, limit_problems, refuse
from pinfric.motions.log.reading import ANGLE_UNITS
from pinfric.motions.sample_times import check_memory, same_instant, sample_times
from pinfric.motions.table import TrajectoryTable

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


#: A move sampled more coarsely than this is a jump: its velocities fall between the samples.
_MIN_PERIODS = 4
#: More points than this are a log: reading them as YAML takes 0.3 ms each.
_MOST_POINTS = 10_000


def _as_names(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


Names = Annotated[
    tuple[str, ...], BeforeValidator(_as_names, json_schema_input_type=str | tuple[str, ...])
]


class ToolPose(Entry):
    """Where the scene's `tool` is to be, in the frame of the robot's base."""

    xyz: Vector3 = key("its origin", [0.4, 0.1, 0.3], "m")
    rpy: Vector3 | None = optional(
        "its axes by roll, pitch, yaw, in `unit`; left out: as at the point before",
        [3.1416, 0.0, 0.0],
        "rad",
    )
    line: bool = key("whether it moves there on a straight line", True, default=False)


class BasePose(Entry):
    """Where a free base is, its feet as at the point before; only joints of the legs move."""

    xyz: Vector3 = key("its origin, in the world's axes", [0.0, 0.0, 0.3], "m")
    rpy: Vector3 | None = optional(
        "its axes by roll, pitch, yaw, in `unit`; left out: as at the point before",
        [0.0, 0.1, 0.0],
        "rad",
    )


class WayPoint(Entry):
    """One stop: where, how long the way there takes, how long it stays, what it grips."""

    q: tuple[Number, ...] = key(
        "one number per joint, in `unit`", [0.0, -0.5, 1.2], "rad or m", default=()
    )
    tool: ToolPose | None = optional(
        "where the scene's tool is, in place of `q`; solved from the posture before",
        {"xyz": [0.4, 0.1, 0.3], "line": True},
    )
    base: BasePose | None = optional(
        "where the free base is, in place of `q`; the scene's `feet` stay where they are",
        {"xyz": [0.0, 0.0, 0.3]},
    )
    duration: Positive | None = optional(
        "of the move to this point; left out: from `speed`", 1.5, "s"
    )
    hold: NonNegative = key("time at rest at this point", 0.3, "s", default=0.0)
    attach: Names = key("payloads picked up on arrival", "box", default=())
    detach: Names = key("payloads put down on arrival", ["box"], default=())
    name: str | None = optional("remark", "above the table")
    via: bool = key(
        "passed without a stop, which only `pinfric retime` can do", True, default=False
    )

    @model_validator(mode="after")
    def _one_place(self) -> WayPoint:
        if bool(self.q) + (self.tool is not None) + (self.base is not None) != 1:
            raise ValueError("give one of `q`, a number per joint, `tool` and `base`")
        return self


class Rating(Entry):
    """What an arm is rated for, in place of a cycle."""

    payload: Positive = key("rated mass that it carries", 10.0, "kg")
    payload_offset: NonNegative = key(
        "of its centre of mass from the origin of `link`, along its z; for the last joint as far "
        "from its axis",
        0.1,
        "m",
        default=0.1,
    )
    inertia: Moments | None = optional(
        "of the payload, as of one of a scene; left out: a cube of water",
        [0.1, 0, 0, 0.1, 0, 0.1],
        "kg m^2",
    )
    link: Text | None = optional(
        "that carries it; left out: the scene's `tool`, else the last link", "tool0"
    )
    speed: dict[str, Positive] = key(
        "top speed by joint, in place of the URDF's limit",
        {"elbow": 3.14},
        "rad/s or m/s",
        default_factory=dict,
    )
    acceleration_time: Positive = key(
        "from rest to top speed in the worst posture, one joint alone", 1.5, "s", default=1.5
    )


class RatingMotion(Rating):
    """A rating whose motion a file is: `size` takes it as the rating, not as a cycle."""

    points: Text = key("check sum of the points that belong to it", "5f1c09aa")

    @property
    def itself(self) -> Rating:
        """The rating, as one gives it."""
        return Rating(**{name: getattr(self, name) for name in Rating.model_fields})


def points_sum(points: Iterable[WayPoint]) -> str:
    """Return a check sum of positions, durations and holds, as a file has them."""
    rows = ([*point.q, point.duration or 0.0, point.hold] for point in points)
    text = "\n".join(" ".join(f"{x:g}" for x in row) for row in rows)
    return f"{zlib.crc32(text.encode()):08x}"


class WayPointFile(Entry):
    """A whole way-point file."""

    pinfric_trajectory: Version = key("version of the format", 1)
    profile: Literal["quintic", "trapezoidal"] = key(
        "of a move between two points", "trapezoidal", default="quintic"
    )
    sample_rate: Number = key(
        "of the computed samples, 0.001 to 1e6", 250, "Hz", ge=1e-3, le=1e6, default=1000.0
    )
    joints: tuple[str, ...] | None = optional(
        "order of the joints in `q`, all of them; left out: the URDF's order",
        ["shoulder", "elbow", "wrist"],
    )
    unit: Literal["rad", "deg"] = key(
        "of the angles in `q`; lengths are in m", "deg", default="rad"
    )
    speed: Number = key(
        "share of the velocity limits used by moves without duration",
        0.5,
        "1",
        gt=0,
        le=1,
        default=1.0,
    )
    ramp: Annotated[Number, Field(gt=0, le=0.5)] | None = optional(
        "part of a trapezoidal move spent speeding up; 1/3 if left out", 0.25, "1"
    )
    points: tuple[WayPoint, ...] = key(
        "the stops, the first one where the motion starts",
        [{"q": [0, 0, 0], "hold": 0.2}, {"q": [0.5, -0.3, 1.0], "duration": 1.0}],
        min_length=1,
    )
    rating: RatingMotion | None = optional(
        "written by `pinfric new --payload`: the motion is that of this rating",
        {"payload": 10.0, "points": "5f1c09aa"},
    )

    @model_validator(mode="after")
    def _points_of_the_rating(self) -> WayPointFile:
        if self.rating is not None and self.rating.points != points_sum(self.points):
            raise ValueError(
                "`points` were changed since `pinfric new` wrote them for the `rating`: take "
                "`rating` out, and they are a motion like any other"
            )
        return self


@dataclass(frozen=True)
class Move:
    """From one stop to the next: start, duration (s), from and to (nj,); then a hold (s).

    `line`: positions (nj,) over the way from 0 to 1; None: joints move straight.
    """

    start: float
    duration: float
    begin: FloatArray
    end: FloatArray
    hold: float
    line: BSpline | None = None

    @property
    def arrival(self) -> float:
        """The instant the joints stop, s."""
        return self.start + self.duration

    @property
    def departure(self) -> float:
        """The instant the hold ends, s."""
        return self.arrival + self.hold

    @property
    def rests(self) -> list[tuple[float, float]]:
        """When nothing moves, s: the hold, and a move to where the robot is."""
        still = self.line is None and bool((self.begin == self.end).all())
        return [(self.start, self.arrival)] * still + [(self.arrival, self.departure)]


def waypoints_text(file: WayPointFile, header: Iterable[str]) -> str:
    """Return a way-point file of joint positions as text, under a comment of these lines."""
    lines = [*(f"# {line}".rstrip() for line in header), "pinfric_trajectory: 1"]
    if file.profile != "quintic":
        lines.append(f"profile: {file.profile}")
    if file.ramp is not None:
        lines.append(f"ramp: {file.ramp:g}")
    lines.append(f"sample_rate: {file.sample_rate:g}")
    if file.joints is not None:
        names = ", ".join(yaml_line(name, within=True) for name in file.joints)
        lines.append(f"joints: [{names}]")
    lines.append("points:")
    for p in file.points:
        time = "" if p.duration is None else f"duration: {p.duration:.4f}, "
        lines.append(f"  - {{q: [{', '.join(f'{x:.6f}' for x in p.q)}], {time}hold: {p.hold:g}}}")
    return "\n".join(lines) + "\n"


def quintic(s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return b, db/ds, d2b/ds2 of b = 10 s^3 - 15 s^4 + 6 s^5, which goes from rest to rest.

    s: (T,) elapsed part of the duration, 0 to 1.
    """
    return (
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )


def trapezoidal(s: FloatArray, ramp: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return b, db/ds, d2b/ds2 of a trapezoidal velocity; where d2b/ds2 jumps, its next value.

    Args:
        s: (T,) elapsed part of the duration, 0 to 1.
        ramp: part of it spent speeding up, and again slowing down; (0, 0.5].
    """
    peak = 1.0 / (1.0 - ramp)
    slope = peak / ramp
    to_go = 1.0 - s
    rising, falling = s < ramp, s >= 1.0 - ramp
    b = np.where(rising, 0.5 * slope * s**2, peak * (s - 0.5 * ramp))
    b = np.where(falling, 1.0 - 0.5 * slope * to_go**2, b)
    rate = np.where(rising, slope * s, np.where(falling, slope * to_go, peak))
    return b, rate, np.where(rising, slope, np.where(falling, -slope, 0.0))


def read_waypoints(path: Path) -> WayPointFile:
    """Read and check a way-point file by itself; `sample_waypoints` checks it against a robot.

    Raises:
        TrajectoryError: unreadable, not YAML, unknown keys, values that cannot be; all at once.
    """

    def check(content: bytes) -> None:
        count = len(re.findall(rb"\b(?:q|tool|base)\s*:", content))
        if count > _MOST_POINTS:
            raise TrajectoryError(
                f"{path}: has {count} points; way-points are at most {_MOST_POINTS}: write a "
                "motion of so many as a CSV table with a column t"
            )

    content = read_yaml(path, TrajectoryError, "pinfric_trajectory", check)
    return parse(WayPointFile, content, str(path), TrajectoryError)


def sample_waypoints(
    waypoints: WayPointFile,
    columns: Sequence[JointColumn],
    payloads: Mapping[str, bool],
    source: str,
    lines: Mapping[int, BSpline] | None = None,
) -> TrajectoryTable:
    """Turn way-points into samples at `sample_rate`, of long holds fewer (`sample_times`).

    v = a = 0 exactly in holds, both ends included. Without a hold, the sample on a point takes the
    acceleration of the move that follows.

    Args:
        columns: (nj,) the model's joints in its order. payloads: name -> attached at the start.
        source: the file, for messages. lines: of `solve_tool_points`.

    Raises:
        TrajectoryError: what is wrong with the points or their durations, all at once.
    """
    problems = [
        f"points[{index}].via: a point without a stop has no time yet; `pinfric retime` finds it"
        for index, point in enumerate(waypoints.points)
        if point.via
    ]
    stops = _positions(waypoints, columns, payloads, problems, source)
    moves = _plan_moves(waypoints, stops, columns, problems, lines or {})
    refuse(source, problems)
    end, rate = moves[-1].departure, waypoints.sample_rate
    rests = (rest for move in moves for rest in move.rests)
    t, close = sample_times(end, rate, rests, source), same_instant(end)
    check_memory(len(t), len(columns), source)
    arrivals = [np.searchsorted(t, move.arrival - close) for move in moves]
    phase = np.searchsorted(arrivals, np.arange(t.size), side="right") - 1
    attached = dict(zip(payloads, carried_on(waypoints, payloads)[phase].T, strict=True))
    motion = _sample_moves(moves, t, waypoints, close)
    return TrajectoryTable(t, *motion, attached, np.zeros(len(columns)))


def way_points(
    waypoints: WayPointFile,
    columns: Sequence[JointColumn],
    payloads: Mapping[str, bool],
    source: str,
) -> FloatArray:
    """Return the positions (points, nj) in the model's order of joints, without times.

    Raises:
        TrajectoryError: what is wrong with the points, all at once.
    """
    problems = [
        f"points[{index}]: `via` passes it without a stop; hold, attach and detach need one"
        for index, point in enumerate(waypoints.points)
        if point.via and (point.hold or point.attach or point.detach)
    ]
    return _positions(waypoints, columns, payloads, problems, source)


def carried_on(waypoints: WayPointFile, payloads: Mapping[str, bool]) -> BoolArray:
    """Return (points, np) which payloads are carried from each point on.

    Args:
        payloads: name -> attached at the start.
    """
    carried, rows = dict(payloads), []
    for point in waypoints.points:
        carried |= dict.fromkeys(point.detach, False) | dict.fromkeys(point.attach, True)
        rows.append([carried[name] for name in payloads])
    return np.array(rows, dtype=bool).reshape(len(rows), len(payloads))


def _positions(
    waypoints: WayPointFile,
    columns: Sequence[JointColumn],
    payloads: Mapping[str, bool],
    problems: list[str],
    source: str,
) -> FloatArray:
    """Return the points (points, nj), rad or m, checked against the joints' limits."""
    names = [column.name for column in columns]
    listed = names if waypoints.joints is None else list(waypoints.joints)
    for name in dict.fromkeys(listed):
        if name not in names:
            problems.append(f"joints: unknown joint {name!r}; {choose_from(name, names)}")
        if listed.count(name) > 1:
            problems.append(f"joints: {name!r} occurs {listed.count(name)} times")
    if missing := [name for name in names if name not in listed]:
        problems.append(f"joints: missing {', '.join(missing)}; every joint needs a position")
    _check_points(waypoints, len(columns), payloads, problems)
    refuse(source, problems)
    order = [listed.index(name) for name in names]
    q = np.array([point.q for point in waypoints.points])[:, order]
    turns, degree = np.array([column.unit == "rad" for column in columns]), ANGLE_UNITS["deg"]
    in_degrees = q * np.where(turns, degree, 1.0)
    if waypoints.unit == "deg":
        return in_degrees
    t, largest = np.arange(float(len(q))), float(np.abs(q[:, turns]).max(initial=0.0))
    beyond = largest > 2.0 * np.pi and limit_problems(columns, t, q)
    if beyond and not limit_problems(columns, t, in_degrees):
        raise TrajectoryError(
            f"{source}: angles up to {largest:g} are beyond the joints' limits "
            "in rad, but within them in degrees: add `unit: deg`, or correct `q`"
        )
    return q


def _ramp(waypoints: WayPointFile) -> float:
    return 1.0 / 3.0 if waypoints.ramp is None else waypoints.ramp


def _check_points(
    waypoints: WayPointFile, joint_count: int, payloads: Mapping[str, bool], problems: list[str]
) -> None:
    attached = dict(payloads)
    count = joint_count if waypoints.joints is None else len(waypoints.joints)
    if waypoints.ramp is not None and waypoints.profile != "trapezoidal":
        problems.append("ramp: belongs to profile: trapezoidal; a quintic has none")
    if waypoints.points[0].tool is not None:
        problems.append("points[0].tool: the posture before is not known: give `q` here")
    if waypoints.points[0].base is not None:
        problems.append("points[0].base: the posture before is not known: give `q` here")
    if waypoints.points[0].duration is not None:
        problems.append("points[0].duration: the motion starts here; leave it out")
    lengths = [len(point.q) for point in waypoints.points]
    wrong = [i for i, number in enumerate(lengths) if number != count]
    if wrong:
        more = f" ({len(wrong)} such points)" if len(wrong) > 1 else ""
        problems.append(
            f"points[{wrong[0]}].q: {counted(lengths[wrong[0]], 'number')} for "
            f"{counted(count, 'joint')}{more}; give one per joint, in the order of `joints` (by "
            "default the scene's), or the scene of this motion"
        )
    unknown = False
    for index, point in enumerate(waypoints.points):
        for change, names, state in (
            ("detach", point.detach, False),
            ("attach", point.attach, True),
        ):
            for name in names:
                where = f"points[{index}].{change}"
                if name not in attached:
                    unknown = True
                    problems.append(
                        f"{where}: unknown payload {name!r}; {choose_from(name, attached)}"
                    )
                elif attached[name] is state and not unknown:  # it may be this one, misspelt
                    problems.append(
                        f"{where}: {name!r} is {change}ed already; if by the scene, write "
                        f"attached: {str(not state).lower()} beside it under robot.payloads"
                    )
                else:
                    attached[name] = state


def _plan_moves(
    waypoints: WayPointFile,
    stops: FloatArray,
    columns: Sequence[JointColumn],
    problems: list[str],
    lines: Mapping[int, BSpline],
) -> list[Move]:
    """Give every move its start and duration, s; the first stays at the first point."""
    first = waypoints.points[0]
    moves = [Move(0.0, 0.0, stops[0], stops[0], first.hold)]
    for index, point in enumerate(waypoints.points[1:], start=1):
        distance, line = np.abs(stops[index] - stops[index - 1]), lines.get(index)
        if line is not None:  # as far as the fastest part would go in the whole time
            distance = np.abs(line.derivative()(np.linspace(0.0, 1.0, 200))).max(axis=0)
        duration = point.duration
        if duration is None:
            unlimited = [
                column.name
                for column, d in zip(columns, distance, strict=True)
                if d > 0 and not math.isfinite(column.velocity_limit)
            ]
            if unlimited:
                problems.append(
                    f"points[{index}]: needs a `duration`: the robot states no velocity limit for "
                    f"{', '.join(unlimited)}"
                )
                continue
            limits = np.array([column.velocity_limit for column in columns])
            duration = _shortest_duration(waypoints, distance, limits)
        elif distance.any() and duration * waypoints.sample_rate < _MIN_PERIODS - 1e-9:
            problems.append(
                f"points[{index}].duration: {duration:g} s is too short for sample_rate "
                f"{waypoints.sample_rate:g} Hz; a move needs at least {_MIN_PERIODS} sample "
                f"periods, {_MIN_PERIODS / waypoints.sample_rate:g} s: raise one of the two"
            )
        begin, end = stops[index - 1], stops[index]
        moves.append(Move(moves[-1].departure, duration, begin, end, point.hold, line))
    return moves


def _shortest_duration(
    waypoints: WayPointFile, distance: FloatArray, velocity_limits: FloatArray
) -> float:
    """The T of the module's docstring, s."""
    if not distance.any():
        return 0.0
    peak = 15.0 / 8.0 if waypoints.profile == "quintic" else 1.0 / (1.0 - _ramp(waypoints))
    shortest = float(np.max(peak * distance / (waypoints.speed * velocity_limits), initial=0.0))
    if shortest > LONGEST_TIME:
        return shortest  # refused where the samples are made
    periods = math.ceil(shortest * waypoints.sample_rate - 1.0e-9)
    return max(periods, _MIN_PERIODS) / waypoints.sample_rate


def _sample_moves(
    moves: Sequence[Move], t: FloatArray, waypoints: WayPointFile, close: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    position = np.empty((t.size, moves[0].end.size))
    velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
    for index, move in enumerate(moves):
        is_last = index == len(moves) - 1
        next_start = 0 if index == 0 else _first_moving_sample(moves[index - 1], t, close)
        arrival = int(np.searchsorted(t, move.arrival - close))
        moving = slice(next_start, arrival)
        if move.duration > 0.0:
            s = np.clip((t[moving] - move.start) / move.duration, 0.0, 1.0)
            b, rate, curvature = (
                quintic(s) if waypoints.profile == "quintic" else trapezoidal(s, _ramp(waypoints))
            )
            rate, curvature = rate / move.duration, curvature / move.duration**2
            way = move.end - move.begin
            if move.line is not None:
                slope, bend = (move.line.derivative(k)(b) for k in (1, 2))
                position[moving], velocity[moving] = move.line(b), rate[:, None] * slope
                acceleration[moving] = curvature[:, None] * slope + rate[:, None] ** 2 * bend
            else:
                position[moving] = move.begin + np.outer(b, way)
                velocity[moving] = np.outer(rate, way)
                acceleration[moving] = np.outer(curvature, way)
        position[arrival : t.size if is_last else _first_moving_sample(move, t, close)] = move.end
    return position, velocity, acceleration


def _first_moving_sample(move: Move, t: FloatArray, close: float) -> int:
    """First sample of the next move; a hold's last instant still belongs to it."""
    return int(np.searchsorted(t, move.departure + (close if move.hold > 0.0 else -close)))
