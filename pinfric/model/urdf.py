"""The URDF, checked: what Pinocchio would pass over or say badly is said here."""

from __future__ import annotations

import logging
import math
import os
import warnings
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import PinfricWarning, RobotError, choose_from
from pinfric.model.magnitudes import LARGEST
from pinfric.model.urdf_document import Document, Joint, Link, parse_document
from pinfric.model.urdf_file import NAMELESS
from pinfric.model.yamlfile import brief

#: Triangle-inequality slack relative to the largest principal moment: URDFs print few digits.
_INERTIA_SLACK = 1e-3
#: Moments below this (kg m^2) are rounding of an exporter, not a statement.
_INERTIA_FLOOR = 1e-9
_JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "planar", "floating")


def read_document(root: ElementTree.Element, urdf: Path) -> Document:
    """Return what a URDF says of links and joints, checked; its meshes are not read.

    A robot without a name gets one in `root`. Mimicry of joints that are not there is taken out
    of it, and bodies that no matter could form are kept, each with one `PinfricWarning`: other
    programs compute with both.

    Args:
        root: as `read_xml` returns it.
        urdf: named in messages.

    Raises:
        RobotError: not a URDF, no tree, or a mass, inertia, axis or limit that cannot be.
    """
    _check_elements(root, urdf)
    if not root.get("name"):
        root.set("name", NAMELESS)
    _release_followers(root, urdf)
    try:
        document = parse_document(root)
    except ValueError as problem:
        raise RobotError(f"{urdf}: {problem}") from None
    _check_tree(document, urdf)
    _check_joints(document, urdf)
    _check_mimics(document, urdf)
    _check_inertias(document, urdf)
    return document


def reductions(root: ElementTree.Element) -> dict[str, float]:
    """Return joint -> mechanical reduction (motor turns per joint turn) of a URDF's transmissions.

    Where one stands beside the joint and one beside the actuator, the actuator's counts, as in ROS.
    """
    found: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        texts = [
            *transmission.findall("joint/mechanicalReduction"),
            *transmission.findall("actuator/mechanicalReduction"),
            *transmission.findall("mechanicalReduction"),
        ]
        values = [_number((element.text or "").strip()) for element in texts]
        for joint in transmission.findall("joint"):
            if values and values[-1] is not None and joint.get("name"):
                found[str(joint.get("name"))] = values[-1]
    return found


def _check_elements(root: ElementTree.Element, urdf: Path) -> None:
    """Names, types, ends and numbers: what parsers otherwise report without saying where."""
    for tag in ("link", "joint"):
        names = [element.get("name") for element in root.findall(tag)]
        if None in names or "" in names:
            position = next(i for i, name in enumerate(names) if not name) + 1
            raise RobotError(f"{urdf}: {tag} number {position} has no name")
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise RobotError(f"{urdf}: {tag} {twice[0]!r} stands twice; names must differ")
    for joint in root.findall("joint"):
        where = f"{urdf}: joint {joint.get('name')!r}"
        kind = joint.get("type")
        if kind not in _JOINT_TYPES:
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


def _check_inertial(link: ElementTree.Element, where: str) -> None:
    """Parsers fill in zeros for what is missing: a link without mass would go unnoticed."""
    inertials = link.findall("inertial")
    if len(inertials) > 1:
        raise RobotError(f"{where} has {len(inertials)} <inertial>; which counts?")
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
    "dynamics": {"friction": 1, "damping": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {"scale": 3},
}


