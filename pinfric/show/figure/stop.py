"""Figures of stops: the farthest stop of each axis over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pinfric.model.described import SPEED, unit_at
from pinfric.show.figure.panel import key_below, panel, sheet
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BLUE, GRID, INK, ORANGE, RED, style
from pinfric.show.report.names import picture_names
from pinfric.stops.study import StopResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Drives that the picture shows, those that go farthest first.
_MOST = 12


@draws(StopResult, "stop")
def stop_figure(result: StopResult) -> Figure:
    """Draw each drive's farthest stop; of more than 12 those that go farthest."""
    order = np.argsort([-axis.travel for axis in result.axes], kind="stable")[:_MOST]
    drawn = sorted(order.tolist())
    labels, _ = picture_names([result.axes[d].name for d in drawn], 40)
    with style():
        name = Path(result.scene.source).stem
        how = f"category {result.settings.category}: each axis in its farthest stop"
        figure = sheet(10.0, 1.6 * len(drawn) + 0.9, f"{name}, {how}")
        panels = figure.subplots(len(drawn), 2, squeeze=False)
        for row, d, label in zip(panels, drawn, labels, strict=True):
            _draw_speed(row[0], result, d)
            _draw_effort(row[1], result, d)
            row[0].set_title(label, color=INK, weight="bold")
        for axes in panels[-1]:
            axes.set_xlabel("time from the command, ms")
        figure.align_ylabels()
        key_below(figure)
    return figure


@draws(StopResult, "speed", "Speed in the farthest stop", one=True)
def speed_in_stop(result: StopResult, drive: int) -> Figure:
    """Draw the speed of a drive's joint in its farthest stop."""
    figure, axes = panel("time from the command, ms", "")
    _draw_speed(axes, result, drive)
    return figure


@draws(StopResult, "effort", "Effort of the gear at the joint in the farthest stop", one=True)
def effort_in_stop(result: StopResult, drive: int) -> Figure:
    """Draw the effort of a drive's gear in its farthest stop."""
    figure, axes = panel("time from the command, ms", "")
    _draw_effort(axes, result, drive)
    return figure


def _draw_speed(axes: Axes, result: StopResult, drive: int) -> None:
    """Draw the speed of a drive's joint, from the command on."""
    stop, motion = result.worst_motions[drive]
    reaction, cycle = result.settings.reaction_time, result.search.cycle
    before = np.linspace(0.0, reaction, 21)
    times = cycle.trajectory.t[stop.case.sample] + stop.case.speed * (before - reaction)
    rate = stop.case.speed * np.interp(times, cycle.trajectory.t, cycle.rate[:, drive])
    t = 1e3 * (reaction + motion.t)
    axes.plot(1e3 * before, rate, color=BLUE, linestyle=":", linewidth=1.4, label="reaction")
    axes.plot(t, motion.rate[:, drive], color=BLUE, linewidth=1.6, label="the axis")
    axes.set_ylabel(f"speed, {unit_at(SPEED, result.scene.drives[drive].unit)}")
    _mark_times(axes, result, drive)


def _draw_effort(axes: Axes, result: StopResult, drive: int) -> None:
    """Draw the effort of a drive's gear, from power-off on."""
    motion = result.worst_motions[drive][1]
    t = 1e3 * (result.settings.reaction_time + motion.t)
    axes.plot(t, motion.effort[:, drive], color=BLUE, linewidth=1.6)
    axes.set_ylabel(f"effort, {result.scene.drives[drive].unit}")
    _mark_times(axes, result, drive)


def _mark_times(axes: Axes, result: StopResult, drive: int) -> None:
    """Draw lines where power goes off and where the brake closes."""
    stop, motion = result.worst_motions[drive]
    off = result.settings.reaction_time + motion.power_off
    delay = result.search.machines.of(stop.case.kind).delay.get(result.axes[drive].name)
    axes.set_xlim(0.0, 1e3 * (stop.time + 0.1 * max(stop.time, 0.01)))
    axes.axhline(0.0, color=GRID, linewidth=0.8, zorder=0)
    axes.axvline(1e3 * off, color=ORANGE, linewidth=1.0, label="power goes off")
    if delay is not None:
        axes.axvline(1e3 * (off + delay), color=RED, linewidth=1.0, label="its brake holds")
