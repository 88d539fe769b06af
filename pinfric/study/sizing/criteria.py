"""The one table of what limits a drive: `size`, `sweep` and `retime` read it.

A row says what a cycle needs, what the maker gives (in order of preference: a lower limit that is
printed stands in for one that is not), the formula and its source. What a missing figure means is
in the row, too: a row is *not checked* without it, and a drive of which nothing settles one of the
`SETTLES` *cannot be judged*.

`size` takes the needs of a whole cycle, `sweep` those of every sample of its own, `retime` bounds
each instant of a motion by the rows whose need is one of `SIGNALS`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pinfric.model.springs import softest
from pinfric.model.transmission import driven_efficiency
from pinfric.study.sizing.bearing import (
    BALL,
    KINDS,
    BearingRatings,
    bearing_life,
    equivalent_load,
    static_load,
)
from pinfric.study.sizing.catalog import Conditions, Gear
from pinfric.study.sizing.criterion import Criterion, Status, compare
from pinfric.study.sizing.demand import DriveCycle, GearDemand, largest
from pinfric.study.sizing.drivetrain import Candidate, MotorCycle, MotorFigures, Ratings, too_hot
from pinfric.study.sizing.overload import overload_window
from pinfric.study.sizing.rules import gear_life, momentary_peaks, resonance

#: Harmonic Drive's selection procedure, as read: "Torque based dimensioning" and life.
_HARMONIC = "Harmonic Drive engineering data 1021387 12/2018, p. 30"
_PRACTICE = "common practice of servo drives"
_STATED = "motor file, or the URDF: retiming alone knows it"
#: Why a load inertia is not known.
_LOOPS = "inertia about a joint of a closed loop"
#: A bus above this many times the nominal voltage is likelier a slip than a choice.
_MOST_OVERVOLTAGE = 1.5


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


def idle(conditions: Conditions, hand: bool = False) -> Case:
    """Return the case of a joint that does nothing: what its drive must have is seen without."""
    nothing, still = np.zeros(2), np.ones(2, dtype=bool)
    cycle = DriveCycle(
        np.arange(2.0), nothing, nothing, nothing, nothing, nothing, still, still, 0.0
    )
    demand = GearDemand("", "", 0.0, 0.0, 0.0, 0.0, bearing=None, travel=0.0)
    return Case(demand, cycle, None, hand, conditions)


class Judged(NamedTuple):
    """A candidate and what it is judged by.

    Attributes:
        candidate: motor and gear.
        motor: what the cycle asks of its motor; None where figures for its torque are missing.
        case: its joint.
    """

    candidate: Candidate
    motor: MotorCycle | None
    case: Case

    @property
    def ratings(self) -> Ratings:
        """Of the rated shaft."""
        return self.candidate.ratings

    @property
    def conditions(self) -> Conditions:
        """What is demanded."""
        return self.case.conditions

    @property
    def demand(self) -> GearDemand:
        """Of the joint."""
        return self.case.demand

    @property
    def gear(self) -> Gear:
        """The gear's entry; rows of gears are for candidates that have one."""
        assert self.candidate.gear is not None
        return self.candidate.gear

    @property
    def bearing(self) -> BearingRatings:
        """What carries the joint; rows of bearings are for candidates whose ratings are known."""
        assert self.candidate.bearing is not None
        return self.candidate.bearing

    @property
    def figures(self) -> MotorFigures | None:
        """What the cycle asks of the motor, or None."""
        return None if self.motor is None else self.motor.figures

    @property
    def mean_speed(self) -> float:
        """Of the rated shaft, rad/s; infinite where not known: a curve's last point counts."""
        return np.inf if self.figures is None else self.figures.mean_speed

    @property
    def missing(self) -> str:
        """The figures that the motor's torque lacks, in words."""
        return ", ".join(self.candidate.missing)

    @property
    def output(self) -> str:
        """Where the motor is rated, in words."""
        return " at its output" if self.candidate.at_output else " at its shaft"


def _asked(figure: str) -> Callable[[Judged], float | None]:
    """A figure of what the cycle asks of the motor."""
    return lambda d: None if d.figures is None else getattr(d.figures, figure)


def _line_voltage(d: Judged) -> float | None:
    if d.motor is None or not d.ratings.has_line:
        return None
    hot = d.motor.figures.hot
    torques = d.motor.torque_lower, d.motor.torque_upper
    return max(largest(d.ratings.voltage(torque, d.motor.speed, hot)) for torque in torques)


