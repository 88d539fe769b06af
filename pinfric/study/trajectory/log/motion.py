"""From logged positions to a motion: unwrapped, on regular time, low-passed, with its holds kept.

A planned motion passes through unchanged: its positions have no noise but rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pinfric.model.brief import counted
from pinfric.study.trajectory.derivatives import SPLINE_GAINS, find_holds, position_derivatives
from pinfric.study.trajectory.joint_columns import JointColumn
from pinfric.study.trajectory.log.files import FEWEST
from pinfric.study.trajectory.log.noise import (
    acceleration_jumps,
    low_pass,
    noise_gain,
    noise_level,
    noisy_joints,
    signal_cutoff,
    typical_noise,
)
from pinfric.study.trajectory.log.reading import DerivativeNoise, Reading, ReadingOptions
from pinfric.study.trajectory.log.rows import (
    ROUNDED,
    Timing,
    gap_problems,
    held_rate,
    regular_time,
)
from pinfric.study.trajectory.log.still import find_noisy_holds
from pinfric.study.trajectory.table import TrajectoryTable

FloatArray = NDArray[np.float64]

#: rad; an angle that steps by more than half of it was wrapped.
_TURN = 2.0 * np.pi
#: rad; a limited joint goes no farther than this in the step in which its angle is wrapped.
_STEP = 0.25 * np.pi
#: s; nobody writes rows by hand at such steps.
_PACE = 0.05
#: Share of the noise that a reading of the stamps must leave, to be the right one.
_CLEARLY = 0.98
#: The low pass of comparison, whose difference shows what a low pass takes away.
_LOWER = 1.0 / np.sqrt(2.0)


@dataclass(frozen=True)
class Settled:
    """A motion as it is computed with, and where its samples stand in the rows that were read.

    Args:
        table: the motion.
        rows: (T,) number of the row, with a fraction where a sample lies between two.
        reading: what was found and done.
    """

    table: TrajectoryTable
    rows: FloatArray
    reading: Reading


def unwrapped(columns: Sequence[JointColumn], position: FloatArray, said: list[str]) -> FloatArray:
    """Return angles without jumps of a whole turn, a limited joint's within its limits.

    Args:
        columns: (nj,) the joints.
        position: (T, nj) rad or m.
        said: joints with limits that were unwrapped are named here.
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
        said.append(f"joint {column.name}: {wraps} of a whole turn taken out")
    return result


def settle(
    columns: Sequence[JointColumn],
    plan: TrajectoryTable,
    options: ReadingOptions,
    problems: list[str],
) -> Settled:
    """Return the motion behind a file's rows; a planned one unchanged.

    Args:
        columns: (nj,) the joints.
        plan: what the rows say; time increases but for jitter, positions are finite, unwrapped.
        options: the cutoff.
        problems: gaps in what must be filtered are appended here.
    """
    held = None if np.isfinite(plan.acceleration).any() else held_rate(plan.position)
    rows = np.arange(plan.t.size)[held or slice(None)]
    said = () if held is None else (
        f"positions change in every {held.step}th row only: the {plan.t.size - rows.size} rows "
        "between are left out",)  # fmt: skip
    names = [column.name for column in columns]
    reading = Reading(rows.size, plan.t.size - rows.size, noise=dict.fromkeys(names, 0.0),
                      cutoff=dict.fromkeys(names), said=said)  # fmt: skip
    plain = Settled(_rows_of(plan, rows), rows.astype(np.float64), reading)
    given = np.isfinite(plan.acceleration).all() and np.isfinite(plan.velocity).all()
    timing = regular_time(plain.table.t)
    if timing is None or given:
        if not given and _is_short_log(plain.table.t):
            words = f"{counted(rows.size, 'row')}: too few to tell noise from motion, not filtered"
            plain = replace(plain, reading=replace(reading, said=(*said, words)))
        if (np.diff(plain.table.t) <= 0.0).any():
            problems.append("time must increase, and is not regular enough to be mended")
        return plain
    even = _on_regular_time(plain, timing)
    noisy = noisy_joints(even.table.position, timing.step, even.table.resolution)
    if not any(noisy) and not isinstance(options.cutoff, float):
        mended = timing.irregular and np.array_equal(even.rows, plain.rows)
        levels = {column.name: typical_noise(q)
                  for column, q in zip(columns, even.table.position.T, strict=True)}  # fmt: skip
        chosen = even if mended else plain
        return replace(chosen, reading=replace(chosen.reading, noise=levels))
    problems += gap_problems(plain.table.t)
    if isinstance(options.cutoff, float):
        problems += _cutoff_problems(options.cutoff, timing)
    return plain if problems else _filtered(columns, even, noisy, timing.step, options)


