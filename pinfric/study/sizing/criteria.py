"""The criteria a drive must meet, each with its margin, formula and source.

A criterion compares something required with something available; its margin is the part of the
limit that is left,

    margin = 1 - required/available,

0.25: a quarter is left; negative: it fails. A criterion whose figure is missing is *not checked*
and says which figure it lacks.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from pinfric.model.described import described, quantity
from pinfric.model.springs import softest
from pinfric.model.transmission import driven_efficiency
from pinfric.study.sizing.bearing import (
    BALL,
    KINDS,
    BearingLoad,
    BearingRatings,
    bearing_life,
    equivalent_load,
    static_load,
)
from pinfric.study.sizing.catalog import Conditions, Gear
from pinfric.study.sizing.demand import DriveCycle, GearDemand, largest
from pinfric.study.sizing.drivetrain import Candidate, MotorCycle, Ratings, too_hot
from pinfric.study.sizing.overload import overload_window
from pinfric.study.summary import rms

#: Harmonic Drive's selection procedure, as read: "Torque based dimensioning" and life.
HARMONIC = "Harmonic Drive engineering data 1021387 12/2018, p. 30"
HARMONIC_LIFE = "Harmonic Drive engineering data 1021387 12/2018, p. 32, equations 32.2, 32.3"
#: Run-away heat, or nothing available: out of every bound, and yet a number.
_LEAST_MARGIN = -1e9
#: Why a load inertia is not known.
_LOOPS = "inertia about a joint of a closed loop"
_PRACTICE = "common practice of servo drives"
#: A bus above this many times the nominal voltage is likelier a slip than a choice.
_MOST_OVERVOLTAGE = 1.5


class Status(StrEnum):
    """How a criterion ended."""

    PASSES = "passes"
    FAILS = "fails"
    NOT_CHECKED = "not checked"
    NOT_REQUIRED = "not required"


@described
class Criterion:
    """One check of one candidate."""

    name: str = quantity("what is checked", heading="criterion")
    status: Status = quantity("how it ended", heading="status")
    required: float | None = quantity("in `unit`; none where not known", heading="needs")
    available: float | None = quantity("in `unit`; none where not known", heading="has")
    unit: str = quantity("of both")
    margin: float | None = quantity(
        "1 - required/available, none where not checked", heading="margin", cell="{margin:%}"
    )
    formula: str = quantity("what was computed")
    source: str = quantity("of the rule")
    note: str = quantity("of this case; what is missing", default="")

    @property
    def scaled(self) -> bool:
        """Whether the margin says how tight the drive is.

        Back-driving has no scale; a bus voltage that passes is no tighter the nearer it is.
        """
        if self.margin is None or self.name == "back-driving":
            return False
        return self.name != "bus voltage" or self.status == Status.FAILS

    @property
    def _boundless(self) -> bool:
        """Whether it fails by more than any number: too much is asked for, or nothing is there."""
        beyond = self.margin is not None and self.margin <= _LEAST_MARGIN
        return beyond and (self.required == np.inf or (self.available or 0.0) <= 0.0)

    @property
    def shortfall(self) -> str:
        """By how much it fails or passes, of the limit; what it says where no number does."""
        if self.margin is None or (self._boundless and self.note):
            return self.note
        if self.margin <= _LEAST_MARGIN:
            return f"a factor above {-_LEAST_MARGIN:.0e}"
        share = abs(self.margin) * 100
        return f"{share:.3g} %" if share < 1000 else f"a factor of {1 - self.margin:.3g}"

    @property
    def why(self) -> str:
        """Say in words by how much it fails or passes, or what is missing."""
        if self._boundless and self.note:
            return f"{self.name}: {self.note}"  # no number says more
        if self.margin is None or self.required is None or self.available is None:
            return f"{self.name}: {self.status}" + (f": {self.note}" if self.note else "")
        tail = f"short by {self.shortfall}" if self.margin < 0 else f"{self.shortfall} in reserve"
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"{self.name}: needs {self.required:.4g}{unit}, has {self.available:.4g}{unit} ({tail})"
        )


def compare(
    name: str,
    required: float | None,
    available: float | None,
    unit: str,
    formula: str,
    source: str,
    missing: str = "",
    note: str = "",
) -> Criterion:
    """Return the criterion required <= available, or "not checked: no figure" where one is None.

    Args:
        name, unit, formula, source, note: of the criterion.
        required, available: numbers >= 0; infinite `required` fails.
        missing: the figure that is missing if one is None.
    """
    if required is None or available is None:
        text = f"no figure ({missing})" if missing else "no figure"
        return Criterion(name, Status.NOT_CHECKED, required, available, unit, None, formula, source,
                         f"{text}; {note}" if note else text)  # fmt: skip
    nothing = 0.0 if required <= 0 else -np.inf
    margin = 1 - required / available if available > 0 else nothing
    margin = max(margin, _LEAST_MARGIN)
    status = Status.PASSES if margin >= 0 else Status.FAILS
    return Criterion(name, status, required, available, unit, float(margin), formula, source, note)


class Case(NamedTuple):
    """What a joint's candidates are judged by.

    Attributes:
        demand, cycle: of the joint.
        load_inertia: largest inertia about it over the cycle, kg m^2 (kg); None: not known.
        hand: it is one of the hand axes, beyond the third joint.
        conditions: what is demanded.
        beyond: sum of J/K_1 over the joints beyond it whose gears' stiffness is known, s^2.
    """

    demand: GearDemand
    cycle: DriveCycle
    load_inertia: float | None
    hand: bool
    conditions: Conditions
    beyond: float = 0.0


def check(candidate: Candidate, motor: MotorCycle | None, case: Case) -> tuple[Criterion, ...]:
    """Return every criterion of a candidate, in the order of the report.

    Args:
        candidate: motor and gear.
        motor: of `motor_cycle`; None where figures for the motor's torque are missing.
        case: its joint.
    """
    demand, _, load_inertia, _, conditions, _ = case
    units = dict(zip(("N m", "rad/s"), candidate.units, strict=True))  # N, m/s of a linear motor
    of_motor = _motor_criteria(candidate, motor, conditions)
    return (
        *(
            c if units.get(c.unit, c.unit) == c.unit else replace(c, unit=units[c.unit])
            for c in of_motor
        ),
        *_gear_criteria(candidate.gear, candidate.ratio, demand, conditions),
        *_bearing_criteria(candidate, demand.bearing, conditions),
        _inertia_ratio(candidate, load_inertia, conditions),
        _resonance(candidate.gear, case),
        _back_driving(candidate, conditions),
    )


def _motor_criteria(
    candidate: Candidate, motor: MotorCycle | None, conditions: Conditions
) -> list[Criterion]:
    ratings = candidate.ratings
    lacking = ", ".join(candidate.missing)
    output = " at its output" if candidate.at_output else " at its shaft"
    speed = None if motor is None else motor.figures.max_speed
    factor = conditions.peak_factor
    continuous, _ = ratings.continuous_at(conditions, _mean_speed(motor))
    return [
        compare(
            "continuous torque", None if motor is None else motor.figures.rms, continuous, "N m",
            "sqrt(1/T int T_m^2 dt) <= continuous torque" + output, _PRACTICE,
            lacking or "continuous torque", _continuous_note(ratings, motor, conditions),
        ),
        *_overload(ratings, motor, conditions, lacking, output),
        compare(
            "peak torque", None if motor is None else factor * motor.figures.peak,
            ratings.peak_torque,
            "N m", f"{factor:g} max |T_m| <= peak torque" + output, _PRACTICE + ": 20 to 30 %",
            lacking or "peak torque",
        ),
        _bus_voltage(ratings, conditions),
        _line(ratings, motor, conditions, lacking),
        _speed(ratings, speed, conditions, lacking),
        _temperature(ratings, motor, conditions, lacking),
    ]  # fmt: skip


def _continuous_note(ratings: Ratings, motor: MotorCycle | None, conditions: Conditions) -> str:
    """Say how the rating was found, and when a stop exceeds it: it assumes that the rotor turns."""
    limit, derated = ratings.continuous_at(conditions, _mean_speed(motor))
    notes = [derated] if derated else []
    if ratings.continuous_curve is not None:
        notes.append(f"of the maker's curve at the mean speed, {_mean_speed(motor):.4g} rad/s")
    notes += [text for text in ratings.derived if text.startswith("continuous")]
    standing = None if motor is None else motor.figures.standing
    if standing is not None and limit and standing > (ratings.continuous_stall_torque or limit):
        notes.append(
            f"standing still it takes up to {standing:.3g} N m, above the continuous torque: a "
            "stalled motor has hot spots that the mean does not show (overloaded standstill)"
        )
    return "; ".join(notes)


def _mean_speed(motor: MotorCycle | None) -> float:
    return 0.0 if motor is None else motor.figures.mean_speed


def _overload(
    ratings: Ratings, motor: MotorCycle | None, conditions: Conditions, lacking: str, output: str
) -> list[Criterion]:
    """What the mean over the cycle hides: overload for a while, and at a standstill."""
    continuous, derated = ratings.continuous_at(conditions, _mean_speed(motor))
    of = "continuous" if ratings.continuous_stall_torque is None else "continuous stall"
    window, source = overload_window(ratings.thermal, conditions)
    figures = None if motor is None else motor.figures
    missing = lacking or "continuous torque"
    still = None if figures is None else figures.overloaded_standstill
    return [
        compare(
            "short-term torque", None if figures is None else figures.short_term, continuous, "N m",
            f"max of sqrt(1/w int T_m^2 dt) over any w = {window:.3g} s <= continuous torque"
            + output, source, missing, derated,
        ),
        compare(
            "overloaded standstill", still, window, "s",
            f"longest standstill with |T_m| > {of} torque <= {window:.3g} s", source, missing,
            "it never ends" if still == np.inf else "",
        ),
    ]  # fmt: skip


def _bus_voltage(ratings: Ratings, conditions: Conditions) -> Criterion:
    """A motor far below the bus voltage is likelier a wrong entry, and its insulation unproven."""
    nominal = ratings.nominal_voltage
    most = None if nominal is None else _MOST_OVERVOLTAGE * nominal
    return compare("bus voltage", conditions.bus_voltage, most, "V",
                   f"bus voltage <= {_MOST_OVERVOLTAGE:g} nominal voltage",
                   "pinfric: question of a motor on a bus it was not made for", "nominal voltage",
                   "" if nominal is None else f"made for {nominal:g} V")  # fmt: skip


def _line(
    ratings: Ratings, motor: MotorCycle | None, conditions: Conditions, lacking: str
) -> Criterion:
    needed, formula = None, "max |R(T_w) T_m/k + k omega| <= bus voltage"
    if ratings.torque_constant is None or ratings.resistance is None:
        formula = "U_n max |T_m/T_stall + omega/omega_no-load| <= bus voltage"
    if motor is not None and ratings.has_line:
        ends = (ratings.voltage(end, motor.speed, motor.figures.hot)
                for end in (motor.torque_lower, motor.torque_upper))  # fmt: skip
        needed = max(largest(end) for end in ends)
    return compare(
        "speed-torque line", needed, conditions.bus_voltage, "V", formula,
        "equivalent circuit of a DC or field-oriented motor",
        lacking or "torque constant and resistance, or no-load speed and stall torque",
        "; ".join(text for text in ratings.derived if not text.startswith("continuous")),
    )  # fmt: skip


def _speed(
    ratings: Ratings, speed: float | None, conditions: Conditions, lacking: str
) -> Criterion:
    limit, note = ratings.speed_limit(conditions.bus_voltage)
    return compare("motor speed", speed, limit, "rad/s", "max |omega| <= maximum speed",
                   "maker's figures", lacking or "maximum speed", note)  # fmt: skip


def _temperature(
    ratings: Ratings, motor: MotorCycle | None, conditions: Conditions, lacking: str
) -> Criterion:
    name, formula = "winding temperature", "settled cycle of the two-node model: max T_w - T_a"
    source = "maxon, Key information: thermal behaviour (two nodes), copper +0.39 %/K"
    limit = None if ratings.thermal is None else ratings.max_winding(conditions)
    rise = None if limit is None else limit - conditions.ambient
    if limit is not None and rise is not None and rise <= 0:
        return Criterion(name, Status.FAILS, 0.0, rise, "K", _LEAST_MARGIN, formula, source,
                         too_hot(conditions.ambient, limit))  # fmt: skip
    figures = None if motor is None else motor.figures
    if figures is None or figures.mean_temperature is None:
        missing = lacking or "thermal resistances, torque constant and resistance"
        return compare(name, None, rise, "K", formula, source, missing)
    # whatever the limit, and without one
    if np.isinf(max(figures.mean_temperature, figures.peak_temperature or 0.0)):
        text = "runs away: the heat grows faster with temperature than it is led off"
        return Criterion(name, Status.FAILS, np.inf, rise, "K", _LEAST_MARGIN, formula, source,
                         text)  # fmt: skip
    peak = figures.peak_temperature
    if peak is not None:
        note = f"reaches {peak:.4g} C" if np.isfinite(peak) else "runs away"
        return compare(name, peak - conditions.ambient, rise, "K", formula, source,
                       "permissible winding temperature", note)  # fmt: skip
    at_mean = figures.mean_temperature - conditions.ambient
    if rise is not None and at_mean > rise:  # the peak is at least the temperature of the mean heat
        return compare(name, at_mean, rise, "K", "temperature at the mean heat: T_w - T_a", source)
    return compare(name, None, rise, "K", formula, source, "thermal time constants",
                   f"at the mean heat it would be {figures.mean_temperature:.4g} C")  # fmt: skip


def _gear_criteria(
    gear: Gear | None, ratio: float, demand: GearDemand, conditions: Conditions
) -> list[Criterion]:
    if gear is None:
        return []
    unit = demand.unit
    collision = conditions.collision_effort.get(demand.name)
    no_collision = (
        "momentary peak" if gear.momentary_peak_torque is None else "conditions.collision_effort"
    )
    return [
        compare("gear average torque", demand.mean_cubic, gear.average_torque, unit,
                "T_av = cbrt(int |v T^3| dt/int |v| dt) <= limit for average torque",
                HARMONIC, "limit for average torque"),
        compare("gear repeated peak torque", demand.peak, gear.repeated_peak_torque, unit,
                "max |T| <= limit for repeated peak torque", HARMONIC,
                "limit for repeated peak torque"),
        compare("gear momentary peak torque", collision, gear.momentary_peak_torque, unit,
                "collision or emergency stop <= limit for momentary peak torque",
                HARMONIC, no_collision),
        *_collisions(gear, ratio * demand.speed, conditions),
        compare("gear maximum input speed", ratio * demand.speed, gear.max_input_speed, "rad/s",
                "ratio max |v| <= maximum input speed", HARMONIC,
                "maximum input speed"),
        compare("gear average input speed", ratio * demand.mean_speed, gear.average_input_speed,
                "rad/s", "ratio 1/T int |v| dt <= limit for average input speed",
                HARMONIC, "limit for average input speed"),
        _life(gear, ratio, demand, conditions),
        *([compare("stroke", demand.travel, gear.stroke, "m", "max q - min q <= stroke",
                   "maker's figures", "stroke")] if gear.output == "linear" else []),
    ]  # fmt: skip


def _collisions(gear: Gear, speed: float, conditions: Conditions) -> list[Criterion]:
    """How often the momentary peak torque is borne; nothing where no number is demanded."""
    wanted = conditions.collisions
    if wanted is None:
        return []
    formula, source = "collisions <= N", "maker's number"
    borne = gear.momentary_peaks
    if borne is None and gear.kind == "strain wave":
        formula = "collisions <= N = 10^4/(2 (n/60) t), n the greatest input speed in rpm"
        source = "Harmonic Drive CSF/CSG catalogue, momentary peak torque"
        borne = momentary_peaks(speed, wanted.duration)
    return [_lasting("gear momentary peaks", wanted.count, borne, "", formula, source,
                     "momentary_peaks", "the joint never moves")]  # fmt: skip


def momentary_peaks(speed: float, duration: float) -> float:
    """Return how often a strain wave gear bears its momentary peak torque, N = 1e4/(2 n t).

    Args:
        speed: of its input before, rad/s (n turns per second). duration: t of each, s.

    Source: Harmonic Drive CSF/CSG catalogue, rating of the momentary peak torque.
    """
    return 1e4 / (2 * speed / (2 * np.pi) * duration) if speed > 0 else np.inf


def _life(gear: Gear, ratio: float, demand: GearDemand, conditions: Conditions) -> Criterion:
    figures = gear.nominal_life, gear.rated_speed, gear.rated_torque
    available = None
    if None not in figures:
        available = gear_life(*figures, ratio * demand.mean_speed, demand.mean_cubic)[0]  # type: ignore[arg-type]
    formula = "L10 = L50/5, L50 = L_n (n_N/n_in,av)(T_N/T_av)^3"
    return _lasting("gear life L10", conditions.life, available, "h", formula, HARMONIC_LIFE,
                    "nominal life, rated speed or rated torque",
                    "the joint never moves")  # fmt: skip


def _bearing_criteria(
    candidate: Candidate, load: BearingLoad | None, conditions: Conditions
) -> list[Criterion]:
    """Loads and life of what carries the joint, against its maker's ratings."""
    ratings, what = candidate.bearing, "screw" if candidate.linear else "bearing"
    if candidate.linear and (candidate.gear is None or "screw" not in candidate.gear.kind):
        return []  # belts and linear motors have none
    if ratings is None:
        return [compare(f"{what} loads", None, None, "", "loads and life by its ratings",
                        KINDS["ball screw" if candidate.linear else "crossed roller"].source,
                        f"ratings of the {what}")]  # fmt: skip
    source = _rule(ratings)
    unknown = "" if load else "the joint's wrench"
    axial = compare(
        f"{what} axial force", load and load.axial, ratings.max_axial, "N",
        "max |F_a| <= permissible axial force", source, unknown or "permissible axial force",
    )  # fmt: skip
    safety = _static_safety(what, ratings, load, source)
    life = _bearing_life(what, candidate, ratings, load, conditions)
    if ratings.screw:
        return [axial, safety, life]
    return [
        compare(f"{what} tilting moment", load and load.moment + ratings.offset * load.radial,
                ratings.max_moment, "N m", "max M + R max F_r <= permissible tilting moment",
                source, unknown or "permissible tilting moment"),
        compare(f"{what} radial force", load and load.radial, ratings.max_radial, "N",
                "max |F_r| <= permissible radial force", source,
                unknown or "permissible radial force"),
        axial, safety, life,
    ]  # fmt: skip


