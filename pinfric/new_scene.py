"""A starting scene for a user's URDF: every joint is listed, with its friction guessed and marked.

Guesses follow from each joint's load: bearings from its effort limit (if missing or a placeholder,
from the weight that it carries), friction from the lesser of the two.
"""

from __future__ import annotations

import datetime
import json
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric import __version__
from pinfric.checking.estimated_masses import estimated_masses
from pinfric.checking.joint_loads import JointLoad, held_out_level, joint_loads, two_digits
from pinfric.checking.robot import RobotFacts
from pinfric.checking.robot_masses import believed_weight
from pinfric.dynamics.inverse.standing import stand
from pinfric.errors import PinfricError, PinfricWarning, RobotError, choose_from
from pinfric.formats import json_schema
from pinfric.model.closure import closed_configurations, driving_joints
from pinfric.model.files import file_hash, write_folder
from pinfric.model.floating import free_joint, stands
from pinfric.model.legs import legs_of
from pinfric.model.massless import massless_joints
from pinfric.model.robot import Robot, link_frame, locator, read_robot, robot_text, urdf_file
from pinfric.model.scene import Scene
from pinfric.model.schema import Payload
from pinfric.model.urdf import UrdfDynamics
from pinfric.model.yamlfile import yaml_line
from pinfric.motions.followers import Follower, find_followers
from pinfric.motions.joint_columns import (
    JointColumn,
    joint_columns,
    single_positions,
    stated_range,
)
from pinfric.motions.rating import rate
from pinfric.motions.standing_pose import Pose, standing_pose
from pinfric.motions.trajectory import Trajectory, load_trajectory

#: Shear stress (Pa) that sizes a shaft for its torque, and its bearings' diameter over its own.
_SHEAR, _BEARING_OVER_SHAFT = 20e6, 1.5
#: The first move lasts no longer (s).
_LONGEST = 10.0
#: Coulomb friction of strain wave and planetary gears, bearings and seals as part of what the joint
#: must stand, and viscous friction at the velocity limit. Identified on a UR10e (Innopolis
#: University): 3.3 to 5 %, and 13 to 22 %.
_COULOMB, _VISCOUS = 0.05, 0.2
#: Coulomb friction as part of the effort limit by the kind of drive, and on what that was measured:
#: UR5e, UR10e, FR3; KR 300 R2700; Go2 (5 actuators, no gear or one stage); SO-101 (stall torque).
DRIVES = {
    "strain_wave": (0.04, "strain wave gear", "UR5e, UR10e, FR3: 1.3 to 6.4 %"),
    "cycloidal": (0.022, "cycloidal gear", "KR 300: 1.7 to 2.7 %"),
    "direct": (0.01, "no gear or one stage", "Go2: 0.7 to 1.6 %"),
    "servo": (0.15, "hobby servo", "SO-101: 8 to 21 % of the stall torque"),
}
#: Static over kinetic friction; a joint's fastest turn or slide where the URDF does not say (rad/s,
#: m/s).
_STATIC, _FASTEST, _FASTEST_SLIDING = 1.2, 3.0, 1.0
#: Rolling bearings: mu of catalogues (SKF 0.0015-0.0030) and, at rest, 1.5 times that.
_MU = {"static": 0.003, "kinetic": 0.002}


@dataclass(frozen=True)
class Closed:
    """A robot whose file closes loops: its scene, a closed configuration (nq,), joints to drive."""

    scene: Scene
    q: np.ndarray
    driven: tuple[str, ...]


