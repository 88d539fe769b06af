"""The times at which a motion with rests is sampled: moves densely, long rests sparsely."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np

from pinfric.errors import TrajectoryError
from pinfric.model.arrays import FloatArray
from pinfric.model.magnitudes import LONGEST_TIME

#: s; instants closer than this are one: sums of durations carry rounding.
_SAME_INSTANT = 1.0e-9
#: s, and sample periods; rests that do not last longer than both are sampled as moves are.
LONG_REST, _MANY_PERIODS = 2.0, 600
#: Samples of a longer rest.
_OF_REST = 400
#: Sample periods at either end of it that are not left out, for differences over samples.
_AT_ENDS = 8
#: s; steps grow from here on: less than a winding takes to warm.
_GROWS = 1.0
#: More samples than this are a mistyped rate or duration, not a motion.
_MAX_SAMPLES = 20_000_000
#: Bytes that inverse dynamics, which takes the least, needs for each joint of a sample.
_BYTES = 150
#: Times of more periods than this differ by too few digits.
_MAX_PERIODS = 1.0e15


def same_instant(end: float) -> float:
    """Return within which time two instants of a motion that lasts until `end` are one, s."""
    return max(_SAME_INSTANT, 4.0 * float(np.spacing(end)))


def sample_times(
    end: float, rate: float, rests: Iterable[tuple[float, float]], source: str
) -> FloatArray:
    """Return the times (T,) of samples from 0 to `end`, which is one on the grid or not.

    At multiples k of 1/rate. At rest nothing changes, so of a long rest few are kept: both ends,
    and k - k_0 = rate (e^(u log(1 + T/s)) - 1) s with u from 0 to 1 and s = 1 s, so that steps grow
    with the time at rest as what cools down changes.

    Args:
        end: s. rate: Hz. rests: (begin, end), s, in the order of time.
        source: for messages.

    Raises:
        TrajectoryError: too many samples, or longer than times can be told apart.
    """
    shortest = max(LONG_REST, _MANY_PERIODS / rate)
    long = [(first, last) for first, last in rests if last - first > shortest]
    moving = end - sum(last - first for first, last in long)
    if moving * rate > _MAX_SAMPLES:
        raise TrajectoryError(
            f"{source}: {moving:g} s at sample_rate {rate:g} Hz are {moving * rate:.3g} samples; "
            f"at most {_MAX_SAMPLES} are made: lower the rate or check the durations"
        )
    if end > LONGEST_TIME or end * rate > _MAX_PERIODS:
        raise TrajectoryError(
            f"{source}: {end:g} s at sample_rate {rate:g} Hz; at most {LONGEST_TIME:g} s and "
            f"{_MAX_PERIODS:g} sample periods are taken: lower the rate or check the durations"
        )
    periods, begin, count = [], 0, int(np.floor(end * rate + 1.0e-6)) + 1
    for first, last in long:
        left = int(np.ceil(first * rate)) + _AT_ENDS
        right = int(np.floor(last * rate)) - _AT_ENDS
        growth = np.linspace(0.0, np.log1p((right - left) / (rate * _GROWS)), _OF_REST)
        inside = left + np.rint(np.expm1(growth) * (rate * _GROWS)).astype(np.int64)
        periods += [np.arange(begin, left), np.unique(np.minimum(inside, right))]
        begin = right + 1
    t = np.concatenate([*periods, np.arange(begin, count)]) / rate
    return t if end - t[-1] <= same_instant(end) else np.append(t, end)


def check_memory(samples: int, joints: int, source: str) -> None:
    """Refuse a motion whose inverse dynamics does not fit the machine's memory.

    Raises:
        TrajectoryError: says how much it takes.
    """
    if too_much := beyond_memory(samples * joints * _BYTES):
        raise TrajectoryError(
            f"{source}: {samples} samples of {joints} joints {too_much}: lower the sample_rate"
        )


def beyond_memory(need: float) -> str:
    """Return "" where this machine has so much memory (bytes), else what to say of it."""
    there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if need <= there:
        return ""
    return f"take some {1e-9 * need:.0f} GB, and this machine has {1e-9 * there:.0f} GB"
