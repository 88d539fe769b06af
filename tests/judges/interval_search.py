"""The judge's search: all loads that obey z = k + sum |p + P z|, in plain NumPy.

If the right side contracts, there is exactly one solution (Banach). Else boxes of loads are cut
until Krawczyk's test shows that each contains no solution or exactly one (Krawczyk 1969; Moore
1977): up to rounding, a proof of their number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

#: Loads up to this many times the largest term are searched.
_FAR = 1e7
#: Largest number of boxes of one search, and their least width relative to the loads in them.
_MOST_BOXES, _NARROW = 20_000, 1e-10
#: Singular values this small beside the largest are 0.
_RANK = 1e-12
#: Two solutions closer than this, relative to their size, are one.
_DISTINCT = 1e-6
#: A box is enlarged by this fraction for its test, so that a solution on a border is inside one.
_MARGIN = 1.05
#: Passes towards a solution; a residual that stops falling ends them.
_PASSES = 200
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Loads:
    """Loads of m choices of friction at once: z_k = k_k + sum over k's contacts of |p_t + P_t z|.

    Attributes:
        k: (nz,). owner: (nz, nt) 1 where a contact force adds to a load.
        p: (m, nt, 3). P: (m, nt, 3, nz).
    """

    k: np.ndarray
    owner: np.ndarray
    p: np.ndarray
    P: np.ndarray

    def of(self, one: np.ndarray) -> Loads:
        """Return the choices of the given numbers."""
        return Loads(self.k, self.owner, self.p[one], self.P[one])

    def forces(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return contact forces (m, nt, 3) under loads z (m, nz), and their sizes (m, nt)."""
        force = self.p + np.einsum("mtej,mj->mte", self.P, z)
        return force, np.sqrt((force**2).sum(axis=2))

    def residual(self, z: np.ndarray) -> np.ndarray:
        """Return z - k - sum |p + P z|, (m, nz)."""
        return np.asarray(z - self.k - self.forces(z)[1] @ self.owner.T)

    def rounding(self, z: np.ndarray) -> np.ndarray:
        """Return (m, nz) the rounding error of the residual."""
        terms = np.abs(self.p).sum(axis=2)
        terms = terms + np.einsum("mtej,mj->mt", np.abs(self.P), np.abs(z))
        return np.asarray(_EPS * (np.abs(z) + self.k + terms @ self.owner.T))

    def slope(self, z: np.ndarray) -> np.ndarray:
        """Return the Jacobian (m, nz, nz) of the residual; a force of zero adds nothing."""
        force, size = self.forces(z)
        unit = force / np.where(size > 0.0, size, 1.0)[:, :, None]
        along = np.einsum("mte,mtej->mtj", unit, self.P)
        return np.asarray(np.eye(z.shape[1]) - np.einsum("kt,mtj->mkj", self.owner, along))

    @property
    def steepness(self) -> np.ndarray:
        """(m, nt, nz) the most by which a force's size changes per unit load."""
        return np.asarray(np.sqrt((self.P**2).sum(axis=2)))

    @property
    def contraction(self) -> np.ndarray:
        """(m,) spectral radius of the steepness; below 1 there is exactly one solution."""
        matrix = np.einsum("kt,mtj->mkj", self.owner, self.steepness)
        return np.asarray(np.abs(np.linalg.eigvals(matrix)).max(axis=1, initial=0.0))


@dataclass(frozen=True)
class Found:
    """Results of a search over m choices.

    Attributes:
        choice: (n,) to which each solution belongs. z: (n, nz).
        decided: (m,) whether these are proved to be all.
    """

    choice: np.ndarray
    z: np.ndarray
    decided: np.ndarray


def all_solutions(loads: Loads) -> Found:
    """Return every solution of every choice."""
    m, nz = len(loads.p), len(loads.k)
    if nz == 0:
        return Found(np.arange(m), np.zeros((m, 0)), np.ones(m, dtype=bool))
    contracts = loads.contraction < 1.0 - 1e-9
    z = _near(loads, np.tile(loads.k, (m, 1)), contracts)
    near = np.abs(loads.residual(z)) <= 1e4 * loads.rounding(z)
    decided = contracts & near.all(axis=1)
    choice, solutions = [np.flatnonzero(decided)], [z[decided]]
    for one in np.flatnonzero(~contracts):
        found, complete = _boxes(loads.of(np.array([one])))
        decided[one] = complete
        choice.append(np.full(len(found), one))
        solutions.append(found)
    return Found(np.concatenate(choice), np.concatenate(solutions), decided)


