"""Stick and slip of joints that can only move together, as in a closed mechanism.

Of all frictions in equilibrium the one is taken whose largest ratio to its limit, t, is least
(limit analysis, `notebooks/theory/resting.md`):

    |x_k| <= t limit_k,      0 = rate_free + A^T A x

With one degree of freedom x_k = -t limit_k sign(A_k). With several, all joints that move in the
weakest direction w, in which the mechanism breaks away at t = 1, have the ratio t. Limits follow
loads, and loads friction: by the tangents of the limits where the search ends, no x nearby has a
smaller t. Where this t is above 1, `holding` decides whether another x holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinfric.friction.balance import FITS, RANK
from pinfric.friction.gears import (
    MOST_PASSES,
    fit,
    hold_chosen,
    lines_and_rows,
    ways_to_hold,
    without_gears,
)
from pinfric.friction.given_modes import ROUNDING, judge, try_modes
from pinfric.friction.holding import decide
from pinfric.friction.law import add_load_slopes, evaluate, slip_law, stick_limits
from pinfric.friction.problem import Modes, Problem, bounded
from pinfric.friction.sharing import Group, joint_sizes, share_nearby, share_one

#: Passes of Anderson's extrapolation; those in given modes, whatever gears hold, after which no
#: other way is begun.
_PASSES, _MOST_SHARED = 400, 2_000


def connected(linked: np.ndarray) -> list[np.ndarray]:
    """Return the connected parts of what is linked (n, n), each in ascending order."""
    linked, parts = linked | linked.T | np.eye(len(linked), dtype=bool), list[np.ndarray]()
    remain = np.ones(len(linked), dtype=bool)
    while remain.any():
        here = linked[np.argmax(remain)]
        while (wider := linked[here].any(axis=0)).sum() > here.sum():
            here = wider
        remain &= ~here
        parts.append(np.flatnonzero(here))
    return parts


@dataclass(eq=False)
class Mechanism:
    """The coupling of the coordinates of a `Problem`; arrays are overwritten at every state.

    Attributes:
        closed: whether coordinates may depend on each other: no friction is shared in a tree.
        factor: (d, nc) A, all rates are A^T w; d freedoms.
        block: (nc,) number of the joint; the three coordinates of a ball have the same.
        ball: (nc,) bool.
        idle: (nc,) bool, whether a joint is so near its dead centre that its own friction cannot
            hold the mechanism.
        way: (nc,) the direction in which sticking coordinates would break away.
        slope: (nc, nc) rate_slope where it is not A^T A: beside a gear on a line that falls; else
            None.
    """

    closed: bool
    factor: np.ndarray
    block: np.ndarray
    ball: np.ndarray
    idle: np.ndarray
    way: np.ndarray
    slope: np.ndarray | None = None
    _groups: tuple[object, list[Group]] = (None, [])
    _locked: tuple[object, bool] = (None, False)
    _freed: tuple[object, tuple[np.ndarray, ...]] = (None, ())

    def groups(self, stuck: np.ndarray) -> list[Group]:
        """Return the coordinates that stick and share their friction, group by group.

        The last result is kept: it does not change while nothing moves.
        """
        if not self.closed:
            return []
        key: tuple[bytes, ...] = stuck.tobytes(), self.factor.tobytes()
        if self.slope is not None:
            key += (self.slope.tobytes(),)
        if self._groups[0] != key:
            A = self.normalized()[:, held := np.flatnonzero(stuck)]
            together = np.abs(A.T @ A) > RANK
            together |= np.equal.outer(self.block[held], self.block[held])
            shared = [
                held[group]
                for group in connected(together)
                if self.ball[held[group]].any() or _rank(A[:, group]) < len(group)
            ]
            self._groups = key, [Group.of(self.factor, c, self.slope) for c in shared]
        return self._groups[1]

    def is_locked(self, stuck: np.ndarray) -> bool:
        """Return whether the sticking coordinates prevent all motion."""
        if not stuck.any():
            return False
        key = stuck.tobytes(), self.factor.tobytes()
        if self._locked[0] != key:
            rank = _rank(self.factor[:, stuck])
            self._locked = key, rank == len(self.factor)
        return self._locked[1]

    def freed(self, stuck: np.ndarray, slipping: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return what `balls.turn_balls` needs of balls that slip, whichever way they do.

        The last result is kept: balls turn many times in the same modes.

        Args:
            stuck: (nc,) bool. slipping: (nc,) bool, coordinates of balls.

        Returns:
            The factor without what sticks (d, nc), and `balls.Balls.here`, `size` and `axes`.
        """
        key = stuck.tobytes(), slipping.tobytes(), self.factor.tobytes()
        if self._freed[0] != key:
            held = self.factor[:, stuck]
            free = self.factor - held @ (np.linalg.pinv(held, rcond=RANK) @ self.factor)
            here = np.array([np.flatnonzero(self.block == b) for b in self.joints(slipping)])
            size, axes = np.linalg.eigh(np.einsum("dbi,dbj->bij", free[:, here], free[:, here]))
            size[size < RANK**2 * size[:, -1:]] = 0.0
            self._freed = key, (free, here, size, axes)
        return self._freed[1]

    def joints(self, which: np.ndarray) -> list[int]:
        """Return the numbers of the joints of which coordinates (nc,) are among these."""
        number: list[int] = self.block[which].tolist()
        return list(dict.fromkeys(number))

    def normalized(self) -> np.ndarray:
        """Return the factor with columns of length 1, or 0."""
        size = np.linalg.norm(self.factor, axis=0)
        return np.asarray(self.factor / np.where(size > 0.0, size, 1.0))

    def companions(self, stuck: np.ndarray, fired: np.ndarray) -> np.ndarray:
        """Return `fired` and what sticks with them in a group of one freedom."""
        if not self.closed:
            return fired
        broken = np.zeros(len(stuck), dtype=bool)
        broken[fired] = True
        for group, _, rates in self.groups(stuck):
            if broken[group].any() and len(rates) == 1:
                broken[group[self.factor[:, group].any(axis=0)]] = True
        return np.flatnonzero(broken)

    def speeds(self, rates: np.ndarray) -> np.ndarray:
        """Return how fast each coordinate's joint moves (nc,): of a ball, its angular speed."""
        speed = np.abs(rates)
        for here in self.balls:
            speed[here] = np.linalg.norm(rates[here])
        return speed

    def summed(self, parts: np.ndarray) -> np.ndarray:
        """Return parts (..., nc) summed over the coordinates of each joint."""
        out = parts.copy()
        for here in self.balls:
            out[..., here] = parts[..., here].sum(axis=-1, keepdims=True)
        return out

    def slip_direction(self, modes: Modes, rates: np.ndarray) -> np.ndarray:
        """Return the direction (nc,) in which each coordinate slips; a ball has a vector."""
        out = modes.direction.copy()
        if self.balls:
            speed = self.speeds(rates)
            moves = self.ball & ~modes.stuck & (speed > 0.0)
            out[moves] = rates[moves] / speed[moves]
        return out

    @cached_property
    def balls(self) -> list[np.ndarray]:
        """(nc,) bool of each ball: its coordinates."""
        return [self.block == number for number in np.unique(self.block[self.ball])]

    def is_dependent(self, stuck: np.ndarray) -> bool:
        """Return whether some of these coordinates can only move together."""
        return bool(self.groups(stuck))


