"""Sizing: demands worked out by hand, drives with mass, ranking, and what does not fit."""

import dataclasses
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example, lump, row, still
from cases import resting_four_bar
from mechanisms import shifted
from numpy.testing import assert_allclose
from rich.console import Console
from sizing_cases import (
    ACCELERATION,
    COULOMB,
    CYCLE,
    GEAR,
    INERTIA,
    MOTOR,
    PAUSE,
    PLATEAU,
    RAMP,
    RATE,
    one_drive,
    sized_cycle,
    trapezoid,
    turntable,
    write_catalog,
)

import pinfric as pf
from pinfric.drives.catalog import Catalog
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.policy import Conditions
from pinfric.drives.robot import with_masses
from pinfric.errors import CatalogError, SizingError, StateError
from pinfric.model.schema import Assumed, Measured
from pinfric.motions.summary import summarize
from pinfric.show.pages.sizing import sizing_page
from pinfric.show.report.drives import product_lines
from pinfric.show.report.sizing import friction_line, sizing_report
from pinfric.sizing.caveats import caveats
from pinfric.sizing.choice import OF_DRIVES, Choice, settle
from pinfric.sizing.drive_search import Ask
from pinfric.sizing.memory import Memory
from pinfric.sizing.summary import sizing_summary, to_ask, unchecked
from pinfric.sizing.task import task_of

UP, RUN, DOWN = (INERTIA * ACCELERATION + COULOMB, COULOMB, -INERTIA * ACCELERATION + COULOMB)


def demand(scene=None):
    scene = scene or turntable()
    return sized_cycle(scene=scene).joints[0].demand


def arm(links=2, mass=1.0, length=0.5, friction=None):
    """Links hanging on axes along y, held out along x: gravity loads every joint."""
    names = (f"joint_{j + 1}" for j in range(links))
    return pf.Scene(row(names, lump(mass, [length / 2, 0, 0]), length), friction=friction or {})


def test_peak_rms_and_speed_of_the_trapezoidal_cycle():
    d = demand()
    worst = (UP**2 * RAMP + RUN**2 * PLATEAU + DOWN**2 * RAMP + COULOMB**2 * PAUSE) / CYCLE
    least = (UP**2 * RAMP + RUN**2 * PLATEAU + DOWN**2 * RAMP) / CYCLE
    assert d.rms == pytest.approx(np.sqrt(worst), rel=1e-6)
    assert d.rms_least == pytest.approx(np.sqrt(least), rel=1e-6)
    assert d.rms == pytest.approx(np.sqrt(45), rel=1e-6)
    assert (d.peak, d.speed) == pytest.approx((15, RATE))
    assert d.duty == pytest.approx(0.5, abs=1e-3)
    assert d.hold_share == pytest.approx(0.5, abs=1e-3)
    assert d.mean_speed == pytest.approx(RATE * (RAMP + PLATEAU) / CYCLE, rel=1e-6)


def test_friction_free_figures_stand_beside():
    d = demand()
    inertial = INERTIA * ACCELERATION
    assert d.peak_frictionless == pytest.approx(inertial)
    assert d.rms_frictionless == pytest.approx(inertial * np.sqrt(2 * RAMP / CYCLE), rel=1e-6)
    assert d.holding_frictionless == pytest.approx(0)


def test_power_and_energy_at_the_joint():
    d = demand()
    assert (d.power.driving, d.power.braking) == pytest.approx((UP * RATE, -DOWN * RATE), rel=1e-6)
    delivered = UP * RATE * RAMP / 2 + RUN * RATE * PLATEAU
    assert d.power.delivered == pytest.approx(delivered, rel=1e-6)
    assert d.power.returned == pytest.approx(-DOWN * RATE * RAMP / 2, rel=1e-6)
    # without friction everything that was put in comes back
    kinetic = INERTIA * RATE**2 / 2
    assert d.power_frictionless.returned == pytest.approx(kinetic, rel=1e-6)
    assert d.power_frictionless.delivered == pytest.approx(kinetic, rel=1e-6)


def test_holding_and_breakaway_are_the_ends_of_the_interval():
    d = demand()
    assert d.holding == pytest.approx((0, COULOMB), abs=1e-9)
    assert d.breakaway == pytest.approx(COULOMB)
    assert d.breakaway_friction == pytest.approx(COULOMB)


def test_holding_interval_of_a_geared_joint(tmp_path):
    # 1 kg at 0.25 m held out level: t = 2.4525 N m; the bearing breaks away at b = 0.5 N m
    scene = arm(1, friction={"joint_1": dry(0.5, 0.4)})
    load, b = 9.81 * 0.25, 0.5
    catalog = one_drive(tmp_path, gear={"no_load_running_torque": 0.01, "starting_torque": None})
    (joint,) = pf.size(scene, still(scene), catalog).joints
    assert joint.demand.holding == pytest.approx((load - b, load + b))
    assert joint.demand.holding_frictionless == pytest.approx(load)
    n, r = 0.01, GEAR["ratio"]
    t_rated = GEAR["rated_torque"] / r
    eta = t_rated / (t_rated / GEAR["efficiency"] - n)
    least = GEAR["back_efficiency"] * (load - b) / r - n
    worst = (load + b) / eta / r + n
    # effort is about +y, against the weight: negative
    assert joint.motor.torque_upper == pytest.approx(-least)
    assert joint.motor.torque_lower == pytest.approx(-worst)
    assert joint.motor.figures.holding == pytest.approx((least, worst))


