"""Constants by hand, against MuJoCo, and read back; what cannot be exported, by name."""

from __future__ import annotations

import dataclasses
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from builders import block, random_states, random_tree
from envelopes import result_of

import pinfric as pf
from pinfric.cli import main
from pinfric.errors import PinfricError
from pinfric.study.export.constants import TERMS
from pinfric.study.export.mjcf import MjcfJoint, mjcf
from pinfric.study.export.tree import bodies

ROBOTS = Path(__file__).parents[3] / "robots"


def moved(scene, speed=5.0, samples=200):
    """A motion of every joint to and fro, each at its own frequency, with a second at rest."""
    t = np.linspace(0.0, 3.0, samples)
    w = speed * (1.0 + 0.37 * np.arange(scene.model.nv))
    phase = w * np.clip(t[:, None] - 1.0, 0.0, None)
    v, a = np.sin(phase), w * np.cos(phase) * (t[:, None] > 1.0)
    still = t <= 1.0
    q = np.where(still[:, None], 0.0, (1.0 - np.cos(phase)) / w)
    return pf.Trajectory.from_arrays(scene, t, q, v, a)


def mujoco_inverse(text, joints, q, v, a):
    """What MuJoCo computes of the file: (T, nv) torques, friction and rotors among them."""
    model = mujoco.MjModel.from_xml_string(text)
    data, torque = mujoco.MjData(model), np.empty_like(v)
    order = [int(model.joint(name).dofadr[0]) for name in joints]  # branch by branch in MuJoCo
    for k in range(len(v)):
        data.qpos[order], data.qvel[order], data.qacc[order] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse[order]
    return torque


@pytest.fixture(scope="module")
def ur5():
    scene = pf.load_scene("ur5_pick_and_place")
    motion = pf.load_trajectory("ur5_pick_and_place.csv", scene)
    return scene, motion, pf.export(scene, motion), pf.inverse_dynamics(scene, motion)


# ---------------------------------------------------------------- constants


def test_what_is_constant_comes_back():
    gear = {"ratio": -50.0, "rotor_inertia": 2e-4, "motor_viscous": 1e-3, "no_load_torque": 0.02}
    scene = pf.Scene(
        model=block(mass=2.0),
        friction={"slide": {"coulomb": {"static": 3.0, "kinetic": 3.0}, "viscous": 2.0}},
        actuators=[{"joint": "slide", "transmission": gear}],
    )
    (joint,) = pf.export(scene, moved(scene)).joints
    found = [joint.frictionloss, joint.damping, joint.armature]
    wanted = [3.0 + 50.0 * 0.02, 2.0 + 50.0**2 * 1e-3, 50.0**2 * 2e-4]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    assert joint.error_peak < 1e-12
    assert (joint.unit, joint.ratio, joint.apart) == ("N", -50.0, True)
    np.testing.assert_allclose([joint.rest_lower, joint.rest_upper], [-4.0, 4.0])


def test_no_constant_is_negative_and_none_fits_better():
    """Friction that falls with the speed asks for a negative damping."""
    stribeck = {"coulomb": {"static": 5.0, "kinetic": 1.0}, "stribeck": {"velocity": 0.7}}
    scene = pf.Scene(model=block(mass=2.0), friction={"slide": stribeck})
    motion = moved(scene)
    (joint,) = pf.export(scene, motion).joints
    result = pf.inverse_dynamics(scene, motion)
    v, a = motion.v[:, 0], motion.a[:, 0]
    moving = (v != 0.0) & ~result.reversal[:, 0]
    friction = (result.effort_lower - result.effort_frictionless)[moving, 0]
    X = np.column_stack([np.sign(v), v, a])[moving]
    constants = np.array([joint.frictionloss, joint.damping, joint.armature])
    missed = friction - X @ constants
    assert joint.moving == moving.sum()
    assert joint.error_rms == pytest.approx(np.sqrt(np.mean(missed**2)))
    assert joint.damping == 0.0
    slopes = X.T @ missed / np.linalg.norm(X, axis=0) / np.linalg.norm(missed)
    assert slopes[1] < -0.1  # with a sign it would fit better
    assert (np.abs(slopes[constants > 0.0]) < 1e-12).all()  # no better among what is allowed


def test_the_worst_sample_is_where_the_error_is(ur5):
    _, motion, made, result = ur5
    lift = made.joints[1]
    k = int(np.argmin(np.abs(motion.t - lift.worst_time)))
    torque = lift.ratio * result.motor_torque_lower[k, 1]
    given = (
        lift.frictionloss * np.sign(motion.v[k, 1])
        + lift.damping * motion.v[k, 1]
        + lift.armature * motion.a[k, 1]
    )
    assert abs(torque - result.effort_frictionless[k, 1] - given) == pytest.approx(lift.error_peak)
    assert lift.worst_load == pytest.approx(result.effort_frictionless[k, 1])
    assert abs(lift.worst_load) > 40.0


