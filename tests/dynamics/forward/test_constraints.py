"""What the constraints of a mechanism do with velocities."""

from __future__ import annotations

import numpy as np
import pytest
from cases import rocker_driven_four_bar, turning_four_bar
from mechanisms import FIVE_BAR, five_bar, pin_friction

from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.samples.closure import consistent_motion


@pytest.mark.parametrize("pin", range(4))
def test_one_pin_that_stops_stops_a_mechanism_of_one_freedom(pin):
    case = turning_four_bar(3)
    ws, stopped = Workspace(case.scene), np.arange(4) == pin
    for q, v in zip(case.q, 1e-8 * case.v, strict=True):
        slower, rests = ws.constraints.stop(q, v, stopped)
        assert np.abs(slower).max() < 1e-20
        assert rests.all()


def test_a_pin_that_rests_at_its_dead_centre_stops_nothing():
    """Crank and coupler are in line: the rocker's pin has no speed, and the crank turns on."""
    case = rocker_driven_four_bar([0.0])
    ws = Workspace(case.scene)
    speed = ws.constraints.rates(case.q[0], case.v[0])
    assert (np.abs(speed) < 1e-12).sum() == 1
    stopped = np.abs(speed) < 1e-12
    v, rests = ws.constraints.stop(case.q[0], case.v[0], stopped)
    np.testing.assert_allclose(v, case.v[0], atol=1e-15)
    np.testing.assert_array_equal(rests, stopped)


@pytest.mark.parametrize("pin", range(4))
def test_a_stop_that_would_take_away_a_speed_changes_nothing(pin):
    case, stopped = turning_four_bar(3), np.arange(4) == pin
    v, rests = Workspace(case.scene).constraints.stop(case.q[0], case.v[0], stopped)
    np.testing.assert_array_equal(v, case.v[0])
    np.testing.assert_array_equal(rests, stopped)


def test_a_pin_that_stops_in_a_fast_mechanism_has_no_speed_left():
    scene, q = five_bar("B", dict.fromkeys(FIVE_BAR, pin_friction(0.1)))
    v = consistent_motion(scene, q[None], ["O", "A"], [[5.0, 1e-8]], [[0.0, 0.0]])[0][0]
    stopped = np.array([name == "A" for name in scene.site_names])
    slower, rests = Workspace(scene).constraints.stop(q, v, stopped)
    index = scene.joint_names.index("A")
    assert abs(slower[index]) < 1e-15
    assert 0.0 < np.abs(slower - v).max() < 1e-6
    np.testing.assert_array_equal(rests, stopped)