def _rule(ratings: BearingRatings) -> str:
    """Where the rule is from, and the ratings, where they are from elsewhere."""
    rule = KINDS[ratings.kind].source
    return f"{rule}; ratings: {ratings.source}" if ratings.source else rule


def _static_safety(
    what: str, ratings: BearingRatings, load: BearingLoad | None, source: str
) -> Criterion:  # fmt: skip
    carried, available = load and static_load(ratings, load), None
    if carried is not None and ratings.static_rating is not None:
        available = ratings.static_rating / carried if carried > 0 else np.inf
    formula = "f_s = C_0/P_0"
    if ratings.rule is not None and not ratings.screw:
        x, y = ratings.rule.static
        formula += f", P_0 = {x:g} P_r + {y:g} F_a"
    return _lasting(f"{what} static safety", ratings.static_safety, available, "", formula, source,
                    "static load rating C_0 or pitch diameter", "nothing loads it")  # fmt: skip


def _bearing_life(
    what: str, candidate: Candidate, ratings: BearingRatings, load: BearingLoad | None,
    conditions: Conditions,
) -> Criterion:  # fmt: skip
    kind, available = KINDS[ratings.kind], None
    exponent = "3" if kind.exponent == BALL else "10/3"
    equivalent = load and equivalent_load(ratings, load)
    if load is not None and equivalent is not None and ratings.dynamic_rating is not None:
        speed = load.speed * (candidate.ratio if ratings.screw else 1.0)
        available = bearing_life(ratings.dynamic_rating, conditions.shock * equivalent, speed,
                                 kind.exponent)  # fmt: skip
    note = "" if equivalent is None else f"P = {equivalent:.4g} N"
    return _lasting(f"{what} life L10", conditions.life, available, "h",
                    f"L10 = 10^6 revolutions (C/({conditions.shock:g} P))^({exponent})",
                    _rule(ratings), "dynamic load rating C or pitch diameter",
                    "it never turns under load", note)  # fmt: skip


