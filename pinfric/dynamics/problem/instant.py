"""One instant: from a state to its friction problem, its modes and its accelerations.

    state -> move, write_laws -> write_accelerations -> write_wrenches -> try_modes -> finish

Until `try_modes` finds friction x everything is affine in it: a = a[:, 0] + a[:, 1:] x.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.accelerations import (
    NOT_FINITE,
    ball_speed,
    move,
    write_accelerations,
    write_efforts,
    write_laws,
)
from pinfric.dynamics.problem.machine import Machine
from pinfric.dynamics.problem.wrenches import write_wrenches
from pinfric.friction.dense import affine
from pinfric.friction.given_modes import try_modes
from pinfric.friction.law import entry_friction, stick_limits
from pinfric.kernels.compiled import kernel

#: Modes that `solve_instant` tries: none; those of the velocities; those in `modes`; the same, with
#: balls directed against their motion. What has no dry friction always is.
UNSOLVED, FREE, GIVEN, TURNED = range(4)
#: An outcome of `solve_instant`, beside 0 and those of `write_accelerations`: joints stick that may
#: share their friction, and the caller has to find it.
NOT_TRIED = 4
_EPS = float(np.finfo(float).eps)


@kernel
def _set_modes_from_velocities(machine: Machine) -> int:
    """Set the modes that velocities fix and stick everything at rest; return how many are.

    At zero speed a ball without dry friction keeps its direction; anything else has none.
    """
    t, m = machine.plan.coordinates, machine.modes
    rate, resting = machine.kinematics.coordinate_rate, 0
    for c in range(rate.size):
        speed = ball_speed(t, rate, c) if t.ball[c] else abs(rate[c])
        m.at_rest[c] = t.dry[c] and speed <= t.stick_velocity[c]
        m.stuck[c] = m.at_rest[c]
        if m.stuck[c]:
            m.direction[c] = 0.0
            resting += 1
        elif speed > 0.0:
            m.direction[c] = rate[c] / speed
        elif not t.ball[c]:
            m.direction[c] = 0.0
    return resting


@kernel
def _update_directions(machine: Machine, balls: bool) -> None:
    """Point the friction of coordinates without dry friction against their motion.

    `balls`: that of balls that slip, too; at no speed it stays.
    """
    rate, t, m = machine.kinematics.coordinate_rate, machine.plan.coordinates, machine.modes
    for c in range(rate.size):
        if t.ball[c]:
            if not m.stuck[c] and (balls or not t.dry[c]):
                speed = ball_speed(t, rate, c)
                if speed > 0.0:
                    m.direction[c] = rate[c] / speed
        elif not t.dry[c]:
            m.direction[c] = np.sign(rate[c])


@kernel
def accelerations_under_friction(machine: Machine, a: np.ndarray) -> None:
    """Write accelerations a (nv,) under the friction found.

    At a sticking coordinate friction cancels all other efforts; n terms of m equations leave a
    rounding of n m eps times their magnitudes, which is set to 0.
    """
    a_map, m = machine.maps.acceleration, machine.modes
    x = m.friction
    sticks = False
    for c in range(x.size):
        sticks |= m.stuck[c]
    rounding = (1 + x.size) * a.size * _EPS if sticks else 0.0
    for i in range(a.size):
        total = a_map[i, 0]
        terms = abs(total)
        for c in range(x.size):
            part = a_map[i, 1 + c] * x[c]
            total += part
            terms += abs(part)
        a[i] = 0.0 if abs(total) <= rounding * terms else total  # what is not a number stays


@kernel
def finish(machine: Machine) -> None:
    """Write accelerations, wrenches, multipliers and each site's friction from the solution."""
    sites, entries, coordinates = machine.plan.sites, machine.plan.entries, machine.plan.coordinates
    found, m, p, G = machine.results, machine.modes, machine.problem, machine.maps.wrench
    x, wrench, phi, stuck = m.friction, found.wrench, found.phi, m.stuck
    accelerations_under_friction(machine, found.a)
    for c in range(x.size):
        if stuck[c] and coordinates.velocity_index[c] >= 0:
            found.a[coordinates.velocity_index[c]] = 0.0
    affine(machine.maps.multiplier, x, found.multiplier)
    stick_limits(p, m.load, found.least, found.most)
    entry_friction(p, m, found.least, found.most, found.entry_phi)
    write_efforts(machine)
    for s in range(phi.size):
        e = sites.first_entry[s]
        c, row = entries.coordinate[e], machine.plan.contacts.site_row[s]
        found.load[s], phi[s] = m.load[e], found.entry_phi[e]
        found.site_modes[s] = np.sign(m.direction[c] * p.ratio[e])
        if coordinates.ball[c]:
            phi[s] = -np.sqrt(x[c] ** 2 + x[c + 1] ** 2 + x[c + 2] ** 2)
            found.site_modes[s] = 0 if stuck[c] else 1
        for i in range(6):
            wrench[s, i] = G[row, i, 0]
            for n in range(x.size):
                wrench[s, i] += G[row, i, 1 + n] * x[n]


@kernel
def solve_instant(
    machine: Machine, q: np.ndarray, v: np.ndarray, effort: np.ndarray, step: float, choice: int
) -> tuple[int, int, int, int]:
    """Write the coupled problem and all maps at one state, try modes, and finish.

    Args:
        machine: its buffers are overwritten.
        q, v: (nq,), (nv,).
        effort: (na,) of the drives; where motors drive, r T_m of each.
        step: 0: r is the relative acceleration; else the time step (s) of which r is the relative
            velocity at the end, with viscous friction implicit.
        choice: `UNSOLVED`, `FREE`, `GIVEN` or `TURNED`.

    Returns:
        (outcome, number of solutions or -1, how many obey, how many are at rest). The outcome is 0,
        `NOT_FINITE`, `SINGULAR`, `TOGGLE` (the loops allow more motions than elsewhere) or
        `NOT_TRIED`.
    """
    m, resting = machine.modes, 0
    move(machine, v)
    write_laws(machine, step)
    if choice == FREE:
        resting = _set_modes_from_velocities(machine)
    elif choice != UNSOLVED:
        m.at_rest[:] = False
        _update_directions(machine, choice == TURNED)
    outcome = write_accelerations(machine, q, v, effort, step)
    if outcome == 0 and not write_wrenches(machine, q):
        outcome = NOT_FINITE
    if outcome != 0 or choice == UNSOLVED:
        return outcome, 0, 0, 0
    if machine.plan.closure.dependent:
        for c in range(m.stuck.size):
            if m.stuck[c]:
                return NOT_TRIED, 0, 0, resting
    found, obeying = try_modes(machine.problem, m, False)
    if found <= 0:
        m.friction[:1] = np.nan  # no guess for the next solve
    elif obeying == 1:
        finish(machine)
    return 0, found, obeying, resting