@dataclass(frozen=True)
class Begun:
    """A robot for which a scene is begun.

    Attributes:
        urdf: the file. robot, facts: as read and measured.
        masses: link -> its estimated inertia; empty where the URDF has masses.
        mass: their sum, kg; 0 where none was given.
        by: what it is shared by.
        drive: kind of all drives, of `DRIVES`; None: unknown.
        pose: on its feet, of a robot whose base floats; None: it is fixed, or has no legs.
    """

    urdf: Path
    robot: Robot
    facts: RobotFacts
    masses: Mapping[str, pin.Inertia]
    mass: float
    by: str
    drive: str | None
    pose: Pose | None = None

    @classmethod
    def read(
        cls,
        urdf: str | Path,
        drive: str | None = None,
        mass: float | None = None,
        xacro_args: Mapping[str, str] | None = None,
        floating: bool = False,
    ) -> Begun:
        """Read a robot, and estimate its masses if `mass` is given.

        Args:
            urdf: the file, or `example-robot-data:<path below its robots folder>`.
            drive: kind of all drives, see `DRIVES`.
            mass: of a robot whose URDF has none, kg, with its drives, as its maker prints it.
            xacro_args: of a robot that is xacro.
            floating: whether its base is to float; it does if the file says so.

        Raises:
            RobotError: the URDF cannot be read, or describes something that cannot exist; a mass
                that is not positive, or of a robot that has its own; a base that is to float on no
                legs.
        """
        urdf = urdf_file(urdf)
        if drive is not None and drive not in DRIVES:
            raise RobotError(f"drive {drive!r}: {choose_from(drive, list(DRIVES))}")
        robot = read_robot(urdf, {}, xacro_args)
        if floating and not free_joint(robot.model):
            robot = read_robot(urdf, {}, xacro_args, True)
        facts = RobotFacts.of(urdf, xacro_args, robot.floating)
        if mass is None:
            stands = floating or (bool(free_joint(robot.model)) and len(legs_of(robot.model)) > 1)
            pose = standing_pose(robot) if stands else None
            return cls(urdf, robot, facts, {}, 0.0, "", drive, pose)
        if floating:
            raise RobotError("--mass is of arms: a robot that stands needs masses in its URDF")
        if not 0 < mass < math.inf:
            raise RobotError(f"mass {mass:g} kg: give what the robot weighs, above 0")
        masses, by = estimated_masses(facts, mass)
        model = robot.model.copy()
        for link, body in masses.items():
            frame = model.frames[link_frame(model, link)]
            model.appendBodyToJoint(frame.parentJoint, body, frame.placement)
        return cls(urdf, replace(robot, model=model), facts, masses, mass, by, drive)

    @property
    def name(self) -> str:
        """Of its files; of arm.urdf.xacro "arm"."""
        return self.urdf.stem.removesuffix(".urdf")

    @property
    def posture(self) -> tuple[str, Mapping[str, float]]:
        """Where the robot begins: in words, and the position (rad or m) by joint; zeros are left
        out.

        That is an MJCF's first keyframe. Else, with loops, joints whose ranges do not hold 0 begin
        in the middle.
        """
        for name, positions in self.robot.keyframes.items():
            return f"keyframe {yaml_line(name)}", positions
        if not self.robot.closures.loops:
            return "", {}
        model = self.robot.model
        ranges = {
            name: stated_range(
                float(model.lowerPositionLimit[joint.idx_q]),
                float(model.upperPositionLimit[joint.idx_q]),
            )
            for name, joint in zip(model.names, model.joints, strict=True)
            if joint.nq == joint.nv == 1
        }
        middles = {n: round(0.5 * (a + b), 4) for n, (a, b) in ranges.items() if a * b > 0.0}
        return "the middle of ranges that do not hold 0", middles

    @cached_property
    def closed(self) -> Closed | None:
        """How the loops of its file close; None without loops.

        Raises:
            SceneError: they cannot close.
        """
        if not (loops := self.robot.closures.loops):
            return None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PinfricWarning)  # said where the scene is loaded
            start, of = self.posture[1], str(self.urdf)
            scene = Scene(self.robot.model, robot=self.robot, loops=loops, source=of, start=start)
        twin, linkage = scene.twin(), scene.linkage
        assert linkage is not None
        near = scene.start_configuration
        q = closed_configurations(twin, linkage, near, scene.source, {}, wanted=1)[0]
        driven = driving_joints(twin, linkage, q)  # a free body has six velocities and no drive
        return Closed(scene, q, tuple(x for x in driven if x in self.robot.model.names))

    @property
    def weight(self) -> float | None:
        """Torque (N m) that holds the robot stretched out level; None where its masses are
        doubtful.
        """
        if self.masses:
            return held_out_level(self.mass, self.facts.reach, self.robot.model)
        return believed_weight(self.facts, self.robot.model)


