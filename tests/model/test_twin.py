"""The wrench twin against Pinocchio's own `data.f`, one joint kind and one robot at a time."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, random_inertia, random_states, random_tree
from judges.verdict import judge
from numpy.testing import assert_allclose, assert_array_equal
from robot_cases import each_robot

import pinfric as pf
from pinfric.errors import RobotError
from pinfric.model.robot import example_robot_data
from pinfric.model.twin import make_twin


def plain_wrenches(model, q, v, a):
    data = model.createData()
    rows = []
    for i in range(len(q)):
        pin.rnea(model, data, q[i], v[i], a[i])
        rows.append(np.array([f.vector for f in data.f][1:]))  # f.vector is a view: copy now
    return np.array(rows)


def assert_twin_equals_data_f(model, seed=0, samples=3):
    q, v, a = random_states(model, seed, samples)
    wrenches = pf.joint_wrenches(pf.Scene(model=model), q, v, a)
    expected = plain_wrenches(model, q, v, a)
    scale = np.abs(expected).max()
    assert_allclose(wrenches, expected, rtol=0, atol=1e-12 * scale)


def test_sixty_joints():
    assert_twin_equals_data_f(random_tree(2, joints=60))


@pytest.mark.parametrize("urdf", each_robot())
def test_wrenches_equal_data_f_on_every_robot(urdf):
    root_joints = [None, pin.JointModelFreeFlyer(), pin.JointModelPlanar()]
    checked = 0
    for root in root_joints:
        for mimic in (True, False):
            arguments = [str(urdf)] if root is None else [str(urdf), root]
            try:
                model = pin.buildModelFromUrdf(*arguments, mimic=mimic)
            except (ValueError, RuntimeError):
                continue  # Pinocchio itself cannot load it that way
            if model.njoints > 1:
                assert_twin_equals_data_f(model)
                checked += 1
    if checked == 0:
        pytest.skip("Pinocchio does not load this URDF, or it has no joint")


def test_most_robots_load_and_mimic_joints_are_among_them():
    loads = mimics = 0
    for urdf in example_robot_data().rglob("*.urdf"):
        try:
            model = pin.buildModelFromUrdf(str(urdf), mimic=True)
        except (ValueError, RuntimeError):
            continue
        loads += 1
        mimics += len(model.mimicking_joints) > 0
    assert loads >= 60  # a wheel that ships fewer would hollow the test above out
    assert mimics >= 3


TILTED = np.array([1.0, 2.0, -2.0]) / 3
KINDS = [
    pin.JointModelRX(),
    pin.JointModelRevoluteUnaligned(TILTED),
    pin.JointModelRUBY(),
    pin.JointModelPZ(),
    pin.JointModelPrismaticUnaligned(TILTED),
    pin.JointModelPlanar(),
    pin.JointModelFreeFlyer(),
    pin.JointModelSpherical(),
    pin.JointModelTranslation(),
]


@pytest.mark.parametrize("joint", KINDS, ids=lambda joint: joint.shortname())
def test_every_joint_kind_between_two_turning_joints(joint):
    rng = np.random.default_rng(1)
    model = pin.Model()
    parent = 0
    for name, kind in (("a", pin.JointModelRY()), ("b", joint), ("c", pin.JointModelRX())):
        placement = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        parent = model.addJoint(parent, kind, placement, name)
        model.appendBodyToJoint(parent, random_inertia(rng), pin.SE3.Identity())
    assert_twin_equals_data_f(model, samples=5)


def test_continuous_joints_about_tilted_axes():
    body = """<inertial><origin xyz="0.1 -0.2 0.3"/><mass value="2"/>
      <inertia ixx="0.1" iyy="0.12" izz="0.09" ixy="0.01" ixz="0" iyz="0.02"/></inertial>"""
    links = "".join(f"<link name='l{i}'>{body}</link>" for i in range(3))
    joints = "".join(
        f"""<joint name='j{i}' type='continuous'><parent link='l{i}'/><child link='l{i + 1}'/>
        <origin xyz='0.1 0.2 -0.3' rpy='0.3 -0.5 1.1'/><axis xyz='0.6 {0.5 * i} 0.8'/></joint>"""
        for i in range(2)
    )
    model = pin.buildModelFromXML(f"<robot name='r'>{links}{joints}</robot>")
    assert {j.shortname() for j in model.joints[1:]} == {"JointModelRevoluteUnboundedUnaligned"}
    assert_twin_equals_data_f(model, samples=5)


@pytest.mark.parametrize("seed", range(10))
def test_random_trees(seed):
    assert_twin_equals_data_f(random_tree(seed, joints=8), seed, samples=4)


def test_effort_of_the_twin_is_rnea_with_armature_and_mimic():
    model = pin.buildModelFromUrdf(
        str(example_robot_data() / "panda_description/urdf/panda.urdf"), mimic=True
    )
    model.armature = np.linspace(0.1, 0.8, model.nv)
    scene = pf.Scene(
        model=model,
        friction={
            n: {"bearing": {"kind": "pin", "radius": 0.0}, "mu": {"static": 0, "kinetic": 0}}
            for n in ("panda_joint1", "panda_joint4")
        },
    )
    q, v, a = random_states(model, 3, 10)
    result = pf.inverse_dynamics(scene, q, v, a)
    data = model.createData()
    expected = np.array([pin.rnea(model, data, *s) for s in zip(q, v, a, strict=True)])
    assert_allclose(result.effort_upper, expected, rtol=0, atol=1e-12 * 100)


def test_threads_and_batches_do_not_change_the_answer():
    model = random_tree(5, joints=7)
    scene = pf.Scene(model=model)
    q, v, a = random_states(model, 5, 700)  # more than one batch of 512
    one = pf.joint_wrenches(scene, q, v, a, threads=1)
    two = pf.joint_wrenches(scene, q, v, a, threads=2)
    assert_array_equal(one, two)
    assert_allclose(one[-2:], pf.joint_wrenches(scene, q[-2:], v[-2:], a[-2:]))


def test_external_wrench_relieves_the_joints_that_carry_it():
    model = random_tree(11, joints=6)
    joint = 6
    placement = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, -0.3]))
    model.addFrame(pin.Frame("tool", joint, placement, pin.FrameType.OP_FRAME))
    scene = pf.Scene(model=model)
    q, v, a = random_states(model, 11, 4)
    tool = np.random.default_rng(0).normal(scale=10, size=(4, 6))
    wrenches = pf.joint_wrenches(scene, q, v, a, {"tool": tool})
    data = model.createData()
    for i in range(4):
        forces = [pin.Force.Zero() for _ in range(model.njoints)]
        forces[joint] = placement.act(pin.Force(tool[i]))
        pin.rnea(model, data, q[i], v[i], a[i], forces)
        expected = np.array([f.vector for f in data.f][1:])
        assert_allclose(wrenches[i], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("pitch", [0.1, 1e-4])  # 1e-4: an axis of length 1 to 5e-9
def test_a_helical_joint_is_refused_with_what_to_write_instead(pitch):
    model = chain(("screw", pin.JointModelHX(pitch)))
    says = rf"'screw' is helical .* prismatic one with <mimic> and multiplier {pitch:g}; .*ratio"
    with pytest.raises(RobotError, match=says):
        make_twin(model)


def test_a_screw_as_two_joints_has_the_closed_form(tmp_path):
    """tau = (J + m p^2) a + m g p + mu R m (g + p a): the collar at radius R carries the load."""
    p, m, J, g, mu, R = 0.01, 2.0, 0.05, 9.81, 0.1, 0.008
    limit = '<axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="0" velocity="0"/>'
    (tmp_path / "screw.urdf").write_text(f"""<robot name="screw">
    <link name="ground"/><link name="spindle"/><link name="nut"><inertial><mass value="{m}"/>
    <inertia ixx="{J}" iyy="{J}" izz="{J}" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="turn" type="revolute"><parent link="ground"/><child link="spindle"/>{limit}</joint>
    <joint name="rise" type="prismatic"><parent link="spindle"/><child link="nut"/>{limit}
    <mimic joint="turn" multiplier="{p}"/></joint></robot>""")
    file = tmp_path / "screw.yaml"
    file.write_text(
        "pinfric: 1\nrobot: {urdf: screw.urdf}\nfriction: {turn: {bearing: {kind: pin, radius: "
        f"0.01, thrust_radius: {R}}}, mu: {{static: {mu}, kinetic: {mu}}}}}}}\n"
    )
    scene = pf.load_scene(file)
    a = np.array([[3.0], [-40.0]])
    result = pf.inverse_dynamics(scene, [[0.3], [0.1]], [[1.0], [2.0]], a)
    torque = (J + m * p**2) * a + m * g * p + mu * R * m * (g + p * a)
    assert_allclose(result.effort_lower, torque, rtol=1e-12)
    assert judge(result).passed()
