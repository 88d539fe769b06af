"""From rows in SI to a motion: on regular time (`regularise`), low-passed (`smooth`), holds kept.

A planned motion passes through unchanged: its positions have no noise but rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinfric.model.arrays import BoolArray, FloatArray, IntArray
from pinfric.model.brief import counted
from pinfric.motions.derivatives import SPLINE_GAINS, find_holds, position_derivatives
from pinfric.motions.joint_columns import JointColumn
from pinfric.motions.log.frame import FEWEST
from pinfric.motions.log.noise import (
    Spectra,
    acceleration_jumps,
    low_pass,
    motion_taken_away,
    noise_differences,
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

#: rad; an angle that steps by more than half of it was wrapped.
_TURN = 2.0 * np.pi
#: rad; a limited joint goes no farther than this in the step in which its angle is wrapped.
_STEP = 0.25 * np.pi
#: s; nobody writes rows by hand at such steps.
_PACE = 0.05
#: Standard errors by which a reading of the stamps must leave less, to be the right one; rows whose
#: sums are samples of that.
_CLEARLY, _TOGETHER = 3.0, 50
#: Stamps are wrong where positions have less than this share of their roughness by rows.
_CONTRADICTED = 0.5
#: Share of a step: rows that follow sooner are not interpolated between.
_NEAREST = 0.5
#: Cutoff of a second low pass over that of the first: their difference shows what a low pass takes
#: away. At a jump of acceleration a Gaussian one shows half as much.
_LOWER, _GAUSSIAN_LOWER = 1.0 / np.sqrt(2.0), 0.5
#: Periods of the cutoff from an end of a log within which errors are up to 50 times those inside.
_ONE_SIDED = 0.35


@dataclass
class Samples:
    """A log's samples in SI; `regularise` and `smooth` change them.

    Attributes:
        table: the motion; NaN where velocity or acceleration is to be derived.
        rows: (T,) number of the row, with a fraction where a sample lies between two.
        reading: what was found and done. problems: what cannot be mended.
        recorded: whether the file holds measurements: these are put on regular times for filters.
        logged: (T, nj) measured velocities, rad/s or m/s, or NaN: they show when rows were taken.
        every: of how many samples the table has one; `rows` are those of all.
    """

    columns: Sequence[JointColumn]
    table: TrajectoryTable
    rows: FloatArray
    reading: Reading
    problems: list[str]
    recorded: bool
    logged: FloatArray | None = None
    every: int = 1

    def said(self, *words: str, **found: Any) -> None:
        """Add notes and fields to the reading."""
        self.reading = replace(self.reading, notes=(*self.reading.notes, *words), **found)

    def keep(self, kept: IntArray, t: FloatArray | None = None) -> None:
        """Leave out all other samples, and perhaps change the times of these."""
        table = self.table
        if t is not None or kept.size != table.t.size:
            self.table = replace(
                table,
                t=table.t[kept] if t is None else t,
                position=table.position[kept],
                velocity=table.velocity[kept],
                acceleration=table.acceleration[kept],
                attached={name: phase[kept] for name, phase in table.attached.items()},
            )

    def left_out(self, count: int, words: str) -> None:
        """Say that so many samples were left out."""
        reading = self.reading
        self.said(words, samples=reading.samples - count, dropped=reading.dropped + count)


@dataclass(frozen=True)
class Regular:
    """Samples on regular times, and the rows behind them.

    Args:
        even: the samples on regular times. step: s between them.
        position: (rows, nj) as read. t: (rows,) when taken, s; None: at the regular times.
        spread: factor on the rows' noise at low frequencies in the regular samples.
    """

    even: Samples
    step: float
    position: FloatArray
    t: FloatArray | None = None
    spread: float = 1.0


def unwrapped(columns: Sequence[JointColumn], position: FloatArray, notes: list[str]) -> FloatArray:
    """Return angles without jumps of a whole turn, a limited joint's within its limits.

    Args:
        position: (T, nj) rad or m. notes: joints that were unwrapped are named here.
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


def regularise(samples: Samples) -> Regular | None:
    """Leave out rows that repeat the row before, and return the motion on regular time.

    None for a plan with all its derivatives, and for few rows: these stay as they are. Positions
    must be finite and unwrapped, and time increase but for jitter.
    """
    _leave_out_repeats(samples)
    table = samples.table
    complete = np.isfinite(table.acceleration).all() and np.isfinite(table.velocity).all()
    timing = None if complete else regular_time(table.t)
    if timing is not None:
        return _on_regular_time(samples, timing)
    steps = np.diff(table.t)
    if not complete and 2 < table.t.size < FEWEST and np.median(steps) < _PACE:
        rows = counted(table.t.size, "row")
        samples.said(f"{rows}: too few to separate noise from motion, not filtered")
    if (steps <= 0.0).any():
        samples.problems.append("time must increase, and is not regular enough to be repaired")
    return None


