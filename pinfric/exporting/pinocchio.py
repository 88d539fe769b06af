"""Pinocchio 4's joint friction: bounds of its constraint, and damping and armature of a model.

`pin.JointFrictionConstraintModel` bounds the effort of dry friction at each joint; rigid-body
algorithms read `model.armature` alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pinfric.exporting.constants import JointConstants
from pinfric.exporting.python_text import constant_fields, python_file
from pinfric.model.scene import Scene

_CODE = '''
import numpy as np
import pinocchio as pin


def set_friction(model):
    """Give a pin.Model its joints' constants; return the constraint that holds dry friction."""
    joints, bound = pin.StdVec_Index(), []
    for name, friction in DRY_FRICTION.items():
        if not model.existJointName(name):
            raise KeyError(f"there is no joint {name!r}; there are {list(model.names)[1:]}")
        joint = model.getJointId(name)
        v = model.joints[joint].idx_v
        joints.append(joint)
        bound.append(friction)
        model.lowerDryFrictionLimit[v] = -friction
        model.upperDryFrictionLimit[v] = friction
        model.damping[v] = DAMPING[name]
        model.armature[v] = ARMATURE[name]
    return pin.JointFrictionConstraintModel(model, joints, -np.array(bound), np.array(bound))
'''


def pinocchio(
    scene: Scene, joints: Sequence[JointConstants], lines: Mapping[str, str], header: Sequence[str]
) -> str:
    """Return a Python file with `set_friction(model)`.

    Args: see `isaaclab.isaaclab`.
    """
    fields = constant_fields(scene, joints, "DRY_FRICTION", "DAMPING", "ARMATURE")
    return python_file(joints, fields, lines, header, _CODE)
