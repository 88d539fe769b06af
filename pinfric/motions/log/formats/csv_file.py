"""CSV files as robots and their tools write them.

Commas, semicolons, tabs or spaces separate cells; a comma is decimal where it cannot separate; the
file may be gzipped. pandas reads it in parts; a small or unusual file (comments, empty lines, torn
rows, cells that are no numbers) is read line by line.
"""

from __future__ import annotations

import csv
import gzip
import math
import re
import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import TrajectoryError
from pinfric.model.arrays import FloatArray
from pinfric.model.brief import counted
from pinfric.model.csv_text import cells_of, number_of, separator_of
from pinfric.model.yamlfile import NOT_UTF_8, brief_path
from pinfric.motions.joint_columns import listing
from pinfric.motions.log.formats.registry import opens
from pinfric.motions.log.frame import (
    EXACT,
    LogFrame,
    OpenedLog,
    RawRows,
    check_size,
    usable_rows,
)

#: Rows looked at to see how many digits a file prints.
_ROWS_FOR_DIGITS = 500
#: Characters at a file's start that say how it is written; rows that pandas reads at a time.
_HEAD, _PART = 2**16, 2**16
#: Bytes of a small file; bytes of a line that is none.
_SMALL, _LONG = 2**20, 2**20
#: A stamp of ISO 8601 with its zone: 2026-11-22T10:00:00.25+01:00.
_ISO = re.compile(
    r"^(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d(?:[.,]\d{1,9})?)(?:Z|([+-])(\d\d):?(\d\d))?$"
)
#: Columns that name the joint of a row, in tables with one row a joint.
_JOINT_COLUMNS = {"joint", "joint_name", "name", "motor", "axis"}
#: Columns that tables of joint states number: `name_0`, `position[0]`.
_NUMBERED = re.compile(r"^(.*?)[_\[.]?(\d+)\]?$")
#: Rows by which a file is judged.
_JUDGED = 20


@dataclass(frozen=True)
class _Table:
    """How a file is written, and its rows, or the first of them.

    Args:
        lines: (rows,) of the rows in the file. rows: their texts. separator: of cells.
        comma: whether numbers have decimal commas.
        rewritten: the rows are not those of the file.
    """

    path: Path
    header: list[str]
    lines: list[int]
    rows: list[str]
    separator: str
    comma: bool
    notes: tuple[str, ...] = ()
    rewritten: bool = False

    @property
    def is_named(self) -> bool:
        """Whether columns hold names, by which each row must be read."""
        return any(
            (match := _NUMBERED.match(column)) and match[1].lower().endswith("name")
            for column in self.header
        )


@opens(".csv", ".tsv", ".txt", ".csv.gz")
def open_csv(path: Path) -> OpenedLog:
    """Open a CSV file, gzipped where it ends in .gz; only its first rows are read yet.

    Raises:
        TrajectoryError: unreadable, not text, empty, too large, or lines that cannot be split.
    """
    _check_size(path)
    table = _table(path, _numbered_lines(path, _HEAD))
    if table.is_named:
        table = _sorted_by_names(_table(path, _numbered_lines(path)))
    elif (place := _joint_place(table)) is not None:
        table = _one_row_a_time(_table(path, _numbered_lines(path)), place)
    in_memory = table.is_named or table.rewritten

    def read(names: Sequence[str], problems: list[str], may_lack: Collection[str]) -> LogFrame:
        in_parts = not in_memory and path.stat().st_size >= _SMALL
        raw = _read_in_parts(table, names) if in_parts else None
        if raw is None:
            whole = table if in_memory else _table(path, _numbered_lines(path))
            raw = _read_by_line(whole, names)
        return usable_rows(raw, problems, may_lack)

    first = cells_of(table.rows[0], table.separator)
    clocks = dict(zip(table.header, first, strict=False))
    units = {name: "ns" for name, cell in clocks.items() if _stamp(cell) is not None}
    return OpenedLog(table.header, read, first, notes=table.notes, units=units)


def _opened(path: Path, mode: str) -> Any:
    text = None if "b" in mode else "utf-8-sig"
    return (gzip.open if path.suffix.lower() == ".gz" else open)(path, mode, encoding=text)


@contextmanager
def _unreadable_said(path: Path) -> Iterator[None]:
    try:
        yield
    except UnicodeDecodeError:
        raise TrajectoryError(f"{path}: {NOT_UTF_8}") from None
    except (OSError, EOFError, zlib.error) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise TrajectoryError(f"{brief_path(path)}: cannot be read: {reason}") from None


