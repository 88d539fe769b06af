"""From a state to its coupled friction problem: all of an instant, affine in what is unknown.

    M a + h = S u + J_c^T lambda + D x,     J_c a + gamma = 0,
    w_j = f_j + W_j a + X_j [u off the joints; lambda; x of loops]       (paper eq. 1-7, 16, 17)

M, h, the bias wrenches f, poses and composite inertias are Pinocchio's. Column i of W_j is the
composite inertia of what both joints carry times the motion of freedom i (Featherstone, Rigid Body
Dynamics Algorithms, 6.2), so no difference against gravity is taken. Friction x is what is left:
a = a[:, 0] + a[:, 1:] x, and so on for wrenches, multipliers and contact forces. A tree is a
linkage without closures.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.gearing import (
    FEW_PASSES,
    MOST_PASSES,
    add_armature,
    face_gears,
    guess_delivered,
    refit,
    write_delivered,
    write_efforts,
    write_lines,
)
from pinfric.dynamics.problem.machine import Machine, Supply, Tables, Work
from pinfric.friction.consistency import site_friction, try_modes
from pinfric.friction.dense import affine, eliminate_full_pivot, factorize, solve_dense
from pinfric.friction.law import slip_law, stick_limits
from pinfric.kernels.compiled import kernel
from pinfric.model.kinematics import act_on_joints, relate_pairs
from pinfric.model.laws import law_at

Vector6 = tuple[float, float, float, float, float, float]
#: Which modes `solve_instant` tries: those of the velocities; those in `Work`; the same, but balls
#: face their motion; those in `Work`, of the state that was assembled last. What has no dry
#: friction faces its motion in any case.
FREE, GIVEN, TURNED, SETTLED = range(4)
#: Outcomes of `solve_instant`, beside 0: all is written.
NOT_FINITE, SINGULAR, TOGGLE, UNDECIDED = 1, 2, 3, 4
#: A joint whose share in the mechanism's motion is this small stands at its dead centre.
_IDLE = 1e-4
#: So small a share is none.
_DEAD = 1e-13
_EPS = float(np.finfo(float).eps)
#: So many times its inertia something moves little.
_HELD = 1e9


# ---------------------------------------------------------------- kinematics


@kernel
def _carry(t: Tables, k: Supply, j: int, s: Vector6) -> Vector6:
    """Return the momentum of what joint j carries if it moves by s, about the world's origin."""
    m, x, y, z = t.mass[j], k.lever[1 + j, 0], k.lever[1 + j, 1], k.lever[1 + j, 2]
    vx, vy, vz, wx, wy, wz = s
    fx, fy, fz = m * (vx + wy * z - wz * y), m * (vy + wz * x - wx * z), m * (vz + wx * y - wy * x)
    xx, xy, yy = k.inertia[1 + j, 0], k.inertia[1 + j, 1], k.inertia[1 + j, 2]
    xz, yz, zz = k.inertia[1 + j, 3], k.inertia[1 + j, 4], k.inertia[1 + j, 5]
    return (
        fx,
        fy,
        fz,
        xx * wx + xy * wy + xz * wz + y * fz - z * fy,
        xy * wx + yy * wy + yz * wz + z * fx - x * fz,
        xz * wx + yz * wy + zz * wz + x * fy - y * fx,
    )


@kernel
def _move_freedoms(t: Tables, k: Supply, w: Work) -> None:
    """Write motion and momentum of every freedom."""
    R, p, S, A = k.R[1:], k.p[1:], w.motion, w.momentum
    axis, first = t.freedom_axis, t.first_freedom
    for j in range(t.parent.size):
        for f in range(first[j], first[j + 1]):
            for r in range(3):
                S[f, r] = S[f, 3 + r] = 0.0
                for c in range(3):
                    S[f, r] += R[j, r, c] * axis[f, c]
                    S[f, 3 + r] += R[j, r, c] * axis[f, 3 + c]
            S[f, 0] += p[j, 1] * S[f, 5] - p[j, 2] * S[f, 4]
            S[f, 1] += p[j, 2] * S[f, 3] - p[j, 0] * S[f, 5]
            S[f, 2] += p[j, 0] * S[f, 4] - p[j, 1] * S[f, 3]
            s = S[f, 0], S[f, 1], S[f, 2], S[f, 3], S[f, 4], S[f, 5]
            A[f, 0], A[f, 1], A[f, 2], A[f, 3], A[f, 4], A[f, 5] = _carry(t, k, j, s)


@kernel
def _write_mass_matrix(t: Tables, w: Work) -> None:
    """Write M = S^T I S + armature.

    Not `data.M`: `crba` takes for granted that joints are numbered depth first, which models made
    in Python need not be.
    """
    M, S, A, first, velocity = w.M, w.motion, w.momentum, t.first_freedom, t.freedom_v
    for i in range(M.shape[0]):
        for j in range(M.shape[0]):
            M[i, j] = t.armature[i] if i == j else 0.0
    for j in range(t.parent.size):
        for g in range(first[j], first[j + 1]):
            i = j
            while i >= 0:
                for f in range(first[i], min(first[i + 1], g + 1)):
                    total = 0.0
                    for e in range(6):
                        total += S[f, e] * A[g, e]
                    total *= t.freedom_ratio[f] * t.freedom_ratio[g]
                    M[velocity[f], velocity[g]] += total
                    if f != g:
                        M[velocity[g], velocity[f]] += total
                i = t.parent[i]


