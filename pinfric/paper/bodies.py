"""Bodies in absolute coordinates: what the paper's equations (1)-(17) are made of.

Every body has six absolute coordinates: the position r of its centre of mass and its Euler
parameters e (scalar last); the generalized speeds are r' (ground axes) and the angular velocity
omega in body axes, as the paper takes them for (14) and (15). Independent of Pinocchio on purpose:
no recursion, no relative coordinates, reactions only from multipliers.

Conventions
    All body frames are parallel to the ground frame where all joint angles are zero; points, axes
    and inertias of a `Mechanism` are given there, in ground axes. A joint angle turns the child
    about the axis relative to the parent. Friction, effort and wrench act on the child, with the
    opposite on the parent. Constraints are written "child minus parent", and the joint acts on
    the child with -Phi_q^T lambda.

Symbols
    T samples, nb bodies (as many as joints), nj joints, ns joints with friction, na actuators,
    n = 6 nb coordinates (1), m = 5 nj constraints (2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pinfric.errors import PinfricError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

GROUND = "ground"
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


# ---------------------------------------------------------------- the mechanism, as data


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body: mass kg, inertia (3, 3) kg m^2 about its centre of mass (3,) m."""

    name: str
    mass: float
    inertia: ArrayLike
    center_of_mass: ArrayLike


@dataclass(frozen=True)
class PinFriction:
    """A pin: radius m, length m (None: loaded at one point), coefficients, stick velocity rad/s."""

    radius: float
    length: float | None
    static: float
    kinetic: float
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


