import dataclasses
import re

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example, lump, random_states, random_tree
from export_cases import moved
from robot_cases import joint as urdf_joint
from robot_cases import link, urdf
from robot_cases import scene as scene_file

import pinfric as pf
from pinfric.exporting.mjcf import MjcfJoint, mjcf
from pinfric.exporting.tree import bodies


def mujoco_inverse(text, joints, q, v, a):
    """MuJoCo's inverse dynamics of the file: (T, nv) torques with friction and rotors."""
    model = mujoco.MjModel.from_xml_string(text)
    data, torque = mujoco.MjData(model), np.empty_like(v)
    order = [int(model.joint(name).dofadr[0]) for name in joints]  # branch by branch in MuJoCo
    for k in range(len(v)):
        data.qpos[order], data.qvel[order], data.qacc[order] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse[order]
    return torque


def assert_same(found, expected):
    """All figures of two records are the same; NaN, "not known", is the same as NaN.

    Python's == does so only up to 3.12, and only for one and the same NaN object.
    """
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_equal(dataclasses.asdict(one), dataclasses.asdict(other))


def test_mujoco_misses_what_the_file_states(ur5):
    """Moving samples; the payload is in the file where the trajectory carries it."""
    scene, motion, made, result = ur5
    carrying = {"part": scene.payloads["part"].model_copy(update={"attached": True})}
    loaded = pf.export(scene.with_(payloads=carrying), motion)
    moved = [[j for j in x.joints if not j.unmoved] for x in (loaded, made)]
    assert_same(*moved)  # the trajectory says when it is carried, not the default
    q = motion.joint_positions()
    free, held = (
        mujoco_inverse(x.text, scene.joint_names, q, motion.v, motion.a) for x in (made, loaded)
    )
    torque = np.where(motion.attached, held, free)
    still = (motion.v == 0.0) & (motion.a == 0.0)
    for d, joint in enumerate(made.joints):
        lower = joint.ratio * result.motor_torque_lower[:, d]
        upper = joint.ratio * result.motor_torque_upper[:, d]
        line = re.search(rf"<!-- {joint.joint}[: ].* -->", made.text)[0]
        standing = re.search(r"standing still (\S+) to (\S+) N m", line)
        left_out = [float(x) for x in standing.groups()]
        wanted = [
            (lower - torque[:, d])[still[:, d]].min(),
            (upper - torque[:, d])[still[:, d]].max(),
        ]
        np.testing.assert_allclose(left_out, wanted, rtol=0.01)
        moving = (motion.v[:, d] != 0.0) & (lower == upper)
        if joint.joint == "wrist_2_joint":
            assert not moving.any()
            assert joint.unmoved
            assert "never moves in this motion: constants of random states" in line
            continue
        assert joint.moving == moving.sum()
        missed = torque[moving, d] - lower[moving]
        stated = re.search(r"error rms (\S+), peak (\S+) N m", line)
        rms, peak = np.sqrt(np.mean(missed**2)), np.abs(missed).max()
        np.testing.assert_allclose([float(x) for x in stated.groups()], [rms, peak], rtol=1e-4)
        np.testing.assert_allclose([joint.error_rms, joint.error_peak], [rms, peak], rtol=1e-9)


def test_mujocos_friction_is_soft_in_the_samples_that_the_file_names():
    """Constants along the motion, computed here, differ from mj_inverse there and only there."""
    scene, motion = example("ur10_machine_tending")
    scene = scene.with_(payloads={})
    bare = pf.Trajectory.from_arrays(scene, motion.t, motion.q, motion.v, motion.a)
    made, result = pf.export(scene, bare), pf.inverse_dynamics(scene, bare)
    v, a = motion.v, motion.a
    torque = mujoco_inverse(made.text, scene.joint_names, motion.joint_positions(), v, a)
    note, *_ = made.notes
    named = dict(re.findall(r"(\w+_joint) (\d+) sample", note))
    assert note.startswith("near rest MuJoCo's friction is soft")
    for d, joint in enumerate(made.joints):
        constant = joint.frictionloss * np.sign(v[:, d]) + joint.damping * v[:, d]
        expected = result.effort_frictionless[:, d] + constant + joint.armature * a[:, d]
        missed = np.abs(torque[:, d] - expected)
        off = (missed > 1e-6 * max(joint.frictionloss, 1e-9)) & (v[:, d] != 0.0)
        assert int(named.get(joint.joint, 0)) == off.sum() <= 5
        assert missed.max() <= 2 * joint.frictionloss
    assert named
    assert note in " ".join(made.text.split()).replace("Near rest", "near rest")


