"""The file a robot is read from, as XML: a URDF, xacro that is expanded first, or an MJCF."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from pinfric.errors import PinfricWarning, RobotError, cut
from pinfric.model.inputs import note_input
from pinfric.model.mjcf import read_mjcf
from pinfric.model.yamlfile import bounded

#: What other robot files begin with, and how to get a URDF from them.
_OTHERS = {
    "sdf": "SDF: convert it, `sdf2mjcf model.sdf robot.xml` of the package sdformat-mjcf, and name "
    "that as robot.mjcf",
    "mujocoinclude": "a part of an MJCF: name the file that includes it",
    "COLLADA": "a Collada mesh; export the robot as a URDF",
}
#: Seconds within which xacro expands: the largest robots take one.
_PATIENCE = 20
#: A tag of xacro.
_TAG = re.compile(r"\{[^}]*/xacro/?\}")
#: Prefixes that stand in files without their declaration.
_SPACES = {b"xacro": b"http://www.ros.org/wiki/xacro", b"drake": b"http://drake.mit.edu"}
#: What a robot without a name is called.
NAMELESS = "robot"


def read_xml(urdf: Path, xacro_args: Mapping[str, str] | None = None) -> ElementTree.Element:
    """Return a URDF's root element, with xacro expanded; of an MJCF as `read_mjcf` writes it.

    A `.urdf` with leftover xacro tags that do not expand is read without them, with a warning, if
    no name and no number depends on them.

    Raises:
        RobotError: it cannot be read, is not XML, is another format, or xacro that does not expand;
            an argument that the file does not have.
    """
    root = _parsed(urdf)
    if root.tag == "mujoco":
        if xacro_args:
            raise RobotError(f"{urdf}: is no xacro, and has no argument {next(iter(xacro_args))!r}")
        return read_mjcf(urdf)
    if root.tag != "robot":
        other = _OTHERS.get(str(root.tag).rpartition("}")[2])
        is_other = f" (this is {other})" if other else ""
        raise RobotError(
            f"{urdf}: the root element is <{root.tag}>, a URDF begins with <robot>{is_other}"
        )
    if not _is_xacro(root):
        if xacro_args:
            raise RobotError(f"{urdf}: is no xacro, and has no argument {next(iter(xacro_args))!r}")
        return root
    try:
        return _expanded(urdf, root, xacro_args or {})
    except RobotError as problem:
        if urdf.suffix.lower() != ".urdf" or not _without_xacro(root):
            raise
        warnings.warn(
            f"{urdf}: tags of xacro are left in it, and what they stand for is missing; it is read "
            f"without them ({str(problem).removeprefix(f'{urdf}: ')})",
            PinfricWarning,
            stacklevel=3,
        )
        return root


def _parsed(urdf: Path) -> ElementTree.Element:
    try:
        content = bounded(urdf, RobotError)
    except OSError as problem:
        raise RobotError(f"{urdf}: cannot be read: {problem.strerror}") from None
    if not content.strip():
        raise RobotError(f"{urdf}: is empty, a URDF begins with <robot>")
    for prefix, space in _SPACES.items():
        if b"<%s:" % prefix in content and b"xmlns:%s" % prefix not in content:  # urdfdom reads it
            content = content.replace(b"<robot", b'<robot xmlns:%s="%s"' % (prefix, space), 1)
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, UnicodeDecodeError, ValueError, LookupError) as problem:
        what = "is not well-formed XML"
        if urdf.suffix.lower() in (".yaml", ".yml", ".json"):
            what = "is YAML or JSON, no robot"
        raise RobotError(f"{urdf}: {what} ({problem}); a URDF begins with <robot>") from None


def _is_xacro(root: ElementTree.Element) -> bool:
    """Whether anything is left to expand; expanded files still declare the namespace."""
    for element in root.iter():
        if isinstance(element.tag, str) and _TAG.match(element.tag):
            return True
        if any("${" in text or "$(" in text for text in element.attrib.values()):
            return True
    return False


def _without_xacro(root: ElementTree.Element) -> bool:
    """Remove xacro's tags, resolve `$(find ...)` of meshes; return whether that was all."""
    for element in list(root.iter()):
        for inner in list(element):
            if isinstance(inner.tag, str) and _TAG.match(inner.tag):
                element.remove(inner)
    for element in root.iter():
        if element.tag in ("mesh", "texture"):
            name = element.get("filename", "")
            element.set("filename", re.sub(r"\$\(\s*find\s+(\S+?)\s*\)", r"package://\1", name))
    return not _is_xacro(root)


