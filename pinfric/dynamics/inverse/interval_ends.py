"""Friction, efforts and their ends where reactions depend on friction.

Everything except the friction law is affine in friction (`effort_maps.LinkedSamples`), so a sample
is a small coupled problem (`given_modes`). Sites whose friction depends on each other are an
*island*; an effort is the sum over islands. Sites that stick, or reverse next to a sample, have
several possible frictions; at the ends of efforts each is at one of its limits. A site whose
friction changes no load is *last*: its limit follows from its load and the end wanted. Up to
`ENUMERATED` choices of the others are all solved, each from the one before, which differs at one
site; beyond that, branch and bound finds the ends (`sign_bounds`). Where it cannot, or a choice may
have several solutions, single sites are switched to their other limit while the effort grows: the
sample is `searched`. The limit of a ball is a sphere: its friction is turned to where the effort
grows fastest. The search ends where a sample jams, and after `MOST_PASSES` (`NOT_CONVERGED`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from pinfric.dynamics.inverse.choices import LOWER, NONE, SLIDES, UPPER, SiteLaws, friction_laws
from pinfric.dynamics.inverse.effort_maps import LinkedSamples
from pinfric.dynamics.inverse.sign_bounds import Limits, Slopes, bound_slopes
from pinfric.dynamics.problem.plan import Plan
from pinfric.dynamics.samples.outcome import Status
from pinfric.friction.dense import solve_dense, spectral_radius_bound
from pinfric.friction.given_modes import (
    MOST_SOLUTIONS,
    Reduced,
    reduce_problem,
    solve_given_modes,
)
from pinfric.friction.law import add_load_slopes, write_loads
from pinfric.friction.problem import Problem
from pinfric.friction.rest import connected
from pinfric.friction.several import from_many_starts
from pinfric.kernels.arrays import array, make
from pinfric.kernels.compiled import KernelArgument, inlined_kernel, kernel
from pinfric.kernels.records import record

#: Choices of one sample that are all solved: 2^12, with a ball 2^8; nodes of branch and bound.
ENUMERATED, ENUMERATED_BALLS, NODES = 4096, 256, 4096
#: Passes of Newton's method for one sample, all its choices together: about a second. The last
#: choice begins below it, and its search from many starts may take as many again.
MOST_PASSES = 100_000
#: More sites than this at rest are never interpreted. Islands are taken together up to so many
#: sites that are not last.
_INTERPRETED, _TOGETHER = 6, 3
#: Below this contraction Newton's method needs no safeguards; its passes, and the relative step
#: that ends them: its square is rounding.
_CLEAR, _PASSES, _STEP = 0.9, 12, 1e-10
#: Turns of a ball's friction until it stays, and what counts as staying: the end's error is its
#: square.
_TURNS, _STAYS = 60, 1e-9
#: Code of a site in a node of branch and bound that is anywhere between its limits.
_BETWEEN = -1


class Ends(NamedTuple):
    """The results of n samples.

    Attributes:
        lower, upper: (n, na) efforts.
        phi: (n, ne) friction, none where stuck: the state that wrenches are given for.
        load: (n, ns) in that state.
        friction_lower, friction_upper: (n, ns) over all choices.
        status: (n,) int8. iterations: (n,) int32. contraction: (n,), the largest.
        searched: (n,) bool: the ends are the best of single flips, so they may be too narrow.
        ends: (n, na, 2, ne) friction at each end of each effort.
    """

    lower: np.ndarray = array("n na")
    upper: np.ndarray = array("n na")
    phi: np.ndarray = array("n ne", fill=np.nan)
    load: np.ndarray = array("n ns", fill=np.nan)
    friction_lower: np.ndarray = array("n ns", fill=np.inf)
    friction_upper: np.ndarray = array("n ns", fill=-np.inf)
    status: np.ndarray = array("n", np.int8)
    iterations: np.ndarray = array("n", np.int32)
    contraction: np.ndarray = array("n")
    searched: np.ndarray = array("n", bool)
    ends: np.ndarray = array("n na 2 ne", fill=np.nan)


class SiteIsland(NamedTuple):
    """Sites whose friction depends on each other, and on no other site's.

    Attributes:
        site, entry, row: (ns,), (ne,), (nt,) numbers in the plan: of sites, their entries, their
            contact forces that friction changes.
        of, owner: (ne,), (nt,) place here of each entry's, each contact force's site.
        ball, last: (ns,) bool; whether a site's friction changes no load.
    """

    site: np.ndarray
    entry: np.ndarray
    row: np.ndarray
    of: np.ndarray
    owner: np.ndarray
    ball: np.ndarray
    last: np.ndarray


class Corner(NamedTuple):
    """One choice of an island's frictions at one sample, and its solutions.

    Attributes:
        contact, effort: (nt, 1 + ne, 3), (na, ne) of the sample.
        along: (nt, 1 + ns, 3) `contact` by the friction along each direction.
        options, code, constant: (ns,) see `SiteLaws`.
        last: (ns,) bool, see `SiteIsland`; while ends are searched none is.
        direction: (ne,) along which friction acts.
        way, mu, coulomb: (ns,), (ns,), (ns, 2) of the choice; way 0 where a site is last.
        x: (MOST_SOLUTIONS, ns) friction of each site along its direction, of each solution.
        load, phi: (ns,), (ne,) in one of them.
        limit, limit_code: (2, ns) least and greatest friction of what is last, their codes.
        ends: (na, 2) least and greatest contribution to each effort.
        figures: (2,) contraction, of all choices in these directions; passes.
        slope, step: (ns, ns), (ns, 1), of Newton's method.
        most: (4,) `ENUMERATED`, `ENUMERATED_BALLS`, `NODES`, `MOST_PASSES`.
    """

    contact: np.ndarray = array("nt columns 3")
    effort: np.ndarray = array("na ne")
    along: np.ndarray = array("nt places 3")
    options: np.ndarray = array("ns", np.int64)
    code: np.ndarray = array("ns", np.int64)
    constant: np.ndarray = array("ns")
    last: np.ndarray = array("ns", bool)
    direction: np.ndarray = array("ne")
    way: np.ndarray = array("ns")
    mu: np.ndarray = array("ns")
    coulomb: np.ndarray = array("ns 2")
    x: np.ndarray = array("solutions ns", fill=np.nan)
    load: np.ndarray = array("ns")
    phi: np.ndarray = array("ne")
    limit: np.ndarray = array("2 ns")
    limit_code: np.ndarray = array("2 ns", np.int64)
    ends: np.ndarray = array("na 2")
    figures: np.ndarray = array("2")
    slope: np.ndarray = array("ns ns")
    step: np.ndarray = array("ns 1")
    most: np.ndarray = array("4", np.int64)


class EndTables(NamedTuple):
    """A batch, one of its islands, and the results; see their classes."""

    samples: LinkedSamples
    law: SiteLaws
    answer: Ends
    island: SiteIsland
    choice: Corner


for _part in (LinkedSamples, SiteLaws, Ends, SiteIsland, Corner, EndTables):
    record(_part)


def find_ends(plan: Plan, samples: LinkedSamples) -> Ends:
    """Solve every sample of a batch, see `effort_maps`."""
    law, (n, na, columns) = friction_laws(plan, samples), samples.effort.shape
    answer: Ends = make(Ends, n=n, na=na, ns=len(plan.sites.joint), ne=columns - 1)
    answer.status[samples.singular] = Status.SINGULAR
    answer.lower[:] = answer.upper[:] = samples.effort[:, :, 0]
    kept = [KernelArgument(table) for table in (samples, law, answer)]
    for island in islands(plan, samples.contact):
        tables = EndTables(samples, law, answer, island, choice_of(island, na))
        search = KernelArgument(tables, *kept)
        resting = (law.options[:, island.site[~island.last]] > 1).any(axis=0).sum()
        long = resting > _INTERPRETED
        solve_samples(search.record() if long else search.beside(samples.contact))
    failed = ~np.isin(answer.status, (Status.CONVERGED, Status.AMBIGUOUS))
    for values in answer:
        if values.dtype == float and values is not answer.contraction:
            values[failed] = np.nan
    answer.searched[failed] = False
    return answer


def islands(plan: Plan, contact: np.ndarray) -> Iterator[SiteIsland]:
    """Yield the islands of a batch with `contact`; small ones together, which saves time."""
    sites, contacts, entries = plan.sites, plan.contacts, plan.entries
    linked = np.zeros((len(sites.joint),) * 2, dtype=bool)
    moved = (np.abs(contact[:, :, 1:]) > 0.0).any(axis=(0, 3))  # nothing singular is
    np.logical_or.at(linked, np.ix_(contacts.site, entries.site), moved)
    last = ~linked.any(axis=0) & (sites.entry_count == 1)
    together = np.arange(0)
    for site in connected(linked):
        wider = np.append(together, site)
        if len(together) and (~last[wider]).sum() > _TOGETHER:
            yield island_of(plan, together, last)
            wider = site
        together = wider
    if len(together):
        yield island_of(plan, together, last)


def island_of(plan: Plan, site: np.ndarray, last: np.ndarray) -> SiteIsland:
    """Return the island of some sites; `last` (all sites,) as in `SiteIsland`."""
    place = np.full(len(plan.sites.joint), -1)
    place[site] = np.arange(len(site))
    entry = np.flatnonzero(place[plan.entries.site] >= 0)
    owner = plan.contacts.site
    row = np.flatnonzero((place[owner] >= 0) & plan.sites.varies[owner])
    ball = plan.sites.entry_count[site] == 3
    of, owner = place[plan.entries.site[entry]], place[owner[row]]
    return SiteIsland(site, entry, row, of, owner, ball, last[site])


def choice_of(island: SiteIsland, na: int) -> Corner:
    """Make the arrays of an island for na drives."""
    ns, ne, nt = map(len, island[:3])
    sizes = {"ns": ns, "ne": ne, "nt": nt, "na": na, "columns": 1 + ne, "places": 1 + ns}
    choice: Corner = make(Corner, **sizes, solutions=MOST_SOLUTIONS)
    choice.last[:] = island.last
    choice.most[:] = ENUMERATED, ENUMERATED_BALLS, NODES, MOST_PASSES
    return choice


def choice_of_sample(
    plan: Plan, samples: LinkedSamples, law: SiteLaws, code: np.ndarray
) -> tuple[EndTables, int, Reduced]:
    """Solve one choice (all sites,) of the only sample, without islands.

    Returns:
        The search, the number of solutions, the problem as it is solved.
    """
    ns, (_, na, columns) = len(code), samples.effort.shape
    island = island_of(plan, np.arange(ns), np.zeros(ns, dtype=bool))
    answer: Ends = make(Ends, n=1, na=na, ns=ns, ne=columns - 1)
    tables = EndTables(samples, law, answer, island, choice_of(island, na))
    search, choice = KernelArgument(tables).beside(samples.contact), tables.choice
    begin(search, 0)
    choice.code[:] = code
    solutions = solve_choice(search, 0)
    stuck, rows = np.zeros(ns, dtype=bool), np.empty((0, 3))
    return tables, solutions, reduce_problem(problem_of(tables), stuck, choice.way, rows)[1]


@inlined_kernel
def _code(is_ball: bool, options: int, n: int) -> int:
    """Return the n-th possible code; a ball's limit is one, in any direction."""
    return SLIDES if options == 1 or (is_ball and n > 0) else UPPER if is_ball else (n + 1) % NONE


