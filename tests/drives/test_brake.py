"""Brakes, against an independent search over friction within its limits."""

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump, row
from mechanisms import pin_friction, shifted
from sizing_cases import COULOMB, one_drive, trapezoid, turntable

import pinfric as pf
from pinfric.drives.brake import Stop, standstills
from pinfric.drives.catalog import Brake
from pinfric.drives.criterion import Status
from pinfric.drives.policy import Conditions
from pinfric.drives.robot import DrivenRobot
from pinfric.errors import SizingError
from pinfric.model.schema import Assumed, Measured
from pinfric.show.report.drives import brake_line
from pinfric.sizing.summary import sizing_summary

MASS, LENGTH, G = 2.0, 0.6, 9.81
MU, RADIUS = 0.3, (0.05, 0.7)  # of the pins' friction circles: the second joint's is large
RATIO, ETA, NO_LOAD = 20.0, 0.8, 0.02
POSES = np.array([[0.3, -1.2], [1.0, 0.4], [0.1, 1.3], [-0.8, 1.7]])


def arm():
    """Two links in a vertical plane on pins, loaded at rest by the weights that they carry."""
    model = row(("joint_1", "joint_2"), lump(MASS, [LENGTH / 2, 0, 0]), LENGTH)
    friction = {f"joint_{j + 1}": pin_friction(MU, RADIUS[j]) | dry(0.0) for j in range(2)}
    gear = {
        "ratio": RATIO,
        "efficiency": ETA,
        "back_efficiency": 2 - 1 / ETA,
        "no_load_torque": NO_LOAD,
    }
    actuators = [{"joint": f"joint_{j + 1}", "transmission": gear} for j in range(2)]
    return pf.Scene(model=model, friction=friction, actuators=actuators)


def searched(joint):
    """(least, load) at joint and motor, and the use of friction, by trying frictions."""
    least, most, least_motor, use = 0.0, 0.0, 0.0, 0.0
    limit = MU * RADIUS[joint] * (2 - joint) * MASS * G
    for q1, q2 in POSES:
        outer = MASS * G * LENGTH / 2 * np.cos(q1 + q2)
        load = -(outer if joint else outer + 1.5 * MASS * G * LENGTH * np.cos(q1))
        efforts = load + np.linspace(-limit, limit, 2001)
        motors = [
            (u + share * (1 / ETA - 1) * abs(u)) / RATIO + no_load
            for u, share, no_load in product(
                efforts[::20], (-1.0, 1.0, 0.0), np.linspace(-NO_LOAD, NO_LOAD, 5)
            )
        ]
        ends = min(motors), max(motors)
        least = max(least, np.abs(efforts).min())
        most = max(most, abs(load))
        least_motor = max(least_motor, 0.0 if ends[0] < 0 < ends[1] else np.abs(ends).min())
        # a gear alone bears what its losses do: t = no-load + (1/eta - 1) t
        use = max(use, abs(load) / (limit + NO_LOAD * RATIO / (2 - 1 / ETA)))
    return (least, most), (least_motor, most / RATIO), use


def still(scene):
    t, zero = np.arange(4.0), np.zeros((4, 2))
    return pf.Trajectory.from_arrays(scene, t, POSES, zero, zero)


@pytest.mark.parametrize("joint", [0, 1])
def test_what_a_brake_must_bear_is_what_a_search_over_friction_finds(joint):
    scene = arm()
    # it moves while power fails: what it does then, and how fast, must not matter
    moving = pf.Trajectory.from_arrays(
        scene, np.arange(4.0), POSES, np.full((4, 2), 2.0), np.full((4, 2), 5.0)
    )
    for motion in (still(scene), moving):
        found = pf.size(scene, motion).standstills[joint]
        effort, motor, use = searched(joint)
        assert found.effort == pytest.approx(effort, abs=2e-3 * effort[1])
        assert found.shaft == pytest.approx(motor, rel=1e-6, abs=2e-3 * motor[1])
        assert found.held == (use <= 1) == (joint == 1)
        assert (found.criteria[0].status == Status.PASSES) == found.held
        if found.held:
            assert found.use == pytest.approx(use, rel=1e-6)


