"""SDF: read back by its own rules, and by Drake if it is installed."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin
import pytest
from builders import random_states, random_tree
from numpy.testing import assert_allclose

import pinfric as pf


def numbers(element, path):
    return np.array([float(x) for x in element.find(path).text.split()])


def read(text):
    """The model of an SDF file, by its rules: poses relative to named frames."""
    root = ElementTree.fromstring(text).find("model")
    joints = {joint.find("child").text: joint for joint in root.findall("joint")}
    model, built = pin.Model(), {"world": 0}
    for link in root.findall("link"):
        name = link.get("name")
        joint = joints[name]
        assert link.find("pose").get("relative_to") == joint.get("name")
        assert not numbers(link, "pose").any()
        parent, axis = joint.find("parent").text, numbers(joint, "axis/xyz")
        stands = joint.find("pose").get("relative_to")
        assert stands == ("__model__" if parent == "world" else parent)
        x, y, z, *angles = numbers(joint, "pose")
        place = pin.SE3(pin.rpy.rpyToMatrix(*angles), np.array([x, y, z]))
        kind = (
            pin.JointModelPrismaticUnaligned
            if joint.get("type") == "prismatic"
            else (pin.JointModelRevoluteUnaligned)
        )
        built[name] = model.addJoint(built[parent], kind(axis), place, joint.get("name"))
        inertia = np.zeros((3, 3))
        for i in range(3):
            for k in range(i, 3):
                moment = numbers(link, f"inertial/inertia/i{'xyz'[i]}{'xyz'[k]}")[0]
                inertia[i, k] = inertia[k, i] = moment
        body = pin.Inertia(
            numbers(link, "inertial/mass")[0], numbers(link, "inertial/pose")[:3], inertia
        )
        model.appendBodyToJoint(built[name], body, pin.SE3.Identity())
    return model


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_same_robot(seed):
    model = random_tree(seed)
    made = read(pf.export(pf.Scene(model), to="sdf").text)
    made.gravity = model.gravity
    (q, v, a), data = random_states(model, seed, 5), model.createData()
    scene = pf.Scene(model)
    angles = pf.Trajectory.from_arrays(scene, np.arange(5.0), q, v, a).joint_positions()
    for k in range(5):
        wanted = pin.rnea(model, data, q[k], v[k], a[k])
        found = pin.rnea(made, made.createData(), angles[k], v[k], a[k])
        assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)


def test_constants_limits_and_errors_are_there():
    scene = pf.load_scene("ur5_pick_and_place")
    made = pf.export(scene, pf.load_trajectory("ur5_pick_and_place.csv", scene), "sdf")
    root = ElementTree.fromstring(made.text).find("model")
    for joint in made.joints:
        dynamics = root.find(f"joint[@name='{joint.joint}']/axis/dynamics")
        assert numbers(dynamics, "friction")[0] == joint.frictionloss
        assert numbers(dynamics, "damping")[0] == joint.damping
    lower = [numbers(joint, "axis/limit/lower")[0] for joint in root.findall("joint")]
    assert_allclose(lower, scene.model.lowerPositionLimit)
    assert made.text.count("; error rms ") == 6
    for joint, drive in zip(root.findall("joint"), scene.drives, strict=True):  # Drake's own tags
        tags = [joint.find(f"{{drake.mit.edu}}{tag}") for tag in ("rotor_inertia", "gear_ratio")]
        inertia, ratio = (float(tag.text) for tag in tags)
        assert ratio == drive.ratio
        assert inertia == pytest.approx(drive.transmission.rotor_inertia)
    names = [x.get("name") for x in (*root.findall("link"), *root.findall("joint"))]
    assert len(set(names)) == len(names)


RODS = (
    '<robot name="rods"><link name="base"/>'
    + "".join(
        f'<link name="{n}{n}"><inertial><origin xyz="0.3 0 0"/><mass value="{m}"/>'
        f'<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="{n}" type="revolute"><parent link="base"/><child link="{n}{n}"/>'
        f'<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="9" velocity="9"/>{mimic}</joint>'
        for n, m, mimic in (
            ("a", 1.2, ""),
            ("b", 0.7, '<mimic joint="a" multiplier="-0.5" offset="0.2"/>'),
            ("c", 0.4, '<mimic joint="b" multiplier="3"/>'),
        )
    )
    + "</robot>"
)


def test_drake_moves_followers_with_their_leader(tmp_path):
    """A chain of followers: the leader's acceleration, and q_b = 0.2 - q_a/2, q_c = 3 q_b."""
    plants = pytest.importorskip("pydrake.multibody.plant", reason="Drake is not installed")
    parsing = pytest.importorskip("pydrake.multibody.parsing")
    analysis = pytest.importorskip("pydrake.systems.analysis")
    (tmp_path / "robot.urdf").write_text(RODS)
    (tmp_path / "scene.yaml").write_text("pinfric: 1\nrobot: {urdf: robot.urdf}")
    scene = pf.load_scene(tmp_path / "scene.yaml")
    file = pf.export(scene, to="sdf").write(tmp_path / "robot.sdf")
    step, q, v = 1e-5, 0.4, 0.5
    plant = plants.MultibodyPlant(step)
    plant.set_discrete_contact_approximation(plants.DiscreteContactApproximation.kSap)
    parsing.Parser(plant).AddModels(str(file))
    plant.Finalize()
    simulator = analysis.Simulator(plant)
    context = simulator.get_mutable_context()
    plant.get_actuation_input_port().FixValue(context, np.zeros(plant.num_actuators()))
    a, b, c = (plant.GetJointByName(name) for name in "abc")
    for joint, ratio, shift in ((a, 1, 0), (b, -0.5, 0.2), (c, -1.5, 0.6)):
        joint.set_angle(context, ratio * q + shift)
        joint.set_angular_rate(context, ratio * v)
    simulator.AdvanceTo(10 * step)
    found = (a.get_angular_rate(context) - v) / (10 * step)
    assert found == pytest.approx(pf.forward_dynamics(scene, [q], [v], [0.0]).a[0], rel=1e-3)
    simulator.AdvanceTo(0.05)
    assert b.get_angle(context) == pytest.approx(0.2 - 0.5 * a.get_angle(context), abs=1e-4)
    assert c.get_angle(context) == pytest.approx(3 * b.get_angle(context), abs=1e-4)


