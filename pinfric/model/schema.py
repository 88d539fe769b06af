"""The scene's file format: one frozen pydantic model per section.

Checks that need the robot (does the joint exist, does the bearing fit it) are in `scene.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    SerializeAsAny,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticKnownError

from pinfric.errors import choose_from
from pinfric.model.bearings import Bearing
from pinfric.model.entry import (
    Entry,
    Forms,
    NonNegative,
    Number,
    Positive,
    Text,
    Vector3,
    Version,
    key,
    optional,
    unlikely,
)
from pinfric.model.friction_terms import (
    TERMS,
    Coulomb,
    FrictionTerm,
    LoadFriction,
    Presliding,
    Stribeck,
    Viscous,
)
from pinfric.model.spring_entries import LinkPoint, SpringsKey
from pinfric.model.transmission import Transmission

#: Moments of inertia of a body about its centre of mass.
Moments = tuple[Number, Number, Number, Number, Number, Number]


class Payload(Entry):
    """A body carried by a link."""

    link: str = key("link of the robot that carries it", "tool0")
    mass: Positive = key("of the body", 2.0, "kg")
    com: Vector3 = key("centre of mass in the link's frame", [0, 0, 0.05], "m")
    inertia: Moments | None = optional(
        "ixx, ixy, ixz, iyy, iyz, izz about its own `com`, in the link's axes; left out: a point, "
        "in place of which `size` takes a cube of water",
        [0.01, 0, 0, 0.01, 0, 0.01],
        "kg m^2",
    )
    attached: bool = key(
        "whether it is carried unless a trajectory says otherwise", False, default=True
    )

    def scaled(self, factor: float) -> Payload:
        """Return a body of the same shape, so many times as dense."""
        inertia = self.inertia and tuple(factor * x for x in self.inertia)
        return self.model_copy(update={"mass": factor * self.mass, "inertia": inertia})


#: Whether the masses of the links hold a drive: its motor, gear and brake.
MassesHold = Literal["with_drives", "without_drives"]
#: In place of a drive's name: all drives that are not named.
OTHERS = "others"


def _word(value: Any) -> Any:
    """A number or a truth value as xacro reads it."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value) if isinstance(value, (int, float)) else value


class RobotEntry(Entry):
    """The URDF or MJCF, gravity, locked joints and payloads."""

    urdf: str | None = optional(
        "file beside the scene, or one of example-robot-data",
        "example-robot-data:ur_description/urdf/ur5_robot.urdf",
    )
    mjcf: str | None = optional("in place of `urdf`, a file of MuJoCo", "arm.xml")
    xacro_args: dict[str, Annotated[str, BeforeValidator(_word)]] = key(
        "arguments of a robot written as xacro",
        {"ur_type": "ur10", "safety_limits": True},
        default_factory=dict,
    )
    floating: bool | None = optional(
        "whether its base is free, as of a robot that stands on its feet: a joint `root_joint` of "
        "six degrees of freedom, which no drive moves; false: fixed; without it as its file says",
        True,
    )
    gravity: Vector3 = key(
        "in the world's axes", [0.0, 0.0, -9.81], "m/s^2", default=(0.0, 0.0, -9.81)
    )
    locked: dict[str, Number] = key(
        "joints that are fixed at a position and removed",
        {"finger_joint": 0.02},
        "rad or m",
        default_factory=dict,
    )
    payloads: dict[str, Payload] = key(
        "bodies by name",
        {"box": {"link": "tool0", "mass": 2.0, "com": [0, 0, 0.05]}},
        default_factory=dict,
    )
    urdf_dynamics: Literal["ignore", "use"] = key(
        "whether to take the URDF's <dynamics> as `coulomb` and `viscous`; an MJCF's frictionloss, "
        "damping and, as a rotor at the joint, armature",
        "use",
        default="ignore",
    )
    urdf_loops: Literal["ignore", "use"] = key(
        "whether to close the loops that the robot's file states (<loop_joint>, <constraint>, "
        "<drake:ball_constraint>, <gazebo><joint>; an MJCF's connect and weld); one of `loops` "
        "replaces that of its name",
        "ignore",
        default="use",
    )
    masses: Annotated[
        dict[str, MassesHold] | MassesHold | None, Forms(dict[str, MassesHold], MassesHold)
    ] = optional(
        "whether the links' masses hold the drives (motors, gears, brakes), or which drives, "
        "and `others`; `size` adds the mass of those they do not hold",
        "with_drives",
    )
    masses_confirmed: bool = key(
        "whether the robot weighs what the URDF says, where `pinfric check` doubts it",
        True,
        default=False,
    )

    @model_validator(mode="after")
    def _one_file(self) -> RobotEntry:
        if (self.urdf is None) == (self.mjcf is None):
            raise ValueError("give `urdf`, the robot's file, or `mjcf`, and not both")
        return self