def _is_short_log(t: FloatArray) -> bool:
    """Whether so few rows come at the pace of a recording; slower ones somebody wrote."""
    return 2 < t.size < FEWEST and float(np.median(np.diff(t))) < _PACE


def _rows_of(table: TrajectoryTable, rows: NDArray[np.int64]) -> TrajectoryTable:
    if rows.size == table.t.size:
        return table
    attached = {name: phase[rows] for name, phase in table.attached.items()}
    return TrajectoryTable(table.t[rows], table.position[rows], table.velocity[rows],
                           table.acceleration[rows], attached, table.resolution)  # fmt: skip


def _on_regular_time(plain: Settled, timing: Timing) -> Settled:
    """Return the samples on regular time: what the stamps or the rows' numbers say, if they differ.

    Either the stamps jitter and the samples were taken regularly, or the stamps tell the truth: the
    reading that leaves the positions less noise is right.
    """
    if not timing.irregular:
        return plain
    table, reading = plain.table, replace(plain.reading, jitter=timing.jitter)
    whole = np.arange(timing.time.size, dtype=np.float64)
    number = timing.number.astype(np.float64)
    lost = np.setdiff1d(whole, number)
    position = _between(number, table.position, whole) if lost.size else table.position
    words = [f"stamps jitter by {_time(timing.jitter)} RMS: rows taken as regular, "
             f"{1.0 / timing.step:.6g} Hz"]  # fmt: skip
    if lost.size:
        words = [f"{counted(lost.size, 'lost row')} interpolated, the first at "
                 f"{timing.time[int(lost[0])]:.6g} s"]  # fmt: skip
    elif timing.jitter <= ROUNDED * timing.step:
        words = []
    interpolated, order = lost.size, np.interp(whole, number, np.arange(number.size))
    if (np.diff(table.t) > 0.0).all():
        at = np.clip(timing.time, table.t[0], table.t[-1])
        stamped = _between(table.t, table.position, at)
        if _noise_sum(stamped) < _CLEARLY * _noise_sum(position):
            position, interpolated = stamped, whole.size
            order = np.interp(at, table.t, np.arange(number.size))
            words = [f"samples taken at jittering times ({_time(timing.jitter)} RMS): interpolated "
                     f"at {1.0 / timing.step:.6g} Hz"]  # fmt: skip
    nearest = np.floor(order + 1e-9).astype(np.int64)
    regular = replace(_rows_of(table, nearest), t=timing.time, position=position)
    reading = replace(reading, samples=whole.size, resampled=interpolated,
                      said=(*reading.said, *words))  # fmt: skip
    rows = np.interp(order, np.arange(number.size), plain.rows)
    return Settled(regular, rows, reading)


def _cutoff_problems(cutoff: float, timing: Timing) -> list[str]:
    """Refuse a cutoff of less than two periods over the whole log, or of half its rate and more."""
    least, most = 2.0 / float(timing.time[-1] - timing.time[0]), 0.5 / timing.step
    if least <= cutoff < most:
        return []
    return [f"--cutoff {cutoff:g}: this log can be filtered from {least:.3g} to {most:.6g} Hz"]


def _between(x: FloatArray, position: FloatArray, at: FloatArray) -> FloatArray:
    from scipy.interpolate import make_interp_spline

    return np.asarray(make_interp_spline(x, position, k=3)(at))


def _noise_sum(position: FloatArray) -> float:
    return sum(noise_level(q) for q in position.T)


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.2g} ms"