def new_scene(
    begun: Begun, folder: str | Path | None = None, payloads: Mapping[str, Payload] | None = None
) -> str:
    """Return a scene for a robot as commented YAML that loads and runs as it is.

    A turning joint gets two bearings on a shaft that carries its torque T at a shear stress of 20
    MPa, d = (16 T/(pi 20 MPa))^(1/3); a sliding joint a guide half as long as its travel. Dry
    friction is a share of the joint's effort limit by the kind of drive (`DRIVES`); without a kind,
    5 % of the lesser of this limit and three times the weight that the joint carries. Viscous
    friction is 20 % of the lesser at the velocity limit, as identified on a UR10e. Limits that are
    placeholders (`limit_remarks`) are ignored. Each guess has its reason beside it and in
    `assumed`. Whether the links hold the drives is asked, not guessed.

    Args:
        begun: the robot.
        folder: where the scene will be saved; the URDF is named relative to it. None: in full.
        payloads: that it is rated for, by name; None: an example in a comment.
    """
    urdf, robot = begun.urdf, begun.robot
    joints = joint_loads(robot.model, begun.weight)
    massless = massless_joints(Scene(robot.model, robot=robot))
    guesses = {
        joint.name: _guesses(joint, begun.drive)
        for joint in joints
        if joint.degrees == 1 and (joint.leader or joint.name) not in massless
    }
    closed = begun.closed
    if closed is not None:  # what no drive moves has neither gear nor motor
        guesses = {
            name: guessed
            if name in closed.driven
            else {key: guessed[key] for key in ("bearing", "mu")}
            for name, guessed in guesses.items()
        }
    rejected = [joint for joint in joints if joint.remark]
    mass = sum(inertia.mass for inertia in tuple(robot.model.inertias)[1:])  # 0 is the ground
    bodies = [frame.name for frame in robot.model.frames if frame.type == pin.FrameType.BODY]
    named = locator(urdf, folder) if not begun.masses else f"{begun.name}.masses.urdf"
    commands = [f"pinfric new {locator(urdf, folder)}"]
    commands += [f"--xacro-arg {name}:={value}" for name, value in robot.xacro_args.items()]
    commands += ["--floating"] * bool(robot.floating)
    commands += [f"--drive {begun.drive}"] * (begun.drive is not None)
    commands += [f"--mass {begun.mass:g}"] * bool(begun.masses)
    parts = [
        f"# A starting scene for {urdf.name} ({robot.model.njoints - 1} joints, {mass:.4g} kg that "
        "move), made by `pinfric new`.\n"
        "# Lines marked `guess` are not measured: replace them with values from the data sheets of "
        "your bearings\n"
        "# and gears, or from `pinfric identify`. `pinfric explain` shows what each one changes.",
        *(
            [
                f"# {len(rejected)} of {len(joints)} effort limits are not believed; of "
                f"{rejected[0].name}: {rejected[0].remark}"
            ]
            if rejected
            else []
        ),
        "pinfric: 1",
        "robot:",
        f"  {'urdf' if begun.masses else robot.key}: {yaml_line(named)}"
        + f"  # guess: {_mass_guess(begun)}" * bool(begun.masses),
        *_xacro_section(robot.xacro_args if not begun.masses else {}),
        *["  floating: true               # a joint root_joint, which nothing drives"]
        * bool(robot.floating),
        f"  gravity: {robot.gravity or [0.0, 0.0, -9.81]}",
        *_dynamics_section(robot),
        *_masses_section(begun),
        *_payload_section(payloads, bodies[-1]),
        "friction:" if guesses else "friction: {}",
        *[line for j in joints for line in _joint_section(j, guesses, robot.dynamics)],
        *(_loops_section(robot.model) if closed is None else _file_loops_section(closed)),
        *_actuators_section(robot, closed),
        *_feet_section(begun.pose),
        # what `pinfric simulate` runs
        *(
            [
                "simulation:                    # pinfric simulate: the robot without power for "
                "1 s\n  t_end: 1.0",
                *_start_section(begun),
            ]
            if guesses or any(joint.degrees > 1 for joint in joints)
            else [
                "# simulation: not possible, because nothing moves a mass; give links an <inertial>"
            ]
        ),
    ]
    # the guesses as data, so that every report can list them
    values = {
        f"friction.{name}.{key}": why
        for name, guessed in guesses.items()
        for key, (_, why) in guessed.items()
    }
    if begun.masses:
        values = {"robot.urdf": _mass_guess(begun), **values}
    if values:
        parts += [
            "assumed:                       # delete the line of each guess that you replace",
            f"  by: {yaml_line(' '.join(commands))}",
            f"  date: '{datetime.date.today().isoformat()}'",
            f"  version: {yaml_line(__version__)}",
            f"  inputs: {{{yaml_line(urdf.name, within=True)}: {file_hash(urdf)}}}",
            "  values:",
            *[f"    {yaml_line(place)}: {yaml_line(why)}" for place, why in values.items()],
        ]
    return "\n".join(parts) + "\n"