def _check_size(path: Path) -> None:
    """Refuse what would fill the memory before reading it: see `check_size`."""
    lines = size = 0
    with _unreadable_said(path), _opened(path, "rb") as file:
        while chunk := file.read(_LONG):
            ends = max(chunk.count(b"\n"), chunk.count(b"\r"))
            if not ends and len(chunk) == _LONG:
                raise TrajectoryError(
                    f"{path}: line {lines + 1} has more than {_LONG:,} bytes; is this a table?"
                )
            lines, size = lines + ends, size + len(chunk)
            check_size(path, lines, inflated=size if path.suffix.lower() == ".gz" else 0)


def _read_in_parts(table: _Table, names: Sequence[str]) -> RawRows | None:
    """Return the rows of columns; None where something is unusual."""
    import pandas as pd

    first = cells_of(table.rows[0], table.separator)
    if len(first) != len(table.header):
        return None
    places = {table.header.index(name): name for name in names}
    origin = {
        name: int(first[place])
        for place, name in places.items()
        if first[place].isdigit() and int(first[place]) > EXACT
    }
    last = len(table.header) - 1  # which a row with fewer cells does not have
    parts = []
    try:
        with pd.read_csv(
            table.path,
            sep=r"\s+" if table.separator == " " else table.separator,
            decimal="," if table.comma else ".",
            header=None,
            skiprows=table.lines[0] - 1,
            skip_blank_lines=False,
            dtype={place: "int64" if name in origin else float for place, name in places.items()},
            quoting=csv.QUOTE_NONE,
            chunksize=_PART,
            encoding="utf-8-sig",
        ) as reader:
            for chunk in reader:
                if chunk.shape[1] != last + 1 or chunk[last].isna().any():
                    return None
                own = chunk[list(places)].set_axis(list(names), axis=1)
                for name, start in origin.items():
                    own[name] -= start
                parts.append(own.to_numpy(dtype=np.float64))
    except (ValueError, OSError, EOFError, zlib.error):  # pandas' errors are ValueErrors
        return None
    values = np.empty((sum(map(len, parts)), len(names)))
    for start in range(0, len(values), _PART):  # one after another: a long log takes much memory
        values[start : start + _PART] = parts.pop(0)
    if not np.isfinite(values).all() or max(values.max(), -values.min()) > EXACT:
        return None
    lines = range(table.lines[0], table.lines[0] + len(values))
    frame = LogFrame(tuple(names), values, lines, _resolution(names, values), origin)
    return RawRows(frame, np.broadcast_to(False, values.shape))


def _read_by_line(table: _Table, names: Sequence[str]) -> RawRows:
    """Return the rows of columns, whatever is wrong in the file."""
    places, last = [table.header.index(name) for name in names], -1
    cells, lines, torn = [], [], []
    for index, line in enumerate(table.rows):
        row = cells_of(line, table.separator)
        if len(row) == len(table.header):
            texts = [row[place] for place in places]
            cells.append([text.replace(",", ".") for text in texts] if table.comma else texts)
            lines.append(table.lines[index])
        else:
            torn.append(f"line {table.lines[index]} ({len(row)})")
            last = index
    clocks = [i for i in range(len(names)) if cells and _stamp(cells[0][i]) is not None]
    for row in cells:
        for i in clocks:
            row[i] = row[i] if (stamp := _stamp(row[i])) is None else str(stamp)
    numbers = [[_number(cell) for cell in row] for row in cells]
    shape = len(cells), len(names)
    unreadable = np.array([[x is None for x in row] for row in numbers], dtype=bool).reshape(shape)
    values = np.array(numbers, dtype=np.float64).reshape(shape)  # None becomes NaN
    origin = {}
    for i, name in enumerate(names):
        column = values[:, i]
        if np.max(np.abs(column), where=np.isfinite(column), initial=0.0) > EXACT:
            texts = [row[i] for row in cells]
            if all(re.fullmatch(r"[-+]?\d+", text) for text in texts):
                origin[name] = int(texts[0])
                column[:] = [float(int(text) - origin[name]) for text in texts]
    cut = len(torn) == 1 and last == len(table.rows) - 1
    frame = LogFrame(tuple(names), values, lines, _resolution(names, values), origin)
    return RawRows(frame, unreadable, torn, len(table.header), cut, lambda i, j: cells[i][j])


