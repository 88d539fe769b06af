"""Inverse dynamics of open chains whose drives sit on their joints.

    u = tau_id - D phi,     phi_k opposes v_k and depends on the wrench w_k       (paper eq. 16, 17)

Reactions do not depend on how drive and friction share the torque about the axis: there is no
iteration. At rest phi is anywhere between its static limits, and u an interval (eq. 21, 22).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.balance import base_rows
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.inverse.undriven import check_undriven, narrow_friction
from pinfric.dynamics.problem.plan import drive_delivery
from pinfric.dynamics.samples.motion_kernels import TreeSamples, bound_efforts, effort_bounds
from pinfric.dynamics.samples.motor_torques import motor_torques
from pinfric.dynamics.samples.presliding import BuiltUp, build_up_friction
from pinfric.dynamics.samples.reactions import (
    AppliedWrench,
    batch_size,
    check_roll_moments,
    constant_payloads,
    part_of,
    reactions,
)
from pinfric.dynamics.samples.reversals import reversals
from pinfric.dynamics.samples.states import States
from pinfric.dynamics.samples.threaded import bound_in_parts, team, threads_for
from pinfric.errors import StateError
from pinfric.model.couples import deliver_interval, drive_rates
from pinfric.model.scene import Scene, SiteTables
from pinfric.model.twin import Twin, project

#: Fields of `TreeSamples` that are results.
_FOUND = TreeSamples._fields[3:]


def _samples(
    scene: Scene, velocity: np.ndarray, reversal: np.ndarray, reacting: bool
) -> tuple[TreeSamples, np.ndarray]:
    """Make the arrays of n samples, and of the wrenches at their sites.

    In one block: page faults of separate arrays cost more than the kernels.
    """
    n, nv, ns = len(velocity), scene.model.nv, len(scene.sites)
    shapes = [(n, nv)] * 3 + [(n, ns)] * 3 + [(n, ns, 6 if reacting else 0)]
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    pieces = np.split(np.empty(ends[-1]), ends[:-1])
    *results, wrench = (piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True))
    sticking = np.empty((n, ns), dtype=bool)
    arrays = velocity, reversal, np.empty((0, 0)), *results, sticking
    return TreeSamples._make(arrays), wrench


def solve_tree(
    scene: Scene,
    states: States,
    applied: list[AppliedWrench],
    whole: slice,
    threads: int | None,
    built: BuiltUp | None = None,
) -> InverseResult:
    """Solve the samples of one slice; those beside it are for reversals only.

    Args, raises: see `inverse.inverse_dynamics`. built: of all samples.
    """
    T, sites = whole.stop - whole.start, scene.site_tables
    threads = threads_for(T, threads)
    velocity, reversal = _site_velocities(scene, states, whole, threads)
    reacting = _needs_wrenches(scene, applied)
    results, wrench = _samples(scene, velocity, reversal, reacting)
    built = built and built.part(whole)
    at_ends = None if built is None else tuple(np.empty((2, *results.effort_lower.shape)))
    for part, twin in constant_payloads(scene, states, whole, batch_size(threads)):
        here = slice(part.start - whole.start, part.stop - whole.start)
        samples, a = TreeSamples._make(array[here] for array in results), states.a[part]
        joint_wrench = wrench[here]
        if reacting:
            joint_wrench = _react(scene, twin, states, applied, part, joint_wrench, threads)
        else:
            write_plain_efforts(
                twin, states.q[part], states.v[part], a, threads, samples.effort_frictionless
            )
        if sites.contacts.moves.any():
            samples = samples._replace(displacement=twin.displacements(sites.joint, states.q[part]))
        _bound(twin, a, sites, joint_wrench, samples, threads)
        if built is not None and at_ends is not None:
            _build_up(scene, built.part(here), samples, at_ends[0][here], at_ends[1][here])
    if reacting:
        check_roll_moments(scene, wrench, whole.start)
    answer = {name: getattr(results, name) for name in _FOUND}
    base = base_rows(scene, applied)
    left = results.effort_frictionless[:, base].copy() if base else None
    around = states.around(whole)
    v, a = states.v[around], states.a[around]
    if at_ends is not None:  # of the joints, then of their drives
        at_ends = tuple(np.ascontiguousarray(x @ drive_delivery(scene).T) for x in at_ends)
    if not scene.one_drive_each:
        answer |= _on_drives(scene, states, whole, results, base)
        v, a = (drive_rates(scene.drives, rates, v[:, :0]) for rates in (v, a))
    efforts = answer["effort_lower"], answer["effort_upper"]
    check_finite(scene, efforts, whole.start)
    torques = motor_torques(scene, states, whole, efforts, v, a, built, at_ends)
    if torques is not efforts:  # behind a gear
        check_finite(scene, torques, whole.start)
    return InverseResult(
        scene=scene,
        states=states.part(whole),
        external=tuple(AppliedWrench(w.joint, w.wrench[whole]) for w in applied),
        **answer,
        wrench=wrench if reacting else None,
        motor_torque_lower=torques[0],
        motor_torque_upper=torques[1],
        reversal=reversal,
        iterations=np.zeros(T, dtype=np.int32),
        contraction=np.zeros(T),
        status=np.zeros(T, dtype=np.int8),
        multipliers=None,
        interval_exact=np.ones(T, dtype=bool),
        interval_searched=np.zeros(T, dtype=bool),
        redundant=False,
        presliding=built,
        base_residual=left,
        actuator_velocity=v[states.inside(whole)],
        actuator_acceleration=a[states.inside(whole)],
    )


def _site_velocities(
    scene: Scene, states: States, whole: slice, threads: int
) -> tuple[np.ndarray, np.ndarray]:
    """(T, ns) velocities of the sites, and at which samples they reverse."""
    index, ratio = scene.site_tables.velocity_index, scene.site_tables.ratio
    wider, inner = states.v[states.around(whole)], states.inside(whole)
    if not np.array_equal(index, np.arange(wider.shape[1])) or (ratio != 1).any():
        wider = wider.take(index, axis=1) * ratio  # C-ordered: another layout is another kernel
    if states.t is None:
        return wider[inner], np.zeros(wider.shape, dtype=bool)
    stick_velocity = scene.site_tables.laws.stick_velocity
    return wider[inner], reversals(wider, stick_velocity, threads)[inner]


def _needs_wrenches(scene: Scene, applied: list[AppliedWrench]) -> bool:
    """Return whether anything in the scene depends on reactions."""
    return bool(applied or scene.springs) or any(
        site.friction.bearing is not None for site in scene.sites
    )


def _react(
    scene: Scene,
    twin: Twin,
    states: States,
    applied: list[AppliedWrench],
    part: slice,
    at_sites: np.ndarray,
    threads: int,
) -> np.ndarray:
    """Write the wrenches of one batch at its sites; return those of all joints (n, nj, 6).

    Args:
        scene, states, applied: see `inverse.inverse_dynamics`.
        twin, part: of this batch.
        at_sites: (n, ns, 6), overwritten.
        threads: of numba.
    """
    all_sites = len(scene.sites) == twin.n_joints  # then no second copy of their wrenches
    wrench = at_sites if all_sites else np.empty((part.stop - part.start, twin.n_joints, 6))
    reactions(twin, states.part(part), part_of(applied, part), wrench, threads)
    if not all_sites:
        at_sites[:] = wrench[:, scene.site_tables.joint]
    return wrench


def _bound(
    twin: Twin,
    a: np.ndarray,
    sites: SiteTables,
    wrench: np.ndarray,
    samples: TreeSamples,
    threads: int,
) -> None:
    """Write efforts without friction, loads, friction and efforts of one batch into `samples`.

    Args:
        twin, a: of this batch, (n, nv).
        sites: `Scene.site_tables`.
        wrench: (n, nj, 6) of all joints, or (n, ns, 0): nothing depends on them.
    """
    balance = twin.embedding, twin.armature, a
    if threads == 1:
        if wrench.shape[2] > 0:
            project(wrench, *balance, samples.effort_frictionless)
        bound_efforts(sites, wrench, samples)
        return
    with team(threads) as parts:
        bound_in_parts(parts, wrench, samples, *balance, *sites)


def _build_up(
    scene: Scene, built: BuiltUp, samples: TreeSamples, ahead: np.ndarray, back: np.ndarray
) -> None:
    """Let friction build up in one batch; see `build_up_friction`."""
    ways, sites = scene.ways, scene.site_tables
    assert ways is not None
    has = ways.way[sites.velocity_index] > 0.0
    build_up_friction(sites, has, built.lower, built.upper, samples, ahead, back)
    lower, upper = samples.friction_lower, samples.friction_upper
    column = sites.velocity_index, sites.ratio
    ends = samples.effort_lower, samples.effort_upper
    effort_bounds(samples.effort_frictionless, lower, upper, *column, *ends)


def write_plain_efforts(
    twin: Twin, q: np.ndarray, v: np.ndarray, a: np.ndarray, threads: int, effort: np.ndarray
) -> None:
    """Write Pinocchio's RNEA (n, nv), where nothing depends on reactions."""
    pin.rneaInParallel(threads, twin.plain_pool(threads), q.T, v.T, a.T, effort.T)