def test_hold_of_a_log_is_found_by_its_velocity():
    # measured velocities are never 0: below the stick velocity the joint holds
    scene = turntable(stick_velocity=0.01)
    t = np.linspace(0, 1, 11)
    v = np.where(t < 0.45, 0.5, 0.004 * np.sin(40 * t))[:, None]
    motion = pf.Trajectory.from_arrays(scene, t, np.zeros((11, 1)), v, np.full((11, 1), 0.1))
    d = pf.size(scene, motion).joints[0].demand
    assert d.holding == pytest.approx((0, COULOMB + 0.1 * INERTIA))
    assert d.hold_share == pytest.approx(0.55)


def test_joint_that_never_rests_has_neither_holding_nor_breakaway():
    scene = turntable()
    t = np.linspace(0, 1, 11)
    moving = pf.Trajectory.from_arrays(scene, t, t[:, None], np.ones((11, 1)), np.zeros((11, 1)))
    d = pf.size(scene, moving).joints[0].demand
    assert d.holding is None
    assert d.breakaway is None
    assert (d.duty, d.hold_share) == (1.0, 0.0)


def test_demand_needs_no_catalogue_and_takes_any_motion_with_times():
    scene = turntable()
    report = sized_cycle(scene=scene)
    assert report.catalog is None
    assert report.joints[0].assessments == ()
    assert report.verdict.failing == ()
    assert report.scene is scene
    assert report.period == pytest.approx(CYCLE)
    report.check()
    with pytest.raises(StateError, match="two samples"):
        pf.size(scene, pf.Trajectory.from_arrays(scene, [0.0], [[0.0]], [[0.0]], [[0.0]]))


def test_lightest_that_fits_is_chosen_and_margins_break_ties(tmp_path):
    motors = {
        "heavy": {**MOTOR, "mass": 2.0},
        "light": {**MOTOR, "mass": 0.4},
        "light and strong": {**MOTOR, "mass": 0.4, "continuous_torque": 0.8},
        "weak": {**MOTOR, "mass": 0.1, "continuous_torque": 0.05},
    }
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", motors))
    (joint,) = sized_cycle(catalog, conditions={"inertia_ratio": 20}).joints
    fitting = [a.candidate.motor for a in joint.assessments if a.fits]
    assert joint.choice is joint.assessments[0]
    assert fitting[-1] == "heavy"
    assert set(fitting) == {"light", "light and strong", "heavy"}
    (weak,) = [a for a in joint.assessments if a.candidate.motor == "weak"]
    assert weak.why.startswith("short-term torque: needs ")
    assert "continuous torque: needs " in weak.why
    assert joint.nearest is None


def test_a_drive_that_is_named_is_taken_in_place_of_the_lightest(tmp_path):
    motors = {
        "heavy": {**MOTOR, "mass": 2.0},
        "light": {**MOTOR, "mass": 0.4},
        "weak": {**MOTOR, "mass": 0.1, "continuous_torque": 0.05},
    }
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", motors))
    report = sized_cycle(catalog, conditions={"take": {"table": "heavy + G"}})
    (joint,) = sizing_summary(report).joints
    assert report.joints[0].choice.candidate.motor == "heavy"
    assert report.drive_mass == pytest.approx(2.0 + GEAR["mass"])
    assert [drive.name for drive in joint.taken] == ["heavy + G"]
    assert report.verdict.signed
    with pytest.warns(pf.PinfricWarning, match="the closest candidate is weak"):
        report = sized_cycle(catalog, conditions={"take": {"table": "weak + G"}})
    assert not report.verdict.signed
    for taken, says in (
        ({"table": "light"}, "the catalogue has no drive 'light'"),
        ({"chair": "light + G"}, "conditions.take: there is no drive 'chair'"),
    ):
        with pytest.raises(CatalogError, match=says):
            sized_cycle(catalog, conditions={"take": taken})


def test_drives_that_fit_stand_side_by_side(tmp_path):
    motors = {"light": MOTOR, "heavy": {**MOTOR, "mass": 2.0, "torque_constant": 0.2}}
    report = sized_cycle(load_catalog(write_catalog(tmp_path / "c.yaml", motors)))
    (joint,) = sizing_summary(report).joints
    mine, other = (*joint.taken, *joint.alternatives)
    assert (mine.name, other.name) == ("light + G", "heavy + G")
    assert (mine.ratio, mine.brake) == (100.0, "")
    assert mine.peak_current == pytest.approx(2.0 * other.peak_current)
    assert mine.tightest in {c.name for c in report.joints[0].choice.criteria}


