"""From the motion of a state to its accelerations as affine functions of friction.

    M = S^T I S + armature,     rate = D v of the coordinates,     s' = S v of the drives

    M a + h = S u + J_c^T lambda + D x,     J_c a + gamma = 0       (paper eq. 1-7)
    a = a_closure + Z (Z^T M Z)^-1 Z^T (push + D^T x),     push = S u - h - M a_closure
    r = D a + dD/dt v = rate_free + rate_slope x,     rate_slope = D Z (Z^T M Z)^-1 Z^T D^T

Z are the motions that loops allow; for a tree Z = 1 and a_closure = 0. Momenta are about the
world's origin, so that no difference against gravity is taken (Featherstone, Rigid Body Dynamics
Algorithms, 6.2).

The torque at a gear's input is u - I s'', with u = r T_m - drag, I = r^2 J_rotor. A gear without
losses delivers it: an armature I and an effort. Losses are friction beside that (`friction.gears`).
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.machine import Machine, PinocchioData, Tree
from pinfric.dynamics.problem.plan import Coordinates
from pinfric.friction.dense import affine, factorize, solve_balance
from pinfric.kernels.compiled import kernel, late_kernel
from pinfric.model.drives import gear_drag, gear_line, held_efforts
from pinfric.model.kinematics import act_on_joints, relate_pairs
from pinfric.model.laws import law_at

Vector6 = tuple[float, float, float, float, float, float]


@kernel
def carry(tree: Tree, k: PinocchioData, j: int, s: Vector6) -> Vector6:
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
def write_mass_matrix(machine: Machine) -> None:
    """Write M = S^T I S + armature, rotors included.

    `data.M` is wrong where joints are not numbered depth first.
    """
    t, M, drives = machine.tree, machine.maps.M, machine.kinematics.S
    S, A = machine.kinematics.motion, machine.kinematics.momentum
    first, velocity = t.first_freedom, t.freedom_velocity
    for i in range(M.shape[0]):
        for j in range(M.shape[0]):
            M[i, j] = t.armature[i] + t.held_inertia[i] if i == j else 0.0
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
    for d in range(drives.shape[0]):
        armature = machine.rotors.inertia[d]
        for j in range(M.shape[0] if armature != 0.0 else 0):
            if armature * drives[d, j] != 0.0:
                for k in range(M.shape[0]):
                    M[j, k] += armature * drives[d, j] * drives[d, k]


@late_kernel("loops")
def _relate_frames(machine: Machine) -> None:
    """Write how the frames of all pairs are related, at a = 0."""
    data, k, gravity = machine.pinocchio, machine.kinematics, machine.tree.gravity
    R, p, velocity, acceleration = k.R, k.p, k.velocity, k.acceleration
    v, a = data.velocity[1:], data.acceleration[1:]
    moves = 0.0  # at rest nothing accelerates: gravity would leave its rounding
    for j in range(R.shape[1]):
        for r in range(6):
            moves += abs(v[j, r])
    for j in range(R.shape[1]):
        for r in range(3):
            p[0, j, r] = data.p[1 + j, r]
            for c in range(3):
                R[0, j, r, c] = data.R[1 + j, r, c]
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
        k.gap,
        k.rate,
        k.rate_derivative,
        k.tilt,
        k.terms,
    )


@kernel
def measure_rates(machine: Machine, v: np.ndarray) -> None:
    """Write the relative velocity of every coordinate, of which poses and velocities are known."""
    k, actions = machine.kinematics, machine.plan.coordinates.action
    if k.tilt.size > 0:
        _relate_frames(machine)
    for c in range(k.coordinate_rate.size):
        action = actions[c]
        k.coordinate_rate[c] = k.rate[0, action] if action >= 0 else 0.0
        for i in range(v.size if action < 0 else 0):
            k.coordinate_rate[c] += k.D[c, i] * v[i]


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
    """Whether q is normalized and obeys the loops to 1e-8 of their size and speed.

    Gaps and rates are written.
    """
    t, k = machine.plan.closure, machine.kinematics
    if not is_normalized(machine.tree.unit_first, machine.tree.unit_count, q):
        return False
    for r in range(t.off_joint, t.off_joint + t.multipliers):
        pair = t.actions.column_pair[r]
        if not abs(k.gap[0, r]) < 1e-8 * t.scale:
            return False
        if not abs(k.rate[0, r]) <= 1e-8 * k.terms[0, pair, 0]:
            return False
        if not k.tilt[0, pair] < 1e-8 and t.planar[pair]:
            return False
    return True


@kernel
def write_laws(machine: Machine, step: float) -> None:
    """Write the law of every site's entry at its speed (see `laws`).

    In a time step, what vanishes at rest goes into `drag` and `damping` instead, under the loads of
    the last solution.
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