def _on_drives(
    scene: Scene, states: States, whole: slice, joints: TreeSamples, left: Sequence[int]
) -> dict[str, np.ndarray]:
    """Map the joints' efforts to their drives; raises the errors of `check_undriven`."""
    P, undriven = drive_delivery(scene), list(scene.mobility.undriven)
    lower, upper = joints.effort_lower, joints.effort_upper
    check_undriven(scene, states, whole, lower[:, undriven], upper[:, undriven], left)
    narrow_friction(scene, joints.effort_frictionless, joints.friction_lower, joints.friction_upper)
    # joints' frictions are independent: so are the ends of their efforts
    lower, upper = deliver_interval(P, lower, upper)
    frictionless = joints.effort_frictionless @ P.T
    return {"effort_lower": lower, "effort_upper": upper, "effort_frictionless": frictionless}


def check_finite(scene: Scene, ends: tuple[np.ndarray, np.ndarray], first: int) -> None:
    """Refuse a result that overflowed."""
    efforts = ends[0] + ends[1]
    if not np.isfinite(efforts).all():
        sample, drive = np.argwhere(~np.isfinite(efforts))[0]
        raise StateError(
            f"the effort of {scene.actuator_names[drive]} at sample {first + sample} overflows: "
            "a state, a load or a coefficient of friction is too large"
        )
