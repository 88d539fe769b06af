"""Inverse dynamics with loops, cylinders or forces, where reactions and friction are coupled.

    M a + h - J_ext^T f_ext = S u + J_c^T lambda + D phi,     phi_k = -sign(v_k) mu_k c_k(w)

(paper eq. 16, 17 solved together). One RNEA batch on the twin gives the wrenches without
multipliers; `effort_maps` makes everything affine in phi; `interval_ends` finds phi.
"""

from __future__ import annotations

import warnings

import numpy as np

from pinfric.dynamics.inverse.effort_maps import write_wrenches
from pinfric.dynamics.inverse.interval_ends import MOST_PASSES, Answer, Solver
from pinfric.dynamics.inverse.linkage_batch import friction_maps, friction_velocities, loop_wrenches
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.inverse.undriven import check_undriven
from pinfric.dynamics.problem.plan import Plan, inverse_plan
from pinfric.dynamics.samples.closure import PairRates, pair_rates
from pinfric.dynamics.samples.motor_torques import motor_torques
from pinfric.dynamics.samples.outcome import Status
from pinfric.dynamics.samples.reactions import (
    CHUNK,
    AppliedWrench,
    Batch,
    check_roll_moments,
    constant_payloads,
)
from pinfric.dynamics.samples.reversals import reversals
from pinfric.dynamics.samples.states import States
from pinfric.dynamics.samples.threaded import threads_for
from pinfric.errors import PinfricWarning
from pinfric.kernels.compiled import KernelArgument
from pinfric.model.couples import drive_rates
from pinfric.model.scene import Scene

#: Fields of each batch's answer that are kept.
_KEPT = (
    "lower",
    "upper",
    "load",
    "friction_lower",
    "friction_upper",
    "status",
    "iterations",
    "contraction",
    "searched",
)


def solve_linkage(
    scene: Scene, states: States, applied: list[AppliedWrench], whole: slice, threads: int | None
) -> InverseResult:
    """Solve the samples of one slice; the samples beside it are used for reversals only.

    Args, raises: see `inverse.inverse_dynamics`; besides, `closure.pair_rates`.
    """
    argument, around, inner = inverse_plan(scene), states.around(whole), states.inside(whole)
    plan = argument.given
    rates = pair_rates(scene, states, around, whole)
    wider = friction_velocities(plan, states.v[around], rates)
    velocity = np.ascontiguousarray(wider[inner])
    reversal = np.zeros((len(velocity), len(scene.sites)), dtype=bool)
    if states.t is not None:
        reversal = site_reversals(plan, wider)[inner]
    answer, frictionless, wrench, multipliers = _solve_batches(
        scene, argument, states, applied, whole, velocity, reversal, threads
    )
    _warn_of_bound(scene, answer, whole.start)
    _warn_of_search(scene, answer, whole.start)
    sticking = site_speeds(plan, velocity) <= plan.sites.laws.stick_velocity
    free = (sticking | reversal) & plan.sites.laws.dry  # friction is an interval
    # friction at rest must balance what has no drive, too: what it can do is less
    uncertain = free if scene.mobility.undriven else free[:, plan.sites.entry_count == 3]
    exact = (answer.status == Status.CONVERGED) & ~answer.searched & ~uncertain.any(axis=1)
    check_roll_moments(scene, wrench, whole.start)
    rates_of_drives = actuator_rates(scene, states, rates, around)
    na, undriven = len(scene.drives), answer.lower[:, len(scene.drives) :]
    check_undriven(scene, states, whole, undriven, answer.upper[:, na:])
    efforts = answer.lower[:, :na], answer.upper[:, :na]
    torques = motor_torques(scene, states, whole, efforts, *rates_of_drives)
    return InverseResult(
        scene=scene,
        states=states.part(whole),
        external=tuple(AppliedWrench(w.joint, w.wrench[whole]) for w in applied),
        effort_lower=efforts[0],
        effort_upper=efforts[1],
        effort_frictionless=frictionless[:, :na],
        motor_torque_lower=torques[0],
        motor_torque_upper=torques[1],
        sticking=sticking,
        reversal=reversal,
        normal_load=answer.load,
        friction_lower=answer.friction_lower,
        friction_upper=answer.friction_upper,
        wrench=wrench,
        iterations=answer.iterations,
        contraction=answer.contraction,
        status=answer.status,
        multipliers=multipliers,
        interval_exact=exact,
        interval_searched=answer.searched,
        redundant=plan.closure.multipliers > scene.model.nv - plan.closure.freedoms,
        actuator_velocity=rates_of_drives[0][inner],
        actuator_acceleration=rates_of_drives[1][inner],
    )


