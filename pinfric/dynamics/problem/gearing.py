"""Gears in the friction problem: the effort at the joint for a given motor torque.

The torque at the gear's input, u = r T_m - drag - I s'', with I = r^2 J_rotor and s' = S v the
drive's rate, follows one of the gear's lines (`drives.gear_line`), u = slope t + offset. So t is
affine in a:

    t = (r T_m - drag - offset - I (S a + dS/dt v)) / slope

For slope > 0 this is an armature I/slope and an effort; otherwise (self-locking, the load drives)
it is a separate row. At rest a gear can transmit every t with lower(t) <= u <= upper(t), which
gives static limits on the coordinate that it drives. The solution shows whether a line was right;
if not, the line is changed and the solve repeated (Newton's method).
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.machine import Machine
from pinfric.friction.dense import affine
from pinfric.friction.law import site_limits
from pinfric.kernels.compiled import kernel
from pinfric.model.drives import Gears, gear_drag, gear_line, gear_range, held_efforts, slope_range

#: An effort beyond its line by this fraction of the terms of its sum is rounding.
_ROUNDING = 1e-12
#: Passes of Newton's method; with every second one a chord; after which none was found.
FEW_PASSES, MOST_PASSES = 6, 200


@kernel
def write_lines(machine: Machine, v: np.ndarray, given: np.ndarray, step: float) -> None:
    """Write the line that each gear follows, and the efforts that it holds at rest.

    Around `lines.delivered`, in the direction `lines.way`; 0 is a gear without losses. With
    `lines.chord` it is the line of the mean slope through the gear's law there: such lines lead to
    the solution whatever they start from, if there is one for all motor torques.

    Args:
        machine: its `lines`, but for `way` and `delivered`, and laws of the gears' entries are
            written.
        v: (nv,).
        given: (na,) u = r T_m (N m or N at the joint).
        step: 0, or a time step (s), at whose end viscous friction acts.
    """
    drives, w, k = machine.plan.drives, machine.lines, machine.kinematics
    gears, modes, p = drives.gears, machine.modes, machine.problem
    for d in range(gears.ratio.size):
        c, e, rate, bend = drives.gear_coordinate[d], drives.gear_entry[d], 0.0, 0.0
        for i in range(v.size):
            rate += k.S[d, i] * v[i]
        if drives.action[d] >= 0:
            bend = k.rate_derivative[0, drives.action[d]]
        drag = gear_drag(gears, d, rate)
        inertia = gears.ratio[d] * gears.ratio[d] * gears.rotor_inertia[d]
        if step > 0.0 and rate != 0.0:
            inertia += step * max(0.5 * gears.power[d], 1.0) * drag / rate  # as `_add_drag` does
        w.reflected[d], w.slope[d], w.spent[d] = inertia, 1.0, drag + inertia * bend
        w.ends[d, 0], w.ends[d, 1], w.offset[d] = -np.inf, np.inf, w.spent[d]
        if w.way[d] != 0.0:
            _follow_line(machine, d, abs(rate))
        if c < 0:
            continue
        for side in (0, 1):  # in motion the line contains all losses
            p.coulomb_slip[e, side] = p.coulomb_stick[e, side] = 0.0
        if modes.stuck[c]:
            at_rest = given[d] - w.spent[d]
            if step > 0.0:
                at_rest += inertia * rate / step
            _write_limits(machine, d, e, at_rest)


@kernel
def _follow_line(machine: Machine, d: int, speed: float) -> None:
    """Write the line of a gear that moves at a speed; with a share of its losses if regularized."""
    gears, w, t = machine.plan.drives.gears, machine.lines, machine.lines.delivered[d]
    sign, share = (1.0 if w.way[d] > 0.0 else -1.0), abs(w.way[d])
    slope, offset, w.ends[d, 0], w.ends[d, 1] = gear_line(gears, d, sign, speed, False, t)
    if w.chord[0]:
        least, greatest = slope_range(gears, d, speed)
        mean = 0.5 * (least + greatest)
        if mean > 0.0 and greatest > least:
            slope, offset = mean, offset + (slope - mean) * t
            w.ends[d, 0], w.ends[d, 1] = np.inf, -np.inf  # to be left for a line of the gear's own
    w.slope[d] = 1.0 + share * (slope - 1.0)
    w.offset[d] += share * offset


@kernel
def _write_limits(machine: Machine, d: int, e: int, arriving: float) -> None:
    """Write between which efforts a gear's entry holds, beside the gear without losses.

    Args:
        machine, d, e: the gear and its entry.
        arriving: what arrives while it rests.
    """
    gears, w, p = machine.plan.drives.gears, machine.lines, machine.problem
    t = w.delivered[d]
    w.arriving[d] = arriving
    w.held[d, 0], w.held[d, 1] = held(gears, d, arriving, t, t)
    # what the gear holds without friction of its own, as near as it can
    alone = min(max(arriving, w.held[d, 0]), w.held[d, 1])
    w.offset[d] = arriving + w.spent[d] - alone
    p.coulomb_stick[e, 0], p.coulomb_stick[e, 1] = alone - w.held[d, 0], w.held[d, 1] - alone


@kernel
def held(gears: Gears, d: int, arriving: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of efforts that a gear at rest holds: the one for efforts low to high.

    Of several the one that most of these efforts are in, else the nearest.

    Args:
        gears, d: see `drives.held_efforts`.
        arriving, low, high: N m or N at the joint.
    """
    lines = gears.last[d, 0] - gears.first[d, 0] + gears.last[d, 1] - gears.first[d, 1]
    found, best, chosen = np.empty((2 * lines + 1, 2)), -np.inf, 0
    for k in range(held_efforts(gears, d, arriving, found)):
        inside = min(high, found[k, 1]) - max(low, found[k, 0])
        if inside > best:
            best, chosen = inside, k
    return found[chosen, 0], found[chosen, 1]