def _resolution(names: Sequence[str], values: FloatArray) -> dict[str, float]:
    """Column -> its last digit, 10^(digits before the point - digits) of the largest number."""
    resolutions = {}
    for name, column in zip(names, values.T, strict=True):
        largest = float(np.max(np.abs(column), where=np.isfinite(column), initial=0.0))
        some = map(repr, column[:: max(1, column.size // _ROWS_FOR_DIGITS)].tolist())
        mantissas = (re.split("[eE]", x, maxsplit=1)[0].removesuffix(".0") for x in some)
        digits = max((len(re.sub(r"\D", "", x).lstrip("0")) for x in mantissas), default=0)
        whole = math.floor(math.log10(largest)) + 1 if largest else 0
        resolutions[name] = float(10.0 ** (whole - digits)) if largest else 0.0
    return resolutions


def _stamp(cell: str) -> int | None:
    """Whole ns since 1970 of an ISO 8601 stamp of any zone, else None."""
    match = _ISO.match(cell.strip().strip('"'))
    if match is None:
        return None
    try:
        nanoseconds = int(
            np.datetime64(f"{match[1]}T{match[2].replace(',', '.')}", "ns").astype(np.int64)
        )
    except ValueError:  # no such day
        return None
    if not match[3]:
        return nanoseconds
    ahead = int(match[4]) * 3600 + int(match[5]) * 60
    return nanoseconds - (1 if match[3] == "+" else -1) * ahead * 10**9


def _number(cell: str) -> float | None:
    try:
        return number_of(cell)
    except ValueError:
        return None


def _numbered_lines(path: Path, most: int = -1) -> list[tuple[int, str]]:
    """Return the lines that are not empty, with their numbers, without comments.

    Of a file longer than `most` characters only whole lines within these, or within more if they
    hold no rows. A comment above the numbers is their header if it has as many names
    (`np.savetxt`).
    """
    with _unreadable_said(path), _opened(path, "rt") as file:
        text: str = file.read(most)
    is_part = len(text) == most
    text = text[: text.rfind("\n") + 1] if is_part else text
    filled = [(n, line) for n, line in enumerate(text.split("\n"), 1) if line.strip()]
    is_comment = [line.lstrip().startswith("#") for _, line in filled]
    rows = [row for row, comment in zip(filled, is_comment, strict=True) if not comment]
    if is_part and len(rows) < 2:
        return _numbered_lines(path, 16 * most)
    if not rows:
        raise TrajectoryError(
            f"{path}: is empty; a header with t and the joints' names comes first"
        )
    above = is_comment.index(False) - 1
    if above >= 0:
        number, names = filled[above][0], filled[above][1].lstrip().lstrip("#").strip()
        separator = separator_of(rows[0][1])
        numbers, words = (cells_of(line, separator) for line in (rows[0][1], names))
        is_table = all(_number(cell) is not None for cell in numbers)
        if is_table and len(words) == len(numbers) and _number(words[0]) is None:
            rows.insert(0, (number, names))
    return rows


def _table(path: Path, rows: list[tuple[int, str]]) -> _Table:
    """Tell header and rows, find what separates cells and whether commas are decimal."""
    separator = separator_of(rows[0][1])
    _check_quotes(path, rows, separator)
    header = cells_of(rows[0][1], separator)
    if (echoed := _echoed(header)) is not None:
        header, rows = echoed, [rows[0], *rows]
    if len(rows) == 1:
        raise TrajectoryError(f"{path}: has a header and no samples below it")
    if all(_number(cell) is not None for cell in header):
        raise TrajectoryError(
            f"{path}: has no header: its first line holds numbers; write the columns' names above "
            "them, t and the joints"
        )
    numbers, texts = [n for n, _ in rows[1:]], [line for _, line in rows[1:]]
    if separator == "," and _doubled(header, texts):
        raise TrajectoryError(
            f"{path}: line {numbers[0]}: its numbers have decimal commas, and commas separate its "
            "columns, too: write decimal points, or separate the columns by semicolons"
        )
    comma = separator != "," and any("," in line for line in texts)
    points = [n for n, line in zip(numbers, texts, strict=True) if comma and "." in line]
    if points:
        raise TrajectoryError(
            f"{path}: line {points[0]} has a point, but the file has decimal commas: thousands, "
            "or decimals? Use decimal points throughout, and no thousands separator"
        )
    return _Table(path, header, numbers, texts, separator, comma)


def _doubled(header: Sequence[str], texts: Sequence[str]) -> bool:
    """Whether rows have up to two cells for each name, all digits: both parts of decimals."""
    rows = [line.split(",") for line in texts[:_JUDGED]]
    whole = (re.fullmatch(r"[-+]?\d+", cell.strip()) for row in rows for cell in row)
    sizes = [len(row) / len(header) for row in rows]
    return min(sizes) > 1.0 and 1.5 < max(sizes) <= 2.0 and all(whole)


def _sorted_by_names(table: _Table) -> _Table:
    """Put numbered columns in the order of the first row's names.

    Each message of joint states names its joints, so `name_0` may change.
    """
    places: dict[str, dict[str, int]] = {}
    for place, column in enumerate(table.header):
        if match := _NUMBERED.match(column):
            places.setdefault(match[1], {})[match[2]] = place
    named = next(group for kind, group in places.items() if kind.lower().endswith("name"))
    groups = [group for group in places.values() if group.keys() == named.keys()]
    first, rows, changed = None, list(table.rows), []
    for index, line in enumerate(table.rows):
        cells = cells_of(line, table.separator)
        if len(cells) != len(table.header):
            continue
        names = [cells[place] for place in named.values()]
        first = first or names
        if names == first:
            continue
        changed.append(table.lines[index])
        known = sorted(names) == sorted(first)
        moved = list(cells)
        for group in groups:
            for number, place in enumerate(group.values()):
                source = list(group.values())[names.index(first[number])] if known else -1
                moved[place] = cells[source] if known else ""
        rows[index] = table.separator.join(moved)
    if not changed:
        return table
    note = (
        f"the names of joints, or their order, change in {counted(len(changed), 'row')}, first in "
        f"line {changed[0]}: each row is read by its own names"
    )
    return replace(table, rows=rows, notes=(note,))


def _joint_place(table: _Table) -> int | None:
    """Place of the cell that names a row's joint, in a table with one row a joint."""
    first = cells_of(table.rows[0], table.separator)
    for place, (column, cell) in enumerate(zip(table.header, first, strict=False)):
        if column.lower() in _JOINT_COLUMNS and _number(cell) is None:
            return place
    return None


def _one_row_a_time(table: _Table, place: int) -> _Table:
    """Return a table with one row a time, from one with a row a joint and time.

    A row's time is its first cell; columns become `joint/position` and so on.
    """
    width, others = len(table.header), [i for i in range(1, len(table.header)) if i != place]
    merged: dict[str, dict[str, list[str]]] = {}
    lines: dict[str, int] = {}
    for line, row in zip(table.lines, table.rows, strict=True):
        cells = cells_of(row, table.separator)
        if len(cells) == width:
            merged.setdefault(cells[0], {})[cells[place]] = [cells[i] for i in others]
            lines.setdefault(cells[0], line)
    joints = list(dict.fromkeys(name for own in merged.values() for name in own))
    header = [table.header[0], *(f"{name}/{table.header[i]}" for name in joints for i in others)]
    none = [""] * len(others)
    rows = [
        table.separator.join([time, *(cell for name in joints for cell in own.get(name, none))])
        for time, own in merged.items()
    ]
    if place == 0 or table.separator == " ":
        raise TrajectoryError(
            f"{table.path}: has one row a joint; write the time first, and separate by commas"
        )
    note = f"the table has one row a joint and time: {listing(joints)}"
    return replace(
        table, header=header, lines=list(lines.values()), rows=rows, notes=(note,), rewritten=True
    )


def _echoed(cells: Sequence[str]) -> list[str] | None:
    """Return column names for a row of `ros2 topic echo --csv` of joint states; else None.

    That writes no header: the stamp's s and ns, the frame, n names, positions, velocities, efforts;
    one of the last two may be missing, and nothing says which.
    """
    is_word = [_number(cell) is None for cell in cells]
    count = [*is_word[3:], False].index(False)
    times, odd = divmod(len(cells) - 3 - count, max(count, 1))
    stamped = all(cell.isdigit() for cell in cells[:2])
    if not stamped or count == 0 or odd or times not in (1, 2, 3) or any(is_word[3 + count :]):
        return None
    parts = ["name", "position", "velocity" if times == 3 else "unknown", "effort"][: times + 1]
    columns = [f"{part}_{i}" for part in parts for i in range(count)]
    return ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id", *columns]


def _check_quotes(path: Path, rows: Sequence[tuple[int, str]], separator: str) -> None:
    """Refuse lines with an open quote, which would swallow the next line."""
    wrong, longest = [], csv.field_size_limit()
    for number, line in rows:
        if '"' in line or len(line) > longest:
            try:
                next(csv.reader([line], delimiter=separator, strict=True))
            except csv.Error as problem:
                is_open = "unexpected end" in str(problem)
                wrong.append(f"line {number} ({'a quote is not closed' if is_open else problem})")
    if wrong:
        raise TrajectoryError(
            f"{path}: cannot be split at its commas: {listing(wrong)}; numbers and names need no "
            "quotes"
        )
