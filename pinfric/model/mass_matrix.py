"""Mass matrices, frame Jacobians and link poses of a whole batch."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinfric.model.closure import embedded, tree_tables
from pinfric.model.kinematics import place_links
from pinfric.model.robot import mass_matrix
from pinfric.model.twin import Twin


def mass_matrices(twin: Twin, q: np.ndarray) -> np.ndarray:
    """Return M(q) (n, nv, nv) of configurations (n, nq), rotors (armatures) left out.

    Samples equal to the one before are not computed again.
    """
    moved, model = np.append(True, (q[1:] != q[:-1]).any(axis=1)), twin.model
    data = model.createData()
    if all(tree[-1] - tree[0] < len(tree) for tree in model.subtrees if len(tree)):
        M = np.array([pin.crba(model, data, x, pin.Convention.WORLD) for x in q[moved]])
    else:  # there `crba` is wrong
        M = np.array([mass_matrix(model, x) for x in q[moved]])
    M = M.reshape(-1, twin.nv, twin.nv) - np.diag(model.armature)
    return M if moved.all() else M[moved.cumsum() - 1]


def link_poses(twin: Twin, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, nj, 3) and axes (n, nj, 3, 3) of the joints' child frames, world."""
    still = np.zeros((len(q), twin.nv))
    p, R = np.empty((len(q), twin.n_joints, 3)), np.empty((len(q), twin.n_joints, 3, 3))
    place_links(embedded(twin, q, still, still)[0], *tree_tables(twin), p, R)
    return p, R


def frame_jacobians(twin: Twin, q: np.ndarray, frame: int) -> np.ndarray:
    """Return J (n, 6, nv) of a frame: velocity of its origin, then rate, in the world's axes.

    `frame` is its id in the model; q is (n, nq).
    """
    model, data = twin.model, twin.model.createData()
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    each = [pin.computeFrameJacobian(model, data, x, frame, axes) for x in q]
    return np.array(each).reshape(-1, 6, twin.nv)
