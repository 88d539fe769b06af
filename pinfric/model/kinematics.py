"""Kernels of loops: where links are and how they move, and what actions do to joints.

Everything here is in world axes; samples come first. `Linkage` names the tables.
"""

from __future__ import annotations

import numpy as np

from pinfric.model.compiled import kernel


@kernel
def _rotation(x: float, y: float, z: float, w: float, R: np.ndarray) -> None:
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
            _rotation(q_twin[i, s + 3], q_twin[i, s + 4], q_twin[i, s + 5], q_twin[i, s + 6], turn)
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
    """Write how every link moves: of its joint's origin and of the link's rotation.

    Accelerations are the classical ones: second derivatives of positions, without gravity.

    Args:
        v_twin, a_twin: (n, 6 nj), as `twin.embed` writes them.
        parents: (nj,), see `place_links`.
        p, R: (n, nj, 3), (n, nj, 3, 3), `place_links`.
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
    """Write where a point of a link is; joint -1 is the ground. p, R: (nj, 3), (nj, 3, 3)."""
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
    p: np.ndarray,
    R: np.ndarray,
    pair_kind: np.ndarray,
    frame_joint: np.ndarray,
    frame_p: np.ndarray,
    frame_R: np.ndarray,
    column_pair: np.ndarray,
    unit: np.ndarray,
    support: np.ndarray,
    v_index: np.ndarray,
    ratio: np.ndarray,
    axis: np.ndarray,
    components: np.ndarray,
    X: np.ndarray,
    J: np.ndarray,
) -> None:
    """Write what each action does to the wrenches of all joints and to the generalized effort.

    Args:
        p, R: (n, nj, 3), (n, nj, 3, 3), `place_links`.
        pair_kind ... support: columns of `Linkage`.
        v_index, ratio, axis, components: columns of `Twin`.
        X: (n, nj + number of loops, 6, nx), overwritten: change of the wrench a joint transmits per
            unit action, parent on child in the child's frame; a loop's joint, a on b in frame b.
        J: (n, nx, nv), overwritten: rows of the Jacobian, tau = J^T x.
    """
    nj = v_index.size
    at, end, Rb = np.empty(3), np.empty(3), np.empty((3, 3))
    force, moment, here, turned = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    arm = np.empty(3)
    X[:] = 0.0
    J[:] = 0.0
    for i in range(p.shape[0]):
        for c in range(column_pair.size):
            pair = column_pair[c]
            b = frame_joint[pair, 1]
            _point(b, frame_p[pair, 1], p[i], R[i], at)
            if pair_kind[pair] == 1:  # cylinder: b is pushed away from a
                _point(frame_joint[pair, 0], frame_p[pair, 0], p[i], R[i], end)
                for k in range(3):
                    force[k], moment[k] = at[k] - end[k], 0.0
                length = np.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
                for k in range(3):
                    force[k] = force[k] / length if length > 0.0 else np.nan
            else:
                _orientation(b, frame_R[pair, 1], R[i], Rb)
                _turn(Rb, unit[c, :3], force)
                _turn(Rb, unit[c, 3:], moment)
                if pair_kind[pair] == 0:
                    for k in range(6):
                        X[i, nj + pair, k, c] = unit[c, k]
            for j in range(nj):
                sign = support[c, j]
                if sign == 0:
                    continue
                for k in range(3):
                    arm[k] = at[k] - p[i, j, k]
                _cross(arm, force, here)
                for k in range(3):
                    here[k] += moment[k]
                for k in range(3):
                    turned[k] = 0.0
                    for r in range(3):
                        turned[k] += R[i, j, r, k] * force[r]
                    X[i, j, k, c] = -sign * turned[k]
                for k in range(3):
                    turned[k] = 0.0
                    for r in range(3):
                        turned[k] += R[i, j, r, k] * here[r]
                    X[i, j, 3 + k, c] = -sign * turned[k]
                if components[j, 0] < 0:
                    total = 0.0
                    for k in range(6):
                        total -= axis[j, k] * X[i, j, k, c]
                    J[i, c, v_index[j]] += ratio[j] * total
                else:
                    m = 0
                    while m < 6 and components[j, m] >= 0:
                        J[i, c, v_index[j] + m] -= X[i, j, components[j, m], c]
                        m += 1


@kernel
def relate_pairs(
    p: np.ndarray,
    R: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    pair_kind: np.ndarray,
    rotation: np.ndarray,
    frame_joint: np.ndarray,
    frame_p: np.ndarray,
    frame_R: np.ndarray,
    pair_axis: np.ndarray,
    column_pair: np.ndarray,
    unit: np.ndarray,
    gap: np.ndarray,
    rate: np.ndarray,
    rate_derivative: np.ndarray,
    tilt: np.ndarray,
    scale: np.ndarray,
) -> None:
    """Write how far apart frames a and b are, along every action, and how that changes.

    Along a multiplier all three are zero where the loop is closed and stays so.

    Args:
        p, R, velocity, acceleration: of the links (`place_links`, `move_links`).
        pair_kind ... unit: columns of `Linkage`.
        gap: (n, nx), overwritten: displacement (m) or rotation (rad) of b from a along each
            action, in frame b; a cylinder's length.
        rate, rate_derivative: (n, nx), overwritten: velocity of b relative to a along each action
            (what it does work on), and its derivative.
        tilt: (n, np), overwritten: angle (rad) between the axes of frames a and b.
        scale: (n, np, 2), overwritten: size of the terms that rates and their derivatives are the
            difference of (m/s or rad/s, and per second).
    """
    at = np.empty((2, 3))
    v, w = np.empty((2, 3)), np.empty((2, 3))
    acc, alpha = np.empty((2, 3)), np.empty((2, 3))
    Ra, Rb = np.empty((3, 3)), np.empty((3, 3))
    r, x, y, z = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    slide, slide_rate, spin, spin_rate = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    theta, ka, kb = np.empty(3), np.empty(3), np.empty(3)
    for i in range(p.shape[0]):
        done = -1
        for c in range(column_pair.size):
            pair = column_pair[c]
            if pair != done:
                done = pair
                for side in range(2):
                    joint = frame_joint[pair, side]
                    _point(joint, frame_p[pair, side], p[i], R[i], at[side])
                    for k in range(3):
                        v[side, k] = w[side, k] = acc[side, k] = alpha[side, k] = 0.0
                    if joint < 0:
                        continue
                    for k in range(3):
                        w[side, k] = velocity[i, joint, 3 + k]
                        alpha[side, k] = acceleration[i, joint, 3 + k]
                        r[k] = at[side, k] - p[i, joint, k]
                    _cross(w[side], r, x)
                    _cross(w[side], x, y)
                    _cross(alpha[side], r, z)
                    for k in range(3):
                        v[side, k] = velocity[i, joint, k] + x[k]
                        acc[side, k] = acceleration[i, joint, k] + y[k] + z[k]
                _orientation(frame_joint[pair, 0], frame_R[pair, 0], R[i], Ra)
                _orientation(frame_joint[pair, 1], frame_R[pair, 1], R[i], Rb)
                for k in range(3):
                    r[k] = at[1, k] - at[0, k]
                # b relative to what of a is at the same place, and its derivative in frame b
                _cross(w[0], r, x)
                _cross(alpha[0], r, y)
                for k in range(3):
                    slide[k] = v[1, k] - v[0, k] - x[k]
                    z[k] = v[1, k] - v[0, k]
                    spin[k] = w[1, k] - w[0, k]
                    slide_rate[k] = acc[1, k] - acc[0, k] - y[k]
                    spin_rate[k] = alpha[1, k] - alpha[0, k]
                _cross(w[0], z, x)
                _cross(w[1], slide, y)
                for k in range(3):
                    slide_rate[k] -= x[k] + y[k]
                _cross(w[1], spin, x)
                for k in range(3):
                    spin_rate[k] -= x[k]
                _turn(Ra, pair_axis[pair], ka)
                _turn(Rb, pair_axis[pair], kb)
                _rotation_from_a_to_b(rotation[pair], Ra, Rb, ka, kb, theta)
                _cross(ka, kb, x)
                dot = ka[0] * kb[0] + ka[1] * kb[1] + ka[2] * kb[2]
                tilt[i, pair] = np.arctan2(np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2), dot)
                scale[i, pair, 0] = scale[i, pair, 1] = 0.0
                for side in range(2):
                    for k in range(3):
                        scale[i, pair, 0] += abs(v[side, k]) + abs(w[side, k])
                        scale[i, pair, 1] += abs(acc[side, k]) + abs(alpha[side, k])
                        scale[i, pair, 1] += w[side, k] * w[side, k]
            if pair_kind[pair] == 1:
                length = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2)
                along, along_rate, square = 0.0, 0.0, 0.0
                for k in range(3):
                    e = r[k] / length if length > 0.0 else np.nan
                    along += e * (v[1, k] - v[0, k])
                    along_rate += e * (acc[1, k] - acc[0, k])
                    square += (v[1, k] - v[0, k]) ** 2
                gap[i, c], rate[i, c] = length, along
                rate_derivative[i, c] = along_rate + (square - along * along) / length
                continue
            _turn(Rb, unit[c, :3], x)
            _turn(Rb, unit[c, 3:], y)
            gap[i, c] = rate[i, c] = rate_derivative[i, c] = 0.0
            for k in range(3):
                gap[i, c] += x[k] * r[k] + y[k] * theta[k]
                rate[i, c] += x[k] * slide[k] + y[k] * spin[k]
                rate_derivative[i, c] += x[k] * slide_rate[k] + y[k] * spin_rate[k]


@kernel
def _rotation_from_a_to_b(
    rotation: int,
    Ra: np.ndarray,
    Rb: np.ndarray,
    ka: np.ndarray,
    kb: np.ndarray,
    theta: np.ndarray,
) -> None:
    """Write the rotation vector (world) that a loop must close: none, of its axis, or all."""
    for k in range(3):
        theta[k] = 0.0
    if rotation == 0:
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
        theta[0] = np.pi  # turned over: any axis leads away from there
