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
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import MotionLike
from pinfric.errors import CatalogError, PinfricWarning, SizingError, choose_from
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.schema import Actuator, Transmission
from pinfric.model.springs import softest
from pinfric.model.upward import Shown
from pinfric.model.urdf import implausible_body
from pinfric.study.elastic.motion import Elasticity, elasticity
from pinfric.study.sizing.assess import (
    Assessment,
    assess,
    lightest,
    nearest_miss,
    own_parts,
)
from pinfric.study.sizing.brake import Standstill, standstills
from pinfric.study.sizing.catalog import (
    OTHERS,
    Catalog,
    Conditions,
    parse_conditions,
)
from pinfric.study.sizing.catalog_file import load_catalog
from pinfric.study.sizing.caveats import caveats, discontinuities, unclosed
from pinfric.study.sizing.criterion import Criterion, Status
from pinfric.study.sizing.demand import (
    DriveCycle,
    GearDemand,
    JointDemand,
    average_output_effort,
    drive_cycle,
    driven_joint,
    hold_samples,
    joint_demand,
    screw_load,
)
from pinfric.study.sizing.drivetrain import (
    Candidate,
    MotorCycle,
    candidates,
    line_voltage,
    motor_cycle,
    with_brake,
)
from pinfric.study.sizing.duty import Duty, Schedule, once
from pinfric.study.sizing.elastic_arm import arm_criteria, check_tool, reversal_criteria
from pinfric.study.sizing.inertia import load_inertias
from pinfric.study.sizing.limit import Case
from pinfric.study.sizing.power import BusPower, bus_power
from pinfric.study.sizing.stopping import chosen_stops
from pinfric.study.stop.study import StopResult
from pinfric.study.summary import effort_unit
from pinfric.study.trajectory.trajectory import Trajectory

#: Passes over all joints before an alternating choice is given up; a serial chain needs two.
_MOST_PASSES = 10
#: Rounds in which brakes are put in; their masses change little.
_MOST_ROUNDS = 4
#: Drives in the model: (index, mass in kg) of each.
_Load = tuple[tuple[int, float | None], ...]
#: What a joint's sizing depends on: its number, the drives beyond it and how they yield, its brake.
_Key = tuple[int, _Load, float, str | None]
#: Joints nearer to the base than this are base axes for the resonance rule.
BASE_AXES = 3


@dataclass(frozen=True)
class JointSizing:
    """One joint's demand, candidates and choice.

    Attributes:
        demand, cycle: with the mass of all chosen drives in the model.
        demand_without_masses: with the model as the scene has it.
        load_inertia: largest inertia about the joint over the cycle, kg m^2 (kg); None where
            closed loops couple the joints.
        motor: the shaft of the drive taken, sample by sample; None without one.
        assessments: every candidate, ranked (`assess`); empty without a catalogue.
        choice: the lightest that fits; None if none fits.
        nearest: if none fits, the candidate with the smallest shortfall.
        choice_without_masses: the choice without the drives' mass.
        choice_frictionless: the choice without friction in the joints.
        nothing_because: why there are no candidates, if a catalogue was given; otherwise empty.
    """

    demand: JointDemand
    cycle: DriveCycle
    demand_without_masses: JointDemand
    load_inertia: float | None
    motor: MotorCycle | None = None
    assessments: tuple[Assessment, ...] = ()
    choice: Assessment | None = None
    nearest: Assessment | None = None
    choice_without_masses: Assessment | None = None
    choice_frictionless: Assessment | None = None
    nothing_because: str = ""

    @property
    def name(self) -> str:
        """The drive's name."""
        return self.demand.name

    @property
    def installed(self) -> Assessment | None:
        """The drive whose mass is in the model: the choice, or the nearest miss."""
        return self.choice or self.nearest

    @property
    def next_smaller(self) -> Assessment | None:
        """The drive lighter than the choice with the smallest shortfall."""
        if self.choice is None or self.choice.candidate.mass is None:
            return None
        most = self.choice.candidate.mass
        return nearest_miss([a for a in self.assessments if (a.candidate.mass or most) < most])

    @property
    def unjudged(self) -> tuple[Assessment, ...]:
        """The drives lighter than the choice that fail nothing but cannot be judged; or all."""
        most = np.inf if self.choice is None else self.choice.candidate.mass or np.inf
        return tuple(
            a
            for a in self.assessments
            if a.missing_figures and not a.failed and (a.candidate.mass or 0.0) < most
        )

    @property
    def no_fit(self) -> str:
        """State that no drive fits, and the shortfall of the nearest one; otherwise empty."""
        if self.choice is not None or (not self.assessments and not self.nothing_because):
            return ""
        if not self.assessments:
            return f"{self.name}: no candidates: {self.nothing_because}"
        if self.nearest is None:
            first = self.assessments[0]
            return f"{self.name}: no candidate can be checked; {first.candidate.name}: {first.why}"
        return (
            f"{self.name}: none of {len(self.assessments)} candidates fits; the nearest miss "
            f"is {self.nearest.candidate.name}: {self.nearest.why}"
        )


