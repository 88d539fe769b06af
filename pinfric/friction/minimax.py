"""The small linear programs that decide whether friction holds: least m with G z + h <= m s."""

from __future__ import annotations

import numpy as np

from pinfric.friction.dense import solve_dense
from pinfric.kernels.compiled import kernel

#: After this many pivots the smallest index is chosen (Bland), which cannot cycle.
_PIVOTS_BEFORE_BLAND, _MOST_PIVOTS = 60, 2000
#: A violation of a row below this, relative, is rounding; so is such an entry of a pivot's column.
_OBEYED, _NO_PIVOT = 1e-13, 1e-11


@kernel
def least_violation(
    G: np.ndarray, h: np.ndarray, s: np.ndarray, rows: int, reach: float, z: np.ndarray
) -> float:
    """Write a z with the least m such that G z + h <= m s, |z_j| <= reach; return a bound of m.

    Simplex on the dual, max h^T y - reach |G^T y|_1 with s^T y = 1, y >= 0: the worst row and sides
    of the box are a feasible basis at once. Every y bounds m from below (weak duality), also one
    that pivots on nearly nothing have worn.

    Args:
        G, h, s: (>= rows, dz), (>= rows,), (>= rows,), s > 0.
        rows: how many of them count.
        reach: bound of every z.
        z: (dz,), overwritten.
    """
    basis, y = np.empty(z.size + 1, np.int64), np.empty(z.size + 1)
    bound = greatest_bound(G, h, s, rows, reach, basis, y)
    write_vertex(G, h, s, rows, reach, basis, z)
    return bound


@kernel
def greatest_bound(
    G: np.ndarray,
    h: np.ndarray,
    s: np.ndarray,
    rows: int,
    reach: float,
    basis: np.ndarray,
    y: np.ndarray,
) -> float:
    """Return the bound of m of `least_violation`, and write the basis and the y that prove it.

    Args:
        G, h, s, rows, reach: see `least_violation`. basis, y: see `begin`.
    """
    dz = y.size - 1
    T, value = np.zeros((dz + 1, rows + 2 * dz)), np.empty(rows + 2 * dz)
    size = begin(G, h, s, rows, reach, T, value, basis, y)
    for pivots in range(_MOST_PIVOTS):
        enter, best = -1, _OBEYED * (size + reach)
        for c in range(value.size):
            if value[c] > best:
                enter = c
                if pivots >= _PIVOTS_BEFORE_BLAND:
                    break
                best = value[c]
        leave, least = -1, np.inf
        for j in range(dz + 1 if enter >= 0 else 0):
            if T[j, enter] > _NO_PIVOT:
                ratio = y[j] / T[j, enter]
                if ratio < least or (ratio == least and basis[j] < basis[leave]):
                    leave, least = j, ratio
        if leave < 0:
            break
        exchange(T, value, y, leave, enter)
        basis[leave] = enter
    return _checked_bound(G, h, s, rows, reach, basis, y)


@kernel
def _checked_bound(
    G: np.ndarray,
    h: np.ndarray,
    s: np.ndarray,
    rows: int,
    reach: float,
    basis: np.ndarray,
    y: np.ndarray,
) -> float:
    """Return the bound of m that the y (dz + 1,) of the rows in the basis prove as they are."""
    dz, weight, bound = y.size - 1, 0.0, 0.0
    for i in range(dz + 1):
        if basis[i] < rows:
            weight += s[basis[i]] * y[i]
            bound += h[basis[i]] * y[i]
    for j in range(dz):
        along = 0.0
        for i in range(dz + 1):
            if basis[i] < rows:
                along += G[basis[i], j] * y[i]
        bound -= reach * abs(along)
    return bound / weight if weight > 0.0 else -np.inf


@kernel
def begin(
    G: np.ndarray,
    h: np.ndarray,
    s: np.ndarray,
    rows: int,
    reach: float,
    T: np.ndarray,
    value: np.ndarray,
    basis: np.ndarray,
    y: np.ndarray,
) -> float:
    """Write the first tableau: the worst row at z = 0, and the side of the box each z would leave.

    Args:
        G, h, s, rows, reach: see `least_violation`.
        T: (dz + 1, rows + 2 dz), zeros: columns in terms of the basis.
        value: (rows + 2 dz,) how much each is violated.
        basis, y: (dz + 1,) columns in the basis, and their y.

    Returns:
        The largest |h| / s.
    """
    dz = y.size - 1
    worst, size = 0, 0.0
    for r in range(rows):
        size = max(size, abs(h[r]) / s[r])
        if h[r] / s[r] > h[worst] / s[worst]:
            worst = r
    for r in range(rows):
        T[dz, r] = s[r] / s[worst]
    y[dz], basis[dz] = 1.0 / s[worst], worst
    for j in range(dz):
        sign = -1.0 if G[worst, j] > 0.0 else 1.0
        for r in range(rows):
            T[j, r] = sign * (G[r, j] - G[worst, j] * T[dz, r])
        T[j, rows + 2 * j], T[j, rows + 2 * j + 1] = sign, -sign
        y[j] = -sign * G[worst, j] * y[dz]
        basis[j] = rows + 2 * j + (0 if sign > 0.0 else 1)
    for c in range(value.size):
        value[c] = (h[c] if c < rows else -reach) - h[worst] * T[dz, c]
        for j in range(dz):
            value[c] += reach * T[j, c]
    return size


@kernel
def exchange(T: np.ndarray, value: np.ndarray, y: np.ndarray, leave: int, enter: int) -> None:
    """Bring column `enter` into the basis for row `leave` (Gauss and Jordan); see `begin`."""
    pivot = T[leave, enter]
    for c in range(value.size):
        T[leave, c] /= pivot
    y[leave] /= pivot
    for j in range(y.size):
        factor = T[j, enter]
        if j != leave and factor != 0.0:
            for c in range(value.size):
                T[j, c] -= factor * T[leave, c]
            y[j] = max(y[j] - factor * y[leave], 0.0)
    factor = value[enter]
    for c in range(value.size):
        value[c] -= factor * T[leave, c]


@kernel
def write_vertex(
    G: np.ndarray,
    h: np.ndarray,
    s: np.ndarray,
    rows: int,
    reach: float,
    basis: np.ndarray,
    z: np.ndarray,
) -> None:
    """Write the z (dz,) at which the rows and sides of the box in the basis are met exactly."""
    dz = z.size
    A, B = np.zeros((dz + 1, dz + 1)), np.zeros((dz + 1, 1))
    for i in range(dz + 1):
        c = basis[i]
        if c < rows:
            for j in range(dz):
                A[i, j] = G[c, j]
            A[i, dz], B[i, 0] = -s[c], -h[c]
        else:
            A[i, (c - rows) // 2] = 1.0
            B[i, 0] = reach if (c - rows) % 2 == 0 else -reach
    solved = solve_dense(A, B)
    for j in range(dz):
        z[j] = B[j, 0] if solved else 0.0
