"""Friction, efforts and their ends where reactions depend on friction.

Everything except the friction law is affine in friction (`effort_maps.Maps`), so each sample is a
small coupled problem (`given_modes`). Sites that stick, or reverse next to a sample, have several
possible frictions; the ends of efforts are where each site is at one of its limits. A *candidate*
is a sample with one such choice; the kernel solves lists of them. Up to `ENUMERATED` choices of a
sample all are candidates. Beyond that, branch and bound finds the ends (`sign_bounds`). Where it
cannot, or a choice may have several solutions, one site at a time is switched to its other limit
while the effort still grows: the sample is `searched`. The limit of a ball is a sphere: its
friction is turned until it points in the direction in which the effort grows fastest. The search of
a sample ends if it jams; if its candidates took `MOST_PASSES` in total, it is `NOT_CONVERGED`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from pinfric.dynamics.inverse.choices import (
    LOWER,
    NONE,
    SLIDES,
    UPPER,
    Candidates,
    friction_laws,
    friction_slopes,
    loads_of_samples,
    solve_list,
)
from pinfric.dynamics.inverse.effort_maps import Maps
from pinfric.dynamics.inverse.sign_bounds import Limits, contracts, slope_bounds
from pinfric.dynamics.problem.plan import Plan
from pinfric.dynamics.samples.outcome import Status
from pinfric.friction.given_modes import MOST_SOLUTIONS, Reduced, reduce_problem
from pinfric.friction.problem import empty_problem
from pinfric.friction.several import distinct, from_many_starts
from pinfric.kernels.arrays import array, make

#: Choices of one sample that are all looked at: 2^12, with a ball 2^8. Its nodes of branch and
#: bound, those of all ends together.
ENUMERATED, ENUMERATED_BALLS, NODES = 4096, 256, 4096
#: Passes of Newton's method for one sample, all its candidates together: about a second. The last
#: call begins below it, and its searches from many starts may take as many again.
MOST_PASSES = 100_000
#: Statuses without efforts: nothing more is looked for.
_FAILED = (Status.JAMMED, Status.NOT_CONVERGED, Status.SINGULAR)
#: Candidates of one call of which more solutions are looked for.
_MOST_SEARCHED = 100
#: Candidates per call of the kernel.
_AT_ONCE = 1 << 14
#: Turns of a ball's friction until it stays, and what counts as staying.
_TURNS, _STAYS = 60, 1e-12
#: Code of a site in a node of branch and bound that is anywhere between its limits.
_BETWEEN = -1


class Ends(NamedTuple):
    """The results of n samples so far.

    Attributes:
        lower, upper: (n, na) efforts.
        phi: (n, ne) friction while what sticks has none: the state that wrenches are given for.
        load: (n, ns) in that state.
        friction_lower, friction_upper: (n, ns) over all candidates.
        status: (n,) int8. iterations: (n,) int32. contraction: (n,), the largest.
        searched: (n,) bool: the ends are the best of single flips, so they may be too narrow.
        ends: (n, na, 2, ne) friction at each end of each effort.
    """

    lower: np.ndarray = array("n na", fill=np.inf)
    upper: np.ndarray = array("n na", fill=-np.inf)
    phi: np.ndarray = array("n ne", fill=np.nan)
    load: np.ndarray = array("n ns", fill=np.nan)
    friction_lower: np.ndarray = array("n ns", fill=np.inf)
    friction_upper: np.ndarray = array("n ns", fill=-np.inf)
    status: np.ndarray = array("n", np.int8)
    iterations: np.ndarray = array("n", np.int32)
    contraction: np.ndarray = array("n")
    searched: np.ndarray = array("n", bool)
    ends: np.ndarray = array("n na 2 ne", fill=np.nan)

    @classmethod
    def of(cls, plan: Plan, n: int) -> Ends:
        """Make the arrays for n samples, nothing known."""
        na, ns, ne = len(plan.drives.action), len(plan.sites.joint), len(plan.entries.site)
        answer: Ends = make(cls, n=n, na=na, ns=ns, ne=ne)
        return answer


class _Merged(NamedTuple):
    """One sample as a function of the friction of each site.

    Attributes:
        effort: (na, ns). contact: (nt, 1 + ns, 3), the first column without friction.
    """

    effort: np.ndarray
    contact: np.ndarray


class IntervalSearch:
    """Solves the samples of one batch; see the module's text.

    Args:
        plan, maps: see `effort_maps`.
        velocity, at_rest: see `friction_laws`.
    """

    def __init__(self, plan: Plan, maps: Maps, velocity: np.ndarray, at_rest: np.ndarray) -> None:
        self.plan, self.maps = plan, maps
        self.law = friction_laws(plan, maps, velocity, at_rest)
        ns = len(plan.sites.joint)
        self._rows = np.flatnonzero(plan.sites.varies[plan.contacts.site])
        sites = plan.contacts.site[self._rows]
        self.base = empty_problem(np.arange(ns), np.ones(ns), sites, np.zeros(ns))
        self._balls = np.flatnonzero(plan.sites.entry_count == 3)

    def ends(self) -> Ends:
        """Solve every sample."""
        n = len(self.maps.singular)
        answer = Ends.of(self.plan, n)
        answer.status[self.maps.singular] = Status.SINGULAR
        good = np.flatnonzero(~self.maps.singular)
        if len(good):
            self._reference(answer, good)
        open_ = good[(self.law.options[good] > 1).any(axis=1)]
        if len(open_):
            self._find_ends(answer, open_)
        failed = ~np.isin(answer.status, (Status.CONVERGED, Status.AMBIGUOUS))
        for found in answer:
            if found.dtype == float and found is not answer.contraction:
                found[failed] = np.nan
        answer.searched[failed] = False
        return answer

    def candidates(
        self, sample: np.ndarray, code: np.ndarray, direction: np.ndarray | None = None
    ) -> Candidates:
        """Solve the given samples with the given codes (m, ns); directions (m, ne) of the law."""
        out = self.unsolved(sample, code, direction)
        if code.shape[1] > 0:  # else nothing rubs, and that is the solution
            self._solve_candidates(out)
            self._complete(out)
        return out

    def unsolved(
        self, sample: np.ndarray, code: np.ndarray, direction: np.ndarray | None = None
    ) -> Candidates:
        """Return candidates before they are solved; see `candidates`."""
        m, ns = code.shape
        direction = self.law.direction[sample] if direction is None else direction
        x, figures = np.zeros((m, MOST_SOLUTIONS, ns)), np.zeros((m, 2))
        return Candidates(sample, code, direction, x, np.ones(m, dtype=np.int64), figures)

    def _solve_candidates(self, c: Candidates) -> None:
        solve_list(self.maps.contact, self._rows, self.plan.entries.site, self.base, self.law, c)

    def _complete(self, c: Candidates) -> None:
        """Look for more solutions of candidates whose contraction allows them: from many starts.

        Of `_MOST_SEARCHED` candidates at most, and of a sample until it comes to its bound.
        """
        doubtful = (c.figures[:, 0] >= 1.0) & (c.found < 2)
        spent = np.bincount(c.sample, c.figures[:, 1])
        for i in np.flatnonzero(doubtful)[:_MOST_SEARCHED].tolist():
            if spent[c.sample[i]] > MOST_PASSES:
                continue
            reduced, way = self.reduced(Candidates(*(field[i : i + 1] for field in c)))
            found, passes = from_many_starts(reduced, way)
            c.figures[i, 1] += passes
            spent[c.sample[i]] += passes
            every = distinct(found)[:MOST_SOLUTIONS]
            if len(every) > c.found[i]:
                c.x[i, : len(every)], c.found[i] = every, len(every)

    def reduced(self, one: Candidates) -> tuple[Reduced, np.ndarray]:
        """Return what `given_modes` solves for one candidate, which it solves on the way.

        Returns:
            The problem in the frictions that follow loads; (ns,) the direction of each site's slip.
        """
        self._solve_candidates(one)  # writes the problem of the last candidate
        way = self.law.way[one.code[0], one.sample[0], np.arange(one.code.shape[1])]
        nobody = np.zeros(len(way), dtype=bool)
        return reduce_problem(self.base, nobody, way, np.empty((0, 3)))[1], way

    def _phi(self, c: Candidates, solution: int) -> np.ndarray:
        """(m, ne) friction coordinates of one of the solutions."""
        return np.asarray(c.x[:, solution][:, self.plan.entries.site] * c.direction)

    def _reference(self, answer: Ends, good: np.ndarray) -> None:
        """Solve the state that wrenches are given for, and all of a sample that only slides."""
        plan = self.plan
        c = self.candidates(good, self.law.code[good])
        self._note(answer, c)
        some = c.found > 0
        phi = self._phi(c, 0)
        answer.phi[good[some]] = phi[some]
        load = np.empty((len(good), len(plan.sites.joint)))
        loads_of_samples(
            self.maps.contact[good], plan.contacts.site, plan.sites.constant, phi, load
        )
        answer.load[good[some]] = load[some]
        slides = (self.law.options[good] == 1).all(axis=1)
        self._widen(answer, c._replace(found=np.where(slides, c.found, 0)), np.arange(0), -1, 0)

    def _note(self, answer: Ends, c: Candidates) -> None:
        """Let the outcomes of candidates worsen their samples' statuses."""
        several = c.sample[c.found > 1]
        several = several[answer.status[several] == Status.CONVERGED]
        answer.status[several] = Status.AMBIGUOUS
        answer.status[c.sample[c.found < 0]] = Status.NOT_CONVERGED
        answer.status[c.sample[c.found == 0]] = Status.JAMMED
        np.add.at(answer.iterations, c.sample, c.figures[:, 1].astype(np.int32))
        np.maximum.at(answer.contraction, c.sample, c.figures[:, 0])

    def _widen(
        self, answer: Ends, c: Candidates, free: np.ndarray, drive: int, side: int
    ) -> np.ndarray:
        """Let solutions widen the ends of their samples; see `_evaluate`."""
        sign, columns = (1.0 if side else -1.0), self.plan.sites.first_entry[free]
        value = np.full(len(c.sample), -sign * np.inf)
        for solution in range(int(c.found.max(initial=0))):
            has = np.flatnonzero(c.found > solution)
            sample, phi = c.sample[has], self._phi(c, solution)[has]
            least, most = self._free_limits(sample, free)
            maps = self.maps.effort[sample]
            for up, ends in enumerate((answer.lower, answer.upper)):
                chosen = np.repeat(phi[:, None], maps.shape[1], axis=1)  # (m, na, ne)
                grows = (maps[:, :, 1 + columns] > 0) == bool(up)
                chosen[:, :, columns] = np.where(grows, most[:, None], least[:, None])
                effort = maps[:, :, 0] + np.einsum("mdk,mdk->md", maps[:, :, 1:], chosen)
                self._take(answer, sample, effort, chosen, ends, up)
                if drive >= 0 and up == side:
                    value[has] = sign * np.maximum(sign * value[has], sign * effort[:, drive])
            self._widen_friction(answer, sample, c.x[has, solution])
            answer.friction_lower[np.ix_(sample, free)] = least
            answer.friction_upper[np.ix_(sample, free)] = most
        return value

    def _take(
        self,
        answer: Ends,
        sample: np.ndarray,
        effort: np.ndarray,
        phi: np.ndarray,
        ends: np.ndarray,
        side: int,
    ) -> None:
        """Let efforts (m, na) of one side be new ends where they reach beyond the present."""
        sign = 1.0 if side else -1.0
        for drive in range(effort.shape[1]):
            order = np.argsort(sign * effort[:, drive], kind="stable")  # the best comes last
            best = order[sign * effort[order, drive] > sign * ends[sample[order], drive]]
            ends[sample[best], drive] = effort[best, drive]
            answer.ends[sample[best], drive, side] = phi[best, drive]

    def _widen_friction(self, answer: Ends, sample: np.ndarray, x: np.ndarray) -> None:
        low = x.copy()
        sticking = self.law.options[sample] > 1
        for s in self._balls:  # any direction of the sphere
            low[:, s] = np.where(sticking[:, s], -np.abs(x[:, s]), x[:, s])
        np.minimum.at(answer.friction_lower, sample, low)
        np.maximum.at(answer.friction_upper, sample, x)

    def _find_ends(self, answer: Ends, open_: np.ndarray) -> None:
        """Find the ends of efforts where something sticks or reverses, samples alike together."""
        free = self._free()
        patterns, group = np.unique(self.law.options[open_], axis=0, return_inverse=True)
        for p, pattern in enumerate(patterns):
            samples = open_[group.ravel() == p]
            choosing = np.flatnonzero((pattern > 1) & ~free)
            free_here = np.flatnonzero((pattern > 1) & free)
            balls = np.intersect1d(choosing, self._balls)
            options = [_options(int(pattern[s]), s in balls) for s in choosing]
            count = math.prod(map(len, options))
            if count <= (ENUMERATED_BALLS if len(balls) else ENUMERATED):
                samples = self._enumerate(answer, samples, choosing, options, free_here, balls)
            elif not len(balls) and (pattern[choosing] == 2).all():
                samples = self._branch(answer, samples, choosing, free_here)
            if len(samples):
                self._flip(answer, samples, choosing, options, free_here, balls)
            answer.searched[samples] = True

    def _enumerate(
        self,
        answer: Ends,
        samples: np.ndarray,
        choosing: np.ndarray,
        options: list[tuple[int, ...]],
        free: np.ndarray,
        balls: np.ndarray,
    ) -> np.ndarray:
        """Solve all combinations of limits; return the samples of which it would take too long."""
        combinations, left = np.array(list(product(*options)), dtype=np.int64), [np.arange(0)]
        for part in _slices(len(samples), max(1, _AT_ONCE // len(combinations))):
            active = samples[part]
            for block in _slices(len(combinations), ENUMERATED_BALLS):
                chosen = combinations[block]
                sample = np.repeat(active, len(chosen))
                code = self.law.code[sample]
                code[:, free] = NONE
                code[:, choosing] = np.tile(chosen, (len(active), 1))
                if len(balls):
                    for drive, side in np.ndindex(answer.lower.shape[1], 2):
                        self._evaluate(answer, sample, code, free, balls, drive, side)
                else:
                    self._evaluate(answer, sample, code, free, balls, -1, 0)
                if len(combinations) > ENUMERATED_BALLS:
                    several = answer.contraction[active] >= 1.0
                    left.append(active[several])
                    active = active[~several]
        return np.concatenate(left)

    def _branch(
        self, answer: Ends, samples: np.ndarray, choosing: np.ndarray, free: np.ndarray
    ) -> np.ndarray:
        """Find the ends by branch and bound on signs; return the samples in which it gives up.

        A node has some sites at a limit and the others anywhere between. Its guess has these at the
        limits that `slope_bounds` suggests; it is split at the site whose other limit may gain
        most.
        """
        left = []
        for sample in samples.tolist():
            root = self.law.code[sample].copy()
            root[free], root[choosing] = NONE, _BETWEEN
            merged = self._merged(sample)
            ends = np.vstack([merged.effort, np.eye(len(root))[choosing]])
            owner = self.plan.contacts.site[self._rows]
            solved = 0 if contracts(merged.contact, owner, self._limits(sample, root)) else NODES
            for target in np.concatenate([ends, -ends]):
                nodes, best = root[None], -np.inf
                while len(nodes) and solved < NODES:
                    judged = [self._judge(sample, merged, node, target) for node in nodes]
                    c = self.candidates(
                        np.full(len(nodes), sample), np.array([guess for guess, _ in judged])
                    )
                    gains = np.array([gain for _, gain in judged])
                    self._note(answer, c)
                    solved = NODES if (c.found != 1).any() else solved + len(nodes)
                    self._widen(answer, c, free, -1, 0)
                    value = c.x[:, 0] @ target
                    best = max(best, float(value.max()))
                    most = value + gains.sum(axis=1)
                    open_ = most > best + 1e-12 * max(abs(best), np.abs(value).max())
                    nodes = _split(nodes[open_], c.code[open_], gains[open_])
            if solved >= NODES:
                left.append(sample)
        return np.array(left, dtype=np.int64)

    def _merged(self, sample: int) -> _Merged:
        """Efforts and varying contact forces of one sample as functions of each site's friction."""
        along, ns = self.law.direction[sample], len(self.plan.sites.joint)
        to_site = np.zeros((len(along), ns))
        to_site[np.arange(len(along)), self.plan.entries.site] = along
        contact, effort = self.maps.contact[sample, self._rows], self.maps.effort[sample]
        slopes = np.einsum("tje,js->tse", contact[:, 1:], to_site)
        return _Merged(effort[:, 1:] @ to_site, np.concatenate([contact[:, :1], slopes], axis=1))

    def _judge(
        self, sample: int, merged: _Merged, node: np.ndarray, target: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the guess of a node, (ns,) codes, and (ns,) the most that each other limit gains.

        Args:
            sample, merged: see `_merged`.
            node: (ns,) codes.
            target: (ns,) change with each friction of what shall be great.
        """
        least, greatest, width = slope_bounds(
            merged.contact,
            self.plan.contacts.site[self._rows],
            self.law.constant[sample],
            self._limits(sample, node),
            target,
        )
        between = node == _BETWEEN
        up = least + greatest > 0.0
        guess = np.where(between, np.where(up, UPPER, LOWER), node)
        gain = width * np.maximum(np.where(up, -least, greatest), 0.0)
        return guess, np.where(between, gain, 0.0)

    def _limits(self, sample: int, node: np.ndarray) -> Limits:
        """Friction of each site of a node as a function of its load."""
        between, sites, limits = node == _BETWEEN, np.arange(len(node)), []
        for code in (np.where(between, LOWER, node), np.where(between, UPPER, node)):
            way = self.law.way[code, sample, sites]
            limits += [
                -way * table[code, sample, sites] for table in (self.law.mu, self.law.coulomb)
            ]
        return Limits(*limits)

    def _free(self) -> np.ndarray:
        """(ns,) sites whose friction changes no load, their own included: each end picks theirs."""
        plan = self.plan
        moved = np.abs(self.maps.contact[:, self._rows, 1:][~self.maps.singular]).max(
            axis=(0, 1, 3), initial=0.0
        )
        changes = np.zeros(len(plan.sites.joint), dtype=bool)
        np.logical_or.at(changes, self.plan.entries.site, moved > 0)
        return np.asarray(~changes & ~plan.sites.varies & (plan.sites.entry_count == 1))

    def _free_limits(self, sample: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(m, number of free sites) least and greatest friction where loads are fixed."""
        law, load = self.law, self.law.constant[sample][:, free]

        def friction(code: int) -> np.ndarray:
            way, mu, dry = (
                array[code][sample][:, free] for array in (law.way, law.mu, law.coulomb)
            )
            return np.asarray(-way * (mu * load + dry))

        least, most, slides = friction(LOWER), friction(UPPER), friction(SLIDES)
        reverses = law.options[sample][:, free] == 3
        return (
            np.where(reverses, np.minimum(least, slides), least),
            np.where(reverses, np.maximum(most, slides), most),
        )

    def _evaluate(
        self,
        answer: Ends,
        sample: np.ndarray,
        code: np.ndarray,
        free: np.ndarray,
        balls: np.ndarray,
        drive: int,
        side: int,
    ) -> np.ndarray:
        """Solve candidates, let them widen the ends, and return one effort (m,) of each.

        Args:
            answer: widened.
            sample, code: (m,), (m, ns).
            free: sites that each end picks the friction of.
            balls: sites whose direction is turned towards one end: `drive`, `side` (0 lower);
                where they slide it stays.
        """
        value = np.full(len(sample), -np.inf if side else np.inf)
        here = np.flatnonzero(self._goes_on(answer, sample))
        if not len(here):
            return value
        c = self.candidates(sample[here], code[here])
        if len(balls):
            self._turn(answer, c, balls, drive, side)
        self._note(answer, c)
        value[here] = self._widen(answer, c, free, drive, side)
        return value

    def _goes_on(self, answer: Ends, sample: np.ndarray) -> np.ndarray:
        """(m,) whether a sample may have ends yet, and came not to its bound."""
        failed = np.isin(answer.status[sample], _FAILED)
        over = answer.iterations[sample] > MOST_PASSES
        answer.status[sample[over & ~failed]] = Status.NOT_CONVERGED
        return np.asarray(~(failed | over))

    def _turn(self, answer: Ends, c: Candidates, balls: np.ndarray, drive: int, side: int) -> None:
        """Turn the balls' friction of each candidate until it stays, or its sample is at its bound.

        Args:
            answer: what was spent before.
            c: overwritten; of passes, the sum over all turns.
            balls, drive, side: see `_evaluate`.
        """
        turning = np.arange(len(c.sample))
        for _ in range(_TURNS):
            if not len(turning):
                return
            before = Candidates(*(array[turning] for array in c))
            direction = self._turned(before, balls, drive, side)
            turned = self.candidates(before.sample, before.code, direction)
            turned.figures[:, 1] += before.figures[:, 1]
            for whole, part in zip(c, turned, strict=True):
                whole[turning] = part
            passes = np.bincount(c.sample, c.figures[:, 1], len(answer.iterations))
            within = (answer.iterations + passes)[before.sample] <= MOST_PASSES
            turn = np.abs(direction - before.direction).max(axis=1, initial=0.0)
            c.found[turning[(turn >= _STAYS) & ~within]] = -1
            turning = turning[(turn >= _STAYS) & within]

    def _turned(self, c: Candidates, balls: np.ndarray, drive: int, side: int) -> np.ndarray:
        """(m, ne) directions in which the balls' friction moves one effort most.

        With x = gain load(phi) and phi = D x, a small change delta of phi changes the effort by
        g delta, g = U + U D (I - L D)^-1 L: at the extreme every ball's friction points along g.
        """
        plan, (m, ne) = self.plan, c.direction.shape
        ns = len(plan.sites.joint)
        L = np.zeros((m, ns, ne))
        friction_slopes(self.maps.contact, plan.contacts.site, self.law, c, self._phi(c, 0), L)
        D = np.zeros((m, ne, ns))
        D[:, np.arange(ne), self.plan.entries.site] = c.direction
        U = self.maps.effort[c.sample, drive, 1:]
        g = U.copy()
        inner = np.eye(ns) - L @ D
        usable = np.abs(np.linalg.det(inner)) > 1e-12
        right = np.einsum("mks,mk->ms", D[usable], U[usable])[:, :, None]
        through = np.linalg.solve(inner[usable].transpose(0, 2, 1), right)
        g[usable] += np.einsum("ms,msk->mk", through[:, :, 0], L[usable])
        g *= 1.0 if side else -1.0
        direction = c.direction.copy()
        for s in balls:
            part = slice(plan.sites.first_entry[s], plan.sites.first_entry[s] + 3)
            size = np.linalg.norm(g[:, part], axis=1, keepdims=True)
            turns = (size > 0) & (c.code[:, [s]] == UPPER)
            direction[:, part] = np.where(
                turns, g[:, part] / np.maximum(size, 1e-300), direction[:, part]
            )
        return direction

    def _flip(
        self,
        answer: Ends,
        samples: np.ndarray,
        choosing: np.ndarray,
        options: list[tuple[int, ...]],
        free: np.ndarray,
        balls: np.ndarray,
    ) -> None:
        """Search each end by changing one site's friction at a time, while that helps."""
        columns, turns = self.plan.sites.first_entry[choosing], np.isin(choosing, balls)
        flips = np.array([(s, o) for s, some in zip(choosing, options, strict=True) for o in some])
        for drive, side in np.ndindex(answer.lower.shape[1], 2):
            sign = 1.0 if side else -1.0
            code = self.law.code[samples]
            code[:, free] = NONE
            # from where it would be if no load depended on friction
            grows = sign * self.maps.effort[samples, drive][:, 1 + columns] > 0
            code[:, choosing] = np.where(grows | turns, UPPER, LOWER)
            best = self._evaluate(answer, samples, code, free, balls, drive, side)
            active = np.arange(len(samples))
            while len(active := active[self._goes_on(answer, samples[active])]):
                trials = np.repeat(code[active][:, None], len(flips), axis=1)
                trials[:, np.arange(len(flips)), flips[:, 0]] = flips[:, 1]
                shape = trials.shape[:2]
                value = self._evaluate(
                    answer,
                    np.repeat(samples[active], len(flips)),
                    trials.reshape(-1, trials.shape[2]),
                    free,
                    balls,
                    drive,
                    side,
                ).reshape(shape)
                top = np.argmax(sign * value, axis=1)
                value = value[np.arange(len(active)), top]
                better = sign * (value - best[active]) > 1e-12 * np.abs(best[active])
                code[active[better]] = trials[better, top[better]]
                best[active[better]] = value[better]
                active = active[better]


def _options(choices: int, is_ball: bool) -> tuple[int, ...]:
    """Codes among which an end chooses at a site; a ball's limit is one, turned any way."""
    return (UPPER, SLIDES)[: choices - 1] if is_ball else (LOWER, UPPER, SLIDES)[:choices]


def _split(nodes: np.ndarray, guesses: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Return two nodes of each: one site at its lower limit, and at its upper one."""
    fixed = np.where(gains > 0.0, nodes, guesses)  # where nothing is to gain, the guess is right
    halves, site = np.repeat(fixed, 2, axis=0), np.repeat(np.argmax(gains, axis=1), 2)
    halves[np.arange(len(halves)), site] = np.tile([LOWER, UPPER], len(nodes))
    return halves


def _slices(total: int, size: int) -> Iterator[slice]:
    for start in range(0, total, size):
        yield slice(start, min(start + size, total))
