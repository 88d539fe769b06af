"""Sizing by a rating: means over each joint's own part, what decides, and published arms."""

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import example
from rating_cases import rated_robot
from sizing_cases import COOL, GEAR, MOTOR, one_drive, trapezoid, turntable, write_catalog

import pinfric as pf
from pinfric.drives.criterion import Status
from pinfric.drives.limits import SHOCK
from pinfric.drives.payloads import with_bodies
from pinfric.errors import CatalogError, SizingError, TrajectoryError
from pinfric.model.described import in_json
from pinfric.model.robot import read_robot
from pinfric.motions.rating import rate
from pinfric.show.pages.sizing import sizing_page
from pinfric.show.report.sizing import rating_lines
from pinfric.sizing.summary import sizing_summary
from pinfric.sizing.verdict import JointState

#: Sizes of CSF and CSG gears that the makers' printed peak torques suggest (inferred).
BUILT = {
    "ur10": [32, 32, 25, 17, 17, 17],
    "ur5": [25, 25, 25, 14, 14, 14],
    "ur3": [17, 17, 14, 14, 14, 14],
}
SIZES = [14, 17, 20, 25, 32, 40, 45, 50, 58, 65]


def sized(name, folder, catalog="default", trajectory=None, conditions=None, **more):
    scene, keys = rated_robot(name, folder)
    return pf.size(
        scene,
        trajectory and trajectory(scene),
        catalog,
        rating=keys | more,
        conditions=conditions,
        on_miss="ignore",
    )


def wave(scene, amplitude=0.4, time=2.0):
    """Every joint there and back, without payload."""
    t = np.linspace(0.0, time, 101)
    w = 2 * np.pi / time
    middle = 0.5 * (scene.model.lowerPositionLimit + scene.model.upperPositionLimit)
    q = middle + amplitude * (1 - np.cos(w * t))[:, None] / 2
    v = np.tile(amplitude * w * np.sin(w * t)[:, None] / 2, (1, scene.model.nv))
    a = np.tile(amplitude * w**2 * np.cos(w * t)[:, None] / 2, (1, scene.model.nv))
    return pf.Trajectory.from_arrays(scene, t, q, v, a)


@pytest.mark.slow
def test_sizes_of_published_arms_are_near_those_that_their_makers_built(tmp_path):
    """Three steps off in all: a wrist of the UR10, and the UR5's elbow, which is two sizes smaller.

    Both belong to a module that its maker shares between joints.
    """
    off = []
    for name, built in BUILT.items():
        report = sized(name, tmp_path)
        found = [int(re.search(r"CSG-(\d+)", j.choice.candidate.name)[1]) for j in report.joints]
        off += [SIZES.index(a) - SIZES.index(b) for a, b in zip(found, built, strict=True)]
    assert sum(map(abs, off)) <= 3


def test_of_a_rating_alone_gears_that_stops_would_overload_are_not_signed(tmp_path):
    """A cycle beside it takes gears that bear them."""
    alone = sized("ur3", tmp_path)
    wrong = {joint.name for joint in alone.verdict.of(JointState.FAILS)}
    assert "elbow_joint" in wrong
    assert alone.verdict.fitted == len(alone.joints) - len(wrong) > 0
    assert f"; {alone.verdict.mass:.2f} kg of drives for these; " in alone.verdict.headline
    assert len(alone.verdict.failing) == len(wrong)
    for k, (joint, own) in enumerate(zip(alone.joints, alone.criteria, strict=True)):
        assert joint.choice is not None
        bears = joint.choice.drives.gear.momentary_peak_torque
        (row,) = (c for c in own if c.name == f"stop: {SHOCK}")
        assert (row.required, row.available) == (alone.open_stops[k], bears)
        assert (row.status == Status.FAILS) == (joint.name in wrong)
        told = [line for line in alone.verdict.failing if line.startswith(joint.name)]
        assert all("give a cycle beside it, or `stops`" in line for line in told)
    with pytest.raises(SizingError, match="elbow_joint: stop: gear momentary peak torque: needs"):
        alone.check()
    assert_gears_bear_stops(sized("ur3", tmp_path, trajectory=wave))