#: What a sample of a motion asks, by name: the same need over a cycle, of `Judged`. The motor's are
#: at the rated shaft.
SIGNALS: dict[str, Callable[[Judged], float | None]] = {
    "motor torque": _asked("peak"),
    "motor RMS torque": _asked("rms"),
    "motor speed": _asked("max_speed"),
    "voltage": _line_voltage,
    "effort": lambda d: d.demand.peak,
    "input speed": lambda d: d.candidate.ratio * d.demand.speed,
    "speed": lambda d: d.demand.speed,
    "acceleration": lambda d: largest(d.case.cycle.acceleration),
}
#: What must be settled of a drive before it is offered: of the rows that settle the same thing at
#: least one must have been checked, or the drive cannot be judged.
SETTLES = ("heat", "motor's peak", "motor's speed", "gear's load", "gear's speed")
#: Of a screw the nut's ratings settle the load, too.
_LOAD_OF_A_SCREW = ("gear's load",)

Figure = Callable[[Judged], float | None]
Text = str | Callable[[Judged], str]


def _always(_: Judged) -> bool:
    return True


def _never(_: Judged) -> bool:
    return False


def _nothing(_: Judged) -> float | None:
    return None


def _one(_: Conditions) -> float:
    return 1.0


@dataclass(frozen=True)
class Limit:
    """One limit of drives.

    Attributes:
        name: as reports, sweeps and retiming print it.
        need: what the cycle asks: one of `SIGNALS`, which `retime` bounds at every instant, or a
            function of the whole cycle; None where it is not known.
        gives: figures of the candidate, `ratings.`, `gear.` or `bearing.` before an entry's key, in
            order of preference; or a function; None where it is not known.
        formula, source: of the comparison. unit: of both sides; `torque` and `speed` are the rated
            shaft's, `effort` the joint's.
        missing: the figure that is missing if one is. note: of this case.
        reserve: factor on the need.
        applies: to which candidates; to others it says nothing.
        endless: what is said where an infinite figure is available; it passes without a number.
        settles: what of the drive it settles, of `SETTLES`.
        key: the key of a motor file that gives it by number; empty: none does.
        verdict: in place of the comparison, where there are no two numbers.
    """

    name: str
    need: str | Figure
    gives: tuple[str, ...] | Figure
    unit: str
    formula: Text
    source: Text
    missing: Text = ""
    note: Text = ""
    reserve: Callable[[Conditions], float] = _one
    applies: Callable[[Judged], bool] = _always
    endless: str = ""
    settles: tuple[str, ...] = ()
    key: str = ""
    verdict: Callable[[Judged], Criterion] | None = None

    def required(self, d: Judged) -> float | None:
        """Return what the cycle asks, its reserve included; None where it is not known."""
        need = (SIGNALS[self.need] if isinstance(self.need, str) else self.need)(d)
        return None if need is None else self.reserve(d.conditions) * need

    def available(self, d: Judged) -> tuple[float | None, str]:
        """Return what the maker gives, or None, and which figure stands in for the first one."""
        if not isinstance(self.gives, tuple):
            return self.gives(d), ""
        for place, path in enumerate(self.gives):
            part, _, figure = path.partition(".")
            value = getattr(getattr(d, part), figure)
            if value is not None:
                words = figure.replace("_", " ")
                return value, f"the {words}: no higher limit is known" if place else ""
        return None, ""

    def bound(self, d: Judged) -> float:
        """Return the greatest need that is within the limit; infinite where there is none."""
        available = self.available(d)[0] if self.applies(d) else None
        return np.inf if available is None else available / self.reserve(d.conditions)

    def judge(self, d: Judged) -> Criterion:
        """Return how a candidate does."""
        if self.verdict is not None:
            return self.verdict(d)
        found, stand_in = self.available(d)
        texts = (self.formula, self.source, self.missing, self.note)
        formula, source, missing, note = (x if isinstance(x, str) else x(d) for x in texts)
        torque, speed = d.candidate.units
        unit = {"torque": torque, "speed": speed, "effort": d.demand.unit}.get(self.unit, self.unit)
        required = self.required(d)
        if self.endless and found is not None and np.isinf(found):
            passes = Status.PASSES
            return Criterion(
                self.name, passes, required, None, unit, 1.0, formula, source, self.endless
            )
        note = "; ".join(text for text in (note, stand_in) if text)
        return compare(self.name, required, found, unit, formula, source, missing, note)


