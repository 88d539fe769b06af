"""Figures of an identification: measured efforts over the found scene's, and residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinfric.identification.identify import Identified, beside_measured, left_over, running_mean
from pinfric.model.described import SPEED, unit_at
from pinfric.show.figure.measured import draw_measured, measured_figure
from pinfric.show.figure.panel import panel
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BLUE, RED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Pieces a log is cut into, each kept with its extremes; dots of a cloud (pages below 1.5 MB).
_PIECES, _DOTS = 500, 400


@draws(Identified, "measured")
def identified_figure(identified: Identified, log: int = 0) -> Figure:
    """Draw the measured efforts of a log, by its number, over those of the scene found."""
    return measured_figure(*beside_measured(identified, log), identified.recordings[log].name)


@draws(
    Identified,
    "time",
    "Measured effort and the identified scene; shaded: possible efforts at rest",
    one=True,
)
def effort_over_logs(identified: Identified, drive: int) -> Figure:
    """Draw a joint's measured effort over the identified scene's, rest intervals as bands.

    Logs follow one another; measured efforts are moved back by the delay.
    """
    unit, start = identified.scene.drives[drive].unit, 0.0
    figure, axes = panel("time, s", f"effort, {unit}", 10.0, 2.9)
    for number in range(len(identified.recordings)):
        result, log = beside_measured(identified, number)
        shift, name = start - float(result.times[0]), identified.scene.joint_names[drive]
        draw_measured(axes, result, log, name, shift, identified.delay, _PIECES)
        start += float(np.ptp(result.times)) + 1.0
    for line, label in zip(axes.lines, ("measured", "identified scene"), strict=False):
        line.set_label(label)  # of the first log
    return figure


@draws(Identified, "velocity", "Residual over velocity", one=True)
def residual_over_velocity(identified: Identified, drive: int) -> Figure:
    """Draw a joint's residual over its velocity, where a missing law shows."""
    velocity, _, off = left_over(identified, drive)
    unit = unit_at(SPEED, identified.scene.drives[drive].unit)
    return _cloud(identified, drive, velocity, off, f"velocity, {unit}")


@draws(Identified, "load", "Residual over load", one=True)
def residual_over_load(identified: Identified, drive: int) -> Figure:
    """Draw a joint's residual over its effort without friction, where a missing law shows."""
    _, load, off = left_over(identified, drive)
    unit = identified.scene.drives[drive].unit
    return _cloud(identified, drive, load, off, f"effort without friction, {unit}")


def _cloud(
    identified: Identified, drive: int, x: np.ndarray, off: np.ndarray, title: str
) -> Figure:
    figure, axes = panel(title, f"measured - fitted, {identified.scene.drives[drive].unit}")
    few = np.unique(np.linspace(0, off.size - 1, min(_DOTS, off.size)).astype(int))
    axes.plot(x[few], off[few], ".", color=BLUE, alpha=0.5, markersize=3, markeredgewidth=0)
    axes.plot(*running_mean(x, off), color=RED, linewidth=1.8, label="mean")
    return figure