@kernel
def _relate_frames(t: Tables, k: Supply, w: Work) -> None:
    """Write how the frames of all pairs are related, at a = 0."""
    R, p, velocity, acceleration, gravity = w.R, w.p, w.velocity, w.acceleration, t.gravity
    v, a = k.velocity[1:], k.acceleration[1:]
    for j in range(t.mass.size):
        for r in range(3):
            p[0, j, r] = k.p[1 + j, r]
            for c in range(3):
                R[0, j, r, c] = k.R[1 + j, r, c]
        # spatial accelerations become those of the frame's origin
        ax = a[j, 0] + v[j, 4] * v[j, 2] - v[j, 5] * v[j, 1]
        ay = a[j, 1] + v[j, 5] * v[j, 0] - v[j, 3] * v[j, 2]
        az = a[j, 2] + v[j, 3] * v[j, 1] - v[j, 4] * v[j, 0]
        for r in range(3):
            x, y, z = R[0, j, r, 0], R[0, j, r, 1], R[0, j, r, 2]
            velocity[0, j, r] = x * v[j, 0] + y * v[j, 1] + z * v[j, 2]
            velocity[0, j, 3 + r] = x * v[j, 3] + y * v[j, 4] + z * v[j, 5]
            acceleration[0, j, r] = x * ax + y * ay + z * az + gravity[r]
            acceleration[0, j, 3 + r] = x * a[j, 3] + y * a[j, 4] + z * a[j, 5]
    relate_pairs(
        p, R, velocity, acceleration, t.actions, w.gap, w.rate, w.rate_derivative, w.tilt, w.terms
    )


@kernel
def _move_pairs(t: Tables, k: Supply, w: Work) -> None:
    """Write how the frames of all pairs are related, and what actions do to joints."""
    if w.tilt.size > 0:
        _relate_frames(t, k, w)
        act_on_joints(w.p, w.R, t.actions, w.X, w.J)


@kernel
def measure_rates(machine: Machine, v: np.ndarray) -> None:
    """Write the relative velocity of every coordinate, of which poses and velocities are known."""
    t, w = machine.tables, machine.work
    layout = t.layout
    _relate_frames(t, machine.supply, w)
    for c in range(w.coordinate_rate.size):
        action = layout.coordinate_action[c]
        w.coordinate_rate[c] = w.rate[0, action] if action >= 0 else 0.0
        for i in range(v.size if action < 0 else 0):
            w.coordinate_rate[c] += w.D[c, i] * v[i]


@kernel
def is_normalized(first: np.ndarray, count: np.ndarray, q: np.ndarray) -> bool:
    """Whether the parts of q that begin at `first` and are `count` long have length 1."""
    for n in range(first.size):
        square = 0.0
        for i in range(first[n], first[n] + count[n]):
            square += q[i] * q[i]
        if not abs(square - 1.0) < 1e-14:
            return False
    return True


@kernel
def is_exact(machine: Machine, q: np.ndarray) -> bool:
    """Whether q is normalized and obeys the loops, of which `w` holds gaps and rates, closely.

    To 1e-8 of a loop's size and speed; `closure.check_closed` says what is wrong with others.
    """
    t, w = machine.tables, machine.work
    layout = t.layout
    if not is_normalized(t.unit_q, t.unit_count, q):
        return False
    for r in range(layout.off_joint, layout.off_joint + t.multipliers):
        pair = t.actions.column_pair[r]
        if not abs(w.gap[0, r]) < 1e-8 * layout.scale:
            return False
        if not abs(w.rate[0, r]) <= 1e-8 * w.terms[0, pair, 0]:
            return False
        if not w.tilt[0, pair] < 1e-8 and t.planar[pair]:
            return False
    return True


@kernel
def _write_rates(t: Tables, w: Work, v: np.ndarray) -> None:
    """Write D, S and the relative velocity of every coordinate."""
    layout = t.layout
    D, S, J, rate = w.D, w.S, w.J, w.coordinate_rate
    action = layout.coordinate_action
    for c in range(action.size):
        rate[c] = 0.0
        for i in range(v.size):
            if action[c] >= 0:
                D[c, i] = J[0, action[c], i]
            rate[c] += D[c, i] * v[i]
    for d in range(layout.drive_action.size):
        if layout.drive_action[d] >= 0:
            for i in range(v.size):
                S[d, i] = J[0, layout.drive_action[d], i]


