"""From logged positions to a motion: unwrapped, on regular time, low-passed, with its holds kept.

A planned motion passes through unchanged: its positions have no noise but rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinfric.model.brief import counted
from pinfric.motions.derivatives import SPLINE_GAINS, find_holds, position_derivatives
from pinfric.motions.joint_columns import JointColumn
from pinfric.motions.log.frame import FEWEST
from pinfric.motions.log.noise import (
    Spectra,
    acceleration_jumps,
    low_pass,
    motion_taken_away,
    noise_floor,
    noise_gain,
    noise_level,
    noisy_joints,
    roughness,
    signal_cutoff,
    typical_noise,
)
from pinfric.motions.log.reading import DerivativeNoise, Reading, ReadingOptions, Thinning
from pinfric.motions.log.rows import (
    ROUNDED,
    Timing,
    evenly,
    far_apart,
    gap_problems,
    held_rate,
    regular_time,
    repeated_rows,
)
from pinfric.motions.log.still import find_noisy_holds, with_resting_ends
from pinfric.motions.table import TrajectoryTable

FloatArray = NDArray[np.float64]

#: rad; an angle that steps by more than half of it was wrapped.
_TURN = 2.0 * np.pi
#: rad; a limited joint goes no farther than this in the step in which its angle is wrapped.
_STEP = 0.25 * np.pi
#: s; nobody writes rows by hand at such steps.
_PACE = 0.05
#: Share of the noise that a reading of the stamps must leave, to be the right one.
_CLEARLY = 0.98
#: Stamps are wrong where positions have less than this share of their roughness by rows.
_CONTRADICTED = 0.5
#: Share of a step: rows that follow sooner are not interpolated between.
_NEAREST = 0.5
#: Cutoff of a second low pass over that of the first: their difference shows what a low pass takes
#: away. At a jump of acceleration a Gaussian one shows half as much.
_LOWER, _GAUSSIAN_LOWER = 1.0 / np.sqrt(2.0), 0.5
#: Periods of the cutoff from an end of a log within which errors are up to 50 times those inside.
_ONE_SIDED = 0.35


@dataclass(frozen=True)
class Settled:
    """A motion as it is computed with, and where its samples stand in the rows that were read.

    Args:
        table: the motion.
        rows: (T,) number of the row, with a fraction where a sample lies between two.
        reading: what was found and done.
        every: of how many samples the motion has one; `rows` are those of all.
    """

    table: TrajectoryTable
    rows: FloatArray
    reading: Reading
    every: int = 1


def unwrapped(columns: Sequence[JointColumn], position: FloatArray, notes: list[str]) -> FloatArray:
    """Return angles without jumps of a whole turn, a limited joint's within its limits.

    Args:
        columns: (nj,) the joints.
        position: (T, nj) rad or m.
        notes: joints with limits that were unwrapped are named here.
    """
    result = position
    for i, column in enumerate(columns):
        q = position[:, i]
        jumps = np.diff(q)
        if column.unit != "rad" or not (np.abs(jumps) > 0.5 * _TURN).any():
            continue
        if not np.isfinite(q).all() or np.abs(jumps).max() > 1.5 * _TURN:
            continue  # no wrapped angle; the limits judge it
        straight = np.unwrap(q)
        if np.isfinite(column.lower) and np.isfinite(column.upper):
            if (np.abs(np.diff(straight)) > _STEP)[np.abs(jumps) > 0.5 * _TURN].any():
                continue  # a leap, but not by a turn
            middle = 0.5 * (float(straight.min()) + float(straight.max()))
            straight -= _TURN * np.rint((middle - 0.5 * (column.lower + column.upper)) / _TURN)
        result = result.copy() if result is position else result
        result[:, i] = straight
        wraps = counted(int((np.abs(jumps) > 0.5 * _TURN).sum()), "jump")
        notes.append(f"joint {column.name}: {wraps} of a whole turn removed")
    return result


@dataclass(frozen=True)
class _Sampled:
    """Rows and when they were taken, and the same motion on regular times.

    Args:
        even: on regular times.
        step: s between them.
        position: (rows, nj) as read, rad or m.
        t: (rows,) when they were taken, s; None: at the regular times.
        spread: by how much more noise the regular samples carry at low frequencies than the rows.
    """

    even: Settled
    step: float
    position: FloatArray
    t: FloatArray | None = None
    spread: float = 1.0


def settle(
    columns: Sequence[JointColumn],
    plan: TrajectoryTable,
    options: ReadingOptions,
    problems: list[str],
    recorded: bool = False,
    logged: FloatArray | None = None,
) -> Settled:
    """Return the motion behind a file's rows; a planned one unchanged.

    Args:
        columns: (nj,) the joints.
        plan: what the rows say; time increases but for jitter, positions are finite, unwrapped.
        options: the cutoff.
        problems: gaps in what must be filtered are appended here.
        recorded: the file holds measurements; they are put on regular times, with or without noise,
            because filters expect that.
        logged: (rows, nj) measured velocities, rad/s or m/s, NaN where there are none: they tell
            when rows were taken.
    """
    fresh, rows, notes = _fresh_rows(plan)
    names = [column.name for column in columns]
    reading = Reading(
        rows.size,
        plan.t.size - rows.size,
        noise=dict.fromkeys(names, 0.0),
        cutoff=dict.fromkeys(names),
        notes=notes,
    )
    plain = Settled(fresh, rows.astype(np.float64), reading)
    given = np.isfinite(plan.acceleration).all() and np.isfinite(plan.velocity).all()
    timing = regular_time(plain.table.t)
    if timing is None or given:
        if not given and _is_short_log(plain.table.t):
            words = (
                f"{counted(rows.size, 'row')}: too few to separate noise from motion, not filtered"
            )
            plain = replace(plain, reading=replace(reading, notes=(*notes, words)))
        if (np.diff(plain.table.t) <= 0.0).any():
            problems.append("time must increase, and is not regular enough to be repaired")
        return plain
    sampled = _on_regular_time(plain, timing, None if logged is None else logged[rows])
    noisy = noisy_joints(sampled.position, timing.step, plain.table.resolution, sampled.t)
    if not any(noisy) and not isinstance(options.cutoff, float):
        even = sampled.even
        mended = timing.irregular and (recorded or np.array_equal(even.rows, plain.rows))
        levels = {
            column.name: typical_noise(q, sampled.t)
            for column, q in zip(columns, sampled.position.T, strict=True)
        }
        chosen = even if mended else plain
        return replace(chosen, reading=replace(chosen.reading, noise=levels))
    problems += gap_problems(plain.table.t)
    problems += _contradictions(sampled)
    if isinstance(options.cutoff, float):
        problems += _cutoff_problems(options.cutoff, timing)
    return plain if problems else _filtered(columns, sampled, noisy, options)


def _fresh_rows(
    plan: TrajectoryTable,
) -> tuple[TrajectoryTable, NDArray[np.int64], tuple[str, ...]]:
    """Return the rows that do not repeat a row before them, which ones they are, and what to say.

    Times are those of the source, where rows that follow at its rate have clearly less noise than
    rows at the recorder's stamps.
    """
    rows = np.arange(plan.t.size)
    if np.isfinite(plan.acceleration).any():
        return plan, rows, ()
    if (held := held_rate(plan.position)) is not None:
        kept = rows[held]
        return (
            _rows_of(plan, kept),
            kept,
            (
                f"positions change in every {held.step}th row only: the {rows.size - kept.size} "
                "rows between are left out",
            ),
        )
    again = repeated_rows(plan.position)
    if again.size == 0:
        return plan, rows, ()
    kept = np.setdiff1d(rows, again)
    fresh = _rows_of(plan, kept)
    words = f"left out {counted(again.size, 'row')} that repeat the row before"
    even = evenly(fresh.t)
    if even is None or not _less_noise(fresh.position, even, fresh.t):
        return fresh, kept, (words,)
    words += f": the source has {1.0 / (even[1] - even[0]):.4g} Hz, less than the log"
    return replace(fresh, t=even), kept, (words,)


def _less_noise(position: FloatArray, t: FloatArray, than: FloatArray) -> bool:
    """Whether positions have clearly less noise at some times than at others."""
    own, other = (sum(noise_level(q, at) for q in position.T) for at in (t, than))
    return own < _CLEARLY * other


def _is_short_log(t: FloatArray) -> bool:
    """Whether so few rows come at the pace of a recording; slower ones somebody wrote."""
    return 2 < t.size < FEWEST and float(np.median(np.diff(t))) < _PACE


def _rows_of(table: TrajectoryTable, rows: NDArray[np.int64]) -> TrajectoryTable:
    if rows.size == table.t.size:
        return table
    attached = {name: phase[rows] for name, phase in table.attached.items()}
    return TrajectoryTable(
        table.t[rows],
        table.position[rows],
        table.velocity[rows],
        table.acceleration[rows],
        attached,
        table.resolution,
    )


def _on_regular_time(plain: Settled, timing: Timing, logged: FloatArray | None = None) -> _Sampled:
    """Return the samples on regular time.

    Either the stamps jitter and the rows were taken regularly, or the stamps are right. Taken is
    what fits the logged velocities better; without any, what leaves less noise in the positions.
    Stamps that wander are taken as right.
    """
    table, stamps = plain.table, plain.table.t
    if not timing.irregular:
        return _Sampled(plain, timing.step, table.position)
    reading = replace(plain.reading, jitter=timing.jitter)
    regular = timing.taken
    if regular is None or _stamps_are_better(table.position, stamps, regular, logged):
        return _by_stamps(plain, timing, reading)
    assert timing.number is not None
    whole = np.arange(timing.count, dtype=np.float64)
    number = timing.number.astype(np.float64)
    lost = np.setdiff1d(whole, number)
    words = [
        f"time stamps jitter by {_time(timing.jitter)} RMS: rows treated as regular, "
        f"{1.0 / timing.step:.6g} Hz"
    ]
    if lost.size:
        words = [
            f"{counted(lost.size, 'lost row')} interpolated, the first at "
            f"{timing.time[int(lost[0])]:.6g} s"
        ]
    elif timing.jitter <= ROUNDED * timing.step:
        words = []
    position = _between(number, table.position, whole) if lost.size else table.position
    order = np.interp(whole, number, np.arange(number.size))
    reading = replace(reading, resampled=lost.size, notes=(*reading.notes, *words))
    even = _resampled(plain, timing, order, position, reading)
    return _Sampled(even, timing.step, table.position, regular if lost.size else None)


def _stamps_are_better(
    position: FloatArray, stamps: FloatArray, regular: FloatArray, logged: FloatArray | None
) -> bool:
    """Whether the stamps fit clearly better than regular times: velocities, else positions."""
    if (np.diff(stamps) <= 0.0).any():
        return False
    if logged is not None and logged.any() and np.isfinite(logged).all():
        by_stamps, by_rows = (_off(position, at, logged) for at in (stamps, regular))
        return by_stamps < _CLEARLY * by_rows
    return _less_noise(position, stamps, regular)


def _off(position: FloatArray, t: FloatArray, velocity: FloatArray) -> float:
    """RMS by which velocities miss the slopes of the positions between rows, rad/s or m/s."""
    steps, total = np.diff(t), 0.0
    for q, v in zip(position.T, velocity.T, strict=True):  # one by one: long logs fill the memory
        total += float(np.mean((np.diff(q) / steps - 0.5 * (v[1:] + v[:-1])) ** 2))
    return float(np.sqrt(total))


def _by_stamps(plain: Settled, timing: Timing, reading: Reading) -> _Sampled:
    """Interpolate on the stamps, and say how irregular they are."""
    table, stamps = plain.table, plain.table.t
    at, steps = np.clip(timing.time, stamps[0], stamps[-1]), np.diff(stamps)
    words = [
        f"samples taken at jittering times ({_time(timing.jitter)} RMS): interpolated "
        f"at {1.0 / timing.step:.6g} Hz"
    ]
    if timing.number is None:
        words = [
            f"time stamps deviate by {_time(timing.jitter)} RMS from regular time (steps of "
            f"{_time(steps.min())} to {_time(steps.max())}): interpolated from them at "
            f"{1.0 / timing.step:.6g} Hz"
        ]
    kept = far_apart(stamps, _NEAREST * timing.step)
    close = stamps.size - kept.size
    if close:
        words.append(
            f"left out {counted(close, 'row')} less than "
            f"{_time(_NEAREST * timing.step)} after the row before"
        )
    position = _between(stamps[kept], table.position[kept], at)
    order = np.interp(at, stamps, np.arange(stamps.size))
    reading = replace(
        reading,
        dropped=reading.dropped + close,
        resampled=timing.count,
        notes=(*reading.notes, *words),
    )
    even = _resampled(plain, timing, order, position, reading)
    cells = np.diff(stamps[kept])
    spread = float(np.sqrt(np.mean(cells**2) / (np.mean(cells) * timing.step)))
    return _Sampled(even, timing.step, table.position[kept], stamps[kept], max(spread, 1.0))


def _resampled(
    plain: Settled, timing: Timing, order: FloatArray, position: FloatArray, reading: Reading
) -> Settled:
    """Positions at regular times, which lie at `order` in the rows; the rest from the row before.

    Samples between rows have no rounding of their own.
    """
    nearest = np.floor(order + 1e-9).astype(np.int64)
    table = replace(_rows_of(plain.table, nearest), t=timing.time, position=position)
    rows = np.interp(order, np.arange(plain.rows.size), plain.rows)
    return Settled(table, rows, replace(reading, samples=timing.count))


def _contradictions(sampled: _Sampled) -> list[str]:
    """Refuse stamps that say when rows were written, not when they were measured."""
    if sampled.t is None:
        return []
    by_stamps, by_rows = (
        sum(roughness(q, t) for q in sampled.position.T) for t in (sampled.t, None)
    )
    if by_rows > _CONTRADICTED * by_stamps:
        return []
    return [
        f"positions over the time stamps are rougher ({by_stamps:.2g} rad or m) than over the rows "
        f"({by_rows:.2g}): the stamps are write times, not measuring times; give the "
        "robot's own times"
    ]


def _cutoff_problems(cutoff: float, timing: Timing) -> list[str]:
    """Refuse a cutoff of less than two periods over the whole log, or of half its rate and more."""
    least, most = 2.0 / float(timing.time[-1] - timing.time[0]), 0.5 / timing.step
    if least <= cutoff < most:
        return []
    return [f"--cutoff {cutoff:g}: this log can be filtered from {least:.3g} to {most:.6g} Hz"]


def _between(x: FloatArray, position: FloatArray, at: FloatArray) -> FloatArray:
    from scipy.interpolate import make_interp_spline

    return np.asarray(make_interp_spline(x, position, k=3)(at))


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.2g} ms"


def _filtered(
    columns: Sequence[JointColumn],
    sampled: _Sampled,
    noisy: Sequence[bool],
    options: ReadingOptions,
) -> Settled:
    """Low-pass what is noisy (all that moves, where the cutoff was given) between its holds."""
    even, step, thinning = sampled.even, sampled.step, options.thinning
    measured, t = even.table.position, even.table.t
    every = thinning.every(step) if thinning else 1
    kept = np.arange(0, t.size, every)
    noise, floor = (
        [
            sampled.spread * level(q, sampled.t) if is_so else 0.0
            for q, is_so in zip(sampled.position.T, noisy, strict=True)
        ]
        for level in (noise_level, noise_floor)
    )
    found = with_resting_ends(measured, step, noise, find_noisy_holds(measured, step, noise))
    kinds: dict[str, type] = dict.fromkeys(("position", "velocity", "acceleration"), float)
    # how far the low pass may be wrong is not known to more than single precision's digits
    kinds |= {"shift": np.float32, "moving": bool}
    parts: dict[str, NDArray[Any]] = {
        name: np.empty((kept.size, len(columns)), kind) for name, kind in kinds.items()
    }
    passes, spreads = [], []
    for i, q in enumerate(measured.T):
        holds = found[i] if noisy[i] else find_holds(q, float(even.table.resolution[i]))
        passes.append(_chosen_pass(q, step, floor[i], holds, noisy[i], options.cutoff))
        joint = _low_passed(sampled, i, holds, passes[i], noise[i], thinning)
        for name, column in parts.items():
            column[:, i] = getattr(joint, name)
        spreads.append(joint.spread)
    names = [column.name for column in columns]
    spread = np.array(spreads)
    reading = replace(
        even.reading,
        noise=dict(zip(names, noise, strict=True)),
        cutoff={name: own.cutoff for name, own in zip(names, passes, strict=True)},
        uncertain=DerivativeNoise(
            parts["moving"],
            spread[:, 0],
            spread[:, 1],
            parts["shift"],
            np.array([own.lost for own in passes]),
        ),
    )
    line = _noise_line(reading, " or ".join(dict.fromkeys(column.unit for column in columns)))
    reading = replace(reading, notes=(*reading.notes, line), noise_line=line)
    table = replace(
        _rows_of(even.table, kept),
        position=parts["position"],
        velocity=parts["velocity"],
        acceleration=parts["acceleration"],
    )
    ends = [0.0 if own.cutoff is None else _ONE_SIDED / own.cutoff for own in passes]
    settled = Settled(table, even.rows, reading, every)
    return _without_ends(settled, parts["moving"], np.array(ends), every * step)


@dataclass(frozen=True)
class _Pass:
    """A joint's low pass: cutoff, Hz, or None; which one; RMS acceleration that it takes away."""

    cutoff: float | None = None
    gaussian: bool = False
    lost: float = 0.0


