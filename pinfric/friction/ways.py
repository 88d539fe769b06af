"""Combinations of slip directions that kinematics allows, out of 3^n for n joints at rest.

Relative accelerations are r = c + A^T w with any w, so in a mechanism with d degrees of freedom not
every choice of signs is possible. The four pins of a four-bar all slip or none does: three ways in
place of 3^4. In general the ways are the faces that n planes form in d dimensions (Zaslavsky 1975).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from pinfric.friction.balance import RANK
from pinfric.friction.minimax import least_violation
from pinfric.friction.problem import Problem
from pinfric.friction.rest import Mechanism

#: A rate this small beside the terms of its sum counts as zero.
_ROUNDING = 1e-7
#: A rate of a mechanism that stands, with all |w| <= 1, below this is none.
_STILL = 1e-3 * RANK
#: Accelerations looked at, so many times those without friction; and of a mechanism that stands.
_FAR = 1e9

Ways = dict[int, float]


class Kinematics:
    """The relative accelerations that the joints at rest can have.

    Args:
        problem: `Problem`.
        mechanism: `Mechanism`.
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
