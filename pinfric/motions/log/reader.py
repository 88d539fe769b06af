"""The one reader of trajectory files with samples: from a path to a table on which to compute."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError
from pinfric.model.brief import counted
from pinfric.model.yamlfile import brief
from pinfric.motions.joint_columns import JointColumn, listing, refuse
from pinfric.motions.log.bags import is_bag, open_bag
from pinfric.motions.log.columns import PAYLOAD, Columns, Use, find_columns, read_mapping
from pinfric.motions.log.csv_file import open_csv
from pinfric.motions.log.files import open_matlab, open_parquet
from pinfric.motions.log.frame import Log, LogFrame, OpenedLog
from pinfric.motions.log.motion import Settled, settle, unwrapped
from pinfric.motions.log.reading import ANGLE_UNITS, Reading, ReadingOptions, Thinning
from pinfric.motions.log.rows import check_times, gap_problems, mended_effort, ordered_rows
from pinfric.motions.log.units import (
    angle_unit,
    fast_angles,
    frozen_angles,
    is_clock,
    slow_angles,
    time_factor,
    unwrapped_steps,
)
from pinfric.motions.table import TrajectoryTable, mismatch_warning

FloatArray = NDArray[np.float64]

#: Endings of the files that are read here; a bag may be a folder, too.
SUFFIXES = (".csv", ".tsv", ".txt", ".csv.gz", ".parquet", ".mat", ".db3", ".mcap")


#: What a file with samples says: the joints it names, their table, how it was read.
Logged = tuple[tuple[JointColumn, ...], TrajectoryTable, Reading]


def read_log(
    source: Path | Log,
    joints: Sequence[JointColumn],
    payloads: Sequence[str],
    choose: Callable[[Sequence[str], list[str]], tuple[JointColumn, ...]],
    options: ReadingOptions,
    problems: list[str],
) -> Logged:
    """Read a CSV, Parquet or MATLAB file, a bag, or arrays.

    Args:
        source: the file, a bag's folder, or a log's arrays.
        joints: all that may have a column.
        payloads: those that may have a column `payload.<name>`.
        choose: names of the joints that have positions, problems -> the joints that must have.
        options: what the person said.
        problems: everything wrong in the file is appended here.

    Raises:
        TrajectoryError: the file cannot be opened, or holds nothing to compute with.
    """
    name = source.name if isinstance(source, Log) else str(source)
    if isinstance(source, Log):
        log, mapping = source.opened([joint.name for joint in joints]), None
    else:
        log, mapping = _open(source, joints), read_mapping(source, options.columns)
    found = find_columns(
        log.header, log.first, joints, payloads, mapping, problems, options.currents
    )
    named = choose(list(found.position), problems)
    missing = [column.name for column in named if column.name not in found.position]
    others = listing(map(brief, found.ignored))
    if missing and found.position:
        near = f" (columns not used: {others})" if others else ""
        problems.append(
            f"joints without a column: {', '.join(missing)}{near}; name theirs by "
            "--columns FILE, or lock them in the scene (robot: locked)"
        )
    named = tuple(column for column in named if column.name in found.position)
    if not found.time or not named:
        refuse(name, problems)
    notes = [*log.notes, *found.notes, *([f"columns not used: {others}"] if others else [])]
    options = replace(options, unit=options.unit or (mapping.unit if mapping else None))
    rows = _in_si(name, log, found, named, options, problems, notes)
    return _settled(log, found, named, rows, options, problems, notes)


def _open(path: Path, joints: Sequence[JointColumn]) -> OpenedLog:
    if is_bag(path):
        return open_bag(path, [joint.name for joint in joints])
    if path.is_dir():
        raise TrajectoryError(f"{path}: is a folder without metadata.yaml, so it is not a bag")
    name = path.name.lower()
    for suffix, opened in ((".parquet", open_parquet), (".mat", open_matlab), (SUFFIXES, open_csv)):
        if name.endswith(suffix):
            return opened(path)
    raise TrajectoryError(
        f"{path}: a trajectory ends in .csv, .yaml or .yml; a log in {', '.join(SUFFIXES)}"
    )


def _say_dropped(cells: LogFrame, notes: list[str]) -> None:
    if cells.dropped:
        notes.append(
            f"left out {counted(cells.dropped, 'row')} of "
            f"{len(cells.values) + cells.dropped}: {cells.why}"
        )
    if cells.absent:
        notes.append(f"{counted(cells.absent, 'row')} without positions skipped")


@dataclass(frozen=True)
class _Measured:
    """The rows of a log in SI and in order of time.

    Args:
        plan: what they say of the motion.
        effort: (T, nj) N m or N; NaN where there is none.
        dropped: rows left out.
    """

    plan: TrajectoryTable
    effort: FloatArray
    dropped: int


def _in_si(
    name: str,
    log: OpenedLog,
    found: Columns,
    named: tuple[JointColumn, ...],
    options: ReadingOptions,
    problems: list[str],
    notes: list[str],
) -> _Measured:
    """Turn cells into SI, and put the rows in order."""
    cells = log.read(found.used(), problems)
    if len(cells.values) == 0:
        refuse(name, problems)
    _say_dropped(cells, notes)
    uses = [found.position[column.name] for column in named]
    raw = _quantity(cells, {name: Use(use.column) for name, use in found.position.items()}, named)
    known = [use.unit for use in uses]
    if found.by_header and options.unit:  # a person knows better than a header
        known = [None] * len(known)
    factors = angle_unit(named, raw, known, options.unit, problems, notes)
    del raw
    position = _quantity(cells, found.position, named, factors)
    resolution = np.array([cells.resolution.get(use.column, 0.0) for use in uses])
    found.time_unit = options.time_unit or found.time_unit or log.units.get(found.time)
    t = _seconds(cells, found, _speeds(named, position), problems, notes)
    check_times(t, cells.lines, problems)
    kept = ordered_rows(t, cells.lines, problems, notes)
    taken = slice(None) if kept.size == t.size else kept
    own_plan = found.planned and bool(found.velocity)
    if not problems and not own_plan and set(factors) == {1.0}:
        problems += fast_angles(named, t[kept], position[taken], known, options.unit)
    if not problems and found.by_header and not options.unit:
        problems += slow_angles(named, t[kept], position[taken], factors)
    position = unwrapped(named, position[taken], notes)
    lines = [cells.lines[i] for i in kept] if kept.size < t.size else cells.lines
    if not problems and not own_plan:
        problems += frozen_angles(named, t[kept], position, lines)
    velocity, acceleration = (
        _quantity(cells, part, named, _own_units(part, named, factors, options.unit))[taken]
        for part in (found.velocity, found.acceleration)
    )
    attached = {name: _phase(cells, name, problems)[kept] for name in found.payloads}
    plan = TrajectoryTable(
        t[kept], position, velocity, acceleration, attached, resolution * np.abs(factors)
    )
    effort = _quantity(cells, found.effort, named)[taken]
    for i, column in enumerate(named):
        if column.name in found.effort:
            effort[:, i] = mended_effort(column.name, effort[:, i], lines, problems, notes)
    return _Measured(plan, effort, cells.dropped + len(cells.values) - kept.size)


def _settled(
    log: OpenedLog,
    found: Columns,
    named: tuple[JointColumn, ...],
    rows: _Measured,
    options: ReadingOptions,
    problems: list[str],
    notes: list[str],
) -> Logged:
    """Settle on the motion behind the rows."""
    plan = rows.plan
    if problems:
        return named, plan, Reading(plan.t.size)
    logged = plan.velocity if found.velocity else None
    if log.recorded or not found.planned:
        notes += _compared(named, plan)
        nothing = np.broadcast_to(np.nan, plan.position.shape)
        plan = replace(plan, velocity=nothing, acceleration=nothing)
    recorded = log.recorded or bool(found.effort)
    settled = settle(named, plan, options, problems, recorded, logged)
    if settled.reading.filtered and np.isfinite(plan.velocity).any():
        notes.append(
            "velocities in the file are not used: they are derived from filtered positions"
        )
    if log.recorded:
        notes += _smoothed_already(settled.reading)
        problems += [gap for gap in gap_problems(plan.t) if gap not in problems]
    reading = replace(
        settled.reading,
        dropped=settled.reading.dropped + rows.dropped,
        effort={
            column.name: _beside(settled, rows.effort[:, i], options.thinning)
            for i, column in enumerate(named)
            if column.name in found.effort
        },
        notes=(*notes, *settled.reading.notes),
    )
    return named, settled.table, reading


def _beside(settled: Settled, effort: FloatArray, thinning: Thinning | None) -> FloatArray:
    """Return the effort at a motion's samples of that in the rows, (T,)."""
    whole = np.interp(settled.rows, np.arange(effort.size), effort)
    if thinning is None or settled.every == 1:
        return whole
    t = settled.table.t
    step = float(t[-1] - t[0]) / ((t.size - 1) * settled.every)
    return thinning.effort(whole, step)[:: settled.every].copy()  # a view would keep all of it