def test_several_ratios_of_one_gear_are_several_candidates(tmp_path):
    catalog = one_drive(tmp_path, gear={"ratio": [50.0, 100.0]})
    (joint,) = sized_cycle(catalog).joints
    assert {a.candidate.name for a in joint.assessments} == {"M + G, i = 50", "M + G, i = 100"}


def test_nothing_that_fits_names_the_nearest_miss_and_by_how_much(tmp_path):
    scene = turntable()
    catalog = one_drive(tmp_path, motor={"continuous_torque": 0.02, "thermal": None})
    with pytest.warns(pf.PinfricWarning, match="none of 1 candidate fits"):
        report = sized_cycle(catalog, scene)
    (joint,) = report.joints
    assert joint.choice is None
    assert joint.nearest.candidate.name == "M + G"
    with pytest.raises(SizingError) as error:
        report.check()
    share = joint.motor.figures.rms / 0.02 - 1
    assert "table: none of 1 candidate fits; the closest candidate is M + G" in str(error.value)
    assert f"short by {share * 100:.3g} %" in str(error.value)
    assert error.value.report is report
    with pytest.raises(SizingError, match="closest candidate"):
        sized_cycle(catalog, scene, on_miss="raise")
    # its mass stays in the model, so that the other joints are sized with something
    assert report.drive_mass == pytest.approx(MOTOR["mass"] + GEAR["mass"])


def test_sliding_joint_takes_linear_gears_only(tmp_path):
    body = lump(4.0)
    model = chain(("lift", pin.JointModelPZ(), body))
    scene = pf.Scene(model=model)
    screw = {
        "source": "invented",
        "grade": "R",
        "ratio": 628.3,
        "output": "linear",
        "mass": 0.5,
        "input_inertia": 1e-6,
        "efficiency": 0.9,
        "back_driving_torque": 12.0,
        "rated_torque": 500.0,
        "max_input_speed": 400.0,
        "stroke": 0.3,
    }
    gears = {"G": GEAR, "screw": screw}
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", gears=gears))
    (joint,) = pf.size(scene, still(scene), catalog).joints
    assert joint.demand.unit == "N"
    assert [a.candidate.name for a in joint.assessments] == ["M + screw"]
    back_driving = joint.assessments[0].criteria[-1]
    assert back_driving.note == "the load moves the motor above 12 N"
    # at rest the interval reaches from lowering to lifting: worst 4 kg x 9.81/0.9/628.3 rad/m
    assert joint.motor.figures.holding[1] == pytest.approx(4 * 9.81 / 0.9 / 628.3)


def test_mass_of_the_outer_drive_loads_the_inner_joint(tmp_path):
    scene = arm(2)
    report = pf.size(scene, still(scene), one_drive(tmp_path), conditions={"inertia_ratio": 100})
    drive = MOTOR["mass"] + GEAR["mass"]
    inner, outer = report.joints
    # links of 1 kg, 0.5 m: the second joint's drive sits 0.5 m out on the first link
    assert inner.demand_without_masses.rms == pytest.approx(9.81 * (0.25 + 0.75))
    assert inner.demand.rms == pytest.approx(9.81 * (0.25 + 0.75 + drive * 0.5))
    assert outer.demand.rms == pytest.approx(outer.demand_without_masses.rms)
    assert report.drive_mass == pytest.approx(2 * drive)
    assert report.settled
    assert report.passes == 2
    # about joint_1 too: M_11 grows by m l^2
    without = pf.size(scene, still(scene)).joints[0].load_inertia
    assert inner.load_inertia == pytest.approx(without + drive * 0.25)


def test_drives_of_one_arm_do_not_load_the_other(tmp_path):
    model = pin.Model()
    for side in (-1.0, 1.0):
        parent, place = 0, pin.SE3(np.eye(3), np.array([0, side, 0]))
        for j in range(2):
            parent = model.addJoint(parent, pin.JointModelRY(), place, f"arm_{side:g}_{j}")
            body = lump(1.0, [0.25, 0, 0])
            model.appendBodyToJoint(parent, body, pin.SE3.Identity())
            place = shifted(0.5)
    scene = pf.Scene(model=model)
    report = pf.size(scene, still(scene), one_drive(tmp_path), conditions={"inertia_ratio": 100})
    alone = pf.size(arm(2), still(arm(2)), one_drive(tmp_path), conditions={"inertia_ratio": 100})
    for k, joint in enumerate(report.joints):
        assert joint.demand.rms == pytest.approx(alone.joints[k % 2].demand.rms)
    for joint, summary in zip(report.joints, summarize(report.result), strict=True):
        assert joint.demand.rms == pytest.approx(summary.rms)


