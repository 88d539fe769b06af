"""The search for modes: which coordinates stick and which slip (Wu, Yang, Haug 1984).

At rest stick has priority: a coordinate slips only if no admissible stick exists. So the search is
for the consistent modes with the fewest slipping joints. Two different accelerations with equally
few slipping joints are ambiguous, unless exactly one of them lets all joints stick that were
sticking until now. Joints that do not depend on each other are searched apart (`islands`). Of up to
`MOST_ENUMERATED` joints at rest all modes that kinematics allows are tried (`PossibleWays`). Beyond
that, modes are followed from all stick: others may exist.

A search ends after `MOST_PASSES` passes of its solves; it is then `UNDECIDED`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np

from pinfric.friction.balance import FITS, RANK
from pinfric.friction.certificate import Ball, kinetic
from pinfric.friction.gears import (
    choices_of_lines,
    fit,
    is_certain,
    lasts_under_loads,
    lines_and_rows,
)
from pinfric.friction.given_modes import SHOULD_STICK, judge
from pinfric.friction.islands import split
from pinfric.friction.law import evaluate
from pinfric.friction.minimax import least_violation
from pinfric.friction.problem import Modes, Problem, SearchOutcome
from pinfric.friction.rest import Mechanism, solve_modes
from pinfric.friction.several import find_all
from pinfric.friction.smoothing import guess_modes

#: A rate this small beside the terms of its sum counts as zero.
_ROUNDING = 1e-7
#: A rate of a mechanism that stands, with all |w| <= 1, below this is none.
_STILL = 1e-3 * RANK
#: Accelerations looked at, so many times those without friction; and of a mechanism that stands.
_FAR = 1e9

Ways = dict[int, float]


class PossibleWays:
    """The combinations of slip directions that kinematics allows, out of 3^n for n joints at rest.

    Relative accelerations are r = c + A^T w with any w (d,), so the ways are the faces that n
    planes form in d dimensions (Zaslavsky 1975): three for a four-bar's pins, not 3^4.

    Args:
        at_rest: (nc,) bool.
    """

    def __init__(self, problem: Problem, mechanism: Mechanism, at_rest: np.ndarray) -> None:
        self.mechanism, self.at_rest = mechanism, at_rest
        self.free = not mechanism.is_dependent(at_rest)  # each slips or sticks whatever others do
        if self.free:
            return
        size = np.linalg.norm(mechanism.factor, axis=0)
        self.A = mechanism.normalized().T
        scale = np.where(size > 0.0, size, 1.0)
        self.c = problem.rate_free / scale
        terms = (problem.rate_scale / scale)[at_rest].max(initial=0.0)
        here = self.A[at_rest]
        self.c[at_rest] -= here @ np.linalg.lstsq(here, self.c[at_rest], rcond=RANK)[0]
        self.rounding = _ROUNDING * terms + 1e-300
        self.stands = bool((np.abs(self.c[at_rest]) <= self.rounding).all())

    def ways(self, others: list[int], level: int, forced: Ways) -> Iterator[Ways]:
        """Yield the ways in which `level` of the other joints can slip: coordinate -> direction.

        Args:
            others: joints at rest, by their first coordinates; the rest of them sticks.
            level: how many slip.
            forced: how others do that slip in any case.
        """
        ball = self.mechanism.ball
        for slipping in combinations(others, level):
            if self.free:
                for signs in product(*[(1.0,) if ball[c] else (1.0, -1.0) for c in slipping]):
                    yield dict(zip(slipping, signs, strict=True))
                continue
            start, N = self._left(slipping, forced)
            if N is not None:
                yield from self._signs(list(slipping), start, N, forced)

    def _left(
        self, slipping: tuple[int, ...], forced: Ways
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """The w that let all others rest, start + N y; N is None where there is none."""
        block = self.mechanism.block
        moves = np.isin(block, [block[c] for c in (*slipping, *forced)])
        stuck = self.at_rest & ~moves
        rows = self.A[stuck]
        left, size, right = np.linalg.svd(rows)
        rank = int((size > RANK).sum())
        start = -right[:rank].T @ (left[:, :rank].T @ self.c[stuck] / size[:rank])
        if not self.stands and (np.abs(rows @ start + self.c[stuck]) > self.rounding).any():
            return start, None
        return start, right[rank:].T

    def _signs(
        self, slipping: list[int], start: np.ndarray, N: np.ndarray, forced: Ways
    ) -> Iterator[Ways]:
        """Yield the directions of what slips, one joint's after the other's."""
        fixed = [c for c in forced if not self.mechanism.ball[c]]
        rows = {c: (self.A[c] @ N, float(self.A[c] @ start + self.c[c])) for c in slipping + fixed}
        if self.stands:  # what does not move along would stick as well
            for c in slipping:
                here = self.mechanism.block == self.mechanism.block[c]
                if not (np.abs(self.A[here] @ N) > RANK).any():
                    return
        order = [c for c in slipping if not self.mechanism.ball[c]]
        balls = {c: 1.0 for c in slipping if self.mechanism.ball[c]}
        waiting: list[Ways] = [{}]
        while waiting:
            ways = waiting.pop()
            if not self._possible(rows, {c: forced[c] for c in fixed}, ways):
                continue
            if len(ways) == len(order):
                yield {**balls, **ways}
                continue
            c = order[len(ways)]
            waiting += [{**ways, c: -1.0}, {**ways, c: 1.0}]

    def _possible(
        self, rows: dict[int, tuple[np.ndarray, float]], weakly: Ways, ways: Ways
    ) -> bool:
        """Whether joints can move in these ways at once; those of the others may stand, too."""
        every = {**ways, **weakly}
        size = next(iter(rows.values()))[0].size if rows else 0
        if not every:
            return True
        G = np.array([-way * rows[c][0] for c, way in every.items()])
        h = np.array([-way * rows[c][1] for c, way in every.items()])
        if self.stands:
            h[:] = 0.0
        if size == 0:
            return bool((h <= self.rounding).all())
        s = np.ones(len(every))
        if not self.stands:
            reach = _FAR * (np.abs(h).max() + self.rounding)
            return bool(least_violation(G, h, s, len(h), reach, np.empty(size)) <= self.rounding)
        if not ways:
            return True
        h[len(ways) :], s[len(ways) :] = -_STILL, _STILL  # G z <= _STILL (1 + m), never below 0
        return bool(least_violation(G, h, s, len(h), 1.0, np.empty(size)) < -RANK)


#: Up to this number of joints at rest all modes are tried: 3^8 = 6561 solves.
MOST_ENUMERATED = 8
#: All modes of up to so many joints are tried in less time than the ball of their answers takes.
_FEW = 2
#: Passes of all solves of a search, a few seconds once compiled. A solve takes one pass in an open
#: chain, three in a mechanism, more where friction is shared.
MOST_PASSES = 20_000
#: Accelerations closer than this, relative to their size, are the same one.
_SAME = 1e-6
#: Outcomes of a search that found no answer.
_NOTHING = SearchOutcome.NONE, SearchOutcome.NOT_CONVERGED
#: Outcomes from the best to the worst; that of several searches is their worst.
_GRAVITY = (
    SearchOutcome.SOLVED,
    SearchOutcome.UNSTABLE,
    SearchOutcome.AMBIGUOUS,
    SearchOutcome.UNDECIDED,
    SearchOutcome.NOT_CONVERGED,
    SearchOutcome.NONE,
)
#: Passes of the search: a constant, and a number per coordinate.
_CHANGES, _FOR_EACH = 60, 20
#: How often all wrong modes may change at once without fewer of them than ever before.
_PATIENCE = 10
#: A ball's direction that turns by no more than this stays.
_TURNED = 1e-8
#: How often several balls take turns, and then steps of Newton's method over all.
_SWEEPS, _NEWTON = 10, 20
#: Passes after which a ball that would stick does.
_TRANSIENT = 10


class Answer(NamedTuple):
    """A solution that obeys the laws, with its friction; see `gears.py` for which are stable."""

    modes: Modes
    stable: bool = True


@dataclass
class SearchStatistics:
    """What a search counted.

    Attributes:
        many: how many answers, and how many of them are stable; 0 where one was found and others
            may exist.
        tried: in how many modes it looked for them.
        unsure: whether gears allow more choices than are tried, so that there may be others.
        island: (n,) coordinates of the island that decided the outcome; none: all did.
    """

    many: tuple[int, int] = (1, 1)
    tried: int = 1
    unsure: bool = False
    island: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def of_one_mode(self, solutions: int, obeying: int) -> SearchOutcome:
        """Return how a search of a single mode ends, from what `rest.solve_modes` returns."""
        self.many, self.tried, self.unsure = (obeying, obeying), 1, False
        self.island = self.island[:0]
        return outcome_of(solutions, obeying)


class _Query:
    """A search: its problem, the solver of given modes, and the remaining passes.

    Attributes:
        problem, modes, mechanism: see `search`.
        count: what is counted.
        answers: those in the modes solved last, if gears may have several; else empty.
        left: passes.
        every: whether all solutions of given modes are wanted, where there may be several.
        unsure: whether the search for all solutions of some modes reached its limit.
        proved: whether the answer found is known to be the only one.
    """

    def __init__(
        self,
        problem: Problem,
        modes: Modes,
        mechanism: Mechanism,
        count: SearchStatistics,
        every: bool,
    ) -> None:
        self.every, self.left, self.unsure, self.proved = every, MOST_PASSES, False, True
        self.problem, self.modes, self.mechanism = problem, modes, mechanism
        self.count, self.answers = count, list[Answer]()
        count.many, count.tried, count.unsure = (0, 0), 0, False

    def answer(self) -> tuple[int, int]:
        """Solve the modes as they are, all solutions of them if wanted; see `rest.solve_modes`."""
        self.answers, m = [], self.modes
        counts = solve_modes(self.problem, m, self.mechanism)
        moves = not m.stuck[self.problem.gear_coordinate].all()
        several = moves and m.figures[0] >= 1.0  # of those found some are off their lines
        if m.effort.size and (counts[0] < 0 or several or not is_certain(self.problem, m)):
            counts = self._on_every_line()
        shared = np.isnan(m.figures[0])
        self.left -= max(3 * self.mechanism.closed, int(m.figures[1]) if shared else 1)
        return self._all(counts) if self.every and m.figures[0] >= 1.0 else counts

    def _on_every_line(self) -> tuple[int, int]:
        """Solve the modes on every line of gears that may fit; `answers` are theirs."""
        m, solved = self.modes, list[Answer]()
        every = choices_of_lines(self.problem, m)
        self.count.unsure |= every is None
        for efforts, stable in every or ():
            m.effort[:] = efforts
            lines = lines_and_rows(self.problem, m)[0]
            solutions, obeying = solve_modes(self.problem, m, self.mechanism, chosen=True)
            if solutions > 0 and not any(_same(m, one.modes) for one in solved):
                lasts = lasts_under_loads(self.problem, m, lines[:, 0])
                solved.append(Answer(m.copy(), stable if lasts is None else lasts))
                self.answers += solved[-1:] * obeying
        if solved:
            self._take(max(self.answers or solved, key=lambda answer: answer.stable))
        return len(solved), len(self.answers)

    def _take(self, answer: Answer) -> None:
        """Make an answer the present one."""
        self.modes.take(answer.modes)
        solve_modes(self.problem, self.modes, self.mechanism, chosen=True)

    def end(self, solutions: int, obeying: int) -> SearchOutcome:
        """Return how the search ends with the modes just solved; the answer is the present one."""
        if self.answers:
            return self.choose(list(self.answers))
        self.count.many = obeying, obeying
        return self.sure(outcome_of(solutions, obeying))

    def sure(self, outcome: SearchOutcome) -> SearchOutcome:
        """Return how the search ends, where what it may have missed would change that."""
        unsure = self.count.unsure and outcome == SearchOutcome.NONE
        unsure |= outcome == SearchOutcome.SOLVED and (self.unsure or self.count.unsure)
        return SearchOutcome.UNDECIDED if unsure else outcome

    def choose(self, answers: list[Answer]) -> SearchOutcome:
        """Make the answer the present one: of several the only stable one."""
        stable = [answer for answer in answers if answer.stable]
        self.count.many = len(answers), len(stable)
        best = (stable or answers)[0]
        self._take(best)  # others were tried since
        if not _same(self.modes, best.modes):
            return SearchOutcome.UNDECIDED
        if len(stable) == 1:
            return SearchOutcome.SOLVED
        return SearchOutcome.AMBIGUOUS if len(answers) > 1 else SearchOutcome.UNSTABLE

    def _all(self, counts: tuple[int, int]) -> tuple[int, int]:
        """Look for solutions that Newton's method has missed; see `answer`."""
        modes, problem = self.modes, self.problem
        kept = modes.copy()
        lines, rows = lines_and_rows(problem, modes)
        every = find_all(problem, modes.stuck, modes.direction, rows)
        self.left -= every.parts
        self.unsure |= every.complete is False
        if len(every.solutions) <= counts[0]:
            return counts
        obeying = 0
        for x in every.solutions:
            modes.friction[:] = x
            evaluate(problem, modes.friction, modes.load, modes.rate)
            left, _ = fit(problem, modes, lines, True)
            if judge(problem, modes) == 0 and not left:
                obeying += 1
                kept = modes.copy()
        modes.take(kept)
        return len(every.solutions), obeying


