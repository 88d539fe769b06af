"""Motor sizing: the demand of a cycle on each drive, and the drives of a catalogue that fit."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pinfric.drives.catalog import Catalog
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.demand import hardest, joint_demand
from pinfric.drives.drivetrain import motor_cycle
from pinfric.drives.duty import Duty
from pinfric.drives.limit import JointCase
from pinfric.drives.parts import check_names, output_of
from pinfric.drives.payloads import guessed_bodies
from pinfric.drives.policy import Conditions, parse_conditions
from pinfric.drives.robot import carried, equip
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.samples.states import MotionLike
from pinfric.errors import PinfricWarning, SizingError
from pinfric.model.brief import file_name
from pinfric.model.floating import stands
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.schema import OTHERS
from pinfric.motions.rating import Rating, parse_rating, rate
from pinfric.motions.summary import beyond_limits, moves_beyond, rms
from pinfric.motions.trajectory import Trajectory
from pinfric.sizing.caveats import caveats, discontinuities, unclosed
from pinfric.sizing.choice import (
    OF_DRIVES,
    QUESTIONS,
    Choice,
    asked,
    contradiction,
    hopeless,
    open_stops,
    said_of_links,
    settle,
    simulated_stops,
)
from pinfric.sizing.drive_search import Assessment
from pinfric.sizing.elastic_arm import check_tool
from pinfric.sizing.memory import Memory, cases
from pinfric.sizing.report import JointSizing, SizingReport
from pinfric.sizing.sensitivity import sensitivities
from pinfric.sizing.task import Task, catalog_arrays, task_of


def size(
    scene: Scene,
    trajectory: MotionLike | Duty | None = None,
    catalog: Catalog | str | Path | None = None,
    *,
    rating: Rating | Mapping[str, Any] | None = None,
    conditions: Conditions | Mapping[str, Any] | None = None,
    on_miss: Literal["warn", "raise", "ignore"] = "warn",
    sensitivity: bool = False,
    progress: Callable[[str], object] | None = None,
) -> SizingReport:
    """Return the demand of a repeated cycle on each drive, and the drives of a catalogue that fit.

    Of every joint, from its effort interval (paper eq. 16, 17; at rest 21, 22): peak, RMS, power,
    holding and break-away effort. With a catalogue: of all motors with all gears that they go with,
    the lightest that meets `limits.LIMITS` and lacks no figure of `policy.NEEDS`, tip to base, with
    the chosen drives' mass in the model; with `lowest_frequency` the lightest set that swings no
    slower.

    Args:
        scene: the robot with its friction. Its `robot.masses` says whether the links hold the
            drives; if not, these are added. The candidates replace its transmissions.
        trajectory: one cycle, with times, repeated without a pause; `SizingReport.unclosed` and a
            note say if it does not end as it began. Several cycles: as a `Duty`. None: by the
            rating alone.
        catalog: a `Catalog`, a file, "default" for the bundled one, or None for the demand only.
        rating: what the arm is built for before it has a cycle, `{"payload": 10}` (kg): held in the
            worst posture of each joint and lifted from there by it alone (`motions.rating`). Beside
            a cycle each joint gets what bears both.
        conditions: in place of the catalogue's: a mapping, or what was set in a `Conditions`.
        on_miss: what to do if no candidate fits a joint; the report says so in any case.
        sensitivity: also by which factors on friction, payloads and speed the choice changes.
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
    if stands(scene):
        raise SizingError(
            f"{scene.source}: size: forces at the feet hold this robot, and they change with the "
            "masses of the drives that size tries: `pinfric inverse` gives each joint's efforts "
            "under given forces"
        )
    scene = scene.without_presliding
    if isinstance(catalog, str | Path):
        catalog = load_catalog(catalog)
    if catalog is not None and not scene.model.gravity.linear.any():
        raise SizingError(
            f"{scene.source}: robot.gravity is [0, 0, 0]: drives and brakes chosen so would not "
            "bear the robot's weight; give the gravity, or size without a catalogue"
        )
    default = Conditions() if catalog is None else catalog.conditions
    wanted = parse_conditions(conditions or {}, default)
    check_names(scene, wanted, catalog)
    check_tool(scene, wanted)
    tell = progress or (lambda _: None)
    trajectory, rating = _motion_of_rating(trajectory, rating)
    rated = None if rating is None else rate(scene, rating)
    arrays = {} if catalog is None else catalog_arrays(catalog, wanted, scene)
    memory = Memory()
    tell("inverse dynamics of the cycle" if rated is None else "inverse dynamics of the rating")
    given = task_of(scene, trajectory, catalog, wanted, tell, arrays, rated)
    task, choice = settle(given, memory, Choice(), QUESTIONS)
    tell("the robot with these drives")
    report = _report(task, memory, choice)
    if sensitivity:
        by = None if rating is None else (parse_rating(rating), rate)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PinfricWarning)  # said of the loads that are given
            found = sensitivities(task, choice, scene, trajectory, by)
        report = replace(report, sensitivity=found)
    if on_miss == "raise":
        report.check()
    for text in report.verdict.failing if on_miss == "warn" else ():
        warnings.warn(text, PinfricWarning, stacklevel=2)
    return report


