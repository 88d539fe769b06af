"""The friction that rests with the least use of its static limits, and the search for it.

At rest all is affine in the friction x of the coordinates that could move:

    A x = b, so x = x_0 + N z;      p_i = P_i0 + P_i x;      limit_k = constant_k + sum_i mu_i |p_i|

The *use* of x is the largest |x_k| / limit_k. With the limits' tangents at hand, which lie below
them, one linear program finds the x with the largest margin at the present use; its true use is
smaller. So it falls, to a stationary point; where limits follow loads there may be several.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.dense import spectral_radius_bound
from pinfric.friction.minimax import least_violation
from pinfric.friction.problem import Problem
from pinfric.model.compiled import kernel

#: Limits are not smaller than this many times the largest one: zero over zero has no use.
_LEAST_LIMIT = 1e-9
#: Descent ends where a program lowers the use by less than this (relative), or after so many.
_STAYS, _PROGRAMS = 1e-9, 60
#: Its longest step, so many times the friction that it starts from.
_FAR = 1e6
#: Friction looked at is at most this many times the limits, where friction can wedge itself.
_WEDGED = 50.0
#: Singular values below this many times the largest are zero.
_FLAT = 1e-9


class Rest(NamedTuple):
    """What rests, as numbers: n coordinates, dz of them free to share, nf contact forces.

    Attributes:
        x0: (n,) a friction in equilibrium. N: (n, dz) what may be added to it, x = x0 + N z.
        above, below: (n,) constant part of the limits of x > 0 and of x < 0.
        force, slope: (nf, 2), (nf, 2, dz): contact force p = force + slope z, in its plane.
        owner: (nf,) coordinate whose limit it is part of. weight: (nf,) mu of it.
        on_a_line: (nf,) bool, whether it has one direction and its opposite only.
        box: (n,) magnitude of x up to which is looked. reach: (dz,) what that means for z.
        low, high: (nf, 2) what that means for the contact forces.
    """

    x0: np.ndarray
    N: np.ndarray
    above: np.ndarray
    below: np.ndarray
    force: np.ndarray
    slope: np.ndarray
    owner: np.ndarray
    weight: np.ndarray
    on_a_line: np.ndarray
    box: np.ndarray
    reach: np.ndarray
    low: np.ndarray
    high: np.ndarray


def make_rest(
    problem: Problem, resting: np.ndarray, A: np.ndarray, b: np.ndarray
) -> tuple[Rest, bool, bool]:
    """Arrays of the resting coordinates; whether all forces lie in planes; whether none wedges."""
    number = np.full(len(problem.rate_free), -1)
    number[resting] = np.arange(len(resting))
    site = number[problem.coordinate]
    size, ahead = np.abs(problem.ratio), problem.ratio > 0.0
    coulomb = np.where(ahead[:, None], problem.coulomb_stick, problem.coulomb_stick[:, ::-1])
    held = site >= 0
    constant = size[held, None] * (
        (problem.mu_stick * problem.constant)[held, None] + coulomb[held]
    )
    below, above = (np.bincount(site[held], constant[:, i], len(resting)) for i in (0, 1))
    weight = (size * problem.mu_stick)[problem.contact_site]
    counts = (weight > 0.0) & held[problem.contact_site]
    owner = site[problem.contact_site][counts]
    free, slope, weight = (
        problem.contact_free[counts],
        problem.contact_slope[counts],
        weight[counts],
    )
    maps = np.concatenate([free[:, None], slope[:, resting]], axis=1).transpose(0, 2, 1)
    left, values, _ = np.linalg.svd(maps, full_matrices=False)
    values = np.pad(values, ((0, 0), (0, 3 - values.shape[1])))
    rank = (values > _FLAT * np.maximum(values[:, :1], 1e-300)).sum(axis=1)
    plane = left[:, :, :2].transpose(0, 2, 1)
    P = plane @ maps  # (nf, 2, 1 + n)
    limit = np.bincount(owner, weight * np.linalg.norm(P[:, :, 0], axis=1), len(resting))
    limit = limit + np.maximum(above, below)
    x0, N = _equilibrium(A, b, np.maximum(limit, _LEAST_LIMIT * limit.max(initial=1e-300)))
    C = np.zeros((len(resting), len(resting)))
    np.add.at(C, owner, weight[:, None] * np.linalg.norm(P[:, :, 1:], axis=1))
    certain = spectral_radius_bound(C, np.empty(len(C))) < 1.0 - 1e-3
    box = np.linalg.solve(np.eye(len(C)) - C, limit) if certain else _WEDGED * limit
    box = np.maximum(box, 0.0 if certain else 2.0 * np.abs(x0))
    reach = np.abs(np.linalg.pinv(N)) @ (box + np.abs(x0))
    P[rank <= 1, 1] = 0.0
    force, slope = P[:, :, 0] + P[:, :, 1:] @ x0, P[:, :, 1:] @ N
    around, spread = np.abs(P[:, :, 1:]) @ box, np.abs(slope) @ reach
    rest = Rest(
        x0=x0,
        N=N,
        above=above,
        below=below,
        force=np.ascontiguousarray(force),
        slope=np.ascontiguousarray(slope),
        owner=owner.astype(np.int64),
        weight=weight,
        on_a_line=rank <= 1,
        box=box,
        reach=reach,
        low=np.maximum(P[:, :, 0] - around, force - spread),
        high=np.minimum(P[:, :, 0] + around, force + spread),
    )
    return rest, bool((rank <= 2).all()), bool(certain)


def _equilibrium(A: np.ndarray, b: np.ndarray, limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The x of A x = b with the least sum of squared uses, and a basis of what keeps it there."""
    _, _, right = np.linalg.svd(A * limit)
    N = np.ascontiguousarray((right[len(b) :] * limit).T)
    N /= np.linalg.norm(N, axis=0) if N.size else 1.0
    return limit * np.linalg.lstsq(A * limit, b, rcond=None)[0], N


