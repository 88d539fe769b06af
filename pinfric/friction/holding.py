"""Decides whether friction can hold resting joints, by a search and a proof.

The search (`least_use`) may end above the limits although another x holds: `branching` finds it or
proves that there is none (`notebooks/theory/resting.md`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.friction.balance import Balance
from pinfric.friction.branching import MOST_NODES, prove
from pinfric.friction.law import evaluate, stick_limits
from pinfric.friction.least_use import NOISE, descend, make_rest
from pinfric.friction.problem import Problem
from pinfric.friction.sharing import joint_sizes, share

#: The proof is that nothing holds with a use of 1 - _MARGIN.
_MARGIN = 1e-9
#: Relative accuracy of the least use, and the nodes after which its proof gives up.
LEAST, _NODES_FOR_LEAST = 1e-6, 200
#: So many times a use a little below the last is looked for, then by halves; proofs at most.
_NEAR_THE_LAST, _MOST_PROOFS = 3, 100


@dataclass(frozen=True)
class Verdict:
    """Whether friction holds.

    Attributes:
        held: True, False, or None if neither was shown.
        use: the smallest max |x_k| / limit_k found, ratios of friction to static limits.
        friction: (nc,) with that use (N m or N).
        proved: whether `held` is certain, see `StaticHold`.
        least: whether no friction has a use smaller by more than `LEAST`, or than was asked.
    """

    held: bool | None
    use: float
    friction: np.ndarray
    proved: bool
    least: bool = False


def decide(
    problem: Problem,
    factor: np.ndarray,
    at_rest: np.ndarray,
    balance: Balance | None = None,
    least_below: float = 0.0,
    slope: np.ndarray | None = None,
) -> Verdict:
    """Decide whether friction holds the coordinates at rest.

    Args:
        problem: `Problem`; friction of moving coordinates must not depend on loads.
        factor: (d, nc) A of rate_slope = A^T A.
        at_rest: (nc,) bool, the coordinates with dry friction that rest.
        balance: equilibrium of their friction; None: rates of zero. At its dead centre a joint has
            a zero column, but its friction changes loads, and so what others hold.
        least_below: find the least use, to `LEAST`, if it is below this; 0: only whether it holds.
        slope: see `Mechanism.slope`.
    """
    resting = np.flatnonzero(at_rest)
    balance = balance or Balance.of_rates(problem, factor, resting, slope)
    if balance is None:
        return Verdict(False, np.inf, np.full(len(at_rest), np.nan), True, True)
    if balance.each_alone:
        return _decide_alone(problem, resting, balance)
    narrow, wide, planar, contracts = make_rest(problem, resting, balance)
    # 1. the search
    z = np.zeros(wide.N.shape[1])
    use = float(descend(wide, z))
    held: bool | None = use <= 1.0
    proved = held or not z.size
    # 2. the proof that nothing holds; the end of the search says nothing about the limits' size
    if not proved:
        held, near = None, np.zeros_like(z)
        outcome = prove(narrow, near, 1.0, _MARGIN, MOST_NODES) if planar else -1
        if outcome == 1:
            held, proved, z, use = True, True, near, float(descend(wide, near))
        elif outcome == 0:
            held, proved = False, contracts
    # 3. the least use: none below `shown`; near the last one found, then halfway between the two
    least, shown, found = not z.size or not len(wide.owner), 0.0, 0
    for _ in range(_MOST_PROOFS if least_below and planar else 0):
        most = min(use, least_below) * (1.0 - 0.5 * LEAST)
        least = least or use == 0.0 or shown >= most * (1.0 - 0.5 * LEAST)
        if least:
            break
        near, below = z.copy(), most if found < _NEAR_THE_LAST else 0.5 * (shown + most)
        box = narrow if below <= 1.0 else wide
        outcome = prove(box, near, below, 0.5 * LEAST, _NODES_FOR_LEAST)
        if outcome < 0:
            break
        if outcome == 0:
            shown = below
        else:
            z, use, found = near, float(descend(wide, near)), found + 1
    x = np.zeros(len(at_rest))
    x[resting] = wide.unit * (wide.x0 + wide.N @ z)
    return Verdict(held, use, x, proved, least)


def _decide_alone(problem: Problem, resting: np.ndarray, balance: Balance) -> Verdict:
    """The verdict where equilibrium leaves one friction, each equation its own: open chains."""
    x, noise = np.zeros(len(problem.rate_free)), np.zeros(len(resting))
    rows, columns = np.nonzero(balance.rows)
    entry = balance.rows[rows, columns]
    x[resting[columns]] = balance.need[rows] / entry
    noise[columns] = NOISE * balance.terms[rows] / np.abs(entry)
    (below, above, rate), load = np.empty((3, len(x))), np.empty(len(problem.constant))
    evaluate(problem, x, load, rate)
    stick_limits(problem, load, below, above)
    limit = np.where(x > 0.0, above, -below)[resting]
    use = float((np.abs(x[resting]) / np.maximum(np.maximum(limit, noise), 1e-300)).max())
    return Verdict(use <= 1.0, use, x, True, True)


def least_possible_use(
    problem: Problem, resting: np.ndarray, balance: Balance, block: np.ndarray
) -> float:
    """Return a lower bound of the use of any friction, balls included: above 1 none holds.

    If x holds, |x_k| <= limit_k <= m_k with m = (1 - C)^-1 limit(0) and C the growth of each
    joint's limit with each joint's |x|. Then for every motion w, such as that of least resistance,

        need^T w = sum x_k rows_k^T w <= sum m_k |rows_k^T w|

    0: limits may grow without bound, or a gear holds any load.

    Args:
        problem: `Problem`. resting: (n,) coordinates. balance: rows x = need of theirs.
        block: (n,) joint of each; |.| is over the three coordinates of a ball.
    """
    nc, load = len(problem.rate_free), problem.constant.copy()
    np.add.at(load, problem.contact_entry, np.linalg.norm(problem.contact[:, 0], axis=1))
    ends = np.empty((2, nc))
    stick_limits(problem, load, *ends)
    joints, first = np.unique(block, return_index=True)
    limit, owner = (
        np.abs(ends).max(axis=0)[resting][first],
        problem.coordinate[problem.contact_entry],
    )
    grows = np.zeros((len(joints), len(joints)))
    for j, joint in enumerate(joints):
        columns = problem.contact[:, 1 + resting[block == joint]]
        size = problem.grip[problem.contact_entry] * np.linalg.norm(columns, ord=2, axis=(1, 2))
        grows[:, j] = np.bincount(owner, size, nc)[resting[first]]
    if not np.abs(np.linalg.eigvals(grows)).max(initial=0.0) < 1.0 or not np.isfinite(limit).all():
        return 0.0
    most = np.linalg.solve(np.eye(len(joints)) - grows, limit)[np.searchsorted(joints, block)]
    _, w = share(balance.rows, balance.need, most, block)
    speed = joint_sizes(balance.rows.T @ w, block)
    number = np.bincount(np.searchsorted(joints, block))[np.searchsorted(joints, block)]
    resistance = float((most * speed / number).sum())
    return float(balance.need @ w) / resistance if resistance > 0.0 else 0.0
