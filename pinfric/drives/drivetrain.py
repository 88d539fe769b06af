"""Candidates for a joint (motor and gear, or gearmotor), and the demand on their motors.

The gear stands between motor and joint and replaces the scene's transmission there;
`drives.motor_torque_bounds` has the equations.

A maker's efficiency eta at rated torque contains the no-load loss n_run. With t = T_rated/ratio at
the input, what is lost in proportion to the load alone is

    eta_load = t/(t/eta - n_run),      n_run = starting torque + viscous x speed

so that at rated torque and speed the whole loss is the maker's. Without `back_efficiency`
eta_b = ratio n_s/F_b, of the torques that start it without load, n_s at the input and F_b at the
output; without these the same loss is taken both ways: eta_b = 2 - 1/eta_load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from pinfric.drives.bearing import BearingRatings
from pinfric.drives.catalog import (
    WARM,
    Amplifier,
    Brake,
    Catalog,
    Gear,
    GearMotor,
    Motor,
)
from pinfric.drives.demand import DriveCycle, largest, mean, power_figures
from pinfric.drives.kinds.kind import Kind
from pinfric.drives.kinds.servo import continuous_torque
from pinfric.drives.overload import heat_lag, settled_heat
from pinfric.drives.policy import (
    COOLING,
    KIT,
    MOST_PEAK,
    REFERENCE_TEMPERATURE,
    STALLED,
    Conditions,
)
from pinfric.drives.sourced import Sourced
from pinfric.drives.thermal import (
    COPPER,
    Thermal,
    WindingCycle,
    mean_winding_temperature,
    no_load_heat,
    winding_cycle,
)
from pinfric.model.described import described, quantity
from pinfric.model.drives import gear_table, gear_torque_bounds
from pinfric.model.friction_terms import constant_friction, linear_drag
from pinfric.model.transmission import (
    MakersEfficiency,
    Transmission,
    load_part,
)
from pinfric.motions.summary import ends_by_magnitude, rms

#: What is said of a product whose figures were not read in its maker's document.
RETYPED = "figures retyped by a third party"
#: What the ratings of a motor need, in words.
_AIR = {"closed": "nothing", "plate": "a plate", "open": "free air", "fan": "a fan's air"}
#: Torque constant of the equivalent DC motor over one that is printed per A of phase current.
PER_DC_AMPERE = {"dc": 1.0, "rms": (2 / 3) ** 0.5, "peak": 2 / 3**0.5}


@dataclass(frozen=True)
class Ratings:
    """A maker's ratings at the rated shaft: a motor's own, or a gearmotor's output.

    Attributes: as of `catalog.Motor`, in its units, completed by `ratings_of`, and
        torque_constant, resistance: of the equivalent DC motor, between terminals.
        peak_by_stall: what the stall torque says of a peak torque that is not printed, N m.
        derived: what was computed from others (continuous or peak torque, "line"), and how.
    """

    continuous_torque: float | None = None
    peak_torque: float | None = None
    stall_torque: float | None = None
    torque_constant: float | None = None
    resistance: float | None = None
    nominal_voltage: float | None = None
    no_load_speed: float | None = None
    rated_speed: float | None = None
    max_speed: float | None = None
    thermal: Thermal | None = None
    max_voltage: float | None = None
    continuous_curve: tuple[tuple[float, float], ...] | None = None
    continuous_stall_torque: float | None = None
    thermal_time: float | None = None
    rated_ambient: float = REFERENCE_TEMPERATURE
    ambient_curve: tuple[tuple[float, float], ...] | None = None
    cooling: str | None = None
    peak_by_stall: float | None = None
    special: Kind | None = None
    derived: tuple[tuple[str, str], ...] = ()

    @property
    def has_line(self) -> bool:
        """Whether the speed-torque line is known."""
        electric = self.torque_constant is not None and self.resistance is not None
        return electric or (self.no_load_speed is not None and self.stall_torque is not None)

    @property
    def no_load_heat(self) -> float:
        """Heat of the housing by turning, W s/rad (`thermal.no_load_heat`); 0: not known."""
        point = self.continuous_torque, self.rated_speed, self.torque_constant, self.resistance
        torque, speed, k, r = point
        if torque is None or speed is None or k is None or r is None:
            return 0.0
        return no_load_heat(self.thermal, torque / k, r, speed, self.rated_ambient)

    def continuous_over(self, speed: np.ndarray) -> np.ndarray:
        """Return the continuous torque (T,), N m, at speeds |speed|: the maker's curve, or flat."""
        if self.continuous_curve is None:
            return np.full(len(speed), np.nan if (t := self.continuous_torque) is None else t)
        at, torque = np.transpose(self.continuous_curve)
        return np.interp(np.abs(speed), at, torque)

    def derating(self, conditions: Conditions) -> tuple[float | None, str]:
        """Return the part of the continuous ratings left in a joint, or None, and a remark.

        Of a motor that needs air `policy.COOLING`; of that at the ambient temperature by the
        maker's curve (None beyond its end), else sqrt((T_max - T_a)/(T_max - T_rated)), at most 1:
        copper loss, in proportion to the torque's square, is led off in proportion to T_max - T_a.
        """
        (share, text), aired = self._derating(conditions), self.aired(conditions)
        if share is None or aired == 1.0:
            return share, text
        air = f"{aired:.3g} of the rating, which needs {_AIR[self.cooling or 'closed']}"
        return aired * share, "; ".join(x for x in (air, text) if x)

    def aired(self, conditions: Conditions) -> float:
        """Return the part of the continuous torque left by the joint's `conditions.cooling`."""
        return min(1.0, COOLING[self.cooling or "closed"] / COOLING[conditions.cooling])

    def thermal_at(self, conditions: Conditions) -> Thermal | None:
        """Return the two nodes in a joint: with less air the housing leads off less.

        The sum of both resistances grows by 1/share^2, so that the derated torque heats the winding
        as the rated one does; the housing's time constant grows with its resistance.
        """
        thermal, share = self.thermal, self.aired(conditions)
        if thermal is None or share == 1.0:
            return thermal
        whole = thermal.winding_housing + thermal.housing_ambient
        factor = (whole / share**2 - thermal.winding_housing) / thermal.housing_ambient
        slower = None if thermal.housing_time is None else factor * thermal.housing_time
        more = {"housing_ambient": factor * thermal.housing_ambient, "housing_time": slower}
        return thermal.model_copy(update=more)

    def _derating(self, conditions: Conditions) -> tuple[float | None, str]:
        ambient, rated = conditions.ambient, self.rated_ambient
        if self.ambient_curve is not None:
            at, parts = np.transpose(self.ambient_curve)
            if ambient > at[-1]:
                return (
                    None,
                    f"the maker's curve ends at {at[-1]:g} C; ambient temperature {ambient:g} C",
                )
            share = float(np.interp(ambient, at, parts))
            return share, f"{share:.3g} of the rating by the maker's curve at {ambient:g} C"
        if ambient <= rated:
            return 1.0, ""
        hottest = self.max_winding(conditions)
        if ambient >= hottest:
            return 0.0, too_hot(ambient, hottest)
        share = ((hottest - ambient) / (hottest - rated)) ** 0.5
        return share, f"{share:.3g} of the rating at {rated:g} C: ambient temperature {ambient:g} C"

    def continuous_at(self, conditions: Conditions, speed: float = 0.0) -> tuple[float | None, str]:
        """Return the continuous torque (N m, or None) at the ambient temperature, and a remark.

        `speed`: the mean one, rad/s, for the maker's curve over speed.
        """
        torque = self.continuous_torque
        if self.continuous_curve is not None:
            torque = float(self.continuous_over(np.array([speed]))[0])
        share, text = self.derating(conditions)
        return None if torque is None or share is None else share * torque, text

    def stall_at(self, conditions: Conditions) -> float | None:
        """Return the torque for ever at a standstill (N m, or None) at the ambient temperature.

        As printed, else a curve's at the speed 0, or 0.71 of the continuous torque.
        """
        share, torque, rated = self.derating(conditions)[0], self.continuous_stall_torque, None
        if self.continuous_curve is not None and self.continuous_curve[0][0] == 0.0:
            rated = self.continuous_curve[0][1]
        elif self.continuous_torque is not None:
            rated = STALLED * self.continuous_torque
        torque = rated if torque is None else torque
        return None if torque is None or share is None else share * torque

    @property
    def by_rule(self) -> str:
        """What of its kind is by a rule, in words; or empty."""
        return "" if self.special is None else self.special.by_rule

    @property
    def rated_up_to(self) -> float:
        """The highest ambient temperature for which its maker rates it, deg C."""
        curve = self.ambient_curve
        return max(self.rated_ambient, curve[-1][0] if curve else self.rated_ambient)

    @property
    def max_winding_printed(self) -> float | None:
        """The maker's permissible winding temperature, deg C, or None."""
        return None if self.thermal is None else self.thermal.max_winding

    def max_winding(self, conditions: Conditions) -> float:
        """Return the permissible winding temperature: the maker's, else the conditions', deg C."""
        printed = self.max_winding_printed
        return conditions.max_winding if printed is None else printed

    def heated(self, temperature: Any) -> Any:
        """Return resistance at temperatures of the winding, deg C, over that at 25 C."""
        return 1 + COPPER * (temperature - REFERENCE_TEMPERATURE)

    def hottest(self, conditions: Conditions) -> float:
        """Return the same at the permissible winding temperature."""
        return float(self.heated(self.max_winding(conditions)))

    def voltage(self, torque: np.ndarray, speed: np.ndarray, hot: float = 1.0) -> np.ndarray:
        """Return the voltage that torque and speed take: |R T/k + k omega| (T,), V.

        Without k and R: U_nominal |T/T_stall + omega/omega_no_load|, the same line.

        Args:
            torque, speed: (T,) at the rated shaft, N m and rad/s.
            hot: the winding's resistance over that at 25 C.
        """
        k, r = self.torque_constant, self.resistance
        if k is not None and r is not None:
            return np.abs(hot * r / k * torque + k * speed)
        assert self.nominal_voltage and self.stall_torque and self.no_load_speed  # noqa: PT018
        return self.nominal_voltage * np.abs(
            hot * torque / self.stall_torque + speed / self.no_load_speed
        )

    def torque_limit(self, speed: np.ndarray, voltage: float, hot: float = 1.0) -> np.ndarray:
        """Return the largest positive torque at each speed: line and peak torque (T,), N m.

        A speed below 0 brakes with it: there the back-EMF helps. Infinite where nothing is known.
        """
        limit = np.full(len(speed), np.inf if self.peak_torque is None else self.peak_torque)
        if self.has_line:
            unit = self.voltage(np.ones(1), np.zeros(1), hot)[0]
            back = self.voltage(np.zeros(1), np.ones(1))[0]
            limit = np.minimum(limit, (voltage - back * speed) / unit)
        return np.maximum(limit, 0.0)


