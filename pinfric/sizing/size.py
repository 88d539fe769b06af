"""Motor sizing: the demand of a cycle on each drive, and the drives of a catalogue that fit.

Motors have mass. The motor and gear of joint j are held by the joint's parent link, with their mass
at the joint's origin (a point; their own moments of inertia and their offset from the axis are left
out), so they load the joints nearer to the base, not their own. Joints are therefore sized from the
tips to the base, each with the drives chosen beyond it in the model, and all over again until no
choice changes. The rotor's inertia acts on its own motor as r^2 J a; gyroscopic torques of rotors,
and their share in other joints' inertias, are left out (for ratio r: 1/r of it).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pinfric.drives.brake import Standstill, ranked, standstills
from pinfric.drives.catalog import Brake, Catalog
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Criterion
from pinfric.drives.demand import (
    DriveCycle,
    JointDemand,
    drive_cycle,
    driven_joint,
    joint_demand,
)
from pinfric.drives.drivetrain import Candidate, MotorCycle, line_voltage, motor_cycle
from pinfric.drives.duty import Duty, Schedule, once
from pinfric.drives.friction import without_drives
from pinfric.drives.held import held_drives
from pinfric.drives.limit import JointCase
from pinfric.drives.limits import SHOCK
from pinfric.drives.mounting import mounted, mountings, turned_as
from pinfric.drives.parts import check_names, own_parts
from pinfric.drives.policy import Conditions, parse_conditions, request
from pinfric.drives.power import BusPower, bus_power
from pinfric.drives.rated import RatedCycle
from pinfric.drives.robot import (
    DrivenRobot,
    added_masses,
    carried,
    equip,
    tip_to_base,
)
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import MotionLike
from pinfric.elastic.motion import Elasticity, elasticity
from pinfric.errors import PinfricWarning, SizingError, StopError, choose_from
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.massless import massless
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.schema import OTHERS, Stops
from pinfric.model.upward import Shown
from pinfric.motions.rating import Rated, Rating, rate
from pinfric.motions.summary import beyond_limits, effort_unit, rms
from pinfric.motions.trajectory import Trajectory
from pinfric.sizing.branch import SwingingArm, stiff_enough
from pinfric.sizing.caveats import caveats, discontinuities, unclosed
from pinfric.sizing.drive_search import (
    Ask,
    Assessment,
    CatalogArrays,
    DriveSearch,
    Parts,
    momentary_peak,
    stiffness_of,
)
from pinfric.sizing.elastic_arm import arm_criteria, check_tool, reversal_criteria
from pinfric.sizing.provisional import provisional
from pinfric.sizing.verdict import Verdict, causes, joint_criteria, verdict_of
from pinfric.stops.machines import Machines, full_load, stop_settings
from pinfric.stops.peaks import braking, cycle_peaks
from pinfric.stops.study import StopResult, stops_of

#: Passes over all joints before an alternating choice is given up; two are usual.
_MOST_PASSES = 12
#: Passes after which a choice that comes back is banned.
_PATIENCE = 4
#: How often a choice whose simulated stops overload a gear is made anew, and by which factor more
#: than its peak the gear must then bear. By which factor more than the peak by algebra, where no
#: simulation follows: simulated peaks are 0.68 to 1.15 of it, once 1.32.
_STOPPED_AGAIN, _STOP_RESERVE, _NOT_SIMULATED = 2, 1.02, 1.3
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
        if len({a and a.candidate.name for a in self.alone.values()}) == 1:
            return "both"
        mass = {n: np.inf if a is None else a.candidate.mass for n, a in self.alone.items()}
        return max(mass, key=lambda name: mass[name] or 0.0, default="")

    @property
    def candidates(self) -> int:
        """Number of drives of the catalogue whose parts go together."""
        return 0 if self.search is None else self.search.arrays.count

    @cached_property
    def alternatives(self) -> tuple[Assessment, ...]:
        """The lightest drives that fit, the choice left out."""
        found = [] if self.search is None or self.choice is None else self.search.fitting(_ENOUGH)
        mine = self.choice and self.choice.candidate.name
        return tuple(a for a in found if a.candidate.name != mine)

    @cached_property
    def next_smaller(self) -> Assessment | None:
        """The drive lighter than the choice with the smallest shortfall."""
        if self.search is None or self.choice is None:
            return None
        return self.search.nearest(below=self.choice.candidate.mass or np.inf)

    @cached_property
    def ask(self) -> tuple[Ask, ...]:
        """Products lighter than the choice that might do but cannot be signed."""
        if self.search is None:
            return ()
        mass = None if self.choice is None else self.choice.candidate.mass
        return self.search.ask(np.inf if mass is None else mass)

    @cached_property
    def assessments(self) -> tuple[Assessment, ...]:
        """The drives judged in full: those that fit by mass, then margin; others, nearest first.

        Of a small catalogue all; else the lightest that fit, the next smaller or the nearest.
        """
        if self.search is None:
            return ()
        beside = (self.installed, *self.alternatives, self.next_smaller, *self.search.all_of_few())
        found = {a.candidate.name: a for a in reversed(beside) if a is not None}
        order = {a.candidate.name: k for k, a in enumerate((self.choice, *self.alternatives)) if a}
        return tuple(
            sorted(
                found.values(),
                key=lambda a: (
                    order.get(a.candidate.name, len(order)),
                    bool(a.lacks or a.unknown),
                    -a.margin,
                    a.candidate.name,
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
            made, asked = self.nearest.candidate, request(self.nearest.lacks, self.nearest.kind)
            return f"{self.name}: none of {of} can be signed; {made.name} is provisional: {asked}"
        if self.nearest is not None:
            name = self.nearest.candidate.name
            return f"{none}; the closest candidate is {name}: {self.nearest.why}"
        if self.ask:
            first = self.ask[0]
            return (
                f"{none}; {first.name} cannot be signed: {request(first.figures, first.kind)} "
                f"(its other figures: {first.source})"
            )
        closest = self.search.nearest(worst=-np.inf)
        if closest is None:
            return "; ".join([none, *(f"{a.candidate.name} {a.why}" for a in self.assessments[:1])])
        why = f"{closest.candidate.name}: {closest.failed[0].why}"
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
        chosen = [(j.name, j.choice.candidate.name) for j in self.joints if j.choice is not None]
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
        found = self.elastic if asked else None
        return arm_criteria(self.scene, found, self.conditions) if asked else ()

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
    report = _Sizing(scene, trajectory, catalog, wanted, tell, rated).run()
    if rated is not None and trajectory is not None and catalog is not None:
        with warnings.catch_warnings():  # said already of both together
            warnings.simplefilter("ignore", PinfricWarning)
            apart = {
                "cycle": _Sizing(scene, trajectory, catalog, wanted, tell).choose(),
                "rating": _Sizing(scene, None, catalog, wanted, tell, rated).choose(),
            }
        joints = (
            replace(joint, alone={name: one.get(i) for name, one in apart.items()})
            for i, joint in enumerate(report.joints)
        )
        report = replace(report, joints=tuple(joints))
    if on_miss == "raise":
        report.check()
    for text in report.verdict.failing if on_miss == "warn" else ():
        warnings.warn(text, PinfricWarning, stacklevel=2)
    return report


class _Sizing:
    """One run of `size`."""

    def __init__(
        self,
        scene: Scene,
        trajectory: MotionLike | Duty | None,
        catalog: Catalog | None,
        conditions: Conditions,
        progress: Callable[[str], object],
        rated: Rated | None = None,
    ) -> None:
        self.motion: MotionLike
        duty, self.rating = None, None
        cycles = [c for c, _ in trajectory.cycles] if isinstance(trajectory, Duty) else [trajectory]
        if rated is not None:
            if isinstance(trajectory, Trajectory):
                trajectory = Duty(((trajectory, 1.0),))
            if not isinstance(trajectory, Duty | None):
                raise SizingError("beside a rating the cycle must be a Trajectory or a Duty")
            self.rating = RatedCycle.of(rated, trajectory)
            self.motion, duty, scene = self.rating.motion, self.rating.schedule, rated.scene
        elif isinstance(trajectory, Duty):
            self.motion, duty = trajectory.motion(), trajectory.schedule()
        elif trajectory is None:
            raise SizingError("give a cycle, or a rating: rating={'payload': 10} (kg)")
        else:
            self.motion = trajectory
        every = [drive.name for drive in scene.drives] if catalog is not None else ()
        self.given, self.scene, self.catalog = scene, without_drives(scene, every), catalog
        self.conditions, self.progress = conditions, progress
        self.robot = DrivenRobot(self.scene, self.motion, duty, conditions, self.rating)
        #: By how they are mounted: the scene's own "", then those that `mounting: any` asks for.
        self.robots = {"": self.robot}
        if conditions.mounting == "any":
            for words, gravity in mountings(self.scene).items():
                turned = self.scene.with_(gravity=gravity)
                self.robots[words] = DrivenRobot(turned, self.motion, duty, conditions, self.rating)
        self.elsewhere: dict[str, Duty] = {}
        for other, there in trajectory.elsewhere if isinstance(trajectory, Duty) else ():
            if rated is not None:
                raise SizingError(
                    "a rating beside cycles of other scenes: give the condition mounting=any, or "
                    "size without the rating"
                )
            words, gravity = turned_as(scene, other), other.model.gravity.linear
            if words in self.elsewhere:
                raise SizingError(f"duty: {words} is there twice; give all its cycles in one duty")
            if catalog is not None and not gravity.any():
                raise SizingError(f"{words}: robot.gravity is [0, 0, 0]; give the gravity")
            self.elsewhere[words] = there
            turned, schedule = self.scene.with_(gravity=gravity), there.schedule()
            self.robots[words] = DrivenRobot(turned, there.motion(), schedule, conditions)
            cycles += [cycle for cycle, _ in there.cycles]
        self.duty = duty or once(len(self.robot.result.states.q))
        robot = [] if scene.robot is None else [scene.robot.urdf]
        cycled = [getattr(cycle, "source", "") for cycle in cycles]
        made = () if catalog is None else catalog.files
        scenes = [scene.source, *(o.source for o, _ in getattr(trajectory, "elsewhere", ()))]
        self.files = tuple(str(f) for f in (*scenes, *robot, *cycled, *made))
        self.unloaded = massless(self.scene, self.scene.payloads)
        if self.unloaded.all():
            raise SizingError(
                f"{scene.source}: no link that moves has a mass, so there is nothing to size: give "
                "the URDF's links an <inertial>; `pinfric new URDF --mass KG` makes a start"
            )
        #: kg, that a drive may weigh.
        self.most = np.inf
        self.shelves: dict[bool, CatalogArrays] = {}
        self.banned: dict[int, set[str]] = {}
        #: By the drives' columns: efforts that gears must bear in stops, those of them that a
        #: simulation showed, and braking under power.
        self.stop_effort: dict[int, float] = {}
        self.stop_least: dict[int, float] = {}
        self.open_stops: dict[int, float] = {}
        self.stop_note = ""
        self.braking: dict[int, tuple[DriveCycle, ...]] = {}

    def run(self) -> SizingReport:
        """Choose until no choice changes, and report; with stops, until gears bear them.

        One simulation of the stops judges the choice; what it finds too weak must bear a little
        more than it says, and the choice begins anew, twice at most.
        """
        taken, passes, settled = self._bearing_stops()
        contradiction = self._contradiction(taken)
        if contradiction and (light := self._light(taken)) is not None:
            (taken, passes, settled), contradiction = light
        elif contradiction:
            mass = _mass(taken)
            self.given = replace(self.given, masses="without_drives")
            self.scene = replace(self.scene, masses="without_drives")
            self.banned, self.stop_effort = {}, {}
            taken, passes, settled = self._bearing_stops()
            contradiction += f"; {mass:.2f} kg of drives so, {_mass(taken):.2f} kg where added"
        for again in range(_STOPPED_AGAIN + 1):
            report = self._report(taken, passes, settled, contradiction)
            stops, why = self._stopped(report)
            axes = () if stops is None else stops.axes
            short = self._overloaded({i: axis.peak for i, axis in enumerate(axes)}, taken)
            if not short or again == _STOPPED_AGAIN:
                break
            self.stop_least |= {i: _STOP_RESERVE * peak for i, peak in short.items()}
            self.stop_effort |= self.stop_least
            taken, passes, settled = self._bearing_stops()
        return replace(report, stops=stops, no_stops=why, other_mass=self._other_mass(taken))

    def _report(
        self, taken: Mapping[int, Assessment], passes: int, settled: bool, contradiction: str
    ) -> SizingReport:
        """The report of a choice, without its stops."""
        joints = tuple(self._joint(i, taken) for i in range(len(self.scene.drives)))
        chosen = {i: a.candidate for i, a in taken.items()}
        equipped = equip(self.scene, chosen, self.conditions) if taken else self.scene
        without, rating = self.robot.base.result, self.rating
        cycles = rating is None or rating.duty is not None
        gaps = unclosed(without, self.duty) if cycles else ()
        source = str(getattr(self.motion, "source", "motion"))
        return SizingReport(
            scene=equipped,
            given=self.given,
            catalog=self.catalog,
            conditions=self.conditions,
            trajectory=source if rating is None else rating.source,
            files=self.files,
            joints=joints,
            result=inverse_dynamics(equipped, self.motion) if taken else without,
            result_without_masses=without,
            duty=self.duty,
            passes=passes,
            settled=settled,
            assumptions=caveats(
                self.given,
                self.catalog,
                gaps,
                discontinuities(without, self.duty) if cycles else (),
                beyond_limits(without),
            ),
            unclosed=gaps,
            contradiction=contradiction,
            rating=rating,
            elsewhere=tuple(self.elsewhere),
            open_stops=self.open_stops,
        )

    def _contradiction(self, taken: Mapping[int, Assessment]) -> str:
        """That links are lighter than the drives that the scene says they hold; else empty."""
        masses = {i: a.candidate.mass for i, a in taken.items()}
        held = held_drives(self.scene, masses, self.conditions.mass_in_urdf)
        worst = held[0] if held[0].share > 1.0 else max(held, key=lambda one: one.share)
        if worst.share <= 1.0:
            return ""
        return (
            f"robot.masses: {worst.where} weigh {worst.links:.3g} kg and cannot hold "
            f"{worst.drives:.3g} kg of drives: write `without_drives`, or correct the masses"
        )

    def _light(
        self, taken: Mapping[int, Assessment]
    ) -> tuple[tuple[dict[int, Assessment], int, bool], str] | None:
        """A choice of drives that the links can hold, and what is said of it; None: there is none.

        None of it need be signed: each is at most its part of the links that weigh least for the
        number of drives in them.
        """
        each = held_drives(self.scene, dict.fromkeys(taken, 1.0), self.conditions.mass_in_urdf)
        self.most = min(one.links / one.drives for one in each if one.drives)
        bears, self.stop_effort = self.stop_effort, {}
        found = self._bearing_stops()
        fit = found[0].keys() == taken.keys() and all(a.fits or a.would for a in found[0].values())
        if fit and not self._contradiction(found[0]):
            why = self._contradiction(taken).partition(" of drives: ")[0]
            most = f"of at most {self.most:.2g} kg each, are provisional, or"
            return found, f"{why} of drives that can be signed: lighter ones, {most} write " + (
                "`without_drives`"
            )
        self.most, self.stop_effort = np.inf, bears
        return None

    def _other_mass(self, taken: Mapping[int, Assessment]) -> float | None:
        """Mass of the drives if the links hold them; None: as `SizingReport.other_mass`."""
        names, holds = self.scene.actuator_names, self.scene.masses_hold
        if not any(holds[i] is None and carried(self.scene, i) for i in taken):
            return None
        other, settled = copy(self), self.robot.last
        bare = {n: "without_drives" for n, hold in zip(names, holds, strict=True) if hold is False}
        other.scene, other.banned = replace(self.scene, masses={**bare, OTHERS: "with_drives"}), {}
        other.stop_effort, other.stop_least = {}, {}
        held, _, _ = other._bearing_stops()
        self.robot.last = settled
        return None if other._contradiction(held) else _mass(held)

    def _stopped(self, report: SizingReport) -> tuple[StopResult | None, str]:
        """The stops with the chosen drives and brakes, or why there are none."""
        if self.scene.stops is None or self.catalog is None or any(j.no_fit for j in report.joints):
            return None, ""
        if len(list(report.duty.parts())) > 1:
            what = "judged for one cycle, not for a duty of several or a rating alone"
            return None, f"stops: {what}"
        names = sorted({drive.brake for drive in report.drives if drive} - {""})
        if slow := [n for n in names if self.catalog.brakes[n].engage_time is None]:
            return None, (
                f"stops: {', '.join(slow)} of the catalogue has no `engage_time`; give it the time "
                "(s) from power-off until it holds, as its maker states it"
            )
        self.progress("stops of the chosen drives")
        motion = self._one_cycle(report.scene, self.robot)
        pairs = zip(report.joints, report.drives, strict=True)
        products = {joint.name: drive.name for joint, drive in pairs if drive}
        load, settings = full_load(report.scene, motion), stop_settings(report.scene, None)
        try:
            return stops_of(Machines(report.scene, settings, load, products), motion), ""
        except StopError as problem:
            return None, str(problem)

    def _one_cycle(self, scene: Scene, robot: DrivenRobot) -> Trajectory:
        """The cycles without a rating, or a rating alone, as a motion of a scene."""
        states, rating = robot.result.states, robot.rating
        part = rating.own if rating is not None and rating.cycles else slice(None)
        carried = states.attached
        attached = (
            {} if carried is None else dict(zip(scene.payloads, carried[part].T, strict=True))
        )
        return Trajectory.from_arrays(
            scene,
            robot.result.times[part],
            states.q[part],
            states.v[part],
            states.a[part],
            attached,
            source=str(getattr(robot.motion, "source", "motion")),
        )

    def _bearing_stops(self) -> tuple[dict[int, Assessment], int, bool]:
        """Choose; gears must bear the stops of all joints together with this choice; again.

        Until the choice bears its own stops and none lighter would do: what it takes depends on no
        drive that was chosen before. Only where choices come back the largest peaks count. Where no
        simulation follows, gears must bear 1.3 times what algebra says. Of a rating alone no choice
        is made by it, unless the scene has `stops`: what its gears do not bear is not signed.
        """
        (taken, passes, settled), self.open_stops = self._choose(), {}
        scene, seen = self.scene, list[dict[int, str]]()
        if self.catalog is None or scene.linkage is not None or scene.mobility.redundant:
            return taken, passes, settled
        for _ in range(_MOST_PASSES):
            if scene.stops is None and not any(a.candidate.brake for a in taken.values()):
                break
            fit = len(taken) == len(scene.drives) and all(a.fits for a in taken.values())
            factor = 1.0 if self._stops_once and fit else _NOT_SIMULATED
            self.stop_note = f"{factor:g} x " * (factor > 1.0) + "the peak in stops of all joints"
            try:
                most, powered = self._stop_peaks(taken)
            except StopError:  # the simulation says what is missing
                break
            peaks = {i: max(factor * float(most[i]), self.stop_least.get(i, 0.0)) for i in taken}
            short = self._overloaded(peaks, taken)
            if self.rating is not None and not self.rating.cycles and scene.stops is None:
                self.open_stops = peaks
                break
            if _names(taken) in seen:
                peaks |= {i: max(x, peaks[i]) for i, x in self.stop_effort.items() if i in peaks}
            first, self.stop_effort = not self.stop_effort, peaks
            if first and not short and not powered:  # it stays the lightest
                taken = {i: a.where(**self._stop(i)) for i, a in taken.items()}
                break
            seen.append(_names(taken))
            self.braking = {
                i: tuple(
                    drive_cycle(x, i, np.zeros(len(x.effort_lower), dtype=bool)) for x in powered
                )
                for i in taken
            }
            self.progress("gears that bear the stops of all joints together")
            taken, more, settled = self._choose()
            passes += more
            if _names(taken) == seen[-1]:
                break
        return taken, passes, settled

    def _stop_peaks(
        self, taken: Mapping[int, Assessment]
    ) -> tuple[np.ndarray, tuple[InverseResult, ...]]:
        """`cycle_peaks` of a choice in each mounting, and `braking`.

        A brake of unknown inertia has next to none: a heavy rotor relieves its gear. Of a scene
        that does not say how it is stopped all brakes close at once.
        """
        stops, chosen = self.scene.stops, dict[int, Candidate]()
        for i, made in ((i, a.candidate) for i, a in taken.items()):
            if (gear := made.transmission) is not None and gear.brake is not None:
                brake = gear.brake.model_copy(update={} if stops else {"engage_time": None})
                inertia = gear.rotor_inertia - made.brake_unsure
                gear = gear.model_copy(update={"rotor_inertia": inertia, "brake": brake})
                made = replace(made, transmission=gear)
            chosen[i] = made
        scene = equip(self.scene, chosen, self.conditions)
        powers, most = list[InverseResult](), np.zeros(len(scene.drives))
        for words, robot in self.robots.items():
            gravity = robot.scene.model.gravity.linear
            turned = scene.with_(gravity=gravity) if words else scene
            motion = self._one_cycle(turned, robot)
            settings = stops or Stops(category=0, reaction_time=0.0)
            machines = Machines(turned, settings, full_load(turned, motion))
            powered = braking(machines, motion)
            most = np.maximum(most, cycle_peaks(machines, motion, powered))
            powers += powered
        return most, tuple(powers)

    def _stop(self, i: int) -> dict[str, Any]:
        """What is known of a joint's stops, as fields of its case."""
        known = i in self.stop_effort
        effort, note = self.stop_effort.get(i, np.nan), self.stop_note * known
        braked = self.braking.get(i, ())
        return {"stop_effort": effort, "stop_note": note, "braking": braked}

    @property
    def _stops_once(self) -> bool:
        """Whether the scene says how it is stopped, of one cycle."""
        stops = self.scene.stops is not None and self.catalog is not None
        return stops and len(list(self.duty.parts())) == 1

    def _overloaded(
        self, peaks: Mapping[int, float], taken: Mapping[int, Assessment]
    ) -> dict[int, float]:
        """The peaks (N m or N), by the drives' columns, that are more than gears bear."""
        return {
            i: peak for i, peak in peaks.items() if i in taken and peak > momentary_peak(taken[i])
        }

    def _added(self, taken: Mapping[int, Assessment]) -> dict[int, float]:
        """The masses that the drives add to the robot's links."""
        masses = {i: a.candidate.mass for i, a in taken.items()}
        return added_masses(self.scene, self.conditions, masses)

    def _is_unloaded(self, i: int) -> bool:
        """Whether a drive's joint moves no mass."""
        column = self.scene.drives[i].velocity_index
        return column >= 0 and bool(self.unloaded[column])

    def _cases(self, i: int, masses: Mapping[int, float]) -> dict[str, JointCase]:
        """A joint, with a rating once by each of its parts, and once by each mounting asked for.

        The one of largest RMS effort first. A brake holds the largest load of all mountings, where
        their motions differ in every pose.
        """
        cases = {
            " ".join(x for x in (name, mounting) if x): robot.case(i, masses, schedule)._replace(
                **self._stop(i)
            )
            for mounting, robot in self.robots.items()
            for name, schedule in _means(robot, i).items()
        }
        if len(self.robots) > 1:
            rests = [case.rest for case in cases.values() if case.rest is not None]
            loads = [np.abs(rest.load) for rest in rests]
            alike = len({len(load) for load in loads}) == 1
            most = np.max(loads, axis=0) if alike else max(load.max() for load in loads)
            peak = max(rest.peak for rest in rests)
            cases = {
                name: case._replace(
                    rest=case.rest
                    and case.rest._replace(load=most + 0.0 * case.rest.load, peak=peak)
                )
                for name, case in cases.items()
            }
        effort = {n: rms(c.cycle.stretched, c.cycle.ends[0]) for n, c in cases.items()}
        return {name: cases[name] for name in sorted(cases, key=lambda name: -effort[name])}

    def _search(self, i: int, masses: Mapping[int, float]) -> DriveSearch | None:
        """The drives of the catalogue at a joint; None: it takes none."""
        if self.catalog is None or driven_joint(self.scene, i) is None or self._is_unloaded(i):
            return None
        name, linear = self.scene.drives[i].name, effort_unit(self.scene, i) == "N"
        if linear not in self.shelves:
            brakes = brakes_of(self.catalog, self.scene)
            self.shelves[linear] = CatalogArrays(self.catalog, self.conditions, linear, brakes)
        own = own_parts(self.catalog, self.conditions, name, linear)
        banned = frozenset(self.banned.get(i, ()))
        shelf, parts = self.shelves[linear], Parts(own, banned, self.most)
        first, *others = self._cases(i, masses).values()
        return DriveSearch(
            shelf, first, parts, [DriveSearch(shelf, case, parts) for case in others]
        )

    def choose(self) -> dict[int, Assessment]:
        """Return the drives that fit, by their columns."""
        return {i: a for i, a in self._bearing_stops()[0].items() if a.fits}

    def _choose(self) -> tuple[dict[int, Assessment], int, bool]:
        """The drives taken, the number of passes, and whether the last one changed nothing."""
        taken: dict[int, Assessment] = {}
        if self.catalog is None:
            return taken, 0, True
        seen: list[dict[int, Assessment]] = []
        for passes in range(1, _MOST_PASSES + 1):
            before = _names(taken)
            searches: dict[int, DriveSearch] = {}
            for i in tip_to_base(self.scene):
                self.progress(f"pass {passes}: {self.scene.drives[i].name}")
                search = self._search(i, self._added(taken))
                if search is None:
                    continue
                searches[i] = search
                found = search.lightest() or provisional(search) or search.nearest()
                taken.pop(i, None)
                if found is not None:
                    taken[i] = found
            if self.conditions.lowest_frequency is not None:
                taken = self._together(taken, searches)
            taken |= self._shared(taken, searches)
            exact = {k: m for k, m in self._added(taken).items() if m and carried(self.scene, k)}
            if _names(taken) == before and (self.robot.exact or self.robot.last.masses == exact):
                return taken, passes, True
            for robot in self.robots.values():
                robot.solve(self._added(taken))
            self._ban(seen, taken)
        warnings.warn(
            f"the choice of drives still alternates after {_MOST_PASSES} passes",
            PinfricWarning,
            stacklevel=4,
        )
        return taken, _MOST_PASSES, False

    def _ban(self, seen: list[dict[int, Assessment]], taken: Mapping[int, Assessment]) -> None:
        """Ban the lightest of what alternates at the outermost joint where a choice comes back."""
        now, before = _names(taken), [_names(one) for one in seen]
        seen.append(dict(taken))
        if len(before) >= _PATIENCE and now in before[:-1]:
            for i in tip_to_base(self.scene):
                found = [one.get(i) for one in seen[before.index(now) :]]
                mass = {a.candidate.name: a.candidate.mass or 0.0 for a in found if a is not None}
                if len(mass) + (None in found) > 1:
                    self.banned.setdefault(i, set()).add(min(mass, key=mass.__getitem__))
                    break

    def _together(
        self, taken: dict[int, Assessment], searches: Mapping[int, DriveSearch]
    ) -> dict[int, Assessment]:
        """The lightest set that swings no slower than `lowest_frequency`; else each by itself."""
        wanted = self.conditions.lowest_frequency
        turning = [i for i in sorted(searches) if not searches[i].arrays.linear]
        fronts = [searches[i].front() for i in turning]
        if wanted is None or self.scene.loops or not turning or not all(fronts):
            return taken
        self.progress(f"drives that swing at {wanted:g} Hz together")
        arm = self.arm(turning, {i: m for i, m in self._added(taken).items() if i not in turning})
        table = []
        for i, front in zip(turning, fronts, strict=True):
            added = [self._added({i: a}).get(i, 0.0) for a in front]
            table.append(
                [
                    (
                        a.candidate.mass or 0.0,
                        stiffness_of(a),
                        more if carried(self.scene, i) else 0.0,
                    )
                    for a, more in zip(front, added, strict=True)
                ]
            )
        picked, _ = stiff_enough(arm, table)
        if picked is None:
            return taken
        return taken | {i: front[p] for i, front, p in zip(turning, fronts, picked, strict=True)}

    def _shared(
        self, taken: Mapping[int, Assessment], searches: Mapping[int, DriveSearch]
    ) -> dict[int, Assessment]:
        """The lightest motor and gear of each group of `same_drive`, if one fits all its joints."""
        found: dict[int, Assessment] = {}
        for group in self.conditions.same_drive:
            own = [i for i in map(self.scene.actuator_names.index, group) if i in searches]
            if not own:
                continue
            heaviest = max(own, key=lambda i: taken[i].candidate.mass or 0.0 if i in taken else 0.0)
            for _, _, *drive in searches[heaviest].offers():
                judged = {i: searches[i].judge(*drive) for i in own}
                banned = {a.candidate.name for a in judged.values()} & {
                    name for i in own for name in searches[i].parts.banned
                }
                if all(a.fits for a in judged.values()) and not banned:
                    found |= judged
                    break
        return found

    def arm(self, turning: Sequence[int], others: Mapping[int, float]) -> SwingingArm:
        """Return the arm that swings on the gears of some drives, at every pose of the cycle."""
        states = self.robot.base.result.states
        poses = np.flatnonzero(np.append(True, (states.q[1:] != states.q[:-1]).any(axis=1)))
        own = [self.scene.drives[i].velocity_index for i in turning]
        still = self.robot.mass_matrices(others, poses)
        per_mass = np.zeros((len(turning), len(poses), len(own), len(own)))
        for k, i in enumerate(turning):
            if carried(self.scene, i):
                more = self.robot.mass_matrices({**others, i: 1.0}, poses) - still
                per_mass[k] = more[:, own][:, :, own]
        assert self.conditions.lowest_frequency is not None
        return SwingingArm(still[:, own][:, :, own], per_mass, self.conditions.lowest_frequency)

    def _joint(self, i: int, taken: Mapping[int, Assessment]) -> JointSizing:
        """The joint with all chosen drives in the model."""
        masses, found = self._added(taken), taken.get(i)
        cases, search = self._cases(i, masses), self._search(i, masses)
        # other scenes have motions of their own, which the tables do not show
        shown = {n: c for n, c in cases.items() if self._mounting(n) not in self.elsewhere}
        ranked = {
            n: c for n, c in shown.items() if found and c.cycle.duty == found.drives.case.cycle.duty
        }
        decided, case = next(iter((ranked or shown).items()))
        mounted = self._mounting(decided)
        demand = joint_demand(self.robots[mounted].result, i, case.cycle)
        demand = replace(demand, speed=case.demand.speed)
        robot = self.robots[mounted]
        base = robot.base.result
        alone = joint_demand(base, i, robot.cycle(i, case.cycle.duty)) if masses else demand
        motor = None
        if found is not None and found.motor is not None:
            motor = motor_cycle(found.candidate, case.cycle, self.conditions)
        return JointSizing(
            demand,
            case.cycle,
            alone,
            case.load_inertia,
            motor,
            choice=found if found is not None and found.fits else None,
            nearest=found if found is not None and not found.fits else None,
            nothing_because="" if search and search.arrays.count else self._no_candidates(i),
            unloaded=self._is_unloaded(i),
            search=search,
            decided=decided,
            mountings=self._by_mounting(cases),
        )

    def _mounting(self, name: str) -> str:
        """The mounting of a case by its name; "": the scene's own."""
        return next((words for words in self.robots if words and words in name), "")

    def _by_mounting(self, cases: Mapping[str, JointCase]) -> dict[str, tuple[float, float]]:
        """RMS and peak effort of a joint in each mounting; empty: there is one."""
        found: dict[str, tuple[float, float]] = {}
        for name, case in cases.items() if len(self.robots) > 1 else ():
            words = self._mounting(name) or file_name(self.scene.source)
            before, worst = found.get(words, (0.0, 0.0)), case.cycle.ends[0]
            now = rms(case.cycle.stretched, worst), float(np.abs(worst).max())
            found[words] = max(before[0], now[0]), max(before[1], now[1])
        return found

    def _no_candidates(self, i: int) -> str:
        """Why there are no candidates; empty without a catalogue, or where none is asked for."""
        if self.catalog is None or self._is_unloaded(i):
            return ""
        if driven_joint(self.scene, i) is None:
            return "motors and gears are for joints with one axis, not for cylinders and forces"
        if not self.catalog.motors and not self.catalog.gearmotors:
            return f"{self.catalog.source} has no motors"
        output = "linear" if effort_unit(self.scene, i) == "N" else "rotary"
        if any(gear.output == output for gear in self.catalog.gears.values()):
            return (
                f"no motor of {self.catalog.source} goes with its gears: a frameless kit needs a "
                "strain wave gear, and a gear with `motors` one of these"
            )
        return f"{self.catalog.source} has no gear with a {output} output"


def _means(robot: DrivenRobot, i: int) -> dict[str, Schedule | None]:
    """What a joint's means are taken over: its cycle, with a rating each part of it."""
    return {"": None} if robot.rating is None else dict(robot.rating.means(i))


def brakes_of(catalog: Catalog, scene: Scene) -> dict[str, Brake]:
    """Return the brakes that a robot may have, the smallest first.

    Where the scene says how it is stopped: those with an `engage_time`, if there are any.
    """
    timed = {n: brake for n, brake in catalog.brakes.items() if brake.engage_time is not None}
    return ranked(catalog.brakes if scene.stops is None else timed or catalog.brakes)


def _mass(taken: Mapping[int, Assessment]) -> float:
    return sum(a.candidate.mass or 0.0 for a in taken.values())


def _names(taken: Mapping[int, Assessment]) -> dict[int, str]:
    return {i: assessment.candidate.name for i, assessment in taken.items()}
