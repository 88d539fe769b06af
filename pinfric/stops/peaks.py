"""What gears bear in stops, by algebra instead of simulation: for a choice of drives, in 0.1 s.

A stop is worst for a gear where a brake closes or another joint comes to rest, and between these
instants little changes. So of each sample of the cycle every order in which that may happen is
taken at once: each set of brakes that have closed, and each set S of joints that still move.
`pinfric.stop` simulates what the algebra leaves out: friction, and how far the arm moves meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.closure import working_rates
from pinfric.model.mass_matrix import mass_matrices
from pinfric.model.transmission import shock_efficiency
from pinfric.motions.trajectory import Trajectory
from pinfric.stops.machines import Kind, Machines, carried_by
from pinfric.stops.motion import Machine

#: Samples spread evenly over the cycle, beside those of each axis's largest speed.
_SPREAD = 80
#: A torque this small beside the load is rounding.
_ROUNDING = 1e-9


def gear_peaks(
    machine: Machine,
    torque: Mapping[str, float],
    delay: Mapping[str, float],
    q: np.ndarray,
    v: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray:
    """Return the largest efforts (T, na) that the gears of all joints bear together, N m or N.

    Of each set of brakes that have closed and each set S of joints that still move, the others
    being at rest,

        (M_SS + diag(r^2 J/eta_b)) a_S = -(r T_b/eta_b) sign v - h_S,      t = M_{.S} a_S + h,

    T_b = 0 of brakes that are still open. h is gravity, and what the velocities of S add; eta_b the
    efficiency of the gear that the load drives (`shock_efficiency`). Friction of the joints is left
    out. The gear of a joint at rest passes at most r T_b/eta_b: beyond, its brake slips. A
    self-locking gear, eta_b <= 0, stands as soon as power is off, and passes what comes.

    Args:
        machine: an open chain with one drive on each joint.
        torque: drive -> T_b of its brake, N m. delay: drive -> when it closes, s.
        q, v: (T, nq), (T, nv).
        direction: (T, na) -1 or 1 of a joint that moves when the drives react, 0 of one at rest.

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, 3.1 and 9.3 (hybrid dynamics: some
    accelerations are given, here 0, and of the other joints the forces).
    """
    scene, drives = machine.scene, machine.scene.drives
    gears = [drive.transmission for drive in drives]
    own = np.array([drive.velocity_index for drive in drives])
    back = np.array([1.0 if gear is None else shock_efficiency(gear) for gear in gears])
    ratio = np.abs([drive.ratio for drive in drives])
    rotor = np.array([0.0 if gear is None else gear.rotor_inertia for gear in gears])
    names, closes = [drive.name for drive in drives], np.array(sorted({*delay.values()}) or [0.0])
    brake = np.array(
        [[torque[n] if n in torque and delay[n] <= t else 0.0 for n in names] for t in closes]
    ).reshape(len(closes), len(names))
    slips = back > 0.0
    divided, direction = np.where(slips, back, 1.0), np.where(slips, direction, 0.0)
    heavy = ratio**2 * rotor / divided
    passes = np.where(slips, ratio * brake / divided, np.inf)  # (brakes closed, na)
    model = scene.loaded_model(machine.carried)
    data, still = model.createData(), np.zeros(model.nv)
    M = mass_matrices(scene.twin(machine.carried), q)[:, own][:, :, own]
    most = np.zeros((len(q), len(own)))
    for size in range(1, len(own) + 1):
        for S in map(list, combinations(range(len(own)), size)):
            rows = np.flatnonzero(direction[:, S].all(axis=1))
            if not rows.size:
                continue
            speed, moves = np.zeros((len(rows), model.nv)), own[S]
            speed[:, moves] = v[rows][:, moves]
            h = np.array(
                [pin.rnea(model, data, *pair, still) for pair in zip(q[rows], speed, strict=True)]
            )[:, own]
            inertia = M[rows][:, S][:, :, S] + np.diag(heavy[S])
            push = -passes[:, S] * direction[rows][:, None, S] - h[:, None, S]
            a = np.linalg.solve(inertia, push.transpose(0, 2, 1))
            effort = np.abs(M[rows][:, :, S] @ a + h[:, :, None]).transpose(0, 2, 1)
            rest = np.delete(np.arange(len(own)), S)
            effort[..., rest] = np.minimum(effort[..., rest], passes[:, rest])
            most[rows] = np.maximum(most[rows], effort.max(axis=1))
    return most


def cycle_peaks(machines: Machines, trajectory: Trajectory) -> np.ndarray:
    """Return (na,) the largest efforts of the gears in all stops of a cycle, N m or N.

    Of `gear_peaks`, with greatest friction and brakes, without payload and with the full load, at
    80 samples and those of each axis's largest speed. Category 0: what moves is stopped by the
    brakes. Category 1: by the drives' efforts, or see `braking`; then what friction does not hold
    falls from rest until its brake closes.

    Args:
        machines: of a scene for which `Scene.one_drive_each` holds. trajectory: the cycle.
    """
    rate = working_rates(machines.scene, trajectory.q, trajectory.v)[0]
    fastest = np.argmax(np.abs(rate), axis=0)
    spread = np.linspace(0, len(rate) - 1, _SPREAD).astype(int)
    picked = np.unique(np.concatenate([spread, fastest]))
    q, v, rate = trajectory.q[picked], trajectory.v[picked], rate[picked]
    most, powered = [np.zeros(rate.shape[1])], machines.settings.category == 1
    for load in {0.0, 1.0} if machines.full else {0.0}:
        machine = machines.of(Kind(True, load))
        if not powered:
            found = gear_peaks(machine, machine.torque, machine.delay, q, v, np.sign(rate))
            most.append(found.max(axis=0))
            continue
        if machine.drive_torque:
            at_once = dict.fromkeys(machine.drive_torque, 0.0)
            found = gear_peaks(machine, machine.drive_torque, at_once, q, v, np.sign(rate))
            most.append(found.max(axis=0))
        if not machine.holds:
            down = _falls(machine, machines, q, load)
            found = gear_peaks(machine, machine.torque, machine.delay, q, 0.0 * v, down)
            most.append(found.max(axis=0))
    powers = braking(machines, trajectory)
    most += [np.max(np.abs([x.effort_lower, x.effort_upper]), axis=(0, 1)) for x in powers]
    return np.max(most, axis=0)


def _falls(machine: Machine, machines: Machines, q: np.ndarray, load: float) -> np.ndarray:
    """(T, na) in which direction joints at rest begin to move when power goes off; 0: none."""
    zero, carried = np.zeros((len(q), machine.scene.model.nv)), carried_by(machines, load, len(q))
    still = inverse_dynamics(machine.scene, q, zero, zero, attached=carried)
    down, least = -np.sign(still.effort_frictionless), _ROUNDING * np.abs(still.effort_frictionless)
    moves = (still.motor_torque_lower > least) | (still.motor_torque_upper < -least)
    return np.asarray(np.where(moves, down, 0.0))


def braking(machines: Machines, trajectory: Trajectory) -> tuple[InverseResult, ...]:
    """Return what it takes to brake a cycle under power from each sample, without payload and with.

    Inverse dynamics of the whole cycle at a = -v/max_j(|v_j|/d_j) along the path, or -d_j sign v_j
    of each axis by itself, with the greatest friction.

    Args:
        machines: of a category 1 with `stops.deceleration`; of another there are none.
        trajectory: the cycle.
    """
    d, v = machines.deceleration, trajectory.v
    if d is None:
        return ()
    a = -d * np.sign(v)
    if machines.settings.along_path:
        a = -v / np.maximum((np.abs(v) / d).max(axis=1, keepdims=True), np.finfo(float).tiny)
    loads = (0.0, 1.0) if machines.full else (0.0,)
    return tuple(
        inverse_dynamics(
            machines.of(Kind(True, load)).scene,
            trajectory.q,
            v,
            a,
            t=trajectory.t,
            attached=carried_by(machines, load, len(v)),
        )
        for load in loads
    )