def test_chosen_transmissions_are_in_the_scene_of_the_report(tmp_path):
    scene = arm(2)
    report = pf.size(scene, still(scene), one_drive(tmp_path), conditions={"inertia_ratio": 100})
    again = pf.inverse_dynamics(report.scene, still(scene))
    for i, joint in enumerate(report.joints):
        assert_allclose(again.motor_torque_upper[:, i], joint.motor.torque_upper)
    assert scene.drives[0].transmission is None  # the scene that was given is as it was


def test_heavier_drives_outside_change_the_choice_inside(tmp_path):
    # sized for itself the inner joint takes the small motor; the outer drive's mass rules it out
    motors = {
        "small": {**MOTOR, "mass": 0.5, "continuous_torque": 0.13, "thermal": None},
        "large": {**MOTOR, "mass": 1.0, "continuous_torque": 0.5, "thermal": None},
    }
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", motors))
    scene = arm(2)
    report = pf.size(scene, still(scene), catalog, conditions={"inertia_ratio": 1000})
    inner, outer = report.joints
    assert outer.choice.candidate.motor == "small"
    assert inner.choice.candidate.motor == "large"


def test_mass_already_in_the_urdf_is_taken_off(tmp_path):
    scene = arm(2)
    drive = MOTOR["mass"] + GEAR["mass"]
    conditions = {"inertia_ratio": 100, "mass_in_urdf": {"joint_2": 0.3}}
    report = pf.size(scene, still(scene), one_drive(tmp_path), conditions=conditions)
    assert report.joints[0].demand.rms == pytest.approx(9.81 * (1.0 + (drive - 0.3) * 0.5))
    assert report.joints[0].demand_without_masses.rms == pytest.approx(9.81)  # as it was given
    conditions["mass_in_urdf"]["joint_2"] = drive + 1.5  # off a link of 1 kg
    with pytest.raises(SizingError, match=r"mass_in_urdf\.joint_2.*negative"):
        pf.size(scene, still(scene), one_drive(tmp_path), conditions=conditions)
    with pytest.raises(CatalogError, match="mass_in_urdf: there is no drive 'joint_3'"):
        pf.size(scene, still(scene), conditions={"mass_in_urdf": {"joint_3": 1.5}})


def test_an_implausible_link_of_the_urdf_does_not_stop_sizing(tmp_path):
    """Loading warned of it; subtracting a drive's mass from its link is not the cause."""
    scene = arm(2)
    model = scene.model.copy()
    model.inertias[1] = pin.Inertia(1.0, np.array([0.25, 0, 0]), np.diag([0.01, 0.5, 0.01]))
    scene = pf.Scene(model=model)
    conditions = {"inertia_ratio": 1000, "mass_in_urdf": {"joint_2": 0.3}}
    report = pf.size(scene, still(scene), one_drive(tmp_path), conditions=conditions)
    drive = MOTOR["mass"] + GEAR["mass"]
    assert report.joints[0].demand.rms == pytest.approx(9.81 * (1.0 + (drive - 0.3) * 0.5))


def test_neglecting_friction_would_have_bought_a_smaller_drive(tmp_path):
    motors = {
        "small": {**MOTOR, "mass": 0.3, "continuous_torque": 0.085, "thermal": None},
        "large": {**MOTOR, "mass": 1.0, "continuous_torque": 0.5, "thermal": None},
    }
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", motors))
    report = sized_cycle(catalog)
    assert report.joints[0].choice.candidate.motor == "large"
    smooth = sized_cycle(catalog, turntable().with_(friction={}))
    assert smooth.joints[0].choice.candidate.motor == "small"


def measured(side):
    return Measured(robot="a table", side=side, source="invented", grade="A")


def guessed(*keys):
    values = {f"friction.table.{key}": "5 %" for key in keys}
    return Assumed(by="pinfric new", date="2026-11-28", version="0", values=values)


@pytest.mark.parametrize(
    ("scene", "more", "left", "says"),
    [
        ({}, {}, 1.0, None),
        ({}, {"includes_drive": True}, 0.0, "with `includes_drive`"),
        ({"measured": measured("motor")}, {}, 0.0, "measured by motor currents"),
        ({"measured": measured("joint")}, {}, 1.0, None),
        ({"measured": measured("joint torque sensor")}, {}, 1.0, None),
        ({"assumed": guessed("coulomb", "viscous")}, {}, 0.0, "guessed"),
        ({"assumed": guessed("coulomb", "viscous")}, {"includes_drive": True}, 0.0, "guessed"),
        ({"assumed": guessed("bearing", "mu")}, {}, 1.0, None),
        ({"assumed": guessed("viscous")}, {}, COULOMB / (COULOMB + 4.0 * RATE), "guessed"),
    ],
)
def test_friction_that_holds_the_old_drive_gives_way_to_the_new_ones(
    tmp_path, scene, more, left, says
):
    """While it speeds up to 1.5 rad/s the table needs J a and its own friction."""
    table = turntable(friction={"table": dry(COULOMB, viscous=4.0) | more}, **scene)
    whole = COULOMB + 4.0 * RATE
    report = sized_cycle(one_drive(tmp_path), table, conditions={"inertia_ratio": 20})
    demand = INERTIA * ACCELERATION + left * whole
    assert report.joints[0].demand.peak == pytest.approx(demand, rel=1e-6)
    line = f"friction: 1 of 1 joints {says}; drives' losses replace it"
    assert friction_line(report) == ([] if says is None else [line])
    assert any("of table include the old drive" in x for x in report.notes) == (says is not None)
    # nothing takes its place where nothing is chosen
    alone = sized_cycle(scene=table).joints[0].demand.peak
    assert alone == pytest.approx(INERTIA * ACCELERATION + whole, rel=1e-6)


