"""Catalogues of motors, gears, gearmotors, bearings and brakes: makers' figures and sources.

A figure that is missing stays missing: every criterion that needs it says so (`criteria`). SI units
throughout, temperatures in degrees Celsius; `grade` R is a figure read at the maker's own document,
T one retyped by a third party.

A file with `extends: default` adds to the bundled catalogue: its entries go before bundled ones of
the same name, its conditions apply.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from pinfric.errors import CatalogError, PinfricWarning, choose_from
from pinfric.model.entry import Entry, NonNegative, Number, Positive, Version, number_or, parse
from pinfric.model.friction_terms import constant_friction, linear_drag
from pinfric.model.springs import Stiffness, softest
from pinfric.model.transmission import (
    BackDriving,
    MakersEfficiency,
    Share,
    Transmission,
    driving_loss,
)
from pinfric.model.yamlfile import brief, read_yaml
from pinfric.study.sizing.bearing import BearingRatings
from pinfric.study.sizing.units import unit_of

#: The bundled catalogue's name, and its folder.
DEFAULT = "default"
_FOLDER = Path(__file__).parents[2] / "catalog"
_SECTIONS = ("motors", "gears", "gearmotors", "bearings", "brakes")
#: Ambient temperature to which makers refer resistances and ratings, degrees Celsius.
REFERENCE_TEMPERATURE = 25.0

Text = Annotated[str, Field(min_length=1)]


class Sourced(Entry):
    """Where an entry's figures come from.

    Attributes:
        source: maker's document and page, e.g. a maker's catalogue, p. 197
        grade: R read at the maker's own document, T retyped by a third party, e.g. R
        note: what else is to be known of it, e.g. peak printed without a duration
        price (of the catalogue's currency): of one, e.g. 310.0
        dimensions: in words, e.g. 60 mm x 88 mm
        stand_ins: figures that are another's, and whose, e.g. {stiffness: the next smaller size}
    """

    source: Text
    grade: Literal["R", "T"]
    note: str = ""
    price: Positive | None = None
    dimensions: str = ""
    stand_ins: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _stand_ins_are_figures(self) -> Sourced:
        for name in self.stand_ins:
            if getattr(self, name, None) is None:
                raise ValueError(f"stand_ins: {name!r} is not a figure of this entry")
        return self


class Thermal(Entry):
    """Two-node model of a motor: winding and housing.

    Attributes:
        winding_housing (K/W): thermal resistance between winding and housing, e.g. 1.2
        housing_ambient (K/W): between housing and surroundings, e.g. 3.0
        winding_time (s): time constant of the winding, e.g. 30.0
        housing_time (s): of the motor, e.g. 900.0
        max_winding (deg C): highest permissible temperature of the winding, e.g. 155.0
    """

    winding_housing: Positive
    housing_ambient: Positive
    winding_time: Positive | None = None
    housing_time: Positive | None = None
    max_winding: Number | None = None


class Motor(Sourced):
    """A motor: torques and speeds at its shaft.

    Attributes:
        continuous_torque (N m): that it bears for ever, e.g. 0.45
        continuous_curve: where that falls with speed, points of speed (rad/s) and torque (N m),
            e.g. [[0.0, 0.45], [400.0, 0.30]]
        continuous_stall_torque (N m): that it bears for ever at a standstill, e.g. 0.40
        continuous_current (A): that goes with the continuous torque, e.g. 6.0
        peak_torque (N m): that it gives for a short time, e.g. 1.3
        torque_constant (N m/A): torque per current, e.g. 0.075
        resistance (Ohm): from terminal to terminal at 25 C, e.g. 0.35
        rotor_inertia (kg m^2): of the rotor, e.g. 3.0e-5
        mass (kg): of the motor, e.g. 0.6
        max_speed (rad/s): permissible, e.g. 600.0
        nominal_voltage (V): at which the speeds and the stall torque hold, e.g. 48.0
        no_load_speed (rad/s): at nominal voltage without load, e.g. 550.0
        rated_speed (rad/s): at nominal voltage and continuous torque, e.g. 450.0
        stall_torque (N m): at nominal voltage, where the speed-torque line begins, e.g. 3.2
        thermal: for the winding's temperature, e.g. {winding_housing: 1.2, housing_ambient: 3.0}
    """

    continuous_torque: Positive | None = None
    continuous_curve: tuple[tuple[NonNegative, Positive], ...] | None = None
    continuous_stall_torque: Positive | None = None
    continuous_current: Positive | None = None
    peak_torque: Positive | None = None
    torque_constant: Positive | None = None
    resistance: Positive | None = None
    rotor_inertia: Positive | None = None
    mass: Positive | None = None
    max_speed: Positive | None = None
    nominal_voltage: Positive | None = None
    no_load_speed: Positive | None = None
    rated_speed: Positive | None = None
    stall_torque: Positive | None = None
    thermal: Thermal | None = None

    @model_validator(mode="after")
    def _figures_agree(self) -> Motor:
        _ascending(self, "continuous_torque", "peak_torque")
        _ascending(self, "continuous_stall_torque", "peak_torque")
        speeds = [point[0] for point in self.continuous_curve or ()]
        if any(b <= a for a, b in pairwise(speeds)) or len(speeds) == 1:
            raise ValueError("continuous_curve: points [rad/s, N m], speeds ascending, two or more")
        _ascending(self, "rated_speed", "no_load_speed")
        line = self.no_load_speed, self.rated_speed, self.stall_torque
        if any(x is not None for x in line) and self.nominal_voltage is None:
            raise ValueError("no_load_speed, rated_speed, stall_torque need `nominal_voltage`")
        return self


class OutputFriction(Entry):
    """Friction of a gearmotor at its output: base + load_dependent |effort| + viscous |v|.

    Attributes:
        base (N m or N): whatever the load, e.g. 0.5
        load_dependent (1): share of the effort, below 1, e.g. 0.1
        viscous (N m s/rad or N s/m): per speed of the output, e.g. 0.2
    """

    base: NonNegative = 0.0
    load_dependent: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    viscous: NonNegative = 0.0


class GearMotor(Sourced):
    """Motor and gear in one: torques, speeds and friction at the output, rotor at the motor.

    Where `output` is linear these are N, m/s and, of a linear motor (ratio 1), the mass that moves
    with its force (kg, as `rotor_inertia`).

    Attributes:
        ratio (1): motor turns per turn of the output; rad/m of a linear one, e.g. 64.0
        output: what it moves, e.g. rotary
        continuous_torque (N m or N): that it bears for ever, e.g. 48.0
        peak_torque (N m or N): that it gives for a short time, e.g. 120.0
        nominal_voltage (V): at which the speeds hold, e.g. 48.0
        no_load_speed (rad/s or m/s): without load, e.g. 6.0
        rated_speed (rad/s or m/s): at continuous torque, e.g. 5.0
        max_speed (rad/s or m/s): permissible, e.g. 7.0
        rotor_inertia (kg m^2): of the rotor, at the motor's speed, e.g. 5.0e-5
        mass (kg): of the whole, e.g. 0.85
        friction: at the output, e.g. {base: 0.5, load_dependent: 0.1}
        back_driving_torque (N m or N): at the output that starts it without current, e.g. 1.5
        bearing: what its output bearing carries, e.g. {kind: crossed roller, max_moment: 40.0}
    """

    ratio: Positive
    output: Literal["rotary", "linear"] = "rotary"
    continuous_torque: Positive | None = None
    peak_torque: Positive | None = None
    nominal_voltage: Positive | None = None
    no_load_speed: Positive | None = None
    rated_speed: Positive | None = None
    max_speed: Positive | None = None
    rotor_inertia: Positive | None = None
    mass: Positive | None = None
    friction: OutputFriction | None = None
    back_driving_torque: Positive | None = None
    bearing: BearingRatings | None = None

    @model_validator(mode="after")
    def _figures_agree(self) -> GearMotor:
        _ascending(self, "continuous_torque", "peak_torque")
        _ascending(self, "rated_speed", "no_load_speed")
        if (self.no_load_speed or self.rated_speed) and self.nominal_voltage is None:
            raise ValueError("no_load_speed and rated_speed need `nominal_voltage`")
        return self


class Gear(Sourced):
    """A gear: torques at its output unless named input; speeds and inertia at its input.

    `efficiency` is the maker's, no-load loss included: a number at rated torque, or his curves as a
    scene's transmission takes them (`transmission.MakersEfficiency`).

    Attributes:
        ratio (1): motor turns per output turn, or a list of ratios with the same figures; rad/m
            where the output is linear, e.g. [50, 80, 100]
        kind: for the reader, and for rules of strain wave gears, e.g. strain wave
        output: rotary, or linear with efforts in N, e.g. rotary
        rated_torque (N m or N): at which life and efficiency hold, e.g. 40.0
        average_torque (N m or N): limit of the mean, weighted by speed, e.g. 49.0
        repeated_peak_torque (N m or N): limit of a cycle's peaks, e.g. 82.0
        momentary_peak_torque (N m or N): limit in a collision or an emergency stop, e.g. 147.0
        momentary_peaks (1): how often it bears that in its life, e.g. 10000
        rated_speed (rad/s): of the input, at which the life holds, e.g. 209.4
        average_input_speed (rad/s): limit of the mean, e.g. 366.0
        max_input_speed (rad/s): limit, e.g. 680.0
        input_inertia (kg m^2): of all that turns with the input, e.g. 1.9e-5
        mass (kg): of the gear, e.g. 0.9
        nominal_life (h): L50 at rated torque and speed, e.g. 35000.0
        efficiency (1): at rated torque, or the maker's curves, e.g. 0.77
        back_efficiency (1): where the load drives; below 0 of a self-locking gear, e.g. 0.7
        no_load_running_torque (N m): at the input, at `no_load_speed`, e.g. 0.05
        no_load_speed (rad/s): of the input, of the running torque, e.g. 209.4
        starting_torque (N m): at the input, that starts it without load, e.g. 0.037
        back_driving_torque (N m or N): at the output, that starts it without load, e.g. 3.9
        stiffness (N m/rad): of the output, N/m of a linear one: a number (K1, where several are
            printed), or lines as a scene's transmission takes them, e.g. {k1: 16000, k2: 25000,
            k3: 29000, t1: 7.0, t2: 25.0}
        hysteresis (rad): hysteresis loss, the whole width at zero torque, e.g. 2.9e-4
        stroke (m): of a linear output, e.g. 0.3
        bearing: of its output; of a screw, its nut, e.g. {kind: crossed roller, max_moment: 91.0}
    """

    ratio: Positive | tuple[Positive, ...]
    kind: str = ""
    output: Literal["rotary", "linear"] = "rotary"
    rated_torque: Positive | None = None
    average_torque: Positive | None = None
    repeated_peak_torque: Positive | None = None
    momentary_peak_torque: Positive | None = None
    momentary_peaks: Positive | None = None
    rated_speed: Positive | None = None
    average_input_speed: Positive | None = None
    max_input_speed: Positive | None = None
    input_inertia: NonNegative | None = None
    mass: Positive | None = None
    nominal_life: Positive | None = None
    efficiency: Annotated[
        float | MakersEfficiency | None,
        BeforeValidator(
            number_or(MakersEfficiency.model_validate, Share),
            json_schema_input_type=Share | MakersEfficiency | None,
        ),
    ] = None
    back_efficiency: Annotated[Number, Field(le=1)] | None = None
    no_load_running_torque: NonNegative | None = None
    no_load_speed: Positive | None = None
    starting_torque: NonNegative | None = None
    back_driving_torque: Positive | None = None
    stiffness: Stiffness = None
    hysteresis: Positive | None = None
    stroke: Positive | None = None
    bearing: BearingRatings | None = None

    @model_validator(mode="after")
    def _figures_agree(self) -> Gear:
        _ascending(self, "rated_torque", "repeated_peak_torque")
        _ascending(self, "repeated_peak_torque", "momentary_peak_torque")
        _ascending(self, "average_input_speed", "max_input_speed")
        if self.bearing is not None and self.bearing.screw != (self.output == "linear"):
            raise ValueError(f"bearing: {self.bearing.kind} at a {self.output} output; linear ones "
                             "take `ball screw`, and only they")  # fmt: skip
        if not self.ratios:
            raise ValueError("ratio: an empty list; give at least one")
        for ratio in self.ratios:
            if isinstance(self.efficiency, MakersEfficiency):
                values = {"ratio": ratio, "efficiency": self.efficiency, **self.no_load()}
                driving_loss(Transmission.model_construct(**values))
            elif self.no_load_running_torque is not None and self.efficiency is not None:
                self._check_no_load(ratio, self.efficiency)
        return self

    @property
    def ratios(self) -> tuple[float, ...]:
        """All ratios this entry comes in."""
        return self.ratio if isinstance(self.ratio, tuple) else (self.ratio,)

    def no_load(self) -> dict[str, Any]:
        """Return `no_load_torque` and `motor_viscous` of a transmission, as far as printed.

        n_run = starting torque + viscous x speed; without a running torque the starting torque is
        all there is, of which an efficiency that is a number at rated torque knows nothing.
        """
        starting, running = self.starting_torque, self.no_load_running_torque
        viscous = 0.0
        if running is None:
            running = (starting or 0.0) if isinstance(self.efficiency, MakersEfficiency) else 0.0
        elif starting is not None and self.no_load_speed is not None and running >= starting:
            viscous, running = (running - starting) / self.no_load_speed, starting
        return {"no_load_torque": constant_friction(running), "motor_viscous": linear_drag(viscous)}

    def back_driving(self, ratio: float) -> tuple[BackDriving, float] | None:
        """Return the torques that start it without load, and eta_b by them; None if above 1."""
        if not self.starting_torque or self.back_driving_torque is None:
            return None
        found = ratio * self.starting_torque / self.back_driving_torque
        torques = BackDriving(starting_torque=self.starting_torque,
                              back_driving_torque=self.back_driving_torque)  # fmt: skip
        return (torques, found) if found <= 1.0 else None

    def _check_no_load(self, ratio: float, efficiency: float) -> None:
        assert self.no_load_running_torque is not None
        if self.rated_torque is None:
            raise ValueError("no_load_running_torque beside `efficiency` needs `rated_torque`, to "
                             "take the two apart")  # fmt: skip
        loss = self.rated_torque / ratio * (1 / efficiency - 1)
        if self.no_load_running_torque > loss:
            raise ValueError(
                f"no_load_running_torque {self.no_load_running_torque:g} N m is more than the "
                f"whole loss at rated torque, {loss:.3g} N m at the input (efficiency "
                f"{efficiency:g}): is it at the output, or in N cm?"
            )


class BearingEntry(Sourced):
    """Friction mu x (radial |F_r| + axial |F_a| + moment |M_b|), the levers x a diameter.

    Attributes:
        mu (1): coefficient in motion, e.g. 0.0015
        mu_range (1): least and greatest where the maker prints a range, e.g. [0.001, 0.003]
        radial (1): lever of the radial force per bore or raceway diameter, e.g. 0.5
        axial (1): of the axial force, e.g. 0.5
        moment (1): of the tilting moment, per m, e.g. 2.05
        ratings: what it carries, for a joint that `conditions.bearings` gives it to, e.g. {kind:
            crossed roller, max_moment: 91.0}
    """

    mu: Positive | None = None
    mu_range: tuple[NonNegative, NonNegative] | None = None
    radial: NonNegative = 0.0
    axial: NonNegative = 0.0
    moment: NonNegative = 0.0
    ratings: BearingRatings | None = None

    def scene_entry(self, diameter: float) -> dict[str, Any]:
        """Return the `bearing` of a scene's joint for a bore or raceway of `diameter` (m)."""
        return {
            "kind": "linear",
            "radial": self.radial * diameter,
            "axial": self.axial * diameter,
            "moment": self.moment,
        }


