"""`robot.floating` is the robot whose URDF has a floating joint, and nothing else changes."""

import numpy as np
import pinocchio as pin
import pytest
import yaml
from mjcf_cases import MODELS
from robot_cases import joint, link, scene, urdf

import pinfric as pf
from pinfric.errors import RobotError
from pinfric.model.floating import free_joint
from pinfric.model.robot import example_robot_data, read_robot
from pinfric.model.scene_text import robot_with_bodies, scene_content

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
LEG = link("trunk", "5"), joint("mount", "base", "trunk", "fixed"), link("shank")
OTHER = link("ball", "1"), joint("other", "base", "ball", axis="0 1 0")
KNEE = joint("knee", "trunk", "shank", axis="0 1 0")


@pytest.mark.parametrize(
    "name",
    [
        "go2_description/urdf/go2.urdf",
        "solo_description/robots/solo12.urdf",
        "bolt_description/robots/bolt.urdf",
        "hyq_description/robots/hyq_no_sensors.urdf",
        "simple_humanoid_description/urdf/simple_humanoid.urdf",
        "talos_data/robots/talos_reduced.urdf",
        "anymal_b_simple_description/robots/anymal.urdf",
        "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    ],
)
def test_efforts_are_those_of_pinocchios_free_flyer(name):
    file = example_robot_data() / name
    model = read_robot(file, {}, floating=True).model
    own = pin.buildModelFromUrdf(str(file), pin.JointModelFreeFlyer(), mimic=True)
    assert (free_joint(model), model.nq, model.nv) == ("root_joint", own.nq, own.nv)
    rng = np.random.default_rng(0)
    for _ in range(10):
        q = pin.integrate(own, pin.neutral(own), rng.normal(size=own.nv))
        v, a = rng.normal(size=(2, own.nv))
        found, expected = (pin.rnea(m, m.createData(), q, v, a) for m in (model, own))
        # Pinocchio numbers branches by name, alike in both
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_the_base_has_no_drive_and_the_file_round_trips(tmp_path):
    urdf(tmp_path, *LEG, KNEE)
    free = pf.load_scene(scene(tmp_path, "robot: {urdf: robot.urdf, floating: true}"))
    assert free.joint_names == ("root_joint", "knee")
    assert free.actuator_names == ("knee",)
    assert free.robot.xml().find("joint").get("type") == "floating"
    assert "floating" not in (tmp_path / "robot.urdf").read_text()
    assert not any("never move" in finding.text for finding in free.findings)
    for text in "", robot_with_bodies(free.robot, free.model):
        (tmp_path / "again.urdf").write_text(text)
        content = scene_content(free, free.robot, tmp_path, "again.urdf" if text else "")
        (tmp_path / "again.yaml").write_text(yaml.safe_dump(content))
        again = pf.load_scene(tmp_path / "again.yaml")
        assert all(
            a.isApprox(b) for a, b in zip(again.model.inertias, free.model.inertias, strict=True)
        )
        assert again.actuator_names == ("knee",)


def test_a_link_called_world_stays_the_ground(tmp_path):
    file = tmp_path / "robot.urdf"
    mount = joint("mount", "world", "trunk", "fixed")
    file.write_text(f'<robot name="r"><link name="world"/>{mount}{"".join(LEG[::2])}{KNEE}</robot>')
    model = read_robot(file, {}, floating=True).model
    assert free_joint(model) == "mount"
    assert model.inertias[1].mass == 5.0


@pytest.mark.parametrize(
    ("floating", "free"), [(None, "mount"), (True, "mount"), (False, "")], ids=str
)
def test_a_base_that_its_file_frees_stays_free_or_is_fixed(tmp_path, floating, free):
    file = urdf(tmp_path, joint("mount", "base", "trunk", "floating"), *LEG[::2], KNEE)
    assert free_joint(read_robot(file, {}, floating=floating).model) == free


def test_the_fixed_base_of_an_mjcf_is_where_its_file_begins_it(tmp_path):
    """Without forces its joints carry what MuJoCo's do where its free joint holds still."""
    mujoco = pytest.importorskip("mujoco")
    tilted = MODELS["leg"].replace('pos="0 0 1"', 'pos="0.1 0.2 1" euler="40 20 10"')
    (tmp_path / "leg.xml").write_text(tilted)
    file = tmp_path / "leg.yaml"
    file.write_text("pinfric: 1\nrobot: {mjcf: leg.xml, floating: false}\n")
    fixed = pf.load_scene(file)
    judge = mujoco.MjModel.from_xml_path(str(tmp_path / "leg.xml"))
    data = mujoco.MjData(judge)
    data.qpos[7:] = 0.3, -0.4, 0.5
    mujoco.mj_inverse(judge, data)
    found = pf.inverse_dynamics(fixed, [0.3, -0.4, 0.5], np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(found.effort_frictionless[0], data.qfrc_inverse[6:], atol=1e-9)
    content = scene_content(fixed, fixed.robot, tmp_path, "")
    (tmp_path / "again.yaml").write_text(yaml.safe_dump(content))
    assert pf.load_scene(tmp_path / "again.yaml").model.nv == 3


@pytest.mark.parametrize(
    ("kind", "more", "says"),
    [
        ("floating", OTHER, "joint 'mount' lets one part float, and joint 'other' begins at"),
        ("fixed", (), "joint 'root_joint' is there"),
    ],
)
def test_a_base_that_cannot_float_is_refused(tmp_path, kind, more, says):
    name = "mount" if kind == "floating" else "root_joint"
    file = urdf(tmp_path, LEG[0], joint(name, "base", "trunk", kind), *more)
    with pytest.raises(RobotError, match=says):
        pf.load_scene(scene(tmp_path, f"robot: {{urdf: {file.name}, floating: true}}"))
