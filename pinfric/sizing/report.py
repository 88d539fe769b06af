"""The report of a sizing: what each joint needs and gets, all its criteria, and the verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pinfric.checking.findings import errors, lines, remarks
from pinfric.drives.amplifier import amplifier_of
from pinfric.drives.brake import BRAKE, Standstill, standstills
from pinfric.drives.catalog import Catalog
from pinfric.drives.criterion import Criterion, Status, compare
from pinfric.drives.demand import DriveCycle, JointDemand
from pinfric.drives.drivetrain import Candidate, MotorCycle, bus_voltage
from pinfric.drives.duty import Schedule
from pinfric.drives.held import doubted_masses, held_drives, refuted_masses
from pinfric.drives.limits import AMPLIFIER_CURRENTS, SHOCK
from pinfric.drives.mounting import mounted
from pinfric.drives.policy import SURROUNDINGS, Conditions, outside, request
from pinfric.drives.power import BusPower, bus_power
from pinfric.drives.rated import RatedCycle
from pinfric.drives.robot import carried
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.elastic.motion import Elasticity, elasticity
from pinfric.errors import SizingError, choose_from
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.scene import Scene
from pinfric.model.upward import Shown
from pinfric.sizing.drive_search import Ask, Assessment, DriveSearch, momentary_peak
from pinfric.sizing.elastic_arm import arm_criteria, reversal_criteria
from pinfric.sizing.sensitivity import Sensitivity
from pinfric.sizing.task import brakes_of
from pinfric.sizing.verdict import JointState, JointVerdict, Verdict
from pinfric.stops.screen import ScreenedStops
from pinfric.stops.study import StopResult

#: Drives that fit, of which a report tells.
_ENOUGH = 12
#: Conditions of the whole robot.
_OF_ROBOT = ("lowest_frequency", "tool_sag", "tool_interval", "tool_reversal")
#: Of a rating alone, what its gear would bear in a stop, and what to do where it does not.
_OPEN_STOP = f"stop: {SHOCK}"
_OPEN_SOURCE = "algebra (`stops.peaks`), all brakes closing at once"
_DEMAND_STOPS = "give a cycle beside it, or `stops`"
_UNKNOWN_STOP = "drives do not determine the motion, so no algebra tells it: give `stops`"


@dataclass(frozen=True)
class JointSizing:
    """One joint's demand and choice.

    Attributes:
        demand, cycle: with the masses of all chosen drives.
        demand_without_masses: with the model as the scene has it.
        load_inertia: largest inertia about the joint over the cycle, kg m^2 (kg), the other drives
            at rest; None in a loop whose drives do not determine it.
        motor: the shaft of the drive taken, sample by sample; None without one.
        choice: the lightest that fits; None if none fits.
        nearest: if none fits, a provisional drive (`would` is not empty), else the one with the
            smallest shortfall, none beyond -1000 %.
        nothing_because: why there are no candidates; otherwise empty.
        unloaded: the joint moves no mass, and gets no drive (`model.massless`).
        search: of the drives that were looked at.
        decided: with a rating, whose means leave the least of the drive: the cycle's, or its own.
        alone: with a rating beside a cycle: the drive of each of the two alone; None: none fits.
        mountings: of several mountings, by name, RMS and peak effort; empty: there is one.
    """

    demand: JointDemand
    cycle: DriveCycle
    demand_without_masses: JointDemand
    load_inertia: float | None
    motor: MotorCycle | None = None
    choice: Assessment | None = None
    nearest: Assessment | None = None
    nothing_because: str = ""
    unloaded: bool = False
    search: DriveSearch | None = field(default=None, repr=False, compare=False)
    decided: str = ""
    alone: Mapping[str, Assessment | None] = field(default_factory=dict)
    mountings: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The drive's name."""
        return self.demand.name

    @property
    def installed(self) -> Assessment | None:
        """The drive whose mass is in the model: the choice, or the closest candidate."""
        return self.choice or self.nearest

    @property
    def decided_by(self) -> str:
        """Which of cycle and rating alone takes the heavier drive; "" where only one is given."""
        if len({a and a.name for a in self.alone.values()}) == 1:
            return "both"
        mass = {n: np.inf if a is None else a.mass for n, a in self.alone.items()}
        return max(mass, key=lambda name: mass[name] or 0.0, default="")

    @property
    def candidates(self) -> int:
        """Number of drives of the catalogue whose parts go together."""
        return 0 if self.search is None else self.search.arrays.count

    @cached_property
    def alternatives(self) -> tuple[Assessment, ...]:
        """The lightest drives that fit, the choice left out."""
        fitting = [] if self.search is None or self.choice is None else self.search.fitting(_ENOUGH)
        mine = self.choice and self.choice.name
        return tuple(a for a in fitting if a.name != mine)

    @cached_property
    def next_smaller(self) -> Assessment | None:
        """The drive lighter than the choice with the smallest shortfall."""
        if self.search is None or self.choice is None:
            return None
        return self.search.nearest(below=self.choice.mass or np.inf)

    @cached_property
    def ask(self) -> tuple[Ask, ...]:
        """Products lighter than the choice that might do but cannot be signed."""
        if self.search is None:
            return ()
        mass = None if self.choice is None else self.choice.mass
        return self.search.ask(np.inf if mass is None else mass)

    @cached_property
    def assessments(self) -> tuple[Assessment, ...]:
        """The drives judged in full: those that fit by mass, then margin; others, nearest first.

        Of a small catalogue all; else the lightest that fit, the next smaller or the nearest.
        """
        if self.search is None:
            return ()
        beside = (self.installed, *self.alternatives, self.next_smaller, *self.search.all_of_few())
        by_name = {a.name: a for a in reversed(beside) if a is not None}
        order = {a.name: k for k, a in enumerate((self.choice, *self.alternatives)) if a}
        return tuple(
            sorted(
                by_name.values(),
                key=lambda a: (
                    order.get(a.name, len(order)),
                    bool(a.lacks or a.unknown),
                    -a.margin,
                    a.name,
                ),
            )
        )

    @property
    def no_fit(self) -> str:
        """That no drive fits, and the shortfall of the nearest one; otherwise empty."""
        if self.choice is not None or (self.search is None and not self.nothing_because):
            return ""
        if self.search is None or not self.candidates:
            return f"{self.name}: no candidates: {self.nothing_because}"
        none = f"{self.name}: none of {counted(self.candidates, 'candidate')} fits"
        failed = () if self.nearest is None else self.nearest.failed
        if not np.isnan(self.search.case.stop_effort) and any(c.name == SHOCK for c in failed):
            none = f"{self.name}: no gear of the catalogue bears the stop"
        if self.nearest is not None and self.nearest.would:
            of = counted(self.candidates, "candidate")
            of += " that its link can hold" * bool(np.isfinite(self.search.parts.most))
            name, asked = self.nearest.name, request(self.nearest.lacks, self.nearest.kind)
            return f"{self.name}: none of {of} can be signed; {name} is provisional: {asked}"
        if self.nearest is not None:
            name = self.nearest.name
            return f"{none}; the closest candidate is {name}: {self.nearest.why}"
        if self.ask:
            first = self.ask[0]
            return (
                f"{none}; {first.name} cannot be signed: {request(first.figures, first.kind)} "
                f"(its other figures: {first.source})"
            )
        closest = self.search.nearest(worst=-np.inf)
        if closest is None:
            return "; ".join([none, *(f"{a.name} {a.why}" for a in self.assessments[:1])])
        why = f"{closest.name}: {closest.failed[0].why}"
        return f"{none}; all miss by more than a factor of ten: {why}"