@kernel
def add_armature(machine: Machine) -> int:
    """Add rotor inertias to M along rising lines; return how many gears follow other lines."""
    w, M, S, locking = machine.lines, machine.maps.M, machine.kinematics.S, 0
    for d in range(machine.plan.drives.gears.ratio.size):
        if w.slope[d] <= 0.0:
            locking += 1
            continue
        armature = w.reflected[d] / w.slope[d]
        for j in range(M.shape[0]):
            if armature * S[d, j] != 0.0:
                for k in range(M.shape[0]):
                    M[j, k] += armature * S[d, j] * S[d, k]
    return locking


@kernel
def write_delivered(machine: Machine, given: np.ndarray) -> None:
    """Write the efforts that drives deliver as maps of friction, along lines that rise."""
    w, S = machine.lines, machine.kinematics.S
    a_map, out = machine.maps.acceleration, machine.maps.delivered
    for d in range(given.size):
        if w.slope[d] <= 0.0:
            continue
        for n in range(out.shape[1]):
            out[d, n] = 0.0
        out[d, 0] = (given[d] - w.offset[d]) / w.slope[d]
        armature = w.reflected[d] / w.slope[d]
        if armature > 0.0:
            for i in range(S.shape[1]):
                if S[d, i] != 0.0:
                    for n in range(out.shape[1]):
                        out[d, n] -= armature * S[d, i] * a_map[i, n]


@kernel
def guess_delivered(machine: Machine, given: np.ndarray, a: np.ndarray) -> int:
    """Write what gears that move deliver at a (nv, 1); return how many leave their lines."""
    w, S, wrong = machine.lines, machine.kinematics.S, 0
    for d in range(machine.plan.drives.gear_coordinate.size):
        c = machine.plan.drives.gear_coordinate[d]
        if c < 0 or machine.modes.stuck[c]:
            continue
        arriving = given[d] - w.offset[d]
        for i in range(a.size):
            arriving -= w.reflected[d] * S[d, i] * a[i, 0]
        w.delivered[d] = arriving / w.slope[d]
        wrong += not w.ends[d, 0] <= w.delivered[d] <= w.ends[d, 1]
    return wrong


@kernel
def face_gears(machine: Machine) -> None:
    """Let each gear follow the lines of its coordinate's mode."""
    coordinate, modes = machine.plan.drives.gear_coordinate, machine.modes
    for d in range(coordinate.size):
        c = coordinate[d]
        if c >= 0:
            machine.lines.way[d] = 0.0 if modes.stuck[c] else modes.direction[c]