class Brake(Sourced):
    """A brake that holds without power, at a motor's shaft.

    Attributes:
        torque (N m): that it holds, e.g. 0.5
        voltage (V): that opens it, e.g. 24.0
        power (W): while it is open, e.g. 7.0
        release_time (s): until it is open, e.g. 0.025
        engage_time (s): until it holds, e.g. 0.015
        stop_energy (J): that it bears in one emergency stop, e.g. 150.0
        rotor_inertia (kg m^2): of what turns with the motor, e.g. 1.0e-6
        mass (kg): of the brake, e.g. 0.2
    """

    torque: Positive
    voltage: Positive | None = None
    power: Positive | None = None
    release_time: Positive | None = None
    engage_time: Positive | None = None
    stop_energy: Positive | None = None
    rotor_inertia: Positive | None = None
    mass: Positive | None = None


class Collisions(Entry):
    """Overloads that a gear must bear in its life.

    Attributes:
        count (1): how many, e.g. 100
        duration (s): of each, e.g. 0.15
    """

    count: Positive
    duration: Positive


class Conditions(Entry):
    """What the drives must stand, with the defaults of common practice.

    Attributes:
        bus_voltage (V): at the motors' terminals, e.g. 48.0
        ambient (deg C): temperature of the surroundings, e.g. 40.0
        peak_factor (1): reserve on the peak torque; 20 to 30 % are usual, e.g. 1.2
        inertia_ratio (1): largest J_load/(ratio^2 (J_motor + J_gear input)), e.g. 10.0
        life (h): L10 of gears and bearings; by default a strain wave gear's at rated torque and
            speed, e.g. 10000.0
        shock (1): factor on the loads of bearings and screws for their life: 1 to 1.2 smooth, 1.2
            to 1.5 normal, 1.5 to 3 with shocks, e.g. 1.2
        bearings: catalogue's bearing that carries a joint, in place of that at the gear's output,
            by joint, e.g. {elbow: THK RB 5013}
        back_driving: whether the load must be able to move the motor, must not, or may, e.g.
            required
        max_winding (deg C): for motors whose maker prints no limit; left out, it is not checked,
            e.g. 155.0
        thermal_time (s): in place of a winding's time constant that is not known: overload counts
            within it; small motors have 15 to 50 s, e.g. 20.0
        collision_effort (N m or N): in a collision or an emergency stop, by joint, e.g. {elbow:
            120.0}
        collisions: of them that a gear must bear in its life, e.g. {count: 100, duration: 0.15}
        holding_brake: whether every joint must have a brake, those that friction does not hold, or
            any may do without, e.g. where_needed
        brake_factor (1): reserve on the brakes' torque; 1.5 to 3 are usual, e.g. 1.5
        bus_limit (V): highest the bus may reach while motors brake, e.g. 56.0
        bus_capacitance (F): of the bus, e.g. 0.0047
        supply_power (W): most that the supply gives, e.g. 960.0
        resonance_base (Hz): least resonance of the first three joints, each with the joints beyond
            it, e.g. 8.0
        resonance_hand (Hz): of those beyond, e.g. 15.0
        lowest_frequency (Hz): that the robot's lowest natural frequency must reach, motors held;
            left out, any, e.g. 8.0
        tool_sag (m): that the load may pull the scene's `tool` off its place at rest, e.g. 2.0e-3
        tool_interval (m): half the width in which friction may hold the tool at rest, e.g. 2.0e-4
        tool_reversal (m): most between places after opposite approaches, e.g. 2.0e-4
        mass_in_urdf (kg): of the drive that the URDF's link already has at the joint's origin, by
            joint; it is taken off there, e.g. {elbow: 1.4}
    """

    bus_voltage: Positive = 48.0
    ambient: Number = REFERENCE_TEMPERATURE
    peak_factor: Annotated[Number, Field(ge=1)] = 1.2
    inertia_ratio: Positive = 10.0
    life: Positive = 10_000.0
    shock: Annotated[Number, Field(ge=1)] = 1.2
    bearings: dict[str, str] = Field(default_factory=dict)
    back_driving: Literal["any", "required", "forbidden"] = "any"
    max_winding: Number | None = None
    thermal_time: Positive = 20.0
    collision_effort: dict[str, Positive] = Field(default_factory=dict)
    collisions: Collisions | None = None
    holding_brake: Literal["any", "where_needed", "required"] = "any"
    brake_factor: Annotated[Number, Field(ge=1)] = 1.5
    bus_limit: Positive | None = None
    bus_capacitance: Positive | None = None
    supply_power: Positive | None = None
    resonance_base: Positive = 8.0
    resonance_hand: Positive = 15.0
    lowest_frequency: Positive | None = None
    tool_sag: Positive | None = None
    tool_interval: Positive | None = None
    tool_reversal: Positive | None = None
    mass_in_urdf: dict[str, NonNegative] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _bus_can_rise(self) -> Conditions:
        if self.bus_limit is not None and self.bus_limit <= self.bus_voltage:
            raise ValueError(f"bus_limit {self.bus_limit:g} V is not above bus_voltage "
                             f"{self.bus_voltage:g} V: how high may the bus rise?")  # fmt: skip
        return self


