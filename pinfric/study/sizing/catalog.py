"""Catalogues of motors, gears, gearmotors, bearings, brakes, amplifiers: makers' figures, sources.

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
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from pinfric.errors import CatalogError, PinfricWarning, choose_from
from pinfric.model.entry import Entry, Forms, NonNegative, Number, Positive, Version, key, parse
from pinfric.model.friction_terms import constant_friction, linear_drag
from pinfric.model.springs import Stiffness, softest
from pinfric.model.transmission import (
    BackDriving,
    Efficiency,
    MakersEfficiency,
    Transmission,
    driving_loss,
)
from pinfric.model.yamlfile import brief, read_yaml
from pinfric.study.sizing.bearing import BearingRatings
from pinfric.study.sizing.units import unit_of

#: The bundled catalogue's name, and its folder.
DEFAULT = "default"
_FOLDER = Path(__file__).parents[2] / "catalog"
_SECTIONS = ("motors", "gears", "gearmotors", "bearings", "brakes", "amplifiers")
#: In place of a drive's name: all drives that are not named.
OTHERS = "others"
#: Ambient temperature to which makers refer resistances and ratings, degrees Celsius.
REFERENCE_TEMPERATURE = 25.0

Text = Annotated[str, Field(min_length=1)]


class Sourced(Entry):
    """Source of an entry's figures."""

    source: Annotated[Text, key("maker's document and page", "a maker's catalogue, p. 197")]
    grade: Annotated[
        Literal["R", "T"],
        key("R: read in the maker's document, T: retyped by a third party", "R"),
    ]
    note: Annotated[str, key("remarks", "peak printed without a duration")] = ""
    price: Annotated[Positive | None, key("of one piece", 310.0, "of the catalogue's currency")] = (
        None
    )
    dimensions: Annotated[str, key("in words", "60 mm x 88 mm")] = ""
    stand_ins: Annotated[
        dict[str, str],
        key("values taken from another product, and which", {"stiffness": "the next smaller size"}),
    ] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _stand_ins_are_figures(self) -> Sourced:
        for name in self.stand_ins:
            if getattr(self, name, None) is None:
                raise ValueError(f"stand_ins: {name!r} is not a figure of this entry")
        return self


class Thermal(Entry):
    """Two-node model of a motor: winding and housing."""

    winding_housing: Annotated[
        Positive, key("thermal resistance between winding and housing", 1.2, "K/W")
    ]
    housing_ambient: Annotated[Positive, key("between housing and surroundings", 3.0, "K/W")]
    winding_time: Annotated[Positive | None, key("time constant of the winding", 30.0, "s")] = None
    housing_time: Annotated[Positive | None, key("of the motor", 900.0, "s")] = None
    max_winding: Annotated[
        Number | None, key("highest permissible temperature of the winding", 155.0, "deg C")
    ] = None


class Rated(Sourced):
    """Temperatures to which continuous ratings refer."""

    rated_ambient: Annotated[
        Number, key("ambient temperature of the continuous ratings", 40.0, "deg C")
    ] = REFERENCE_TEMPERATURE
    ambient_curve: Annotated[
        tuple[tuple[Number, NonNegative], ...] | None,
        key(
            "the maker's derating: points of ambient temperature (deg C) and share of the "
            "continuous ratings",
            [[40.0, 1.0], [60.0, 0.8]],
        ),
    ] = None
    thermal_time: Annotated[
        Positive | None,
        key(
            "thermal time constant of the whole motor, if only one is printed",
            1500.0,
            "s",
        ),
    ] = None

    @model_validator(mode="after")
    def _curve_rises_in_temperature(self) -> Rated:
        at = [point[0] for point in self.ambient_curve or ()]
        if any(b <= a for a, b in pairwise(at)) or len(at) == 1:
            raise ValueError("ambient_curve: points [deg C, part], ascending in deg C, two or more")
        return self


