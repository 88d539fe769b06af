"""Files as robots and their tools write them: what columns they have, and the cells of those used.

CSV (comma, semicolon, tab; a decimal comma where it cannot separate), Parquet, ROS 2 bags (`bags`).
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError
from pinfric.model.yamlfile import brief, brief_path
from pinfric.study.trajectory.joint_columns import listing

FloatArray = NDArray[np.float64]

#: Share of rows that may be torn or not finite before the file is refused.
BAD_SHARE = 0.01
#: Fewer rows than this are a table that somebody wrote: no row may be bad, none is judged.
FEWEST = 20
#: Rows looked at to see how many digits a file prints.
_ROWS_FOR_DIGITS = 500
#: Whole numbers beyond this lose their last digits as floats.
_EXACT = 2.0**53


@dataclass(frozen=True)
class Cells:
    """Cells of the columns that were asked for.

    Args:
        names: (n,) the columns.
        values: (rows, n).
        lines: (rows,) where each row stands in the file, for messages.
        resolution: (n,) the last digit printed; 0: not rounded.
        origin: column -> whole number subtracted from it, so that the rest is exact.
        dropped, why: how many rows were left out, and which.
        absent: rows without a cell in any of the columns but the first.
    """

    names: tuple[str, ...]
    values: FloatArray
    lines: Sequence[int]
    resolution: FloatArray
    origin: dict[str, int]
    dropped: int = 0
    why: str = ""
    absent: int = 0

    def column(self, name: str) -> FloatArray:
        """Return one of the columns, (rows,)."""
        return np.ascontiguousarray(self.values[:, self.names.index(name)])


@dataclass(frozen=True)
class OpenedLog:
    """An opened file: its columns, a function that reads some of them, and words about the file.

    Args:
        header: all columns.
        read: names of columns and a list for problems -> their cells.
        first: the first row's texts, for columns that hold names.
        recorded: no file of ours: velocities in it are measured, not part of a plan.
        said: what a person should know of the file.
        units: column -> unit, where the file itself says it.
    """

    header: list[str]
    read: Callable[[Sequence[str], list[str]], Cells]
    first: Sequence[str] = ()
    recorded: bool = False
    said: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _Text:
    """A CSV file as text: the lines below the header, their numbers, and what separates cells."""

    header: list[str]
    lines: list[int]
    rows: list[str]
    separator: str


def open_csv(path: Path) -> OpenedLog:
    """Open a CSV file; nothing below its header is parsed yet.

    Raises:
        TrajectoryError: unreadable, not text, empty, or lines that cannot be split.
    """
    text = _split(path, _numbered_lines(path))
    first = next(csv.reader([text.rows[0]], delimiter=text.separator))
    return OpenedLog(text.header, lambda names, problems: _read_text(text, names, problems), first)


def open_parquet(path: Path) -> OpenedLog:
    """Open a Parquet file; a column of time stamps counts as whole ns.

    Raises:
        TrajectoryError: damaged, no table, or pyarrow is missing.
    """
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        raise TrajectoryError(
            f"{path}: Parquet needs pyarrow: pip install 'pinfric[logs]'"
        ) from None
    try:
        frame = parquet.read_table(path).to_pandas()
    except (OSError, ValueError, KeyError) as problem:  # pyarrow's errors are ValueErrors, OSErrors
        reason = " ".join(str(problem).split())[:200]
        raise TrajectoryError(f"{path}: is no Parquet file that can be read: {reason}") from None
    frame = frame.reset_index() if frame.index.name else frame
    columns: dict[str, NDArray[Any]] = {}
    units = {}
    for name in frame.columns:
        values = frame[name]
        if values.dtype.kind == "M":
            columns[str(name)] = values.to_numpy().astype("datetime64[ns]").astype(np.int64)
            units[str(name)] = "ns"
        elif values.dtype.kind in "iufb":
            columns[str(name)] = values.to_numpy()
    return arrays_log(columns, units)


def arrays_log(
    columns: Mapping[str, NDArray[Any]],
    units: Mapping[str, str],
    said: tuple[str, ...] = (),
    recorded: bool = False,
) -> OpenedLog:
    """Return the log that columns of numbers are; whole numbers keep all their digits."""

    def read(names: Sequence[str], problems: list[str]) -> Cells:
        origin, parts = {}, []
        for name in names:
            values = columns[name]
            if values.dtype.kind in "iu" and values.size and abs(int(values[0])) > _EXACT:
                origin[name] = int(values[0])
                values = values - values[0]
            parts.append(np.asarray(values, dtype=np.float64))
        rows = np.array(parts).reshape(len(names), -1).T
        found = _Rows(rows, range(1, len(rows) + 1), np.isnan(rows))
        return _sifted(names, found, np.zeros(len(names)), origin, problems)

    return OpenedLog(list(columns), read, recorded=recorded, said=said, units=units)


def _numbered_lines(path: Path) -> list[tuple[int, str]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as problem:
        where = brief_path(path)
        raise TrajectoryError(f"{where}: cannot be read: {problem.strerror}") from None
    except UnicodeDecodeError:
        raise TrajectoryError(f"{path}: is not a text file in UTF-8") from None
    rows = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not rows:
        raise TrajectoryError(
            f"{path}: is empty; a header with t and the joints' names comes first"
        )
    return rows


def _split(path: Path, rows: list[tuple[int, str]]) -> _Text:
    """Tell header and rows, find what separates cells, and make decimal commas points."""
    top = rows[0][1]
    separator = max("\t;,", key=lambda mark: (top.count(mark), mark == ","))
    _check_cells(path, rows, separator)
    header = [cell.strip() for cell in next(csv.reader([top], delimiter=separator))]
    if (echoed := _echoed(header)) is not None:
        header, rows = echoed, [rows[0], *rows]
    if len(rows) == 1:
        raise TrajectoryError(f"{path}: has a header and no samples below it")
    if all(_number(cell) is not None for cell in header):
        raise TrajectoryError(f"{path}: has no header: its first line holds numbers; write the "
                              "columns' names above them, t and the joints")  # fmt: skip
    numbers, texts = [n for n, _ in rows[1:]], [line for _, line in rows[1:]]
    if separator != "," and any("," in line for line in texts):
        points = [n for n, line in zip(numbers, texts, strict=True) if "." in line]
        if points:
            raise TrajectoryError(f"{path}: line {points[0]} has a point, and the file writes "
                                  "decimal commas: thousands, or decimals? write decimal points "
                                  "throughout, and nothing between thousands")  # fmt: skip
        texts = [line.replace(",", ".") for line in texts]
    return _Text(header, numbers, texts, separator)


def _echoed(cells: Sequence[str]) -> list[str] | None:
    """Return column names for a row of `ros2 topic echo --csv` of joint states; else None.

    That writes no header: the stamp's s and ns, the frame, n names, n positions, velocities,
    efforts; one of the last two may be missing, and nothing says which.
    """
    is_word = [_number(cell) is None for cell in cells]
    count = [*is_word[3:], False].index(False)
    times, left = divmod(len(cells) - 3 - count, max(count, 1))
    stamped = all(cell.isdigit() for cell in cells[:2])
    if not stamped or count == 0 or left or times not in (1, 2, 3) or any(is_word[3 + count :]):
        return None
    parts = {1: ("name", "position"), 2: ("name", "position", "unknown"),
             3: ("name", "position", "velocity", "effort")}[times]  # fmt: skip
    columns = [f"{part}_{i}" for part in parts for i in range(count)]
    return ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id", *columns]


def _check_cells(path: Path, rows: Sequence[tuple[int, str]], separator: str) -> None:
    """Refuse lines no CSV reader takes by themselves: an open quote swallows the next line."""
    wrong, longest = [], csv.field_size_limit()
    for number, line in rows:
        if '"' in line or len(line) > longest:
            try:
                next(csv.reader([line], delimiter=separator, strict=True))
            except csv.Error as problem:
                is_open = "unexpected end" in str(problem)
                wrong.append(f"line {number} ({'a quote is not closed' if is_open else problem})")
    if wrong:
        raise TrajectoryError(f"{path}: cannot be split at its commas: {listing(wrong)}; numbers "
                              "and names need no quotes")  # fmt: skip


@dataclass(frozen=True)
class _Rows:
    """Rows as they were read: numbers, NaN where there was none; what stood there, and torn rows.

    Args:
        values: (rows, n).
        lines: (rows,) where each stands in the file.
        unreadable: (rows, n) there was no number.
        torn: where rows with another number of cells stand, and how many they have.
        cut: the only torn row is the last one: the log was cut off while it was written.
        cell: what stood at row, column.
    """

    values: FloatArray
    lines: Sequence[int]
    unreadable: NDArray[np.bool_]
    torn: Sequence[str] = ()
    cut: bool = False
    cell: Callable[[int, int], str] = lambda row, column: ""


def _read_text(text: _Text, names: Sequence[str], problems: list[str]) -> Cells:
    """Parse the columns at once; only where that fails look at each cell, to say which ones."""
    places = [text.header.index(name) for name in names]
    rows = _parsed_at_once(text, places) or _parsed_one_by_one(text, places)
    origin = {}
    for i, name in enumerate(names):
        column = rows.values[:, i]
        if np.max(np.abs(column), where=np.isfinite(column), initial=0.0) > _EXACT:
            texts = [rows.cell(k, i) for k in range(len(column))]
            if all(re.fullmatch(r"[-+]?\d+", x) for x in texts):
                origin[name] = int(texts[0])
                column[:] = [float(int(x) - origin[name]) for x in texts]
    resolution = np.array([_resolution(text, place, rows.values[:, i])
                           for i, place in enumerate(places)])  # fmt: skip
    return _sifted(names, rows, resolution, origin, problems, len(text.header))


def _parsed_at_once(text: _Text, places: Sequence[int]) -> _Rows | None:
    mark = text.separator
    if any(line.count(mark) != len(text.header) - 1 or '"' in line for line in text.rows):
        return None
    try:
        values = np.loadtxt(text.rows, delimiter=mark, comments=None, ndmin=2, usecols=places)
    except ValueError:
        return None
    return _Rows(values, text.lines, np.zeros(values.shape, dtype=bool),
                 cell=lambda row, i: text.rows[row].split(mark)[places[i]].strip())  # fmt: skip


def _parsed_one_by_one(text: _Text, places: Sequence[int]) -> _Rows:
    cells: list[list[str]] = []
    lines, torn, last = [], [], -1
    for index, row in enumerate(csv.reader(text.rows, delimiter=text.separator)):
        if len(row) == len(text.header):
            cells.append([row[place].strip() for place in places])
            lines.append(text.lines[index])
        else:
            torn.append(f"line {text.lines[index]} ({len(row)})")
            last = index
    numbers = [[_number(cell) for cell in row] for row in cells]
    values = np.array([[math.nan if x is None else x for x in row] for row in numbers], dtype=float)
    unreadable = np.array([[x is None for x in row] for row in numbers], dtype=bool)
    shape = (len(cells), len(places))
    cut = len(torn) == 1 and last == len(text.rows) - 1
    return _Rows(values.reshape(shape), lines, unreadable.reshape(shape), torn, cut,
                 lambda row, i: cells[row][i])  # fmt: skip


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _sifted(
    names: Sequence[str],
    rows: _Rows,
    resolution: FloatArray,
    origin: dict[str, int],
    problems: list[str],
    width: int = 0,
) -> Cells:
    """Leave out the rows that cannot be used: few of them are dropped, many are problems.

    Rows that have no number but in the first column belong to another source in the same file.
    """
    finite = np.isfinite(rows.values)
    absent = np.zeros(len(finite), dtype=bool)
    for i in np.flatnonzero(rows.unreadable[:, 1:].all(axis=1)).tolist():
        absent[i] = not any(rows.cell(i, j) for j in range(1, len(names)))
    if absent.all():
        absent[:] = False
    bad = ~finite.all(axis=1) & ~absent
    wrong = _bad_cells(names, rows, absent, width)
    count, lost = len(bad) + len(rows.torn), int(bad.sum()) + len(rows.torn)
    few = count >= FEWEST and (lost <= BAD_SHARE * count or (rows.cut and lost == 1))
    if not few:
        problems += wrong
    keep = ~absent & ~bad if few else ~absent
    values, lines = rows.values, rows.lines
    if not keep.all():  # else no copy: a long log fills much of the memory
        values = values[keep]
        lines = [line for line, kept in zip(lines, keep.tolist(), strict=True) if kept]
    dropped = "; ".join(wrong) if few else ""
    return Cells(tuple(names), values, lines, resolution, origin,
                 lost if few else 0, dropped, int(absent.sum()))  # fmt: skip


def _bad_cells(
    names: Sequence[str], rows: _Rows, absent: NDArray[np.bool_], width: int
) -> list[str]:
    """Say what is torn, what is no number, and what is not finite."""
    said = []
    if rows.torn:
        said.append(f"the header has {width} columns; rows with another number of cells: "
                    f"{listing(rows.torn)}")  # fmt: skip
    words = np.argwhere(rows.unreadable & ~absent[:, None]).tolist()
    if words:
        where = listing(f"line {rows.lines[i]}, column {names[j]}: {brief(rows.cell(i, j))}"
                        for i, j in words)  # fmt: skip
        said.append(f"not a number: {where}")
    for j, name in enumerate(names):
        column = rows.values[:, j]
        wrong = np.flatnonzero(~np.isfinite(column) & ~rows.unreadable[:, j]).tolist()
        if wrong:
            where = listing(f"{column[i]:g} at sample {i} (line {rows.lines[i]})" for i in wrong)
            said.append(f"column {name}: {where}; every value must be finite")
    return said


def _resolution(text: _Text, place: int, values: FloatArray) -> float:
    """The last digit printed of a column: 10^(digits before the point of the largest - digits)."""
    size = np.abs(values)
    largest = float(np.max(size, where=np.isfinite(size), initial=0.0))
    if largest == 0.0 or not text.rows:
        return 0.0
    step = max(1, len(text.rows) // _ROWS_FOR_DIGITS)
    cells = (line.split(text.separator) for line in text.rows[::step])
    digits = max((_significant_digits(row[place]) for row in cells if place < len(row)), default=0)
    return float(10.0 ** (math.floor(math.log10(largest)) + 1 - digits))


def _significant_digits(cell: str) -> int:
    mantissa = re.split("[eE]", cell, maxsplit=1)[0]
    return len(re.sub(r"\D", "", mantissa).lstrip("0"))
