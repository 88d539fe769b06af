"""Kernels of loops: poses and motion of links, and the effect of actions on joints.

All quantities are in world axes, one row per sample; `loops.Linkage` describes the tables.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.kernels.compiled import kernel


class Actions(NamedTuple):
    """Tables for the kernels of loops: columns of `loops.Linkage`, then of `twin.Twin`."""

    pair_kind: np.ndarray
    rotation: np.ndarray
    frame_joint: np.ndarray
    frame_p: np.ndarray
    frame_R: np.ndarray  # noqa: N815 - a rotation matrix
    pair_axis: np.ndarray
    column_pair: np.ndarray
    unit: np.ndarray
    support: np.ndarray
    v_index: np.ndarray
    ratio: np.ndarray
    axis: np.ndarray
    components: np.ndarray


@kernel
def rotation(x: float, y: float, z: float, w: float, R: np.ndarray) -> None:
    """Write the rotation matrix of a unit quaternion."""
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@kernel
def _turn(R: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Write R x."""
    for r in range(3):
        out[r] = R[r, 0] * x[0] + R[r, 1] * x[1] + R[r, 2] * x[2]


@kernel
def _cross(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Write a x b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def _normalize(a: np.ndarray) -> float:
    """Write a / |a|, NaN if |a| = 0; return |a|."""
    length = np.sqrt(a[0] ** 2 + a[1] ** 2 + a[2] ** 2)
    for k in range(3):
        a[k] = a[k] / length if length > 0.0 else np.nan
    return length


@kernel
def place_links(
    q_twin: np.ndarray,
    parents: np.ndarray,
    placement_p: np.ndarray,
    placement_R: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
) -> None:
    """Write position and orientation of every joint's child frame in the world.

    Args:
        q_twin: (n, 7 nj), as `twin.embed` writes it.
        parents: (nj,) row of each joint's parent, -1 for the ground.
        placement_p, placement_R: (nj, 3), (nj, 3, 3), fixed placement in the parent's frame.
        p, R: (n, nj, 3), (n, nj, 3, 3), overwritten.
    """
    turn, side = np.empty((3, 3)), np.empty((3, 3))
    moved = np.empty(3)
    for i in range(q_twin.shape[0]):
        for j in range(parents.size):
            s, above = 7 * j, parents[j]
            rotation(q_twin[i, s + 3], q_twin[i, s + 4], q_twin[i, s + 5], q_twin[i, s + 6], turn)
            _turn(placement_R[j], q_twin[i, s : s + 3], moved)
            for r in range(3):
                moved[r] += placement_p[j, r]
                for c in range(3):
                    side[r, c] = 0.0
                    for k in range(3):
                        side[r, c] += placement_R[j, r, k] * turn[k, c]
            if above < 0:
                for r in range(3):
                    p[i, j, r] = moved[r]
                    for c in range(3):
                        R[i, j, r, c] = side[r, c]
                continue
            for r in range(3):
                p[i, j, r] = p[i, above, r]
                for k in range(3):
                    p[i, j, r] += R[i, above, r, k] * moved[k]
                for c in range(3):
                    R[i, j, r, c] = 0.0
                    for k in range(3):
                        R[i, j, r, c] += R[i, above, r, k] * side[k, c]


@kernel
def move_links(
    v_twin: np.ndarray,
    a_twin: np.ndarray,
    parents: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> None:
    """Write velocity and acceleration of every link: of its joint's origin and its rotation.

    Accelerations are second derivatives of positions, without gravity.

    Args:
        v_twin, a_twin: (n, 6 nj), as `twin.embed` writes them.
        parents, p, R: as in `place_links`.
        velocity, acceleration: (n, nj, 6), overwritten, linear first, world axes.
    """
    d, slide, spin = np.empty(3), np.empty(3), np.empty(3)
    slide_rate, spin_rate = np.empty(3), np.empty(3)
    u, x = np.empty(3), np.empty(3)
    still = np.zeros(6)
    for i in range(v_twin.shape[0]):
        for j in range(parents.size):
            s, above = 6 * j, parents[j]
            _turn(R[i, j], v_twin[i, s : s + 3], slide)
            _turn(R[i, j], v_twin[i, s + 3 : s + 6], spin)
            _turn(R[i, j], a_twin[i, s : s + 3], slide_rate)
            _turn(R[i, j], a_twin[i, s + 3 : s + 6], spin_rate)
            up_v = velocity[i, above] if above >= 0 else still
            up_a = acceleration[i, above] if above >= 0 else still
            omega, alpha = up_v[3:], up_a[3:]
            for c in range(3):
                d[c] = p[i, j, c] - (p[i, above, c] if above >= 0 else 0.0)
            _cross(omega, d, u)
            for c in range(3):
                velocity[i, j, c] = up_v[c] + u[c] + slide[c]
                velocity[i, j, 3 + c] = omega[c] + spin[c]
                acceleration[i, j, c] = up_a[c] + slide_rate[c]
                acceleration[i, j, 3 + c] = alpha[c] + spin_rate[c]
                u[c] += 2.0 * slide[c]
            _cross(omega, u, x)  # centripetal and Coriolis
            for c in range(3):
                acceleration[i, j, c] += x[c]
            _cross(alpha, d, x)
            for c in range(3):
                acceleration[i, j, c] += x[c]
            _cross(spin, slide, x)
            for c in range(3):
                acceleration[i, j, c] += x[c]
            _cross(omega, spin, x)
            for c in range(3):
                acceleration[i, j, 3 + c] += x[c]


@kernel
def _point(joint: int, local: np.ndarray, p: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    """Write a point's position; joint -1 is the ground. p, R of the links: (nj, 3), (nj, 3, 3)."""
    if joint < 0:
        for c in range(3):
            out[c] = local[c]
        return
    _turn(R[joint], local, out)
    for c in range(3):
        out[c] += p[joint, c]


@kernel
def _orientation(joint: int, local: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    """Write the rotation of a frame on a link."""
    for r in range(3):
        for c in range(3):
            if joint < 0:
                out[r, c] = local[r, c]
                continue
            out[r, c] = 0.0
            for k in range(3):
                out[r, c] += R[joint, r, k] * local[k, c]


@kernel
def act_on_joints(
    p: np.ndarray, R: np.ndarray, actions: Actions, X: np.ndarray, J: np.ndarray
) -> None:
    """Write the effect of each action on the wrenches of all joints and the generalized effort.

    Args:
        p, R: see `place_links`.
        actions: or any record with its fields.
        X: (n, nj + number of pairs, 6, nx), overwritten: change of a joint's wrench per unit
            action, parent on child in the child's frame; of a loop's joint, a on b in frame b; of a
            cylinder, the force on b along z.
        J: (n, nx, nv), overwritten: rows of the Jacobian, tau = J^T x.
    """
    frame_joint, frame_p, frame_R = actions.frame_joint, actions.frame_p, actions.frame_R
    column_pair, unit, pair_kind = actions.column_pair, actions.unit, actions.pair_kind
    nj, push, Rb = actions.v_index.size, np.empty((column_pair.size, 9)), np.empty((3, 3))
    at, force, moment = np.empty(3), np.empty(3), np.empty(3)
    X[:] = 0.0
    J[:] = 0.0
    for i in range(p.shape[0]):
        for c in range(column_pair.size):
            pair = column_pair[c]
            kind, b = pair_kind[pair], frame_joint[pair, 1]
            _point(b, frame_p[pair, 1], p[i], R[i], at)
            if kind == 1:  # cylinder: b is pushed away from a
                _point(frame_joint[pair, 0], frame_p[pair, 0], p[i], R[i], force)
                for k in range(3):
                    force[k], moment[k] = at[k] - force[k], 0.0
                _normalize(force)
                X[i, nj + pair, 2, c] = 1.0
            else:
                _orientation(b, frame_R[pair, 1], R[i], Rb)
                _turn(Rb, unit[c, :3], force)
                _turn(Rb, unit[c, 3:], moment)
            if kind == 0 or kind >= 3:  # a loop
                for k in range(6):
                    X[i, nj + pair, k, c] = unit[c, k]
            if kind == 3 and unit[c, 3] ** 2 + unit[c, 4] ** 2 + unit[c, 5] ** 2 > 0.0:
                _common_normal(frame_joint[pair, 0], frame_R[pair, 0], R[i], unit[c, 3:], moment)
                for k in range(3):  # in frame b
                    X[i, nj + pair, 3 + k, c] = 0.0
                    for r in range(3):
                        X[i, nj + pair, 3 + k, c] += Rb[r, k] * moment[r]
            for k in range(3):
                push[c, k], push[c, 3 + k], push[c, 6 + k] = at[k], force[k], moment[k]
        _spread(
            actions.support,
            push,
            p[i],
            R[i],
            actions.v_index,
            actions.ratio,
            actions.axis,
            actions.components,
            X[i],
            J[i],
        )


@kernel
def _common_normal(
    a: int, frame_R: np.ndarray, R: np.ndarray, axis: np.ndarray, moment: np.ndarray
) -> None:
    """Write the common normal of the axes of a and b in place of b's axis.

    Args:
        a, frame_R: row of the joint that carries frame a, and the frame's axes in it (3, 3).
        R: (nj, 3, 3) of the links.
        axis: (3,) in frame a as in frame b.
        moment: (3,) b's axis in the world, overwritten.
    """
    Ra, first, second = np.empty((3, 3)), np.empty(3), moment.copy()
    _orientation(a, frame_R, R, Ra)
    _turn(Ra, axis, first)
    _cross(first, second, moment)
    _normalize(moment)


@kernel
def _spread(
    support: np.ndarray,
    push: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
    v_index: np.ndarray,
    ratio: np.ndarray,
    axis: np.ndarray,
    components: np.ndarray,
    X: np.ndarray,
    J: np.ndarray,
) -> None:
    """Write the effect of actions on the wrenches of the joints that carry one side of them.

    Args:
        push: (nx, 9) where each acts, its force and its moment, world.
        p, R: (nj, 3), (nj, 3, 3) of the links.
        X: (nj + number of pairs, 6, nx), the joints' rows written. J: (nx, nv), added to.
    """
    for c in range(support.shape[0]):
        fx, fy, fz = push[c, 3], push[c, 4], push[c, 5]
        for j in range(support.shape[1]):
            sign = support[c, j]
            if sign == 0:
                continue
            x, y, z = push[c, 0] - p[j, 0], push[c, 1] - p[j, 1], push[c, 2] - p[j, 2]
            mx = push[c, 6] + y * fz - z * fy
            my = push[c, 7] + z * fx - x * fz
            mz = push[c, 8] + x * fy - y * fx
            for k in range(3):
                X[j, k, c] = -sign * (R[j, 0, k] * fx + R[j, 1, k] * fy + R[j, 2, k] * fz)
                X[j, 3 + k, c] = -sign * (R[j, 0, k] * mx + R[j, 1, k] * my + R[j, 2, k] * mz)
            if components[j, 0] < 0:
                total = 0.0
                for k in range(6):
                    total -= axis[j, k] * X[j, k, c]
                J[c, v_index[j]] += ratio[j] * total
                continue
            m = 0
            while m < 6 and components[j, m] >= 0:
                J[c, v_index[j] + m] -= X[j, components[j, m], c]
                m += 1


@kernel
def relate_pairs(
    p: np.ndarray,
    R: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    actions: Actions,
    gap: np.ndarray,
    rate: np.ndarray,
    rate_derivative: np.ndarray,
    tilt: np.ndarray,
    scale: np.ndarray,
) -> None:
    """Write the gap between frames a and b along every action, its rate and its second derivative.

    Along a multiplier all three are zero while the loop is closed.

    Args:
        p, R, velocity, acceleration: of the links (`place_links`, `move_links`).
        actions: or any record with its fields.
        gap: (n, nx), overwritten, as all below: displacement (m) or angle (rad) of b from a; a
            cylinder's length.
        rate, rate_derivative: (n, nx) velocity that each action does work on.
        tilt: (n, np) angle (rad) between the axes of frames a and b.
        scale: (n, np, 2) size of the terms of the rates and their derivatives.
    """
    frames, motion, slip = np.empty((10, 3)), np.empty((2, 4, 3)), np.empty((4, 3))
    ka, kb, Ra, Rb = frames[2], frames[3], frames[4:7], frames[7:]
    r, theta, x, y, three = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    column_pair, unit, pair_kind = actions.column_pair, actions.unit, actions.pair_kind
    for i in range(p.shape[0]):
        done = -1
        for c in range(column_pair.size):
            pair, kind = column_pair[c], pair_kind[column_pair[c]]
            if pair != done:
                done = pair
                links = p[i], R[i], velocity[i], acceleration[i]
                _slip(actions, pair, links, frames, motion, slip, scale[i, pair])
                along = 0.0
                for k in range(3):
                    r[k] = frames[1, k] - frames[0, k]
                    along += ka[k] * r[k] if kind == 4 else 0.0
                for k in range(3):  # of a loop that slides, what lies along the axis is no gap
                    r[k] -= along * ka[k]
                _rotation_from_a_to_b(actions.rotation[pair], Ra, Rb, ka, kb, theta)
                tilt[i, pair] = _angle(ka, kb, x)
            _turn(Rb, unit[c, :3], x)
            _turn(Rb, unit[c, 3:], y)
            if kind == 1:
                _length(r, motion, three)
            elif kind == 3 and y[0] ** 2 + y[1] ** 2 + y[2] ** 2 > 0.0:
                _turn_about_normal(ka, kb, motion, three)
            else:
                three[0] = three[1] = three[2] = 0.0
                for k in range(3):
                    three[0] += x[k] * r[k] + y[k] * theta[k]
                    three[1] += x[k] * slip[0, k] + y[k] * slip[2, k]
                    three[2] += x[k] * slip[1, k] + y[k] * slip[3, k]
            gap[i, c], rate[i, c], rate_derivative[i, c] = three[0], three[1], three[2]


@kernel
def _slip(
    actions: Actions,
    pair: int,
    links: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    frames: np.ndarray,
    motion: np.ndarray,
    slip: np.ndarray,
    scale: np.ndarray,
) -> None:
    """Write the motion of the frames of a pair, and that of b relative to the body of a.

    With r from a to b and dots for derivatives in the world,

        s = r' - omega_a x r,       in frame b  r'' - omega_a' x r - omega_a x r' - omega_b x s
        w = omega_b - omega_a,      in frame b  w' - omega_b x w

    Args:
        links: p (nj, 3), R (nj, 3, 3), velocity (nj, 6), acceleration (nj, 6) of the links.
        frames: (10, 3), overwritten, as all below: positions of a and b, their axes, their
            rotations.
        motion: (2, 4, 3) of a and of b v, its derivative, omega, its derivative.
        slip: (4, 3) s, its derivative in frame b, w, its derivative in frame b.
        scale: (2,) size of the terms of a rate and of its derivative.
    """
    p, R, velocity, acceleration = links
    joint, axis = actions.frame_joint[pair], actions.pair_axis[pair]
    local_p, local_R = actions.frame_p[pair], actions.frame_R[pair]
    scale[0] = scale[1] = 0.0
    for side in range(2):
        turn = frames[4 + 3 * side : 7 + 3 * side]
        _point(joint[side], local_p[side], p, R, frames[side])
        _orientation(joint[side], local_R[side], R, turn)
        _turn(turn, axis, frames[2 + side])
        _move_point(joint[side], frames[side], p, velocity, acceleration, motion[side])
        for k in range(3):
            scale[0] += abs(motion[side, 0, k]) + abs(motion[side, 2, k])
            scale[1] += abs(motion[side, 1, k]) + abs(motion[side, 3, k])
            scale[1] += motion[side, 2, k] * motion[side, 2, k]
    for row in range(4):
        for k in range(3):
            slip[row, k] = motion[1, row, k] - motion[0, row, k]
    # r = (x, y, z), omega_a = w, omega_b = b, omega_a' = e, r' = u, s
    x, y = frames[1, 0] - frames[0, 0], frames[1, 1] - frames[0, 1]
    z = frames[1, 2] - frames[0, 2]
    wx, wy, wz = motion[0, 2, 0], motion[0, 2, 1], motion[0, 2, 2]
    bx, by, bz = motion[1, 2, 0], motion[1, 2, 1], motion[1, 2, 2]
    ex, ey, ez = motion[0, 3, 0], motion[0, 3, 1], motion[0, 3, 2]
    ux, uy, uz = slip[0, 0], slip[0, 1], slip[0, 2]
    sx, sy, sz = ux - (wy * z - wz * y), uy - (wz * x - wx * z), uz - (wx * y - wy * x)
    slip[0, 0], slip[0, 1], slip[0, 2] = sx, sy, sz
    slip[1, 0] -= ey * z - ez * y + (wy * uz - wz * uy) + (by * sz - bz * sy)
    slip[1, 1] -= ez * x - ex * z + (wz * ux - wx * uz) + (bz * sx - bx * sz)
    slip[1, 2] -= ex * y - ey * x + (wx * uy - wy * ux) + (bx * sy - by * sx)
    slip[3, 0] -= by * slip[2, 2] - bz * slip[2, 1]
    slip[3, 1] -= bz * slip[2, 0] - bx * slip[2, 2]
    slip[3, 2] -= bx * slip[2, 1] - by * slip[2, 0]


@kernel
def _move_point(
    joint: int,
    at: np.ndarray,
    p: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    motion: np.ndarray,
) -> None:
    """Write the motion of a point of a link (4, 3): v, its derivative, omega, its derivative."""
    for k in range(3):
        motion[0, k] = motion[1, k] = motion[2, k] = motion[3, k] = 0.0
    if joint < 0:
        return
    wx, wy, wz = velocity[joint, 3], velocity[joint, 4], velocity[joint, 5]
    ex, ey, ez = acceleration[joint, 3], acceleration[joint, 4], acceleration[joint, 5]
    rx, ry, rz = at[0] - p[joint, 0], at[1] - p[joint, 1], at[2] - p[joint, 2]
    vx, vy, vz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
    motion[0, 0] = velocity[joint, 0] + vx
    motion[0, 1] = velocity[joint, 1] + vy
    motion[0, 2] = velocity[joint, 2] + vz
    motion[1, 0] = acceleration[joint, 0] + wy * vz - wz * vy + ey * rz - ez * ry
    motion[1, 1] = acceleration[joint, 1] + wz * vx - wx * vz + ez * rx - ex * rz
    motion[1, 2] = acceleration[joint, 2] + wx * vy - wy * vx + ex * ry - ey * rx
    for k in range(3):
        motion[2, k], motion[3, k] = velocity[joint, 3 + k], acceleration[joint, 3 + k]


@kernel
def _length(r: np.ndarray, motion: np.ndarray, out: np.ndarray) -> None:
    """Write the length of a line from a to b, its rate and the rate's derivative."""
    length = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2)
    along, along_rate, square = 0.0, 0.0, 0.0
    for k in range(3):
        e = r[k] / length if length > 0.0 else np.nan
        v = motion[1, 0, k] - motion[0, 0, k]
        along += e * v
        along_rate += e * (motion[1, 1, k] - motion[0, 1, k])
        square += v * v
    out[0], out[1] = length, along
    out[2] = along_rate + (square - along * along) / length


@kernel
def _turn_about_normal(ka: np.ndarray, kb: np.ndarray, motion: np.ndarray, out: np.ndarray) -> None:
    """Write the angle of two axes from perpendicular, and the rotation of b about their normal n.

        angle = -atan2(ka.kb, |ka x kb|),   rate = n.(omega_b - omega_a),   n = ka x kb / |ka x kb|

    Args:
        ka, kb: (3,) the unit axes of a and b.
        motion: (2, 4, 3), `_move_point` of both.
        out: (3,), overwritten: angle, rate and the rate's derivative.
    """
    n, turned_a, turned_b = np.empty(3), np.empty(3), np.empty(3)
    x, y = np.empty(3), np.empty(3)
    _cross(ka, kb, n)
    sine = _normalize(n)
    _cross(motion[0, 2], ka, turned_a)
    _cross(motion[1, 2], kb, turned_b)
    _cross(turned_a, kb, x)
    _cross(ka, turned_b, y)
    cosine, lengthened = 0.0, 0.0
    for k in range(3):
        cosine += ka[k] * kb[k]
        lengthened += n[k] * (x[k] + y[k])
    out[0], out[1], out[2] = -np.arctan2(cosine, sine), 0.0, 0.0
    for k in range(3):
        spin = motion[1, 2, k] - motion[0, 2, k]
        out[1] += n[k] * spin
        out[2] += n[k] * (motion[1, 3, k] - motion[0, 3, k])
        out[2] += (x[k] + y[k] - n[k] * lengthened) / sine * spin


@kernel
def _angle(a: np.ndarray, b: np.ndarray, work: np.ndarray) -> float:
    """Return the angle between two unit vectors; `work` (3,) is overwritten."""
    _cross(a, b, work)
    sine = np.sqrt(work[0] ** 2 + work[1] ** 2 + work[2] ** 2)
    return np.arctan2(sine, a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@kernel
def _rotation_from_a_to_b(
    rotation: int,
    Ra: np.ndarray,
    Rb: np.ndarray,
    ka: np.ndarray,
    kb: np.ndarray,
    theta: np.ndarray,
) -> None:
    """Write the rotation vector (world) to be closed by a loop: none, that of its axis, or all."""
    for k in range(3):
        theta[k] = 0.0
    if rotation == 0 or rotation == 3:
        return
    if rotation == 1:
        _cross(ka, kb, theta)
        cosine = ka[0] * kb[0] + ka[1] * kb[1] + ka[2] * kb[2]
    else:
        cosine = -0.5
        for r in range(3):
            s, t = (r + 1) % 3, (r + 2) % 3
            for c in range(3):
                # the antisymmetric part of Rb Ra^T is sin(angle) times the axis
                theta[r] += 0.5 * (Rb[t, c] * Ra[s, c] - Rb[s, c] * Ra[t, c])
                cosine += 0.5 * Rb[r, c] * Ra[r, c]
    sine = np.sqrt(theta[0] ** 2 + theta[1] ** 2 + theta[2] ** 2)
    if sine > 0.0:
        factor = np.arctan2(sine, cosine) / sine
        for k in range(3):
            theta[k] *= factor
    elif cosine < 0.0:
        theta[0] = np.pi  # half a turn: any axis can be used
