"""Trajectory files of closed mechanisms: they name independent joints, loops move the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pinfric.dynamics.samples.closure import (
    complete_configurations,
    consistent_motion,
    first_closed,
    independent_joints,
)
from pinfric.errors import ClosureError, TrajectoryError
from pinfric.model.arrays import FloatArray
from pinfric.model.closure import NEARLY_CLOSED, close
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import JointColumn, configurations

#: rad, or share of the mechanism's size: what measured positions may miss a closed loop by.
_MEASURED = 1e-2


def named_columns(
    scene: object, columns: Sequence[JointColumn], names: Sequence[str], problems: list[str]
) -> tuple[JointColumn, ...]:
    """Return the joints that a file has columns for: all, or with loops the independent ones.

    Args:
        columns: (nj,) all joints. names: in the file; unknown ones are refused elsewhere.
        problems: a wrong number of joints is appended here.
    """
    if not isinstance(scene, Scene) or not scene.loops:
        return tuple(columns)
    named = tuple(column for column in columns if column.name in names)
    freedom = scene.mobility.freedoms
    if len(named) not in (freedom, len(columns)):
        problems.append(
            f"names {len(named)} joint{'' if len(named) == 1 else 's'} "
            f"({', '.join(c.name for c in named) or 'none'}); the loops leave {freedom} "
            f"independent: name {freedom}, or all {len(columns)} of "
            f"{', '.join(c.name for c in columns)}"
        )
        return tuple(columns)
    return named


class Completed(NamedTuple):
    """A motion of all joints: q (T, nq), v, a (T, nv).

    `assembly`: the start that a search chose among those that close, in words; empty: none did.
    """

    q: FloatArray
    v: FloatArray
    a: FloatArray
    assembly: str = ""


def complete_motion(
    scene: Scene,
    source: str,
    columns: Sequence[JointColumn],
    named: Sequence[JointColumn],
    position: FloatArray,
    v: FloatArray,
    a: FloatArray,
    derived: bool,
    warnings: list[str],
) -> Completed:
    """Return the motion of all joints from that of the named ones.

    The first configuration is the one nearest to the scene's `simulation.start`. Where all joints
    are named and derivatives come from their positions, the independent ones move the others,
    because measured positions close no loop exactly. Else all that was given stays.

    Args:
        columns, named: (nj,) all joints, (k,) those in the file.
        position, v, a: (T, k) rad or m, and per second. derived: some of v, a came from splines.
        warnings: how far positions were moved is appended here.

    Raises:
        TrajectoryError: a sample at which loops cannot close, or do not determine the other joints.
    """
    model, names = scene.model, [column.name for column in named]
    q = configurations(named, position, model.nq)
    try:
        if len(named) < len(columns):
            start, searched = first_closed(scene, scene.start_configuration, names, q[0])
            assembly = _where_it_begins(columns, names, start) if searched else ""
            warnings += [assembly] * searched
            q = complete_configurations(scene, start, names, q)
            return Completed(q, *consistent_motion(scene, q, names, v, a), assembly)
        if not derived:
            return Completed(q, v, a)
        chosen = independent_joints(scene, q[0])
        index = [names.index(name) for name in chosen]
        q = _closed(scene, columns, chosen, q, warnings)
        return Completed(q, *consistent_motion(scene, q, chosen, v[:, index], a[:, index]))
    except ClosureError as problem:
        raise TrajectoryError(f"{source}: {problem}") from None


def _where_it_begins(columns: Sequence[JointColumn], named: Sequence[str], q: FloatArray) -> str:
    others = [c for c in columns if c.name not in named]
    places = ", ".join(f"{c.name}: {q[c.index_q]:.3g}" for c in others)
    return (
        "loops do not close near `simulation.start`; a search found that they do with "
        f"simulation: {{start: {{q: {{{places}}}}}}}: another assembly needs a start of its own"
    )


def _closed(
    scene: Scene,
    columns: Sequence[JointColumn],
    independent: Sequence[str],
    q: FloatArray,
    warnings: list[str],
) -> FloatArray:
    """Return q (T, nq) with loops closed by dependent joints; unchanged if by much."""
    linkage, twin = scene.linkage, scene.twin()
    assert linkage is not None
    held = np.zeros(twin.nv, dtype=bool)
    held[[column.index_v for column in columns if column.name in independent]] = True
    try:
        closed = np.array([close(twin, linkage, x, held, i) for i, x in enumerate(q)])
    except ClosureError:  # the check of the motion says where and by how much
        return q
    moved = np.abs(closed - q)
    sliding = [column.index_q for column in columns if column.unit == "m"]
    moved[:, sliding] /= linkage.size
    if (largest := float(moved.max(initial=0.0))) > _MEASURED:
        return q
    if largest > NEARLY_CLOSED:
        worst = columns[int(np.argmax([moved[:, c.index_q].max() for c in columns]))]
        by = float(np.abs(closed - q)[:, worst.index_q].max())
        warnings.append(
            f"loops closed by correcting joints, {worst.name} most, by up to {by:.1e} "
            f"{worst.unit}; {' and '.join(independent)} as in the file"
        )
    return closed
