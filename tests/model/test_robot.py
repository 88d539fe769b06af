"""Impossible URDFs, and the scenes of possible ones."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, random_tree
from numpy.testing import assert_allclose
from robot_cases import joint, link, scene, urdf

import pinfric as pf
from pinfric.errors import PinfricWarning, RobotError
from pinfric.model.robot import mass_matrix, read_robot


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


def test_a_follower_without_leader_moves_by_itself(tmp_path):
    lost = joint(name="wrist", parent="arm", child="hand", more='<mimic joint="swng"/>')
    with pytest.warns(PinfricWarning, match="'wrist' mimics 'swng', which is not there"):
        robot = read_robot(urdf(tmp_path, link("arm"), joint(), link("hand"), lost), {})
    assert robot.model.nv == 2


def test_a_robot_without_a_name_loads(tmp_path):
    file = urdf(tmp_path, link("arm"), joint())
    file.write_text(file.read_text().replace(' name="r"', ""))
    assert read_robot(file, {}).model.nv == 1


def test_a_file_is_read_once_and_each_caller_changes_its_own(tmp_path, monkeypatch):
    robot = read_robot(urdf(tmp_path, link("arm"), joint("j1")), {})
    first = robot.xml()
    monkeypatch.setattr("pinfric.model.robot.read_xml", pytest.fail)
    first.clear()
    assert [j.get("name") for j in robot.xml().findall("joint")] == ["j1"]


def test_locked_joints_are_gone_and_stay_where_they_were_put(tmp_path):
    parts = link("arm"), joint(), link("hand"), joint(name="wrist", parent="arm", child="hand")
    file = urdf(tmp_path, *parts)
    robot = read_robot(file, {"wrist": 0.3})
    assert list(robot.model.names)[1:] == ["swing"]
    frame = robot.model.frames[robot.model.getFrameId("hand")]
    assert_allclose(frame.placement.rotation, pin.rpy.rpyToMatrix(0, 0, 0.3), atol=1e-15)
    with pytest.raises(RobotError, match=r"no joint 'wirst'"):
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


def test_a_model_of_ones_own_with_negative_kinetic_energy_is_refused():
    model = chain(("j1", pin.JointModelRZ()), ("j2", pin.JointModelRX()))
    inertia = model.inertias[2]
    inertia.inertia = np.diag([0.5, -3.0, 0.5])
    model.inertias[2] = inertia
    with pytest.raises(RobotError, match="negative kinetic energy"):
        pf.Scene(model=model)


def test_joints_that_are_not_numbered_depth_first_are_read_rightly():
    """Pinocchio's CRBA gives such a model, a tree of seven joints, a negative kinetic energy."""
    model = random_tree(2265, 7, sliding=0.2)
    q, v = pin.integrate(model, pin.neutral(model), np.linspace(-1, 1, 7)), np.linspace(1, -1, 7)
    wrong = pin.crba(model, model.createData(), pin.neutral(model))
    assert np.linalg.eigvalsh(np.triu(wrong) + np.triu(wrong, 1).T)[0] < 0.0
    found = mass_matrix(model, q)
    assert 0.5 * v @ found @ v == pytest.approx(
        pin.computeKineticEnergy(model, model.createData(), q, v), rel=1e-13
    )
    a = pf.forward_dynamics(pf.Scene(model=model), q, v, np.zeros(7)).a
    data = model.createData()
    assert_allclose(pin.rnea(model, data, q, v, a), 0.0, atol=1e-11)