@dataclass(frozen=True, eq=False)
class Actuator:
    """Unit effort: force g (3,) at a point and torque h (3,) on the child, opposite on the parent.

    The point and both directions are fixed in the child (10-13). `through` names the joint whose
    transmitted wrench includes this actuator (a joint drive); None acts past the joints.
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
    """Bodies in a tree of revolute joints (parents first) under gravity (3,) m/s^2.

    Without `actuators` each joint has one drive, in the order of the joints.
    Raises `PinfricError` where the joints are no tree over the bodies.
    """

    bodies: tuple[Body, ...]
    joints: tuple[RevoluteJoint, ...]
    gravity: ArrayLike
    actuators: tuple[Actuator, ...] = ()

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
        drives = tuple(
            Actuator(j.name, j.parent, j.child, j.point, torque=unit(j.axis), through=j.name)
            for j in self.joints
        )
        object.__setattr__(self, "actuators", self.actuators or drives)
        if len(self.actuators) != len(self.joints):
            raise PinfricError(
                f"{len(self.actuators)} actuators for {len(self.joints)} degrees of freedom"
            )

    @cached_property
    def geometry(self) -> _Geometry:
        """The same mechanism as arrays."""
        return _geometry(self)


@dataclass(frozen=True, eq=False)
class _Geometry:
    """A mechanism as arrays; the ground is body number nb, with its centre at the origin."""

    mass: Array  # (nb,)
    inertia: Array  # (nb, 3, 3)
    gravity: Array  # (3,)
    parent: Indices  # (nj,)
    child: Indices  # (nj,)
    triad: Array  # (nj, 3, 3) rows f, g, h: h the axis, f and g normal to it
    arm_parent: Array  # (nj, 3) from the parent's centre of mass to the joint
    arm_child: Array  # (nj, 3)
    sites: Indices  # (ns,) the joints with friction
    radius: Array  # (ns,)
    per_length: Array  # (ns,) 1 / length, 0 where the pin is loaded at one point
    static: Array  # (ns,)
    kinetic: Array  # (ns,)
    stick_velocity: Array  # (ns,)
    drive_parent: Indices  # (na,)
    drive_child: Indices  # (na,)
    drive_arm: Array  # (na, 3) from the child's centre of mass to the actuator's point
    drive_force: Array  # (na, 3) g in the child's axes
    drive_torque: Array  # (na, 3) h in the child's axes
    through: Array  # (nj, na) 1 where an actuator's torque passes through a joint

    @cached_property
    def mass_matrix(self) -> Array:
        M = np.zeros((6 * len(self.mass),) * 2)
        for k, (mass, inertia) in enumerate(zip(self.mass, self.inertia, strict=True)):
            M[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = mass * np.eye(3)
            M[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = inertia
        return M


def _geometry(mechanism: Mechanism) -> _Geometry:
    bodies, joints, actuators = mechanism.bodies, mechanism.joints, mechanism.actuators
    number = {body.name: k for k, body in enumerate(bodies)} | {GROUND: len(bodies)}
    center = np.array([np.asarray(b.center_of_mass, float) for b in bodies] + [np.zeros(3)])
    parent = np.array([number[j.parent] for j in joints])
    child = np.array([number[j.child] for j in joints])
    drive_child = np.array([number[a.child] for a in actuators])
    point = np.array([np.asarray(j.point, float) for j in joints])
    pins = [(k, j.friction) for k, j in enumerate(joints) if j.friction is not None]
    return _Geometry(
        mass=np.array([b.mass for b in bodies], float),
        inertia=np.array([np.asarray(b.inertia, float) for b in bodies]),
        gravity=np.asarray(mechanism.gravity, float),
        parent=parent,
        child=child,
        triad=np.array([_triad(j.axis) for j in joints]),
        arm_parent=point - center[parent],
        arm_child=point - center[child],
        sites=np.array([k for k, _ in pins], int),
        radius=np.array([pin.radius for _, pin in pins], float),
        per_length=np.array([1.0 / pin.length if pin.length else 0.0 for _, pin in pins], float),
        static=np.array([pin.static for _, pin in pins], float),
        kinetic=np.array([pin.kinetic for _, pin in pins], float),
        stick_velocity=np.array([pin.stick_velocity for _, pin in pins], float),
        drive_parent=np.array([number[a.parent] for a in actuators]),
        drive_child=drive_child,
        drive_arm=np.array([np.asarray(a.point, float) for a in actuators]) - center[drive_child],
        drive_force=np.array([np.asarray(a.force, float) for a in actuators]),
        drive_torque=np.array([np.asarray(a.torque, float) for a in actuators]),
        through=np.array([[float(a.through == j.name) for a in actuators] for j in joints]),
    )


def unit(axis: ArrayLike) -> Array:
    """The axis at length 1; raises `PinfricError` where it has no direction."""
    vector = np.asarray(axis, float)
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise PinfricError(f"an axis needs a direction, not {vector}")
    return vector / length


def _triad(axis: ArrayLike) -> Array:
    h = unit(axis)
    f = unit(cross(h, np.eye(3)[np.argmin(np.abs(h))]))
    return np.array([f, cross(h, f), h])


# ---------------------------------------------------------------- absolute coordinates


def cross(a: Array, b: Array) -> Array:
    """a x b over the last axis (np.cross costs ten times as much on small arrays)."""
    return a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]


def skew(a: Array) -> Array:
    """The matrix a~ with a~ b = a x b, (..., 3, 3)."""
    matrix = np.zeros((*a.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., k, j], matrix[..., j, k] = a[..., i], -a[..., i]
    return matrix


def apply(matrix: Array, vector: Array) -> Array:
    """matrix @ vector over the last axes."""
    return np.matmul(matrix, vector[..., None])[..., 0]


def _compose(a: Array, b: Array) -> Array:
    """Euler parameters of A(a) A(b), scalar last."""
    vector = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + cross(a[..., :3], b[..., :3])
    scalar = a[..., 3:] * b[..., 3:] - np.sum(a[..., :3] * b[..., :3], axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def _rotation(e: Array) -> Array:
    """A(e), body to ground axes: (2 e0^2 - 1) I + 2 (e e^T + e0 e~), (..., 3, 3)."""
    vector, scalar = e[..., :3], e[..., 3, None, None]
    outer = vector[..., :, None] * vector[..., None, :]
    return (2 * scalar**2 - 1) * np.eye(3) + 2 * (outer + scalar * skew(vector))


@dataclass(frozen=True, eq=False)
class Placement:
    """Absolute coordinates q (1) of all bodies; the last one of nb + 1 is the ground."""

    position: Array  # (T, nb + 1, 3) centre of mass, ground axes, m
    euler_parameters: Array  # (T, nb + 1, 4) scalar last
    orientation: Array  # (T, nb + 1, 3, 3) body to ground axes


def place(mechanism: Mechanism, angle: Array) -> Placement:
    """Absolute coordinates at joint angles (T, nj) rad, by the tree of joints."""
    geo = mechanism.geometry
    samples, bodies = len(angle), len(geo.mass)
    r = np.zeros((samples, bodies + 1, 3))
    e = np.tile([0.0, 0.0, 0.0, 1.0], (samples, bodies + 1, 1))
    A = np.tile(np.eye(3), (samples, bodies + 1, 1, 1))
    half = angle[..., None] / 2
    turn = np.concatenate([np.sin(half) * geo.triad[:, 2], np.cos(half)], axis=-1)
    for k, (i, j) in enumerate(zip(geo.parent, geo.child, strict=True)):
        e[:, j] = _compose(e[:, i], turn[:, k])
        A[:, j] = _rotation(e[:, j])
        r[:, j] = r[:, i] + A[:, i] @ geo.arm_parent[k] - A[:, j] @ geo.arm_child[k]
    return Placement(r, e, A)


def joint_jacobians(mechanism: Mechanism, q: Placement) -> tuple[Array, Array]:
    """Phi_q (T, 5 nj, n) of (2), and the axis rows (T, nj, n) that give the joint rates.

    Phi = [r_j + A_j s_j - r_i - A_i s_i;  f_i . h_j;  g_i . h_j] for parent i and child j, with
    h the joint axis and f, g normal to it; the axis row is h . (omega_j - omega_i).
    """
    geo = mechanism.geometry
    samples, joints = len(q.position), len(geo.child)
    a_i, a_j = q.orientation[:, geo.parent], q.orientation[:, geo.child]
    f, g, h_i = np.moveaxis(np.matmul(geo.triad, np.swapaxes(a_i, -1, -2)), -2, 0)
    h_j = apply(a_j, geo.triad[:, 2])
    normals = np.stack([cross(h_j, f), cross(h_j, g), h_i], axis=-2)
    on_i, on_j = np.zeros((2, samples, joints, 6, 6))
    on_j[..., :3, :3], on_i[..., :3, :3] = np.eye(3), -np.eye(3)
    on_j[..., :3, 3:] = -np.matmul(a_j, skew(geo.arm_child))
    on_i[..., :3, 3:] = np.matmul(a_i, skew(geo.arm_parent))
    on_j[..., 3:, 3:] = np.matmul(normals, a_j)
    on_i[..., 3:, 3:] = -np.matmul(normals, a_i)
    rows = np.zeros((samples, joints, 6, len(geo.mass) + 1, 6))
    each = np.arange(joints)
    rows[:, each, :, geo.child] = np.moveaxis(on_j, 1, 0)
    rows[:, each, :, geo.parent] = np.moveaxis(on_i, 1, 0)
    on_bodies = rows[..., :-1, :].reshape(samples, joints, 6, -1)
    return on_bodies[:, :, :5].reshape(samples, 5 * joints, -1), on_bodies[:, :, 5]


def acceleration_bias(mechanism: Mechanism, q: Placement, speed: Array) -> Array:
    """gamma (T, 5 nj) of Phi_q q'' = gamma, for generalized speeds (T, n) that obey Phi_q q' = 0.

    gamma = -[omega_j x (omega_j x s_j) - omega_i x (omega_i x s_i);
              f.(w_j x (w_j x h)) + 2 (w_i x f).(w_j x h) + h.(w_i x (w_i x f));  the same with g]
    The axis rows need none: h' . (omega_j - omega_i) = 0 where the relative velocity is along h.
    """
    geo = mechanism.geometry
    omega = np.zeros(q.position.shape)
    omega[:, :-1] = speed.reshape(len(speed), -1, 6)[..., 3:]
    omega = apply(q.orientation, omega)
    w_i, w_j = omega[:, geo.parent], omega[:, geo.child]
    a_i, a_j = q.orientation[:, geo.parent], q.orientation[:, geo.child]
    h = apply(a_j, geo.triad[:, 2])
    spin_h = cross(w_j, h)
    child = cross(w_j, cross(w_j, apply(a_j, geo.arm_child)))
    parent = cross(w_i, cross(w_i, apply(a_i, geo.arm_parent)))
    gamma = np.empty((*w_i.shape[:2], 5))
    gamma[..., :3] = parent - child
    for row in (0, 1):
        f = apply(a_i, geo.triad[:, row])
        spin_f = cross(w_i, f)
        terms = f * cross(w_j, spin_h) + 2 * spin_f * spin_h + h * cross(w_i, spin_f)
        gamma[..., 3 + row] = -np.sum(terms, axis=-1)
    return gamma.reshape(len(speed), -1)


def body_speeds(constraint: Array, axis: Array, rate: Array) -> Array:
    """Generalized speeds q' (T, n) from [Phi_q; axis] q' = [0; rate], rates (T, nj) rad/s."""
    driven = np.concatenate([constraint, axis], axis=1)
    right = np.concatenate([np.zeros(constraint.shape[:2]), rate], axis=1)
    return solve(driven, right)


def solve(matrix: Array, right: Array) -> Array:
    """matrix^-1 right for stacks of matrices and of vectors."""
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], np.float64)


# ---------------------------------------------------------------- (5), (6), (10)-(15)


def full_pivoting(jacobian: Array) -> tuple[Indices, Indices]:
    """Split coordinates into dependent (T, m) and independent (T, n - m) ones (5).

    Gaussian elimination of Phi_q (T, m, n); each pivot is the largest entry left in all rows and
    columns. Raises `PinfricError` where the constraints are not independent.
    """
    work = jacobian.copy()
    samples, m, n = work.shape
    each = np.arange(samples)
    dependent = np.empty((samples, m), dtype=np.intp)
    row_left, column_left = np.ones((samples, m), bool), np.ones((samples, n), bool)
    for k in range(m):
        size = np.where(row_left[:, :, None] & column_left[:, None, :], np.abs(work), -1.0)
        row, column = np.divmod(size.reshape(samples, -1).argmax(axis=1), n)
        pivot = work[each, row, column]
        if np.any(np.abs(pivot) < 1e-10 * np.abs(jacobian).max()):
            raise PinfricError("the constraints of the mechanism depend on each other")
        ratio = np.where(row_left, work[each, :, column] / pivot[:, None], 0.0)
        ratio[each, row] = 0.0
        work -= ratio[:, :, None] * work[each, row][:, None, :]
        row_left[each, row] = column_left[each, column] = False
        dependent[:, k] = column
    return dependent, np.nonzero(column_left)[1].reshape(samples, n - m)


def partial_velocity_matrix(jacobian: Array, dependent: Indices, independent: Indices) -> Array:
    """B (T, n, n - m) with Phi_q B = 0:  B = [-Phi_qd^-1 Phi_qi; I] (6), rows in q's order."""
    left = np.take_along_axis(jacobian, dependent[:, None, :], axis=2)
    right = np.take_along_axis(jacobian, independent[:, None, :], axis=2)
    B = np.zeros((len(jacobian), jacobian.shape[2], independent.shape[1]))
    np.put_along_axis(B, dependent[:, :, None], -np.linalg.solve(left, right), axis=1)
    unit = np.broadcast_to(np.eye(independent.shape[1]), B[:, : independent.shape[1]].shape)
    np.put_along_axis(B, independent[:, :, None], unit, axis=1)
    return B