@dataclass(frozen=True)
class SizingReport(Shown):
    """The demand of a cycle on every drive, and the drives chosen for it.

    Attributes:
        scene: with the chosen drives' masses and transmissions; the given one without a catalogue.
        given: the scene as it was given.
        trajectory: source of the motion.
        catalog, conditions: the catalogue and the conditions; catalog None: demand only.
        joints: in the order of the scene's drives.
        result, result_without_masses: inverse dynamics of `scene` and of `given`.
        duty: the samples of each cycle of the period, and the number of its runs.
        passes: over all joints until no choice changed. settled: no choice changed in the last.
        assumptions: of the sizing, in sentences.
        unclosed: states that differ between end and start of the cycle; empty if it closes.
        stops: with the chosen drives and their brakes; None: none, or the scene has no `stops`.
        no_stops: why the stops that the scene asks for could not be judged; "" where they were.
    """

    scene: Scene
    given: Scene
    trajectory: str
    catalog: Catalog | None
    conditions: Conditions
    joints: tuple[JointSizing, ...]
    result: InverseResult
    result_without_masses: InverseResult
    duty: Schedule
    passes: int
    settled: bool
    assumptions: tuple[str, ...] = ()
    unclosed: tuple[str, ...] = ()
    stops: StopResult | None = None
    no_stops: str = ""

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
                "mass": (f"{self.chosen_mass:.3g} kg of drives" if chosen else "no drive fits")
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
        assert self.result.t is not None  # size refuses a motion without times
        t = self.duty.stretched(self.result.t)
        return float(t[-1] - t[0])

    @property
    def drive_mass(self) -> float:
        """Mass of all drives in the model, kg."""
        taken = (joint.installed for joint in self.joints)
        return sum(a.candidate.mass or 0.0 for a in taken if a is not None)

    @property
    def chosen_mass(self) -> float:
        """Mass of the drives that fit, kg."""
        chosen = (joint.choice for joint in self.joints)
        return sum(a.candidate.mass or 0.0 for a in chosen if a is not None)

    @cached_property
    def standstills(self) -> tuple[Standstill, ...]:
        """Holding of each joint without power, and its brake; in the order of `joints`.

        Where the scene says how it is stopped: of brakes with an `engage_time`, if there are any.
        """
        catalog = self.catalog or Catalog("no catalogue")
        fitted = [j.installed.candidate.brake if j.installed else "" for j in self.joints]
        inertias = [catalog.brakes[name].rotor_inertia or 0.0 if name else 0.0 for name in fitted]
        timed = {n: brake for n, brake in catalog.brakes.items() if brake.engage_time is not None}
        there = catalog.brakes if self.given.stops is None else timed or catalog.brakes
        return standstills(self.result, there, self.conditions, inertias)

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions, and what of the needed brakes is not in the model."""
        if self.catalog is None:
            return self.assumptions
        needed = dict.fromkeys(x.brake for x in self.standstills if x.fitted and x.brake)
        brakes = {name: self.catalog.brakes[name] for name in needed}
        unknown = {
            "mass": [name for name, brake in brakes.items() if brake.mass is None],
            "inertia": [name for name, brake in brakes.items() if brake.rotor_inertia is None],
        }
        lacks = [f"{what} of {', '.join(names)}" for what, names in unknown.items() if names]
        text = f"Not known of brakes that are needed, and not in the model: {'; '.join(lacks)}."
        return (*self.assumptions, text) if lacks else self.assumptions

    @cached_property
    def elastic(self) -> Elasticity | None:
        """Effects of the gears' elasticity over the cycle; None if no stiffness is known."""
        return elasticity(self.result) if self.scene.elastic else None

    @cached_property
    def arm_criteria(self) -> tuple[Criterion, ...]:
        """Criteria of the whole robot: lowest frequency, position of the tool at rest."""
        return arm_criteria(self.scene, self.elastic, self.conditions)

    @cached_property
    def reversals(self) -> tuple[Criterion, ...]:
        """Reversal error of each joint, in the order of `joints`; none where not asked for."""
        taken = (joint.installed for joint in self.joints)
        backlash = [None if a is None else a.candidate.backlash for a in taken]
        return reversal_criteria(self.scene, self.elastic, self.conditions, backlash)

    @cached_property
    def bus(self) -> BusPower:
        """Power of all chosen drives from their bus, and power fed back."""
        drives = {joint.name: joint.motor for joint in self.joints}
        t = self.result.t
        assert t is not None  # size refuses a motion without times
        voltages = {
            joint.name: line_voltage(joint.installed.candidate.ratings, joint.motor)
            for joint in self.joints
            if joint.installed is not None and joint.motor is not None
        }
        return bus_power(drives, t, self.duty, self.conditions, voltages)

    @property
    def no_fit(self) -> tuple[str, ...]:
        """One line for each joint for which no candidate fits."""
        return tuple(joint.no_fit for joint in self.joints if joint.no_fit)

    @property
    def unmet(self) -> tuple[str, ...]:
        """One line for each condition that a brake, the bus, a stop or the robot does not meet."""
        names = [joint.name for joint in self.joints]
        reversals = [(name, (c,)) for name, c in zip(names, self.reversals, strict=False)]
        whole = [*reversals, ("robot", self.arm_criteria)]
        if self.catalog is None:
            return _failing(whole)
        wanted = self.standstills if self.conditions.holding_brake != "any" else ()
        found = [(name, still.criteria) for name, still in zip(names, wanted, strict=False)]
        why = (self.no_stops,) if self.no_stops else ()
        stopping = why if self.stops is None else self.stops.unmet
        return (*_failing([*found, ("bus", self.bus.criteria), *whole]), *stopping)

    def check(self) -> None:
        """Raise if a joint has no drive that fits, or a brake or the bus does not meet a condition.

        Raises:
            SizingError: names the joints, the nearest misses and by how much; holds the report.
        """
        if wrong := (*self.no_fit, *self.unmet):
            raise SizingError("; ".join(wrong), self)

    def joint(self, name: str) -> JointSizing:
        """Return one joint's sizing by name.

        Raises:
            SizingError: there is none of that name.
        """
        for joint in self.joints:
            if joint.name == name:
                return joint
        names = [joint.name for joint in self.joints]
        raise SizingError(f"there is no drive {name!r}; {choose_from(name, names)}")


