"""The state in which the `simulation` section of a scene file starts."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.samples.closure import consistent_motion, independent_joints
from pinfric.errors import ClosureError, SceneError, choose_from
from pinfric.model.closure import closed_configurations, velocity_indices, velocity_names
from pinfric.model.coordinates import motion_columns
from pinfric.model.scene import Scene
from pinfric.model.schema import Start


def start_state(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return (nq,) and (nv,) of `simulation.start`; joints not named are at 0 and at rest.

    With loops `start` gives the driven joints, and the configuration near which the others follow.

    Raises:
        SceneError: no such section; an unknown joint, or one of several degrees of freedom; loops
            do not close near there.
        ClosureError: the loops do not determine how all joints move.
    """
    if scene.simulation is None:
        raise SceneError(
            f"{scene.source}: has no `simulation` section; add one with start, effort and t_end, "
            "or give q0 and v0"
        )
    v0 = np.zeros(scene.model.nv)
    start = scene.simulation.start
    single = [
        name
        for name, joint in zip(scene.joint_names, scene.model.joints[1:], strict=True)
        if joint.nv == 1
    ]
    for section, entries in (("q", start.q), ("v", start.v)):
        for name in entries:
            if name not in single:
                raise SceneError(
                    f"{scene.source}: simulation.start.{section}: there is no one-degree joint "
                    f"{name!r}; {choose_from(name, single)}"
                )
    for name, rate in start.v.items():
        v0[scene.model.joints[scene.model.getJointId(name)].idx_v] = rate
    if not scene.loops:
        return scene.start_configuration, v0
    return _closed_start(scene, start, v0)


def _closed_start(scene: Scene, start: Start, v0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The start of a scene with loops: closed, moving as its independent joints do."""
    names, freedoms = velocity_names(scene.model), scene.mobility.freedoms
    driven = [names[d.velocity_index] for d in scene.drives if d.velocity_index >= 0]
    driven = list(dict.fromkeys([*driven, *start.q]))[:freedoms]
    try:
        q0 = scene.close(scene.start_configuration, driven)
    except ClosureError:  # what is driven cannot stay where it is: let all joints move
        try:
            q0 = scene.close(scene.start_configuration)
        except ClosureError as problem:
            raise SceneError(_where_it_closes(scene, problem)) from None
    if not v0.any():
        return q0, v0
    others = independent_joints(scene, q0)
    leading = list(dict.fromkeys([*start.v, *driven, *others]))[:freedoms]
    rates = np.array([[v0[velocity_indices(scene.model, [n], "start")[0]] for n in leading]])
    v, _ = consistent_motion(scene, q0[None], leading, rates, np.zeros_like(rates))
    return q0, v[0]


def _where_it_closes(scene: Scene, problem: ClosureError) -> str:
    """Say that the loops do not close near the start, and where they do."""
    assert scene.linkage is not None
    start = scene.start_configuration
    q = closed_configurations(scene.twin(), scene.linkage, start, scene.source, {}, wanted=1)
    none = np.zeros((1, scene.model.nv))
    columns = motion_columns(scene.model, np.array(q), none, none)
    at = [f"{name[:-2]}: {value[0]:.3g}" for name, value in columns.items() if name[-2:] == ".q"]
    return (
        f"{scene.source}: simulation.start: loop {problem.loop!r} does not close near it "
        f"({problem.residual:.3g} m apart); give a closer `q`, e.g. {{{', '.join(at)}}}"
    )
