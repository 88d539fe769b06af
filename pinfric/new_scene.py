"""A starting scene for a user's URDF: every joint listed, its friction guessed and marked so.

The guesses are meant to be replaced. They are sized by the load of each joint according to the
URDF: bearings by its effort limit or, if that is missing or a placeholder, by the weight that it
carries, friction by the lesser of the two.
"""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pinocchio as pin

from pinfric import __version__
from pinfric.checking.joint_loads import JointLoad, joint_loads
from pinfric.checking.robot import RobotFacts
from pinfric.checking.robot_masses import believed_weight
from pinfric.errors import PinfricError, RobotError
from pinfric.formats import json_schema
from pinfric.model.files import file_hash, write_folder
from pinfric.model.massless import massless_joints
from pinfric.model.robot import Robot, locator, read_robot, urdf_file
from pinfric.model.scene import Scene
from pinfric.model.schema import Payload
from pinfric.model.urdf import UrdfDynamics
from pinfric.model.yamlfile import yaml_line
from pinfric.motions.followers import Follower, find_followers
from pinfric.motions.joint_columns import JointColumn, joint_columns
from pinfric.motions.rating import rate

#: Shear stress (Pa) that sizes a shaft for its torque, and its bearings' diameter over its own.
_SHEAR, _BEARING_OVER_SHAFT = 20e6, 1.5
#: The first move lasts no longer (s).
_LONGEST = 10.0
#: Coulomb friction of strain wave and planetary gears, bearings and seals as part of what the joint
#: must stand, and viscous friction at the velocity limit. Identified on a UR10e (Innopolis
#: University): 3.3 to 5 %, and 13 to 22 %.
_COULOMB, _VISCOUS = 0.05, 0.2
#: Static over kinetic friction; a joint's fastest turn or slide where the URDF does not say (rad/s,
#: m/s).
_STATIC, _FASTEST, _FASTEST_SLIDING = 1.2, 3.0, 1.0
#: Rolling bearings: mu of catalogues (SKF 0.0015-0.0030) and, at rest, 1.5 times that.
_MU = {"static": 0.003, "kinetic": 0.002}


def new_scene(
    urdf: str | Path, folder: str | Path | None = None, payload: Payload | None = None
) -> str:
    """Return a scene for a URDF as commented YAML that loads and runs as it is.

    Bearings: a turning joint gets two bearings on a shaft that carries its torque T at a shear
    stress of 20 MPa, d = (16 T/(pi 20 MPa))^(1/3); a sliding joint a guide half as long as its
    travel. Dry friction is 5 % of the lesser of the joint's effort limit and three times the weight
    that it carries, viscous friction 20 % of it at the velocity limit, as identified on a UR10e.
    Each guess has its reason beside it, and in `assumed`. Whether the links hold the drives is
    asked, not guessed.

    Args:
        urdf: the file, or `example-robot-data:<path below its robots folder>`.
        folder: where the scene will be saved; the URDF is named relative to it. None: in full.
        payload: that it is rated for; None: an example in a comment.

    Raises:
        RobotError: the URDF cannot be read, or describes something that cannot exist.
    """
    urdf = urdf_file(urdf)
    robot = read_robot(urdf, {})
    weight = believed_weight(RobotFacts.of(urdf), robot.model)
    joints = joint_loads(robot.model, weight)
    massless = massless_joints(Scene(robot.model))
    guessed = [
        joint
        for joint in joints
        if joint.degrees == 1 and (joint.leader or joint.name) not in massless
    ]
    rejected = [joint for joint in joints if joint.remark]
    mass = sum(inertia.mass for inertia in tuple(robot.model.inertias)[1:])  # 0 is the ground
    bodies = [frame.name for frame in robot.model.frames if frame.type == pin.FrameType.BODY]
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
        f"  urdf: {yaml_line(locator(urdf, folder))}",
        "  gravity: [0.0, 0.0, -9.81]",
        *_dynamics_section(robot),
        "  # masses: with_drives        # do the links hold motors and gears? Nothing in a URDF "
        "tells it:\n"
        "  # masses: without_drives     # write one. Until then `size` tries both and takes the "
        "heavier drives",
        *_payload_section(payload, bodies[-1]),
        "friction:" if guessed else "friction: {}",
        *[line for j in joints for line in _joint_section(j, j in guessed, robot.dynamics)],
        *_actuators_section(robot),
        # what `pinfric simulate` runs
        *(
            [
                "simulation:                    # pinfric simulate: the robot without power for "
                "1 s\n  t_end: 1.0",
            ]
            if guessed or any(joint.degrees > 1 for joint in joints)
            else [
                "# simulation: not possible, because nothing moves a mass; give links an <inertial>"
            ]
        ),
        # the guesses as data, so that every report can list them
        *(
            [
                "assumed:                       # delete the line of each guess that you replace",
                f"  by: {yaml_line(f'pinfric new {locator(urdf, folder)}')}",
                f"  date: '{datetime.date.today().isoformat()}'",
                f"  version: {yaml_line(__version__)}",
                f"  inputs: {{{yaml_line(urdf.name)}: {file_hash(urdf)}}}",
                "  values:",
            ]
            if guessed
            else []
        ),
        *[
            f"    {yaml_line(f'friction.{joint.name}.{key}')}: {yaml_line(why)}"
            for joint in guessed
            for key, (_, why) in _guesses(joint).items()
        ],
    ]
    return "\n".join(parts) + "\n"


