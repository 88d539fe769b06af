"""Motions that show friction, within limits: Fourier series, moves, staircases of speed.

    v_j(t) = s_j sum_k (A_jk cos k w t + B_jk sin k w t),   sum_k A_jk = sum_k k B_jk = 0

so that v = a = 0 at the start and after each period (Swevers et al., Optimal robot excitation and
identification, 1997, with these two conditions). s_j is as large as the limits allow, and A, B
are sought that tell most about friction (`information.Criterion`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pinfric.identification.information import Criterion
from pinfric.model.arrays import FloatArray
from pinfric.motions.waypoints import WayPoint, quintic, trapezoidal

#: Terms of a series; of robots with more joints fewer, so that the search ends.
HARMONICS, _FEWER, _MANY_JOINTS = 5, 3, 10
#: s of a period that are tried. Samples a period and term at which limits are kept: between two of
#: them a speed is larger by (pi/_FINE)^2/2 = 0.1 % at most, less than what is left of each limit.
_PERIODS, _FINE, _LEFT = (6.0, 10.0, 15.0), 64, 0.998
#: Samples a period, and evaluations, of the search; random starts of each period.
_COARSE, _EVALUATIONS, _STARTS = 96, 3000, 12
#: Steps of the search: the first, the least, factors after success and without.
_FIRST_STEP, _LAST_STEP, _GROWS, _SHRINKS = 0.5, 0.03, 1.1, 0.985
#: Samples a move, and moves that are compared for the next one.
_OF_MOVE, _COMPARED = 12, 8
#: s in which a joint may come to its top speed where no acceleration is given.
SPEED_UP = 0.4
#: Part of a trapezoidal move spent speeding up.
RAMP = 0.2
#: Speeds of a staircase, as shares of the joint's, and s of a hold between its moves: the first is
#: so slow that the joint breaks away while its effort rises.
_STAIRS, _HOLD = (0.02, 0.15, 1.0), 0.3
#: Peak speed and peak acceleration of a move of length 1 in time 1.
_PEAKS = {"quintic": (15.0 / 8.0, 10.0 / np.sqrt(3.0)), "trapezoidal": (1.25, 6.25)}


@dataclass(frozen=True)
class Reach:
    """Where and how fast joints may move; (nj,) each, rad or m, s."""

    low: FloatArray
    high: FloatArray
    speed: FloatArray
    acceleration: FloatArray

    def slower(self, factor: float) -> Reach:
        """Return the reach of the same motions, slower by a factor."""
        return replace(self, speed=self.speed / factor, acceleration=self.acceleration / factor**2)


@dataclass(frozen=True)
class Series:
    """A Fourier series within limits: its period (s) and (nj, 2 h + 1) A, B, place of its range."""

    period: float
    terms: FloatArray

    def slower(self, factor: float) -> Series:
        """Return the same motion, slower by a factor."""
        return replace(self, period=factor * self.period)

    def motion(self, reach: Reach, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, v, a (T, nj) at times t (T,)."""
        h = self.terms.shape[1] // 2
        k = np.arange(1, h + 1)
        w = 2.0 * np.pi * k / self.period
        A, B = self.terms[:, :h], self.terms[:, h : 2 * h]
        A = A - A.mean(axis=1, keepdims=True)
        B = B - (B @ k / (k @ k))[:, None] * k
        of_fit, of_t = (_series(w, A, B, x) for x in (self._fine(h), t))
        q, v, a = of_fit
        extent = np.maximum(np.ptp(q, axis=0), 1e-12)
        scale = np.minimum.reduce(
            [
                reach.speed / np.maximum(np.abs(v).max(axis=0), 1e-12),
                reach.acceleration / np.maximum(np.abs(a).max(axis=0), 1e-12),
                (reach.high - reach.low) / extent,
            ]
        )
        scale *= _LEFT
        spare = np.maximum(reach.high - reach.low - scale * extent, 0.0)
        beside = (1.0 - _LEFT) * scale * extent  # of which some is between two of these samples
        share = 0.5 + 0.5 * np.sin(self.terms[:, -1])
        lowest = reach.low + 0.5 * beside + share * (spare - beside)
        middle = lowest - scale * q.min(axis=0)
        return middle + scale * of_t[0], scale * of_t[1], scale * of_t[2]

    def _fine(self, terms: int) -> FloatArray:
        return np.arange(_FINE * terms) * self.period / (_FINE * terms)