@pytest.mark.parametrize("name", [None, "M1"])
def test_a_gear_that_is_a_bearing_gives_way_to_the_new_one(tmp_path, name):
    """With mu of its own torque J a; the joint's own Coulomb friction stays."""
    gear = {"bearing": {"kind": "gear"}, "mu": {"static": 0.2, "kinetic": 0.2}}
    drives = [{"joint": "table", "name": name}]
    table = turntable(friction={"table": dry(COULOMB) | gear}, actuators=drives)
    report = sized_cycle(one_drive(tmp_path), table, conditions={"inertia_ratio": 20})
    bare = sized_cycle(one_drive(tmp_path), conditions={"inertia_ratio": 20})
    assert report.joints[0].demand.peak == pytest.approx(bare.joints[0].demand.peak, rel=1e-9)
    assert report.joints[0].choice.candidate == bare.joints[0].choice.candidate
    assert report.scene.friction["table"].mu.static == 0.0
    assert friction_line(report)[0].startswith("friction: 1 of 1 joints lost in the gear; drives'")
    assert any(x.startswith("The losses of the gears of table (`bearing: {") for x in report.notes)
    assert not any("Coulomb and viscous friction of table" in x for x in report.notes)
    alone = sized_cycle(scene=table).joints[0].demand.peak  # nothing takes its place
    assert alone == pytest.approx(1.2 * INERTIA * ACCELERATION + COULOMB, rel=1e-6)


@pytest.mark.filterwarnings("ignore:.*no candidates. motors and gears are for joints with one axis")
def test_planar_joint_gets_its_demand_but_no_drive(tmp_path):
    body = lump(4.0)
    model = chain(("base", pin.JointModelPlanar(), body))
    scene = pf.Scene(model=model)
    zero, q = np.zeros((2, 3)), np.array([[0, 0, 1, 0], [0, 0, 1, 0]], dtype=float)
    motion = pf.Trajectory.from_arrays(scene, [0.0, 1.0], q, zero, zero)
    report = pf.size(scene, motion, one_drive(tmp_path))
    assert [joint.choice for joint in report.joints] == [None] * 3
    assert len(report.verdict.failing) == 3
    assert (
        "no candidates: motors and gears are for joints with one axis" in report.verdict.failing[0]
    )


def test_cylinders_are_sized_by_their_own_rate():
    """Independent: lengths from Pinocchio's frames; rates by differences, work by trapezoids."""
    scene, motion = example("excavator", "excavator.waypoints.yaml")
    report = pf.size(scene, motion)
    scene = report.given  # its soil is a body
    result = pf.inverse_dynamics(scene, motion)
    model, data = scene.model, scene.model.createData()
    ends = [(a.cylinder.a, a.cylinder.b) for a in scene.actuators]
    length = np.empty((len(motion.t), 3))
    for i, q in enumerate(motion.q):
        pin.framesForwardKinematics(model, data, q)
        for k, (a, b) in enumerate(ends):
            at = [data.oMf[model.getFrameId(end.link)].act(np.array(end.xyz)) for end in (a, b)]
            length[i, k] = np.linalg.norm(at[1] - at[0])
    rate = np.gradient(length, motion.t, axis=0, edge_order=2)
    assert_allclose(result.actuator_velocity, rate, atol=2e-3 * np.abs(rate).max())
    for k, joint in enumerate(report.joints):
        assert joint.demand.speed == pytest.approx(np.abs(rate[:, k]).max(), rel=5e-3)
    # mass on a cylinder: twice the energy at 1 m/s of it, the others standing
    step, energy = 1e-6 * np.eye(3), pin.computeKineticEnergy

    def lengths(q):
        pin.framesForwardKinematics(model, data, q)
        return [
            np.linalg.norm(
                np.subtract(*(data.oMf[model.getFrameId(e.link)].act(np.array(e.xyz)) for e in two))
            )
            for two in ends
        ]

    heaviest = np.zeros(3)
    for q, carried in list(zip(motion.q, motion.attached, strict=True))[::10]:
        names = [n for n, on in zip(motion.payload_names, carried, strict=True) if on]
        loaded = scene.loaded_model(names)
        ahead, back = ([lengths(pin.integrate(model, q, s * one)) for one in step] for s in (1, -1))
        B = np.linalg.inv((np.subtract(ahead, back) / 2e-6).T)
        masses = [2.0 * energy(loaded, loaded.createData(), q, column) for column in B.T]
        heaviest = np.maximum(heaviest, masses)
    assert_allclose([joint.load_inertia for joint in report.joints], heaviest, rtol=1e-3)


