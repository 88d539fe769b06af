"""The modes of joints at rest that no linear program refutes: branch and bound.

In given modes rates are affine in friction x, and limits are affine in loads. A load is at least
its tangent and, over a box that contains every answer, at most a linear function (`write_bounds`).
So what the modes decided so far demand is a linear program:

    sticks        r = 0                 |x| <= largest static limit
    slips s       s r >= 0              least sliding friction <= -s x <= largest
    not decided                         |x| <= largest limit of both

A node whose program has no solution has no answer below it (Land and Doig 1960); leaves are judged
by the laws themselves. Nodes with few slipping joints come first (`notebooks/theory/resting.md`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from pinfric.friction.dense import factorize, solve_dense, spectral_radius_bound
from pinfric.friction.law import sliding
from pinfric.friction.minimax import greatest_bound
from pinfric.friction.problem import Problem
from pinfric.friction.ways import Ways
from pinfric.kernels.compiled import kernel

#: Modes of a node beside -1 and 1, the directions of a slip.
_STICKS, _UNDECIDED = 0, 2
#: The growth of friction with friction has to be below this.
_BELOW = 0.999
#: A rate of which others leave no more than this share depends on them.
_DEPENDS = 1e-9
#: A box is wider by this part: rounding.
_ROUNDING = 1e-9
#: A program's rows, in parts of their scale, may be violated by so much: rounding.
_EXACT = 1e-6
#: Programs of one search, in all and times the number of joints to the sixth: beyond 16 joints few
#: trees end, and a twentieth of a second is spent on them.
_MOST_PROGRAMS, _MOST_WORK = 20_000, 134_000_000_000
#: The same in mechanisms.
_MOST_IN_LOOPS = 3_000
#: Leaves of one level, at most.
_MOST_LEAVES = 2_000


class Bounds(NamedTuple):
    """Linear bounds over the box |x - middle| <= box, of each coordinate's friction x.

    Attributes:
        middle, box: (nc,) N m or N.
        stick: (nc, 2, 1 + nc) static limits from above, of x > 0 and of x < 0, by (1, x).
        either: (nc, 2, 1 + nc) the larger of static limit and sliding friction from above, alike.
        slip: (nc, 2, 2, 1 + nc) sliding friction, in forward and in backward motion: from below
            and from above, by (1, x).
    """

    middle: np.ndarray
    box: np.ndarray
    stick: np.ndarray
    either: np.ndarray
    slip: np.ndarray


def kernels_of_tree(problem: Problem, closed: bool) -> list[tuple[Any, tuple[Any, ...]]]:
    """Return the kernels that Python calls in a tree, with arguments of their types.

    Args:
        closed: whether it is of a mechanism.
    """
    n, rests, modes = 0, np.empty(0, bool), np.empty((0, 0), np.int8)
    limits = np.empty((n, 2, 1)), np.empty((n, 2, 1)), np.empty((n, 2, 2, 1))
    bounds, line = Bounds(np.empty(n), np.empty(n), *limits), np.empty(0)
    state, order = (problem, bounds, rests), np.empty(0, np.int64)
    nodes: list[tuple[Any, tuple[Any, ...]]]
    nodes = [(expand, (*state, order, *[modes] * 3, 0, not closed))]
    nodes += [(allows, (*state, modes.ravel()))] if closed else []
    return [(write_bounds, (problem, rests, line, bounds)), *nodes]


class Tree:
    """The tree of modes of a problem without balls.

    Attributes:
        ends: whether a box is known that contains every answer.
        programs: how many were solved. complete: whether all that they leave was looked at.

    Args:
        problem: `Problem`. at_rest: (nc,) bool. direction: (nc,) in which the others slip.
        closed: whether it is of a mechanism, whose rates depend on each other.
    """

    def __init__(
        self, problem: Problem, at_rest: np.ndarray, direction: np.ndarray, closed: bool = False
    ) -> None:
        self.closed = closed
        self.problem, self.at_rest, n = problem, at_rest, len(at_rest)
        self.root = np.where(at_rest, _UNDECIDED, np.sign(direction)).astype(np.int8)
        self.programs, self.complete = 0, True
        slope = np.maximum(problem.rate_slope.diagonal(), 1e-300)
        strength = np.abs(problem.rate_free) / np.sqrt(slope)
        self.order = np.argsort(-strength, kind="stable")
        limits = np.zeros((n, 2, 1 + n)), np.zeros((n, 2, 1 + n)), np.zeros((n, 2, 2, 1 + n))
        self.bounds = Bounds(np.empty(n), np.empty(n), *limits)
        self.ends = bool(write_bounds(problem, at_rest, direction, self.bounds))

    def allowed(self, levels: Iterable[list[Ways]]) -> Iterator[list[Ways]]:
        """Yield of each level the ways of a mechanism that no program refutes."""
        for level in levels:
            yield [ways for ways in level if self._allows(ways)]

    def _allows(self, ways: Ways) -> bool:
        mode = np.where(self.at_rest, _STICKS, self.root).astype(np.int8)
        for c, way in ways.items():
            mode[c] = way
        return bool(allows(self.problem, self.bounds, self.at_rest, mode))

    def levels(self, forced: Ways) -> Iterator[list[Ways]]:
        """Yield the ways to slip with no joint beside the forced ones, then with one more, ...

        `complete` is False if there are more than were looked at.

        Args:
            forced: joints that slip in any case, and how.
        """
        root = self.root.copy()
        for c, way in forced.items():
            root[c] = way
        order = self.order[(root == _UNDECIDED)[self.order]]
        waiting = root[None]
        leaves = np.empty((_MOST_LEAVES, len(root)), np.int8)
        while len(waiting):
            most = _MOST_IN_LOOPS if self.closed else _MOST_PROGRAMS
            left = min(most, _MOST_WORK // len(root) ** 6) - self.programs
            room = 2 * min(len(order) * len(waiting), left) + 2
            more = np.empty((room, len(root)), np.int8)
            found, after, programs = expand(
                self.problem,
                self.bounds,
                self.at_rest,
                order,
                waiting,
                more,
                leaves,
                left,
                not self.closed,
            )
            self.programs += programs
            if found < 0:
                self.complete = False
                return
            yield [
                {c: float(way) for c, way in enumerate(leaf.tolist()) if way and self.at_rest[c]}
                for leaf in leaves[:found]
            ]
            waiting = more[:after]


@kernel
def allows(problem: Problem, bounds: Bounds, at_rest: np.ndarray, mode: np.ndarray) -> bool:
    """Return whether no program refutes the modes (nc,) of a mechanism, whose rates depend."""
    nc = mode.size
    G, h, s = np.empty((6 * nc, nc)), np.empty(6 * nc), np.ones(6 * nc)
    basis, y = np.empty(nc + 1, np.int64), np.empty(nc + 1)
    rows, free = write_rows(problem, bounds, at_rest, mode, False, G, h)
    return greatest_bound(G, h, s, rows, 1.0, basis[: free + 1], y[: free + 1]) <= _EXACT


@kernel
def write_bounds(
    problem: Problem, at_rest: np.ndarray, direction: np.ndarray, bounds: Bounds
) -> bool:
    """Write the box and the bounds over it; False: no box is known.

    With p_e in [low_e, high_e], p_e^2 <= (low_e + high_e) p_e - low_e high_e; m is the force in the
    middle of the box:

        m . p / |m| <= |p| <= (|p|^2 + r^2) / (2 r),   r^2 = sum of (low_e^2 + high_e^2) / 2

    Args:
        problem, at_rest, direction: see `Tree`.
        bounds: overwritten; its limits are zero.
    """
    write_box(problem, at_rest, direction, bounds.middle, bounds.box)
    box, nc, ne = bounds.box, at_rest.size, problem.constant.size
    for c in range(nc):
        if not box[c] < np.inf:
            return False
    above, below, middle = np.zeros((ne, 1 + nc)), np.zeros((ne, 1 + nc)), np.empty(3)
    for s in range(ne):
        above[s, 0] = below[s, 0] = problem.constant[s]
    # 1. loads
    for t in range(problem.contact_entry.size):
        s, square, product = problem.contact_entry[t], 0.0, 0.0
        for e in range(3):
            reach, middle[e] = 0.0, problem.contact[t, 0, e]
            for c in range(nc):
                middle[e] += problem.contact[t, 1 + c, e] * bounds.middle[c]
                reach += abs(problem.contact[t, 1 + c, e]) * box[c]
            square += middle[e] * middle[e] + reach * reach
            product += middle[e] * middle[e] - reach * reach
        r = max(np.sqrt(square), 1e-300)
        size = np.sqrt(middle[0] * middle[0] + middle[1] * middle[1] + middle[2] * middle[2])
        above[s, 0] += 0.5 * (r - product / r)
        for j in range(1 + nc):
            along = 0.0
            for e in range(3):
                along += middle[e] * problem.contact[t, j, e]
            above[s, j] += along / r
            below[s, j] += along / max(size, 1e-300)
    # 2. limits
    gears = ne - problem.gear_rotor.shape[0]
    for s in range(ne):
        c, size = problem.coordinate[s], abs(problem.ratio[s])
        mu = max(problem.mu_stick[s], problem.mu_slip[s])
        forward = 0 if problem.ratio[s] > 0.0 else 1
        for side in range(2):
            # of `stick`, x > 0 and x < 0, against backward and forward motion
            stick = problem.coulomb_stick[s, forward if side == 1 else 1 - forward]
            if s >= gears:
                low, high = _held(problem, s - gears)
                stick = high if side == 0 else -low
            offset = sliding(problem, s, 2.0 * side - 1.0)[1]
            bounds.stick[c, side, 0] += size * stick
            bounds.either[c, side, 0] += max(size * stick, abs(offset))
            # of `slip`, in forward and in backward motion
            gain, offset = sliding(problem, s, 1.0 - 2.0 * side)
            way = 2.0 * side - 1.0  # of the friction
            for end in range(2):
                bounds.slip[c, side, end, 0] += way * offset
            for j in range(1 + nc):
                bounds.stick[c, side, j] += size * problem.mu_stick[s] * above[s, j]
                bounds.either[c, side, j] += size * mu * above[s, j]
                bounds.slip[c, side, 0, j] += way * gain * below[s, j]
                bounds.slip[c, side, 1, j] += way * gain * above[s, j]
            if s >= gears:
                bounds.either[c, side, 0] = np.inf
                _add_moving_gear(problem, at_rest, s - gears, bounds, side)
    return True


@kernel
def _held(problem: Problem, g: int) -> tuple[float, float]:
    """Return the least and the greatest friction of a gear at rest over all that it can hold."""
    given, low, high = problem.gear_rotor[g, 0], np.inf, -np.inf
    for k in range(problem.gear_held.shape[1]):
        low, high = min(low, problem.gear_held[g, k, 0]), max(high, problem.gear_held[g, k, 1])
    return (low - given, high - given) if low <= high else (0.0, 0.0)


@kernel
def _add_moving_gear(
    problem: Problem, at_rest: np.ndarray, g: int, bounds: Bounds, side: int
) -> None:
    """Add what a gear in motion takes of the effort that arrives, w = u - I r, to its bounds.

    It is f(w) = s (w - t), t on the lines. Where f is convex it is above each of its lines and
    below its chord; elsewhere it is above 0.
    """
    c = problem.coordinate[problem.constant.size - problem.gear_rotor.shape[0] + g]
    given, inertia = problem.gear_rotor[g, 0], problem.gear_rotor[g, 1]
    way, lines = 1.0 - 2.0 * side, problem.gear_lines[g, side]
    # 1. what can arrive: it slips where it accelerates
    rate, reach = problem.rate_free[c], 0.0
    for d in range(at_rest.size):
        rate += problem.rate_slope[c, d] * bounds.middle[d]
        reach += abs(problem.rate_slope[c, d]) * bounds.box[d]
    least, most = rate - reach, rate + reach
    if at_rest[c]:
        least, most = (
            (max(least, 0.0), max(most, 0.0)) if side == 0 else (min(least, 0.0), min(most, 0.0))
        )
    least, most = given - inertia * most, given - inertia * least
    # 2. lines there
    first, last = _line_at(lines, least), _line_at(lines, most)
    for k in range(first, last + 1):
        convex = lines[k, 0] > 0.0
        if convex and k > first:
            convex = way * (1.0 / lines[k - 1, 0] - 1.0 / lines[k, 0]) >= -_ROUNDING
        if not convex:
            bounds.slip[c, side, 1, 0] = np.inf
            return
    ends = np.empty(2)
    for end in range(2):
        k, w = (first, least) if end == 0 else (last, most)
        ends[end] = way * (w - (w - lines[k, 1]) / lines[k, 0])
    k = _line_at(lines, 0.5 * (least + most))
    for end in range(2):
        slope = way * (1.0 - 1.0 / lines[k, 0])
        constant = way * lines[k, 1] / lines[k, 0]
        if end == 1 and first != last:
            slope = (ends[1] - ends[0]) / (most - least)
            constant = ends[0] - slope * least
        bounds.slip[c, side, end, 0] += constant + slope * (given - inertia * problem.rate_free[c])
        for d in range(at_rest.size):
            bounds.slip[c, side, end, 1 + d] -= slope * inertia * problem.rate_slope[c, d]


@kernel
def _line_at(lines: np.ndarray, w: float) -> int:
    """Return on which of a gear's rising lines (n, 3) it delivers of the effort w that arrives."""
    k = 0
    while k + 1 < lines.shape[0] and lines[k + 1, 2] < np.inf:
        if lines[k, 0] * lines[k + 1, 2] + lines[k, 1] > w:
            break
        k += 1
    return k


