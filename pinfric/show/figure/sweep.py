"""Figure of a sweep: spread of peak and RMS, motors that suffice, influential parameters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.show.figure.efforts import largest
from pinfric.show.figure.panel import sheet
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BLUE, GRID, INK, ORANGE, QUIET, RED, style
from pinfric.show.report.names import least_room, picture_names, shortened
from pinfric.show.report.sweep import measure, own, percent, shaft
from pinfric.show.report.values import digits
from pinfric.sweeps.result import SweepResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BLUE, _BEYOND, _RATING = "#5FA8D3", ORANGE, "#B23A00"
_UP, _DOWN, _NOISE = BLUE, RED, GRID
_BINS = 40
#: Drives drawn, and letters of their names.
_MOST, _LETTERS = 16, 24
#: Parameters drawn per drive.
_DRAWN = 3
#: Inches: of one drive, and of what stands above and below all of them.
_ROW, _REST = 1.15, 1.5
#: Part of a histogram's width that a percentile's label takes.
_LABEL = 0.16
#: A rating beyond this part of the samples' range would squeeze them: it is named, not drawn.
_FARTHEST = 1.2


@draws(SweepResult, "sweep")
def sweep_figure(result: SweepResult) -> Figure:
    """Draw a row for every drive: distributions of peak and RMS, and influential parameters.

    Of more than 16 drives those with the largest median peaks of their unit. Ticks below a
    histogram are percentiles; what lies beyond a motor's rating is orange. The bars on the right
    are rank correlations with the RMS (in Sobol's design: shares of its variance); bars shorter
    than the grey band are not significant.

    Args:
        result: with at least one sample that has a solution.
    """
    names, where = result.rated, shaft(result)
    units = result.units if names == ("peak", "rms") else result.motor_units
    same = f", {units[0]}" if len(set(units)) == 1 else ""
    peaks = np.median(result.figure(names[0])[result.solved], axis=0)
    drawn, others = largest(peaks.tolist(), units, _MOST)
    labels, note = picture_names(result.actuator_names, _LETTERS)
    count = len(drawn)
    with style():
        solved = np.count_nonzero(result.solved)
        lost = f" ({result.samples - solved} without a solution)" * bool(solved < result.samples)
        title = f"{Path(result.scene).stem} · {Path(result.trajectory).name} · {result.samples} "
        figure = sheet(11.0, _ROW * count + _REST, f"{title}samples{lost}{others}{note}")
        panels = figure.subplots(count, 3, squeeze=False, width_ratios=(1, 1, 0.8))
        strength = result.influences(names[1])
        for i, row in zip(drawn, panels, strict=True):
            for axes, name in zip(row[:2], names, strict=True):
                _spread(axes, result, i, name)
            _drivers(row[2], result, i, strength[:, i], bottom=i == drawn[-1])
            text = labels[i] + ("" if same else f"\n{units[i]}")
            row[0].set_ylabel(
                text, rotation=0, ha="right", va="center", fontweight="bold", color=INK, labelpad=8
            )
        titles = f"peak{where}{same}", f"RMS{where}{same}", f"RMS: {measure(result)}"
        for axes, text in zip(panels[0], titles, strict=True):
            axes.set_title(text, fontsize=10, color=INK, pad=12)
    return figure


def _spread(axes: Axes, result: SweepResult, i: int, name: str) -> None:
    """Draw a histogram over the samples, with percentiles and a motor's rating if on trial."""
    values = result.figure(name)[result.solved, i]
    trial = next((t for t in result.trials if t.actuator == i), None)
    rating, kind = None, "peak" if name.endswith("peak") else "continuous"
    if trial is not None:
        rating = trial.peak_torque if kind == "peak" else trial.continuous_torque
    low, high = float(values.min()), float(values.max())
    pad = 0.04 * (high - low) or 0.05 * abs(high) or 1.0
    axes.set_xlim(low - pad, high + pad)
    inside = rating is not None and rating < high + _FARTHEST * max(high - low, pad)
    if rating is not None and inside:
        axes.set_xlim(min(low, rating) - pad, max(high, rating) + pad)
        axes.axvline(rating, color=_RATING, linewidth=1.4)
    edges = np.linspace(low - 1e-3 * pad, high + 1e-3 * pad, _BINS + 1)
    counts, _ = np.histogram(values, edges)
    within, _ = np.histogram(values[values <= (np.inf if rating is None else rating)], edges)
    bars: dict[str, Any] = {"width": edges[1] - edges[0], "align": "edge", "linewidth": 0}
    axes.bar(edges[:-1], within, color=_BLUE, **bars)
    axes.bar(edges[:-1], counts - within, bottom=within, color=_BEYOND, **bars)
    axes.set_ylim(0, 1.28 * counts.max())
    axes.set_yticks([])
    if trial is not None and rating is not None:  # in how many samples it suffices
        met = percent(result.probability(result.figure(name)[:, i] <= rating))
        low, high = axes.get_xlim()
        right = not inside or rating > 0.5 * (low + high)
        axes.annotate(
            f"{met} within {digits(rating)}",
            (rating if inside else high, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(-4 if right else 4, -1),
            textcoords="offset points",
            ha="right" if right else "left",
            va="top",
            fontsize=8,
            color=_RATING,
        )
    _mark_percentiles(axes, result, values)
    _quiet(axes)


def _mark_percentiles(axes: Axes, result: SweepResult, values: np.ndarray) -> None:
    percentiles = sorted(result.percentiles)
    at = np.percentile(values, percentiles)
    low, high = axes.get_xlim()
    axes.set_xticks(at, [""] * len(at))
    axes.tick_params(axis="x", length=4, color=INK)
    room = min(_LABEL, 1.0 / len(at)) * (high - low)
    places = at.copy()
    for k in range(1, len(at)):
        places[k] = max(places[k], places[k - 1] + room)
    places[-1] = min(places[-1], high)
    for k in reversed(range(len(at) - 1)):
        places[k] = min(places[k], places[k + 1] - room)
    for x, value, p in zip(places, at, percentiles, strict=True):
        for text, below, size, colour in (
            (digits(value), -6, 8, INK),
            (f"{p:g} %", -16, 6.5, QUIET),
        ):
            axes.annotate(
                text,
                (x, 0),
                xytext=(0, below),
                textcoords="offset points",
                xycoords=("data", "axes fraction"),
                ha="center",
                va="top",
                fontsize=size,
                color=colour,
            )


def _drivers(axes: Axes, result: SweepResult, i: int, strength: np.ndarray, bottom: bool) -> None:
    order = np.argsort(-np.nan_to_num(np.abs(strength), nan=-1.0), kind="stable")[:_DRAWN]
    signed = not result.has_shares
    if signed:
        axes.axvspan(-result.correlation_noise, result.correlation_noise, color=_NOISE, zorder=0)
    for k, j in enumerate(order):
        x = float(strength[j]) if np.isfinite(strength[j]) else 0.0
        axes.barh(-k, abs(x), height=0.62, color=_UP if x >= 0 else _DOWN, zorder=2)
        label: dict[str, Any] = {"va": "center", "fontsize": 8, "color": INK, "zorder": 3}
        axes.text(abs(x) + 0.02, -k, f"{x:{'+' if signed else ''}.2f}", **label)
    names = [own(parameter, result.actuator_names[i]) for parameter in result.parameter_names]
    short = shortened(names, max(_LETTERS, least_room(names)))
    axes.set_yticks(-np.arange(len(order)), [short[j] for j in order])
    axes.set_xlim(0, 1.18)
    axes.set_ylim(-_DRAWN + 0.4, 0.6)
    axes.set_xticks((0, 0.5, 1), ("0", "0.5", "1") if bottom else ("", "", ""))
    _quiet(axes)


def _quiet(axes: Axes) -> None:
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="x", colors=QUIET)
    axes.tick_params(axis="y", length=0, colors=INK)
