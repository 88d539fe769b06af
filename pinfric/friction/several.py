"""All frictions in given modes, where there may be several: a complete search.

In given modes friction that depends on loads is z_k = offset_k + sign_k y_k with

    y_k = sum |gain| |p|,      p = P_0 + P y,      y >= 0

In homogeneous coordinates u = (tau, y) every solution lies in the simplex tau + sum y = 1, which is
cut into parts. In each f_k(u) = y_k - sum |gain| |P u| is concave: not below the chord through the
corners, not above its tangent. A part is done if such bounds exclude a solution, or if forces turn
so little in it that f is one to one: then Newton's method finds the only one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.dense import largest
from pinfric.friction.given_modes import Reduced, keep, newton, reduce_problem
from pinfric.friction.law import stick_limits
from pinfric.friction.problem import Problem
from pinfric.friction.tree import write_box
from pinfric.kernels.compiled import kernel

#: Up to so many frictions that follow loads all solutions are found; most simplices to look at.
MOST_COUPLED, MOST_PARTS = 6, 20_000
#: Solutions closer than this, relative to their size, are one; a simplex so small is not cut.
_DISTINCT, _SMALL = 1e-6, 1e-7
#: Simplices that are examined together, those cut last first.
_AT_ONCE = 64
#: Starts of a wide search; what Newton's method must reach there (it stops at rounding).
_STARTS, _RESIDUAL = 200, 1e-12
#: Of the starts' frictions, by the size of contact forces times gains; drawn once.
_SCALES = 10.0 ** np.random.default_rng(0).uniform(-4.0, 5.0, size=16 * _STARTS)
#: What rounding leaves of zero; what Newton's method must reach; its passes.
_ROUNDING, _FOUND, _PASSES = 1e-12, 1e-13, 40
#: By more than this share of the terms a law is broken.
_UNJUST = 1e-8
#: Error of tau, as a share of it, up to which a solution counts.
_KNOWN = 0.5


class Frictions(NamedTuple):
    """The result of a search for all frictions.

    Attributes:
        solutions: (nc,) each.
        parts: number of simplices examined.
        complete: whether there are no others; None: not searched for so many entries.
    """

    solutions: list[np.ndarray]
    parts: int
    complete: bool | None


def find_all(
    problem: Problem,
    stuck: np.ndarray,
    direction: np.ndarray,
    rows: np.ndarray,
    obey: np.ndarray | None = None,
) -> Frictions:
    """Return all frictions that fit given modes, of up to `MOST_COUPLED` that follow loads.

    Args:
        stuck, direction: (nc,) the modes. rows: (nc, 3), `gears.write_rows`.
        obey: (nc,) bool, coordinates that have to obey their laws, too: frictions by which one of
            them does not may be missing.
    """
    nz, reduced = reduce_problem(problem, stuck, direction, rows)
    if not 0 < nz <= MOST_COUPLED:
        return Frictions([], 0, None)
    rays = _Rays(reduced)
    if obey is not None:
        rays.laws = _Laws(problem, stuck, direction, obey, rays.friction(reduced.X))
    roots, parts, complete = rays.search()
    solutions = [reduced.X[:, 0] + reduced.X[:, 1:] @ z for z in roots]
    return Frictions(solutions, parts, complete)


@kernel
def from_many_starts(
    reduced: Reduced, direction: np.ndarray, solutions: np.ndarray, found: int, figures: np.ndarray
) -> int:
    """Append the frictions that Newton's method finds from many starts; return how many there are.

    Starts are on every scale (`_SCALES`). It proves nothing.

    Args:
        reduced: `Reduced`.
        direction: (nc,) of the slip.
        solutions, found, figures: see `given_modes.solve_given_modes`; those found before.
    """
    unknown, X, _, _, gain, contact = reduced
    z, drawn, scale = np.zeros(contact.shape[1] - 1), contact.shape[1] - 1, 0.0
    for t in range(gain.size):
        scale = max(scale, np.abs(contact[t, 0]).max())
    scale *= largest(gain)
    for start in range(_STARTS if z.size > 0 else 0):
        for c in range(unknown.size if start > 0 else 0):
            if unknown[c] >= 0:
                size = (scale if scale > 0.0 else 1.0) * _SCALES[drawn % _SCALES.size]
                z[unknown[c]] = -direction[c] * size
                drawn += 1
        error, passes = newton(reduced, z, False)
        figures[1] += passes
        if error <= _RESIDUAL:
            found = keep(X, z, solutions, found)
    return found


def distinct(frictions: np.ndarray) -> list[np.ndarray]:
    """Return the frictions (n, nc) that differ by more than rounding: each by its own scale."""
    kept: list[np.ndarray] = []
    for x in frictions:
        floor = _ROUNDING * float(np.abs(x).max(initial=0.0))
        if all(
            (np.abs(x - other) > _DISTINCT * np.maximum(np.abs(x), np.abs(other)) + floor).any()
            for other in kept
        ):
            kept.append(x)
    return kept


class _Laws:
    """What frictions x = X u of modes have to obey, as functions of u.

    Args:
        problem, stuck, direction, obey: see `find_all`. X: (nc, 1 + nz).
    """

    def __init__(
        self,
        problem: Problem,
        stuck: np.ndarray,
        direction: np.ndarray,
        obey: np.ndarray,
        X: np.ndarray,
    ) -> None:
        R, first = problem.rate_slope, np.eye(1, X.shape[1])
        way = np.where(obey & ~stuck, direction, 0.0)
        moves = np.flatnonzero(way)
        rate = problem.rate_free[:, None] * first + R @ X
        terms = problem.rate_scale[:, None] * first + np.abs(R) @ np.abs(X)
        middle, box = np.empty((2, len(stuck)))
        write_box(problem, obey, direction, middle, box)
        boxed = np.flatnonzero(box < np.inf)
        centred = X[boxed] - middle[boxed, None] * first
        reach, size = (
            box[boxed, None] * first,
            np.abs(X[boxed]) + np.abs(middle)[boxed, None] * first,
        )
        #: (m, 1 + nz) rates along the slip and room in the box; what rounding may leave of them
        self.room = np.vstack([way[moves, None] * rate[moves], reach - centred, reach + centred])
        self.noise = _UNJUST * np.vstack([terms[moves], size + reach, size + reach])
        held = obey & stuck
        held[problem.gear_coordinate] = False  # what they hold is no limit
        self.held = np.flatnonzero(held)
        below, above = np.empty((2, len(stuck)))
        stick_limits(problem, problem.constant, below, above)
        owner, grip = problem.coordinate[problem.contact_entry], problem.grip[problem.contact_entry]
        here = np.flatnonzero(held[owner] & (grip > 0.0))
        whole = np.concatenate([first, X])
        self.x, self.above, self.below = X[self.held], above[self.held], -below[self.held]
        #: (nt, 3, 1 + nz) contact forces times grip; (n, nt) whose limit they are part of
        self.contact = np.einsum("tje,ju->teu", problem.contact[here], whole)
        self.contact *= grip[here, None, None]
        self.owner = (self.held[:, None] == owner[here]).astype(float)

    def are_broken(self, V: np.ndarray) -> np.ndarray:
        """(k,) bool: whether one is, all over a simplex (k, 1 + nz, 1 + nz), corners in columns.

        Rates are linear, and friction less its limit is concave: corners bound both.
        """
        against = (self.room @ V < -(self.noise @ V)).all(axis=2).any(axis=1)
        k, n, m = V.shape
        forces = (self.contact.reshape(-1, n) @ V).reshape(k, len(self.contact), 3, m)
        loads, x = self.owner @ np.linalg.norm(forces, axis=2), self.x @ V
        loads, tau = loads * (1.0 + _UNJUST), V[:, None, 0] * (1.0 + _UNJUST)
        over = (x > loads + self.above[:, None] * tau).all(axis=2)
        over |= (-x > loads + self.below[:, None] * tau).all(axis=2)
        return np.asarray(against | over.any(axis=1))


class _Rays:
    """The equations f(u) = 0 of the module's text, y scaled by its size at rest.

    Attributes:
        laws: that what is looked for has to obey, too; None: none.
    """

    laws: _Laws | None = None

    def __init__(self, reduced: Reduced) -> None:
        _, _, offset, place, gain, contact = reduced
        nz = len(offset)
        self.sign, self.offset = np.zeros(nz), offset
        self.sign[place] = np.sign(gain)
        self.owner = np.zeros((nz, len(gain)))
        self.owner[place, np.arange(len(gain))] = np.abs(gain)
        first = contact[:, 0] + np.einsum("tje,j->te", contact[:, 1:], offset)
        size = self.owner @ np.linalg.norm(first, axis=1)
        self.scale = np.maximum(size, 1e-3 * size.max(initial=1e-300))
        along = contact[:, 1:] * (self.sign * self.scale)[:, None]
        self.P = np.concatenate([first[:, None], along], axis=1).transpose(0, 2, 1)
        self.select = np.eye(1 + nz)[1:] * self.scale[:, None]  # y of u

    def friction(self, X: np.ndarray) -> np.ndarray:
        """Return x (nc, 1 + nz) as a map of u, from X (nc, 1 + nz) as a map of (1, z)."""
        along = X[:, 1:] @ (self.sign[:, None] * self.select)
        along[:, 0] += X[:, 0] + X[:, 1:] @ self.offset
        return np.asarray(along)

    def forces(self, U: np.ndarray) -> np.ndarray:
        """Return the contact forces (k, nt, 3, m) at points U (k, 1 + nz, m)."""
        k, n, m = U.shape
        return (self.P.reshape(-1, n) @ U).reshape(k, len(self.P), 3, m)

    def values(self, U: np.ndarray) -> np.ndarray:
        """Return f (k, nz, m) at points U (k, 1 + nz, m)."""
        sizes = np.linalg.norm(self.forces(U), axis=2)
        return np.asarray(self.select @ U - self.owner @ sizes)

    def slopes(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """df/du (k, nz, 1 + nz) at u (k, 1 + nz), and the directions (k, nt, 3) of the forces."""
        p = self.forces(u[:, :, None])[..., 0]
        size = np.linalg.norm(p, axis=2, keepdims=True)
        e = p / np.where(size > 0.0, size, 1.0)
        return self.select - self.owner @ np.einsum("kte,tej->ktj", e, self.P), e

    def search(self) -> tuple[list[np.ndarray], int, bool]:
        """All solutions z, the simplices looked at, and whether these were enough."""
        solutions: list[np.ndarray] = []
        waiting, parts, complete = np.eye(1 + len(self.scale))[None], 0, True
        while len(waiting) and complete:
            V, waiting = waiting[-_AT_ONCE:], waiting[:-_AT_ONCE]  # corners are columns
            parts += len(V)
            if parts > MOST_PARTS:
                return self._frictions(solutions), parts, False
            if self.laws is not None:
                V = V[~self.laws.are_broken(V)]
            V = V[~self._are_empty(V)]
            small = np.abs(V - V[:, :, :1]).max(axis=(1, 2)) < _SMALL
            cut = ~small
            for k in np.flatnonzero(self._are_single(V) | small):
                done = any(self._inside(V[k], u) for u in solutions)
                u = None if done else self._newton(V[k].mean(axis=1))
                if u is not None and u[0] > 0.0:
                    if all(np.abs(u - other).max() > _DISTINCT for other in solutions):
                        solutions.append(u)
                    done = self._inside(V[k], u)
                cut[k] &= not done
                near = any(np.abs(u - V[k, :, 0]).max() < 10.0 * _SMALL for u in solutions)
                complete &= done or near or not small[k]
            waiting = np.concatenate([waiting, _halves(V[cut])])
        return self._frictions(solutions), parts, complete

    def _frictions(self, solutions: list[np.ndarray]) -> list[np.ndarray]:
        return [self.offset + self.sign * (self.select @ u) / u[0] for u in solutions]

    def _are_empty(self, V: np.ndarray) -> np.ndarray:
        """(k,) bool: whether bounds of f show that no solution is in a simplex."""
        F = self.values(V)
        J, _ = self.slopes(V.mean(axis=2))
        over = J @ V
        slack = _ROUNDING * (np.abs(self.select @ V) + np.abs(F)).max(axis=2)
        empty = (F.min(axis=2) > slack) | (over.max(axis=2) < -slack)
        W = _inverses(J @ (V[:, :, 1:] - V[:, :, :1]))
        rounding = (np.abs(W) @ slack[:, :, None])[:, :, 0]
        low = np.maximum(W, 0.0) @ F + np.minimum(W, 0.0) @ over
        high = np.maximum(W, 0.0) @ over + np.minimum(W, 0.0) @ F
        empty |= (low.min(axis=2) > rounding) | (high.max(axis=2) < -rounding)
        return np.asarray(empty.any(axis=1))

    def _are_single(self, V: np.ndarray) -> np.ndarray:
        """(k,) bool: whether f is one to one in a simplex: forces keep their directions, nearly."""
        J, e = self.slopes(V.mean(axis=2))
        p = self.forces(V)
        size = np.linalg.norm(p, axis=2)
        along = np.einsum("kte,ktem->ktm", e, p) / np.where(size > 0.0, size, np.inf)
        least = along.min(axis=2)
        turn = np.sqrt(np.maximum(2.0 - 2.0 * least, 0.0))  # how far |e - e'| goes
        D = V[:, :, 1:] - V[:, :, :1]
        E = self.owner @ (turn[:, :, None] * np.linalg.norm(self.forces(D), axis=2))
        A = np.abs(_inverses(J @ D)) @ E
        single = (least > 0.0).all(axis=1) & np.isfinite(A).all(axis=(1, 2))  # a cone
        single[single] = np.abs(np.linalg.eigvals(A[single])).max(axis=1) < 0.99
        return np.asarray(single)

    def _inside(self, V: np.ndarray, u: np.ndarray) -> bool:
        """Whether a point is in the simplex."""
        try:
            return bool((np.linalg.solve(V, u) >= -1e-9).all())
        except np.linalg.LinAlgError:
            return False

    def _newton(self, u: np.ndarray) -> np.ndarray | None:
        """A solution from a point on; None where none is near.

        None, too, where rounding of f could move it to tau = 0: a solution at infinity.
        """
        for _ in range(_PASSES):
            f = self.values(u[None, :, None])[0, :, 0]
            rounding = _FOUND * (8 + len(f)) * np.abs(self.select @ u).max()
            try:
                inverse = np.linalg.inv(np.vstack([self.slopes(u[None])[0][0], np.ones(len(u))]))
            except np.linalg.LinAlgError:
                return None
            if np.abs(f).max() <= rounding:
                far = np.abs(inverse[0, :-1]).sum() * rounding > _KNOWN * u[0]
                return None if far else u / u.sum()
            u = u - inverse[:, :-1] @ f
            if not np.isfinite(u).all() or (u < -1.0).any():
                return None
        return None


def _inverses(A: np.ndarray) -> np.ndarray:
    """The inverses of matrices (k, n, n); not a number where there is none."""
    try:
        W = np.linalg.inv(A)
        W[~np.isfinite(W).all(axis=(1, 2))] = np.nan
        return W
    except np.linalg.LinAlgError:
        if len(A) == 1:
            return np.full_like(A, np.nan)
        middle = len(A) // 2
        return np.concatenate([_inverses(A[:middle]), _inverses(A[middle:])])


def _halves(V: np.ndarray) -> np.ndarray:
    """The two halves of each simplex (k, n, n), cut at the middle of its longest edge."""
    k, n, _ = V.shape
    gaps = np.linalg.norm(V[:, :, :, None] - V[:, :, None, :], axis=1)
    i, j = np.unravel_index(gaps.reshape(k, n * n).argmax(axis=1), (n, n))
    each, halves = np.arange(k), np.concatenate([V, V])
    middle = 0.5 * (V[each, :, i] + V[each, :, j])
    halves[each, :, i] = halves[k + each, :, j] = middle
    return halves
