"""Places and colours of a replay's marks: a ring round each friction site's axis.

It is drawn twice: solid, and faintly on top of everything, so a joint inside its housing shows,
too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.model.loops import turn_between
from pinfric.model.scene import Scene, Site
from pinfric.show.figure.style import BLUE, GREEN, ORANGE, PALE_RED, RED, SKY, YELLOW
from pinfric.show.replay.meshes import DrawnShape
from pinfric.show.replay.shapes import UP, linkage_frame

#: What a site does -> its colour.
COLORS = {
    "sliding": BLUE,
    "sticking": ORANGE,
    "near": RED,
    "reversal": YELLOW,
    "jammed": "#C2185B",
}
#: The same in words, for the legend.
MEANINGS = {
    "sliding": "slides",
    "sticking": "sticks",
    "near": "sticks, about to break away",
    "reversal": "reverses between two samples",
    "jammed": "jammed: no solution, or several",
}
#: What a simulated motion means otherwise.
SIMULATED = {"reversal": "reverses without sticking"}
#: Of a gear that holds its joint without its motor, and what that means.
GEAR_COLOR = SKY
GEAR_MEANING = "gear holds by itself: its motor needs no torque"
#: Of a logged effort that is off the computed one, and far off, and what that means.
OFF_COLORS = PALE_RED, RED
OFF_MEANING = "logged effort differs from the computed one by more than 10 %, 30 % of its RMS"
#: Of a limit that holds the motion back, and of one that is exceeded, and what that means.
LIMIT_COLORS = GREEN, "#C2185B"
LIMIT_MEANING = "a drive at one of its limits holds the motion back; red: it exceeds it"
FORCE_COLOR = "#7B4FB5"
PAYLOAD_COLOR = "#1FAF86"
#: Radius of a ring, as parts of the robot's size: least and most.
_SMALLEST, _LARGEST = 0.04, 0.09
#: The least radius of a ring at a small link, such as a finger's, as a part of that link's size.
_OF_LINK = 0.4
#: The smallest ring beside that of a large link: a link may have no extent at all.
_OF_ROBOT = 0.1
#: The arcs span at most this angle (rad), seen along the axis.
ARC = np.deg2rad(160.0)


@dataclass(frozen=True)
class Marker:
    """Where a site's marker is drawn.

    Attributes:
        joint: Pinocchio's index of the joint whose link carries it (0: the ground).
        placement: of the marker in the joint's frame; its z axis is the site's axis.
        radius: of its ring, m.
        size: m, to which its thickness and arcs are proportional: the robot's, less at a small
            link.
        turn: (3, 3) from the axes of the site's wrench to the marker's.
    """

    joint: int
    placement: pin.SE3
    radius: float
    size: float
    turn: np.ndarray


def site_marker(scene: Scene, site: Site, shapes: Sequence[DrawnShape], size: float) -> Marker:
    """Place a site's ring round its axis at the bearing's middle, outside the links if possible.

    A cylinder's is at its end b, round its line at the start, and turns with that link.

    Args:
        scene: the robot.
        site: a joint with friction, of the tree or of a loop.
        shapes: what is drawn of the robot.
        size: of the robot, m.
    """
    bearing = site.friction.bearing
    offset = getattr(bearing, "offset", 0.0)  # not every kind has one, nor a radius
    radius = 1.15 * getattr(bearing, "radius", 0.0)
    if site.pair < 0:
        # diagonal of the box round what is drawn of its link
        link = [s.corners() for s in shapes if s.kind == "visual" and s.joint == site.joint + 1]
        own = np.linalg.norm(np.ptp(np.concatenate(link), axis=0)) if link else np.inf
        size = float(np.clip(_OF_LINK / _SMALLEST * own, _OF_ROBOT * size, size))
    least = _SMALLEST * size
    most = max(_LARGEST * size, min(radius, 3.0 * _LARGEST * size))
    up = turn_between(UP, site.axis)
    placement = pin.SE3(up, offset * site.axis)
    joint = site.joint + 1
    if site.pair < 0:
        radius = max(radius, _outside(scene, joint, placement, shapes, (least, most)))
    else:
        assert scene.linkage is not None  # there are pairs
        joint, frame = linkage_frame(scene.linkage, site.pair, 1)
        placement = frame * placement
        if site.name in scene.linkage.cylinders:
            # along the cylinder at the scene's start, in the axes of the joint that carries its end
            other, at_other = linkage_frame(scene.linkage, site.pair, 0)
            data = scene.model.createData()
            pin.forwardKinematics(scene.model, data, scene.start_configuration)
            way = data.oMi[joint] * frame.translation - data.oMi[other] * at_other.translation
            line = turn_between(UP, np.asarray(data.oMi[joint].rotation.T @ way))
            return Marker(joint, pin.SE3(line, frame.translation), least, size, np.eye(3))
    return Marker(joint, placement, float(np.clip(radius, least, most)), size, up.T)


def _outside(
    scene: Scene,
    joint: int,
    placement: pin.SE3,
    shapes: Sequence[DrawnShape],
    limits: tuple[float, float],
) -> float:
    """Return the radius of a ring about z of `placement` outside most of the links; 0: none."""
    # (n, 3) points on the visuals of the joint and of its parent, in the joint's frame at q0
    to_joint = scene.model.jointPlacements[joint].inverse()
    parts = [np.empty((0, 3))]
    for shape in shapes:
        if shape.kind == "visual" and shape.joint in (joint, scene.model.parents[joint]):
            place = shape.placement if shape.joint == joint else to_joint * shape.placement
            points = shape.mesh.vertices[:: max(1, len(shape.mesh.vertices) // 2000)]
            parts.append(points @ place.rotation.T + place.translation)
    seen = np.concatenate(parts)
    local = (seen - placement.translation) @ placement.rotation
    reach = np.hypot(local[:, 0], local[:, 1])
    reach = reach[(np.abs(local[:, 2]) < 0.5 * limits[0]) & (reach < limits[1])]
    return 1.12 * float(np.quantile(reach, 0.75)) if len(reach) > 10 else 0.0
