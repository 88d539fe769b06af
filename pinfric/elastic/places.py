"""Positions of a tool if each joint may be anywhere in an interval.

To first order a wind-up delta of the drives moves the tool by -J Q delta, Q = N (S N)^-1. If the
drives' intervals are independent, its places are a zonotope: middle + sum_j s_j g_j, |s_j| <= 1,
g_j = (J Q)_j (delta_upper - delta_lower)_j/2. See `notebooks/theory/elastic.md`.
"""

from __future__ import annotations

import numpy as np

from pinfric.elastic.vibration import free_motions

#: Of so many intervals all corners are looked at; beyond, a bound stands for the farthest.
MOST_CORNERS = 14
#: S N is singular where its least singular value is this small beside the largest.
_SINGULAR = 1e-9


def joint_answer(rates: np.ndarray, closed: np.ndarray) -> np.ndarray | None:
    """Return Q (nv, na): motion of the joints per unit of each drive's rate; None: not determined.

    Args:
        rates: (na, nv) S of all drives.
        closed: (m, nv) rows of loops.
    """
    N = free_motions(closed[None], rates.shape[1])[0]
    moved = rates @ N
    if moved.shape[0] != moved.shape[1]:
        return None
    sizes = np.linalg.svd(moved, compute_uv=False)
    if sizes.size and not sizes[-1] > _SINGULAR * sizes[0]:
        return None
    return np.asarray(N @ np.linalg.inv(moved))


def extents(generators: np.ndarray) -> np.ndarray:
    """Return half the zonotope's width along each axis, sum_j |g_j| (d,).

    Args:
        generators: (d, k) g_j as columns.
    """
    return np.asarray(np.abs(generators).sum(axis=1))


def farthest(generators: np.ndarray) -> float:
    """Return the largest distance of a place, a corner, from the middle.

    Beyond `MOST_CORNERS` generators the upper bound sum_j |g_j|.
    """
    used = generators[:, np.abs(generators).max(axis=0, initial=0.0) > 0.0]
    if used.shape[1] > MOST_CORNERS:
        return float(np.linalg.norm(used, axis=0).sum())
    return float(np.linalg.norm(corners(used), axis=1).max())


def corners(generators: np.ndarray) -> np.ndarray:
    """Return sum_j +-g_j for all signs, those with +g_1 (the others mirror them), (2^(k-1), d)."""
    points = generators[:, :1].T if generators.shape[1] else np.zeros((1, len(generators)))
    for g in generators.T[1:]:
        points = np.concatenate([points + g, points - g])
    return np.asarray(points)


def outline(generators: np.ndarray) -> np.ndarray:
    """Return the corners (2k + 1, 2) of a plane zonotope around its middle, closed, in order.

    Args:
        generators: (2, k).
    """
    kept = generators[:, np.abs(generators).max(axis=0, initial=0.0) > 0.0].T
    if not len(kept):
        return np.zeros((1, 2))
    up = np.where((kept[:, 1] < 0.0) | ((kept[:, 1] == 0.0) & (kept[:, 0] < 0.0)), -1.0, 1.0)
    turned = up[:, None] * kept
    ordered = turned[np.argsort(np.arctan2(turned[:, 1], turned[:, 0]))]
    steps = np.concatenate([2.0 * ordered, -2.0 * ordered])
    start = -ordered.sum(axis=0)
    return np.concatenate([[start], start + np.cumsum(steps, axis=0)])