@kernel
def write_box(  # noqa: C901
    problem: Problem,
    at_rest: np.ndarray,
    direction: np.ndarray,
    middle: np.ndarray,
    box: np.ndarray,
) -> None:
    """Write a box of x that contains every answer: its middle, and its half width or inf (nc,).

    With a the limits without friction and C their growth, where friction does not feed itself,

        |x| <= a + C |x|,       |x| <= (1 - C)^-1 a

    Friction does no work on what rests, x . r <= 0 with r = r_0 + R x. So where loads do not change
    the friction of what moves, x lies in a ball between none and what would hold all, x_s:

        |x - x_s/2|_R <= |x_s|_R / 2,       x_s = -R^-1 r_0

    In loops this bounds as many sums of frictions as there are freedoms: `_bound_by_energy`.
    """
    nc, gears = at_rest.size, problem.constant.size - problem.gear_rotor.shape[0]
    limit, grows, follows = np.zeros((nc, 1)), np.zeros((nc, nc)), False
    # 1. friction that does not feed itself
    for s in range(problem.constant.size):
        c, size = problem.coordinate[s], abs(problem.ratio[s])
        mu, most = max(problem.mu_stick[s], problem.mu_slip[s]), 0.0
        for way in range(2):
            most = max(most, problem.coulomb_slip[s, way])
            most = max(most, problem.coulomb_stick[s, way] if s < gears else 0.0)
        limit[c, 0] += size * (mu * problem.constant[s] + most + abs(problem.drag[s]))
        # drag works on what rests, and loads or efforts change the friction of what moves
        follows |= problem.drag[s] != 0.0 if at_rest[c] else s >= gears
    for t in range(problem.contact_entry.size):
        s = problem.contact_entry[t]
        c = problem.coordinate[s]
        mu = abs(problem.ratio[s]) * max(problem.mu_stick[s], problem.mu_slip[s])
        follows |= not at_rest[c] and problem.mu_slip[s] > 0.0
        for j in range(1 + nc):
            p = problem.contact[t, j]
            size = mu * np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
            if j == 0:
                limit[c, 0] += size
            else:
                grows[c, j - 1] += size
    for g in range(problem.gear_rotor.shape[0]):
        _add_gear(problem, g, limit, grows)
    bounded = _is_limited(limit) or (
        not follows and _bound_by_energy(problem, at_rest, limit, grows)
    )
    bounded = bounded and spectral_radius_bound(grows, np.empty(nc)) < _BELOW
    if bounded:
        bounded = solve_dense(np.eye(nc) - grows, limit)
    # 2. friction that does no work on what rests
    rests = np.flatnonzero(at_rest)
    n = rests.size
    R, inverse, offset, r = np.empty((n, n)), np.eye(n), np.zeros(nc), np.empty(n)
    for s in range(problem.constant.size):
        c = problem.coordinate[s]
        if not at_rest[c]:
            offset[c] += sliding(problem, s, direction[c])[1]
    for i in range(n):
        r[i] = problem.rate_free[rests[i]]
        for c in range(nc):
            r[i] += problem.rate_slope[rests[i], c] * offset[c]
        for j in range(n):
            R[i, j] = problem.rate_slope[rests[i], rests[j]]
    ball = not follows and factorize(R.copy()) and solve_dense(R, inverse)
    energy = 0.0
    for i in range(n):
        for j in range(n):
            energy += 0.25 * r[i] * inverse[i, j] * r[j]
    for c in range(nc):
        middle[c], box[c] = 0.0, limit[c, 0] if bounded else np.inf
        if ball and not at_rest[c]:
            middle[c], box[c] = offset[c], 0.0
    for i in range(n if ball else 0):
        c, x = rests[i], 0.0
        for j in range(n):
            x -= 0.5 * inverse[i, j] * r[j]
        reach = np.sqrt(inverse[i, i] * energy) * (1.0 + _ROUNDING)
        low, high = max(-box[c], x - reach), min(box[c], x + reach)
        middle[c], box[c] = 0.5 * (low + high), 0.5 * (high - low)


