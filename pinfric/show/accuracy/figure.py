"""One picture of computing time against accuracy: work-precision, sampling, friction models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.accuracy.ladder import Rung
from pinfric.accuracy.precision import Run
from pinfric.accuracy.sampling import Sampled
from pinfric.accuracy.study import Accuracy
from pinfric.show.figure.style import BAND, BLUE, GREEN, GRID, INK, QUIET, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colour and mark of each method; the marks tell them apart in grey.
_STYLES = {
    "event": (BLUE, "o"),
    "timestepping": (RED, "s"),
    "regularized": (GREEN, "^"),
}
#: What is smaller is drawn here: rounding, and the decade below which nobody looks.
_FLOOR = 1e-13
#: The same of shares (%).
_FLOOR_SHARE = 1e-3


def accuracy_figure(found: Accuracy) -> Figure:
    """Draw a panel for each study, two in a row."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    name = Path(found.scene.source).stem
    panels: list[Callable[[Axes], None]] = []
    if found.runs:
        title = "simulation: error of q (rad or m)"
        panels.append(partial(_work, runs=found.runs, quantity="error", title=title))
    if any(run.stick_error > 0 for run in found.runs):
        title = "simulation: error of stick times (s)"
        panels.append(partial(_work, runs=found.runs, quantity="stick_error", title=title))
    panels.append(partial(_sampling, rows=found.sampling))
    panels.append(partial(_ladder, rungs=found.ladder))
    rows = -(-len(panels) // 2)
    layout = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12)
    figure = Figure(figsize=(12.0, 0.7 + 4.5 * rows), dpi=140, layout=layout)
    figure.suptitle(
        f"{name}: cost of accuracy",
        x=0.01,
        ha="left",
        fontsize=14,
        fontweight="bold",
        color=INK,
    )
    axes = figure.subplots(rows, 2, squeeze=False).ravel()
    for draw, one in zip(panels, axes, strict=False):
        draw(one)
        one.spines[["top", "right"]].set_visible(False)
        one.spines[["left", "bottom"]].set_color(QUIET)
        one.tick_params(which="both", colors=QUIET, labelsize=9)
    for unused in axes[len(panels) :]:
        unused.set_visible(False)
    return figure


