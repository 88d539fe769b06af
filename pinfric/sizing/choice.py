"""The choice of drives for a robot along its cycles: one state, and questions of it.

Motor and gear of joint j are a point mass at its origin, on its parent link: they load the joints
nearer to the base, not their own. The rotor acts on its own motor as r^2 J a. Left out are the
drives' own moments of inertia, their offset from the axis, and gyroscopic torques of rotors and
their share in other joints' inertias (1/r of r^2 J).

The answer depends on a `Choice` alone. The questions of it are asked in the order of their cost,
from the first one again after each new answer, until none has one. It ends: where a joint leaves a
drive for the third time the lighter of this and the next is banned from it, links and simulated
stops answer at most twice, and all other answers follow from the drives taken. So each drive was
judged at the masses and the stops of all the drives that are chosen.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Any

import numpy as np

from pinfric.drives.demand import DriveCycle, drive_cycle
from pinfric.drives.drivetrain import Candidate
from pinfric.drives.held import held_drives
from pinfric.drives.robot import carried, equip, tip_to_base
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import PinfricWarning, StopError
from pinfric.model.brief import time_left
from pinfric.model.schema import Stops
from pinfric.motions.trajectory import Trajectory
from pinfric.sizing.drive_search import Assessment, momentary_peak
from pinfric.sizing.memory import Added, Asked, Memory
from pinfric.sizing.task import Task
from pinfric.sizing.together import together
from pinfric.stops.machines import Machines, full_load, stop_settings
from pinfric.stops.peaks import braking, cycle_peaks
from pinfric.stops.screen import ScreenedStops, screened_stops

#: How often a joint may leave a drive before one is banned; and rounds that no choice needs.
_FREE, _MOST_ROUNDS = 3, 200
#: How often simulated stops that overload a gear demand more of it, and by which factor more than
#: their peak.
_STOPPED_AGAIN, _STOP_RESERVE = 2, 1.02

#: Names of drives by their columns, that can be compared.
Products = frozenset[tuple[int, str]]


@dataclass(frozen=True)
class Choice:
    """Drives by their columns: that fit, provisional, or the nearest; and all that they hang on.

    Attributes:
        taken: the drive of each joint.
        bare: the links hold none of them, whatever the scene says. links: that they cannot hold
            `heavier`, in words.
        solved: masses of the inverse dynamics by which loads are computed.
        efforts: that gears must bear in stops, N m or N. note: their source, in words.
        borne: the products of these stops. seen: all of which stops were asked.
        least: of `efforts` what simulated stops showed. simulated: how often they did.
        braking: braking under power from each sample, without payload and with.
        most: kg, that a drive may weigh. heavier: the choice that the links cannot hold.
        banned: names that a joint may not take again.
        rounds, settled: of questions until none had a new answer; whether that was reached.
    """

    taken: Mapping[int, Assessment] = field(default_factory=dict)
    bare: bool = False
    links: str = ""
    solved: Added = frozenset()
    efforts: Mapping[int, float] = field(default_factory=dict)
    note: str = ""
    borne: Products | None = None
    seen: frozenset[Products] = frozenset()
    least: Mapping[int, float] = field(default_factory=dict)
    simulated: int = 0
    braking: Mapping[int, tuple[DriveCycle, ...]] = field(default_factory=dict)
    most: float = np.inf
    heavier: Choice | None = None
    banned: Mapping[int, frozenset[str]] = field(default_factory=dict)
    rounds: int = 0
    settled: bool = True

    @property
    def products(self) -> Products:
        """Names of the drives taken, by column."""
        return frozenset((i, assessment.name) for i, assessment in self.taken.items())

    @property
    def mass(self) -> float:
        """Of all drives, as far as it is known, kg."""
        return sum(a.mass or 0.0 for a in self.taken.values())

    def stops(self, i: int) -> dict[str, Any]:
        """Return what is known of a joint's stops, as fields of its case."""
        note, braked = self.note * (i in self.efforts), self.braking.get(i, ())
        effort = self.efforts.get(i, np.nan)
        return {"stop_effort": effort, "stop_note": note, "braking": braked}

    def ban(self, i: int, name: str) -> Choice:
        """Return the choice in which a joint may not take a drive again."""
        banned = self.banned.get(i, frozenset()) | {name}
        return replace(self, banned={**self.banned, i: banned})


#: A question: of a choice, its answer, which is the same choice if nothing is new.
Question = Callable[[Task, Memory, Choice], Choice]


