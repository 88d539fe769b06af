"""Published friction of a robot beside what was identified of it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.identification.findings import Findings
from pinfric.identification.recordings import STILL
from pinfric.model.arrays import FloatArray
from pinfric.model.described import EFFORT, derived, described, quantity
from pinfric.model.scene import Scene
from pinfric.model.scene_file import load_scene, measured_scenes
from pinfric.motions.log.judged import measured_interval
from pinfric.motions.summary import effort_unit

#: So many samples of each log are compared at most.
_SAMPLES = 1000
#: Links whose masses differ by less are those of the same robot.
_MASS = 0.05


@described
class BesidePublished:
    """Friction of one joint as identified and as published, in the same states.

    mean |friction| over the logs' samples in which the joint moves, no faster than the published
    figures were measured.
    """

    name: str = quantity("the joint", heading="joint", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    scene: str = quantity("bundled scene with the published figures", heading="published\nin")
    grade: str = quantity("how well they are documented, A to C", heading="grade")
    published: float = quantity("mean friction by them", EFFORT, "published")
    found: float = quantity("mean friction as identified", EFFORT, "here")

    @property
    @derived(heading="ratio", cell="{ratio:.2f}")
    def ratio(self) -> float:
        """Identified over published."""
        return self.found / self.published if self.published else float("nan")


def beside_published(found: Findings) -> tuple[BesidePublished, ...]:
    """Return what is published of the robot's friction beside what was found, joint by joint.

    A robot is known by its URDF: the joints' names, and either its own name or its links' masses.
    """
    rows = []
    for name, other in _known(found.estimate.question.scene).items():
        measured = other.measured
        assert measured is not None
        for j, joint in enumerate(found.scene.joint_names):
            top = measured.top_speed(joint)
            if joint not in other.friction or joint not in found.laws:
                continue
            here, there = _mean_friction(found, other, j, np.inf if top is None else top)
            if np.isfinite(here):
                unit = effort_unit(found.scene, j)
                rows.append(BesidePublished(joint, unit, name, measured.grade, there, here))
    return tuple(sorted(rows, key=lambda row: found.scene.joint_names.index(row.name)))


def _known(scene: Scene) -> dict[str, Scene]:
    """The bundled scenes of a robot."""

    def masses(one: Scene) -> FloatArray:
        return np.array([inertia.mass for inertia in one.model.inertias])

    return {
        name: other
        for name, other in _measured().items()
        if other.joint_names == scene.joint_names
        and (
            scene.model.name in (name, other.model.name)
            or np.allclose(masses(scene), masses(other), rtol=_MASS, atol=1e-9)
        )
    }


@cache
def _measured() -> dict[str, Scene]:
    return {name: load_scene(name) for name in measured_scenes()}


def _mean_friction(found: Findings, other: Scene, joint: int, top: float) -> tuple[float, float]:
    """Mean |friction| of a joint that moves, by two scenes; NaN where it never moves so slowly."""
    at, here, there = found.estimate.question.at, list[FloatArray](), list[FloatArray]()
    for recording in found.recordings:
        speed = np.abs(recording.velocity[:, joint])
        moving = np.flatnonzero((speed > STILL) & (speed <= top))
        picked = moving[:: max(1, moving.size // _SAMPLES)]
        if not picked.size:
            continue
        motion = recording.trajectory
        q, v, carried = motion.q[picked], motion.v[picked], motion.attached[picked]
        for scene, attached, into in ((found.scene, carried, here), (other, None, there)):
            still = replace(scene, measured=None)  # no acceleration: without rotors' inertia
            result = inverse_dynamics(still, q, v, np.zeros_like(v), attached=attached)
            friction = measured_interval(result, at)[0] - result.effort_frictionless
            into.append(np.abs(friction[:, joint]))
    if not here:
        return float("nan"), float("nan")
    return float(np.concatenate(here).mean()), float(np.concatenate(there).mean())
