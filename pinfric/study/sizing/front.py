"""What else could be chosen: sets of drives that trade mass for energy, peak power or price.

Of every joint's drives that fit, those stay that no other betters in all of these by itself; sets
are built joint by joint, keeping what none betters and, of many, some over the whole range of
masses. Each set that is left is then sized by itself, with its own masses in the model; those that
no longer fit are left out. Differences below 1 % count as none.

Peaks and energies of a bus are none of its drives' sums, and a copper loss that is not known is in
no comparison: a set that would be better still may be left out. Where sets are shown, that is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.model.described import described, quantity
from pinfric.study.sizing.assess import Assessment
from pinfric.study.sizing.catalog import Conditions
from pinfric.study.sizing.demand import DriveCycle, power_figures
from pinfric.study.sizing.drivetrain import motor_cycle

#: Sets kept while they are built, and sets sized in the end.
_BUILT, _SIZED = 64, 24
#: Figures are compared in steps of this part.
_STEP = 0.01

#: Every joint's drive -> how it does, and its samples, with all their masses in the model.
Judge = Callable[[Mapping[int, Assessment]], Sequence[tuple[Assessment, DriveCycle]]]


@described
class DriveSet:
    """A drive for every joint, all of which fit."""

    mass: float = quantity("of all drives", "kg", "mass")
    energy: float = quantity("drawn from the bus over a period", "J", "energy")
    peak_power: float = quantity("of the bus", "W", "peak of\nthe bus")
    price: float | None = quantity(
        "of motors and gears; none where one is not known", heading="price", cell="{price:.2f}"
    )
    drives: dict[str, str] = quantity(
        "joint -> name of its drive", heading="instead of the lightest"
    )
    copper: bool = quantity(
        "all copper losses are in energy and power; else they are those of some motors"
    )


@dataclass(frozen=True)
class _Part:
    """Drives of the first joints: who, kg, price, the sum of their power (T,), all copper in it."""

    taken: tuple[Assessment, ...]
    mass: float
    price: float | None
    power: np.ndarray
    copper: bool

    def with_drive(self, other: _Part) -> _Part:
        prices = self.price, other.price
        return _Part(
            self.taken + other.taken, self.mass + other.mass,
            None if prices[0] is None or prices[1] is None else prices[0] + prices[1],
            self.power + other.power, self.copper and other.copper,
        )  # fmt: skip


def trade_offs(
    names: Sequence[str],
    fitting: Sequence[Sequence[Assessment]],
    cycles: Sequence[DriveCycle],
    conditions: Conditions,
    judge: Judge,
) -> tuple[DriveSet, ...]:
    """Return the sets of drives that no other betters in mass, energy, peak power and price.

    Args:
        names: of the joints. fitting: each one's drives that fit; none of a joint: no sets.
        cycles: each one's samples. conditions: of the sizing.
        judge: sizes a whole set with its own masses.
    """
    if not fitting or not all(fitting):
        return ()
    t = cycles[0].stretched
    parts = [_Part((), 0.0, 0.0, np.zeros(len(t)), True)]
    for options, cycle in zip(fitting, cycles, strict=True):
        drives = _best([_part(a, cycle, conditions) for a in options], t)
        parts = _spread(_best([p.with_drive(d) for p in parts for d in drives], t), _BUILT)
    sized = []
    for part in _spread(parts, _SIZED):
        found = judge(dict(enumerate(part.taken)))
        if all(assessment.fits for assessment, _ in found):
            total = _Part((), 0.0, 0.0, np.zeros(len(t)), True)
            for assessment, cycle in found:
                total = total.with_drive(_part(assessment, cycle, conditions))
            sized.append(total)
    return tuple(_drive_set(names, part, t) for part in _best(sized, t))


def _drive_set(names: Sequence[str], part: _Part, t: np.ndarray) -> DriveSet:
    drives = {name: a.candidate.name for name, a in zip(names, part.taken, strict=True)}
    flow = power_figures(t, part.power)
    return DriveSet(part.mass, flow.delivered, flow.driving, part.price, drives, part.copper)


def _part(assessment: Assessment, cycle: DriveCycle, conditions: Conditions) -> _Part:
    candidate = assessment.candidate
    motor = motor_cycle(candidate, cycle, conditions)
    return _Part((assessment,), candidate.mass or 0.0, candidate.price, motor.power, motor.copper)


def _best(parts: Sequence[_Part], t: np.ndarray) -> list[_Part]:
    """Those that no other betters, the lightest first; of equals the first.

    Losses that are not known make a set better than it is: it betters none whose are.
    """
    parts = sorted(parts, key=lambda part: part.mass)
    priced = all(part.price is not None for part in parts)
    flows = [power_figures(t, part.power) for part in parts]
    figures = np.array([
        (part.mass, flow.delivered, flow.driving, part.price if priced else 1.0)
        for part, flow in zip(parts, flows, strict=True)
    ], dtype=float).reshape(-1, 4)  # fmt: skip
    steps = np.floor(np.log(np.maximum(figures, 1e-9)) / _STEP)
    copper = np.array([part.copper for part in parts])
    kept: list[int] = []
    for i in range(len(parts)):
        no_worse = (steps <= steps[i]).all(axis=1) & (copper | ~copper[i])
        better = (steps < steps[i]).any(axis=1) | (copper & ~copper[i])
        same = [k for k in kept if (steps[k] == steps[i]).all() and copper[k] == copper[i]]
        if not (no_worse & better).any() and not same:
            kept.append(i)
    return [parts[i] for i in kept]


def _spread(parts: Sequence[_Part], most: int) -> list[_Part]:
    """At most so many, over the whole range of masses."""
    if len(parts) <= most:
        return list(parts)
    return [parts[i] for i in np.unique(np.linspace(0, len(parts) - 1, most).round().astype(int))]
