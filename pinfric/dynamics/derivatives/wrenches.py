"""How the wrenches of an open chain change with its motion, along any axis: one kernel.

RNEA's derivatives keep, of the change of each joint's wrench w_k, the component along the joint's
axis. Friction needs that along the gradient of the load c = sum |p_i| + constant,

    g_k = dc_k/dw_k = sum_i (B_i + s C_i)^T p_i / |p_i|,     p_i = (B_i + s C_i) w_k

With S_j the motion of a freedom of joint j about the world's origin, V and A velocity and
acceleration of a link (the ground accelerates against gravity), p the parent of j, Y_k the inertia
of all that joint k carries, B_k what multiplies a change of velocity there,

    dV/dq = V_p x S,     dA/dq = A_p x S + V_p x (V_p x S),     dA/dv = (V_j + V_p) x S

    j carries k or is k     g . (Y_k dA/dq + B_k dV/dq),  g . (Y_k dA/dv + B_k S),  g . Y_k S
    k carries j             the same with Y_j, B_j; and g . (S x* F_j) in the first

(Carpentier and Mansard, Analytical Derivatives of Rigid Body Dynamics Algorithms, RSS 2018; there g
is the axis). B acts on rotations only: with l momentum and P = int V(r) r^T dm about the origin,

    B w = -2 (l x w, (P - tr P) w)

Wrenches and velocities in a joint's own frame do not change with a rotation of that frame, so the
changes are those of figures in the frame of joint k.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.derivatives.tables import Tables
from pinfric.dynamics.problem.accelerations import Vector6
from pinfric.dynamics.problem.machine import Machine
from pinfric.kernels.compiled import kernel

#: A contact force below this part of its terms is none: its direction is rounding.
_NONE = 1e-13
Vector3 = tuple[float, float, float]


@kernel
def _six(A: np.ndarray, i: int) -> Vector6:
    """Return row i (6,)."""
    return A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5]


@kernel
def _put(A: np.ndarray, i: int, x: Vector6) -> None:
    """Write row i (6,)."""
    A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5] = x


@kernel
def _cross(a: Vector3, b: Vector3) -> Vector3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _turn(R: np.ndarray, j: int, a: Vector3) -> Vector3:
    return (
        R[j, 0, 0] * a[0] + R[j, 0, 1] * a[1] + R[j, 0, 2] * a[2],
        R[j, 1, 0] * a[0] + R[j, 1, 1] * a[1] + R[j, 1, 2] * a[2],
        R[j, 2, 0] * a[0] + R[j, 2, 1] * a[1] + R[j, 2, 2] * a[2],
    )


@kernel
def _to_world(R: np.ndarray, p: np.ndarray, j: int, motion: Vector6) -> Vector6:
    """Return a motion in frame j about the world's origin, in its axes."""
    w = _turn(R, j, motion[3:])
    v, lever = _turn(R, j, motion[:3]), _cross((p[j, 0], p[j, 1], p[j, 2]), w)
    return v[0] + lever[0], v[1] + lever[1], v[2] + lever[2], w[0], w[1], w[2]


@kernel
def _cross_motion(a: Vector6, b: Vector6) -> Vector6:
    """Return a x b of motions."""
    u, v, w = _cross(a[3:], b[:3]), _cross(a[:3], b[3:]), _cross(a[3:], b[3:])
    return u[0] + v[0], u[1] + v[1], u[2] + v[2], w[0], w[1], w[2]


@kernel
def _carry(Y: np.ndarray, j: int, s: Vector6) -> Vector6:
    """Return Y s of what joint j carries; a row of Y is m, m c, then xx, xy, yy, xz, yz, zz."""
    m, x, y, z = Y[j, 0], Y[j, 1], Y[j, 2], Y[j, 3]
    return (
        m * s[0] + s[4] * z - s[5] * y,
        m * s[1] + s[5] * x - s[3] * z,
        m * s[2] + s[3] * y - s[4] * x,
        Y[j, 4] * s[3] + Y[j, 5] * s[4] + Y[j, 7] * s[5] + y * s[2] - z * s[1],
        Y[j, 5] * s[3] + Y[j, 6] * s[4] + Y[j, 8] * s[5] + z * s[0] - x * s[2],
        Y[j, 7] * s[3] + Y[j, 8] * s[4] + Y[j, 9] * s[5] + x * s[1] - y * s[0],
    )


