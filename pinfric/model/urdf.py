"""Checks of a URDF: errors that Pinocchio accepts or reports badly are found here.

<dynamics> and <transmission>, which Pinocchio's model does not keep, are read here, too. yourdfpy
reads everything else (`read_document`).
"""

from __future__ import annotations

import io
import logging
import math
import os
import re
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pinfric.errors import FindingWarning, PinfricWarning, RobotError, choose_from
from pinfric.model.inputs import note_input
from pinfric.model.magnitudes import LARGEST
from pinfric.model.mimics import link_of, settle_mimics
from pinfric.model.mjcf import BALL, MARK
from pinfric.model.urdf_file import NAMELESS
from pinfric.model.yamlfile import brief

#: Triangle-inequality slack relative to the largest principal moment: URDFs print few digits.
_INERTIA_SLACK = 1e-3
#: Moments below this (kg m^2) are the rounding of an exporter.
_INERTIA_FLOOR = 1e-9
#: A velocity limit beyond is a placeholder, rad/s or m/s.
PLACEHOLDER_SPEED = 50.0
_JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "planar", "floating")
_MOMENTS = ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")
#: Required attributes of each shape.
_MEASURES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ()}


class UrdfDynamics(NamedTuple):
    """A joint's friction (N m or N) and damping (N m s/rad or N s/m), 0 where not given.

    `armature`: of an MJCF, the inertia of its rotor at the joint (kg m^2 or kg).
    """

    friction: float
    damping: float
    armature: float = 0.0


def check_urdf(root: ElementTree.Element, urdf: Path) -> None:
    """Check the links and joints of a URDF; its meshes are not read.

    In `root` (see `read_xml`) a nameless robot gets a name, numbers are rewritten so that every
    reader accepts them, and mimic tags so that Pinocchio does (`settle_mimics`). Physically
    impossible inertias, which other programs accept, are kept with one `PinfricWarning`.

    Raises:
        RobotError: not a URDF, not a tree, or an impossible mass, inertia, axis, limit or mimic.
    """
    _check_elements(root, urdf)
    if not root.get("name"):
        root.set("name", NAMELESS)
    _check_tree(root, urdf)
    _check_joints(root, urdf)
    settle_mimics(root, urdf)
    _check_inertias(root, urdf)


def read_document(root: ElementTree.Element, urdf: Path) -> Any:
    """Return links and joints of a checked URDF as yourdfpy's `Robot`; no mesh is loaded.

    Raises:
        RobotError: an entry that yourdfpy cannot read, such as an invalid colour.
    """
    from yourdfpy import URDF  # 0.5 s: only where it is used

    content = io.BytesIO(ElementTree.tostring(root))
    try:
        return URDF.load(content, build_scene_graph=False, load_meshes=False).robot
    except Exception as problem:  # of lxml, or of what stands in the file
        raise RobotError(f"{urdf}: cannot be read: {brief(str(problem), 300)}") from None


def dynamics(root: ElementTree.Element) -> dict[str, UrdfDynamics]:
    """Return joint -> its <dynamics>."""
    return {
        name: UrdfDynamics(*(float(tag.get(key, 0)) for key in UrdfDynamics._fields))
        for name, tag in _parts(root, "dynamics")
    }


def _parts(root: ElementTree.Element, tag: str) -> list[tuple[str, ElementTree.Element]]:
    """The joints with an element of this tag, and the first such element of each."""
    tags = ((joint.attrib["name"], joint.find(tag)) for joint in root.findall("joint"))
    return [(name, child) for name, child in tags if child is not None]


def reductions(root: ElementTree.Element) -> dict[str, float]:
    """Return joint -> mechanical reduction (motor turns per joint turn) of a URDF's transmissions.

    If both the joint and the actuator have one, the actuator's is used, as in ROS.
    """
    ratios: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        texts = [
            *transmission.findall("joint/mechanicalReduction"),
            *transmission.findall("actuator/mechanicalReduction"),
            *transmission.findall("mechanicalReduction"),
        ]
        values = [_number((element.text or "").strip()) for element in texts]
        for joint in transmission.findall("joint"):
            if values and values[-1] is not None and joint.get("name"):
                ratios[str(joint.get("name"))] = values[-1]
    return ratios