@inlined_kernel
def _count(is_ball: bool, options: int) -> int:
    """Return how many such codes there are."""
    return max(1, options - is_ball)


@kernel
def solve_samples(search: EndTables) -> None:
    """Add what one island does to the efforts of every sample."""
    island, choice, answer = search.island, search.choice, search.answer
    last, ends = choice.last, choice.ends
    for i in range(answer.status.size):
        if _has_failed(search, i):
            continue
        begin(search, i)
        if choice.options.max() == 1 and choice.figures[0] >= 1.0:
            last[:] = False  # a wide search starts from frictions of all sites: it finds more
        solutions = solve_choice(search, i)
        _note(search, i, solutions)
        if solutions > 0:
            _complete(search, i, 0)
            for s in range(last.size):
                answer.load[i, island.site[s]] = choice.load[s]
            for e in range(choice.phi.size):
                answer.phi[i, island.entry[e]] = choice.phi[e]
        if choice.options.max() == 1:
            for solution in range(solutions):
                if solution > 0:
                    _complete(search, i, solution)
                _widen(search, i, solution, -1, 0)
        elif not _enumerate(search, i):
            last[:] = False
            if not _branch(search, i):
                answer.searched[i] = True
                for drive in range(ends.shape[0]):
                    for side in range(2):
                        _flip(search, i, drive, side)
        for s in range(last.size):
            last[s] = island.last[s]
        for d in range(ends.shape[0]):
            answer.lower[i, d] += ends[d, 0]
            answer.upper[i, d] += ends[d, 1]


