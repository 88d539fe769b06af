"""The robot and its friction sites in a meshcat viewer: one node per joint, markers below it.

    meshcat/world                    turned so that gravity points down
      <joint>                        moves; "world" itself holds what does not
        visual_<n>, body_<n>, line_<n>
        site <name>/{ring, ghost, disc}     the marker, its z axis the site's axis
        site <name>/{arc_plus, arc_minus}   friction about or along the axis: {body, head}
        site <name>/force                   force of the parent on the child: {body, head}
        payload <name>
      cylinder <name>/{barrel, rod}

Used alike for a page without a server (the window keeps the commands) and for a live viewer.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.model.equivalent_box import payload_box
from pinfric.model.loops import CYLINDER, FORCE, Linkage, turn_between
from pinfric.model.scene import Scene, Site
from pinfric.model.twin import PRISMATIC
from pinfric.show.replay import markers, surfaces
from pinfric.show.replay.drawn import DrawnMesh, Surface
from pinfric.show.replay.markers import ARC, COLORS, FORCE_COLOR, PAYLOAD_COLOR, Marker
from pinfric.show.replay.shapes import UP, Shapes, linkage_frame, robot_shapes

_BODY_COLOR, _LINE_COLOR = "#8FA3B5", "#5D6B78"
#: Of cylinders and of forces that drive.
DRIVE_COLOR = "#C9A227"
#: Thickness of rings, arrows and lines, as parts of the robot's size.
_RING, _ARC_TUBE, _ARROW, _LINE = 0.0048, 0.0032, 0.0055, 0.008
#: The longest arrow, and the arc's radius beside its ring's.
ARROW, ARC_REACH = 0.22, 1.22
#: How far a cylinder's barrel reaches along it.
BARREL = 0.6
#: Lengths of the arrows' heads, as parts of the robot's size.
HEADS = {"friction": 5 * 0.8 * _ARROW, "force": 5 * _ARROW}
#: Colours: of the floor's lines near and far, and of the background.
_NEAR, _FAR = [0.66, 0.71, 0.77], [0.90, 0.92, 0.94]
_TOP, _BOTTOM = [0.965, 0.973, 0.980], [0.835, 0.863, 0.890]


@dataclass(frozen=True)
class DrawnCylinder:
    """A cylinder: its node, and its ends as (joint, (3,) point in that joint's frame)."""

    path: str
    a: tuple[int, np.ndarray]
    b: tuple[int, np.ndarray]


@dataclass(frozen=True)
class Stage:
    """What has been drawn, and where.

    Attributes:
        joint_paths: nodes of the joints, in the model's order, the universe left out.
        site_paths: nodes of the markers, in the order of the sites.
        payload_paths: payload -> node.
        gear_paths: drive -> node of the mark of its gear, hidden at first.
        cylinders: the drives along a line between two links.
        markers: in the order of the sites.
        upright: (3, 3) turns the world's axes so that gravity points down.
        points: (n, 3) in the turned world, m: what the view must show.
        size: of the robot (diagonal of the box round it, median over the frames), m.
        floor: height of the grid, m.
    """

    joint_paths: tuple[str, ...]
    site_paths: tuple[str, ...]
    payload_paths: dict[str, str]
    gear_paths: dict[str, str]
    cylinders: tuple[DrawnCylinder, ...]
    markers: tuple[Marker, ...]
    upright: np.ndarray
    points: np.ndarray
    size: float
    floor: float


def set_stage(
    viewer: Any, scene: Scene, placements: np.ndarray, gears: Collection[str] = ()
) -> Stage:
    """Draw the robot, its markers and its payloads, and look at where it moves.

    Args:
        viewer: a `meshcat.Visualizer`.
        scene: the robot.
        placements: (F, nj, 7) of the joints in the frames that the view must show.
        gears: drives whose gears are marked where they hold.
    """
    shapes, upright = robot_shapes(scene), _upright(scene)
    few = placements[np.unique(np.linspace(0, len(placements) - 1, 24).astype(int))]
    seen = [_seen(shapes.points, frame, upright) for frame in few]
    boxes = [np.linalg.norm(points.max(axis=0) - points.min(axis=0)) for points in seen]
    size = max(float(np.median(boxes)), 1e-3)
    names = tuple(_node(name) for name in scene.joint_names)
    nodes = ("world", *(f"world/{name}" for name in names))
    world = np.eye(4)
    world[:3, :3] = upright
    viewer["world"].set_transform(world)
    for path, placement in zip(nodes[1:], placements[0], strict=True):
        viewer[path].set_transform(pin.XYZQUATToSE3(placement).homogeneous)
    _draw_robot(viewer, shapes, nodes, size)
    placed = tuple(markers.site_marker(scene, site, shapes, size) for site in scene.sites)
    sites = tuple(
        f"{nodes[m.joint]}/site {_node(site.name)}"
        for site, m in zip(scene.sites, placed, strict=True)
    )
    for site, path, marker in zip(scene.sites, sites, placed, strict=True):
        _draw_marker(viewer[path], marker, site, size)
    payloads = {name: _draw_payload(viewer, scene, name, nodes) for name in scene.payloads}
    marked = {name: _draw_gear(viewer, scene, name, nodes, shapes, size) for name in gears}
    cylinders = _draw_linkage(viewer, scene.linkage, nodes, size) if scene.linkage else ()
    low = min(float(points[:, 2].min()) for points in seen)
    rings = _ring_points(placed)
    points = np.concatenate([*seen, *(_seen(rings, frame, upright) for frame in few)])
    for cylinder in cylinders:
        stretch_cylinder(viewer, cylinder, placements[0])
    floor = low if low < -0.02 * size else 0.0
    _dress(viewer, floor, size)
    return Stage(
        nodes[1:],
        sites,
        payloads,
        {name: path for name, path in marked.items() if path},
        cylinders,
        placed,
        upright,
        points,
        size,
        floor,
    )


def stretch_cylinder(viewer: Any, cylinder: DrawnCylinder, placements: np.ndarray) -> None:
    """Draw a cylinder from end to end.

    Args:
        viewer: a `meshcat.Visualizer`.
        cylinder: as `set_stage` drew it.
        placements: (nj, 7) of the joints.
    """
    start, end = (
        point if joint == 0 else pin.XYZQUATToSE3(placements[joint - 1]).act(point)
        for joint, point in (cylinder.a, cylinder.b)
    )
    length = max(float(np.linalg.norm(end - start)), 1e-9)
    turn = turn_between(UP, (end - start) / length)
    viewer[cylinder.path].set_transform(pin.SE3(turn, start).homogeneous)
    viewer[cylinder.path]["barrel"].set_transform(np.diag([1.0, 1.0, BARREL * length, 1.0]))
    viewer[cylinder.path]["rod"].set_transform(np.diag([1.0, 1.0, length, 1.0]))


def _node(name: str) -> str:
    """A joint's name as one step of a path."""
    return name.replace("/", "|") or "joint"


def _upright(scene: Scene) -> np.ndarray:
    """(3, 3) that turns gravity downwards."""
    gravity = np.array(scene.model.gravity.linear)
    return np.eye(3) if np.linalg.norm(gravity) < 1e-9 else turn_between(gravity, -UP)


def _seen(points: dict[int, np.ndarray], placements: np.ndarray, upright: np.ndarray) -> np.ndarray:
    """(n, 3) points, given per joint in its frame, in the turned world in one frame (nj, 7)."""
    seen = [np.zeros((0, 3))]
    for joint, local in points.items():
        place = pin.SE3.Identity() if joint == 0 else pin.XYZQUATToSE3(placements[joint - 1])
        seen.append(local @ place.rotation.T + place.translation)
    return np.concatenate(seen) @ upright.T


def _ring_points(placed: tuple[Marker, ...]) -> dict[int, np.ndarray]:
    """Joint -> (n, 3) points as far out as the rings and arcs of its markers."""
    found: dict[int, list[np.ndarray]] = {}
    corners = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]) * ARC_REACH
    for marker in placed:
        place = marker.placement
        around = marker.radius * corners @ place.rotation.T + place.translation
        found.setdefault(marker.joint, []).append(around)
    return {joint: np.concatenate(parts) for joint, parts in found.items()}


