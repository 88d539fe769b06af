"""The robot and its friction sites in a meshcat viewer: one node per joint, markers below it.

meshcat/world                    turned so that gravity points down
  <joint>                        moves; "world" itself holds what does not
    visual_<n>, body_<n>, line_<n>
    site <name>/{ring, ghost, disc}     the marker, its z axis the site's axis
    site <name>/{arc_plus, arc_minus}   friction about or along the axis: {body, head}
    site <name>/force                   force of the parent on the child: {body, head}
    payload <name>, loop <name>, drive <name>
  cylinder <name>/{barrel, rod}, spring <name>/{barrel, rod}
  stop_<n>                       where the tool stops
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.model.loops import CYLINDER, FORCE, Linkage, turn_between
from pinfric.model.scene import Scene, Site
from pinfric.show.replay import markers
from pinfric.show.replay.drawn import Surface, Track
from pinfric.show.replay.markers import ARC, COLORS, FORCE_COLOR, PAYLOAD_COLOR, Marker
from pinfric.show.replay.meshes import DrawnShape, fewer_triangles
from pinfric.show.replay.shapes import UP, box_mesh, linkage_frame, payload_box, robot_shapes
from pinfric.show.timeline.frames import Frames

LINE_COLOR = "#5D6B78"
#: Of cylinders and of forces that drive.
DRIVE_COLOR = "#C9A227"
#: Of places at which the tool stops; their radius as a part of the robot's size.
STOP_COLOR, _STOP = "#2E7D32", 0.008
#: Beside the longest step between frames: steps of a tool that stops, and how far stops are apart.
_STILL, _APART = 0.01, 0.5
#: Thickness of rings, arcs, arrows and lines, as parts of the robot's size.
_RING, _ARC_TUBE, _ARROW, _LINE = 0.0048, 0.0032, 0.0055, 0.008
#: The longest arrow, and the arc's radius beside its ring's.
ARROW, ARC_REACH = 0.22, 1.22
#: Angle of view (deg), and the direction from what is seen to the camera.
VIEW, _LOOK = 36.0, np.array([1.0, -1.25, 0.55]) / np.linalg.norm([1.0, -1.25, 0.55])
#: How far a cylinder's barrel reaches along it.
_BARREL = 0.6
#: Pieces along a ring or an arc, and round its thickness.
SEGMENTS, SIDES = 60, 6
#: Lengths of the arrows' heads, as parts of the robot's size.
HEADS = {"friction": 5 * 0.8 * _ARROW, "force": 5 * _ARROW}


@dataclass(frozen=True)
class DrawnCylinder:
    """A cylinder: its node, and its ends as (joint, (3,) point in that joint's frame)."""

    path: str
    a: tuple[int, np.ndarray]
    b: tuple[int, np.ndarray]


@dataclass(frozen=True)
class Stage:
    """The nodes of what has been drawn.

    Attributes:
        joint_paths: of the joints, in the model's order, without the universe.
        site_paths: of the markers, in the order of the sites.
        payload_paths: payload -> node.
        cylinders: cylinders and springs between links.
        markers: in the order of the sites.
        middle, distance: of all that moves, in the turned world; from where `VIEW` holds it, m.
        size: of the robot (diagonal of its box, median over the frames), m.
    """

    joint_paths: tuple[str, ...]
    site_paths: tuple[str, ...]
    payload_paths: dict[str, str]
    cylinders: tuple[DrawnCylinder, ...]
    markers: tuple[Marker, ...]
    middle: np.ndarray
    distance: float
    size: float


def set_stage(viewer: Any, scene: Scene, placements: np.ndarray) -> Stage:
    """Draw the robot, its markers and its payloads.

    Args:
        viewer: a `meshcat.Visualizer`.
        placements: (F, nj, 7) of the joints in the frames that the view must show.
    """
    # 1. What will be seen, in up to 24 frames, and its size; gravity points down
    gravity = np.array(scene.model.gravity.linear)
    upright = np.eye(3) if np.linalg.norm(gravity) < 1e-9 else turn_between(gravity, -UP)
    shapes = robot_shapes(scene)
    boxes = {name: payload_box(scene, payload) for name, payload in scene.payloads.items()}
    payloads = {
        name: DrawnShape("payload", joint, box.placement, box_mesh(box))
        for name, (joint, box) in boxes.items()
    }
    points = [(shape.joint, shape.corners()) for shape in (*shapes, *payloads.values())]
    points += [(joint, np.zeros((1, 3))) for joint in range(1, scene.model.njoints)]
    few = placements[np.unique(np.linspace(0, len(placements) - 1, 24).astype(int))]
    seen = np.array(
        [np.concatenate([_act(x, joint, local) for joint, local in points]) for x in few]
    )
    seen = seen @ upright.T
    size = max(float(np.median(np.linalg.norm(np.ptp(seen, axis=1), axis=1))), 1e-3)
    # 2. The world, and a node for each joint with its shapes
    named = enumerate(scene.joint_names, 1)  # a number, or "constructor" were JavaScript's own
    nodes = ("world", *(f"world/{j} {_node(name)}" for j, name in named))
    world = np.eye(4)
    world[:3, :3] = upright
    viewer["world"].set_transform(world)
    for path, placement in zip(nodes[1:], placements[0], strict=True):
        viewer[path].set_transform(pin.XYZQUATToSE3(placement).homogeneous)
    meshes = fewer_triangles([shape.mesh for shape in shapes], size)
    for n, (shape, mesh) in enumerate(zip(shapes, meshes, strict=True)):
        node = viewer[f"{nodes[shape.joint]}/{shape.kind}_{n}"]
        node.set_object(Surface(mesh))
        node.set_transform(shape.placement.homogeneous)
    # 3. In them markers of friction, payloads, drives, springs; the places at which the tool stops
    placed = tuple(markers.site_marker(scene, site, shapes, size) for site in scene.sites)
    sites = []
    for site, marker in zip(scene.sites, placed, strict=True):
        sites.append(f"{nodes[marker.joint]}/site {_node(site.name)}")
        _draw_marker(viewer[sites[-1]], marker, site, size)
    carried = {name: f"{nodes[x.joint]}/payload {_node(name)}" for name, x in payloads.items()}
    for name, path in carried.items():
        _draw_payload(viewer[path], payloads[name], scene, name, size)
    cylinders = _draw_linkage(viewer, scene.linkage, nodes, size) if scene.linkage else ()
    cylinders += _draw_springs(viewer, scene, size)
    for n, place in enumerate(tool_stops(scene, placements)):
        _draw_ball(viewer[f"world/stop_{n}"], STOP_COLOR, place, _STOP * size, on_top=True)
    # 4. The floor, and how far away the camera sees it all
    low, high = seen.min(axis=(0, 1)), seen.max(axis=(0, 1))
    _dress(viewer, upright, low[2] if low[2] < -0.02 * size else 0.0, size)
    middle = 0.5 * (low + high)
    local = seen.reshape(-1, 3) - middle
    depth = local @ _LOOK
    aside = np.linalg.norm(local - depth[:, None] * _LOOK, axis=1)
    distance = float((aside / np.tan(np.deg2rad(0.5 * VIEW)) + depth).max())
    return Stage(nodes[1:], tuple(sites), carried, cylinders, placed, middle, distance, size)


def animate(viewer: Any, stage: Stage, frames: Frames) -> None:
    """Animate joints and cylinders from 0 s on, and show payloads while carried."""
    from meshcat.animation import Animation, AnimationClip

    t, animation = frames.t - frames.t[0], Animation()

    def add(path: str, *tracks: Track) -> None:
        clip = AnimationClip(tracks={track.name: track for track in tracks}, fps=1)
        animation.clips[viewer[path].path] = clip

    def move(path: str, place: Any, turn: Any) -> None:
        position = Track("position", "vector3", t, place)
        add(path, position, Track("quaternion", "quaternion", t, turn))

    for j, path in enumerate(stage.joint_paths):
        move(path, frames.placement[:, j, :3], frames.placement[:, j, 3:])
    for cylinder in stage.cylinders:
        start, end = (
            np.array([_act(places, joint, point) for places in frames.placement])
            for joint, point in (cylinder.a, cylinder.b)
        )
        length = np.maximum(np.linalg.norm(end - start, axis=1, keepdims=True), 1e-9)
        along = (end - start) / length
        turns = [pin.Quaternion(turn_between(UP, axis)).coeffs() for axis in along]
        scale = np.hstack((np.ones((len(t), 2)), length))
        move(cylinder.path, start, turns)
        add(f"{cylinder.path}/rod", Track("scale", "vector3", t, scale))
        barrel = scale * [1.0, 1.0, _BARREL]
        add(f"{cylinder.path}/barrel", Track("scale", "vector3", t, barrel))
    for name, path in stage.payload_paths.items():
        spans = np.array(frames.carried[name]).reshape(-1, 2) - frames.t[0]
        ends = np.unique(np.append(spans, 0.0))
        carried = [any(a <= x and (x < b or b == t[-1]) for a, b in spans) for x in ends]
        add(path, Track("visible", "boolean", ends, carried))
    viewer.set_animation(animation)


def _node(name: str) -> str:
    return name.replace("/", "|")


def _act(placements: np.ndarray, joint: int, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) or (3,) of a joint (0: the ground) in the world, in one frame (nj, 7)."""
    if joint == 0:
        return points
    place = pin.XYZQUATToSE3(placements[joint - 1])
    return points @ place.rotation.T + place.translation


def tool_stops(scene: Scene, placements: np.ndarray) -> np.ndarray:
    """Return (n, 3) places at which the scene's tool stops, m; none without a tool.

    Args:
        placements: (F, nj, 7) of the joints.
    """
    if scene.tool is None:
        return np.zeros((0, 3))
    frame = scene.model.frames[scene.model.getFrameId(scene.tool)]
    point = frame.placement.translation
    way = np.array([_act(places, frame.parentJoint, point) for places in placements])
    step = np.linalg.norm(np.diff(way, axis=0), axis=1)
    slowest = np.minimum(np.append(step, np.inf), np.append(np.inf, step))
    still = way[slowest <= _STILL * step.max(initial=0.0)]
    kept: list[np.ndarray] = []
    for place in still:
        if all(np.linalg.norm(place - other) > _APART * step.max() for other in kept):
            kept.append(place)
    return np.array(kept).reshape(-1, 3)


def _draw_ball(
    node: Any, color: str, place: np.ndarray, radius: float, on_top: bool = False
) -> None:
    from trimesh import creation
    from trimesh.transformations import translation_matrix

    node.set_object(Surface(creation.icosphere(radius=radius), color, on_top=on_top))
    node.set_transform(translation_matrix(place))


def _draw_payload(node: Any, shape: DrawnShape, scene: Scene, name: str, size: float) -> None:
    from trimesh import creation

    payload = scene.payloads[name]
    node.set_object(Surface(shape.mesh, PAYLOAD_COLOR, 0.8))
    node.set_transform(shape.placement.homogeneous)
    node.set_property("visible", bool(payload.attached))
    link = scene.model.frames[scene.model.getFrameId(payload.link, pin.FrameType.BODY)]
    hand = shape.placement.actInv(link.placement.translation)
    if np.linalg.norm(hand) > _LINE * size:
        rod = creation.cylinder(_LINE * size, segment=[hand, np.zeros(3)]).smooth_shaded
        node["held"].set_object(Surface(rod, LINE_COLOR))


def _draw_linkage(
    viewer: Any, linkage: Linkage, nodes: tuple[str, ...], size: float
) -> tuple[DrawnCylinder, ...]:
    """Draw loops' joints as balls, cylinders as barrel and rod, forces as arrows."""
    from trimesh.transformations import translation_matrix

    for row, loop in enumerate(linkage.loops):
        joint, frame = linkage_frame(linkage, row, 1)
        node = viewer[f"{nodes[joint]}/loop {_node(loop.name)}"]
        _draw_ball(node, LINE_COLOR, frame.translation, 2.0 * _LINE * size)
    drawn = []
    pairs = range(len(linkage.loops), len(linkage.pair_kind) - len(linkage.rods))
    off_joint = [drive for drive in linkage.drives if linkage.column_pair[drive.column] in pairs]
    for pair, drive in zip(pairs, off_joint, strict=True):
        joint, frame = linkage_frame(linkage, pair, 1)
        if linkage.pair_kind[pair] == CYLINDER:
            from_, start = linkage_frame(linkage, pair, 0)
            ends = (from_, start.translation), (joint, frame.translation)
            drawn.append(
                _draw_rod(viewer, f"cylinder {_node(drive.name)}", DRIVE_COLOR, ends, size)
            )
        elif linkage.pair_kind[pair] == FORCE:
            node = viewer[f"{nodes[joint]}/drive {_node(drive.name)}"]
            thickness = 1.2 * _ARROW * size
            _draw_arrow(node, DRIVE_COLOR, thickness)
            stretch = np.diag([1.0, 1.0, 0.15 * size, 1.0])
            node["body"].set_transform(stretch)
            node["head"].set_transform(translation_matrix(0.15 * size * UP))
            axis = linkage.pair_axis[pair]
            tail = -(0.15 * size + 5.0 * thickness) * axis  # its tip is where it pushes
            node.set_transform((frame * pin.SE3(turn_between(UP, axis), tail)).homogeneous)
    return tuple(drawn)


def _draw_rod(
    viewer: Any, name: str, color: Any, ends: tuple[tuple[int, Any], tuple[int, Any]], size: float
) -> DrawnCylinder:
    """Draw a barrel and a rod between two points of links, each a joint's index and a place."""
    path = f"world/{name}"
    viewer[path]["barrel"].set_object(Surface(_rod(2.2 * _LINE * size), color))
    viewer[path]["rod"].set_object(Surface(_rod(_LINE * size), LINE_COLOR))
    return DrawnCylinder(path, *ends)


def _draw_springs(viewer: Any, scene: Scene, size: float) -> tuple[DrawnCylinder, ...]:
    if (springs := scene.twin().springs) is None:
        return ()
    entries = zip(springs.lines, springs.ends, springs.points, strict=True)
    return tuple(
        _draw_rod(
            viewer,
            f"spring {_node(line.name)}",
            LINE_COLOR,
            ((int(ends[0]) + 1, places[0]), (int(ends[1]) + 1, places[1])),
            size,
        )
        for line, ends, places in entries
    )


def _draw_marker(node: Any, marker: Marker, site: Site, size: float) -> None:
    from trimesh import creation, util
    from trimesh.transformations import rotation_matrix

    node.set_transform(marker.placement.homogeneous)
    radius, blue, own = marker.radius, COLORS["sliding"], marker.size
    ring = _tube(radius, _RING * own, 2.0 * np.pi)
    if site.ball:
        turns = [
            np.eye(4),
            rotation_matrix(np.pi / 2, [1, 0, 0]),
            rotation_matrix(np.pi / 2, [0, 1, 0]),
        ]
        ring = util.concatenate([ring.copy().apply_transform(turn) for turn in turns])
    node["ring"].set_object(Surface(ring, blue))
    node["ghost"].set_object(Surface(ring, blue, opacity=0.35, on_top=True))
    disc = creation.revolve([[0.0, 0.0], [radius, 0.0]])
    node["disc"].set_object(Surface(disc, blue, opacity=0.45, on_top=True))
    node["disc"].set_property("visible", False)
    for name, sign in (("arc_plus", 1.0), ("arc_minus", -1.0)):
        if site.sliding:
            # inside the body that slides, most often
            _draw_arrow(node[name], blue, 0.8 * _ARROW * size, on_top=True)
            turn = np.diag([1.0, sign, sign, 1.0])  # half a turn about x: along -z
            node[name].set_transform(turn)
        else:
            arc = _tube(ARC_REACH * radius, _ARC_TUBE * own, sign * ARC)
            node[name]["body"].set_object(Surface(arc, blue))
            node[name]["head"].set_object(
                Surface(creation.cone(3.0 * _ARC_TUBE * own, 9.0 * _ARC_TUBE * own), blue)
            )
    _draw_arrow(node["force"], FORCE_COLOR, _ARROW * size, on_top=True)


def _draw_arrow(node: Any, color: str, thickness: float, on_top: bool = False) -> None:
    """Draw an arrow of length 1 along z; the viewer stretches its body and shifts its head."""
    from trimesh import creation

    node["body"].set_object(Surface(_rod(0.7 * thickness), color, on_top=on_top))
    head = creation.cone(2.0 * thickness, 5.0 * thickness)
    node["head"].set_object(Surface(head, color, on_top=on_top))


def _dress(viewer: Any, upright: np.ndarray, floor: float, size: float) -> None:
    """Set the background, a floor grid in cells of 1, 2 or 5 x 10^n m, and the world's axes."""
    viewer["/Background"].set_property("top_color", [0.965, 0.973, 0.980])
    viewer["/Background"].set_property("bottom_color", [0.835, 0.863, 0.890])
    rough = size / 15.0  # 20 of them: software renderers drop lines that end behind the camera
    power = 10.0 ** np.floor(np.log10(rough))
    cell = power * max(m for m in (1.0, 2.0, 5.0) if m * power <= rough * (1 + 1e-9))
    grid = np.diag([cell / 0.5, cell / 0.5, 1.0, 1.0])  # meshcat's cells are 0.5 m wide
    grid[2, 3] = floor
    viewer["/Grid"].set_transform(grid)
    viewer["/Grid/<object>"].set_property("color", [1.0, 1.0, 1.0, 0.25])
    axes = np.eye(4)
    axes[:3, :3] = 0.24 * size * upright  # meshcat's are 0.5 m long
    viewer["/Axes"].set_transform(axes)


def _tube(radius: float, thickness: float, angle: float) -> Any:
    """Return a tube along an arc about z from the x axis; negative angles turn the other way.

    Its faces are in order: a viewer that draws the first ones draws the beginning of the arc.
    """
    from trimesh import creation

    across = np.linspace(0.0, 2.0 * np.pi, SIDES + 1)
    profile = np.column_stack((radius + thickness * np.cos(across), thickness * np.sin(across)))
    tube = creation.revolve(profile, angle=abs(angle), sections=SEGMENTS)
    return tube.apply_transform(np.diag([1.0, np.sign(angle), np.sign(angle), 1.0]))


def _rod(radius: float) -> Any:
    from trimesh import creation

    return creation.cylinder(radius, segment=[np.zeros(3), UP]).smooth_shaded
