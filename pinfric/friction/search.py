"""Which coordinates stick and which slip: the search over modes (Wu, Yang, Haug 1984).

At rest stick has priority: a coordinate slips only where no admissible stick exists. So the modes
wanted are the consistent ones with the fewest slipping joints; two different accelerations with
equally few are ambiguous, unless it is known what was sticking until now and just one of them lets
it stick on. Up to `MOST_ENUMERATED` joints at rest that is decided by enumeration, exactly. Beyond,
and first where joints can only move together, modes are followed from all stick: they are
consistent, but it is not known that they are the only ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from pinfric.friction.consistency import SHOULD_STICK
from pinfric.friction.modes import Found, Modes
from pinfric.friction.problem import Problem
from pinfric.friction.rest import Mechanism, solve
from pinfric.friction.sharing import RANK

#: Up to so many joints at rest all modes are looked at: 3^8 = 6561 solves.
MOST_ENUMERATED = 8
#: Accelerations closer than this, relative to their size, are the same one.
_SAME = 1e-6
#: Passes of the search: so many, and for each coordinate.
_CHANGES, _FOR_EACH = 60, 20


def search(
    problem: Problem,
    modes: Modes,
    mechanism: Mechanism,
    forced: Mapping[int, float] | None = None,
    held: np.ndarray | None = None,
) -> Found:
    """Find the modes of the coordinates at rest; those that move keep theirs.

    A joint that rests because it is at its dead centre turns round with the mechanism.

    Args:
        problem: `Problem`.
        modes: with `at_rest`, and the modes of the others, set; overwritten with the answer.
        mechanism: `Mechanism`.
        forced: coordinate -> direction it must slip in (it has just broken away).
        held: (nc,) bool, what has been sticking until now: among several answers with equally few
            slipping joints, the one that lets all of these stick on.
    """
    together = mechanism.is_dependent(modes.at_rest)
    passing = modes.at_rest & mechanism.idle
    if together:
        passing &= _led(problem, modes, mechanism)
    modes.at_rest[passing] = modes.stuck[passing] = False
    modes.direction[passing] = np.sign(problem.rate_free[passing])
    at_rest = modes.at_rest.copy()
    attempt = search if together and not mechanism.is_dependent(at_rest) else _search_open
    for _ in range(3):
        found = attempt(problem, modes, mechanism, forced or {}, held)
        if (modes.direction[passing] * modes.rate[passing] >= 0.0).all():
            break
        modes.at_rest[:] = at_rest
        modes.direction[passing] = np.sign(modes.rate[passing])
    return found


def _led(problem: Problem, modes: Modes, mechanism: Mechanism) -> np.ndarray:
    """(nc,) bool: what moves along with what is not at rest."""
    A = mechanism.normalized()
    led = (np.abs(A.T @ A[:, ~modes.at_rest]) > RANK).any(axis=1)
    return np.asarray(led | (~A.any(axis=0) & (problem.rate_free != 0.0)))


def _search_open(
    problem: Problem,
    modes: Modes,
    mechanism: Mechanism,
    forced: Mapping[int, float],
    held: np.ndarray | None,
) -> Found:
    """Find the modes of what is at rest where no joint passes its dead centre. See `search`."""
    rests, together = modes.at_rest, mechanism.is_dependent(modes.at_rest)
    if not rests.any():
        return outcome(*solve(problem, modes, mechanism))
    few = len(mechanism.joints(rests)) <= MOST_ENUMERATED
    found = Found.NONE
    if together or not few:
        _stick(modes, mechanism, forced)
        found = follow(problem, modes, mechanism, set(forced))
    if few and found in (Found.NONE, Found.NOT_CONVERGED):
        found = _enumerate(problem, modes, mechanism, forced, held)
    if few and together and forced and found in (Found.NONE, Found.NOT_CONVERGED):
        # which way it breaks away was a first guess: a slow joint may rub along with the motion
        found = _enumerate(problem, modes, mechanism, {}, held, fewest=1)
    one_freedom = together and len(mechanism.factor) == 1
    if found == Found.SOLVED and one_freedom and not modes.stuck[rests].any():
        other = modes.copy()  # there is one other way to slip
        other.direction[rests] *= -1.0
        if solve(problem, other, mechanism)[1] > 0:
            return Found.AMBIGUOUS
    return found


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
    problem: Problem,
    modes: Modes,
    mechanism: Mechanism,
    forced: Mapping[int, float],
    held: np.ndarray | None,
    fewest: int = 0,
) -> Found:
    """Try all modes, with the fewest joints that slip beside the forced ones first."""
    status = Found.NONE
    others = [c for c in mechanism.joints(modes.at_rest) if c not in forced]
    for level in range(fewest, len(others) + 1):
        consistent: list[Modes] = []
        for ways in _ways(mechanism, others, level):
            _stick(modes, mechanism, {**forced, **ways} if forced else ways)
            solutions, obeying = _settle(problem, modes, mechanism)
            if solutions < 0:
                status = Found.NOT_CONVERGED
            if obeying > 1:
                return Found.AMBIGUOUS
            if obeying == 1 and not any(_same(modes, other) for other in consistent):
                consistent.append(modes.copy())
        if len(consistent) > 1 and held is not None:
            stay = held & ~np.isin(np.arange(len(held)), list(forced))
            consistent = [one for one in consistent if one.stuck[stay].all()] or consistent
        if consistent:
            modes.take(consistent[0])
            return Found.SOLVED if len(consistent) == 1 else Found.AMBIGUOUS
    return status


def _ways(mechanism: Mechanism, others: list[int], level: int) -> Iterator[dict[int, float]]:
    """Yield all ways in which `level` of the other joints slip: coordinate -> direction."""
    for slipping in combinations(others, level):
        for ways in product(*[(1.0,) if mechanism.ball[c] else (1.0, -1.0) for c in slipping]):
            yield dict(zip(slipping, ways, strict=True))


def _settle(problem: Problem, modes: Modes, mechanism: Mechanism) -> tuple[int, int]:
    """Solve the modes as they are, the balls that slip from rest turned; see `rest.solve`."""
    if not mechanism.closed:
        return solve(problem, modes, mechanism)
    modes.friction[:1] = np.nan  # what is shared is no guess for other modes
    for _ in range(_CHANGES):
        solutions, obeying = solve(problem, modes, mechanism)
        if solutions <= 0 or not _turn_balls(problem, modes, mechanism):
            break
    return solutions, max(obeying, int(solutions > 0 and not modes.verdict.any()))


def _same(one: Modes, other: Modes) -> bool:
    """Return whether two solutions are one acceleration (what is at its limit slips at rate 0)."""
    difference = np.abs(one.friction - other.friction).max(initial=0.0)
    size = max(np.abs(one.friction).max(initial=0.0), np.abs(other.friction).max(initial=0.0))
    return bool(difference <= _SAME * size)


def outcome(solutions: int, obeying: int) -> Found:
    """Return how a search with a single candidate ends, from what `solve` returns."""
    if solutions < 0:
        return Found.NOT_CONVERGED
    return (Found.NONE, Found.SOLVED, Found.AMBIGUOUS)[obeying]


@dataclass
class _Patience:
    """Whether all that is wrong may change at once: while that reduces its number now and then.

    Attributes:
        fewest: that were wrong so far. left: how often more may be from now on.
    """

    fewest: int
    left: int = 10

    def lasts(self, wrong: int) -> bool:
        """Count a pass in which so many are wrong; False: only one of them may change."""
        if wrong < self.fewest:
            self.fewest, self.left = wrong, 10
            return True
        self.left -= 1
        return self.left >= 0


def follow(
    problem: Problem, modes: Modes, mechanism: Mechanism, fixed: set[int] | None = None
) -> Found:
    """Find consistent modes from those given, by block pivoting with Murty's rule as a safeguard.

    Every joint that breaks its law changes its mode, all at once; when that stops reducing their
    number, only the last of them does, which ends for certain where loads do not depend on friction
    and static equals kinetic (a P-matrix). A ball that slips from rest moves the way it is pushed,
    which changes with its friction: its direction is followed until it stays.

    Args:
        problem, modes, mechanism: see `search`; the modes given are where it starts.
        fixed: coordinates whose modes stay.
    """
    fixed, all_at_once = fixed or set(), _Patience(len(modes.stuck) + 1)
    for _ in range(_CHANGES + _FOR_EACH * len(modes.stuck)):
        solutions, obeying = solve(problem, modes, mechanism)
        if solutions <= 0:
            return outcome(solutions, 0)
        if _turn_balls(problem, modes, mechanism):
            continue
        if obeying or not modes.verdict.any():
            return outcome(solutions, max(obeying, 1))
        wrong = [int(c) for c in np.flatnonzero(modes.verdict) if c not in fixed]
        if not wrong:
            return Found.NONE  # what must slip would not
        if not all_at_once.lasts(len(wrong)):
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
    return Found.NONE


def _turn_balls(problem: Problem, modes: Modes, mechanism: Mechanism) -> bool:
    """Point the friction of balls that slip from rest against their motion; True if one turned.

    With |x| = L given, x = -L r / |r| and r = r_0 + R x:  x = -(R + g 1)^-1 r_0 with g = |r| / L,
    of which |x| falls with g: one root. At g = 0 the ball would be held.
    """
    turned = False
    if not mechanism.closed:
        return turned
    slipping = modes.at_rest & ~modes.stuck & mechanism.ball
    for number in mechanism.joints(slipping):
        here = np.flatnonzero(mechanism.block == number)
        x = modes.friction[here]
        limit = float(np.linalg.norm(x))
        R = problem.rate_slope[np.ix_(here, here)]
        size, axes = np.linalg.eigh(R)
        pull = axes.T @ (modes.rate[here] - R @ x)
        modes.verdict[here] = 0
        new = -axes @ (pull / (size + _secular_root(pull, size, limit)))
        if not np.linalg.norm(new) >= limit * (1.0 - 1e-9):
            modes.verdict[here] = SHOULD_STICK
            continue
        towards = -new / np.linalg.norm(new)
        turned = turned or bool(np.abs(towards - modes.direction[here]).max() > 1e-8)
        modes.direction[here] = towards
    return turned


def _secular_root(pull: np.ndarray, size: np.ndarray, limit: float) -> float:
    """Return the g >= 0 at which |pull / (size + g)| = limit; next to 0 where it is below there.

    Args:
        pull, size: (3,), size >= 0.
        limit: what is to be reached.
    """
    low, high = 1e-14 * float(size.max()), float(np.linalg.norm(pull)) / max(limit, 1e-300)
    if np.linalg.norm(pull / (size + low)) <= limit:
        return low
    for _ in range(200):  # bisection on the exponent: decades apart at first
        middle = np.sqrt(low * high)
        if middle in (low, high):
            break
        inside = np.linalg.norm(pull / (size + middle)) <= limit
        low, high = (low, middle) if inside else (middle, high)
    return float(high)