def new_waypoints(begun: Begun) -> str:
    """Return a way-point file for the robot: a small move of every joint, a hold, and back.

    Raises:
        TrajectoryError: planar or floating joints, which files cannot describe.
    """
    robot = begun.robot
    if begun.pose is not None:
        return _squat(begun.pose, begun.urdf.name)
    columns = joint_columns(robot.model, str(begun.urdf))
    followers = find_followers(SimpleNamespace(robot=robot, model=robot.model), columns)
    columns = tuple(_followed(column, followers) for column in columns)
    posed = begun.posture[1]
    start = [
        _rounded(min(max(posed[c.name], c.lower), c.upper), c) if c.name in posed else _start(c)
        for c in columns
    ]
    if (closed := begun.closed) is not None:  # the loops move the other joints
        q = single_positions(closed.q[None], [column.nq for column in columns])[0]
        moved = [i for i, column in enumerate(columns) if column.name in closed.driven]
        columns = tuple(columns[i] for i in moved)
        at = [min(max(float(q[i]), c.lower), c.upper) for i, c in zip(moved, columns, strict=True)]
        start = [_rounded(x, column) for x, column in zip(at, columns, strict=True)]
    end = [_end(column, at) for column, at in zip(columns, start, strict=True)]
    names = ", ".join(yaml_line(column.name, within=True) for column in columns)
    there, back, name = _numbers(end), _numbers(start), begun.urdf.name
    # at most 0.3 of every velocity limit (quintic: peak 15/8)
    needed = [
        1.875 * abs(b - a) / (0.3 * c.velocity_limit)
        for c, a, b in zip(columns, start, end, strict=True)
        if math.isfinite(c.velocity_limit) and c.velocity_limit > 0
    ]
    time = f"{max(1.0, math.ceil(10.0 * max(needed, default=0.0)) / 10.0):g}"
    return f"""# A first motion for {name}: each joint moves a little, holds, and returns.
# Made by `pinfric new`; positions in rad and m, times in s.
pinfric_trajectory: 1
profile: quintic
sample_rate: 250
joints: [{names}]
points:
  - {{name: start, q: {back}, hold: 0.3}}
  - {{name: there, q: {there}, duration: {time}, hold: 0.5}}
  - {{name: start, q: {back}, duration: {time}, hold: 0.3}}
"""


def _squat(pose: Pose, name: str) -> str:
    """Return way-points of a stand, a squat if the legs reach one, and back; the feet stay."""
    names = ", ".join(yaml_line(column.name, within=True) for column in pose.columns)
    free = [x for x, column in zip(pose.position, pose.columns, strict=True) if column.free]
    up, down = ([*map(float, free[:2]), z] for z in (float(free[2]), pose.lowered))
    there = f"""  - {{name: squat, base: {{xyz: {_numbers(down)}}}, duration: 1.5, hold: 0.5}}
  - {{name: stand, base: {{xyz: {_numbers(up)}}}, duration: 1.5, hold: 0.3}}
"""
    squats = "squats, and stands up again"
    if pose.lowered >= free[2]:
        there, squats = "", "and its legs reach no squat within their limits"
    return f"""# A first motion for {name}: it stands ({pose.by}), {squats}.
# Made by `pinfric new`; positions in rad and m, times in s. The scene's `feet` stay where they are.
pinfric_trajectory: 1
profile: quintic
sample_rate: 50
joints: [{names}]
points:
  - {{name: stand, q: {_numbers(pose.position.tolist())}, hold: 0.3}}
{there}"""


