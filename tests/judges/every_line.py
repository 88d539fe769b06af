"""Machines with gears: every mode times every line of every gear, in plain NumPy, no pinfric.

At one state

    M a + h = S^T t + D^T x + J^T lambda,    J a = gamma,    u - I s' = F(t),    s' = S a + bend

with t what each gear delivers along its rate S v, x the bearings' friction along D v, and F one of
the gear's lines: slope t + offset, for t from least to greatest. What sticks has the rate 0, and
its gears and bearings can add what is needed along it: a gear every t with F_-(t) <= u <= F_+(t), a
bearing anything up to its limit. Of the stable answers that with the fewest joints slipping from
rest counts. Stable is an answer at which a shaft with a little compliance stays:

    diag(slope) + I^1/2 S M^-1 S^T I^1/2 positive definite
"""

from collections.abc import Callable, Iterator
from itertools import combinations, islice, product
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import linprog

#: What rounding leaves of forces and of accelerations, as a share of their terms.
ROUNDING = 1e-9
_RANK = 1e-9
#: Choices of lines that are solved at once.
_AT_ONCE = 20_000


class Loss(NamedTuple):
    """Loss over the load: straight between points (load, loss), the first (0, 0), then a slope."""

    points: tuple[tuple[float, float], ...]
    beyond: float

    def lines(self) -> list[tuple[float, float, float, float]]:
        """(from, to, slope, value at 0) of every straight part."""
        out = []
        for k, (x, y) in enumerate(self.points):
            last = k + 1 == len(self.points)
            end = np.inf if last else self.points[k + 1][0]
            slope = self.beyond if last else (self.points[k + 1][1] - y) / (end - x)
            out.append((x, end, slope, y - slope * x))
        return out


class Gear(NamedTuple):
    """Losses where the motor drives, and the load; no-load torque forward, backward; rotor."""

    driving: Loss
    driven: Loss
    kinetic: tuple[float, float]
    static: tuple[float, float]
    inertia: float

    def lines(self, way: float, static: bool = False) -> list[tuple[float, float, float, float]]:
        """(slope, offset, least t, greatest t) of u = F(t) in a direction of motion."""
        n = (self.static if static else self.kinetic)[0 if way > 0.0 else 1]
        out = []
        for loss, side in ((self.driving, way), (self.driven, -way)):  # sign of t on these lines
            for start, end, slope, at_zero in loss.lines():
                ends = sorted((side * start, side * end))
                out.append((1.0 + way * side * slope, way * (at_zero + n), *ends))
        return out

    def held(self, u: float) -> list[tuple[float, float]]:
        """The intervals of t that the gear holds at rest: F_-(t) <= u <= F_+(t)."""
        lines = {way: self.lines(way, static=True) for way in (1.0, -1.0)}
        marks = {end for every in lines.values() for line in every for end in line[2:]}
        for every in lines.values():
            for slope, offset, least, most in every:
                if slope != 0.0 and least <= (u - offset) / slope <= most:
                    marks.add((u - offset) / slope)
        at = sorted(mark for mark in marks if np.isfinite(mark))
        found: list[list[float]] = []
        for low, high in zip([-np.inf, *at], [*at, np.inf], strict=True):
            inside = 0.5 * (low + high)
            if low == -np.inf:
                inside = high - 1.0 - abs(high)
            if high == np.inf:
                inside = low + 1.0 + abs(low)
            fits = True
            for way, every in lines.items():
                (value,) = [s * inside + o for s, o, least, most in every if least < inside < most]
                fits &= way * (value - u) >= 0.0
            if fits and found and found[-1][1] == low:
                found[-1][1] = high
            elif fits:
                found.append([low, high])
        return [(low, high) for low, high in found]


class Bearing(NamedTuple):
    """Constant friction, in motion and at rest (N m or N)."""

    kinetic: float
    static: float


class System(NamedTuple):
    """A machine at one state; see the module.

    Attributes:
        M, h: (n, n), (n,). J, gamma: (nl, n), (nl,).
        S, bend, speed, u: (ng, n), (ng,): of every gear; u = r T_m - drag.
        gears, bearings: of the rows of S, of D.
        D, turn, rate: (nb, n), (nb,): of every bearing, its rate's change at a = 0, its rate.
        loads: accelerations (n,) -> load-dependent friction of the bearings, in motion and at rest
            (2, nb); None: there is none.
    """

    M: np.ndarray
    h: np.ndarray
    J: np.ndarray
    gamma: np.ndarray
    S: np.ndarray
    bend: np.ndarray
    speed: np.ndarray
    u: np.ndarray
    gears: list[Gear]
    D: np.ndarray
    turn: np.ndarray
    rate: np.ndarray
    bearings: list[Bearing]
    loads: Callable[[np.ndarray], np.ndarray] | None = None


class Answer(NamedTuple):
    """An acceleration that obeys all laws, what moving gears deliver, and whether it is stable."""

    a: np.ndarray
    t: np.ndarray
    stable: bool


