"""Parts of an MJCF file: its lines, defaults, orientations, and bodies that its geoms make.

Every number as MuJoCo 3 reads it (mujoco.readthedocs.io, XMLreference).
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from pinfric.errors import RobotError, choose_from
from pinfric.model.inputs import note_input
from pinfric.model.yamlfile import bounded, brief

#: Attributes that say an orientation; an element's own replaces that of its defaults.
_TURNS = ("quat", "axisangle", "euler", "xyaxes", "zaxis", "fromto")
#: Shortcuts of <general>, whose defaults they share.
ACTUATORS = (
    *("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle"),
    *("adhesion", "plugin", "dcmotor"),
)
#: kg/m^3 of a geom without a density.
_WATER = 1000.0
_NO_LIMIT = (0.0, 0.0)


@dataclass
class MjcfFile:
    """An MJCF with its includes: elements, where they stand, defaults by class.

    Attributes:
        places: element -> the file, and its line there.
        classes: name -> tag -> attributes.
        compiler: attributes of all <compiler>.
    """

    path: Path
    root: ElementTree.Element
    places: dict[ElementTree.Element, tuple[Path, int]]
    classes: dict[str, dict[str, dict[str, str]]] = field(default_factory=dict)
    compiler: dict[str, str] = field(default_factory=dict)

    def where(self, element: ElementTree.Element) -> str:
        """Return how messages name an element: its line, tag and name."""
        file, line = self.places[element]
        within = "" if file == self.path else f" of {file.name}"
        name = f" {element.get('name')!r}" * ("name" in element.attrib)
        return f"line {line}{within}, <{element.tag}>{name}"

    def refused(self, element: ElementTree.Element, why: str) -> RobotError:
        """Return the error of an element."""
        return RobotError(f"{self.path}: {self.where(element)}: {why}")

    def attributes(self, element: ElementTree.Element, inherited: str) -> dict[str, str]:
        """Return an element's attributes with those of its class, or else the `inherited` one."""
        named = element.get("class") or inherited
        if named not in self.classes:
            near = choose_from(named, list(self.classes))
            raise self.refused(element, f"there is no default class {named!r}; {near}")
        own, tag = dict(element.attrib), str(element.tag)
        given = self.classes[named].get("general" if tag in ACTUATORS else tag, {})
        if any(key in own for key in _TURNS):
            given = {key: value for key, value in given.items() if key not in _TURNS}
        return {**given, **own}

    def numbers(
        self, element: ElementTree.Element, text: str, key: str, count: int | None = None
    ) -> list[float]:
        """Return the finite numbers of an attribute's text, `count` of them where it is given."""
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        fits = len(values) == count if count is not None else bool(values)
        if not fits or not all(map(math.isfinite, values)):
            wanted = f"{count} finite numbers" if count is not None else "finite numbers"
            raise self.refused(element, f"{key}={brief(text)} should be {wanted}")
        return values

    def angle(self, value: float) -> float:
        """Return an angle of the file in rad."""
        return value if self.compiler.get("angle", "degree") == "radian" else math.radians(value)

    def pose(self, element: ElementTree.Element, given: Mapping[str, str]) -> np.ndarray:
        """Return the frame (4, 4) that attributes describe, in that of the parent."""
        place = np.eye(4)
        place[:3, 3] = self.numbers(element, given.get("pos", "0 0 0"), "pos", 3)
        place[:3, :3] = self._turn(element, given)
        return place

    def _turn(self, element: ElementTree.Element, given: Mapping[str, str]) -> np.ndarray:
        def read(key: str, count: int) -> np.ndarray:
            return np.array(self.numbers(element, given[key], key, count))

        if "quat" in given:
            w, x, y, z = _unit(read("quat", 4))
            return np.asarray(pin.Quaternion(w, x, y, z).toRotationMatrix())
        if "axisangle" in given:
            *axis, angle = read("axisangle", 4)
            return np.asarray(pin.AngleAxis(self.angle(angle), _unit(np.array(axis))).matrix())
        if "xyaxes" in given:
            six = read("xyaxes", 6)
            x = _unit(six[:3])
            y = _unit(six[3:] - x * (x @ six[3:]))
            return np.column_stack([x, y, np.cross(x, y)])
        if "zaxis" in given:
            return along(read("zaxis", 3))
        whole = np.eye(3)
        if "euler" in given:
            order = self.compiler.get("eulerseq", "xyz")
            for letter, angle in zip(order, read("euler", 3), strict=True):
                axis = np.eye(3)["xyz".index(letter.lower())]
                one = pin.AngleAxis(self.angle(angle), axis).matrix()
                whole = whole @ one if letter.islower() else one @ whole
        return whole