def _filtered(
    columns: Sequence[JointColumn],
    even: Settled,
    noisy: Sequence[bool],
    step: float,
    options: ReadingOptions,
) -> Settled:
    """Low-pass what is noisy (all that moves, where the cutoff was given) between its holds."""
    measured, t = even.table.position, even.table.t
    noise = [noise_level(q) if is_so else 0.0 for q, is_so in zip(measured.T, noisy, strict=True)]
    found = find_noisy_holds(measured, step, noise)
    kinds: dict[str, type] = dict.fromkeys(("position", "velocity", "acceleration"), float)
    # how far the low pass may be wrong is not known to more than single precision's digits
    kinds |= {"shift": np.float32, "moving": bool}
    parts = {name: np.empty(measured.shape, kind) for name, kind in kinds.items()}
    joints = []
    for i, q in enumerate(measured.T):
        holds = found[i] if noisy[i] else find_holds(q, float(even.table.resolution[i]))
        moves = sum(last - first + 1 for first, last in holds) < q.size
        cutoff, gentle = None, False
        if moves and isinstance(options.cutoff, float):
            cutoff = options.cutoff
        elif moves and noisy[i] and options.cutoff is None:
            cutoff = signal_cutoff(q, step)
            gentle = cutoff is not None and acceleration_jumps(q, step, cutoff)
        joint = _low_passed(t, q, holds, step, cutoff, noise[i], gentle)
        for name, column in parts.items():
            column[:, i] = getattr(joint, name)
        joints.append((joint.cutoff, joint.spread))
    names = [column.name for column in columns]
    spread = np.array([both for _, both in joints])
    reading = replace(
        even.reading,
        noise=dict(zip(names, noise, strict=True)),
        cutoff={name: cutoff for name, (cutoff, _) in zip(names, joints, strict=True)},
        uncertain=DerivativeNoise(parts["moving"], spread[:, 0], spread[:, 1], parts["shift"]),
    )
    line = _noise_line(reading, " or ".join(dict.fromkeys(column.unit for column in columns)))
    reading = replace(reading, said=(*reading.said, line), noise_line=line)
    table = replace(even.table, position=parts["position"], velocity=parts["velocity"],
                    acceleration=parts["acceleration"])  # fmt: skip
    return Settled(table, even.rows, reading)


@dataclass(frozen=True)
class _Smoothed:
    """One joint between its holds: (T,) each; `spread` are sigma of velocity and acceleration."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    shift: FloatArray
    moving: NDArray[np.bool_]
    cutoff: float | None
    spread: tuple[float, float]


def _low_passed(
    t: FloatArray,
    measured: FloatArray,
    holds: Sequence[tuple[int, int]],
    step: float,
    cutoff: float | None,
    noise: float,
    gentle: bool,
) -> _Smoothed:
    q, moving = measured.copy(), np.ones(measured.size, dtype=bool)
    for first, last in holds:
        q[first : last + 1] = q[first : last + 1].mean()
        moving[first : last + 1] = False
    if cutoff is None:
        v, a = position_derivatives(t, q, holds)
        spread_v, spread_a = (noise * gain / step ** (k + 1) for k, gain in enumerate(SPLINE_GAINS))
        return _Smoothed(q, v, a, np.zeros_like(q), moving, None, (spread_v, spread_a))
    smooth = low_pass(q, step, cutoff, gentle)
    v, a = position_derivatives(t, smooth, ())
    lower = position_derivatives(t, low_pass(q, step, _LOWER * cutoff, gentle), ())[1]
    spread_v, spread_a = (noise * noise_gain(step, cutoff, order, gentle) for order in (1, 2))
    return _Smoothed(np.where(moving, smooth, q), v * moving, a * moving, (lower - a) * moving,
                     moving, cutoff, (spread_v, spread_a))  # fmt: skip


def _noise_line(reading: Reading, unit: str) -> str:
    """Say "filtered at 11 Hz, noise 1.0e-05 rad", with ranges over the joints."""
    cutoffs = sorted(x for x in reading.cutoff.values() if x is not None)
    noise = sorted(x for x in reading.noise.values() if x > 0.0)
    still = reading.uncertain is not None and not reading.uncertain.moving.any()
    done = "every joint stands still" if still else "not filtered"
    done = f"filtered at {_span(cutoffs, '.3g')} Hz" if cutoffs else done
    parts = [done, *([f"noise {_span(noise, '.1e')} {unit}"] if noise else [])]
    if reading.uncertain is not None and not cutoffs and not still:
        parts.append(f"which leaves {reading.uncertain.acceleration.max():.2g} {unit}/s^2 in "
                     "accelerations")  # fmt: skip
    return ", ".join(parts)


def _span(values: Sequence[float], form: str) -> str:
    low, high = (f"{x:{form}}" for x in (values[0], values[-1]))
    return low if low == high else f"{low} to {high}"
