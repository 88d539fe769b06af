"""One stop: ten worked out by hand, a balance of energy, an arm by independent integration."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import lump
from stop_cases import ARM, arm, axis, turntable

import pinfric as pf
from pinfric.errors import StopError
from pinfric.stops.machines import MachineKind, Machines
from pinfric.stops.motion import BrakedMachine, stop_motion, tool_path


def machine(scene, torque, delay, drive_torque=0.0, deceleration=None):
    """The machine of a scene whose only drive is "axis"."""
    return BrakedMachine(
        scene=scene,
        carried=(),
        torque={} if torque is None else {"axis": torque},
        delay={} if torque is None else {"axis": delay},
        drive_torque={"axis": drive_torque} if drive_torque else {},
        deceleration=None if deceleration is None else np.array([deceleration]),
    )


def lift(friction=20.0):
    """10 kg on a vertical screw, 200 rad/m, with 20 kg of rotor: 200^2 x 5e-4; 98.1 N of weight."""
    body = lump(10.0, moment=1.0)
    return axis(pin.JointModelPZ(), body, friction, 9.81, ratio=200.0, rotor_inertia=5e-4)


# Scene, brake N m, delay s, speed; further arguments; time s, way, energy of the brake J.
BY_HAND = {
    # coasts 0.04 rad; 50 N m on 2 kg m^2 is 25 rad/s^2: 0.04 s, 0.02 rad; all of 1 J
    "turntable": (turntable(), 0.5, 0.04, 1.0, {}, 0.08, 0.06, 1.0),
    # 5 rad/s^2 down to 0.8 in 0.036 rad; then 30: 0.8/30 s, 0.64/60 rad
    "turntable with friction": (
        *(turntable(10.0), 0.5, 0.04, 1.0, {}),
        *(0.04 + 0.8 / 30, 0.036 + 0.64 / 60, 50 * 0.64 / 60),
    ),
    # (98.1 - 20)/30 = 2.60333 faster for 0.05 s: 0.630167 m/s after 0.0282542 m;
    # (400 + 20 - 98.1)/30 = 10.73: 0.0587294 s, 0.0185048 m
    "lift going down": (lift(), 2.0, 0.05, -0.5, {}, 0.1087294, -0.0467590, 7.40194),
    # (98.1 + 20)/30 = 3.93667 slower: 0.303167 m/s after 0.0200792 m; then 17.27: 0.0175545 s
    "lift going up": (lift(), 2.0, 0.05, 0.5, {}, 0.0675545, 0.0227402, 1.06440),
    # falls 0.00325417 m, to 0.130167 m/s; the brake takes 0.0121311 s and 0.000789533 m
    "lift at rest": (lift(), 2.0, 0.05, 0.0, {}, 0.0621311, -0.00404370, 0.315813),
    # turns after 0.0254022 s at 0.00127011 m, falls 0.000787576 m and 0.000191083 m more
    "lift going up slowly": (lift(), 2.0, 0.05, 0.1, {}, 0.0559680, 0.000291451, 0.0764332),
    # 1 rad/s at 4 rad/s^2, the brake closes at rest
    "category 1, a deceleration": (
        *(turntable(10.0), 0.5, 0.04, 1.0, {"deceleration": 4.0}),
        *(0.25, 0.125, 0.0),
    ),
    # (60 + 10)/2 = 35 rad/s^2
    "category 1, an effort limit": (
        *(turntable(10.0), 0.5, 0.04, 1.0, {"drive_torque": 0.6}),
        *(1 / 35, 1 / 70, 0.0),
    ),
    # moved by the load the gear passes on 0.8 t: 0.8 a + a = 50, a = 27.7778 rad/s^2
    "turntable, a gear with losses": (
        *(turntable(efficiency=0.8, back_efficiency=0.8), 0.5, 0.04, 1.0, {}),
        *(0.076, 0.058, 0.9),
    ),
    # 10 N m on 2 kg m^2 alone: 5 rad/s^2
    "no brake, friction stops it": (turntable(10.0), None, 0.0, 1.0, {}, 0.2, 0.1, 0.0),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_stops_worked_out_by_hand(name):
    scene, torque, delay, speed, more, time, way, energy = BY_HAND[name]
    found = stop_motion(machine(scene, torque, delay, **more), np.zeros(1), np.array([speed]))
    assert found.rest_time == pytest.approx([time], rel=2e-6)
    assert found.travel[-1] == pytest.approx([way], rel=2e-5)
    assert found.energy == pytest.approx([energy], rel=2e-5, abs=1e-12)
    assert not found.v[-1].any()


def test_effort_of_the_gear_is_what_slows_the_load():
    """Brake on the motor's side: of 50 N m the rotor takes its half, the gear carries 25."""
    found = stop_motion(machine(turntable(), 0.5, 0.04), np.zeros(1), np.ones(1))
    assert np.abs(found.effort).max() == pytest.approx(25.0, rel=1e-9)
    lost = turntable(efficiency=0.8, back_efficiency=0.8)
    found = stop_motion(machine(lost, 0.5, 0.04), np.zeros(1), np.ones(1))
    assert np.abs(found.effort).max() == pytest.approx(50 / 1.8, rel=1e-9)


