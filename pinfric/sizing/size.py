"""Motor sizing: the demand of a cycle on each drive, and the drives of a catalogue that fit."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pinfric.drives.brake import Standstill, standstills
from pinfric.drives.catalog import Catalog
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Criterion
from pinfric.drives.demand import DriveCycle, JointDemand, driven_joint, joint_demand
from pinfric.drives.drivetrain import Candidate, MotorCycle, line_voltage, motor_cycle
from pinfric.drives.duty import Duty, Schedule
from pinfric.drives.limit import JointCase
from pinfric.drives.limits import SHOCK
from pinfric.drives.mounting import mounted
from pinfric.drives.parts import check_names, own_parts
from pinfric.drives.policy import Conditions, parse_conditions, request
from pinfric.drives.power import BusPower, bus_power
from pinfric.drives.rated import RatedCycle
from pinfric.drives.robot import carried, equip
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import MotionLike
from pinfric.elastic.motion import Elasticity, elasticity
from pinfric.errors import PinfricWarning, SizingError, StopError, choose_from
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.schema import OTHERS
from pinfric.model.upward import Shown
from pinfric.motions.rating import Rating, rate
from pinfric.motions.summary import beyond_limits, effort_unit, rms
from pinfric.sizing.caveats import caveats, discontinuities, unclosed
from pinfric.sizing.choice import (
    Demanded,
    DriveChoice,
    Task,
    bearing_stops,
    brakes_of,
    cases,
    contradiction,
    light_enough,
    overloaded,
    search_at,
    task_of,
)
from pinfric.sizing.drive_search import Ask, Assessment, DriveSearch
from pinfric.sizing.elastic_arm import arm_criteria, check_tool, reversal_criteria
from pinfric.sizing.verdict import Verdict, causes, joint_criteria, verdict_of
from pinfric.stops.machines import Machines, full_load, stop_settings
from pinfric.stops.study import StopResult, stops_of

#: How often a choice whose simulated stops overload a gear is made anew, and by which factor more
#: than its peak the gear must then bear.
_STOPPED_AGAIN, _STOP_RESERVE = 2, 1.02
#: Drives that fit, of which a report tells.
_ENOUGH = 12


@dataclass(frozen=True)
class JointSizing:
    """One joint's demand and choice.

    Attributes:
        demand, cycle: with the mass of all chosen drives in the model.
        demand_without_masses: with the model as the scene has it.
        load_inertia: largest inertia about the joint over the cycle, kg m^2 (kg); None where
            closed loops couple the joints.
        motor: the shaft of the drive taken, sample by sample; None without one.
        choice: the lightest that fits; None if none fits.
        nearest: if none fits, a provisional drive (its `would` is not empty), else the candidate
            with the smallest shortfall, none beyond -1000 %.
        nothing_because: why there are no candidates, if a catalogue was given; otherwise empty.
        unloaded: the joint moves no mass, and gets no drive (`model.massless`).
        search: of the drives that were looked at.
        decided: with a rating, whose means leave the least of the drive: the cycle's, or its own.
        alone: with a rating beside a cycle: what each of the two alone would take; None: nothing.
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
        """State that no drive fits, and the shortfall of the nearest one; otherwise empty."""
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
        scene: with the chosen drives' masses and transmissions; the given one without a catalogue.
        given: the scene as it was given.
        trajectory: source of the motion. files: scene, URDF, cycles and catalogue.
        catalog, conditions: the catalogue and the conditions; catalog None: demand only.
        joints: in the order of the scene's drives.
        result, result_without_masses: inverse dynamics of `scene`, and without the drives' masses.
        duty: the samples of each cycle of the period, and the number of its runs.
        passes: over all joints until no choice changed. settled: no choice changed in the last.
        other_mass: where the scene does not say whether its links hold the drives: mass of the
            drives that would be chosen if they do, kg; None: it says, or the links are too light
            for them.
        contradiction: that links are said to hold drives that outweigh them; these were then added.
        assumptions: of the sizing, in sentences.
        unclosed: states that differ between end and start of the cycle; empty if it closes.
        stops: with the chosen drives and their brakes; None: none, or the scene has no `stops`.
        no_stops: why the stops that the scene asks for could not be judged; "" where they were.
        rating: what the robot is rated for, beside a cycle or alone; None: a cycle alone.
        elsewhere: scenes in which the robot is mounted otherwise, for which the drives are, too.
        open_stops: of a rating alone, by the drives' columns: what the gears would have to bear in
            stops, N m or N; no drive was chosen by it. Empty: it was demanded.
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
    assumptions: tuple[str, ...] = ()
    unclosed: tuple[str, ...] = ()
    stops: StopResult | None = None
    no_stops: str = ""
    contradiction: str = ""
    rating: RatedCycle | None = None
    elsewhere: tuple[str, ...] = ()
    open_stops: Mapping[int, float] = field(default_factory=dict)

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
                + counted(self.passes, "pass", "passes"),
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
        return tuple(None if one is None else one.candidate for one in taken)

    @property
    def drive_mass(self) -> float:
        """Mass of all drives taken, kg."""
        return sum(drive.mass or 0.0 for drive in self.drives if drive)

    @cached_property
    def criteria(self) -> tuple[tuple[Criterion, ...], ...]:
        """All criteria of each joint: of its drive, brake, reversal error, stop and place."""
        return joint_criteria(self)

    @cached_property
    def verdict(self) -> Verdict:
        """Which joints can be signed, what fails, and where: see `sizing.verdict`."""
        return verdict_of(self)

    @cached_property
    def standstills(self) -> tuple[Standstill, ...]:
        """Holding of each joint without power, and its brake; in the order of `joints`."""
        catalog = self.catalog or Catalog("no catalogue")
        drives = () if self.catalog is None else self.drives
        return standstills(self.result, brakes_of(catalog, self.given), self.conditions, drives)

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions, and what of the needed brakes is not known."""
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
        drives = {joint.name: joint.motor for joint in self.joints}
        voltages = {
            joint.name: line_voltage(joint.installed.candidate.ratings, joint.motor)
            for joint in self.joints
            if joint.installed is not None and joint.motor is not None
        }
        return bus_power(drives, self.result.times, self.duty, self.conditions, voltages)

    def check(self) -> None:
        """Raise if the choice cannot be signed; without a catalogue, if a criterion fails.

        Raises:
            SizingError: names what fails, where, and by how much; holds the report.
        """
        if wrong := self.verdict.failing:
            raise SizingError("; ".join(causes(self) or wrong), self)

    @property
    def not_checked(self) -> int:
        """Number of criteria that lack a figure, of all drives in the model."""
        return sum(len(joint.installed.not_checked) for joint in self.joints if joint.installed)

    def joint(self, name: str) -> JointSizing:
        """Return one joint's sizing by name.

        Raises:
            SizingError: there is none of that name.
        """
        joints = {joint.name: joint for joint in self.joints}
        if name not in joints:
            raise SizingError(f"there is no drive {name!r}; {choose_from(name, joints)}")
        return joints[name]


#: Conditions of the whole robot.
_OF_ROBOT = ("lowest_frequency", "tool_sag", "tool_interval", "tool_reversal")


def size(
    scene: Scene,
    trajectory: MotionLike | Duty | None = None,
    catalog: Catalog | str | Path | None = None,
    *,
    rating: Rating | Mapping[str, Any] | None = None,
    conditions: Conditions | Mapping[str, Any] | None = None,
    on_miss: Literal["warn", "raise", "ignore"] = "warn",
    progress: Callable[[str], object] | None = None,
) -> SizingReport:
    """Return the demand of a repeated cycle on each drive, and the drives of a catalogue that fit.

    For every joint, from its effort interval (paper eq. 16, 17; at rest 21, 22): peak, RMS, power,
    holding and break-away effort. With a catalogue: of every motor with every gear that it goes
    with, the lightest that meets all `limits.LIMITS` and of which every figure of `policy.NEEDS` is
    known, tip to base, with the chosen drives' mass in the model; with `lowest_frequency` the
    lightest set that swings no slower.

    Args:
        scene: the robot with its friction. Its `robot.masses` says whether the links hold the
            drives; if not, these are added. The candidates replace its transmissions.
        trajectory: one cycle, with times; it is repeated without a pause. If it does not end as
            it began, `SizingReport.unclosed` and a note say so. Several cycles: as a `Duty`. None:
            by the rating alone.
        catalog: a `Catalog`, a file, "default" for the bundled one, or None for the demand only.
        rating: what the arm is built for before it has a cycle, `{"payload": 10}` (kg): this
            payload is held in the worst posture of each joint and lifted from there by it alone
            (`motions.rating`). Beside a cycle each joint gets what bears both.
        conditions: in place of the catalogue's: a mapping, or what was set in a `Conditions`.
        on_miss: what to do if no candidate fits a joint; the report says so in any case.
        progress: called with a line of text at each step.

    Raises:
        CatalogError: the catalogue or a condition is wrong; StateError: the motion has no times;
        TrajectoryError: a rating that the robot cannot have;
        SizingError: a catalogue and no gravity; without `mass_in_urdf` a link is not a possible
        body; or the choice cannot be signed and `on_miss` is "raise".

    Warns:
        PinfricWarning: no candidate fits a joint; with the shortfall of the nearest one.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> motion = pf.load_trajectory("pendulum", scene)
    >>> round(pf.size(scene, motion).joints[0].demand.peak, 2)
    5.36
    """
    expect_scene(scene, "size")
    if isinstance(catalog, str | Path):
        catalog = load_catalog(catalog)
    if catalog is not None and not scene.model.gravity.linear.any():
        raise SizingError(
            f"{scene.source}: robot.gravity is [0, 0, 0]: drives and brakes chosen so would not "
            "bear the robot's weight; give the gravity, or size without a catalogue"
        )
    default = Conditions() if catalog is None else catalog.conditions
    wanted = parse_conditions(conditions or {}, default)
    check_names(scene, wanted)
    check_tool(scene, wanted)
    for joint in wanted.bearings:
        linear = effort_unit(scene, scene.actuator_names.index(joint)) == "N"
        own_parts(catalog or Catalog("no catalogue"), wanted, joint, linear)
    tell = progress or (lambda _: None)
    rated = None if rating is None else rate(scene, rating)
    report = _sized(task_of(scene, trajectory, catalog, wanted, tell, rated))
    if rated is not None and trajectory is not None and catalog is not None:
        with warnings.catch_warnings():  # said already of both together
            warnings.simplefilter("ignore", PinfricWarning)
            apart = {
                "cycle": bearing_stops(task_of(scene, trajectory, catalog, wanted, tell)),
                "rating": bearing_stops(task_of(scene, None, catalog, wanted, tell, rated)),
            }
        joints = (
            replace(joint, alone={name: choice.fitting(i) for name, choice in apart.items()})
            for i, joint in enumerate(report.joints)
        )
        report = replace(report, joints=tuple(joints))
    if on_miss == "raise":
        report.check()
    for text in report.verdict.failing if on_miss == "warn" else ():
        warnings.warn(text, PinfricWarning, stacklevel=2)
    return report


def _sized(task: Task) -> SizingReport:
    """Choose until no choice changes, and report; with stops, until gears bear them.

    One simulation of the stops judges the choice; what it finds too weak must bear a little
    more than it says, and the choice begins anew, twice at most.
    """
    choice = bearing_stops(task)
    impossible = contradiction(task, choice.taken)
    if impossible and (light := light_enough(task, choice)) is not None:
        choice, impossible = light
    elif impossible:
        task, mass = task.with_masses("without_drives"), choice.mass
        choice = bearing_stops(task)
        impossible += f"; {mass:.2f} kg of drives so, {choice.mass:.2f} kg where added"
    for again in range(_STOPPED_AGAIN + 1):
        report = _report(task, choice, impossible)
        stops, why = _stopped(task, report)
        axes = () if stops is None else stops.axes
        short = overloaded({i: axis.peak for i, axis in enumerate(axes)}, choice.taken)
        if not short or again == _STOPPED_AGAIN:
            break
        more = {i: _STOP_RESERVE * peak for i, peak in short.items()}
        least = {**choice.demanded.least, **more}
        efforts = {**choice.demanded.efforts, **least}
        choice = bearing_stops(task, replace(choice.demanded, efforts=efforts, least=least))
    return replace(report, stops=stops, no_stops=why, other_mass=_other_mass(task, choice))


def _report(task: Task, choice: DriveChoice, impossible: str) -> SizingReport:
    """The report of a choice, without its stops."""
    joints = tuple(_joint(task, choice, i) for i in range(len(task.scene.drives)))
    chosen = {i: a.candidate for i, a in choice.taken.items()}
    equipped = equip(task.scene, chosen, task.conditions) if chosen else task.scene
    without, rating = task.robot.base.result, task.rating
    cycles = rating is None or rating.duty is not None
    gaps = unclosed(without, task.duty) if cycles else ()
    source = str(getattr(task.motion, "source", "motion"))
    return SizingReport(
        scene=equipped,
        given=task.given,
        catalog=task.catalog,
        conditions=task.conditions,
        trajectory=source if rating is None else rating.source,
        files=task.files,
        joints=joints,
        result=inverse_dynamics(equipped, task.motion) if chosen else without,
        result_without_masses=without,
        duty=task.duty,
        passes=choice.passes,
        settled=choice.settled,
        assumptions=caveats(
            task.given,
            task.catalog,
            gaps,
            discontinuities(without, task.duty) if cycles else (),
            beyond_limits(without),
        ),
        unclosed=gaps,
        contradiction=impossible,
        rating=rating,
        elsewhere=tuple(task.elsewhere),
        open_stops=choice.open_stops,
    )


def _other_mass(task: Task, choice: DriveChoice) -> float | None:
    """Mass of the drives if the links hold them; None: as `SizingReport.other_mass`."""
    scene = task.scene
    names, holds = scene.actuator_names, scene.masses_hold
    if not any(holds[i] is None and carried(scene, i) for i in choice.taken):
        return None
    bare = {n: "without_drives" for n, hold in zip(names, holds, strict=True) if hold is False}
    other = task.with_masses({**bare, OTHERS: "with_drives"})
    held = bearing_stops(other, Demanded(most=choice.demanded.most))
    return None if contradiction(other, held.taken) else held.mass


def _stopped(task: Task, report: SizingReport) -> tuple[StopResult | None, str]:
    """The stops with the chosen drives and brakes, or why there are none."""
    if task.scene.stops is None or task.catalog is None or any(j.no_fit for j in report.joints):
        return None, ""
    if not task.stops_once:
        what = "judged for one cycle, not for a duty of several or a rating alone"
        return None, f"stops: {what}"
    names = sorted({drive.brake for drive in report.drives if drive} - {""})
    if slow := [n for n in names if task.catalog.brakes[n].engage_time is None]:
        return None, (
            f"stops: {', '.join(slow)} of the catalogue has no `engage_time`; give it the time "
            "(s) from power-off until it holds, as its maker states it"
        )
    task.progress("stops of the chosen drives")
    motion = task.one_cycle(report.scene, task.robot)
    pairs = zip(report.joints, report.drives, strict=True)
    products = {joint.name: drive.name for joint, drive in pairs if drive}
    load, settings = full_load(report.scene, motion), stop_settings(report.scene, None)
    try:
        return stops_of(Machines(report.scene, settings, load, products), motion), ""
    except StopError as problem:
        return None, str(problem)


def _joint(task: Task, choice: DriveChoice, i: int) -> JointSizing:
    """The joint with all chosen drives in the model."""
    masses, drive = task.added(choice.taken), choice.taken.get(i)
    of_joint = cases(task, i, masses, choice.demanded)
    search = search_at(task, i, masses, choice.demanded)
    # other scenes have motions of their own, which the tables do not show
    shown = {key: c for key, c in of_joint.items() if key[1] not in task.elsewhere}
    same = {
        n: c for n, c in shown.items() if drive and c.cycle.duty == drive.drives.case.cycle.duty
    }
    decided, case = next(iter((same or shown).items()))
    robot = task.robots[decided[1]]
    demand = replace(joint_demand(robot.result, i, case.cycle), speed=case.demand.speed)
    base = robot.base.result
    motor = None
    if drive is not None and drive.motor is not None:
        motor = motor_cycle(drive.candidate, case.cycle, task.conditions)
    return JointSizing(
        demand,
        case.cycle,
        joint_demand(base, i, robot.cycle(i, case.cycle.duty)) if masses else demand,
        case.load_inertia,
        motor,
        choice=drive if drive is not None and drive.fits else None,
        nearest=drive if drive is not None and not drive.fits else None,
        nothing_because="" if search and search.arrays.count else _no_candidates(task, i),
        unloaded=task.is_unloaded(i),
        search=search,
        decided=" ".join(words for words in decided if words),
        mountings=_by_mounting(task, of_joint),
    )


def _by_mounting(
    task: Task, of_joint: Mapping[tuple[str, str], JointCase]
) -> dict[str, tuple[float, float]]:
    """RMS and peak effort of a joint in each mounting; empty: there is one."""
    largest: dict[str, tuple[float, float]] = {}
    for (_, mounting), case in of_joint.items() if len(task.robots) > 1 else ():
        words = mounting or file_name(task.scene.source)
        before, worst = largest.get(words, (0.0, 0.0)), case.cycle.ends[0]
        now = rms(case.cycle.stretched, worst), float(np.abs(worst).max())
        largest[words] = max(before[0], now[0]), max(before[1], now[1])
    return largest


def _no_candidates(task: Task, i: int) -> str:
    """Why there are no candidates; empty without a catalogue, or where none is asked for."""
    catalog = task.catalog
    if catalog is None or task.is_unloaded(i):
        return ""
    if driven_joint(task.scene, i) is None:
        return "motors and gears are for joints with one axis, not for cylinders and forces"
    if not catalog.motors and not catalog.gearmotors:
        return f"{catalog.source} has no motors"
    output = "linear" if effort_unit(task.scene, i) == "N" else "rotary"
    if any(gear.output == output for gear in catalog.gears.values()):
        return (
            f"no motor of {catalog.source} goes with its gears: a frameless kit needs a "
            "strain wave gear, and a gear with `motors` one of these"
        )
    return f"{catalog.source} has no gear with a {output} output"