@pytest.mark.slow
def test_of_a_rating_with_stops_gears_bear_them(tmp_path):
    scene, keys = rated_robot("ur3", tmp_path)
    scene = scene.with_(stops={"category": 0, "reaction_time": 0.01})
    stopped = pf.size(scene, None, "default", rating=keys, on_miss="ignore")
    assert_gears_bear_stops(stopped)
    assert "a rating alone" in stopped.no_stops


def assert_gears_bear_stops(report):
    assert not report.open_stops
    rows = [c for own in report.criteria for c in own if c.name == SHOCK]
    assert {c.status for c in rows} == {Status.PASSES}


def test_means_are_over_each_joints_own_part(tmp_path):
    report = sized("arm", tmp_path, catalog=None)
    rated = report.rating.rated
    scene = with_bodies(rated.scene)
    moves = {lift.drive: motion for _, lift, motion in rated.motions() if lift is not None}
    for k, joint in enumerate(report.joints):
        with_it = rated.carried_by(k)
        holds = [m for load, lift, m in rated.motions() if lift is None and load == with_it]
        alone = pf.inverse_dynamics(scene, moves[k])
        square = np.trapezoid(alone.effort_frictionless[:, k] ** 2, moves[k].t)
        own = np.sqrt(square / moves[k].duration)
        held = [pf.inverse_dynamics(scene, m).effort_frictionless[0, k] for m in holds]
        still = np.sqrt(np.mean(np.square(held)))
        assert joint.demand.rms == pytest.approx(max(own, still), rel=1e-6, abs=1e-9)
        assert joint.decided == ("rating: move" if own >= still else "rating: hold")
        every = [pf.inverse_dynamics(scene, m).effort_frictionless for *_, m in rated.motions()]
        assert joint.demand.peak == pytest.approx(np.abs(np.concatenate(every)[:, k]).max())
        assert joint.demand.speed == pytest.approx(rated.lifts[k].speed)


def test_frequencies_are_reported_of_a_rating_and_demanded_of_a_cycle(tmp_path):
    torques = "average_torque", "repeated_peak_torque", "momentary_peak_torque"
    strong = {"continuous_torque": 5.0, "peak_torque": 20.0, "resistance": 0.01, "max_speed": 700.0}
    parts = one_drive(tmp_path, strong, {"stiffness": 1e4, **dict.fromkeys(torques, 1e4)})
    stiff = COOL | {"resonance_base": 12.0, "resonance_hand": 12.0}
    alone = sized("ur3", tmp_path, parts, conditions=stiff)
    rows = [c for j in alone.joints for c in j.installed.criteria if c.name == "gear resonance"]
    assert {c.status for c in rows} == {Status.NOT_REQUIRED}
    joints = sizing_summary(alone).rating.joints
    for joint, row in zip(joints, rows, strict=True):
        assert joint.frequency == pytest.approx(row.available)
    lowest = min(j.frequency for j in joints)
    assert lowest < 12
    assert f"swings at {lowest:.2f} Hz, the lowest" in rating_lines(sizing_summary(alone))[1]
    both = sized("ur3", tmp_path, parts, conditions=stiff, trajectory=wave)
    rows = [c for j in both.joints for c in j.installed.criteria if c.name == "gear resonance"]
    assert {c.status for c in rows} <= {Status.PASSES, Status.FAILS}
    assert all(row.available > joint.frequency for row, joint in zip(rows, joints, strict=True))


@pytest.mark.slow
def test_beside_a_cycle_each_joint_bears_both_and_says_which_decided(tmp_path):
    report = sized("ur5", tmp_path, trajectory=lambda scene: wave(scene, 1.5, 1.5), payload=0.5)
    assert {j.decided_by for j in report.joints} >= {"cycle", "rating"}
    for joint in report.joints:
        masses = {name: a.candidate.mass for name, a in joint.alone.items()}
        assert joint.choice.candidate.mass >= max(masses.values()) * (1 - 1e-9)
        assert masses.get(joint.decided_by, max(masses.values())) == max(masses.values())
    assert report.trajectory.endswith(", rating 0.5 kg")
    assert report.period == pytest.approx(1.5)