def test_drake_reads_it(tmp_path):
    """Drake 1.51 takes masses, limits and damping, and no dry friction."""
    plants = pytest.importorskip("pydrake.multibody.plant", reason="Drake is not installed")
    parsing = pytest.importorskip("pydrake.multibody.parsing")
    scene = pf.load_scene("ur5_pick_and_place")
    made = pf.export(scene, pf.load_trajectory("ur5_pick_and_place.csv", scene), "sdf")
    file = made.write(tmp_path / "ur5.sdf")
    plant = plants.MultibodyPlant(0.0)
    parsing.Parser(plant).AddModels(str(file))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q, v, a = (x[0] for x in random_states(scene.model, 1, 1))
    plant.SetPositions(context, q)
    plant.SetVelocities(context, v)
    forces = plants.MultibodyForces_[float](plant) if hasattr(plants, "MultibodyForces_") else None
    if forces is None:
        forces = pytest.importorskip("pydrake.multibody.tree").MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    found = plant.CalcInverseDynamics(context, a, forces)
    model = scene.loaded_model()
    wanted = pin.rnea(model, model.createData(), q, v, a)
    damping = np.array([joint.damping for joint in made.joints])
    rotors = np.array([d.ratio**2 * d.transmission.rotor_inertia for d in scene.drives])
    assert_allclose(found, wanted + damping * v + rotors * a, rtol=1e-9, atol=1e-9)
