"""A scene as the content of a file, and its robot as a URDF: for commands that change a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pinocchio as pin

from pinfric.model.entry import Entry
from pinfric.model.robot import Robot, locator, robot_text
from pinfric.model.scene import Scene
from pinfric.model.schema import LoopTolerance, Redundancy, Simulation, TableEffort


def scene_content(scene: Scene, robot: Robot, folder: Path, urdf: str = "") -> dict[str, Any]:
    """Return a scene as the content of a file in `folder`.

    `urdf` is a file there with the robot's other inertias (`robot_with_bodies`); "": its own.
    """
    content: dict[str, Any] = {"pinfric": 1, "robot": _robot(scene, robot, folder, urdf)}
    sites = [*scene.joint_names, *(loop.name for loop in scene.loops)]
    order = sorted(scene.friction, key=lambda name: sites.index(name) if name in sites else -1)
    content["friction"] = {name: _dump(scene.friction[name]) for name in order}
    if scene.loops:
        content["loops"] = [_dump(loop) for loop in scene.loops]
        if scene.loop_tolerance != LoopTolerance():
            content["loop_tolerance"] = _dump(scene.loop_tolerance)
        if scene.redundancy_length != Redundancy().length:
            content["redundancy"] = {"length": scene.redundancy_length}
    if scene.springs:
        content["springs"] = [_dump(spring) for spring in scene.springs]
    if scene.actuators is not None:
        content["actuators"] = [
            _dump(drive)
            | ({"transmission": _dump(drive.transmission)} if drive.transmission else {})
            for drive in scene.actuators
        ]
    if scene.feet:
        content["feet"] = {name: _dump(foot) for name, foot in scene.feet.items()}
    content["stick"] = {"velocity": scene.stick_velocity}
    if scene.tool is not None:
        content["tool"] = scene.tool
    if scene.simulation is not None:
        content["simulation"] = _simulation(scene.simulation, Path(scene.source).parent)
    for name in ("stops", "measured", "sized", "assumed"):
        if (entry := getattr(scene, name)) is not None:
            content[name] = entry.model_dump(exclude_unset=True)
    return content


def _robot(scene: Scene, robot: Robot, folder: Path, urdf: str) -> dict[str, Any]:
    """The section `robot`."""
    section: dict[str, Any] = {"urdf": urdf} if urdf else {robot.key: locator(robot.urdf, folder)}
    if robot.floating is not None:
        section["floating"] = robot.floating
    section["gravity"] = scene.model.gravity.linear.tolist()
    if robot.xacro_args and not urdf:  # the new file is xacro no more
        section["xacro_args"] = dict(robot.xacro_args)
    if robot.locked:
        section["locked"] = dict(robot.locked)
    if any(map(any, robot.dynamics.values())):
        section["urdf_dynamics"] = "ignore"  # what counts of them stands under `friction`
    if scene.masses is not None:
        words: dict[bool | None, str] = {True: "with_drives", False: "without_drives"}
        held = set(scene.masses_hold) - {None}
        named = isinstance(scene.masses, str) or len(held) > 1 or None in scene.masses_hold
        section["masses"] = scene.masses if named else words[held.pop()]
    if scene.masses_confirmed:
        section["masses_confirmed"] = True
    if scene.payloads:
        section["payloads"] = {name: _dump(payload) for name, payload in scene.payloads.items()}
    return section


def robot_with_bodies(robot: Robot, model: pin.Model) -> str:
    """Return the URDF with a model's inertias: each body's at the link that its joint moves.

    Links fixed to that link lose theirs: they are one body with it.
    """
    moved_by = {
        str(joint.get("name")): str(child.get("link"))
        for joint in robot.xml().findall("joint")
        if (child := joint.find("child")) is not None
    }
    bodies = (f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint > 0)
    inertias: dict[str, pin.Inertia | None] = dict.fromkeys(str(frame.name) for frame in bodies)
    for body in range(1, model.njoints):
        inertias[moved_by[model.names[body]]] = model.inertias[body]
    return robot_text(robot, inertias)


def _dump(entry: Entry) -> dict[str, Any]:
    """An entry as a file has it, without defaults; a lone coefficient becomes a number."""
    content = entry.model_dump(exclude_defaults=True)
    return {
        key: value["coefficient"]
        if isinstance(value, dict) and set(value) == {"coefficient"}
        else value
        for key, value in content.items()
    }


def _simulation(simulation: Simulation, folder: Path) -> dict[str, Any]:
    """The scene's own, with its tables named in full."""
    content = _dump(simulation)
    for name, effort in simulation.effort.items():
        if isinstance(effort, TableEffort):
            content["effort"][name] = {"table": str((folder / effort.table).resolve())}
    return content
