"""The search for the friction of resting joints with the least use of its static limits.

At rest all is affine in the friction x of the coordinates that could move:

    A x = b, so x = x_0 + N z;      p_i = P_i0 + P_i x;      limit_k = constant_k + sum_i mu_i |p_i|

The *use* of x is the largest |x_k| / limit_k. With tangents of the limits, which lie below them,
one linear program after the other lowers it to a stationary point (`notebooks/theory/resting.md`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.balance import Balance
from pinfric.friction.dense import spectral_radius_bound
from pinfric.friction.law import add_load_slopes, contact_force, stick_limits, write_loads
from pinfric.friction.minimax import least_violation
from pinfric.friction.problem import Problem
from pinfric.kernels.compiled import kernel

#: Rounding of friction, relative to the terms that it balances; and of its unit, relative to the
#: terms that rates are the sum of.
NOISE, _LEAST_UNIT = 1e-12, 1e-15
#: Descent ends if a program leaves more than this share of the use, or after so many programs.
_STAYS, _PROGRAMS = 1.0 - 1e-9, 60
#: Where friction can wedge itself, frictions up to this many times the limits are searched.
_WEDGED = 50.0
#: Singular values below this many times the largest are zero.
_FLAT = 1e-9


class Rest(NamedTuple):
    """Arrays of resting joints: n coordinates, dz of them free to share, nf contact forces.

    Frictions and limits are in `unit`, contact forces in that of their owner, times its mu.

    Attributes:
        unit: (n,) N m or N.
        x0: (n,) a friction in equilibrium. N: (n, dz) what may be added to it, x = x0 + N z.
        above, below: (n,) constant part of the limits of x > 0 and of x < 0; inf: no limit.
        least: (n,) rounding of the friction; limits are not below it.
        contact: (nf, 1 + dz, 3) contact forces p = contact (1, z), in axes of their own; the last
            is zero for those that lie in a plane.
        owner: (nf,) coordinate whose limit it is part of.
        on_a_line: (nf,) bool, whether it has one direction and its opposite only.
        box: (n,) largest magnitude of x that is searched. reach: (dz,) the same for z.
        low, high: (nf, 3) the same for the contact forces.
    """

    unit: np.ndarray
    x0: np.ndarray
    N: np.ndarray
    above: np.ndarray
    below: np.ndarray
    least: np.ndarray
    contact: np.ndarray
    owner: np.ndarray
    on_a_line: np.ndarray
    box: np.ndarray
    reach: np.ndarray
    low: np.ndarray
    high: np.ndarray


def make_rest(
    problem: Problem, members: np.ndarray, balance: Balance
) -> tuple[Rest, Rest, bool, bool]:
    """Return arrays of coordinates at rest, whether all forces lie in planes, whether none wedges.

    Args:
        members: (n,) the coordinates.
        balance: what their friction balances.

    Returns:
        The arrays with a box beyond which no friction holds, if there is one; those with a wide
        box; and both answers.
    """
    n = len(members)
    # 1. static limits, and the contact forces of which they are functions: (nf, 1 + n, 3) by x
    number = np.full(len(problem.rate_free), -1)
    number[members] = np.arange(n)
    below, above = np.empty((2, len(number)))
    stick_limits(problem, problem.constant, below, above)
    below, above = -below[members], above[members]
    lower, higher = np.minimum(above, below), np.maximum(above, below)
    unlimited, weight = np.isinf(higher), problem.grip[problem.contact_entry]
    owner = number[problem.coordinate[problem.contact_entry]]
    counts = np.flatnonzero((weight > 0.0) & (owner >= 0) & np.isfinite(lower)[owner])
    owner = owner[counts].astype(np.int64)
    by_x = problem.contact[counts][:, np.append(0, 1 + members)] * weight[counts, None, None]
    by_x = np.ascontiguousarray(by_x)
    # 2. a friction in equilibrium, of the least sum of squared uses, and its limits as units
    slopes = np.diag(problem.rate_slope)[members]
    natural = problem.rate_scale[members] / np.where(slopes > 0.0, slopes, np.inf)
    x, start = np.zeros(n), None
    for _ in range(2):
        unit = np.empty(n)
        write_loads(by_x, owner, np.where(unlimited, lower, higher), x, unit)
        # a gear that locks may have no limit one way, and 0 the other: neither is a unit
        endless = np.isinf(unit) | (unlimited & (unit < natural))
        unit[endless] = np.maximum(np.abs(x), natural)[endless]
        unit = np.maximum(unit, NOISE * natural)
        positive = unit[unit > 0.0]
        unit[unit == 0.0] = NOISE * positive.max() if positive.size else 1.0
        shared = balance.eliminate(unit, unlimited)
        free = shared.free
        if start is None:
            uses = shared.N / unit[:, None]
            uses[unlimited] = 0.0
            z = -np.linalg.lstsq(uses * unit[free], shared.x0 / unit, rcond=None)[0]
            start = shared.x0 + shared.N @ (unit[free] * z)
        x = shared.x0 + shared.N @ start[free]
    # 3. contact forces by z, in axes of their own
    of_z = np.zeros((1 + len(free), 1 + n))  # (1, x) = (1, z) of_z
    of_z[0, 0], of_z[0, 1:], of_z[1:, 1:] = 1.0, x, (shared.N * unit[free]).T
    contact = (of_z @ by_x) / unit[owner, None, None]
    axes, rank = _axes(contact)
    # 4. a box: what holds obeys |x| <= limit(0) + C |x|, unless friction can wedge itself; x that
    # follows from others' is replaced by them
    maps = by_x + shared.follow.T @ by_x[:, 1:]
    maps[:, 1:] *= np.where(shared.follows, 0.0, unit)[:, None]
    C = np.zeros((n, 1 + n))
    np.add.at(C, owner, np.linalg.norm(maps, axis=2) / unit[owner, None])
    C[:, 0] += np.where(unlimited, 0.0, higher) / unit
    C[unlimited] = 0.0
    contracts = not C[:, 1:][:, unlimited & ~shared.follows].any()
    contracts = contracts and spectral_radius_bound(C[:, 1:].copy(), np.empty(n)) < 1.0 - 1e-3
    box = np.linalg.solve(np.eye(n) - C[:, 1:], C[:, 0]) if contracts else np.zeros(n)
    least = np.maximum(NOISE * shared.noise / unit, _LEAST_UNIT)
    uses = np.abs(x / unit)[~unlimited]
    wide = np.maximum(box, max(_WEDGED, 2.0 * float(uses.max(initial=0.0))))
    wide[shared.follows] = np.inf
    narrow = np.where(unlimited, wide, box + least) if contracts else wide
    arrays = Rest(
        unit=unit,
        x0=x / unit,
        N=np.ascontiguousarray(shared.N * (unit[free] / unit[:, None])),
        above=above / unit,
        below=below / unit,
        least=least,
        contact=np.ascontiguousarray(contact @ axes),
        owner=owner,
        on_a_line=rank <= 1,
        box=wide,
        reach=wide[free],
        low=np.empty((len(rank), 3)),
        high=np.empty((len(rank), 3)),
    )
    maps = maps @ axes / unit[owner, None, None]
    return (
        _boxed(arrays, narrow, free, maps),
        _boxed(arrays, wide, free, maps),
        bool((rank <= 2).all()),
        bool(contracts),
    )


def _axes(contact: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return axes (nf, 3, 3) of contact forces, their columns, and ranks (nf,).

    What forces do not reach has an axis of zero: the third where they lie in a plane.
    """
    size = np.linalg.norm(contact, axis=2).sum(axis=1)
    size[size == 0.0] = 1.0
    maps = contact.transpose(0, 2, 1) / size[:, None, None]
    axes, values, _ = np.linalg.svd(maps)
    rank = (values > _FLAT * np.maximum(values[:, :1], 1e-300)).sum(axis=1)
    axes[rank <= 1, :, 1:] = axes[rank <= 2, :, 2:] = 0.0
    return axes, rank


