"""Catalogues as engineers have them: a table with one row per motor or gear, read by a mapping.

A number may bring its own unit ("224 mN m"), which then goes before the mapping's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from pinfric.drives.catalog import (
    BearingEntry,
    Brake,
    Gear,
    GearMotor,
    Motor,
    Sourced,
    Text,
)
from pinfric.drives.units import cells_of, in_si, unit_of
from pinfric.errors import CatalogError, PinfricError, choose_from
from pinfric.model.csv_text import read_table
from pinfric.model.entry import Entry, Forms, key, parse
from pinfric.model.files import write_file
from pinfric.model.yamlfile import brief, read_yaml, yaml_text

_SECTIONS: dict[str, type[Sourced]] = {
    "motors": Motor,
    "gears": Gear,
    "gearmotors": GearMotor,
    "bearings": BearingEntry,
    "brakes": Brake,
}
#: What a cell says instead of nothing.
_NOTHING = ("", "-", "\N{EN DASH}", "\N{EM DASH}", "n/a", "N/A")
_NUMBER = re.compile(r"([-+]?[.,]?\d[\d.,']*(?:[eE][-+]?\d+)?)\s*(.*)")
#: A number whose marks may separate thousands, and nothing else if there are several.
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+|[-+]?[1-9]\d{0,2}(?:\.\d{3})+")


class Cells(Entry):
    """A column, and the unit of its numbers where they do not say it themselves."""

    column: Annotated[Text, key("its name in line 1 of the table", "Mn")]
    unit: Annotated[Text | None, key("of its numbers", "mN m")] = None


class TableMapping(Entry):
    """A mapping file: the column of a table for each key of an entry."""

    section: Annotated[
        Literal["motors", "gears", "gearmotors", "bearings", "brakes"],
        key("kind of the rows", "motors"),
    ]
    columns: Annotated[
        dict[str, Annotated[str | Cells, Forms(Text, Cells)]],
        key(
            "key of the entry (`thermal.NAME`, `bearing.NAME` for keys of a part, "
            "`stand_ins.NAME` for the product that a value is taken from): its column, or column "
            "and unit",
            {"name": "Type", "mass": {"column": "Weight", "unit": "g"}},
        ),
    ]
    every: Annotated[
        dict[str, Any],
        key("values that are the same for all rows, SI", {"source": "a catalogue", "grade": "R"}),
    ] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _figures_exist(self) -> TableMapping:
        known = ["name", *cells_of(_SECTIONS[self.section])]
        for figure in self.columns:
            if figure.removeprefix("stand_ins.") not in known:
                raise ValueError(f"unknown figure `{figure}`; {choose_from(figure, known)}")
        if "name" not in self.columns:
            raise ValueError("`name`: which column has the names?")
        return self


def import_table(table: str | Path, mapping: str | Path | None = None) -> dict[str, Any]:
    """Return the catalogue, as its YAML file holds it, of a CSV table with one row per entry.

    Args:
        table: CSV (comma, semicolon or tab), names in line 1; whether its commas or its points are
            decimal is told by all its numbers together.
        mapping: its mapping file; None takes TABLE.columns.yaml beside it.

    Raises:
        CatalogError: unreadable, a column that is not there; or rows that cannot be, all of them
            named: numbers without unit, of the wrong quantity, ratings that contradict each other;
            decimal commas beside decimal points.
    """
    path = Path(table)
    where = Path(mapping) if mapping else mapping_of(path)
    if path.is_file() and not where.is_file():
        raise CatalogError(
            f"there is no file {where}: it says which column of {path.name} is which figure, and "
            "its unit (`pinfric schema table` has its format); write it, or name it by --columns"
        )
    if not path.is_file():
        raise CatalogError(f"there is no file {path}")
    try:
        wanted: TableMapping = parse(TableMapping, read_yaml(where, CatalogError), str(where))
    except PinfricError as problem:
        raise CatalogError(str(problem)) from None
    cells = {
        figure: given if isinstance(given, Cells) else Cells(column=given)
        for figure, given in wanted.columns.items()
    }
    entries: dict[str, Any] = {}
    delimiter, names, lines = read_table(path, CatalogError)
    for figure, given in cells.items():
        if given.column not in names:
            raise CatalogError(
                f"{where}: columns.{figure}: {path.name} has no column "
                f"{given.column!r}; {choose_from(given.column, names)}"
            )
    rows = [(n, dict(zip(names, row + [""] * len(names), strict=False))) for n, row in lines]
    of_rows = cells_of(_SECTIONS[wanted.section])
    numbers = [given.column for figure, given in cells.items() if of_rows.get(figure)]
    mark = _decimal_mark(path, delimiter, (row[column] for _, row in rows for column in numbers))
    problems = []
    for line, row in rows:
        name = row[cells["name"].column]
        found = list(_row_problems(name, row, cells, wanted, entries, mark))
        problems += [f"line {line} ({name or 'no name'}): {'; '.join(found)}"] if found else []
    if problems:
        raise CatalogError(
            f"{path}: {len(problems)} of {len(rows)} rows cannot be: " + " | ".join(problems)
        )
    if not entries:
        raise CatalogError(f"{path}: no rows below the names of its columns")
    return {"pinfric_catalog": 1, wanted.section: entries}


def mapping_of(table: Path) -> Path:
    """Return where a table's mapping file lies if none is named."""
    return table.with_name(f"{table.stem}.columns.yaml")


