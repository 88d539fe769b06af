"""Gears with losses as entries of a `Problem`: friction that follows the effort they deliver.

A gear receives u - I r, with u what arrives at r = 0. It delivers t; its entry has the friction x:

    t = u - I r + x,      u - I r = slope t + offset       in motion: lines, by the direction
                          lower(t) <= u <= upper(t)        at rest: intervals of t

In given modes and lines all coordinates have rows, with y the friction of the bearings:

    a (x - y) + b r = g,     (1, 0, 0) slips, (0, 1, 0) sticks, (slope, (1 - slope) I, ...) a gear

Newton's method over the lines ends at the one solution of gears that do not lock themselves.
Self-locking ones have one for every u if and only if diag(least slope) + I^1/2 W I^1/2 is positive
definite, with W the rates per unit effort, without rotors, of what does not stick. A solution is
stable if that with the slopes of its own lines is (`notebooks/theory/gears.md`).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from math import prod
from typing import NamedTuple

import numpy as np

from pinfric.friction.balance import RANK
from pinfric.friction.dense import solve_dense
from pinfric.friction.law import add_load_slopes, entry_limits, slip_law, write_rates
from pinfric.friction.problem import Modes, Problem
from pinfric.kernels.compiled import inlined, inlined_kernel, kernel, late_kernel

#: An effort beyond its line by this fraction of the terms of its sum is rounding.
_ROUNDING = 1e-12
#: How many choices are tried at most: of intervals that gears hold; of lines; of lines where
#: friction depends on loads.
_MOST_HOLDS, _MOST_LINES, _MOST_LOADED = 64, 200_000, 4096
#: A choice of lines is tried though an effort is beyond its line by this share of all efforts.
_NEAR = 1e-9
#: Rotors of so many times what each needs alone would not help either.
_HEAVIEST = 1e6
#: Passes of Newton's method over lines for a guess; passes after which it has failed.
_GUESSES, MOST_PASSES = 6, 200


@inlined_kernel
def gear_entry(problem: Problem, g: int) -> int:
    """Return the entry of a gear: they are the last ones."""
    return problem.coordinate.size - problem.gear_rotor.shape[0] + g


@kernel
def _line(problem: Problem, g: int, law: int, effort: float) -> tuple[float, float, float, float]:
    """Return slope, offset and ends of a gear's line around an effort, see `Problem`.

    Where two lines meet, the one of larger efforts.
    """
    lines, k = problem.gear_lines[g, law], 0
    while k + 1 < lines.shape[0] and lines[k + 1, 2] <= effort:
        k += 1
    end = lines[k + 1, 2] if k + 1 < lines.shape[0] else np.inf
    return lines[k, 0], lines[k, 1], lines[k, 2], end


@kernel
def write_rows(problem: Problem, modes: Modes, lines: np.ndarray, rows: np.ndarray) -> None:
    """Write the lines of gears in motion, around `modes.effort`, and the rows of coordinates.

    Args:
        lines: (ng, 4) slope, offset and ends, overwritten.
        rows: (nc, 3) of the module's text, overwritten.
    """
    for c in range(modes.stuck.size):
        rows[c, 0], rows[c, 1], rows[c, 2] = (0.0, 1.0, 0.0) if modes.stuck[c] else (1.0, 0.0, 0.0)
    for g in range(problem.gear_rotor.shape[0]):
        c = problem.coordinate[gear_entry(problem, g)]
        way, t = modes.direction[c], modes.effort[g]
        if modes.stuck[c]:
            continue
        slope, offset, low, high = _line(problem, g, 0 if way > 0.0 else 1, t)
        slope, offset = 1.0 + abs(way) * (slope - 1.0), abs(way) * offset
        lines[g, 0], lines[g, 1], lines[g, 2], lines[g, 3] = slope, offset, low, high
        given, inertia = problem.gear_rotor[g, 0], problem.gear_rotor[g, 1]
        others = rows[c, 0]
        rows[c, 2] = slope * rows[c, 2] + others * ((1.0 - slope) * given - offset)
        rows[c, 1] = slope * rows[c, 1] + others * (1.0 - slope) * inertia
        rows[c, 0] = slope * others


write_rows_within = inlined(write_rows)


@inlined_kernel
def are_bound(stuck: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return which coordinates (nc,) stick or have gears, by rows (nc, 3), (0, 3) without gears."""
    if rows.shape[0] == 0:
        return stuck
    bound = np.empty(stuck.size, np.bool_)
    for c in range(stuck.size):
        bound[c] = rows[c, 0] != 1.0 or rows[c, 1] != 0.0 or rows[c, 2] != 0.0
    return bound