def check(candidate: Candidate, motor: MotorCycle | None, case: Case) -> tuple[Criterion, ...]:
    """Return every criterion of a candidate, in the order of the table.

    Args:
        candidate: motor and gear.
        motor: of `motor_cycle`; None where figures for the motor's torque are missing.
        case: its joint.
    """
    judged = Judged(candidate, motor, case)
    return tuple(limit.judge(judged) for limit in LIMITS if limit.applies(judged))


def missing_figures(criteria: Sequence[Criterion]) -> tuple[str, ...]:
    """Return why a drive cannot be judged: what of `SETTLES` no figure settles, and what lacks.

    Args:
        criteria: of `check`.
    """
    unchecked = {c.name: c for c in criteria if c.status == Status.NOT_CHECKED}
    names, reasons = {c.name for c in criteria}, []
    for thing in SETTLES:
        rows = [limit.name for limit in LIMITS if thing in limit.settles and limit.name in names]
        if rows and all(name in unchecked for name in rows):
            lacks = " or ".join(f"{name}: {unchecked[name].note}" for name in rows)
            reasons.append(f"cannot be judged by its {thing.replace(chr(39) + 's', '')}: {lacks}")
    return tuple(reasons)


def instant_limits() -> tuple[Limit, ...]:
    """Return the rows that bound every instant of a motion, in the order of the table."""
    over_time = ("motor RMS torque",)
    return tuple(
        limit for limit in LIMITS if isinstance(limit.need, str) and limit.need not in over_time
    )


def add_limit(limit: Limit) -> None:
    """Add a row to the table: `size`, `sweep` and `retime` judge it from then on.

    Raises:
        ValueError: there is one of its name.
    """
    if any(limit.name == other.name for other in LIMITS):
        raise ValueError(f"there is a limit {limit.name!r} already; give another name")
    LIMITS.append(limit)


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
    standing = None if figures is None else figures.standing
    if standing is not None and limit and standing > (ratings.continuous_stall_torque or limit):
        notes.append(
            f"standing still it takes up to {standing:.3g} N m, above the continuous torque: a "
            "stalled motor has hot spots that the mean does not show (overloaded standstill)"
        )
    return "; ".join(notes)


def _window(d: Judged) -> tuple[float, str]:
    return overload_window(d.ratings.thermal, d.conditions)


def _standing_formula(d: Judged) -> str:
    of = "continuous" if d.ratings.continuous_stall_torque is None else "continuous stall"
    return f"longest standstill with |T_m| > {of} torque <= {_window(d)[0]:.3g} s"


def _standing_note(d: Judged) -> str:
    still = d.figures and d.figures.overloaded_standstill
    return "it never ends" if still == np.inf else ""


def _most_voltage(d: Judged) -> float | None:
    nominal = d.ratings.nominal_voltage
    return None if nominal is None else _MOST_OVERVOLTAGE * nominal


def _made_for(d: Judged) -> str:
    nominal = d.ratings.nominal_voltage
    return "" if nominal is None else f"made for {nominal:g} V"


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


def _winding_missing(d: Judged) -> str:
    figures = d.figures
    if figures is None or figures.mean_temperature is None:
        return d.missing or "thermal resistances, torque constant and resistance"
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
        return f"at the mean heat it would be {figures.mean_temperature:.4g} C"
    if np.isinf(rise):
        return "runs away: the heat grows faster with temperature than it is led off"
    return "" if figures.peak_temperature is None else f"reaches {figures.peak_temperature:.4g} C"


def _has_gear(d: Judged) -> bool:
    return d.candidate.gear is not None


def _collision(d: Judged) -> float | None:
    return d.conditions.collision_effort.get(d.demand.name)


def _no_collision(d: Judged) -> str:
    unknown = d.gear.momentary_peak_torque is None
    return "momentary peak" if unknown else "conditions.collision_effort"


def _collisions(d: Judged) -> float | None:
    return None if d.conditions.collisions is None else d.conditions.collisions.count


def _by_rule(d: Judged) -> bool:
    """Whether the number of momentary peaks follows from the maker's rule, not from a figure."""
    return d.gear.momentary_peaks is None and d.gear.kind == "strain wave"


