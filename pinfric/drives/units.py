"""Units of a catalogue's figures, and those in which makers print them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache, lru_cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pinfric.errors import CatalogError, choose_from
from pinfric.model.entry import Entry

#: SI unit -> the other units of the same quantity, and what one of them is in it.
_PRINTED: dict[str, dict[str, float]] = {
    "N m": {
        **{"mN m": 1e-3, "N cm": 1e-2, "kN m": 1e3},
        **{"kgf cm": 0.0980665, "oz in": 0.00706155, "lb in": 0.1129848},
    },
    "N": {"kN": 1e3, "kgf": 9.80665, "lbf": 4.448222},
    "rad/s": {"rpm": math.pi / 30, "1/min": math.pi / 30, "deg/s": math.pi / 180},
    "m/s": {"mm/s": 1e-3},
    "kg m^2": {"kg cm^2": 1e-4, "g cm^2": 1e-7, "kg mm^2": 1e-6},
    "kg": {"g": 1e-3, "lb": 0.45359237},
    "V": {"mV": 1e-3},
    "A": {"mA": 1e-3},
    "ohm": {"mohm": 1e-3},
    "N m/A": {"mN m/A": 1e-3},
    **{alone: {} for alone in ("N/A", "K/W", "C", "W")},
    "J": {"kJ": 1e3},
    "s": {"ms": 1e-3, "min": 60.0},
    **{alone: {} for alone in ("h", "1/h")},
    "N m/rad": {"N m/arcmin": 10800 / math.pi},
    "N/m": {"N/mm": 1e3, "N/um": 1e6},
    "rad": {"deg": math.pi / 180, "arcmin": math.pi / 10800, "arcsec": math.pi / 648000},
    "m": {"mm": 1e-3},
    "1": {"%": 1e-2},
    "rad/m": {"mm/rev": 1e-3, "m/rev": 1.0},
    "Pa": {"MPa": 1e6, "N/mm^2": 1e6, "GPa": 1e9},
    "m^2": {"mm^2": 1e-6, "cm^2": 1e-4},
    **{alone: {} for alone in ("Pa m/s", "kg/m^3", "mm rpm", "N m s/rad", "N s/m")},
    "price": {},
}
#: Unit -> (SI unit, factor to it). A lead is turned into a ratio: 2 pi/lead.
UNITS = {
    unit: (si, factor)
    for si, others in _PRINTED.items()
    for unit, factor in {si: 1.0, **others}.items()
}

#: As the keys of entries say it -> as tables do.
_MEANT = {"Ohm": "ohm", "deg C": "C", "of the catalogue's currency": "price"}


@cache
def cells_of(entry: type[Entry]) -> dict[str, str]:
    """Return what a table of entries may have a column for, and its unit; "" of words.

    A key of a part has a point ("thermal.winding_time"). "A or B": A where the output turns.
    """
    found: dict[str, str] = {}
    for name, field in entry.model_fields.items():
        kinds = list(_kinds(field.annotation))
        for part in kinds:
            if isinstance(part, type) and issubclass(part, Entry):
                inner = cells_of(part).items()
                found |= {f"{name}.{key}": unit for key, unit in inner if "." not in key}
        if float in kinds or str in kinds:
            extra = field.json_schema_extra
            unit = str(extra["unit"]) if isinstance(extra, dict) and float in kinds else ""
            found[name] = _MEANT.get(unit, unit)
    return found


def _kinds(annotation: Any) -> Iterator[Any]:
    """The types that a value may have; of words that are listed `str`."""
    origin = get_origin(annotation)
    if origin is Literal:
        yield str
    elif origin is Annotated:
        yield from _kinds(get_args(annotation)[0])
    elif origin in (Union, UnionType):
        for member in get_args(annotation):
            yield from _kinds(member)
    else:
        yield annotation


def unit_of(entry: type[Entry], figure: str, linear: bool = False) -> str:
    """Return the SI unit of a figure of an entry, "" of words; `linear`: its output slides."""
    turning, _, sliding = cells_of(entry)[figure].partition(" or ")
    return sliding if linear and sliding else turning


@lru_cache
def _known(unit: str) -> str:
    """The unit of `UNITS` that is written so; "": there is none."""
    meant = "".join(unit.replace("·", "").replace("²", "^2").replace("Ω", "ohm").split())
    return next((known for known in UNITS if known.replace(" ", "") == meant), "")


def in_si(value: float, unit: str, wanted: str) -> float:
    """Return a figure in the SI unit it is wanted in.

    Raises:
        CatalogError: an unknown unit, or one of another quantity.
    """
    known = _known(unit)
    if not known:
        raise CatalogError(f"the unit {unit!r} is not known; {choose_from(unit, UNITS)}")
    si, factor = UNITS[known]
    if si != wanted:
        fitting = [u for u, (quantity, _) in UNITS.items() if quantity == wanted]
        raise CatalogError(
            f"{known} is not a unit of this value; take {', '.join(fitting) or wanted}"
        )
    if known.endswith("/rev"):
        return 2 * math.pi / (factor * value) if value else math.inf
    return factor * value
