"""A pose on its feet for a robot whose base floats: what `pinfric new --floating` begins with.

The legs are those of the names (`legs.py`). A bundled robot has a pose in its SRDF, an MJCF in its
keyframes; of others, each leg is bent until its foot is nearer to its hip by a tenth of the leg's
length, straight below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.errors import RobotError
from pinfric.model.floating import base_numbers, free_joint
from pinfric.model.legs import legs_of
from pinfric.model.robot import Robot
from pinfric.model.schema import Foot
from pinfric.motions.foot_contact import touching
from pinfric.motions.joint_columns import JointColumn, joint_columns
from pinfric.motions.tool_points import Tool

#: Words for the links on which robots stand, the best first.
_FEET = ("sole", "foot", "feet", "toe")
#: A leg with an ankle, or so many joints, has a sole.
_JOINTS_OF_A_SOLE = 5
#: m: of a sole that nobody has measured.
_LENGTH, _WIDTH = 0.16, 0.08
#: Part of the height of the base by which a first squat lowers it, and by which legs are bent.
_SQUAT, _BENT = 0.15, 0.1
#: Names of poses in SRDFs and keyframes, the best first.
_POSES = ("standing", "stand", "half_sitting", "standing_with_arm_up", "default", "home")
#: m: a foot's link begins at least so far from its leg's last joint; else it is the shank.
_OWN = 0.01


@dataclass(frozen=True)
class Pose:
    """A robot on its feet.

    Attributes:
        position: (nj,) numbers of the columns, the base's first.
        columns: all joints.
        feet: link -> foot, as guessed.
        lowered: height of the base in a squat that its legs reach, m.
        by: where the pose is from.
    """

    position: np.ndarray
    columns: tuple[JointColumn, ...]
    feet: dict[str, Foot]
    lowered: float
    by: str


def standing_pose(robot: Robot) -> Pose:
    """Return a pose in which a robot stands, and how far down it can go from there.

    Raises:
        RobotError: its base does not float, or no joint or link is called as of a leg.
    """
    model = robot.model
    if not free_joint(model):
        raise RobotError(f"{robot.urdf}: the base does not float")
    legs = legs_of(model)
    if len(legs) < 2:
        raise RobotError(
            f"{robot.urdf}: no two branches from its base are called as legs (leg, hip, knee, "
            "thigh, calf, foot): write `floating: true` into a scene, and its `feet`"
        )
    feet = dict(_foot(robot, leg) for leg in legs)
    columns = joint_columns(model, str(robot.urdf), free_base=True)
    position, by = _from_keyframe(robot, columns)
    if position is None:
        position, by = _from_srdf(robot, columns)
    if position is None:
        position, by = _bent(model, columns, feet), "legs a little bent"
    position = _on_ground(model, columns, position, feet)
    return Pose(position, columns, feet, _lowered(robot, columns, position, feet), by)


def _foot(robot: Robot, leg: Sequence[int]) -> tuple[str, Foot]:
    """Return the link on which a leg, its joints, stands, and what foot it is."""
    model = robot.model
    tip = max(leg, key=lambda j: len(model.supports[j]))
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == tip]
    named = [
        frame.name
        for word in _FEET
        for frame in bodies
        if word in frame.name.lower() and "imu" not in frame.name.lower()
    ]
    far = max(bodies, key=lambda frame: float(np.linalg.norm(frame.placement.translation)))
    chain = [str(model.names[j]) for j in model.supports[tip] if j in leg]
    ankle = any("ankle" in name.lower() for name in chain)
    sole = ankle or len(chain) >= _JOINTS_OF_A_SOLE
    usual = Foot(length=_LENGTH, width=_WIDTH) if sole else Foot()
    link = (named or [far.name])[0]
    begins = model.frames[model.getFrameId(link)].placement.translation
    own = None if np.linalg.norm(begins) > _OWN else touching(robot.xml(), link, sole)
    return link, own or usual


def _from_keyframe(robot: Robot, columns: Sequence[JointColumn]) -> tuple[np.ndarray | None, str]:
    """Return the pose that an MJCF's keyframes have for its joints, the base upright."""
    name = next((name for name in (*_POSES, *robot.keyframes) if name in robot.keyframes), None)
    if name is None:
        return None, ""
    joints = robot.keyframes[name]
    place = np.array([joints.get(column.name, 0.0) for column in columns])
    low, high = (np.array([getattr(c, end) for c in columns]) for end in ("lower", "upper"))
    return np.clip(place, low, high), f"keyframe {name}"