class CatalogFile(Entry):
    """A whole catalogue file.

    Attributes:
        pinfric_catalog: version of the format, e.g. 1
        extends: the bundled catalogue, whose entries stand beside those of the file, e.g. default
        motors: to choose from, e.g. {M 48: {source: data sheet, grade: R, continuous_torque: 0.45}}
        gears: to put behind them, e.g. {G 100: {source: data sheet, grade: R, ratio: 100}}
        gearmotors: both in one, e.g. {A 80: {source: data sheet, grade: R, ratio: 64}}
        bearings: for joints with one of their own, e.g. {ring: {source: data sheet, grade: R, mu:
            0.0015}}
        brakes: for motors' shafts, e.g. {B 5: {source: data sheet, grade: R, torque: 0.5}}
        conditions: what the drives must stand, e.g. {bus_voltage: 24.0}
    """

    pinfric_catalog: Version
    extends: Literal["default"] | None = None
    motors: dict[str, Motor] = Field(default_factory=dict)
    gears: dict[str, Gear] = Field(default_factory=dict)
    gearmotors: dict[str, GearMotor] = Field(default_factory=dict)
    bearings: dict[str, BearingEntry] = Field(default_factory=dict)
    brakes: dict[str, Brake] = Field(default_factory=dict)
    conditions: Conditions | None = None