def test_constants_that_a_motion_does_not_tell_apart_are_said():
    scene = pf.Scene(model=block(), friction={"slide": {"viscous": 2.0}})
    t = np.linspace(0.0, 1.0, 50)
    v = np.full((50, 1), 0.5)
    steady = pf.Trajectory.from_arrays(scene, t, 0.5 * t[:, None], v, np.zeros((50, 1)))
    made = pf.export(scene, steady)
    assert not made.joints[0].apart
    assert "does not determine each of these constants" in made.text
    assert pf.export(scene, moved(scene)).joints[0].apart


def test_without_a_motion_random_states_are_taken():
    scene = pf.load_scene("so101")
    made = pf.export(scene)
    assert made.samples == 1000
    assert np.isnan(made.joints[0].rest_lower)
    assert made.joints[1].frictionloss == pytest.approx(0.318, abs=0.003)  # what was identified


def assert_same(found, expected):
    """Two records are the same where all their figures are; NaN, "not known", is the same as NaN.

    Python's == says so only up to 3.12, and only of one and the same NaN.
    """
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_equal(dataclasses.asdict(one), dataclasses.asdict(other))


# ---------------------------------------------------------------- MuJoCo


def test_mujoco_misses_what_the_file_states(ur5):
    """Moving samples; the payload is in the file where the trajectory carries it."""
    scene, motion, made, result = ur5
    carrying = {"part": scene.payloads["part"].model_copy(update={"attached": True})}
    loaded = pf.export(scene.with_(payloads=carrying), motion)
    assert_same(
        loaded.joints, made.joints
    )  # the trajectory says when it is carried, not the default
    q = motion.joint_positions()
    free, held = (
        mujoco_inverse(x.text, scene.joint_names, q, motion.v, motion.a) for x in (made, loaded)
    )
    torque = np.where(motion.attached, held, free)
    still = (motion.v == 0.0) & (motion.a == 0.0)
    for d, joint in enumerate(made.joints):
        lower = joint.ratio * result.motor_torque_lower[:, d]
        upper = joint.ratio * result.motor_torque_upper[:, d]
        line = re.search(rf"<!-- {joint.joint}: .* -->", made.text)[0]
        standing = re.search(r"standing still (\S+) to (\S+) N m", line)
        left_out = [float(x) for x in standing.groups()]
        wanted = [
            (lower - torque[:, d])[still[:, d]].min(),
            (upper - torque[:, d])[still[:, d]].max(),
        ]
        np.testing.assert_allclose(left_out, wanted, rtol=0.01)
        moving = (motion.v[:, d] != 0.0) & (lower == upper)
        assert joint.moving == moving.sum()
        if joint.joint == "wrist_2_joint":
            assert not moving.any()
            assert "never moves in this motion and has no constants" in line
            continue
        missed = torque[moving, d] - lower[moving]
        stated = re.search(r"error rms (\S+), peak (\S+) N m", line)
        rms, peak = np.sqrt(np.mean(missed**2)), np.abs(missed).max()
        np.testing.assert_allclose([float(x) for x in stated.groups()], [rms, peak], rtol=1e-4)
        np.testing.assert_allclose([joint.error_rms, joint.error_peak], [rms, peak], rtol=1e-9)


def test_mujocos_friction_is_soft_in_the_samples_that_the_file_names():
    """Constants along the motion, computed here, differ from mj_inverse there and only there."""
    scene = pf.load_scene("ur10_machine_tending")
    motion = pf.load_trajectory("ur10_machine_tending", scene)
    scene = scene.with_(payloads={})
    bare = pf.Trajectory.from_arrays(scene, motion.t, motion.q, motion.v, motion.a)
    made, result = pf.export(scene, bare), pf.inverse_dynamics(scene, bare)
    v, a = motion.v, motion.a
    torque = mujoco_inverse(made.text, scene.joint_names, motion.joint_positions(), v, a)
    (note,) = made.notes
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


def test_constants_name_the_payload_that_they_were_fitted_with(ur5):
    scene, motion, made, _ = ur5
    count = int(motion.attached.sum())
    part = scene.payloads["part"]
    said = (
        f"with the payload 'part' ({part.mass:g} kg at {part.link}) in {count} of {len(motion.t)} "
    )
    assert made.notes[0].startswith(f"fitted {said}")
    for to in ("mjcf", "urdf", "ur", "sdf", "isaaclab", "newton", "pinocchio"):
        text = " ".join(
            re.sub(r"[#*\n]|<!--|-->|//", " ", pf.export(scene, motion, to).text).split()
        )
        assert f"Fitted {said}samples." in text