@kernel
def _write_laws(t: Tables, w: Work, step: float) -> None:
    """Write the law of every entry at its present speed (see `laws`).

    Of a time step, what vanishes at rest goes into `drag` and `damping` (see `_add_drag`) in place
    of the entries' laws, under the loads of the last solution.
    """
    layout, p = t.layout, w.problem
    laws, rate = layout.laws, w.coordinate_rate
    for c in range(rate.size):
        w.drag[c] = w.damping[c] = 0.0
    for e in range(layout.entry_coordinate.size):
        c, ratio = layout.entry_coordinate[e], p.ratio[e]
        velocity = ratio * rate[c]
        speed = _ball_speed(t, rate, c) if layout.ball[c] else abs(velocity)
        towards = velocity / speed if speed > 0.0 else 0.0  # a ball's drag lies along its velocity
        law = law_at(laws, layout.entry_site[e], np.copysign(speed, velocity), step > 0.0)
        p.mu_stick[e] = law.static_mu
        p.coulomb_stick[e, 0], p.coulomb_stick[e, 1] = law.static_forward, law.static_backward
        p.coulomb_slip[e, 0], p.coulomb_slip[e, 1] = law.forward, law.backward
        if step == 0.0:
            p.mu_slip[e] = law.mu + law.drag_mu
            p.drag[e] = law.viscous * velocity + law.drag * towards
            continue
        load = w.modes.load[e] if law.drag_mu > 0.0 else 0.0
        drag, slope = law.drag + law.drag_mu * load, law.drag_slope + law.drag_mu_slope * load
        p.mu_slip[e], p.drag[e] = law.mu, 0.0
        w.drag[c] += ratio * (law.viscous * velocity + drag * towards)
        w.damping[c] += ratio * ratio * law.viscous
        if drag > 0.0:
            w.damping[c] += ratio * ratio * max(drag / speed, 0.5 * slope)


@kernel
def _ball_speed(t: Tables, rate: np.ndarray, c: int) -> float:
    """The angular speed of the ball that coordinate c belongs to."""
    first = t.layout.block[c]
    return np.sqrt(rate[first] ** 2 + rate[first + 1] ** 2 + rate[first + 2] ** 2)


@kernel
def relate(machine: Machine, v: np.ndarray) -> None:
    """Write rates, D and S at a state of which only poses and velocities are known."""
    t, k, w = machine.tables, machine.supply, machine.work
    _move_pairs(t, k, w)
    _write_rates(t, w, v)


# ---------------------------------------------------------------- accelerations


@kernel
def closure_basis(
    J: np.ndarray, target: np.ndarray, scale: float, Z: np.ndarray, a_closure: np.ndarray
) -> int:
    """Write the motions that loops allow and one acceleration with J a = target; return J's rank.

    Full pivoting chooses dependent and independent velocities (paper eq. 5, 6).

    Args:
        J, target: (nl, nv), (nl,).
        scale: pivots small beside it are zero.
        Z: (nv, nv), overwritten; its first nv - rank columns count.
        a_closure: (nv,), overwritten.
    """
    nl, nv = J.shape
    A, order = np.empty((nl, nv + 1)), np.empty(nv, np.int64)
    for r in range(nl):
        for i in range(nv):
            A[r, i] = J[r, i]
        A[r, nv] = target[r]
    rank = eliminate_full_pivot(A, nv, order, scale)
    for c in range(nv):
        for f in range(nv):
            Z[c, f] = 0.0
    for f in range(nv - rank):
        Z[order[rank + f], f] = 1.0
    for c in range(nv):
        a_closure[order[c]] = A[c, nv] if c < rank else 0.0
        if c < rank:
            for f in range(nv - rank):
                Z[order[c], f] = -A[c, rank + f]
    return rank


@kernel
def _reduce(w: Work, given: np.ndarray, d: int, closed: bool) -> bool:
    """Write a_map and the factor A of D a_slope = A^T A; False: M is singular.

    a = a_closure + Z (Z^T M Z)^-1 Z^T (push + D^T x),     push = S u - h - M a_closure

    Args:
        given: (na,) what drives are given.
        d: number of freedoms.
        closed: whether loops leave fewer than nv of them; else Z is 1.
    """
    push, a_closure = w.push, w.a_closure
    M, Z, D, factor, a_map = w.M, w.Z, w.D, w.factor, w.a_map
    nv, nc = M.shape[0], D.shape[0]
    L, Y = w.lower, w.right
    if not closed:
        for i in range(nv):
            Y[i, 0] = push[i]
            for j in range(nv):
                L[i, j] = M[i, j]
            for c in range(nc):
                Y[i, 1 + c] = D[c, i]
    else:
        L, Y, MZ = np.zeros((d, d)), np.zeros((d, 1 + nc)), np.zeros((nv, d))
        for i in range(nv):
            for j in range(nv):
                for f in range(d):
                    MZ[i, f] += M[i, j] * Z[j, f]
        for i in range(nv):
            for f in range(d):
                for g in range(d):
                    L[f, g] += Z[i, f] * MZ[i, g]
                Y[f, 0] += Z[i, f] * push[i]
                for c in range(nc):
                    Y[f, 1 + c] += Z[i, f] * D[c, i]
    if w.locking[0] > 0:
        if not _reduce_locking(w, given, L, Y, closed):
            return False
    elif factorize(L):
        _substitute(L, Y, factor)
    else:
        return False
    for i in range(nv):
        for k in range(1 + nc):
            a_map[i, k] = a_closure[i] if k == 0 else 0.0
            if not closed:
                a_map[i, k] += Y[i, k]
        if closed:
            for f in range(d):
                for k in range(1 + nc):
                    a_map[i, k] += Z[i, f] * Y[f, k]
    return True


