"""The ways to slip that kinematics allows, out of 3^n for n joints at rest."""

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
#: Accelerations looked at, so many times those without friction.
_FAR = 1e9

#: Coordinate -> direction of its slip; a joint is named by its first coordinate, a ball's is 1.
Ways = dict[int, float]


class PossibleWays:
    """The ways to slip of relative accelerations r = c + A^T w with any w (d,).

    They are the faces that n planes form in d dimensions (Zaslavsky 1975): three for a four-bar's
    pins, not 3^4.

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

    def levels(self, forced: Ways, fewest: int = 0) -> Iterator[list[Ways]]:
        """Yield the ways with `fewest` joints that slip beside the forced, then with one more, ...

        Args:
            forced: joints that slip in any case, and how.
            fewest: number of the others at first.
        """
        others = [c for c in self.mechanism.joints(self.at_rest) if c not in forced]
        for level in range(fewest, len(others) + 1):
            sets = combinations(others, level)
            yield [forced | ways for slipping in sets for ways in self._ways(slipping, forced)]

    def _ways(self, slipping: tuple[int, ...], forced: Ways) -> Iterator[Ways]:
        """Yield the directions in which these joints can slip while the others stick."""
        block, ball = self.mechanism.block, self.mechanism.ball
        balls = {c: 1.0 for c in slipping if ball[c]}
        order = [c for c in slipping if not ball[c]]
        if self.free:
            for signs in product((1.0, -1.0), repeat=len(order)):
                yield balls | dict(zip(order, signs, strict=True))
            return
        # 1. the w at which the others rest, start + N y
        slips = np.array([block[c] for c in (*slipping, *forced)])
        stuck = self.at_rest & ~np.equal.outer(block, slips).any(axis=1)
        rows = self.A[stuck]
        U, size, right = np.linalg.svd(rows)
        rank = int((size > RANK).sum())
        start, N = -right[:rank].T @ (U[:, :rank].T @ self.c[stuck] / size[:rank]), right[rank:].T
        if not self.stands and (np.abs(rows @ start + self.c[stuck]) > self.rounding).any():
            return
        if self.stands:  # what does not move along would stick as well
            for c in slipping:
                if not (np.abs(self.A[block == block[c]] @ N) > RANK).any():
                    return
        # 2. directions, one joint's after the other's
        weakly = {c: way for c, way in forced.items() if not ball[c]}
        rates = np.column_stack([self.A @ N, self.A @ start + self.c])
        waiting: list[Ways] = [{}]
        while waiting:
            ways = waiting.pop()
            if not self._can_move(rates, weakly, ways):
                continue
            if len(ways) == len(order):
                yield balls | ways
                continue
            c = order[len(ways)]
            waiting += [{**ways, c: -1.0}, {**ways, c: 1.0}]

    def _can_move(self, rates: np.ndarray, weakly: Ways, ways: Ways) -> bool:
        """Return whether joints can move in these ways at once; those of `weakly` may stand.

        Args:
            rates: (nc, size + 1) of all joints by (y, 1).
        """
        moving, size = {**ways, **weakly}, rates.shape[1] - 1
        if not moving:
            return True
        rows = -np.array([*moving.values()])[:, None] * rates[[*moving]]
        G, h = np.ascontiguousarray(rows[:, :-1]), rows[:, -1].copy()
        if self.stands:
            h[:] = 0.0
        if size == 0:
            return bool((h <= self.rounding).all())
        s = np.ones(len(moving))
        if not self.stands:
            reach = _FAR * (np.abs(h).max() + self.rounding)
            return bool(least_violation(G, h, s, len(h), reach, np.empty(size)) <= self.rounding)
        if not ways:
            return True
        h[len(ways) :], s[len(ways) :] = -_STILL, _STILL  # G z <= _STILL (1 + m), never below 0
        return bool(least_violation(G, h, s, len(h), 1.0, np.empty(size)) < -RANK)
