"""Figures, found by the result that they draw: `pf.plot`, `--out` and pages ask `figures_of`.

A new one is a function in a module of this folder, with `draws` above it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from pinfric.errors import StateError, choose_from
from pinfric.model.neighbours import import_neighbours


@dataclass(frozen=True)
class ResultFigure:
    """A figure of a result.

    Attributes:
        result: what it draws.
        name: of its files with `--out`, and in `pf.plot(result, figure=name)`.
        title: above it on the result's page; empty: the page lacks it.
        one: it draws one joint or drive, whose number follows the result.
        draw: makes it of a result and options; None: the result lacks what it would show.
    """

    result: type
    name: str
    title: str
    one: bool
    draw: Callable[..., Any]


_Draw = TypeVar("_Draw", bound=Callable[..., Any])
_KNOWN: list[ResultFigure] = []


def draws(
    result: type, name: str, title: str = "", *, one: bool = False
) -> Callable[[_Draw], _Draw]:
    """Make a function a figure of a kind of result; see `ResultFigure`."""

    def register(draw: _Draw) -> _Draw:
        _KNOWN.append(ResultFigure(result, name, title, one, draw))
        return draw

    return register


def known() -> list[ResultFigure]:
    """Return the figures of all results, those of a module in its order."""
    import_neighbours(__name__)
    return _KNOWN


def figures_of(result: Any, *, one: bool = False) -> list[ResultFigure]:
    """Return the figures of a result: of all together, or those of one joint or drive."""
    return [each for each in known() if isinstance(result, each.result) and each.one == one]


def figure_of(result: Any, name: str = "") -> ResultFigure:
    """Return the figure of a result with a name; without one, the first of all together.

    Raises:
        StateError: there is none.
    """
    found = figures_of(result) + figures_of(result, one=True)
    if not found:
        kinds = ", ".join(dict.fromkeys(each.result.__name__ for each in known()))
        raise StateError(f"a {type(result).__name__} has no picture; these have one: {kinds}")
    for each in found:
        if name in ("", each.name):
            return each
    names = [each.name for each in found]
    kind = type(result).__name__
    raise StateError(f"figure: a {kind} has no {name!r}; {choose_from(name, names)}")
