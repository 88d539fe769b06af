"""Units of a catalogue's figures, and those in which makers print them."""

from __future__ import annotations

import math

from pinfric.errors import CatalogError, choose_from

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
    "price": {},
}
#: Unit -> (SI unit, factor to it). A lead is turned into a ratio: 2 pi/lead.
UNITS = {
    unit: (si, factor)
    for si, others in _PRINTED.items()
    for unit, factor in {si: 1.0, **others}.items()
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
    *("rotor_inertia", "no_load_running_torque", "starting_torque", "rated_speed"),
    *("no_load_speed", "average_input_speed", "max_input_speed", "input_inertia"),
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