def line_voltage(ratings: Ratings, motor: MotorCycle) -> np.ndarray | None:
    """Return the voltage (T,) that a cycle takes, worst of its torques; None without a line."""
    if not ratings.has_line:
        return None
    hot, speed = motor.figures.hot, motor.speed
    ends = motor.torque_lower, motor.torque_upper
    return np.maximum(*(ratings.voltage(torque, speed, hot) for torque in ends))


def bus_voltage(
    candidate: Candidate, motor: MotorCycle, conditions: Conditions
) -> np.ndarray | None:
    """Return the bus voltage (T,) that a cycle takes; None without a line."""
    taken = line_voltage(candidate.ratings, motor)
    return None if taken is None else taken / candidate.voltage_share(conditions)


def too_hot(ambient: float, hottest: float) -> str:
    """Say that a motor cannot lead off anything (deg C)."""
    return f"ambient temperature {ambient:g} C, not below the winding's limit, {hottest:g} C"


@dataclass(frozen=True)
class Candidate:
    """A motor with a gear, or a gearmotor: entries of the catalogue, and what its joint has.

    Attributes:
        motor, entry: of the motor or gearmotor. gear_name, gear: None of a gearmotor.
        ratio: motor turns per joint turn (rad/m at a sliding joint).
        transmission: ratio and losses for the dynamics, rotor and brake; None where figures are
            missing. losses: how they follow from the entries, in words.
        bearing: what carries the joint: the gear's output bearing (a screw's nut), or the joint's
            own; None where its ratings are not known. guide: the same of a sliding joint.
        amplifier: that feeds the motor; None where none is named.
        brake, brake_entry: at the motor's shaft; empty and None: none.
    """

    motor: str
    entry: Motor | GearMotor
    gear_name: str | None
    gear: Gear | None
    ratio: float
    transmission: Transmission | None
    losses: str = ""
    bearing: BearingRatings | None = None
    guide: BearingRatings | None = None
    amplifier: Amplifier | None = None
    brake: str = ""
    brake_entry: Brake | None = None

    @property
    def name(self) -> str:
        """As reports print it and files name it."""
        if self.gear is None:
            return self.motor
        return drive_name(self.motor, self.gear_name or "", self.gear, self.ratio)

    @cached_property
    def ratings(self) -> Ratings:
        """Of the rated shaft."""
        return ratings_of(self.entry)

    @property
    def at_output(self) -> bool:
        """Whether the rated shaft is a gearmotor's output, not a motor's."""
        return isinstance(self.entry, GearMotor)

    @property
    def linear(self) -> bool:
        """Whether its output slides."""
        return self._of_output("output") == "linear"

    @property
    def backlash(self) -> float | None:
        """Of its output, rad (m); None: not known."""
        return self._of_output("backlash")

    @property
    def back_driving_torque(self) -> float | None:
        """At its output, starts it without load, N m (N); None: not known."""
        return self._of_output("back_driving_torque")

    def _of_output(self, figure: str) -> Any:
        return getattr(self.gear or self.entry, figure, None)

    @property
    def missing(self) -> tuple[str, ...]:
        """The figures missing for the motor's torque."""
        figures: dict[str, object] = {"rotor inertia": self.entry.rotor_inertia}
        if self.gear is not None:
            figures = {
                "rotor inertia of the motor": self.entry.rotor_inertia,
                "input inertia of the gear": self.gear.input_inertia,
                "efficiency of the gear": self.gear.efficiency,
            }
        return tuple(name for name, value in figures.items() if value is None)

    @cached_property
    def mass(self) -> float | None:
        """Of motor, gear, housing of a kit and brake, kg; None: one is not known."""
        mass = self.entry.mass
        if isinstance(self.entry, Motor) and self.gear is not None:
            kit = 1 + KIT * self.entry.frameless
            mass = _sum(self.entry.mass_taken, self.gear.mass, kit)
        return mass if self.brake_entry is None else _sum(mass, self.brake_entry.mass_taken)

    @cached_property
    def rotor_inertia(self) -> float | None:
        """J_motor + J_gear input + J_brake at the motor's shaft, kg m^2; None: not known."""
        inertia = self.entry.rotor_inertia
        if self.gear is not None:
            inertia = _sum(inertia, self.gear.input_inertia)
        more = None if self.brake_entry is None else self.brake_entry.inertia_ends[1]
        return inertia if more is None else _sum(inertia, more)

    def voltage_share(self, conditions: Conditions) -> float:
        """Return the part of the bus voltage that the motor gets; see the function."""
        return voltage_share(self.entry, self.amplifier, conditions)

    def voltage(self, conditions: Conditions) -> float:
        """Return the highest voltage at the motor's terminals, V."""
        return self.voltage_share(conditions) * conditions.bus_voltage

    @property
    def brake_note(self) -> str:
        """The brake, and what of it is not known, in words; empty: there is none."""
        unknown = () if self.brake_entry is None else self.brake_entry.unknown
        return f"{self.brake}: {', '.join(unknown)}" if unknown else self.brake

    @property
    def _parts(self) -> list[tuple[str, Sourced]]:
        names = self.motor, self.gear_name or "", self.brake
        entries = self.entry, self.gear, self.brake_entry
        return [(name, x) for name, x in zip(names, entries, strict=True) if x is not None]

    @property
    def sources(self) -> tuple[str, ...]:
        """Of all parts, with their grades."""
        return tuple(f"{name}: {entry.source} ({entry.grade})" for name, entry in self._parts)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the catalogue remarks on the parts, with their names."""
        notes = list[str]()
        for name, entry in self._parts:
            said = [entry.note] * bool(entry.note) + [RETYPED] * (entry.grade == "T")
            said += [self.ratings.by_rule] * (entry is self.entry and self.ratings.by_rule != "")
            notes += [f"{name}: {text}" for text in said]
        return tuple(notes)

    @property
    def stand_ins(self) -> tuple[str, ...]:
        """Figures taken from other products, or by rule."""
        taken, motor = list[str](), self.entry
        for name, entry in self._parts:
            taken += [f"{f.replace('_', ' ')}: {whose}" for f, whose in entry.stand_ins.items()]
            if isinstance(entry, Motor) and entry.mass_taken != entry.mass:
                taken.append(f"mass: 1.94 T^0.75 = {entry.mass_taken:.2g} kg, by rule")
            kit = entry is self.gear and isinstance(motor, Motor) and motor.frameless
            if kit and self.mass is not None:
                taken.append(f"housing, shaft, bearings of a frameless kit: {KIT:.0%} of its mass")
            if isinstance(entry, Brake):
                taken += [f"{name}: {text}" for text in entry.unknown]
        return tuple(taken)

    @property
    def carried(self) -> bool:
        """Whether the ratings of what carries the joint are known."""
        return self.bearing is not None or self.guide is not None

    @property
    def integrated(self) -> bool:
        """Whether it is a gearmotor, without a shaft for a brake that is sold alone."""
        return self.at_output and not self.linear

    @property
    def on_bus(self) -> bool:
        """Whether the bus of the motors feeds it."""
        return self.ratings.special is None or self.ratings.special.ON_BUS

    @property
    def units(self) -> tuple[str, str]:
        """Of torque and speed at the rated shaft; N and m/s of a linear motor."""
        return ("N", "m/s") if self.linear and self.at_output else ("N m", "rad/s")


def voltage_share(
    entry: Motor | GearMotor | None, amplifier: Amplifier | None, conditions: Conditions
) -> float:
    """Return the part of the bus voltage that a motor gets from its amplifier.

    As that prints it, else the conditions'; 1 of a gearmotor with electronics of its own, whose
    figures are for its supply.
    """
    if isinstance(entry, GearMotor) and (entry.max_voltage or entry.peak_current):
        return 1.0
    printed = None if amplifier is None else amplifier.voltage_share
    return conditions.amplifier_share if printed is None else printed


def _sum(a: float | None, b: float | None, factor: float = 1.0) -> float | None:
    """None where one is not known."""
    return None if a is None or b is None else (a + b) * factor


@described
class MotorFigures:
    """Demand of the cycle at the rated shaft; magnitudes, worst case over the interval."""

    peak: float = quantity("largest torque", "N m")
    rms: float = quantity("RMS of the torque", "N m")
    rms_least: float = quantity("least RMS of the torque", "N m")
    max_speed: float = quantity("largest", "rad/s")
    holding: tuple[float, float] | None = quantity(
        "(least, worst) over the holds (all joints at rest); none without a hold", "N m"
    )
    peak_temperature: float | None = quantity(
        "winding temperature in the settled cycle (infinite: thermal runaway); none: not known",
        "deg C",
    )
    mean_temperature: float | None = quantity("at the mean heat; none where not known", "deg C")
    driving_power: float | None = quantity("largest electrical power from the bus", "W")
    braking_power: float | None = quantity("largest electrical power to the bus", "W")
    energy: float | None = quantity("energy from the bus over a cycle, with copper loss", "J")
    regenerated: float | None = quantity("energy to the bus over a cycle", "J")
    mean_speed: float = quantity("mean", "rad/s", default=0.0)
    standing: float | None = quantity(
        "largest torque while this joint stands still, whatever the others do; none: never",
        "N m",
        default=None,
    )
    short_term: float | None = quantity(
        "constant torque that heats the motor as much as the cycle at its hottest time",
        "N m",
        default=None,
    )
    overloaded_standstill: float | None = quantity(
        "longest standstill above the continuous torque (infinite: without end); "
        "none if that torque is not known",
        "s",
        default=None,
    )
    hot: float = quantity(
        "resistance of the winding over that at 25 C: at its peak temperature, else at the mean "
        "heat, else at the permissible one",
        default=1.0,
    )
    peak_current: float | None = quantity(
        "largest, in A of `current_kind`: torque over its maker's torque constant; none: not known",
        "A",
        "peak\ncurrent",
        default=None,
    )
    rms_current: float | None = quantity(
        "RMS, as `peak_current`", "A", "RMS\ncurrent", default=None
    )
    current_kind: str = quantity(
        "of the torque constant: DC or block commutation (dc), or RMS or peak of a sinusoidal "
        "phase current (rms, peak)",
        heading="kind of\ncurrent",
        default="",
    )


@dataclass(frozen=True)
class MotorCycle:
    """The rated shaft over the cycle, sample by sample.

    Attributes:
        torque_lower, torque_upper: (T,) N m. speed: (T,) rad/s.
        current: (T,) A of the torque of larger magnitude, or None.
        winding: temperatures of the settled cycle, or None.
        power: (T,) T_m omega + R(T_w) i^2 of the torque of larger magnitude, W.
        copper: whether the second part is known and in it.
        figures: its peaks and means.
    """

    torque_lower: np.ndarray
    torque_upper: np.ndarray
    speed: np.ndarray
    current: np.ndarray | None
    winding: WindingCycle | None
    power: np.ndarray
    copper: bool
    figures: MotorFigures


def drives_of(
    catalog: Catalog, linear: bool, ambient: float = WARM
) -> Iterator[tuple[str, Callable[[], Candidate]]]:
    """Yield the name of every motor with every gear and ratio, and of gearmotors, and their maker.

    Args:
        linear: for a sliding joint: only what has a linear output.
        ambient: as of `motor_with_gear`.
    """
    for gear_name, gear in catalog.gears.items():
        if (gear.output == "linear") != linear:
            continue
        for ratio in gear.ratios:
            for name, motor in catalog.motors.items():
                make = partial(motor_with_gear, name, motor, gear_name, gear, ratio, ambient)
                yield drive_name(name, gear_name, gear, ratio), make
    for name, gearmotor in catalog.whole():
        if (gearmotor.output == "linear") == linear:
            yield name, partial(gearmotor_drive, name, gearmotor)


def drive_name(motor: str, gear: str, entry: Gear, ratio: float) -> str:
    """Return the name of a motor behind a gear."""
    return f"{motor} + {gear}" + (f", i = {ratio:g}" if len(entry.ratios) > 1 else "")


def with_brake(candidate: Candidate, name: str, brake: Brake) -> Candidate:
    """Return a drive with a brake at its motor's shaft.

    Where they are not printed, its mass and greatest inertia are those of a rule.
    """
    transmission = candidate.transmission
    if transmission is not None:
        inertia = transmission.rotor_inertia + brake.inertia_ends[1]
        held = {"rotor_inertia": inertia, "brake": brake.holding}
        transmission = transmission.model_copy(update=held)
    return replace(candidate, transmission=transmission, brake=name, brake_entry=brake)


def amplifier_torque(candidate: Candidate, current: str) -> tuple[float | None, str]:
    """Return the torque (N m) of an amplifier's peak or continuous current, and this in words."""
    amplifier, k = candidate.amplifier, candidate.ratings.torque_constant
    most = None if amplifier is None else getattr(amplifier, current)
    if amplifier is None or most is None:
        return None, ""
    text = f"{most:g} A {amplifier.current}"
    return (None if k is None else float(k * most / PER_DC_AMPERE[amplifier.current])), text


