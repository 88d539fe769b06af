"""The choice of drives for a robot along its cycles.

Motor and gear of joint j are a point mass at its origin, on its parent link: they load the joints
nearer to the base, not their own. So joints are sized from the tips to the base, each with the
drives chosen beyond it in the model, until no choice changes. The rotor acts on its own motor as
r^2 J a. Left out are the drives' own moments of inertia, their offset from the axis, and gyroscopic
torques of rotors and their share in other joints' inertias (1/r of r^2 J).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinfric.drives.brake import opened, ranked
from pinfric.drives.catalog import Brake, Catalog
from pinfric.drives.demand import DriveCycle, drive_cycle, driven_joint
from pinfric.drives.drivetrain import Candidate
from pinfric.drives.duty import Duty, Schedule, once
from pinfric.drives.friction import without_drives
from pinfric.drives.held import held_drives
from pinfric.drives.limit import JointCase
from pinfric.drives.mounting import mountings, turned_as
from pinfric.drives.parts import own_parts
from pinfric.drives.policy import Conditions
from pinfric.drives.rated import RatedCycle
from pinfric.drives.robot import DrivenRobot, added_masses, carried, equip, tip_to_base
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import MotionLike
from pinfric.errors import PinfricWarning, SizingError, StopError
from pinfric.model.massless import massless
from pinfric.model.scene import Scene
from pinfric.model.schema import Stops
from pinfric.motions.rating import Rated
from pinfric.motions.summary import effort_unit, rms
from pinfric.motions.trajectory import Trajectory
from pinfric.sizing.branch import SwingingArm, stiff_enough
from pinfric.sizing.drive_search import (
    Assessment,
    CatalogArrays,
    DriveSearch,
    Parts,
    momentary_peak,
    stiffness_of,
)
from pinfric.sizing.provisional import provisional
from pinfric.stops.machines import Machines, full_load
from pinfric.stops.peaks import braking, cycle_peaks

#: Passes over all joints before an alternating choice is given up; two are usual.
_MOST_PASSES = 12
#: Passes after which a choice that comes back is banned.
_PATIENCE = 4
#: By which factor more than the peak by algebra a gear must bear where no simulation of the stops
#: follows: simulated peaks are 0.68 to 1.15 of it, once 1.32.
_NOT_SIMULATED = 1.3


@dataclass(frozen=True)
class Task:
    """What is sized: a robot along its cycles.

    Attributes:
        given: the scene. scene: the same without losses of the drives that are replaced.
        motion, duty: the cycles, and which samples are which. rating: that the motion contains.
        catalog: None: demand only. conditions: what is demanded.
        robots: by mounting: the scene's own "", those of `mounting: any`, and those of other
            scenes, whose duties are in `elsewhere`.
        files: that were read. progress: called with a line at each step.
        unloaded: (nv,) joints that move no mass.
        arrays: of the catalogue, by whether they are for sliding joints.
    """

    given: Scene
    scene: Scene
    motion: MotionLike
    duty: Schedule
    rating: RatedCycle | None
    catalog: Catalog | None
    conditions: Conditions
    robots: Mapping[str, DrivenRobot]
    elsewhere: Mapping[str, Duty]
    files: tuple[str, ...]
    unloaded: np.ndarray
    progress: Callable[[str], object]
    arrays: Mapping[bool, CatalogArrays]

    @property
    def robot(self) -> DrivenRobot:
        """As the scene mounts it."""
        return self.robots[""]

    @property
    def stops_once(self) -> bool:
        """Whether stops can be simulated: the scene has `stops`, and there is one cycle."""
        stops = self.scene.stops is not None and self.catalog is not None
        return stops and len(list(self.duty.parts())) == 1

    def with_masses(self, masses: str | Mapping[str, str]) -> Task:
        """Return the same with another `robot.masses` of the scene."""
        given, scene = (replace(x, masses=masses) for x in (self.given, self.scene))
        return replace(self, given=given, scene=scene)

    def added(self, taken: Mapping[int, Assessment]) -> dict[int, float]:
        """Return the masses that drives add to the robot's links, kg, by column."""
        masses = {i: a.mass for i, a in taken.items()}
        return added_masses(self.scene, self.conditions, masses)

    def is_unloaded(self, i: int) -> bool:
        """Return whether a drive's joint moves no mass."""
        column = self.scene.drives[i].velocity_index
        return column >= 0 and bool(self.unloaded[column])

    def one_cycle(self, scene: Scene, robot: DrivenRobot) -> Trajectory:
        """Return the cycles without a rating, or a rating alone, as a motion of a scene."""
        states, rating = robot.result.states, robot.rating
        samples = slice(None) if rating is None else rating.once
        carried = states.attached
        attached = (
            {} if carried is None else dict(zip(scene.payloads, carried[samples].T, strict=True))
        )
        return Trajectory.from_arrays(
            scene,
            robot.result.times[samples],
            states.q[samples],
            states.v[samples],
            states.a[samples],
            attached,
            source=str(getattr(robot.motion, "source", "motion")),
        )