@dataclass(frozen=True)
class SizingReport(Shown):
    """The demand of a cycle on every drive, and the drives chosen for it.

    Attributes:
        scene: with the chosen drives; the given one without a catalogue. given: as it was given.
        trajectory: source of the motion. files: scene, URDF, cycles and catalogue.
        catalog: None: demand only. conditions: of operation.
        joints: in the order of the scene's drives.
        result, result_without_masses: inverse dynamics of `scene`, and without the drives' masses.
        duty: the samples of each cycle of the period, and the number of its runs.
        passes: answers until no question of the choice had a new one (`sizing.choice`). settled:
            whether that was reached.
        other_mass: where the scene does not say whether its links hold the drives: mass of the
            drives that would be chosen if they do, kg; None: it says, or the links are too light.
        lighter: by column, drives that weigh no more than what they move, where those chosen
            outweigh it: provisional ones, too; empty: there are none.
        contradiction: that links are said to hold drives that outweigh them; these were then added.
        assumptions: of the sizing, in sentences.
        unclosed: states that differ between end and start of the cycle; empty if it closes.
        screened: stops with the chosen drives and their brakes, as far as they decide; None: none,
            or the scene has no `stops`.
        no_stops: why the stops that the scene asks for could not be judged; else "".
        rating: what the robot is rated for, beside a cycle or alone; None: a cycle alone.
        elsewhere: scenes in which the robot is mounted otherwise, for which the drives are, too.
        bodies: inertias of payloads that were guessed, and as what, by their places in the scene.
        point_mass: mass of the drives if these payloads were points, kg; None: no choice, or none.
        beyond: joints that the cycle moves faster or farther than the URDF allows, and assemblies
            of loops that a search chose, in words.
        open_stops: by column, what the gears would bear in stops, N m or N, which the choice does
            not use: of a rating alone; NaN where brakes may close and no algebra tells it.
        sensitivity: by which factors on loads the choice changes; empty: not asked for.
    """

    scene: Scene
    given: Scene
    trajectory: str
    files: tuple[str, ...]
    catalog: Catalog | None
    conditions: Conditions
    joints: tuple[JointSizing, ...]
    result: InverseResult
    result_without_masses: InverseResult
    duty: Schedule
    passes: int
    settled: bool
    other_mass: float | None = None
    lighter: Mapping[int, Assessment] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()
    unclosed: tuple[str, ...] = ()
    screened: ScreenedStops | None = None
    no_stops: str = ""
    contradiction: str = ""
    rating: RatedCycle | None = None
    elsewhere: tuple[str, ...] = ()
    bodies: Mapping[str, str] = field(default_factory=dict)
    point_mass: float | None = None
    beyond: tuple[str, ...] = ()
    open_stops: Mapping[int, float] = field(default_factory=dict)
    sensitivity: tuple[Sensitivity, ...] = ()

    def __repr__(self) -> str:
        names = [joint.name for joint in self.joints]
        peaks = [f"{joint.demand.peak:.3g} {joint.demand.unit}" for joint in self.joints]
        chosen = [(j.name, j.choice.name) for j in self.joints if j.choice is not None]
        settled = "settled" if self.settled else "not settled"
        facts = {"peaks": listed(names, peaks)}
        if self.catalog is not None:
            facts |= {
                "catalog": file_name(self.catalog.source),
                "drives": listed([n for n, _ in chosen], [f"-> {d}" for _, d in chosen]) or "none",
                "misses": listed([joint.name for joint in self.joints if joint.no_fit]),
                "mass": (f"{self.verdict.mass:.3g} kg of drives" if chosen else "no drive fits")
                + f"; {settled} after "
                + counted(self.passes, "round"),
            }
        title = (
            f"{file_name(self.given.source)} · {file_name(self.trajectory)}: {self.period:.4g} s"
        )
        return screen("SizingReport", title, {**facts, "more": ".summary() .plot() .joint(name)"})

    @property
    def period(self) -> float:
        """Duration (s) of the repeated period: the cycle, or a duty's cycles and its time off."""
        t = self.duty.stretched(self.result.times)
        return float(t[-1] - t[0])

    @property
    def drives(self) -> tuple[Candidate | None, ...]:
        """The drives in the model, in the order of `joints`; None where there is none."""
        taken = (joint.installed for joint in self.joints)
        return tuple(None if assessment is None else assessment.candidate for assessment in taken)

    @property
    def drive_mass(self) -> float:
        """Mass of all drives taken, kg."""
        return sum(drive.mass or 0.0 for drive in self.drives if drive)

    def of_drive(self, k: int) -> tuple[Criterion, ...]:
        """Return the criteria of one joint's drive and its amplifier."""
        taken = self.joints[k].installed
        own = () if taken is None else taken.criteria
        return tuple(_fed(c, *self.amplifiers[k]) for c in own)

    @cached_property
    def criteria(self) -> tuple[tuple[Criterion, ...], ...]:
        """All criteria of each joint: of its drive, brake, reversal error, stop and place."""
        by_joint = []
        for k in range(len(self.joints)):
            own = self.of_drive(k)
            still = () if self.catalog is None else self.standstills[k].criteria
            stop = () if self.screened is None else self.screened.criteria[k]
            named = (replace(c, name=f"stop: {c.name}") for c in stop)
            others = (*named, *_open_stop(self, k), *_shared(self, k))
            by_joint.append((*own, *still, *self.reversals[k : k + 1], *others))
        return tuple(by_joint)

    @property
    def stops(self) -> StopResult | None:
        """All stops of the cycle, with times and ways: simulated when they are asked for.

        Raises:
            StopError: of `stop`.
        """
        return None if self.screened is None else self.screened.result

    @cached_property
    def amplifiers(self) -> tuple[tuple[str, str], ...]:
        """Amplifier of each joint, else why there is none: see `amplifier_of`."""
        known = {} if self.catalog is None else self.catalog.amplifiers
        return tuple(
            amplifier_of(joint.installed.candidate, joint.search.cases, known)
            if joint.installed is not None and joint.search is not None
            else ("", "no drive")
            for joint in self.joints
        )

    @cached_property
    def verdict(self) -> Verdict:
        """Which joints can be signed, what fails, and where: see `verdict`."""
        joints = zip(self.joints, self.criteria, strict=True)
        whole = _failing("robot", self.arm_criteria)
        if self.catalog is None:
            alone = (line for joint, own in joints for line in _failing(joint.name, own))
            failing = [*alone, *whole, *errors(self.given.findings)]
            return Verdict((), tuple(failing), "", (*self.beyond, *remarks(self.given.findings)))
        # What the scene says of its masses
        masses = {i: drive.mass for i, drive in enumerate(self.drives) if drive}
        held = held_drives(self.given, masses, self.conditions.mass_in_urdf)
        heavy = doubted_masses(held)
        beyond = any(
            branch.share > 1.0 for branch in held
        )  # larger gears for the stops may be the last ones
        refuted = refuted_masses(self.given, masses, self.conditions.mass_in_urdf)
        impossible = [line for line in (self.contradiction, heavy * beyond, refuted) if line]
        unsigned = bool(impossible or self._refused)
        judged = tuple(_of_joint(joint, own, unsigned) for joint, own in joints)
        failing = [line for joint in judged for line in joint.failing]
        # Of the robot as a whole: findings, the choice, masses, the bus, the stops
        failing += self._refused
        if not self.settled:
            failing.append(f"the choice still alternates after {self.passes} rounds")
        failing += [*impossible, *self._causes[len(self._refused) :]]
        failing += [*_failing("bus", self.bus.criteria), *whole]
        failing += [self.no_stops] if self.no_stops else []
        # What it leaves open
        question, same, holds = "", "", self.given.masses_hold
        unsaid = [i for i in masses if holds[i] is None and carried(self.given, i)]
        if self.other_mass not in (None, self.drive_mass):
            unknown = [j.name for j, hold in zip(self.joints, holds, strict=True) if hold is None]
            whose = f" of {', '.join(unknown)}" if len(unknown) < len(holds) else ""
            question = (
                f"{self.drive_mass:.2f} kg if the links are bare, {self.other_mass:.2f} kg if they "
                f"hold the drives{whose}: write `robot.masses`"
            )
        elif unsaid and not refuted:
            same = "robot.masses is not written: " + (
                "the links are too light to hold the drives, which are added to them"
                if self.other_mass is None
                else "the same drives are chosen if the links hold them"
            )
        if any(c.name == _OPEN_STOP and c.fails and c.scaled for own in self.criteria for c in own):
            open_stop = f"of a rating alone stops are not demanded: {_DEMAND_STOPS}"
            question = "; ".join(text for text in (question, open_stop) if text)
        open_ = [text for text in (same, "" if beyond else heavy) if text]
        doubted = remarks(f for f in self.given.findings if not f.refuses)
        return Verdict(judged, tuple(failing), question, (*open_, *doubted))

    @cached_property
    def _refused(self) -> tuple[str, ...]:
        """Findings on scene, robot and cycle beside which nothing is signed, in words."""
        return (*lines(f for f in self.given.findings if f.refuses), *self.beyond)

    @cached_property
    def _causes(self) -> tuple[str, ...]:
        catalog, conditions = self.catalog, self.conditions
        if catalog is None:
            return ()
        reasons, pairs = [*self._refused], tuple(zip(self.joints, self.criteria, strict=True))
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
        if outer and any(joint.choice is None and not joint.unloaded for joint in self.joints):
            named = ", ".join(
                k + " gears" if k not in ("motor", "amplifier") else k + "s" for k in outer
            )
            reasons.append(
                f"conditions.ambient = {conditions.ambient:g} C: {named} lack "
                f"{outside(outer[0], conditions)[0]}, and none is signed: give the temperature at "
                "the drives"
            )
        return tuple(reasons)

    @cached_property
    def standstills(self) -> tuple[Standstill, ...]:
        """Holding of each joint without power, and its brake; in the order of `joints`."""
        catalog = self.catalog or Catalog("no catalogue")
        drives = () if self.catalog is None else self.drives
        brakes = brakes_of(catalog, self.given, self.conditions)
        return standstills(self.result, brakes, self.conditions, drives)

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions, and which figures of brakes the catalogue lacks."""
        notes = (drive.brake_note for drive in self.drives if drive)
        brakes = dict.fromkeys(note for note in notes if ": " in note)
        text = f"Not printed of brakes: {'; '.join(brakes)}."
        if self.catalog is None:
            return self.assumptions
        how = mounted(self.given, self.conditions.mounting == "any", self.elsewhere)
        return (*self.assumptions, how, *[text] * bool(brakes))

    @cached_property
    def elastic(self) -> Elasticity | None:
        """Effects of the gears' elasticity over the cycle; None if no stiffness is known."""
        return elasticity(self.result) if self.scene.elastic else None

    @cached_property
    def arm_criteria(self) -> tuple[Criterion, ...]:
        """Criteria of the whole robot: lowest frequency, position of the tool at rest."""
        asked = any(getattr(self.conditions, key) is not None for key in _OF_ROBOT)
        return arm_criteria(self.scene, self.elastic, self.conditions) if asked else ()

    @cached_property
    def reversals(self) -> tuple[Criterion, ...]:
        """Reversal error of each joint, in the order of `joints`; none where not asked for."""
        if self.conditions.reversal_error is None:
            return ()
        backlash = [drive.backlash if drive else None for drive in self.drives]
        return reversal_criteria(self.scene, self.elastic, self.conditions, backlash)

    @cached_property
    def bus(self) -> BusPower:
        """Power of all chosen drives from their bus, and power fed back."""
        on_bus = [j for j in self.joints if j.installed is None or j.installed.candidate.on_bus]
        drives = {joint.name: joint.motor for joint in on_bus}
        voltages = {
            joint.name: bus_voltage(joint.installed.candidate, joint.motor, self.conditions)
            for joint in on_bus
            if joint.installed is not None and joint.motor is not None
        }
        return bus_power(drives, self.result.times, self.duty, self.conditions, voltages)

    def check(self) -> None:
        """Raise if the choice cannot be signed; without a catalogue, if a criterion fails.

        Raises:
            SizingError: names what fails, where, and by how much; holds the report.
        """
        if wrong := self.verdict.failing:
            raise SizingError("; ".join(self._causes or wrong), self)

    @property
    def not_checked(self) -> int:
        """Number of criteria that lack a figure, of all drives in the model."""
        return sum(c.unchecked for k in range(len(self.joints)) for c in self.of_drive(k))

    def joint(self, name: str) -> JointSizing:
        """Return one joint's sizing by name.

        Raises:
            SizingError: there is none of that name.
        """
        joints = {joint.name: joint for joint in self.joints}
        if name not in joints:
            raise SizingError(f"there is no drive {name!r}; {choose_from(name, joints)}")
        return joints[name]


