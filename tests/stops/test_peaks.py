"""Peaks of gears in stops by algebra: against Pinocchio's forward dynamics, and by hand."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, example, lump
from mechanisms import shifted
from numpy.testing import assert_allclose
from stop_cases import axis

import pinfric as pf
from pinfric.stops.machines import Machines, full_load, stop_settings
from pinfric.stops.motion import BrakedMachine
from pinfric.stops.peaks import braking, cycle_peaks, gear_peaks
from pinfric.stops.screen import screened_stops

RATIOS, ROTORS = np.array([-100.0, 80.0, 50.0]), np.array([1e-4, 8e-5, 3e-5])
BACK, BRAKES, DELAYS = np.array([0.6, 0.8, 0.5]), np.array([0.4, 0.9, 0.3]), (0.03, 0.01, 0.03)
NAMES = ("turn", "lift", "elbow")


def three_axes():
    """A column that turns and two bars on it; gears whose efficiencies give `BACK`."""
    turns = pin.JointModelRZ(), pin.JointModelRY(), pin.JointModelRY()
    bodies = (lump(mass, [0.2, 0.05, 0.1], 0.1) for mass in (4.0, 3.0, 2.0))
    places = [0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.4, 0.0, 0.0]
    model = chain(*zip(NAMES, turns, bodies, places, strict=True))
    model.addBodyFrame("tip", 3, shifted(0.4), 0)
    gears = {
        name: {
            "ratio": RATIOS[k],
            "rotor_inertia": ROTORS[k],
            "efficiency": 0.9,
            "back_efficiency": BACK[k],
            "brake": {"torque": BRAKES[k] / 2, "engage_time": DELAYS[k]},
        }
        for k, name in enumerate(NAMES)
    }
    box = {"link": "tip", "mass": 2.0, "com": [0.0, 0.0, 0.0]}
    return pf.Scene(
        model,
        actuators=[{"joint": name, "transmission": gears[name]} for name in NAMES],
        payloads={"box": box},
    )


def driven(model, q, v, moving, push, hose):
    """(3,) efforts of the gears: some joints move with a push (3,) and their rotors."""
    model.armature = np.where(moving, RATIOS**2 * ROTORS / BACK, 1e9)
    a = pin.aba(model, model.createData(), q, v, push + hose)
    model.armature = np.zeros(3)
    return pin.rnea(model, model.createData(), q, v, a) - hose


def by_forward_dynamics(scene, carried, q, v, direction, hose):
    """(3,) the largest efforts of one sample, with torques (3,) of hoses.

    Rotors, seen through gears that pass 1/eta_b, are Pinocchio's armature; joints at rest have so
    much of it that they do not move. A joint whose brake slips moves from rest.
    """
    model, most = scene.loaded_model(carried), np.zeros(3)
    pushes = np.abs(RATIOS) * BRAKES / BACK
    for closed, moving in product(((0, 1, 0), (1, 1, 1)), product((False, True), repeat=3)):
        moving = np.array(moving) & (direction != 0)
        if not moving.any():
            continue
        push, speed = -(np.array(closed) * pushes * direction), np.where(moving, v, 0.0)
        effort = driven(model, q, speed, moving, np.where(moving, push, 0.0), hose)
        brakes = np.array(closed) * pushes
        for k in np.flatnonzero(~moving & (np.abs(effort) > brakes)):
            slips, pulled = moving.copy(), np.where(moving, push, 0.0)
            slips[k], pulled[k] = True, np.sign(effort[k]) * brakes[k]
            effort[k] = driven(model, q, speed, slips, pulled, hose)[k]
        effort = np.abs(effort)
        most = np.maximum(most, effort)
    return most


@pytest.mark.parametrize(("carried", "torque"), [((), 0.0), (("box",), 7.0)])
def test_peaks_of_all_joints_by_pinocchios_forward_dynamics(carried, torque):
    hose = {"kind": "hose", "name": "hose", "joint": "lift", "torque": torque}
    scene, random = three_axes().with_(springs=[hose]), np.random.default_rng(3)
    hoses = np.array([0.0, torque, 0.0])
    q, v = random.uniform(-2.0, 2.0, (2, 20, 3))
    v[::4, 1] = 0.0
    delay, torque = (dict(zip(NAMES, x, strict=True)) for x in (DELAYS, BRAKES))
    machine = BrakedMachine(scene, carried, {}, {}, {}, None)
    found = gear_peaks(machine, torque, delay, q, v, np.sign(v))
    judged = [
        by_forward_dynamics(scene, carried, *row, hoses)
        for row in zip(q, v, np.sign(v), strict=True)
    ]
    assert_allclose(found, judged, rtol=1e-6)


#: Joints that other drives turn as well, and joints that no drive turns.
OTHER_CHAINS = {
    "coupled": {"couples": {"elbow": {"lift": -0.7, "turn": 0.2}}, "drives": NAMES},
    "undriven": {"couples": {}, "drives": ("lift", "elbow")},
}


@pytest.mark.parametrize("name", OTHER_CHAINS)
def test_peaks_of_coupled_drives_and_beside_free_joints_by_one_linear_system(name):
    """M a + h = S^T t, S a = 0 of what rests, whose effort is free."""
    scene, random, given = three_axes(), np.random.default_rng(4), OTHER_CHAINS[name]
    there = [NAMES.index(n) for n in given["drives"]]
    actuators = [
        a.model_copy(update={"couples": given["couples"].get(a.joint, {})})
        for a in (scene.actuators[k] for k in there)
    ]
    scene = scene.with_(actuators=actuators)
    S = np.eye(3)[there]
    for driven, others in given["couples"].items():
        for other, factor in others.items():
            S[given["drives"].index(driven), NAMES.index(other)] = factor
    q, v = random.uniform(-2.0, 2.0, (2, 10, 3))
    delay, torque = (dict.fromkeys(NAMES, 0.01), dict(zip(NAMES, BRAKES, strict=True)))
    direction, machine = np.sign(v @ S.T), BrakedMachine(scene, (), {}, {}, {}, None)
    found = gear_peaks(machine, torque, delay, q, v, direction)
    model, n = scene.loaded_model(()), len(there)
    data, push = model.createData(), (np.abs(RATIOS) * BRAKES / BACK)[there]
    heavy, most = (RATIOS**2 * ROTORS / BACK)[there], np.zeros((10, n))
    for k, moving in product(range(10), product((False, True), repeat=n)):
        rest = ~np.array(moving)
        # the velocities of what moves, the rates of what rests being 0
        free = np.eye(3)[[j for j in range(3) if j not in there]]
        rates = np.concatenate([np.where(rest, 0.0, S @ v[k]), free @ v[k]])
        speed = np.linalg.solve(np.vstack([S, free]), rates)
        h, M = pin.rnea(model, data, q[k], speed, np.zeros(3)), pin.crba(model, data, q[k])
        M = np.triu(M) + np.triu(M, 1).T
        if n == 3 and rest.all():
            continue

        def efforts(still, pulled, M=M, h=h):
            # unknown: a, t; t = pulled - heavy S a where it moves, S a = 0 where it rests
            turns = np.where(still[:, None], 1.0, heavy[:, None]) * S
            A = np.block([[M, -S.T], [turns, np.diag(~still)]]).astype(float)
            return np.linalg.solve(A, np.concatenate([-h, pulled]))[3:]

        pulled = np.where(rest, 0.0, -push * direction[k])
        t = efforts(rest, pulled)
        for j in np.flatnonzero(rest & (np.abs(t) > push)):  # its brake slips
            slips = np.arange(n) == j
            t[j] = efforts(rest & ~slips, np.where(slips, np.sign(t[j]) * push, pulled))[j]
        most[k] = np.maximum(most[k], np.abs(t))
    assert_allclose(found, most, rtol=1e-6)


def test_a_self_locking_gear_rests_and_passes_what_comes():
    """eta_b < 0: the lift stands as soon as power is off, as a joint of no direction would.

    Its gear has no brake that slips: what the other two throw at it, it must bear.
    """
    scene, random = three_axes(), np.random.default_rng(5)
    locks = [
        a.model_copy(update={"transmission": a.transmission.model_copy(update=change)})
        for a, change in zip(scene.actuators, ({}, {"back_efficiency": -0.5}, {}), strict=True)
    ]
    q, v = random.uniform(-2.0, 2.0, (2, 20, 3))
    delay, torque = (dict(zip(NAMES, x, strict=True)) for x in (DELAYS, BRAKES))
    direction, holds = np.sign(v), torque | {"lift": 1e6}
    found = gear_peaks(
        BrakedMachine(scene.with_(actuators=locks), (), {}, {}, {}, None),
        torque,
        delay,
        q,
        v,
        direction,
    )
    direction[:, 1] = 0.0
    machine = BrakedMachine(scene, (), {}, {}, {}, None)
    judged = gear_peaks(machine, holds, delay | {"lift": 0.0}, q, v, direction)
    assert_allclose(found, judged, rtol=1e-9)


def lift(torque=1.0, **stops):
    """10 kg on a screw of 200 rad/m, with 20 kg of rotor, and 20 N of friction."""
    brake = {"torque": torque, "engage_time": 0.05}
    joint, body = pin.JointModelPZ(), lump(10.0, moment=1.0)
    scene = axis(joint, body, 20.0, 9.81, ratio=200.0, rotor_inertia=5e-4, brake=brake)
    model = scene.model.copy()
    model.effortLimit = np.array([450.0])
    return scene.with_(model=model, stops={"reaction_time": 0.01, **stops})


def down_and_up(scene):
    """0.5 m/s down at first, and up at last."""
    t = np.linspace(0.0, 2.0, 41)
    q, v, a = t**2 / 4 - t / 2, t / 2 - 0.5, 0.0 * t + 0.5
    return pf.Trajectory.from_arrays(scene, t, q[:, None], v[:, None], a[:, None])


def machines_of(scene, motion):
    return Machines(scene, stop_settings(scene, None), full_load(scene, motion))


#: Peak of the gear, N; of the brake of 400 N, 20 kg of rotor and 98.1 N on 10 kg.
BY_HAND = {
    # 30 a = 400 - 98.1, the gear carries 10 (9.81 + a)
    "category 0": ({"category": 0}, 98.1 + 301.9 / 3),
    # 20 N of friction do not hold 98.1 N: from rest the same
    "category 1": ({"category": 1, "deceleration": {"axis": 8.0}}, 98.1 + 301.9 / 3),
    # 10 (9.81 + 8) - 20 going down
    "power until braked": (
        {"category": 1, "deceleration": {"axis": 8.0}, "power_until_braked": True},
        158.1,
    ),
    # going up 30 a = 450 + 98.1: 98.1 - 182.7; the drive holds until the brake has closed
    "effort limit": ({"category": 1, "power_until_braked": True}, 98.1 + 351.9 / 3),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_peaks_of_a_lift_by_hand(name):
    stops, peak = BY_HAND[name]
    scene = lift(**stops)
    motion = down_and_up(scene)
    machines = machines_of(scene, motion)
    found = cycle_peaks(machines, motion, braking(machines, motion))
    assert found == pytest.approx([peak], rel=1e-9)


def test_a_cycle_that_asks_more_than_its_stops_is_their_peak():
    """Up: 10 (9.81 + 0.5) + 20 N. The brake, 120 N at most, slows 30 kg by 0.73 m/s^2: 105 N."""
    scene = lift(torque=0.3, category=0)
    machines, motion = machines_of(scene, down_and_up(scene)), down_and_up(scene)
    assert cycle_peaks(machines, motion, ()) == pytest.approx([123.1], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["ur10_machine_tending", "ur5_pick_and_place", "panda_pick_and_place"]
)
def test_simulated_stops_of_sized_robots_load_their_gears_as_the_algebra_says(name):
    """Of joints that are loaded above a tenth of what their gears bear."""
    scene, motion = example(name)
    required = {"holding_brake": "all"}
    report = pf.size(scene, motion, "default", conditions=required, on_miss="ignore")
    equipped = timed(report.scene).with_(stops={"category": 0, "reaction_time": 0.01})
    found = pf.stop(equipped, motion)
    simulated = np.array([axis.peak for axis in found.axes])
    bears = np.array([d.transmission.momentary_peak or np.inf for d in equipped.drives])
    algebra = cycle_peaks(found.search.machines, motion, ())
    assert (algebra >= [joint.demand.peak for joint in report.joints]).all()  # of the cycle itself
    ratio = (simulated / algebra)[simulated > 0.1 * bears]
    assert 0.68 < ratio.min() <= ratio.max() < 1.1
    assert np.median(ratio) == pytest.approx(0.91, abs=0.1)
    screened = screened_stops(found.search.machines, motion, algebra, lambda *_: None)
    for own, stopped in zip(screened.criteria, found.axes, strict=True):
        judged = {c.name: c for c in own}
        assert {c.name: c.status for c in stopped.criteria} == {
            n: c.status for n, c in judged.items()
        }
        energy = judged["brake energy of a stop"]
        assert energy.required >= stopped.energy * (energy.source.startswith("algebra"))


def timed(scene):
    """The scene with brakes that close after 20 ms where the catalogue does not say when."""
    drives = []
    for a in scene.actuators:
        brake = a.transmission.brake
        brake = brake.model_copy(update={"engage_time": brake.engage_time or 0.02})
        drives.append(
            a.model_copy(
                update={"transmission": a.transmission.model_copy(update={"brake": brake})}
            )
        )
    return scene.with_(actuators=drives)