def motor_with_gear(
    motor_name: str, motor: Motor, gear_name: str, gear: Gear, ratio: float, ambient: float = WARM
) -> Candidate:
    """Return one motor behind one gear.

    Args:
        ratio: one of the gear's. ambient: deg C, by which a cold gear loses more (`Gear.at`).
    """
    gear = gear.at(ratio, ambient)
    inertia = _sum(motor.rotor_inertia, gear.input_inertia)
    made = gear_transmission(gear, ratio, inertia)
    return Candidate(motor_name, motor, gear_name, gear, ratio, *made, gear.bearing)


def gear_transmission(
    gear: Gear, ratio: float, rotor_inertia: float | None
) -> tuple[Transmission | None, str]:
    """Return a gear's ratio and losses for the dynamics, and how they were found, in words.

    See the module; None where the efficiency or the inertia is not known.

    Args:
        ratio: one of the gear's.
        rotor_inertia: at its input, the motor's included, kg m^2; None: not known.
    """
    if gear.efficiency is None:
        return None, "gear's efficiency not known"
    values, eta = gear.no_load(), gear.efficiency
    back: Any = gear.back_efficiency
    if isinstance(eta, MakersEfficiency):
        text = "efficiency by the maker's curve"
    elif gear.dragged_by_rule:  # which loss contains the other is not known: both count in full
        text = (
            f"efficiency {eta:.3g} at any load and {gear.no_load_running_torque:.3g} N m no-load, "
            "by rule, on top"
        )
    elif gear.no_load_running_torque is not None:
        assert gear.rated_torque is not None  # the schema requires it
        t, running = gear.rated_torque / ratio, gear.no_load_running_torque
        whole, eta = eta, min(t / (t + load_part(eta, t, running)), 1.0)
        text = (
            f"efficiency {whole:.3g} at rated torque = {eta:.3f} load-proportional and "
            f"{running:.3g} N m no-load"
        )
    else:  # without the running torque it cannot be taken out of the efficiency
        text = (
            f"efficiency {eta:.3g} at any load (its no-load part is not known: losses at part load "
            "are too small)"
        )
    text += "; backwards "
    if back is not None:
        text += f"{back:.3f}"
    elif (driven := gear.back_driving(ratio)) is not None:
        back, eta_b = driven
        text += f"{eta_b:.3f} = ratio x starting torque/back-driving torque"
    elif isinstance(eta, MakersEfficiency):
        back = "same_loss"
        text += "the same loss (assumed)"
    else:
        back = 2 - 1 / eta
        text += f"{back:.3f} = 2 - 1/eta, the same loss both ways (assumed)"
    values |= {
        "ratio": ratio,
        "rotor_inertia": rotor_inertia,
        "efficiency": eta,
        "back_efficiency": back,
        "stiffness": gear.stiffness,
        "hysteresis": gear.hysteresis,
        "momentary_peak": gear.momentary_peak_torque,
    }
    # the entry's figures were validated when it was read
    return (None if rotor_inertia is None else Transmission.model_construct(**values)), text


