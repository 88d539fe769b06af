"""What a choice of drives remembers: joints' loads, searches of drives at them, stops.

A load hangs on the masses beyond the joint; a search on its load and on what stops demand of it.
What was asked once is not computed again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pinfric.drives.limit import JointCase
from pinfric.drives.parts import output_of, own_parts
from pinfric.drives.rest import RestDemand
from pinfric.drives.robot import DrivenRobot, loads
from pinfric.motions.summary import rms
from pinfric.sizing.drive_search import Assessment, DriveSearch, Known, Parts
from pinfric.sizing.provisional import provisional
from pinfric.sizing.task import Task

#: Samples that are kept of a stretch in which nothing changes: a housing may be warmest inside it.
_KEPT = 8
#: Changes this small, of the largest magnitude, are rounding: within a stretch, of two loads.
_NO_CHANGE, _SAME = 1e-12, 1e-9

#: Ends the part of a case whose payloads are points: the last of all.
AS_POINTS = "as points"
#: Masses (kg) by drives' columns, that can be compared.
Added = frozenset[tuple[int, float]]
#: Part of a rating, and mounting.
CaseName = tuple[str, str]


@dataclass(frozen=True)
class Load:
    """A joint's cases, without stops, and what is known of drives there, case by case."""

    cases: Mapping[CaseName, JointCase]
    known: Mapping[CaseName, Known]


@dataclass(frozen=True)
class Asked:
    """The drives of the catalogue at a joint, in what they are held against."""

    search: DriveSearch

    @cached_property
    def fitting(self) -> Assessment | None:
        """The lightest that is signed, else one that is provisional."""
        return self.search.lightest() or provisional(self.search)

    @cached_property
    def best(self) -> Assessment | None:
        """The same, else the nearest."""
        return self.fitting or self.search.nearest()


class Memory:
    """See the module; it lives as long as one sizing, whatever its links are said to hold."""

    def __init__(self) -> None:
        self.found: dict[Any, Any] = {}
        self._loads: dict[Any, Load] = {}
        self._asked: dict[Any, Asked] = {}

    def load(
        self, task: Task, i: int, masses: Mapping[int, float], solved: Added, alone: str = ""
    ) -> Load:
        """Return what a joint bears; the same object where its figures are those of another.

        Args:
            i: the drive's column. masses: that other drives add, kg, by their columns.
            solved: the masses of the inverse dynamics to which changes are added.
            alone: "cycle" or "rating", as if the other one were not there; empty: both count.
        """
        beyond = frozenset((k, m) for k, m in masses.items() if m and loads(task.scene, k, i))
        key = i, alone, beyond, frozenset() if task.robot.exact else solved
        if key not in self._loads:
            for _, robot in () if task.robot.exact else task.every_robot():
                robot.solve(dict(solved))
            own = cases(task, i, masses, alone)
            found = {name: thinned(case) for name, case in own.items()}
            before = (load for (column, *_), load in self._loads.items() if column == i)
            alike = next((load for load in before if _alike(load.cases, found)), None)
            self._loads[key] = alike or Load(found, {name: Known() for name in found})
        return self._loads[key]

    def asked(
        self,
        task: Task,
        i: int,
        load: Load,
        stops: Mapping[str, Any],
        banned: frozenset[str],
        most: float,
    ) -> Asked | None:
        """Return the drives of the catalogue at a joint; None: it takes none.

        Args:
            i: the drive's column. stops: fields of `JointCase`. banned, most: as of `Parts`.
        """
        catalog = task.catalog
        output = output_of(task.scene, i, task.conditions)
        if catalog is None or not output or task.is_unloaded(i):
            return None
        effort = None if np.isnan(stops["stop_effort"]) else stops["stop_effort"]
        braking = tuple(map(id, stops["braking"]))
        key = i, id(load), effort, stops["stop_note"], braking, banned, most
        if key not in self._asked:
            name, arrays = task.scene.drives[i].name, task.arrays[output]
            own = own_parts(catalog, task.conditions, name, arrays.linear)
            parts = Parts(own, banned, most)
            if (taken := task.conditions.take.get(name)) is not None:
                arrays = arrays.only(taken)
            first, *others = (
                (case._replace(**stops), load.known[name]) for name, case in load.cases.items()
            )
            beside = [DriveSearch(arrays, case, parts, (), known) for case, known in others]
            self._asked[key] = Asked(DriveSearch(arrays, first[0], parts, beside, first[1]))
        return self._asked[key]


