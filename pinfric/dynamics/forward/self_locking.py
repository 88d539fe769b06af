"""Self-locking gears: whether the motors' torques determine the motion, and all answers if not.

While one moves, u - I s' = F(t) with F as in `drives`. The accelerations follow from it for every
motor torque if and only if

    diag(least slope) + I^1/2 W I^1/2,    W = S M^-1 S^T without what sticks

is positive definite. Otherwise every line of every gear is tried. A solution is stable, one at
which a shaft with a little compliance would stay, if the matrix is positive definite with the
slopes of the solution's own lines.

At rest such a gear may hold little and much load and slip between: several intervals.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from math import prod

import numpy as np

from pinfric.dynamics.problem.machine import Machine
from pinfric.friction.dense import affine
from pinfric.model.drives import (
    gear_line,
    held_efforts,
    slope_range,
)

#: Up to so many choices of what gears hold, and of lines, are tried; of lines where bearings follow
#: their loads.
_MOST_HOLDS, _MOST_LINES, _MOST_LOADED = 64, 200_000, 4096
#: A gear's effort beyond a line by this share of all efforts may be rounding.
_ROUNDING = 1e-9


class LockingGears:
    """The self-locking gears of a workspace.

    Attributes:
        gears: (n,) which drives they are.
        exceeded: whether there were more choices of lines than are tried; set back by its user.
    """

    def __init__(self, machine: Machine) -> None:
        """Take the machine, whose lines of gears and modes are written."""
        drives = machine.plan.drives
        self._table, self._coordinate = drives.gears, drives.gear_coordinate
        slopes = [self._least_slopes(np.full(len(self._coordinate), x)) for x in (0.0, 1e6)]
        self.gears = np.flatnonzero((np.array(slopes) <= 0.0).any(axis=0))
        self._machine, self._lines, self._modes = machine, machine.lines, machine.modes
        self.exceeded = False

    def jam(self, v: np.ndarray) -> tuple[int, float, float] | None:
        """Return the gear that jams; None if motor torques determine the acceleration at v (nv,).

        Returns:
            The drive, the least eigenvalue of the module's text, and the rotor inertia (kg m^2)
            above which this gear does not jam.
        """
        moves = self._moves()
        if not moves[self.gears].any():
            return None
        w, speed = self._lines, np.abs(self._machine.kinematics.S @ v)
        share = np.where(w.way == 0.0, 1.0, np.abs(w.way))
        back = (1.0 + share * (self._least_slopes(speed) - 1.0))[moves]
        root, W = np.sqrt(w.reflected[moves]), self._coupling(moves)
        E = np.diag(back) + root[:, None] * W * root
        size, axes = np.linalg.eigh(E)
        if size[0] > 0.0:
            return None
        worst = int(np.argmax(np.where(back <= 0.0, np.abs(axes[:, 0]), -1.0)))
        others = np.arange(len(back)) != worst
        others &= np.diag(E) > 0.0
        across = root[others] * W[worst, others]
        left = W[worst, worst] - across @ np.linalg.pinv(E[np.ix_(others, others)]) @ across
        d = int(np.flatnonzero(moves)[worst])
        enough = -back[worst] / left if left > 0.0 else np.inf
        return d, float(size[0]), float(enough) / self._table.ratio[d] ** 2

    def _least_slopes(self, speed: np.ndarray) -> np.ndarray:
        """The least slope of each gear's lines at speeds (na,) of the joints."""
        return np.array([slope_range(self._table, d, x)[0] for d, x in enumerate(speed.tolist())])

    def choices(self, v: np.ndarray, given: np.ndarray) -> Iterator[tuple[np.ndarray, bool]]:
        """Yield efforts (na,) on every choice of lines that may fit, and whether it is stable.

        The present modes must be solved, on any lines. Where no friction follows loads all is
        linear, and lines that do not fit are left out.

        Args:
            v: (nv,). given: (na,) r T_m (N m or N at the joint).
        """
        moves = np.flatnonzero(self._moves())
        every = [self._lines_of(int(d), v) for d in moves]
        w, m, p = self._lines, self._modes, self._machine.problem
        slides = ~m.stuck[p.coordinate[p.contact_site]]
        loaded = bool((p.mu_slip[p.contact_site] * slides).any())
        if prod(len(lines) for lines in every) > (_MOST_LOADED if loaded else _MOST_LINES):
            self.exceeded = True
            return
        table = np.array(list(product(*every)))
        inertia, W, t = w.reflected[moves], self._coupling(self._moves()), np.empty(len(given))
        affine(self._machine.maps.delivered, m.friction, t)
        A = inertia[:, None] * W + np.eye(len(moves)) * table[:, :, 0][:, None, :]
        fits = np.ones(len(table), dtype=bool)
        if not loaded and np.isfinite(t).all():
            rotors = (given - w.offset - w.slope * t)[moves] - inertia * (W @ t[moves])
            right = (given - w.spent)[moves] - table[:, :, 1] - rotors
            fits = np.linalg.det(A) != 0.0
            found = np.full(right.shape, np.nan)
            found[fits] = np.linalg.solve(A[fits], right[fits][:, :, None])[:, :, 0]
            slack = _ROUNDING * (np.abs(found).max(axis=1) + np.abs(given).max())[:, None]
            inside = (table[:, :, 2] - slack <= found) & (found <= table[:, :, 3] + slack)
            fits = inside.all(axis=1)
        root = np.sqrt(inertia)
        for lines in table[fits]:
            least = np.linalg.eigvalsh(np.diag(lines[:, 0]) + root[:, None] * W * root)[0]
            efforts = w.delivered.copy()
            efforts[moves] = [_inside(low, high) for low, high in lines[:, 2:]]
            yield efforts, bool(least > 0.0)

    def ways_to_hold(self) -> Iterator[np.ndarray]:
        """Yield efforts (na,), one for each choice of the loads that gears at rest hold."""
        sticks = self._coordinate >= 0
        sticks[sticks] = self._modes.stuck[self._coordinate[sticks]]
        every = [(int(d), self._held(int(d))) for d in self.gears if sticks[d]]
        every = [(d, ends) for d, ends in every if len(ends) > 1]
        if np.prod([len(ends) for _, ends in every]) > _MOST_HOLDS:
            return
        efforts = self._lines.delivered.copy()
        for choice in product(*(ends for _, ends in every)):
            for (d, _), (low, high) in zip(every, choice, strict=True):
                efforts[d] = _inside(low, high)
            yield efforts.copy()

    def by_coordinate(self, rests: np.ndarray) -> list[list[int]]:
        """Return these gears where coordinates rest (nc,), those on one coordinate together."""
        found: dict[int, list[int]] = {}
        for d in self.gears.tolist():
            c = int(self._coordinate[d])
            if c >= 0 and rests[c]:
                found.setdefault(c, []).append(d)
        return list(found.values())

    def _moves(self) -> np.ndarray:
        """(na,) bool: drives that do not stick, with or without a gear."""
        stuck = np.append(self._modes.stuck, False)
        return np.asarray(~stuck[self._coordinate])

    def _coupling(self, moves: np.ndarray) -> np.ndarray:
        """W = S M^-1 S^T of the drives in motion, M without rotors, what sticks or closes fixed."""
        k, w, closure = self._machine.kinematics, self._lines, self._machine.plan.closure
        rises = w.slope > 0.0
        rotors = np.where(rises, w.reflected / np.where(rises, w.slope, 1.0), 0.0)
        inertia = self._machine.maps.M - (k.S * rotors[:, None]).T @ k.S
        S, J = k.S[moves], k.J[0, closure.off_joint : closure.solved]
        fixed = np.concatenate([J, k.D[self._modes.stuck]])
        of_rates, of_fixed = np.linalg.solve(inertia, S.T), np.linalg.solve(inertia, fixed.T)
        left = (
            (S @ of_fixed) @ np.linalg.pinv(fixed @ of_fixed, hermitian=True) @ (fixed @ of_rates)
        )
        return np.asarray(S @ of_rates - left)

    def _lines_of(self, d: int, v: np.ndarray) -> list[tuple[float, float, float, float]]:
        """(slope, offset, least, greatest effort) of every line of a gear in motion."""
        way, lines, start = self._lines.way[d], list[tuple[float, float, float, float]](), -np.inf
        if way == 0.0:
            return [(1.0, 0.0, -np.inf, np.inf)]
        speed = abs(float(self._machine.kinematics.S[d] @ v))
        while start < np.inf:
            slope, offset, low, start = gear_line(
                self._table, d, float(np.sign(way)), speed, False, start
            )
            lines.append((1.0 + abs(way) * (slope - 1.0), abs(way) * offset, low, start))
        return lines

    def _held(self, d: int) -> list[tuple[float, float]]:
        """The intervals of efforts that a gear at rest holds."""
        first, last = self._table.first[d], self._table.last[d]
        found = np.empty((2 * int((last - first).sum()) + 1, 2))
        count = held_efforts(self._table, d, float(self._lines.arriving[d]), found)
        return [(float(low), float(high)) for low, high in found[:count]]


def _inside(low: float, high: float) -> float:
    """An effort well between two, of which one or both may be infinite."""
    if np.isinf(low) and np.isinf(high):
        return 0.0
    if np.isinf(low):
        return high - 1.0 - abs(high)
    return low + 1.0 + abs(low) if np.isinf(high) else 0.5 * (low + high)
