"""Can friction hold what rests? A stick found is its own proof; that there is none is proved.

Friction x in equilibrium holds if no joint needs more than its static limit. Limits are convex in
x, so what holds is a difference of convex sets: a search (`least_use`) may end above the limits
although another x holds, at any contraction. Then `branching` finds that one, or proves that there
is none. The answer depends on the state alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.friction.balance import Balance
from pinfric.friction.branching import MOST_NODES, prove
from pinfric.friction.least_use import Rest, descend, make_rest
from pinfric.friction.problem import Problem

#: What is proved is that nothing holds with a use of 1 - _MARGIN.
_MARGIN = 1e-9
#: The least use is known to this part, where so many nodes are enough to show it (of 700 closed
#: chains with up to seven pins none needed 1,000).
LEAST, _NODES_FOR_LEAST = 1e-6, 2_000


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


def decide(
    problem: Problem,
    factor: np.ndarray,
    at_rest: np.ndarray,
    balance: Balance | None = None,
    least: bool = False,
) -> Verdict:
    """Decide whether friction holds the coordinates at rest.

    Args:
        problem: `Problem`; what is not at rest must have no friction that depends on loads.
        factor: (d, nc) A of rate_slope = A^T A.
        at_rest: (nc,) bool, the coordinates with dry friction that rest.
        balance: what the friction of those that could move balances; None: rates of zero.
        least: whether the use is the least, to `LEAST`, not just that of a friction that holds.
    """
    resting = can_move(factor, at_rest)
    balance = balance or Balance.of_rates(problem, factor, resting)
    if balance is None:
        return Verdict(False, np.inf, np.full(len(at_rest), np.nan), True)
    narrow, wide, planar, certain = make_rest(problem, resting, balance)

    def verdict(held: bool | None, proved: bool) -> Verdict:
        use = _least(narrow if certain else wide, wide, z) if least and planar else found
        x = np.zeros(len(at_rest))
        x[resting] = wide.unit * (wide.x0 + wide.N @ z)
        return Verdict(held, use, x, proved)

    z = np.zeros(wide.N.shape[1])
    found = float(descend(wide, z))
    if found <= 1.0 or not z.size:
        return verdict(found <= 1.0, True)
    if not planar:
        return verdict(None, False)
    near = np.zeros_like(z)  # where the search ended is no measure of the limits
    outcome = prove(narrow, near, 1.0, _MARGIN, MOST_NODES)
    if outcome == 1:
        z, found = near, float(descend(wide, near))
        return verdict(True, True)
    return verdict(False if outcome == 0 else None, outcome == 0 and certain)


def can_move(factor: np.ndarray, at_rest: np.ndarray) -> np.ndarray:
    """Return which coordinates of those at rest (nc,) could move at all."""
    return np.flatnonzero(at_rest & factor.any(axis=0))


def _least(narrow: Rest, wide: Rest, z: np.ndarray) -> float:
    """Lower the use at z (dz,) to the least there is, to `LEAST`; overwrite z, return it.

    Args:
        narrow: with a box that holds whatever has a use of at most 1.
        wide: with one for more.
    """
    use = float(descend(wide, z))
    while z.size and len(wide.owner) and use > 0.0:
        near = z.copy()
        rest = narrow if use <= 1.0 else wide
        if prove(rest, near, use * (1.0 - 0.5 * LEAST), 0.5 * LEAST, _NODES_FOR_LEAST) != 1:
            break
        z[:] = near
        use = float(descend(wide, z))
    return use