def _boxed(rest: Rest, box: np.ndarray, free: np.ndarray, maps: np.ndarray) -> Rest:
    """Limit frictions to a box (n,); maps (nf, 1 + n, 3) are the contact forces by x."""
    reach = box[free]
    around = np.where(np.isfinite(box), box, 0.0) @ np.abs(maps[:, 1:])
    spread = reach @ np.abs(rest.contact[:, 1:])
    return rest._replace(
        box=box,
        reach=reach,
        low=np.maximum(maps[:, 0] - around, rest.contact[:, 0] - spread),
        high=np.minimum(maps[:, 0] + around, rest.contact[:, 0] + spread),
    )


@kernel
def friction_and_limits(
    rest: Rest, z: np.ndarray, x: np.ndarray, above: np.ndarray, below: np.ndarray
) -> float:
    """Write x (n,) and the limits of x > 0 and x < 0 (n,) at z (dz,); return the use."""
    n, dz = rest.N.shape
    for k in range(n):
        x[k], above[k], below[k] = rest.x0[k], rest.above[k], rest.below[k]
        for j in range(dz):
            x[k] += rest.N[k, j] * z[j]
    p = np.empty(3)
    for i in range(rest.owner.size):
        load = contact_force(rest.contact, i, z, p)
        above[rest.owner[i]] += load
        below[rest.owner[i]] += load
    use = 0.0
    for k in range(n):
        above[k] = max(above[k], rest.least[k])
        below[k] = max(below[k], rest.least[k])
        use = max(use, abs(x[k]) / (above[k] if x[k] > 0.0 else below[k]))
    return use