def test_a_brake_bears_a_payload_where_it_is_carried_and_only_there():
    whole = arm()
    model, mass = whole.model.copy(), 4.0
    tip = shifted(LENGTH)
    model.addFrame(pin.Frame("hand", 2, tip, pin.FrameType.BODY))
    box = {"link": "hand", "mass": mass, "com": [0.0, 0.0, 0.0], "attached": False}
    scene = pf.Scene(
        model=model, friction=whole.friction, actuators=whole.actuators, payloads={"box": box}
    )
    t, zero = np.arange(4.0), np.zeros((4, 2))
    for carried in ([False, True, False, False], [False] * 4):
        motion = pf.Trajectory.from_arrays(scene, t, POSES, zero, zero, {"box": carried})
        found = pf.size(scene, motion).standstills[1]
        extra = mass * np.array(carried)
        load = G * (MASS / 2 + extra) * LENGTH * np.cos(POSES.sum(axis=1))
        limit = MU * RADIUS[1] * G * (MASS + extra)
        assert found.effort[1] == pytest.approx(abs(load).max())
        gear = NO_LOAD * RATIO / (2 - 1 / ETA)
        assert found.use == pytest.approx((abs(load) / (limit + gear)).max(), rel=1e-6)


def brakes(*torques):
    return {
        f"B{torque:g}": {
            "source": "invented",
            "grade": "R",
            "torque": torque,
            "torque_max": torque,
            "voltage": 24.0,
        }
        for torque in torques
    }


def sized(tmp_path, torques, wanted, on_miss="ignore"):
    catalog = one_drive(tmp_path, brakes=brakes(*torques))
    scene = arm()
    given = {"holding_brake": wanted, "inertia_ratio": 1e3, "thermal_time": 1.0}
    return pf.size(scene, still(scene), catalog, conditions=given, on_miss=on_miss)


def test_the_smallest_brake_that_bears_it_is_taken(tmp_path):
    report = sized(tmp_path, (0.01, 0.05, 0.1, 0.4, 0.8, 5.0), "all")
    for still, joint in zip(report.standstills, report.joints, strict=True):
        brake = still.criteria[1]
        assert brake.required == pytest.approx(1.5 * still.shaft[1])
        # at the shaft of the drive that was chosen: its gear, not the scene's
        load = np.abs(joint.cycle.effort_frictionless).max()
        assert still.shaft[1] == pytest.approx(load / joint.choice.candidate.ratio)
        torque = float(still.brake.removeprefix("B"))
        assert torque == min(x for x in (0.01, 0.05, 0.1, 0.4, 0.8, 5.0) if x >= brake.required)
    assert report.verdict.failing == ()


def test_a_brake_that_is_required_of_a_catalogue_without_any_fails(tmp_path):
    report = sized(tmp_path, (), "all")
    assert [still.criteria[1].status for still in report.standstills] == ["fails"] * 2
    joint = report.joints[0].name
    says = f"{joint}: holding brake: the catalogue has no brake .*holding_brake = all"
    assert re.search(says, "; ".join(report.verdict.failing))
    with pytest.raises(SizingError, match="has no brakes, and joint_1, joint_2 would"):
        report.check()
    wanted = sized(tmp_path, (), "any")
    assert wanted.verdict.failing == ()
    (line,) = brake_line(sizing_summary(wanted))  # on the first screen: both fall
    assert line.startswith("joint_1, joint_2: the catalogue has no brake that goes with this motor")
    assert line.endswith("without power its load moves it")


def test_of_brakes_with_equal_torque_the_lightest_is_taken():
    same = {"source": "invented", "grade": "R", "torque": 9.0}
    of_mass = {
        "weak": {"torque": 0.01},
        "unknown": {},
        "heavy": {"mass": 0.3, "power": 5.0},
        "light": {"mass": 0.2, "power": 9.0},
        "cool": {"mass": 0.2, "power": 8.0},
        "strong": {"torque": 10.0, "mass": 0.1},
    }
    brakes = {name: Brake(**same | more) for name, more in of_mass.items()}
    scene = arm()
    found = standstills(pf.inverse_dynamics(scene, still(scene)), brakes, Conditions())
    assert [one.brake for one in found] == ["cool", "cool"]


