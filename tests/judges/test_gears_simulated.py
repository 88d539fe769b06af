"""Simulations driven by motors through lossy gears: pencil and paper, published curves, energy."""

import numpy as np
import pytest
from builders import geared_arm, random_states
from judges.gear_judges import (
    Gear,
    follow,
    heat,
    mesh_reversal,
    sine_against_load,
    smoothed,
    spun_down,
)
from judges.test_cylinder_friction import ARM, INERTIA, PIN, RAM, SEAL, G, M, boom, line, needed
from judges.test_gear_judges import DEMO, PUBLISHED
from judges.test_gears import LOSSY, WORM, hoist
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.forward import holds as holds_module
from pinfric.errors import SimulationError, StateError
from pinfric.friction.holding import Verdict
from pinfric.model.described import in_json
from pinfric.show.motion_summary import motion_summary

RATIO = -50.0


def wheel(mass: float, gear: Gear, friction: dict | None = None) -> pf.Scene:
    """One weightless joint behind a judge's gear; a second motor, "load", pushes it directly."""
    transmission = {
        "ratio": RATIO,
        "efficiency": gear.eta,
        "back_efficiency": gear.eta_b,
        "no_load_torque": gear.n / abs(RATIO),
        "rotor_inertia": gear.inertia / RATIO**2,
        "motor_viscous": gear.drag / RATIO**2,
    }
    scene = hoist(transmission, mass, friction).with_(gravity=[0.0, 0.0, 0.0])
    return scene.with_(
        actuators=[
            {"joint": "lift", "name": "motor", "transmission": transmission},
            {"joint": "lift", "name": "load", "transmission": {"ratio": 1.0}},
        ]
    )


FINE = {"rtol": 1e-11, "atol": 1e-13}
#: Time stepping reads no tolerances.
FINEST = {"event": FINE, "timestepping": {}}


@pytest.mark.parametrize("demo", DEMO)
def test_lossy_gears_follow_the_closed_forms_and_the_published_curves(demo):
    """u = A sin(w t) against h0 + h1 t: stops and starts at 1e-9, Dymola's figures at 1e-7 s."""
    mass, gear, amplitude, w, h0, h1, t_end = DEMO[demo]
    found = pf.simulate(
        wheel(mass, gear),
        [0.0],
        [0.0],
        t_end=t_end,
        **FINE,
        motor_torque=lambda t, q, v: [amplitude * np.sin(w * t) / RATIO, -h0 - h1 * t],
    )
    by_hand = sine_against_load(*DEMO[demo])
    wanted = [by_hand[0].end, by_hand[1].start, by_hand[1].end, by_hand[2].start]
    times = [event.time for event in found.events][-4:]
    assert [event.kind for event in found.events][-4:] == ["stick", "slip", "stick", "slip"]
    assert_allclose(times, wanted, rtol=0, atol=1e-9)
    q, v = follow(by_hand, found.t)
    assert_allclose(found.q[:, 0], q, rtol=0, atol=1e-9)
    assert_allclose(found.v[:, 0], v, rtol=0, atol=2e-8 * np.abs(v).max())
    assert_allclose(times, PUBLISHED[demo][0], rtol=0, atol=1e-7)
    assert found.v[-1, 0] == pytest.approx(PUBLISHED[demo][2], abs=5e-8)
    assert {event.name for event in found.events} == {"motor"}  # no site is there
    lost = heat(by_hand, gear)  # below the stick velocity, too: only what stands still loses none
    assert_allclose(found.energy().gear_loss, [lost, 0.0], rtol=1e-11, atol=1e-15)


def test_a_mesh_that_carries_nothing_does_not_chatter():
    """LossyGearDemo3: M = I = 0.001, eta = eta_b = 0.25, n 0.5, Coulomb 0.5 at the joint.

    While it runs down t = M a + 0.5, and I a + s t + 0.5 = 0 is a = -500, t = 0 whatever s: it
    stops at 0.02 s. From 0.5 s the wheel is pushed with 1: with t = -0.5, F(t) = 0.25 t + 0.5 > 0,
    so the gear holds.
    """
    scene = wheel(0.001, Gear(0.25, 0.25, 0.5, 0.001), {"static": 0.5, "kinetic": 0.5})
    found = pf.simulate(
        scene,
        [0.0],
        [10.0],
        t_end=1.0,
        breakpoints=[0.5],
        **FINE,
        motor_torque=lambda t, q, v: [0.0, float(t >= 0.5)],
    )
    assert [event.kind for event in found.events] == ["stick"]
    assert found.events[0].time == pytest.approx(0.02, abs=1e-9)
    assert found.q[-1, 0] == pytest.approx(0.1, abs=1e-9)
    running = found.t < 0.0199
    assert np.abs(found.effort[running, 0]).max() < 1e-9
    assert found.evaluations < 5000