def _draw_robot(viewer: Any, shapes: Shapes, nodes: tuple[str, ...], size: float) -> None:
    for i, visual in enumerate(shapes.visuals):
        node = viewer[f"{nodes[visual.joint]}/visual_{i}"]
        node.set_object(DrawnMesh(visual.mesh))
        node.set_transform(visual.placement.homogeneous)
    for joint, boxes in shapes.boxes.items():
        for i, box in enumerate(boxes):
            node = viewer[f"{nodes[joint]}/body_{i}"]
            node.set_object(_cuboid(box.edges, _BODY_COLOR, 0.7))
            node.set_transform(box.placement.homogeneous)
    vertices, faces = surfaces.rod(_LINE * size)
    for joint, ends in shapes.lines.items():
        for i, end in enumerate(ends):
            if np.linalg.norm(end) > 1e-6:
                node = viewer[f"{nodes[joint]}/line_{i}"]
                node.set_object(Surface(vertices, faces, _LINE_COLOR))
                node.set_transform(_along(end))


def _draw_linkage(
    viewer: Any, linkage: Linkage, nodes: tuple[str, ...], size: float
) -> tuple[DrawnCylinder, ...]:
    """Draw loops' joints as balls, cylinders as barrel and rod, forces as arrows."""
    import meshcat.geometry as mg

    for row, loop in enumerate(linkage.loops):
        joint, frame = linkage_frame(linkage, row, 1)
        node = viewer[f"{nodes[joint]}/loop {_node(loop.name)}"]
        ball = mg.MeshPhongMaterial(color=int(_LINE_COLOR[1:], 16))
        node.set_object(mg.Sphere(2.0 * _LINE * size), ball)
        node.set_transform(frame.homogeneous)
    drawn = []
    pairs = range(len(linkage.loops), len(linkage.pair_kind))
    off_joint = [drive for drive in linkage.drives if linkage.column_pair[drive.column] in pairs]
    for pair, drive in zip(pairs, off_joint, strict=True):
        if linkage.pair_kind[pair] == CYLINDER:
            path = f"world/cylinder {_node(drive.name)}"
            viewer[path]["barrel"].set_object(
                Surface(*surfaces.rod(2.2 * _LINE * size), DRIVE_COLOR)
            )
            viewer[path]["rod"].set_object(Surface(*surfaces.rod(_LINE * size), _LINE_COLOR))
            (a, at_a), (b, at_b) = (linkage_frame(linkage, pair, side) for side in (0, 1))
            drawn.append(DrawnCylinder(path, (a, at_a.translation), (b, at_b.translation)))
        elif linkage.pair_kind[pair] == FORCE:
            joint, frame = linkage_frame(linkage, pair, 1)
            node = viewer[f"{nodes[joint]}/drive {_node(drive.name)}"]
            _draw_arrow(node, DRIVE_COLOR, 1.2 * _ARROW * size, on_top=True)
            node["body"].set_transform(np.diag([1.0, 1.0, 0.15 * size, 1.0]))
            shift = np.eye(4)
            shift[2, 3] = 0.15 * size
            node["head"].set_transform(shift)
            axis = linkage.pair_axis[pair]
            tail = -(0.15 * size + 5.0 * 1.2 * _ARROW * size) * axis  # its tip is where it pushes
            node.set_transform((frame * pin.SE3(turn_between(UP, axis), tail)).homogeneous)
    return tuple(drawn)