@kernel
def _reduce_locking(w: Work, given: np.ndarray, L: np.ndarray, Y: np.ndarray, closed: bool) -> bool:
    """Solve for the freedoms and for what gears deliver whose lines do not rise; False: singular.

    [L  -Z^T S^T; I S Z  slope] [f; t] = [Y; given - offset - I S a_closure]

    Args:
        given: (na,).
        L, Y: (d, d), (d, 1 + nc); Y is overwritten with f.
        closed: see `_reduce`.
    """
    (d, columns), k = Y.shape, w.locking[0]
    A, B, row = np.zeros((d + k, d + k)), np.zeros((d + k, columns)), d
    A[:d, :d], B[:d] = L, Y
    for g in range(given.size):
        if w.slope[g] > 0.0:
            continue
        A[row, row], B[row, 0] = w.slope[g], given[g] - w.offset[g]
        for i in range(w.S.shape[1]):
            B[row, 0] -= w.reflected[g] * w.S[g, i] * w.a_closure[i]
            for f in range(d):
                share = w.S[g, i] * w.Z[i, f] if closed else w.S[g, i] if i == f else 0.0
                A[f, row] -= share
                A[row, f] += w.reflected[g] * share
        row += 1
    if not solve_dense(A, B):
        return False
    Y[:] = B[:d]
    row = d
    for g in range(given.size):
        if w.slope[g] <= 0.0:
            w.delivered_map[g] = B[row]
            row += 1
    w.factor[:] = 0.0
    return True


@kernel
def _substitute(L: np.ndarray, Y: np.ndarray, factor: np.ndarray) -> None:
    """Overwrite Y (d, 1 + nc) with (L L^T)^-1 Y; factor with L^-1 Y[:, 1:]."""
    d, columns = Y.shape
    for f in range(d):
        for g in range(f):
            for k in range(columns):
                Y[f, k] -= L[f, g] * Y[g, k]
        for k in range(columns):
            Y[f, k] /= L[f, f]
            if k > 0:
                factor[f, k - 1] = Y[f, k]
    for f in range(d - 1, -1, -1):
        for g in range(f + 1, d):
            for k in range(columns):
                Y[f, k] -= L[g, f] * Y[g, k]
        for k in range(columns):
            Y[f, k] /= L[f, f]


@kernel
def _write_problem_rates(
    t: Tables, w: Work, v: np.ndarray, terms: np.ndarray, step: float, related: bool
) -> None:
    """Write r = D a + Ddot v, or of a step D (v + step a), and its slope.

    Args:
        v: (nv,).
        terms: (nv,) size of what `push` is the sum of.
        step: s, or 0.
        related: whether there are pairs, along which coordinates may depend on each other.
    """
    D, a_map, factor, action, d = w.D, w.a_map, w.factor, t.layout.coordinate_action, w.freedoms[0]
    rate_free, rate_scale = w.problem.rate_free, w.problem.rate_scale
    rate_slope = w.problem.rate_slope
    nc, nv = D.shape
    scale = step if step > 0.0 else 1.0
    root = np.sqrt(scale)
    for c in range(nc):
        total, offset, size = 0.0, 0.0, 0.0
        for i in range(nv):
            size += scale * terms[i] * abs(a_map[i, 1 + c])
            if D[c, i] != 0.0:
                total += D[c, i] * a_map[i, 0]
                if step > 0.0:
                    offset += D[c, i] * v[i]
                    size += abs(D[c, i] * v[i])
        if step == 0.0 and action[c] >= 0:
            offset = w.rate_derivative[0, action[c]]
            size += abs(offset)
        rate_free[c], rate_scale[c] = scale * total + offset, size
        for f in range(d):
            factor[f, c] *= root
    if related:
        _find_dead_centres(t, w, d)
    for c in range(nc):
        for e in range(c + 1):
            total = 0.0
            for f in range(d):
                total += factor[f, c] * factor[f, e]
            if w.locking[0] > 0:  # there is no such factor
                for i in range(nv):
                    total += scale * D[c, i] * a_map[i, 1 + e]
            rate_slope[c, e] = rate_slope[e, c] = total


@kernel
def _find_dead_centres(t: Tables, w: Work, d: int) -> None:
    """Mark joints that stand still while the mechanism moves; those at rest get no slope."""
    D, Z, factor = w.D, w.Z, w.factor
    nc, nv = D.shape
    most = 0.0
    for i in range(nv):
        for f in range(d):
            most = max(most, abs(Z[i, f]))
    for c in range(nc):
        share, size = 0.0, t.direction_size[c]
        for f in range(d):
            total = 0.0
            for i in range(nv):
                total += D[c, i] * Z[i, f]
            share = max(share, abs(total))
        for i in range(nv):
            size = max(size, abs(D[c, i]))
        w.idle[c] = share <= _IDLE * size * most
        if share <= _DEAD * size * most:
            for f in range(d):
                factor[f, c] = 0.0


# ---------------------------------------------------------------- multipliers, wrenches, contacts


