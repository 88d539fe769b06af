"""A robot as other engines take it: one body per joint, as Pinocchio's model has them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.errors import PinfricError
from pinfric.model.scene import Scene
from pinfric.model.twin import PRISMATIC
from pinfric.motions.joint_columns import JointColumn, joint_columns, stated_limit


@dataclass(frozen=True, eq=False)
class Body:
    """One joint with the body it moves, in Pinocchio's order.

    Attributes:
        joint: how files see it: name, limits, unit.
        link: name of the first link it moves.
        parent: row of the body it hangs on; -1 is the world.
        placement: of the joint's frame in the parent's, at q = 0.
        inertia: of all links fixed to each other, with what is carried.
        axis: (3,) unit vector, along or about which it moves.
        armature: the model's own rotor inertia at the joint (kg m^2 or kg).
        effort_limit: N m or N; infinite where none was stated.
        frames: name -> placement in the body of its further links.
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


def check_plain_tree(scene: Scene) -> tuple[JointColumn, ...]:
    """Return the joints of a scene that is an open chain driven at its joints.

    Raises:
        PinfricError: loops, drives off the joints or coupled, or joints of several degrees of
            freedom; named.
    """
    off_joint = [given for a in scene.actuators or () if (given := a.cylinder or a.force)]
    for what, named in (("the loop", scene.loops), ("the drive off the joints", off_joint)):
        if named:
            more = f" (and {len(named) - 1} more)" if len(named) > 1 else ""
            raise PinfricError(
                f"{scene.source}: {what} {named[0].name!r}{more}: other engines hold loops and "
                "cylinders as soft constraints, for which no error can be stated; only open "
                "chains with drives at their joints are exported"
            )
    for drive in scene.drives:
        if drive.couples:
            raise PinfricError(
                f"{scene.source}: the drive {drive.name!r} is coupled with another joint, but a "
                "constant of these formats acts on one joint; leave its `couples` out"
            )
    return joint_columns(scene.loaded_model(), scene.source)


def bodies(scene: Scene) -> tuple[Body, ...]:
    """Return the bodies of a scene, with the payloads that it carries by default.

    Raises:
        PinfricError: loops, drives off the joints, mimic joints or joints of several degrees of
            freedom; named.
    """
    columns = check_plain_tree(scene)
    model, twin = scene.loaded_model(), scene.twin()
    names = {column.name for column in columns}
    follower = next((name for name in scene.joint_names if name not in names), None)
    if follower is not None:
        raise PinfricError(
            f"{scene.source}: joint {follower!r} mimics another, which other engines hold as a "
            "soft constraint; lock it (robot.locked), or export to URDF"
        )
    every = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
    found = []
    for row, column in enumerate(columns):
        own = [frame for frame in every if frame.parentJoint == row + 1]
        found.append(
            Body(
                joint=column,
                link=own[0].name if own else column.name,
                parent=int(model.parents[row + 1]) - 1,
                placement=model.jointPlacements[row + 1],
                inertia=model.inertias[row + 1],
                axis=twin.axis[row, :3] if twin.kind[row] == PRISMATIC else twin.axis[row, 3:],
                armature=float(model.armature[column.index_v]),
                effort_limit=stated_limit(float(model.effortLimit[column.index_v])),
                frames={frame.name: frame.placement for frame in own[1:]},
            )
        )
    return tuple(found)
