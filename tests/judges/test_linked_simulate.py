"""Closed mechanisms in time: drift, energy, stick-slip at loop joints, all three methods."""

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import dry, example
from cases import boxer
from dynamics.forward.test_forward import mimic_scene
from mechanisms import add_link, bar, four_bar, grounded_model, shifted

import pinfric as pf
from pinfric.dynamics.samples.closure import consistent_motion
from pinfric.dynamics.simulation.start import start_state
from pinfric.errors import LoopMotionError, SceneError
from pinfric.model.closure import loop_state

METHODS = {"event": {}, "timestepping": {"dt": 4e-3}, "regularized": {"rtol": 1e-5, "atol": 1e-7}}


def parallelogram_scene(friction=None, length=0.2, coupler=0.5):
    """Crank and rocker alike (1 kg each), coupler 2 kg: it swings like one pendulum."""
    model = grounded_model()
    crank = add_link(model, 0, pin.JointModelRZ(), pin.SE3.Identity(), "crank", bar(1.0, length))
    add_link(model, crank, pin.JointModelRZ(), shifted(length), "coupler", bar(2.0, coupler))
    add_link(model, 0, pin.JointModelRZ(), shifted(coupler), "rocker", bar(1.0, length))
    loop = {
        "name": "wrist",
        "kind": "planar_pin",
        "a": {"link": "coupler", "xyz": [coupler, 0, 0]},
        "b": {"link": "rocker", "xyz": [length, 0, 0]},
    }
    named = dict.fromkeys(("crank", "coupler", "rocker", "wrist"), friction) if friction else {}
    return pf.Scene(model=model, friction=named, loops=[loop], actuators=[{"joint": "crank"}])


def swing(angle):
    """q of the parallelogram whose crank is `angle` away from hanging down."""
    return np.array([angle - np.pi / 2, np.pi / 2 - angle, angle - np.pi / 2])


#: theta'' = -STIFFNESS sin(theta) + torque / INERTIA, by hand: two bars about their ends, a coupler
#: that only translates.
INERTIA = 2 * 1.0 * 0.2**2 / 3 + 2.0 * 0.2**2
STIFFNESS = 9.81 * (2 * 1.0 * 0.1 + 2.0 * 0.2) / INERTIA


def residuals(motion):
    """Largest gap (m), rate and acceleration of it over the samples."""
    linkage, zero = motion.scene.linkage, motion.a
    state = loop_state(motion.scene.twin(), linkage, motion.q, motion.v, zero)
    rows = linkage.lambdas
    return [np.abs(x[:, rows]).max() for x in (state.gap, state.rate, state.rate_derivative)]