@kernel
def refit(machine: Machine, chosen: bool) -> int:
    """Compare the lines with the solution; where one does not fit, choose another.

    What a gear at rest holds is chosen such that the bearings beside it have the most room; one
    that slips does so the way its law is broken, which with a self-locking gear may be against
    the load.

    Args:
        machine: `lines.delivered` and `modes.verdict` are written.
        chosen: whether the gears' lines are to be tried, and not left: only what gears at rest
            hold changes.

    Returns:
        How many do not fit; -1 if a gear in motion leaves a line that is to be tried.
    """
    w, drives, modes, wrong = machine.lines, machine.plan.drives, machine.modes, 0
    x, delivered = modes.friction, machine.maps.delivered
    for d in range(drives.gear_coordinate.size):
        c = drives.gear_coordinate[d]
        if c < 0:
            continue
        total = terms = delivered[d, 0]
        terms = abs(terms) + abs(w.offset[d])
        for k in range(x.size):
            total += delivered[d, 1 + k] * x[k]
            terms += abs(delivered[d, 1 + k] * x[k])
        if not modes.stuck[c]:
            beyond = max(w.ends[d, 0] - total, total - w.ends[d, 1])
            if not beyond <= _ROUNDING * terms:
                if chosen:
                    return -1
                wrong += 1
            w.delivered[d] = total
            continue
        below, above = _beside(machine, d)
        total += x[c]
        least, greatest = held(drives.gears, d, w.arriving[d], total - above, total - below)
        if least != w.held[d, 0] or greatest != w.held[d, 1]:
            wrong += 1
            w.delivered[d] = min(max(total, least), greatest)
        elif modes.verdict[c] != 0 and not machine.plan.closure.dependent:
            backward, forward = gear_margins(machine, d)
            if min(backward, forward) < 0.0:
                modes.verdict[c] = -1 if backward < forward else 1
    return wrong


@kernel
def _beside(machine: Machine, d: int) -> tuple[float, float]:
    """Return the least and the greatest friction of all that rests beside a gear."""
    p, drives, least, greatest = machine.problem, machine.plan.drives, 0.0, 0.0
    for e in range(p.coordinate.size):
        if p.coordinate[e] == drives.gear_coordinate[d] and e != drives.gear_entry[d]:
            ends = site_limits(p, machine.modes.load, e)
            least, greatest = least + ends[0], greatest + ends[1]
    return least, greatest


@kernel
def gear_margins(machine: Machine, d: int) -> tuple[float, float]:
    """Return the distances of the torque at a gear at rest above lower(t) and below upper(t).

    Each is the largest over all efforts t that the friction beside the gear allows; below 0 the
    gear slips backward or forward. Both are finite and continuous, also where a self-locking gear
    begins to hold any effort.

    Args:
        machine: solved, what the gear drives sticks.
        d: the gear.
    """
    drives, arriving = machine.plan.drives, machine.lines.arriving[d]
    gears, c, x = drives.gears, drives.gear_coordinate[d], machine.modes.friction
    delivered = machine.maps.delivered
    needed = delivered[d, 0] + x[c]
    for k in range(x.size):
        needed += delivered[d, 1 + k] * x[k]
    least, greatest = _beside(machine, d)
    if not greatest - least < np.inf:  # another gear holds it, whatever the load
        return np.inf, np.inf
    low, high = needed - greatest, needed - least
    lower, _ = gear_range(gears, d, -1.0, 0.0, True, low, high)
    _, upper = gear_range(gears, d, 1.0, 0.0, True, low, high)
    return arriving - lower, upper - arriving


@kernel
def write_efforts(machine: Machine) -> None:
    """Write what each drive delivers in the solution; a gear at rest has its share of friction."""
    drives, found = machine.plan.drives, machine.solution
    affine(machine.maps.delivered, machine.modes.friction, found.effort)
    for d in range(drives.gear_entry.size):
        e, c = drives.gear_entry[d], drives.gear_coordinate[d]
        found.driving[d] = 0
        if e >= 0 and machine.modes.stuck[c]:
            found.effort[d] += found.entry_phi[e]
        elif e >= 0:
            found.driving[d] = np.sign(machine.lines.way[d] * found.effort[d])
