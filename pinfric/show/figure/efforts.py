"""Figures: effort over time as an interval, one small panel per drive.

Matplotlib's `Figure` is used directly; `pyplot` would take a second to import and keep the
figures alive. Nothing is drawn that the eye could not see: long motions are thinned to their
extremes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.dynamics.inverse.result import InverseResult, runs
from pinfric.errors import StateError, choose_from
from pinfric.motions.log.judged import JudgedLog
from pinfric.motions.summary import (
    ActuatorSummary,
    ends_by_magnitude,
    payload_phases,
    rests,
    rounding,
    sites_on,
    summarize,
)
from pinfric.show.figure.style import BAND, BLUE, GREEN, GRID, INK, ORANGE, QUIET, style
from pinfric.show.report.inverse import log_lines
from pinfric.show.report.names import picture_names, shortened
from pinfric.show.report.values import digits, span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_EFFORT, _STICKING, _CARRIED = BLUE, ORANGE, GREEN
#: The band is drawn in two layers, white and over it a veil that makes its colour: the frictionless
#: curve between them shows through, the shading below both does not.
_VEIL, _VEIL_ALPHA = "#539FD1", 0.5
#: Opacity of the shaded times.
_SHADE = 0.17
#: The mark of an instant at rest, at the bottom of a panel.
_PASSAGE: dict[str, Any] = {
    "linestyle": "",
    "marker": 2,
    "markersize": 9,
    "markeredgecolor": "#B87400",  # 2: a tick upward
    "markeredgewidth": 1.4,
}
#: The mark of the largest effort.
_PEAK: dict[str, Any] = {
    "marker": "o",
    "markersize": 4.5,
    "markerfacecolor": "white",
    "markeredgecolor": _EFFORT,
    "markeredgewidth": 1.2,
}
#: Pieces a long motion is cut into, each drawn by its extremes: more than a panel has pixels.
_PIECES = 2000
#: A stick of this part of the whole time is a line, not a band: three pixels wide.
_INSTANT = 1 / 500
#: Drives drawn: three columns of ten.
_MOST = 30
#: Up to this many samples each one gets a dot.
_FEW = 80
#: Inches a letter takes in a panel's label, on average.
_LETTER, _BOLD_LETTER = 0.068, 0.088
#: Inches: width of the figure, its margins, the header, a payload's strip, a panel's label.
_WIDTH, _LEFT, _RIGHT, _HEADER, _FOOT, _STRIP, _LABEL = 11.0, 0.75, 0.25, 0.92, 0.55, 0.2, 0.38


def effort_figure(
    result: InverseResult,
    trajectory: str = "",
    drives: Sequence[str] | None = None,
    log: JudgedLog | None = None,
) -> Figure:
    """Draw every drive's effort over time: a line while it slides, a band while it sticks.

    The thin line behind is the effort without friction; times at rest are shaded; a tick below
    marks an instant at rest (a single sample, or a reversal between two); a bar above says when a
    payload is carried.

    Args:
        result: with times.
        trajectory: its name, for the title.
        drives: names of those to draw; by default all, of more than 30 those with the largest
            peaks of their unit: what is left out is counted.
        log: how the trajectory was read, if it came from samples; how well efforts are known is
            said below the title.

    Raises:
        StateError: the result has no times, no drives, or no drive of a name.
    """
    from matplotlib.figure import Figure

    if result.t is None:
        raise StateError("a figure over time needs times: give `t` to inverse_dynamics")
    chosen, left = _chosen(result, summarize(result), drives)
    count = len(chosen)
    columns = 1 if count <= 8 else 2 if count <= 16 else 3
    rows = -(-count // columns)
    height = {1: 3.2, 2: 2.0, 3: 1.5}.get(rows, 1.15 if columns == 1 else 0.95)
    whole_way = [(float(result.t[0]), float(result.t[-1]))]
    carried = payload_phases(result)
    always = [name for name, spans in carried.items() if spans == whole_way]
    phases = {name: spans for name, spans in carried.items() if spans and name not in always}
    strips = _STRIP * len(phases) + (0.08 if phases else 0.0)
    zero = rounding(result)
    total = _HEADER + strips + rows * (height + _LABEL) + _FOOT
    with style():
        figure = Figure(figsize=(_WIDTH, total), dpi=150, facecolor="white")
        grid = _Grid(figure, columns, height, total, strips)
        room = int((grid.width - 1.0) / _BOLD_LETTER)
        names, note = picture_names(result.actuator_names, room)
        for place, (i, summary) in enumerate(chosen.items()):
            row, column = place % rows, place // rows
            axes = grid.panel(row, column)
            bottom = row == rows - 1 or place == count - 1
            _draw_panel(axes, result, i, zero, bottom)
            for moment in sorted({x for spans in phases.values() for ends in spans for x in ends}):
                axes.axvline(moment, color=_CARRIED, linewidth=0.7, linestyle=(0, (4, 3)), zorder=1)
            axes.plot(summary.peak_time, _peak(result, i), zorder=5, gid="peak", **_PEAK)
            _label(axes, names[i], summary, grid.width, zero)
        if phases:
            for column in range(columns):
                _draw_phases(grid.strip(column), phases, result.t)
        known = "; ".join(["", *log_lines(log, {s.name: s.unit for s in summarize(result)})])
        text = f"{_subject(chosen.values(), always)}{left}{note}{known}"
        _head(figure, total, result, trajectory, text)
    return figure


def _subject(drawn: Iterable[ActuatorSummary], always: Sequence[str]) -> str:
    """What is drawn, in which units, and what is carried `always`."""
    units = " and ".join(dict.fromkeys(summary.unit for summary in drawn))
    carried = f"; carries {', '.join(always)} all the way" if always else ""
    return f"effort of each drive at its joint, in {units}{carried}"


def _chosen(
    result: InverseResult, summaries: Sequence[ActuatorSummary], drives: Sequence[str] | None
) -> tuple[dict[int, ActuatorSummary], str]:
    """What is drawn, by column, and what to say of the rest."""
    if not summaries:
        raise StateError(f"{result.scene.source}: has no drives, so there are no efforts to draw")
    if drives is not None:
        for name in drives:
            if name not in result.actuator_names:
                known = choose_from(name, result.actuator_names)
                raise StateError(f"a figure: there is no drive {name!r}; {known}")
        return {i: s for i, s in enumerate(summaries) if s.name in drives}, ""
    drawn, left = largest([s.peak for s in summaries], [s.unit for s in summaries], _MOST)
    return {i: summaries[i] for i in drawn}, left


def largest(peaks: Sequence[float], units: Sequence[str], most: int) -> tuple[list[int], str]:
    """Return which drives to draw, in their order, and what to say of the others.

    Args:
        peaks: (na,) of the drives' efforts; compared with the largest of the same unit.
        units: (na,) of these.
        most: how many to draw.
    """
    scale = {u: max(p for p, unit in zip(peaks, units, strict=True) if unit == u) for u in units}
    part = [p / (scale[u] or 1.0) for p, u in zip(peaks, units, strict=True)]
    drawn = sorted(sorted(range(len(part)), key=lambda i: -part[i])[:most])
    rest = [i for i in range(len(part)) if i not in set(drawn)]
    below = " and ".join(
        f"{digits(max(peaks[i] for i in rest if units[i] == unit))} {unit}"
        for unit in dict.fromkeys(units[i] for i in rest)
    )
    return drawn, f"; {len(rest)} more, not drawn, need at most {below}" if rest else ""


def thinned(series: Sequence[np.ndarray], pieces: int = _PIECES) -> np.ndarray:
    """Return increasing indices that keep each series' least and greatest value piece by piece.

    Where a piece holds NaN, its first is kept, too: the line has its gap.

    Args:
        series: arrays of equal shape (T,).
        pieces: number of equal pieces; up to 4 x pieces samples, all are kept.
    """
    count = len(series[0])
    if count <= 4 * pieces:
        return np.arange(count)
    size = -(-count // pieces)
    starts = np.arange(0, count, size)
    kept = [starts, np.array([count - 1])]
    for values in series:
        # the last piece is filled with its own last value, which changes no extreme
        filled = np.pad(values, (0, len(starts) * size - count), mode="edge").reshape(-1, size)
        gap = np.isnan(filled)
        low, high = np.where(gap, np.inf, filled), np.where(gap, -np.inf, filled)
        for chosen in (low.argmin(axis=1), high.argmax(axis=1), gap.argmax(axis=1)):
            kept.append(np.minimum(starts + chosen, count - 1))
    return np.unique(np.concatenate(kept))


def brief_ticks(value: float, _position: float = 0.0) -> str:
    """Return a tick's label: 0.0005 takes as much room as a panel has, 5e-4 does not."""
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        text = f"{value:g}"
    else:
        mantissa, exponent = f"{value:.3e}".split("e")
        text = f"{float(mantissa):g}e{int(exponent)}"
    return text.replace("-", "\N{MINUS SIGN}")


