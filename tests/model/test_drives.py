"""Transmissions in all quadrants, by hand."""

import numpy as np
import pinocchio as pin
import pytest
from builders import block, dry, plane_friction, sliding_block

import pinfric as pf
from pinfric.model.drives import motor_torque_bounds
from pinfric.model.schema import Transmission

GEAR = {"ratio": 100.0, "efficiency": 0.8, "back_efficiency": 0.7, "no_load_torque": 0.02}


def motor(effort, velocity, acceleration=0.0, transmission=GEAR, friction=None):
    """Motor torque bounds where the slide of a 1 kg block must deliver about `effort`."""
    model = block(mass=1.0)
    model.gravity.linear = np.zeros(3)
    model.addFrame(pin.Frame("slide_child", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    scene = pf.Scene(
        model=model,
        friction=friction or {},
        actuators=[{"joint": "slide", "transmission": transmission}],
    )
    result = pf.inverse_dynamics(
        scene,
        [[0.0]],
        [[velocity]],
        [[acceleration]],
        {"slide_child": np.array([acceleration - effort, 0, 0, 0, 0, 0])},
    )
    assert result.effort_frictionless[0, 0] == pytest.approx(effort)
    return result.motor_torque_lower[0, 0], result.motor_torque_upper[0, 0]


def test_driving_forward_pays_the_loss():
    assert motor(50.0, 1.0) == pytest.approx([(50 / 0.8 + 2) / 100] * 2)


def test_braking_forward_gains_from_the_loss():
    assert motor(-50.0, 1.0) == pytest.approx([(-50 * 0.7 + 2) / 100] * 2)


def test_driving_backward_pays_the_loss():
    assert motor(-50.0, -1.0) == pytest.approx([(-50 / 0.8 - 2) / 100] * 2)


def test_braking_backward_gains_from_the_loss():
    assert motor(50.0, -1.0) == pytest.approx([(50 * 0.7 - 2) / 100] * 2)


def test_holding_needs_anything_from_lowering_to_lifting():
    lower, upper = motor(50.0, 0.0)
    assert lower == pytest.approx((50 * 0.7 - 2) / 100)
    assert upper == pytest.approx((50 / 0.8 + 2) / 100)
    assert lower < 50.0 / 100 < upper  # the least that holds is less than lifting takes


def test_holding_adds_the_bearing_to_the_gear():
    friction = {"slide": dry(10.0, 5.0)}
    lower, upper = motor(50.0, 0.0, friction=friction)
    assert lower == pytest.approx((40 * 0.7 - 2) / 100)
    assert upper == pytest.approx((60 / 0.8 + 2) / 100)


def test_a_self_locking_gear_must_be_pushed_to_lower_a_load():
    worm = {"ratio": 50.0, "efficiency": 0.4, "back_efficiency": -0.5}
    lower, _ = motor(50.0, -1.0, transmission=worm)
    assert lower == pytest.approx(-50 * 0.5 / 50)  # negative: pushes down, though the load pulls
    hold = motor(50.0, 0.0, transmission=worm)
    assert hold[0] < 0 < hold[1]  # at rest it holds with no motor torque at all


def test_rotor_inertia_and_motor_viscosity_do_not_pass_through_the_loss():
    gear = {**GEAR, "rotor_inertia": 1e-4, "motor_viscous": 1e-3}
    expected = (50 / 0.8 + 2) / 100 + 100 * (1e-3 * 1.0 + 1e-4 * 3.0)
    assert motor(50.0, 1.0, 3.0, gear) == pytest.approx([expected] * 2)


def test_a_reversing_transmission_turns_the_interval_over():
    turned = {**GEAR, "ratio": -100.0}
    lower, upper = motor(50.0, 0.0)
    assert motor(50.0, 0.0, transmission=turned) == pytest.approx([-upper, -lower])


def test_without_a_transmission_the_motor_is_the_joint():
    scene = sliding_block(plane_friction(0.3, 0.2), 0.1)
    result = pf.inverse_dynamics(scene, *np.zeros((3, 1, 1)))
    assert result.motor_torque_lower[0, 0] == result.effort_lower[0, 0]
    assert result.motor_torque_upper[0, 0] == result.effort_upper[0, 0]


@pytest.mark.parametrize("back_efficiency", [-0.3, 0.0, 0.5])
@pytest.mark.parametrize("velocity", [0.0, 0.7, -0.7])
def test_bounds_enclose_every_effort_of_the_interval_tightly(back_efficiency, velocity):
    """Brute force over the interval: a self-locking gear's torque is not monotone in the effort."""
    gear = Transmission(
        ratio=50.0, efficiency=0.8, back_efficiency=back_efficiency, no_load_torque=0.01
    )
    rng = np.random.default_rng(0)
    for _ in range(200):
        lower, upper = np.sort(rng.uniform(-12, 12, 2))
        t = np.linspace(lower, upper, 2001)
        forward = np.maximum(t / 0.8, back_efficiency * t) + 0.5
        backward = np.minimum(t / 0.8, back_efficiency * t) - 0.5
        possible = {0.0: np.concatenate([forward, backward]), 0.7: forward, -0.7: backward}[
            velocity
        ]
        found = motor_torque_bounds(
            gear, *(np.array([x]) for x in (lower, upper, velocity, 0.0, False)), 1e-6
        )
        assert found[0][0] == pytest.approx(possible.min() / 50, abs=1e-4)
        assert found[1][0] == pytest.approx(possible.max() / 50, abs=1e-4)
