"""Efforts, multipliers and bearing loads of a given motion as affine functions of friction.

    M a + h = S u + J_c^T lambda + D phi,     y = [u off the joints; lambda],     A y = b - B phi

(paper eq. 7, 16, 17). Drives on joints of the tree balance their own row, so A has the other rows.
Full pivoting, the paper's choice, finds its rank. A rank below the number of rows means a toggle,
where drives cannot balance the load; below the number of columns, redundant drives, which share the
work so that the sum of u^2 / share is least, and redundant closures (`wrenches.share_load`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pinfric.dynamics.problem.plan import Drives, Entries, Plan
from pinfric.dynamics.problem.wrenches import (
    add_friction,
    add_products,
    add_reactions,
    share_load,
    write_contacts,
)
from pinfric.dynamics.samples.closure import check_pairs
from pinfric.dynamics.samples.reactions import AppliedWrench, part_of, reactions
from pinfric.dynamics.samples.reversals import reversals
from pinfric.dynamics.samples.states import States
from pinfric.friction.dense import affine, solve_balance
from pinfric.kernels.compiled import KernelArgument, kernel
from pinfric.model.closure import action_maps, loop_state
from pinfric.model.couples import drive_rates
from pinfric.model.loops import Linkage
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin, project


class LinkedSamples(NamedTuple):
    """A batch of samples of a linkage as functions of the friction: [:, ..., 0] + [:, ..., 1:] phi.

    Attributes:
        wrench: (n, nj, 6), RNEA of the twin: of the tree's joints without multipliers, drives off
            the joints and friction.
        X: (n, nj + pairs, 6, nx), `kinematics.act_on_joints`.
        velocity: (n, ne) along each friction coordinate (rad/s or m/s).
        reversal: (n, ns) bool, see `site_reversals`.
        effort: (n, na, 1 + ne), of the drives (N m or N).
        y: (n, ny, 1 + ne), off-joint efforts, then multipliers.
        contact: (n, nt, 1 + ne, 3), weighted contact forces of the bearings (N m or N).
        singular: (n,) bool: the drives cannot balance the load, or the closure changes rank.
    """

    wrench: np.ndarray
    X: np.ndarray
    velocity: np.ndarray
    reversal: np.ndarray
    effort: np.ndarray
    y: np.ndarray
    contact: np.ndarray
    singular: np.ndarray


def link_samples(
    argument: KernelArgument[Plan],
    scene: Scene,
    twin: Twin,
    states: States,
    applied: Sequence[AppliedWrench],
    part: slice,
    threads: int,
) -> tuple[LinkedSamples, list[np.ndarray]]:
    """Return a batch, and the velocities and accelerations (m, na) of what the drives move.

    These are of the samples `states.around` the batch.

    Args:
        argument, scene: the plan of inverse dynamics, and the scene with its loops.
        states, applied: of all samples.
        twin, part: of this batch.
        threads: of Pinocchio.

    Raises:
        LoopMotionError, StateError: see `closure.check_pairs`.
    """
    plan, linkage, n = argument.given, scene.linkage, part.stop - part.start
    assert linkage is not None
    wide, inner = states.around(part), states.inside(part)
    q, v, a = states.q[wide], states.v[wide], states.a[wide]
    state = loop_state(twin, linkage, q, v, a)
    check_pairs(linkage, state, wide, part)
    wrench = np.empty((n, twin.n_joints, 6))
    reactions(twin, states.part(part), part_of(applied, part), wrench, threads)
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
        velocity: (n, ne), see `LinkedSamples`.
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


def loop_wrenches(linkage: Linkage, X: np.ndarray, solved: np.ndarray) -> np.ndarray:
    """Return the multipliers (n, number of loops, 6) as wrenches of a on b in frame b.

    Args:
        linkage: with the loops. X: of `LinkedSamples`.
        solved: (n, ny) efforts off the joints and multipliers.
    """
    first, rows = X.shape[1] - len(linkage.pair_kind), linkage.lambdas
    loops = X[:, first : first + len(linkage.loops), :, rows]
    return np.einsum("nlkc,nc->nlk", loops, solved[:, rows])


@kernel
def map_friction(
    plan: Plan, samples: LinkedSamples, total_effort: np.ndarray, J: np.ndarray, q: np.ndarray
) -> None:
    """Write `effort`, `y` and `contact` of samples as affine functions of friction, and `singular`.

    Args:
        plan: of inverse dynamics.
        samples: all other fields of theirs are given.
        total_effort: (n, nv), M a + h.
        J: (n, nx, nv), `kinematics.act_on_joints`.
        q: (n, nq).
    """
    wrench, X, ny = samples.wrench, samples.X, samples.y.shape[1]
    joint, columns = plan.contacts.joint, samples.effort.shape[2]
    at_joints, free = np.empty((joint.size, 6, columns)), np.empty((ny, ny))
    for i in range(wrench.shape[0]):
        y, contact = samples.y[i], samples.contact[i]
        spare = _balance(plan, total_effort[i], J[i], y, free)
        for row in range(joint.size):
            _write_known_wrench(plan.entries, joint[row], wrench[i], X[i], at_joints[row])
        samples.singular[i] = spare < 0 or not add_reactions(
            plan.closure, joint, X[i], 0, free[:, :spare].copy(), y, at_joints
        )
        if samples.singular[i]:
            y[:] = contact[:] = np.nan
        else:
            write_contacts(plan, q[i], at_joints, contact)
        _write_efforts(plan.drives, plan.entries, total_effort[i], J[i], y, samples.effort[i])


@kernel
def _balance(
    plan: Plan, total_effort: np.ndarray, J: np.ndarray, y: np.ndarray, free: np.ndarray
) -> int:
    """Write y (ny, 1 + ne) of one sample, and to free (ny, ny) the columns that may be added to it.

    Returns:
        The number of these columns; -1: the drives cannot balance the load.
    """
    t, entries, (ny, columns) = plan.closure, plan.entries, y.shape
    nr = t.balanced.size
    A = np.empty((nr, ny + columns))
    for r in range(nr):
        v = t.balanced[r]
        for c in range(ny):
            A[r, c] = J[c, v]
        A[r, ny] = total_effort[v]
        for k in range(columns - 1):
            A[r, ny + 1 + k] = -_lever(entries, J, k, v)
    if solve_balance(A, t.scale, y, free) < nr:
        return -1
    spare, shifts = ny - nr, plan.drives.shifts
    if spare > 0 and shifts > 0:
        still = np.empty((ny, spare - shifts))
        if not share_work(plan.drives, entries, total_effort, J, free[:, :spare].copy(), y, still):
            return -1
        spare -= shifts
        for c in range(ny):
            for f in range(spare):
                free[c, f] = still[c, f]
    return spare


@kernel
def share_work(
    t: Drives,
    entries: Entries,
    total_effort: np.ndarray,
    J: np.ndarray,
    free: np.ndarray,
    y: np.ndarray,
    still: np.ndarray,
) -> bool:
    """Choose the free part of y so that the sum of cost u^2 over the drives is least.

    Args:
        t, entries: of the plan.
        total_effort, J: see `map_friction`.
        free: (ny, nf) what may be added to y (ny, 1 + ne).
        still: (ny, nf - shifts), overwritten: what may still be added, which changes no effort.

    Returns:
        False where the least is not unique.
    """
    (ny, nf), (na, columns) = free.shape, (t.action.size, y.shape[1])
    effort, along = np.empty((na, columns)), np.zeros((na, nf))
    _write_efforts(t, entries, total_effort, J, y, effort)
    for d in range(na):
        for f in range(nf):
            if t.velocity_index[d] < 0:
                along[d, f] = free[t.action[d], f]
            for v in range(J.shape[1]):
                for c in range(ny if t.delivery[d, v] != 0.0 else 0):
                    along[d, f] -= t.delivery[d, v] * J[c, v] * free[c, f]
    return share_load(effort, along, t.cost, free, y, still) == t.shifts


@kernel
def _lever(entries: Entries, J: np.ndarray, k: int, v: int) -> float:
    """The generalized effort at velocity v of one unit of an entry's friction."""
    if entries.action[k] >= 0:
        return J[entries.action[k], v]
    return entries.ratio[k] if entries.velocity_index[k] == v else 0.0


