"""Which amplifier of a catalogue feeds the motor of a drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pinfric.drives.catalog import Amplifier
from pinfric.drives.criterion import Status
from pinfric.drives.drivetrain import PER_DC_AMPERE, Candidate, MotorCycle, motor_cycle
from pinfric.drives.limit import JointCase
from pinfric.drives.limits import LIMITS
from pinfric.drives.reading import read_drive

#: How the rows of `LIMITS` that judge an amplifier begin.
_ROWS = "amplifier "


def amplifier_of(
    candidate: Candidate, cases: Sequence[JointCase], amplifiers: Mapping[str, Amplifier]
) -> tuple[str, str]:
    """Return the name of a drive's amplifier, else why there is none.

    By `conditions.amplifiers`; else that of the catalogue with the smallest continuous current of
    which every row passes in every case: bus voltage, peak and continuous current, and the time
    between them. A figure that is not printed passes nothing.

    Args:
        candidate: a drive with a motor. cases: of its joint.
    """
    if (named := candidate.amplifier) is not None:
        return next(name for name, amplifier in amplifiers.items() if amplifier is named), ""
    if candidate.ratings.special is not None:
        return "", candidate.ratings.special.UNFED
    if candidate.transmission is None or candidate.ratings.torque_constant is None:
        return "", "no torque constant"
    motors = [(motor_cycle(candidate, case.cycle, case.conditions), case) for case in cases]
    for name in sorted(amplifiers, key=lambda name: _size(amplifiers[name])):
        if _feeds(replace(candidate, amplifier=amplifiers[name]), motors):
            return name, ""
    return "", "no amplifier of the catalogue fits"


def _size(amplifier: Amplifier) -> float:
    """The continuous current of an equivalent DC motor, A."""
    if (current := amplifier.continuous_current) is None:
        return float("inf")
    return current / PER_DC_AMPERE[amplifier.current]


def _feeds(candidate: Candidate, motors: Sequence[tuple[MotorCycle, JointCase]]) -> bool:
    """Whether all rows of a drive's amplifier pass."""
    for motor, case in motors:
        drive = read_drive(candidate, motor, case)
        rows = [limit for limit in LIMITS if limit.name.startswith(_ROWS) and limit.concerns(drive)]
        if any(limit.judge(drive).status != Status.PASSES for limit in rows):
            return False
    return True
