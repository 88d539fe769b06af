"""Mobility of a scene: degrees of freedom, undriven velocities, redundant drives.

Loops allow the velocities with J_c v = 0. A velocity at which all rates S v of drives are 0 is
undriven. A drive without which [J_c; S] has the same rank is redundant
(`notebooks/theory/problem.md`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space

from pinfric.errors import SceneError
from pinfric.model.closure import (
    NEARLY_CLOSED,
    RANK,
    LoopState,
    action_maps,
    closed_configurations,
    full_pivot,
    loop_state,
    velocity_names,
)
from pinfric.model.drives import Drive
from pinfric.model.loops import Linkage, loop_place
from pinfric.model.twin import Twin


@dataclass(frozen=True)
class Mobility:
    """Degrees of freedom and how they are driven.

    Attributes:
        freedoms: number of degrees of freedom that the loops allow.
        undriven: velocities that no drive moves, one for each undriven degree of freedom.
        redundant: indices of the redundant drives.
    """

    freedoms: int
    undriven: tuple[int, ...]
    redundant: tuple[int, ...]

    def counts(self, drives: int) -> str:
        """Return the numbers of drives and of degrees of freedom as a text."""
        return f"{drives} for {self.freedoms} degree{'' if self.freedoms == 1 else 's'} of freedom"


def mobility_of_tree(nv: int, drives: Sequence[Drive]) -> Mobility:
    """Return the mobility of an open chain with drives on its joints."""
    on = [drive.velocity_index for drive in drives]
    undriven = tuple(v for v in range(nv) if v not in on)
    return Mobility(nv, undriven, tuple(d for d, v in enumerate(on) if on.count(v) > 1))


def mobility_of_linkage(
    twin: Twin,
    linkage: Linkage,
    drives: Sequence[Drive],
    start: np.ndarray,
    source: str,
    doubts: Mapping[str, str],
) -> Mobility:
    """Return the mobility of a scene with loops, cylinders or forces.

    The loops close near `start` (nq,); other configurations are used as well, because it may be
    singular. `doubts` are those of `alignment.Alignment`.

    Raises:
        SceneError: a loop that cannot close, a planar pin whose axes are not parallel.
    """
    freedoms, best = twin.nv, -1
    undriven: list[int] = []
    redundant: list[int] = []
    scale = min(1.0, linkage.size)
    for q in closed_configurations(twin, linkage, start, source, doubts):
        rows, gaps, state = _held_rows(twin, linkage, drives, q)
        for row, loop in enumerate(linkage.loops):
            if loop.kind == "planar_pin" and state.tilt[0, row] > NEARLY_CLOSED:
                raise SceneError(
                    f"{source}: {loop_place(linkage.loops, loop.name)}: the axes of its sides "
                    f"differ by {state.tilt[0, row]:.3g} rad; "
                    + doubts.get(
                        loop.name,
                        "a planar_pin turns about the axis that all joints of its loop turn about: "
                        "give it as `axis`, in frame a",
                    )
                )
        rank_closed, (rank, order) = full_pivot(rows[:gaps], scale)[0], full_pivot(rows, scale)
        freedoms = min(freedoms, twin.nv - rank_closed)
        if rank > best:
            best, undriven = rank, sorted(order[rank:])
            several = len(drives) > rank - rank_closed
            count = len(drives) if several else 0
            without = [np.delete(rows, gaps + d, axis=0) for d in range(count)]
            redundant = [
                d for d, others in enumerate(without) if full_pivot(others, scale)[0] == rank
            ]
    return Mobility(freedoms, tuple(undriven), tuple(redundant))


def loose_bodies(
    twin: Twin, linkage: Linkage, drives: Sequence[Drive], start: np.ndarray, source: str
) -> list[str]:
    """Return the joints whose bodies can move while drives and all other bodies stand still.

    Such is a rod between two balls. Args: see `mobility_of_linkage`.
    """
    model = twin.model
    q = closed_configurations(twin, linkage, start, source, {}, wanted=1)[0]
    U = null_space(_held_rows(twin, linkage, drives, q)[0], rcond=RANK)
    if not U.shape[1]:
        return []
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    heavy = [j for j in range(1, model.njoints) if model.inertias[j].mass > 0.0]
    moves = {j: pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL) @ U for j in heavy}
    loose = []
    for body in heavy:
        others = [np.zeros((1, U.shape[1])), *(moves[j] for j in heavy if j != body)]
        _, size, V = np.linalg.svd(np.concatenate(others))
        alone = V[int(np.sum(size > NEARLY_CLOSED)) :].T
        if np.abs(moves[body] @ alone).max(initial=0.0) > NEARLY_CLOSED:
            loose.append(str(model.names[body]))
    return loose


def _held_rows(
    twin: Twin, linkage: Linkage, drives: Sequence[Drive], q: np.ndarray
) -> tuple[np.ndarray, int, LoopState]:
    """The rates of loops' gaps and of drives per velocity, how many are gaps, and how pairs are."""
    zero = np.zeros((1, twin.nv))
    state = loop_state(twin, linkage, q[None], zero, zero)
    J = action_maps(twin, linkage, state.p, state.R)[1][0]
    S = [
        J[drive.column] if drive.velocity_index < 0 else np.eye(twin.nv)[drive.velocity_index]
        for drive in drives
    ]
    closed = J[linkage.lambdas]
    return np.concatenate([closed, np.array(S).reshape(-1, twin.nv)]), len(closed), state


def lightest_joint(model: pin.Model, mass: np.ndarray, closed: np.ndarray) -> str:
    """Return the name of the velocity with the largest part in the lightest motion.

    That is the eigenvector of the least eigenvalue of N^T M N: M (nv, nv), singular, is scaled to a
    diagonal of ones, N are the motions that the loops' rows `closed` (m, nv) allow.
    """
    own = np.diag(mass)
    scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
    N = null_space(closed * scale) if len(closed) else np.eye(len(mass))
    motion = N @ np.linalg.eigh(N.T @ (scale[:, None] * mass * scale) @ N)[1][:, 0]
    return velocity_names(model)[int(np.argmax(np.abs(motion)))]
