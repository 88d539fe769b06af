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
from pinfric.drives.thermal import Thermal
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
    schedule = duty or once(len(t))
    times, parts = np.array([*lag.times, lag.times[0]][:2]), np.array([*lag.parts, 0.0][:2])
    return float(settled_root(t, x, times, parts, np.array(schedule.starts), schedule.counts))


@kernel
def settled_root(
    t: np.ndarray,
    x: np.ndarray,
    times: np.ndarray,
    parts: np.ndarray,
    starts: np.ndarray,
    counts: np.ndarray,
) -> float:
    """See `settled_heat`.

    Args:
        times, parts: (2,) of the lag; of a single one the other part is 0.
        starts, counts: (K + 1,), (K,) of the cycles: first samples, and how often each is run.
    """
    largest = np.abs(x).max()
    if t.size == 1 or not largest > 0.0:  # also NaN
        return largest
    nodes = 2 if parts[1] > 0.0 else 1
    left, added = np.empty((t.size - 1, nodes)), np.empty((t.size - 1, nodes))
    for k in range(t.size - 1):
        before, after = (x[k] / largest) ** 2, (x[k + 1] / largest) ** 2  # cannot overflow
        for j in range(nodes):
            lost, late = _low_pass((t[k + 1] - t[k]) / times[j])
            left[k, j], added[k, j] = 1.0 - lost, before * lost + (after - before) * late
    whole, rise, theta, most = np.ones(2), np.zeros(2), np.zeros(2), 0.0
    for c in range(counts.size):
        for _ in range(counts[c]):
            for k in range(starts[c], starts[c + 1] - 1):
                for j in range(nodes):
                    whole[j] *= left[k, j]
                    rise[j] = left[k, j] * rise[j] + added[k, j]
    for j in range(nodes):
        theta[j] = rise[j] / (1.0 - whole[j])
    for c in range(counts.size):
        for _ in range(counts[c]):
            for k in range(starts[c], starts[c + 1]):
                if k > starts[c]:
                    for j in range(nodes):
                        theta[j] = left[k - 1, j] * theta[j] + added[k - 1, j]
                most = max(most, parts[0] * theta[0] + parts[1] * theta[1])
    return largest * min(np.sqrt(most), 1.0)  # rounding must not lift it above the peak


@kernel
def _low_pass(ratio: float) -> tuple[float, float]:
    """Return 1 - e^-r, r = step/tau, and the mean of 1 - e^-s over s from 0 to r.

    Short steps by their series, which is as exact and takes a tenth of the time.
    """
    if ratio < 1e-3:
        late = ratio / 2 * (1.0 - ratio / 3 * (1.0 - ratio / 4 * (1.0 - ratio / 5)))
        return ratio * (1.0 - late), late
    lost = -np.expm1(-ratio)
    return lost, 1.0 - lost / ratio


def longest_above(
    t: np.ndarray, x: np.ndarray, limit: float, where: np.ndarray, duty: Schedule | None = None
) -> float:
    """Return the longest time (s) in which |x| exceeds a limit in a repeated cycle, or infinity.

    Args:
        t: (T,) increasing, s. x: (T,), its magnitude linear between samples. limit: of |x|.
        where: (T,) only between two samples that are both in this mask.
        duty: the cycles of a period; None: one cycle.
    """
    if duty is not None:
        order, t = duty.played(t)
        x, where = x[order], where[order]
    return float(longest_run(t, np.abs(x), limit, where))


@kernel
def longest_run(t: np.ndarray, x: np.ndarray, limit: float, where: np.ndarray) -> float:
    """See `longest_above`; two rounds, so that a time that runs on past the end is found whole."""
    n, run, best, above = t.size - 1, 0.0, 0.0, False
    for k in range(t.size):
        above |= where[k] and x[k] > limit
    if not above:
        return 0.0
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