def test_all_figures_of_the_brake_that_is_taken_are_said():
    given = {"torque": 9.0, "voltage": 24.0, "release_time": 0.05, "engage_time": 0.02}
    brake = Brake(source="a maker, p. 7", grade="R", power=8.0, stop_energy=300.0, **given)
    scene = arm()
    motion = still(scene)
    found = standstills(pf.inverse_dynamics(scene, motion), {"B": brake}, Conditions())
    assert found[0].criteria[1].note == (
        "B: 9 N m, 24 V, 8 W, opens in 0.05 s, closes in 0.02 s, 300 J a stop (R: a maker, p. 7)"
    )


@pytest.mark.parametrize(("wanted", "short"), [("any", 0), ("where_needed", 2), ("all", 2)])
def test_a_brake_that_is_too_weak_is_missed_where_one_is_wanted(tmp_path, wanted, short):
    report = sized(tmp_path, (0.01,), wanted)
    missed = [miss for miss in report.verdict.failing if "holding brake: needs" in miss]
    assert len(missed) == short
    assert not any(still.brake for still in report.standstills)
    if wanted == "all":
        with pytest.raises(SizingError, match=r"joint_1: holding brake: needs .*, has 0.01 N m"):
            report.check()


def test_friction_does_not_push_a_brake():
    """About a vertical axis nothing loads the brake, whatever the friction."""
    scene = turntable()
    (found,) = standstills(pf.inverse_dynamics(scene, trapezoid(scene)), {}, Conditions())
    assert COULOMB > 0
    assert found.effort == (0.0, 0.0)
    geared = scene.with_(actuators=[{"joint": "table", "transmission": {"ratio": 100.0}}])
    tiny = {"tiny": Brake(source="invented", grade="R", torque=1e-3)}
    resting = pf.Trajectory.from_arrays(geared, np.arange(2.0), *[np.zeros((2, 1))] * 3)
    motion = pf.inverse_dynamics(geared, resting)
    (found,) = standstills(motion, tiny, Conditions(holding_brake="all"))
    assert (found.shaft, found.brake) == ((0.0, 0.0), "tiny")


def test_the_energy_of_a_stop_is_what_an_integration_finds():
    """The load drives on until the brake closes, then against it; friction left out."""
    brake = Brake(
        source="invented",
        grade="R",
        torque=0.5,
        engage_time=0.03,
        rotor_inertia=2e-5,
        stop_energy=40.0,
    )
    inertia, speed, load = 3e-4, 250.0, 0.12
    step, omega, energy, t = 1e-5, speed, 0.0, 0.0
    while omega > 0:
        braking = brake.torque if t >= brake.engage_time else 0.0
        energy += braking * omega * step
        omega += (load - braking) / (inertia + brake.rotor_inertia) * step
        t += step
    stop = Stop(*(np.array([x]) for x in (inertia, speed, load)))
    assert stop.energy(brake) == pytest.approx(energy, rel=1e-3)
    weak = Brake(source="invented", grade="R", torque=0.1)
    assert stop.energy(weak) == np.inf


def test_a_brake_whose_maker_prints_too_little_energy_is_passed_over():
    scene = arm()
    moving = pf.Trajectory.from_arrays(
        scene, np.arange(4.0), POSES, np.full((4, 2), 2.0), np.zeros((4, 2))
    )
    same = {"source": "invented", "grade": "R", "engage_time": 0.01}
    brakes = {
        "small": Brake(**same, torque=9.0, stop_energy=1e-3),
        "large": Brake(**same, torque=10.0, stop_energy=1e3),
    }
    result = pf.inverse_dynamics(scene, moving)
    for found in standstills(result, brakes, Conditions(holding_brake="all")):
        assert found.brake == "large"
        energy = found.criteria[2]
        assert energy.status == Status.PASSES
        assert 0 < energy.required < energy.available == 1e3


