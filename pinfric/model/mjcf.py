"""An MJCF (MuJoCo) as the elements of a URDF, which all else reads.

A body with joints j1, j2, ... becomes a chain of links, the last one, with its name and frame, in
the joint's own link. Positions are MuJoCo's qpos, in its order: `ref` moves the joint's frame.
What URDF does not have:

    <joint type="ball">        kept under this name, as a joint of three degrees of freedom
    <equality> connect, weld   <loop_joint> (`file_loops`); joint: <mimic> where it is linear
    <keyframe>, gravity        kept: the positions by joint, the vector
    armature                   of <dynamics>, beside its friction and damping
"""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.errors import PinfricWarning, RobotError, choose_from
from pinfric.model.mjcf_parts import (
    Body,
    Geom,
    MjcfFile,
    body_of_geoms,
    bounded_body,
    limits_of,
    read_geom,
    read_inertial,
    read_mjcf_file,
    with_frames,
)

#: How a root element says that it was an MJCF: its joints stand in the order of the file.
MARK = "mjcf"
#: Type of a joint that URDF does not have.
BALL = "ball"
#: The root link.
_WORLD = "world"
_KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": BALL, "free": "floating"}
#: Joint kind -> numbers in qpos.
_POSITIONS = {"revolute": 1, "prismatic": 1, BALL: 4, "floating": 7}
#: The pose of a weld that holds its bodies as they are at qpos0.
_AT_START = "0 1 0 0 0 0 0"


@dataclass
class _Written:
    """The URDF so far.

    Attributes:
        places: body -> its frame (4, 4) in the world at qpos0. sites: site -> body, frame in it.
        above: joint -> the joint that carries it. joints: name, kind in qpos's order.
        moments: link -> its mass, centre and moments, for <compiler settotalmass>.
        said: what is not read.
    """

    root: ElementTree.Element
    places: dict[str, np.ndarray] = field(default_factory=dict)
    sites: dict[str, tuple[str, np.ndarray]] = field(default_factory=dict)
    above: dict[str, str] = field(default_factory=dict)
    joints: list[tuple[str, str]] = field(default_factory=list)
    refs: dict[str, float] = field(default_factory=dict)
    bodies: dict[str, Body] = field(default_factory=dict)
    efforts: dict[str, float] = field(default_factory=dict)
    meshes: dict[str, tuple[str, str]] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)


def read_mjcf(path: Path) -> ElementTree.Element:
    """Return an MJCF as the root element of a URDF.

    Raises:
        RobotError: what cannot be read, with its line; bodies or joints of one name.

    Warns:
        PinfricWarning: forces that are not read (springs, gravcomp, a fluid, tendons).
    """
    file = read_mjcf_file(path)
    worlds = file.root.findall("worldbody")
    if not worlds:
        raise RobotError(f"{path}: has no <worldbody>")
    root = ElementTree.Element("robot", {"name": file.root.get("model", path.stem), MARK: "true"})
    written = _Written(root, {_WORLD: np.eye(4)})
    _read_options(file, written)
    written.meshes = _meshes(file)
    written.efforts = _efforts(file)
    link = ElementTree.SubElement(root, "link", name=_WORLD)
    for world in worlds:
        for part, frame, inherited in with_frames(file, world, np.eye(4), "main"):
            if part.tag == "body":
                _read_body(file, written, part, _WORLD, frame, inherited, ())
            elif part.tag == "geom":
                _draw(written, link, [(frame, read_geom(file, part, inherited))])
            elif part.tag == "site":
                _read_site(file, written, part, _WORLD, frame, inherited)
    _write_bodies(file, written)
    for section in file.root.findall("equality"):
        for equality in section:
            _read_equality(file, written, equality)
    for section in file.root.findall("keyframe"):
        for number, key in enumerate(section.findall("key"), 1):
            _read_key(file, written, key, key.get("name") or f"key_{number}")
    for text in written.said:
        warnings.warn(f"{path}: {text}", PinfricWarning, stacklevel=4)
    return root


def _read_options(file: MjcfFile, written: _Written) -> None:
    """Read gravity, and say which forces are not read."""
    weightless = False
    for option in file.root.findall("option"):
        if "gravity" in option.attrib:
            gravity = file.numbers(option, option.attrib["gravity"], "gravity", 3)
            written.root.set("gravity", _text(gravity))
        if any(flag.get("gravity") == "disable" for flag in option.findall("flag")):
            weightless = True
        fluid = [key for key in ("density", "viscosity") if float(option.get(key, 0))]
        if fluid:
            written.said.append(
                f"{file.where(option)}: forces of a fluid ({fluid[0]}) are not read"
            )
    if weightless:
        written.root.set("gravity", "0 0 0")
    for section in file.root.findall("tendon"):
        for tendon in section:
            given = file.attributes(tendon, "main")
            acting = [key for key in ("stiffness", "damping", "frictionloss") if key in given]
            if acting:
                written.said.append(f"{file.where(tendon)}: its {acting[0]} is not read")


