"""The scene's file format: one frozen pydantic model per section.

Nothing here knows a robot. Checks that need one (does the joint exist, does the bearing fit its
kind) live in `scene.py`; what a single entry can get wrong by itself is refused here.
"""

from __future__ import annotations

import math
import warnings
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    ValidationError,
    field_validator,
    model_validator,
)

from pinfric.errors import PinfricWarning, SceneError, choose_from, problems_line
from pinfric.model.magnitudes import LARGEST, SMALLEST
from pinfric.model.yamlfile import brief


def _strict_number(value: Any) -> Any:
    """Refuse what pydantic would silently turn into a number, and what no machine has."""
    if isinstance(value, bool | str):
        raise ValueError(f"should be a number, found {brief(value)}")
    if isinstance(value, int | float) and LARGEST < abs(value) < math.inf:
        raise ValueError(f"should be at most {LARGEST:g} in magnitude, found {brief(value)}")
    return value


def _not_vanishing(value: float) -> float:
    if 0 < value < SMALLEST:
        raise ValueError(f"should be at least {SMALLEST:g}, found {value:g}")
    return value


Number = Annotated[FiniteFloat, BeforeValidator(_strict_number)]
NonNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0), AfterValidator(_not_vanishing)]
Vector3 = tuple[Number, Number, Number]


