"""Robot files: xacro with and without its extra, and files that are no URDF."""

import re

import pytest
from tables import table

import pinfric as pf
from pinfric.errors import PinfricWarning, RobotError
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


GRIPPER = f"""<robot {NAMESPACE}><link name="$(arg grip)"/>
  <joint name="hold" type="fixed"><parent link="rod"/><child link="$(arg grip)"/></joint></robot>"""


@pytest.fixture
def gripped(arm):
    """The arm with another package's gripper, and an argument without default."""
    found = '<xacro:include filename="$(find gripper)/grip.xacro"/>'
    arm.write_text(ARM.replace('<link name="base"/>', f'<link name="base"/>{found}'))
    return arm


def test_arguments_are_given_and_packages_found_beside_what_is_above(gripped, tmp_path):
    pytest.importorskip("xacrodoc")
    (tmp_path / "gripper").mkdir()
    (tmp_path / "gripper/grip.xacro").write_text(GRIPPER)
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "pinfric: 1\nrobot: {urdf: arm.urdf.xacro, xacro_args: {load: 2, grip: fingers}}"
    )
    model = pf.load_scene(scene).model
    assert model.inertias[1].mass == 4.0
    assert model.existFrame("fingers")
    given = {"load": "0.5", "grip": "a"}
    assert pf.check(gripped, given).figures["moving_mass"] == 1.0
    with pytest.raises(RobotError, match=r"'grip' has no default: give it by --xacro-arg grip:="):
        read_robot(gripped, {})
    with pytest.raises(RobotError, match=r"there is no argument 'laod'; it has grip, load$"):
        read_robot(gripped, {}, {**given, "laod": "1"})
    (tmp_path / "plain.urdf").write_text('<robot name="r"><link name="base"/></robot>')
    with pytest.raises(RobotError, match=r"plain.urdf: is no xacro, and has no argument 'load'"):
        read_robot(tmp_path / "plain.urdf", {}, given)


def test_a_package_that_is_not_there_is_named_with_where_it_was_looked_for(gripped, monkeypatch):
    pytest.importorskip("xacrodoc")
    monkeypatch.setenv("ROS_PACKAGE_PATH", "/opt/ros")
    says = f"no package 'gripper': looked for a folder of this name in {gripped.parent} and all "
    with pytest.raises(RobotError, match=says + r".*ROS_PACKAGE_PATH \(/opt/ros\)") as told:
        read_robot(gripped, {})
    assert "\n" not in str(told.value)


@pytest.mark.filterwarnings("ignore:.*there is no mesh")
@pytest.mark.parametrize(
    ("left", "reads"),
    [
        ('<xacro:include filename="$(find gripper)/grip.xacro"/>', True),
        (
            '<link name="a"><visual><geometry><mesh filename="$(find gripper)/a.stl"/></geometry>'
            '</visual></link><joint name="f" type="fixed"><parent link="base"/><child link="a"/>'
            "</joint>",
            True,
        ),
        ('<link name="${prefix}tip"/>', False),
    ],
)
def test_tags_left_over_in_a_urdf_are_a_warning(tmp_path, left, reads):
    text = f"""<robot name="arm" {NAMESPACE}>{left}<link name="base"/>
      <link name="rod"><inertial><mass value="2"/>{BODY}</inertial></link>
      <joint name="swing" type="continuous"><parent link="base"/><child link="rod"/></joint>
      </robot>"""
    file = tmp_path / "arm.urdf"
    file.write_text(text)
    if not reads:
        with pytest.raises(RobotError, match="is xacro and does not expand"):
            read_robot(file, {})
        return
    with pytest.warns(PinfricWarning, match="tags of xacro are left in it.* no package 'gripper'"):
        assert read_robot(file, {}).model.inertias[1].mass == 2.0
    assert "reading" in {finding.kind for finding in pf.check(file).findings}
    file.write_text(text.replace(NAMESPACE, ""))  # its prefix is not declared
    if "<xacro:" in left:
        with pytest.warns(PinfricWarning, match="tags of xacro are left in it.*unbound prefix"):
            assert read_robot(file, {}).model.inertias[1].mass == 2.0


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


CASES = """
load_yaml('a.yaml')       root: [secret: x: y  ParserError when evaluating
load_yaml('a.yaml')[0].x  [secret]             Error when evaluating
load_yaml('a.yaml')['k']  k: ${secret}         evaluated to "${...}", which is not
load_yaml('a.yaml')       !degrees secret      name '...' is not defined
load_yaml('a.yaml')       secret               evaluated to "...", which is not
load_yaml('a.txt')        secret               load_yaml takes .yaml and .yml only when
load_yaml('b.yaml')       secret               load_yaml takes .yaml and .yml only when
"""


@pytest.mark.parametrize(
    ("wrong", "content", "says"),
    table(CASES),
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


def test_what_a_yaml_file_gives_for_a_number_is_not_quoted_by_later_errors(arm):
    pytest.importorskip("xacrodoc")
    (arm.parent / "a.yaml").write_text("{k: secret, m: 2.5e0}")
    load = "${xacro.load_yaml('a.yaml')['%s']}"
    mass = '"${2 * $(arg load)}"'
    assert mass in ARM
    arm.write_text(ARM.replace(mass, f'"{load % "m"}"'))
    assert read_robot(arm, {}).model.inertias[1].mass == 2.5
    arm.write_text(ARM.replace(mass, f'"{load % "k"}"'))
    with pytest.raises(RobotError, match=r"<mass value='\.\.\.'> should be a finite"):
        read_robot(arm, {})


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
