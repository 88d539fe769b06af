"""Kernels of `linked.py`: from one batch and the linkage's Jacobian to the coupled problem.

    a = a_closure + Z (Z^T M Z)^-1 Z^T (S u - h - M a_closure + D x),     J_c Z = 0
    J_c^T lambda = M a + h - S u - D x

Z and the particular a_closure come from full pivoting of J_c (the paper's choice of dependent and
independent coordinates, eq. 5, 6), the multipliers from full pivoting of its transpose.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics import assembly, constrained
from pinfric.dynamics.assembly import factorize
from pinfric.dynamics.chained import kernel_calling
from pinfric.dynamics.constrained import eliminate_full_pivot

kernel = kernel_calling(assembly, constrained)


@kernel
def closure_basis(
    J: np.ndarray, target: np.ndarray, scale: float, Z: np.ndarray, a_closure: np.ndarray
) -> int:
    """Write the motions that loops allow and one acceleration with J a = target; return J's rank.

    Args:
        J, target: (nl, nv), (nl,).
        scale: pivots small beside it are zero.
        Z: (nv, nv), overwritten; its first nv - rank columns count.
        a_closure: (nv,), overwritten.
    """
    nl, nv = J.shape
    A, order = np.empty((nl, nv + 1)), np.empty(nv, np.int64)
    A[:, :nv] = J
    A[:, nv] = target
    rank = eliminate_full_pivot(A, nv, order, scale)
    Z[:] = 0.0
    for f in range(nv - rank):
        Z[order[rank + f], f] = 1.0
    for c in range(nv):
        a_closure[order[c]] = A[c, nv] if c < rank else 0.0
        if c < rank:
            for f in range(nv - rank):
                Z[order[c], f] = -A[c, rank + f]
    return rank


@kernel
def reduce_dynamics(
    M: np.ndarray,
    push: np.ndarray,
    Z: np.ndarray,
    D: np.ndarray,
    a_closure: np.ndarray,
    factor: np.ndarray,
    a_free: np.ndarray,
    a_slope: np.ndarray,
) -> bool:
    """Write a = a_free + a_slope x and the factor A of D^T a_slope = A^T A; False: M is singular.

    Args:
        M: (nv, nv).
        push: (nv,) S u - h - M a_closure.
        Z: (nv, d).
        D: (nc, nv) rate of each coordinate per unit velocity.
        a_closure: (nv,).
        factor, a_free, a_slope: (d, nc), (nv,), (nv, nc), overwritten.
    """
    nv, d = Z.shape
    nc = D.shape[0]
    MZ, L = np.zeros((nv, d)), np.zeros((d, d))
    for i in range(nv):
        for j in range(nv):
            for f in range(d):
                MZ[i, f] += M[i, j] * Z[j, f]
    for i in range(nv):
        for f in range(d):
            for g in range(d):
                L[f, g] += Z[i, f] * MZ[i, g]
    if not factorize(L):
        return False
    # columns: push, then D^T; forward substitution in place
    Y = np.zeros((d, 1 + nc))
    for i in range(nv):
        for f in range(d):
            Y[f, 0] += Z[i, f] * push[i]
            for c in range(nc):
                Y[f, 1 + c] += Z[i, f] * D[c, i]
    for k in range(1 + nc):
        for f in range(d):
            for g in range(f):
                Y[f, k] -= L[f, g] * Y[g, k]
            Y[f, k] /= L[f, f]
    factor[:, :] = Y[:, 1:]
    for k in range(1 + nc):
        for f in range(d - 1, -1, -1):
            for g in range(f + 1, d):
                Y[f, k] -= L[g, f] * Y[g, k]
            Y[f, k] /= L[f, f]
    for i in range(nv):
        for k in range(1 + nc):
            total = a_closure[i] if k == 0 else 0.0
            for f in range(d):
                total += Z[i, f] * Y[f, k]
            if k == 0:
                a_free[i] = total
            else:
                a_slope[i, k - 1] = total
    return True


@kernel
def balance(
    J: np.ndarray,
    M: np.ndarray,
    load: np.ndarray,
    D: np.ndarray,
    a_free: np.ndarray,
    a_slope: np.ndarray,
    scale: float,
    y: np.ndarray,
    free: np.ndarray,
) -> int:
    """Write multipliers as y[:, 0] + y[:, 1:] x and what may be added to them; return their rank.

    Args:
        J: (nl, nv).
        M: (nv, nv).
        load: (nv,) h - S u.
        D, a_free, a_slope: see `reduce_dynamics`.
        scale: pivots small beside it are zero.
        y: (nl, 1 + nc), overwritten; free multipliers are zero.
        free: (nl, nl), overwritten: its first nl - rank columns (redundant closures).
    """
    nl, nv = J.shape
    nc = D.shape[0]
    A, order = np.empty((nv, nl + 1 + nc)), np.empty(nl, np.int64)
    for i in range(nv):
        for r in range(nl):
            A[i, r] = J[r, i]
        for k in range(1 + nc):
            total = load[i] if k == 0 else -D[k - 1, i]
            for j in range(nv):
                total += M[i, j] * (a_free[j] if k == 0 else a_slope[j, k - 1])
            A[i, nl + k] = total
    rank = eliminate_full_pivot(A, nl, order, scale)
    y[:] = 0.0
    free[:] = 0.0
    for r in range(nl):
        if r < rank:
            for k in range(1 + nc):
                y[order[r], k] = A[r, nl + k]
            for f in range(nl - rank):
                free[order[r], f] = -A[r, rank + f]
        else:
            free[order[r], r - rank] = 1.0
    return rank


@kernel
def given_wrenches(
    batch: np.ndarray,
    X: np.ndarray,
    a_free: np.ndarray,
    a_slope: np.ndarray,
    drive_column: np.ndarray,
    effort: np.ndarray,
    column: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write every joint's wrench without multipliers as out[..., 0] + out[..., 1:] x.

    Args:
        batch: (nv + 2, nj, 6), see `assembly.assemble`.
        X: (nj + loops, 6, nx), see `kinematics.act_on_joints`.
        a_free, a_slope: see `reduce_dynamics`.
        drive_column: (na,) action of each drive, -1 on a joint; effort: (na,).
        column: (nc,) action of each friction coordinate, -1 on a joint.
        out: (nj + loops, 6, 1 + nc), overwritten.
    """
    nj, nc, nv = batch.shape[1], column.size, a_free.size
    for j in range(out.shape[0]):
        for e in range(6):
            for k in range(1 + nc):
                out[j, e, k] = 0.0
            if j < nj:
                out[j, e, 0] = batch[0, j, e]
                for i in range(nv):
                    slope = batch[2 + i, j, e] - batch[1, j, e]
                    if slope != 0.0:
                        out[j, e, 0] += slope * a_free[i]
                        for c in range(nc):
                            out[j, e, 1 + c] += slope * a_slope[i, c]
            for d in range(effort.size):
                if drive_column[d] >= 0:
                    out[j, e, 0] += X[j, e, drive_column[d]] * effort[d]
            for c in range(nc):
                if column[c] >= 0:
                    out[j, e, 1 + c] += X[j, e, column[c]]


