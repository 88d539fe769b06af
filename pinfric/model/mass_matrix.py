"""Mass matrices and frame Jacobians of a whole batch, from the poses of all links.

With S_j the unit twists of a joint and I_j^c the inertia of its link and all beyond it, both at the
world's origin and in the world's axes,

    M_ij = S_i^T I_j^c S_j        i on the way from the ground to j        (composite rigid bodies)

Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, 6.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.kernels.compiled import kernel
from pinfric.model.closure import embedded, tree_tables
from pinfric.model.kinematics import place_links
from pinfric.model.twin import Twin


class Bodies(NamedTuple):
    """Links and the twists of their joints as arrays for the kernel.

    Attributes:
        mass, com, inertia: (nj,), (nj, 3), (nj, 3, 3) in the joint's frame, about the com.
        joint, column: (ns,) the joint of each unit twist, and its column of the velocity.
        twist: (ns, 6) in the joint's frame, linear first; a mimic joint's times its ratio.
        first: (nj + 1,) twists of joint j are first[j] to first[j + 1].
    """

    mass: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    joint: np.ndarray
    column: np.ndarray
    twist: np.ndarray
    first: np.ndarray


def mass_matrices(twin: Twin, q: np.ndarray) -> np.ndarray:
    """Return M(q) (n, nv, nv) of configurations (n, nq), rotors (armatures) left out.

    Args:
        twin: the robot with its payloads.
        q: rad, m; samples equal to the one before are not computed again.
    """
    moved = np.append(True, (q[1:] != q[:-1]).any(axis=1))
    p, R = link_poses(twin, q[moved])
    M = np.zeros((len(p), twin.nv, twin.nv))
    write_mass_matrices(p, R, tree_tables(twin)[0], bodies(twin), M)
    return M if moved.all() else M[moved.cumsum() - 1]


def link_poses(twin: Twin, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, nj, 3) and axes (n, nj, 3, 3) of the joints' child frames, world."""
    still = np.zeros((len(q), twin.nv))
    p, R = np.empty((len(q), twin.n_joints, 3)), np.empty((len(q), twin.n_joints, 3, 3))
    place_links(embedded(twin, q, still, still)[0], *tree_tables(twin), p, R)
    return p, R


def bodies(twin: Twin) -> Bodies:
    """Return the robot's links and unit twists."""
    if "bodies" not in twin.pools:
        joint, column, twist = [], [], []
        for j in range(twin.n_joints):
            if twin.components[j, 0] < 0:
                joint.append(j)
                column.append(int(twin.v_index[j]))
                twist.append(twin.ratio[j] * twin.axis[j])
            for n, component in enumerate(twin.components[j]):
                if component >= 0:
                    joint.append(j)
                    column.append(int(twin.v_index[j]) + n)
                    twist.append(np.eye(6)[component])
        inertias = tuple(twin.model.inertias)[1:]
        twin.pools["bodies"] = Bodies(
            mass=np.array([body.mass for body in inertias], dtype=float),
            com=np.array([body.lever for body in inertias], dtype=float).reshape(-1, 3),
            inertia=np.array([body.inertia for body in inertias], dtype=float).reshape(-1, 3, 3),
            joint=np.array(joint, dtype=np.int64),
            column=np.array(column, dtype=np.int64),
            twist=np.array(twist, dtype=float).reshape(-1, 6),
            first=np.searchsorted(joint, np.arange(twin.n_joints + 1)).astype(np.int64),
        )
    found: Bodies = twin.pools["bodies"]
    return found


# Kernels below take whole arrays and indices: a view of an array costs more than what is computed.


@kernel
def _write_twist(
    p: np.ndarray, R: np.ndarray, i: int, j: int, twist: np.ndarray, k: int, S: np.ndarray
) -> None:
    """Write twist k of joint j in world axes: velocity at the world's origin, then rotation."""
    for r in range(3):
        x, y, z = R[i, j, r, 0], R[i, j, r, 1], R[i, j, r, 2]
        S[k, r] = x * twist[k, 0] + y * twist[k, 1] + z * twist[k, 2]
        S[k, 3 + r] = x * twist[k, 3] + y * twist[k, 4] + z * twist[k, 5]
    S[k, 0] += p[i, j, 1] * S[k, 5] - p[i, j, 2] * S[k, 4]
    S[k, 1] += p[i, j, 2] * S[k, 3] - p[i, j, 0] * S[k, 5]
    S[k, 2] += p[i, j, 0] * S[k, 4] - p[i, j, 1] * S[k, 3]


@kernel
def _turned(half: np.ndarray, R: np.ndarray, i: int, j: int, r: int, s: int) -> float:
    """Return (R I R^T)_rs from half = R I."""
    return float(
        half[r, 0] * R[i, j, s, 0] + half[r, 1] * R[i, j, s, 1] + half[r, 2] * R[i, j, s, 2]
    )


