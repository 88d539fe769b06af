"""Inverse dynamics with friction: the efforts that a motion takes, as intervals where joints stick.

    M a + h - J_ext^T f_ext = u + D phi,     phi_k opposes v_k and depends on the wrench w_k

(design 2.3; paper eq. 16, 17). In an open chain whose drives sit on their joints the reactions do
not depend on how drive and friction share the axis component, so u = tau_id - D phi needs no
iteration; at rest phi is any value between its static limits, and u an interval (eq. 21, 22).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, overload

import numpy as np
import pinocchio as pin

from pinfric.dynamics.motion_kernels import effort_bounds, mark_reversals
from pinfric.dynamics.reactions import (
    AppliedWrench,
    Batch,
    applied_wrenches,
    batch_size,
    generalized_effort,
    reactions,
    relieve,
    slices,
    threads_for,
)
from pinfric.dynamics.result import InverseResult
from pinfric.dynamics.states import MotionLike, States, attached_columns
from pinfric.dynamics.threaded import (
    efforts_in_parts,
    friction_in_parts,
    reversals_in_parts,
    team,
)
from pinfric.errors import RollMomentError, StateError
from pinfric.model.arrays import whole_number
from pinfric.model.bearings import normal_loads
from pinfric.model.drives import motor_torque_bounds
from pinfric.model.laws import friction_bounds
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin


@overload
def inverse_dynamics(
    scene: Scene, q: np.ndarray | MotionLike, v: np.ndarray | None = ...,
    a: np.ndarray | None = ..., external: Mapping[str, np.ndarray] | None = ..., *,
    t: np.ndarray | None = ..., attached: np.ndarray | None = ..., threads: int | None = ...,
    chunks: None = ...,
) -> InverseResult: ...  # fmt: skip
@overload
def inverse_dynamics(
    scene: Scene, q: np.ndarray | MotionLike, v: np.ndarray | None = ...,
    a: np.ndarray | None = ..., external: Mapping[str, np.ndarray] | None = ..., *,
    t: np.ndarray | None = ..., attached: np.ndarray | None = ..., threads: int | None = ...,
    chunks: int,
) -> Iterator[InverseResult]: ...  # fmt: skip
def inverse_dynamics(
    scene: Scene,
    q: np.ndarray | MotionLike,
    v: np.ndarray | None = None,
    a: np.ndarray | None = None,
    external: Mapping[str, np.ndarray] | None = None,
    *,
    t: np.ndarray | None = None,
    attached: np.ndarray | None = None,
    threads: int | None = None,
    chunks: int | None = None,
) -> InverseResult | Iterator[InverseResult]:
    """Return the drives' efforts along a motion, with friction: intervals where joints stick.

    u = M a + h - J_ext^T f_ext - D phi (paper eq. 16, 17; at rest eq. 21, 22). With times, a joint
    that reverses between two samples passes through rest: the sample nearest to the reversal
    carries the interval of standstill too. Without times the samples are states of their own, in
    no order: what stands beside a sample says nothing of it.

    Args:
        scene: the robot with its friction and drives.
        q, v, a: (T, nq), (T, nv), (T, nv) in rad, m and per second; or, in place of q alone, a
            motion that has t, q, v, a (and `attached`).
        external: frame name -> (T, 6) or (6,) wrench on it, in its axes at its origin (N, N m).
        t: (T,) times in s, which make the samples one motion: for reversals, stick intervals and
            time-weighted figures. None: states without order.
        attached: (T, np) which payloads are carried; columns as `scene.payloads`.
        threads: of Pinocchio; None chooses by the number of samples.
        chunks: return an iterator of results of this many samples each, for motions whose result
            would not fit in memory; a time at rest that goes on into the next result is a stick
            interval of both.

    Raises:
        StateError: not real numbers, a wrong shape, a value not finite, times not increasing.
        RollMomentError: a guide without width is loaded by a moment about its axis.
        LoopMotionError: a loop is open, or the motion violates it.
    """
    if not isinstance(q, np.ndarray) and hasattr(q, "q"):
        if not (v is None and a is None and t is None):
            raise StateError("inverse_dynamics: a motion brings its own v, a and t; leave them out")
        motion = q
        q, v, a, t = motion.q, motion.v, motion.a, motion.t
        attached = attached_columns(scene, motion) if attached is None else attached
    if v is None or a is None:
        raise StateError("inverse_dynamics needs q, v and a, or one motion that has all of them")
    states = States.of(scene, q, v, a, t, attached)
    applied = applied_wrenches(scene, external, len(states.q))
    if chunks is None:
        return _solve(scene, states, applied, slice(0, len(states.q)), threads)
    parts = slices(0, len(states.q), whole_number("chunks", chunks))
    return (_solve(scene, states, applied, part, threads) for part in parts)


def _solve(
    scene: Scene, states: States, applied: list[AppliedWrench], whole: slice, threads: int | None
) -> InverseResult:
    """Solve the samples of one slice; the samples beside it only tell reversals."""
    if scene.linkage is not None:
        from pinfric.dynamics.coupled_inverse import solve_coupled  # it needs this file

        return solve_coupled(scene, states, applied, whole, threads)
    T, ns, nv = whole.stop - whole.start, len(scene.sites), scene.model.nv
    sites, threads = scene.site_tables, threads_for(T, threads)
    velocity, reversal = _velocities(
        sites.velocity_index, sites.ratio, sites.laws.stick_velocity, states, whole, threads
    )
    reacting = _needs_wrenches(scene, applied)
    shapes = [(T, nv)] * 3 + [(T, ns)] * 3 + [(T, ns, 6 if reacting else 0)]
    lower, upper, frictionless, load, friction_lower, friction_upper, wrench = _arrays(shapes)
    sticking = np.empty((T, ns), dtype=bool)
    batch = Batch.of(scene.twin(), min(T, batch_size(threads)))
    for part, twin in constant_payloads(scene, states, whole, batch_size(threads)):
        here = slice(part.start - whole.start, part.stop - whole.start)
        qva = states.q[part], states.v[part], states.a[part]
        rubbing = (velocity[here], load[here], sites.laws, reversal[here], friction_lower[here],
                   friction_upper[here], sticking[here])  # fmt: skip
        if not reacting:
            load[here] = 0.0
            _plain(twin, *qva, threads, frictionless[here])
            friction_bounds(*rubbing)
        else:
            now = batch.first(part.stop - part.start)
            if ns == twin.n_joints:  # every joint is a site: no second copy of its wrench
                now = Batch(now.q, now.v, now.a, wrench[here])
            reactions(twin, *qva, now, threads)
            relieve(twin, applied, part, now)
            if ns != twin.n_joints:
                wrench[here] = now.wrench[:, sites.joint]
            moves = sites.contacts.moves.any()
            displacement = displacements(twin, sites.joint, qva[0]) if moves else np.empty((0, 0))
            bearing = sites.joint, sites.contacts, displacement
            _rub(twin, now.wrench, qva[2], frictionless[here], bearing, rubbing, threads)
    if reacting:
        check_roll_moments(scene, wrench, whole.start)
    ends = (frictionless, friction_lower, friction_upper, sites.velocity_index, sites.ratio, lower,
            upper)  # fmt: skip
    if threads == 1:
        effort_bounds(*ends)
    else:
        with team(threads) as parts:
            efforts_in_parts(parts, *ends)
    _check_finite(scene, lower + upper, whole.start)
    motor_lower, motor_upper = _motor_torques(scene, states, whole, lower, upper)
    if motor_lower is not lower:  # behind a gear
        _check_finite(scene, motor_lower + motor_upper, whole.start)
    return InverseResult(
        scene=scene,
        states=states.part(whole),
        external=tuple(AppliedWrench(w.joint, w.wrench[whole]) for w in applied),
        effort_lower=lower,
        effort_upper=upper,
        effort_frictionless=frictionless,
        motor_torque_lower=motor_lower,
        motor_torque_upper=motor_upper,
        sticking=sticking,
        reversal=reversal,
        normal_load=load,
        friction_lower=friction_lower,
        friction_upper=friction_upper,
        wrench=wrench if reacting else None,
        iterations=np.zeros(T, dtype=np.int32),
        contraction=np.zeros(T),
        status=np.zeros(T, dtype=np.int8),
    )


def _rub(
    twin: Twin, wrench: np.ndarray, a: np.ndarray, effort: np.ndarray, bearing: tuple[Any, ...],
    rubbing: tuple[Any, ...], threads: int,
) -> None:  # fmt: skip
    """Write a batch's efforts without friction, loads and friction from its wrenches.

    Args:
        twin, wrench, a, effort: see `reactions.generalized_effort`.
        bearing: joint, contacts and displacement of `normal_loads`.
        rubbing: arguments of `friction_bounds`.
        threads: each takes a part of the samples.
    """
    if threads == 1:
        generalized_effort(twin, wrench, a, effort)
        normal_loads(wrench, *bearing, rubbing[1])
        friction_bounds(*rubbing)
        return
    velocity, load, laws, *sides = rubbing
    projection = twin.v_index, twin.ratio, twin.axis, twin.components
    with team(threads) as parts:
        friction_in_parts(parts, wrench, projection, effort, *bearing, load, velocity, laws,
                          tuple(sides))  # fmt: skip
    if twin.armature.any():
        effort += twin.armature * a


def constant_payloads(
    scene: Scene, states: States, whole: slice, size: int
) -> Iterator[tuple[slice, Twin]]:
    """Cut `whole` into batches of constant payload, with the twin that carries it."""
    for start, stop, carried in states.phases(scene):
        for part in slices(max(start, whole.start), min(stop, whole.stop), size):
            yield part, scene.twin(carried)


def _motor_torques(
    scene: Scene, states: States, whole: slice, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(T, na) least and greatest motor torque; the efforts themselves where no gear is."""
    if not any(drive.transmission for drive in scene.drives):
        return lower, upper
    motor_lower, motor_upper = lower.copy(), upper.copy()
    index = np.array([drive.velocity_index for drive in scene.drives])
    stick = np.array([_drive_stick_velocity(scene, i) for i in index])
    velocity, turns = _velocities(index, np.ones(len(index)), stick, states, whole)
    for column, drive in enumerate(scene.drives):
        if drive.transmission is not None:
            motor_lower[:, column], motor_upper[:, column] = motor_torque_bounds(
                drive.transmission, lower[:, column], upper[:, column], velocity[:, column],
                states.a[whole, drive.velocity_index], turns[:, column], stick[column],
            )  # fmt: skip
    return motor_lower, motor_upper