def _motion_of_rating(
    trajectory: MotionLike | Duty | None, rating: Rating | Mapping[str, Any] | None
) -> tuple[MotionLike | Duty | None, Rating | Mapping[str, Any] | None]:
    """Take the motion that `new` writes of a rating as the rating: as a cycle it would dilute it.

    Raises:
        SizingError: it stands among cycles, or beside another rating.
    """
    cycles = [(trajectory, 1.0)]
    if isinstance(trajectory, Duty):
        others = (duty.cycles for _, duty in trajectory.elsewhere)
        cycles = [*trajectory.cycles, *(cycle for other in others for cycle in other)]
    rated = [x for x, _ in cycles if isinstance(x, Trajectory) and x.rating is not None]
    if not rated:
        return trajectory, rating
    own, source = rated[0].rating, file_name(rated[0].source)
    assert own is not None
    if len(cycles) > 1:
        raise SizingError(
            f"{source}: is the motion of a rating, not a cycle: leave it out, and give the rating "
            f"beside the cycles (--rating payload={own.payload:g})"
        )
    if rating is not None and parse_rating(rating) != own:
        raise SizingError(
            f"{source}: is the motion of another rating, {own.payload:g} kg: give one of the two"
        )
    return None, own


def _report(task: Task, memory: Memory, choice: Choice) -> SizingReport:
    for _, robot in () if task.robot.exact else task.every_robot():
        robot.solve(dict(choice.solved))
    joints = tuple(_joint(task, memory, choice, i) for i in range(len(task.scene.drives)))
    screened, no_stops = simulated_stops(task, memory, choice)
    chosen = {i: a.candidate for i, a in choice.taken.items()}
    equipped = equip(task.scene, chosen, task.conditions) if chosen else task.scene
    without, rating = task.robot.base.result, task.rating
    cycles = rating is None or rating.duty is not None
    own = slice(None) if rating is None else rating.own  # a rating's speeds are what is asked for
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
        passes=choice.rounds,
        settled=choice.settled,
        assumptions=caveats(
            task.given,
            task.catalog,
            gaps,
            discontinuities(without, task.duty) if cycles else (),
            beyond_limits(without),
        ),
        unclosed=gaps,
        contradiction=said_of_links(choice),
        screened=screened,
        no_stops=no_stops,
        other_mass=_other_mass(task, memory, choice),
        lighter=_lighter(task, memory, choice),
        rating=rating,
        elsewhere=tuple(task.elsewhere),
        bodies=guessed_bodies(task.given, task.guessed),
        point_mass=_point_mass(task, choice),
        beyond=(
            *moves_beyond(without.scene, without.states.q[own], without.states.v[own]),
            *task.assemblies,
        ),
        open_stops=open_stops(task, memory, choice),
    )


def _other_mass(task: Task, memory: Memory, choice: Choice) -> float | None:
    scene = task.scene
    names, holds = scene.actuator_names, scene.masses_hold
    if not any(holds[i] is None and carried(scene, i) for i in choice.taken):
        return None
    bare = {n: "without_drives" for n, hold in zip(names, holds, strict=True) if hold is False}
    other = task.with_masses({**bare, OTHERS: "with_drives"})
    held = settle(other, memory, Choice(most=choice.most), OF_DRIVES)[1]
    return None if contradiction(other, held.taken) else held.mass