@kernel
def _is_limited(limit: np.ndarray) -> bool:
    """Return whether limits (nc, 1) are finite."""
    limited = True
    for c in range(limit.shape[0]):
        limited &= limit[c, 0] < np.inf
    return limited


@kernel
def _bound_by_energy(  # noqa: C901
    problem: Problem, at_rest: np.ndarray, limit: np.ndarray, grows: np.ndarray
) -> bool:
    """Bound what has no limit of its own, gears that lock themselves, by others; False: not all.

    Of coordinates B whose rates do not depend on each other, and N the others, all at rest,

        |x_B + W x_N + b/2| <= |b|_R / 2,       (W, b) = R_BB^-1 (R_BN, r_B)

    Args:
        limit, grows: (nc, 1), (nc, nc), overwritten where a limit is infinite.
    """
    nc, energy = at_rest.size, 0.0
    M, basis = np.zeros((nc, 2 * nc + 1)), np.zeros(nc, np.bool_)  # R, r, and then R_BB^-1
    if at_rest.sum() < nc:
        return False
    for c in range(nc):
        M[c, nc], M[c, nc + 1 + c] = problem.rate_free[c], 1.0
        for d in range(nc):
            M[c, d] = problem.rate_slope[c, d]
    for _ in range(nc):
        pivot, best = -1, _DEPENDS
        for c in range(nc):  # those without limit first
            share = M[c, c] / max(problem.rate_slope[c, c], 1e-300)
            if share > _DEPENDS and not limit[c, 0] < np.inf:
                share += 1.0
            if not basis[c] and share > best:
                pivot, best = c, share
        if pivot < 0:
            break
        basis[pivot], size = True, M[pivot, pivot]
        for j in range(2 * nc + 1):
            M[pivot, j] /= size
        for c in range(nc):
            factor = M[c, pivot]
            for j in range(2 * nc + 1 if c != pivot else 0):
                M[c, j] -= factor * M[pivot, j]
    for c in range(nc):
        energy += 0.25 * problem.rate_free[c] * M[c, nc] if basis[c] else 0.0
    for c in range(nc):
        if limit[c, 0] < np.inf:
            continue
        if not basis[c]:
            return False
        reach = np.sqrt(max(M[c, nc + 1 + c] * energy, 0.0)) * (1.0 + _ROUNDING)
        limit[c, 0] = 0.5 * abs(M[c, nc]) + reach
        for d in range(nc):
            grows[c, d] = 0.0 if basis[d] else abs(M[c, d])
    return True


