"""The reader of trajectory files with samples: from a path to a table."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
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
from pinfric.motions.log.base import with_base, wrenches
from pinfric.motions.log.columns import (
    PAYLOAD,
    Columns,
    Use,
    find_columns,
    is_counter,
    meaning_of,
    read_mapping,
)
from pinfric.motions.log.episodes import one_episode
from pinfric.motions.log.formats.bags import is_bag, open_bag
from pinfric.motions.log.formats.registry import opener
from pinfric.motions.log.frame import Log, LogFrame, OpenedLog, Remarks
from pinfric.motions.log.motion import Samples, regularise, smooth, unwrapped
from pinfric.motions.log.reading import ANGLE_UNITS, Reading, ReadingOptions, Thinning
from pinfric.motions.log.rows import check_times, gap_problems, mended_effort, ordered_rows
from pinfric.motions.log.units import (
    angle_unit,
    fast_angles,
    impossible_motions,
    is_clock,
    slow_angles,
    time_factor,
    wrong_velocities,
)
from pinfric.motions.table import TrajectoryTable, mismatch_warnings

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
    said: Remarks,
    locked: Mapping[str, tuple[float, str]] = MappingProxyType({}),
    frames: Collection[str] = (),
) -> Logged:
    """Read a file of one of the `formats`, a bag's folder, or arrays.

    Args:
        joints, payloads: those that may have columns (`payload.<name>`).
        choose: names of the joints that have positions, problems -> the joints that must have.
        options: what the person said. said: everything wrong in the file is added here.
        locked: joint -> where the scene fixes it, and in what, "rad" or "m".
        frames: of the robot, on which forces may have columns.

    Raises:
        TrajectoryError: the file cannot be opened, or holds nothing to compute with.
    """
    if isinstance(source, Log):
        name, log, mapping = source.name, source.opened([joint.name for joint in joints]), None
    else:
        name, log = str(source), _open(source, joints)
        mapping = read_mapping(source, options.columns)
    log = one_episode(log, mapping.episode if mapping else None, said)
    refuse(name, said.problems)
    said.notes += log.notes
    log = with_base(log, joints, mapping.base if mapping else None, said)
    refuse(name, said.problems)
    found = joints, payloads, mapping, said, options.currents, frames
    columns = find_columns(log.header, log.first, *found)
    columns.effort = {x: use for x, use in columns.effort.items() if x not in options.without}
    columns.time_unit = options.time_unit or columns.time_unit or log.units.get(columns.time)
    options = replace(options, unit=options.unit or (mapping.unit if mapping else None))
    if columns.unclear and not options.unit:
        said.problems.append(columns.unclear)
    named = choose(list(columns.position), said.problems)
    missing = [column.name for column in named if column.name not in columns.position]
    others = listing(map(brief, columns.ignored))
    if missing and columns.position:
        near = f" (columns not used: {others})" if others else ""
        said.problems.append(
            f"joints without a column: {', '.join(missing)}{near}; name theirs by "
            "--columns FILE, or lock them in the scene (robot: locked)"
        )
    said.notes += [f"columns not used: {others}"] if others else []
    named = tuple(column for column in named if column.name in columns.position)
    if not (columns.time or columns.rate) or not named:
        refuse(name, said.problems)
    samples, factors = _to_si(name, log, columns, named, options, said)
    turns = [factor for column, factor in zip(named, factors, strict=True) if column.unit == "rad"]
    said.problems += _moving_though_locked(log, columns.ignored, locked, (turns or [1.0])[0])
    if not said.problems:
        if columns.wrench:
            axes = {} if mapping is None else mapping.external
            world = frozenset(frame for frame, entry in axes.items() if entry.axes == "world")
            samples.said(world=world)
        samples = smooth(samples, regularise(samples), options)
        if samples.reading.filtered and columns.planned and columns.velocity and not log.recorded:
            samples.said(
                "velocities in the file are not used: they are derived from filtered positions"
            )
        _finish(samples, log.recorded, options.thinning)
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
    return opener(path)(path)


def _absurd(cells: LogFrame, columns: Columns) -> list[str]:
    """Return numbers, but times, beyond those of any motion."""
    quantities = ("position", columns.position), ("velocity", columns.velocity)
    worst = {
        f"{what} of {joint}": np.nanmax(np.abs(column), initial=0.0, where=np.isfinite(column))
        for what, uses in (*quantities, ("acceleration", columns.acceleration))
        for joint, use in uses.items()
        for column in [cells.column(use.column)]
    }
    return [
        f"{what}: {value:g} is beyond {LARGEST_OF_A_MOTION:g}"
        for what, value in worst.items()
        if value > LARGEST_OF_A_MOTION
    ]


def _to_si(
    name: str,
    log: OpenedLog,
    columns: Columns,
    named: tuple[JointColumn, ...],
    options: ReadingOptions,
    said: Remarks,
) -> tuple[Samples, list[float]]:
    """Return the rows in SI and in order of time, with efforts, and rad per unit."""
    # 1. numbers
    efforts_of = {use.column for use in columns.effort.values()}
    cells = log.read(columns.used(), said.problems, efforts_of)
    said.problems += (absurd := _absurd(cells, columns))
    if absurd or not len(cells.values):
        refuse(name, said.problems or ["there are no samples"])
    if cells.dropped:
        total = len(cells.values) + cells.dropped
        said.notes.append(f"left out {counted(cells.dropped, 'row')} of {total}: {cells.why}")
    if cells.absent:
        said.notes.append(f"{counted(cells.absent, 'row')} without positions skipped")
    for joint, effort_use in columns.effort.items():
        if lost := int(np.isnan(cells.column(effort_use.column)).sum()):
            said.notes.append(f"joint {joint}: no effort in {counted(lost, 'row')}")
    # 2. units; a person knows better than a header
    uses = [columns.position[column.name] for column in named]
    known = [None if columns.by_header and options.unit else use.unit for use in uses]
    raw = (cells.column(use.column) for use in uses)
    factors = angle_unit(named, raw, known, options.unit, said)
    position = _quantity(cells, columns.position, named, factors)
    t = _seconds(cells, columns, named, position, said)
    # 3. order
    check_times(t, cells.lines, said.problems)
    kept = ordered_rows(t, cells.lines, said)
    taken = slice(None) if kept.size == t.size else kept
    lines = [cells.lines[i] for i in kept] if kept.size < len(cells.lines) else cells.lines
    t, position = t[kept], position[taken]
    # 4. what contradicts the units, turns, motions that cannot be
    planned = columns.planned and bool(columns.velocity)
    if not planned and set(factors) == {1.0}:
        said.ask(fast_angles, named, t, position, known, options.unit)
    if columns.by_header and not options.unit:
        said.ask(slow_angles, named, t, position, factors)
    position = unwrapped(named, position, said.notes)
    if not planned:
        said.ask(impossible_motions, named, t, position, lines)
    # 5. all else in the rows
    velocity, acceleration = (
        _quantity(cells, uses_of, named, _own_units(uses_of, named, factors, options.unit))[taken]
        for uses_of in (columns.velocity, columns.acceleration)
    )
    attached = {name: _phase(cells, name, said.problems)[kept] for name in columns.payloads}
    efforts = {
        column.name: mended_effort(column.name, effort[taken], q, lines, said)
        for column, q in zip(named, position.T, strict=True)
        if (use := columns.effort.get(column.name))
        for effort in [use.factor * cells.column(use.column)]
    }
    resolution = np.array([cells.resolution.get(use.column, 0.0) for use in uses])
    resolution = resolution * np.abs(factors)
    table = TrajectoryTable(t, position, velocity, acceleration, attached, resolution)
    # 6. measured velocities are only compared
    measured = log.recorded or not columns.planned
    if measured or efforts:
        said.ask(wrong_velocities, named, t, position, velocity)
    if measured and not said.problems:
        said.notes += mismatch_warnings(named, table)
        nothing = np.broadcast_to(np.nan, position.shape)
        table = replace(table, velocity=nothing, acceleration=nothing)
    external = wrenches(columns.wrench, cells, taken)
    reading = Reading(
        t.size,
        cells.dropped + len(cells.values) - t.size,
        noise={column.name: 0.0 for column in named},
        cutoff={column.name: None for column in named},
        notes=tuple(said.notes),
        effort=efforts,
        external=external,
    )
    recorded, rows = log.recorded or bool(columns.effort), np.arange(t.size, dtype=np.float64)
    logged = velocity if columns.velocity else None
    return Samples(named, table, rows, reading, said.problems, recorded, logged), factors


def _moving_though_locked(
    log: OpenedLog,
    columns: Sequence[str],
    locked: Mapping[str, tuple[float, str]],
    factor: float,
) -> list[str]:
    problems = []
    for column in columns:
        joint, quantity = meaning_of(column, tuple(locked), {}) or ("", "")
        if quantity != "position":
            continue
        place, unit = locked[joint]
        q = (factor if unit == "rad" else 1.0) * log.read([column], [], ()).values[:, 0]
        q = q[np.isfinite(q)]
        if q.size and np.ptp(q) > _LOCKED_WAY:
            problems.append(
                f"joint {joint}: the scene locks it at {place:g}, but in the log it moves "
                f"from {q.min():.4g} to {q.max():.4g}, which loads its neighbours: take it out of "
                f"`robot: locked` (`identify --without {joint}` needs no effort of it), or leave "
                "its column out of the log if what it moves weighs nothing"
            )
    return problems


def _finish(samples: Samples, recorded: bool, thinning: Thinning | None) -> None:
    """Say that a recording is smooth, refuse gaps, take efforts at the samples."""
    reading, t = samples.reading, samples.table.t
    if recorded:
        if not reading.noise_line:  # something has filtered it before
            largest = max(reading.noise.values(), default=0.0)
            samples.said(
                f"positions have almost no noise ({largest:.1e}): already smooth, not filtered"
            )
        samples.problems += [gap for gap in gap_problems(t) if gap not in samples.problems]
    step = float(t[-1] - t[0]) / max((t.size - 1) * samples.every, 1)

    def at_samples(column: FloatArray) -> FloatArray:
        whole = np.interp(samples.rows, np.arange(column.size), column)
        if thinning and samples.every > 1:
            whole = thinning.effort(whole, step)[:: samples.every].copy()  # a view would keep all
        return whole

    samples.said(
        effort={name: at_samples(effort) for name, effort in reading.effort.items()},
        external={
            name: np.column_stack([at_samples(part) for part in wrench.T])
            for name, wrench in reading.external.items()
        },
    )


def _quantity(
    cells: LogFrame,
    uses: Mapping[str, Use],
    named: Sequence[JointColumn],
    factors: Sequence[float] | None = None,
) -> FloatArray:
    """Return one quantity of the joints in SI, (rows, nj); NaN without a column."""
    if not uses:
        return np.broadcast_to(np.nan, (len(cells.values), len(named)))
    values = np.full((len(cells.values), len(named)), np.nan)
    for i, column in enumerate(named):
        if (use := uses.get(column.name)) is not None:
            factor = use.factor * (1.0 if factors is None else factors[i])
            values[:, i] = factor * cells.column(use.column) + use.offset
    return values


def _own_units(
    uses: Mapping[str, Use],
    named: Sequence[JointColumn],
    of_angles: list[float],
    stated: str | None,
) -> list[float]:
    """Return rad per unit by a column's header, else as the joint's angles."""
    units = [None if stated or c.name not in uses else uses[c.name].unit for c in named]
    return [
        of_angle if unit is None or column.unit != "rad" else ANGLE_UNITS[unit]
        for column, unit, of_angle in zip(named, units, of_angles, strict=True)
    ]


def _seconds(
    cells: LogFrame,
    columns: Columns,
    named: Sequence[JointColumn],
    position: FloatArray,
    said: Remarks,
) -> FloatArray:
    """Return the rows' times in s, those of a clock from its first one on.

    Rows without a time were written at one rate.
    """
    if columns.rate is not None:
        said.notes.append(f"no column is the time: rows taken as written at {columns.rate:g} Hz")
        return (np.asarray(cells.lines, dtype=np.float64) - cells.lines[0]) / columns.rate
    t = cells.column(columns.time)
    start = float(cells.origin.get(columns.time, 0)) + float(t[0])
    if columns.nanoseconds is not None:
        return (t - t[0]) + 1e-9 * cells.column(columns.nanoseconds)
    factor = time_factor(columns.time, t, start, columns.time_unit, named, position, said)
    if is_clock(start * factor) or is_counter(columns.time):
        said.notes.append(f"column {columns.time} is clock time: times count from its first row")
        t = t - t[0]
    return t if factor == 1.0 else t * factor


def _phase(cells: LogFrame, name: str, problems: list[str]) -> BoolArray:
    values = cells.column(PAYLOAD + name)
    wrong = np.flatnonzero(np.isfinite(values) & (values != 0.0) & (values != 1.0))
    if wrong.size:
        where = listing(f"{values[i]:g} at line {cells.lines[i]}" for i in wrong.tolist())
        problems.append(f"column {PAYLOAD}{name}: 1 (carried) or 0, found {where}")
    return values == 1.0