def search(
    problem: Problem,
    modes: Modes,
    mechanism: Mechanism,
    forced: Mapping[int, float] | None = None,
    held: np.ndarray | None = None,
    count: SearchStatistics | None = None,
    follow: bool = False,
) -> SearchOutcome:
    """Find the modes of the coordinates at rest, island by island; those that move keep theirs.

    At a dead centre a joint has no velocity although the mechanism moves; it is not at rest.

    Args:
        modes: with `at_rest`, and the modes of the others, set; overwritten with the answer.
        forced: coordinate -> direction it must slip in (it has just broken away).
        held: (nc,) bool, coordinates that were sticking until now, see the module's text.
        count: overwritten with what was counted.
        follow: from the modes given, in a mechanism then from all stick, and only then all of them.

    Returns:
        The worst outcome of an island.
    """
    islands, forced = split(problem, modes, mechanism), forced or {}
    count = count or SearchStatistics()
    solve = _follow_or_search if follow else _search
    if not islands:
        count.island = np.arange(len(modes.stuck))
        return solve(problem, modes, mechanism, count, forced, held)
    ends = list[tuple[SearchOutcome, SearchStatistics, np.ndarray]]()
    for island in islands:
        ways = {k: forced[c] for k, c in enumerate(island.coordinates.tolist()) if c in forced}
        stays = None if held is None else held[island.coordinates]
        own = SearchStatistics(island=island.coordinates)
        part = island.problem, island.modes, island.mechanism
        ends.append((solve(*part, own, ways, stays), own, island.modes.figures))
        island.put_back(problem, modes, mechanism)
    if np.isnan(modes.friction).any():
        modes.friction[:1] = np.nan
    worst = max((outcome for outcome, _, _ in ends), key=_GRAVITY.index)
    those = [(own, figures) for outcome, own, figures in ends if outcome == worst]
    modes.figures[:] = np.max([figures for _, figures in those], axis=0)
    many = np.prod([own.many for own, _ in those], axis=0).tolist()
    count.many = (many[0], many[1]) if worst == SearchOutcome.SOLVED else those[0][0].many
    count.tried, count.island = those[0][0].tried, those[0][0].island
    count.unsure = any(own.unsure for own, _ in those)
    return worst


