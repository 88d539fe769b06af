"""Overloads shorter than a cycle: what its mean hides.

A winding follows its heat with its own time constant, so that the mean over a long cycle says
little of minutes of overload in it. The root mean square over any time as long as that constant is
held against the continuous torque instead; so is the time at a standstill above it, in which one
phase takes all the heat. Cycles repeat: a window runs on from the last sample to the first.
"""

from __future__ import annotations

import numpy as np

from pinfric.kernels.compiled import kernel
from pinfric.study.sizing.catalog import Conditions, Thermal
from pinfric.study.sizing.duty import Schedule


def overload_window(thermal: Thermal | None, conditions: Conditions) -> tuple[float, str]:
    """Return the time (s) within which overload counts, and where it comes from, in words."""
    if thermal is not None and thermal.winding_time is not None:
        text = "maxon, Key information: short-term operation, within the winding's time constant"
        return thermal.winding_time, text
    return conditions.thermal_time, "pinfric: conditions.thermal_time for a time constant not known"


def moving_rms(t: np.ndarray, x: np.ndarray, window: float, duty: Schedule | None = None) -> float:
    """Return the largest root mean square over any `window` of time of a cycle that repeats.

    max over s of sqrt(1/window int_s^(s + window) x^2 dt), x^2 linear between samples (as the
    trapezoidal rule has it): exact, windows may begin and end between samples.

    Args:
        t: (T,) increasing, s; the last sample is the first of the next repetition.
        x: (T,).
        window: s; no longer than the cycle, a longer one is cut to it.
        duty: which samples are which cycle of a period; None: they are one.
    """
    if duty is not None:
        order, t = duty.played(t, window)
        x = x[order]
    largest = float(np.abs(x).max())
    if len(t) == 1 or not largest > 0:  # also NaN
        return largest
    part = x / largest  # its square cannot overflow
    mean = _greatest_mean(t, part * part, min(window, float(t[-1] - t[0])))
    return largest * min(float(np.sqrt(mean)), 1.0)  # rounding must not lift it above the peak


def longest_above(
    t: np.ndarray, x: np.ndarray, limit: float, where: np.ndarray, duty: Schedule | None = None
) -> float:
    """Return the longest time (s) in which |x| stays above a limit, in a cycle that repeats.

    Infinite where it never ends.

    Args:
        t: (T,) increasing, s. x: (T,), its magnitude linear between samples. limit: of |x|.
        where: (T,) only between two samples that are both in this mask.
        duty: which samples are which cycle of a period; None: they are one.
    """
    if not (np.abs(x[where]) > limit).any():
        return 0.0
    if duty is not None:
        order, t = duty.played(t)
        x, where = x[order], where[order]
    return float(_longest_above(t, np.abs(x), limit, where))


@kernel
def _greatest_mean(t: np.ndarray, y: np.ndarray, window: float) -> float:
    """Return the greatest mean of y (T,), linear between samples, over any window of the cycle.

    The window's integral G(s) has the slope y(s + window) - y(s), linear between the instants at
    which one of its two edges meets a sample: there, or where the slope passes zero, G is greatest.
    """
    n = t.size - 1
    total, j, left = 0.0, 0, window
    while j < n and left >= t[j + 1] - t[j]:
        total += (t[j + 1] - t[j]) * (y[j] + y[j + 1]) / 2
        left -= t[j + 1] - t[j]
        j += 1
    if j == n:  # the whole cycle, wherever it begins
        return total / window
    head = y[j] + left * (y[j + 1] - y[j]) / (t[j + 1] - t[j])
    total += left * (y[j] + head) / 2
    best, i, tail = total, 0, y[0]
    to_tail, to_head = t[1] - t[0], t[j + 1] - t[j] - left  # until an edge meets its next sample
    while i < n:
        step = min(to_tail, to_head)
        before = head - tail
        head += step * (y[j + 1] - y[j]) / (t[j + 1] - t[j])
        tail += step * (y[i + 1] - y[i]) / (t[i + 1] - t[i])
        after = head - tail
        if before > 0.0 and after < 0.0:
            best = max(best, total + step * before * before / (2 * (before - after)))
        total += step * (before + after) / 2
        best = max(best, total)
        to_tail -= step
        to_head -= step
        if to_tail <= 0.0:
            i += 1
            if i < n:
                to_tail, tail = t[i + 1] - t[i], y[i]
        if to_head <= 0.0:
            j = (j + 1) % n
            to_head, head = t[j + 1] - t[j], y[j]
    return best / window


@kernel
def _longest_above(t: np.ndarray, x: np.ndarray, limit: float, where: np.ndarray) -> float:
    """See `longest_above`; two rounds, so that a time that runs on past the end is found whole."""
    n, run, best = t.size - 1, 0.0, 0.0
    for k in range(2 * n):
        i = k % n
        step, a, b = t[i + 1] - t[i], x[i] - limit, x[i + 1] - limit
        if not (where[i] and where[i + 1]) or (a <= 0.0 and b <= 0.0):
            run = 0.0
        elif a > 0.0 and b > 0.0:
            run += step
        elif a > 0.0:
            best = max(best, run + step * a / (a - b))
            run = 0.0
        else:
            run = step * b / (b - a)
        best = max(best, run)
    return np.inf if best >= t[-1] - t[0] else best