@kernel
def _add_gear(problem: Problem, g: int, limit: np.ndarray, grows: np.ndarray) -> None:
    """Add what a gear takes of the effort that arrives, u - I r, to limits (nc, 1) and growth.

    On a line it takes |u - I r| |1 - 1/slope| + |offset/slope| at most; at rest what it holds.
    """
    c = problem.coordinate[problem.constant.size - problem.gear_rotor.shape[0] + g]
    given, inertia, lines = (
        problem.gear_rotor[g, 0],
        problem.gear_rotor[g, 1],
        problem.gear_lines[g],
    )
    part = rest = 0.0
    for way in range(lines.shape[0]):
        for k in range(lines.shape[1]):
            if lines[way, k, 0] <= 0.0:  # it locks itself
                limit[c, 0] = np.inf
                return
            part = max(part, abs(1.0 - 1.0 / lines[way, k, 0]))
            rest = max(rest, abs(lines[way, k, 1] / lines[way, k, 0]))
    low, high = _held(problem, g)
    moves = part * (abs(given) + inertia * abs(problem.rate_free[c])) + rest
    limit[c, 0] += max(-low, high, moves)
    for d in range(grows.shape[0]):
        grows[c, d] += part * inertia * abs(problem.rate_slope[c, d])


@kernel
def expand(
    problem: Problem,
    bounds: Bounds,
    at_rest: np.ndarray,
    order: np.ndarray,
    nodes: np.ndarray,
    more: np.ndarray,
    leaves: np.ndarray,
    most: int,
    follow: bool,
) -> tuple[int, int, int]:
    """Write the leaves with as many slipping joints as the nodes have, and the nodes with one more.

    Args:
        problem, bounds, at_rest: of the tree.
        order: (n,) coordinates in the order in which they are decided.
        nodes: (m, nc) modes. more, leaves: (>=, nc), overwritten with modes.
        most: programs. follow: see `write_rows`.

    Returns:
        The numbers of leaves (-1: there are too many, or too many programs), of nodes and of
        programs.
    """
    nc, n = bounds.box.size, order.size
    G, h, s = np.empty((6 * nc, nc)), np.empty(6 * nc), np.ones(6 * nc)
    basis, y = np.empty(nc + 1, np.int64), np.empty(nc + 1)
    waiting = np.empty((n + 2, nc), np.int8)
    found, after, programs = 0, 0, 0
    for node in range(nodes.shape[0]):
        for c in range(nc):
            waiting[0, c] = nodes[node, c]
        depth = 1
        while depth > 0:
            depth -= 1
            mode = waiting[depth]
            programs += 1
            if programs > most:
                return -1, after, programs
            rows, free = write_rows(problem, bounds, at_rest, mode, follow, G, h)
            bound = greatest_bound(G, h, s, rows, 1.0, basis[: free + 1], y[: free + 1])
            if bound > _EXACT:
                continue
            k = 0
            while k < n and mode[order[k]] != _UNDECIDED:
                k += 1
            if k == n:
                if found == leaves.shape[0]:
                    return -1, after, programs
                for c in range(nc):
                    leaves[found, c] = mode[c]
                found += 1
                continue
            if after + 2 > more.shape[0]:
                return -1, after, programs
            for way in (-1, 1):
                for c in range(nc):
                    more[after, c] = mode[c]
                more[after, order[k]] = way
                after += 1
            mode[order[k]] = _STICKS
            depth += 1
    return found, after, programs