def size(
    scene: Scene,
    trajectory: MotionLike | Duty,
    catalog: Catalog | str | Path | None = None,
    *,
    conditions: Conditions | Mapping[str, Any] | None = None,
    on_miss: Literal["warn", "raise", "ignore"] = "warn",
    progress: Callable[[str], object] | None = None,
) -> SizingReport:
    """Return the demand of a repeated cycle on each drive, and the drives of a catalogue that fit.

    For every joint, from its effort interval (paper eq. 16, 17; at rest 21, 22): peak, RMS, power,
    holding and break-away effort. With a catalogue: every motor with every gear, checked by
    `criteria.check`; the lightest that fits is chosen, tip to base, with the chosen drives' mass
    in the model.

    Args:
        scene: the robot with its friction. Its links are assumed to have no drives, except for
            `conditions.mass_in_urdf`. The candidates replace its transmissions.
        trajectory: one cycle, with times; it is repeated without a pause. If it does not end as
            it began, `SizingReport.unclosed` and a note say so. Several cycles: as a `Duty`.
        catalog: a `Catalog`, a file, "default" for the bundled one, or None for the demand only.
        conditions: values that replace the catalogue's conditions; `Conditions` or a mapping.
        on_miss: what to do if no candidate fits a joint; the report says so in any case.
        progress: called with a line of text at each step.

    Raises:
        CatalogError: the catalogue or a condition is wrong; StateError: the motion has no times;
        SizingError: without `mass_in_urdf` a link is not a possible body; or no candidate fits
        and `on_miss` is "raise".

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
    wanted = parse_conditions(conditions, Conditions() if catalog is None else catalog.conditions)
    check_names(scene, wanted)
    check_tool(scene, wanted)
    for joint in wanted.bearings:
        linear = effort_unit(scene, scene.actuator_names.index(joint)) == "N"
        own_parts(catalog or Catalog("no catalogue"), wanted, joint, linear)
    sizing = _Sizing(scene, trajectory, catalog, wanted, progress or (lambda _: None))
    report = sizing.run()
    if on_miss == "raise":
        report.check()
    for text in (*report.no_fit, *report.unmet) if on_miss == "warn" else ():
        warnings.warn(text, PinfricWarning, stacklevel=2)
    return report


class _Sizing:
    """One run of `size`: keeps results that were computed already."""

    def __init__(
        self,
        scene: Scene,
        trajectory: MotionLike | Duty,
        catalog: Catalog | None,
        conditions: Conditions,
        progress: Callable[[str], object],
    ) -> None:
        self.trajectory: MotionLike
        self.duty = None
        if isinstance(trajectory, Duty):
            self.trajectory, self.duty = trajectory.motion(), trajectory.schedule()
        else:
            self.trajectory = trajectory
        every = [drive.name for drive in scene.drives] if catalog is not None else ()
        self.scene, self.catalog = without_drives(scene, every), catalog
        self.conditions, self.progress = conditions, progress
        self.solved: dict[_Load, tuple[InverseResult, np.ndarray]] = {}
        self.judged: dict[_Key, JointSizing] = {}
        self.offered: dict[tuple[str | None, ...], tuple[Candidate, ...]] = {}
        self.brakes: dict[int, str] = {}
        self.hold: np.ndarray | None = None
        self.beyond: dict[int, float] = {}

    def run(self) -> SizingReport:
        """Size with the brakes that the drives turn out to need, until these do not change."""
        report = self._report()
        for _ in range(_MOST_ROUNDS):
            brakes = {
                i: still.brake
                for i, still in enumerate(report.standstills)
                if still.fitted and still.brake is not None
            }
            if brakes == self.brakes:
                break
            self.brakes = brakes
            report = self._report()
        compared = tuple(self._compared(i, joint) for i, joint in enumerate(report.joints))
        stops, why = self._stopped(report)
        return replace(report, joints=compared, stops=stops, no_stops=why)

    def _stopped(self, report: SizingReport) -> tuple[StopResult | None, str]:
        """The stops with the chosen drives and brakes, or why there are none."""
        if self.scene.stops is None or self.catalog is None or report.no_fit:
            return None, ""
        if len(report.duty.repeats) > 1:
            return None, "stops: judged for one cycle, not for a duty of several"
        self.progress("stops of the chosen drives")
        brakes = self.catalog.brakes
        return chosen_stops(report.result, report.standstills, brakes, report.trajectory)

    def _report(self) -> SizingReport:
        taken: dict[int, Assessment] = {}
        drives = range(len(self.scene.drives))
        tip_to_base = sorted(drives, key=lambda i: -depth(self.scene, i))
        passes, settled = 0, self.catalog is None
        while self.catalog is not None and not settled and passes < _MOST_PASSES:
            passes += 1
            before = _names(taken)
            for i in tip_to_base:
                self.progress(f"pass {passes}: {self.scene.drives[i].name}")
                assessment = self.joint(i, taken).installed
                if assessment is not None:
                    taken[i] = assessment
            settled = _names(taken) == before
        if not settled:
            warnings.warn(
                f"the choice of drives still alternates after {passes} passes",
                PinfricWarning,
                stacklevel=3,
            )
        joints = tuple(self.joint(i, taken) for i in drives)
        chosen = {i: j.installed for i, j in enumerate(joints) if j.installed is not None}
        equipped = with_masses(self.scene, chosen, self.conditions) if chosen else self.scene
        without, _ = self._solve((), {})
        duty = self.duty or once(len(without.states.q))
        gaps = unclosed(without, duty)
        return SizingReport(
            scene=equipped,
            given=self.scene,
            catalog=self.catalog,
            conditions=self.conditions,
            trajectory=str(getattr(self.trajectory, "source", "motion")),
            joints=joints,
            result=inverse_dynamics(equipped, self.trajectory) if chosen else without,
            result_without_masses=without,
            duty=duty,
            passes=passes,
            settled=settled,
            assumptions=caveats(
                self.scene, self.catalog, self.conditions, gaps, discontinuities(without, duty)
            ),
            unclosed=gaps,
        )

    def joint(self, i: int, taken: Mapping[int, Assessment]) -> JointSizing:
        """Judge all candidates for one joint, with the drives beyond it in the model."""
        beyond = {k: a for k, a in taken.items() if _loads(self.scene, k, i)}
        load = tuple(sorted((k, a.candidate.mass) for k, a in beyond.items()))
        solved = self._solve(load, beyond)
        self.beyond[i] = yielding(self.scene, i, _softest(beyond), solved[1])
        key = i, load, self.beyond[i], self.brakes.get(i)
        if key not in self.judged:
            self.judged[key] = self._judge(i, *solved)
        return self.judged[key]

    def _case(self, i: int, demand: GearDemand, cycle: DriveCycle, inertia: float | None) -> Case:
        """The data by which a joint's candidates are checked."""
        hand = depth(self.scene, i) > BASE_AXES
        return Case(demand, cycle, inertia, hand, self.conditions, self.beyond.get(i, 0.0))

    def _solve(
        self, load: _Load, taken: Mapping[int, Assessment]
    ) -> tuple[InverseResult, np.ndarray]:
        """Inverse dynamics and load inertias with these drives' masses in the model."""
        if load not in self.solved:
            self.solved.clear()  # joints of one load follow each other: older ones are done
            scene = with_masses(self.scene, taken, self.conditions, drives=False)
            result = inverse_dynamics(scene, self.trajectory)
            self.solved[load] = result, load_inertias(result)
        return self.solved[load]

    def _cycle(
        self, i: int, result: InverseResult, inertias: np.ndarray
    ) -> tuple[DriveCycle, float | None]:
        """A drive's samples, and the inertia about its joint."""
        if self.hold is None:
            self.hold = holds(self.scene, self.trajectory, result.states.v)
        tree = driven_joint(self.scene, i) is not None and not self.scene.loops
        cycle = drive_cycle(result, i, self.hold, self.duty)
        return cycle, float(inertias[i]) if tree else None

    def _offers(self, i: int, demand: GearDemand) -> tuple[Candidate, ...]:
        """The candidates of the catalogue for a joint, with its brake."""
        if self.catalog is None or driven_joint(self.scene, i) is None:
            return ()
        conditions, brake = self.conditions, self.brakes.get(i)
        own = [given.get(demand.name) for given in (conditions.bearings, conditions.amplifiers)]
        bare = demand.unit, *own, None
        if bare not in self.offered:
            linear = demand.unit == "N"
            parts = own_parts(self.catalog, conditions, demand.name, linear)
            self.offered[bare] = tuple(candidates(self.catalog, linear, parts))
        key = *bare[:-1], brake
        if brake is not None and key not in self.offered:
            braked = with_brake(self.offered[bare], brake, self.catalog.brakes[brake])
            self.offered[key] = tuple(braked)
        return self.offered[key]

    def _judge(self, i: int, result: InverseResult, inertias: np.ndarray) -> JointSizing:
        cycle, inertia = self._cycle(i, result, inertias)
        demand = joint_demand(result, i, cycle)
        ranked = assess(self._offers(i, demand), self._case(i, demand, cycle, inertia))
        choice = ranked[0] if ranked and ranked[0].fits else None
        because = "" if ranked else self._no_candidates(i, demand.unit)
        nearest = None if choice else nearest_miss(ranked)
        return JointSizing(
            demand,
            cycle,
            demand,
            inertia,
            assessments=ranked,
            choice=choice,
            nearest=nearest,
            nothing_because=because,
        )

    def _no_candidates(self, i: int, unit: str) -> str:
        """Why there are no candidates; empty without a catalogue."""
        if self.catalog is None:
            return ""
        if driven_joint(self.scene, i) is None:
            return "motors and gears are for joints with one axis, not for cylinders and forces"
        if not self.catalog.motors and not self.catalog.gearmotors:
            return f"{self.catalog.source} has no motors"
        output = "linear" if unit == "N" else "rotary"
        return f"{self.catalog.source} has no gear with a {output} output"

    def _compared(self, i: int, joint: JointSizing) -> JointSizing:
        """The joint, with what would have been chosen without masses, and without friction."""
        motor, offers = None, self._offers(i, joint.demand)
        decides = next((a.decides for a in joint.assessments if a.decides), {})
        if joint.installed is not None and joint.installed.motor is not None:
            motor = motor_cycle(joint.installed.candidate, joint.cycle, self.conditions)
        cycle = joint.cycle.without_friction()
        bare = gear_demand_frictionless(joint.demand, cycle)
        frictionless = lightest(offers, self._case(i, bare, cycle, joint.load_inertia), decides)
        alone_key = i, (), self.beyond.get(i, 0.0), self.brakes.get(i)
        if alone_key in self.judged:  # no drive weighs on it
            demand, choice = self.judged[alone_key].demand, self.judged[alone_key].choice
        else:
            result, inertias = self._solve((), {})
            alone, inertia = self._cycle(i, result, inertias)
            demand = joint_demand(result, i, alone)
            choice = lightest(offers, self._case(i, demand, alone, inertia), decides)
        return replace(
            joint,
            demand_without_masses=demand,
            motor=motor,
            choice_frictionless=frictionless,
            choice_without_masses=choice,
        )