@kernel
def _balance(t: Tables, w: Work, push: np.ndarray, free: np.ndarray) -> int:
    """Write multipliers as a map of friction, and what may be added to them; return their rank.

    J_c^T lambda = M a + h - S u - D^T x

    Args:
        push: (nv,) S u - h.
        free: (nl, nl), overwritten: its first nl - rank columns (redundant closures).
    """
    layout = t.layout
    J, M, D, a_map, y = w.J, w.M, w.D, w.a_map, w.multiplier_map
    nl, (nc, nv) = t.multipliers, D.shape
    A, order = np.empty((nv, nl + 1 + nc)), np.empty(nl, np.int64)
    for i in range(nv):
        for r in range(nl):
            A[i, r] = J[0, layout.off_joint + r, i]
        for k in range(1 + nc):
            total = -push[i] if k == 0 else -D[k - 1, i]
            for j in range(nv):
                total += M[i, j] * a_map[j, k]
            for d in range(w.slope.size):
                if w.slope[d] <= 0.0:
                    total -= w.S[d, i] * w.delivered_map[d, k]
            A[i, nl + k] = total
    rank = eliminate_full_pivot(A, nl, order, layout.scale)
    for r in range(nl):
        for k in range(1 + nc):
            y[order[r], k] = A[r, nl + k] if r < rank else 0.0
        for f in range(nl):
            free[order[r], f] = 0.0
        if r >= rank:
            free[order[r], r - rank] = 1.0
        else:
            for f in range(nl - rank):
                free[order[r], f] = -A[r, rank + f]
    return rank


@kernel
def _accelerate(t: Tables, w: Work) -> None:
    """Write what W_j a is the sum of, columns as in a_map, about the world's origin.

    The acceleration of joint j's link, and the momenta of the freedoms that it carries.
    """
    above, below, first = w.above, w.below, t.first_freedom
    nj, columns = above.shape[0], above.shape[1]
    for j in range(nj):
        parent = t.parent[j]
        for n in range(columns):
            for e in range(6):
                above[j, n, e] = above[parent, n, e] if parent >= 0 else 0.0
                below[j, n, e] = 0.0
        for f in range(first[j], first[j + 1]):
            for n in range(columns):
                share = t.freedom_ratio[f] * w.a_map[t.freedom_v[f], n]
                for e in range(6):
                    above[j, n, e] += share * w.motion[f, e]
    for j in range(nj - 1, -1, -1):
        parent = t.parent[j]
        if parent < 0:
            continue
        for n in range(columns):
            for e in range(6):
                below[parent, n, e] += below[j, n, e]
        for f in range(first[j], first[j + 1]):
            for n in range(columns):
                share = t.freedom_ratio[f] * w.a_map[t.freedom_v[f], n]
                for e in range(6):
                    below[parent, n, e] += share * w.momentum[f, e]


@kernel
def _write_tree_wrench(t: Tables, k: Supply, w: Work, row: int, j: int) -> None:
    """Write w_j = f_j + W_j a (6, 1 + nc) of a joint of the tree, in its child's frame."""
    R, above, below, G = k.R, w.above, w.below, w.wrench_map
    x, y, z = k.p[1 + j, 0], k.p[1 + j, 1], k.p[1 + j, 2]
    for n in range(G.shape[2]):
        moves = (
            above[j, n, 0],
            above[j, n, 1],
            above[j, n, 2],
            above[j, n, 3],
            above[j, n, 4],
            above[j, n, 5],
        )
        fx, fy, fz, mx, my, mz = _carry(t, k, j, moves)
        fx, fy, fz = fx + below[j, n, 0], fy + below[j, n, 1], fz + below[j, n, 2]
        mx += below[j, n, 3] - y * fz + z * fy
        my += below[j, n, 4] - z * fx + x * fz
        mz += below[j, n, 5] - x * fy + y * fx
        for e in range(3):
            a, b, c = R[1 + j, 0, e], R[1 + j, 1, e], R[1 + j, 2, e]
            G[row, e, n] = a * fx + b * fy + c * fz
            G[row, 3 + e, n] = a * mx + b * my + c * mz
    for e in range(6):
        G[row, e, 0] += k.force[1 + j, e]


@kernel
def _write_wrenches(t: Tables, k: Supply, w: Work) -> None:
    """Write the wrenches wanted as maps of friction, all but the multipliers' part."""
    layout = t.layout
    G, X, nj, action = w.wrench_map, w.X, t.mass.size, layout.coordinate_action
    _accelerate(t, w)
    for row in range(t.wrench_row.size):
        j = t.wrench_row[row]
        if j < nj:
            _write_tree_wrench(t, k, w, row, j)
        else:
            for e in range(6):
                for n in range(G.shape[2]):
                    G[row, e, n] = 0.0
        for d in range(layout.drive_v.size):
            if layout.drive_v[d] < 0:
                for e in range(6):
                    share = X[0, j, e, layout.drive_action[d]]
                    for n in range(G.shape[2]):
                        G[row, e, n] += share * w.delivered_map[d, n]
        for c in range(action.size):
            if action[c] >= 0:
                for e in range(6):
                    G[row, e, 1 + c] += X[0, j, e, action[c]]


