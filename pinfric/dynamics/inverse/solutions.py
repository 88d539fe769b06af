"""All states of friction at one sample: several where ambiguous, none where it jams."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from pinfric.dynamics.inverse.choices import LOWER, friction_laws
from pinfric.dynamics.inverse.effort_maps import (
    LinkedSamples,
    link_samples,
    loop_wrenches,
    write_site_wrenches,
)
from pinfric.dynamics.inverse.interval_ends import Ends, choice_of_sample, find_ends
from pinfric.dynamics.problem.plan import Plan, drive_delivery, kept_plan
from pinfric.dynamics.samples.outcome import Solution, SolvedMotion
from pinfric.friction.dense import spectral_radius_bound
from pinfric.friction.given_modes import contraction_matrix
from pinfric.friction.law import write_loads
from pinfric.friction.several import distinct, from_many_starts
from pinfric.model.scene import Scene


def find_solutions(result: SolvedMotion, sample: int) -> tuple[Solution, ...]:
    """Return the states of friction that obey the laws at one sample (`result.solutions`)."""
    if result.scene.linkage is None:
        return (_of_open_chain(result, sample),)
    plan, samples = one_sample(result, sample)
    if samples.singular[0]:
        return ()
    law = friction_laws(plan, samples)
    if (law.options > 1).any():
        ends = find_ends(plan, samples).ends
        frictions = ends.reshape(-1, ends.shape[-1])
        frictions = frictions[~np.isnan(frictions).any(axis=1)]
    else:
        search, count, reduced = choice_of_sample(plan, samples, law, law.code[0])
        choice = search.choice
        starts = choice.x, max(count, 0), choice.figures
        count = from_many_starts(reduced, choice.way, *starts)
        frictions = choice.x[:count, plan.entries.site] * law.direction
    return tuple(_solution(result.scene, samples, phi) for phi in distinct(frictions))


def solve_sample(
    result: SolvedMotion, sample: int
) -> tuple[Ends, Callable[[np.ndarray], Solution]]:
    """Return one sample's ends, solved alone, and what makes solutions of frictions (ne,)."""
    plan, samples = one_sample(result, sample)
    return find_ends(plan, samples), partial(_solution, result.scene, samples)


def one_sample(result: SolvedMotion, sample: int) -> tuple[Plan, LinkedSamples]:
    """Return the search's input of one sample."""
    scene, states = result.scene, result.states
    argument, part = kept_plan(scene, "inverse"), slice(sample, sample + 1)
    carried = next(names for start, stop, names in states.phases(scene) if start <= sample < stop)
    twin, applied = scene.twin(carried), result.external
    samples, _ = link_samples(argument, scene, twin, states, applied, part, 1)
    return argument.given, samples._replace(reversal=result.reversal[part])


def find_jamming_site(result: SolvedMotion, sample: int) -> str | None:
    """Return the site whose load grows most with friction (`result.jamming_site`)."""
    if result.scene.linkage is None or not result.scene.site_names:
        return None
    plan, samples = one_sample(result, sample)
    if samples.singular[0]:
        return None
    law = friction_laws(plan, samples)
    code = np.where(law.options[0] > 1, LOWER, law.code[0])  # what sticks is at a limit
    reduced = choice_of_sample(plan, samples, law, code)[2]
    nz = reduced.contact.shape[1] - 1
    A, vector = np.empty((nz, nz)), np.empty(nz)
    contraction_matrix(reduced, A)
    if spectral_radius_bound(A, vector) == 0.0:
        return None
    return result.scene.site_names[int(np.flatnonzero(reduced.unknown == np.argmax(vector))[0])]


def _solution(scene: Scene, samples: LinkedSamples, phi: np.ndarray) -> Solution:
    argument, na, linkage = kept_plan(scene, "inverse"), len(scene.drives), scene.linkage
    assert linkage is not None
    plan = argument.given
    ns = len(plan.sites.joint)
    wrench, solved = np.empty((1, ns, 6)), np.empty((1, plan.closure.solved))
    unknowns = phi[None], wrench, solved
    write_site_wrenches(argument.beside(samples.X, *unknowns), samples, *unknowns)
    columns = np.concatenate([[1.0], phi])
    load = np.empty(ns)
    write_loads(samples.contact[0], plan.contacts.site, plan.sites.constant, phi, load)
    friction = phi[plan.sites.first_entry].copy()
    for s in np.flatnonzero(plan.sites.entry_count == 3):
        first = plan.sites.first_entry[s]
        friction[s] = -np.linalg.norm(phi[first : first + 3])
    return Solution(
        effort=samples.effort[0, :na] @ columns,
        friction=friction,
        friction_coordinates=phi.copy(),
        normal_load=load,
        wrench=wrench[0],
        multipliers=loop_wrenches(linkage, samples.X, solved)[0],
    )


def _of_open_chain(result: SolvedMotion, sample: int) -> Solution:
    """The solution of a sample; what sticks has no friction."""
    friction = np.where(
        result.friction_lower[sample] == result.friction_upper[sample],
        result.friction_lower[sample],
        0.0,
    )
    sites, total = result.scene.site_tables, np.zeros(result.scene.model.nv)
    np.add.at(total, sites.velocity_index, sites.ratio * friction)
    effort = result.effort_frictionless[sample] - drive_delivery(result.scene) @ total
    ns = len(friction)
    wrench = np.full((ns, 6), np.nan) if result.wrench is None else result.wrench[sample]
    return Solution(
        effort, friction, friction, result.normal_load[sample], wrench, np.zeros((0, 6))
    )