@kernel
def begin(search: EndTables, i: int) -> None:
    """Copy one sample, with the friction that wrenches are given for, into the choice."""
    samples, law, island, choice = search.samples, search.law, search.island, search.choice
    site, entry, row, constant = island.site, island.entry, island.row, choice.constant
    for s in range(site.size):
        choice.options[s], choice.code[s] = law.options[i, site[s]], law.code[i, site[s]]
        constant[s], choice.x[0, s] = law.constant[i, site[s]], 0.0
    direction, effort, every_effort = choice.direction, choice.effort, samples.effort
    for e in range(entry.size):
        direction[e] = law.direction[i, entry[e]]
        for d in range(effort.shape[0]):
            effort[d, e] = every_effort[i, d, 1 + entry[e]]
    contact, every_contact = choice.contact, samples.contact
    for t in range(row.size):
        for e in range(1 + entry.size):
            k = 1 + entry[e - 1] if e > 0 else 0
            for axis in range(3):
                contact[t, e, axis] = every_contact[i, row[t], k, axis]
    for d in range(effort.shape[0]):
        choice.ends[d, 0], choice.ends[d, 1] = np.inf, -np.inf
    _direct(search, i)


@kernel
def _direct(search: EndTables, i: int) -> None:
    """Write `along`, and the contraction of all choices (`given_modes.contraction_matrix`)."""
    law, island, choice, of = search.law, search.island, search.choice, search.island.of
    contact, source, direction = choice.along, choice.contact, choice.direction
    A, owner, ns = choice.slope, island.owner, choice.code.size
    contact[:], A[:] = 0.0, 0.0
    for t in range(owner.size):
        for axis in range(3):
            contact[t, 0, axis] = source[t, 0, axis]
            for e in range(of.size):
                contact[t, 1 + of[e], axis] += direction[e] * source[t, 1 + e, axis]
        s, most = owner[t], 0.0
        for n in range(0 if choice.last[s] else _count(island.ball[s], choice.options[s])):
            code = _code(island.ball[s], choice.options[s], n)
            most = max(most, abs(law.mu[code, i, island.site[s]]))
        for j in range(ns if most > 0.0 else 0):
            p, q, r = contact[t, 1 + j, 0], contact[t, 1 + j, 1], contact[t, 1 + j, 2]
            A[s, j] += most * np.sqrt(p * p + q * q + r * r)
    choice.figures[0] = spectral_radius_bound(A, choice.load)


