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
    NonNegative,
    Number,
    Positive,
    Vector3,
    Version,
    number_or,
    unlikely,
)
from pinfric.model.friction_terms import (
    TERMS,
    CoulombFriction,
    DirectedCoulombFriction,
    FrictionTerm,
    LoadFriction,
    Stribeck,
    Viscous,
    coulomb_of,
)
from pinfric.model.transmission import Transmission

Coulomb = Annotated[
    CoulombFriction | DirectedCoulombFriction | None,
    BeforeValidator(lambda value: coulomb_of(value) if isinstance(value, dict) else value),
]


class Payload(Entry):
    """A body carried by a link.

    Attributes:
        link: of the robot that carries it, e.g. tool0
        mass (kg): of the body, e.g. 2.0
        com (m): centre of mass in the link's frame, e.g. [0, 0, 0.05]
        inertia (kg m^2): ixx, ixy, ixz, iyy, iyz, izz about its own `com`, in the link's axes, e.g.
            [0.01, 0, 0, 0.01, 0, 0.01]
        attached: whether it is carried unless a trajectory says otherwise, e.g. false
    """

    link: str
    mass: Positive
    com: Vector3
    inertia: tuple[Number, Number, Number, Number, Number, Number] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    attached: bool = True


class RobotEntry(Entry):
    """Which URDF, how gravity acts on it, what is locked and what it carries.

    Attributes:
        urdf: file beside the scene, or one of example-robot-data, e.g.
            'example-robot-data:ur_description/urdf/ur5_robot.urdf'
        gravity (m/s^2): in the world's axes, e.g. [0.0, 0.0, -9.81]
        locked (rad or m): joints that are fixed there and removed, e.g. {finger_joint: 0.02}
        payloads: bodies by name, e.g. {box: {link: tool0, mass: 2.0, com: [0, 0, 0.05]}}
        urdf_dynamics: whether to take the URDF's <dynamics> as `coulomb` and `viscous`, e.g. use
    """

    urdf: str
    gravity: Vector3 = (0.0, 0.0, -9.81)
    locked: dict[str, Number] = Field(default_factory=dict)
    payloads: dict[str, Payload] = Field(default_factory=dict)
    urdf_dynamics: Literal["ignore", "use"] = "ignore"


def added_terms() -> dict[str, type[FrictionTerm]]:
    """Return the classes of the terms that are no field of `Friction`, by their keys."""
    return {key: cls for key, cls in TERMS.items() if key not in Friction.model_fields}


def _added_term(keyed: tuple[str, Any]) -> FrictionTerm | None:
    key, value = keyed
    cls = added_terms().get(key)
    if cls is None:
        raise PydanticKnownError("extra_forbidden")
    return None if value is None else cls.model_validate(value)


