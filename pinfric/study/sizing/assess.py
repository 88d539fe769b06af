"""Judge every candidate for one joint, and rank those that fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pinfric.errors import CatalogError, choose_from
from pinfric.study.sizing.bearing import BearingRatings
from pinfric.study.sizing.catalog import OTHERS, Amplifier, Catalog, Conditions
from pinfric.study.sizing.criteria import (
    Gap,
    check,
    continuous_limit,
    deciding,
    failing,
    gaps,
    gear_limits,
    motor_limits,
)
from pinfric.study.sizing.criterion import Criterion, Status, compare
from pinfric.study.sizing.drivetrain import (
    Candidate,
    Floor,
    MotorFigures,
    motor_cycle,
    torque_floor,
)
from pinfric.study.sizing.limit import Case

#: Of candidates that fit, so many are judged before the heavier ones are left out.
ENOUGH = 12


@dataclass(frozen=True)
class Assessment:
    """One candidate with all its criteria.

    Attributes:
        candidate: motor and gear.
        criteria: in the order of the report.
        motor: what the cycle asks of the motor; None where figures are missing.
        decides: criteria by which another candidate for the joint fails alone -> its name.
    """

    candidate: Candidate
    criteria: tuple[Criterion, ...]
    motor: MotorFigures | None
    decides: Mapping[str, str] = field(default_factory=dict)

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
    def gaps(self) -> tuple[Gap, ...]:
        """What of it must be judged and cannot be."""
        return gaps(self.criteria, self.decides)

    @property
    def missing_figures(self) -> tuple[str, ...]:
        """Why it cannot be judged, even though it fails nothing."""
        unknown = ("mass: not known",) if self.candidate.mass is None else ()
        return (*(gap.why for gap in self.gaps), *unknown)

    @property
    def lacks(self) -> tuple[str, ...]:
        """The figures without which it cannot be judged."""
        unknown = ("mass",) if self.candidate.mass is None else ()
        return tuple(dict.fromkeys((*(gap.figures for gap in self.gaps), *unknown)))

    @property
    def fits(self) -> bool:
        """It fails no criterion; those that are indispensable or decide were checked."""
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


@dataclass(frozen=True)
class _Rejected:
    """Candidates, lightest first, that fail criteria which are quickly checked."""

    candidates: list[Candidate]
    failed: tuple[Criterion, ...]

    @cached_property
    def assessment(self) -> Assessment:
        """Of the lightest, which stands for all of them."""
        return Assessment(self.candidates[0], self.failed, None)


def assess(offers: Sequence[Candidate], case: Case) -> tuple[Assessment, ...]:
    """Return judged candidates with their criteria: those that fit by mass, then margin; others.

    Gears that fail whatever the motor are judged first, and motors too slow for a gear or the bus;
    an assessment has only these criteria then. The others are judged from the lightest on, until
    `ENOUGH` fit. Of what was rejected early that is judged in full which may be the nearest miss,
    or the nearest below the lightest that fits.

    A criterion by which one of them fails alone decides at this joint: no other fits without it
    (`deciding`), or a drive whose stiffness is not printed would win where a stiffer one fails.

    Args:
        offers: motors and gears. case: the joint.
    """
    early, rest = [], []
    limits = gear_limits()
    for (gear, _), group in _by_gear(offers).items():
        failed = failing(limits, group[0], case) if gear is not None else ()
        if failed:
            early.append(_Rejected(group, failed))
        else:
            rest += group
    found, decides = _from_the_lightest(rest, case, early)
    most = min((_by_mass(a.candidate) for a in found if a.fits), default=np.inf)
    short = (a.margin for a in found if a.failed and _by_mass(a.candidate) < most)
    lighter = _lighter(early, most)
    found += _nearest_of(lighter, max(short, default=-np.inf), case, decides)
    there = {a.candidate.name for a in found}
    found += [e.assessment for e in early if e.assessment.candidate.name not in there]
    return tuple(sorted(found, key=_rank))


def _by_gear(offers: Sequence[Candidate]) -> dict[tuple[str | None, float], list[Candidate]]:
    """The candidates by gear and ratio, lightest motor first; a gearmotor is alone."""
    groups: dict[tuple[str | None, float], list[Candidate]] = {}
    for number, candidate in enumerate(offers):
        alone = candidate.gear_name is None
        key = (None, float(number)) if alone else (candidate.gear_name, candidate.ratio)
        groups.setdefault(key, []).append(candidate)
    for group in groups.values():
        group.sort(key=_by_mass)
    return groups


def _by_mass(candidate: Candidate) -> float:
    return np.inf if candidate.mass is None else candidate.mass


class _Weak:
    """Motors that cannot carry even the least RMS torque of a cycle, whatever else."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.floors: dict[tuple[str, float], Floor] = {}

    def __call__(self, candidate: Candidate) -> tuple[Criterion, ...]:
        """Return the criterion of the continuous torque if a candidate is too weak."""
        ratings, conditions = candidate.ratings, self.case.conditions
        if candidate.gear_name is None or candidate.transmission is None:
            return ()
        if ratings.continuous_curve is not None:
            return ()
        limit, note = ratings.continuous_at(conditions)
        key = candidate.gear_name, candidate.ratio
        if key not in self.floors:
            self.floors[key] = torque_floor(candidate, self.case.cycle)
        least = self.floors[key].rms(candidate.transmission.rotor_inertia) * (1 - 1e-9)
        if limit is None or least <= limit:
            return ()
        row = continuous_limit()
        texts = "; ".join(x for x in ("at least; the cycle was not looked at further", note) if x)
        formula = "sqrt(1/T int T_m^2 dt) <= continuous torque at its shaft"
        source = row.source if isinstance(row.source, str) else ""
        return (compare(row.name, least, limit, "N m", formula, source, note=texts),)