def actuator_forces(mechanism: Mechanism, q: Placement) -> Array:
    """(Q^A)_FA (T, n, na): generalized forces of unit efforts.

    Q_j = {g; s_j~ A_j^T g + A_j^T h} on the child and Q_i = {-g; -s_i~ A_i^T g - A_i^T h} on the
    parent, with s to the point of action, which belongs to the child (14, 15).
    """
    geo = mechanism.geometry
    i, j = geo.drive_parent, geo.drive_child
    a_i, a_j = q.orientation[:, i], q.orientation[:, j]
    g, h = apply(a_j, geo.drive_force), apply(a_j, geo.drive_torque)
    point = q.position[:, j] + apply(a_j, geo.drive_arm)
    arm_i = apply(np.swapaxes(a_i, -1, -2), point - q.position[:, i])
    g_i, h_i = apply(np.swapaxes(a_i, -1, -2), g), apply(np.swapaxes(a_i, -1, -2), h)
    columns = np.zeros((len(point), len(j), len(geo.mass) + 1, 6))
    each = np.arange(len(j))
    columns[:, each, j, :3], columns[:, each, i, :3] = g, -g
    columns[:, each, j, 3:] = cross(geo.drive_arm, geo.drive_force) + geo.drive_torque
    columns[:, each, i, 3:] = -cross(arm_i, g_i) - h_i
    return np.swapaxes(columns[..., :-1, :].reshape(len(point), len(j), -1), 1, 2)


