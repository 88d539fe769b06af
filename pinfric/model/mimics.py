"""Mimic joints of a URDF, written so that Pinocchio reads them, and locked joints.

A follower moves as q_i = k_i q + o_i with its leader's q. Pinocchio needs one leader that is no
follower, turns within limits or slides, and is numbered before its followers.
"""

from __future__ import annotations

import math
import sys
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.errors import FindingWarning, PinfricWarning, RobotError, choose_from
from pinfric.model.mjcf import MARK

#: Joints of several degrees of freedom; `ball` is an MJCF's.
SEVERAL = ("planar", "floating", "ball")
#: Share by which a follower that is locked beside its leader may be off its place.
_SAME_PLACE = 1e-9


class Mimic(NamedTuple):
    """The joint that a follower follows: position = multiplier * the leader's + offset."""

    joint: str
    multiplier: float
    offset: float


def followers(root: ElementTree.Element) -> dict[str, Mimic]:
    """Return joint -> the joint it mimics."""
    return {
        joint.attrib["name"]: Mimic(
            mimic.attrib["joint"],
            float(mimic.get("multiplier", 1.0)),
            float(mimic.get("offset", 0.0)),
        )
        for joint in root.findall("joint")
        if (mimic := joint.find("mimic")) is not None
    }


def lost_leaders(root: ElementTree.Element) -> dict[str, str]:
    """Return joint -> the joint it mimics, for joints that mimic an unknown joint."""
    joints = {joint.get("name") for joint in root.findall("joint")}
    return {
        str(joint.get("name")): str(mimic.get("joint"))
        for joint in root.findall("joint")
        for mimic in joint.findall("mimic")
        if joint.get("type") != "fixed" and mimic.get("joint") not in joints
    }


def settle_mimics(root: ElementTree.Element, urdf: Path) -> None:
    """Write the mimic tags of a checked URDF as Pinocchio reads them; `root` is changed in place.

    Chains become one tag, q_c = k_cb (k_ba q_a + o_ba) + o_cb. A follower of a fixed joint, or with
    the multiplier 0, is fixed at its offset; one without a leader moves by itself; both with a
    warning. A continuous joint that leads or follows becomes a revolute one without limits, whose
    position is one number. A tag on a fixed joint is removed.

    Raises:
        RobotError: a ring of mimics, a leader of several degrees of freedom or beyond its follower.
    """
    joints = {joint.attrib["name"]: joint for joint in root.findall("joint")}
    lost = lost_leaders(root)
    for name, joint in joints.items():
        for tag in joint.findall("mimic"):
            if name in lost or joint.get("type") == "fixed":
                joint.remove(tag)
    if lost:
        _warn_of_lost(lost, urdf)
    flat = _flattened(followers(root), urdf)
    above = _joints_above(joints)
    standing = []
    for name, mimic in flat.items():
        leader, joint = joints[mimic.joint], joints[name]
        where = f"{urdf}: joint {name!r} mimics {mimic.joint!r}"
        for one, called in (leader, mimic.joint), (joint, name):
            if one.get("type") in SEVERAL:
                raise RobotError(
                    f"{where}, and {called!r} is {one.get('type')}: joints of one degree of "
                    "freedom lead and follow"
                )
        if leader.get("type") == "fixed" or mimic.multiplier == 0.0:
            fix_joint(joint, mimic.offset)
            standing.append(f"{name!r} at {mimic.offset:g}")
            continue
        if name in above[mimic.joint]:
            raise RobotError(
                f"{where}, which {name!r} carries: a leader stands nearer to the root or on "
                f"another branch; let {mimic.joint!r} mimic {name!r}"
            )
        for tag in joint.findall("mimic"):
            tag.set("joint", mimic.joint)
            tag.set("multiplier", repr(mimic.multiplier))
            tag.set("offset", repr(mimic.offset))
        for one in (leader, joint):
            _make_revolute(one)
    if standing:
        warnings.warn(
            f"{urdf}: {', '.join(standing)}: what these joints mimic is fixed, or their multiplier "
            "is 0; they stand at their offset",
            PinfricWarning,
            stacklevel=5,
        )


def _warn_of_lost(lost: Mapping[str, str], urdf: Path) -> None:
    name, leader = next(iter(lost.items()))
    others = f" (and {len(lost) - 1} more joints have no leader)" if len(lost) > 1 else ""
    warnings.warn(
        f"{urdf}: joint {name!r} mimics {leader!r}, which is not there{others}; a joint without "
        "leader moves independently, with its own drive",
        FindingWarning,
        stacklevel=6,
    )


def _flattened(mimics: Mapping[str, Mimic], urdf: Path) -> dict[str, Mimic]:
    """Each follower with the first joint of its chain, which follows none."""
    flat = {}
    for name, mimic in mimics.items():
        passed = [name]
        while mimic.joint in mimics:
            if mimic.joint in passed:
                ring = passed[passed.index(mimic.joint) :]
                each = " mimics ".join(map(repr, [*ring, ring[0]]))
                itself = f"joint {name!r} mimics itself" if len(ring) == 1 else f"{each}: a ring"
                raise RobotError(f"{urdf}: {itself}; one of them must lead")
            passed.append(mimic.joint)
            of = mimics[mimic.joint]
            mimic = Mimic(
                of.joint,
                mimic.multiplier * of.multiplier,
                mimic.multiplier * of.offset + mimic.offset,
            )
        flat[name] = mimic
    return flat


