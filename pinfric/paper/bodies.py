"""Bodies and joints as data: the mechanisms that the paper's equations are written for.

Conventions
    All body frames are parallel to the ground frame where all joint positions are zero; points,
    axes and inertias of a `Mechanism` are given there, in ground axes. A joint position turns the
    child about the axis, or moves it along the axis, relative to the parent. Friction, effort and
    wrench act on the child, with the opposite on the parent. Constraints are written "child minus
    parent", and the joint acts on the child with -Phi_q^T lambda.

Symbols
    T samples, nb bodies, nt joints that place them (as many), nl joints that close loops, nj = nt +
    nl joints in that order, ns joints with friction, na actuators, n = 6 nb coordinates (1), m
    constraints (2), n - m degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pinfric.errors import PinfricError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

GROUND = "ground"
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
#: The six relative motions of a joint, child to parent: along f, g, h; tilting h; turning about h.
ALONG, TURN = 2, 5


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body: mass kg, inertia (3, 3) kg m^2 about its centre of mass (3,) m."""

    name: str
    mass: float
    inertia: ArrayLike
    center_of_mass: ArrayLike


@dataclass(frozen=True)
class PinFriction:
    """A pin: radius m, length m (None: loaded at one point), coefficients, stick velocity rad/s.

    N = R (|F_r/2 + (M_b x k)/d| + |F_r/2 - (M_b x k)/d|), Fig. 3.
    """

    radius: float
    length: float | None
    static: float
    kinetic: float
    stick_velocity: float = 1e-6


@dataclass(frozen=True)
class GuideFriction:
    """A guide on two pads that move with the child, `length` m apart about the joint's point.

    Coefficients, stick velocity m/s. A moment about the axis is carried `width` m apart.

    N = |F_r/2 + (M_b x k)/length| + |F_r/2 - (M_b x k)/length| + 2 |M_a|/width, the N of (20)-(22).
    """

    length: float
    static: float
    kinetic: float
    width: float | None = None
    stick_velocity: float = 1e-6


@dataclass(frozen=True, eq=False)
class RevoluteJoint:
    """The child turns about an axis (3,) through a point (3,) m of the parent, with friction."""

    name: str
    parent: str
    child: str
    point: ArrayLike
    axis: ArrayLike
    friction: PinFriction | None = None

    free: ClassVar[int] = TURN
    constrained: ClassVar[tuple[int, ...]] = (0, 1, 2, 3, 4)


@dataclass(frozen=True, eq=False)
class TranslationalJoint:
    """The child moves along an axis (3,) of the parent, with friction at a point (3,) m of it."""

    name: str
    parent: str
    child: str
    point: ArrayLike
    axis: ArrayLike
    friction: GuideFriction | None = None

    free: ClassVar[int] = ALONG
    constrained: ClassVar[tuple[int, ...]] = (0, 1, 3, 4, 5)


@dataclass(frozen=True, eq=False)
class LoopPin:
    """Closes a loop: the child's point stays on the parent's axis, with friction as it turns.

    It has two constraints: the mechanism's other joints keep it in a plane. `point` and
    `child_point` (3,) m coincide where the loop is closed, not at position zero.
    """

    name: str
    parent: str
    child: str
    point: ArrayLike
    child_point: ArrayLike
    axis: ArrayLike
    friction: PinFriction | None = None

    free: ClassVar[int] = TURN
    constrained: ClassVar[tuple[int, ...]] = (0, 1)


