"""Trajectory files of closed mechanisms: they name independent joints, the loops move the rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pinfric.dynamics.closure import (
    complete_configurations,
    consistent_motion,
    independent_joints,
)
from pinfric.errors import ClosureError, TrajectoryError
from pinfric.model.scene import Scene
from pinfric.study.joint_columns import JointColumn, configurations

FloatArray = NDArray[np.float64]


def named_columns(
    scene: object, columns: Sequence[JointColumn], names: Sequence[str], problems: list[str]
) -> tuple[JointColumn, ...]:
    """Return the joints that a file has columns for: all, or with loops the independent ones.

    Args:
        scene: only a `Scene` with loops lets a file leave joints out.
        columns: (nj,) all joints.
        names: what the file names, unknown names included (they are refused elsewhere).
        problems: a wrong number of joints is appended here.
    """
    if not isinstance(scene, Scene) or not scene.loops:
        return tuple(columns)
    named = tuple(column for column in columns if column.name in names)
    freedom = len(scene.drives)  # one drive per degree of freedom, checked when the scene was made
    if len(named) not in (freedom, len(columns)):
        problems.append(
            f"names {len(named)} joint{'' if len(named) == 1 else 's'} "
            f"({', '.join(c.name for c in named) or 'none'}); the loops leave {freedom} "
            f"independent: name {freedom}, or all {len(columns)} of "
            f"{', '.join(c.name for c in columns)}"
        )
        return tuple(columns)
    return named


def complete_motion(
    scene: Scene,
    source: str,
    columns: Sequence[JointColumn],
    named: Sequence[JointColumn],
    position: FloatArray,
    v: FloatArray,
    a: FloatArray,
    derived: bool,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return q (T, nq), v, a (T, nv) of all joints from those of the named ones.

    The first configuration is the one nearest to `simulation.start` of the scene. Where all joints
    are named their positions stay, and derivatives that a spline gave are made consistent.

    Args:
        scene: with loops.
        source: the file, for messages.
        columns, named: (nj,) all joints, (k,) those in the file.
        position, v, a: (T, k) rad or m, and per second.
        derived: some of v, a came from splines.

    Raises:
        TrajectoryError: a sample at which the loops cannot close, or do not determine the rest.
    """
    model, names = scene.model, [column.name for column in named]
    q = configurations(named, position, model.nq)
    try:
        if len(named) < len(columns):
            q = complete_configurations(scene, scene.start_configuration, names, q)
            return q, *consistent_motion(scene, q, names, v, a)
        if not derived:
            return q, v, a
        chosen = independent_joints(scene, q[0])
        index = [names.index(name) for name in chosen]
        return q, *consistent_motion(scene, q, chosen, v[:, index], a[:, index])
    except ClosureError as problem:
        raise TrajectoryError(f"{source}: {problem}") from None
