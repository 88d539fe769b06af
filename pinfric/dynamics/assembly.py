"""From the twin's batch to the coupled problem, and from its solution to accelerations: kernels.

    M a + h - J_ext^T f_ext = u + D phi   gives   a = a_free + a_slope x,   x the friction

(design 2.1, 2.5). The batch holds the wrenches at (v, a = 0), at rest with a = 0, and at rest with
each unit acceleration; differences at rest are the columns W_a, and M = E^T W_a (at speed the
differences would cancel).
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics import consistency, coupling
from pinfric.dynamics.chained import kernel_calling
from pinfric.dynamics.consistency import settle, site_friction, stick_limits, try_modes
from pinfric.dynamics.problem import Problem
from pinfric.model import laws as laws_module
from pinfric.model.laws import Laws, friction_at

#: Outcomes of the assembly.
NOT_FINITE, SINGULAR = 1, 2
#: Who chooses the modes that are tried: the velocities, or whoever wrote them before.
FREE, GIVEN = 0, 1

kernel = kernel_calling(coupling, consistency, laws_module)


@kernel
def factorize(M: np.ndarray) -> bool:
    """Overwrite the lower triangle of M (n, n) with its Cholesky factor; False: not positive."""
    n = M.shape[0]
    for j in range(n):
        diagonal = M[j, j]
        pivot = diagonal
        for k in range(j):
            pivot -= M[j, k] * M[j, k]
        if not pivot > 1e-14 * diagonal:
            return False
        root = np.sqrt(pivot)
        M[j, j] = root
        for i in range(j + 1, n):
            total = M[i, j]
            for k in range(j):
                total -= M[i, k] * M[j, k]
            M[i, j] = total / root
    return True


@kernel
def substitute(L: np.ndarray, b: np.ndarray) -> None:
    """Overwrite b (n,) with (L L^T)^-1 b."""
    n = b.size
    for i in range(n):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] /= L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= L[k, i] * b[k]
        b[i] /= L[i, i]


@kernel
def write_laws(
    v: np.ndarray, laws: Laws, coordinate_v: np.ndarray, problem: Problem, implicit: bool
) -> None:
    """Write the friction coefficients of every site at its present speed (see `laws`)."""
    for s in range(problem.ratio.size):
        velocity = problem.ratio[s] * v[coordinate_v[problem.coordinate[s]]]
        moving = friction_at(laws, s, abs(velocity))
        problem.mu_stick[s] = laws.mu_static[s]
        problem.mu_slip[s] = moving.mu + moving.drag_mu
        for side in range(2):
            problem.coulomb_stick[s, side] = laws.coulomb_static[s, side]
        problem.coulomb_slip[s, 0] = moving.forward
        problem.coulomb_slip[s, 1] = moving.backward
        problem.drag[s] = 0.0 if implicit else laws.viscous[s] * velocity
        if velocity > 0.0:
            problem.drag[s] += moving.drag_forward
        else:
            problem.drag[s] -= moving.drag_backward


@kernel
def assemble(
    q: np.ndarray,
    v: np.ndarray,
    effort: np.ndarray,
    step: float,
    batch: np.ndarray,
    rows: np.ndarray,
    armature: np.ndarray,
    joint: np.ndarray,
    laws: Laws,
    coordinate_v: np.ndarray,
    wrench_map: np.ndarray,
    wrench_map_moved: np.ndarray,
    displacement_q: np.ndarray,
    displacement_ratio: np.ndarray,
    displacement_shift: np.ndarray,
    M: np.ndarray,
    a_free: np.ndarray,
    a_slope: np.ndarray,
    problem: Problem,
) -> int:
    """Write a = a_free + a_slope x and the coupled problem from one batch (design 2.1).

    Args:
        q, v, effort, step: see `Workspace.assemble`.
        batch: (nv + 2, nj, 6), wrenches: at (v, a = 0), at rest with a = 0, with unit a.
        rows: (nv + 2, nv), E^T of it: h, gravity, and gravity plus the columns of M.
        armature: (nv,).
        joint ... displacement_shift: see `Tables`.
        M: (nv, nv), overwritten with its Cholesky factor.
        a_free, a_slope, problem: overwritten.

    Returns:
        0, `NOT_FINITE` or `SINGULAR`.
    """
    nv, nc, ns = v.size, coordinate_v.size, joint.size
    write_laws(v, laws, coordinate_v, problem, step > 0.0)
    for i in range(nv):
        for j in range(nv):
            M[i, j] = rows[2 + i, j] - rows[1, j]
        M[i, i] += armature[i]
        a_free[i] = effort[i] - rows[0, i]
        for c in range(nc):
            a_slope[i, c] = 1.0 if coordinate_v[c] == i else 0.0
    if step > 0.0:
        for s in range(ns):
            i = coordinate_v[problem.coordinate[s]]
            viscous = problem.ratio[s] * problem.ratio[s] * laws.viscous[s]
            M[i, i] += step * viscous
            a_free[i] -= viscous * v[i]
    if not factorize(M):
        for i in range(nv):
            for j in range(nv):
                if not abs(rows[2 + i, j]) < np.inf:
                    return NOT_FINITE
        return SINGULAR
    substitute(M, a_free)
    size = 0.0
    for i in range(nv):
        size += abs(a_free[i])
    if not size < np.inf:
        return NOT_FINITE
    column = np.empty(nv)
    for c in range(nc):
        for i in range(nv):
            column[i] = a_slope[i, c]
        substitute(M, column)
        for i in range(nv):
            a_slope[i, c] = column[i]
    # r: the coordinate's row of a, or of v + step a
    scale = step if step > 0.0 else 1.0
    for c in range(nc):
        i = coordinate_v[c]
        problem.rate_free[c] = scale * a_free[i] + (v[i] if step > 0.0 else 0.0)
        size = abs(v[i]) if step > 0.0 else 0.0
        for j in range(nv):
            size += scale * abs(a_slope[j, c]) * (abs(effort[j]) + abs(rows[0, j]))
        problem.rate_scale[c] = size
        for d in range(nc):
            problem.rate_slope[d, c] = scale * a_slope[coordinate_v[d], c]
    mapped, slopes = np.empty(6), np.empty(nc)
    for t in range(problem.contact_site.size):
        s = problem.contact_site[t]
        j = joint[s]
        moved = displacement_shift[s] + displacement_ratio[s] * q[displacement_q[s]]
        for e in range(3):
            free, rest = 0.0, 0.0
            for k in range(6):
                mapped[k] = wrench_map[t, e, k] + moved * wrench_map_moved[t, e, k]
                free += mapped[k] * batch[0, j, k]
                rest += mapped[k] * batch[1, j, k]
            for c in range(nc):
                slopes[c] = 0.0
            for i in range(nv):
                slope = -rest
                for k in range(6):
                    slope += mapped[k] * batch[2 + i, j, k]
                free += slope * a_free[i]
                for c in range(nc):
                    slopes[c] += slope * a_slope[i, c]
            problem.contact_free[t, e] = free
            for c in range(nc):
                problem.contact_slope[t, c, e] = slopes[c]
    return 0


@kernel
def finish(
    problem: Problem,
    stuck: np.ndarray,
    direction: np.ndarray,
    friction: np.ndarray,
    load: np.ndarray,
    coordinate_v: np.ndarray,
    a_free: np.ndarray,
    a_slope: np.ndarray,
    batch: np.ndarray,
    joint: np.ndarray,
    least: np.ndarray,
    most: np.ndarray,
    phi: np.ndarray,
    site_modes: np.ndarray,
    a: np.ndarray,
    wrench: np.ndarray,
) -> None:
    """Write a = a_free + a_slope x, exactly 0 where it sticks, and what belongs to sites."""
    nv = a.size
    for i in range(nv):
        a[i] = a_free[i]
        for c in range(friction.size):
            a[i] += a_slope[i, c] * friction[c]
    for c in range(friction.size):
        if stuck[c]:
            a[coordinate_v[c]] = 0.0
    stick_limits(problem, load, least, most)
    site_friction(problem, stuck, direction, friction, load, least, most, phi)
    for s in range(joint.size):
        site_modes[s] = np.sign(direction[problem.coordinate[s]] * problem.ratio[s])
        for k in range(6):
            total = batch[0, joint[s], k]
            for i in range(nv):
                total += (batch[2 + i, joint[s], k] - batch[1, joint[s], k]) * a[i]
            wrench[s, k] = total


@kernel
def solve_instant(
    q: np.ndarray,
    v: np.ndarray,
    effort: np.ndarray,
    choice: int,
    batch: np.ndarray,
    rows: np.ndarray,
    armature: np.ndarray,
    joint: np.ndarray,
    laws: Laws,
    coordinate_v: np.ndarray,
    wrench_map: np.ndarray,
    wrench_map_moved: np.ndarray,
    displacement_q: np.ndarray,
    displacement_ratio: np.ndarray,
    displacement_shift: np.ndarray,
    M: np.ndarray,
    a_free: np.ndarray,
    a_slope: np.ndarray,
    dry: np.ndarray,
    stick_velocity: np.ndarray,
    stuck: np.ndarray,
    direction: np.ndarray,
    at_rest: np.ndarray,
    friction: np.ndarray,
    load: np.ndarray,
    rate: np.ndarray,
    verdict: np.ndarray,
    figures: np.ndarray,
    least: np.ndarray,
    most: np.ndarray,
    phi: np.ndarray,
    site_modes: np.ndarray,
    a: np.ndarray,
    wrench: np.ndarray,
    rate_free: np.ndarray,
    rate_slope: np.ndarray,
    rate_scale: np.ndarray,
    contact_free: np.ndarray,
    contact_slope: np.ndarray,
    contact_site: np.ndarray,
    constant: np.ndarray,
    coordinate: np.ndarray,
    ratio: np.ndarray,
    mu_slip: np.ndarray,
    mu_stick: np.ndarray,
    coulomb_slip: np.ndarray,
    coulomb_stick: np.ndarray,
    drag: np.ndarray,
) -> tuple[int, int, int, int]:
    """Assemble, try the given modes or those of the velocities, and finish: one call.

    `choice` is `FREE` or `GIVEN`; the last arguments are the fields of `Problem` (one by one:
    a tuple of arrays costs twice as long to hand over).

    Returns:
        (outcome of `assemble`, number of solutions or -1, how many obey, how many at rest).
    """
    problem = Problem(
        rate_free, rate_slope, rate_scale, contact_free, contact_slope, contact_site,
        constant, coordinate, ratio, mu_slip, mu_stick, coulomb_slip, coulomb_stick, drag,
    )  # fmt: skip
    outcome = assemble(
        q, v, effort, 0.0, batch, rows, armature, joint, laws, coordinate_v, wrench_map,
        wrench_map_moved, displacement_q, displacement_ratio, displacement_shift, M, a_free,
        a_slope, problem,
    )  # fmt: skip
    if outcome != 0:
        return outcome, 0, 0, 0
    resting = 0
    if choice == FREE:
        resting = settle(v, coordinate_v, dry, stick_velocity, stuck, direction, at_rest)
    else:
        at_rest[:] = False
    found, obeying = try_modes(problem, stuck, direction, at_rest, friction, friction, load,
                               rate, verdict, figures)  # fmt: skip
    if found <= 0:
        friction[:1] = np.nan  # no guess for the next solve
    elif obeying == 1:
        finish(problem, stuck, direction, friction, load, coordinate_v, a_free, a_slope, batch,
               joint, least, most, phi, site_modes, a, wrench)  # fmt: skip
    return 0, found, obeying, resting