# Safeguard: what the integration leaves open is closed after every step and in every sample.
# Without (`obey` returns what it is given): gaps of 0.06 m, 0.21 m and 0.09 m after 100 s.
@pytest.mark.parametrize("seconds", [10.0, pytest.param(100.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", METHODS)
def test_loops_stay_closed_for_a_hundred_seconds(method, seconds):
    """Gaps stay below 1e-10 m; the four-bar swings without friction."""
    scene, _ = four_bar(friction={})
    q = scene.close(np.array([-1.2, 1.0, 1.5]), ["O"])
    options = {
        "event": {"rtol": 1e-5, "atol": 1e-7},
        "timestepping": {"dt": 0.02},
        "regularized": {"rtol": 1e-2, "atol": 1e-4},
    }[method]
    motion = pf.simulate(scene, q, np.zeros(3), [0.0], seconds, method, sample_step=0.5, **options)
    gap, rate, _ = residuals(motion)
    assert gap < 1e-10
    assert rate < 1e-10
    assert np.ptp(motion.q[:, 0]) > 0.5  # and it did swing


def test_a_parallelogram_swings_with_the_period_of_its_pendulum():
    from scipy.special import ellipk

    motion = pf.simulate(
        parallelogram_scene(), swing(0.3), np.zeros(3), [0.0], 20.0, sample_step=0.05
    )
    period = 4 * ellipk(np.sin(0.15) ** 2) / np.sqrt(STIFFNESS)
    turns = np.flatnonzero((motion.v[:-1, 0] > 0) & (motion.v[1:, 0] <= 0))  # at +0.3
    assert len(turns) == int(20.0 / period)
    times = [np.interp(0.0, -motion.v[i : i + 2, 0], motion.t[i : i + 2]) for i in turns]
    assert np.diff(times).mean() == pytest.approx(period, rel=1e-4)


def pendulum_with_constant_friction(start, torque, t_end):
    """Reference: the one-freedom equation integrated by SciPy, half swing by half swing."""
    from scipy.integrate import solve_ivp

    t, angle = 0.0, start
    while True:
        held = abs(STIFFNESS * INERTIA * np.sin(angle)) <= torque
        if held:
            return t, angle
        sign = -np.sign(np.sin(angle))  # of the motion that begins

        def rhs(t, y, sign=sign):
            return [y[1], -STIFFNESS * np.sin(y[0]) - sign * torque / INERTIA]

        def stops(t, y):
            return y[1]

        stops.terminal, stops.direction = True, -sign
        found = solve_ivp(
            rhs,
            (t, t_end),
            [angle, 1e-300 * sign],
            events=stops,
            rtol=1e-12,
            atol=1e-14,
            method="DOP853",
            first_step=1e-4,
        )
        assert found.t_events[0].size, "still swinging"
        t, angle = float(found.t_events[0][0]), float(found.y_events[0][0][0])


@pytest.mark.parametrize("method", METHODS)
def test_a_swinging_parallelogram_comes_to_rest_where_one_pendulum_does(method):
    """Constant friction in all four pins, the loop's too, is four times that in one pendulum."""
    coulomb = 0.05
    scene = parallelogram_scene(dry(coulomb))
    stop, angle = pendulum_with_constant_friction(0.8, 4 * coulomb, 10.0)
    motion = pf.simulate(
        scene, swing(0.8), np.zeros(3), [0.0], stop + 0.5, method, **METHODS[method]
    )
    allowed = {"event": 1e-6, "timestepping": 1e-2, "regularized": 1e-2}[method]
    assert motion.q[-1, 0] + np.pi / 2 == pytest.approx(angle, abs=allowed)
    gap, _, _ = residuals(motion)
    assert gap < 1e-10
    if method == "regularized":
        return
    sticks = motion.stick_intervals()
    assert {s.site for s in sticks} == {"crank", "coupler", "rocker", "wrist"}
    for stick in sticks:
        assert stick.start == pytest.approx(stop, abs=allowed)
        assert stick.end == motion.t[-1]
    at_rest = motion.t > stop + 0.01
    assert (motion.v[at_rest] == 0.0).all()
    assert (motion.q[at_rest] == motion.q[-1]).all()


def test_stick_and_slip_of_a_driven_mechanism_by_the_one_pendulum():
    """A torque that grows slowly: it holds until gravity and friction are overcome, to 1e-9 s."""
    coulomb = 0.05
    scene = parallelogram_scene(dry(coulomb, 0.8 * coulomb))
    motion = pf.simulate(scene, swing(0.02), np.zeros(3), {"crank": lambda t: 0.3 * t}, 2.0)
    breakaway = (STIFFNESS * INERTIA * np.sin(0.02) + 4 * coulomb) / 0.3
    slips = [event for event in motion.events if event.kind == "slip"][:4]
    assert sorted(event.name for event in slips) == ["coupler", "crank", "rocker", "wrist"]
    for event in slips:
        assert event.time == pytest.approx(breakaway, abs=1e-9)
    ways = {event.name: event.direction for event in slips}
    assert ways == {"crank": 1, "coupler": -1, "rocker": 1, "wrist": 1}


def test_energy_is_balanced_with_load_dependent_friction_in_a_loop():
    motion = pf.simulate(pf.load_scene("four_bar"), t_end=1.0)
    energy = motion.energy()
    assert energy.friction_loss.min() > 0.0
    assert abs(energy.residual) < 1e-7 * energy.friction_loss.sum()


# Safeguard: what stops one joint of a freedom stops all of it. Without: only two of the four joints
# are said to stick.
def test_all_that_runs_out_stops_at_once():
    """One freedom: when one joint of the slider-crank stops, all four do, at the same instant."""
    motion = pf.simulate(pf.load_scene("slider_crank"))
    sticks = motion.stick_intervals()
    assert {s.site for s in sticks} == {"crank_pin", "rod_pin", "guide", "piston_pin"}
    assert len({s.start for s in sticks}) == 1
    at_rest = motion.t >= sticks[0].start
    assert (motion.v[at_rest] == 0.0).all()
    load, friction = motion.normal_load[at_rest], motion.friction[at_rest]
    static = [site.law.static.mu for site in motion.scene.sites]
    assert (np.abs(friction) <= static * load * (1 + 1e-9)).all()


def test_inverse_dynamics_of_a_simulated_motion_gives_its_efforts_back():
    """Between events, from samples of the four-bar."""
    scene, _ = four_bar(mu=0.2)
    q = scene.close(np.array([0.5, 0.4, 1.5]), ["O"])
    v, _ = consistent_motion(scene, q[None], ["O"], np.array([[2.0]]), np.zeros((1, 1)))
    motion = pf.simulate(scene, q, v[0], {"O": lambda t: 0.8 + 0.2 * np.sin(5 * t)}, 0.5)
    result = pf.inverse_dynamics(scene, motion.q, motion.v, motion.a, t=motion.t)
    error = np.abs(result.effort_lower - motion.effort)[:, 0]
    moving = ~(result.sticking | result.reversal).any(axis=1)
    assert moving.sum() > 400
    assert error[moving].max() < 1e-7


@pytest.mark.slow
def test_time_stepping_a_mechanism_is_first_order():
    scene = pf.load_scene("delta")
    q, v = start_state(scene)
    effort = {"arm_1": -1.0, "arm_2": -1.2, "arm_3": -0.8}
    exact = pf.simulate(scene, q, v, effort, 0.2, rtol=1e-9, atol=1e-11).q[-1]
    errors = [
        np.abs(pf.simulate(scene, q, v, effort, 0.2, "timestepping", dt=dt).q[-1] - exact).max()
        for dt in (4e-3, 2e-3, 1e-3)
    ]
    assert errors[-1] < 5e-4
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.2)


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "drawer", "excavator", "delta"])
def test_bundled_mechanisms_run_as_their_scenes_say(name):
    motion = pf.simulate(pf.load_scene(name))
    assert motion.status == "finished"
    assert motion.stick_intervals()
    assert np.isfinite(motion.friction).all()
    energy = motion.energy()
    turnover = abs(energy.work) + abs(energy.change) + energy.friction_loss.sum()
    assert abs(energy.residual) < 1e-6 * turnover
    if motion.scene.loops:
        gap, rate, _ = residuals(motion)
        assert gap < 1e-10
        assert rate < 1e-10