def input_torques(candidate: Candidate, cycle: DriveCycle) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends (T,) of the torque at a gear's input, N m, without any rotor."""
    assert candidate.transmission is not None
    bare = candidate.transmission.model_copy(update={"rotor_inertia": 0.0})
    return gear_torque_bounds(
        gear_table([bare], [0.0]),
        cycle.effort_lower,
        cycle.effort_upper,
        cycle.velocity,
        cycle.acceleration,
        cycle.at_rest,
    )


def braking_torque(candidate: Candidate, cycle: DriveCycle) -> float:
    """Return the largest torque, rotor included, at the rated shaft of a drive that brakes, N m."""
    assert candidate.transmission is not None
    scale = candidate.ratio if candidate.at_output else 1.0
    rotor = candidate.ratio * candidate.transmission.rotor_inertia * cycle.acceleration
    return scale * max(largest(end + rotor) for end in input_torques(candidate, cycle))


def motor_cycle(
    candidate: Candidate,
    cycle: DriveCycle,
    conditions: Conditions,
    bare: tuple[np.ndarray, np.ndarray] | None = None,
) -> MotorCycle:
    """Return the demand of the cycle on the motor of a candidate with a transmission.

    T_m = [lower(t), upper(t)]/r + r viscous v + r J a (`motor_torque_bounds`); i = T_m/k;
    P = T_m omega + R(T_w) i^2. `bare`: `input_torques`, if known.
    """
    assert candidate.transmission is not None
    t = cycle.stretched
    rotor = candidate.ratio * candidate.transmission.rotor_inertia * cycle.acceleration
    lower, upper = (end + rotor for end in bare or input_torques(candidate, cycle))
    speed = candidate.ratio * cycle.velocity
    if candidate.at_output:
        lower, upper, speed = lower * candidate.ratio, upper * candidate.ratio, cycle.velocity
    lower, upper = lower * cycle.powered, upper * cycle.powered
    worst, least = ends_by_magnitude(lower, upper)
    hold = cycle.holding
    current, winding, mean_temperature = _temperatures(
        candidate.ratings, cycle, worst, speed, conditions
    )
    ratings, mean_speed = candidate.ratings, mean(t, np.abs(speed))
    settled = winding is not None and not winding.runaway
    warmest = winding.peak if winding is not None and settled else mean_temperature
    if warmest is None or not np.isfinite(warmest):
        warmest = ratings.max_winding(conditions)
    hot = ratings.heated(warmest)
    power, drawn, copper = worst * speed, (None, None, None, None), False
    if current is not None and ratings.resistance is not None:
        of_each = ratings.heated(winding.winding) if winding is not None and settled else hot
        power, copper = power + ratings.resistance * of_each * current**2, True
        drawn = astuple(power_figures(t, power))
    kind = getattr(candidate.entry, "current", "dc")
    printed = None if current is None else current * PER_DC_AMPERE[kind]
    limit = ratings.stall_at(conditions)
    lag = heat_lag(ratings.thermal_at(conditions), ratings.thermal_time, conditions)
    figures = MotorFigures(
        peak=largest(worst),
        rms=rms(t, worst),
        rms_least=rms(t, least),
        max_speed=largest(speed),
        mean_speed=mean_speed,
        holding=(largest(least[hold]), largest(worst[hold])) if hold.any() else None,
        peak_temperature=None if winding is None else winding.peak,
        mean_temperature=mean_temperature,
        driving_power=drawn[0],
        braking_power=drawn[1],
        energy=drawn[2],
        regenerated=drawn[3],
        standing=largest(worst[cycle.standing]) if cycle.standing.any() else None,
        short_term=settled_heat(cycle.t, worst, lag, cycle.duty),
        overloaded_standstill=None
        if limit is None
        else cycle.longest_above(worst, limit, still=True),
        hot=hot,
        peak_current=None if printed is None else largest(printed),
        rms_current=None if printed is None else rms(t, printed),
        current_kind="" if printed is None else kind,
    )
    return MotorCycle(lower, upper, speed, current, winding, power, copper, figures)


