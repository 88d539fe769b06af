"""URScript of a Universal Robots arm: the friction of its six joints, to be added to a torque.

UR's controller knows friction as two numbers per joint, Coulomb and viscous. Its own are not
published and cannot be set, only scaled: `direct_torque(torque, viscous_scale, coulomb_scale)`
(URScript manual, PolyScope 5.25), in ROS 2 `ur_msgs/FrictionModelParameters`. With both scales 0
friction is the program's: this one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from pinfric.errors import PinfricError, one_line
from pinfric.exporting.constants import JointConstants
from pinfric.model.scene import Scene

#: The joints in UR's order; a description may put a prefix before them.
JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
_PROGRAM = """\
def pinfric_friction(qd):
  # N m of the six joints at the speeds qd (rad/s); within `slow` of rest it grows linearly
  local slow = 0.01
  local coulomb = {coulomb}
  local viscous = {viscous}
  local torque = [0, 0, 0, 0, 0, 0]
  local i = 0
  while i < 6:
    local direction = qd[i] / slow
    if direction > 1:
      direction = 1
    elif direction < -1:
      direction = -1
    end
    torque[i] = coulomb[i] * direction + viscous[i] * qd[i]
    i = i + 1
  end
  return torque
end
"""
_USE = (
    "UR's own friction model is not published and can only be scaled (direct_torque, URScript "
    "manual of PolyScope 5.25; ROS 2: ur_msgs/FrictionModelParameters); instead of it:",
    "  local friction = pinfric_friction(get_actual_joint_speeds())",
    "  direct_torque(torque + friction, viscous_scale=[0, 0, 0, 0, 0, 0], "
    "coulomb_scale=[0, 0, 0, 0, 0, 0])  # element by element",
)


def ur_script(
    scene: Scene, joints: Sequence[JointConstants], lines: Mapping[str, str], header: Sequence[str]
) -> str:
    """Return a URScript function of the constants: coulomb sign(qd) + viscous qd.

    Args:
        scene: of one of UR's arms; locked joints get 0.
        joints: the constants.
        lines: joint -> comment.
        header: comments at the top.

    Raises:
        PinfricError: a joint that UR's arms do not have, or one of theirs that is missing.
    """
    named = {}
    for joint in joints:
        ends = [name for name in JOINTS if joint.joint.endswith(name)]
        if not ends:
            raise PinfricError(
                f"{scene.source}: joint {joint.joint!r} is not a joint of a UR arm "
                f"({', '.join(JOINTS)}), and UR's script has no others; lock it (robot.locked), or "
                "export to mjcf or urdf"
            )
        named[ends[0]] = joint
    locked = {} if scene.robot is None else scene.robot.locked
    for name in JOINTS:
        if name not in named and not any(known.endswith(name) for known in locked):
            raise PinfricError(
                f"{scene.source}: has no joint {name!r}; UR's friction parameters are for its "
                f"six joints: {', '.join(JOINTS)}"
            )
    found = [named.get(name) for name in JOINTS]
    comments = [*header, *lines.values(), *_USE]
    program = _PROGRAM.format(
        coulomb=_numbers(joint.frictionloss if joint else 0.0 for joint in found),
        viscous=_numbers(joint.damping if joint else 0.0 for joint in found),
    )
    return "".join(f"# {one_line(line)}\n" for line in comments) + program


def _numbers(values: Iterable[float]) -> str:
    return f"[{', '.join(f'{x:.6g}' for x in values)}]"
