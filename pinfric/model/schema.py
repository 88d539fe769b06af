"""The scene's file format: one frozen pydantic model per section.

Nothing here knows a robot. Checks that need one (does the joint exist, does the bearing fit its
kind) live in `scene.py`; what a single entry can get wrong by itself is refused here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    SerializeAsAny,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticKnownError

from pinfric.model.bearings import Bearing
from pinfric.model.entry import (
    Entry,
    Forms,
    NonNegative,
    Number,
    Positive,
    Vector3,
    Version,
    key,
    unlikely,
)
from pinfric.model.friction_terms import (
    TERMS,
    Coulomb,
    FrictionTerm,
    LoadFriction,
    Stribeck,
    Viscous,
)
from pinfric.model.transmission import Transmission


class Payload(Entry):
    """A body carried by a link."""

    link: Annotated[str, key("of the robot that carries it", "tool0")]
    mass: Annotated[Positive, key("of the body", 2.0, "kg")]
    com: Annotated[Vector3, key("centre of mass in the link's frame", [0, 0, 0.05], "m")]
    inertia: Annotated[
        tuple[Number, Number, Number, Number, Number, Number],
        key(
            "ixx, ixy, ixz, iyy, iyz, izz about its own `com`, in the link's axes",
            [0.01, 0, 0, 0.01, 0, 0.01],
            "kg m^2",
        ),
    ] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    attached: Annotated[
        bool, key("whether it is carried unless a trajectory says otherwise", False)
    ] = True


class RobotEntry(Entry):
    """Which URDF, how gravity acts on it, what is locked and what it carries."""

    urdf: Annotated[
        str,
        key(
            "file beside the scene, or one of example-robot-data",
            "example-robot-data:ur_description/urdf/ur5_robot.urdf",
        ),
    ]
    gravity: Annotated[Vector3, key("in the world's axes", [0.0, 0.0, -9.81], "m/s^2")] = (
        0.0,
        0.0,
        -9.81,
    )
    locked: Annotated[
        dict[str, Number],
        key("joints that are fixed there and removed", {"finger_joint": 0.02}, "rad or m"),
    ] = Field(default_factory=dict)
    payloads: Annotated[
        dict[str, Payload],
        key("bodies by name", {"box": {"link": "tool0", "mass": 2.0, "com": [0, 0, 0.05]}}),
    ] = Field(default_factory=dict)
    urdf_dynamics: Annotated[
        Literal["ignore", "use"],
        key("whether to take the URDF's <dynamics> as `coulomb` and `viscous`", "use"),
    ] = "ignore"


def _added_term(named: tuple[str, Any] | str) -> FrictionTerm | None:
    if isinstance(named, str):  # see `Entry._known_keys`
        raise PydanticKnownError("extra_forbidden")
    name, value = named
    return None if value is None else TERMS[name].model_validate(value)


class Friction(Entry):
    """The friction of one joint: a bearing with coefficients, a constant part, a viscous part.

    Keys beyond these are terms that a class of `FrictionTerm` adds.
    """

    model_config = ConfigDict(extra="allow")  # `key_names` says which
    __pydantic_extra__: dict[str, Annotated[Any, BeforeValidator(_added_term)]] = Field(init=False)

    bearing: Annotated[
        SerializeAsAny[Bearing] | None,
        key("what makes a normal load of the joint's wrench", {"kind": "pin", "radius": 0.05}),
    ] = None
    mu: Annotated[
        LoadFriction | None, key("friction per load", {"static": 0.15, "kinetic": 0.1})
    ] = None
    stribeck: Annotated[
        Stribeck | None,
        key(
            "how `mu` and `coulomb` fall from static to kinetic; left out, in a jump",
            {"velocity": 0.02},
        ),
    ] = None
    coulomb: Annotated[
        Coulomb | None,
        key("friction whatever the load, also by direction", {"static": 6.0, "kinetic": 5.0}),
    ] = None
    viscous: Annotated[
        Viscous, key("friction that grows with the speed", 3.0, "N m or N at 1 rad/s or 1 m/s")
    ] = None
    stick_velocity: Annotated[
        NonNegative | None, key("at or below which the joint sticks", 0.0001, "rad/s or m/s")
    ] = None
    includes_drive: Annotated[
        bool,
        key(
            "`coulomb` and `viscous` were measured through the drive (by its motor's current) and "
            "hold its losses, which go where another drive takes its place",
            True,
        ),
    ] = False

    @classmethod
    def key_names(cls) -> list[str]:
        """Return the keys a mapping may have, those that classes add, too."""
        return [*super().key_names(), *TERMS]

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """With the keys that classes add, and no others."""
        schema = handler(core)
        made = handler.resolve_ref_schema(schema)
        made["additionalProperties"] = False
        for name, term in TERMS.items():
            made["properties"][name] = handler(term.__pydantic_core_schema__)
        return schema

    @property
    def terms(self) -> tuple[FrictionTerm, ...]:
        """The terms it is a sum of."""
        return tuple(self.named_terms.values())

    @property
    def named_terms(self) -> dict[str, FrictionTerm]:
        """The same by their keys."""
        return {name: term for name, term in self if isinstance(term, FrictionTerm)}

    @model_validator(mode="before")
    @classmethod
    def _with_keys(cls, value: Any) -> Any:
        # what a class adds is read with its key, which says the class
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
        return self

    def questions(self) -> Iterator[str]:
        """Ask about a coefficient that no materials have."""
        if self.mu is not None:
            yield from unlikely("mu.static", self.mu.static, 2.0, "")


class LinkPoint(Entry):
    """A point of a link."""

    link: Annotated[str, key("of the robot", "base")]
    xyz: Annotated[Vector3, key("in the link's frame", [0.2, 0, 0.1], "m")] = (0.0, 0.0, 0.0)


class Cylinder(Entry):
    """A drive along the line between two points of two links; a positive effort lengthens it."""

    name: Annotated[str, key("of the drive", "boom")]
    a: Annotated[LinkPoint, key("the point it stands on", {"link": "base", "xyz": [0.2, 0, 0.1]})]
    b: Annotated[LinkPoint, key("the point it pushes", {"link": "boom", "xyz": [0.5, 0, 0.2]})]


class PointForce(Entry):
    """A drive that pushes a point of a link and reacts on the world; all in the link's frame."""

    name: Annotated[str, key("of the drive", "push")]
    link: Annotated[str, key("of the robot", "drawer")]
    xyz: Annotated[Vector3, key("where it pushes", [0, 0.2, 0], "m")] = (0.0, 0.0, 0.0)
    direction: Annotated[Vector3, key("of the force, of any length", [1, 0, 0], "1")]