class _Grid:
    """Places panels by inches, so that labels have the same room in every figure."""

    def __init__(
        self, figure: Figure, columns: int, height: float, total: float, strips: float
    ) -> None:
        self.figure, self.height, self.total, self.strips = figure, height, total, strips
        gap = 0.6
        self.width = (_WIDTH - _LEFT - _RIGHT - (columns - 1) * gap) / columns
        self.step = self.width + gap
        self.first: Axes | None = None

    def panel(self, row: int, column: int) -> Axes:
        top = self.total - _HEADER - self.strips - row * (self.height + _LABEL) - _LABEL
        axes = self._axes(column, top - self.height, self.height, sharex=self.first)
        self.first = self.first or axes
        return axes

    def strip(self, column: int) -> Axes:
        bottom = self.total - _HEADER - self.strips
        return self._axes(column, bottom, self.strips - 0.08, sharex=self.first)

    def _axes(self, column: int, bottom: float, height: float, **options: Any) -> Axes:
        left = (_LEFT + column * self.step) / _WIDTH
        box = (left, bottom / self.total, self.width / _WIDTH, height / self.total)
        return self.figure.add_axes(box, **options)


def _draw_panel(axes: Axes, result: InverseResult, i: int, zero: float, bottom: bool) -> None:
    assert result.t is not None
    lower, upper = result.effort_lower[:, i], result.effort_upper[:, i]
    frictionless = result.effort_frictionless[:, i]
    kept = thinned([lower, upper, frictionless])
    if len(kept) < len(lower):
        kept = np.union1d(kept, _edges(lower != upper))
    t, lower, upper, frictionless = (x[kept] for x in (result.t, lower, upper, frictionless))
    sticking = rests(result, i)
    interval = lower != upper
    _shade(axes, result.t, sticking)
    passages = _passages(result, i)
    _mark_passages(axes, result.t, passages)
    axes.axhline(0.0, color=QUIET, linewidth=0.5, alpha=0.6, zorder=1)
    if sites_on(result.scene, i):
        axes.plot(t, frictionless, color=INK, linewidth=0.7, zorder=2.9, gid="frictionless")
    # The band of possible efforts; of an instant at rest a vertical line
    lasting = interval & (sticking & ~passages)[kept]
    where = lasting.tolist()
    axes.fill_between(t, lower, upper, where=where, color="white", linewidth=0, zorder=2.8)
    axes.fill_between(
        t,
        lower,
        upper,
        where=where,
        facecolor=_VEIL,
        alpha=_VEIL_ALPHA,
        linewidth=0,
        zorder=3,
        gid="interval",
    )
    axes.fill_between(
        t, lower, upper, where=where, facecolor="none", edgecolor=_EFFORT, linewidth=0.7, zorder=3.7
    )
    instants = (interval & ~lasting) | _alone(lasting)
    axes.vlines(
        t[instants],
        lower[instants],
        upper[instants],
        color=_EFFORT,
        linewidth=1.2,
        alpha=0.6,
        zorder=3,
        gid="instants",
    )
    sliding = np.where(interval, np.nan, upper)
    axes.plot(
        t, sliding, color=_EFFORT, linewidth=1.5, zorder=4, gid="sliding", solid_capstyle="round"
    )
    dots = ~interval if len(t) <= _FEW else _alone(~interval)
    axes.plot(t[dots], upper[dots], ".", color=_EFFORT, markersize=4, zorder=4, clip_on=False)
    _dress(axes, result.t, (lower, upper, frictionless), zero, bottom)