@kernel
def write_rows(
    problem: Problem,
    bounds: Bounds,
    at_rest: np.ndarray,
    mode: np.ndarray,
    follow: bool,
    G: np.ndarray,
    h: np.ndarray,
) -> tuple[int, int]:
    """Write a node's program G z + h <= 0, |z| <= 1; return its rows and unknowns.

    The unknowns are frictions, from the middle of the box in parts of it.

    Args:
        problem, bounds, at_rest, mode: see `expand`.
        follow: whether those that stick follow from the others: no rates depend on each other.
        G, h: overwritten.
    """
    box, nc = bounds.box, bounds.box.size
    free, held, place = np.empty(nc, np.int64), np.empty(nc, np.int64), np.empty(nc, np.int64)
    n = k = 0
    for c in range(nc):
        if mode[c] == _STICKS and follow:
            held[k], place[c] = c, -1
            k += 1
        else:
            free[n], place[c] = c, n
            n += 1
    # 1. x = of_z (1, z): what sticks has no rate
    A, B, of_z = np.empty((k, k)), np.empty((k, 1 + n)), np.zeros((nc, 1 + n))
    for i in range(k):
        for j in range(k):
            A[i, j] = problem.rate_slope[held[i], held[j]]
        B[i, 0] = -problem.rate_free[held[i]]
        for j in range(n):
            B[i, 0] -= problem.rate_slope[held[i], free[j]] * bounds.middle[free[j]]
            B[i, 1 + j] = -problem.rate_slope[held[i], free[j]] * box[free[j]]
    if k > 0:
        solve_dense(A, B)
    for i in range(k):
        for j in range(1 + n):
            of_z[held[i], j] = B[i, j]
    for j in range(n):
        of_z[free[j], 0], of_z[free[j], 1 + j] = bounds.middle[free[j]], box[free[j]]
    # 2. the rows, by (1, x) and then by z
    rows, line = 0, np.empty(1 + nc)
    for c in range(nc):
        way, scale = mode[c], max(abs(bounds.middle[c]), box[c]) + 1e-300
        slips = way not in (_STICKS, _UNDECIDED)
        for side in range(2):
            sign = 1.0 - 2.0 * side
            mine = slips and sign * way > 0.0
            if not slips:  # sign x <= limit
                limit = bounds.stick if way == _STICKS else bounds.either
                rows += _put(-1.0, limit[c, side], c, sign, of_z, place, scale, G, h, rows)
            for end in range(2 if mine else 0):  # least <= -sign x <= most
                toward = 1.0 - 2.0 * end
                slip = bounds.slip[c, side, end]
                rows += _put(toward, slip, c, toward * sign, of_z, place, scale, G, h, rows)
            if at_rest[c] and (mine or (way == _STICKS and not follow)):  # sign r >= 0
                line[0], size = -sign * problem.rate_free[c], problem.rate_scale[c]
                for d in range(nc):
                    line[1 + d] = -sign * problem.rate_slope[c, d]
                    size += abs(problem.rate_slope[c, d]) * box[d]
                rows += _put(1.0, line, c, 0.0, of_z, place, size + 1e-300, G, h, rows)
    return rows, n


@kernel
def _put(
    factor: float,
    line: np.ndarray,
    c: int,
    sign: float,
    of_z: np.ndarray,
    place: np.ndarray,
    scale: float,
    G: np.ndarray,
    h: np.ndarray,
    row: int,
) -> int:
    """Write the row (factor line (1, x) + sign x_c) / scale <= 0 by z; return 1, 0 if infinite."""
    if not abs(line[0]) < np.inf:
        return 0
    h[row] = factor * line[0]
    for j in range(of_z.shape[1] - 1):
        G[row, j] = 0.0
    for d in range(of_z.shape[0]):
        entry = factor * line[1 + d] + (sign if d == c else 0.0)
        if entry != 0.0:
            h[row] += entry * of_z[d, 0]
            if place[d] >= 0:  # its own unknown
                G[row, place[d]] += entry * of_z[d, 1 + place[d]]
                continue
            for j in range(of_z.shape[1] - 1):
                G[row, j] += entry * of_z[d, 1 + j]
    h[row] /= scale
    for j in range(of_z.shape[1] - 1):
        G[row, j] /= scale
    return 1