def _temperatures(
    ratings: Ratings,
    cycle: DriveCycle,
    torque: np.ndarray,
    speed: np.ndarray,
    conditions: Conditions,
) -> tuple[np.ndarray | None, WindingCycle | None, float | None]:
    """Return current, winding temperatures and temperature at the mean heat, where known."""
    if ratings.torque_constant is None:
        return None, None, None
    current = torque / ratings.torque_constant
    thermal, resistance = ratings.thermal_at(conditions), ratings.resistance
    if thermal is None or resistance is None:
        return current, None, None
    ambient, turning = conditions.ambient, ratings.no_load_heat * np.abs(speed)
    at_mean = mean_winding_temperature(
        cycle.stretched,
        current,
        resistance,
        thermal,
        ambient,
        no_load=mean(cycle.stretched, turning),
    )
    if thermal.winding_time is None or thermal.housing_time is None:
        return current, None, at_mean
    winding = winding_cycle(
        cycle.t, current, resistance, thermal, ambient, duty=cycle.duty, no_load=turning
    )
    return current, winding, at_mean


_RATINGS = tuple(figure.name for figure in fields(Ratings))
#: A figure that was computed from others ("line": the speed-torque line), and how.
Note = tuple[str, str]


def ratings_of(entry: Motor | GearMotor) -> Ratings:
    """Return a maker's figures, completed by what follows from others.

    A sinusoidal motor is taken as the DC motor of the same torque, copper loss and bus voltage:
    with k per ampere of the phase current's peak and a phase's resistance R_ph, 2/sqrt(3) k and
    2 R_ph (3/2 R_ph i^2 is lost; sqrt(3) times a phase's voltage is the bus's).
    """
    # 1. as printed; a drive of a kind of its own has torques of its own
    own, special = vars(entry), entry.special
    ratings, derived = (
        Ratings(**{name: own[name] for name in _RATINGS if name in own}),
        list[Note](),
    )
    if special is not None:
        torque, text = special.torques
        highest = ratings.max_voltage or special.highest_voltage
        ratings = replace(
            ratings,
            special=special,
            continuous_torque=torque,
            peak_torque=torque,
            max_voltage=highest,
        )
        derived += [("continuous torque", text), ("peak torque", text)]
    # 2. torques
    if isinstance(entry, GearMotor):
        continuous, peak, notes = _torques_by_stall(entry, ratings)
    else:
        continuous, peak, notes = _torque_by_current(entry, ratings)
    derived += notes
    # 3. the equivalent DC motor
    k, resistance, notes = _dc_motor(entry, ratings)
    derived += notes
    # 4. over the speed
    curve, stall = ratings.continuous_curve, ratings.stall_torque
    rated, no_load, stalled = (
        ratings.rated_speed,
        ratings.no_load_speed,
        ratings.continuous_stall_torque,
    )
    if curve is None and continuous and stalled and rated and stalled > continuous:
        curve = ((0.0, stalled), (rated, continuous))
        text = "along a line from the one at standstill to the one at the rated speed"
        derived.append(("continuous torque", text))
    if continuous is None and ratings.continuous_curve is not None:
        continuous = max(torque for _, torque in ratings.continuous_curve)
    if stall is None and continuous is not None and rated and no_load and rated < no_load:
        stall = continuous / (1 - rated / no_load)
        text = "speed-torque line through the rated point and the no-load speed"
        derived.append(("line", text))
    by_stall = None if peak is not None else stall
    if by_stall is not None and continuous is not None:
        by_stall = min(by_stall, MOST_PEAK * continuous)
    completed = {
        "continuous_torque": continuous,
        "continuous_curve": curve,
        "peak_torque": peak,
        "torque_constant": k,
        "resistance": resistance,
        "stall_torque": stall,
        "peak_by_stall": by_stall,
        "derived": tuple(derived),
    }
    return Ratings(**vars(ratings) | completed)  # `replace` takes twice the time


