"""Modes of joints at rest from friction that grows smoothly with their rates, ever more sharply.

x_c = -L_c(x) r_c / (|r|^2 + e^2)^1/2 with r = r_0 + R x (|r| of a ball: of three coordinates) has a
solution that Newton's method follows as e falls to nearly zero: where |r| >> e the joint slips. It
proves nothing, but ends where pivoting turns in a circle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pinfric.friction.dense import largest
from pinfric.friction.law import evaluate, slip_law
from pinfric.friction.problem import Modes, Problem
from pinfric.friction.rest import Mechanism
from pinfric.kernels.compiled import compiling, kernel

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
    n, directions = len(problem.rate_free), modes.direction.copy()
    law = problem, modes.at_rest, mechanism.block, mechanism.ball
    residual, after, slope, none = np.empty(n), np.empty(n), np.empty((n, n)), np.empty((n, 0))
    x, scale = np.zeros(n), float(np.abs(problem.rate_free).max(initial=1e-300))
    width = scale
    with compiling():
        while width > _SHARPEST * scale:
            for _ in range(_PASSES):
                smoothed(*law, width**2, x, directions, residual, none)
                most = float(np.abs(x).max())
                if not np.abs(residual).max() > _LEFT * most:
                    break
                smoothed(*law, width**2, x, directions, residual, slope)
                step, damping = np.linalg.lstsq(slope, -residual, rcond=None)[0], 1.0
                size = np.linalg.norm(residual)
                while damping > 1e-4:
                    smoothed(*law, width**2, x + damping * step, directions, after, none)
                    if np.linalg.norm(after) < size:
                        break
                    damping *= 0.5
                x = x + damping * step
            width *= _STEP
        smoothed(*law, width**2, x, directions, residual, none)
    slips = mechanism.speeds(directions) >= _SLIPS
    modes.stuck[modes.at_rest] = ~slips[modes.at_rest]
    modes.direction[modes.at_rest] = np.where(slips, directions, 0.0)[modes.at_rest]


def kernel_of_smoothing(problem: Problem) -> tuple[Any, tuple[Any, ...]]:
    """Return the kernel that Python calls in `guess_modes`, with arguments of its types."""
    rests, line = np.empty(0, bool), np.empty(0)
    law = problem, rests, np.empty(0, np.int64), rests
    return smoothed, (*law, 1.0, line, line, line, np.empty((0, 0)))


@kernel
def smoothed(
    problem: Problem,
    at_rest: np.ndarray,
    block: np.ndarray,
    ball: np.ndarray,
    square: float,
    x: np.ndarray,
    directions: np.ndarray,
    left: np.ndarray,
    slope: np.ndarray,
) -> None:
    """Write the directions r / (|r|^2 + e^2)^1/2 under friction x, and what the law leaves (nc,).

    Args:
        problem, at_rest: see `guess_modes`. block, ball: see `rest.Mechanism`.
        square: e^2. x: (nc,).
        directions: (nc,) those of what moves stay. left: (nc,), overwritten.
        slope: (nc, nc) or (nc, 0), overwritten with the slope of `left`, by differences.
    """
    n, ne, small = x.size, problem.constant.size, _SMALL * (largest(x) or 1.0)
    load, rate, gain, offset = np.empty(ne), np.empty(n), np.empty(ne), np.empty(n)
    near, total, free = np.empty(n), np.empty(n), np.zeros(n, np.bool_)
    for j in range(-1, slope.shape[1]):
        for c in range(n):
            near[c], total[c] = x[c] + (small if c == j else 0.0), 0.0
        evaluate(problem, near, load, rate)
        for c in range(n):
            speed = abs(rate[c])
            if ball[c]:
                speed = 0.0
                for d in range(n):
                    speed += rate[d] * rate[d] if block[d] == block[c] else 0.0
                speed = np.sqrt(speed)
            if at_rest[c]:
                directions[c] = rate[c] / np.sqrt(speed * speed + square)
        slip_law(problem, free, directions, gain, offset)
        for s in range(ne):
            total[problem.coordinate[s]] += gain[s] * load[s]
        for c in range(n):
            rest = near[c] - offset[c] - total[c]
            if j < 0:
                left[c] = rest
            else:
                slope[c, j] = (rest - left[c]) / small