def read_mjcf_file(path: Path) -> MjcfFile:
    """Read an MJCF with all that it includes.

    Raises:
        RobotError: a file that is not there or not well-formed, an element that makes others.
    """
    root, places = _parsed(path, path)
    file = MjcfFile(path, root, places)
    _include(file, root, [path.resolve()])
    for element in root.iter():
        if element.tag in ("replicate", "attach", "composite", "flexcomp", "plugin", "model"):
            raise file.refused(
                element,
                "makes elements that only MuJoCo can make: save the whole model "
                "(mujoco.mj_saveLastXML) and name that file",
            )
    for compiler in root.findall("compiler"):
        file.compiler |= compiler.attrib
    file.classes["main"] = {}
    for default in root.findall("default"):
        _read_defaults(file, default, {}, "main")
        file.classes[default.get("class", "main")] = file.classes["main"]
    return file


def _parsed(
    path: Path, named: Path
) -> tuple[ElementTree.Element, dict[ElementTree.Element, tuple[Path, int]]]:
    """The elements of a file, and their lines."""
    try:
        content = bounded(path, RobotError)
    except OSError as problem:
        raise RobotError(f"{named}: {path} cannot be read: {problem.strerror}") from None
    places: dict[ElementTree.Element, tuple[Path, int]] = {}
    open_: list[ElementTree.Element] = []
    roots: list[ElementTree.Element] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = ElementTree.Element(tag, attributes)
        places[element] = path, parser.CurrentLineNumber
        (open_[-1] if open_ else roots).append(element)
        open_.append(element)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: open_.pop()
    try:
        parser.Parse(content, True)
    except expat.ExpatError as problem:
        raise RobotError(f"{path}: is not well-formed XML ({problem})") from None
    return roots[0], places


def _include(file: MjcfFile, element: ElementTree.Element, within: list[Path]) -> None:
    """Put what files include in place of each <include>; names count from the main file."""
    for index, child in reversed(list(enumerate(element))):
        if child.tag != "include":
            _include(file, child, within)
            continue
        there = file.path.parent / child.get("file", "")
        if not there.is_file():
            raise file.refused(child, f"there is no file {there}")
        if there.resolve() in within:
            raise file.refused(child, "includes itself")
        note_input(there)
        root, places = _parsed(there, file.path)
        file.places.update(places)
        _include(file, root, [*within, there.resolve()])
        element.remove(child)
        for part in reversed(root):
            element.insert(index, part)


def _read_defaults(
    file: MjcfFile,
    default: ElementTree.Element,
    above: Mapping[str, dict[str, str]],
    name: str,
) -> None:
    own = {tag: dict(given) for tag, given in {**above, **file.classes.get(name, {})}.items()}
    for child in default:
        if child.tag != "default":
            tag = "general" if child.tag in ACTUATORS else str(child.tag)
            own[tag] = {**own.get(tag, {}), **child.attrib}
    file.classes[name] = own
    for child in default.findall("default"):
        if not child.get("class"):
            raise file.refused(child, "a default within another needs a class")
        _read_defaults(file, child, own, child.get("class", ""))


