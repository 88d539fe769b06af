"""Loops that a robot's file closes with elements that URDF does not have.

Each becomes an entry of a scene's `loops`, with its name:

    <loop_joint>             Isaac Sim: <link1>, <link2> with xyz and rpy, an <axis>
    <constraint>             urdfdom #264: an origin and an axis on <parent> and on <child>
    <drake:ball_constraint>  Drake: a point on each of two bodies
    <gazebo><joint>          SDFormat: a pose in the child; the parent's frame is where it is at 0
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from pinfric.errors import RobotError, choose_from
from pinfric.model.entry import parse
from pinfric.model.mimics import link_of
from pinfric.model.schema import Loop

#: Kind of a joint in these elements -> kind of a scene's loop.
_KINDS = {
    "revolute": "revolute",
    "continuous": "revolute",
    "hinge": "revolute",
    "spherical": "spherical",
    "ball": "spherical",
    "prismatic": "prismatic",
    "cylindrical": "cylindrical",
    "universal": "universal",
    "fixed": "fixed",
}
#: Kinds for which the angle of frame b about the axis does not matter.
_ABOUT_AXIS = ("revolute", "cylindrical")
#: The namespace in tags of Drake's elements: files write its address in several ways.
_DRAKE = re.compile(r"\{[^}]*drake\.mit\.edu/?\}")
#: Elements that tie links together in a way no loop has.
_TIES = ("drake:linear_bushing_rpy", "drake:tendon_constraint")
#: Other elements of such names may close loops, too.
_PERHAPS = re.compile(r"loop|closure|constraint", re.I)


@dataclass(frozen=True)
class FileLoops:
    """The loops of a robot's file.

    Attributes:
        loops: as entries of a scene.
        unread: elements that tie links together and are not read: place, and why.
    """

    loops: tuple[Loop, ...] = ()
    unread: tuple[tuple[str, str], ...] = ()

    @property
    def said(self) -> list[str]:
        """A line for each element that is not read."""
        return [f"{place} is not read: {why}; {OPEN}" for place, why in self.unread]


#: What follows for a robot with an element that is not read.
OPEN = "without it the robot is an open tree there: close it in the scene's `loops`"


class _UnreadError(Exception):
    """Why an element is no loop of a scene."""


@dataclass(frozen=True)
class _Reader:
    """One element, its name in messages, and the links of its file."""

    element: ElementTree.Element
    where: str
    places: dict[str, np.ndarray]

    def link(self, name: str | None, side: str) -> str:
        """The link of a side, which must be there."""
        name = (name or "").strip()
        if not name:
            raise RobotError(f"{self.where}: has no {side}; a loop joins two links")
        if name not in self.places:
            raise RobotError(
                f"{self.where}: {side} names link {name!r}; {choose_from(name, list(self.places))}"
            )
        return name

    def numbers(self, text: str | None, what: str, count: int = 3) -> list[float]:
        """So many finite numbers; zeros where there is no text."""
        words = (text or " ".join(["0"] * count)).split()
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            raise RobotError(f"{self.where}: {what} {text!r} should be {count} finite numbers")
        return values

    def frame(self, link: str, at: ElementTree.Element | None, side: str) -> dict[str, Any]:
        """A frame of a scene's loop from an element with xyz and rpy."""
        xyz, rpy = (
            self.numbers(None if at is None else at.get(key), f"{side} {key}")
            for key in ("xyz", "rpy")
        )
        return {"link": link, "xyz": xyz, "rpy": rpy}

    def kind(self) -> str:
        """The kind of the loop."""
        given = self.element.get("type", "")
        if given not in _KINDS:
            raise _UnreadError(f"a scene's loops have no kind {given!r}")
        return _KINDS[given]


