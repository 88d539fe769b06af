"""The verdict of a sizing: its headline, tile, colours, table, signature and exit code are of it.

A joint can be signed if a drive was chosen of which every necessary figure is known, and if all
criteria of `joint_criteria` pass: those of drive, brake, stop and place alike. A criterion enters
once, where it is judged, and counts from then on:

- of a drive: a row of `drives.limits.LIMITS`,
- of a brake: `Standstill.criteria`,
- of a stop, and of the place where it ends: `SizingReport.stops.axes[i].criteria`; of a rating
  alone what its gear would bear in one: `SizingReport.open_stops`,
- of the bus or the whole robot: `SizingReport.bus` and `.arm_criteria`.

Only `Status.FAILS` counts against a joint. What was not checked does so where a drive cannot be
signed without it (`Assessment.fits`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from pinfric.drives.brake import BRAKE
from pinfric.drives.criterion import Criterion, Status, compare
from pinfric.drives.held import doubted_masses, held_drives
from pinfric.drives.limits import SHOCK
from pinfric.drives.policy import SURROUNDINGS, outside
from pinfric.drives.robot import carried
from pinfric.model.brief import counted
from pinfric.model.described import derived, described, quantity
from pinfric.model.legs import hanging_legs
from pinfric.model.scene import Scene
from pinfric.model.total_mass import doubted_mass
from pinfric.sizing.drive_search import momentary_peak

if TYPE_CHECKING:  # it is above this module
    from pinfric.sizing.size import JointSizing, SizingReport

#: Of a rating alone, what its gear would bear in a stop, and what to do where it does not.
_OPEN_STOP = f"stop: {SHOCK}"
_DEMAND_STOPS = "give a cycle beside it, or `stops`"
#: Joints of which the headline says what fails; the others are counted.
_MOST_FAILING = 2


class JointState(StrEnum):
    """How the choice for a joint ended."""

    SIGNED = "can be signed"
    FAILS = "fails"
    PROVISIONAL = "provisional"
    NONE = "none"
    UNLOADED = "moves no mass"


@described
class JointVerdict:
    """The verdict on one joint."""

    name: str = quantity("the drive's", name=True)
    state: JointState = quantity(
        "can be signed; fails: a brake, a stop, or the place where it ends; provisional; none; "
        "moves no mass: not sized"
    )
    mass: float = quantity("of its drive, as far as known; 0 where none fits", "kg")
    margin: float | None = quantity(
        "the least of all criteria of drive, brake, stop and place; none: none was checked",
        heading="least\nmargin",
        cell="{margin:margin}",
    )
    tightest: str | None = quantity(
        "the criterion of the least margin; none: none was checked", heading="tightest\ncriterion"
    )
    why: str = quantity("what fails, in short; empty: nothing")
    failing: tuple[str, ...] = quantity("a line for each thing that fails")


@described
class Verdict:
    """The verdict on all joints and the robot.

    Attributes:
        joints: in the order of the report's; empty without a catalogue.
    """

    joints: tuple[JointVerdict, ...]
    failing: tuple[str, ...] = quantity(
        "a line for everything that keeps the sizing from being signed, of joints and robot"
    )
    question: str = quantity("what the scene leaves open, with both answers; empty: nothing")
    remarks: tuple[str, ...] = quantity("what is doubted, though it does not fail")

    @property
    @derived()
    def signed(self) -> bool:
        """Whether the choice can be signed: there is one, and `failing` is empty."""
        return bool(self.joints) and not self.failing

    @property
    @derived()
    def fitted(self) -> int:
        """Number of joints that can be signed."""
        return len(self.of(JointState.SIGNED))

    @property
    @derived()
    def sized(self) -> int:
        """Number of joints that get a drive: all but those that move no mass."""
        return len(self.joints) - len(self.of(JointState.UNLOADED))

    @property
    @derived("kg")
    def mass(self) -> float:
        """Mass of the drives that can be signed."""
        return sum(joint.mass for joint in self.of(JointState.SIGNED))

    @property
    @derived()
    def headline(self) -> str:
        """How many joints can be signed, the mass of their drives, what fails, and where."""
        if not self.joints:
            unmet = f"{counted(len(self.failing), 'criterion', 'criteria')} not met"
            return unmet if self.failing else "no criterion fails"
        provisional = self.of(JointState.PROVISIONAL)
        said = f"{self.fitted} of {self.sized} joints can be signed"
        parts = [f"{said}, {len(provisional)} provisional" if provisional else said]
        if self.fitted:
            these = " for these" * (self.fitted < self.sized)
            parts.append(f"{self.mass:.2f} kg of drives{these}")
        if provisional:
            parts.append(f"{sum(joint.mass for joint in provisional):.2f} kg provisional")
        if unloaded := self.of(JointState.UNLOADED):
            named = ", ".join(joint.name for joint in unloaded)
            parts.append(f"{named}: moves no mass, not sized")
        wrong = [joint for joint in self.joints if joint.why]
        parts += [f"{joint.name}: {joint.why}" for joint in wrong[:_MOST_FAILING]]
        more = len(wrong[_MOST_FAILING:])
        parts += [f"{counted(more, 'more joint')} not"] * bool(more)
        parts += self.failing[sum(len(joint.failing) for joint in self.joints) :][:_MOST_FAILING]
        return "; ".join([*parts, *([self.question] if self.question else ())])

    def of(self, state: JointState) -> tuple[JointVerdict, ...]:
        """Return the joints that ended so."""
        return tuple(joint for joint in self.joints if joint.state == state)


def verdict_of(report: SizingReport) -> Verdict:
    """Return the verdict on a sizing: see the module."""
    joints = zip(report.joints, report.criteria, strict=True)
    whole = _failing("robot", report.arm_criteria)
    (weighs, possible), legs = _weight(report.given), hanging_legs(report.given.model)
    if report.catalog is None:
        alone = (line for joint, own in joints for line in _failing(joint.name, own))
        whole += [] if possible else [weighs]
        return Verdict((), (*alone, *whole), "", (legs,) if legs else ())
    # What the scene says of its masses
    masses = {i: drive.mass for i, drive in enumerate(report.drives) if drive}
    held = held_drives(report.given, masses, report.conditions.mass_in_urdf)
    heavy = doubted_masses(held)
    beyond = any(one.share > 1.0 for one in held)  # larger gears for the stops may be the last ones
    impossible = (report.contradiction, heavy * beyond, "" if possible else weighs)
    doubted = any(impossible)
    judged = tuple(_of_joint(joint, own, doubted) for joint, own in joints)
    lines = [line for joint in judged for line in joint.failing]
    # Of the robot as a whole: the choice, masses, the bus, the stops
    if not report.settled:
        lines.append(f"the choice still alternates after {report.passes} passes")
    lines += [*(line for line in impossible[:2] if line), *causes(report)]
    lines += [*_failing("bus", report.bus.criteria), *whole]
    lines += [report.no_stops] if report.no_stops else []
    # What it leaves open
    question, same, holds = "", "", report.given.masses_hold
    unsaid = [i for i in masses if holds[i] is None and carried(report.given, i)]
    if report.other_mass not in (None, report.drive_mass):
        open_ = [j.name for j, hold in zip(report.joints, holds, strict=True) if hold is None]
        whose = f" of {', '.join(open_)}" if len(open_) < len(holds) else ""
        question = (
            f"{report.drive_mass:.2f} kg if the links are bare, {report.other_mass:.2f} kg if they "
            f"hold the drives{whose}: write `robot.masses`"
        )
    elif unsaid:
        same = "robot.masses is not written: " + (
            "the links are too light to hold the drives, which are added to them"
            if report.other_mass is None
            else "the same drives are chosen if the links hold them"
        )
    if any(c.name == _OPEN_STOP and c.fails for own in report.criteria for c in own):
        open_stop = f"of a rating alone stops are not demanded: {_DEMAND_STOPS}"
        question = "; ".join(text for text in (question, open_stop) if text)
    remarks = (legs, same, "" if beyond else heavy, weighs if possible else "")
    return Verdict(judged, tuple(lines), question, tuple(text for text in remarks if text))


def causes(report: SizingReport) -> tuple[str, ...]:
    """Return what of catalogue, ambient or masses keeps joints from being signed."""
    catalog, conditions = report.catalog, report.conditions
    if catalog is None:
        return ()
    reasons, pairs = [], tuple(zip(report.joints, report.criteria, strict=True))
    bare = [j.name for j, own in pairs for c in own if c.name == BRAKE and c.fails]
    if bare and not catalog.brakes:
        reasons.append(
            f"{catalog.source} has no brakes, and {', '.join(bare)} would not be held without "
            "power: add `brakes`, or `extends: default`"
        )
    there = {gear.kind for gear in catalog.gears.values()}
    there |= {"motor"} if catalog.motors or catalog.gearmotors else set()
    there |= {"amplifier"} if conditions.amplifiers else set()
    outer = [kind for kind in SURROUNDINGS if kind in there and outside(kind, conditions)]
    if outer and any(joint.choice is None and not joint.unloaded for joint in report.joints):
        named = ", ".join(
            k + " gears" if k not in ("motor", "amplifier") else k + "s" for k in outer
        )
        reasons.append(
            f"conditions.ambient = {conditions.ambient:g} C: {named} lack "
            f"{outside(outer[0], conditions)[0]}, and none is signed: give the temperature at the "
            "drives"
        )
    weighs, possible = _weight(report.given)
    return (*reasons, *[weighs] * (not possible))


def _weight(scene: Scene) -> tuple[str, bool]:
    """What is doubted of the robot's mass, "" if nothing, and whether it can be signed so.

    Robots that are too light by less than ten times are signed where the links are said to be bare.
    """
    doubt = doubted_mass(scene.model)
    if doubt is None:
        return "", True
    if doubt.impossible or not doubt.light:
        return f"robot: {doubt.text}", not doubt.impossible
    bare = all(hold is False for hold in scene.masses_hold)
    said = "" if bare else "; bare links are said by `robot.masses: without_drives`"
    return f"robot: {doubt.text}{said}", bare


def joint_criteria(report: SizingReport) -> tuple[tuple[Criterion, ...], ...]:
    """Return all criteria of each joint: of its drive, brake, reversal error, stop and place."""
    by_joint = []
    stops = None if report.stops is None else report.stops.axes
    for k, joint in enumerate(report.joints):
        own = () if joint.installed is None else joint.installed.criteria
        still = () if report.catalog is None else report.standstills[k].criteria
        stop = () if stops is None else stops[k].criteria
        named = (replace(c, name=f"stop: {c.name}") for c in stop)
        rest = (*named, *_open_stop(report, k), *_shared(report, k))
        by_joint.append((*own, *still, *report.reversals[k : k + 1], *rest))
    return tuple(by_joint)


def _open_stop(report: SizingReport, k: int) -> list[Criterion]:
    """What the gear of a rating alone would have to bear if brakes close."""
    taken = report.joints[k].installed
    if taken is None or k not in report.open_stops:
        return []
    bears = momentary_peak(taken)
    judged = compare(
        _OPEN_STOP,
        report.open_stops[k],
        None if np.isnan(bears) else bears,
        report.joints[k].demand.unit,
        "1.3 x the peak in stops of all joints <= limit for momentary peak torque",
        "algebra (`stops.peaks`), all brakes closing at once",
        "momentary_peak_torque of the gear",
    )
    fails = judged.fails
    return [replace(judged, note=_DEMAND_STOPS) if fails else judged]


def _shared(report: SizingReport, k: int) -> list[Criterion]:
    """Whether a joint has the drive of its group, where it is of one."""
    names, mine = [joint.name for joint in report.joints], report.joints[k].name
    judged = []
    for group in report.conditions.same_drive:
        taken = [report.drives[names.index(name)] for name in group]
        if mine in group and report.catalog is not None:
            alike = len({drive and drive.name for drive in taken}) == 1
            status, said = Status.PASSES if alike else Status.FAILS, f"by {', '.join(group)}"
            note = said if alike else f"no one drive fits {', '.join(group)}"
            rule = "one motor and gear for the group", "conditions.same_drive"
            judged.append(Criterion("same drive", status, None, None, "", None, *rule, note))
    return judged


def _of_joint(joint: JointSizing, criteria: tuple[Criterion, ...], doubted: bool) -> JointVerdict:
    """`doubted`: the scene's masses cannot be, so that nothing can be signed."""
    ended = () if joint.unloaded else (Status.PASSES, Status.FAILS)
    judged = (c for c in criteria if c.status in ended and c.scaled)
    tightest = min(judged, key=lambda c: c.margin or 0.0, default=None)
    failed, state, why = [c for c in criteria if c.fails], JointState.SIGNED, ""
    failing = tuple(_failing(joint.name, failed))
    taken = joint.choice
    if joint.unloaded:
        state, failing = JointState.UNLOADED, ()
    elif taken is None and joint.nearest is not None and joint.nearest.would:
        taken, state = joint.nearest, JointState.PROVISIONAL
        beside = [c for c in failed if c not in taken.failed]
        failing = (joint.no_fit, *_failing(joint.name, beside))
    elif taken is None:
        state, why, failing = JointState.NONE, "no drive fits", (joint.no_fit,)
    elif failed:
        worst = min(failed, key=lambda c: c.margin or 0.0)
        short = f"{worst.shortfall} short" if "%" in worst.shortfall else worst.shortfall
        state, why = JointState.FAILS, f"{worst.name}: {short}"
    elif doubted:
        state = JointState.PROVISIONAL
    return JointVerdict(
        name=joint.name,
        state=state,
        mass=0.0 if taken is None else taken.mass or 0.0,
        margin=None if tightest is None else tightest.margin or 0.0,
        tightest=None if tightest is None else tightest.name,
        why=why,
        failing=failing,
    )


def _failing(whose: str, criteria: Iterable[Criterion]) -> list[str]:
    """One line for each criterion that fails, with whose it is."""
    return [
        f"{whose}: {c.why}" + (f"; {c.note}" if c.note and c.note not in c.why else "")
        for c in criteria
        if c.fails
    ]
