"""The directions in which balls slip from rest: each against its motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pinfric.friction.dense import largest, solve_dense
from pinfric.friction.given_modes import SHOULD_STICK
from pinfric.friction.problem import Modes
from pinfric.friction.rest import Mechanism
from pinfric.kernels.compiled import call_compiled, kernel

#: A ball's direction that turns by no more than this stays.
TURNED = 1e-8
#: How often several balls take turns, and then steps of Newton's method over all.
_SWEEPS, _NEWTON = 10, 20


class Balls(NamedTuple):
    """Balls that slip.

    Attributes:
        here: (n, 3) coordinates.
        size, axes: (n, 3), (n, 3, 3) eigenvalues and vectors (columns) of their part of the slope.
        limit: (n,) length of their friction.
    """

    here: np.ndarray
    size: np.ndarray
    axes: np.ndarray
    limit: np.ndarray


def turn_balls(modes: Modes, mechanism: Mechanism, slips: bool = False) -> float:
    """Point the friction of balls that slip from rest against their motion; return the most turned.

    With |x| = L given and r = r_0 + R x, where what sticks goes on to stick, x = -L r / |r| gives
    x = -(R + g 1)^-1 r_0 with g = |r| / L. |x| falls with g: one root. Balls take turns until none
    changes: each lowers x R x / 2 + r_0 x, a convex function, within its limit.

    Args:
        slips: whether a ball turns, too, that its limit would hold (g = 0).
    """
    turned = 0.0
    slipping = modes.at_rest & ~modes.stuck & mechanism.ball
    if not mechanism.closed or not slipping.any():
        return turned
    free, here, size, axes = mechanism.freed(modes.stuck, slipping)
    balls = Balls(here, size, axes, np.linalg.norm(modes.friction[here], axis=1))
    x = modes.friction.copy()
    call_compiled(turn_in_turns, free, modes.rate, balls, x)
    for here, limit in zip(balls.here, balls.limit, strict=True):
        new, length = x[here], float(np.linalg.norm(x[here]))
        sticks = not length >= limit * (1.0 - 1e-9)
        modes.verdict[here] = SHOULD_STICK if sticks else 0
        if sticks and not (slips and length):
            continue
        turned = max(turned, float(np.abs(new / length + modes.direction[here]).max()))
        modes.direction[here] = -new / length
    return turned


def kernel_of_balls() -> tuple[Any, tuple[Any, ...]]:
    """Return the kernel that Python calls in `turn_balls`, with arguments of its types."""
    line, rows = np.empty(0), np.empty((0, 0))
    balls = Balls(np.empty((0, 3), np.int64), rows, np.empty((0, 3, 3)), line)
    return turn_in_turns, (rows, line, balls, line)


@kernel
def turn_in_turns(free: np.ndarray, rate: np.ndarray, balls: Balls, x: np.ndarray) -> None:
    """Bring the friction x of balls that slip against their motion, ball by ball, then all at once.

    Args:
        free: (d, nc) the factor without what sticks. rate: (nc,) under the friction given.
        balls: those that slip. x: (nc,) that friction, overwritten.
    """
    given, motion, several = x.copy(), np.zeros(free.shape[0]), balls.limit.size > 1
    pull, new = np.empty(3), np.empty(3)
    for _ in range(_SWEEPS if several else 1):
        change = 0.0
        for b in range(balls.limit.size):
            here, size, axes = balls.here[b], balls.size[b], balls.axes[b]
            for i in range(3):
                new[i] = rate[here[i]]
                for d in range(motion.size):
                    new[i] += free[d, here[i]] * motion[d]
            for k in range(3):
                pull[k] = 0.0
                for i in range(3 if size[k] > 0.0 else 0):
                    pull[k] += axes[i, k] * (new[i] - size[k] * x[here[i]])
            g = _secular_root(pull, size, balls.limit[b])
            for i in range(3):
                step = -x[here[i]]
                for k in range(3):
                    step -= axes[i, k] * (pull[k] / (size[k] + g))
                x[here[i]] += step
                change = max(change, abs(step))
                for d in range(motion.size):
                    motion[d] += free[d, here[i]] * step
        if change <= TURNED * largest(x):
            break
    if several:
        _polish(free, rate, given, balls, motion, x)


@kernel
def _polish(  # noqa: C901
    free: np.ndarray,
    rate: np.ndarray,
    given: np.ndarray,
    balls: Balls,
    motion: np.ndarray,
    x: np.ndarray,
) -> None:
    """Improve the friction x of balls that all slip by Newton's method over their motion (d,)."""
    n, y, way = motion.size, x.copy(), np.empty(3)
    for b in range(balls.limit.size):
        square = 0.0
        for i in range(3):
            square += x[balls.here[b, i]] ** 2
        if np.sqrt(square) < balls.limit[b] * (1.0 - 1e-9):
            return
    slope, off, across = np.empty((n, n)), np.empty((n, 1)), np.empty((n, 3))
    for _ in range(_NEWTON):
        for d in range(n):
            off[d, 0] = motion[d]
            for e in range(n):
                slope[d, e] = 1.0 if d == e else 0.0
        for b in range(balls.limit.size):
            here, square = balls.here[b], 0.0
            for i in range(3):
                way[i] = rate[here[i]]
                for d in range(n):
                    way[i] += free[d, here[i]] * motion[d]
                square += way[i] * way[i]
            speed = np.sqrt(square)
            if speed == 0.0:
                return
            for i in range(3):
                way[i] /= speed
                y[here[i]] = -balls.limit[b] * way[i]
            for d in range(n):
                along = 0.0
                for i in range(3):
                    along += free[d, here[i]] * way[i]
                    off[d, 0] -= free[d, here[i]] * (y[here[i]] - given[here[i]])
                for i in range(3):
                    across[d, i] = free[d, here[i]] - along * way[i]
            for d in range(n):
                for e in range(n):
                    for i in range(3):
                        slope[d, e] += balls.limit[b] / speed * across[d, i] * free[e, here[i]]
        if not solve_dense(slope, off):
            return
        change = most = 0.0
        for d in range(n):
            motion[d] -= off[d, 0]
            change, most = max(change, abs(off[d, 0])), max(most, abs(motion[d]))
        if change <= 1e-2 * TURNED * most:
            for c in range(x.size):
                x[c] = y[c]
            return


@kernel
def _secular_root(pull: np.ndarray, size: np.ndarray, limit: float) -> float:
    """Return the g >= 0 at which |pull / (size + g)| = limit; next to 0 where it is below there.

    By Newton's method on 1 / |.|, which is nearly a line (Moré and Sorensen 1983).

    Args:
        pull, size: (3,), size >= 0.
        limit: what is to be reached.
    """
    low = g = max(1e-14 * largest(size), 1e-90)
    high = 0.0
    for k in range(3):
        high += pull[k] * pull[k]
    high = np.sqrt(high) / max(limit, 1e-300)
    for _ in range(200):
        square = slope = 0.0
        for k in range(3):
            part = (pull[k] / (size[k] + g)) ** 2
            square, slope = square + part, slope + part / (size[k] + g)
        if square <= limit * limit:
            if g == low:
                return low
            high = g
        else:
            low = g
        before, g = g, g + square * (np.sqrt(square) / max(limit, 1e-300) - 1.0) / slope
        if not low < g < high:
            g = np.sqrt(low * high)  # decades apart at first
        if g in (low, high) or abs(g - before) <= 4e-16 * g:
            break
    return g
