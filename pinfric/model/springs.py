"""Stiffness of gears as makers print it: angle over torque, a piecewise linear line through 0.

    delta = f(t) = sign(t) (delta_i + (|t| - t_i)/K_i),    t_i <= |t| < t_(i+1)

is the wind-up, the motor's angle over the ratio less the joint's, at the torque t from motor to
joint; K_i are the tangent stiffnesses. Units are rad and N m at the joint, m and N if it slides.
See `notebooks/theory/elastic.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import model_validator

from pinfric.model.entry import Entry, Forms, Positive, key, optional


class StiffnessLines(Entry):
    """Two or three lines of a strain wave gear's data sheet: K1 up to T1, K2 up to T2, then K3.

        stiffness: {k1: 3.1e4, k2: 5.0e4, k3: 5.7e4, t1: 14, t2: 48}

    Source: Harmonic Drive engineering data 1018854 8/2018, tables 54.3, 54.4.
    """

    k1: Positive = key("up to `t1`", 31000.0, "N m/rad or N/m")
    k2: Positive = key("from `t1` on", 50000.0, "N m/rad or N/m")
    k3: Positive | None = optional("from `t2` on", 57000.0, "N m/rad or N/m")
    t1: Positive = key("torque at the joint where the second line begins", 14.0, "N m or N")
    t2: Positive | None = optional("where the third begins", 48.0, "N m or N")

    @model_validator(mode="after")
    def _rising(self) -> StiffnessLines:
        if (self.k3 is None) != (self.t2 is None):
            raise ValueError("`k3` and `t2` belong together: K3 holds from T2 on")
        if self.t2 is not None and self.t2 <= self.t1:
            raise ValueError(f"t2 {self.t2:g} is not above t1 {self.t1:g}; swapped?")
        _check_rising([("k1", self.k1), ("k2", self.k2), ("k3", self.k3)])
        return self

    def scaled(self, factor: float) -> StiffnessLines:
        """Return lines `factor` times as stiff, which meet at the same torques."""
        stiffer = {k: factor * x for k in ("k1", "k2", "k3") if (x := getattr(self, k)) is not None}
        return self.model_copy(update=stiffer)


class LostMotionStiffness(Entry):
    """Two lines of a cycloidal or planetary gear, soft up to a share of the rated torque.

    The lost motion Phi is the whole angle between +share and -share of the rated torque T_N, on the
    middle of the hysteresis curve, so K_1 = 2 share T_N/Phi. Backlash is described in the same way,
    with a softer first line.

        stiffness: {k: 3.9e5, lost_motion: 2.9e-4, rated_torque: 412, share: 0.03}
    """

    k: Positive = key("torsional rigidity beyond the lost motion (b/a)", 390000.0, "N m/rad or N/m")
    lost_motion: Positive = key("Phi", 0.00029, "rad or m")
    rated_torque: Positive = key("T_N, at the joint", 412.0, "N m or N")
    share: Positive = key(
        "of the rated torque at which the lost motion is measured", 0.03, "1", lt=1, default=0.03
    )

    @property
    def soft(self) -> float:
        """K_1, N m/rad."""
        return 2.0 * self.share * self.rated_torque / self.lost_motion

    @model_validator(mode="after")
    def _rising(self) -> LostMotionStiffness:
        _check_rising([("2 share rated_torque/lost_motion", self.soft), ("k", self.k)])
        return self

    def scaled(self, factor: float) -> LostMotionStiffness:
        """Return lines `factor` times as stiff, which meet at the same torque."""
        update = {"k": factor * self.k, "lost_motion": self.lost_motion / factor}
        return self.model_copy(update=update)


#: Forms of `stiffness` in a file.
Stiffness = Annotated[
    float | StiffnessLines | LostMotionStiffness,
    Forms(Positive, StiffnessLines, LostMotionStiffness),
]


def _check_rising(named: Sequence[tuple[str, float | None]]) -> None:
    """Refuse a stiffness that falls with the torque, as if figures were swapped."""
    known = [(name, k) for name, k in named if k is not None]
    for (softer, low), (stiffer, high) in pairwise(known):
        if high < low:
            raise ValueError(
                f"stiffness falls with torque: {stiffer} {high:g} is below {softer} {low:g} "
                "(N m/rad); gears grow stiffer, so check order and unit"
            )


class Spring(NamedTuple):
    """A piecewise linear line from torque to angle.

    Attributes:
        torques: (n,) at which its lines begin, the first at 0 (N m or N).
        stiffness: (n,) of each (N m/rad or N/m).
        angles: (n,) at `torques` (rad or m).
    """

    torques: np.ndarray
    stiffness: np.ndarray
    angles: np.ndarray

    def wind_up(self, torque: Any) -> np.ndarray:
        """Return delta = f(t), rad (m), of torques of any shape."""
        size = np.abs(torque)
        line = self._line(self.torques, size)
        angle = self.angles[line] + (size - self.torques[line]) / self.stiffness[line]
        return np.asarray(np.copysign(angle, torque))

    def torque(self, wind_up: Any) -> np.ndarray:
        """Return t = f^-1(delta), N m (N), of angles of any shape."""
        size = np.abs(wind_up)
        line = self._line(self.angles, size)
        torque = self.torques[line] + (size - self.angles[line]) * self.stiffness[line]
        return np.asarray(np.copysign(torque, wind_up))

    def tangent(self, torque: Any) -> np.ndarray:
        """Return dt/d delta at torques of any shape; where two lines meet, the stiffer."""
        return np.asarray(self.stiffness[self._line(self.torques, np.abs(torque))])

    @staticmethod
    def _line(starts: np.ndarray, size: np.ndarray) -> np.ndarray:
        return np.asarray(np.searchsorted(starts, size, side="right") - 1)


def spring_of(stiffness: float | StiffnessLines | LostMotionStiffness) -> Spring:
    """Return the piecewise linear line of a stiffness entry."""
    match stiffness:
        case StiffnessLines():
            torques = [0.0, stiffness.t1, stiffness.t2]
            lines = [stiffness.k1, stiffness.k2, stiffness.k3]
        case LostMotionStiffness():
            torques = [0.0, stiffness.share * stiffness.rated_torque]
            lines = [stiffness.soft, stiffness.k]
        case _:
            torques, lines = [0.0], [stiffness]
    t = np.array([x for x in torques if x is not None])
    k = np.array([x for x in lines if x is not None])
    return Spring(t, k, np.concatenate([[0.0], np.cumsum(np.diff(t) / k[:-1])]))


def softest(stiffness: float | StiffnessLines | LostMotionStiffness) -> float:
    """Return the tangent stiffness without load, N m/rad (N/m), the least of the gear."""
    return float(spring_of(stiffness).stiffness[0])


def largest_friction(spring: Spring, hysteresis: float) -> float:
    """Return b = f^-1(H/2), the largest friction behind the spring for a stated hysteresis H.

    H is the full width at zero torque, rad (m).
    """
    return float(spring.torque(0.5 * hysteresis))
