"""Retiming by closed forms, by an independent phase plane, by an optimizer, and refusals."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry
from mechanisms import pin_friction
from retime_cases import MOTORS, STOPS, WAVE, one_joint, planar, straight
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import pinfric as pf
from pinfric.motions.summary import ends_by_magnitude, rms
from pinfric.retiming.path import Path
from pinfric.retiming.profile import Profile
from pinfric.retiming.retime import retime


def along_a_line(up, down, distance):
    """Time from rest to rest: accelerate by up(v), brake by down(v), switch where it must be."""

    def phase(rate, speed, sign):
        """(distance, time) between rest and a speed."""
        found = solve_ivp(
            lambda v, _: [sign * v / rate(v), sign / rate(v)],
            (0.0, speed),
            [0, 0],
            rtol=1e-10,
            atol=1e-12,
        )
        return found.y[:, -1]

    def whole(speed):
        return phase(up, speed, 1.0) + phase(down, speed, -1.0)

    top = brentq(lambda v: up(v), 1e-6, 1e3)
    switch = brentq(lambda v: whole(v)[0] - distance, 1e-6, 0.999999 * top)
    return whole(switch)[1]


def test_a_hose_speeds_one_way_and_slows_the_other():
    """Rest to rest with (5 + 2)/J to speed up and (5 - 2)/J to brake, and the other way round."""
    hose = {"kind": "hose", "name": "hose", "joint": "j", "torque": 2.0}
    scene, limits = one_joint(inertia=2.0).with_(springs=[hose]), {"j": {"peak_torque": 5.0}}
    up, down = 7.0 / 2.0, 3.0 / 2.0
    expected = np.sqrt(2.0 * 6.0 * (1.0 / up + 1.0 / down))
    assert retime(scene, straight(6.0), limits).duration == pytest.approx(expected, rel=1e-4)
    rubs = {"kind": "tension", "name": "rod", "stiffness": 1.0, "free_length": 0.0, "pushes": True}
    model = scene.model.copy()
    for n, name in enumerate(("ground", "body")):
        model.addBodyFrame(name, n, pin.SE3.Identity(), 0)
    ends = {"a": {"link": "ground", "xyz": [1, 0, 0]}, "b": {"link": "body", "xyz": [0, 0.5, 0]}}
    rubbing = scene.with_(model=model, springs=[rubs | ends], friction={"rod": dry(1.0)})
    with pytest.raises(pf.PinfricError, match=r"friction along the spring 'rod' couples"):
        retime(rubbing, straight(6.0), limits)


def test_coulomb_viscous_and_a_speed_torque_line():
    inertia, coulomb, viscous = 2.0, 1.0, 0.6
    friction = {"j": dry(1.0, viscous=viscous)}
    scene = one_joint(inertia=inertia, friction=friction)
    stall, free, peak = 8.0, 10.0, 5.0
    limits = {"j": {"peak_torque": peak, "stall_torque": stall, "no_load_speed": free}}

    def up(v):
        return (min(peak, stall * (1 - v / free)) - coulomb - viscous * v) / inertia

    def down(v):
        return -(peak + coulomb + viscous * v) / inertia

    found = retime(scene, straight(12.0), limits)
    assert found.duration == pytest.approx(along_a_line(up, down, 12.0), rel=3e-4)
    assert found.excess < 1e-3
    assert set(found.limiting["j"]) == {"peak torque", "speed-torque line"}


def test_gear_by_direction():
    """Accelerating the motor drives through the gear, braking the load drives it back."""
    eta, back, r, T, inertia, rotor = 0.7, 0.5, 50.0, 0.1, 2.0, 2e-4
    gear = {
        "ratio": r,
        "efficiency": eta,
        "back_efficiency": back,
        "rotor_inertia": rotor,
        "no_load_torque": 0.01,
    }
    scene = one_joint(inertia=inertia, transmission=gear)
    up = r * (T - 0.01) / (inertia / eta + r * r * rotor)
    down = r * (T + 0.01) / (inertia * back + r * r * rotor)
    expected = np.sqrt(2.0 * 3.0 * (1 / up + 1 / down))
    found = retime(scene, straight(3.0), {"j": {"peak_torque": T}})
    assert found.duration == pytest.approx(expected, rel=1e-5)
    negative = scene.with_(actuators=[{"joint": "j", "transmission": gear | {"ratio": -r}}])
    assert retime(negative, straight(3.0), {"j": {"peak_torque": T}}).duration == pytest.approx(
        expected, rel=1e-5
    )


def test_pendulum_whose_pin_feels_its_load():
    """Against an independent phase plane of m l^2 a = T - m g l sin(q) - mu r |F|."""
    m, length, mu, radius, g, torque = 2.0, 0.5, 0.2, 0.1, 9.81, 14.0
    weight = pin.Inertia(m, np.array([0, 0, -length]), np.zeros((3, 3)))
    friction = {"j": pin_friction(mu, radius)}
    scene = pf.Scene(chain(("j", pin.JointModelRY(), weight), gravity=g), friction=friction)

    def slope(q, x, drive):
        """d(v^2)/dq = 2 a where the drive gives `drive`, moving forward."""

        def balance(a):
            load = np.hypot(length * a + g * np.sin(q), length * x + g * np.cos(q))
            return m * length**2 * a + m * g * length * np.sin(q) + mu * radius * m * load - drive

        return 2.0 * brentq(balance, -1e3, 1e3)

    begin, end = 0.1, 2.3
    forth = solve_ivp(
        lambda q, x: [slope(q, x[0], torque)],
        (begin, end),
        [0.0],
        dense_output=True,
        rtol=1e-9,
        atol=1e-9,
    )
    back = solve_ivp(
        lambda q, x: [slope(q, x[0], -torque)],
        (end, begin),
        [0.0],
        dense_output=True,
        rtol=1e-9,
        atol=1e-9,
    )
    root = np.linspace(0.0, 1.0, 4001)[1:-1]  # q = begin + way sin^2: even in time at both ends
    q = begin + (end - begin) * np.sin(0.5 * np.pi * root) ** 2
    x = np.minimum(forth.sol(q)[0], back.sol(q)[0])
    weight = (end - begin) * 0.5 * np.pi * np.sin(np.pi * root) / np.sqrt(x)
    expected = weight.sum() * (root[1] - root[0]) + 0.5 * (weight[0] + weight[-1]) / 4000
    found = retime(scene, straight(end, begin), {"j": {"peak_torque": torque}})
    assert found.duration == pytest.approx(expected, rel=5e-4)
    assert found.excess < 1e-3


def test_joint_limits_alone():
    scene = one_joint()
    limits = {"j": {"peak_torque": 1e3, "velocity": 2.0, "acceleration": 4.0}}
    found = retime(scene, straight(3.0), limits)
    assert found.duration == pytest.approx(3.0 / 2.0 + 2.0 / 4.0, rel=1e-6)
    assert set(found.limiting["j"]) == {"joint speed", "acceleration"}


def test_a_joint_that_only_rests_is_within_its_limits():
    alone = Path.from_waypoints([[0.0, 0.3], [1.0, 0.3]])
    assert retime(planar(), alone, MOTORS, points=100).excess < 1e-3


def test_holds_payloads_and_moves():
    scene = pf.load_scene("panda_pick_and_place")
    found = retime(scene, "panda_pick_and_place.waypoints.yaml")
    given = pf.load_trajectory("panda_pick_and_place.waypoints.yaml", scene)
    assert found.duration < 0.7 * given.duration
    assert found.excess < 1e-3
    assert len(found.moves) == 7
    assert found.duration == pytest.approx(found.moves.sum() + 1.2)
    assert np.ptp(found.trajectory.q[[0, -1]], axis=0).max() < 1e-9
    carried = found.trajectory.attached[:, 0]
    assert carried.any()
    assert not carried[0]
    assert not carried[-1]
    from_log = retime(scene, given, points=200)
    assert from_log.duration == pytest.approx(found.duration, rel=2e-3)
    assert from_log.before == pytest.approx(given.duration)
    again = pf.inverse_dynamics(scene, found.trajectory)
    assert (np.abs(again.effort_upper) < 1.001 * scene.model.effortLimit).all()


@pytest.mark.parametrize("width", [0.005, 0.02, 0.05, 0.2])
def test_a_smoothed_motion_keeps_its_limits(width):
    """Judged by inverse dynamics of its samples."""
    scene, plain = planar(), retime(planar(), WAVE, MOTORS)
    found = retime(scene, WAVE, MOTORS, smooth=width)
    judged = pf.inverse_dynamics(scene, found.trajectory)
    ends = judged.motor_torque_lower, judged.motor_torque_upper
    most = np.maximum(*map(np.abs, ends)).max(axis=0)
    assert (most <= 1.001 * np.array([0.32, 0.12])).all()
    assert not found.notes
    slower = found.duration - width  # which is what smoothing costs by itself
    assert plain.duration <= slower < plain.duration * (1.01 if width < 0.03 else 1.3)


@pytest.mark.slow
def test_the_heat_of_a_smoothed_motion_is_its_own():
    limits = {
        "a": {"peak_torque": 0.32, "continuous_torque": 0.15},
        "b": {"peak_torque": 0.12, "continuous_torque": 0.05},
    }
    found = retime(planar(), WAVE, limits, smooth=0.05)
    judged = pf.inverse_dynamics(planar(), found.trajectory)
    worst = ends_by_magnitude(judged.motor_torque_lower, judged.motor_torque_upper)[0]
    part = [rms(judged.t, x) / c for x, c in zip(worst.T, (0.15, 0.05), strict=True)]
    assert found.rms == pytest.approx(part)
    assert max(part) == pytest.approx(1.0, abs=1e-3)


def test_smoothing_costs_its_width_and_stays_on_the_path():
    plain = retime(planar(), STOPS, MOTORS)
    smooth = retime(planar(), STOPS, MOTORS, smooth=0.02)
    assert smooth.duration == pytest.approx(plain.duration + 2 * 0.02, rel=2e-4)
    q, v, a = (getattr(smooth.trajectory, name) for name in "qva")
    jump = np.abs(np.diff(a, axis=0)).max()
    assert jump < 0.3 * np.abs(np.diff(plain.trajectory.a, axis=0)).max()
    assert np.abs((q[2:] - q[:-2]) / 2e-3 - v[1:-1]).max() < 2e-3 * np.abs(v).max()
    assert np.abs(q[-1] - STOPS.stop(2)).max() < 1e-9


def near_rest(scene, points, factor):
    """A spline, and efforts a little above what holds the robot at its hardest place."""
    path = Path.spline(np.arange(float(len(points))), points)
    curve = path.pieces[0]
    q = curve(np.linspace(*curve.x[[0, -1]], 300))
    still = pf.inverse_dynamics(scene, q, 0.0 * q, 0.0 * q)
    most = np.maximum(np.abs(still.effort_lower), np.abs(still.effort_upper)).max(axis=0)
    return path, {
        n: {"effort": factor * e} for n, e in zip(scene.actuator_names, most, strict=True)
    }


def test_limits_near_what_holds_the_robot_give_a_motion():
    """Wherever it is held at rest it goes on slowly; as on a grid of four times the points."""
    a = [0.24, 0.52, 1.33, -1.18, 1.28, 1.36, -0.22, 1.49]
    b = [-0.6, -0.9, -0.4, 0.39, -0.18, 0.0, 0.36, 1.35]
    path, limits = near_rest(planar(), np.transpose([a, b]), 1.14)
    found = retime(planar(), path, limits, heat=False, points=100)
    finer = retime(planar(), path, limits, heat=False, points=400)
    assert found.excess < 1e-3
    assert found.duration == pytest.approx(finer.duration, rel=0.03)


def test_a_drive_that_brings_the_motion_to_a_standstill_is_named(monkeypatch):
    monkeypatch.setattr(Profile, "stalls", lambda _: np.array([3]))
    with pytest.raises(pf.RetimeError, match=r"% of piece 0: drive '[ab]', at its .*, comes to a"):
        retime(planar(), WAVE, MOTORS, points=30)


@pytest.mark.slow
def test_a_motion_that_would_stop_between_two_points_is_solved_on_nearer_ones():
    """At 1200 points the speed of this one fell below 0 inside two intervals: a beyond 1e18."""
    scene, random = pf.load_scene("ur10_machine_tending"), np.random.default_rng(1)
    points = random.uniform(-1.2, 1.2, (6, 6)) - [0.0, 1.2, 0.0, 0.0, 0.0, 0.0]
    path, limits = near_rest(scene, points, 1.25)
    for entry in limits.values():
        entry |= {"effort": entry["effort"] + 1.0, "velocity": 3.0}
    rough, fine = (retime(scene, path, limits, heat=False, points=n) for n in (1200, 4800))
    assert rough.excess < 1e-3
    assert rough.duration == pytest.approx(fine.duration, rel=3e-3)