@kernel
def solve_choice(search: EndTables, i: int) -> int:
    """Solve a choice from the last solution; return the number of solutions, -1: undecided."""
    law, choice, site, answer = search.law, search.choice, search.island.site, search.answer
    code, last, way, mu, coulomb = choice.code, choice.last, choice.way, choice.mu, choice.coulomb
    x, figures, coupled, solutions = choice.x, choice.figures, False, 1
    contraction = figures[0]
    for s in range(site.size):
        mu[s] = law.mu[code[s], i, site[s]]
        coulomb[s] = law.coulomb[code[s], i, site[s]]
        way[s] = 0.0 if last[s] else law.way[code[s], i, site[s]]
        coupled |= way[s] * mu[s] != 0.0
    figures[1] = 0.0
    if not coupled:
        for s in range(site.size):
            x[0, s] = -way[s] * coulomb[s, 0]
    elif not _descend(search):
        problem = _problem_within(search), np.zeros(way.size, np.bool_), way, np.empty((0, 3))
        solutions = solve_given_modes(*problem, np.full(1, np.nan), x, figures)
        if solutions < 2 and figures[0] >= 1.0:
            reduced = reduce_problem(*problem)[1]
            solutions = from_many_starts(reduced, way, x, max(solutions, 0), figures)
        for s in range(site.size if solutions < 1 else 0):
            x[0, s] = 0.0
    answer.iterations[i] += int(figures[1])
    answer.contraction[i] = max(answer.contraction[i], figures[0] if coupled else 0.0)
    figures[0] = contraction
    return solutions


