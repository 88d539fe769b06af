"""Retiming by closed forms, by a phase plane integrated apart, by an optimizer, and by refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly
from scipy.optimize import brentq, minimize
from sizing_cases import GEAR, MOTOR, one_drive, turntable

import pinfric as pf
from pinfric.study.retime.limits import candidate_limits, read_limits
from pinfric.study.retime.path import Path
from pinfric.study.retime.problem import Policy
from pinfric.study.retime.profile import Profile
from pinfric.study.retime.retime import _Retiming, retime
from pinfric.study.retime.tables import natural_points
from pinfric.study.sizing.catalog import Amplifier, Conditions, load_catalog
from pinfric.study.sizing.drivetrain import candidates
from pinfric.study.trajectory.joint_columns import joint_columns


def one_joint(inertia=2.0, friction=None, transmission=None):
    """A joint about the vertical that turns a body whose inertia is `inertia`."""
    body = pin.Inertia(1.0, np.zeros(3), np.diag([inertia] * 3))
    model = chain(("j", pin.JointModelRZ(), body), gravity=0.0)
    actuators = None
    if transmission is not None:
        actuators = [{"joint": "j", "transmission": transmission}]
    return pf.Scene(model=model, friction=friction or {}, actuators=actuators)


def straight(end, start=0.0):
    return Path.from_waypoints([[start], [end]])


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


def test_coulomb_viscous_and_a_speed_torque_line():
    inertia, coulomb, viscous = 2.0, 1.0, 0.6
    friction = {"j": {"coulomb": {"static": 1.0, "kinetic": 1.0}, "viscous": viscous}}
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
    """Against the phase plane of m l^2 a = T - m g l sin(q) - mu r |F|, integrated by itself."""
    m, length, mu, radius, g, torque = 2.0, 0.5, 0.2, 0.1, 9.81, 14.0
    weight = pin.Inertia(m, np.array([0, 0, -length]), np.zeros((3, 3)))
    friction = {
        "j": {"bearing": {"kind": "pin", "radius": radius}, "mu": {"static": mu, "kinetic": mu}}
    }
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


def planar(friction=True):
    """Two links that hang, with all kinds of friction and gears that lose."""
    upper = pin.Inertia(3.0, np.array([0, 0, -0.2]), 0.05 * np.eye(3))
    lower = pin.Inertia(1.5, np.array([0, 0, -0.15]), 0.02 * np.eye(3))
    model = chain(("a", pin.JointModelRY(), upper), ("b", pin.JointModelRY(), lower, [0, 0, -0.4]))
    entry = {
        "bearing": {"kind": "pin", "radius": 0.03},
        "mu": {"static": 0.15, "kinetic": 0.1},
        "coulomb": {
            "positive": {"static": 0.5, "kinetic": 0.4},
            "negative": {"static": 0.4, "kinetic": 0.3},
        },
        "viscous": 0.2,
        "stribeck": {"velocity": 0.3},
    }
    gear = {
        "ratio": 60.0,
        "efficiency": 0.85,
        "back_efficiency": 0.8,
        "rotor_inertia": 3e-5,
        "no_load_torque": 0.01,
        "motor_viscous": 2e-5,
    }
    return pf.Scene(
        model=model,
        friction=dict.fromkeys("ab", entry) if friction else {},
        actuators=[{"joint": name, "transmission": gear} for name in "ab"],
    )


WAVE = Path.spline(np.arange(4.0), [[0.0, 0.0], [1.2, -0.8], [0.4, 0.5], [-0.5, 1.0]])
STOPS = Path.from_waypoints([[0.0, 0.0], [1.0, 0.4], [0.2, -0.5]], holds=[0.0, 0.3, 0.1])
MOTORS = {"a": {"peak_torque": 0.32}, "b": {"peak_torque": 0.12}}


def test_within_every_limit_between_the_points_too():
    found = retime(planar(), WAVE, MOTORS, points=300)
    assert 0.9 < found.usage.max() < 1.0 + 1e-3
    assert found.excess < 1e-3
    assert found.profile.holes == 0
    finest = retime(planar(), WAVE, MOTORS, points=1600)
    assert found.duration == pytest.approx(finest.duration, rel=3e-3)


def test_stops_that_are_left_at_once_the_other_way():
    """The sample beside such a stop is a reversal: friction at rest counts both ways there."""
    way = Path.from_waypoints([[0.0, 0.0], [1.0, 0.4], [0.2, -0.5], [0.7, 0.1], [0.1, 0.5]])
    assert retime(planar(), way, MOTORS).excess < 1e-3


def test_far_points_that_miss_the_way_are_set_nearer():
    """A curved path on which a third of the points asked for find no speed at one place."""
    points = np.random.default_rng(7).uniform(-1.6, 1.6, (3, 6, 2))[2]
    path = Path.spline(np.arange(6.0), points)
    motors = {"a": {"peak_torque": 0.6, "effort": 30.0}, "b": {"peak_torque": 0.25}}
    found = retime(planar(), path, motors)
    assert found.excess < 1e-3
    finest = retime(planar(), path, motors, points=3200)
    assert found.duration == pytest.approx(finest.duration, rel=3e-3)


def test_no_other_profile_is_faster():
    """SLSQP on the squares of the speeds, judged by `inverse_dynamics`, on the same coarse grid."""
    scene, natural = planar(), natural_points(WAVE.pieces[0], np.eye(2))
    s = np.union1d(np.linspace(0.0, 3.0, 10), natural)
    run = _Retiming(scene, WAVE, joint_columns(scene.model), read_limits(scene, MOTORS), Policy())
    run.constant = [(0, 0.0, 3.0)]
    problem = run.problem([s])
    # this search knows friction against the motion only: nor at the start both signs
    problem = replace(problem, mode=np.zeros_like(problem.mode))
    best = problem.solve()
    step, curve = np.diff(s), WAVE.pieces[0]
    sliding = scene.with_(stick_velocity=1e-12)

    def duration(x):
        z = np.sqrt(np.concatenate(([0.0], x, [0.0])))
        return 2.0 * (step / (z[1:] + z[:-1])).sum()

    def spare(x):
        """What is left of each limit just inside both ends of every interval."""
        full = np.maximum(np.concatenate(([0.0], x, [0.0])), 0.0)
        u = np.diff(full) / (2.0 * step)
        at = np.concatenate((s[:-1] + 1e-6, s[1:] - 1e-6))
        xs = np.concatenate((full[:-1], full[1:])) + 1e-6
        us = np.concatenate((u, u))
        v = curve(at, 1) * np.sqrt(xs)[:, None]
        a = curve(at, 1) * us[:, None] + curve(at, 2) * xs[:, None]
        found = pf.inverse_dynamics(sliding, curve(at), v, a)
        torque = np.maximum(np.abs(found.motor_torque_lower), np.abs(found.motor_torque_upper))
        return (1.0 - torque / [0.32, 0.12]).ravel()

    def slope(x):
        """Of `spare`: an interval feels the speeds at its two ends, so three steps tell all."""
        rows = np.repeat(np.tile(np.arange(len(step)), 2), 2)
        base, found = spare(x), np.zeros((len(rows), len(x)))
        for k in range(3):
            moved = x.copy()
            moved[k::3] += 1e-6
            change = (spare(moved) - base) / 1e-6
            for near in (rows - 1, rows):
                mine = (near % 3 == k) & (near >= 0) & (near < len(x))
                found[mine, near[mine]] = change[mine]
        return found

    assert spare(best.x[1:-1]).min() > -1e-4
    found = minimize(
        duration,
        best.scaled(0.7).x[1:-1],
        method="SLSQP",
        bounds=[(1e-4, None)] * (len(s) - 2),
        constraints={"type": "ineq", "fun": spare, "jac": slope},
        options={"maxiter": 400, "ftol": 1e-8},
    )
    assert found.fun == pytest.approx(best.duration[0], rel=2e-3)


def test_samples_are_of_one_motion():
    """Velocities and accelerations are the derivatives of the positions, at any rate."""
    found = retime(planar(), WAVE, MOTORS, points=100, sample_rate=20_000.0)
    t, q, v, a = (getattr(found.trajectory, name) for name in "tqva")
    h = t[1] - t[0]
    assert np.abs((q[2:] - q[:-2]) / (2 * h) - v[1:-1])[5:-5].max() < 1e-3 * np.abs(v).max()
    smooth = np.abs(np.diff(a, axis=0)).max(axis=1) < 0.02 * np.abs(a).max()
    rate = (v[1:] - v[:-1]) / h - 0.5 * (a[1:] + a[:-1])
    assert np.abs(rate[smooth]).max() < 0.02 * np.abs(a).max()
    assert found.trajectory.duration == pytest.approx(found.duration)


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


def test_a_payload_that_is_too_heavy_is_named():
    scene, way = pf.load_scene("panda_pick_and_place"), "panda_pick_and_place.waypoints.yaml"
    move = pf.load_trajectory(way, scene)
    still = pf.inverse_dynamics(scene, move.q, 0 * move.v, 0 * move.a, attached=move.attached)
    need = np.abs(still.effort_frictionless[:, 1])
    carried = move.attached[:, 0]
    between = 0.5 * (need[~carried].max() + need[carried].max())
    limits = {name: {"effort": 200.0} for name in scene.actuator_names}
    limits["panda_joint2"] = {"effort": between}
    with pytest.raises(pf.RetimeError, match=r"stop 2, carrying box: drive 'panda_joint2' cannot"):
        retime(scene, way, limits)


MIMIC = """<robot name="pair"><link name="base"/>{}</robot>"""
TURNING = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="{1}" ixy="0"
  ixz="0" iyz="0"/></inertial></link><joint name="j{0}" type="revolute"><parent link="base"/>
  <child link="{0}"/><axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="10" velocity="9"/>
  {2}</joint>"""


