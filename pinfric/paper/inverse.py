"""The paper's inverse dynamics, eq. (1)-(17) and its steps 1-7, as the independent judge.

Absolute coordinates with Euler parameters, full pivoting of Phi_q, the partial velocity matrix B,
and the fixed-point iteration between efforts (16) and multipliers (17). Imports neither Pinocchio
nor any other part of pinfric, so that agreement with the rest of the package means something.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from pinfric.errors import PinfricError
from pinfric.paper.bodies import (
    Array,
    Indices,
    Mechanism,
    Placement,
    acceleration_bias,
    actuator_forces,
    applied_forces,
    apply,
    body_speeds,
    full_pivoting,
    joint_jacobians,
    mass_matrix,
    normal_load,
    partial_velocity_matrix,
    place,
    reactions,
    solve,
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

    Where joints stick, `normal_load`, `wrench` and `multipliers` are those without friction at the
    sticking joints; with joint drives they are the same anywhere in the interval.
    """

    effort_lower: Array  # (T, na) N m for a joint drive, N for a unit force
    effort_upper: Array  # (T, na)
    effort_frictionless: Array  # (T, na)
    normal_load: Array  # (T, ns) N m, radius-weighted sum of contact forces
    friction_lower: Array  # (T, ns) N m, on the child about the axis
    friction_upper: Array  # (T, ns)
    wrench: Array  # (T, nj, 6) parent on child, at the joint's point, child's axes, linear first
    sticking: np.ndarray  # (T, ns) bool
    iterations: np.ndarray  # (T,) solutions of (16), the most of all static limits tried
    multipliers: Array  # (T, 5 nj) lambda of (17)
    body_acceleration: Array  # (T, n) r'' in ground axes and omega' in body axes, body by body


@dataclass(frozen=True, eq=False)
class _Known:
    """Step 2: everything the motion fixes, samples first."""

    placement: Placement
    constraint: Array  # Phi_q (T, m, n)
    axis: Array  # (T, nj, n), transposed the generalized forces of unit torques about the axes
    dependent: Indices  # (T, m)
    B: Array  # (T, n, n - m)
    inertial: Array  # M q'' - Q^E (T, n)
    drive: Array  # (Q^A)_FA (T, n, na)
    reduced_drive: Array  # B^T (Q^A)_FA (T, n - m, na)
    scale: Array  # (T,) size of the terms of (16), what "small" is measured by
    acceleration: Array  # q'' (T, n)

    def take(self, samples: Indices) -> _Known:
        """The same for some of the samples."""
        placement = Placement(
            *(getattr(self.placement, f.name)[samples] for f in fields(Placement))
        )
        rest = {f.name: getattr(self, f.name)[samples] for f in fields(self)[1:]}
        return _Known(placement=placement, **rest)