def task_of(
    scene: Scene,
    trajectory: MotionLike | Duty | None,
    catalog: Catalog | None,
    conditions: Conditions,
    progress: Callable[[str], object],
    arrays: Mapping[bool, CatalogArrays],
    rated: Rated | None = None,
) -> Task:
    """Return what is sized; arguments as of `size` and `Task`.

    Raises:
        SizingError: neither a cycle nor a rating, or kinds of both that do not go together; no link
            that moves has a mass.
    """
    # 1. The motion: cycles, a rating, or both one behind the other
    motion: MotionLike
    duty, rating = None, None
    cycles = [c for c, _ in trajectory.cycles] if isinstance(trajectory, Duty) else [trajectory]
    if rated is not None:
        if isinstance(trajectory, Trajectory):
            trajectory = Duty(((trajectory, 1.0),))
        if not isinstance(trajectory, Duty | None):
            raise SizingError("beside a rating the cycle must be a Trajectory or a Duty")
        rating = RatedCycle.of(rated, trajectory)
        motion, duty, scene = rating.motion, rating.schedule, rated.scene
    elif isinstance(trajectory, Duty):
        motion, duty = trajectory.motion(), trajectory.schedule()
    elif trajectory is None:
        raise SizingError("give a cycle, or a rating: rating={'payload': 10} (kg)")
    else:
        motion = trajectory
    drives = [drive.name for drive in scene.drives] if catalog is not None else ()
    given, scene = scene, without_drives(scene, drives)
    # 2. The robot in each of its mountings
    robots = {"": DrivenRobot(scene, motion, duty, conditions, rating)}
    if conditions.mounting == "any":
        for words, gravity in mountings(scene).items():
            turned = scene.with_(gravity=gravity)
            robots[words] = DrivenRobot(turned, motion, duty, conditions, rating)
    elsewhere: dict[str, Duty] = {}
    others = trajectory.elsewhere if isinstance(trajectory, Duty) else ()
    for other, there in others:
        if rated is not None:
            raise SizingError(
                "a rating beside cycles of other scenes: give the condition mounting=any, or "
                "size without the rating"
            )
        words, gravity = turned_as(given, other), other.model.gravity.linear
        if words in elsewhere:
            raise SizingError(f"duty: {words} is there twice; give all its cycles in one duty")
        if catalog is not None and not gravity.any():
            raise SizingError(f"{words}: robot.gravity is [0, 0, 0]; give the gravity")
        elsewhere[words] = there
        turned, schedule = scene.with_(gravity=gravity), there.schedule()
        robots[words] = DrivenRobot(turned, there.motion(), schedule, conditions)
        cycles += [cycle for cycle, _ in there.cycles]
    # 3. What was read, and whether there is anything to size
    files = [given.source, *(other.source for other, _ in others)]
    files += [] if given.robot is None else [str(given.robot.urdf)]
    files += [getattr(cycle, "source", "") for cycle in cycles]
    files += () if catalog is None else catalog.files
    unloaded = massless(scene, scene.payloads)
    if unloaded.all():
        raise SizingError(
            f"{scene.source}: no link that moves has a mass, so there is nothing to size: give "
            "the URDF's links an <inertial>; `pinfric new URDF --mass KG` makes a start"
        )
    return Task(
        given,
        scene,
        motion,
        duty or once(len(robots[""].result.states.q)),
        rating,
        catalog,
        conditions,
        robots,
        elsewhere,
        tuple(map(str, files)),
        unloaded,
        progress,
        arrays,
    )


