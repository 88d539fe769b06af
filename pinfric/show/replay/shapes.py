"""What a robot looks like: the URDF's visuals, and shapes from inertias where it has none.

Everything is given per joint and in the joint's own frame, so that a viewer moves one node per
joint. Links without visuals become boxes of equal inertia and lines to the next joints: a robot
made in Python, or one whose meshes are missing, is never invisible.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.errors import PinfricWarning
from pinfric.model.loops import Linkage
from pinfric.model.magnitudes import LARGEST, impossible
from pinfric.model.robot import payload_inertia
from pinfric.model.scene import Scene
from pinfric.model.schema import Payload
from pinfric.show.replay.meshes import Visual, urdf_visuals

#: An edge of a box of equal inertia is at least this part of its longest (a rod stays visible).
_THINNEST = 0.12
#: Markers, arrows and cylinders are drawn along z, then turned.
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Box:
    """A box: `edges` (3,) in m along the axes of `placement`, which lies in its joint's frame."""

    edges: np.ndarray
    placement: pin.SE3


@dataclass(frozen=True)
class Shapes:
    """What to draw at each joint (index 0: what does not move), all in the joint's frame.

    Attributes:
        visuals: those of the URDF.
        boxes: joint -> boxes of equal inertia, where the joint has no visual.
        lines: joint -> (3,) ends of lines from the joint's origin to the joints it carries.
        points: joint -> (n, 3) corners of what is drawn there, to frame the view.
    """

    visuals: tuple[Visual, ...]
    boxes: dict[int, list[Box]]
    lines: dict[int, list[np.ndarray]]
    points: dict[int, np.ndarray]


def robot_shapes(scene: Scene) -> Shapes:
    """Return what to draw; meshes that are not there are replaced, with one `PinfricWarning`."""
    model = scene.model
    visuals, missing = ([], {}) if scene.robot is None else urdf_visuals(model, scene.robot)
    if missing:
        _warn_of(missing, scene)
    dressed = {visual.joint for visual in visuals}
    boxes: dict[int, list[Box]] = {}
    lines: dict[int, list[np.ndarray]] = {}
    for joint in range(1, model.njoints):
        if joint in dressed:
            continue
        if (box := equivalent_box(model.inertias[joint])) is not None:
            boxes[joint] = [box]
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        if parent not in dressed:
            lines.setdefault(parent, []).append(model.jointPlacements[joint].translation.copy())
    for pair in range(0 if scene.linkage is None else len(scene.linkage.pair_kind)):
        assert scene.linkage is not None
        for side in (0, 1):
            joint, frame = linkage_frame(scene.linkage, pair, side)
            if joint not in dressed:
                lines.setdefault(joint, []).append(frame.translation)
    points: dict[int, list[np.ndarray]] = {
        joint: [np.zeros((1, 3)), *(end[None] for end in ends)] for joint, ends in lines.items()
    }
    for joint in range(1, model.njoints):
        points.setdefault(joint, [np.zeros((1, 3))])
    for visual in visuals:
        points.setdefault(visual.joint, []).append(_corners(visual))
    for joint, there in boxes.items():
        points[joint] += [_box_corners(box) for box in there]
    gathered = {joint: np.concatenate(parts) for joint, parts in points.items()}
    return Shapes(tuple(visuals), boxes, lines, gathered)


def linkage_frame(linkage: Linkage, pair: int, side: int) -> tuple[int, pin.SE3]:
    """Return the joint (0: the ground) that carries side a (0) or b (1) of a loop, cylinder or
    force, and that frame's placement in the joint's frame."""
    placement = pin.SE3(linkage.frame_R[pair, side], linkage.frame_p[pair, side])
    return int(linkage.frame_joint[pair, side]) + 1, placement


def equivalent_box(inertia: pin.Inertia) -> Box | None:
    """Return the uniform box of the same mass and inertia, or None for a body without mass.

    Also None where the box would be larger than any machine, because there is hardly any mass.

    Edge^2 = 6 (J_2 + J_3 - J_1)/m about each principal axis; where the data belong to no body
    (or to a point) the edge is `_THINNEST` of the longest.
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
    """Return the joint that carries a payload and the box to draw for it, in the joint's frame.

    A payload without inertia is drawn as a cube of water's density.
    """
    frame = scene.model.frames[scene.model.getFrameId(payload.link, pin.FrameType.BODY)]
    box = equivalent_box(payload_inertia(payload))
    if box is None:
        edge = (payload.mass / 1000.0) ** (1.0 / 3.0)
        box = Box(np.full(3, edge), pin.SE3(np.eye(3), np.array(payload.com)))
    return int(frame.parentJoint), Box(box.edges, frame.placement * box.placement)


def _corners(visual: Visual) -> np.ndarray:
    low, high = visual.mesh.vertices.min(axis=0), visual.mesh.vertices.max(axis=0)
    inside = pin.SE3(np.eye(3), 0.5 * (low + high))
    return _box_corners(Box(high - low, visual.placement * inside))


def _box_corners(box: Box) -> np.ndarray:
    signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
    return np.asarray(signs * box.edges @ box.placement.rotation.T + box.placement.translation)


def _warn_of(missing: dict[str, str], scene: Scene) -> None:
    shown = "; ".join(f"{name}: {why}" for name, why in list(missing.items())[:3])
    more = f"; and {len(missing) - 3} more" if len(missing) > 3 else ""
    urdf = "" if scene.robot is None else f"{scene.robot.urdf}: "
    warnings.warn(
        f"{urdf}cannot be drawn, shapes are instead: {shown}{more}", PinfricWarning, stacklevel=3
    )
