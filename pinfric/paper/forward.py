"""Forward dynamics in absolute coordinates: eq. (3) with stiction.

A sliding joint has friction -sign(rate) mu_k N(lambda), implicit because lambda depends on it. A
sticking joint gets one more constraint, and is released when its multiplier exceeds mu_s N
(constraint addition-deletion: Wu, Yang, Haug 1984).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import root

from pinfric.errors import PinfricError
from pinfric.paper.bodies import Array, Mechanism
from pinfric.paper.equations import (
    Placement,
    Relative,
    acceleration_bias,
    actuator_forces,
    applied_forces,
    apply,
    body_speeds,
    contact_forces,
    normal_load,
    place,
    reactions,
    relative_jacobian,
    transmitted,
)

Modes = NDArray[np.int_]

ROUNDING = 1e-11  # of the terms that are summed; below it a number is zero
CONVERGED = 1e-14  # of the friction and of the loads it comes from
MOST_AT_REST = 8  # 3^8 combinations of stick and slip


class NoConsistentFriction(PinfricError):  # noqa: N818 - it names a finding about the mechanism
    """Neither stick nor slip obeys the law of friction, or several combinations do (`consistent`).

    At `time` s (None outside a simulation), `position` and `rate`.
    """

    def __init__(
        self,
        time: float | None,
        position: Array,
        rate: Array,
        effort: Array,
        consistent: list[Modes],
    ) -> None:
        self.time, self.position, self.rate = time, position, rate
        self.effort, self.consistent = effort, consistent
        count = f"{len(consistent)} combinations" if consistent else "no combination"
        when = "" if time is None else f" at t = {time:.6g} s"
        super().__init__(
            f"{count} of stick and slip fit the law of friction{when}: position "
            f"{position.tolist()}, rate {rate.tolist()}, effort {effort.tolist()}"
        )


@dataclass(frozen=True, eq=False)
class AbsoluteInstant:
    """Accelerations, reactions and friction at one state under given efforts."""

    acceleration: Array  # (nj,) rad/s^2 or m/s^2, along what the joints leave free
    body_acceleration: Array  # (n,) q'' of (3)
    multipliers: Array  # (m,) lambda of (3)
    friction: Array  # (ns,) N m or N on the child about or along the axis
    normal_load: Array  # (ns,) N m or N
    wrench: Array  # (nj, 6) parent on child, joint's point, child's axes, linear first
    modes: Modes  # (ns,) the sign of the slip, 0 where the joint sticks
    rounding: Array  # (nj,) rad/s^2 or m/s^2 below which an acceleration counts as zero


# ---------------------------------------------------------------- eq. (3) in given modes


@dataclass(frozen=True, eq=False)
class State:
    """All of (3) that does not depend on friction or modes, at one state."""

    mechanism: Mechanism
    placement: Placement
    jacobian: Relative  # of one sample
    bias: Relative
    force: Array  # Q^A + Q^E (n,)
    effort: Array  # (na,)
    site_rate: Array  # (ns,) rad/s or m/s


def prepare(mechanism: Mechanism, position: Array, rate: Array, effort: Array) -> State:
    """All of (3) that modes do not change; positions, rates (nt,) and efforts (na,)."""
    placement = place(mechanism, position[None])
    jacobian = relative_jacobian(mechanism, placement)
    speed = body_speeds(jacobian, rate[None])
    bias = acceleration_bias(mechanism, placement, speed)
    force = apply(actuator_forces(mechanism, placement)[0], effort)
    force = force + applied_forces(mechanism, speed)[0]
    rates = np.concatenate([rate, jacobian.axis[0, len(rate) :] @ speed[0]])
    sites = mechanism.geometry.sites
    return State(mechanism, placement, jacobian, bias, force, effort, rates[sites])


def _solve_modes(state: State, modes: Modes) -> AbsoluteInstant | None:
    """Solve [M Phi_q^T; Phi_q 0] [q''; lambda] = [Q; gamma] (3) in given modes; None if it fails.

    A sticking joint adds its axis row to Phi_q; minus that row's multiplier is its friction. The
    solution is affine in the sliding friction (`_sliding_friction`).
    """
    geo, constraint, axis = (
        state.mechanism.geometry,
        state.jacobian.constraint[0],
        state.jacobian.axis[0],
    )
    axis_bias = state.bias.axis[0]
    stuck, sliding = modes == 0, modes != 0
    rows = np.concatenate([constraint, axis[geo.sites[stuck]]])
    slip_force = axis[geo.sites[sliding]]
    n, m = constraint.shape[1], len(constraint)
    kkt = np.zeros((n + len(rows),) * 2)
    kkt[:n, :n], kkt[:n, n:], kkt[n:, :n] = geo.mass_matrix, rows.T, rows
    right = np.zeros((len(kkt), 1 + len(slip_force)))
    right[:n, 0], right[:n, 1:] = state.force, slip_force.T
    right[n:, 0] = np.concatenate([state.bias.constraint[0], axis_bias[geo.sites[stuck]]])
    # the first row is the solution without sliding friction, the others what unit friction adds
    columns = np.asarray(np.linalg.solve(kkt, right).T, np.float64)
    # the joints' constraint wrenches and contact forces, linear in lambda
    multipliers = columns[:, n : n + m]
    wrench = reactions(state.mechanism, state.placement, state.jacobian, multipliers)
    contact = contact_forces(state.mechanism, wrench)
    factor = -(modes * geo.kinetic * geo.radius)[sliding]
    slip = _sliding_friction(contact[0, sliding], contact[1:, sliding], factor)
    if slip is None:
        return None
    share = np.concatenate([[1.0], slip])
    solution, wrench = share @ columns, np.tensordot(share, wrench, 1)
    load = normal_load(state.mechanism, wrench)
    friction = np.zeros(len(modes))
    friction[sliding], friction[stuck] = slip, -solution[n + m :]
    terms = np.abs(share) @ np.abs(columns[:, :n]) @ np.abs(axis).T
    return AbsoluteInstant(
        acceleration=axis @ solution[:n] - axis_bias,
        body_acceleration=solution[:n],
        multipliers=solution[n : n + m],
        friction=friction,
        normal_load=load,
        wrench=transmitted(state.mechanism, wrench, state.effort, friction),
        modes=modes,
        rounding=ROUNDING * terms,
    )


def _sliding_friction(constant: Array, slope: Array, factor: Array) -> Array | None:
    """Friction phi (k,) with phi = factor sum |p|, p = constant (k, 3, 3) + phi slope (k, k, 3, 3).

    Fixed point first; if slow or divergent, Powell's hybrid method. None if neither converges.
    """
    if len(factor) == 0:
        return np.zeros(0)
    shape, flat = constant.shape, slope.reshape(len(slope), -1)
    terms, slopes = np.abs(constant).sum(), np.abs(flat).sum(axis=1)

    def residual(friction: Array) -> Array:
        force = constant + (friction @ flat).reshape(shape)
        return friction - factor * np.sqrt((force**2).sum(axis=-1)).sum(axis=-1)

    def small(friction: Array, error: Array) -> bool:
        size = terms + np.abs(friction) @ slopes
        return bool(np.all(np.abs(error) <= CONVERGED * np.abs(factor) * size))

    start = -residual(np.zeros(len(factor)))
    friction = start
    for _ in range(30):
        error = residual(friction)
        if small(friction, error):
            return friction
        friction = friction - error
    friction = root(residual, start, method="hybr", options={"xtol": CONVERGED}).x
    return friction if small(friction, residual(friction)) else None


# ---------------------------------------------------------------- which modes


def _violated(mechanism: Mechanism, instant: AbsoluteInstant, at_rest: NDArray[np.bool_]) -> bool:
    """Whether a sticking joint is held beyond mu_s N, or a joint at rest slips against its mode."""
    geo = mechanism.geometry
    limit = geo.static * instant.normal_load
    excess = np.abs(instant.friction) - limit
    beyond = (instant.modes == 0) & (excess > ROUNDING * (np.abs(instant.friction) + limit))
    # a slip that starts from rest must be going its own way, or not be going at all
    onward = instant.modes * instant.acceleration[geo.sites] >= -instant.rounding[geo.sites]
    return bool(np.any(beyond | (at_rest & (instant.modes != 0) & ~onward)))


def _candidates(modes: Modes, free: NDArray[np.bool_]) -> Iterator[list[Modes]]:
    """All modes of the free joints, level by level, those with the most sticking joints first."""
    choices = list(itertools.product((0, 1, -1), repeat=int(free.sum())))
    for slipping in range(int(free.sum()) + 1):
        level = []
        for choice in choices:
            if np.count_nonzero(choice) == slipping:
                level.append(modes.copy())
                level[-1][free] = choice
        yield level


def find_modes(
    state: State,
    modes: Modes,
    free: NDArray[np.bool_],
    at_rest: NDArray[np.bool_],
    where: tuple[float | None, Array, Array],
) -> AbsoluteInstant:
    """The only consistent choice for the free joints with the most of them sticking."""
    if free.sum() > MOST_AT_REST:
        raise PinfricError(f"{free.sum()} joints are at rest, {MOST_AT_REST} is the most")
    for level in _candidates(modes, free):
        tried = (_solve_modes(state, candidate) for candidate in level)
        consistent = [
            instant
            for instant in tried
            if instant is not None and not _violated(state.mechanism, instant, at_rest)
        ]
        if len(consistent) == 1:
            return consistent[0]
        if consistent:
            raise NoConsistentFriction(*where, state.effort, [x.modes for x in consistent])
    raise NoConsistentFriction(*where, state.effort, [])


def forward(
    mechanism: Mechanism,
    position: ArrayLike,
    rate: ArrayLike,
    effort: ArrayLike,
    modes: ArrayLike | None = None,
) -> AbsoluteInstant:
    """Accelerations, multipliers and friction under efforts at one state.

    [M Phi_q^T; Phi_q 0] [q''; lambda] = [Q^A + Q^F + Q^E; gamma] (3). A joint within its stick
    velocity sticks if a consistent choice allows it; else it slips in the direction of its
    acceleration.

    Args:
        mechanism: bodies, joints, gravity and actuators.
        position: (nt,) rad about the joints' axes or m along them, child relative to parent.
        rate: (nt,) rad/s or m/s; in a loop those that keep it closed (unchecked).
        effort: (na,) N m, or N for a unit force.
        modes: (ns,) prescribes 0 (sticks) or the sign of the slip, unchecked; None finds them.

    Raises:
        NoConsistentFriction: no choice of stick and slip obeys the law of friction, or several do.
        PinfricError: a joint is at rest in a mechanism with loops.

    Source: the paper, (3), (4), (21); Wu, Yang, Haug 1984 for the change of constraints.
    """
    position, rate, effort = (np.asarray(x, float) for x in (position, rate, effort))
    state = prepare(mechanism, position, rate, effort)
    where = (None, position, rate)
    if modes is not None:
        instant = _solve_modes(state, np.asarray(modes, int))
        if instant is None:
            raise NoConsistentFriction(*where, effort, [])
        return instant
    geo = mechanism.geometry
    at_rest = np.abs(state.site_rate) <= geo.stick_velocity
    if at_rest.any() and mechanism.loops:
        raise PinfricError(
            "joints at rest in a loop share their friction in more ways than one: "
            "forward dynamics takes loops in motion only"
        )
    signs = np.where(at_rest, 0, np.sign(state.site_rate)).astype(int)
    return find_modes(state, signs, at_rest, at_rest, where)
