"""Sliding friction that no load changes, as efforts of the joints: then one ABA has the motion.

    M a + h = S u + D^T x,     x = -sum |ratio| direction (mu c + coulomb) - drag,     c constant

A gear with losses delivers t with u - I r = slope t + offset, a line of `friction.gears`: the
effort (u - offset) / slope and the armature I / slope. Gears whose lines rise have one answer, so
lines on which all t fit are the answer.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.accelerations import write_gears, write_laws
from pinfric.dynamics.problem.instant import FREE
from pinfric.dynamics.problem.machine import Machine
from pinfric.friction.gears import write_rows
from pinfric.friction.law import sliding
from pinfric.kernels.compiled import kernel

#: Gears on a line with a slope below this are left to the search; effort beyond a line: rounding.
_RISES, _ROUNDING = 0.02, 1e-12


@kernel
def slide_freely(machine: Machine, v: np.ndarray, given: np.ndarray, choice: int) -> bool:
    """Write the joints' efforts and armatures while everything slides; False: not all does.

    Args:
        machine: its modes, laws and friction are overwritten, and `free_motion` is written.
        v, given: (nv,), (na,), see `instant.solve_instant`.
        choice: `FREE`: modes by the velocities; else those in `modes`.
    """
    tau, armature = machine.free_motion.effort, machine.free_motion.armature
    t, e, m, found = machine.plan.coordinates, machine.plan.entries, machine.modes, machine.results
    p, drives, rate = machine.problem, machine.plan.drives, machine.kinematics.coordinate_rate
    for c in range(rate.size):
        rate[c] = v[t.velocity_index[c]]
        if choice == FREE:
            if t.dry[c] and abs(rate[c]) <= t.stick_velocity[c]:
                return False
            m.stuck[c] = False
        elif m.stuck[c]:
            return False
        if choice == FREE or not t.dry[c]:
            m.direction[c] = np.sign(rate[c])
        m.at_rest[c], m.friction[c] = False, 0.0
    write_laws(machine, 0.0)
    for i in range(v.size):
        tau[i], armature[i] = 0.0, machine.tree.armature[i]
    for s in range(e.site.size):
        c = e.coordinate[s]
        gain, offset = sliding(p, s, m.direction[c])
        m.load[s] = found.load[e.site[s]] = p.constant[s]
        x = gain * m.load[s] + offset
        found.phi[e.site[s]] = x / p.ratio[s]
        found.site_modes[e.site[s]] = np.sign(m.direction[c] * p.ratio[s])
        m.friction[c] += x
        tau[t.velocity_index[c]] += x
    arriving, motors = given, drives.gears.ratio.size > 0
    if motors:
        write_gears(machine, v, given, 0.0)
        arriving = machine.rotors.arriving
    lines = np.empty((m.effort.size, 4))
    if lines.shape[0] > 0:
        write_rows(p, m, lines, np.empty((rate.size, 3)))
    for d in range(given.size):
        slope, offset = 1.0, 0.0
        if motors and drives.gear_entry[d] >= 0:
            g = drives.gear_entry[d] - e.site.size
            slope, offset = lines[g, 0], lines[g, 1]
            if not slope > _RISES:
                return False
        tau[drives.velocity_index[d]] += (arriving[d] - offset) / slope
        if motors:
            armature[drives.velocity_index[d]] += machine.rotors.inertia[d] / slope
        found.effort[d] = given[d]
    m.figures[:] = 0.0
    return True


@kernel
def deliver(machine: Machine, a: np.ndarray) -> bool:
    """Write what drives with rotors deliver at accelerations a (nv,); False: off their lines."""
    drives, m, found, rotors = machine.plan.drives, machine.modes, machine.results, machine.rotors
    fits, lines = True, np.empty((m.effort.size, 4))
    write_rows(machine.problem, m, lines, np.empty((m.stuck.size, 3)))
    for d in range(drives.velocity_index.size):
        taken = rotors.inertia[d] * a[drives.velocity_index[d]]
        t, e, c = rotors.arriving[d] - taken, drives.gear_entry[d], drives.gear_coordinate[d]
        found.driving[d] = 0
        if e >= 0:
            g = e - machine.plan.entries.site.size
            terms = abs(rotors.arriving[d]) + abs(taken) + abs(lines[g, 1])
            loss, t = t, (t - lines[g, 1]) / lines[g, 0]
            beyond = max(lines[g, 2] - t, t - lines[g, 3])
            fits &= beyond * lines[g, 0] <= _ROUNDING * terms
            m.effort[g], m.load[e] = t, 0.0
            m.friction[c] += t - loss
            found.driving[d] = np.sign(m.direction[c] * t)
        found.effort[d] = t
    return fits
