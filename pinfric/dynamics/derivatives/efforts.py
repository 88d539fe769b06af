"""Derivatives of friction, efforts, gears and accelerations, from those of wrenches: kernels.

    u = tau_id - D phi,     dphi = (dphi/dc) dc + (dphi/dv) dv

    sliding     dphi/dc = -sign(v) (mu + drag_mu),
                dphi/dv = -d/ds (mu c + coulomb + drag) - viscous
    at rest     the ends of phi: dphi/dc = -+mu_s, dphi/dv = 0
    gear        d(r T_m) = slope dt + (dF/dw) dw + drag' dw + r^2 J da   (`model.drives`)

A self-locking gear at rest may have its least torque at a corner of its lines, where it does not
change with the effort.

Smoothed below a speed w, with s(y) = y (15 - 10 y^2 + 3 y^4) / 8 for |y| < 1, else sign y (two
continuous derivatives),

    phi = -s(v/w) (mu c + coulomb) - drag,     F(t) = t + |s(w_d/w)| (line(t) - t)
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.derivatives.tables import Tables
from pinfric.dynamics.derivatives.wrenches import add_change, differentiate_wrenches, six, to_world
from pinfric.dynamics.problem.accelerations import is_normalized
from pinfric.dynamics.problem.machine import Machine
from pinfric.friction.dense import solve_dense
from pinfric.kernels.compiled import kernel
from pinfric.model.drives import Gears, gear_drag, gear_line
from pinfric.model.friction_terms import STEEP
from pinfric.model.laws import Laws, is_dry, law_at
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION

#: A corner of a gear's lines is met within this part of the effort.
_CORNER = 1e-12


@kernel
def smooth_sign(y: float) -> tuple[float, float]:
    """Return s(y) of the module, and its derivative."""
    if abs(y) >= 1.0:
        return np.sign(y), 0.0
    square = y * y
    return y * (15.0 - square * (10.0 - 3.0 * square)) / 8.0, 15.0 / 8.0 * (1.0 - square) ** 2


@kernel
def _power_slope(speed: float, power: float) -> float:
    """Return the derivative of `laws.power_of`."""
    if power < 1.0 and speed < STEEP:
        return STEEP ** (power - 1.0)
    return power * speed ** (power - 1.0)


@kernel
def _law_slopes(
    laws: Laws, s: int, speed: float, against: int
) -> tuple[float, float, float, float, bool]:
    """Return the slopes by speed of a law's mu, coulomb, drag_mu, drag; whether at a kink."""
    mu, coulomb, drag_mu, drag, steep = 0.0, 0.0, 0.0, 0.0, False
    for r in range(laws.row_start[s], laws.row_end[s]):
        power, shape, fall = laws.power[r], 1.0, 0.0
        if laws.velocity[r] < np.inf:
            e, v = laws.exponent[r], laws.velocity[r]
            steep |= e < 1.0 and speed < STEEP
            y = (max(speed, STEEP) if e < 1.0 else speed) / v
            shape, fall = np.exp(-(y**e)), e / v * y ** (e - 1.0)
        if power > 0.0:
            steep |= power < 1.0 and speed < STEEP
            slope = shape * (_power_slope(speed, power) - speed**power * fall)
            drag_mu += laws.mu[r] * slope
            drag += laws.coulomb[r, against] * slope
        else:
            mu -= laws.mu[r] * shape * fall
            coulomb -= laws.coulomb[r, against] * shape * fall
    return mu, coulomb, drag_mu, drag, steep


#: The mode of a site that its velocity decides, as in inverse dynamics.
BY_VELOCITY = 2


