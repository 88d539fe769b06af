"""Stops of a cycle: stopping times and ways, the tool's path, what brakes and gears bear.

Category 0 and 1 of IEC 60204-1, commanded anywhere along the cycle, at 33, 66 and 100 % of its
speed and of its payload (ISO 10218-1, annex B). Friction and brakes at their least give the longest
stops, the farthest sag and the most energy of brakes; at their greatest the gears' peaks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pinfric.drives.criterion import Criterion
from pinfric.errors import StopError, TrajectoryError
from pinfric.model.brakes import BRAKE_PEAK
from pinfric.model.brief import file_name, screen
from pinfric.model.described import described, gathered, quantity
from pinfric.model.floating import stands
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.schema import Stops
from pinfric.model.upward import Shown
from pinfric.motions.trajectory import Trajectory
from pinfric.stops.axes import AxisStop, StopGrid, axis_stop, not_met, stop_grid
from pinfric.stops.machines import Machines, check_brakes, full_load, stop_settings
from pinfric.stops.motion import StopMotion
from pinfric.stops.search import StopCycle, Stopped, StopSearch

#: Parts of the cycle's speed and of its payload that are tabulated (ISO 10218-1, annex B).
SHARES = (0.33, 0.66, 1.0)


@dataclass(frozen=True, eq=False)
class StopResult(Shown):
    """The stops of a cycle.

    Attributes:
        settings: how it was stopped. search: all stops that were simulated.
        grid: time and travel of each drive's joint by payload and speed, the worse of two samples.
    """

    scene: Scene
    trajectory: Trajectory
    settings: Stops
    search: StopSearch
    grid: tuple[StopGrid, ...]

    def __repr__(self) -> str:
        worst = self.longest
        path = "" if self.farthest is None else f"{self.farthest.path:.3g} m"
        return screen(
            "StopResult",
            f"{file_name(self.scene.source)}: category {self.settings.category}, "
            f"{len(self.search.found)} stops",
            {
                "longest": f"{worst.time:.3g} s, commanded at {worst.command:.3g} s",
                "tool": path,
                "unmet": "; ".join(self.unmet),
                "more": ".axes .grid .longest .farthest .check() .summary() .plot()",
            },
        )

    @cached_property
    def longest(self) -> Stopped:
        """The stop that takes the longest."""
        return self.search.worst(lambda stop: stop.time)

    @cached_property
    def farthest(self) -> Stopped | None:
        """The stop with the longest way of the tool; None: the scene has no `tool`."""
        if self.search.cycle.path is None:
            return None
        return self.search.worst(lambda stop: stop.path or 0.0)

    @cached_property
    def axes(self) -> tuple[AxisStop, ...]:
        """The worst of each drive's joint, in the order of the drives."""
        return tuple(axis_stop(self.search, d) for d in range(len(self.scene.drives)))

    @cached_property
    def worst_motions(self) -> tuple[tuple[Stopped, StopMotion], ...]:
        """The stop in which each drive's joint goes farthest, and its motion."""
        worst = map(self.search.farthest, range(len(self.scene.drives)))
        return tuple((found, self.search.motion(found.case)) for found in worst)

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        """All criteria, those of each drive together."""
        return tuple(c for axis in self.axes for c in axis.criteria)

    @property
    def unmet(self) -> tuple[str, ...]:
        """A line for each criterion that is not met."""
        return tuple(not_met(axis.name, c) for axis in self.axes for c in axis.criteria if c.fails)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What is assumed, and what is not known."""
        return tuple(_notes(self))

    def check(self) -> StopResult:
        """Return the result, or raise `StopError` if a criterion is not met."""
        if self.unmet:
            raise StopError("; ".join(self.unmet))
        return self


@described
class StopSummary:
    """The stops of a cycle."""

    trajectory: str = quantity("the cycle's file")
    category: int = quantity("of IEC 60204-1")
    reaction_time: float = quantity("from the command until the drives react", "s")
    friction: tuple[float, float] = quantity("least and greatest factor on all friction")
    payload: tuple[str, ...] = quantity("payloads of the full load")
    time: float = quantity("longest time from the command until all is at rest", "s")
    command: float = quantity("when in the cycle that stop is commanded", "s")
    path: float | None = quantity("longest way of the tool; none: the scene has no tool", "m")
    path_command: float | None = quantity("when in the cycle that stop is commanded", "s")
    axes: tuple[AxisStop, ...] = quantity("the worst of each drive's joint")
    grid: tuple[StopGrid, ...] = quantity("by payload and speed, at each joint's worst samples")
    stops: int = quantity("number of stops simulated")
    unmet: tuple[str, ...] = quantity("criteria that are not met")
    notes: tuple[str, ...] = quantity("what is assumed, and what is not known")


def stop_summary(result: StopResult) -> StopSummary:
    """Return what `pinfric stop` prints and writes."""
    longest, farthest = result.longest, result.farthest
    return gathered(
        StopSummary,
        result,
        trajectory=result.trajectory.source,
        category=result.settings.category,
        reaction_time=result.settings.reaction_time,
        friction=result.settings.friction,
        payload=result.search.machines.full,
        time=longest.time,
        command=longest.command,
        path=None if farthest is None else farthest.path,
        path_command=None if farthest is None else farthest.command,
        stops=len(result.search.found),
    )


def stop(
    scene: Scene,
    trajectory: Trajectory,
    *,
    category: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> StopResult:
    """Return the worst stops of a cycle: times, ways, the tool's path, loads of brakes and gears.

    From any sample of the cycle the drives react, `reaction_time` after the command. Category 0:
    power goes off, each brake closes after its `engage_time`. Category 1: the robot is braked
    under power until it is at rest, on its path or each axis by itself, then power goes off. The
    stop is simulated with the scene's friction and gears; a closed brake is dry friction at the
    motor's shaft (`pinfric.stops`).

    Args:
        scene: with a `stops` section, transmissions, and brakes where gravity acts.
        category: 0 or 1 of IEC 60204-1, in place of the section's.
        progress: function of the stops done and the stops expected.

    Raises:
        StopError: the scene lacks a `stops` section, a transmission or a brake's `engage_time`; a
            joint does not come to rest. Names what to give.
        TrajectoryError: the reaction takes longer than the trajectory.
    """
    expect_scene(scene, "stop")
    if stands(scene):
        raise StopError(
            f"{scene.source}: stop: forces at the feet hold this robot, and what they are while "
            "it stops and falls is not known: stop it on a fixed base (`floating: false`)"
        )
    scene = scene.without_presliding
    machines = Machines(scene, stop_settings(scene, category), full_load(scene, trajectory))
    return stops_of(machines, trajectory, progress)


def stops_of(
    machines: Machines,
    trajectory: Trajectory,
    progress: Callable[[int, int], None] | None = None,
) -> StopResult:
    """Return the worst stops of a cycle as `stop` does, and raise what it raises."""
    cycle = checked_cycle(machines, trajectory)
    return result_of(StopSearch(machines, cycle, progress or (lambda done, total: None)))


def checked_cycle(machines: Machines, trajectory: Trajectory) -> StopCycle:
    """Return a cycle as stops need it, and raise what `stop` raises before it simulates."""
    scene, settings = machines.scene, machines.settings
    check_brakes(scene)
    if trajectory.duration < settings.reaction_time:
        raise TrajectoryError(
            f"{trajectory.source}: lasts {trajectory.duration:g} s, less than the reaction_time "
            f"{settings.reaction_time:g} s of {scene.source}: the robot's motion after the command "
            "is not known; give a longer trajectory"
        )
    return StopCycle.of(machines, trajectory)


def result_of(search: StopSearch) -> StopResult:
    """Return the worst stops of a search that measures all."""
    search.run()
    machines, trajectory = search.machines, search.cycle.trajectory
    grid = [row for d in range(len(machines.scene.drives)) for row in stop_grid(search, d, SHARES)]
    return StopResult(machines.scene, trajectory, machines.settings, search, tuple(grid))


def _notes(result: StopResult) -> list[str]:
    scene, settings = result.scene, result.settings
    brakes = {d.name: d.transmission.brake for d in scene.drives if d.transmission is not None}
    none = [name for name, brake in brakes.items() if brake is None]
    taken = [n for n, b in brakes.items() if b is not None and b.torque_max is None]
    lines = []
    if settings.friction == (1.0, 1.0):
        lines.append(
            "friction as the scene has it; `stops.friction` takes its least and greatest factor"
        )
    if taken:
        lines.append(
            f"{', '.join(taken)}: gears' peaks by {BRAKE_PEAK:g} x `torque`, since the brake's "
            "`torque_max` is not known"
        )
    if settings.category == 1:
        along = settings.along_path and settings.deceleration
        lines.append(
            "braked along the path: all axes stop together"
            if along
            else "each axis brakes by itself, so the tool leaves its path"
        )
        if along and result.trajectory.v[-1].any():
            lines.append(
                "the trajectory ends at speed: stops that pass its end go straight on in the "
                "joints; give a longer trajectory"
            )
    if none:
        lines.append(f"{', '.join(none)}: without a brake, stopped by friction")
    if scene.tool is None:
        lines.append("the scene names no `tool`: its path is not known")
    stepped = sum(stop.stepped for stop in result.search.found.values())
    if stepped:
        lines.append(
            f"{stepped} stops in part by time stepping, not by events: these accumulate, or "
            "several accelerations obey the laws of friction at rest"
        )
    lines.append(
        f"{len(result.search.found)} stops simulated, from {len(result.trajectory.t)} samples of "
        f"{Path(result.trajectory.source).name}: candidates by an estimate, then around the worst"
    )
    return lines