def _series(
    w: FloatArray, A: FloatArray, B: FloatArray, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    phase = np.outer(t, w)
    s, c = np.sin(phase), np.cos(phase)
    return s @ (A / w).T - c @ (B / w).T, c @ A.T + s @ B.T, c @ (B * w).T - s @ (A * w).T


def random_series(reach: Reach, period: float, draws: np.random.Generator) -> Series:
    """Return a series with random terms."""
    nj = reach.speed.size
    h = HARMONICS if nj <= _MANY_JOINTS else _FEWER
    return Series(period, draws.normal(size=(nj, 2 * h + 1)))


def informative_series(criterion: Criterion, reach: Reach, duration: float, seed: int) -> Series:
    """Return the series that tells most about friction in `duration` s, of those searched.

    One joint's terms change at random at a time; steps grow with success, and shrink without
    (Rechenberg's (1 + 1) strategy). The scale is a least one of several, with kinks: L-BFGS-B ends
    there, with 0.84 of a random motion's errors on a UR5e where this comes to 0.75.
    """
    draws = np.random.default_rng(seed)
    periods = sorted({duration / max(round(duration / p), 1) for p in _PERIODS})

    def worth(series: Series) -> float:
        t = np.arange(_COARSE) * series.period / _COARSE
        return criterion.value(criterion.products(*series.motion(reach, t)))

    starts = [random_series(reach, p, draws) for p in periods for _ in range(_STARTS)]
    values = [worth(series) for series in starts]
    value = max(values)
    best, step = starts[values.index(value)], _FIRST_STEP
    for _ in range(_EVALUATIONS):
        terms, j = best.terms.copy(), int(draws.integers(len(best.terms)))
        terms[j] += step * draws.normal(size=terms.shape[1])
        other = replace(best, terms=terms)
        if (found := worth(other)) > value:
            best, value, step = other, found, min(_GROWS * step, 1.0)
        else:
            step = max(_SHRINKS * step, _LAST_STEP)
    return best


def move_time(reach: Reach, change: FloatArray, profile: str) -> float:
    """Return the shortest time (s) of a move by `change` (nj,) rad or m from rest to rest.

    What is left of the limits is for rounding in files.
    """
    peak, bend = (x / _LEFT for x in _PEAKS[profile])
    by_speed = np.max(peak * np.abs(change) / reach.speed)
    return float(max(by_speed, np.sqrt(np.max(bend * np.abs(change) / reach.acceleration))))


def informative_moves(
    criterion: Criterion,
    known: FloatArray,
    reach: Reach,
    postures: FloatArray,
    duration: float,
    profile: str = "quintic",
    hold: float = _HOLD,
) -> tuple[WayPoint, ...]:
    """Return way-points among postures (n, nj); each next move tells most per second.

    Args:
        known: (nj, p, p) products of what is recorded already.
    """
    draws = np.random.default_rng(0)
    here, elapsed = postures[0], 0.0
    points = [WayPoint(q=tuple(here.tolist()), hold=hold)]
    s = (np.arange(_OF_MOVE) + 0.5) / _OF_MOVE
    b, rate, bend = quintic(s) if profile == "quintic" else trapezoidal(s, RAMP)
    value = criterion.value(known)
    while elapsed < duration:
        found: tuple[float, FloatArray, float, FloatArray, float] | None = None
        for k in draws.integers(len(postures), size=_COMPARED).tolist():
            change = postures[k] - here
            time = min(max(move_time(reach, change, profile), 0.2), duration)
            own = criterion.products(
                here + np.outer(b, change),
                np.outer(rate, change) / time,
                np.outer(bend, change) / time**2,
            )
            both = known + own * (time / _OF_MOVE)
            worth = criterion.value(both)
            if found is None or (worth - value) / (time + hold) > found[0]:
                found = (worth - value) / (time + hold), postures[k], time, both, worth
        assert found is not None  # several are compared
        _, here, time, known, value = found
        points.append(WayPoint(q=tuple(here.tolist()), duration=time, hold=hold))
        elapsed += time + hold
    return tuple(points)


def staircases(reach: Reach, home: FloatArray, duration: float) -> tuple[WayPoint, ...]:
    """Return, for each joint alone, moves there and back at rising speeds, trapezoidal.

    Args:
        home: (nj,) where they begin and end. duration: s for all joints.
    """
    return tuple(
        point
        for j in range(home.size)
        for point in _staircase(reach, home, j, duration / home.size)
    )


def _staircase(reach: Reach, home: FloatArray, j: int, duration: float) -> Iterator[WayPoint]:
    peak = _PEAKS["trapezoidal"][0]
    room, back = reach.high[j] - home[j], home[j] - reach.low[j]
    most, sign = max(room, back), 1.0 if room >= back else -1.0
    each = max(duration / (2 * len(_STAIRS)) - _HOLD, 0.5)
    for share in _STAIRS:
        speed = share * _LEFT * reach.speed[j]
        length = min(most, speed * each / peak)
        change = length * (np.arange(home.size) == j)
        time = max(length * peak / speed, move_time(reach, change, "trapezoidal"))
        for q in (home[j] + sign * length, home[j]):
            point = home.copy()
            point[j] = q
            yield WayPoint(q=tuple(point.tolist()), duration=time, hold=_HOLD)
