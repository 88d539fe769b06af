"""Linear algebra of a few unknowns for kernels: an elimination, a spectral radius, a norm."""

from __future__ import annotations

import numpy as np

from pinfric.kernels.compiled import kernel

#: Pivots below this many times the first one are zero; those of second derivatives.
RANK, _FLAT = 1e-9, 1e-14


@kernel
def solve_dense(A: np.ndarray, B: np.ndarray) -> bool:
    """Overwrite B (n, m) with A^-1 B by elimination with row pivots; A is lost; False: singular."""
    n, m = B.shape
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if not abs(A[pivot, k]) > 0.0:
            return False
        if pivot != k:
            for j in range(n):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            for j in range(m):
                B[k, j], B[pivot, j] = B[pivot, j], B[k, j]
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            if factor != 0.0:
                for j in range(k + 1, n):
                    A[i, j] -= factor * A[k, j]
                for j in range(m):
                    B[i, j] -= factor * B[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(m):
            total = B[k, j]
            for i in range(k + 1, n):
                total -= A[k, i] * B[i, j]
            B[k, j] = total / A[k, k]
    return True


@kernel
def solve_semidefinite(H: np.ndarray, x: np.ndarray) -> None:
    """Overwrite x (n,) with a y of H y = x, by elimination with diagonal pivots; H is lost.

    Args:
        H: (n, n), symmetric, no eigenvalue negative. Where it is flat y is 0.
        x: overwritten.
    """
    n, first = x.size, 0.0
    order, rank = np.arange(n), n
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if H[i, i] > H[pivot, pivot]:
                pivot = i
        if k == 0:
            first = H[pivot, pivot]
        if not H[pivot, pivot] > _FLAT * first:
            rank = k
            break
        if pivot != k:
            order[k], order[pivot] = order[pivot], order[k]
            x[k], x[pivot] = x[pivot], x[k]
            for j in range(n):
                H[k, j], H[pivot, j] = H[pivot, j], H[k, j]
            for j in range(n):
                H[j, k], H[j, pivot] = H[j, pivot], H[j, k]
        for i in range(k + 1, n):
            factor = H[i, k] / H[k, k]
            x[i] -= factor * x[k]
            for j in range(k + 1, n):
                H[i, j] -= factor * H[k, j]
    y = np.zeros(n)
    for k in range(rank - 1, -1, -1):
        total = x[k]
        for j in range(k + 1, rank):
            total -= H[k, j] * y[order[j]]
        y[order[k]] = total / H[k, k]
    for k in range(n):
        x[k] = y[k]


@kernel
def spectral_radius_bound(A: np.ndarray, vector: np.ndarray) -> float:
    """Upper bound of the spectral radius of a non-negative A (Collatz and Wielandt).

    max_i (A y)_i / y_i bounds it for every positive y; power iteration brings y near the Perron
    vector.

    Args:
        A: (n, n), no entry negative.
        vector: (n,), overwritten with y.
    """
    n = A.shape[0]
    if n == 0:
        return 0.0
    image = np.empty(n)
    best = np.inf
    for j in range(n):
        vector[j] = 1.0
    for _ in range(30):
        upper, lower, largest = 0.0, np.inf, 0.0
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += A[i, j] * vector[j]
            image[i] = total
            upper, lower = max(upper, total / vector[i]), min(lower, total / vector[i])
            largest = max(largest, total)
        best = min(best, upper)
        if largest == 0.0 or best - lower <= 1e-2 * best:
            break
        for i in range(n):  # half a step keeps y positive where A is reducible or cyclic
            vector[i] = 0.5 * (vector[i] + image[i] / largest) + 1e-9
    return best


@kernel
def affine(A: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Write A (1, x) (n,) of a map A (n, 1 + nx)."""
    for i in range(out.size):
        out[i] = A[i, 0]
        for c in range(x.size):
            out[i] += A[i, 1 + c] * x[c]


@kernel
def largest(values: np.ndarray) -> float:
    """Return the largest magnitude in (n,)."""
    most = 0.0
    for value in values:
        most = max(most, abs(value))
    return most


@kernel
def factorize(M: np.ndarray) -> bool:
    """Overwrite the lower triangle of M (n, n) with its Cholesky factor; False: not positive."""
    n = M.shape[0]
    for j in range(n):
        diagonal = M[j, j]
        pivot = diagonal
        for k in range(j):
            pivot -= M[j, k] * M[j, k]
        if not pivot > 1e-14 * diagonal:
            return False
        root = np.sqrt(pivot)
        M[j, j] = root
        for i in range(j + 1, n):
            total = M[i, j]
            for k in range(j):
                total -= M[i, k] * M[j, k]
            M[i, j] = total / root
    return True


@kernel
def eliminate_full_pivot(A: np.ndarray, ny: int, order: np.ndarray, scale: float) -> int:
    """Bring the first ny columns of A (nr, ny + more) to reduced echelon form; return the rank.

    Afterwards y[order[r]] = A[r, ny:] - sum over the free columns f >= rank of A[r, f] y[order[f]].

    Args:
        A: overwritten; its columns below ny are exchanged.
        ny: number of unknowns.
        order: (ny,) int, overwritten: which unknown stands in each column.
        scale: pivots small beside it, or beside the first one, are zero.
    """
    nr, width = A.shape
    for c in range(ny):
        order[c] = c
    first = 0.0
    for k in range(min(nr, ny)):
        best, row, column = 0.0, k, k
        for i in range(k, nr):
            for j in range(k, ny):
                if abs(A[i, j]) > best:
                    best, row, column = abs(A[i, j]), i, j
        if k == 0:
            first = max(best, scale)
        if not best > RANK * first:
            return k
        if row != k:
            for j in range(width):
                A[k, j], A[row, j] = A[row, j], A[k, j]
        if column != k:
            order[k], order[column] = order[column], order[k]
            for i in range(nr):
                A[i, k], A[i, column] = A[i, column], A[i, k]
        pivot = A[k, k]
        for j in range(k, width):
            A[k, j] /= pivot
        for i in range(nr):
            factor = A[i, k]
            if i != k and factor != 0.0:
                for j in range(k, width):
                    A[i, j] -= factor * A[k, j]
    return min(nr, ny)


@kernel
def solve_balance(A: np.ndarray, scale: float, y: np.ndarray, free: np.ndarray) -> int:
    """Write one solution of A[:, :ny] y = A[:, ny:], and its null space; return the rank.

    Full pivoting, the paper's choice, finds the rank. Below the number of rows there may be no
    solution.

    Args:
        A: (nr, ny + columns), overwritten.
        scale: pivots small beside it are zero.
        y: (ny, columns), overwritten.
        free: (ny, ny), overwritten: its first ny - rank columns.
    """
    ny, columns = y.shape
    order = np.empty(ny, np.int64)
    rank = eliminate_full_pivot(A, ny, order, scale)
    for r in range(ny):
        for k in range(columns):
            y[order[r], k] = A[r, ny + k] if r < rank else 0.0
        for f in range(ny):
            free[order[r], f] = 0.0
        if r >= rank:
            free[order[r], r - rank] = 1.0
            continue
        for f in range(ny - rank):
            free[order[r], f] = -A[r, rank + f]
    return rank
