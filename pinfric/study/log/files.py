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

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError
from pinfric.model.yamlfile import brief, brief_path
from pinfric.study.joint_columns import listing

FloatArray = NDArray[np.float64]

#: Share of rows that may be torn or not finite before the file is refused.
BAD_SHARE = 0.01
#: Fewer rows than this are a table somebody wrote, in which no row may be bad.
_FEWEST = 20
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
        dropped: one text per row left out: where, and why.
        absent: rows without a cell in any of the columns but the first.
    """

    names: tuple[str, ...]
    values: FloatArray
    lines: Sequence[int]
    resolution: FloatArray
    origin: dict[str, int]
    dropped: tuple[str, ...] = ()
    absent: int = 0

    def column(self, name: str) -> FloatArray:
        """Return one of the columns, (rows,)."""
        return np.ascontiguousarray(self.values[:, self.names.index(name)])


@dataclass(frozen=True)
class Log:
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
    """A CSV file as text: the lines below the header, with their numbers and what separates cells."""

    path: Path
    header: list[str]
    lines: list[int]
    rows: list[str]
    separator: str


def open_csv(path: Path) -> Log:
    """Open a CSV file; nothing below its header is parsed yet.

    Raises:
        TrajectoryError: unreadable, not text, empty, or lines that cannot be split.
    """
    text = _split(path, _numbered_lines(path))
    first = next(csv.reader([text.rows[0]], delimiter=text.separator))
    return Log(text.header, lambda names, problems: _read_text(text, names, problems), first)


def open_parquet(path: Path) -> Log:
    """Open a Parquet file; a column of time stamps counts as whole ns.

    Raises:
        TrajectoryError: damaged, no table, or pyarrow is missing.
    """
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        raise TrajectoryError(f"{path}: Parquet needs pyarrow: pip install 'pinfric[logs]'") from None
    try:
        frame = parquet.read_table(path).to_pandas()
    except (OSError, ValueError, KeyError) as problem:  # pyarrow's errors are ValueErrors, OSErrors
        reason = " ".join(str(problem).split())[:200]
        raise TrajectoryError(f"{path}: is no Parquet file that can be read: {reason}") from None
    frame = frame.reset_index() if frame.index.name else frame
    columns: dict[str, NDArray[np.int64] | FloatArray] = {}
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
    columns: dict[str, NDArray[np.int64] | FloatArray],
    units: Mapping[str, str],
    said: tuple[str, ...] = (),
    recorded: bool = False,
) -> Log:
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
        lines = range(1, len(rows) + 1)
        return _sifted(names, rows, lines, np.zeros(rows.shape, dtype=bool),
                       np.zeros(len(names)), origin, [], problems, "row")  # fmt: skip

    return Log(list(columns), read, recorded=recorded, said=said, units=units)


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
    if len(rows) == 1:
        raise TrajectoryError(f"{path}: has a header and no samples below it")
    if all(_number(cell) is not None for cell in header):
        raise TrajectoryError(f"{path}: has no header: its first line holds numbers; write the "
                              "columns' names above them, t and the joints")  # fmt: skip
    numbers, texts = [n for n, _ in rows[1:]], [line for _, line in rows[1:]]
    if separator != "," and any("," in line for line in texts):
        both = [n for n, line in zip(numbers, texts, strict=True) if "," in line and "." in line]
        if both:
            raise TrajectoryError(f"{path}: line {both[0]} has both commas and points in its "
                                  "numbers; write decimal points")  # fmt: skip
        texts = [line.replace(",", ".") for line in texts]
    return _Text(path, header, numbers, texts, separator)


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


def _read_text(text: _Text, names: Sequence[str], problems: list[str]) -> Cells:
    """Parse the columns at once; only where that fails look at each cell, to say which ones."""
    places = [text.header.index(name) for name in names]
    whole = all(line.count(text.separator) == len(text.header) - 1 for line in text.rows)
    if whole and not any('"' in line for line in text.rows):
        try:
            values = np.loadtxt(text.rows, delimiter=text.separator, comments=None, ndmin=2,
                                usecols=places)  # fmt: skip
        except ValueError:
            pass
        else:
            rows = list(range(len(text.rows)))
            return _finish(text, names, values, rows, np.zeros(values.shape, dtype=bool), [],
                           problems)  # fmt: skip
    parsed, kept, missing, torn = [], [], [], []
    for index, cells in enumerate(csv.reader(text.rows, delimiter=text.separator)):
        if len(cells) != len(text.header):
            torn.append((index, f"line {text.lines[index]} ({len(cells)})"))
            continue
        row = [_number(cells[place]) for place in places]
        parsed.append([math.nan if x is None else x for x in row])
        missing.append([x is None for x in row])
        kept.append(index)
    shape = (len(parsed), len(names))
    return _finish(text, names, np.array(parsed, dtype=np.float64).reshape(shape), kept,
                   np.array(missing, dtype=bool).reshape(shape), torn, problems)  # fmt: skip


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _finish(
    text: _Text,
    names: Sequence[str],
    values: FloatArray,
    kept: list[int],
    unreadable: NDArray[np.bool_],
    torn: list[tuple[int, str]],
    problems: list[str],
) -> Cells:
    """Make long whole numbers exact, see how many digits there are, and sift the rows."""
    origin = {}
    for i, name in enumerate(names):
        place = text.header.index(name)
        if np.nanmax(np.abs(values[:, i]), initial=0.0) > _EXACT:
            texts = [text.rows[k].split(text.separator)[place].strip() for k in kept]
            if all(re.fullmatch(r"[-+]?\d+", x) for x in texts):
                origin[name] = int(texts[0])
                values[:, i] = [float(int(x) - origin[name]) for x in texts]
    resolution = np.array([_resolution(text, text.header.index(name), values[:, i])
                           for i, name in enumerate(names)])  # fmt: skip
    texts_of = [text.rows[k] for k in kept]
    said = [f"the header has {len(text.header)} columns; rows with another number of cells: "
            f"{listing(where for _, where in torn)}"] if torn else []  # fmt: skip
    last = bool(torn) and len(torn) == 1 and torn[0][0] == len(text.rows) - 1
    wrong = [
        f"line {text.lines[kept[i]]}, column {names[j]}: "
        f"{brief(_cell(texts_of[i], text, names[j]))}"
        for i, j in np.argwhere(unreadable).tolist()
        if _cell(texts_of[i], text, names[j])
    ]
    empty = [
        f"line {text.lines[kept[i]]}, column {names[j]}: ''"
        for i, j in np.argwhere(unreadable & ~unreadable[:, 1:].all(axis=1)[:, None]).tolist()
        if not _cell(texts_of[i], text, names[j])
    ]
    if wrong or empty:
        said.append(f"not a number: {listing(wrong + empty)}")
    lines = [text.lines[k] for k in kept]
    return _sifted(names, values, lines, unreadable, resolution, origin, said, problems, "line",
                   torn=len(torn), last_torn=last)  # fmt: skip


def _cell(line: str, text: _Text, name: str) -> str:
    cells = next(csv.reader([line], delimiter=text.separator))
    return cells[text.header.index(name)].strip()


def _sifted(
    names: Sequence[str],
    values: FloatArray,
    lines: Sequence[int],
    unreadable: NDArray[np.bool_],
    resolution: FloatArray,
    origin: dict[str, int],
    said: list[str],
    problems: list[str],
    word: str,
    torn: int = 0,
    last_torn: bool = False,
) -> Cells:
    """Leave out the rows that cannot be used: few of them are dropped, many are problems.

    Rows that have no number but in the first column belong to another, slower source.
    """
    absent = np.isnan(values[:, 1:]).all(axis=1) if len(names) > 1 else np.zeros(len(values), bool)
    if not unreadable.any() and word == "line":
        absent[:] = False  # nan was written there
    if absent.all():
        absent[:] = False
    finite = np.isfinite(values)
    bad = ~finite.all(axis=1) & ~absent
    count = len(values) + torn
    few = count >= _FEWEST and (int(bad.sum()) + torn <= BAD_SHARE * count
                                or (last_torn and not bad.any()))  # fmt: skip
    dropped: list[str] = []
    if few:
        where = [str(lines[i]) for i in np.flatnonzero(bad)[:1]]
        dropped = said or [f"{word} {x} is not finite" for x in where]
        dropped = [*dropped[:1], *[""] * (int(bad.sum()) + torn - len(dropped[:1]))]
        dropped = dropped if bad.any() or torn else []
    else:
        problems += said
        for i, name in enumerate(names):
            wrong = np.flatnonzero(~finite[:, i] & ~unreadable[:, i] & ~absent)
            if wrong.size:
                places = listing(f"{values[k, i]:g} at sample {k} ({word} {lines[k]})"
                                 for k in wrong)  # fmt: skip
                problems.append(f"column {name}: {places}; every value must be finite")
    keep = ~absent & ~bad if few else ~absent
    chosen = np.flatnonzero(keep)
    return Cells(tuple(names), values[keep], [lines[i] for i in chosen] if not keep.all() else lines,
                 resolution, origin, tuple(dropped), int(absent.sum()))  # fmt: skip


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