#: A rate at or below this is none.
STILL = 1e-6


class _Places(NamedTuple):
    """Rows along which gears and bearings lie together, each row once."""

    rows: np.ndarray
    bend: np.ndarray
    rate: np.ndarray
    of_gear: np.ndarray
    of_bearing: np.ndarray


def _places(s: System) -> _Places:
    rows, bend, rate = [], [], []
    of = []
    for row, b, r in zip(
        np.vstack([s.S, s.D]),
        np.concatenate([s.bend, s.turn]),
        np.concatenate([s.speed, s.rate]),
        strict=True,
    ):
        size = np.abs(row).max()
        same = [k for k, other in enumerate(rows) if np.abs(other - row).max() < 1e-9 * size]
        if not same:
            rows.append(row)
            bend.append(b)
            rate.append(r)
        of.append(same[0] if same else len(rows) - 1)
    at = np.array(of, dtype=int)
    n = s.M.shape[0]
    return _Places(
        np.array(rows).reshape(-1, n),
        np.array(bend),
        np.array(rate),
        at[: len(s.gears)],
        at[len(s.gears) :],
    )


def answers(s: System) -> list[Answer]:
    """Different accelerations that obey the laws, fewest slips first, until one is stable."""
    places, found = _places(s), list[Answer]()
    rests = np.flatnonzero(np.abs(places.rate) <= STILL)
    for level in range(len(rests) + 1):
        for slipping in combinations(rests, level):
            for signs in product((1.0, -1.0), repeat=level):
                ways = np.sign(places.rate)
                ways[rests] = 0.0
                ways[list(slipping)] = signs
                for answer in _in_modes(s, places, ways, rests):
                    if not any(_same(answer, other) for other in found):
                        found.append(answer)
        if any(answer.stable for answer in found):
            break
    return found


def the_answer(found: list[Answer]) -> np.ndarray | None:
    """The only stable acceleration; None if the state is to be refused."""
    stable = [answer.a for answer in found if answer.stable]
    return stable[0] if len(stable) == 1 else None


def _same(one: Answer, other: Answer) -> bool:
    size = max(np.abs(one.a).max(), np.abs(other.a).max())
    return bool(np.abs(one.a - other.a).max() <= 1e-7 * size) and one.stable == other.stable


class _Modes(NamedTuple):
    """Accelerations a = start + N y of given modes, and y = inverse (push + ...)."""

    ways: np.ndarray
    stuck: np.ndarray
    start: np.ndarray
    N: np.ndarray
    inverse: np.ndarray
    scale: float


def _in_modes(s: System, p: _Places, ways: np.ndarray, rests: np.ndarray) -> Iterator[Answer]:
    stuck = np.array([k for k in rests if ways[k] == 0.0], dtype=int)
    C = np.vstack([s.J, p.rows[stuck]])
    target = np.concatenate([s.gamma, -p.bend[stuck]])
    n = len(s.h)
    start, N = np.zeros(n), np.eye(n)
    if len(C):
        start = np.linalg.lstsq(C, target, rcond=_RANK)[0]
        if np.abs(C @ start - target).max() > 1e-7 * (np.abs(target).max() + 1e-3):
            return
        N = null_space(C, rcond=_RANK)
    inverse = np.linalg.inv(N.T @ s.M @ N)
    forces = np.abs(s.h).max() + np.abs(s.S.T @ s.u).max(initial=0.0)
    modes = _Modes(ways, stuck, start, N, inverse, forces)
    moving = np.flatnonzero(ways[p.of_gear]) if len(s.gears) else np.zeros(0, dtype=int)
    every = product(*(s.gears[g].lines(ways[p.of_gear[g]]) for g in moving))
    if s.loads is not None:
        for choice in every:
            yield from _with_loads(s, p, modes, moving, np.array(choice).reshape(-1, 4))
        return
    friction = -ways[p.of_bearing] * np.array([b.kinetic for b in s.bearings])
    while True:
        chunk = list(islice(every, _AT_ONCE))
        if not chunk:
            return
        lines = np.array(chunk).reshape(len(chunk), len(moving), 4)
        for line, t in _solve(s, modes, moving, lines, friction):
            answer = _check(s, p, modes, moving, line, t, friction, np.zeros(len(s.bearings)))
            if answer is not None:
                yield answer