@late_kernel("loops")
def _act_on_joints(machine: Machine) -> None:
    """Write what actions do to joints; frames are related."""
    k = machine.kinematics
    act_on_joints(k.p, k.R, machine.plan.closure.actions, k.X, k.J)


@kernel
def relate(machine: Machine, v: np.ndarray) -> None:
    """Write pairs, D, S and the relative velocity of every coordinate; poses are known."""
    k, drive = machine.kinematics, machine.plan.drives.action
    action = machine.plan.coordinates.action
    D, S, J, rate = k.D, k.S, k.J, k.coordinate_rate
    # 1. how the frames of all pairs are related, and what actions do to joints
    if k.tilt.size > 0:
        _relate_frames(machine)
        _act_on_joints(machine)
    # 2. D and its rates
    for c in range(action.size):
        rate[c] = 0.0
        for i in range(v.size):
            if action[c] >= 0:
                D[c, i] = J[0, action[c], i]
            rate[c] += D[c, i] * v[i]
    # 3. S
    for d in range(drive.size):
        if drive[d] >= 0:
            for i in range(v.size):
                S[d, i] = J[0, drive[d], i]


@kernel
def move(machine: Machine, v: np.ndarray) -> None:
    """Write motion and momentum of every freedom, and what `relate` writes."""
    tree, k = machine.tree, machine.pinocchio
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
    relate(machine, v)


@late_kernel("gears")
def write_gears(machine: Machine, v: np.ndarray, given: np.ndarray, step: float) -> None:
    """Write rotors, and the laws of gears with losses, where motors drive.

    Args:
        machine: rates are written.
        v: (nv,).
        given: (na,) r T_m (N m or N at the joint).
        step: 0, or a time step (s), at whose end viscous friction acts.
    """
    drives, k, p, rotors = machine.plan.drives, machine.kinematics, machine.problem, machine.rotors
    gears, scale = drives.gears, step if step > 0.0 else 1.0
    for d in range(gears.ratio.size):
        rate, bend = 0.0, 0.0
        for i in range(v.size):
            rate += k.S[d, i] * v[i]
        if drives.action[d] >= 0:
            bend = k.rate_derivative[0, drives.action[d]]
        drag = gear_drag(gears, d, rate)
        inertia = gears.ratio[d] * gears.ratio[d] * gears.rotor_inertia[d]
        if step > 0.0 and rate != 0.0:
            inertia += step * max(0.5 * gears.power[d], 1.0) * drag / rate  # as `_add_drag` does
        rotors.inertia[d] = inertia
        rotors.arriving[d] = given[d] - drag - inertia * bend
        c = drives.gear_coordinate[d]
        if c < 0:
            continue
        g = drives.gear_entry[d] - machine.plan.entries.site.size
        p.gear_rotor[g, 1] = inertia / scale
        p.gear_rotor[g, 0] = given[d] - drag
        if step > 0.0:
            p.gear_rotor[g, 0] += inertia * (rate / step - bend)
        m = machine.modes
        slow = abs(rate) <= machine.plan.coordinates.stick_velocity[c]
        rests = slow or m.stuck[c] or step > 0.0
        _write_lines(machine, d, g, abs(rate), 4 if rests else 2)
        if rests:
            _write_held(machine, d, g)


@kernel
def _write_lines(machine: Machine, d: int, g: int, speed: float, laws: int) -> None:
    """Write the lines of a gear at a speed: 2 laws, or 4, of which two are from rest."""
    gears, lines = machine.plan.drives.gears, machine.problem.gear_lines[g]
    for law in range(laws):
        way, k, start = 1.0 if law % 2 == 0 else -1.0, 0, -np.inf
        while start < np.inf:
            now = speed if law < 2 else 0.0
            slope, offset, low, start = gear_line(gears, d, way, now, law > 1, start)
            lines[law, k, 0], lines[law, k, 1], lines[law, k, 2] = slope, offset, low
            k += 1
        for more in range(k, lines.shape[1]):
            lines[law, more, 0], lines[law, more, 2] = lines[law, k - 1, 0], np.inf


