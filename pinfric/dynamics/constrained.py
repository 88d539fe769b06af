"""What friction does to efforts, multipliers and bearing loads: all of it affine (design 2.2, 2.3).

    tau_id = S u + J_c^T lambda + D phi,     y = [u off the joints; lambda],     A y = b - B phi

Drives on joints of the tree only balance their own row, so A has the other rows. Full pivoting (the
paper's choice) finds its rank: fewer than its rows is a toggle, where drives cannot balance the
load; fewer than its columns, redundant closures. Then, among all y, the one is taken with the least

    sum over all joints, the loops' too, of |F|^2 + |M / l|^2,

which does not depend on where the loop was cut, and is again affine in phi.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.model.compiled import kernel
from pinfric.model.laws import Laws
from pinfric.model.loops import Linkage
from pinfric.model.scene import Scene

#: Pivots below this many times the first one are zero.
_RANK = 1e-9


class Layout(NamedTuple):
    """Where everything stands: drives, friction coordinates, contact forces of a scene.

    Friction coordinates phi: one per site, three (in frame b) for a ball.

    Attributes:
        rest: (nr,) velocities that no joint drive moves: the rows of A.
        drive_v: (na,) velocity of each drive, -1 off the joints.
        drive_column: (na,) its column among the actions, -1 on a joint.
        off_joint, solved: number of off-joint drives, and with the multipliers (length of y).
        phi_v, phi_ratio: (nf,) the velocity a tree site's friction acts on; -1 for a loop's.
        phi_column: (nf,) column of a loop site's friction among the actions; -1 for a tree's.
        phi_start, phi_count: (ns,) the coordinates of each site.
        joint: (ns,) row of each site's joint, the loops' after the tree's.
        n_tree: number of joints of the tree.
        varies: (ns,) whether a site's load can depend on friction, and its friction on the load.
        contact_site: (nt,) site of each contact force.
        contact_map, contact_map_moved: (nt, 3, 6), see `bearings.Contacts`.
        constant: (ns,) constant part of each load.
        laws: of the sites.
        inverse_length: 1/l of the redundancy's weights (1/m).
        scale: size of the levers and directions that A is made of; what is small beside it is 0.
    """

    rest: np.ndarray
    drive_v: np.ndarray
    drive_column: np.ndarray
    off_joint: int
    solved: int
    phi_v: np.ndarray
    phi_ratio: np.ndarray
    phi_column: np.ndarray
    phi_start: np.ndarray
    phi_count: np.ndarray
    joint: np.ndarray
    n_tree: int
    varies: np.ndarray
    contact_site: np.ndarray
    contact_map: np.ndarray
    contact_map_moved: np.ndarray
    constant: np.ndarray
    laws: Laws
    inverse_length: float
    scale: float


class Maps(NamedTuple):
    """Everything of a batch as a function of the friction: [:, ..., 0] + [:, ..., 1:] phi.

    Attributes:
        effort: (n, na, 1 + nf), of the drives (N m or N).
        y: (n, ny, 1 + nf), off-joint efforts, then multipliers.
        contact: (n, nt, 1 + nf, 3), weighted contact forces of the bearings (N m or N).
        singular: (n,) bool: the drives cannot balance the load here, or the closure changes rank.
    """

    effort: np.ndarray
    y: np.ndarray
    contact: np.ndarray
    singular: np.ndarray

    @classmethod
    def of(cls, layout: Layout, n: int) -> Maps:
        """Make the arrays for n samples."""
        columns = 1 + len(layout.phi_v)
        return cls(
            np.empty((n, len(layout.drive_v), columns)),
            np.empty((n, layout.solved, columns)),
            np.empty((n, len(layout.contact_site), columns, 3)),
            np.empty(n, dtype=np.bool_),
        )


def make_layout(scene: Scene, linkage: Linkage) -> Layout:
    """Tabulate a scene with loops or drives off the joints."""
    sites, tables = scene.sites, scene.site_tables
    phi_v: list[int] = []
    phi_ratio: list[float] = []
    phi_column: list[int] = []
    start, count = [], []
    for site in sites:
        start.append(len(phi_v))
        count.append(3 if site.ball else 1)
        first = linkage.friction_column[site.loop] if site.loop >= 0 else -1
        for i in range(count[-1]):
            phi_v.append(site.velocity_index)
            phi_ratio.append(site.ratio)
            phi_column.append(int(first) + i if site.loop >= 0 else -1)
    drive_v = np.array([d.velocity_index for d in scene.drives], dtype=np.int64)
    drive_column = np.array([getattr(d, "column", -1) for d in scene.drives], dtype=np.int64)
    rest = np.setdiff1d(np.arange(scene.model.nv), drive_v[drive_v >= 0])
    n_tree = scene.model.njoints - 1
    # a tree joint's wrench depends on friction only through what is solved for, or loop friction
    felt = np.abs(linkage.support).max(axis=0, initial=0) > 0
    contacts, loaded = tables.contacts, tables.laws.loaded
    varies = [
        s in contacts.site and loaded[s]
        and (site.loop >= 0 or bool(np.take(felt, site.joint)))
        for s, site in enumerate(sites)
    ]  # fmt: skip
    return Layout(
        rest=rest.astype(np.int64),
        drive_v=drive_v,
        drive_column=drive_column,
        off_joint=linkage.off_joint,
        solved=linkage.solved,
        phi_v=np.array(phi_v, dtype=np.int64),
        phi_ratio=np.array(phi_ratio, dtype=float),
        phi_column=np.array(phi_column, dtype=np.int64),
        phi_start=np.array(start, dtype=np.int64),
        phi_count=np.array(count, dtype=np.int64),
        joint=np.ascontiguousarray(tables.joint),
        n_tree=n_tree,
        varies=np.array(varies, dtype=np.bool_),
        contact_site=contacts.site,
        contact_map=contacts.map,
        contact_map_moved=contacts.map_moved,
        constant=contacts.constant,
        laws=tables.laws,
        inverse_length=1.0 / scene.redundancy_length,
        scale=min(1.0, linkage.size),
    )


@kernel
def eliminate_full_pivot(A: np.ndarray, ny: int, order: np.ndarray, scale: float) -> int:
    """Bring the first ny columns of A (nr, ny + more) to reduced echelon form by full pivoting.

    Afterwards y[order[r]] = A[r, ny:] - sum over the free columns f >= rank of A[r, f] y[order[f]].

    Args:
        A: overwritten; its columns below ny are exchanged.
        ny: number of unknowns.
        order: (ny,) int, overwritten: which unknown stands in each column.
        scale: pivots small beside it, or beside the first one, are zero.

    Returns:
        The rank.
    """
    nr, width = A.shape
    for c in range(ny):
        order[c] = c
    first = 0.0
    for k in range(min(nr, ny)):
        best, row, column = 0.0, k, k
        for i in range(k, nr):
            for j in range(k, ny):
                if abs(A[i, j]) > best:
                    best, row, column = abs(A[i, j]), i, j
        if k == 0:
            first = max(best, scale)
        if not best > _RANK * first:
            return k
        if row != k:
            for j in range(width):
                A[k, j], A[row, j] = A[row, j], A[k, j]
        if column != k:
            order[k], order[column] = order[column], order[k]
            for i in range(nr):
                A[i, k], A[i, column] = A[i, column], A[i, k]
        pivot = A[k, k]
        for j in range(k, width):
            A[k, j] /= pivot
        for i in range(nr):
            factor = A[i, k]
            if i != k and factor != 0.0:
                for j in range(k, width):
                    A[i, j] -= factor * A[k, j]
    return min(nr, ny)


@kernel
def _share_least_squares(
    A: np.ndarray,
    order: np.ndarray,
    layout: Layout,
    wrench: np.ndarray,
    X: np.ndarray,
    y: np.ndarray,
) -> bool:
    """Choose the free unknowns of a redundant closure: least sum of |F|^2 + |M/l|^2.

    Args:
        A, order: of `eliminate_full_pivot`, rank = rows.
        layout: `Layout`.
        wrench: (nj, 6), of the tree's joints with y = 0 and phi = 0.
        X: (nj + loops, 6, nx) of one sample.
        y: (ny, 1 + nf), holds the solution with free unknowns 0; overwritten.

    Returns:
        False where the least is not unique.
    """
    nr, ny, columns = A.shape[0], y.shape[0], y.shape[1]
    free = ny - nr
    N = np.zeros((ny, free))
    for f in range(free):
        N[order[nr + f], f] = 1.0
        for r in range(nr):
            N[order[r], f] = -A[r, nr + f]
    normal, right = np.zeros((free, free)), np.zeros((free, columns))
    along, given = np.empty(free), np.empty(columns)
    for j in range(X.shape[0]):
        for e in range(6):
            weight = 1.0 if e < 3 else layout.inverse_length
            touched = False
            for c in range(ny):
                touched = touched or X[j, e, c] != 0.0
            if not touched:
                continue
            for f in range(free):
                along[f] = 0.0
                for c in range(ny):
                    along[f] += weight * X[j, e, c] * N[c, f]
            for k in range(columns):
                given[k] = 0.0
                for c in range(ny):
                    given[k] += weight * X[j, e, c] * y[c, k]
                if k == 0:
                    if j < layout.n_tree:
                        given[k] += weight * wrench[j, e]
                elif layout.phi_column[k - 1] >= 0:
                    given[k] += weight * X[j, e, layout.phi_column[k - 1]]
            for f in range(free):
                for g in range(free):
                    normal[f, g] += along[f] * along[g]
                for k in range(columns):
                    right[f, k] -= along[f] * given[k]
    work = np.empty((free, free + columns))
    for f in range(free):
        for k in range(free + columns):
            work[f, k] = normal[f, k] if k < free else right[f, k - free]
    position = np.empty(free, np.int64)
    if eliminate_full_pivot(work, free, position, 0.0) < free:
        return False
    for f in range(free):
        for k in range(columns):
            for c in range(ny):
                y[c, k] += N[c, position[f]] * work[f, free + k]
    return True


@kernel
def map_friction(
    layout: Layout,
    wrench: np.ndarray,
    tau: np.ndarray,
    X: np.ndarray,
    J: np.ndarray,
    displacement: np.ndarray,
    maps: Maps,
) -> None:
    """Write efforts, multipliers and contact forces of a batch as affine functions of friction.

    Args:
        layout: `Layout`.
        wrench: (n, nj, 6), of the tree's joints without multipliers, drives off the joints and
            friction: RNEA of the twin.
        tau: (n, nv), tau_id.
        X, J: (n, nj + loops, 6, nx), (n, nx, nv), `kinematics.act_on_joints`.
        displacement: (n, ns) of each site along its axis, or (0, 0) where it does not matter.
        maps: overwritten.
    """
    nr, ny, nf = layout.rest.size, layout.solved, layout.phi_v.size
    columns = 1 + nf
    A, order = np.empty((nr, ny + columns)), np.empty(ny, np.int64)
    site_wrench, mapped = np.empty((6, columns)), np.empty(6)
    for i in range(wrench.shape[0]):
        y, effort = maps.y[i], maps.effort[i]
        for r in range(nr):
            v = layout.rest[r]
            for c in range(ny):
                A[r, c] = J[i, c, v]
            A[r, ny] = tau[i, v]
            for k in range(nf):
                if layout.phi_column[k] >= 0:
                    A[r, ny + 1 + k] = -J[i, layout.phi_column[k], v]
                else:
                    A[r, ny + 1 + k] = -layout.phi_ratio[k] if layout.phi_v[k] == v else 0.0
        singular = eliminate_full_pivot(A, ny, order, layout.scale) < nr
        if not singular:
            for r in range(nr):
                for k in range(columns):
                    y[order[r], k] = A[r, ny + k]
            for f in range(nr, ny):
                for k in range(columns):
                    y[order[f], k] = 0.0
            if ny > nr:
                singular = not _share_least_squares(A, order, layout, wrench[i], X[i], y)
        maps.singular[i] = singular
        if singular:
            for c in range(ny):
                for k in range(columns):
                    y[c, k] = np.nan
        for d in range(layout.drive_v.size):
            v = layout.drive_v[d]
            for k in range(columns):
                if v < 0:
                    effort[d, k] = y[layout.drive_column[d], k]
                    continue
                total = tau[i, v] if k == 0 else 0.0
                if k > 0:
                    if layout.phi_column[k - 1] >= 0:
                        total -= J[i, layout.phi_column[k - 1], v]
                    elif layout.phi_v[k - 1] == v:
                        total -= layout.phi_ratio[k - 1]
                for c in range(ny):
                    total -= J[i, c, v] * y[c, k]
                effort[d, k] = total
        site = -1
        for t in range(layout.contact_site.size):
            s = layout.contact_site[t]
            if s != site:
                site = s
                write_site_wrench(layout, s, wrench[i], X[i], y, site_wrench)
            moved = displacement[i, s] if displacement.size > 0 else 0.0
            for e in range(3):
                for m in range(6):
                    mapped[m] = (
                        layout.contact_map[t, e, m] + moved * layout.contact_map_moved[t, e, m]
                    )
                for k in range(columns):
                    total = 0.0
                    for m in range(6):
                        total += mapped[m] * site_wrench[m, k]
                    maps.contact[i, t, k, e] = total


@kernel
def write_site_wrench(
    layout: Layout, s: int, wrench: np.ndarray, X: np.ndarray, y: np.ndarray, out: np.ndarray
) -> None:
    """Write the wrench at a site's joint as (6, 1 + nf): [:, 0] + [:, 1:] phi."""
    j = layout.joint[s]
    for e in range(6):
        for k in range(out.shape[1]):
            total = 0.0
            if k == 0:
                if j < layout.n_tree:
                    total = wrench[j, e]
            elif layout.phi_column[k - 1] >= 0:
                total = X[j, e, layout.phi_column[k - 1]]
            for c in range(y.shape[0]):
                if X[j, e, c] != 0.0:
                    total += X[j, e, c] * y[c, k]
            out[e, k] = total