def write_catalog(content: dict[str, Any], path: str | Path, origin: str = "") -> Path:
    """Write a catalogue's content as a YAML file that `load_catalog` reads.

    Args:
        content: of `import_table`. path: the file. origin: for its first line.

    Raises:
        PinfricError: it cannot be written.
    """
    head = f"# Imported from {origin}: SI units.\n" if origin else ""
    return write_file(
        path, lambda file: file.write_text(head + yaml_text(content), encoding="utf-8")
    )


def _decimal_mark(path: Path, delimiter: str, texts: Iterable[str]) -> str:
    """Return the decimal mark of a table's numbers, or "" where they do not tell.

    Of two kinds of mark in a number the last is decimal, one that is repeated is not; a single one
    is, unless it may as well separate thousands ("3,000"). Points are, where commas separate cells.
    """
    found: dict[str, str] = {}
    for text in texts:
        if (match := _NUMBER.fullmatch(text)) is None:
            continue
        marks = re.findall("[.,]", match[1])
        if marks and (len(set(marks)) == 2 or not _THOUSANDS.fullmatch(match[1])):
            found.setdefault(marks[-1], text)
        elif len(marks) > 1:
            found.setdefault("," if marks[0] == "." else ".", text)
    if len(found) == 2:
        raise CatalogError(
            f"{path}: {found[',']!r} has a decimal comma and {found['.']!r} a decimal point: give "
            "one of them to all numbers"
        )
    return next(iter(found), "." if delimiter == "," else "")


def _row_problems(
    name: str,
    row: dict[str, str],
    cells: dict[str, Cells],
    wanted: TableMapping,
    entries: dict[str, Any],
    mark: str,
) -> Iterator[str]:
    """Put a row's entry into `entries`; yield what is wrong with it."""
    entry: dict[str, Any] = deepcopy(wanted.every)  # its parts, too: each row adds its own
    linear = (row[cells["output"].column] if "output" in cells else entry.get("output")) == "linear"
    if not name or name in entries:
        yield "this name is given twice" if name else "no name"
    for figure in sorted(cells, key=lambda figure: figure != "ratio"):  # it says what turns
        given = cells[figure]
        text, value = row[given.column], None
        if text in _NOTHING or figure == "name":
            continue
        try:
            screw = figure == "rotor_inertia" and entry.get("ratio", 1.0) != 1.0
            kind = _SECTIONS[wanted.section]
            words = figure.startswith("stand_ins.")
            unit = "" if words else unit_of(kind, figure, linear and not screw)
            value = _figure(text, given.unit, unit, mark) if unit else text
        except CatalogError as problem:
            yield f"{figure}: {problem}"
        part, _, key = figure.rpartition(".")
        (entry.setdefault(part, {}) if part else entry)[key] = value
    try:
        parse(_SECTIONS[wanted.section], {k: v for k, v in entry.items() if v is not None}, "")
    except PinfricError as problem:
        yield str(problem).removeprefix(": ")
    entries[name] = entry


def _figure(text: str, unit: str | None, wanted: str, mark: str) -> float:
    """A cell's number in SI; its own unit goes before the mapping's."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise CatalogError(f"should be a number, found {brief(text)}")
    digits, own = match[1].replace("'", ""), match[2]
    if not mark and re.search("[.,]", digits):
        raise CatalogError(
            f"{brief(text)} has a decimal mark or one of thousands, and no number of the table "
            "tells which: write thousands without a mark"
        )
    try:
        value = float(digits.replace("," if mark == "." else ".", "").replace(",", "."))
    except ValueError:
        raise CatalogError(f"should be a number, found {brief(text)}") from None
    given = own or unit or ("1" if wanted == "1" else "price" if wanted == "price" else "")
    if not given:
        raise CatalogError(f"{text} has no unit: give it in the mapping, or beside the number")
    return in_si(value, given, wanted)
