"""Small dense linear algebra against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from pinfric.friction import dense
from pinfric.friction.dense import eliminate_full_pivot, factorize, largest


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


@pytest.mark.parametrize("zeros", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_full_pivoting_finds_rank_and_solution(seed, zeros):
    rng = np.random.default_rng(seed)
    rows, unknowns, rank = int(rng.integers(1, 7)), int(rng.integers(1, 7)), 0
    rank = int(rng.integers(0, min(rows, unknowns) + 1))
    A = rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, unknowns))
    if zeros:  # where the next row or column has no pivot
        A *= rng.random(A.shape) < 0.4
        rank = int(np.linalg.matrix_rank(A))
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


@pytest.mark.parametrize("n", [1, 2, 5])
def test_solve_dense_is_a_linear_solver(n):
    rng = np.random.default_rng(n)
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, 3))
    A[0, 0] = 0.0  # needs a pivot
    X = B.copy()
    if n == 1:
        assert not dense.solve_dense(A.copy(), X)
        return
    assert dense.solve_dense(A.copy(), X)
    np.testing.assert_allclose(X, np.linalg.solve(A, B), rtol=1e-11)


def test_solve_dense_subtracts_rows_that_are_subtracted_once():
    """A_ij = min(i, j): every factor of the elimination is 1, and A^-1 has the rows -1, 2, -1."""
    n = 5
    A = np.minimum.outer(np.arange(1.0, n + 1), np.arange(1.0, n + 1))
    inverse = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    inverse[-1, -1] = 1.0
    X = np.eye(n)
    assert dense.solve_dense(A, X)
    np.testing.assert_array_equal(X, inverse)


@pytest.mark.parametrize("seed", range(20))
def test_spectral_radius_bound_is_above_and_near(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 6
    A = rng.uniform(size=(n, n)) * (rng.random((n, n)) < 0.8)
    radius = np.abs(np.linalg.eigvals(A)).max()
    bound = dense.spectral_radius_bound(A, np.empty(n))
    assert radius * (1 - 1e-12) <= bound
    if (np.linalg.matrix_power(A + np.eye(n), n) > 0).all():  # irreducible: the bound is near
        assert bound <= 1.05 * radius + 1e-9