def test_a_start_that_is_open_or_against_the_loop_says_by_how_much():
    scene = pf.load_scene("four_bar")
    q, v = start_state(scene)
    with pytest.raises(LoopMotionError, match=r"'rocker_pin' is open.*by 0\.0"):
        pf.simulate(scene, pf.load_scene("four_bar").start_configuration, v, [0.0], 0.1)
    with pytest.raises(LoopMotionError, match=r"violated by the velocities.*by 0\.0.*m/s"):
        pf.simulate(scene, q, v + np.array([0.0, 0.0, 0.1]), [0.0], 0.1)


def test_a_motion_goes_to_a_file_and_back_and_knows_its_loops(tmp_path):
    scene = pf.load_scene("four_bar")
    motion = pf.simulate(scene, t_end=0.2)
    path = motion.save(tmp_path / "m")
    again = pf.load_motion(path, scene)
    assert (again.q == motion.q).all()
    loop = scene.loops[0].model_dump()
    loop["a"]["xyz"] = [0.34, 0.0, 0.0]
    other = pf.Scene(
        model=scene.model,
        friction=scene.friction,
        loops=[loop],
        actuators=scene.actuators,
        simulation=scene.simulation,
    )
    with pytest.raises(pf.PinfricError, match="loops"):
        pf.load_motion(path, other)