def test_sag_counts_from_power_off():
    """Category 1 ends at rest, then the lift falls until the brake holds: as if it had rested."""
    found = stop_motion(machine(lift(), 2.0, 0.05, deceleration=2.0), np.zeros(1), np.array([0.5]))
    assert found.power_off == pytest.approx(0.25, rel=1e-12)
    assert found.after_power_off == pytest.approx([-0.00404370], rel=2e-5)
    assert found.travel[-1] == pytest.approx([0.0625 - 0.00404370], rel=1e-6)
    assert found.q[-1] == pytest.approx([0.0625 - 0.00404370], rel=1e-6)


def test_drives_that_hold_until_the_brake_has_closed_let_nothing_sag():
    """Power goes off 50 ms after rest, as soon as the brake holds; too weak a one slips then."""
    holding = machine(lift(), 2.0, 0.05, deceleration=2.0)
    found = stop_motion(replace(holding, holds=True), np.zeros(1), np.array([0.5]))
    assert found.power_off == pytest.approx(0.25 + 0.05, rel=1e-12)
    assert found.after_power_off == pytest.approx([0.0], abs=1e-12)
    assert found.q[-1] == pytest.approx([0.0625], rel=1e-9)
    assert found.rest_time == pytest.approx([0.25])
    assert (np.diff(found.t) >= 0.0).all()
    weak = machine(lift(), 1e-3, 0.05, deceleration=2.0)
    with pytest.raises(StopError, match="too weak"):
        stop_motion(replace(weak, holds=True), np.zeros(1), np.array([0.5]))


def test_an_imposed_deceleration_costs_what_inverse_dynamics_says():
    """Going down at 0.5 m/s and braking with 2 m/s^2: 10 (9.81 + 2) less 20 N of friction."""
    found = stop_motion(
        machine(lift(), 2.0, 0.05, deceleration=2.0), np.zeros(1), -0.5 * np.ones(1)
    )
    moving = (found.v[:, 0] < 0.0) & (found.t < found.power_off)
    assert found.effort[moving, 0] == pytest.approx(118.1 - 20.0, rel=1e-9)


def two_brakes(scene):
    names = ("lift", "elbow")
    torque, delay = (dict(zip(names, ARM[x], strict=True)) for x in ("brakes", "delays"))
    return BrakedMachine(scene, (), torque, delay, {}, None)


START = np.array([0.4, 0.7]), np.array([1.8, -2.5])