class Motor(Rated):
    """A motor: torques and speeds at its shaft."""

    continuous_torque: Annotated[Positive | None, key("continuous torque", 0.45, "N m")] = None
    continuous_curve: Annotated[
        tuple[tuple[NonNegative, Positive], ...] | None,
        key(
            "continuous torque over speed: points of speed (rad/s) and torque (N m)",
            [[0.0, 0.45], [400.0, 0.3]],
        ),
    ] = None
    continuous_stall_torque: Annotated[
        Positive | None, key("continuous torque at standstill", 0.4, "N m")
    ] = None
    continuous_current: Annotated[
        Positive | None, key("current at the continuous torque", 6.0, "A")
    ] = None
    peak_torque: Annotated[Positive | None, key("largest torque for a short time", 1.3, "N m")] = (
        None
    )
    torque_constant: Annotated[Positive | None, key("torque per current", 0.075, "N m/A")] = None
    current: Annotated[
        Literal["dc", "rms", "peak"],
        key(
            "kind of current of the torque constant and the continuous current: DC or block "
            "commutation, or RMS or peak of a sinusoidal phase current",
            "rms",
        ),
    ] = "dc"
    resistance: Annotated[Positive | None, key("of the winding at 25 C", 0.35, "Ohm")] = None
    resistance_of: Annotated[
        Literal["terminals", "phase"],
        key("measured between two terminals, or from one phase to the star point", "phase"),
    ] = "terminals"
    rotor_inertia: Annotated[Positive | None, key("of the rotor", 3e-05, "kg m^2")] = None
    mass: Annotated[Positive | None, key("of the motor", 0.6, "kg")] = None
    max_speed: Annotated[Positive | None, key("permissible", 600.0, "rad/s")] = None
    nominal_voltage: Annotated[
        Positive | None, key("for which the speeds and the stall torque are given", 48.0, "V")
    ] = None
    no_load_speed: Annotated[
        Positive | None, key("at nominal voltage without load", 550.0, "rad/s")
    ] = None
    rated_speed: Annotated[
        Positive | None, key("at nominal voltage and continuous torque", 450.0, "rad/s")
    ] = None
    stall_torque: Annotated[
        Positive | None, key("at nominal voltage, start of the speed-torque line", 3.2, "N m")
    ] = None
    thermal: Annotated[
        Thermal | None,
        key("for the winding's temperature", {"winding_housing": 1.2, "housing_ambient": 3.0}),
    ] = None

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
    """Friction of a gearmotor at its output: base + load_dependent |effort| + viscous |v|."""

    base: Annotated[NonNegative, key("independent of the load", 0.5, "N m or N")] = 0.0
    load_dependent: Annotated[
        Number, Field(ge=0, lt=1), key("share of the effort, below 1", 0.1, "1")
    ] = 0.0
    viscous: Annotated[NonNegative, key("per speed of the output", 0.2, "N m s/rad or N s/m")] = 0.0


