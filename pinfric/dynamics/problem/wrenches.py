"""Wrenches, multipliers and contact forces as affine functions of friction.

    w_j = f_j + W_j a + X_j [u off the joints; lambda; x of loops]         (paper eq. 7, 16, 17)
    J_c^T lambda = M a + h - S u - D^T x,     p = (map + s map_moved) w

Every map has 1 + n columns: [..., 0] + [..., 1:] x, x the friction. Kernels that do not take a
`Machine` serve inverse dynamics, too, where y are efforts off the joints, then multipliers.

Column i of W_j is the composite inertia of what both joints carry times the motion of freedom i
about the world's origin (Featherstone, Rigid Body Dynamics Algorithms, 6.2), so no difference
against gravity is taken.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.accelerations import carry
from pinfric.dynamics.problem.machine import Machine
from pinfric.dynamics.problem.plan import Closure, Plan
from pinfric.friction.dense import eliminate_full_pivot, solve_balance
from pinfric.kernels.compiled import kernel, late_kernel


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
        unique = share_load(given, along, weight, free, y, np.empty((ny, 0))) == nf
    for row in range(joint.size):
        add_products(X[joint[row]], first, y, wrench[row])
    return unique


@kernel
def share_load(
    given: np.ndarray,
    along: np.ndarray,
    weight: np.ndarray,
    free: np.ndarray,
    y: np.ndarray,
    left: np.ndarray,
) -> int:
    """Choose the free part of y with the least sum of weight |given + along z|^2; return its rank.

    Redundant closures share reactions so, sum |F|^2 + |M/l|^2 over all joints, wherever a loop was
    cut; redundant drives share work.

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


@kernel
def _accelerate(machine: Machine) -> None:
    """Write the terms of W_j a, with the columns of the maps, about the world's origin.

    They are the acceleration of joint j's link, and the momenta of the freedoms that it carries.
    """
    t, k, a_map = machine.tree, machine.kinematics, machine.maps.acceleration
    above, below, first = machine.scratch.above, machine.scratch.below, t.first_freedom
    nj, columns = above.shape[0], above.shape[1]
    for j in range(nj):
        parent = t.parent[j]
        for n in range(columns):
            for e in range(6):
                above[j, n, e] = above[parent, n, e] if parent >= 0 else 0.0
                below[j, n, e] = 0.0
        for f in range(first[j], first[j + 1]):
            for n in range(columns):
                acceleration = a_map[t.freedom_velocity[f], n]
                for e in range(6):
                    above[j, n, e] += acceleration * k.motion[f, e]
    for j in range(nj - 1, -1, -1):
        parent = t.parent[j]
        if parent < 0:
            continue
        for n in range(columns):
            for e in range(6):
                below[parent, n, e] += below[j, n, e]
        for f in range(first[j], first[j + 1]):
            for n in range(columns):
                acceleration = a_map[t.freedom_velocity[f], n]
                for e in range(6):
                    below[parent, n, e] += acceleration * k.momentum[f, e]


@kernel
def _write_known_wrenches(machine: Machine) -> None:
    """Write the required wrenches as maps of friction, without the multipliers' part.

    w_j = f_j + W_j a (6, 1 + nc) of a joint of the tree, in its child's frame.
    """
    drives, joint = machine.plan.drives, machine.plan.contacts.joint
    k, G, X, delivered = (
        machine.pinocchio,
        machine.maps.wrench,
        machine.kinematics.X,
        machine.maps.delivered,
    )
    above, below, R, nj = machine.scratch.above, machine.scratch.below, k.R, machine.tree.mass.size
    _accelerate(machine)
    for row in range(joint.size):
        j = joint[row]
        if j >= nj:
            G[row] = 0.0
        for n in range(G.shape[2] if j < nj else 0):
            x, y, z = k.p[1 + j, 0], k.p[1 + j, 1], k.p[1 + j, 2]
            moves = (
                above[j, n, 0],
                above[j, n, 1],
                above[j, n, 2],
                above[j, n, 3],
                above[j, n, 4],
                above[j, n, 5],
            )
            fx, fy, fz, mx, my, mz = carry(machine.tree, k, j, moves)
            fx, fy, fz = fx + below[j, n, 0], fy + below[j, n, 1], fz + below[j, n, 2]
            mx += below[j, n, 3] - y * fz + z * fy
            my += below[j, n, 4] - z * fx + x * fz
            mz += below[j, n, 5] - x * fy + y * fx
            for e in range(3):
                a, b, c = R[1 + j, 0, e], R[1 + j, 1, e], R[1 + j, 2, e]
                G[row, e, n] = a * fx + b * fy + c * fz
                G[row, 3 + e, n] = a * mx + b * my + c * mz
        for e in range(6 if j < nj else 0):
            G[row, e, 0] += k.force[1 + j, e]
        if X.shape[3] == 0:  # all acts on joints
            continue
        for d in range(drives.action.size):
            if drives.velocity_index[d] < 0:
                for e in range(6):
                    lever = X[0, j, e, drives.action[d]]
                    for n in range(G.shape[2]):
                        G[row, e, n] += lever * delivered[d, n]
        add_friction(X[0, j], machine.plan.coordinates.action, G[row])


@kernel
def write_wrenches(machine: Machine, q: np.ndarray) -> bool:
    """Write multipliers, wrenches and contact forces as maps of friction; False: not finite.

    Args:
        machine: accelerations are written.
        q: (nq,).
    """
    _write_known_wrenches(machine)
    if machine.plan.closure.multipliers > 0:
        _write_multipliers(machine)
    return write_contacts(machine.plan, q, machine.maps.wrench, machine.problem.contact)


@late_kernel("loops")
def _write_multipliers(machine: Machine) -> None:
    """Write multipliers, and add their part to the wrenches."""
    t, maps, contacts = machine.plan.closure, machine.maps, machine.plan.contacts
    M, D, J, unbalanced = maps.M, machine.kinematics.D, machine.kinematics.J, maps.unbalanced
    nl, (nc, nv) = t.multipliers, D.shape
    A, free = np.empty((nv, nl + 1 + nc)), np.empty((nl, nl))
    for i in range(nv):
        for r in range(nl):
            A[i, r] = J[0, t.off_joint + r, i]
        for n in range(1 + nc):
            A[i, nl + n] = -unbalanced[i] if n == 0 else -D[n - 1, i]
            for j in range(nv):
                A[i, nl + n] += M[i, j] * maps.acceleration[j, n]
    ways = nl - solve_balance(A, t.scale, maps.multiplier, free)  # to share redundant ones
    X, free = machine.kinematics.X[0], free[:, :ways].copy()
    add_reactions(t, contacts.joint, X, t.off_joint, free, maps.multiplier, maps.wrench)
