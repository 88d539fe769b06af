"""Cycle time against the mass of the drives.

From the drives that `size` chose, those that hold the motion back are exchanged for the next
heavier ones that fit the cycle, the one that saves most time per kg first, until none saves any. A
search by steps: sets that exchange several drives at once for less are not tried.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace

from pinfric.errors import PinfricWarning, RetimeError
from pinfric.model.described import described, quantity
from pinfric.study.retime.limits import candidate_limits
from pinfric.study.retime.path import Path
from pinfric.study.retime.retime import RetimeResult, retime
from pinfric.study.sizing.robot import added_masses, geared, with_masses
from pinfric.study.sizing.shelf import Assessment
from pinfric.study.sizing.size import SizingReport

#: Drives that are exchanged in a step, and how many heavier ones are tried for each.
_DRIVES, _HEAVIER = 2, 3
#: Steps, and the part of the duration that a step saves at least.
_STEPS, _LEAST = 12, 1e-3
_POINTS = 150


@described
class TimedSet:
    """A drive for every joint, and the cycle time with them."""

    mass: float = quantity("mass of all drives", "kg", "drives")
    duration: float = quantity(
        "cycle time with holds, within the continuous torques", "s", "cycle", "{duration:.3f}"
    )
    drives: dict[str, str] = quantity(
        "joint -> name of its drive", heading="other than in the first"
    )
    held_by: str = quantity(
        "the drive and the limit that hold it back for most of the time",
        heading="held back by",
    )
    best: bool = quantity(
        "at least 0.1 % faster than every lighter set that was tried", default=True
    )


def fastest_sets(report: SizingReport, path: Path) -> tuple[TimedSet, ...]:
    """Return the sets of drives that were tried, from the lightest on.

    Args:
        report: of `size` with a catalogue, a drive taken for each joint.
        path: where to; all sets move along it.

    Raises:
        RetimeError: a joint has no drive, or the drives chosen cannot follow the path.
    """
    taken = {
        i: joint.installed for i, joint in enumerate(report.joints) if joint.installed is not None
    }
    if len(taken) < len(report.joints) or report.catalog is None:
        raise RetimeError(
            f"{report.given.source}: fastest: needs a drive for every joint; give "
            "`size` a catalogue with suitable drives"
        )
    now = _tried(report, path, taken)
    found, result = [now[0]], now[1]
    for _ in range(_STEPS):
        names = report.given.actuator_names
        held = dict.fromkeys(
            drive
            for drive, kind, _ in result.held_back()
            if kind not in ("joint speed", "acceleration")
        )
        options = []
        for drive in list(held)[:_DRIVES]:
            i = names.index(drive)
            for other in _heavier(report, i, taken[i]):
                try:
                    options.append((*_tried(report, path, taken | {i: other}), i, other))
                except RetimeError:  # figures missing, or too heavy for the joints below
                    continue
        found += [option[0] for option in options]
        last = result.duration
        better = [o for o in options if o[0].duration < last * (1.0 - _LEAST)]
        if not better:
            break
        mass = sum(a.candidate.mass or 0.0 for a in taken.values())
        best = max(better, key=lambda o: (last - o[0].duration) / max(o[0].mass - mass, 1e-3))
        result, taken = best[1], taken | {best[2]: best[3]}
    found.sort(key=lambda x: (x.mass, x.duration))
    return tuple(
        replace(x, best=all(x.duration < y.duration * (1.0 - _LEAST) for y in found[:k]))
        for k, x in enumerate(found)
    )


def _heavier(report: SizingReport, i: int, taken: Assessment) -> list[Assessment]:
    """The next drives that fit the cycle and weigh as much or more, and can give more."""
    mass = taken.candidate.mass or 0.0
    ranked = [
        a
        for a in report.joints[i].alternatives
        if a.candidate.name != taken.candidate.name and (a.candidate.mass or 0.0) >= mass
    ]
    return ranked[:_HEAVIER]


def _tried(
    report: SizingReport, path: Path, taken: Mapping[int, Assessment]
) -> tuple[TimedSet, RetimeResult]:
    """One set of drives, their masses in the model."""
    given, conditions = report.given, report.conditions
    masses = {i: a.candidate.mass for i, a in taken.items()}
    names = given.actuator_names
    gears = {names[i]: a.candidate.transmission for i, a in taken.items()}
    heavier = with_masses(given, added_masses(given, conditions, masses))
    scene = replace(heavier, actuators=geared(given, gears))
    limits = {names[i]: candidate_limits(a.candidate, report.conditions) for i, a in taken.items()}
    with warnings.catch_warnings():  # what was chosen and tried is judged by `size` already
        warnings.simplefilter("ignore", PinfricWarning)
        result = retime(scene, path, limits, points=_POINTS)
    most = result.held_back()
    held_by = f"{most[0][0]}: {most[0][1]}" if most else ""
    mass = sum(a.candidate.mass or 0.0 for a in taken.values())
    drives = {names[i]: a.candidate.name for i, a in sorted(taken.items())}
    return TimedSet(mass, result.duration, drives, held_by), result