def _search(
    problem: Problem,
    modes: Modes,
    mechanism: Mechanism,
    count: SearchStatistics,
    forced: Mapping[int, float],
    held: np.ndarray | None,
) -> SearchOutcome:
    """`search` of one island."""
    query = _Query(problem, modes, mechanism, count, every=True)
    together = mechanism.is_dependent(modes.at_rest)
    passing = modes.at_rest & mechanism.idle
    if together:
        passing &= _led(problem, modes, mechanism)
    modes.at_rest[passing] = modes.stuck[passing] = False
    modes.direction[passing] = np.sign(problem.rate_free[passing])
    at_rest = modes.at_rest.copy()
    for _ in range(3):
        if together and not mechanism.is_dependent(at_rest):
            outcome = _search(problem, modes, mechanism, count, forced, held)
        else:
            outcome = _search_open(query, dict(forced), held)
        if (modes.direction[passing] * modes.rate[passing] >= 0.0).all():
            break
        modes.at_rest[:] = at_rest
        modes.direction[passing] = np.sign(modes.rate[passing])
    if outcome == SearchOutcome.SOLVED and not query.proved:
        query.count.many = 0, 0
    return query.sure(outcome)


def _led(problem: Problem, modes: Modes, mechanism: Mechanism) -> np.ndarray:
    """(nc,) bool: coordinates that move together with those not at rest."""
    A = mechanism.normalized()
    led = (np.abs(A.T @ A[:, ~modes.at_rest]) > RANK).any(axis=1)
    moves = np.abs(problem.rate_free) > FITS * problem.rate_scale  # not by rounding
    return np.asarray(led | (~A.any(axis=0) & moves))


