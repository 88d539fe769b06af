"""Figures of effort over time as an interval, a panel per drive.

`pyplot` is not used: it takes a second to import and keeps figures alive.
"""

from __future__ import annotations

from collections.abc import Sequence
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
from pinfric.show.figure.panel import key_below, sheet
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BLUE, GREEN, GRID, INK, ORANGE, QUIET, style
from pinfric.show.report.inverse import log_lines
from pinfric.show.report.names import picture_names, shortened
from pinfric.show.report.values import digits, span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_EFFORT, _STICKING, _CARRIED = BLUE, ORANGE, GREEN
#: A tick upward at an instant at rest, the line where a joint slides, the ring at the peak.
_TICK: dict[str, Any] = {
    "linestyle": "",
    "marker": 2,
    "markersize": 9,
    "markeredgewidth": 1.4,
    "color": "#B87400",
    "zorder": 4.5,
    "clip_on": False,
    "gid": "passages",
    "label": "passes through rest",
}
_SLIDING: dict[str, Any] = {
    "color": _EFFORT,
    "linewidth": 1.5,
    "solid_capstyle": "round",
    "zorder": 4,
    "gid": "sliding",
    "label": "effort where the joint slides",
}
_PEAK: dict[str, Any] = {
    "linestyle": "",
    "marker": "o",
    "markersize": 4.5,
    "markerfacecolor": "white",
    "markeredgecolor": _EFFORT,
    "markeredgewidth": 1.2,
    "zorder": 5,
    "gid": "peak",
    "label": "peak",
}
#: Layers of the band: white, a veil over it that makes its colour, and an edge. The frictionless
#: curve between the first two shows through, the shading below them does not.
_BAND: tuple[dict[str, Any], ...] = (
    {"zorder": 2.8, "color": "white", "linewidth": 0},
    {
        "zorder": 3,
        "color": "#539FD1",
        "alpha": 0.5,
        "linewidth": 0,
        "gid": "interval",
        "label": "possible efforts where it sticks",
    },
    {"zorder": 3.7, "facecolor": "none", "edgecolor": _EFFORT, "linewidth": 0.7},
)
#: Pieces a long motion is cut into, each drawn by its extremes: more than a panel has pixels.
_PIECES = 2000
#: A stick of this part of the whole time is a line, not a band: three pixels wide.
_INSTANT = 1 / 500
#: Drives drawn: three columns of ten.
_MOST = 30
#: Up to this many samples each one gets a dot.
_FEW = 80
#: Inches a letter takes in a panel's label, on average; all panels of a row; a payload's strip.
_LETTER, _BOLD_LETTER, _WIDTH, _STRIP = 0.068, 0.088, 10.2, 0.3