def new_waypoints(urdf: str | Path) -> str:
    """Return a way-point file for the same robot: a small move of every joint, a hold, and back.

    Raises:
        RobotError: the URDF cannot be read.
        TrajectoryError: planar or floating joints, which files cannot describe.
    """
    urdf = urdf_file(urdf)
    robot = read_robot(urdf, {})
    columns = joint_columns(robot.model, str(urdf))
    followers = find_followers(SimpleNamespace(robot=robot, model=robot.model), columns)
    columns = tuple(_followed(column, followers) for column in columns)
    start = [_start(column) for column in columns]
    end = [_end(column, at) for column, at in zip(columns, start, strict=True)]
    names = ", ".join(yaml_line(column.name) for column in columns)
    there, back, time = _numbers(end), _numbers(start), f"{_duration(columns, start, end):g}"
    return f"""# A first motion for {urdf.name}: each joint moves a little, holds, and returns.
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


def new_rating(urdf: str | Path, payload: float, link: str | None = None) -> tuple[Payload, str]:
    """Return a rated payload for a scene, and a way-point file that holds and lifts it.

    Args:
        urdf: see `new_scene`. payload: kg. link: that carries it; None: the last one.

    Raises:
        RobotError: the URDF cannot be read; TrajectoryError: see `rate`.
    """
    urdf = urdf_file(urdf)
    robot = read_robot(urdf, {})
    scene = Scene(robot.model, robot=robot, source=str(urdf))
    rated = rate(scene, {"payload": payload, **({} if link is None else {"link": link})})
    return rated.scene.payloads[rated.payload], (
        f"# What {urdf.name} is rated for, as a motion: {payload:g} kg, held in the worst posture "
        "of each joint and lifted\n"
        "# from there by it alone, against gravity. `pinfric size --rating` takes each joint's "
        "means over its own part.\n"
        f"# Made by `pinfric new`; positions in rad and m, times in s.\n{rated.waypoints()}"
    )


def write_new(
    urdf: str | Path,
    folder: str | Path = ".",
    payload: float | None = None,
    link: str | None = None,
) -> list[Path]:
    """Write NAME.yaml and NAME.waypoints.yaml for a URDF; existing files are never overwritten.

    Beside them go the JSON schemas of both, which their first lines name to editors; with a payload
    rating.waypoints.yaml.

    Args:
        urdf: see `new_scene`; NAME is the file's without suffix.
        folder: where to; made if missing. payload, link: see `new_rating`.

    Raises:
        RobotError: see `new_scene`; PinfricError: a file exists already or cannot be written.
    """
    urdf = urdf_file(urdf)
    folder, name = Path(folder), urdf.stem.removesuffix(".urdf")  # of arm.urdf.xacro, too
    load, rating = (None, "") if payload is None else new_rating(urdf, payload, link)
    contents = {f"{name}.yaml": _checked("scene", new_scene(urdf, folder, load))}
    try:
        contents[f"{name}.waypoints.yaml"] = _checked("waypoints", new_waypoints(urdf))
    except RobotError:
        raise
    except PinfricError:
        pass  # a floating joint: motions are made in Python
    if rating:
        contents["rating.waypoints.yaml"] = _checked("waypoints", rating)
    for file in contents:
        if (folder / file).exists():
            raise PinfricError(f"{folder / file}: exists already; name another folder (--out)")
    schemas = {
        f"{kind}.schema.json": json.dumps(json_schema(kind), indent=1) + "\n"
        for kind in ("scene", "waypoints")
    }
    write_folder(
        folder,
        {
            file: partial(Path.write_text, data=text, encoding="utf-8")
            for file, text in {**schemas, **contents}.items()
        },
    )
    return [folder / file for file in contents]


def _checked(kind: str, text: str) -> str:
    """A file whose first line tells editors by which schema to check and complete it."""
    return f"# yaml-language-server: $schema={kind}.schema.json\n{text}"


def _payload_section(payload: Payload | None, link: str) -> list[str]:
    """The rated payload, or an example in a comment."""
    if payload is None:
        return [
            "  # payloads:                  # what it carries; com in the link's frame",
            f"  #   box: {{link: {yaml_line(link)}, mass: 1.0, com: [0, 0, 0.05]}}",
        ]
    com = ", ".join(_short(x) for x in payload.com)
    return [
        "  payloads:                    # what it carries; com in the link's frame",
        f"    rated: {{link: {yaml_line(payload.link)}, mass: {payload.mass:g}, com: [{com}]}}"
        "  # the rating: along z of its link",
    ]


def _joint_section(
    joint: JointLoad, moves_mass: bool, dynamics: Mapping[str, UrdfDynamics]
) -> list[str]:
    """The lines of one joint; a joint without a single axis is only listed."""
    name = yaml_line(joint.name)
    if joint.degrees > 1:
        return [f"  # {name}: {joint.degrees} degrees of freedom; friction needs one axis"]
    if not moves_mass:
        return [f"  # {name}: moves no mass; its friction would have no load, and none is guessed"]
    position = "m" if joint.sliding else "rad"
    if joint.leader is not None:
        about = f"follows {yaml_line(joint.leader)}: has bearings, but no drive"
    elif math.isfinite(joint.upper):
        about = f"{joint.lower:.4g} to {joint.upper:.4g} {position}"
    else:
        about = "no limits"
    about += f"; {joint.remark}" if joint.remark else ""
    given = dynamics.get(joint.name, UrdfDynamics(0.0, 0.0))
    stated = {"coulomb": given.friction, "viscous": given.damping}
    lines = [f"  {name}:  # {'slides' if joint.sliding else 'turns'}, {about}"]
    for key, (value, why) in _guesses(joint).items():
        urdf = f"; <dynamics>: {stated[key]:g}" if stated.get(key) else ""
        lines.append(f"    {key}: {value}  # guess: {why}{urdf}")
    if joint.leader is None:
        lines.append("    includes_drive: true  # `size` replaces both by its candidates' losses")
    return lines


def _guesses(joint: JointLoad) -> dict[str, tuple[str, str]]:
    """Key of a joint's friction -> its guess, and why."""
    dry = _COULOMB * joint.least
    unit, rate = ("N", "m/s") if joint.sliding else ("N m", "rad/s")
    speed, at = joint.fastest, "its velocity limit"
    if not speed:
        speed, at = (_FASTEST_SLIDING if joint.sliding else _FASTEST), "a usual velocity"
    least = f"{joint.least:.3g} {unit}"
    lesser = joint.why_least if joint.least < joint.load else least
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
            f"{1e3 * shaft:.2g} mm shaft for {joint.why}",
        )
    return {
        "bearing": bearing,
        "mu": (
            f"{{static: {_MU['static']}, kinetic: {_MU['kinetic']}}}",
            "rolling bearings (plain bushings: 0.1 to 0.2)",
        ),
        "coulomb": (
            f"{{static: {_short(_STATIC * dry)}, kinetic: {_short(dry)}}}",
            f"gear and seals, {100 * _COULOMB:g} % of {lesser}; measured robots: 0.2 to 6.5 %",
        ),
        "viscous": (
            _short(_VISCOUS * joint.least / speed),
            f"{100 * _VISCOUS:g} % of {least} at {at}, {speed:.3g} {rate}",
        ),
    }


