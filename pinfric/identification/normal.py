"""Least squares from summed normal equations: a fit is then sums and one small solve.

    minimise  sum_j w_j |y_j - Y_j theta - X_j x_j|^2 + lambda^2 N |(theta - theta_0)/scale|^2
    over theta and x >= 0

theta is eliminated once (Schur complement). Laws differ in which of the x take part, and each fit
is a non-negative least squares of that size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.identification.columns import Rows
from pinfric.identification.laws import K
from pinfric.model.arrays import BoolArray, FloatArray, IntArray

#: Share of the largest eigenvalue below which columns are combinations of each other.
_DEPENDENT = 1e-9
#: Draws coefficients of columns scaled to one to zero, where a joint does not move.
RIDGE = 1e-8
#: Residuals beyond so many median absolute deviations count less (Huber).
_HUBER = 2.5
#: No effort is fitted better than to this share of itself: from a simulation it may be, and weights
#: without end would drown the links' prior in rounding.
_EXACT = 1e-3
#: Rounds in which coefficients of many fits go to zero or come back together, and the share of the
#: right side by which rounding may miss a gradient of zero.
_EXCHANGES, _SLACK = 12, 1e-12
#: Multiplications from which BLAS takes several threads. These wait for each other by spinning: on
#: cores that others use, too, a product of this size then takes a hundred times as long.
_ALONE = 2**18


@dataclass(frozen=True)
class Prior:
    """Prior of the links' inertial parameters.

    Attributes:
        center: (p,) those of the URDF.
        weight: (p,) lambda^2 / scale^2; infinite where they are kept.
        deviation: (p,) standard deviation of the center.
    """

    center: FloatArray
    weight: FloatArray
    deviation: FloatArray

    @property
    def kept(self) -> bool:
        """Whether the parameters are those of the URDF."""
        return bool(np.isinf(self.weight).all())


@dataclass(frozen=True)
class BlockProducts:
    """Summed products of one joint's columns (rigid, slots, effort) by block.

    Attributes:
        products: (blocks, p + K + 1, p + K + 1) A^T W A with the effort as the last column.
        count: (blocks,) rows in each.
    """

    products: FloatArray
    count: FloatArray

    @classmethod
    def of(cls, rows: Rows, weight: FloatArray, blocks: int) -> BlockProducts:
        """Sum the products of a joint's weighted rows."""
        columns = np.column_stack((rows.rigid, rows.slots, rows.effort))
        count = np.bincount(rows.block, minlength=blocks).astype(np.float64)
        return cls(products_by_block(columns, weight, rows.block, blocks), count)


@dataclass(frozen=True)
class Fit:
    """One estimate.

    Attributes:
        theta: (p,) inertial parameters of the links.
        slots: (nj, K) coefficients; 0 where a law has none.
    """

    theta: FloatArray
    slots: FloatArray

    def of_joint(self, joint: int) -> FloatArray:
        """Return theta and one joint's coefficients, (p + K,)."""
        return np.concatenate((self.theta, self.slots[joint]))


@dataclass(frozen=True)
class Normal:
    """Normal equations of some blocks; theta (p,) and all joints' slots (nj K,) apart.

    Attributes:
        rigid, cross, slots: (p, p), (p, nj K), (nj K, nj K) of A^T W A.
        right_rigid, right_slots: (p,), (nj K,) of A^T W y.
        rows: how many rows were summed.
    """

    rigid: FloatArray
    cross: FloatArray
    slots: FloatArray
    right_rigid: FloatArray
    right_slots: FloatArray
    rows: float

    @classmethod
    def of(cls, grams: Sequence[BlockProducts], blocks: BoolArray, weights: FloatArray) -> Normal:
        """Sum the blocks' products, joint j with weight `weights[j]`."""
        nj = len(grams)
        p = grams[0].products.shape[1] - K - 1
        normal = cls(
            np.zeros((p, p)),
            np.zeros((p, nj * K)),
            np.zeros((nj * K, nj * K)),
            np.zeros(p),
            np.zeros(nj * K),
            sum(float(own.count[blocks].sum()) for own in grams),
        )
        for j, (own, weight) in enumerate(zip(grams, weights, strict=True)):
            s = weight * own.products[blocks].sum(axis=0)
            place = slice(j * K, (j + 1) * K)
            normal.rigid[:] += s[:p, :p]
            normal.right_rigid[:] += s[:p, -1]
            normal.cross[:, place] = s[:p, p:-1]
            normal.slots[place, place] = s[p:-1, p:-1]
            normal.right_slots[place] = s[p:-1, -1]
        return normal


