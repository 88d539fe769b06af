"""Units of a catalogue's figures, and those in which makers print them."""

from __future__ import annotations

import math

from pinfric.errors import CatalogError, choose_from

#: Unit -> (SI unit, factor to it). A lead is turned into a ratio: 2 pi/lead.
UNITS = {
    "N m": ("N m", 1.0),
    "mN m": ("N m", 1e-3),
    "N cm": ("N m", 1e-2),
    "kN m": ("N m", 1e3),
    "kgf cm": ("N m", 0.0980665),
    "oz in": ("N m", 0.00706155),
    "lb in": ("N m", 0.1129848),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "kgf": ("N", 9.80665),
    "lbf": ("N", 4.448222),
    "rad/s": ("rad/s", 1.0),
    "rpm": ("rad/s", math.pi / 30),
    "1/min": ("rad/s", math.pi / 30),
    "deg": ("rad", math.pi / 180),
    "deg/s": ("rad/s", math.pi / 180),
    "m/s": ("m/s", 1.0),
    "mm/s": ("m/s", 1e-3),
    "kg m^2": ("kg m^2", 1.0),
    "kg cm^2": ("kg m^2", 1e-4),
    "g cm^2": ("kg m^2", 1e-7),
    "kg mm^2": ("kg m^2", 1e-6),
    "kg": ("kg", 1.0),
    "g": ("kg", 1e-3),
    "lb": ("kg", 0.45359237),
    "V": ("V", 1.0),
    "mV": ("V", 1e-3),
    "A": ("A", 1.0),
    "mA": ("A", 1e-3),
    "ohm": ("ohm", 1.0),
    "mohm": ("ohm", 1e-3),
    "N m/A": ("N m/A", 1.0),
    "mN m/A": ("N m/A", 1e-3),
    "N/A": ("N/A", 1.0),
    "K/W": ("K/W", 1.0),
    "C": ("C", 1.0),
    "W": ("W", 1.0),
    "J": ("J", 1.0),
    "kJ": ("J", 1e3),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "min": ("s", 60.0),
    "h": ("h", 1.0),
    "1/h": ("1/h", 1.0),
    "N m/rad": ("N m/rad", 1.0),
    "N m/arcmin": ("N m/rad", 10800 / math.pi),
    "N/m": ("N/m", 1.0),
    "N/mm": ("N/m", 1e3),
    "N/um": ("N/m", 1e6),
    "rad": ("rad", 1.0),
    "arcmin": ("rad", math.pi / 10800),
    "arcsec": ("rad", math.pi / 648000),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "1": ("1", 1.0),
    "%": ("1", 1e-2),
    "rad/m": ("rad/m", 1.0),
    "mm/rev": ("rad/m", 1e-3),
    "m/rev": ("rad/m", 1.0),
    "price": ("price", 1.0),
}

_OF_UNIT = {
    "N m": "continuous_torque continuous_stall_torque peak_torque stall_torque rated_torque "
    "average_torque repeated_peak_torque momentary_peak_torque no_load_running_torque "
    "starting_torque back_driving_torque torque torque_max bearing.max_moment "
    "bearing.static_moment bearing.static_roll ratings.max_moment ratings.static_moment "
    "ratings.static_roll stiffness.t1 stiffness.t2",
    "N": "bearing.max_radial bearing.max_axial bearing.dynamic_rating bearing.static_rating "
    "ratings.max_radial ratings.max_axial ratings.dynamic_rating ratings.static_rating",
    "rad/s": "max_speed no_load_speed rated_speed average_input_speed max_input_speed",
    "kg m^2": "rotor_inertia input_inertia",
    "kg": "mass",
    "V": "nominal_voltage max_voltage voltage",
    "W": "power",
    "J": "stop_energy",
    "1/h": "stops_per_hour",
    "ohm": "resistance",
    "A": "continuous_current",
    "N m/A": "torque_constant",
    "C": "thermal.max_winding rated_ambient",
    "K/W": "thermal.winding_housing thermal.housing_ambient",
    "h": "nominal_life",
    "s": "thermal_time thermal.winding_time thermal.housing_time release_time engage_time",
    "N m/rad": "stiffness stiffness.k1 stiffness.k2 stiffness.k3",
    "rad": "hysteresis backlash",
    "price": "price",
    "m": "stroke bearing.pitch_diameter bearing.spacing bearing.offset ratings.pitch_diameter "
    "ratings.spacing ratings.offset screw.root_diameter screw.length screw.ball_circle",
    "1": "ratio efficiency back_efficiency bearing.static_safety ratings.static_safety "
    "momentary_peaks mu radial axial moment",
}
#: Figure -> its unit; what is before a point is a part of an entry.
FIGURES = {figure: unit for unit, figures in _OF_UNIT.items() for figure in figures.split()}
#: The same of what slides: the output of linear gears, all of linear motors.
_LINEAR = {
    "N m": "N",
    "rad/s": "m/s",
    "N m/rad": "N/m",
    "N m/A": "N/A",
    "kg m^2": "kg",
    "rad": "m",
}
#: Figures of what has a linear output that stay those of what turns before it.
_AT_INPUT = (
    "rotor_inertia",
    "no_load_running_torque",
    "starting_torque",
    "rated_speed",
    "no_load_speed",
    "average_input_speed",
    "max_input_speed",
    "input_inertia",
)


def unit_of(figure: str, linear: bool = False, turning: bool = False) -> str:
    """Return the SI unit of a figure.

    Args:
        figure: of `FIGURES`. linear: of what slides.
        turning: what stands before its output turns: a gear's input, a rotor with a screw.
    """
    if linear and figure == "ratio":
        return "rad/m"
    unit, part = FIGURES[figure], figure.partition(".")[0]
    turns = not linear or (turning and figure in _AT_INPUT) or part not in (figure, "stiffness")
    return unit if turns else _LINEAR.get(unit, unit)


def in_si(value: float, unit: str, wanted: str) -> float:
    """Return a figure in the SI unit it is wanted in.

    Raises:
        CatalogError: an unknown unit, or one of another quantity.
    """
    known = " ".join(unit.replace("·", " ").replace("²", "^2").replace("Ω", "ohm").split())
    known = next((u for u in UNITS if u.replace(" ", "") == known.replace(" ", "")), "")
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
