"""Figure of a retimed path: its speed below the limit, and each drive's use of its limits."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pinfric.drives.limits import instant_limits
from pinfric.retiming.retime import RetimeResult
from pinfric.show.figure.panel import sheet
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BLUE, GREEN, ORANGE, PURPLE, QUIET, RED, SKY, YELLOW, style
from pinfric.show.report.names import picture_names
from pinfric.show.report.values import digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SPEED, _LIMIT = BLUE, RED
#: Colours of `instant_limits`, where the drive is at that limit.
_COLOURS = (RED, ORANGE, PURPLE, "#8B4513", YELLOW, BLUE, SKY, GREEN)
#: Inches: the top panel, a drive's strip, all else.
_TOP, _STRIP, _REST = 3.2, 0.34, 1.9
#: Pieces of time that strips are drawn in.
_PIECES = 1400
_AT_LIMIT = 0.995
#: A strip's part of its row, its ground, and what is used below a limit.
_BAND, _ROOM, _USED = 0.84, "#f0f1f4", "#a3a6b3"
#: Letters of a drive's name.
_LETTERS = 20


@draws(RetimeResult, "retime")
def retime_figure(result: RetimeResult) -> Figure:
    """Draw the speed along the path over time under its limit, and below what each drive uses.

    Above the limit no acceleration along the path keeps all limits. A drive's strip is filled as
    far as it uses its nearest limit, and coloured where it reaches it.
    """
    from matplotlib.patches import Patch

    scene, path = result.problem.scene, result.problem.path
    strips = len(scene.drives) * _STRIP
    with style():
        title = f"{Path(scene.source).stem} · {Path(path.source).name}"
        figure = sheet(11.0, _TOP + strips + _REST, title)
        top, low = figure.subplots(2, 1, sharex=True, height_ratios=(_TOP, strips))
        # The speed, and the curve that it cannot pass
        departs, label = 0.0, True
        curve = result.limit_curve()
        stops = np.flatnonzero(result.profile.grid.stop)
        holds, most = result.problem.path.holds, float(np.sqrt(result.profile.x.max()))
        for p, (a, b) in enumerate(pairwise(stops)):
            departs += holds[p]
            t = departs + np.append(0.0, result.profile.time[a + 1 : b + 1])
            limit = np.append(curve[a:b], curve[b - 1])
            limit = np.where(limit < (3.0 * most) ** 2, np.sqrt(limit), np.nan)
            top.plot(t, limit, color=_LIMIT, linewidth=1.0, label="limit" if label else None)
            fine = np.linspace(0.0, result.profile.duration[p], 400)
            top.plot(
                departs + fine,
                result.profile.at(p, fine)[1],
                color=_SPEED,
                linewidth=1.6,
                label="speed" if label else None,
            )
            departs, label = departs + float(result.moves[p]), False
        top.set_ylim(0.0, 1.35 * most)
        top.set_ylabel("along the path, ds/dt (1/s)")
        top.tick_params(colors=QUIET)
        top.legend(loc="upper right", ncols=2)
        used = _draw_use(low, result)
        before = f" ({digits(result.before)} s before)" if result.before is not None else ""
        text = (
            f"{digits(result.duration)} s{before}; no limit exceeded by more than "
            f"{100 * result.excess:.2g} %"
            f"{picture_names([drive.name for drive in scene.drives], _LETTERS)[1]}"
        )
        top.set_title(text, color=QUIET)
        limits = instant_limits()
        patches = [Patch(color=_colour(k), label=f"at the limit: {limits[k].name}") for k in used]
        key = "used part of the drive's nearest limit; a full strip is all of it"
        patches.append(Patch(color=_USED, label=key))
        figure.legend(handles=patches, loc="outside lower center", ncols=4)
    return figure


def _draw_use(axes: Axes, result: RetimeResult) -> list[int]:
    """Draw each drive's use of its nearest limit as a strip; return the limits reached."""
    t, use = result.trajectory.t, result.usage
    names = [drive.name for drive in result.problem.scene.drives]
    edges = np.linspace(t[0], t[-1], min(_PIECES, len(t)) + 1)
    first = np.searchsorted(t, edges[:-1])
    most = np.maximum.reduceat(use, np.minimum(first, len(t) - 1), axis=0)
    nearest, share = most.argmax(axis=2), np.clip(most.max(axis=2), 0.0, 1.0)
    reached = share > _AT_LIMIT
    met = sorted(set(nearest[reached].tolist()))
    for i in range(len(names)):
        floor = i + 0.5 * _BAND
        axes.axhspan(i - 0.5 * _BAND, floor, color=_ROOM, linewidth=0)
        for colour, where in (
            (_USED, ~reached),
            *((_colour(k), reached & (nearest == k)) for k in met),
        ):
            top = floor - _BAND * np.where(where[:, i], share[:, i], 0.0)
            axes.stairs(top, edges, baseline=floor, fill=True, color=colour, linewidth=0)
    axes.set(xlim=(t[0], t[-1]), ylim=(len(names) - 0.5, -0.5), xlabel="time (s)")
    axes.set_yticks(range(len(names)), picture_names(names, _LETTERS)[0])
    axes.spines["left"].set_visible(False)
    axes.grid(visible=False)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", length=3, colors=QUIET)
    return met


def _colour(k: int) -> str:
    return _COLOURS[k % len(_COLOURS)]
