"""Derivatives of the wrenches and loads of an open chain by its motion: one kernel.

Each load c = sum |p_i| + constant changes with its joint's wrench w_k along the gradient

    g_k = dc_k/dw_k = sum_i (B_i + s C_i)^T p_i / |p_i|,     p_i = (B_i + s C_i) w_k

With S_j the motion of a freedom of joint j about the world's origin, V and A velocity and
acceleration of a link (the ground accelerates against gravity), p the parent of j, Y_k the
composite inertia of joint k, B_k what multiplies a change of velocity there,

    dV/dq = V_p x S,     dA/dq = A_p x S + V_p x (V_p x S),     dA/dv = (V_j + V_p) x S

    j carries k or is k     dw_k = Y_k dA/dq + B_k dV/dq,  Y_k dA/dv + B_k S,  Y_k S
    k carries j             the same with Y_j, B_j; and S x* F_j in the first

(Carpentier and Mansard, Analytical Derivatives of Rigid Body Dynamics Algorithms, RSS 2018.) B acts
on rotations only: with l momentum and P = int V(r) r^T dm about the origin,

    B w = -2 (l x w, (P - tr P) w)

The changes are of figures in the frame of joint k.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.derivatives.tables import Tables
from pinfric.dynamics.problem.accelerations import Vector6, carry
from pinfric.dynamics.problem.machine import Machine
from pinfric.kernels.compiled import kernel

#: A contact force below this part of its terms is none: its direction is rounding.
_NONE = 1e-13
Vector3 = tuple[float, float, float]
_UNITS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_NO_WRENCH = (0.0,) * 6


@kernel
def six(A: np.ndarray, i: int) -> Vector6:
    """Return row i (6,)."""
    return A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5]


@kernel
def _cross(a: Vector3, b: Vector3) -> Vector3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _plus(a: Vector3, factor: float, b: Vector3) -> Vector3:
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@kernel
def _cross_motion(a: Vector6, b: Vector6) -> Vector6:
    """Return a x b of motions, or, with the moment of b first, a x* b."""
    return _plus(_cross(a[3:], b[:3]), 1.0, _cross(a[:3], b[3:])) + _cross(a[3:], b[3:])


@kernel
def to_world(R: np.ndarray, p: np.ndarray, i: int, a: Vector6) -> Vector6:
    """Return a motion in frame i, or a wrench with its moment first, about the world's origin."""
    v, w = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for e in range(3):
        axis = R[i, 0, e], R[i, 1, e], R[i, 2, e]
        v, w = _plus(v, a[e], axis), _plus(w, a[3 + e], axis)
    return _plus(v, 1.0, _cross((p[i, 0], p[i, 1], p[i, 2]), w)) + w


@kernel
def _write_links(machine: Machine, x: Tables) -> None:
    """Write V, A, F (moment first) and S of every joint in the world."""
    k, twist, first = machine.pinocchio, machine.tree.twist, machine.tree.first_freedom
    R, p, V, A, F = k.R, k.p, k.velocity, k.acceleration, k.force
    velocity, acceleration, force, motion = x.velocity, x.acceleration, x.force, x.motion
    for i in range(1, first.size):
        f = six(F, i)
        v, a = to_world(R, p, i, six(V, i)), to_world(R, p, i, six(A, i))
        f = to_world(R, p, i, f[3:] + f[:3])
        for e in range(6):
            velocity[i, e], acceleration[i, e], force[i, e] = v[e], a[e], f[e]
        for g in range(first[i - 1], first[i]):
            s = to_world(R, p, i, six(twist, g))
            for e in range(6):
                motion[g, e] = s[e]


@kernel
def _add_drift(machine: Machine, x: Tables, to: int, j: int, i: int, factor: float) -> None:
    """Add to row `to` of B the part of joint j's composite body moving as link i, times factor."""
    I, c, V, B = machine.pinocchio.inertia, machine.pinocchio.lever, x.velocity, x.drift  # noqa: E741
    at, w, m = (
        (c[1 + j, 0], c[1 + j, 1], c[1 + j, 2]),
        (V[i, 3], V[i, 4], V[i, 5]),
        machine.tree.mass,
    )
    xx, xy, yy = I[1 + j, 0], I[1 + j, 1], I[1 + j, 2]
    xz, yz, zz = I[1 + j, 3], I[1 + j, 4], I[1 + j, 5]
    half = 0.5 * (xx + yy + zz)
    spread = (half - xx, -xy, -xz), (-xy, half - yy, -yz), (-xz, -yz, half - zz)
    mean = _plus((V[i, 0], V[i, 1], V[i, 2]), 1.0, _cross(w, at))
    for e in range(3):
        flow = _plus(_cross(w, spread[e]), m[j] * at[e], mean)  # a column of P
        turned = _cross(_UNITS[e], mean)
        for r in range(3):
            B[to, r, e] += 2.0 * factor * m[j] * turned[r]
            B[to, 3 + r, e] -= 2.0 * factor * flow[r]
            B[to, 3 + r, r] += 2.0 * factor * flow[e]


