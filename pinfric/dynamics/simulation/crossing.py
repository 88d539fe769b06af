"""The first time in a step at which a guard function falls below zero, including grazing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Halvings of an interval in which a guard may dip below zero unseen.
_DEPTH = 8

Guard = Callable[[float], float]


def first_crossing(
    guard: Guard, times: np.ndarray, values: np.ndarray, slack: float
) -> float | None:
    """Return the first time at which a guard falls below -slack, located at zero, or None.

    Between two positive values a dip is searched for if the second differences allow one. A guard
    that is below -slack at the start triggers there.

    Args:
        guard: of time; may jump.
        times, values: (n,) evenly spaced over the step, and the guard there, finite.
        slack: rounding of the guard.
    """
    if values[0] < -slack:
        return float(times[0])
    bend = float(np.abs(np.diff(values, 2)).max()) if len(values) > 2 else 0.0
    for i in range(len(times) - 1):
        ends = (times[i], times[i + 1]), (values[i], values[i + 1])
        crossing = _within(guard, *ends, slack, bend, _DEPTH)
        if crossing is not None:
            return crossing
    return None


def _within(
    guard: Guard,
    times: tuple[float, float],
    values: tuple[float, float],
    slack: float,
    bend: float,
    depth: int,
) -> float | None:
    (start, end), (at_start, at_end) = times, values
    if at_end < -slack:
        if at_start > 0.0:
            return root(guard, start, end)
        for k in range(1, 45):  # it starts on zero: after a moment above, or from where it leaves
            middle = start + (end - start) * 0.5**k
            if guard(middle) > slack:
                return root(guard, middle, end)
        return root(lambda t: guard(t) + slack, start, end) if slack > 0.0 else start
    # a parabola with this second difference dips at most bend / 8 below both ends
    if min(at_start, at_end) > 0.5 * bend or depth == 0 or bend <= slack:
        return None
    middle = 0.5 * (start + end)
    at_middle = guard(middle)
    bend = max(0.25 * bend, abs(at_start - 2.0 * at_middle + at_end))
    crossing = _within(guard, (start, middle), (at_start, at_middle), slack, bend, depth - 1)
    if crossing is not None:
        return crossing
    return _within(guard, (middle, end), (at_middle, at_end), slack, bend, depth - 1)


def root(guard: Guard, start: float, end: float) -> float:
    """Return when a guard falls through zero, to rounding; of a jump, its far side.

    Args:
        guard: not negative at `start`, negative at `end` (s).
    """
    from scipy.optimize import brentq  # 0.6 s to import

    if guard(start) <= 0.0:
        return start
    if guard(end) >= 0.0:  # a guard of iterated friction, within its rounding
        return end
    tolerance = 4.0 * np.finfo(float).eps
    time = float(brentq(guard, start, end, xtol=1e-15 * max(1.0, abs(end)), rtol=tolerance))
    after = min(time + 8.0 * np.finfo(float).eps * max(1.0, abs(end)), end)
    return after if guard(time) >= 0.0 > guard(after) else min(time, end)
