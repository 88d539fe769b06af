"""How large a URDF's links are, by their visuals and collision shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.model.magnitudes import LARGEST, impossible
from pinfric.model.urdf import mesh_file, read_mesh_scene

_CORNERS = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T


@dataclass(frozen=True)
class Extent:
    """The box that holds a link's shapes.

    Attributes:
        low, high: (3,) its corners, m, in the link's frame and along its axes.
    """

    low: np.ndarray
    high: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """(3,) edges, m."""
        return self.high - self.low

    @property
    def diagonal(self) -> float:
        """From corner to corner, m."""
        return float(np.linalg.norm(self.size))

    def distance(self, point: np.ndarray) -> float:
        """Return how far a point of the link's frame is outside the box (m); 0 within."""
        return float(np.linalg.norm(np.maximum(np.maximum(self.low - point, point - self.high), 0)))

    def farthest(self, point: np.ndarray) -> float:
        """Return the distance from a point to the farthest corner (m)."""
        return float(np.linalg.norm(np.maximum(abs(self.low - point), abs(self.high - point))))


def link_extents(
    document: Any, urdf: Path, folders: Sequence[Path]
) -> tuple[dict[str, Extent], dict[str, str]]:
    """Return link -> its extent where it has shapes, and mesh -> why it cannot be read.

    Args:
        document: as `read_document` returns it.
        urdf: the file.
        folders: where `package://` names may begin.
    """
    extents: dict[str, Extent] = {}
    unread: dict[str, str] = {}
    for link in document.links:
        corners = []
        for shape in (*link.visuals, *link.collisions):
            box = _shape_box(shape, urdf, folders, unread)
            if box is not None:
                origin = place_of(shape.origin)
                turn, place = origin[:3, :3], origin[:3, 3]
                center, size = box
                with np.errstate(all="ignore"):
                    points = (center + _CORNERS * size) @ turn.T + place
                if impossible(points, LARGEST).any():
                    unread[f"a shape of {link.name}"] = "its sizes or positions are implausible"
                    continue
                corners.append(points)
        if corners:
            points = np.concatenate(corners)
            extents[link.name] = Extent(points.min(axis=0), points.max(axis=0))
    return extents, unread


def _shape_box(
    shape: Any, urdf: Path, folders: Sequence[Path], unread: dict[str, str]
) -> tuple[np.ndarray, np.ndarray] | None:
    """Centre and edges of the box that holds a shape, in the shape's frame."""
    mesh = shape.geometry.mesh
    if mesh is None:
        return np.zeros(3), _edges(shape.geometry)
    path = mesh_file(mesh.filename, urdf, folders)
    if path is None:
        return None  # said where the robot is read
    bounds = _mesh_bounds(path)
    if isinstance(bounds, str):
        unread[str(mesh.filename)] = bounds
        return None
    low, high = (1.0 if mesh.scale is None else mesh.scale) * bounds
    return (low + high) / 2.0, np.abs(high - low)


def _edges(geometry: Any) -> np.ndarray:
    """Edges of the box that holds a body (m)."""
    if geometry.box is not None:
        return np.asarray(geometry.box.size)
    body = geometry.sphere or geometry.cylinder
    across = 2.0 * body.radius
    return np.array([across, across, across if geometry.sphere else body.length])


def place_of(origin: np.ndarray | None) -> np.ndarray:
    """Return an <origin> as a matrix (4, 4); without one, nothing is moved."""
    return np.eye(4) if origin is None else origin


@lru_cache(maxsize=512)
def _mesh_bounds(path: Path) -> np.ndarray | str:
    """(2, 3) the corners of a mesh in m, before the URDF's scale, or why it cannot be read."""
    try:
        scene, unit = read_mesh_scene(path)
        bounds = scene.bounds
    except Exception as problem:  # each format's reader raises its own
        return " ".join(str(problem).split()) or type(problem).__name__
    if bounds is None or not np.isfinite(bounds).all():
        return "it has no points, or points that are not finite"
    return unit * np.asarray(bounds)