def asked(task: Task, memory: Memory, choice: Choice, i: int, alone: str = "") -> Asked | None:
    """Return the drives of the catalogue at a joint; arguments as of `Memory.load`."""
    load = memory.load(task, i, task.added(choice.taken), choice.solved, alone)
    banned = choice.banned.get(i, frozenset())
    return memory.asked(task, i, load, choice.stops(i), banned, choice.most)


# ------------------------------------------------------------------------------ the questions


def drives(task: Task, memory: Memory, choice: Choice) -> Choice:
    """The drive of each joint, from the tips to the base, and what joints must have together."""
    conditions, own = task.conditions, dict[int, Asked]()
    whole = bool(conditions.same_drive) or conditions.lowest_frequency is not None
    taken = dict(choice.taken)
    for i, found in _inward(task, memory, choice, taken):
        own[i] = found
        if not whole or i not in taken:  # else of the set as a whole
            taken.pop(i, None)
            taken |= {} if found.best is None else {i: found.best}
    if whole:
        key = "set", tuple((i, id(found)) for i, found in own.items())
        if key not in memory.found:
            best = {i: found.best for i, found in own.items() if found.best is not None}
            searches = {i: found.search for i, found in own.items()}
            memory.found[key] = together(task, searches, best)
        taken = memory.found[key]
    same = taken.keys() == choice.taken.keys()
    if same and all(a is choice.taken[i] for i, a in taken.items()):
        return choice
    return replace(choice, taken=taken)


def _inward(
    task: Task, memory: Memory, choice: Choice, taken: dict[int, Assessment]
) -> Iterator[tuple[int, Asked]]:
    """Yield the joints that take a drive, from the tips to the base, below what is `taken` then."""
    count, began = len(task.scene.drives), monotonic()
    for k, i in enumerate(tip_to_base(task.scene), start=1):
        left = time_left(began, k - 1, count)
        task.progress(
            f"round {choice.rounds + 1}: {task.scene.drives[i].name}, drive {k} of {count}"
            + f"{left} in this round" * bool(left)  # how many rounds follow is not known
        )
        found = asked(task, memory, replace(choice, taken=taken), i)
        if found is not None:
            yield i, found


def hopeless(task: Task, memory: Memory, choice: Choice) -> bool:
    """Return whether a joint has no drive, signed or provisional, that is light enough for it.

    Of a choice of nothing, whose joints carry the least that they can: rounds and stops only add.
    """
    taken = dict[int, Assessment]()
    for i, found in _inward(task, memory, choice, taken):
        if found.fitting is None:
            return True
        taken[i] = found.fitting
    return False


def load(task: Task, memory: Memory, choice: Choice) -> Choice:
    """Inverse dynamics with the masses of the drives taken."""
    added = task.added(choice.taken)
    solved = frozenset((k, m) for k, m in added.items() if m and carried(task.scene, k))
    if task.robot.exact or solved == choice.solved:  # exact: solved with each joint's load
        return choice
    return replace(choice, solved=solved)


def peaks(task: Task, memory: Memory, choice: Choice) -> Choice:
    """What all gears must bear in stops, by algebra.

    Only the peaks of the last choice count, so that the result depends on no earlier one; where
    choices come back, the largest of all. Gears must bear `stop_factor` times the peaks, whether a
    simulation follows or not. A rating alone demands no stops unless the scene has `stops`.
    """
    taken, products, scene = choice.taken, choice.products, task.scene
    only_rated = task.rating is not None and not task.rating.cycles
    if products == choice.borne or (only_rated and scene.stops is None):
        return choice
    found = _stop_peaks(task, memory, choice)
    if found is None or np.isnan(found[0]).any():
        return choice
    most, powered = found
    factor = task.conditions.stop_factor
    efforts = {i: max(factor * float(most[i]), choice.least.get(i, 0.0)) for i in taken}
    if products in choice.seen:
        efforts |= {i: max(x, efforts[i]) for i, x in choice.efforts.items() if i in efforts}
    braked = {
        i: tuple(drive_cycle(x, i, np.zeros(len(x.effort_lower), dtype=bool)) for x in powered)
        for i in (taken if powered else ())
    }
    return replace(
        choice,
        efforts=efforts,
        note=f"{factor:g} x the peak in stops of all joints",
        borne=products,
        seen=choice.seen | {products},
        braking=braked,
    )


