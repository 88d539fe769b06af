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
from pinfric.model.drives import Gears, gear_drag, gear_line, gear_range, gear_slips

#: An effort beyond its line by this fraction of the terms of its sum is rounding.
_ROUNDING = 1e-12
#: A friction of this many times all forces is impossible: used where a gear cannot slip.
_NEVER = 1e9
#: A load of this many times all forces is on the outermost line of a gear.
MUCH = 1e6
#: Passes in which all gears change their lines, and after which none was found.
FEW_PASSES, MOST_PASSES = 6, 100


@kernel
def write_lines(machine: Machine, v: np.ndarray, given: np.ndarray, step: float) -> None:
    """Write the line that each gear follows, and the efforts that it holds at rest.

    Around `lines.delivered`, in the direction `lines.way`; 0 is a gear without losses, which is
    also taken where a line that falls would have to hold what may be at rest.

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
        way, spent = w.way[d], drag + inertia * bend
        w.reflected[d], w.slope[d], w.offset[d] = inertia, 1.0, spent
        w.ends[d, 0], w.ends[d, 1] = -np.inf, np.inf
        if way != 0.0:
            sign, share = (1.0 if way > 0.0 else -1.0), abs(way)
            slope, offset, w.ends[d, 0], w.ends[d, 1] = gear_line(
                gears, d, sign, abs(rate), False, w.delivered[d]
            )
            if slope <= 0.0 and (modes.stuck[c] or modes.at_rest[c]):
                way = 0.0
                if not modes.stuck[c]:  # no solution: other lines are not tried in turn for ever
                    w.ends[d, 0], w.ends[d, 1] = -np.inf, np.inf
            else:
                w.slope[d] = 1.0 + share * (slope - 1.0)
                w.offset[d] += share * offset
        if c >= 0 and not (modes.stuck[c] or modes.at_rest[c]):
            p.coulomb_slip[e, 0] = p.coulomb_slip[e, 1] = 0.0
        elif c >= 0:
            at_rest = given[d] - spent
            if step > 0.0:
                at_rest += inertia * rate / step
            _write_limits(machine, d, e, way, at_rest, at_rest + spent)


@kernel
def _write_limits(
    machine: Machine, d: int, e: int, way: float, arriving: float, given: float
) -> None:
    """Write the law of a gear's entry: between which t it holds, where a line is used already.

    Args:
        machine, d, e: the gear and its entry.
        way: the direction of the line in use, 0 for the one without losses.
        arriving: what arrives while it rests.
        given: the same, with what `lines.offset` takes off.
    """
    gears, w, p = machine.plan.drives.gears, machine.lines, machine.problem
    never = _NEVER * (w.all_forces[0] + abs(arriving) + 1e-300)
    w.arriving[d] = arriving
    w.held[d, 0], w.held[d, 1] = held(gears, d, arriving, True, w.delivered[d])
    least, greatest = held(gears, d, arriving, False, w.delivered[d])
    on_line = (given - w.offset[d]) / w.slope[d] if w.slope[d] > 0.0 else 0.0
    if way == 0.0:  # what the gear holds without friction of its own, as near as it can
        on_line = min(max(on_line, w.held[d, 0]), w.held[d, 1])
        w.offset[d] = given - on_line
    p.coulomb_stick[e, 0] = on_line - w.held[d, 0]
    p.coulomb_stick[e, 1] = w.held[d, 1] - on_line
    forward = on_line - least if least > -np.inf else never
    backward = greatest - on_line if greatest < np.inf else never
    wedged = (least == -np.inf and arriving >= 0.0) or (greatest == np.inf and arriving <= 0.0)
    if wedged or (way == 0.0 and w.way[d] != 0.0):
        forward = backward = never  # from here it slips along a line that falls only
    p.coulomb_slip[e, 0] = 0.0 if way > 0.0 else forward
    p.coulomb_slip[e, 1] = 0.0 if way < 0.0 else backward


@kernel
def held(gears: Gears, d: int, arriving: float, static: bool, near: float) -> tuple[float, float]:
    """Return the interval of efforts that a gear at rest holds: around one, or nearest to it.

    If load and motor push the same way, a self-locking gear slips only between two efforts.

    Args:
        gears, d, static: see `drives.gear_slips`.
        arriving, near: N m or N at the joint.
    """
    least, greatest = -np.inf, np.inf
    for direction in (1.0, -1.0):
        low, high = gear_slips(gears, d, direction, static, arriving)
        if low >= high:
            continue
        if near - low < high - near:
            greatest = min(greatest, low)
        else:
            least = max(least, high)
    return least, greatest


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
def refit(machine: Machine, cautious: bool) -> int:
    """Compare the lines with the solution; where one does not fit, choose another.

    Args:
        machine: `lines.delivered` and `lines.way` are written.
        cautious: change the first that does not fit only, which ends for certain (Murty's rule).

    Returns:
        How many do not fit.
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
        way = w.way[d]
        if modes.stuck[c]:
            total += x[c]
            least, greatest = held(drives.gears, d, w.arriving[d], True, total)
            nearest = least == w.held[d, 0] and greatest == w.held[d, 1]
            chosen = abs(w.delivered[d]) >= MUCH * w.all_forces[0]  # the side is to be tried
            fits = nearest or (chosen and modes.verdict[c] == 0)
        else:
            way = modes.direction[c]
            beyond = max(w.ends[d, 0] - total, total - w.ends[d, 1])
            fits = way == w.way[d] and beyond <= _ROUNDING * terms
        if not fits:
            wrong += 1
        if fits or wrong == 1 or not cautious:
            w.way[d], w.delivered[d] = way, total
    return wrong


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
    drives, p, arriving = machine.plan.drives, machine.problem, machine.lines.arriving[d]
    gears, c, x = drives.gears, drives.gear_coordinate[d], machine.modes.friction
    delivered = machine.maps.delivered
    needed = delivered[d, 0] + x[c]
    for k in range(x.size):
        needed += delivered[d, 1 + k] * x[k]
    least = greatest = 0.0
    for e in range(p.coordinate.size):
        if p.coordinate[e] == c and e != drives.gear_entry[d]:
            ends = site_limits(p, machine.modes.load, e)
            least, greatest = least + ends[0], greatest + ends[1]
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
        if e >= 0 and machine.modes.stuck[c]:
            found.effort[d] += found.entry_phi[e]
