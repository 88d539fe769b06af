"""The search for modes: which coordinates stick and which slip (Wu, Yang, Haug 1984).

At rest stick has priority: the search is for the consistent modes with the fewest slipping joints.
Two different accelerations with equally few are ambiguous, unless exactly one of them lets all
joints stick that were sticking until now. Of up to `MOST_ENUMERATED` joints that depend on each
other (`islands`) all modes that kinematics allows are tried (`ways`), in open chains all that
linear programs do not refute (`tree`), also in loops of more joints. Beyond that, modes are
followed from all stick: others may exist (`notebooks/theory/resting.md`). After `MOST_PASSES`
passes of its solves a search is `UNDECIDED`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pinfric.friction.balance import FITS, RANK
from pinfric.friction.balls import TURNED, turn_balls
from pinfric.friction.gears import (
    choices_of_lines,
    fit,
    lasts_under_loads,
    lines_and_rows,
    one_answer,
)
from pinfric.friction.given_modes import SHOULD_STICK, judge
from pinfric.friction.islands import split
from pinfric.friction.law import evaluate
from pinfric.friction.problem import Modes, Problem, SearchOutcome
from pinfric.friction.rest import Mechanism, passes_of_sharing, solve_modes
from pinfric.friction.several import find_all
from pinfric.friction.smoothing import guess_modes
from pinfric.friction.tree import Tree
from pinfric.friction.ways import PossibleWays, Ways

#: Up to this number of joints at rest all modes are tried: 3^8 = 6561 solves.
MOST_ENUMERATED = 8
#: All modes of up to so many joints are tried in less time than a tree of them takes.
_FEW = 2
#: Passes of all solves of a search, about a second once compiled. A solve takes one pass in an open
#: chain, three in a mechanism, more where friction is shared; on lines of gears a tenth of these.
MOST_PASSES, _ON_LINES = 8_000, 0.1
#: Passes in the modes that the tree of a mechanism leaves: nearly always one to three.
_IN_LOOPS = 300
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
#: How often balls may turn in the same modes.
_TURNS = 30
#: Passes after which a ball that would stick does.
_TRANSIENT = 10


class Answer(NamedTuple):
    """A solution that obeys the laws; see `gears.py` for which are stable."""

    modes: Modes
    stable: bool = True


@dataclass
class SearchStatistics:
    """What a search counted.

    Attributes:
        many: how many answers, and how many of them are stable; 0: one was found, others may exist.
        tried: in how many modes it looked for them.
        may_miss: whether gears allow more choices than were tried.
        island: (n,) coordinates of the island that decided the outcome; none: all did.
    """

    many: tuple[int, int] = (1, 1)
    tried: int = 1
    may_miss: bool = False
    island: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def of_one_mode(self, solutions: int, obeying: int) -> SearchOutcome:
        """Return how a search of a single mode ends, from what `rest.solve_modes` returns."""
        self.many, self.tried, self.may_miss = (obeying, obeying), 1, False
        self.island = self.island[:0]
        return outcome_of(solutions, obeying)


@dataclass
class _Query:
    """The search of an island, and what remains of its passes.

    Attributes:
        several: whether all solutions of given modes are wanted, where there may be several.
        judged: whether of these only those that obey the laws are.
        answers: those in the modes solved last, if gears may have several; else empty.
        passes: that remain.
        may_miss: whether the search for all solutions of some modes reached its limit.
        proved: whether the answer found is known to be the only one.
    """

    problem: Problem
    modes: Modes
    mechanism: Mechanism
    count: SearchStatistics
    several: bool = False
    judged: bool = False
    answers: list[Answer] = field(default_factory=list)
    passes: float = field(default_factory=lambda: MOST_PASSES)
    may_miss: bool = False
    proved: bool = True

    def __post_init__(self) -> None:
        self.count.many, self.count.tried, self.count.may_miss = (0, 0), 0, False

    def solve(self) -> tuple[int, int]:
        """Solve the modes as they are, all solutions of them if wanted; see `rest.solve_modes`."""
        self.answers, m = [], self.modes
        counts = solve_modes(self.problem, m, self.mechanism)
        self._count(1.0)
        moves = not m.stuck[self.problem.gear_coordinate].all()
        off_lines = moves and m.figures[0] >= 1.0  # of several solutions some
        if m.effort.size and (counts[0] < 0 or off_lines or not one_answer(self.problem, m)):
            counts = self._on_every_line()
        return self._all(counts) if self.several and m.figures[0] >= 1.0 else counts

    def rest(self) -> tuple[int, int]:
        """Let all at rest stick, and solve; see `rest.solve_modes`."""
        _stick(self.modes, self.mechanism, {})
        self.count.tried += 1
        return _settle(self)

    def _count(self, weight: float) -> None:
        """Take the passes of the last solve from those that remain."""
        plain = weight * (3 if self.mechanism.closed else 1)
        self.passes -= max(plain, passes_of_sharing(self.modes))

    def _on_every_line(self) -> tuple[int, int]:
        """Solve the modes on every line of gears that may fit; `answers` are theirs."""
        m, solved = self.modes, list[Answer]()
        choices = choices_of_lines(self.problem, m)
        self.count.may_miss |= choices is None
        for efforts, stable in choices or ():
            if self.passes <= 0:
                self.count.may_miss = True
                break
            m.effort[:] = efforts
            lines = lines_and_rows(self.problem, m)[0]
            solutions, obeying = solve_modes(self.problem, m, self.mechanism, chosen=True)
            self._count(_ON_LINES)
            known = solutions > 0 and np.isfinite(m.friction).all()
            if known and not any(_same(m, answer.modes) for answer in solved):
                lasts = lasts_under_loads(self.problem, m, lines[:, 0])
                solved.append(Answer(m.copy(), stable if lasts is None else lasts))
                self.answers += solved[-1:] * obeying
        if solved:
            self._take(max(self.answers or solved, key=lambda answer: answer.stable))
        return len(solved), len(self.answers)

    def _take(self, answer: Answer) -> None:
        """Write an answer, and solve it again."""
        self.modes.take(answer.modes)
        solve_modes(self.problem, self.modes, self.mechanism, chosen=True)

    def end(self, solutions: int, obeying: int) -> SearchOutcome:
        """Return how the search ends with the modes just solved, and write the answer."""
        if self.answers:
            return self.choose(list(self.answers))
        self.count.many = obeying, obeying
        return self.unless_missed(outcome_of(solutions, obeying))

    def unless_missed(self, outcome: SearchOutcome) -> SearchOutcome:
        """Return how the search ends, where what it may have missed would change that."""
        missed = self.count.may_miss and outcome == SearchOutcome.NONE
        missed |= outcome == SearchOutcome.SOLVED and (self.may_miss or self.count.may_miss)
        return SearchOutcome.UNDECIDED if missed else outcome

    def choose(self, answers: list[Answer]) -> SearchOutcome:
        """Write an answer: of several the only stable one."""
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
        """Look for solutions that Newton's method has missed; see `solve`."""
        modes, problem = self.modes, self.problem
        before = modes.copy()
        kept = before
        lines, rows = lines_and_rows(problem, modes)
        obey = modes.at_rest & ~self.mechanism.ball if self.judged else None
        frictions = find_all(problem, modes.stuck, modes.direction, rows, obey)
        self.passes -= frictions.parts
        self.may_miss |= frictions.complete is False
        if len(frictions.solutions) <= counts[obey is not None]:
            return counts
        obeying = 0
        for x in frictions.solutions:
            modes.friction[:] = x
            evaluate(problem, modes.friction, modes.load, modes.rate)
            off_lines, _ = fit(problem, modes, lines, True) if modes.effort.size else (0, 0)
            if judge(problem, modes) == 0 and not off_lines:
                obeying += 1
                kept = modes.copy()
        modes.take(kept)
        if obey is not None and obeying <= counts[1]:
            modes.take(before)
            return counts
        return max(len(frictions.solutions), counts[0]), obeying


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
    if not islands:
        count.island = np.arange(len(modes.stuck))
        return _search_island(problem, modes, mechanism, count, forced, held, follow)
    ends = list[tuple[SearchOutcome, SearchStatistics, np.ndarray]]()
    for island in islands:
        ways = {k: forced[c] for k, c in enumerate(island.coordinates.tolist()) if c in forced}
        stays = None if held is None else held[island.coordinates]
        own = SearchStatistics(island=island.coordinates)
        alone = island.problem, island.modes, island.mechanism
        ends.append((_search_island(*alone, own, ways, stays, follow), own, island.modes.figures))
        island.put_back(problem, modes, mechanism)
    if np.isnan(modes.friction).any():
        modes.forget()
    worst = max((outcome for outcome, _, _ in ends), key=_GRAVITY.index)
    those = [(own, figures) for outcome, own, figures in ends if outcome == worst]
    modes.figures[:] = np.max([figures for _, figures in those], axis=0)
    many = np.prod([own.many for own, _ in those], axis=0).tolist()
    count.many = (many[0], many[1]) if worst == SearchOutcome.SOLVED else those[0][0].many
    count.tried, count.island = those[0][0].tried, those[0][0].island
    count.may_miss = any(own.may_miss for own, _ in those)
    return worst


