"""The one table of a drive's limits (`limit.Limit`): `size`, `sweep` and `retime` judge by it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from pinfric.drives import kinds
from pinfric.drives.bearing import (
    BALL,
    KINDS,
    ROLLER,
    BearingLoad,
    BearingRatings,
    bearing_life,
    equivalent_load,
    guide_safety,
    static_load,
)
from pinfric.drives.catalog import Nut, Screw
from pinfric.drives.criterion import Criterion, Status
from pinfric.drives.demand import average_output_effort, mean, share
from pinfric.drives.drivetrain import (
    Candidate,
    MotorCycle,
    amplifier_torque,
    too_hot,
)
from pinfric.drives.limit import (
    GEAR_FIGURES,
    MOTOR_FIGURES,
    SIGNALS,
    Candidates,
    Figure,
    JointCase,
    Limit,
    Value,
    first_known,
    never,
    nothing,
    number,
)
from pinfric.drives.overload import Lag, heat_lag, standstill_time
from pinfric.drives.policy import (
    EXTRA_LOW_VOLTAGE,
    MOST_OVERVOLTAGE,
    STALLED,
    STAND_INS,
    stated,
)
from pinfric.drives.reading import read_drive
from pinfric.drives.rules import (
    buckling_load,
    critical_speed,
    dn_speed,
    gear_life,
    momentary_peaks,
    nut_pv,
    resonance,
)
from pinfric.errors import SizingError, choose_from
from pinfric.model.transmission import driven_efficiency

#: The row of what a gear bears in a collision or a stop, and that of a motor whose amplifier the
#: conditions do not name.
SHOCK, AMPLIFIER_CURRENTS = "gear momentary peak torque", "amplifier currents"
_PRACTICE = "common practice of servo drives"
_MAKER = "maker's figures"
_HARMONIC = "Harmonic Drive engineering data 1021387 12/2018, p. 30"
_STATED = "motor file, or the URDF: used by retiming only"
_THK = "THK, selection of ball screws: "
_LOOPS = "inertia about a joint of a loop that its drives do not determine"


# ------------------------------------------------------------------------------------- motors


def _of_motor(words: str) -> Callable[[Candidates], str]:
    """What is missing: of the motor's torque, else the figure itself."""
    return lambda d: d.missing or words


def _derived(figure: str) -> Callable[[Candidates], str]:
    return lambda d: "; ".join(text for of, text in d.ratings.derived if of == figure)


def _continuous_note(d: Candidates) -> str:
    """Say how the rating was found, and when a hold exceeds it: it assumes that the rotor turns."""
    ratings, figures = d.ratings, d.asked.figures
    limit, derated = ratings.continuous_at(d.conditions, d.asked.mean_speed)
    notes = [derated] if derated else []
    if ratings.continuous_curve is not None and figures is not None:
        notes.append(f"of the maker's curve at the mean speed, {d.asked.mean_speed:.4g} rad/s")
    notes += [text] if (text := _derived("continuous torque")(d)) else []
    standing, stall = d.asked.standing, ratings.stall_at(d.conditions)
    if limit and stall is not None and standing > stall:
        notes.append(
            f"at standstill it needs up to {standing:.3g} N m, above {stall:.3g} for ever: a "
            "stalled motor has hot spots that the mean does not show (overloaded standstill)"
        )
    return "; ".join(notes)


def _lag(d: Candidates) -> Lag:
    thermal = d.ratings.thermal_at(d.conditions)
    return heat_lag(thermal, d.ratings.thermal_time, d.conditions)


def _cooled(d: Candidates) -> tuple[str, ...]:
    """The conditions that derate the continuous torque."""
    by_class = d.ratings.max_winding_printed is None and d.ratings.ambient_curve is None
    sets = {"ambient": True, "max_winding": by_class, "cooling": d.ratings.aired(d.conditions) < 1}
    return tuple(key for key, does in sets.items() if does)


def _stalled(d: Candidates) -> tuple[str, ...]:
    """The same, and `thermal_time` where the winding's is not printed."""
    thermal = d.ratings.thermal
    printed = thermal is not None and thermal.winding_time is not None
    return _cooled(d) if printed else (*_cooled(d), "thermal_time")


def _warmed(d: Candidates) -> tuple[str, ...]:
    """The same, and `thermal_time` where neither the winding's nor the motor's is printed."""
    return _stalled(d) if d.ratings.thermal_time is None else _cooled(d)


def _heat_formula(d: Candidates) -> str:
    lag = _lag(d)
    parts = ("",) if len(lag.times) == 1 else tuple(f"{weight:.3g} " for weight in lag.parts)
    nodes = " + ".join(
        f"{weight}theta(tau = {time:.4g} s)" for time, weight in zip(lag.times, parts, strict=True)
    )
    return f"sqrt(max({nodes})) <= continuous torque{d.output}; tau theta' + theta = T_m^2, settled"


def _window(d: Candidates) -> tuple[float, str]:
    return standstill_time(d.ratings.thermal, d.conditions)


def _standing_formula(d: Candidates) -> str:
    ratings, of = d.ratings, f"{STALLED:g} x continuous torque, by rule,"
    if ratings.continuous_stall_torque is not None or ratings.continuous_curve is not None:
        of = "continuous stall torque"
    return f"longest standstill with |T_m| > {of} <= {_window(d)[0]:.3g} s"


