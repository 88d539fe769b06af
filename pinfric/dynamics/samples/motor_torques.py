"""Motor torques of a motion from the efforts of the drives."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.samples.presliding import BuiltUp, build_up_torques
from pinfric.dynamics.samples.reversals import reversals
from pinfric.dynamics.samples.states import States
from pinfric.model.couples import taking_part
from pinfric.model.drives import write_motor_torques
from pinfric.model.scene import Scene


def motor_torques(
    scene: Scene,
    states: States,
    whole: slice,
    efforts: tuple[np.ndarray, np.ndarray],
    velocity: np.ndarray,
    acceleration: np.ndarray,
    built: BuiltUp | None = None,
    at_ends: tuple[np.ndarray, ...] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (T, na) least and greatest motor torque; without a gear these are the efforts.

    T_m = effort / (r efficiency) + motor_viscous + r J_rotor a, see `drives.motor_torque_bounds`.

    Args:
        scene: its closed brakes do not count.
        states: of all samples. whole: the T samples of the result.
        efforts: (T, na) least, (T, na) greatest (N m or N).
        velocity, acceleration: (n, na) of what each drive moves (rad/s or m/s, and per second), of
            the samples `states.around(whole)`.
        built, at_ends: of the T samples where friction builds up, and (T, na) efforts with the
            joints' friction built up in full in either direction.
    """
    if not any(drive.transmission for drive in scene.drives):
        return efforts
    gears, inner = scene.gears(brakes=False), states.inside(whole)
    at_rest = np.zeros(velocity.shape, dtype=bool)
    if states.t is not None:
        at_rest = reversals(velocity, gears.stick_velocity)
    lower, upper = (np.ascontiguousarray(ends) for ends in efforts)
    torques = np.empty_like(lower), np.empty_like(upper)
    motion = velocity[inner], acceleration[inner], at_rest[inner]
    write_motor_torques(gears, lower, upper, *motion, *torques)
    if built is not None and at_ends is not None:
        ways, coupled = scene.ways, np.zeros(len(scene.drives), dtype=bool)
        assert ways is not None
        coupled[taking_part(scene.drives)] = True
        build_up_torques(
            gears,
            ways.way[ways.of_drive] > 0.0,
            coupled,
            (built.drive_lower, built.drive_upper),
            (lower, upper, *at_ends),
            motion,
            torques,
        )
    return torques
