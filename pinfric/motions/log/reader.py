"""The one reader of trajectory files with samples: from a path to a table on which to compute."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from pinfric.errors import TrajectoryError
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.brief import counted
from pinfric.model.inputs import note_input
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION
from pinfric.model.yamlfile import brief
from pinfric.motions.joint_columns import JointColumn, listing, refuse
from pinfric.motions.log.bags import is_bag, open_bag
from pinfric.motions.log.columns import (
    PAYLOAD,
    Columns,
    Use,
    find_columns,
    meaning_of,
    read_mapping,
)
from pinfric.motions.log.csv_file import open_csv
from pinfric.motions.log.files import open_json, open_matlab, open_numpy, open_parquet
from pinfric.motions.log.frame import Log, LogFrame, OpenedLog
from pinfric.motions.log.motion import Samples, regularise, smooth, unwrapped
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
    wrong_velocities,
)
from pinfric.motions.table import TrajectoryTable, mismatch_warning

#: Endings of the files that are read here; a bag may be a folder, too.
SUFFIXES = (".csv", ".tsv", ".txt", ".csv.gz", ".parquet", ".mat", ".npz", ".json", ".db3", ".mcap")
#: How files of arrays are opened; all others are text or bags.
_OPENED = {
    ".parquet": open_parquet,
    ".mat": open_matlab,
    ".npz": open_numpy,
    ".json": open_json,
}

#: rad or m: a joint that goes no farther, as a gripper's finger, is locked nearly where it is.
_LOCKED_WAY = 0.05

#: What a file with samples says: the joints it names, their table, how it was read.
Logged = tuple[tuple[JointColumn, ...], TrajectoryTable, Reading]


def read_log(
    source: Path | Log,
    joints: Sequence[JointColumn],
    payloads: Sequence[str],
    choose: Callable[[Sequence[str], list[str]], tuple[JointColumn, ...]],
    options: ReadingOptions,
    problems: list[str],
    locked: Mapping[str, tuple[float, str]] = MappingProxyType({}),
) -> Logged:
    """Read a CSV, Parquet or MATLAB file, a bag, or arrays.

    Args:
        source: the file, a bag's folder, or a log's arrays.
        joints: all that may have a column.
        payloads: those that may have a column `payload.<name>`.
        choose: names of the joints that have positions, problems -> the joints that must have.
        options: what the person said.
        problems: everything wrong in the file is appended here.
        locked: joint -> where the scene fixes it, and the unit of that, "rad" or "m".

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
    options = replace(options, unit=options.unit or (mapping.unit if mapping else None))
    found.effort = {x: use for x, use in found.effort.items() if x not in options.without}
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
    if not (found.time or found.rate) or not named:
        refuse(name, problems)
    notes = [*log.notes, *found.notes, *([f"columns not used: {others}"] if others else [])]
    samples, efforts, factors = _to_si(name, log, found, named, options, problems, notes)
    turns = [factor for column, factor in zip(named, factors, strict=True) if column.unit == "rad"]
    problems += _moving_though_locked(log, found.ignored, locked, (turns or [1.0])[0])
    if not problems:
        samples = smooth(samples, regularise(samples), options)
        if samples.reading.filtered and found.planned and found.velocity and not log.recorded:
            samples.said(
                "velocities in the file are not used: they are derived from filtered positions"
            )
        _finish(samples, log.recorded, efforts, options.thinning)
    return named, samples.table, samples.reading


def _open(path: Path, joints: Sequence[JointColumn]) -> OpenedLog:
    note_input(path, *(path.iterdir() if path.is_dir() else ()))
    if is_bag(path):
        return open_bag(path, [joint.name for joint in joints])
    if path.is_dir():
        raise TrajectoryError(f"{path}: is a folder without metadata.yaml, so it is not a bag")
    if path.exists() and not path.is_file():
        raise TrajectoryError(
            f"{path}: is a pipe or a device, and a log is read twice: save it first"
        )
    name = path.name.lower()
    if name.endswith(SUFFIXES):
        return _OPENED.get(Path(name).suffix, open_csv)(path)
    raise TrajectoryError(
        f"{path}: a trajectory ends in .csv, .yaml or .yml; a log in {', '.join(SUFFIXES)}"
    )


def _refuse_absurd(name: str, cells: LogFrame, found: Columns, problems: list[str]) -> None:
    """Refuse numbers beyond those of any motion before units, noise and speeds are asked of them.

    Times have their own bounds: nanoseconds since 1970 are beyond 1e18.
    """
    given = ("position", found.position), ("velocity", found.velocity)
    worst = {
        f"{what} of {joint}": np.nanmax(np.abs(column), initial=0.0, where=np.isfinite(column))
        for what, uses in (*given, ("acceleration", found.acceleration))
        for joint, use in uses.items()
        for column in [cells.column(use.column)]
    }
    absurd = [
        f"{what}: {value:g} is beyond {LARGEST_OF_A_MOTION:g}"
        for what, value in worst.items()
        if value > LARGEST_OF_A_MOTION
    ]
    refuse(name, [*problems, *absurd] if absurd else [])


