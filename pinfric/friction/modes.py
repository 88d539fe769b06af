"""Which coordinates stick and which slip: the search over modes (Wu, Yang, Haug 1984).

At rest stick has priority: a coordinate slips only where no admissible stick exists. So the modes
wanted are the consistent ones with the fewest slipping coordinates; two different accelerations
with equally few are ambiguous, unless it is known what was sticking until now and just one of them
lets it stick on. Up to `MOST_ENUMERATED` coordinates at rest that is decided by enumeration,
exactly; beyond, by pivoting, which finds consistent modes but cannot say that they are the only
ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from itertools import combinations, product

import numpy as np

from pinfric.friction.consistency import SHOULD_STICK, try_modes
from pinfric.friction.problem import Problem

#: Up to so many coordinates at rest all modes are looked at: 3^8 = 6561 solves.
MOST_ENUMERATED = 8
#: Accelerations closer than this, relative to their size, are the same one.
_SAME = 1e-6


class Found(IntEnum):
    """How a search for modes ended."""

    SOLVED = 0
    NONE = 1
    AMBIGUOUS = 2
    NOT_CONVERGED = 3


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of all coordinates and the solution in them; every array is overwritten by a search.

    Attributes:
        stuck: (nc,) bool.
        direction: (nc,) of the slip, -1 or 1; 0 where it sticks or has no dry friction.
        at_rest: (nc,) bool, which modes are open.
        friction: (nc,) N m or N; the guess of the next solve.
        load: (ns,) N m or N.
        rate: (nc,) relative acceleration, or what the problem says.
        verdict: (nc,) int, see `consistency.judge`.
        figures: (2,) contraction and passes of the solve.
    """

    stuck: np.ndarray
    direction: np.ndarray
    at_rest: np.ndarray
    friction: np.ndarray
    load: np.ndarray
    rate: np.ndarray
    verdict: np.ndarray
    figures: np.ndarray

    @classmethod
    def of(cls, nc: int, load: np.ndarray) -> Modes:
        """Make the arrays for nc coordinates; `load` (ns,) is given."""
        friction = np.zeros(nc)
        friction[:1] = np.nan  # no guess yet
        return cls(
            np.zeros(nc, dtype=bool), np.zeros(nc), np.zeros(nc, dtype=bool), friction,
            load, np.zeros(nc), np.zeros(nc, dtype=np.int64), np.zeros(2),
        )  # fmt: skip

    def arrays(self) -> tuple[np.ndarray, ...]:
        """Return all arrays in the order of the attributes."""
        return (self.stuck, self.direction, self.at_rest, self.friction, self.load, self.rate,
                self.verdict, self.figures)  # fmt: skip

    def copy(self) -> Modes:
        """Return modes with arrays of their own."""
        return Modes(*(array.copy() for array in self.arrays()))

    def take(self, other: Modes) -> None:
        """Overwrite these arrays with another's."""
        for mine, theirs in zip(self.arrays(), other.arrays(), strict=True):
            mine[:] = theirs


def solve(problem: Problem, modes: Modes) -> tuple[int, int]:
    """Solve the modes as they are; return (number of solutions or -1, how many obey the laws)."""
    found: tuple[int, int] = try_modes(
        problem, modes.stuck, modes.direction, modes.at_rest, modes.friction, modes.friction,
        modes.load, modes.rate, modes.verdict, modes.figures,
    )  # fmt: skip
    if found[0] <= 0:
        modes.friction[:1] = np.nan  # what is there is no guess for the next solve
    return found