def test_kinetic_and_potential_energy_are_what_friction_and_brakes_take():
    scene = arm()
    q, v = START
    found = stop_motion(two_brakes(scene), q, v)
    model, data = scene.model, scene.model.createData()
    rotors = 0.5 * sum(
        J * (r * w) ** 2 for J, r, w in zip(ARM["rotors"], ARM["ratios"], v, strict=True)
    )
    kinetic = pin.computeKineticEnergy(model, data, q, v) + rotors
    fallen = pin.computePotentialEnergy(model, data, q)
    fallen -= pin.computePotentialEnergy(model, data, found.q[-1])
    rubbed = np.trapezoid(np.abs(found.v), found.t, axis=0) @ np.array(ARM["friction"])
    assert kinetic + fallen == pytest.approx(rubbed + found.energy.sum(), rel=3e-6)
    assert found.energy.min() > 0.1


def lagrange(q, v):
    """Mass matrix with rotors and the terms without accelerations, of Lagrange's equations."""
    (m1, m2), (c1, c2), l1 = ARM["masses"], ARM["centres"], ARM["lengths"][0]
    (I1, I2), (r1, r2), (J1, J2) = ARM["inertias"], ARM["ratios"], ARM["rotors"]
    cosine, sine = np.cos(q[1]), np.sin(q[1])
    m22 = m2 * c2**2 + I2
    m12 = m22 + m2 * l1 * c2 * cosine
    m11 = m1 * c1**2 + I1 + m2 * l1**2 + 2 * m2 * l1 * c2 * cosine + m22
    M = np.array([[m11 + r1**2 * J1, m12], [m12, m22 + r2**2 * J2]])
    h = m2 * l1 * c2 * sine
    bias = np.array([-h * (2 * v[0] * v[1] + v[1] ** 2), h * v[0] ** 2])
    g, both = 9.81, np.cos(q[0] + q[1])  # height -(l sin q): a turn about y lowers the bar
    weight = np.array(
        [-g * ((m1 * c1 + m2 * l1) * np.cos(q[0]) + m2 * c2 * both), -g * m2 * c2 * both]
    )
    return M, bias + weight


def rates(q, v, friction, stuck):
    """Accelerations under friction (2,), zero of joints that stick."""
    M, bias = lagrange(q, v)
    force = np.where(stuck, 0.0, friction) - bias
    a, free = np.zeros(2), ~stuck
    a[free] = np.linalg.solve(M[np.ix_(free, free)], force[free])
    return a, M @ a + bias  # the second, of joints that stick: what holds them


def advanced(q, v, step, friction, stuck):
    """One step of the classical Runge-Kutta method with constant friction."""
    stages = []
    for part in (0.0, 0.5, 0.5, 1.0):
        dq, dv = stages[-1] if stages else (0.0, 0.0)
        there, speed = q + part * step * dq, v + part * step * dv
        stages.append((speed, rates(there, speed, friction, stuck)[0]))
    weights = np.array([1, 2, 2, 1]) / 6
    return (
        q + step * sum(w * dq for w, (dq, _) in zip(weights, stages, strict=True)),
        v + step * sum(w * dv for w, (_, dv) in zip(weights, stages, strict=True)),
    )


def integrated(q, v, longest):
    """Stick and slip in steps that end where a brake closes and where a joint comes to rest."""
    t, stuck, rest = 0.0, np.zeros(2, dtype=bool), np.zeros(2)
    delays, brakes = np.array(ARM["delays"]), np.array(ARM["brakes"]) * np.array(ARM["ratios"])
    while t < 0.3:
        limits = np.array(ARM["friction"]) + np.where(t >= delays - 1e-12, brakes, 0.0)
        stuck &= np.abs(rates(q, v, 0.0, stuck)[1]) <= limits
        friction = -np.sign(v) * limits
        step = min([longest, *(delay - t for delay in delays if delay > t + 1e-12)])
        ended = np.zeros(2, dtype=bool)
        for _ in range(4):  # shorter, until the first joint is just at rest at its end
            after = advanced(q, v, step, friction, stuck)
            beyond = ~stuck & (v != 0.0) & (after[1] * v < -1e-15)
            ended |= beyond
            if not beyond.any():
                break
            step *= float((v[beyond] / (v - after[1])[beyond]).min())
        ended &= np.abs(after[1]) < 1e-9
        q, v, t = after[0], np.where(stuck | ended, 0.0, after[1]), t + step
        rest = np.where(ended, t, rest)
        stuck |= ended
    return q, rest