def test_mujoco_has_another_friction_by_default(ur5):
    """Why the file says how friction is solved: else its constants are not MuJoCo's."""
    scene, motion, made, _ = ur5
    soft = re.sub(r'solreffriction="[^"]*" solimpfriction="[^"]*"', "", made.text)
    assert soft != made.text
    samples = slice(400, 700)
    states = motion.joint_positions()[samples], motion.v[samples], motion.a[samples]
    hard, other = (mujoco_inverse(text, scene.joint_names, *states) for text in (made.text, soft))
    assert np.abs(hard - other).max() > 5.0


def test_mujoco_steps_it(ur5):
    _, _, made, _ = ur5
    model = mujoco.MjModel.from_xml_string(made.text)
    data = mujoco.MjData(model)
    data.qpos[:] = [0.0, -1.2, 1.9, -1.5, -1.5, 0.0]
    mujoco.mj_step(model, data, 300)
    assert np.isfinite(data.qpos).all()
    assert np.abs(data.qvel).max() < 10.0
    assert data.qvel[1] > 0.1  # nothing drives it: the arm sinks


@pytest.mark.parametrize("seed", range(4))
def test_mujoco_has_the_same_robot(seed):
    """Sliding, turning, continuous joints in any place; constants that are not fitted."""
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
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "first")
    second = model.addJoint(first, pin.JointModelRX(), pin.SE3.Identity(), "second")
    rod = pin.Inertia(
        1.0, np.zeros(3), pin.exp3(np.ones(3)) @ np.diag([0.1, 0.2, 0.3]) @ pin.exp3(-np.ones(3))
    )  # a plate: C = A + B but for rounding
    model.appendBodyToJoint(second, rod, pin.SE3.Identity())
    scene = pf.Scene(model=model)
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


# ---------------------------------------------------------------- URDF


def test_a_urdf_read_back_misses_what_was_stated(tmp_path):
    """Ideal drives: then the constants are all that differs."""
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
        np.testing.assert_allclose(
            ours.toDynamicParameters(), theirs.toDynamicParameters(), atol=1e-12
        )
    efforts = pf.inverse_dynamics(again, motion.q, motion.v, motion.a, t=motion.t)
    wanted = pf.inverse_dynamics(scene, motion)
    for d, joint in enumerate(made.joints):
        moving = (motion.v[:, d] != 0.0) & (wanted.effort_lower == wanted.effort_upper)[:, d]
        missed = (efforts.effort_lower - wanted.effort_lower)[moving, d]
        assert moving.any() == (joint.moving > 0)
        if joint.moving:
            assert np.abs(missed).max() == pytest.approx(joint.error_peak)
            assert np.sqrt(np.mean(missed**2)) == pytest.approx(joint.error_rms)
        else:
            assert joint.joint not in again.friction


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
        np.testing.assert_allclose(ours.homogeneous, theirs.homogeneous, atol=1e-12)


# ---------------------------------------------------------------- UR


def test_the_urscript_gives_the_constants(ur5):
    """URScript's blocks end with `end`; without them and `local` this program is Python's."""
    scene, motion, made, _ = ur5
    text = pf.export(scene, motion, "ur").text
    lines = [line.replace("local ", "") for line in text.splitlines() if line.strip() != "end"]
    program = {}
    exec("\n".join(lines), program)
    rates = [0.5, -0.4, 0.3, -0.2, 0.1, -0.6]
    torque = program["pinfric_friction"](rates)
    wanted = [
        joint.frictionloss * np.sign(v) + joint.damping * v
        for joint, v in zip(made.joints, rates, strict=True)
    ]
    np.testing.assert_allclose(torque, wanted, rtol=1e-5)
    assert torque[4] == 0.0  # it never moves
    slowly = np.array(program["pinfric_friction"]([0.001] * 6))
    np.testing.assert_allclose(
        slowly[0], 0.1 * wanted[0] - 0.049 * made.joints[0].damping, rtol=1e-5
    )
    assert all(f"# {joint.joint}: " in text for joint in made.joints)


# ---------------------------------------------------------------- bad input


def planar():
    model = pin.Model()
    model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "skates")
    model.appendBodyToJoint(1, pin.Inertia.Random(), pin.SE3.Identity())
    return pf.Scene(model=model)


