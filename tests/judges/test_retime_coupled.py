"""Retiming with coupled drives: a gantry on two belts, and the same one with slides along them."""

import numpy as np
import pytest
from builders import dry, gantry

import pinfric as pf
from pinfric.errors import RetimeError
from pinfric.retiming.path import Path
from pinfric.retiming.retime import retime

_GEAR = {
    "ratio": 40.0,
    "efficiency": 0.8,
    "back_efficiency": 0.7,
    "rotor_inertia": 2e-4,
    "no_load_torque": 0.1,
    "motor_viscous": 0.002,
}
_LIMITS = {"peak_torque": 1.6, "stall_torque": 4.0, "no_load_speed": 150.0, "max_speed": 60.0}


def test_belts_are_as_fast_as_slides_along_them() -> None:
    """Torque, the motor's line and its greatest speed hold at motors that both joints turn."""
    points = np.array([[0.0, 0.0], [0.5, 0.4], [1.2, 0.1], [0.2, -0.3]])
    to_turned = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    found = []
    for turned in (False, True):
        model, actuators = gantry(turned, _GEAR)
        path = Path.from_waypoints(points @ to_turned.T if turned else points)
        limits = {name: _LIMITS for name in "xz"}
        found.append(retime(pf.Scene(model, actuators=actuators), path, limits))
    belts, slides = found
    assert belts.duration == pytest.approx(slides.duration, rel=1e-6)
    assert belts.excess < 1e-3
    assert {kind for one in belts.limiting.values() for kind in one} >= {"peak torque"}
    result = pf.inverse_dynamics(belts.problem.scene, belts.trajectory)
    torque = np.maximum(np.abs(result.motor_torque_lower), np.abs(result.motor_torque_upper))
    assert 1.55 < torque.max() < 1.602
    assert 40.0 * np.abs(result.actuator_velocity).max() < 60.06


def test_friction_at_coupled_joints_is_refused() -> None:
    model, actuators = gantry(False, _GEAR)
    friction = {"x": dry(3.0, 2.0)}
    scene = pf.Scene(model, friction=friction, actuators=actuators)
    path = Path.from_waypoints([[0.0, 0.0], [0.5, 0.4]])
    with pytest.raises(RetimeError, match="retime accepts friction of coupled drives"):
        retime(scene, path, {name: _LIMITS for name in "xz"})
