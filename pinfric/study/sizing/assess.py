"""Judge every candidate for one joint, and rank those that fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from pinfric.errors import CatalogError, choose_from
from pinfric.study.sizing.bearing import BearingRatings
from pinfric.study.sizing.catalog import OTHERS, Amplifier, Catalog, Conditions
from pinfric.study.sizing.criteria import check, missing_figures
from pinfric.study.sizing.criterion import Criterion, Status
from pinfric.study.sizing.drivetrain import Candidate, MotorFigures, motor_cycle
from pinfric.study.sizing.limit import Case


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
    def missing_figures(self) -> tuple[str, ...]:
        """Why it cannot be judged, even though it fails nothing."""
        unknown = ("mass: not known",) if self.candidate.mass is None else ()
        return missing_figures(self.criteria) + unknown

    @property
    def fits(self) -> bool:
        """It fails no criterion, and the indispensable ones were checked."""
        return not self.failed and not self.missing_figures

    @cached_property
    def margin(self) -> float:
        """The least margin of what was checked and has a scale (`Criterion.scaled`)."""
        margins = [c.margin for c in self.criteria if c.margin is not None and c.scaled]
        return min(margins, default=0.0)

    @property
    def why(self) -> str:
        """Why it is rejected; empty if it fits."""
        return "; ".join([c.why for c in self.failed] or list(self.missing_figures))


def assess(offers: Sequence[Candidate], case: Case) -> tuple[Assessment, ...]:
    """Return every candidate with its criteria: those that fit by mass, then margin; the others.

    Args:
        offers: motors and gears. case: the joint.
    """
    return tuple(sorted((judged(c, case) for c in offers), key=_rank))


def lightest(offers: Sequence[Candidate], case: Case) -> Assessment | None:
    """Return the first of `assess` if it fits, without a look at what is heavier; else None."""
    best = None
    weighed = ((c.mass, c) for c in offers if c.mass is not None)
    for mass, candidate in sorted(weighed, key=lambda pair: pair[0]):
        if best is not None and mass > (best.candidate.mass or 0.0):
            break
        found = judged(candidate, case)
        if found.fits and (best is None or _rank(found) < _rank(best)):
            best = found
    return best


def own_parts(
    catalog: Catalog, conditions: Conditions, joint: str, linear: bool
) -> dict[str, BearingRatings | Amplifier]:
    """Return what the conditions give to a joint, by its field of a candidate.

    Raises:
        CatalogError: the catalogue does not have it, or not its ratings; it does not fit the joint.
    """
    amplifier, name = own_amplifier(catalog, conditions, joint), conditions.bearings.get(joint)
    parts: dict[str, BearingRatings | Amplifier] = {}
    if amplifier is not None:
        parts["amplifier"] = amplifier
    if name is None:
        return parts
    where, entry = f"conditions.bearings.{joint}: ", catalog.bearings.get(name)
    if entry is None or entry.ratings is None:
        rated = [known for known, other in catalog.bearings.items() if other.ratings is not None]
        what = "has no `ratings`" if name in catalog.bearings else "is not in the catalogue"
        raise CatalogError(f"{where}the bearing {name!r} {what}; {choose_from(name, rated)}")
    if entry.ratings.guide != linear or entry.ratings.screw:
        joint_kind = "sliding joint takes a `linear guide`" if linear else "turning joint a bearing"
        nut = "; a screw's nut is its gear's `bearing`" if entry.ratings.screw else ""
        raise CatalogError(f"{where}{name!r} is a {entry.ratings.kind}; a {joint_kind}{nut}")
    source = entry.ratings.source or entry.source
    ratings = entry.ratings.model_copy(update={"source": source})
    return parts | {"guide" if linear else "bearing": ratings}


def own_amplifier(catalog: Catalog, conditions: Conditions, joint: str) -> Amplifier | None:
    """Return the amplifier that the conditions give to a joint's motor, or None.

    Raises:
        CatalogError: the catalogue does not have it.
    """
    key = joint if joint in conditions.amplifiers else OTHERS
    name = conditions.amplifiers.get(key)
    if name is None:
        return None
    if name not in catalog.amplifiers:
        raise CatalogError(
            f"conditions.amplifiers.{key}: there is no amplifier {name!r} in the catalogue; "
            f"{choose_from(name, catalog.amplifiers)}"
        )
    return catalog.amplifiers[name]


def nearest_miss(assessments: Sequence[Assessment]) -> Assessment | None:
    """Return the rejected candidate whose worst criterion is short by least, or None."""
    failing = [a for a in assessments if a.failed]
    judged = [a for a in failing if not a.missing_figures] or failing
    return max(judged, key=lambda a: a.margin, default=None)


def judged(candidate: Candidate, case: Case) -> Assessment:
    """Return one candidate with its criteria."""
    motor = None
    if candidate.transmission is not None:
        motor = motor_cycle(candidate, case.cycle, case.conditions)
    criteria = check(candidate, motor, case)
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


def pareto_front(assessments: Sequence[Assessment]) -> list[Assessment]:
    """Return the candidates for which no other is both lighter and of greater margin, by mass."""
    front: list[Assessment] = []
    for a in sorted(assessments, key=lambda a: (a.candidate.mass or 0.0, -a.margin)):
        if not front or a.margin > front[-1].margin:
            front.append(a)
    return front