def _search_island(
    problem: Problem,
    modes: Modes,
    mechanism: Mechanism,
    count: SearchStatistics,
    forced: Mapping[int, float],
    held: np.ndarray | None,
    follow: bool = False,
) -> SearchOutcome:
    """`search` of one island."""
    if follow:  # the modes given; in a mechanism then all stick
        start = modes.copy()
        outcome = _follow(_Query(problem, modes, mechanism, count), set())
        if outcome != SearchOutcome.SOLVED and mechanism.closed:
            modes.take(start)
            _stick(modes, mechanism, {})
            outcome = _follow(_Query(problem, modes, mechanism, count), set())
        many = modes.at_rest.sum() > MOST_ENUMERATED and (mechanism.closed or mechanism.ball.any())
        if outcome == SearchOutcome.SOLVED or many:
            return outcome
    query = _Query(problem, modes, mechanism, count, several=True)
    # 1. joints that pass their dead centre are not at rest
    together = mechanism.is_dependent(modes.at_rest)
    passing = modes.at_rest & mechanism.idle
    if together:  # of these what moves with coordinates that are not at rest
        A = mechanism.normalized()
        moves = np.abs(problem.rate_free) > FITS * problem.rate_scale  # not by rounding
        led = (np.abs(A.T @ A[:, ~modes.at_rest]) > RANK).any(axis=1)
        passing &= led | (~A.any(axis=0) & moves)
    modes.at_rest[passing] = modes.stuck[passing] = False
    modes.direction[passing] = np.sign(problem.rate_free[passing])
    at_rest = modes.at_rest.copy()
    # 2. the others, until the passing ones slip as they move
    for _ in range(3):
        if together and not mechanism.is_dependent(at_rest):
            outcome = _search_island(problem, modes, mechanism, count, forced, held)
        else:
            outcome = _search_resting(query, dict(forced), held)
        if (modes.direction[passing] * modes.rate[passing] >= 0.0).all():
            break
        modes.at_rest[:] = at_rest
        modes.direction[passing] = np.sign(modes.rate[passing])
    if outcome == SearchOutcome.SOLVED and not query.proved:
        query.count.many = 0, 0
    return query.unless_missed(outcome)