def _check_elements(root: ElementTree.Element, urdf: Path) -> None:
    """Check names, types, links and numbers, which parsers report without their place."""
    for tag in ("link", "joint"):
        names = [element.get("name") for element in root.findall(tag)]
        if None in names or "" in names:
            position = next(i for i, name in enumerate(names) if not name) + 1
            raise RobotError(f"{urdf}: {tag} number {position} has no name")
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise RobotError(f"{urdf}: two {tag}s are named {twice[0]!r}; names must differ")
    for joint in root.findall("joint"):
        where = f"{urdf}: joint {joint.get('name')!r}"
        kind = joint.get("type")
        if kind not in _JOINT_TYPES and not (kind == BALL and MARK in root.attrib):
            raise RobotError(f"{where} has the type {kind!r}; {choose_from(kind, _JOINT_TYPES)}")
        for end in ("parent", "child"):
            element = joint.find(end)
            if element is None or not element.get("link"):
                raise RobotError(f"{where} has no <{end} link=...>")
        axis = joint.find("axis")
        if axis is not None and axis.get("xyz") is None:
            raise RobotError(f"{where} has an <axis> without xyz; give a direction")
        if kind in ("revolute", "prismatic") and joint.find("limit") is None:
            raise RobotError(f"{where} is {kind} and has no <limit>; give one, or type continuous")
        _check_numbers(joint, where)
    for link in root.findall("link"):
        where = f"{urdf}: link {link.get('name')!r}"
        _check_inertial(link, where)
        for shape in (*link.findall("visual"), *link.findall("collision")):
            _check_numbers(shape, where)
            body = shape.find("geometry/*")
            if body is None or body.tag not in _MEASURES:
                kinds = ", ".join(_MEASURES)
                raise RobotError(f"{where}: a <{shape.tag}> needs a <geometry>, of {kinds}")
            if missing := [name for name in _MEASURES[body.tag] if body.get(name) is None]:
                raise RobotError(
                    f"{where}: a <{shape.tag}> has a <{body.tag}> without {missing[0]}"
                )


def _check_inertial(link: ElementTree.Element, where: str) -> None:
    """Check for missing parts: parsers replace them by zeros without a message."""
    inertials = link.findall("inertial")
    if len(inertials) > 1:
        raise RobotError(f"{where} has {len(inertials)} <inertial>; keep one of them")
    for inertial in inertials:
        _check_numbers(inertial, where)
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or mass.get("value") is None:
            raise RobotError(f"{where} has an <inertial> without <mass value=...>")
        moments = _NUMBERS["inertia"]
        missing = [m for m in moments if inertia is None or inertia.get(m) is None]
        if missing and float(mass.get("value", "0")) > 0:
            raise RobotError(f"{where} has an <inertial> without inertia {', '.join(missing)}")


#: Attributes that hold numbers: element tag -> attribute -> how many.
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "dynamics": {"friction": 1, "damping": 1, "armature": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {"scale": 3},
}


#: The numbers that every reader of URDFs takes, and infinity. Python's `float` takes more, and
#: urdfdom drops the whole <inertial> of a number that it does not take, without an error.
_SPELLING = re.compile(r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|inf(inity)?)", re.A | re.I)
_BLANKS = " \t\r\n"


def _check_numbers(element: ElementTree.Element, where: str) -> None:
    """Check the numbers of an element's parts, and write them as urdfdom reads them.

    One blank separates two numbers; an infinite limit becomes the largest float, Pinocchio's word
    for none.
    """
    for child in element.iter():
        for attribute, count in _NUMBERS.get(child.tag, {}).items():
            text = child.get(attribute)
            if text is None:
                continue
            words = re.split(f"[{_BLANKS}]+", text.strip(_BLANKS))
            values = [_number(word) for word in words]
            limit = child.tag == "limit"
            finite = limit or all(math.isfinite(v) for v in values if v is not None)
            shown = f"{where}: <{child.tag} {attribute}={brief(text)}>"
            if len(values) != count or None in values or not finite:
                kind = "number" if limit else "finite number"
                wanted = f"a {kind}" if count == 1 else f"{count} {kind}s"
                raise RobotError(f"{shown} should be {wanted}, as 2, 0.5 or 1e-3")
            if not limit and any(abs(v) > LARGEST for v in values if v is not None):
                raise RobotError(f"{shown} should be at most {LARGEST:g} in magnitude")
            # readers may take such a number for zero
            tiny = [w for w in words if abs(float(w)) < sys.float_info.min]
            if any(re.search("[1-9]", w.lower().partition("e")[0]) for w in tiny):
                raise RobotError(f"{shown} should be 0, or at least 1e-307 in magnitude")
            most = sys.float_info.max
            spelled = (
                w if abs(float(w)) <= most else repr(math.copysign(most, float(w))) for w in words
            )
            child.set(attribute, " ".join(spelled))