def _lasting(
    name: str, required: float, available: float | None, unit: str, formula: str, source: str,
    missing: str, endless: str, note: str = "",
) -> Criterion:  # fmt: skip
    """`compare` for what may be endless: then it passes without a number, and says why."""
    if available is not None and np.isinf(available):
        return Criterion(name, Status.PASSES, required, None, unit, 1.0, formula, source, endless)
    return compare(name, required, available, unit, formula, source, missing, note)


def _inertia_ratio(
    candidate: Candidate, load_inertia: float | None, conditions: Conditions
) -> Criterion:
    """Load to motor side, max J_load/(ratio^2 (J_motor + J_gear input)).

    The gear's input (a wave generator) counts with the rotor: it sits on the motor's side of the
    compliance, across which load and motor swing; the rule bounds how unlike they may be.
    """
    inertia, ratio = candidate.rotor_inertia, None
    missing = ", ".join(candidate.missing) or "rotor inertia"
    if load_inertia is None:
        missing = _LOOPS
    elif inertia is not None:
        ratio = load_inertia / (candidate.ratio**2 * inertia)
    return compare("inertia ratio", ratio, conditions.inertia_ratio, "",
                   "max J_load / (ratio^2 (J_motor + J_gear input))",
                   _PRACTICE + "; the gear's input is on the motor's side of the compliance",
                   missing)  # fmt: skip


