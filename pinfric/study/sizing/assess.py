"""Judge every candidate for one joint, and rank those that fit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from pinfric.study.sizing.catalog import Catalog, Conditions
from pinfric.study.sizing.criteria import Criterion, Status, check
from pinfric.study.sizing.demand import DriveCycle, JointDemand
from pinfric.study.sizing.drivetrain import Candidate, MotorFigures, candidates, motor_cycle

#: A candidate whose continuous torque cannot be checked is not offered: nothing speaks for it.
_INDISPENSABLE = "continuous torque"


@dataclass(frozen=True)
class Assessment:
    """One candidate with all its criteria.

    Attributes:
        candidate: motor and gear.
        criteria: in the order of the report.
        motor: what the cycle asks of the motor; None where figures are missing.
    """

    candidate: Candidate
    criteria: tuple[Criterion, ...]
    motor: MotorFigures | None

    @cached_property
    def failed(self) -> tuple[Criterion, ...]:
        """The criteria it fails, the worst first."""
        failed = [c for c in self.criteria if c.status == Status.FAILS]
        return tuple(sorted(failed, key=lambda c: c.margin if c.margin is not None else 0.0))

    @cached_property
    def not_checked(self) -> tuple[Criterion, ...]:
        """The criteria for which a figure is missing."""
        return tuple(c for c in self.criteria if c.status == Status.NOT_CHECKED)

    @cached_property
    def lacking(self) -> tuple[str, ...]:
        """Why it could not be chosen even though it fails nothing."""
        reasons = [c.why for c in self.not_checked if c.name == _INDISPENSABLE]
        return tuple(reasons + ["mass: not known"] * (self.candidate.mass is None))

    @property
    def fits(self) -> bool:
        """It fails nothing, and what is indispensable was checked."""
        return not self.failed and not self.lacking

    @cached_property
    def margin(self) -> float:
        """The least margin of what was checked and has a scale (`Criterion.scaled`)."""
        margins = [c.margin for c in self.criteria if c.margin is not None and c.scaled]
        return min(margins, default=0.0)

    @property
    def why(self) -> str:
        """Why it is rejected; empty where it fits."""
        return "; ".join([c.why for c in self.failed] or list(self.lacking))


def assess(
    catalog: Catalog,
    conditions: Conditions,
    demand: JointDemand,
    cycle: DriveCycle,
    load_inertia: float | None,
    hand: bool,
) -> tuple[Assessment, ...]:
    """Return every candidate with its criteria: those that fit by mass, then margin; the others.

    Args:
        catalog, conditions: what there is and what is demanded.
        demand, cycle: of the joint.
        load_inertia: largest inertia about the joint, kg m^2 (kg); None: not known.
        hand: one of the hand axes, beyond the third joint.
    """
    offered: Iterable[Candidate] = candidates(catalog, linear=demand.unit == "N")
    if own := conditions.bearings.get(demand.name):
        offered = (replace(c, bearing=catalog.bearings[own].ratings) for c in offered)
    found = [judged(c, conditions, demand, cycle, load_inertia, hand) for c in offered]
    return tuple(sorted(found, key=_rank))


def nearest_miss(assessments: Sequence[Assessment]) -> Assessment | None:
    """Return the rejected candidate whose worst criterion is short by least, or None."""
    failing = [a for a in assessments if a.failed]
    judged = [a for a in failing if not a.lacking] or failing
    return max(judged, key=lambda a: a.margin, default=None)


def judged(
    candidate: Candidate,
    conditions: Conditions,
    demand: JointDemand,
    cycle: DriveCycle,
    load_inertia: float | None,
    hand: bool,
) -> Assessment:
    """Return one candidate with its criteria; arguments as `assess`."""
    motor = None if candidate.transmission is None else motor_cycle(candidate, cycle, conditions)
    criteria = check(candidate, demand, cycle, motor, load_inertia, hand, conditions)
    # the samples are not kept: long motions x many candidates would fill the memory
    return Assessment(candidate, criteria, None if motor is None else motor.figures)


def _rank(assessment: Assessment) -> tuple[int, float, float, int, str]:
    """Those that fit by mass, then margin; those that lack a figure; those that fail, nearest
    first."""
    mass, name = assessment.candidate.mass, assessment.candidate.name
    if assessment.fits:
        return 0, mass or 0.0, -round(assessment.margin, 9), len(assessment.not_checked), name
    group = 2 if assessment.failed else 1
    return group, -assessment.margin, mass or 0.0, len(assessment.not_checked), name