def test_a_catalogue_without_motors_or_gears_says_that_nothing_can_be_chosen(tmp_path):
    scene, motion = example("excavator", "excavator.waypoints.yaml")
    (tmp_path / "c.yaml").write_text(f"pinfric_catalog: 1\nmotors: {{M: {MOTOR}}}\n")
    report = pf.size(scene, motion, tmp_path / "c.yaml", on_miss="ignore")
    assert len(report.verdict.failing) == 3
    none = f"{tmp_path / 'c.yaml'} has no hydraulic cylinders"
    assert report.verdict.failing[0].startswith(f"boom_cylinder: no candidates: {none}")
    (row,) = (row for row in unchecked(report) if row.criterion == "all of its drive")
    assert row.joints == scene.actuator_names
    assert row.missing == none


def test_panda_carries_the_mass_of_its_drives(panda):
    report = panda
    assert report.settled
    assert report.verdict.failing == ()
    assert report.joint("panda_joint2").demand.rms > 1.1 * (
        report.joint("panda_joint2").demand_without_masses.rms
    )
    for joint in report.joints:
        assert joint.choice.margin > 0
        assert all(a.why for a in joint.assessments if not a.fits)
    with pytest.raises(SizingError, match="no drive 'panda_joint'; did you mean"):
        report.joint("panda_joint")


def test_demand_agrees_with_the_summary_of_inverse_dynamics(panda):
    for joint, summary in zip(panda.joints, summarize(panda.result), strict=True):
        assert joint.demand.peak == pytest.approx(summary.peak)
        assert joint.demand.rms == pytest.approx(summary.rms)
        assert joint.demand.rms_least == pytest.approx(summary.rms_least)
        assert joint.motor.figures.rms == pytest.approx(summary.motor_rms) or (
            joint.choice.candidate.at_output
        )


@pytest.fixture(scope="module")
def panda():
    scene = pf.load_scene("panda_pick_and_place.yaml").with_(masses="without_drives")
    return pf.size(
        scene, pf.load_trajectory(_bundled("panda_pick_and_place.csv"), scene), "default"
    )


def _bundled(name):
    from pinfric.model.scene_file import bundled_folder

    return bundled_folder() / name


# ---------------------------------------------------------------- cycles that do not close


def way_out(scene, end=0.5, speed=0.0, attached=None):
    """From 0 to `end` rad, there with `speed` (rad/s); the joint moves all the time."""
    t = np.linspace(0.0, 1.0, 51)
    q = end * (3 * t**2 - 2 * t**3) + speed * (t**3 - t**2)
    v = end * (6 * t - 6 * t**2) + speed * (3 * t**2 - 2 * t)
    a = end * (6 - 12 * t) + speed * (6 * t - 2)
    return pf.Trajectory.from_arrays(
        scene, t, q[:, None], v[:, None], a[:, None], attached=attached
    )


def test_a_cycle_that_does_not_close_says_what_and_by_how_much(tmp_path):
    payload = {"box": {"link": "table", "mass": 1.0, "com": [0.0, 0.0, 0.0]}}
    scene = turntable()
    model = scene.model.copy()
    model.addBodyFrame("table", 1, pin.SE3.Identity(), 0)
    scene = pf.Scene(model=model, payloads=payload, friction=scene.friction)
    carried = {"box": np.arange(51) == 50}
    report = pf.size(
        scene, way_out(scene, 0.5, 0.2, carried), one_drive(tmp_path), on_miss="ignore"
    )
    assert report.unclosed == (
        "table ends 0.5 rad from where it began",
        "table ends with a velocity 0.2 rad/s from that at its start",
        "payload box is carried at the end only: detach it where the robot stands",
    )
    assert report.notes[0].startswith("The cycle does not close: table ends 0.5 rad from where it")
    assert "assume that it repeats without a pause" in report.notes[0]
    # without a catalogue, too: the RMS is of the repeated cycle
    (note,) = pf.size(scene, way_out(scene)).notes
    assert "table ends 0.5 rad" in note


def test_a_payload_gripped_at_rest_at_the_seam_closes_the_cycle():
    scene = turntable()
    model = scene.model.copy()
    model.addBodyFrame("table", 1, pin.SE3.Identity(), 0)
    payload = {"box": {"link": "table", "mass": 1.0, "com": [0.0, 0.0, 0.0]}}
    scene = pf.Scene(model=model, payloads=payload, friction=scene.friction)
    carried = {"box": np.arange(51) > 20}
    assert pf.size(scene, way_out(scene, 0.0, 0.0, carried)).unclosed == ()
    (note,) = pf.size(scene, way_out(scene, 0.0, 0.2, carried)).notes
    assert "add the return move" in note  # it does not stand there
    moving = way_out(scene, 0.0, 0.0, carried)
    moving = dataclasses.replace(moving, v=moving.v + 0.1)
    (note,) = pf.size(scene, moving).notes
    assert "detach it where the robot stands" in note
    assert "return move" not in note