@kernel
def _write_held(machine: Machine, d: int, g: int) -> None:
    """Write the intervals of efforts that a gear at rest holds; it holds that of u at first."""
    p, e = machine.problem, machine.plan.drives.gear_entry[d]
    held, given = p.gear_held[g], p.gear_rotor[g, 0]
    for k in range(held_efforts(machine.plan.drives.gears, d, given, held), held.shape[0]):
        held[k, 0], held[k, 1] = np.inf, -np.inf
    for k in range(held.shape[0]):
        if held[k, 0] <= given <= held[k, 1]:
            p.coulomb_stick[e, 0], p.coulomb_stick[e, 1] = given - held[k, 0], held[k, 1] - given


@kernel
def write_delivered(machine: Machine) -> None:
    """Write the efforts that drives deliver, without gears' friction, as maps of friction."""
    S, a_map, out = machine.kinematics.S, machine.maps.acceleration, machine.maps.delivered
    for d in range(out.shape[0]):
        armature = machine.rotors.inertia[d]
        for n in range(out.shape[1]):
            out[d, n] = 0.0
        out[d, 0] = machine.rotors.arriving[d]
        for i in range(S.shape[1] if armature > 0.0 else 0):
            if S[d, i] != 0.0:
                for n in range(out.shape[1]):
                    out[d, n] -= armature * S[d, i] * a_map[i, n]


@kernel
def write_efforts(machine: Machine) -> None:
    """Write what each drive delivers in the solution; a gear at rest has its share of friction."""
    drives, modes, found = machine.plan.drives, machine.modes, machine.results
    affine(machine.maps.delivered, modes.friction, found.effort)
    for d in range(drives.gear_entry.size):
        e, c = drives.gear_entry[d], drives.gear_coordinate[d]
        found.driving[d] = 0
        if e >= 0 and modes.stuck[c]:
            found.effort[d] += found.entry_phi[e]
        elif e >= 0:
            found.effort[d] = modes.effort[e - machine.plan.entries.site.size]
            found.driving[d] = np.sign(modes.direction[c] * found.effort[d])


#: Outcomes beside 0: all is written.
NOT_FINITE, SINGULAR, TOGGLE = 1, 2, 3
#: A joint with a share in the mechanism's motion below this is at its dead centre.
_IDLE = 1e-4
#: A share below this counts as zero, as singular values do (`balance.RANK`): rates divided by it
#: would be rounding.
_DEAD = 1e-9


@kernel
def _reduce(machine: Machine) -> bool:
    """Write accelerations and the factor A of D a_slope = A^T A in a tree; False: M is singular."""
    maps, D, L, Y = machine.maps, machine.kinematics.D, machine.scratch.lower, machine.scratch.right
    M, push, a_closure, a_map = maps.M, maps.push, maps.a_closure, maps.acceleration
    nv, nc = M.shape[0], D.shape[0]
    for i in range(nv):
        row = nv - 1 - i  # the last first: what is 0 in M between two branches is 0 in L
        Y[row, 0] = push[i]
        for j in range(nv):
            L[row, nv - 1 - j] = M[i, j]
        for c in range(nc):
            Y[row, 1 + c] = D[c, i]
    if not factorize(L):
        return False
    substitute(L, Y, maps.factor)
    for i in range(nv):
        for k in range(1 + nc):
            a_map[i, k] = a_closure[i] if k == 0 else 0.0
            a_map[i, k] += Y[nv - 1 - i, k]
    return True


