"""Logs as frames: the numbers of the columns used, one row per line."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pinfric.errors import TrajectoryError
from pinfric.model.arrays import BoolArray, FloatArray, real_numbers
from pinfric.model.yamlfile import brief
from pinfric.motions.joint_columns import listing

#: Share of rows that may be torn or not finite before the file is refused.
BAD_SHARE = 0.01
#: Fewer rows than this are a table that somebody wrote: no row may be bad, none is judged.
FEWEST = 20
#: Rows of a file, and their numbers: more would fill the memory, and a small compressed file can
#: hold any number of them.
MOST_ROWS, MOST_CELLS = 5_000_000, 250_000_000
#: Bytes that a compressed file may hold.
MOST_BYTES = 2**30
#: Whole numbers beyond this lose their last digits as floats.
EXACT = 2.0**53


def check_size(path: Path, rows: int, columns: int = 1, inflated: int = 0) -> None:
    """Refuse a file with more rows, cells or decompressed bytes than fit (TrajectoryError)."""
    for count, most, what in (
        (rows, MOST_ROWS, "rows"),
        (rows * columns, MOST_CELLS, "numbers"),
        (inflated, MOST_BYTES, "decompressed bytes"),
    ):
        if count > most:
            raise TrajectoryError(f"{path}: has more than {most:,} {what}; split it")


@dataclass
class Remarks:
    """What the steps of reading say.

    Attributes:
        problems: all that is wrong, for one message that refuses the file.
        notes: what was guessed, repaired or left out.
    """

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def ask(self, check: Callable[..., list[str]], *of: Any) -> None:
        """Add what a check finds, unless something else is wrong already."""
        if not self.problems:
            self.problems += check(*of)


@dataclass(frozen=True)
class LogFrame:
    """Numbers of the columns that were asked for.

    Args:
        names: (n,) columns. values: (rows, n); NaN: no number. lines: (rows,) in the file.
        resolution: column -> the last digit printed; left out: not rounded.
        origin: column -> whole number subtracted from it to keep the digits.
        dropped, why: how many rows were left out, and which.
        absent: rows without a number in any of the columns but the first.
    """

    names: tuple[str, ...]
    values: FloatArray
    lines: Sequence[int]
    resolution: Mapping[str, float] = field(default_factory=dict)
    origin: Mapping[str, int] = field(default_factory=dict)
    dropped: int = 0
    why: str = ""
    absent: int = 0

    def column(self, name: str) -> FloatArray:
        """Return one of the columns, (rows,)."""
        return self.values[:, self.names.index(name)].copy()  # a view would keep all the others


@dataclass(frozen=True)
class OpenedLog:
    """An opened file: its columns, a function that reads some of them, and notes on the file.

    Args:
        read: names of columns, a list for problems, columns that may lack numbers -> their numbers.
        first: the first row's texts, for columns that hold names.
        recorded: whether velocities in it are measured, not part of a plan.
        units: column -> unit, where the file itself says it.
    """

    header: list[str]
    read: Callable[[Sequence[str], list[str], Collection[str]], LogFrame]
    first: Sequence[str] = ()
    recorded: bool = False
    notes: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class RawRows:
    """Rows as they were read.

    Args:
        unreadable: (rows, n) there was no number.
        torn: rows with another number of cells. width: number of cells of the others.
        cut: only the last row is torn: the log was cut off while it was written.
        cell: what stood at row, column.
    """

    frame: LogFrame
    unreadable: BoolArray
    torn: Sequence[str] = ()
    width: int = 0
    cut: bool = False
    cell: Callable[[int, int], str] = lambda row, column: ""


def arrays_log(
    columns: Mapping[str, NDArray[Any]],
    units: Mapping[str, str],
    notes: tuple[str, ...] = (),
    recorded: bool = False,
) -> OpenedLog:
    """Return columns of numbers as a log; whole numbers keep all their digits."""

    def read(names: Sequence[str], problems: list[str], may_lack: Collection[str]) -> LogFrame:
        origin, parts = {}, []
        for name in names:
            values = columns[name]
            if values.dtype.kind in "iu" and values.size and abs(int(values[0])) > EXACT:
                origin[name] = int(values[0])
                values = values - values[0]
            parts.append(np.asarray(values, dtype=np.float64))
        rows = np.array(parts).reshape(len(names), -1).T
        frame = LogFrame(tuple(names), rows, range(1, len(rows) + 1), origin=origin)
        return usable_rows(RawRows(frame, np.isnan(rows)), problems, may_lack)

    return OpenedLog(list(columns), read, recorded=recorded, notes=notes, units=units)


def usable_rows(rows: RawRows, problems: list[str], may_lack: Collection[str]) -> LogFrame:
    """Leave out the rows that cannot be used; many of them are problems.

    Rows with a number in the first column only belong to another source. Columns that `may_lack`
    numbers have NaN in up to half of the rows: without an effort a motion is still known.
    """
    frame = rows.frame
    lacks = _lacking(rows, may_lack)
    rows = replace(rows, unreadable=rows.unreadable & ~lacks)
    finite = (np.isfinite(frame.values) | lacks).all(axis=1)
    absent: BoolArray = np.asarray((rows.unreadable | lacks)[:, 1:].all(axis=1))
    for i in np.flatnonzero(absent).tolist():
        absent[i] = not any(rows.cell(i, j) for j in range(1, len(frame.names)))
    absent &= not absent.all()
    bad = ~finite & ~absent
    wrong = _bad_cells(rows, absent, lacks) if bad.any() or rows.torn else []
    count, lost = len(bad) + len(rows.torn), int(bad.sum()) + len(rows.torn)
    few = count >= FEWEST and (lost <= BAD_SHARE * count or (rows.cut and lost == 1))
    if not few:
        problems += wrong
    keep = ~absent & ~bad if few else ~absent
    if not keep.all():  # else no copy: a long log takes much memory
        lines = [line for line, kept in zip(frame.lines, keep.tolist(), strict=True) if kept]
        frame = replace(frame, values=frame.values[keep], lines=lines)
    dropped, why = (lost, "; ".join(wrong)) if few else (0, "")
    return replace(frame, dropped=dropped, why=why, absent=int(absent.sum()))


def _lacking(rows: RawRows, may_lack: Collection[str]) -> BoolArray:
    """(rows, n) where a column that may lack numbers has none: an empty cell, or nan."""
    frame = rows.frame
    lacks = np.zeros(frame.values.shape, dtype=bool)
    for j in [j for j, name in enumerate(frame.names) if name in may_lack]:
        none = np.isnan(frame.values[:, j])
        for i in np.flatnonzero(none & rows.unreadable[:, j]).tolist():
            none[i] = not rows.cell(i, j).strip()  # a word is no number that was not taken
        lacks[:, j] = none & (none.sum() <= 0.5 * none.size)
    return lacks


def _bad_cells(rows: RawRows, absent: BoolArray, lacks: BoolArray) -> list[str]:
    problems, lines, names = [], rows.frame.lines, rows.frame.names
    if rows.torn:
        problems.append(
            f"the header has {rows.width} columns; rows with another number of cells: "
            f"{listing(rows.torn)}"
        )
    unreadable = rows.unreadable & ~absent[:, None]
    for j in np.flatnonzero((unreadable | absent[:, None]).all(axis=0)).tolist():
        if not any(rows.cell(i, j) for i in range(len(lines))):
            unreadable[:, j] = False
            problems.append(
                f"column {names[j]} is empty: name another by --columns FILE; a joint whose effort "
                "is unknown is left out by `identify --without JOINT`"
            )
    words = np.argwhere(unreadable).tolist()
    if words:
        where = listing(
            f"line {lines[i]}, column {names[j]}: {brief(rows.cell(i, j))}" for i, j in words
        )
        problems.append(f"not a number: {where}; {_remedy([rows.cell(i, j) for i, j in words])}")
    for j, name in enumerate(names):
        column = rows.frame.values[:, j]
        known = rows.unreadable[:, j] | lacks[:, j]
        wrong = np.flatnonzero(~np.isfinite(column) & ~known).tolist()
        if wrong:
            where = listing(f"{column[i]:g} at sample {i} (line {lines[i]})" for i in wrong)
            problems.append(f"column {name}: {where}; every value must be finite")
    return problems


def _remedy(cells: Sequence[str]) -> str:
    if any(re.search(r"\d[.:/-]\d+[.:/-]\d", cell) for cell in cells):
        return "times are seconds, or ISO 8601 (2026-11-22T10:00:00.25)"
    if any(re.fullmatch(r"-?\d+,\d+", cell) for cell in cells):
        return "write decimal points, or separate the columns by semicolons"
    return "leave these rows out, or log them again"


@dataclass(frozen=True)
class Log:
    """Samples that were measured; they are read and filtered as a file's are.

    Args:
        t: (T,) time; s, or as `ReadingOptions` say. Whole numbers keep all their digits.
        q: (T, nj) positions, rad or m; columns as the scene's joints.
        effort: (T, nj) N m or N; NaN where there is none.
        v: (T, nj) measured velocities, which are only compared.
        payload: payload -> (T,) 1 where it is carried.
        name: for messages.

    Raises:
        TrajectoryError: shapes that do not agree.
    """

    t: ArrayLike
    q: ArrayLike
    effort: ArrayLike | None = None
    v: ArrayLike | None = None
    payload: Mapping[str, ArrayLike] = field(default_factory=dict)
    name: str = "log"

    def opened(self, joints: Sequence[str]) -> OpenedLog:
        """Return the samples as an opened file, columns by the scene's joints."""
        t, shape = np.asarray(self.t), (np.size(self.t), len(joints))
        columns: dict[str, Any] = {"t": t}
        for quantity, array in (("", self.q), ("/velocity", self.v), ("/effort", self.effort)):
            if array is None:
                continue
            what = f"{self.name}: {quantity[1:] or 'q'}"
            values = real_numbers(what, array, TrajectoryError)
            if t.ndim != 1 or values.shape != shape:
                raise TrajectoryError(
                    f"{what} has shape {values.shape}; t and the scene's joints make {shape}"
                )
            columns |= {f"{joint}{quantity}": values[:, i] for i, joint in enumerate(joints)}
        for payload, carried in self.payload.items():
            columns[f"payload.{payload}"] = np.asarray(carried, dtype=np.float64)
        return arrays_log(columns, {}, recorded=True)