@kernel
def _rub(
    laws: Laws, s: int, velocity: float, load: float, mode: int, width: float, end: int
) -> tuple[float, float, float, bool]:
    """Return phi, dphi/dc, dphi/dv of a site, and whether it is at a kink.

    Args:
        laws, s, velocity, load: of the site.
        mode: -1, 0, 1, or `BY_VELOCITY`.
        width: w; 0: not smoothed.
        end: where it rests, 0 the least friction, 1 the greatest.
    """
    law, way, rests = law_at(laws, s, velocity), np.sign(velocity), mode == 0
    if mode == BY_VELOCITY:
        rests = width == 0.0 and abs(velocity) <= laws.stick_velocity[s]
    d = way if mode == 0 or mode == BY_VELOCITY else float(mode)
    against = 0 if d > 0.0 else 1
    mu_rise, rise, drag_mu_rise, drag_rise, steep = _law_slopes(laws, s, abs(velocity), against)
    drag = law.viscous * velocity + way * (law.drag_mu * load + law.drag)
    by_load, by_rate = -way * law.drag_mu, -(law.viscous + drag_mu_rise * load + drag_rise)
    if rests and is_dry(law):
        sign = 2.0 * end - 1.0
        limit = law.static_mu * load + (law.static_forward if end == 0 else law.static_backward)
        creeps = way * sign < 0.0  # see `laws`
        if not creeps:
            drag = by_load = by_rate = 0.0
        return sign * limit - drag, sign * law.static_mu + by_load, by_rate, creeps and steep
    share, bend = d, 0.0
    if width > 0.0:
        share, bend = smooth_sign(velocity / width)
        steep |= velocity == 0.0 and law.forward != law.backward
    force = law.mu * load + (law.forward if d > 0.0 else law.backward)
    by_rate -= bend / max(width, 1e-300) * force + abs(share) * (mu_rise * load + rise)
    return -share * force - drag, -share * law.mu + by_load, by_rate, steep


@kernel
def _join_efforts(
    machine: Machine, x: Tables, v: np.ndarray, modes: np.ndarray, width: float
) -> None:
    """Write the ends of the joints' efforts, tau_id - D phi, and their changes.

    Args:
        modes: (ns,) of the sites; empty: by velocity.
    """
    tree, R, p, nv = machine.tree, machine.pinocchio.R, machine.pinocchio.p, v.size
    first, column, sites, joint, total = (
        tree.first_freedom,
        tree.freedom_velocity,
        x.sites,
        x.joint,
        x.joint_change,
    )
    joint[:], total[:], x.joint_kink[:] = machine.pinocchio.h, 0.0, False
    for c in range(nv):
        total[0, c, 2 * nv + c] = tree.armature[c]
    for j in range(first.size - 1):
        for g in range(first[j], first[j + 1]):
            add_change(x, j, six(x.motion, g), 1.0, total[0, column[g]])
    total[1] = total[0]
    for s in range(x.load.size):
        c, ratio, k = sites.velocity_index[s], sites.ratio[s], sites.joint[s]
        mode = int(modes[s]) if modes.size > 0 else BY_VELOCITY
        axis = to_world(R, p, 1 + k, six(x.gradient, s))
        for e in range(2):
            phi, by_load, by_rate, kink = _rub(
                sites.laws, s, ratio * v[c], x.load[s], mode, width, e
            )
            x.by_load[e, s] = by_load
            x.joint_kink[c] |= kink or (x.sharp[s] and by_load != 0.0)
            end = 1 - e if ratio >= 0.0 else e
            joint[end, c] -= ratio * phi
            add_change(x, k, axis, -ratio * by_load, total[end, c])
            total[end, c, c] -= ratio * by_load * x.by_place[s]
            total[end, c, nv + c] -= ratio * ratio * by_rate


@kernel
def _deliver(x: Tables) -> None:
    """Write the ends of the drives' efforts u = P tau, and their changes."""
    P, effort, total = x.delivery, x.effort, x.effort_change
    effort[:], total[:], x.kink[:] = 0.0, 0.0, False
    for d in range(P.shape[0]):
        for c in range(P.shape[1]):
            if P[d, c] == 0.0:
                continue
            x.kink[d] |= x.joint_kink[c]
            for end in range(2):
                of = end if P[d, c] > 0.0 else 1 - end
                effort[end, d] += P[d, c] * x.joint[of, c]
                for i in range(total.shape[2]):
                    total[end, d, i] += P[d, c] * x.joint_change[of, c, i]


@kernel
def _corner(gears: Gears, d: int, way: float, speed: float, static: bool, t: float) -> bool:
    """Whether the line of a gear changes its slope at an effort."""
    near = _CORNER * (1.0 + abs(t))
    before = gear_line(gears, d, way, speed, static, t - near)[0]
    return abs(before - gear_line(gears, d, way, speed, static, t + near)[0]) > _CORNER


@kernel
def _speed_slope(gears: Gears, d: int, way: float, speed: float, static: bool, t: float) -> float:
    """Return the derivative of a gear's F(t) by speed; its loss grows with the motor's speed^p."""
    p, size = gears.exponent[d, 0 if (t >= 0.0) == (way > 0.0) else 1], abs(gears.ratio[d])
    slope, offset, _, _ = gear_line(gears, d, way, 1.0 / size, static, t)
    at_rest = gear_line(gears, d, way, 0.0, static, t)
    rise = (slope - at_rest[0]) * t + offset - at_rest[1]  # from 0 to 1 rad/s of the motor
    return rise * size * _power_slope(size * speed, p) if rise != 0.0 else 0.0