def _head(axes: Axes, text: str, note: str = "", columns: int = 3) -> None:
    """Title, a note, and the legend between title and plot, where it hides no point.

    Args:
        axes: with everything drawn.
        text: the title.
        note: a line for what is not drawn.
        columns: of the legend.
    """
    handles, labels = axes.get_legend_handles_labels()
    lines = -(-len(labels) // columns)
    if labels:
        legend = axes.legend(
            handles,
            labels,
            frameon=False,
            fontsize=8.5,
            labelcolor=INK,
            ncols=columns,
            loc="lower left",
            bbox_to_anchor=(-0.012, 0.995),
            borderaxespad=0.0,
            columnspacing=1.4,
            handlelength=1.8,
        )
        legend.set_in_layout(False)  # a long one must not squeeze the plots
    axes.set_title(text, loc="left", fontsize=10.5, color=INK, pad=8.0 + 14.5 * lines)
    if note:
        axes.annotate(
            note,
            (1.0, 1.0),
            xytext=(0, -3),
            xycoords="axes fraction",
            va="top",
            ha="right",
            textcoords="offset points",
            fontsize=8.5,
            color=QUIET,
        )


def _plain_times(axes: Axes) -> None:
    """A logarithmic axis of times with few plain numbers: 5, 10, 20, 50."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_xlim()
    steps = (1.0, 2.0, 5.0) if high < 300 * low else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=steps, numticks=20))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _logarithmic(axes: Axes, xlabel: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(True, which="major", color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.set_xlabel(xlabel, color=QUIET, fontsize=9.5)


def _work(axes: Axes, runs: Sequence[Run], quantity: str, title: str) -> None:
    """Error against time, a line per method; what failed or has no such error is counted."""

    def of(run: Run) -> float:
        return float(getattr(run, quantity))

    lost = []
    for method in dict.fromkeys(run.method for run in runs):
        own = [run for run in runs if run.method == method]
        color, marker = _STYLES.get(method, (INK, "x"))
        good = [run for run in own if np.isfinite(of(run))]
        if len(good) < len(own):
            lost.append(f"{method} {len(own) - len(good)} of {len(own)}")
        line = [run for run in good if run.setting != "defaults"]
        x, y = _points(line, of)
        axes.plot(
            x,
            y,
            color=color,
            marker=marker,
            markersize=6.5,
            linewidth=1.8,
            markeredgecolor="white",
            markeredgewidth=0.8,
            label=method,
            zorder=3,
        )
        alone = [run for run in good if run.setting == "defaults"]
        if alone:
            x, y = _points(alone, of)
            axes.plot(
                x,
                y,
                linestyle="",
                marker=marker,
                markersize=8,
                markerfacecolor="white",
                markeredgecolor=color,
                markeredgewidth=1.8,
                label=f"{method}, defaults",
                zorder=4,
            )
    _logarithmic(axes, "wall time (ms)")
    _plain_times(axes)
    _head(axes, title, f"without a figure: {', '.join(lost)}" if lost else "")


def _points(runs: Sequence[Run], of: Callable[[Run], float]) -> tuple[list[float], list[float]]:
    return [1e3 * run.wall_s for run in runs], [max(of(run), _FLOOR) for run in runs]


def _sampling(axes: Axes, rows: Sequence[Sampled]) -> None:
    """Shares of stick time and peaks that are lost, against the rate of sampling."""
    quantities: tuple[tuple[str, str, Callable[[Sampled], float]], ...] = (
        (
            "stick time missed",
            RED,
            lambda r: 100 * r.missed_stick / r.stick if r.stick > 0 else float("nan"),
        ),
        ("error of peaks", BLUE, lambda r: 100 * r.peak_error),
    )
    for given, style in (("q, v, a", "-"), ("q", "--")):
        own = [row for row in rows if row.given == given and not row.problem]
        for label, color, share in quantities:
            shares = [share(row) for row in own]
            if not np.isfinite(shares).any():
                continue
            shares = [max(s, _FLOOR_SHARE) for s in shares]
            axes.plot(
                [row.rate for row in own],
                shares,
                style,
                color=color,
                marker="o",
                markersize=5,
                markeredgecolor="white",
                linewidth=1.6,
                label=f"{label} (given {given})",
            )
    _logarithmic(axes, "samples per second")
    axes.set_ylim(bottom=0.7 * _FLOOR_SHARE)
    _plain_times(axes)
    _head(
        axes,
        f"inverse dynamics: error with fewer samples (%; smallest shown {_FLOOR_SHARE:g})",
        columns=2,
    )


def _ladder(axes: Axes, rungs: Sequence[Rung]) -> None:
    """What each model misses of the whole, as bars; beside each its time per sample."""
    shown = [rung for rung in rungs if rung.on and not rung.problem]
    missing = [100 * rung.distance for rung in shown]
    places = np.arange(len(shown))[::-1]
    axes.barh(places, missing, height=0.62, color=BAND, edgecolor=BLUE, linewidth=0.8)
    largest = max(missing, default=0.0) or 1.0
    for place, rung, share in zip(places, shown, missing, strict=True):
        cost = f"{rung.us:.2f} us" if np.isfinite(rung.us) else "an estimate"
        text = f"{share:.1f} %   {cost}" if share >= 0.05 else f"nothing   {cost}"
        axes.text(share + 0.015 * largest, place, text, va="center", fontsize=9, color=INK)
    style: dict[str, Any] = {"fontsize": 9.5, "color": INK}
    axes.set_yticks(places, [rung.name for rung in shown], **style)
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(0.0, 1.35 * largest)
    axes.set_xlabel(
        "RMS difference from the full model (%), and time per sample", color=QUIET, fontsize=9.5
    )
    _head(axes, "inverse dynamics: models of friction")
