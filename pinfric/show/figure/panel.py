"""A small picture of one pair of axes, as a page shows it: SVG, its text as text."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any

from pinfric.show.figure.style import GRID, QUIET, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def panel(x: str, y: str, width: float = 5.0, height: float = 2.9) -> tuple[Figure, Axes]:
    """Return a figure of one pair of axes, with their titles.

    Args:
        x, y: titles of the axes.
        width, height: inches.
    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    with style():
        figure = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine())
        axes = figure.add_subplot()
        axes.set_xlabel(x, color=QUIET)
        axes.set_ylabel(y, color=QUIET)
        axes.tick_params(colors=QUIET)
        axes.grid(color=GRID, linewidth=0.6)
        axes.set_axisbelow(True)
    return figure, axes


def svg(figure: Figure, title: str) -> str:
    """Return a figure as an <svg> that takes the width it is given.

    Args:
        figure: with named lines, of which a legend is made below the axes.
        title: read aloud in place of the picture.
    """
    from html import escape

    from matplotlib import rc_context

    handles, labels = figure.axes[0].get_legend_handles_labels()
    with style(), rc_context({"svg.fonttype": "none"}):
        if handles:
            figure.legend(handles, labels, loc="outside lower left", ncols=3, frameon=False)
        file: Any = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    text = file.getvalue()
    text = re.sub(r'<g id="[^"]*"', "<g", text[text.index("<svg") :])  # ids are of one picture
    # places to 1/100 of a point; what stands between tags is text
    text = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(\d\.\d\d)\d+", r"\1", tag[0]), text)
    return re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL).replace(
        "<svg", f'<svg role="img" aria-label="{escape(title)}"', 1
    )
