"""Joints that move no mass: of a link without an <inertial>, or of a point mass on the axis.

No effort determines the motion of such a joint: it can be neither simulated nor sized. Results of
other joints do not depend on it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from pinfric.model.closure import action_maps, velocity_names
from pinfric.model.mass_matrix import link_poses, mass_matrices
from pinfric.model.scene import Scene

#: Of the largest inertia of any joint.
_NO_MASS = 1e-12
#: Postures beside the start that are tried.
_POSTURES = 8


def massless(scene: Scene, attached: Iterable[str] | None = None) -> np.ndarray:
    """Return (nv,) bool: which velocities move no mass, M_jj <= 1e-12 max M in all postures tried.

    M holds the model's armatures and the drives' rotors, ratio^2 times. A joint that moves other
    masses by a loop, a cylinder or a force does not count. `attached`: see `Scene.solver`.
    """
    twin, model = scene.twin(attached), scene.model
    rng, start = np.random.default_rng(0), scene.start_configuration
    rotors = np.array(twin.armature)
    for drive in scene.drives:
        if drive.transmission is not None and drive.velocity_index >= 0:
            gear = drive.transmission
            rotors[drive.velocity_index] += gear.rotor_inertia * gear.ratio**2

    if twin.nv == 0:
        return np.zeros(0, dtype=bool)

    def without(q: np.ndarray) -> np.ndarray:
        own = np.diagonal(mass_matrices(twin, q), axis1=1, axis2=2) + rotors
        still: np.ndarray = (own <= _NO_MASS * own.max()).all(axis=0)
        return still

    if not without(start[None]).any():
        return np.zeros(twin.nv, dtype=bool)
    away = rng.uniform(-np.pi, np.pi, (_POSTURES, twin.nv))
    q = np.array([start, *(pin.integrate(model, start, one) for one in away)])
    still = without(q)
    if scene.linkage is not None and still.any():
        rows = action_maps(twin, scene.linkage, *link_poses(twin, q))[1]
        still &= ~rows.any(axis=(0, 1))
    return still


def massless_joints(scene: Scene, attached: Iterable[str] | None = None) -> tuple[str, ...]:
    """Return the names of what moves no mass; see `massless`."""
    names = velocity_names(scene.model)
    return tuple(names[k] for k in np.flatnonzero(massless(scene, attached)))
