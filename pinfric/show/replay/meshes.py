"""A URDF's visuals as plain triangles with colours, whatever file they come from.

Read by trimesh, one by one: a mesh that is missing or broken costs no more than itself. (Pinocchio
refuses all visuals then, and meshcat's own reader of Collada files fails on some of them.)
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.model.magnitudes import LARGEST, impossible
from pinfric.model.robot import Robot
from pinfric.model.urdf import mesh_file, read_mesh_scene
from pinfric.model.urdf_file import read_xml
from pinfric.show.replay import surfaces

_GRAY = (190, 196, 204)


@dataclass(frozen=True)
class Mesh:
    """Triangles with one colour per vertex.

    Attributes:
        vertices: (n, 3), m.
        faces: (k, 3) indices.
        normals: (n, 3) unit, or None: a viewer makes them.
        colors: (n, 3) uint8.
        opacity: 1 is opaque.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None
    colors: np.ndarray
    opacity: float = 1.0


@dataclass(frozen=True)
class Visual:
    """One `<visual>` of a link.

    Attributes:
        joint: Pinocchio's index of the joint that moves the link (0: the ground).
        placement: in that joint's frame.
        mesh: what is seen.
    """

    joint: int
    placement: pin.SE3
    mesh: Mesh


def urdf_visuals(model: pin.Model, robot: Robot) -> tuple[list[Visual], dict[str, str]]:
    """Return a URDF's visuals, and those that cannot be had: file name -> why.

    Args:
        model: the robot, with a frame for each of its links.
        robot: the URDF and where its meshes are.
    """
    root = read_xml(robot.urdf)
    named = {m.get("name"): color for m in root.findall("material") if (color := _rgba(m))}
    found: list[Visual] = []
    missing: dict[str, str] = {}
    loaded: dict[Path, Mesh] = {}
    for link in root.findall("link"):
        name = link.get("name", "")
        if not model.existFrame(name, pin.FrameType.BODY):
            continue
        frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        for visual in link.findall("visual"):
            material = visual.find("material")
            color = None if material is None else _rgba(material) or named.get(material.get("name"))
            mesh = _geometry(visual.find("geometry"), robot, loaded, missing)
            if mesh is None:
                continue
            placement = frame.placement * _origin(visual.find("origin"))
            if impossible(mesh.vertices, LARGEST).any() or impossible(placement.np, LARGEST).any():
                missing[f"a <visual> of {name}"] = "its sizes or places are no numbers of a machine"
                continue
            found.append(Visual(int(frame.parentJoint), placement, _painted(mesh, color)))
    return found, missing


def read_mesh(path: Path) -> Mesh:
    """Read a mesh file (Collada, STL, OBJ, and what else trimesh knows).

    Raises:
        Exception: whatever its reader raises; ValueError where there are no triangles.
    """

    with np.errstate(all="ignore"):  # of corners beyond numbers, which are refused below
        return _triangles(*read_mesh_scene(path))


def _triangles(scene: Any, unit: float) -> Mesh:
    import trimesh

    parts = []
    for node in scene.graph.nodes_geometry:
        turn, name = scene.graph[node]
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh) and len(part.faces):
            parts.append(_part(part, np.asarray(turn)))
    if not parts:
        raise ValueError("no triangles")
    if any(impossible(part.vertices, LARGEST).any() for part in parts):
        raise ValueError("corners that are nowhere (not finite, or beyond any machine)")
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Mesh(
        vertices=unit * np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + n for part, n in zip(parts, first[:-1], strict=True)]),
        normals=np.concatenate([part.normals for part in parts]),
        colors=np.concatenate([part.colors for part in parts]),
    )


def _part(part: Any, turn: np.ndarray) -> Mesh:
    vertices = np.asarray(part.vertices) @ turn[:3, :3].T + turn[:3, 3]
    normals = np.asarray(part.vertex_normals) @ np.linalg.inv(turn[:3, :3])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Mesh(vertices, np.asarray(part.faces), normals, _colors(part))