def _momentary_peaks(d: Judged) -> float | None:
    wanted = d.conditions.collisions
    if wanted is None or not _by_rule(d):
        return d.gear.momentary_peaks
    return momentary_peaks(d.candidate.ratio * d.demand.speed, wanted.duration)


def _gear_life(d: Judged) -> float | None:
    life, speed, torque = d.gear.nominal_life, d.gear.rated_speed, d.gear.rated_torque
    if life is None or speed is None or torque is None:
        return None
    mean_speed = d.candidate.ratio * d.demand.mean_speed
    return gear_life(life, speed, torque, mean_speed, d.demand.mean_cubic)[0]


def _turning(d: Judged) -> bool:
    """Whether a bearing carries the joint."""
    return not d.candidate.linear


def _nut(d: Judged) -> bool:
    """Whether a screw's nut carries the joint; belts and linear motors have none."""
    candidate = d.candidate
    return candidate.linear and candidate.gear is not None and "screw" in candidate.gear.kind


def _rule(d: Judged) -> str:
    """Where the rule is from, and the ratings, where they are from elsewhere."""
    rule = KINDS[d.bearing.kind].source
    return f"{rule}; ratings: {d.bearing.source}" if d.bearing.source else rule


def _of_bearing(words: str) -> Text:
    return lambda d: words if d.demand.bearing else "the joint's wrench"


def _tilting(d: Judged) -> float | None:
    load = d.demand.bearing
    return load and load.moment + d.bearing.offset * load.radial


def _static_safety(d: Judged) -> float | None:
    carried = d.demand.bearing and static_load(d.bearing, d.demand.bearing)
    if carried is None or d.bearing.static_rating is None:
        return None
    return d.bearing.static_rating / carried if carried > 0 else np.inf


def _safety_formula(d: Judged) -> str:
    if d.bearing.rule is None or d.bearing.screw:
        return "f_s = C_0/P_0"
    x, y = d.bearing.rule.static
    return f"f_s = C_0/P_0, P_0 = {x:g} P_r + {y:g} F_a"


def _equivalent(d: Judged) -> float | None:
    return d.demand.bearing and equivalent_load(d.bearing, d.demand.bearing)


def _bearing_life(d: Judged) -> float | None:
    load, equivalent, rating = d.demand.bearing, _equivalent(d), d.bearing.dynamic_rating
    if load is None or equivalent is None or rating is None:
        return None
    speed = load.speed * (d.candidate.ratio if d.bearing.screw else 1.0)
    exponent = KINDS[d.bearing.kind].exponent
    return bearing_life(rating, d.conditions.shock * equivalent, speed, exponent)


def _life_formula(d: Judged) -> str:
    exponent = "3" if KINDS[d.bearing.kind].exponent == BALL else "10/3"
    return f"L10 = 10^6 revolutions (C/({d.conditions.shock:g} P))^({exponent})"


def _life_note(d: Judged) -> str:
    equivalent = _equivalent(d)
    return "" if equivalent is None else f"P = {equivalent:.4g} N"


def _inertia_ratio(d: Judged) -> float | None:
    """Load to motor side, max J_load/(ratio^2 (J_motor + J_gear input)).

    The gear's input (a wave generator) counts with the rotor: it sits on the motor's side of the
    compliance, across which load and motor swing; the rule bounds how unlike they may be.
    """
    inertia, load = d.candidate.rotor_inertia, d.case.load_inertia
    return None if inertia is None or load is None else load / (d.candidate.ratio**2 * inertia)


def _no_inertia(d: Judged) -> str:
    return _LOOPS if d.case.load_inertia is None else d.missing or "rotor inertia"


def _least_resonance(d: Judged) -> float:
    return d.conditions.resonance_hand if d.case.hand else d.conditions.resonance_base


def _stiffness(d: Judged) -> float | None:
    gear = d.candidate.gear
    return None if gear is None or gear.stiffness is None else softest(gear.stiffness)


def _resonance(d: Judged) -> float | None:
    """The joint and those beyond it swing, those nearer the base stand: Dunkerley's lower bound.

    The maker's rule takes the other joints as rigid, which is an upper bound.
    """
    stiffness, inertia = _stiffness(d), d.case.load_inertia
    if stiffness is None or inertia is None:
        return None
    swing = inertia / stiffness + d.case.beyond
    return resonance(1.0, swing) if swing > 0 else np.inf


