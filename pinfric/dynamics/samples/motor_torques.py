"""Motor torques of a motion from the efforts of the drives."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.samples.reversals import reversals
from pinfric.dynamics.samples.states import States
from pinfric.model.drives import Drive, Gears, gear_table, motor_torque_bounds
from pinfric.model.loops import OffJointDrive
from pinfric.model.scene import Scene


def motor_torques(
    scene: Scene,
    states: States,
    whole: slice,
    efforts: tuple[np.ndarray, np.ndarray],
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (T, na) least and greatest motor torque; without a gear these are the efforts.

    T_m = effort / (r efficiency) + motor_viscous + r J_rotor a, see `drives.motor_torque_bounds`.

    Args:
        scene: with the drives.
        states: of all samples.
        whole: the T samples that are asked for.
        efforts: (T, na) least, (T, na) greatest (N m or N).
        velocity, acceleration: (n, na) of what each drive moves (rad/s or m/s, and per second), of
            the samples `states.around(whole)`.
    """
    if not any(drive.transmission for drive in scene.drives):
        return efforts
    stick = np.array([drive_stick_velocity(scene, drive) for drive in scene.drives])
    at_rest = np.zeros(velocity.shape, dtype=bool)
    if states.t is not None:
        at_rest = reversals(velocity, stick)
    inner = states.inside(whole)
    lower, upper = (ends.copy() for ends in efforts)
    for d, drive in enumerate(scene.drives):
        if drive.transmission is not None:
            lower[:, d], upper[:, d] = motor_torque_bounds(
                drive.transmission,
                lower[:, d],
                upper[:, d],
                velocity[inner, d],
                acceleration[inner, d],
                at_rest[inner, d],
                stick[d],
            )
    return lower, upper


def scene_gears(scene: Scene) -> Gears:
    """Return the transmissions of a scene's drives, and their closed brakes, as arrays."""
    stick = [drive_stick_velocity(scene, drive) for drive in scene.drives]
    closed = [scene.closed_brakes.get(drive.name, 0.0) for drive in scene.drives]
    return gear_table([drive.transmission for drive in scene.drives], stick, closed)


def drive_stick_velocity(scene: Scene, drive: Drive) -> float:
    """Return the stick velocity of the drive's site, else the scene's default."""
    moved = drive.name
    if isinstance(drive, OffJointDrive) and scene.linkage is not None:
        pair = int(scene.linkage.column_pair[drive.column])
        moved = scene.loops[pair].name if pair < len(scene.loops) else moved
    for site in scene.sites:
        joint = site.velocity_index == drive.velocity_index >= 0 and site.ratio == 1.0
        if joint or site.name == moved:
            return site.law.stick_velocity
    return scene.stick_velocity
