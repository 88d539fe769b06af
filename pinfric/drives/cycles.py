"""A drive judged over many cycles at once, as a sweep runs them.

A kernel reduces each cycle to the figures that the rows of `LIMITS` read (`Asked`); then each row
is judged once, of arrays over the cycles. A drive with a row that reads samples of a cycle is not
judged so (`reads_samples`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pinfric.drives.bearing import KINDS, BearingLoad, GuideLoad
from pinfric.drives.catalog import REFERENCE_TEMPERATURE
from pinfric.drives.criterion import STEPS, Status
from pinfric.drives.demand import average_effort
from pinfric.drives.drivetrain import Candidate, amplifier_torque
from pinfric.drives.limit import (
    Candidates,
    Figures,
    JointCase,
    Limit,
    idle,
    number,
)
from pinfric.drives.limits import LIMITS, OWN_LIMITS
from pinfric.drives.overload import heat_lag, longest_run, settled_root
from pinfric.drives.policy import Conditions
from pinfric.drives.reading import read_drive
from pinfric.drives.thermal import COPPER, mean_temperature, winding_rises
from pinfric.kernels.compiled import kernel


class Asked(NamedTuple):
    """What one cycle asks of a drive, beside its peaks, RMS and largest speed; NaN: not known.

    Attributes:
        mean_speed, mean_cubic: as of `GearDemand`.
        radial, axial, moment, radial_mean, axial_mean, moment_mean: as of `BearingLoad`.
        across, pitch, roll: as of `GuideLoad`.
        standing ... hot: as of `MotorFigures`; `peak_temperature` is infinite of a run-away.
        overdriven: longest time above the amplifier's continuous current, s.
        voltage: the largest that the motor takes, V.
    """

    mean_speed: float
    mean_cubic: float
    radial: float
    axial: float
    moment: float
    radial_mean: float
    axial_mean: float
    moment_mean: float
    across: float
    pitch: float
    roll: float
    standing: float
    short_term: float
    overloaded_standstill: float
    overdriven: float
    peak_temperature: float
    mean_temperature: float
    hot: float
    voltage: float


class Rated(NamedTuple):
    """Drives on trial, as `write_asked` reads them: (k, ...) each; NaN: not known.

    Attributes:
        column: of the drive. carried: where force and moment of its joint are stored, in axes of
            which the last is the joint's; -1: what carries it is not judged. linear: it slides.
        ratio: motor turns per joint turn. scale: from the motor's shaft to the rated one.
        exponent: of its bearing's mean loads; 0: its life is not judged.
        stall, overdriven: torques above which it is overloaded at rest, and its amplifier, N m.
        lag, part: (k, 2) time constants of its heat, s, and each one's part.
        constant, resistance: N m/A and ohm. nodes: (k, 4) as of `winding_rises`.
        turning: W s/rad, `no_load_heat`. ambient: deg C.
        hottest: resistance at the permissible temperature over that at 25 C.
        per_torque, per_speed: V/(N m) and V s/rad of the speed-torque line.
    """

    column: np.ndarray
    carried: np.ndarray
    linear: np.ndarray
    ratio: np.ndarray
    scale: np.ndarray
    exponent: np.ndarray
    stall: np.ndarray
    overdriven: np.ndarray
    lag: np.ndarray
    part: np.ndarray
    constant: np.ndarray
    resistance: np.ndarray
    nodes: np.ndarray
    turning: np.ndarray
    ambient: np.ndarray
    hottest: np.ndarray
    per_torque: np.ndarray
    per_speed: np.ndarray

    @classmethod
    def of(
        cls, drives: list[tuple[int, Candidate]], carried: list[int], conditions: Conditions
    ) -> Rated:
        """Return the table of candidates at drives, which are columns; `carried`: of each."""
        rows = [_rated(*drive, conditions) for drive in drives]
        table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        return cls(carried=np.array(carried), **table)


def _rated(column: int, candidate: Candidate, conditions: Conditions) -> dict[str, Any]:
    ratings, bearing = candidate.ratings, candidate.bearing
    thermal = ratings.thermal_at(conditions)
    lag = heat_lag(thermal, ratings.thermal_time, conditions)
    k, r = ratings.torque_constant, ratings.resistance
    per_torque, per_speed = np.nan, np.nan
    if k is not None and r is not None:
        per_torque, per_speed = r / k, k
    elif ratings.has_line:
        assert ratings.nominal_voltage and ratings.stall_torque and ratings.no_load_speed  # noqa: PT018
        per_torque = ratings.nominal_voltage / ratings.stall_torque
        per_speed = ratings.nominal_voltage / ratings.no_load_speed
    nodes = [np.nan] * 4
    if thermal is not None:
        names = "winding_housing", "housing_ambient", "winding_time", "housing_time"
        nodes = [number(getattr(thermal, name)) for name in names]
    judged = bearing is not None and conditions.life is not None
    return {
        "column": column,
        "linear": candidate.linear,
        "ratio": float(candidate.ratio),
        "scale": float(candidate.ratio) if candidate.at_output else 1.0,
        "exponent": KINDS[bearing.kind].exponent if bearing and judged else 0.0,
        "stall": number(ratings.stall_at(conditions)),
        "overdriven": number(amplifier_torque(candidate, "continuous_current")[0]),
        "lag": [*lag.times, lag.times[0]][:2],
        "part": [*lag.parts, 0.0][:2],
        "constant": number(k),
        "resistance": number(r),
        "nodes": nodes,
        "turning": float(ratings.no_load_heat),
        "ambient": float(conditions.ambient),
        "hottest": ratings.hottest(conditions),
        "per_torque": float(per_torque),
        "per_speed": float(per_speed),
    }


@kernel
def write_asked(
    rated: Rated,
    k: int,
    t: np.ndarray,
    velocity: np.ndarray,
    effort: np.ndarray,
    torque: np.ndarray,
    carried: np.ndarray,
    stick_velocity: float,
    asked: np.ndarray,
) -> None:
    """Write what a cycle that repeats asks of one drive, as `Asked`.

    Args:
        rated, k: the drives, and which of them.
        t: (T,) s. velocity: (T,) of the joint.
        effort, torque: (2, T) their ends: at the joint, and at the motor's shaft.
        carried: (T, 6) force and moment of the joint in axes of which the last is its own; (0, 6):
            not known.
        asked: (number of figures,), overwritten.
    """
    n, scale = t.size, rated.scale[k]
    starts, counts = np.array([0, n]), np.ones(1, dtype=np.int64)
    worst, pull, speed = np.empty((3, n))
    standing, always, still = np.empty(n, dtype=np.bool_), np.ones(n, dtype=np.bool_), False
    slow, turned, holding = False, 0.0, np.nan
    for i in range(n):
        low, high = effort[0, i], effort[1, i]
        worst[i] = high if abs(high) >= abs(low) else low
        low, high = torque[0, i] * scale, torque[1, i] * scale
        pull[i] = abs(high if abs(high) >= abs(low) else low)
        speed[i] = velocity[i] * (rated.ratio[k] / scale)
        still = abs(velocity[i]) <= stick_velocity
        standing[i] = still and slow
        if standing[i]:
            standing[i - 1] = True
        slow = still
        if i > 0:
            turned += (t[i] - t[i - 1]) * (abs(velocity[i]) + abs(velocity[i - 1]))
    for i in range(n):
        if standing[i]:
            holding = pull[i] if holding != holding else max(holding, pull[i])
    mean_speed = 0.5 * turned / (t[n - 1] - t[0])
    asked[0], asked[1] = mean_speed, average_effort(t, worst, velocity, 3.0)
    _write_carried(rated, k, t, velocity, worst, carried, asked[2:11])
    lag, stall, most = rated.lag[k], rated.stall[k], rated.overdriven[k]
    asked[11], asked[12] = holding, settled_root(t, pull, lag, rated.part[k], starts, counts)
    asked[13] = longest_run(t, pull, stall, standing) if stall == stall else np.nan
    asked[14] = longest_run(t, pull, most, always) if most == most else np.nan
    peak, mean, settled = np.nan, np.nan, np.nan
    nodes, resistance = rated.nodes[k], rated.resistance[k]
    if nodes[0] == nodes[0] and rated.constant[k] * resistance == rated.constant[k] * resistance:
        current, ambient = pull / rated.constant[k], rated.ambient[k]
        heat = rated.turning[k] * np.abs(speed)
        at_rate = rated.turning[k] * mean_speed * abs(rated.ratio[k] / scale)
        mean = mean_temperature(t, current, resistance, nodes, ambient, at_rate)
        settled = mean
        if nodes[2] == nodes[2] and nodes[3] == nodes[3]:
            rise, runaway = winding_rises(
                t, current, heat, resistance, nodes, ambient, starts, counts
            )
            peak = ambient + rise[:, 0].max()
            settled = mean if runaway else peak
    hot = rated.hottest[k]
    if np.isfinite(settled):
        hot = 1.0 + COPPER * (settled - REFERENCE_TEMPERATURE)
    asked[15], asked[16], asked[17], asked[18] = peak, mean, hot, np.nan
    if rated.per_torque[k] == rated.per_torque[k]:
        voltage = 0.0
        for i in range(n):
            back = rated.per_speed[k] * speed[i]
            for end in range(2):
                taken = hot * rated.per_torque[k] * (torque[end, i] * scale) + back
                voltage = max(voltage, abs(taken))
        asked[18] = voltage


@kernel
def _write_carried(
    rated: Rated,
    k: int,
    t: np.ndarray,
    velocity: np.ndarray,
    worst: np.ndarray,
    carried: np.ndarray,
    found: np.ndarray,
) -> None:
    """Write the loads of `Asked` on bearing and guide, (9,)."""
    found[:] = np.nan
    if carried.shape[0] == 0 and not rated.linear[k]:
        return
    loads, exponent = np.zeros((3, t.size)), rated.exponent[k]
    if rated.linear[k]:  # of a screw's nut: the effort along it
        loads[1] = np.abs(worst)
        if carried.shape[0] > 0:
            found[6:] = 0.0
            for i in range(t.size):
                x = carried[i]
                found[6] = max(found[6], np.hypot(x[0], x[1]))
                found[7] = max(found[7], np.hypot(x[3], x[4]))
                found[8] = max(found[8], abs(x[5]))
    else:
        for i in range(t.size):
            x = carried[i]
            loads[0, i], loads[1, i] = np.sqrt(x[0] * x[0] + x[1] * x[1]), abs(x[2])
            loads[2, i] = np.sqrt(x[3] * x[3] + x[4] * x[4])
    for j in range(3):
        found[j] = loads[j].max()
        if exponent > 0.0:
            found[3 + j] = average_effort(t, loads[j], velocity, exponent)


def reads_samples(candidate: Candidate, conditions: Conditions, hand: bool) -> bool:
    """Return whether a row of a drive reads samples of a cycle, or may.

    Rows of `add_limit` may.
    """
    probe: Any = _Samples()
    d = read_drive(candidate, None, idle(conditions, hand))
    some = replace(d, case=d.case._replace(cycle=probe))
    try:
        for limit in LIMITS:
            if limit.concerns(some) and limit.verdict is None:
                limit.required(some), limit.available(some)
    except _ReadsSamplesError:
        return True
    return len(LIMITS) > OWN_LIMITS


class _ReadsSamplesError(Exception):
    """A row reads samples."""


class _Samples:
    """Stands for samples that are not there."""

    def __getattr__(self, name: str) -> Any:
        raise _ReadsSamplesError(name)


def judge_cycles(
    candidate: Candidate, case: JointCase, torque: np.ndarray, asked: np.ndarray
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the least margin of a drive over each of n cycles, and each criterion's margins.

    As `criteria` and `least_margin` judge one cycle; (n,) each. NaN: not checked. Infinite: not
    required.

    Args:
        case: the joint. Of its demand peak and speed are arrays (n,), as its load inertia is, and
            of what `asked` holds there is nothing; no cycle.
        torque: (2, n) peak and RMS at the motor's shaft, N m.
        asked: (n, number of figures) of `write_asked`.
    """
    found = Asked(*asked.T)
    scale = candidate.ratio if candidate.at_output else 1.0
    bearing = guide = None
    if not np.isnan(found.axial).any():
        loads = found.radial, found.axial, found.moment
        means = found.radial_mean, found.axial_mean, found.moment_mean
        exponent = KINDS["ball" if candidate.bearing is None else candidate.bearing.kind].exponent
        bearing = BearingLoad(*loads, {exponent: means}, found.mean_speed)
    if not np.isnan(found.across).any():
        guide = GuideLoad(found.across, found.pitch, found.roll)
    own: dict[str, Any] = {"mean_speed": found.mean_speed, "mean_cubic": found.mean_cubic}
    demand = replace(case.demand, bearing=bearing, guide=guide, **own)
    nothing = read_drive(candidate, None, case)
    motor = {name: getattr(found, name) for name in Asked._fields if hasattr(nothing.asked, name)}
    motor |= dict(zip(("peak", "rms"), scale * torque, strict=True))
    motor["mean_speed"] = found.mean_speed * (candidate.ratio / scale)
    share = number(candidate.ratings.derating(case.conditions)[0])
    d = replace(
        nothing,
        case=case._replace(demand=demand),
        asked=Figures(**vars(nothing.asked) | motor),
        heat=share * candidate.ratings.continuous_over(motor["mean_speed"]),
    )
    least, margins = np.full(len(asked), np.inf), dict[str, np.ndarray]()
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for limit in LIMITS:
            if limit.concerns(d):
                margin = np.broadcast_to(_margins(limit, d), least.shape)
                margins[limit.name] = margin
                counts = np.isfinite(margin) & (limit.verdict is None)
                if limit.name in STEPS:
                    counts &= margin < 0
                least = np.where(counts, np.minimum(least, margin), least)
    return np.where(np.isinf(least), 0.0, least), margins


def _margins(limit: Limit, d: Candidates) -> Any:
    """The margins of one row; NaN: not checked; infinite: not required."""
    if limit.verdict is not None:
        one = limit.verdict(d)
        never = np.inf if one.status == Status.NOT_REQUIRED else np.nan
        return never if one.margin is None else one.margin
    margin = limit.margin(d)
    if limit.endless:
        margin = np.where(limit.available(d) == np.inf, 1.0, margin)
    if limit.optional:
        margin = np.where(np.isnan(limit.required(d)), np.inf, margin)
    return margin