class GearMotor(Rated):
    """Motor and gear in one: torques, speeds and friction at the output, rotor at the motor.

    Where `output` is linear these are N, m/s and, of a linear motor (ratio 1), the mass that moves
    with its force (kg, as `rotor_inertia`).
    """

    ratio: Annotated[
        Positive, key("motor turns per turn of the output; rad/m of a linear one", 64.0, "1")
    ]
    output: Annotated[Literal["rotary", "linear"], key("motion of its output", "rotary")] = "rotary"
    continuous_torque: Annotated[Positive | None, key("continuous output", 48.0, "N m or N")] = None
    peak_torque: Annotated[
        Positive | None, key("largest output for a short time", 120.0, "N m or N")
    ] = None
    nominal_voltage: Annotated[
        Positive | None, key("for which the speeds are given", 48.0, "V")
    ] = None
    no_load_speed: Annotated[Positive | None, key("without load", 6.0, "rad/s or m/s")] = None
    rated_speed: Annotated[Positive | None, key("at continuous torque", 5.0, "rad/s or m/s")] = None
    max_speed: Annotated[Positive | None, key("permissible", 7.0, "rad/s or m/s")] = None
    rotor_inertia: Annotated[
        Positive | None, key("of the rotor, at the motor's speed", 5e-05, "kg m^2")
    ] = None
    mass: Annotated[Positive | None, key("of motor and gear", 0.85, "kg")] = None
    friction: Annotated[
        OutputFriction | None, key("at the output", {"base": 0.5, "load_dependent": 0.1})
    ] = None
    back_driving_torque: Annotated[
        Positive | None, key("at the output, turns it without current", 1.5, "N m or N")
    ] = None
    bearing: Annotated[
        BearingRatings | None,
        key("ratings of its output bearing", {"kind": "crossed roller", "max_moment": 40.0}),
    ] = None

    @model_validator(mode="after")
    def _figures_agree(self) -> GearMotor:
        _ascending(self, "continuous_torque", "peak_torque")
        _ascending(self, "rated_speed", "no_load_speed")
        if (self.no_load_speed or self.rated_speed) and self.nominal_voltage is None:
            raise ValueError("no_load_speed and rated_speed need `nominal_voltage`")
        return self


class Screw(Entry):
    """A screw between its supports."""

    root_diameter: Annotated[Positive, key("of the thread's root", 0.0125, "m")]
    length: Annotated[Positive, key("longest free length between the supports", 0.79, "m")]
    supports: Annotated[
        Literal["fixed-free", "supported-supported", "fixed-supported", "fixed-fixed"],
        key("supports of its two ends", "fixed-supported"),
    ]
    ball_circle: Annotated[
        Positive | None, key("diameter of the circle of ball centres", 0.0155, "m")
    ] = None
    max_dn: Annotated[
        Positive | None,
        key("permissible ball circle diameter (mm) times speed (rpm)", 70000.0, "mm rpm"),
    ] = None
    elasticity: Annotated[Positive, key("of its material", 2.06e11, "Pa")] = 2.06e11
    density: Annotated[Positive, key("of its material", 7850.0, "kg/m^3")] = 7850.0


class Nut(Entry):
    """A nut that slides on a lead screw's thread."""

    diameter: Annotated[Positive, key("pitch diameter of the thread", 0.01, "m")]
    contact_area: Annotated[
        Positive, key("between thread and nut, as the maker counts it", 1.2e-4, "m^2")
    ]
    max_pressure: Annotated[
        Positive | None, key("permissible pressure on that area", 5e6, "Pa")
    ] = None
    max_pv: Annotated[
        Positive | None, key("permissible pressure times sliding speed", 1e5, "Pa m/s")
    ] = None