def _number(word: str) -> float | None:
    return float(word) if _SPELLING.fullmatch(word) else None


def _check_tree(root: ElementTree.Element, urdf: Path) -> None:
    links = [link.attrib["name"] for link in root.findall("link")]
    if not links:
        raise RobotError(f"{urdf}: has no <link>")
    above: dict[str, str] = {}
    for joint in root.findall("joint"):
        name, ends = joint.attrib["name"], (link_of(joint, "parent"), link_of(joint, "child"))
        for end in ends:
            if end not in links:
                raise RobotError(
                    f"{urdf}: joint {name!r} names link {end!r}; {choose_from(end, links)}"
                )
        if ends[1] in above:
            raise RobotError(
                f"{urdf}: link {ends[1]!r} is the child of {above[ends[1]]!r} and "
                f"{name!r}; a URDF is a tree: close loops in the scene's `loops`"
            )
        above[ends[1]] = name
    roots = [name for name in links if name not in above]
    if len(roots) != 1:
        raise RobotError(f"{urdf}: needs one root link, found {roots or 'a ring of links'}")
    reached = _reachable(roots, root.findall("joint"))
    if lost := [name for name in links if name not in reached]:
        raise RobotError(f"{urdf}: links {lost} form a ring without connection to {roots[0]!r}")


def _reachable(start: Sequence[str], joints: Iterable[ElementTree.Element]) -> set[str]:
    """Links reached from `start` along the joints, downwards."""
    reached = set(start)
    ends = [(link_of(joint, "parent"), link_of(joint, "child")) for joint in joints]
    while grown := {child for parent, child in ends if parent in reached} - reached:
        reached |= grown
    return reached


def _check_joints(root: ElementTree.Element, urdf: Path) -> None:
    unlimited = []
    for joint in root.findall("joint"):
        where, kind = f"{urdf}: joint {joint.get('name')!r}", joint.get("type")
        if kind in ("fixed", "floating", BALL):
            continue
        axis_tag, limit = joint.find("axis"), joint.find("limit")
        axis = (
            [1.0, 0.0, 0.0]
            if axis_tag is None
            else list(map(float, axis_tag.attrib["xyz"].split()))
        )
        if not 1e-9 < max(map(abs, axis)) < 1e9:
            raise RobotError(f"{where} has the axis {axis}; give a direction")
        if kind in ("revolute", "prismatic") and limit is not None:
            lower, upper = (limit.get(end) for end in ("lower", "upper"))
            if lower is not None and upper is not None and float(lower) > float(upper):
                raise RobotError(f"{where}: limits lower {float(lower)} > upper {float(upper)}")
        for key in ("effort", "velocity"):
            if limit is not None and float(limit.get(key, 0)) < 0:
                unlimited.append(f"{joint.get('name')!r} ({key} {limit.get(key)})")
                limit.set(key, "0")
    if unlimited:
        more = f" and {len(unlimited) - 1} more" if len(unlimited) > 1 else ""
        warnings.warn(
            f"{urdf}: negative limits are read as none: {unlimited[0]}{more}",
            PinfricWarning,
            stacklevel=4,
        )


def bodies(root: ElementTree.Element) -> dict[str, tuple[float, np.ndarray]]:
    """Return link -> its mass (kg), and its inertia (3, 3) about its centre of mass (kg m^2).

    Links without an <inertial> are left out.
    """
    by_link = {}
    for link in root.findall("link"):
        if (mass := link.find("inertial/mass")) is not None:
            moments = link.find("inertial/inertia")
            attributes: Mapping[str, str] = {} if moments is None else moments.attrib
            inertia = np.reshape([float(attributes.get(moment, 0)) for moment in _MOMENTS], (3, 3))
            by_link[link.attrib["name"]] = float(mass.attrib["value"]), inertia
    return by_link