def smooth(samples: Samples, regular: Regular | None, options: ReadingOptions) -> Samples:
    """Return the motion without its noise; one that has none, or was planned, unchanged.

    `samples` and `regular` are those of `regularise`.
    """
    if regular is None:
        return samples
    cutoff, even, t = options.cutoff, regular.even, samples.table.t
    noisy = noisy_joints(regular.position, regular.step, samples.table.resolution, regular.t)
    if not any(noisy) and not isinstance(cutoff, float):
        if even is not samples and (samples.recorded or np.array_equal(even.rows, samples.rows)):
            samples = even
        levels = [typical_noise(q, regular.t) for q in regular.position.T]
        samples.said(noise={c.name: x for c, x in zip(samples.columns, levels, strict=True)})
        return samples
    samples.problems += gap_problems(t)
    if regular.t is not None:  # stamps that say when rows were written, not measured
        by_stamps, by_rows = (
            sum(roughness(q, at) for q in regular.position.T) for at in (regular.t, None)
        )
        if by_rows <= _CONTRADICTED * by_stamps:
            samples.problems.append(
                f"positions over the time stamps are rougher ({by_stamps:.2g} rad or m) than over "
                f"the rows ({by_rows:.2g}): the stamps are write times, not measuring times; give "
                "the robot's own times"
            )
    if isinstance(cutoff, float):
        # two periods over the whole log, and half its rate
        least, most = 2.0 / (regular.step * (even.rows.size - 1)), 0.5 / regular.step
        if not least <= cutoff < most:
            samples.problems.append(
                f"--cutoff {cutoff:g}: this log can be filtered from {least:.3g} to {most:.6g} Hz"
            )
    return samples if samples.problems else _filtered(regular, noisy, options)


def _leave_out_repeats(samples: Samples) -> None:
    """Leave out repeated rows; times become the source's where that clearly reduces the noise."""
    position = samples.table.position
    if np.isfinite(samples.table.acceleration).any():
        return
    rows, t = np.arange(len(position)), None
    if (held := held_rate(position)) is not None:
        kept = rows[held]
        words = (
            f"positions change in every {held.step}th row only: the {rows.size - kept.size} rows "
            "between are left out"
        )
    else:
        again = repeated_rows(position)
        if again.size == 0:
            return
        kept = np.setdiff1d(rows, again)
        words = f"left out {counted(again.size, 'row')} that repeat the row before"
        stamps = samples.table.t[kept]
        even = evenly(stamps)
        if even is not None and _less_noise(position[kept], even, stamps):
            words += f": the source has {1.0 / (even[1] - even[0]):.4g} Hz, less than the log"
            t = even
    samples.keep(kept, t)
    samples.rows = samples.rows[kept]
    if samples.logged is not None:
        samples.logged = samples.logged[kept]
    samples.left_out(rows.size - kept.size, words)


def _less_noise(position: FloatArray, t: FloatArray, than: FloatArray) -> bool:
    return _clearly_less(
        [(noise_differences(q, t), noise_differences(q, than)) for q in position.T]
    )


def _clearly_less(pairs: Sequence[tuple[FloatArray, FloatArray]]) -> bool:
    """Whether the first squares are clearly less than the second, over all joints.

    Each joint counts by its own mean square, so that a noisy one hides no other.
    """
    total = np.zeros(0)
    for own, other in pairs:  # one after another: a long log fills much of the memory
        less = other**2 - own**2
        sums = np.add.reduceat(less, np.arange(0, less.size, _TOGETHER)) if less.size else less
        sums = sums / max(float(np.mean(other**2)) if less.size else 0.0, 1e-300)
        longer, shorter = sorted((total, sums), key=len)[::-1]
        total = longer + np.pad(shorter, (0, longer.size - shorter.size))
    if total.size < 2:
        return False
    return bool(total.mean() > _CLEARLY * total.std(ddof=1) / np.sqrt(total.size))


def _on_regular_time(samples: Samples, timing: Timing) -> Regular:
    """Return the samples on regular time.

    Either the stamps jitter, or they are right: by the logged velocities, without any by the noise
    of the positions. Stamps that wander are right.
    """
    position, stamps = samples.table.position, samples.table.t
    if not timing.irregular:
        return Regular(samples, timing.step, position)
    even, regular = replace(samples), timing.taken
    if regular is None or _stamps_are_better(position, stamps, regular, samples.logged):
        return _by_stamps(even, timing)
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
    even.said(*words, resampled=lost.size)
    between = _between(number, position, whole) if lost.size else position
    _resample(even, timing, np.interp(whole, number, np.arange(number.size)), between)
    return Regular(even, timing.step, position, regular if lost.size else None)