def test_an_arm_of_two_axes_against_an_integration_of_its_own():
    q, v = START
    found = stop_motion(two_brakes(arm()), q, v)
    end, rest = integrated(q, v, 2e-4)
    assert found.rest_time == pytest.approx(rest, abs=1e-7)
    assert found.q[-1] == pytest.approx(end, abs=1e-8)
    assert found.travel[-1] == pytest.approx(end - q, abs=1e-6)  # trapezia over 1 ms
    assert (np.abs(found.travel[-1]) > 0.02).all()


def test_the_tools_path_of_a_turn_is_an_arc():
    scene = arm()
    q = np.column_stack([np.linspace(0.0, 0.8, 400), np.zeros(400)])
    assert tool_path(scene, (), q)[-1] == pytest.approx(1.1 * 0.8, rel=1e-5)
    assert tool_path(scene.with_(tool=None), (), q) is None


def test_a_brake_that_is_too_weak_is_named():
    with pytest.raises(
        StopError, match=r"axis still moves at \S+ m/s .*brake of 0\.2 N m .* too weak"
    ):
        stop_motion(machine(lift(), 0.2, 0.05), np.zeros(1), np.zeros(1))


def test_no_brake_under_gravity_is_named_with_what_to_give():
    with pytest.raises(
        StopError, match=r"axis still moves at \S+ m/s .*no brake: give .*engage_time: s"
    ):
        stop_motion(machine(lift(), None, 0.0), np.zeros(1), np.zeros(1))


def test_a_closed_brake_holds_and_is_part_of_the_scene():
    scene = lift().with_(closed_brakes={"axis": 2.0})
    assert pf.holds(scene, [0.0], motor_torque=[0.0]).held
    assert not pf.holds(lift(), [0.0], motor_torque=[0.0]).held
    with pytest.raises(pf.PinfricError, match="no drive 'axi'"):
        lift().with_(closed_brakes={"axi": 2.0})


def test_inverse_dynamics_asks_what_the_motor_gives_without_a_brake():
    """(weight + friction + (load + rotor) a) / ratio, brake closed or open."""
    scene, state = lift().with_(closed_brakes={"axis": 2.0}), np.array([[0.0], [0.5], [1.0]])
    wanted = (98.1 + 20.0 + 30.0) / 200.0
    assert scene.solver().inverse(*state).motor_torque_upper == pytest.approx([wanted])
    batch = pf.inverse_dynamics(scene, *state[:, None])
    np.testing.assert_allclose(batch.motor_torque_upper, [[wanted]])


def test_several_answers_at_rest_are_passed_by_time_stepping():
    """Power goes off at a pose at which one set of joints may break away, or another."""
    scene = pf.load_scene("panda_pick_and_place")
    gears = []
    for drive in scene.drives:
        most = float(scene.model.effortLimit[drive.velocity_index])
        gear = {"ratio": 100.0, "efficiency": 0.8, "back_efficiency": 0.7, "rotor_inertia": 1e-4}
        brake = {"torque": 0.012 * most, "engage_time": 0.02}
        gears.append({"joint": drive.name, "transmission": {**gear, "brake": brake}})
    settings = {"category": 0, "reaction_time": 0.02, "friction": [0.8, 1.2]}
    scene = scene.with_(actuators=gears, stops=settings)
    q = np.array([0.636394, -0.00824784, 0.0, -1.79923, 0.0, 1.79099, 0.7854])
    stopped = Machines(scene, scene.stops, ()).of(MachineKind(False, 0.0))
    motion = stop_motion(stopped, q, np.zeros(7))
    assert motion.parts[0].method == "timestepping"
    assert not motion.v[-1].any()
    # it falls for no longer than the brakes take, and they hold
    assert motion.rest_time.max() < 0.04
    assert np.abs(motion.travel[-1]).max() < 0.5 * 9.81 * 0.04**2 / 0.1