class LinkFrame(Entry):
    """A frame on a link, in the link's frame."""

    link: Annotated[str, key("of the robot", "coupler")]
    xyz: Annotated[Vector3, key("its origin", [0.35, 0, 0], "m")] = (0.0, 0.0, 0.0)
    rpy: Annotated[Vector3, key("its axes, as in a URDF", [0, 0, 1.5707963], "rad")] = (
        0.0,
        0.0,
        0.0,
    )


class Loop(Entry):
    """A joint that closes a loop between frame a on one link and frame b on another.

    The frames coincide but for what the joint lets free: a `prismatic` one slides along the axis, a
    `cylindrical` one turns about it besides, a `universal` one keeps frame a's axis and frame b's
    `axis_b` perpendicular.
    """

    name: Annotated[
        str, key("of the loop, by which `friction` and `actuators` find it", "rocker_pin")
    ]
    kind: Annotated[
        Literal[
            "spherical", "revolute", "fixed", "planar_pin", "prismatic", "cylindrical", "universal"
        ],
        key("what the joint lets free", "spherical"),
    ]
    axis: Annotated[
        Vector3, key("in frame a, and in frame b where they coincide", [0, 0, 1], "1")
    ] = (0.0, 0.0, 1.0)
    axis_b: Annotated[Vector3 | None, key("of a `universal` one, in frame b", [0, 1, 0], "1")] = (
        None
    )
    a: Annotated[LinkFrame, key("frame on one link", {"link": "coupler", "xyz": [0.35, 0, 0]})]
    b: Annotated[LinkFrame, key("frame on the other link", {"link": "rocker", "xyz": [0.25, 0, 0]})]

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
    """By how much rounded files may miss what a loop needs; 0 for not at all."""

    angle: Annotated[
        NonNegative, key("by which axes may miss being parallel or perpendicular", 1e-05, "rad")
    ] = 1.0e-5
    length: Annotated[NonNegative, key("by which frames may miss each other", 1e-06, "m")] = 1.0e-6