@draws(InverseResult, "efforts")
def effort_figure(
    result: InverseResult,
    trajectory: str = "",
    joints: Sequence[str] | None = None,
    log: JudgedLog | None = None,
    ax: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """Draw every drive's effort over time: a line while it slides, a band while it sticks.

    The thin line behind is the effort without friction; times at rest are shaded; a tick below
    marks an instant at rest (a single sample, or a reversal between two); a bar above shows when a
    payload is carried.

    Args:
        result: with times.
        trajectory: its name, for the title.
        joints: names of the drives to draw, those of their joints; by default all, of more than 30
            those with the largest peaks of their unit.
        log: how the trajectory was read; the uncertainty of efforts is stated below the panels.
        ax: axes of your own to draw in, one for each of `joints`; the figure returned is theirs.

    Raises:
        StateError: the result has no times, no drives, or no drive of a name; another number of
            axes than of drives.
    """
    t, scene, names = result.t, result.scene, result.actuator_names
    if t is None:
        raise StateError("a figure over time needs times: give `t` to inverse_dynamics")
    summaries = summarize(result)
    if not summaries:
        raise StateError(f"{scene.source}: has no drives, so there are no efforts to draw")
    for name in joints or ():
        if name not in names:
            raise StateError(f"a figure: there is no drive {name!r}; {choose_from(name, names)}")
    units = [summary.unit for summary in summaries]
    chosen, others = largest([summary.peak for summary in summaries], units, _MOST)
    if joints is not None:
        chosen, others = [i for i, name in enumerate(names) if name in joints], ""
    if ax is not None:
        return _draw_in(ax, result, chosen, summaries)
    count = len(chosen)
    columns = 1 if count <= 8 else 2 if count <= 16 else 3
    rows = -(-count // columns)
    height = {1: 3.6, 2: 2.4, 3: 1.9}.get(rows, 1.55 if columns == 1 else 1.35)
    carried = payload_phases(result)
    always = [n for n, spans in carried.items() if spans == [(float(t[0]), float(t[-1]))]]
    phases = {n: spans for n, spans in carried.items() if spans and n not in always}
    heights = [_STRIP * len(phases)] * bool(phases) + [height] * rows
    zero, width = rounding(result), _WIDTH / columns - 0.5
    short, note = picture_names(names, int((width - 1.0) / _BOLD_LETTER))
    with style():
        title = " · ".join(name for name in (Path(scene.source).stem, trajectory) if name)
        figure = sheet(11.0, sum(heights) + 1.4, shortened([title], 90)[0])
        grid = figure.subplots(
            len(heights), columns, sharex=True, squeeze=False, height_ratios=heights
        )
        still = 0.5 if len(t) == 1 else 0.0  # a single instant has no width
        grid[0, 0].set_xlim(t[0] - still, t[-1] + still)
        for axes in grid[0] if phases else ():
            _draw_phases(axes, phases, t)
        panels = grid[len(phases) > 0 :].T.ravel()
        for axes in panels[count:]:
            axes.remove()
        for place, (axes, i) in enumerate(zip(panels, chosen, strict=False)):
            for moment in {x for spans in phases.values() for ends in spans for x in ends}:
                axes.axvline(moment, color=_CARRIED, linewidth=0.7, linestyle=(0, (4, 3)), zorder=1)
            _draw_panel(axes, result, i, zero)
            _label(axes, short[i], summaries[i], width, zero)
            if place == count - 1 or (place + 1) % rows == 0:  # the lowest of its column
                axes.set_xlabel("time (s)")
                axes.tick_params(labelbottom=True)
        figure.align_ylabels(panels[:count])
        shown = " and ".join(dict.fromkeys(units[i] for i in chosen))
        known = "; ".join(["", *log_lines(log, {s.name: s.unit for s in summaries})])
        carries = f"; carries {', '.join(always)} all the way" if always else ""
        text = f"effort of each drive at its joint, in {shown}{carries}{others}{note}{known}"
        key_below(figure, title=text, alignment="left")
    return figure


def _draw_in(
    ax: Axes | Sequence[Axes],
    result: InverseResult,
    chosen: Sequence[int],
    summaries: Sequence[ActuatorSummary],
) -> Figure:
    """Draw drives in axes of the caller's; return the figure of these."""
    given = [*np.atleast_1d(np.asarray(ax, dtype=object)).ravel()]
    if len(given) != len(chosen):
        raise StateError(
            f"a figure: {len(given)} axes for {len(chosen)} drives; name as many `joints` as axes"
        )
    zero = rounding(result)
    with style():
        for axes, i in zip(given, chosen, strict=True):
            _draw_panel(axes, result, i, zero)
            _label(axes, result.actuator_names[i], summaries[i], _WIDTH, zero)
            axes.set_xlabel("time (s)")
    figure: Figure = given[0].get_figure()
    return figure


def largest(peaks: Sequence[float], units: Sequence[str], most: int) -> tuple[list[int], str]:
    """Return which drives to draw, in their order, and a text about the others.

    Args:
        peaks: (na,) of the efforts; compared with the largest of the same unit.
        units: (na,) of these.
        most: how many to draw.
    """
    scale = {u: max(p for p, unit in zip(peaks, units, strict=True) if unit == u) for u in units}
    relative = [p / (scale[u] or 1.0) for p, u in zip(peaks, units, strict=True)]
    drawn = sorted(sorted(range(len(relative)), key=lambda i: -relative[i])[:most])
    others = [i for i in range(len(relative)) if i not in set(drawn)]
    below = " and ".join(
        f"{digits(max(peaks[i] for i in others if units[i] == unit))} {unit}"
        for unit in dict.fromkeys(units[i] for i in others)
    )
    return drawn, f"; {len(others)} more, not drawn, need at most {below}" if others else ""


def thinned(series: Sequence[np.ndarray], pieces: int = _PIECES) -> np.ndarray:
    """Return increasing indices that keep each series' least and greatest value piece by piece.

    The first NaN of a piece is kept, too: the line has its gap.

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
    """Return a tick's label that fits a panel: 5e-4, not 0.0005."""
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        text = f"{value:g}"
    else:
        mantissa, exponent = f"{value:.3e}".split("e")
        text = f"{float(mantissa):g}e{int(exponent)}"
    return text.replace("-", "\N{MINUS SIGN}")


def shade(axes: Axes, spans: np.ndarray, label: str = "") -> None:
    """Shade the background in spans (n, 2) of time at rest, s."""
    axes.broken_barh(
        [(a, b - a) for a, b in spans],
        (0.0, 1.0),
        transform=axes.get_xaxis_transform(),
        facecolor=_STICKING,
        alpha=0.17,
        linewidth=0,
        zorder=0,
        gid="sticking",
        label=label if len(spans) else None,
    )


def rest_spans(result: InverseResult, i: int) -> np.ndarray:
    """Return the spans (n, 2), s, in which a drive rests; those closer than a pixel are joined."""
    start, end = result.times[np.array(runs(rests(result, i)), dtype=int).reshape(-1, 2)].T
    apart = start[1:] - end[:-1] >= np.ptp(result.times) / _PIECES
    first, last = (np.ones(len(start), dtype=bool) for _ in range(2))
    first[1:], last[:-1] = apart, apart
    return np.column_stack((start[first], end[last]))


def dress(axes: Axes, ticks: int) -> None:
    """Give a panel few round ticks with brief labels, and a line at 0."""
    from matplotlib.ticker import MaxNLocator

    axes.axhline(0.0, color=QUIET, linewidth=0.5, alpha=0.6, zorder=1)
    axes.yaxis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 2.5, 5, 10]))
    axes.yaxis.set_major_formatter(brief_ticks)
    axes.tick_params(colors=QUIET, length=2.5)