def _meshes(file: MjcfFile) -> dict[str, tuple[str, str]]:
    """Name -> the mesh's file and its scale."""
    folder = file.compiler.get("meshdir", file.compiler.get("assetdir", ""))
    meshes = {}
    for mesh in file.root.findall("asset/mesh"):
        given = file.attributes(mesh, "main")
        if "file" in given:
            there = Path(folder) / given["file"]
            if file.compiler.get("strippath", "false") == "true":
                there = Path(folder) / Path(given["file"]).name
            name = given.get("name", Path(given["file"]).stem)
            meshes[name] = there.as_posix(), given.get("scale", "1 1 1")
    return meshes


def _efforts(file: MjcfFile) -> dict[str, float]:
    """Joint -> the largest effort that its actuators can give, where they say it."""
    efforts: dict[str, float] = {}
    for actuator in (one for section in file.root.findall("actuator") for one in section):
        given = file.attributes(actuator, "main")
        keys = ("forcerange", *(("ctrlrange",) if actuator.tag == "motor" else ()))
        ranges = [file.numbers(actuator, given[key], key, 2) for key in keys if key in given]
        if "joint" not in given or not ranges:
            continue
        gear = file.numbers(actuator, given.get("gear", "1"), "gear")[0]
        force = min(max(map(abs, ends)) for ends in ranges)
        efforts[given["joint"]] = efforts.get(given["joint"], 0.0) + abs(gear) * force
    return efforts


def _read_body(
    file: MjcfFile,
    written: _Written,
    body: ElementTree.Element,
    parent: str,
    frame: np.ndarray,
    inherited: str,
    above: tuple[str, ...],
) -> None:
    """Write a body's joints and links, and all that it carries.

    Args:
        parent: the body that carries it. frame: (4, 4) in the parent's, from <frame>.
        above: the joints that carry it.
    """
    name = body.get("name") or f"body_{len(written.places)}"
    if name in written.places:
        raise file.refused(body, "two bodies have this name; names must differ")
    place = frame @ file.pose(body, body.attrib)
    written.places[name] = written.places[parent] @ place
    if float(body.get("gravcomp", 0)):
        written.said.append(f"{file.where(body)}: gravcomp is not read: efforts carry its weight")
    parts = list(with_frames(file, body, np.eye(4), body.get("childclass") or inherited))
    joints = [part for part in parts if part[0].tag in ("joint", "freejoint")]
    link, at = parent, place
    for index, (element, within, kind) in enumerate(joints):
        last = index == len(joints) - 1
        link, at, joint = _read_joint(file, written, element, within, kind, name, last, link, at)
        if above:
            written.above[joint] = above[-1]
        above = (*above, joint)
    if link != name:
        called = f"{name}_fixed" if joints == [] else f"{name}_frame"
        ElementTree.SubElement(written.root, "link", name=name)
        _joint(written.root, called, "fixed", link, name, at)
    (own,) = (x for x in written.root.findall("link") if x.get("name") == name)
    geoms = [(f, read_geom(file, part, c)) for part, f, c in parts if part.tag == "geom"]
    _draw(written, own, geoms)
    inertial = [part for part, _, _ in parts if part.tag == "inertial"]
    from_geoms = file.compiler.get("inertiafromgeom", "auto")
    if inertial and from_geoms != "true":
        written.bodies[name] = bounded_body(file, read_inertial(file, inertial[0]))
    elif from_geoms != "false" and (made := body_of_geoms(file, geoms, not above)) is not None:
        written.bodies[name] = bounded_body(file, made)
    for part, within, kind in parts:
        if part.tag == "body":
            _read_body(file, written, part, name, within, kind, above)
        elif part.tag == "site":
            _read_site(file, written, part, name, within, kind)