def test_mass_and_inertia_of_brakes_are_in_the_drives(tmp_path):
    """The outer brake hangs on the inner joint; each turns with its motor, and counts once."""
    model = arm().model
    scene = pf.Scene(model=model, stick_velocity=1e-6)
    t = np.linspace(0.0, 1.0, 51)
    q = np.outer(0.5 * np.sin(2 * np.pi * t), [1.0, 0.3])
    motion = pf.Trajectory.from_arrays(scene, t, q)
    brake = {"source": "invented", "grade": "R", "torque": 10.0, "engage_time": 0.01}
    strong = dict.fromkeys(("rated_torque", "average_torque", "repeated_peak_torque"), 900.0)
    strong["momentary_peak_torque"] = 3e4
    reports = []
    for more in ({}, {"mass": 0.7, "rotor_inertia": 4e-5}):
        catalog = one_drive(tmp_path, gear=strong, brakes={"B": {**brake, **more}})
        conditions = {"holding_brake": "all", "inertia_ratio": 1e3}
        reports.append(pf.size(scene, motion, catalog, conditions=conditions, on_miss="ignore"))
    bare, braked = reports
    largest = "Not printed of brakes: B: largest torque taken as 2 x 10 N m"
    mass, inertia = 0.28 * 10**0.7, 2.2e-6 * 10**1.38
    assert bare.notes[-1] == (
        f"{largest}, mass taken as 0.28 T^0.7 = {mass:.2g} kg, "
        f"inertia taken as 0 to 2.2e-6 T^1.38 = {inertia:.2g} kg m^2."
    )
    assert braked.notes[-1] == f"{largest}."
    drive = [report.joints[0].installed.candidate for report in reports]
    assert drive[1].mass - drive[0].mass == pytest.approx(0.7 - mass)
    assert drive[1].brake == "B"
    assert drive[1].sources[-1] == "B: invented (R)"
    for report, more in ((bare, inertia), (braked, 4e-5)):
        gear = report.scene.drives[1].transmission
        assert gear.rotor_inertia == pytest.approx(6e-5 + more)
    # gravity and inertia of what one is heavier at the outer joint, without friction
    one, other = (report.result.effort_frictionless[:, 0] for report in (bare, braked))
    angle, turning = q[:, 0], motion.a[:, 0]
    expected = (0.7 - mass) * (LENGTH**2 * turning - 9.81 * LENGTH * np.cos(angle))
    np.testing.assert_allclose(other - one, expected, atol=1e-9)
    # a stop's energy: rotor, brake once, load
    for report in reports:
        more = inertia if report is bare else 4e-5
        criteria = {c.name: c for c in report.standstills[1].criteria}
        own = 0.01 + MASS * (LENGTH / 2) ** 2
        shaft, speed = own / 100**2 + 6e-5 + more, 100 * np.abs(motion.v[:, 1])
        load = np.abs(MASS * G * LENGTH / 2 * np.cos(q.sum(axis=1))) / 100
        driven = speed + load * 0.01 / shaft
        energy = shaft / 2 * driven**2 * 10.0 / (10.0 - load)
        assert criteria["brake stop energy"].required == pytest.approx(energy.max(), rel=1e-6)


def test_a_load_below_the_cycles_rounding_is_none():
    """A vertical axis tilted by 1e-17: nothing to hold, and no figure of 1e-17 N m."""
    scene = turntable(friction={})
    model = scene.model.copy()
    model.jointPlacements[1] = pin.SE3(pin.exp3(np.array([1e-17, 0.0, 0.0])), np.zeros(3))
    model.inertias[1] = lump(1.0, [0.3, 0.0, 0.0], 2)
    leaning = pf.Scene(model=model, stick_velocity=0.0, actuators=geared_by(100.0))
    result = pf.inverse_dynamics(leaning, trapezoid(leaning))
    (found,) = standstills(result, {}, Conditions(holding_brake="all"))
    assert found.torque.required == 0.0
    assert found.held


def geared_by(ratio):
    return [{"joint": "table", "transmission": {"ratio": ratio}}]


@pytest.mark.parametrize("joint", [pin.JointModelRZ(), pin.JointModelPZ()])
def test_only_a_linear_motor_has_no_shaft(joint):
    """A slide whose motor is linear (ratio 1) has no shaft for a brake; a direct drive has."""
    model = chain(("j", joint, lump(2.0)))
    scene = pf.Scene(model=model, actuators=[{"joint": "j", "transmission": {"ratio": 1.0}}])
    zero = np.zeros((2, 1))
    motion = pf.Trajectory.from_arrays(scene, np.array([0.0, 1.0]), zero, zero, zero)
    slides = joint.shortname() == "JointModelPZ"
    report = pf.size(scene, motion)
    (found,) = report.standstills
    assert (found.shaft is None) == slides
    (chosen,) = standstills(report.result, {}, Conditions(), [None])
    assert (chosen.torque.status == Status.FAILS) == slides  # its load would fall
    assert ("no shaft for a brake" in chosen.torque.note) == slides
    assert found.effort == pytest.approx((2.0 * 9.81,) * 2 if slides else (0.0, 0.0), abs=1e-12)


