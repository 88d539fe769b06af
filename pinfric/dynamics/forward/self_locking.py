"""Self-locking gears at rest: the loads that they can hold, and those at which they slip.

If motor and load push a self-locking gear in the same direction, it holds small and large loads and
slips at loads between. It then slips on lines that fall. The usual search does not find these,
because it assumes that slip opposes the push. So the ways in which such gears hold and slip are
tried one after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations, compress, product

import numpy as np

from pinfric.dynamics.problem.gearing import MUCH
from pinfric.dynamics.problem.machine import Machine
from pinfric.friction.consistency import SHOULD_STICK
from pinfric.friction.modes import Modes
from pinfric.model.drives import gear_slips, self_locking_gears

#: Largest number of gears for which all ways to hold, or to slip on falling lines, are tried.
_MOST = 6


class LockingGears:
    """The self-locking gears of a workspace.

    Attributes:
        gears: (n,) which drives they are.
    """

    def __init__(self, machine: Machine) -> None:
        """Take the machine, whose lines of gears and modes are written."""
        drives = machine.plan.drives
        self.gears = np.flatnonzero(self_locking_gears(drives.gears))
        self._table, self._coordinate = drives.gears, drives.gear_coordinate
        self._lines, self._modes = machine.lines, machine.modes
        self._falling: tuple[int, ...] = ()

    def may_slip(self) -> np.ndarray:
        """Return in which directions coordinates may slip from rest: bool (2, nc), forward first.

        The problem must be coupled. A self-locking gear slips only the way its motor pushes it.
        """
        found = np.ones((2, len(self._modes.stuck)), dtype=bool)
        for d, c in self._at_rest():
            for side, direction in enumerate((1.0, -1.0)):
                low, high = gear_slips(self._table, d, direction, False, self._lines.arriving[d])
                found[side, c] &= low < high
        return found

    def settle(
        self, solve: Callable[[], tuple[int, int]], delivered: np.ndarray, falls: int
    ) -> tuple[int, int]:
        """Solve the present modes with a given number of gears slipping on lines that fall.

        Args:
            solve: solves the modes from the lines that are written, as `rest.solve` does.
            delivered: (na,) the loads around which gears are asked first what they hold.
            falls: how many.

        Returns:
            see `rest.solve`: of the first choice of gears that obeys, else of the last.
        """
        m, rests, found = self._modes, self._modes.at_rest.copy(), (0, 0)
        able = [
            d
            for d, c in self._at_rest()
            if not m.stuck[c]
            and self._may_wedge(d)
            and m.direction[c] * self._lines.arriving[d] > 0.0
        ]
        for falling in combinations(able, falls):
            self._choose_lines(delivered, falling)
            found = solve()
            if found[0] > 0 and self._hold_otherwise():
                found = solve()
            m.at_rest[:] = rests
            there = self._coordinate[list(falling)]
            against = there[m.direction[there] * m.rate[there] < 0.0]
            m.verdict[against] = SHOULD_STICK
            if found[1] and not against.size:
                return found
            found = min(found[0], 1), 0
        return found

    def take_fallen(self) -> None:
        """Treat gears that slip on falling lines as moving, so that no other lines are tried."""
        self._modes.at_rest[self._coordinate[list(self._falling)]] = False

    def let_fall(self, start: Modes, delivered: np.ndarray) -> Iterator[np.ndarray]:
        """Yield loads (na,) with more and more gears at rest that slip on falling lines.

        Args:
            start: the modes to begin with; those that fall are regarded as moving.
            delivered: see `settle`.
        """
        m = self._modes
        m.take(start)
        wedged = [(d, c) for d, c in self._at_rest() if self._may_wedge(d)][:_MOST]
        for falls in range(1, len(wedged) + 1):
            for falling in combinations(wedged, falls):
                m.take(start)
                loads = delivered.copy()
                for d, c in falling:
                    m.at_rest[c] = m.stuck[c] = False
                    m.direction[c] = np.sign(self._lines.arriving[d])
                    loads[d] = -m.direction[c] * self._much
                yield loads

    def ways_to_hold(self, couple: Callable[[], None]) -> Iterator[bool]:
        """Yield with each choice of loads that these gears hold; then the first again.

        Args:
            couple: writes the coupled problem, with other lines of gears.

        What is yielded: whether these are all choices that there are.
        """
        c_of, delivered = self._coordinate, self._lines.delivered.copy()
        sticks = (c_of[self.gears] >= 0) & self._modes.stuck[c_of[self.gears]]
        wedged = [d for d in self.gears[sticks].tolist() if self._may_wedge(d)]
        every = len(wedged) <= _MOST
        wedged = wedged[:_MOST]
        yield every
        for choice in list(product((False, True), repeat=len(wedged)))[1:]:
            self._lines.delivered[:] = delivered
            for d in compress(wedged, choice):
                self._take_other_side(d)
            couple()
            yield every
        self._lines.delivered[:] = delivered
        couple()

    def by_coordinate(self, rests: np.ndarray) -> list[list[int]]:
        """Return these gears where coordinates rest (nc,), those on one coordinate together."""
        found: dict[int, list[int]] = {}
        for d in self.gears.tolist():
            c = int(self._coordinate[d])
            if c >= 0 and rests[c]:
                found.setdefault(c, []).append(d)
        return list(found.values())

    @property
    def _much(self) -> float:
        return float(MUCH * self._lines.all_forces[0])

    def _at_rest(self) -> list[tuple[int, int]]:
        """These gears, and their coordinates, whose modes are sought."""
        c_of, rests = self._coordinate, self._modes.at_rest
        return [(int(d), int(c_of[d])) for d in self.gears if c_of[d] >= 0 and rests[c_of[d]]]

    def _may_wedge(self, d: int) -> bool:
        """Whether motor and load may push a gear at rest in the same direction."""
        return bool(np.isfinite(self._lines.held[d]).any())

    def _choose_lines(self, delivered: np.ndarray, falling: tuple[int, ...]) -> None:
        """Write the first lines: of gears that stick by given loads, of others by how they slip."""
        m, lines, at_rest = self._modes, self._lines, self._at_rest()
        lines.delivered[self.gears] = delivered[self.gears]
        for d, c in at_rest:
            if not m.stuck[c]:
                lines.delivered[d] = m.direction[c] * (-self._much if d in falling else self._much)
        m.at_rest[self._coordinate[list(falling)]] = False  # no other line is taken in its place
        self._falling = falling

    def _hold_otherwise(self) -> bool:
        """Let gears that break their law hold the load on the other side; return whether any do."""
        m = self._modes
        tried = [d for d, c in self._at_rest() if m.stuck[c] and m.verdict[c]]
        tried = [d for d in tried if self._may_wedge(d)]
        for d in tried:
            self._take_other_side(d)
        return bool(tried)

    def _take_other_side(self, d: int) -> None:
        """Let a gear hold the load beyond those at which it slips, on the other side."""
        self._lines.delivered[d] = self._much if self._lines.held[d, 0] == -np.inf else -self._much