@kernel
def _act(
    machine: Machine, x: Tables, k: int, c: int, a: Vector6, w: Vector3, own: bool, lean: Vector6
) -> None:
    """Add Y_k a + B_k w to column c of joint k; of its own motion, plus lean, to its ancestors."""
    parent, B, W = machine.tree.parent, x.drift, x.wrench_change
    f = carry(machine.tree, machine.pinocchio, k, a)
    for e in range(6):
        change = f[e] + B[k, e, 0] * w[0] + B[k, e, 1] * w[1] + B[k, e, 2] * w[2]
        W[k, e, c] += change
        i = parent[k] if own else -1
        while i >= 0:
            W[i, e, c] += change + lean[e]
            i = parent[i]


@kernel
def _write_changes(machine: Machine, x: Tables) -> None:
    """Write dw of every joint by the q, v and a of every freedom."""
    parent, first = machine.tree.parent, machine.tree.first_freedom
    column, nv = machine.tree.freedom_velocity, machine.pinocchio.h.size
    x.drift[:] = 0.0
    x.wrench_change[:] = 0.0
    for j in range(parent.size - 1, -1, -1):  # parents come before their children
        above = parent[j]
        _add_drift(machine, x, j, j, 1 + j, 1.0)
        if above >= 0:
            _add_drift(machine, x, above, j, 1 + above, -1.0)  # what its own row will add
            x.drift[above] += x.drift[j]
    for k in range(parent.size):
        j = k
        while j >= 0:
            A, V = six(x.acceleration, 1 + parent[j]), six(x.velocity, 1 + parent[j])
            v = six(x.velocity, 1 + j)
            both = _plus(V[:3], 1.0, v[:3]) + _plus(V[3:], 1.0, v[3:])
            for g in range(first[j], first[j + 1]):
                s, c, own = six(x.motion, g), column[g], j == k
                f, dv = _cross_motion(s, six(x.force, 1 + j)), _cross_motion(V, s)
                once, twice = _cross_motion(A, s), _cross_motion(V, dv)
                da = _plus(once[:3], 1.0, twice[:3]) + _plus(once[3:], 1.0, twice[3:])
                _act(machine, x, k, c, da, dv[3:], own, f[3:] + f[:3])
                _act(machine, x, k, nv + c, _cross_motion(both, s), s[3:], own, _NO_WRENCH)
                _act(machine, x, k, 2 * nv + c, s, _NO_WRENCH[3:], own, _NO_WRENCH)
            j = parent[j]


@kernel
def add_change(x: Tables, k: int, axis: Vector6, factor: float, out: np.ndarray) -> None:
    """Add the change (3 nv,) of joint k's wrench along an axis in the world times a factor."""
    W = x.wrench_change
    for e in range(6):
        for i in range(out.size):
            out[i] += factor * axis[e] * W[k, e, i]


@kernel
def _write_loads(machine: Machine, x: Tables, q: np.ndarray) -> None:
    """Write load and its gradient, in the child's frame, of every site."""
    joint, contacts = x.sites.joint, x.sites.contacts
    site, rank, still, moved = contacts.site, contacts.rank, contacts.map, contacts.map_moved
    t, F, R, p = (
        machine.plan.sites,
        machine.pinocchio.force,
        machine.pinocchio.R,
        machine.pinocchio.p,
    )
    of_q, scale, shift = t.displacement_q, t.displacement_ratio, t.displacement_shift
    load, gradient, contact, maps, by_place = x.load, x.gradient, x.contact, x.maps, x.by_place
    load[:], gradient[:], by_place[:], x.sharp[:] = contacts.constant, 0.0, 0.0, False
    for n in range(site.size):
        s, rows, square, size = site[n], rank[n], 0.0, 0.0
        i, moves, place = 1 + joint[s], contacts.moves[s], 0.0
        if moves:
            place = scale[s] * q[of_q[s]] + shift[s]
        for e in range(rows):
            contact[e] = 0.0
            for c in range(6):
                maps[e, c] = still[n, e, c]
                if moves:
                    maps[e, c] += place * moved[n, e, c]
                contact[e] += maps[e, c] * F[i, c]
                size += abs(maps[e, c] * F[i, c])
            square += contact[e] * contact[e]
        norm = np.sqrt(square)
        for e in range(rows):
            if norm <= _NONE * size:  # a kink, unless it stays 0
                x.row[:] = 0.0
                add_change(x, joint[s], to_world(R, p, i, six(maps, e)), 1.0, x.row)
                x.sharp[s] |= np.abs(x.row).max() > _NONE
                continue
            direction = contact[e] / norm
            for c in range(6):
                gradient[s, c] += maps[e, c] * direction
                if moves:
                    by_place[s] += scale[s] * moved[n, e, c] * F[i, c] * direction
        if norm > _NONE * size:
            load[s] += norm


@kernel
def differentiate_wrenches(machine: Machine, x: Tables, q: np.ndarray) -> None:
    """Write `wrench_change`, loads and their gradients; arguments as `differentiate_efforts`."""
    _write_links(machine, x)
    _write_changes(machine, x)
    _write_loads(machine, x, q)
