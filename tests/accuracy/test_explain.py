"""`explain`: changes by hand, costs that are figures, and the command."""

import numpy as np
import pinocchio as pin
import pytest
from builders import block, chain, dry, sliding_block
from cli_cases import told
from envelopes import result_of
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.accuracy.explain import explain
from pinfric.dynamics.samples.random_states import random_states
from pinfric.motions.summary import known_rms
from pinfric.motions.trajectory import Trajectory


def test_changes_are_those_of_the_drive_by_hand():
    friction = {"slide": dry(3.0, viscous=2.0)}
    scene = pf.Scene(model=block(mass=2.0), friction=friction)
    t = np.linspace(0.0, 1.0, 101)
    v = np.full((101, 1), 0.5)
    motion = Trajectory.from_arrays(scene, t, 0.5 * t[:, None], v, np.zeros((101, 1)))
    found = {e.name: e for e in explain(scene, motion).effects}
    assert found["coulomb"].peak_change == pytest.approx(3.0)
    assert found["coulomb"].rms_change == pytest.approx(3.0)
    assert found["viscous"].peak_change == pytest.approx(1.0)
    assert found["viscous"].drive == "slide"
    assert not found["load"].on
    assert np.isnan(found["load"].cost_us)


def test_rms_is_over_time_not_over_samples():
    """A second of motion in many samples, a slow minute in few; jams are left out of both."""
    scene = sliding_block({"viscous": 2.0})
    t = np.concatenate([np.linspace(0.0, 1.0, 201), [1.1, 30.0, 61.0]])
    v = np.where(t <= 1.0, 0.01, 0.5)
    motion = Trajectory.from_arrays(scene, t, t[:, None], v[:, None], np.zeros((len(t), 1)))
    found = {e.name: e for e in explain(scene, motion).effects}
    over_time = np.sqrt(np.trapezoid((2.0 * v) ** 2, t) / 61.0)
    assert over_time > 0.99
    assert found["viscous"].rms_change == pytest.approx(over_time)
    known = np.array([[1.0, 3.0], [1.0, np.nan], [2.0, 4.0], [2.0, 4.0]])
    times = np.array([0.0, 1.0, 1.5, 9.5])
    assert_allclose(known_rms(times, known), [np.sqrt((1 + 1.25 + 32) / 9.5), 4.0])
    assert_allclose(known_rms(None, known), np.sqrt([10 / 4, 41 / 3]))


def test_random_states_of_a_drive_off_the_joint_by_hand():
    """The drawer has no loop: its pads carry weight and couple, |F| = |m a| + mu |(W, 2 F y/l)|."""
    scene = pf.load_scene("drawer")
    _, v, a = random_states(scene)
    mass, weight, mu, lever = 4.0, 4.0 * 9.81, 0.4, 2.0 * 0.2 / 0.3
    force = inertial = mass * a[:, 0]
    for _ in range(100):  # contracts by mu lever = 0.53
        force = inertial + mu * np.sign(v[:, 0]) * np.hypot(weight, lever * force)
    found = {e.name: e for e in explain(scene).effects}
    change = np.abs(force).max() - np.abs(inertial).max()
    assert found["load"].peak_change == pytest.approx(change)
    assert found["load"].drive == "push"


def test_random_states_do_not_close_loops():
    with pytest.raises(pf.PinfricError, match=r"four_bar\.yaml: .* the loops; give a trajectory$"):
        explain(pf.load_scene("four_bar"))


def test_what_gears_lose_with_their_load_is_a_row_each():
    """One joint drives, the other is driven back; the third loses nothing that grows."""
    model = three_wheels()
    gears = [
        {"ratio": 50.0, "efficiency": 0.8, "back_efficiency": 0.7},
        {"ratio": 20.0, "efficiency": 0.9, "back_efficiency": 0.6},
        {"ratio": 10.0, "rotor_inertia": 1e-3, "no_load_torque": 0.1},
    ]
    actuators = [{"joint": f"wheel_{i}", "transmission": gear} for i, gear in enumerate(gears)]
    scene = pf.Scene(model=model, actuators=actuators)
    t = np.linspace(0.0, 1.0, 101)
    a = np.tile([3.0, -4.0, 5.0], (101, 1))
    v = np.array([1.0, 9.0, 1.0]) + a * t[:, None]
    motion = Trajectory.from_arrays(scene, t, np.zeros((101, 3)), v, a)
    explanation = explain(scene, motion)
    drives, back = explanation.gears
    assert (drives.drive, back.drive) == ("wheel_0", "wheel_1")
    assert drives.rms == pytest.approx(2.0 * 3.0 / 0.8 / 50.0)
    assert drives.peak_change == pytest.approx(2.0 * 3.0 / 50.0 * (1 / 0.8 - 1))
    assert back.rms_change == pytest.approx(2.0 * 4.0 / 20.0 * (0.6 - 1))
    rows = {e.name: e for e in explanation.effects}
    assert rows["gear"].on
    assert rows["gear"].motor_side
    assert rows["gear"].rms_change == pytest.approx(back.rms_change)
    lossless = scene.with_(
        actuators=actuators[2:]
        + [{"joint": a["joint"], "transmission": {"ratio": 2.0}} for a in actuators[:2]]
    )
    assert explain(lossless, motion).gears == ()


def three_wheels():
    """Three wheels of 2 kg m^2 on fixed axles, without weight."""
    body = pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 2.0]))
    return chain(*((f"wheel_{i}", pin.JointModelRZ(), body) for i in range(3)), beside=True)


@pytest.mark.slow
def test_the_command_prints_what_it_measured(capsys):
    said = told(capsys, "explain", "three_link", "three_link.waypoints.yaml", "--json")
    answer = result_of(said.out)
    load = next(e for e in answer["effects"] if e["name"] == "load")
    assert load["on"]
    assert load["why"] == "friction.joint_12.bearing"
    assert load["peak_change"] > 0
    assert answer["total_us"] > 0  # not compared: a busy machine turns timings around
    assert answer["plain_us"] > 0
    off = next(e for e in answer["effects"] if e["name"] == "payload")
    assert off["cost_us"] is None
    assert "friction.joint_12.bearing" in told(capsys, "explain", "three_link").out