def _resonance_note(d: Judged) -> str:
    stiffness, inertia = _stiffness(d), d.case.load_inertia
    if stiffness is None or not inertia or not d.case.beyond > 0:
        return ""
    alone = resonance(stiffness, inertia)
    return f"lower bound (Dunkerley); with all other joints rigid {alone:.3g} Hz"


def _back_driving(d: Judged) -> Criterion:
    candidate, wanted = d.candidate, d.conditions.back_driving
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


def _carrying(what: str, carried: Callable[[Judged], bool]) -> list[Limit]:
    """The rows of what carries a joint: its bearing, or a screw's nut."""

    def rated(d: Judged) -> bool:
        return carried(d) and d.candidate.bearing is not None

    turning = [
        Limit(
            "bearing tilting moment",
            need=_tilting,
            gives=("bearing.max_moment",),
            unit="N m",
            formula="max M + R max F_r <= permissible tilting moment",
            source=_rule,
            missing=_of_bearing("permissible tilting moment"),
            applies=rated,
        ),
        Limit(
            "bearing radial force",
            need=lambda d: d.demand.bearing and d.demand.bearing.radial,
            gives=("bearing.max_radial",),
            unit="N",
            formula="max |F_r| <= permissible radial force",
            source=_rule,
            missing=_of_bearing("permissible radial force"),
            applies=rated,
        ),
    ]
    return [
        Limit(
            f"{what} loads",
            need=_nothing,
            gives=_nothing,
            unit="",
            formula="loads and life by its ratings",
            source=KINDS["ball screw" if what == "screw" else "crossed roller"].source,
            missing=f"ratings of the {what}",
            applies=lambda d: carried(d) and d.candidate.bearing is None,
        ),
        *(turning if what == "bearing" else ()),
        Limit(
            f"{what} axial force",
            need=lambda d: d.demand.bearing and d.demand.bearing.axial,
            gives=("bearing.max_axial",),
            unit="N",
            formula="max |F_a| <= permissible axial force",
            source=_rule,
            missing=_of_bearing("permissible axial force"),
            applies=rated,
            settles=_LOAD_OF_A_SCREW if what == "screw" else (),
        ),
        Limit(
            f"{what} static safety",
            need=lambda d: d.bearing.static_safety,
            gives=_static_safety,
            unit="",
            formula=_safety_formula,
            source=_rule,
            missing="static load rating C_0 or pitch diameter",
            applies=rated,
            endless="nothing loads it",
            settles=_LOAD_OF_A_SCREW if what == "screw" else (),
        ),
        Limit(
            f"{what} life L10",
            need=lambda d: d.conditions.life,
            gives=_bearing_life,
            unit="h",
            formula=_life_formula,
            source=_rule,
            missing="dynamic load rating C or pitch diameter",
            note=_life_note,
            applies=rated,
            endless="it never turns under load",
        ),
    ]