def _solve(
    s: System, modes: _Modes, moving: np.ndarray, lines: np.ndarray, friction: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the fitting lines of a batch (m, g, 4), and what the gears deliver on them."""
    if not len(moving):
        yield lines[0], np.zeros(0)
        return
    S, inertia = s.S[moving], np.array([s.gears[g].inertia for g in moving])
    through = modes.N @ modes.inverse @ modes.N.T
    free = modes.start + through @ (s.D.T @ friction - s.h - s.M @ modes.start)
    W = S @ through @ S.T
    A = inertia[:, None] * W + np.eye(len(moving)) * lines[:, :, 0][:, None, :]
    right = s.u[moving] - inertia * (S @ free + s.bend[moving]) - lines[:, :, 1]
    solvable = np.abs(np.linalg.det(A)) > 0.0
    t = np.full(right.shape, np.nan)
    t[solvable] = np.linalg.solve(A[solvable], right[solvable][:, :, None])[:, :, 0]
    slack = ROUNDING * (modes.scale + np.abs(t).max(axis=1, keepdims=True))
    fits = ((lines[:, :, 2] - slack <= t) & (t <= lines[:, :, 3] + slack)).all(axis=1)
    for k in np.flatnonzero(fits):
        yield lines[k], t[k]


def _with_loads(
    s: System, p: _Places, modes: _Modes, moving: np.ndarray, line: np.ndarray
) -> Iterator[Answer]:
    """The answer on one choice of lines; loads of bearings are repeated until they stay."""
    assert s.loads is not None
    free = line.copy()
    free[:, 2:] = -np.inf, np.inf
    followed = np.zeros((2, len(s.bearings)))
    for _ in range(200):
        friction = -modes.ways[p.of_bearing] * (
            np.array([b.kinetic for b in s.bearings]) + followed[0]
        )
        found = list(_solve(s, modes, moving, free[None], friction))
        if not found:
            return
        a = _acceleration(s, modes, moving, found[0][1], friction)
        before, followed = followed, s.loads(a)
        if np.abs(followed - before).max() <= 1e-14 * modes.scale:
            break
    slack = ROUNDING * (modes.scale + np.abs(found[0][1]).max(initial=0.0))
    if ((found[0][1] < line[:, 2] - slack) | (found[0][1] > line[:, 3] + slack)).any():
        return
    answer = _check(s, p, modes, moving, line, found[0][1], friction, followed[1])
    if answer is not None:
        yield answer


def _acceleration(
    s: System, modes: _Modes, moving: np.ndarray, t: np.ndarray, friction: np.ndarray
) -> np.ndarray:
    push = s.D.T @ friction + s.S[moving].T @ t - s.h - s.M @ modes.start
    return np.asarray(modes.start + modes.N @ modes.inverse @ modes.N.T @ push)


def _check(
    s: System,
    p: _Places,
    modes: _Modes,
    moving: np.ndarray,
    line: np.ndarray,
    t: np.ndarray,
    friction: np.ndarray,
    followed: np.ndarray,
) -> Answer | None:
    """The answer on fitting lines, if the slipping joints slip and the sticking ones are held."""
    a = _acceleration(s, modes, moving, t, friction)
    rates = p.rows @ a + p.bend
    rests = np.abs(p.rate) <= STILL
    terms = np.abs(p.rows) @ np.abs(modes.N @ modes.inverse @ modes.N.T) @ np.full(
        len(a), modes.scale
    ) + np.abs(p.bend)
    if (rests & (modes.ways * rates < -ROUNDING * terms)).any():
        return None
    need = s.M @ a + s.h - s.S[moving].T @ t - s.D.T @ friction
    if not _held(s, p, modes, need, followed, t):
        return None
    S, inertia = s.S[moving], np.sqrt([s.gears[g].inertia for g in moving])
    W = S @ modes.N @ modes.inverse @ modes.N.T @ S.T
    K = np.diag(line[:, 0]) + inertia[:, None] * W * inertia
    return Answer(a, t, bool(len(t) == 0 or np.linalg.eigvalsh(K).min() > 0.0))


def _held(
    s: System, p: _Places, modes: _Modes, need: np.ndarray, followed: np.ndarray, t: np.ndarray
) -> bool:
    """Whether gears and bearings that stick can add the needed (n,) along their rows."""
    stuck = modes.stuck
    if not len(stuck):
        return True
    slack = ROUNDING * (modes.scale + np.abs(need).max() + np.abs(t).max(initial=0.0))
    pieces = []
    for k in stuck:
        limit = sum(s.bearings[b].static + followed[b] for b in np.flatnonzero(p.of_bearing == k))
        here = [(-limit - slack, limit + slack)]
        for g in np.flatnonzero(p.of_gear == k):
            here = [
                (low + least, high + most)
                for low, high in here
                for least, most in s.gears[g].held(float(s.u[g]))
            ]
        pieces.append(here)
    Z = null_space(s.J, rcond=_RANK) if len(s.J) else np.eye(len(need))
    rows, right = Z.T @ p.rows[stuck].T, Z.T @ need
    if np.linalg.matrix_rank(rows, tol=_RANK * np.abs(rows).max()) == len(stuck):
        f = np.linalg.lstsq(rows, right, rcond=None)[0]
        return all(
            any(low <= x <= high for low, high in here) for x, here in zip(f, pieces, strict=True)
        )
    size = np.abs(right).max() + 1e-300
    for bounds in product(*pieces):
        limits = [(None if np.isinf(x) else x / size for x in each) for each in bounds]
        found = linprog(
            np.zeros(len(stuck)),
            A_eq=rows,
            b_eq=right / size,
            bounds=[tuple(each) for each in limits],
        )
        if found.status == 0:
            return True
    return False