def _colors(part: Any) -> np.ndarray:
    """(n, 3) uint8: from a texture, a material, or the vertices; gray where there is nothing."""
    count, visual = len(part.vertices), part.visual
    try:
        if visual.kind == "texture" and _has_image(visual.material) and visual.uv is not None:
            colors = np.asarray(visual.to_color().vertex_colors)
        elif visual.kind == "texture":
            colors = np.asarray(visual.material.main_color)
        elif visual.kind in ("vertex", "face"):
            colors = np.asarray(visual.vertex_colors)
        else:
            colors = np.array(_GRAY)
    except Exception:  # a texture that cannot be read must not cost the shape
        colors = np.array(_GRAY)
    return np.broadcast_to(colors[..., :3].astype(np.uint8), (count, 3))


def _has_image(material: Any) -> bool:
    images = (getattr(material, "image", None), getattr(material, "baseColorTexture", None))
    return any(image is not None for image in images)


def _geometry(
    geometry: ElementTree.Element | None,
    robot: Robot,
    loaded: dict[Path, Mesh],
    missing: dict[str, str],
) -> Mesh | None:
    if geometry is None or not len(geometry):
        return None
    shape = geometry[0]
    if shape.tag == "mesh":
        return _mesh(shape, robot, loaded, missing)
    if shape.tag == "box":
        vertices, faces = surfaces.box(_vector(shape, "size", (1.0, 1.0, 1.0)))
    elif shape.tag == "cylinder":
        radius, length = float(shape.get("radius", 0)), float(shape.get("length", 0))
        vertices, faces = surfaces.rod(radius)
        vertices = (vertices - [0.0, 0.0, 0.5]) * [1.0, 1.0, length]
    elif shape.tag == "sphere":
        vertices, faces = surfaces.ball(float(shape.get("radius", 0)))
    else:
        return None
    return Mesh(vertices, faces, None, np.broadcast_to(np.array(_GRAY, np.uint8), vertices.shape))


def _mesh(
    element: ElementTree.Element,
    robot: Robot,
    loaded: dict[Path, Mesh],
    missing: dict[str, str],
) -> Mesh | None:
    name = element.get("filename", "")
    path = mesh_file(name, robot.urdf, robot.package_dirs)
    if path is None:
        missing[name] = "there is no such file"
        return None
    if path not in loaded:
        try:
            loaded[path] = read_mesh(path)
        except Exception as problem:  # each format's reader raises its own
            missing[name] = str(problem) or type(problem).__name__
            return None
    mesh, scale = loaded[path], _vector(element, "scale", (1.0, 1.0, 1.0))
    if (scale == 1.0).all():
        return mesh
    normals = None if mesh.normals is None else mesh.normals * np.sign(scale)
    return replace(mesh, vertices=mesh.vertices * scale, normals=normals)


def _painted(mesh: Mesh, color: tuple[float, ...] | None) -> Mesh:
    if color is None:
        return mesh
    one = np.round(255.0 * np.clip(color[:3], 0.0, 1.0)).astype(np.uint8)
    return replace(mesh, colors=np.broadcast_to(one, mesh.vertices.shape), opacity=color[3])


def _rgba(material: ElementTree.Element) -> tuple[float, ...] | None:
    color = material.find("color")
    if color is None:
        return None
    try:
        values = tuple(float(x) for x in color.get("rgba", "").split())
    except ValueError:
        return None  # a colour that is none stops no replay
    return values if len(values) == 4 else None


def _origin(origin: ElementTree.Element | None) -> pin.SE3:
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (_vector(origin, key, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _vector(element: ElementTree.Element, key: str, default: Sequence[float]) -> np.ndarray:
    values = [float(x) for x in element.get(key, "").split()]
    return np.array(values if len(values) == 3 else default)
