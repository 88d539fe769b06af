"""From the changes of wrenches to those of friction, efforts, gears and accelerations: kernels.

    u = tau_id - D phi,     dphi = (dphi/dc) dc + (dphi/dv) dv

    sliding     dphi/dc = -sign(v) (mu + drag_mu),
                dphi/dv = -d/ds (mu c + coulomb + drag) - viscous
    at rest     the ends of phi: dphi/dc = -+mu_s, dphi/dv = 0
    gear        d(r T_m) = slope dt + (dF/dw) dw + drag' dw + r^2 J da   (`model.drives`)

A gear at rest has its least and greatest torque at an end of the interval of efforts, or, if it is
self-locking, at a corner of its lines within it, where the torque does not change with the effort.

Smoothed by a width of speeds w, with s(y) = y (15 - 10 y^2 + 3 y^4) / 8 for |y| < 1, else sign y,

    phi = -s(v/w) (mu c + coulomb) - drag,     F(t) = t + |s(w_d/w)| (line(t) - t)

s has two continuous derivatives and is exactly 1 from the width on.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.derivatives.tables import Tables
from pinfric.dynamics.derivatives.wrenches import differentiate_wrenches
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
    """Return s(y), see the module, and its derivative."""
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
    """Return the slopes by speed of a law's mu, coulomb, drag_mu, drag; whether one is steep."""
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


@kernel
def _rub(
    laws: Laws, s: int, velocity: float, load: float, mode: int, width: float, end: int
) -> tuple[float, float, float, bool]:
    """Return phi, dphi/dc, dphi/dv of a site, and whether it is at a kink.

    Args:
        laws, s, velocity, load: of the site.
        mode: -1, 0, 1, or `BY_VELOCITY`.
        width: of speeds that are smoothed; 0: none.
        end: 0 the least friction, 1 the greatest, where it rests.
    """
    law, way, dry = law_at(laws, s, velocity), np.sign(velocity), False
    dry = is_dry(law)
    d = float(mode)
    if mode == BY_VELOCITY or not dry:
        d = way
    rests = dry and mode == 0
    if mode == BY_VELOCITY:
        rests = dry and abs(velocity) <= laws.stick_velocity[s]
    against = 0 if d > 0.0 else 1
    mu_rise, rise, drag_mu_rise, drag_rise, steep = _law_slopes(laws, s, abs(velocity), against)
    drag = law.viscous * velocity + way * (law.drag_mu * load + law.drag)
    drag_rate = law.viscous + drag_mu_rise * load + drag_rise
    ahead = law.forward if d > 0.0 else law.backward
    force, force_rise = law.mu * load + ahead, mu_rise * load + rise
    if width > 0.0:
        share, bend = smooth_sign(velocity / width)
        by_rate = -bend / width * force - abs(share) * force_rise - drag_rate
        kink = steep or (velocity == 0.0 and law.forward != law.backward)
        return -share * force - drag, -share * law.mu - way * law.drag_mu, by_rate, kink
    if rests:
        sign = 2.0 * end - 1.0
        limit = law.static_mu * load + (law.static_forward if end == 0 else law.static_backward)
        if way * sign < 0.0:  # it creeps: see `laws`
            by_load = sign * law.static_mu - way * law.drag_mu
            return sign * limit - drag, by_load, -drag_rate, steep
        return sign * limit, sign * law.static_mu, 0.0, False
    return -d * force - drag, -d * law.mu - way * law.drag_mu, -force_rise - drag_rate, steep


#: The mode of a site that its velocity decides, as in inverse dynamics.
BY_VELOCITY = 2


@kernel
def _join_efforts(
    machine: Machine, x: Tables, v: np.ndarray, modes: np.ndarray, width: float
) -> None:
    """Write the ends of the joints' efforts, tau_id - D phi, and their changes.

    Args:
        modes: (ns,) of the sites; empty: by velocity.
    """
    h, armature, column = machine.supply.h, machine.tree.armature, machine.tree.freedom_velocity
    joint, total, change, kinks = x.joint, x.joint_change, x.change, x.joint_kink
    sites, load, sharp, nf, nv = x.sites, x.load, x.sharp, x.motion.shape[0], v.size
    laws, of, ratios, by_load, by_rate = (
        sites.laws,
        sites.velocity_index,
        sites.ratio,
        x.by_load,
        x.by_rate,
    )
    for end in range(2):
        for c in range(nv):
            joint[end, c], kinks[c] = h[c], False
    for n in range(3):
        for c in range(nv):
            for i in range(nv):
                total[0, n, c, i] = 0.0
    for n in range(3):
        for f in range(nf):
            for i in range(nv):
                total[0, n, column[f], i] += change[n, f, i]
    for c in range(nv):
        total[0, 2, c, c] += armature[c]
    total[1] = total[0]
    for s in range(load.size):
        c, ratio = of[s], ratios[s]
        mode = int(modes[s]) if modes.size > 0 else BY_VELOCITY
        for e in range(2):
            phi, d_load, d_rate, kink = _rub(laws, s, ratio * v[c], load[s], mode, width, e)
            by_load[e, s], by_rate[e, s] = d_load, d_rate
            kinks[c] |= kink or (sharp[s] and d_load != 0.0)
            end = 1 - e if ratio >= 0.0 else e
            joint[end, c] -= ratio * phi
            for n in range(3):
                for i in range(nv):
                    total[end, n, c, i] -= ratio * d_load * change[n, nf + s, i]
            total[end, 1, c, c] -= ratio * ratio * d_rate