def _shade(axes: Axes, t: np.ndarray, sticking: np.ndarray) -> None:
    """Light background where the drive sticks; times closer than a pixel are drawn as one."""
    closest = (t[-1] - t[0]) / _PIECES
    spans: list[list[float]] = []
    for first, last in runs(sticking):
        if spans and t[first] - spans[-1][1] < closest:
            spans[-1][1] = float(t[last])
        else:
            spans.append([float(t[first]), float(t[last])])
    axes.broken_barh(
        [(start, end - start) for start, end in spans],
        (0.0, 1.0),
        transform=axes.get_xaxis_transform(),
        facecolor=_STICKING,
        alpha=_SHADE,
        linewidth=0,
        zorder=0,
        gid="sticking",
    )


def _passages(result: InverseResult, i: int) -> np.ndarray:
    """(T,) where a drive is at rest for an instant: a stick too short to see, or a reversal."""
    assert result.t is not None
    t, sticking = result.t, rests(result, i)
    passages = result.reversal[:, sites_on(result.scene, i)].any(axis=1) & ~sticking
    for first, last in runs(sticking):
        if t[last] - t[first] <= _INSTANT * (t[-1] - t[0]):
            passages[first : last + 1] = True
    return np.asarray(passages)


def _mark_passages(axes: Axes, t: np.ndarray, passages: np.ndarray) -> None:
    """A tick at the bottom per instant at rest; those too close to be told apart are one."""
    width = _INSTANT * float(t[-1] - t[0]) or 1.0
    _, first = np.unique(np.floor((t[passages] - t[0]) / width), return_index=True)
    moments: list[float] = []
    for moment in t[passages][first].tolist():
        if not moments or moment - moments[-1] > width:
            moments.append(moment)
    axes.plot(
        moments,
        np.zeros(len(moments)),
        transform=axes.get_xaxis_transform(),
        zorder=4.5,
        clip_on=False,
        gid="passages",
        **_PASSAGE,
    )


