"""The law of friction for a `Problem`: loads, static limits and sliding friction.

    p = p_0 + P x,     c = constant + sum |p|                               load of an entry
    at rest     -(grip c + forward) <= x <= grip c + backward               (paper eq. 21)
    in motion   x = gain c + offset                                         (paper eq. 20)

x is the entry's part of its coordinate's friction. A contact force is stored as (1 + nx, 3): p_0,
then its change per unit of each friction.
"""

from __future__ import annotations

import numpy as np

from pinfric.friction.problem import Modes, Problem
from pinfric.kernels.compiled import inlined_kernel, kernel


@kernel
def contact_force(contact: np.ndarray, t: int, x: np.ndarray, p: np.ndarray) -> float:
    """Write one contact force p (3,) under x, and return its size."""
    p0, p1, p2 = contact[t, 0, 0], contact[t, 0, 1], contact[t, 0, 2]
    for j in range(x.size):
        p0 += contact[t, 1 + j, 0] * x[j]
        p1 += contact[t, 1 + j, 1] * x[j]
        p2 += contact[t, 1 + j, 2] * x[j]
    p[0], p[1], p[2] = p0, p1, p2
    return np.sqrt(p0 * p0 + p1 * p1 + p2 * p2)


@kernel
def write_loads(
    contact: np.ndarray, owner: np.ndarray, constant: np.ndarray, x: np.ndarray, load: np.ndarray
) -> None:
    """Write the loads c (n,) under friction x.

    Args:
        contact: (nt, 1 + nx, 3).
        owner: (nt,) whose load each force is part of.
        constant: (n,) part of each load that does not change.
        x: (nx,).
        load: (n,), overwritten.
    """
    p = np.empty(3)
    for s in range(load.size):
        load[s] = constant[s]
    for t in range(owner.size):
        load[owner[t]] += contact_force(contact, t, x, p)


@kernel
def write_rates(problem: Problem, x: np.ndarray, rate: np.ndarray) -> None:
    """Write the rates r (nc,) under friction x."""
    for c in range(x.size):
        rate[c] = problem.rate_free[c]
        for d in range(x.size):
            rate[c] += problem.rate_slope[c, d] * x[d]


@kernel
def add_load_slopes(
    contact: np.ndarray, owner: np.ndarray, weight: np.ndarray, x: np.ndarray, slope: np.ndarray
) -> None:
    """Add weight d|p| / dx to each force's owner's row of a slope; a force of zero adds nothing.

    Args:
        contact, owner, x: see `write_loads`.
        weight: (nt,).
        slope: (n, nx).
    """
    p = np.empty(3)
    for t in range(owner.size):
        size = contact_force(contact, t, x, p)
        if size == 0.0:
            continue
        for j in range(x.size):
            along = 0.0
            for e in range(3):
                along += p[e] * contact[t, 1 + j, e]
            slope[owner[t], j] += weight[t] * along / size


@inlined_kernel
def entry_limits(problem: Problem, load: np.ndarray, s: int) -> tuple[float, float]:
    """Return the least and the most that an entry at rest may add to its coordinate's friction."""
    size, grip = abs(problem.ratio[s]), problem.mu_stick[s] * load[s]
    forward, backward = (0, 1) if problem.ratio[s] > 0.0 else (1, 0)
    return (
        -size * (grip + problem.coulomb_stick[s, forward]),
        size * (grip + problem.coulomb_stick[s, backward]),
    )


