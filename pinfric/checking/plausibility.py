"""Everything implausible about a robot and a scene, in one list, which all commands read."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from pinfric.checking.findings import (
    CONFIRMED,
    CheckReport,
    Finding,
    Severity,
    error,
    note,
    warning,
)
from pinfric.checking.joints import joint_findings
from pinfric.checking.links import link_findings, outweighing
from pinfric.checking.robot import RobotFacts
from pinfric.checking.robot_masses import NO_MASS, doubted
from pinfric.checking.scene import massless_findings, scene_findings
from pinfric.errors import PinfricWarning, RobotError, SceneError
from pinfric.model.file_loops import OPEN
from pinfric.model.legs import hanging_legs
from pinfric.model.robot import BUNDLED, Robot, read_robot, urdf_file
from pinfric.model.scene import Scene
from pinfric.model.scene_file import load_scene
from pinfric.model.total_mass import doubted_mass, doubted_reach, reach_of
from pinfric.model.yamlfile import path_of

_URDF_SUFFIXES = (".urdf", ".xacro", ".xml", ".sdf", ".mjcf")


def check(source: str | Path | Scene, xacro_args: Mapping[str, str] | None = None) -> CheckReport:
    """Return everything implausible about a URDF, or about a scene and its URDF.

    Args:
        source: a URDF (or xacro), `example-robot-data:<path below its robots folder>`, a scene
            file, a bundled scene's name, or a scene.
        xacro_args: of a xacro; a scene has its own, `robot.xacro_args`.

    Raises:
        RobotError, SceneError: it cannot be read at all.

    >>> import pinfric as pf
    >>> pf.check("pendulum").errors
    0
    """
    if not isinstance(source, Scene) and is_urdf(source):
        return check_urdf(urdf_file(source), str(source), xacro_args)
    if xacro_args:
        raise SceneError(f"{source}: is a scene: write its `robot.xacro_args`")
    scene = source
    if not isinstance(scene, Scene):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PinfricWarning)  # its questions are among the findings
            scene = load_scene(scene)
    if scene.robot is None:
        return CheckReport(scene.source, scene.findings, {}, (scene.source,))
    files = scene.source, str(scene.robot.urdf)
    return CheckReport(scene.source, scene.findings, _figures(_facts(scene.robot)), files)


def check_urdf(
    urdf: Path, source: str = "", xacro_args: Mapping[str, str] | None = None
) -> CheckReport:
    """Return everything implausible about a URDF, called `source` or by its path.

    Raises:
        RobotError: it cannot be read at all.
    """
    facts = RobotFacts.of(urdf, xacro_args)
    found = _ordered(_urdf_findings(facts))
    return CheckReport(source or str(urdf), found, _figures(facts), (str(urdf),))


def is_urdf(source: str | Path) -> bool:
    """Return whether a name means a robot, not a scene: by its suffix, else its content."""
    path = path_of(source, RobotError)
    if str(source).startswith(BUNDLED) or path.suffix.lower() in _URDF_SUFFIXES:
        return True
    if path.suffix.lower() in (".yaml", ".yml") or not os.path.isfile(path):
        return False
    with path.open("rb") as file:
        return file.read(256).lstrip().startswith(b"<")


def findings_of(scene: Scene, meshes: bool = True) -> tuple[Finding, ...]:
    """Return everything implausible about a scene and its robot, the most severe first.

    `scene.findings` keeps it. Without `meshes` (`scene.quick_findings`) it takes milliseconds: all
    errors are in it, and the warnings that ask for no mesh.
    """
    facts = None if scene.robot is None else _facts(scene.robot)
    return _ordered(_of_scene(scene, facts, meshes))


def _facts(robot: Robot) -> RobotFacts:
    return RobotFacts.of(robot.urdf, robot.xacro_args, robot.floating)


def _ordered(findings: Iterator[Finding]) -> tuple[Finding, ...]:
    return tuple(sorted(findings, key=lambda f: (-f.severity, -f.excess)))


def _of_scene(scene: Scene, facts: RobotFacts | None, meshes: bool) -> Iterator[Finding]:
    robot = _model_findings(scene) if facts is None else _urdf_findings(facts, scene, meshes)
    for finding in robot:
        yield _as_owned(finding, scene) if finding.kind == "masses" else finding
    yield from scene_findings(scene, facts, meshes)


def _as_owned(finding: Finding, scene: Scene) -> Finding:
    """A doubt of the robot's mass beside what its owner says of it.

    Bare links may be light, as no robot with its drives is; a mass that is confirmed is believed.
    """
    if scene.masses_confirmed:
        said = f"{finding.why}; confirmed by `robot.masses_confirmed`"
        return replace(finding, severity=Severity.NOTE, kind=CONFIRMED, why=said, unsigned=False)
    if finding.severity == Severity.ERROR or not finding.unsigned:
        return finding
    if all(hold is False for hold in scene.masses_hold):
        return replace(finding, unsigned=False)
    said = f"{finding.why}; bare links are said by `robot.masses: without_drives`"
    return replace(finding, why=said)


def _model_findings(scene: Scene) -> Iterator[Finding]:
    """Of a robot without a URDF: its length, its mass, its legs."""
    model = scene.model
    if doubt := doubted_reach(reach_of(model)):
        yield doubted("lengths", doubt)
    elif not any(body.mass for body in model.inertias):
        yield NO_MASS
    elif doubt := doubted_mass(model):
        yield doubted("masses", doubt)
    yield from _by_model(scene)


def _by_model(scene: Scene) -> Iterator[Finding]:
    model = scene.model
    bodies = zip(scene.joint_names, tuple(model.inertias)[1:], strict=True)
    yield from outweighing({f"what joint {name} moves": body.mass for name, body in bodies})
    if any(body.mass for body in model.inertias):
        yield from massless_findings(scene)
    if legs := hanging_legs(model):
        said, _, how = legs.partition("; ")
        yield warning("legs", "robot", said, how, unsigned=True)


def _urdf_findings(
    facts: RobotFacts, scene: Scene | None = None, meshes: bool = True
) -> Iterator[Finding]:
    """With a scene, its payloads and rotors count where joints move no mass."""
    robot: Robot | None = None if scene is None else scene.robot
    if robot is None or (meshes and robot.locked):  # effort limits are those of all its joints
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PinfricWarning)
                robot = read_robot(facts.urdf, {}, facts.xacro_args, facts.floating)
        except RobotError as refused:
            reason = str(refused).removeprefix(f"{facts.urdf}: ")
            yield error("does not load", "robot", reason, "", excess=1e9)
    yield from link_findings(facts, meshes)
    yield from joint_findings(facts, robot, meshes)
    if robot is not None:
        yield from _closures(robot, scene)
        yield from _by_model(scene or Scene(robot.model, robot=robot))
    for text in facts.said:
        yield warning("reading", "robot", text, "")
    if facts.nameless:
        yield note("no name", "robot", "has no name", "called 'robot'")
    for mesh in facts.missing if meshes else ():
        yield note(
            "missing mesh",
            f"mesh {Path(mesh).name}",
            f"there is no file {mesh}",
            "not needed for efforts, but the size of its link is not checked",
        )
    for mesh, why in facts.unread.items():
        yield note("unreadable mesh", f"mesh {Path(mesh).name}", "cannot be read", why)


def _closures(robot: Robot, scene: Scene | None) -> Iterator[Finding]:
    """The loops of the robot's file, and what of it ties links together and is not read."""
    for place, why in robot.closures.unread:
        yield warning(
            "loop not read", "robot", f"{place} is not read", f"{why}; {OPEN}", unsigned=True
        )
    if not (loops := robot.closures.loops):
        return
    more = f" and {len(loops) - 4} more" if len(loops) > 4 else ""
    names = f"its file closes loops: {', '.join(loop.name for loop in loops[:4])}{more}"
    used = "read as a scene's `loops` are"
    if scene is None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PinfricWarning)
                Scene(robot.model, loops=loops, source=str(robot.urdf))
        except SceneError as refused:
            reason = str(refused).removeprefix(f"{robot.urdf}: ")
            yield error("loop", "robot", reason, "")
    elif not {loop.name for loop in loops} <= {loop.name for loop in scene.loops}:
        used = "left out by `robot.urdf_loops: ignore`"
    yield note("loops", "robot", names, used)


def _figures(facts: RobotFacts) -> dict[str, float]:
    return {
        "links": len(facts.link_names),
        "joints": facts.moving_joints,
        "moving_mass": sum(link.mass for link in facts.links),
        "fixed_mass": sum(facts.fixed_mass.values()),
        "reach": facts.reach,
    }