class Foot(Entry):
    """A foot on which a robot with a free base stands, on one level ground."""

    mu: Positive = key("coefficient of friction of the ground", 0.6, "1", default=0.6)
    length: NonNegative = key(
        "of its sole, along x of its frame; 0: a point",
        0.2,
        "m",
        default=0.0,
    )
    width: NonNegative = key("of its sole, along y of its frame", 0.1, "m", default=0.0)
    xyz: Vector3 = key(
        "where it touches the ground, or the middle of its sole, in its link's frame",
        [0.0, 0.0, -0.21],
        "m",
        default=(0.0, 0.0, 0.0),
    )


def _added_term(named: tuple[str, Any] | str) -> FrictionTerm | None:
    if isinstance(named, str):  # see `Entry._known_keys`
        raise PydanticKnownError("extra_forbidden")
    name, value = named
    return None if value is None else TERMS[name].model_validate(value)


class Friction(Entry):
    """The friction of one joint: a bearing with coefficients, a constant part, a viscous part.

    Further keys are terms that a class of `FrictionTerm` adds.
    """

    model_config = ConfigDict(extra="allow")  # `key_names` says which
    __pydantic_extra__: dict[str, Annotated[Any, BeforeValidator(_added_term)]] = Field(init=False)

    bearing: SerializeAsAny[Bearing] | None = optional(
        "geometry from which the normal load follows", {"kind": "pin", "radius": 0.05}
    )
    mu: LoadFriction | None = optional("friction / normal load", {"static": 0.15, "kinetic": 0.1})
    stribeck: Stribeck | None = optional(
        "how `mu` and `coulomb` fall from static to kinetic; without it by a jump",
        {"velocity": 0.02},
    )
    coulomb: Coulomb = optional("friction independent of the load", {"static": 6.0, "kinetic": 5.0})
    viscous: Viscous = optional(
        "friction that grows with the speed", 3.0, "N m or N at 1 rad/s or 1 m/s"
    )
    stick_velocity: NonNegative | None = optional(
        "at or below which the joint sticks", 0.0001, "rad/s or m/s"
    )
    presliding: Presliding | None = optional(
        "the way over which friction builds up after a reversal; without it at once",
        {"way": 0.001},
    )
    includes_drive: bool = key(
        "whether `coulomb` and `viscous` were measured from motor currents and so include the "
        "losses of the drive; for another drive these are removed",
        True,
        default=False,
    )

    @classmethod
    def key_names(cls) -> list[str]:
        """Return the keys that a mapping may have, including those of added classes."""
        return [*super().key_names(), *TERMS]

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Return the schema with the keys of added classes, and no others."""
        schema = handler(core)
        resolved = handler.resolve_ref_schema(schema)
        resolved["additionalProperties"] = False
        for name, term in TERMS.items():
            resolved["properties"][name] = handler(term.__pydantic_core_schema__)
        return schema

    @property
    def terms(self) -> tuple[FrictionTerm, ...]:
        """The terms whose sum is the friction."""
        return tuple(self.named_terms.values())

    @property
    def named_terms(self) -> dict[str, FrictionTerm]:
        """The terms by their keys."""
        return {name: term for name, term in self if isinstance(term, FrictionTerm)}

    def scaled(self, factor: float) -> Friction:
        """Return the friction with every term times a factor."""
        terms = {name: term.scaled(factor) for name, term in self.named_terms.items()}
        return self.model_copy(update=terms)

    @model_validator(mode="before")
    @classmethod
    def _with_keys(cls, value: Any) -> Any:
        # an added term is read together with its key, which determines its class
        if not isinstance(value, dict):
            return value
        return {k: x if k in cls.model_fields else (k, x) for k, x in value.items()}

    @model_validator(mode="after")
    def _bearing_and_mu_belong_together(self) -> Friction:
        if (self.bearing is None) != (self.mu is None):
            have, miss = ("mu", "bearing") if self.bearing is None else ("bearing", "mu")
            raise ValueError(f"`{have}` without `{miss}`: friction = mu x the bearing's load")
        if self.stribeck is not None and self.mu is None and self.coulomb is None:
            raise ValueError("`stribeck` needs `mu` or `coulomb` to act on")
        if self.presliding is not None and not any(max(term.at_rest()) for term in self.terms):
            raise ValueError("`presliding` needs `mu` or `coulomb`, which build up over its way")
        return self

    def questions(self) -> Iterator[str]:
        """Yield a warning for a coefficient that no pair of materials has."""
        if self.mu is not None:
            yield from unlikely("mu.static", self.mu.static, 2.0, "")


class Cylinder(Entry):
    """A drive along the line between two points of two links; a positive effort lengthens it."""

    name: str = key("of the drive", "boom")
    a: LinkPoint = key("point at its base", {"link": "base", "xyz": [0.2, 0, 0.1]})
    b: LinkPoint = key("point that it pushes", {"link": "boom", "xyz": [0.5, 0, 0.2]})


class PointForce(Entry):
    """A drive that pushes a point of a link against the world; all in the link's frame."""

    name: str = key("of the drive", "push")
    link: str = key("of the robot", "drawer")
    xyz: Vector3 = key("point at which it pushes", [0, 0.2, 0], "m", default=(0.0, 0.0, 0.0))
    direction: Vector3 = key("of the force; its length does not matter", [1, 0, 0], "1")