def test_followers_rub_at_their_own_speed_and_direction(tmp_path):
    """The follower turns twice as fast, and backwards: J = 1 + 4 x 0.5, friction 1 + 2 x 0.7."""
    follows = '<mimic joint="ja" multiplier="-2"/>'
    links = TURNING.format("a", 1.0, "") + TURNING.format("b", 0.5, follows)
    (tmp_path / "pair.urdf").write_text(MIMIC.format(links))
    (tmp_path / "pair.yaml").write_text("""pinfric: 1
robot: {urdf: pair.urdf}
friction:
  ja: {coulomb: {static: 1.0, kinetic: 1.0}}
  jb: {coulomb: {positive: {static: 2.0, kinetic: 2.0}, negative: {static: 0.7, kinetic: 0.7}}}
""")
    scene = pf.load_scene(tmp_path / "pair.yaml")
    up, down = (10.0 - 2.4) / 3.0, (10.0 + 2.4) / 3.0
    found = retime(scene, straight(2.0))
    assert found.duration == pytest.approx(np.sqrt(2 * 2.0 * (1 / up + 1 / down)), rel=1e-4)
    assert found.excess < 1e-3


def test_guides_on_the_parent():
    body = pin.Inertia(2.0, np.zeros(3), 0.01 * np.eye(3))
    model = chain(("lead", pin.JointModelPX(), body))
    guide = {"kind": "guide", "length": 0.2, "width": 0.1, "on": "parent", "preload": 5.0}
    scene = pf.Scene(
        model=model,
        friction={
            "lead": {"bearing": guide, "mu": {"static": 0.2, "kinetic": 0.1}, "viscous": 3.0}
        },
    )
    found = retime(scene, straight(0.5), {"lead": {"peak_torque": 40.0}})
    assert found.excess < 1e-3
    assert found.usage.max() > 0.999


