"""Stopping times that a maker prints, beside those of its robot's scene."""

import numpy as np
import pinocchio as pin
import pytest

import pinfric as pf
from pinfric.stops.motion import BrakedMachine, stop_motion

#: Universal Robots UR10/CB3 user manual, 1.6.2 (2009-2020, p. 14): speed of the tool, m/s, and
#: longest stopping time of the safety system, s; arm extended horizontally, 10 kg, category 0 or 1.
#: The fourth row is printed as a second "1.5 m/s" between 2.0 and 3.0: read as 2.5.
PRINTED = {1.0: 0.450, 1.5: 0.500, 2.0: 0.550, 2.5: 0.600, 3.0: 0.650}
#: Brakes of the large and of the small joints, N m: not printed, the first is fitted to the slope.
LARGE, SMALL = 3.5, 2.45


#: Universal Robots UR5/CB3 user manual 3.4.5, p. I-53: ways, rad, and times, s, of base, shoulder
#: and elbow from 183 deg/s; category 0, arm extended horizontally, 5 kg, the latter two downwards.
UR5_SPEED = np.radians(183.0)
UR5_WAYS, UR5_TIMES = np.array([0.31, 0.70, 0.22]), np.array([0.244, 0.530, 0.164])
#: Brake of the three, N m: not printed, fitted to the ways of the first two.
UR5_BRAKE = 1.18


def stop_of(robot, mass, axis, speed, large, small):
    """Time and way in which an axis of an extended arm stops, downwards, category 0, no delay."""
    load = {"link": "tool0", "mass": mass, "com": [0.0, 0.0, 0.0]}
    scene = pf.load_scene(robot).with_(payloads={"load": load})
    names = scene.actuator_names
    torque = dict(zip(names, [large] * 3 + [small] * 3, strict=True))
    machine = BrakedMachine(scene, ("load",), torque, dict.fromkeys(names, 1e-4), {}, None)
    v = np.zeros(6)
    v[axis] = speed
    found = stop_motion(machine, np.zeros(6), v)
    return found.rest_time[axis], found.travel[-1][axis]


def test_a_ur10_stops_the_slower_the_faster_it_was_as_its_maker_prints():
    """One brake torque and one reaction, detection included, give the five times to 2 %.

    Both are fitted, so only the growth of the time with the speed is judged; the maker prints no
    other figure of this arm.
    """
    radius = 1.2117  # the tool's distance from the shoulder, arm extended
    times = np.array(
        [stop_of("ur10_machine_tending", 10.0, 1, v / radius, LARGE, SMALL)[0] for v in PRINTED]
    )
    printed = np.array(list(PRINTED.values()))
    reaction = float((printed - times).mean())
    assert reaction == pytest.approx(0.326, abs=0.01)
    assert times + reaction == pytest.approx(printed, abs=0.012)
    assert np.diff(times).min() > 0.03


def test_base_and_shoulder_of_a_ur5_stop_where_its_maker_prints_and_its_elbow_does_not():
    """One brake torque gives the ways of base and shoulder; the elbow stops four times as fast.

    By the printed ways brake and friction of base and shoulder take 141 and 158 N m at the joints,
    those of the elbow, of the same size, only 90 N m; the manual does not say why. All ways are
    0.40 to 0.42 of speed x time, where a constant torque gives 0.5: the times hold a slow tail, or
    the arm was slower than stated, so they judge no constant torque.
    """
    robot = "ur5_pick_and_place"
    stops = [stop_of(robot, 5.0, j, UR5_SPEED, UR5_BRAKE, UR5_BRAKE) for j in range(3)]
    times, ways = np.array(stops).T
    assert ways[:2] == pytest.approx(UR5_WAYS[:2], rel=0.05)
    assert UR5_TIMES[2] / times[2] == pytest.approx(4.0, abs=0.3)
    assert (UR5_WAYS / (UR5_SPEED * UR5_TIMES) < 0.43).all()
    scene = pf.load_scene(robot)
    load = {"link": "tool0", "mass": 5.0, "com": [0.0, 0.0, 0.0]}
    model = scene.with_(payloads={"load": load}).loaded_model(("load",))
    data, q = model.createData(), np.zeros(6)
    inertia = np.diag(pin.crba(model, data, q))[:3] + 101.0**2 * 6.65e-5
    gravity = np.abs(pin.computeGeneralizedGravity(model, data, q))[:3]
    brakes = inertia * UR5_SPEED**2 / (2 * UR5_WAYS) + gravity
    assert brakes == pytest.approx([141, 158, 90], abs=1.5)