def problem_of(search: EndTables) -> Problem:
    """Return a choice for `given_modes`; sites are coordinates."""
    choice, ns = search.choice, search.choice.code.size
    none, dry = np.zeros(ns), choice.coulomb
    return Problem(
        rate_free=none,
        rate_slope=np.zeros((ns, ns)),
        rate_scale=none,
        contact=choice.along,
        contact_entry=search.island.owner,
        constant=choice.constant,
        coordinate=np.arange(ns),
        ratio=np.ones(ns),
        mu_slip=choice.mu,
        mu_stick=choice.mu,
        coulomb_slip=dry,
        coulomb_stick=dry,
        drag=none,
        gear_rotor=np.zeros((0, 2)),
        gear_lines=np.zeros((0, 4, 1, 3)),
        gear_held=np.zeros((0, 3, 2)),
    )


_problem_within = inlined_kernel(problem_of)


@kernel
def _descend(search: EndTables) -> bool:
    """Solve a choice by Newton's method alone, if it contracts; else False."""
    choice, owner, x, load = (
        search.choice,
        search.island.owner,
        search.choice.x[0],
        search.choice.load,
    )
    J, step, way, mu, dry = choice.slope, choice.step, choice.way, choice.mu, choice.coulomb
    contact, constant, ns = choice.along, choice.constant, x.size
    for passes in range(1, _PASSES if choice.figures[0] < _CLEAR else 0):
        for s in range(ns):
            load[s] = constant[s]
            for j in range(ns):
                J[s, j] = 1.0 if s == j else 0.0
        for t in range(owner.size):
            s, p, q, r = owner[t], contact[t, 0, 0], contact[t, 0, 1], contact[t, 0, 2]
            for j in range(ns):
                p += contact[t, 1 + j, 0] * x[j]
                q += contact[t, 1 + j, 1] * x[j]
                r += contact[t, 1 + j, 2] * x[j]
            size = np.sqrt(p * p + q * q + r * r)
            load[s] += size
            gain = way[s] * mu[s] / size if size > 0.0 else 0.0
            for j in range(ns if gain != 0.0 else 0):
                along = p * contact[t, 1 + j, 0] + q * contact[t, 1 + j, 1]
                J[s, j] += gain * (along + r * contact[t, 1 + j, 2])
        for s in range(ns):
            step[s, 0] = x[s] + way[s] * (mu[s] * load[s] + dry[s, 0])
        if not solve_dense(J, step):
            return False
        ends = True
        for s in range(ns):
            ends &= abs(step[s, 0]) <= _STEP * abs(x[s])
            x[s] -= step[s, 0]
        if ends:
            choice.figures[1] = passes
            return True
    return False