class FrictionNormalEquations:
    """Normal equations of the friction coefficients, with theta eliminated."""

    def __init__(self, normal: Normal, prior: Prior) -> None:
        self.by_slots: FloatArray = np.zeros_like(normal.cross)
        self.start: FloatArray = prior.center
        if not prior.kept:
            strength = normal.rows * prior.weight
            right = normal.right_rigid + strength * prior.center
            solved = np.linalg.solve(
                normal.rigid + np.diag(strength), np.column_stack((normal.cross, right))
            )
            self.by_slots = np.asarray(solved[:, :-1], dtype=np.float64)
            self.start = np.asarray(solved[:, -1], dtype=np.float64)
        self.left = normal.slots.copy()
        for start in range(0, len(self.left), K):
            place = slice(start, start + K)
            self.left[place] -= normal.cross[:, place].T @ self.by_slots
        self.right = normal.right_slots - normal.cross.T @ self.start

    def fit(self, chosen: Sequence[Sequence[int]]) -> Fit:
        """Return the estimate with slots `chosen[j]` of joint j, all >= 0."""
        place = places(chosen)
        x = np.zeros(self.right.size)
        x[place] = non_negative(self.left[np.ix_(place, place)], self.right[place])
        return Fit(self.start - self.by_slots @ x, x.reshape(len(chosen), -1))


class ManyNormalEquations:
    """Normal equations of all held-out parts, solved together."""

    def __init__(self, equations: Sequence[FrictionNormalEquations]) -> None:
        self.left = np.array([equation.left for equation in equations])
        self.right = np.array([equation.right for equation in equations])
        self.by_slots = np.array([equation.by_slots for equation in equations])
        self.start = np.array([equation.start for equation in equations])

    def fit(self, chosen: Sequence[Sequence[int]]) -> tuple[FloatArray, FloatArray]:
        """Return theta (parts, p) and coefficients (parts, nj, K) of all parts."""
        place = places(chosen)
        x = np.zeros_like(self.right)
        x[:, place] = non_negative(self.left[:, place[:, None], place], self.right[:, place])
        theta = self.start - (self.by_slots @ x[:, :, None])[:, :, 0]
        return theta, x.reshape(len(x), len(chosen), -1)


def weighted(rows: Sequence[Rows], fit: Fit) -> tuple[tuple[FloatArray, ...], FloatArray]:
    """Return each row's weight (Huber), and each joint's: 1/variance of its residual."""
    of_rows, of_joints = [], []
    for j, own in enumerate(rows):
        off = np.abs(residuals(own, fit, j))
        if off.size == 0:
            of_rows.append(off)
            of_joints.append(0.0)
            continue
        most = _HUBER * 1.4826 * float(np.median(off)) + 1e-12
        weight = np.minimum(1.0, most / np.maximum(off, 1e-12))
        of_rows.append(weight)
        least = _EXACT**2 * float(np.mean(own.effort**2)) + 1e-12
        of_joints.append(1.0 / max(float(np.mean(weight * off**2)), least))
    return tuple(of_rows), np.array(of_joints)


def products_by_block(
    columns: FloatArray, weight: FloatArray, block: IntArray, blocks: int
) -> FloatArray:
    """Return A^T W A of each block's rows, (blocks, p, p).

    Args:
        columns: (n, p) A. weight: (n,) the diagonal of W. block: (n,) number of each row's block.
    """
    size = columns.shape[1]
    products = np.zeros((blocks, size, size))
    for b in np.unique(block):
        in_block = block == b
        products[b] = gram(columns[in_block], weight[in_block])
    return products


def gram(columns: FloatArray, weight: FloatArray) -> FloatArray:
    """Return A^T W A, by as many rows at a time as BLAS multiplies in one thread.

    Args:
        columns: (n, p) A. weight: (n,) the diagonal of W.
    """
    size = columns.shape[1]
    total, rows = np.zeros((size, size)), _rows_alone(size, size)
    for start in range(0, len(columns), rows):
        chunk = columns[start : start + rows]
        total += (chunk * weight[start : start + rows, None]).T @ chunk
    return total


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return orthonormal columns (n, r) that span given ones (n, m), dependent or not."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    if not scaled.size:
        return scaled
    values, vectors = np.linalg.eigh(gram(scaled, np.ones(len(scaled))))
    kept = values > _DEPENDENT * max(float(values.max(initial=0.0)), 1e-300)
    return _times(scaled, vectors[:, kept] / np.sqrt(values[kept]))


