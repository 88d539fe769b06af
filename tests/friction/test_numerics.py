"""The small numerics of friction: linear algebra, extrapolation, how what rests shares a load."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from pinfric.friction.anderson import anderson
from pinfric.friction.dense import eliminate_full_pivot, factorize, largest
from pinfric.friction.rest import Mechanism
from pinfric.friction.sharing import _along_one, share


@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_a_factor_is_cholesky_s(n):
    A = np.random.default_rng(n).normal(size=(n, n))
    M = A @ A.T + 0.1 * np.eye(n)
    L = M.copy()
    assert factorize(L)
    np.testing.assert_allclose(np.tril(L), np.linalg.cholesky(M), rtol=1e-12)
    assert not factorize(M - 2.0 * np.linalg.eigvalsh(M).max() * np.eye(n))
    singular = np.ones((2, 2))
    assert not factorize(singular)


@pytest.mark.parametrize("seed", range(12))
def test_full_pivoting_finds_rank_and_solution(seed):
    rng = np.random.default_rng(seed)
    rows, unknowns, rank = int(rng.integers(1, 7)), int(rng.integers(1, 7)), 0
    rank = int(rng.integers(0, min(rows, unknowns) + 1))
    A = rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, unknowns))
    y = rng.normal(size=(unknowns, 2))
    work, order = np.hstack([A, A @ y]), np.empty(unknowns, dtype=np.int64)
    assert eliminate_full_pivot(work, unknowns, order, 0.0) == rank
    found = np.zeros((unknowns, 2))
    found[order[:rank]] = work[:rank, unknowns:]
    np.testing.assert_allclose(A @ found, A @ y, atol=1e-11)
    for free in range(rank, unknowns):  # each column is a motion of the kernel
        motion = np.zeros(unknowns)
        motion[order[free]], motion[order[:rank]] = 1.0, -work[:rank, free]
        np.testing.assert_allclose(A @ motion, 0.0, atol=1e-11)


def test_the_largest_is_a_size():
    assert largest(np.array([1.0, -3.0, 2.0])) == 3.0
    assert largest(np.zeros(0)) == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_extrapolation_finds_a_fixed_point_that_passes_alone_run_away_from(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(4, 4)), rng.normal(size=4)
    A *= (0.6 if seed % 2 else 1.5) / np.abs(np.linalg.eigvals(A)).max()
    x, passes = anderson(lambda x: A @ x + b, np.zeros(4), 1e-12)
    np.testing.assert_allclose(x, np.linalg.solve(np.eye(4) - A, b), rtol=1e-8)
    assert passes < 60
    assert anderson(lambda x: x + 1.0, np.zeros(2), 1e-12)[0] is None


@pytest.mark.parametrize("started", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_a_load_is_shared_with_the_least_largest_use(seed, started):
    """Against the linear program min t, A x = b, |x_k| <= t limit_k; from other limits' motion."""
    rng = np.random.default_rng(seed)
    r, n = int(rng.integers(1, 4)), int(rng.integers(4, 9))
    A = np.linalg.qr(rng.normal(size=(n, r)))[0].T
    b, limit = rng.normal(size=r), rng.uniform(0.2, 2.0, n)
    other = share(A, b, rng.uniform(0.2, 2.0, n), np.arange(n))[1] if started else None
    x, _ = share(A, b, limit, np.arange(n), other)
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


def test_what_rests_together_is_found_and_whether_anything_moves():
    """Coordinates 0 and 1 are one motion, 2 another; 3 cannot move at all."""
    factor = np.array([[1.0, -2.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0]])
    four = np.arange(4)
    mechanism = Mechanism(True, factor, four, np.zeros(4, bool), np.zeros(4, bool), np.zeros(4))
    everything = np.ones(4, dtype=bool)
    together = [set(group.members.tolist()) for group in mechanism.groups(everything)]
    assert {0, 1} in together
    assert {2} not in together
    assert mechanism.is_dependent(everything)
    assert not mechanism.is_dependent(np.array([True, False, True, False]))
    assert mechanism.is_locked(everything)
    assert not mechanism.is_locked(np.array([True, True, False, True]))
    assert mechanism.is_locked(np.array([False, True, True, False]))
    mechanism.factor = factor[:1]  # of another state: nothing is remembered that is not so
    assert mechanism.is_locked(np.array([True, False, False, False]))


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