def test_a_cycle_that_closes_but_for_noise_says_nothing():
    scene = turntable()
    assert pf.size(scene, way_out(scene, 0.0, 0.0)).unclosed == ()
    there_and_back = trapezoid(scene)  # its positions are 0 throughout, its velocities end at 0
    assert pf.size(scene, there_and_back).unclosed == ()
    noisy = way_out(scene, 5e-5)
    assert pf.size(scene, noisy).notes == ()


def test_a_way_out_and_the_way_back_are_joined():
    scene = turntable()
    out = way_out(scene)
    back = pf.Trajectory.from_arrays(scene, out.t, 0.5 - out.q, -out.v, -out.a)
    for cycles, joined in (((out, back), True), ((out, out), False)):
        notes = pf.size(scene, pf.Duty(tuple((cycle, 1) for cycle in cycles))).notes
        assert any("does not begin where" in note for note in notes) != joined


@pytest.mark.parametrize(("count", "more"), [(4, ""), (6, " and 2 more")])
def test_of_many_gaps_four_are_listed(count, more):
    gaps = [f"joint {k} ends elsewhere" for k in range(count)]
    (note,) = caveats(turntable(), None, gaps)
    assert f"close: {'; '.join(gaps[:4])}{more}. RMS" in note


def test_guesses_of_a_new_scene_are_said_beside_candidates(tmp_path):
    guessed = Assumed(by="pinfric new", date="2026-11-27", version="0", values={"a.b": "2 %"})
    scene = turntable().with_(assumed=guessed)
    assert "`pinfric new`, 2026-11-27: a.b (2 %)." in "".join(caveats(scene, Catalog("c"), ()))


def test_full_turns_of_a_continuous_joint_close():
    model = chain(("table", pin.JointModelRUBZ(), lump(1.0, moment=1.0)))
    scene = pf.Scene(model=model)
    angle = np.linspace(0.0, 4 * np.pi, 200)
    q, v = np.column_stack([np.cos(angle), np.sin(angle)]), np.ones((200, 1))
    motion = pf.Trajectory.from_arrays(scene, angle, q, v, 0 * v)
    assert pf.size(scene, motion).unclosed == ()


@pytest.mark.parametrize(
    ("lever", "axis", "closes"),
    [(0.0, "RUBX", True), (0.1, "RUBZ", True), (0.1, "RUBX", False)],
)
def test_an_axis_without_end_may_turn_on_where_its_load_is_the_same(lever, axis, closes):
    """A drum on its axis, a turntable; but not a lever that turns in gravity."""
    body = pin.Inertia(1.0, np.array([0.0, lever, 0.0]), np.eye(3))
    model = chain(("table", getattr(pin, f"JointModel{axis}")(), body))
    scene = pf.Scene(model=model)
    t = np.linspace(0.0, 1.0, 200)
    angle, v = 2.0 * t, np.full((200, 1), 2.0)
    q = np.column_stack([np.cos(angle), np.sin(angle)])
    report = pf.size(scene, pf.Trajectory.from_arrays(scene, t, q, v, 0 * v))
    gap = "table ends 2 rad from where it began, and its load depends on the angle: "
    assert report.unclosed == (() if closes else (gap + "add the rest of the turn",))
    assert not any("return move" in note for note in report.notes)


def test_the_next_smaller_says_what_it_lacks(tmp_path):
    motors = {
        "small": {**MOTOR, "mass": 0.3, "continuous_torque": 0.06, "thermal": None},
        "tiny": {**MOTOR, "mass": 0.1, "continuous_torque": 0.02, "thermal": None},
        "large": {**MOTOR, "mass": 1.0, "thermal": None},
    }
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", motors))
    (joint,) = sized_cycle(catalog).joints
    assert joint.choice.candidate.motor == "large"
    assert joint.next_smaller.candidate.motor == "small"
    short = joint.next_smaller.failed[0]
    assert short.name == "short-term torque"
    assert short.shortfall == f"{100 * (joint.motor.figures.short_term / 0.06 - 1):.3g} %"


@pytest.mark.parametrize(("mass", "asked"), [(0.5, ["N"]), (0.6, [])])
def test_a_maker_is_asked_only_about_what_would_be_lighter(mass, asked, tmp_path):
    motors = {"M": MOTOR, "N": MOTOR | {"mass": mass, "continuous_torque": None}}
    motors["N"] = {key: x for key, x in motors["N"].items() if x is not None}
    (joint,) = sized_cycle(load_catalog(write_catalog(tmp_path / "c.yaml", motors))).joints
    assert [one.name for one in joint.ask] == asked