def beside(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return columns less their part in the span of a basis: A - B (B^T A).

    Args:
        basis: (n, r) B, orthonormal. columns: (n, m) A.
    """
    r, rows = basis.shape[1], _rows_alone(basis.shape[1], columns.shape[1])
    projection = np.zeros((r, columns.shape[1]))
    for start in range(0, len(columns), rows):
        projection += basis[start : start + rows].T @ columns[start : start + rows]
    return columns - _times(basis, projection)


def _times(columns: FloatArray, small: FloatArray) -> FloatArray:
    """Return A S of a long A (n, m) and a small S (m, k)."""
    result, rows = np.empty((len(columns), small.shape[1])), _rows_alone(*small.shape)
    for start in range(0, len(columns), rows):
        result[start : start + rows] = columns[start : start + rows] @ small
    return result


def _rows_alone(m: int, k: int) -> int:
    """Rows of a product with m k numbers each that BLAS makes in one thread."""
    return max(1, _ALONE // max(1, m * k))


def places(chosen: Sequence[Sequence[int]]) -> IntArray:
    """Return the places of all joints' chosen slots among (nj K,)."""
    return np.array(
        [j * K + slot for j, slots in enumerate(chosen) for slot in sorted(slots)],
        dtype=np.int64,
    )


def above_zero(fit: Fit, chosen: Sequence[Sequence[int]]) -> IntArray:
    """Return the places among (nj K,) of chosen coefficients that are not zero."""
    place = places(chosen)
    return place[fit.slots.ravel()[place] > 0.0]


def non_negative(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the x >= 0 that makes x^T left x / 2 - right^T x least.

    Columns are scaled to one; a ridge decides between dependent ones. All problems are solved
    together: coefficients below zero are set to zero, and those freed whose gradient asks for it,
    until none is left (Kim and Park, Fast nonnegative matrix factorization, 2011). Where that
    cycles, each is solved by itself.

    Args:
        left: (..., n, n) symmetric, positive semidefinite. right: (..., n).
    """
    from scipy.optimize import nnls

    n = right.shape[-1]
    if n == 0:
        return np.zeros_like(right)
    diagonal = np.diagonal(left, axis1=-2, axis2=-1)
    least = 1e-30 * np.maximum(diagonal.max(axis=-1, keepdims=True), 1.0)
    size = np.sqrt(np.maximum(diagonal, least))
    scaled = left / (size[..., :, None] * size[..., None, :]) + RIDGE * np.eye(n)
    target = right / size
    matrices, wanted = scaled.reshape(-1, n, n), target.reshape(-1, n)
    solutions, free = np.empty_like(wanted), np.ones(wanted.shape, dtype=bool)
    open_, slack = np.arange(len(wanted)), _SLACK * np.abs(wanted).max(axis=1, keepdims=True)
    for _ in range(_EXCHANGES):
        here, own = free[open_], matrices[open_]
        held = own * (here[:, :, None] & here[:, None, :]) + np.eye(n) * ~here[:, None, :]
        x = np.linalg.solve(held, (wanted[open_] * here)[:, :, None])
        gradient = (own @ x)[:, :, 0] - wanted[open_]
        solutions[open_] = x[:, :, 0]
        wrong = np.where(here, solutions[open_] < 0.0, gradient < -slack[open_])
        free[open_] = here ^ wrong
        open_ = open_[wrong.any(axis=1)]
        if open_.size == 0:
            break
    for at in open_.tolist():
        values, vectors = np.linalg.eigh(matrices[at])  # rounding may leave some below zero
        root = np.sqrt(np.maximum(values, RIDGE))
        solutions[at], _ = nnls(root[:, None] * vectors.T, vectors.T @ wanted[at] / root)
    return np.asarray(solutions.reshape(right.shape) / size)


def residuals(rows: Rows, fit: Fit, joint: int) -> FloatArray:
    """Return measured less fitted effort of a joint's rows, (n,) N m or N."""
    fitted = np.einsum("ni,i->n", rows.rigid, fit.theta)
    return rows.effort - fitted - np.einsum("ni,i->n", rows.slots, fit.slots[joint])


def block_errors(products: FloatArray, values: FloatArray) -> FloatArray:
    """Return the sum of squared residuals of each block, (blocks,), in (N m)^2 or N^2.

    Args:
        products: (blocks, p + K + 1, p + K + 1) of one joint.
        values: (blocks, p + K) its coefficients in each.
    """
    x = np.hstack((-values, np.ones((len(values), 1))))
    return np.maximum(np.sum((products @ x[:, :, None])[:, :, 0] * x, axis=1), 0.0)