def holds(scene: Scene, trajectory: MotionLike, v: np.ndarray) -> np.ndarray:
    """Return (T,) which samples hold: those the trajectory knows (v = a = 0), else by velocity."""
    mask = np.zeros(len(v), dtype=bool)
    for hold in trajectory.holds() if isinstance(trajectory, Trajectory) else ():
        mask[hold.first : hold.last + 1] = True
    return mask if mask.any() else hold_samples(scene, v)  # a log is never at rest exactly


def gear_demand_frictionless(demand: JointDemand, cycle: DriveCycle) -> GearDemand:
    """Return the figures that criteria ask for, of the same cycle without friction.

    Args:
        demand: with friction.
        cycle: `DriveCycle.without_friction`.
    """
    cubic = average_output_effort(cycle.stretched, cycle.effort_frictionless, cycle.velocity)
    carried = screw_load(cycle) if demand.unit == "N" else demand.bearing
    return GearDemand(
        demand.name,
        demand.unit,
        demand.peak_frictionless,
        demand.speed,
        demand.mean_speed,
        cubic,
        carried,
        demand.travel,
        demand.guide,
    )


def yielding(
    scene: Scene, actuator: int, softest: Mapping[int, float], inertias: np.ndarray
) -> float:
    """Return the sum of J/K_1 over the elastic drives beyond a joint, s^2 (`Case.beyond`).

    Args:
        scene: the robot. actuator: the joint's column.
        softest: column -> K_1 of the drives whose gears' stiffness is known, N m/rad.
        inertias: (na,) of `load_inertias`.
    """
    there = {k: K for k, K in softest.items() if _loads(scene, k, actuator)}
    return sum(float(inertias[k]) / K for k, K in there.items())


