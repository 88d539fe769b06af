"""What gears bear in stops, by algebra: for a choice of drives, in 0.1 s.

A stop is worst for a gear where a brake closes or another joint comes to rest. So of each sample of
the cycle every order of these events is taken at once: each set of brakes that have closed, and
each set S of joints that still move. `pinfric.stop` simulates what the algebra leaves out:
friction, and how far the arm moves meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, combinations

import numpy as np

from pinfric.drives.inertia import DriveCoordinates
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.closure import working_rates
from pinfric.dynamics.samples.reactions import rigid_efforts
from pinfric.model.mass_matrix import mass_matrices
from pinfric.model.massless import massless
from pinfric.model.transmission import shock_efficiency
from pinfric.model.twin import Twin
from pinfric.motions.trajectory import Trajectory
from pinfric.stops.machines import MachineKind, Machines, carried_by
from pinfric.stops.motion import BrakedMachine

#: Samples spread evenly over the cycle, beside those of each axis's largest speed.
_SPREAD = 80
#: Of so many joints that move every set is taken; of more those of one, two, all and all but one.
_EVERY_SET = 10
#: A torque this small beside the load is rounding.
_ROUNDING = 1e-9


def gear_peaks(
    machine: BrakedMachine,
    torque: Mapping[str, float],
    delay: Mapping[str, float],
    q: np.ndarray,
    v: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray:
    """Return the largest efforts (T, na) that the gears of all joints bear together, N m or N.

    Of each set of brakes that have closed and each set S of joints that still move, the others
    being at rest,

        (M_SS + diag(r^2 J/eta_b)) a_S = -(r T_b/eta_b) sign u - h_S,      t = M_{.S} a_S + h,

    in the drives' own coordinates u, v = B u (`DriveCoordinates`): M stands for B^T M B, and h for
    B^T (M gamma + h). T_b = 0 of open brakes. h is gravity and springs, and what the velocities of
    S add; eta_b the efficiency of the gear that the load drives (`shock_efficiency`). Friction of
    the joints is left out. The gear of a joint at rest passes r T_b/eta_b before its brake slips.
    Beyond, the others drag the joint along, and its gear turns the rotor, too: of a load t that
    would hold it still it passes

        r T_b/eta_b + (r^2 J/eta_b) (t - r T_b/eta_b)/(M_ii + r^2 J/eta_b - M_iS K^-1 M_Si),

    K the matrix in brackets above. A self-locking gear, eta_b <= 0, stands as soon as power is
    off, and passes what comes. What no drive moves is free in every set. NaN: drives do not
    determine the motion.

    Args:
        machine: a chain, or one with loops.
        torque: drive -> T_b of its brake, N m. delay: drive -> when it closes, s.
        q, v: (T, nq), (T, nv).
        direction: (T, na) -1 or 1 of a joint that moves when the drives react, 0 of one at rest.

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, 3.1 and 9.3 (hybrid dynamics: some
    accelerations are given, here 0, and of the other joints the forces).
    """
    scene, drives = machine.scene, machine.scene.drives
    gears, count = [d.transmission for d in drives], len(drives)
    back = np.array([1.0 if gear is None else shock_efficiency(gear) for gear in gears])
    ratio = np.abs([drive.ratio for drive in drives])
    names, closes = [drive.name for drive in drives], np.array(sorted({*delay.values()}) or [0.0])
    brake = np.array(
        [[torque[n] if n in torque and delay[n] <= t else 0.0 for n in names] for t in closes]
    ).reshape(len(closes), len(names))
    # 1. Coordinates of the drives, with brakes, then of what no drive moves
    twin = scene.twin(machine.carried)
    along = DriveCoordinates.of(scene, twin, q)
    rate = along.rates(working_rates(scene, q, v)[0], v)
    BT, free = along.directions.transpose(0, 2, 1), range(count, rate.shape[1])
    none, slips = np.zeros(len(free)), np.append(back > 0.0, np.ones(len(free), dtype=bool))
    divided = np.where(slips, np.append(back, none + 1.0), 1.0)
    heavy = np.append(ratio**2 * scene.gears().rotor_inertia, none) / divided
    pushes = np.pad(ratio * brake, ((0, 0), (0, len(free)))) / divided
    passes = np.where(slips, pushes, np.inf)  # (brakes closed, na + nf)
    direction = np.pad(np.where(slips[:count], direction, 0.0), ((0, 0), (0, len(free))))
    M, most = BT @ mass_matrices(twin, q) @ along.directions, np.zeros(rate.shape)
    # 2. Of the samples in which the same drives move, every set of these, and the free motions
    patterns, which = np.unique(direction != 0.0, axis=0, return_inverse=True)
    for k, pattern in enumerate(patterns):
        rows, moving = np.flatnonzero(which == k), np.flatnonzero(pattern).tolist()
        loads = _Loads(twin, along.part(rows), rate[rows], free)
        n = len(moving)
        sizes = range(n + 1) if n <= _EVERY_SET else (0, 1, 2, n - 1, n)
        for few in chain.from_iterable(combinations(moving, size) for size in sizes):
            S = [*few, *free]
            if not S:
                continue
            h = loads.of(few)
            inertia = M[rows][:, S][:, :, S] + np.diag(heavy[S])
            push = -passes[:, S] * direction[rows][:, None, S] - h[:, None, S]
            a = np.linalg.solve(inertia, push.transpose(0, 2, 1))
            effort = np.abs(M[rows][:, :, S] @ a + h[:, :, None]).transpose(0, 2, 1)
            others = np.delete(np.arange(rate.shape[1]), S)
            felt = M[rows][:, others][:, :, S]
            alone = np.einsum("tii->ti", M[rows])[:, others] + heavy[others]
            alone -= np.einsum("tis,tsi->ti", felt, np.linalg.solve(inertia, felt.mT))
            turns = np.divide(heavy[others], alone, out=np.zeros(alone.shape), where=alone > 0.0)
            holds = np.minimum(effort[..., others], passes[:, others])
            effort[..., others] = holds + turns[:, None] * (effort[..., others] - holds)
            most[rows] = np.maximum(most[rows], effort.max(axis=1))
    return most[:, :count]


class _Loads:
    """The loads h (n, na + nf) of `gear_peaks` of any set of drives that move.

    They are quadratic in the rates u: those of a set are sums of what drives add one by one, and
    two by two.

    Args:
        along: of n samples. rate: u (n, na + nf). free: columns that move in every set.
    """

    def __init__(
        self, twin: Twin, along: DriveCoordinates, rate: np.ndarray, free: Sequence[int]
    ) -> None:
        self._twin, self._along, self._rate, self._free = twin, along, rate, list(free)
        self._added: dict[tuple[int, ...], np.ndarray] = {}

    def of(self, few: Sequence[int]) -> np.ndarray:
        """Return the loads while a few drives move."""
        parts = chain.from_iterable(combinations(few, size) for size in (0, 1, 2))
        return np.sum([self._adds(part) for part in parts], axis=0)

    def _adds(self, part: tuple[int, ...]) -> np.ndarray:
        """What one or two drives add to what each of them adds, and to what is there at rest."""
        if part not in self._added:
            along = self._along
            v = along.velocities(self._rate, [*part, *self._free])
            load = rigid_efforts(self._twin, along.q, v, along.at_constant_rates(v))[1]
            whole = (along.directions.transpose(0, 2, 1) @ load[..., None])[..., 0]
            fewer = chain.from_iterable(combinations(part, size) for size in range(len(part)))
            self._added[part] = whole - sum(map(self._adds, fewer), np.zeros(whole.shape))
        return self._added[part]


def cycle_peaks(
    machines: Machines, trajectory: Trajectory, powers: Sequence[InverseResult]
) -> np.ndarray:
    """Return (na,) the largest efforts of the gears in all stops of a cycle, N m or N.

    Of the cycle itself, which goes on until the drives react, and of `gear_peaks`, with greatest
    friction and brakes, without payload and with the full load, at
    80 samples and those of each axis's largest speed. Category 0: brakes stop what moves. Category
    1: the drives' efforts do, or see `braking`; then what friction does not hold falls from rest
    until its brake closes. What moves no mass is left at rest.

    Args:
        machines: of a chain, or one with loops.
    """
    rate = working_rates(machines.scene, trajectory.q, trajectory.v)[0]
    fastest = np.argmax(np.abs(rate), axis=0)
    spread = np.linspace(0, len(rate) - 1, _SPREAD).astype(int)
    picked = np.unique(np.concatenate([spread, fastest]))
    q, v, rate = trajectory.q[picked], trajectory.v[picked], rate[picked]
    most, powered = [np.zeros(rate.shape[1])], machines.settings.category == 1
    powers = [inverse_dynamics(machines.of(MachineKind(True, 0.0)).scene, trajectory), *powers]
    for load in {0.0, 1.0} if machines.full else {0.0}:
        machine = machines.of(MachineKind(True, load))
        light = np.append(massless(machine.scene, machine.carried), False)  # [-1]: off the joints
        heavy = ~light[[drive.velocity_index for drive in machine.scene.drives]]
        stopped = []
        if not powered:
            stopped.append((machine.torque, machine.delay, v, np.sign(rate)))
        if powered and machine.drive_torque:
            at_once = dict.fromkeys(machine.drive_torque, 0.0)
            stopped.append((machine.drive_torque, at_once, v, np.sign(rate)))
        if powered and not machine.holds:
            down = _falls(machine, machines, q, load)
            stopped.append((machine.torque, machine.delay, 0.0 * v, down))
        for torque, delay, speed, way in stopped:
            peaks = gear_peaks(machine, torque, delay, q, speed, way * heavy)
            most.append(peaks.max(axis=0))
    most += [np.max(np.abs([x.effort_lower, x.effort_upper]), axis=(0, 1)) for x in powers]
    return np.max(most, axis=0)


def _falls(machine: BrakedMachine, machines: Machines, q: np.ndarray, load: float) -> np.ndarray:
    """(T, na) direction in which joints at rest begin to move when power goes off; 0: none."""
    zero, carried = np.zeros((len(q), machine.scene.model.nv)), carried_by(machines, load, len(q))
    still = inverse_dynamics(machine.scene, q, zero, zero, attached=carried)
    down, least = -np.sign(still.effort_frictionless), _ROUNDING * np.abs(still.effort_frictionless)
    moves = (still.motor_torque_lower > least) | (still.motor_torque_upper < -least)
    return np.where(moves, down, 0.0)


def braking(machines: Machines, trajectory: Trajectory) -> tuple[InverseResult, ...]:
    """Return what it takes to brake a cycle under power from each sample, without payload and with.

    Inverse dynamics of the whole cycle at a = -v/max_j(|v_j|/d_j) along the path, or -d_j sign v_j
    of each axis by itself, with the greatest friction.

    Args:
        machines: of a category 1 with `stops.deceleration`; of another there are none.
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
            machines.of(MachineKind(True, load)).scene,
            trajectory.q,
            v,
            a,
            t=trajectory.t,
            attached=carried_by(machines, load, len(v)),
        )
        for load in loads
    )
