"""The fastest profile whose motors stay within their continuous torque over the whole cycle.

    min T   with   E_j = int T_j^2 dt + holds <= c_j^2 (T + holds),   low(x) <= u <= high(x)

over the squares x of the speeds at the grid's points, u constant in each interval: a primal barrier
method (Boyd & Vandenberghe, Convex Optimization, 2004, section 11.3). T and E are convex in x but
for viscous friction and Stribeck curves (Verscheure et al. 2009, Time-optimal path tracking for
robots: a convex optimization approach). The Hessian is tridiagonal plus one column for each motor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded
from scipy.optimize import brentq

from pinfric.errors import RetimeError
from pinfric.retiming.problem import PathProblem
from pinfric.retiming.profile import Profile
from pinfric.retiming.scan import box_scan, ranges, torques
from pinfric.retiming.tables import Grid

#: Signs of u in u - low and high - u.
_SIGNS = np.array([1.0, -1.0])
#: Relative steps of differences.
_STEP = 1.0e-6
#: The barrier's weight, as a part of the duration for all constraints together: first and last.
_FIRST, _LAST, _FALL = 0.3, 1.0e-4, 0.2
_NEWTON = 25
#: How much of the uniform slow-down is left as room to begin with.
_ROOM = 0.97


@dataclass(frozen=True)
class HeatBudget:
    """What counts over the cycle beside its moves.

    Attributes:
        limit: (na,) continuous torque, N m; infinite where none.
        hold_energy: (na,) int T^2 dt over all holds, (N m)^2 s.
        hold_time: s.
    """

    limit: np.ndarray
    hold_energy: np.ndarray
    hold_time: float


def within_continuous(
    problem: PathProblem, fast: Profile, cycle: HeatBudget, given: Profile | None = None
) -> tuple[Profile, float]:
    """Return the fastest profile within the continuous torques, and the uniform one's duration, s.

    Args:
        fast: the fastest profile without this limit, returned where it is within it.
        given: another to begin with where no slower `fast` is; it may rest where holding is light.

    Raises:
        RetimeError: neither is within them.
    """
    barrier = _Barrier(problem, cycle)
    if (barrier.slack(fast.x) >= 0.0).all():
        return fast, float(fast.duration.sum())
    try:
        factor = barrier.uniform(fast)
    except RetimeError:
        if given is None or not np.isfinite(barrier.value(given.x, 1.0)):
            raise
        return barrier.from_start(problem.grid, given.x), np.inf
    uniform = fast.scaled(factor)
    total = float(uniform.duration.sum())
    while not np.isfinite(barrier.value(fast.x * (factor * _ROOM) ** 2, 1.0)):
        factor *= 0.9  # friction that falls with the speed, a slower motion beyond a limit
        if factor < 1e-3:
            return uniform, total
    profile = barrier.from_start(problem.grid, fast.x * (factor * _ROOM) ** 2)
    return (profile if profile.duration.sum() <= total else uniform), total


class _Barrier:
    """Duration, torques and constraints of a profile, with derivatives."""

    def __init__(self, problem: PathProblem, cycle: HeatBudget) -> None:
        grid = problem.grid
        constant = replace(problem, constant=np.ones(len(grid.step), dtype=bool))
        scan = constant.scan()
        self.scan, self.cycle = box_scan(scan), cycle
        self.names = problem.scene.actuator_names
        self.step, self.free, self.moving = grid.step, ~grid.stop, _ends(~grid.stop)
        top = np.minimum(
            scan.top[np.append(scan.start, scan.end[-1])],
            scan.top[np.append(scan.start[0], scan.end)],
        )
        self.top = np.where(top < 1e14, top, np.inf)
        self.judged = np.isfinite(cycle.limit)
        #: Weight of a mean square beside a limit of one place, of which there are many.
        self.heavy = 0.1 * len(self.step)

    def durations(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Duration of each interval, its gradient (n, 2) and Hessian (n, 2, 2)."""
        z = np.sqrt(np.maximum(_ends(x), 1e-100))
        total = z.sum(axis=1, keepdims=True)
        time = 2.0 * self.step[:, None] / total
        first = np.where(self.moving, -time / (2.0 * z * total), 0.0)
        second = (time / (2.0 * total**2))[:, :, None] / _outer(z, z)
        second[:, [0, 1], [0, 1]] += time / (4.0 * z**3 * total)
        return time[:, 0], first, np.where(_outer(self.moving, self.moving), second, 0.0)

    def torques(self, x: np.ndarray) -> np.ndarray:
        """(n, 2, na) of the motors."""
        u = np.diff(x) / (2.0 * self.step)
        torque = np.empty((len(u), 2, len(self.cycle.limit)))
        torques(self.scan, _ends(x), np.stack([u, u], axis=1), torque)
        return torque

    def slack(self, x: np.ndarray) -> np.ndarray:
        """(judged,) c^2 (T + holds) - E, as a part of the first; E = int T^2 dt over the cycle."""
        time = self.durations(x)[0]
        energy = time @ _mean_square(self.torques(x)) + self.cycle.hold_energy
        allowed = self.cycle.limit**2 * (time.sum() + self.cycle.hold_time)
        return 1.0 - (energy / allowed)[self.judged]

    def uniform(self, fast: Profile) -> float:
        """The greatest speed factor with which the whole profile is within."""

        def left(factor: float) -> float:
            return float(self.slack(fast.x * factor**2).min())

        factors = np.geomspace(1.0, 1e-2, 60)
        for slower, faster in zip(factors[1:], factors[:-1], strict=True):
            if left(slower) > 0.0:
                return float(brentq(left, slower, faster, xtol=1e-10)) * (1.0 - 1e-9)
        worst = int(np.argmin(self.slack(fast.x * 1e-4)))
        name = [n for n, judged in zip(self.names, self.judged, strict=True) if judged][worst]
        raise RetimeError(
            f"drive {name!r} exceeds its continuous torque at any speed of the fastest motion, "
            "because it holds too much load, and in the given time; take a larger motor, shorter "
            "holds, or heat=False (--no-heat) for a single run"
        )

    def ranges(self, ends: np.ndarray) -> np.ndarray:
        """(n, 2 sides, 2) least and greatest u at both ends of intervals, by x (n, 2)."""
        between = np.empty((2, *ends.shape))
        ranges(self.scan, ends, *between)
        return np.moveaxis(between, 0, 2)

    def gaps(self, x: np.ndarray) -> np.ndarray:
        """(n, 2 sides, 2): u - low and high - u at both ends."""
        u = np.diff(x) / (2.0 * self.step)
        return _SIGNS * (u[:, None, None] - self.ranges(_ends(x)))

    def value(self, x: np.ndarray, weight: float) -> float:
        """The barrier function; infinite outside."""
        if (x[self.free] <= 0.0).any():
            return np.inf
        gap, slack, room = self.gaps(x), self.slack(x), (1.0 - x / self.top)[self.free]
        if not (gap.min() > 0.0 and slack.min() > 0.0 and room.min() > 0.0):
            return np.inf
        logs = np.log(gap).sum() + self.heavy * np.log(slack).sum() + np.log(room).sum()
        return float(self.durations(x)[0].sum() - weight * logs)

    def from_start(self, grid: Grid, x: np.ndarray) -> Profile:
        """Return the fastest profile that is reached from squares of speeds (n + 1,) inside."""
        x = self.minimize(x)
        u = np.diff(x) / (2.0 * self.step)
        return Profile.of(grid, x, np.stack([u, u], axis=1))

    def minimize(self, x: np.ndarray) -> np.ndarray:
        """Return (n + 1,) x of the minimum, following the weights down."""
        count = 4 * len(self.step) + self.heavy * self.judged.sum() + self.free.sum()
        share = _FIRST
        while True:
            weight = share * self.durations(x)[0].sum() / count
            for _ in range(_NEWTON):
                x, gain = self.newton(x, weight)
                if gain < 0.05 * weight * np.sqrt(count):
                    break
            if share <= _LAST:
                return x
            share = max(share * _FALL, _LAST)

    def newton(self, x: np.ndarray, weight: float) -> tuple[np.ndarray, float]:
        """One damped step: the new x, and how much the barrier function fell."""
        gradient, band, columns = self.derivatives(x, weight)
        fixed = ~self.free
        gradient[fixed], columns[fixed] = 0.0, 0.0
        band[0, fixed], band[1, fixed] = 1.0, 0.0
        band[1, :-1][fixed[1:]] = 0.0
        solved = solveh_banded(band, np.column_stack((-gradient, columns)), lower=True)
        direction, response = solved[:, 0], solved[:, 1:]
        direction = direction - response @ np.linalg.solve(
            np.eye(columns.shape[1]) + columns.T @ response, columns.T @ direction
        )
        value, slope = self.value(x, weight), float(gradient @ direction)
        size = min(1.0, 0.99 / max(float((-direction[self.free] / x[self.free]).max()), 0.99))
        while size > 1e-10:
            there = self.value(x + size * direction, weight)
            if there <= value + 0.1 * size * slope:
                return x + size * direction, value - there
            size *= 0.5
        return x, 0.0

    def derivatives(
        self, x: np.ndarray, weight: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gradient (n + 1,), tridiagonal (2, n + 1) and columns (n + 1, judged) of the Hessian."""
        first, second = self._limits(x, weight)
        more, bent, columns = self._heat(x, weight)
        first, second, room = first + more, second + bent, self.top - x
        gradient = np.where(self.free, weight / room, 0.0)
        band = np.stack([np.where(self.free, weight / room**2, 0.0), np.zeros(len(x))])
        for end, own in enumerate((slice(None, -1), slice(1, None))):
            gradient[own] += first[:, end]
            band[0, own] += second[:, end, end]
        band[1, :-1] = second[:, 0, 1]
        return gradient, band, columns

    def _limits(self, x: np.ndarray, weight: float) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (n, 2), Hessian (n, 2, 2): logs of u - low(x), high(x) - u at both ends."""
        gap, ends = self.gaps(x), _ends(x)
        here, moved = self.ranges(ends), ends * (1.0 + _STEP) + 1e-300
        there = self.ranges(moved)
        empty = there[:, :, 0] > there[:, :, 1]  # the step leaves what is possible: the other side
        if empty.any():
            moved = np.where(empty, ends * (1.0 - _STEP), moved)
            there = self.ranges(moved)
        own = -_SIGNS * (there - here) / (moved - ends)[:, :, None]
        by_u = np.stack([-0.5 / self.step, 0.5 / self.step], axis=1)
        first, second = np.zeros(ends.shape), np.zeros((*ends.shape, 2))
        for side in range(2):
            for k, sign in enumerate(_SIGNS):
                slope = sign * by_u
                slope[:, side] += own[:, side, k]
                slope = np.where(self.moving, slope / gap[:, side, k, None], 0.0)
                first -= weight * slope
                second += weight * _outer(slope, slope)
        return first, second

    def _heat(self, x: np.ndarray, weight: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same of the duration, and of the slack of the mean squares: a column per motor."""
        time, first, second = self.durations(x)
        T, slope = self.torques(x), self._torque_slopes(x)
        square = _mean_square(T)
        energy, whole = time @ square + self.cycle.hold_energy, time.sum() + self.cycle.hold_time
        gradient, hessian = first.copy(), second.copy()
        columns = np.zeros((len(x), int(self.judged.sum())))
        for c, d in enumerate(np.flatnonzero(self.judged)):
            limit = self.cycle.limit[d] ** 2
            share = self.heavy * weight / (limit * whole - energy[d])
            a, b, Ta, Tb = slope[:, 0, d], slope[:, 1, d], T[:, 0, d, None], T[:, 1, d, None]
            grown = ((2 * Ta + Tb) * a + (Ta + 2 * Tb) * b) / 3.0
            own = first * (square[:, d] - limit)[:, None] + time[:, None] * grown
            products = 2.0 * (_outer(a, a) + _outer(b, b)) + _outer(a, b) + _outer(b, a)
            gradient += share * own
            hessian += share * (
                time[:, None, None] * products / 3.0
                + _outer(first, grown)
                + _outer(grown, first)
                + second * (square[:, d] - limit)[:, None, None]
            )
            columns[:-1, c] += own[:, 0]
            columns[1:, c] += own[:, 1]
            columns[:, c] *= share / np.sqrt(self.heavy * weight)
        values, vectors = np.linalg.eigh(hessian)  # convex but for friction that depends on speed
        values = np.maximum(values, 1e-6 * np.abs(values).max(axis=1, keepdims=True))
        return gradient, np.einsum("nik,nk,njk->nij", vectors, values, vectors), columns

    def _torque_slopes(self, x: np.ndarray) -> np.ndarray:
        """(n, 2, na, 2) derivatives of `torques` by the speeds at both ends."""
        T = self.torques(x)
        slope = np.zeros((*T.shape, 2))
        for k in range(2):  # every second point moves: an interval feels one of its ends
            moved = x.copy()
            moved[k::2] *= 1.0 + _STEP
            difference, change = self.torques(moved) - T, moved - x
            for end in range(2):
                rows = np.arange(end, len(x) - 1 + end)
                own = (rows % 2 == k) & self.free[rows]
                slope[own, :, :, end] = difference[own] / change[rows[own], None, None]
        return slope


def _outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, :, None] * b[:, None, :]


def _ends(x: np.ndarray) -> np.ndarray:
    """(n, 2) values of points (n + 1,) at both ends of each interval."""
    return np.stack([x[:-1], x[1:]], axis=1)


def _mean_square(T: np.ndarray) -> np.ndarray:
    """(n, na) mean T^2, T linear between its ends (n, 2, na)."""
    return (T[:, 0] ** 2 + T[:, 0] * T[:, 1] + T[:, 1] ** 2) / 3.0
