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
from pinfric.friction.sharing import RANK

#: Nodes after which a proof is given up.
MOST_NODES = 40_000


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
        nodes: of the proof.
    """

    held: bool | None
    use: float
    friction: np.ndarray
    proved: bool
    nodes: int


def decide(problem: Problem, factor: np.ndarray, at_rest: np.ndarray) -> Verdict:
    """Decide whether friction holds the coordinates at rest.

    Args:
        problem: `Problem`; what is not at rest must have no friction that depends on loads.
        factor: (d, nc) A of rate_slope = A^T A.
        at_rest: (nc,) bool, the coordinates with dry friction that rest.
    """
    problem = bounded(problem)
    resting = np.flatnonzero(at_rest & factor.any(axis=0))
    _, size, right = np.linalg.svd(factor[:, resting], full_matrices=False)
    rank = int((size > RANK * size[:1]).sum())
    A = right[:rank]
    push = A @ problem.rate_free[resting]
    # rates = A^T (push + size^2 A x): what does not fit moves whatever the friction
    unmatched = np.abs(problem.rate_free[resting] - A.T @ push)
    if (unmatched > 1e-7 * problem.rate_scale[resting].max(initial=0.0) + 1e-300).any():
        return Verdict(False, np.inf, np.full(len(at_rest), np.nan), True, 0)
    rest, planar, certain = make_rest(problem, resting, A, -push / size[:rank] ** 2)

    def friction(z: np.ndarray) -> np.ndarray:
        x = np.zeros(len(at_rest))
        x[resting] = rest.x0 + rest.N @ z
        return x

    z = np.zeros(rest.N.shape[1])
    use = float(descend(rest, z))
    if use <= 1.0 or not z.size:
        return Verdict(use <= 1.0, use, friction(z), True, 0)
    if not planar:
        return Verdict(None, use, friction(z), False, 0)
    near = z.copy()
    outcome, nodes = prove(rest, near, MOST_NODES)
    if outcome == 1:
        return Verdict(True, float(descend(rest, near)), friction(near), True, nodes)
    held = False if outcome == 0 else None
    return Verdict(held, use, friction(z), held is False and certain, nodes)