def test_a_drive_bears_each_part_even_where_its_joints_effort_is_less(tmp_path):
    """A heavy rotor is hard to turn in a fast cycle that asks less of the joint than the rating."""
    torques = "average_torque", "repeated_peak_torque", "momentary_peak_torque"
    heavy = {"rotor_inertia": 5e-3, "continuous_torque": 1.4, "peak_torque": 50.0}
    heavy |= {"resistance": 0.01, "max_speed": 1e3, "thermal": None, "torque_constant": 0.05}
    parts = one_drive(tmp_path, heavy, dict.fromkeys(torques, 1e4))
    wanted = COOL | {"holding_brake": "any", "inertia_ratio": 1e3}
    shoulders = [
        sized("ur3", tmp_path, parts, cycle, wanted).joints[1]
        for cycle in (None, lambda scene: wave(scene, 0.4, 1.0))
    ]
    missed = [{c.name for c in joint.installed.failed} for joint in shoulders]
    assert "continuous torque" not in missed[0]
    assert "continuous torque" in missed[1]
    assert [joint.decided for joint in shoulders] == ["rating: move", "cycle"]


def test_what_a_cycle_carries_does_not_change_beside_a_rating():
    scene, motion = example("ur10_machine_tending")
    both = pf.size(scene, motion, rating={"payload": 10})
    own = both.rating.own
    before = pf.inverse_dynamics(scene, motion).effort_frictionless
    np.testing.assert_allclose(both.result.effort_frictionless[own], before, atol=1e-9)