def _draw_marker(node: Any, marker: Marker, site: Site, size: float) -> None:
    node.set_transform(marker.placement.homogeneous)
    radius, blue = marker.radius, COLORS["sliding"]
    shape = surfaces.rings if site.ball else surfaces.ring
    vertices, faces = shape(radius, _RING * size)
    node["ring"].set_object(Surface(vertices, faces, blue))
    node["ghost"].set_object(Surface(vertices, faces, blue, opacity=0.35, on_top=True))
    node["disc"].set_object(Surface(*surfaces.disc(radius), blue, opacity=0.45, on_top=True))
    node["disc"].set_property("visible", False)
    for name, sign in (("arc_plus", 1.0), ("arc_minus", -1.0)):
        if site.sliding:
            # inside the body that slides, most often
            _draw_arrow(node[name], blue, 0.8 * _ARROW * size, on_top=True)
            turn = np.diag([1.0, sign, sign, 1.0])  # half a turn about x: along -z
            node[name].set_transform(turn)
        else:
            vertices, faces = surfaces.tube(ARC_REACH * radius, _ARC_TUBE * size, sign * ARC)
            node[name]["body"].set_object(Surface(vertices, faces, blue))
            head = surfaces.cone(3.0 * _ARC_TUBE * size, 9.0 * _ARC_TUBE * size)
            node[name]["head"].set_object(Surface(*head, blue))
    _draw_arrow(node["force"], FORCE_COLOR, _ARROW * size, on_top=True)