@kernel
def _add_link(
    p: np.ndarray, R: np.ndarray, i: int, j: int, links: Bodies, half: np.ndarray, body: np.ndarray
) -> None:
    """Add link j to body[j]: m, m c (3), then xx yy zz xy xz yz about the world's origin.

    Args:
        half: (4, 3), overwritten.
    """
    m, com, inertia = links.mass[j], links.com, links.inertia
    for r in range(3):
        a, b, c = R[i, j, r, 0], R[i, j, r, 1], R[i, j, r, 2]
        half[3, r] = p[i, j, r] + a * com[j, 0] + b * com[j, 1] + c * com[j, 2]
        for k in range(3):
            half[r, k] = a * inertia[j, 0, k] + b * inertia[j, 1, k] + c * inertia[j, 2, k]
    x, y, z = half[3, 0], half[3, 1], half[3, 2]
    body[j, 0] += m
    body[j, 1] += m * x
    body[j, 2] += m * y
    body[j, 3] += m * z
    body[j, 4] += m * (y * y + z * z) + _turned(half, R, i, j, 0, 0)
    body[j, 5] += m * (x * x + z * z) + _turned(half, R, i, j, 1, 1)
    body[j, 6] += m * (x * x + y * y) + _turned(half, R, i, j, 2, 2)
    body[j, 7] += _turned(half, R, i, j, 0, 1) - m * x * y
    body[j, 8] += _turned(half, R, i, j, 0, 2) - m * x * z
    body[j, 9] += _turned(half, R, i, j, 1, 2) - m * y * z


@kernel
def _write_momentum(body: np.ndarray, j: int, S: np.ndarray, k: int, h: np.ndarray) -> None:
    """Write the momentum (6,) of body[j] that moves with twist k, at the world's origin."""
    m, x, y, z = body[j, 0], body[j, 1], body[j, 2], body[j, 3]
    xy, xz, yz = body[j, 7], body[j, 8], body[j, 9]
    a, b, c = S[k, 3], S[k, 4], S[k, 5]
    h[0] = m * S[k, 0] + b * z - c * y
    h[1] = m * S[k, 1] + c * x - a * z
    h[2] = m * S[k, 2] + a * y - b * x
    h[3] = body[j, 4] * a + xy * b + xz * c + y * S[k, 2] - z * S[k, 1]
    h[4] = xy * a + body[j, 5] * b + yz * c + z * S[k, 0] - x * S[k, 2]
    h[5] = xz * a + yz * b + body[j, 6] * c + x * S[k, 1] - y * S[k, 0]


@kernel
def write_mass_matrices(
    p: np.ndarray, R: np.ndarray, parents: np.ndarray, links: Bodies, M: np.ndarray
) -> None:
    """Add M(q) to (n, nv, nv) zeros.

    Args:
        p, R: (n, nj, 3), (n, nj, 3, 3) of `link_poses`.
        parents: (nj,) row of each joint's parent, -1 for the ground.
        links: `bodies`.
        M: (n, nv, nv), added to.
    """
    nj, ns = parents.size, links.joint.size
    body, half, S, h = np.empty((nj, 10)), np.empty((4, 3)), np.empty((ns, 6)), np.empty(6)
    for i in range(p.shape[0]):
        body[:] = 0.0
        for k in range(ns):
            _write_twist(p, R, i, links.joint[k], links.twist, k, S)
        for j in range(nj - 1, -1, -1):  # a parent's row is less than its child's
            _add_link(p, R, i, j, links, half, body)
            if parents[j] >= 0:
                for c in range(10):
                    body[parents[j], c] += body[j, c]
            for k in range(links.first[j], links.first[j + 1]):
                _write_momentum(body, j, S, k, h)
                above, a = j, links.column[k]
                while above >= 0:
                    for n in range(links.first[above], links.first[above + 1]):
                        product, b = 0.0, links.column[n]
                        for c in range(6):
                            product += S[n, c] * h[c]
                        M[i, b, a] += product
                        if above != j:
                            M[i, a, b] += product
                    above = parents[above]


def frame_jacobians(twin: Twin, q: np.ndarray, frame: int) -> np.ndarray:
    """Return J (n, 6, nv) of a frame: velocity of its origin, then rate, in the world's axes.

    Args:
        twin: the robot. q: (n, nq) rad, m.
        frame: its id in the model.
    """
    p, R = link_poses(twin, q)
    links, parents = bodies(twin), tree_tables(twin)[0]
    carried = twin.model.frames[frame]
    J, j = np.zeros((len(q), 6, twin.nv)), int(carried.parentJoint) - 1
    if j < 0:
        return J
    origin = p[:, j] + R[:, j] @ carried.placement.translation
    while j >= 0:
        for k in range(links.first[j], links.first[j + 1]):
            rate = R[:, j] @ links.twist[k, 3:]
            moved = R[:, j] @ links.twist[k, :3] + np.cross(rate, origin - p[:, j])
            J[:, :, links.column[k]] += np.concatenate([moved, rate], axis=1)
        j = int(parents[j])
    return J