class Friction(Entry):
    """The friction of one joint: a bearing with coefficients, a constant part, a viscous part.

    Keys beyond these are terms that a class of `FrictionTerm` adds.

    Attributes:
        bearing: what makes a normal load of the joint's wrench, e.g. {kind: pin, radius: 0.05}
        mu: friction per load, e.g. {static: 0.15, kinetic: 0.10}
        stribeck: how `mu` and `coulomb` fall from static to kinetic; left out, in a jump, e.g.
            {velocity: 0.02}
        coulomb: friction whatever the load, also by direction, e.g. {static: 6.0, kinetic: 5.0}
        viscous (N m or N at 1 rad/s or 1 m/s): friction that grows with the speed, e.g. 3.0
        stick_velocity (rad/s or m/s): at or below which the joint sticks, e.g. 1.0e-4
        includes_drive: `coulomb` and `viscous` were measured through the drive (by its motor's
            current) and hold its losses, which go where another drive takes its place, e.g. true
    """

    model_config = ConfigDict(extra="allow")  # `_added_term` refuses what no class adds
    __pydantic_extra__: dict[str, Annotated[Any, BeforeValidator(_added_term)]] = Field(init=False)

    bearing: SerializeAsAny[Bearing] | None = None
    mu: LoadFriction | None = None
    stribeck: Stribeck | None = None
    coulomb: Coulomb = None
    viscous: Viscous = None
    stick_velocity: NonNegative | None = None
    includes_drive: bool = False

    @classmethod
    def keys_and_kinds(cls) -> dict[str, Any]:
        """Return the keys a mapping may have, those that classes add, too."""
        return super().keys_and_kinds() | added_terms()

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """With the keys that classes add, and no others."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        made = handler.resolve_ref_schema(schema)
        made["additionalProperties"] = False
        for key, term in added_terms().items():
            made["properties"][key] = term.describe_keys(handler(term.__pydantic_core_schema__))
        return schema

    @property
    def terms(self) -> tuple[FrictionTerm, ...]:
        """The terms it is a sum of."""
        return tuple(term for _, term in self if isinstance(term, FrictionTerm))

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
    """A point of a link.

    Attributes:
        link: of the robot, e.g. base
        xyz (m): in the link's frame, e.g. [0.2, 0, 0.1]
    """

    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)


class Cylinder(Entry):
    """A drive along the line between two points of two links; a positive effort lengthens it.

    Attributes:
        name: of the drive, e.g. boom
        a: the point it stands on, e.g. {link: base, xyz: [0.2, 0, 0.1]}
        b: the point it pushes, e.g. {link: boom, xyz: [0.5, 0, 0.2]}
    """

    name: str
    a: LinkPoint
    b: LinkPoint


class PointForce(Entry):
    """A drive that pushes a point of a link and reacts on the world; all in the link's frame.

    Attributes:
        name: of the drive, e.g. push
        link: of the robot, e.g. drawer
        xyz (m): where it pushes, e.g. [0, 0.2, 0]
        direction (1): of the force, of any length, e.g. [1, 0, 0]
    """

    name: str
    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    direction: Vector3


class LinkFrame(Entry):
    """A frame on a link, in the link's frame.

    Attributes:
        link: of the robot, e.g. coupler
        xyz (m): its origin, e.g. [0.35, 0, 0]
        rpy (rad): its axes, as in a URDF, e.g. [0, 0, 1.5707963]
    """

    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)


class Loop(Entry):
    """A joint that closes a loop between frame a on one link and frame b on another.

    The frames coincide but for what the joint lets free: a `prismatic` one slides along the axis, a
    `cylindrical` one turns about it besides, a `universal` one keeps frame a's axis and frame b's
    `axis_b` perpendicular.

    Attributes:
        name: of the loop, by which `friction` and `actuators` find it, e.g. rocker_pin
        kind: what the joint lets free, e.g. spherical
        axis (1): in frame a, and in frame b where they coincide, e.g. [0, 0, 1]
        axis_b (1): of a `universal` one, in frame b, e.g. [0, 1, 0]
        a: frame on one link, e.g. {link: coupler, xyz: [0.35, 0, 0]}
        b: frame on the other link, e.g. {link: rocker, xyz: [0.25, 0, 0]}
    """

    name: str
    kind: Literal[
        "spherical", "revolute", "fixed", "planar_pin", "prismatic", "cylindrical", "universal"
    ]
    axis: Vector3 = (0.0, 0.0, 1.0)
    axis_b: Vector3 | None = None
    a: LinkFrame
    b: LinkFrame

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
    """By how much rounded files may miss what a loop needs; 0 for not at all.

    Attributes:
        angle (rad): by which axes may miss being parallel or perpendicular, e.g. 1.0e-5
        length (m): by which frames may miss each other, e.g. 1.0e-6
    """

    angle: NonNegative = 1.0e-5
    length: NonNegative = 1.0e-6


class Redundancy(Entry):
    """How reactions are shared that a redundant mechanism leaves open: least |F|^2 + |M/l|^2.

    Attributes:
        length (m): l, which weighs moments against forces, e.g. 0.1
    """

    length: Positive = 0.1


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

    Attributes:
        joint: of the robot or of a loop that it drives, e.g. joint_2
        name: of the drive; left out, its joint's, e.g. joint_2_left
        share (1): w, of the work that redundant drives share, e.g. 2.0
        couples: other joints that turn this drive, with their factors, e.g. {joint_2: 1.0}
        transmission: gear and motor; left out, an ideal drive, e.g. {ratio: 100}
        encoder: what the controller measures, the motor's angle or the joint's: behind an elastic
            gear only the first lets the load move the joint, e.g. joint
        cylinder: a drive between two points, e.g. {name: boom, a: {link: base}, b: {link: boom}}
        force: a drive at a point, e.g. {name: push, link: drawer, direction: [1, 0, 0]}
    """

    joint: str | None = None
    name: str | None = None
    share: Positive | None = None
    couples: dict[str, Number] = Field(default_factory=dict)
    transmission: Transmission | None = None
    encoder: Literal["motor", "joint"] = "motor"
    cylinder: Cylinder | None = None
    force: PointForce | None = None

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
    """When a joint stands still.

    Attributes:
        velocity (rad/s or m/s): at or below it a joint sticks; logs need more, e.g. 1.0e-3
    """

    velocity: NonNegative = 1.0e-6


