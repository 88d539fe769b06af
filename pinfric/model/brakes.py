"""Brakes that hold without power, at a motor's shaft."""

from __future__ import annotations

from pydantic import model_validator

from pinfric.model.entry import Entry, Positive, key, optional

#: Of a brake whose largest torque is not printed: times its least holding torque.
BRAKE_PEAK = 2.0


class HoldingBrake(Entry):
    """A brake at a motor's shaft that closes when power goes off.

    Closed it acts like dry friction: it holds up to its torque, and opposes motion with it.
    """

    torque: Positive = key(
        "least holding torque; the dynamic one of a stop, if it is less", 0.5, "N m"
    )
    static_torque: Positive | None = optional(
        "M4, least at rest, where it is more than `torque`", 0.8, "N m"
    )
    torque_max: Positive | None = optional(
        "largest torque, which loads the gear in a stop; left out: twice `torque`", 0.9, "N m"
    )
    engage_time: Positive | None = optional("from power-off until it holds", 0.015, "s")
    stop_energy: Positive | None = optional("permissible energy of one emergency stop", 150.0, "J")
    stops_per_hour: Positive | None = optional(
        "permissible number of such stops in an hour", 10.0, "1/h"
    )

    @property
    def greatest(self) -> float:
        """The largest torque, N m: `torque_max`, or `BRAKE_PEAK` times `holds` if not known."""
        return self.torque_max or BRAKE_PEAK * self.holds

    @property
    def holds(self) -> float:
        """What it holds at rest, N m."""
        return self.static_torque or self.torque

    @model_validator(mode="after")
    def _most_is_more(self) -> HoldingBrake:
        for most in ("torque_max", "static_torque"):
            greatest = getattr(self, most)
            if greatest is not None and greatest < self.torque:
                raise ValueError(
                    f"{most} {greatest:g} N m is less than torque {self.torque:g} N m: `torque` is "
                    "the least that it holds"
                )
        return self
