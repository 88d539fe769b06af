"""The reproduction of the paper as a table, beside the printed results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pinfric.paper.reproduction import CLOSED_LOOP, READINGS, LiteralReading, Reproduction
from pinfric.show.report.tables import Column, ColumnKind, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


def paper_report(examples: Sequence[Reproduction], loop_difference: float) -> list[RenderableType]:
    """Return what `pinfric paper` prints: a row for each of the paper's claims."""
    from rich.text import Text

    rows = {
        "sticks, printed": [_span(r.example.printed, 3) for r in examples],
        "sticks, reduced formulation": [_span(r.stick, 6) for r in examples],
        "sticks, absolute formulation": [_span(r.stick_absolute, 6) for r in examples],
        "recovered torque outside stiction: largest error": [
            f"{r.max_torque_error:.1e} N m" for r in examples
        ],
        "stick samples whose interval brackets the torque": [
            f"{100 * r.bracketed:.0f} %" for r in examples
        ],
        "width of the interval - 2 mu_s c: largest": [
            f"{r.max_width_error:.1e} N m" for r in examples
        ],
        "reduced against absolute: efforts, loads, reactions": [
            f"{r.max_formulation_difference:.1e}" for r in examples
        ],
    }
    names = [r.example.name for r in examples]
    table = _table("Park, Yoo, Hwang, Bae: both examples", names, rows)
    readings = [Text(f"- {reading}") for reading in READINGS]
    return [
        table,
        Text(
            f"{CLOSED_LOOP}, a closed loop with a translational joint, which the paper's equations "
            f"hold for, too: reduced against absolute {loop_difference:.1e}"
        ),
        Text(),
        Text("The printed data leave questions open. Used here, because it fits:"),
        *readings,
        Text("`--reading literal` shows what the data give as they are printed."),
    ]


def literal_report(readings: Sequence[LiteralReading]) -> list[RenderableType]:
    """Return what `pinfric paper --reading literal` prints."""
    from rich.text import Text

    rows = {
        "sticks, printed": [_span(r.example.printed, 3) for r in readings],
        "first stick": [_span(r.stick, 4) for r in readings],
        "neither stick nor slip is consistent at": [
            "never" if r.stops_at is None else f"{r.stops_at:.4f} s" for r in readings
        ],
    }
    table = _table("the data as printed", [r.example.name for r in readings], rows)
    return [
        table,
        Text(),
        Text(
            "Static friction 0.30 below kinetic 0.35, and the pendulum's J about O: the joint "
            "sticks earlier than printed, and when the static limit is reached, no motion obeys "
            "the laws: sliding would meet more friction than held it. The simulation stops there."
        ),
    ]


def _table(title: str, names: Sequence[str], rows: dict[str, list[str]]) -> Table:
    columns = (Column("", ColumnKind.WORDS), *map(Column, names))
    return Table(title, columns, [(claim, *cells) for claim, cells in rows.items()])


def _span(span: tuple[float, float], decimals: int) -> str:
    return f"{span[0]:.{decimals}f}-{span[1]:.{decimals}f} s"