def test_gears_as_makers_give_them():
    """An efficiency that rises with the load: accelerating it is what it is at that torque."""
    curve = [[2.0, 0.5], [5.0, 0.7], [10.0, 0.8]]
    gear = {
        "ratio": 50.0,
        "efficiency": {"over_load": curve},
        "back_efficiency": "same_loss",
        "no_load_torque": {"static": 0.02, "kinetic": 0.01},
    }
    scene = one_joint(inertia=2.0, transmission=gear)
    # at 10 N m the motor gives 10/0.8 N m/50 with all losses
    found = retime(scene, straight(3.0), {"j": {"peak_torque": 10.0 / 0.8 / 50.0}})
    most = found.trajectory.a.max()  # but for the start, which takes the static torque
    assert most == pytest.approx(10.0 / 2.0, rel=1e-3)
    assert found.excess < 1e-3
    arm = planar()
    gears = arm.with_(
        actuators=[{"joint": name, "transmission": gear | {"rotor_inertia": 3e-5}} for name in "ab"]
    )
    motors = {"a": {"peak_torque": 0.5}, "b": {"peak_torque": 0.25}}
    moved = retime(gears, WAVE, motors)
    assert moved.excess < 1e-3
    assert moved.usage.max() > 0.999
    assert moved.duration == pytest.approx(
        retime(gears, WAVE, motors, points=900).duration, rel=3e-3
    )