def test_what_most_joints_could_use_is_asked_for_first():
    a, b, c = (Ask(name, ("mass",) * n, 1.0, "") for name, n in (("a", 1), ("b", 1), ("c", 2)))
    joints = [
        SimpleNamespace(name=f"j{k}", ask=ask) for k, ask in enumerate(((a, c), (b, c), (b,)))
    ]
    rows = to_ask(SimpleNamespace(joints=joints))
    assert [(row.name, row.joints) for row in rows] == [
        ("b", ("j1", "j2")),
        ("a", ("j0",)),
        ("c", ("j0", "j1")),
    ]


def test_a_choice_that_goes_on_changing_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("pinfric.sizing.choice._MOST_ROUNDS", 1)
    scene = arm(2)
    with pytest.warns(pf.PinfricWarning, match="still alternates after 1 round"):
        report = pf.size(
            scene, still(scene), one_drive(tmp_path), conditions={"inertia_ratio": 100}
        )
    assert (report.passes, report.settled) == (0, False)


def test_of_drives_that_alternate_the_heavier_one_stays(monkeypatch):
    """Its own mass balances a joint, so that the light one would do; its mass does not."""
    scene, mass = arm(2), {"light": 0.5, "heavy": 1.5, "huge": 3.0}
    task = task_of(scene, still(scene), Catalog("c"), Conditions(), lambda _: None, {})

    made = {name: SimpleNamespace(name=name, mass=kg) for name, kg in mass.items()}

    def asked(task, memory, choice, i):
        load = task.added(choice.taken).get(1, 0.0)
        none = choice.banned.get(i, set()) | ({"light"} if load < 1.0 else set())
        return SimpleNamespace(best=next(made[name] for name in made if name not in none))

    monkeypatch.setattr("pinfric.sizing.choice.asked", asked)
    _, choice = settle(task, Memory(), Choice(), OF_DRIVES[:2])
    assert choice.settled
    assert choice.taken[1].name == "heavy"


def test_progress_names_the_round_and_the_drive(tmp_path):
    said = []
    sized_cycle(one_drive(tmp_path), progress=said.append)
    assert said[:2] == ["inverse dynamics of the cycle", "round 1: table, drive 1 of 1"]


def test_transmissions_of_the_scene_are_said_to_be_replaced(tmp_path):
    note = "The scene's transmissions are replaced by the candidates'."
    for gear, there in (({"ratio": 50.0}, True), (None, False)):
        scene = turntable(actuators=[{"joint": "table", "transmission": gear}])
        assert (note in sized_cycle(one_drive(tmp_path), scene).notes) == there


def test_a_drive_in_a_loop_carries_itself(tmp_path):
    """It sits on a crank and turns the coupler's pin: its own torque holds its weight."""
    case = resting_four_bar(5)
    scene = case.scene.with_(actuators=[{"joint": "A"}], masses="without_drives")
    motion = pf.Trajectory.from_arrays(scene, np.linspace(0, 1, 5), case.q, case.v, case.a)
    report = pf.size(scene, motion, one_drive(tmp_path), on_miss="ignore")
    exact = pf.inverse_dynamics(with_masses(scene, {0: 1.5}), motion)
    worst = np.maximum(np.abs(exact.effort_upper), np.abs(exact.effort_lower)).max()
    assert report.joints[0].demand.peak == pytest.approx(worst, rel=1e-9)


def test_remarks_and_stand_ins_of_what_was_chosen_are_printed_everywhere(tmp_path):
    remarks = {"motor": "open rotor", "gear": "read on a photograph", "brake": "at 100 rpm"}
    bare = {"source": "invented", "grade": "R", "torque": 0.5}
    catalog = one_drive(
        tmp_path,
        {"note": remarks["motor"], "cooling": "fan", "continuous_torque": 2.0},
        {"note": remarks["gear"], "stand_ins": {"stiffness": "the next smaller size"}},
        brakes={"B": bare | {"note": remarks["brake"]}},
    )
    report = sized_cycle(catalog, conditions={"holding_brake": "all", "inertia_ratio": 20})
    (joint,) = sizing_summary(report).joints
    for name, note in zip("MGB", remarks.values(), strict=True):
        assert f"{name}: {note}" in joint.installed.notes
    assert joint.installed.stand_ins == (
        "stiffness: the next smaller size",
        "B: largest torque taken as 2 x 0.5 N m",
        f"B: mass taken as 0.28 T^0.7 = {0.28 * 0.5**0.7:.2g} kg",
        f"B: inertia taken as 0 to 2.2e-6 T^1.38 = {2.2e-6 * 0.5**1.38:.2g} kg m^2",
    )
    console = Console(file=StringIO(), width=400)
    console.print(*sizing_report(report, verbose=False), sep="\n")
    assert f"{len(product_lines(sizing_summary(report)))} remarks)" in (console.file.getvalue())
    console.print(*sizing_report(report), sep="\n")
    page = sizing_page(report).replace("<b>", "").replace("</b>", "")
    assert all(line in console.file.getvalue() for line in joint.installed.notes)
    for line in (*joint.installed.notes, *joint.installed.stand_ins):
        assert line in page
    assert "0.48 of the rating, which needs a fan" in page
