"""Constants by hand, against MuJoCo, and read back; what cannot be exported, by name."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import block, random_tree, sliding_block
from export_cases import moved, planar

import pinfric as pf
from pinfric.errors import PinfricError


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
        (lambda: sliding_block(), "urdf", "no URDF .*export to mjcf"),
        (changed, "urdf", r"not the one of three_link.urdf \(inertias\)"),
        (lambda: pf.load_scene("panda_pick_and_place"), "ur", "'panda_joint1' is not a joint of"),
        (lambda: pf.Scene(model=random_tree(0, joints=0)), "ur", "no joint 'shoulder_pan_joint'"),
        (lambda: sliding_block(), "stl", "'stl': there are: mjcf, urdf, ur, sdf"),
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
    assert "the stiffness of the gear of elbow_joint: the joint is rigid there" in lost
    assert "the hysteresis of the gear of elbow_joint: the joint is rigid there" in lost
    assert "Stiffness and hysteresis of gears are" in pf.export(scene, to="cpp").text


def test_the_object_says_what_it_is(ur5):
    made = ur5[2]
    assert len(repr(made).splitlines()) < 12
    frame = made.summary()
    assert frame.loc["elbow_joint", "frictionloss"] == made.joints[2].frictionloss


# URScript of a UR arm, interpreted here.


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
    assert torque[4] > 0.1  # it never moves in the motion: of random states
    slowly = np.array(program["pinfric_friction"]([0.001] * 6))
    np.testing.assert_allclose(
        slowly[0], 0.1 * wanted[0] - 0.049 * made.joints[0].damping, rtol=1e-5
    )
    assert all(f"# {joint.joint}" in text for joint in made.joints)
