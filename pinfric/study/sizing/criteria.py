"""The one table of a drive's limits: `size`, `sweep` and `retime` read it.

A row says what a cycle needs, what the maker gives (in order of preference: a lower limit that is
printed stands in for one that is not), the formula and its source. What a missing figure means is
in the row, too: a row is *not checked* without it, and a drive of which nothing settles one of the
`SETTLES` *cannot be checked*.

`size` takes the needs of a whole cycle, `sweep` those of every sample of its own, `retime` bounds
each instant of a motion by the rows whose need is one of `SIGNALS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

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


class Gap(NamedTuple):
    """Something of a drive that must be judged and cannot be.

    Attributes:
        what: what must be judged. rows: the criteria that would do, all without a figure.
        other: the drive that makes it indispensable, as it fails by this alone; "" for `SETTLES`.
    """

    what: str
    rows: tuple[Criterion, ...]
    other: str = ""

    @property
    def figures(self) -> str:
        """What is missing, in words."""
        return " or ".join(dict.fromkeys(row.lacks for row in self.rows))

    @property
    def why(self) -> str:
        """What cannot be judged, for lack of which figure."""
        if self.other:
            return f"{self.what}: {self.rows[0].note}; {self.other} fails by it alone"
        lacks = " or ".join(f"{row.name}: {row.note}" for row in self.rows)
        return f"its {self.what.replace(chr(39) + 's', '')} cannot be checked: {lacks}"


def gaps(criteria: Sequence[Criterion], decides: Mapping[str, str]) -> tuple[Gap, ...]:
    """Return why a drive cannot be judged: what of `SETTLES` and of what decides has no value.

    Args:
        criteria: of `check`. decides: of `deciding`, at its joint.
    """
    unchecked = {c.name: c for c in criteria if c.status == Status.NOT_CHECKED}
    names, found, settled = {c.name for c in criteria}, [], set[str]()
    for thing in SETTLES:
        rows = [limit.name for limit in LIMITS if thing in limit.settles and limit.name in names]
        if rows and all(name in unchecked for name in rows):
            found.append(Gap(thing, tuple(unchecked[name] for name in rows)))
        settled.update(rows)  # one row stands for the others; if none was checked it is said above
    open_ = [name for name in decides if name in unchecked and name not in settled]
    return (*found, *(Gap(name, (unchecked[name],), decides[name]) for name in open_))


def deciding(failed: Iterable[tuple[str, Sequence[Criterion]]]) -> dict[str, str]:
    """Return the criteria by which one of several drives fails alone, and the first such drive.

    A bus voltage far above the nominal one is a question, no limit: it decides nothing.

    Args:
        failed: name and failed criteria of each drive.
    """
    alone = ((criteria[0].name, drive) for drive, criteria in failed if len(criteria) == 1)
    found: dict[str, str] = {}
    for name, drive in alone:
        if name != "bus voltage":
            found.setdefault(name, drive)
    return found


def instant_limits() -> tuple[Limit, ...]:
    """Return the rows that bound every instant of a motion, in the order of the table."""
    over_time = ("motor RMS torque",)
    return tuple(
        limit for limit in LIMITS if isinstance(limit.need, str) and limit.need not in over_time
    )
