"""Whether elasticity matters: bandwidths of known signals, and what `explain` says."""

import numpy as np
import pytest
from builders import example, lump
from cli_cases import told
from envelopes import result_of

import pinfric as pf
from pinfric.accuracy.explain import explain
from pinfric.elastic.matters import bandwidth, elastic_effect
from pinfric.show.report.explain import elastic_lines


def test_bandwidth_of_sines_and_of_rest():
    t = np.linspace(0.0, 10.0, 4001)
    a = np.stack([np.sin(2 * np.pi * 3 * t), np.zeros_like(t)], axis=1)
    assert bandwidth(t, a) == pytest.approx(3.0, abs=0.1)
    a[:, 1] = 1e-3 * np.sin(2 * np.pi * 8 * t)  # small, but all that this joint does
    assert bandwidth(t, a) == pytest.approx(8.0, abs=0.1)
    assert bandwidth(t, np.zeros((4001, 2))) == 0.0


def test_what_winding_up_takes_of_a_motor():
    """A bar in gravity, q = A sin(w t): t = m g l cos q, and I t''/K beside the motor's torque."""
    import pinocchio as pin
    from builders import chain

    body = lump(4.0, [0.5, 0, 0], 0.2)
    gear = {"ratio": 50.0, "rotor_inertia": 1e-3, "stiffness": 2e3}
    scene = pf.Scene(
        chain(("pin", pin.JointModelRY(), body), gravity=0.0),
        actuators=[{"joint": "pin", "transmission": gear}],
    )
    t = np.linspace(0.0, 4.0, 4001)
    w = 2 * np.pi
    q, v, a = np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)
    result = pf.inverse_dynamics(scene, q[:, None], v[:, None], a[:, None], t=t)
    found = elastic_effect(result)
    J, rotor = 0.2 + 4 * 0.25, 50.0**2 * 1e-3
    assert found.motor_share == pytest.approx(rotor * J * w**2 / 2e3 / (J + rotor), rel=2e-3)
    assert found.bandwidth == pytest.approx(1.0, abs=0.3)
    assert found.frequency == pytest.approx(np.sqrt(2e3 / J) / w, rel=1e-8)
    assert found.sag is None


@pytest.mark.slow
def test_explain_says_it_only_of_elastic_scenes(capsys):
    scene, motion = example("ur10_machine_tending")
    effect = explain(scene, motion).elastic
    assert effect.sag == pytest.approx(2.38e-3, abs=5e-6)
    assert effect.interval == pytest.approx(0.223e-3, abs=1e-6)
    assert effect.motor_share < 2e-3
    for name, elastic in (("ur10_machine_tending", True), ("pendulum", False)):
        found = result_of(told(capsys, "explain", name, "--json").out)
        assert (found["elastic"] is not None) == elastic
    assert explain(scene).elastic.bandwidth is None


def test_explain_says_whose_wind_up_the_controller_corrects():
    """Sag and range had been 0 without a word."""
    scene, motion = example("ur10_machine_tending")
    at_joint = [a.model_copy(update={"encoder": "joint"}) for a in scene.actuators]
    for given, names in ((scene, ()), (scene.with_(actuators=at_joint), scene.actuator_names)):
        found = elastic_effect(pf.inverse_dynamics(given, motion))
        assert found.corrected == tuple(names)
        lines = " ".join(elastic_lines(found))
        assert ("the controller corrects their wind-up" in lines) == bool(names)
    assert found.sag == 0.0
