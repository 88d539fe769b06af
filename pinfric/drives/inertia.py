"""Inertias about the drives' joints over a motion."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import States
from pinfric.model.couples import delivery, taking_part
from pinfric.model.mass_matrix import mass_matrices
from pinfric.model.scene import Scene


def load_inertias(result: InverseResult) -> np.ndarray:
    """Return (na,) the largest `joint_inertias` over a motion."""
    return joint_inertias(result.scene, result.states).max(axis=0)


def joint_inertias(scene: Scene, states: States) -> np.ndarray:
    """Return (T, na) M_jj(q): the inertia about each drive's joint, kg m^2 (kg).

    Payloads count while they are carried; rotors (Pinocchio's armature) do not. Of coupled drives
    it is (P M P^T)_jj: what moves with one while the others stand.
    """
    own = np.array([drive.velocity_index for drive in scene.drives], dtype=np.int64)
    P, inertia = delivery(scene.drives, scene.model.nv), np.empty((len(states.q), len(own)))
    for start, stop, carried in states.phases(scene):
        mass = mass_matrices(scene.twin(carried), states.q[start:stop])
        inertia[start:stop] = mass[:, own, own]
        for d in taking_part(scene.drives):  # v^T M v of what moves while the others stand
            inertia[start:stop, d] = np.einsum("a,nab,b->n", P[d], mass[:, own][:, :, own], P[d])
    return inertia