class Redundancy(Entry):
    """How reactions are shared that a redundant mechanism leaves open: least |F|^2 + |M/l|^2."""

    length: Annotated[Positive, key("l, which weighs moments against forces", 0.1, "m")] = 0.1


class Actuator(Entry):
    """One drive: on a joint (of the robot or of a loop), a cylinder, or a force at a point.

    A joint with several drives needs `name`s for them. Where drives outnumber the freedoms that
    they move, `share`s w say who does how much: the sum of effort^2 / w is least, so that drives
    on one joint share its effort as w1 : w2.

    `couples` names other joints that turn this drive, too, and how far per turn of theirs:

        {joint: wrist_3_joint, couples: {wrist_2_joint: 1.0}, transmission: {ratio: 32}}

    turns its motor by 32 (q_wrist_3 + 1.0 q_wrist_2). A factor is positive where the motor must
    turn forward while the other joint moves forward and its own stands; a controller's figure in
    motor turns per turn of the other joint is factor x ratio (per m of a joint that slides). The
    drive's effort t acts on its own joint, and factor x t on the other.
    """

    joint: Annotated[str | None, key("of the robot or of a loop that it drives", "joint_2")] = None
    name: Annotated[str | None, key("of the drive; left out, its joint's", "joint_2_left")] = None
    share: Annotated[
        Positive | None, key("w, of the work that redundant drives share", 2.0, "1")
    ] = None
    couples: Annotated[
        dict[str, Number],
        key("other joints that turn this drive, with their factors", {"joint_2": 1.0}),
    ] = Field(default_factory=dict)
    transmission: Annotated[
        Transmission | None, key("gear and motor; left out, an ideal drive", {"ratio": 100})
    ] = None
    encoder: Annotated[
        Literal["motor", "joint"],
        key(
            "what the controller measures, the motor's angle or the joint's: behind an elastic "
            "gear only the first lets the load move the joint",
            "joint",
        ),
    ] = "motor"
    cylinder: Annotated[
        Cylinder | None,
        key(
            "a drive between two points",
            {"name": "boom", "a": {"link": "base"}, "b": {"link": "boom"}},
        ),
    ] = None
    force: Annotated[
        PointForce | None,
        key("a drive at a point", {"name": "push", "link": "drawer", "direction": [1, 0, 0]}),
    ] = None

    @model_validator(mode="after")
    def _one_kind(self) -> Actuator:
        kinds = [k for k in ("joint", "cylinder", "force") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise ValueError(f"an actuator is one of joint, cylinder, force; found {kinds}")
        if self.name is not None and self.joint is None:
            raise ValueError(f"`name` stands inside `{kinds[0]}`")
        if self.couples and self.joint is None:
            raise ValueError(f"`couples` is of drives on joints, not of a {kinds[0]}")
        for name, factor in self.couples.items():
            if name == self.joint:
                raise ValueError(f"`couples` names its own joint {name!r}; leave it out")
            if factor == 0.0:
                raise ValueError(f"`couples.{name}` 0 couples nothing; leave it out")
        return self

    @property
    def drive_name(self) -> str:
        """The name of its efforts: its own, else its joint's."""
        given = self.cylinder or self.force
        return given.name if given is not None else self.name or self.joint or ""


class Stick(Entry):
    """When a joint stands still."""

    velocity: Annotated[
        NonNegative, key("at or below it a joint sticks; logs need more", 0.001, "rad/s or m/s")
    ] = 1.0e-6


class Sine(Entry):
    """amplitude sin(angular_frequency t + phase)."""

    amplitude: Annotated[Number, key("of the effort, N m of a motor's torque", 5.0, "N m or N")]
    angular_frequency: Annotated[Number, key("2 pi times the frequency", 1.0, "rad/s")]
    phase: Annotated[Number, key("at t = 0", 1.5707963, "rad")] = 0.0


class SineEffort(Entry):
    """A drive's effort, or its motor's torque, as a sine of time."""

    sine: Annotated[Sine, key("its numbers", {"amplitude": 5.0, "angular_frequency": 1.0})]


class TableEffort(Entry):
    """A drive's effort, or its motor's torque, from a CSV file with columns t and one per drive."""

    table: Annotated[str, key("file beside the scene", "torques.csv")]


GivenEffort = Annotated[float | SineEffort | TableEffort, Forms(Number, SineEffort, TableEffort)]


class Start(Entry):
    """Initial angles (or lengths) and rates by joint; the rest 0."""

    q: Annotated[dict[str, Number], key("by joint", {"joint_1": 0.5}, "rad or m")] = Field(
        default_factory=dict
    )
    v: Annotated[
        dict[str, Number], key("by joint", {"joint_1": 1.0, "joint_12": -1.0}, "rad/s or m/s")
    ] = Field(default_factory=dict)


class Simulation(Entry):
    """What `pinfric simulate SCENE` runs: efforts of drives, or torques of their motors."""

    start: Annotated[Start, key("where it starts", {"q": {"joint_1": 0.5}})] = Start()
    effort: Annotated[
        dict[str, GivenEffort],
        key(
            "by drive, the rest 0",
            {"joint_1": 2.0, "joint_23": {"table": "torques.csv"}},
            "N m or N",
        ),
    ] = Field(default_factory=dict)
    motor_torque: Annotated[
        dict[str, GivenEffort], key("in its place, at the motors' shafts", {"joint_2": 0.1}, "N m")
    ] = Field(default_factory=dict)
    t_end: Annotated[Positive, key("when it ends", 1.0, "s")]

    @model_validator(mode="after")
    def _one_of_them(self) -> Simulation:
        if self.effort and self.motor_torque:
            raise ValueError("`effort` and `motor_torque`: give one of them, for all drives")
        return self


class SceneFile(Entry):
    """A whole scene file."""

    pinfric: Annotated[Version, key("version of the format", 1)]
    robot: Annotated[RobotEntry, key("which robot", {"urdf": "three_link.urdf"})]
    friction: Annotated[
        dict[str, Friction],
        key("by joint, loop or cylinder; one not named has none", {"elbow": {"viscous": 3.0}}),
    ] = Field(default_factory=dict)
    loops: Annotated[
        list[Loop],
        key(
            "joints that close loops",
            [
                {
                    "name": "rocker_pin",
                    "kind": "spherical",
                    "a": {"link": "coupler"},
                    "b": {"link": "rocker"},
                }
            ],
        ),
    ] = Field(default_factory=list)
    loop_tolerance: Annotated[LoopTolerance, key("for files that round", {"angle": 1e-05})] = (
        LoopTolerance()
    )
    redundancy: Annotated[
        Redundancy, key("for mechanisms with more closures than they need", {"length": 0.1})
    ] = Redundancy()
    actuators: Annotated[
        list[Actuator] | None,
        key("the drives; left out, one ideal drive per joint", [{"joint": "joint_1"}]),
    ] = None
    stick: Annotated[Stick, key("when a joint stands still", {"velocity": 1e-06})] = Stick()
    tool: Annotated[
        str | None,
        key(
            "link whose frame is the tool's, for where elastic gears let it stand; how far off it "
            "may be, a catalogue's `conditions` say",
            "tool0",
        ),
    ] = None
    simulation: Annotated[
        Simulation | None, key("what `pinfric simulate` runs", {"t_end": 1.0})
    ] = None