def links(task: Task, memory: Memory, choice: Choice) -> Choice:
    """Whether the links can hold their drives; else lighter drives, or drives that are added.

    Lighter ones weigh at most the least of links' mass per drive; they may be provisional.
    """
    if choice.bare:
        return choice
    why, heavier = contradiction(task, choice.taken), choice.heavier
    if heavier is not None:
        fit = choice.taken.keys() == heavier.taken.keys()
        if fit and not why and all(a.fits or a.would for a in choice.taken.values()):
            return choice
        return replace(_anew(choice), bare=True, most=np.inf)
    if not why:
        return choice
    each = held_drives(task.scene, dict.fromkeys(choice.taken, 1.0), task.conditions.mass_in_urdf)
    most = min(held.links / held.drives for held in each if held.drives)
    lighter = replace(_anew(choice), most=most, heavier=choice, links=why)
    if hopeless(task, memory, replace(Choice(), most=most)):
        return replace(lighter, bare=True, most=np.inf)
    return lighter


def _anew(choice: Choice) -> Choice:
    """The choice of which no stops are known but those that were simulated."""
    return replace(choice, efforts={}, borne=None, seen=frozenset())


def stops(task: Task, memory: Memory, choice: Choice) -> Choice:
    """What gears must bear in simulated stops that overload them: 1.02 times what is demanded."""
    found = simulated_stops(task, memory, choice)[0]
    if found is None or choice.simulated == _STOPPED_AGAIN:
        return choice
    factor = task.conditions.stop_factor
    short = _overloaded({i: factor * peak for i, peak in found.peaks.items()}, choice.taken)
    if not short:
        return choice
    least = {**choice.least, **{i: _STOP_RESERVE * peak for i, peak in short.items()}}
    efforts = {**choice.efforts, **least}
    return replace(choice, least=least, efforts=efforts, simulated=choice.simulated + 1)


#: In the order of their cost; of drives alone, and of links and simulated stops as well.
OF_DRIVES: Sequence[Question] = (drives, load, peaks)
QUESTIONS: Sequence[Question] = (*OF_DRIVES, links, stops)


def settle(
    task: Task, memory: Memory, choice: Choice, questions: Sequence[Question]
) -> tuple[Task, Choice]:
    """Return what is sized, its links bare if they must be, and the choice that leaves no question.

    Warns:
        PinfricWarning: it still alternates after 200 rounds.
    """
    left, sized = Counter[tuple[int, str]](), task
    if task.catalog is None:
        return task, choice
    for rounds in range(_MOST_ROUNDS):
        choice = replace(choice, rounds=rounds)
        after = next(
            (new for ask in questions if (new := ask(sized, memory, choice)) is not choice), None
        )
        if after is None:
            return sized, choice
        for i, name in choice.products - after.products:  # of a whole question, not of each try
            left[i, name] += 1
            if left[i, name] >= _FREE:
                two = (a for a in (choice.taken[i], after.taken.get(i)) if a is not None)
                after = after.ban(i, min(two, key=lambda a: a.mass or 0.0).name)
        choice = after
        if choice.bare:
            sized = task.with_masses("without_drives")
    warnings.warn(
        f"the choice of drives still alternates after {_MOST_ROUNDS} rounds",
        PinfricWarning,
        stacklevel=4,
    )
    return sized, replace(choice, settled=False)


# -------------------------------------------------------------------------------------- stops


def open_stops(task: Task, memory: Memory, choice: Choice) -> dict[int, float]:
    """Return what gears would bear in stops that the choice does not use, by column.

    Of a rating alone, `stop_factor` times the peak by algebra; NaN where no algebra tells it.
    """
    found = _stop_peaks(task, memory, choice)
    if found is None or choice.borne == choice.products:
        return {}
    return {i: task.conditions.stop_factor * float(found[0][i]) for i in choice.taken}


def _overloaded(peaks: Mapping[int, float], taken: Mapping[int, Assessment]) -> dict[int, float]:
    """The peaks (N m or N), by column, that are more than gears bear."""
    return {i: peak for i, peak in peaks.items() if i in taken and peak > momentary_peak(taken[i])}


def _stop_peaks(
    task: Task, memory: Memory, choice: Choice
) -> tuple[np.ndarray, tuple[InverseResult, ...]] | None:
    """`cycle_peaks` of a choice, the largest of all mountings, and `braking`.

    None: there are no stops, or a simulation will say what they lack. NaN: drives share a motion,
    or do not determine it. A brake's least inertia counts: a heavy rotor relieves its gear. Without
    `stops` in the scene all brakes close at once.
    """
    scene, given = task.scene, task.scene.stops
    if task.catalog is None:
        return None
    if given is None and not any(a.candidate.brake for a in choice.taken.values()):
        return None
    if scene.mobility.redundant:
        return np.full(len(scene.drives), np.nan), ()
    key = "peaks", choice.products, frozenset(task.added(choice.taken).items())
    if key not in memory.found:
        task.progress("peaks of all gears in stops, by algebra")
        try:
            memory.found[key] = _algebra(task, choice, given)
        except StopError:
            memory.found[key] = None
    found: tuple[np.ndarray, tuple[InverseResult, ...]] | None = memory.found[key]
    return found


