"""Limits of motors, as rows of the table."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pinfric.study.sizing.drivetrain import PER_DC_AMPERE, too_hot
from pinfric.study.sizing.limit import Judged, Limit, Text, asked, nothing
from pinfric.study.sizing.overload import Lag, heat_lag, longest_above, standstill_time
from pinfric.study.summary import ends_by_magnitude

_PRACTICE = "common practice of servo drives"


#: A bus above this many times the nominal voltage is likelier a slip than a choice.
_MOST_OVERVOLTAGE = 1.5


def _of_motor(words: str) -> Text:
    """What is missing: of the motor's torque, else the figure itself."""
    return lambda d: d.missing or words


def _continuous(d: Judged) -> float | None:
    return d.ratings.continuous_at(d.conditions, d.mean_speed)[0]


def _continuous_note(d: Judged) -> str:
    """Say how the rating was found, and when a stop exceeds it: it assumes that the rotor turns."""
    ratings, figures = d.ratings, d.figures
    limit, derated = ratings.continuous_at(d.conditions, d.mean_speed)
    notes = [derated] if derated else []
    if ratings.continuous_curve is not None and figures is not None:
        notes.append(f"of the maker's curve at the mean speed, {d.mean_speed:.4g} rad/s")
    notes += [text for text in ratings.derived if text.startswith("continuous")]
    standing, stall = None if figures is None else figures.standing, ratings.stall_at(d.conditions)
    if standing is not None and limit and standing > (limit if stall is None else stall):
        notes.append(
            f"at standstill it needs up to {standing:.3g} N m, above the continuous torque: a "
            "stalled motor has hot spots that the mean does not show (overloaded standstill)"
        )
    return "; ".join(notes)


def _lag(d: Judged) -> Lag:
    return heat_lag(d.ratings.thermal, d.ratings.thermal_time, d.conditions)


def _heat_formula(d: Judged) -> str:
    lag = _lag(d)
    nodes = " + ".join(
        f"theta(tau = {time:.4g} s)"
        if len(lag.times) == 1
        else f"{part:.3g} theta(tau = {time:.4g} s)"
        for time, part in zip(lag.times, lag.parts, strict=True)
    )
    return f"sqrt(max({nodes})) <= continuous torque{d.output}; tau theta' + theta = T_m^2, settled"


def _window(d: Judged) -> tuple[float, str]:
    return standstill_time(d.ratings.thermal, d.conditions)


def _standing_formula(d: Judged) -> str:
    of = "continuous" if d.ratings.continuous_stall_torque is None else "continuous stall"
    return f"longest standstill with |T_m| > {of} torque <= {_window(d)[0]:.3g} s"


def _standing_note(d: Judged) -> str:
    still = d.figures and d.figures.overloaded_standstill
    return "without end" if still == np.inf else ""


def _most_voltage(d: Judged) -> float | None:
    nominal = d.ratings.nominal_voltage
    return None if nominal is None else _MOST_OVERVOLTAGE * nominal


def _at_its_voltage_only(d: Judged) -> bool:
    ratings = d.ratings
    known = ratings.has_line or ratings.max_speed is None
    return not known and ratings.nominal_voltage is not None


def _made_for(d: Judged) -> str:
    nominal = d.ratings.nominal_voltage
    return "" if nominal is None else f"nominal voltage {nominal:g} V"


def _line_formula(d: Judged) -> str:
    if d.ratings.torque_constant is None or d.ratings.resistance is None:
        return "U_n max |T_m/T_stall + omega/omega_no-load| <= bus voltage"
    return "max |R(T_w) T_m/k + k omega| <= bus voltage"


def _line_note(d: Judged) -> str:
    return "; ".join(text for text in d.ratings.derived if not text.startswith("continuous"))


def _winding_room(d: Judged) -> float | None:
    limit = None if d.ratings.thermal is None else d.ratings.max_winding(d.conditions)
    return None if limit is None else limit - d.conditions.ambient


def _winding_rise(d: Judged) -> float | None:
    """max T_w - T_a; infinite where it runs away; at the mean heat where that is too hot already.

    The peak is at least the temperature at the mean heat.
    """
    room, figures = _winding_room(d), d.figures
    if room is not None and room <= 0:
        return np.inf
    if figures is None or figures.mean_temperature is None:
        return None
    peak, ambient = figures.peak_temperature, d.conditions.ambient
    at_mean = figures.mean_temperature - ambient
    if peak is not None:
        return np.inf if np.isinf(at_mean) else peak - ambient
    return at_mean if np.isinf(at_mean) or (room is not None and at_mean > room) else None


