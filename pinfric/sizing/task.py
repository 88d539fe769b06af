"""What is sized: a robot along its cycles, in each of its mountings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinfric.drives.brake import coil_supply, ranked
from pinfric.drives.catalog import Brake, Catalog
from pinfric.drives.duty import Duty, Schedule, once
from pinfric.drives.friction import without_drives
from pinfric.drives.mounting import mountings, turned_as
from pinfric.drives.parts import output_of
from pinfric.drives.payloads import points, with_bodies
from pinfric.drives.policy import Conditions
from pinfric.drives.rated import RatedCycle
from pinfric.drives.robot import DrivenRobot, added_masses
from pinfric.dynamics.samples.states import MotionLike
from pinfric.errors import SizingError
from pinfric.model.massless import massless
from pinfric.model.scene import Scene
from pinfric.motions.rating import Rated
from pinfric.motions.trajectory import Trajectory
from pinfric.sizing.drive_search import Assessment, CatalogArrays


@dataclass(frozen=True)
class Task:
    """What is sized: a robot along its cycles.

    Attributes:
        given: the scene. scene: the same without losses of the drives that are replaced.
        motion, duty: the cycles, and which samples are which. rating: that the motion contains.
        catalog: None: demand only. conditions: what is demanded.
        robots: by mounting: the scene's own "", those of `mounting: any`, and those of other
            scenes, whose duties are in `elsewhere`.
        points: the same robots with payloads as points, where `guessed` ones are cubes of water;
            empty: there are none.
        guessed: names of the payloads whose inertia is not given.
        assemblies: of closed loops that a search chose, see `Trajectory`; nothing is signed there.
        files: that were read. progress: called with a line at each step.
        unloaded: (nv,) joints that move no mass.
        arrays: of the catalogue, by what joints take (`parts.output_of`).
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
    arrays: Mapping[str, CatalogArrays]
    points: Mapping[str, DrivenRobot]
    guessed: tuple[str, ...]
    assemblies: tuple[str, ...] = ()

    @property
    def robot(self) -> DrivenRobot:
        """As the scene mounts it."""
        return self.robots[""]

    def every_robot(self) -> Iterator[tuple[str, DrivenRobot]]:
        """Yield each robot by its mounting, those with payloads as points last."""
        yield from self.robots.items()
        yield from self.points.items()

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
    arrays: Mapping[str, CatalogArrays],
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
    known, guessed = scene, points(scene)
    given = with_bodies(scene)
    scene = without_drives(given, drives)
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
        words, gravity = turned_as(known, other), other.model.gravity.linear
        if words in elsewhere:
            raise SizingError(f"duty: {words} is there twice; give all its cycles in one duty")
        if catalog is not None and not gravity.any():
            raise SizingError(f"{words}: robot.gravity is [0, 0, 0]; give the gravity")
        elsewhere[words] = there
        turned, schedule = scene.with_(gravity=gravity), there.schedule()
        robots[words] = DrivenRobot(turned, there.motion(), schedule, conditions)
        cycles += [cycle for cycle, _ in there.cycles]
    apart = {
        words: DrivenRobot(
            replace(robot.scene, payloads=known.payloads),
            robot.motion,
            robot.duty,
            conditions,
            robot.rating,
            like=robot,
        )
        for words, robot in robots.items()
        if guessed
    }
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
        apart,
        guessed,
        tuple(dict.fromkeys(x for c in cycles if (x := getattr(c, "assembly", "")))),
    )


def catalog_arrays(
    catalog: Catalog, conditions: Conditions, scene: Scene
) -> dict[str, CatalogArrays]:
    """Return a catalogue's drives for the joints of a scene, by what these take."""
    brakes = brakes_of(catalog, scene, conditions)
    outputs = {output_of(scene, i, conditions) for i in range(len(scene.drives))} - {""}
    return {output: CatalogArrays(catalog, conditions, output, brakes) for output in outputs}


def brakes_of(catalog: Catalog, scene: Scene, conditions: Conditions) -> dict[str, Brake]:
    """Return the brakes that a robot may have, the smallest first, those that it can open before.

    Where the scene has `stops`, those with an `engage_time`, if there are any.
    """
    timed = {n: brake for n, brake in catalog.brakes.items() if brake.engage_time is not None}
    brakes = catalog.brakes if scene.stops is None else timed or catalog.brakes
    return ranked(brakes, coil_supply(conditions))
