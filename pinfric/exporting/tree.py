"""A robot for other engines: one body per joint, as in Pinocchio's model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.errors import PinfricError
from pinfric.exporting.constants import JointConstants
from pinfric.model.floating import stands
from pinfric.model.scene import Scene
from pinfric.model.twin import PRISMATIC
from pinfric.motions.followers import find_followers
from pinfric.motions.joint_columns import JointColumn, joint_columns, stated_limit


@dataclass(frozen=True, eq=False)
class MovedBody:
    """One joint with the body it moves, in Pinocchio's order.

    Attributes:
        joint: how files see it: name, limits, unit.
        link: name of the first link it moves.
        parent: row of the parent body; -1 is the world.
        placement: of the joint's frame in the parent's, at q = 0.
        inertia: of all links fixed to each other, with payloads.
        axis: (3,) unit vector of its motion.
        armature: the model's, at the joint (kg m^2 or kg).
        effort_limit: N m or N; infinite if none was stated.
        frames: name -> placement in the body of its further links.
        follows: (leader's name, ratio, shift) of a mimic joint; None for others.
    """

    joint: JointColumn
    link: str
    parent: int
    placement: pin.SE3
    inertia: pin.Inertia
    axis: np.ndarray
    armature: float
    effort_limit: float
    frames: dict[str, pin.SE3]
    follows: tuple[str, float, float] | None = None


def check_plain_tree(scene: Scene, free_base: bool = False) -> tuple[JointColumn, ...]:
    """Return the joints of a scene that is an open chain driven at its joints.

    `free_base`: whether it may float, on given forces; it is none of the joints.

    Raises:
        PinfricError: loops, friction along springs, drives off the joints or coupled, or joints of
            several degrees of freedom; named.
    """
    if scene.closed_by:
        raise PinfricError(
            f"{scene.source}: {scene.closed_by}: other engines hold loops and cylinders as soft "
            "constraints, for which no error can be stated, and have no dry friction along "
            "springs; only open chains with drives at their joints are exported"
        )
    free_base &= stands(scene)
    for row, name in enumerate(scene.joint_names):
        joint = scene.model.joints[row + 1]
        if joint.nv > 1 and (row or not free_base):
            raise PinfricError(
                f"{scene.source}: joint {name!r} has {joint.nv} degrees of freedom; exports are of "
                "robots whose joints have one each: of a legged robot export the scene of its "
                "fixed base (`floating: false`) and give its <body> a <freejoint/> and the base's "
                "<inertial>, or take `--to constants`; lock others (robot.locked)"
            )
    for drive in scene.drives:
        if drive.couples:
            raise PinfricError(
                f"{scene.source}: the drive {drive.name!r} is coupled with another joint, but a "
                "constant of these formats acts on one joint; leave its `couples` out"
            )
    columns = joint_columns(scene.loaded_model(), scene.source, free_base)
    return tuple(column for column in columns if not column.free)


def rotor_inertias(scene: Scene) -> np.ndarray:
    """Return (n,) r^2 J of each rotor plus the model's armature, at the joint (kg m^2 or kg).

    In the order of `check_plain_tree`.
    """
    own, gears = scene.model.armature, scene.gears()
    reflected = (gears.ratio**2 * gears.rotor_inertia).tolist()
    rotors = dict(zip([d.velocity_index for d in scene.drives], reflected, strict=True))
    columns = [column.index_v for column in check_plain_tree(scene, free_base=True)]
    return np.array([float(own[v]) + rotors.get(v, 0.0) for v in columns])


def drake_rotor(joint: JointConstants, reflected: float) -> dict[str, str]:
    """Return Drake's tags of a rotor, with their values; none without a rotor.

    Args:
        joint: with the ratio. reflected: `rotor_inertias` (kg m^2 or kg).

    Source: Drake documentation, parsing models: drake:rotor_inertia, drake:gear_ratio.
    """
    if not reflected > 0.0:
        return {}
    values = reflected / joint.ratio**2, joint.ratio
    return dict(zip(("drake:rotor_inertia", "drake:gear_ratio"), map(repr, values), strict=True))


def bodies(scene: Scene) -> tuple[MovedBody, ...]:
    """Return the bodies of a scene, with the payloads that it carries by default.

    Raises:
        PinfricError: see `check_plain_tree`; a mimic joint without its URDF's limits.
    """
    columns = {column.name: column for column in check_plain_tree(scene)}
    model, twin = scene.loaded_model(), scene.twin()
    followers = {f.column.name: f for f in find_followers(scene, tuple(columns.values()))}
    frames = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
    rows = []
    for row, name in enumerate(list(model.names)[1:]):
        own = [frame for frame in frames if frame.parentJoint == row + 1]
        follower, leads = followers.get(name), columns.get(name)
        column = leads if follower is None else follower.column
        if column is None:
            raise PinfricError(
                f"{scene.source}: joint {name!r} mimics another, in a model that was made in "
                "Python: its limits are not known; load the robot from its URDF"
            )
        limit = np.inf if leads is None else float(model.effortLimit[column.index_v])
        rows.append(
            MovedBody(
                joint=column,
                link=own[0].name if own else name,
                parent=int(model.parents[row + 1]) - 1,
                placement=model.jointPlacements[row + 1],
                inertia=model.inertias[row + 1],
                axis=twin.axis[row, :3] if twin.kind[row] == PRISMATIC else twin.axis[row, 3:],
                armature=0.0 if leads is None else float(model.armature[column.index_v]),
                effort_limit=stated_limit(limit),
                frames={frame.name: frame.placement for frame in own[1:]},
                follows=None if follower is None else follower.law,
            )
        )
    return tuple(rows)