@kernel
def _complete(search: EndTables, i: int, solution: int) -> None:
    """Write loads and friction of one solution, with the limits of what is last."""
    law, island, choice = search.law, search.island, search.choice
    x, load, code, phi = choice.x[solution], choice.load, choice.code, choice.phi
    limit, limit_code, last, of = choice.limit, choice.limit_code, choice.last, island.of
    way, mu, coulomb = law.way, law.mu, law.coulomb
    write_loads(choice.along, island.owner, choice.constant, x, load)
    for s in range(load.size if last.any() else 0):
        if not last[s]:
            continue
        site, options = island.site[s], choice.options[s]
        limit[0, s], limit[1, s] = np.inf, -np.inf
        for n in range(-1, options):  # its own code first
            k = code[s] if n < 0 else _code(False, options, n)
            friction = -way[k, i, site] * (mu[k, i, site] * load[s] + coulomb[k, i, site])
            if n < 0:
                x[s] = friction
                continue
            for side in range(2):
                if (2 * side - 1) * (friction - limit[side, s]) > 0.0:
                    limit[side, s], limit_code[side, s] = friction, k
    for e in range(phi.size):
        phi[e] = x[of[e]] * choice.direction[e]


@inlined_kernel
def _has_failed(search: EndTables, i: int) -> bool:
    """Return whether a sample has no ends, or took too many passes."""
    answer, status = search.answer, search.answer.status
    if answer.iterations[i] > search.choice.most[3] and status[i] != Status.JAMMED:
        status[i] = Status.NOT_CONVERGED
    return status[i] != Status.CONVERGED and status[i] != Status.AMBIGUOUS


@inlined_kernel
def _note(search: EndTables, i: int, solutions: int) -> None:
    """Let the number of solutions worsen a sample's status."""
    if solutions < 1:
        search.answer.status[i] = Status.JAMMED if solutions == 0 else Status.NOT_CONVERGED
    elif solutions > 1:
        search.answer.status[i] = Status.AMBIGUOUS


@kernel
def _evaluate(search: EndTables, i: int, drive: int, side: int) -> float:
    """Solve a choice of sample i and let its solutions widen the ends.

    Args:
        drive, side: the end (0 lower) towards which balls at their limit are turned; -1: none are.

    Returns:
        The contribution to that end, of the lower one with the sign changed.
    """
    if _has_failed(search, i):
        return -np.inf
    law, island, direction = search.law, search.island, search.choice.direction
    turns = drive >= 0 and island.ball.any()
    if turns:
        for e in range(direction.size):
            direction[e] = law.direction[i, island.entry[e]]
        _direct(search, i)
    solutions, best = 0, -np.inf
    for _ in range(_TURNS):
        solutions = solve_choice(search, i)
        if not turns or not _turn(search, i, drive, side):
            break
        if search.answer.iterations[i] > search.choice.most[3]:
            solutions = -1
            break
    _note(search, i, solutions)
    for solution in range(solutions):
        _complete(search, i, solution)
        best = max(best, _widen(search, i, solution, drive, side))
    return best


@kernel
def _widen(search: EndTables, i: int, solution: int, drive: int, side: int) -> float:
    """Let a solution widen the ends; return its contribution as `_evaluate` does."""
    island, choice, answer, best = search.island, search.choice, search.answer, -np.inf
    effort, phi, ends, limit, of = choice.effort, choice.phi, choice.ends, choice.limit, island.of
    last, x = choice.last, choice.x[solution]
    for d in range(effort.shape[0]):
        for up in range(2):
            sign, value = 2.0 * up - 1.0, 0.0
            for e in range(phi.size):
                if last[of[e]]:
                    phi[e] = limit[1 if sign * effort[d, e] > 0.0 else 0, of[e]]
                value += effort[d, e] * phi[e]
            if sign * value > sign * ends[d, up]:
                ends[d, up] = value
                for e in range(phi.size):
                    answer.ends[i, d, up, island.entry[e]] = phi[e]
            if d == drive and up == side:
                best = sign * value
    lower, upper = answer.friction_lower, answer.friction_upper
    for s in range(last.size):
        low, high, site = x[s], x[s], island.site[s]
        if last[s]:
            low, high = limit[0, s], limit[1, s]
        elif island.ball[s] and choice.options[s] > 1:  # any direction of the sphere
            low = -abs(high)
        lower[i, site], upper[i, site] = min(lower[i, site], low), max(upper[i, site], high)
    return best