def _smoothed_already(reading: Reading) -> list[str]:
    """Say that a recording has no noise: something has filtered it before."""
    if reading.noise_line:
        return []
    largest = max(reading.noise.values(), default=0.0)
    return [f"positions have almost no noise ({largest:.1e}): already smooth, not filtered"]


def _quantity(
    cells: LogFrame,
    uses: Mapping[str, Use],
    named: Sequence[JointColumn],
    factors: Sequence[float] | None = None,
) -> FloatArray:
    """Return one quantity of the joints in SI, (rows, nj); NaN where there is no column."""
    if not uses:
        return np.broadcast_to(np.nan, (len(cells.values), len(named)))
    values = np.full((len(cells.values), len(named)), np.nan)
    for i, column in enumerate(named):
        if (use := uses.get(column.name)) is not None:
            factor = use.factor * (1.0 if factors is None else factors[i])
            values[:, i] = factor * cells.column(use.column) + use.offset
    return values


def _own_units(
    uses: Mapping[str, Use], named: Sequence[JointColumn], of_angles: list[float], given: str | None
) -> list[float]:
    """Return rad per unit: what a column's header says, else that of the joint's angles."""
    units = [None if given or c.name not in uses else uses[c.name].unit for c in named]
    return [
        of_angle if unit is None or column.unit != "rad" else ANGLE_UNITS[unit]
        for column, unit, of_angle in zip(named, units, of_angles, strict=True)
    ]


