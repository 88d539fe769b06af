"""Random mechanisms at rest whose static friction exceeds kinetic, and all they may do.

    python tests/judges/resting_states.py trees 0 1000
    python tests/judges/resting_states.py all 0 500

Newton and Euler body by body in absolute coordinates, plain NumPy: no Pinocchio, no pinfric. At
rest accelerations and forces are affine in x, the friction and what gears deliver:

    r = rate (1, x),     p = force (1, x),     limit_j = kinetic_j sum |p| + dry_j

All ways in which joints can slip are searched, the fewest first: every set that can stick while
others move, every choice of signs that the loops allow, every line of every gear that moves; by
Newton's method, a ball's direction from several starts. Whether all can stick is searched by SLSQP
from several starts.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space, orth
from scipy.optimize import linprog, minimize

if __name__ == "__main__":
    TESTS = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(TESTS), str(TESTS / "helpers")]
from judges.every_line import Gear
from judges.geared_states import constant_gear, plain_gear
from judges.pin_chains import PinChain, random_chain
from judges.planar_states import Moving, random_planar_tree
from mechanisms import add_link, grounded_model

import pinfric as pf

Rng = np.random.Generator
#: What rounding leaves, as a share of the terms; accelerations this close are the same.
ROUNDING, SAME = 1e-9, 1e-6
_RANK = 1e-8
#: Modes solved at once, and looked at before a state is given up.
_AT_ONCE, _MOST = 4000, 120_000
_PASSES = 40
#: A use of limits this close to 1 decides nothing.
_NEAR = 1e-5


@dataclass(frozen=True)
class Resting:
    """A mechanism at rest; see the module.

    Attributes:
        rate: (n, 1 + n). force: (nt, 3, 1 + n), weighted by the bearing's radius.
        owner: (nt,) joint of each force. joint: (n,) of each coordinate: a ball has three.
        kinetic, dry: (nj,). above: static friction per kinetic.
        gears: coordinate -> (u at r = 0, the gear).
        island: (nj,) number of the part that nothing couples with the others.
    """

    rate: np.ndarray
    force: np.ndarray
    owner: np.ndarray
    joint: np.ndarray
    kinetic: np.ndarray
    dry: np.ndarray
    above: float
    gears: dict[int, tuple[float, Gear]] = field(default_factory=dict)
    island: np.ndarray | None = None

    def limit(self, x: np.ndarray) -> np.ndarray:
        """(m, nj) kinetic limits under x (m, n)."""
        p = self.force[:, :, 0] + np.einsum("tek,mk->mte", self.force[:, :, 1:], x)
        size = np.linalg.norm(p, axis=2) @ np.eye(len(self.kinetic))[self.owner]
        return np.asarray(size * self.kinetic + self.dry)

    def slope(self, x: np.ndarray) -> np.ndarray:
        """(m, nj, n) how the limits change with x."""
        p = self.force[:, :, 0] + np.einsum("tek,mk->mte", self.force[:, :, 1:], x)
        size = np.linalg.norm(p, axis=2, keepdims=True)
        each = np.einsum("mte,tek->mtk", p / np.where(size > 0, size, 1.0), self.force[:, :, 1:])
        of = np.eye(len(self.kinetic))[self.owner] * self.kinetic
        return np.einsum("tj,mtk->mjk", of, each)

    def rates(self, x: np.ndarray) -> np.ndarray:
        """(m, n) relative accelerations."""
        return np.asarray(self.rate[:, 0] + x @ self.rate[:, 1:].T)

    def of_island(self, number: int) -> tuple[Resting, np.ndarray]:
        """One part alone, and its coordinates."""
        assert self.island is not None
        js = np.flatnonzero(self.island == number)
        c = np.flatnonzero(np.isin(self.joint, js))
        t = np.flatnonzero(np.isin(self.owner, js))
        columns = np.append(0, 1 + c)
        part = Resting(
            self.rate[np.ix_(c, columns)], self.force[t][:, :, columns],
            np.searchsorted(js, self.owner[t]), np.searchsorted(js, self.joint[c]),
            self.kinetic[js], self.dry[js], self.above,
            {k: self.gears[i] for k, i in enumerate(c.tolist()) if i in self.gears},
        )  # fmt: skip
        return part, c


# ---------------------------------------------------------------- all that obeys


@dataclass
class Answers:
    """What a state may do.

    Attributes:
        rates: (m, n) different accelerations with the fewest slipping joints.
        level: how many slip. use: of the limits where all stick, at the best x found.
        complete: whether all ways were searched.
    """

    rates: np.ndarray
    level: int
    use: float = 0.0
    complete: bool = True


def answers(s: Resting, rng: Rng) -> Answers:
    """Return what obeys the laws with the fewest slipping joints; each island alone."""
    if s.island is None:
        return _answers(s, rng)
    whole = Answers(np.zeros((1, len(s.joint))), 0)
    for number in np.unique(s.island):
        part, c = s.of_island(int(number))
        found = _answers(part, rng)
        many = np.repeat(whole.rates, len(found.rates), axis=0)
        many[:, c] = np.tile(found.rates, (len(whole.rates), 1))
        uses = [whole.use, found.use]
        use = min(uses, key=lambda x: abs(x - 1.0))
        whole = Answers(many, whole.level + found.level, use, whole.complete & found.complete)
    return whole


def _answers(s: Resting, rng: Rng) -> Answers:
    n, use = len(s.joint), least_use(s, rng)
    if use <= 1.0:
        return Answers(np.zeros((1, n)), 0, use)
    tried = 0
    for level, modes in _levels(s, rng):
        found = list[np.ndarray]()
        while block := [mode for mode, _ in zip(modes, range(_AT_ONCE), strict=False)]:
            tried += len(block)
            for r in _obeying(s, block):
                if not any(_same(r, other) for other in found):
                    found.append(r)
        if found:
            return Answers(np.array(found), level, use)
        if tried > _MOST:
            return Answers(np.zeros((0, n)), level, use, False)
    return Answers(np.zeros((0, n)), -1, use)


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.abs(one - other).max() <= SAME * max(np.abs(one).max(), np.abs(other).max()))


#: Coordinates that stick; the sign of each pin that slips, a ball's first direction; gears' lines.
Mode = tuple[np.ndarray, np.ndarray, tuple]


def _levels(s: Resting, rng: Rng) -> Iterator[tuple[int, Iterator[Mode]]]:
    """Yield, by the number of slipping joints, the modes that loops allow."""
    B = orth(s.rate[:, 1:], rcond=_RANK)
    nj, freedoms = len(s.kinetic), B.shape[1]
    if freedoms == len(s.joint):  # a tree
        for level in range(1, nj + 1):
            yield (
                level,
                (
                    mode
                    for slips in combinations(range(nj), level)
                    for signs in product((1.0, -1.0), repeat=level)
                    for mode in _with_lines(s, ~np.isin(s.joint, slips), _placed(nj, slips, signs))
                ),
            )
        return
    flats: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
    seen = set()
    for count in range(freedoms):
        for sticks in combinations(range(nj), count):
            here = np.isin(s.joint, sticks)
            N = null_space(B[here], rcond=_RANK) if here.any() else np.eye(freedoms)
            if not N.shape[1]:
                continue
            moves = np.abs(B @ N).max(axis=1) > 1e-7
            slips = np.unique(s.joint[moves])
            if (key := slips.tobytes()) not in seen:
                seen.add(key)
                flats.setdefault(len(slips), []).append((slips, B @ N))
    for level in sorted(flats):
        yield (
            level,
            (
                mode
                for slips, rows in flats[level]
                for way in _faces(s, slips, rows, rng)
                for mode in _with_lines(s, ~np.isin(s.joint, slips), way)
            ),
        )


def _placed(n: int, at: tuple[int, ...], values: tuple[float, ...]) -> np.ndarray:
    out = np.zeros(n)
    out[list(at)] = values
    return out


def _faces(s: Resting, slips: np.ndarray, rows: np.ndarray, rng: Rng) -> Iterator[np.ndarray]:
    """Yield directions (n,) of motions of every choice of signs; with balls several of each.

    The faces of planes through the origin, at random and next to the lines in which they meet.
    """
    ball = np.bincount(s.joint, minlength=len(s.kinetic)) == 3
    pins = np.flatnonzero(np.isin(s.joint, slips) & ~ball[s.joint])
    d = rows.shape[1]
    if ball[slips].any():
        yield from _least_power(s, slips, rows, pins)
    w = [np.ones((1, 1)), -np.ones((1, 1))] if d == 1 else [rng.normal(size=(400, d))]
    if d > 1:
        for meet in combinations(pins, d - 1):
            A = rows[list(meet)]
            line = null_space(A, rcond=_RANK)
            if line.shape[1] != 1:
                continue
            across = np.linalg.pinv(A)
            across /= np.linalg.norm(across, axis=0)
            for way in product((1.0, -1.0), repeat=d):
                near = way[0] * line[:, 0] + 1e-4 * across @ np.array(way[1:])
                w.append(near[None])
    r = np.vstack(w) @ rows.T
    most = 4 if ball[slips].any() else 1
    count: Counter[bytes] = Counter()
    for one in r:
        key = np.sign(one[pins]).tobytes()
        count[key] += 1
        if count[key] <= most:
            out = one.copy()
            out[pins] = np.sign(one[pins])
            yield out


def _least_power(
    s: Resting, slips: np.ndarray, rows: np.ndarray, pins: np.ndarray
) -> Iterator[np.ndarray]:
    """Yield where (r - r0) R^-1 (r - r0) / 2 + sum limit |r| is least, limits followed."""
    B, n = orth(s.rate[:, 1:], rcond=_RANK), len(s.joint)
    inverse = np.linalg.inv(B.T @ s.rate[:, 1:] @ B)
    of, free = np.eye(len(s.kinetic))[s.joint], B.T @ s.rate[:, 0]
    N, stuck = B.T @ rows, ~np.isin(s.joint, slips)
    size = float(np.abs(free).max())
    x, y = np.zeros(n), np.linalg.lstsq(N, free, rcond=None)[0] / size
    for _ in range(8):
        L = s.limit(x[None])[0]

        def power(y: np.ndarray, L: np.ndarray = L, fine: float = 1e-4) -> tuple[float, np.ndarray]:
            off = inverse @ (N @ y * size - free)
            r = rows @ y
            speed = np.sqrt(r**2 @ of + fine**2)
            value = (N @ y * size - free) @ off / (2.0 * size) + L @ speed
            return float(value), N.T @ off + rows.T @ (of @ (L / speed) * r)

        y = minimize(power, y, jac=True, method="BFGS", options={"gtol": 1e-9}).x
        r = rows @ y
        speed = of @ np.sqrt(r**2 @ of)
        before, x = x, np.where(stuck, 0.0, -(of @ L) * r / np.where(speed > 0.0, speed, 1.0))
        R = s.rate[np.ix_(stuck, 1 + np.flatnonzero(stuck))]
        x[stuck] = -np.linalg.pinv(R, rcond=_RANK) @ s.rates(x[None])[0][stuck]
        if np.abs(x - before).max() <= 1e-6 * np.abs(x).max():
            break
    r[pins] = np.sign(r[pins])
    yield r


def _with_lines(s: Resting, stuck: np.ndarray, way: np.ndarray) -> Iterator[Mode]:
    moving = [k for k in s.gears if not stuck[k]]
    for lines in product(*(s.gears[k][1].lines(way[k]) for k in moving)):
        yield stuck, way, lines


def _obeying(s: Resting, modes: list[Mode]) -> Iterator[np.ndarray]:
    """Yield rates (n,) of modes that obey their law."""
    n, m = len(s.joint), len(modes)
    stuck, way = (np.array([mode[k] for mode in modes]).reshape(m, n) for k in (0, 1))
    ball = np.bincount(s.joint, minlength=len(s.kinetic))[s.joint] == 3
    R, alone = s.rate[:, 1:], np.zeros((m, n))
    whole = R.copy()  # what of a ball that sticks moves nothing is no friction
    for here in (np.flatnonzero(s.joint == j) for j in np.unique(s.joint[ball])):
        idle = null_space(R[np.ix_(here, here)], rcond=_RANK)
        whole[np.ix_(here, here)] += np.trace(R[np.ix_(here, here)]) * idle @ idle.T
    # t = (u - offset - I r) / slope of gears that move: constant, and per rate
    given, per_rate = np.zeros((m, n)), np.zeros((m, n))
    ends = np.full((2, m, n), np.inf)
    ends[0] *= -1.0
    for i, (sticks, _, lines) in enumerate(modes):
        for k, (slope, offset, least, most) in zip(
            [k for k in s.gears if not sticks[k]], lines, strict=True
        ):
            u, gear = s.gears[k]
            given[i, k], per_rate[i, k] = (u - offset) / slope, -gear.inertia / slope
            ends[:, i, k] = least, most
    of = np.eye(len(s.kinetic))[s.joint]  # of each coordinate its joint's
    turns, sign = ball & ~stuck, np.where(stuck | ball, 0.0, way)
    size = np.sqrt(np.where(turns, way**2, 0.0) @ of @ of.T)
    towards = np.where(turns, way / np.where(size > 0, size, 1.0), sign)

    def newton(x: np.ndarray, free: bool, passes: int) -> tuple[np.ndarray, np.ndarray]:
        """From x; balls keep their direction or are free to turn."""
        active = np.arange(m)
        error = np.full(m, np.inf)
        for _ in range(passes):
            y = x[active]
            r, L, dL = s.rates(y), s.limit(y) @ of.T, s.slope(y)[:, s.joint]
            t, T = given[active] + per_rate[active] * r, per_rate[active][:, :, None] * R
            e = towards[active]
            J = np.eye(n) + e[:, :, None] * dL - T
            rest = y + e * L - t
            if free and turns.any():
                speed = np.sqrt(np.where(ball, r**2, 0.0) @ of @ of.T)
                unit = r / np.where(speed > 0, speed, 1.0)
                inner = np.zeros((len(y), n, n))
                for j in np.unique(s.joint[ball]):
                    here = np.flatnonzero(s.joint == j)
                    proj = np.eye(3) - unit[:, here, None] * unit[:, None, here]
                    turn = proj @ R[here] / np.maximum(speed[:, here[0]], 1e-300)[:, None, None]
                    inner[:, here] = turn * L[:, here[0]][:, None, None]
                swap = turns[active]
                J = np.where(swap[:, :, None], np.eye(n) + unit[:, :, None] * dL + inner, J)
                rest = np.where(swap, y + unit * L, rest)
            J = np.where(stuck[active][:, :, None], whole, J)
            rest = np.where(stuck[active], r + y @ (whole - R), rest)
            good = np.abs(np.linalg.det(J)) > 1e-200
            step = np.zeros_like(y)
            step[good] = np.linalg.solve(J[good], rest[good][:, :, None])[:, :, 0]
            step[~good] = np.nan
            x[active] = y - step
            with np.errstate(invalid="ignore"):
                error[active] = np.abs(step).max(axis=1) / np.abs(x[active]).max(axis=1)
                wrong = sign[active] * s.rates(x[active]) < -1e-2 * np.abs(r).max(1)[:, None]
            near = error[active] < 1e-4
            drop = near & wrong.any(axis=1) & ~turns[active].any(axis=1)
            error[active[drop]] = np.inf
            active = active[(error[active] > 1e-14) & ~drop & np.isfinite(x[active]).all(axis=1)]
            if not active.size:
                break
        return x, error

    with np.errstate(all="ignore"):
        if turns.any():
            x, _ = newton(alone, False, 12)
            x[~np.isfinite(x)] = 0.0
            x, error = newton(x, True, _PASSES)
        else:
            x, error = newton(alone, False, _PASSES)
        for i in np.flatnonzero(error < 1e-10):
            if _obeys(s, x[i], stuck[i], sign[i], given[i], per_rate[i], ends[:, i]):
                yield np.where(stuck[i], 0.0, s.rates(x[i][None])[0])


def _obeys(
    s: Resting, x: np.ndarray, stuck: np.ndarray, sign: np.ndarray, given: np.ndarray,
    per_rate: np.ndarray, ends: np.ndarray,
) -> bool:  # fmt: skip
    r, L = s.rates(x[None])[0], s.limit(x[None])[0]
    terms = np.abs(s.rate[:, 0]) + np.abs(s.rate[:, 1:]) @ np.abs(x)
    if (sign * r < -ROUNDING * terms.max()).any():
        return False
    slack = 1e-8 * np.abs(x).max()
    t = given + per_rate * r
    if ((t < ends[0] - slack) | (t > ends[1] + slack))[[*s.gears]].any():
        return False
    for j in range(len(L)):
        here = np.flatnonzero(s.joint == j)
        if len(here) == 3 and not stuck[here[0]] and x[here] @ r[here] > 0.0:
            return False
        if not stuck[here[0]]:
            continue
        most = s.above * L[j] + slack
        if here[0] in s.gears:
            u, gear = s.gears[int(here[0])]
            if not any(low - most <= x[here[0]] <= high + most for low, high in gear.held(u)):
                return False
        elif np.linalg.norm(x[here]) > most:
            return False
    return True


def least_use(s: Resting, rng: Rng, starts: int = 4) -> float:
    """The least t found at which all stick, none beyond its limit by more than t - 1 of all limits.

    By linear programs with the limits of the last one (a ball's a cube), then by SLSQP.
    """
    R, nj = s.rate[:, 1:], len(s.kinetic)
    x0 = np.linalg.lstsq(R, -s.rate[:, 0], rcond=_RANK)[0]
    N = null_space(R, rcond=_RANK)
    of = np.eye(nj)[s.joint]
    balls = [np.flatnonzero(s.joint == j) for j in range(nj) if (s.joint == j).sum() == 3]
    pins = np.array([c for c in range(len(x0)) if not any(c in ball for ball in balls)])
    held = {k: gear.held(u) for k, (u, gear) in s.gears.items()}
    best = np.inf
    for choice in product(*held.values()):
        low, high = np.zeros((2, len(x0)))
        for k, ends in zip(held, choice, strict=True):
            low[k], high[k] = ends

        def spare(
            x: np.ndarray, m: float, size: float, low: np.ndarray = low, high: np.ndarray = high
        ) -> np.ndarray:
            L = s.above * s.limit(x[None])[0] + m * size
            pin = L[s.joint[pins]]
            ball = [L[s.joint[here[0]]] - np.linalg.norm(x[here]) for here in balls]
            here = x[pins]
            out = np.concatenate([pin + high[pins] - here, pin + here - low[pins], ball]) / size
            return np.asarray(np.where(np.isfinite(out), out, 1e3))

        size = float(s.above * s.limit(x0[None]).max())
        m = -spare(x0, 0.0, size).min()
        best = min(best, 1.0 + m)
        if not N.shape[1] or best <= 1.0:
            continue
        for k in range(starts):
            x = x0 + N @ rng.normal(size=N.shape[1]) * size * (0.0, 1.0, 3.0, 10.0)[k % 4]
            for _ in range(6):
                L = of @ (s.above * s.limit(x[None])[0])
                L[np.concatenate([np.zeros(0, int), *balls])] *= 0.7
                G = np.vstack([N, -N]) / size
                h = np.concatenate([L + high - x0, L + x0 - low]) / size
                bounded = np.isfinite(h)
                found = linprog(
                    np.append(np.zeros(N.shape[1]), 1.0), bounds=(None, None),
                    A_ub=np.column_stack([G, -np.ones(len(h))])[bounded], b_ub=h[bounded],
                )  # fmt: skip
                if found.x is None:
                    break
                x = x0 + N @ found.x[:-1]
            m = -spare(x, 0.0, size).min()
            z = N.T @ (x - x0) / size
            better = minimize(
                lambda y: y[0], np.append(m, z), jac=lambda y: np.eye(len(y))[0],
                constraints={
                    "type": "ineq",
                    "fun": lambda y: spare(x0 + N @ y[1:] * size, y[0], size),  # noqa: B023
                },
                method="SLSQP", options={"maxiter": 100, "ftol": 1e-10},
            )  # fmt: skip
            best = min(best, 1.0 + m)
            if np.isfinite(better.x).all():
                x = x0 + N @ better.x[1:] * size
                best = min(best, 1.0 - spare(x, 0.0, size).min())
            if best <= 1.0:
                return best
    return best


def share_of_limits(s: Resting, x: np.ndarray) -> float:
    """The largest |x_k| / limit_k of pins."""
    return float((np.abs(x) / (s.above * s.limit(x[None])[0])).max())


def least_share(s: Resting, rng: Rng, starts: int = 6) -> float:
    """The least `share_of_limits` found at which all pins stick: linear programs, many starts."""
    R = s.rate[:, 1:]
    x0, N = np.linalg.lstsq(R, -s.rate[:, 0], rcond=_RANK)[0], null_space(R, rcond=_RANK)
    best, unit = np.inf, np.eye(len(x0))
    for k in range(starts):
        x = x0 + N @ rng.normal(size=N.shape[1]) * np.abs(x0).max() * (0.0, 0.3, 1.0, 3.0)[k % 4]
        for _ in range(30):
            L, G = s.above * s.limit(x[None])[0], s.above * s.slope(x[None])[0]
            t, reach = share_of_limits(s, x), 3.0 * np.abs(x).max()
            room = np.append(t * L - x, t * L + x)
            # sign (x + N z) - t (L + G N z) <= m L
            rows = [np.column_stack([(sign * unit - t * G) @ N, -L]) for sign in (1.0, -1.0)]
            found = linprog(
                np.append(np.zeros(N.shape[1]), 1.0), np.vstack(rows), room,
                bounds=[(-reach, reach)] * N.shape[1] + [(None, None)],
            )  # fmt: skip
            if found.x is None or not share_of_limits(s, x + N @ found.x[:-1]) < t * (1 - 1e-12):
                break
            x = x + N @ found.x[:-1]
        best = min(best, share_of_limits(s, x))
    return best


# ---------------------------------------------------------------- bodies in space


@dataclass(frozen=True)
class Joint:
    """One joint, in the pose in which all coordinates are 0.

    Attributes:
        bodies: the child, and what carries it; -1 the ground. place: (3,) m.
        axes: (3, k) about which it turns: one a pin, three a ball, none a platform that floats.
        level: whether the platform cannot turn.
        friction: radial and thrust radius times kinetic coefficient (m), dry (N m); None: none.
    """

    name: str
    bodies: tuple[int, int]
    place: np.ndarray
    axes: np.ndarray
    friction: tuple[float, float, float] | None = None
    level: bool = False


@dataclass(frozen=True)
class Bodies:
    """Bodies and joints in space.

    Attributes:
        mass: (nb,) kg. center: (nb, 3) m. inertia: (nb, 3) about it, along the world's axes.
        joints: each body's, then those that close loops. drives: numbers of joints.
    """

    mass: np.ndarray
    center: np.ndarray
    inertia: np.ndarray
    joints: tuple[Joint, ...]
    drives: tuple[int, ...]

    def resting(self, above: float, effort: np.ndarray) -> Resting:
        """The maps under efforts (na,) of the drives."""
        nb, columns, rows, at = len(self.mass), [], [], []
        M = np.zeros((6 * nb, 6 * nb))
        push = np.zeros(6 * nb)
        for b in range(nb):
            here = slice(6 * b, 6 * b + 6)
            M[here, here] = np.diag([*[self.mass[b]] * 3, *self.inertia[b]])
            push[6 * b + 2] = -9.81 * self.mass[b]
        for k, one in enumerate(self.joints):
            W = np.zeros((6 * nb, 6))  # of the force and the moment on the child
            for body, sign in zip(one.bodies, (1.0, -1.0), strict=True):
                if body >= 0:
                    W[6 * body : 6 * body + 3, :3] = sign * np.eye(3)
                    lever = one.place - self.center[body]
                    W[6 * body + 3 : 6 * body + 6, :3] = sign * pin.skew(lever)
                    W[6 * body + 3 : 6 * body + 6, 3:] = sign * np.eye(3)
            turns = W[:, 3:] @ one.axes
            across = null_space(one.axes.T) if one.axes.size else np.eye(3)[:, : 3 * one.level]
            closes = [W[:, :3]] * (one.axes.size > 0) + [W[:, 3:] @ across]
            at.append(sum(c.shape[1] for c in columns))
            columns += closes
            if one.friction is not None:
                rows.append(turns)
            if k in self.drives:
                push += turns[:, 0] * effort[self.drives.index(k)]
        W, D = np.hstack(columns), np.hstack(rows)
        K = np.block([[M, -W], [W.T, np.zeros((W.shape[1],) * 2)]])
        right = np.zeros((len(K), 1 + D.shape[1]))
        right[: 6 * nb] = np.column_stack([push, D])
        x = np.linalg.solve(K, right)
        rubs = [k for k, one in enumerate(self.joints) if one.friction is not None]
        owner, force, joint = [], [], []
        for j, k in enumerate(rubs):
            one = self.joints[k]
            assert one.friction is not None
            F, along = x[6 * nb + at[k] :][:3], one.axes @ one.axes.T
            radial = F if one.axes.shape[1] == 3 else F - along @ F
            force += [one.friction[0] * radial, one.friction[1] * (F - radial)]
            owner += [j, j]
            joint += [j] * one.axes.shape[1]
        dry = [self.joints[k].friction[2] for k in rubs]  # type: ignore[index]
        return Resting(
            D.T @ x[: 6 * nb], np.array(force), np.array(owner), np.array(joint),
            np.ones(len(rubs)), np.array(dry), above,
        )  # fmt: skip

    def scene(self, above: float) -> pf.Scene:
        """The same as a scene of pinfric."""
        model, ids, own = grounded_model((0.0, 0.0, -9.81)), [0], [np.zeros(3)]
        loops, friction = [], {}
        for one in self.joints:
            body, carrier = (1 + b for b in one.bodies)
            if one.friction is not None:
                radial, thrust, dry = one.friction
                kind = {"kind": "pin", "radius": radial / 0.1, "thrust_radius": thrust / 0.1}
                if one.axes.shape[1] == 3:
                    kind = {"kind": "ball", "radius": radial / 0.1}
                friction[one.name] = {
                    "bearing": kind,
                    "mu": {"static": 0.1 * above, "kinetic": 0.1},
                    **({"coulomb": {"static": above * dry, "kinetic": dry}} if dry else {}),
                }
            if body < len(ids):
                sides = {
                    side: {"link": f"b{b - 1}" if b else "ground", "xyz": one.place - own[b]}
                    for side, b in (("a", body), ("b", carrier))
                }
                loops.append({"name": one.name, "kind": "spherical", **sides})
                continue
            turns = pin.JointModelTranslation() if one.level else pin.JointModelFreeFlyer()
            if one.axes.size:
                turns = pin.JointModelRevoluteUnaligned(one.axes[:, 0])
            lever, inertia = self.center[body - 1] - one.place, np.diag(self.inertia[body - 1])
            moved = pin.SE3(np.eye(3), one.place - own[carrier])
            solid = pin.Inertia(self.mass[body - 1], lever, inertia)
            ids.append(add_link(model, ids[carrier], turns, moved, one.name, solid))
            own.append(one.place)
        drives = [{"joint": self.joints[k].name} for k in self.drives]
        return pf.Scene(model=model, friction=friction, loops=loops, actuators=drives)


def _unit(x: np.ndarray) -> np.ndarray:
    return np.asarray(x / np.linalg.norm(x))


def legged(rng: Rng, delta: bool) -> Bodies:
    """A platform on three legs: two pins and a ball each, or a delta's arms and forearms."""
    ball, body = float(rng.uniform(0.05, 0.25) * rng.choice([0.006, 0.01, 0.02])), []
    mu = 0.1 * rng.choice([0.005, 0.01, 0.02])
    center, joints, closing = [np.array([0.0, 0.0, 0.4])], [], []
    joints.append(Joint("b0", (0, -1), center[0], np.zeros((3, 0)), level=delta))
    body.append((float(rng.uniform(0.5, 3.0)), 0.15))
    for k in range(3):
        turn = pin.rpy.rpyToMatrix(0.0, 0.0, 2.0 * np.pi * k / 3.0 + 0.15 * rng.normal())
        foot = turn @ np.array([rng.uniform(0.2, 0.3), 0.0, 0.0])
        top = center[0] + turn @ np.array([rng.uniform(0.08, 0.18), 0.0, 0.0])
        knee = turn @ np.array([rng.uniform(0.32, 0.45), 0.05 * rng.normal(), 0.2])
        axis = turn @ _unit(np.array([0.1 * rng.normal(), 1.0, 0.1 * rng.normal()]))
        arm = len(body)
        rubs = (mu, float(rng.choice([0.0, 1.0])) * mu, float(rng.choice([0.0, 0.02])))
        body += [(float(rng.uniform(0.2, 0.8)), 0.1), (float(rng.uniform(0.1, 0.6)), 0.15)]
        center += [0.5 * (foot + knee), 0.5 * (knee + top)]
        joints.append(Joint(f"b{arm}", (arm, -1), foot, axis[:, None], rubs))
        bends = axis if delta else _unit(axis + 0.1 * rng.normal(size=3))
        lower = arm + 1
        if delta:  # a cross of little mass between arm and forearm
            body.insert(lower, (0.02, 0.05))
            center.insert(lower, knee)
            joints.append(Joint(f"b{lower}", (lower, arm), knee, bends[:, None]))
            lower, bends = lower + 1, _unit(np.cross(bends, top - knee))
        knees = None if delta else rubs
        joints.append(Joint(f"b{lower}", (lower, lower - 1), knee, bends[:, None], knees))
        rubbing = (ball, 0.0, 0.0)
        closing.append(Joint(f"ball{k}", (lower, 0), top, np.eye(3), rubbing))
    mass, size = np.array(body).T
    spin = mass[:, None] * size[:, None] ** 2 * np.array([0.6, 0.8, 1.0])
    arms = tuple(k for k, one in enumerate(joints) if one.axes.size and one.bodies[1] == -1)
    return Bodies(mass, np.array(center), spin, (*joints, *closing), arms)


# ---------------------------------------------------------------- states


@dataclass(frozen=True)
class State:
    """A mechanism at rest, its scene, its drives' input, and which rates are its joints'."""

    resting: Resting
    scene: pf.Scene
    given: dict[str, np.ndarray]
    columns: np.ndarray
    velocity: np.ndarray


def _of_chain(chain: PinChain, torque: np.ndarray, above: float) -> Resting:
    moving = Moving(chain, np.zeros(len(chain.radius)), torque)
    pins = np.arange(len(chain.radius))
    force = np.concatenate([moving.force, np.zeros((len(pins), 1, 1 + len(pins)))], axis=1)
    weighted = force * chain.radius[:, None, None]
    kinetic = np.full(len(pins), chain.mu)
    return Resting(moving.relative, weighted, pins, pins, kinetic, chain.dry, above)


def _widths(s: Resting, drives: np.ndarray) -> np.ndarray:
    """(na,) how far efforts may be from those that hold alone: friction's work along each drive."""
    B = orth(s.rate[:, 1:], rcond=_RANK)
    of, L = np.eye(len(s.kinetic))[s.joint], s.above * s.limit(np.zeros((1, len(s.joint))))[0]
    along = B @ np.linalg.pinv(B[drives])
    return np.asarray(L @ np.sqrt(of.T @ along**2))


def tree(rng: Rng) -> State:
    """Five to fourteen bars, all driven; half of them hang from one pin."""
    pins = int(rng.choice(np.arange(5, 15), p=np.array([3, 3, 3, 3, 2, 2, 2, 2, 3, 3]) / 26))
    chain = random_planar_tree(int(rng.integers(1 << 30)), pins, bool(rng.random() < 0.6))
    above = float(rng.choice([1.1, 1.3, 1.6]))
    chain = replace(chain, above=above, dry=np.maximum(chain.dry, 0.05 * rng.random(pins)))
    held = chain.balance()[1][:, 0]
    s = _of_chain(chain, held, above)
    limit = above * s.limit(np.zeros((1, pins)))[0]
    most = 2.5 if pins < 10 else 1.4  # of many joints a few slip: else there are too many modes
    push = rng.uniform(-1.0, 1.0, pins) * limit * rng.choice([0.9, 1.2, most], pins)
    root = np.arange(pins)
    for b, parent in enumerate(chain.parent):
        root[b] = b if parent < 0 else root[parent]
    torque = held + push
    s = replace(_of_chain(chain, torque, above), island=root)
    return State(s, chain.scene(), {"effort": torque}, np.arange(pins), np.arange(pins))


def five_bar(rng: Rng, loops: tuple[int, ...] = (5,), push: float = 1.8) -> State:
    """A loop of pins; its freedoms are driven, up to so many times beyond what friction holds."""
    above = float(rng.choice([1.0, 1.2, 1.5]))
    mu = float(rng.choice([0.1, 0.2, 0.4]))
    chain = random_chain(int(rng.integers(1 << 30)), loops, mu, 0.5)
    chain = replace(chain, above=above, radius=chain.radius * 0.7)
    n, d = len(chain.radius), np.array(chain.drives)
    if rng.random() < 0.3:
        chain = replace(chain, dry=rng.uniform(0.0, 0.3, n))
    held = chain.balance()[1][:, 0]
    width = _widths(_of_chain(chain, held, above), d)
    torque = held + width * rng.uniform(-push, push, len(d))
    bars = np.arange(len(chain.parent))
    return State(_of_chain(chain, torque, above), chain.scene(), {"effort": torque}, bars, bars)


def geared(rng: Rng) -> State:
    """A four-bar or a five-bar whose drives have gears with losses, driven by motor torques."""
    loops = [(4,), (5,)][rng.integers(2)]
    state = five_bar(rng, loops)
    scene, s = state.scene, state.resting
    drives = np.array([int(name[1:]) for name in scene.actuator_names])
    gears, entries, u = {}, [], []
    (effort,) = state.given.values()
    weight = np.abs(effort).max() + 0.1
    for k in drives.tolist():
        ratio = float(rng.choice([-1.0, 1.0]) * rng.uniform(20, 120))
        inertia = 1.0 / float(s.rate[k, 1 + k])
        entry = constant_gear(rng, ratio, float(10 ** rng.uniform(-1.5, 0.3)), False, inertia)
        if rng.random() < 0.7:
            entry["back_efficiency"] = float(rng.uniform(0.4, 1.0))
        size = weight * float(rng.choice([0.01, 0.1])) / abs(ratio)
        entry["no_load_torque"] = {"static": 1.4 * size, "kinetic": size}
        entries.append({"joint": f"p{k}", "transmission": entry})
        gears[k] = plain_gear(entry)
    # without efforts: what the gears deliver is in x
    rate, force = s.rate.copy(), s.force.copy()
    rate[:, 0] -= rate[:, 1 + drives] @ effort
    force[:, :, 0] -= force[:, :, 1 + drives] @ effort
    for k, e in zip(drives.tolist(), effort, strict=True):
        lines = [
            line for line in gears[k].lines(float(np.sign(e) or 1.0)) if line[2] <= e <= line[3]
        ]
        u.append((lines[0][0] * e + lines[0][1]) * rng.uniform(0.7, 1.2))
    ratio = np.array([entry["transmission"]["ratio"] for entry in entries])
    known = {k: (x, gears[k]) for k, x in zip(drives.tolist(), u, strict=True)}
    s = replace(s, rate=rate, force=force, gears=known)
    scene = scene.with_(actuators=entries)
    return replace(state, resting=s, scene=scene, given={"motor_torque": np.array(u) / ratio})


def platform(rng: Rng, delta: bool) -> State:
    """A delta or a 3-RRS with friction in balls and pins."""
    above = float(rng.choice([1.0, 1.2, 1.5]))
    while True:
        bodies = legged(rng, delta)
        free = bodies.resting(above, np.zeros(3))
        rubs = [one for one in bodies.joints if one.friction is not None]
        names = [one.name for one in rubs]
        at = np.array(
            [list(free.joint).index(names.index(bodies.joints[k].name)) for k in bodies.drives]
        )
        held = -np.linalg.lstsq(free.rate[:, 1 + at], free.rate[:, 0], rcond=None)[0]
        if np.abs(held).max() < 60.0:
            break
    width = _widths(bodies.resting(above, held), at)
    effort = held + width * rng.uniform(-1.5, 1.5, 3)
    s, scene = bodies.resting(above, effort), bodies.scene(above)
    pins = np.array(
        [list(s.joint).index(j) for j, one in enumerate(rubs) if one.axes.shape[1] == 1]
    )
    of = [scene.model.getJointId(one.name) for one in rubs if one.axes.shape[1] == 1]
    velocity = np.array([scene.model.joints[j].idx_v for j in of])
    return State(s, scene, {"effort": effort}, pins, velocity)


KINDS: dict[str, Callable[[Rng], State]] = {
    "trees": tree,
    "five-bars": five_bar,
    "geared loops": geared,
    "deltas": lambda rng: platform(rng, True),
    "3-RRS": lambda rng: platform(rng, False),
}


def also(s: Resting, pins: np.ndarray, a: np.ndarray, slips: np.ndarray) -> np.ndarray | None:
    """Rates near accelerations a of pins that obey the laws, where these joints slip; or None."""
    B = orth(s.rate[:, 1:], rcond=_RANK)
    r = B @ np.linalg.lstsq(B[pins], a, rcond=None)[0]
    stuck = ~slips[s.joint]
    way = r.copy()
    way[pins] = np.sign(r[pins])
    for one in _obeying(s, list(_with_lines(s, stuck, way))):
        if np.abs(one[pins] - a).max() <= 1e-5 * np.abs(a).max():
            return one
    return None


def compare(kind: str, seed: int) -> tuple[str, object]:
    """How forward dynamics and the judge compare at one random state; and what each says."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    state = KINDS[kind](rng)
    s = state.resting
    found = answers(s, rng)
    q, still = pin.neutral(state.scene.model), np.zeros(state.scene.model.nv)
    many = f"{len(found.rates)} answers"
    if abs(found.use - 1.0) < _NEAR:
        return "not judged: at the limit", found
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            instant = pf.forward_dynamics(state.scene, q, still, **state.given)
    except pf.PinfricError as error:
        says = type(error).__name__
        if not found.complete:
            return f"not judged: too many modes, {says}", error
        right = {0: ("NoConsistentAcceleration",), 1: ()}.get(
            len(found.rates), ("AmbiguousAcceleration",)
        )
        if says in right:
            return f"same: {many}, {says}", error
        undecided = says == "UndecidedAcceleration"
        return f"{'undecided' if undecided else 'WRONG ' + says}: {many}", (found, error)
    a = instant.a[state.velocity]
    if not found.complete:
        return "not judged: too many modes", found
    near = [bool(np.abs(a - r[state.columns]).max() <= 1e-5 * np.abs(r).max()) for r in found.rates]
    if found.level == 0:
        near = [not a.any()]
    proved = "" if instant.answers else ", others may exist"
    if not any(near):
        slips = instant.modes != 0
        obeys = also(s, state.columns, a, slips) is not None
        level = int(slips.sum())
        if obeys and found.level < 0:
            return f"same: found by pinfric alone, moves{proved}", found
        if obeys and proved:
            return f"others may exist, and do: {many} with fewer slipping", (instant, found)
        return f"WRONG a: {many} with {found.level} slipping, {level} here{proved}", (
            instant,
            found,
        )
    if len(near) > 1 and instant.answers:
        return f"WRONG label: {many}", (instant, found)
    moves = "moves" if found.level else "holds"
    return f"same: {many}, {moves}{proved}", found


def study(kind: str, seeds: range) -> tuple[Counter[str], dict[str, list[int]]]:
    """Count the outcomes of many states, and print the seeds of those that differ."""
    count: Counter[str] = Counter()
    which: dict[str, list[int]] = {}
    for seed in seeds:
        outcome, _ = compare(kind, seed)
        count[outcome] += 1
        if not outcome.startswith("same"):
            which.setdefault(outcome, []).append(seed)
    return count, which


if __name__ == "__main__":
    for name in KINDS if sys.argv[1] == "all" else [sys.argv[1]]:
        total, seeds_of = study(name, range(int(sys.argv[2]), int(sys.argv[3])))
        print(name, flush=True)
        for label, number in sorted(total.items()):
            print(f"  {number:5d}  {label}  {seeds_of.get(label, [])[:12]}", flush=True)
