"""Files as robots and their tools write them: what columns they have, and the cells of those used.

CSV (comma, semicolon, tab, spaces; a decimal comma where it cannot separate; gzipped), Parquet,
MATLAB, ROS 2 bags (`bags`).
"""

from __future__ import annotations

import csv
import gzip
import math
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import dropwhile
from pathlib import Path
from typing import Any, TextIO, cast

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError
from pinfric.model.brief import counted
from pinfric.model.yamlfile import brief, brief_path
from pinfric.study.trajectory.joint_columns import listing

FloatArray = NDArray[np.float64]

#: Share of rows that may be torn or not finite before the file is refused.
BAD_SHARE = 0.01
#: Fewer rows than this are a table that somebody wrote: no row may be bad, none is judged.
FEWEST = 20
#: Rows looked at to see how many digits a file prints.
_ROWS_FOR_DIGITS = 500
#: Bytes from which a file is parsed while it is read, for its lines would fill the memory; bytes
#: at its start that say what separates cells.
_LONG, _HEAD = 2**25, 2**16
#: Whole numbers beyond this lose their last digits as floats.
_EXACT = 2.0**53
#: Columns that tables of joint states number: `name_0`, `position[0]`.
_NUMBERED = re.compile(r"^(.*?)[_\[.]?(\d+)\]?$")


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
        return self.values[:, self.names.index(name)].copy()  # a view would keep all the others


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
    said: tuple[str, ...] = ()


def open_csv(path: Path) -> OpenedLog:
    """Open a CSV file, gzipped where it ends in .gz; nothing below its header is parsed yet.

    Raises:
        TrajectoryError: unreadable, not text, empty, or lines that cannot be split.
    """
    if (head := _plain_head(path)) is not None:
        return OpenedLog(head.header, lambda names, problems: _streamed(path, head, names, problems)
                         or _whole_csv(path).read(names, problems),
                         _cells(head.rows[0], head.separator))  # fmt: skip
    return _whole_csv(path)


def _whole_csv(path: Path) -> OpenedLog:
    text = _sorted_by_names(_split(path, _numbered_lines(path)))
    first = next(csv.reader([text.rows[0]], delimiter=text.separator))
    return OpenedLog(text.header, lambda names, problems: _read_text(text, names, problems), first,
                     said=text.said)  # fmt: skip


def _plain_head(path: Path) -> _Text | None:
    """Return the first lines of a long file that may be parsed line by line; None: another one."""
    try:
        if path.stat().st_size < _LONG:
            return None
    except OSError:
        return None
    rows = _numbered_lines(path, _HEAD)
    head = _split(path, rows)
    rewritten = head.lines[0] == rows[0][0] or any(
        "," in line for _, line in rows if head.separator != ",")  # fmt: skip
    named = any("name" in column.lower() for column in head.header)  # rows may differ in order
    return None if rewritten or named else head


def _streamed(path: Path, head: _Text, names: Sequence[str], problems: list[str]) -> Cells | None:
    """Parse a long file line by line; None where a line is torn or holds what is no number."""
    places, first = (
        [head.header.index(name) for name in names],
        _cells(head.rows[0], head.separator),
    )
    origin = {name: int(first[place]) for name, place in zip(names, places, strict=True)
              if first[place].isdigit() and int(first[place]) > _EXACT}  # fmt: skip
    exact: dict[int | str, Callable[[Any], Any]] = {
        head.header.index(name): partial(_above, start=start) for name, start in origin.items()
    }
    kept: list[str] = []
    try:
        values = np.loadtxt(_plain_lines(path, head, kept), comments=None, ndmin=2, usecols=places,
                            delimiter=head.separator.strip(" ") or None,
                            converters=exact or None)  # fmt: skip
    except (ValueError, OSError, EOFError, zlib.error):
        return None
    if np.max(np.abs(values), where=np.isfinite(values), initial=0.0) > _EXACT:
        return None
    sample = replace(head, rows=kept)
    resolution = np.array([_resolution(sample, place, values[:, i])
                           for i, place in enumerate(places)])  # fmt: skip
    start = head.lines[0]
    rows = _Rows(values, range(start, start + len(values)), np.zeros(values.shape, dtype=bool))
    return _sifted(names, rows, resolution, origin, problems, len(head.header))


def _above(cell: str, start: int) -> float:
    return float(int(cell) - start)


def _plain_lines(path: Path, head: _Text, kept: list[str]) -> Iterator[str]:
    """Yield the lines below the header, and keep some hundreds of them, evenly.

    Raises:
        ValueError: a line that is not like the first one.
    """
    mark, width, every = head.separator, len(head.header), 1
    with _opened(path) as file:
        lines = enumerate(dropwhile(lambda row: row[0] < head.lines[0], enumerate(file, 1)))
        for index, (_, line) in lines:
            cells = len(line.split()) if mark == " " else line.count(mark) + 1
            if cells != width or '"' in line:
                if not line.strip() and not "".join(x for _, (_, x) in lines).strip():
                    return
                raise ValueError
            if index % every == 0:
                kept.append(" ".join(line.split()) if mark == " " else line)
            if len(kept) > 2 * _ROWS_FOR_DIGITS:
                kept[:], every = kept[::2], 2 * every
            yield line


