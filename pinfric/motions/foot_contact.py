"""Where a link touches the ground: by its simple collision shapes, as simulators take them.

MJCFs and some URDFs have no link for a foot: a ball at the end of the shank is one, balls or a box
below the ankle are a sole.
"""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from pinfric.model.schema import Foot

#: m: what a sole has at least in both directions.
_LEAST = 0.02
_MIDDLES = np.vstack([np.eye(3), -np.eye(3)])


def touching(root: ElementTree.Element, link: str, sole: bool) -> Foot | None:
    """Return a link as a foot; None: it has no simple shapes for it.

    A sole is the box of its shapes, at its lowest z; a point the end of a shape that is farthest
    from the link's origin: the middle of a ball, or of the end of a cylinder or a box.

    Args:
        root: of a checked URDF. sole: or a point.
    """
    (own,) = (x for x in root.findall("link") if x.get("name") == link)
    ends = [end for shape in own.findall("collision") for end in _ends(shape, corners=sole)]
    if not ends:
        return None
    places = np.array([place for place, _ in ends])
    if not sole:
        far = places[int(np.linalg.norm(places, axis=1).argmax())]
        return Foot(xyz=_rounded(far))
    low, high = places.min(axis=0), places.max(axis=0)
    length, width, _ = high - low
    if min(length, width) < _LEAST:
        return None
    bottom = min(place[2] - radius for place, radius in ends)
    middle = np.array([*0.5 * (low + high)[:2], bottom])
    size = {"length": round(float(length), 4), "width": round(float(width), 4)}
    return Foot(xyz=_rounded(middle), **size)


def _ends(shape: ElementTree.Element, corners: bool) -> Iterator[tuple[np.ndarray, float]]:
    """Yield places on a shape in the link's frame, and its radius around each, m.

    corners: of a box, or the middles of its sides.
    """
    origin = shape.find("origin")
    xyz, rpy = (
        [float(x) for x in (origin.get(key, "0 0 0") if origin is not None else "0 0 0").split()]
        for key in ("xyz", "rpy")
    )
    place = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
    (body,) = shape.findall("geometry/*")[:1]
    if body.tag == "sphere":
        yield place.translation, float(body.attrib["radius"])
    elif body.tag == "cylinder":
        for side in (-0.5, 0.5):
            yield place.act(np.array([0.0, 0.0, side * float(body.attrib["length"])])), 0.0
    elif body.tag == "box":
        half = 0.5 * np.array([float(x) for x in body.attrib["size"].split()])
        ends = list(itertools.product((-1.0, 1.0), repeat=3)) if corners else _MIDDLES
        for there in np.array(ends):
            yield place.act(half * there), 0.0


def _rounded(place: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(x), 4) for x in place)
    return x, y, z