def rests(problem: Problem, modes: Modes, mechanism: Mechanism) -> bool:
    """Return whether friction holds all that is at rest, which every search tries first.

    Forward dynamics and `holds` ask this: if so, nothing moves.

    Args:
        modes: with `at_rest`, and the modes of the others, set; overwritten with all at rest
            sticking, and with the friction that holds it or the last one tried.
    """
    islands, held = split(problem, modes, mechanism), True
    if not islands:
        return _Query(problem, modes, mechanism, SearchStatistics(), several=True).rest()[1] > 0
    for island in islands:
        alone = island.problem, island.modes, island.mechanism
        held &= _Query(*alone, SearchStatistics(), several=True).rest()[1] > 0
        island.put_back(problem, modes, mechanism)
    return held


def _search_resting(query: _Query, forced: Ways, held: np.ndarray | None) -> SearchOutcome:
    """Find the modes of coordinates at rest if no joint passes its dead centre; see `search`."""
    modes, mechanism = query.modes, query.mechanism
    rests, together = modes.at_rest, mechanism.is_dependent(modes.at_rest)
    if not rests.any():
        query.count.tried += 1
        return query.end(*query.solve())
    open_chain = not (mechanism.closed or mechanism.ball.any())
    in_tree = open_chain and rests.sum() > _FEW and not (modes.stuck & ~rests).any()
    many = len(mechanism.joints(rests)) > MOST_ENUMERATED
    # 1. all stick; where that does not last, or in several ways, it is one answer of step 3
    first = None if forced else query.rest()
    stays = first is not None and first[1] > 0
    if first is not None and stays:
        lasts = first[1] == 1 and all(answer.stable for answer in query.answers)
        if lasts or in_tree or many:
            return query.end(*first)
    unsolved = first is not None and first[0] < 0
    # 2. what follows from there, and open chains
    if in_tree:
        outcome = _in_tree(query, forced, held, first)
        if outcome is not None:
            return SearchOutcome.NOT_CONVERGED if unsolved and outcome in _NOTHING else outcome
        first = None
    plain = not (mechanism.ball.any() or mechanism.idle.any())
    plain &= mechanism.closed and not (modes.stuck & ~rests).any()
    if many:
        if plain:
            query.passes = _IN_LOOPS
            outcome = _in_tree(query, forced, held, None)
            if outcome in (SearchOutcome.SOLVED, SearchOutcome.AMBIGUOUS):
                return outcome
            first, query.passes = None, MOST_PASSES
        return _pivot(query, forced, first)
    # 3. the others, those with few slipping joints first
    possible = PossibleWays(query.problem, mechanism, rests.copy())
    levels = possible.levels(forced, fewest=int(not forced and not stays))
    if plain:
        tree = Tree(query.problem, rests.copy(), modes.direction)
        levels = tree.allowed(levels) if tree.ends else levels
    outcome = _enumerate(query, levels, forced, held)
    if unsolved and outcome == SearchOutcome.NONE:
        outcome = SearchOutcome.NOT_CONVERGED
    missed = outcome in _NOTHING and (mechanism.ball & rests).any()  # a ball has one start only
    if missed or outcome == SearchOutcome.UNDECIDED:
        query.passes = MOST_PASSES
        outcome = _pivot(query, forced)
        return outcome if outcome == SearchOutcome.SOLVED else SearchOutcome.UNDECIDED
    if together and forced and outcome in _NOTHING:
        # the direction of break-away was a guess: a slow joint's friction may act with the motion
        outcome = _enumerate(query, possible.levels({}, fewest=1), {}, held)
    return outcome


