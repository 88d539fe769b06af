"""URDFs that cannot be, and what a scene makes of those that can."""

from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin
import pytest
from builders import chain

import pinfric as pf
from pinfric.errors import PinfricWarning, RobotError, SceneError
from pinfric.model.robot import read_robot
from pinfric.model.urdf import implausible_body

INERTIA = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'


def link(name, mass="1", inertia=INERTIA):
    return f'<link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial></link>'


def joint(name="swing", parent="base", child="arm", kind="revolute", axis="0 0 1", more=""):
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <axis xyz="{axis}"/><limit lower="-1" upper="1" effort="5" velocity="2"/>{more}</joint>"""


def urdf(tmp_path, *parts):
    file = tmp_path / "robot.urdf"
    file.write_text(f'<robot name="r"><link name="base"/>{"".join(parts)}</robot>')
    return file


def scene(tmp_path, text):
    file = tmp_path / "scene.yaml"
    file.write_text("pinfric: 1\n" + text)
    return file


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ([link("arm", mass="-1"), joint()], r"'arm'.*mass -1 kg is negative"),
        (
            [link("arm", inertia=INERTIA.replace('izz="0.1"', 'izz="-0.3"')), joint()],
            r"the links that joint 'swing' moves have a negative kinetic energy",
        ),
        ([link("arm"), joint(axis="0 0 0")], r"'swing' has the axis \[0.0, 0.0, 0.0\]"),
        ([link("arm"), joint(child="amr")], r"'swing' names link 'amr'.*did you mean 'arm'"),
        ([link("arm"), joint(), joint(name="again")], "'again'.*tree"),
        ([link("arm"), joint(), link("loose")], "one root link"),
        ([link("arm"), joint(axis="0 0")], r"'swing'.*axis xyz='0 0'.*3 finite numbers"),
        ([link("arm"), joint().replace('lower="-1"', 'lower="3"')], r"'swing': limits lower 3"),
        ([link("arm"), joint(more='<mimic joint="swing"/>')], "'swing' mimics itself"),
        ([link("arm"), joint(more='<dynamics friction="x"/>')], "'swing'.*friction='x'"),
        (
            [
                link("arm"),
                joint(),
                link("a"),
                link("b"),
                joint("r", "a", "b"),
                joint("s", "b", "a"),
            ],
            r"\['a', 'b'\] form a ring",
        ),
        ([link("arm"), joint().replace(' xyz="0 0 1"', "")], "'swing' has an <axis> without xyz"),
        (
            [
                link("arm").replace(
                    "</link>", '<visual><geometry><box size="1 2"/></geometry></visual></link>'
                ),
                joint(),
            ],
            "'arm': <box size='1 2'> should be 3 finite",
        ),
        (
            [link("arm").replace("</link>", "<visual/></link>"), joint()],
            "'arm': a <visual> needs a <geometry>, of box, cylinder, sphere, mesh",
        ),
        (
            [
                link("arm").replace(
                    "</link>", "<collision><geometry><cone/></geometry></collision></link>"
                ),
                joint(),
            ],
            "'arm': a <collision> needs a <geometry>",
        ),
        (
            [
                link("arm").replace(
                    "</link>", '<visual><geometry><cylinder radius="1"/></geometry></visual></link>'
                ),
                joint(),
            ],
            "'arm'.*<cylinder> without length",
        ),
        ([link("arm"), joint(axis="1e200 1e200 0")], "'swing'.*should be at most 1e.12"),
        ([link("arm"), joint(axis="1e10 0 0")], "'swing' has the axis"),
        ([link("arm", mass="1e304"), joint()], "'arm': <mass value='1e304'> should be at most"),
        ([link("arm").replace('<mass value="1"/>', ""), joint()], "'arm'.*without <mass"),
        ([link("arm").replace('iyy="0.1"', ""), joint()], "'arm'.*without inertia iyy"),
        ([link("arm").replace("</link>", "<inertial/></link>"), joint()], "'arm' has 2 <inert"),
        (
            [
                link("arm"),
                joint(),
                link("a"),
                link("b"),
                joint("m", "arm", "a", more='<mimic joint="swing"/>'),
                joint("n", "arm", "b", more='<mimic joint="m"/>'),
            ],
            "'n' mimics 'm', which mimics",
        ),
        (
            [
                link("arm"),
                joint(kind="continuous"),
                link("a"),
                joint("m", "arm", "a", more='<mimic joint="swing"/>'),
            ],
            "'m' mimics 'swing', a cont",
        ),
        ([link("arm", mass="nan"), joint()], r"'arm': <mass value='nan'>"),
        ([link("arm"), joint(kind="fixed")], "no joint of this robot can move"),
        ([link("arm"), joint().replace('name="swing" ', "")], "joint number 1 has no name"),
        ([link("arm"), joint(kind="hinge")], "type 'hinge'; there are: revolute"),
    ],
)
def test_what_no_robot_can_be_is_refused(tmp_path, parts, says):
    with pytest.raises(RobotError, match=says) as caught:
        read_robot(urdf(tmp_path, *parts), {})
    assert "\n" not in str(caught.value)


def two_links(tmp_path, first, second, upper):
    """Joint 1 about z, joint 2 about x at the same place; moments of the links."""
    hinge = joint("j2", "arm", "hand", axis="1 0 0")
    hinge = hinge.replace('lower="-1" upper="1"', f'lower="-0.5" upper="{upper}"')
    links = link("arm", inertia=first), link("hand", inertia=second)
    return urdf(tmp_path, *links, joint("j1"), hinge)


@pytest.mark.parametrize(
    ("own", "upper", "loads"),
    [(0.1, 2.0, False), (0.1, 0.5, True), (0.39, 1.6, False), (0.41, 1.6, True)],
)
def test_kinetic_energy_is_positive_at_every_pose_within_the_ranges(tmp_path, own, upper, loads):
    """M_11 = own + 0.5 cos^2 q2 - 0.4 sin^2 q2, M_22 = 0.5: below 0 where tan^2 q2 is large."""
    moment = 'ixx="0.5" iyy="-0.4" izz="0.5"'
    second = f'<inertia {moment} ixy="0" ixz="0" iyz="0"/>'
    first = f'<inertia ixx="{own}" iyy="{own}" izz="{own}" ixy="0" ixz="0" iyz="0"/>'
    file = two_links(tmp_path, first, second, upper)
    if loads:
        with pytest.warns(PinfricWarning, match="one is negative"):
            assert read_robot(file, {}).model.nv == 2
        return
    says = "'j1' moves have a negative kinetic energy at q = "
    with pytest.warns(PinfricWarning), pytest.raises(RobotError, match=says):
        read_robot(file, {})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot", "not well-formed"),
        ("", "robot.urdf: is empty"),
        ("<sdf version='1.6'/>", "root element is <sdf>.*SDF, as Gazebo"),
        ("<mujoco model='a'/>", "root element is <mujoco>.*MJCF"),
        ("a: 1", "not well-formed"),
        ("<robot name='r'/>", "no <link>"),
    ],
)
def test_what_is_no_urdf_is_refused(tmp_path, text, says):
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    with pytest.raises(RobotError, match=says):
        read_robot(file, {})


def test_a_missing_mesh_is_one_warning(tmp_path):
    mesh = '<visual><geometry><mesh filename="package://no/a.stl"/></geometry></visual>'
    body = link("arm").replace("</link>", mesh + mesh.replace("a.stl", "b.stl") + "</link>")
    with pytest.warns(PinfricWarning, match=r"no mesh package://no/a\.stl and 1 more") as caught:
        robot = read_robot(urdf(tmp_path, body, joint()), {})
    assert len(caught) == 1
    assert robot.model.nv == 1


@pytest.mark.parametrize(("excess", "said"), [(-0.02, False), (5e-4, False), (0.02, True)])
def test_the_triangle_inequality_from_both_sides(excess, said):
    """A plate is at the limit, J_z = J_x + J_y; 0.0005 of it is what three digits round."""
    flat = np.diag([0.1, 0.1, 0.2 * (1 + excess)])
    assert (implausible_body(1.0, flat) is not None) == said


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (link("arm", inertia=INERTIA.replace('ixx="0.1"', 'ixx="0.3"')), "triangle inequality"),
        (link("arm", inertia=INERTIA.replace('ixx="0.1"', 'ixx="-0.3"')), "one is negative"),
        (link("arm", mass="0"), "without a mass"),
    ],
)
def test_bodies_that_other_programs_take_are_one_warning_with_all_their_names(tmp_path, body, says):
    hand = body.replace('"arm"', '"hand"')
    parts = body, joint(), hand, joint(name="wrist", parent="arm", child="hand")
    with pytest.warns(PinfricWarning, match=rf"'arm'.*{says}.*also hand; used") as caught:
        robot = read_robot(urdf(tmp_path, *parts), {})
    assert len(caught) == 1
    as_written = np.array([[0.1]]) * 2  # izz of both about the common axis, no lever
    M = pin.crba(robot.model, robot.model.createData(), np.zeros(2))
    np.testing.assert_allclose(M[0, 0], as_written[0, 0], atol=1e-15)


def test_a_follower_without_leader_moves_by_itself(tmp_path):
    lost = joint(name="wrist", parent="arm", child="hand", more='<mimic joint="swng"/>')
    with pytest.warns(PinfricWarning, match="'wrist' mimics 'swng', which is not there"):
        robot = read_robot(urdf(tmp_path, link("arm"), joint(), link("hand"), lost), {})
    assert robot.model.nv == 2


def test_a_robot_without_a_name_loads(tmp_path):
    file = urdf(tmp_path, link("arm"), joint())
    file.write_text(file.read_text().replace(' name="r"', ""))
    assert read_robot(file, {}).model.nv == 1


def test_links_that_never_move_may_say_what_they_like(tmp_path):
    weird = link("foot", inertia=INERTIA.replace('ixx="0.1"', 'ixx="9"'))
    fixed = joint(name="bolt", child="foot", kind="fixed")
    robot = read_robot(urdf(tmp_path, weird, fixed, link("arm"), joint()), {})
    assert robot.model.nv == 1


def test_locked_joints_are_gone_and_stay_where_they_were_put(tmp_path):
    parts = link("arm"), joint(), link("hand"), joint(name="wrist", parent="arm", child="hand")
    file = urdf(tmp_path, *parts)
    robot = read_robot(file, {"wrist": 0.3})
    assert list(robot.model.names)[1:] == ["swing"]
    frame = robot.model.frames[robot.model.getFrameId("hand")]
    np.testing.assert_allclose(frame.placement.rotation, pin.rpy.rpyToMatrix(0, 0, 0.3), atol=1e-15)
    with pytest.raises(RobotError, match=r"no joint 'wirst'; did you mean 'wrist'"):
        read_robot(file, {"wirst": 0.3})


def test_locking_a_leader_locks_its_followers(tmp_path):
    file = scene(
        tmp_path,
        "robot: {urdf: 'example-robot-data:panda_description/urdf/panda.urdf', "
        "locked: {panda_finger_joint1: 0.02}}",
    )
    with pytest.warns(PinfricWarning, match="dynamics"):
        arm = pf.load_scene(file)
    assert arm.model.nv == 7
    assert "panda_finger_joint2" not in arm.joint_names
    frames = {f.name: f.placement.translation[1] for f in arm.model.frames}
    assert frames["panda_rightfinger"] - frames["panda_leftfinger"] != 0


def test_urdf_dynamics_are_ignored_with_a_notice_or_used(tmp_path):
    urdf(tmp_path, link("arm"), joint(more='<dynamics friction="2.0" damping="0.5"/>'))
    with pytest.warns(PinfricWarning, match=r"swing.*ignored"):
        ignored = pf.load_scene(scene(tmp_path, "robot: {urdf: robot.urdf}"))
    assert ignored.site_names == ()
    used = pf.load_scene(scene(tmp_path, "robot: {urdf: robot.urdf, urdf_dynamics: use}"))
    assert used.friction["swing"].coulomb.kinetic == 2.0
    assert used.sites[0].law.viscous == 0.5
    own = "robot: {urdf: robot.urdf, urdf_dynamics: use}\nfriction: {swing: {viscous: 0.1}}"
    mixed = pf.load_scene(scene(tmp_path, own))
    assert mixed.friction["swing"].coulomb.kinetic == 2.0
    assert mixed.sites[0].law.viscous == 0.1


def test_the_notice_of_urdf_dynamics_names_four_joints_of_many(tmp_path):
    with pytest.warns(PinfricWarning, match="the URDF's <") as said:
        pf.load_scene(
            scene(
                tmp_path, "robot: {urdf: 'example-robot-data:tiago_description/robots/tiago.urdf'}"
            )
        )
    assert all(len(str(warning.message)) < 400 for warning in said)


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("friction: {swnig: {viscous: 1}}", SceneError, "no joint 'swnig'; did you mean 'swing'"),
        (
            "friction: {swing: {bearing: {kind: guide, length: 0.1}, mu: {static: 0, kinetic: 0}}}",
            SceneError,
            "a guide does not fit a turning joint; take pin",
        ),
        (
            "friction: {swing: {bearing: {kind: ball, radius: 0.1}, mu: {static: 0, kinetic: 0}}}",
            SceneError,
            "take pin or linear .a ball fits a spherical loop",
        ),
        ("actuators: [{joint: swing}, {joint: swing}]", SceneError, "listed twice"),
        ("actuators: [{joint: wing}]", SceneError, "did you mean 'swing'"),
        ("actuators: [{cylinder: {name: boom}}]", SceneError, r"`actuators\[0\].cylinder.a`"),
        ("actuators: [{force: {name: push}}]", SceneError, r"`actuators\[0\].force.link`"),
        ("loops: [{name: rocker}]", SceneError, r"`loops\[0\].kind` is missing"),
    ],
)
def test_a_scene_that_does_not_fit_its_robot_is_refused(tmp_path, text, error, says):
    urdf(tmp_path, link("arm"), joint())
    with pytest.raises(error, match=says):
        pf.load_scene(scene(tmp_path, "robot: {urdf: robot.urdf}\n" + text))


@pytest.mark.parametrize(
    ("payload", "says"),
    [
        ("{link: amr, mass: 1, com: [0, 0, 0]}", r"payloads\.box\.link.*did you mean 'arm'"),
        ("{link: arm, mass: 1, com: [0, 0, 0], inertia: [1, 0, 0, 1, 0, 3]}", "triangle"),
    ],
)
def test_payloads_are_checked_like_links(tmp_path, payload, says):
    urdf(tmp_path, link("arm"), joint())
    text = f"robot: {{urdf: robot.urdf, payloads: {{box: {payload}}}}}"
    with pytest.raises(SceneError, match=says):
        pf.load_scene(scene(tmp_path, text))


def test_payload_on_a_link_behind_a_fixed_joint(tmp_path):
    tool = joint(name="bolt", parent="arm", child="tool", kind="fixed").replace(
        "<parent", '<origin xyz="0.5 0 0" rpy="0 0 1.5707963267948966"/><parent'
    )
    urdf(tmp_path, link("arm"), joint(axis="0 -1 0"), '<link name="tool"/>', tool)
    box = "{link: tool, mass: 2.0, com: [0, 0.1, 0]}"
    bare = pf.load_scene(scene(tmp_path, "robot: {urdf: robot.urdf}"))
    laden = pf.load_scene(scene(tmp_path, f"robot: {{urdf: robot.urdf, payloads: {{box: {box}}}}}"))
    still = np.zeros((1, 1))
    effort = [pf.inverse_dynamics(s, still, still, still).effort_lower[0, 0] for s in (bare, laden)]
    # the tool frame is turned by 90 degrees: its y points back along the arm
    assert effort[1] - effort[0] == pytest.approx(2.0 * 9.81 * (0.5 - 0.1))


def test_bundled_scenes_are_found_by_name_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert pf.load_scene("three_link").model.nv == 3
    assert pf.load_scene("robots/three_link.yaml").model.nv == 3
    with pytest.raises(SceneError, match=r"did you mean 'three_link\.yaml'"):
        pf.load_scene("three_lnk")
    for elsewhere in ("mine/three_link.yaml", tmp_path / "three_link.yaml"):
        with pytest.raises(SceneError, match="there is no file"):
            pf.load_scene(elsewhere)
    with pytest.raises(RobotError, match="example-robot-data has no"):
        pf.load_scene(scene(tmp_path, "robot: {urdf: 'example-robot-data:ur5.urdf'}"))


def test_reductions_of_the_urdf_are_mentioned_until_actuators_name_them(tmp_path):
    gear = """<transmission name="t"><type>SimpleTransmission</type><joint name="swing"/>
      <actuator name="m"><mechanicalReduction>100</mechanicalReduction></actuator></transmission>"""
    urdf(tmp_path, link("arm"), joint(), gear)
    with pytest.warns(PinfricWarning, match=r"reductions \(swing 100\)"):
        found = pf.load_scene(scene(tmp_path, "robot: {urdf: robot.urdf}"))
    assert found.robot.reductions == {"swing": 100.0}
    named = "robot: {urdf: robot.urdf}\nactuators: [{joint: swing, transmission: {ratio: 100}}]"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pf.load_scene(scene(tmp_path, named))


def test_a_model_of_ones_own_with_negative_kinetic_energy_is_refused():
    model = chain(("j1", pin.JointModelRZ()), ("j2", pin.JointModelRX()))
    inertia = model.inertias[2]
    inertia.inertia = np.diag([0.5, -3.0, 0.5])
    model.inertias[2] = inertia
    with pytest.raises(RobotError, match="negative kinetic energy"):
        pf.Scene(model=model)