def _dress(
    axes: Axes, t: np.ndarray, series: Sequence[np.ndarray], zero: float, bottom: bool
) -> None:
    """Limits and ticks: as little ink as a reader needs."""
    from matplotlib.ticker import MaxNLocator

    values = np.concatenate(series)
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    low, high = min(low, 0.0), max(high, 0.0)
    if high - low <= zero:
        low, high = -1.0, 1.0
    axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    still = 0.5 if len(t) == 1 else 0.0  # a single instant has no width
    axes.set_xlim(t[0] - still, t[-1] + still)
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    axes.yaxis.set_major_formatter(brief_ticks)
    axes.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 2, 5, 10]))
    axes.tick_params(colors=QUIET, labelcolor=QUIET, length=2.5, labelbottom=bottom)
    axes.grid(axis="y", color=GRID, linewidth=0.4, zorder=0)
    axes.set_axisbelow(True)
    if bottom:
        axes.set_xlabel("time (s)", color=QUIET)


def _label(axes: Axes, name: str, summary: ActuatorSummary, width: float, zero: float) -> None:
    """The drive's name above its panel; at the right the figures that leave room for it."""
    peak, spread = f"peak {digits(summary.peak, zero)}", span(summary.rms_least, summary.rms, zero)
    choices = (
        f"{peak}   RMS {spread}   RMS without friction {digits(summary.rms_frictionless, zero)}",
        f"{peak}   RMS {spread}",
        peak,
    )
    for figures in choices:
        room = int((width - _LETTER * (len(figures) + 6)) / _BOLD_LETTER)
        if len(name) <= room:
            break
    labels: tuple[tuple[str, float, str, dict[str, Any]], ...] = (
        (name, 0, "left", {"fontsize": 9, "fontweight": "bold", "color": INK}),
        (f"{figures}  {summary.unit}", 1, "right", {"fontsize": 8, "color": QUIET}),
    )
    for text, x, side, look in labels:
        axes.annotate(
            text,
            (x, 1),
            (0, 4),
            "axes fraction",
            "offset points",
            ha=side,
            va="bottom",
            annotation_clip=False,
            **look,
        )