@kernel
def _drift(l: np.ndarray, P: np.ndarray, j: int, w: Vector3) -> Vector6:  # noqa: E741
    """Return B w of what joint j carries."""
    trace = P[j, 0, 0] + P[j, 1, 1] + P[j, 2, 2]
    f, n = _cross((l[j, 0], l[j, 1], l[j, 2]), w), _turn(P, j, w)
    return (
        -2.0 * f[0],
        -2.0 * f[1],
        -2.0 * f[2],
        2.0 * (trace * w[0] - n[0]),
        2.0 * (trace * w[1] - n[1]),
        2.0 * (trace * w[2] - n[2]),
    )


@kernel
def _write_links(machine: Machine, x: Tables) -> None:
    """Write V, A, F, S of every joint in the world, and Y, l, P of all that it carries."""
    k, parent = machine.supply, machine.tree.parent  # once: arrays of a record are counted
    first, twist, mass = machine.tree.first_freedom, machine.tree.twist, machine.tree.mass
    R, p, V, A, F = k.R, k.p, k.velocity, k.acceleration, k.force
    lever, inertia, Y, moment, spread = k.lever, k.inertia, x.carried, x.moment, x.spread
    velocity, acceleration, force, motion = x.velocity, x.acceleration, x.force, x.motion
    l, P, half, own = x.momentum, x.flow, x.half, x.mass  # noqa: E741
    for j in range(parent.size):
        i = 1 + j
        at = p[i, 0], p[i, 1], p[i, 2]
        v, w = _six(V, i), _six(F, i)
        _put(velocity, i, _to_world(R, p, i, v))
        _put(acceleration, i, _to_world(R, p, i, _six(A, i)))
        f, n = _turn(R, i, w[:3]), _turn(R, i, w[3:])
        arm = _cross(at, f)
        _put(force, i, (f[0], f[1], f[2], n[0] + arm[0], n[1] + arm[1], n[2] + arm[2]))
        for g in range(first[j], first[j + 1]):
            _put(motion, g, _to_world(R, p, i, _six(twist, g)))
        m, a, b, c = mass[j], lever[i, 0], lever[i, 1], lever[i, 2]
        Y[j, 0], Y[j, 1], Y[j, 2], Y[j, 3] = m, m * a, m * b, m * c
        Y[j, 4] = inertia[i, 0] + m * (b * b + c * c)
        Y[j, 5] = inertia[i, 1] - m * a * b
        Y[j, 6] = inertia[i, 2] + m * (a * a + c * c)
        Y[j, 7] = inertia[i, 3] - m * a * c
        Y[j, 8] = inertia[i, 4] - m * b * c
        Y[j, 9] = inertia[i, 5] + m * (a * a + b * b)
        u = moment[j, 0], moment[j, 1], moment[j, 2]
        spin = _cross(v[3:], u)
        l[j, 0], l[j, 1], l[j, 2] = _turn(
            R, i, (own[j] * v[0] + spin[0], own[j] * v[1] + spin[1], own[j] * v[2] + spin[2])
        )
        for e in range(3):  # a column of v u^T + w x spread
            s = _cross(v[3:], (spread[j, 0, e], spread[j, 1, e], spread[j, 2, e]))
            column = v[0] * u[e] + s[0], v[1] * u[e] + s[1], v[2] * u[e] + s[2]
            half[0, e], half[1, e], half[2, e] = _turn(R, i, column)
        for r in range(3):
            row = _turn(R, i, (half[r, 0], half[r, 1], half[r, 2]))
            for e in range(3):
                P[j, r, e] = row[e] + l[j, r] * at[e]
    for j in range(parent.size - 1, 0, -1):  # parents come before their children
        above = parent[j]
        if above >= 0:
            for r in range(3):
                l[above, r] += l[j, r]
                for e in range(3):
                    P[above, r, e] += P[j, r, e]


