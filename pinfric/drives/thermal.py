"""Winding temperature of a motor over a cycle that repeats for ever: two nodes, exact in time.

    C_w dT_w/dt = R (1 + alpha (T_w - T_ref)) i^2 - (T_w - T_h)/R_wh
    C_h dT_h/dt = (T_w - T_h)/R_wh - (T_h - T_a)/R_ha + P_0

with C_w = tau_w/R_wh and C_h = tau_h/R_ha (maxon, Key information: thermal behaviour). P_0 is what
turning costs (iron and friction; `no_load_heat`). Left out: the torque constant falls with the
magnets' temperature; a stalled motor has hot spots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.drives.duty import Schedule, once
from pinfric.drives.policy import REFERENCE_TEMPERATURE
from pinfric.kernels.compiled import kernel
from pinfric.model.entry import Entry, Number, Positive, key, optional

#: Rise of copper's resistance with temperature, 1/K, at the reference temperature.
COPPER = 0.0039


class Thermal(Entry):
    """Two-node model of a motor: winding and housing."""

    winding_housing: Positive = key("thermal resistance between winding and housing", 1.2, "K/W")
    housing_ambient: Positive = key("between housing and surroundings", 3.0, "K/W")
    winding_time: Positive | None = optional("time constant of the winding", 30.0, "s")
    housing_time: Positive | None = optional("of the motor", 900.0, "s")
    max_winding: Number | None = optional(
        "highest permissible temperature of the winding", 155.0, "deg C"
    )


@dataclass(frozen=True)
class WindingCycle:
    """Periodic steady state of winding and housing.

    Attributes:
        winding, housing: (T,) deg C, the highest of a cycle's repetitions; infinite where the loss
            outgrows the cooling (run-away).
        runaway: no steady state exists: each repetition ends hotter than it began.
    """

    winding: np.ndarray
    housing: np.ndarray
    runaway: bool

    @property
    def peak(self) -> float:
        """The winding's highest temperature, deg C."""
        return float(self.winding.max())


def winding_cycle(
    t: np.ndarray,
    current: np.ndarray,
    resistance: float,
    thermal: Thermal,
    ambient: float,
    duty: Schedule | None = None,
    no_load: np.ndarray | None = None,
) -> WindingCycle:
    """Return the temperatures that a repeated cycle settles to.

    Between samples i^2 is its mean, |i| linear in time (between two worst cases of opposite sign
    the motor does not rest). So the equations are linear with constant coefficients and are stepped
    by their matrix exponential; one cycle is an affine map x -> Phi x + g, and the settled one
    begins at (I - Phi)^-1 g.

    Args:
        t: (T,) s; the last sample is the first of the next repetition.
        current: (T,) A; its sign does not matter.
        resistance: ohm at 25 C.
        thermal: with both time constants.
        ambient: deg C.
        duty: the cycles of a period; None: one cycle.
        no_load: (T,) P_0, W; None: nothing.

    Raises:
        ValueError: `thermal` has no time constants, or there is one sample only.
    """
    if thermal.winding_time is None or thermal.housing_time is None:
        raise ValueError("a temperature over time needs both time constants")
    if len(t) < 2:
        raise ValueError("a cycle needs two samples")
    nodes = np.array(
        [
            thermal.winding_housing,
            thermal.housing_ambient,
            thermal.winding_time,
            thermal.housing_time,
        ]
    )
    schedule = duty or once(len(t))
    turning = np.zeros(len(t)) if no_load is None else no_load
    rise, runaway = winding_rises(
        t, current, turning, resistance, nodes, ambient, np.array(schedule.starts), schedule.counts
    )
    return WindingCycle(ambient + rise[:, 0], ambient + rise[:, 1], bool(runaway))