def _winding_formula(d: Judged) -> str:
    figures = d.figures
    if figures is not None and figures.peak_temperature is None and _winding_rise(d) is not None:
        return "temperature at the mean heat: T_w - T_a"
    return "settled cycle of the two-node model: max T_w - T_a"


def _lacks_heat(d: Judged) -> str:
    """Which of the figures that heat follows from are missing."""
    r = d.ratings
    electric = {"torque constant": r.torque_constant, "resistance": r.resistance}
    figures = {"thermal resistances": r.thermal} | electric
    lacking = [name for name, value in figures.items() if value is None] or list(figures)
    *first, last = lacking
    return f"{', '.join(first)} and {last}" if first else last


def _winding_missing(d: Judged) -> str:
    figures = d.figures
    if figures is None or figures.mean_temperature is None:
        return d.missing or _lacks_heat(d)
    if figures.peak_temperature is None:
        return "thermal time constants"
    return "permissible winding temperature"


def _winding_note(d: Judged) -> str:
    room, figures = _winding_room(d), d.figures
    if room is not None and room <= 0:
        return too_hot(d.conditions.ambient, d.conditions.ambient + room)
    if figures is None or figures.mean_temperature is None:
        return ""
    rise = _winding_rise(d)
    if rise is None:
        return f"at the mean heat {figures.mean_temperature:.4g} C"
    if np.isinf(rise):
        return "thermal runaway: the loss grows faster with temperature than the cooling"
    if figures.peak_temperature is None:
        return ""
    turning = d.ratings.no_load_heat * (d.ratings.rated_speed or 0.0)
    by_turning = f"; {turning:.3g} W of it by turning at rated speed" if turning > 0 else ""
    return f"reaches {figures.peak_temperature:.4g} C{by_turning}"


def _amplified(current: str) -> Callable[[Judged], float | None]:
    """The torque (N m) of one of the amplifier's currents, of the equivalent DC motor."""

    def torque(d: Judged) -> float | None:
        amplifier, k = d.candidate.amplifier, d.ratings.torque_constant
        most = None if amplifier is None else getattr(amplifier, current)
        if amplifier is None or most is None or k is None:
            return None
        return float(k * most / PER_DC_AMPERE[amplifier.current])

    return torque


def _amperes(current: str) -> Callable[[Judged], str]:
    """Say the current behind a torque."""

    def text(d: Judged) -> str:
        amplifier = d.candidate.amplifier
        most = None if amplifier is None else getattr(amplifier, current)
        return "" if amplifier is None or most is None else f"{most:g} A {amplifier.current}"

    return text


def _overdriven(d: Judged) -> float | None:
    """The longest time above the amplifier's continuous current, s."""
    limit = _amplified("continuous_current")(d)
    if d.motor is None or limit is None:
        return None
    cycle, worst = d.case.cycle, ends_by_magnitude(d.motor.torque_lower, d.motor.torque_upper)[0]
    return longest_above(cycle.t, worst, limit, np.ones(len(worst), dtype=bool), cycle.duty)


def _overdrive_time(d: Judged) -> float | None:
    if _overdriven(d) == 0:
        return np.inf
    return None if d.candidate.amplifier is None else d.candidate.amplifier.peak_time


def _amplifier_lacks(figure: str) -> Callable[[Judged], str]:
    """What is missing: of the motor's torque, its torque constant, else the amplifier's figure."""

    def text(d: Judged) -> str:
        known = d.ratings.torque_constant is not None
        return d.missing or (f"{figure} of the amplifier" if known else "torque constant")

    return text


#: Name, need, what is given, unit, formula, figure of the amplifier, a remark.
_AMPLIFIER: tuple[tuple[Any, ...], ...] = (
    (
        "amplifier peak current",
        "motor torque",
        _amplified("peak_current"),
        "torque",
        "max |T_m| <= torque constant x peak current of the amplifier",
        "peak_current",
        _amperes("peak_current"),
    ),
    (
        "amplifier continuous current",
        "motor RMS torque",
        _amplified("continuous_current"),
        "torque",
        "sqrt(1/T int T_m^2 dt) <= torque constant x continuous current of the amplifier",
        "continuous_current",
        _amperes("continuous_current"),
    ),
    (
        "amplifier overload",
        _overdriven,
        _overdrive_time,
        "s",
        "longest time above the continuous current <= peak_time of the amplifier",
        "continuous_current and peak_time",
        "",
    ),
)