def _has_line(d: Candidates) -> Value:
    electric = d.motor.torque_constant * d.motor.resistance
    return ~np.isnan(electric) | ~np.isnan(d.motor.no_load_speed * d.motor.stall_torque)


def _most_voltage(d: Candidates) -> Value:
    any_winding = d.conditions.bus_voltage <= EXTRA_LOW_VOLTAGE
    rule = np.inf if any_winding else MOST_OVERVOLTAGE * d.motor.nominal_voltage
    return np.where(np.isnan(d.motor.max_voltage), rule, d.motor.max_voltage)


def _nominal_note(d: Candidates) -> str:
    nominal = float(d.motor.nominal_voltage)
    return "" if np.isnan(nominal) else f"nominal voltage {nominal:g} V"


def _at_its_voltage_only(d: Candidates) -> Value:
    known = _has_line(d) | np.isnan(first_known(d.motor, STAND_INS["max_speed"]))
    return ~known & ~np.isnan(d.motor.nominal_voltage)


def _line_formula(d: Candidates) -> str:
    most = f"{d.share:g} x bus voltage" if d.share < 1 else "bus voltage"
    hot = f"R/R(25 C) = {d.asked.hot:.3g}"
    if d.ratings.torque_constant is None or d.ratings.resistance is None:
        return f"U_n max |(T_m/T_stall) R/R(25 C) + omega/omega_no-load| <= {most}; {hot}"
    return f"max |R(T_w) T_m/k + k omega| <= {most}; {hot}"


def _bus_share(d: Candidates) -> tuple[str, ...]:
    """The conditions that set the voltage at the motor's terminals."""
    if d.share == d.conditions.amplifier_share:
        return "bus_voltage", "amplifier_share"
    return ("bus_voltage", "amplifiers") if _fed(d) else ("bus_voltage",)


def _shared_voltage(d: Candidates) -> tuple[str, ...]:
    """The same, and how hot the winding is."""
    guessed = np.isnan(d.asked.peak_temperature) and not np.isfinite(d.asked.mean_temperature)
    taken = bool(guessed) and d.ratings.max_winding_printed is None
    return (*_bus_share(d), "max_winding") if taken else _bus_share(d)


def _fastest(d: Candidates) -> Value:
    """Maximum speed; where no speed-torque line says what is left of it, by the voltage."""
    speed = first_known(d.motor, STAND_INS["max_speed"])
    lower = np.minimum(d.voltage / d.motor.nominal_voltage, 1.0)
    return np.where(_has_line(d) | np.isnan(lower), speed, lower * speed)


def _slowed(d: Candidates) -> tuple[str, ...]:
    """The conditions that set the voltage, where it sets the speed."""
    by_voltage = not _has_line(d) and not np.isnan(d.motor.nominal_voltage)
    return _bus_share(d) if by_voltage else ()


def _fastest_note(d: Candidates) -> str:
    most, at_nominal = float(_fastest(d)), float(first_known(d.motor, STAND_INS["max_speed"]))
    if not most < at_nominal:
        return ""
    return (
        f"{at_nominal:.4g} at {d.motor.nominal_voltage:g} V, in proportion to the {d.voltage:g} V "
        "that it gets: no speed-torque line is known"
    )


def _winding_room(d: Candidates) -> float:
    if d.ratings.thermal is None:
        return np.nan
    return d.ratings.max_winding(d.conditions) - d.conditions.ambient


def _winding_rise(d: Candidates) -> Value:
    """max T_w - T_a, at the mean heat where that is too hot already; infinite: it runs away."""
    room, ambient, mean = _winding_room(d), d.conditions.ambient, d.asked.mean_temperature
    if room <= 0:
        return np.inf
    peak, runs_away = d.asked.peak_temperature, np.isinf(mean)
    too_hot_in_the_mean = runs_away | (mean - ambient > room)
    over_time = np.where(runs_away, np.inf, peak - ambient)
    at_mean = np.where(too_hot_in_the_mean, mean - ambient, np.nan)
    return np.where(np.isnan(peak), at_mean, over_time)[()]


def _winding_formula(d: Candidates) -> str:
    if np.isnan(d.asked.peak_temperature) and not np.isnan(_winding_rise(d)):
        return "temperature at the mean heat: T_w - T_a"
    return "settled cycle of the two-node model: max T_w - T_a"


def _winding_missing(d: Candidates) -> str:
    if not np.isnan(d.asked.mean_temperature):
        return "thermal time constants"
    r = d.ratings
    electric = {"torque constant": r.torque_constant, "resistance": r.resistance}
    figures = {"thermal resistances": r.thermal} | electric
    lacking = [name for name, value in figures.items() if value is None] or list(figures)
    *first, last = lacking
    return d.missing or (f"{', '.join(first)} and {last}" if first else last)


def _winding_note(d: Candidates) -> str:
    room, mean, rise = _winding_room(d), d.asked.mean_temperature, _winding_rise(d)
    if room <= 0:
        return too_hot(d.conditions.ambient, d.conditions.ambient + room)
    if np.isnan(rise):
        return "" if np.isnan(mean) else f"at the mean heat {mean:.4g} C"
    if np.isinf(rise):
        return "thermal runaway: the loss grows faster with temperature than the cooling"
    if np.isnan(d.asked.peak_temperature):
        return ""
    turning = d.ratings.no_load_heat * (d.ratings.rated_speed or 0.0)
    by_turning = f"; {turning:.3g} W of it by turning at rated speed" if turning > 0 else ""
    return f"reaches {d.asked.peak_temperature:.4g} C{by_turning}"


