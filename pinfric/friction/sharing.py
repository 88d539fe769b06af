"""How joints that rest together share the friction that holds them (limit analysis)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.balance import RANK, inverse_of
from pinfric.kernels.compiled import call_compiled, kernel

#: A joint this much slower than the others (relative) does not take part in the motion w.
_SMOOTH = 1e-6
#: Passes of Newton's method; what it may leave of the gradient, relative: at the least it leaves
#: 1e-9, where a kink beside its start keeps it 1e-3 or more.
_NEWTON_PASSES, _STATIONARY = 40, 1e-5


class Group(NamedTuple):
    """Coordinates that rest together, and the inverse of their part of the rates' slope.

    Attributes:
        members: (m,) coordinates.
        inverse, rates: see `balance.inverse_of`.
    """

    members: np.ndarray
    inverse: np.ndarray
    rates: np.ndarray

    @classmethod
    def of(cls, factor: np.ndarray, members: np.ndarray, slope: np.ndarray | None) -> Group:
        """Take coordinates (m,) together; see `Mechanism` for the factor (d, nc) and the slope."""
        own_slope = None if slope is None else slope[np.ix_(members, members)]
        return cls(members, *inverse_of(factor[:, members], own_slope))

    def needs(self, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return b (r,) of rates x = b, which takes rates (m,) away, and what no x takes (m,)."""
        s = self.rates @ rate
        return -self.inverse @ s, np.abs(rate - self.rates.T @ s)


