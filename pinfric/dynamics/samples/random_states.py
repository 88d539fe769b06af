"""Random states, where no motion is given."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinfric.errors import StateError
from pinfric.model.scene import Scene


def random_states(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return 1000 seeded states q, v, a within the limits, at up to 1 rad/s or m/s.

    Positions are within 1 rad or m of the allowed one nearest to 0.

    Raises:
        StateError: the scene has loops, which random states do not close.
    """
    if scene.linkage is not None and scene.linkage.loops:
        raise StateError(
            f"{scene.source}: random states would not close the loops; give a trajectory"
        )
    model = scene.model
    rng = np.random.default_rng(0)
    low = np.nan_to_num(model.lowerPositionLimit, nan=-1.0)
    high = np.nan_to_num(model.upperPositionLimit, nan=1.0)
    nearest = np.clip(0.0, low, high)
    low, high = np.maximum(low, nearest - 1.0), np.minimum(high, nearest + 1.0)
    speed = np.array(model.velocityLimit)
    speed = np.where(speed > 0.0, np.minimum(speed, 1.0), 1.0)
    pin.seed(0)
    q = np.array([pin.randomConfiguration(model, low, np.maximum(low, high)) for _ in range(1000)])
    v, a = rng.uniform(-1, 1, (2, 1000, model.nv))
    return q, speed * v, a
