"""Tasks of a robot that stands: they take the forces at its feet, or say why they cannot."""

import json

import numpy as np
import pytest
from standing_cases import LEGS, biped, squat

import pinfric as pf
from pinfric.errors import (
    PinfricError,
    RetimeError,
    SizingError,
    StopError,
    SweepError,
)

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
BEARING = "{kind: pin, radius: 0.02, length: 0.05}"
FRICTION = f"bearing: {BEARING}, mu: {{static: 0.2, kinetic: 0.1}}, coulomb: 2.0, viscous: 0.5"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    scene = pf.load_scene(biped(tmp_path_factory.mktemp("tasks"), FRICTION))
    return scene, squat(scene).motion


@pytest.mark.parametrize(
    ("task", "kind", "says"),
    [
        (pf.size, SizingError, "size: forces at the feet hold this robot, and they change with"),
        (pf.retime, RetimeError, "retime: forces at the feet hold this robot, and they change"),
        (pf.stop, StopError, "stop: forces at the feet hold this robot, and what they are"),
        (pf.export, PinfricError, "export the scene of its fixed base"),
    ],
)
def test_what_cannot_take_forces_says_why_in_one_line(case, task, kind, says):
    with pytest.raises(kind, match=says) as refused:
        task(*case)
    assert "\n" not in str(refused.value)


def test_a_sweep_varies_friction_under_the_same_forces(case):
    scene, motion = case
    viscous = {"uniform": {"low": 0.1, "high": 2.0}}
    varied = {
        "pinfric_sweep": 1,
        "samples": 3,
        "parameters": {"friction.left_knee.viscous": viscous},
    }
    found = pf.sweep(scene, motion, varied, processes=1)
    for value, peak in zip(found.values[:, 0], found.figure("peak")[:, 1], strict=True):
        law = scene.friction["left_knee"].model_dump(exclude_unset=True)
        friction = {**scene.friction, "left_knee": {**law, "viscous": float(value)}}
        own = pf.inverse_dynamics(scene.with_(friction=friction), motion)
        worst = np.maximum(np.abs(own.effort_lower), np.abs(own.effort_upper))[:, 1].max()
        assert peak == pytest.approx(worst, rel=1e-12)


def test_a_sweep_of_speed_is_refused(case):
    varied = {
        "pinfric_sweep": 1,
        "samples": 3,
        "parameters": {"speed": {"uniform": {"low": 0.9, "high": 1.1}}},
    }
    with pytest.raises(SweepError, match="speed: the forces on left_foot, right_foot were"):
        pf.sweep(*case, varied, processes=1)
    with pytest.raises(PinfricError, match="were measured at one speed"):
        case[1].with_speed(1.1)


def test_constants_of_the_legs_are_those_under_the_feets_forces(case):
    """The law of a bearing by load has an error, which is that of the result's own torques."""
    scene, motion = case
    exported = pf.export(scene, motion, "constants")
    assert [joint.joint for joint in exported.joints] == list(LEGS)
    result = pf.inverse_dynamics(scene, motion)
    for d, joint in enumerate(exported.joints):
        sliding = result.effort_lower[:, d] == result.effort_upper[:, d]
        friction = (result.effort_lower - result.effort_frictionless)[sliding, d]
        v = result.actuator_velocity[sliding, d]
        missed = friction - joint.frictionloss * np.sign(v) - joint.damping * v
        missed -= joint.armature * result.actuator_acceleration[sliding, d]
        assert np.abs(missed).max() == pytest.approx(joint.error_peak, rel=1e-9)
        assert joint.error_peak < 0.2 * np.abs(friction).max()
    # loads carry the robot: under forces friction is more than without
    free = {name: {"coulomb": 2.0, "viscous": 0.5} for name in LEGS}
    without = pf.export(scene.with_(friction=free), motion, "constants")
    knee, plain = exported.joints[1], without.joints[1]
    assert knee.frictionloss > 1.05 * plain.frictionloss
    assert json.loads(exported.text)["joints"][1]["dry"] == knee.frictionloss


def test_constants_need_a_motion_with_forces(case):
    with pytest.raises(PinfricError, match="give a motion that has them"):
        pf.export(case[0], to="constants")


def test_explain_compares_under_the_same_forces(case):
    from pinfric.accuracy.explain import explain

    found = {row.name: row for row in explain(*case).effects}
    assert found["load"].on
    assert found["load"].peak_change > 0.0
