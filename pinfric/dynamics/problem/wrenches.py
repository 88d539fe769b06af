"""Joints' wrenches and loops' multipliers as affine functions of friction, in forward dynamics.

    w_j = f_j + W_j a + X_j [u off the joints; lambda; x of loops]         (paper eq. 7, 16, 17)
    J_c^T lambda = M a + h - S u - D^T x

Pinocchio gives f. Column i of W_j is the composite inertia of what both joints carry times the
motion of freedom i (Featherstone, Rigid Body Dynamics Algorithms, 6.2), so no difference against
gravity is taken.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.affine import (
    add_friction,
    add_reactions,
    solve_balance,
    write_contacts,
)
from pinfric.dynamics.problem.machine import Machine
from pinfric.dynamics.problem.rates import carry
from pinfric.kernels.compiled import kernel


@kernel
def _accelerate(machine: Machine) -> None:
    """Write the terms of W_j a, with the columns of the maps, about the world's origin.

    The acceleration of joint j's link, and the momenta of the freedoms that it carries.
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
                share = a_map[t.freedom_velocity[f], n]
                for e in range(6):
                    above[j, n, e] += share * k.motion[f, e]
    for j in range(nj - 1, -1, -1):
        parent = t.parent[j]
        if parent < 0:
            continue
        for n in range(columns):
            for e in range(6):
                below[parent, n, e] += below[j, n, e]
        for f in range(first[j], first[j + 1]):
            for n in range(columns):
                share = a_map[t.freedom_velocity[f], n]
                for e in range(6):
                    below[parent, n, e] += share * k.momentum[f, e]


@kernel
def _write_tree_wrench(machine: Machine, row: int, j: int) -> None:
    """Write w_j = f_j + W_j a (6, 1 + nc) of a joint of the tree, in its child's frame."""
    k, G, R = machine.supply, machine.maps.wrench, machine.supply.R
    above, below = machine.scratch.above, machine.scratch.below
    x, y, z = k.p[1 + j, 0], k.p[1 + j, 1], k.p[1 + j, 2]
    for n in range(G.shape[2]):
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
    for e in range(6):
        G[row, e, 0] += k.force[1 + j, e]


@kernel
def _write_known_wrenches(machine: Machine) -> None:
    """Write the required wrenches as maps of friction, without the multipliers' part."""
    drives, joint = machine.plan.drives, machine.plan.contacts.joint
    action = machine.plan.coordinates.action
    G, X, delivered = machine.maps.wrench, machine.kinematics.X, machine.maps.delivered
    nj, off_joints = machine.tree.mass.size, X.shape[3] > 0
    _accelerate(machine)
    for row in range(joint.size):
        j = joint[row]
        if j < nj:
            _write_tree_wrench(machine, row, j)
        else:
            G[row] = 0.0
        if not off_joints:
            continue
        for d in range(drives.action.size):
            if drives.velocity_index[d] < 0:
                for e in range(6):
                    share = X[0, j, e, drives.action[d]]
                    for n in range(G.shape[2]):
                        G[row, e, n] += share * delivered[d, n]
        add_friction(X[0, j], action, G[row])


@kernel
def _balance(machine: Machine, free: np.ndarray) -> int:
    """Write multipliers as a map of friction, and their null space; return their rank.

    Args:
        machine: accelerations are written.
        free: (nl, nl), overwritten: its first nl - rank columns (redundant closures).
    """
    t, w, k = machine.plan.closure, machine.maps, machine.kinematics
    M, D, a_map, given = w.M, k.D, w.acceleration, machine.scratch.given
    nl, (nc, nv) = t.multipliers, D.shape
    A = np.empty((nv, nl + 1 + nc))
    for i in range(nv):
        for r in range(nl):
            A[i, r] = k.J[0, t.off_joint + r, i]
        for n in range(1 + nc):
            total = -given[i] if n == 0 else -D[n - 1, i]
            for j in range(nv):
                total += M[i, j] * a_map[j, n]
            A[i, nl + n] = total
    return solve_balance(A, t.scale, w.multiplier, free)


@kernel
def write_wrenches(machine: Machine, q: np.ndarray) -> bool:
    """Write multipliers, wrenches and contact forces as maps of friction; False: not finite.

    Args:
        machine: accelerations are written.
        q: (nq,).
    """
    t, w, contacts = machine.plan.closure, machine.maps, machine.plan.contacts
    nl = t.multipliers
    _write_known_wrenches(machine)
    if nl > 0:
        free = np.empty((nl, nl))
        left = nl - _balance(machine, free)
        X, free = machine.kinematics.X[0], free[:, :left].copy()
        add_reactions(t, contacts.joint, X, t.off_joint, free, w.multiplier, w.wrench)
    return write_contacts(machine.plan, q, w.wrench, machine.problem.contact)
