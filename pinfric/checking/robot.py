"""A URDF as the checks see it: its links' sizes, masses, and what carries them."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from pinfric.checking.link_extent import Extent, MeasuredLinks, numbers, place_of
from pinfric.errors import FindingWarning, PinfricWarning
from pinfric.model.floating import set_base
from pinfric.model.mimics import link_of, lost_leaders
from pinfric.model.robot import mesh_folders
from pinfric.model.urdf import bodies, check_urdf, missing_meshes, still_links
from pinfric.model.urdf_file import read_xml

#: Shapes smaller than this part of the robot's length stand in for something.
_STAND_IN = 0.01


#: A shape so many times the robot's length, and so large (m), is in another unit.
SHAPE_OVER_LENGTH, _LEAST_OVERSIZE = 20.0, 2.0
#: No link, payload or centre of mass is so many times as far away as the robot is long. (Its length
#: ends at the last joint: the last link may be longer than all before it.)
BEYOND = 3.0
#: A centre of mass outside its shapes, or a radius of gyration, is an error from these parts of the
#: robot's length on: other links need no shapes to tell that they have no error.
COM_OVER_LENGTH, GYRATION_OVER_LENGTH = 0.1, 0.5


@dataclass(frozen=True)
class JointFacts:
    """A joint as its URDF has it.

    Attributes:
        place: (4, 4) of its frame in that of its parent link.
        limit: lower, upper, effort, velocity as far as they are written; None: no <limit>.
        friction: of <dynamics>; 0 without.
        rpy: of its <origin>, as written.
        has_axis: whether it has an <axis>.
    """

    name: str
    type: str
    parent: str
    child: str
    place: np.ndarray
    limit: Mapping[str, float] | None
    friction: float
    rpy: tuple[float, ...]
    has_axis: bool

    @classmethod
    def of(cls, element: ElementTree.Element) -> JointFacts:
        """Read a checked <joint>."""
        origin, limit, dynamics = map(element.find, ("origin", "limit", "dynamics"))
        return cls(
            element.attrib["name"],
            element.attrib["type"],
            link_of(element, "parent"),
            link_of(element, "child"),
            place_of(origin),
            None if limit is None else {key: float(x) for key, x in limit.attrib.items()},
            0.0 if dynamics is None else float(dynamics.get("friction", 0)),
            tuple(numbers(origin, "rpy")),
            element.find("axis") is not None,
        )

    def stated(self, end: str) -> float:
        """Return a number of its <limit>, 0 where it is not written."""
        return (self.limit or {}).get(end, 0.0)


@dataclass(frozen=True)
class LinkFacts:
    """One link that moves.

    Attributes:
        mass: kg. inertia: (3, 3) kg m^2 about the centre of mass.
        com: (3,) m, in the link's frame. com_given: whether the URDF says it; else it is 0.
        mass_share, inertia_share: its part of the links it is fixed to; 1 where it is alone.
        joints: (n, 3) where the joints that it carries stand, and its own origin, m.
    """

    name: str
    mass: float
    inertia: np.ndarray
    com: np.ndarray
    com_given: bool
    mass_share: float
    inertia_share: float
    joints: np.ndarray
    robot: RobotFacts = field(repr=False, compare=False)

    @cached_property
    def has_shapes(self) -> bool:
        """Whether `extent` is that of shapes."""
        return self.name in self.robot.shapes

    @cached_property
    def extent(self) -> Extent:
        """The box of its shapes; without shapes a cube of `BEYOND` times the robot's length."""
        half = np.full(3, BEYOND * self.robot.length)
        return self.robot.shapes.get(self.name, Extent(-half, half))

    @property
    def radius(self) -> float:
        """Largest radius of gyration about its centre of mass, m."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.inertia)[2], 0.0) / self.mass))

    @property
    def suspect(self) -> bool:
        """Whether an error is possible: by its joints alone, whatever its shapes."""
        if self.mass <= 0.0:
            return False
        outside = np.maximum(self.joints.min(axis=0) - self.com, self.com - self.joints.max(axis=0))
        away = float(np.linalg.norm(np.maximum(outside, 0.0)))
        length = self.robot.length
        return away > COM_OVER_LENGTH * length or self.radius > GYRATION_OVER_LENGTH * length


@dataclass(frozen=True)
class RobotFacts:
    """A URDF, read and measured.

    Attributes:
        root: its XML.
        nameless: the file gives the robot no name.
        lost: joint -> the leader that is not there.
        extents: link -> box of its shapes; a link's meshes are read when it is first asked for.
        said: what reading warned of that is no other fact.
        xacro_args: with which it was read.
        floating: whether its base was let free, or fixed; None: it is as its file says.
    """

    urdf: Path
    root: ElementTree.Element
    nameless: bool
    lost: dict[str, str]
    extents: Mapping[str, Extent]
    said: tuple[str, ...]
    xacro_args: Mapping[str, str]
    floating: bool | None = None

    @classmethod
    def of(
        cls,
        urdf: Path,
        xacro_args: Mapping[str, str] | None = None,
        floating: bool | None = None,
    ) -> RobotFacts:
        """Read a URDF, its base free or fixed by `floating`; what loading warns of is among the
        facts.

        Raises:
            RobotError: see `read_xml` and `check_urdf`.
        """
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", PinfricWarning)
            root = read_xml(urdf, xacro_args)
            lost, nameless = lost_leaders(root), not root.get("name")
            check_urdf(root, urdf)
            set_base(root, urdf, floating)
        texts = (
            str(warning.message).removeprefix(f"{urdf}: ")
            for warning in said
            if not issubclass(warning.category, FindingWarning)
        )
        extents = MeasuredLinks(root, urdf, mesh_folders(urdf))
        return cls(urdf, root, nameless, lost, extents, tuple(texts), xacro_args or {}, floating)

    @property
    def missing(self) -> list[str]:
        """Meshes that are not there."""
        return missing_meshes(self.root, self.urdf, mesh_folders(self.urdf))

    @property
    def unread(self) -> Mapping[str, str]:
        """Mesh that cannot be read -> why; of the links measured so far."""
        return getattr(self.extents, "unread", {})

    @cached_property
    def joints(self) -> tuple[JointFacts, ...]:
        """All joints, fixed ones too, in the order of the file."""
        return tuple(map(JointFacts.of, self.root.findall("joint")))

    @cached_property
    def moving_joints(self) -> int:
        """How many joints are not fixed."""
        return sum(joint.type != "fixed" for joint in self.joints)

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """All links, in the order of the file."""
        return tuple(link.attrib["name"] for link in self.root.findall("link"))

    @cached_property
    def drawn(self) -> set[str]:
        """Links that have a visual or a collision shape."""
        shapes = ("visual", "collision")
        links = self.root.findall("link")
        return {x.attrib["name"] for x in links if any(x.find(tag) is not None for tag in shapes)}

    @cached_property
    def length(self) -> float:
        """The longest way from the root along the joints' origins, m."""
        return self._longest(from_root=True)

    @cached_property
    def reach(self) -> float:
        """The longest way along the joints' origins after the first that moves, m."""
        return self._longest(from_root=False)

    def _longest(self, from_root: bool) -> float:
        far = dict.fromkeys(self._roots, 0.0 if from_root else -np.inf)
        for joint in self._downwards:
            far[joint.child] = far[joint.parent] + float(np.linalg.norm(joint.place[:3, 3]))
            if joint.type != "fixed":
                far[joint.child] = max(far[joint.child], 0.0)
        return max(max(far.values()), 0.0)

    @cached_property
    def ways(self) -> list[list[str]]:
        """The links on each way from a root to a tip."""
        ways = {root: [root] for root in self._roots}
        for joint in self._downwards:
            ways[joint.child] = [*ways[joint.parent], joint.child]
        carrying = {joint.parent for joint in self.joints}
        return [way for tip, way in ways.items() if tip not in carrying]

    @property
    def root_link(self) -> str:
        """The link that no joint carries."""
        return self._roots[0]

    @cached_property
    def _roots(self) -> list[str]:
        carried = {joint.child for joint in self.joints}
        return [name for name in self.link_names if name not in carried]

    @cached_property
    def _downwards(self) -> list[JointFacts]:
        """The joints, each after those that carry it."""
        below: dict[str, list[JointFacts]] = {}
        for joint in self.joints:
            below.setdefault(joint.parent, []).append(joint)
        links, ahead = list[JointFacts](), list(self._roots)
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
        nothing = {name: (0.0, np.zeros((3, 3))) for name in self.link_names}
        return nothing | bodies(self.root)

    @property
    def masses(self) -> dict[str, float]:
        """Link -> its mass, kg."""
        return {name: mass for name, (mass, _) in self.bodies.items()}

    @cached_property
    def shapes(self) -> Mapping[str, Extent]:
        """Link -> box of its shapes, where they are no stand-in."""
        return NoStandIns(self.extents, _STAND_IN * self.length)

    @cached_property
    def links(self) -> tuple[LinkFacts, ...]:
        """The links that move and have an inertial."""
        whole: dict[str, np.ndarray] = {}  # body -> its links' masses and moments, summed
        for name, (mass, inertia) in self.bodies.items():
            both = np.array([mass, np.trace(inertia)])
            whole[self._body(name)] = whole.get(self._body(name), np.zeros(2)) + both
        ends: dict[str, list[np.ndarray]] = {name: [np.zeros(3)] for name in self.link_names}
        for joint in self.joints:
            ends[joint.parent].append(joint.place[:3, 3])
        facts = []
        for link in self.root.findall("link"):
            name, inertial = link.attrib["name"], link.find("inertial")
            if inertial is None or name in self.still:
                continue
            mass, inertia = self.bodies[name]
            total = whole[self._body(name)]
            shares = np.divide([mass, np.trace(inertia)], total, np.zeros(2), where=total > 0)
            at = inertial.find("origin")
            com, (own, turning) = place_of(at)[:3, 3], map(float, shares)
            joints = np.array(ends[name])
            facts.append(
                LinkFacts(name, mass, inertia, com, at is not None, own, turning, joints, self)
            )
        return tuple(facts)

    def oversized(self, extent: Extent) -> bool:
        """Return whether shapes are too large beside the robot: in another unit."""
        return extent.diagonal >= max(SHAPE_OVER_LENGTH * self.length, _LEAST_OVERSIZE)

    def moved_mass(self, joint: JointFacts) -> float:
        """Return the mass beyond a joint, kg."""
        masses = self.masses
        beyond, ahead = 0.0, [joint.child]
        while ahead:
            link = ahead.pop()
            beyond += masses[link]
            ahead += [below.child for below in self.joints if below.parent == link]
        return beyond

    def fixed_to(self, link: str) -> list[str]:
        """Return all links that move with a link as one body."""
        return [name for name in self.link_names if self._body(name) == self._body(link)]

    def _body(self, link: str) -> str:
        """The link that stands for all those fixed to each other."""
        above = self._fixed_above
        while link in above:
            link = above[link]
        return link

    @cached_property
    def _fixed_above(self) -> dict[str, str]:
        return {j.child: j.parent for j in self.joints if j.type == "fixed"}


class NoStandIns(Mapping[str, Extent]):
    """Boxes of links' shapes, but for those too small to be more than a stand-in."""

    def __init__(self, extents: Mapping[str, Extent], least: float) -> None:
        self._extents, self._least = extents, least

    def __getitem__(self, link: str) -> Extent:
        if (extent := self._extents[link]).diagonal < self._least:
            raise KeyError(link)
        return extent

    def __iter__(self) -> Iterator[str]:
        return (name for name, box in self._extents.items() if box.diagonal >= self._least)

    def __len__(self) -> int:
        return sum(1 for _ in self)
