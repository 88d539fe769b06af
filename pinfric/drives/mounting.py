"""How a robot is mounted, by its scene's gravity: standing, hanging, on a wall, tilted."""

from __future__ import annotations

import numpy as np

from pinfric.model.scene import Scene

#: Degrees; less than this off an axis is along it.
_ALONG = 1.0


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


def mounted(scene: Scene, every: bool) -> str:
    """Return a sentence: how the robot is mounted, and that drives are for `every` mounting."""
    more = "; drives and brakes are chosen for all six ways, brakes and stops printed for this one"
    return f"The robot is mounted {mounting(scene)}, as the scene's gravity says{more * every}."


def mountings(scene: Scene) -> dict[str, list[float]]:
    """Return gravity (m/s^2) along each axis of the base, both ways, by its words.

    The one that the scene has is left out.
    """
    own = np.asarray(scene.model.gravity.linear)
    size, found = float(np.linalg.norm(own)), {}
    for axis, name in enumerate("xyz"):
        for sign in (-1.0, 1.0):
            gravity = np.zeros(3)
            gravity[axis] = sign * size
            if not np.allclose(gravity, own, atol=1e-9 * size):
                found[f"gravity along {'-' if sign < 0 else '+'}{name}"] = gravity.tolist()
    return found