@kernel
def _gear(
    gears: Gears, d: int, low: float, high: float, rate: float, end: int, width: float
) -> tuple[float, float, float, float, float, bool]:
    """Return the least (end 0) or greatest F(t) of a gear for t from low to high.

    Returns:
        (F, its derivatives by low, high and rate, its t, whether at a kink).
    """
    way, speed, sign = -1.0 if rate < 0.0 else 1.0, abs(rate), 2.0 * end - 1.0
    rests = width == 0.0 and speed <= gears.stick_velocity[d]
    if rests:
        way = sign
    if width > 0.0:
        high = low
    t, at, best, most = low, low, 0.0, -np.inf
    while True:  # it is at an end of a line
        slope, offset, _, last = gear_line(gears, d, way, speed, rests, t)
        if sign * (slope * t + offset) > most:
            at, best, most = t, slope, sign * (slope * t + offset)
        if not t < high:
            break
        t = min(last, high)
    F, kink = sign * most, False
    by_rate = np.sign(rate) * _speed_slope(gears, d, way, speed, rests, at)
    if width > 0.0:
        share, bend = smooth_sign(rate / width)
        back = gear_line(gears, d, -way, speed, False, at)
        kink = rate == 0.0 and abs(F + back[0] * at + back[1] - 2.0 * at) > _CORNER * abs(F)
        by_rate = abs(share) * by_rate + way * bend / width * (F - at)
        best, F = 1.0 + abs(share) * (best - 1.0), at + abs(share) * (F - at)
    by_low, by_high = best if at == low else 0.0, best if at == high > low else 0.0
    kink |= (by_low != 0.0 or by_high != 0.0) and _corner(gears, d, way, speed, rests, at)
    return F, by_low, by_high, by_rate, at, kink


@kernel
def _drag_rate(gears: Gears, d: int, rate: float) -> float:
    """Return the derivative of `drives.gear_drag`."""
    size = abs(gears.ratio[d])
    return size * size * gears.viscous[d] * _power_slope(size * abs(rate), gears.power[d])


@kernel
def _shaft(x: Tables, v: np.ndarray, a: np.ndarray, width: float) -> None:
    """Write the ends of `joint_effort` = r T_m and of T_m of every drive, and their changes."""
    gears, nv, effort, effort_change = x.gears, v.size, x.effort, x.effort_change
    for d in range(x.kink.size):
        rate, bend, r = 0.0, 0.0, gears.ratio[d]
        for c in range(nv):
            rate += x.rate[d, c] * v[c]
            bend += x.rate[d, c] * a[c]
        rotor, drag, drag_rate = r * r * gears.rotor_inertia[d], 0.0, 0.0
        if gears.viscous[d] > 0.0:
            drag, drag_rate = gear_drag(gears, d, rate), _drag_rate(gears, d, rate)
            x.kink[d] |= gears.power[d] < 1.0 and abs(r * rate) < STEEP
        for end in range(2):
            F = at = effort[end, d]
            by_low, by_high, by_rate, kink = 1.0 - end, 1.0 * end, 0.0, False
            if not x.ideal[d]:
                F, by_low, by_high, by_rate, at, kink = _gear(
                    gears, d, effort[0, d], effort[1, d], rate, end, width
                )
            x.kink[d] |= kink
            of = end if r > 0.0 else 1 - end
            x.geared[end, d] = F + rotor * bend + drag
            x.motor[of, d] = x.geared[end, d] / r
            x.through[of, 0, d], x.through[of, 1, d], x.through[of, 2, d] = (
                by_low / r,
                by_high / r,
                at,
            )
            for i in range(3 * nv):
                change = by_low * effort_change[0, d, i] + by_high * effort_change[1, d, i]
                if i >= 2 * nv:
                    change += rotor * x.rate[d, i - 2 * nv]
                elif i >= nv:
                    change += (by_rate + drag_rate) * x.rate[d, i - nv]
                x.geared_change[end, d, i], x.motor_change[of, d, i] = change, change / r


