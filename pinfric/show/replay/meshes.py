"""A URDF's visuals as coloured triangles.

trimesh reads them one by one, so only a broken mesh is lost. (Pinocchio then refuses all, and
meshcat's reader of Collada files fails on some.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.errors import RobotError
from pinfric.model.magnitudes import LARGEST, impossible
from pinfric.model.robot import Robot
from pinfric.model.urdf import mesh_file, read_document, read_mesh_scene

_GRAY = (190, 196, 204, 255)
#: Triangles of a robot that a page takes, and the first cell of a grid, as a part of its size.
_MOST_TRIANGLES, _CELL = 80_000, 0.001


@dataclass(frozen=True)
class DrawnShape:
    """What is drawn of a link.

    Attributes:
        kind: "visual", "body" (a box of equal inertia) or "line" (to the next joint).
        joint: Pinocchio's index of the joint that moves the link (0: the ground).
        placement: in that joint's frame.
        mesh: `trimesh.Trimesh` with a colour (RGBA) at each vertex.
    """

    kind: str
    joint: int
    placement: pin.SE3
    mesh: Any

    def corners(self) -> np.ndarray:
        """Return the (8, 3) corners of the shape's box in the joint's frame."""
        from trimesh.bounds import corners

        box = np.asarray(corners(self.mesh.bounds))
        return box @ self.placement.rotation.T + self.placement.translation


def urdf_visuals(model: pin.Model, robot: Robot) -> tuple[list[DrawnShape], dict[str, str]]:
    """Return a URDF's visuals, and the missing ones: file name -> why.

    Args:
        model: with a frame for each link.
        robot: the URDF and where its meshes are.
    """
    try:
        document = read_document(robot.xml(), robot.urdf)
    except Exception as problem:  # a colour that is no number, say: it must not stop the replay
        return [], {"its <visual>s": str(problem)}
    named = {m.name: m.color for m in document.materials or () if m.color is not None}
    shapes: list[DrawnShape] = []
    missing: dict[str, str] = {}
    loaded: dict[Path, Any] = {}
    for link in document.links:
        if not model.existFrame(link.name, pin.FrameType.BODY):
            continue
        frame = model.frames[model.getFrameId(link.name, pin.FrameType.BODY)]
        for visual in link.visuals:
            name = getattr(visual.geometry.mesh, "filename", None) or f"a <visual> of {link.name}"
            origin = np.eye(4) if visual.origin is None else visual.origin
            try:
                placement = frame.placement * pin.SE3(origin[:3, :3], origin[:3, 3])
                mesh = _geometry(visual.geometry, robot, loaded)
                refuse_nowhere(mesh.vertices, placement.np)
            except Exception as problem:  # each format's reader raises its own
                missing[name] = str(problem) or type(problem).__name__
                continue
            material = visual.material
            if material is not None and (color := material.color or named.get(material.name)):
                mesh.visual.vertex_colors = (
                    np.clip(255 * color.rgba, 0, 255).round().astype(np.uint8)
                )
            shapes.append(DrawnShape("visual", int(frame.parentJoint), placement, mesh))
    return shapes, missing


def refuse_nowhere(*numbers: np.ndarray) -> None:
    """Raise ValueError for coordinates that are not finite, or beyond any machine."""
    if any(impossible(x, LARGEST).any() for x in numbers):
        raise ValueError("its sizes or positions are implausible")


def read_mesh(path: Path) -> Any:
    """Read a mesh file (Collada, STL, OBJ, and others of trimesh's) as one trimesh, in m.

    Raises:
        Exception: whatever its reader raises; ValueError without triangles.
    """
    import trimesh

    with np.errstate(all="ignore"):  # of corners beyond numbers, which are refused below
        scene, unit = read_mesh_scene(path)
        meshes = [
            mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)
        ]
        if not meshes:
            raise ValueError("no triangles")
        whole = trimesh.util.concatenate([_colored(mesh) for mesh in meshes])
    return whole.apply_scale(unit)


def _colored(mesh: Any) -> Any:
    """Colour the part at each vertex; in one colour, merge vertices where it is smooth."""
    import trimesh

    refuse_nowhere(mesh.vertices)
    visual = mesh.visual
    try:
        if visual.kind == "texture":
            material = visual.material
            images = [getattr(material, name, None) for name in ("image", "baseColorTexture")]
            textured = visual.uv is not None and any(image is not None for image in images)
            colors = visual.to_color().vertex_colors if textured else material.main_color
        else:
            colors = visual.vertex_colors if visual.kind else _GRAY
    except Exception:  # a texture that cannot be read must not cost the shape
        colors = _GRAY
    colors = np.broadcast_to(np.asarray(colors, np.uint8), (len(mesh.vertices), 4))
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=colors)
    if not (colors == colors[0]).all():
        return mesh
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return painted(mesh, colors[0])


def _geometry(geometry: Any, robot: Robot, loaded: dict[Path, Any]) -> Any:
    from trimesh import creation

    if geometry.mesh is not None:
        path = mesh_file(geometry.mesh.filename, robot.urdf, robot.package_dirs)
        if path is None:
            raise RobotError("there is no such file")
        if path not in loaded:
            loaded[path] = read_mesh(path)
        mesh = loaded[path].copy()
        return mesh.apply_scale(1.0 if geometry.mesh.scale is None else geometry.mesh.scale)
    if geometry.box is not None:
        return painted(creation.box(geometry.box.size))
    if geometry.cylinder is not None:
        return painted(creation.cylinder(geometry.cylinder.radius, geometry.cylinder.length))
    if geometry.sphere is not None:
        return painted(creation.icosphere(radius=geometry.sphere.radius))
    raise RobotError("it has no geometry")


def fewer_triangles(meshes: Sequence[Any], size: float) -> list[Any]:
    """Return meshes small enough for a page: corners within one cell of a grid become one.

    The cell grows until there are few enough triangles, at most to a quarter of a mesh.

    Args:
        meshes: of trimesh, with colours at their vertices.
        size: of the whole robot, m.
    """
    fewer, cell = list(meshes), _CELL * size
    while sum(len(mesh.faces) for mesh in fewer) > _MOST_TRIANGLES and cell < size:
        fewer, cell = [_in_cells(mesh, min(cell, mesh.scale / 4)) for mesh in meshes], 1.25 * cell
    return fewer


def _in_cells(mesh: Any, cell: float) -> Any:
    """Move the mesh's corners to their mean in each cell; keep sharp edges and colours."""
    import trimesh

    _, place = np.unique(np.round(mesh.vertices / cell), axis=0, return_inverse=True)
    means = [np.bincount(place, x) / np.bincount(place) for x in mesh.vertices.T]
    kinds = np.round(1.5 * mesh.vertex_normals), mesh.visual.vertex_colors
    _, first, kind = np.unique(
        np.column_stack((place, *kinds)), axis=0, return_index=True, return_inverse=True
    )
    sums = np.stack([np.bincount(kind, x) for x in mesh.vertex_normals.T], axis=1)
    normals = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)
    corners = place[mesh.faces]
    kept = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    if not kept.any():  # all on one line
        return mesh
    faces = kind[mesh.faces[kept]]
    # in the order of their corners, and rounded: it packs smaller
    turned = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
    used, faces = np.unique(
        np.unique(np.take_along_axis(faces, turned, axis=1), axis=0), return_inverse=True
    )
    return trimesh.Trimesh(
        np.round(np.stack(means, axis=1)[place[first[used]]] * (4 / cell)) * (cell / 4),
        faces.reshape(-1, 3),
        vertex_normals=np.round(32 * normals[used]) / 32,
        vertex_colors=mesh.visual.vertex_colors[first[used]],
        process=False,
    )


def painted(mesh: Any, color: Sequence[int] = _GRAY) -> Any:
    """Return a trimesh in one colour (RGBA), its edges sharp."""
    mesh = mesh.smooth_shaded.copy()
    mesh.visual.vertex_colors = color
    return mesh
