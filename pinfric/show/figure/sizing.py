"""Figures of a sizing: the cycle's efforts, each drive in its limits, the bus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.drives.drivetrain import Candidate
from pinfric.drives.policy import Conditions
from pinfric.dynamics.inverse.result import runs
from pinfric.motions.summary import ends_by_magnitude
from pinfric.show.figure.efforts import effort_figure, thinned
from pinfric.show.figure.panel import panel
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BAND, BLUE, GREEN, INK, ORANGE, QUIET, RED
from pinfric.sizing.report import JointSizing, SizingReport

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Pieces a long motion is cut into, each kept with its extremes.
_PIECES = 400
#: The envelope is cut where it would make the cycle smaller than this part of the picture.
_MOST_SHRUNK = 8.0


@draws(SizingReport, "efforts")
def cycle_figure(report: SizingReport, **options: Any) -> Figure:
    """Draw the cycle's efforts with the chosen drives' masses; options of `effort_figure`."""
    return effort_figure(report.result, **options)


@draws(SizingReport, "envelope", "The cycle in the motor's torque-speed limits", one=True)
def torque_speed(report: SizingReport, drive: int) -> Figure | None:
    """Draw the cycle in the motor's envelope: torque over speed, intervals at rest as bars."""
    motor, taken = report.joints[drive].motor, report.joints[drive].installed
    if motor is None or taken is None:
        return None
    ratings = taken.candidate.ratings
    lower, upper, speed = motor.torque_lower, motor.torque_upper, motor.speed
    worst = ends_by_magnitude(lower, upper)[0]
    most = 1.05 * report.conditions.peak_factor * float(np.abs(worst).max())
    top = 1.15 * max(most, ratings.continuous_torque or 0.0, 0.957 * (ratings.peak_torque or 0.0))
    top = min(top, _MOST_SHRUNK * most) if most > 0 else top
    # The speed axis ends where the envelope does, unless the cycle uses little of it
    voltage = taken.candidate.voltage(report.conditions)
    used = float(np.abs(speed).max())
    ends = [1.25 * used]
    limit = ratings.max_speed or ratings.no_load_speed or ratings.rated_speed
    if limit is not None:
        ends.append(1.05 * limit)
    if ratings.no_load_speed is not None and ratings.nominal_voltage is not None:
        ends.append(1.05 * ratings.no_load_speed * voltage / ratings.nominal_voltage)
    elif ratings.torque_constant is not None:
        ends.append(1.05 * voltage / ratings.torque_constant)
    reach = max(ends) or 1.0
    reach = min(reach, _MOST_SHRUNK * used) if used > 0 else reach
    shaft = "output" if taken.candidate.at_output else "motor"
    effort, rate = taken.candidate.units
    kind = "force" if effort == "N" else "torque"
    figure, axes = panel(f"{shaft} speed, {rate}", f"{shaft} {kind}, {effort}")
    _draw_envelope(axes, taken.candidate, report.conditions, motor.figures.hot, (reach, top))
    keep = thinned([lower, upper, speed], _PIECES // 4)
    wide = keep[(upper - lower)[keep] > 1e-9 * max(most, 1e-12)]
    axes.plot(speed[keep], worst[keep], color=BAND, linewidth=0.8)
    axes.plot(speed[keep], worst[keep], ".", color=BLUE, markersize=2.5, label="cycle")
    axes.vlines(
        speed[wide], lower[wide], upper[wide], color=ORANGE, linewidth=3, label="interval at rest"
    )
    axes.set(xlim=(-reach, reach), ylim=(-top, top))
    return figure


@draws(SizingReport, "effort", "Effort at the joint over the cycle", one=True)
def effort_over_time(report: SizingReport, drive: int) -> Figure:
    """Draw the effort interval over the cycle, and the effort without friction; holds shaded."""
    joint = report.joints[drive]
    cycle = joint.cycle
    figure, axes = panel("time, s", f"effort at the joint, {joint.demand.unit}")
    series = [cycle.effort_lower, cycle.effort_upper, cycle.effort_frictionless]
    keep = _drawn(joint, series)
    t, (lower, upper, bare) = cycle.t[keep], (x[keep] for x in series)
    for a, b in runs(cycle.holding):
        axes.axvspan(cycle.t[a], cycle.t[b], color=ORANGE, alpha=0.16, linewidth=0)
    axes.fill_between(t, lower, upper, color=BAND, linewidth=0)
    axes.plot(t, lower, color=BLUE, linewidth=1.2)
    axes.plot(t, upper, color=BLUE, linewidth=1.2, label="effort interval")
    axes.plot(t, bare, ":", color=QUIET, linewidth=1.0, label="without friction")
    return figure


@draws(SizingReport, "heat", "Winding temperature, settled cycle", one=True)
def temperature(report: SizingReport, drive: int) -> Figure | None:
    """Draw winding and housing over the settled cycle; None if they are unknown."""
    joint = report.joints[drive]
    motor, taken = joint.motor, joint.installed
    if motor is None or taken is None or motor.winding is None or motor.winding.runaway:
        return None
    winding, housing = motor.winding.winding, motor.winding.housing
    keep = _drawn(joint, [winding, housing])
    figure, axes = panel("time, s", "temperature, °C")
    axes.plot(joint.cycle.t[keep], winding[keep], color=RED, label="winding")
    axes.plot(joint.cycle.t[keep], housing[keep], color=ORANGE, label="housing")
    thermal = taken.candidate.ratings.thermal
    limit = report.conditions.max_winding
    if thermal is not None and thermal.max_winding is not None:
        limit = thermal.max_winding
    if limit is not None:
        axes.axhline(limit, linestyle="--", color=INK, linewidth=1, label="limit")
    axes.axhline(
        report.conditions.ambient, linestyle=":", color=QUIET, linewidth=1, label="ambient"
    )
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    return figure


@draws(SizingReport, "bus", "Power from the bus")
def power_over_time(report: SizingReport) -> Figure | None:
    """Draw the power of all drives from their bus, below 0 fed back; None without a catalogue."""
    if report.catalog is None:
        return None
    power, t = report.bus.power, report.result.times
    keep = thinned([power], _PIECES)
    keep = keep[report.duty.powered(len(t))[keep]]
    figure, axes = panel("time, s", "power of all drives, W", height=1.9)
    axes.fill_between(t[keep], power[keep], color=BAND, linewidth=0)
    axes.plot(t[keep], power[keep], color=BLUE, linewidth=1.2, label="power")
    axes.axhline(
        report.bus.mean, linestyle="--", color=INK, linewidth=1, label="mean of the period"
    )
    return figure


def _drawn(joint: JointSizing, series: Sequence[np.ndarray]) -> np.ndarray:
    """Select the samples to draw over time, without the period's time off."""
    keep = thinned(list(series), _PIECES)
    return keep[joint.cycle.powered[keep]]


def _draw_envelope(
    axes: Axes, drive: Candidate, conditions: Conditions, hot: float, ends: tuple[float, float]
) -> None:
    """Draw the motor's limits: the bus voltage's line cut by peak torque, and continuous torque."""
    ratings, voltage, (reach, top) = drive.ratings, drive.voltage(conditions), ends
    fastest = ratings.max_speed or ratings.no_load_speed or ratings.rated_speed
    end = reach if fastest is None else min(fastest, reach)
    speed = np.linspace(-end, end, 201)
    limit = ratings.torque_limit(speed, voltage, hot)
    if np.isfinite(limit).all():
        x = np.concatenate([speed, speed[::-1], speed[:1]])
        y = np.clip(np.concatenate([limit, -limit, limit[:1]]), -2 * top, 2 * top)
        name = "envelope" if ratings.has_line else "envelope (no line known)"
        axes.plot(x, y, color=GREEN, linewidth=1, label=name)
        axes.fill(x, y, color=GREEN, alpha=0.1, linewidth=0)
    continuous, _ = ratings.continuous_at(conditions)
    at = np.array([-reach, reach])
    over = None if continuous is None else np.full(2, continuous)
    if ratings.continuous_curve is not None and continuous is not None:
        share = continuous / ratings.continuous_over(np.zeros(1))[0]  # of a warm place
        at = np.linspace(-reach, reach, 201)
        over = share * ratings.continuous_over(at)
    peak = None if ratings.peak_torque is None else np.full(2, ratings.peak_torque)
    for name, x, torque, dash in (
        ("continuous torque", at, over, "--"),
        ("peak torque", at[[0, -1]], peak, ":"),
    ):
        if torque is not None and (torque <= 1.3 * top).any():
            axes.plot(x, torque, dash, color=INK, linewidth=1, label=name)
            axes.plot(x, -torque, dash, color=INK, linewidth=1)