def _check_numbers(element: ElementTree.Element, where: str) -> None:
    for part in element.iter():
        for attribute, count in _NUMBERS.get(part.tag, {}).items():
            text = part.get(attribute)
            if text is None:
                continue
            values = [_number(word) for word in text.split()]
            # no limit is often written as an infinite one
            finite = part.tag == "limit" or all(math.isfinite(v) for v in values if v is not None)
            shown = f"{where}: <{part.tag} {attribute}={brief(text)}>"
            if len(values) != count or None in values or not finite:
                wanted = "a finite number" if count == 1 else f"{count} finite numbers"
                raise RobotError(f"{shown} should be {wanted}")
            if part.tag != "limit" and any(abs(v) > LARGEST for v in values if v is not None):
                raise RobotError(f"{shown} should be at most {LARGEST:g} in magnitude")


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _check_tree(document: Document, urdf: Path) -> None:
    links = [link.name for link in document.links]
    if not links:
        raise RobotError(f"{urdf}: has no <link>")
    parents: dict[str, Joint] = {}
    for joint in document.joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise RobotError(
                    f"{urdf}: joint {joint.name!r} names link {end!r}; {choose_from(end, links)}"
                )
        if joint.child in parents:
            raise RobotError(
                f"{urdf}: link {joint.child!r} is the child of {parents[joint.child].name!r} and "
                f"{joint.name!r}; a URDF is a tree: close loops in the scene's `loops`"
            )
        parents[joint.child] = joint
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        raise RobotError(f"{urdf}: needs one root link, found {roots or 'a ring of links'}")
    reached = _reachable(roots, document.joints)
    if lost := [name for name in links if name not in reached]:
        raise RobotError(f"{urdf}: links {lost} hang in a ring that no joint ties to {roots[0]!r}")


def _reachable(start: Sequence[str], joints: Iterable[Joint]) -> set[str]:
    """Links reached from `start` along the joints, downwards."""
    reached = set(start)
    joints = list(joints)
    while grown := {j.child for j in joints if j.parent in reached} - reached:
        reached |= grown
    return reached


def _check_joints(document: Document, urdf: Path) -> None:
    for joint in document.joints:
        where = f"{urdf}: joint {joint.name!r}"
        if joint.type in ("fixed", "floating"):
            continue
        if not 1e-9 < np.abs(joint.axis).max() < 1e9:
            raise RobotError(f"{where} has the axis {joint.axis.tolist()}; give a direction")
        limit = joint.limit
        if limit is None or limit.lower is None or limit.upper is None:
            continue
        if joint.type in ("revolute", "prismatic") and limit.lower > limit.upper:
            raise RobotError(f"{where}: limits lower {limit.lower} > upper {limit.upper}")


def _check_mimics(document: Document, urdf: Path) -> None:
    joints = {joint.name: joint for joint in document.joints}
    for name, joint in joints.items():
        if joint.mimic is None:
            continue
        where, leader = f"{urdf}: joint {name!r}", joint.mimic.joint
        if leader == name:
            raise RobotError(f"{where} mimics itself")
        if (above := joints[leader].mimic) is not None:
            raise RobotError(
                f"{where} mimics {leader!r}, which mimics {above.joint!r}: "
                f"Pinocchio takes no chains; mimic {above.joint!r} directly"
            )
        if joints[leader].type not in ("revolute", "prismatic"):
            raise RobotError(
                f"{where} mimics {leader!r}, a {joints[leader].type} joint; Pinocchio takes "
                "revolute and prismatic leaders: give it limits"
            )
        if joint.mimic.multiplier == 0.0:
            raise RobotError(f"{where} mimics with the multiplier 0: make it a fixed joint")


def lost_leaders(root: ElementTree.Element) -> dict[str, str]:
    """Return joint -> the joint it mimics, where that one is not there."""
    joints = {joint.get("name") for joint in root.findall("joint")}
    return {
        str(joint.get("name")): str(mimic.get("joint"))
        for joint in root.findall("joint")
        for mimic in joint.findall("mimic")
        if mimic.get("joint") not in joints
    }


