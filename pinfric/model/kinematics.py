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
def _normalize(a: np.ndarray) -> float:
    """Write a / |a|, NaN where it has no direction; return |a|."""
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
def _action(
    kind: int,
    unit: np.ndarray,
    joint_a: int,
    frame_p: np.ndarray,
    frame_R: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
    at: np.ndarray,
    Rb: np.ndarray,
    force: np.ndarray,
    moment: np.ndarray,
) -> None:
    """Write force and moment (world) of one action of a on b at b's origin.

    Args:
        kind, unit: of its pair and column in `Linkage`.
        joint_a, frame_p, frame_R: frame a.
        p, R: (nj, 3), (nj, 3, 3) of the links.
        at, Rb: where b is, and how it is turned.
        force, moment: (3,), overwritten.
    """
    if kind == 1:  # cylinder: b is pushed away from a
        _point(joint_a, frame_p, p, R, force)
        for k in range(3):
            force[k], moment[k] = at[k] - force[k], 0.0
        _normalize(force)
        return
    _turn(Rb, unit[:3], force)
    _turn(Rb, unit[3:], moment)
    if kind == 3 and unit[3] ** 2 + unit[4] ** 2 + unit[5] ** 2 > 0.0:  # about the common normal
        Ra, first = np.empty((3, 3)), np.empty(3)
        _orientation(joint_a, frame_R, R, Ra)
        _turn(Ra, unit[3:], first)
        second = moment.copy()
        _cross(first, second, moment)
        _normalize(moment)


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
    at, Rb = np.empty(3), np.empty((3, 3))
    force, moment, here, turned = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    arm = np.empty(3)
    X[:] = 0.0
    J[:] = 0.0
    for i in range(p.shape[0]):
        for c in range(column_pair.size):
            pair = column_pair[c]
            b = frame_joint[pair, 1]
            _point(b, frame_p[pair, 1], p[i], R[i], at)
            _orientation(b, frame_R[pair, 1], R[i], Rb)
            _action(pair_kind[pair], unit[c], frame_joint[pair, 0], frame_p[pair, 0],
                    frame_R[pair, 0], p[i], R[i], at, Rb, force, moment)  # fmt: skip
            if pair_kind[pair] in (0, 3, 4):  # a loop
                for k in range(6):
                    X[i, nj + pair, k, c] = unit[c, k]
            if pair_kind[pair] == 3:  # its common normal, in frame b
                for k in range(3):
                    X[i, nj + pair, 3 + k, c] = 0.0
                    for r in range(3):
                        X[i, nj + pair, 3 + k, c] += Rb[r, k] * moment[r]
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
    at, motion, slip = np.empty((2, 3)), np.empty((2, 4, 3)), np.empty((4, 3))
    Ra, Rb = np.empty((3, 3)), np.empty((3, 3))
    r, x, y, theta, three = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    ka, kb = np.empty(3), np.empty(3)
    for i in range(p.shape[0]):
        done = -1
        for c in range(column_pair.size):
            pair = column_pair[c]
            if pair != done:
                done = pair
                for side in range(2):
                    joint = frame_joint[pair, side]
                    _point(joint, frame_p[pair, side], p[i], R[i], at[side])
                    _move_point(joint, at[side], p[i], velocity[i], acceleration[i], motion[side])
                _orientation(frame_joint[pair, 0], frame_R[pair, 0], R[i], Ra)
                _orientation(frame_joint[pair, 1], frame_R[pair, 1], R[i], Rb)
                for k in range(3):
                    r[k] = at[1, k] - at[0, k]
                _slip(r, motion, slip)
                _turn(Ra, pair_axis[pair], ka)
                _turn(Rb, pair_axis[pair], kb)
                _rotation_from_a_to_b(rotation[pair], Ra, Rb, ka, kb, theta)
                if pair_kind[pair] == 4:  # what lies along the axis is no gap
                    along = ka[0] * r[0] + ka[1] * r[1] + ka[2] * r[2]
                    for k in range(3):
                        r[k] -= along * ka[k]
                tilt[i, pair] = _angle(ka, kb, x)
                _term_sizes(motion, scale[i, pair])
            if pair_kind[pair] == 1:
                _length(r, motion, three)
                gap[i, c], rate[i, c], rate_derivative[i, c] = three[0], three[1], three[2]
                continue
            _turn(Rb, unit[c, :3], x)
            _turn(Rb, unit[c, 3:], y)
            if pair_kind[pair] == 3 and y[0] ** 2 + y[1] ** 2 + y[2] ** 2 > 0.0:
                _turn_about_normal(ka, kb, motion, three)
                gap[i, c], rate[i, c], rate_derivative[i, c] = three[0], three[1], three[2]
                continue
            gap[i, c] = rate[i, c] = rate_derivative[i, c] = 0.0
            for k in range(3):
                gap[i, c] += x[k] * r[k] + y[k] * theta[k]
                rate[i, c] += x[k] * slip[0, k] + y[k] * slip[2, k]
                rate_derivative[i, c] += x[k] * slip[1, k] + y[k] * slip[3, k]