@pytest.mark.parametrize(("method", "near"), [("event", 1e-9), ("timestepping", 3e-3)])
def test_a_flywheel_spins_down_and_its_mesh_reverses_as_by_hand(method, near):
    gear = Gear(0.8, 0.6, 0.5, 0.7, 0.3)
    path = spun_down(2.0, gear, 4.0)
    found = pf.simulate(
        wheel(2.0, gear),
        [0.0],
        [4.0],
        t_end=1.1 * path.end,
        method=method,
        motor_torque=[0.0, 0.0],
        **FINEST[method],
    )
    assert [event.kind for event in found.events] == ["stick"]
    assert found.events[0].time == pytest.approx(path.end, abs=near)
    assert found.q[-1, 0] == pytest.approx(path.at(path.end)[0], abs=near)
    gear = Gear(0.7, 0.5, 0.3, 0.4)
    by_hand = mesh_reversal(2.0, gear, 3.0, 2.0, 4.0, 1.5)
    found = pf.simulate(
        wheel(2.0, gear),
        [0.0],
        [3.0],
        t_end=1.5,
        method=method,
        **FINEST[method],
        motor_torque=lambda t, q, v: [(2.0 - 4.0 * t) / RATIO, 0.0],
    )
    assert not found.events  # a kink of the right side, nothing more
    wanted = follow(by_hand, found.t)
    assert_allclose(found.q[:, 0], wanted[0], rtol=near)
    assert_allclose(found.v[:, 0], wanted[1], rtol=near, atol=near)


def test_a_worm_lowers_at_constant_speed_and_locks_when_the_motor_stops():
    """u = eta_b h - n: no acceleration. Then u = 0: (I + eta_b M) a = n - eta_b h, 20.62."""
    worm = {**WORM, "rotor_inertia": 3.0 / 50**2}
    lower = -20.62 / 50
    for method, near in (("event", 1e-9), ("timestepping", 3e-3)):
        found = pf.simulate(
            hoist(worm),
            [0.0],
            [-0.2],
            t_end=1.0,
            method=method,
            **FINEST[method],
            breakpoints=[0.5],
            motor_torque=lambda t, q, v: [lower * (t < 0.5)],
        )
        stop = 0.5 + 0.2 * (3.0 - 2.0) / 20.62
        assert found.q[-1, 0] == pytest.approx(-0.1 - 0.1 * (stop - 0.5), abs=near)
        assert [event.kind for event in found.events] == ["stick"]
        assert found.events[0].time == pytest.approx(stop, abs=near)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("transmission", "gear"),
    [
        (LOSSY, Gear(0.8, 0.7, 1.0, 5.0, 2.5)),
        ({**WORM, "rotor_inertia": 3.0 / 50**2}, Gear(0.4, -0.2, 1.0, 3.0)),
    ],
)
def test_a_regularized_gear_moves_as_a_stiff_integrator_of_its_smoothed_law(transmission, gear):
    """The loss s (n + mu |t|) with s = tanh(v / 1e-3): lifted, let go, lowered; M = 10."""

    def u(t):
        return 60.0 - 250.0 * np.sin(12.0 * t)

    found = pf.simulate(
        hoist(transmission),
        [0.0],
        [0.1],
        t_end=0.8,
        method="regularized",
        regularization_velocity=1e-3,
        rtol=1e-8,
        atol=1e-11,
        motor_torque=lambda t, q, v: [u(t) / transmission["ratio"]],
    )
    q, v = smoothed(10.0, lambda t: 98.1, u, gear, 0.1, 0.8, 1e-3, found.t)
    assert v.min() < -0.05 < 0.1 <= v.max()
    assert_allclose(found.q[:, 0], q, rtol=0, atol=1e-6)
    assert_allclose(found.v[:, 0], v, rtol=0, atol=1e-5)


def test_the_energy_of_a_minute_of_stick_and_slip_is_accounted_for():
    """Work of the motor = kinetic, of the rotor, too, + potential + heat of bearing and gear."""
    scene = hoist(LOSSY, friction={"static": 12.0, "kinetic": 8.0})

    def torque(t, q, v):
        return [(98.1 + 100 * np.sin(2 * t) + 20 * np.sin(0.7 * t)) / -50]

    found = pf.simulate(
        scene, [0.0], [0.0], t_end=60.0, motor_torque=torque, rtol=1e-10, atol=1e-12
    )
    energy = found.energy()
    assert len(found.events) > 30
    heat = energy.friction_loss[0] + energy.gear_loss[0]
    assert abs(energy.residual) < 1e-9 * heat
    # the gear's heat once more, from samples: |v| (n + mu |t|) + r^2 c v^2, by quadrants
    t, v = found.effort[:, 0], found.v[:, 0]
    loss = np.where(t * v > 0, 1 / 0.8 - 1, 1 - 0.7) * np.abs(t) + 1.0 + 2.5 * np.abs(v)
    assert np.trapezoid(loss * np.abs(v), found.t) == pytest.approx(energy.gear_loss[0], rel=1e-3)