def _stamps_are_better(
    position: FloatArray, stamps: FloatArray, regular: FloatArray, logged: FloatArray | None
) -> bool:
    """Whether stamps fit clearly better than regular times: velocities, else positions."""
    if (np.diff(stamps) <= 0.0).any():
        return False
    if logged is not None and logged.any() and np.isfinite(logged).all():
        joints = list(zip(position.T, logged.T, strict=True))
        return _clearly_less([(_off(q, stamps, v), _off(q, regular, v)) for q, v in joints])
    return _less_noise(position, stamps, regular)


def _off(position: FloatArray, t: FloatArray, velocity: FloatArray) -> FloatArray:
    """Velocities less the slopes of positions between rows, rad/s."""
    return np.asarray(np.diff(position) / np.diff(t) - 0.5 * (velocity[1:] + velocity[:-1]))


def _by_stamps(even: Samples, timing: Timing) -> Regular:
    rows, stamps = even.table.position, even.table.t
    at, steps = np.clip(timing.time, stamps[0], stamps[-1]), np.diff(stamps)
    words = (
        f"time stamps deviate by {_time(timing.jitter)} RMS from regular time (steps of "
        f"{_time(steps.min())} to {_time(steps.max())}): interpolated from them"
        if timing.number is None
        else f"samples taken at jittering times ({_time(timing.jitter)} RMS): interpolated"
    )
    even.said(f"{words} at {1.0 / timing.step:.6g} Hz", resampled=timing.count)
    kept = far_apart(stamps, _NEAREST * timing.step)
    if close := stamps.size - kept.size:
        even.left_out(
            close,
            f"left out {counted(close, 'row')} less than {_time(_NEAREST * timing.step)} after "
            "the row before",
        )
    between = _between(stamps[kept], rows[kept], at)
    _resample(even, timing, np.interp(at, stamps, np.arange(stamps.size)), between)
    cells = np.diff(stamps[kept])
    spread = float(np.sqrt(np.mean(cells**2) / (np.mean(cells) * timing.step)))
    return Regular(even, timing.step, rows[kept], stamps[kept], max(spread, 1.0))


def _resample(even: Samples, timing: Timing, order: FloatArray, position: FloatArray) -> None:
    """Take positions at regular times, at `order` in the rows; all else of the row before."""
    even.keep(np.floor(order + 1e-9).astype(np.int64), timing.time)
    even.table = replace(even.table, position=position)
    even.rows = np.interp(order, np.arange(even.rows.size), even.rows)
    even.said(samples=timing.count, jitter=timing.jitter)


def _between(x: FloatArray, position: FloatArray, at: FloatArray) -> FloatArray:
    from scipy.interpolate import make_interp_spline

    return np.asarray(make_interp_spline(x, position, k=3)(at))


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.2g} ms"


