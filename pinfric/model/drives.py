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

from dataclasses import dataclass

import numpy as np

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
    eta = transmission.efficiency
    eta_back = 1.0 if transmission.back_efficiency is None else transmission.back_efficiency
    r = transmission.ratio
    no_load = transmission.no_load_torque * abs(r)
    ends = np.stack([effort_lower, effort_upper])
    # upper is convex in t and lower concave, and neither is monotone in a self-locking gear:
    # the outer ends lie at an end of the effort's interval, the inner ones where it is nearest to 0
    inner = np.clip(0.0, effort_lower, effort_upper)
    forward = np.maximum(ends / eta, eta_back * ends).max(axis=0) + no_load
    backward = np.minimum(ends / eta, eta_back * ends).min(axis=0) - no_load
    forward_inner = np.maximum(ends / eta, eta_back * ends).min(axis=0)
    backward_inner = np.minimum(ends / eta, eta_back * ends).max(axis=0)
    forward_least = np.minimum(forward_inner, np.maximum(inner / eta, eta_back * inner)) + no_load
    backward_most = np.maximum(backward_inner, np.minimum(inner / eta, eta_back * inner)) - no_load
    still = at_rest | (np.abs(velocity) <= stick_velocity)
    least = np.where(still | (velocity < 0), backward, forward_least)
    greatest = np.where(still | (velocity > 0), forward, backward_most)
    motor_side = r * (
        transmission.motor_viscous * velocity + transmission.rotor_inertia * acceleration
    )
    torques = least / r + motor_side, greatest / r + motor_side
    return np.minimum(*torques), np.maximum(*torques)
