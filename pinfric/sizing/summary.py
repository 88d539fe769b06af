"""Summary of a sizing, as `pinfric size` prints and writes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from time import monotonic
from typing import Any

import numpy as np

from pinfric.drives.brake import Standstill
from pinfric.drives.criterion import Criterion
from pinfric.drives.demand import JointDemand
from pinfric.drives.drivetrain import MotorFigures
from pinfric.drives.limit import number
from pinfric.drives.policy import OWN_BEARING, of_maker
from pinfric.drives.power import BusPower
from pinfric.drives.rules import resonance
from pinfric.elastic.summary import ElasticSummary, elastic_summary
from pinfric.model.brief import time_left
from pinfric.model.described import EFFORT, INERTIA, SPEED, described, gathered, quantity
from pinfric.model.mass_matrix import frame_jacobians
from pinfric.model.robot import link_frame
from pinfric.motions.rating import Rated
from pinfric.sizing.drive_search import Ask, Assessment, stiffness_of
from pinfric.sizing.report import JointSizing, SizingReport
from pinfric.sizing.sensitivity import Sensitivity
from pinfric.sizing.verdict import JointVerdict, Verdict
from pinfric.stops.screen import StopScreen, stop_screen

#: Criteria that are named of a drive that misses several.
_MOST_MISSES = 3


@described
class Candidacy:
    """A drive that fits one joint: the chosen one, or one beside it."""

    name: str = quantity("motor and gear; `--take JOINT=NAME` takes it", heading="drive")
    mass: float | None = quantity("with its brake; none: not known", "kg", "mass")
    ratio: float = quantity("motor turns per joint turn", "1 or rad/m", "ratio")
    margin: float = quantity(
        "the least of all criteria", heading="least\nmargin", cell="{margin:margin}"
    )
    tightest: str | None = quantity("the criterion of that margin", heading="tightest\ncriterion")
    peak_current: float | None = quantity(
        "largest of its motor, in A as its maker prints them; none: not known", "A", "peak\ncurrent"
    )
    rms_current: float | None = quantity("RMS of the same", "A", "RMS\ncurrent")
    brake: str = quantity('at the motor\'s shaft; "": none', heading="brake")
    not_checked: int = quantity("criteria without a figure", heading="not\nchecked")


@described
class NextSmaller:
    """Of the drives lighter than the chosen one the one that misses by least."""

    name: str = quantity("motor and gear", heading="next smaller")
    why: str = quantity("the criterion that is not met, and by how much")
    mass: float | None = quantity("none: not known", "kg", "mass")
    short_by: str = quantity(
        "the criteria that it misses by most, each with the shortfall",
        heading="would fit,\nbut is short by",
    )


@described
class Provisional:
    """A drive that would fit, of which figures are missing: it is not signed."""

    drive: str = quantity("motor and gear", heading="drive")
    mass: float | None = quantity("none: not known", "kg", "mass")
    ask: tuple[str, ...] = quantity("figures that its makers must be asked for")
    would: str = quantity("what these must be", heading="would fit if")
    source: str = quantity("the documents of its other figures")


@described
class Lighter:
    """A drive of a joint that weighs no more than what it moves; not signed, or with others."""

    name: str = quantity("the joint's", heading="joint", name=True)
    drive: str = quantity("motor and gear", heading="drive")
    mass: float | None = quantity("none: not known", "kg", "mass")
    ask: tuple[str, ...] = quantity("figures that its makers must be asked for; empty: none")
    would: str = quantity('what these must be; "": it fits', heading="would fit if")


@described
class ToAsk:
    """A product that might do, lighter than the choice, but cannot be signed."""

    name: str = quantity("gear or motor", heading="product")
    figures: str = quantity(
        "that its maker must be asked for, or the condition that gives them",
        heading="what is missing",
    )
    mass: float | None = quantity("with its lightest partner; none: not known", "kg")
    joints: tuple[str, ...] = quantity("at which it might do", heading="joints")
    source: str = quantity("the document of its other figures")


@described
class CriterionMargins:
    """One criterion of all joints."""

    criterion: str = quantity("its name", heading="criterion")
    joints: Mapping[str, Criterion] = quantity("joint -> its check", heading="{}")


@described
class Installed:
    """The drive in the model: the choice or, if none fits, the closest candidate."""

    judged: str = quantity("its name")
    mass: float | None = quantity("none: not known", "kg", "mass")
    ratio: float = quantity("motor turns per joint turn", "1 or rad/m")
    brake: str = quantity('at the motor\'s shaft; "": none', heading="brake")
    amplifier: str = quantity(
        'that feeds the motor: of the conditions, else the smallest of the catalogue; "": none',
        heading="amplifier",
    )
    no_amplifier: str = quantity('why there is none; "": there is one')
    backlash: float | None = quantity(
        "of its gear at the joint; none: not printed", "rad or m", "backlash\nat the joint"
    )
    backlash_at_tool: float | None = quantity(
        "what that is at the tool, at the farthest pose; none: not known, or no `tool`",
        "m",
        "backlash\nat the tool",
        "{backlash_at_tool:mm}",
    )
    not_checked: int = quantity("criteria without a figure")
    margins: dict[str, float | None] = quantity("criterion -> part of the limit that is left")
    criteria: tuple[Criterion, ...] = quantity(
        "criteria of the drive, of holding without power, of the reversal error, and of its stops"
    )
    motor: MotorFigures | None = quantity("demand of the cycle on the motor", heading="*")
    losses: str = quantity("how the transmission's losses are derived from the catalogue")
    stand_ins: tuple[str, ...] = quantity("figures taken from other products, or from rules")
    notes: tuple[str, ...] = quantity("what the catalogue remarks on motor, gear and brake")
    sources: tuple[str, ...] = quantity("of motor and gear, with their grades")


@described
class SizedJoint(JointDemand):
    """Demand of one joint, and its drive."""

    peak_without_masses: float = quantity("`peak` without the drives' own masses", EFFORT)
    rms_without_masses: float = quantity(
        "`rms` without the drives' own masses", EFFORT, "worst\nwithout\nthat mass"
    )
    load_inertia: float | None = quantity(
        "largest inertia about the joint over the cycle; none: a loop's drives do not tell it",
        INERTIA,
    )
    choice: str | None = quantity(
        "the lightest drive that fits the cycle; none: none does", heading="drive"
    )
    decided_by: str | None = quantity(
        "which of cycle and rating alone takes the heavier drive; none: only one is given",
        heading="decided\nby",
    )
    installed: Installed | None = quantity(
        "the drive in the model; none: no candidates", heading="*"
    )
    verdict: JointVerdict | None = quantity(
        "whether it can be signed, and what fails; none: no catalogue", heading="*"
    )
    provisional: Provisional | None = quantity(
        "what would fit if figures were known that are missing, where nothing can be signed",
        heading="*",
    )
    candidates: int = quantity("drives of the catalogue whose parts go together")
    standstill: Standstill = quantity("holding without power", heading="*")
    taken: tuple[Candidacy, ...] = quantity("the choice beside them; empty: none fits")
    alternatives: tuple[Candidacy, ...] = quantity("other drives that fit")
    nearest_miss: str | None = quantity("if none fits: by how much the closest candidate misses")
    next_smaller: NextSmaller | None = quantity(
        "the lighter drive that misses by the least", heading="*"
    )


@described
class Unchecked:
    """A criterion that was not checked, and the figure that it lacks."""

    criterion: str = quantity("its name", heading="criterion")
    joints: tuple[str, ...] = quantity(
        "joints whose drive it is of; empty: the whole robot", heading="joints"
    )
    missing: str = quantity("the figure that is missing", heading="what is missing")


@described
class PeriodCycle:
    """One cycle of a period."""

    name: str = quantity("of the motion")
    repeats: float = quantity("number of runs in a period")


@described
class RatedJoint:
    """A joint's part of a rating."""

    name: str = quantity("the drive's", heading="joint", name=True)
    unit: str = quantity('of its effort, "N m" or "N"', heading="unit")
    held: float = quantity("effort that holds the payload in its worst posture", EFFORT, "held")
    speed: float = quantity("its top speed", SPEED, "top\nspeed")
    time: float = quantity("of the move from there, 90 degrees at most", "s", "move")
    reached: float = quantity("largest speed of the move", SPEED, "speed\nreached")
    frequency: float | None = quantity(
        "with the rated payload, all other joints rigid; none: not known", "Hz", "frequency"
    )
    decided: str = quantity("whose mean is tightest: its move's, the holds', a cycle's")
    by_cycle: str | None = quantity(
        "the drive that the cycle alone would take", heading="by the cycle alone"
    )
    by_rating: str | None = quantity(
        "the drive that the rating alone would take", heading="by the rating alone"
    )


