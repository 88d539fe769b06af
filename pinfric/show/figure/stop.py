"""Figure of stops: the worst stop of each axis over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pinfric.model.described import SPEED, unit_at
from pinfric.show.figure.panel import key_below, panel, sheet
from pinfric.show.figure.style import BLUE, GRID, INK, ORANGE, RED, style
from pinfric.show.report.names import picture_names
from pinfric.stops.study import StopResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Drives that the picture shows, those that go farthest first.
_MOST = 12


def stop_figure(result: StopResult) -> Figure:
    """Draw each drive's farthest stop (`draw_stop`); of more than 12 those that go farthest."""
    order = np.argsort([-axis.travel for axis in result.axes], kind="stable")[:_MOST]
    drawn = sorted(order.tolist())
    labels, _ = picture_names([result.axes[d].name for d in drawn], 40)
    with style():
        name = Path(result.scene.source).stem
        how = f"category {result.settings.category}: each axis in its farthest stop"
        figure = sheet(10.0, 1.6 * len(drawn) + 0.9, f"{name}, {how}")
        panels = figure.subplots(len(drawn), 2, squeeze=False)
        for row, d, label in zip(panels, drawn, labels, strict=True):
            draw_stop(row[0], row[1], result, d)
            row[0].set_title(label, color=INK, weight="bold")
        for axes in panels[-1]:
            axes.set_xlabel("time from the command, ms")
        figure.align_ylabels()
        key_below(figure)
    return figure


def axis_pictures(result: StopResult, drive: int) -> tuple[Figure, Figure]:
    """Return one drive's two pictures of `draw_stop`."""
    unit = result.scene.drives[drive].unit
    speed, upper = panel("time from the command, ms", f"speed, {unit_at(SPEED, unit)}")
    effort, lower = panel("time from the command, ms", f"effort of the gear, {unit}")
    draw_stop(upper, lower, result, drive)
    return speed, effort


def draw_stop(upper: Axes, lower: Axes, result: StopResult, drive: int) -> None:
    """Draw a drive's farthest stop: its joint's speed above, its gear's effort below.

    Args:
        upper, lower: axes.
        result: the stops.
        drive: its number.
    """
    stop, motion = result.worst_motions[drive]
    unit = result.scene.drives[drive].unit
    reaction = result.settings.reaction_time
    t = 1e3 * (reaction + motion.t)
    end = 1e3 * (stop.time + 0.1 * max(stop.time, 0.01))
    before = np.linspace(0.0, reaction, 21)
    cycle = result.search.cycle
    times = cycle.trajectory.t[stop.case.sample] + stop.case.speed * (before - reaction)
    rate = stop.case.speed * np.interp(times, cycle.trajectory.t, cycle.rate[:, drive])
    upper.plot(1e3 * before, rate, color=BLUE, linestyle=":", linewidth=1.4, label="reaction")
    upper.plot(t, motion.rate[:, drive], color=BLUE, linewidth=1.6, label="the axis")
    lower.plot(t, motion.effort[:, drive], color=BLUE, linewidth=1.6)
    for axes, label in ((upper, f"speed, {unit_at(SPEED, unit)}"), (lower, f"effort, {unit}")):
        axes.set_xlim(0.0, end)
        axes.set_ylabel(label)
        axes.axhline(0.0, color=GRID, linewidth=0.8, zorder=0)
        # Lines where power goes off and where the brake closes
        off = reaction + motion.power_off
        axes.axvline(1e3 * off, color=ORANGE, linewidth=1.0, label="power goes off")
        delay = result.search.machines.of(stop.case.kind).delay.get(result.axes[drive].name)
        if delay is not None:
            axes.axvline(1e3 * (off + delay), color=RED, linewidth=1.0, label="its brake holds")
