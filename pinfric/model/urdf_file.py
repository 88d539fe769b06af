"""The file a robot is read from, as XML: a URDF, or xacro that is expanded first."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from pinfric.errors import RobotError

#: What other robot files begin with, and how to get a URDF from them.
_OTHERS = {
    "sdf": "SDF, as Gazebo writes it",
    "mujoco": "MJCF, as MuJoCo writes it",
    "mujocoinclude": "MJCF, as MuJoCo writes it",
    "COLLADA": "a Collada mesh",
}
#: What a robot without a name is called.
NAMELESS = "robot"


def read_xml(urdf: Path) -> ElementTree.Element:
    """Return a URDF's root element, with xacro expanded.

    Raises:
        RobotError: it cannot be read, is not XML, is another format, or xacro that does not expand.
    """
    root = _parsed(urdf)
    if root.tag != "robot":
        other = _OTHERS.get(str(root.tag).rpartition("}")[2])
        is_other = f" (this is {other}; export or convert it to a URDF)" if other else ""
        raise RobotError(
            f"{urdf}: the root element is <{root.tag}>, a URDF begins with <robot>{is_other}"
        )
    if _is_xacro(root):
        root = _expanded(urdf, root)
    return root


def _parsed(urdf: Path) -> ElementTree.Element:
    try:
        content = urdf.read_bytes()
    except OSError as problem:
        raise RobotError(f"{urdf}: cannot be read: {problem.strerror}") from None
    if not content.strip():
        raise RobotError(f"{urdf}: is empty, a URDF begins with <robot>")
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, UnicodeDecodeError, ValueError, LookupError) as problem:
        raise RobotError(
            f"{urdf}: is not well-formed XML ({problem}); a URDF begins with <robot>"
        ) from None


def _is_xacro(root: ElementTree.Element) -> bool:
    """Whether anything is left to expand: expanded files still declare the namespace."""
    for element in root.iter():
        if isinstance(element.tag, str) and re.match(r"\{[^}]*/xacro/?\}", element.tag):
            return True
        if any("${" in text or "$(" in text for text in element.attrib.values()):
            return True
    return False


def _expanded(urdf: Path, root: ElementTree.Element) -> ElementTree.Element:
    try:
        from xacrodoc import XacroDoc, packages
    except ImportError:
        raise RobotError(
            f"{urdf}: is xacro: install the extra (pip install 'pinfric[xacro]'), or expand it "
            f"yourself (xacro {urdf.name} > robot.urdf)"
        ) from None
    path = urdf.resolve()
    try:
        packages.walk_up_from(path)
        # included, not read: only so do its own includes count from its folder
        document = XacroDoc.from_includes(
            [str(path)], name=root.get("name") or NAMELESS, resolve_packages=False
        )
        return ElementTree.fromstring(document.to_urdf_string())
    except Exception as problem:  # of xacro, its expressions, its includes, its packages
        reason = " ".join(str(problem).split()) or type(problem).__name__
        raise RobotError(f"{urdf}: is xacro and does not expand: {reason}") from None