def share(
    A: np.ndarray,
    b: np.ndarray,
    limit: np.ndarray,
    block: np.ndarray,
    speeds: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the x with A x = b that has the least max |x_k| / limit_k.

    Its dual is the motion w in which friction resists least: min sum_k limit_k |A_k^T w| with
    b^T w = |b|. With rounded kinks, x = t limit_k A_k^T w / |A_k^T w| balances b exactly.

    Args:
        A: (r, n) of rank r.
        b: (r,).
        limit: (n,) static limit the way x points.
        block: (n,) joint of each column; |.| is over the columns of a joint.
        speeds: (n,) A^T w of a similar problem, near which to start; None: anywhere.

    Returns:
        x (n,), the least squares solution where nothing can hold; w (r,).
    """
    size = float(np.linalg.norm(b))
    if size == 0.0 or not limit.any():
        return np.asarray(np.linalg.lstsq(A, b, rcond=RANK)[0]), b
    same = np.equal.outer(block, block).astype(float)
    # with one freedom w is known
    w = b / size if len(b) == 1 else _weakest(A, b / size, limit, same, speeds)
    rounding = _SMOOTH * np.sqrt(same @ (A**2).sum(axis=0))
    # as the root: weights differ by 1e12 where one limit is more than any, squares lose directions
    root = np.sqrt(limit / np.sqrt(same @ (A.T @ w) ** 2 + rounding**2 + 1e-300))
    scaled, x = A * root, np.zeros(len(limit))
    for _ in range(2):  # once more for what rounding left
        x += root * np.linalg.lstsq(scaled, b - A @ x, rcond=1e-15)[0]
    return x + np.linalg.lstsq(A, b - A @ x, rcond=RANK)[0], w


def share_nearby(
    A: np.ndarray,
    b: np.ndarray,
    limit: np.ndarray,
    slope: np.ndarray,
    near: np.ndarray,
    block: np.ndarray,
    speeds: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """`share` for several freedoms, where limits depend on the friction, near one.

    With e_k the direction of near_k and y = x - e slope (x - near), |y_k| <= t limit_k says that
    |x_k| <= t limit_k + slope_k (x - near), to first order. x = near has no better x nearby.

    Args:
        A, b, limit, block, speeds: see `share`.
        slope: (n, n) t d limit_k / d x_j, with the t so far.
        near: (n,) friction at which the limits are given.

    Returns:
        x (n,), speeds (n,).
    """
    used = joint_sizes(near, block)
    follows = slope * (near / np.where(used > 0.0, used, 1.0))[:, None]
    try:
        back = np.linalg.inv(np.eye(len(near)) - follows)
    except np.linalg.LinAlgError:  # friction wedges itself
        return np.full_like(near, np.nan), near
    offset = back @ (follows @ near)
    along = A @ back
    y, w = share(along, b + A @ offset, limit, block, speeds)
    return back @ y - offset, along.T @ w


def joint_sizes(x: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Return for every column (n,) the length of x over the columns of its joint."""
    return np.asarray(np.sqrt(np.equal.outer(block, block) @ x**2))


def share_one(
    A: np.ndarray,
    b: np.ndarray,
    limit: np.ndarray,
    slope: np.ndarray,
    block: np.ndarray,
) -> np.ndarray:
    """`share` for one freedom, where limits depend on the friction: least max |x_k| / limit_k(x).

    x = t limit_k z_k / |z_k|,   z = A^T w + slope^T |z|           (conditions of a least t)

    The friction of a joint that moves little may act with the motion if this loads others more.

    Args:
        A, b, limit, block: see `share`, r = 1.
        slope: (n, n) t d limit_k / d x_j, with the t so far.
    """
    direct = A[0] * np.sign(b[0])
    z = np.empty_like(direct)
    call_compiled(_along_one, direct, np.ascontiguousarray(slope.T), block, z)
    same = np.equal.outer(block, block)
    size = np.sqrt(same @ z**2 + (_SMOOTH * np.abs(z).max()) ** 2)
    x = limit * z / np.where(size > 0.0, size, 1.0)
    total = float(A[0] @ x)
    return x * (b[0] / total) if total * b[0] > 0.0 else np.asarray(direct * abs(b[0]))


@kernel
def _along_one(direct: np.ndarray, gain: np.ndarray, block: np.ndarray, z: np.ndarray) -> None:
    """Write the z of `share_one`, `direct` where it has no bound: the mechanism jams.

    Args:
        direct: (n,) A^T w. gain: (n, n) t slope^T.
        block: (n,) joint of each column.
        z: (n,), overwritten.
    """
    n = direct.size
    length, bound = np.empty(n), 1e3 * np.abs(direct).max()
    for j in range(n):
        z[j] = direct[j]
    for _ in range(50):
        for k in range(n):  # |z| of its joint, a part for each of the joint's columns
            square, number = 0.0, 0
            for j in range(n):
                if block[j] == block[k]:
                    square, number = square + z[j] * z[j], number + 1
            length[k] = np.sqrt(square) / number
        most = change = 0.0
        for j in range(n):
            new = direct[j]
            for k in range(n):
                new += gain[j, k] * length[k]
            most, change = max(most, abs(new)), max(change, abs(new - z[j]))
            z[j] = new
        if not most < bound:
            for j in range(n):
                z[j] = direct[j]
            return
        if change <= 1e-12 * most:
            return


def _weakest(
    A: np.ndarray,
    b: np.ndarray,
    limit: np.ndarray,
    same: np.ndarray,
    speeds: np.ndarray | None,
) -> np.ndarray:
    """Motion w (r,), b^T w = 1, |b| = 1, of least resistance: Newton, kinks rounded ever less.

    Near given speeds (n,) they are as sharp as at the end: in w those that rest, or nearly, do.
    Where that ends early all begins anew from b.
    """
    if speeds is not None:
        slow = np.sqrt(same @ speeds**2)
        slow += _SMOOTH * slow.max()
        w = np.linalg.lstsq((A / slow).T, speeds / slow, rcond=1e-14)[0]
        if float(w @ b) > 0.0:
            w, stationary = _newton(A, b, limit, same, w / float(w @ b), _SMOOTH)
            if stationary:
                return w
    w = b
    for smooth in 10.0 ** np.arange(-1, np.log10(_SMOOTH) - 0.5, -1):
        w, _ = _newton(A, b, limit, same, w, smooth)
    return w


def _newton(
    A: np.ndarray, b: np.ndarray, limit: np.ndarray, same: np.ndarray, w: np.ndarray, smooth: float
) -> tuple[np.ndarray, bool]:
    """`_weakest` from w on with kinks of one roundness; and whether the resistance is least."""
    across = np.linalg.svd(b[None])[2][1:].T  # (r, r - 1)
    rounding = smooth * np.sqrt(same @ (A**2).sum(axis=0)) + 1e-300
    number = same.sum(axis=0)

    def speeds(w: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt(same @ (A.T @ w) ** 2 + rounding**2))

    def resistance(w: np.ndarray) -> float:
        return float((limit / number) @ speeds(w))

    def gradient(w: np.ndarray) -> np.ndarray:
        return np.asarray(A @ (limit / speeds(w) * (A.T @ w)))

    for _ in range(_NEWTON_PASSES):
        y, speed = A.T @ w, speeds(w)
        weight = limit / speed
        along = A @ (same * y[:, None])
        H = (A * weight) @ A.T - (along * (weight / speed**2 / number)) @ along.T
        towards = -across.T @ gradient(w)
        step = across @ np.linalg.lstsq(across.T @ H @ across, towards, rcond=1e-14)[0]
        damping, before = 1.0, resistance(w)
        while damping > 1e-6 and resistance(w + damping * step) > before:
            damping *= 0.5
        w = w + damping * step
        if np.abs(step).max() <= 1e-13 * np.abs(w).max() or damping <= 1e-6:
            break
    slope = gradient(w)
    return w, bool(np.linalg.norm(across.T @ slope) <= _STATIONARY * np.linalg.norm(slope))