def _arrays(shapes: list[tuple[int, ...]]) -> list[np.ndarray]:
    """Carve arrays out of one block: a large block gets huge pages and so few page faults, which
    cost more than the friction kernels when every array is allocated by itself."""
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    pieces = np.split(np.empty(ends[-1]), ends[:-1])
    return [piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)]


def _velocities(
    index: np.ndarray, ratio: np.ndarray, stick_velocity: np.ndarray, states: States, part: slice,
    threads: int = 1,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """(n, ns) velocities ratio * v[:, index] of the samples of `part`, and where they reverse."""
    around = states.around(part)
    wider = states.v[around]
    if not np.array_equal(index, np.arange(wider.shape[1])) or (ratio != 1).any():
        wider = wider[:, index] * ratio
    inner = slice(part.start - around.start, part.stop - around.start)
    if states.t is None:
        return wider[inner], np.zeros(wider.shape, dtype=bool)
    return wider[inner], reversals(wider, stick_velocity, threads)[inner]


def reversals(velocity: np.ndarray, stick_velocity: np.ndarray, threads: int = 1) -> np.ndarray:
    """Return at which samples a velocity changes sign beside them.

    Of the two samples around a sign change the slower one is marked (the earlier if equal); where
    one of them sticks already, its interval covers the passage and nothing is marked.

    Args:
        velocity: (T, ns), rad/s or m/s.
        stick_velocity: (ns,), rad/s or m/s.
        threads: each takes a part of the samples.

    Returns:
        (T, ns) bool.
    """
    marked = np.zeros(velocity.shape, dtype=bool)
    if threads == 1:
        mark_reversals(velocity, stick_velocity, marked)
    else:
        with team(threads) as parts:
            reversals_in_parts(parts, velocity, stick_velocity, marked)
    return marked


def _needs_wrenches(scene: Scene, applied: list[AppliedWrench]) -> bool:
    """Say whether anything in the scene looks at reactions; if not, they are not computed."""
    return bool(applied) or any(site.friction.bearing is not None for site in scene.sites)


def _plain(
    twin: Twin, q: np.ndarray, v: np.ndarray, a: np.ndarray, threads: int, effort: np.ndarray
) -> None:
    """Write the ordinary RNEA (n, nv), for scenes whose friction looks at no reaction."""
    pin.rneaInParallel(threads, twin.plain_pool(threads), q.T, v.T, a.T, effort.T)


def displacements(twin: Twin, joint: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return positions (n, len(joint)) along the joints' axes (rad or m)."""
    return twin.ratio[joint] * q[:, twin.q_index[joint]] + twin.shift[joint]


def _drive_stick_velocity(scene: Scene, velocity_index: int) -> float:
    """The stick velocity of the site on a drive's joint, else the scene's default."""
    for site in scene.sites:
        if site.velocity_index == velocity_index and site.ratio == 1.0:
            return site.law.stick_velocity
    return scene.stick_velocity


def _check_finite(scene: Scene, efforts: np.ndarray, first: int) -> None:
    """Refuse a result that overflowed: a number that is none must not reach a table."""
    if not np.isfinite(efforts).all():
        sample, drive = np.argwhere(~np.isfinite(efforts))[0]
        raise StateError(
            f"the effort of {scene.actuator_names[drive]} at sample {first + sample} is beyond "
            "what numbers can hold: a state, a load or a coefficient of friction is too large"
        )


def check_roll_moments(scene: Scene, wrench: np.ndarray, first: int) -> None:
    """Refuse a moment about the axis that a bearing cannot carry (beyond rounding)."""
    for s, site in enumerate(scene.sites):
        bearing = site.friction.bearing
        lever = None if bearing is None else bearing.roll_lever()
        if lever is None:
            continue
        force, moment = wrench[:, s, :3], wrench[:, s, 3:]
        roll = moment @ site.axis
        scale = np.linalg.norm(moment, axis=1) + lever * np.linalg.norm(force, axis=1)
        beyond = np.abs(roll) > 1e-9 * scale
        if beyond.any():
            sample = int(np.argmax(beyond))
            raise RollMomentError(site.name, first + sample, float(roll[sample]))
