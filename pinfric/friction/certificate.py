"""All answers of joints at rest in an open chain: they lie in a ball around the kinetic answer.

The kinetic answer x0 is that with sliding friction as static limits; it obeys the true laws, too.
Of any other answer x0 + d, with a_c, e_c and kappa of `notebooks/theory/resting.md` and kappa < 1,

    (1 - kappa) |d|_R^2 <= sum over T of e_c |r_c(x0)|,     T: slip in x0 and stick in x

So a joint that moves fast in x0 slips in every answer, and one that needs little friction sticks.
With each set of the other joints that slips there is at most one answer; pivoting finds its
directions. A rotor whose gear does not lock itself counts as I / (steepest slope of its lines) in
R.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from math import comb

import numpy as np

from pinfric.friction.balance import RANK
from pinfric.friction.law import stick_limits
from pinfric.friction.problem import Modes, Problem

#: kappa has to be below this. Bounds are widened by this part for rounding.
_BELOW, _ROUNDING = 0.999, 1e-9
#: Sets of slipping joints that are looked at.
_MOST_SETS = 20_000


def kinetic(problem: Problem, at_rest: np.ndarray) -> Problem | None:
    """Return the problem with sliding friction as static limits; None: true ones are below it.

    A gear at rest holds what its lines in motion would hold. None, too, where a gear locks itself.
    """
    lines, gears = problem.gear_lines.copy(), len(problem.gear_rotor)
    if gears and lines[:, :2, :, 0].min() <= 0.0:
        return None
    bearings = at_rest[problem.coordinate]
    bearings[len(bearings) - gears :] = False
    above = problem.mu_stick >= problem.mu_slip
    above &= (problem.coulomb_stick >= problem.coulomb_slip).all(axis=1) & (problem.drag == 0.0)
    if not above[bearings].all():
        return None
    same = (problem.mu_stick == problem.mu_slip)[bearings].all()
    same &= (problem.coulomb_stick == problem.coulomb_slip)[bearings].all()
    if same and not gears:
        return problem
    mu, coulomb = problem.mu_stick.copy(), problem.coulomb_stick.copy()
    mu[bearings], coulomb[bearings] = problem.mu_slip[bearings], problem.coulomb_slip[bearings]
    held = problem.gear_held.copy()
    for g in np.flatnonzero(at_rest[problem.gear_coordinate]).tolist():
        u, (least, most) = problem.gear_rotor[g, 0], held[g, 0]
        low, high = (_on_line(way, u) for way in lines[g, :2])
        if not least <= low <= high <= most:
            return None
        lines[g, 2:], held[g, 0], held[g, 1:] = lines[g, :2], (low, high), (np.inf, -np.inf)
        coulomb[len(coulomb) - gears + g] = u - low, high - u
    return problem._replace(mu_stick=mu, coulomb_stick=coulomb, gear_lines=lines, gear_held=held)


def _on_line(lines: np.ndarray, u: float) -> float:
    """The effort that a gear delivers of u at r = 0, on rising lines (n, 3) of one direction."""
    k = 0
    while k + 1 < len(lines) and lines[k + 1, 2] < np.inf:
        if lines[k + 1, 0] * lines[k + 1, 2] + lines[k + 1, 1] > u:
            break
        k += 1
    return float((u - lines[k, 1]) / lines[k, 0])


class Ball:
    """The ball of a problem's answers.

    Attributes:
        sure: whether kappa < 1.
        slips, open: coordinates that slip in every answer; those that may slip in some.

    Args:
        problem: `Problem`, of an open chain.
        limits: `kinetic` of it.
        centre: modes of x0, solved.
        at_rest: (nc,) bool.
    """

    def __init__(
        self, problem: Problem, limits: Problem, centre: Modes, at_rest: np.ndarray
    ) -> None:
        nc = len(at_rest)
        self.centre = centre
        self.moved = moved = at_rest & ~centre.stuck
        self.sure, self.slips, self.open = True, np.flatnonzero(moved), np.flatnonzero([])
        entry = problem.contact_entry
        loaded = problem.mu_slip[entry].any() or problem.mu_stick[entry].any()
        if limits is problem and not loaded:
            return  # the only answer
        side = np.where(centre.direction > 0.0, 0, 1)
        ends = np.zeros((2, 2, nc))  # of the true limits and of the kinetic ones
        for end, p in zip(ends, (problem, limits), strict=True):
            stick_limits(p, centre.load, *end)
        ends[:, 0] *= -1.0
        with np.errstate(invalid="ignore"):  # a brake may hold any load
            above = np.nan_to_num((ends[0] - ends[1])[side, np.arange(nc)])
        self.excess = np.where(moved, np.maximum(above, 0.0) * np.abs(centre.rate), 0.0)
        x = centre.friction
        self.room = np.minimum(x + ends[1, 0], ends[1, 1] - x)
        self.R, contact = _behind_gears(problem)
        size, axes = np.linalg.eigh(self.R)
        if not size[0] > RANK * size[-1]:
            self.sure = False
            return
        root = axes / np.sqrt(size)
        P = root.T @ contact
        each = np.linalg.norm(P, ord=2, axis=(1, 2))
        ratio, owner = np.abs(problem.ratio)[entry], problem.coordinate[entry]
        slide = ratio * problem.mu_slip[entry]
        self.a = np.bincount(owner, slide * each, nc)
        more = np.maximum(problem.mu_stick - problem.mu_slip, 0.0)[entry]
        grows = np.bincount(owner, ratio * more * each, nc)
        self.grows = np.where(moved, grows * np.abs(centre.rate), 0.0)
        self.kappa = self._kappa(root, P, slide, each, owner)
        self.sure = self.kappa < _BELOW
        if not self.sure:
            return
        self.width = np.sqrt(np.diag(self.R))
        self.reach = np.sqrt(np.diag(np.linalg.inv(self.R))) + self.a
        self._mark(moved, at_rest)

    def _kappa(
        self,
        root: np.ndarray,
        P: np.ndarray,
        slide: np.ndarray,
        each: np.ndarray,
        owner: np.ndarray,
    ) -> float:
        """The smaller of two bounds of sum |(R d)_c| |dL_c| / |d|_R^2."""
        a, R = self.a, self.R
        plain = float(np.sqrt(a @ np.abs(R) @ a))
        if plain < 0.5 * _BELOW:
            return plain
        weight = np.where(a > 0.0, a / np.sqrt(np.diag(R)), 0.0)
        rows = root.T @ R  # columns: R_c in the axes in which |d|_R is a length
        total = 0.5 * (rows * weight) @ rows.T
        share = slide * a[owner] / np.where(each > 0.0, each, 1.0)
        share = share / np.where(weight[owner] > 0.0, weight[owner], 1.0)
        total += 0.5 * np.einsum("t,tie,tje->ij", share, P, P)
        return min(plain, float(np.linalg.eigvalsh(total)[-1]))

    def radius(self, sticking: np.ndarray) -> float:
        """Return a bound of |d|_R if, of the joints that slip in x0, only these may stick."""
        E, B, margin = self.excess[sticking].sum(), self.grows[sticking].sum(), 1.0 - self.kappa
        return float((B + np.sqrt(B * B + 4.0 * margin * E)) / (2.0 * margin)) * (1.0 + _ROUNDING)

    def _mark(self, moved: np.ndarray, at_rest: np.ndarray) -> None:
        """Write `slips` and `open`."""
        unsure, speed = moved.copy(), np.abs(self.centre.rate)
        while True:
            radius = self.radius(unsure)
            remaining = unsure & (speed <= self.width * radius + _ROUNDING * speed)
            if (remaining == unsure).all():
                break
            unsure = remaining
        near = at_rest & ~moved & (self.room <= self.reach * radius + _ROUNDING * np.abs(self.room))
        self.slips = np.flatnonzero(moved & ~unsure)
        self.open = np.flatnonzero(unsure | (near if radius > 0.0 else False))

    def sets(self) -> Iterator[list[np.ndarray]]:
        """Yield, by their size, the sets of joints that may slip while the others stick.

        The set that slips in x0 is among the last. Beyond `_MOST_SETS` sets it ends early.
        """
        looked = 0
        for more in range(int(self.moved.sum()) - len(self.slips) + 1):
            looked += comb(len(self.open), more)
            if looked > _MOST_SETS:
                return
            each = combinations(self.open.tolist(), more)
            slipping_sets = (
                np.array([*self.slips.tolist(), *those], dtype=np.int64) for those in each
            )
            yield [slipping for slipping in slipping_sets if self._may_slip(slipping)]

    def _may_slip(self, slipping: np.ndarray) -> bool:
        """Whether an answer in which these slip, and no others, may be in the ball."""
        sticking = self.moved.copy()
        sticking[slipping] = False
        here, started = np.flatnonzero(sticking), slipping[~self.moved[slipping]]
        if not here.size:
            return True
        radius, rate, room = self.radius(sticking), self.centre.rate[here], self.room[started]
        if (room > self.reach[started] * radius + _ROUNDING * np.abs(room)).any():
            return False
        near = rate @ np.linalg.solve(self.R[here][:, here], rate)
        return bool(near * (1.0 - _ROUNDING) <= radius**2)


def _behind_gears(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """R (nc, nc), and forces (nt, nc, 3) per unit of d by R^-1 R_eff d, behind lightest rotors."""
    R, contact, lines = problem.rate_slope, problem.contact[:, 1:], problem.gear_lines
    if not len(lines):
        return R, contact
    lighter = np.zeros(len(R))
    steepest = lines[:, :2, :, 0].max(axis=(1, 2))
    np.add.at(lighter, problem.gear_coordinate, problem.gear_rotor[:, 1] * (1.0 - 1.0 / steepest))
    stiff = np.linalg.inv(R)
    eff = np.linalg.inv(stiff - np.diag(lighter))
    eff = 0.5 * (eff + eff.T)
    return eff, (stiff @ eff).T @ contact