def solve_modes(
    problem: Problem, modes: Modes, mechanism: Mechanism, chosen: bool = False
) -> tuple[int, int]:
    """Solve the modes; return (number of solutions or -1, how many obey the laws).

    Joints that can only move together share their friction.

    Args:
        chosen: whether gears in motion keep their lines, those of `modes.effort`.
    """
    if chosen and modes.effort.size:
        hold_chosen(problem, modes)
    modes.figures[:] = 0.0
    solutions, obeying = _solve_held(problem, modes, mechanism, chosen)
    more = mechanism.closed and modes.effort.size > 0 and not obeying
    ways = list(ways_to_hold(problem, modes)) if more else []
    for efforts in ways if len(ways) > 1 else ():
        modes.effort[:] = efforts
        hold_chosen(problem, modes)
        solutions, obeying = _solve_held(problem, modes, mechanism, chosen, within=True)
        if obeying:
            break
        if passes_of_sharing(modes) > _MOST_SHARED:
            return -1, 0  # others may hold
    return solutions, obeying


def passes_of_sharing(modes: Modes) -> float:
    """Return the passes of the last solve in which friction was shared."""
    return float(modes.figures[1]) if np.isnan(modes.figures[0]) else 0.0


def _solve_held(
    problem: Problem, modes: Modes, mechanism: Mechanism, chosen: bool, within: bool = False
) -> tuple[int, int]:
    """`solve_modes` with the intervals that gears at rest hold as they are.

    `within`: friction is counted from within them, not from their ends.
    """
    for _ in range(MOST_PASSES):
        groups = list[Group]()
        if mechanism.closed:
            lines, rows = lines_and_rows(problem, modes)
            without = without_gears(problem, modes, rows, within)
            if without is None:
                return 0, 0
            plain, of_y = without
            mechanism.slope = None if plain is problem else plain.rate_slope
            groups = mechanism.groups(modes.stuck)
        if not groups:
            solutions, obeying = try_modes(problem, modes, chosen)
            if solutions <= 0:
                modes.forget()  # what is there is no guess for the next solve
            if mechanism.closed:
                mechanism.way[:] = np.where(modes.stuck, -np.sign(modes.friction), modes.direction)
            return int(solutions), int(obeying)
        shared = _Shared(problem, plain, of_y, modes, mechanism, groups)
        solutions, obeying, off_lines, changed = shared.solve(lines)
        if solutions > 0 and chosen and off_lines:
            return 0, 0
        if solutions <= 0 or not off_lines + changed:
            return solutions, obeying
        if passes_of_sharing(modes) > _MOST_SHARED:
            break
    return -1, 0


