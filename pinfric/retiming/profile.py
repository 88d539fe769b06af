"""Speed profiles over time: durations, and samples whose q, v and a belong together.

In an interval u = d^2s/dt^2 is linear in s, u = u_a + k h: with z = ds/dt

    h(t) = z_a S(t) + u_a C(t),   S = sinh(w t)/w,   C = (cosh(w t) - 1)/w^2,   w^2 = k
    tanh(w T/2) = w step/(z_a + z_b)

(sin, cos and tan where k < 0), so samples are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pinfric.motions.joint_columns import JointColumn
from pinfric.motions.sample_times import same_instant, sample_times
from pinfric.retiming.path import Path
from pinfric.retiming.tables import Grid

#: Below this w^2 t^2 the series are more exact than the functions.
_SERIES = 1.0e-6
#: Part of (z_a + z_b)^2 from which on an interval is never passed, to rounding.
_STALLS = 1.0e-9
#: Of the quadrature of a moving mean.
_NODES = 48


@dataclass(frozen=True)
class Profile:
    """A speed profile on a grid.

    Attributes:
        x: (n + 1,) (ds/dt)^2 at each point. u: (n, 2) d^2s/dt^2 at both ends of each interval.
        time: (n + 1,) when it passes each point since the start of its piece, s; at a stop the time
            of the piece that ends there.
        duration: (pieces,) s.
        holes: how often a lower limit cut the accelerations at a place in two, and the larger part
            was kept: only with extreme friction.
    """

    grid: Grid
    x: np.ndarray
    u: np.ndarray
    time: np.ndarray
    duration: np.ndarray
    holes: int = 0

    @classmethod
    def of(cls, grid: Grid, x: np.ndarray, u: np.ndarray) -> Profile:
        """Compute the times of a profile."""
        k = (u[:, 1] - u[:, 0]) / grid.step
        w, ratio = np.sqrt(np.abs(k)), grid.step / (np.sqrt(x[:-1]) + np.sqrt(x[1:]))
        y = w * ratio
        with np.errstate(divide="ignore", invalid="ignore"):
            hyperbolic = np.arctanh(np.minimum(y, 1.0 - 1e-16))
            spent = 2.0 * np.where(k > 0.0, hyperbolic, np.arctan(y)) / w
        square = k * ratio**2
        spent = np.where(np.abs(square) < _SERIES, 2.0 * ratio * (1.0 + square / 3.0), spent)
        total = np.concatenate(([0.0], np.cumsum(spent)))
        stops = np.flatnonzero(grid.stop)
        begin = np.zeros(len(total))
        for a, b in pairwise(stops):
            begin[a + 1 : b + 1] = total[a]
        return cls(grid, x, u, total - begin, np.diff(total[stops]))

    def stalls(self) -> np.ndarray:
        """Return the intervals inside which x falls to 0: points too far apart for such limits.

        x = x_a (1 - y) + x_b y - (u_b - u_a) step y (1 - y), y = h/step, has a zero in [0, 1] from
        (u_b - u_a) step = (z_a + z_b)^2 on.
        """
        z, bend = np.sqrt(self.x), self.u[:, 1] - self.u[:, 0]
        return np.flatnonzero(bend * self.grid.step >= (1.0 - _STALLS) * (z[:-1] + z[1:]) ** 2)

    def scaled(self, factor: float) -> Profile:
        """Return the same profile run `factor` times as fast."""
        return replace(
            self,
            x=self.x * factor**2,
            u=self.u * factor**2,
            time=self.time / factor,
            duration=self.duration / factor,
        )

    def inside(self, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return interval, x and u at given parts of every interval, (n len(shares),) each."""
        grid = self.grid
        h = np.outer(grid.step, shares)
        k = (self.u[:, 1] - self.u[:, 0]) / grid.step
        x = self.x[:-1, None] + 2.0 * self.u[:, :1] * h + k[:, None] * h**2
        u = self.u[:, :1] + k[:, None] * h
        of = np.repeat(np.arange(len(grid.step)), len(shares))
        return of, np.maximum(x, 0.0).ravel(), u.ravel()

    def at(self, piece: int, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return s, ds/dt and d^2s/dt^2 at times since a piece's start, (T,) each."""
        stops = np.flatnonzero(self.grid.stop)
        first, last = stops[piece], stops[piece + 1]
        begin = np.concatenate(([0.0], self.time[first + 1 : last + 1]))
        j = np.clip(np.searchsorted(begin, t, side="right") - 1, 0, last - first - 1)
        elapsed, j = np.maximum(t - begin[j], 0.0), j + first
        step, u = self.grid.step[j], self.u[j, 0]
        k, z = (self.u[j, 1] - u) / step, np.sqrt(self.x[j])
        half = 0.5 * elapsed
        S, C = _sine(k, elapsed), 2.0 * _sine(k, half) ** 2
        h = np.clip(z * S + u * C, 0.0, step)
        return self.grid.s[self.grid.start[j]] + h, z * (1.0 + k * C) + u * S, u + k * h


def _sine(k: np.ndarray, t: np.ndarray) -> np.ndarray:
    """sinh(w t)/w with w^2 = k, sin where k < 0."""
    w = np.sqrt(np.abs(k))
    square = k * t**2
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(k > 0.0, np.sinh(np.minimum(w * t, 700.0)), np.sin(w * t)) / w
    return np.where(np.abs(square) < _SERIES, t * (1.0 + square / 6.0), ratio)


@dataclass(frozen=True)
class RetimedSamples:
    """A motion in samples: times, one number per joint, who moves and where.

    Attributes:
        t: (T,) s. q, v, a: (T, nj) positions, velocities, accelerations.
        piece: (T,) the piece on which each sample is, or the one after the stop.
        moving: (T,) bool, inside a piece. s, rate: (T,) place and ds/dt.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    piece: np.ndarray
    moving: np.ndarray
    s: np.ndarray
    rate: np.ndarray


def sample(path: Path, profile: Profile, rate: float, smooth: float = 0.0) -> RetimedSamples:
    """Return the motion at `rate` (Hz), its end included; v = a = 0 at stops and in holds, of which
    long ones have fewer samples (`sample_times`).

    At a stop without a hold the acceleration is that of the move that follows.

    Args:
        smooth: s(t) is a moving mean over this time (s), by which each piece takes longer: jumps of
            the acceleration become ramps, and the path stays.
    """
    duration = profile.duration + smooth
    departs = np.cumsum(np.array(path.holds[:-1]) + np.concatenate(([0.0], duration[:-1])))
    end = departs[-1] + duration[-1] + path.holds[-1]
    arrives = np.append(0.0, departs + duration)
    rests = zip(arrives.tolist(), (arrives + path.holds).tolist(), strict=True)
    t, close = sample_times(float(end), rate, rests, path.source), same_instant(float(end))
    n, nj = len(path.pieces), path.nj
    q, v, a = np.empty((len(t), nj)), np.zeros((len(t), nj)), np.zeros((len(t), nj))
    s, speed, moving = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t), dtype=bool)
    of = np.searchsorted(departs + duration, t + close, side="right")
    for p in range(n + 1):
        here = of == p
        q[here] = path.stop(p)
        if p == n:
            break
        here &= t >= departs[p] - (close if path.holds[p] == 0.0 else -close)
        place, z, u = _smoothed(profile, p, np.maximum(t[here] - departs[p], 0.0), smooth)
        curve = path.pieces[p]
        first = curve(place, 1)
        q[here], v[here] = curve(place), first * z[:, None]
        a[here] = first * u[:, None] + curve(place, 2) * (z * z)[:, None]
        s[here], speed[here], moving[here] = place, z, z > 0.0
    return RetimedSamples(t, q, v, a, of, moving, s, speed)


def _smoothed(
    profile: Profile, piece: int, t: np.ndarray, width: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`Profile.at` of the moving mean of s over a window that ends at t."""
    if width == 0.0:
        return profile.at(piece, t)

    def at(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inside = (t > 0.0) & (t < profile.duration[piece])
        s, z, _ = profile.at(piece, np.clip(t, 0.0, profile.duration[piece]))
        return s, np.where(inside, z, 0.0)

    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    place = sum(
        0.5 * w * at(t - width * 0.5 * (1.0 - x))[0] for x, w in zip(nodes, weights, strict=True)
    )
    (s_1, z_1), (s_0, z_0) = at(t), at(t - width)
    return np.asarray(place), (s_1 - s_0) / width, (z_1 - z_0) / width


def columns_to_velocities(columns: tuple[JointColumn, ...], x: np.ndarray) -> np.ndarray:
    """Return (T, nv) velocities in the model's order from one number per joint (T, nj)."""
    velocities = np.zeros_like(x)
    velocities[:, [column.index_v for column in columns]] = x
    return velocities
