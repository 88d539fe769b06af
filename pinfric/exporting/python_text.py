"""Python files that give another engine's robot its joints' constants, by the joints' names.

Isaac Lab: `friction` is the effort at which a joint breaks away, `dynamic_friction` in motion (N m
or N), `viscous_friction` N m s/rad or N s/m, `armature` kg m^2 or kg (`isaaclab.actuators`,
ActuatorBaseCfg of Isaac Lab 2.3 and 3.0 with Isaac Sim 5.0 or later; in 4.5 the first was a
coefficient without unit, and these values would be wrong).

Newton: SolverMuJoCo takes all three of a `ModelBuilder` (Newton 1.8: frictionloss, damping and
armature of MuJoCo, by default with MuJoCo's soft constraint, which creeps where friction holds).

Pinocchio 4: `pin.JointFrictionConstraintModel` bounds the effort of dry friction at each joint;
rigid-body algorithms read `model.armature` alone.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from pinfric.errors import one_line
from pinfric.exporting.constants import JointConstants
from pinfric.model.scene import Scene

#: Format -> its dictionaries of dry friction, damping and rotor inertia.
_NAMES = {
    "isaaclab": ("DYNAMIC_FRICTION", "VISCOUS_FRICTION", "ARMATURE"),
    "newton": ("JOINT_FRICTION", "JOINT_DAMPING", "JOINT_ARMATURE"),
    "pinocchio": ("DRY_FRICTION", "DAMPING", "ARMATURE"),
}
#: Format -> what uses them.
_CODE = {
    "isaaclab": """
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
""",
    "newton": '''
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
''',
    "pinocchio": '''
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
''',
}


def python_text(
    to: str,
    scene: Scene,
    joints: Sequence[JointConstants],
    lines: Mapping[str, str],
    header: Sequence[str],
) -> str:
    """Return a Python file: comments, a dictionary of constants for each field, and code.

    Args:
        to: "isaaclab" (`ACTUATORS` for an ArticulationCfg), "newton" or "pinocchio"
            (`set_friction`).
        scene: with the model's own rotor inertias, to which the constants add.
        joints: the constants.
        lines: joint -> comment.
        header: comments at the top.
    """
    model, isaac = scene.model, to == "isaaclab"
    index = {name: model.joints[model.getJointId(name)].idx_v for name in scene.joint_names}
    own = [j.armature + model.armature[index[j.joint]] for j in joints]
    columns = [j.frictionloss for j in joints], [j.damping for j in joints], own
    fields = dict(zip(_NAMES[to], columns, strict=True))
    if isaac:
        # half the width of the interval at rest, not below the friction in motion (N m or N); fmax
        # leaves that alone where the joint never stands still
        halves = [0.5 * (joint.rest_upper - joint.rest_lower) for joint in joints]
        fields = {"FRICTION": np.fmax(halves, columns[0]).tolist(), **fields}
    comments = [f"# {one_line(line)}".rstrip() for line in (*header, *lines.values())]
    # Isaac Lab's names are regular expressions
    names = [re.escape(joint.joint) if isaac else joint.joint for joint in joints]
    tables = []
    for field, column in fields.items():
        rows = zip(names, column, strict=True)
        entries = (f"    {name!r}: {float(value)!r}," for name, value in rows)
        tables.append("\n".join([f"{field} = {{", *entries, "}"]))
    return "\n".join([*comments, "", *tables, "", _CODE[to].strip("\n"), ""])