def _amplified(current: str) -> Figure:
    return lambda d: number(amplifier_torque(d.candidate, current)[0])


def _amperes(current: str) -> Callable[[Candidates], str]:
    return lambda d: amplifier_torque(d.candidate, current)[1]


def _overdrive_time(d: Candidates) -> Value:
    amplifier = d.candidate.amplifier
    most = np.nan if amplifier is None else number(amplifier.peak_time)
    return np.where(d.asked.overdriven == 0, np.inf, most)[()]


def _bus_of_amplifier(figure: str) -> Figure:
    return lambda d: number(getattr(d.candidate.amplifier, figure, None))


def _fed(d: Candidates) -> bool:
    return d.candidate.amplifier is not None


def _of_amplifier(figure: str) -> Callable[[Candidates], str]:
    """What is missing: of the motor's torque, its torque constant, else the amplifier's figure."""
    return lambda d: (
        d.missing
        or (
            "torque constant" if d.ratings.torque_constant is None else f"{figure} of the amplifier"
        )
    )


_RMS = "sqrt(1/T int T_m^2 dt) <= "
_NEVER_ABOVE = "never above its continuous current"
# fmt: off
MOTOR_LIMITS = [
    Limit("continuous torque", "motor RMS torque", lambda d: d.heat, "torque",
          lambda d: f"{d.conditions.rms_factor:g} {_RMS}continuous torque{d.output}",
          "Kollmorgen Developer Network, derating: encoder and brake cost 7 to 16 % at 40 C",
          _of_motor("continuous torque"), _continuous_note,
          stage="pair", condition=_cooled, reserve="rms_factor", key="continuous_torque"),
    Limit("short-term torque", lambda d: d.asked.short_term, lambda d: d.heat, "torque",
          _heat_formula, lambda d: _lag(d).source, _of_motor("continuous torque"),
          lambda d: d.ratings.continuous_at(d.conditions, d.asked.mean_speed)[1],
          condition=_warmed),
    Limit("overloaded standstill", lambda d: d.asked.overloaded_standstill,
          lambda d: _window(d)[0], "s", _standing_formula, lambda d: _window(d)[1],
          _of_motor("continuous torque"),
          lambda d: "without end" if d.asked.overloaded_standstill == np.inf else "",
          condition=_stalled),
    Limit("peak torque", "motor torque", "motor.peak_torque", "torque",
          lambda d: f"{d.conditions.peak_factor:g} max |T_m| <= peak torque{d.output}",
          _PRACTICE + ": 20 to 30 %", _of_motor("peak torque"), _derived("peak torque"),
          stage="pair", reserve="peak_factor", key="peak_torque"),
    *(row for kind in kinds.KINDS for row in kind.limits),
    Limit("peak torque of braking", lambda d: d.asked.braking, "motor.peak_torque", "torque",
          lambda d: f"max |T_m| at the deceleration of a stop <= peak torque{d.output}",
          "inverse dynamics with the rotor, without payload and with", _of_motor("peak torque"),
          applies=lambda d: bool(d.case.braking)),
    Limit("bus voltage", lambda d: d.conditions.bus_voltage, _most_voltage, "V",
          f"bus voltage <= {MOST_OVERVOLTAGE:g} nominal voltage, or extra-low voltage",
          f"pinfric: any winding up to {EXTRA_LOW_VOLTAGE:g} V DC; above that a question",
          "nominal voltage", _nominal_note,
          stage="pair", condition=("bus_voltage",),
          endless=f"extra-low voltage, up to {EXTRA_LOW_VOLTAGE:g} V DC: any winding"),
    Limit("motor voltage", lambda d: d.motor.nominal_voltage, lambda d: d.conditions.bus_voltage,
          "V", "nominal voltage <= bus voltage, where no speed-torque line is known",
          "pinfric: what a motor gives at a lower voltage is not known then",
          stage="pair", condition=("bus_voltage",), applies=_at_its_voltage_only),
    Limit("speed-torque line", "voltage", lambda d: d.voltage, "V", _line_formula,
          "equivalent circuit of a DC or field-oriented motor",
          _of_motor("torque constant and resistance, or no-load speed and stall torque"),
          _derived("line"),
          stage="pair", condition=_shared_voltage, key="stall_torque"),
    Limit("motor speed", "motor speed", _fastest, "speed",
          "max |omega| <= maximum speed", _MAKER, "maximum speed", _fastest_note, stage="pair",
          condition=_slowed, key="max_speed"),
    Limit("winding temperature", _winding_rise, _winding_room, "K", _winding_formula,
          "maxon, Key information: thermal behaviour (two nodes), copper +0.39 %/K",
          _winding_missing, _winding_note, condition=_cooled),
    Limit(AMPLIFIER_CURRENTS, nothing, nothing, "A",
          "currents of the motor <= those of its amplifier", _MAKER,
          "conditions.amplifiers: which amplifier feeds it", applies=lambda d: not _fed(d)),
    Limit("amplifier bus voltage", lambda d: d.conditions.bus_voltage,
          _bus_of_amplifier("max_voltage"), "V", "bus voltage <= highest of the amplifier",
          f"{_MAKER} of the amplifier", "highest voltage of the amplifier",
          condition=("amplifiers", "bus_voltage"), applies=_fed),
    Limit("amplifier least voltage", _bus_of_amplifier("min_voltage"),
          lambda d: d.conditions.bus_voltage, "V", "lowest of the amplifier <= bus voltage",
          f"{_MAKER} of the amplifier", "lowest voltage of the amplifier",
          condition=("amplifiers", "bus_voltage"), applies=_fed),
    Limit("amplifier peak current", "motor torque", _amplified("peak_current"), "torque",
          "max |T_m| <= torque constant x peak current of the amplifier",
          f"{_MAKER} of the amplifier", _of_amplifier("peak_current"), _amperes("peak_current"),
          condition=("amplifiers",), applies=_fed, endless=_NEVER_ABOVE),
    Limit("amplifier continuous current", "motor RMS torque", _amplified("continuous_current"),
          "torque", f"{_RMS}torque constant x continuous current of the amplifier",
          f"{_MAKER} of the amplifier", _of_amplifier("continuous_current"),
          _amperes("continuous_current"), condition=("amplifiers",), applies=_fed,
          endless=_NEVER_ABOVE),
    Limit("amplifier overload", lambda d: d.asked.overdriven, _overdrive_time, "s",
          "longest time above the continuous current <= peak_time of the amplifier",
          f"{_MAKER} of the amplifier", _of_amplifier("continuous_current and peak_time"),
          condition=("amplifiers",), applies=_fed, endless=_NEVER_ABOVE),
]
# fmt: on