@kernel
def differentiate_efforts(
    machine: Machine, x: Tables, q: np.ndarray, v: np.ndarray, a: np.ndarray, width: float
) -> bool:
    """Write efforts, motor torques and their derivatives by q, v, a of a motion.

    Args:
        machine: after `crba` and `Pinocchio.balance` of the motion.
        x: overwritten.
        q, v, a: (nq,), (nv,), (nv,).
        width: w (rad/s or m/s); 0: not smoothed.

    Returns:
        False if q, v or a is not finite, or q not on its manifold: nothing is written.
    """
    for array in (q, v, a):
        for number in array:
            if not abs(number) <= LARGEST_OF_A_MOTION:
                return False
    if not is_normalized(machine.tree.unit_first, machine.tree.unit_count, q):
        return False
    differentiate_wrenches(machine, x, q)
    _join_efforts(machine, x, v, np.empty(0, np.int8), width)
    _deliver(x)
    _shaft(x, v, a, width)
    return True


@kernel
def _pull(machine: Machine, x: Tables, v: np.ndarray, motors: bool) -> bool:
    """Subtract S^T dt of the drives from the equations; return whether a gear is at a corner.

    With motor torques given, r T_m = F(t) + drag + r^2 J da, so dt = (r dT - ...) / slope.
    """
    rates, A, B, stuck = x.rate, x.equation, x.answer, machine.modes.stuck
    coordinate, gears = machine.plan.drives.gear_coordinate, machine.plan.drives.gears
    direction, effort, nv, corner = machine.modes.direction, machine.results.effort, v.size, False
    for d in range(rates.shape[0]):
        by_rate, rotor, per = 0.0, 0.0, 1.0
        if motors:
            c, t, rate = coordinate[d], effort[d], 0.0
            if c >= 0 and stuck[c]:
                continue  # its friction absorbs what the motor does
            for i in range(nv):
                rate += rates[d, i] * v[i]
            way = direction[c] if c >= 0 and direction[c] != 0.0 else np.sign(rate)
            slope = gear_line(gears, d, way, abs(rate), False, t)[0]
            by_rate = way * _speed_slope(gears, d, way, abs(rate), False, t)
            by_rate = (by_rate + _drag_rate(gears, d, rate)) / slope
            r = gears.ratio[d]
            rotor, per = r * r * gears.rotor_inertia[d] / slope, r / slope
            corner |= c >= 0 and _corner(gears, d, way, abs(rate), False, t)
        for c in range(nv):
            along = rates[d, c]
            if along == 0.0:
                continue
            B[c, 2 * nv + d] = along * per
            for i in range(nv):
                A[c, i] += along * rotor * rates[d, i]
                B[c, nv + i] -= along * by_rate * rates[d, i]
    return corner


@kernel
def differentiate_accelerations(
    machine: Machine,
    x: Tables,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    held: np.ndarray,
    motors: bool,
) -> tuple[bool, bool]:
    """Write the derivatives of the accelerations that forward dynamics found, in its modes.

    With R = tau_id - D phi - S^T t, which is 0, and D_s the rates of what sticks,

        [R_a, -D_s^T; D_s, 0] (da, dx_s) = (-R_q dq - R_v dv + S^T (dt/du) du, 0)

    Args:
        machine: after `Workspace.solve`, then `Pinocchio.balance` of the motion.
        x: `answer` is overwritten: (nv, 2 nv + na) by q, v, and efforts or motor torques.
        q, v, a: (nq,), (nv,), (nv,) of the solution.
        held: velocities that move no mass (`model.massless`).
        motors: whether motor torques were given.

    Returns:
        Whether there is a solution, and whether it is at a kink.
    """
    modes, stuck, D = machine.results.site_modes, machine.modes.stuck, machine.kinematics.D
    of, A, B, change = machine.plan.coordinates.velocity_index, x.equation, x.answer, x.joint_change
    nv, n, kinks = v.size, v.size, x.joint_kink
    differentiate_wrenches(machine, x, q)
    _join_efforts(machine, x, v, modes, 0.0)
    A[:], B[:] = 0.0, 0.0
    A[:nv, :nv], B[:nv, : 2 * nv] = change[0, :, 2 * nv :], -change[0, :, : 2 * nv]
    kink = _pull(machine, x, v, motors)
    for c in held:
        A[c], B[c] = 0.0, 0.0
        A[c, c] = 1.0
    for c in range(stuck.size):
        if stuck[c]:
            for i in range(nv):
                A[n, i], A[i, n] = D[c, i], -D[c, i]
            n += 1
            if of[c] >= 0:
                kinks[of[c]] = False
    for c in range(nv):
        kink |= kinks[c]
    solved = solve_dense(A[:n, :n], B[:n])
    for c in range(stuck.size):
        if stuck[c] and of[c] >= 0:
            B[of[c]] = 0.0
    return solved, kink
