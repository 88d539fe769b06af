"""Picture of the positions in which friction can hold a tool at rest."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from pinfric.elastic.motion import Elasticity, RestPeriod, ToolPlace
from pinfric.elastic.places import outline
from pinfric.errors import StateError
from pinfric.show.figure.panel import key_below, sheet
from pinfric.show.figure.registry import draws
from pinfric.show.figure.style import BLUE, GREEN, GRID, INK, QUIET, RED, style
from pinfric.show.report.values import digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INSIDE, _EDGE, _APPROACH, _OPPOSITE = "#CFE3F1", BLUE, RED, GREEN
_AXES, MM = "xyz", 1e3


@draws(Elasticity, "tool")
def tool_figure(elastic: Elasticity, title: str = "", rest: RestPeriod | None = None) -> Figure:
    """Draw the positions that the tool can have at one rest, along three axes, in mm.

    Blue is every place that static friction can hold (projections of the zonotope), to one scale; a
    cross, or an arrow towards it, marks the commanded place, the dot that without friction, the
    triangles those after slow approaches from the motion's side and the opposite one.

    Args:
        elastic: of `elasticity`.
        title: above the picture.
        rest: which; by default the one with the widest interval.

    Raises:
        StateError: no rest has a tool's place.
    """
    rest = rest or elastic.worst
    if rest is None or rest.tool is None:
        why = "; ".join(elastic.notes) or "the motion has no rest"
        raise StateError(f"there is no position of the tool at rest to draw: {why}")
    carried = f", carries {', '.join(rest.payloads)}" if rest.payloads else ""
    title += f"{': ' * bool(title)}where {elastic.result.scene.tool} can stand at rest, "
    tool = rest.tool
    title += f"{rest.start:.2f}-{rest.end:.2f} s{carried}\nsag {digits(MM * tool.sag_distance)} mm"
    title += f" · interval ±{digits(MM * tool.farthest)} mm from its middle"
    if tool.reversal is not None:
        title += f" · reversal error {digits(MM * tool.reversal)} mm"
    # least and greatest (3,) of all that is drawn but the commanded place, mm
    middle, extents = tool.middle[:3], tool.extents[:3]
    places = [tool.sag[:3], middle - extents, middle + extents]
    places += [way[:3] for way in (tool.approach, tool.opposite) if way is not None]
    low, high = MM * np.min(places, axis=0), MM * np.max(places, axis=0)
    half = max(0.8 * (high - low).max(), 1e-6)
    with style():
        figure = sheet(10.0, 4.4, title)
        panels = figure.subplots(1, 3)
        for axes, plane in zip(panels, combinations(range(3), 2), strict=True):
            _draw(axes, tool, *plane)
            centre = 0.5 * (low + high)[list(plane)]
            x, y = centre
            axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), aspect="equal")
            _point_to_command(axes, centre, half)
        key_below(figure, 3)
    return figure


def _point_to_command(axes: Axes, centre: np.ndarray, half: float) -> None:
    """Draw an arrow towards the commanded place (0, 0) if it is outside, with its distance."""
    away = float(np.abs(centre).max())
    if away <= 0.96 * half:
        return
    towards = -centre / away
    x, y = centre + 0.95 * half * towards
    start_x, start_y = centre + 0.72 * half * towards
    arrow = {"arrowstyle": "->", "color": INK, "lw": 1.2}
    axes.annotate("", (x, y), (start_x, start_y), arrowprops=arrow)
    distance = digits(float(np.linalg.norm(centre)))
    axes.text(
        0.97,
        0.03,
        f"commanded: {distance} mm away",
        transform=axes.transAxes,
        ha="right",
        color=INK,
        fontsize=7.5,
    )


def _draw(axes: Axes, tool: ToolPlace, i: int, j: int) -> None:
    plane = [i, j]
    middle, edge = MM * tool.middle[plane], MM * outline(tool.generators[plane])
    axes.fill(
        *(middle + edge).T,
        facecolor=_INSIDE,
        edgecolor=_EDGE,
        lw=1.2,
        label="positions that friction can hold",
    )
    sag = MM * tool.sag[plane]
    axes.plot([0.0, sag[0]], [0.0, sag[1]], color=QUIET, lw=0.8, ls=":", zorder=2)
    axes.plot(0.0, 0.0, "+", color=INK, ms=11, mew=1.4, label="commanded", zorder=4)
    axes.plot(*sag, "o", color=INK, ms=5, label="without friction (sag)", zorder=4)
    for way, colour, mark, label in (
        (tool.approach, _APPROACH, "^", "after the motion's approach"),
        (tool.opposite, _OPPOSITE, "v", "after the opposite approach"),
    ):
        if way is not None:
            axes.plot(*(MM * way[plane]), mark, color=colour, ms=7, label=label, zorder=5)
    axes.set(xlabel=f"{_AXES[i]}, mm", ylabel=f"{_AXES[j]}, mm")
    axes.tick_params(colors=QUIET)
    axes.grid(color=GRID, lw=0.6)
