"""Constants by hand, against MuJoCo, and read back; refusals by name."""

import json
import re

import numpy as np
import pinocchio as pin
import pytest
from builders import block, random_tree, sliding_block
from export_cases import moved, planar

import pinfric as pf
from pinfric.errors import PinfricError
from pinfric.exporting.engines import shortfalls


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
        (lambda: pf.load_scene("drawer"), "constants", "off the joints 'push'"),
        (planar, "mjcf", "'skates' has 3 degrees of freedom; exports"),
        (mimic, "mjcf", "'finger' mimics another"),
        (impossible, "mjcf", "'slide' moves a body that MuJoCo refuses: .*triangle"),
        (lambda: sliding_block(), "urdf", "no URDF .*export to mjcf"),
        (changed, "urdf", r"not the one of three_link.urdf \(inertias\)"),
        (lambda: sliding_block(), "stl", "'stl': there are: mjcf, urdf, sdf, constants"),
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
    scene = sliding_block({"coulomb": pair})
    made = pf.export(scene, moved(scene))
    lost = "the direction of friction.slide.coulomb: one constant for both directions"
    assert lost in made.left_out
    assert made.joints[0].error_peak > 0.9


def test_elastic_gears_are_said_to_be_rigid_there():
    scene = pf.load_scene("ur10_machine_tending")
    lost = pf.export(scene).left_out
    for key in ("stiffness", "hysteresis"):
        names = ", ".join(scene.actuator_names)
        assert f"the {key} of the gear of {names}: the joint is rigid there" in lost
    assert "Stiffness and hysteresis of gears are" in pf.export(scene, to="cpp").text


@pytest.mark.parametrize(
    ("to", "lines"),
    [
        ("mjcf", ("MuJoCo, mj_step: .* creeps, at its limit", "mj_inverse: no friction at rest")),
        ("urdf", ("Drake: no dry friction, .* {dry}", "Pinocchio, .* {dry}", "Isaac Sim before 5")),
        ("sdf", ("Drake: no dry friction, .* {dry}", "Gazebo, .*: no rotor inertia, {rotor}")),
        ("constants", ("as Drake: .* {dry}", "as Gazebo: .* {rotor}", "measured velocity")),
    ],
)
def test_a_file_says_in_its_head_what_its_engines_do_not_do(ur5, to, lines):
    """With the largest figure at a joint: damping alone, all of it; the rotor."""
    scene, motion, *_ = ur5
    made = pf.export(scene, motion, to)
    joint = max(made.joints, key=lambda joint: joint.frictionloss)
    drag = joint.damping * np.abs(motion.v[:, list(scene.joint_names).index(joint.joint)]).max()
    rotors = {d.name: d.ratio**2 * d.transmission.rotor_inertia for d in scene.drives}
    name, heaviest = max(rotors.items(), key=lambda item: item[1])
    figures = {
        "dry": rf"constants say {joint.frictionloss + drag:.3g} N m \({joint.joint}",
        "rotor": rf"{heaviest:.3g} kg m\^2 \({name}\)",
    }
    head = made.text.partition("<worldbody>")[0].partition("<model")[0].partition("<link")[0]
    for line in lines:
        assert re.search(line.format(**figures), head), line
        if to == "sdf" and "Drake" in line:
            assert f"{drag:.3g} N m where" in head


def test_a_figure_in_the_head_is_of_the_joint_where_it_is_largest(ur5):
    joints = ur5[2].joints
    most = np.eye(6)
    for k, joint in enumerate(joints):
        (*_, rotor) = shortfalls("urdf", joints, 1.5 * most[k], 0.0 * most[k])
        assert f"no rotor inertia, 1.5 kg m^2 ({joint.joint})" in rotor
        creeps, *_ = shortfalls("mjcf", joints, most[k], 2.5 * most[k])
        assert f"creeps, at its limit by 2.5 rad/s ({joint.joint})" in creeps


def test_the_file_of_constants_holds_them_and_where_they_were_fitted(ur5):
    scene, motion, made, result = ur5
    read = json.loads(pf.export(scene, motion, "constants").text)
    load = result.effort_frictionless
    for i, (row, joint) in enumerate(zip(read["joints"], made.joints, strict=True)):
        assert (row["joint"], row["dry"], row["viscous"]) == (
            joint.joint,
            joint.frictionloss,
            joint.damping,
        )
        assert row["armature"] == joint.armature
        assert row["error_rms"] == joint.error_rms
        assert row["about"].startswith(f"{joint.joint}")
        if not joint.unmoved:
            assert load[:, i].min() <= row["load"][0] <= row["load"][1] <= load[:, i].max()
            assert row["speed"] == [motion.v[:, i].min(), motion.v[:, i].max()]
    assert any("links, masses and geometry" in line for line in read["about"])
    model = block()
    model.armature[:] = 0.25  # the model's own counts, too
    sliding = pf.Scene(model=model, friction={"slide": {"viscous": 2.0}})
    (row,) = json.loads(pf.export(sliding, moved(sliding), "constants").text)["joints"]
    assert row["armature"] == pytest.approx(0.25, rel=1e-12)