#: Attributes that hold numbers wherever they stand.
NUMBERS = (
    *("xyz", "rpy", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz", "lower", "upper", "effort"),
    *("velocity", "friction", "damping", "multiplier", "offset", "size", "radius", "length"),
)
#: Expands the xacro file that is its argument: on stdout the names of the files it includes or
#: loads and the robot, on stderr why it does not expand. A package is looked for as xacrodoc does,
#: then as a folder of its name above the file or beside what is above it. Expressions may load any
#: file, and errors quote it: only YAML is loaded, and only words that stand in XML files or xacro
#: itself are told, also of what stands in place of a number.
_EXPAND = """
import json, os, pathlib, re, resource, sys
from xml.etree import ElementTree
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
given = json.loads(sys.argv[4])
def innermost(problem):
    while getattr(problem, "exc", None) is not None:
        problem = problem.exc
    return problem
def written():
    own = [x for x in (sys.argv[1], *xacro.all_includes) if os.path.isfile(x)]
    return [name for name in own if not name.lower().endswith((".yaml", ".yml"))]
def expanded():
    # included, not read: only so do its own includes count from its folder
    options = {"name": sys.argv[2], "resolve_packages": False, "subargs": dict(given)}
    return XacroDoc.from_includes([sys.argv[1]], **options)
def told(text, *words):
    files = [open(name, errors="replace").read() for name in [xacro.__file__, *written()]]
    known, number = " ".join([*words, sys.argv[1], *files]), r"(?<!line )(?<!column )"
    return re.sub(number + r"\\b\\w+", lambda word: word[0] if word[0] in known else "...", text)
def is_number(text):
    return re.fullmatch(r"[-+.\\deEinfat\\s]*", text) is not None
missing = ""
try:
    packages.walk_up_from(sys.argv[1])
    while True:
        try:
            made = expanded()
            break
        except Exception as problem:
            inner = innermost(problem)
            if type(inner).__name__ != "PackageNotFoundError":
                raise
            missing, again = str(inner.args[0]), missing
            above = [p / missing for p in pathlib.Path(sys.argv[1]).parents]
            above += [p for p in pathlib.Path(sys.argv[1]).parents if p.name == missing]
            there = [p for p in above if p.is_dir()] if missing != again else []
            if not there:
                raise
            packages.update_package_cache({missing: there[0]})
    texts = " ".join(open(name, errors="replace").read() for name in written())
    known = set(re.findall(r"\\$\\(\\s*arg\\s+([^\\s)]+)", texts))
    known |= set(re.findall(r":arg\\s[^>]*?name=.([^'\\s>]+?).[\\s/>]", texts))
    if unknown := set(given) - known:
        has = f"it has {', '.join(sorted(known))}" if known else "it has none"
        sys.exit(f"there is no argument {min(unknown)!r}; {has}")
    files = json.dumps(xacro.all_includes)
    root = ElementTree.fromstring(made.to_urdf_string())
    for element in root.iter():
        for name in {*sys.argv[5:]} & {*element.keys()}:
            if not is_number(element.get(name)):
                element.set(name, told(element.get(name)))
    sys.stdout.buffer.write(files.encode() + b"\\n" + ElementTree.tostring(root))
except Exception as problem:
    inner, text = innermost(problem), str(problem)
    package = type(inner).__name__ == "PackageNotFoundError"
    text = f"package {missing}" if package else text
    before, within, expression = text.partition("when evaluating")
    if within and "is not defined" not in before:
        kind = refusal if refusal in before else type(inner).__name__
        text = f"{kind} {within}{expression}"
    words = "[Errno] No such file or directory not well-formed unbound column package"
    text = told(text, type(inner).__name__, refusal, words)
    sys.exit(text or type(problem).__name__)
"""


def _expanded(
    urdf: Path, root: ElementTree.Element, xacro_args: Mapping[str, str]
) -> ElementTree.Element:
    """Expand in a process of its own: an expression may take any time and memory."""
    if find_spec("xacrodoc") is None:
        raise RobotError(
            f"{urdf}: is xacro: install the extra (pip install 'pinfric[xacro]'), or expand it "
            f"yourself (xacro {urdf.name} > robot.urdf)"
        )
    failed = f"{urdf}: is xacro and does not expand"
    name = root.get("name") or NAMELESS
    words = [str(urdf.resolve()), name, str(_PATIENCE), json.dumps(dict(xacro_args)), *NUMBERS]
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-c", _EXPAND, *words], capture_output=True, timeout=_PATIENCE
        )
    except subprocess.TimeoutExpired:
        raise RobotError(f"{failed} in {_PATIENCE} s") from None
    if ended.returncode:
        said = " ".join(ended.stderr.decode(errors="replace").split())
        if (package := re.fullmatch(r"package (\S+)", said)) is not None:
            raise RobotError(f"{failed}: {_package_not_found(package[1], urdf)}")
        if (argument := re.search(r"Undefined substitution argument (\S+)", said)) is not None:
            name = argument[1]
            said = f"its argument {name!r} has no default: give it by --xacro-arg {name}:=VALUE, or"
            said += f" in the scene by robot.xacro_args: {{{name}: VALUE}}"
        raise RobotError(f"{failed}: {cut(said, 300) or 'its process was killed'}")
    files, _, text = ended.stdout.partition(b"\n")
    note_input(*json.loads(files))
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as problem:
        raise RobotError(f"{failed}: its result is not well-formed XML ({problem})") from None


def _package_not_found(name: str, urdf: Path) -> str:
    """The message with the places where a package was looked for."""
    paths = {key: os.environ.get(key) for key in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")}
    places = [f"{key} ({value or 'not set'})" for key, value in paths.items()]
    return (
        f"there is no package {name!r}: looked for a folder of this name in "
        f"{urdf.resolve().parent} and all above it, for a package.xml with it there, and in "
        f"{' and '.join(places)}"
    )
