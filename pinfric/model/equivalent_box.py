"""Boxes with the mass and inertia of a body, for drawing it without a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.model.magnitudes import LARGEST, impossible
from pinfric.model.robot import payload_inertia
from pinfric.model.scene import Scene
from pinfric.model.schema import Payload

#: The least ratio of a box's edge to its longest edge, so that a rod stays visible.
_THINNEST = 0.12


@dataclass(frozen=True)
class Box:
    """A box: `edges` (3,) in m along the axes of `placement`, which is in its joint's frame."""

    edges: np.ndarray
    placement: pin.SE3


def equivalent_box(inertia: pin.Inertia) -> Box | None:
    """Return the uniform box of the same mass and inertia, or None for a body without mass.

    Edge^2 = 6 (J_2 + J_3 - J_1)/m for each principal axis; if that is not positive, as for a point,
    the edge is `_THINNEST` of the longest. None also if the mass is so small that the box would be
    larger than any machine.
    """
    mass = inertia.mass
    moments, axes = np.linalg.eigh(inertia.inertia)
    if not mass > 0 or not moments[2] > 0:
        return None
    edges = np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / mass, 0.0))
    edges = np.maximum(edges, _THINNEST * edges.max())
    if impossible(edges, LARGEST).any():
        return None
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1.0
    return Box(edges, pin.SE3(axes, np.array(inertia.lever)))


def payload_box(scene: Scene, payload: Payload) -> tuple[int, Box]:
    """Return the joint that carries a payload and a box for it, in the joint's frame.

    A payload without inertia is a cube of water's density.
    """
    frame = scene.model.frames[scene.model.getFrameId(payload.link, pin.FrameType.BODY)]
    box = equivalent_box(payload_inertia(payload))
    if box is None:
        edge = (payload.mass / 1000.0) ** (1.0 / 3.0)
        box = Box(np.full(3, edge), pin.SE3(np.eye(3), np.array(payload.com)))
    return int(frame.parentJoint), Box(box.edges, frame.placement * box.placement)
