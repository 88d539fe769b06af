"""Figures of catalogues whose unit looks wrong."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pinfric.drives.catalog import Catalog, GearMotor, Motor
from pinfric.drives.sourced import Sourced
from pinfric.drives.thermal import Thermal
from pinfric.drives.units import unit_of
from pinfric.model.springs import softest

#: Figure -> (least usual, greatest usual, the unit one would have slipped into).
_USUAL = {
    "continuous_torque": (1e-4, 2e3, "mN m"),
    "peak_torque": (1e-4, 1e4, "mN m"),
    "torque_constant": (1e-4, 20.0, "mN m/A"),
    "resistance": (1e-3, 500.0, "mohm"),
    "mass": (1e-3, 200.0, "g"),
    "max_speed": (0.1, 7e3, "rpm"),
    "no_load_speed": (0.1, 7e3, "rpm"),
    "rated_speed": (0.1, 7e3, "rpm"),
    "max_input_speed": (1.0, 2e3, "rpm"),
    "average_input_speed": (1.0, 1.5e3, "rpm"),
    "rated_torque": (1e-3, 2e4, "mN m"),
    "rotor_inertia": (1e-10, 0.08, "kg cm^2 or g cm^2"),
    "input_inertia": (1e-10, 0.05, "kg cm^2"),
    "stiffness": (10.0, 1e8, "N m/arcmin"),
    "nominal_life": (100.0, 1e6, "s"),
    "starting_torque": (1e-5, 20.0, "N cm"),
    "no_load_running_torque": (1e-5, 50.0, "N cm"),
    "ratio": (1.0, 2e3, "output turns per motor turn"),
}
#: The same for the input of a gear, which turns slower than the fastest motors.
_USUAL_OF_GEARS = {
    "rated_speed": (1.0, 1e3, "rpm"),
    "no_load_speed": (1.0, 1e3, "rpm"),
}
#: Radius of gyration sqrt(J/m) of a rotor over the whole mass, m, and rotor inertia per continuous
#: torque, s^2: far beyond real motors on both sides (4e-3 m and 4e-5 s^2 are usual).
_GYRATION = (2e-4, 0.15)
_INERTIA_PER_TORQUE = (1e-7, 2e-2)
#: Continuous torque per mass, N m/kg: bare motors reach 5 to 10, geared ones 100.
_TORQUE_PER_MASS = {"motors": (5e-3, 40.0), "gearmotors": (5e-2, 500.0)}
#: Continuous torque x greatest speed per mass, W/kg: servo motors reach 1000; rpm is 9.5 times it.
_POWER_PER_MASS = 3e3
#: Maximum speed over that at the nominal voltage: slow windings reach 8; rpm is 9.5 times it.
_SPEED_OVER_NOMINAL = 9.0
#: k omega_0/U and T_stall R/(k U), both about 1.
_BACK_EMF, _STALL = (0.5, 2.0), (0.3, 3.0)
#: s: windings of gram motors take longer to warm.
_LEAST_WINDING_TIME = 1.0


def doubts(catalog: Catalog) -> Iterator[tuple[str, str]]:
    """Yield (where, what) of each figure whose unit looks wrong."""
    for section in ("motors", "gears", "gearmotors"):
        for name, entry in getattr(catalog, section).items():
            where = f"{section}.{name}"
            linear = entry.output == "linear" if section == "gearmotors" else False
            beyond = () if linear else _beyond_proportion(section, entry)
            for text in (*_beyond_usual(section, entry), *beyond):
                yield where, text
            if section != "gears":
                yield from ((where, text) for text in _speeds_beyond_proportion(section, entry))
            if section == "motors":
                yield from ((where, text) for text in _line_beyond_proportion(entry))
            if (thermal := getattr(entry, "thermal", None)) is not None:
                yield from ((f"{where}.thermal", text) for text in _unusual_heat(thermal))


def _beyond_usual(section: str, entry: Sourced) -> Iterator[str]:
    figures, usual = vars(entry), _USUAL | (_USUAL_OF_GEARS if section == "gears" else {})
    for rating, (least, greatest, slip) in usual.items():
        value = figures.get(rating)
        if rating == "stiffness" and value is not None:
            value = softest(value)
        if value is None or figures.get("output") == "linear":
            continue
        for x in value if isinstance(value, tuple) else (value,):
            if not (least <= x <= greatest or (x == 0 and rating == "input_inertia")):
                turns = "motor turns per output turn" if rating == "ratio" else ""
                unit = turns or unit_of(type(entry), rating)
                yield (
                    f"{rating} = {x:g} {unit} is outside the usual range, {least:g} to "
                    f"{greatest:g} {unit}; {slip} entered?"
                )


def _beyond_proportion(section: str, entry: Any) -> Iterator[str]:
    inertia = getattr(entry, "rotor_inertia", None) or getattr(entry, "input_inertia", None)
    mass, torque = entry.mass, getattr(entry, "continuous_torque", None)
    if inertia and mass and not _GYRATION[0] <= (inertia / mass) ** 0.5 <= _GYRATION[1]:
        yield (
            f"inertia {inertia:g} kg m^2 at {mass:g} kg is a radius of gyration of "
            f"{(inertia / mass) ** 0.5:.3g} m, which no rotor has; kg cm^2 (1e-4) or g cm^2 (1e-7) "
            "entered?"
        )
    elif inertia and torque and section == "motors":
        low, high = _INERTIA_PER_TORQUE
        if not low <= inertia / torque <= high:
            yield (
                f"rotor inertia {inertia:g} kg m^2 does not match {torque:g} N m; kg cm^2 "
                "(1e-4) or g cm^2 (1e-7), or mN m entered?"
            )
    if torque and mass and section in _TORQUE_PER_MASS:
        low, high = _TORQUE_PER_MASS[section]
        if not low <= torque / mass <= high:
            yield (
                f"continuous torque {torque:g} N m at {mass:g} kg is {torque / mass:.3g} "
                "N m/kg; mN m or g entered?"
            )


def _speeds_beyond_proportion(section: str, entry: Motor | GearMotor) -> Iterator[str]:
    nominal = entry.no_load_speed or entry.rated_speed
    if entry.max_speed and nominal and entry.max_speed > _SPEED_OVER_NOMINAL * nominal:
        yield (
            f"max_speed = {entry.max_speed:g} rad/s is {entry.max_speed / nominal:.3g} times "
            f"the speed at the nominal voltage, {nominal:g} rad/s; up to "
            f"{_SPEED_OVER_NOMINAL:g} times expected; rpm entered?"
        )
        return
    torque, mass = entry.continuous_torque, entry.mass
    if not (torque and mass) or torque / mass > _TORQUE_PER_MASS[section][1]:
        return  # the torque or the mass is in question, not the speed
    for rating in ("max_speed", "no_load_speed", "rated_speed"):
        speed = getattr(entry, rating)
        if speed and torque * speed / mass > _POWER_PER_MASS:
            yield (
                f"{rating} = {speed:g} rad/s at continuous_torque {torque:g} N m and {mass:g} kg "
                f"is {torque * speed / mass:.3g} W/kg; up to {_POWER_PER_MASS:g} W/kg expected; "
                "rpm entered?"
            )


def _line_beyond_proportion(motor: Motor) -> Iterator[str]:
    k, voltage = motor.torque_constant, motor.nominal_voltage
    if k is None or voltage is None:
        return
    if motor.no_load_speed is not None:
        expected = voltage / motor.no_load_speed
        if not _BACK_EMF[0] <= k / expected <= _BACK_EMF[1]:
            yield (
                f"torque_constant = {k:g} N m/A; about nominal_voltage/no_load_speed = "
                f"{expected:.3g} N m/A expected; one of them in another unit?"
            )
    if motor.stall_torque is not None and motor.resistance is not None:
        expected = k * voltage / motor.resistance
        if not _STALL[0] <= motor.stall_torque / expected <= _STALL[1]:
            yield (
                f"stall_torque = {motor.stall_torque:g} N m; about torque_constant x "
                f"nominal_voltage/resistance = {expected:.3g} N m expected: mN m, or another "
                "unit of them?"
            )


def _unusual_heat(thermal: Thermal) -> Iterator[str]:
    winding, housing = thermal.winding_time, thermal.housing_time
    if (thermal.max_winding or 0) > 250:
        yield f"max_winding = {thermal.max_winding:g} C, at most 250 C expected; kelvin entered?"
    if winding is not None and winding < _LEAST_WINDING_TIME:
        yield (
            f"winding_time = {winding:g} s; more than {_LEAST_WINDING_TIME:g} s expected; "
            "minutes entered?"
        )
    if winding is not None and housing is not None and winding >= housing:
        yield (
            f"winding_time = {winding:g} s; less than housing_time = {housing:g} s expected; "
            "one of them in ms or minutes, or swapped?"
        )
