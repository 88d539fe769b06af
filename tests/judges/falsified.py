"""Six situations, and falsifications of their results."""

from dataclasses import replace
from functools import partial

import numpy as np
from builders import plane_friction, sliding_block
from cases import (
    Case,
    decelerating_drawer,
    jamming_drawer,
    resting_four_bar,
    rocker_driven_four_bar,
    turning_four_bar,
)

EFFORTS = ("effort_lower", "effort_upper", "motor_torque_lower", "motor_torque_upper")
NOTHING = dict.fromkeys(
    (*EFFORTS, "friction_lower", "friction_upper", "normal_load", "wrench", "multipliers"), np.nan
)
#: What is falsified, and to what.
FALSE = {
    **dict.fromkeys(
        (*NOTHING, "effort_frictionless"), lambda x: np.where(np.isnan(x), 1.0, np.nan)
    ),
    "actuator_velocity": lambda x: x + 1e-6,
    "actuator_acceleration": lambda x: x + 1e-3,
    "contraction": lambda x: 0.5 * x if x else x + 0.1,
    "interval_exact": np.logical_not,
    "interval_searched": np.logical_not,
    "sticking": np.logical_not,
}
SITUATIONS = {
    "jammed": partial(jamming_drawer, 0.6, 1.0),
    # a force along the fixed direction in which the link's end cannot move
    "singular": partial(rocker_driven_four_bar, np.zeros(1)),
    "ambiguous": decelerating_drawer,
    "turning": partial(turning_four_bar, 3),
    "resting": partial(resting_four_bar, 2),
    "tree": lambda: Case(sliding_block(plane_friction(0.5, 0.3)), *np.ones((3, 1, 1))),
}


def falsified(found, name):
    """Return the result with a false field at the first sample; None if it has no such field."""
    values = getattr(found, name)
    if values is None or not values[0].size:
        return None
    values = values.copy()  # some are the motion's own arrays
    values[0] = FALSE[name](values[0])
    return replace(found, **{name: values})