@kernel
def _deliver(x: Tables) -> None:
    """Write the ends of the drives' efforts u = P tau, and their changes."""
    delivery, kink, joint_kink, effort, joint = x.delivery, x.kink, x.joint_kink, x.effort, x.joint
    total, given = x.effort_change, x.joint_change
    na, nv = delivery.shape
    for d in range(na):
        kink[d] = False
        for end in range(2):
            effort[end, d] = 0.0
            for n in range(3):
                for i in range(nv):
                    total[end, n, d, i] = 0.0
            for c in range(nv):
                P = delivery[d, c]
                if P == 0.0:
                    continue
                of = end if P > 0.0 else 1 - end
                kink[d] |= joint_kink[c]
                effort[end, d] += P * joint[of, c]
                for n in range(3):
                    for i in range(nv):
                        total[end, n, d, i] += P * given[of, n, c, i]


@kernel
def _corner(gears: Gears, d: int, way: float, speed: float, static: bool, t: float) -> bool:
    """Whether the line of a gear changes its slope at an effort."""
    near = _CORNER * (1.0 + abs(t))
    before, after = (
        gear_line(gears, d, way, speed, static, t - near)[0],
        gear_line(gears, d, way, speed, static, t + near)[0],
    )
    return abs(before - after) > _CORNER


@kernel
def _speed_slope(gears: Gears, d: int, way: float, speed: float, static: bool, t: float) -> float:
    """Return the derivative of a gear's F(t) by speed: its loss grows with the motor's speed."""
    k = 0 if (t >= 0.0) == (way > 0.0) else 1
    if not gears.rise[d, k] > 0.0:
        return 0.0
    size, side = abs(gears.ratio[d]), 0 if way > 0.0 else 1
    w, p = size * speed, gears.exponent[d, k]
    slope, offset, _, _ = gear_line(gears, d, way, speed, static, t)
    steady = gears.no_load_static[d, side] if static else gears.no_load[d, side]
    loss = way * (slope * t + offset - t) - steady
    power = w * STEEP ** (p - 1.0) if p < 1.0 and w < STEEP else w**p
    factor = gears.constant[d, k] + gears.rise[d, k] * power
    if not factor > 0.0:
        return 0.0
    return way * loss / factor * gears.rise[d, k] * _power_slope(w, p) * size


@kernel
def _extreme(
    gears: Gears, d: int, way: float, speed: float, static: bool, low: float, high: float, end: int
) -> tuple[float, float, float, float, bool]:
    """Return the least (end 0) or the greatest F(t) from low to high, and its derivatives.

    Returns:
        (F, its derivative by low, by high, by speed, whether it is at a corner).
    """
    slope, offset, _, last = gear_line(gears, d, way, speed, static, low)
    best, by_low, by_high, at = slope * low + offset, slope, 0.0, low
    sign = 2.0 * end - 1.0 if low < high else 0.0
    while last < high:
        value = slope * last + offset
        if sign * (value - best) > 0.0:
            best, by_low, at = value, 0.0, last
        slope, offset, _, last = gear_line(gears, d, way, speed, static, last)
    value = slope * high + offset
    if sign * (value - best) > 0.0:
        best, by_low, by_high, at = value, 0.0, slope, high
    corner = (by_low != 0.0 or by_high != 0.0) and _corner(gears, d, way, speed, static, at)
    return best, by_low, by_high, _speed_slope(gears, d, way, speed, static, at), corner


@kernel
def _gear(
    gears: Gears, d: int, low: float, high: float, rate: float, end: int, width: float
) -> tuple[float, float, float, float, bool]:
    """Return F of a gear at an end of its efforts, its derivatives by both ends and by the rate.

    Also whether it is at a kink.
    """
    way, speed = -1.0 if rate < 0.0 else 1.0, abs(rate)
    if width > 0.0:
        t, (share, bend) = low, smooth_sign(rate / width)
        F, slope, _, by_speed, corner = _extreme(gears, d, way, speed, False, t, t, 0)
        back = gear_line(gears, d, -way, speed, False, t)
        kink = rate == 0.0 and abs(F + back[0] * t + back[1] - 2.0 * t) > _CORNER * abs(F)
        size = abs(share)
        by_rate = way * (bend / width * (F - t) + size * by_speed)
        return t + size * (F - t), 1.0 + size * (slope - 1.0), 0.0, by_rate, kink or corner
    rests = speed <= gears.stick_velocity[d]
    if rests:
        way = 2.0 * end - 1.0
    F, by_low, by_high, by_speed, corner = _extreme(gears, d, way, speed, rests, low, high, end)
    return F, by_low, by_high, np.sign(rate) * by_speed, corner


