"""From the wrenches of an open chain to the ends of its efforts, and its reversals.

wrench -> load c -> friction phi -> effort u = tau_id - D phi     (paper eq. 16, 17, 20-22)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.kernels.compiled import inlined_kernel, kernel
from pinfric.model.bearings import normal_loads
from pinfric.model.laws import friction_bounds
from pinfric.model.scene import SiteTables


class TreeSamples(NamedTuple):
    """Samples of an open chain: motion of its sites, and results as in `InverseResult`.

    Attributes:
        velocity, reversal: (n, ns) of the sites.
        displacement: (n, ns) along their axes, or (0, 0) where no load depends on it.
        effort_frictionless, effort_lower, effort_upper: (n, nv) of the joints.
        normal_load, friction_lower, friction_upper, sticking: (n, ns).
    """

    velocity: np.ndarray
    reversal: np.ndarray
    displacement: np.ndarray
    effort_frictionless: np.ndarray
    effort_lower: np.ndarray
    effort_upper: np.ndarray
    normal_load: np.ndarray
    friction_lower: np.ndarray
    friction_upper: np.ndarray
    sticking: np.ndarray


@inlined_kernel
def part_of(x: TreeSamples, i: int, j: int) -> TreeSamples:
    """Return the samples i to j."""
    return TreeSamples(
        x.velocity[i:j],
        x.reversal[i:j],
        x.displacement[i:j],
        x.effort_frictionless[i:j],
        x.effort_lower[i:j],
        x.effort_upper[i:j],
        x.normal_load[i:j],
        x.friction_lower[i:j],
        x.friction_upper[i:j],
        x.sticking[i:j],
    )


def bound_efforts(sites: SiteTables, wrench: np.ndarray, x: TreeSamples) -> None:
    """Write loads, friction and the ends of efforts; within kernels, `bound_within`.

    Args:
        sites: `Scene.site_tables`; `joint` is the row of each site's wrench.
        wrench: (n, rows, 6) parent on child; any, where no load depends on wrenches.
        x: whose `effort_frictionless` is known.
    """
    lower, upper = x.friction_lower, x.friction_upper
    normal_loads(wrench, sites.joint, sites.contacts, x.displacement, x.normal_load)
    friction_bounds(x.velocity, x.normal_load, sites.laws, x.reversal, lower, upper, x.sticking)
    column = sites.velocity_index, sites.ratio
    effort_bounds(x.effort_frictionless, lower, upper, *column, x.effort_lower, x.effort_upper)


bound_within = inlined_kernel(bound_efforts)


@kernel
def mark_reversals(velocity: np.ndarray, stick_velocity: np.ndarray, marked: np.ndarray) -> None:
    """Mark the samples of `reversals` in `marked` (T, ns)."""
    for i in range(velocity.shape[0] - 1):
        for s in range(velocity.shape[1]):
            rate, next_rate = velocity[i, s], velocity[i + 1, s]
            if (rate > 0.0) == (next_rate > 0.0):
                continue
            if abs(rate) > stick_velocity[s] and abs(next_rate) > stick_velocity[s]:
                marked[i if abs(rate) <= abs(next_rate) else i + 1, s] = True


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