@kernel
def winding_rises(
    t: np.ndarray,
    current: np.ndarray,
    no_load: np.ndarray,
    resistance: float,
    nodes: np.ndarray,
    ambient: float,
    starts: np.ndarray,
    counts: np.ndarray,
) -> tuple[np.ndarray, bool]:
    """Return the rises above ambient (T, 2) of `winding_cycle`, and whether they run away.

    Args:
        nodes: (4,) thermal resistances, then time constants, of the winding and of the housing.
        starts, counts: (K + 1,), (K,) of the cycles: first samples, and how often each is run.
    """
    capacity, conductance = nodes[2:] / nodes[:2], 1.0 / nodes[:2]
    heat, between, step = np.empty((3, t.size - 1))
    for k in range(t.size - 1):
        a, b = abs(current[k]), abs(current[k + 1])
        heat[k] = resistance * ((a * a + a * b + b * b) / 3)  # mean of i^2, |i| linear
        between[k] = 0.5 * (no_load[k] + no_load[k + 1])
        step[k] = t[k + 1] - t[k]
    warm = 1.0 + COPPER * (ambient - REFERENCE_TEMPERATURE)
    maps = _maps(step, heat, between, warm, COPPER, capacity, conductance)
    rise, runaway = settled(maps, starts, counts)
    if runaway:
        rise[:] = np.inf
    return rise, runaway


def mean_winding_temperature(
    t: np.ndarray,
    current: np.ndarray,
    resistance: float,
    thermal: Thermal,
    ambient: float,
    no_load: float = 0.0,
) -> float:
    """Return the winding's temperature at the cycle's mean heat, deg C: a floor of its peak.

    T_w = T_a + (r P (1 + alpha (T_a - T_ref)) + R_ha P_0)/(1 - alpha r P) with r = R_wh + R_ha and
    P = R <i^2>; infinite where alpha r P >= 1. For motors whose time constants are not known.

    Args: as `winding_cycle`; no_load: the mean of P_0, W.
    """
    nodes = np.array([thermal.winding_housing, thermal.housing_ambient])
    return float(mean_temperature(t, current, resistance, nodes, ambient, no_load))


@kernel
def mean_temperature(
    t: np.ndarray,
    current: np.ndarray,
    resistance: float,
    nodes: np.ndarray,
    ambient: float,
    no_load: float,
) -> float:
    """See `mean_winding_temperature`; `nodes`: as of `winding_rises`."""
    gain = (nodes[0] + nodes[1]) * (resistance * _mean_square_over(t, np.abs(current)))
    if COPPER * gain >= 1.0:
        return np.inf
    warm = 1.0 + COPPER * (ambient - REFERENCE_TEMPERATURE)
    return ambient + (gain * warm + nodes[1] * no_load) / (1.0 - COPPER * gain)


def no_load_heat(
    thermal: Thermal | None, current: float, resistance: float, speed: float, ambient: float
) -> float:
    """Return P_0/omega, W s/rad, by which a motor's nominal point heats it just to its limit.

    T_max - T_a = r R (1 + alpha (T_max - T_ref)) i^2 + R_ha P_0. So the maker's continuous torque
    is that at the nominal speed, and slower it may carry more. 0 where the limit is not known, or
    copper alone heats it more.

    Args:
        thermal: with its limit, or None. current, resistance: at the nominal point, A; ohm at 25 C.
        speed: nominal, rad/s. ambient: to which the nominal torque refers, deg C.
    """
    if thermal is None or thermal.max_winding is None:
        return 0.0
    hot = resistance * (1 + COPPER * (thermal.max_winding - REFERENCE_TEMPERATURE))
    by_copper = (thermal.winding_housing + thermal.housing_ambient) * hot * current**2
    by_turning = thermal.max_winding - ambient - by_copper
    return max(by_turning, 0.0) / thermal.housing_ambient / speed


@kernel
def _mean_square_over(t: np.ndarray, x: np.ndarray) -> float:
    """Return the mean of x^2 over time, x linear between samples; in one pass, for long motions."""
    total = 0.0
    for k in range(t.size - 1):
        a, b = x[k], x[k + 1]
        total += (t[k + 1] - t[k]) * (a * a + a * b + b * b) / 3
    return total / (t[-1] - t[0])