def _resonance(gear: Gear | None, case: Case) -> Criterion:
    """The joint and those beyond it swing, those nearer the base stand: Dunkerley's lower bound.

    The maker's rule takes the other joints as rigid, which is an upper bound.
    """
    conditions, inertia = case.conditions, case.load_inertia
    required = conditions.resonance_hand if case.hand else conditions.resonance_base
    available, note = None, ""
    if gear is not None and gear.stiffness is not None and inertia is not None:
        stiffness = softest(gear.stiffness)
        swing = inertia / stiffness + case.beyond
        available = resonance(1.0, swing) if swing > 0 else np.inf
        if case.beyond > 0 and inertia > 0:
            alone = resonance(stiffness, inertia)
            note = f"lower bound (Dunkerley); with all other joints rigid {alone:.3g} Hz"
    return compare(
        "gear resonance",
        required,
        available,
        "Hz",
        "f = 1/(2 pi sqrt(sum of max J_load/K_1 over this joint and those beyond))",
        "rule of a maker of strain wave gears: 8 Hz base axes, 15 Hz hand axes (retyped)",
        _LOOPS if inertia is None else "stiffness",
        note,
    )


def _back_driving(candidate: Candidate, conditions: Conditions) -> Criterion:
    wanted = conditions.back_driving
    name, formula = "back-driving", "eta_b > 0: the load moves the motor from some effort on"
    source = "Harmonic Drive: back-driving torque must not be counted on to hold a load"
    effort = candidate.back_driving_torque
    unit = "N" if candidate.linear else "N m"
    note = "" if effort is None else f"the load moves the motor from {effort:.3g} {unit} on"
    transmission = candidate.transmission
    known = transmission is not None and (not candidate.at_output or effort is not None)
    if wanted == "any" or not known:
        status = Status.NOT_REQUIRED if wanted == "any" else Status.NOT_CHECKED
        text = note or ("" if wanted == "any" else "no figure (losses backwards)")
        return Criterion(name, status, None, None, "", None, formula, source, text)
    assert transmission is not None
    back = driven_efficiency(transmission)
    if wanted == "required":
        locked = "self-locking" if back <= 0 else note
        status = Status.PASSES if back > 0 else Status.FAILS
        return Criterion(name, status, None, None, "", back, formula, source, locked)
    status = Status.PASSES if back <= 0 else Status.FAILS
    text = "self-locking" if back <= 0 else "not self-locking: it needs a brake"
    return Criterion(name, status, None, None, "", -back, "eta_b <= 0: self-locking", source, text)


