"""Distances of sticking friction from its static limits, for integrators."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.machine import Machine
from pinfric.friction.gears import gear_margins
from pinfric.friction.given_modes import ROUNDING
from pinfric.friction.rest import Mechanism

#: Margin used in place of an infinite one.
_MOST_MARGIN = 1e300


class Margins:
    """The margins of a workspace's solution."""

    def __init__(self, machine: Machine, mechanism: Mechanism) -> None:
        self._machine, self._modes, self._mechanism = machine, machine.modes, mechanism

    def both(self) -> np.ndarray:
        """Return the distances of sticking friction from its two static limits (2, nc), N m or N.

        The limits of a self-locking gear may be infinite; there it is the distance of the torque at
        the gear from that at which it slips, see `gear_margins`.
        """
        x, limits = self._modes.friction, self._machine.results
        out = np.array([x - limits.least, limits.most - x])
        for ball in self._mechanism.balls:
            size, most = np.linalg.norm(x[ball]), limits.most[ball]
            out[:, ball] = most + size, most - size
        p, locking_gears = self._machine.problem, dict[int, tuple[float, float]]()
        for g in np.flatnonzero(p.gear_lines[..., 0].min(axis=(1, 2)) <= 0.0):
            c = int(p.gear_coordinate[g])
            if self._modes.stuck[c]:  # of several on one joint the one that holds best
                ends = gear_margins(p, self._modes, g)
                locking_gears[c] = max(locking_gears.get(c, ends), ends, key=min)
        for c, (backward, forward) in locking_gears.items():
            out[:, c] = forward, backward
        return np.minimum(out, _MOST_MARGIN)

    def rounding(self) -> np.ndarray:
        """Return the rounding error of the margins (nc,), including that of loads that cancel."""
        problem = self._machine.problem
        slope = np.diag(problem.rate_slope)
        terms = problem.rate_scale / np.where(slope > 0.0, slope, np.inf)
        return np.asarray(ROUNDING * (self.width + terms))

    @property
    def width(self) -> np.ndarray:
        """(nc,) distance between the two limits of the margins; 0 for infinite limits."""
        margins = self.both()
        return np.where((margins < _MOST_MARGIN).all(axis=0), margins.sum(axis=0), 0.0)

    @property
    def nearest(self) -> np.ndarray:
        """(nc,) the smaller of each coordinate's margins."""
        return self.both().min(axis=0)

    def breakaway_direction(self) -> np.ndarray:
        """Return the direction (nc,) in which sticking coordinates would break away.

        In an open chain the nearer limit determines it. In a mechanism it is a first guess,
        `Mechanism.way`.
        """
        if self._mechanism.closed:
            return self._mechanism.way.copy()
        below, above = self.both()
        return np.where(above < below, -1.0, 1.0)