def _to_si(
    name: str,
    log: OpenedLog,
    found: Columns,
    named: tuple[JointColumn, ...],
    options: ReadingOptions,
    problems: list[str],
    notes: list[str],
) -> tuple[Samples, dict[str, FloatArray], list[float]]:
    """Return the rows in SI and in order of time, joint -> (rows,) effort, and rad per unit."""
    cells = log.read(found.used(), problems)
    if len(cells.values) == 0:
        refuse(name, problems)
    _refuse_absurd(name, cells, found, problems)
    if cells.dropped:
        every = len(cells.values) + cells.dropped
        notes.append(f"left out {counted(cells.dropped, 'row')} of {every}: {cells.why}")
    if cells.absent:
        notes.append(f"{counted(cells.absent, 'row')} without positions skipped")
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
    t, position = t[kept], position[taken]
    planned, by_header = found.planned and bool(found.velocity), found.by_header
    if not problems and not planned and set(factors) == {1.0}:
        problems += fast_angles(named, t, position, known, options.unit)
    if not problems and by_header and not options.unit:
        problems += slow_angles(named, t, position, factors)
    position = unwrapped(named, position, notes)
    lines = [cells.lines[i] for i in kept] if kept.size < len(cells.lines) else cells.lines
    if not problems and not planned:
        problems += frozen_angles(named, t, position, lines)
    velocity, acceleration = (
        _quantity(cells, part, named, _own_units(part, named, factors, options.unit))[taken]
        for part in (found.velocity, found.acceleration)
    )
    attached = {name: _phase(cells, name, problems)[kept] for name in found.payloads}
    efforts = {
        column.name: mended_effort(column.name, effort[taken], q, lines, problems, notes)
        for column, q in zip(named, position.T, strict=True)
        if (use := found.effort.get(column.name))
        for effort in [use.factor * cells.column(use.column)]
    }
    table = TrajectoryTable(
        t, position, velocity, acceleration, attached, resolution * np.abs(factors)
    )
    logged = velocity if found.velocity else None
    if not problems and (log.recorded or not found.planned or efforts):
        problems += wrong_velocities(named, t, position, velocity)
    if not problems and (log.recorded or not found.planned):
        notes += _compared(named, table)
        nothing = np.broadcast_to(np.nan, position.shape)
        table = replace(table, velocity=nothing, acceleration=nothing)
    reading = Reading(
        t.size,
        cells.dropped + len(cells.values) - t.size,
        noise={column.name: 0.0 for column in named},
        cutoff={column.name: None for column in named},
        notes=tuple(notes),
    )
    recorded, rows = log.recorded or bool(found.effort), np.arange(t.size, dtype=np.float64)
    return Samples(named, table, rows, reading, problems, recorded, logged), efforts, factors


def _moving_though_locked(
    log: OpenedLog,
    columns: Sequence[str],
    locked: Mapping[str, tuple[float, str]],
    factor: float,
) -> list[str]:
    """Return a line for each joint that the scene fixes, and that moves in the log."""
    found = []
    for column in columns:
        joint, quantity = meaning_of(column, tuple(locked), {}) or ("", "")
        if quantity != "position":
            continue
        place, unit = locked[joint]
        q = (factor if unit == "rad" else 1.0) * log.read([column], []).values[:, 0]
        q = q[np.isfinite(q)]
        if q.size and np.ptp(q) > _LOCKED_WAY:
            found.append(
                f"joint {joint}: the scene locks it at {place:g}, but in the log it moves "
                f"from {q.min():.4g} to {q.max():.4g}, which loads its neighbours: take it out of "
                f"`robot: locked` (`identify --without {joint}` needs no effort of it), or leave "
                "its column out of the log if what it moves weighs nothing"
            )
    return found


def _finish(
    samples: Samples,
    recorded: bool,
    efforts: Mapping[str, FloatArray],
    thinning: Thinning | None,
) -> None:
    """Say that a recording is smooth, refuse its gaps, and take efforts at the samples."""
    reading, t = samples.reading, samples.table.t
    if recorded:
        if not reading.noise_line:  # something has filtered it before
            largest = max(reading.noise.values(), default=0.0)
            samples.said(
                f"positions have almost no noise ({largest:.1e}): already smooth, not filtered"
            )
        samples.problems += [gap for gap in gap_problems(t) if gap not in samples.problems]
    taken = {}
    for name, effort in efforts.items():
        whole = np.interp(samples.rows, np.arange(effort.size), effort)
        if thinning and samples.every > 1:
            step = float(t[-1] - t[0]) / ((t.size - 1) * samples.every)
            whole = thinning.effort(whole, step)[:: samples.every].copy()  # a view would keep all
        taken[name] = whole
    samples.said(effort=taken)


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
    """Return the rows' times in s, those of a clock from its first one on.

    Rows without a time were written at one rate; those that were left out have theirs.
    """
    if found.rate is not None:
        notes.append(f"no column is the time: rows taken as written at {found.rate:g} Hz")
        return (np.asarray(cells.lines, dtype=np.float64) - cells.lines[0]) / found.rate
    t = cells.column(found.time)
    start = float(cells.origin.get(found.time, 0)) + float(t[0])
    if found.nanoseconds is not None:
        return (t - t[0]) + 1e-9 * cells.column(found.nanoseconds)
    factor = time_factor(found.time, t, start, found.time_unit, speeds, problems, notes)
    if is_clock(start * factor):
        notes.append(f"column {found.time} is clock time: times count from its first row")
        t = t - t[0]
    return t if factor == 1.0 else t * factor


def _phase(cells: LogFrame, name: str, problems: list[str]) -> BoolArray:
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