def _near(loads: Loads, z: np.ndarray, passes_help: np.ndarray) -> np.ndarray:
    """Return where Newton's method, or the fixed point where that helps, ends from z (m, nz).

    `passes_help` (m,): where the fixed point converges.
    """
    rest = loads.residual(z)
    best, least = z.copy(), np.abs(rest).max(axis=1)
    for _ in range(_PASSES):
        J = loads.slope(z)
        good = np.abs(np.linalg.det(J)) > 1e-14
        step = rest.copy()
        step[good] = np.linalg.solve(J[good], rest[good][:, :, None])[:, :, 0]
        trial = z - step
        size = np.abs(loads.residual(trial)).max(axis=1)
        worse = passes_help & ~(size < 0.9 * np.abs(rest).max(axis=1))
        trial[worse] = (z - rest)[worse]
        z = np.where(np.isfinite(trial), trial, z)
        rest = loads.residual(z)
        size = np.abs(rest).max(axis=1)
        better = size < least
        best[better], least[better] = z[better], size[better]
        if not better.any() or (np.abs(rest) <= 2 * loads.rounding(z)).all():
            break
    return best


class _Reduced(NamedTuple):
    """The loads of one choice in the few coordinates y that move any contact force.

        z = k + owner |p + B y|,    y = c + M |p + B y|,    M = C owner,  c = C k,  y = C z

    Attributes:
        c: (r,). M: (r, nt). p: (nt, 3). B: (nt, 3, r). steep: (nt, r) lengths of B's columns.
    """

    c: np.ndarray
    M: np.ndarray
    p: np.ndarray
    B: np.ndarray
    steep: np.ndarray

    @classmethod
    def of(cls, loads: Loads) -> _Reduced:
        """Reduce the only choice of some loads by the singular values of P."""
        P = loads.P[0].reshape(-1, len(loads.k))
        left, size, right = np.linalg.svd(P, full_matrices=False)
        r = int((size > _RANK * size[0]).sum())
        B, C = (left[:, :r] * size[:r]).reshape(*loads.p[0].shape, r), right[:r]
        return cls(C @ loads.k, C @ loads.owner, loads.p[0], B, np.linalg.norm(B, axis=1))

    def forces(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return contact forces (n, nt, 3) at y (n, r), and their sizes (n, nt)."""
        force = self.p + np.einsum("tej,nj->nte", self.B, y)
        return force, np.sqrt((force**2).sum(axis=2))

    def rounding(self, y: np.ndarray) -> np.ndarray:
        """Return (n, r) the rounding error of y - c - M |p + B y|."""
        terms = np.abs(self.p).sum(axis=1)
        terms = terms + np.einsum("tej,nj->nt", np.abs(self.B), np.abs(y))
        return np.asarray(_EPS * (np.abs(y) + np.abs(self.c) + terms @ np.abs(self.M).T))


def _boxes(loads: Loads) -> tuple[np.ndarray, bool]:
    """Return all solutions (n, nz) of one choice, and whether they are proved to be all."""
    here = _Reduced.of(loads)
    largest = float((np.abs(loads.p[0]).sum(axis=1) @ loads.owner.T + loads.k).max())
    if largest == 0.0:  # nothing loads anything
        return np.zeros((1, len(loads.k))), True
    high = np.full((1, len(here.c)), _FAR * largest)
    low, found, looked, complete = -high, [np.zeros((0, len(loads.k)))], 0, True
    while len(low):
        looked += len(low)
        if looked > _MOST_BOXES:
            complete = False
            break
        low, high = _within(here, low, high)
        middle, radius = 0.5 * (low + high), 0.5 * (high - low)
        step, spread = _krawczyk(here, middle, radius)
        with np.errstate(invalid="ignore"):
            empty = (np.abs(step) > radius + spread + 4 * here.rounding(middle)).any(axis=1)
            alone = (np.abs(step) + _MARGIN * spread < _MARGIN * radius).all(axis=1) & ~empty
        inside = _settled(here, middle[alone], radius[alone])
        start = loads.k + here.forces(inside)[1] @ loads.owner.T
        one = loads.of(np.zeros(len(start), dtype=int))
        found.append(_near(one, start, np.zeros(len(start), dtype=bool)))
        narrow = (radius < _NARROW * (np.abs(middle) + largest)).all(axis=1) & ~empty & ~alone
        complete &= not narrow.any()
        low, high = _halves(here, low, high, ~(empty | alone | narrow))
    return _unique(np.concatenate(found)), complete


def _within(here: _Reduced, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Narrow boxes to where y can be c + M |p + B y|; drop those where it cannot."""
    middle, radius = 0.5 * (low + high), 0.5 * (high - low)
    force, size = here.forces(middle)
    reach = np.einsum("tej,nj->nte", np.abs(here.B), radius)
    round_reach = np.einsum("tj,nj->nt", here.steep, radius)
    least = np.sqrt((np.maximum(np.abs(force) - reach, 0.0) ** 2).sum(axis=2))
    least = np.maximum(least, size - round_reach)
    most = np.sqrt(((np.abs(force) + reach) ** 2).sum(axis=2))
    most = np.minimum(most, size + round_reach)
    plus, minus = np.maximum(here.M, 0.0), np.maximum(-here.M, 0.0)
    slack = 4 * here.rounding(np.abs(middle) + radius)
    low = np.maximum(low, here.c + least @ plus.T - most @ minus.T - slack)
    high = np.minimum(high, here.c + most @ plus.T - least @ minus.T + slack)
    some = (low <= high).all(axis=1)
    return low[some], high[some]


def _krawczyk(
    here: _Reduced, middle: np.ndarray, radius: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return Newton's step from the middle of each box, and its spread over the box.

    A solution in the box is within the spread of middle - step; if that is within the box, there is
    exactly one. The slope of a force's size changes by its steepness times the change of its
    direction.
    """
    force, size = here.forces(middle)
    unit = force / np.where(size > 0.0, size, 1.0)[:, :, None]
    J = np.eye(len(here.c)) - np.einsum("kt,nte,tej->nkj", here.M, unit, here.B)
    good = np.abs(np.linalg.det(J)) > 1e-12
    inverse = np.full(J.shape, np.nan)
    inverse[good] = np.linalg.inv(J[good])
    rest = middle - here.c - size @ here.M.T
    reach = _MARGIN * np.einsum("tj,nj->nt", here.steep, radius)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where(reach < size, np.minimum(2.0, 2.0 * reach / (2.0 * size - reach)), 2.0)
    change = np.einsum("kt,nt->nk", np.abs(here.M), np.where(reach == 0.0, 0.0, turn) * reach)
    spread = np.einsum("nkj,nj->nk", np.abs(inverse), change)
    return np.einsum("nkj,nj->nk", inverse, rest), spread


def _settled(here: _Reduced, middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return near the only solution of each box: Krawczyk's test again on the box that it leaves.

    Newton's method alone may leave the box for the solution of another one.
    """
    middle, radius = middle.copy(), radius.copy()
    for _ in range(_PASSES):
        step, spread = _krawczyk(here, middle, radius)
        smaller = (spread < 0.99 * radius).any(axis=1) & np.isfinite(spread).all(axis=1)
        if not smaller.any():
            break
        low, high = middle - radius, middle + radius
        low = np.maximum(low, middle - step - spread)[smaller]
        high = np.minimum(high, middle - step + spread)[smaller]
        middle[smaller], radius[smaller] = 0.5 * (low + high), 0.5 * np.maximum(high - low, 0.0)
    return middle


def _halves(
    here: _Reduced, low: np.ndarray, high: np.ndarray, keep: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cut the boxes to keep where their width matters most; far from zero nearer to it."""
    low, high = low[keep], high[keep]
    rows = np.arange(len(low))
    axis = np.argmax((high - low) * np.linalg.norm(here.steep, axis=0), axis=1)
    a, b = low[rows, axis], high[rows, axis]
    near, far = np.minimum(np.abs(a), np.abs(b)), np.maximum(np.abs(a), np.abs(b))
    cut = np.where(a * b < 0.0, 0.0, np.sign(a + b) * np.sqrt(np.maximum(near, 1e-3 * far) * far))
    cut = np.where((far < 4.0 * near) | ((a * b < 0.0) & (far < 4.0 * near)), 0.5 * (a + b), cut)
    left, right = high.copy(), low.copy()
    left[rows, axis] = right[rows, axis] = cut
    return np.concatenate([low, right]), np.concatenate([left, high])


def _unique(found: np.ndarray) -> np.ndarray:
    kept: list[np.ndarray] = []
    for z in found:
        if all(np.abs(z - other).max() > _DISTINCT * np.abs(z).max() for other in kept):
            kept.append(z)
    return np.array(kept).reshape(-1, found.shape[1])