def _chosen_pass(
    q: FloatArray,
    step: float,
    noise: float,
    holds: Sequence[tuple[int, int]],
    is_noisy: bool,
    given: float | str | None,
) -> _Pass:
    """Return the low pass that a joint needs, or of the cutoff that was given if it moves."""
    moves = sum(last - first + 1 for first, last in holds) < q.size
    if not moves or given == "none" or (given is None and not is_noisy):
        return _Pass()
    seen, gaussian = Spectra.of(q, step, noise), False
    cutoff = given if isinstance(given, float) else signal_cutoff(seen)
    if given is None and cutoff is not None and acceleration_jumps(seen, cutoff):
        cutoff, gaussian = signal_cutoff(seen, gaussian=True), True
    lost = 0.0 if cutoff is None else motion_taken_away(seen, cutoff, gaussian)
    return _Pass(cutoff, gaussian, lost)


def _without_ends(
    settled: Settled, moving: NDArray[np.bool_], ends: FloatArray, step: float
) -> Settled:
    """Leave out the ends of a log in which a joint moves: there a low pass has one side only.

    Args:
        settled: the filtered motion.
        moving: (T, nj) where a joint is not held.
        ends: (nj,) how long its low pass is unreliable at an end, s.
        step: s between samples.
    """
    count = len(moving)
    first, last = (
        min(int(np.max(ends * moving[at], initial=0.0) / step + 0.5), count // 4) for at in (0, -1)
    )
    if first == last == 0:
        return settled
    inside = slice(first, count - last)
    table, reading = settled.table, settled.reading
    assert reading.uncertain is not None
    uncertain = replace(
        reading.uncertain,
        moving=reading.uncertain.moving[inside],
        acceleration_shift=reading.uncertain.acceleration_shift[inside],
    )
    words = (
        f"left out {_time(first * step)} at the start and {_time(last * step)} at the end, "
        "where joints move and the low pass has samples on one side only"
    )
    reading = replace(
        reading,
        samples=reading.samples - (first + last) * settled.every,
        dropped=reading.dropped + (first + last) * settled.every,
        notes=(*reading.notes, words),
        uncertain=uncertain,
    )
    rows = settled.rows[first * settled.every : (count - last) * settled.every]
    return replace(
        settled, table=_rows_of(table, np.arange(count)[inside]), rows=rows, reading=reading
    )


@dataclass(frozen=True)
class _Smoothed:
    """One joint between its holds: (T,) each; `spread` are sigma of velocity and acceleration."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    shift: FloatArray
    moving: NDArray[np.bool_]
    spread: list[float]


def _low_passed(
    sampled: _Sampled,
    joint: int,
    holds: Sequence[tuple[int, int]],
    chosen: _Pass,
    noise: float,
    thinning: Thinning | None,
) -> _Smoothed:
    """Return one joint's motion, thinned; its whole columns fill much of the memory."""
    t, step, cutoff, gaussian = sampled.even.table.t, sampled.step, chosen.cutoff, chosen.gaussian
    every = thinning.every(step) if thinning else 1
    q = sampled.even.table.position[:, joint].copy()
    moving, shift = np.ones(q.size, dtype=bool), np.zeros(1)
    for first, last in holds:
        q[first : last + 1] = q[first : last + 1].mean()
        moving[first : last + 1] = False
    if cutoff is None:
        v, a = position_derivatives(t, q, holds)
        spread = [noise * gain / step ** (k + 1) for k, gain in enumerate(SPLINE_GAINS)]
    else:
        lower = low_pass(q, step, (_GAUSSIAN_LOWER if gaussian else _LOWER) * cutoff, gaussian)
        shift = position_derivatives(t, lower, ())[1][::every].copy()
        del lower
        smooth = low_pass(q, step, cutoff, gaussian)
        v, a = position_derivatives(t, smooth, ())
        shift = (shift - a[::every]) * moving[::every]
        np.copyto(q, smooth, where=moving)
        del smooth
        v[~moving] = a[~moving] = 0.0
        spread = [noise * noise_gain(step, cutoff, order, gaussian) for order in (1, 2)]
    q, v = q[::every].copy(), v[::every].copy()
    if thinning and every > 1:
        a = thinning.acceleration(a, step)
    return _Smoothed(q, v, a[::every], shift, moving[::every], spread)


def _noise_line(reading: Reading, unit: str) -> str:
    """Say "filtered at 11 Hz, noise 1.0e-05 rad", with ranges over the joints."""
    cutoffs = sorted(x for x in reading.cutoff.values() if x is not None)
    noise = sorted(x for x in reading.noise.values() if x > 0.0)
    still = reading.uncertain is not None and not reading.uncertain.moving.any()
    done = "every joint is at rest" if still else "not filtered"
    done = f"filtered at {_span(cutoffs, '.3g')} Hz" if cutoffs else done
    parts = [done, *([f"noise {_span(noise, '.1e')} {unit}"] if noise else [])]
    if reading.uncertain is not None and not cutoffs and not still:
        parts.append(
            f"error left in accelerations {reading.uncertain.acceleration.max():.2g} {unit}/s^2"
        )
    return ", ".join(parts)


def _span(values: Sequence[float], form: str) -> str:
    low, high = (f"{x:{form}}" for x in (values[0], values[-1]))
    return low if low == high else f"{low} to {high}"
