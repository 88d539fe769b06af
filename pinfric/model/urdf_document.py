"""What a URDF says of links and joints, as data: all that Pinocchio's model does not keep."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from typing import cast

import numpy as np
import pinocchio as pin

_MOMENTS = ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")
_BODIES = ("box", "cylinder", "sphere", "mesh")


@dataclass(frozen=True)
class Shape:
    """A `<visual>` or `<collision>`: a mesh, or what fits a box.

    Attributes:
        origin: (4, 4) its frame in the link's.
        size: (3,) m, edges of the box around its frame that holds it; None of a mesh.
        mesh: file name as written (empty where it is missing); None of other shapes.
        scale: (3,) of the mesh.
    """

    origin: np.ndarray
    size: np.ndarray | None
    mesh: str | None
    scale: np.ndarray


@dataclass(frozen=True)
class Inertial:
    """A link's mass (kg), its inertia (3, 3) about the centre of mass (kg m^2), and where that is.

    Attributes:
        com: (3,) m, in the link's frame; None where the file has no <origin>.
    """

    mass: float
    inertia: np.ndarray
    com: np.ndarray | None


@dataclass(frozen=True)
class Link:
    """A link: its name, its inertial if it has one, and its visuals and collision shapes."""

    name: str
    inertial: Inertial | None
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class Limit:
    """A joint's limits (rad or m; N m or N; rad/s or m/s), each None where it is not given."""

    lower: float | None
    upper: float | None
    effort: float | None
    velocity: float | None


@dataclass(frozen=True)
class UrdfDynamics:
    """A joint's friction (N m or N) and damping (N m s/rad or N s/m), 0 where not given."""

    friction: float
    damping: float


@dataclass(frozen=True)
class Mimic:
    """The joint that a follower follows: position = multiplier * the leader's + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint.

    Attributes:
        name, type: as written.
        parent, child: links.
        offset: (3,) m, of its frame in the parent's.
        axis: (3,) as written.
        limit, dynamics, mimic: None where there is none.
    """

    name: str
    type: str
    parent: str
    child: str
    offset: np.ndarray
    axis: np.ndarray
    limit: Limit | None
    dynamics: UrdfDynamics | None
    mimic: Mimic | None


@dataclass(frozen=True)
class Document:
    """A URDF's links and joints, in the file's order."""

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]


def parse_document(root: ElementTree.Element) -> Document:
    """Return a URDF's links and joints.

    Args:
        root: whose names, types, ends and numbers were checked.

    Raises:
        ValueError: a shape without a geometry, or without one of its measures.
    """
    return Document(
        tuple(_link(link) for link in root.findall("link")),
        tuple(_joint(joint) for joint in root.findall("joint")),
    )


def _link(link: ElementTree.Element) -> Link:
    name = str(link.get("name"))
    shapes = [
        _shape(shape, name) for shape in (*link.findall("visual"), *link.findall("collision"))
    ]
    return Link(name, _inertial(link.find("inertial")), tuple(shapes))


def _inertial(inertial: ElementTree.Element | None) -> Inertial | None:
    if inertial is None:
        return None
    mass, moments = cast(ElementTree.Element, inertial.find("mass")), inertial.find("inertia")
    values = [0.0 if moments is None else _number(moments, key) or 0.0 for key in _MOMENTS]
    origin = inertial.find("origin")
    com = None if origin is None else _vector(origin, "xyz", 0.0)
    return Inertial(float(mass.attrib["value"]), np.reshape(values, (3, 3)), com)


def _shape(shape: ElementTree.Element, link: str) -> Shape:
    geometry = shape.find("geometry")
    where = f"link {link!r}: a <{shape.tag}>"
    if geometry is None or not len(geometry) or geometry[0].tag not in _BODIES:
        raise ValueError(f"{where} needs a <geometry>, of {', '.join(_BODIES)}")
    body = geometry[0]
    origin = shape.find("origin")
    placement = np.eye(4)
    if origin is not None:
        placement[:3, :3] = pin.rpy.rpyToMatrix(_vector(origin, "rpy", 0.0))
        placement[:3, 3] = _vector(origin, "xyz", 0.0)
    try:
        size = _size(body)
    except KeyError as missing:
        raise ValueError(f"{where} has a <{body.tag}> without {missing.args[0]}") from None
    return Shape(
        placement,
        size,
        body.get("filename", "") if body.tag == "mesh" else None,
        _vector(body, "scale", 1.0),
    )


def _size(body: ElementTree.Element) -> np.ndarray | None:
    """Edges of the box that holds a body (m), None of a mesh."""
    if body.tag == "mesh":
        return None
    if body.tag == "box":
        return np.array(body.attrib["size"].split(), dtype=float)
    if body.tag == "sphere":
        return np.full(3, 2.0 * float(body.attrib["radius"]))
    across = 2.0 * float(body.attrib["radius"])
    return np.array([across, across, float(body.attrib["length"])])


def _joint(joint: ElementTree.Element) -> Joint:
    found = {element.tag: element for element in reversed(joint)}  # the first of each counts
    limit, dynamics, mimic = (found.get(tag) for tag in ("limit", "dynamics", "mimic"))
    return Joint(
        name=joint.attrib["name"],
        type=joint.attrib["type"],
        parent=found["parent"].attrib["link"],
        child=found["child"].attrib["link"],
        offset=_vector(found["origin"], "xyz", 0.0) if "origin" in found else np.zeros(3),
        axis=_vector(found["axis"], "xyz", 0.0) if "axis" in found else np.array([1.0, 0.0, 0.0]),
        limit=None
        if limit is None
        else Limit(
            _number(limit, "lower"),
            _number(limit, "upper"),
            _number(limit, "effort"),
            _number(limit, "velocity"),
        ),
        dynamics=None
        if dynamics is None
        else UrdfDynamics(
            _number(dynamics, "friction") or 0.0, _number(dynamics, "damping") or 0.0
        ),
        mimic=None
        if mimic is None
        else Mimic(
            mimic.attrib["joint"],
            float(mimic.get("multiplier", 1.0)),
            float(mimic.get("offset", 0.0)),
        ),
    )


def _vector(element: ElementTree.Element, key: str, default: float) -> np.ndarray:
    text = element.get(key)
    return np.full(3, default) if text is None else np.array(text.split(), dtype=float)


def _number(element: ElementTree.Element, key: str) -> float | None:
    text = element.get(key)
    return None if text is None else float(text)
