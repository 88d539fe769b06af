"""A batch of samples of a linkage as functions of its friction, for `interval_ends`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse.effort_maps import Maps, map_friction
from pinfric.dynamics.problem.plan import Plan
from pinfric.dynamics.samples.closure import check_pairs
from pinfric.dynamics.samples.reactions import (
    AppliedWrench,
    Batch,
    subtract_external_wrenches,
    transmitted,
)
from pinfric.dynamics.samples.states import States
from pinfric.kernels.compiled import KernelArgument
from pinfric.model.closure import action_maps, embedded, embedded_state
from pinfric.model.couples import drive_rates
from pinfric.model.loops import Linkage
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin, project


@dataclass(frozen=True)
class LinkedSamples:
    """A batch for `interval_ends`: maps, and the arrays from which wrenches follow.

    Attributes:
        maps: `effort_maps.Maps`.
        wrench: (n, nj, 6) of the tree without multipliers.
        X: (n, nj + pairs, 6, nx), `kinematics.act_on_joints`.
        velocity: (m, ne) along each friction coordinate (rad/s or m/s), of the samples
            `states.around` the batch, as the others.
        drive_velocity, drive_acceleration: (m, na) of what each drive moves.
    """

    maps: Maps
    wrench: np.ndarray
    X: np.ndarray
    velocity: np.ndarray
    drive_velocity: np.ndarray
    drive_acceleration: np.ndarray


def link_samples(
    argument: KernelArgument[Plan],
    scene: Scene,
    twin: Twin,
    states: States,
    applied: Sequence[AppliedWrench],
    part: slice,
    threads: int,
) -> LinkedSamples:
    """Return everything of a batch as affine functions of the friction (`effort_maps`).

    Args:
        argument, scene: the plan of inverse dynamics, and the scene with its loops.
        twin: with the payloads of this batch.
        states, applied: of all samples.
        part: the samples of this batch.
        threads: of Pinocchio.

    Raises:
        LoopMotionError, StateError: see `closure.check_pairs`.
    """
    plan, linkage, n = argument.given, scene.linkage, part.stop - part.start
    assert linkage is not None
    wide, inner = states.around(part), states.inside(part)
    q, v, a = states.q[wide], states.v[wide], states.a[wide]
    q_twin, v_twin, a_twin = embedded(twin, q, v, a)
    state = embedded_state(twin, linkage, q_twin, v_twin, a_twin)
    check_pairs(linkage, state, wide, part)
    wrench = np.empty((n, twin.n_joints, 6))
    batch = Batch(q_twin[inner], v_twin[inner], a_twin[inner], wrench)
    transmitted(twin, q[inner], v[inner], a[inner], batch, threads)
    subtract_external_wrenches(twin, applied, part, batch)
    tau = np.empty((n, twin.nv))
    project(wrench, twin.embedding, twin.armature, a[inner], tau)
    X, J = action_maps(twin, linkage, state.p[inner], state.R[inner])
    maps = Maps.of(plan, n)
    given = wrench, tau, X, J, q[inner]
    map_friction(argument.beside(*given), *given, maps)
    velocity = np.ascontiguousarray(plan.entries.ratio * v[:, plan.entries.velocity_index])
    loop = plan.entries.action >= 0
    velocity[:, loop] = state.rate[:, plan.entries.action[loop]]
    of_drives = zip((v, a), (state.rate, state.rate_derivative), strict=True)
    rates = (drive_rates(scene.drives, *pair) for pair in of_drives)
    return LinkedSamples(maps, wrench, X, velocity, *rates)


def loop_wrenches(linkage: Linkage, X: np.ndarray, solved: np.ndarray) -> np.ndarray:
    """Return the multipliers (n, number of loops, 6) as wrenches of a on b in frame b.

    Args:
        linkage: with the loops.
        X: (n, nj + number of pairs, 6, nx), `kinematics.act_on_joints`.
        solved: (n, ny) efforts off the joints and multipliers.
    """
    first, rows = X.shape[1] - len(linkage.pair_kind), linkage.lambdas
    loops = X[:, first : first + len(linkage.loops), :, rows]
    return np.einsum("nlkc,nc->nlk", loops, solved[:, rows])