# -------------------------------------------------------------------------------------- gears


def _has_gear(d: Candidates) -> bool:
    return d.one is None or d.one.gear is not None


def _linear(d: Candidates) -> bool:
    return d.linear and _has_gear(d)


def _shocked(d: Candidates) -> bool:
    """Whether it has a gear that bears stops, also one in a gearmotor with a brake."""
    return _has_gear(d) or (d.candidate.brake != "" and d.ratio != 1.0)


def _collision(d: Candidates) -> float:
    wanted = number(d.conditions.collision_effort.get(d.demand.name))
    return float(np.fmax(wanted, d.case.stop_effort))


def _rolls(d: Candidates) -> Value:
    """Which gears are cycloidal."""
    return ~np.isnan(d.gear.rollers)


def _average_torque(d: Candidates) -> Value:
    """The mean that wears a gear: of cycloidal ones with the exponent of rollers."""
    if not np.any(_rolls(d)):
        return d.demand.mean_cubic
    return np.where(_rolls(d), _rollers_torque(d), d.demand.mean_cubic)


def _rollers_torque(d: Candidates) -> float:
    cycle = d.case.cycle
    return average_output_effort(cycle.stretched, cycle.ends[0], cycle.velocity, ROLLER)


def _speed_under_load(d: Candidates) -> Value:
    """Mean input speed while the joint moves, pauses left out."""
    cycle = d.case.cycle
    moving = share(cycle.stretched, np.abs(cycle.velocity) > cycle.stick_velocity)
    speed = mean(cycle.stretched, np.abs(cycle.velocity))
    return d.ratio * (min(speed / moving, d.demand.speed) if moving > 0 else 0.0)


def _by_stop(d: Candidates) -> bool:
    return d.case.stop_effort == _collision(d)


def _shock_missing(d: Candidates) -> str:
    if not np.isnan(_collision(d)):
        return "momentary peak" + " of the gear in the gearmotor" * (not _has_gear(d))
    stopped = "peaks of stops, of a motion that drives do not determine"
    return stopped if d.candidate.brake else "conditions.collision_effort"


def _shock_note(d: Candidates) -> str:
    note = f"{d.case.stop_note}; {d.candidate.brake_note}"
    return note.strip("; ") if _by_stop(d) else ""


def _by_rule(d: Candidates) -> bool:
    """Whether the number of momentary peaks follows from the maker's rule."""
    return np.isnan(d.gear.momentary_peaks) and d.entry.kind == "strain wave"


def _momentary_peaks(d: Candidates) -> float:
    wanted = d.conditions.collisions
    if wanted is None or not _by_rule(d):
        return d.gear.momentary_peaks
    return momentary_peaks(d.ratio * d.demand.speed, wanted.duration)


def _gear_life(d: Candidates) -> Value:
    if not _has_gear(d):  # a gearmotor: its maker prints no life
        return np.nan
    life, speed, torque = d.gear.nominal_life, d.gear.rated_speed, d.gear.rated_torque
    mean_speed, mean_effort = d.ratio * d.demand.mean_speed, d.demand.mean_cubic
    if d.entry.kind == "planetary":  # no law: printed for what is within the ratings
        most = first_known(d.gear, STAND_INS["average_input_speed"])
        within = (d.demand.peak <= torque) & (mean_speed <= most)
        return np.where(within, _PLANETARY_LIFE, np.nan)[()]
    if d.entry.kind != "cycloidal":
        known = not np.isnan(life * speed * torque)
        return gear_life(life, speed, torque, mean_speed, mean_effort) if known else np.nan
    life = _CYCLOIDAL_LIFE if np.isnan(life) else life
    if np.isnan(speed * torque):
        return np.nan
    return gear_life(life, speed, torque, mean_speed, _rollers_torque(d), ROLLER)