def _from_the_lightest(
    offers: Sequence[Candidate], case: Case, early: list[_Rejected]
) -> tuple[list[Assessment], dict[str, str]]:
    """Judge until enough fit; those that their motor's speed or voltage rejects go to `early`.

    Second: the criteria that decide (`deciding`).
    """
    found: list[Assessment] = []
    fit, last, limits, weak = 0, np.inf, motor_limits(), _Weak(case)
    decides = _deciding((), early)
    for candidate in sorted(offers, key=_by_mass):
        if fit >= ENOUGH and _by_mass(candidate) > last:
            break
        failed = failing(limits, candidate, case) or weak(candidate)
        if failed:
            early.append(_Rejected([candidate], failed))
            continue
        found.append(judged(candidate, case, decides))
        if more := _deciding(found[-1:], ()).keys() - decides:
            decides = decides | {name: candidate.name for name in more}
            found = [replace(a, decides=decides) for a in found]
            fitting = [_by_mass(a.candidate) for a in found if a.fits]
            fit, last = len(fitting), max(fitting, default=np.inf)
        elif found[-1].fits:
            fit, last = fit + 1, _by_mass(candidate)
    return found, decides


def _deciding(found: Sequence[Assessment], early: Sequence[_Rejected]) -> dict[str, str]:
    """The criteria by which one of these fails alone, as far as it was judged -> its name."""
    rejected = [e.assessment for e in early]
    return deciding((a.candidate.name, a.failed) for a in (*found, *rejected))


def _lighter(early: Sequence[_Rejected], mass: float) -> list[_Rejected]:
    """What was rejected early, of candidates below a mass, kg."""
    kept = ([c for c in e.candidates if _by_mass(c) < mass or mass == np.inf] for e in early)
    return [_Rejected(c, e.failed) for c, e in zip(kept, early, strict=True) if c]


def _nearest_of(
    early: Sequence[_Rejected], best: float, case: Case, decides: Mapping[str, str]
) -> list[Assessment]:
    """Judge in full what may fall short by less than `best`; no margin is above its early one."""
    found: list[Assessment] = []
    limits, weak = motor_limits(), _Weak(case)
    for rejected in sorted(early, key=lambda e: -e.assessment.margin):
        bound = rejected.assessment.margin
        if bound <= best:
            break
        for candidate in rejected.candidates:
            wrong = failing(limits, candidate, case) or weak(candidate)
            if min((c.margin or 0.0 for c in wrong), default=np.inf) <= best:
                continue
            found.append(judged(candidate, case, decides))
            if not found[-1].missing_figures:
                best = max(best, found[-1].margin)
            if best >= bound:
                break
    return found


def lightest(
    offers: Sequence[Candidate], case: Case, decides: Mapping[str, str]
) -> Assessment | None:
    """Return the first of `assess` if it fits, without a look at what is heavier; else None.

    Args:
        offers: motors and gears. case: the joint. decides: see `Assessment`, of the same joint.
    """
    of_gear, of_motor = gear_limits(), motor_limits()
    groups = _by_gear([c for c in offers if c.mass is not None])
    rest = [
        candidate
        for (gear, _), group in groups.items()
        if gear is None or not failing(of_gear, group[0], case)
        for candidate in group
    ]
    best, weak = None, _Weak(case)
    for candidate in sorted(rest, key=_by_mass):
        if best is not None and _by_mass(candidate) > _by_mass(best.candidate):
            break
        if failing(of_motor, candidate, case) or weak(candidate):
            continue
        found = judged(candidate, case, decides)
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
    in_full = [a for a in failing if a.motor is not None and not a.missing_figures]
    return max(in_full or failing, key=lambda a: a.margin, default=None)


def judged(
    candidate: Candidate, case: Case, decides: Mapping[str, str] | None = None
) -> Assessment:
    """Return one candidate with its criteria.

    Args:
        candidate: motor and gear. case: the joint. decides: see `Assessment`.
    """
    motor = None
    if candidate.transmission is not None:
        motor = motor_cycle(candidate, case.cycle, case.conditions)
    criteria = check(candidate, motor, case)
    # the samples are not kept: long motions x many candidates would fill the memory
    return Assessment(candidate, criteria, None if motor is None else motor.figures, decides or {})


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
