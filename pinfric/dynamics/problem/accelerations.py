"""Accelerations as affine functions of friction: the equation of motion solved at one state.

    M a + h = S u + J_c^T lambda + D x,     J_c a + gamma = 0       (paper eq. 1-7)
    a = a_closure + Z (Z^T M Z)^-1 Z^T (push + D^T x),     push = S u - h - M a_closure
    r = D a + dD/dt v = rate_free + rate_slope x,     rate_slope = D Z (Z^T M Z)^-1 Z^T D^T

Z are the motions that loops allow; for a tree Z = 1 and a_closure = 0.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.problem.affine import solve_balance
from pinfric.dynamics.problem.gearing import add_armature, write_delivered, write_gears
from pinfric.dynamics.problem.machine import Machine
from pinfric.dynamics.problem.rates import write_mass_matrix
from pinfric.friction.dense import factorize
from pinfric.kernels.compiled import kernel

#: Outcomes beside 0: all is written.
NOT_FINITE, SINGULAR, TOGGLE = 1, 2, 3
#: A joint with a share in the mechanism's motion below this is at its dead centre.
_IDLE = 1e-4
#: A share below this counts as zero, as singular values do (`balance.RANK`): rates divided by it
#: would be rounding.
_DEAD = 1e-9


@kernel
def _reduce(machine: Machine, d: int, closed: bool) -> bool:  # noqa: C901
    """Write accelerations and the factor A of D a_slope = A^T A; False: M is singular.

    Args:
        d: number of freedoms.
        closed: whether loops leave fewer than nv of them; else Z is 1.
    """
    w, D = machine.maps, machine.kinematics.D
    M, Z, push, a_closure, a_map = w.M, w.Z, w.push, w.a_closure, w.acceleration
    nv, nc = M.shape[0], D.shape[0]
    L, Y = machine.scratch.lower, machine.scratch.right
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
    if not factorize(L):
        return False
    substitute(L, Y, w.factor)
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
def substitute(L: np.ndarray, Y: np.ndarray, factor: np.ndarray) -> None:
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
def _write_problem_rates(machine: Machine, v: np.ndarray, step: float) -> None:
    """Write r = D a + Ddot v, or of a step D (v + step a), and its slope.

    Args:
        v: (nv,).
        step: s, or 0.
    """
    w, k, p = machine.maps, machine.kinematics, machine.problem
    D, a_map, factor, terms, d = k.D, w.acceleration, w.factor, w.push_terms, w.freedoms[0]
    action, rate_derivative = machine.plan.coordinates.action, k.rate_derivative
    rate_free, rate_scale, rate_slope = p.rate_free, p.rate_scale, p.rate_slope
    nc, nv = D.shape
    scale = step if step > 0.0 else 1.0
    root, dead = np.sqrt(scale), np.zeros(nc, np.bool_)
    if k.tilt.size > 0:  # there are pairs, along which coordinates may depend on each other
        _find_dead_centres(machine, dead)
    for c in range(nc):
        total, offset, size = 0.0, 0.0, 0.0
        for i in range(nv):
            size += scale * terms[i] * abs(a_map[i, 1 + c])
            if D[c, i] != 0.0:
                total += D[c, i] * (w.a_closure[i] if dead[c] else a_map[i, 0])
                if step > 0.0:
                    offset += D[c, i] * v[i]
                    size += abs(D[c, i] * v[i])
        if step == 0.0 and action[c] >= 0:
            offset = rate_derivative[0, action[c]]
            size += abs(offset)
        rate_free[c], rate_scale[c] = scale * total + offset, size
        for f in range(d):
            factor[f, c] *= root
    for c in range(nc):
        for e in range(c + 1):
            total = 0.0
            for f in range(d):
                total += factor[f, c] * factor[f, e]
            rate_slope[c, e] = rate_slope[e, c] = total


@kernel
def _find_dead_centres(machine: Machine, dead: np.ndarray) -> None:
    """Mark joints that stand still while the mechanism moves, in `dead` (nc,); their slope is 0."""
    D, w, size_of = machine.kinematics.D, machine.maps, machine.plan.coordinates.direction_size
    Z, factor, d = w.Z, w.factor, w.freedoms[0]
    nc, nv = D.shape
    most = 0.0
    for i in range(nv):
        for f in range(d):
            most = max(most, abs(Z[i, f]))
    for c in range(nc):
        share, size = 0.0, size_of[c]
        for f in range(d):
            total = 0.0
            for i in range(nv):
                total += D[c, i] * Z[i, f]
            share = max(share, abs(total))
        for i in range(nv):
            size = max(size, abs(D[c, i]))
        w.idle[c] = share <= _IDLE * size * most
        dead[c] = share <= _DEAD * size * most
        if dead[c]:
            for f in range(d):
                factor[f, c] = 0.0


@kernel
def _write_given(machine: Machine) -> None:
    """Write S u, the generalized effort of the drives."""
    given, S = machine.scratch.given, machine.kinematics.S
    for i in range(given.size):
        given[i] = 0.0
    for d in range(S.shape[0]):
        for i in range(given.size):
            given[i] += S[d, i] * machine.rotors.arriving[d]


@kernel
def _add_drag(machine: Machine, step: float) -> None:
    """Let drag d act at the end of the step, d + c (v' - v): M + step D^T c D, given - D^T d.

    c is the secant d/|v| or half the slope of drag, whichever is larger. The secant prevents drag
    from reversing a motion. Half the slope makes speeds converge to the balance of drag and drive
    at any step: near it a step multiplies an error by 1 - slope step / (M + c step).
    """
    M, drag, damping = machine.maps.M, machine.maps.drag, machine.maps.damping
    D, given = machine.kinematics.D, machine.scratch.given
    nc, nv = D.shape
    for c in range(nc):
        if damping[c] == 0.0:
            continue
        for i in range(nv):
            if D[c, i] != 0.0:
                given[i] -= D[c, i] * drag[c]
                for j in range(nv):
                    M[i, j] += step * D[c, i] * damping[c] * D[c, j]


@kernel
def _close(machine: Machine, v: np.ndarray, step: float) -> int:
    """Write Z and a_closure, return J's rank; of a step, such that loops' rates end as zero.

    Full pivoting chooses dependent and independent velocities (paper eq. 5, 6).
    """
    t, w, k, nv = machine.plan.closure, machine.maps, machine.kinematics, v.size
    A = np.empty((t.multipliers, nv + 1))
    for r in range(t.multipliers):
        row = t.off_joint + r
        A[r, nv] = 0.0 if step > 0.0 else -k.rate_derivative[0, row]
        for i in range(nv):
            A[r, i] = k.J[0, row, i]
            if step > 0.0:
                A[r, nv] -= A[r, i] * v[i] / step
    return solve_balance(A, t.scale, w.a_closure.reshape((nv, 1)), w.Z)


@kernel
def write_accelerations(
    machine: Machine, q: np.ndarray, v: np.ndarray, effort: np.ndarray, step: float
) -> int:
    """Write accelerations and relative accelerations as maps of friction.

    Args, returns: see `instant.assemble`. Rates and laws must be written.
    """
    t, w = machine.plan.closure, machine.maps
    M, h, given, terms, push = w.M, machine.supply.h, machine.scratch.given, w.push_terms, w.push
    nv, closed, rank = v.size, t.multipliers > 0, 0
    motors = machine.plan.drives.gears.ratio.size > 0
    if motors:
        write_gears(machine, v, effort, step)
    else:
        machine.rotors.arriving[:] = effort
    _write_given(machine)
    write_mass_matrix(machine)
    if motors:
        add_armature(machine)
    if step > 0.0:
        _add_drag(machine, step)
    if closed:
        rank = _close(machine, v, step)
    w.freedoms[0] = nv - rank
    if closed and rank < nv - t.freedoms:
        return TOGGLE
    size = np.abs(q).sum()
    for i in range(nv):
        terms[i] = abs(given[i]) + abs(h[i])
        push[i] = given[i] = given[i] - h[i]
        if closed:
            for j in range(nv):
                push[i] -= M[i, j] * w.a_closure[j]
        size += abs(push[i]) + abs(v[i])
    if not _reduce(machine, nv - rank, closed):
        for i in range(nv):
            for j in range(nv):
                size += abs(M[i, j])
        return SINGULAR if size < np.inf else NOT_FINITE
    if not size < np.inf:
        return NOT_FINITE
    write_delivered(machine)
    _write_problem_rates(machine, v, step)
    return 0