class Entry(BaseModel):
    """Base of all sections: unknown keys are errors, nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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
    locked: dict[str, Number] = {}
    payloads: dict[str, Payload] = {}
    urdf_dynamics: Literal["ignore", "use"] = "ignore"


class Bearing(Entry):
    """Where a joint's load is carried; turns the joint's wrench into a normal load."""

    kind: Literal["pin", "guide", "linear", "ball"]
    radius: NonNegative | None = None
    length: Positive | None = None
    thrust_radius: NonNegative | None = None
    width: Positive | None = None
    radial: NonNegative | None = None
    axial: NonNegative | None = None
    moment: NonNegative | None = None
    preload: NonNegative = 0.0
    offset: Number = 0.0
    on: Literal["child", "parent"] | None = None

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Bearing:
        allowed = BEARING_KEYS[self.kind]
        given = {key for key in self.model_fields_set if getattr(self, key) is not None} - {"kind"}
        for key in sorted(given - allowed.keys()):
            raise ValueError(f"a {self.kind} has no `{key}`; {choose_from(key, allowed)}")
        for key, required in allowed.items():
            if required and key not in given:
                raise ValueError(f"a {self.kind} needs `{key}`")
        if self.kind == "linear" and not given & {"radial", "axial", "moment", "preload"}:
            raise ValueError("a linear bearing needs radial, axial, moment or preload")
        for key in ("radius", "thrust_radius", "length", "width"):
            _question(f"bearing.{key}", getattr(self, key), 1.0, "m")
        return self


#: The keys each kind of bearing takes, and whether it must have them.
BEARING_KEYS: dict[str, dict[str, bool]] = {
    "pin": {
        "radius": True, "length": False, "thrust_radius": False, "preload": False, "offset": False,
    },
    "guide": {"length": True, "width": False, "preload": False, "offset": False, "on": False},
    "linear": {
        "radial": False, "axial": False, "moment": False, "preload": False, "offset": False,
    },
    "ball": {"radius": True, "preload": False},
}  # fmt: skip


class Coefficients(Entry):
    """A static and a kinetic value of the same kind of friction."""

    static: NonNegative
    kinetic: NonNegative

    @model_validator(mode="after")
    def _static_is_the_larger(self) -> Coefficients:
        if self.static < self.kinetic:
            raise ValueError(
                f"static {self.static:g} is less than kinetic {self.kinetic:g}: the two look "
                "swapped (friction at rest is at least the friction in motion)"
            )
        return self


class DirectedCoefficients(Entry):
    """Coulomb friction that differs by the direction of motion."""

    positive: Coefficients
    negative: Coefficients


class Stribeck(Entry):
    """The fall from static to kinetic: exp(-(|v|/velocity)^exponent), joint velocity."""

    velocity: Positive
    exponent: Positive = 2.0


class Friction(Entry):
    """The friction of one joint: a bearing with coefficients, a constant part, a viscous part."""

    bearing: Bearing | None = None
    mu: Coefficients | None = None
    stribeck: Stribeck | None = None
    coulomb: Coefficients | DirectedCoefficients | None = None
    viscous: NonNegative = 0.0
    stick_velocity: NonNegative | None = None

    @field_validator("coulomb", mode="before")
    @classmethod
    def _which_coulomb(cls, value: Any) -> Any:
        # decided here so that an error names one form, not every member of the union
        if isinstance(value, dict):
            directed = bool({"positive", "negative"} & value.keys())
            return (DirectedCoefficients if directed else Coefficients).model_validate(value)
        return value

    @model_validator(mode="after")
    def _bearing_and_mu_belong_together(self) -> Friction:
        if (self.bearing is None) != (self.mu is None):
            have, miss = ("mu", "bearing") if self.bearing is None else ("bearing", "mu")
            raise ValueError(f"`{have}` without `{miss}`: friction = mu x the bearing's load")
        if self.mu is not None:
            _question("mu.static", self.mu.static, 2.0, "")
        if self.stribeck is not None and self.mu is None and self.coulomb is None:
            raise ValueError("`stribeck` needs `mu` or `coulomb` to act on")
        return self


class Transmission(Entry):
    """Ratio and losses between motor and joint; torques and inertia at the motor's shaft."""

    ratio: Number
    efficiency: Annotated[Positive, Field(le=1)] = 1.0
    back_efficiency: Annotated[Number, Field(le=1)] | None = None
    no_load_torque: NonNegative = 0.0
    motor_viscous: NonNegative = 0.0
    rotor_inertia: NonNegative = 0.0

    @model_validator(mode="after")
    def _plausible(self) -> Transmission:
        if self.ratio == 0:
            raise ValueError("ratio 0 connects nothing; give motor turns per joint turn")
        _not_vanishing(abs(self.ratio))
        if self.efficiency < 1 and self.back_efficiency is None:
            raise ValueError(
                "`efficiency` below 1 needs `back_efficiency`, which catalogues rarely print; "
                f"equal losses both ways give 2 - 1/efficiency = {2 - 1 / self.efficiency:.3g}"
            )
        _question(
            "transmission.rotor_inertia", self.rotor_inertia, 0.1, "kg m^2 (kg cm^2 entered?)"
        )
        _question("transmission.ratio", abs(self.ratio), 1000.0, "")
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
    """One drive: on a joint (of the robot or of a loop), a cylinder, or a force at a point."""

    joint: str | None = None
    transmission: Transmission | None = None
    cylinder: Cylinder | None = None
    force: PointForce | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Actuator:
        kinds = [k for k in ("joint", "cylinder", "force") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise ValueError(f"an actuator is one of joint, cylinder, force; found {kinds}")
        return self


class Stick(Entry):
    """The default stick velocity of all sites (rad/s, m/s)."""

    velocity: NonNegative = 1.0e-6


class Sine(Entry):
    """amplitude sin(angular_frequency t + phase)."""

    amplitude: Number
    angular_frequency: Number
    phase: Number = 0.0


class SineEffort(Entry):
    """A drive's effort as a sine of time."""

    sine: Sine


class TableEffort(Entry):
    """A drive's effort from a CSV file with columns t and one per drive."""

    table: str


class Start(Entry):
    """Initial angles (or lengths) and rates by joint; the rest 0."""

    q: dict[str, Number] = {}
    v: dict[str, Number] = {}


class Simulation(Entry):
    """What `pinfric simulate SCENE` runs."""

    start: Start = Start()
    effort: dict[str, Number | SineEffort | TableEffort] = {}
    t_end: Positive


class SceneFile(Entry):
    """A whole scene file."""

    pinfric: Annotated[Literal[1], BeforeValidator(_strict_number)]
    robot: RobotEntry
    friction: dict[str, Friction] = {}
    loops: list[Loop] = []
    loop_tolerance: LoopTolerance = LoopTolerance()
    redundancy: Redundancy = Redundancy()
    actuators: list[Actuator] | None = None
    stick: Stick = Stick()
    simulation: Simulation | None = None


def parse(entry: type[BaseModel], content: Any, where: str) -> Any:
    """Validate `content` as `entry`; all problems in one `SceneError` that begins with `where`."""
    if isinstance(content, entry):
        return content
    if not isinstance(content, dict):
        raise SceneError(f"{where}: should be a mapping of keys, found {brief(content)}")
    try:
        return entry.model_validate(content)
    except ValidationError as error:
        problems = [_problem(entry, problem) for problem in error.errors()]
    raise SceneError(problems_line(where, problems))


def _problem(entry: type[BaseModel], problem: Any) -> str:
    """One pydantic problem in our words: key path, what was found, what is allowed."""
    path = [str(part) for part in problem["loc"] if not _is_union_tag(part)]
    key = ".".join(path)
    if problem["type"] == "extra_forbidden":
        allowed = _fields_at(entry, problem["loc"][:-1])
        return f"unknown key `{key}`; {choose_from(path[-1], allowed)}"
    if problem["type"] == "missing":
        return f"`{key}` is missing"
    if problem["type"] in ("model_type", "dict_type", "model_attributes_type"):
        text = f"should be a mapping of keys, found {brief(problem['input'])}"
    elif problem["type"] in ("too_short", "too_long", "tuple_type", "list_type"):
        text = f"has a wrong length or is no list, found {brief(problem['input'])}"
    elif problem["type"] == "value_error":
        text = str(problem["ctx"]["error"])
    else:
        text = f"{problem['msg'][0].lower()}{problem['msg'][1:]}, found {brief(problem['input'])}"
    return f"`{key}`: {text}" if key else text


def _is_union_tag(part: int | str) -> bool:
    return isinstance(part, str) and part in {
        "SineEffort", "TableEffort", "Coefficients", "DirectedCoefficients",
        "constrained-float", "finite-float", "function-before[_strict_number(), finite-float]",
    }  # fmt: skip


def _fields_at(entry: type[BaseModel], path: tuple[int | str, ...]) -> list[str]:
    """The keys allowed where `path` leads, by walking the annotations."""
    current: Any = entry
    for part in path:
        found = _step(current, part)
        if found is None:
            return []
        current = found
    models = _models_in(current)
    return [name for model in models for name in model.model_fields]


def _step(current: Any, part: int | str) -> Any:
    for model in _models_in(current):
        if isinstance(part, str) and part in model.model_fields:
            return model.model_fields[part].annotation
        if model.__name__ == part:
            return model
    return current  # an index into a list or a name in a mapping: the annotation covers it


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for arg in getattr(annotation, "__args__", ()) for model in _models_in(arg)]


def _question(key: str, value: float | None, largest_usual: float, unit: str) -> None:
    """Warn where a magnitude is possible but so unusual that a wrong unit is likelier."""
    if value is not None and value > largest_usual:
        warnings.warn(
            f"{key} = {value:g} {unit}: unusually large (usual: up to {largest_usual:g}); "
            "check the unit",
            PinfricWarning,
            stacklevel=2,
        )