def _filtered(regular: Regular, noisy: Sequence[bool], options: ReadingOptions) -> Samples:
    """Low-pass what is noisy (or moves, with a stated cutoff) between its holds."""
    even, step, thinning = regular.even, regular.step, options.thinning
    measured, t = even.table.position, even.table.t
    stride = thinning.every(step) if thinning else 1
    kept = np.arange(0, t.size, stride)
    noise, floor = (
        [
            regular.spread * level(q, regular.t) if is_so else 0.0
            for q, is_so in zip(regular.position.T, noisy, strict=True)
        ]
        for level in (noise_level, noise_floor)
    )
    resting = with_resting_ends(measured, step, noise, find_noisy_holds(measured, step, noise))
    kinds: dict[str, type] = dict.fromkeys(("position", "velocity", "acceleration"), float)
    # how far the low pass may be wrong is not known to more than single precision's digits
    kinds |= {"shift": np.float32, "moving": bool}
    parts: dict[str, NDArray[Any]] = {
        name: np.empty((kept.size, len(even.columns)), kind) for name, kind in kinds.items()
    }
    passes, spreads = [], []
    for i, q in enumerate(measured.T):
        holds = resting[i] if noisy[i] else find_holds(q, float(even.table.resolution[i]))
        passes.append(_chosen_pass(q, step, floor[i], holds, noisy[i], options.cutoff))
        columns, spread_of = _low_passed(regular, i, holds, passes[i], noise[i], thinning)
        for target, column in zip(parts.values(), columns, strict=True):
            target[:, i] = column
        spreads.append(spread_of)
    names, spread = [column.name for column in even.columns], np.array(spreads)
    even.said(
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
    unit = " or ".join(dict.fromkeys(column.unit for column in even.columns))
    line = _noise_line(even.reading, unit)
    even.said(line, noise_line=line)
    even.keep(kept)
    even.table = replace(
        even.table,
        position=parts["position"],
        velocity=parts["velocity"],
        acceleration=parts["acceleration"],
    )
    even.every = stride
    ends = [0.0 if own.cutoff is None else _ONE_SIDED / own.cutoff for own in passes]
    _leave_out_ends(even, parts["moving"], np.array(ends), stride * step)
    return even


@dataclass(frozen=True)
class _Pass:
    """A joint's low pass: cutoff, Hz, or None; which; RMS acceleration it takes away."""

    cutoff: float | None = None
    gaussian: bool = False
    lost: float = 0.0


def _chosen_pass(
    q: FloatArray,
    step: float,
    noise: float,
    holds: Sequence[tuple[int, int]],
    is_noisy: bool,
    stated: float | str | None,
) -> _Pass:
    """Return the low pass that a joint needs, or with the stated cutoff if it moves."""
    moves = sum(last - first + 1 for first, last in holds) < q.size
    if not moves or stated == "none" or (stated is None and not is_noisy):
        return _Pass()
    seen, gaussian = Spectra.of(q, step, noise), False
    cutoff = stated if isinstance(stated, float) else signal_cutoff(seen)
    if stated is None and cutoff is not None and acceleration_jumps(seen, cutoff):
        cutoff, gaussian = signal_cutoff(seen, gaussian=True), True
    lost = 0.0 if cutoff is None else motion_taken_away(seen, cutoff, gaussian)
    return _Pass(cutoff, gaussian, lost)


def _leave_out_ends(even: Samples, moving: BoolArray, ends: FloatArray, step: float) -> None:
    """Leave out the ends of a log in which a joint moves: there a low pass has one side only.

    Args:
        moving: (T, nj) where a joint is not held.
        ends: (nj,) how long its low pass is unreliable at an end, s.
    """
    count, stride, uncertain = len(moving), even.every, even.reading.uncertain
    first, last = (
        min(int(np.max(ends * moving[at], initial=0.0) / step + 0.5), count // 4) for at in (0, -1)
    )
    if first == last == 0:
        return
    assert uncertain is not None
    inside = slice(first, count - last)
    even.said(
        uncertain=replace(
            uncertain,
            moving=moving[inside],
            acceleration_shift=uncertain.acceleration_shift[inside],
        )
    )
    even.left_out(
        (first + last) * stride,
        f"left out {_time(first * step)} at the start and {_time(last * step)} at the end, "
        "where joints move and the low pass has samples on one side only",
    )
    even.rows = even.rows[first * stride : (count - last) * stride]
    even.keep(np.arange(count)[inside])


def _low_passed(
    regular: Regular,
    joint: int,
    holds: Sequence[tuple[int, int]],
    chosen: _Pass,
    noise: float,
    thinning: Thinning | None,
) -> tuple[list[NDArray[Any]], list[float]]:
    """Return one joint's motion, thinned; its whole columns fill much of the memory.

    Position, velocity, acceleration, shift, where it moves (T,); sigma of velocity, acceleration.
    """
    t, step, cutoff, gaussian = regular.even.table.t, regular.step, chosen.cutoff, chosen.gaussian
    stride = thinning.every(step) if thinning else 1
    q = regular.even.table.position[:, joint].copy()
    moving, shift = np.ones(q.size, dtype=bool), np.zeros(1)
    for first, last in holds:
        q[first : last + 1] = q[first : last + 1].mean()
        moving[first : last + 1] = False
    if cutoff is None:
        v, a = position_derivatives(t, q, holds)
        spread = [noise * gain / step ** (k + 1) for k, gain in enumerate(SPLINE_GAINS)]
    else:
        lower = low_pass(q, step, (_GAUSSIAN_LOWER if gaussian else _LOWER) * cutoff, gaussian)
        shift = position_derivatives(t, lower, ())[1][::stride].copy()
        del lower
        smooth = low_pass(q, step, cutoff, gaussian)
        v, a = position_derivatives(t, smooth, ())
        shift = (shift - a[::stride]) * moving[::stride]
        np.copyto(q, smooth, where=moving)
        del smooth
        v[~moving] = a[~moving] = 0.0
        spread = [noise * noise_gain(step, cutoff, order, gaussian) for order in (1, 2)]
    q, v = q[::stride].copy(), v[::stride].copy()
    if thinning and stride > 1:
        a = thinning.acceleration(a, step)
    return [q, v, a[::stride], shift, moving[::stride]], spread


def _noise_line(reading: Reading, unit: str) -> str:
    """Say "filtered at 11 Hz, noise 1.0e-05 rad", with ranges over joints."""
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
