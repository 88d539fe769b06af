"""The paper's equations (1), (2), (5), (6), (10)-(15): coordinates, constraints, forces, reactions.

Every body has six absolute coordinates: the position r of its centre of mass and its Euler
parameters e (scalar last); its generalized speeds are r' (ground axes) and the angular velocity
omega in body axes, as in (14) and (15). There is no recursion and no relative coordinate; reactions
come from multipliers only.

Conventions and symbols are those of `bodies`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.errors import PinfricError
from pinfric.paper.bodies import ALONG, TURN, Array, Geometry, Indices, Mechanism, cross

#: Share of the terms that are summed by which a loop may be open, or its motion open it.
CLOSED = 1e-7


def skew(a: Array) -> Array:
    """The matrix a~ with a~ b = a x b, (..., 3, 3)."""
    matrix = np.zeros((*a.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., k, j], matrix[..., j, k] = a[..., i], -a[..., i]
    return matrix


def apply(matrix: Array, vector: Array) -> Array:
    """matrix @ vector over the last axes."""
    return np.matmul(matrix, vector[..., None])[..., 0]


def solve(matrix: Array, right: Array) -> Array:
    """matrix^-1 right for stacks of matrices and of vectors."""
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], np.float64)


# ---------------------------------------------------------------- absolute coordinates (1)


@dataclass(frozen=True, eq=False)
class Placement:
    """Absolute coordinates q (1) of all bodies; the last one of nb + 1 is the ground."""

    position: Array  # (T, nb + 1, 3) centre of mass, ground axes, m
    euler_parameters: Array  # (T, nb + 1, 4) scalar last
    orientation: Array  # (T, nb + 1, 3, 3) body to ground axes


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


def place(mechanism: Mechanism, position: Array) -> Placement:
    """Absolute coordinates at joint positions (T, nt) rad or m, by the tree of joints."""
    geo = mechanism.geometry
    samples, bodies = len(position), len(geo.mass)
    r = np.zeros((samples, bodies + 1, 3))
    e = np.tile([0.0, 0.0, 0.0, 1.0], (samples, bodies + 1, 1))
    A = np.tile(np.eye(3), (samples, bodies + 1, 1, 1))
    tree = slice(position.shape[1])
    h = geo.triad[tree, 2]
    half = np.where(geo.free[tree] == TURN, position, 0.0)[..., None] / 2
    turn = np.concatenate([np.sin(half) * h, np.cos(half)], axis=-1)
    arm = geo.arm_parent[tree] + np.where(geo.free[tree] == ALONG, position, 0.0)[..., None] * h
    for k, (i, j) in enumerate(zip(geo.parent[tree], geo.child[tree], strict=True)):
        e[:, j] = _compose(e[:, i], turn[:, k])
        A[:, j] = _rotation(e[:, j])
        r[:, j] = r[:, i] + apply(A[:, i], arm[:, k]) - A[:, j] @ geo.arm_child[k]
    return Placement(r, e, A)


# ---------------------------------------------------------------- constraints (2)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Parts of the relative motions of all joints; ground axes, samples first.

    f, g, h are fixed in the parent i, s_j runs from the child's centre of mass to its point of the
    joint, s_i from the parent's centre of mass to that same point, d to it from the parent's point.
    """

    a_i: Array  # (T, nj, 3, 3)
    a_j: Array
    triad: Array  # (T, nj, 3, 3) rows f, g, h
    h_j: Array  # (T, nj, 3) the axis, fixed in the child
    s_i: Array
    s_j: Array
    d: Array


def _pairs(geo: Geometry, q: Placement) -> _Pairs:
    a_i, a_j = q.orientation[:, geo.parent], q.orientation[:, geo.child]
    s_j = apply(a_j, geo.arm_child)
    s_i = q.position[:, geo.child] + s_j - q.position[:, geo.parent]
    return _Pairs(
        a_i=a_i,
        a_j=a_j,
        triad=np.matmul(geo.triad, np.swapaxes(a_i, -1, -2)),
        h_j=apply(a_j, geo.triad[:, 2]),
        s_i=s_i,
        s_j=s_j,
        d=s_i - apply(a_i, geo.arm_parent),
    )


@dataclass(frozen=True, eq=False)
class Relative:
    """A linear map to the six relative motions of every joint, or their values.

    Rows: f . d, g . d, h . d, f . h_j, g . h_j and the turn about h (see `relative_jacobian`).
    """

    geometry: Geometry
    rows: Array  # (T, nj, 6, ...)

    @property
    def constraint(self) -> Array:
        """Phi_q (T, m, n), or Phi or gamma (T, m): the rows that are forbidden."""
        samples, joints, _, *columns = self.rows.shape
        return self.rows.reshape(samples, 6 * joints, *columns)[:, self.geometry.constrained]

    @property
    def axis(self) -> Array:
        """(T, nj, ...) the rows measured by the joint positions."""
        return self.rows[:, np.arange(self.rows.shape[1]), self.geometry.free]