@pytest.mark.parametrize("seed", [1, 5])
def test_the_energy_of_an_arm_is_accounted_for(seed):
    scene, rng = geared_arm(seed)
    (q,), _, _ = random_states(scene.model, seed, 1)
    ratio = np.array([drive.transmission.ratio for drive in scene.drives])
    n = len(ratio)
    size, w = 8.0 * rng.normal(size=n), rng.uniform(1.0, 6.0, n)

    def torque(t, q, v):
        return (size * np.sin(w * t) - 5.0 * v) / ratio

    found = pf.simulate(scene, q, np.zeros(n), t_end=1.5, motor_torque=torque)
    energy = found.energy()
    assert {"slip", "stick"} <= {event.kind for event in found.events}
    assert abs(energy.residual) < 1e-6 * (energy.friction_loss.sum() + energy.gear_loss.sum())
    assert min(energy.gear_loss.min(), energy.friction_loss.min(initial=0.0)) >= 0.0
    again = found.sample(found.t[10:20])
    assert_allclose(again.motor_torque, found.motor_torque[10:20], rtol=1e-12)
    assert_allclose(again.effort, found.effort[10:20], rtol=1e-6, atol=1e-6)


# ---------------------------------------------------------------- a lead screw on a cylinder

LEAD = 2 * np.pi / 0.01


def screw(eta: float, eta_b: float, friction: dict | None = None) -> pf.Scene:
    """A boom on a lead screw of 10 mm: rad/m for a ratio, I = ratio^2 J kg, n = ratio 0.02 N."""
    transmission = {
        "ratio": LEAD,
        "efficiency": eta,
        "back_efficiency": eta_b,
        "no_load_torque": 0.02,
        "rotor_inertia": 2e-3,
    }
    return boom(friction or {}).with_(actuators=[{**RAM, "transmission": transmission}])


@pytest.mark.parametrize(("eta", "eta_b"), [(0.6, 0.4), (0.4, -0.1)])
def test_a_boom_on_a_lead_screw_moves_as_virtual_work_says(eta, eta_b):
    """J a = m g x + L' t,  slope t + sign(L') n + I (L' a + L'' v^2) = u, the rotor feels L''."""
    scene, step = screw(eta, eta_b), 1e-5
    inertia, n = LEAD**2 * 2e-3, LEAD * 0.02
    for q, v, u in ((0.1, 0.5, -3000.0), (0.1, -0.5, -1000.0), (-0.3, 0.4, 500.0)):
        rate = line(q)[1]
        bend = (line(q + step)[1] - line(q - step)[1]) / (2 * step)
        way, answers = np.sign(rate * v), []
        for drives, slope in ((True, 1 / eta), (False, eta_b)):
            rows = [[INERTIA + M * ARM**2, -rate], [inertia * rate, slope]]
            right = [M * G * ARM * np.cos(q), u - way * n - inertia * bend * v**2]
            answer = np.linalg.solve(rows, right)
            if (way * answer[1] > 0) == drives:
                answers.append(answer)
        found = pf.forward_dynamics(scene, [q], [v], motor_torque=[u / LEAD])
        assert len(answers) == 1
        assert [found.a[0], found.effort[0]] == pytest.approx(answers[0], rel=1e-8)
        inverse = pf.inverse_dynamics(scene, [[q]], [[v]], [found.a])
        assert inverse.motor_torque_lower[0, 0] == pytest.approx(u / LEAD, rel=1e-9)


@pytest.mark.parametrize("friction", [{}, {"pivot": PIN, "ram": SEAL}])
@pytest.mark.parametrize(("eta", "eta_b"), [(0.6, 0.4), (0.4, -0.1)])
def test_a_lead_screw_at_rest_holds_what_inverse_dynamics_says(eta, eta_b, friction):
    """`holds`, forward and inverse dynamics agree at both ends of the motor's interval."""
    scene = screw(eta, eta_b, friction)
    inverse = pf.inverse_dynamics(scene, [[0.2]], [[0.0]], [[0.0]])
    low, high = inverse.motor_torque_lower[0, 0], inverse.motor_torque_upper[0, 0]
    assert (low < 0.0) == (eta_b < 0.0)
    if not friction:  # F at the load alone, by hand
        force, n = needed(0.2, 0.0), LEAD * 0.02
        assert [low, high] == pytest.approx([(eta_b * force - n) / LEAD, (force / eta + n) / LEAD])
    near = 1e-3 * (high - low)
    for torque, held in (
        (low - near, False),
        (low + near, True),
        (0.5 * (low + high), True),
        (high - near, True),
        (high + near, False),
    ):
        found = pf.forward_dynamics(scene, [0.2], [0.0], motor_torque=[torque])
        answer = pf.holds(scene, [0.2], motor_torque=[torque])
        assert (found.a[0] == 0.0) == held == answer.held
        assert (answer.use < 1.0) == held
        assert answer.proved