def new_rating(
    begun: Begun, payload: float, link: str | None = None
) -> tuple[dict[str, Payload], str]:
    """Return a rated payload, where it is carried, and a way-point file that holds and lifts it.

    Args:
        begun: the robot.
        payload: kg.
        link: that carries it; None: the last one.

    Raises:
        TrajectoryError: see `rate`.
    """
    loops = begun.robot.closures.loops
    scene = Scene(begun.robot.model, robot=begun.robot, source=str(begun.urdf), loops=loops)
    rated = rate(scene, {"payload": payload, **({} if link is None else {"link": link})})
    return dict(rated.scene.payloads), (
        f"# What {begun.urdf.name} is rated for, as a motion: {payload:g} kg, held in the worst "
        "posture of each joint and lifted\n"
        "# from there by it alone, against gravity. `pinfric size --rating` takes each joint's "
        "means over its own part.\n"
        f"# Made by `pinfric new`; positions in rad and m, times in s.\n{rated.waypoints()}"
    )


def write_new(
    urdf: str | Path,
    folder: str | Path = ".",
    payload: float | None = None,
    link: str | None = None,
    **given: Any,
) -> list[Path]:
    """Write NAME.yaml and NAME.waypoints.yaml for a URDF, never over other files.

    Also the JSON schemas of both, which their first lines name for editors; with a payload
    NAME.rating.waypoints.yaml, with a mass NAME.masses.urdf.

    Args:
        urdf: see `Begun.read`; NAME is its name without suffix.
        folder: where to; made if missing.
        payload, link: see `new_rating`.
        **given: drive, mass, xacro_args, floating of `Begun.read`.

    Raises:
        RobotError: see `Begun.read`.
        PinfricError: a file exists already with other content, or cannot be written.
    """
    begun = Begun.read(urdf, **given)
    folder, name = Path(folder), begun.name
    load, rating = (None, "") if payload is None else new_rating(begun, payload, link)
    contents = {f"{name}.yaml": _checked("scene", new_scene(begun, folder, load))}
    try:
        contents[f"{name}.waypoints.yaml"] = _checked("waypoints", new_waypoints(begun))
    except RobotError:
        raise
    except PinfricError:
        pass  # a floating joint: motions are made in Python
    if rating:
        contents[f"{name}.rating.waypoints.yaml"] = _checked("waypoints", rating)
    if begun.masses:
        contents[f"{name}.masses.urdf"] = robot_text(begun.robot, begun.masses)
    for path, text in ((folder / file, text) for file, text in contents.items()):
        # a killed run leaves some of these
        if path.exists() and not (path.is_file() and path.read_bytes() == text.encode()):
            raise PinfricError(f"{path}: exists already; name another folder (--out)")
    schemas = {
        f"{kind}.schema.json": json.dumps(json_schema(kind), indent=1) + "\n"
        for kind in ("scene", "waypoints")
    }
    write_folder(folder, schemas | contents)
    return [folder / file for file in contents]


def first_command(scene: Scene, files: Sequence[Path]) -> tuple[str, list[Path]]:
    """Return a command that runs with the files of `write_new`, and the motion that it takes.

    `scene` is that of the first file.

    Mechanisms of many joints may not follow their first motion; without one, `explain` tries
    states at random, in which loops would not close.
    """
    motion = [file for file in files if file.name.endswith(".waypoints.yaml")][:1]
    if stands(scene) and motion and not _stands_still(scene, motion[0]):
        return "check", []
    if not scene.loops:
        without = "check" if stands(scene) else "explain"  # no forces hold a base that floats
        return ("inverse" if motion else without), motion
    try:
        for file in motion:
            load_trajectory(file, scene)
            return "inverse", motion
    except PinfricError:
        pass
    return "check", []