@kernel
def _write_columns(machine: Machine, x: Tables) -> None:
    """Write dV, dA, and dF of the joint itself, by the q, v and a of every freedom."""
    parent, first = machine.tree.parent, machine.tree.first_freedom
    V, A, F, S, Y, l, P = (  # noqa: E741
        x.velocity,
        x.acceleration,
        x.force,
        x.motion,
        x.carried,
        x.momentum,
        x.flow,
    )
    by_velocity, by_acceleration, by_force = x.dv, x.da, x.df
    for j in range(parent.size):
        above = 1 + parent[j]  # row 0 is the ground's
        below, own, f = _six(V, above), _six(V, 1 + j), _six(F, 1 + j)
        fall = _six(A, above)
        for g in range(first[j], first[j + 1]):
            s = _six(S, g)
            dv = _cross_motion(below, s)
            once, twice, bend = (
                _cross_motion(fall, s),
                _cross_motion(below, dv),
                _cross_motion(own, s),
            )
            arm, turned = _cross(s[:3], f[:3]), _cross(s[3:], f[3:])
            lift = _cross(s[3:], f[:3])
            lean = (
                lift[0],
                lift[1],
                lift[2],
                arm[0] + turned[0],
                arm[1] + turned[1],
                arm[2] + turned[2],
            )
            for e in range(3):
                by_velocity[0, g, e], by_velocity[1, g, e] = dv[3 + e], s[3 + e]
            for e in range(6):
                by_acceleration[0, g, e] = once[e] + twice[e]
                by_acceleration[1, g, e] = bend[e] + dv[e]
                by_acceleration[2, g, e] = s[e]
            by_q, by_v = _drift(l, P, j, dv[3:]), _drift(l, P, j, s[3:])
            y = _carry(Y, j, _six(by_acceleration[0], g))
            z, by_a = _carry(Y, j, _six(by_acceleration[1], g)), _carry(Y, j, s)
            for e in range(6):
                by_force[0, g, e] = y[e] + by_q[e] + lean[e]
                by_force[1, g, e] = z[e] + by_v[e]
                by_force[2, g, e] = by_a[e]


@kernel
def _write_rows(machine: Machine, x: Tables, start: int, end: int) -> None:
    """Write x.change (3, rows, nv) of some rows: `axis` . dw by q, v, a, at the rows' joints."""
    first, column = machine.tree.first_freedom, machine.tree.freedom_velocity
    G, joint, change, carries = x.axis, x.row_joint, x.change, x.carries
    Y, l, P, dv, da, df = x.carried, x.momentum, x.flow, x.dv, x.da, x.df  # noqa: E741
    for r in range(start, end):
        k, g = joint[r], _six(G, r)
        y = _carry(Y, k, g)  # Y is symmetric
        b = _cross(g[:3], (l[k, 0], l[k, 1], l[k, 2]))  # B^T g
        trace = P[k, 0, 0] + P[k, 1, 1] + P[k, 2, 2]
        b0 = 2.0 * (trace * g[3] - b[0] - P[k, 0, 0] * g[3] - P[k, 1, 0] * g[4] - P[k, 2, 0] * g[5])
        b1 = 2.0 * (trace * g[4] - b[1] - P[k, 0, 1] * g[3] - P[k, 1, 1] * g[4] - P[k, 2, 1] * g[5])
        b2 = 2.0 * (trace * g[5] - b[2] - P[k, 0, 2] * g[3] - P[k, 1, 2] * g[4] - P[k, 2, 2] * g[5])
        for n in range(3):
            for c in range(change.shape[2]):
                change[n, r, c] = 0.0
        for j in range(first.size - 1):
            if carries[j, k]:
                for f in range(first[j], first[j + 1]):
                    c = column[f]
                    for n in range(3):
                        total = 0.0
                        for e in range(6):
                            total += y[e] * da[n, f, e]
                        if n < 2:
                            total += b0 * dv[n, f, 0] + b1 * dv[n, f, 1] + b2 * dv[n, f, 2]
                        change[n, r, c] += total
            elif carries[k, j]:
                for f in range(first[j], first[j + 1]):
                    c = column[f]
                    for n in range(3):
                        total = 0.0
                        for e in range(6):
                            total += g[e] * df[n, f, e]
                        change[n, r, c] += total


