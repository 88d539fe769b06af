"""Robots with legs that hang by a fixed base: the legs carry themselves and not the robot.

Names tell legs from fingers, geometry cannot: two branches or more from the base whose joints or
links have a word for a part of a leg. Of example-robot-data and 40 other public robots these are
all with legs at their base, and no arm or hand.
"""

from __future__ import annotations

import re

import pinocchio as pin

from pinfric.model.floating import free_joint

_WORDS = {
    *("leg", "legs", "foot", "feet", "hip", "knee", "thigh", "calf", "ankle", "shank", "toe"),
    *("coxa", "femur", "tibia", "haa", "hfe", "kfe"),
}
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def hanging_legs(model: pin.Model) -> str:
    """Return that a robot's legs hang by a fixed base, and how to let it stand, or ""."""
    if free_joint(model) or len(found := legs_of(model)) < 2:
        return ""
    legs, trunk = len(found), _trunk(model)
    base = next(iter(_links(model)[trunk][1:]), "its root")
    held = f"{base}, which joints hold to the ground" if trunk else f"the fixed base {base}"
    return (
        f"{legs} legs hang by {held}, and carry only themselves; to let them stand, "
        + "take these joints out of the file, " * bool(trunk)
        + "write `floating: true` under `robot` (`pinfric new --floating`) and give the forces at "
        "the feet with the motion"
    )


def legs_of(model: pin.Model) -> list[list[int]]:
    """Return the joints of each branch from the base that has a word for a part of a leg."""
    links, root = _links(model), _trunk(model)
    branches = (j for j in range(1, model.njoints) if int(model.parents[j]) == root)
    return [
        list(model.subtrees[j])
        for j in branches
        if model.joints[j].nv <= 1
        and any(_of_leg(name) for k in model.subtrees[j] for name in links[k])
    ]


def _trunk(model: pin.Model) -> int:
    """Return the joint that moves the base: the free one, or the last of a chain from the ground.

    0: the base is fixed, as it is if the chain never branches.
    """
    if free_joint(model):
        return 1
    children: list[list[int]] = [[] for _ in range(model.njoints)]
    for j in range(1, model.njoints):
        children[int(model.parents[j])].append(j)
    trunk = 0
    while len(children[trunk]) == 1:
        trunk = children[trunk][0]
    return trunk if children[trunk] else 0


def _links(model: pin.Model) -> list[list[str]]:
    """Return by joint its name and those of the links that it moves."""
    names: list[list[str]] = [[str(name)] for name in model.names]
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            names[frame.parentJoint].append(str(frame.name))
    return names


def _of_leg(name: str) -> bool:
    """Whether a word of a name is a leg's: left_hip, LHipYaw, RLEG_JOINT0."""
    words = [word.lower() for word in _TOKEN.findall(name)]
    return any(word in _WORDS or (word[0] in "lr" and word[1:] in _WORDS) for word in words)