@kernel
def stick_limits(problem: Problem, load: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    """Write least and greatest static friction (nc,) of each coordinate under loads (ne,)."""
    for c in range(lower.size):
        lower[c] = upper[c] = 0.0
    for s in range(load.size):
        least, greatest = entry_limits(problem, load, s)
        lower[problem.coordinate[s]] += least
        upper[problem.coordinate[s]] += greatest


@inlined_kernel
def sliding(problem: Problem, s: int, direction: float) -> tuple[float, float]:
    """Return gain and offset of an entry whose coordinate slips.

    Args:
        s: the entry.
        direction: of the coordinate's slip, -1 to 1 (between: regularized friction).
    """
    size = abs(problem.ratio[s]) * direction
    against = 0 if problem.ratio[s] * direction > 0.0 else 1
    dry = size * problem.coulomb_slip[s, against]
    return -size * problem.mu_slip[s], -(dry + problem.ratio[s] * problem.drag[s])


@kernel
def slip_law(
    problem: Problem, stuck: np.ndarray, direction: np.ndarray, gain: np.ndarray, offset: np.ndarray
) -> None:
    """Write the laws of slipping coordinates, x = offset + sum of gain load; 0 where one sticks.

    Args:
        stuck: (nc,) bool.
        direction: (nc,) of the slip, see `sliding`.
        gain: (ne,), overwritten.
        offset: (nc,), overwritten.
    """
    for c in range(offset.size):
        offset[c] = 0.0
    for s in range(gain.size):
        c = problem.coordinate[s]
        gain[s] = 0.0
        if not stuck[c]:
            gain[s], part = sliding(problem, s, direction[c])
            offset[c] += part


@kernel
def evaluate(problem: Problem, friction: np.ndarray, load: np.ndarray, rate: np.ndarray) -> None:
    """Write each entry's load (ne,) and each coordinate's rate (nc,) under given friction (nc,)."""
    write_loads(problem.contact, problem.contact_entry, problem.constant, friction, load)
    write_rates(problem, friction, rate)


@kernel
def limit_width(lower: float, upper: float) -> float:
    """Return the scale for rounding of static limits: their width, or the finite limit."""
    width = upper - lower
    return width if width < np.inf else min(abs(lower), abs(upper), 1e300)


@kernel
def entry_friction(
    problem: Problem, modes: Modes, lower: np.ndarray, upper: np.ndarray, phi: np.ndarray
) -> None:
    """Write each entry's friction (ne,); those of a sticking coordinate share it like their limits.

    Args:
        modes: `Modes`, solved.
        lower, upper: (nc,), `stick_limits`.
        phi: (ne,), overwritten.
    """
    stuck, direction, friction, load = modes.stuck, modes.direction, modes.friction, modes.load
    for s in range(phi.size):
        c, ratio = problem.coordinate[s], problem.ratio[s]
        if stuck[c]:
            width = upper[c] - lower[c]
            if not width < np.inf:
                continue
            fraction = (friction[c] - lower[c]) / width if width > 0.0 else 0.5
            least, greatest = entry_limits(problem, load, s)
            phi[s] = (least + fraction * (greatest - least)) / ratio
        else:
            gain, offset = sliding(problem, s, direction[c])
            phi[s] = (gain * load[s] + offset) / ratio
    for c in range(stuck.size):
        if stuck[c] and not upper[c] - lower[c] < np.inf:
            _share_unlimited(problem, friction[c], load, c, phi)


@kernel
def _share_unlimited(
    problem: Problem, friction: float, load: np.ndarray, c: int, phi: np.ndarray
) -> None:
    """Write the friction of the entries of a coordinate at rest of which some have no limit.

    The limited ones get the middle of what the others leave, each unlimited one its least; what
    then remains goes to the last that can take it.
    """
    low = high = beyond_low = beyond_high = 0.0
    for s in range(phi.size):
        if problem.coordinate[s] == c:
            least, greatest = entry_limits(problem, load, s)
            if greatest - least < np.inf:
                low, high = low + least, high + greatest
            else:
                beyond_low, beyond_high = beyond_low + least, beyond_high + greatest
    middle = 0.5 * (max(low, friction - beyond_high) + min(high, friction - beyond_low))
    fraction = (middle - low) / (high - low) if high > low else 0.5
    left = friction - middle
    for spread in (True, False):  # the second time from the last entry on
        for n in range(phi.size):
            s = n if spread else phi.size - 1 - n
            if problem.coordinate[s] != c:
                continue
            least, greatest = entry_limits(problem, load, s)
            had = 0.0 if spread else phi[s] * problem.ratio[s]
            part = min(max(0.0 if spread else had + left, least), greatest)
            if greatest - least < np.inf:
                part = least + fraction * (greatest - least)
            else:
                left -= part - had
            phi[s] = part / problem.ratio[s]