def test_sensitivity():
    """T = sqrt(2 D/a) twice: T ~ torque^-1/2."""
    scene = one_joint(inertia=2.0, transmission={"ratio": 50.0, "rotor_inertia": 5e-4})
    found = retime(scene, straight(3.0), {"j": {"peak_torque": 0.1}})
    assert found.sensitivity() == {"j": {"peak torque": pytest.approx(-0.5, abs=1e-3)}}


def test_sensitivity_to_a_continuous_torque():
    """T ~ c^-1/2 of a pure inertia that only its continuous torque limits."""
    limits = {"j": {"peak_torque": 50.0, "continuous_torque": 1.0}}
    found = retime(one_joint(inertia=2.0), straight(3.0), limits, points=60)
    slopes = found.sensitivity(0.05)
    assert slopes == {"j": {"continuous torque": pytest.approx(-0.5, abs=0.01)}}


def lifting():
    """A joint about a horizontal axis, with a weight at 0.5 m: 9.81 N m at q = 90 deg."""
    weight = pin.Inertia(2.0, np.array([0, 0, -0.5]), 1e-3 * np.eye(3))
    model = chain(("j", pin.JointModelRY(), weight))
    model.upperPositionLimit[:] = 3.0
    model.lowerPositionLimit[:] = -3.0
    return pf.Scene(model=model)


