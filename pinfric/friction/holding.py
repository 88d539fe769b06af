"""Can friction hold what rests? A stick found is its own proof; that there is none is proved.

Friction x in equilibrium holds if no joint needs more than its static limit. Limits are convex in
x, so what holds is a difference of convex sets: a search (`least_use`) may end above the limits
although another x holds, at any contraction. Then `branching` finds that one, or proves that there
is none. The answer depends on the state alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.friction.branching import prove
from pinfric.friction.least_use import descend, make_rest
from pinfric.friction.problem import Problem, bounded
from pinfric.friction.sharing import FITS, Group


@dataclass(frozen=True)
class Verdict:
    """Whether friction holds.

    Attributes:
        held: True, False, or None where neither a stick nor a proof was found.
        use: the least found of max |x_k| / limit_k, the share of its static limit that the joint
            needs that needs most.
        friction: (nc,) with that use (N m or N).
        proved: an x that holds is its own proof; that none does is proved by branching, where
            friction cannot wedge itself whatever its size.
    """

    held: bool | None
    use: float
    friction: np.ndarray
    proved: bool


def decide(problem: Problem, factor: np.ndarray, at_rest: np.ndarray) -> Verdict:
    """Decide whether friction holds the coordinates at rest.

    Args:
        problem: `Problem`; what is not at rest must have no friction that depends on loads.
        factor: (d, nc) A of rate_slope = A^T A.
        at_rest: (nc,) bool, the coordinates with dry friction that rest.
    """
    problem = bounded(problem)
    resting = np.flatnonzero(at_rest & factor.any(axis=0))
    group = Group.of(factor, resting)
    b, left = group.needs(problem.rate_free[resting])
    if (left > FITS * problem.rate_scale[resting].max(initial=0.0) + 1e-300).any():
        return Verdict(False, np.inf, np.full(len(at_rest), np.nan), True)
    rest, planar, certain = make_rest(problem, resting, group.rates, b)

    def friction(z: np.ndarray) -> np.ndarray:
        x = np.zeros(len(at_rest))
        x[resting] = rest.x0 + rest.N @ z
        return x

    z = np.zeros(rest.N.shape[1])
    use = float(descend(rest, z))
    if use <= 1.0 or not z.size:
        return Verdict(use <= 1.0, use, friction(z), True)
    if not planar:
        return Verdict(None, use, friction(z), False)
    near = np.zeros_like(z)  # where the search ended is no measure of the limits
    outcome = prove(rest, near)
    if outcome == 1:
        return Verdict(True, float(descend(rest, near)), friction(near), True)
    held = False if outcome == 0 else None
    return Verdict(held, use, friction(z), held is False and certain)