#: Formula and source of a gear's life, by its kind; of others as of strain wave gears.
_LIVES = {
    "planetary": (
        "more than 20,000 h where max |T| <= T2N and the mean input speed <= n1N",
        "Beckhoff AG2400, TP",
    ),
    "cycloidal": (
        "L10 = L_n (n_N/n_in,av)(T_N/T_av)^(10/3), T_av over |v| with 10/3",
        "Nabtesco GH, glossary: L_n = 6000 h; ISO 281's exponent of rollers, by rule",
    ),
}
_STRAIN_WAVE_LIFE = (
    "L10 = L50/5, L50 = L_n (n_N/n_in,av)(T_N/T_av)^3",
    "Harmonic Drive engineering data 1021387 12/2018, p. 32, equations 32.2, 32.3",
)
_PLANETARY_LIFE, _CYCLOIDAL_LIFE = 20_000.0, 6_000.0


def _life_of(d: Candidates) -> tuple[str, str]:
    return _LIVES.get(d.entry.kind if _has_gear(d) else "", _STRAIN_WAVE_LIFE)


def _above_rated(d: Candidates) -> np.ndarray:
    return np.abs(d.case.cycle.ends[0]) > d.gear.rated_torque


def _peak_turns(d: Candidates) -> float:
    """Output turns above the nominal torque in the life asked for, else 20,000 h."""
    cycle, hours = d.case.cycle, d.conditions.life or _PLANETARY_LIFE
    rate = mean(cycle.stretched, np.abs(cycle.velocity) * _above_rated(d))
    return rate / (2 * np.pi) * 3600 * hours


def _peaks_per_hour(d: Candidates) -> float:
    """How often an hour the nominal torque is exceeded."""
    cycle, above, rises = d.case.cycle, _above_rated(d), 0.0
    runs, starts = cycle.schedule.repeats, cycle.schedule.starts
    parts = [(n, above[starts[k] : starts[k + 1]]) for k, n in enumerate(runs) if n]
    drops = not all(exceeded[-1] for _, exceeded in parts)
    for n, exceeded in parts:
        rises += n * float((exceeded[1:] & ~exceeded[:-1]).sum() + (exceeded[0] and drops))
    return rises * 3600 / float(cycle.stretched[-1] - cycle.stretched[0])


def _printed(figure: str) -> Callable[[Candidates], bool]:
    return lambda d: d.one is not None and _has_gear(d) and getattr(d.entry, figure) is not None


def _screw(d: Candidates) -> bool:
    return d.one is not None and d.one.gear is not None and "screw" in d.one.gear.kind


def _of_screw(rule: Callable[[Screw], float | None]) -> Figure:
    return lambda d: np.nan if d.entry.screw is None else number(rule(d.entry.screw))


def _buckling(d: Candidates) -> float:
    """Euler's, or the maker's force of a complete unit, which has a stroke."""
    if d.entry.screw is not None:
        return buckling_load(d.entry.screw)
    return d.gear.rated_torque if d.entry.stroke is not None else np.nan


def _buckling_note(d: Candidates) -> str:
    if d.entry.screw is not None or np.isnan(_buckling(d)):
        return ""
    return f"the maker's rated force of a unit of {d.entry.stroke:g} m stroke"


def _tightest(d: Candidates) -> tuple[float, float]:
    """Effort and the maker's limit at its speed, at the sample of least margin."""
    assert d.entry.effort_curve is not None  # the row is for gears that have one
    at, limits = np.transpose(d.entry.effort_curve)
    speed, effort = d.ratio * np.abs(d.case.cycle.velocity), np.abs(d.case.cycle.ends[0])
    if speed.max() > at[-1]:
        return float(effort[np.argmax(speed)]), np.nan
    allowed = np.interp(speed, at, limits)
    k = int(np.argmax(effort / allowed))
    return float(effort[k]), float(allowed[k])


def _of_nut(needs: Callable[[Nut, Candidates], float | None]) -> Figure:
    return lambda d: np.nan if d.entry.nut is None else number(needs(d.entry.nut, d))


def _lead_screw(d: Candidates) -> bool:
    return _screw(d) and d.entry.kind == "lead screw"


