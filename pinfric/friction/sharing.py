"""How joints that rest together share the friction that holds them (limit analysis)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.balance import RANK, inverse_of
from pinfric.friction.dense import solve_semidefinite
from pinfric.kernels.compiled import call_compiled, kernel

#: A joint this much slower than the others (relative) does not take part in the motion w; with
#: limits that differ by the side kinks are sharper, for one that is decades above the others.
_SMOOTH, _SHARPER = 1e-6, 1e-8
#: Up to so much slower a joint may rest in the motion.
_RESTS = 1e-5
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
        limit: (n,) static limits, or (2, n): of x > 0 and of x < 0.
        block: (n,) joint of each column; |.| is over the columns of a joint.
        speeds: (n,) A^T w of a similar problem, near which to start; None: anywhere.

    Returns:
        x (n,), the least squares solution where nothing can hold; w (r,).
    """
    size, limits = float(np.linalg.norm(b)), np.array(np.broadcast_to(limit, (2, len(block))))
    if size == 0.0 or not limits.any():
        return np.asarray(np.linalg.lstsq(A, b, rcond=RANK)[0]), b
    same = np.equal.outer(block, block).astype(float)
    fastest = np.sqrt(same @ (A**2).sum(axis=0))
    w = b / size  # with one freedom it is known
    differ = bool((limits[0] != limits[1]).any())
    if len(b) > 1:
        w = _weakest(A, b / size, limits, block, speeds, _SHARPER if differ else _SMOOTH)
    limit = limit_towards(limits, A.T @ w, _RESTS * fastest * np.linalg.norm(w))
    if len(b) > 1 and differ:
        w = _weakest(A, b / size, np.array([limit, limit]), block, A.T @ w)
    rounding = _SMOOTH * fastest
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


def limit_towards(limits: np.ndarray, y: np.ndarray, least: np.ndarray | float) -> np.ndarray:
    """Return the limits (n,), of (2, n), on the side of speeds y (n,); the larger up to `least`."""
    side = np.where(y > 0.0, limits[0], limits[1])
    return np.where(np.abs(y) <= least, limits.max(axis=0), side)


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
    towards = limit_towards(np.broadcast_to(limit, (2, len(z))), z, 0.0)
    x = towards * z / np.where(size > 0.0, size, 1.0)
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
    limits: np.ndarray,
    block: np.ndarray,
    speeds: np.ndarray | None,
    sharpest: float = _SMOOTH,
) -> np.ndarray:
    """Motion w (r,), b^T w = 1, |b| = 1, of least resistance: Newton, kinks rounded ever less.

    Near given speeds (n,) they are as sharp as at the end: in w those that rest, or nearly, do.
    Where that ends early all begins anew from b.
    """
    side = 1.0 if b[0] >= 0.0 else -1.0
    v = b + side * np.eye(1, len(b))[0]
    axes = side * (np.outer(v, v) / (v @ v / 2.0) - np.eye(len(b)))  # the first is b
    rotated, u = np.ascontiguousarray(axes.T @ A), np.zeros(len(b) - 1)
    if speeds is not None:
        slow = joint_sizes(speeds, block)
        slow += _SMOOTH * slow.max()
        w = np.linalg.lstsq((A / slow).T, speeds / slow, rcond=1e-14)[0]
        if float(w @ b) > 0.0:
            u[:] = axes[:, 1:].T @ w / float(w @ b)
            if call_compiled(least_resistance, rotated, limits, block, sharpest, u):
                return np.asarray(axes @ np.append(1.0, u))
            u[:] = 0.0
    for smooth in 10.0 ** np.arange(-1, np.log10(sharpest) - 0.5, -1):
        call_compiled(least_resistance, rotated, limits, block, float(smooth), u)
    return np.asarray(axes @ np.append(1.0, u))