@kernel
def friction_and_limits(
    rest: Rest, z: np.ndarray, x: np.ndarray, above: np.ndarray, below: np.ndarray
) -> float:
    """Write x (n,) and the limits of x > 0 and x < 0 (n,) at z (dz,); return the use."""
    n, dz = rest.N.shape
    most = 0.0
    for k in range(n):
        x[k], above[k], below[k] = rest.x0[k], rest.above[k], rest.below[k]
        for j in range(dz):
            x[k] += rest.N[k, j] * z[j]
    for i in range(rest.owner.size):
        square = 0.0
        for e in range(2):
            p = rest.force[i, e]
            for j in range(dz):
                p += rest.slope[i, e, j] * z[j]
            square += p * p
        load = rest.weight[i] * np.sqrt(square)
        above[rest.owner[i]] += load
        below[rest.owner[i]] += load
    for k in range(n):
        most = max(most, above[k], below[k])
    use = 0.0
    for k in range(n):
        above[k] = max(above[k], _LEAST_LIMIT * most)
        below[k] = max(below[k], _LEAST_LIMIT * most)
        if x[k] != 0.0:
            limit = above[k] if x[k] > 0.0 else below[k]
            use = max(use, abs(x[k]) / limit if limit > 0.0 else np.inf)
    return use


@kernel
def descend(rest: Rest, z: np.ndarray) -> float:
    """Lower the use from z on, one linear program a step; return it, and overwrite z (dz,).

    Where friction can wedge itself the use may fall towards a friction without bound. Steps grow
    with it, but so far only that what balances is not lost beside it in rounding.
    """
    n, dz = rest.N.shape
    x, above, below = np.empty(n), np.empty(n), np.empty(n)
    use = friction_and_limits(rest, z, x, above, below)
    if dz == 0 or not use < np.inf:
        return use
    G, h, s = np.empty((2 * n, dz)), np.empty(2 * n), np.empty(2 * n)
    tangent, step, trial = np.empty((n, dz)), np.empty(dz), np.empty(dz)
    farthest = np.inf
    for _ in range(_PROGRAMS):
        for k in range(n):
            for j in range(dz):
                tangent[k, j] = 0.0
        for i in range(rest.owner.size):
            px, py = rest.force[i, 0], rest.force[i, 1]
            for j in range(dz):
                px += rest.slope[i, 0, j] * z[j]
                py += rest.slope[i, 1, j] * z[j]
            size = np.sqrt(px * px + py * py)
            if size > 0.0:  # a norm of zero has no tangent; zero is one of its subgradients
                for j in range(dz):
                    along = px * rest.slope[i, 0, j] + py * rest.slope[i, 1, j]
                    tangent[rest.owner[i], j] += rest.weight[i] * along / size
        largest = 0.0
        for k in range(n):
            for side in range(2):
                r, sign = 2 * k + side, 1.0 - 2.0 * side
                limit = above[k] if side == 0 else below[k]
                s[r] = limit
                h[r] = sign * x[k] - use * limit
                for j in range(dz):
                    G[r, j] = sign * rest.N[k, j] - use * tangent[k, j]
                largest = max(largest, limit * max(use, 1.0), abs(x[k]))
        farthest = min(farthest, _FAR * largest)
        least_violation(G, h, s, 2 * n, min(10.0 * largest, farthest), step)
        for j in range(dz):
            trial[j] = z[j] + step[j]
        before, new = use, friction_and_limits(rest, trial, x, above, below)
        if new < before:
            use = new
            for j in range(dz):
                z[j] = trial[j]
        if not new < before * (1.0 - _STAYS):
            break
    return use
