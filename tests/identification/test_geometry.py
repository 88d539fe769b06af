"""Bases at another angle, stamps of another clock and zeros that are off, with free links."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from identify_cases import excitation, guess, logged, motor_effort, truth

import pinfric as pf
from pinfric.identification.geometry import Gravity, Zero, gravity_by_efforts, zeros_by_efforts
from pinfric.identification.notes import _geometry, _time, _zeros


@pytest.mark.parametrize("angle", [12.0, pytest.param(4.0, marks=pytest.mark.slow)])
def test_a_tilted_base_is_named_with_gravity_in_its_frame(angle):
    true, motion = truth(), excitation(80, 30.0, 125.0)
    model = true.model.copy()
    model.gravity.linear = pin.utils.rotate("x", np.radians(angle)) @ true.model.gravity.linear
    tilted = model.gravity.linear.copy()
    effort = motor_effort(true.with_(model=model), motion)
    found = pf.identify(guess(80), logged(80, motion, effort))
    tilt = gravity_by_efforts(found.estimate)
    assert np.degrees(tilt.angle) == pytest.approx(angle, abs=1.0)
    assert tilt.vector == pytest.approx(tilted, abs=0.2)
    assert np.linalg.norm(tilt.vector) == pytest.approx(9.81)
    assert found.doubts[0].startswith(f"the base is tilted by {np.degrees(tilt.angle):.1f} +- ")


def test_a_level_base_is_not(found):
    tilt = gravity_by_efforts(found.estimate)
    assert not tilt.tilted
    assert tilt.angle < np.radians(1.0)


def test_time_and_zeros_are_told_as_far_as_logs_know_them(found):
    low, high = gravity_by_efforts(found.estimate).time()
    assert 0.97 < low < high < 1.03
    assert any(f"stamped time over true time is [{low:.3g}, {high:.3g}]" in x for x in found.notes)
    zeros = zeros_by_efforts(found.estimate)
    assert [x.joint for x in zeros] == [1, 2, 3, 4, 5]  # the first axis is upright
    assert not any(x.off or abs(x.value) > 3.0 * x.standard_error for x in zeros)
    said = [note for note in found.notes if "angles are too large by so many rad" in note]
    assert 1 <= len(said) <= 2  # as given, and as shown
    assert all(found.scene.joint_names[x.joint] in " ".join(said) for x in zeros)
    assert not any("stamped" in x or "logged angle" in x for x in found.doubts)


def test_stamps_of_another_clock_are_doubted():
    motion = excitation(80, 30.0, 125.0)
    given = logged(80, motion, motor_effort(truth(), motion))
    found = pf.identify(guess(80), replace(given, t=1.1 * np.asarray(given.t)))
    low, high = gravity_by_efforts(found.estimate).time()
    assert low < 1.1 < high
    said = f"stamped time over true time is [{low:.3g}, {high:.3g}] by gravity"
    assert any(line.startswith(said) for line in found.doubts), found.doubts


def test_a_zero_that_is_off_is_doubted():
    motion = excitation(80, 30.0, 125.0)
    given = logged(80, motion, motor_effort(truth(), motion))
    away = 0.3 * np.eye(6)[1]
    found = pf.identify(guess(80), replace(given, q=np.asarray(given.q) + away))
    shoulder = zeros_by_efforts(found.estimate)[0]
    assert shoulder.off
    assert shoulder.value == pytest.approx(0.3, abs=3.0 * shoulder.standard_error)
    said = "the logged angle is larger than the true one by so many rad: shoulder_lift_joint 0.3"
    assert any(line.startswith(said) for line in found.doubts), found.doubts


def test_gravity_that_is_not_known_tells_no_end_of_the_time():
    known = Gravity(np.zeros(3), 0.0, 0.0, 0.5, 0.2, 1.0)
    assert known.time() == pytest.approx((1.0 / np.sqrt(0.892), 1.0 / np.sqrt(0.108)))
    assert replace(known, size_error=0.3).time()[1] == np.inf
    assert not known.off_the_clock
    assert replace(known, size_error=0.1).off_the_clock
    assert not replace(known, size=0.95, size_error=0.01).off_the_clock


def test_beside_a_large_misfit_of_friction_zeros_and_stamps_are_no_doubt(found):
    off, names = Zero(1, 0.4, 0.05), ["base", "shoulder"]
    doubts, given, lines = _zeros([off], names, True)
    assert "shoulder 0.40 +- 0.10" in doubts[0]
    assert not given + lines
    doubts, given, lines = _zeros([off], names, False)
    assert not doubts + given
    assert "shoulder 0.40 +- 0.10" in lines[0]
    assert not any(x.share > 0.3 for x in found.misfits)
    assert _geometry(found.estimate, [], found.misfits).doubts == ()


def test_what_efforts_hardly_check_is_given_and_what_they_show_is_a_note():
    names = ["base", "shoulder"]
    doubts, (given,), (known,) = _zeros([Zero(1, 0.1, 0.17), Zero(0, 0.0, 0.02)], names, True)
    assert not doubts
    assert given.startswith("zeros of angles are taken as given: ")
    assert given.endswith(": shoulder 0.10 +- 0.33")
    assert known.endswith(": base 0.00 +- 0.04")
    for low, high, place in ((0.92, 1.32, 1), (0.97, 1.03, 2), (1.2, 1.5, 0)):
        said = _time(low, high, "by gravity", place == 0)
        assert [len(x) for x in said] == [place == k for k in range(3)]
    assert (
        _time(0.92, 1.32, "by gravity", False)
        .given[0]
        .startswith(
            "time stamps are taken as given: stamped time over true time is [0.92, 1.32] by gravity"
        )
    )