def _read_joint(
    file: MjcfFile,
    written: _Written,
    element: ElementTree.Element,
    within: np.ndarray,
    inherited: str,
    body: str,
    last: bool,
    link: str,
    at: np.ndarray,
) -> tuple[str, np.ndarray, str]:
    """Write one joint; return its link, the body's frame (4, 4) in it, and the joint's name.

    Args:
        within: (4, 4) of the <frame> it is in. body, last: whose it is, and whether its last.
        link, at: what carries it, and the body's frame (4, 4) there.
    """
    free = element.tag == "freejoint"
    given = dict(element.attrib) if free else file.attributes(element, inherited)
    kind = given.get("type", "free" if free else "hinge")
    if kind not in _KINDS:
        raise file.refused(element, f"there is no type {kind!r}; {choose_from(kind, list(_KINDS))}")
    kind = _KINDS[kind]
    name = given.get("name") or f"{body}_joint" + f"_{len(written.joints)}" * (not last)
    if any(name == other for other, _ in written.joints):
        raise file.refused(element, "two joints have this name; names must differ")
    written.joints.append((name, kind))
    anchor, turn, begins = np.eye(4), within[:3, :3], at
    if kind == "floating":
        if link != _WORLD:
            raise file.refused(element, "a free joint is of a body of the world")
        at = np.eye(4)  # its position is that of the body in the world
    else:
        pos = file.numbers(element, given.get("pos", "0 0 0"), "pos", 3)
        anchor[:3, 3] = within[:3, 3] + turn @ pos
    axis = turn @ file.numbers(element, given.get("axis", "0 0 1"), "axis", 3)
    length = float(np.linalg.norm(axis))
    if kind in ("revolute", "prismatic") and length < 1e-10:
        raise file.refused(element, "its axis has no direction")
    axis /= length or 1.0
    ref = float(given.get("ref", 0))
    start = np.eye(4)
    if kind == "revolute":
        ref = file.angle(ref)
        start[:3, :3] = pin.AngleAxis(-ref, axis).matrix()
    elif kind == "prismatic":
        start[:3, 3] = -ref * axis
    written.refs[name] = ref
    back = np.linalg.inv(anchor)
    own = body if last and not anchor[:3, 3].any() else f"{body}.{name}"
    ElementTree.SubElement(written.root, "link", name=own)
    joint = _joint(written.root, name, kind, link, own, at @ anchor @ start)
    if kind == "floating":
        joint.attrib |= {f"start_{key}": text for key, text in _origin(begins).items()}
    if kind in ("revolute", "prismatic"):
        ElementTree.SubElement(joint, "axis", xyz=_text(axis))
        _write_limit(file, written, element, given, joint, kind)
        _write_dynamics(file, written, element, given, joint, kind)
    return own, back, name


def _write_limit(
    file: MjcfFile,
    written: _Written,
    element: ElementTree.Element,
    given: Mapping[str, str],
    joint: ElementTree.Element,
    kind: str,
) -> None:
    low, high = limits_of(file, element, given)
    if kind == "revolute":
        low, high = file.angle(low), file.angle(high)
    if low == high == 0.0:
        low, high = -math.inf, math.inf
    effort = written.efforts.get(joint.attrib["name"], math.inf)
    if "actuatorfrcrange" in given:
        ends = file.numbers(element, given["actuatorfrcrange"], "actuatorfrcrange", 2)
        effort = min(effort, max(map(abs, ends)))
    limits = {"lower": low, "upper": high, "effort": effort if effort < math.inf else 0.0}
    limits["velocity"] = 0.0  # none
    ElementTree.SubElement(joint, "limit", {key: repr(float(x)) for key, x in limits.items()})


def _write_dynamics(
    file: MjcfFile,
    written: _Written,
    element: ElementTree.Element,
    given: Mapping[str, str],
    joint: ElementTree.Element,
    kind: str,
) -> None:
    words = {"friction": "frictionloss", "damping": "damping", "armature": "armature"}
    values = {
        key: file.numbers(element, given.get(word, "0"), word)[0] for key, word in words.items()
    }
    if any(values.values()):
        ElementTree.SubElement(joint, "dynamics", {k: repr(x) for k, x in values.items()})
    stiffness = file.numbers(element, given.get("stiffness", "0"), "stiffness")[0]
    if stiffness:
        rest = float(given.get("springref", 0))
        rest = file.angle(rest) if kind == "revolute" else rest
        name = joint.attrib["name"]
        spring = f"{{kind: torsion, name: {name}_spring, joint: {name}, stiffness: {stiffness:g}, "
        said = f"its spring is not read; write it: springs: [{spring}rest: {rest:g}}}]"
        written.said.append(f"{file.where(element)}: {said}")


def _joint(
    root: ElementTree.Element, name: str, kind: str, parent: str, child: str, place: np.ndarray
) -> ElementTree.Element:
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    ElementTree.SubElement(joint, "origin", _origin(place))
    return joint