@pytest.mark.slow
def test_joints_that_share_a_drive_get_the_lightest_that_fits_all(tmp_path):
    groups = [["wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]]
    report = sized("ur10", tmp_path, conditions={"same_drive": groups})
    alone = sized("ur10", tmp_path)
    names = {report.joint(name).choice.candidate.name for name in groups[0]}
    assert len(names) == 1
    for one, other in zip(report.joints, alone.joints, strict=True):
        assert one.choice.candidate.mass >= other.choice.candidate.mass - 1e-9


def test_joints_that_turn_and_that_slide_share_no_drive(tmp_path):
    with pytest.raises(CatalogError, match="of lift, slide some turn and some slide"):
        sized("arm", tmp_path, None, conditions={"same_drive": [["lift", "slide"]]})


@pytest.mark.parametrize(
    ("groups", "said"),
    [
        ([["table", "elbow"]], "there is no drive 'elbow'"),
        ([["table", "table"]], "'table' occurs 2 times"),
        ("table;table", "'table' occurs 2 times"),
    ],
)
def test_groups_that_cannot_share_a_drive_are_refused(groups, said, tmp_path):
    scene = turntable()
    with pytest.raises(CatalogError, match=said):
        pf.size(scene, trapezoid(scene), conditions={"same_drive": groups})


def test_a_group_that_no_drive_fits_alike_is_not_signed(tmp_path):
    """One gear bears the shoulder and is too slow for the wrist, the other the other way round."""
    groups = [["shoulder_lift_joint", "wrist_3_joint"]]
    torques = "average_torque", "repeated_peak_torque", "momentary_peak_torque"
    strong = GEAR | dict.fromkeys(torques, 1e4) | {"max_input_speed": 400.0, "mass": 2.0}
    fast = GEAR | dict.fromkeys((*torques, "rated_torque"), 5.0)
    motor = MOTOR | {
        "continuous_torque": 5.0,
        "peak_torque": 20.0,
        "resistance": 0.01,
        "torque_constant": 0.05,  # 31 V at the wrist's top speed
        "max_speed": 700.0,
    }
    file = write_catalog(tmp_path / "c.yaml", {"M": motor}, {"S": strong, "F": fast})
    wanted = {"same_drive": groups, "inertia_ratio": 1e3, "holding_brake": "any"}
    report = sized("ur3", tmp_path, file, conditions=wanted)
    lift, wrist = (report.joint(name) for name in groups[0])
    assert [lift.choice.candidate.gear_name[0], wrist.choice.candidate.gear_name[0]] == ["S", "F"]
    for k in (1, 5):
        rows = [c for c in report.criteria[k] if c.name == "same drive"]
        assert [c.status for c in rows] == [Status.FAILS]
    assert any("no one drive fits shoulder_lift_joint" in line for line in report.verdict.failing)


def rating_file(scene, keys, folder):
    """The rating's motion, as `new --payload` writes it."""
    file = folder / "rating.waypoints.yaml"
    file.write_text(rate(scene, keys).waypoints())
    return file


def test_the_motion_of_a_rating_is_the_rating(tmp_path):
    """As a cycle it would dilute each joint's RMS by all others' parts."""
    scene, keys = rated_robot("arm", tmp_path)
    motion = pf.load_trajectory(rating_file(scene, keys, tmp_path), scene)
    by_key = sizing_summary(pf.size(scene, rating=keys))
    for given in (motion, pf.Duty(((motion, 1.0),))):
        assert in_json(sizing_summary(pf.size(scene, given))) == in_json(by_key)
    assert in_json(sizing_summary(pf.size(scene, motion, rating=keys))) == in_json(by_key)
    assert motion.with_speed(0.5).rating is None
    as_cycle = pf.size(scene, replace(motion, rating=None))
    (lift,) = (joint for joint in by_key.joints if joint.name == "lift")
    assert as_cycle.joint("lift").demand.rms < 0.95 * lift.rms


def test_the_motion_of_a_rating_is_no_cycle_among_others(tmp_path):
    scene, keys = rated_robot("arm", tmp_path)
    motion = pf.load_trajectory(rating_file(scene, keys, tmp_path), scene)
    with pytest.raises(SizingError, match=r"the motion of a rating, not a cycle: .*payload=2\)"):
        pf.size(scene, pf.Duty(((motion, 1.0), (replace(motion, rating=None), 2.0))))
    with pytest.raises(SizingError, match="the motion of another rating, 2 kg"):
        pf.size(scene, motion, rating=keys | {"payload": 3.0})
    file = tmp_path / "rating.waypoints.yaml"
    file.write_text(file.read_text().replace("hold: 2}", "hold: 3}"))
    with pytest.raises(TrajectoryError, match="changed since `pinfric new` wrote them"):
        pf.load_trajectory(file, scene)


def test_without_a_cycle_and_without_a_rating_there_is_nothing_to_size():
    with pytest.raises(SizingError, match="give a cycle, or a rating"):
        pf.size(turntable())


def test_the_first_screen_says_what_the_robot_is_rated_for(tmp_path):
    report = sized("arm", tmp_path, catalog=None)
    said = (
        "rated for 2.00 kg, 0.100 m beyond tool, up to 1.20 m from the second joint: held in the "
        "worst posture of each joint, at most 49.2 N m (lift) without the masses of chosen drives, "
        "and lifted from there by it alone, in 1.50 s to top speed, at most 90\N{DEGREE SIGN}"
    )
    assert rating_lines(sizing_summary(report)) == [said]
    assert said in sizing_page(report)


#: A lever of 4 kg; its tool is 0.7 m from the joint.
LEVER = """<robot name="lever"><link name="base"/><link name="l"><inertial>
<origin xyz="0.3 0 0"/><mass value="4"/><inertia ixx="0.4" iyy="0.4" izz="0.4" ixy="0" ixz="0"
iyz="0"/></inertial></link><joint name="j" type="revolute"><parent link="base"/><child link="l"/>
<axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="400" velocity="4"/></joint>
<link name="tool"/><joint name="t" type="fixed"><parent link="l"/><child link="tool"/>
<origin xyz="0.7 0 0"/></joint></robot>"""


def test_rows_beside_a_rating_show_the_worst_part_of_each(tmp_path):
    """The holds decide the RMS; what wears the gear, and energy, are not those of holds."""
    (tmp_path / "lever.urdf").write_text(LEVER)
    robot = read_robot(tmp_path / "lever.urdf", {})
    scene = pf.Scene(robot.model, robot=robot, masses="without_drives", tool="tool", source="lever")
    motion, rating = wave(scene, 1.5, 1.6), {"payload": 3.0, "payload_offset": 0.1}
    alone, beside = (
        pf.size(scene, motion, "default", rating=given, on_miss="ignore").joints[0]
        for given in (None, rating)
    )
    assert beside.decided == "rating: hold"
    rows = {c.name: c for c in beside.installed.criteria}
    own = {c.name: c for c in alone.installed.criteria}
    ratio = beside.installed.candidate.ratio / alone.installed.candidate.ratio
    for name, factor in (("gear average torque", 1.0), ("gear average input speed", ratio)):
        assert rows[name].required >= 0.99 * factor * own[name].required > 0.0
    assert beside.demand.duty == pytest.approx(alone.demand.duty, rel=1e-6)
    assert beside.demand.hold_share == pytest.approx(1.0)
    assert beside.demand.power.delivered >= 0.99 * alone.demand.power.delivered > 0.0
    assert beside.demand.rms > alone.demand.rms
