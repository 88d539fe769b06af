"""Catalogues of motors, gears, gearmotors, bearings, brakes, amplifiers: makers' figures, sources.

A missing figure stays missing: criteria that need it say so. SI units, temperatures in degrees
Celsius; `grade` R is a figure read at the maker's own document, T one retyped by a third party.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import asin, cos, pi
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np
from pydantic import Field, model_validator

from pinfric.drives.bearing import BearingRatings
from pinfric.drives.kinds import KindSections, KindsOfMotors
from pinfric.drives.kinds.kind import Kind
from pinfric.drives.policy import REFERENCE_TEMPERATURE, Conditions
from pinfric.drives.sourced import Sourced, ascending, rising
from pinfric.drives.thermal import Thermal
from pinfric.model.brakes import BRAKE_PEAK, HoldingBrake
from pinfric.model.entry import (
    Entry,
    Forms,
    NonNegative,
    Number,
    Positive,
    Text,
    Version,
    key,
    optional,
)
from pinfric.model.friction_terms import constant_friction, linear_drag
from pinfric.model.springs import Stiffness
from pinfric.model.transmission import (
    BackDriving,
    Efficiency,
    MakersEfficiency,
    Transmission,
)

#: Kind of gear -> no-load running torque over rated torque, both at the input, where none is
#: printed. Strain wave: Schaeffler RT1-H-CS 25, the largest of its series (both grow with the cube
#: of the size: 0.035 to 0.195 N m of sizes 14 to 25); planetary: nine in ten of 83 that print it
#: have less. At most the whole loss at rated torque, which cycloidal gears get.
DRAG = {"strain wave": 0.224, "planetary": 0.17, "cycloidal": 1.0}
#: Of that torque what starts it; eta_b by the starting torques; rad/s: of the same series.
DRAG_AT_START, DRAG_BACK, DRAG_SPEED = 0.354, 0.95, 209.4
BY_RULE = "by rule"
#: deg C, at which makers of gears print losses.
WARM = 20.0
#: Ambient temperature, deg C -> losses of a strain wave gear over those at 20 C. CSD-20/25-100 at
#: 2000 rpm: 64, 44, 31 % at 20, 0, -10 C, so 1/eta - 1 = 0.5625, 1.273, 2.226.
COLD = ((-10.0, 3.96), (0.0, 2.26), (20.0, 1.0))


class RatedEntry(Sourced):
    """Temperatures to which continuous ratings refer."""

    rated_ambient: Number = key(
        "ambient temperature of the continuous ratings",
        40.0,
        "deg C",
        default=REFERENCE_TEMPERATURE,
    )
    ambient_curve: tuple[tuple[Number, NonNegative], ...] | None = optional(
        "the maker's derating: points of ambient temperature (deg C) and share of the "
        "continuous ratings",
        [[40.0, 1.0], [60.0, 0.8]],
    )
    thermal_time: Positive | None = optional(
        "thermal time constant of the whole motor, if only one is printed", 1500.0, "s"
    )

    @model_validator(mode="after")
    def _curve_rises_in_temperature(self) -> RatedEntry:
        rising(self, "ambient_curve", "deg C, part")
        return self


class Motor(KindsOfMotors, RatedEntry):
    """A motor: torques and speeds at its shaft."""

    continuous_torque: Positive | None = optional("continuous torque", 0.45, "N m")
    continuous_curve: tuple[tuple[NonNegative, Positive], ...] | None = optional(
        "continuous torque over speed: points of speed (rad/s) and torque (N m)",
        [[0.0, 0.45], [400.0, 0.3]],
    )
    continuous_stall_torque: Positive | None = optional(
        "continuous torque at standstill", 0.4, "N m"
    )
    continuous_current: Positive | None = optional("current at the continuous torque", 6.0, "A")
    peak_torque: Positive | None = optional("largest torque for a short time", 1.3, "N m")
    torque_constant: Positive | None = optional("torque per current", 0.075, "N m/A")
    current: Literal["dc", "rms", "peak"] = key(
        "kind of current of the torque constant and the continuous current: DC or block "
        "commutation, or RMS or peak of a sinusoidal phase current",
        "rms",
        default="dc",
    )
    resistance: Positive | None = optional("of the winding at 25 C", 0.35, "Ohm")
    resistance_of: Literal["terminals", "phase"] = key(
        "measured between two terminals, or from one phase to the star point",
        "phase",
        default="terminals",
    )
    rotor_inertia: Positive | None = optional("of the rotor", 3e-05, "kg m^2")
    mass: Positive | None = optional("of the motor", 0.6, "kg")
    max_speed: Positive | None = optional("permissible", 600.0, "rad/s")
    mounting: Literal["frameless", "shaft", "flange"] | None = optional(
        "what it comes as: rotor and stator only, or a housing with a shaft, without or with "
        "the square flange of servo motors",
        "frameless",
    )
    cooling: Literal["closed", "open", "fan", "plate"] | None = optional(
        "what its continuous ratings need: nothing, free air through an open rotor, a fan on "
        "its shaft, or a plate that it is mounted on; left out: nothing",
        "open",
    )
    nominal_voltage: Positive | None = optional(
        "for which the speeds and the stall torque are given", 48.0, "V"
    )
    max_voltage: Positive | None = optional(
        "highest that its winding's insulation permits", 60.0, "V"
    )
    no_load_speed: Positive | None = optional("at nominal voltage without load", 550.0, "rad/s")
    rated_speed: Positive | None = optional(
        "at nominal voltage and continuous torque", 450.0, "rad/s"
    )
    stall_torque: Positive | None = optional(
        "at nominal voltage, start of the speed-torque line", 3.2, "N m"
    )
    thermal: Thermal | None = optional(
        "for the winding's temperature", {"winding_housing": 1.2, "housing_ambient": 3.0}
    )

    @property
    def frameless(self) -> bool:
        """Whether it is a kit of rotor and stator, without shaft, bearings and housing."""
        return self.mounting == "frameless"

    @property
    def mass_taken(self) -> float | None:
        """Its mass, kg; where it is not printed 1.94 T^0.75 of a motor with a housing: heavy.

        Of the 36 of the bundled catalogue whose mass is known nine in ten are lighter.
        """
        torque = max(self.continuous_torque or 0.0, self.continuous_stall_torque or 0.0)
        if self.mass is not None or self.frameless or not torque:
            return self.mass
        return 1.94 * torque**0.75

    @model_validator(mode="after")
    def _figures_agree(self) -> Motor:
        ascending(self, "continuous_torque", "peak_torque")
        ascending(self, "continuous_stall_torque", "peak_torque")
        rising(self, "continuous_curve", "rad/s, N m")
        ascending(self, "rated_speed", "no_load_speed")
        line = self.no_load_speed, self.rated_speed, self.stall_torque
        if any(x is not None for x in line) and self.nominal_voltage is None:
            raise ValueError("no_load_speed, rated_speed, stall_torque need `nominal_voltage`")
        return self


class OutputFriction(Entry):
    """Friction of a gearmotor at its output, by which its effort u exceeds the load t.

        u - t = base + load_dependent (|u| + |t|) + viscous |v|

    At rest u = -t, so a share of twice the load is lost (BAM's model M3).
    """

    base: NonNegative = key("independent of the load", 0.5, "N m or N", default=0.0)
    load_dependent: Number = key(
        "share of the sum of effort and load, below 1", 0.1, "1", ge=0, lt=1, default=0.0
    )
    viscous: NonNegative = key("per speed of the output", 0.2, "N m s/rad or N s/m", default=0.0)


class GearMotor(RatedEntry):
    """Motor and gear in one: torques, speeds and friction at the output, rotor at the motor.

    Where `output` is linear: N, m/s and, of a linear motor (ratio 1), the mass that moves (kg, as
    `rotor_inertia`).
    """

    ratio: Positive = key(
        "motor turns per turn of the output; rad/m of a linear one", 64.0, "1 or rad/m"
    )
    output: Literal["rotary", "linear"] = key("motion of its output", "rotary", default="rotary")
    continuous_torque: Positive | None = optional("continuous output", 48.0, "N m or N")
    peak_torque: Positive | None = optional("largest output for a short time", 120.0, "N m or N")
    stall_torque: Positive | None = optional(
        "of a servo at nominal voltage, its output blocked: for a moment only. Where they are "
        "not printed it stands in for the peak torque, and 0.2 of it for the continuous one",
        2.9,
        "N m or N",
    )
    nominal_voltage: Positive | None = optional("for which the speeds are given", 48.0, "V")
    no_load_speed: Positive | None = optional("without load", 6.0, "rad/s or m/s")
    rated_speed: Positive | None = optional("at continuous torque", 5.0, "rad/s or m/s")
    max_speed: Positive | None = optional("permissible", 7.0, "rad/s or m/s")
    rotor_inertia: Positive | None = optional(
        "of the rotor, at the motor's speed", 5e-05, "kg m^2 or kg"
    )
    mass: Positive | None = optional("of motor and gear", 0.85, "kg")
    torque_constant: Positive | None = optional(
        "at the output, per current of the motor", 4.8, "N m/A or N/A"
    )
    peak_current: Positive | None = optional(
        "largest of its own electronics, of the kind of `current`: bounds the peak", 43.0, "A"
    )
    current: Literal["dc", "rms", "peak"] = key(
        "kind of current of the torque constant, as of a motor", "rms", default="dc"
    )
    resistance: Positive | None = optional(
        "between two terminals of the motor at 25 C", 0.39, "Ohm"
    )
    max_voltage: Positive | None = optional("highest that its own electronics permit", 60.0, "V")
    stiffness: Stiffness | None = optional(
        "of the output, its rotor held; as of a gear", 16000, "N m/rad or N/m"
    )
    backlash: NonNegative | None = optional(
        "of the output, its input held: the whole angle", 0.00087, "rad or m"
    )
    friction: OutputFriction | None = optional(
        "at the output", {"base": 0.5, "load_dependent": 0.1}
    )
    back_driving_torque: Positive | None = optional(
        "at the output, turns it without current", 1.5, "N m or N"
    )
    bearing: BearingRatings | None = optional(
        "ratings of its output bearing", {"kind": "crossed roller", "max_moment": 40.0}
    )

    @property
    def special(self) -> Kind | None:
        """What it has in place of torques and speeds; None: it has these."""
        return None

    @property
    def serves(self) -> str:
        """Which joints it is for: `rotary`, `linear`, or those of a `medium`."""
        return self.output

    @model_validator(mode="after")
    def _figures_agree(self) -> GearMotor:
        ascending(self, "continuous_torque", "peak_torque")
        ascending(self, "continuous_torque", "stall_torque")
        ascending(self, "rated_speed", "no_load_speed")
        ascending(self, "nominal_voltage", "max_voltage")
        if (self.no_load_speed or self.rated_speed) and self.nominal_voltage is None:
            raise ValueError("no_load_speed and rated_speed need `nominal_voltage`")
        return self


class KindDrive(GearMotor):
    """A drive without a motor's figures, which its kind describes: ratio 1, linear, no rotor."""

    figures: Kind = key("of its kind", {})

    @property
    def special(self) -> Kind | None:
        """See `GearMotor`."""
        return self.figures

    @property
    def serves(self) -> str:
        """See `GearMotor`."""
        return self.figures.serves

    @property
    def stroke(self) -> float | None:
        """Of its kind, m."""
        return self.figures.stroke

    @classmethod
    def of(cls, figures: Kind, own: Mapping[str, Any]) -> KindDrive:
        """Return a drive of a kind; `own`: fields of a gearmotor, which its kind has validated."""
        own = {"ratio": 1.0, "output": "linear", "rotor_inertia": 0.0, **own}
        return cls.model_construct(**own, figures=figures)


class Screw(Entry):
    """A screw between its supports."""

    root_diameter: Positive = key("of the thread's root", 0.0125, "m")
    length: Positive = key("longest free length between the supports", 0.79, "m")
    supports: Literal["fixed-free", "supported-supported", "fixed-supported", "fixed-fixed"] = key(
        "supports of its two ends", "fixed-supported"
    )
    ball_circle: Positive | None = optional("diameter of the circle of ball centres", 0.0155, "m")
    max_dn: Positive | None = optional(
        "permissible ball circle diameter (mm) times speed (rpm)", 70000.0, "mm rpm"
    )
    elasticity: Positive = key("of its material", 2.06e11, "Pa", default=2.06e11)
    density: Positive = key("of its material", 7850.0, "kg/m^3", default=7850.0)


class Nut(Entry):
    """A nut that slides on a lead screw's thread."""

    diameter: Positive = key("pitch diameter of the thread", 0.01, "m")
    contact_area: Positive = key("between thread and nut, as the maker counts it", 1.2e-4, "m^2")
    max_pressure: Positive | None = optional("permissible pressure on that area", 5e6, "Pa")
    max_pv: Positive | None = optional("permissible pressure times sliding speed", 1e5, "Pa m/s")


class Gear(Sourced):
    """A gear: torques at its output unless named input; speeds and inertia at its input.

    `efficiency` is the maker's, no-load loss included: a number at rated torque, or his curves as
    a scene's `transmission` takes them.
    """

    ratio: Annotated[float | tuple[float, ...], Forms(Positive, tuple[Positive, ...])] = key(
        "motor turns per output turn, or a list of ratios with the same figures; rad/m where "
        "the output is linear",
        [50, 80, 100],
        "1 or rad/m",
    )
    kind: str = key("type; strain wave gears have rules of their own", "strain wave", default="")
    output: Literal["rotary", "linear"] = key(
        "rotary, or linear with efforts in N", "rotary", default="rotary"
    )
    rated_torque: Positive | None = optional(
        "for which life and efficiency are given", 40.0, "N m or N"
    )
    average_torque: Positive | None = optional(
        "limit of the mean, weighted by speed", 49.0, "N m or N"
    )
    repeated_peak_torque: Positive | None = optional("limit of a cycle's peaks", 82.0, "N m or N")
    momentary_peak_torque: Positive | None = optional(
        "limit in a collision or an emergency stop", 147.0, "N m or N"
    )
    momentary_peaks: Positive | None = optional(
        "permissible number of momentary peaks in its life", 10000, "1"
    )
    peak_turns: Positive | None = optional(
        "output turns in its life above `rated_torque`, up to the repeated peak", 30000, "1"
    )
    peaks_per_hour: Positive | None = optional(
        "how often an hour it may exceed `rated_torque`", 1000.0, "1/h"
    )
    rated_speed: Positive | None = optional(
        "of the input, for which the life is given", 209.4, "rad/s"
    )
    average_input_speed: Positive | None = optional("limit of the mean", 366.0, "rad/s")
    max_input_speed: Positive | None = optional("limit", 680.0, "rad/s")
    input: Literal["bore", "hollow", "clamp", "shaft", "pinion"] | None = optional(
        "what takes the motor: a bored hub, as of a wave generator, for the shaft of a motor "
        "or of the joint; a hollow shaft; a hub that clamps a motor's shaft; a shaft of its "
        "own for a coupling; a pinion that its maker puts on the shaft of his `motors`",
        "clamp",
    )
    motors: tuple[Text, ...] = key(
        "the only motors that it goes with, by how their names begin; empty: any that fits "
        "its `input`",
        ["maxon EC-i 40", "maxon EC 45 flat"],
        default=(),
    )
    input_inertia: NonNegative | None = optional(
        "of all that turns with the input", 1.9e-05, "kg m^2"
    )
    mass: Positive | None = optional("of the gear", 0.9, "kg")
    nominal_life: Positive | None = optional("L50 at rated torque and speed", 35000.0, "h")
    efficiency: Efficiency | None = optional("at rated torque, or the maker's curves", 0.77, "1")
    back_efficiency: Annotated[Number, Field(le=1)] | None = optional(
        "when the load drives; below 0 for a self-locking gear", 0.7, "1"
    )
    no_load_running_torque: NonNegative | None = optional(
        "at the input, at `no_load_speed`", 0.05, "N m"
    )
    no_load_speed: Positive | None = optional(
        "input speed of the no-load running torque", 209.4, "rad/s"
    )
    starting_torque: NonNegative | None = optional(
        "at the input, starts it without load", 0.037, "N m"
    )
    back_driving_torque: Positive | None = optional(
        "at the output, starts it without load", 3.9, "N m or N"
    )
    stiffness: Stiffness | None = optional(
        "of the output: a number (K1, where several are printed), or lines as a scene's "
        "transmission takes them",
        {"k1": 16000, "k2": 25000, "k3": 29000, "t1": 7.0, "t2": 25.0},
        "N m/rad or N/m",
    )
    hysteresis: Positive | None = optional(
        "hysteresis loss, the whole width at zero torque", 0.00029, "rad or m"
    )
    backlash: NonNegative | None = optional(
        "of the output, its input held: the whole angle", 0.00087, "rad or m"
    )
    stroke: Positive | None = optional("of a linear output", 0.3, "m")
    screw: Screw | None = optional(
        "for a screw's critical speed, buckling and the speed of its balls",
        {"root_diameter": 0.0125, "length": 0.79, "supports": "fixed-supported"},
    )
    nut: Nut | None = optional(
        "of a lead screw, for its pressure and PV value",
        {"diameter": 0.01, "contact_area": 1.2e-4, "max_pv": 1e5},
    )
    effort_curve: tuple[tuple[NonNegative, Positive], ...] | None = optional(
        "largest effort over input speed, as of a belt: points of speed (rad/s) and N m or N",
        [[0.0, 1070.0], [70.0, 890.0]],
    )
    bearing: BearingRatings | None = optional(
        "output bearing; of a screw, the nut", {"kind": "crossed roller", "max_moment": 91.0}
    )

    @model_validator(mode="after")
    def _figures_agree(self) -> Gear:
        ascending(self, "rated_torque", "repeated_peak_torque")
        ascending(self, "repeated_peak_torque", "momentary_peak_torque")
        ascending(self, "average_input_speed", "max_input_speed")
        rising(self, "effort_curve", "rad/s, N or N m")
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
                Transmission.model_construct(**values).losses()
            elif self.no_load_running_torque is not None and self.efficiency is not None:
                self._check_no_load(ratio, self.efficiency)
        return self

    @property
    def rollers(self) -> float | None:
        """1 of a cycloidal (RV) gear, whose rules are those of its crank's rollers; else None."""
        return 1.0 if self.kind == "cycloidal" else None

    @property
    def repeated_by_rating(self) -> float | None:
        """Peak of starts and stops where a cycloidal gear's is not printed, 2.5 x the rating.

        Source: Nabtesco RV-40E, 412, 1029 and 2058 N m, retyped in a public selector; Zhenkang
        ZKRV-20E to 450E print 2.5 and 5 times, too.
        """
        return 2.5 * self.rated_torque if self.rollers and self.rated_torque else None

    @property
    def momentary_by_rating(self) -> float | None:
        """Emergency peak of the same, 5 x the rating."""
        return 5.0 * self.rated_torque if self.rollers and self.rated_torque else None

    @property
    def ratios(self) -> tuple[float, ...]:
        """All ratios this entry comes in."""
        return self.ratio if isinstance(self.ratio, tuple) else (self.ratio,)

    def at(self, ratio: float, ambient: float) -> Gear:
        """Return the gear with its no-load torque, by rule where none is printed, as cold as it is.

        Strain wave gears are printed at 20 C; below, all losses are times `COLD`. `stand_ins` says
        both.

        Args:
            ratio: one of its own. ambient: temperature of its surroundings, deg C.
        """
        gear = self._with_drag(ratio)
        factor = float(np.interp(ambient, *np.transpose(COLD)))
        if gear.kind != "strain wave" or factor == 1.0:
            return gear
        update: dict[str, Any] = {
            name: factor * value
            for name in ("no_load_running_torque", "starting_torque", "back_driving_torque")
            if (value := getattr(gear, name)) is not None
        }
        if isinstance(gear.efficiency, MakersEfficiency):
            update["efficiency"] = gear.efficiency.with_losses(factor)
        elif gear.efficiency is not None:
            update["efficiency"] = 1 / (1 + factor * (1 / gear.efficiency - 1))
        if gear.back_efficiency is not None:
            update["back_efficiency"] = 1 - factor * (1 - gear.back_efficiency)
        cold = f"{factor:.3g} x the losses at 20 C: CSD-20/25-100 at {ambient:g} C"
        said = {name: "; ".join([*_said(gear, name), cold]) for name in update}
        return gear.model_copy(update={**update, "stand_ins": {**gear.stand_ins, **said}})

    def _with_drag(self, ratio: float) -> Gear:
        """See `DRAG`; nothing for screws and belts, nor where the efficiency is not a number."""
        share, eta, rated = DRAG.get(self.kind, 0.0), self.efficiency, self.rated_torque
        if self.no_load_running_torque is not None or not rated or not isinstance(eta, float):
            return self
        lost = 1 / eta - 1
        torque = min(share, lost) * rated / ratio
        if torque <= 0.0:
            return self
        of = f"{share:g} of the rated torque" if share < lost else "the whole loss at rated torque"
        words = f"{BY_RULE}, {torque:.2g} N m: {of}, on top of the efficiency"
        drag = {"no_load_running_torque": torque, "no_load_speed": DRAG_SPEED}
        drag["starting_torque"] = min(self.starting_torque or np.inf, DRAG_AT_START * torque)
        back = self.back_efficiency
        if back is None and self.back_driving_torque is None:
            drag["back_driving_torque"] = ratio * drag["starting_torque"] / DRAG_BACK
        said = {"no_load_running_torque": words, **self.stand_ins}
        return self.model_copy(update={**drag, "stand_ins": said})

    @property
    def dragged_by_rule(self) -> bool:
        """Whether the no-load torque follows from `DRAG`."""
        return self.stand_ins.get("no_load_running_torque", "").startswith(BY_RULE)

    def takes(self, name: str, motor: Motor) -> bool:
        """Return whether its maker lets a motor be put before it.

        A frameless kit goes into a strain wave gear only, whose wave generator its rotor turns. A
        gear that names its motors takes no other; else a motor with a shaft fits.
        """
        if motor.frameless and self.kind != "strain wave":
            return False
        return not self.motors or name.startswith(self.motors)

    def no_load(self) -> dict[str, Any]:
        """Return `no_load_torque` and `motor_viscous` of a transmission, as far as printed.

        n_run = starting torque + viscous x speed. Without n_run the starting torque counts, but not
        beside an efficiency that is a number at rated torque.
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
        eta_b = ratio * self.starting_torque / self.back_driving_torque
        torques = BackDriving(
            starting_torque=self.starting_torque, back_driving_torque=self.back_driving_torque
        )
        return (torques, eta_b) if eta_b <= 1.0 else None

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


class Belt(Sourced):
    """A closed synchronous belt on two pulleys, which is a gear (`gear`).

    The force F that cords and teeth bear makes the torque F r_2 at the driven pulley; two strands
    of length l have the stiffness 2 C r_2^2/l, C the specific one (force per strain).
    """

    pitch: Positive = key("of its teeth", 0.005, "m")
    width: Positive = key("of the belt", 0.016, "m")
    teeth_in: Positive = key("of the motor's pulley", 20, "1")
    teeth_out: Positive = key("of the driven pulley", 60, "1")
    length: Positive = key("pitch length of the closed belt", 0.5, "m")
    allowable_tension: Positive = key("of its cords", 560.0, "N")
    specific_stiffness: Positive = key(
        "force per strain of one strand, of this width", 280000.0, "N"
    )
    mass_per_length: Positive = key("of this width", 0.05, "kg/m")
    tooth_load: tuple[tuple[NonNegative, Positive], ...] | None = optional(
        "permissible for one tooth in mesh per width over the speed of the motor's pulley: "
        "points of rad/s and N/m; left out: only the cords count",
        [[0.0, 3640.0], [104.7, 2650.0]],
    )
    most_teeth: Positive = key(
        "in mesh that count: 6 of a belt that is welded, else 12", 6, "1", default=6.0
    )
    max_input_speed: Positive = key("of the motor's pulley", 419.0, "rad/s")
    service_factor: Number = key(
        "on the peak torque; 1.5 to 2 are usual", 1.5, "1", ge=1, default=1.5
    )
    efficiency: Number | None = optional("left out: 0.9, by rule", 0.96, "1", gt=0, le=1)
    pulley_density: Positive = key(
        "of pulleys as solid discs, as wide as the belt", 2700.0, "kg/m^3", default=2700.0
    )

    @model_validator(mode="after")
    def _goes_around(self) -> Belt:
        rising(self, "tooth_load", "rad/s, N/m")
        least = self._around(sum(self.radii))
        if self.length <= least:
            raise ValueError(
                f"length {self.length:g} m is shorter than its pulleys need, {least:.4g} m for "
                f"{self.teeth_in:g} and {self.teeth_out:g} teeth side by side: count the belt's "
                "teeth, or take smaller pulleys"
            )
        return self

    @property
    def radii(self) -> tuple[float, float]:
        """Pitch radii of the motor's and of the driven pulley, m."""
        turn = self.pitch / (2 * pi)
        return self.teeth_in * turn, self.teeth_out * turn

    def _around(self, distance: float) -> float:
        """Return the length of a belt around pulleys at a centre distance, m."""
        first, second = self.radii
        lean = asin(abs(second - first) / distance)
        return 2 * distance * cos(lean) + pi * (first + second) + 2 * lean * abs(second - first)

    @property
    def distance(self) -> float:
        """Centre distance at which the belt is straight, m."""
        low, high = sum(self.radii), self.length
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._around(middle) < self.length else (low, middle)
        return low

    @property
    def gear(self) -> Gear:
        """The gear that it is: ratio, torques, stiffness, inertia and mass of belt and pulleys."""
        first, second = self.radii
        ratio = self.teeth_out / self.teeth_in
        lean = asin((second - first) / self.distance)
        wrapped = self.teeth_in * (0.5 - lean / pi), self.teeth_out * (0.5 + lean / pi)
        meshing = int(min(*wrapped, self.most_teeth))
        tension, reach = self.allowable_tension, second / self.service_factor
        curve = tuple(
            (speed, reach * min(tension, load * meshing * self.width))
            for speed, load in self.tooth_load or ()
        )
        most = max((torque for _, torque in curve), default=reach * tension)
        discs = [pi * r**2 * self.width * self.pulley_density for r in self.radii]
        belt, rule = self.mass_per_length * self.length, "by rule: solid pulleys"
        turning = discs[0] * first**2 / 2 + discs[1] * second**2 / 2 / ratio**2 + belt * first**2
        note = f"centre distance {self.distance:.3g} m, {meshing} teeth in mesh count"
        return Gear(
            **{key: getattr(self, key) for key in ("source", "grade", "price", "max_input_speed")},
            note=f"{self.note}; {note}" if self.note else note,
            stand_ins={"mass": rule, "input_inertia": rule}
            | ({} if self.efficiency else {"efficiency": "by rule: 0.9"}),
            kind="belt",
            ratio=ratio,
            rated_torque=most,
            repeated_peak_torque=most,
            effort_curve=curve or None,
            input="clamp",
            input_inertia=turning,
            mass=sum(discs) + belt,
            efficiency=self.efficiency or 0.9,
            stiffness=2 * self.specific_stiffness / (self.distance * cos(lean)) * second**2,
        )


class BearingEntry(Sourced):
    """Friction mu x (radial |F_r| + axial |F_a| + moment |M_b|), the levers x a diameter."""

    mu: Positive | None = optional("coefficient in motion", 0.0015, "1")
    mu_range: tuple[NonNegative, NonNegative] | None = optional(
        "smallest and largest, if the maker prints a range", [0.001, 0.003], "1"
    )
    radial: NonNegative = key(
        "lever of the radial force per bore or raceway diameter", 0.5, "1", default=0.0
    )
    axial: NonNegative = key("of the axial force", 0.5, "1", default=0.0)
    moment: NonNegative = key("of the tilting moment, per m", 2.05, "1", default=0.0)
    ratings: BearingRatings | None = optional(
        "load ratings, needed if `conditions.bearings` names it",
        {"kind": "crossed roller", "max_moment": 91.0},
    )


class Brake(HoldingBrake, Sourced):
    """A brake that holds without power, at a motor's shaft."""

    sold: Text | None = optional(
        "`alone`, or the motors that it is built into, by how their names begin", "alone"
    )
    voltage: Positive | None = optional("to open it", 24.0, "V")
    power: Positive | None = optional("while it is open", 7.0, "W")
    release_time: Positive | None = optional("until it is open", 0.025, "s")
    rotor_inertia: Positive | None = optional(
        "of its parts that turn with the motor", 1e-06, "kg m^2"
    )
    mass: Positive | None = optional("of the brake", 0.2, "kg")
    wear_energy: Positive | None = optional(
        "energy of all emergency stops until it is worn", 35e3, "J"
    )

    @property
    def mass_taken(self) -> float:
        """Its mass, kg; where it is not printed 0.28 T^0.7, more than brakes that are: not 0.

        Source: B&R 8JSA user's manual V1.00, p. 20: 1.42 to 53 N m, 0.27 to 2.9 kg.
        """
        return self.mass or 0.28 * self.torque**0.7

    @property
    def inertia_ends(self) -> tuple[float, float]:
        """The least and the greatest that its inertia may be, kg m^2; equal where it is printed.

        Else 0 and 2.2e-6 T^1.38. Source: as of `mass_taken`, 1.1e-6 to 1.64e-4.
        """
        if self.rotor_inertia is not None:
            return self.rotor_inertia, self.rotor_inertia
        return 0.0, 2.2e-6 * self.torque**1.38

    @property
    def unknown(self) -> tuple[str, ...]:
        """What is not printed, and what it is taken as."""
        figures = (
            ("largest torque", self.torque_max, f"{BRAKE_PEAK:g} x {self.torque:g} N m"),
            ("mass", self.mass, f"0.28 T^0.7 = {self.mass_taken:.2g} kg"),
            (
                "inertia",
                self.rotor_inertia,
                f"0 to 2.2e-6 T^1.38 = {self.inertia_ends[1]:.2g} kg m^2",
            ),
        )
        return tuple(f"{what} taken as {rule}" for what, x, rule in figures if x is None)

    def goes_with(self, motor: str, integrated: bool = False) -> bool:
        """Return whether it is sold alone or in this motor, or nothing is said.

        Args:
            motor: its name, or that of a gearmotor (`integrated`), whose shaft is not accessible.
        """
        if self.sold == "alone":
            return not integrated
        return self.sold is None or motor.startswith(self.sold)

    @property
    def holding(self) -> HoldingBrake:
        """The brake as a transmission of a scene has it."""
        return HoldingBrake(**{name: getattr(self, name) for name in HoldingBrake.model_fields})


class Amplifier(Sourced):
    """An amplifier (servo drive), which feeds one motor."""

    min_voltage: Positive | None = optional("lowest of its DC bus", 10.0, "V")
    max_voltage: Positive | None = optional("highest of its DC bus", 50.0, "V")
    continuous_current: Positive | None = optional("without end", 5.0, "A")
    peak_current: Positive | None = optional("for a short time", 15.0, "A")
    peak_time: Positive | None = optional(
        "for which it may exceed the continuous current", 15.0, "s"
    )
    voltage_share: Number | None = optional(
        "largest part of its bus voltage that a motor gets", 0.9, "1", gt=0, le=1
    )
    current: Literal["dc", "rms", "peak"] = key(
        "kind of its currents: DC or block commutation, or RMS or peak of a sinusoidal phase "
        "current",
        "rms",
        default="rms",
    )

    @model_validator(mode="after")
    def _figures_agree(self) -> Amplifier:
        ascending(self, "continuous_current", "peak_current")
        ascending(self, "min_voltage", "max_voltage")
        return self


class _Sections(Entry):
    """What every catalogue has."""

    pinfric_catalog: Version = key("version of the format", 1)
    extends: Literal["default"] | None = optional(
        "also use the entries of the bundled catalogue", "default"
    )
    motors: dict[str, Motor] = key(
        "to choose from",
        {"M 48": {"source": "data sheet", "grade": "R", "continuous_torque": 0.45}},
        default_factory=dict,
    )
    gears: dict[str, Gear] = key(
        "to combine with motors",
        {"G 100": {"source": "data sheet", "grade": "R", "ratio": 100}},
        default_factory=dict,
    )
    belts: dict[str, Belt] = key(
        "synchronous belts with their pulleys, as gears",
        {
            "AT5 3:1": {
                "source": "data sheet",
                "grade": "R",
                "pitch": 0.005,
                "width": 0.016,
                "teeth_in": 20,
                "teeth_out": 60,
                "length": 0.41,
                "allowable_tension": 560.0,
                "specific_stiffness": 280000.0,
                "mass_per_length": 0.05,
                "max_input_speed": 419.0,
            }
        },
        default_factory=dict,
    )
    gearmotors: dict[str, GearMotor] = key(
        "motor with gear",
        {"A 80": {"source": "data sheet", "grade": "R", "ratio": 64}},
        default_factory=dict,
    )
    bearings: dict[str, BearingEntry] = key(
        "for joints with a separate bearing",
        {"ring": {"source": "data sheet", "grade": "R", "mu": 0.0015}},
        default_factory=dict,
    )
    brakes: dict[str, Brake] = key(
        "for motors' shafts",
        {"B 5": {"source": "data sheet", "grade": "R", "torque": 0.5}},
        default_factory=dict,
    )
    amplifiers: dict[str, Amplifier] = key(
        "that feed motors",
        {"A 5": {"source": "data sheet", "grade": "R", "continuous_current": 5.0}},
        default_factory=dict,
    )
    conditions: Conditions | None = optional("conditions of operation", {"bus_voltage": 24.0})


class CatalogFile(KindSections, _Sections):
    """A whole catalogue file."""


#: The sections of products: the kind of their entries.
SECTIONS: dict[str, type[Sourced]] = {
    name: get_args(entries.annotation)[1]
    for name, entries in CatalogFile.model_fields.items()
    if get_origin(entries.annotation) is dict
}


@dataclass(frozen=True)
class Catalog:
    """Products to choose from, by name.

    Attributes:
        source: the file, or "default" for the bundled ones.
        kinds: entries of the sections of kinds (`kinds.KindSections`).
        replaced: entries that stand in place of bundled ones, in words.
        files: that it was read from; of the bundled entries their folder.
    """

    source: str
    motors: Mapping[str, Motor] = field(default_factory=dict)
    gears: Mapping[str, Gear] = field(default_factory=dict)
    gearmotors: Mapping[str, GearMotor] = field(default_factory=dict)
    kinds: Mapping[str, Kind] = field(default_factory=dict)
    bearings: Mapping[str, BearingEntry] = field(default_factory=dict)
    brakes: Mapping[str, Brake] = field(default_factory=dict)
    amplifiers: Mapping[str, Amplifier] = field(default_factory=dict)
    conditions: Conditions = field(default_factory=Conditions)
    replaced: tuple[str, ...] = ()
    files: tuple[str, ...] = ()

    def whole(self) -> Iterator[tuple[str, GearMotor]]:
        """Yield the drives that are no motor behind a gear: gearmotors, and those of kinds."""
        yield from self.gearmotors.items()
        for called, kind in self.kinds.items():
            for name, one, own in kind.drives(called):
                yield name, KindDrive.of(one, own)


def _said(entry: Sourced, figure: str) -> list[str]:
    return [entry.stand_ins[figure]] if figure in entry.stand_ins else []