@kernel
def _drag_rate(gears: Gears, d: int, rate: float) -> float:
    """Return the derivative of `drives.gear_drag`."""
    size = abs(gears.ratio[d])
    return size * size * gears.viscous[d] * _power_slope(size * abs(rate), gears.power[d])


@kernel
def _shaft(x: Tables, v: np.ndarray, a: np.ndarray, width: float) -> None:
    """Write the ends of `joint_effort` = r T_m and of T_m of every drive, and their changes."""
    gears, rates, nv, kinks, effort = x.gears, x.rate, v.size, x.kink, x.effort
    geared, motor, lossless = x.geared, x.motor, x.ideal
    given, total, at_shaft = x.effort_change, x.geared_change, x.motor_change
    for d in range(kinks.size):
        rate, bend, r = 0.0, 0.0, gears.ratio[d]
        for c in range(nv):
            rate += rates[d, c] * v[c]
            bend += rates[d, c] * a[c]
        rotor, drag_rate, drag = r * r * gears.rotor_inertia[d], 0.0, 0.0
        if gears.viscous[d] > 0.0:
            drag, drag_rate = gear_drag(gears, d, rate), _drag_rate(gears, d, rate)
            kinks[d] |= gears.power[d] < 1.0 and abs(r * rate) < STEEP
        for end in range(2):
            F, by_low, by_high, by_rate, kink = effort[end, d], 1.0 - end, 1.0 * end, 0.0, False
            if not lossless[d]:
                low, high = effort[0, d], effort[1, d]
                F, by_low, by_high, by_rate, kink = _gear(gears, d, low, high, rate, end, width)
            kinks[d] |= kink
            of = end if r > 0.0 else 1 - end
            geared[end, d] = F + rotor * bend + drag
            motor[of, d] = geared[end, d] / r
            for n in range(3):
                own = 0.0
                if n == 1:
                    own = by_rate + drag_rate
                elif n == 2:
                    own = rotor
                for c in range(nv):
                    change = by_low * given[0, n, d, c] + by_high * given[1, n, d, c]
                    change += own * rates[d, c]
                    total[end, n, d, c], at_shaft[of, n, d, c] = change, change / r


@kernel
def differentiate_efforts(
    machine: Machine, x: Tables, q: np.ndarray, v: np.ndarray, a: np.ndarray, width: float
) -> bool:
    """Write efforts, torques of motors and their derivatives by q, v, a of a motion.

    Args:
        machine: Pinocchio's figures of the motion (`Supplier.balance` after `crba`).
        x: overwritten.
        q, v, a: (nq,), (nv,), (nv,).
        width: 0, or rad/s and m/s below which friction is smooth.

    Returns:
        Whether q, v and a are finite, and q on its manifold; else nothing is written.
    """
    if not _is_usual(machine, q, v, a):
        return False
    differentiate_wrenches(machine, x, q)
    _join_efforts(machine, x, v, np.empty(0, np.int8), width)
    _deliver(x)
    _shaft(x, v, a, width)
    return True


@kernel
def _is_usual(machine: Machine, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> bool:
    """Whether a motion is finite and not impossibly large, and q is on its manifold."""
    for one in (q, v, a):
        for i in range(one.size):
            if not abs(one[i]) <= LARGEST_OF_A_MOTION:
                return False
    return is_normalized(machine.tree.unit_first, machine.tree.unit_count, q)


@kernel
def _pull(machine: Machine, x: Tables, v: np.ndarray, motors: bool) -> bool:
    """Subtract S^T dt of the drives from the equations; return whether a gear is at a corner.

    Of motors given, r T_m = F(t) + drag + r^2 J da, so dt = (r dT - ...) / slope.
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
        machine: after `Workspace.solve`; Pinocchio's figures are those of the motion.
        x: `answer` is overwritten: (nv, 2 nv + na) by q, v, and efforts or torques of motors.
        q, v, a: (nq,), (nv,), (nv,) of the solution.
        held: velocities that move no mass (`model.massless`).
        motors: whether torques of motors were given.

    Returns:
        (whether there is a solution, whether it is at a kink).
    """
    modes, stuck, D = machine.results.site_modes, machine.modes.stuck, machine.kinematics.D
    of, A, B, change = machine.plan.coordinates.velocity_index, x.equation, x.answer, x.joint_change
    nv, n, kinks = v.size, v.size, x.joint_kink
    differentiate_wrenches(machine, x, q)
    _join_efforts(machine, x, v, modes, 0.0)
    A[:] = 0.0
    B[:] = 0.0
    for c in range(nv):
        for i in range(nv):
            A[c, i] = change[0, 2, c, i]
            B[c, i], B[c, nv + i] = -change[0, 0, c, i], -change[0, 1, c, i]
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