def _search_open(query: _Query, forced: dict[int, float], held: np.ndarray | None) -> SearchOutcome:
    """Find the modes of coordinates at rest if no joint passes its dead centre; see `search`."""
    modes, mechanism = query.modes, query.mechanism
    rests, together = modes.at_rest, mechanism.is_dependent(modes.at_rest)
    if not rests.any():
        query.count.tried += 1
        return query.end(*query.answer())
    if not mechanism.closed and not forced and rests.sum() > _FEW:
        certain = _in_ball(query, held)
        if certain is not None:
            return certain
    if len(mechanism.joints(rests)) > MOST_ENUMERATED:
        return _pivot(query, forced)
    outcome = _enumerate(query, _all_ways(query, forced), forced, held)
    missed = outcome in _NOTHING and (mechanism.ball & rests).any()
    if (
        missed or outcome == SearchOutcome.UNDECIDED
    ):  # a ball's direction is searched from one start
        query.left = MOST_PASSES
        outcome = _pivot(query, forced)
        return outcome if outcome == SearchOutcome.SOLVED else SearchOutcome.UNDECIDED
    if together and forced and outcome in _NOTHING:
        # the direction of break-away was a guess: a slow joint's friction may act with the motion
        outcome = _enumerate(query, _all_ways(query, {}, fewest=1), {}, held)
    return outcome