@dataclass(frozen=True, eq=False)
class Actuator:
    """Unit effort: force g (3,) at a point and torque h (3,) on the child, opposite on the parent.

    The point and both directions are fixed in the child (10-13). `through` names the joint whose
    transmitted wrench includes it (a joint drive); None: it acts past the joints.
    """

    name: str
    parent: str
    child: str
    point: ArrayLike
    force: ArrayLike = (0.0, 0.0, 0.0)
    torque: ArrayLike = (0.0, 0.0, 0.0)
    through: str | None = None


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies in a tree of joints (parents first), joints that close loops, and gravity (3,) m/s^2.

    Without `actuators` each joint of the tree has one drive, in order. Raises `PinfricError` where
    the joints are no tree over the bodies, friction does not fit its joint, or there are not as
    many actuators as degrees of freedom (assumed in the paper's 2.2).
    """

    bodies: tuple[Body, ...]
    joints: tuple[RevoluteJoint | TranslationalJoint, ...]
    gravity: ArrayLike
    actuators: tuple[Actuator, ...] = ()
    loops: tuple[LoopPin, ...] = ()

    def __post_init__(self) -> None:
        names = [body.name for body in self.bodies]
        placed = [GROUND]
        for joint in self.joints:
            if joint.parent not in placed:
                raise PinfricError(f"joint {joint.name}: no earlier joint places {joint.parent!r}")
            if joint.child in placed or joint.child not in names:
                raise PinfricError(f"joint {joint.name}: cannot place body {joint.child!r}")
            placed.append(joint.child)
        if len(placed) != len(names) + 1:
            raise PinfricError(f"no joint places {sorted(set(names) - set(placed))}")
        joints = (*self.joints, *self.loops)
        for one in joints:
            fitting = GuideFriction if one.free == ALONG else PinFriction
            if not isinstance(one.friction, fitting | None):
                raise PinfricError(f"joint {one.name}: its friction should be {fitting.__name__}")
        object.__setattr__(self, "actuators", self.actuators or tuple(map(_drive, self.joints)))
        freedom = 6 * len(names) - sum(len(j.constrained) for j in joints)
        if len(self.actuators) != freedom:
            raise PinfricError(f"{len(self.actuators)} actuators for {freedom} degrees of freedom")

    @cached_property
    def geometry(self) -> Geometry:
        """The same mechanism as arrays."""
        return _geometry(self)


def _drive(joint: RevoluteJoint | TranslationalJoint) -> Actuator:
    """A drive on a joint: a torque about its axis, or a force along it."""
    kind = "force" if joint.free == ALONG else "torque"
    return Actuator(
        joint.name,
        joint.parent,
        joint.child,
        joint.point,
        through=joint.name,
        **{kind: unit(joint.axis)},
    )


@dataclass(frozen=True, eq=False)
class Geometry:
    """A mechanism as arrays; the ground is body number nb, its centre at the origin."""

    mass: Array  # (nb,)
    inertia: Array  # (nb, 3, 3)
    gravity: Array  # (3,)
    parent: Indices  # (nj,)
    child: Indices  # (nj,)
    triad: Array  # (nj, 3, 3) rows f, g, h: h the axis, f and g normal to it
    arm_parent: Array  # (nj, 3) from the parent's centre of mass to the joint
    arm_child: Array  # (nj, 3)
    free: Indices  # (nj,) which of the six relative motions a joint's position measures
    constrained: Indices  # (m,) which of all 6 nj relative motions the joints forbid
    direction: Array  # (nj, 6) unit wrench of friction and drive at the joint, child's axes
    sites: Indices  # (ns,) the joints with friction
    radius: Array  # (ns,) m; 1 for a guide
    per_length: Array  # (ns,) 1 / length, 0 where the pin is loaded at one point
    per_width: Array  # (ns,) 1 / width of a guide, 0 where it carries no moment about its axis
    static: Array  # (ns,)
    kinetic: Array  # (ns,)
    stick_velocity: Array  # (ns,)
    drive_parent: Indices  # (na,)
    drive_child: Indices  # (na,)
    drive_arm: Array  # (na, 3) from the child's centre of mass to the actuator's point
    drive_force: Array  # (na, 3) g in the child's axes
    drive_torque: Array  # (na, 3) h in the child's axes
    through: Array  # (nj, na) 1 where an actuator acts through a joint

    @cached_property
    def mass_matrix(self) -> Array:
        """M (n, n) of (3): blocks diag(m I, J), constant because omega is in body axes."""
        M = np.zeros((6 * len(self.mass),) * 2)
        for k, (mass, inertia) in enumerate(zip(self.mass, self.inertia, strict=True)):
            M[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = mass * np.eye(3)
            M[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = inertia
        return M


def _geometry(mechanism: Mechanism) -> Geometry:
    bodies, actuators = mechanism.bodies, mechanism.actuators
    joints = (*mechanism.joints, *mechanism.loops)
    number = {body.name: k for k, body in enumerate(bodies)} | {GROUND: len(bodies)}
    center = np.array([np.asarray(b.center_of_mass, float) for b in bodies] + [np.zeros(3)])
    parent = np.array([number[j.parent] for j in joints])
    child = np.array([number[j.child] for j in joints])
    drive_child = np.array([number[a.child] for a in actuators])
    point = np.array([np.asarray(j.point, float) for j in joints])
    on_child = np.array([np.asarray(getattr(j, "child_point", j.point), float) for j in joints])
    triad = np.array([_triad(j.axis) for j in joints])
    sites = [k for k, joint in enumerate(joints) if joint.friction is not None]
    friction = [joint.friction for joint in joints if joint.friction is not None]
    widths = [getattr(law, "width", None) for law in friction]
    return Geometry(
        mass=np.array([b.mass for b in bodies], float),
        inertia=np.array([np.asarray(b.inertia, float) for b in bodies]),
        gravity=np.asarray(mechanism.gravity, float),
        parent=parent,
        child=child,
        triad=triad,
        arm_parent=point - center[parent],
        arm_child=on_child - center[child],
        free=np.array([j.free for j in joints]),
        constrained=np.array([6 * k + c for k, j in enumerate(joints) for c in j.constrained]),
        direction=np.array(
            [
                np.concatenate([h * (j.free == ALONG), h * (j.free == TURN)])
                for j, h in zip(joints, triad[:, 2], strict=True)
            ]
        ),
        sites=np.array(sites, int),
        radius=np.array([getattr(law, "radius", 1.0) for law in friction], float),
        per_length=np.array([1.0 / law.length if law.length else 0.0 for law in friction], float),
        per_width=np.array([1.0 / width if width else 0.0 for width in widths], float),
        static=np.array([law.static for law in friction], float),
        kinetic=np.array([law.kinetic for law in friction], float),
        stick_velocity=np.array([law.stick_velocity for law in friction], float),
        drive_parent=np.array([number[a.parent] for a in actuators]),
        drive_child=drive_child,
        drive_arm=np.array([np.asarray(a.point, float) for a in actuators]) - center[drive_child],
        drive_force=np.array([np.asarray(a.force, float) for a in actuators]),
        drive_torque=np.array([np.asarray(a.torque, float) for a in actuators]),
        through=np.array([[float(a.through == j.name) for a in actuators] for j in joints]),
    )


def unit(axis: ArrayLike) -> Array:
    """Return the axis at length 1; raises `PinfricError` where it has no direction."""
    vector = np.asarray(axis, float)
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise PinfricError(f"an axis needs a direction, not {vector}")
    return vector / length


def _triad(axis: ArrayLike) -> Array:
    h = unit(axis)
    f = unit(cross(h, np.eye(3)[np.argmin(np.abs(h))]))
    return np.array([f, cross(h, f), h])


def cross(a: Array, b: Array) -> Array:
    """a x b over the last axis (np.cross costs ten times as much on small arrays)."""
    return a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]
