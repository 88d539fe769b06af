"""Catalogues as engineers have them: a table with one row per motor or gear, read by a mapping.

A number may bring its own unit ("224 mN m"), which then goes before the mapping's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import model_validator

from pinfric.drives.catalog import SECTIONS, Text
from pinfric.drives.sourced import Sourced
from pinfric.drives.units import cells_of, in_si, unit_of
from pinfric.errors import CatalogError, PinfricError, choose_from
from pinfric.model.csv_text import read_table
from pinfric.model.entry import Entry, Forms, key, optional, parse
from pinfric.model.files import write_file
from pinfric.model.yamlfile import brief, read_yaml, yaml_text

if TYPE_CHECKING:
    _Section = str
else:  # words of the schema
    _Section = Literal[tuple(SECTIONS)]
#: What a cell says instead of nothing, in any case.
_NOTHING = {
    *("", "-", "--", "\N{EN DASH}", "\N{EM DASH}", "n/a", "na", "n.a.", "nan", "none", "null"),
    *("?", "tbd", "inf", "+inf", "-inf", "infinity"),
}
_NUMBER = re.compile(r"([-+]?[.,]?\d(?:[\d.,]|'(?=\d))*(?:[eE][-+]?\d+)?)\s*(.*)", re.A)
#: A gear's ratio as two numbers; a voltage from here to there, of which the lower counts.
_RATIO = re.compile(r"(\d+(?:[.,]\d+)?)\s*[:/]\s*(\d+(?:[.,]\d+)?)", re.A)
_RANGE = re.compile(
    r"(\d+(?:[.,]\d+)?)\s*(?:-|~|\.{2,3}|\N{EN DASH}|\N{HORIZONTAL ELLIPSIS}|to)\s*"
    r"(\d+(?:[.,]\d+)?)\s*([^\d\s].*)?",
    re.A,
)
#: A number whose marks may separate thousands, and nothing else if there are several.
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+|[-+]?[1-9]\d{0,2}(?:\.\d{3})+", re.A)


class Cells(Entry):
    """A column, and the unit of its numbers where they do not say it themselves."""

    column: Text = key("its name in line 1 of the table", "Mn")
    unit: Text | None = optional("of its numbers", "mN m")


class TableMapping(Entry):
    """A mapping file: the column of a table for each key of an entry."""

    section: _Section = key("kind of the rows", "motors")
    columns: dict[str, Annotated[str | Cells, Forms(Text, Cells)]] = key(
        "key of the entry (`thermal.NAME`, `bearing.NAME` for keys of a part, "
        "`stand_ins.NAME` for the product that a value is taken from): its column, or column "
        "and unit",
        {"name": "Type", "mass": {"column": "Weight", "unit": "g"}},
    )
    every: dict[str, Any] = key(
        "values that are the same for all rows, SI",
        {"source": "a catalogue", "grade": "R"},
        default_factory=dict,
    )

    @model_validator(mode="after")
    def _figures_exist(self) -> TableMapping:
        known = ["name", *cells_of(SECTIONS[self.section])]
        for figure in self.columns:
            if figure.removeprefix("stand_ins.") not in known:
                raise ValueError(f"unknown figure `{figure}`; {choose_from(figure, known)}")
        if "name" not in self.columns:
            raise ValueError("`name`: which column has the names?")
        return self


@dataclass(frozen=True)
class ImportedTable:
    """A table as a catalogue, and how it was understood.

    Attributes:
        section: kind of the rows. entries: by name.
        content: the catalogue, as its YAML file holds it.
        first: of the first row that was read: column, figure, text of the cell, value in SI, unit.
        unused: columns that the mapping does not name.
        left_out: rows that cannot be, each with its line and why.
    """

    section: str
    entries: dict[str, Sourced]
    content: dict[str, Any]
    first: tuple[tuple[str, str, str, str, str], ...]
    unused: tuple[str, ...]
    left_out: tuple[str, ...]


def import_table(table: str | Path, mapping: str | Path | None = None) -> ImportedTable:
    """Return a CSV table with one row per entry as a catalogue.

    Left out and named is a row with a number without unit or of the wrong quantity, ratings that
    contradict each other, or a name given twice.

    Args:
        table: CSV (comma, semicolon or tab), names in line 1; all its numbers together tell whether
            commas or points are decimal.
        mapping: its mapping file; None takes TABLE.columns.yaml beside it.

    Raises:
        CatalogError: unreadable, a column that is not there, decimal commas beside decimal points,
            or no row that can be read.
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
    delimiter, names, lines = read_table(path, CatalogError)
    for figure, given in cells.items():
        if given.column not in names:
            raise CatalogError(
                f"{where}: columns.{figure}: {path.name} has no column "
                f"{given.column!r}; {choose_from(given.column, names)}"
            )
    rows = [(n, dict(zip(names, row + [""] * len(names), strict=False))) for n, row in lines]
    if not rows:
        raise CatalogError(f"{path}: no rows below the names of its columns")
    kind = SECTIONS[wanted.section]
    of_rows = cells_of(kind)
    numbers = [given.column for figure, given in cells.items() if of_rows.get(figure)]
    mark = _decimal_mark(path, delimiter, (row[column] for _, row in rows for column in numbers))
    entries: dict[str, Sourced] = {}
    content: dict[str, Any] = {}
    plan = [(figure, cells[figure]) for figure in sorted(cells, key=lambda x: x != "ratio")]
    first: tuple[tuple[str, str, str, str, str], ...] = ()
    problems = []
    for line, row in rows:
        name = row[cells["name"].column]
        entry, made, units, wrong = _entry(row, plan, wanted, mark)
        if not name or name in entries:
            wrong.insert(0, "this name is given twice" if name else "no name")
        if wrong or made is None:
            problems.append(f"line {line} ({name or 'no name'}): {'; '.join(wrong)}")
            continue
        content[name], entries[name] = entry, made
        first = first or _understood(row, cells, entry, units)
    if not entries:
        read = ", ".join(f"{given.column} as {figure}" for figure, given in cells.items())
        raise CatalogError(
            f"{path}: {'its row cannot' if len(rows) == 1 else f'none of its {len(rows)} rows can'}"
            f" be read: {problems[0]}; understood were the columns {read}"
        )
    used = {given.column for given in cells.values()}
    unused = tuple(name for name in names if name and name not in used)
    return ImportedTable(
        wanted.section,
        entries,
        {"pinfric_catalog": 1, wanted.section: content},
        first,
        unused,
        tuple(problems),
    )


