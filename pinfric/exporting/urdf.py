"""A scene's own URDF, with constants of friction in `<dynamics>`, locked joints fixed."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pinfric.errors import PinfricError, PinfricWarning
from pinfric.exporting.constants import JointConstants
from pinfric.exporting.mjcf import numbers, xml_comment, xml_text
from pinfric.exporting.tree import drake_rotor, rotor_inertias
from pinfric.model.mimics import lock_joints
from pinfric.model.robot import changed_parts, inertia_matrix, read_robot
from pinfric.model.scene import Scene
from pinfric.model.schema import Payload
from pinfric.model.urdf import check_urdf

#: The namespace of Drake's own tags.
_DRAKE = "http://drake.mit.edu"


def urdf(
    scene: Scene, joints: Sequence[JointConstants], lines: Mapping[str, str], header: Sequence[str]
) -> str:
    """Return the scene's URDF, with constants in place of its `<dynamics>`.

    Locked joints are fixed, payloads that the scene carries by default are links of their own,
    meshes keep their places.

    Raises:
        PinfricError: the scene has no URDF, or its model is not that of its URDF.
    """
    robot = scene.robot
    if robot is None:
        raise PinfricError(
            f"{scene.source}: has no URDF to write constants into (a model made in Python); export "
            "to mjcf, which is written from the model"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)
        file = read_robot(robot.urdf, robot.locked, robot.xacro_args, robot.floating).model
    file.gravity = scene.model.gravity  # a URDF has none
    if changed := changed_parts(scene.model, file):
        raise PinfricError(
            f"{scene.source}: scene.model is not the one of {Path(robot.urdf).name} "
            f"({', '.join(changed)}), whose URDF this writes; export to mjcf, which is written "
            "from the model"
        )
    root = robot.xml()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)  # said when the scene was read
        check_urdf(root, robot.urdf)
    lock_joints(root, robot.locked, robot.urdf)
    constants = {joint.joint: joint for joint in joints if joint.moving}
    for element in root.findall("joint"):
        name = str(element.get("name"))
        for old in element.findall("dynamics"):
            element.remove(old)
        if name in lines:
            root.insert(list(root).index(element), xml_comment(lines[name]))
        if name in constants:
            constant = constants[name]
            ElementTree.SubElement(
                element,
                "dynamics",
                damping=repr(constant.damping),
                friction=repr(constant.frictionloss),
            )
    _add_rotors(root, joints, rotor_inertias(scene).tolist())
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if name and "://" not in name:  # beside the file that it was named in
            mesh.set("filename", str((robot.urdf.parent / name).resolve()))
    for name, payload in scene.payloads.items():
        if payload.attached:
            root.extend(_payload(name, payload))
    for row, line in enumerate(header):
        root.insert(row, xml_comment(line))
    return xml_text(root)


def _add_rotors(
    root: ElementTree.Element, joints: Sequence[JointConstants], reflected: Sequence[float]
) -> None:
    """Write Drake's tags of rotors into the joints' transmissions, which are made if missing.

    Tags of one namespace get one prefix in the written file, whichever they had.
    """
    spaces = {tag[1:].partition("}")[0] for tag in (x.tag for x in root.iter()) if "}" in str(tag)}
    space = next((uri for uri in sorted(spaces) if "drake" in uri), _DRAKE)
    ElementTree.register_namespace("drake", space)
    stated = {x.get("name"): up for up in root.findall("transmission") for x in up.findall("joint")}
    for joint, inertia in zip(joints, reflected, strict=True):
        tags, transmission = drake_rotor(joint, inertia), stated.get(joint.joint)
        if not tags:
            continue
        if transmission is None:
            name = f"{joint.joint}_transmission"
            transmission = ElementTree.SubElement(root, "transmission", name=name)
            kind = ElementTree.SubElement(transmission, "type")
            kind.text = "transmission_interface/SimpleTransmission"
            ElementTree.SubElement(transmission, "joint", name=joint.joint)
        actuator = transmission.find("actuator")
        if actuator is None:
            actuator = ElementTree.SubElement(transmission, "actuator", name=joint.joint)
        for tag, value in tags.items():
            full = f"{{{space}}}{tag.partition(':')[2]}"
            for old in actuator.findall(full):
                actuator.remove(old)
            ElementTree.SubElement(actuator, full, value=value)


def _payload(name: str, payload: Payload) -> tuple[ElementTree.Element, ElementTree.Element]:
    link = ElementTree.Element("link", name=f"payload_{name}")
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=numbers(payload.com))
    ElementTree.SubElement(inertial, "mass", value=repr(payload.mass))
    inertia = inertia_matrix(payload)[np.triu_indices(3)].tolist()
    moments = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia, strict=True)
    ElementTree.SubElement(inertial, "inertia", {key: repr(value) for key, value in moments})
    joint = ElementTree.Element("joint", name=f"payload_{name}_fixed", type="fixed")
    ElementTree.SubElement(joint, "parent", link=payload.link)
    ElementTree.SubElement(joint, "child", link=f"payload_{name}")
    return link, joint
