"""Friction and loads that depend on each other, in given modes: the kernels that solve a `Problem`.

The unknown is the friction z of the slipping coordinates whose loads depend on it: z = G(z). It is
solved by the fixed-point iteration while this is fast (the paper), then by a semi-smooth Newton
method. Below 1 the `contraction`, a bound of the spectral radius of A_kj = gain Lip(load along
z_j), certifies that there is exactly one solution; otherwise others are searched for. `slide`
solves the `Problem` without a reduction where nothing rests and the bound is clearly below 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.dense import largest, solve_dense, spectral_radius_bound
from pinfric.friction.gears import (
    MOST_PASSES,
    are_bound,
    bind,
    choose_lines,
    fit,
    fit_within,
    gear_entry,
    turn_gears,
    write_rows_within,
)
from pinfric.friction.law import (
    evaluate,
    limit_width,
    slip_law,
    stick_limits,
    write_rates,
)
from pinfric.friction.problem import Modes, Problem
from pinfric.kernels.compiled import kernel, late_kernel

#: A residual below this many times the size of the terms it is the difference of is rounding.
RESIDUAL = 1e-15
#: What Newton must reach to have found a solution, for each term of a residual.
_FOUND = 1e-13
#: A fixed-point pass that leaves more of the residual than this is slower than Newton's.
_FAST = 1e-3
#: Passes of Newton; fixed-point passes where the contraction is certain but Newton cycles.
_NEWTON_PASSES, _FIXED_POINT_PASSES = 60, 5000
#: Two solutions closer than this, relative to their size, are one; a z with a larger error is none
#: that rounding lets us know.
_DISTINCT = 1e-6
#: So far below a contraction of 1 a small residual proves a small error: |residual| / (1 - it).
_CERTAIN = 1e-6
#: Room for the solutions of given modes; a four-bar's four pins can have three.
MOST_SOLUTIONS = 8


class Reduced(NamedTuple):
    """A `Problem` in given modes, reduced to the friction z of which the loads are functions.

        z_k = offset_k + sum over its contacts of gain |p|,    x = X (1, z),    p = contact (1, z)

    Attributes:
        unknown: (nc,) int: place of each coordinate in z, or -1.
        X: (nc, 1 + nz).
        offset: (nz,).
        place, gain: (n,) of each contact force: the place in z of its friction, and the
            coefficient.
        contact: (n, 1 + nz, 3).
    """

    unknown: np.ndarray
    X: np.ndarray
    offset: np.ndarray
    place: np.ndarray
    gain: np.ndarray
    contact: np.ndarray


@kernel
def reduce_problem(
    problem: Problem, stuck: np.ndarray, direction: np.ndarray, rows: np.ndarray
) -> tuple[int, Reduced]:
    """Return the length of z and the problem in it; -1: what sticks and gears make it singular.

    Sticking coordinates are eliminated by r = 0, gears on their lines by theirs, slipping
    coordinates whose load is constant by their law.

    Args:
        problem, stuck, direction: see `slip_law`.
        rows: (nc, 3), `gears.write_rows`; (0, 3) without gears.
    """
    nc, ne = stuck.size, problem.constant.size
    law, entry_gain, unknown = np.empty(nc), np.empty(ne), np.empty(nc, np.int64)
    slip_law(problem, stuck, direction, entry_gain, law)
    nz = count = 0
    for c in range(nc):
        unknown[c] = -1
    bound = are_bound(stuck, rows)
    for t in range(problem.contact_entry.size):
        s = problem.contact_entry[t]
        c = problem.coordinate[s]
        if entry_gain[s] != 0.0:
            count += 1
            if unknown[c] < 0:
                unknown[c] = nz
                nz += 1
    for s in range(ne):
        law[problem.coordinate[s]] += entry_gain[s] * problem.constant[s]
    X, offset = np.zeros((nc, 1 + nz)), np.empty(nz)
    for c in range(nc):
        if unknown[c] >= 0:
            X[c, 1 + unknown[c]], offset[unknown[c]] = 1.0, law[c]
        elif not stuck[c]:
            X[c, 0] = law[c]
    place, gain, contact = np.empty(count, np.int64), np.empty(count), np.zeros((count, 1 + nz, 3))
    reduced = Reduced(unknown, X, offset, place, gain, contact)
    binds = False
    for c in range(nc):
        binds |= bound[c]
    if binds and not bind(problem, bound, rows, X):
        return -1, reduced
    _reduce_contacts(problem, bound, entry_gain, reduced)
    return nz, reduced


@kernel
def _reduce_contacts(
    problem: Problem, bound: np.ndarray, entry_gain: np.ndarray, reduced: Reduced
) -> None:
    """Write `place`, `gain` and `contact` of a reduced problem."""
    unknown, X, _, place, gain, contact = reduced
    columns, n = contact.shape[1], 0
    for t in range(problem.contact_entry.size):
        s = problem.contact_entry[t]
        if entry_gain[s] == 0.0:
            continue
        place[n], gain[n] = unknown[problem.coordinate[s]], entry_gain[s]
        for e in range(3):
            contact[n, 0, e] = problem.contact[t, 0, e]
        for c in range(unknown.size):
            # what slips without a gear is a number or one of z
            first, last = (0, columns) if bound[c] else (1 + unknown[c], 2 + unknown[c])
            for j in range(first, last):
                for e in range(3):
                    contact[n, j, e] += X[c, j] * problem.contact[t, 1 + c, e]
        n += 1


@kernel
def write_residual(
    reduced: Reduced,
    z: np.ndarray,
    residual: np.ndarray,
    J: np.ndarray,
    length: np.ndarray,
) -> float:
    """Write z - offset - gain |p(z)| (nz,), its Jacobian (nz, nz) and the |p| (n,).

    Return the largest residual, relative to the terms it is the sum of.
    """
    _, _, offset, place, gain, contact = reduced
    size, worst = np.empty(z.size), 0.0
    J[:] = 0.0
    for k in range(z.size):
        J[k, k], residual[k], size[k] = 1.0, z[k] - offset[k], abs(z[k]) + abs(offset[k])
    for t in range(gain.size):
        p, q, r = contact[t, 0, 0], contact[t, 0, 1], contact[t, 0, 2]
        terms = abs(p) + abs(q) + abs(r)
        for j in range(z.size):
            u, v, w = contact[t, 1 + j, 0], contact[t, 1 + j, 1], contact[t, 1 + j, 2]
            p, q, r = p + u * z[j], q + v * z[j], r + w * z[j]
            terms += (abs(u) + abs(v) + abs(w)) * abs(z[j])
        k, length[t] = place[t], np.sqrt(p * p + q * q + r * r)
        if gain[t] == 0.0:
            continue
        residual[k] -= gain[t] * length[t]
        size[k] += abs(gain[t]) * terms
        for j in range(z.size if length[t] > 0.0 else 0):
            along = p * contact[t, 1 + j, 0] + q * contact[t, 1 + j, 1]
            along += r * contact[t, 1 + j, 2]
            J[k, j] -= gain[t] * along / length[t]
    for k in range(z.size):
        if not abs(residual[k]) < 1e300:
            return np.inf
        if residual[k] != 0.0:
            worst = max(worst, abs(residual[k]) / size[k])
    return worst


@kernel
def newton(reduced: Reduced, z: np.ndarray, fast: bool) -> tuple[float, int]:
    """Solve z = offset + gain load(z) from the given z: fixed point while fast, then Newton.

    Args:
        z: (nz,), overwritten.
        fast: False leaves the fixed point out: it can jump from one solution to another.

    Returns:
        (the relative residual reached, passes).
    """
    nz = z.size
    residual, J, length = np.empty(nz), np.empty((nz, nz)), np.empty(reduced.gain.size)
    tolerance = RESIDUAL * (8 + nz)
    error = write_residual(reduced, z, residual, J, length)
    if error <= tolerance:
        return error, 0
    trial_residual, trial, step = np.empty(nz), np.empty(nz), np.empty((nz, 1))
    # steps are judged by the residual itself: relative to its terms it is no smaller far out
    most = largest(residual)
    for passes in range(_NEWTON_PASSES):
        if error <= tolerance or not error < np.inf:
            return error, passes
        if not fast:
            write_residual(reduced, z, residual, J, length)
        for k in range(nz):
            step[k, 0] = residual[k]
        if not fast and not solve_dense(J, step):
            return error, passes
        damping, new, trial_most = 1.0, np.inf, np.inf
        for _ in range(30):
            for k in range(nz):
                trial[k] = z[k] - damping * step[k, 0]
            new = write_residual(reduced, trial, trial_residual, J, length)
            trial_most = largest(trial_residual)
            if fast or trial_most < most or new <= tolerance:
                break
            damping *= 0.5
        better = trial_most < most or new <= tolerance
        if fast and not trial_most < _FAST * most:
            fast = False
            if not better:
                continue  # a pass that leads away is not taken
        elif not better:
            return error, passes + 1  # no way down: rounding, or no solution near
        for k in range(nz):
            z[k], residual[k] = trial[k], trial_residual[k]
        error, most = new, trial_most
    return error, _NEWTON_PASSES


@kernel
def fixed_point(reduced: Reduced, z: np.ndarray, tolerance: float) -> int:
    """Iterate z = offset + gain load(z), certain to converge below contraction 1; return passes."""
    nz = z.size
    residual, J, length = np.empty(nz), np.empty((nz, nz)), np.empty(reduced.gain.size)
    for passes in range(_FIXED_POINT_PASSES):
        if write_residual(reduced, z, residual, J, length) <= tolerance:
            return passes
        for k in range(nz):
            z[k] -= residual[k]
    return _FIXED_POINT_PASSES


@kernel
def settles(reduced: Reduced, z: np.ndarray) -> bool:
    """Refine a z (nz,) of small residual by Newton; return whether it is known to be a solution.

    Its error |J^-1| (|residual| + rounding) must be small: where the contraction is 1, a small
    residual far out proves nothing.
    """
    _, _, offset, _, gain, contact = reduced
    nz = z.size
    residual, J, length = np.empty(nz), np.empty((nz, nz)), np.empty(gain.size)
    inverse = np.empty((nz, nz))
    for _ in range(3):
        write_residual(reduced, z, residual, J, length)
        for i in range(nz):
            for j in range(nz):
                inverse[i, j] = 1.0 if i == j else 0.0
        if not solve_dense(J, inverse):
            return False
        size = largest(z) + largest(offset)
        for t in range(gain.size):
            force = abs(contact[t, 0, 0]) + abs(contact[t, 0, 1]) + abs(contact[t, 0, 2])
            size = max(size, abs(gain[t]) * force)
        error = 0.0
        for i in range(nz):
            step, bound = 0.0, 0.0
            for j in range(nz):
                step += inverse[i, j] * residual[j]
                bound += abs(inverse[i, j]) * (abs(residual[j]) + RESIDUAL * size)
            z[i] -= step
            error = max(error, bound)
        if error <= _DISTINCT * size:
            return True
    return False


@kernel
def contraction_matrix(reduced: Reduced, A: np.ndarray) -> None:
    """Write A_kj = sum |gain| Lip(load along z_j): |G(z) - G(z')| <= A |z - z'|."""
    _, _, _, place, gain, contact = reduced
    A[:] = 0.0
    for t in range(gain.size):
        for j in range(A.shape[0]):
            x, y, z = contact[t, 1 + j, 0], contact[t, 1 + j, 1], contact[t, 1 + j, 2]
            A[place[t], j] += abs(gain[t]) * np.sqrt(x * x + y * y + z * z)


@kernel
def keep(X: np.ndarray, z: np.ndarray, solutions: np.ndarray, found: int) -> int:
    """Append x = X (1, z) to the solutions unless it is there already; return their number."""
    nc = X.shape[0]
    if found == solutions.shape[0]:
        return found
    x = solutions[found]
    for c in range(nc):
        x[c] = X[c, 0]
        for j in range(z.size):
            x[c] += X[c, 1 + j] * z[j]
    for other in range(found):
        size, difference = 0.0, 0.0
        for c in range(nc):
            difference = max(difference, abs(x[c] - solutions[other, c]))
            size = max(size, abs(x[c]), abs(solutions[other, c]))
        if difference <= _DISTINCT * size:
            return found
    return found + 1


@kernel
def solve_given_modes(
    problem: Problem,
    stuck: np.ndarray,
    direction: np.ndarray,
    rows: np.ndarray,
    guess: np.ndarray,
    solutions: np.ndarray,
    figures: np.ndarray,
) -> int:
    """Find the friction in given modes and lines; several solutions if contraction allows them.

    Args:
        stuck, direction, rows: see `reduce_problem`.
        guess: (nc,) friction of bearings to start from; NaN in the first place: none.
        solutions: (MOST_SOLUTIONS, nc), overwritten.
        figures: (2,), overwritten: contraction, passes.

    Returns:
        Number of solutions; -1 if rounding hides the certain one.
    """
    figures[0] = figures[1] = 0.0
    nz, reduced = reduce_problem(problem, stuck, direction, rows)
    if nz < 0:
        return 0
    if nz == 0:
        for c in range(stuck.size):
            solutions[0, c] = reduced.X[c, 0]
        return 1
    A, perron = np.empty((nz, nz)), np.empty(nz)
    contraction_matrix(reduced, A)
    figures[0] = spectral_radius_bound(A, perron)
    tolerance = _FOUND * (8 + nz)
    z = np.zeros(nz)
    if guess[0] == guess[0]:
        for c in range(guess.size):
            if reduced.unknown[c] >= 0:
                z[reduced.unknown[c]] = guess[c]
    error, passes = newton(reduced, z, figures[0] < 1.0)
    figures[1] = passes
    if figures[0] >= 1.0:
        return _search(reduced, direction, z, error <= tolerance, perron, solutions, figures)
    if not error <= tolerance:
        passes = fixed_point(reduced, z, tolerance)
        figures[1] += passes
        if passes == _FIXED_POINT_PASSES:
            return -1
    if figures[0] > 1.0 - _CERTAIN and not settles(reduced, z):
        return -1
    return keep(reduced.X, z, solutions, 0)


@kernel
def _search(
    reduced: Reduced,
    direction: np.ndarray,
    z: np.ndarray,
    small: bool,
    perron: np.ndarray,
    solutions: np.ndarray,
    figures: np.ndarray,
) -> int:
    """Search for solutions from zero and from far out; return how many there are.

    Args:
        direction: see `slip_law`. z: (nz,) where Newton has come to, overwritten.
        small: whether the residual there is small.
        perron: (nz,) eigenvector of the contraction's matrix.
        solutions, figures: see `solve_given_modes`.
    """
    unknown, X, _, _, gain, contact = reduced
    nz, tolerance, far, most, found = z.size, _FOUND * (8 + z.size), 1.0, 1.0, 0
    if small and settles(reduced, z):
        found = keep(X, z, solutions, found)
    for t in range(contact.shape[0]):
        most = max(most, abs(gain[t]))
        for e in range(3):
            far = max(far, abs(contact[t, 0, e]))
    for start in range(nz + 2):
        for c in range(unknown.size):
            k = unknown[c]
            if k >= 0:
                weight = start * perron[k] if start < 2 else 1.0 if k == start - 2 else 0.0
                z[k] = -direction[c] * 1e4 * far * most * weight
        error, passes = newton(reduced, z, False)
        figures[1] += passes
        if error <= tolerance and settles(reduced, z):
            found = keep(X, z, solutions, found)
    # a solution between two others may be reached from no start far out
    for one in range(found):
        for other in range(one):
            for c in range(unknown.size):
                if unknown[c] >= 0:
                    z[unknown[c]] = 0.5 * (solutions[one, c] + solutions[other, c])
            error, passes = newton(reduced, z, False)
            figures[1] += passes
            if error <= tolerance and settles(reduced, z):
                found = keep(X, z, solutions, found)
    return found


#: Below this contraction elimination needs no pivots: what is subtracted from 1 stays below it.
_CLEAR = 0.9
#: Gears on a line with a slope below this are left to `given_modes`.
_RISES = 0.02
#: Passes of Newton's method, of which four are usual; `given_modes` takes over after them.
_PASSES = 12


@kernel
def slide(problem: Problem, modes: Modes) -> bool:
    """Write the solution in modes in which nothing rests, see the module's text; False: not solved.

    Newton's method goes over the lines of gears, too, if they rise.

    Args:
        modes: `Modes`; the solve starts from its `friction` and `effort`.
    """
    return _slide_along(problem, modes) if modes.effort.size > 0 else _slide(problem, modes, None)


@late_kernel("gears")
def _slide_along(problem: Problem, modes: Modes) -> bool:
    """`slide` with gears on lines."""
    return _slide(problem, modes, np.empty((modes.effort.size, 4)))


@kernel
def _slide(problem: Problem, modes: Modes, lines: np.ndarray | None) -> bool:  # noqa: C901
    """`slide`; numba leaves out what belongs to gears where lines (ng, 4) are None."""
    x, load, (nc, ne) = modes.friction, modes.load, (modes.friction.size, modes.load.size)
    for c in range(nc):
        if modes.stuck[c] or modes.at_rest[c]:
            return False
    law, offset, unknown, nz = np.empty(ne), np.empty(nc), np.empty(nc, np.int64), 0
    for c in range(nc):
        unknown[c] = -1
    slip_law(problem, modes.stuck, modes.direction, law, offset)
    contact, nt, ng = problem.contact, problem.contact_entry.size, modes.effort.size
    place, gain, length = np.empty(nt, np.int64), np.empty(nt), np.empty(nt)
    for t in range(nt):
        s = problem.contact_entry[t]
        place[t], gain[t] = problem.coordinate[s], law[s]
        if gain[t] != 0.0 and unknown[place[t]] < 0:
            unknown[place[t]] = nz
            nz += 1
    if lines is not None:
        for g in range(ng):
            c = problem.coordinate[gear_entry(problem, g)]
            if unknown[c] < 0:
                unknown[c] = nz
                nz += 1
    back, J, residual = np.empty((nz, nz)), np.empty((nc, nc)), np.empty(nc)
    contraction = _contraction(contact, place, gain, unknown, back)
    if nz == 0 or not contraction < _CLEAR:
        return False
    rows = J if lines is None else np.empty((nc, 3))  # not used without gears
    for s in range(ne):
        offset[problem.coordinate[s]] += law[s] * problem.constant[s]
    started = x[0] == x[0]
    for c in range(nc):
        if unknown[c] < 0 or not started:
            x[c] = offset[c] if unknown[c] < 0 else 0.0
    reduced = Reduced(unknown, J, offset, place, gain, contact)  # z is x: X is not read
    for passes in range(_PASSES):
        error = write_residual(reduced, x, residual, J, length)
        for s in range(ne):
            load[s] = problem.constant[s]
        for t in range(nt):
            load[problem.contact_entry[t]] += length[t]
        if lines is not None:
            write_rates(problem, x, modes.rate)
            if passes > 0:
                fit_within(problem, modes, lines, False)
            write_rows_within(problem, modes, lines, rows)
            if not rows[:, 0].min() > _RISES:
                return False
            error = _with_gears(problem, modes, rows, J, residual)
        solved = error <= RESIDUAL * (8 + nz)
        if lines is not None:
            solved = solved and fit(problem, modes, lines, False)[0] == 0
        if solved:
            if lines is not None:
                contraction = _behind_gears(problem, modes, rows, unknown, back)
                if not contraction < _CLEAR:
                    break
            modes.figures[0], modes.figures[1] = contraction, passes
            modes.verdict[:] = 0
            if lines is None:
                write_rates(problem, x, modes.rate)
            return True
        _eliminate(J, residual)
        for c in range(nc):
            x[c] -= residual[c]
    x[0] = np.nan
    return False


@kernel
def _with_gears(
    problem: Problem, modes: Modes, rows: np.ndarray, J: np.ndarray, residual: np.ndarray
) -> float:
    """Turn x - y into a (x - y) + b r - g; return the largest, relative to its terms."""
    worst = 0.0
    for c in range(residual.size):
        across, along, given = rows[c, 0], rows[c, 1], rows[c, 2]
        terms = abs(problem.rate_free[c])
        for d in range(residual.size):
            terms += abs(problem.rate_slope[c, d] * modes.friction[d])
            J[c, d] = across * J[c, d] + along * problem.rate_slope[c, d]
        terms = abs(across * modes.friction[c]) + abs(along) * terms + abs(given)
        residual[c] = across * residual[c] + along * modes.rate[c] - given
        if not abs(residual[c]) < 1e300:
            return np.inf
        if residual[c] != 0.0:
            worst = max(worst, abs(residual[c]) / terms)
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
    contact: np.ndarray, place: np.ndarray, gain: np.ndarray, unknown: np.ndarray, A: np.ndarray
) -> float:
    """Bound how much of a change of friction comes back; see `contraction_matrix`."""
    A[:] = 0.0
    for t in range(gain.size):
        for c in range(unknown.size if gain[t] != 0.0 else 0):
            if unknown[c] >= 0:
                x, y, z = contact[t, 1 + c, 0], contact[t, 1 + c, 1], contact[t, 1 + c, 2]
                A[unknown[place[t]], unknown[c]] += abs(gain[t]) * np.sqrt(x * x + y * y + z * z)
    return spectral_radius_bound(A, np.empty(A.shape[0]))


@kernel
def _eliminate(A: np.ndarray, b: np.ndarray) -> None:
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


#: How far beyond its law a sticking or slipping coordinate may be, relative to the terms: rounding.
ROUNDING = 1e-11
#: `judge`'s verdict on a slipping coordinate that moves against its direction.
SHOULD_STICK = 2


@kernel
def judge(problem: Problem, modes: Modes) -> int:
    """Write how each coordinate violates its law; return the number that do.

    What sticks stays within its static limits (paper eq. 21), what starts from rest moves against
    its friction (eq. 20).

    Args:
        modes: `Modes`, solved; its `verdict` is overwritten.
    """
    resting = 0
    for c in range(modes.stuck.size):
        modes.verdict[c] = 0
        resting += modes.at_rest[c]
    return _judge_resting(problem, modes) if resting > 0 else 0


@kernel
def _judge_resting(problem: Problem, modes: Modes) -> int:
    """`judge` where joints rest."""
    nc, verdict, wrong = modes.stuck.size, modes.verdict, 0
    lower, upper = np.empty(nc), np.empty(nc)
    stick_limits(problem, modes.load, lower, upper)
    for c in range(nc):
        if not modes.at_rest[c]:
            continue
        x, terms = modes.friction[c], problem.rate_scale[c]
        for d in range(nc):
            terms += abs(problem.rate_slope[c, d] * modes.friction[d])
        if modes.stuck[c]:
            slack = ROUNDING * (limit_width(lower[c], upper[c]) + terms / problem.rate_slope[c, c])
            if x < lower[c] - slack:
                verdict[c] = 1
            elif not x <= upper[c] + slack:  # nor does what is not a number obey
                verdict[c] = -1
        elif not modes.direction[c] * modes.rate[c] >= -ROUNDING * terms:
            verdict[c] = SHOULD_STICK
        wrong += verdict[c] != 0
    if problem.gear_rotor.shape[0] > 0:
        turn_gears(problem, modes)
    return wrong


@kernel
def try_modes(problem: Problem, modes: Modes, chosen: bool) -> tuple[int, int]:
    """Solve given modes and judge the solutions; write the first that obeys, else the first.

    Every gear in motion is on the line that fits, by Newton's method over the lines.

    Args:
        modes: see `slide`.
        chosen: whether gears in motion keep their lines instead.

    Returns:
        (number of solutions or -1, how many of them obey), see `solve_given_modes`.
    """
    if not chosen and slide(problem, modes):
        return 1, 1
    nc, ng = modes.stuck.size, modes.effort.size
    friction, guess, solutions = modes.friction, modes.friction, np.empty((MOST_SOLUTIONS, nc))
    lines, rows = np.empty((ng, 4)), np.empty((nc if ng > 0 else 0, 3))
    for passes in range(MOST_PASSES):
        if ng > 0:
            guess = np.empty(nc)
            choose_lines(problem, modes, guess, lines, rows, passes == 0 and not chosen)
        found = solve_given_modes(
            problem, modes.stuck, modes.direction, rows, guess, solutions, modes.figures
        )
        first, obeying, wrong, there = -1, 0, 0, 0
        for i in range(found - 1, -1, -1):
            for c in range(nc):
                friction[c] = solutions[i, c]
            evaluate(problem, friction, modes.load, modes.rate)
            left, changed = fit(problem, modes, lines, True) if ng > 0 else (0, 0)
            if left > 0 and chosen:
                continue
            obeys = judge(problem, modes) == 0
            there, obeying = there + 1, obeying + obeys
            if first < 0 or obeys or obeying == 0:
                first, wrong = i, left + changed
        if first > 0:  # another was written last
            for c in range(nc):
                friction[c] = solutions[first, c]
            evaluate(problem, friction, modes.load, modes.rate)
            if ng > 0:
                fit(problem, modes, lines, True)
            judge(problem, modes)
        if chosen or found <= 0 or wrong == 0:
            return min(found, there), obeying
    return -1, 0