@dataclass(frozen=True)
class Catalog:
    """What can be chosen from, by name.

    Attributes:
        source: the file, or "default" for the bundled ones.
        motors, gears, gearmotors, bearings, brakes: name -> entry.
        conditions: what the file demands of the drives.
    """

    source: str
    motors: Mapping[str, Motor] = field(default_factory=dict)
    gears: Mapping[str, Gear] = field(default_factory=dict)
    gearmotors: Mapping[str, GearMotor] = field(default_factory=dict)
    bearings: Mapping[str, BearingEntry] = field(default_factory=dict)
    brakes: Mapping[str, Brake] = field(default_factory=dict)
    conditions: Conditions = field(default_factory=Conditions)


def load_catalog(name: str | Path = DEFAULT) -> Catalog:
    """Read a catalogue: a YAML file, or "default" for the bundled motors, gears and bearings.

    A file that says `extends: default` has the bundled entries beside its own.

    Args:
        name: the file.

    Raises:
        CatalogError: it cannot be read, has unknown keys or figures that cannot be.

    Warns:
        PinfricWarning: a figure is so unusual that a wrong unit is likelier.
    """
    if str(name) == DEFAULT and not os.path.isfile(name):
        catalog = _merged(DEFAULT, _bundled())
    else:
        file = _read(Path(name))
        if file.extends is None and not any(getattr(file, section) for section in _SECTIONS):
            raise CatalogError(f"{name}: no motors, gears, gearmotors, bearings or brakes in it; "
                               "`extends: default` takes the bundled ones")  # fmt: skip
        catalog = _merged(str(name), [*(_bundled() if file.extends else ()), file])
    for where, text in _doubts(catalog):
        warnings.warn(f"{catalog.source}: {where}: {text}", PinfricWarning, stacklevel=2)
    return catalog