@kernel
def bind(problem: Problem, bound: np.ndarray, rows: np.ndarray, X: np.ndarray) -> bool:
    """Write the friction of coordinates that stick or have gears; False: it is singular.

    Args:
        bound, rows: (nc,) which; (nc, 3), or (0, 3) without gears.
        X: (nc, columns) y as a map, overwritten with x.
    """
    nc, columns = X.shape
    held, n = np.empty(nc, np.int64), 0
    for c in range(nc):
        if bound[c]:
            held[n] = c
            n += 1
    A, B = np.empty((n, n)), np.empty((n, columns))
    for i in range(n):
        c, across, along, rest = held[i], 0.0, 1.0, 0.0
        if rows.shape[0] > 0:
            across, along, rest = rows[c, 0], rows[c, 1], rows[c, 2]
        for j in range(n):
            A[i, j] = along * problem.rate_slope[c, held[j]]
        A[i, i] += across
        for k in range(columns):
            B[i, k] = across * X[c, k]
            if k == 0:
                B[i, k] += rest - along * problem.rate_free[c]
            for d in range(nc):
                if not bound[d]:
                    B[i, k] -= along * problem.rate_slope[c, d] * X[d, k]
    if not solve_dense(A, B):
        return False
    for i in range(n):
        for k in range(columns):
            X[held[i], k] = B[i, k]
    return True


@kernel
def slip_friction(problem: Problem, modes: Modes, y: np.ndarray) -> None:
    """Write the friction y (nc,) of bearings that slip, under the loads in `modes`; 0 of others.

    Unknown loads count as zero.
    """
    if modes.friction[0] != modes.friction[0]:
        modes.load[:] = 0.0
    gain = np.empty(modes.load.size)
    slip_law(problem, modes.stuck, modes.direction, gain, y)
    for s in range(gain.size):
        y[problem.coordinate[s]] += gain[s] * modes.load[s]


@kernel
def guess_lines(
    problem: Problem, modes: Modes, y: np.ndarray, lines: np.ndarray, rows: np.ndarray
) -> None:
    """Choose lines with the loads of the last solution, of which `slip_friction` gives y (nc,).

    Then one full solve is usually enough; without it a state takes 1.25 times as long.

    Args:
        lines, rows: see `write_rows`; overwritten.
    """
    nc = y.size
    X = np.empty((nc, 1))
    for _ in range(_GUESSES):
        for c in range(nc):
            X[c, 0] = y[c]
        if not bind(problem, are_bound(modes.stuck, rows), rows, X):
            return
        for c in range(nc):
            modes.friction[c] = X[c, 0]
        write_rates(problem, modes.friction, modes.rate)
        if fit(problem, modes, lines, False)[0] == 0:
            return
        write_rows(problem, modes, lines, rows)


@late_kernel("gears")
def choose_lines(
    problem: Problem, modes: Modes, y: np.ndarray, lines: np.ndarray, rows: np.ndarray, guess: bool
) -> None:
    """Write the friction y (nc,) of bearings that slip, and lines and rows around `modes.effort`.

    Args:
        lines, rows: see `write_rows`; overwritten.
        guess: whether to look for lines that fit (`guess_lines`).
    """
    slip_friction(problem, modes, y)
    write_rows(problem, modes, lines, rows)
    if guess:
        guess_lines(problem, modes, y, lines, rows)