class Gear(Sourced):
    """A gear: torques at its output unless named input; speeds and inertia at its input.

    `efficiency` is the maker's, no-load loss included: a number at rated torque, or his curves as a
    scene's transmission takes them (`transmission.MakersEfficiency`).
    """

    ratio: Annotated[
        Annotated[float | tuple[float, ...], Forms(Positive, tuple[Positive, ...])],
        key(
            "motor turns per output turn, or a list of ratios with the same figures; rad/m where "
            "the output is linear",
            [50, 80, 100],
            "1",
        ),
    ]
    kind: Annotated[str, key("type; strain wave gears have rules of their own", "strain wave")] = ""
    output: Annotated[
        Literal["rotary", "linear"], key("rotary, or linear with efforts in N", "rotary")
    ] = "rotary"
    rated_torque: Annotated[
        Positive | None, key("for which life and efficiency are given", 40.0, "N m or N")
    ] = None
    average_torque: Annotated[
        Positive | None, key("limit of the mean, weighted by speed", 49.0, "N m or N")
    ] = None
    repeated_peak_torque: Annotated[
        Positive | None, key("limit of a cycle's peaks", 82.0, "N m or N")
    ] = None
    momentary_peak_torque: Annotated[
        Positive | None, key("limit in a collision or an emergency stop", 147.0, "N m or N")
    ] = None
    momentary_peaks: Annotated[
        Positive | None, key("permissible number of momentary peaks in its life", 10000, "1")
    ] = None
    rated_speed: Annotated[
        Positive | None, key("of the input, for which the life is given", 209.4, "rad/s")
    ] = None
    average_input_speed: Annotated[Positive | None, key("limit of the mean", 366.0, "rad/s")] = None
    max_input_speed: Annotated[Positive | None, key("limit", 680.0, "rad/s")] = None
    input_inertia: Annotated[
        NonNegative | None, key("of all that turns with the input", 1.9e-05, "kg m^2")
    ] = None
    mass: Annotated[Positive | None, key("of the gear", 0.9, "kg")] = None
    nominal_life: Annotated[Positive | None, key("L50 at rated torque and speed", 35000.0, "h")] = (
        None
    )
    efficiency: Annotated[
        Efficiency | None, key("at rated torque, or the maker's curves", 0.77, "1")
    ] = None
    back_efficiency: Annotated[
        Annotated[Number, Field(le=1)] | None,
        key("when the load drives; below 0 for a self-locking gear", 0.7, "1"),
    ] = None
    no_load_running_torque: Annotated[
        NonNegative | None, key("at the input, at `no_load_speed`", 0.05, "N m")
    ] = None
    no_load_speed: Annotated[
        Positive | None, key("input speed of the no-load running torque", 209.4, "rad/s")
    ] = None
    starting_torque: Annotated[
        NonNegative | None, key("at the input, starts it without load", 0.037, "N m")
    ] = None
    back_driving_torque: Annotated[
        Positive | None, key("at the output, starts it without load", 3.9, "N m or N")
    ] = None
    stiffness: Annotated[
        Stiffness | None,
        key(
            "of the output, N/m of a linear one: a number (K1, where several are printed), or "
            "lines as a scene's transmission takes them",
            {"k1": 16000, "k2": 25000, "k3": 29000, "t1": 7.0, "t2": 25.0},
            "N m/rad",
        ),
    ] = None
    hysteresis: Annotated[
        Positive | None, key("hysteresis loss, the whole width at zero torque", 0.00029, "rad")
    ] = None
    backlash: Annotated[
        NonNegative | None, key("of the output, its input held: the whole angle", 0.00087, "rad")
    ] = None
    stroke: Annotated[Positive | None, key("of a linear output", 0.3, "m")] = None
    screw: Annotated[
        Screw | None,
        key(
            "for a screw's critical speed, buckling and the speed of its balls",
            {"root_diameter": 0.0125, "length": 0.79, "supports": "fixed-supported"},
        ),
    ] = None
    nut: Annotated[
        Nut | None,
        key(
            "of a lead screw, for its pressure and PV value",
            {"diameter": 0.01, "contact_area": 1.2e-4, "max_pv": 1e5},
        ),
    ] = None
    effort_curve: Annotated[
        tuple[tuple[NonNegative, Positive], ...] | None,
        key(
            "largest effort over input speed, as of a belt: points of speed (rad/s) and N m or N",
            [[0.0, 1070.0], [70.0, 890.0]],
        ),
    ] = None
    bearing: Annotated[
        BearingRatings | None,
        key("output bearing; of a screw, the nut", {"kind": "crossed roller", "max_moment": 91.0}),
    ] = None

    @model_validator(mode="after")
    def _figures_agree(self) -> Gear:
        _ascending(self, "rated_torque", "repeated_peak_torque")
        _ascending(self, "repeated_peak_torque", "momentary_peak_torque")
        _ascending(self, "average_input_speed", "max_input_speed")
        speeds = [point[0] for point in self.effort_curve or ()]
        if any(b <= a for a, b in pairwise(speeds)) or len(speeds) == 1:
            raise ValueError("effort_curve: points [rad/s, N or N m], speeds ascending, 2 or more")
        if self.bearing is not None and self.bearing.screw != (self.output == "linear"):
            raise ValueError(
                f"bearing: {self.bearing.kind} at a {self.output} output; a linear output needs "
                "`ball screw`, a rotary one another kind"
            )
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
        torques = BackDriving(
            starting_torque=self.starting_torque, back_driving_torque=self.back_driving_torque
        )
        return (torques, found) if found <= 1.0 else None

    def _check_no_load(self, ratio: float, efficiency: float) -> None:
        assert self.no_load_running_torque is not None
        if self.rated_torque is None:
            raise ValueError(
                "no_load_running_torque with `efficiency` needs `rated_torque`, to "
                "separate the two losses"
            )
        loss = self.rated_torque / ratio * (1 / efficiency - 1)
        if self.no_load_running_torque > loss:
            raise ValueError(
                f"no_load_running_torque {self.no_load_running_torque:g} N m is more than the "
                f"whole loss at rated torque, {loss:.3g} N m at the input (efficiency "
                f"{efficiency:g}): is it at the output, or in N cm?"
            )