@kernel
def share_redundant(
    given: np.ndarray, among: np.ndarray, free: np.ndarray, inverse_length: float, y: np.ndarray
) -> bool:
    """Add to y (ny, columns) what is free of it so that sum |F|^2 + |M/l|^2 is least.

    Over all joints, the loops' too: the choice does not depend on where a loop was cut, and is
    again affine in friction.

    Args:
        given: (n, 6, columns) wrenches of all joints under y as it is.
        among: (n, 6, nx) their change per unit y; the first ny columns count.
        free: (ny, nf) what may be added to y.
        inverse_length: 1/l (1/m).

    Returns:
        False where the least is not unique.
    """
    (ny, nf), columns = free.shape, y.shape[1]
    work, order = np.zeros((nf, nf + columns)), np.empty(nf, np.int64)
    along = np.empty(nf)
    for j in range(given.shape[0]):
        for e in range(6):
            weight = 1.0 if e < 3 else inverse_length * inverse_length
            for f in range(nf):
                along[f] = 0.0
                for c in range(ny):
                    along[f] += among[j, e, c] * free[c, f]
            for f in range(nf):
                for g in range(nf):
                    work[f, g] += weight * along[f] * along[g]
                for n in range(columns):
                    work[f, nf + n] -= weight * along[f] * given[j, e, n]
    if eliminate_full_pivot(work, nf, order, 0.0) < nf:
        return False
    for f in range(nf):
        for n in range(columns):
            for c in range(ny):
                y[c, n] += free[c, order[f]] * work[f, nf + n]
    return True


@kernel
def _add_multipliers(t: Tables, w: Work, push: np.ndarray) -> None:
    """Find the multipliers and add their part to the wrenches."""
    layout = t.layout
    nl, X, G, y = t.multipliers, w.X, w.wrench_map, w.multiplier_map
    free = np.empty((nl, nl))
    rank = _balance(t, w, push, free)
    rows = t.wrench_row.size
    among = np.empty((rows, 6, nl))
    for row in range(rows):
        for e in range(6):
            for r in range(nl):
                among[row, e, r] = X[0, t.wrench_row[row], e, layout.off_joint + r]
    if rank < nl:
        given = G.copy()
        for row in range(rows):
            add_products(among[row], y, given[row])
        share_redundant(
            given[: layout.sharing], among, free[:, : nl - rank].copy(), layout.inverse_length, y
        )
    for row in range(rows):
        add_products(among[row], y, G[row])


@kernel
def add_products(A: np.ndarray, y: np.ndarray, out: np.ndarray) -> None:
    """Add A (6, n) y (ny, columns) to out (6, columns); of A the first ny columns count."""
    for e in range(6):
        for r in range(y.shape[0]):
            if A[e, r] != 0.0:
                for n in range(y.shape[1]):
                    out[e, n] += A[e, r] * y[r, n]


@kernel
def along(row: np.ndarray, wrench: np.ndarray, j: int, n: int) -> float:
    """Return a row (6,) of a contact's map times a wrench's column, wrench[j, :, n]."""
    total = 0.0
    for m in range(6):
        total += row[m] * wrench[j, m, n]
    return total


@kernel
def _write_contacts(t: Tables, w: Work, q: np.ndarray) -> bool:
    """Write contact forces as maps of friction; False: not finite."""
    layout, contact, G, row, total = t.layout, w.problem.contact, w.wrench_map, w.row, 0.0
    for i in range(t.contact_row.size):
        s, j = layout.entry_site[t.contact_site[i]], t.contact_row[i]
        moved = (
            layout.displacement_shift[s]
            + layout.displacement_ratio[s] * q[layout.displacement_q[s]]
        )
        for e in range(t.contact_rank[i]):
            for m in range(6):
                row[m] = t.contact_map[i, e, m] + moved * t.contact_map_moved[i, e, m]
            for n in range(contact.shape[1]):
                contact[i, n, e] = along(row, G, j, n)
                total += abs(contact[i, n, e])
    return total < np.inf


# ---------------------------------------------------------------- one instant


@kernel
def prepare(machine: Machine, v: np.ndarray, effort: np.ndarray, step: float) -> None:
    """Write what a state is whatever gears do: kinematics, rates, laws. See `assemble`."""
    t, k, w = machine.tables, machine.supply, machine.work
    _move_freedoms(t, k, w)
    _move_pairs(t, k, w)
    _write_rates(t, w, v)
    _write_laws(t, w, step)
    w.push_size[0] = np.abs(k.h).sum() + np.abs(effort).sum()


@kernel
def couple(machine: Machine, q: np.ndarray, v: np.ndarray, effort: np.ndarray, step: float) -> int:
    """Write the coupled problem and all maps of a prepared state, with the lines of its gears.

    Args, returns: see `assemble`.
    """
    t, k, w = machine.tables, machine.supply, machine.work
    M, h, nv, nl = w.M, k.h, v.size, t.multipliers
    given, terms, push = w.given, w.size, w.push
    if t.layout.gear_entry.size > 0:
        write_lines(t, w, v, effort, step)
    _write_given(w, effort)
    _write_mass_matrix(t, w)
    w.locking[0] = add_armature(t, w)
    if step > 0.0:
        _add_drag(w, step, given)
    rank = 0
    if nl > 0:
        rank = _close(t, w, v, step)
        if rank < nv - t.layout.freedoms:
            w.freedoms[0] = nv - rank
            return TOGGLE
    size = np.abs(q).sum()
    for i in range(nv):
        terms[i] = abs(given[i]) + abs(h[i])
        push[i] = given[i] - h[i]
        given[i] = push[i]
        if nl > 0:
            for j in range(nv):
                push[i] -= M[i, j] * w.a_closure[j]
        size += abs(push[i]) + abs(v[i])
    w.freedoms[0] = nv - rank
    if not _reduce(w, effort, nv - rank, nl > 0):
        for i in range(nv):
            for j in range(nv):
                size += abs(M[i, j])
        return SINGULAR if size < np.inf else NOT_FINITE
    if not size < np.inf:
        return NOT_FINITE
    write_delivered(w, effort)
    _write_problem_rates(t, w, v, terms, step, w.tilt.size > 0)
    _write_wrenches(t, k, w)
    if nl > 0:
        _add_multipliers(t, w, given)
    return 0 if _write_contacts(t, w, q) else NOT_FINITE