@late_kernel("gears")
def fit(problem: Problem, modes: Modes, lines: np.ndarray, rests: bool) -> tuple[int, int]:
    """Write the efforts of gears, of which friction, loads and rates are written, into `modes`.

    A gear at rest holds the interval in which the bearings beside it have the most room.

    Args:
        problem: its limits of gears at rest are overwritten.
        lines: on which it was solved, see `write_rows`.
        rests: whether to look at gears at rest.

    Returns:
        How many gears left their line, and how many hold another interval.
    """
    left = changed = 0
    for g in range(problem.gear_rotor.shape[0]):
        c = problem.coordinate[gear_entry(problem, g)]
        given, inertia = problem.gear_rotor[g, 0], problem.gear_rotor[g, 1]
        if modes.stuck[c]:
            if rests:
                below, above = _beside(problem, modes, g)
                t = given + modes.friction[c]
                changed += _hold(problem, modes, g, t - above, t - below, t)
            continue
        arriving, slope, offset = given - inertia * modes.rate[c], lines[g, 0], lines[g, 1]
        if slope != 0.0:
            t = (arriving - offset) / slope
        else:
            y = np.empty(modes.stuck.size)
            slip_friction(problem, modes, y)
            t = arriving + modes.friction[c] - y[c]
            for other in range(problem.gear_rotor.shape[0]):
                if other != g and problem.coordinate[gear_entry(problem, other)] == c:
                    its = (
                        problem.gear_rotor[other, 0] - problem.gear_rotor[other, 1] * modes.rate[c]
                    )
                    t -= (its - lines[other, 1]) / lines[other, 0] - its
        beyond = max(lines[g, 2] - t, t - lines[g, 3])
        if not beyond <= 0.0:
            terms = abs(modes.rate[c]) + problem.rate_scale[c]
            for d in range(modes.friction.size):
                terms += abs(problem.rate_slope[c, d] * modes.friction[d])
            terms = abs(given) + abs(offset) + inertia * terms
            left += not beyond * max(abs(slope), 1e-3) <= _ROUNDING * terms
        modes.effort[g] = t
    return left, changed


fit_within = inlined(fit)


@kernel
def _hold(problem: Problem, modes: Modes, g: int, low: float, high: float, effort: float) -> bool:
    """Let a gear at rest hold the interval that most efforts low to high are in, or the nearest.

    Return whether it changed.
    """
    held, given, e = problem.gear_held[g], problem.gear_rotor[g, 0], gear_entry(problem, g)
    best, chosen = -np.inf, 0
    for k in range(held.shape[0]):
        inside = min(high, held[k, 1]) - max(low, held[k, 0])
        if inside > best:
            best, chosen = inside, k
    least, most = held[chosen, 0], held[chosen, 1]
    changed = problem.coulomb_stick[e, 0] != given - least
    problem.coulomb_stick[e, 0], problem.coulomb_stick[e, 1] = given - least, most - given
    modes.effort[g] = min(max(effort, least), most)
    return changed


@kernel
def hold_chosen(problem: Problem, modes: Modes) -> None:
    """Let gears at rest hold the intervals of the efforts in `modes`."""
    for g in range(problem.gear_rotor.shape[0]):
        if modes.stuck[problem.coordinate[gear_entry(problem, g)]]:
            t = modes.effort[g]
            _hold(problem, modes, g, t, t, t)


@kernel
def _beside(problem: Problem, modes: Modes, g: int) -> tuple[float, float]:
    """Return the least and the greatest friction of all that rests beside a gear."""
    least = greatest = 0.0
    for e in range(problem.coordinate.size):
        own = gear_entry(problem, g)
        if problem.coordinate[e] == problem.coordinate[own] and e != own:
            ends = entry_limits(problem, modes.load, e)
            least, greatest = least + ends[0], greatest + ends[1]
    return least, greatest


@kernel
def gear_margins(problem: Problem, modes: Modes, g: int) -> tuple[float, float]:
    """Return the distances of the torque at a gear at rest above lower(t) and below upper(t).

    Each is the largest over all efforts t that the friction beside the gear allows, finite and
    continuous; below 0 the gear slips.
    """
    given = problem.gear_rotor[g, 0]
    needed = given + modes.friction[problem.coordinate[gear_entry(problem, g)]]
    least, greatest = _beside(problem, modes, g)
    if not greatest - least < np.inf:  # another gear holds it, whatever the load
        return np.inf, np.inf
    lower, upper, start = np.inf, -np.inf, needed - greatest
    while True:
        slope, offset, _, end_down = _line(problem, g, 3, start)
        rise, shift, _, end_up = _line(problem, g, 2, start)
        end = min(needed - least, end_down, end_up)
        lower = min(lower, slope * start + offset, slope * end + offset)
        upper = max(upper, rise * start + shift, rise * end + shift)
        if end >= needed - least:
            return given - lower, upper - given
        start = end