@kernel
def _turn(search: EndTables, i: int, drive: int, side: int) -> bool:
    """Turn the friction of balls at their limit to where it changes an effort most; did it turn?

    With x = gain load(phi) and phi = D x, a small change delta of phi changes the effort by
    g delta, g = U + U D (I - L D)^-1 L: at the extreme every ball's friction points along g.
    """
    law, island, choice, sign = search.law, search.island, search.choice, 2.0 * side - 1.0
    of, owner, code, direction = island.of, island.owner, choice.code, choice.direction
    ns, ne, U, phi = code.size, of.size, choice.effort[drive], choice.phi
    _complete(search, i, 0)
    for e in range(ne):
        s = of[e]
        if choice.last[s]:
            helps = 1 if sign * U[e] > 0.0 else 0
            phi[e], code[s] = choice.limit[helps, s], choice.limit_code[helps, s]
    weight, L, A, h = np.empty(owner.size), np.zeros((ns, ne)), np.eye(ns), np.zeros((ns, 1))
    for t in range(owner.size):
        k, site = code[owner[t]], island.site[owner[t]]
        weight[t] = -law.way[k, i, site] * law.mu[k, i, site]
    add_load_slopes(choice.contact, owner, weight, phi, L)
    for e in range(ne):
        h[of[e], 0] += U[e] * direction[e]
        for s in range(ns):
            A[of[e], s] -= L[s, e] * direction[e]
    if not solve_dense(A, h):
        h[:] = 0.0
    moved, g = False, np.empty(3)
    for e in range(ne):
        if not island.ball[of[e]] or code[of[e]] != UPPER or (e > 0 and of[e - 1] == of[e]):
            continue
        for axis in range(3):
            g[axis] = sign * U[e + axis]
            for s in range(ns):
                g[axis] += sign * h[s, 0] * L[s, e + axis]
        size = np.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
        turns = False
        for axis in range(3 if size > 0.0 else 0):
            turns |= abs(g[axis] / size - direction[e + axis]) >= _STAYS
        for axis in range(3 if turns else 0):
            direction[e + axis] = g[axis] / size
            moved = True
    if moved:
        _direct(search, i)
    return moved


