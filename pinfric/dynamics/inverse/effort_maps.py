"""What friction does to efforts, multipliers and bearing loads of a given motion: all of it affine.

    M a + h = S u + J_c^T lambda + D phi,     y = [u off the joints; lambda],     A y = b - B phi

(paper eq. 7, 16, 17). Drives on joints of the tree only balance their own row, so A has the other
rows. Full pivoting, the paper's choice, finds its rank: fewer than its rows is a toggle, where
drives cannot balance the load; fewer than its columns, redundant drives, which share the work such
that the sum of u^2 / share is least, and redundant closures (`maps.share_redundant`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.dynamics.problem.layout import Layout
from pinfric.dynamics.problem.maps import add_products, along, share_redundant
from pinfric.friction.dense import eliminate_full_pivot
from pinfric.kernels.compiled import kernel


class EffortTables(NamedTuple):
    """The part of `Layout` that these kernels read: each call copies all fields of a tuple."""

    drive_v: np.ndarray
    drive_action: np.ndarray
    balanced: np.ndarray
    part: np.ndarray
    delivery: np.ndarray
    cost: np.ndarray
    shifts: int
    joint: np.ndarray
    n_tree: int
    sharing: int
    entry_v: np.ndarray
    entry_action: np.ndarray
    entry_ratio: np.ndarray
    contact_site: np.ndarray
    contact_rank: np.ndarray
    contact_map: np.ndarray
    contact_map_moved: np.ndarray
    inverse_length: float
    scale: float

    @classmethod
    def of(cls, layout: Layout) -> EffortTables:
        """Take the part that is needed."""
        return cls(*(getattr(layout, name) for name in cls._fields))


class Maps(NamedTuple):
    """Everything of a batch as a function of the friction: [:, ..., 0] + [:, ..., 1:] phi.

    Attributes:
        effort: (n, na, 1 + ne), of the drives (N m or N).
        y: (n, ny, 1 + ne), off-joint efforts, then multipliers.
        contact: (n, nt, 1 + ne, 3), weighted contact forces of the bearings (N m or N).
        singular: (n,) bool: the drives cannot balance the load here, or the closure changes rank.
    """

    effort: np.ndarray
    y: np.ndarray
    contact: np.ndarray
    singular: np.ndarray

    @classmethod
    def of(cls, layout: Layout, n: int) -> Maps:
        """Make the arrays for n samples."""
        columns = 1 + len(layout.entry_site)
        return cls(
            np.empty((n, len(layout.drive_v), columns)),
            np.empty((n, layout.solved, columns)),
            np.empty((n, len(layout.contact_site), columns, 3)),
            np.empty(n, dtype=np.bool_),
        )


@kernel
def map_friction(
    t: EffortTables,
    wrench: np.ndarray,
    total_effort: np.ndarray,
    X: np.ndarray,
    J: np.ndarray,
    displacement: np.ndarray,
    maps: Maps,
) -> None:
    """Write efforts, multipliers and contact forces of a batch as affine functions of friction.

    Args:
        t: `EffortTables`.
        wrench: (n, nj, 6), of the tree's joints without multipliers, drives off the joints and
            friction: RNEA of the twin.
        total_effort: (n, nv), M a + h.
        X, J: (n, nj + pairs, 6, nx), (n, nx, nv), `kinematics.act_on_joints`.
        displacement: (n, ns) of each site along its axis, or (0, 0) where it does not matter.
        maps: overwritten.
    """
    columns = maps.effort.shape[2]
    site_wrench, row = np.empty((1, 6, columns)), np.empty(6)
    maps.contact[:] = 0.0
    for i in range(wrench.shape[0]):
        y = maps.y[i]
        maps.singular[i] = not _balance(t, wrench[i], total_effort[i], X[i], J[i], y)
        if maps.singular[i]:
            for c in range(y.shape[0]):
                for k in range(columns):
                    y[c, k] = np.nan
        _write_efforts(t, total_effort[i], J[i], y, maps.effort[i])
        site = -1
        for n in range(t.contact_site.size):
            s = t.contact_site[n]
            if s != site:
                site = s
                _write_wrench(t, t.joint[s], wrench[i], X[i], y, site_wrench[0])
            moved = displacement[i, s] if displacement.size > 0 else 0.0
            for e in range(t.contact_rank[n]):
                for m in range(6):
                    row[m] = t.contact_map[n, e, m] + moved * t.contact_map_moved[n, e, m]
                for k in range(columns):
                    maps.contact[i, n, k, e] = along(row, site_wrench, 0, k)


@kernel
def _balance(
    t: EffortTables,
    wrench: np.ndarray,
    total_effort: np.ndarray,
    X: np.ndarray,
    J: np.ndarray,
    y: np.ndarray,
) -> bool:
    """Write y (ny, 1 + ne) of one sample; False: the drives cannot balance the load."""
    nr, (ny, columns) = t.balanced.size, y.shape
    A, order = np.empty((nr, ny + columns)), np.empty(ny, np.int64)
    for r in range(nr):
        v = t.balanced[r]
        for c in range(ny):
            A[r, c] = J[c, v]
        A[r, ny] = total_effort[v]
        for k in range(columns - 1):
            A[r, ny + 1 + k] = -_lever(t, J, k, v)
    if eliminate_full_pivot(A, ny, order, t.scale) < nr:
        return False
    for c in range(ny):
        for k in range(columns):
            y[order[c], k] = A[c, ny + k] if c < nr else 0.0
    if ny == nr:
        return True
    free = np.zeros((ny, ny - nr))
    for f in range(ny - nr):
        free[order[nr + f], f] = 1.0
        for r in range(nr):
            free[order[r], f] = -A[r, nr + f]
    if t.shifts > 0:
        left = np.empty((ny, free.shape[1] - t.shifts))
        if not share_work(t, total_effort, J, free, y, left):
            return False
        free = left
        if free.shape[1] == 0:
            return True
    given = np.empty((t.sharing, 6, columns))
    for j in range(t.sharing):
        _write_wrench(t, j, wrench, X, y, given[j])
    return share_redundant(given, X, free, t.inverse_length, y)


@kernel
def share_work(
    t: EffortTables,
    total_effort: np.ndarray,
    J: np.ndarray,
    free: np.ndarray,
    y: np.ndarray,
    left: np.ndarray,
) -> bool:
    """Add to y what is free of it so that the sum of cost u^2 over the drives is least.

    Args:
        t, total_effort, J: see `_balance`.
        free: (ny, nf) what may be added to y (ny, 1 + ne).
        left: (ny, nf - shifts), overwritten: what may still be added, which moves no drive.

    Returns:
        False where the least is not unique.
    """
    (ny, nf), (na, columns) = free.shape, (t.drive_v.size, y.shape[1])
    effort, along = np.empty((na, columns)), np.zeros((na, nf))
    _write_efforts(t, total_effort, J, y, effort)
    work, order = np.zeros((nf, nf + columns)), np.empty(nf, np.int64)
    for d in range(na):
        if t.cost[d] == 0.0:
            continue
        for f in range(nf):
            if t.drive_v[d] < 0:
                along[d, f] = free[t.drive_action[d], f]
                continue
            for c in range(ny):
                along[d, f] -= t.part[d] * J[c, t.drive_v[d]] * free[c, f]
        for f in range(nf):
            for g in range(nf):
                work[f, g] += t.cost[d] * along[d, f] * along[d, g]
            for n in range(columns):
                work[f, nf + n] -= t.cost[d] * along[d, f] * effort[d, n]
    rank = eliminate_full_pivot(work, nf, order, 0.0)
    if rank != t.shifts:
        return False
    for f in range(rank):
        for n in range(columns):
            for c in range(ny):
                y[c, n] += free[c, order[f]] * work[f, nf + n]
    for f in range(nf - rank):
        for c in range(ny):
            left[c, f] = free[c, order[rank + f]]
            for r in range(rank):
                left[c, f] -= free[c, order[r]] * work[r, rank + f]
    return True


@kernel
def _lever(t: EffortTables, J: np.ndarray, k: int, v: int) -> float:
    """The generalized effort at velocity v of one unit of an entry's friction."""
    if t.entry_action[k] >= 0:
        return J[t.entry_action[k], v]
    return t.entry_ratio[k] if t.entry_v[k] == v else 0.0