def _check_inertias(root: ElementTree.Element, urdf: Path) -> None:
    """Refuse negative masses; warn once of other impossible bodies."""
    still, found = still_links(root), bodies(root)
    moving = {name: body for name, body in found.items() if name not in still}
    problems = {n: why for n, body in moving.items() if (why := implausible_body(*body))}
    for name, problem in problems.items():
        if found[name][0] < 0:
            raise RobotError(f"{urdf}: link {name!r}: {problem}")
    if problems:
        first, *others = problems
        also = f"; also {', '.join(others)}" if others else ""
        warnings.warn(
            f"{urdf}: link {first!r}: {problems[first]}{also}; used as written "
            "(`pinfric check` lists them, --strict refuses them)",
            FindingWarning,
            stacklevel=4,
        )


def still_links(root: ElementTree.Element) -> set[str]:
    """Return the links that never move: the root and all links fixed to it."""
    joints = root.findall("joint")
    children = {link_of(joint, "child") for joint in joints}
    roots = [
        name for link in root.findall("link") if (name := link.get("name", "")) not in children
    ]
    return _reachable(roots, (joint for joint in joints if joint.get("type") == "fixed"))


def implausible_body(mass: float, inertia: np.ndarray) -> str | None:
    """Return why no rigid body has this mass and inertia about its centre of mass, or None.

    Each principal moment is at most the sum of the other two (triangle inequality), within the
    rounding of a file. `mass` is in kg, `inertia` (3, 3) in kg m^2.
    """
    if not math.isfinite(mass) or not np.isfinite(inertia).all():
        return "mass or inertia is not finite"
    if mass < 0:
        return f"mass {mass:g} kg is negative"
    moments = np.linalg.eigvalsh(inertia)
    slack = _INERTIA_SLACK * moments[2] + _INERTIA_FLOOR
    shown = ", ".join(f"{m:.3g}" for m in moments)
    if moments[0] < -slack:
        return f"principal moments of inertia {shown} kg m^2: one is negative"
    if mass == 0 and moments[2] > _INERTIA_FLOOR:
        return f"principal moments of inertia {shown} kg m^2 without a mass"
    if moments[2] > moments[0] + moments[1] + slack:
        return (
            f"principal moments of inertia {shown} kg m^2 violate the triangle "
            "inequality (the largest exceeds the sum of the others): no body has them"
        )
    return None


def missing_meshes(
    root: ElementTree.Element, urdf: Path, package_dirs: Sequence[Path]
) -> list[str]:
    """Return the mesh names of a URDF whose files are not there, sorted."""
    shapes = (*root.iterfind("link/visual"), *root.iterfind("link/collision"))
    names = {mesh.get("filename", "") for shape in shapes for mesh in shape.iter("mesh")}
    return sorted(
        name or "(a <mesh> without a filename)"
        for name in names
        if mesh_file(name, urdf, package_dirs) is None
    )


def warn_of_missing_meshes(
    root: ElementTree.Element, urdf: Path, package_dirs: Sequence[Path]
) -> None:
    """Warn once about missing mesh files; the dynamics do not need them."""
    if missing := missing_meshes(root, urdf, package_dirs):
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        warnings.warn(
            f"{urdf}: there is no mesh {missing[0]}{more}; loaded without (efforts do not need "
            "meshes)",
            PinfricWarning,
            stacklevel=2,
        )


def mesh_file(name: str | None, urdf: Path, package_dirs: Sequence[Path]) -> Path | None:
    """Return the file of a URDF's mesh name (package://, file:// or a path), or None."""
    if not name:
        return None
    scheme, _, rest = name.partition("://")
    if not rest:
        candidates = [urdf.parent / name]
    elif scheme == "file":
        candidates = [Path(rest)]
    else:
        candidates = [folder / rest.lstrip("/") for folder in package_dirs]
    file = next((path for path in candidates if os.path.isfile(path)), None)
    note_input(*([] if file is None else [file]))
    return file


def read_mesh_scene(path: Path) -> tuple[Any, float]:
    """Return a mesh file as trimesh's scene, and the metres that one of its units has.

    Collada files name their unit, as RViz and Gazebo read it; other formats are in metres. Raises
    whatever the format's reader raises.
    """
    import trimesh  # 0.4 s: only where a mesh is there

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # it prints its doubts
    scene: Any = trimesh.load(str(path), force="scene", process=False)
    named = path.suffix.lower() == ".dae" and scene.units
    return scene, trimesh.units.unit_conversion(scene.units, "meters") if named else 1.0
