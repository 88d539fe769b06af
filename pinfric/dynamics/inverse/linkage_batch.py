"""A batch of samples of a linkage as functions of its friction, for `interval_ends`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse.effort_maps import Maps, map_friction
from pinfric.dynamics.problem.plan import Plan
from pinfric.dynamics.samples.closure import PairRates
from pinfric.dynamics.samples.reactions import (
    AppliedWrench,
    Batch,
    reactions,
    subtract_external_wrenches,
)
from pinfric.dynamics.samples.states import States
from pinfric.kernels.compiled import KernelArgument
from pinfric.model.closure import action_maps, tree_tables
from pinfric.model.kinematics import place_links
from pinfric.model.loops import Linkage
from pinfric.model.twin import Twin, project


@dataclass(frozen=True)
class Samples:
    """A batch for `interval_ends`: maps, and the arrays from which wrenches follow.

    Attributes:
        maps: `effort_maps.Maps`.
        wrench: (n, nj, 6) of the tree without multipliers.
        X: (n, nj + pairs, 6, nx), `kinematics.act_on_joints`.
    """

    maps: Maps
    wrench: np.ndarray
    X: np.ndarray


def friction_maps(
    argument: KernelArgument[Plan],
    linkage: Linkage,
    twin: Twin,
    states: States,
    applied: list[AppliedWrench],
    part: slice,
    batch: Batch,
    threads: int,
) -> Samples:
    """Return everything of a batch as affine functions of the friction (`effort_maps`).

    Args:
        argument, linkage: the plan of inverse dynamics, and the loops.
        twin: with the payloads of this batch.
        states, applied: of all samples.
        part: the samples of this batch.
        batch: buffers of as many samples.
        threads: of Pinocchio.
    """
    q, a, n = states.q[part], states.a[part], part.stop - part.start
    reactions(twin, q, states.v[part], a, batch, threads)
    subtract_external_wrenches(twin, applied, part, batch)
    tau = np.empty((n, twin.nv))
    project(batch.wrench, twin.embedding, twin.armature, a, tau)
    p, R = np.empty((n, twin.n_joints, 3)), np.empty((n, twin.n_joints, 3, 3))
    place_links(batch.q, *tree_tables(twin), p, R)
    X, J = action_maps(twin, linkage, p, R)
    maps = Maps.of(argument.given, n)
    given = batch.wrench, tau, X, J, q
    map_friction(argument.beside(*given), *given, maps)
    return Samples(maps, batch.wrench, X)


def friction_velocities(plan: Plan, v: np.ndarray, rates: PairRates) -> np.ndarray:
    """Return the relative velocity (n, ne) along each friction coordinate (rad/s or m/s)."""
    out = plan.entries.ratio * v[:, plan.entries.velocity_index]
    loop = plan.entries.action >= 0
    out[:, loop] = rates.rate[:, plan.entries.action[loop]]
    return np.ascontiguousarray(out)


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
