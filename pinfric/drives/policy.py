"""The policy of `size`: what is demanded, what must be known of a drive, and which parts fit.

A drive can be signed if every figure of `NEEDS` is printed, or has an unfavourable stand-in, which
the report names. Of others the figures to ask the maker for are listed. Nothing here looks at other
candidates: what is chosen does not depend on what else there is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, model_validator

from pinfric.errors import CatalogError, choose_from
from pinfric.model.entry import Entry, NonNegative, Number, Positive, key, optional, parse
from pinfric.model.schema import OTHERS as OTHERS

#: Ambient temperature to which makers refer resistances and ratings, degrees Celsius.
REFERENCE_TEMPERATURE = 25.0

#: V DC, up to which a bus is extra-low voltage and takes any winding (IEC 60204-1, PELV).
EXTRA_LOW_VOLTAGE = 60.0
#: Above that: a bus beyond this many times the nominal voltage is likelier a slip than a choice.
MOST_OVERVOLTAGE = 1.5
#: Of motor and gear: housing, shaft and bearings of a frameless kit (12 to 32 % in MyActuator's
#: EPS-RH 14 to 32 beside the same gears and motors as kits).
KIT = 0.25
#: How a motor is cooled in its rating -> the part of its continuous torque that is left where no
#: air moves around it. maxon EC 60 flat: closed 0.269, open rotor 0.401, fan 0.536 N m; EC 90 flat
#: 0.457 0.729 0.953 and 0.964 1.26 1.56: 0.63 to 0.77 and 0.48 to 0.62, product pages July 2020.
COOLING = {"closed": 1.0, "plate": 1.0, "open": 0.63, "fan": 0.48}
#: Part of the continuous torque left at a standstill where no stall torque is printed: one phase
#: may carry the peak of a sinusoidal current. By rule.
STALLED = 0.71
#: Times the continuous torque: the most that a stall torque stands in for a peak torque; by rule.
#: Peaks that are printed are 2.5 to 12 times, the median of 64 motors of the catalogue 3.0.
MOST_PEAK = 3.5
#: A joint's own dry friction must be so many times its load for it to need no brake: friction falls
#: by warm grease, wear and vibration. 1 to 4 make no difference to 17 machines.
FRICTION_RESERVE = 2.0
#: Of a joint's largest effort: a smaller load is rounding of masses, or of an axis up to 1.1
#: degrees off the vertical.
LITTLE_LOAD = 0.02
#: Reserve of brakes where masses or payloads are guesses: "if not enough is known about the load
#: torque, a safety factor of 2" (B&R 8JSA user's manual V1.00, p. 20).
UNSURE_BRAKE_FACTOR = 2.0
#: s, within which a brake alone stops its joint: Universal Robots UR5, user manual CB3 3.4.5, p.
#: I-53, category 0 at full speed and reach: base 0.24, shoulder 0.53, elbow 0.16 s.
STOP_TIME = 0.5
#: Reserve of gears on their peaks in stops of rigid gears, by algebra and by simulation: elastic
#: gears ring.
STOP_FACTOR = 1.3
#: Figures that a provisional drive may lack: no torque.
EXTRA_INERTIAS = frozenset(("input inertia", "rotor inertia"))
PROVISIONAL = EXTRA_INERTIAS | {
    *("efficiency", "stiffness", "output bearing", "maximum input speed", "largest speed"),
    "stroke",
}
#: Joints nearer to the base than this are base axes for the rule on frequencies.
BASE_AXES = 3


class Surroundings(NamedTuple):
    """Temperatures of the surroundings, deg C, for which makers rate a kind of product."""

    low: float
    high: float
    source: str


#: Kind of product -> its surroundings; of others none were read.
SURROUNDINGS = {
    "motor": Surroundings(0.0, 50.0, "Kollmorgen Developer Network, derating: encoders from 0 C"),
    "strain wave": Surroundings(
        -10.0, 40.0, "Harmonic Drive 1021387 12/2018, 5.5.4; efficiency of CSD-20/25 from -10 C on"
    ),
    "planetary": Surroundings(-15.0, 40.0, "Beckhoff AG2400, TP"),
    "cycloidal": Surroundings(-np.inf, 60.0, "Nabtesco RV-RH, p. 8: of the surface"),
    "amplifier": Surroundings(-np.inf, 40.0, "Kollmorgen Developer Network, derating"),
}


class Collisions(Entry):
    """Overloads that a gear must bear in its life."""

    count: Positive = key("how many", 100, "1")
    duration: Positive = key("of each", 0.15, "s")


def _as_groups(value: Any) -> Any:
    """Groups of joints; in a text joints end with commas, groups with semicolons."""
    if not isinstance(value, str):
        return value
    return tuple(_as_names(group) for group in value.split(";"))


def _as_names(value: Any) -> Any:
    """Names of joints; in a text with commas."""
    return tuple(n.strip() for n in value.split(",")) if isinstance(value, str) else value


class Conditions(Entry):
    """Conditions of operation, with the defaults of common practice."""

    bus_voltage: Positive = key(
        "of the bus that feeds the amplifiers; up to 60 V (DC, extra-low voltage) any winding is "
        "taken, above that one whose nominal voltage times 1.5, or `max_voltage`, reaches it",
        48.0,
        "V",
        default=48.0,
    )
    amplifier_share: Number = key(
        "part of the bus voltage that a motor gets from its amplifier, where that prints none "
        "(maxon's EPOS4: 0.9); the rest is for the control of the current; gearmotors with "
        "electronics of their own get all",
        0.95,
        "1",
        gt=0,
        le=1,
        default=0.9,
    )
    ambient: Number = key(
        "temperature of the surroundings; makers rate servo motors up to 40 C (IEC 60034-1, "
        "clause not read), ratings at 25 C are reduced; outside of what makers rate nothing is "
        "signed, and below 20 C strain wave gears lose more",
        25.0,
        "deg C",
        default=40.0,
    )
    peak_factor: Number = key(
        "reserve on the peak torque; 20 to 30 % are usual", 1.2, "1", ge=1, default=1.2
    )
    rms_factor: Number = key(
        "reserve on the continuous torque; with encoder and brake motors lose 7 to 16 % "
        "(Kollmorgen Developer Network, derating)",
        1.1,
        "1",
        ge=1,
        default=1.1,
    )
    pull_out_factor: Number = key(
        "reserve on the pull-out torque of stepper motors; 1.5 to 2 are usual",
        2.0,
        "1",
        ge=1,
        default=1.5,
    )
    cylinders: Annotated[
        tuple[str, ...],
        BeforeValidator(_as_names, json_schema_input_type=tuple[str, ...] | str),
    ] = key(
        "sliding joints that get a cylinder, as drives between two points always do; on a command "
        "line a,b",
        ["lift"],
        default=(),
    )
    medium: Literal["hydraulic", "pneumatic"] = key(
        "of all cylinders", "pneumatic", default="hydraulic"
    )
    hydraulic_pressure: Number = key(
        "of the supply of hydraulic cylinders; ISO 6020-2: 160 bar",
        2.1e7,
        "Pa",
        ge=1e5,
        default=1.6e7,
    )
    pneumatic_pressure: Number = key(
        "of the supply of pneumatic cylinders, above that of the air; makers print forces at 6e5",
        5e5,
        "Pa",
        ge=1e4,
        default=6e5,
    )
    hydraulic_flow: Positive | None = optional(
        "of the supply, for one cylinder at a time; left out: printed, not judged", 1e-3, "m^3/s"
    )
    buckling_length: Number = key(
        "of a cylinder with its rod out, over the distance of its pins: 1 with pins at both ends, "
        "2 with a free end, 0.7 with one clamped end, 0.5 with both clamped and guided (Merkle)",
        0.7,
        "1",
        ge=0.5,
        default=1.0,
    )
    buckling_factor: Number = key(
        "reserve on the force at which a cylinder buckles; 3 to 5 are usual (Haenchen)",
        5.0,
        "1",
        ge=1,
        default=3.5,
    )
    cooling: Literal["closed", "open", "fan"] = key(
        "what air the joints give to their motors: none (an open rotor keeps 0.63 of its "
        "continuous torque, one with a fan 0.48, by maxon's closed versions), free air, or that "
        "of a fan",
        "fan",
        default="closed",
    )
    mounting: Literal["scene", "any"] = key(
        "how the robot is mounted: as the scene's gravity says, or any way round, with gravity "
        "along each axis of the base; for some mountings give `--cycle wall.yaml:pick.csv`",
        "any",
        default="scene",
    )
    inertia_ratio: Positive = key(
        "largest permitted J_load/(ratio^2 (J_motor + J_gear input)), by practice of servo drives",
        10.0,
        "1",
        default=10.0,
    )
    life: Positive | None = optional(
        "L10 that gears and bearings must reach, for example a strain wave gear's at rated "
        "torque and speed; left out: printed, not judged",
        10000.0,
        "h",
    )
    shock: Number = key(
        "factor on the loads of bearings and screws for their life: 1 to 1.2 smooth, 1.2 to "
        "1.5 normal, 1.5 to 3 with shocks",
        1.2,
        "1",
        ge=1,
        default=1.2,
    )
    bearings: dict[str, str] = key(
        "bearing of the catalogue that carries the joint, instead of that of the gear, "
        "or guide of a sliding joint; by joint",
        {"elbow": "THK RB 5013"},
        default_factory=dict,
    )
    amplifiers: dict[str, str] = key(
        "amplifier of the catalogue that feeds the motor, by joint; `others`: of all joints "
        "that are not named; without it the report names the smallest that feeds each motor",
        {"elbow": "EPOS4 50/5", "others": "EPOS4 50/15"},
        default_factory=dict,
    )
    take: dict[str, str] = key(
        "drive that a joint gets, named as `size` prints it, in place of the lightest; by joint",
        {"elbow": "M 48 + G 100"},
        default_factory=dict,
    )
    same_drive: Annotated[
        tuple[tuple[str, ...], ...],
        BeforeValidator(_as_groups, json_schema_input_type=tuple[tuple[str, ...], ...] | str),
    ] = key(
        "groups of joints that share one motor and gear, each with its own brake; on a command "
        "line a,b;c,d",
        [["wrist_1", "wrist_2"]],
        default=(),
    )
    back_driving: Literal["any", "required", "forbidden"] = key(
        "whether the load must, must not or may be able to move the motor",
        "required",
        default="any",
    )
    max_winding: Number = key(
        "of motors whose maker prints no limit: the lowest class, A", 155.0, "deg C", default=105.0
    )
    thermal_time: Positive = key(
        "used if a winding's time constant is not known: overload is averaged over it; "
        "small motors have 15 to 50 s",
        20.0,
        "s",
        default=20.0,
    )
    collision_effort: dict[str, Positive] = key(
        "in a collision or an emergency stop, by joint",
        {"elbow": 120.0},
        "N m or N",
        default_factory=dict,
    )
    collisions: Collisions | None = optional(
        "number and duration in the gear's life", {"count": 100, "duration": 0.15}
    )
    holding_brake: Literal["any", "where_needed", "all"] = key(
        "which joints need a brake: all, as makers of light arms have it; those whose load exceeds "
        "half of dry friction that is known to be their own, and 2 % of their largest effort, and, "
        "where the scene has `stops`, those that move; `any`: the same, if there is one",
        "all",
        default="where_needed",
    )
    brake_factor: Number = key(
        "reserve on the brakes' torque; 1.5 to 3 are usual (Machine Design, Mechantronics, 2007); "
        "at least 2 where masses or payloads are guesses (B&R 8JSA V1.00, p. 20)",
        1.5,
        "1",
        ge=1,
        default=1.5,
    )
    stop_factor: Number = key(
        "reserve on what gears bear in stops, by algebra and by simulation: both take gears as "
        "rigid, and elastic ones ring, at most to twice the peak; a gear with less than 1.32 times "
        "this on the algebra's peak is simulated",
        1.5,
        "1",
        ge=1,
        default=STOP_FACTOR,
    )
    coil_voltage: Positive = key(
        "of the supply of the brakes' coils, beside the bus: no coil needs more than the higher of "
        "both",
        12.0,
        "V",
        default=24.0,
    )
    lost_springs: Literal["one", "none"] = key(
        "springs and payloads that a brake must do without: gas springs lose pressure, springs "
        "break, a counterweight or the load that it balances comes off",
        "none",
        default="one",
    )
    brake_stops: Positive | None = optional(
        "emergency stops that a brake bears until it is worn, each as hard as the cycle's hardest; "
        "left out: printed, not judged",
        500.0,
        "1",
    )
    bus_limit: Positive | None = optional(
        "highest permissible bus voltage while motors brake", 56.0, "V"
    )
    bus_capacitance: Positive | None = optional("of the bus", 0.0047, "F")
    supply_power: Positive | None = optional("largest power of the supply", 960.0, "W")
    supply_resistance: Positive | None = optional(
        "of supply and cables: the bus sags by it times the current", 0.05, "Ohm"
    )
    resonance_base: Positive = key(
        "least frequency of each of the first three joints, all others rigid; our default, after a "
        "maker's rule as it is quoted (Harmonic Drive 1019658, p. 22, not read)",
        8.0,
        "Hz",
        default=8.0,
    )
    resonance_hand: Positive = key("of those beyond", 15.0, "Hz", default=15.0)
    lowest_frequency: Positive | None = optional(
        "required lowest natural frequency of the whole robot, motors held: drives are chosen "
        "together; left out: each joint by itself",
        8.0,
        "Hz",
    )
    tool_sag: Positive | None = optional(
        "largest displacement of the scene's `tool` at rest by the load", 0.002, "m"
    )
    tool_interval: Positive | None = optional(
        "largest half-width of the tool's positions that friction holds at rest", 0.0002, "m"
    )
    tool_reversal: Positive | None = optional(
        "largest distance after opposite approaches", 0.0002, "m"
    )
    backlash: Positive | None = optional("largest backlash of a joint's gear", 0.0003, "rad or m")
    reversal_error: Positive | None = optional(
        "largest difference of a joint's positions after opposite approaches: wind-up by "
        "friction, hysteresis and backlash of its gear",
        0.0005,
        "rad or m",
    )
    mass_in_urdf: dict[str, NonNegative] = key(
        "mass of the drive that the URDF's link already includes at the joint's origin, by "
        "joint; it is subtracted there",
        {"elbow": 1.4},
        "kg",
        default_factory=dict,
    )

    @model_validator(mode="after")
    def _bus_can_rise(self) -> Conditions:
        if self.bus_limit is not None and self.bus_limit <= self.bus_voltage:
            raise ValueError(
                f"bus_limit {self.bus_limit:g} V is not above bus_voltage "
                f"{self.bus_voltage:g} V: how high may the bus rise?"
            )
        return self


#: Conditions as a file has them: keys that replace those of its catalogue, by `parse_conditions`.
GivenConditions = Annotated[
    dict[str, Any], BeforeValidator(lambda x: x, json_schema_input_type=Conditions)
]


def parse_conditions(given: Conditions | Mapping[str, Any], default: Conditions) -> Conditions:
    """Return `default` with what is given in its place: of an object what was set in it.

    Raises:
        CatalogError: an unknown condition or a value that cannot be.
    """
    if isinstance(given, Conditions):
        given = {name: getattr(given, name) for name in given.model_fields_set}
    for name in given:  # `parse` would suggest none: all keys are there
        if name not in (names := Conditions.key_names()):
            raise CatalogError(f"conditions: unknown key `{name}`; {choose_from(name, names)}")
    return parse(Conditions, {**dict(default), **given}, "conditions", CatalogError)


def stated(conditions: Conditions, *names: str) -> str:
    """Say what some conditions are, and their defaults."""
    return "; ".join(_stated(name, getattr(conditions, name)) for name in names)


def _stated(name: str, given: Any) -> str:
    default = Conditions.model_fields[name].get_default(call_default_factory=True)
    if given == default and given:
        return f"conditions.{name} = {_short(given)}, its default"
    value = f" = {_short(given)}" if isinstance(given, int | float | str) else ""
    return f"conditions.{name}{value}, default {_short(default) if default else 'none'}"


def _short(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


#: Of a gear; in place of it a joint may have a bearing of its own, and behind a belt it must.
BEARING, OWN_BEARING = "output bearing", "conditions.bearings"
_OF_GEARS = {"mass": "mass", "input inertia": "input_inertia", "efficiency": "efficiency"}
_OUTPUT = {"stiffness": "stiffness", BEARING: "bearing"}
_ROTOR = {"mass": "mass mass_taken", "rotor inertia": "rotor_inertia"}
_OF_MOTORS = {
    **_ROTOR,
    "continuous torque": "continuous_torque",
    "peak torque": "peak_torque stall_torque",
    "largest speed": "max_speed no_load_speed rated_speed",
}
#: Kind -> what must be known of it: a figure in words, as its maker is asked for it, and the
#: entry's keys in order of preference, of which a later one stands in for the first.
NEEDS: dict[str, dict[str, str]] = {
    "motor": _OF_MOTORS,
    "strain wave": {
        **_OF_GEARS,
        "repeated peak torque": "repeated_peak_torque",
        "momentary peak torque": "momentary_peak_torque",
        "limit for average torque": "average_torque rated_torque",
        "maximum input speed": "max_input_speed average_input_speed",
        "limit for average input speed": "average_input_speed",
        **_OUTPUT,
    },
    "other gear": {
        **_OF_GEARS,
        "rated torque": "rated_torque",
        "maximum input speed": "max_input_speed average_input_speed rated_speed",
        **_OUTPUT,
    },
    "linear": {
        **_OF_GEARS,
        "permissible force": "rated_torque repeated_peak_torque bearing nut",
        "maximum input speed": "max_input_speed average_input_speed rated_speed screw",
        "stroke": "stroke screw",
    },
    "gearmotor": {**_OF_MOTORS, "continuous torque": "continuous_torque stall_torque", **_OUTPUT},
    "linear motor": {
        "mass": "mass",
        "moving mass": "rotor_inertia",
        "continuous force": "continuous_torque",
        "peak force": "peak_torque stall_torque",
        "largest speed": "max_speed no_load_speed rated_speed",
    },
}
#: What stands in for a figure that is not printed: of gears other than strain wave ones (T2N, T2B:
#: rated and repeated peak torque), and of all gears for speeds.
STAND_INS = {
    words.split()[0]: tuple(words.split())
    for words in (
        "average_torque rated_torque",
        "repeated_peak_torque repeated_by_rating average_torque rated_torque",
        "momentary_peak_torque momentary_by_rating repeated_peak_torque average_torque "
        "rated_torque",
        "max_input_speed average_input_speed rated_speed",
        "average_input_speed rated_speed",
        "peak_torque peak_by_stall",
        "max_speed no_load_speed rated_speed",
    )
}
#: How that is said; of others, that no higher limit is known.
STAND_IN_WORDS = {
    "peak_by_stall": f"the stall torque, at most {MOST_PEAK:g} x the continuous torque, by rule; "
    "if the amplifier gives it",
    "repeated_by_rating": "2.5 x the rated torque of a cycloidal gear, by rule",
    "momentary_by_rating": "5 x the rated torque of a cycloidal gear, by rule",
}


def kind_of(entry: Any, gearmotor: bool = False) -> str:
    """Return the list of `NEEDS` that a gear or gearmotor is held against."""
    if entry.output == "linear":
        return "linear motor" if gearmotor else "linear"
    if gearmotor:
        return "gearmotor"
    return "strain wave" if getattr(entry, "kind", "") == "strain wave" else "other gear"


def lacks(kind: str, *entries: Any) -> tuple[str, ...]:
    """Return the figures that an entry lacks, as its maker is asked for them.

    Args:
        kind: of `NEEDS`; of drives of a kind of their own (`kinds`) those of the kind count.
        entries: with the figures of the list, of a motor `Ratings`, too; the last has the kind.
    """
    special = getattr(entries[-1], "special", None)
    needs = NEEDS[kind] if special is None else special.NEEDS
    known_by = entries if special is None else (*entries, special)
    return tuple(
        figure
        for figure, keys in needs.items()
        if not any(getattr(x, key, None) is not None for key in keys.split() for x in known_by)
    )


def product_of(entry: Any) -> str:
    """Return of which product in `SURROUNDINGS` a motor or gearmotor is."""
    special = getattr(entry, "special", None)
    return "motor" if special is None else str(special.PRODUCT)


def of_maker(figures: Sequence[str], kind: str) -> tuple[str, ...]:
    """Return the missing figures that a maker can be asked for: a belt has no bearing."""
    return tuple(figure for figure in figures if (kind, figure) != ("belt", BEARING))


def request(figures: Sequence[str], kind: str) -> str:
    """Say what to do about missing figures; arguments as of `of_maker`."""
    asked = of_maker(figures, kind)
    own = f"give the joint a bearing of its own: {OWN_BEARING}"
    said = [f"ask its maker for {', '.join(asked)}"] * bool(asked)
    return "; ".join([*said, *[own] * (len(asked) < len(figures))])


def outside(kind: str, conditions: Conditions, rated: float = -np.inf) -> tuple[str, ...]:
    """Return what to ask the maker for, where it is too cold or too warm for a kind of product.

    Args:
        kind: of `SURROUNDINGS`. rated: for which this product is rated, deg C.
    """
    if (makers := SURROUNDINGS.get(kind)) is None:
        return ()
    ambient, high = conditions.ambient, max(makers.high, rated)
    if ambient > high:
        return (f"ratings at {ambient:g} C (makers rate up to {high:g} C: {makers.source})",)
    if ambient < makers.low:
        return (
            f"ratings at {ambient:g} C (makers rate from {makers.low:g} C on: {makers.source})",
        )
    return ()