class Sine(Entry):
    """amplitude sin(angular_frequency t + phase).

    Attributes:
        amplitude (N m or N): of the effort, N m of a motor's torque, e.g. 5.0
        angular_frequency (rad/s): 2 pi times the frequency, e.g. 1.0
        phase (rad): at t = 0, e.g. 1.5707963
    """

    amplitude: Number
    angular_frequency: Number
    phase: Number = 0.0


class SineEffort(Entry):
    """A drive's effort, or its motor's torque, as a sine of time.

    Attributes:
        sine: its numbers, e.g. {amplitude: 5.0, angular_frequency: 1.0}
    """

    sine: Sine


class TableEffort(Entry):
    """A drive's effort, or its motor's torque, from a CSV file with columns t and one per drive.

    Attributes:
        table: file beside the scene, e.g. torques.csv
    """

    table: str


def _sine_or_table(given: dict[str, object]) -> SineEffort | TableEffort:
    return (TableEffort if "table" in given else SineEffort).model_validate(given)


GivenEffort = Annotated[
    float | SineEffort | TableEffort, BeforeValidator(number_or(_sine_or_table, Number))
]


class Start(Entry):
    """Initial angles (or lengths) and rates by joint; the rest 0.

    Attributes:
        q (rad or m): by joint, e.g. {joint_1: 0.5}
        v (rad/s or m/s): by joint, e.g. {joint_1: 1.0, joint_12: -1.0}
    """

    q: dict[str, Number] = Field(default_factory=dict)
    v: dict[str, Number] = Field(default_factory=dict)


class Simulation(Entry):
    """What `pinfric simulate SCENE` runs: efforts of drives, or torques of their motors.

    Attributes:
        start: where it starts, e.g. {q: {joint_1: 0.5}}
        effort (N m or N): by drive, the rest 0, e.g. {joint_1: 2.0, joint_23: {table: torques.csv}}
        motor_torque (N m): in its place, at the motors' shafts, e.g. {joint_2: 0.1}
        t_end (s): when it ends, e.g. 1.0
    """

    start: Start = Start()
    effort: dict[str, GivenEffort] = Field(default_factory=dict)
    motor_torque: dict[str, GivenEffort] = Field(default_factory=dict)
    t_end: Positive

    @model_validator(mode="after")
    def _one_of_them(self) -> Simulation:
        if self.effort and self.motor_torque:
            raise ValueError("`effort` and `motor_torque`: give one of them, for all drives")
        return self


class SceneFile(Entry):
    """A whole scene file.

    Attributes:
        pinfric: version of the format, e.g. 1
        robot: which robot, e.g. {urdf: three_link.urdf}
        friction: by joint, loop or cylinder; one not named has none, e.g. {elbow: {viscous: 3.0}}
        loops: joints that close loops, e.g. [{name: rocker_pin, kind: spherical, a: {link:
            coupler}, b: {link: rocker}}]
        loop_tolerance: for files that round, e.g. {angle: 1.0e-5}
        redundancy: for mechanisms with more closures than they need, e.g. {length: 0.1}
        actuators: the drives; left out, one ideal drive per joint, e.g. [{joint: joint_1}]
        stick: when a joint stands still, e.g. {velocity: 1.0e-6}
        tool: link whose frame is the tool's, for where elastic gears let it stand, e.g. tool0
        simulation: what `pinfric simulate` runs, e.g. {t_end: 1.0}
    """

    pinfric: Version
    robot: RobotEntry
    friction: dict[str, Friction] = Field(default_factory=dict)
    loops: list[Loop] = Field(default_factory=list)
    loop_tolerance: LoopTolerance = LoopTolerance()
    redundancy: Redundancy = Redundancy()
    actuators: list[Actuator] | None = None
    stick: Stick = Stick()
    tool: str | None = None
    simulation: Simulation | None = None