def along(axis: np.ndarray) -> np.ndarray:
    """Return the least rotation (3, 3) that takes z to an axis (3,)."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), _unit(axis))
    return np.asarray(turn.toRotationMatrix())


def _unit(vector: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    return np.eye(len(vector))[0] if length < 1e-10 else vector / length


@dataclass(frozen=True)
class Geom:
    """A geom: its kind, place (4, 4) in its body, sizes (m), attributes."""

    element: ElementTree.Element
    kind: str
    place: np.ndarray
    size: list[float]
    given: Mapping[str, str]

    @property
    def seen(self) -> bool:
        """Whether it touches nothing: a visual."""
        return self.given.get("contype", "1") == self.given.get("conaffinity", "1") == "0"

    def volume(self) -> float:
        """Return its volume, m^3."""
        r, *rest = self.size or [0.0]
        if self.kind == "sphere":
            return 4.0 / 3.0 * math.pi * r**3
        if self.kind in ("cylinder", "capsule"):
            ends = 4.0 / 3.0 * math.pi * r**3 if self.kind == "capsule" else 0.0
            return 2.0 * math.pi * r**2 * rest[0] + ends
        share = 8.0 if self.kind == "box" else 4.0 / 3.0 * math.pi
        return share * float(np.prod(self.size))

    def moments(self) -> np.ndarray:
        """Return its moments of inertia (3,) for a mass of 1 kg, m^2."""
        if self.kind in ("box", "ellipsoid", "sphere"):
            edges = np.array(self.size if self.kind != "sphere" else 3 * self.size[:1]) ** 2
            return (edges.sum() - edges) / (3.0 if self.kind == "box" else 5.0)
        r, half = self.size
        ball = 4.0 / 3.0 * r if self.kind == "capsule" else 0.0
        inner, outer = 2.0 * half / (2.0 * half + ball), ball / (2.0 * half + ball)
        about = inner * r**2 / 2.0 + outer * 0.4 * r**2
        across = inner * (3.0 * r**2 + 4.0 * half**2) / 12.0
        across += outer * (0.4 * r**2 + half**2 + 0.75 * r * half)
        return np.array([across, across, about])


#: Numbers of a size: kind -> how many.
_SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}


def read_geom(file: MjcfFile, element: ElementTree.Element, inherited: str) -> Geom:
    """Return a geom with its defaults.

    Raises:
        RobotError: sizes that are missing or no numbers.
    """
    given = file.attributes(element, inherited)
    kind = given.get("type", "mesh" if "mesh" in given else "sphere")
    if kind not in _SIZES or "mesh" in given:
        return Geom(
            element, "mesh" if "mesh" in given else kind, file.pose(element, given), [], given
        )
    size = file.numbers(element, given["size"], "size") if "size" in given else []
    place = file.pose(element, given)
    if "fromto" in given:
        ends = np.array(file.numbers(element, given["fromto"], "fromto", 6)).reshape(2, 3)
        place[:3, 3], place[:3, :3] = ends.mean(axis=0), along(ends[0] - ends[1])
        half = float(np.linalg.norm(ends[1] - ends[0])) / 2.0
        size = [*((_SIZES[kind] - 1) * size[:1]), half]  # as wide as deep
    size = size[: _SIZES[kind]]
    if len(size) < _SIZES[kind] or min(size) <= 0.0:
        raise file.refused(element, f"a {kind} needs {_SIZES[kind]} positive sizes, found {size}")
    return Geom(element, kind, place, size, given)


@dataclass(frozen=True)
class Body:
    """A body's mass (kg), centre of mass (3,) and moments (3, 3) about it, in its own axes."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray


def read_inertial(file: MjcfFile, element: ElementTree.Element) -> Body:
    """Return what an <inertial> states.

    Raises:
        RobotError: numbers that are missing.
    """
    given = element.attrib
    if "mass" not in given:
        raise file.refused(element, "has no mass")
    (mass,) = file.numbers(element, given["mass"], "mass", 1)
    place = file.pose(element, given)
    if "fullinertia" in given:
        xx, yy, zz, xy, xz, yz = file.numbers(element, given["fullinertia"], "fullinertia", 6)
        own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    elif "diaginertia" in given:
        own = np.diag(file.numbers(element, given["diaginertia"], "diaginertia", 3))
    else:
        raise file.refused(element, "has neither diaginertia nor fullinertia")
    return Body(mass, place[:3, 3], place[:3, :3] @ own @ place[:3, :3].T)


def body_of_geoms(
    file: MjcfFile, geoms: Sequence[tuple[np.ndarray, Geom]], still: bool
) -> Body | None:
    """Return the body that geoms make, each with a place (4, 4) of its frame; None without mass.

    still: whether it never moves; then a mass that is not computed is left out.

    Raises:
        RobotError: a mass of a mesh or a shell, which only MuJoCo computes.
    """
    low, high = file.compiler.get("inertiagrouprange", "0 5").split()
    mass, parts = 0.0, list[tuple[float, np.ndarray, np.ndarray]]()
    for frame, geom in geoms:
        if not int(low) <= int(geom.given.get("group", "0")) <= int(high):
            continue
        if geom.kind in ("plane", "hfield"):
            continue
        stated = geom.given.get("mass")
        density = geom.given.get("density", str(_WATER))
        if not float(density if stated is None else stated):
            continue
        if geom.kind not in _SIZES or geom.given.get("shellinertia", "false") == "true":
            if still:
                return None
            raise file.refused(
                geom.element,
                f"its body has no <inertial>, and a mass of a {geom.kind} is not computed here: "
                'write an <inertial>, or let MuJoCo (<compiler saveinertial="true"/> and '
                "mujoco.mj_saveLastXML)",
            )
        own = float(density) * geom.volume() if stated is None else float(stated)
        place = frame @ geom.place
        turn = place[:3, :3]
        mass += own
        parts.append((own, place[:3, 3], own * turn @ np.diag(geom.moments()) @ turn.T))
    if mass <= 0.0:
        return None
    com = np.asarray(sum(own * at for own, at, _ in parts) / mass)
    inertia = np.zeros((3, 3))
    for own, at, moments in parts:
        arm = at - com
        inertia += moments + own * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Body(mass, com, inertia)


def bounded_body(file: MjcfFile, body: Body) -> Body:
    """Return a body with the least mass and moments that <compiler> asks for.

    Raises:
        RobotError: moments that no body has, which MuJoCo would change with `balanceinertia`.
    """
    mass = max(body.mass, float(file.compiler.get("boundmass", 0)))
    least = float(file.compiler.get("boundinertia", 0))
    if least <= 0.0:
        return Body(mass, body.com, body.inertia)
    values, axes = np.linalg.eigh(body.inertia)
    inertia = axes @ np.diag(np.maximum(values, least)) @ axes.T
    return Body(mass, body.com, np.asarray(inertia))


def limits_of(
    file: MjcfFile, element: ElementTree.Element, given: Mapping[str, str]
) -> tuple[float, float]:
    """Return a joint's range as written; (0, 0) where it has none."""
    limited = given.get("limited", "auto")
    auto = file.compiler.get("autolimits", "true") == "true" and "range" in given
    if "range" not in given or not (limited == "true" or (limited == "auto" and auto)):
        return _NO_LIMIT
    low, high = file.numbers(element, given["range"], "range", 2)
    return low, high


def with_frames(
    file: MjcfFile, element: ElementTree.Element, frame: np.ndarray, inherited: str
) -> Iterator[tuple[ElementTree.Element, np.ndarray, str]]:
    """Yield a body's parts with the place (4, 4) of the <frame> that each is in, and its class."""
    for child in element:
        if child.tag == "frame":
            below = frame @ file.pose(child, child.attrib)
            yield from with_frames(file, child, below, child.get("childclass") or inherited)
        else:
            yield child, frame, inherited
