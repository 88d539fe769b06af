"""The paper's inverse dynamics, eq. (1)-(17) and its steps 1-7, as the independent judge.

Absolute coordinates with Euler parameters, full pivoting of Phi_q, the partial velocity matrix B,
and the fixed-point iteration between efforts (16) and multipliers (17).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from pinfric.errors import PinfricError
from pinfric.paper.bodies import Array, Indices, Mechanism
from pinfric.paper.equations import (
    Placement,
    Relative,
    acceleration_bias,
    actuator_forces,
    applied_forces,
    apply,
    body_accelerations,
    body_speeds,
    check_loops,
    full_pivoting,
    normal_load,
    partial_velocity_matrix,
    place,
    reactions,
    relative_jacobian,
    solve,
    transmitted,
)

MOST_STICKING = 10  # 2^10 corners of static limits at one sample


class FixedPointError(PinfricError):
    """The iteration over (16) and (17) did not end; `samples` are the rows concerned."""

    def __init__(self, samples: Indices, iterations: int) -> None:
        self.samples, self.iterations = samples, iterations
        super().__init__(
            f"efforts and normal loads did not settle in {iterations} iterations at "
            f"{len(samples)} samples, the first is sample {samples[0]}"
        )


@dataclass(frozen=True, eq=False)
class AbsoluteInverse:
    """Efforts, loads and reactions along a motion; samples first, joints and sites in order.

    Where joints stick, `normal_load`, `wrench` and `multipliers` are those without their friction;
    with joint drives they are the same anywhere in the interval.
    """

    effort_lower: Array  # (T, na) N m, or N for a unit force
    effort_upper: Array  # (T, na)
    effort_frictionless: Array  # (T, na)
    normal_load: Array  # (T, ns) radius-weighted sum of contact forces, N m (N along an axis)
    friction_lower: Array  # (T, ns) N m or N, on the child about or along the axis
    friction_upper: Array  # (T, ns)
    wrench: Array  # (T, nj, 6) parent on child, at the joint's point, child's axes, linear first
    sticking: np.ndarray  # (T, ns) bool
    iterations: np.ndarray  # (T,) solutions of (16), the most of all static limits tried
    multipliers: Array  # (T, m) lambda of (17)
    body_acceleration: Array  # (T, n) r'' in ground axes and omega' in body axes, body by body


@dataclass(frozen=True, eq=False)
class _Known:
    """Step 2: what the motion determines, samples first."""

    placement: Placement
    jacobian: Relative  # Phi_q among its rows; transposed: forces along and about the joints
    dependent: Indices  # (T, m)
    B: Array  # (T, n, n - m)
    inertial: Array  # M q'' - Q^E (T, n)
    drive: Array  # (Q^A)_FA (T, n, na)
    reduced_drive: Array  # B^T (Q^A)_FA (T, n - m, na)
    effort_terms: Array  # (T, na) size of the terms that efforts are sums of, without friction
    rate: Array  # (T, ns) at the sites, rad/s or m/s
    acceleration: Array  # q'' (T, n)

    def take(self, samples: Indices) -> _Known:
        placement = Placement(
            *(getattr(self.placement, f.name)[samples] for f in fields(Placement))
        )
        jacobian = replace(self.jacobian, rows=self.jacobian.rows[samples])
        arrays = {f.name: getattr(self, f.name)[samples] for f in fields(self)[2:]}
        return _Known(placement=placement, jacobian=jacobian, **arrays)


def _step_2(mechanism: Mechanism, position: Array, rate: Array, acceleration: Array) -> _Known:
    geo = mechanism.geometry
    placement = place(mechanism, position)
    jacobian = relative_jacobian(mechanism, placement)
    speed = body_speeds(jacobian, rate)
    bias = acceleration_bias(mechanism, placement, speed)
    body_acceleration = body_accelerations(jacobian, bias, acceleration)
    check_loops(mechanism, placement, jacobian, bias, speed, body_acceleration)
    dependent, independent = full_pivoting(jacobian.constraint)
    B = partial_velocity_matrix(jacobian.constraint, dependent, independent)
    B_transposed = np.swapaxes(B, 1, 2)
    inertia_force = body_acceleration @ geo.mass_matrix
    applied = applied_forces(mechanism, speed)
    drive = actuator_forces(mechanism, placement)
    reduced_drive = B_transposed @ drive
    sums = np.abs(B_transposed) @ np.abs(drive)
    relative = reduced_drive / sums.max(axis=1, keepdims=True)  # efforts may have different units
    if np.any(np.linalg.svd(relative, compute_uv=False)[:, -1] < 1e-10):
        raise PinfricError("the actuators leave a motion of the mechanism undriven")
    terms = apply(np.abs(B_transposed), np.abs(inertia_force) + np.abs(applied))
    tree = rate.shape[1]  # its rates as they were given; the loops' follow
    rates = np.concatenate([rate, apply(jacobian.axis[:, tree:], speed)], axis=1)
    return _Known(
        placement=placement,
        jacobian=jacobian,
        dependent=dependent,
        B=B,
        inertial=inertia_force - applied,
        drive=drive,
        reduced_drive=reduced_drive,
        effort_terms=apply(np.abs(np.linalg.inv(reduced_drive)), terms),
        rate=rates[:, geo.sites],
        acceleration=body_acceleration,
    )


@dataclass(frozen=True, eq=False)
class _Solution:
    effort: Array
    friction: Array
    load: Array
    wrench: Array
    multipliers: Array
    iterations: np.ndarray


def _friction_force(mechanism: Mechanism, known: _Known, friction: Array) -> Array:
    """Q^F (T, n) of (4): friction on the child about or along its axis, opposite on the parent."""
    unit_force = known.jacobian.axis[:, mechanism.geometry.sites]
    return apply(np.swapaxes(unit_force, 1, 2), friction)


def _effort_16(mechanism: Mechanism, known: _Known, friction: Array) -> Array:
    """F_A of B^T (Q^A)_FA F_A = chi (7, 8, 16), with chi = B^T (M q'' - Q^F - Q^E) (9)."""
    q_friction = _friction_force(mechanism, known, friction)
    return solve(
        known.reduced_drive, apply(np.swapaxes(known.B, 1, 2), known.inertial - q_friction)
    )


def _multipliers_17(mechanism: Mechanism, known: _Known, effort: Array, friction: Array) -> Array:
    """Lambda of Phi_q^T lambda = Q - M q'' (17), from the rows of the dependent coordinates."""
    right = apply(known.drive, effort) + _friction_force(mechanism, known, friction)
    right = right - known.inertial
    constraint = known.jacobian.constraint
    dependent = np.take_along_axis(constraint, known.dependent[:, None, :], axis=2)
    picked = np.take_along_axis(right, known.dependent, axis=1)
    return solve(np.swapaxes(dependent, 1, 2), picked)


def _fixed_point(
    mechanism: Mechanism,
    known: _Known,
    coefficient: Array,
    load: Array,
    tolerance: float,
    max_iterations: int,
) -> _Solution:
    """Steps 3 to 6 with friction = coefficient x load, until F_A no longer changes."""
    iterations = np.zeros(len(load), int)
    before = np.full(known.effort_terms.shape, np.inf)
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging iteration may overflow
        for count in range(1, max_iterations + 1):
            friction = coefficient * load  # step 3
            effort = _effort_16(mechanism, known, friction)  # step 4
            # step 5: each effort's change against the size of its own terms, whatever its unit
            size = known.effort_terms + np.abs(effort)
            settled = np.all(np.abs(effort - before) <= tolerance * size, axis=1)
            # step 6, for the reactions to the last efforts, too
            multipliers = _multipliers_17(mechanism, known, effort, friction)
            wrench = reactions(mechanism, known.placement, known.jacobian, multipliers)
            load = normal_load(mechanism, wrench)
            iterations[settled & (iterations == 0)] = count
            if np.all(settled):
                return _Solution(effort, friction, load, wrench, multipliers, iterations)
            before = effort
    raise FixedPointError(np.nonzero(~settled)[0], max_iterations)


def inverse(
    mechanism: Mechanism,
    position: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    tolerance: float = 1e-13,
    max_iterations: int = 500,
) -> AbsoluteInverse:
    """Efforts that produce a motion against load-dependent friction, as intervals where it sticks.

    B^T (Q^A)_FA F_A = B^T (M q'' - Q^F - Q^E) (16) and Phi_q^T lambda = Q - M q'' (17), iterated
    with friction = -sign(rate) mu_k N(lambda), or -+ mu_s N(lambda) at a joint that sticks.

    Every sample starts from its own frictionless loads; the paper's step 1 starts from the last
    sample, which would make answers depend on neighbours where there are several. If several joints
    stick, every combination of their static limits is solved, so the ends hold for coupled
    actuators too. Ends of different efforts are not attained together.

    Args:
        mechanism: bodies, joints, gravity and actuators.
        position: (T, nt) rad about the joints' axes or m along them, child relative to parent;
            joints that close loops follow.
        rate, acceleration: (T, nt) the same per second, and per second squared.
        tolerance: change of F_A at which the iteration ends (step 5), each effort relative to the
            size of its terms.
        max_iterations: solutions of (16) allowed.

    Raises:
        FixedPointError: the iteration does not settle.
        PinfricError: shapes do not fit, a loop is open, more than ten joints stick at one sample.

    Source: the paper, (1)-(17) and steps 1-7.
    """
    position, rate, acceleration = (
        _samples(mechanism, name, values)
        for name, values in (("position", position), ("rate", rate), ("acceleration", acceleration))
    )
    geo = mechanism.geometry
    known = _step_2(mechanism, position, rate, acceleration)
    settle = partial(_fixed_point, mechanism, tolerance=tolerance, max_iterations=max_iterations)
    sticking = np.abs(known.rate) <= geo.stick_velocity
    zero = np.zeros(known.rate.shape)
    free = settle(known, zero, zero)  # step 1
    sliding = np.where(sticking, 0.0, -np.sign(known.rate) * geo.kinetic)  # (20)
    middle = settle(known, sliding, free.load)
    lower, upper = _static_limits(settle, known, sticking, sliding, geo.static, middle)
    return AbsoluteInverse(
        effort_lower=lower.effort,
        effort_upper=upper.effort,
        effort_frictionless=free.effort,
        normal_load=middle.load,
        friction_lower=lower.friction,
        friction_upper=upper.friction,
        wrench=transmitted(mechanism, middle.wrench, middle.effort, middle.friction),
        sticking=sticking,
        iterations=upper.iterations,
        multipliers=middle.multipliers,
        body_acceleration=known.acceleration,
    )


def _static_limits(
    settle: Callable[[_Known, Array, Array], _Solution],
    known: _Known,
    sticking: np.ndarray,
    sliding: Array,
    static: Array,
    middle: _Solution,
) -> tuple[_Solution, _Solution]:
    """Least and greatest efforts and friction over all combinations of static limits (21, 22)."""
    most = int(sticking.sum(axis=1).max(initial=0))
    if most > MOST_STICKING:
        raise PinfricError(f"{most} joints stick at one sample, {MOST_STICKING} is the most")
    stuck = np.nonzero(sticking.any(axis=1))[0]
    lower, upper = middle, middle
    for name in ("effort", "friction"):
        low, high = getattr(middle, name).copy(), getattr(middle, name).copy()
        low[stuck], high[stuck] = np.inf, -np.inf
        lower, upper = replace(lower, **{name: low}), replace(upper, **{name: high})
    iterations = middle.iterations.copy()
    for signs in itertools.product((1.0, -1.0), repeat=sticking.shape[1]):
        # a site that slides takes part with one sign only, or a corner would be solved twice
        rows = stuck[np.all(sticking[stuck] | (np.array(signs) > 0), axis=1)]
        if len(rows) == 0:
            continue
        limit = np.where(sticking[rows], signs * static, sliding[rows])  # (21)
        corner = settle(known.take(rows), limit, middle.load[rows])
        for name in ("effort", "friction"):
            low, high, value = (getattr(end, name) for end in (lower, upper, corner))
            low[rows], high[rows] = np.minimum(low[rows], value), np.maximum(high[rows], value)
        iterations[rows] = np.maximum(iterations[rows], corner.iterations)
    return lower, replace(upper, iterations=iterations)


def _samples(mechanism: Mechanism, name: str, values: ArrayLike) -> Array:
    array = np.atleast_2d(np.asarray(values, float))
    if array.ndim != 2 or array.shape[1] != len(mechanism.joints):
        raise PinfricError(f"{name} must be (T, {len(mechanism.joints)}), not {array.shape}")
    return array
