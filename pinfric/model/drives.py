"""Drives: which degree of freedom each actuator moves, and what its transmission does to torque.

`effort` is what the drive delivers at the joint, `motor_torque` what its motor must give at its
shaft. With t = effort, ratio r and no-load torque n (at the motor, so n|r| at the joint), the
motor's torque times r is

    moving forward    upper(t) = max(t/eta, eta_b t) + n|r|
    moving backward   lower(t) = min(t/eta, eta_b t) - n|r|
    at standstill     anything from the least lower(t) to the greatest upper(t) over the efforts t

plus r^2 viscous v and r^2 J_rotor a, which do not pass through the loss. eta_b <= 0 is a
self-locking gear: the load alone never moves it, so the motor must push to lower it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pinfric.model.compiled import kernel
from pinfric.model.schema import Transmission


@dataclass(frozen=True)
class Drive:
    """One actuator on one joint.

    Attributes:
        name: the actuator's own name, else its joint's.
        velocity_index: the column of v it moves.
        transmission: None for an ideal drive of ratio 1 (motor torque = effort).
        share: w of the sum of effort^2 / w that redundant drives make least; None: not said.
    """

    name: str
    velocity_index: int
    transmission: Transmission | None = None
    share: float | None = None


class Gears(NamedTuple):
    """Transmissions as arrays for kernels; an ideal drive has ratio 1 and loses nothing.

    Attributes:
        ratio, efficiency, back_efficiency: (na,).
        no_load: (na,) no-load torque at the joint (N m or N).
        viscous, rotor_inertia: (na,) at the motor's shaft (N m s/rad, kg m^2).
        stick_velocity: (na,) at or below this speed the joint stands still (rad/s or m/s).
    """

    ratio: np.ndarray
    efficiency: np.ndarray
    back_efficiency: np.ndarray
    no_load: np.ndarray
    viscous: np.ndarray
    rotor_inertia: np.ndarray
    stick_velocity: np.ndarray


def gear_table(
    transmissions: Sequence[Transmission | None], stick_velocity: Sequence[float]
) -> Gears:
    """Return the transmissions of drives, and their joints' stick velocities, as arrays."""
    rows = []
    for gear, stick in zip(transmissions, stick_velocity, strict=True):
        gear = Transmission(ratio=1.0) if gear is None else gear
        back = 1.0 if gear.back_efficiency is None else gear.back_efficiency
        rows.append((gear.ratio, gear.efficiency, back, gear.no_load_torque * abs(gear.ratio),
                     gear.motor_viscous, gear.rotor_inertia, stick))  # fmt: skip
    return Gears(*np.array(rows, dtype=float).reshape(-1, len(Gears._fields)).T.copy())


@kernel
def write_motor_torques(
    gears: Gears,
    effort_lower: np.ndarray,
    effort_upper: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    at_rest: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> None:
    """Write the least and greatest motor torque (n, na) of each drive; see the module's text.

    Args:
        gears: `gear_table`.
        effort_lower ... at_rest: (n, na), see `motor_torque_bounds`.
        lower, upper: (n, na), overwritten; NaN where the efforts are.
    """
    for i in range(lower.shape[0]):
        for d in range(lower.shape[1]):
            low, high, v = effort_lower[i, d], effort_upper[i, d], velocity[i, d]
            if low != low or high != high:
                lower[i, d] = upper[i, d] = np.nan
                continue
            eta, back, no_load = gears.efficiency[d], gears.back_efficiency[d], gears.no_load[d]
            # upper(t) is convex and lower(t) concave, and neither is monotone in a self-locking
            # gear: the outer ends lie at an end of the effort's interval, the inner ones where it
            # is nearest to 0
            inner = min(max(0.0, low), high)
            forward_low, forward_high = max(low / eta, back * low), max(high / eta, back * high)
            backward_low, backward_high = min(low / eta, back * low), min(high / eta, back * high)
            still = at_rest[i, d] or abs(v) <= gears.stick_velocity[d]
            if still or v < 0.0:
                least = min(backward_low, backward_high) - no_load
            else:
                nearest = max(inner / eta, back * inner)
                least = min(forward_low, forward_high, nearest) + no_load
            if still or v > 0.0:
                greatest = max(forward_low, forward_high) + no_load
            else:
                nearest = min(inner / eta, back * inner)
                greatest = max(backward_low, backward_high, nearest) - no_load
            r = gears.ratio[d]
            motor_side = r * (gears.viscous[d] * v + gears.rotor_inertia[d] * acceleration[i, d])
            ends = least / r + motor_side, greatest / r + motor_side
            lower[i, d], upper[i, d] = min(ends[0], ends[1]), max(ends[0], ends[1])


def motor_torque_bounds(
    transmission: Transmission,
    effort_lower: np.ndarray,
    effort_upper: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    at_rest: np.ndarray,
    stick_velocity: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and greatest motor torque (N m at the motor's shaft) of each sample.

    T_m = [lower(t) or upper(t)]/r + r viscous v + r J_rotor a (see the module's text).

    Args:
        transmission: ratio, efficiencies and the motor-side losses.
        effort_lower, effort_upper: (T,) N m or N at the joint.
        velocity, acceleration: (T,) of the joint (rad/s or m/s, and per second).
        at_rest: (T,) True where the joint comes to rest between two samples.
        stick_velocity: at or below this speed the joint stands still (rad/s or m/s).
    """
    samples = effort_lower, effort_upper, velocity, acceleration, at_rest
    lower, upper = np.empty((2, len(effort_lower), 1))
    columns = (np.ascontiguousarray(given)[:, None] for given in samples)
    write_motor_torques(gear_table([transmission], [stick_velocity]), *columns, lower, upper)
    return lower[:, 0], upper[:, 0]