def _torque_by_current(
    motor: Motor, ratings: Ratings
) -> tuple[float | None, float | None, list[Note]]:
    """The continuous torque that its current makes, and the peak as printed; and how."""
    continuous, k = ratings.continuous_torque, ratings.torque_constant
    if continuous is not None or motor.continuous_current is None or k is None:
        return continuous, ratings.peak_torque, []
    text = "continuous torque = torque constant x continuous current"
    return k * motor.continuous_current, ratings.peak_torque, [("continuous torque", text)]


def _torques_by_stall(
    entry: GearMotor, ratings: Ratings
) -> tuple[float | None, float | None, list[Note]]:
    """Continuous and peak torque of a gearmotor, by its stall torque and its electronics."""
    notes, blocked, current = list[Note](), entry.stall_torque, entry.peak_current
    continuous, printed, k = ratings.continuous_torque, ratings.peak_torque, ratings.torque_constant
    if continuous is None and blocked is not None:
        continuous, text = continuous_torque(blocked)
        notes.append(("continuous torque", text))
    text, peak = "the stall torque, a momentary maximum", blocked if printed is None else printed
    if current is not None and k is not None and (peak is None or k * current < peak):
        text, peak = "torque constant x largest current of its electronics", k * current
    return continuous, peak, notes + ([("peak torque", text)] if peak != printed else [])