@kernel
def _is_sharp(machine: Machine, x: Tables, s: int, rows: int) -> bool:
    """Whether a contact force of site s, now zero, changes with the motion: a kink of its load."""
    last, R, p = x.axis.shape[0] - 1, machine.supply.R, machine.supply.p
    x.row_joint[last] = x.sites.joint[s]
    for e in range(rows):
        _put(x.axis, last, _to_world(R, p, 1 + x.row_joint[last], _six(x.maps, e)))
        _write_rows(machine, x, last, last + 1)
        if np.abs(x.change[:, last]).max() > _NONE:
            return True
    return False


@kernel
def _write_loads(machine: Machine, x: Tables, q: np.ndarray) -> None:
    """Write load, its gradient g in the child's frame, and its changes, of every site."""
    joint, contacts, nf = x.sites.joint, x.sites.contacts, x.motion.shape[0]
    site, rank, still, moved = contacts.site, contacts.rank, contacts.map, contacts.map_moved
    t, F, R, p = machine.plan.sites, machine.supply.force, machine.supply.R, machine.supply.p
    of_q, scale, shift = t.displacement_q, t.displacement_ratio, t.displacement_shift
    load, gradient, contact, maps, by_place = x.load, x.gradient, x.contact, x.maps, x.by_place
    for s in range(joint.size):
        load[s], x.sharp[s], by_place[s] = contacts.constant[s], False, 0.0
        for c in range(6):
            gradient[s, c] = 0.0
    for n in range(site.size):
        s, rows, square, size = site[n], rank[n], 0.0, 0.0
        w, moves, place = _six(F, 1 + joint[s]), contacts.moves[s], 0.0
        if moves:
            place = scale[s] * q[of_q[s]] + shift[s]
        for e in range(rows):
            contact[e] = 0.0
            for c in range(6):
                maps[e, c] = still[n, e, c]
                if moves:
                    maps[e, c] += place * moved[n, e, c]
                contact[e] += maps[e, c] * w[c]
                size += abs(maps[e, c] * w[c])
            square += contact[e] * contact[e]
        norm = np.sqrt(square)
        if norm <= _NONE * size:
            x.sharp[s] |= _is_sharp(machine, x, s, rows)
            continue
        load[s] += norm
        for e in range(rows):
            part = contact[e] / norm
            for c in range(6):
                gradient[s, c] += maps[e, c] * part
                if moves:
                    by_place[s] += moved[n, e, c] * w[c] * part
    for s in range(joint.size):
        _put(x.axis, nf + s, _to_world(R, p, 1 + joint[s], _six(gradient, s)))


@kernel
def differentiate_wrenches(machine: Machine, x: Tables, q: np.ndarray) -> None:
    """Write x.change: of the wrenches along the freedoms, then of the sites' loads; and the loads.

    Args:
        machine: Pinocchio's figures of the motion (`Supplier.balance` after `crba`).
        x: overwritten.
        q: (nq,).
    """
    nf, by_place, scale = x.motion.shape[0], x.by_place, machine.plan.sites.displacement_ratio
    _write_links(machine, x)
    _write_columns(machine, x)
    _write_loads(machine, x, q)
    for f in range(nf):
        _put(x.axis, f, _six(x.motion, f))
    _write_rows(machine, x, 0, nf + by_place.size)
    for s in range(by_place.size):
        x.change[0, nf + s, x.sites.velocity_index[s]] += scale[s] * by_place[s]