def mapping_of(table: Path) -> Path:
    """Return where a table's mapping file lies if none is named."""
    return table.with_name(f"{table.stem}.columns.yaml")


def write_catalog(content: dict[str, Any], path: str | Path, origin: str = "") -> Path:
    """Write a catalogue's content as a YAML file that `load_catalog` reads.

    Args:
        content: of `import_table`. origin: for its first line.

    Raises:
        PinfricError: it cannot be written.
    """
    head = f"# Imported from {origin}: SI units.\n" if origin else ""
    return write_file(path, head + yaml_text(content))


def _decimal_mark(path: Path, delimiter: str, texts: Iterable[str]) -> str:
    """Return the decimal mark of a table's numbers, or "" where they do not tell.

    Of two kinds of mark in a number the last is decimal, a repeated one is not; a single one is,
    unless it may separate thousands ("3,000"). Points are, where commas separate cells.
    """
    seen: dict[str, str] = {}
    for text in texts:
        points, commas = text.count("."), text.count(",")
        known = (points <= 1 and not commas and "." in seen) or not points + commas
        if known or (match := _NUMBER.fullmatch(text)) is None:
            continue
        marks = re.findall("[.,]", match[1])
        if marks and (len(set(marks)) == 2 or not _THOUSANDS.fullmatch(match[1])):
            seen.setdefault(marks[-1], text)
        elif len(marks) > 1:
            seen.setdefault("," if marks[0] == "." else ".", text)
    if len(seen) == 2:
        raise CatalogError(
            f"{path}: {seen[',']!r} has a decimal comma and {seen['.']!r} a decimal point: give "
            "one of them to all numbers"
        )
    return next(iter(seen), "." if delimiter == "," else "")


def _entry(
    row: dict[str, str], plan: list[tuple[str, Cells]], wanted: TableMapping, mark: str
) -> tuple[dict[str, Any], Sourced | None, dict[str, str], list[str]]:
    """Return a row as of a file and as an entry, its figures' SI units, and what is wrong with it.

    `plan` has the ratio first: it says what turns.
    """
    every = wanted.every.items()  # each row adds to its parts
    entry: dict[str, Any] = {k: dict(v) if isinstance(v, dict) else v for k, v in every}
    kind, units, problems = SECTIONS[wanted.section], dict[str, str](), list[str]()
    output, made = wanted.columns.get("output"), None
    column = output.column if isinstance(output, Cells) else output
    linear = (row[column] if column else entry.get("output")) == "linear"
    for figure, given in plan:
        text, value = row[given.column], None
        if text.lower() in _NOTHING or figure == "name":
            continue
        try:
            screw = figure == "rotor_inertia" and entry.get("ratio", 1.0) != 1.0
            words = figure.startswith("stand_ins.")
            unit = units[figure] = "" if words else unit_of(kind, figure, linear and not screw)
            value = _figure(text, given.unit, unit, mark) if unit else text
        except CatalogError as problem:
            problems.append(f"{figure}: {problem}")
        nested, _, key = figure.rpartition(".")
        (entry.setdefault(nested, {}) if nested else entry)[key] = value
    try:
        made = parse(kind, {k: v for k, v in entry.items() if v is not None}, "")
    except PinfricError as problem:
        problems.append(str(problem).removeprefix(": "))
    return entry, made, units, problems


def _understood(
    row: dict[str, str], cells: dict[str, Cells], entry: dict[str, Any], units: dict[str, str]
) -> tuple[tuple[str, str, str, str, str], ...]:
    """See `ImportedTable.first`."""
    understood = []
    for figure, given in cells.items():
        nested, _, key = figure.rpartition(".")
        value = (entry.get(nested, {}) if nested else entry).get(key)
        shown = f"{value:.4g}" if isinstance(value, float) else ""
        cell, number = row[given.column], _NUMBER.fullmatch(row[given.column])
        if given.unit and (number is None or not number[2]):  # a cell's own unit goes before it
            cell = f"{cell} {given.unit}".strip()
        understood.append(
            (given.column, figure, cell, shown, units.get(figure, "") if shown else "")
        )
    return tuple(understood)


def _figure(text: str, unit: str | None, wanted: str, mark: str) -> float:
    """A cell's number in SI; its own unit goes before the mapping's."""
    if wanted in ("1", "rad/m") and (ratio := _RATIO.fullmatch(text)):
        ends = [_figure(end, "1", "1", mark or ".") for end in ratio.groups()]
        return max(ends) / min(ends) if min(ends) else 0.0
    if wanted == "V" and (span := _RANGE.fullmatch(text)):
        least = min(span[1], span[2], key=lambda end: float(end.replace(",", ".")))
        text = f"{least} {span[3] or ''}"
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
    given = own.strip() or unit or ("1" if wanted == "1" else "price" if wanted == "price" else "")
    if not given:
        raise CatalogError(f"{text} has no unit: give it in the mapping, or beside the number")
    return in_si(value, given, wanted)