def relative_jacobian(mechanism: Mechanism, q: Placement) -> Relative:
    """The Jacobian (T, nj, 6, n) of all relative motions; Phi_q of (2) is among its rows.

    d/dt of [f . d; g . d; h . d; f . h_j; g . h_j] and h . (omega_j - omega_i), where
    d = r_j + A_j s_j - r_i - A_i s_i, for parent i and child j, with h the joint axis and f, g
    normal to it, all three fixed in the parent, and h_j fixed in the child.
    """
    geo = mechanism.geometry
    pairs = _pairs(geo, q)
    f, g, h = np.moveaxis(pairs.triad, -2, 0)
    samples, joints = h.shape[:2]
    normals = np.stack([cross(pairs.h_j, f), cross(pairs.h_j, g), h], axis=-2)
    on_i, on_j = np.zeros((2, samples, joints, 6, 6))
    on_j[..., :3, :3], on_i[..., :3, :3] = pairs.triad, -pairs.triad
    on_j[..., :3, 3:] = np.matmul(cross(pairs.s_j[..., None, :], pairs.triad), pairs.a_j)
    on_i[..., :3, 3:] = -np.matmul(cross(pairs.s_i[..., None, :], pairs.triad), pairs.a_i)
    on_j[..., 3:, 3:] = np.matmul(normals, pairs.a_j)
    on_i[..., 3:, 3:] = -np.matmul(normals, pairs.a_i)
    rows = np.zeros((samples, joints, 6, len(geo.mass) + 1, 6))
    each = np.arange(joints)
    rows[:, each, :, geo.child] = np.moveaxis(on_j, 1, 0)
    rows[:, each, :, geo.parent] = np.moveaxis(on_i, 1, 0)
    return Relative(geo, rows[..., :-1, :].reshape(samples, joints, 6, -1))


def acceleration_bias(mechanism: Mechanism, q: Placement, speed: Array) -> Relative:
    """gamma (T, nj, 6) of [Jacobian] q'' = gamma + x'', at generalized speeds q' (T, n).

    Of k . d, with k one of f, g, h:
        -[k.(w_j x (w_j x s_j) - w_i x (w_i x s_i0)) + 2 (w_i x k).d' + d.(w_i x (w_i x k))],
    of k . h_j: -[k.(w_j x (w_j x h_j)) + 2 (w_i x k).(w_j x h_j) + h_j.(w_i x (w_i x k))],
    s_i0 to the parent's own point of the joint. 0 for the turn: h' . (w_j - w_i) = 0, as w_j - w_i
    is zero or along h.
    """
    geo = mechanism.geometry
    pairs = _pairs(geo, q)
    motion = np.zeros((*q.position.shape[:2], 2, 3))
    motion[:, :-1] = speed.reshape(len(speed), -1, 2, 3)
    velocity, omega = motion[:, :, 0], apply(q.orientation, motion[:, :, 1])
    w_i, w_j = omega[:, geo.parent], omega[:, geo.child]
    own = pairs.s_i - pairs.d
    child, parent = cross(w_j, pairs.s_j), cross(w_i, own)
    d_rate = velocity[:, geo.child] + child - velocity[:, geo.parent] - parent
    apart = cross(w_j, child) - cross(w_i, parent)
    h_rate = cross(w_j, pairs.h_j)
    k_rate = cross(w_i[..., None, :], pairs.triad)
    k_bias = cross(w_i[..., None, :], k_rate)
    gamma = np.zeros((*w_i.shape[:2], 6))
    gamma[..., :3] -= apply(pairs.triad, apart) + 2 * apply(k_rate, d_rate)
    gamma[..., :3] -= apply(k_bias, pairs.d)
    tilt = apply(pairs.triad, cross(w_j, h_rate)) + 2 * apply(k_rate, h_rate)
    gamma[..., 3:TURN] -= (tilt + apply(k_bias, pairs.h_j))[..., :2]
    return Relative(geo, gamma)


def body_speeds(jacobian: Relative, rate: Array) -> Array:
    """Generalized speeds q' (T, n) from rates (T, nt) rad/s or m/s of the tree's joints."""
    return _by_the_tree(jacobian, np.zeros(jacobian.rows.shape[:3]), rate)


def body_accelerations(jacobian: Relative, bias: Relative, acceleration: Array) -> Array:
    """q'' (T, n) from accelerations (T, nt) rad/s^2 or m/s^2 of the tree's joints."""
    return _by_the_tree(jacobian, bias.rows, acceleration)


def _by_the_tree(jacobian: Relative, right: Array, free: Array) -> Array:
    """x of [rows of the tree's joints] x = right, plus `free` (T, nt) along the free ones."""
    samples, tree = free.shape
    rows, right = jacobian.rows[:, :tree], right[:, :tree].copy()
    right[:, np.arange(tree), jacobian.geometry.free[:tree]] += free
    return solve(rows.reshape(samples, 6 * tree, -1), right.reshape(samples, -1))