class BearingEntry(Sourced):
    """Friction mu x (radial |F_r| + axial |F_a| + moment |M_b|), the levers x a diameter."""

    mu: Annotated[Positive | None, key("coefficient in motion", 0.0015, "1")] = None
    mu_range: Annotated[
        tuple[NonNegative, NonNegative] | None,
        key("smallest and largest, if the maker prints a range", [0.001, 0.003], "1"),
    ] = None
    radial: Annotated[
        NonNegative, key("lever of the radial force per bore or raceway diameter", 0.5, "1")
    ] = 0.0
    axial: Annotated[NonNegative, key("of the axial force", 0.5, "1")] = 0.0
    moment: Annotated[NonNegative, key("of the tilting moment, per m", 2.05, "1")] = 0.0
    ratings: Annotated[
        BearingRatings | None,
        key(
            "load ratings, needed if `conditions.bearings` names it",
            {"kind": "crossed roller", "max_moment": 91.0},
        ),
    ] = None

    def scene_entry(self, diameter: float) -> dict[str, Any]:
        """Return the `bearing` of a scene's joint for a bore or raceway of `diameter` (m)."""
        return {
            "kind": "linear",
            "radial": self.radial * diameter,
            "axial": self.axial * diameter,
            "moment": self.moment,
        }


class Brake(Sourced):
    """A brake that holds without power, at a motor's shaft."""

    torque: Annotated[Positive, key("holding torque", 0.5, "N m")]
    voltage: Annotated[Positive | None, key("to open it", 24.0, "V")] = None
    power: Annotated[Positive | None, key("while it is open", 7.0, "W")] = None
    release_time: Annotated[Positive | None, key("until it is open", 0.025, "s")] = None
    engage_time: Annotated[Positive | None, key("until it holds", 0.015, "s")] = None
    stop_energy: Annotated[
        Positive | None, key("permissible energy of one emergency stop", 150.0, "J")
    ] = None
    rotor_inertia: Annotated[
        Positive | None, key("of its parts that turn with the motor", 1e-06, "kg m^2")
    ] = None
    mass: Annotated[Positive | None, key("of the brake", 0.2, "kg")] = None


class Amplifier(Sourced):
    """An amplifier (servo drive), which feeds one motor."""

    continuous_current: Annotated[Positive | None, key("without end", 5.0, "A")] = None
    peak_current: Annotated[Positive | None, key("for a short time", 15.0, "A")] = None
    peak_time: Annotated[
        Positive | None, key("for which it may exceed the continuous current", 15.0, "s")
    ] = None
    current: Annotated[
        Literal["dc", "rms", "peak"],
        key(
            "kind of its currents: DC or block commutation, or RMS or peak of a sinusoidal phase "
            "current",
            "rms",
        ),
    ] = "rms"

    @model_validator(mode="after")
    def _figures_agree(self) -> Amplifier:
        _ascending(self, "continuous_current", "peak_current")
        return self


