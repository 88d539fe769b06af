"""Self-locking gears at rest: what they may hold, and where they slip beyond it.

One that motor and load push the same way holds little and much load, and slips between: on lines
that fall, which a search does not find that takes what slips to oppose its push. So the ways in
which such gears hold and slip are tried one after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from pinfric.dynamics.layout import Layout
from pinfric.dynamics.machine import Work
from pinfric.friction.modes import Found, Modes
from pinfric.friction.search import Reach
from pinfric.model.drives import may_lock

#: So many gears are let hold and slip in all ways (3^n searches at most, of six 0.7 s); loads that
#: are more than any.
_MOST, _MUCH = 6, 1e6
#: How: beyond the loads at which it slips, on the other side; between them, on a line that falls.
_OTHERWISE, _FALLS = 1, 2


class LockingGears:
    """The self-locking gears of a workspace.

    Attributes:
        gears: (n,) which drives they are.
    """

    def __init__(self, layout: Layout, work: Work, modes: Modes) -> None:
        """Take the tables, and the buffers that are written: lines of gears, and modes."""
        self.gears = np.flatnonzero(may_lock(layout.gears))
        self._coordinate, self._work, self._modes = layout.gear_coordinate, work, modes

    def search(
        self,
        settle: Callable[[int | None], Found],
        couple: Callable[[], None],
        reach: Reach,
        thorough: bool,
    ) -> tuple[Found, bool]:
        """Settle a search; where things slip, let these gears hold or slip otherwise, too.

        Args:
            settle: searches the modes of what is at rest, all gears on their lines; given a
                number, only modes in which so many of them slip.
            couple: writes the coupled problem, with other lines of gears.
            reach: its passes are those of all searches together.
            thorough: True: of all answers the one in which least slips; False: the first.

        Returns:
            what was found, and whether its modes and lines are written, but not yet solved.
        """
        start, m, w = self._modes.copy(), self._modes, self._work
        found = settle(None)
        if not self.gears.size or (
            found == Found.SOLVED and not (thorough and self._slipping(start))
        ):
            return found, False
        fewest = self._slipping(start) if found == Found.SOLVED else len(m.stuck) + 1
        best = found, m.copy(), w.gear_way.copy(), w.delivered.copy()
        lines = best[2:]
        m.take(start)
        couple()
        wedged = self._wedged(start.at_rest)[:_MOST]
        choices = sorted(product((0, _OTHERWISE, _FALLS), repeat=len(wedged)),
                         key=lambda each: (each.count(_FALLS), sum(each)))  # fmt: skip
        for slipping, choice in product(range(min(fewest, len(m.stuck) + 1)), choices[1:]):
            others = slipping - choice.count(_FALLS)
            if slipping >= fewest or reach.left <= 0:
                break
            if others < 0:
                continue
            m.take(start)
            w.gear_way[:], w.delivered[:] = lines
            for d, how in zip(wedged, choice, strict=True):
                self._wedge(d, how)
            couple()
            other = settle(others)
            falls = [self._coordinate[d] for d, how in zip(wedged, choice, strict=True)
                     if how == _FALLS]  # fmt: skip
            slips = bool((m.direction[falls] * m.rate[falls] >= 0.0).all())
            if other == Found.SOLVED and slips and self._slipping(start) < fewest:
                fewest = self._slipping(start)
                best = other, m.copy(), w.gear_way.copy(), w.delivered.copy()
        found, modes, w.gear_way[:], w.delivered[:] = best
        if found == Found.NONE and reach.left <= 0:
            found = Found.UNDECIDED
        m.take(modes)
        m.at_rest[self._coordinate[self.gears]] = False  # decided: lines that fall are followed
        couple()
        return found, found == Found.SOLVED

    def begin(self, delivered: np.ndarray) -> None:
        """Choose the first lines: of gears that stick by given loads, of others where they drive.

        Args:
            delivered: (na,) around which gears are asked what they hold.
        """
        m, w = self._modes, self._work
        for d in self.gears:
            c = self._coordinate[d]
            slips = c >= 0 and m.at_rest[c] and not m.stuck[c]
            w.delivered[d] = m.direction[c] * _MUCH * w.push_size[0] if slips else delivered[d]

    def ways_to_hold(self, couple: Callable[[], None]) -> Iterator[bool]:
        """Yield with each choice of loads that these gears hold; then the first again.

        Args:
            couple: see `search`.

        What is yielded: whether these are all choices that there are.
        """
        wedged, delivered = self._wedged(self._modes.stuck), self._work.delivered.copy()
        every = len(wedged) <= _MOST
        wedged = wedged[:_MOST]
        yield every
        for choice in list(product((0, _OTHERWISE), repeat=len(wedged)))[1:]:
            self._work.delivered[:] = delivered
            for d, how in zip(wedged, choice, strict=True):
                self._wedge(d, how)
            couple()
            yield every
        self._work.delivered[:] = delivered
        couple()

    def by_coordinate(self, rests: np.ndarray) -> list[list[int]]:
        """Return these gears where coordinates rest (nc,), those on one coordinate together."""
        found: dict[int, list[int]] = {}
        for d in self.gears.tolist():
            c = int(self._coordinate[d])
            if c >= 0 and rests[c]:
                found.setdefault(c, []).append(d)
        return list(found.values())

    def _wedged(self, rests: np.ndarray) -> list[int]:
        """The gears at rest (nc,) that motor and load push the same way, or may."""
        c_of, held = self._coordinate, self._work.held
        return [int(d) for d in self.gears if c_of[d] >= 0 and rests[c_of[d]]
                and np.isfinite(held[d]).any()]  # fmt: skip

    def _slipping(self, start: Modes) -> int:
        """How many coordinates slip that were at rest."""
        return int((start.at_rest & ~self._modes.stuck).sum())

    def _wedge(self, d: int, how: int) -> None:
        """Let a gear hold the load beyond those at which it slips, or slip there."""
        m, w, c = self._modes, self._work, self._coordinate[d]
        much = _MUCH * w.push_size[0]
        if how == _OTHERWISE:
            w.delivered[d] = much if w.held[d, 0] == -np.inf else -much
        elif how == _FALLS:
            m.at_rest[c] = m.stuck[c] = False
            m.direction[c] = w.gear_way[d] = np.sign(w.arriving[d])
            w.delivered[d] = -m.direction[c] * much
