"""Read a scene file and its URDF into a `Scene`; find bundled scenes by name."""

from __future__ import annotations

import os
import warnings
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import PinfricError, PinfricWarning, RobotError, SceneError, choose_from
from pinfric.model.brief import counted
from pinfric.model.entry import parse
from pinfric.model.friction_terms import constant_friction, linear_drag
from pinfric.model.hysteresis import contradictions
from pinfric.model.inputs import note_input
from pinfric.model.robot import Robot, locate_urdf, mention_reductions, read_robot
from pinfric.model.scene import Scene
from pinfric.model.schema import (
    Actuator,
    Assumed,
    Friction,
    LinkFrame,
    Loop,
    Measured,
    SceneFile,
    TableEffort,
)
from pinfric.model.yamlfile import path_of, read_yaml

#: A robot that is measured at more than so many times its URDF's limit was measured in deg/s.
_FASTER = 5.0
#: Two loops whose frames agree to so many decimals (m) are at the same place.
_PLACE = 6


def load_scene(path: str | Path) -> Scene:
    """Read a scene file (`schema.SceneFile`), or a bundled scene by its name from any folder.

    Args:
        path: a YAML file; if it does not exist, the bundled scene of that name.

    Raises:
        SceneError: the file or an entry is wrong; RobotError: its URDF is.

    Warns:
        PinfricWarning: an implausible entry, e.g. friction that contradicts a gear's hysteresis.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> scene.actuator_names
    ('joint_1',)
    """
    file = find_file(path, (".yaml", ".yml"), SceneError)
    # Read a scene's keys; refuse another kind of file by its name
    if file.suffix.lower() in (".urdf", ".xacro", ".xml"):
        raise SceneError(
            f"{file}: is a robot, not a scene; `pinfric new {file}` writes a scene of it"
        )
    entries: SceneFile = parse(SceneFile, read_yaml(file, SceneError, "pinfric"), str(file))
    try:
        of = entries.robot
        urdf = locate_urdf(of.urdf or of.mjcf or "", file.parent)
        robot = read_robot(urdf, of.locked, of.xacro_args, of.floating)
        if getattr(of, robot.key) is None:
            kind = {"urdf": "a URDF", "mjcf": "an MJCF"}[robot.key]
            raise RobotError(f"robot: {urdf} is {kind}: write `{robot.key}: {of.urdf or of.mjcf}`")
    except RobotError as problem:
        raise RobotError(f"{file}: {problem}") from None
    if entries.actuators is None:
        mention_reductions(robot, str(file))
    if (simulation := entries.simulation) is not None:  # its tables are read where it is simulated
        efforts = (*simulation.effort.values(), *simulation.motor_torque.values())
        note_input(*(file.parent / e.table for e in efforts if isinstance(e, TableEffort)))
    stated = robot.gravity if "gravity" not in of.model_fields_set else None
    robot.model.gravity.linear = np.array(stated or of.gravity)
    # Refuse measured speeds that no joint of the robot reaches: deg/s, as a rule
    for joint in filter(robot.model.existJointName, entries.friction):
        top = entries.measured.top_speed(joint) if entries.measured else None
        column = robot.model.joints[robot.model.getJointId(joint)].idx_v
        limit = float(robot.model.velocityLimit[column])
        if top is not None and 0.0 < _FASTER * limit < top:
            raise SceneError(
                f"{file}: `measured.speed`: {joint} {top:g} is {top / limit:.0f} times the URDF's "
                f"velocity limit {limit:g}; speeds are in rad/s or m/s: if this is in deg/s, write "
                f"{np.radians(top):.3g}"
            )
    friction = _with_urdf_dynamics(entries, robot, str(file))
    for excess in contradictions(friction, entries.actuators):
        warnings.warn(f"{file}: {excess.place}: {excess.text}", PinfricWarning, stacklevel=2)
    guesses = {} if entries.assumed is None else entries.assumed.values
    if entries.assumed is not None:
        warnings.warn(f"{file}: {guesses_line(entries.assumed)}", PinfricWarning, stacklevel=2)
    return Scene(
        model=robot.model,
        friction=friction,
        actuators=_drives(entries, robot),
        payloads=entries.robot.payloads,
        stick_velocity=entries.stick.velocity,
        robot=robot,
        simulation=entries.simulation,
        source=str(file),
        loops=_with_urdf_loops(entries, robot, str(file)),
        loop_tolerance=entries.loop_tolerance,
        redundancy_length=entries.redundancy.length,
        tool=entries.tool,
        # a guess may not make drives lighter: `size` asks
        masses=None if "robot.masses" in guesses else entries.robot.masses,
        masses_confirmed=entries.robot.masses_confirmed,
        assumed=entries.assumed,
        measured=entries.measured,
        stops=entries.stops,
        sized=entries.sized,
        springs=entries.springs,
        feet=entries.feet,
    )


def _drives(entries: SceneFile, robot: Robot) -> list[Actuator] | None:
    """The file's; without any, if the base is let free: one on each joint with an axis."""
    if entries.actuators is not None or not robot.floating:
        return entries.actuators
    joints = list(zip(robot.model.names, robot.model.joints, strict=True))[1:]  # not the ground
    return [Actuator(joint=name) for name, joint in joints if joint.nv == 1]


def guesses_line(assumed: Assumed) -> str:
    """Return how many entries of a scene are guesses, and of what."""
    places: dict[str, list[str]] = {}
    for place in assumed.values:
        entry, _, key = place.rpartition(".")
        places.setdefault(entry, []).append(key)
    robots = [entry for entry in places if entry.startswith("robot")]
    whole = [f"{entry}.{key}" for entry in robots for key in places.pop(entry)]
    count = Counter(", ".join(keys) for keys in places.values())
    of = "; ".join(
        [*whole, *(f"{keys} of {counted(number, 'joint')}" for keys, number in count.items())]
    )
    return (
        f"{len(assumed.values)} entries are guesses of `{assumed.by}` ({of}); `assumed` lists "
        "them: replace them by data sheets or by what you identify"
    )


