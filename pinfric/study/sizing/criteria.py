"""The one table of a drive's limits: `size`, `sweep` and `retime` read it.

A row says what a cycle needs, what the maker gives (in order of preference: a lower limit that is
printed stands in for one that is not), the formula and its source. What a missing figure means is
in the row, too: a row is *not checked* without it, and a drive of which nothing settles one of the
`SETTLES` *cannot be checked*.

`size` takes the needs of a whole cycle, `sweep` those of every sample of its own, `retime` bounds
each instant of a motion by the rows whose need is one of `SIGNALS`.
"""

from __future__ import annotations

from collections.abc import Sequence

from pinfric.errors import SizingError, choose_from
from pinfric.study.sizing.bearing_limits import BEARING_LIMITS
from pinfric.study.sizing.criterion import Criterion, Status
from pinfric.study.sizing.drivetrain import Candidate, MotorCycle
from pinfric.study.sizing.gear_limits import GEAR_LIMITS
from pinfric.study.sizing.joint_limits import GEAR_RESONANCE, JOINT_LIMITS
from pinfric.study.sizing.limit import SETTLES, SIGNALS, Case, Judged, Limit
from pinfric.study.sizing.motor_limits import MOTOR_LIMITS
from pinfric.study.sizing.stop_limits import STOP_LIMITS

#: The table.
LIMITS: list[Limit] = [*MOTOR_LIMITS, *GEAR_LIMITS, *BEARING_LIMITS, *JOINT_LIMITS, *STOP_LIMITS]


def check(candidate: Candidate, motor: MotorCycle | None, case: Case) -> tuple[Criterion, ...]:
    """Return every criterion of a candidate, in the order of the table.

    Args:
        candidate: motor and gear.
        motor: of `motor_cycle`; None where figures for the motor's torque are missing.
        case: its joint.
    """
    judged = Judged(candidate, motor, case)
    return tuple(limit.judge(judged) for limit in LIMITS if limit.applies(judged))


def gear_limits() -> list[Limit]:
    """Return the rows that depend on gear and joint alone."""
    names = {limit.name for limit in (*GEAR_LIMITS, *BEARING_LIMITS, GEAR_RESONANCE)}
    return [limit for limit in LIMITS if limit.name in names]


def motor_limits() -> list[Limit]:
    """Return the rows of motors that need no look at the cycle's samples."""
    names = ("bus voltage", "motor voltage", "motor speed")
    return [limit for limit in LIMITS if limit.name in names]


def continuous_limit() -> Limit:
    """Return the row of the continuous torque."""
    return next(limit for limit in MOTOR_LIMITS if limit.name == "continuous torque")


def failing(limits: Sequence[Limit], candidate: Candidate, case: Case) -> tuple[Criterion, ...]:
    """Return the criteria of these rows that a candidate fails.

    Args:
        limits: of `gear_limits` or `motor_limits`. candidate: motor and gear. case: its joint.
    """
    judged = Judged(candidate, None, case)
    found = (limit.judge(judged) for limit in limits if limit.exceeded(judged))
    return tuple(criterion for criterion in found if criterion.status == Status.FAILS)


def add_limit(limit: Limit) -> None:
    """Add a row to the table: `size`, `sweep` and `retime` judge it from then on.

    Raises:
        SizingError: the name exists already; the need is not a signal; a figure is not of an entry.
    """
    where = f"limit {limit.name!r}"
    if any(limit.name == other.name for other in LIMITS):
        raise SizingError(f"{where}: exists already; give another name")
    if isinstance(limit.need, str) and limit.need not in SIGNALS:
        allowed = choose_from(limit.need, list(SIGNALS))
        raise SizingError(f"{where}: need {limit.need!r}: give a function, or a signal; {allowed}")
    units = {other.unit for other in LIMITS if other.need == limit.need}
    if isinstance(limit.need, str) and units and limit.unit not in units:
        raise SizingError(
            f"{where}: unit {limit.unit!r}: {limit.need!r} is in SI: {choose_from('', list(units))}"
        )
    if isinstance(limit.gives, str):
        raise SizingError(
            f"{where}: gives {limit.gives!r}: give a function, or a tuple of figures like "
            "('ratings.peak_torque',)"
        )
    LIMITS.append(limit)


def missing_figures(criteria: Sequence[Criterion]) -> tuple[str, ...]:
    """Return why a drive cannot be checked: each need of `SETTLES` without a value, and why.

    Args:
        criteria: of `check`.
    """
    unchecked = {c.name: c for c in criteria if c.status == Status.NOT_CHECKED}
    names, reasons = {c.name for c in criteria}, []
    for thing in SETTLES:
        rows = [limit.name for limit in LIMITS if thing in limit.settles and limit.name in names]
        if rows and all(name in unchecked for name in rows):
            lacks = " or ".join(f"{name}: {unchecked[name].note}" for name in rows)
            reasons.append(f"its {thing.replace(chr(39) + 's', '')} cannot be checked: {lacks}")
    return tuple(reasons)


def instant_limits() -> tuple[Limit, ...]:
    """Return the rows that bound every instant of a motion, in the order of the table."""
    over_time = ("motor RMS torque",)
    return tuple(
        limit for limit in LIMITS if isinstance(limit.need, str) and limit.need not in over_time
    )
