"""The scene's file format: one frozen pydantic model per section.

Nothing here knows a robot. Checks that need one (does the joint exist, does the bearing fit its
kind) live in `scene.py`; what a single entry can get wrong by itself is refused here.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    model_validator,
)
from pydantic_core import PydanticKnownError

from pinfric.model.bearings import Bearing
from pinfric.model.entry import (
    Entry,
    NonNegative,
    Number,
    Positive,
    Vector3,
    number_or,
    question,
    strict_number,
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
    """A body carried by a link; `inertia` (kg m^2) about its own `com`, in the link's axes."""

    link: str
    mass: Positive
    com: Vector3
    inertia: tuple[Number, Number, Number, Number, Number, Number] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    attached: bool = True


class RobotEntry(Entry):
    """Which URDF, how gravity acts on it, what is locked and what it carries."""

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
    """

    model_config = ConfigDict(extra="allow")  # `_added_term` refuses what no class adds
    __pydantic_extra__: dict[str, Annotated[Any, BeforeValidator(_added_term)]] = Field(init=False)

    bearing: SerializeAsAny[Bearing] | None = None
    mu: LoadFriction | None = None
    stribeck: Stribeck | None = None
    coulomb: Coulomb = None
    viscous: Viscous = None
    stick_velocity: NonNegative | None = None

    @classmethod
    def keys_and_kinds(cls) -> dict[str, Any]:
        """Return the keys a mapping may have, those that classes add, too."""
        return super().keys_and_kinds() | added_terms()

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
        if self.mu is not None:
            question("mu.static", self.mu.static, 2.0, "")
        if self.stribeck is not None and self.mu is None and self.coulomb is None:
            raise ValueError("`stribeck` needs `mu` or `coulomb` to act on")
        return self


class LinkPoint(Entry):
    """A point of a link, in the link's frame (m)."""

    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)


class Cylinder(Entry):
    """A drive along the line between two points of two links; a positive effort lengthens it."""

    name: str
    a: LinkPoint
    b: LinkPoint


class PointForce(Entry):
    """A drive that pushes a point of a link and reacts on the world; all in the link's frame."""

    name: str
    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    direction: Vector3


class LinkFrame(Entry):
    """A frame on a link, in the link's frame (m, rad)."""

    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)


class Loop(Entry):
    """A joint that closes a loop between frame a on one link and frame b on another.

    The frames coincide but for what the joint lets free: a `prismatic` one slides along the axis, a
    `cylindrical` one turns about it besides, a `universal` one keeps frame a's axis and frame b's
    `axis_b` perpendicular.
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
                if self.axis_b is None else f"a {self.kind} loop has one axis: leave `axis_b` out"
            )  # fmt: skip
        return self


class LoopTolerance(Entry):
    """By how much rounded files may miss what a loop needs: axes (rad), places (m); 0 for none."""

    angle: NonNegative = 1.0e-5
    length: NonNegative = 1.0e-6


class Redundancy(Entry):
    """The length l (m) that weighs moments against forces where reactions are not unique."""

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
    """

    joint: str | None = None
    name: str | None = None
    share: Positive | None = None
    couples: dict[str, Number] = Field(default_factory=dict)
    transmission: Transmission | None = None
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
    """The default stick velocity of all sites (rad/s, m/s)."""

    velocity: NonNegative = 1.0e-6


class Sine(Entry):
    """amplitude sin(angular_frequency t + phase)."""

    amplitude: Number
    angular_frequency: Number
    phase: Number = 0.0


class SineEffort(Entry):
    """A drive's effort, or its motor's torque, as a sine of time."""

    sine: Sine


class TableEffort(Entry):
    """A drive's effort, or its motor's torque, from a CSV file with columns t and one per drive."""

    table: str


def _sine_or_table(given: dict[str, object]) -> SineEffort | TableEffort:
    return (TableEffort if "table" in given else SineEffort).model_validate(given)


GivenEffort = Annotated[
    float | SineEffort | TableEffort, BeforeValidator(number_or(_sine_or_table, Number))
]


class Start(Entry):
    """Initial angles (or lengths) and rates by joint; the rest 0."""

    q: dict[str, Number] = Field(default_factory=dict)
    v: dict[str, Number] = Field(default_factory=dict)


class Simulation(Entry):
    """What `pinfric simulate SCENE` runs: efforts of drives, or torques of their motors."""

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
    """A whole scene file."""

    pinfric: Annotated[Literal[1], BeforeValidator(strict_number)]
    robot: RobotEntry
    friction: dict[str, Friction] = Field(default_factory=dict)
    loops: list[Loop] = Field(default_factory=list)
    loop_tolerance: LoopTolerance = LoopTolerance()
    redundancy: Redundancy = Redundancy()
    actuators: list[Actuator] | None = None
    stick: Stick = Stick()
    simulation: Simulation | None = None