def catalog_arrays(
    catalog: Catalog, conditions: Conditions, scene: Scene
) -> dict[bool, CatalogArrays]:
    """Return a catalogue's drives for the joints of a scene, by whether these slide."""
    brakes = brakes_of(catalog, scene, conditions)
    sliding = {effort_unit(scene, i) == "N" for i in range(len(scene.drives))}
    return {linear: CatalogArrays(catalog, conditions, linear, brakes) for linear in sliding}


@dataclass(frozen=True)
class Demanded:
    """What drives must meet beside the cycle, by their columns.

    Attributes:
        efforts: that gears must bear in stops, N m or N. note: their source, in words.
        least: what of it a simulation of the stops showed.
        braking: braking under power from each sample, without payload and with.
        most: kg, that a drive may weigh. banned: names of drives that may not be taken again.
    """

    efforts: Mapping[int, float] = field(default_factory=dict)
    note: str = ""
    least: Mapping[int, float] = field(default_factory=dict)
    braking: Mapping[int, tuple[DriveCycle, ...]] = field(default_factory=dict)
    most: float = np.inf
    banned: Mapping[int, frozenset[str]] = field(default_factory=dict)

    def of_stops(self, i: int) -> dict[str, Any]:
        """Return what is known of a joint's stops, as fields of its case."""
        note, braked = self.note * (i in self.efforts), self.braking.get(i, ())
        effort = self.efforts.get(i, np.nan)
        return {"stop_effort": effort, "stop_note": note, "braking": braked}


@dataclass(frozen=True)
class DriveChoice:
    """Drives taken, by their columns: those that fit, provisional ones, the closest ones.

    Attributes:
        demanded: what they were held against beside the cycle.
        passes, settled, open_stops: as of `SizingReport`.
    """

    taken: Mapping[int, Assessment]
    demanded: Demanded
    passes: int = 0
    settled: bool = True
    open_stops: Mapping[int, float] = field(default_factory=dict)

    def fitting(self, i: int) -> Assessment | None:
        """Return a joint's drive, if it fits."""
        taken = self.taken.get(i)
        return taken if taken is not None and taken.fits else None

    @property
    def mass(self) -> float:
        """Of all drives, as far as it is known, kg."""
        return sum(a.mass or 0.0 for a in self.taken.values())


def _names(taken: Mapping[int, Assessment]) -> dict[int, str]:
    return {i: assessment.name for i, assessment in taken.items()}


def bearing_stops(task: Task, demanded: Demanded | None = None) -> DriveChoice:
    """Choose drives whose gears bear the peaks of all joints' stops with these drives.

    Only the peaks of the last choice count, so that the result depends on no earlier one; where
    choices come back, the largest of all. Where no simulation of the stops follows, gears must bear
    1.3 times the peaks. A rating alone demands no stops unless the scene has `stops`.
    """
    choice, scene, seen = choose(task, demanded or Demanded()), task.scene, list[dict[int, str]]()
    if task.catalog is None:
        return choice
    for _ in range(_MOST_PASSES):
        taken, before = choice.taken, choice.demanded
        if scene.stops is None and not any(a.candidate.brake for a in taken.values()):
            break
        # 1. What the gears must bear with this choice
        fit = len(taken) == len(scene.drives) and all(a.fits for a in taken.values())
        factor = 1.0 if task.stops_once and fit else _NOT_SIMULATED
        try:
            most, powered = _stop_peaks(task, taken)
        except StopError:  # the simulation says what is missing
            break
        if np.isnan(most).any():
            return replace(choice, open_stops=dict.fromkeys(taken, np.nan))
        peaks = {i: max(factor * float(most[i]), before.least.get(i, 0.0)) for i in taken}
        if task.rating is not None and not task.rating.cycles and scene.stops is None:
            return replace(choice, open_stops=peaks)
        if _names(choice.taken) in seen:
            peaks |= {i: max(x, peaks[i]) for i, x in before.efforts.items() if i in peaks}
        note = f"{factor:g} x " * (factor > 1.0) + "the peak in stops of all joints"
        after = replace(before, efforts=peaks, note=note)
        if not before.efforts and not overloaded(peaks, taken) and not powered:
            stopped = {i: a.where(**after.of_stops(i)) for i, a in taken.items()}
            return replace(choice, taken=stopped, demanded=after)  # it stays the lightest
        # 2. The choice that bears it
        seen.append(_names(choice.taken))
        braked = {
            i: tuple(drive_cycle(x, i, np.zeros(len(x.effort_lower), dtype=bool)) for x in powered)
            for i in taken
        }
        task.progress("gears that bear the stops of all joints together")
        again = choose(task, replace(after, braking=braked))
        choice = replace(again, passes=choice.passes + again.passes)
        if _names(choice.taken) == seen[-1]:
            break
    return choice


