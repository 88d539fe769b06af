"""Where velocities pass through zero between two samples of a motion."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.samples.motion_kernels import mark_reversals
from pinfric.dynamics.samples.threaded import reversals_in_parts, team


def reversals(velocity: np.ndarray, stick_velocity: np.ndarray, threads: int = 1) -> np.ndarray:
    """Return the samples (T, ns) next to which a velocity changes sign.

    Of the two around a sign change, the slower (the earlier if equal). None where one of them
    sticks: its interval covers the passage.

    Args:
        velocity: (T, ns), rad/s or m/s.
        stick_velocity: (ns,), rad/s or m/s.
    """
    marked = np.zeros(velocity.shape, dtype=bool)
    if threads == 1:
        mark_reversals(velocity, stick_velocity, marked)
    else:
        with team(threads) as parts:
            reversals_in_parts(parts, velocity, stick_velocity, marked)
    return marked
