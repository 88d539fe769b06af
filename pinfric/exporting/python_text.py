"""Python files that give another engine's robot its joints' constants, by the joints' names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pinfric.errors import one_line
from pinfric.exporting.constants import JointConstants
from pinfric.model.scene import Scene


def python_file(
    joints: Sequence[JointConstants],
    fields: Mapping[str, Mapping[str, float]],
    lines: Mapping[str, str],
    header: Sequence[str],
    code: str,
) -> str:
    """Return a Python file: comments, a dictionary of constants for each field, and code.

    Args:
        joints: the constants.
        fields: name of a dictionary -> joint -> number.
        lines: joint -> comment.
        header: comments at the top.
        code: what uses the dictionaries.
    """
    comments = [f"# {one_line(line)}".rstrip() for line in (*header, *lines.values())]
    tables = [
        "\n".join(
            [
                f"{name} = {{",
                *(f"    {joint.joint!r}: {float(values[joint.joint])!r}," for joint in joints),
                "}",
            ]
        )
        for name, values in fields.items()
    ]
    return "\n".join([*comments, "", *tables, "", code.strip("\n"), ""])


def constant_fields(
    scene: Scene, joints: Sequence[JointConstants], friction: str, damping: str, armature: str
) -> dict[str, dict[str, float]]:
    """Return the dictionaries of dry friction, damping and rotor inertia, each joint -> number.

    Args:
        scene: with the model's own rotor inertias, to which the constants add.
        joints: the constants.
        friction, damping, armature: names of the dictionaries.
    """
    model = scene.model
    index = {name: model.joints[model.getJointId(name)].idx_v for name in scene.joint_names}
    return {
        friction: {joint.joint: joint.frictionloss for joint in joints},
        damping: {joint.joint: joint.damping for joint in joints},
        armature: {j.joint: float(j.armature + model.armature[index[j.joint]]) for j in joints},
    }


def break_away(joint: JointConstants) -> float:
    """Return half the width of the interval at rest, not below the friction in motion (N m or N).

    Where the joint never stands still, that is the friction in motion.
    """
    if joint.rest_upper != joint.rest_upper:
        return joint.frictionloss
    return max(0.5 * (joint.rest_upper - joint.rest_lower), joint.frictionloss)