def _in_ball(query: _Query, held: np.ndarray | None) -> SearchOutcome | None:
    """Search an open chain among the answers that its kinetic answer allows; None: nothing proved.

    See `certificate`.
    """
    problem, modes, mechanism = query.problem, query.modes, query.mechanism
    rests, limits = modes.at_rest.copy(), kinetic(problem, modes.at_rest)
    if limits is None:
        return None
    _stick(modes, mechanism, {})
    query.count.tried += 1
    solutions, obeying = query.answer()
    if modes.figures[0] >= 1.0:
        return None
    if obeying:
        return query.end(solutions, obeying)

    def follow() -> bool:
        sub = _Query(limits, modes, mechanism, SearchStatistics(), every=False)
        solved = _follow(sub, set()) == SearchOutcome.SOLVED
        query.count.tried += sub.count.tried
        return solved

    if not follow():
        return None
    ball, failed = Ball(problem, limits, centre := modes.copy(), rests), False

    def ways(sets: list[np.ndarray]) -> Iterator[Ways]:
        nonlocal failed
        for slipping in sets:
            modes.take(centre)
            moving = slipping[~centre.stuck[slipping]].tolist()
            _stick(modes, mechanism, {c: centre.direction[c] for c in moving})
            modes.at_rest[:] = False
            modes.at_rest[slipping] = True
            if (modes.stuck != centre.stuck).any() and not follow():
                failed = True
            slips, modes.at_rest[:] = not modes.stuck[slipping].any(), rests
            if slips:
                yield dict(zip(slipping.tolist(), modes.direction[slipping].tolist(), strict=True))

    if not ball.sure:
        return None
    query.every = False  # in given modes there is one solution
    outcome = SearchOutcome.NONE if ball.open.size else query.end(*query.answer())
    if outcome != SearchOutcome.SOLVED:
        outcome = _enumerate(query, (list(ways(sets)) for sets in ball.sets()), {}, held)
    query.every = True
    return None if failed or outcome in _NOTHING else outcome


def _all_ways(query: _Query, forced: Ways, fewest: int = 0) -> Iterator[list[Ways]]:
    """Yield the ways to slip that kinematics allows, with ever more joints beside the forced."""
    modes, mechanism = query.modes, query.mechanism
    others = [c for c in mechanism.joints(modes.at_rest) if c not in forced]
    possible = PossibleWays(query.problem, mechanism, modes.at_rest.copy())
    for level in range(fewest, len(others) + 1):
        yield [forced | more for more in possible.ways(others, level, forced)]


