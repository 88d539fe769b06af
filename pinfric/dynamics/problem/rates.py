"""Kinematics of a state: motions and momenta, mass matrix, rates of coordinates, friction laws.

    M = S^T I S + armature,     s' = S v of the drives,     rate = D v of the coordinates

Poses, velocities and composite inertias are Pinocchio's. Momenta are about the world's origin, so
that no difference against gravity is taken (Featherstone, Rigid Body Dynamics Algorithms, 6.2).
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.machine import Machine, Supply, Tree
from pinfric.dynamics.problem.plan import Coordinates
from pinfric.kernels.compiled import kernel
from pinfric.model.kinematics import act_on_joints, relate_pairs
from pinfric.model.laws import law_at

Vector6 = tuple[float, float, float, float, float, float]


@kernel
def carry(tree: Tree, k: Supply, j: int, s: Vector6) -> Vector6:
    """Return the momentum of what joint j carries if it moves by s, about the world's origin."""
    m, x, y, z = tree.mass[j], k.lever[1 + j, 0], k.lever[1 + j, 1], k.lever[1 + j, 2]
    vx, vy, vz, wx, wy, wz = s
    fx, fy, fz = m * (vx + wy * z - wz * y), m * (vy + wz * x - wx * z), m * (vz + wx * y - wy * x)
    xx, xy, yy = k.inertia[1 + j, 0], k.inertia[1 + j, 1], k.inertia[1 + j, 2]
    xz, yz, zz = k.inertia[1 + j, 3], k.inertia[1 + j, 4], k.inertia[1 + j, 5]
    return (
        fx,
        fy,
        fz,
        xx * wx + xy * wy + xz * wz + y * fz - z * fy,
        xy * wx + yy * wy + yz * wz + z * fx - x * fz,
        xz * wx + yz * wy + zz * wz + x * fy - y * fx,
    )


@kernel
def _move_freedoms(machine: Machine) -> None:
    """Write motion and momentum of every freedom."""
    tree, k = machine.tree, machine.supply
    R, p, S, A = k.R[1:], k.p[1:], machine.kinematics.motion, machine.kinematics.momentum
    twist, first = tree.twist, tree.first_freedom
    for j in range(tree.parent.size):
        for f in range(first[j], first[j + 1]):
            for r in range(3):
                S[f, r] = S[f, 3 + r] = 0.0
                for c in range(3):
                    S[f, r] += R[j, r, c] * twist[f, c]
                    S[f, 3 + r] += R[j, r, c] * twist[f, 3 + c]
            S[f, 0] += p[j, 1] * S[f, 5] - p[j, 2] * S[f, 4]
            S[f, 1] += p[j, 2] * S[f, 3] - p[j, 0] * S[f, 5]
            S[f, 2] += p[j, 0] * S[f, 4] - p[j, 1] * S[f, 3]
            s = S[f, 0], S[f, 1], S[f, 2], S[f, 3], S[f, 4], S[f, 5]
            A[f, 0], A[f, 1], A[f, 2], A[f, 3], A[f, 4], A[f, 5] = carry(tree, k, j, s)


@kernel
def write_mass_matrix(machine: Machine) -> None:
    """Write M = S^T I S + armature.

    `data.M` is not used, because `crba` assumes that joints are numbered depth first, which is not
    always true for models made in Python.
    """
    t, M = machine.tree, machine.maps.M
    S, A = machine.kinematics.motion, machine.kinematics.momentum
    first, velocity = t.first_freedom, t.freedom_velocity
    for i in range(M.shape[0]):
        for j in range(M.shape[0]):
            M[i, j] = t.armature[i] if i == j else 0.0
    for j in range(t.parent.size):
        for g in range(first[j], first[j + 1]):
            i = j
            while i >= 0:
                for f in range(first[i], min(first[i + 1], g + 1)):
                    total = 0.0
                    for e in range(6):
                        total += S[f, e] * A[g, e]
                    M[velocity[f], velocity[g]] += total
                    if f != g:
                        M[velocity[g], velocity[f]] += total
                i = t.parent[i]


@kernel
def _relate_frames(machine: Machine) -> None:
    """Write how the frames of all pairs are related, at a = 0."""
    k, w, gravity = machine.supply, machine.kinematics, machine.tree.gravity
    R, p, velocity, acceleration = w.R, w.p, w.velocity, w.acceleration
    v, a = k.velocity[1:], k.acceleration[1:]
    moves = 0.0  # at rest nothing accelerates: gravity would leave its rounding
    for j in range(R.shape[1]):
        for r in range(6):
            moves += abs(v[j, r])
    for j in range(R.shape[1]):
        for r in range(3):
            p[0, j, r] = k.p[1 + j, r]
            for c in range(3):
                R[0, j, r, c] = k.R[1 + j, r, c]
        # spatial accelerations become those of the frame's origin
        ax = a[j, 0] + v[j, 4] * v[j, 2] - v[j, 5] * v[j, 1]
        ay = a[j, 1] + v[j, 5] * v[j, 0] - v[j, 3] * v[j, 2]
        az = a[j, 2] + v[j, 3] * v[j, 1] - v[j, 4] * v[j, 0]
        for r in range(3):
            x, y, z = R[0, j, r, 0], R[0, j, r, 1], R[0, j, r, 2]
            velocity[0, j, r] = x * v[j, 0] + y * v[j, 1] + z * v[j, 2]
            velocity[0, j, 3 + r] = x * v[j, 3] + y * v[j, 4] + z * v[j, 5]
            acceleration[0, j, r] = acceleration[0, j, 3 + r] = 0.0
            if moves > 0.0:
                acceleration[0, j, r] = x * ax + y * ay + z * az + gravity[r]
                acceleration[0, j, 3 + r] = x * a[j, 3] + y * a[j, 4] + z * a[j, 5]
    relate_pairs(
        p,
        R,
        velocity,
        acceleration,
        machine.plan.closure.actions,
        w.gap,
        w.rate,
        w.rate_derivative,
        w.tilt,
        w.terms,
    )