def _origin(place: np.ndarray) -> dict[str, str]:
    return {"xyz": _text(place[:3, 3]), "rpy": _text(pin.rpy.matrixToRpy(place[:3, :3]))}


def _text(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in values)


def _read_site(
    file: MjcfFile,
    written: _Written,
    site: ElementTree.Element,
    body: str,
    frame: np.ndarray,
    inherited: str,
) -> None:
    given = file.attributes(site, inherited)
    if "name" in given:
        written.sites[given["name"]] = body, frame @ file.pose(site, given)


def _write_bodies(file: MjcfFile, written: _Written) -> None:
    """Write the inertia of each body, all scaled to <compiler settotalmass>."""
    total = float(file.compiler.get("settotalmass", -1))
    mass = sum(body.mass for body in written.bodies.values())
    scale = total / mass if total > 0.0 < mass else 1.0
    for link in written.root.findall("link"):
        if (body := written.bodies.get(link.attrib["name"])) is not None:
            inertial = ElementTree.Element("inertial")
            link.insert(0, inertial)
            ElementTree.SubElement(inertial, "origin", xyz=_text(body.com), rpy="0 0 0")
            ElementTree.SubElement(inertial, "mass", value=repr(float(scale * body.mass)))
            moments = {
                f"i{'xyz'[i]}{'xyz'[k]}": repr(float(scale * body.inertia[i, k]))
                for i in range(3)
                for k in range(i, 3)
            }
            ElementTree.SubElement(inertial, "inertia", moments)


def _draw(
    written: _Written, link: ElementTree.Element, geoms: Sequence[tuple[np.ndarray, Geom]]
) -> None:
    """Write the shapes of a link; those that touch are drawn, too, where nothing else is."""
    shapes = [(frame, g) for frame, g in geoms if g.size or g.given.get("mesh") in written.meshes]
    alone = not any(geom.seen for _, geom in shapes)
    for frame, geom in shapes:
        kinds = ("visual",) if geom.seen else ("visual", "collision") if alone else ("collision",)
        for place, tag, measures in _shapes(written, frame @ geom.place, geom):
            for kind in kinds:
                shape = ElementTree.SubElement(link, kind)
                ElementTree.SubElement(shape, "origin", _origin(place))
                ElementTree.SubElement(ElementTree.SubElement(shape, "geometry"), tag, measures)


def _shapes(
    written: _Written, place: np.ndarray, geom: Geom
) -> list[tuple[np.ndarray, str, dict[str, str]]]:
    """A geom as shapes of a URDF; an ellipsoid as its box, a capsule as a cylinder and balls."""
    if geom.kind == "mesh":
        filename, scale = written.meshes[geom.given["mesh"]]
        return [(place, "mesh", {"filename": filename, "scale": scale})]
    if geom.kind in ("box", "ellipsoid"):
        return [(place, "box", {"size": _text(2.0 * np.array(geom.size))})]
    radius = {"radius": repr(geom.size[0])}
    if geom.kind == "sphere":
        return [(place, "sphere", radius)]
    shapes = [(place, "cylinder", {**radius, "length": repr(2.0 * geom.size[1])})]
    for end in (1.0, -1.0) if geom.kind == "capsule" else ():
        shift = np.eye(4)
        shift[2, 3] = end * geom.size[1]
        shapes.append((place @ shift, "sphere", radius))
    return shapes


def _read_equality(file: MjcfFile, written: _Written, equality: ElementTree.Element) -> None:
    """Write what ties bodies or joints together."""
    given, kind = file.attributes(equality, "main"), str(equality.tag)
    line = str(file.places[equality][1])
    unread = ""
    if given.get("active", "true") == "false":
        unread = "it is not active"
    elif kind == "joint":
        unread = _follow(file, written, equality, given)
    elif kind in ("connect", "weld"):
        _tie(file, written, equality, given, line)
    else:
        unread = "a scene's loops join two links"
    if unread:
        name = {"name": given["name"]} if "name" in given else {}
        ElementTree.SubElement(
            written.root, "constraint_not_read", name, type=kind, line=line, why=unread
        )