def _stands_still(scene: Scene, motion: Path) -> bool:
    """Whether forces within friction balance a robot at the first sample of its motion."""
    try:
        moved = load_trajectory(motion, scene)
        t, q, v, a = (x[:1] for x in (moved.t, moved.q, moved.v, moved.a))
        stand(scene, Trajectory.from_arrays(scene, t, q, v, a))
    except PinfricError:
        return False
    return True


def _checked(kind: str, text: str) -> str:
    """Prepend the line that names the schema by which editors check and complete the file."""
    return f"# yaml-language-server: $schema={kind}.schema.json\n{text}"


def _mass_guess(begun: Begun) -> str:
    return f"{begun.mass:g} kg, shared by {begun.by}; {begun.urdf.name} has no mass"


def _xacro_section(arguments: Mapping[str, str]) -> list[str]:
    return [f"  xacro_args: {yaml_line(dict(arguments))}"] if arguments else []


def _masses_section(begun: Begun) -> list[str]:
    """State that links hold their drives if a maker's mass was given; else ask."""
    if begun.masses:
        return ["  masses: with_drives         # a robot's printed mass holds motors and gears"]
    return [
        "  # masses: with_drives        # do the links hold motors and gears? Nothing in a URDF "
        "tells it:\n"
        "  # masses: without_drives     # write one. Until then `size` tries both and takes the "
        "heavier drives"
    ]


def _payload_section(payloads: Mapping[str, Payload] | None, link: str) -> list[str]:
    if payloads is None:
        return [
            "  # payloads:                  # what it carries; com in the link's frame",
            f"  #   box: {{link: {yaml_line(link, within=True)}, mass: 1.0, com: [0, 0, 0.05], "
            "attached: false}",
        ]
    lines = ["  payloads:                    # what it carries; com in the link's frame"]
    for name, payload in payloads.items():
        carrier, com = yaml_line(payload.link, within=True), ", ".join(map(_short, payload.com))
        off = ", attached: false" * (not payload.attached)
        where = "as far across the last axis" if off else "along z of its link"
        lines.append(
            f"    {name}: {{link: {carrier}, mass: {payload.mass:g}, com: [{com}]{off}}}"
            f"  # the rating: {where}"
        )
    return lines


def _joint_section(
    joint: JointLoad,
    guesses: Mapping[str, dict[str, tuple[str, str]]],
    dynamics: Mapping[str, UrdfDynamics],
) -> list[str]:
    name = yaml_line(joint.name)
    if joint.degrees > 1:
        return [f"  # {name}: {joint.degrees} degrees of freedom; friction needs one axis"]
    if joint.name not in guesses:
        return [f"  # {name}: moves no mass; its friction would have no load, and none is guessed"]
    position = "m" if joint.sliding else "rad"
    if joint.leader is not None:
        about = f"follows {yaml_line(joint.leader)}: has bearings, but no drive"
    elif math.isfinite(joint.upper):
        about = f"{joint.lower:.4g} to {joint.upper:.4g} {position}"
    else:
        about = "no limits"
    about += f"; {joint.remark}" if joint.remark else ""
    own_dynamics = dynamics.get(joint.name, UrdfDynamics(0.0, 0.0))
    stated = {"coulomb": own_dynamics.friction, "viscous": own_dynamics.damping}
    lines = [f"  {name}:  # {'slides' if joint.sliding else 'turns'}, {about}"]
    for key, (value, why) in guesses[joint.name].items():
        urdf = f"; <dynamics>: {stated[key]:g}" if stated.get(key) else ""
        lines.append(f"    {key}: {value}  # guess: {why}{urdf}")
    if joint.leader is None and "coulomb" in guesses[joint.name]:
        lines.append("    includes_drive: true  # `size` replaces both by its candidates' losses")
    return lines


