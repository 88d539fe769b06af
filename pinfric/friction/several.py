"""All frictions in given modes, where there may be several: a complete search.

In given modes friction that depends on loads is z_k = offset_k + sign_k y_k with

    y_k = sum |gain| |p|,      p = P_0 + P y,      y >= 0

In homogeneous coordinates u = (tau, y) every solution lies in the simplex tau + sum y = 1, which is
cut into parts. In each f_k(u) = y_k - sum |gain| |P u| is concave: not below the chord through the
corners, not above its tangent. A part is done if such bounds exclude a solution, or if forces turn
so little in it that f is one to one: then Newton's method finds the only one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pinfric.friction.dense import largest, solve_dense
from pinfric.friction.given_modes import Reduced, keep, newton, reduce_problem
from pinfric.friction.law import stick_limits
from pinfric.friction.problem import Problem
from pinfric.friction.tree import write_box
from pinfric.kernels.compiled import call_compiled, kernel

#: Up to so many frictions that follow loads all solutions are found; most simplices to look at.
MOST_COUPLED, MOST_PARTS = 6, 20_000
#: Solutions closer than this, relative to their size, are one; a simplex so small is not cut.
_DISTINCT, _SMALL = 1e-6, 1e-7
#: Simplices that are examined together, those cut last first.
_AT_ONCE = 64
#: Starts of a wide search; what Newton's method must reach there (it stops at rounding).
_STARTS, _RESIDUAL = 200, 1e-12
#: Of the starts' frictions, by the size of contact forces times gains; drawn once.
_SCALES = 10.0 ** np.random.default_rng(0).uniform(-4.0, 5.0, size=16 * _STARTS)
#: What rounding leaves of zero; what Newton's method must reach; its passes.
_ROUNDING, _FOUND, _PASSES = 1e-12, 1e-13, 40
#: By more than this share of the terms a law is broken.
_UNJUST = 1e-8
#: Error of tau, as a share of it, up to which a solution counts.
_KNOWN = 0.5
#: Below this spectral radius it contracts.
_CONTRACTS = 0.99
#: What bounds show of a simplex.
_EMPTY, _OPEN, _SINGLE = range(3)


class Frictions(NamedTuple):
    """The result of a search for all frictions.

    Attributes:
        solutions: (nc,) each.
        parts: number of simplices examined.
        complete: whether there are no others; None: not searched for so many entries.
    """

    solutions: list[np.ndarray]
    parts: int
    complete: bool | None


def find_all(
    problem: Problem,
    stuck: np.ndarray,
    direction: np.ndarray,
    rows: np.ndarray,
    obey: np.ndarray | None = None,
) -> Frictions:
    """Return all frictions that fit given modes, of up to `MOST_COUPLED` that follow loads.

    Args:
        stuck, direction: (nc,) the modes. rows: (nc, 3), `gears.write_rows`.
        obey: (nc,) bool, coordinates that have to obey their laws, too: frictions by which one of
            them does not may be missing.
    """
    nz, reduced = reduce_problem(problem, stuck, direction, rows)
    if not 0 < nz <= MOST_COUPLED:
        return Frictions([], 0, None)
    rays, X = _rays_of(reduced)
    laws, roots = _laws_of(problem, stuck, direction, obey, X), np.empty((MOST_PARTS, 1 + nz))
    found, parts, complete = call_compiled(look_everywhere, rays, laws, MOST_PARTS, roots)
    return Frictions([X @ u / u[0] for u in roots[:found]], parts, complete)


def kernel_of_simplices() -> tuple[Any, tuple[Any, ...]]:
    """Return the kernel that Python calls in `find_all`, with arguments of its types."""
    line, rows, forces = np.empty(0), np.empty((0, 0)), np.empty((0, 3, 0))
    places = np.empty(0, np.int64)
    laws = _Laws(rows, rows, rows, rows, places, forces)
    return look_everywhere, (_Rays(line, places, line, forces), laws, 0, rows)


@kernel
def from_many_starts(
    reduced: Reduced, direction: np.ndarray, solutions: np.ndarray, found: int, figures: np.ndarray
) -> int:
    """Append the frictions that Newton's method finds from many starts; return how many there are.

    Starts are on every scale (`_SCALES`). It proves nothing.

    Args:
        reduced: `Reduced`.
        direction: (nc,) of the slip.
        solutions, found, figures: see `given_modes.solve_given_modes`; those found before.
    """
    unknown, X, _, _, gain, contact = reduced
    z, drawn, scale = np.zeros(contact.shape[1] - 1), contact.shape[1] - 1, 0.0
    for t in range(gain.size):
        scale = max(scale, np.abs(contact[t, 0]).max())
    scale *= largest(gain)
    for start in range(_STARTS if z.size > 0 else 0):
        for c in range(unknown.size if start > 0 else 0):
            if unknown[c] >= 0:
                size = (scale if scale > 0.0 else 1.0) * _SCALES[drawn % _SCALES.size]
                z[unknown[c]] = -direction[c] * size
                drawn += 1
        error, passes = newton(reduced, z, False)
        figures[1] += passes
        if error <= _RESIDUAL:
            found = keep(X, z, solutions, found)
    return found


def distinct(frictions: np.ndarray) -> list[np.ndarray]:
    """Return the frictions (n, nc) that differ by more than rounding: each by its own scale."""
    kept: list[np.ndarray] = []
    for x in frictions:
        floor = _ROUNDING * float(np.abs(x).max(initial=0.0))
        if all(
            (np.abs(x - other) > _DISTINCT * np.maximum(np.abs(x), np.abs(other)) + floor).any()
            for other in kept
        ):
            kept.append(x)
    return kept


class _Laws(NamedTuple):
    """What frictions x = X u of modes have to obey, as functions of u.

    Attributes:
        room, noise: (m, 1 + nz) rates along the slip and room in the box, which obey where they are
            not negative; what rounding may leave of them.
        x: (n, 1 + nz) friction of coordinates that stick. limit: (n, 2) without contact forces, of
            x > 0 and of x < 0.
        owner: (nt,) whose limit a contact force is part of. contact: (nt, 3, 1 + nz) the force.
    """

    room: np.ndarray
    noise: np.ndarray
    x: np.ndarray
    limit: np.ndarray
    owner: np.ndarray
    contact: np.ndarray


def _laws_of(
    problem: Problem,
    stuck: np.ndarray,
    direction: np.ndarray,
    obey: np.ndarray | None,
    X: np.ndarray,
) -> _Laws:
    """Return the laws of coordinates that have to obey; see `find_all` and `_rays_of`."""
    if obey is None:
        line = np.empty((0, X.shape[1]))
        none = np.empty((0, 2)), np.empty(0, np.int64), np.empty((0, 3, X.shape[1]))
        return _Laws(line, line, line, *none)
    R, first = problem.rate_slope, np.eye(1, X.shape[1])
    way = np.where(obey & ~stuck, direction, 0.0)
    moves = np.flatnonzero(way)
    rate = problem.rate_free[:, None] * first + R @ X
    terms = problem.rate_scale[:, None] * first + np.abs(R) @ np.abs(X)
    middle, box = np.empty((2, len(stuck)))
    write_box(problem, obey, direction, middle, box)
    boxed = np.flatnonzero(box < np.inf)
    centred = X[boxed] - middle[boxed, None] * first
    reach = box[boxed, None] * first
    size = np.abs(X[boxed]) + np.abs(middle)[boxed, None] * first + reach
    held = obey & stuck
    held[problem.gear_coordinate] = False  # what they hold is no limit
    below, above = np.empty((2, len(stuck)))
    stick_limits(problem, problem.constant, below, above)
    owner, grip = problem.coordinate[problem.contact_entry], problem.grip[problem.contact_entry]
    here = np.flatnonzero(held[owner] & (grip > 0.0))
    contact = np.einsum("tje,ju->teu", problem.contact[here], np.concatenate([first, X]))
    place = np.cumsum(held) - 1
    return _Laws(
        np.vstack([way[moves, None] * rate[moves], reach - centred, reach + centred]),
        _UNJUST * np.vstack([terms[moves], size, size]),
        X[held],
        np.stack([above[held], -below[held]], axis=1),
        place[owner[here]],
        np.ascontiguousarray(contact * grip[here, None, None]),
    )


class _Rays(NamedTuple):
    """The equations f(u) = 0 of the module's text, y in parts of its size at rest.

    Attributes:
        scale: (nz,) those sizes.
        place, gain: (nt,) of each contact force: whose friction it is part of, and how much.
        contact: (nt, 3, 1 + nz) the forces by u.
    """

    scale: np.ndarray
    place: np.ndarray
    gain: np.ndarray
    contact: np.ndarray


def _rays_of(reduced: Reduced) -> tuple[_Rays, np.ndarray]:
    """Return the equations, and X (nc, 1 + nz) of friction x = X u / tau."""
    _, X, offset, place, gain, contact = reduced
    sign, size, gains = np.zeros(len(offset)), np.zeros(len(offset)), np.abs(gain)
    sign[place] = np.sign(gain)
    first = contact[:, 0] + np.einsum("tje,j->te", contact[:, 1:], offset)
    np.add.at(size, place, gains * np.linalg.norm(first, axis=1))
    scale = np.maximum(size, 1e-3 * size.max(initial=1e-300))
    along = contact[:, 1:] * (sign * scale)[:, None]
    forces = np.concatenate([first[:, None], along], axis=1).transpose(0, 2, 1)
    rays = _Rays(scale, place, gains, np.ascontiguousarray(forces))
    return rays, np.column_stack([X[:, 0] + X[:, 1:] @ offset, X[:, 1:] * (sign * scale)])


class _Points(NamedTuple):
    """Corners of simplices, each computed once.

    Attributes:
        u: (n, 1 + nz). force: (n, nt, 3) contact forces. f: (n, nz).
        size: (n, nz) of the terms of f. broken: (n, m + 2 k) bool, laws.
    """

    u: np.ndarray
    force: np.ndarray
    f: np.ndarray
    size: np.ndarray
    broken: np.ndarray


@kernel
def look_everywhere(  # noqa: C901
    rays: _Rays, laws: _Laws, most: int, solutions: np.ndarray
) -> tuple[int, int, bool]:
    """Write all solutions u; return their number, that of simplices, and whether these were enough.

    Args:
        rays, laws: `_Rays`, `_Laws`.
        most: simplices. solutions: (>= most, 1 + nz), overwritten.
    """
    n, nt = 1 + rays.scale.size, rays.gain.size
    room = most + n
    points = _Points(
        np.zeros((room, n)),
        np.empty((room, nt, 3)),
        np.empty((room, n - 1)),
        np.empty((room, n - 1)),
        np.empty((room, laws.room.shape[0] + 2 * laws.x.shape[0]), np.bool_),
    )
    waiting, cut = np.empty((most + 2 * _AT_ONCE, n), np.int64), np.empty((_AT_ONCE, n), np.int64)
    for i in range(n):
        points.u[i, i] = 1.0
        waiting[0, i] = i
        _write_point(rays, laws, points, i)
    left, known, found, parts, complete = 1, n, 0, 0, True
    u = np.empty(n)
    while left > 0 and complete:
        first = max(0, left - _AT_ONCE)
        parts += left - first
        if parts > most:
            return found, parts, False
        cuts = 0
        for k in range(first, left):
            corners = waiting[k]
            outcome = _examine(rays, points, corners)
            if outcome == _EMPTY:
                continue
            small, done, near = True, False, False
            for j in range(1, n):
                for i in range(n):
                    gap = abs(points.u[corners[j], i] - points.u[corners[0], i])
                    small &= gap < _SMALL
            if outcome == _SINGLE or small:
                for j in range(found):
                    done |= _is_inside(points, corners, solutions[j])
                if not done:
                    for i in range(n):
                        u[i] = 0.0
                        for j in range(n):
                            u[i] += points.u[corners[j], i] / n
                    if _newton(rays, u) and u[0] > 0.0:
                        new = True
                        for j in range(found):
                            apart = 0.0
                            for i in range(n):
                                apart = max(apart, abs(u[i] - solutions[j, i]))
                            new &= apart > _DISTINCT
                        if new:
                            for i in range(n):
                                solutions[found, i] = u[i]
                            found += 1
                        done = _is_inside(points, corners, u)
                for j in range(found):
                    apart = 0.0
                    for i in range(n):
                        apart = max(apart, abs(solutions[j, i] - points.u[corners[0], i]))
                    near |= apart < 10.0 * _SMALL
                complete &= done or near or not small
            if not (small or done):
                for i in range(n):
                    cut[cuts, i] = corners[i]
                cuts += 1
        left = first + 2 * cuts
        for k in range(cuts):
            i, j = _longest_edge(points, cut[k])
            for e in range(n):
                points.u[known, e] = 0.5 * (points.u[cut[k, i], e] + points.u[cut[k, j], e])
                waiting[first + k, e] = waiting[first + cuts + k, e] = cut[k, e]
            waiting[first + k, i] = waiting[first + cuts + k, j] = known
            _write_point(rays, laws, points, known)
            known += 1
    return found, parts, complete


@kernel
def _write_point(rays: _Rays, laws: _Laws, points: _Points, c: int) -> None:
    """Write what a corner c, at `points.u[c]`, adds to bounds."""
    u, f, broken, n = points.u[c], points.f[c], points.broken[c], points.u.shape[1]
    # 1. the equations
    for k in range(n - 1):
        f[k] = rays.scale[k] * u[1 + k]
        points.size[c, k] = abs(f[k])
    for t in range(rays.gain.size):
        f[rays.place[t]] -= rays.gain[t] * _write_force(rays.contact[t], u, points.force[c, t])
    for k in range(n - 1):
        points.size[c, k] += abs(f[k])
    # 2. the laws: rates are linear, and friction less its limit is concave
    for r in range(laws.room.shape[0]):
        room = noise = 0.0
        for i in range(n):
            room += laws.room[r, i] * u[i]
            noise += laws.noise[r, i] * u[i]
        broken[r] = room < -noise
    load, p = np.zeros(laws.x.shape[0]), np.empty(3)
    for t in range(laws.owner.size):
        load[laws.owner[t]] += _write_force(laws.contact[t], u, p)
    for k in range(load.size):
        x, row = 0.0, laws.room.shape[0] + 2 * k
        for i in range(n):
            x += laws.x[k, i] * u[i]
        for side in range(2):
            most = (load[k] + laws.limit[k, side] * u[0]) * (1.0 + _UNJUST)
            broken[row + side] = (x if side == 0 else -x) > most


@kernel
def _write_force(contact: np.ndarray, u: np.ndarray, p: np.ndarray) -> float:
    """Write a force (3,) at u from its map (3, 1 + nz); return its size."""
    square = 0.0
    for e in range(3):
        p[e] = 0.0
        for i in range(u.size):
            p[e] += contact[e, i] * u[i]
        square += p[e] * p[e]
    return float(np.sqrt(square))


@kernel
def _write_slopes(rays: _Rays, e: np.ndarray, J: np.ndarray) -> None:
    """Write J = df/du (nz, 1 + nz) where forces are e (nt, 3); make these their directions."""
    for k in range(rays.scale.size):
        for j in range(J.shape[1]):
            J[k, j] = rays.scale[k] if j == 1 + k else 0.0
    for t in range(rays.gain.size):
        size = np.sqrt(e[t, 0] * e[t, 0] + e[t, 1] * e[t, 1] + e[t, 2] * e[t, 2])
        for c in range(3 if size > 0.0 else 0):
            e[t, c] /= size
        for j in range(J.shape[1]):
            along = 0.0
            for c in range(3):
                along += e[t, c] * rays.contact[t, c, j]
            J[rays.place[t], j] -= rays.gain[t] * along


@kernel
def _examine(rays: _Rays, points: _Points, corners: np.ndarray) -> int:  # noqa: C901
    """Return what bounds of f show of a simplex with these corners (1 + nz,).

    `_EMPTY`: there is no solution. `_SINGLE`: f is one to one, as forces keep their directions,
    nearly. Else `_OPEN`.
    """
    n, nz, nt = corners.size, corners.size - 1, rays.gain.size
    # 1. a law that all corners break
    for r in range(points.broken.shape[1]):
        i = 0
        while i < n and points.broken[corners[i], r]:
            i += 1
        if i == n:
            return _EMPTY
    # 2. f_k is at least what it is at a corner, and at most its tangent in the middle
    e, J, over, slack = np.zeros((nt, 3)), np.empty((nz, n)), np.empty((nz, n)), np.zeros(nz)
    for t in range(nt):
        for j in range(n):
            for c in range(3):
                e[t, c] += points.force[corners[j], t, c] / n
    _write_slopes(rays, e, J)
    for k in range(nz):
        least, most = np.inf, -np.inf
        for j in range(n):
            over[k, j] = 0.0
            for i in range(n):
                over[k, j] += J[k, i] * points.u[corners[j], i]
            least, most = min(least, points.f[corners[j], k]), max(most, over[k, j])
            slack[k] = max(slack[k], _ROUNDING * points.size[corners[j], k])
        if least > slack[k] or most < -slack[k]:
            return _EMPTY
    # 3. the same of W f, W the inverse of f's slopes along the edges
    A, W, size = np.zeros((nz, nz)), np.zeros((nz, nz)), 0.0
    for k in range(nz):
        W[k, k] = 1.0
        for j in range(nz):
            for i in range(n):
                A[k, j] += J[k, i] * (points.u[corners[1 + j], i] - points.u[corners[0], i])
    if not solve_dense(A, W):
        return _OPEN
    for k in range(nz):
        for i in range(nz):
            size += abs(W[k, i])
    if not size < np.inf:
        return _OPEN
    for k in range(nz):
        least, most, rounding = np.inf, -np.inf, 0.0
        for i in range(nz):
            rounding += abs(W[k, i]) * slack[i]
        for j in range(n):
            low = high = 0.0
            for i in range(nz):
                f = points.f[corners[j], i]
                low += W[k, i] * (f if W[k, i] > 0.0 else over[i, j])
                high += W[k, i] * (over[i, j] if W[k, i] > 0.0 else f)
            least, most = min(least, low), max(most, high)
        if least > rounding or most < -rounding:
            return _EMPTY
    # 4. how far directions turn
    E = np.zeros((nz, nz))
    for t in range(nt):
        least = np.inf
        for j in range(n):
            p = points.force[corners[j], t]
            size = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
            along = e[t, 0] * p[0] + e[t, 1] * p[1] + e[t, 2] * p[2]
            least = min(least, along / size if size > 0.0 else 0.0)
        if not least > 0.0:
            return _OPEN
        turn = np.sqrt(max(2.0 - 2.0 * least, 0.0))  # how far |e - e'| goes
        for j in range(nz):
            square = 0.0
            for c in range(3):
                gap = points.force[corners[1 + j], t, c] - points.force[corners[0], t, c]
                square += gap * gap
            E[rays.place[t], j] += rays.gain[t] * turn * np.sqrt(square)
    # 5. |W| E has a spectral radius below one: 1 - |W| E has positive pivots only
    for k in range(nz):
        for j in range(nz):
            A[k, j] = _CONTRACTS if k == j else 0.0
            for i in range(nz):
                A[k, j] -= abs(W[k, i]) * E[i, j]
    for k in range(nz):
        if not A[k, k] > 0.0:
            return _OPEN
        for i in range(k + 1, nz):
            factor = A[i, k] / A[k, k]
            for j in range(k + 1, nz):
                A[i, j] -= factor * A[k, j]
    return _SINGLE


@kernel
def _is_inside(points: _Points, corners: np.ndarray, u: np.ndarray) -> bool:
    """Return whether a point (1 + nz,) is in a simplex."""
    n, least = corners.size, np.inf
    V, share = np.empty((n, n)), np.empty((n, 1))
    for i in range(n):
        share[i, 0] = u[i]
        for j in range(n):
            V[i, j] = points.u[corners[j], i]
    if not solve_dense(V, share):
        return False
    for i in range(n):
        least = min(least, share[i, 0])
    return least >= -1e-9


@kernel
def _newton(rays: _Rays, u: np.ndarray) -> bool:
    """Bring a point (1 + nz,) to a solution near it; False: there is none.

    So it is where rounding of f could move it to tau = 0: a solution at infinity.
    """
    n, nt = u.size, rays.gain.size
    f, e, J = np.empty(n - 1), np.empty((nt, 3)), np.empty((n - 1, n))
    A, inverse = np.empty((n, n)), np.empty((n, n))
    for _ in range(_PASSES):
        most = rounding = 0.0
        for k in range(n - 1):
            f[k] = rays.scale[k] * u[1 + k]
            rounding = max(rounding, _FOUND * (7 + n) * abs(f[k]))
        for t in range(nt):
            f[rays.place[t]] -= rays.gain[t] * _write_force(rays.contact[t], u, e[t])
        _write_slopes(rays, e, J)
        for k in range(n):
            most = max(most, abs(f[k]) if k < n - 1 else 0.0)
            for j in range(n):
                A[k, j] = J[k, j] if k < n - 1 else 1.0
                inverse[k, j] = 1.0 if k == j else 0.0
        if not solve_dense(A, inverse):
            return False
        if most <= rounding:
            far = total = 0.0
            for i in range(n):
                far += abs(inverse[0, i]) * rounding if i < n - 1 else 0.0
                total += u[i]
            for i in range(n):
                u[i] /= total
            return far <= _KNOWN * u[0] * total
        for i in range(n):
            for k in range(n - 1):
                u[i] -= inverse[i, k] * f[k]
            if not abs(u[i]) < np.inf or u[i] < -1.0:
                return False
    return False


@kernel
def _longest_edge(points: _Points, corners: np.ndarray) -> tuple[int, int]:
    """Return the places of the corners between which a simplex is longest."""
    longest, first, second = -1.0, 0, 0
    for i in range(corners.size):
        for j in range(i + 1, corners.size):
            square = 0.0
            for e in range(corners.size):
                gap = points.u[corners[i], e] - points.u[corners[j], e]
                square += gap * gap
            if np.sqrt(square) > longest:  # as the root: equal lengths are
                longest, first, second = np.sqrt(square), i, j
    return first, second
