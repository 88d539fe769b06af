"""Friction where nothing rests and loads clearly contract: one solution, found by Newton's method.

x = offset + sum of gain |p(x)|,     p = p_0 + P x

Contraction, residual and Jacobian are written from the `Problem` itself. `given_modes` has kernels
for them, too, but these take a problem that was reduced first, and the copies cost time.
"""

from __future__ import annotations

import numpy as np

from pinfric.friction.dense import spectral_radius_bound
from pinfric.friction.gears import are_bound, bind, fit, gear_site, write_rows
from pinfric.friction.given_modes import RESIDUAL
from pinfric.friction.law import slip_law, write_rates
from pinfric.friction.modes import Modes
from pinfric.friction.problem import Problem
from pinfric.kernels.compiled import kernel

#: Below this contraction elimination needs no pivots: what is subtracted from 1 stays below it.
_CLEAR = 0.9
#: Gears on a line with a slope below this are left to `given_modes`.
_RISES = 0.02
#: Passes of Newton's method, of which four are usual; `given_modes` takes over after them.
_PASSES = 12


@kernel
def slide(problem: Problem, modes: Modes) -> bool:  # noqa: C901
    """Write the solution in modes in which nothing rests; False: that is left to `given_modes`.

    Newton's method goes over the lines of gears, too, if they rise.

    Args:
        problem: `Problem`.
        modes: `Modes`; its `friction` and `effort` are where the solve starts from.
    """
    x, load, (nc, ns) = modes.friction, modes.load, (modes.friction.size, modes.load.size)
    for c in range(nc):
        if modes.stuck[c] or modes.at_rest[c]:
            return False
    gain, offset, place, nz = np.empty(ns), np.empty(nc), np.full(nc, -1, np.int64), 0
    slip_law(problem, modes.stuck, modes.direction, gain, offset)
    for t in range(problem.contact_site.size):
        s = problem.contact_site[t]
        if gain[s] != 0.0 and place[problem.coordinate[s]] < 0:
            place[problem.coordinate[s]] = nz
            nz += 1
    ng = modes.effort.size
    for g in range(ng):
        c = problem.coordinate[gear_site(problem, g)]
        if place[c] < 0:
            place[c] = nz
            nz += 1
    J, rest = np.empty((nz, nz)), np.empty(nz)
    contraction = _contraction(problem, gain, place, J, rest)
    if nz == 0 or not contraction < _CLEAR:
        return False
    back = lines = rows = J  # not used without gears
    if ng > 0:
        back, lines, rows = J.copy(), np.empty((ng, 4)), np.empty((nc, 3))
    for s in range(ns):
        offset[problem.coordinate[s]] += gain[s] * problem.constant[s]
    started = x[0] == x[0]
    for c in range(nc):
        if place[c] < 0 or not started:
            x[c] = offset[c] if place[c] < 0 else 0.0
    for passes in range(_PASSES):
        error = _residual(problem, gain, offset, place, x, load, J, rest)
        if ng > 0:
            write_rates(problem, modes.friction, modes.rate)
            if passes > 0:
                fit(problem, modes, lines, False)
            write_rows(problem, modes, False, lines, rows)
            if not rows[:, 0].min() > _RISES:
                return False
            error = _with_gears(problem, modes, rows, place, J, rest)
        if error <= RESIDUAL * (8 + nz) and (ng == 0 or fit(problem, modes, lines, False)[0] == 0):
            if ng > 0:
                contraction = _behind_gears(problem, modes, rows, place, back)
                if not contraction < _CLEAR:
                    break
            modes.figures[0], modes.figures[1] = contraction, passes
            modes.verdict[:] = 0
            if ng == 0:
                write_rates(problem, modes.friction, modes.rate)
            return True
        _solve(J, rest)
        for c in range(nc):
            if place[c] >= 0:
                x[c] -= rest[place[c]]
    x[0] = np.nan
    return False


@kernel
def _with_gears(
    problem: Problem,
    modes: Modes,
    rows: np.ndarray,
    place: np.ndarray,
    J: np.ndarray,
    rest: np.ndarray,
) -> float:
    """Turn x - y into a (x - y) + b r - g; return the largest, relative to its terms."""
    worst = 0.0
    for c in range(place.size):
        k, across, along, given = place[c], rows[c, 0], rows[c, 1], rows[c, 2]
        if k < 0:
            continue
        terms = abs(problem.rate_free[c])
        for d in range(place.size):
            terms += abs(problem.rate_slope[c, d] * modes.friction[d])
        terms = abs(across * modes.friction[c]) + abs(along) * terms + abs(given)
        rest[k] = across * rest[k] + along * modes.rate[c] - given
        for d in range(place.size):
            if place[d] >= 0:
                slope = along * problem.rate_slope[c, d]
                J[k, place[d]] = across * J[k, place[d]] + slope
        if not abs(rest[k]) < 1e300:
            return np.inf
        if rest[k] != 0.0:
            worst = max(worst, abs(rest[k]) / terms)
    return worst


