"""The scene's own URDF, written and read back."""

import dataclasses
import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from export_cases import moved
from numpy.testing import assert_allclose

import pinfric as pf


def test_a_urdf_read_back_misses_what_was_stated(tmp_path):
    """With ideal drives only the constants differ."""
    base = pf.load_scene("panda_pick_and_place")
    box = {"box": base.payloads["box"].model_copy(update={"attached": True})}
    scene = base.with_(actuators=None, payloads=box)
    motion = pf.load_trajectory("panda_pick_and_place.csv", scene)
    motion = dataclasses.replace(motion, attached=np.ones_like(motion.attached))
    made = pf.export(scene, motion, "urdf")
    made.write(tmp_path / "panda.urdf")
    text = "pinfric: 1\nrobot: {urdf: panda.urdf, urdf_dynamics: use}\n"
    (tmp_path / "again.yaml").write_text(text)
    again = pf.load_scene(tmp_path / "again.yaml")
    same = scene.loaded_model()
    for ours, theirs in zip(again.model.inertias, same.inertias, strict=True):
        assert_allclose(ours.toDynamicParameters(), theirs.toDynamicParameters(), atol=1e-12)
    efforts = pf.inverse_dynamics(again, motion.q, motion.v, motion.a, t=motion.t)
    wanted = pf.inverse_dynamics(scene, motion)
    for d, joint in enumerate(made.joints):
        moving = (motion.v[:, d] != 0.0) & (wanted.effort_lower == wanted.effort_upper)[:, d]
        missed = (efforts.effort_lower - wanted.effort_lower)[moving, d]
        assert moving.any() != joint.unmoved
        if not joint.unmoved:
            assert np.abs(missed).max() == pytest.approx(joint.error_peak)
            assert np.sqrt(np.mean(missed**2)) == pytest.approx(joint.error_rms)
        else:
            assert joint.joint in again.friction


@pytest.mark.parametrize("stated", ["", "_other"])
def test_rotors_stand_in_transmissions_as_drake_reads_them(tmp_path, stated):
    """In the joint's own transmission, or in a new one."""
    text = (Path(pf.load_scene("three_link").robot.urdf)).read_text()
    first = pf.load_scene("three_link").joint_names[0]
    own = (
        f'<transmission name="its"><joint name="{first}{stated}"/><actuator name="m">'
        '<d:gear_ratio value="3"/></actuator></transmission></robot>'
    )
    text = text.replace("<robot", '<robot xmlns:d="http://drake.mit.edu"', 1)
    (tmp_path / "arm.urdf").write_text(text.replace("</robot>", own))
    gear = f"{{joint: {first}, transmission: {{ratio: 50, rotor_inertia: 2e-4}}}}"
    (tmp_path / "arm.yaml").write_text(
        f"pinfric: 1\nrobot: {{urdf: arm.urdf, urdf_dynamics: ignore}}\nactuators: [{gear}]\n"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = pf.load_scene(tmp_path / "arm.yaml")
    made = pf.export(scene.with_(actuators=[*scene.actuators, *rest(scene, first)]), to="urdf").text
    root = ElementTree.fromstring(made)
    assert 'xmlns:drake="http://drake.mit.edu"' in made
    found = {x.find("joint").get("name"): x for x in root.findall("transmission")}
    actuator = found[first].find("actuator")
    values = {x.tag.rpartition("}")[2]: float(x.get("value")) for x in actuator}
    assert values == {"rotor_inertia": 2e-4, "gear_ratio": 50.0}
    assert len(found) == 1 + bool(stated)


def rest(scene, name):
    return [{"joint": other} for other in scene.joint_names if other != name]


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_locked_joints_are_fixed_where_they_are_locked(tmp_path, kind):
    body = (
        '<inertial><origin xyz="0.1 0.2 0.3"/><mass value="1"/><inertia ixx="1" iyy="1" '
        'izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    limit = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="arm"><link name="a"/><link name="b">{body}</link><link name="c">{body}'
        '<visual><geometry><mesh filename="c.stl"/></geometry></visual></link>'
        f'<joint name="locked" type="{kind}"><parent link="a"/><child link="b"/>{limit}'
        '<origin xyz="1 2 3" rpy="0.3 0.2 0.1"/><axis xyz="0 3 4"/>'
        '<dynamics damping="9" friction="8"/></joint>'
        f'<joint name="free" type="revolute"><parent link="b"/><child link="c"/>{limit}'
        '<axis xyz="1 0 0"/><dynamics damping="7" friction="6"/></joint></robot>'
    )
    (tmp_path / "arm.yaml").write_text(
        "pinfric: 1\nrobot: {urdf: arm.urdf, locked: {locked: 0.7}, urdf_dynamics: ignore}\n"
        "friction: {free: {coulomb: {static: 3, kinetic: 2}}}\n"
    )
    with pytest.warns(pf.PinfricWarning, match="no mesh"):
        scene = pf.load_scene(tmp_path / "arm.yaml")
    made = pf.export(scene, moved(scene), "urdf")
    assert made.text.count("<dynamics ") == 1
    mesh = ElementTree.fromstring(made.text).find(".//mesh").get("filename")
    assert mesh == str(tmp_path / "c.stl")
    again = pin.buildModelFromXML(made.text)
    assert tuple(again.names)[1:] == ("free",)
    for ours, theirs in zip(again.jointPlacements, scene.model.jointPlacements, strict=True):
        assert_allclose(ours.homogeneous, theirs.homogeneous, atol=1e-12)