def _draw_gear(
    viewer: Any, scene: Scene, name: str, nodes: tuple[str, ...], shapes: Shapes, size: float
) -> str:
    """A toothed wheel inside the joint's ring; "" for a drive that is on no joint of the tree."""
    if name not in scene.joint_names:
        return ""
    twin, row = scene.twin(), scene.joint_names.index(name)
    axis = twin.axis[row, :3] if twin.kind[row] == PRISMATIC else twin.axis[row, 3:]
    marker = markers.joint_marker(scene, row + 1, axis, shapes, size)
    path = f"{nodes[row + 1]}/gear {_node(name)}"
    wheel = surfaces.wheel(0.72 * marker.radius)
    viewer[path].set_object(Surface(*wheel, markers.GEAR_COLOR, opacity=0.95, on_top=True))
    viewer[path].set_transform(marker.placement.homogeneous)
    viewer[path].set_property("visible", False)
    return path


def _draw_arrow(node: Any, color: str, thickness: float, on_top: bool = False) -> None:
    """An arrow of length 1 along z; the viewer stretches its body and shifts its head."""
    node["body"].set_object(Surface(*surfaces.rod(0.7 * thickness), color, on_top=on_top))
    head = surfaces.cone(2.0 * thickness, 5.0 * thickness)
    node["head"].set_object(Surface(*head, color, on_top=on_top))


def _draw_payload(viewer: Any, scene: Scene, name: str, nodes: tuple[str, ...]) -> str:
    joint, box = payload_box(scene, scene.payloads[name])
    path = f"{nodes[joint]}/payload {_node(name)}"
    viewer[path].set_object(_cuboid(box.edges, PAYLOAD_COLOR, 0.8))
    viewer[path].set_transform(box.placement.homogeneous)
    viewer[path].set_property("visible", bool(scene.payloads[name].attached))
    return path


def _dress(viewer: Any, floor: float, size: float) -> None:
    """Background, grid at the floor, the world's axes; meshcat's own axes ignore the turn."""
    viewer["/Background"].set_property("top_color", _TOP)
    viewer["/Background"].set_property("bottom_color", _BOTTOM)
    viewer["/Axes"].set_property("visible", False)
    viewer["/Grid"].set_property("visible", False)
    viewer["floor"].set_object(_grid(size, floor))
    viewer["/Lights/AmbientLight/<object>"].set_property("intensity", 0.5)
    for axis, color in ((0, "#C0392B"), (1, "#2E8B57"), (2, "#2C5FA8")):
        end = np.zeros(3)
        end[axis] = 0.12 * size
        node = viewer[f"world/axes/{'xyz'[axis]}"]
        node.set_object(Surface(*surfaces.rod(0.003 * size), color))
        node.set_transform(_along(end))


def _grid(size: float, height: float) -> Any:
    """Lines on the floor that fade with the distance, in cells of 1, 2 or 5 x 10^n m.

    Each line is cut at its crossings: software renderers drop one that ends behind the camera.
    """
    import meshcat.geometry as mg

    rough = size / 6.0
    power = 10.0 ** np.floor(np.log10(rough))
    cell = power * max(m for m in (1.0, 2.0, 5.0) if m * power <= rough * (1 + 1e-9))
    count = int(np.ceil(2.6 * size / cell))
    steps = np.arange(-count, count + 1)
    line, along = np.meshgrid(steps, steps[:-1], indexing="ij")
    ends = np.stack((np.stack((line, along), -1), np.stack((line, along + 1), -1)), 2)
    ends = ends.reshape(-1, 2)
    flat = cell * np.concatenate((ends, ends[:, ::-1]))
    near = np.clip(1.15 - np.linalg.norm(flat, axis=1) / (cell * count), 0.0, 1.0)[:, None]
    color = np.array(_FAR) + near * (np.array(_NEAR) - np.array(_FAR))
    position = np.column_stack((flat, np.full(len(flat), height)))
    # the fade ends before the corners: leave out what could not be seen
    seen = np.repeat(near.reshape(-1, 2).max(axis=1) > 0.0, 2)
    return mg.LineSegments(
        mg.PointsGeometry(position[seen].astype(np.float32).T, color[seen].astype(np.float32).T),
        mg.LineBasicMaterial(vertexColors=True),
    )


def _cuboid(edges: np.ndarray, color: str, opacity: float = 1.0) -> Any:
    import meshcat.geometry as mg

    material = mg.MeshPhongMaterial(color=int(color[1:], 16), opacity=opacity, shininess=40)
    return mg.Mesh(mg.Box([float(edge) for edge in edges]), material)


def _along(end: np.ndarray) -> np.ndarray:
    """(4, 4) that stretches the unit z axis from the origin to `end`."""
    length = float(np.linalg.norm(end))
    turn = np.eye(4)
    turn[:3, :3] = turn_between(UP, end / length) @ np.diag([1.0, 1.0, length])
    return turn
