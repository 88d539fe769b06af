"""Gears as their makers give them in forward dynamics, and screws in cylinders with friction."""

import numpy as np
import pytest
import yaml
from builders import dry, random_states, random_tree

import pinfric as pf

#: Efficiencies of one gear over load (N m at the output) and motor speed (rad/s).
CURVES = yaml.safe_load("""
over_load:
- [2.0, 0.35]
- [8.0, 0.58]
- [25.0, 0.71]
speed: 30.0
load: 25.0
over_speed:
- [15.0, 0.76]
- [30.0, 0.71]
- [60.0, 0.64]
- [110.0, 0.57]
""")
NO_LOAD = {
    "positive": {"static": 0.02, "kinetic": 0.012},
    "negative": {"static": 0.016, "kinetic": 0.010},
}


def made(rng, ratio):
    """A maker's gear; half of them lose as much when driven, and lock at speed."""
    return {
        "ratio": ratio,
        "efficiency": CURVES,
        "no_load_torque": NO_LOAD,
        "back_efficiency": "same_loss" if rng.random() < 0.5 else 0.8,
        "motor_viscous": {"coefficient": 2e-4, "exponent": 0.7},
        "rotor_inertia": float(rng.uniform(3e-3, 6e-3)),
    }


@pytest.mark.parametrize("seed", range(24))
def test_inverse_dynamics_gives_the_motor_torques_back(seed):
    """Motor torque -> a -> motor torque, or an interval around it, at 1e-9 of the forces there."""
    rng = np.random.default_rng(seed)
    model = random_tree(seed, int(rng.integers(1, 5)))
    names = tuple(model.names)[1:]
    ratio = np.where(rng.random(len(names)) < 0.3, -80.0, 60.0)
    actuators = [
        {"joint": name, "transmission": made(rng, float(r))}
        for name, r in zip(names, ratio, strict=True)
    ]
    friction = {name: dry(1.0, 0.7) for name in names[::2]}
    scene = pf.Scene(model=model, friction=friction, actuators=actuators)
    (q,), (v,), _ = random_states(model, seed, 1)
    v = v * (rng.random(len(v)) < (0.0, 0.5, 1.0)[seed % 3])
    torque = rng.normal(scale=0.4, size=len(v))
    found = pf.forward_dynamics(scene, q, v, motor_torque=torque)
    wanted = pf.inverse_dynamics(scene, q, v, found.a)
    least, greatest = wanted.motor_torque_lower[0], wanted.motor_torque_upper[0]
    size = np.abs(ratio * torque).max() + np.abs(wanted.effort_frictionless).max()
    assert (np.maximum(least - torque, torque - greatest) * np.abs(ratio)).max() < 1e-9 * size
    assert np.abs(greatest - least)[v != 0.0].max(initial=0.0) < 1e-9 * size


@pytest.mark.parametrize("speed", [0.0, 0.3, -0.3])
def test_a_lead_screw_in_a_cylinder_that_rubs(speed):
    """Motor torque -> a -> motor torque on the excavator, with screws on cylinders and seals."""
    scene = pf.load_scene("excavator")
    screw = {
        "ratio": 2 * np.pi / 0.01,
        "efficiency": 0.5,
        "back_efficiency": 0.2,
        "no_load_torque": 0.4,
        "rotor_inertia": 2e-3,
    }
    seal = {
        "bearing": {"kind": "seal"},
        "mu": {"static": 0.04, "kinetic": 0.03},
        "coulomb": {"static": 400.0, "kinetic": 300.0},
    }
    actuators = [{"cylinder": a.cylinder, "transmission": screw} for a in scene.actuators]
    friction = {**scene.friction, **dict.fromkeys(scene.actuator_names, seal)}
    scene = scene.with_(actuators=actuators, friction=friction)
    q, v = np.array([0.1, -1.2, -0.4]), speed * np.array([1.0, -0.7, 0.5])
    start = pf.inverse_dynamics(scene, q, v, np.zeros(3))
    middle = 0.5 * (start.motor_torque_lower + start.motor_torque_upper)[0]
    for more in (0.0, 0.3, -400.0):
        found = pf.forward_dynamics(scene, q, v, motor_torque=middle + more)
        wanted = pf.inverse_dynamics(scene, q, v, found.a)
        least, greatest = wanted.motor_torque_lower[0], wanted.motor_torque_upper[0]
        assert (np.maximum(least - middle - more, middle + more - greatest)).max() < 1e-9 * 400.0
        if speed == 0.0:
            assert found.a.any() == (more == -400.0)