@kernel
def _maps(
    step: np.ndarray,
    heat: np.ndarray,
    no_load: np.ndarray,
    warm: float,
    copper: float,
    capacity: np.ndarray,
    conductance: np.ndarray,
) -> np.ndarray:
    """Return (T-1, 6) of each interval the map of rises above ambient: Phi by rows, then g."""
    maps = np.empty((step.size, 6))
    for k in range(step.size):
        a00 = (copper * heat[k] - conductance[0]) / capacity[0]
        a01 = conductance[0] / capacity[0]
        a10 = conductance[0] / capacity[1]
        a11 = -(conductance[0] + conductance[1]) / capacity[1]
        b0, b1 = heat[k] * warm / capacity[0], no_load[k] / capacity[1]
        middle, half = 0.5 * (a00 + a11), 0.5 * (a00 - a11)
        root = np.sqrt(half * half + a01 * a10)  # > 0: the eigenvalues are real and distinct
        fast, slow = middle - root, middle + root
        d_fast, d_slow = np.expm1(fast * step[k]), np.expm1(slow * step[k])
        e_fast = 1.0 + d_fast
        i_fast = d_fast / fast if fast != 0.0 else step[k]
        i_slow = d_slow / slow if slow != 0.0 else step[k]
        # exp(A h) = e_slow P + e_fast (I - P), P = (A - fast I)/(slow - fast)
        q00, q01 = (a00 - fast) / (slow - fast), a01 / (slow - fast)
        q10, q11 = a10 / (slow - fast), (a11 - fast) / (slow - fast)
        de, di = d_slow - d_fast, i_slow - i_fast
        maps[k] = (
            e_fast + de * q00,
            de * q01,
            de * q10,
            e_fast + de * q11,
            (i_fast + di * q00) * b0 + di * q01 * b1,
            di * q10 * b0 + (i_fast + di * q11) * b1,
        )
    return maps


@kernel
def settled(maps: np.ndarray, starts: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return what two nodes reach in a period that repeats: rises, runaway.

    The largest rise of each at each sample, (T, 2); and whether they run away (no fixed point: the
    others are 0).

    Args:
        maps: (T - 1, 6) what each interval does to the rises, x -> Phi x + g: Phi by rows, then g.
        starts, counts: (K + 1,), (K,) of the cycles: first samples, and how often each is run.
    """
    p00, p01, p10, p11, g0, g1 = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0
    for part in range(counts.size):
        for _ in range(counts[part]):
            for k in range(starts[part], starts[part + 1] - 1):
                m00, m01, m10, m11, c0, c1 = maps[k]
                p00, p10 = m00 * p00 + m01 * p10, m10 * p00 + m11 * p10
                p01, p11 = m00 * p01 + m01 * p11, m10 * p01 + m11 * p11
                g0, g1 = m00 * g0 + m01 * g1 + c0, m10 * g0 + m11 * g1 + c1
    # all entries of Phi are positive: its spectral radius is below 1 exactly if I - Phi has
    # positive leading minors (an M-matrix)
    determinant = (1 - p00) * (1 - p11) - p01 * p10
    rise = np.zeros((starts[-1], 2))
    if not (p00 < 1.0 and determinant > 0.0):
        return rise, True
    x0 = ((1 - p11) * g0 + p01 * g1) / determinant
    x1 = (p10 * g0 + (1 - p00) * g1) / determinant
    for part in range(counts.size):
        for _ in range(counts[part]):
            for k in range(starts[part], starts[part + 1]):
                if k > starts[part]:
                    m00, m01, m10, m11, c0, c1 = maps[k - 1]
                    x0, x1 = m00 * x0 + m01 * x1 + c0, m10 * x0 + m11 * x1 + c1
                rise[k, 0], rise[k, 1] = max(rise[k, 0], x0), max(rise[k, 1], x1)
    return rise, False