def parse_conditions(
    given: Conditions | Mapping[str, Any] | None, default: Conditions
) -> Conditions:
    """Return `default` with what `given` says otherwise.

    Raises:
        CatalogError: an unknown condition or a value that cannot be.
    """
    if given is None:
        return default
    if isinstance(given, Conditions):
        return given
    return parse(Conditions, {**default.model_dump(), **given}, "conditions", CatalogError)


@cache
def _bundled() -> tuple[CatalogFile, ...]:
    return tuple(_read(path) for path in sorted(_FOLDER.glob("*.yaml")))


def _merged(source: str, files: Sequence[CatalogFile]) -> Catalog:
    """All entries of the files; of the same name, and of the conditions, the last file's."""
    entries = {
        section: {name: entry for file in files for name, entry in getattr(file, section).items()}
        for section in _SECTIONS
    }
    return Catalog(source, **entries, conditions=files[-1].conditions or Conditions())


def _read(path: Path) -> CatalogFile:
    if not os.path.exists(path) and path.suffix not in (".yaml", ".yml"):
        raise CatalogError(f"there is no catalogue {brief(str(path))}; "
                           f"{choose_from(path, [DEFAULT])}, or a YAML file")  # fmt: skip
    return parse(CatalogFile, read_yaml(path, CatalogError), str(path), CatalogError)


