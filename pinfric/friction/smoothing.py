"""Modes of joints at rest from friction that grows smoothly with their rates, ever more sharply.

x_c = -L_c(x) r_c / (|r|^2 + e^2)^1/2 with r = r_0 + R x (|r| of a ball: of three coordinates) has a
solution that Newton's method follows as e falls to nearly zero: where |r| >> e the joint slips. It
proves nothing, but ends where pivoting turns in a circle.
"""

from __future__ import annotations

import numpy as np

from pinfric.friction.law import evaluate, slip_law
from pinfric.friction.problem import Modes, Problem
from pinfric.friction.rest import Mechanism

#: e in parts of the largest rate without friction: from 1 down, in such steps.
_SHARPEST, _STEP = 1e-9, 10.0**-0.5
#: Newton's passes for each e, what they may leave; a step for differences.
_PASSES, _LEFT, _SMALL = 60, 1e-12, 1e-7
#: At this share of its sliding friction a joint slips.
_SLIPS = 0.999


def guess_modes(problem: Problem, modes: Modes, mechanism: Mechanism) -> None:
    """Write what sticks of what rests, and in which directions the others slip.

    Args:
        problem: `Problem` without gears.
        modes: with `at_rest`; overwritten.
    """
    n, free = len(problem.rate_free), np.zeros(len(problem.rate_free), dtype=bool)
    load, rate, offset = np.empty(len(problem.constant)), np.empty(n), np.empty(n)
    gain, directions = np.empty(len(load)), modes.direction.copy()

    def left(x: np.ndarray) -> np.ndarray:
        evaluate(problem, x, load, rate)
        smooth = rate / np.sqrt(mechanism.speeds(rate) ** 2 + width**2)
        directions[modes.at_rest] = smooth[modes.at_rest]
        slip_law(problem, free, directions, gain, offset)
        return x - offset - np.bincount(problem.coordinate, gain * load, n)

    x, scale = np.zeros(n), float(np.abs(problem.rate_free).max(initial=1e-300))
    width = scale
    while width > _SHARPEST * scale:
        for _ in range(_PASSES):
            residual, most = left(x), float(np.abs(x).max())
            if not np.abs(residual).max() > _LEFT * most:
                break
            small = _SMALL * (most or 1.0)
            slope = np.array([left(x + small * unit) - residual for unit in np.eye(n)]).T / small
            step, damping = np.linalg.lstsq(slope, -residual, rcond=None)[0], 1.0
            size = np.linalg.norm(residual)
            while damping > 1e-4 and not np.linalg.norm(left(x + damping * step)) < size:
                damping *= 0.5
            x = x + damping * step
        width *= _STEP
    left(x)
    slips = mechanism.speeds(directions) >= _SLIPS
    modes.stuck[modes.at_rest] = ~slips[modes.at_rest]
    modes.direction[modes.at_rest] = np.where(slips, directions, 0.0)[modes.at_rest]
