"""What the stops of one axis come to: the worst, the table by speed and payload, criteria."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from pinfric.drives.criterion import Criterion, compare
from pinfric.model.brakes import HoldingBrake
from pinfric.model.described import EFFORT, PLACE, described, quantity
from pinfric.stops.machines import UNLIMITED, MachineKind, Machines
from pinfric.stops.search import StopCase, StopCycle, Stopped, StopSearch

#: A joint beyond its limit by less than this (rad or m) is still at it, to rounding.
_TOUCHES = 1e-6
#: A load this small beside the largest of the robot is rounding.
_ROUNDING = 1e-12


@described
class AxisStop:
    """The worst stops of one drive's joint; each figure is the worst of all stops."""

    name: str = quantity("the drive's", heading="drive", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    time: float = quantity("longest time from the command to rest", "s", "stopping\ntime")
    time_command: float = quantity("when in the cycle that stop is commanded", "s", "commanded\nat")
    travel: float = quantity("largest distance from where the command met it", PLACE, "travel")
    command: float = quantity("when in the cycle that stop is commanded", "s", "commanded\nat")
    load: str = quantity("payload in that stop", heading="carries")
    sag: float | None = quantity(
        "farthest way with gravity after power-off, of joints at rest then; none: it never rests",
        PLACE,
        "sag",
    )
    peak: float = quantity("largest effort of the gear at the joint", EFFORT, "gear's\npeak")
    braking: float | None = quantity(
        "largest effort until power goes off; none: category 0 has no power", EFFORT, "under\npower"
    )
    energy: float | None = quantity("most energy of the brake; none: no brake", "J", "brake")
    criteria: tuple[Criterion, ...] = quantity("of brake, gear, braking under power, and place")


@described
class StopGrid:
    """Stopping time and travel of one drive's joint at a payload, by speed in %."""

    name: str = quantity("the drive's", heading="drive", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    load: str = quantity("payload", heading="payload")
    time: Mapping[str, float] = quantity("time from the command to rest", "s", "time at\n{} %")
    travel: Mapping[str, float] = quantity("distance from the command", PLACE, "travel at\n{} %")


class Nearest(NamedTuple):
    """Where a stop takes a joint nearest to a limit, or farthest past one.

    Attributes:
        sample, speed: as of `StopCase`. command: s, in the cycle. load: share of the full payload.
        side: 0 of the lower limit, 1 of the upper.
        beyond: way past it, rad or m; negative: what is left.
    """

    sample: int
    speed: float
    command: float
    load: float
    side: int
    beyond: float


class Figures(NamedTuple):
    """What the criteria of one drive's joint compare.

    Attributes:
        peak: of the gear in stops, N m or N. reserve: factor on it that a gear must bear.
        braking: effort under power, N m or N. energy: that the brake must take, J.
        nearest: None: the joint has no limit.
        peaks_of, energy_of, place_of: formula and source of each, in words.
    """

    peak: float
    reserve: float
    braking: float
    energy: float
    nearest: Nearest | None
    peaks_of: tuple[str, str]
    energy_of: tuple[str, str]
    place_of: tuple[str, str]


def simulated(search: StopSearch, drive: int) -> Figures:
    """Return the figures of the worst stops that were simulated."""
    stops = list(search.found.values())
    energy, peak, braking = (
        max(float(getattr(s, x)[drive]) for s in stops) for x in ("energy", "peak", "braking")
    )
    nearest = None
    if search.limited[drive]:
        worst = search.nearest(drive)
        side = int(np.argmax(worst.beyond[drive]))
        case, beyond = worst.case, float(worst.beyond[drive, side])
        nearest = Nearest(case.sample, case.speed, worst.command, case.kind.load, side, beyond)
    return Figures(
        peak,
        search.machines.reserve,
        braking,
        energy,
        nearest,
        (
            "max |effort| in a stop",
            "simulated stops, friction and brake at their greatest, a rigid gear",
        ),
        ("max int T_b |omega| dt", "simulated stops, friction and brake at their least"),
        ("way in a stop towards the limit", "simulated stops; the URDF's limit"),
    )


def axis_stop(search: StopSearch, drive: int) -> AxisStop:
    """Return the worst of one drive's joint."""
    scene, stops = search.machines.scene, list(search.found.values())
    longest, worst = search.longest(drive), search.farthest(drive)
    sags = [stop.sag[drive] for stop in stops if np.isfinite(stop.sag[drive])]
    gear = scene.drives[drive].transmission
    powered = search.machines.settings.category == 1
    figures = simulated(search, drive)
    by_measure = axis_criteria(search.machines, search.cycle, drive, figures)
    return AxisStop(
        name=scene.drives[drive].name,
        unit=scene.drives[drive].unit,
        time=float(longest.rest[drive]),
        time_command=longest.command,
        travel=float(worst.travel[drive]),
        command=worst.command,
        load=load_name(worst.case.kind.load),
        sag=float(max(sags)) + 0.0 if sags else None,
        peak=figures.peak,
        braking=figures.braking if powered else None,
        energy=None if gear is None or gear.brake is None else figures.energy,
        criteria=tuple(c for own in by_measure.values() for c in own),
    )


def stop_grid(search: StopSearch, drive: int, shares: tuple[float, ...]) -> list[StopGrid]:
    """Return the rows of one drive's joint by payload, the worse of two samples.

    The samples are those of its longest stop and of its farthest.

    Args:
        search: with these stops. shares: of speed and payload.
    """
    scene = search.machines.scene
    worst = search.longest(drive), search.farthest(drive)
    samples = sorted({figures.case.sample for figures in worst})
    rows = []
    for load in (0.0, *shares) if search.machines.full else (0.0,):
        stops: dict[str, list[Stopped]] = {
            f"{100 * speed:.0f}": [
                search.stop(StopCase(MachineKind(False, load), sample, speed)) for sample in samples
            ]
            for speed in shares
        }
        rows.append(
            StopGrid(
                name=scene.drives[drive].name,
                unit=scene.drives[drive].unit,
                load=load_name(load),
                time={k: max(float(one.rest[drive]) for one in own) for k, own in stops.items()},
                travel={
                    k: max(float(one.travel[drive]) for one in own) for k, own in stops.items()
                },
            )
        )
    return rows


def load_name(load: float) -> str:
    """Return a share of the full payload in words."""
    return "nothing" if load == 0.0 else "full load" if load == 1.0 else f"{100 * load:.0f} %"


def not_met(name: str, criterion: Criterion) -> str:
    """Return the line of a criterion that a drive does not meet."""
    note = criterion.note
    return f"{name}: {criterion.why}" + (f"; {note}" if note not in criterion.why else "")


def axis_criteria(
    machines: Machines, cycle: StopCycle, drive: int, figures: Figures
) -> dict[str, tuple[Criterion, ...]]:
    """Return the criteria of one drive's joint, by what they compare (a field of `Stopped`)."""
    gear = machines.scene.drives[drive].transmission
    brake = None if gear is None else gear.brake
    return {
        "hold": tuple(_of_brake(machines, cycle, drive, brake)),
        "energy": tuple(_of_energy(brake, machines.settings.per_hour, figures)),
        "peak": tuple(_of_effort(machines, drive, figures)),
        "beyond": tuple(_of_place(machines, cycle, drive, figures)),
    }


def _of_brake(
    machines: Machines, cycle: StopCycle, drive: int, brake: HoldingBrake | None
) -> Iterator[Criterion]:
    if brake is None:
        return
    ratio = abs(machines.scene.drives[drive].ratio)
    holds = np.abs(np.concatenate(list(cycle.hold.values())))
    load = float(holds[:, drive].max()) / ratio
    load = load if load > _ROUNDING * holds.max() else 0.0
    yield compare(
        "brake torque",
        load,
        brake.torque,
        "N m",
        "max |load at rest|/|ratio| <= least torque of the brake",
        "statics: friction does not push, and need not help",
    )


def _of_energy(
    brake: HoldingBrake | None, per_hour: float | None, figures: Figures
) -> Iterator[Criterion]:
    if brake is None:
        return
    formula, source = figures.energy_of
    yield compare(
        "brake energy of a stop",
        figures.energy,
        brake.stop_energy,
        "J",
        f"{formula} <= permissible energy of one stop",
        source,
        "stop_energy of the brake",
    )
    missing = "stops.per_hour" if per_hour is None else "stops_per_hour of the brake"
    yield compare(
        "brake stops in an hour",
        per_hour,
        brake.stops_per_hour,
        "1/h",
        "stops in an hour <= permissible number",
        "maker's figure",
        missing,
    )


def _of_effort(machines: Machines, drive: int, figures: Figures) -> Iterator[Criterion]:
    """What the gear may bear for a moment, and what a stated deceleration may take, by the URDF."""
    scene, (formula, source) = machines.scene, figures.peaks_of
    gear, unit = scene.drives[drive].transmission, scene.drives[drive].unit
    yield compare(
        "gear momentary peak torque",
        figures.reserve * figures.peak,
        None if gear is None else gear.momentary_peak,
        unit,
        f"{figures.reserve:g} {formula} <= limit for momentary peak torque",
        source,
        "momentary_peak of the transmission",
    )
    if machines.deceleration is not None:
        limit = float(scene.model.effortLimit[scene.drives[drive].velocity_index])
        yield compare(
            "effort of braking",
            figures.braking,
            limit if 0.0 < limit < UNLIMITED else None,
            unit,
            "max |effort| at the deceleration, until power goes off <= effort limit",
            "inverse dynamics; the URDF's limit",
            "effort limit of the URDF",
        )


def _of_place(
    machines: Machines, cycle: StopCycle, drive: int, figures: Figures
) -> Iterator[Criterion]:
    worst, (formula, source) = figures.nearest, figures.place_of
    if worst is None:
        return
    side, beyond, limit = worst.side, worst.beyond, float(cycle.limits[drive, worst.side])
    way = cycle.before(worst.sample, worst.speed)[1][drive]
    place = float(cycle.trajectory.q[worst.sample, cycle.place[drive]] - way)
    room = (limit - place) * (1 if side else -1)
    unit = machines.scene.drives[drive].place_unit
    passes = f" by {beyond:.3g} {unit}" if beyond > _TOUCHES else ""
    note = (
        f"{'passes' if passes else 'nearest to'} its {'upper' if side else 'lower'} limit of "
        f"{limit:.4g} {unit}{passes}, commanded at {worst.command:.3g} s (sample {worst.sample}), "
        f"carrying {load_name(worst.load)}"
    )
    need = max(room + beyond, 0.0) if passes else min(max(room + beyond, 0.0), room)
    yield compare(
        "position limit",
        need,
        room,
        unit,
        f"{formula} <= distance to it at the command",
        source,
        note=note,
    )
