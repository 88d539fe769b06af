"""Which motions of a scene its drives move: freedoms, undriven velocities, redundant drives.

Loops leave the velocities v with J_c v = 0; drives of rates S v move those of them that some row of
S sees. A drive without which [J_c; S] has the same rank is redundant: how it shares the work with
others does not follow from a motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.errors import SceneError
from pinfric.model.closure import (
    NEARLY_CLOSED,
    action_maps,
    closed_configurations,
    full_pivot,
    loop_state,
)
from pinfric.model.drives import Drive
from pinfric.model.loops import Linkage, loop_place
from pinfric.model.twin import Twin


@dataclass(frozen=True)
class Mobility:
    """What moves, and what moves it.

    Attributes:
        freedoms: degrees of freedom that the loops leave.
        undriven: velocities that no drive moves, as many as freedoms are undriven.
        redundant: places of the drives whose part in the work a motion leaves open.
    """

    freedoms: int
    undriven: tuple[int, ...]
    redundant: tuple[int, ...]

    def counts(self, drives: int) -> str:
        """Say how many drives there are for how many freedoms."""
        return f"{drives} for {self.freedoms} degree{'' if self.freedoms == 1 else 's'} of freedom"


def mobility_of_tree(nv: int, drives: Sequence[Drive]) -> Mobility:
    """Find what drives on the joints of an open chain move."""
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
    """Find what the drives of a scene with loops, cylinders or forces move.

    Args:
        twin, linkage: the robot, its loops and drives off the joints.
        drives: all of the scene.
        start: (nq,) a configuration near which the loops close; others are looked at besides, so
            that none is special.
        source: the scene, for messages.
        doubts: loop -> which of its axes are nearly parallel (`alignment.Alignment`).

    Raises:
        SceneError: a loop that cannot close, a planar pin whose axes are nearly parallel.
    """
    freedoms, best = twin.nv, -1
    undriven: list[int] = []
    redundant: list[int] = []
    scale = min(1.0, linkage.size)
    for q in closed_configurations(twin, linkage, start, source, doubts):
        zero = np.zeros((1, twin.nv))
        state = loop_state(twin, linkage, q[None], zero, zero)
        for row, loop in enumerate(linkage.loops):
            if (
                loop.kind == "planar_pin"
                and loop.name in doubts
                and (state.tilt[0, row] > NEARLY_CLOSED)
            ):
                raise SceneError(
                    f"{source}: {loop_place(linkage.loops, loop.name)}: the axes of its sides "
                    f"differ by {state.tilt[0, row]:.3g} rad; {doubts[loop.name]}"
                )
        J = action_maps(twin, linkage, state.p, state.R)[1][0]
        S = [
            J[drive.column] if drive.velocity_index < 0 else np.eye(twin.nv)[drive.velocity_index]
            for drive in drives
        ]
        closed = J[linkage.lambdas]
        rows = np.concatenate([closed, np.array(S).reshape(-1, twin.nv)])
        rank_closed, (rank, order) = full_pivot(closed, scale)[0], full_pivot(rows, scale)
        freedoms = min(freedoms, twin.nv - rank_closed)
        if rank > best:
            best, undriven = rank, sorted(order[rank:])
            several = len(S) > rank - rank_closed
            without = [np.delete(rows, len(closed) + d, axis=0) for d in range(len(S) * several)]
            redundant = [
                d for d, others in enumerate(without) if full_pivot(others, scale)[0] == rank
            ]
    return Mobility(freedoms, tuple(undriven), tuple(redundant))