class LinkFrame(Entry):
    """A frame on a link, in the link's frame."""

    link: str = key("of the robot", "coupler")
    xyz: Vector3 = key("its origin", [0.35, 0, 0], "m", default=(0.0, 0.0, 0.0))
    rpy: Vector3 = key(
        "its axes, as in a URDF",
        [0, 0, 1.5707963],
        "rad",
        default=(
            0.0,
            0.0,
            0.0,
        ),
    )


class Loop(Entry):
    """A joint that closes a loop between frame a on one link and frame b on another.

    The frames coincide except for the joint's free motion: a `prismatic` one slides along the axis,
    a `cylindrical` one also turns about it, a `universal` one keeps the axis in frame a and
    `axis_b` in frame b perpendicular.
    """

    name: str = key("of the loop, for use in `friction` and `actuators`", "rocker_pin")
    kind: Literal[
        "spherical", "revolute", "fixed", "planar_pin", "prismatic", "cylindrical", "universal"
    ] = key("type of the joint", "spherical")
    axis: Vector3 = key(
        "in frame a, and in frame b where they coincide", [0, 0, 1], "1", default=(0.0, 0.0, 1.0)
    )
    axis_b: Vector3 | None = optional("second axis of a universal, in b", [0, 1, 0], "1")
    a: LinkFrame = key("frame on one link", {"link": "coupler", "xyz": [0.35, 0, 0]})
    b: LinkFrame = key("frame on the other link", {"link": "rocker", "xyz": [0.25, 0, 0]})

    @model_validator(mode="after")
    def _second_axis_of_a_universal(self) -> Loop:
        if (self.axis_b is not None) != (self.kind == "universal"):
            raise ValueError(
                "a universal loop needs `axis_b`, the second axis, in frame b (`axis` is in a)"
                if self.axis_b is None
                else f"a {self.kind} loop has one axis: leave `axis_b` out"
            )
        return self


class LoopTolerance(Entry):
    """Largest errors of rounded files that are corrected so that loops close; 0: none."""

    angle: NonNegative = key(
        "error of parallel or perpendicular axes", 1e-05, "rad", default=1.0e-5
    )
    length: NonNegative = key("distance of the loop's frames", 1e-06, "m", default=1.0e-6)


class Redundancy(Entry):
    """Choice of reactions that are not unique: the sum of |F|^2 + |M/l|^2 is least."""

    length: Positive = key("l, which weights moments against forces", 0.1, "m", default=0.1)