@kernel
def write_contacts(
    X: np.ndarray,
    first: int,
    y: np.ndarray,
    q: np.ndarray,
    contact_row: np.ndarray,
    contact_map: np.ndarray,
    contact_map_moved: np.ndarray,
    displacement_q: np.ndarray,
    displacement_ratio: np.ndarray,
    displacement_shift: np.ndarray,
    wrench: np.ndarray,
    contact_free: np.ndarray,
    contact_slope: np.ndarray,
) -> bool:
    """Add the multipliers to all wrenches and write the contact forces; False: not finite.

    Args:
        X: (nj + loops, 6, nx). first: column of the first multiplier.
        y: (nl, 1 + nc).
        q: (nq,). contact_row ... displacement_shift: see `LinkedTables`.
        wrench: (nj + loops, 6, 1 + nc), `given_wrenches`, completed.
        contact_free, contact_slope: of the `Problem`, overwritten.
    """
    columns = wrench.shape[2]
    finite = True
    for j in range(wrench.shape[0]):
        for e in range(6):
            for r in range(y.shape[0]):
                share = X[j, e, first + r]
                if share != 0.0:
                    for k in range(columns):
                        wrench[j, e, k] += share * y[r, k]
            for k in range(columns):
                finite = finite and abs(wrench[j, e, k]) < np.inf
    mapped = np.empty(6)
    for t in range(contact_row.size):
        moved = displacement_shift[t] + displacement_ratio[t] * q[displacement_q[t]]
        for e in range(3):
            for m in range(6):
                mapped[m] = contact_map[t, e, m] + moved * contact_map_moved[t, e, m]
            for k in range(columns):
                total = 0.0
                for m in range(6):
                    total += mapped[m] * wrench[contact_row[t], m, k]
                if k == 0:
                    contact_free[t, e] = total
                else:
                    contact_slope[t, k - 1, e] = total
    return finite
