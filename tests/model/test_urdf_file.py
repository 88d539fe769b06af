"""Files a robot is read from: xacro with and without its extra, and what is no URDF."""

from __future__ import annotations

import re

import pytest

import pinfric as pf
from pinfric.errors import RobotError
from pinfric.model.robot import read_robot
from pinfric.model.urdf_file import read_xml

BODY = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
PARTS = f"""<robot {NAMESPACE}>
  <xacro:macro name="rod" params="name mass"><link name="${{name}}">
    <inertial><mass value="${{mass}}"/>{BODY}</inertial></link></xacro:macro></robot>"""
ARM = f"""<robot name="arm" {NAMESPACE}>
  <xacro:include filename="parts/rod.xacro"/>
  <xacro:arg name="load" default="1.5"/>
  <link name="base"/>
  <xacro:rod name="rod" mass="${{2 * {{load}}}}"/>
  <joint name="swing" type="revolute"><parent link="base"/><child link="rod"/>
    <axis xyz="0 1 0"/><limit lower="${{-pi}}" upper="${{pi}}" effort="5" velocity="2"/></joint>
</robot>""".replace("{load}", "$(arg load)")


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/rod.xacro").write_text(PARTS)
    (tmp_path / "arm.urdf.xacro").write_text(ARM)
    return tmp_path / "arm.urdf.xacro"


def test_xacro_is_expanded_with_includes_beside_it(arm, tmp_path, monkeypatch):
    pytest.importorskip("xacrodoc")
    monkeypatch.chdir("/")
    robot = read_robot(arm, {})
    assert robot.model.inertias[1].mass == 3.0
    assert robot.model.upperPositionLimit[0] == pytest.approx(3.141592653589793, abs=1e-15)
    assert read_xml(arm).get("name") == "arm"
    scene = tmp_path / "scene.yaml"
    scene.write_text("pinfric: 1\nrobot: {urdf: arm.urdf.xacro}")
    assert pf.load_scene(scene).joint_names == ("swing",)


def test_xacro_that_does_not_expand_says_why(arm, capfd):
    pytest.importorskip("xacrodoc")
    arm.write_text(ARM.replace("${pi}", "${pie}"))
    with pytest.raises(RobotError, match=r"arm\.urdf\.xacro: is xacro and does not.*'pie'") as told:
        read_robot(arm, {})
    assert "\n" not in str(told.value)
    assert capfd.readouterr() == ("", "")


def test_xacro_that_never_ends_is_stopped(arm, monkeypatch):
    pytest.importorskip("xacrodoc")
    monkeypatch.setattr("pinfric.model.urdf_file._PATIENCE", 1)
    arm.write_text(ARM.replace("${pi}", "${9**9**9}"))
    with pytest.raises(RobotError, match=r"arm\.urdf\.xacro: is xacro and does not expand"):
        read_robot(arm, {})
    monkeypatch.setattr("pinfric.model.urdf_file._PATIENCE", 10)
    arm.write_text(ARM.replace("${pi}", "${len('x' * 10**11)}"))
    with pytest.raises(RobotError, match="does not expand: MemoryError when evaluating"):
        read_robot(arm, {})


@pytest.mark.parametrize(
    ("wrong", "content", "says"),
    [
        ("load_yaml('a.yaml')", "root: [secret: x: y", "ParserError when evaluating"),
        ("load_yaml('a.yaml')[0].x", "[secret]", "Error when evaluating"),
        ("load_yaml('a.yaml')['k']", "k: ${secret}", 'evaluated to "${...}", which is not'),
        ("load_yaml('a.yaml')", "!degrees secret", "name '...' is not defined"),
        ("load_yaml('a.yaml')", "secret", 'evaluated to "...", which is not'),
        ("load_yaml('a.txt')", "secret", "load_yaml takes .yaml and .yml only when"),
        ("load_yaml('b.yaml')", "secret", "load_yaml takes .yaml and .yml only when"),
    ],
)
def test_errors_of_xacro_do_not_quote_other_files(arm, wrong, content, says):
    pytest.importorskip("xacrodoc")
    for name in ("a.yaml", "a.txt"):
        (arm.parent / name).write_text(content)
    (arm.parent / "b.yaml").symlink_to("a.txt")
    at = '<link name="base"/>'
    arm.write_text(ARM.replace(at, f'<xacro:if value="${{xacro.{wrong}}}"/>{at}'))
    with pytest.raises(RobotError, match=f"does not expand: .*{re.escape(says)}") as told:
        read_robot(arm, {})
    assert "secret" not in str(told.value)
    assert "\n" not in str(told.value)


def test_xacro_without_its_extra_says_how_to_expand_it(arm, monkeypatch):
    monkeypatch.setattr("pinfric.model.urdf_file.find_spec", lambda name: None)
    says = r"is xacro: install.*pinfric\[xacro\].*xacro arm\.urdf\.xacro > robot\.urdf"
    with pytest.raises(RobotError, match=says):
        read_robot(arm, {})


def test_what_xacro_has_expanded_needs_no_extra(tmp_path, monkeypatch):
    monkeypatch.setattr("pinfric.model.urdf_file.find_spec", lambda name: None)
    file = tmp_path / "robot.urdf"
    file.write_text(f'<robot name="r" {NAMESPACE}><link name="base"/></robot>')
    assert read_xml(file).get("name") == "r"


def test_meshes_are_found_in_the_package_that_the_urdf_lies_in(tmp_path, recwarn):
    """package://NAME/... with the usual NAME/urdf/robot.urdf and NAME/meshes."""
    for folder in ("my_arm/urdf", "my_arm/meshes"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "my_arm/meshes/rod.stl").write_text("solid rod")
    file = tmp_path / "my_arm/urdf/arm.urdf"
    mesh = '<mesh filename="package://my_arm/meshes/rod.stl"/>'
    file.write_text(f"""<robot name="arm"><link name="base"/>
      <link name="rod"><inertial><mass value="1"/>{BODY}</inertial>
        <visual><geometry>{mesh}</geometry></visual></link>
      <joint name="j" type="continuous"><parent link="base"/><child link="rod"/></joint></robot>""")
    read_robot(file, {})
    assert not recwarn.list
