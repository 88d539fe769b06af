"""SDF, Gazebo's and Drake's format: SDFormat 1.7, 1.11 with mimic joints.

Gazebo's engines hold joints by up to `friction`; Drake reads `damping` only, and rotors by its own
keys.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinfric.exporting.constants import JointConstants
from pinfric.exporting.mjcf import numbers, xml_comment, xml_text
from pinfric.exporting.tree import MovedBody, bodies, drake_rotor, rotor_inertias
from pinfric.model.scene import Scene


def sdf(
    scene: Scene, joints: Sequence[JointConstants], lines: Mapping[str, str], header: Sequence[str]
) -> str:
    """Return a robot as SDF: links with masses, joints with limits and constants; no shapes.

    Args:
        scene: with the payloads that it carries by default.
    """
    tree = bodies(scene)
    # <mimic> came with 1.11
    following = any(body.follows for body in tree)
    space = {"version": "1.11" if following else "1.7", "xmlns:drake": "drake.mit.edu"}
    root = ElementTree.Element("sdf", space)
    root.extend(xml_comment(line) for line in header)
    model = ElementTree.SubElement(root, "model", name=Path(scene.source).stem)
    by_name = {joint.joint: joint for joint in joints}
    rotors = dict(zip(by_name, rotor_inertias(scene).tolist(), strict=True))
    # names of links and joints are one set there
    named = {body.joint.name for body in tree}
    links = [body.link if body.link not in named else f"{body.link}_link" for body in tree]
    for body, name in zip(tree, links, strict=True):
        link = ElementTree.SubElement(model, "link", name=name)  # in the frame of its joint
        _text(link, "pose", numbers([0.0] * 6), relative_to=body.joint.name)
        inertial = ElementTree.SubElement(link, "inertial")
        _text(inertial, "pose", numbers([*body.inertia.lever, 0.0, 0.0, 0.0]))
        _text(inertial, "mass", numbers([body.inertia.mass]))
        inertia, I = ElementTree.SubElement(inertial, "inertia"), body.inertia.inertia  # noqa: E741
        for i, k in combinations_with_replacement(range(3), 2):
            _text(inertia, f"i{'xyz'[i]}{'xyz'[k]}", numbers([I[i, k]]))
    springs = scene.twin().springs
    for row, (body, name) in enumerate(zip(tree, links, strict=True)):
        own = by_name.get(body.joint.name)
        if own is not None:
            model.append(xml_comment(lines[own.joint]))
        ends = "world" if body.parent < 0 else links[body.parent], name
        coil = None if springs is None else springs.in_joint(row)
        model.append(element := _joint(body, ends, own, coil))
        if own is not None:
            for tag, value in drake_rotor(own, rotors[own.joint]).items():
                _text(element, tag, value)
    return xml_text(root)


def _joint(
    body: MovedBody,
    ends: tuple[str, str],
    constants: JointConstants | None,
    coil: tuple[float, float] | None,
) -> ElementTree.Element:
    """A joint between two links (parent, child), with its spring; a follower has no constants."""
    parent, child = ends
    kind = "prismatic" if body.joint.unit == "m" else "revolute"
    joint = ElementTree.Element("joint", name=body.joint.name, type=kind)
    _text(
        joint,
        "pose",
        numbers([*body.placement.translation, *pin.rpy.matrixToRpy(body.placement.rotation)]),
        relative_to="__model__" if parent == "world" else parent,
    )
    _text(joint, "parent", parent)
    _text(joint, "child", child)
    axis = ElementTree.SubElement(joint, "axis")
    _text(axis, "xyz", numbers(body.axis))
    limit = ElementTree.SubElement(axis, "limit")
    for tag, bound in (("lower", body.joint.lower), ("upper", body.joint.upper)):
        _text(limit, tag, numbers([bound if np.isfinite(bound) else np.copysign(1e16, bound)]))
    if np.isfinite(body.effort_limit):
        _text(limit, "effort", numbers([body.effort_limit]))
    if np.isfinite(body.joint.velocity_limit):
        _text(limit, "velocity", numbers([body.joint.velocity_limit]))
    if body.follows is not None:
        leader, ratio, shift = body.follows
        mimic = ElementTree.SubElement(axis, "mimic", joint=leader)
        for tag, value in (("multiplier", ratio), ("offset", shift), ("reference", 0.0)):
            _text(mimic, tag, numbers([value]))
        law = {"joint": leader, "multiplier": repr(ratio), "offset": repr(shift)}
        ElementTree.SubElement(joint, "drake:mimic", law)  # Drake reads no other
    if constants is None and coil is None:
        return joint
    dynamics = ElementTree.SubElement(axis, "dynamics")
    if constants is not None:
        _text(dynamics, "damping", numbers([constants.damping]))
        _text(dynamics, "friction", numbers([constants.frictionloss]))
    if coil is not None:
        _text(dynamics, "spring_stiffness", numbers(coil[:1]))
        _text(dynamics, "spring_reference", numbers(coil[1:]))
    return joint


def _text(parent: ElementTree.Element, tag: str, text: str, **attributes: str) -> None:
    ElementTree.SubElement(parent, tag, attributes).text = text