#: The table.
LIMITS: list[Limit] = [
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
        need=_asked("short_term"),
        gives=_continuous,
        unit="torque",
        formula=lambda d: (
            f"max of sqrt(1/w int T_m^2 dt) over any w = {_window(d)[0]:.3g} s <= continuous torque"
            + d.output
        ),
        source=lambda d: _window(d)[1],
        missing=_of_motor("continuous torque"),
        note=lambda d: d.ratings.continuous_at(d.conditions, d.mean_speed)[1],
    ),
    Limit(
        "overloaded standstill",
        need=_asked("overloaded_standstill"),
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
        source="pinfric: question of a motor on a bus it was not made for",
        missing="nominal voltage",
        note=_made_for,
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
    ),
    Limit(
        "gear average torque",
        need=lambda d: d.demand.mean_cubic,
        gives=("gear.average_torque",),
        unit="effort",
        formula="T_av = cbrt(int |v T^3| dt/int |v| dt) <= limit for average torque",
        source=_HARMONIC,
        missing="limit for average torque",
        applies=_has_gear,
    ),
    Limit(
        "gear repeated peak torque",
        need="effort",
        gives=("gear.repeated_peak_torque", "gear.average_torque", "gear.rated_torque"),
        unit="effort",
        formula="max |T| <= limit for repeated peak torque",
        source=_HARMONIC,
        missing="limit for repeated peak torque",
        applies=_has_gear,
        settles=("gear's load",),
    ),
    Limit(
        "effort",
        need="effort",
        gives=_nothing,
        unit="effort",
        formula="max |effort| <= effort",
        source=_STATED,
        applies=_never,
        settles=("gear's load",),
        key="effort",
    ),
    Limit(
        "gear momentary peak torque",
        need=_collision,
        gives=("gear.momentary_peak_torque",),
        unit="effort",
        formula="collision or emergency stop <= limit for momentary peak torque",
        source=_HARMONIC,
        missing=_no_collision,
        applies=_has_gear,
    ),
    Limit(
        "gear momentary peaks",
        need=_collisions,
        gives=_momentary_peaks,
        unit="",
        formula=lambda d: (
            "collisions <= N = 10^4/(2 (n/60) t), n the greatest input speed in rpm"
            if _by_rule(d)
            else "collisions <= N"
        ),
        source=lambda d: (
            "Harmonic Drive CSF/CSG catalogue, momentary peak torque"
            if _by_rule(d)
            else "maker's number"
        ),
        missing="momentary_peaks",
        applies=lambda d: _has_gear(d) and d.conditions.collisions is not None,
        endless="the joint never moves",
    ),
    Limit(
        "gear maximum input speed",
        need="input speed",
        gives=("gear.max_input_speed", "gear.average_input_speed"),
        unit="rad/s",
        formula="ratio max |v| <= maximum input speed",
        source=_HARMONIC,
        missing="maximum input speed",
        applies=_has_gear,
        settles=("gear's speed",),
        key="input_speed",
    ),
    Limit(
        "joint speed",
        need="speed",
        gives=_nothing,
        unit="rad/s or m/s",
        formula="max |v| <= velocity",
        source=_STATED,
        applies=_never,
        settles=("motor's speed", "gear's speed"),
        key="velocity",
    ),
    Limit(
        "acceleration",
        need="acceleration",
        gives=_nothing,
        unit="rad/s^2 or m/s^2",
        formula="max |a| <= acceleration",
        source=_STATED,
        applies=_never,
        key="acceleration",
    ),
    Limit(
        "gear average input speed",
        need=lambda d: d.candidate.ratio * d.demand.mean_speed,
        gives=("gear.average_input_speed",),
        unit="rad/s",
        formula="ratio 1/T int |v| dt <= limit for average input speed",
        source=_HARMONIC,
        missing="limit for average input speed",
        applies=_has_gear,
    ),
    Limit(
        "gear life L10",
        need=lambda d: d.conditions.life,
        gives=_gear_life,
        unit="h",
        formula="L10 = L50/5, L50 = L_n (n_N/n_in,av)(T_N/T_av)^3",
        source="Harmonic Drive engineering data 1021387 12/2018, p. 32, equations 32.2, 32.3",
        missing="nominal life, rated speed or rated torque",
        applies=_has_gear,
        endless="the joint never moves",
    ),
    Limit(
        "stroke",
        need=lambda d: d.demand.travel,
        gives=("gear.stroke",),
        unit="m",
        formula="max q - min q <= stroke",
        source="maker's figures",
        missing="stroke",
        applies=lambda d: _has_gear(d) and d.gear.output == "linear",
    ),
    *_carrying("bearing", _turning),
    *_carrying("screw", _nut),
    Limit(
        "inertia ratio",
        need=_inertia_ratio,
        gives=lambda d: d.conditions.inertia_ratio,
        unit="",
        formula="max J_load / (ratio^2 (J_motor + J_gear input))",
        source=_PRACTICE + "; the gear's input is on the motor's side of the compliance",
        missing=_no_inertia,
    ),
    Limit(
        "gear resonance",
        need=_least_resonance,
        gives=_resonance,
        unit="Hz",
        formula="f = 1/(2 pi sqrt(sum of max J_load/K_1 over this joint and those beyond))",
        source="rule of a maker of strain wave gears: 8 Hz base axes, 15 Hz hand axes (retyped)",
        missing=lambda d: _LOOPS if d.case.load_inertia is None else "stiffness",
        note=_resonance_note,
    ),
    Limit(
        "back-driving",
        need=_nothing,
        gives=_nothing,
        unit="",
        formula="",
        source="",
        verdict=_back_driving,
    ),
]
