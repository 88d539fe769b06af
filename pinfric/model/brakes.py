"""Brakes that hold without power, at a motor's shaft."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from pinfric.model.entry import Entry, Positive, key

#: Of a brake whose largest torque is not printed: times its least holding torque.
BRAKE_PEAK = 2.0


class HoldingBrake(Entry):
    """A brake at a motor's shaft that closes when power goes off.

    Closed it acts like dry friction: it holds up to its torque, and opposes motion with it.
    """

    torque: Annotated[
        Positive, key("least holding torque; the dynamic one of a stop, if it is less", 0.5, "N m")
    ]
    static_torque: Annotated[
        Positive | None, key("M4, least at rest, where it is more than `torque`", 0.8, "N m")
    ] = None
    torque_max: Annotated[
        Positive | None,
        key("largest torque, which loads the gear in a stop; left out: twice `torque`", 0.9, "N m"),
    ] = None
    engage_time: Annotated[Positive | None, key("from power-off until it holds", 0.015, "s")] = None
    stop_energy: Annotated[
        Positive | None, key("permissible energy of one emergency stop", 150.0, "J")
    ] = None
    stops_per_hour: Annotated[
        Positive | None, key("permissible number of such stops in an hour", 10.0, "1/h")
    ] = None

    @property
    def greatest(self) -> float:
        """The largest torque, N m: `torque_max`, or 2 times `holds` where it is not known."""
        return self.torque_max or BRAKE_PEAK * self.holds

    @property
    def holds(self) -> float:
        """What it holds at rest, N m."""
        return self.static_torque or self.torque

    @model_validator(mode="after")
    def _most_is_more(self) -> HoldingBrake:
        for most in ("torque_max", "static_torque"):
            given = getattr(self, most)
            if given is not None and given < self.torque:
                raise ValueError(
                    f"{most} {given:g} N m is less than torque {self.torque:g} N m: `torque` is "
                    "the least that it holds"
                )
        return self
