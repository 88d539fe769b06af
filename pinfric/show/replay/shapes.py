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
from pinfric.model.equivalent_box import Box, equivalent_box
from pinfric.model.loops import Linkage
from pinfric.model.scene import Scene
from pinfric.show.replay.meshes import Visual, urdf_visuals

#: Markers, arrows and cylinders are drawn along z, then turned.
UP = np.array([0.0, 0.0, 1.0])


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
