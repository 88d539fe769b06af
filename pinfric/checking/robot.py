"""A URDF as the checks see it: its links' sizes, masses, and what carries them."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.checking.link_extent import Extent, link_extents, place_of
from pinfric.errors import FindingWarning, PinfricWarning
from pinfric.model.mimics import lost_leaders
from pinfric.model.robot import mesh_folders
from pinfric.model.urdf import (
    bodies,
    check_urdf,
    missing_meshes,
    read_document,
    still_links,
)
from pinfric.model.urdf_file import read_xml

#: Shapes smaller than this part of the robot's reach stand in for something.
_STAND_IN = 0.01


#: A shape so many times the robot's reach, and so large (m), is in another unit.
SHAPE_OVER_REACH, _LEAST_OVERSIZE = 20.0, 2.0
#: No link, payload or centre of mass is so many times as far away as the robot reaches. (The reach
#: ends at the last joint: the last link may be longer than all before it.)
BEYOND = 3.0


@dataclass(frozen=True)
class LinkFacts:
    """One link that moves.

    Attributes:
        mass: kg. inertia: (3, 3) kg m^2 about the centre of mass.
        com: (3,) m, in the link's frame. com_given: whether the URDF says it; else it is 0.
        extent: the box of its shapes; without shapes a cube of `BEYOND` times the robot's reach.
        has_shapes: whether `extent` is that of shapes.
        mass_share, inertia_share: its part of the links it is fixed to; 1 where it is alone.
    """

    name: str
    mass: float
    inertia: np.ndarray
    com: np.ndarray
    com_given: bool
    extent: Extent
    has_shapes: bool
    mass_share: float
    inertia_share: float


@dataclass(frozen=True)
class RobotFacts:
    """A URDF, read and measured.

    Attributes:
        root, document: its XML, and the same as yourdfpy reads it (`read_document`).
        nameless: the file gives the robot no name.
        lost: joint -> the leader that is not there.
        missing, unread: meshes that are not there; those that cannot be read -> why.
        extents: link -> box of its shapes.
        said: what reading warned of that is no other fact.
        xacro_args: with which it was read.
    """

    urdf: Path
    root: ElementTree.Element
    document: Any
    nameless: bool
    lost: dict[str, str]
    missing: list[str]
    unread: dict[str, str]
    extents: dict[str, Extent]
    said: tuple[str, ...]
    xacro_args: Mapping[str, str]

    @classmethod
    def of(cls, urdf: Path, xacro_args: Mapping[str, str] | None = None) -> RobotFacts:
        """Read a URDF and its meshes; what loading warns of is among the facts.

        Raises:
            RobotError: see `read_document`.
        """
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", PinfricWarning)
            root = read_xml(urdf, xacro_args)
            lost, nameless = lost_leaders(root), not root.get("name")
            check_urdf(root, urdf)
        texts = (
            str(warning.message).removeprefix(f"{urdf}: ")
            for warning in said
            if not issubclass(warning.category, FindingWarning)
        )
        document = read_document(root, urdf)
        folders = mesh_folders(urdf)
        extents, unread = link_extents(document, urdf, folders)
        return cls(
            urdf,
            root,
            document,
            nameless,
            lost,
            missing_meshes(root, urdf, folders),
            unread,
            extents,
            tuple(texts),
            xacro_args or {},
        )

    @cached_property
    def elements(self) -> dict[str, ElementTree.Element]:
        """Joint -> its XML: what the document does not keep."""
        return {str(joint.get("name")): joint for joint in self.root.findall("joint")}

    @cached_property
    def reach(self) -> float:
        """The longest way from the root along the joints' origins, m."""
        return self._longest(from_root=True)

    @cached_property
    def way(self) -> float:
        """The longest way along the joints' origins after the first that moves, m."""
        return self._longest(from_root=False)

    def _longest(self, from_root: bool) -> float:
        far = dict.fromkeys(self._roots, 0.0 if from_root else -np.inf)
        for joint in self._downwards:
            length = float(np.linalg.norm(place_of(joint.origin)[:3, 3]))
            far[joint.child] = far[joint.parent] + length
            if joint.type != "fixed":
                far[joint.child] = max(far[joint.child], 0.0)
        return max(max(far.values()), 0.0)

    @cached_property
    def ways(self) -> list[list[str]]:
        """The links on each way from a root to a tip."""
        ways = {root: [root] for root in self._roots}
        for joint in self._downwards:
            ways[joint.child] = [*ways[joint.parent], joint.child]
        carrying = {joint.parent for joint in self.document.joints}
        return [way for tip, way in ways.items() if tip not in carrying]

    @property
    def root_link(self) -> str:
        """The link that no joint carries."""
        return self._roots[0]

    @cached_property
    def _roots(self) -> list[str]:
        carried = {joint.child for joint in self.document.joints}
        return [link.name for link in self.document.links if link.name not in carried]

    @cached_property
    def _downwards(self) -> list[Any]:
        """The joints, each after those that carry it."""
        below: dict[str, list[Any]] = {}
        for joint in self.document.joints:
            below.setdefault(joint.parent, []).append(joint)
        links, ahead = list[Any](), list(self._roots)
        while ahead:
            joints = below.get(ahead.pop(), [])
            links += joints
            ahead += [joint.child for joint in joints]
        return links

    @cached_property
    def still(self) -> set[str]:
        """Links that never move."""
        return still_links(self.root)

    @cached_property
    def fixed_mass(self) -> dict[str, float]:
        """Link that never moves -> its mass, where it has one."""
        return {name: m for name, m in self.masses.items() if name in self.still and m > 0}

    @cached_property
    def bodies(self) -> dict[str, tuple[float, np.ndarray]]:
        """Link -> its mass and inertia, zeros where it has none."""
        nothing = {link.name: (0.0, np.zeros((3, 3))) for link in self.document.links}
        return nothing | bodies(self.root)

    @property
    def masses(self) -> dict[str, float]:
        """Link -> its mass, kg."""
        return {name: mass for name, (mass, _) in self.bodies.items()}

    @cached_property
    def shapes(self) -> dict[str, Extent]:
        """Link -> box of its shapes, where they are no stand-in."""
        least = _STAND_IN * self.reach
        return {name: box for name, box in self.extents.items() if box.diagonal >= least}

    @cached_property
    def links(self) -> tuple[LinkFacts, ...]:
        """The links that move and have an inertial."""
        whole: dict[str, np.ndarray] = {}  # body -> its links' masses and moments, summed
        for name, (mass, inertia) in self.bodies.items():
            both = np.array([mass, np.trace(inertia)])
            whole[self._body(name)] = whole.get(self._body(name), np.zeros(2)) + both
        facts = []
        # where a link without shapes surely ends: its length is not known, only the others'
        half = np.full(3, BEYOND * self.reach)
        for link in self.document.links:
            if link.inertial is None or link.name in self.still:
                continue
            mass, inertia = self.bodies[link.name]
            total = whole[self._body(link.name)]
            shares = np.divide([mass, np.trace(inertia)], total, np.zeros(2), where=total > 0)
            at = link.inertial.origin
            shapes = self.shapes.get(link.name)
            facts.append(
                LinkFacts(
                    link.name,
                    mass,
                    inertia,
                    place_of(at)[:3, 3],
                    at is not None,
                    shapes or Extent(-half, half),
                    shapes is not None,
                    *map(float, shares),
                )
            )
        return tuple(facts)

    def oversized(self, extent: Extent) -> bool:
        """Return whether shapes are too large beside the robot: in another unit."""
        return extent.diagonal >= max(SHAPE_OVER_REACH * self.reach, _LEAST_OVERSIZE)

    def moved_mass(self, joint: Any) -> float:
        """Return the mass beyond a joint, kg."""
        masses = self.masses
        beyond, ahead = 0.0, [joint.child]
        while ahead:
            link = ahead.pop()
            beyond += masses[link]
            ahead += [below.child for below in self.document.joints if below.parent == link]
        return beyond

    def fixed_to(self, link: str) -> list[str]:
        """Return all links that move with a link as one body."""
        return [x.name for x in self.document.links if self._body(x.name) == self._body(link)]

    def _body(self, link: str) -> str:
        """The link that stands for all those fixed to each other."""
        above = self._fixed_above
        while link in above:
            link = above[link]
        return link

    @cached_property
    def _fixed_above(self) -> dict[str, str]:
        return {j.child: j.parent for j in self.document.joints if j.type == "fixed"}