#: N m: 2 kg at 0.3 m, held out level.
LOAD = MASS * G * LENGTH / 2
DIRECTED = ("positive", 9.0 * LOAD), ("negative", 1.99 * LOAD)
DRIVE = Measured(robot="an arm", side="motor", source="invented", grade="A")
GUESS = Assumed(by="new", date="2026-11-28", version="0", values={"friction.j.coulomb": "5 %"})
STOPS = {"category": 0, "reaction_time": 0.01}


def lever(friction=None, tilt=0.0, **more):
    """One arm held out; about a vertical axis, tilted if a tilt is given."""
    axis = pin.JointModelRZ() if tilt else pin.JointModelRY()
    model = chain(("j", axis, lump(MASS, [LENGTH / 2, 0.0, 0.0])))
    if tilt:
        model.jointPlacements[1] = pin.SE3(pin.exp3(np.array([tilt, 0.0, 0.0])), np.zeros(3))
    friction = {} if friction is None else {"j": friction}
    return pf.Scene(model=model, friction=friction, stick_velocity=1e-9, **more)


def swings(scene, rate):
    """To and fro about the held out posture, at `rate` rad/s in its middle."""
    t = np.linspace(0.0, 1.0, 101)
    q = rate / (2 * np.pi) * np.sin(2 * np.pi * t)
    return pf.Trajectory.from_arrays(scene, t, q[:, None])


@pytest.mark.parametrize(
    ("scene", "braked"),
    [
        (lever(), True),
        (lever(dry(1.99 * LOAD)), True),
        (lever(dry(2.01 * LOAD)), False),
        (lever(dry(9.0 * LOAD, 1.99 * LOAD)), True),  # static friction does not count
        (lever({"coulomb": {s: {"static": 99, "kinetic": k} for s, k in DIRECTED}}), True),
        (lever(dry(9.0 * LOAD) | {"includes_drive": True}), True),
        (lever(dry(9.0 * LOAD), measured=DRIVE), True),
        (lever(dry(9.0 * LOAD), assumed=GUESS), True),
        (lever(pin_friction(0.9, 0.9)), True),  # no bearing holds
    ],
)
def test_only_dry_friction_of_its_own_twice_the_load_makes_a_brake_needless(
    tmp_path, scene, braked
):
    strong = dict.fromkeys(("rated_torque", "average_torque", "repeated_peak_torque"), 900.0)
    strong["momentary_peak_torque"] = 3e4
    motor = {"continuous_torque": 5.0, "peak_torque": 9.0, "thermal": None, "max_speed": 100.0}
    catalog = one_drive(tmp_path, motor, strong)
    with_brakes = {"B": Brake(source="invented", grade="R", torque=50.0)}
    given = {"inertia_ratio": 1e3, "ambient": 25.0}
    for wanted, brakes in product(("where_needed", "any", "all"), ({}, with_brakes)):
        report = pf.size(
            scene,
            swings(scene, 0.1),
            replace(catalog, brakes=brakes),
            conditions={**given, "holding_brake": wanted},
            on_miss="ignore",
        )
        (joint,), (still,) = report.joints, report.standstills
        needs = braked or wanted == "all"
        assert bool(joint.installed.candidate.brake) == still.fitted == (needs and bool(brakes))
        missed = any("holding brake" in line for line in report.verdict.failing)
        assert missed == (needs and not brakes and wanted != "any")
        if not needs:
            assert still.torque.note == ("no brake: without power it coasts; add `stops`")