def _softest(taken: Mapping[int, Assessment]) -> dict[int, float]:
    """K_1 of the drives' gears, as far as it is known."""
    gears = {k: assessment.candidate.gear for k, assessment in taken.items()}
    return {k: softest(g.stiffness) for k, g in gears.items() if g and g.stiffness is not None}


def with_masses(
    scene: Scene, taken: Mapping[int, Assessment], conditions: Conditions, drives: bool = True
) -> Scene:
    """The scene with the drives' mass on their joints' parent links, and their transmissions."""
    model = scene.model.copy()
    changed = False
    for i, drive in enumerate(scene.drives):
        joint = driven_joint(scene, i)
        if joint is None or model.parents[joint] == 0:
            continue
        if i not in taken:
            continue
        mass = (taken[i].candidate.mass or 0.0) - conditions.mass_in_urdf.get(drive.name, 0.0)
        place = pin.SE3(np.eye(3), model.jointPlacements[joint].translation)
        parent = model.parents[joint]
        point = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
        before = implausible_body(model.inertias[parent].mass, model.inertias[parent].inertia)
        model.appendBodyToJoint(parent, point, place)
        body = model.inertias[parent]
        problem = implausible_body(body.mass, body.inertia)
        if problem and (body.mass < 0 or not before):  # else the URDF's own, warned of on loading
            raise SizingError(
                f"conditions.mass_in_urdf.{drive.name}: without {-mass:g} kg, the link that "
                f"carries this drive is not a possible body: {problem}"
            )
        changed = True
    actuators: Sequence[Actuator] | None = scene.actuators
    if drives and taken:
        chosen = {scene.drives[i].name: a.candidate.transmission for i, a in taken.items()}
        actuators = geared(scene, chosen)
    elif not changed:
        return scene
    return replace(scene, model=model, actuators=actuators)


