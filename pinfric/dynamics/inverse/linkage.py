"""Inverse dynamics with loops, cylinders or forces, where reactions and friction are coupled.

    M a + h - J_ext^T f_ext = S u + J_c^T lambda + D phi,     phi_k = -sign(v_k) mu_k c_k(w)

(paper eq. 16, 17 solved together). `effort_maps` makes everything affine in phi; `interval_ends`
finds phi.
"""

from __future__ import annotations

import warnings

import numpy as np

from pinfric.dynamics.inverse.balance import base_rows
from pinfric.dynamics.inverse.effort_maps import (
    link_samples,
    loop_wrenches,
    site_speeds,
    write_site_wrenches,
)
from pinfric.dynamics.inverse.interval_ends import MOST_PASSES, Ends, find_ends
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.inverse.undriven import check_undriven
from pinfric.dynamics.problem.plan import kept_plan
from pinfric.dynamics.samples.motor_torques import motor_torques
from pinfric.dynamics.samples.outcome import Status
from pinfric.dynamics.samples.reactions import (
    CHUNK,
    AppliedWrench,
    check_roll_moments,
    constant_payloads,
)
from pinfric.dynamics.samples.states import States
from pinfric.dynamics.samples.threaded import threads_for
from pinfric.errors import PinfricWarning
from pinfric.model.scene import Scene


def solve_linkage(
    scene: Scene, states: States, applied: list[AppliedWrench], whole: slice, threads: int | None
) -> InverseResult:
    """Solve the samples of one slice; those beside it are for reversals only.

    Args, raises: see `inverse.inverse_dynamics`.
    """
    argument = kept_plan(scene, "inverse")
    around, inner = states.around(whole), states.inside(whole)
    plan, linkage, na = argument.given, scene.linkage, len(scene.drives)
    T = whole.stop - whole.start
    assert linkage is not None
    threads, parts = threads_for(T, threads), []
    frictionless = np.empty((T, len(plan.drives.action)))
    wrench, solved = np.empty((T, len(scene.sites), 6)), np.empty((T, plan.closure.solved))
    multipliers = np.empty((T, len(scene.loops), 6))
    sticking, reversal = np.zeros((2, T, len(scene.sites)), dtype=bool)
    drive_motion = np.empty((2, around.stop - around.start, na))
    for part, twin in constant_payloads(scene, states, whole, CHUNK * threads):
        here = slice(part.start - whole.start, part.stop - whole.start)
        there = states.around(part)
        samples, moved = link_samples(argument, scene, twin, states, applied, part, threads)
        drive_motion[:, there.start - around.start : there.stop - around.start] = moved
        reversal[here] = samples.reversal
        sticking[here] = site_speeds(plan, samples.velocity) <= plan.sites.laws.stick_velocity
        frictionless[here] = samples.effort[:, :, 0]
        ends = find_ends(plan, samples)
        parts.append(ends)
        unknowns = ends.phi, wrench[here], solved[here]
        write_site_wrenches(argument.beside(samples.X, *unknowns), samples, *unknowns)
        multipliers[here] = loop_wrenches(linkage, samples.X, solved[here])
    answer = Ends(*map(np.concatenate, zip(*parts, strict=True)))
    _warn(scene, answer, whole.start)
    free = (sticking | reversal) & plan.sites.laws.dry  # friction is an interval
    # friction at rest must balance what has no drive, too: what it can do is less
    uncertain = free if scene.mobility.undriven else free[:, plan.sites.entry_count == 3]
    exact = (answer.status == Status.CONVERGED) & ~answer.searched & ~uncertain.any(axis=1)
    check_roll_moments(scene, wrench, whole.start)
    base = base_rows(scene, applied)
    check_undriven(scene, states, whole, answer.lower[:, na:], answer.upper[:, na:], base)
    at = [na + scene.mobility.undriven.index(v) for v in base]
    efforts = answer.lower[:, :na], answer.upper[:, :na]
    torques = motor_torques(scene, states, whole, efforts, *drive_motion)
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
        base_residual=frictionless[:, at] if base else None,
        redundant=plan.closure.multipliers > scene.model.nv - plan.closure.freedoms,
        actuator_velocity=drive_motion[0, inner],
        actuator_acceleration=drive_motion[1, inner],
    )


def _warn(scene: Scene, answer: Ends, first: int) -> None:
    """Warn of samples without ends, or with those of a search; `first`: number of the first."""
    over = (answer.status == Status.NOT_CONVERGED) & (answer.iterations > MOST_PASSES)
    contraction = answer.contraction[over].max(initial=0.0)
    for samples, what in (
        (
            over,
            "undecided: the search for the ends of efforts did not finish within "
            f"{MOST_PASSES} passes (loads grow with the friction they cause, contraction "
            f"{contraction:.3g}); remove friction from joints where it does not matter, reduce "
            "`mu`, or give a state in motion",
        ),
        (
            answer.searched,
            "the intervals of the efforts may be too narrow: so many joints at rest load each "
            "other that the ends are the best of a search; remove friction from joints where it "
            "does not matter, or give a state in motion",
        ),
    ):
        here = np.flatnonzero(samples)
        if len(here):
            more = f" and {len(here) - 1} more" if len(here) > 1 else ""
            text = f"{scene.source}: sample {first + here[0]}{more}: {what}"
            warnings.warn(text, PinfricWarning, stacklevel=4)