def _make_revolute(joint: ElementTree.Element) -> None:
    """Make a continuous joint a revolute one whose limits are the largest float: none."""
    if joint.get("type") != "continuous":
        return
    joint.set("type", "revolute")
    limit = joint.find("limit")
    none = repr(sys.float_info.max)
    if limit is None:
        limit = ElementTree.SubElement(joint, "limit", effort=none, velocity=none)
    limit.attrib.update(lower=f"-{none}", upper=none)


def lock_joints(root: ElementTree.Element, locked: Mapping[str, float], urdf: Path) -> None:
    """Fix joints of a checked URDF at positions (rad or m), and their followers with them.

    Raises:
        RobotError: an unknown joint, one of several degrees of freedom, or a follower without its
            leader or off its place.
    """
    movable = {j.attrib["name"]: j for j in root.findall("joint") if j.get("type") != "fixed"}
    mimics = followers(root)
    for name, position in locked.items():
        if name not in movable:
            raise RobotError(
                f"robot.locked: {urdf} has no joint {name!r}; {choose_from(name, movable)}"
            )
        if movable[name].get("type") in SEVERAL:
            raise RobotError(f"robot.locked.{name}: only one-degree joints can be locked")
        if (mimic := mimics.get(name)) is not None:
            place = mimic.multiplier * locked.get(mimic.joint, math.nan) + mimic.offset
            if not abs(place - position) <= _SAME_PLACE * (1 + abs(position)):
                raise RobotError(
                    f"robot.locked.{name}: {urdf} lets it follow {mimic.joint!r}, "
                    f"{mimic.multiplier:g} x its position {mimic.offset:+g}: lock "
                    f"{mimic.joint!r}, and it stands, too"
                )
    for name, mimic in mimics.items():
        if mimic.joint in locked:
            fix_joint(movable[name], mimic.multiplier * locked[mimic.joint] + mimic.offset)
    for name, position in locked.items():
        fix_joint(movable[name], position)


def fix_joint(joint: ElementTree.Element, position: float) -> None:
    """Make a joint of one degree of freedom a fixed one at a position (rad or m)."""
    if joint.get("type") == "fixed":
        return
    origin, axis_tag = joint.find("origin"), joint.find("axis")
    if origin is None:
        origin = ElementTree.SubElement(joint, "origin")
    place, angles = (
        np.array(origin.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy")
    )
    axis = np.array(("1 0 0" if axis_tag is None else axis_tag.attrib["xyz"]).split(), dtype=float)
    axis /= np.linalg.norm(axis)
    turn = pin.rpy.rpyToMatrix(*angles)
    if joint.get("type") == "prismatic":
        place = place + turn @ axis * position
    else:
        turn = turn @ pin.exp3(axis * position)
    origin.set("xyz", " ".join(repr(float(x)) for x in place))
    origin.set("rpy", " ".join(repr(float(x)) for x in pin.rpy.matrixToRpy(turn)))
    joint.set("type", "fixed")
    for tag in ("axis", "limit", "mimic", "safety_controller", "calibration"):
        for old in joint.findall(tag):
            joint.remove(old)


def numbers_before_names(root: ElementTree.Element, urdf: Path) -> dict[str, str]:
    """Return joint -> prefix of its name by which leaders come first; empty if none is needed.

    Pinocchio visits joints depth first, those of one link in alphabetical order, and needs leaders
    first. So of two joints on one link, that with a leader at or beyond it comes before that with
    the follower. Those of an MJCF stand in the order of the file, as MuJoCo has them.

    Raises:
        RobotError: no order has each leader before its followers.
    """
    mimics, in_order = followers(root), MARK in root.attrib
    if not mimics and not in_order:
        return {}
    joints = {joint.attrib["name"]: joint for joint in root.findall("joint")}
    above = _joints_above(joints)
    siblings: dict[str, list[str]] = {}
    for name in joints if in_order else sorted(joints):
        siblings.setdefault(link_of(joints[name], "parent"), []).append(name)
    numbers: dict[str, str] = {}
    needed = False
    for beside in siblings.values():
        before: dict[str, set[str]] = {name: set() for name in beside}
        for follower, mimic in mimics.items():
            for late in {follower, *above[follower]} & before.keys():
                early = {mimic.joint, *above[mimic.joint]} & before.keys()
                before[late] |= early - {late}
        order: list[str] = []
        for name in beside:
            _place(name, before, order, [], urdf)
        needed |= order != sorted(beside)
        numbers |= {name: f"{rank:06d} " for rank, name in enumerate(order)}
    return numbers if needed else {}


def _place(
    name: str, before: Mapping[str, set[str]], order: list[str], waiting: list[str], urdf: Path
) -> None:
    """Append a joint to `order`, and first those that have to come before it."""
    if name in waiting:
        names = " and ".join(map(repr, waiting[waiting.index(name) :]))
        raise RobotError(
            f"{urdf}: {names} carry leaders of each other's followers: Pinocchio needs each "
            "leader first; let one of them lead"
        )
    for early in sorted(before[name]):
        _place(early, before, order, [*waiting, name], urdf)
    if name not in order:
        order.append(name)


def link_of(joint: ElementTree.Element, end: str) -> str:
    """Return the name of a joint's `parent` or `child` link, which was checked to exist."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _joints_above(joints: Mapping[str, ElementTree.Element]) -> dict[str, list[str]]:
    """The joints between each joint and the root, nearest first."""
    carrying = {link_of(joint, "child"): name for name, joint in joints.items()}
    above = {}
    for name in joints:
        chain = [name]
        while (up := carrying.get(link_of(joints[chain[-1]], "parent"))) is not None:
            chain.append(up)
        above[name] = chain[1:]
    return above