_LENGTH = "screw: root diameter, length and supports"
# fmt: off
GEAR_LIMITS = [
    Limit("gear average torque", _average_torque, "gear.average_torque", "effort",
          lambda d: "T_av = (int |v| |T|^(10/3) dt/int |v| dt)^(3/10) <= rated torque" if _rolls(d)
          else "T_av = cbrt(int |v T^3| dt/int |v| dt) <= limit for average torque",
          lambda d: _LIVES["cycloidal"][1] if _rolls(d) else _HARMONIC,
          "limit for average torque", stage="gear", applies=_has_gear),
    Limit("gear repeated peak torque", "effort", "gear.repeated_peak_torque", "effort",
          "max |T| <= limit for repeated peak torque", _HARMONIC,
          "limit for repeated peak torque", stage="gear", applies=_has_gear),
    Limit("gear turns above rated torque", _peak_turns, lambda d: number(d.entry.peak_turns), "",
          "output turns with |T| > T2N in `life`, else 20,000 h <= those of its maker",
          "Neugart PLE as Beckhoff AG2250: T2B for 30,000 output revolutions in all",
          stage="entry", condition=("life",), applies=_printed("peak_turns")),
    Limit("gear peaks per hour", _peaks_per_hour, lambda d: number(d.entry.peaks_per_hour), "1/h",
          "times an hour that |T| rises above T2N <= those of its maker",
          "Wittenstein as Beckhoff AG2300, AG3300: T2B for 1000 cycles an hour",
          stage="entry", applies=_printed("peaks_per_hour")),
    Limit("gear effort at its speed", lambda d: _tightest(d)[0], lambda d: _tightest(d)[1],
          "effort", "|T| <= the maker's limit at the input speed of the same instant", _MAKER,
          "the maker's curve ends below the input speed", stage="entry",
          applies=lambda d: d.one is not None and _has_gear(d)
          and d.entry.effort_curve is not None),
    Limit("effort", "effort", nothing, "effort", "max |effort| <= effort", _STATED,
          applies=never, key="effort"),
    Limit(SHOCK, _collision, "gear.momentary_peak_torque", "effort",
          "collision or emergency stop <= limit for momentary peak torque", _HARMONIC,
          _shock_missing, _shock_note, stage="gear", applies=_shocked,
          condition=lambda d: ("stop_factor" if _by_stop(d) else "collision_effort",)),
    Limit("gear momentary peaks",
          lambda d: np.nan if d.conditions.collisions is None else d.conditions.collisions.count,
          _momentary_peaks, "",
          lambda d: "collisions <= N = 10^4/(2 (n/60) t), n the greatest input speed in rpm"
          if _by_rule(d) else "collisions <= N",
          lambda d: "Harmonic Drive CSF/CSG catalogue, momentary peak torque"
          if _by_rule(d) else "maker's number",
          "momentary_peaks", stage="entry", condition=("collisions",),
          applies=lambda d: _has_gear(d) and d.conditions.collisions is not None,
          endless="the joint never moves"),
    Limit("gear maximum input speed", "input speed", "gear.max_input_speed", "rad/s",
          "ratio max |v| <= maximum input speed", _HARMONIC, "maximum input speed",
          stage="gear", applies=_has_gear, key="input_speed"),
    Limit("joint speed", "speed", nothing, "rad/s or m/s", "max |v| <= velocity", _STATED,
          applies=never, key="velocity"),
    Limit("acceleration", "acceleration", nothing, "rad/s^2 or m/s^2",
          "max |a| <= acceleration", _STATED, applies=never, key="acceleration"),
    Limit("gear average input speed", lambda d: d.ratio * d.demand.mean_speed,
          "gear.average_input_speed", "rad/s",
          "ratio 1/T int |v| dt <= limit for average input speed", _HARMONIC,
          "limit for average input speed", stage="gear",
          applies=lambda d: _has_gear(d) & ~_rolls(d)),
    Limit("gear speed under load", _speed_under_load, "gear.max_input_speed", "rad/s",
          "ratio int |v| dt/(time in which it moves) <= maximum input speed",
          "Nabtesco manual of RV gears, p. 8: the allowable output speed is without load",
          "maximum input speed", stage="gear", applies=_rolls),
    Limit("gear life L10", lambda d: number(d.conditions.life), _gear_life, "h",
          lambda d: _life_of(d)[0], lambda d: _life_of(d)[1],
          "nominal life, rated speed or rated torque", condition=("life",),
          endless="the joint never moves", optional=True),
    Limit("screw critical speed", "input speed", _of_screw(critical_speed), "rad/s",
          "ratio max |v| <= 0.8 lambda^2/l^2 sqrt(E I/(rho A))",
          _THK + "permissible rotational speed", _LENGTH, stage="entry", applies=_screw),
    Limit("screw DN value", "input speed", _of_screw(dn_speed), "rad/s",
          "ratio max |v| <= DN/ball circle diameter", _THK + "DN value",
          "screw: ball_circle and max_dn", stage="entry",
          applies=lambda d: _screw(d) and d.entry.kind == "ball screw"),
    Limit("screw buckling", "effort", _buckling, "effort", "max |F| <= n pi^2 E I/l^2 x 0.5",
          _THK + "buckling load", _LENGTH, _buckling_note, stage="entry", applies=_screw),
    Limit("nut pressure", _of_nut(lambda nut, d: d.demand.peak / nut.contact_area),
          _of_nut(lambda nut, d: nut.max_pressure), "Pa",
          "max |F|/A <= permissible pressure of the nut", _MAKER,
          "nut: contact_area and max_pressure", stage="entry", applies=_lead_screw),
    Limit("nut PV value", _of_nut(lambda nut, d: nut_pv(nut, d.ratio, d.case.cycle)),
          _of_nut(lambda nut, d: nut.max_pv), "Pa m/s",
          "max |F|/A |v| sqrt(1 + (ratio d/2)^2) <= permissible PV of the nut",
          "Thomson, PV of lead screws with polymer nuts; at every instant of the cycle",
          "nut: diameter, contact_area and max_pv", stage="entry", applies=_lead_screw),
    Limit("stroke", lambda d: number(d.demand.travel), "gear.stroke", "m",
          "max q - min q <= stroke", _MAKER, "stroke", stage="gear", applies=_linear),
]
# fmt: on


# ----------------------------------------------------------------------------------- bearings


def _turning(d: Candidates) -> bool:
    return not d.linear


def _on_nut(d: Candidates) -> bool:
    """Whether a nut that is rated as a bearing carries the joint."""
    return d.linear and _screw(d) and d.entry.nut is None


def _rule(d: Candidates) -> str:
    rule = KINDS[d.bearing.kind].source
    return f"{rule}; ratings: {d.bearing.source}" if d.bearing.source else rule


def _borne(rule: Callable[[BearingRatings, BearingLoad], float | None]) -> Figure:
    return lambda d: np.nan if (x := d.demand.bearing) is None else number(rule(d.bearing, x))


