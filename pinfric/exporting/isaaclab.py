"""Isaac Lab's actuator configuration: friction of joints as PhysX takes it, efforts since 5.0.

`friction` is the effort at which a joint breaks away, `dynamic_friction` in motion (N m or N),
`viscous_friction` N m s/rad or N s/m, `armature` kg m^2 or kg (`isaaclab.actuators`,
ActuatorBaseCfg of Isaac Lab 2.3 and 3.0 with Isaac Sim 5.0 or later; in 4.5 the first was a
coefficient without unit, and these values would be wrong).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from pinfric.exporting.constants import JointConstants
from pinfric.exporting.python_text import break_away, constant_fields, python_file
from pinfric.model.scene import Scene

_CODE = """
from isaaclab.actuators import ImplicitActuatorCfg

ACTUATORS = {
    "arm": ImplicitActuatorCfg(
        joint_names_expr=list(FRICTION),
        stiffness=0.0,  # for effort commands; set your gains for position or velocity commands
        damping=0.0,
        friction=FRICTION,
        dynamic_friction=DYNAMIC_FRICTION,
        viscous_friction=VISCOUS_FRICTION,
        armature=ARMATURE,
    ),
}
"""


def isaaclab(
    scene: Scene, joints: Sequence[JointConstants], lines: Mapping[str, str], header: Sequence[str]
) -> str:
    """Return a Python file with `ACTUATORS`, for an ArticulationCfg.

    Args:
        scene: with the model's own rotor inertias.
        joints: the constants.
        lines: joint -> comment.
        header: comments at the top.
    """
    fields = {
        "FRICTION": {joint.joint: break_away(joint) for joint in joints},
        **constant_fields(scene, joints, "DYNAMIC_FRICTION", "VISCOUS_FRICTION", "ARMATURE"),
    }
    text = python_file(joints, fields, lines, header, _CODE)
    for joint in joints:  # names are regular expressions there
        text = text.replace(f"    {joint.joint!r}:", f"    {re.escape(joint.joint)!r}:")
    return text