def _guesses(joint: JointLoad, drive: str | None) -> dict[str, tuple[str, str]]:
    """Return each key of a joint's friction with its guess and the reason."""
    dry, measured = _COULOMB * joint.least, "measured robots: 0.2 to 6.5 %"
    unit, rate = ("N", "m/s") if joint.sliding else ("N m", "rad/s")
    speed, at = joint.fastest, "its velocity limit"
    if not speed:
        speed, at = (_FASTEST_SLIDING if joint.sliding else _FASTEST), "a usual velocity"
    least = f"{joint.least:.3g} {unit}"
    share = f"{100 * _COULOMB:g} % of {joint.why_least if joint.least < joint.load else least}"
    if drive is not None:
        fraction, called, measured = DRIVES[drive]
        dry, share = fraction * joint.load, f"{called}, {100 * fraction:g} % of {joint.why}"
    if joint.sliding:
        travel = joint.upper - joint.lower
        length = min(max(0.5 * travel, 0.02), 0.3) if math.isfinite(travel) else 0.1
        size = _short(length)
        bearing = (
            f"{{kind: guide, length: {size}, width: {size}}}",
            "half its travel" if length == 0.5 * travel else "a usual size",
        )
    else:
        shaft = (16.0 * joint.load / (math.pi * _SHEAR)) ** (1.0 / 3.0)
        radius = max(0.5 * _BEARING_OVER_SHAFT * shaft, 1e-3)
        r, width = _short(radius), _short(2.0 * radius)
        bearing = (
            f"{{kind: pin, radius: {r}, length: {width}, thrust_radius: {r}}}",
            f"{two_digits(1e3 * shaft)} mm shaft for {joint.why}",
        )
    return {
        "bearing": bearing,
        "mu": (
            f"{{static: {_MU['static']}, kinetic: {_MU['kinetic']}}}",
            "rolling bearings (plain bushings: 0.1 to 0.2)",
        ),
        "coulomb": (
            f"{{static: {_short(_STATIC * dry)}, kinetic: {_short(dry)}}}",
            f"gear and seals, {share}; {measured}",
        ),
        "viscous": (
            _short(_VISCOUS * joint.least / speed),
            f"{100 * _VISCOUS:g} % of {least} at {at}, {speed:.3g} {rate}",
        ),
    }


def _dynamics_section(robot: Robot) -> list[str]:
    movable = set(list(robot.model.names)[1:])
    stated = [n for n, d in robot.dynamics.items() if n in movable and any(d)]
    if not stated:
        return []
    shown = stated[0] + (f" and {len(stated) - 1} more" if len(stated) > 1 else "")
    return [
        f"  # The {robot.dynamics_words}, of {shown}; many are placeholders.",
        "  urdf_dynamics: ignore        # `use`: use them if this file gives no value",
    ]


def _loops_section(model: pin.Model) -> list[str]:
    """Show how two ends of a plane tree close a loop, which a URDF cannot say."""
    ends = sorted(set(range(1, model.njoints)) - set(model.parents))
    turns = pin.computeJointJacobians(model, model.createData(), pin.neutral(model))[3:]
    if len(ends) < 2 or np.linalg.matrix_rank(turns, tol=1e-6) > 1:
        return []
    bodies = {f.parentJoint: f.name for f in model.frames if f.type == pin.FrameType.BODY}
    sides = ", ".join(
        f"{side}: {{link: {yaml_line(bodies[end], within=True)}, xyz: [0.1, 0, 0]}}"
        for side, end in zip("ab", ends, strict=False)
    )
    return [
        "# loops:                       # a URDF has no loops: a pin that two ends share",
        f"#   - {{name: C, kind: planar_pin, {sides}}}",
        "#                              # then name the driven joints under `actuators`, and take",
        "#                              # `includes_drive`, `coulomb`, `viscous` from all others",
    ]


def _start_section(begun: Begun) -> list[str]:
    """Begin in the robot's posture."""
    why, positions = begun.posture
    if not positions:
        return []
    start = yaml_line({"q": dict(positions)})
    return [f"  start: {start}  # {why}"]


def _file_loops_section(closed: Closed) -> list[str]:
    """Say which loops the file closes, and near which start."""
    names = ", ".join(yaml_line(loop.name) for loop in closed.scene.loops)
    return [
        f"# loops:                       # those of the robot's file are closed: {names}",
        "#                              # one given here replaces that of its name",
    ]


