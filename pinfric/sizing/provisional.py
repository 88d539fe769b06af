"""Provisional drives: what would fit a joint for which nothing can be signed, and what to ask for.

Such a drive lacks up to three figures, none of them a torque rating; all known rows pass. The need
of the row that lacks a figure is what the figure must be.

- Efficiency: the worst known of the kind stands in.
- Inertia: the least that its inertia ratio permits; then the largest with which the motor passes.
- Continuous torque of a hobby servo: `kinds.servo`. Where nothing else fits it may run hot.

A provisional drive is taken only where none can be signed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from pinfric.drives.catalog import Gear
from pinfric.drives.drivetrain import Candidate, gearmotor_drive, motor_with_gear
from pinfric.drives.kinds.servo import HEAT, asked_heat, is_servo
from pinfric.drives.limit import Candidates
from pinfric.drives.policy import BEARING, EXTRA_INERTIAS, OWN_BEARING, PROVISIONAL
from pinfric.model.brief import rounded_down, rounded_up

if TYPE_CHECKING:  # it is above this module
    from pinfric.sizing.drive_search import Assessment, DriveSearch

#: Drives that are judged in full, the lightest of fewest missing figures first.
_TRIED = 200
#: Doublings, then halvings, that find the largest inertia.
_DOUBLINGS, _HALVINGS = 20, 12


def provisional(search: DriveSearch) -> Assessment | None:
    """Return the drive of fewest missing figures, then the lightest, that passes all known rows."""
    tried = sorted(_offers(search))[:_TRIED]
    for hot in (False, True):
        for _, _, b, g, m in tried:
            judged = _judged(search, b, g, m, hot)
            if judged is not None:
                return judged
    return None


def _offers(search: DriveSearch) -> Iterator[tuple[int, float, int, int, int]]:
    """Yield missing figures, mass, group, gear and motor of what no bound rules out."""
    for b, group in enumerate(search.arrays.groups):
        able = _able(search, b)
        bounded: dict[bool, list[int]] = {False: [], True: []}
        for g in able:
            lacks = {*search.gear_lacks(group, g)}
            more = bool(lacks & EXTRA_INERTIAS)
            if not is_servo(group.entries[g]) and not (more and "efficiency" in lacks):
                bounded[more].append(g)  # of others no bound is known: a servo may run hot
        for more, some in bounded.items():
            for gears in search.some_at_a_time(b, np.array(some, dtype=int)):
                least = search.any_inertia(b, gears) if more else search.margins(b, gears)[0]
                for g, margins in zip(gears.tolist(), least, strict=True):
                    able[g] &= ~(margins < 0)
        for g, motors_able in able.items():
            own, mass = search.gear_lacks(group, g), group.mass[g]
            for theirs, motors in group.by_lacks.items():
                lacks = {*own, *theirs}
                if not group.at_output and "rotor inertia" in lacks:
                    continue  # of a motor nothing stands in for it
                if lacks <= PROVISIONAL and 0 < len(lacks) <= 3:
                    some = motors[motors_able[motors]]
                    few = some[np.argsort(mass[some], kind="stable")][:_TRIED]
                    yield from ((len(lacks), float(mass[m]), b, g, m) for m in few.tolist())


def _able(search: DriveSearch, b: int) -> dict[int, np.ndarray]:
    """Gears that lack no more than a provisional drive may, and (nm,) motors that go with each."""
    group, found = search.arrays.groups[b], dict[int, np.ndarray]()
    for g in range(len(group.names)):
        own = search.gear_lacks(group, g)
        if set(own) <= PROVISIONAL and not search.gear_margins[b][g] < 0:
            mass = group.mass[g]
            found[g] = group.fits[g] & np.isfinite(mass) & (mass <= search.parts.most)
            if not own:
                found[g] &= ~group.signable
    return {g: able for g, able in found.items() if able.any()}


def _judged(search: DriveSearch, b: int, g: int, m: int, hot: bool) -> Assessment | None:
    """Return a drive with stand-ins for missing figures; None: it does not fit.

    `hot`: of a hobby servo only; the rows of its heat may fail.
    """
    group = search.arrays.groups[b]
    servo = is_servo(group.entries[g])
    if hot and not servo:
        return None
    lacks = (*search.gear_lacks(group, g), *group.motor_lacks[m], *["continuous torque"] * servo)
    load, ratio = search.case.load_inertia or 0.0, float(group.drives.ratio[g, 0])
    least = load / (ratio**2 * search.case.conditions.inertia_ratio)
    inertial, said = bool({*lacks} & EXTRA_INERTIAS), []
    name, entry = group.names[g], group.entries[g]
    if isinstance(entry, Gear):
        motor = group.motors[m]
        assert motor.rotor_inertia is not None
        least = max(least - motor.rotor_inertia, 0.0)
        if entry.efficiency is None:
            worst = search.arrays.worst_efficiency(entry.kind)
            if worst is None:
                return None
            entry = entry.model_copy(update={"efficiency": worst})
            said.append(f"efficiency >= {worst:.2g}, the worst known of its kind")

    def made(inertia: float) -> Candidate:
        if isinstance(entry, Gear):
            own = {"input_inertia": inertia} if inertial else {}
            drive = motor_with_gear(
                group.motor_names[m],
                group.motors[m],
                name,
                entry.model_copy(update=own),
                ratio,
                search.case.conditions.ambient,
            )
        else:
            drive = gearmotor_drive(
                name, entry.model_copy(update={"rotor_inertia": inertia} if inertial else {})
            )
        return replace(drive, **search.parts.own)

    def assess(inertia: float) -> Assessment:
        return search.assess_each(made(inertia), lacks)

    def passes(assessment: Assessment) -> bool:
        return not assessment.falls_short(HEAT if hot else ())

    assessment = assess(least * (1 + 1e-9))
    heavy = (assessment.mass or 0.0) > search.parts.most
    if assessment.name in search.parts.banned or heavy or not passes(assessment):
        return None
    if inertial:
        low, high = least, max(least, 1e-9)
        for _ in range(_DOUBLINGS):
            if not passes(assess(2.0 * high)):
                break
            low, high = 2.0 * high, 2.0 * high
        high = 2.0 * high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if passes(assess(middle)) else (low, middle)
        range_ = (
            f"{rounded_up(least)} to {rounded_down(low)}" if least else f"<= {rounded_down(low)}"
        )
        said.append(f"{next(iter({*lacks} & EXTRA_INERTIAS))} {range_} kg m^2")
    said += _turned(assessment.drives, {*lacks})
    said += [asked_heat(assessment.criteria)] if servo else []
    return replace(assessment, would=tuple(said))


def _turned(d: Candidates, lacks: set[str]) -> list[str]:
    """Say what figures without a stand-in must be."""
    said, (_, rate) = list[str](), d.candidate.units
    if "stiffness" in lacks and d.case.load_inertia:
        c = d.conditions
        hertz = c.resonance_hand if d.case.hand else c.resonance_base
        said.append(f"stiffness >= {rounded_up((2 * pi * hertz) ** 2 * d.load)} N m/rad")
    if BEARING in lacks and d.demand.bearing is not None:
        load, belt = d.demand.bearing, d.candidate.gear is not None and d.entry.kind == "belt"
        said.append(
            f"tilting moment >= {rounded_up(load.moment)} N m, "
            f"radial force >= {rounded_up(load.radial)} N, "
            f"axial force >= {rounded_up(load.axial)} N{' of' if belt else ', or'} "
            f"a bearing of the joint's own ({OWN_BEARING})"
        )
    speed = d.demand.speed * (1.0 if d.at_output else d.ratio)
    for figure in ("maximum input speed", "largest speed"):
        if figure in lacks:
            said.append(f"{figure} >= {rounded_up(speed)} {rate}")
    if "stroke" in lacks:
        said.append(f"stroke >= {rounded_up(d.demand.travel or 0.0)} m")
    return said