def _step_2(mechanism: Mechanism, angle: Array, rate: Array, acceleration: Array) -> _Known:
    placement = place(mechanism, angle)
    constraint, axis = joint_jacobians(mechanism, placement)
    speed = body_speeds(constraint, axis, rate)
    driven = np.concatenate([constraint, axis], axis=1)
    bias = acceleration_bias(mechanism, placement, speed)
    body_acceleration = solve(driven, np.concatenate([bias, acceleration], axis=1))
    dependent, independent = full_pivoting(constraint)
    B = partial_velocity_matrix(constraint, dependent, independent)
    inertia_force = body_acceleration @ mass_matrix(mechanism)
    applied = applied_forces(mechanism, speed)
    drive = actuator_forces(mechanism, placement)
    reduced_drive = np.swapaxes(B, 1, 2) @ drive
    sums = np.swapaxes(np.abs(B), 1, 2) @ np.abs(drive)
    relative = reduced_drive / sums.max(axis=1, keepdims=True)  # efforts may have different units
    if np.any(np.linalg.svd(relative, compute_uv=False)[:, -1] < 1e-10):
        raise PinfricError("the actuators leave a motion of the mechanism undriven")
    terms = apply(np.swapaxes(np.abs(B), 1, 2), np.abs(inertia_force) + np.abs(applied))
    return _Known(
        placement=placement,
        constraint=constraint,
        axis=axis,
        dependent=dependent,
        B=B,
        inertial=inertia_force - applied,
        drive=drive,
        reduced_drive=reduced_drive,
        scale=terms.max(axis=1),
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


def _effort_16(mechanism: Mechanism, known: _Known, friction: Array) -> tuple[Array, Array]:
    """F_A of B^T (Q^A)_FA F_A = chi (16), and chi = B^T (M q'' - Q^F - Q^E) (9)."""
    q_friction = _friction_force(mechanism, known, friction)
    chi = apply(np.swapaxes(known.B, 1, 2), known.inertial - q_friction)
    return solve(known.reduced_drive, chi), chi


def _multipliers_17(mechanism: Mechanism, known: _Known, effort: Array, friction: Array) -> Array:
    """Lambda of Phi_q^T lambda = Q - M q'' (17), from the rows of the dependent coordinates."""
    right = apply(known.drive, effort) + _friction_force(mechanism, known, friction)
    right = right - known.inertial
    dependent = np.take_along_axis(known.constraint, known.dependent[:, None, :], axis=2)
    picked = np.take_along_axis(right, known.dependent, axis=1)
    return solve(np.swapaxes(dependent, 1, 2), picked)


def _friction_force(mechanism: Mechanism, known: _Known, friction: Array) -> Array:
    """Q^F (T, n): a torque on the child about the joint's axis, the opposite on the parent."""
    unit_torque = known.axis[:, mechanism.geometry.sites]
    return apply(np.swapaxes(unit_torque, 1, 2), friction)


def _fixed_point(
    mechanism: Mechanism,
    known: _Known,
    coefficient: Array,
    load: Array,
    tolerance: float,
    max_iterations: int,
) -> _Solution:
    """Steps 3 to 6 with friction = coefficient x load, until (16) does not change any more."""
    iterations = np.zeros(len(load), int)
    before = np.full(known.inertial.shape[:1] + known.reduced_drive.shape[2:], np.inf)
    with np.errstate(over="ignore", invalid="ignore"):  # a diverging iteration may overflow
        for count in range(1, max_iterations + 1):
            friction = coefficient * load
            effort, chi = _effort_16(mechanism, known, friction)
            multipliers = _multipliers_17(mechanism, known, effort, friction)
            wrench = reactions(mechanism, known.placement, known.constraint, multipliers)
            load = normal_load(mechanism, wrench)
            scale = known.scale + np.abs(chi).max(axis=1)
            settled = np.abs(chi - before).max(axis=1) <= tolerance * scale
            iterations[settled & (iterations == 0)] = count
            if np.all(settled):
                return _Solution(effort, friction, load, wrench, multipliers, iterations)
            before = chi
    raise FixedPointError(np.nonzero(~settled)[0], max_iterations)


def inverse(
    mechanism: Mechanism,
    angle: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    tolerance: float = 1e-13,
    max_iterations: int = 500,
) -> AbsoluteInverse:
    """Efforts that produce a motion against load-dependent friction, as intervals where it sticks.

    B^T (Q^A)_FA F_A = B^T (M q'' - Q^F - Q^E) (16) and Phi_q^T lambda = Q - M q'' (17), iterated
    with friction = -sign(rate) mu_k N(lambda), or -+ mu_s N(lambda) at a joint that sticks.

    Every sample starts from its own frictionless loads; the paper's step 1 starts from the sample
    before it, which would let an answer depend on its neighbours where there are several. Several
    joints sticking at once: every combination of their static limits is solved, so that the ends
    hold for coupled actuators too. Ends of different efforts are not attained together.

    Args:
        mechanism: bodies, joints, gravity and actuators.
        angle: (T, nj) rad about the joints' axes, child relative to parent.
        rate: (T, nj) rad/s.
        acceleration: (T, nj) rad/s^2.
        tolerance: change of (16) at which the iteration ends, relative to the size of its terms.
        max_iterations: solutions of (16) allowed.

    Raises:
        FixedPointError: the iteration does not settle.
        PinfricError: shapes do not fit, or more than ten joints stick at one sample.

    Source: the paper, (1)-(17) and steps 1-7.
    """
    angle, rate, acceleration = (
        _samples(mechanism, name, values)
        for name, values in (("angle", angle), ("rate", rate), ("acceleration", acceleration))
    )
    geo = mechanism.geometry
    known = _step_2(mechanism, angle, rate, acceleration)
    site_rate = rate[:, geo.sites]
    sticking = np.abs(site_rate) <= geo.stick_velocity
    zero = np.zeros(site_rate.shape)
    free = _fixed_point(mechanism, known, zero, zero, tolerance, max_iterations)
    sliding = np.where(sticking, 0.0, -np.sign(site_rate) * geo.kinetic)
    middle = _fixed_point(mechanism, known, sliding, free.load, tolerance, max_iterations)
    ends = _static_limits(mechanism, known, sticking, sliding, middle, tolerance, max_iterations)
    wrench = middle.wrench.copy()
    through = apply(geo.through, middle.effort)
    through[:, geo.sites] += middle.friction
    wrench[..., 3:] += through[..., None] * geo.triad[:, 2]
    return AbsoluteInverse(
        effort_lower=ends[0].effort,
        effort_upper=ends[1].effort,
        effort_frictionless=free.effort,
        normal_load=middle.load,
        friction_lower=ends[0].friction,
        friction_upper=ends[1].friction,
        wrench=wrench,
        sticking=sticking,
        iterations=ends[1].iterations,
        multipliers=middle.multipliers,
        body_acceleration=known.acceleration,
    )


def _static_limits(
    mechanism: Mechanism,
    known: _Known,
    sticking: np.ndarray,
    sliding: Array,
    middle: _Solution,
    tolerance: float,
    max_iterations: int,
) -> tuple[_Solution, _Solution]:
    """Least and greatest efforts and friction over all combinations of static limits (step 3)."""
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
        limit = np.where(sticking[rows], signs * mechanism.geometry.static, sliding[rows])
        corner = _fixed_point(
            mechanism, known.take(rows), limit, middle.load[rows], tolerance, max_iterations
        )
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