def cases(
    task: Task, i: int, masses: Mapping[int, float], alone: str = ""
) -> dict[CaseName, JointCase]:
    """Return a joint for each part of a rating and mounting, that of largest RMS effort first.

    A brake holds the largest load of all mountings, where their motions differ in every pose. Those
    with payloads as points are last: a body takes the stronger brake.

    Args: as of `Memory.load`.
    """
    of_joint = _cases(task.robots, i, masses, alone)
    apart = _cases(task.points, i, masses, alone)
    if len(task.robots) > 1:
        rests = [case.rest for case in of_joint.values() if case.rest is not None]
        held = [np.abs(demand.load) for demand in rests]
        alike = len({len(load) for load in held}) == 1
        most = np.max(held, axis=0) if alike else max(load.max() for load in held)
        peak = max(demand.peak for demand in rests)
        of_joint = {
            key: case._replace(
                rest=case.rest and case.rest._replace(load=_as_loads(case.rest, most), peak=peak)
            )
            for key, case in of_joint.items()
        }
    for key, case in apart.items():  # a small load of a large effort takes no brake
        rest, point = of_joint[key].rest, case.rest
        if rest is not None and point is not None:
            rest = rest._replace(peak=min(rest.peak, point.peak))
            of_joint[key] = of_joint[key]._replace(rest=rest)
    effort = {key: rms(c.cycle.stretched, c.cycle.ends[0]) for key, c in of_joint.items()}
    order = sorted(of_joint, key=lambda key: -effort[key])
    found = {key: of_joint[key] for key in order}
    return found | {(f"{key[0]} {AS_POINTS}", key[1]): apart[key] for key in order if key in apart}


def _cases(
    robots: Mapping[str, DrivenRobot], i: int, masses: Mapping[int, float], alone: str
) -> dict[CaseName, JointCase]:
    return {
        (part, mounting): robot.case(i, masses, schedule, alone)
        for mounting, robot in robots.items()
        for part, schedule in (
            {"": None} if robot.rating is None else robot.rating.means(i)
        ).items()
        if part.startswith(alone)
    }


def _as_loads(rest: RestDemand, most: np.ndarray | float) -> np.ndarray:
    """The largest load of all mountings, (T,), in the direction that it has in one."""
    return np.copysign(most, rest.load)


def thinned(case: JointCase) -> JointCase:
    """Return a case with few samples of stretches in which neither joint nor efforts change.

    Means, lags and thermal maps are exact over constants, so that all figures stay.
    """
    cycle, resting = case.cycle, case.rest
    count, starts = len(cycle.t), np.array(cycle.schedule.starts)
    series = [*_series(case), cycle.at_rest, cycle.holding, cycle.powered]
    same = np.ones(count - 1, dtype=bool)
    for values in (np.asarray(x, dtype=float) for x in series if len(x) == count):
        same &= np.abs(np.diff(values)) <= _NO_CHANGE * np.abs(values).max()
    inside = np.zeros(count, dtype=bool)
    inside[1:-1] = same[:-1] & same[1:]
    inside[starts[:-1]] = inside[starts[1:] - 1] = False
    ends = np.flatnonzero(np.diff(np.pad(inside.astype(int), 1)))
    for first, last in zip(ends[::2], ends[1::2], strict=True):
        inside[np.linspace(first, last - 1, min(_KEPT, last - first)).astype(int)] = False
    keep = ~inside
    if keep.all():
        return case
    kept = tuple(np.append(0, np.cumsum(keep))[starts].tolist())
    duty = None if cycle.duty is None else replace(cycle.duty, starts=kept)
    if resting is not None and len(resting.load) == count:
        resting = resting._replace(load=resting.load[keep])
    return case._replace(cycle=cycle.some(keep, duty), rest=resting)


def _series(case: JointCase) -> Iterator[np.ndarray]:
    """What a case has of each sample, the times left out."""
    c = case.cycle
    yield from (c.effort_lower, c.effort_upper, c.effort_frictionless, c.velocity, c.acceleration)
    if case.rest is not None:
        yield case.rest.load


def _alike(a: Mapping[CaseName, JointCase], b: Mapping[CaseName, JointCase]) -> bool:
    """Whether two loads have the same figures."""
    if list(a) != list(b):
        return False
    mine, other = (
        [x for case in load.values() for x in (*_series(case), *_numbers(case))] for load in (a, b)
    )
    return len(mine) == len(other) and all(
        p.shape == q.shape and bool((np.abs(p - q) <= _SAME * np.abs(p).max(initial=0.0)).all())
        for p, q in zip(mine, other, strict=True)
    )


def _numbers(case: JointCase) -> Iterator[np.ndarray]:
    """The figures of a case, each by itself; those that are not known left out."""
    demand = case.demand
    parts = (part for part in (demand, demand.bearing, demand.guide) if part is not None)
    single = (case.load_inertia, case.swung, *(x for part in parts for x in vars(part).values()))
    yield from (np.array([x]) for x in single if isinstance(x, float))
