"""Random states, used if no motion is given."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinfric.errors import StateError
from pinfric.model.scene import Scene


def random_states(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return 1000 seeded states q, v, a inside the position limits, at up to 1 rad/s or m/s.

    Raises:
        StateError: the scene has loops, which random states do not close.
    """
    if scene.linkage is not None:
        raise StateError(
            f"{scene.source}: random states would not close its loops; give a trajectory"
        )
    model = scene.model
    rng = np.random.default_rng(0)
    low = np.clip(np.nan_to_num(model.lowerPositionLimit, neginf=-1.0), -1.0, 1.0)
    high = np.clip(np.nan_to_num(model.upperPositionLimit, posinf=1.0), -1.0, 1.0)
    pin.seed(0)
    q = np.array([pin.randomConfiguration(model, low, np.maximum(low, high)) for _ in range(1000)])
    v, a = rng.uniform(-1, 1, (2, 1000, model.nv))
    return q, v, a