def _pivot(query: _Query, forced: dict[int, float]) -> SearchOutcome:
    """Follow modes from all stick; the answer is the only one if none breaks away beside `forced`.

    It is then the one with the fewest slipping joints.
    """
    modes = query.modes
    _stick(modes, query.mechanism, forced)
    outcome = _follow(query, set(forced))
    if outcome != SearchOutcome.SOLVED and not forced and not modes.effort.size:
        guess_modes(query.problem, modes, query.mechanism)
        modes.friction[:1], query.left = np.nan, MOST_PASSES
        outcome = _follow(query, set())
    if outcome in _NOTHING:
        return SearchOutcome.UNDECIDED  # there are modes that were not tried
    moves = query.mechanism.joints(modes.at_rest & ~modes.stuck)
    forced_to = query.mechanism.joints(np.isin(np.arange(len(modes.stuck)), [*forced]))
    query.proved &= len(moves) <= len(forced_to)
    return outcome


def _stick(modes: Modes, mechanism: Mechanism, ways: Mapping[int, float]) -> None:
    """Let everything at rest stick but the joints of coordinates that slip, in these ways."""
    modes.stuck[modes.at_rest], modes.direction[modes.at_rest] = True, 0.0
    for c, way in ways.items():
        modes.stuck[c], modes.direction[c] = False, way
        _agree(modes, mechanism, c)


def _agree(modes: Modes, mechanism: Mechanism, c: int) -> None:
    """Let the three coordinates of a ball stick or slip as one of them does."""
    if mechanism.ball[c]:
        here = mechanism.block == mechanism.block[c]
        modes.stuck[here] = modes.stuck[c]
        if modes.stuck[c]:
            modes.direction[here] = 0.0


def _enumerate(
    query: _Query, levels: Iterable[list[Ways]], forced: Ways, held: np.ndarray | None
) -> SearchOutcome:
    """Try ways to slip, those with the fewest joints beside the forced ones first.

    Where all answers of these are unstable, a joint that they let stick breaks away: more may slip.
    """
    status, unstable = SearchOutcome.NONE, list[Answer]()
    modes = query.modes
    for level in levels:
        consistent = list[Answer]()
        for ways in level:
            if query.left <= 0:
                return SearchOutcome.UNDECIDED
            _stick(modes, query.mechanism, ways)
            query.count.tried += 1
            solutions, obeying = _settle(query)
            status = SearchOutcome.NOT_CONVERGED if solutions < 0 else status
            answers = list(query.answers)
            if obeying > 1 and all(_same(answers[0].modes, one.modes) for one in answers):
                query.count.many = obeying, obeying
                return SearchOutcome.AMBIGUOUS
            for answer in answers or [Answer(modes.copy())] * (obeying == 1):
                if not any(_same(answer.modes, other.modes) for other in consistent):
                    consistent.append(answer)
        if len(consistent) > 1 and held is not None:
            stay = held & ~np.isin(np.arange(len(held)), list(forced))
            consistent = [one for one in consistent if one.modes.stuck[stay].all()] or consistent
        if any(answer.stable for answer in consistent):
            return query.choose(unstable + consistent)
        unstable += consistent
    return query.choose(unstable) if unstable else status


def _settle(query: _Query) -> tuple[int, int]:
    """Solve the modes as they are, the balls that slip from rest turned; see `rest.solve_modes`."""
    modes = query.modes
    if not query.mechanism.closed:
        return query.answer()
    modes.friction[:1] = np.nan  # what is shared is no guess for other modes
    for n in range(_CHANGES):
        solutions, obeying = query.answer()
        if solutions <= 0:
            break
        turned = _turn_balls(modes, query.mechanism, slips=True)
        sticks = (modes.verdict[query.mechanism.ball] == SHOULD_STICK).any()
        if turned <= _TURNED or (sticks and n > _TRANSIENT):
            break
    else:
        solutions, sticks = -1, True
    if solutions <= 0 or sticks:
        query.answers = []
        return solutions, 0
    return solutions, max(obeying, int(solutions > 0 and not modes.verdict.any()))