@kernel
def _behind_gears(
    problem: Problem, modes: Modes, rows: np.ndarray, place: np.ndarray, back: np.ndarray
) -> float:
    """Bound how much of a change of y comes back: |y'| <= back |dx/dy| |y|."""
    nc, A, X = place.size, np.zeros(back.shape), np.zeros((place.size, 1 + place.size))
    for c in range(nc):
        X[c, 1 + c] = 1.0
    if not bind(problem, are_bound(modes.stuck, rows), rows, X):
        return np.inf
    for j in range(nc):
        for k in range(nc if place[j] >= 0 else 0):
            for i in range(back.shape[0] if place[k] >= 0 else 0):
                A[i, place[k]] += back[i, place[j]] * abs(X[j, 1 + k])
    return spectral_radius_bound(A, np.empty(back.shape[0]))


@kernel
def _contraction(
    problem: Problem, gain: np.ndarray, place: np.ndarray, A: np.ndarray, vector: np.ndarray
) -> float:
    """Bound how much of a change of friction comes back; see `given_modes.contraction_matrix`."""
    A[:] = 0.0
    for t in range(problem.contact_site.size):
        s = problem.contact_site[t]
        for c in range(place.size if gain[s] != 0.0 else 0):
            if place[c] >= 0:
                force = problem.contact[t, 1 + c]
                size = np.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
                A[place[problem.coordinate[s]], place[c]] += abs(gain[s]) * size
    return spectral_radius_bound(A, vector)


@kernel
def _residual(
    problem: Problem,
    gain: np.ndarray,
    offset: np.ndarray,
    place: np.ndarray,
    x: np.ndarray,
    load: np.ndarray,
    J: np.ndarray,
    rest: np.ndarray,
) -> float:
    """Write x - offset - gain |p(x)| (nz,), its Jacobian (nz, nz) and the loads (ns,).

    Returns:
        The largest, relative to the terms it is the sum of.
    """
    contact, size, worst = problem.contact, np.empty(rest.size), 0.0
    J[:], load[:] = 0.0, problem.constant
    for c in range(x.size):
        k = place[c]
        if k >= 0:
            J[k, k], rest[k], size[k] = 1.0, x[c] - offset[c], abs(x[c]) + abs(offset[c])
    for t in range(problem.contact_site.size):
        p, q, r = contact[t, 0, 0], contact[t, 0, 1], contact[t, 0, 2]
        terms = abs(p) + abs(q) + abs(r)
        for c in range(x.size):
            u, v, w = contact[t, 1 + c, 0], contact[t, 1 + c, 1], contact[t, 1 + c, 2]
            p, q, r = p + u * x[c], q + v * x[c], r + w * x[c]
            terms += (abs(u) + abs(v) + abs(w)) * abs(x[c])
        s, length = problem.contact_site[t], np.sqrt(p * p + q * q + r * r)
        load[s] += length
        if gain[s] == 0.0:
            continue
        k = place[problem.coordinate[s]]
        rest[k] -= gain[s] * length
        size[k] += abs(gain[s]) * terms
        for c in range(x.size if length > 0.0 else 0):
            if place[c] >= 0:
                along = p * contact[t, 1 + c, 0] + q * contact[t, 1 + c, 1]
                along += r * contact[t, 1 + c, 2]
                J[k, place[c]] -= gain[s] * along / length
    for k in range(rest.size):
        if not abs(rest[k]) < 1e300:
            return np.inf
        if rest[k] != 0.0:
            worst = max(worst, abs(rest[k]) / size[k])
    return worst


@kernel
def _solve(A: np.ndarray, b: np.ndarray) -> None:
    """Overwrite b (n,) with A^-1 b by elimination without pivots; A is lost.

    With `solve_dense` in its place a state takes 3 % longer.
    """
    n = b.size
    for k in range(n):
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= factor * A[k, j]
            b[i] -= factor * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= A[k, j] * b[j]
        b[k] /= A[k, k]