def _solve_batches(
    scene: Scene,
    argument: KernelArgument[Plan],
    states: States,
    applied: list[AppliedWrench],
    whole: slice,
    velocity: np.ndarray,
    reversal: np.ndarray,
    threads: int | None,
) -> tuple[Answer, np.ndarray, np.ndarray, np.ndarray]:
    """Return answer, efforts without friction, wrenches (T, ns, 6) and multipliers of one slice.

    Args:
        scene, states, applied, threads: see `inverse.inverse_dynamics`.
        argument: the plan of inverse dynamics.
        whole: the T samples.
        velocity, reversal: (T, ne), (T, ns), see `choices.friction_laws`.
    """
    linkage, T = scene.linkage, len(velocity)
    assert linkage is not None
    threads = threads_for(T, threads)
    plan = argument.given
    answer = Answer.of(plan, T)
    frictionless = np.empty((T, len(plan.drives.part)))
    wrench, solved = np.empty((T, len(scene.sites), 6)), np.empty((T, plan.closure.solved))
    multipliers = np.empty((T, len(scene.loops), 6))
    batch = Batch.of(scene.twin(), min(T, CHUNK * threads))
    for part, twin in constant_payloads(scene, states, whole, CHUNK * threads):
        here = slice(part.start - whole.start, part.stop - whole.start)
        now = batch.first(part.stop - part.start)
        samples = friction_maps(argument, linkage, twin, states, applied, part, now, threads)
        maps, X = samples.maps, samples.X
        frictionless[here] = maps.effort[:, :, 0]
        found = Solver(plan, maps, velocity[here], reversal[here]).solve()
        for name in _KEPT:
            getattr(answer, name)[here] = getattr(found, name)
        given = samples.wrench, X, maps.y, found.phi, wrench[here], solved[here]
        write_wrenches(argument.beside(*given), *given)
        multipliers[here] = loop_wrenches(linkage, X, solved[here])
    return answer, frictionless, wrench, multipliers


def _warn_of_bound(scene: Scene, answer: Answer, first: int) -> None:
    """Warn of the samples at which the search for the ends of efforts reached its limit."""
    over = (answer.status == Status.NOT_CONVERGED) & (answer.iterations > MOST_PASSES)
    if not over.any():
        return
    samples, contraction = np.flatnonzero(over), answer.contraction[over].max()
    more = f" and {len(samples) - 1} more" if len(samples) > 1 else ""
    warnings.warn(
        f"{scene.source}: sample {first + samples[0]}{more}: undecided: the search for the "
        f"ends of efforts did not finish within {MOST_PASSES} passes "
        f"(loads grow with the friction they cause, contraction {contraction:.3g}); remove "
        "friction from joints where it does not matter, reduce `mu`, or give a state in motion",
        PinfricWarning,
        stacklevel=4,
    )


def _warn_of_search(scene: Scene, answer: Answer, first: int) -> None:
    """Warn of the samples whose ends come from a search."""
    samples = np.flatnonzero(answer.searched)
    if not len(samples):
        return
    more = f" and {len(samples) - 1} more" if len(samples) > 1 else ""
    warnings.warn(
        f"{scene.source}: sample {first + samples[0]}{more}: the intervals of the efforts may be "
        "too narrow: so many joints at rest load each other that the ends are the best of a "
        "search; remove friction from joints where it does not matter, or give a state in motion",
        PinfricWarning,
        stacklevel=4,
    )


def site_speeds(plan: Plan, velocity: np.ndarray) -> np.ndarray:
    """Return the speed (n, ns) of each site; a ball's is the length of its angular velocity."""
    squares = (
        np.add.reduceat(velocity**2, plan.sites.first_entry, axis=1)
        if len(plan.sites.joint)
        else (np.zeros((len(velocity), 0)))
    )
    return np.asarray(np.sqrt(squares))


def site_reversals(plan: Plan, velocity: np.ndarray) -> np.ndarray:
    """Return (n, ns) whether a site passes through rest next to a sample.

    A ball does where the straight line between two angular velocities comes as near to zero as its
    stick velocity; of the two samples the slower one is marked (the earlier if equal).

    Args:
        plan: `Plan`.
        velocity: (n, ne), `friction_velocities`.
    """
    stick = plan.sites.laws.stick_velocity
    marked = reversals(np.ascontiguousarray(velocity[:, plan.sites.first_entry]), stick)
    for s in np.flatnonzero(plan.sites.entry_count == 3):
        w = velocity[:, plan.sites.first_entry[s] : plan.sites.first_entry[s] + 3]
        change = np.diff(w, axis=0)
        square = np.maximum((change**2).sum(axis=1), 1e-300)
        share = np.clip(-(w[:-1] * change).sum(axis=1) / square, 0.0, 1.0)
        nearest = np.linalg.norm(w[:-1] + share[:, None] * change, axis=1)
        speed = np.linalg.norm(w, axis=1)
        moving = (speed[:-1] > stick[s]) & (speed[1:] > stick[s])
        passes = np.flatnonzero((nearest <= stick[s]) & moving)
        marked[:, s] = False
        marked[np.where(speed[passes] <= speed[passes + 1], passes, passes + 1), s] = True
    return marked


def actuator_rates(
    scene: Scene, states: States, rates: PairRates, around: slice
) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, na) velocity and acceleration of what each drive moves, of `around`."""
    return (
        drive_rates(scene.drives, states.v[around], rates.rate),
        drive_rates(scene.drives, states.a[around], rates.rate_derivative),
    )