@kernel
def assemble(
    machine: Machine, q: np.ndarray, v: np.ndarray, effort: np.ndarray, step: float
) -> int:
    """Write the coupled problem and all maps at one state.

    Args:
        machine: its `work` is overwritten.
        q, v: (nq,), (nv,).
        effort: (na,) of the drives; where motors drive, r T_m of each.
        step: 0: r is the relative acceleration; else the time step (s) of which r is the relative
            velocity at the end, with viscous friction implicit.

    Returns:
        0, `NOT_FINITE`, `SINGULAR`, or `TOGGLE`: the loops leave more freedoms than elsewhere.
    """
    prepare(machine, v, effort, step)
    face_gears(machine.tables, machine.work)
    return couple(machine, q, v, effort, step)


@kernel
def _write_given(w: Work, effort: np.ndarray) -> None:
    """Write S u, the generalized effort of the drives, along the lines of their gears that rise."""
    given = w.given
    for i in range(given.size):
        given[i] = w.a_closure[i] = 0.0
    for d in range(effort.size):
        if w.slope[d] <= 0.0:
            continue
        on_line = (effort[d] - w.offset[d]) / w.slope[d]
        for i in range(given.size):
            given[i] += w.S[d, i] * on_line


@kernel
def _add_drag(w: Work, step: float, given: np.ndarray) -> None:
    """Let drag d act at the end of the step, d + c (v' - v): M + step D^T c D, given - D^T d.

    c is the secant d/|v| or half the slope of drag, whichever is larger. The secant keeps drag from
    reversing a motion. Half the slope lets speeds tend to where drag and drive balance, however
    long the step: near there a step multiplies an error by 1 - slope step / (M + c step).
    """
    M, D, damping = w.M, w.D, w.damping
    nc, nv = D.shape
    for c in range(nc):
        if damping[c] == 0.0:
            continue
        for i in range(nv):
            if D[c, i] != 0.0:
                given[i] -= D[c, i] * w.drag[c]
                for j in range(nv):
                    M[i, j] += step * D[c, i] * damping[c] * D[c, j]


@kernel
def _close(t: Tables, w: Work, v: np.ndarray, step: float) -> int:
    """Write Z and a_closure; of a step, such that the loops' rates are zero at its end."""
    layout = t.layout
    nl, J = t.multipliers, w.J[0, layout.off_joint : layout.off_joint + t.multipliers]
    target = np.empty(nl)
    for r in range(nl):
        target[r] = -w.rate_derivative[0, layout.off_joint + r]
        if step > 0.0:
            target[r] = 0.0
            for i in range(v.size):
                target[r] -= J[r, i] * v[i] / step
    return closure_basis(J, target, layout.scale, w.Z, w.a_closure)


@kernel
def _face(t: Tables, w: Work) -> int:
    """Set the modes that velocities fix and stick everything at rest; return how many are.

    At no speed at all the direction of what has no dry friction stays as it is.
    """
    layout, m = t.layout, w.modes
    rate, resting = w.coordinate_rate, 0
    for c in range(rate.size):
        speed = _ball_speed(t, rate, c) if layout.ball[c] else abs(rate[c])
        m.at_rest[c] = layout.dry[c] and speed <= layout.stick_velocity[c]
        m.stuck[c] = m.at_rest[c]
        if m.stuck[c]:
            m.direction[c] = 0.0
            resting += 1
        elif speed > 0.0:
            m.direction[c] = rate[c] / speed
        elif not layout.ball[c]:
            m.direction[c] = 0.0
    return resting


@kernel
def _turn(t: Tables, w: Work, balls: bool) -> None:
    """Point the friction of coordinates without dry friction against their motion.

    Args:
        t, w: `modes.direction` is written.
        balls: whether that of balls that slip, too; at no speed it stays.
    """
    rate, m = w.coordinate_rate, w.modes
    for c in range(rate.size):
        if t.layout.ball[c]:
            if not m.stuck[c] and (balls or not t.layout.dry[c]):
                speed = _ball_speed(t, rate, c)
                if speed > 0.0:
                    m.direction[c] = rate[c] / speed
        elif not t.layout.dry[c]:
            m.direction[c] = np.sign(rate[c])


@kernel
def write_accelerations(machine: Machine, a: np.ndarray) -> None:
    """Write accelerations a (nv,) under the friction found.

    Where something sticks, its friction cancels what pushes it. Of the n terms of such a sum each
    comes from m equations: no more than n m eps times their magnitudes is rounding, and set to 0.
    """
    w = machine.work
    a_map, x, m = w.a_map, w.modes.friction, w.modes
    sticks = False
    for c in range(x.size):
        sticks |= m.stuck[c]
    share = (1 + x.size) * a.size * _EPS if sticks else 0.0
    for i in range(a.size):
        total = a_map[i, 0]
        terms = abs(total)
        for c in range(x.size):
            part = a_map[i, 1 + c] * x[c]
            total += part
            terms += abs(part)
        a[i] = total if abs(total) > share * terms else 0.0