@kernel
def _write_efforts(
    t: EffortTables, total_effort: np.ndarray, J: np.ndarray, y: np.ndarray, effort: np.ndarray
) -> None:
    """Write the drives' efforts (na, 1 + ne) of one sample."""
    for d in range(t.drive_v.size):
        v = t.drive_v[d]
        for k in range(effort.shape[1]):
            if v < 0:
                effort[d, k] = y[t.drive_action[d], k]
                continue
            total = total_effort[v] if k == 0 else -_lever(t, J, k - 1, v)
            for c in range(y.shape[0]):
                total -= J[c, v] * y[c, k]
            effort[d, k] = t.part[d] * total
    if t.delivery.size > 0:
        taken = effort.copy()
        for d in range(effort.shape[0]):
            for k in range(effort.shape[1]):
                effort[d, k] = 0.0
                for e in range(effort.shape[0]):
                    effort[d, k] += t.delivery[d, e] * taken[e, k]


@kernel
def _write_wrench(
    t: EffortTables, j: int, wrench: np.ndarray, X: np.ndarray, y: np.ndarray, out: np.ndarray
) -> None:
    """Write the wrench at joint j as (6, 1 + ne): [:, 0] + [:, 1:] phi."""
    for e in range(6):
        for k in range(out.shape[1]):
            out[e, k] = 0.0
            if k == 0:
                if j < t.n_tree:
                    out[e, 0] = wrench[j, e]
            elif t.entry_action[k - 1] >= 0:
                out[e, k] = X[j, e, t.entry_action[k - 1]]
    add_products(X[j], y, out)


@kernel
def write_wrenches(
    t: EffortTables,
    wrench: np.ndarray,
    X: np.ndarray,
    y: np.ndarray,
    phi: np.ndarray,
    site_wrench: np.ndarray,
    solved: np.ndarray,
) -> None:
    """Write the wrench at each site and the solved unknowns under given friction.

    Args:
        t, wrench, X: see `map_friction`.
        y: (n, ny, 1 + ne) of `Maps`.
        phi: (n, ne) friction.
        site_wrench: (n, ns, 6), overwritten, parent on child or a on b.
        solved: (n, ny), overwritten: off-joint efforts, then multipliers.
    """
    columns = y.shape[2]
    affine = np.empty((6, columns))
    for i in range(phi.shape[0]):
        for c in range(solved.shape[1]):
            solved[i, c] = y[i, c, 0]
            for k in range(1, columns):
                solved[i, c] += y[i, c, k] * phi[i, k - 1]
        for s in range(t.joint.size):
            _write_wrench(t, t.joint[s], wrench[i], X[i], y[i], affine)
            for e in range(6):
                site_wrench[i, s, e] = affine[e, 0]
                for k in range(1, columns):
                    site_wrench[i, s, e] += affine[e, k] * phi[i, k - 1]