def test_a_boom_on_a_lead_screw_keeps_its_energy():
    found = pf.simulate(
        screw(0.6, 0.4, {"pivot": PIN, "ram": SEAL}),
        [0.2],
        [0.0],
        t_end=1.5,
        motor_torque=lambda t, q, v: [2.0 * np.sin(5.0 * t) + 1.0],
    )
    energy = found.energy()
    assert {"slip", "stick"} <= {event.kind for event in found.events}
    assert energy.gear_loss[0] > 1.0
    assert abs(energy.residual) < 1e-6 * (energy.gear_loss[0] + energy.friction_loss.sum())


# ---------------------------------------------------------------- what is given, and kept


def test_a_motion_keeps_which_was_given(tmp_path):
    scene = hoist(LOSSY)
    found = pf.simulate(scene, [0.0], [0.0], t_end=0.2, motor_torque={"lift": -3.0})
    assert (found.motor_torque == -3.0).all()
    assert found.given == in_json(motion_summary(found))["given"] == "motor_torque"
    assert found.energy().gear_loss[0] == motion_summary(found).energy.gear_loss["lift"]
    assert found.energy().gear_loss[0] == found.summary().loc["lift", "gear_heat"]
    t = found.a[:, 0] * 10.0 + 98.1
    assert_allclose(found.effort[:, 0], t, rtol=1e-12)
    assert {"lift.effort", "lift.motor_torque"} <= set(found.to_dataframe().columns)
    again = pf.load_motion(found.save(tmp_path / "motion"), scene)
    assert_array_equal(again.motor_torque, found.motor_torque)
    given = pf.simulate(scene, [0.0], [0.0], [120.0], 0.2)
    assert given.motor_torque is None
    assert (given.effort == 120.0).all()
    assert "lift.motor_torque" not in given.to_dataframe().columns


def test_a_scene_says_what_drives_its_simulation():
    scene = hoist(LOSSY)
    section = {"effort": {}, "motor_torque": {"lift": -3.0}, "t_end": 0.1}
    scene = scene.with_(simulation=pf.model.schema.Simulation(**section))
    assert (pf.simulate(scene, [0.0], [0.0]).motor_torque == -3.0).all()
    with pytest.raises(ValueError, match="`effort` and `motor_torque`: give one of them"):
        pf.model.schema.Simulation(**section | {"effort": {"lift": 1.0}})
    with pytest.raises(
        ValueError, match=r"motor_torque\.lift\.\w+\.sine\.angular_frequency\s+Field required"
    ):
        pf.model.schema.Simulation(
            **section | {"motor_torque": {"lift": {"sine": {"amplitude": 1.0}}}}
        )
    with pytest.raises(SimulationError, match="found both effort and motor_torque"):
        pf.simulate(scene, [0.0], [0.0], [1.0], 1.0, motor_torque=[1.0])
    with pytest.raises(SimulationError, match=r"motor_torque: shape \(2,\); should be \(1,\)"):
        pf.simulate(scene, [0.0], [0.0], t_end=1.0, motor_torque=[1.0, 2.0])
    with pytest.raises(StateError, match="neither"):
        pf.holds(scene, [0.0])


def test_what_one_way_to_hold_leaves_open_is_not_refuted(monkeypatch):
    """A worm holds small or large loads: `held` is False only if both are shown not to hold."""
    nothing = Verdict(False, np.inf, np.zeros(1), True)
    doubt = Verdict(None, np.inf, np.zeros(1), False)
    bound = Verdict(False, np.inf, np.zeros(1), False)
    scene = screw(0.4, -0.1, {})
    high = pf.inverse_dynamics(scene, [[0.2]], [[0.0]], [[0.0]]).motor_torque_upper[0, 0]
    for second, held, proved in (
        (nothing, False, True),
        (doubt, None, False),
        (bound, False, False),
    ):
        ends = [(verdict, np.zeros(1)) for verdict in (nothing, second)]
        monkeypatch.setattr(holds_module, "_decide", lambda *_, ends=ends: ends.pop(0))
        found = pf.holds(scene, [0.2], motor_torque=[1.1 * high])
        assert (found.held, found.proved, ends) == (held, proved, [])