def _draw_phases(axes: Axes, phases: dict[str, list[tuple[float, float]]], t: np.ndarray) -> None:
    """One bar per payload that is carried part of the way, labelled inside or beside."""
    axes.set_ylim(len(phases), 0)
    axes.axis("off")
    for row, (name, spans) in enumerate(phases.items()):
        axes.broken_barh(
            [(a, b - a) for a, b in spans],
            (row + 0.08, 0.84),
            facecolor=_CARRIED,
            alpha=0.8,
            linewidth=0,
            gid="carried",
        )
        start, end = max(spans, key=lambda ends: ends[1] - ends[0])
        inside = (end - start) / (t[-1] - t[0]) > 0.012 * (len(name) + 8)
        axes.annotate(
            f"carries {name}" if inside else f" {name}",
            ((start + end) / 2 if inside else end, row + 0.5),
            fontsize=8,
            color="white" if inside else _CARRIED,
            ha="center" if inside else "left",
            va="center",
        )


def _head(
    figure: Figure,
    total: float,
    result: InverseResult,
    trajectory: str,
    text: str,
) -> None:
    """Title, what is shown, and the key; the key names only what the figure has."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    title = " · ".join(name for name in (Path(result.scene.source).stem, trajectory) if name)
    title = shortened([title], 90)[0]
    handles: list[Any] = [
        Line2D([], [], color=_EFFORT, linewidth=1.5, label="effort where the joint slides")
    ]
    if (result.effort_lower != result.effort_upper).any():
        handles.append(
            Patch(
                facecolor=BAND,
                edgecolor=_EFFORT,
                linewidth=0.6,
                label="possible efforts where it sticks",
            )
        )
    if result.sticking.any():
        handles.append(Patch(facecolor=_STICKING, alpha=_SHADE * 1.8, label="time at rest"))
    if any(_passages(result, i).any() for i in range(len(result.actuator_names))):
        in_line = {**_PASSAGE, "marker": "|"}  # a tick would stand above the letters
        handles.append(Line2D([], [], label="passes through rest", **in_line))
    if result.site_names:
        handles.append(Line2D([], [], color=INK, linewidth=0.7, label="without friction"))
    handles.append(Line2D([], [], linestyle="", label="peak", **_PEAK))
    at: dict[str, Any] = {"x": _LEFT / _WIDTH, "va": "top"}
    figure.text(y=1 - 0.2 / total, s=title, fontsize=13, fontweight="bold", color=INK, **at)
    figure.text(y=1 - 0.46 / total, s=text, fontsize=9, color=QUIET, **at)
    figure.legend(
        handles=handles,
        loc="upper left",
        ncols=6,
        frameon=False,
        fontsize=8.5,
        bbox_to_anchor=(_LEFT / _WIDTH, 1 - 0.62 / total),
        borderaxespad=0,
        borderpad=0.2,
        handlelength=1.8,
        columnspacing=1.8,
        labelcolor=INK,
    )


def _peak(result: InverseResult, i: int) -> float:
    """The effort of largest magnitude, with its sign."""
    worst, _ = ends_by_magnitude(result.effort_lower[:, i], result.effort_upper[:, i])
    return float(worst[np.abs(worst).argmax()])


def _edges(mask: np.ndarray) -> np.ndarray:
    """Indices on both sides of each change; none where they outnumber the pixels."""
    change = np.flatnonzero(mask[1:] != mask[:-1])
    return np.union1d(change, change + 1) if len(change) <= 2 * _PIECES else np.array([], int)


def _alone(mask: np.ndarray) -> np.ndarray:
    """True where a mask is True for a single sample."""
    padded = np.concatenate(([False], mask, [False]))
    return mask & ~padded[:-2] & ~padded[2:]
