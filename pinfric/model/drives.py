"""Drives: which degree of freedom each actuator moves, and what its transmission does to torque.

`effort` is what the drive delivers at the joint, `motor_torque` what its motor must give at its
shaft. With t = effort, ratio r and no-load torque n (at the motor, so n|r| at the joint), the
motor's torque times r is

    moving forward    upper(t) = max(t/eta, eta_b t) + n|r|
    moving backward   lower(t) = min(t/eta, eta_b t) - n|r|
    at standstill     anything from the least lower(t) to the greatest upper(t) over the efforts t

plus r^2 viscous v and r^2 J_rotor a, which do not pass through the loss; at standstill with the
no-load torque that it takes to leave rest. eta_b <= 0 is a self-locking gear: the load alone never
moves it, so the motor must push to lower it.
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
        name: the actuator's name: its joint's, with an index where a joint has several.
        velocity_index: the column of v it moves.
        transmission: None for an ideal drive of ratio 1 (motor torque = effort).
    """

    name: str
    velocity_index: int
    transmission: Transmission | None = None


class Gears(NamedTuple):
    """Transmissions as arrays for kernels; an ideal drive has ratio 1 and loses nothing.

    Attributes:
        ratio, efficiency, back_efficiency: (na,).
        no_load, no_load_static: (na,) no-load torque at the joint, in motion and at rest (N m or
            N).
        viscous, rotor_inertia: (na,) at the motor's shaft (N m s/rad, kg m^2).
        stick_velocity: (na,) at or below this speed the joint stands still (rad/s or m/s).
    """

    ratio: np.ndarray
    efficiency: np.ndarray
    back_efficiency: np.ndarray
    no_load: np.ndarray
    no_load_static: np.ndarray
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
        no_load = gear.no_load_torque * abs(gear.ratio)
        rows.append((gear.ratio, gear.efficiency, back, no_load, no_load, gear.motor_viscous,
                     gear.rotor_inertia, stick))  # fmt: skip
    return Gears(*np.array(rows, dtype=float).reshape(-1, len(Gears._fields)).T.copy())


@kernel
def gear_line(
    gears: Gears, d: int, direction: float, speed: float, static: bool, effort: float
) -> tuple[float, float, float, float]:
    """Return the line that a gear follows around an effort, and where it does.

    What arrives at the gear, u = r (T_m - J_rotor r a) - drag, is F(t) = slope t + offset: upper(t)
    in forward motion, lower(t) in backward motion (see the module's text), piecewise linear in t.

    Args:
        gears: `gear_table`.
        d: the drive.
        direction: of the joint's motion, 1 or -1.
        speed: of the joint (rad/s or m/s).
        static: True for what it takes to leave rest.
        effort: t (N m or N); where two lines meet, the one above is returned.

    Returns:
        (slope, offset, least, greatest): the line holds for efforts from least to greatest.
    """
    offset = direction * (gears.no_load_static[d] if static else gears.no_load[d])
    drives = direction * effort > 0.0 or (effort == 0.0 and direction > 0.0)
    slope = 1.0 / gears.efficiency[d] if drives else gears.back_efficiency[d]
    if drives == (direction > 0.0):
        return slope, offset, 0.0, np.inf
    return slope, offset, -np.inf, 0.0


@kernel
def gear_drag(gears: Gears, d: int, velocity: float) -> float:
    """Return the torque that the motor's viscous friction takes, at the joint: r^2 viscous v.

    Args:
        gears, d: see `gear_line`.
        velocity: of the joint (rad/s or m/s).
    """
    return gears.ratio[d] ** 2 * gears.viscous[d] * velocity


@kernel
def gear_slips(
    gears: Gears, d: int, direction: float, static: bool, given: float
) -> tuple[float, float]:
    """Return the efforts between which a gear at rest slips: upper(t) < u, or lower(t) > u.

    Args:
        gears, d, direction, static: see `gear_line`.
        given: u = r T_m (N m or N at the joint).

    Returns:
        (least, greatest), (inf, -inf) where it slips at none: a self-locking gear, little driven.
    """
    least, greatest = np.inf, -np.inf
    start = -np.inf
    while start < np.inf:
        slope, offset, first, last = gear_line(gears, d, direction, 0.0, static, start)
        rise, spare = direction * slope, direction * (given - offset)
        if rise > 0.0:
            low, high = first, min(last, spare / rise)
        elif rise < 0.0:
            low, high = max(first, spare / rise), last
        else:
            low, high = first, last if spare > 0.0 else first
        if low < high:
            least, greatest = min(least, low), max(greatest, high)
        start = last
    return least, greatest


@kernel
def _gear_range(
    gears: Gears, d: int, direction: float, speed: float, static: bool, low: float, high: float
) -> tuple[float, float]:
    """Least and greatest F(t), t from low to high: at the ends of its lines."""
    slope, offset, _, last = gear_line(gears, d, direction, speed, static, low)
    least = greatest = slope * low + offset
    while last < high:
        value = slope * last + offset
        least, greatest = min(least, value), max(greatest, value)
        slope, offset, _, last = gear_line(gears, d, direction, speed, static, last)
    value = slope * high + offset
    return min(least, value), max(greatest, value)


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

    Neither upper(t) nor lower(t) is monotone in a self-locking gear: both are taken over the whole
    interval of efforts.

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
            if at_rest[i, d] or abs(v) <= gears.stick_velocity[d]:
                least, _ = _gear_range(gears, d, -1.0, abs(v), True, low, high)
                _, greatest = _gear_range(gears, d, 1.0, abs(v), True, low, high)
            else:
                way = 1.0 if v > 0.0 else -1.0
                least, greatest = _gear_range(gears, d, way, abs(v), False, low, high)
            r = gears.ratio[d]
            motor_side = r * gears.rotor_inertia[d] * acceleration[i, d]
            motor_side += gear_drag(gears, d, v) / r
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
