"""One drive at one joint, as the rows of `limits` read it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pinfric.drives.demand import largest
from pinfric.drives.drivetrain import (
    Candidate,
    MotorCycle,
    amplifier_torque,
    braking_torque,
    line_voltage,
)
from pinfric.drives.limit import (
    GEAR_FIGURES,
    MOTOR_FIGURES,
    Candidates,
    Figures,
    JointCase,
    figure_of,
    number,
)
from pinfric.motions.summary import ends_by_magnitude

#: What the cycle asks of a motor of which nothing is known.
_NOTHING_ASKED = (
    *("peak", "rms", "mean_speed", "short_term", "overloaded_standstill", "standing"),
    *("peak_temperature", "mean_temperature", "voltage", "overdriven", "braking", "pull_out"),
    "hot",
)


def read_drive(candidate: Candidate, motor: MotorCycle | None, case: JointCase) -> Candidates:
    """Return one drive as rows read it.

    Args:
        motor: the cycle at its rated shaft; None where figures for its torque are missing.
    """
    ratings, conditions = candidate.ratings, case.conditions
    asked = Figures(**dict.fromkeys(_NOTHING_ASKED, np.nan), figures=None)
    asked.mean_speed = np.inf  # a curve's last point counts
    if motor is not None:
        words = "holding", "current_kind"
        figures = {k: number(v) for k, v in vars(motor.figures).items() if k not in words}
        asked = Figures(**vars(asked) | figures | {"figures": motor.figures})
        needed = line_voltage(ratings, motor)
        asked.voltage = np.nan if needed is None else largest(needed)
        worst = ends_by_magnitude(motor.torque_lower, motor.torque_upper)[0]
        if (own := ratings.special) is not None:
            asked.pull_out = own.share(worst, motor.speed, case.cycle.standing, conditions)
        limit, _ = amplifier_torque(candidate, "continuous_current")
        if limit is not None:
            asked.overdriven = case.cycle.longest_above(worst, limit)
    if candidate.transmission is not None and case.braking:
        asked.braking = max(braking_torque(candidate, cycle) for cycle in case.braking)
    gear = _numbers(candidate.gear, GEAR_FIGURES)
    gear.backlash = number(candidate.backlash)
    if candidate.gear is None:  # a gearmotor has some of a gear's figures
        gear.stiffness = figure_of(candidate.transmission, "stiffness")
    return Candidates(
        gear,
        _numbers(ratings, MOTOR_FIGURES),
        candidate.ratio,
        number(candidate.rotor_inertia),
        number(ratings.continuous_at(conditions, asked.mean_speed)[0]),
        candidate.at_output,
        candidate.linear,
        case,
        asked,
        candidate,
        candidate.voltage_share(conditions),
        None if ratings.special is None else type(ratings.special),
    )


def _numbers(entry: Any, figures: Iterable[str]) -> Figures:
    return Figures(**{name: figure_of(entry, name) for name in figures})
