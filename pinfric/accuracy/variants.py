"""Scenes with less friction than they have, and how far their efforts then differ."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import MotionLike, attached_columns
from pinfric.model.effects import with_effects
from pinfric.model.friction_terms import CoulombFriction, LoadFriction
from pinfric.model.scene import Scene
from pinfric.model.schema import Friction
from pinfric.motions.summary import ends_by_magnitude, known_rms

#: A coefficient so small that the load it reports is that without friction.
_HARDLY = 1e-9


@dataclass(frozen=True, eq=False)
class Efforts:
    """(T, na) ends of the efforts at the joints and at the motors' shafts.

    t: (T,) times in s, or None: states without order.
    """

    lower: np.ndarray
    upper: np.ndarray
    motor_lower: np.ndarray
    motor_upper: np.ndarray
    t: np.ndarray | None

    @classmethod
    def of(cls, r: InverseResult) -> Efforts:
        """Return the efforts of a result."""
        return cls(r.effort_lower, r.effort_upper, r.motor_torque_lower, r.motor_torque_upper, r.t)


def solve(scene: Scene, motion: MotionLike) -> InverseResult:
    """Return inverse dynamics on one thread; the motion's payloads as it carries them."""
    attached = attached_columns(scene, motion)
    return inverse_dynamics(
        scene, motion.q, motion.v, motion.a, t=motion.t, attached=attached, threads=1
    )


def fitted_constants(result: InverseResult) -> dict[str, float]:
    """Return for each site the constant nearest to its friction while it slides (N m or N).

    The F of least squares in phi = -sign(v) F: the mean of |phi|; 0 where it never slides.
    """
    slides = ~(result.sticking | result.reversal)
    size = 0.5 * np.abs(result.friction_lower + result.friction_upper)
    count = np.maximum(slides.sum(axis=0), 1)
    means = np.nansum(np.where(slides, size, 0.0), axis=0) / count
    return dict(zip(result.site_names, means.tolist(), strict=True))


def with_constant_friction(scene: Scene, constants: Mapping[str, float]) -> Scene:
    """Return the scene with constant friction only, ideal drives and its payloads.

    Args:
        scene: stays as it is.
        constants: site -> friction, static as kinetic (N m or N).
    """
    friction = {
        name: Friction(coulomb=CoulombFriction(static=F, kinetic=F))
        for name, F in constants.items()
        if F > 0.0
    }
    return dataclasses.replace(with_effects(scene, only=["payload"]), friction=friction)


def hardly_rubbing(scene: Scene) -> Scene:
    """Return the scene with coefficients so small that loads are those without friction."""
    friction = {
        name: entry.model_copy(update={"mu": LoadFriction(static=_HARDLY, kinetic=_HARDLY)})
        if entry.mu is not None
        else entry
        for name, entry in scene.friction.items()
    }
    return dataclasses.replace(scene, friction=friction)


def one_pass(radial: Scene, motion: MotionLike) -> Efforts:
    """Return efforts with loads without friction, friction from them, and no look back.

    What coupling corrects. Efforts are linear in friction: a site's share comes from a constant at
    that site alone. Kinetic friction, also at sites that stick.

    Args:
        radial: a scene whose only friction is that of loads.
        motion: with t, q, v, a.
    """
    plain = solve(with_effects(radial, only=["payload"]), motion)
    loads = solve(hardly_rubbing(radial), motion).normal_load
    efforts = plain.effort_lower.copy()
    for s, name in enumerate(radial.site_names):
        mu = radial.friction[name].mu
        if mu is None:
            continue
        alone = solve(with_constant_friction(radial, {name: 1.0}), motion)
        unit = 0.5 * (alone.effort_lower + alone.effort_upper) - plain.effort_lower
        efforts += unit * mu.kinetic * loads[:, s : s + 1]
    return Efforts(efforts, efforts, efforts, efforts, plain.t)


def effort_change(
    scene: Scene, here: Efforts, below: Efforts, motor: bool
) -> tuple[float, float, str]:
    """Changes of peak and RMS of the worst end, of the drive where its RMS changes most."""
    peaks, rms = effort_changes(here, below, motor)
    i = int(np.argmax(np.abs(rms)))
    return float(peaks[i]), float(rms[i]), scene.actuator_names[i]


def effort_changes(here: Efforts, below: Efforts, motor: bool) -> tuple[np.ndarray, np.ndarray]:
    """Changes (na,) of peak and of RMS of the worst end of every drive's effort."""
    worst = [
        ends_by_magnitude(*((e.motor_lower, e.motor_upper) if motor else (e.lower, e.upper)))[0]
        for e in (here, below)
    ]
    peaks = [np.nanmax(np.abs(w), axis=0) for w in worst]
    rms = [known_rms(e.t, w) for e, w in zip((here, below), worst, strict=True)]
    return peaks[0] - peaks[1], rms[0] - rms[1]
