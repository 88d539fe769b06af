"""Kernels of inverse dynamics that look at motion and efforts: reversals, ends of efforts."""

from __future__ import annotations

import numpy as np

from pinfric.kernels.compiled import kernel


@kernel
def mark_reversals(velocity: np.ndarray, stick_velocity: np.ndarray, marked: np.ndarray) -> None:
    """Set the samples that `reversals` describes in `marked` (T, ns)."""
    for i in range(velocity.shape[0] - 1):
        for s in range(velocity.shape[1]):
            now, then = velocity[i, s], velocity[i + 1, s]
            if (now > 0.0) == (then > 0.0):
                continue
            if abs(now) > stick_velocity[s] and abs(then) > stick_velocity[s]:
                marked[i if abs(now) <= abs(then) else i + 1, s] = True


@kernel
def effort_bounds(
    frictionless: np.ndarray,
    friction_lower: np.ndarray,
    friction_upper: np.ndarray,
    velocity_index: np.ndarray,
    ratio: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> None:
    """Write the least and greatest effort u = tau_id - D phi over each sample's friction.

    Args:
        frictionless: (n, nv), tau_id.
        friction_lower, friction_upper: (n, ns).
        velocity_index, ratio: (ns,), the site's column of D: `ratio` at its degree of freedom.
        lower, upper: (n, nv), overwritten.
    """
    for i in range(frictionless.shape[0]):
        for c in range(frictionless.shape[1]):
            lower[i, c] = frictionless[i, c]
            upper[i, c] = frictionless[i, c]
        for s in range(ratio.size):
            c, r = velocity_index[s], ratio[s]
            if r >= 0.0:
                lower[i, c] -= r * friction_upper[i, s]
                upper[i, c] -= r * friction_lower[i, s]
            else:
                lower[i, c] -= r * friction_lower[i, s]
                upper[i, c] -= r * friction_upper[i, s]