def _dynamics_section(robot: Robot) -> list[str]:
    movable = set(list(robot.model.names)[1:])
    given = [n for n, d in robot.dynamics.items() if n in movable and (d.friction or d.damping)]
    if not given:
        return []
    shown = given[0] + (f" and {len(given) - 1} more" if len(given) > 1 else "")
    return [
        f"  # The URDF's <dynamics> has friction or damping of {shown}; many are placeholders.",
        "  urdf_dynamics: ignore        # `use`: use them if this file gives no value",
    ]


def _actuators_section(robot: Robot) -> list[str]:
    """The drives with the ratios that the URDF gives; a comment where it gives none."""
    single = [name for name, nv in zip(robot.model.names, robot.model.nvs, strict=True) if nv == 1]
    if not robot.gears.keys() & set(single):
        return [
            "# actuators:                   # without this section: one ideal drive per joint",
            f"#   - joint: {yaml_line(single[0] if single else robot.model.names[1])}",
            "#     transmission: {ratio: 100, efficiency: 0.85, back_efficiency: 0.82, "
            "rotor_inertia: 1.0e-5}",
        ]
    lines = [
        "actuators:                     # ratios are from the URDF's <transmission>, which has no",
        "  # losses and no rotors: add efficiency, back_efficiency, rotor_inertia (data sheet)",
    ]
    for name in Scene(robot.model).actuator_names:
        ratio = robot.gears.get(name) if name in single else None
        gear = "" if ratio is None else (f", transmission: {{ratio: {_short(ratio, 12)}}}")
        lines.append(f"  - {{joint: {yaml_line(name)}{gear}}}{'  # the URDF' if gear else ''}")
    return lines


