"""Overloads within a cycle that the mean hides, and the effect of time switched off.

A winding follows its heat with its own time constant, the housing with a longer one. Heat is in
proportion to T_m^2; each part of the temperature rise is a low-pass of it,

    tau theta' + theta = T_m^2,

settled over the period that repeats. The root of its greatest value is held against the continuous
torque. Of a torque T for t_on of a period T_p this is makers' overload rule
T/T_continuous <= sqrt((1 - e^(-T_p/tau))/(1 - e^(-t_on/tau))).

At a standstill one phase takes all the heat: there the time above the continuous torque counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.drives.duty import Schedule, once
from pinfric.drives.policy import Conditions
from pinfric.drives.thermal import Thermal, settled
from pinfric.kernels.compiled import kernel


class Lag(NamedTuple):
    """Time constants of a motor's temperature rise and each one's part of it; and their source."""

    times: tuple[float, ...]
    parts: tuple[float, ...]
    source: str


def heat_lag(thermal: Thermal | None, whole: float | None, conditions: Conditions) -> Lag:
    """Return how a motor's temperature follows its heat.

    Winding and housing, each by its thermal resistance, where both time constants are known; else
    the winding's alone, else the whole motor's, else that of the conditions.

    Args:
        whole: time constant of the motor, s, where one is printed.
        conditions: `thermal_time` for motors of which none is known.

    Source: maxon, Key information: thermal behaviour (two nodes); IEC 60034-1, S3.
    """
    if thermal is not None and thermal.winding_time is not None:
        source = "maxon, Key information: thermal behaviour, time constants of winding and housing"
        if thermal.housing_time is None:
            return Lag((thermal.winding_time,), (1.0,), source)
        whole_resistance = thermal.winding_housing + thermal.housing_ambient
        of_winding = thermal.winding_housing / whole_resistance
        return Lag(
            (thermal.winding_time, thermal.housing_time), (of_winding, 1.0 - of_winding), source
        )
    if whole is not None:
        return Lag((whole,), (1.0,), "IEC 60034-1, S3: the motor's thermal time constant")
    text = "pinfric: conditions.thermal_time for a time constant not known"
    return Lag((conditions.thermal_time,), (1.0,), text)


def standstill_time(thermal: Thermal | None, conditions: Conditions) -> tuple[float, str]:
    """Return for how long (s) a stalled motor may be overloaded, and the source, in words."""
    if thermal is not None and thermal.winding_time is not None:
        text = "maxon, Key information: short-term operation, within the winding's time constant"
        return thermal.winding_time, text
    return conditions.thermal_time, "pinfric: conditions.thermal_time for a time constant not known"


def settled_heat(t: np.ndarray, x: np.ndarray, lag: Lag, duty: Schedule | None = None) -> float:
    """Return the root of the greatest settled sum of part x theta, tau theta' + theta = x^2.

    x^2 is linear between samples; each step is exact, and the settled cycle is a fixed point.

    Args:
        t: (T,) increasing, s; the last sample is the first of the next repetition. x: (T,).
        duty: the cycles of a period; None: one cycle.
    """
    largest = float(np.abs(x).max())
    if len(t) == 1 or not largest > 0:  # also NaN
        return largest
    schedule, y = duty or once(len(t)), np.square(x / largest)  # cannot overflow
    ratio = np.diff(t)[:, None] / np.array([lag.times[0], lag.times[-1]])
    lost = -np.expm1(-ratio)
    # of the ramp's second half; a short step leaves half of it
    late = np.where(ratio > 1e-6, 1.0 - lost / ratio, 0.5 * ratio)
    maps = np.zeros((len(ratio), 6))
    maps[:, [0, 3]] = 1.0 - lost
    maps[:, 4:] = y[:-1, None] * lost + np.diff(y)[:, None] * late
    parts = np.array([*lag.parts, 0.0][:2])
    mean = settled(maps, np.array(schedule.starts), schedule.counts, parts)[2]
    return largest * min(float(np.sqrt(mean)), 1.0)  # rounding must not lift it above the peak


def longest_above(
    t: np.ndarray, x: np.ndarray, limit: float, where: np.ndarray, duty: Schedule | None = None
) -> float:
    """Return the longest time (s) in which |x| exceeds a limit in a repeated cycle, or infinity.

    Args:
        t: (T,) increasing, s. x: (T,), its magnitude linear between samples. limit: of |x|.
        where: (T,) only between two samples that are both in this mask.
        duty: the cycles of a period; None: one cycle.
    """
    if not (np.abs(x[where]) > limit).any():
        return 0.0
    if duty is not None:
        order, t = duty.played(t)
        x, where = x[order], where[order]
    return float(_longest_above(t, np.abs(x), limit, where))


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