@late_kernel("gears")
def turn_gears(problem: Problem, modes: Modes) -> None:
    """Let gears at rest that give way slip as their law is broken: of a worm against the load.

    Args:
        modes: `Modes`, judged; its `verdict` is changed.
    """
    for g in range(problem.gear_rotor.shape[0]):
        c = problem.coordinate[gear_entry(problem, g)]
        if modes.stuck[c] and abs(modes.verdict[c]) == 1:
            backward, forward = gear_margins(problem, modes, g)
            if min(backward, forward) < 0.0:
                modes.verdict[c] = -1 if backward < forward else 1


def lines_and_rows(problem: Problem, modes: Modes) -> tuple[np.ndarray, ...]:
    """Return lines (ng, 4) and rows (nc, 3) of modes, see `write_rows`; (0, 3) without gears."""
    gears, coordinates = len(modes.effort), len(modes.stuck)
    lines, rows = np.empty((gears, 4)), np.empty((coordinates if gears else 0, 3))
    if gears:
        write_rows(problem, modes, lines, rows)
    return lines, rows


def without_gears(
    problem: Problem, modes: Modes, rows: np.ndarray, within: bool = False
) -> tuple[Problem, np.ndarray] | None:
    """Return the same problem for y, and x = map (1, y); None: gears in motion make it singular."""
    if not problem.gear_rotor.shape[0]:
        return problem, np.empty(0)
    nc, R = len(rows), problem.rate_slope
    x, stick = np.eye(nc, 1 + nc, 1), problem.coulomb_stick.copy()
    for e in np.flatnonzero(modes.stuck[problem.gear_coordinate]) - len(problem.gear_rotor):
        shift = min(max(0.0, -stick[e, 0]), stick[e, 1])
        if within and shift != 0.0:
            shift = _inside(-stick[e, 0], stick[e, 1])
        x[problem.coordinate[e], 0] += shift
        stick[e] += shift, -shift
    if not bind(problem, (rows != (1.0, 0.0, 0.0)).any(axis=1) & ~modes.stuck, rows, x):
        return None
    whole = np.concatenate([np.eye(1, 1 + nc), x])
    return problem._replace(
        rate_free=problem.rate_free + R @ x[:, 0],
        rate_slope=R @ x[:, 1:],
        contact=np.einsum("tie,ij->tje", problem.contact, whole),
        coulomb_stick=stick,
    ), x


# ---------------------------------------------------------------- all solutions


class Jam(NamedTuple):
    """Self-locking gears in motion beside which u does not determine the motion.

    Attributes:
        gear: that of most of the motion. eigenvalue: the least, of the module's text.
        inertia: gear -> I above which there is one answer for every u, at the joint, per unit of r:
            of one gear where that is enough, else of all; none where no inertia is.
    """

    gear: int
    eigenvalue: float
    inertia: dict[int, float]


def jam(problem: Problem, modes: Modes) -> Jam | None:
    """Return which gears jam; None if there is one answer for every u in given modes."""
    stiffness = _stiffness(problem, modes)
    if stiffness is None:
        return None
    moves, back, W = stiffness
    inertia = problem.gear_rotor[moves, 1]
    size, axes = np.linalg.eigh(_energy(back, inertia, W))
    if size[0] > 0.0:
        return None
    order = np.argsort(np.where(back <= 0.0, -np.abs(axes[:, 0]), 1.0))
    enough = _enough(back, inertia, W, order[: int((back <= 0.0).sum())])
    return Jam(int(moves[order[0]]), float(size[0]), {int(moves[g]): x for g, x in enough.items()})


def one_answer(problem: Problem, modes: Modes) -> bool:
    """Return whether there is one answer for every u in given modes."""
    stiffness = _stiffness(problem, modes)
    if stiffness is None:
        return True
    moves, back, W = stiffness
    return bool(np.linalg.eigvalsh(_energy(back, problem.gear_rotor[moves, 1], W))[0] > 0.0)


