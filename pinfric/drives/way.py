"""The way of a drive that slides: of a sliding joint, or of a cylinder between two points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.model.coordinates import is_sliding
from pinfric.model.loops import CYLINDER, carriers
from pinfric.model.mass_matrix import link_poses
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import stated_range

#: Places of a joint between its limits at which a cylinder's length is computed.
_PLACES = 401


class Way(NamedTuple):
    """What a cylinder must cover, m.

    Attributes:
        travel: over the cycle. range: between the URDF's limits of its joint; NaN: it has none.
        shortest, longest: distance of its pins over the cycle; NaN: it is on a joint.
    """

    travel: float
    range: float
    shortest: float = np.nan
    longest: float = np.nan

    @property
    def between_pins(self) -> bool:
        """Whether it is no joint's."""
        return not np.isnan(self.longest)


def pins(scene: Scene, drive: int) -> list[tuple[int, np.ndarray]]:
    """Return of a cylinder's two ends the row of the joint that carries it, and its place (3,).

    Row -1 is the ground; empty: the drive is not between two points.
    """
    linkage, column = scene.linkage, getattr(scene.drives[drive], "column", -1)
    if linkage is None or scene.drives[drive].velocity_index >= 0 or column < 0:
        return []
    pair = int(linkage.column_pair[column])
    if linkage.pair_kind[pair] != CYLINDER:
        return []
    ends = zip(linkage.frame_joint[pair].tolist(), linkage.frame_p[pair], strict=True)
    return [(row, np.array(place)) for row, place in ends]


def pin_distance(scene: Scene, drive: int, q: np.ndarray) -> np.ndarray:
    """Return the distance (T,) of a cylinder's pins, m, at configurations q (T, nq)."""
    p, R = link_poses(scene.twin(()), q)
    a, b = (
        place if row < 0 else p[:, row] + R[:, row] @ place for row, place in pins(scene, drive)
    )
    return np.asarray(np.linalg.norm(b - a, axis=-1))


def way_of(scene: Scene, drive: int, q: np.ndarray) -> Way | None:
    """Return the way of a drive over a path q (T, nq); None: it neither slides nor has pins."""
    model, ends = scene.model, pins(scene, drive)
    if ends:
        length, span = pin_distance(scene, drive, q), np.nan
        between = carriers(model, ends[0][0]) ^ carriers(model, ends[1][0])
        if len(between) == 1 and not scene.loops:
            joint = model.joints[between.pop() + 1]
            low, high = _limits(model, joint)
            if np.isfinite(high - low) and joint.nq == 1:
                at = np.tile(pin.neutral(model), (_PLACES, 1))
                at[:, joint.idx_q] = np.linspace(low, high, _PLACES)
                span = float(np.ptp(pin_distance(scene, drive, at)))
        return Way(float(np.ptp(length)), span, float(length.min()), float(length.max()))
    moved = scene.drives[drive].velocity_index
    joint = next((j for j in model.joints if j.nv == 1 and j.idx_v == moved), None)
    if joint is None or not is_sliding(joint):
        return None
    low, high = _limits(model, joint)
    span = high - low if np.isfinite(high - low) else np.nan
    return Way(float(np.ptp(q[:, joint.idx_q])), span)


def _limits(model: pin.Model, joint: pin.JointModel) -> tuple[float, float]:
    at = joint.idx_q
    return stated_range(float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at]))
