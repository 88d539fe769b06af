"""Units of a catalogue's figures, and those in which makers print them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np

from pinfric.errors import CatalogError, choose_from
from pinfric.model.entry import Entry

#: SI unit of a figure -> others that makers print, for messages. What is read is far more: any
#: product of the symbols below, in any spelling.
_PRINTED: dict[str, tuple[str, ...]] = {
    "N m": ("mN m", "N cm", "kgf cm", "oz in", "lb in"),
    "N": ("kN", "kgf", "lbf"),
    "rad/s": ("rpm", "1/min", "deg/s"),
    "m/s": ("mm/s",),
    "kg m^2": ("kg cm^2", "g cm^2", "kg mm^2", "oz in s^2"),
    "kg": ("g", "lb", "oz"),
    "V": ("mV",),
    "A": ("mA",),
    "ohm": ("mohm",),
    "N m/A": ("mN m/A", "V/krpm"),
    "H": ("mH", "uH"),
    "W": ("kW",),
    "J": ("kJ",),
    "s": ("ms", "min"),
    "N m/rad": ("N m/arcmin",),
    "N/m": ("N/mm", "N/um"),
    "rad": ("deg", "arcmin", "arcsec"),
    "m": ("mm",),
    "1": ("%",),
    "rad/m": ("mm/rev", "m/rev"),
    "Pa": ("MPa", "bar", "N/mm^2"),
    "m^2": ("mm^2", "cm^2"),
}
#: Quantities: kg, m, s, A, K, rad, deg C.
_Dimensions = tuple[int, int, int, int, int, int, int]
_NONE: _Dimensions = (0,) * 7
_FORCE: _Dimensions = (1, 1, -2, 0, 0, 0, 0)
_TORQUE: _Dimensions = (1, 2, -2, 0, 0, 0, 0)
_TORQUE_CONSTANT: _Dimensions = (1, 2, -2, -1, 0, 0, 0)
_SPEED: _Dimensions = (0, 0, -1, 0, 0, 1, 0)
_PER_TRAVEL: _Dimensions = (0, -1, 0, 0, 0, 1, 0)
_STANDARD_GRAVITY, _POUND, _TURN = 9.80665, 0.45359237, 2 * math.pi
#: Symbols: (factor to SI, dimensions), and the prefixes they take.
_BASES: tuple[tuple[str, float, _Dimensions, str], ...] = (
    ("g gr", 1e-3, (1, 0, 0, 0, 0, 0, 0), "kKm"),
    ("lb lbs lbm", _POUND, (1, 0, 0, 0, 0, 0, 0), ""),
    ("oz", _POUND / 16, (1, 0, 0, 0, 0, 0, 0), ""),
    ("N", 1.0, _FORCE, "kmcM"),
    ("gf", 1e-3 * _STANDARD_GRAVITY, _FORCE, "kK"),
    ("lbf", _POUND * _STANDARD_GRAVITY, _FORCE, ""),
    ("ozf", _POUND * _STANDARD_GRAVITY / 16, _FORCE, ""),
    ("m", 1.0, (0, 1, 0, 0, 0, 0, 0), "mcu"),
    ("in inch", 0.0254, (0, 1, 0, 0, 0, 0, 0), ""),
    ("ft", 0.3048, (0, 1, 0, 0, 0, 0, 0), ""),
    ("s sec", 1.0, (0, 0, 1, 0, 0, 0, 0), "mu"),
    ("min", 60.0, (0, 0, 1, 0, 0, 0, 0), ""),
    ("h hr", 3600.0, (0, 0, 1, 0, 0, 0, 0), ""),
    ("rad", 1.0, (0, 0, 0, 0, 0, 1, 0), "m"),
    ("deg degree degrees", math.pi / 180, (0, 0, 0, 0, 0, 1, 0), ""),
    ("arcmin", math.pi / 10800, (0, 0, 0, 0, 0, 1, 0), ""),
    ("arcsec", math.pi / 648000, (0, 0, 0, 0, 0, 1, 0), ""),
    ("rev r U turn", _TURN, (0, 0, 0, 0, 0, 1, 0), ""),
    ("rpm", _TURN / 60, _SPEED, "k"),
    ("A Arms Adc amp amps ampere", 1.0, (0, 0, 0, 1, 0, 0, 0), "m"),
    ("V Vdc Vrms volt volts", 1.0, (1, 2, -3, -1, 0, 0, 0), "mk"),
    ("ohm ohms Ohm Ohms", 1.0, (1, 2, -3, -2, 0, 0, 0), "mk"),
    ("H", 1.0, (1, 2, -2, -2, 0, 0, 0), "mu"),
    ("W watt watts", 1.0, (1, 2, -3, 0, 0, 0, 0), "mk"),
    ("J", 1.0, _TORQUE, "mk"),
    ("K", 1.0, (0, 0, 0, 0, 1, 0, 0), ""),
    ("C degC", 1.0, (0, 0, 0, 0, 0, 0, 1), ""),
    ("Pa", 1.0, (1, -1, -2, 0, 0, 0, 0), "kMG"),
    ("bar", 1e5, (1, -1, -2, 0, 0, 0, 0), "m"),
    ("%", 1e-2, _NONE, ""),
)
_PREFIXES = {"": 1.0, "k": 1e3, "K": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "c": 1e-2, "u": 1e-6}
_SYMBOLS = {
    prefix + symbol: (_PREFIXES[prefix] * factor, dimensions)
    for symbols, factor, dimensions, prefixes in _BASES
    for symbol in symbols.split()
    for prefix in ("", *prefixes)
}
_LOWER = {symbol.lower(): symbol for symbol in reversed(_SYMBOLS)}
#: Spellings of the same sign.
_SIGNS = str.maketrans(
    {
        **dict.fromkeys("*\N{MIDDLE DOT}\N{DOT OPERATOR}\N{MULTIPLICATION SIGN}\N{BULLET}", " "),
        **dict.fromkeys("[](){}", " "),
        **dict.fromkeys("\N{EN DASH}\N{MINUS SIGN}\N{NON-BREAKING HYPHEN}", "-"),
        **{"\N{SUPERSCRIPT TWO}": "^2", "\N{SUPERSCRIPT THREE}": "^3"},
        **{"\N{SUPERSCRIPT MINUS}": "^-", "\N{SUPERSCRIPT ONE}": "1"},
        **{"\N{OHM SIGN}": "ohm", "\N{GREEK CAPITAL LETTER OMEGA}": "ohm"},
        **{"\N{MICRO SIGN}": "u", "\N{GREEK SMALL LETTER MU}": "u", "\N{DEGREE SIGN}": "deg"},
        **{"'": "arcmin", "\N{PRIME}": "arcmin", "\N{DOUBLE PRIME}": "arcsec"},
    }
)
_POWER_OF_TEN = re.compile(r"x?\s*(?:10\s*\^?|1[eE])\s*([-+]?\d+)\s*")
_FACTOR = re.compile(r"(?:([A-Za-z%]+)(?:\^?(-?\d))?|1)[\s.-]*")
#: How many of the unit behind "/": 60 of s/60deg.
_MANY = re.compile(r"(\d+)\s*(?=[A-Za-z])")

#: As the keys of entries say it -> as tables do.
_MEANT = {"Ohm": "ohm", "deg C": "C", "of the catalogue's currency": "price"}


@cache
def cells_of(entry: type[Entry]) -> dict[str, str]:
    """Return what a table of entries may have a column for, and its unit; "" of words.

    A key of a part has a point ("thermal.winding_time"). "A or B": A where the output turns.
    """
    cells: dict[str, str] = {}
    for name, field in entry.model_fields.items():
        kinds = list(_kinds(field.annotation))
        for kind in kinds:
            if isinstance(kind, type) and issubclass(kind, Entry):
                inner = cells_of(kind).items()
                cells |= {f"{name}.{key}": unit for key, unit in inner if "." not in key}
        if float in kinds or str in kinds:
            extra = field.json_schema_extra
            unit = str(extra["unit"]) if isinstance(extra, dict) and float in kinds else ""
            cells[name] = _MEANT.get(unit, unit)
    return cells


def _kinds(annotation: Any) -> Iterator[Any]:
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


@cache
def unit_of(entry: type[Entry], figure: str, linear: bool = False) -> str:
    """Return the SI unit of a figure of an entry, "" of words; `linear`: its output slides."""
    turning, _, sliding = cells_of(entry)[figure].partition(" or ")
    return sliding if linear and sliding else turning


@lru_cache
def _parsed(unit: str) -> tuple[float, _Dimensions] | None:
    """What one of a unit is in SI, and its dimensions; None where it cannot be read.

    A unit is a product of symbols with powers; what stands after "/" divides. Between symbols
    stands a blank, a point, a hyphen, or nothing ("N m", "N.m", "oz-in", "gcm2"). A number may
    follow "/" ("s/60deg").
    """
    text = unit.replace("''", "\N{DOUBLE PRIME}").translate(_SIGNS).strip()
    ten = _POWER_OF_TEN.match(text)
    text = re.sub(r"\barc[ .-]?(min|sec)", r"arc\1", text[ten.end() if ten else 0 :], flags=re.I)
    above, _, below = text.partition("/")
    scale = 10.0 ** int(ten[1]) if ten else 1.0
    dimensions = np.zeros(7, dtype=int)
    for part, sign in ((above, 1), (below.replace("/", " "), -1)):
        part, at = part.strip(), 0
        if sign < 0 and (many := _MANY.match(part)) is not None:
            scale, at = scale / float(many[1]), many.end()
        while at < len(part):
            if (match := _FACTOR.match(part, at)) is None:
                return None
            at = match.end()
            symbols = _split(match[1]) if match[1] else ()
            if symbols is None:
                return None
            for row, symbol in enumerate(symbols):
                power = sign * (int(match[2] or 1) if row == len(symbols) - 1 else 1)
                factor, of = _SYMBOLS[symbol]
                scale *= factor**power
                dimensions += power * np.array(of)
    return (scale, tuple(map(int, dimensions))) if above.strip() else None  # type: ignore[return-value]


def _split(word: str) -> tuple[str, ...] | None:
    """The symbols of a word, the longest first: as written, else in any case; None: no such."""
    if (symbols := _chain(word, _SYMBOLS)) is not None:
        return symbols
    if not (word.isupper() or word.istitle() or word.islower()):
        return None
    symbols = _chain(word.lower(), _LOWER)
    return None if symbols is None else tuple(_LOWER[symbol] for symbol in symbols)


def _chain(word: str, known: Mapping[str, object]) -> tuple[str, ...] | None:
    if not word:
        return ()
    for length in range(len(word), 0, -1):
        if word[:length] in known and (rest := _chain(word[length:], known)) is not None:
            return (word[:length], *rest)
    return None


def in_si(value: float, unit: str, wanted: str) -> float:
    """Return a figure in the SI unit it is wanted in.

    A mass where a force is wanted is its weight (kg cm of a torque, oz in s^2 of an inertia), 1/min
    of a speed are turns, V/rpm and V/min-1 of a torque constant are N m/A. A length (per turn) of a
    ratio is a screw's lead, which becomes 2 pi/lead; a time per angle of a speed (a servo's
    s/60deg) becomes one over it.

    Args:
        unit: in any spelling. wanted: the SI unit, as `unit_of` says it.

    Raises:
        CatalogError: an unknown unit, or one of another quantity.
    """
    if wanted == "price":
        if unit != "price":
            raise CatalogError(f"{unit} is not a unit of a price: give the number alone")
        return value
    factor, inverse = _conversion(unit, wanted)
    if inverse:
        return 1.0 / (factor * value) if value else math.inf
    return factor * value


@lru_cache
def _conversion(unit: str, wanted: str) -> tuple[float, bool]:
    """What one of a unit is in another; of a lead, a time per angle, one over it."""
    parsed = _parsed(unit)
    fitting = (wanted, *_PRINTED.get(wanted, ()))
    if parsed is None:
        raise CatalogError(f"the unit {unit!r} is not known; {choose_from(unit, fitting)}")
    target = _parsed(wanted)
    assert target is not None  # of `cells_of`: tested
    factor, dimensions = parsed[0] / target[0], parsed[1]
    apart = tuple(int(x) for x in np.subtract(target[1], dimensions))
    if not any(apart):
        turns_a_minute = target[1] == _TORQUE_CONSTANT and "min" in unit.lower()  # V/min-1
        return factor / (_TURN if turns_a_minute else 1.0), False
    if apart == (0, 1, -2, 0, 0, 0, 0):
        return _STANDARD_GRAVITY * factor, False
    turns = (0, 0, 0, 0, 0, 1, 0)
    if target[1] == _SPEED and apart == turns:
        return _TURN * factor, False
    if target[1] == _SPEED and dimensions == (0, 0, 1, 0, 0, -1, 0):
        return parsed[0], True
    if apart == turns and target[1] == _TORQUE_CONSTANT:
        return factor, False
    if target[1] == _PER_TRAVEL and dimensions in ((0, 1, 0, 0, 0, -1, 0), (0, 1, 0, 0, 0, 0, 0)):
        return parsed[0] / (1.0 if dimensions[5] else _TURN), True
    raise CatalogError(f"{unit} is not a unit of this value; take {', '.join(fitting)}")