def _stiffness(problem: Problem, modes: Modes) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Which gears move (m,), their least slopes (m,), and W (m, m); None if none of them locks."""
    if not problem.gear_rotor.shape[0] or problem.gear_lines[:, :2, :, 0].min() > 0.0:
        return None
    moves = np.flatnonzero(~modes.stuck[problem.gear_coordinate])
    share = np.abs(modes.direction[problem.gear_coordinate[moves]])
    share[share == 0.0] = 1.0  # whichever way
    back = 1.0 + share * (problem.gear_lines[moves, :2, :, 0].min(axis=(1, 2), initial=1.0) - 1.0)
    return (moves, back, _coupling(problem, modes, moves)) if (back <= 0.0).any() else None


def _energy(slopes: np.ndarray, inertia: np.ndarray, W: np.ndarray) -> np.ndarray:
    """The matrix of the module's text."""
    root = np.sqrt(inertia)
    return np.asarray(np.diag(slopes) + root[:, None] * W * root)


def _enough(
    back: np.ndarray, inertia: np.ndarray, W: np.ndarray, locking: np.ndarray
) -> dict[int, float]:
    """See `Jam.inertia`, of m gears by their numbers here; locking: which, the first preferred."""
    E, root = _energy(back, inertia, W), np.sqrt(inertia)
    for g in locking.tolist():
        others = np.arange(len(back)) != g
        beside = E[np.ix_(others, others)]
        if np.linalg.eigvalsh(beside).min(initial=1.0) > 0.0:
            across = root[others] * W[g, others]
            remaining = W[g, g] - across @ np.linalg.solve(beside, across)
            if remaining > RANK * W[g, g]:
                return {g: float(-back[g] / remaining)}
    alone = -back[locking] / np.maximum(np.diag(W)[locking], 1e-300)  # what each needs by itself

    def heavier(times: float) -> np.ndarray:
        out = inertia.copy()
        out[locking] = np.maximum(out[locking], times * alone)
        return out

    def is_enough(times: float) -> bool:
        return bool(np.linalg.eigvalsh(_energy(back, heavier(times), W))[0] > 0.0)

    low, high = 1.0, 2.0
    while not is_enough(high):
        low, high = high, 2.0 * high
        if high > _HEAVIEST:
            return {}
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return {g: float(heavier(high)[g]) for g in locking.tolist()}


def _coupling(
    problem: Problem, modes: Modes, moves: np.ndarray, R: np.ndarray | None = None
) -> np.ndarray:
    """W of the module's text (m, m), of the gears that move (m,).

    R (nc, nc): rates per unit effort; None takes the problem's, which is symmetric.
    """
    c, stuck, own = problem.gear_coordinate[moves], modes.stuck, R is None
    R = problem.rate_slope if R is None else R
    across, held = R[c], R[stuck]
    inverse = np.linalg.pinv(held[:, stuck], hermitian=own)
    W = across[:, c] - across[:, stuck] @ inverse @ held[:, c]
    W = W @ np.linalg.inv(np.eye(len(c)) - problem.gear_rotor[moves, 1][:, None] * W)
    return 0.5 * (W + W.T) if own else W


def lasts_under_loads(problem: Problem, modes: Modes, slopes: np.ndarray) -> bool | None:
    """Return whether an answer is stable beside bearings whose loads it changes.

    With x = f + y(x), rates change by R (1 - dy/dx)^-1 per unit effort f; the symmetric part of the
    matrix counts. None where no y depends on loads.

    Args:
        problem, modes: solved.
        slopes: (ng,) of the lines that gears in motion are on.
    """
    gain, offset = np.empty(len(problem.constant)), np.empty(len(modes.stuck))
    slip_law(problem, modes.stuck, modes.direction, gain, offset)
    entry, grows = problem.contact_entry, np.zeros((len(offset), len(offset)))
    add_load_slopes(problem.contact, problem.coordinate[entry], gain[entry], modes.friction, grows)
    if not grows.any():
        return None
    moves = np.flatnonzero(~modes.stuck[problem.gear_coordinate])
    R = problem.rate_slope @ np.linalg.inv(np.eye(len(offset)) - grows)
    E = _energy(slopes[moves], problem.gear_rotor[moves, 1], _coupling(problem, modes, moves, R))
    return bool(np.linalg.eigvalsh(0.5 * (E + E.T)).min(initial=1.0) > 0.0)


