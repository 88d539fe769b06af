"""Tables of described results: a row each, a column for every field with a heading."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from enum import Enum, IntEnum
from string import Formatter
from typing import Any, NamedTuple

from pinfric.model.described import EFFORT, Quantity, quantities, unit_of
from pinfric.show.report.tables import Column, ColumnKind, Table
from pinfric.show.report.values import digits, percent, percentage, power_of_ten, signed

#: Units of people: how many of them an SI unit has.
DISPLAYS = {"mm": 1e3, "arcmin": 60 * 180 / math.pi, "ms": 1e3, "us": 1e6}
#: Words up to this length are not wrapped.
_LABEL = 20
#: Values that are shown in words.
_WORDY = (str, bool, list, Mapping, Enum)
#: What stands in place of no figure.
NONE = "-"
#: So small beside the largest of its column a figure is rounding's square: 3e-29 W beside 50 W.
_ROUNDING = 1e-24


def table_of(
    title: str,
    rows: Sequence[Any],
    *,
    only: Collection[str] = (),
    without: Collection[str] = (),
    cells: Mapping[str, Callable[[Any], str]] | None = None,
    zero: float | Callable[[Any], float] = 0.0,
    **layout: Any,
) -> Table | None:
    """Return the table of described rows of one class; None without rows.

    Columns without any value are left out; efforts' unit is in the headings if all rows share it,
    else in a column of its own.

    Args:
        only: fields to show, also without a heading; none: all with one.
        without: fields to leave out.
        cells: field -> what it shows of a row, in place of its own cell.
        zero: efforts up to this print as 0; a number, or of a row. Without efforts it is for all
            figures.
    """
    if not rows:
        return None
    shown = [
        column
        for name, field in shown_fields(rows)
        if name not in without and (name in only or (field.heading and not only))
        if (column := _column(rows, name, field, (cells or {}).get(name), zero)) is not None
    ]
    # One unit of all numbers stands in the title
    units = [column.unit for column in shown if column.kind is ColumnKind.NUMBER]
    if title and len(units) > 1 and len(set(units)) == 1 and (of_all := units[0]):
        title = f"{title}, {of_all}"
        shown = [c._replace(unit="" if c.unit == of_all else c.unit) for c in shown]
    columns = [Column(heading(c.heading, c.unit), c.kind) for c in shown]
    by_unit = len(columns) > 1 and columns[1].heading.endswith("unit")
    keys = layout.pop("keys", 2 if by_unit else 1)
    texts = list(zip(*(c.texts for c in shown), strict=True))
    return Table(title, columns, texts, keys=keys, **layout)


class _Shown(NamedTuple):
    """A column: heading and unit, its kind, a text for each row."""

    heading: str
    unit: str
    kind: ColumnKind
    texts: list[str]


def _column(
    rows: Sequence[Any],
    name: str,
    field: Quantity,
    write: Callable[[Any], str] | None,
    zero: float | Callable[[Any], float],
) -> _Shown | None:
    """Return a field's column; None if it is empty. Arguments as of `table_of`."""
    values = [value_at(row, name) for row in rows]
    if field.heading.endswith("unit") and len(set(values)) == 1:
        return None
    if write is not None:
        texts = [write(row) for row in rows]
    else:
        is_effort = field.unit in ("", EFFORT) or not hasattr(rows[0], "unit")
        sizes = [abs(x) for x in values if isinstance(x, int | float) and math.isfinite(x)]
        rounding = _ROUNDING * max(sizes, default=0.0)
        small = zero if is_effort or field.unit.startswith("in ") else rounding
        texts = [cell(row, name, field, small(row) if callable(small) else small) for row in rows]
        if set(texts) <= {NONE, "", "n/a"}:
            return None
    return _Shown(field.heading, shown_unit(field, rows), kind(field, values, texts), texts)


def shown_fields(rows: Sequence[Any]) -> Iterator[tuple[str, Quantity]]:
    """Yield the columns of described rows: names as `value_at` takes them, and their descriptions.

    A part whose heading ends with "*" gives its fields, a mapping a column for each of its keys.
    """
    for name, field in quantities(type(rows[0])).items():
        above = field.heading.removesuffix("*").rstrip()
        if field.heading.endswith("*"):
            parts = [part for row in rows if (part := getattr(row, name)) is not None]
            for inner, column in shown_fields(parts) if parts else ():
                text = (column.cell or f"{{{inner}}}").replace("{", f"{{{name}.")
                head = f"{above}\n{column.heading}" if above and column.heading else column.heading
                unit = column.unit or field.unit
                yield f"{name}.{inner}", column._replace(cell=text, heading=head, unit=unit)
        elif "{}" in field.heading:
            for key in dict.fromkeys(key for row in rows for key in getattr(row, name)):
                path = f"{name}[{key}]"
                text = f"{{{path}{field.cell}}}"
                yield path, field._replace(heading=field.heading.format(key), cell=text)
        else:
            yield name, field


