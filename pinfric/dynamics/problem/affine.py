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
    unique = True
    if free.shape[1] > 0:
        n, columns = closure.shared, y.shape[1]
        under_y, among = np.empty((n, 6, columns)), np.empty((n, 6, y.shape[0]))
        for row in range(n):
            for e in range(6):
                for r in range(y.shape[0]):
                    among[row, e, r] = X[joint[row], e, first + r]
                for k in range(columns):
                    under_y[row, e, k] = wrench[row, e, k]
            add_products(among[row], 0, y, under_y[row])
        unique = share_redundant(under_y, among, free, closure.inverse_length, y)
    for row in range(joint.size):
        add_products(X[joint[row]], first, y, wrench[row])
    return unique


@kernel
def share_redundant(
    given: np.ndarray, among: np.ndarray, free: np.ndarray, inverse_length: float, y: np.ndarray
) -> bool:
    """Choose the free part of y (ny, columns) so that sum |F|^2 + |M/l|^2 is least.

    The sum is over all joints, including those of loops. So the choice does not depend on where a
    loop was cut, and it is again affine in friction.

    Args:
        given: (n, 6, columns) wrenches of all joints under y as it is.
        among: (n, 6, ny) their change per unit y.
        free: (ny, nf) what may be added to y.
        inverse_length: 1/l (1/m).

    Returns:
        False where the least is not unique.
    """
    (ny, nf), columns = free.shape, y.shape[1]
    work, order = np.zeros((nf, nf + columns)), np.empty(nf, np.int64)
    along = np.empty(nf)
    for j in range(given.shape[0]):
        for e in range(6):
            weight = 1.0 if e < 3 else inverse_length * inverse_length
            for f in range(nf):
                along[f] = 0.0
                for c in range(ny):
                    along[f] += among[j, e, c] * free[c, f]
            for f in range(nf):
                for g in range(nf):
                    work[f, g] += weight * along[f] * along[g]
                for n in range(columns):
                    work[f, nf + n] -= weight * along[f] * given[j, e, n]
    if eliminate_full_pivot(work, nf, order, 0.0) < nf:
        return False
    for f in range(nf):
        for n in range(columns):
            for c in range(ny):
                y[c, n] += free[c, order[f]] * work[f, nf + n]
    return True


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