@kernel
def _write_efforts(
    t: Drives,
    entries: Entries,
    total_effort: np.ndarray,
    J: np.ndarray,
    y: np.ndarray,
    effort: np.ndarray,
) -> None:
    """Write the drives' efforts (na, 1 + ne) of one sample."""
    for d in range(effort.shape[0]):
        for k in range(effort.shape[1]):
            effort[d, k] = y[t.action[d], k] if t.velocity_index[d] < 0 else 0.0
        for v in range(J.shape[1]):
            if t.delivery[d, v] == 0.0:
                continue
            for k in range(effort.shape[1]):
                total = total_effort[v] if k == 0 else -_lever(entries, J, k - 1, v)
                for c in range(y.shape[0]):
                    total -= J[c, v] * y[c, k]
                effort[d, k] += t.delivery[d, v] * total


@kernel
def _write_known_wrench(
    entries: Entries, j: int, wrench: np.ndarray, X: np.ndarray, out: np.ndarray
) -> None:
    """Write the wrench at joint j (6, 1 + ne), [:, 0] + [:, 1:] phi, without the part of y."""
    for e in range(6):
        for k in range(out.shape[1]):
            out[e, k] = 0.0
        if j < wrench.shape[0]:
            out[e, 0] = wrench[j, e]
    add_friction(X[j], entries.action, out)


@kernel
def write_site_wrenches(
    plan: Plan,
    samples: LinkedSamples,
    phi: np.ndarray,
    site_wrench: np.ndarray,
    solved: np.ndarray,
) -> None:
    """Write the wrench at each site, and y, under friction phi (n, ne).

    Args:
        plan, samples: see `map_friction`.
        phi: (n, ne).
        site_wrench: (n, ns, 6), overwritten, parent on child or a on b.
        solved: (n, ny), overwritten.
    """
    wrench, X, y, joint = samples.wrench, samples.X, samples.y, plan.sites.joint
    maps = np.empty((6, y.shape[2]))
    for i in range(phi.shape[0]):
        affine(y[i], phi[i], solved[i])
        for s in range(joint.size):
            _write_known_wrench(plan.entries, joint[s], wrench[i], X[i], maps)
            add_products(X[i, joint[s]], 0, y[i], maps)
            affine(maps, phi[i], site_wrench[i, s])
