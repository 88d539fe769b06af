"""Robots that stand, for identification: the free base as six joints of one freedom each.

Their efforts are those that nothing drives: no row has them. The legs' efforts are what is left of
the measured ones beside the forces at the feet, which a log gives.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.errors import IdentificationError, StateError
from pinfric.model.floating import MOST_PITCH, POSE, base_numbers, base_rates, free_joint
from pinfric.model.scene import Scene
from pinfric.model.schema import Actuator
from pinfric.motions.trajectory import Trajectory

#: The joints in the place of the base, from the ground on: R = R_z(yaw) R_y(pitch) R_x(roll).
_CHAIN = ("x", "y", "z", "yaw", "pitch", "roll")
_KINDS = (
    *(pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ),
    *(pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX),
)
#: Their places among the numbers of a base, `POSE`.
_PLACES = [POSE.index(part) for part in _CHAIN]


def base_joints(scene: Scene) -> tuple[str, ...]:
    """Return the names of the joints in the place of a scene's free base."""
    return tuple(f"{free_joint(scene.model)}.{part}" for part in _CHAIN)


def on_chain(scene: Scene) -> Scene:
    """Return a scene whose free base is six joints, each with an ideal drive."""
    names = base_joints(scene)
    drives = [Actuator(joint=name) for name in names]
    return scene.with_(
        model=_chain_model(scene.model, names),
        actuators=(*drives, *(scene.actuators or ())),
        feet={},
    )


def on_base(found: Scene, scene: Scene) -> Scene:
    """Return a scene of `on_chain` with the free base of the one that it was made of."""
    drives = [drive for drive in found.actuators or () if drive.joint not in base_joints(scene)]
    return found.with_(
        model=scene.model, actuators=tuple(drives) if scene.actuators else None, feet=scene.feet
    )


def motion_on_chain(motion: Trajectory, scene: Scene) -> Trajectory:
    """Return a motion of a scene with a free base in the numbers of `on_chain`.

    Raises:
        IdentificationError: it has no forces at the feet; the base turns upright.
    """
    if not motion.external:
        raise IdentificationError(
            f"{motion.source}: holds no forces at the feet: without them each equation holds the "
            "friction of all legs, and joints are fitted one by one; log the forces, or identify "
            "the legs on a stand (`floating: false`)"
        )
    numbers = base_numbers(motion.q[:, :7])
    if np.abs(numbers[:, POSE.index("pitch")]).max() > MOST_PITCH:
        raise IdentificationError(
            f"{motion.source}: the base pitches by more than {np.degrees(MOST_PITCH):.0f} degrees"
        )
    rates, bends = base_rates(numbers, motion.v[:, :6], motion.a[:, :6])
    parts = zip(
        (numbers, rates, bends), (motion.q[:, 7:], motion.v[:, 6:], motion.a[:, 6:]), strict=True
    )
    q, v, a = (np.hstack([base[:, _PLACES], legs]) for base, legs in parts)
    names = (*base_joints(scene), *motion.joint_names[1:])
    return replace(
        motion, q=q, v=v, a=a, joint_names=names, joint_nq=(1,) * 6 + motion.joint_nq[1:]
    )


def left_at_base(motion: Trajectory, scene: Scene) -> float:
    """Return the share of the weight that forces at the feet leave at the base; 0: within `LIMIT`.

    Raises:
        IdentificationError: they would balance it in other axes, or with the other sign.
    """
    try:
        balance = inverse_dynamics(scene.with_(friction={}), motion).balance
    except StateError as problem:
        raise IdentificationError(f"{motion.source}: {problem}") from None
    return 0.0 if balance is None or balance.within else balance.share


def _chain_model(model: pin.Model, names: tuple[str, ...]) -> pin.Model:
    chain, place = pin.Model(), {0: 0}
    chain.name, chain.gravity = model.name, model.gravity
    parent = 0
    for kind, name in zip(_KINDS, names, strict=True):
        parent = chain.addJoint(parent, kind(), pin.SE3.Identity(), name)
    place[1] = parent
    chain.appendBodyToJoint(parent, model.inertias[1], pin.SE3.Identity())
    for j in range(2, model.njoints):
        placement, joint = model.jointPlacements[j], model.joints[j]
        first, last = joint.idx_q, joint.idx_q + joint.nq
        ends = slice(joint.idx_v, joint.idx_v + joint.nv)
        place[j] = chain.addJoint(
            place[model.parents[j]],
            joint,
            placement,
            model.names[j],
            model.effortLimit[ends],
            model.velocityLimit[ends],
            model.lowerPositionLimit[first:last],
            model.upperPositionLimit[first:last],
        )
        chain.appendBodyToJoint(place[j], model.inertias[j], pin.SE3.Identity())
    chain.armature = model.armature  # columns of v are the same
    for frame in model.frames[1:]:
        chain.addFrame(
            pin.Frame(
                frame.name, place[frame.parentJoint], 0, frame.placement, frame.type, frame.inertia
            ),
            False,
        )
    return chain