def overloaded(peaks: Mapping[int, float], taken: Mapping[int, Assessment]) -> dict[int, float]:
    """Return the peaks (N m or N), by column, that are more than gears bear."""
    return {i: peak for i, peak in peaks.items() if i in taken and peak > momentary_peak(taken[i])}


def _stop_peaks(
    task: Task, taken: Mapping[int, Assessment]
) -> tuple[np.ndarray, tuple[InverseResult, ...]]:
    """Return `cycle_peaks` of a choice, the largest of all mountings, and `braking`.

    NaN: several drives share a motion, or do not determine it. A brake's least inertia counts: a
    heavy rotor relieves its gear. Without `stops` in the scene all brakes close at once.
    """
    if task.scene.mobility.redundant:
        return np.full(len(task.scene.drives), np.nan), ()
    stops, chosen = task.scene.stops, dict[int, Candidate]()
    for i, candidate in ((i, a.candidate) for i, a in taken.items()):
        if (gear := candidate.transmission) is not None and gear.brake and candidate.brake_entry:
            brake = gear.brake.model_copy(update={} if stops else {"engage_time": None})
            low, high = candidate.brake_entry.inertia_ends
            inertia = gear.rotor_inertia - (high - low)
            gear = gear.model_copy(update={"rotor_inertia": inertia, "brake": brake})
            candidate = replace(candidate, transmission=gear)
        chosen[i] = candidate
    scene = equip(task.scene, chosen, task.conditions)
    powers, most = list[InverseResult](), np.zeros(len(scene.drives))
    for words, robot in task.robots.items():
        gravity = robot.scene.model.gravity.linear
        turned = scene.with_(gravity=gravity) if words else scene
        motion = task.one_cycle(turned, robot)
        settings = stops or Stops(category=0, reaction_time=0.0)
        machines = Machines(turned, settings, full_load(turned, motion))
        powered = braking(machines, motion)
        most = np.maximum(most, cycle_peaks(machines, motion, powered))
        powers += powered
    return most, tuple(powers)


def choose(task: Task, demanded: Demanded) -> DriveChoice:
    """Return the lightest drives that fit, each with the masses of those beyond it in the model.

    Warns:
        PinfricWarning: it still alternates after twelve passes.
    """
    taken: dict[int, Assessment] = {}
    if task.catalog is None:
        return DriveChoice(taken, demanded)
    seen: list[dict[int, Assessment]] = []
    for passes in range(1, _MOST_PASSES + 1):
        before = _names(taken)
        searches: dict[int, DriveSearch] = {}
        for i in tip_to_base(task.scene):
            task.progress(f"pass {passes}: {task.scene.drives[i].name}")
            search = search_at(task, i, task.added(taken), demanded)
            if search is None:
                continue
            searches[i] = search
            best = search.lightest() or provisional(search) or search.nearest()
            taken.pop(i, None)
            if best is not None:
                taken[i] = best
        if task.conditions.lowest_frequency is not None:
            taken = _together(task, taken, searches)
        taken |= _shared(task, taken, searches)
        exact = {k: m for k, m in task.added(taken).items() if m and carried(task.scene, k)}
        if _names(taken) == before and (task.robot.exact or task.robot.last.masses == exact):
            return DriveChoice(taken, demanded, passes)
        for robot in task.robots.values():
            robot.solve(task.added(taken))
        demanded = _ban(task, demanded, seen, taken)
    warnings.warn(
        f"the choice of drives still alternates after {_MOST_PASSES} passes",
        PinfricWarning,
        stacklevel=4,
    )
    return DriveChoice(taken, demanded, _MOST_PASSES, settled=False)


