"""A stop along the path of a cycle: its time runs slower and slower until it stands.

    q(t) = p(tau),    tau' = sigma,    v_j = p_j' sigma,    a_j = p_j'' sigma^2 + p_j' sigma'

p the cycle, sigma its speed (1 as given). The deceleration of each axis, -sign(v_j) a_j, is bounded
by d_j, so with x = sigma^2

    -dx/dtau = max(0, min_j 2 (d_j + sign(p_j') p_j'' x)/|p_j'|)

is the most by which the cycle can be slowed: less at any place leaves more speed at all that
follow. Where the cycle by itself slows an axis by more than d_j it goes on as it is. All axes stop
together. Integrated by Heun's method, exact for an axis that moves with constant speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.motions.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline

#: Longest time of the cycle between places of a stop (s), the least number of them, and the most.
_STEP, _LEAST, _MOST = 1e-3, 50, 5000
#: So many places at a time.
_CHUNK = 128


class Slowed(NamedTuple):
    """A motion that ends at rest.

    Attributes:
        t: (N,) s, from 0. q: (N, nq). v, a: (N, nv).
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


@dataclass(frozen=True, eq=False)
class CyclePath:
    """A cycle between its samples, and straight on after its last."""

    model: pin.Model
    trajectory: Trajectory

    @cached_property
    def curve(self) -> CubicHermiteSpline:
        """Way of each velocity since the first sample (nv,) over the cycle's time."""
        from scipy.interpolate import CubicHermiteSpline  # 0.5 s to import

        cycle = self.trajectory
        steps = [
            pin.difference(self.model, *pair)
            for pair in zip(cycle.q[:-1], cycle.q[1:], strict=True)
        ]
        way = np.concatenate([np.zeros((1, self.model.nv)), np.cumsum(steps, axis=0)])
        return CubicHermiteSpline(cycle.t, way, cycle.v)

    def slowed(self, sample: int, speed: float, deceleration: np.ndarray) -> Slowed:
        """Return the stop from a sample.

        Args:
            speed: sigma there. deceleration: (nv,) d_j > 0, rad/s^2 or m/s^2.
        """
        cycle = self.trajectory
        if not cycle.v[sample].any():  # it rests
            zero = np.zeros((1, self.model.nv))
            return Slowed(np.zeros(1), cycle.q[[sample]], zero, zero)
        slowest = float((np.abs(cycle.v[sample:]) / deceleration).max())
        begin, straight = float(cycle.t[sample]), speed**2 * slowest / 2.0
        longest = float(cycle.t[-1]) - begin + straight
        step = max(min(_STEP, straight / _LEAST), longest / _MOST)
        tau, square, slowing = self._until_rest(begin, step, speed**2, deceleration)
        sigma = np.sqrt(square)
        t = np.append(0.0, np.cumsum(2.0 * np.diff(tau) / (sigma[1:] + sigma[:-1])))
        q, rate, bend = self.at(tau)
        a = bend * square[:, None] - rate * slowing[:, None] / 2.0
        return Slowed(t, q, rate * sigma[:, None], a)

    def _until_rest(
        self, begin: float, step: float, square: float, deceleration: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return places (N,), x = sigma^2 and -dx/dtau there, from a speed until x is 0.

        Args:
            begin: first place, s. step: between places, s. square: x there.
        """
        taus, squares, slowings = [begin], [square], []
        while True:
            tau = taus[-1] + step * np.arange(_CHUNK + 1)
            rate, bend = self.rates(tau)
            with np.errstate(divide="ignore", invalid="ignore"):
                least = 2.0 * deceleration / np.abs(rate)  # infinite of an axis at rest
                more = np.where(rate == 0.0, 0.0, 2.0 * bend / rate)
            slowing = _slowing(least[0], more[0], square)
            for k in range(_CHUNK):
                slowings.append(slowing)
                after = _slowing(least[k + 1], more[k + 1], max(square - step * slowing, 0.0))
                mean = 0.5 * (slowing + after) if after < np.inf else slowing
                if square <= step * mean or after == np.inf:  # it comes to rest before the next
                    way = min(square / mean, step) if mean > 0.0 else step
                    end = [*taus, float(tau[k]) + way], [*squares, 0.0], [*slowings, 0.0]
                    return np.array(end[0]), np.array(end[1]), np.nan_to_num(end[2], posinf=0.0)
                square -= step * mean
                slowing = _slowing(least[k + 1], more[k + 1], square)
                taus.append(float(tau[k + 1]))
                squares.append(square)

    def rates(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return p' and p'' (N, nv) at times of the cycle (N,)."""
        cycle = self.trajectory
        within = np.minimum(tau, cycle.t[-1])
        bend = np.array([np.interp(within, cycle.t, column) for column in cycle.a.T]).T
        return self.curve(within, 1), np.where((tau > within)[:, None], 0.0, bend)

    def at(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p (N, nq), p' and p'' (N, nv) at times of the cycle (N,)."""
        cycle, curve = self.trajectory, self.curve
        within = np.minimum(tau, cycle.t[-1])
        before = np.clip(cycle.t.searchsorted(within, side="right") - 1, 0, len(cycle.t) - 1)
        after = (tau - within)[:, None]
        way = curve(within) - curve(cycle.t[before]) + cycle.v[-1] * after
        pairs = zip(cycle.q[before], way, strict=True)
        q = np.array([pin.integrate(self.model, *pair) for pair in pairs])
        return q, *self.rates(tau)


def _slowing(least: np.ndarray, more: np.ndarray, square: float) -> float:
    """Most by which x = sigma^2 may fall per time of the cycle: `least` + `more` x of an axis."""
    return max(float((least + more * square).min()), 0.0)
