"""Bearings: from the wrench that a joint transmits to the normal load of its friction.

    c = sum_i |(B_i + s C_i) w| + constant

is the load (N m about the axis, N along it) due to the wrench w of the parent on the child (force
F, moment M), in axes whose z is the joint's axis; s is the child's displacement along it. See
`notebooks/theory/bearings.md`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar, Union

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    TypeAdapter,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from pinfric.errors import SceneError
from pinfric.kernels.compiled import kernel
from pinfric.model.entry import (
    Entry,
    NonNegative,
    Number,
    Positive,
    key,
    optional,
    register_kind,
    unlikely,
)
from pinfric.model.yamlfile import brief

#: Rows that take one component of the wrench, z along the joint's axis.
FX, FY, FZ, MX, MY, MZ = np.eye(6)
#: m; above the largest bearings that were built.
_LARGEST_RADIUS = 15.0


def _buildable(value: float) -> float:
    if value > _LARGEST_RADIUS:
        raise ValueError(
            f"should be at most {_LARGEST_RADIUS:g} m, found {value:g}; check the unit"
        )
    return value


Radius = Annotated[NonNegative, AfterValidator(_buildable)]


class LoadTerms(NamedTuple):
    """The load of one bearing, c = sum_i |(B_i + s C_i) w| + constant.

    Attributes:
        maps: (n, 3, 6) B of each term, made by `norm_of`.
        moved: C of each term; empty if the load does not depend on the displacement.
        constant: N m for a joint that turns, N for one that slides.
    """

    maps: Sequence[np.ndarray]
    constant: float = 0.0
    moved: Sequence[np.ndarray] = ()


def norm_of(*rows: np.ndarray) -> np.ndarray:
    """Return the map (3, 6) from a wrench to a vector with these rows (6,) as components."""
    return np.vstack([*rows, *np.zeros((3 - len(rows), 6))])


def two_ends(length: float, middle: float) -> list[np.ndarray]:
    """Return the maps of the end forces F_r/2 +- M_b x k/length of a bearing (paper's Fig. 3).

    F_r is the force across the axis k, M_b the moment across it about the bearing's middle, which
    is `middle` (m) from the joint's origin along the axis.
    """
    bending_x, bending_y = MX + middle * FY, MY - middle * FX
    couple = norm_of(bending_y, -bending_x) / length
    return [norm_of(FX, FY) / 2 + couple, norm_of(FX, FY) / 2 - couple]


class Bearing(Entry):
    """Base class of all kinds of bearing; it reads the key `bearing:` as one of them.

    Attributes:
        kind: its name in the scene file, a `Literal` of one word in each subclass.
        fits: the joints it can carry: "turning joint", "prismatic joint", "spherical loop",
            "revolute loop", "planar_pin loop", "prismatic loop", "cylinder".
        sizes: keys that are lengths (m); above 1 m a warning asks to check the unit.
        rolling: whether it is a rolling bearing, with the coefficients of one.
    """

    fits: ClassVar[tuple[str, ...]]
    sizes: ClassVar[tuple[str, ...]] = ()
    rolling: ClassVar[bool] = False

    kind: str

    @classmethod
    def kinds(cls) -> list[str]:
        """See `Entry.kinds`."""
        return list(KINDS)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Any of the kinds."""
        return handler(_any_of(*KINDS.values()).core_schema if cls is Bearing else core)

    @model_validator(mode="wrap")
    @classmethod
    def _of_its_kind(cls, value: Any, read: ModelWrapValidatorHandler[Bearing]) -> Bearing:
        """Read a mapping as the kind of bearing that its key `kind` names."""
        if cls is Bearing and not isinstance(value, Bearing):
            return _any_of(*KINDS.values()).validate_python(value)
        return read(value)

    @abstractmethod
    def terms(self) -> LoadTerms:
        """Return the load's terms, in axes whose z is the joint's axis."""

    def misfit(self, joint: str) -> str:
        """Return why this bearing does not fit a joint (see `fits`); empty if it fits.

        The text begins with a key's name or a colon, to follow the entry's path.
        """
        if joint in self.fits:
            return ""
        fitting = [kind for kind, cls in KINDS.items() if joint in cls.fits]
        return (
            f": a {self.kind} does not fit a {joint}; take {' or '.join(fitting)} "
            f"(a {self.kind} fits a {' or '.join(self.fits)})"
        )

    def roll_lever(self) -> float | None:
        """Return a length (m) if the bearing cannot carry a moment about its axis, else None.

        Such a moment is refused above the rounding of other moments and of forces times this
        length.
        """
        return None

    def without_bending(self) -> Bearing | None:
        """Return the bearing without the load due to bending; None if no load remains."""
        return self

    def questions(self) -> Iterator[str]:
        """Yield a warning for each size that is unusually large."""
        for name in self.sizes:
            yield from unlikely(name, getattr(self, name), 1.0, "m")


#: The classes of all kinds of bearing, by their names in a scene file.
KINDS: dict[str, type[Bearing]] = {}
_Kind = TypeVar("_Kind", bound=Bearing)


def bearing_kind(cls: type[_Kind]) -> type[_Kind]:
    """Decorate a class of bearings: scene files can then use its `kind`.

    Raises:
        SceneError: another class has this kind; a class that is run again replaces itself.
    """
    register_kind(KINDS, cls)
    return cls


@cache
def _any_of(*kinds: type[Bearing]) -> TypeAdapter[Bearing]:
    for kind in kinds:
        kind.model_rebuild()  # pydantic before 2.13 cannot write a class that is still deferred
    union: Any = Annotated[Union[kinds], Field(discriminator="kind")]  # noqa: UP007 - any number
    return TypeAdapter(union)


@bearing_kind
class Pin(Bearing):
    """A plain bearing; with a length, its two ends carry the bending moment (paper's Fig. 3).

    c = radius (|F_r/2 + M_b x k/length| + |F_r/2 - M_b x k/length| + preload)
        + thrust_radius |F_a|;     without length   radius (|F_r| + preload) + ...
    """

    fits = ("turning joint", "revolute loop", "planar_pin loop")
    sizes = ("radius", "thrust_radius", "length")

    kind: Literal["pin"] = key("a plain bearing", "pin")
    radius: Radius = key("of the sliding surface", 0.05, "m")
    length: Positive | None = optional(
        "distance of the ends, which carry bending; without it no bending", 0.1, "m"
    )
    thrust_radius: Radius = key(
        "mean radius of the face that carries the axial force", 0.04, "m", default=0.0
    )
    preload: NonNegative = key("contact force without any load", 50.0, "N", default=0.0)
    offset: Number = key(
        "of the bearing's middle along the axis from the joint's origin", -0.02, "m", default=0.0
    )

    def terms(self) -> LoadTerms:
        """See the class."""
        ends = [norm_of(FX, FY)] if self.length is None else two_ends(self.length, self.offset)
        maps = [*(self.radius * end for end in ends), self.thrust_radius * norm_of(FZ)]
        return LoadTerms(maps, self.radius * self.preload)

    def misfit(self, joint: str) -> str:
        """See `Bearing.misfit`."""
        if joint == "planar_pin loop" and self.length is not None:
            return (
                ".length: a planar_pin carries no bending moment, so its length has no effect; "
                "leave it out"
            )
        return super().misfit(joint)

    def without_bending(self) -> Pin:
        """See `Bearing.without_bending`."""
        return self if self.length is None else self.model_copy(update={"length": None})


@bearing_kind
class Guide(Bearing):
    """Sliding pads at two ends, fixed to the child or to the parent.

    c = |F_r/2 + M_b x k/length| + |F_r/2 - M_b x k/length| + 2 |M_a|/width + preload
    """

    fits = ("prismatic joint", "prismatic loop")
    sizes = ("length", "width")

    kind: Literal["guide"] = key("sliding pads", "guide")
    length: Positive = key("distance of the pads along the axis", 0.2, "m")
    width: Positive | None = optional(
        "distance of the pads across it; without it no moment about the axis", 0.12, "m"
    )
    preload: NonNegative = key("contact force without any load", 50.0, "N", default=0.0)
    offset: Number = key(
        "of the pads' middle along the axis from the joint's origin", 0.05, "m", default=0.0
    )
    on: Literal["child", "parent"] = key(
        "link that the pads are fixed to", "parent", default="child"
    )

    def misfit(self, joint: str) -> str:
        """See `Bearing.misfit`."""
        if joint == "prismatic loop" and self.on == "parent":
            return ".on: a guide of a loop is fixed to side b; exchange a and b"
        return super().misfit(joint)

    def terms(self) -> LoadTerms:
        """See the class; a guide on the parent moves backwards in the child's axes."""
        maps = two_ends(self.length, self.offset)
        if self.width is not None:
            maps.append(2.0 / self.width * norm_of(MZ))
        # d(middle)/ds = -1 moves the bending moment by (-FY, FX)
        couple = norm_of(FX, FY) / self.length
        moved = [couple, -couple] if self.on == "parent" else []
        return LoadTerms(maps, self.preload, moved)

    def roll_lever(self) -> float | None:
        """See `Bearing.roll_lever`."""
        return self.length if self.width is None else None


@bearing_kind
class Linear(Bearing):
    """Rolling bearings, with a catalogue's factor for each part of the load.

    c = radial |F_r| + axial |F_a| + moment |M_b| + preload

    A slewing ring of raceway diameter D (m) has radial 1.025 D, axial 0.5 D, moment 2.05. At a
    sliding joint the weights are pure numbers and preload is in N.
    """

    fits = (
        "turning joint",
        "prismatic joint",
        "revolute loop",
        "planar_pin loop",
        "prismatic loop",
    )
    rolling = True

    kind: Literal["linear"] = key("rolling bearings", "linear")
    radial: NonNegative = key("weight of the force across the axis", 0.04, "m", default=0.0)
    axial: NonNegative = key("weight of the force along the axis", 0.04, "m", default=0.0)
    moment: NonNegative = key(
        "weight of the moment across the axis, 1/m where the joint slides", 2.0, "1", default=0.0
    )
    preload: NonNegative = key(
        "load without any force, N where the joint slides", 0.5, "N m", default=0.0
    )
    offset: Number = key(
        "of the bearing's middle along the axis from the joint's origin", 0.0, "m", default=0.0
    )

    @model_validator(mode="after")
    def _something(self) -> Linear:
        if not self.model_fields_set & {"radial", "axial", "moment", "preload"}:
            raise ValueError("a linear bearing needs radial, axial, moment or preload")
        return self

    def terms(self) -> LoadTerms:
        """See the class."""
        bending = norm_of(MX + self.offset * FY, MY - self.offset * FX)
        maps = [self.radial * norm_of(FX, FY), self.axial * norm_of(FZ), self.moment * bending]
        return LoadTerms(maps, self.preload)

    def misfit(self, joint: str) -> str:
        """See `Bearing.misfit`."""
        if joint == "prismatic joint" and self.axial:
            return (
                ".axial: along a prismatic joint the drive carries the force, not the bearing; "
                "leave `axial` out"
            )
        if joint == "prismatic loop" and self.axial:
            return ".axial: a prismatic loop transmits no force along its axis; leave it out"
        return super().misfit(joint)

    def without_bending(self) -> Linear | None:
        """See `Bearing.without_bending`."""
        if not self.moment:
            return self
        loaded = self.radial or self.axial or self.preload
        return self.model_copy(update={"moment": 0.0}) if loaded else None


@bearing_kind
class Gear(Bearing):
    """Teeth of the joint's gear, whose loss may fall from rest to motion: c = |M_a|.

    M_a is the torque that the joint delivers. In motion mu c is the loss of a gear with the
    efficiencies 1/(1 + mu) and 1 - mu; with `mu.static` and `stribeck` it is larger at rest
    (Bittencourt and Gunnarsson 2012, Static friction in a robot joint).

    friction: {elbow: {bearing: {kind: gear}, mu: {static: 0.3, kinetic: 0.05},
                       coulomb: 0.65, stribeck: {velocity: 0.1}}}
    """

    fits = ("turning joint",)

    kind: Annotated[Literal["gear"], key("the joint's gear", "gear")]

    def terms(self) -> LoadTerms:
        """See the class."""
        return LoadTerms([norm_of(MZ)])


@bearing_kind
class Ball(Bearing):
    """A ball in its socket: c = radius (|F| + preload)."""

    fits = ("spherical loop",)
    sizes = ("radius",)

    kind: Literal["ball"] = key("a ball joint", "ball")
    radius: Radius = key("of the ball", 0.01, "m")
    preload: NonNegative = key("contact force without any load", 20.0, "N", default=0.0)

    def terms(self) -> LoadTerms:
        """See the class."""
        return LoadTerms([self.radius * norm_of(FX, FY, FZ)], self.radius * self.preload)


@bearing_kind
class Seal(Bearing):
    """Seals of a cylinder: c = |F| + preload, with F its force, which includes friction.

    friction: {ram: {bearing: {kind: seal}, mu: {static: 0.04, kinetic: 0.03},
                     coulomb: {static: 120.0, kinetic: 80.0}, viscous: 400.0}}
    """

    fits = ("cylinder",)

    kind: Literal["seal"] = key("seals of a cylinder", "seal")
    preload: NonNegative = key("load without any force", 200.0, "N", default=0.0)

    def terms(self) -> LoadTerms:
        """See the class."""
        return LoadTerms([norm_of(FZ)], self.preload)


class Contacts(NamedTuple):
    """The loads of all sites' bearings, c = sum |(B + s C) w| + constant, as arrays for kernels.

    Attributes:
        site: (nt,) the site of each term, ascending.
        rank: (nt,) number of the first rows of B and C that are used.
        map, map_moved: (nt, 3, 6) B and C, for wrenches in the child's joint frame.
        moves: (ns,) bool, whether the load depends on the displacement s.
        constant: (ns,) N m or N.
    """

    site: np.ndarray
    rank: np.ndarray
    map: np.ndarray
    map_moved: np.ndarray
    moves: np.ndarray
    constant: np.ndarray


def contacts(bearings: Sequence[Bearing | None], axes: Sequence[np.ndarray]) -> Contacts:
    """Return the nonzero terms of all sites (None: no bearing), in the joints' frames.

    `axes` (3,) are the joints' unit axes in the child's frame.
    """
    site, maps, moved = [], [], []
    constant = np.zeros(len(bearings))
    for s, (bearing, axis) in enumerate(zip(bearings, axes, strict=True)):
        if bearing is None:
            continue
        terms, turn = bearing.terms(), np.kron(np.eye(2), axes_along(axis))
        shapes = isinstance(terms, LoadTerms) and {
            np.shape(each) for each in (*terms.maps, *terms.moved)
        }
        if shapes is False or shapes - {(3, 6)}:
            raise SceneError(
                f"{type(bearing).__name__}.terms: should return LoadTerms of maps (3, 6), see "
                f"`norm_of`; found {brief(shapes or terms)}"
            )
        if not (np.isfinite([*terms.maps, *terms.moved]).all() and 0 <= terms.constant < np.inf):
            raise SceneError(
                f"{type(bearing).__name__}.terms: maps should be finite, and `constant` not "
                f"negative; found {brief(terms)}"
            )
        constant[s] = terms.constant
        for i, map_ in enumerate(terms.maps):
            map_moved = terms.moved[i] if i < len(terms.moved) else np.zeros((3, 6))
            if map_.any() or map_moved.any():
                site.append(s)
                maps.append(map_ @ turn)
                moved.append(map_moved @ turn)
    of, shape = np.array(site, dtype=np.int64), (len(site), 3, 6)
    B, C = np.array(maps).reshape(shape), np.array(moved).reshape(shape)
    used = (B != 0.0).any(axis=2) | (C != 0.0).any(axis=2)
    moves = np.zeros(len(bearings), dtype=bool)
    moves[of[C.any(axis=(1, 2))]] = True
    rank = (used * np.arange(1, 4)).max(axis=1, initial=0)
    return Contacts(of, rank.astype(np.int64), B, C, moves, constant)


def axes_along(axis: np.ndarray) -> np.ndarray:
    """Return a rotation (3, 3) whose rows are unit axes x, y and `axis` (3,), a unit vector."""
    y = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, axis), y, axis])


@kernel
def normal_loads(
    wrench: np.ndarray,
    joint: np.ndarray,
    contacts: Contacts,
    displacement: np.ndarray,
    load: np.ndarray,
) -> None:
    """Write each site's normal load c (N m about its axis, N along it).

    Args:
        wrench: (n, nj, 6), parent on child in the child's joint frame, linear first.
        joint: (ns,) row of each site's joint.
        displacement: (n, ns), of the child along the axis; read only where `moves`.
        load: (n, ns), overwritten.
    """
    for i in range(wrench.shape[0]):
        for s in range(joint.size):
            load[i, s] = contacts.constant[s]
    for t in range(contacts.site.size):
        s = contacts.site[t]
        j, rows, moves = joint[s], contacts.rank[t], contacts.moves[s]
        still, moved = contacts.map[t], contacts.map_moved[t]
        for i in range(wrench.shape[0]):
            square = 0.0
            for e in range(rows):
                part = 0.0
                for k in range(6):
                    part += still[e, k] * wrench[i, j, k]
                if moves:
                    for k in range(6):
                        part += displacement[i, s] * moved[e, k] * wrench[i, j, k]
                square += part * part
            load[i, s] += np.sqrt(square)