def _speeds(named: Sequence[JointColumn], position: FloatArray) -> tuple[float, float]:
    """The largest speed over its limit, and the largest speed, per row."""
    if len(position) < 2:
        return 0.0, 0.0
    largest = np.zeros(len(named))
    for i, q in enumerate(position.T):  # one after another: a long log fills much of the memory
        steps = unwrapped_steps(q)
        largest[i] = np.max(steps, where=np.isfinite(steps), initial=0.0)
    limits = np.array([column.velocity_limit for column in named])
    return float((largest / limits).max(initial=0.0)), float(largest.max(initial=0.0))


def _seconds(
    cells: LogFrame,
    found: Columns,
    speeds: tuple[float, float],
    problems: list[str],
    notes: list[str],
) -> FloatArray:
    """Return the rows' times in s, those of a clock from its first one on."""
    t = cells.column(found.time)
    start = float(cells.origin.get(found.time, 0)) + float(t[0])
    if found.nanoseconds is not None:
        return (t - t[0]) + 1e-9 * cells.column(found.nanoseconds)
    factor = time_factor(found.time, t, start, found.time_unit, speeds, problems, notes)
    if is_clock(start * factor):
        notes.append(f"column {found.time} is clock time: times count from its first row")
        t = t - t[0]
    return t if factor == 1.0 else t * factor


def _phase(cells: LogFrame, name: str, problems: list[str]) -> NDArray[np.bool_]:
    values = cells.column(PAYLOAD + name)
    wrong = np.flatnonzero(np.isfinite(values) & (values != 0.0) & (values != 1.0))
    if wrong.size:
        where = listing(f"{values[i]:g} at line {cells.lines[i]}" for i in wrong.tolist())
        problems.append(f"column {PAYLOAD}{name}: 1 (carried) or 0, found {where}")
    return values == 1.0


def _compared(named: Sequence[JointColumn], plan: TrajectoryTable) -> list[str]:
    """Say where velocities that were measured do not fit the positions."""
    if plan.t.size < 2 or (np.diff(plan.t) <= 0.0).any():
        return []
    return [
        line
        for i, column in enumerate(named)
        if np.isfinite(plan.velocity[:, i]).all()
        for line in mismatch_warning(
            column, plan.t, plan.position[:, i], plan.velocity[:, i], plan.resolution[i]
        )
    ]
