"""The shapes of a robot, each in its joint's own frame, as a viewer moves one node per joint.

Links without visuals become boxes of equal inertia and lines to the next joints, so a robot made in
Python, or without its meshes, is visible.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.errors import PinfricWarning
from pinfric.model.loops import Linkage
from pinfric.model.magnitudes import LARGEST, impossible
from pinfric.model.robot import payload_inertia
from pinfric.model.scene import Scene
from pinfric.model.schema import Payload
from pinfric.show.replay.meshes import DrawnShape, painted, urdf_visuals

#: Markers, arrows and cylinders are drawn along z, then turned.
UP = np.array([0.0, 0.0, 1.0])
_BODY, _LINE = (143, 163, 181, 179), (93, 107, 120, 255)
#: A line's radius beside its length.
_THICK = 0.03
#: The least ratio of a box's edge to its longest edge, so that a rod stays visible.
_THINNEST = 0.12


@dataclass(frozen=True)
class Box:
    """A box: `edges` (3,) in m along the axes of `placement`, which is in its joint's frame."""

    edges: np.ndarray
    placement: pin.SE3


def equivalent_box(inertia: pin.Inertia) -> Box | None:
    """Return the uniform box of the same mass and inertia, or None for a body without mass.

    Edge^2 = 6 (J_2 + J_3 - J_1)/m for each principal axis; at least `_THINNEST` of the longest.
    None also if the box would be larger than any machine.
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


def robot_shapes(scene: Scene) -> tuple[DrawnShape, ...]:
    """Return what to draw; missing meshes are replaced, with one `PinfricWarning`."""
    from trimesh import creation

    model = scene.model
    shapes, missing = ([], {}) if scene.robot is None else urdf_visuals(model, scene.robot)
    if missing:
        shown = "; ".join(f"{name}: {why}" for name, why in list(missing.items())[:3])
        more = f"; and {len(missing) - 3} more" if len(missing) > 3 else ""
        urdf = "" if scene.robot is None else f"{scene.robot.urdf}: "
        warnings.warn(
            f"{urdf}cannot be drawn, simple shapes are used: {shown}{more}",
            PinfricWarning,
            stacklevel=2,
        )
    dressed = {shape.joint for shape in shapes}
    ends = [
        (model.parents[j], model.jointPlacements[j].translation) for j in range(1, model.njoints)
    ]
    for pair in range(0 if scene.linkage is None else len(scene.linkage.pair_kind)):
        assert scene.linkage is not None
        frames = (linkage_frame(scene.linkage, pair, side) for side in (0, 1))
        ends += [(joint, frame.translation) for joint, frame in frames]
    for joint in range(1, model.njoints):
        box = None if joint in dressed else equivalent_box(model.inertias[joint])
        if box is not None:
            shapes.append(DrawnShape("body", joint, box.placement, box_mesh(box, _BODY)))
    for joint, end in ends:
        if joint not in dressed and np.linalg.norm(end) > 1e-6:
            radius = _THICK * float(np.linalg.norm(end))
            rod = painted(creation.cylinder(radius, segment=[np.zeros(3), end]), _LINE)
            shapes.append(DrawnShape("line", joint, pin.SE3.Identity(), rod))
    return tuple(shapes)


def box_mesh(box: Box, color: tuple[int, ...] = _BODY) -> Any:
    """Return a box as a trimesh round the origin, in one colour (RGBA)."""
    from trimesh import creation

    return painted(creation.box(box.edges), color)


def linkage_frame(linkage: Linkage, pair: int, side: int) -> tuple[int, pin.SE3]:
    """Return joint (0: ground) and placement of side a (0) or b (1) of a loop, cylinder, force."""
    placement = pin.SE3(linkage.frame_R[pair, side], linkage.frame_p[pair, side])
    return int(linkage.frame_joint[pair, side]) + 1, placement
