"""How a robot is mounted, by its scene's gravity: standing, hanging, on a wall, tilted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinfric.errors import SizingError
from pinfric.model.brief import file_name
from pinfric.model.robot import changed_parts
from pinfric.model.scene import Scene

#: Degrees; less than this off an axis is along it.
_ALONG = 1.0
#: What scenes of one robot have in common, beside its model.
_SAME = ("friction", "payloads", "actuators", "loops", "springs", "masses", "stops")


def mounting(scene: Scene) -> str:
    """Return how a robot is mounted, in words, if its base's z axis points away from its foot."""
    gravity = np.asarray(scene.model.gravity.linear)
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return "without gravity"
    tilt = float(np.degrees(np.arccos(np.clip(-gravity[2] / size, -1.0, 1.0))))
    for angle, words in ((0.0, "standing"), (90.0, "on a wall"), (180.0, "hanging")):
        if abs(tilt - angle) <= _ALONG:
            return words
    return f"tilted by {tilt:.3g} degrees"


def mounted(scene: Scene, every: bool, elsewhere: Sequence[str] = ()) -> str:
    """Say how the robot is mounted, and for which other mountings drives are.

    Args:
        scene: as it is mounted. every: whether drives are for all six ways.
        elsewhere: scenes in which it is mounted otherwise, for which drives are, too.
    """
    others = ["all six ways"] * every + list(elsewhere)
    printed = "demand, bus, brakes" if elsewhere else "brakes"
    more = (
        f"; drives and brakes are chosen for {', '.join(others)}{' as well' * bool(elsewhere)}, "
        f"{printed} and stops printed for this one"
    )
    told = more * bool(others)
    return f"The robot is mounted {mounting(scene)}, as the scene's gravity says{told}."


def turned_as(scene: Scene, other: Scene) -> str:
    """Return the name of another scene, in which the same robot is mounted otherwise.

    Raises:
        SizingError: more than gravity differs, or nothing.
    """
    ours, name = file_name(scene.source), file_name(other.source)
    differs = changed_parts(other.model, scene.model)
    differs += [key for key in _SAME if getattr(other, key) != getattr(scene, key)]
    if other.joint_names != scene.joint_names:
        differs = ["joints"]
    if differs != ["gravity"]:
        what = ", ".join(part for part in differs if part != "gravity") or "gravity is the same"
        raise SizingError(
            f"{name}: should be {ours} with another gravity and nothing else, found: {what}; copy "
            f"{ours} and change robot.gravity alone"
        )
    return name


def mountings(scene: Scene) -> dict[str, list[float]]:
    """Return gravity (m/s^2) along each axis of the base, both ways, by words.

    The scene's own is left out.
    """
    own = np.asarray(scene.model.gravity.linear)
    size, turned = float(np.linalg.norm(own)), {}
    for axis, name in enumerate("xyz"):
        for sign in (-1.0, 1.0):
            gravity = np.zeros(3)
            gravity[axis] = sign * size
            if not np.allclose(gravity, own, atol=1e-9 * size):
                turned[f"gravity along {'-' if sign < 0 else '+'}{name}"] = gravity.tolist()
    return turned
