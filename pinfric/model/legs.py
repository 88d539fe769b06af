"""Robots with legs that hang by a fixed base: the legs carry themselves and not the robot.

Names tell legs from fingers, geometry cannot: two branches or more from the base whose joints or
links have a word for a part of a leg. Of example-robot-data and 40 other public robots these are
all with legs at their base, and no arm or hand.
"""

from __future__ import annotations

import re

import pinocchio as pin

_WORDS = {
    *("leg", "legs", "foot", "feet", "hip", "knee", "thigh", "calf", "ankle", "shank", "toe"),
    *("coxa", "femur", "tibia", "haa", "hfe", "kfe"),
}
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def hanging_legs(model: pin.Model) -> str:
    """Return that a robot's legs hang by a fixed base, and how to let it stand, or ""."""
    names: list[list[str]] = [[str(name)] for name in model.names]
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            names[frame.parentJoint].append(str(frame.name))
    legs = 0
    for j in range(1, model.njoints):
        if not int(model.parents[j]):
            if model.joints[j].nv > 1:
                return ""
            legs += any(_of_leg(name) for k in model.subtrees[j] for name in names[k])
    if legs < 2:
        return ""
    base = next(iter(names[0][1:]), "its root")
    return (
        f"{legs} legs hang by the fixed base {base}, and carry only themselves; to let them stand, "
        "write `floating: true` under `robot` (`pinfric new --floating`) and give the forces at "
        "the feet with the motion"
    )


def _of_leg(name: str) -> bool:
    """Whether a word of a name is a leg's: left_hip, LHipYaw, RLEG_JOINT0."""
    words = [word.lower() for word in _TOKEN.findall(name)]
    return any(word in _WORDS or (word[0] in "lr" and word[1:] in _WORDS) for word in words)