@kernel
def _move_point(
    joint: int,
    at: np.ndarray,
    p: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    motion: np.ndarray,
) -> None:
    """Write how a point of a link moves (4, 3): v, its derivative, omega, its derivative."""
    for k in range(3):
        motion[0, k] = motion[1, k] = motion[2, k] = motion[3, k] = 0.0
    if joint < 0:
        return
    r, x, y, z = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        motion[2, k] = velocity[joint, 3 + k]
        motion[3, k] = acceleration[joint, 3 + k]
        r[k] = at[k] - p[joint, k]
    _cross(motion[2], r, x)
    _cross(motion[2], x, y)
    _cross(motion[3], r, z)
    for k in range(3):
        motion[0, k] = velocity[joint, k] + x[k]
        motion[1, k] = acceleration[joint, k] + y[k] + z[k]


@kernel
def _slip(r: np.ndarray, motion: np.ndarray, slip: np.ndarray) -> None:
    """Write how b moves relative to what of a is at the same place, and the derivative in frame b.

    Args:
        r: (3,) from a to b.
        motion: (2, 4, 3), `_move_point` of both.
        slip: (4, 3), overwritten: velocity and its derivative, angular velocity and its derivative.
    """
    x, y, z = np.empty(3), np.empty(3), np.empty(3)
    _cross(motion[0, 2], r, x)
    _cross(motion[0, 3], r, y)
    for k in range(3):
        z[k] = motion[1, 0, k] - motion[0, 0, k]
        slip[0, k] = z[k] - x[k]
        slip[1, k] = motion[1, 1, k] - motion[0, 1, k] - y[k]
        slip[2, k] = motion[1, 2, k] - motion[0, 2, k]
        slip[3, k] = motion[1, 3, k] - motion[0, 3, k]
    _cross(motion[0, 2], z, x)
    _cross(motion[1, 2], slip[0], y)
    for k in range(3):
        slip[1, k] -= x[k] + y[k]
    _cross(motion[1, 2], slip[2], x)
    for k in range(3):
        slip[3, k] -= x[k]


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
    """Write how far two axes are from perpendicular, and how b turns about their normal n.

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
def _term_sizes(motion: np.ndarray, scale: np.ndarray) -> None:
    """Write the size (2,) of the terms that a rate and its derivative are the difference of."""
    scale[0] = scale[1] = 0.0
    for side in range(2):
        for k in range(3):
            scale[0] += abs(motion[side, 0, k]) + abs(motion[side, 2, k])
            scale[1] += abs(motion[side, 1, k]) + abs(motion[side, 3, k])
            scale[1] += motion[side, 2, k] * motion[side, 2, k]


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
        theta[0] = np.pi  # turned over: any axis leads away from there
