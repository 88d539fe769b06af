"""The drives' own coordinates u, and inertias about them: v = B u, alike in chains and loops.

    [J_c; D] B = [0; 1],      dv/dt = B du/dt + gamma,      [J_c; D] gamma = -[dJ_c/dt; dD/dt] v

with the loops' Jacobian J_c and the drives' rates D v, both at the joints' velocities v. Whatever
no drive moves has coordinates of its own behind those of the drives.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import States
from pinfric.model.closure import RANK, action_maps, loop_state
from pinfric.model.couples import delivery, rate_rows
from pinfric.model.mass_matrix import link_poses, mass_matrices
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin

#: By how much rates of drives that B gives may miss 1.
_SOLVED = 1e-6


def load_inertias(result: InverseResult) -> np.ndarray:
    """Return (na,) the largest `joint_inertias` over a motion; NaN: not known."""
    return joint_inertias(result.scene, result.states).max(axis=0)


def joint_inertias(scene: Scene, states: States) -> np.ndarray:
    """Return (T, na) the inertia about each drive's joint, kg m^2 (kg): (B^T M B)_jj.

    It is that of all that moves with one drive while the others stand; in an open chain without
    couples M_jj. Payloads count while they are carried; rotors (Pinocchio's armature) do not. NaN:
    drives of a loop do not determine its motion.
    """
    return np.einsum("tdd->td", drive_inertias(scene, states)).copy()


def drive_inertias(scene: Scene, states: States) -> np.ndarray:
    """Return B^T M B (T, na, na), what the drives feel together; as of `joint_inertias`."""
    count = len(scene.drives)
    inertia = np.empty((len(states.q), count, count))
    for start, stop, carried in states.phases(scene):
        q, twin = states.q[start:stop], scene.twin(carried)
        B = DriveCoordinates.of(scene, twin, q).directions[:, :, :count]
        inertia[start:stop] = B.transpose(0, 2, 1) @ mass_matrices(twin, q) @ B
    return inertia


@dataclass(frozen=True)
class DriveCoordinates:
    """The drives' coordinates at n configurations (see the module).

    Attributes:
        directions: B (n, nv, na + nf): velocities of the joints at unit rate of each drive, the
            others at rest, then in motions of which no drive knows. NaN: drives do not determine
            them (a dead centre, or several drives of one motion).
    """

    scene: Scene
    twin: Twin
    q: np.ndarray
    directions: np.ndarray
    _inverse: np.ndarray

    @classmethod
    def of(cls, scene: Scene, twin: Twin, q: np.ndarray) -> DriveCoordinates:
        """Return them at configurations (n, nq) of a scene's twin with its payloads."""
        drives, nv = scene.drives, scene.model.nv
        if scene.linkage is None:
            own = [drive.velocity_index for drive in drives]
            along = np.eye(nv)[own + [k for k in range(nv) if k not in own]]
            if (P := delivery(drives, nv)).size:
                along[np.ix_(range(len(own)), own)] = P
            return cls(scene, twin, q, np.tile(along.T, (len(q), 1, 1)), np.empty(0))
        # 1. The rows [J_c; D], of configurations that differ
        moved = np.append(True, (q[1:] != q[:-1]).any(axis=1))
        J = action_maps(twin, scene.linkage, *link_poses(twin, q[moved]))[1]
        D = np.tile(rate_rows(drives, nv), (len(J), 1, 1))
        for d, drive in enumerate(drives):
            if drive.velocity_index < 0:
                D[:, d] += J[:, drive.column]
        rows = np.concatenate([J[:, scene.linkage.lambdas], D], axis=1)
        # 2. Their pseudo-inverse, and what they leave free
        U, size, V = np.linalg.svd(rows)
        known = size > RANK * size[:, :1]
        scale = np.where(known, 1.0 / np.where(known, size, 1.0), 0.0)
        n = size.shape[1]
        inverse = (V[:, :n].transpose(0, 2, 1) * scale[:, None]) @ U[:, :, :n].transpose(0, 2, 1)
        B = inverse[:, :, rows.shape[1] - len(drives) :]
        missed = rows @ B
        missed[:, -len(drives) :] -= np.eye(len(drives))
        B = np.where(np.abs(missed).max(axis=(1, 2), keepdims=True) < _SOLVED, B, np.nan)
        free = V[:, int(known.sum(axis=1).max()) :].transpose(0, 2, 1)
        each = moved.cumsum() - 1
        return cls(scene, twin, q, np.concatenate([B, free], axis=2)[each], inverse[each])

    def rates(self, driven: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return u (n, na + nf) of the drives' rates (n, na) and the joints' velocities (n, nv)."""
        free = self.directions[:, :, driven.shape[1] :]
        return np.hstack([driven, np.einsum("tvf,tv->tf", free, v)])

    def velocities(self, u: np.ndarray, moving: Collection[int]) -> np.ndarray:
        """Return v (n, nv) if only some coordinates move."""
        some = list(moving)
        return (self.directions[:, :, some] @ u[:, some, None])[..., 0]

    def at_constant_rates(self, v: np.ndarray) -> np.ndarray:
        """Return gamma (n, nv): accelerations of the joints while u is constant."""
        linkage = self.scene.linkage
        if linkage is None:
            return np.zeros_like(v)
        derivative = loop_state(self.twin, linkage, self.q, v, np.zeros_like(v)).rate_derivative
        of_drives = np.zeros((len(v), len(self.scene.drives)))
        for d, drive in enumerate(self.scene.drives):
            if drive.velocity_index < 0:
                of_drives[:, d] = derivative[:, drive.column]
        change = np.hstack([derivative[:, linkage.lambdas], of_drives])
        return -(self._inverse @ change[..., None])[..., 0]

    def part(self, rows: np.ndarray) -> DriveCoordinates:
        """Return those of some samples."""
        inverse = self._inverse[rows] if len(self._inverse) else self._inverse
        return DriveCoordinates(self.scene, self.twin, self.q[rows], self.directions[rows], inverse)
