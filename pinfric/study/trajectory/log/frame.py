"""Logs as frames: the numbers of the columns that are used, one row per line of the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pinfric.model.yamlfile import brief
from pinfric.study.trajectory.joint_columns import listing

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

#: Share of rows that may be torn or not finite before the file is refused.
BAD_SHARE = 0.01
#: Fewer rows than this are a table that somebody wrote: no row may be bad, none is judged.
FEWEST = 20
#: Whole numbers beyond this lose their last digits as floats.
EXACT = 2.0**53


@dataclass(frozen=True)
class LogFrame:
    """Numbers of the columns that were asked for.

    Args:
        numbers: a column of float64 each; the index says where each row stands in the file.
        resolution: column -> the last digit printed; left out: not rounded.
        origin: column -> whole number subtracted from it, so that the rest is exact.
        dropped, why: how many rows were left out, and which.
        absent: rows without a number in any of the columns but the first.
    """

    numbers: pd.DataFrame
    resolution: Mapping[str, float]
    origin: Mapping[str, int]
    dropped: int = 0
    why: str = ""
    absent: int = 0

    @property
    def lines(self) -> Sequence[int]:
        """Where each row stands in the file, for messages, (rows,)."""
        return self.numbers.index  # type: ignore[return-value]

    def column(self, name: str) -> FloatArray:
        """Return one of the columns, (rows,)."""
        return self.numbers[name].to_numpy(copy=True)  # a view would keep all the others


@dataclass(frozen=True)
class OpenedLog:
    """An opened file: its columns, a function that reads some of them, and notes on the file.

    Args:
        header: all columns.
        read: names of columns and a list for problems -> their numbers.
        first: the first row's texts, for columns that hold names.
        recorded: no file of ours: velocities in it are measured, not part of a plan.
        notes: what a person should know of the file.
        units: column -> unit, where the file itself says it.
    """

    header: list[str]
    read: Callable[[Sequence[str], list[str]], LogFrame]
    first: Sequence[str] = ()
    recorded: bool = False
    notes: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class RawRows:
    """Rows as they were read.

    Args:
        numbers: as in `LogFrame`; NaN where there was no number.
        unreadable: (rows, n) there was no number.
        torn: where rows with another number of cells stand, and how many they have.
        width: how many cells a row should have.
        cut: the only torn row is the last one: the log was cut off while it was written.
        cell: what stood at row, column.
    """

    numbers: pd.DataFrame
    unreadable: NDArray[np.bool_]
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
    """Return the log that columns of numbers are; whole numbers keep all their digits."""

    def read(names: Sequence[str], problems: list[str]) -> LogFrame:
        import pandas as pd

        origin, parts = {}, {}
        for name in names:
            values = columns[name]
            if values.dtype.kind in "iu" and values.size and abs(int(values[0])) > EXACT:
                origin[name] = int(values[0])
                values = values - values[0]
            parts[name] = np.asarray(values, dtype=np.float64)
        numbers = pd.DataFrame(parts)
        numbers.index += 1
        return usable_rows(RawRows(numbers, np.isnan(numbers.to_numpy())), {}, origin, problems)

    return OpenedLog(list(columns), read, recorded=recorded, notes=notes, units=units)


def usable_rows(
    rows: RawRows, resolution: Mapping[str, float], origin: Mapping[str, int], problems: list[str]
) -> LogFrame:
    """Leave out the rows that cannot be used: few of them are dropped, many are problems.

    Rows that have no number but in the first column belong to another source in the same file.
    """
    numbers = rows.numbers
    finite = np.isfinite(numbers.to_numpy()).all(axis=1)
    absent: NDArray[np.bool_] = np.asarray(rows.unreadable[:, 1:].all(axis=1))
    for i in np.flatnonzero(absent).tolist():
        absent[i] = not any(rows.cell(i, j) for j in range(1, numbers.shape[1]))
    absent &= not absent.all()
    bad = ~finite & ~absent
    wrong = _bad_cells(rows, absent) if bad.any() or rows.torn else []
    count, lost = len(bad) + len(rows.torn), int(bad.sum()) + len(rows.torn)
    few = count >= FEWEST and (lost <= BAD_SHARE * count or (rows.cut and lost == 1))
    if not few:
        problems += wrong
    keep = ~absent & ~bad if few else ~absent
    if not keep.all():  # else no copy: a long log takes much memory
        numbers = numbers.loc[keep]
    return LogFrame(
        numbers,
        resolution,
        origin,
        lost if few else 0,
        "; ".join(wrong) if few else "",
        int(absent.sum()),
    )


def _bad_cells(rows: RawRows, absent: NDArray[np.bool_]) -> list[str]:
    """Say what is torn, what is no number, and what is not finite."""
    found, lines, names = [], rows.numbers.index, list(rows.numbers)
    if rows.torn:
        found.append(
            f"the header has {rows.width} columns; rows with another number of cells: "
            f"{listing(rows.torn)}"
        )
    words = np.argwhere(rows.unreadable & ~absent[:, None]).tolist()
    if words:
        where = listing(
            f"line {lines[i]}, column {names[j]}: {brief(rows.cell(i, j))}" for i, j in words
        )
        found.append(f"not a number: {where}")
    for j, name in enumerate(names):
        column = rows.numbers[name].to_numpy()
        wrong = np.flatnonzero(~np.isfinite(column) & ~rows.unreadable[:, j]).tolist()
        if wrong:
            where = listing(f"{column[i]:g} at sample {i} (line {lines[i]})" for i in wrong)
            found.append(f"column {name}: {where}; every value must be finite")
    return found
