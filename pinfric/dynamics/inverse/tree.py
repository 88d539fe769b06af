"""Inverse dynamics of open chains whose drives sit on their joints.

    u = tau_id - D phi,     phi_k opposes v_k and depends on the wrench w_k       (paper eq. 16, 17)

The reactions do not depend on how drive and friction share the axis component, so that needs no
iteration; at rest phi is any value between its static limits, and u an interval (eq. 21, 22).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.inverse.undriven import check_undriven, narrow_friction
from pinfric.dynamics.problem.layout import make_layout
from pinfric.dynamics.problem.motion_kernels import effort_bounds
from pinfric.dynamics.problem.motor_torques import motor_torques
from pinfric.dynamics.problem.reactions import (
    AppliedWrench,
    Batch,
    batch_size,
    check_roll_moments,
    constant_payloads,
    generalized_effort,
    reactions,
    subtract_external_wrenches,
)
from pinfric.dynamics.problem.reversals import reversals
from pinfric.dynamics.problem.states import States
from pinfric.dynamics.problem.threaded import efforts_in_parts, friction_in_parts, team, threads_for
from pinfric.errors import StateError
from pinfric.model.bearings import normal_loads
from pinfric.model.couples import deliver_interval, drive_rates
from pinfric.model.laws import Laws, friction_bounds
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin


class _Answer(NamedTuple):
    """What is found of each sample; the names are those of `InverseResult`."""

    effort_lower: np.ndarray
    effort_upper: np.ndarray
    effort_frictionless: np.ndarray
    normal_load: np.ndarray
    friction_lower: np.ndarray
    friction_upper: np.ndarray
    wrench: np.ndarray
    sticking: np.ndarray

    @classmethod
    def of(cls, n: int, nv: int, ns: int, reacting: bool) -> _Answer:
        """Carve arrays for n samples out of one block.

        A large block gets huge pages and so few page faults, which cost more than the friction
        kernels when every array is allocated by itself.
        """
        shapes = [(n, nv)] * 3 + [(n, ns)] * 3 + [(n, ns, 6 if reacting else 0)]
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
        pieces = np.split(np.empty(ends[-1]), ends[:-1])
        arrays = [piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)]
        return cls._make([*arrays, np.empty((n, ns), dtype=bool)])

    def part(self, here: slice) -> _Answer:
        """Return the samples of one slice."""
        return _Answer(*(array[here] for array in self))

    def rubbing(self, velocity: np.ndarray, laws: Laws, reversal: np.ndarray) -> tuple[Any, ...]:
        """Return the arguments of `friction_bounds`."""
        friction = self.friction_lower, self.friction_upper, self.sticking
        return velocity, self.normal_load, laws, reversal, *friction


def solve_tree(
    scene: Scene, states: States, applied: list[AppliedWrench], whole: slice, threads: int | None
) -> InverseResult:
    """Solve the samples of one slice; the samples beside it only tell reversals.

    Args, raises: see `inverse.inverse_dynamics`.
    """
    T, sites = whole.stop - whole.start, scene.site_tables
    threads = threads_for(T, threads)
    velocity, reversal = _site_velocities(scene, states, whole, threads)
    reacting = _needs_wrenches(scene, applied)
    answer = _Answer.of(T, scene.model.nv, len(scene.sites), reacting)
    batch = Batch.of(scene.twin(), min(T, batch_size(threads)))
    for part, twin in constant_payloads(scene, states, whole, batch_size(threads)):
        here = slice(part.start - whole.start, part.stop - whole.start)
        now = answer.part(here)
        rubbing = now.rubbing(velocity[here], sites.laws, reversal[here])
        if reacting:
            _react(scene, twin, states, applied, part, batch, now, rubbing, threads)
        else:
            now.normal_load[:] = 0.0
            qva = states.q[part], states.v[part], states.a[part]
            _plain(twin, *qva, threads, now.effort_frictionless)
            friction_bounds(*rubbing)
    if reacting:
        check_roll_moments(scene, answer.wrench, whole.start)
    _bound_efforts(scene, answer, threads)
    around = states.around(whole)
    v, a = states.v[around], states.a[around]
    if not scene.one_drive_each:
        answer = _on_drives(scene, states, whole, answer)
        v, a = (drive_rates(scene.drives, given, v[:, :0]) for given in (v, a))
    efforts = answer.effort_lower, answer.effort_upper
    check_finite(scene, efforts, whole.start)
    torques = motor_torques(scene, states, whole, efforts, v, a)
    if torques is not efforts:  # behind a gear
        check_finite(scene, torques, whole.start)
    return InverseResult(
        scene=scene,
        states=states.part(whole),
        external=tuple(AppliedWrench(w.joint, w.wrench[whole]) for w in applied),
        **answer._asdict() | ({} if reacting else {"wrench": None}),
        motor_torque_lower=torques[0],
        motor_torque_upper=torques[1],
        reversal=reversal,
        iterations=np.zeros(T, dtype=np.int32),
        contraction=np.zeros(T),
        status=np.zeros(T, dtype=np.int8),
        multipliers=None,
        interval_exact=np.ones(T, dtype=bool),
        redundant=False,
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
    """Say whether anything in the scene looks at reactions; if not, they are not computed."""
    return bool(applied) or any(site.friction.bearing is not None for site in scene.sites)


def _react(
    scene: Scene,
    twin: Twin,
    states: States,
    applied: list[AppliedWrench],
    part: slice,
    batch: Batch,
    answer: _Answer,
    rubbing: tuple[Any, ...],
    threads: int,
) -> None:
    """Write wrenches, efforts without friction, loads and friction of one batch.

    Args:
        scene, states, applied: see `inverse.inverse_dynamics`.
        twin: with the payloads of this batch.
        part: the samples of this batch.
        batch: buffers of at least as many samples.
        answer: of these samples, overwritten.
        rubbing: arguments of `friction_bounds`.
        threads: of Pinocchio.
    """
    sites, q, a = scene.site_tables, states.q[part], states.a[part]
    every = len(scene.sites) == twin.n_joints
    now = batch.first(part.stop - part.start)
    if every:  # every joint is a site: no second copy of its wrench
        now = Batch(now.q, now.v, now.a, answer.wrench)
    reactions(twin, q, states.v[part], a, now, threads)
    subtract_external_wrenches(twin, applied, part, now)
    if not every:
        answer.wrench[:] = now.wrench[:, sites.joint]
    moves = sites.contacts.moves.any()
    displacement = twin.displacements(sites.joint, q) if moves else np.empty((0, 0))
    bearing = sites.joint, sites.contacts, displacement
    _rub(twin, now.wrench, a, answer.effort_frictionless, bearing, rubbing, threads)


def _rub(
    twin: Twin,
    wrench: np.ndarray,
    a: np.ndarray,
    effort: np.ndarray,
    bearing: tuple[Any, ...],
    rubbing: tuple[Any, ...],
    threads: int,
) -> None:
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
    with team(threads) as parts:
        friction_in_parts(
            parts, wrench, twin.embedding, effort, *bearing, load, velocity, laws, tuple(sides)
        )
    if twin.armature.any():
        effort += twin.armature * a


def _plain(
    twin: Twin, q: np.ndarray, v: np.ndarray, a: np.ndarray, threads: int, effort: np.ndarray
) -> None:
    """Write the ordinary RNEA (n, nv), for scenes whose friction looks at no reaction."""
    pin.rneaInParallel(threads, twin.plain_pool(threads), q.T, v.T, a.T, effort.T)


def _bound_efforts(scene: Scene, answer: _Answer, threads: int) -> None:
    """Write the ends of the efforts from those of the frictions."""
    sites = scene.site_tables
    friction = answer.friction_lower, answer.friction_upper
    efforts = answer.effort_lower, answer.effort_upper
    ends = answer.effort_frictionless, *friction, sites.velocity_index, sites.ratio, *efforts
    if threads == 1:
        effort_bounds(*ends)
    else:
        with team(threads) as parts:
            efforts_in_parts(parts, *ends)


def _on_drives(scene: Scene, states: States, whole: slice, answer: _Answer) -> _Answer:
    """Give the joints' efforts to their drives; it raises what `check_undriven` does."""
    layout, undriven = make_layout(scene), list(scene.mobility.undriven)
    lower, upper = answer.effort_lower, answer.effort_upper
    check_undriven(scene, states, whole, lower[:, undriven], upper[:, undriven])
    narrow_friction(scene, answer.effort_frictionless, answer.friction_lower, answer.friction_upper)
    efforts = [array[:, layout.drive_v] * layout.part for array in answer[:3]]
    if layout.delivery.size:  # joints' frictions are independent: so are the ends of their efforts
        efforts = [*deliver_interval(layout.delivery, *efforts[:2]), efforts[2] @ layout.delivery.T]
    return _Answer._make([*efforts, *answer[3:]])


def check_finite(scene: Scene, ends: tuple[np.ndarray, np.ndarray], first: int) -> None:
    """Refuse a result that overflowed: a number that is none must not reach a table."""
    efforts = ends[0] + ends[1]
    if not np.isfinite(efforts).all():
        sample, drive = np.argwhere(~np.isfinite(efforts))[0]
        raise StateError(
            f"the effort of {scene.actuator_names[drive]} at sample {first + sample} is beyond "
            "what numbers can hold: a state, a load or a coefficient of friction is too large"
        )