class Collisions(Entry):
    """Overloads that a gear must bear in its life."""

    count: Annotated[Positive, key("how many", 100, "1")]
    duration: Annotated[Positive, key("of each", 0.15, "s")]


class Conditions(Entry):
    """Conditions of operation, with the defaults of common practice."""

    bus_voltage: Annotated[Positive, key("at the motors' terminals", 48.0, "V")] = 48.0
    ambient: Annotated[Number, key("temperature of the surroundings", 40.0, "deg C")] = (
        REFERENCE_TEMPERATURE
    )
    peak_factor: Annotated[
        Number, Field(ge=1), key("reserve on the peak torque; 20 to 30 % are usual", 1.2, "1")
    ] = 1.2
    inertia_ratio: Annotated[
        Positive, key("largest permitted J_load/(ratio^2 (J_motor + J_gear input))", 10.0, "1")
    ] = 10.0
    life: Annotated[
        Positive,
        key(
            "L10 of gears and bearings; by default a strain wave gear's at rated torque and speed",
            10000.0,
            "h",
        ),
    ] = 10_000.0
    shock: Annotated[
        Number,
        Field(ge=1),
        key(
            "factor on the loads of bearings and screws for their life: 1 to 1.2 smooth, 1.2 to "
            "1.5 normal, 1.5 to 3 with shocks",
            1.2,
            "1",
        ),
    ] = 1.2
    bearings: Annotated[
        dict[str, str],
        key(
            "bearing of the catalogue that carries the joint, instead of that of the gear, "
            "or guide of a sliding joint; by joint",
            {"elbow": "THK RB 5013"},
        ),
    ] = Field(default_factory=dict)
    amplifiers: Annotated[
        dict[str, str],
        key(
            "amplifier of the catalogue that feeds the motor, by joint; `others`: of all joints "
            "that are not named",
            {"elbow": "EPOS4 50/5", "others": "EPOS4 50/15"},
        ),
    ] = Field(default_factory=dict)
    back_driving: Annotated[
        Literal["any", "required", "forbidden"],
        key("whether the load must, must not or may be able to move the motor", "required"),
    ] = "any"
    max_winding: Annotated[
        Number | None,
        key("for motors without a printed limit; left out: not checked", 155.0, "deg C"),
    ] = None
    thermal_time: Annotated[
        Positive,
        key(
            "used if a winding's time constant is not known: overload is averaged over it; "
            "small motors have 15 to 50 s",
            20.0,
            "s",
        ),
    ] = 20.0
    collision_effort: Annotated[
        dict[str, Positive],
        key("in a collision or an emergency stop, by joint", {"elbow": 120.0}, "N m or N"),
    ] = Field(default_factory=dict)
    collisions: Annotated[
        Collisions | None,
        key("number and duration in the gear's life", {"count": 100, "duration": 0.15}),
    ] = None
    holding_brake: Annotated[
        Literal["any", "where_needed", "required"],
        key(
            "which joints need a brake: all, those that friction does not hold, or none",
            "where_needed",
        ),
    ] = "any"
    brake_factor: Annotated[
        Number, Field(ge=1), key("reserve on the brakes' torque; 1.5 to 3 are usual", 1.5, "1")
    ] = 1.5
    bus_limit: Annotated[
        Positive | None, key("highest permissible bus voltage while motors brake", 56.0, "V")
    ] = None
    bus_capacitance: Annotated[Positive | None, key("of the bus", 0.0047, "F")] = None
    supply_power: Annotated[Positive | None, key("largest power of the supply", 960.0, "W")] = None
    supply_resistance: Annotated[
        Positive | None,
        key("of supply and cables: the bus sags by it times the current", 0.05, "Ohm"),
    ] = None
    resonance_base: Annotated[
        Positive,
        key("least resonance of the first three joints, each with the joints beyond it", 8.0, "Hz"),
    ] = 8.0
    resonance_hand: Annotated[Positive, key("of those beyond", 15.0, "Hz")] = 15.0
    lowest_frequency: Annotated[
        Positive | None,
        key(
            "required lowest natural frequency of the robot, motors held; left out: not checked",
            8.0,
            "Hz",
        ),
    ] = None
    tool_sag: Annotated[
        Positive | None,
        key("largest displacement of the scene's `tool` at rest by the load", 0.002, "m"),
    ] = None
    tool_interval: Annotated[
        Positive | None,
        key("largest half-width of the tool's positions that friction holds at rest", 0.0002, "m"),
    ] = None
    tool_reversal: Annotated[
        Positive | None, key("largest distance after opposite approaches", 0.0002, "m")
    ] = None
    backlash: Annotated[
        Positive | None, key("largest backlash of a joint's gear", 0.0003, "rad or m")
    ] = None
    reversal_error: Annotated[
        Positive | None,
        key(
            "largest difference of a joint's positions after opposite approaches: wind-up by "
            "friction, hysteresis and backlash of its gear",
            0.0005,
            "rad or m",
        ),
    ] = None
    mass_in_urdf: Annotated[
        dict[str, NonNegative],
        key(
            "mass of the drive that the URDF's link already includes at the joint's origin, by "
            "joint; it is subtracted there",
            {"elbow": 1.4},
            "kg",
        ),
    ] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _bus_can_rise(self) -> Conditions:
        if self.bus_limit is not None and self.bus_limit <= self.bus_voltage:
            raise ValueError(
                f"bus_limit {self.bus_limit:g} V is not above bus_voltage "
                f"{self.bus_voltage:g} V: how high may the bus rise?"
            )
        return self