@pytest.mark.parametrize(
    ("path", "limits", "message"),
    [
        (
            straight(np.pi / 2),
            {"j": {"peak_torque": 9.0}},
            r"path: stop 1: drive 'j' cannot hold: needs 9.81 N m of its motor, has 9",
        ),
        (straight(1.8, -1.8), {"j": {"peak_torque": 9.0}}, r"stop 0: drive 'j' cannot hold"),
        (straight(1.0), {}, "limits: none for drive 'j'"),
        (straight(1.0), {"j": {"max_speed": 3.0}}, r"limits.j: nothing limits its torque"),
        (straight(1.0), {"k": {}}, "there is no drive 'k'"),
        (straight(1.0), {"j": {"peak": 3.0}}, "unknown key `peak`"),
        (straight(1.0), {"j": {"stall_torque": 3.0}}, "needs both"),
        (straight(4.0), {"j": {"peak_torque": 90.0}}, "joint j: 4 rad at 100 % of piece 0"),
        (straight(1.0), {"j": "no such + thing"}, "has no drive 'no such"),
        (straight(1.0), None, "states no effort limit for 'j'"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(path, limits, message):
    with pytest.raises(pf.PinfricError, match=message) as caught:
        retime(lifting(), path, limits)
    assert "\n" not in str(caught.value)


def test_swinging_over_a_place_where_it_could_not_stand():
    """From -100 to 100 degrees with less than the weight's moment: momentum carries it over."""
    scene = lifting()
    weak = {"j": {"peak_torque": 9.7}}
    found = retime(scene, straight(1.4, -1.4), weak)
    assert found.excess < 1e-3
    with pytest.raises(pf.RetimeError, match=r"cannot hold: needs 9.81"):
        retime(scene, straight(np.pi / 2, -1.4), weak)


def test_motors_file_with_a_drive_of_the_catalogue(tmp_path):
    """Its figures at the motor's shaft: a gearmotor's are printed at the output."""
    text = """pinfric_motors: 1
conditions: {peak_factor: 1.0, bus_voltage: 24.0}
drives:
  j: {drive: CubeMars AK80-64, acceleration: 2.0}
"""
    file = tmp_path / "motors.yaml"
    file.write_text(text)
    limits = read_limits(lifting(), file)[0]
    entry = load_catalog().gearmotors["CubeMars AK80-64"]
    assert limits.acceleration == 2.0
    assert limits.peak_torque == pytest.approx(entry.peak_torque / entry.ratio)
    assert limits.no_load_speed == pytest.approx(
        entry.no_load_speed * entry.ratio * 24.0 / entry.nominal_voltage
    )
    found = retime(lifting(), straight(1.0), file)
    assert found.duration == pytest.approx(np.sqrt(4 * 1.0 / 2.0), rel=1e-3)
    file.write_text(text.replace("AK80-64", "AK80-6000"))
    with pytest.raises(
        pf.RetimeError, match=r"motors.yaml: drives.j: default has no drive .*; the nearest of"
    ):
        retime(lifting(), straight(1.0), file)
    file.write_text("pinfric_motors: 1\nothers: {max_speed: 3.0}\n")
    with pytest.raises(pf.RetimeError, match=r"motors.yaml: others: nothing limits its torque"):
        retime(lifting(), straight(1.0), file)
    file.write_text("pinfric_motors: 1\ndrives: {jay: {peak_torque: 3.0}}\n")
    with pytest.raises(pf.RetimeError, match=r"motors.yaml: drives: there is no drive 'jay'"):
        retime(lifting(), straight(1.0), file)
    file.write_text(text.replace("drives", "motors"))
    with pytest.raises(pf.PinfricError, match="unknown key `motors`"):
        retime(lifting(), straight(1.0), file)


def test_continuous_torque_of_a_pure_inertia():
    """The optimum sqrt(2 sqrt(3) D J/c) is 7 % faster than the whole motion slowed down."""
    D, c, J = 3.0, 1.0, 2.0
    limits = {"j": {"peak_torque": 50.0, "continuous_torque": c}}
    found = retime(one_joint(inertia=J), straight(D), limits, points=150)
    assert found.duration == pytest.approx(np.sqrt(2 * np.sqrt(3) * D * J / c), rel=1e-3)
    assert found.uniform == pytest.approx(2 * np.sqrt(D * J / c), rel=3e-3)
    assert found.rms == pytest.approx([1.0], abs=1e-3)
    assert found.limiting["j"]["continuous torque"] == 1.0
    once = retime(one_joint(inertia=J), straight(D), limits, heat=False, points=150)
    assert once.duration == pytest.approx(2 * np.sqrt(D * J / 50.0), rel=1e-3)
    assert once.rms is None
    unknown = retime(one_joint(), straight(D), {"j": {"peak_torque": 50.0}})
    assert unknown.rms is None


def test_continuous_torques_over_a_cycle_with_holds():
    found = retime(
        planar(),
        STOPS,
        {
            name: entry | {"continuous_torque": 0.6 * entry["peak_torque"]}
            for name, entry in MOTORS.items()
        },
    )
    fast = retime(planar(), STOPS, MOTORS)
    assert fast.duration < found.duration <= found.uniform
    assert found.rms.max() == pytest.approx(1.0, abs=2e-3)
    assert found.excess < 1e-3
    with pytest.raises(pf.RetimeError, match="'a' exceeds its continuous torque at any speed"):
        retime(planar(), STOPS, {"a": MOTORS["a"] | {"continuous_torque": 0.02}, "b": MOTORS["b"]})


def table_drive(tmp_path, gear=None, motor=None, **conditions):
    """A turntable, the drive of `sizing_cases` with figures changed, and its limits."""
    catalog = one_drive(tmp_path, motor, gear)
    (candidate,) = candidates(catalog, False)
    return turntable(), candidate_limits(candidate, Conditions(**conditions)), candidate


def test_an_amplifiers_continuous_current_is_heat_of_its_own(tmp_path):
    """Its RMS is used up, and named, where it is less than the motor's continuous torque."""
    amplifier = Amplifier(
        source="invented", grade="R", continuous_current=2.0, peak_current=20.0, current="dc"
    )
    scene, _, candidate = table_drive(tmp_path)
    fed = replace(candidate, amplifier=amplifier)
    path = Path.from_waypoints([[0.0], [2.0], [0.0]])
    found = retime(scene, path, {"table": fed})
    assert found.limiting["table"]["amplifier continuous current"] == 1.0
    by_name = {c.name: c for c in found.criteria["table"]}
    assert by_name["amplifier continuous current"].margin == pytest.approx(0.0, abs=2e-3)
    assert by_name["amplifier continuous current"].available == 2.0 * MOTOR["torque_constant"]


def test_a_drive_of_the_catalogue_is_limited_as_size_judges_it(tmp_path):
    """The retimed motion uses all of a limit that `size` finds used up, and heat is one."""
    scene, limits, candidate = table_drive(tmp_path)
    assert limits.peak_torque == MOTOR["peak_torque"] / Conditions().peak_factor
    hot = 1 + 0.0039 * (MOTOR["thermal"]["max_winding"] - 25)
    stall = 48.0 * MOTOR["torque_constant"] / (MOTOR["resistance"] * hot)
    assert limits.stall_torque == pytest.approx(stall)
    path = Path.from_waypoints([[0.0], [2.0], [0.0]])
    once = retime(scene, path, {"table": candidate}, heat=False)
    with pytest.warns(pf.PinfricWarning, match="table: this motion, repeated, does not pass"):
        found = retime(scene, path, {"table": candidate})
    assert once.duration < found.duration
    assert found.limiting["table"]["continuous torque"] == 1.0
    assert found.rms == pytest.approx([1.0], abs=2e-3)
    by_name = {c.name: c for c in found.criteria["table"]}
    assert by_name["continuous torque"].margin == pytest.approx(0.0, abs=2e-3)
    report = pf.size(scene, found.trajectory, one_drive(tmp_path), on_miss="ignore")
    for mine, theirs in zip(
        found.criteria["table"], report.joints[0].assessments[0].criteria, strict=True
    ):
        assert mine.name == theirs.name
        if theirs.margin is not None:
            assert mine.margin == pytest.approx(theirs.margin, rel=1e-9)


def test_the_momentary_peak_of_a_gear_is_no_limit_of_a_cycle(tmp_path):
    gear = {"repeated_peak_torque": None}
    _, limits, _ = table_drive(tmp_path, gear)
    assert limits.least("effort") == GEAR["average_torque"]
    gear |= {"average_torque": None, "rated_torque": None}
    scene, _, candidate = table_drive(tmp_path, gear)
    path = Path.from_waypoints([[0.0], [2.0]])
    with pytest.raises(pf.RetimeError, match=r"M \+ G cannot be checked: .* gear repeated peak"):
        retime(scene, path, {"table": candidate})


def test_smoothing_beyond_a_limit_is_a_warning():
    with pytest.warns(pf.PinfricWarning, match=r"smoothing over 200 ms exceeds the .* of [ab] by"):
        found = retime(planar(), WAVE, MOTORS, smooth=0.2)
    assert found.excess > 1e-3
    assert found.notes


def test_smoothing_costs_its_width_and_stays_on_the_path():
    plain = retime(planar(), STOPS, MOTORS)
    smooth = retime(planar(), STOPS, MOTORS, smooth=0.02)
    assert smooth.duration == pytest.approx(plain.duration + 2 * 0.02)
    q, v, a = (getattr(smooth.trajectory, name) for name in "qva")
    jump = np.abs(np.diff(a, axis=0)).max()
    assert jump < 0.3 * np.abs(np.diff(plain.trajectory.a, axis=0)).max()
    assert np.abs((q[2:] - q[:-2]) / 2e-3 - v[1:-1]).max() < 2e-3 * np.abs(v).max()
    assert np.abs(q[-1] - STOPS.stop(2)).max() < 1e-9


def test_kinks_and_repeated_points_are_refused():
    with pytest.raises(pf.PinfricError, match=r"points\[2\]: the same position as points\[1\]"):
        Path.from_waypoints([[0.0], [1.0], [1.0]])
    knots = np.array([0.0, 1.0, 2.0])
    bent = PPoly(np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [1.0, 0.0]]]), knots)
    with pytest.raises(pf.PinfricError, match="a corner at s = 1"):
        Path((bent,))
    with pytest.raises(pf.PinfricError, match=r"no joint moves with s at s = 0.875"):
        Path.from_waypoints([[0.0], [1.0], [0.5]], via=[False, True, False])
    with pytest.raises(pf.PinfricError, match=r"stop 1: hold -1 s, should be 0 or more"):
        Path.from_waypoints([[0.0], [1.0]], holds=[0.0, -1.0])
    with pytest.raises(pf.PinfricError, match="a via point is passed without a stop and cannot"):
        Path.from_waypoints([[0.0], [0.5], [1.0]], via=[False, True, False], holds=[0.0, 1.0, 0.0])
    with pytest.raises(pf.PinfricError, match="attached need one entry for each of 2 points"):
        Path.from_waypoints([[0.0], [1.0]], attached=[[True]])
    load = Path.from_waypoints([[0.0], [1.0]], attached=[[True], [True]])
    with pytest.raises(pf.RetimeError, match="1 columns for 0 payloads"):
        retime(one_joint(), load, {"j": {"peak_torque": 1.0}})
    with pytest.raises(pf.PinfricError, match=r"attached: shape \(3,\)"):
        Path.from_waypoints([[0.0], [0.5], [1.0]], attached=[True, True, False])
    with pytest.raises(pf.PinfricError, match=r"points\[0\].via"):
        Path.from_waypoints([[0.0], [1.0]], via=[True, False])


