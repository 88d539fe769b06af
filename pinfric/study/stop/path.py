"""A stop along the path of a cycle: its time runs slower and slower until it stands.

    q(t) = p(tau),    tau' = sigma,    sigma' = -min_j d_j/|p_j'(tau)|

p the cycle, sigma its speed (1 as given) and d_j the most by which axis j is slowed, so that
v_j = p_j' sigma and a_j = p_j'' sigma^2 + p_j' sigma'. All axes stop together, and the one that
needs longest decides. Between neighbouring places sigma' is constant, so of an axis that moves with
constant speed the time v/d and the way v^2/(2 d) are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicHermiteSpline

from pinfric.study.trajectory.trajectory import Trajectory

#: Time of the cycle between places of a stop, s; the least and the largest number of them.
_STEP, _LEAST, _MOST = 1e-3, 50, 5000
#: So much farther than the farthest stop the places go: rounding must not leave the end out.
_TO_THE_END = 1.0 + 1e-9


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
    """A cycle between its samples, and straight on after its last.

    Attributes:
        model: of the robot. trajectory: the cycle.
    """

    model: pin.Model
    trajectory: Trajectory

    @cached_property
    def curve(self) -> CubicHermiteSpline:
        """Way of each velocity since the first sample (nv,) over the cycle's time."""
        given = self.trajectory
        steps = [
            pin.difference(self.model, *pair)
            for pair in zip(given.q[:-1], given.q[1:], strict=True)
        ]
        way = np.concatenate([np.zeros((1, self.model.nv)), np.cumsum(steps, axis=0)])
        return CubicHermiteSpline(given.t, way, given.v)

    def slowed(self, sample: int, speed: float, deceleration: np.ndarray) -> Slowed:
        """Return the stop from a sample.

        Args:
            sample: at which it begins. speed: sigma there.
            deceleration: (nv,) d_j > 0, rad/s^2 or m/s^2.
        """
        given = self.trajectory
        if not given.v[sample].any():  # it rests
            zero = np.zeros((1, self.model.nv))
            return Slowed(np.zeros(1), given.q[[sample]], zero, zero)
        slowest = float((np.abs(given.v[sample:]) / deceleration).max())
        length = speed**2 * slowest / 2.0 * _TO_THE_END
        count = int(np.clip(length / _STEP, _LEAST, _MOST))
        tau = given.t[sample] + np.linspace(0.0, length, count + 1)
        needs = np.minimum((np.abs(self.at(tau)[1]) / deceleration).max(axis=1), slowest)
        needs = np.maximum(needs[:-1], needs[1:])  # -1/sigma' from one place to the next, s
        square = np.full(count + 1, speed**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            square[1:] -= np.cumsum(2.0 * np.diff(tau) / needs)
        last = int(np.argmin(square > 0.0)) - 1  # the place before the end
        sigma = np.append(np.sqrt(square[: last + 1]), 0.0)
        tau = np.append(tau[: last + 1], tau[last] + square[last] * needs[last] / 2.0)
        t = np.append(0.0, np.cumsum(2.0 * np.diff(tau) / (sigma[1:] + sigma[:-1])))
        q, rate, bend = self.at(tau)
        slowing = np.zeros(len(tau))  # where nothing moves it stops at once, without slowing
        np.divide(-1.0, needs[: last + 1], out=slowing[:-1], where=needs[: last + 1] > 0.0)
        a = bend * sigma[:, None] ** 2 + rate * slowing[:, None]
        return Slowed(t, q, rate * sigma[:, None], a)

    def at(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p (N, nq), p' and p'' (N, nv) at times of the cycle (N,)."""
        given, curve = self.trajectory, self.curve
        within = np.minimum(tau, given.t[-1])
        before = np.clip(given.t.searchsorted(within, side="right") - 1, 0, len(given.t) - 1)
        rate, after = curve(within, 1), (tau - within)[:, None]
        way = curve(within) - curve(given.t[before]) + given.v[-1] * after
        pairs = zip(given.q[before], way, strict=True)
        q = np.array([pin.integrate(self.model, *pair) for pair in pairs])
        bend = np.array([np.interp(within, given.t, column) for column in given.a.T]).T
        return q, rate, np.where(after > 0.0, 0.0, bend)