def _release_followers(root: ElementTree.Element, urdf: Path) -> None:
    """Take out mimicry of joints that are not there: such a joint moves by itself."""
    lost = lost_leaders(root)
    if not lost:
        return
    for joint in root.findall("joint"):
        for mimic in joint.findall("mimic") if joint.get("name") in lost else ():
            joint.remove(mimic)
    name, leader = next(iter(lost.items()))
    others = f" (and {len(lost) - 1} more joints have no leader)" if len(lost) > 1 else ""
    warnings.warn(
        f"{urdf}: joint {name!r} mimics {leader!r}, which is not there{others}; what has no "
        "leader moves by itself, with a drive of its own",
        PinfricWarning,
        stacklevel=4,
    )


def implausible_links(document: Document) -> dict[str, str]:
    """Return link -> why no rigid body has its mass and inertia; links that never move left out."""
    still = still_links(document)
    bodies = {
        link.name: mass_and_inertia(link)
        for link in document.links
        if link.inertial is not None and link.name not in still
    }
    return {name: why for name, body in bodies.items() if (why := implausible_body(*body))}


def _check_inertias(document: Document, urdf: Path) -> None:
    """Refuse negative masses; warn once of other bodies that cannot be."""
    problems = implausible_links(document)
    for link in document.links:
        if link.name in problems and mass_and_inertia(link)[0] < 0:
            raise RobotError(f"{urdf}: link {link.name!r}: {problems[link.name]}")
    if problems:
        first, *others = problems
        also = f"; the like of {', '.join(others)}" if others else ""
        warnings.warn(
            f"{urdf}: link {first!r}: {problems[first]}{also}; computed with as written "
            "(`pinfric check` lists them, --strict refuses them)",
            PinfricWarning,
            stacklevel=4,
        )


def still_links(document: Document) -> set[str]:
    """Return the links that never move: the root and what is fixed to it."""
    children = {joint.child for joint in document.joints}
    roots = [link.name for link in document.links if link.name not in children]
    return _reachable(roots, (joint for joint in document.joints if joint.type == "fixed"))


def mass_and_inertia(link: Link) -> tuple[float, np.ndarray]:
    """Return a link's mass (kg) and its inertia (3, 3) about its centre of mass, zeros if none."""
    given = link.inertial
    return (0.0, np.zeros((3, 3))) if given is None else (given.mass, given.inertia)


def implausible_body(mass: float, inertia: np.ndarray) -> str | None:
    """Say why no rigid body has this mass and inertia about its centre of mass, or None.

    J's principal moments are sums of integrals over the body, so each is at most the sum of the
    other two (triangle inequality); rounding of what a file prints is allowed for.

    Args:
        mass: kg.
        inertia: (3, 3), kg m^2, about the centre of mass.
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


def missing_meshes(document: Document, urdf: Path, package_dirs: Sequence[Path]) -> list[str]:
    """Return the mesh names of a URDF whose files are not there, sorted."""
    names = {shape.mesh for link in document.links for shape in link.shapes} - {None}
    return sorted(
        name or "(a <mesh> without a filename)"
        for name in names
        if mesh_file(name, urdf, package_dirs) is None
    )


def warn_of_missing_meshes(document: Document, urdf: Path, package_dirs: Sequence[Path]) -> None:
    """Warn once, naming them, of mesh files that are not there; the dynamics do without them."""
    if missing := missing_meshes(document, urdf, package_dirs):
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
    return next((path for path in candidates if os.path.isfile(path)), None)


def read_mesh_scene(path: Path) -> tuple[Any, float]:
    """Return a mesh file as trimesh's scene, and the metres that one of its units has.

    Collada files name their unit, and RViz and Gazebo apply it; other formats are in metres.

    Raises:
        Exception: whatever the format's reader raises.
    """
    import trimesh  # 0.4 s: only where a mesh is there

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # it prints its doubts
    scene: Any = trimesh.load(str(path), force="scene", process=False)
    named = path.suffix.lower() == ".dae" and scene.units
    return scene, trimesh.units.unit_conversion(scene.units, "meters") if named else 1.0