@kernel
def _move_pairs(machine: Machine) -> None:
    """Write how the frames of all pairs are related, and what actions do to joints."""
    w = machine.kinematics
    if w.tilt.size > 0:
        _relate_frames(machine)
        act_on_joints(w.p, w.R, machine.plan.closure.actions, w.X, w.J)


@kernel
def measure_rates(machine: Machine, v: np.ndarray) -> None:
    """Write the relative velocity of every coordinate, of which poses and velocities are known."""
    w, actions = machine.kinematics, machine.plan.coordinates.action
    _relate_frames(machine)
    for c in range(w.coordinate_rate.size):
        action = actions[c]
        w.coordinate_rate[c] = w.rate[0, action] if action >= 0 else 0.0
        for i in range(v.size if action < 0 else 0):
            w.coordinate_rate[c] += w.D[c, i] * v[i]


@kernel
def is_normalized(first: np.ndarray, count: np.ndarray, q: np.ndarray) -> bool:
    """Whether the parts of q that begin at `first` and are `count` long have length 1."""
    for n in range(first.size):
        square = 0.0
        for i in range(first[n], first[n] + count[n]):
            square += q[i] * q[i]
        if not abs(square - 1.0) < 1e-14:
            return False
    return True


@kernel
def is_exact(machine: Machine, q: np.ndarray) -> bool:
    """Whether q is normalized and obeys the loops closely; their gaps and rates are written.

    To 1e-8 of a loop's size and speed; `closure.check_closed` says what is wrong with others.
    """
    t, w = machine.plan.closure, machine.kinematics
    if not is_normalized(machine.tree.unit_first, machine.tree.unit_count, q):
        return False
    for r in range(t.off_joint, t.off_joint + t.multipliers):
        pair = t.actions.column_pair[r]
        if not abs(w.gap[0, r]) < 1e-8 * t.scale:
            return False
        if not abs(w.rate[0, r]) <= 1e-8 * w.terms[0, pair, 0]:
            return False
        if not w.tilt[0, pair] < 1e-8 and t.planar[pair]:
            return False
    return True


@kernel
def _write_rates(machine: Machine, v: np.ndarray) -> None:
    """Write D, S and the relative velocity of every coordinate."""
    w, drive = machine.kinematics, machine.plan.drives.action
    action = machine.plan.coordinates.action
    D, S, J, rate = w.D, w.S, w.J, w.coordinate_rate
    for c in range(action.size):
        rate[c] = 0.0
        for i in range(v.size):
            if action[c] >= 0:
                D[c, i] = J[0, action[c], i]
            rate[c] += D[c, i] * v[i]
    for d in range(drive.size):
        if drive[d] >= 0:
            for i in range(v.size):
                S[d, i] = J[0, drive[d], i]


@kernel
def write_laws(machine: Machine, step: float) -> None:
    """Write the law of every site's entry at its present speed (see `laws`).

    Of a time step, what vanishes at rest goes into `drag` and `damping` (see `accelerations`), not
    into the entries' laws, under the loads of the last solution.
    """
    entries, coordinates, p = machine.plan.entries, machine.plan.coordinates, machine.problem
    laws, rate = machine.plan.sites.laws, machine.kinematics.coordinate_rate
    drags, damping = machine.maps.drag, machine.maps.damping
    for c in range(rate.size):
        drags[c] = damping[c] = 0.0
    for e in range(entries.coordinate.size):
        c, ratio = entries.coordinate[e], p.ratio[e]
        velocity = ratio * rate[c]
        speed = ball_speed(coordinates, rate, c) if coordinates.ball[c] else abs(velocity)
        towards = velocity / speed if speed > 0.0 else 0.0  # a ball's drag lies along its velocity
        law = law_at(laws, entries.site[e], np.copysign(speed, velocity), step > 0.0)
        p.mu_stick[e] = law.static_mu
        p.coulomb_stick[e, 0], p.coulomb_stick[e, 1] = law.static_forward, law.static_backward
        p.coulomb_slip[e, 0], p.coulomb_slip[e, 1] = law.forward, law.backward
        if step == 0.0:
            p.mu_slip[e] = law.mu + law.drag_mu
            p.drag[e] = law.viscous * velocity + law.drag * towards
            continue
        load = machine.modes.load[e] if law.drag_mu > 0.0 else 0.0
        drag, slope = law.drag + law.drag_mu * load, law.drag_slope + law.drag_mu_slope * load
        p.mu_slip[e], p.drag[e] = law.mu, 0.0
        drags[c] += ratio * (law.viscous * velocity + drag * towards)
        damping[c] += ratio * ratio * law.viscous
        if drag > 0.0:
            damping[c] += ratio * ratio * max(drag / speed, 0.5 * slope)


@kernel
def ball_speed(coordinates: Coordinates, rate: np.ndarray, c: int) -> float:
    """The angular speed of the ball that coordinate c belongs to."""
    first = coordinates.block[c]
    return np.sqrt(rate[first] ** 2 + rate[first + 1] ** 2 + rate[first + 2] ** 2)


@kernel
def relate(machine: Machine, v: np.ndarray) -> None:
    """Write rates, D and S at a state of which only poses and velocities are known."""
    _move_pairs(machine)
    _write_rates(machine, v)


@kernel
def move(machine: Machine, v: np.ndarray) -> None:
    """Write all quantities that depend only on the motion: joint motions, pairs and rates."""
    _move_freedoms(machine)
    relate(machine, v)