def _dc_motor(
    entry: Motor | GearMotor, ratings: Ratings
) -> tuple[float | None, float | None, list[Note]]:
    """Torque constant and resistance between terminals of the equivalent DC motor."""
    notes = list[Note]()
    k, resistance, stall = ratings.torque_constant, ratings.resistance, ratings.stall_torque
    if k is not None and entry.current != "dc":
        k *= PER_DC_AMPERE[entry.current]
        text = f"{PER_DC_AMPERE[entry.current]:.4g} of the torque constant, which is per A "
        notes.append(("line", f"{text}{entry.current}, for an equivalent DC motor"))
    if isinstance(entry, Motor) and resistance is not None and entry.resistance_of == "phase":
        resistance *= 2.0
        notes.append(("line", "2 x the resistance of a phase between terminals"))
    if resistance is None and k is not None and stall is not None and ratings.nominal_voltage:
        resistance = k * ratings.nominal_voltage / stall
        notes.append(("line", "resistance = torque constant x nominal voltage/stall torque"))
    return k, resistance, notes


def gearmotor_drive(name: str, entry: GearMotor) -> Candidate:
    """Return a gearmotor: torques and speeds at its output."""
    friction = entry.friction
    values: dict[str, Any] = {
        "ratio": entry.ratio,
        "efficiency": 1.0,
        "back_efficiency": 1.0,
        "rotor_inertia": entry.rotor_inertia or 0.0,
        "stiffness": entry.stiffness,
    }
    losses = "included in the maker's ratings at the output"
    if friction is not None:  # driving: u (1 - l) = t (1 + l) + base + viscous v
        share = friction.load_dependent
        values["efficiency"] = values["back_efficiency"] = (1 - share) / (1 + share)
        values["no_load_torque"] = constant_friction(friction.base / ((1 - share) * entry.ratio))
        values["motor_viscous"] = linear_drag(friction.viscous / ((1 - share) * entry.ratio**2))
        losses = "identified friction at the output: base, load-dependent, viscous"
    transmission = None if entry.rotor_inertia is None else Transmission.model_construct(**values)
    return Candidate(name, entry, None, None, entry.ratio, transmission, losses, entry.bearing)