def _ascending(entry: Sourced, smaller: str, larger: str) -> None:
    low, high = getattr(entry, smaller), getattr(entry, larger)
    if low is not None and high is not None and low > high:
        raise ValueError(f"{smaller} {low:g} is more than {larger} {high:g}: swapped, or a unit?")


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
    "rotor_inertia": (1e-10, 0.05, "kg cm^2 or g cm^2"),
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


def _doubts(catalog: Catalog) -> Iterator[tuple[str, str]]:
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
    usual = _USUAL | (_USUAL_OF_GEARS if section == "gears" else {})
    for key, (least, greatest, slip) in usual.items():
        value = getattr(entry, key, None)
        if key == "stiffness" and value is not None:
            value = softest(value)
        unit = "motor turns per output turn" if key == "ratio" else unit_of(key)
        if value is None or getattr(entry, "output", "") == "linear":
            continue
        for x in value if isinstance(value, tuple) else (value,):
            if not (least <= x <= greatest or (x == 0 and key == "input_inertia")):
                yield (f"{key} = {x:g} {unit} is far from anything usual, {least:g} to "
                       f"{greatest:g} {unit}; {slip} entered?")  # fmt: skip


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
            yield (f"rotor inertia {inertia:g} kg m^2 does not go with {torque:g} N m; kg cm^2 "
                   "(1e-4) or g cm^2 (1e-7), or mN m entered?")  # fmt: skip
    if torque and mass and section in _TORQUE_PER_MASS:
        low, high = _TORQUE_PER_MASS[section]
        if not low <= torque / mass <= high:
            yield (f"continuous torque {torque:g} N m at {mass:g} kg is {torque / mass:.3g} "
                   "N m/kg; mN m or g entered?")  # fmt: skip