class CatalogFile(Entry):
    """A whole catalogue file."""

    pinfric_catalog: Annotated[Version, key("version of the format", 1)]
    extends: Annotated[
        Literal["default"] | None,
        key("also use the entries of the bundled catalogue", "default"),
    ] = None
    motors: Annotated[
        dict[str, Motor],
        key(
            "to choose from",
            {"M 48": {"source": "data sheet", "grade": "R", "continuous_torque": 0.45}},
        ),
    ] = Field(default_factory=dict)
    gears: Annotated[
        dict[str, Gear],
        key(
            "to combine with motors",
            {"G 100": {"source": "data sheet", "grade": "R", "ratio": 100}},
        ),
    ] = Field(default_factory=dict)
    gearmotors: Annotated[
        dict[str, GearMotor],
        key("motor with gear", {"A 80": {"source": "data sheet", "grade": "R", "ratio": 64}}),
    ] = Field(default_factory=dict)
    bearings: Annotated[
        dict[str, BearingEntry],
        key(
            "for joints with a separate bearing",
            {"ring": {"source": "data sheet", "grade": "R", "mu": 0.0015}},
        ),
    ] = Field(default_factory=dict)
    brakes: Annotated[
        dict[str, Brake],
        key("for motors' shafts", {"B 5": {"source": "data sheet", "grade": "R", "torque": 0.5}}),
    ] = Field(default_factory=dict)
    amplifiers: Annotated[
        dict[str, Amplifier],
        key(
            "that feed motors",
            {"A 5": {"source": "data sheet", "grade": "R", "continuous_current": 5.0}},
        ),
    ] = Field(default_factory=dict)
    conditions: Annotated[
        Conditions | None, key("conditions of operation", {"bus_voltage": 24.0})
    ] = None