def _tie(
    file: MjcfFile,
    written: _Written,
    equality: ElementTree.Element,
    given: Mapping[str, str],
    line: str,
) -> None:
    """Write a <loop_joint> for <connect> or <weld>, whose frames meet at qpos0 or as it says."""
    if "site1" in given or "site2" in given:
        sides = []
        for key in ("site1", "site2"):
            site = given.get(key, "")
            if site not in written.sites:
                near = choose_from(site, list(written.sites))
                raise file.refused(equality, f"{key} names site {site!r}; {near}")
            sides.append(written.sites[site])
    else:
        bodies = [given.get("body1", ""), given.get("body2", _WORLD)]
        for key, body in zip(("body1", "body2"), bodies, strict=True):
            if not body:
                raise file.refused(
                    equality, f"has no {key}; it ties two bodies, or one to the world"
                )
            if body not in written.places:
                near = choose_from(body, list(written.places))
                raise file.refused(equality, f"{key} names body {body!r}; {near}")
        frames = [np.eye(4), np.eye(4)]
        apart = np.linalg.inv(written.places[bodies[1]]) @ written.places[bodies[0]]
        if equality.tag == "connect":
            if "anchor" not in given:
                raise file.refused(equality, "has no anchor; give its place in body1's frame")
            frames[0][:3, 3] = file.numbers(equality, given["anchor"], "anchor", 3)
            frames[1] = apart @ frames[0]
        else:
            pose = file.numbers(equality, given.get("relpose", _AT_START), "relpose", 7)
            if any(pose[3:]):
                at = {"pos": _text(pose[:3]), "quat": _text(pose[3:])}
                frames[0] = file.pose(equality, at)
            else:
                frames[1] = apart
        sides = list(zip(bodies, frames, strict=True))
    loop = ElementTree.SubElement(
        written.root,
        "loop_joint",
        name=given.get("name") or f"{equality.tag}_{line}",
        type="spherical" if equality.tag == "connect" else "fixed",
        line=line,
    )
    for number, (body, frame) in enumerate(sides, 1):
        ElementTree.SubElement(loop, f"link{number}", {"link": body, **_origin(frame)})


def _follow(
    file: MjcfFile,
    written: _Written,
    equality: ElementTree.Element,
    given: Mapping[str, str],
) -> str:
    """Let one joint mimic another; return why not."""
    names = [given.get("joint1", ""), given.get("joint2", "")]
    kinds = dict(written.joints)
    for key, name in zip(("joint1", "joint2"), names, strict=True):
        if name not in kinds and (name or key == "joint1"):
            near = choose_from(name, list(kinds))
            raise file.refused(equality, f"{key} names joint {name!r}; {near}")
    if not names[1]:
        return "it holds one joint: lock it by robot.locked"
    text = given.get("polycoef", "0 1 0 0 0")
    offset, slope, *curve = file.numbers(equality, text, "polycoef")
    if any(curve) or slope == 0.0:
        return f"polycoef {text} is no line with a slope"
    if any(_POSITIONS[kinds[name]] > 1 for name in names):
        return "joints of one degree of freedom follow each other"
    follower, leader = names
    passed: str | None = leader
    while (passed := written.above.get(passed or "")) is not None:
        if passed == follower:  # the leader stands nearer to the root
            follower, leader = leader, follower
            offset, slope = -offset / slope, 1.0 / slope
            break
    # q1 - ref1 = offset + slope (q2 - ref2)
    offset += written.refs[follower] - slope * written.refs[leader]
    (joint,) = (j for j in written.root.findall("joint") if j.get("name") == follower)
    if joint.find("mimic") is not None:
        return f"joint {follower!r} follows another one already"
    mimic = {"joint": leader, "multiplier": repr(slope), "offset": repr(offset)}
    ElementTree.SubElement(joint, "mimic", mimic)
    return ""


def _read_key(file: MjcfFile, written: _Written, key: ElementTree.Element, name: str) -> None:
    """Write the positions of a keyframe, of joints with one degree of freedom."""
    if "qpos" not in key.attrib:
        return
    counts = [_POSITIONS[kind] for _, kind in written.joints]
    values = file.numbers(key, key.attrib["qpos"], "qpos", sum(counts))
    keyframe = ElementTree.SubElement(written.root, "keyframe", name=name)
    at = 0
    for (joint, _), count in zip(written.joints, counts, strict=True):
        if count == 1:
            ElementTree.SubElement(keyframe, "q", joint=joint, value=repr(values[at]))
        at += count


def keyframes(root: ElementTree.Element) -> dict[str, dict[str, float]]:
    """Return keyframe -> position (rad or m) by joint, of a root that `read_mjcf` made."""

    def positions(keyframe: ElementTree.Element) -> dict[str, Any]:
        return {q.attrib["joint"]: float(q.attrib["value"]) for q in keyframe}

    return {key.attrib["name"]: positions(key) for key in root.findall("keyframe")}