def choices_of_lines(problem: Problem, modes: Modes) -> list[tuple[np.ndarray, bool]] | None:
    """Return efforts (ng,) on every choice of lines that may fit, and whether it is stable.

    None where there are too many. The modes must be solved, on any lines.
    """
    moves = np.flatnonzero(~modes.stuck[problem.gear_coordinate])
    if not len(moves):
        return [(modes.effort.copy(), True)]
    W = _coupling(problem, modes, moves)
    coordinate, t = problem.gear_coordinate[moves], modes.effort[moves]
    lines_of_each = [
        _lines_of(problem, int(g), float(modes.direction[c]))
        for g, c in zip(moves, coordinate, strict=True)
    ]
    slides = ~modes.stuck[problem.coordinate[problem.contact_entry]]
    loaded = bool((problem.mu_slip[problem.contact_entry] * slides).any())
    if prod(len(lines) for lines in lines_of_each) > (_MOST_LOADED if loaded else _MOST_LINES):
        return None
    arriving, inertia = problem.gear_rotor[moves].T
    table = np.array(list(product(*lines_of_each)))
    A = inertia[:, None] * W + np.eye(len(moves)) * table[:, :, 0][:, None, :]
    fits = np.ones(len(table), dtype=bool)
    if not loaded and np.isfinite(modes.rate).all() and np.isfinite(t).all():
        right = arriving - inertia * (modes.rate[coordinate] - W @ t) - table[:, :, 1]
        fits = np.linalg.det(A) != 0.0
        efforts_on_lines = np.full(right.shape, np.nan)
        efforts_on_lines[fits] = np.linalg.solve(A[fits], right[fits][:, :, None])[:, :, 0]
        slack = _NEAR * (np.abs(efforts_on_lines).max(axis=1) + np.abs(arriving).max())[:, None]
        fits = (
            (table[:, :, 2] - slack <= efforts_on_lines)
            & (efforts_on_lines <= table[:, :, 3] + slack)
        ).all(axis=1)
    out = []
    for lines in table[fits]:
        least = np.linalg.eigvalsh(_energy(lines[:, 0], inertia, W))[0]
        efforts = modes.effort.copy()
        efforts[moves] = [_inside(low, high) for low, high in lines[:, 2:]]
        out.append((efforts, bool(least > 0.0)))
    return out


def _lines_of(problem: Problem, g: int, way: float) -> list[tuple[float, float, float, float]]:
    """(slope, offset, least, greatest effort) of every line of a gear in motion."""
    lines = problem.gear_lines[g, 0 if way > 0.0 else 1]
    lines = lines[lines[:, 2] < np.inf]
    slopes = 1.0 + abs(way) * (lines[:, 0] - 1.0)
    ends = [*lines[1:, 2].tolist(), np.inf]
    return list(zip(slopes, abs(way) * lines[:, 1], lines[:, 2], ends, strict=True))


def ways_to_hold(problem: Problem, modes: Modes) -> Iterator[np.ndarray]:
    """Yield efforts (ng,), one for each choice of the intervals that gears at rest hold."""
    choices = []
    for g in np.flatnonzero(modes.stuck[problem.gear_coordinate]).tolist():
        held = [(low, high) for low, high in problem.gear_held[g].tolist() if low <= high]
        choices += [[(g, _inside(low, high)) for low, high in held]] * (len(held) > 1)
    if prod(len(held) for held in choices) > _MOST_HOLDS:
        return
    kept = modes.effort.copy()
    for choice in product(*choices):
        for g, effort in choice:
            kept[g] = effort
        yield kept.copy()


def _inside(low: float, high: float) -> float:
    """An effort well between two, of which one or both may be infinite."""
    if np.isinf(low) and np.isinf(high):
        return 0.0
    if np.isinf(low):
        return high - 1.0 - abs(high)
    return low + 1.0 + abs(low) if np.isinf(high) else 0.5 * (low + high)
