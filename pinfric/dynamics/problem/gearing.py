"""Drives in the friction problem: rotors as armature, and the laws of gears with losses.

The torque at the gear's input is u - I s'', with u = r T_m - drag, I = r^2 J_rotor and s' = S v the
drive's rate. A gear without losses delivers it: an armature I and an effort. The losses of others
are friction beside that, see `friction.gears`.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.machine import Machine
from pinfric.friction.dense import affine
from pinfric.kernels.compiled import kernel
from pinfric.model.drives import gear_drag, gear_line, held_efforts


@kernel
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
def add_armature(machine: Machine) -> None:
    """Add the rotors' inertia to M."""
    M, S = machine.maps.M, machine.kinematics.S
    for d in range(S.shape[0]):
        armature = machine.rotors.inertia[d]
        for j in range(M.shape[0]):
            if armature * S[d, j] != 0.0:
                for k in range(M.shape[0]):
                    M[j, k] += armature * S[d, j] * S[d, k]


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
    drives, modes, found = machine.plan.drives, machine.modes, machine.solution
    affine(machine.maps.delivered, modes.friction, found.effort)
    for d in range(drives.gear_entry.size):
        e, c = drives.gear_entry[d], drives.gear_coordinate[d]
        found.driving[d] = 0
        if e >= 0 and modes.stuck[c]:
            found.effort[d] += found.entry_phi[e]
        elif e >= 0:
            found.effort[d] = modes.effort[e - machine.plan.entries.site.size]
            found.driving[d] = np.sign(modes.direction[c] * found.effort[d])