def test_mujocos_friction_follows_the_acceleration_of_a_slow_joint():
    """Random slow states: mj_inverse misses by twice the frictionloss where the file says so."""
    model = chain(("hinge", pin.JointModelRY(), lump(2.0, [0.5, 0.0, 0.0], 0.05)))
    scene = pf.Scene(model, friction={"hinge": dry(3.0)}, actuators=[{"joint": "hinge"}])
    rng = np.random.default_rng(0)
    q, v, a = rng.uniform(-1.0, 1.0, (3, 400, 1))
    v *= 10.0 ** rng.uniform(-5.0, 0.0, v.shape)
    made = pf.export(scene, pf.Trajectory.from_arrays(scene, np.arange(400.0), q, v, a))
    torque = mujoco_inverse(made.text, ["hinge"], q, v, a)
    bare = np.array(
        [pin.rnea(model, model.createData(), *state) for state in zip(q, v, a, strict=True)]
    )
    (joint,) = made.joints
    missed = np.abs(torque - bare - joint.frictionloss * np.sign(v))[:, 0]
    said = (v * a < 0.0)[:, 0] & (np.abs(v) < np.abs(a) / 1000.0)[:, 0]
    assert said.sum() > 50
    np.testing.assert_allclose(missed[said], 2.0 * joint.frictionloss, rtol=0.05)
    assert (missed[~said] < 1e-6).mean() > 0.99  # but for the width of the soft constraint
    assert f"hinge {int((missed > 1e-6).sum())} samples" in made.notes[0]


def test_mujoco_has_another_friction_by_default(ur5):
    """Why the file sets how friction is solved: else its constants are not MuJoCo's."""
    scene, motion, made, _ = ur5
    soft = re.sub(r'solreffriction="[^"]*" solimpfriction="[^"]*"', "", made.text)
    assert soft != made.text
    samples = slice(400, 700)
    states = motion.joint_positions()[samples], motion.v[samples], motion.a[samples]
    hard, other = (mujoco_inverse(text, scene.joint_names, *states) for text in (made.text, soft))
    assert np.abs(hard - other).max() > 5.0


@pytest.mark.parametrize("seed", range(4))
def test_mujoco_has_the_same_robot(seed):
    """Sliding, turning, continuous joints anywhere; constants that are not fitted."""
    model = random_tree(seed)
    model.armature = np.linspace(0.0, 0.3, model.nv)
    scene = pf.Scene(model=model)
    tree = bodies(scene)
    rng = np.random.default_rng(seed)
    constants = rng.uniform(0.1, 3.0, (model.nv, 3))
    joints = [
        MjcfJoint(loss, damping, armature + body.armature, gear=-30.0)
        for (loss, damping, armature), body in zip(constants, tree, strict=True)
    ]
    text = mjcf("random", tree, joints, model.gravity.linear)
    q, v, a = random_states(model, seed)
    v = np.where(np.abs(v) < 0.05, 0.05, v)
    data = model.createData()
    plain = np.array([pin.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])
    loss, damping, armature = constants.T
    wanted = plain + loss * np.sign(v) + damping * v + armature * a
    angles = pf.Trajectory.from_arrays(scene, np.arange(len(q)), q, v, a).joint_positions()
    torque = mujoco_inverse(text, scene.joint_names, angles, v, a)
    np.testing.assert_allclose(torque, wanted, rtol=1e-9, atol=1e-9)
    driven = mujoco.MjModel.from_xml_string(text)
    assert driven.nu == model.nv
    np.testing.assert_array_equal(driven.actuator_gear[:, 0], -30.0)