@kernel
def write_wrenches(
    layout: Layout,
    wrench: np.ndarray,
    X: np.ndarray,
    y: np.ndarray,
    phi: np.ndarray,
    site_wrench: np.ndarray,
    solved: np.ndarray,
) -> None:
    """Write the wrench at each site and the solved unknowns under given friction.

    Args:
        layout, wrench, X: see `map_friction`.
        y: (n, ny, 1 + nf) of `Maps`.
        phi: (n, nf) friction.
        site_wrench: (n, ns, 6), overwritten, parent on child or a on b.
        solved: (n, ny), overwritten: off-joint efforts, then multipliers.
    """
    for i in range(phi.shape[0]):
        for c in range(solved.shape[1]):
            solved[i, c] = y[i, c, 0]
            for k in range(phi.shape[1]):
                solved[i, c] += y[i, c, 1 + k] * phi[i, k]
        for s in range(layout.joint.size):
            j = layout.joint[s]
            for e in range(6):
                total = wrench[i, j, e] if j < layout.n_tree else 0.0
                for c in range(solved.shape[1]):
                    if X[i, j, e, c] != 0.0:
                        total += X[i, j, e, c] * solved[i, c]
                for k in range(phi.shape[1]):
                    if layout.phi_column[k] >= 0:
                        total += X[i, j, e, layout.phi_column[k]] * phi[i, k]
                site_wrench[i, s, e] = total
