"""A robot's free base: `robot.floating`, without another URDF, and its motion as six numbers."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.errors import RobotError
from pinfric.model.mimics import link_of

#: The joint of the free base and the link that it stands on, as Pinocchio and ROS call them.
FREE_JOINT, _GROUND = "root_joint", "world"
#: Attributes of a floating joint: where its file begins the base, and how it is turned.
START = ("start_xyz", "start_rpy")
#: What a file calls the six numbers of a free base, behind its joint's name: m, then rad.
POSE = ("x", "y", "z", "roll", "pitch", "yaw")
#: rad; nearer to a right angle a base's roll and yaw are not determined.
MOST_PITCH = math.radians(85.0)


def set_base(root: ElementTree.Element, urdf: Path, floating: bool | None) -> None:
    """Free or fix the base of a robot; `root`, checked, is changed in place.

    A joint of type floating is put before the root link. A root link without mass that is called
    `world` stays: the joint that fixes the robot to it becomes the floating one. A base is fixed
    where the file begins it (`START`), else at the root link.

    Args:
        floating: whether the base floats; None: as the file says.

    Raises:
        RobotError: more than the base floats already, or its joint's name is taken.
    """
    if floating is None:
        return
    joints = root.findall("joint")
    carried = {link_of(joint, "child") for joint in joints}
    base = next(x for link in root.findall("link") if (x := link.attrib["name"]) not in carried)
    first = [joint for joint in joints if link_of(joint, "parent") == base]
    free = [joint for joint in first if joint.get("type") == "floating"]
    if free and len(first) > 1:
        other = next(joint for joint in first if joint is not free[0])
        raise RobotError(
            f"{urdf}: robot.floating: joint {free[0].get('name')!r} lets one part float, and joint "
            f"{other.get('name')!r} begins at the ground, too: this is no one base; lock one of "
            "them (robot.locked), or take it out of the file"
        )
    if free and not floating:
        free[0].set("type", "fixed")
        for key in START:
            origin = free[0].find("origin")
            if key in free[0].attrib and origin is not None:
                origin.set(key.removeprefix("start_"), free[0].attrib.pop(key))
    if free or not floating:
        return
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


def stands(scene: Any) -> bool:
    """Return whether a scene's base floats and nothing drives it: forces at its feet hold it."""
    return bool(free_joint(scene.model)) and set(range(6)) <= set(scene.mobility.undriven)


def base_numbers(q: np.ndarray) -> np.ndarray:
    """Return a free base's numbers (T, 6), `POSE`, from its q (T, 7): R = R_z(yaw) R_y R_x(roll).

    Roll and yaw are continuous, the first within +-pi; pitch is within +-pi/2.
    """
    x, y, z, w = q[:, 3:7].T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    turned = np.unwrap(np.column_stack([roll, pitch, yaw]), axis=0)
    return np.column_stack([q[:, :3], turned])


def base_configuration(numbers: np.ndarray) -> np.ndarray:
    """Return a free base's q (T, 7): position, and quaternion x, y, z, w; numbers is (T, 6)."""
    half = 0.5 * numbers[:, 3:]
    (sr, sp, sy), (cr, cp, cy) = np.sin(half).T, np.cos(half).T
    turned = (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
    return np.column_stack([numbers[:, :3], *turned])


def base_motion(
    numbers: np.ndarray, rates: np.ndarray, accelerations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a free base's v, a (T, 6) in its own axes, linear first, from those of its numbers.

    v = (R^T p', w), w = E (roll', pitch', yaw'); a = (R^T p'' - w x R^T p', E (..)'' + E' (..)').
    """
    R, E, dE = _turning(numbers, rates[:, 3:])
    linear = np.einsum("tji,tj->ti", R, rates[:, :3])
    angular = np.einsum("tij,tj->ti", E, rates[:, 3:])
    bent = np.einsum("tji,tj->ti", R, accelerations[:, :3]) - np.cross(angular, linear)
    turned = np.einsum("tij,tj->ti", E, accelerations[:, 3:])
    turned += np.einsum("tij,tj->ti", dE, rates[:, 3:])
    return np.hstack([linear, angular]), np.hstack([bent, turned])


def base_rates(numbers: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two derivatives (T, 6) of a free base's numbers: see `base_motion`."""
    E = _turning(numbers, np.zeros((len(v), 3)))[1]
    turning = np.linalg.solve(E, v[:, 3:, None])[:, :, 0]
    R, E, dE = _turning(numbers, turning)
    linear = np.einsum("tij,tj->ti", R, v[:, :3])
    bent = np.einsum("tij,tj->ti", R, a[:, :3] + np.cross(v[:, 3:], v[:, :3]))
    rest = a[:, 3:] - np.einsum("tij,tj->ti", dE, turning)
    turned = np.linalg.solve(E, rest[:, :, None])[:, :, 0]
    return np.hstack([linear, turning]), np.hstack([bent, turned])


def _turning(numbers: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return R, E and E' (T, 3, 3) at a base's numbers and the rates of its three angles."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(numbers[:, 3:]).T, np.cos(numbers[:, 3:]).T
    dr, dp, _ = rates.T
    one, zero = np.ones_like(sr), np.zeros_like(sr)
    R = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    E = [[one, zero, -sp], [zero, cr, cp * sr], [zero, -sr, cp * cr]]
    dE = [
        [zero, zero, -cp * dp],
        [zero, -sr * dr, cp * cr * dr - sp * sr * dp],
        [zero, -cr * dr, -cp * sr * dr - sp * cr * dp],
    ]
    first, second, third = (np.moveaxis(np.array(x), 2, 0) for x in (R, E, dE))
    return first, second, third
