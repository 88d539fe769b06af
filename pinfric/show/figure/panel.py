"""The sheet that pictures are drawn on, and small ones for pages as SVG."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any

from pinfric.show.figure.style import GRID, INK, QUIET, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def sheet(width: float, height: float, title: str = "") -> Figure:
    """Return an empty figure that makes room for its axes' labels, its title at the left.

    Args:
        width, height: inches.
        title: above all axes.
    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    engine = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.06)
    figure = Figure(figsize=(width, height), dpi=150, facecolor="white", layout=engine)
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold", color=INK)
    return figure


def key_below(figure: Figure, ncols: int = 6, **options: Any) -> None:
    """Add one legend below all axes, each label once."""
    named = [axes.get_legend_handles_labels() for axes in figure.axes]
    key = {label: handle for of in named for handle, label in zip(*of, strict=True)}
    if key:
        figure.legend(key.values(), key, ncols=ncols, loc="outside lower left", **options)


def panel(x: str, y: str, width: float = 5.0, height: float = 2.3) -> tuple[Figure, Axes]:
    """Return a figure of one pair of axes, with their titles.

    Args:
        x, y: titles of the axes.
        width, height: inches.
    """
    with style():
        figure = sheet(width, height)
        axes = figure.add_subplot()
        axes.set(xlabel=x, ylabel=y)
        axes.tick_params(colors=QUIET)
        axes.grid(color=GRID, linewidth=0.6)
    return figure, axes


def svg(figure: Figure, title: str) -> str:
    """Return a figure as an <svg> that takes the width it is given.

    Args:
        figure: with named lines, for the legend below the axes.
        title: read aloud in place of the picture.
    """
    from html import escape

    from matplotlib import rc_context

    with style(), rc_context({"svg.fonttype": "none"}):
        key_below(figure, 3)
        file: Any = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    text = file.getvalue()
    text = re.sub(r'<g id="[^"]*"', "<g", text[text.index("<svg") :])  # ids are of one picture
    # places to 1/100 of a point; what stands between tags is text
    text = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(\d\.\d\d)\d+", r"\1", tag[0]), text)
    return re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL).replace(
        "<svg", f'<svg role="img" aria-label="{escape(title)}"', 1
    )
