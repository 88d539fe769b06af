"""How joints at rest share a load: the least largest use of friction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from pinfric.friction.balance import RANK, inverse_of
from pinfric.friction.dense import solve_semidefinite
from pinfric.friction.sharing import _along_one, least_resistance, share
from pinfric.kernels.compiled import call_compiled


@pytest.mark.parametrize("started", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_a_load_is_shared_with_the_least_largest_use(seed, started):
    """Against the linear program min t, A x = b, |x_k| <= t limit_k; from other limits' motion."""
    rng = np.random.default_rng(seed)
    r, n = int(rng.integers(1, 4)), int(rng.integers(4, 9))
    A = np.linalg.qr(rng.normal(size=(n, r)))[0].T
    b, limit = rng.normal(size=r), rng.uniform(0.2, 2.0, n)
    w = share(A, b, rng.uniform(0.2, 2.0, n), np.arange(n))[1]
    x, _ = share(A, b, limit, np.arange(n), A.T @ w if started else None)
    np.testing.assert_allclose(A @ x, b, atol=1e-12)
    beside = np.hstack([np.eye(n), -limit[:, None]])
    below = np.hstack([-np.eye(n), -limit[:, None]])
    least = linprog(
        np.r_[np.zeros(n), 1.0],
        np.vstack([beside, below]),
        np.zeros(2 * n),
        np.hstack([A, np.zeros((r, 1))]),
        b,
        (None, None),
    ).fun
    assert least * (1 - 1e-9) <= (np.abs(x) / limit).max() <= least * (1 + 1e-3)


@pytest.mark.parametrize("seed", range(40))
def test_limits_that_differ_by_the_side_are_used_the_least(seed):
    """Against the linear program; where a gear locks itself one side has no limit, the other 0.

    The side was that of the last pass, so passes jumped between two.
    """
    rng = np.random.default_rng(seed)
    r, n = int(rng.integers(1, 4)), int(rng.integers(4, 7))
    A, b = np.linalg.qr(rng.normal(size=(n, r)))[0].T, rng.normal(size=r)
    limits = rng.uniform(0.2, 2.0, (2, n))
    locks, free = rng.permutation(n)[:2]
    way = int(rng.integers(2))
    limits[way, locks], limits[1 - way, locks] = 1e5, 0.0
    limits[int(rng.integers(2)), free] *= 100.0
    x, _ = share(A, b, limits, np.arange(n))
    np.testing.assert_allclose(A @ x, b, atol=1e-11)
    rows = [np.hstack([s * np.eye(n), -limits[k][:, None]]) for k, s in enumerate((1.0, -1.0))]
    least = linprog(
        np.r_[np.zeros(n), 1.0],
        np.vstack(rows),
        np.zeros(2 * n),
        np.hstack([A, np.zeros((r, 1))]),
        b,
        (None, None),
    ).fun
    over = np.maximum(x - least * limits[0], -x - least * limits[1])
    assert over.max() <= 1e-9 * max(1.0, least)


@pytest.mark.parametrize("sign", [None, -1.0])
def test_the_slope_of_what_rests_is_inverted_where_it_moves_anything(sign):
    """Two directions of motion, one of two columns: against the pseudo-inverse of the slope."""
    A = np.random.default_rng(4).normal(size=(3, 2))[:, [0, 1, 0]]
    slope = A.T @ A if sign is None else A.T @ np.diag([1.0, sign, 1.0]) @ A
    inverse, rows = inverse_of(A, None if sign is None else slope)
    np.testing.assert_allclose(rows @ rows.T, np.eye(2), atol=1e-14)
    wanted = np.linalg.pinv(slope, rcond=RANK)
    np.testing.assert_allclose(rows.T @ inverse @ rows, wanted, atol=1e-12 * np.abs(wanted).max())


def test_a_motion_that_loads_other_joints_has_the_friction_of_a_linear_system():
    """z = direct + gain |z|; with all positive (1 - gain)^-1 direct, without bound: jam."""
    rng = np.random.default_rng(0)
    direct, gain, z = rng.uniform(0.5, 1.0, 5), 0.1 * rng.random((5, 5)), np.empty(5)
    _along_one(direct, gain, np.arange(5), z)
    np.testing.assert_allclose(z, np.linalg.solve(np.eye(5) - gain, direct), rtol=1e-11)
    _along_one(direct, gain, np.zeros(5, int), z)  # one joint: |z| / 5 for each column
    size = np.linalg.norm(z)
    np.testing.assert_allclose(z, direct + gain.sum(axis=1) * size / 5, rtol=1e-11)
    _along_one(direct, 2.0 * np.eye(5), np.arange(5), z)
    np.testing.assert_array_equal(z, direct)
    small = 1e-9 * direct  # in small units it is the same
    _along_one(small, gain, np.arange(5), z)
    np.testing.assert_allclose(z, np.linalg.solve(np.eye(5) - gain, small), rtol=1e-11)


def rounded_resistance(A, limit, block, smooth):
    """Value, slope and second derivatives of sum limit |y|, y = A^T w, by matrices alone."""
    joints = np.equal.outer(np.unique(block), block).astype(float)
    size = joints.T @ joints @ (A**2).sum(axis=0)
    of_joint, own = smooth**2 * joints @ size / joints.sum(axis=1), joints @ limit / joints.sum(1)

    def at(w):
        y = A.T @ w
        speed = np.sqrt(joints @ y**2 + of_joint)
        along = A @ (joints * y).T
        weight = joints.T @ (own / speed)
        H = (A * weight) @ A.T - (along * own / speed**3) @ along.T
        return own @ speed, A @ (weight * y), H

    return at


@pytest.mark.parametrize("seed", range(40))
def test_the_motion_of_least_resistance_is_that_of_newton_s_method_on_matrices(seed):
    """Pins and balls whose limits are up to six decades apart."""
    rng = np.random.default_rng(seed)
    d, block = int(rng.integers(1, 5)), np.repeat(np.arange(6), rng.choice([1, 3], 6))
    A = np.linalg.qr(rng.normal(size=(len(block), 1 + d)))[0].T
    limit = 10.0 ** rng.uniform(-3, 3, 6)[block]
    u, w = np.zeros(d), np.eye(1, 1 + d)[0]
    for smooth in (1e-1, 1e-2, 1e-3):
        call_compiled(least_resistance, A, np.array([limit, limit]), block, smooth, u)
        at = rounded_resistance(A, limit, block, smooth)
        for _ in range(100):
            value, slope, H = at(w)
            step = np.append(0.0, np.linalg.solve(H[1:, 1:], -slope[1:]))
            while at(w + step)[0] > value and np.abs(step).max() > 1e-15:
                step *= 0.5
            w = w + step
        np.testing.assert_allclose(u, w[1:], rtol=1e-7, atol=1e-7 * np.abs(w).max())
        assert at(np.append(1.0, u))[0] <= at(w)[0] * (1 + 1e-12)


def test_where_second_derivatives_are_flat_nothing_moves():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(3, 5)) * 10.0 ** np.arange(-4.0, 1.0)
    H, x = A.T @ A, A.T @ np.array([1.0, 2.0, -3.0])
    y = x.copy()
    solve_semidefinite(H.copy(), y)
    np.testing.assert_allclose(H @ y, x, rtol=1e-8, atol=1e-12 * np.abs(x).max())
    y = np.ones(2)
    solve_semidefinite(np.diag([0.0, 4.0]), y)
    np.testing.assert_array_equal(y, [0.0, 0.25])