def without_drives(scene: Scene, names: Collection[str]) -> Scene:
    """Return the scene with no losses of the named drives in their joints' friction.

    Args:
        scene: where `includes_drive` says of friction that it holds them, its Coulomb and viscous
            parts become 0.
        names: of the drives that others replace.
    """
    changed = {
        name: entry.model_copy(
            update={
                key: term.scaled(0.0)
                for key, term in entry
                if key in ("coulomb", "viscous") and term
            }
        )
        for name, entry in scene.friction.items()
        if name in names and entry.includes_drive
    }
    return replace(scene, friction={**scene.friction, **changed}) if changed else scene


def geared(scene: Scene, gears: Mapping[str, Transmission | None]) -> list[Actuator]:
    """Return the scene's actuators, those of the named drives with other transmissions."""
    given = scene.actuators
    if given is None:
        given = [Actuator(joint=drive.name) for drive in scene.drives]
    return [
        a.model_copy(update={"transmission": gears[a.drive_name]}) if a.drive_name in gears else a
        for a in given
    ]


def _loads(scene: Scene, drive: int, actuator: int) -> bool:
    """Whether a drive's mass acts on another joint: the link that holds it hangs on that joint."""
    held, joint = driven_joint(scene, drive), driven_joint(scene, actuator)
    if drive == actuator or held is None:
        return False
    if scene.loops or joint is None:
        return True
    link = int(scene.model.parents[held])
    while link > joint:  # a parent's index is less than its child's
        link = int(scene.model.parents[link])
    return link == joint


def depth(scene: Scene, actuator: int) -> int:
    """Return how many joints lie between the ground and the joint's child, its own included."""
    joint, count = driven_joint(scene, actuator), 0
    while joint:
        joint, count = int(scene.model.parents[joint]), count + 1
    return count


def _failing(found: Sequence[tuple[str, tuple[Criterion, ...]]]) -> tuple[str, ...]:
    """One line for each criterion that fails, with whose it is."""
    return tuple(
        f"{name}: {c.why}" for name, criteria in found for c in criteria if c.status == Status.FAILS
    )


def _names(taken: Mapping[int, Assessment]) -> dict[int, str]:
    return {i: assessment.candidate.name for i, assessment in taken.items()}


def check_names(scene: Scene, conditions: Conditions) -> None:
    """Refuse conditions that name a drive that is not there: `CatalogError`."""
    for key in ("mass_in_urdf", "collision_effort", "bearings", "amplifiers"):
        for name in getattr(conditions, key):
            if name not in scene.actuator_names and (key, name) != ("amplifiers", OTHERS):
                raise CatalogError(
                    f"conditions.{key}: there is no drive {name!r}; "
                    f"{choose_from(name, scene.actuator_names)}"
                )