def test_links_without_mass_load():
    rod = pin.Inertia(
        1.0, np.zeros(3), pin.exp3(np.ones(3)) @ np.diag([0.1, 0.2, 0.3]) @ pin.exp3(-np.ones(3))
    )  # a plate: C = A + B but for rounding
    scene = pf.Scene(chain(("first", pin.JointModelRZ()), ("second", pin.JointModelRX(), rod)))
    made = mujoco.MjModel.from_xml_string(pf.export(scene, moved(scene)).text)
    assert made.nv == 2
    assert made.body_mass[1] < 1e-8


def test_limits_frames_and_odd_names_are_there():
    scene = pf.load_scene("panda_pick_and_place")
    odd = scene.with_(friction={}, source="a--b---c <&> d.yaml")
    text = pf.export(odd).text
    model = mujoco.MjModel.from_xml_string(text)
    np.testing.assert_allclose(model.jnt_range[:, 0], scene.model.lowerPositionLimit)
    np.testing.assert_allclose(model.jnt_actfrcrange[:, 1], scene.model.effortLimit)
    assert model.site("panda_hand_tcp").id >= 0
    assert model.ngeom > 0


def test_joints_that_never_move_in_the_motion_are_held():
    """0.5 N m at the Panda's joint 5, which the motion holds still: friction 0 let it turn."""
    scene, motion = example("panda_pick_and_place", "panda_pick_and_place.csv")
    made = pf.export(scene, motion)
    still = [joint for joint in made.joints if joint.unmoved]
    assert [joint.joint[-1] for joint in still] == ["3", "5", "7"]
    random = {joint.joint: joint for joint in pf.export(scene).joints}
    gears = {drive.name: drive.transmission for drive in scene.drives}
    for joint in still:
        gear = gears[joint.joint]
        assert joint.armature == pytest.approx(gear.ratio**2 * gear.rotor_inertia)
        assert joint.frictionloss == pytest.approx(random[joint.joint].frictionloss, rel=0.1)
        assert joint.fitted_rms == pytest.approx(random[joint.joint].error_rms)
        assert joint.fitted_rms <= joint.error_rms
        assert f"leaves an rms of {joint.fitted_rms:.5g} N m" in made.text
    model = mujoco.MjModel.from_xml_string(made.text)
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[:] = motion.joint_positions()[0]
    data.qfrc_applied[4] = 0.5
    mujoco.mj_step(model, data, 1000)
    assert abs(data.qvel[4]) < 1e-3


MIMICS = {  # leader kind, leader's k and o, follower kind: two rods beside each other, and a chain
    "turning": ("revolute", -0.5, 0.2, "revolute"),
    "rack": ("revolute", 0.05, 0.1, "prismatic"),
    "continuous": ("continuous", 2.0, 0.0, "continuous"),
}


