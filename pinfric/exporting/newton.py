"""Newton's joints: `joint_friction`, `joint_damping` and `joint_armature` of a `ModelBuilder`.

SolverMuJoCo takes all three (Newton 1.8: frictionloss, damping and armature of MuJoCo, by default
with MuJoCo's soft constraint, which creeps where friction holds).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pinfric.exporting.constants import JointConstants
from pinfric.exporting.python_text import constant_fields, python_file
from pinfric.model.scene import Scene

_CODE = '''
def set_friction(builder):
    """Give the joints of a newton.ModelBuilder their constants; call it before `finalize`."""
    named = {label.rsplit("/", 1)[-1]: j for j, label in enumerate(builder.joint_label)}
    missing = sorted(set(JOINT_FRICTION) - set(named))
    if missing:
        raise KeyError(f"there are no joints {missing}; there are {sorted(named)}")
    for name, friction in JOINT_FRICTION.items():
        dof = builder.joint_qd_start[named[name]]
        builder.joint_friction[dof] = friction
        builder.joint_damping[dof] = JOINT_DAMPING[name]
        builder.joint_armature[dof] = JOINT_ARMATURE[name]
'''


def newton(
    scene: Scene, joints: Sequence[JointConstants], lines: Mapping[str, str], header: Sequence[str]
) -> str:
    """Return a Python file with `set_friction(builder)`.

    Args: see `isaaclab.isaaclab`.
    """
    fields = constant_fields(scene, joints, "JOINT_FRICTION", "JOINT_DAMPING", "JOINT_ARMATURE")
    return python_file(joints, fields, lines, header, _CODE)
