"""The equilibrium of resting joints, A x = b, solved as x = x_0 + N z.

Rounding of large limits would hide small ones. So z is the friction of the joints with the smallest
limits; the others follow by Gauss-Jordan elimination with full pivoting, those without limit first,
every column in its own unit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.problem import Problem

#: Columns, or singular values, below this many times the largest are zero: geometry, not forces.
RANK = 1e-9
#: Rates that friction cannot take away are rounding below this many times the terms' size.
FITS = 1e-7


class Shared(NamedTuple):
    """The frictions in equilibrium, x = x_0 + N z.

    Attributes:
        x0: (n,), zero where `free`. N: (n, dz), one where `free`.
        free: (dz,) int, the coordinates whose friction z is.
        noise: (n,) size of the terms that x0 is the sum of; 0 where `free`.
        follow: (n, 1 + n) x of coordinates without limit by the others' x, follow (1, x); else
            zero.
        follows: (n,) bool, which coordinates these are.
    """

    x0: np.ndarray
    N: np.ndarray
    free: np.ndarray
    noise: np.ndarray
    follow: np.ndarray
    follows: np.ndarray


def inverse_of(A: np.ndarray, slope: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Invert a slope of rates where they can move.

    Args:
        A: (d, n) of which the rates are A^T w.
        slope: (n, n); None: A^T A.

    Returns:
        inverse (r, r) and orthonormal rows (r, n): slope = rows^T inverse^-1 rows.
    """
    _, size, rows = np.linalg.svd(A, full_matrices=False)
    rank = int((size > RANK * size[:1]).sum())
    rows = rows[:rank]
    if slope is None:
        return np.diag(1.0 / size[:rank] ** 2), rows
    return np.linalg.inv(rows @ slope @ rows.T), rows


class Balance(NamedTuple):
    """The equilibrium A x = b of friction x, each row in its own unit.

    Attributes:
        rows: (d, n) A, of rank d.
        need: (d,) b.
        terms: (d,) size of the terms of b, the scale for rounding.
    """

    rows: np.ndarray
    need: np.ndarray
    terms: np.ndarray

    @classmethod
    def of_rates(
        cls,
        problem: Problem,
        factor: np.ndarray,
        members: np.ndarray,
        slope: np.ndarray | None = None,
    ) -> Balance | None:
        """Return the equations that make the rates of some coordinates 0; None: unsolvable.

        Args:
            factor: (d, nc) A of rate_slope = A^T A.
            members: (n,) the coordinates.
            slope: see `Mechanism.slope`.
        """
        size = np.linalg.norm(factor[:, members], axis=0)  # rates of one joint, in its own unit
        size[size == 0.0] = 1.0  # at its dead centre: of friction that changes loads alone
        if slope is not None:
            slope = slope[np.ix_(members, members)] / np.outer(size, size)
        inverse, rows = inverse_of(factor[:, members] / size, slope)
        rate, terms = problem.rate_free[members] / size, problem.rate_scale[members] / size
        left = np.abs(rate - rows.T @ (rows @ rate))
        if (left > FITS * terms.max(initial=0.0) + 1e-300).any():
            return None
        inverse = inverse @ rows
        return cls(rows * size, -inverse @ rate, np.abs(inverse) @ terms)

    @property
    def each_alone(self) -> bool:
        """Whether every friction has an equation of its own."""
        entries = self.rows != 0.0
        return bool((entries.sum(axis=0) == 1).all() and (entries.sum(axis=1) == 1).all())

    def eliminate(self, unit: np.ndarray, unlimited: np.ndarray) -> Shared:
        """Solve for the friction of the joints with the largest limits.

        Args:
            unit: (n,) size of each limit, N m or N, positive.
            unlimited: (n,) bool, what has none, at least one way.
        """
        d, n = self.rows.shape
        T = np.column_stack([self.rows, self.need, np.diag(self.terms)])
        T /= _largest(T[:, :n])
        rows, columns = list(range(d)), np.flatnonzero(unlimited).tolist()
        geometry = 1.0 / _largest(T[:, :n].T)[:, 0]
        first = _eliminate(T, rows, columns, geometry, RANK)
        follow, follows = np.zeros((n, 1 + n)), np.zeros(n, dtype=bool)
        for r, c in first:
            follow[c, 0], follow[c, 1:], follows[c] = T[r, n], -T[r, :n], True
            follow[c, 1 + c] = 0.0
        limited = np.flatnonzero(~unlimited)
        T[rows] /= _largest(T[rows][:, limited] * unit[limited])
        pivots = first + _eliminate(T, rows, limited.tolist(), unit, 0.0)
        free = np.setdiff1d(np.arange(n), [c for _, c in pivots])
        x0, N, noise = np.zeros(n), np.zeros((n, len(free))), np.zeros(n)
        N[free, np.arange(len(free))] = 1.0
        for r, c in pivots:
            x0[c], N[c], noise[c] = T[r, n], -T[r, free], np.abs(T[r, n + 1 :]).sum()
        return Shared(x0, N, free, noise, follow, follows)


def _largest(rows: np.ndarray) -> np.ndarray:
    """Return the largest magnitude of each row (m, n), or 1; (m, 1)."""
    most = np.abs(rows).max(axis=1, initial=0.0, keepdims=True)
    return np.where(most > 0.0, most, 1.0)


def _eliminate(
    T: np.ndarray, rows: list[int], columns: list[int], unit: np.ndarray, least: float
) -> list[tuple[int, int]]:
    """Bring a tableau to reduced echelon form in some columns; return its pivots (row, column).

    Args:
        T: (d, >= n), overwritten.
        rows: without a pivot; those that get one are taken out.
        columns: which may get one.
        unit: (n,) of the columns.
        least: pivots up to this size, in these units, are zero.
    """
    pivots = []
    while rows and columns:
        size = np.abs(T[rows][:, columns]) * unit[columns]
        i, j = np.unravel_index(int(size.argmax()), size.shape)
        if not size[i, j] > least:
            break
        r, c = rows.pop(int(i)), columns.pop(int(j))
        T[r] /= T[r, c]
        others = np.arange(len(T)) != r
        T[others] -= np.outer(T[others, c], T[r])
        T[others, c] = 0.0
        pivots.append((r, c))
    return pivots