@pytest.mark.parametrize("share", [0.019, 0.021])
def test_a_load_of_two_percent_of_the_largest_effort_is_none(share):
    """About an axis tilted by an angle e the load is m g l sin(e), beside J a."""
    tilt, inertia = 0.01, 0.01 + MASS * (LENGTH / 2) ** 2
    load = LOAD * np.sin(tilt)
    scene = lever(tilt=tilt)
    motion = swings(scene, load / share / (2 * np.pi * inertia))
    rest = DrivenRobot(scene, motion, None, Conditions()).case(0, {}).rest
    assert np.abs(rest.load).max() / rest.peak == pytest.approx(share, rel=0.03)
    assert bool(rest.why_brake(Conditions(), locks=False)) == (share > 0.02)


@pytest.mark.parametrize(
    ("wanted", "stops", "rate", "guess", "factor"),
    [
        ("where_needed", None, 3.0, "", 1.5),
        ("where_needed", STOPS, 0.01, "", 1.5),
        ("where_needed", STOPS, 3.0, "", 1.5),
        ("all", None, 3.0, "", 1.5),
        ("where_needed", None, 3.0, "robot.masses", 2.0),
        ("where_needed", None, 3.0, "robot.payloads", 2.0),
        ("where_needed", None, 3.0, "friction.j.mu", 1.5),
    ],
)
def test_a_brake_holds_with_a_reserve_and_stops_within_half_a_second(
    wanted, stops, rate, guess, factor
):
    """(J/r^2 + J_rotor + J_brake) r omega/0.5 s beyond the load; a brake of 1 % less is left."""
    assumed = GUESS.model_copy(update={"values": {guess: "?"}}) if guess else None
    gear = {"ratio": 50.0, "rotor_inertia": 3e-4}
    drives = [{"joint": "j", "transmission": gear}]
    scene = lever(actuators=drives, stops=stops, assumed=assumed)
    inertia = (0.01 + MASS * (LENGTH / 2) ** 2) / 50**2 + 3e-4 + 1e-4
    held, stopped = factor * LOAD / 50, 0.0
    if stops or wanted == "all":
        stopped = LOAD / 50 + inertia * 50 * rate / 0.5
    needed = max(held, stopped)
    same = {"source": "invented", "grade": "R", "rotor_inertia": 1e-4, "engage_time": 0.01}
    brakes = {f"{x}": Brake(torque=x * needed, **same) for x in (0.9, 0.99, 1.01, 1.5)}
    result = pf.inverse_dynamics(scene, swings(scene, rate))
    (found,) = standstills(result, brakes, Conditions(holding_brake=wanted))
    assert (found.brake, found.fitted) == ("1.01", True)
    assert found.torque.required == pytest.approx(needed, rel=1e-3)
    assert ("guesses" in found.torque.formula) == (factor == 2.0)
    # at rest the static torque counts, in a stop the dynamic one, which is more than the load
    stopped = max(stopped, LOAD / 50)
    slides = 1.01 * stopped
    parts = {"weak": (0.99 * slides, 0.99 * held), "fits": (slides, 1.01 * held)}
    brakes = {
        name: Brake(torque=low, static_torque=max(low, high), **same)
        for name, (low, high) in parts.items()
    }
    (found,) = standstills(result, brakes, Conditions(holding_brake=wanted))
    assert found.brake == "fits"
    assert (found.torque.required, found.torque.available) in [
        pytest.approx((held, max(slides, 1.01 * held)), rel=1e-3),
        pytest.approx((stopped, slides), rel=1e-3),
    ]


@pytest.mark.parametrize(("stops", "moves"), [*product((None, STOPS), (False, True))])
def test_a_joint_that_moves_needs_a_brake_where_the_robot_is_stopped(stops, moves):
    """Without `stops` the turntable coasts; a joint at rest needs none."""
    scene = turntable().with_(stops=stops)
    motion = trapezoid(scene)
    if not moves:
        motion = pf.Trajectory.from_arrays(scene, np.arange(2.0), *[np.zeros((2, 1))] * 3)
    rest, stopped = (
        DrivenRobot(scene, motion, None, Conditions()).case(0, {}).rest,
        bool(stops) and moves,
    )
    assert rest.why_brake(Conditions(), locks=False) == "it moves when power goes off" * stopped
    assert rest.why_brake(Conditions(), locks=True) == ""
    assert rest.within(Conditions()) == (0.5 if stopped else np.inf)
