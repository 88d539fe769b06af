"""Friction that builds up over a way, in time steps.

Let x be a coordinate's friction, x0 before the step, and F its limit there under the loads of the
step before. A spring of stiffness F/d in series with the slider gives, at the end of the step,

    v' + C (x' - x0) = 0,     C = d/(F dt)

while |x'| is within its static limits; else it slips, as without a way. So C is added to the
diagonal of the step's problem, and a coordinate that "sticks" there builds up.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.forward.workspace import Workspace
from pinfric.friction.problem import Problem


class BuildUp:
    """What has built up along the coordinates of a simulation.

    Attributes:
        way: (nc,) rad or m; 0: at once.
        builds: (nc,) bool, where it is not at once.
        share: (nc,) z, of the friction in motion against forward motion; beyond 1 where friction
            at rest is larger.
    """

    def __init__(self, ws: Workspace) -> None:
        coordinates, ways = ws.plan.coordinates, ws.scene.ways
        self.way = np.zeros(len(coordinates.dry))
        if ways is not None:
            self.way = np.where(coordinates.dry, ways.way[coordinates.velocity_index], 0.0)
        self.builds, self.share = self.way > 0.0, np.zeros(len(self.way))

    def note(self, ws: Workspace) -> None:
        """Take over the friction of the present solution: what slips has built up in full."""
        if self.builds.any():
            limit = _limits(ws.problem, ws.modes.load, -ws.modes.friction)
            share = -ws.modes.friction / np.maximum(limit, 1e-300)
            self.share = np.where(ws.modes.stuck & (limit > 0.0), share, ws.modes.direction)

    def add(self, ws: Workspace, step: float) -> None:
        """Add it to the problem of a step (s), whose modes hold the loads of the step before."""
        if self.builds.any():
            problem = ws.problem
            limit = _limits(problem, ws.modes.load, self.share)
            builds = np.flatnonzero(self.builds & (limit > 0.0))
            spring = self.way[builds] / (limit[builds] * step)
            problem.rate_slope[builds, builds] += spring
            problem.rate_free[builds] += spring * self.share[builds] * limit[builds]


def _limits(problem: Problem, load: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(nc,) friction in motion against motion in the direction of `way` (nc,), N m or N."""
    limit = np.zeros(len(way))
    for s, c in enumerate(problem.coordinate):
        size = abs(problem.ratio[s])
        against = 0 if problem.ratio[s] * way[c] > 0.0 else 1
        limit[c] += size * (problem.mu_slip[s] * load[s] + problem.coulomb_slip[s, against])
    return limit
