"""Common parts of pages: templates and style, values, names and tables."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pinfric import __version__
from pinfric.errors import PinfricError
from pinfric.show.figure.panel import svg
from pinfric.show.figure.registry import figures_of
from pinfric.show.report.envelope import hashes
from pinfric.show.report.html import html_of
from pinfric.show.report.names import affixes, left_out, said_short, short_names
from pinfric.show.report.values import digits, percentage

#: What stands where there is no figure.
NO_FIGURE = "\N{EN DASH}"
#: Inches above which a figure takes a page's whole width.
_WIDE = 8.0
#: Values that print as 0: rounding.
_ROUNDING = 1e-9


def page(
    template: str,
    names: Sequence[str],
    joints: Sequence[str],
    files: Iterable[str] = (),
    **content: Any,
) -> str:
    """Return a page: the header, a link to each joint's section, and a template's sections.

    Args:
        template: its name in this folder.
        names: of joints and drives; their common beginning and end is left out, and stated once.
        joints: those that have a section.
        files: the inputs; the page names them with their SHA-256.
        content: what the template shows.

    Raises:
        PinfricError: the extra `report` (jinja2) is not installed.
    """
    jinja2 = needed("jinja2")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    ends, short, markup = affixes(names), short_names(names), needed("markupsafe").Markup

    def said(text: str) -> Any:
        """Return text as HTML, `backticks` as code."""
        escaped = str(markup.escape(said_short(text, short)))
        return markup(re.sub("`([^`]+)`", r"<code>\1</code>", escaped))

    environment.filters.update(
        digits=figure,
        percent=percentage,
        formula=formula,
        table=lambda table: markup(html_of(table.without(*ends)) if table else ""),
        short=said,
    )
    environment.globals.update(
        left_out=left_out(*ends),
        version=__version__,
        date=datetime.date.today().isoformat(),
        inputs=hashes(files),
        joints=joints,
    )
    html: str = environment.get_template(f"{template}.html.j2").render(**content)
    return html


class Picture(NamedTuple):
    """A figure on a page.

    Attributes:
        name, title: of `ResultFigure`. svg: the drawing. wide: whether it takes the whole width.
    """

    name: str
    title: str
    svg: str
    wide: bool


def drawn(result: Any, number: int | None = None, joint: str = "") -> list[Picture]:
    """Return the figures that a result's page shows.

    Args:
        result: of a task.
        number, joint: of the joint or drive that they draw, and its name; None: of all together.
    """
    alone, of = number is not None, f" of {joint}" if joint else ""
    shown = [each for each in figures_of(result, one=alone) if each.title]
    drawings = [(each, each.draw(result, *([number] if alone else []))) for each in shown]
    return [
        Picture(
            each.name, each.title, svg(drawing, each.title + of), drawing.get_figwidth() > _WIDE
        )
        for each, drawing in drawings
        if drawing is not None
    ]


def figure(x: float | None) -> str:
    """Return a value with three digits, a dash for None."""
    if x is None:
        return NO_FIGURE
    if np.isinf(x):
        return "\N{INFINITY}"
    return digits(x) if abs(x) > _ROUNDING else "0"


def needed(module: str) -> Any:
    """Import a module of the extra `report`, or raise `PinfricError` with how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise PinfricError(
            f"a page needs {module.partition('.')[0]}: pip install 'pinfric[report]'"
        ) from None


def formula(text: str) -> Any:
    """Return a plain formula as HTML: Greek letters, roots, subscripts, powers."""
    markup = needed("markupsafe")
    html = str(markup.escape(text)).replace("&lt;=", "≤").replace("&gt;", ">")
    for pattern, sign in (
        (r"\bint ", "∫ "),
        (r"\bsqrt", "√"),
        (r"\bcbrt", "∛"),
        (r"\bomega", "ω"),
        (r"\btheta(?=\(|&#39;| =)", "ϑ"),
        (r"\btau(?= [t=ϑ])", "τ"),
        (r"\blambda", "λ"),
        (r"\brho\b", "\N{GREEK SMALL LETTER RHO}"),
        (r"\beta", "η"),
        (r"\bpi\b", "π"),
        (r"\^2", "²"),
        (r"\^3", "³"),
        (r"\^6\b", "⁶"),
    ):
        html = re.sub(pattern, sign, html)
    return markup.Markup(re.sub(r"(?<=\w)_([A-Za-z0-9,\-]*[A-Za-z0-9])", r"<sub>\1</sub>", html))