def _feet_section(pose: Pose | None) -> list[str]:
    if pose is None:
        return []
    lines = ["feet:                          # where it stands; mu of the ground"]
    for name, foot in pose.feet.items():
        size = f", length: {foot.length:g}, width: {foot.width:g}" if foot.length else ""
        guess = "; a usual sole, with the origin of its link in the middle" if foot.length else ""
        if any(foot.xyz):
            size += f", xyz: {_numbers(list(foot.xyz))}"
            guess = f"; {'its sole' if foot.length else 'its end'}, by its collision shapes"
        lines.append(
            f"  {yaml_line(name)}: {{mu: {foot.mu:g}{size}}}  # guess: rubber on floor{guess}"
        )
    return lines


def _actuators_section(robot: Robot, closed: Closed | None) -> list[str]:
    """List the drives with the URDF's ratios; a comment if it gives none and all joints have one.

    `closed`: of a mechanism, which loops close.
    """
    single = [name for name, nv in zip(robot.model.names, robot.model.nvs, strict=True) if nv == 1]
    names, of, ratio = list(Scene(robot.model, robot=robot).actuator_names), "", "  # the URDF"
    if closed is not None:
        of = "guess: the loops leave so many free; drive others if others have motors"
        names, ratio = list(closed.driven), ""
    elif free_joint(robot.model) and single:
        of = "of all joints but the base"
        names, ratio = [name for name in names if name in single], ""
    elif not robot.gears.keys() & set(single):
        return [
            "# actuators:                   # without this section: one ideal drive per joint",
            f"#   - joint: {yaml_line(single[0] if single else robot.model.names[1])}",
            "#     transmission: {ratio: 100, efficiency: 0.85, back_efficiency: 0.82, "
            "rotor_inertia: 1.0e-5}",
        ]
    lines = [f"actuators:                     # {of}"]
    if not of:
        lines = [
            "actuators:                     # ratios are from the URDF's <transmission>, which has "
            "no",
            "  # losses and no rotors: add efficiency, back_efficiency, rotor_inertia (data sheet)",
        ]
    for name in names:
        geared = name in single and name in robot.gears
        gear = f", transmission: {{ratio: {_short(robot.gears[name], 12)}}}" if geared else ""
        lines.append(f"  - {{joint: {yaml_line(name, within=True)}{gear}}}{ratio if gear else ''}")
    return lines


def _followed(column: JointColumn, followers: Sequence[Follower]) -> JointColumn:
    """Narrow a column's range until its followers stay within their limits, too."""
    lower, upper = column.lower, column.upper
    for follower in followers:
        if follower.leader == column and follower.ratio != 0.0:
            limits = follower.column.lower, follower.column.upper
            ends = sorted((end - follower.shift) / follower.ratio for end in limits)
            lower, upper = max(lower, ends[0]), min(upper, ends[1])
    return replace(column, lower=lower, upper=upper) if lower <= upper else column


def _start(column: JointColumn) -> float:
    if column.lower < 0 < column.upper or not math.isfinite(column.lower + column.upper):
        return min(max(0.0, column.lower), column.upper)
    return _rounded(0.5 * (column.lower + column.upper), column)


def _end(column: JointColumn, start: float) -> float:
    """Return a position a fifth of the range away, towards the farther limit; at most 0.4 rad or
    0.05 m.

    Less for a joint so slow that the move would last longer than `_LONGEST`.
    """
    most = 0.05 if column.unit == "m" else 0.4
    if math.isfinite(column.velocity_limit) and column.velocity_limit > 0:
        most = min(most, _LONGEST * 0.3 * column.velocity_limit / 1.875)
    up, down = column.upper - start, start - column.lower
    step = min(most, 0.2 * min(max(up, down), 1e6))
    return _rounded(start + (step if up >= down else -step), column)


def _rounded(position: float, column: JointColumn) -> float:
    """Round to 4 decimals; to more where the range is narrow or the joint slow."""
    size = min(column.upper - column.lower, column.velocity_limit, 1.0)
    return round(position, 4 if size >= 0.01 else 4 - math.floor(math.log10(max(size, 1e-12))))


def _short(x: float, digits: int = 2) -> str:
    number = float(f"{x:.{digits}g}")
    return yaml_line(int(number) if number.is_integer() else number)


def _numbers(values: list[float]) -> str:
    return f"[{', '.join(_short(value, 12) for value in values)}]"