@kernel
def least_resistance(
    A: np.ndarray, limits: np.ndarray, block: np.ndarray, smooth: float, u: np.ndarray
) -> bool:
    """Lower sum limit |y| over joints, y = A^T (1, u), from u on by Newton's method.

    |y|^2 is summed over the columns of a joint. Return whether the resistance is least.

    Args:
        A: (1 + d, n).
        limits: (2, n) of y > 0 and of y < 0, alike for the columns of a ball.
        block: (n,) joint of each column.
        smooth: roundness of the kinks, relative to the largest speeds with |(1, u)| = 1.
        u: (d,), overwritten.
    """
    d, n = u.size, block.size
    rounding, y, speed = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        square = 0.0
        for j in range(n):
            for i in range(1 + d if block[j] == block[k] else 0):
                square += A[i, j] * A[i, j]
        rounding[k] = smooth * np.sqrt(square) + 1e-300
    slope, H = np.empty(1 + d), np.empty((d, d))
    step, trial = np.empty(d), np.empty(d)
    least = _resistance(A, limits, block, rounding, u, y, speed)
    for _ in range(_NEWTON_PASSES):
        _write_slope(A, limits, block, y, speed, slope, H)
        for i in range(d):
            step[i] = slope[1 + i]
        solve_semidefinite(H, step)
        damping, before, size, far = 2.0, least, 1.0, 0.0
        while damping == 2.0 or (damping > 1e-6 and least > before):
            damping *= 0.5
            for i in range(d):
                trial[i] = u[i] - damping * step[i]
            least = _resistance(A, limits, block, rounding, trial, y, speed)
        if least > before:
            least = _resistance(A, limits, block, rounding, u, y, speed)
            break
        for i in range(d):
            u[i] = trial[i]
            size, far = max(size, abs(u[i])), max(far, abs(step[i]))
        if far <= 1e-13 * size or damping <= 1e-6:
            break
    _write_slope(A, limits, block, y, speed, slope, H)
    across = 0.0
    for i in range(d):
        across += slope[1 + i] * slope[1 + i]
    return bool(across <= _STATIONARY * _STATIONARY * (across + slope[0] * slope[0]))


@kernel
def _resistance(
    A: np.ndarray,
    limits: np.ndarray,
    block: np.ndarray,
    rounding: np.ndarray,
    u: np.ndarray,
    y: np.ndarray,
    speed: np.ndarray,
) -> float:
    """Write y and speed (n,) of each column's joint at u; return the resistance."""
    n, total = y.size, 0.0
    for k in range(n):
        y[k] = A[0, k]
        for i in range(u.size):
            y[k] += A[1 + i, k] * u[i]
    for k in range(n):
        square, number = rounding[k] * rounding[k], 0
        for j in range(n):
            if block[j] == block[k]:
                square, number = square + y[j] * y[j], number + 1
        speed[k] = np.sqrt(square)
        above, below = limits[0, k], limits[1, k]  # below |y| + (above - below) max(y, 0)
        total += 0.5 * ((above + below) * speed[k] + (above - below) * y[k]) / number
    return total


@kernel
def _write_slope(
    A: np.ndarray,
    limits: np.ndarray,
    block: np.ndarray,
    y: np.ndarray,
    speed: np.ndarray,
    slope: np.ndarray,
    H: np.ndarray,
) -> None:
    """Write the resistance's slope (1 + d,) and its second derivatives by u (d, d)."""
    n, r = y.size, slope.size
    along = np.empty(r)
    slope[:] = 0.0
    H[:] = 0.0
    for k in range(n):
        weight, first = 0.5 * (limits[0, k] + limits[1, k]) / speed[k], True
        push = weight * y[k] + 0.5 * (limits[0, k] - limits[1, k])
        for i in range(r):
            slope[i] += push * A[i, k]
            for j in range(1, r if i > 0 else 0):
                H[i - 1, j - 1] += weight * A[i, k] * A[j, k]
        for j in range(k):
            first = first and block[j] != block[k]
        if not first:  # what follows is once of each joint
            continue
        along[:] = 0.0
        for j in range(n):
            for i in range(r if block[j] == block[k] else 0):
                along[i] += y[j] * A[i, j]
        for i in range(1, r):
            for j in range(1, r):
                H[i - 1, j - 1] -= weight / (speed[k] * speed[k]) * along[i] * along[j]