def _speeds_beyond_proportion(section: str, entry: Motor | GearMotor) -> Iterator[str]:
    """Question speeds that do not go with each other, or with torque and mass."""
    nominal = entry.no_load_speed or entry.rated_speed
    if entry.max_speed and nominal and entry.max_speed > _SPEED_OVER_NOMINAL * nominal:
        yield (f"max_speed = {entry.max_speed:g} rad/s is {entry.max_speed / nominal:.3g} times "
               f"the speed at the nominal voltage, {nominal:g} rad/s; up to "
               f"{_SPEED_OVER_NOMINAL:g} times expected; rpm entered?")  # fmt: skip
        return
    torque, mass = entry.continuous_torque, entry.mass
    if not (torque and mass) or torque / mass > _TORQUE_PER_MASS[section][1]:
        return  # the torque or the mass is in question, not the speed
    for key in ("max_speed", "no_load_speed", "rated_speed"):
        speed = getattr(entry, key)
        if speed and torque * speed / mass > _POWER_PER_MASS:
            yield (f"{key} = {speed:g} rad/s at continuous_torque {torque:g} N m and {mass:g} kg "
                   f"is {torque * speed / mass:.3g} W/kg; up to {_POWER_PER_MASS:g} W/kg expected; "
                   "rpm entered?")  # fmt: skip


def _line_beyond_proportion(motor: Motor) -> Iterator[str]:
    """Question a torque constant beside k omega_0 = U, and a stall torque beside k U/R."""
    k, voltage = motor.torque_constant, motor.nominal_voltage
    if k is None or voltage is None:
        return
    if motor.no_load_speed is not None:
        expected = voltage / motor.no_load_speed
        if not _BACK_EMF[0] <= k / expected <= _BACK_EMF[1]:
            yield (f"torque_constant = {k:g} N m/A; about nominal_voltage/no_load_speed = "
                   f"{expected:.3g} N m/A expected; one of them in another unit?")  # fmt: skip
    if motor.stall_torque is not None and motor.resistance is not None:
        expected = k * voltage / motor.resistance
        if not _STALL[0] <= motor.stall_torque / expected <= _STALL[1]:
            yield (f"stall_torque = {motor.stall_torque:g} N m; about torque_constant x "
                   f"nominal_voltage/resistance = {expected:.3g} N m expected: mN m, or another "
                   "unit of them?")  # fmt: skip


def _unusual_heat(thermal: Thermal) -> Iterator[str]:
    winding, housing = thermal.winding_time, thermal.housing_time
    if (thermal.max_winding or 0) > 250:
        yield f"max_winding = {thermal.max_winding:g} C, at most 250 C expected; kelvin entered?"
    if winding is not None and winding < _LEAST_WINDING_TIME:
        yield (f"winding_time = {winding:g} s; more than {_LEAST_WINDING_TIME:g} s expected; "
               "minutes entered?")  # fmt: skip
    if winding is not None and housing is not None and winding >= housing:
        yield (f"winding_time = {winding:g} s; less than housing_time = {housing:g} s expected; "
               "one of them in ms or minutes, or swapped?")  # fmt: skip
