"""Figures of measured efforts over the computed ones, a panel per drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import StateError
from pinfric.motions.log.effort_place import EFFORT_PLACES
from pinfric.motions.log.judged import JudgedLog, measured_interval
from pinfric.show.figure.efforts import dress, rest_spans, shade, thinned
from pinfric.show.figure.panel import sheet
from pinfric.show.figure.style import BAND, BLUE, PALE_RED, style
from pinfric.show.report.names import picture_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COMPUTED, _MEASURED = BLUE, PALE_RED
#: Letters of a drive's name.
_LETTERS = 60


def measured_figure(result: InverseResult, log: JudgedLog, trajectory: str = "") -> Figure:
    """Draw logged efforts over the computed ones at the same place.

    Args:
        result: of the log's motion, with times.
        log: of `judge_log`, with measured efforts.
        trajectory: its name, for the title.

    Raises:
        StateError: no times, or no measured effort.
    """
    if result.t is None or not log.measured:
        raise StateError("a figure of measured efforts needs a log that has them")
    with style():
        names, note = picture_names(list(log.measured), _LETTERS)
        title = f"{trajectory}: {EFFORT_PLACES[log.at]}{note}"
        figure = sheet(11.0, 1.5 * len(names) + 1.25, title)
        panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for axes, short, (name, compared) in zip(panels, names, log.measured.items(), strict=True):
            draw_measured(axes, result, log, name)
            i = result.actuator_names.index(name)
            title = f"{short}, {result.scene.drives[i].unit}: off by {compared.relative_error:.0%}"
            axes.set_title(title.replace("%", " %"))
            dress(axes, 5)
        panels[-1].set_xlabel("time (s)")
        labels = ["measured", "computed (a band where it sticks)"]
        figure.legend(panels[0].lines[:2], labels, ncols=2, loc="outside lower left")
    return figure


def draw_measured(
    axes: Axes,
    result: InverseResult,
    log: JudgedLog,
    drive: str,
    shift: float = 0.0,
    lag: float = 0.0,
    pieces: int = 2000,
) -> None:
    """Draw a drive's measured effort over the computed one: two lines, a band where it sticks.

    Args:
        result, log: as of `measured_figure`.
        shift: added to the times, s.
        lag: of the measured effort behind the motion, s; it is removed.
        pieces: see `thinned`.
    """
    i, t = result.actuator_names.index(drive), result.times + shift
    lower, upper = measured_interval(result, log.at)
    measured = log.reading.effort[drive]
    known = np.where(np.isfinite(measured), measured, 0.0)
    keep = thinned([lower[:, i], upper[:, i], known], pieces)
    shade(axes, rest_spans(result, i) + shift)
    axes.fill_between(t[keep], lower[keep, i], upper[keep, i], color=BAND, linewidth=0)
    axes.plot(t[keep] - lag, measured[keep], color=_MEASURED, linewidth=1.8, gid="measured")
    axes.plot(t[keep], upper[keep, i], color=_COMPUTED, linewidth=0.9, gid="computed")
    axes.plot(t[keep], lower[keep, i], color=_COMPUTED, linewidth=0.9)
