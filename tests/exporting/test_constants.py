"""Constants in place of friction: worked out by hand, none better, the worst sample."""

import re

import numpy as np
import pytest
from builders import dry, sliding_block
from export_cases import moved
from numpy.testing import assert_allclose

import pinfric as pf


def test_what_is_constant_comes_back():
    gear = {"ratio": -50.0, "rotor_inertia": 2e-4, "motor_viscous": 1e-3, "no_load_torque": 0.02}
    scene = sliding_block(
        dry(3.0, viscous=2.0), actuators=[{"joint": "slide", "transmission": gear}]
    )
    (joint,) = pf.export(scene, moved(scene)).joints
    found = [joint.frictionloss, joint.damping, joint.armature]
    wanted = [3.0 + 50.0 * 0.02, 2.0 + 50.0**2 * 1e-3, 50.0**2 * 2e-4]
    assert_allclose(found, wanted, rtol=1e-12)
    assert joint.error_peak < 1e-12
    assert (joint.unit, joint.ratio, joint.apart) == ("N", -50.0, True)
    assert_allclose([joint.rest_lower, joint.rest_upper], [-4.0, 4.0])


def test_no_constant_is_negative_and_none_fits_better():
    """Friction that falls with the speed would fit a negative damping."""
    stribeck = dry(5.0, 1.0, stribeck={"velocity": 0.7})
    scene = sliding_block(stribeck)
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
    scene = sliding_block({"viscous": 2.0})
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


def test_constants_name_the_payload_that_they_were_fitted_with(ur5):
    scene, motion, made, _ = ur5
    count = int(motion.attached.sum())
    part = scene.payloads["part"]
    said = (
        f"with the payload 'part' ({part.mass:g} kg at {part.link}) in {count} of {len(motion.t)} "
    )
    assert made.notes[0].startswith(f"fitted {said}")
    for to in ("mjcf", "urdf", "sdf", "constants"):
        text = " ".join(
            re.sub(r"[#*\n]|<!--|-->|//", " ", pf.export(scene, motion, to).text).split()
        )
        assert f"Fitted {said}samples; the stated errors hold for an engine" in text