def check_loops(
    mechanism: Mechanism,
    q: Placement,
    jacobian: Relative,
    bias: Relative,
    speed: Array,
    acceleration: Array,
) -> None:
    """Check Phi = 0 (2), Phi_q q' = 0 and Phi_q q'' = gamma at the joints that close loops.

    The tree's joints obey theirs by construction. Raises `PinfricError` with joint and sample.
    """
    first = len(mechanism.joints)
    pairs = _pairs(mechanism.geometry, q)
    arms = [np.linalg.norm(x[:, first:], axis=-1)[..., None] for x in (pairs.s_i, pairs.s_j)]
    gap = apply(pairs.triad, pairs.d)[:, first:, :2]
    rows = jacobian.rows[:, first:, :2]
    beyond = bias.rows[:, first:, :2]
    levels = {
        "position": (gap, arms[0] + arms[1]),
        "rate": (rows @ speed[:, None, :, None], np.abs(rows) @ np.abs(speed)[:, None, :, None]),
        "acceleration": (
            rows @ acceleration[:, None, :, None] - beyond[..., None],
            np.abs(rows) @ np.abs(acceleration)[:, None, :, None] + np.abs(beyond)[..., None],
        ),
    }
    for name, (off, size) in levels.items():
        wrong = np.argwhere(np.abs(off) > CLOSED * size)
        if len(wrong):
            sample, loop = wrong[0, :2]
            raise PinfricError(
                f"loop {mechanism.loops[loop].name}: the {name} of the tree's "
                f"joints opens it at sample {sample}"
            )


# ---------------------------------------------------------------- (5) and (6)


def full_pivoting(jacobian: Array) -> tuple[Indices, Indices]:
    """Split coordinates into dependent (T, m) and independent (T, n - m) ones (5).

    Gaussian elimination of Phi_q (T, m, n); each pivot is the largest remaining entry. Raises
    `PinfricError` where the constraints are not independent.
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


# ---------------------------------------------------------------- forces, (4) and (10)-(15)


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


# ---------------------------------------------------------------- reactions and normal loads


def reactions(mechanism: Mechanism, q: Placement, jacobian: Relative, multipliers: Array) -> Array:
    """Wrench (T, nj, 6) of each joint's constraints on its child, from lambda and Phi_q (step 6).

    -Phi_q^T lambda, taken per joint on the child's six coordinates; force N and moment N m at the
    child's point of the joint in the child's axes, linear first. No component along the free axis.
    """
    geo = mechanism.geometry
    samples, joints = len(multipliers), len(geo.child)
    each = np.arange(joints)
    of_rows = np.zeros((samples, 6 * joints))
    of_rows[:, geo.constrained] = multipliers
    blocks = jacobian.rows.reshape(len(jacobian.rows), joints, 6, -1, 6)[:, each, :, geo.child]
    rows = np.moveaxis(blocks, 0, 1)  # (T, nj, 6, 6)
    on_child = -apply(np.swapaxes(rows, -1, -2), of_rows.reshape(samples, joints, 6))
    force = apply(np.swapaxes(q.orientation[:, geo.child], -1, -2), on_child[..., :3])
    moment = on_child[..., 3:] - cross(geo.arm_child, force)
    return np.concatenate([force, moment], axis=-1)


def transmitted(mechanism: Mechanism, wrench: Array, effort: Array, friction: Array) -> Array:
    """The whole wrench (..., nj, 6) of each joint on its child: constraints, drives, friction.

    Along the joint's free direction only friction (..., ns) and the efforts (..., na) through it
    act.
    """
    geo = mechanism.geometry
    through = effort @ geo.through.T
    through[..., geo.sites] += friction
    return wrench + through[..., None] * geo.direction


def contact_forces(mechanism: Mechanism, wrench: Array) -> Array:
    """The contact forces (..., ns, 3, 3) N at the joints with friction.

    F_r/2 +- (M_b x k)/length at the two ends of a pin or a guide (a pin without length carries F_r
    at one point: both are F_r/2), and 2 M_a/width of a guide. F_r and M_b are the parts of the
    joint's wrench (..., nj, 6) normal to its axis k, M_a the moment about it.
    """
    geo = mechanism.geometry
    k = geo.triad[geo.sites, 2]
    force, moment = wrench[..., geo.sites, :3], wrench[..., geo.sites, 3:]
    radial = force - np.sum(force * k, axis=-1, keepdims=True) * k
    couple = cross(moment, k) * geo.per_length[:, None]
    about = 2 * np.sum(moment * k, axis=-1, keepdims=True) * k * geo.per_width[:, None]
    return np.stack([radial / 2 + couple, radial / 2 - couple, about], axis=-2)


def normal_load(mechanism: Mechanism, wrench: Array) -> Array:
    """Radius-weighted sum (..., ns) of contact forces, N m of a pin and N of a guide.

    Friction is a coefficient times this (20, 21).
    """
    forces = contact_forces(mechanism, wrench)
    return mechanism.geometry.radius * np.linalg.norm(forces, axis=-1).sum(axis=-1)
