"""How large a URDF's links are, by their visuals and collision shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from pinfric.model.magnitudes import LARGEST, impossible
from pinfric.model.urdf import mesh_file, read_mesh_scene

_CORNERS = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
#: Points of a cylinder's ends and of a sphere, with edges of 1: their hulls hold 99 % of them.
_TURN = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
_ROUND = np.array([(np.cos(t) / 2, np.sin(t) / 2, end) for t in _TURN for end in (-0.5, 0.5)])
_BALL = np.array(
    [
        (np.cos(t) * np.sin(u) / 2, np.sin(t) * np.sin(u) / 2, np.cos(u) / 2)
        for t in _TURN
        for u in np.linspace(0.0, np.pi, 17)
    ]
)


@dataclass(frozen=True)
class Extent:
    """The box that holds a link's shapes.

    Attributes:
        low, high: (3,) its corners, m, in the link's frame and along its axes.
        hull: volume of the convex hull of its visuals or collision shapes, the larger one, m^3.
        solid: volume in its visuals, or else its collision shapes, if all are closed meshes, m^3; 0
            otherwise.
    """

    low: np.ndarray
    high: np.ndarray
    hull: float = 0.0
    solid: float = 0.0

    @property
    def size(self) -> np.ndarray:
        """(3,) edges, m."""
        return self.high - self.low

    @property
    def diagonal(self) -> float:
        """From corner to corner, m."""
        return float(np.linalg.norm(self.size))

    def distance(self, point: np.ndarray) -> float:
        """Return how far a point of the link's frame is outside the box, m."""
        return float(np.linalg.norm(np.maximum(np.maximum(self.low - point, point - self.high), 0)))

    def farthest(self, point: np.ndarray) -> float:
        """Return the distance from a point to the farthest corner (m)."""
        return float(np.linalg.norm(np.maximum(abs(self.low - point), abs(self.high - point))))


def link_extents(
    document: Any, urdf: Path, folders: Sequence[Path]
) -> tuple[dict[str, Extent], dict[str, str]]:
    """Return link -> its extent where it has shapes, and mesh -> why it cannot be read.

    `folders`: where `package://` names may begin.
    """
    extents: dict[str, Extent] = {}
    unread: dict[str, str] = {}
    for link in document.links:
        corners, hulls, solids = [], [0.0], [0.0]
        for shapes in (link.visuals, link.collisions):
            points, held, closed = [], 0.0, True
            for shape in shapes:
                placed = _shape(shape, urdf, folders, unread)
                if placed is None:
                    closed = False
                    continue
                body, scale = placed
                origin = place_of(shape.origin)
                with np.errstate(all="ignore"):
                    box, around = (
                        scale * part @ origin[:3, :3].T + origin[:3, 3]
                        for part in (body.corners, body.points)
                    )
                if impossible(box, LARGEST).any():
                    unread[f"a shape of {link.name}"] = "its sizes or positions are implausible"
                    closed = False
                    continue
                corners.append(box)
                points.append(around)
                held += body.solid * float(np.abs(np.prod(scale)))
                closed &= body.solid > 0.0
            hulls.append(_volume(points))
            solids.append(held if closed else 0.0)
        if corners:
            ends = np.concatenate(corners)
            solid = next((held for held in solids if held), 0.0)
            extents[link.name] = Extent(ends.min(axis=0), ends.max(axis=0), max(hulls), solid)
    return extents, unread


@dataclass(frozen=True)
class _Shape:
    """A shape in its own frame: corners (8, 3) of its box, points on its hull; see `Extent`."""

    corners: np.ndarray
    points: np.ndarray
    solid: float = 0.0


def _shape(
    shape: Any, urdf: Path, folders: Sequence[Path], unread: dict[str, str]
) -> tuple[_Shape, np.ndarray] | None:
    """A shape before its scale, and the scale (3,)."""
    geometry, mesh = shape.geometry, shape.geometry.mesh
    if geometry.box is not None:
        return _Shape(_CORNERS, _CORNERS), np.asarray(geometry.box.size, dtype=float)
    if mesh is None:
        body = geometry.sphere or geometry.cylinder
        across = 2.0 * body.radius
        height = across if geometry.sphere else body.length
        ring = _BALL if geometry.sphere else _ROUND
        return _Shape(_CORNERS, ring), np.array([across, across, height], dtype=float)
    path = mesh_file(mesh.filename, urdf, folders)
    if path is None:
        return None  # said where the robot is read
    read = _mesh(path)
    if isinstance(read, str):
        unread[str(mesh.filename)] = read
        return None
    return read, np.ones(3) if mesh.scale is None else np.ones(3) * mesh.scale


def _volume(points: Sequence[np.ndarray]) -> float:
    """Of the convex hull of points, m^3; 0 where they are flat."""
    if not points:
        return 0.0
    try:
        return float(ConvexHull(np.concatenate(points)).volume)
    except (QhullError, ValueError):
        return 0.0


def place_of(origin: np.ndarray | None) -> np.ndarray:
    """Return an <origin> as a matrix (4, 4), without one the identity."""
    return np.eye(4) if origin is None else origin


@lru_cache(maxsize=512)
def _mesh(path: Path) -> _Shape | str:
    """A mesh in m, before the URDF's scale, or why it cannot be read."""
    try:
        scene, unit = read_mesh_scene(path)
        bounds = scene.bounds
    except Exception as problem:  # each format's reader raises its own
        return " ".join(str(problem).split()) or type(problem).__name__
    if bounds is None or not np.isfinite(bounds).all():
        return "it has no points, or points that are not finite"
    low, high = unit * np.asarray(bounds)
    corners = (low + high) / 2.0 + _CORNERS * (high - low)
    solid = 0.0
    try:
        whole = scene.to_mesh()
        points = unit * np.asarray(whole.vertices)[ConvexHull(whole.vertices).vertices]
        whole.merge_vertices(merge_tex=True, merge_norm=True)
        if whole.is_watertight and whole.is_winding_consistent:
            solid = abs(float(whole.volume)) * unit**3
    except Exception:  # flat, or without faces: its box has to do
        points = corners
    return _Shape(corners, points, solid)