def _same(one: Modes, other: Modes) -> bool:
    """Return whether two solutions are one acceleration.

    Their friction is the same, or their rates are: what rests may share its friction in many ways.
    """
    pairs = np.array([(one.friction, other.friction), (one.rate, other.rate)])
    far = np.abs(pairs[:, 0] - pairs[:, 1]).max(axis=1, initial=0.0)
    alike = far <= _SAME * np.abs(pairs).max(axis=(1, 2), initial=0.0)
    return bool(alike.any() and np.isfinite(pairs).all())


def outcome_of(solutions: int, obeying: int) -> SearchOutcome:
    """Return how a search with a single candidate ends, from what `solve_modes` returns."""
    if solutions < 0:
        return SearchOutcome.NOT_CONVERGED
    return (SearchOutcome.NONE, SearchOutcome.SOLVED, SearchOutcome.AMBIGUOUS)[min(obeying, 2)]


def solve_given(
    problem: Problem, modes: Modes, mechanism: Mechanism, count: SearchStatistics
) -> SearchOutcome:
    """Solve the modes as they are; of several answers that gears leave the only stable one."""
    query, count.island = _Query(problem, modes, mechanism, count, every=False), count.island[:0]
    query.count.tried += 1
    return query.end(*query.answer())


def _follow_or_search(
    problem: Problem, modes: Modes, mechanism: Mechanism, count: SearchStatistics, *search: Any
) -> SearchOutcome:
    """`search` of one island, from the modes given on."""
    start = modes.copy()
    outcome = _follow(_Query(problem, modes, mechanism, count, every=False), set())
    if outcome != SearchOutcome.SOLVED and mechanism.closed:
        modes.take(start)
        _stick(modes, mechanism, {})
        outcome = _follow(_Query(problem, modes, mechanism, count, every=False), set())
    if outcome != SearchOutcome.SOLVED and int(modes.at_rest.sum()) <= MOST_ENUMERATED:
        return _search(problem, modes, mechanism, count, *search)
    return outcome


def _follow(query: _Query, fixed: set[int]) -> SearchOutcome:
    """Find consistent modes by block pivoting with Murty's rule as a safeguard, `fixed` unchanged.

    All joints that violate their law change their mode at once; when this stops reducing their
    number, only the last of them does (certain to end with a P-matrix). The direction of a ball
    that slips from rest depends on its friction, and is iterated.
    """
    modes, mechanism = query.modes, query.mechanism
    fewest, patience = len(modes.stuck) + 1, _PATIENCE
    for _ in range(_CHANGES + _FOR_EACH * len(modes.stuck)):
        if query.left <= 0:
            return SearchOutcome.UNDECIDED
        query.count.tried += 1
        solutions, obeying = query.answer()
        if solutions <= 0:
            return outcome_of(solutions, 0)
        if _turn_balls(modes, mechanism) > _TURNED:
            continue
        if obeying or not modes.verdict.any():
            return query.end(solutions, max(obeying, 1))
        wrong = [int(c) for c in np.flatnonzero(modes.verdict) if c not in fixed]
        if not wrong:
            return SearchOutcome.NONE  # what must slip would not
        patience = _PATIENCE if len(wrong) < fewest else patience - 1
        fewest = min(fewest, len(wrong))
        if patience < 0:
            last = mechanism.block[wrong[-1]]
            wrong = [c for c in wrong if mechanism.block[c] == last]
        alone = [c for c in wrong if mechanism.idle[c] and len(wrong) == 1 and not modes.stuck[c]]
        modes.direction[alone] *= -1.0  # at its dead centre a joint turns round
        for c in wrong if not alone else []:
            sticks = modes.verdict[c] == SHOULD_STICK
            modes.stuck[c] = sticks
            way = mechanism.way[c] if mechanism.ball[c] else modes.verdict[c]
            modes.direction[c] = 0.0 if sticks else way
        for c in wrong:
            _agree(modes, mechanism, c)
    return SearchOutcome.NONE