@late_kernel("loops")
def _reduce_closed(machine: Machine, d: int) -> bool:
    """Write the same where loops leave d freedoms, along Z."""
    maps, D = machine.maps, machine.kinematics.D
    M, Z, push, a_closure, a_map = maps.M, maps.Z, maps.push, maps.a_closure, maps.acceleration
    nv, nc = M.shape[0], D.shape[0]
    L, Y, MZ = np.zeros((d, d)), np.zeros((d, 1 + nc)), np.zeros((nv, d))
    for i in range(nv):
        for j in range(nv):
            for f in range(d):
                MZ[i, f] += M[i, j] * Z[j, f]
    for i in range(nv):
        for f in range(d):
            for g in range(d):
                L[f, g] += Z[i, f] * MZ[i, g]
            Y[f, 0] += Z[i, f] * push[i]
            for c in range(nc):
                Y[f, 1 + c] += Z[i, f] * D[c, i]
    if not factorize(L):
        return False
    substitute(L, Y, maps.factor)
    for i in range(nv):
        for k in range(1 + nc):
            a_map[i, k] = a_closure[i] if k == 0 else 0.0
        for f in range(d):
            for k in range(1 + nc):
                a_map[i, k] += Z[i, f] * Y[f, k]
    return True


@kernel
def substitute(L: np.ndarray, Y: np.ndarray, factor: np.ndarray) -> None:
    """Overwrite Y (d, 1 + nc) with (L L^T)^-1 Y; factor with L^-1 Y[:, 1:]."""
    d, columns = Y.shape
    for f in range(d):
        for g in range(f):
            for k in range(columns if L[f, g] != 0.0 else 0):
                Y[f, k] -= L[f, g] * Y[g, k]
        for k in range(columns):
            Y[f, k] /= L[f, f]
            if k > 0:
                factor[f, k - 1] = Y[f, k]
    for f in range(d - 1, -1, -1):
        for g in range(f + 1, d):
            for k in range(columns if L[g, f] != 0.0 else 0):
                Y[f, k] -= L[g, f] * Y[g, k]
        for k in range(columns):
            Y[f, k] /= L[f, f]


@kernel
def _write_problem_rates(machine: Machine, v: np.ndarray, step: float) -> None:
    """Write r = D a + Ddot v, or of a step D (v + step a), and its slope.

    Args:
        v: (nv,).
        step: s, or 0.
    """
    maps, k, p = machine.maps, machine.kinematics, machine.problem
    D, a_map, factor, terms, d = (
        k.D,
        maps.acceleration,
        maps.factor,
        maps.push_terms,
        maps.freedoms[0],
    )
    action, rate_derivative = machine.plan.coordinates.action, k.rate_derivative
    rate_free, rate_scale, rate_slope = p.rate_free, p.rate_scale, p.rate_slope
    nc, nv = D.shape
    scale = step if step > 0.0 else 1.0
    root, dead = np.sqrt(scale), np.empty(nc, np.bool_)
    for c in range(nc):
        dead[c] = False
    if k.tilt.size > 0:  # there are pairs, along which coordinates may depend on each other
        _find_dead_centres(machine, dead)
    for c in range(nc):
        total, offset, size = 0.0, 0.0, 0.0
        for i in range(nv):
            size += scale * terms[i] * abs(a_map[i, 1 + c])
            if D[c, i] != 0.0:
                total += D[c, i] * (maps.a_closure[i] if dead[c] else a_map[i, 0])
                if step > 0.0:
                    offset += D[c, i] * v[i]
                    size += abs(D[c, i] * v[i])
        if step == 0.0 and action[c] >= 0:
            offset = rate_derivative[0, action[c]]
            size += abs(offset)
        rate_free[c], rate_scale[c] = scale * total + offset, size
        for f in range(d):
            factor[f, c] *= root
    rate_slope[:] = 0.0
    for f in range(d):
        for c in range(nc):
            along = factor[f, c]
            for e in range(c + 1 if along != 0.0 else 0):
                rate_slope[c, e] += along * factor[f, e]
    for c in range(nc):
        for e in range(c):
            rate_slope[e, c] = rate_slope[c, e]