def applied_forces(mechanism: Mechanism, speed: Array) -> Array:
    """Q^E (T, n) of (4): {m g; -omega~ J omega}, gravity and the gyroscopic moment."""
    geo = mechanism.geometry
    omega = speed.reshape(len(speed), -1, 6)[..., 3:]
    weight = np.broadcast_to(geo.mass[:, None] * geo.gravity, omega.shape)
    gyroscopic = -cross(omega, apply(geo.inertia, omega))
    return np.concatenate([weight, gyroscopic], axis=-1).reshape(speed.shape)


def mass_matrix(mechanism: Mechanism) -> Array:
    """M (n, n) of (3): blocks diag(m I, J), constant because omega is in body axes."""
    return mechanism.geometry.mass_matrix


# ---------------------------------------------------------------- reactions and normal loads


def reactions(mechanism: Mechanism, q: Placement, constraint: Array, multipliers: Array) -> Array:
    """Wrench (T, nj, 6) of each joint's constraints on its child, from lambda and Phi_q (step 6).

    -Phi_q^T lambda, taken per joint on the child's six coordinates; force N and moment N m at the
    joint's point in the child's axes, linear first. No component along the axis moment.
    """
    geo = mechanism.geometry
    joints = len(geo.child)
    each = np.arange(joints)
    blocks = constraint.reshape(len(constraint), joints, 5, -1, 6)[:, each, :, geo.child]
    rows = np.moveaxis(blocks, 0, 1)  # (T, nj, 5, 6)
    on_child = -apply(np.swapaxes(rows, -1, -2), multipliers.reshape(-1, joints, 5))
    force = apply(np.swapaxes(q.orientation[:, geo.child], -1, -2), on_child[..., :3])
    moment = on_child[..., 3:] - cross(geo.arm_child, force)
    return np.concatenate([force, moment], axis=-1)


def contact_forces(mechanism: Mechanism, wrench: Array) -> Array:
    """The two radial forces (..., ns, 2, 3) N at a pin's ends: F_r/2 +- (M_b x k)/length.

    A pin without length carries F_r at one point: both halves are F_r/2. F_r and M_b are the
    parts of the joint's wrench (..., nj, 6) normal to its axis k.
    """
    geo = mechanism.geometry
    k = geo.triad[geo.sites, 2]
    force, moment = wrench[..., geo.sites, :3], wrench[..., geo.sites, 3:]
    radial = force - np.sum(force * k, axis=-1, keepdims=True) * k
    couple = cross(moment, k) * geo.per_length[:, None]
    return np.stack([radial / 2 + couple, radial / 2 - couple], axis=-2)


def normal_load(mechanism: Mechanism, wrench: Array) -> Array:
    """Radius-weighted sum of contact forces (..., ns) N m; friction = coefficient x this."""
    forces = contact_forces(mechanism, wrench)
    return mechanism.geometry.radius * np.linalg.norm(forces, axis=-1).sum(axis=-1)
