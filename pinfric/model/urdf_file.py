"""The file a robot is read from, as XML: a URDF, or xacro that is expanded first."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from pathlib import Path

from pinfric.errors import RobotError, cut
from pinfric.model.inputs import note_input
from pinfric.model.yamlfile import bounded

#: What other robot files begin with, and how to get a URDF from them.
_OTHERS = {
    "sdf": "SDF, as Gazebo writes it",
    "mujoco": "MJCF, as MuJoCo writes it",
    "mujocoinclude": "MJCF, as MuJoCo writes it",
    "COLLADA": "a Collada mesh",
}
#: Seconds within which xacro expands: the largest robots take one.
_PATIENCE = 20
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
        content = bounded(urdf, RobotError)
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


#: Expands the xacro file that is its argument: on stdout the names of the files it includes or
#: loads and the robot, on stderr why it does not expand. Expressions may load any file, and errors
#: quote it: only YAML is loaded, and only words that stand in XML files or xacro itself are told.
_EXPAND = """
import json, os, re, resource, sys
for kind, most in (resource.RLIMIT_AS, 2**32), (resource.RLIMIT_CPU, int(sys.argv[3])):
    resource.setrlimit(kind, (most, most))
import xacro, yaml
from xacrodoc import XacroDoc, packages
load, refusal = yaml.safe_load, "load_yaml takes .yaml and .yml only"
def safe_load(file):
    if not os.path.realpath(file.name).lower().endswith((".yaml", ".yml")):
        raise OSError(refusal)
    return load(file)
yaml.safe_load = safe_load
try:
    packages.walk_up_from(sys.argv[1])
    # included, not read: only so do its own includes count from its folder
    made = XacroDoc.from_includes([sys.argv[1]], name=sys.argv[2], resolve_packages=False)
    files = json.dumps(xacro.all_includes)
    sys.stdout.buffer.write(f"{files}\\n{made.to_urdf_string()}".encode())
except Exception as problem:
    inner, text = problem, str(problem)
    while getattr(inner, "exc", None) is not None:
        inner = inner.exc
    before, within, expression = text.partition("when evaluating")
    if within and "is not defined" not in before:
        kind = refusal if refusal in before else type(inner).__name__
        text = f"{kind} {within}{expression}"
    words = "[Errno] No such file or directory not well-formed column"
    known = [type(inner).__name__, refusal, words, sys.argv[1]]
    for name in [sys.argv[1], xacro.__file__, *xacro.all_includes]:
        if os.path.isfile(name) and not name.lower().endswith((".yaml", ".yml")):
            known.append(open(name, errors="replace").read())
    known, number = " ".join(known), r"(?<!line )(?<!column )"
    text = re.sub(number + r"\\b\\w+", lambda word: word[0] if word[0] in known else "...", text)
    sys.exit(text or type(problem).__name__)
"""


def _expanded(urdf: Path, root: ElementTree.Element) -> ElementTree.Element:
    """Expand in a process of its own: an expression may take any time and memory."""
    if find_spec("xacrodoc") is None:
        raise RobotError(
            f"{urdf}: is xacro: install the extra (pip install 'pinfric[xacro]'), or expand it "
            f"yourself (xacro {urdf.name} > robot.urdf)"
        )
    failed = f"{urdf}: is xacro and does not expand"
    given = [str(urdf.resolve()), root.get("name") or NAMELESS, str(_PATIENCE)]
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-c", _EXPAND, *given], capture_output=True, timeout=_PATIENCE
        )
    except subprocess.TimeoutExpired:
        raise RobotError(f"{failed} in {_PATIENCE} s") from None
    if ended.returncode:
        said = " ".join(ended.stderr.decode(errors="replace").split())
        raise RobotError(f"{failed}: {cut(said, 300) or 'its process was killed'}")
    files, _, made = ended.stdout.partition(b"\n")
    note_input(*json.loads(files))
    try:
        return ElementTree.fromstring(made)
    except ElementTree.ParseError as problem:
        raise RobotError(f"{failed}: its result is not well-formed XML ({problem})") from None