def search_at(
    task: Task, i: int, masses: Mapping[int, float], demanded: Demanded
) -> DriveSearch | None:
    """Return the drives of the catalogue at a joint; None: it takes none.

    Args:
        i: the drive's column. masses: that other drives add, kg, by their columns.
    """
    catalog = task.catalog
    if catalog is None or driven_joint(task.scene, i) is None or task.is_unloaded(i):
        return None
    linear = effort_unit(task.scene, i) == "N"
    name, arrays = task.scene.drives[i].name, task.arrays[linear]
    own = own_parts(catalog, task.conditions, name, linear)
    if (taken := task.conditions.take.get(name)) is not None:
        arrays = arrays.only(taken)
    parts = Parts(own, demanded.banned.get(i, frozenset()), demanded.most)
    first, *others = cases(task, i, masses, demanded).values()
    return DriveSearch(arrays, first, parts, [DriveSearch(arrays, x, parts) for x in others])


def cases(
    task: Task, i: int, masses: Mapping[int, float], demanded: Demanded
) -> dict[tuple[str, str], JointCase]:
    """Return a joint for each part of a rating and mounting, that of largest RMS effort first.

    A brake holds the largest load of all mountings, where their motions differ in every pose.

    Args: as of `search_at`.
    """
    stops = demanded.of_stops(i)
    of_joint = {
        (part, mounting): robot.case(i, masses, schedule)._replace(**stops)
        for mounting, robot in task.robots.items()
        for part, schedule in (
            {"": None} if robot.rating is None else robot.rating.means(i)
        ).items()
    }
    if len(task.robots) > 1:
        rests = [case.rest for case in of_joint.values() if case.rest is not None]
        loads = [np.abs(demand.load) for demand in rests]
        alike = len({len(load) for load in loads}) == 1
        most = np.max(loads, axis=0) if alike else max(load.max() for load in loads)
        peak = max(demand.peak for demand in rests)
        of_joint = {
            key: case._replace(
                rest=case.rest and case.rest._replace(load=most + 0.0 * case.rest.load, peak=peak)
            )
            for key, case in of_joint.items()
        }
    effort = {key: rms(c.cycle.stretched, c.cycle.ends[0]) for key, c in of_joint.items()}
    return {key: of_joint[key] for key in sorted(of_joint, key=lambda key: -effort[key])}


def _ban(
    task: Task,
    demanded: Demanded,
    seen: list[dict[int, Assessment]],
    taken: Mapping[int, Assessment],
) -> Demanded:
    """Ban the lightest alternating drive at the outermost joint where a choice comes back."""
    names, before = _names(taken), [_names(choice) for choice in seen]
    seen.append(dict(taken))
    if len(before) >= _PATIENCE and names in before[:-1]:
        for i in tip_to_base(task.scene):
            alternating = [choice.get(i) for choice in seen[before.index(names) :]]
            mass = {a.name: a.mass or 0.0 for a in alternating if a is not None}
            if len(mass) + (None in alternating) > 1:
                banned = demanded.banned.get(i, frozenset()) | {min(mass, key=mass.__getitem__)}
                return replace(demanded, banned={**demanded.banned, i: banned})
    return demanded


def _together(
    task: Task, taken: dict[int, Assessment], searches: Mapping[int, DriveSearch]
) -> dict[int, Assessment]:
    """Return the lightest set that swings no slower than `lowest_frequency`, or `taken`."""
    wanted, scene = task.conditions.lowest_frequency, task.scene
    turning = [i for i in sorted(searches) if not searches[i].arrays.linear]
    fronts = [searches[i].front() for i in turning]
    if wanted is None or scene.loops or not turning or not all(fronts):
        return taken
    task.progress(f"drives that swing at {wanted:g} Hz together")
    others = {i: m for i, m in task.added(taken).items() if i not in turning}
    table = [
        [
            (
                a.mass or 0.0,
                stiffness_of(a),
                task.added({i: a}).get(i, 0.0) if carried(scene, i) else 0.0,
            )
            for a in front
        ]
        for i, front in zip(turning, fronts, strict=True)
    ]
    picked, _ = stiff_enough(_arm(task, turning, others, wanted), table)
    if picked is None:
        return taken
    return taken | {i: front[p] for i, front, p in zip(turning, fronts, picked, strict=True)}