def _point_mass(task: Task, choice: Choice) -> float | None:
    """Mass of the drives that payloads would take as points, kg; None: none is guessed."""
    if not task.points or not choice.taken:
        return None
    as_points = replace(task, robots=task.points, points={}, progress=lambda _: None)
    begin = Choice(bare=choice.bare, most=choice.most)
    return settle(as_points, Memory(), begin, OF_DRIVES)[1].mass


def _lighter(task: Task, memory: Memory, choice: Choice) -> dict[int, Assessment]:
    """Drives that weigh no more than what they move, where the signed ones outweigh it.

    Each weighs at most its share of that mass; they may be provisional. Empty: there are none.
    """
    moved = sum(body.mass for body in list(task.scene.model.inertias)[1:])
    moved += max((x.mass for x in task.scene.payloads.values()), default=0.0)
    if choice.mass <= moved or not all(a.fits for a in choice.taken.values()):
        return {}
    most = moved / len(choice.taken)
    silent = replace(task, progress=lambda _: None)
    begin = Choice(bare=choice.bare, most=most)
    if hopeless(silent, memory, begin):
        return {}
    light = settle(silent, memory, begin, OF_DRIVES)[1].taken
    fit = light.keys() == choice.taken.keys() and all(a.fits or a.would for a in light.values())
    return dict(light) if fit else {}


def _joint(task: Task, memory: Memory, choice: Choice, i: int) -> JointSizing:
    masses, drive = task.added(choice.taken), choice.taken.get(i)
    of_joint, found = cases(task, i, masses), asked(task, memory, choice, i)
    search = None if found is None else found.search
    # other scenes have motions of their own, which the tables do not show
    shown = {key: c for key, c in of_joint.items() if key[1] not in task.elsewhere}
    same = {n: c for n, c in shown.items() if drive and _alike(c, drive.drives.case)}
    decided, case = next(iter((same or shown).items()))  # never one as points
    robot = task.robots[decided[1]]
    beside = [c for name, c in shown.items() if name[1] == decided[1] and c is not case]
    demand = hardest([joint_demand(robot.result, i, c.cycle) for c in (case, *beside)])
    demand = replace(demand, speed=case.demand.speed)
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
        alone=_alone(task, memory, choice, i),
        mountings=_by_mounting(task, of_joint),
    )


def _alike(a: JointCase, b: JointCase) -> bool:
    """Whether the means of two cases are over the same cycles."""
    return a.cycle.schedule.repeats == b.cycle.schedule.repeats


def _alone(task: Task, memory: Memory, choice: Choice, i: int) -> dict[str, Assessment | None]:
    """The drives that cycle and rating would take by themselves, in the arm that is chosen."""
    if task.rating is None or not task.rating.cycles or task.catalog is None:
        return {}
    open_ = choice if task.scene.stops else replace(choice, efforts={}, note="", braking={})
    found = {
        "cycle": asked(task, memory, choice, i, "cycle"),
        "rating": asked(task, memory, open_, i, "rating"),
    }
    return {name: None if one is None else one.search.lightest() for name, one in found.items()}


def _by_mounting(
    task: Task, of_joint: Mapping[tuple[str, str], JointCase]
) -> dict[str, tuple[float, float]]:
    """RMS and peak effort of a joint in each of several mountings."""
    largest: dict[str, tuple[float, float]] = {}
    for (_, mounting), case in of_joint.items() if len(task.robots) > 1 else ():
        words = mounting or file_name(task.scene.source)
        before, worst = largest.get(words, (0.0, 0.0)), case.cycle.ends[0]
        figures = rms(case.cycle.stretched, worst), float(np.abs(worst).max())
        largest[words] = max(before[0], figures[0]), max(before[1], figures[1])
    return largest


def _no_candidates(task: Task, i: int) -> str:
    """Why there are no candidates; empty where none is asked for."""
    catalog = task.catalog
    if catalog is None or task.is_unloaded(i):
        return ""
    output = output_of(task.scene, i, task.conditions)
    if not output:
        return "motors and gears are for joints with one axis, not for forces"
    if output == task.conditions.medium:
        return f"{catalog.source} has no {output} cylinders"
    if not catalog.motors and not catalog.gearmotors:
        return f"{catalog.source} has no motors"
    if any(gear.output == output for gear in catalog.gears.values()):
        return (
            f"no motor of {catalog.source} goes with its gears: a frameless kit needs a "
            "strain wave gear, and a gear with `motors` one of these"
        )
    return f"{catalog.source} has no gear with a {output} output"