def _from_srdf(robot: Robot, columns: Sequence[JointColumn]) -> tuple[np.ndarray | None, str]:
    """Return the pose that the robot's SRDF has for it, and its name."""
    files = sorted(robot.urdf.resolve().parents[1].glob("srdf/*.srdf"))
    near = [file for file in files if robot.urdf.stem.startswith(file.stem)] or files
    for file in near[:1]:
        model = robot.model.copy()
        try:
            pin.loadReferenceConfigurations(model, str(file), False)
        except (RuntimeError, ValueError):
            continue
        poses = {pose.key(): pose.data() for pose in model.referenceConfigurations}
        for name in (name for name in _POSES if name in poses):
            q = np.array(poses[name])
            if q.shape == (model.nq,) and np.isfinite(q).all():
                return _numbers(columns, q), f"{name} of {file.name}"
    return None, ""


def _numbers(columns: Sequence[JointColumn], q: np.ndarray) -> np.ndarray:
    base = base_numbers(q[None])[0]
    place = [
        base[k]
        if column.free
        else (
            q[column.index_q]
            if column.nq == 1
            else np.arctan2(q[column.index_q + 1], q[column.index_q])
        )
        for k, column in enumerate(columns)
    ]
    low, high = (np.array([getattr(c, end) for c in columns]) for end in ("lower", "upper"))
    return np.clip(np.array(place, dtype=float), low, high)


def _tools(
    model: pin.Model, columns: Sequence[JointColumn], feet: dict[str, Foot]
) -> dict[str, Tool]:
    tools = {}
    for name in feet:
        frame = model.getFrameId(name)
        joints = [str(model.names[j]) for j in model.supports[model.frames[frame].parentJoint]]
        tools[name] = Tool(model, columns, frame, joints, feet[name].xyz)
    return tools


def _bent(model: pin.Model, columns: Sequence[JointColumn], feet: dict[str, Foot]) -> np.ndarray:
    """Return a pose with each foot below its hip, nearer by `_BENT` of its leg's length."""
    low, high = (np.array([getattr(c, end) for c in columns]) for end in ("lower", "upper"))
    finite = np.isfinite(low) & np.isfinite(high)
    middle = 0.5 * (np.where(finite, low, 0.0) + np.where(finite, high, 0.0))
    start = np.clip(np.zeros(len(columns)), low, high)
    start[finite] += 0.25 * (middle - start)[finite]  # off the stretched pose, which has no way up
    for name, tool in _tools(model, columns, feet).items():
        straight = tool.place(np.clip(np.zeros(len(columns)), low, high)).copy()
        hip = tool.data.oMi[model.supports[tool.joint][2]].translation
        leg = straight.translation - hip
        if abs(leg[2]) > 0.5 * np.linalg.norm(leg):
            leg[:2] = 0.0  # straight up: an ankle that does not roll keeps its sole flat
        goal = pin.SE3(straight.rotation, straight.translation - _BENT * leg)
        rows = 6 if feet[name].length else 3
        start, _ = tool.reach(goal, start, rows)
    return start


def _on_ground(
    model: pin.Model,
    columns: Sequence[JointColumn],
    position: np.ndarray,
    feet: dict[str, Foot],
) -> np.ndarray:
    """Return the pose with level feet on the ground at 0, soles flat, the base as high as it is."""
    position = position.copy()
    tools = _tools(model, columns, feet)
    places = {name: tool.place(position).copy() for name, tool in tools.items()}
    ground = float(np.mean([place.translation[2] for place in places.values()]))
    for name, tool in tools.items():
        goal = places[name].copy()
        goal.translation = np.array([*goal.translation[:2], ground])
        sole = feet[name].length > 0
        if sole:  # its own turn about the vertical stays
            up = int(np.argmax(np.abs(goal.rotation[2])))
            goal.rotation = _upright(goal.rotation, up)
        position, _ = tool.reach(goal, position, 6 if sole else 3)
    position[2] -= ground
    return position


def _upright(R: np.ndarray, axis: int) -> np.ndarray:
    """Return the nearest rotation whose axis is vertical."""
    now = R[:, axis] * np.sign(R[2, axis])
    turn = pin.Quaternion.FromTwoVectors(now, np.array([0.0, 0.0, 1.0])).matrix()
    return np.asarray(turn @ R)


def _lowered(
    robot: Robot,
    columns: Sequence[JointColumn],
    position: np.ndarray,
    feet: dict[str, Foot],
) -> float:
    """Return a height of the base that its legs reach over feet that stay, m."""
    model = robot.model
    tools = _tools(model, columns, feet)
    places = {name: tool.place(position).copy() for name, tool in tools.items()}
    for share in _SQUAT * np.array([1.0, 0.7, 0.4, 0.2]):
        reached, there = True, position.copy()
        for part in np.linspace(0.0, share, 9)[1:]:
            there[2] = (1.0 - part) * position[2]
            for name, tool in tools.items():
                there, e = tool.reach(places[name], there, 6 if feet[name].length else 3)
                reached &= bool(np.abs(e).max() < 1e-6)
        if reached:
            return float((1.0 - share) * position[2])
    return float(position[2])
