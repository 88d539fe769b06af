"""Units that files hold by mistake."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Unit:
    """A unit that files hold by mistake, and its size in SI units."""

    name: str
    size: float


LENGTHS = (Unit("mm", 1e-3), Unit("cm", 1e-2), Unit("inches", 0.0254))
MASSES = (Unit("g", 1e-3), Unit("t", 1e3))
INERTIAS = (
    Unit("kg mm^2", 1e-6),
    Unit("g mm^2", 1e-9),
    Unit("kg cm^2", 1e-4),
    Unit("g cm^2", 1e-7),
)
#: Of motors, in the order in which data sheets have them.
ROTOR_INERTIAS = (Unit("kg cm^2", 1e-4), Unit("g cm^2", 1e-7))
ANGLES = (Unit("degrees", 0.017453292519943295),)


def in_unit(unit: Unit | None, si: str, value: float) -> str:
    """Return the value of a number (as written) if it is in a wrong unit; "" for no unit."""
    return f"if it is in {unit.name}: {unit.size * value:.3g} {si}" if unit else ""


def likely_unit(units: Iterable[Unit], plausible: Callable[[float], bool]) -> Unit | None:
    """Return the first unit (likeliest first) whose size makes a value plausible, or None."""
    return next((unit for unit in units if plausible(unit.size)), None)