@late_kernel("loops")
def _find_dead_centres(machine: Machine, dead: np.ndarray) -> None:
    """Mark joints that stand still while the mechanism moves, in `dead` (nc,); their slope is 0."""
    D, maps, size_of = machine.kinematics.D, machine.maps, machine.plan.coordinates.direction_size
    Z, factor, d = maps.Z, maps.factor, maps.freedoms[0]
    nc, nv = D.shape
    most = 0.0
    for i in range(nv):
        for f in range(d):
            most = max(most, abs(Z[i, f]))
    for c in range(nc):
        speed, size = 0.0, size_of[c]
        for f in range(d):
            total = 0.0
            for i in range(nv):
                total += D[c, i] * Z[i, f]
            speed = max(speed, abs(total))
        for i in range(nv):
            size = max(size, abs(D[c, i]))
        maps.idle[c] = speed <= _IDLE * size * most
        dead[c] = speed <= _DEAD * size * most
        if dead[c]:
            for f in range(d):
                factor[f, c] = 0.0


@kernel
def _add_drag(machine: Machine, step: float) -> None:
    """Let drag d act at the end of the step, d + c (v' - v): M + step D^T c D, S u - D^T d.

    c is the larger of the secant d/|v|, so that drag reverses no motion, and half its slope, so
    that speeds converge to the balance of drag and drive at any step.
    """
    M, drag, damping = machine.maps.M, machine.maps.drag, machine.maps.damping
    D, unbalanced = machine.kinematics.D, machine.maps.unbalanced
    nc, nv = D.shape
    for c in range(nc):
        if damping[c] == 0.0:
            continue
        for i in range(nv):
            if D[c, i] != 0.0:
                unbalanced[i] -= D[c, i] * drag[c]
                for j in range(nv):
                    M[i, j] += step * D[c, i] * damping[c] * D[c, j]


@late_kernel("loops")
def _close(machine: Machine, v: np.ndarray, step: float) -> int:
    """Write Z and a_closure, return J's rank; of a step, such that loops' rates end as zero.

    Full pivoting chooses dependent and independent velocities (paper eq. 5, 6).
    """
    t, maps, k, nv = machine.plan.closure, machine.maps, machine.kinematics, v.size
    A = np.empty((t.multipliers, nv + 1))
    for r in range(t.multipliers):
        row = t.off_joint + r
        A[r, nv] = 0.0 if step > 0.0 else -k.rate_derivative[0, row]
        for i in range(nv):
            A[r, i] = k.J[0, row, i]
            if step > 0.0:
                A[r, nv] -= A[r, i] * v[i] / step
    return solve_balance(A, t.scale, maps.a_closure.reshape((nv, 1)), maps.Z)


@kernel
def write_accelerations(
    machine: Machine, q: np.ndarray, v: np.ndarray, effort: np.ndarray, step: float
) -> int:
    """Write accelerations and relative accelerations as maps of friction.

    Args, returns: see `instant.solve_instant`. Rates and laws must be written.
    """
    t, maps = machine.plan.closure, machine.maps
    M, h, terms = maps.M, machine.pinocchio.h, maps.push_terms
    unbalanced, push = maps.unbalanced, maps.push
    nv, closed, rank = v.size, t.multipliers > 0, 0
    motors, arriving = machine.plan.drives.gears.ratio.size > 0, machine.rotors.arriving
    if motors:
        write_gears(machine, v, effort, step)
    unbalanced[:] = 0.0
    for d in range(effort.size):
        if not motors:
            arriving[d] = effort[d]
        for i in range(nv):
            unbalanced[i] += machine.kinematics.S[d, i] * arriving[d]
    write_mass_matrix(machine)
    if step > 0.0:
        _add_drag(machine, step)
    if closed:
        rank = _close(machine, v, step)
    maps.freedoms[0] = nv - rank
    if closed and rank < nv - t.freedoms:
        return TOGGLE
    size = 0.0
    for i in range(q.size):
        size += abs(q[i])
    for i in range(nv):
        terms[i] = abs(unbalanced[i]) + abs(h[i])
        push[i] = unbalanced[i] = unbalanced[i] - h[i]
        if closed:
            for j in range(nv):
                push[i] -= M[i, j] * maps.a_closure[j]
        size += abs(push[i]) + abs(v[i])
    if not (_reduce_closed(machine, nv - rank) if closed else _reduce(machine)):
        for i in range(nv):
            for j in range(nv):
                size += abs(M[i, j])
        return SINGULAR if size < np.inf else NOT_FINITE
    if not size < np.inf:
        return NOT_FINITE
    write_delivered(machine)
    _write_problem_rates(machine, v, step)
    return 0