@kernel
def write_limit(
    rest: Rest,
    x: np.ndarray,
    r: int,
    use: float,
    limit: float,
    G: np.ndarray,
    h: np.ndarray,
    s: np.ndarray,
) -> None:
    """Write the rows |x_k| - use limit <= m and |x_k| - box_k <= m of a linear program, one way.

    Args:
        x: (n,) friction from which z is counted.
        r: the row of the limit, 2 k for x_k > 0, 2 k + 1 for x_k < 0; that of the box is 2 n below.
        use: how much of the limit. limit: inf: there is none, the row says nothing.
        G, h, s: (>= 4 n, dz), (>= 4 n,) twice: G z + h <= m s.
    """
    n, dz = rest.N.shape
    k, sign = r // 2, 1.0 - 2.0 * (r % 2)
    for part in range(2):
        row, most = r + part * 2 * n, limit if part == 0 else rest.box[k]
        s[row] = 1.0
        h[row] = -2.0 * (1.0 + use)  # m is at least -use
        if most < np.inf:
            h[row] = sign * x[k] - (use * most if part == 0 else most)
        for j in range(dz):
            G[row, j] = sign * rest.N[k, j] if most < np.inf else 0.0


@kernel
def descend(rest: Rest, z: np.ndarray) -> float:
    """Lower the use from z on, one linear program a step; return it, and overwrite z (dz,).

    Only the box is searched: friction that can wedge itself may grow without bound.
    """
    n, dz = rest.N.shape
    x, above, below = np.empty(n), np.empty(n), np.empty(n)
    use = friction_and_limits(rest, z, x, above, below)
    if dz == 0 or use == 0.0:
        return use
    G, h, s = np.empty((4 * n, dz)), np.empty(4 * n), np.empty(4 * n)
    trial, every = np.empty(dz), np.ones(rest.owner.size)
    for _ in range(_PROGRAMS):
        tangent, largest = np.zeros((n, dz)), 1.0
        add_load_slopes(rest.contact, rest.owner, every, z, tangent)
        for k in range(n):
            largest = max(largest, abs(x[k]))
            for r, limit in ((2 * k, above[k]), (2 * k + 1, below[k])):
                write_limit(rest, x, r, use, limit, G, h, s)
                if limit < np.inf:
                    s[r] = limit
                    for j in range(dz):
                        G[r, j] -= use * tangent[k, j]
        least_violation(G, h, s, 4 * n, 10.0 * largest, trial)
        for j in range(dz):
            trial[j] += z[j]
        before, new = use, friction_and_limits(rest, trial, x, above, below)
        if new < before:
            use = new
            for j in range(dz):
                z[j] = trial[j]
        if not new < before * _STAYS:
            break
    return use