def _turn_balls(modes: Modes, mechanism: Mechanism, slips: bool = False) -> float:
    """Point the friction of balls that slip from rest against their motion; return the most turned.

    With |x| = L given, x = -L r / |r| and r = r_0 + R x, where what sticks goes on to stick:
    x = -(R + g 1)^-1 r_0 with g = |r| / L, of which |x| falls with g: one root. At g = 0 the ball
    would be held; `slips`: it turns, too. Balls take turns until none changes: each lessens
    x R x / 2 + r_0 x, a convex function, within its limit.
    """
    turned = 0.0
    slipping = modes.at_rest & ~modes.stuck & mechanism.ball
    if not mechanism.closed or not slipping.any():
        return turned
    held = mechanism.factor[:, modes.stuck]
    left = mechanism.factor - held @ (np.linalg.pinv(held, rcond=RANK) @ mechanism.factor)
    balls = list[tuple[np.ndarray, np.ndarray, np.ndarray, float]]()
    for number in mechanism.joints(slipping):
        here = np.flatnonzero(mechanism.block == number)
        size, axes = np.linalg.eigh(left[:, here].T @ left[:, here])
        size[size < RANK**2 * size[-1]] = 0.0
        balls.append((here, size, axes, float(np.linalg.norm(modes.friction[here]))))
    x, motion = modes.friction.copy(), np.zeros(len(left))
    for _ in range(_SWEEPS if len(balls) > 1 else 1):
        before = x.copy()
        for here, size, axes, limit in balls:
            rate = modes.rate[here] + left[:, here].T @ motion
            pull = np.where(size > 0.0, axes.T @ rate - size * (axes.T @ x[here]), 0.0)
            new = -axes @ (pull / (size + _secular_root(pull, size, limit)))
            motion += left[:, here] @ (new - x[here])
            x[here] = new
        if np.abs(x - before).max() <= _TURNED * np.abs(x).max():
            break
    if len(balls) > 1:
        _polish(left, modes, [(here, limit) for here, _, _, limit in balls], motion, x)
    for here, _, _, limit in balls:
        new, length = x[here], float(np.linalg.norm(x[here]))
        sticks = not length >= limit * (1.0 - 1e-9)
        modes.verdict[here] = SHOULD_STICK if sticks else 0
        if sticks and not (slips and length):
            continue
        turned = max(turned, float(np.abs(new / length + modes.direction[here]).max()))
        modes.direction[here] = -new / length
    return turned


def _polish(
    left: np.ndarray,
    modes: Modes,
    balls: list[tuple[np.ndarray, float]],
    motion: np.ndarray,
    x: np.ndarray,
) -> None:
    """Improve the friction x of balls that all slip by Newton's method over their motion (d,)."""
    if any(np.linalg.norm(x[here]) < limit * (1.0 - 1e-9) for here, limit in balls):
        return
    y = x.copy()
    for _ in range(_NEWTON):
        slope = np.eye(len(left))
        for here, limit in balls:
            A = left[:, here]
            rate = modes.rate[here] + A.T @ motion
            speed = float(np.linalg.norm(rate))
            if speed == 0.0:
                return
            way = rate / speed
            y[here] = -limit * way
            slope += (limit / speed) * A @ (np.eye(3) - np.outer(way, way)) @ A.T
        off = motion - left @ (y - modes.friction)
        step = np.linalg.solve(slope, off)
        motion = motion - step
        if np.abs(step).max() <= 1e-2 * _TURNED * np.abs(motion).max():
            x[:] = y
            return


def _secular_root(pull: np.ndarray, size: np.ndarray, limit: float) -> float:
    """Return the g >= 0 at which |pull / (size + g)| = limit; next to 0 where it is below there.

    By Newton's method on 1 / |.|, which is nearly a line (Moré and Sorensen 1983).

    Args:
        pull, size: (3,), size >= 0.
        limit: what is to be reached.
    """
    terms = list(zip((pull**2).tolist(), size.tolist(), strict=True))
    low = g = max(1e-14 * max(size.tolist()), 1e-90)
    high = sum(square for square, _ in terms) ** 0.5 / max(limit, 1e-300)
    for _ in range(200):
        square = sum(p / (s + g) ** 2 for p, s in terms)
        if square <= limit * limit:
            if g == low:
                return low
            high = g
        else:
            low = g
        slope = sum(p / (s + g) ** 3 for p, s in terms)
        before, g = g, g + square * (square**0.5 / max(limit, 1e-300) - 1.0) / slope
        if not low < g < high:
            g = (low * high) ** 0.5  # decades apart at first
        if g in (low, high) or abs(g - before) <= 4e-16 * g:
            break
    return float(g)
