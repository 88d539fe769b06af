"""How large a URDF's links are, by their visuals and collision shapes."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinfric.model.magnitudes import LARGEST, impossible
from pinfric.model.urdf import mesh_file, read_mesh_scene

_CORNERS = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T


@dataclass(frozen=True)
class Extent:
    """The box that holds a link's shapes.

    Attributes:
        low, high: (3,) its corners, m, in the link's frame and along its axes.
        hull: volume of the convex hull of its visuals or collision shapes, the larger one, m^3.
        solids: volumes in its visuals and in its collision shapes, m^3; 0 where not all of them are
            closed meshes.
    """

    low: np.ndarray
    high: np.ndarray
    hull: float = 0.0
    solids: tuple[float, float] = (0.0, 0.0)

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


class MeasuredLinks(Mapping[str, Extent]):
    """The extents of those links of a checked URDF that have shapes, measured when asked for.

    Attributes:
        unread: mesh that cannot be read -> why, of the links measured so far.
    """

    def __init__(self, root: ElementTree.Element, urdf: Path, folders: Sequence[Path]) -> None:
        """`folders`: where `package://` names may begin."""
        self._links = {link.attrib["name"]: link for link in root.findall("link")}
        self._urdf, self._folders = urdf, folders
        self._measured: dict[str, Extent | None] = {}
        self.unread: dict[str, str] = {}

    def __getitem__(self, link: str) -> Extent:
        if link not in self._measured:
            self._measured[link] = self._measure(self._links[link])
        if (extent := self._measured[link]) is None:
            raise KeyError(link)
        return extent

    def __iter__(self) -> Iterator[str]:
        return (link for link in self._links if link in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _measure(self, link: ElementTree.Element) -> Extent | None:
        corners, hulls, solids = list[np.ndarray](), list[float](), list[float]()
        for kind in ("visual", "collision"):
            points, held, hull, closed = list[np.ndarray](), 0.0, 0.0, True
            for shape in link.findall(kind):
                placed = _shape(shape, self._urdf, self._folders, self.unread)
                if placed is None:
                    closed = False
                    continue
                body, scale = placed
                place = place_of(shape.find("origin"))
                with np.errstate(all="ignore"):
                    box, around = (
                        scale * part @ place[:3, :3].T + place[:3, 3]
                        for part in (body.corners, body.points)
                    )
                if impossible(box, LARGEST).any():
                    name = link.attrib["name"]
                    self.unread[f"a shape of {name}"] = "its sizes or positions are implausible"
                    closed = False
                    continue
                corners.append(box)
                points.append(around)
                grown = float(np.abs(np.prod(scale)))
                held, hull = held + body.solid * grown, body.hull * grown
                closed &= body.solid > 0.0
            hulls.append(hull if len(points) == 1 else _volume(points))
            solids.append(held if closed else 0.0)
        if not corners:
            return None
        ends = np.concatenate(corners)
        return Extent(ends.min(axis=0), ends.max(axis=0), max(hulls), (solids[0], solids[1]))


@dataclass(frozen=True)
class _Shape:
    """A shape in its own frame: corners (8, 3) of its box, points on its hull; see `Extent`."""

    corners: np.ndarray
    points: np.ndarray
    solid: float = 0.0

    @cached_property
    def hull(self) -> float:
        """Volume of its convex hull."""
        return _volume([self.points])


#: A box; a cylinder and a sphere, with edges of 1: their hulls hold 99 % of them.
_TURN = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
_BOX = _Shape(_CORNERS, _CORNERS)
_ROUND = _Shape(
    _CORNERS,
    np.array([(np.cos(t) / 2, np.sin(t) / 2, end) for t in _TURN for end in (-0.5, 0.5)]),
)
_BALL = _Shape(
    _CORNERS,
    np.array(
        [
            (np.cos(t) * np.sin(u) / 2, np.sin(t) * np.sin(u) / 2, np.cos(u) / 2)
            for t in _TURN
            for u in np.linspace(0.0, np.pi, 17)
        ]
    ),
)


def _shape(
    shape: ElementTree.Element, urdf: Path, folders: Sequence[Path], unread: dict[str, str]
) -> tuple[_Shape, np.ndarray] | None:
    """A shape before its scale, and the scale (3,)."""
    (body,) = shape.findall("geometry/*")[:1]
    if body.tag == "box":
        return _BOX, np.array(numbers(body, "size"))
    if body.tag != "mesh":
        across = 2.0 * float(body.attrib["radius"])
        height = float(body.get("length", across))
        ring = _BALL if body.tag == "sphere" else _ROUND
        return ring, np.array([across, across, height])
    name = body.get("filename", "")
    path = mesh_file(name, urdf, folders)
    if path is None:
        return None  # said where the robot is read
    read = _mesh(path)
    if isinstance(read, str):
        unread[name] = read
        return None
    return read, np.array(numbers(body, "scale") or [1.0] * 3)


def _volume(points: Sequence[np.ndarray]) -> float:
    """Of the convex hull of points, m^3; 0 where they are flat."""
    from scipy.spatial import ConvexHull, QhullError  # 0.2 s: only where shapes are measured

    if not points:
        return 0.0
    try:
        return float(ConvexHull(np.concatenate(points)).volume)
    except (QhullError, ValueError):
        return 0.0


def place_of(origin: ElementTree.Element | None) -> np.ndarray:
    """Return an <origin> as a matrix (4, 4), without one the identity."""
    xyz, rpy = (np.array(numbers(origin, key) or [0.0] * 3) for key in ("xyz", "rpy"))
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = pin.rpy.rpyToMatrix(rpy), xyz
    return place


def numbers(element: ElementTree.Element | None, key: str) -> list[float]:
    """Return the numbers of an attribute; none where it is missing."""
    return [] if element is None else [float(x) for x in element.get(key, "").split()]


@lru_cache(maxsize=512)
@np.errstate(all="ignore")  # of corners that are no numbers, which are refused below
def _mesh(path: Path) -> _Shape | str:
    """A mesh in m, before the URDF's scale, or why it cannot be read."""
    from scipy.spatial import ConvexHull

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