def _fed(criterion: Criterion, amplifier: str, why: str) -> Criterion:
    """The row of a drive for which the conditions name no amplifier: that of the catalogue."""
    if criterion.name != AMPLIFIER_CURRENTS:
        return criterion
    if not amplifier:
        return replace(criterion, note=why, missing=f"{why}: conditions.amplifiers")
    said = f"{amplifier}, the smallest of the catalogue that feeds it"
    return replace(criterion, status=Status.PASSES, note=said, missing="")


def _open_stop(report: SizingReport, k: int) -> list[Criterion]:
    """What the gear of a rating alone would have to bear if brakes close."""
    taken = report.joints[k].installed
    if taken is None or k not in report.open_stops:
        return []
    bears, peak = momentary_peak(taken), report.open_stops[k]
    factor = report.conditions.stop_factor
    formula = f"{factor:g} x the peak in stops of all joints <= limit for momentary peak torque"
    if np.isnan(peak):
        figures = None, None, "", None, formula, _OPEN_SOURCE, _UNKNOWN_STOP
        judged = Criterion(_OPEN_STOP, Status.FAILS, *figures)
        return [judged] * (report.screened is None)
    judged = compare(
        _OPEN_STOP,
        peak,
        None if np.isnan(bears) else bears,
        report.joints[k].demand.unit,
        formula,
        _OPEN_SOURCE,
        "momentary_peak_torque of the gear",
    )
    fails = judged.fails
    return [replace(judged, note=_DEMAND_STOPS) if fails else judged]


def _shared(report: SizingReport, k: int) -> list[Criterion]:
    """Whether a joint has the drive of its group."""
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
    """`doubted`: by the scene's masses nothing can be signed."""
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
    return [
        f"{whose}: {c.why}" + (f"; {c.note}" if c.note and c.note not in c.why else "")
        for c in criteria
        if c.fails
    ]
