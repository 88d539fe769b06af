"""A robot's free base: `robot.floating`, without another URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pinocchio as pin

from pinfric.errors import RobotError
from pinfric.model.mimics import link_of

#: The joint of the free base and the link that it stands on, as Pinocchio and ROS call them.
FREE_JOINT, _GROUND = "root_joint", "world"


def free_base(root: ElementTree.Element, urdf: Path) -> None:
    """Put a joint of type floating before the root link; `root`, checked, is changed in place.

    A root link without mass that is called `world` stays: the joint that fixes the robot to it
    becomes the floating one.

    Raises:
        RobotError: the base floats already, or its joint's name is taken.
    """
    joints = root.findall("joint")
    carried = {link_of(joint, "child") for joint in joints}
    base = next(x for link in root.findall("link") if (x := link.attrib["name"]) not in carried)
    first = [joint for joint in joints if link_of(joint, "parent") == base]
    if len(first) == 1 and first[0].get("type") == "floating":
        raise RobotError(
            f"{urdf}: robot.floating: joint {first[0].get('name')!r} lets the base float already; "
            "leave `floating` out"
        )
    if base == _GROUND and len(first) == 1 and first[0].get("type") == "fixed":
        first[0].set("type", "floating")
        return
    for kind, name in (("joint", FREE_JOINT), ("link", _GROUND)):
        if any(element.get("name") == name for element in root.findall(kind)):
            raise RobotError(
                f"{urdf}: robot.floating: {kind} {name!r} is there, which is the name of the free "
                f"base's; rename it in the URDF"
            )
    joint = ElementTree.Element("joint", name=FREE_JOINT, type="floating")
    ElementTree.SubElement(joint, "parent", link=_GROUND)
    ElementTree.SubElement(joint, "child", link=base)
    root.insert(0, joint)
    root.insert(0, ElementTree.Element("link", name=_GROUND))


def free_joint(model: pin.Model) -> str:
    """Return the name of the joint that lets the whole robot float; "": its base is fixed."""
    roots = [j for j in range(1, model.njoints) if not int(model.parents[j])]
    if len(roots) == 1 and model.joints[roots[0]].shortname() == "JointModelFreeFlyer":
        return str(model.names[roots[0]])
    return ""