@pytest.mark.parametrize(("kind", "k", "o", "follows"), MIMICS.values(), ids=MIMICS)
def test_followers_accelerate_and_stay_with_their_leader(tmp_path, kind, k, o, follows):
    """MuJoCo's soft equation against forward dynamics of the scene; the gap stays below 2e-5."""
    third = urdf_joint(
        "c", "base", "lc", follows, "0 0.6 0.8", f'<mimic joint="b" multiplier="{k}"/>'
    )
    file = urdf(
        tmp_path,
        *(link(name) for name in ("la", "lb", "lc")),
        urdf_joint("a", "base", "la", kind, "0 1 0"),
        urdf_joint(
            "b", "la", "lb", follows, "0 1 0", f'<mimic joint="a" multiplier="{k}" offset="{o}"/>'
        ),
        third,
    )
    file.write_text(
        re.sub('<mass value="1"/>', '<origin xyz="0.3 0 0.1"/><mass value="1"/>', file.read_text())
    )
    scene = pf.load_scene(
        scene_file(tmp_path, "robot: {urdf: robot.urdf}\nactuators: [{joint: a}]\n")
    )
    model = mujoco.MjModel.from_xml_string(pf.export(scene, to="mjcf").text)
    data = mujoco.MjData(model)
    q, v = 0.3, 0.8

    def full(x, shift):
        b = k * x + o * shift
        return [x, b, k * b]

    order = [model.joint(name).qposadr[0] for name in "abc"]
    data.qpos[order], data.qvel[order] = full(q, 1.0), full(v, 0.0)
    mujoco.mj_forward(model, data)
    expected = pf.forward_dynamics(scene, [q], [v], [0.0]).a[0]
    # the equations yield by 1e-4 of what the followers would do alone, here up to 30 m/s^2
    np.testing.assert_allclose(data.qacc[order], full(expected, 0.0), rtol=1e-3, atol=5e-3)
    for _ in range(200):
        mujoco.mj_step(model, data)
        np.testing.assert_allclose(data.qpos[order], full(data.qpos[order[0]], 1.0), atol=2e-5)


def test_springs_are_stiffness_in_joints_and_tendons_between_links(tmp_path):
    """MuJoCo's inverse dynamics of the file beside pinfric's, slack and taut, and the notes."""
    model = random_tree(3, 5, sliding=0.4)
    for j in range(6):
        model.addBodyFrame(f"link_{j}", j, pin.SE3.Identity(), 0)
    ends = {
        "a": {"link": "link_0", "xyz": [0.3, 0.1, 0.0]},
        "b": {"link": "link_4", "xyz": [0, 0.2, 0]},
    }
    rod = {"kind": "tension", "stiffness": 900.0, "free_length": 0.9, **ends}
    coil = {"kind": "torsion", "name": "coil", "joint": "joint_2", "stiffness": 12.0}
    held = [
        coil | {"rest": 0.4, "preload": -2.0},
        coil | {"name": "second"},
        rod | {"name": "slack"},
        rod | {"name": "bar", "pushes": True},
    ]
    lost = [
        rod | {"name": "wound", "initial_tension": 5.0},
        {"kind": "hose", "name": "hose", "joint": "joint_1", "torque": 1.0},
        {"kind": "gas", "name": "strut", "force": 90.0, "length": 9.0, "stroke": 8.9, **ends},
    ]
    scene, (q, v, a) = pf.Scene(model, springs=held), random_states(model, 3)
    efforts = pf.inverse_dynamics(scene, q, v, a).effort_lower
    made = pf.export(scene)
    found = mujoco_inverse(made.text, scene.joint_names, q, v, a)
    np.testing.assert_allclose(found, efforts, rtol=1e-9, atol=1e-8)
    bare = pf.inverse_dynamics(scene.with_(springs=held[:2]), q, v, a).effort_lower
    assert np.abs(efforts - bare).max() > 1.0
    for to, missing in (("mjcf", ()), ("sdf", ("slack", "bar"))):
        said = pf.export(scene.with_(springs=[*held, *lost]), to=to).left_out
        for spring in (*missing, "wound", "hose", "strut"):
            assert any(f"{spring!r} (springs[" in line for line in said), (to, spring)
    assert "<spring_stiffness>24.0<" in pf.export(scene, to="sdf").text
    with pytest.raises(pf.PinfricError, match="the header's rigid body has no 'coil'"):
        pf.export(scene, to="cpp")
    with pytest.raises(pf.PinfricError, match="mujoco_friction takes loads without springs"):
        pf.mujoco_friction(scene, mujoco.MjModel.from_xml_string(made.text))
    rubs = {"slack": dry(3.0)}
    with pytest.raises(pf.PinfricError, match=r"friction along the spring 'slack'"):
        pf.export(scene.with_(friction=rubs))
    with pytest.raises(pf.PinfricError, match=r"friction along the spring 'slack'.*compensator"):
        pf.Solver(scene.with_(friction=rubs)).compensate(q[0], v[0], v[0])