def _static_safety(bearing: BearingRatings, load: BearingLoad) -> float | None:
    carried, rating = static_load(bearing, load), bearing.static_rating
    if carried is None or rating is None:
        return None
    with np.errstate(divide="ignore"):
        return np.divide(rating, carried)


def _safety_formula(d: Candidates) -> str:
    if d.bearing.rule is None or d.bearing.screw:
        return "f_s = C_0/P_0"
    x, y = d.bearing.rule.static
    return f"f_s = C_0/P_0, P_0 = {x:g} P_r + {y:g} F_a"


def _bearing_life(d: Candidates) -> Value:
    load, rating = d.demand.bearing, d.bearing.dynamic_rating
    equivalent = None if load is None else equivalent_load(d.bearing, load)
    if load is None or equivalent is None or rating is None:
        return np.nan
    speed = load.speed * (d.ratio if d.bearing.screw else 1.0)
    exponent = KINDS[d.bearing.kind].exponent
    return bearing_life(rating, d.conditions.shock * equivalent, speed, exponent)


def _life_formula(d: Candidates) -> str:
    exponent = "3" if KINDS[d.bearing.kind].exponent == BALL else "10/3"
    return f"L10 = 10^6 revolutions (C/({d.conditions.shock:g} P))^({exponent})"


def _life_note(d: Candidates) -> str:
    equivalent = _borne(equivalent_load)(d)
    return "" if np.isnan(equivalent) else f"P = {equivalent:.4g} N"


def _of_bearing(figure: str) -> Callable[[Candidates], str]:
    return lambda d: figure if d.demand.bearing else "the joint's wrench"


def _rated(what: str, carried: Callable[[Candidates], bool], names: Collection[str]) -> list[Limit]:
    """The rows of what carries a joint, whose ratings are known."""
    static = "static load rating C_0 or pitch diameter"

    def applies(d: Candidates) -> bool:
        return d.one is not None and carried(d) and d.one.bearing is not None

    # fmt: off
    rows = [
        Limit("tilting moment", _borne(lambda b, load: load.moment + b.offset * load.radial),
              lambda d: number(d.bearing.max_moment), "N m",
              "max M + R max F_r <= permissible tilting moment", _rule,
              _of_bearing("permissible tilting moment")),
        Limit("radial force", _borne(lambda _, load: load.radial),
              lambda d: number(d.bearing.max_radial), "N",
              "max |F_r| <= permissible radial force", _rule,
              _of_bearing("permissible radial force")),
        Limit("axial force", _borne(lambda _, load: load.axial),
              lambda d: number(d.bearing.max_axial), "N",
              "max |F_a| <= permissible axial force", _rule,
              _of_bearing("permissible axial force")),
        Limit("static safety", lambda d: d.bearing.static_safety, _borne(_static_safety), "",
              _safety_formula, _rule, _of_bearing(static), endless="no load"),
        Limit("life L10", lambda d: number(d.conditions.life), _bearing_life, "h",
              _life_formula, _rule, _of_bearing("dynamic load rating C or pitch diameter"),
              _life_note, condition=("life", "shock"), endless="it never turns under load",
              optional=True),
    ]
    # fmt: on
    return [
        replace(row, name=f"{what} {row.name}", stage="entry", applies=applies)
        for row in rows
        if row.name in names
    ]


def _unrated(name: str, kind: str, applies: Callable[[Candidates], bool]) -> Limit:
    """The row that says that nothing is known of what carries a joint."""
    what = name.partition(" ")[0]
    missing = f"ratings of the {what}" + "; conditions.bearings" * (what == "guide")
    formula, source = "loads and life by its ratings", KINDS[kind].source
    return Limit(name, nothing, nothing, "", formula, source, missing, applies=applies)


def _bare(carried: Callable[[Candidates], bool]) -> Callable[[Candidates], bool]:
    return lambda d: carried(d) and d.candidate.bearing is None


def _on_joint(d: Candidates) -> bool:
    return d.case.way is None or not d.case.way.between_pins


def _guided(d: Candidates) -> bool:
    return d.linear and d.candidate.guide is not None


_FORCES = ("tilting moment", "radial force", "axial force", "static safety", "life L10")
# fmt: off
BEARING_LIMITS = [
    _unrated("bearing loads", "crossed roller", _bare(_turning)),
    *_rated("bearing", _turning, _FORCES),
    _unrated("screw loads", "ball screw", _bare(_on_nut)),
    *_rated("screw", _on_nut, _FORCES[2:]),
    _unrated("guide loads", "linear guide", lambda d: d.linear and not _guided(d) and _on_joint(d)),
    Limit("guide static safety", lambda d: d.guide.least_safety,
          lambda d: number(d.demand.guide and guide_safety(d.guide, d.demand.guide)), "",
          "f_s = 1/(sqrt(2) F/C_0 + M/M_0 + M_a/M_a0)",
          lambda d: f"{KINDS['linear guide'].source}; ratings: {d.guide.source}",
          "the joint's wrench, or static_rating, static_moment, static_roll of the guide",
          applies=_guided, endless="no load"),
]
# fmt: on


# ----------------------------------------------------------------------------- drive and load


def _only_rated(d: Candidates) -> bool:
    """Whether there are only a rating's postures, of which no frequencies are demanded."""
    return d.case.swung == 0.0


def _resonance(d: Candidates) -> Value:
    with np.errstate(divide="ignore"):
        return resonance(d.gear.stiffness, number(d.case.swung or d.case.load_inertia))


