"""Reactions and contact forces as maps of friction, for forward and inverse dynamics.

    w_j = known_j + X_j (friction along actions, y),     A y = B,     p = (map + s map_moved) w

y are the multipliers, in inverse dynamics after the efforts of drives off the joints. Every map has
1 + n columns: [..., 0] + [..., 1:] x, x the friction.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.plan import Closure, Plan
from pinfric.friction.dense import eliminate_full_pivot
from pinfric.kernels.compiled import kernel


@kernel
def solve_balance(A: np.ndarray, scale: float, y: np.ndarray, free: np.ndarray) -> int:
    """Write one solution of A[:, :ny] y = A[:, ny:], and its null space; return the rank.

    Full pivoting, the paper's choice, finds the rank. A rank below the number of rows: there may be
    no solution.

    Args:
        A: (nr, ny + columns), overwritten.
        scale: pivots small beside it are zero.
        y: (ny, columns), overwritten.
        free: (ny, ny), overwritten: its first ny - rank columns.
    """
    ny, columns = y.shape
    order = np.empty(ny, np.int64)
    rank = eliminate_full_pivot(A, ny, order, scale)
    for r in range(ny):
        for k in range(columns):
            y[order[r], k] = A[r, ny + k] if r < rank else 0.0
        for f in range(ny):
            free[order[r], f] = 0.0
        if r >= rank:
            free[order[r], r - rank] = 1.0
            continue
        for f in range(ny - rank):
            free[order[r], f] = -A[r, rank + f]
    return rank


@kernel
def add_friction(X: np.ndarray, action: np.ndarray, wrench: np.ndarray) -> None:
    """Add to the map of a joint's wrench (6, 1 + n) the friction that acts along actions.

    Args:
        X: (6, nx) what actions do to the joint.
        action: (n,) of each friction; -1: it acts in a joint of the tree.
        wrench: added to.
    """
    for k in range(action.size):
        if action[k] >= 0:
            for e in range(6):
                wrench[e, 1 + k] += X[e, action[k]]


@kernel
def add_products(A: np.ndarray, first: int, y: np.ndarray, out: np.ndarray) -> None:
    """Add A[:, first : first + ny] y (ny, columns) to out (6, columns); A is (6, n)."""
    for e in range(6):
        for r in range(y.shape[0]):
            if A[e, first + r] != 0.0:
                for n in range(y.shape[1]):
                    out[e, n] += A[e, first + r] * y[r, n]


@kernel
def add_reactions(
    closure: Closure,
    joint: np.ndarray,
    X: np.ndarray,
    first: int,
    free: np.ndarray,
    y: np.ndarray,
    wrench: np.ndarray,
) -> bool:
    """Add to wrenches the effect of y, after y was chosen where reactions are redundant.

    Args:
        closure: of the scene.
        joint: (nr,) of the wrenches.
        X: (nj + pairs, 6, nx), `kinematics.act_on_joints`.
        first: where in it the columns of y begin.
        free: (ny, nf) what may be added to y.
        y: (ny, columns), changed where nf > 0.
        wrench: (nr, 6, columns), added to.

    Returns:
        False where no way to share is the best.
    """
    unique, (ny, nf), columns = True, free.shape, y.shape[1]
    if nf > 0:
        rows = 6 * closure.shared
        given, along, weight = np.empty((rows, columns)), np.zeros((rows, nf)), np.ones(rows)
        for i in range(rows):
            row, e = i // 6, i % 6
            if e > 2:
                weight[i] = closure.inverse_length * closure.inverse_length
            for k in range(columns):
                given[i, k] = wrench[row, e, k]
            for r in range(ny):
                x = X[joint[row], e, first + r]
                for k in range(columns):
                    given[i, k] += x * y[r, k]
                for f in range(nf):
                    along[i, f] += x * free[r, f]
        unique = share(given, along, weight, free, y, np.empty((ny, 0))) == nf
    for row in range(joint.size):
        add_products(X[joint[row]], first, y, wrench[row])
    return unique


@kernel
def share(
    given: np.ndarray,
    along: np.ndarray,
    weight: np.ndarray,
    free: np.ndarray,
    y: np.ndarray,
    left: np.ndarray,
) -> int:
    """Choose the free part of y so that the sum of weight |given + along z|^2 is least; return how
    many ways that takes.

    Redundant closures share reactions so, sum |F|^2 + |M/l|^2 over all joints, those of loops, too:
    the choice does not depend on where a loop was cut. Redundant drives share work. It is again
    affine in friction.

    Args:
        given, along: (m, columns), (m, nf) what is weighted, and its change with z.
        weight: (m,).
        free: (ny, nf) what may be added to y: free z.
        y: (ny, columns), changed.
        left: (ny, as many as wanted), overwritten: what may still be added.
    """
    (ny, nf), columns = free.shape, y.shape[1]
    work, order = np.zeros((nf, nf + columns)), np.empty(nf, np.int64)
    for i in range(weight.size):
        for f in range(nf if weight[i] > 0.0 else 0):
            for g in range(nf):
                work[f, g] += weight[i] * along[i, f] * along[i, g]
            for n in range(columns):
                work[f, nf + n] -= weight[i] * along[i, f] * given[i, n]
    rank = eliminate_full_pivot(work, nf, order, 0.0)
    for c in range(ny):
        for f in range(rank):
            for n in range(columns):
                y[c, n] += free[c, order[f]] * work[f, nf + n]
        for f in range(min(nf - rank, left.shape[1])):
            left[c, f] = free[c, order[rank + f]]
            for r in range(rank):
                left[c, f] -= free[c, order[r]] * work[r, rank + f]
    return rank


@kernel
def write_contacts(plan: Plan, q: np.ndarray, wrench: np.ndarray, contact: np.ndarray) -> bool:
    """Write contact forces as maps of friction; False: not finite.

    Args:
        plan: says of which wrench each is a part.
        q: (nq,).
        wrench: (nr, 6, columns) of the joints that are wanted.
        contact: (nt, columns, 3), overwritten as far as its ranks go.
    """
    t, sites, total = plan.contacts, plan.sites, 0.0
    row = np.empty(6)
    for i in range(t.owner.size):
        s = t.site[i]
        j = t.site_row[s]
        moved = sites.displacement_shift[s]
        moved += sites.displacement_ratio[s] * q[sites.displacement_q[s]]
        for e in range(t.rank[i]):
            for m in range(6):
                row[m] = t.map[i, e, m] + moved * t.map_moved[i, e, m]
            for n in range(contact.shape[1]):
                force = 0.0
                for m in range(6):
                    force += row[m] * wrench[j, m, n]
                contact[i, n, e] = force
                total += abs(force)
    return total < np.inf
