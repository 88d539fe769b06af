"""Read a trajectory's CSV file: every problem in it is found before anything is raised."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError, choose_from
from pinfric.model.yamlfile import brief, brief_path
from pinfric.study.derivatives import (
    acceleration_noise,
    find_holds,
    position_derivatives,
    velocity_derivative,
)
from pinfric.study.joint_columns import JointColumn, listing

FloatArray = NDArray[np.float64]

#: A time step this many times the median one is a gap: a spline across it would be invented.
GAP_FACTOR = 20.0
#: Share of a joint's peak acceleration that may be rounding noise before it is pointed out.
_NOISE_SHARE = 0.05
#: Share of a joint's peak speed by which its velocities may miss those of its positions (RMS).
_MISMATCH_SHARE = 0.1
#: Fewer samples than this say too little about noise or about a mismatch.
_FEWEST_SAMPLES = 20
#: Rows looked at to see how many digits a file prints.
_ROWS_FOR_DIGITS = 500
_PAYLOAD = "payload."


@dataclass(frozen=True)
class TrajectoryTable:
    """A motion with one number per joint, (T, nj); a column of NaN is one that was not given.

    `attached` holds the payload columns there are, (T,) bool each; `resolution` (nj,) the last
    digit printed of each joint's positions (0: not rounded).
    """

    t: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    attached: dict[str, NDArray[np.bool_]]
    resolution: FloatArray


@dataclass(frozen=True)
class _Cells:
    """The file's cells: values (rows, columns), NaN where unreadable; each row's line number."""

    header: list[str]
    values: FloatArray
    lines: list[int]
    texts: list[str]
    unreadable: NDArray[np.bool_]


def read_table(
    path: Path, joint_names: Sequence[str], payload_names: Sequence[str], problems: list[str]
) -> TrajectoryTable:
    """Read a CSV file with columns t, <joint>, <joint>.v, <joint>.a, payload.<name>.

    Args:
        path: the file.
        joint_names: (nj,) the joints that must have a column.
        payload_names: the payloads that may have one.
        problems: everything wrong in the file is appended here; the table then has NaN there.

    Raises:
        TrajectoryError: the file cannot be opened, is not text, or holds nothing.
    """
    cells = _read_cells(path, problems)
    known = _known_columns(joint_names, payload_names)
    _check_header(cells.header, joint_names, payload_names, known, problems)
    _check_finite(cells, known, problems)
    t = _column(cells, "t")
    _check_time(t, cells.lines, problems)
    attached = {
        name: _phase(cells, _PAYLOAD + name, problems)
        for name in payload_names
        if _PAYLOAD + name in cells.header
    }
    position, velocity, acceleration = (
        np.array([_column(cells, n + suffix) for n in joint_names]).reshape(len(joint_names), -1).T
        for suffix in ("", ".v", ".a")
    )
    resolution = np.array([_resolution(cells, name) for name in joint_names])
    return TrajectoryTable(t, position, velocity, acceleration, attached, resolution)


def _read_cells(path: Path, problems: list[str]) -> _Cells:
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
    _check_cells(path, rows)
    header = [cell.strip() for cell in next(csv.reader([rows[0][1]]))]
    if len(header) == 1 and re.search(r"[;\t]", header[0]):
        raise TrajectoryError(f"{path}: columns are separated by commas, found {brief(header[0])}")
    if len(rows) == 1:
        raise TrajectoryError(f"{path}: has a header and no samples below it")
    return _parse_rows(header, [n for n, _ in rows[1:]], [line for _, line in rows[1:]], problems)


def _check_cells(path: Path, rows: Sequence[tuple[int, str]]) -> None:
    """Refuse lines no CSV reader takes by themselves: an open quote swallows the next line."""
    wrong, longest = [], csv.field_size_limit()
    for number, line in rows:
        if '"' in line or len(line) > longest:
            try:
                next(csv.reader([line], strict=True))
            except csv.Error as problem:
                is_open = "unexpected end" in str(problem)
                wrong.append(f"line {number} ({'a quote is not closed' if is_open else problem})")
    if wrong:
        raise TrajectoryError(f"{path}: cannot be split at its commas: {listing(wrong)}; numbers "
                              "and names need no quotes")  # fmt: skip


def _parse_rows(
    header: list[str], lines: list[int], texts: list[str], problems: list[str]
) -> _Cells:
    """Parse all rows at once; only where that fails look at each cell, to say which ones."""
    try:
        values = np.loadtxt(texts, delimiter=",", comments=None, quotechar='"', ndmin=2)
        if values.shape == (len(texts), len(header)):
            return _Cells(header, values, lines, texts, np.zeros(values.shape, dtype=bool))
    except ValueError:
        pass
    parsed, kept, wrong_length, wrong_cell = [], [], [], []
    for index, cells in enumerate(csv.reader(texts)):
        if len(cells) != len(header):
            wrong_length.append(f"line {lines[index]} ({len(cells)})")
            continue
        row = [_number(cell) for cell in cells]
        wrong_cell += [
            f"line {lines[index]}, column {name}: {brief(cell.strip())}"
            for name, cell, number in zip(header, cells, row, strict=True)
            if number is None
        ]
        parsed.append(row)
        kept.append(index)
    if wrong_length:
        problems.append(f"the header has {len(header)} columns; rows with another number of "
                        f"cells: {listing(wrong_length)}")  # fmt: skip
    if wrong_cell:
        problems.append(f"not a number: {listing(wrong_cell)}")
    unreadable = np.array([[cell is None for cell in row] for row in parsed], dtype=bool)
    values = np.array([[math.nan if c is None else c for c in row] for row in parsed], dtype=float)
    shape = (len(parsed), len(header))
    return _Cells(header, values.reshape(shape), [lines[i] for i in kept],
                  [texts[i] for i in kept], unreadable.reshape(shape))  # fmt: skip


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _known_columns(joint_names: Sequence[str], payload_names: Sequence[str]) -> list[str]:
    return [
        "t",
        *joint_names,
        *(name + suffix for suffix in (".v", ".a") for name in joint_names),
        *(_PAYLOAD + name for name in payload_names),
    ]


def _check_header(
    header: list[str],
    joint_names: Sequence[str],
    payload_names: Sequence[str],
    known: list[str],
    problems: list[str],
) -> None:
    for name in dict.fromkeys(header):
        if header.count(name) > 1:
            problems.append(f"column {brief(name)} stands {header.count(name)} times")
        if name in known:
            continue
        if name.startswith(_PAYLOAD):
            short = name.removeprefix(_PAYLOAD)
            problems.append(f"unknown payload in column {brief(name)}; "
                            f"{choose_from(short, payload_names)}")  # fmt: skip
        else:
            problems.append(f"unknown column {brief(name)} (locked joints and mimic followers have "
                            f"none); {choose_from(name, known)}")  # fmt: skip
    if "t" not in header:
        problems.append("there is no column t (time, s)")
    missing = [name for name in joint_names if name not in header]
    if missing:
        problems.append(f"joints without a column: {', '.join(missing)}")


def _check_finite(cells: _Cells, known: list[str], problems: list[str]) -> None:
    wrong = ~np.isfinite(cells.values) & ~cells.unreadable
    for index, name in enumerate(cells.header):
        if name in known and wrong[:, index].any():
            samples = np.flatnonzero(wrong[:, index])
            where = listing(f"{cells.values[i, index]:g} at sample {i} (line {cells.lines[i]})"
                            for i in samples)  # fmt: skip
            problems.append(f"column {name}: {where}; every value must be finite")


#: s. Below this a time step is a unit error or rounding: rates from it would be noise.
_SHORTEST_STEP = 1e-9
#: s, three centuries. Beyond it a time is a unit error (a clock's milliseconds are), and the steps
#: between times drown in its rounding.
_LONGEST_TIME = 1e10


def _check_time(t: FloatArray, lines: list[int], problems: list[str]) -> None:
    far = np.flatnonzero(np.isfinite(t) & (np.abs(t) > _LONGEST_TIME))
    if far.size:
        where = listing(f"line {lines[i]} (t = {t[i]:.9g})" for i in far)
        problems.append(f"times beyond {_LONGEST_TIME:g} s cannot be meant, t is in seconds: "
                        f"{where}")  # fmt: skip
        return
    back = np.flatnonzero(np.diff(t) <= 0)
    if back.size:
        where = listing(f"line {lines[i + 1]} (t = {t[i + 1]:.9g} after {t[i]:.9g})" for i in back)
        problems.append(f"time must increase; it does not at {where}")
        return
    tiny = np.flatnonzero(np.diff(t) < _SHORTEST_STEP)
    if tiny.size:
        where = listing(f"line {lines[i + 1]} ({t[i + 1] - t[i]:.3g} s)" for i in tiny)
        problems.append(f"time steps below {_SHORTEST_STEP:g} s cannot be meant: {where}")


def _column(cells: _Cells, name: str) -> FloatArray:
    if name not in cells.header:
        return np.full(len(cells.lines), np.nan)
    return np.ascontiguousarray(cells.values[:, cells.header.index(name)])


def _phase(cells: _Cells, name: str, problems: list[str]) -> NDArray[np.bool_]:
    values = _column(cells, name)
    wrong = np.flatnonzero(np.isfinite(values) & (values != 0.0) & (values != 1.0))
    if wrong.size:
        where = listing(f"{values[i]:g} at line {cells.lines[i]}" for i in wrong)
        problems.append(f"column {name}: 1 (carried) or 0, found {where}")
    return values == 1.0


def _resolution(cells: _Cells, name: str) -> float:
    """The last digit printed of a column: 10^(digits before the point of the largest - digits)."""
    if name not in cells.header or not cells.texts:
        return 0.0
    values = np.abs(_column(cells, name))
    largest = float(np.max(values, where=np.isfinite(values), initial=0.0))
    if largest == 0.0:
        return 0.0
    step = max(1, len(cells.texts) // _ROWS_FOR_DIGITS)
    index = cells.header.index(name)
    digits = max(_significant_digits(line.split(",")[index]) for line in cells.texts[::step])
    return float(10.0 ** (math.floor(math.log10(largest)) + 1 - digits))


def _significant_digits(cell: str) -> int:
    mantissa = re.split("[eE]", cell, maxsplit=1)[0]
    return len(re.sub(r"\D", "", mantissa).lstrip("0"))


@np.errstate(over="ignore", invalid="ignore")  # what overflows is refused as not finite
def complete_derivatives(
    columns: Sequence[JointColumn],
    table: TrajectoryTable,
    problems: list[str],
    warnings: list[str],
) -> tuple[FloatArray, FloatArray]:
    """Return velocities and accelerations (T, nj), those not given from splines (`derivatives`).

    Args:
        columns: (nj,) the joints.
        table: the motion; its time increases and its positions are finite.
        problems: what cannot be derived is appended here.
        warnings: where rounding spoils an acceleration, or velocities do not fit the positions,
            is appended here.
    """
    v, a = table.velocity.copy(), table.acceleration.copy()
    for i, column in enumerate(columns):
        if not np.isnan(v[0, i]):
            warnings += _mismatch_warning(
                column, table.t, table.position[:, i], v[:, i], table.resolution[i]
            )
    missing = [i for i in range(len(columns)) if np.isnan(v[0, i]) or np.isnan(a[0, i])]
    if missing and table.t.size == 1:
        names = ", ".join(columns[i].name for i in missing)
        problems.append(f"one sample says nothing about derivatives: give .v and .a for {names}")
        return v, a
    gaps = _gaps(table.t) if missing else []
    for i in missing:
        q, resolution = table.position[:, i], table.resolution[i]
        holds = find_holds(q, resolution)
        problems += _moved_across(columns[i], table.t, q, gaps)
        try:
            if not np.isnan(v[0, i]):
                a[:, i] = velocity_derivative(table.t, v[:, i], holds)
                continue
            fitted_v, fitted_a = position_derivatives(table.t, q, holds)
        except ValueError as problem:  # SciPy: numbers too far apart for a spline
            problems.append(f"joint {columns[i].name}: no spline goes through its samples "
                            f"({problem}); give .v and .a")  # fmt: skip
            continue
        v[:, i] = fitted_v
        if np.isnan(a[0, i]):
            a[:, i] = fitted_a
            warnings += _noise_warning(columns[i], table.t, fitted_a, resolution)
    return v, a


def _gaps(t: FloatArray) -> list[int]:
    """Return the samples after which a step is far longer than the median one."""
    steps = np.diff(t)
    return [int(i) for i in np.flatnonzero(steps > GAP_FACTOR * np.median(steps))]


def _moved_across(
    column: JointColumn, t: FloatArray, q: FloatArray, gaps: Iterable[int]
) -> list[str]:
    moved = [i for i in gaps if q[i] != q[i + 1]]
    if not moved:
        return []
    where = listing(f"{t[i]:.6g} to {t[i + 1]:.6g} s" for i in moved)
    return [f"joint {column.name}: moves across gaps in time ({where}), where its derivatives "
            "would be invented; give .v and .a, or the missing samples"]  # fmt: skip


def _mismatch_warning(
    column: JointColumn, t: FloatArray, q: FloatArray, v: FloatArray, resolution: float
) -> list[str]:
    """Compare the mean velocity of each time step by positions and by velocities.

    Both are of second order in the step, which is as fine as a share of a tenth asks for, and cost
    little where a motion has millions of samples.
    """
    if t.size < _FEWEST_SAMPLES:
        return []
    steps, moves = np.diff(t), np.diff(q)
    if column.nq == 2:  # an angle may be written within +-pi
        moves -= 2.0 * np.pi * np.round(moves / (2.0 * np.pi))
    dense = steps <= GAP_FACTOR * np.median(steps)
    by_position = moves[dense] / steps[dense]
    by_velocity = 0.5 * (v[1:] + v[:-1])[dense]
    # two roundings of resolution / sqrt(12) each, and three standard deviations
    noise = 3.0 * resolution / np.sqrt(6.0) / float(np.median(steps))
    peak = max(float(np.abs(by_position).max()) - noise, float(np.abs(v).max()))
    miss = float(np.sqrt(np.mean((by_position - by_velocity) ** 2)))
    if miss <= _MISMATCH_SHARE * peak + noise:
        return []
    return [
        f"joint {column.name}: the velocities given do not fit the positions: they differ by "
        f"{miss:.3g} {column.unit}/s (RMS) at speeds up to {peak:.3g}; check units, order and "
        "sign, or leave the velocities out"
    ]


def _noise_warning(
    column: JointColumn, t: FloatArray, acceleration: FloatArray, resolution: float
) -> list[str]:
    noise, peak = acceleration_noise(t, resolution), float(np.abs(acceleration).max())
    # where a joint stands still throughout, its accelerations are 0 and hold no noise
    if t.size < _FEWEST_SAMPLES or peak == 0.0 or noise <= _NOISE_SHARE * peak:
        return []
    return [
        f"joint {column.name}: positions rounded to {resolution:.1g} {column.unit} leave noise of "
        f"about {noise:.2g} {column.unit}/s^2 in accelerations that peak at {peak:.3g}; give more "
        "digits, or .v and .a columns"
    ]