#: In the order of reports.
MOTOR_LIMITS = [
    Limit(
        "continuous torque",
        need="motor RMS torque",
        gives=_continuous,
        unit="torque",
        formula=lambda d: "sqrt(1/T int T_m^2 dt) <= continuous torque" + d.output,
        source=_PRACTICE,
        missing=_of_motor("continuous torque"),
        note=_continuous_note,
        settles=("heat",),
        key="continuous_torque",
    ),
    Limit(
        "short-term torque",
        need=asked("short_term"),
        gives=_continuous,
        unit="torque",
        formula=_heat_formula,
        source=lambda d: _lag(d).source,
        missing=_of_motor("continuous torque"),
        note=lambda d: d.ratings.continuous_at(d.conditions, d.mean_speed)[1],
    ),
    Limit(
        "overloaded standstill",
        need=asked("overloaded_standstill"),
        gives=lambda d: _window(d)[0],
        unit="s",
        formula=_standing_formula,
        source=lambda d: _window(d)[1],
        missing=_of_motor("continuous torque"),
        note=_standing_note,
    ),
    Limit(
        "peak torque",
        need="motor torque",
        gives=("ratings.peak_torque",),
        unit="torque",
        formula=lambda d: f"{d.conditions.peak_factor:g} max |T_m| <= peak torque" + d.output,
        source=_PRACTICE + ": 20 to 30 %",
        missing=_of_motor("peak torque"),
        reserve=lambda conditions: conditions.peak_factor,
        settles=("motor's peak",),
        key="peak_torque",
    ),
    Limit(
        "bus voltage",
        need=lambda d: d.conditions.bus_voltage,
        gives=_most_voltage,
        unit="V",
        formula=f"bus voltage <= {_MOST_OVERVOLTAGE:g} nominal voltage",
        source="pinfric: asks about a motor far below the bus voltage",
        missing="nominal voltage",
        note=_made_for,
    ),
    Limit(
        "motor voltage",
        need=lambda d: d.ratings.nominal_voltage,
        gives=lambda d: d.conditions.bus_voltage,
        unit="V",
        formula="nominal voltage <= bus voltage, where no speed-torque line is known",
        source="pinfric: what a motor gives at a lower voltage is not known then",
        applies=_at_its_voltage_only,
    ),
    Limit(
        "speed-torque line",
        need="voltage",
        gives=lambda d: d.conditions.bus_voltage,
        unit="V",
        formula=_line_formula,
        source="equivalent circuit of a DC or field-oriented motor",
        missing=_of_motor("torque constant and resistance, or no-load speed and stall torque"),
        note=_line_note,
        settles=("motor's peak", "motor's speed"),
        key="stall_torque",
    ),
    Limit(
        "motor speed",
        need="motor speed",
        gives=lambda d: d.ratings.speed_limit(d.conditions.bus_voltage)[0],
        unit="speed",
        formula="max |omega| <= maximum speed",
        source="maker's figures",
        missing=_of_motor("maximum speed"),
        note=lambda d: d.ratings.speed_limit(d.conditions.bus_voltage)[1],
        settles=("motor's speed",),
        key="max_speed",
    ),
    Limit(
        "winding temperature",
        need=_winding_rise,
        gives=_winding_room,
        unit="K",
        formula=_winding_formula,
        source="maxon, Key information: thermal behaviour (two nodes), copper +0.39 %/K",
        missing=_winding_missing,
        note=_winding_note,
        settles=("heat",),
    ),
    Limit(
        "amplifier currents",
        need=nothing,
        gives=nothing,
        unit="A",
        formula="currents of the motor <= those of its amplifier",
        source="maker's figures",
        missing="conditions.amplifiers: which amplifier feeds it",
        applies=lambda d: d.candidate.amplifier is None,
    ),
    *(
        Limit(
            name,
            need,
            gives,
            unit,
            formula,
            source="maker's figures of the amplifier",
            missing=_amplifier_lacks(figure),
            note=note,
            applies=lambda d: d.candidate.amplifier is not None,
            endless="never above its continuous current",
        )
        for name, need, gives, unit, formula, figure, note in _AMPLIFIER
    ),
]