def file_loops(root: ElementTree.Element, urdf: Path) -> FileLoops:
    """Return the loops of a checked URDF, and what ties its links together and is no loop.

    Raises:
        RobotError: an element that names a link that is not there, or one link only; numbers that
            are none; two of one name.
    """
    found = list(_elements(root))
    if not found:
        return FileLoops()
    lines, places = _lines(root, urdf), _link_places(root)
    loops, unread = list[Loop](), list[tuple[str, str]]()
    for element, read in found:
        tag = _tag(element)
        if tag == "constraint_not_read":
            tag = f"equality><{element.get('type')}"
        name = element.get("name") or f"loop_{len(loops) + 1}"
        number = str(lines[element]) if element in lines else element.get("line")  # of an MJCF
        line = f"line {number}, " if number else ""
        called = f" {element.get('name')!r}" * ("name" in element.attrib)
        reader = _Reader(element, f"{urdf}: {line}<{tag}>{called}", places)
        try:
            entry = read(reader)
        except _UnreadError as why:
            unread.append((f"{line}<{tag}>{called}", str(why)))
            continue
        a, b = entry["a"]["link"], entry["b"]["link"]
        if a == b:
            raise RobotError(f"{reader.where}: both sides are link {a!r}; a loop joins two links")
        if any(loop.name == name for loop in loops):
            raise RobotError(f"{reader.where}: two loops have this name; names must differ")
        loops.append(parse(Loop, {"name": name, **entry}, reader.where))
    return FileLoops(tuple(loops), tuple(unread))


def _tag(element: ElementTree.Element) -> str:
    return _DRAKE.sub("drake:", str(element.tag))


def _elements(
    root: ElementTree.Element,
) -> Iterator[tuple[ElementTree.Element, Callable[[_Reader], dict[str, Any]]]]:
    readers = {
        "loop_joint": _loop_joint,
        "constraint": _constraint,
        "drake:ball_constraint": _ball_constraint,
        **dict.fromkeys(_TIES, _tie),
    }
    for element in root:
        if (reader := readers.get(_tag(element))) is not None:
            yield element, reader
        elif _PERHAPS.search(_tag(element)):
            yield element, _unknown
        if element.tag == "gazebo":
            for joint in element.findall("joint"):
                yield joint, _gazebo_joint


def _loop_joint(at: _Reader) -> dict[str, Any]:
    sides = [at.element.find(f"link{n}") for n in (1, 2)]
    a, b = (
        at.frame(
            at.link(None if side is None else side.get("link"), f"<link{n}>"), side, f"<link{n}>"
        )
        for n, side in enumerate(sides, 1)
    )
    entry: dict[str, Any] = {"kind": at.kind(), "a": a, "b": b}
    axis = at.element.find("axis")
    if entry["kind"] == "universal":
        raise _UnreadError("it says one axis, a universal joint has two")
    if entry["kind"] not in ("spherical", "fixed"):  # without an axis: x, as of a URDF's joint
        given = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
        entry["axis"] = at.numbers(given, "<axis xyz>")
    return entry


def _constraint(at: _Reader) -> dict[str, Any]:
    frames, axes = [], []
    for side in ("parent", "child"):
        ends = at.element.find(side)
        link = at.link(None if ends is None else ends.get("link"), f"<{side}>")
        frames.append(at.frame(link, at.element.find(f"{side}_origin"), f"<{side}_origin>"))
        axis = at.element.find(f"{side}_axis")
        axes.append(at.numbers("1 0 0" if axis is None else axis.get("xyz"), f"<{side}_axis xyz>"))
    (a, b), kind = frames, at.kind()
    entry: dict[str, Any] = {"kind": kind, "a": a, "b": b}
    if kind in ("spherical", "fixed"):
        return entry
    if kind == "universal":
        return {**entry, "axis": axes[0], "axis_b": axes[1]}
    unit = [np.array(axis) / (float(np.linalg.norm(axis)) or 1.0) for axis in axes]
    if np.abs(unit[0] - unit[1]).max() > 1e-9:
        if kind not in _ABOUT_AXIS:
            raise _UnreadError(f"its axes differ, which leaves the angle of a {kind} joint open")
        turn = pin.Quaternion.FromTwoVectors(*unit).toRotationMatrix()
        b["rpy"] = pin.rpy.matrixToRpy(pin.rpy.rpyToMatrix(*b["rpy"]) @ turn).tolist()
    return {**entry, "axis": axes[0]}


def _ball_constraint(at: _Reader) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": "spherical"}
    for side, body, point in (("a", "body_A", "p_AP"), ("b", "body_B", "p_BQ")):
        within = {_tag(part).removeprefix("drake:ball_constraint_"): part for part in at.element}
        ends, place = within.get(body), within.get(point)
        link = at.link(None if ends is None else ends.get("name"), f"drake:ball_constraint_{body}")
        xyz = at.numbers(None if place is None else place.get("value"), point)
        entry[side] = {"link": link, "xyz": xyz}
    return entry