def _algebra(
    task: Task, choice: Choice, given: Stops | None
) -> tuple[np.ndarray, tuple[InverseResult, ...]]:
    chosen = dict[int, Candidate]()
    for i, candidate in ((i, a.candidate) for i, a in choice.taken.items()):
        if (gear := candidate.transmission) is not None and gear.brake and candidate.brake_entry:
            brake = gear.brake.model_copy(update={} if given else {"engage_time": None})
            low, high = candidate.brake_entry.inertia_ends
            inertia = gear.rotor_inertia - (high - low)
            gear = gear.model_copy(update={"rotor_inertia": inertia, "brake": brake})
            candidate = replace(candidate, transmission=gear)
        chosen[i] = candidate
    scene = equip(task.scene, chosen, task.conditions)
    powers, most = list[InverseResult](), np.zeros(len(scene.drives))
    for _, robot in task.every_robot():
        turned, gravity = scene, robot.scene.model.gravity.linear
        if robot is not task.robot:
            turned = scene.with_(gravity=gravity, payloads=robot.scene.payloads)
        motion = task.one_cycle(turned, robot)
        settings = given or Stops(category=0, reaction_time=0.0)
        machines = Machines(turned, settings, full_load(turned, motion))
        powered = braking(machines, motion)
        most = np.maximum(most, cycle_peaks(machines, motion, powered))
        powers += powered
    return most, tuple(powers)


def simulated_stops(task: Task, memory: Memory, choice: Choice) -> tuple[ScreenedStops | None, str]:
    """Return the simulated stops of a choice, or None and why there are none, else empty."""
    scene, catalog = task.scene, task.catalog
    columns = range(len(scene.drives))
    fit = all(choice.taken[i].fits if i in choice.taken else task.is_unloaded(i) for i in columns)
    if scene.stops is None or catalog is None or not fit:
        return None, ""
    if not task.stops_once:
        what = "judged for one cycle, not for a duty of several or a rating alone"
        return None, f"stops: {what}"
    names = sorted({a.candidate.brake for a in choice.taken.values()} - {""})
    if slow := [n for n in names if catalog.brakes[n].engage_time is None]:
        return None, (
            f"stops: {', '.join(slow)} of the catalogue has no `engage_time`; give it the time "
            "(s) from power-off until it holds, as its maker states it"
        )
    key = "stops", choice.products, frozenset(task.added(choice.taken).items())
    if key not in memory.found:
        told = _stop_peaks(task, memory, choice)
        memory.found[key] = _simulated(task, choice, None if told is None else told[0])
    found: tuple[ScreenedStops | None, str] = memory.found[key]
    return found


def _simulated(
    task: Task, choice: Choice, peaks: np.ndarray | None
) -> tuple[ScreenedStops | None, str]:
    task.progress("stops of the chosen drives")
    chosen = {i: a.candidate for i, a in choice.taken.items()}
    scene = equip(task.scene, chosen, task.conditions)
    motion: Trajectory = task.one_cycle(scene, task.robot)
    products = {scene.drives[i].name: drive.name for i, drive in chosen.items()}
    load, settings = full_load(scene, motion), stop_settings(scene, None)
    reserve = task.conditions.stop_factor

    began = monotonic()

    def tell(done: int, total: int) -> None:
        count = f"{done} of about {total}{time_left(began, done, total)}"
        task.progress(f"stops of the chosen drives: {count}")

    try:
        machines = Machines(scene, settings, load, products, reserve)
        return screened_stops(machines, motion, peaks, tell), ""
    except StopError as problem:
        return None, str(problem)


# -------------------------------------------------------------------------------------- links


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


def said_of_links(choice: Choice) -> str:
    """Return what is said of links that cannot hold their drives; else empty."""
    heavier = choice.heavier
    if heavier is None:
        return ""
    if choice.bare:
        return (
            f"{choice.links}; {heavier.mass:.2f} kg of drives so, {choice.mass:.2f} kg where added"
        )
    why = choice.links.partition(" of drives: ")[0]
    return (
        f"{why} of drives that can be signed: lighter ones, of at most {choice.most:.2g} kg each, "
        "are provisional, or write `without_drives`"
    )
