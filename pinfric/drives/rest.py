"""What a joint at rest asks of a brake."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.drives.demand import largest
from pinfric.drives.policy import (
    FRICTION_RESERVE,
    LITTLE_LOAD,
    STOP_TIME,
    UNSURE_BRAKE_FACTOR,
    Conditions,
)


class RestDemand(NamedTuple):
    """What decides whether a joint needs a brake, and how strong a one.

    Attributes:
        load: (T,) effort that holds it without friction, N m (N), at every pose of the cycle.
        peak: largest effort of the cycle. own: dry friction that is known to be the joint's own.
        moves: it moves in the cycle. stops: the scene says how the robot is stopped.
        unsure: masses or payloads are guesses. sprung: any one spring or payload may be
            lost.
    """

    load: np.ndarray
    peak: float
    own: float
    moves: bool
    stops: bool
    unsure: bool
    sprung: bool = False

    def why_brake(self, conditions: Conditions, locks: bool) -> str:
        """Return why the joint needs a brake; empty: it needs none.

        It does where its load exceeds half of its own dry friction, and 2 % of its largest effort;
        where it moves and the robot is stopped; or where the conditions want one. "Do not rely on
        the back-driving torque to hold a load" (Harmonic Drive): only a self-locking gear holds.

        Args:
            conditions: `holding_brake`. locks: its gear is self-locking.
        """
        if conditions.holding_brake == "all":
            return "holding_brake = all"
        if locks:
            return ""
        if largest(self.load) > max(self.own / FRICTION_RESERVE, LITTLE_LOAD * self.peak):
            return "its own friction does not hold it"
        return "it moves when power goes off" if self.moves and self.stops else ""

    def without_brake(self, back: float) -> str:
        """Say what a joint does without a brake, by eta_b of its driven gear."""
        if back <= 0:
            return (
                f"no brake: the gear locks by eta_b = {back:.2g}, a model where it is not printed"
            )
        if self.stops:
            return "no brake: it stands still in this cycle; without power it can be pushed"
        return "no brake: without power it coasts; add `stops`"

    def reserve(self, conditions: Conditions) -> float:
        """Return the factor on the load: the conditions', at least 2 where masses are guesses."""
        return max(conditions.brake_factor, UNSURE_BRAKE_FACTOR if self.unsure else 1.0)

    def within(self, conditions: Conditions) -> float:
        """Return the time (s) in which the brake alone stops the joint; infinite: any."""
        stopped = (self.moves and self.stops) or conditions.holding_brake == "all"
        return STOP_TIME if stopped else np.inf