@dataclass(frozen=True)
class Catalog:
    """Products to choose from, by name.

    Attributes:
        source: the file, or "default" for the bundled ones.
        motors, gears, gearmotors, bearings, brakes, amplifiers: name -> entry.
        conditions: what the file demands of the drives.
        replaced: entries of the file that stand in place of bundled ones, in words.
    """

    source: str
    motors: Mapping[str, Motor] = field(default_factory=dict)
    gears: Mapping[str, Gear] = field(default_factory=dict)
    gearmotors: Mapping[str, GearMotor] = field(default_factory=dict)
    bearings: Mapping[str, BearingEntry] = field(default_factory=dict)
    brakes: Mapping[str, Brake] = field(default_factory=dict)
    amplifiers: Mapping[str, Amplifier] = field(default_factory=dict)
    conditions: Conditions = field(default_factory=Conditions)
    replaced: tuple[str, ...] = ()


def load_catalog(name: str | Path = DEFAULT) -> Catalog:
    """Read a catalogue: a YAML file, or "default" for the bundled motors, gears and bearings.

    A file that says `extends: default` has the bundled entries beside its own.

    Args:
        name: the file.

    Raises:
        CatalogError: it cannot be read, has unknown keys or figures that cannot be.

    Warns:
        PinfricWarning: a figure is so unusual that a wrong unit is likelier; an entry replaces a
            bundled one of its name.
    """
    if str(name) == DEFAULT and not os.path.isfile(name):
        catalog = _merged(DEFAULT, _bundled())
    else:
        file = _read(Path(name))
        if file.extends is None and not any(getattr(file, section) for section in _SECTIONS):
            raise CatalogError(
                f"{name}: no motors, gears, gearmotors, bearings, brakes or amplifiers in it; "
                "`extends: default` takes the bundled ones"
            )
        bundled = _bundled() if file.extends else ()
        replaced = tuple(_replaced(bundled, file))
        catalog = replace(_merged(str(name), [*bundled, file]), replaced=replaced)
        for text in replaced:
            warnings.warn(f"{name}: {text}", PinfricWarning, stacklevel=2)
    for where, text in _doubts(catalog):
        warnings.warn(f"{catalog.source}: {where}: {text}", PinfricWarning, stacklevel=2)
    return catalog


def parse_conditions(
    given: Conditions | Mapping[str, Any] | None, default: Conditions
) -> Conditions:
    """Return `default` with the values of `given` replaced.

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
    entries: dict[str, Any] = {
        section: {name: entry for file in files for name, entry in getattr(file, section).items()}
        for section in _SECTIONS
    }
    return Catalog(source, **entries, conditions=files[-1].conditions or Conditions())


def _replaced(bundled: Sequence[CatalogFile], file: CatalogFile) -> Iterator[str]:
    """Say which bundled entries a file's own take the place of."""
    for section in _SECTIONS:
        there = {name for other in bundled for name in getattr(other, section)}
        for name in getattr(file, section):
            if name in there:
                yield f"{section}.{name} replaces the bundled entry of that name"


def _read(path: Path) -> CatalogFile:
    if not os.path.exists(path) and path.suffix not in (".yaml", ".yml"):
        raise CatalogError(
            f"there is no catalogue {brief(str(path))}; "
            f"{choose_from(path, [DEFAULT])}, or a YAML file"
        )
    return parse(
        CatalogFile, read_yaml(path, CatalogError, "pinfric_catalog"), str(path), CatalogError
    )


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
    for rating, (least, greatest, slip) in usual.items():
        value = getattr(entry, rating, None)
        if rating == "stiffness" and value is not None:
            value = softest(value)
        unit = "motor turns per output turn" if rating == "ratio" else unit_of(rating)
        if value is None or getattr(entry, "output", "") == "linear":
            continue
        for x in value if isinstance(value, tuple) else (value,):
            if not (least <= x <= greatest or (x == 0 and rating == "input_inertia")):
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
    """Question speeds that do not go with each other, or with torque and mass."""
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
    """Question a torque constant beside k omega_0 = U, and a stall torque beside k U/R."""
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