def _in_tree(
    query: _Query, forced: Ways, held: np.ndarray | None, first: tuple[int, int] | None
) -> SearchOutcome | None:
    """Search joints without balls among the modes of its `tree.Tree`; None: too many."""
    if first is not None and _has_one_answer(query.problem, query.modes.at_rest):
        return _follow(query, set(), first)
    closed = query.mechanism.closed
    tree = Tree(query.problem, query.modes.at_rest.copy(), query.modes.direction, closed)
    if not tree.ends:
        return None
    levels = ([ways for ways in level if ways] for level in tree.levels(forced))
    outcome = _enumerate(query, levels, forced, held)
    if tree.complete and outcome != SearchOutcome.UNDECIDED:
        return outcome
    query.passes = MOST_PASSES
    return None


def _has_one_answer(problem: Problem, at_rest: np.ndarray) -> bool:
    """Whether friction that no load changes is the same at rest as in motion: pivoting finds it."""
    loaded = (problem.mu_stick + problem.mu_slip)[problem.contact_entry].any()
    rests = at_rest[problem.coordinate]
    same = (problem.coulomb_stick == problem.coulomb_slip)[rests].all()
    return not (loaded or len(problem.gear_rotor) or problem.drag[rests].any()) and bool(same)


def _pivot(query: _Query, forced: Ways, first: tuple[int, int] | None = None) -> SearchOutcome:
    """Follow modes from all stick.

    The answer is the one with the fewest slipping joints if none breaks away beside `forced`.
    `first`: see `_follow`.
    """
    modes, query.judged = query.modes, False
    if first is None:
        _stick(modes, query.mechanism, forced)
    outcome = _follow(query, set(forced), first)
    if outcome != SearchOutcome.SOLVED and not forced and not modes.effort.size:
        guess_modes(query.problem, modes, query.mechanism)
        modes.forget()
        query.passes = MOST_PASSES
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

    Where all answers of these are unstable, more may slip.
    """
    status, unstable = SearchOutcome.NONE, list[Answer]()
    modes, query.judged = query.modes, True
    for level in levels:
        consistent = list[Answer]()
        for ways in level:
            if query.passes <= 0:
                return SearchOutcome.UNDECIDED
            _stick(modes, query.mechanism, ways)
            query.count.tried += 1
            solutions, obeying = _settle(query)
            status = SearchOutcome.NOT_CONVERGED if solutions < 0 else status
            answers = list(query.answers)
            if obeying > 1 and all(_same(answers[0].modes, other.modes) for other in answers):
                query.count.many = obeying, obeying
                return SearchOutcome.AMBIGUOUS
            for answer in answers or [Answer(modes.copy())] * (obeying == 1):
                if not any(_same(answer.modes, other.modes) for other in consistent):
                    consistent.append(answer)
        if len(consistent) > 1 and held is not None:
            stay = held & ~np.isin(np.arange(len(held)), list(forced))
            those = [answer for answer in consistent if answer.modes.stuck[stay].all()]
            consistent = those or consistent
        if any(answer.stable for answer in consistent):
            return query.choose(unstable + consistent)
        unstable += consistent
    return query.choose(unstable) if unstable else status


def _settle(query: _Query) -> tuple[int, int]:
    """Solve the modes as they are, the balls that slip from rest turned; see `rest.solve_modes`."""
    modes = query.modes
    if not query.mechanism.closed:
        return query.solve()
    modes.forget()  # what is shared is no guess for other modes
    for n in range(_CHANGES):
        solutions, obeying = query.solve()
        if solutions <= 0:
            break
        turned = turn_balls(modes, query.mechanism, slips=True) if query.mechanism.balls else 0.0
        sticks = (modes.verdict[query.mechanism.ball] == SHOULD_STICK).any()
        if turned <= TURNED or (sticks and n > _TRANSIENT):
            break
    else:
        solutions, sticks = -1, True
    if solutions <= 0 or sticks:
        query.answers = []
        return solutions, 0
    return solutions, max(obeying, int(solutions > 0 and not modes.verdict.any()))


def _same(modes: Modes, other: Modes) -> bool:
    """Return whether two solutions have the same friction, or the same rates.

    What rests may share its friction in many ways.
    """
    pairs = np.array([(modes.friction, other.friction), (modes.rate, other.rate)])
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
    query, count.island = _Query(problem, modes, mechanism, count), count.island[:0]
    query.count.tried += 1
    return query.end(*query.solve())


def _follow(query: _Query, fixed: set[int], first: tuple[int, int] | None = None) -> SearchOutcome:
    """Find consistent modes by block pivoting with Murty's rule as a safeguard, `fixed` unchanged.

    All joints that violate their law change their mode at once; when this stops reducing their
    number, only the last of them does (certain to end with a P-matrix). It ends where balls
    do not settle. `first`: what `solve` returned of the modes as they are.
    """
    modes, mechanism, turns = query.modes, query.mechanism, 0
    fewest, patience = len(modes.stuck) + 1, _PATIENCE
    for _ in range(_CHANGES + _FOR_EACH * len(modes.stuck)):
        if query.passes <= 0:
            return SearchOutcome.UNDECIDED
        if first is None:
            query.count.tried += 1
        (solutions, obeying), first = first or query.solve(), None
        if solutions <= 0:
            return outcome_of(solutions, 0)
        turns = turns + 1 if turn_balls(modes, mechanism) > TURNED else 0
        if turns > _TURNS:
            return SearchOutcome.NONE
        if turns:
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
