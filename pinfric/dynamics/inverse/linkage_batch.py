"""A batch of samples of a linkage as functions of its friction, for `interval_ends`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinfric.dynamics.inverse.effort_maps import LinkedSamples, map_friction
from pinfric.dynamics.problem.plan import Plan
from pinfric.dynamics.samples.closure import check_pairs
from pinfric.dynamics.samples.reactions import (
    AppliedWrench,
    Batch,
    subtract_external_wrenches,
    transmitted,
)
from pinfric.dynamics.samples.reversals import reversals
from pinfric.dynamics.samples.states import States
from pinfric.kernels.compiled import KernelArgument
from pinfric.model.closure import action_maps, embedded, embedded_state
from pinfric.model.couples import drive_rates
from pinfric.model.loops import Linkage
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin, project


def link_samples(
    argument: KernelArgument[Plan],
    scene: Scene,
    twin: Twin,
    states: States,
    applied: Sequence[AppliedWrench],
    part: slice,
    threads: int,
) -> tuple[LinkedSamples, list[np.ndarray]]:
    """Return a batch as functions of the friction, and the motion of what the drives move.

    Velocities and accelerations (m, na) are those of the samples `states.around` the batch.

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
    velocity = np.ascontiguousarray(plan.entries.ratio * v[:, plan.entries.velocity_index])
    loop = plan.entries.action >= 0
    velocity[:, loop] = state.rate[:, plan.entries.action[loop]]
    reversal = np.zeros((n, len(plan.sites.joint)), dtype=bool)
    if states.t is not None:
        reversal[:] = site_reversals(plan, velocity)[inner]
    columns, contacts = 1 + len(plan.entries.site), len(plan.contacts.owner)
    samples = LinkedSamples(
        wrench,
        X,
        velocity[inner],
        reversal,
        effort=np.empty((n, len(plan.drives.action), columns)),
        y=np.empty((n, plan.closure.solved, columns)),
        contact=np.zeros((n, contacts, columns, 3)),
        singular=np.zeros(n, dtype=bool),
    )
    map_friction(argument.beside(X, tau, J), samples, tau, J, q[inner])
    of_drives = zip((v, a), (state.rate, state.rate_derivative), strict=True)
    return samples, [drive_rates(scene.drives, *pair) for pair in of_drives]


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


def site_speeds(plan: Plan, velocity: np.ndarray) -> np.ndarray:
    """Return the speed (n, ns) of each site; a ball's is the length of its angular velocity."""
    squares = (
        np.add.reduceat(velocity**2, plan.sites.first_entry, axis=1)
        if len(plan.sites.joint)
        else (np.zeros((len(velocity), 0)))
    )
    return np.asarray(np.sqrt(squares))


def site_reversals(plan: Plan, velocity: np.ndarray) -> np.ndarray:
    """Return (n, ns) whether a site passes through rest next to a sample.

    A ball does where the straight line between two angular velocities comes as near to zero as its
    stick velocity; of the two samples the slower one is marked (the earlier if equal).

    Args:
        velocity: (n, ne), along the friction coordinates.
    """
    stick = plan.sites.laws.stick_velocity
    marked = reversals(np.ascontiguousarray(velocity[:, plan.sites.first_entry]), stick)
    for s in np.flatnonzero(plan.sites.entry_count == 3):
        w = velocity[:, plan.sites.first_entry[s] : plan.sites.first_entry[s] + 3]
        change = np.diff(w, axis=0)
        square = np.maximum((change**2).sum(axis=1), 1e-300)
        share = np.clip(-(w[:-1] * change).sum(axis=1) / square, 0.0, 1.0)
        nearest = np.linalg.norm(w[:-1] + share[:, None] * change, axis=1)
        speed = np.linalg.norm(w, axis=1)
        moving = (speed[:-1] > stick[s]) & (speed[1:] > stick[s])
        passes = np.flatnonzero((nearest <= stick[s]) & moving)
        marked[:, s] = False
        marked[np.where(speed[passes] <= speed[passes + 1], passes, passes + 1), s] = True
    return marked