def gear_life(
    nominal_life: float,
    rated_speed: float,
    rated_torque: float,
    average_input_speed: float,
    average_torque: float,
) -> tuple[float, float]:
    """Return (L10, L50) of a strain wave gear's wave generator bearing, in hours.

    L50 = L_n (n_N/n_in,av)(T_N/T_av)^3, L10 = L50/5; infinite where nothing turns or loads.

    Args:
        nominal_life: L_n, h (L50 at rated torque and speed).
        rated_speed, average_input_speed: n_N and n_in,av, rad/s; pauses count in the average.
        rated_torque, average_torque: T_N and T_av, N m at the output.

    Source: Harmonic Drive engineering data 1021387 12/2018, p. 32, equations 32.2, 32.3.
    """
    if not (average_input_speed > 0 and average_torque > 0):
        return np.inf, np.inf
    l50 = nominal_life * rated_speed / average_input_speed * (rated_torque / average_torque) ** 3
    return l50 / 5, l50


def resonance(stiffness: float, inertia: float) -> float:
    """Return f = sqrt(K/J)/(2 pi), Hz, of a load J (kg m^2) behind a gear K (N m/rad)."""
    return float(np.sqrt(stiffness / inertia) / (2 * np.pi))


def optimum_ratio(cycle: DriveCycle, effort: np.ndarray, rotor_inertia: float) -> float:
    """Return the ratio of least RMS motor torque: r^2 = rms(T*)/(J_rotor rms(a)).

    From T_m,rms^2 = rms(T*)^2/r^2 + 2 J mean(T* a) + r^2 J^2 rms(a)^2, gear losses left out;
    infinite where the joint never accelerates.

    Args:
        cycle: the joint's samples.
        effort: (T,) T*, N m. rotor_inertia: J at the motor's shaft, kg m^2.

    Source: Giberti, Cinquemani, Legnani: choice of motor and ratio by accelerating factor.
    """
    moving = rms(cycle.stretched, cycle.acceleration)
    inertial = rotor_inertia * moving  # a product of two positive numbers may still be 0
    return float(np.sqrt(rms(cycle.stretched, effort) / inertial)) if inertial > 0 else np.inf


def load_factor(cycle: DriveCycle, effort: np.ndarray) -> float:
    """Return beta = 2 (rms(a) rms(T*) + mean(a T*)), W/s: what the load asks of T_N^2/J_rotor.

    A motor can do it with some ratio if its accelerating factor T_N^2/J_rotor >= beta/eta.

    Args:
        cycle: the joint's samples.
        effort: (T,) T*, N m.

    Source: Giberti, Cinquemani, Legnani: choice of motor and ratio by accelerating factor.
    """
    a, t = cycle.acceleration, cycle.stretched
    mixed = float(np.trapezoid(a * effort, t) / (t[-1] - t[0]))
    return 2 * (rms(t, a) * rms(t, effort) + mixed)