class _Shared:
    """One pass x -> G(x) of a problem in which groups share their friction.

    Attributes:
        given, plain, of_y: the problem, and what `without_gears` returns of it.
        problem: the plain one with finite limits; x is its friction.
    """

    def __init__(
        self,
        problem: Problem,
        plain: Problem,
        of_y: np.ndarray,
        modes: Modes,
        mechanism: Mechanism,
        groups: list[Group],
    ) -> None:
        self.given, self.plain, self.problem, self.of_y = problem, plain, bounded(plain), of_y
        self.modes, self.mechanism = modes, mechanism
        nc, ne = len(modes.stuck), len(problem.constant)
        self.gain, self.offset = np.empty(ne), np.empty(nc)
        slip_law(problem, modes.stuck, modes.direction, self.gain, self.offset)
        self.load, self.rate = np.empty(ne), np.empty(nc)
        self.least, self.most = np.empty(nc), np.empty(nc)
        self.shared = np.zeros(nc, dtype=bool)
        self.groups = groups
        for group, _, _ in groups:
            self.shared[group] = True
        self.alone = np.flatnonzero(modes.stuck & ~self.shared)
        self.possible, self.follows_loads = True, True
        self.push = np.zeros(nc)
        self.speeds: list[np.ndarray | None] = [None] * len(groups)
        self.sharp = 4e-15 if all(len(A) == 1 for _, _, A in self.groups) else 1e-9

    def solve(self, lines: np.ndarray) -> tuple[int, int, int, int]:
        """(number of solutions or -1, how many obey), and what `fit` returns of lines (ng, 4)."""
        modes, stuck, start = self.modes, self.modes.stuck, np.zeros(len(self.modes.stuck))
        # 1. the fixed point, with limits that follow loads if it is found so
        if self.sharp < 1e-12 and np.isfinite(modes.friction).all():
            start[:] = modes.friction  # exact whatever it starts from
        x, passes = anderson(self, start, self.sharp)
        if x is None and self.possible:
            self.follows_loads = False
            x, more = anderson(self, start, self.sharp)
            passes += more
        modes.figures[:] = np.nan, passes_of_sharing(modes) + passes
        if not self.possible:
            modes.forget()
            return 0, 0, 0, 0
        self.write(self.image(start) if x is None else x)
        # 2. beyond limits another friction may hold, unless a ball's limit is a sphere or what
        # slides has friction that loads decide
        stick_limits(self.problem, modes.load, self.least, self.most)
        beyond = x is None or any(
            self._against_limits(group)[2].any() for group, _, _ in self.groups
        )
        held = False
        if beyond and not self.mechanism.ball[stuck].any() and not self.gain.any():
            p, moving = self.plain, self.offset
            if moving.any():
                contact = p.contact.copy()
                contact[:, 0] += np.einsum("tce,c->te", p.contact[:, 1:], moving)
                p = p._replace(rate_free=p.rate_free + p.rate_slope @ moving, contact=contact)
            given = p, self.mechanism.factor, stuck
            verdict = decide(*given, slope=self.mechanism.slope)
            if verdict.held:
                held = True
                verdict = decide(*given, slope=self.mechanism.slope, least_below=1.0)
                self.write(verdict.friction + moving)
        # 3. what breaks its law
        off_lines, changed = fit(self.given, modes, lines, True) if modes.effort.size else (0, 0)
        broken = self.judge()
        if x is None and not held:  # beyond its limits friction may grow without bound: breaks away
            modes.forget()
            return (1 if broken else -1), 0, 0, 0
        return 1, int(broken == 0), off_lines, changed

    def write(self, y: np.ndarray) -> None:
        """Write the friction of a solution, its loads and rates."""
        self.y, modes = y, self.modes
        modes.friction[:] = self.of_y[:, 0] + self.of_y[:, 1:] @ y if self.of_y.size else y
        evaluate(self.given, modes.friction, modes.load, modes.rate)

    def image(self, x: np.ndarray) -> np.ndarray:
        """Return G(x)."""
        p, modes = self.problem, self.modes
        evaluate(p, x, self.load, self.rate)
        stick_limits(p, self.load, self.least, self.most)
        new = self.offset + np.bincount(p.coordinate, self.gain * self.load, len(x))
        new[modes.stuck] = 0.0
        rate = p.rate_free + p.rate_slope @ new
        if self.alone.size:
            here = p.rate_slope[self.alone[:, None], self.alone]
            new[self.alone] = -np.linalg.lstsq(here, rate[self.alone], rcond=None)[0]
            rate = p.rate_free + p.rate_slope @ new
        for i, each in enumerate(self.groups):
            group, _, A = each
            if not len(A):  # what cannot move at all needs no friction
                new[group] = self.push[group] = 0.0
                continue
            b, residual = each.needs(rate[group])
            terms = p.rate_scale[group] + np.abs(p.rate_slope[group]) @ np.abs(new)
            if (residual > FITS * terms.max() + 1e-300).any():
                self.possible = False
                return np.full(len(x), np.nan)
            towards = A.T @ b
            self.push[group] = -towards
            block = self.mechanism.block[group]
            near = x[group] if self.follows_loads else np.zeros(len(group))
            way = np.where(near != 0.0, near, towards)
            limits = np.array([self.most[group], -self.least[group]])
            limit, used = np.where(way > 0.0, *limits), joint_sizes(near, block)
            if self.mechanism.ball[group].any():  # beside balls by the side of the last pass
                limits[:] = limit
            most = float((used / np.where(limit > 0.0, limit, np.inf)).max())
            owner, slope = p.coordinate[p.contact_entry], np.zeros((len(x), len(x)))  # of limits
            add_load_slopes(p.contact, owner, p.grip[p.contact_entry], x, slope)
            slope = min(most, 1.0) * slope[group[:, None], group]
            if len(A) == 1 and self.follows_loads:
                new[group] = share_one(A, b, limits, slope, block)
                continue
            new[group], self.speeds[i] = share_nearby(
                A, b, limits, slope, near, block, self.speeds[i]
            )
        return new

    def judge(self) -> int:
        """Write `verdict` and `way`; return how many coordinates break their law."""
        p, m, way = self.problem, self.modes, self.mechanism.way
        at_rest = m.at_rest & ~self.shared
        judge(self.given, m._replace(at_rest=at_rest))
        stick_limits(p, m.load, self.least, self.most)
        way[:] = np.where(m.stuck, -np.sign(m.friction), m.direction)
        for group, _, _ in self.groups:
            size, limit, over = self._against_limits(group)
            over &= m.at_rest[group]
            push, block = self.push[group], self.mechanism.block[group]
            pushed = joint_sizes(push, block)
            way[group] = push / np.where(pushed > 0.0, pushed, 1.0)
            if over.any():
                used = size / np.where(limit > 0.0, limit, 1e-300)
                over &= used >= (1.0 - 1e-3) * used[over].max()
            m.verdict[group] = np.where(over, np.where(way[group] < 0.0, -1, 1), 0)
        return int((m.verdict != 0).sum())

    def _against_limits(self, group: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Friction of each joint of a group, its limit, and whether it is beyond (not rounding)."""
        p, x, block = self.problem, self.y[group], self.mechanism.block[group]
        size = joint_sizes(x, block)
        limit = np.where(x > 0.0, self.most[group], -self.least[group])
        ball = self.mechanism.ball[group]
        limit[ball] = self.most[group][ball]
        slope = np.diag(p.rate_slope)[group]
        strongest = int(np.argmax(slope))
        terms = p.rate_scale[group][strongest] / max(slope[strongest], 1e-300)  # of rates
        return size, limit, size > limit + ROUNDING * (limit + terms)


def anderson(step: _Shared, x: np.ndarray, sharp: float) -> tuple[np.ndarray | None, int]:
    """Solve x = G(x), with Anderson's extrapolation over the last four passes; None: it fails.

    G is `step.image` (Anderson 1965; Walker and Ni 2011). It ends at a relative difference of
    `sharp`, or where rounding prevents further progress.
    """
    points: list[np.ndarray] = []
    residuals: list[np.ndarray] = []
    best, since = np.inf, 0
    for passes in range(_PASSES):
        image = step.image(x)
        residual = image - x
        if not np.isfinite(residual).all():
            return None, passes
        error, size = (
            float(np.abs(residual).max(initial=0.0)),
            float(np.abs(image).max(initial=0.0)),
        )
        if error <= sharp * size:
            return image, passes
        since = 0 if error < 0.5 * best else since + 1
        best = min(best, error)
        if since > 12 and error <= 1e-12 * size:
            return image, passes  # rounding
        points, residuals = [*points[-4:], image], [*residuals[-4:], residual]
        x = image
        if len(points) > 1:
            slope = np.array([r - residual for r in residuals[:-1]]).T
            weights = np.linalg.lstsq(slope, -residual, rcond=1e-10)[0]
            x = image + np.array([p - image for p in points[:-1]]).T @ weights
    return None, _PASSES


def _rank(A: np.ndarray) -> int:
    """The rank of a matrix; older NumPy takes none without rows (a robot that is locked)."""
    return int(np.linalg.matrix_rank(A, rtol=RANK)) if A.size else 0