def search(
    problem: Problem,
    modes: Modes,
    forced: Mapping[int, float] | None = None,
    held: np.ndarray | None = None,
) -> Found:
    """Find the modes of the coordinates at rest; those that move keep theirs.

    Args:
        problem: `Problem`.
        modes: with `at_rest`, and the modes of the others, set; overwritten with the answer.
        forced: coordinate -> direction it must slip in (it has just broken away).
        held: (nc,) bool, what has been sticking until now: among several answers with equally few
            slipping coordinates, the one that lets all of these stick on.
    """
    free = np.flatnonzero(modes.at_rest)
    if not free.size:
        return only_candidate(*solve(problem, modes))
    forced = forced or {}
    modes.stuck[free], modes.direction[free] = True, 0.0
    for c, direction in forced.items():
        modes.stuck[c], modes.direction[c] = False, direction
    if len(free) > MOST_ENUMERATED:
        return pivot(problem, modes, forced)
    status = Found.NONE
    for level in range(len(forced), len(free) + 1):
        consistent: list[Modes] = []
        for _ in _candidates(modes, free, level, forced):
            solutions, obeying = solve(problem, modes)
            if solutions < 0:
                status = Found.NOT_CONVERGED
            if obeying > 1:
                return Found.AMBIGUOUS
            if obeying == 1 and not any(same(modes, other) for other in consistent):
                consistent.append(modes.copy())
        if len(consistent) > 1 and held is not None:
            stay = held & ~np.isin(np.arange(len(held)), list(forced))
            consistent = [one for one in consistent if one.stuck[stay].all()] or consistent
        if consistent:
            modes.take(consistent[0])
            return Found.SOLVED if len(consistent) == 1 else Found.AMBIGUOUS
    return status


@dataclass
class Patience:
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


def pivot(problem: Problem, modes: Modes, forced: Mapping[int, float] | None = None) -> Found:
    """Find consistent modes from those given, by block pivoting with Murty's rule as a safeguard.

    Every coordinate that breaks its law changes its mode, all at once; when that stops reducing
    their number, only the last of them does, which ends for certain where loads do not depend on
    friction and static equals kinetic (a P-matrix).

    Args:
        problem, modes, forced: see `search`; here the modes given are where the search starts.
    """
    fixed, all_at_once = set(forced or {}), Patience(len(modes.stuck) + 1)
    for _ in range(50 + 20 * len(modes.stuck)):
        solutions, obeying = solve(problem, modes)
        if solutions < 0:
            return Found.NOT_CONVERGED
        if solutions == 0:
            return Found.NONE
        if obeying:
            return Found.SOLVED
        wrong = [int(c) for c in np.flatnonzero(modes.verdict) if c not in fixed]
        if not wrong:
            return Found.NONE  # what must slip would not
        for c in wrong if all_at_once.lasts(len(wrong)) else wrong[-1:]:
            sticks = modes.verdict[c] == SHOULD_STICK
            modes.stuck[c] = sticks
            modes.direction[c] = 0.0 if sticks else float(modes.verdict[c])
    return Found.NONE


def only_candidate(solutions: int, obeying: int) -> Found:
    """Return how a search with a single candidate ends, from what `solve` returns."""
    if solutions < 0:
        return Found.NOT_CONVERGED
    return (Found.NONE, Found.SOLVED, Found.AMBIGUOUS)[obeying]


def _candidates(
    modes: Modes, free: np.ndarray, level: int, forced: Mapping[int, float]
) -> Iterator[None]:
    """Write all modes with `level` slipping coordinates into `modes`, one after the other."""
    others = [int(c) for c in free if c not in forced]
    for slipping in combinations(others, level - len(forced)):
        for directions in product((1.0, -1.0), repeat=len(slipping)):
            modes.stuck[free], modes.direction[free] = True, 0.0
            for c, direction in (*forced.items(), *zip(slipping, directions, strict=True)):
                modes.stuck[c], modes.direction[c] = False, direction
            yield


def same(one: Modes, other: Modes) -> bool:
    """Return whether two solutions are one acceleration (what is at its limit slips at rate 0)."""
    difference = np.abs(one.friction - other.friction).max(initial=0.0)
    size = max(np.abs(one.friction).max(initial=0.0), np.abs(other.friction).max(initial=0.0))
    return bool(difference <= _SAME * size)