def _arm(
    task: Task, turning: Sequence[int], others: Mapping[int, float], frequency: float
) -> SwingingArm:
    robot, scene = task.robot, task.scene
    states = robot.base.result.states
    poses = np.flatnonzero(np.append(True, (states.q[1:] != states.q[:-1]).any(axis=1)))
    own = [scene.drives[i].velocity_index for i in turning]
    still = robot.mass_matrices(others, poses)
    per_mass = np.zeros((len(turning), len(poses), len(own), len(own)))
    for k, i in enumerate(turning):
        if carried(scene, i):
            more = robot.mass_matrices({**others, i: 1.0}, poses) - still
            per_mass[k] = more[:, own][:, :, own]
    return SwingingArm(still[:, own][:, :, own], per_mass, frequency)


def _shared(
    task: Task, taken: Mapping[int, Assessment], searches: Mapping[int, DriveSearch]
) -> dict[int, Assessment]:
    """Return the lightest motor and gear of each group of `same_drive` that fits all its joints."""
    shared: dict[int, Assessment] = {}
    for group in task.conditions.same_drive:
        own = [i for i in map(task.scene.actuator_names.index, group) if i in searches]
        if not own:
            continue
        heaviest = max(own, key=lambda i: taken[i].mass or 0.0 if i in taken else 0.0)
        for _, _, *drive in searches[heaviest].offers():
            judged = {i: searches[i].judge(*drive) for i in own}
            banned = {a.name for a in judged.values()} & {
                name for i in own for name in searches[i].parts.banned
            }
            if all(a.fits for a in judged.values()) and not banned:
                shared |= judged
                break
    return shared


def contradiction(task: Task, taken: Mapping[int, Assessment]) -> str:
    """Say that links are lighter than the drives that they are said to hold; else empty."""
    masses = {i: a.mass for i, a in taken.items()}
    held = held_drives(task.scene, masses, task.conditions.mass_in_urdf)
    worst = held[0] if held[0].share > 1.0 else max(held, key=lambda one: one.share)
    if worst.share <= 1.0:
        return ""
    return (
        f"robot.masses: {worst.where} weigh {worst.links:.3g} kg and cannot hold "
        f"{worst.drives:.3g} kg of drives: write `without_drives`, or correct the masses"
    )


def light_enough(task: Task, choice: DriveChoice) -> tuple[DriveChoice, str] | None:
    """Return a choice of drives that the links can hold, and what is said of it, or None.

    Each drive weighs at most the least of links' mass per drive; it may be provisional.
    """
    each = held_drives(task.scene, dict.fromkeys(choice.taken, 1.0), task.conditions.mass_in_urdf)
    most = min(held.links / held.drives for held in each if held.drives)
    light = bearing_stops(task, replace(choice.demanded, efforts={}, most=most))
    fit = light.taken.keys() == choice.taken.keys()
    fit = fit and all(a.fits or a.would for a in light.taken.values())
    if not fit or contradiction(task, light.taken):
        return None
    why = contradiction(task, choice.taken).partition(" of drives: ")[0]
    return light, (
        f"{why} of drives that can be signed: lighter ones, of at most {most:.2g} kg each, are "
        "provisional, or write `without_drives`"
    )


def brakes_of(catalog: Catalog, scene: Scene, conditions: Conditions) -> dict[str, Brake]:
    """Return the brakes that a robot may have and open, the smallest first.

    Where the scene has `stops`, those with an `engage_time`, if there are any.
    """
    brakes = opened(catalog.brakes, conditions)
    timed = {n: brake for n, brake in brakes.items() if brake.engage_time is not None}
    return ranked(brakes if scene.stops is None else timed or brakes)
