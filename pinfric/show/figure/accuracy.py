"""Picture of computing time against accuracy of the methods of simulation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pinfric.accuracy.study import Accuracy, TimedRun
from pinfric.show.figure.panel import key_below, sheet
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BLUE, GREEN, GRID, INK, QUIET, RED, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colour and mark of each method; the marks tell them apart in grey.
_STYLES = {"event": (BLUE, "o"), "timestepping": (RED, "s"), "regularized": (GREEN, "^")}
#: What is smaller is drawn here: rounding, and the decade below which nobody looks.
_FLOOR = 1e-13


@draws(Accuracy, "accuracy")
def accuracy_figure(accuracy: Accuracy) -> Figure:
    """Draw error against time, a line per method: of q, and of stick times if any joint sticks."""
    panels = {"error": "error of q (rad or m)", "stick_error": "error of stick times (s)"}
    if not any(run.stick_error > 0 for run in accuracy.runs):
        del panels["stick_error"]
    with style():
        name = Path(accuracy.scene.source).stem
        figure = sheet(6.0 * len(panels), 5.2, f"{name}: cost of accuracy in simulation")
        for axes, (quantity, text) in zip(
            figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True
        ):
            lost = _draw(axes, accuracy.runs, quantity)
            axes.set_xlabel("wall time (ms)")
            said = f"{text}; without a figure: {', '.join(lost)}" if lost else text
            axes.set_title(said, color=INK)
        key_below(figure)
    return figure


def _draw(axes: Axes, runs: Sequence[TimedRun], quantity: str) -> list[str]:
    """Draw one panel; return how often each method lacks this error."""
    from matplotlib.ticker import LogLocator

    lost = []
    for method in dict.fromkeys(run.method for run in runs):
        own = [run for run in runs if run.method == method]
        color, marker = _STYLES.get(method, (INK, "x"))
        good = [run for run in own if np.isfinite(getattr(run, quantity))]
        if len(good) < len(own):
            lost.append(f"{method} {len(own) - len(good)} of {len(own)}")
        for default, line, inside in ((False, "-", color), (True, "", "white")):
            drawn = [run for run in good if (run.setting == "defaults") == default]
            if drawn:
                axes.plot(
                    [1e3 * run.wall_s for run in drawn],
                    [max(getattr(run, quantity), _FLOOR) for run in drawn],
                    linestyle=line,
                    color=color,
                    marker=marker,
                    markersize=7,
                    markerfacecolor=inside,
                    label=f"{method}, defaults" if default else method,
                )
    axes.set(xscale="log", yscale="log")
    axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.grid(True, which="major", color=GRID, linewidth=0.8)
    axes.tick_params(which="both", colors=QUIET)
    return lost
