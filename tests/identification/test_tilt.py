"""A base that is mounted at another angle than the scene says."""

import numpy as np
import pinocchio as pin
import pytest
from identify_cases import excitation, guess, logged, motor_effort, truth

import pinfric as pf
from pinfric.identification.tilt import base_tilt


@pytest.mark.parametrize("angle", [12.0, pytest.param(4.0, marks=pytest.mark.slow)])
def test_a_tilted_base_is_named_with_gravity_in_its_frame(angle):
    true, motion = truth(), excitation(80, 30.0, 125.0)
    model = true.model.copy()
    model.gravity.linear = pin.utils.rotate("x", np.radians(angle)) @ true.model.gravity.linear
    tilted = model.gravity.linear.copy()
    effort = motor_effort(true.with_(model=model), motion)
    found = pf.identify(guess(80), logged(80, motion, effort))
    tilt = base_tilt(found.estimate)
    assert np.degrees(tilt.angle) == pytest.approx(angle, abs=1.0)
    assert tilt.gravity == pytest.approx(tilted, abs=0.2)
    assert np.linalg.norm(tilt.gravity) == pytest.approx(9.81)
    assert found.doubts[0].startswith(f"the base is tilted by {np.degrees(tilt.angle):.1f} +- ")


def test_a_level_base_is_not(found):
    tilt = base_tilt(found.estimate)
    assert not tilt.doubted
    assert tilt.angle < np.radians(1.0)