def _gazebo_joint(at: _Reader) -> dict[str, Any]:
    root = next(iter(at.places))
    links = []
    for side in ("parent", "child"):
        text = (at.element.findtext(side) or at.element.findtext(f"{side}/link") or "").strip()
        links.append(root if text == "world" not in at.places else at.link(text, f"<{side}>"))
    parent, child = (at.places[link] for link in links)
    kind, pose = at.kind(), at.element.find("pose")
    own = at.numbers(None if pose is None else pose.text, "<pose>", 6)
    within = child
    if pose is not None and pose.get("relative_to"):
        within = at.places[at.link(pose.get("relative_to"), "<pose relative_to>")]
    joint = within @ _place(own[:3], own[3:])
    entry: dict[str, Any] = {"kind": kind}
    for side, link, place in (("a", links[0], parent), ("b", links[1], child)):
        there = np.linalg.inv(place) @ joint
        rpy = pin.rpy.matrixToRpy(there[:3, :3])
        entry[side] = {"link": link, "xyz": there[:3, 3].tolist(), "rpy": rpy.tolist()}
    if kind in ("spherical", "fixed"):
        return entry
    for key, tag in (("axis", "axis"), *([("axis_b", "axis2")] if kind == "universal" else [])):
        xyz = at.element.find(f"{tag}/xyz")
        axis = np.array(at.numbers("0 0 1" if xyz is None else xyz.text, f"<{tag}><xyz>"))
        model = (at.element.findtext(f"{tag}/use_parent_model_frame") or "").strip() in (
            "1",
            "true",
        )
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        if model or frame == "__model__":
            axis = joint[:3, :3].T @ axis
        elif frame:
            axis = joint[:3, :3].T @ at.places[at.link(frame, "<xyz expressed_in>")][:3, :3] @ axis
        entry[key] = axis.tolist()
    return entry


def _tie(at: _Reader) -> dict[str, Any]:
    raise _UnreadError("it is a spring or a tendon, not a joint: give it under `springs`")


def _link_places(root: ElementTree.Element) -> dict[str, np.ndarray]:
    """Link -> its frame (4, 4) in the root's where every joint is at 0; the root comes first."""
    above = {link_of(joint, "child"): joint for joint in root.findall("joint")}
    names = [link.attrib["name"] for link in root.findall("link")]
    places = {name: np.eye(4) for name in names if name not in above}
    ahead = list(above)
    while ahead:  # a tree: each pass places at least one
        for name in [link for link in ahead if link_of(above[link], "parent") in places]:
            origin, parent = above[name].find("origin"), link_of(above[name], "parent")
            xyz, rpy = (
                [
                    float(x)
                    for x in ("0 0 0" if origin is None else origin.get(key, "0 0 0")).split()
                ]
                for key in ("xyz", "rpy")
            )
            places[name] = places[parent] @ _place(xyz, rpy)
            ahead.remove(name)
    return places


def _place(xyz: Sequence[float], rpy: Sequence[float]) -> np.ndarray:
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = pin.rpy.rpyToMatrix(*rpy), xyz
    return place


def _unknown(at: _Reader) -> dict[str, Any]:
    if "why" in at.element.attrib:  # of an MJCF
        raise _UnreadError(at.element.attrib["why"])
    raise _UnreadError("no such element of a robot's file is known")


def _lines(root: ElementTree.Element, urdf: Path) -> dict[ElementTree.Element, int]:
    """Element -> its line in the file; empty where the file was changed by reading (xacro)."""
    starts: list[tuple[str, int]] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, _: starts.append((tag, parser.CurrentLineNumber))
    try:
        parser.Parse(urdf.read_bytes(), True)
    except (OSError, expat.ExpatError):
        return {}
    elements = list(root.iter())

    def local(tag: str) -> str:
        return tag.rpartition("}")[2].rpartition(":")[2]

    same = [local(str(element.tag)) for element in elements] == [local(tag) for tag, _ in starts]
    return dict(zip(elements, (n for _, n in starts), strict=True)) if same else {}