@described
class RatingSummary:
    """What a robot is rated for."""

    payload: float = quantity("rated mass", "kg")
    payload_offset: float = quantity("of its centre of mass, along z of the link", "m")
    across: str | None = quantity(
        "last joint, for which it is also as far from the axis; none: it is so far for all"
    )
    link: str = quantity("that carries it")
    reach: float = quantity("farthest of the payload from the second joint, the shoulder", "m")
    acceleration_time: float = quantity("of one joint alone, from rest to top speed", "s")
    joints: tuple[RatedJoint, ...] = quantity("that carry the payload")


@described
class Hardest:
    """In which of several mountings a joint's effort is largest."""

    name: str = quantity("the drive's", heading="joint", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    rms: float = quantity("largest RMS effort", EFFORT, "largest\nRMS")
    rms_in: str = quantity("the mounting that has it", heading="in")
    peak: float = quantity("largest effort", EFFORT, "largest\npeak")
    peak_in: str = quantity("the mounting that has it", heading="in ")


@described
class SizingSummary:
    """Demand of a cycle on every drive, and the drives chosen for it."""

    verdict: Verdict = quantity("whether the choice can be signed, and what fails")
    trajectory: str = quantity("source of the motion")
    rating: RatingSummary | None = quantity("in place of a cycle or beside it; none: no rating")
    catalog: str | None = quantity("the catalogue; none: demand only")
    conditions: dict[str, Any] = quantity("conditions, with the keys of a catalogue")
    cycle_time: float = quantity("duration of the repeated period", "s")
    cycles: tuple[PeriodCycle, ...] = quantity("cycles of a period")
    off: float = quantity("time switched off in a period", "s")
    unclosed: tuple[str, ...] = quantity("states that differ between end and start of the cycle")
    passes: int = quantity("answers until no question of the choice had a new one")
    settled: bool = quantity("whether no choice changed in the last pass")
    drive_mass: float = quantity("mass of all drives in the model", "kg")
    joints: tuple[SizedJoint, ...] = quantity("in the order of the scene's drives")
    mountings: tuple[Hardest, ...] = quantity(
        "of several mountings the hardest for each joint; empty: there is one"
    )
    bus: BusPower = quantity("electrical power of all drives together")
    bodies: dict[str, str] = quantity(
        "inertias of payloads that were guessed, and as what, by their places in the scene"
    )
    point_mass: float | None = quantity(
        "mass of the drives if these payloads were points; none: none is guessed", "kg"
    )
    other_mass: float | None = quantity(
        "mass of the drives if the links hold them; none: the scene says it, or they are too light",
        "kg",
    )
    lighter: tuple[Lighter, ...] = quantity(
        "where the drives outweigh what they move, drives that do not; empty: there are none"
    )
    sensitivity: tuple[Sensitivity, ...] = quantity(
        "by which factors on loads the choice changes; empty: not asked for"
    )
    ask: tuple[ToAsk, ...] = quantity(
        "lighter products that cannot be signed, fewest figures first"
    )
    stops: StopScreen | None = quantity("with the chosen drives; none: no `stops` in the scene")
    unchecked: tuple[Unchecked, ...] = quantity(
        "criteria of drives, brakes, bus and robot that were not checked, and why"
    )
    robot_criteria: tuple[Criterion, ...] = quantity("criteria of the whole robot")
    elasticity: ElasticSummary | None = quantity(
        "effects of elastic gears; none: no stiffness known"
    )
    notes: tuple[str, ...] = quantity("assumptions, and what was not checked")


def sizing_summary(
    report: SizingReport, progress: Callable[[str], object] = lambda _: None
) -> SizingSummary:
    """Return the summary of a sizing; `progress`: called with a line of text at each joint."""
    t, duty, joints = report.result.times, report.duty, list[SizedJoint]()
    began = monotonic()
    for k, lever in enumerate(levers(report)):
        done = f"drive {k + 1} of {len(report.joints)}{time_left(began, k, len(report.joints))}"
        progress(f"what else fits: {report.joints[k].name}, {done}")
        joints.append(_sized_joint(report, k, lever))
    progress("what to ask for")
    return gathered(
        SizingSummary,
        report,
        rating=None if report.rating is None else _rating_summary(report, report.rating.rated),
        catalog=None if report.catalog is None else report.catalog.source,
        conditions=report.conditions.model_dump(),
        cycle_time=report.period,
        cycles=tuple(
            PeriodCycle(name, n) for name, n in zip(duty.names, duty.repeats, strict=False) if n
        ),
        off=float(t[-1] - t[duty.starts[-2]]) if duty.off else 0.0,
        joints=tuple(joints),
        mountings=tuple(_hardest(joint) for joint in report.joints if joint.mountings),
        lighter=_lighter(report),
        ask=to_ask(report),
        stops=None if report.screened is None else stop_screen(report.screened),
        unchecked=() if report.catalog is None else unchecked(report),
        robot_criteria=report.arm_criteria,
        elasticity=None if report.elastic is None else elastic_summary(report.elastic),
    )


def _lighter(report: SizingReport) -> tuple[Lighter, ...]:
    return tuple(
        Lighter(
            report.joints[i].name, a.name, a.mass, of_maker(a.lacks, a.kind), "; ".join(a.would)
        )
        for i, a in sorted(report.lighter.items())
    )


def _hardest(joint: JointSizing) -> Hardest:
    figures = joint.mountings
    by_rms, by_peak = (max(figures, key=lambda words: figures[words][k]) for k in (0, 1))
    rms, peak = figures[by_rms][0], figures[by_peak][1]
    return Hardest(joint.name, joint.demand.unit, rms, by_rms, peak, by_peak)


def _rating_summary(report: SizingReport, rated: Rated) -> RatingSummary:
    joints = []
    for lift in rated.lifts:
        joint, taken = report.joints[lift.drive], report.joints[lift.drive].installed
        stiffness = np.nan if taken is None else stiffness_of(taken)
        hertz = resonance(stiffness, number(joint.load_inertia))
        alone = {name: None if a is None else a.name for name, a in joint.alone.items()}
        joints.append(
            RatedJoint(
                joint.name,
                joint.demand.unit,
                lift.held,
                lift.speed,
                lift.duration,
                lift.reached,
                None if np.isnan(hertz) else hertz,
                joint.decided,
                alone.get("cycle"),
                alone.get("rating"),
            )
        )
    return RatingSummary(
        rated.rating.payload,
        rated.rating.payload_offset,
        rated.columns[rated.lifts[-1].column].name if rated.across else None,
        rated.link,
        rated.reach,
        rated.rating.acceleration_time,
        tuple(joints),
    )


def unchecked(report: SizingReport) -> tuple[Unchecked, ...]:
    """Return every criterion that was not checked, with what it lacks, and the joints."""
    lacking: dict[tuple[str, str], list[str]] = {}
    for joint, criteria in zip(report.joints, report.criteria, strict=True):
        if joint.installed is None:
            because = joint.nothing_because or "no candidate can be judged"
            because = "something to move: it moves no mass" if joint.unloaded else because
            lacking.setdefault(("all of its drive", because), []).append(joint.name)
            continue
        for c in criteria:
            if c.unchecked:
                lacking.setdefault((c.name, c.lacks), []).append(joint.name)
    for c in (*report.bus.criteria, *report.arm_criteria):
        if c.unchecked:
            lacking.setdefault((c.name, c.lacks), [])
    if report.screened is None:
        lacks = report.no_stops or "a drive that fits for every joint"
        lacks = "the key stops of the scene" if report.given.stops is None else lacks
        lacking["stopping times and distances", lacks] = []
    return tuple(Unchecked(name, tuple(of), lacks) for (name, lacks), of in lacking.items())


def levers(report: SizingReport) -> np.ndarray:
    """Return (na,) how far the tool moves per rad (m) of each joint, at most; NaN: not known."""
    scene, q = report.scene, report.result.states.q
    if scene.tool is None or scene.loops:
        return np.full(len(scene.drives), np.nan)
    J = frame_jacobians(scene.twin(), q, link_frame(scene.model, scene.tool))[:, :3]
    moved = np.linalg.norm(J[:, :, [drive.velocity_index for drive in scene.drives]], axis=1)
    return moved.max(axis=0)


def to_ask(report: SizingReport) -> tuple[ToAsk, ...]:
    """Return the products that might do at some joint but lack figures, fewest figures first."""
    joints: dict[str, list[str]] = {}
    asked = {}
    for joint in report.joints:
        for ask in joint.ask:
            joints.setdefault(ask.name, []).append(joint.name)
            asked[ask.name] = ask
    order = sorted(asked.values(), key=lambda a: (len(a.figures), -len(joints[a.name]), a.name))

    def missing(ask: Ask) -> str:
        asked = of_maker(ask.figures, ask.kind)
        return ", ".join([*asked, *[OWN_BEARING] * (len(asked) < len(ask.figures))])

    return tuple(ToAsk(a.name, missing(a), a.mass, tuple(joints[a.name]), a.source) for a in order)


def _sized_joint(report: SizingReport, k: int, lever: float) -> SizedJoint:
    """`lever`: by which the tool moves per rad (m) of the joint, at most."""
    joint, verdicts = report.joints[k], report.verdict.joints
    smaller, taken = joint.next_smaller, joint.installed
    return gathered(
        SizedJoint,
        joint,
        **vars(joint.demand),
        peak_without_masses=joint.demand_without_masses.peak,
        rms_without_masses=joint.demand_without_masses.rms,
        choice=None if joint.choice is None else joint.choice.name,
        decided_by=joint.decided_by or None,
        verdict=verdicts[k] if verdicts else None,
        provisional=_provisional(joint.nearest),
        installed=None if taken is None else _installed(report, k, taken, lever),
        standstill=report.standstills[k],
        taken=() if joint.choice is None else (_candidacy(joint.choice),),
        alternatives=tuple(_candidacy(a) for a in joint.alternatives),
        nearest_miss=joint.no_fit or None,
        next_smaller=None if smaller is None else _next_smaller(smaller),
    )


def _provisional(taken: Assessment | None) -> Provisional | None:
    if taken is None or not taken.would:
        return None
    would, sources = "; ".join(taken.would), "; ".join(taken.candidate.sources)
    return Provisional(taken.name, taken.mass, of_maker(taken.lacks, taken.kind), would, sources)


def _next_smaller(smaller: Assessment) -> NextSmaller:
    failed = smaller.failed
    parts = [f"{c.name}: {c.shortfall}" for c in failed[:_MOST_MISSES]]
    parts += [f"{len(failed) - _MOST_MISSES} more"] * (len(failed) > _MOST_MISSES)
    return NextSmaller(smaller.name, smaller.why, smaller.mass, "; ".join(parts))


def margins(summary: SizingSummary) -> list[CriterionMargins]:
    """Return the criteria of all joints' drives, a row each: what moves first, what holds last."""
    columns = {
        joint.name: {c.name: c for c in joint.installed.criteria} if joint.installed else {}
        for joint in summary.joints
    }
    names = dict.fromkeys(name for column in columns.values() for name in column)
    last = ("inertia", "gear res", "back", "holding", "brake", "reversal")
    return [
        CriterionMargins(name, {joint: own[name] for joint, own in columns.items() if name in own})
        for name in sorted(names, key=lambda name: name.startswith(last))
    ]


def _candidacy(drive: Assessment) -> Candidacy:
    judged = [c for c in drive.criteria if c.scaled]
    tightest = min(judged, key=lambda c: c.margin or 0.0, default=None)
    motor = drive.motor
    return Candidacy(
        drive.name,
        drive.mass,
        drive.candidate.ratio,
        drive.margin,
        None if tightest is None else tightest.name,
        None if motor is None else motor.peak_current,
        None if motor is None else motor.rms_current,
        drive.candidate.brake,
        len(drive.not_checked),
    )


def _installed(report: SizingReport, k: int, taken: Assessment, lever: float) -> Installed:
    gap, criteria = taken.candidate.backlash, report.criteria[k]
    amplifier, why = report.amplifiers[k]
    return gathered(
        Installed,
        taken.candidate,
        judged=taken.name,
        amplifier=amplifier,
        no_amplifier=why,
        backlash_at_tool=None if gap is None or np.isnan(lever) else gap * lever,
        not_checked=sum(c.unchecked for c in criteria),
        margins={c.name: c.margin for c in criteria},
        criteria=criteria,
        motor=taken.motor,
    )