def test_a_motion_that_turns_back_between_samples_stops_there():
    scene = one_joint()
    t = np.linspace(0.0, 2.0, 402)
    swing = 1.0 - np.cos(np.pi * t)  # to 2 rad at 1 s, between two samples, and back
    move = pf.Trajectory.from_arrays(scene, t, swing[:, None])
    path = Path.from_trajectory(move)
    assert len(path.pieces) == 2
    assert path.stop(1) == pytest.approx([2.0], abs=1e-4)
    found = retime(scene, path, {"j": {"peak_torque": 8.0}})
    assert found.moves == pytest.approx([2.0 * np.sqrt(2.0 / 4.0)] * 2, rel=1e-3)


def test_loops_are_refused_by_name():
    with pytest.raises(pf.RetimeError, match=r"open chains .* loop '"):
        retime(pf.load_scene("four_bar"), Path.from_waypoints([[0.0], [1.0]]))
    with pytest.raises(pf.RetimeError, match="a drive off the joints"):
        retime(pf.load_scene("drawer"), Path.from_waypoints([[0.0], [1.0]]))


def test_via_points_are_passed_without_a_stop(tmp_path):
    scene = planar()
    text = """pinfric_trajectory: 1
points:
  - {q: [0.0, 0.0]}
  - {q: [0.6, 0.3], via: true}
  - {q: [1.0, -0.4], hold: 0.3}
"""
    file = tmp_path / "way.yaml"
    file.write_text(text)
    passing = retime(scene, str(file), MOTORS, points=100)
    file.write_text(text.replace(", via: true", ""))
    stopping = retime(scene, str(file), MOTORS, points=100)
    assert len(passing.moves) == 1
    assert passing.duration < 0.95 * stopping.duration
    file.write_text(text)
    with pytest.raises(pf.PinfricError, match=r"points\[1\].via: a point without a stop"):
        pf.load_trajectory(file, scene)
    file.write_text(text.replace("via: true", "via: true, hold: 1"))
    with pytest.raises(pf.PinfricError, match=r"points\[1\]: `via` passes it without a stop"):
        retime(scene, str(file), MOTORS)


def test_a_slower_profile_is_the_same_in_another_time():
    found = retime(planar(), WAVE, MOTORS, points=60).profile
    slower = found.scaled(0.5)
    again = Profile.of(slower.grid, slower.x, slower.u)
    assert again.duration == pytest.approx(2.0 * found.duration)