def _opened(path: Path) -> TextIO:
    opened = gzip.open if path.suffix.lower() == ".gz" else open
    return cast(TextIO, opened(path, "rt", encoding="utf-8-sig"))


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


def open_matlab(path: Path) -> OpenedLog:
    """Open a MATLAB file; rows or columns of arrays are named `struct.field_1` and on.

    Raises:
        TrajectoryError: damaged, of a version that SciPy does not read, no arrays.
    """
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise TrajectoryError(f"{path}: is of MATLAB's version 7.3; save it with -v7") from None
    except Exception as problem:  # zlib's, struct's, NumPy's: whatever a cut file ends in
        reason = " ".join(str(problem).split())[:200] or type(problem).__name__
        raise TrajectoryError(f"{path}: cannot be read as a MATLAB file: {reason}") from None
    arrays = dict(_matlab_arrays("", content))
    sizes = [max(x.shape) for x in arrays.values() if max(x.shape) >= FEWEST]
    count = max(sizes, key=lambda size: (sizes.count(size), size), default=0)
    columns: dict[str, NDArray[Any]] = {}
    for name, values in arrays.items():
        if values.shape == (count,):
            columns[name] = values
        elif values.ndim == 2 and count in values.shape:
            each = values if values.shape[1] == count else values.T
            columns |= {f"{name}_{i}": row for i, row in enumerate(each, 1)}
    if not columns:
        raise TrajectoryError(f"{path}: holds no arrays of numbers")
    return arrays_log(columns, {}, recorded=True)


def _matlab_arrays(prefix: str, content: Mapping[str, Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of numbers in variables and structs of structs."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            fields = {field: getattr(value, field) for field in value._fieldnames}
            yield from _matlab_arrays(f"{prefix}{name}.", fields)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb" and value.ndim in (1, 2):
            yield f"{prefix}{name}", value


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


def _numbered_lines(path: Path, most: int = -1) -> list[tuple[int, str]]:
    """Return the lines that are not empty, with their numbers; comments apart, except a header.

    Of a file longer than `most` characters only the whole lines in these. A comment right above
    the numbers is their header if it has as many names (`np.savetxt`).
    """
    try:
        with _opened(path) as file:
            text = file.read(most)
            text = text if len(text) != most else text[: text.rfind("\n") + 1]
    except UnicodeDecodeError:
        raise TrajectoryError(f"{path}: is not a text file in UTF-8") from None
    except (OSError, EOFError, zlib.error) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise TrajectoryError(f"{brief_path(path)}: cannot be read: {reason}") from None
    filled = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    is_comment = [line.lstrip().startswith("#") for _, line in filled]
    rows = [row for row, comment in zip(filled, is_comment, strict=True) if not comment]
    if not rows:
        raise TrajectoryError(
            f"{path}: is empty; a header with t and the joints' names comes first"
        )
    above = is_comment.index(False) - 1
    if above >= 0:
        number, names = filled[above][0], filled[above][1].lstrip().lstrip("#").strip()
        separator = _separator(rows[0][1])
        numbers, words = (_cells(line, separator) for line in (rows[0][1], names))
        is_table = all(_number(cell) is not None for cell in numbers)
        if is_table and len(words) == len(numbers) and _number(words[0]) is None:
            rows.insert(0, (number, names))
    return rows


def _separator(line: str) -> str:
    """The mark that separates a line's cells; a space where there is no other."""
    mark = max("\t;,", key=lambda x: (line.count(x), x == ","))
    return mark if mark in line else " "


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def _split(path: Path, rows: list[tuple[int, str]]) -> _Text:
    """Tell header and rows, find what separates cells, and make decimal commas points."""
    separator = _separator(rows[0][1])
    if separator == " ":
        rows = [(number, " ".join(line.split())) for number, line in rows]
    _check_cells(path, rows, separator)
    header = _cells(rows[0][1], separator)
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


def _sorted_by_names(text: _Text) -> _Text:
    """Put numbered columns in the order of the first row's names, where later rows have another.

    Each message of joint states names its joints, so `name_0` is not always the same joint.
    """
    places: dict[str, dict[str, int]] = {}
    for place, column in enumerate(text.header):
        if match := _NUMBERED.match(column):
            places.setdefault(match[1], {})[match[2]] = place
    named = next((group for kind, group in places.items() if kind.lower().endswith("name")), None)
    if named is None:
        return text
    groups = [group for group in places.values() if group.keys() == named.keys()]
    first, rows, changed = None, list(text.rows), []
    for index, line in enumerate(text.rows):
        cells = next(csv.reader([line], delimiter=text.separator))
        if len(cells) != len(text.header):
            continue
        names = [cells[place].strip() for place in named.values()]
        first = first or names
        if names == first:
            continue
        changed.append(text.lines[index])
        known = sorted(names) == sorted(first)
        moved = list(cells)
        for group in groups:
            for number, place in enumerate(group.values()):
                source = list(group.values())[names.index(first[number])] if known else -1
                moved[place] = cells[source] if known else ""
        rows[index] = text.separator.join(moved)
    if not changed:
        return text
    said = (f"the names of joints, or their order, change in {counted(len(changed), 'row')}, first "
            f"in line {changed[0]}: each row is read by its own names",)  # fmt: skip
    return replace(text, rows=rows, said=said)


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
    if not keep.all():  # else no copy: a long log takes much memory
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
