"""Hobby servos: gearmotors of which only the stall torque is printed, and what it says of heat."""

from __future__ import annotations

from collections.abc import Sequence

from pinfric.drives.criterion import Criterion
from pinfric.model.brief import rounded_up

#: Of its stall torque: what it bears for ever (ROBOTIS, Torque Ratings, 2020).
HOBBY = 0.2
#: Rows of its heat, all of its continuous torque.
HEAT = ("continuous torque", "short-term torque", "overloaded standstill", "standstill")


def is_servo(entry: object) -> bool:
    """Return whether a gear or gearmotor is one: its continuous torque is of its stall torque."""
    of_a_kind = getattr(entry, "special", None) is not None  # which has no torques of its own
    return not of_a_kind and getattr(entry, "continuous_torque", 0.0) is None  # gears have none


def continuous_torque(stall_torque: float) -> tuple[float, str]:
    """Return what stands for its continuous torque, N m or N, and how it was found."""
    text = f"{HOBBY:g} x the stall torque, by rule (ROBOTIS, Torque Ratings, 2020)"
    return HOBBY * stall_torque, text


def asked_heat(criteria: Sequence[Criterion]) -> str:
    """Say what its continuous torque must be, and whether it runs hot.

    Args:
        criteria: of one at its joint, all that apply.
    """
    heat = next(c for c in criteria if c.name == HEAT[0])
    need, has = heat.required or 0.0, heat.available or 0.0
    hot = ", so it runs hot: needs pauses" * any(c.fails and c.name in HEAT for c in criteria)
    return (
        f"continuous torque >= {rounded_up(need)} {heat.unit} (taken: {HOBBY:g} of its stall "
        f"torque, {has:.3g} {heat.unit}{hot})"
    )