# Safeguard: guards know the rounding of loads that cancel, and one freedom's joints break away
# together. Without: a wrist "slips" alone at 6e-8 s, then a rod and a piston.
@pytest.mark.slow
def test_one_freedom_breaks_away_at_once_although_nothing_loads_its_pins():
    """Ramp 0.2 t against a brake of 0.05 N m: at 0.25 s, all four joints, and none before."""
    case = boxer(cylinders=1, angle=1.0)
    motion = pf.simulate(case.scene, case.q[0], 0 * case.v[0], lambda t, q, v: [0.2 * t], 0.4)
    slips = [event for event in motion.events if event.kind == "slip"]
    assert {event.name for event in slips} == {"crank", "rod_1", "piston_1", "wrist_1"}
    for event in slips:
        assert event.time == pytest.approx(0.25, abs=1e-9)


# Safeguard: joints at rest only because the mechanism passes their dead centre are not taken for a
# mechanism at rest. Without: no acceleration is found at the first dead centre.
def test_a_boxer_runs_through_its_dead_centres():
    case = boxer(cylinders=2, angle=-0.5, rate=10.0)
    motion = pf.simulate(case.scene, case.q[0], case.v[0], [0.8], 0.6)
    energy = motion.energy()
    assert motion.status == "finished"
    assert abs(energy.residual) < 1e-5 * energy.work
    turns = [event.time for event in motion.events if event.name == "piston_1"]
    others = [event.time for event in motion.events if event.name == "piston_2"]
    assert len(turns) >= 2
    assert turns == pytest.approx(others, abs=1e-6)


# Safeguard: a ball stops about all its axes, or turns on. Without: brakes stop a delta that moves
# straight up, two of a ball's axes stop at once and the third later, and energy() cannot close the
# loop that stands.
def test_a_ball_stops_about_all_its_axes_at_once():
    plain, up = example("delta")
    sample = int(np.argmax(up.v[:90, -1]))
    scene = plain.with_(closed_brakes=dict.fromkeys(plain.actuator_names, 1.5))
    q, v = up.q[sample], up.v[sample]
    motion = pf.simulate(scene, q, v, motor_torque=np.zeros(3), t_end=0.05, attached=())
    assert not motion.v[-1].any()
    energy = motion.energy()
    assert energy.change < -0.1
    assert abs(energy.residual) < 1e-9 * abs(energy.change)


def test_energy_of_mimic_joints_is_balanced():
    scene = mimic_scene()
    motion = pf.simulate(scene, [0.0], [2.0], [0.5], 0.4)
    energy = motion.energy()
    assert abs(energy.residual) < 1e-9 * (abs(energy.work) + energy.friction_loss.sum())


def test_a_start_at_which_loops_do_not_close_is_refused_with_one_at_which_they_do():
    """Newton's method leads nowhere from there; from what the message offers it closes."""
    scene = pf.load_scene("four_bar")
    far = dict.fromkeys(("crank_pin", "coupler_pin", "ground_pin"), 0.0)
    refused = scene.with_(simulation={"start": {"q": far}, "t_end": 0.01})
    with pytest.raises(SceneError, match=r"simulation\.start: loop 'rocker_pin'.*e\.g\.") as error:
        pf.simulate(refused)
    offered = yaml.safe_load(str(error.value).partition("e.g. ")[2])
    taken = scene.with_(simulation={"start": {"q": offered}, "t_end": 0.01})
    assert pf.simulate(taken).status == "finished"
