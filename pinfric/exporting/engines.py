"""What the engines that read an exported file lack, with the figure at its worst joint.

The lines stand in the file, as who simulates with it may not know its origin.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinfric.exporting.constants import JointConstants
from pinfric.model.described import INERTIA, SPEED, unit_at

_NO_DRY = "no dry friction, in motion or at rest: {drag} where the constants say {whole}"
_NONE = "Pinocchio, rnea and aba: no friction, where the constants say {whole}"
_ONLY_DRAKE = "all but Drake (drake:rotor_inertia, drake:gear_ratio): no rotor inertia, {rotor}"
#: By format: the figure that a line needs, the line.
_LINES: dict[str, tuple[tuple[str, str], ...]] = {
    "mjcf": (
        ("creep", "MuJoCo, mj_step: a joint that friction holds creeps, at its limit by {creep}"),
        ("rest", "MuJoCo, mj_inverse: no friction at rest, where the scene holds {rest}"),
    ),
    "urdf": (
        ("whole", f"Drake: {_NO_DRY}"),
        ("whole", _NONE),
        ("whole", "Isaac Sim before 5.0: takes friction, {dry}, as a coefficient without a unit"),
        ("rotor", _ONLY_DRAKE),
    ),
    "sdf": (
        ("whole", f"Drake: {_NO_DRY}"),
        ("rotor", f"Gazebo, and {_ONLY_DRAKE}"),
    ),
    "constants": (
        ("whole", f"engines that take the damping alone, as Drake: {_NO_DRY}"),
        ("whole", _NONE),
        ("rotor", "engines that take no armature, as Gazebo: no rotor inertia, {rotor}"),
        (
            "whole",
            "a controller must not add them at a measured velocity: they miss the joint's own "
            "friction by up to {error}, and what is too much drives the arm",
        ),
    ),
    "actuator": (
        (
            "whole",
            "a controller must not add them at a measured velocity: where they exceed the joint's "
            "own friction the rest drives the arm",
        ),
    ),
}


def shortfalls(
    to: str, joints: Sequence[JointConstants], rotors: np.ndarray, creep: np.ndarray
) -> tuple[str, ...]:
    """Return what the engines that read a format lack.

    Args:
        rotors: (n,) inertia of each joint's rotor, at the joint (kg m^2 or kg).
        creep: (n,) speed at which MuJoCo's joint yields under its frictionloss (rad/s or m/s).
    """
    figures: dict[str, str] = {}
    if moving := [joint for joint in joints if joint.frictionloss > 0.0]:
        worst = max(moving, key=lambda joint: joint.frictionloss)
        speed = max(map(abs, worst.speeds))
        drag, dry, at = worst.damping * speed, worst.frictionloss, f"({worst.joint}"
        figures |= {
            "drag": f"{drag:.3g} {worst.unit}",
            "whole": f"{dry + drag:.3g} {worst.unit} {at} at {speed:.3g} "
            f"{unit_at(SPEED, worst.unit)})",
            "dry": f"{dry:.3g} {worst.unit} {at})",
            "error": f"{worst.error_peak:.3g} {worst.unit} {at})",
        }
    for name, values, unit in (("rotor", rotors, INERTIA), ("creep", creep, SPEED)):
        most = int(np.argmax(values))
        if values[most] > 0.0:
            figures[name] = (
                f"{values[most]:.3g} {unit_at(unit, joints[most].unit)} ({joints[most].joint})"
            )
    if rests := [joint for joint in joints if np.isfinite(joint.rest_lower)]:
        held = max(rests, key=lambda joint: joint.rest_upper - joint.rest_lower)
        least, most_ = held.rest_lower, held.rest_upper
        figures["rest"] = f"{least:.3g} to {most_:.3g} {held.unit} beside the load ({held.joint})"
    return tuple(line.format(**figures) for need, line in _LINES[to] if need in figures)
