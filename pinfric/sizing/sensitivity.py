"""Which joint needs another drive first where friction, payload or speed are higher than given.

At each factor the loads are computed anew, and the drives that were chosen are judged by them, with
the smallest brakes that hold them: nothing is interpolated. Stops are those by algebra.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import replace
from typing import Any

from pinfric.drives.drivetrain import Candidate
from pinfric.drives.duty import Duty
from pinfric.model.described import described, quantity
from pinfric.model.scene import Scene
from pinfric.motions.rating import Rating
from pinfric.motions.trajectory import Trajectory
from pinfric.sizing.choice import OF_DRIVES, Choice, settle
from pinfric.sizing.drive_search import Assessment, CatalogArrays
from pinfric.sizing.memory import Memory
from pinfric.sizing.task import Task, task_of
from pinfric.stops.machines import with_loads

#: By which friction and losses, payloads and speeds are multiplied.
FACTORS = (1.05, 1.1, 1.25, 1.5, 2.0)


@described
class Sensitivity:
    """The least factor on a quantity at which the choice changes."""

    what: str = quantity("that is multiplied", heading="multiplied")
    factor: float | None = quantity(
        "the least of 1.05, 1.1, 1.25, 1.5 and 2; none: the choice bears 2", heading="by"
    )
    joints: tuple[str, ...] = quantity(
        "that need another drive or brake then", heading="needs another drive"
    )
    why: str = quantity("the criteria that fail there", heading="because of")


def sensitivities(
    task: Task,
    choice: Choice,
    scene: Scene,
    trajectory: Any,
    rating: tuple[Rating, Callable[..., Any]] | None,
) -> tuple[Sensitivity, ...]:
    """Return by which factors on friction, payloads and speed the choice changes.

    Args:
        task, choice: that are settled. scene, trajectory: as given to `size`.
        rating: as parsed, and what makes it a `Rated` of a scene; None: there is none.
    """
    signed = {i: a for i, a in choice.taken.items() if a.fits}
    if task.catalog is None or not signed:
        return ()
    names = scene.actuator_names
    conditions = task.conditions.model_copy(
        update={"take": {names[i]: a.name for i, a in choice.taken.items()}}
    )
    taken = {assessment.name for assessment in choice.taken.values()}
    few = {linear: arrays.only(*taken) for linear, arrays in task.arrays.items()}

    def at(what: str, factor: float) -> Task:
        friction, load = (factor if what == x else 1.0 for x in (_FRICTION, _PAYLOAD))
        speed = factor if what == _SPEED else 1.0
        heavier = with_loads(scene, friction, load)
        rated = None
        if rating is not None:
            rated = rating[1](heavier, _heavier(rating[0], load))
        arrays = {x: _lossier(own, friction) for x, own in few.items()}
        motion = _changed(trajectory, speed, lambda other: with_loads(other, friction, load))
        made = task_of(heavier, motion, task.catalog, conditions, lambda _: None, arrays, rated)
        return made.with_masses("without_drives") if choice.bare else made

    quantities = [_FRICTION]
    quantities += [_PAYLOAD] * bool(scene.payloads or rating is not None)
    quantities += [_SPEED] * isinstance(trajectory, Trajectory | Duty)
    found = []
    for what in quantities:
        said: dict[int, str] = {}
        factor = None
        for factor in FACTORS:
            task.progress(f"the drives at {factor:g} x the {what}")
            begin = Choice(bare=choice.bare, least=choice.least)
            after = settle(at(what, factor), Memory(), begin, OF_DRIVES)[1].taken
            said = dict(_changes(signed, after))
            if said:
                break
        joints = tuple(names[i] for i in sorted(said))
        reasons = ", ".join(dict.fromkeys(said.values()))
        found.append(Sensitivity(what, factor if said else None, joints, reasons))
    return tuple(found)


_FRICTION, _PAYLOAD, _SPEED = "friction and losses", "payload", "speed of the cycle"


def _changes(
    before: Mapping[int, Assessment], after: Mapping[int, Assessment]
) -> Iterator[tuple[int, str]]:
    """Yield the joints that keep neither drive nor brake, and why."""
    for i, drive in before.items():
        now = after.get(i)
        if now is None or not now.fits:
            failed = () if now is None else now.failed
            yield i, failed[0].name if failed else "no figure of it is known"
        elif now.candidate.brake != drive.candidate.brake:
            yield i, "holding brake"


def _lossier(arrays: CatalogArrays, factor: float) -> CatalogArrays:
    """The same drives with losses of their gears multiplied."""
    if factor == 1.0:
        return arrays

    def changed(make: Callable[..., Candidate]) -> Callable[..., Candidate]:
        def made(*numbers: int) -> Candidate:
            drive = make(*numbers)
            gear = drive.transmission
            return drive if gear is None else replace(drive, transmission=gear.with_losses(factor))

        return made

    lossier = copy(arrays)
    lossier.groups = [
        replace(group, make=changed(group.make), bare=changed(group.bare))
        for group in arrays.groups
    ]
    return lossier


def _heavier(rating: Rating, factor: float) -> Rating:
    return rating.model_copy(update={"payload": factor * rating.payload})


def _changed(motion: Any, speed: float, loaded: Callable[[Scene], Scene]) -> Any:
    """A motion at another speed; of a duty elsewhere in scenes with other loads, too."""
    if isinstance(motion, Trajectory):
        return motion if speed == 1.0 else motion.with_speed(speed)
    if not isinstance(motion, Duty):
        return motion
    faster = tuple((_changed(cycle, speed, loaded), share) for cycle, share in motion.cycles)
    elsewhere = tuple((loaded(s), _changed(d, speed, loaded)) for s, d in motion.elsewhere)
    beside = tuple(_changed(cycle, speed, loaded) for cycle in motion.beside)
    return Duty(faster, motion.on, motion.period, beside, elsewhere)
