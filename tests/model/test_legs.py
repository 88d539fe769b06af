"""Robots with legs that hang by a fixed base are named; arms, hands and floating robots are not."""

import re

import numpy as np
import pinocchio as pin
import pytest
from robot_cases import INERTIA, urdf

import pinfric as pf
from pinfric.model.legs import hanging_legs
from pinfric.model.robot import example_robot_data, read_robot
from pinfric.show.inverse_summary import inverse_summary
from pinfric.show.report.inverse import verdict

#: example-robot-data's robots with legs at their base, by their files' names.
LEGGED = re.compile(
    "a1|alexander|anymal|b1|bolt|centauro|g1|go|human|hyq|icub|laikago|quadruped$|romeo|simple_h|"
    "solo|talos_[fr]"
)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
def test_legs_are_told_from_arms_and_fingers_in_all_robots():
    for file in sorted(example_robot_data().rglob("*.urdf")):
        if file.stem not in ("quadrotor_base", "iris_simple", "ur3", "bluevolta", "falcon"):
            model = read_robot(file, {}).model
            assert bool(hanging_legs(model)) == bool(LEGGED.match(file.stem)), file


def robot(tmp_path, names=("left_hip", "RKnee"), root="fixed"):
    """Two pendulums below a trunk of 5 kg that is fixed to the world or floats."""
    body = f'<inertial><mass value="{{}}"/>{INERTIA}</inertial>'
    parts = f'<link name="trunk">{body.format(5)}</link>'
    parts += f'<joint name="root" type="{root}"><parent link="base"/><child link="trunk"/></joint>'
    for name in names:
        parts += f'<link name="{name}_link">{body.format(1)}</link>'
        parts += f'<joint name="{name}" type="continuous"><parent link="trunk"/>'
        parts += f'<child link="{name}_link"/><axis xyz="0 1 0"/></joint>'
    return urdf(tmp_path, parts)


@pytest.mark.parametrize(
    ("names", "root", "hangs"),
    [
        (("left_hip", "RKnee"), "fixed", True),
        (("LLEG_JOINT0", "fl_foot"), "fixed", True),
        (("left_hip_yaw_joint", "right_knee_joint"), "fixed", True),  # H1, G1
        (("leftHipYaw", "rightKneePitch"), "fixed", True),  # Valkyrie
        (("l_leg_hpz", "r_leg_kny"), "fixed", True),  # Atlas
        (("left_hip", "RKnee"), "continuous", True),  # Cassie with its base on joints
        (("left_hip", "arm"), "continuous", False),
        (("left_hip", "arm"), "fixed", False),
        (("chip", "knuckle"), "fixed", False),
        (("left_hip", "RKnee"), "floating", False),
    ],
)
def test_every_verdict_says_that_legs_hang(tmp_path, names, root, hangs):
    file = robot(tmp_path, names, root)
    assert ("legs" in {finding.kind for finding in pf.check(file).findings}) == hangs
    scene = pf.Scene(read_robot(file, {}).model)
    zero = np.zeros((2, scene.model.nv))
    q = np.tile(pin.neutral(scene.model), (2, 1))
    motion = pf.Trajectory.from_arrays(scene, np.array([0.0, 1.0]), q, zero, zero)
    result = pf.inverse_dynamics(scene, motion)
    said = "2 legs hang by the fixed base base, and carry only themselves: to let them stand, "
    said += "write `floating: true`"
    if root == "continuous":
        said = (
            "2 legs hang by trunk, which joints hold to the ground, and carry only themselves: to "
        )
        said += "let them stand, take these joints out of the file, write `floating: true`"
    assert (said in verdict(result, inverse_summary(result, ""))) == hangs
    if root != "floating":
        remarks = pf.size(scene, motion, on_miss="ignore").verdict.remarks
        assert any(said in remark for remark in remarks) == hangs


def test_what_is_proposed_lets_the_robot_stand(tmp_path):
    """The feet bear 7 kg: no force remains at the floating joint."""
    model = read_robot(robot(tmp_path), {}, floating=True).model
    drives = [{"joint": name} for name in ("left_hip", "RKnee")]
    scene = pf.Scene(model, actuators=drives)
    weight = np.array([0.0, 0.0, 3.5 * 9.81, 0.0, 0.0, 0.0])
    zero = np.zeros(model.nv)
    feet = {"left_hip_link": weight, "RKnee_link": weight}
    found = scene.solver().inverse(pin.neutral(model), zero, zero, external=feet)
    assert np.abs(found.effort_upper).max() == pytest.approx(0.0, abs=1e-9)
