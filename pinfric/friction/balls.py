"""The directions in which balls slip from rest: each against its motion."""

from __future__ import annotations

import numpy as np

from pinfric.friction.balance import RANK
from pinfric.friction.given_modes import SHOULD_STICK
from pinfric.friction.problem import Modes
from pinfric.friction.rest import Mechanism

#: A ball's direction that turns by no more than this stays.
TURNED = 1e-8
#: How often several balls take turns, and then steps of Newton's method over all.
_SWEEPS, _NEWTON = 10, 20


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
    held = mechanism.factor[:, modes.stuck]
    free = mechanism.factor - held @ (np.linalg.pinv(held, rcond=RANK) @ mechanism.factor)
    balls = list[tuple[np.ndarray, np.ndarray, np.ndarray, float]]()
    for number in mechanism.joints(slipping):
        here = np.flatnonzero(mechanism.block == number)
        size, axes = np.linalg.eigh(free[:, here].T @ free[:, here])
        size[size < RANK**2 * size[-1]] = 0.0
        balls.append((here, size, axes, float(np.linalg.norm(modes.friction[here]))))
    x, motion = modes.friction.copy(), np.zeros(len(free))
    for _ in range(_SWEEPS if len(balls) > 1 else 1):
        before = x.copy()
        for here, size, axes, limit in balls:
            rate = modes.rate[here] + free[:, here].T @ motion
            pull = np.where(size > 0.0, axes.T @ rate - size * (axes.T @ x[here]), 0.0)
            new = -axes @ (pull / (size + _secular_root(pull, size, limit)))
            motion += free[:, here] @ (new - x[here])
            x[here] = new
        if np.abs(x - before).max() <= TURNED * np.abs(x).max():
            break
    if len(balls) > 1:
        _polish(free, modes, [(here, limit) for here, _, _, limit in balls], motion, x)
    for here, _, _, limit in balls:
        new, length = x[here], float(np.linalg.norm(x[here]))
        sticks = not length >= limit * (1.0 - 1e-9)
        modes.verdict[here] = SHOULD_STICK if sticks else 0
        if sticks and not (slips and length):
            continue
        turned = max(turned, float(np.abs(new / length + modes.direction[here]).max()))
        modes.direction[here] = -new / length
    return turned


def _polish(
    free: np.ndarray,
    modes: Modes,
    balls: list[tuple[np.ndarray, float]],
    motion: np.ndarray,
    x: np.ndarray,
) -> None:
    """Improve the friction x of balls that all slip by Newton's method over their motion (d,)."""
    if any(np.linalg.norm(x[here]) < limit * (1.0 - 1e-9) for here, limit in balls):
        return
    y = x.copy()
    for _ in range(_NEWTON):
        slope = np.eye(len(free))
        for here, limit in balls:
            A = free[:, here]
            rate = modes.rate[here] + A.T @ motion
            speed = float(np.linalg.norm(rate))
            if speed == 0.0:
                return
            way = rate / speed
            y[here] = -limit * way
            slope += (limit / speed) * A @ (np.eye(3) - np.outer(way, way)) @ A.T
        off = motion - free @ (y - modes.friction)
        step = np.linalg.solve(slope, off)
        motion = motion - step
        if np.abs(step).max() <= 1e-2 * TURNED * np.abs(motion).max():
            x[:] = y
            return


def _secular_root(pull: np.ndarray, size: np.ndarray, limit: float) -> float:
    """Return the g >= 0 at which |pull / (size + g)| = limit; next to 0 where it is below there.

    By Newton's method on 1 / |.|, which is nearly a line (Moré and Sorensen 1983).

    Args:
        pull, size: (3,), size >= 0.
        limit: what is to be reached.
    """
    terms = list(zip((pull**2).tolist(), size.tolist(), strict=True))
    low = g = max(1e-14 * max(size.tolist()), 1e-90)
    high = sum(square for square, _ in terms) ** 0.5 / max(limit, 1e-300)
    for _ in range(200):
        square = sum(p / (s + g) ** 2 for p, s in terms)
        if square <= limit * limit:
            if g == low:
                return low
            high = g
        else:
            low = g
        slope = sum(p / (s + g) ** 3 for p, s in terms)
        before, g = g, g + square * (square**0.5 / max(limit, 1e-300) - 1.0) / slope
        if not low < g < high:
            g = (low * high) ** 0.5  # decades apart at first
        if g in (low, high) or abs(g - before) <= 4e-16 * g:
            break
    return float(g)
