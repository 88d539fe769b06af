"""Bounds on the figures of a machine, in SI units.

Beyond them powers and products in friction, dynamics and sizing overflow, and results would
silently be infinite or NaN.
"""

from __future__ import annotations

import numpy as np

#: Of a scene, URDF or catalogue: far beyond the largest mass, length, gear or torque there is.
LARGEST = 1e12
#: Of what divides (a length, a mass, a time): far below what can be made or measured.
SMALLEST = 1e-12
#: Of a motion (rad, m, s and rates): accelerations near a toggle grow with the speed's square.
LARGEST_OF_A_MOTION = 1e18
#: s, three centuries: a longer time is a unit error, and its time steps are lost in rounding.
LONGEST_TIME = 1e10


def impossible(array: np.ndarray, largest: float = LARGEST_OF_A_MOTION) -> np.ndarray:
    """Return a mask of values that are not finite or impossibly large."""
    return np.asarray(~(np.abs(array) <= largest))
