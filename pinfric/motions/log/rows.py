"""Rows of a log: stamps that repeat, run back, jitter or miss, and the regular time behind them.

Arguments: t (rows,) s; lines (rows,) of these in the file; position (rows, nj) rad or m; said, to
which notes and problems are added.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse.result import runs
from pinfric.model.arrays import BoolArray, FloatArray, IntArray
from pinfric.model.brief import counted
from pinfric.motions.joint_columns import listing
from pinfric.motions.log.frame import BAD_SHARE, FEWEST, Remarks

#: A step this many times the median one is a gap: what happened in it would be invented.
GAP_FACTOR = 20.0
#: s. Below this a time step is a unit error or rounding: rates from it would be noise.
_SHORTEST_STEP = 1e-9
#: s, three centuries. Beyond it a time is a unit error (a clock's milliseconds are), and the steps
#: between times drown in its rounding.
_LONGEST_TIME = 1e10
#: Share of a step by which stamps may miss regular time, RMS.
_JITTER = 0.5
#: Where steps vary by a larger share than this (median), a lost or doubled row cannot be told from
#: jitter, and rows count as taken one step after another.
_PRECISE = 0.1
#: Share of a step below which jitter is a clock's rounding: mended, but not worth a word.
ROUNDED = 1e-3
#: Share of a step below which stamps stay as they are. Twice the rounding of a clock's seconds
#: since 1970 (2.4e-7 s) puts 0.5 rad/s^2 into a joint at 2 rad/s that is logged at 500 Hz.
_REGULAR = 1e-6
#: Share of the changes that come at one and the same number of rows, where a slower rate is held.
_SAME_PERIOD = 0.9
#: Counts by which a joint moves in the rows beside one that repeats the row before it.
_CLEAR_STEP = 10.0


@dataclass(frozen=True)
class Timing:
    """When the rows of a log were taken, and the regular times to compute on.

    Args:
        start, step, count: of the regular times, s.
        number: (rows,) increasing whole numbers: row i was taken at start + step number[i] but for
            jitter; a missing one is a lost row. None: stamps wander from any regular time.
        jitter: RMS of the stamps about regular time, s.
    """

    start: float
    step: float
    count: int
    number: IntArray | None
    jitter: float

    @property
    def time(self) -> FloatArray:
        """The regular times, lost rows among them, s."""
        return self.start + self.step * np.arange(self.count, dtype=np.float64)

    @property
    def taken(self) -> FloatArray | None:
        """The regular times at which rows were taken, s; None where stamps wander."""
        if self.number is None:
            return None
        return np.asarray(self.start + self.step * self.number, dtype=np.float64)

    @property
    def irregular(self) -> bool:
        """Whether stamps differ from regular time by more than rounding, or rows are lost."""
        if self.number is None or self.count != self.number.size:
            return True
        return self.jitter > _REGULAR * self.step


def check_times(t: FloatArray, lines: Sequence[int], problems: list[str]) -> None:
    """Append impossible times to `problems`: beyond 1e10 s, or less than 1 ns apart."""
    far = np.flatnonzero(np.isfinite(t) & (np.abs(t) > _LONGEST_TIME))
    if far.size:
        where = listing(f"line {lines[i]} (t = {t[i]:.9g})" for i in far.tolist())
        problems.append(f"times beyond {_LONGEST_TIME:g} s are refused, t is in seconds: {where}")
        return
    steps = np.diff(t)
    tiny = np.flatnonzero((steps > 0.0) & (steps < _SHORTEST_STEP))
    if tiny.size:
        where = listing(f"line {lines[i + 1]} ({steps[i]:.3g} s)" for i in tiny.tolist())
        problems.append(f"time steps below {_SHORTEST_STEP:g} s are refused: {where}")


def ordered_rows(t: FloatArray, lines: Sequence[int], said: Remarks) -> IntArray:
    """Return the rows to keep: those whose stamp is later than all before.

    Where one stamp is earlier than the one before only, either may be wrong, or both rows are
    exchanged: none of them is kept. Stamps that only jitter about regular time are all kept. More
    than 1 % of doubled or backward stamps are a problem.
    """
    all_rows = np.arange(t.size)
    if not np.isfinite(t).all():  # refused already
        return all_rows
    latest = np.maximum.accumulate(t)
    wrong = np.flatnonzero(t[1:] <= latest[:-1]) + 1
    if wrong.size == 0 or _only_jitters(t):
        return all_rows
    if t.size < FEWEST or wrong.size > BAD_SHARE * t.size:
        where = listing(
            f"line {lines[i]} (t = {t[i]:.9g} after {t[i - 1]:.9g})" for i in wrong.tolist()
        )
        said.problems.append(
            f"time must increase; it does not at {where}; sort the rows by time, or log finer or "
            "other stamps"
        )
        return all_rows
    back = wrong[(wrong > 1) & (t[wrong] < t[wrong - 1])]
    wrong = np.union1d(wrong, back[t[back] > t[back - 2]] - 1)
    said.notes.append(
        f"left out {counted(wrong.size, 'row')} with repeated or backward time stamps, the first "
        f"in line {lines[int(wrong[0])]}"
    )
    return np.setdiff1d(all_rows, wrong)


def _only_jitters(t: FloatArray) -> bool:
    """Whether rows were taken at regular times, and only their stamps vary."""
    steps = np.diff(t)
    middle = float(np.median(steps))
    if t.size < FEWEST or np.median(np.abs(steps - middle)) <= _PRECISE * middle:
        return False
    return evenly(t) is not None


def regular_time(t: FloatArray) -> Timing | None:
    """Return the regular time behind stamps; None for few rows, or times that do not increase.

    Steps are rounded to multiples of the median one and summed, then a line is fitted: rounding the
    stamps themselves would drift past lost rows. Stamps that wander by more than half a step from
    the line are taken as the rows' times.
    """
    if t.size < FEWEST:
        return None
    steps = np.diff(t)
    if _only_jitters(t):
        number = np.arange(t.size)
    else:
        whole = np.rint(steps / np.median(steps)).astype(np.int64)
        if (whole <= 0).any() or whole.sum() > GAP_FACTOR * t.size:
            return _wandering_time(t)
        number = np.concatenate(([0], np.cumsum(whole)))
    step, start, jitter = _line(t, number)
    if step <= 0.0 or jitter > _JITTER * step:
        return _wandering_time(t)
    return Timing(start, step, int(number[-1]) + 1, number, jitter)


def _line(t: FloatArray, number: IntArray) -> tuple[float, float, float]:
    """Return step, start and RMS distance of the line t = start + step number, s."""
    step, start = np.polyfit(number, t, 1)
    off = t - start - step * number
    with np.errstate(over="ignore"):  # stamps of 1e200 are off by more than any step
        return float(step), float(start), float(np.sqrt(np.mean(off**2)))


def _wandering_time(t: FloatArray) -> Timing | None:
    """Return as many regular times as rows, but for gaps, over stamps that increase."""
    steps = np.diff(t)
    if (steps <= 0.0).any():
        return None
    step = float(np.mean(steps[steps <= GAP_FACTOR * np.median(steps)]))
    count = int((t[-1] - t[0]) / step + 1e-9) + 1
    if count > GAP_FACTOR * t.size:  # a gap that is longer than the log
        return None
    return Timing(float(t[0]), step, count, None, _line(t, np.arange(t.size))[2])


def far_apart(t: FloatArray, least: float) -> IntArray:
    """Return the rows to interpolate between, each at least `least` s after the one before.

    A spline through noisy rows that nearly coincide swings far beyond them.
    """
    if (np.diff(t) >= least).all():
        return np.arange(t.size)
    kept = [0]
    while (following := int(np.searchsorted(t, t[kept[-1]] + least))) < t.size:
        kept.append(following)
    return np.array(kept)


def held_rate(position: FloatArray) -> slice | None:
    """Return the slice of rows in which positions change, where a slower source is held between.

    A coarse encoder at slow speed repeats itself too, but not regularly, nor by many counts.
    """
    change = np.zeros(max(len(position) - 1, 0), dtype=bool)
    for q in position.T:  # one after another: a long log fills much of the memory
        change |= np.diff(q) != 0.0
    places = np.flatnonzero(change) + 1
    if places.size < FEWEST:
        return None
    periods = np.diff(places)
    period = int(np.median(periods))
    if period < 2 or np.mean(periods % period == 0) < _SAME_PERIOD:
        return None
    sizes = np.abs(np.diff(position, axis=0))
    least = np.min(sizes, axis=0, where=sizes > 0.0, initial=np.inf)
    if np.median(sizes[places - 1] / least) < 3.0:
        return None
    phase = int(np.bincount(places % period).argmax())
    return slice(phase, None, period)


def repeated_rows(position: FloatArray) -> IntArray:
    """Return the rows that repeat the row before them in the middle of a motion.

    A recorder that is faster than its source repeats. Where all joints slow down to a stop and go
    on, a repetition is the motion itself.
    """
    same = np.ones(max(len(position) - 1, 0), dtype=bool)
    for q in position.T:  # one after another: a long log fills much of the memory
        same &= np.diff(q) == 0.0
    places = np.flatnonzero(same[2:-2]) + 2
    repeats = np.zeros(places.size, dtype=bool)
    for q in position.T if places.size else ():
        steps = np.diff(q)
        sizes = np.abs(steps)
        least = np.min(sizes, where=sizes > 0.0, initial=np.inf)
        inner = np.minimum(sizes[places - 1], sizes[places + 1])
        outer = np.maximum(sizes[places - 2], sizes[places + 2])
        goes_on = steps[places - 1] * steps[places + 1] > 0.0
        repeats |= goes_on & (inner > _CLEAR_STEP * least) & (inner > 0.5 * outer)
    return places[repeats] + 1


def evenly(t: FloatArray) -> FloatArray | None:
    """Return the times of rows taken one step after another, s; None: they were not."""
    step, start, jitter = _line(t, np.arange(t.size))
    even = start + step * np.arange(t.size, dtype=np.float64)
    return even if step > 0.0 and jitter <= _JITTER * step else None


def gaps(t: FloatArray) -> IntArray:
    """Return the rows after which a step is far longer than the median."""
    steps = np.diff(t)
    return np.flatnonzero(steps > GAP_FACTOR * np.median(steps))


def gap_problems(t: FloatArray) -> list[str]:
    """Return one line that names gaps longer than 20 sample periods, if any."""
    far = gaps(t)
    if far.size == 0:
        return []
    where = listing(f"{t[i]:.6g} to {t[i + 1]:.6g} s" for i in far)
    return [
        f"gaps longer than {GAP_FACTOR:g} sample periods: {where}; the motion there "
        "is not in the file: split the log there, or add the missing rows"
    ]


#: Rows that a lost message or a spike lasts at most: longer ones may be the effort itself.
_LONGEST = 5
#: Typical changes from row to row within which an effort may pass through zero.
_NEAR_ZERO = 5.0
#: Spreads (of nine tenths of the rows) beyond these rows at which hardly any value is; counts of an
#: encoder that are no motion.
_BEYOND, _COUNTS = 3.0, 5.0
#: Rows beside a spike that are as all others; as they are if they are beyond them by less than this
#: share of what the spike is.
_BESIDE, _FLANK = 2, 0.5


def mended_effort(
    joint: str,
    effort: FloatArray,
    position: FloatArray,
    lines: Sequence[int],
    said: Remarks,
) -> FloatArray:
    """Return an effort (rows,) as logged, with lost samples and spikes interpolated.

    Lost ones are exactly 0 amid values of one sign far from it; spikes are far beyond all other
    values, also those beside them, while the joint (`position`: (rows,)) moves as usual. Both are
    short; more than 1 % of the rows are a problem.
    """
    if effort.size < FEWEST or not np.isfinite(effort).all():
        return effort
    result = effort
    for bad, what in (
        (_zeros(effort), "exactly 0 amid other values"),
        (_spikes(effort, position), ""),
    ):
        if not bad.size:
            continue
        where = f"{counted(bad.size, 'row')} of {effort.size}, the first in line {lines[bad[0]]}"
        what = what or f"up to {np.abs(effort[bad]).max():.4g}, far beyond all other values"
        if bad.size > BAD_SHARE * effort.size:
            said.problems.append(
                f"joint {joint}: its effort is {what} in {where}: samples were lost; log it again, "
                "or leave these rows out of the file"
            )
            continue
        said.notes.append(f"joint {joint}: left out its effort, {what}, in {where}")
        result = result.copy() if result is effort else result
        kept = np.setdiff1d(np.arange(effort.size), bad)
        result[bad] = np.interp(bad, kept, result[kept])
    return result


def _zeros(effort: FloatArray) -> IntArray:
    """Rows of short runs of zeros amid values of one sign far from zero."""
    zero = effort == 0.0
    if not zero.any() or zero.all():
        return np.zeros(0, dtype=np.int64)
    steps = np.abs(np.diff(effort[~zero]))
    count = float(np.min(steps, where=steps > 0.0, initial=np.inf))
    near = _NEAR_ZERO * max(float(np.median(steps)), count) if np.isfinite(count) else 0.0

    def amid(first: int, last: int) -> bool:
        a, b = effort[first - 1], effort[last + 1]
        return bool(min(abs(a), abs(b)) > near and a * b > 0.0)

    return _short(zero, amid)


def _spikes(effort: FloatArray, position: FloatArray) -> IntArray:
    """Rows of short runs that neither rows beside nor the joint's motion explain."""
    far, reach = _far(effort)
    if reach == 0.0:
        return np.zeros(0, dtype=np.int64)
    speed = np.diff(position, prepend=position[:1])
    moves = np.zeros(effort.size, dtype=bool)
    for rate in (speed, np.diff(speed, append=speed[-1:])):
        off, usual = _far(rate)
        sizes = np.abs(rate)
        count = float(np.min(sizes, where=sizes > 0.0, initial=np.inf))
        moves |= off > max(usual, _COUNTS * count if usual == 0.0 else 0.0)

    def alone(first: int, last: int) -> bool:
        near = slice(max(first - _BESIDE, 0), last + 1 + _BESIDE)
        flanks = [*far[near.start : first], *far[last + 1 : near.stop]]
        edge = min(far[first], far[last])  # a smooth peak rises to its top
        jumps = max(flanks) < _FLANK * edge and edge > _FLANK * far[first : last + 1].max()
        return bool(jumps and not moves[near].any())

    return _short(far > reach, alone)


def _far(values: FloatArray) -> tuple[FloatArray, float]:
    """Return how far values are beyond nine tenths of them, and the usual limit."""
    low, high = np.quantile(values[:: max(1, values.size // 20_000)], (0.05, 0.95))
    return np.maximum(np.maximum(values - high, low - values), 0.0), _BEYOND * float(high - low)


def _short(flags: BoolArray, fits: Callable[[int, int], bool]) -> IntArray:
    """Rows of short runs, first to last, that fit."""
    fitting = []
    for first, last in runs(flags):
        inside = first > 0 and last + 1 < flags.size and last - first < _LONGEST
        if inside and fits(first, last):
            fitting.append(np.arange(first, last + 1))
    return np.concatenate(fitting) if fitting else np.zeros(0, dtype=np.int64)
