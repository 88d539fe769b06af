"""`pinfric check`: everything implausible about a URDF or a scene, in one list."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path

from pinfric.checking.findings import CheckReport, Finding, error, note, warning
from pinfric.checking.joints import joint_findings
from pinfric.checking.links import link_findings
from pinfric.checking.robot import RobotFacts
from pinfric.checking.scene import massless_findings, scene_findings
from pinfric.errors import PinfricWarning, RobotError, SceneError
from pinfric.model.legs import hanging_legs
from pinfric.model.robot import BUNDLED, Robot, read_robot, urdf_file
from pinfric.model.scene import Scene
from pinfric.model.scene_file import load_scene
from pinfric.model.yamlfile import path_of

_URDF_SUFFIXES = (".urdf", ".xacro", ".xml", ".sdf", ".mjcf")


def check(source: str | Path, xacro_args: Mapping[str, str] | None = None) -> CheckReport:
    """Return everything implausible about a URDF, or about a scene and its URDF.

    Args:
        source: a URDF (or xacro), `example-robot-data:<path below its robots folder>`, a scene
            file, or a bundled scene's name.
        xacro_args: of a xacro; a scene has its own, `robot.xacro_args`.

    Raises:
        RobotError, SceneError: it cannot be read at all.

    >>> import pinfric as pf
    >>> pf.check("pendulum").errors
    0
    """
    if is_urdf(source):
        return check_urdf(urdf_file(source), str(source), xacro_args)
    if xacro_args:
        raise SceneError(f"{source}: is a scene: write its `robot.xacro_args`")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PinfricWarning)
        scene = load_scene(source)
    said = [str(w.message) for w in caught if issubclass(w.category, PinfricWarning)]
    # The robot's findings, then the scene's; loading's own questions are not asked twice
    findings: list[Finding] = []
    facts, files = None, [scene.source]
    if scene.robot is not None:
        files.append(str(scene.robot.urdf))
        facts = RobotFacts.of(scene.robot.urdf, scene.robot.xacro_args)
        findings += _urdf_findings(facts, scene)
    findings += scene_findings(scene, facts, said)
    return CheckReport.of(scene.source, findings, {} if facts is None else _figures(facts), files)


def check_urdf(
    urdf: Path, source: str = "", xacro_args: Mapping[str, str] | None = None
) -> CheckReport:
    """Return everything implausible about a URDF, called `source` or by its path.

    Raises:
        RobotError: it cannot be read at all.
    """
    facts = RobotFacts.of(urdf, xacro_args)
    return CheckReport.of(source or str(urdf), _urdf_findings(facts), _figures(facts), [urdf])


def is_urdf(source: str | Path) -> bool:
    """Return whether a name means a robot, not a scene: by its suffix, else its content."""
    path = path_of(source, RobotError)
    if str(source).startswith(BUNDLED) or path.suffix.lower() in _URDF_SUFFIXES:
        return True
    if path.suffix.lower() in (".yaml", ".yml") or not os.path.isfile(path):
        return False
    with path.open("rb") as file:
        return file.read(256).lstrip().startswith(b"<")


def _urdf_findings(facts: RobotFacts, scene: Scene | None = None) -> Iterator[Finding]:
    """With a scene, its payloads and rotors count where joints move no mass."""
    robot: Robot | None = None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PinfricWarning)
            robot = read_robot(facts.urdf, {}, facts.xacro_args)
    except RobotError as refused:
        reason = str(refused).removeprefix(f"{facts.urdf}: ")
        yield error("does not load", "robot", reason, "", excess=1e9)
    yield from link_findings(facts)
    yield from joint_findings(facts, robot)
    if robot is not None and any(facts.masses.values()):
        yield from massless_findings(scene or Scene(robot.model))
    if robot is not None and (legs := hanging_legs(robot.model)):
        said, _, how = legs.partition("; ")
        yield warning("legs", "robot", said, how)
    for text in facts.said:
        yield warning("reading", "robot", text, "")
    if facts.nameless:
        yield note("no name", "robot", "has no name", "called 'robot'")
    for mesh in facts.missing:
        yield note(
            "missing mesh",
            f"mesh {Path(mesh).name}",
            f"there is no file {mesh}",
            "not needed for efforts, but the size of its link is not checked",
        )
    for mesh, why in facts.unread.items():
        yield note("unreadable mesh", f"mesh {Path(mesh).name}", "cannot be read", why)


def _figures(facts: RobotFacts) -> dict[str, float]:
    return {
        "links": len(facts.document.links),
        "joints": sum(joint.type != "fixed" for joint in facts.document.joints),
        "moving_mass": sum(link.mass for link in facts.links),
        "fixed_mass": sum(facts.fixed_mass.values()),
        "reach": facts.way,
    }