def _followed(column: JointColumn, followers: Sequence[Follower]) -> JointColumn:
    """The column with the range in which its followers, too, stay within their limits."""
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
    """A fifth of the range away, towards the farther limit; 0.4 rad or 0.05 m at most.

    Less where the joint is so slow that the move would last longer than `_LONGEST`.
    """
    most = 0.05 if column.unit == "m" else 0.4
    if math.isfinite(column.velocity_limit) and column.velocity_limit > 0:
        most = min(most, _LONGEST * 0.3 * column.velocity_limit / 1.875)
    up, down = column.upper - start, start - column.lower
    step = min(most, 0.2 * min(max(up, down), 1e6))
    return _rounded(start + (step if up >= down else -step), column)


def _rounded(position: float, column: JointColumn) -> float:
    """To 4 decimals, or more where the range is narrow or the joint slow."""
    size = min(column.upper - column.lower, column.velocity_limit, 1.0)
    return round(position, 4 if size >= 0.01 else 4 - math.floor(math.log10(max(size, 1e-12))))


def _duration(columns: tuple[JointColumn, ...], start: list[float], end: list[float]) -> float:
    """Long enough for 0.3 of every velocity limit that is given (quintic: peak 15/8)."""
    needed = [
        1.875 * abs(b - a) / (0.3 * c.velocity_limit)
        for c, a, b in zip(columns, start, end, strict=True)
        if math.isfinite(c.velocity_limit) and c.velocity_limit > 0
    ]
    return max(1.0, math.ceil(10.0 * max(needed, default=0.0)) / 10.0)


def _short(x: float, digits: int = 2) -> str:
    """A number with so many significant digits."""
    number = float(f"{x:.{digits}g}")
    return yaml_line(int(number) if number.is_integer() else number)


def _numbers(values: list[float]) -> str:
    return f"[{', '.join(_short(value, 12) for value in values)}]"