class Product(Entry):
    """The product that is installed as a drive, by the names of a catalogue."""

    drive: Text = key("motor and gear as `pinfric size` names them", "CubeMars AK80-64")
    brake: Text | None = optional("at the motor's shaft", "Kendrion INTORQ BFK551-01")


class Sized(Entry):
    """The masses for which `pinfric size` chose the drives; `retime` refuses others."""

    joints: dict[str, Number] = key("mass that moves with each joint, kg", {"elbow": 4.2})
    payloads: dict[str, Number] = key("masses, kg", {"part": 5.0}, default_factory=dict)


class Actuator(Entry):
    """One drive: on a joint (of the robot or of a loop), a cylinder, or a force at a point.

    Several drives on one joint need a `name` each. Redundant drives share the work by `share`s w:
    the sum of effort^2 / w is least, so drives on one joint share its effort as w1 : w2.

    `couples` names other joints that also turn this drive, with the factor for each:

        {joint: wrist_3_joint, couples: {wrist_2_joint: 1.0}, transmission: {ratio: 32}}

    turns its motor by 32 (q_wrist_3 + 1.0 q_wrist_2). A factor is positive if the motor must turn
    forward while the other joint moves forward and its own joint is at rest. A controller's figure
    in motor turns per turn (or m) of the other joint is factor x ratio. The drive's effort t acts
    on its own joint, and factor x t on the other.
    """

    joint: str | None = optional("joint of the robot or of a loop", "joint_2")
    name: str | None = optional("of the drive; default: its joint's", "joint_2_left")
    share: Positive | None = optional("w, share of the work of redundant drives", 2.0, "1")
    couples: dict[str, Number] = key(
        "other joints that turn this drive, with factors", {"joint_2": 1.0}, default_factory=dict
    )
    transmission: SerializeAsAny[Transmission] | None = optional(
        "gear and motor; without it an ideal drive", {"ratio": 100}
    )
    installed: Product | None = optional(
        "the product whose figures stand under `transmission`", {"drive": "CubeMars AK80-64"}
    )
    encoder: Literal["motor", "joint"] = key(
        "angle that the controller measures; with `motor` the wind-up of an elastic gear "
        "moves the joint, with `joint` the controller corrects it",
        "joint",
        default="motor",
    )
    cylinder: Cylinder | None = optional(
        "a drive between two points", {"name": "boom", "a": {"link": "base"}, "b": {"link": "boom"}}
    )
    force: PointForce | None = optional(
        "a drive at a point", {"name": "push", "link": "drawer", "direction": [1, 0, 0]}
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Actuator:
        kinds = [k for k in ("joint", "cylinder", "force") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise ValueError(f"an actuator is one of joint, cylinder, force; found {kinds}")
        if self.name is not None and self.joint is None:
            raise ValueError(f"give `name` inside `{kinds[0]}`")
        if self.installed is not None and self.transmission is None:
            raise ValueError(
                "`installed` names a product, but its figures are missing: give `transmission` as "
                "`pinfric size --out` writes it"
            )
        if self.couples and self.joint is None:
            raise ValueError(f"`couples` is for drives on joints, not for a {kinds[0]}")
        for name, factor in self.couples.items():
            if name == self.joint:
                raise ValueError(f"`couples` names its own joint {name!r}; leave it out")
            if factor == 0.0:
                raise ValueError(f"`couples.{name}` must not be 0; leave it out")
        return self

    @property
    def drive_name(self) -> str:
        """The name of its column of efforts: its own name, else its joint's."""
        line = self.cylinder or self.force
        return line.name if line is not None else self.name or self.joint or ""


class Stick(Entry):
    """When a joint counts as being at rest."""

    velocity: NonNegative = key(
        "at or below which a joint sticks; larger for logs", 0.001, "rad/s or m/s", default=1.0e-6
    )


class Sine(Entry):
    """amplitude sin(angular_frequency t + phase)."""

    amplitude: Number = key("of the effort or of the motor torque", 5.0, "N m or N")
    angular_frequency: Number = key("2 pi times the frequency", 1.0, "rad/s")
    phase: Number = key("at t = 0", 1.5707963, "rad", default=0.0)


class SineEffort(Entry):
    """A drive's effort, or its motor's torque, as a sine of time."""

    sine: Sine = key("its numbers", {"amplitude": 5.0, "angular_frequency": 1.0})


class TableEffort(Entry):
    """A drive's effort, or its motor's torque, from a CSV file with columns t and one per drive."""

    table: str = key("file beside the scene", "torques.csv")


GivenEffort = Annotated[float | SineEffort | TableEffort, Forms(Number, SineEffort, TableEffort)]


class Start(Entry):
    """Initial angles (or lengths) and rates by joint; 0 for joints that are not listed."""

    q: dict[str, Number] = key("by joint", {"joint_1": 0.5}, "rad or m", default_factory=dict)
    v: dict[str, Number] = key(
        "by joint", {"joint_1": 1.0, "joint_12": -1.0}, "rad/s or m/s", default_factory=dict
    )


class Simulation(Entry):
    """Input of `pinfric simulate SCENE`: efforts of drives, or torques of their motors."""

    start: Start = key("initial state", {"q": {"joint_1": 0.5}}, default=Start())
    effort: dict[str, GivenEffort] = key(
        "by drive; 0 for drives that are not listed",
        {"joint_1": 2.0, "joint_23": {"table": "torques.csv"}},
        "N m or N",
        default_factory=dict,
    )
    motor_torque: dict[str, GivenEffort] = key(
        "in place of `effort`, at the shafts", {"joint_2": 0.1}, "N m", default_factory=dict
    )
    t_end: Positive | None = optional("time at the end, which `simulate` needs", 1.0, "s")

    @model_validator(mode="after")
    def _one_of_them(self) -> Simulation:
        if self.effort and self.motor_torque:
            raise ValueError("`effort` and `motor_torque`: give one of them, for all drives")
        return self


class Stops(Entry):
    """How the robot is stopped, input of `pinfric stop`.

    The categories are those of IEC 60204-1. 0: after `reaction_time` power goes off, and the brakes
    close after their `engage_time`. 1: after `reaction_time` the robot is braked under power with
    `deceleration`, along its path or each axis by itself; without any, each axis by itself with the
    URDF's effort limit. At rest, or once the brakes have closed, power goes off.
    """

    category: Literal[0, 1] = key("of IEC 60204-1", 0)
    reaction_time: NonNegative = key(
        "from the command until the drives react; the motion goes on", 0.02, "s"
    )
    deceleration: dict[str, Positive] = key(
        "of category 1, the most of each drive; empty: what the URDF's effort limits allow",
        {"joint_1": 6.0, "joint_2": 4.0},
        "rad/s^2 or m/s^2",
        default_factory=dict,
    )
    along_path: bool = key(
        "whether `deceleration` slows the robot on its path, all axes together; else each axis "
        "stops by itself, and the tool leaves the path",
        True,
        default=True,
    )
    power_until_braked: bool = key(
        "of category 1: whether the drives hold the robot until its brakes have closed; else "
        "power goes off as soon as it is at rest, and it can sag",
        True,
        default=False,
    )
    friction: tuple[NonNegative, NonNegative] = key(
        "least and greatest factor on all friction and gear losses",
        [0.7, 1.3],
        "1",
        default=(1.0, 1.0),
    )
    per_hour: Positive | None = optional("how often it is stopped so", 4.0, "1/h")

    @model_validator(mode="after")
    def _in_order(self) -> Stops:
        if self.friction[0] > self.friction[1]:
            raise ValueError(
                f"`friction` {list(self.friction)}: the first is the least factor, the second the "
                "greatest; swap them"
            )
        if self.power_until_braked and self.category == 0:
            raise ValueError(
                "`power_until_braked` is for category 1; in category 0 the drives have no power: "
                "leave it out, or give `category: 1`"
            )
        if self.deceleration and self.category == 0:
            raise ValueError(
                "`deceleration` is for category 1; in category 0 the drives have no power: leave "
                "it out, or give `category: 1`"
            )
        return self


#: deg C: no gear's grease is hotter.
_HOTTEST = 200.0
#: Least and greatest value of something measured.
Range = tuple[NonNegative, NonNegative]


class Measured(Entry):
    """Where the scene's friction was measured, and how well it is documented.

    measured: {robot: UR10e, speed: [0, 1.0], side: motor, source: "log and commit", grade: A}

    Grades: A: the logs or the maker's test record are public; B: the method is stated, the logs are
    not public; C: neither. Motions beyond `speed` cause a warning, because laws of friction do not
    extrapolate.
    """

    robot: Text = key("maker and type of the one measured", "Universal Robots UR10e")
    speed: Annotated[dict[str, Range] | Range, Forms(dict[str, Range], Range)] | None = optional(
        "least and greatest, of all joints or by joint; without it: not published",
        [0, 1.0],
        "rad/s or m/s",
    )
    temperature: tuple[Number, Number] | None = optional(
        "of the joints, least and greatest", [42, 46], "deg C"
    )
    side: Literal["joint", "motor", "joint torque sensor"] = key(
        "where torque was measured; `motor`: from its current, with the gear's losses", "motor"
    )
    source: Text = key("publication or repository with its commit", "arXiv 2502.11940, table 2")
    licence: Text | None = optional("of the figures", "BSD-3-Clause")
    grade: Literal["A", "B", "C"] = key("how well it is documented", "A")

    @field_validator("speed", "temperature", mode="before")
    @classmethod
    def _two_numbers(cls, value: Any, info: ValidationInfo) -> Any:
        unit, example = {
            "speed": ("rad/s or m/s", "[0, 1.0]"),
            "temperature": ("deg C", "[42, 46]"),
        }[info.field_name or ""]
        for pair in value.values() if isinstance(value, dict) else [value]:
            if pair is not None and not (
                isinstance(pair, list | tuple)
                and len(pair) == 2
                and all(isinstance(x, int | float) for x in pair)
            ):
                raise ValueError(
                    f"should be the least and the greatest, two numbers in {unit}, e.g. {example}; "
                    f"found {pair!r}"
                )
        return value

    @model_validator(mode="after")
    def _in_order(self) -> Measured:
        by_joint = self.speed if isinstance(self.speed, dict) else {"": self.speed}
        ranges = {f"speed {name}".strip(): pair for name, pair in by_joint.items()}
        for name, pair in (ranges | {"temperature": self.temperature}).items():
            if pair is not None and pair[0] > pair[1]:
                raise ValueError(f"`{name}` {list(pair)}: the least comes first; swap them")
        if self.temperature and self.temperature[1] > _HOTTEST:
            low, high = (round(x - 273.15, 1) for x in self.temperature)
            raise ValueError(
                f"`temperature` {list(self.temperature)}: is in deg C; if these are kelvin, write "
                f"[{low:g}, {high:g}]"
            )
        return self

    @property
    def speeds(self) -> list[Range]:
        """The published ranges of speed, of all joints or one each."""
        pairs = self.speed.values() if isinstance(self.speed, dict) else [self.speed]
        return [pair for pair in pairs if pair is not None]

    def summary(self) -> str:
        """Return it in a line."""
        tops = " or ".join(sorted({f"{top:g}" for _, top in self.speeds}))
        to = f"to {tops} rad/s or m/s" if tops else "speeds not published"
        return f"{self.robot}, {to}, at the {self.side}, grade {self.grade}: {self.source}"

    def top_speed(self, joint: str) -> float | None:
        """Return the greatest measured speed of a joint (rad/s or m/s); None: not published."""
        pair = self.speed.get(joint) if isinstance(self.speed, dict) else self.speed
        return None if pair is None else pair[1]


class Assumed(Entry):
    """Which entries of a scene are guesses. Delete the line of an entry that you replace."""

    by: str = key("command that guessed", "pinfric new arm.urdf")
    date: str = key("when", "2026-11-22")
    version: str = key("of pinfric", "1.0.0")
    inputs: dict[str, str] = key(
        "file read: its SHA-256", {"arm.urdf": "9f86d081884c7d65"}, default_factory=dict
    )
    values: dict[str, str] = key(
        "entry: reason for the guess", {"friction.elbow.coulomb": "5 % of 150 N m"}
    )


def guesses_left(
    assumed: Assumed, before: Mapping[str, Friction], after: Mapping[str, Friction]
) -> Assumed | None:
    """Return the guesses that a change of friction left as they were; None if none is left."""

    def value(friction: Mapping[str, Friction], place: str) -> Any:
        joint, _, name = place.removeprefix("friction.").rpartition(".")
        return getattr(friction.get(joint), name, None)

    values = {
        place: why
        for place, why in assumed.values.items()
        if not place.startswith("friction.") or value(before, place) == value(after, place)
    }
    return assumed.model_copy(update={"values": values}) if values else None


class SceneFile(Entry):
    """A whole scene file."""

    pinfric: Version = key("version of the format", 1)
    robot: RobotEntry = key("which robot", {"urdf": "three_link.urdf"})
    friction: dict[str, Friction] = key(
        "by joint, loop, cylinder or spring; others have none",
        {"elbow": {"viscous": 3.0}},
        default_factory=dict,
    )
    loops: list[Loop] = key(
        "joints that close loops",
        [
            {
                "name": "rocker_pin",
                "kind": "spherical",
                "a": {"link": "coupler"},
                "b": {"link": "rocker"},
            }
        ],
        default_factory=list,
    )
    loop_tolerance: LoopTolerance = key(
        "for rounded files", {"angle": 1e-05}, default=LoopTolerance()
    )
    redundancy: Redundancy = key(
        "for mechanisms with redundant constraints", {"length": 0.1}, default=Redundancy()
    )
    actuators: list[Actuator] | None = optional(
        "the drives; without it one ideal drive per joint", [{"joint": "joint_1"}]
    )
    springs: SpringsKey = Field(default_factory=list)
    feet: dict[str, Foot] = key(
        "links on which a robot with a free base stands: where a motion brings no forces, these "
        "are within friction",
        {"left_sole": {"length": 0.2, "width": 0.1}},
        default_factory=dict,
    )
    stick: Stick = key("when a joint is at rest", {"velocity": 1e-06}, default=Stick())
    tool: str | None = optional(
        "link whose frame is the tool's; its position error due to elastic gears is computed, "
        "and limited by the `conditions` of a catalogue",
        "tool0",
    )
    simulation: Simulation | None = optional("input of `pinfric simulate`", {"t_end": 1.0})
    stops: Stops | None = optional(
        "input of `pinfric stop`", {"category": 0, "reaction_time": 0.02}
    )
    measured: Measured | None = optional(
        "where its friction was measured",
        {"robot": "UR10e", "side": "motor", "source": "its paper", "grade": "A"},
    )
    sized: Sized | None = optional(
        "written by `pinfric size --out`: the masses that the drives were chosen for",
        {"joints": {"elbow": 4.2}},
    )
    assumed: Assumed | None = optional(
        "guesses among the entries; every report lists them",
        {
            "by": "pinfric new arm.urdf",
            "date": "2026-11-22",
            "version": "1.0.0",
            "values": {"friction.elbow.coulomb": "5 % of 150 N m"},
        },
    )

    @model_validator(mode="after")
    def _measured_joints_have_friction(self) -> SceneFile:
        speed = self.measured.speed if self.measured else None
        for joint in speed if isinstance(speed, dict) else ():
            if joint not in self.friction:
                raise ValueError(
                    f"`measured.speed` has {joint!r}, which has no friction here; "
                    f"{choose_from(joint, list(self.friction))}"
                )
        return self

    @model_validator(mode="after")
    def _guesses_are_there(self) -> SceneFile:
        for place in self.assumed.values if self.assumed else ():
            if place == "robot.masses" and self.robot.masses is None:
                raise ValueError(
                    "`assumed.values` has `robot.masses`, which this scene does not have; delete "
                    "its line"
                )
            if not place.startswith("friction."):
                continue
            joint, _, name = place.removeprefix("friction.").rpartition(".")
            if joint not in self.friction:
                near = choose_from(joint, list(self.friction))
                raise ValueError(
                    f"`assumed.values` has `{place}`, but `friction` has no {joint!r}: correct its "
                    f"name there, or delete its lines here; {near}"
                )
            if name not in self.friction[joint].model_fields_set:
                raise ValueError(
                    f"`assumed.values` has `{place}`, which this scene does not have; delete its "
                    "line"
                )
        return self