@kernel
def finish(machine: Machine) -> None:
    """Write accelerations, wrenches, multipliers and each site's friction from the solution."""
    t, w = machine.tables, machine.work
    layout, x, G, wrench, phi = t.layout, w.modes.friction, w.wrench_map, w.wrench, w.phi
    stuck, direction, ratio = w.modes.stuck, w.modes.direction, w.problem.ratio
    write_accelerations(machine, w.a)
    for c in range(x.size):
        if stuck[c] and layout.coordinate_v[c] >= 0:
            w.a[layout.coordinate_v[c]] = 0.0
    affine(w.multiplier_map, x, w.multiplier)
    stick_limits(w.problem, w.modes.load, w.least, w.most)
    site_friction(w.problem, w.modes, w.least, w.most, w.entry_phi)
    write_efforts(t, w)
    for s in range(phi.size):
        e = layout.first_entry[s]
        c, row = layout.entry_coordinate[e], t.site_row[s]
        w.load[s], phi[s] = w.modes.load[e], w.entry_phi[e]
        w.site_modes[s] = np.sign(direction[c] * ratio[e])
        if layout.ball[c]:
            phi[s] = -np.sqrt(x[c] ** 2 + x[c + 1] ** 2 + x[c + 2] ** 2)
            w.site_modes[s] = 0 if stuck[c] else 1
        for i in range(6):
            wrench[s, i] = G[row, i, 0]
            for n in range(x.size):
                wrench[s, i] += G[row, i, 1 + n] * x[n]


@kernel
def _guess_lines(machine: Machine, v: np.ndarray, effort: np.ndarray) -> None:
    """Choose the lines of gears in a tree by accelerations with the loads of the last solution.

    At a fraction of a pass of `couple`, which then mostly is the only one.
    """
    t, w = machine.tables, machine.work
    L, a, m = w.lower, np.empty((v.size, 1)), w.modes
    gain, x = np.empty(w.problem.constant.size), np.empty(m.stuck.size)
    slip_law(w.problem, m.stuck, m.direction, gain, x)
    for e in range(len(t.layout.entry_site)):
        x[w.problem.coordinate[e]] += gain[e] * m.load[e]
    for _ in range(FEW_PASSES):
        write_lines(t, w, v, effort, 0.0)
        _write_given(w, effort)
        _write_mass_matrix(t, w)
        if add_armature(t, w) > 0:
            return
        for i in range(v.size):
            a[i, 0] = w.given[i] - machine.supply.h[i]
            for j in range(i + 1):
                L[i, j] = w.M[i, j]
        for c in range(m.stuck.size):
            for i in range(v.size):
                a[i, 0] += w.D[c, i] * x[c]
            i = t.layout.coordinate_v[c]
            if m.stuck[c] and i >= 0:
                L[i, i] *= _HELD
        if not factorize(L):
            return
        _substitute(L, a, w.factor)
        if guess_delivered(t, w, effort, a) == 0:
            return


@kernel
def solve_instant(
    machine: Machine, q: np.ndarray, v: np.ndarray, effort: np.ndarray, choice: int, step: float
) -> tuple[int, int, int, int]:
    """Assemble, try the modes with every gear on the line that fits, and finish: one call.

    With modes given, what a gear passes on rises with what arrives at it. So for gears that do not
    lock themselves Newton's method over the lines ends at the one solution.

    Args:
        machine ... effort: see `assemble`.
        choice: `FREE`, `GIVEN` or `TURNED`; or `SETTLED`: the modes in `Work`, of the state that
            was assembled last, and nothing is finished.
        step: see `assemble`; 0 but for `SETTLED`.

    Returns:
        (outcome, number of solutions or -1, how many obey, how many are at rest); the outcome is
        `UNDECIDED` where joints that may share their friction stick: no modes were tried.
    """
    t, w, m = machine.tables, machine.work, machine.work.modes
    resting = 0
    if choice != SETTLED:
        prepare(machine, v, effort, 0.0)
        if choice == FREE:
            resting = _face(t, w)
        else:
            m.at_rest[:] = False
            _turn(t, w, choice == TURNED)
    face_gears(t, w)
    if choice != SETTLED and t.layout.gears.ratio.size > 0 and t.multipliers == 0:
        _guess_lines(machine, v, effort)
    found = obeying = 0
    for passes in range(MOST_PASSES):
        outcome = couple(machine, q, v, effort, step)
        if outcome != 0:
            return outcome, 0, 0, 0
        if t.dependent:
            for c in range(m.stuck.size):
                if m.stuck[c]:
                    return UNDECIDED, 0, 0, resting
        found, obeying = try_modes(w.problem, m)
        if found <= 0 or refit(machine, passes >= FEW_PASSES) == 0:
            break
        if passes == MOST_PASSES - 1:
            found, obeying = -1, 0
    if found <= 0:
        m.friction[:1] = np.nan  # no guess for the next solve
    elif obeying == 1 and choice != SETTLED:
        finish(machine)
    return 0, found, obeying, resting