@kernel
def _enumerate(search: EndTables, i: int) -> bool:
    """Solve all combinations of limits; False: too many, or many where each may be ambiguous."""
    island, choice, most = search.island, search.choice, search.choice.most
    (na, ns), balls, corners = (choice.effort.shape[0], choice.code.size), False, 1.0
    count, place, step = np.ones(ns, np.int64), np.zeros(ns, np.int64), np.ones(ns, np.int64)
    ball, options, code = island.ball, choice.options, choice.code
    for s in range(ns):
        if not choice.last[s]:
            count[s] = _count(ball[s], options[s])
        corners *= count[s]
        balls |= ball[s] and options[s] > 1
    if corners > (most[1] if balls else most[0]):
        return False
    for target in range(2 * na if balls else 1):
        for s in range(ns):
            place[s], step[s], code[s] = 0, 1, _code(ball[s], options[s], 0)
        s = 0
        while s < ns:  # in the order of Gray's code
            _evaluate(search, i, target // 2 if balls else -1, target % 2)
            if _has_failed(search, i):
                return True
            if corners > most[1] and choice.figures[0] >= 1.0:
                return False
            s = 0
            while s < ns and not 0 <= place[s] + step[s] < count[s]:
                step[s] = -step[s]
                s += 1
            if s < ns:
                place[s] += step[s]
                code[s] = _code(ball[s], options[s], place[s])
    return True


@kernel
def _branch(search: EndTables, i: int) -> bool:
    """Find the ends by branch and bound; False: it gives up.

    A node has some sites at a limit and the others anywhere between, in its guess at the limits
    that `bound_slopes` suggests; it is split at the site whose other limit may gain most.
    """
    choice, of, ball, solved = search.choice, search.island.of, search.island.ball, 0
    (na, ne), ns, options = choice.effort.shape, choice.code.size, choice.options
    if (options - ball > 2 - ball * 2).any():  # reverses, or is a ball at its limit
        return False
    nodes, bound, U = np.empty((ns + 2, ns), np.int64), np.empty(ns + 2), np.empty(ns)
    for target in range(2 * (na + ns)):
        d, sign = target // 2, 2.0 * (target % 2) - 1.0
        if d >= na and options[d - na] == 1:
            continue
        U[:] = 0.0
        for e in range(ne if d < na else 0):
            U[of[e]] += sign * choice.effort[d, e] * choice.direction[e]
        if d >= na:
            U[d - na] = sign
        height, best, bound[0] = 1, -np.inf, np.inf
        nodes[0] = np.where(options == 1, SLIDES, _BETWEEN)
        while height > 0:
            height -= 1
            if not bound[height] > best:
                continue
            node = nodes[height].copy()
            if solved == search.choice.most[2]:
                return False
            gains = np.zeros(node.size)
            known = _guess(search, i, node, U, gains)
            if not known:
                return False
            _evaluate(search, i, -1, 0)
            if _has_failed(search, i):
                return False
            solved, value = solved + 1, (U * choice.x[0]).sum()
            best, greatest = max(best, value), value + gains.sum()
            if greatest > best + 1e-12 * max(abs(best), abs(value)):
                s = np.argmax(gains)
                for here in range(2):
                    # where nothing is to gain, the guess is right
                    nodes[height] = np.where(gains > 0.0, node, choice.code)
                    nodes[height, s] = choice.code[s] if here else LOWER + UPPER - choice.code[s]
                    bound[height] = greatest
                    height += 1
    return True


@kernel
def _guess(search: EndTables, i: int, node: np.ndarray, U: np.ndarray, gains: np.ndarray) -> bool:
    """Guess the limits of a node (ns,) where U times the friction is greatest.

    Args:
        gains: (ns,) the most that each other limit gains, overwritten.

    Returns:
        Whether the bounds hold.
    """
    choice, law = search.choice, search.law
    ends = np.empty((4, node.size))
    for s in range(node.size):
        site = search.island.site[s]
        for side in range(2):
            code = LOWER + side if node[s] == _BETWEEN else node[s]
            ends[2 * side, s] = -law.way[code, i, site] * law.mu[code, i, site]
            ends[2 * side + 1, s] = -law.way[code, i, site] * law.coulomb[code, i, site]
    limits = Limits(ends[0], ends[1], ends[2], ends[3])
    slopes = Slopes(np.empty(node.size), np.empty(node.size), np.empty(node.size))
    given = choice.along, search.island.owner, choice.constant, limits, U, slopes
    known = bound_slopes(*given)
    for s in range(node.size):
        choice.code[s] = node[s]
        if node[s] == _BETWEEN:
            up = slopes.least[s] + slopes.greatest[s] > 0.0
            choice.code[s] = UPPER if up else LOWER
            gains[s] = slopes.width[s] * max(-slopes.least[s] if up else slopes.greatest[s], 0.0)
    return known


@kernel
def _flip(search: EndTables, i: int, drive: int, side: int) -> None:
    """EndTables an end by switching one site at a time, while that helps."""
    island, choice, sign = search.island, search.choice, 2.0 * side - 1.0
    ball, options, code = island.ball, choice.options, choice.code
    for e in range(island.of.size):  # from where it is if no load depends on friction
        s = island.of[e]
        up = sign * choice.effort[drive, e] > 0.0 and options[s] > 1 and not ball[s]
        code[s] = _code(ball[s], options[s], 1 if up else 0)
    best = _evaluate(search, i, drive, side)
    while not _has_failed(search, i):
        top, where, flipped = -np.inf, 0, 0
        for s in range(code.size):
            kept = code[s]
            for n in range(_count(ball[s], options[s])):
                code[s] = _code(ball[s], options[s], n)
                if code[s] != kept:
                    value = _evaluate(search, i, drive, side)
                    if value > top:
                        top, where, flipped = value, s, code[s]
            code[s] = kept
        if not top - best > 1e-12 * abs(best):
            return
        best, code[where] = top, flipped