def mimic():
    model = random_tree(1, joints=2, sliding=0.0)
    model.addJoint(1, pin.JointModelMimic(model.joints[1], 2.0, 0.0), pin.SE3.Identity(), "finger")
    model.appendBodyToJoint(3, pin.Inertia.Random(), pin.SE3.Identity())
    return pf.Scene(model=model)


def impossible():
    model = block()
    model.inertias[1] = pin.Inertia(1.0, np.zeros(3), np.diag([0.1, 0.1, 0.5]))
    return pf.Scene(model=model)


def changed():
    scene = pf.load_scene("three_link")
    model = scene.model.copy()
    model.inertias[1] = pin.Inertia.Random()
    return scene.with_(model=model)


@pytest.mark.parametrize(
    ("scene", "to", "message"),
    [
        (lambda: pf.load_scene("four_bar"), "mjcf", "four_bar.yaml: the loop 'rocker_pin'"),
        (lambda: pf.load_scene("excavator"), "urdf", "off the joints 'boom_cylinder'.* 2 more"),
        (lambda: pf.load_scene("drawer"), "ur", "off the joints 'push'"),
        (planar, "mjcf", r"skates \(3 degrees of freedom\)"),
        (mimic, "mjcf", "'finger' mimics another"),
        (impossible, "mjcf", "'slide' moves a body that MuJoCo refuses: .*triangle"),
        (lambda: pf.Scene(model=block()), "urdf", "no URDF .*export to mjcf"),
        (changed, "urdf", r"not the one of three_link.urdf \(inertias\)"),
        (lambda: pf.load_scene("panda_pick_and_place"), "ur", "'panda_joint1' is not a joint of"),
        (lambda: pf.Scene(model=random_tree(0, joints=0)), "ur", "no joint 'shoulder_pan_joint'"),
        (lambda: pf.Scene(model=block()), "stl", "'stl': there are: mjcf, urdf, ur, sdf"),
    ],
)
def test_what_cannot_be_exported_is_named(scene, to, message):
    with pytest.raises(PinfricError, match=message):
        pf.export(scene(), to=to)


def test_a_law_by_direction_is_said_to_be_left_out():
    pair = {
        "positive": {"static": 3.0, "kinetic": 3.0},
        "negative": {"static": 1.0, "kinetic": 1.0},
    }
    scene = pf.Scene(model=block(), friction={"slide": {"coulomb": pair}})
    made = pf.export(scene, moved(scene))
    lost = "the direction of friction.slide.coulomb: one constant for both directions"
    assert lost in made.left_out
    assert made.joints[0].error_peak > 0.9


# ---------------------------------------------------------------- the command


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main(["export", *arguments])
    return ended.value.code


def test_the_command_writes_and_says_what_it_costs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    given = "ur5_pick_and_place", "--trajectory", "ur5_pick_and_place.csv"
    assert run(*given, "--to", "mjcf", "--json") == 0
    answer = result_of(capsys.readouterr().out)
    assert answer["file"] == "ur5_pick_and_place.mjcf.xml"
    assert {*TERMS, "error_rms", "worst_load", "rest_upper"} <= answer["joints"][0].keys()
    assert answer["joints"][4]["error_rms"] is None
    assert any("break-away friction" in line for line in answer["left_out"])
    assert run(*given, "--to", "urdf", "--out", "a/b") == 0
    out = capsys.readouterr().out
    assert "never moves" in out
    assert "rotor inertias" in out
    assert run(*given, "--to", "ur", "--out", "c/friction.script") == 0
    files = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    assert files == {
        "ur5_pick_and_place.mjcf.xml",
        "a/b/ur5_pick_and_place.constants.urdf",
        "c/friction.script",
    }


def test_bad_input_is_one_line_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("three_link.yaml", "three_link.urdf"):
        (tmp_path / name).write_bytes((ROBOTS / name).read_bytes())
    before = (tmp_path / "three_link.urdf").read_bytes()
    assert run("three_link.yaml", "--to", "urdf", "--out", "three_link.urdf") == 2
    assert "three_link.urdf: is the scene's own URDF" in capsys.readouterr().err
    assert run("four_bar", "--to", "mjcf") == 2
    assert run("three_link.yaml", "--to", "stl") == 2
    assert sorted(p.name for p in tmp_path.iterdir()) == ["three_link.urdf", "three_link.yaml"]
    assert (tmp_path / "three_link.urdf").read_bytes() == before


def test_the_object_says_what_it_is(ur5):
    made = ur5[2]
    assert len(repr(made).splitlines()) < 12
    frame = made.summary()
    assert frame.loc["elbow_joint", "frictionloss"] == made.joints[2].frictionloss