def _back_driving(d: Candidates) -> Criterion:
    candidate, wanted = d.candidate, d.conditions.back_driving
    name, formula = "back-driving", "eta_b > 0: a large enough load moves the motor"
    source = "Harmonic Drive: do not rely on the back-driving torque to hold a load"
    effort = candidate.back_driving_torque
    unit = "N" if candidate.linear else "N m"
    note = "" if effort is None else f"the load moves the motor above {effort:.3g} {unit}"
    transmission = candidate.transmission
    known = transmission is not None and (not candidate.at_output or effort is not None)
    if wanted == "any" or not known:
        status = Status.NOT_REQUIRED if wanted == "any" else Status.NOT_CHECKED
        text = note or ("" if wanted == "any" else "no value (losses when the load drives)")
        return Criterion(name, status, None, None, "", None, formula, source, text)
    said = stated(d.conditions, "back_driving")
    assert transmission is not None
    back = driven_efficiency(transmission)
    if wanted == "required":
        locked = "self-locking" if back <= 0 else note
        status = Status.PASSES if back > 0 else Status.FAILS
        return Criterion(name, status, None, None, "", back, formula, source, locked, said)
    status = Status.PASSES if back <= 0 else Status.FAILS
    text = "self-locking" if back <= 0 else "not self-locking: it needs a brake"
    formula = "eta_b <= 0: self-locking"
    return Criterion(name, status, None, None, "", -back, formula, source, text, said)


def _frequency(condition: str, hand: bool) -> Limit:
    return Limit(
        "gear resonance",
        lambda d: np.nan if _only_rated(d) else getattr(d.conditions, condition),
        _resonance,
        "Hz",
        "f = sqrt(K_1/max J_load)/(2 pi), all other joints rigid",
        "pinfric's default, as a maker's rule is quoted: 8 Hz base axes, 15 Hz hand axes",
        lambda d: _LOOPS if d.case.load_inertia is None else "stiffness",
        lambda d: "of the rated payload; demanded of a cycle only" if _only_rated(d) else "",
        stage="gear",
        condition=(condition,),
        applies=lambda d: not d.linear and d.case.hand == hand,
        optional=True,
    )


# fmt: off
JOINT_LIMITS = [
    Limit("inertia ratio", lambda d: d.load / (d.ratio**2 * d.inertia),
          lambda d: d.conditions.inertia_ratio, "",
          "max J_load / (ratio^2 (J_motor + J_gear input))",
          _PRACTICE + "; the gear's input is on the motor's side of the compliance",
          lambda d: _LOOPS if d.case.load_inertia is None else d.missing or "rotor inertia",
          stage="pair", condition=("inertia_ratio",)),
    _frequency("resonance_base", hand=False),
    _frequency("resonance_hand", hand=True),
    Limit("backlash", lambda d: d.gear.backlash, lambda d: number(d.conditions.backlash), "place",
          "backlash of the gear <= conditions.backlash", _MAKER, "backlash of the gear",
          stage="gear", condition=("backlash",),
          applies=lambda d: d.conditions.backlash is not None),
    Limit("back-driving", nothing, nothing, "", "", "", verdict=_back_driving),
]
# fmt: on

#: The table.
LIMITS: list[Limit] = [*MOTOR_LIMITS, *GEAR_LIMITS, *BEARING_LIMITS, *JOINT_LIMITS]
#: How many are not of `add_limit`.
OWN_LIMITS = len(LIMITS)


def check(candidate: Candidate, motor: MotorCycle | None, case: JointCase) -> tuple[Criterion, ...]:
    """Return every criterion of a drive, in the order of the table.

    Args:
        motor: of `motor_cycle`; None where figures for the motor's torque are missing.
    """
    return criteria(read_drive(candidate, motor, case))


def criteria(d: Candidates) -> tuple[Criterion, ...]:
    """Return every criterion of one drive, in the order of the table."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return tuple(limit.judge(d) for limit in LIMITS if limit.concerns(d))


def instant_limits() -> tuple[Limit, ...]:
    """Return the rows that bound every instant of a motion, in the order of the table."""
    over_time = ("motor RMS torque",)
    return tuple(
        limit for limit in LIMITS if isinstance(limit.need, str) and limit.need not in over_time
    )


def add_limit(limit: Limit) -> None:
    """Add a row to the table: `size`, `sweep` and `retime` judge it from then on.

    Raises:
        SizingError: the name exists already; the need is not a signal; `gives` names no figure.
    """
    where = f"limit {limit.name!r}"
    if any(limit.name == other.name for other in LIMITS):
        raise SizingError(f"{where}: exists already; give another name")
    if isinstance(limit.need, str) and limit.need not in SIGNALS:
        allowed = choose_from(limit.need, list(SIGNALS))
        raise SizingError(f"{where}: need {limit.need!r}: give a function, or a signal; {allowed}")
    units = {other.unit for other in LIMITS if other.need == limit.need}
    if isinstance(limit.need, str) and units and limit.unit not in units:
        raise SizingError(
            f"{where}: unit {limit.unit!r}: {limit.need!r} is in SI: {choose_from('', list(units))}"
        )
    known = [*(f"gear.{x}" for x in GEAR_FIGURES), *(f"motor.{x}" for x in MOTOR_FIGURES)]
    if isinstance(limit.gives, str) and limit.gives not in known:
        raise SizingError(
            f"{where}: gives {limit.gives!r}: give a function, or {choose_from(limit.gives, known)}"
        )
    LIMITS.append(limit)