def value_at(row: Any, path: str) -> Any:
    """Return a field of a row: `peak`, of a part `error.rms`, of a mapping `shares[elbow]`.

    None if the part is None, or the mapping lacks the key.
    """
    name, _, key = path.partition("[")
    value = row
    for step in name.split("."):
        value = None if value is None else getattr(value, step)
    return value if not key or value is None else value.get(key.removesuffix("]"))


def shown_unit(field: Quantity, rows: Sequence[Any]) -> str:
    """Return the unit of a column's cells; empty if rows differ, or none is shown."""
    spec = next((s for _, n, s, _ in Formatter().parse(field.cell) if n and s), "")
    if spec in DISPLAYS or spec in ("%", "percent", "margin"):
        return spec if spec in DISPLAYS else ""
    units = {unit_of(row, field.unit) for row in rows}
    by_row = field.unit == EFFORT or field.unit.startswith("in ")
    return units.pop() if len(units) == 1 else "" if by_row else field.unit


def heading(text: str, unit: str) -> str:
    """Return a column's heading, its unit in the last line."""
    if text.endswith("±") and unit:
        return f"{text[:-1].rstrip()}\n± {unit}"
    return f"{text}\n{unit}" if unit else text


def kind(field: Quantity, values: Sequence[Any], texts: Sequence[str]) -> ColumnKind:
    """Return a column's kind: numbers, names, short words or long ones.

    Args:
        texts: what the column shows of its values.
    """
    if field.name:
        return ColumnKind.NAME
    known = [value for value in values if value is not None]
    said = all(text[:1].isalpha() for text in texts)  # "moves" of a number
    if not said and not any(isinstance(x, _WORDY) or _words(x) for x in known):
        return ColumnKind.NUMBER
    lines = [line for text in texts for line in text.split("\n")]
    return ColumnKind.LABEL if all(len(line) <= _LABEL for line in lines) else ColumnKind.WORDS


def _words(value: Any) -> bool:
    return isinstance(value, tuple) and all(isinstance(entry, str) for entry in value)


def cell(row: Any, name: str, field: Quantity, zero: float = 0.0) -> str:
    """Return what a field's column shows of one row."""
    parts = list(Formatter().parse(field.cell or f"{{{name}}}"))
    values = [value_at(row, path) for _, path, _, _ in parts if path]
    if values[0] is None:
        return NONE
    specs = [spec or "" for _, path, spec, _ in parts if path]
    texts = [text_of(value, spec, zero) for value, spec in zip(values, specs, strict=True)]
    if len(set(texts)) == 1 and any("\N{EN DASH}" in literal for literal, *_ in parts):
        return texts[0]
    filled = iter(texts)
    return "".join(text + (next(filled) if path else "") for text, path, _, _ in parts)


def text_of(value: Any, display: str = "", zero: float = 0.0) -> str:
    """Return one value as tables show it.

    Args:
        value: a number, words, a pair of least and worst, None.
        display: its unit for people, of `DISPLAYS` or "%"; "percent" for a small share, "margin"
            for the rest of a limit, "+" with a sign, "decade" as 3.7e-5; or a format of Python:
            ".2f".
        zero: values up to this print as 0.
    """
    if value is None:
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, IntEnum):
        return value.name.lower()
    if isinstance(value, str | Enum):
        return str(value)
    if isinstance(value, tuple) and len(value) == 2 and not _words(value):
        ends = [text_of(x, display, zero) for x in value]
        return "\N{EN DASH}".join(dict.fromkeys(ends))
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value))
    if display == "%":
        return f"{100 * value:.0f} %" if math.isfinite(value) else "n/a"
    if display == "margin":
        return percentage(value)
    if display == "percent":
        return percent(value)
    if display == "+":
        return signed(value, zero)
    if display == "decade":
        return "0" if value == 0 else power_of_ten(value, 1) if math.isfinite(value) else "n/a"
    if isinstance(value, int):
        return str(value)
    if display in ("", *DISPLAYS):
        return digits(DISPLAYS.get(display, 1.0) * value, DISPLAYS.get(display, 1.0) * zero)
    return format(value, display) if math.isfinite(value) else "n/a"


def flat(row: Any) -> dict[str, Any]:
    """Return a described row as columns of a DataFrame: its numbers and words.

    A pair of least and worst makes two columns, `_least` and `_worst`; a described part its own.
    """
    columns: dict[str, Any] = {}
    for name in quantities(type(row)):
        value = getattr(row, name)
        if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], float):
            columns |= {f"{name}_least": value[0], f"{name}_worst": value[1]}
        elif is_dataclass(value):
            columns |= {f"{name}_{key}": entry for key, entry in flat(value).items()}
        elif isinstance(value, IntEnum):
            columns[name] = value.name.lower()
        elif value is None or isinstance(value, str | bool | int | float):
            columns[name] = value
    return columns
