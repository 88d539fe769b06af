"""The reproduction of the paper as a table: ours beside what is printed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pinfric.study.paper import READINGS, LiteralReading, Reproduction

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table


def paper_report(found: Sequence[Reproduction]) -> list[RenderableType]:
    """Return what `pinfric paper` prints: the paper's claims, one row each, ours beside its."""
    from rich.text import Text

    table = _table("Park, Yoo, Hwang, Bae: both examples", [r.example.name for r in found])
    rows = {
        "sticks, printed": [_span(r.example.printed, 3) for r in found],
        "sticks, reduced formulation": [_span(r.stick, 6) for r in found],
        "sticks, absolute formulation": [_span(r.stick_absolute, 6) for r in found],
        "recovered torque outside stiction: largest error": [
            f"{r.max_torque_error:.1e} N m" for r in found
        ],
        "stick samples whose interval brackets the torque": [
            f"{100 * r.bracketed:.0f} %" for r in found
        ],
        "width of the interval - 2 mu_s c: largest": [
            f"{r.max_width_error:.1e} N m" for r in found
        ],
        "reduced against absolute: efforts, loads, reactions": [
            f"{r.max_formulation_difference:.1e}" for r in found
        ],
    }
    for name, cells in rows.items():
        table.add_row(name, *cells)
    readings = [Text(f"- {reading}") for reading in READINGS]
    return [
        table,
        Text(),
        Text("The printed data are ambiguous in three places. Used here, because it fits:"),
        *readings,
        Text("`--reading literal` shows what the data give as they are printed."),
    ]


def literal_report(found: Sequence[LiteralReading]) -> list[RenderableType]:
    """Return what `pinfric paper --reading literal` prints."""
    from rich.text import Text

    table = _table("the data as printed", [r.example.name for r in found])
    table.add_row("sticks, printed", *(_span(r.example.printed, 3) for r in found))
    table.add_row("first stick", *(_span(r.stick, 4) for r in found))
    stops = ["never" if r.stops_at is None else f"{r.stops_at:.4f} s" for r in found]
    table.add_row("neither stick nor slip is consistent at", *stops)
    return [
        table,
        Text(),
        Text(
            "Static friction 0.30 below kinetic 0.35, and the pendulum's J about O: the joint "
            "sticks earlier than printed, and when the static limit is reached, no motion obeys "
            "the laws: sliding would meet more friction than held it. The simulation stops there."
        ),
    ]


def _table(title: str, names: Sequence[str]) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD,
        pad_edge=False, padding=(0, 2, 0, 0), show_edge=False,
    )  # fmt: skip
    table.add_column("")
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _span(span: tuple[float, float], decimals: int) -> str:
    return f"{span[0]:.{decimals}f}-{span[1]:.{decimals}f} s"