def _draw_panel(axes: Axes, result: InverseResult, i: int, zero: float) -> None:
    """Draw one drive's effort over time; values up to `zero` are rounding."""
    t, sticking, rubs = result.times, rests(result, i), sites_on(result.scene, i)
    lower, upper = result.effort_lower[:, i], result.effort_upper[:, i]
    frictionless = result.effort_frictionless[:, i]
    # 1. Instants at rest: sticks too short to see, and reversals; close ones make one tick
    instant = _INSTANT * float(np.ptp(t)) or 1.0
    passages = result.reversal[:, rubs].any(axis=1) & ~sticking
    for first, last in runs(sticking):
        passages[first : last + 1] = t[last] - t[first] <= instant
    moments = t[passages]
    moments = moments[np.unique(np.floor((moments - t[0]) / instant), return_index=True)[1]]
    lasting = (lower != upper) & sticking & ~passages
    # 2. Of a long motion what the eye can tell apart, with both sides of each change
    kept, change = thinned([lower, upper, frictionless]), np.flatnonzero(np.diff(lower != upper))
    if len(kept) < len(t) and len(change) <= 2 * _PIECES:
        kept = np.union1d(kept, (change, change + 1))
    t, lower, upper, frictionless, lasting = (
        x[kept] for x in (t, lower, upper, frictionless, lasting)
    )
    interval = lower != upper
    # 3. Behind: times and instants at rest, the effort without friction
    shade(axes, rest_spans(result, i), "time at rest")
    if moments.size:
        axes.plot(moments, 0.0 * moments, transform=axes.get_xaxis_transform(), **_TICK)
    if rubs:
        (line,) = axes.plot(t, frictionless, color=INK, linewidth=0.7, label="without friction")
        line.set(zorder=2.9, gid="frictionless")
    # 4. Where it sticks: the band of possible efforts, of a sample alone a vertical line
    for look in _BAND if lasting.any() else ():
        axes.fill_between(t, lower, upper, where=lasting.tolist(), **look)
    alone = (interval & ~lasting) | _alone(lasting)
    lines = axes.vlines(t[alone], lower[alone], upper[alone], color=_EFFORT, linewidth=1.2)
    lines.set(alpha=0.6, zorder=3, gid="instants")
    # 5. Where it slides: a line, of a sample alone a dot; the peak
    axes.plot(t, np.where(interval, np.nan, upper), **_SLIDING)
    dots = ~interval if len(t) <= _FEW else _alone(~interval)
    axes.plot(t[dots], upper[dots], ".", color=_EFFORT, markersize=4, zorder=4)
    worst, _ = ends_by_magnitude(lower, upper)
    peak = int(np.nan_to_num(np.abs(worst)).argmax())
    axes.plot(t[peak], worst[peak], **_PEAK)
    # 6. Limits: as little ink as a reader needs
    values = np.concatenate([lower, upper, frictionless, [0.0]])
    values = values[np.isfinite(values)]
    low, high = (values.min(), values.max()) if np.ptp(values) > zero else (-1.0, 1.0)
    axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    dress(axes, 5)
    axes.grid(axis="y", color=GRID, linewidth=0.4)


def _label(axes: Axes, name: str, summary: ActuatorSummary, width: float, zero: float) -> None:
    """Write the drive's name above its panel, and at the right as many figures as fit."""
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
    axes.set_title(name, fontweight="bold", color=INK)
    axes.set_title(f"{figures}  {summary.unit}", loc="right", fontsize=8, color=QUIET)
    axes.set_ylabel(f"effort ({summary.unit})")


def _draw_phases(axes: Axes, phases: dict[str, list[tuple[float, float]]], t: np.ndarray) -> None:
    """Draw a bar for each payload carried part of the time, labelled inside or beside."""
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


def _alone(mask: np.ndarray) -> np.ndarray:
    """True where a mask is True for a single sample."""
    padded = np.concatenate(([False], mask, [False]))
    return mask & ~padded[:-2] & ~padded[2:]