def bundled_folder() -> Path:
    """Return the folder of the scenes that are part of pinfric."""
    installed = Path(__file__).parents[1] / "robots"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "robots"


def measured_scenes() -> dict[str, Measured]:
    """Return where the friction of bundled robots was measured, by the scenes' names.

    A scene that repeats the measurement of another is left out.
    """
    scenes: dict[str, Measured] = {}
    for file in sorted(bundled_folder().glob("*.yaml")):
        content = read_yaml(file, SceneError) if file.name.count(".") == 1 else {}
        if measured := content.get("measured"):
            record = parse(Measured, measured, str(file), at=("measured",))
            if record not in scenes.values():
                scenes[file.stem] = record
    return scenes


def find_file(path: str | Path, suffixes: tuple[str, ...], error: type[PinfricError]) -> Path:
    """Return `path` if it is a file, else the bundled file of that name (suffix optional)."""
    if not str(path):  # as a path it would be the current folder
        raise error(f"the name of the {error.__name__.removesuffix('Error').lower()} is empty")
    path = path_of(path, error)
    if path.name.encode(errors="replace") != os.fsencode(path.name):  # titles show it
        raise error(f"{path}: its name is not in UTF-8; rename it")
    try:
        if path.exists() and not path.is_dir():  # also a pipe: <(...)
            return path
    except (OSError, ValueError) as problem:  # a name too long, or with a NUL
        raise error(f"{str(path)[:80]!r}: cannot be a file: {problem.args[-1]}") from None
    folder = bundled_folder()
    bundled = path.parent in (Path("."), Path("robots"))  # other paths never mean a bundled file
    for candidate in (path.name, *(path.name + suffix for suffix in suffixes)):
        if bundled and os.path.isfile(folder / candidate):
            return folder / candidate
    there: list[str] = []
    for place in dict.fromkeys((path.parent, folder)):
        with suppress(OSError):  # no folder, or one that may not be read: nothing to suggest
            beside = [p.name for p in place.iterdir()]
            there += sorted(n for n in beside if n[n.find(".") :] in suffixes and n not in there)
    if path.is_dir():
        raise error(f"{path} is a folder; give a file: {', '.join(suffixes)}")
    if path.is_symlink():
        raise error(f"{path}: its link leads to no file ({os.readlink(path)})")
    stem = path.name.partition(".")[0]
    same = [name for name in there if name.partition(".")[0] == stem]
    meant = f"did you mean {same[0]!r}?" if same else choose_from(path.name, there)
    raise error(f"there is no file {path}, and no bundled one of that name; {meant}")


def _with_urdf_loops(entries: SceneFile, robot: Robot, where: str) -> list[Loop]:
    """The loops of the robot's file that the scene does not replace or ignore, and its own."""
    if entries.robot.urdf_loops == "ignore":
        return entries.loops
    own = {loop.name for loop in entries.loops}
    kept = [loop for loop in robot.closures.loops if loop.name not in own]
    for there in kept:
        for loop in entries.loops:
            if _same_place(there, loop):
                raise SceneError(
                    f"{where}: loops: {loop.name!r} closes what the robot's file closes by "
                    f"{there.name!r}: call it so, leave it out, or write robot.urdf_loops: ignore"
                )
    return [*kept, *entries.loops]


def _same_place(one: Loop, other: Loop) -> bool:
    """Whether two loops join the same links, and at the same place of one of them."""

    def at(frame: LinkFrame) -> tuple[str, tuple[float, ...]]:
        return frame.link, tuple(round(x, _PLACE) for x in frame.xyz)

    ends = [{at(loop.a), at(loop.b)} for loop in (one, other)]
    links = [{loop.a.link, loop.b.link} for loop in (one, other)]
    return links[0] == links[1] and bool(ends[0] & ends[1])


def _with_urdf_dynamics(entries: SceneFile, robot: Robot, where: str) -> dict[str, Friction]:
    """The file's friction, completed from `<dynamics>` if the scene asks for it."""
    friction = dict(entries.friction)
    movable = set(tuple(robot.model.names)[1:])
    stated = {n: d for n, d in robot.dynamics.items() if n in movable and any(d)}
    if not stated:
        return friction
    if entries.robot.urdf_dynamics == "ignore":
        if "urdf_dynamics" in entries.robot.model_fields_set:
            return friction  # as the scene demands
        more = f" and {len(stated) - 4} more" if len(stated) > 4 else ""
        warnings.warn(
            f"{where}: the {robot.dynamics_words} for {', '.join(list(stated)[:4])}{more}; "
            "ignored (many URDFs have placeholders); robot.urdf_dynamics: use takes them, ignore "
            "silences this",
            PinfricWarning,
            stacklevel=3,
        )
        return friction
    for name, dynamics in stated.items():
        entry = friction.get(name, Friction())
        update: dict[str, Any] = {}
        if entry.coulomb is None and dynamics.friction > 0:
            update["coulomb"] = constant_friction(dynamics.friction)
        if "viscous" not in entry.model_fields_set and dynamics.damping > 0:
            update["viscous"] = linear_drag(dynamics.damping)
        if update or name in friction:
            friction[name] = entry.model_copy(update=update)
        column = robot.model.joints[robot.model.getJointId(name)].idx_v
        robot.model.armature[column] += dynamics.armature
    return friction
