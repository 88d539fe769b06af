"""What every page has: templates and style, values and names in words, tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from pinfric import __version__
from pinfric.errors import PinfricError
from pinfric.show.report.html import html_of
from pinfric.show.report.names import affixes, left_out, said_short, without
from pinfric.show.report.tables import Table
from pinfric.show.report.values import digits, percentage

#: What stands where there is no figure.
NO_FIGURE = "\N{EN DASH}"
#: Values that print as 0: rounding.
_ROUNDING = 1e-9


def page_environment(names: Sequence[str], *folders: Path) -> Any:
    """Return jinja2's environment for a page, with filters that show values and names.

    Args:
        names: of joints and drives; what all begin and end with is left out, and said once.
        folders: of templates, beside that of the style.

    Raises:
        PinfricError: the extra `report` (jinja2) is not installed.
    """
    jinja2 = needed("jinja2")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, Path(__file__).parent]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    ends = affixes(names)
    short = dict(zip(names, without(names, *ends), strict=True))
    environment.filters.update(
        digits=figure,
        percent=percent,
        table=lambda table: _table(table, *ends),
        short=lambda text: _said(said_short(text, short)),
    )
    environment.globals.update(left_out=left_out(*ends), version=__version__)
    return environment


def _table(table: Table | None, front: str, back: str) -> Any:
    if table is None:
        return ""
    return import_module("markupsafe").Markup(html_of(table.without(front, back)))


def _said(text: str) -> Any:
    """Text as HTML, with what stands in `backticks` as code."""
    markup = import_module("markupsafe")
    return markup.Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(markup.escape(text))))


def figure(x: float | None) -> str:
    """Return a value with three digits, a dash for None."""
    if x is None:
        return NO_FIGURE
    if np.isinf(x):
        return "\N{INFINITY}"
    return digits(x) if abs(x) > _ROUNDING else "0"


def percent(x: float | None) -> str:
    """Return a margin as tables print it, with a true minus sign, a dash for None."""
    return NO_FIGURE if x is None else percentage(x).replace("-", "\N{MINUS SIGN}")


def needed(module: str) -> Any:
    """Import a module of the extra `report`, or say how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise PinfricError(
            f"a page needs {module.partition('.')[0]}: pip install 'pinfric[report]'"
        ) from None
