"""Summaries against figures worked out by hand."""

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example, lump

import pinfric as pf
from pinfric.errors import StateError
from pinfric.motions.summary import (
    ActuatorSummary,
    beyond_limits,
    payload_phases,
    rms,
    sites_on,
    summarize,
)

INERTIA = 2.0  # kg m^2 about the joint; kg for the slider
MIMIC = """<robot name="fingers">
  <link name="base"/>
  <link name="left"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"
    ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="right"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"
    ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="leader" type="revolute"><parent link="base"/><child link="left"/><axis xyz="0 0 1"/>
    <limit lower="-9" upper="9" effort="1" velocity="9"/></joint>
  <joint name="mirror" type="revolute"><parent link="base"/><child link="right"/>
    <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1" velocity="9"/>
    <mimic joint="leader" multiplier="-2"/></joint>
</robot>"""


def turntable(joint=None, **scene):
    """One body whose effort is INERTIA x acceleration; its weight does not load the drive."""
    body = lump(INERTIA, moment=INERTIA)
    model = chain(("table", joint or pin.JointModelRZ(), body))
    return pf.Scene(model=model, **scene)


def summary(t, v, a, **scene) -> ActuatorSummary:
    column = np.array(v, dtype=float)[:, None], np.array(a, dtype=float)[:, None]
    model = turntable(**scene)
    result = pf.inverse_dynamics(model, 0 * column[0], *column, t=np.array(t, dtype=float))
    return summarize(result)[0]


DRY = {"friction": {"table": dry(3.0, 2.0)}}


def test_a_loss_at_the_motor_has_its_share_there():
    """T = u_0/r + r J a + n: 0.5 N m of 2 x 3/10 + 10 x 0.01 x 3 = 0.9 N m."""
    gear = {"ratio": 10.0, "rotor_inertia": 0.01, "no_load_torque": 0.5}
    lost = [{"joint": "table", "transmission": gear}]
    s = summary([0, 1, 2], [1, 1, 1], [3, 3, 3], actuators=lost)
    assert s.friction_share == 0.0
    assert s.motor_peak == pytest.approx(1.4)
    assert s.motor_friction_share == pytest.approx(0.5 / 1.4)
    same = summary([0, 1, 2], [1, 1, 1], [3, 3, 3], **DRY)
    assert same.motor_friction_share == same.friction_share > 0.0


def test_constant_effort_has_its_own_magnitude_as_peak_and_rms():
    s = summary([0, 1, 2], [1, 1, 1], [0, 0, 0], **DRY)
    assert (s.peak, s.rms, s.rms_least) == pytest.approx((2, 2, 2))
    assert (s.peak_frictionless, s.rms_frictionless) == pytest.approx((0, 0), abs=1e-12)
    assert (s.stick_time, s.sticks, s.reversals, s.max_interval) == (0, 0, 0, 0)
    assert s.friction_share == pytest.approx(1.0)
    assert s.unit == s.motor_unit == "N m"


def test_interval_that_encloses_zero_has_least_rms_zero():
    s = summary([0, 1, 2], [0, 0, 0], [0, 0, 0], **DRY)
    assert (s.peak, s.rms, s.max_interval) == pytest.approx((3, 3, 6))
    assert s.rms_least == 0
    assert (s.stick_time, s.sticks) == (2, 1)


def test_interval_beside_zero_has_its_nearer_end_as_least():
    # at rest, but about to accelerate: u = 2 * 4 +- 3
    s = summary([0, 1], [0, 0], [4, 4], **DRY)
    assert (s.rms_least, s.rms, s.peak) == pytest.approx((5, 11, 11))


def test_rms_weights_by_time():
    # u = 2, 2, 6 at 0, 1, 10 s: ((4 + 4)/2 * 1 + (4 + 36)/2 * 9) / 10 = 18.4, not 44/3
    s = summary([0, 1, 10], [1, 1, 1], [1, 1, 3])
    assert s.rms == pytest.approx(math.sqrt(18.4))
    assert rms(np.array([5.0]), np.array([-3.0])) == 3.0


def test_peak_is_the_larger_magnitude_with_its_time_and_velocity():
    s = summary([0, 1, 2], [1, 5, 2], [1, -7, 3])
    assert (s.peak, s.peak_time, s.peak_velocity) == pytest.approx((14, 1, 5))


def test_stick_of_one_sample_counts_but_takes_no_time():
    s = summary([0, 1, 2, 3, 5], [1, 0, 1, 0, 0], [0] * 5, **DRY)
    assert (s.sticks, s.stick_time) == (2, 2.0)


def test_reversal_between_samples_counts_once():
    s = summary([0, 1, 2], [1, -0.5, -1], [0] * 3, **DRY)
    assert (s.sticks, s.reversals) == (0, 1)
    assert s.max_interval == pytest.approx(6)


@pytest.mark.parametrize(("direction", "effort"), [(1, 4.0), (-1, 0.0)])
def test_share_is_half_where_friction_equals_the_rest_whichever_way_it_acts(direction, effort):
    # frictionless 2 N m; friction 2 N m opposes or does the drive's work
    s = summary([0, 1], [direction] * 2, [1, 1], **DRY)
    assert s.peak == pytest.approx(effort)
    assert s.friction_share == pytest.approx(0.5)


def test_without_friction_the_share_is_zero_even_of_nothing():
    assert summary([0, 1], [1, 1], [0, 0]).friction_share == 0


def test_motor_side_is_behind_the_gear():
    gear = [{"joint": "table", "transmission": {"ratio": 10, "no_load_torque": 0.1}}]
    s = summary([0, 1], [1, 1], [1, 1], actuators=gear)
    assert s.peak == pytest.approx(2)
    assert (s.motor_peak, s.motor_rms, s.motor_rms_least) == pytest.approx((0.3, 0.3, 0.3))
    still = summary([0, 1], [0, 0], [1, 1], actuators=gear)
    assert (still.motor_rms_least, still.motor_rms) == pytest.approx((0.1, 0.3))


def test_units_follow_the_joint():
    gear = [{"joint": "table", "transmission": {"ratio": 100}}]
    s = summary([0, 1], [1, 1], [1, 1], joint=pin.JointModelPX(), actuators=gear)
    assert (s.unit, s.motor_unit) == ("N", "N m")
    planar = turntable(joint=pin.JointModelPlanar())
    assert [drive.unit for drive in planar.drives] == ["N", "N", "N m"]


@pytest.mark.parametrize("limit", [0.0, 3.0, 5.0])
def test_efforts_beyond_the_limit_of_the_urdf_are_named(limit):
    """Inertia 2 and friction 2 at 1 rad/s^2 take 4 N m; a limit of 0 states none."""
    model = turntable().model.copy()
    model.effortLimit[:] = limit
    scene = pf.Scene(model=model, **DRY)
    one = np.ones((2, 1))
    result = pf.inverse_dynamics(scene, one, one, one, t=np.arange(2.0))
    said = beyond_limits(result)
    assert said == (("table needs 4 N m; the URDF allows 3 N m",) if limit == 3.0 else ())


def test_drive_sticks_with_its_mimic_follower():
    model = pin.buildModelFromXML(MIMIC, mimic=True)
    scene = pf.Scene(model=model, friction={"mirror": dry(1)})
    v = np.array([[1.0], [0.0], [0.0], [0.0]])
    result = pf.inverse_dynamics(scene, 0 * v, v, 0 * v, t=np.arange(4.0))
    (s,) = summarize(result)
    assert (s.name, s.sticks, s.stick_time) == ("leader", 1, 2.0)
    assert s.max_interval == pytest.approx(4.0)  # 2 N m wide at the follower, geared 2 : 1


def test_a_cylinder_rests_with_its_own_joint_and_not_with_every_other():
    """The way-points hold for 1.5 s; boom, then bucket, stand while the others move on."""
    result = pf.inverse_dynamics(*example("excavator"))
    assert [s.stick_time for s in summarize(result)] == pytest.approx([5.0, 3.0, 1.5])


@pytest.mark.parametrize(
    ("name", "joints", "felt"),
    [
        ("excavator", {}, [[0], [1], [2]]),
        ("four_bar", {}, [[0, 1, 2, 3]]),
        ("excavator", {1: {}, 2: {"couples": {"stick_pin": 1.0}}}, [[0], [1, 2], [1, 2]]),
        ("excavator", {0: {}}, [[0], [1], [2]]),
    ],
)
def test_only_friction_that_a_drive_feels_changes_its_effort(name, joints, felt):
    """With drives on some joints in place of cylinders, one coupled to the joint before."""
    scene = pf.load_scene(name)
    drives = list(scene.actuators)
    for d, changes in joints.items():
        drives[d] = {"joint": scene.joint_names[d], **changes}
    scene = scene.with_(actuators=drives)
    assert [sites_on(scene, d) for d in range(len(scene.drives))] == felt
    motion = pf.load_trajectory(name, scene)
    row = [len(motion.t) // 3]
    effort = pf.inverse_dynamics(scene, motion.q[row], motion.v[row], motion.a[row]).effort_upper
    for s, site in enumerate(scene.sites):
        other = scene.with_(friction={k: f for k, f in scene.friction.items() if k != site.name})
        without = pf.inverse_dynamics(other, motion.q[row], motion.v[row], motion.a[row])
        (changed,) = np.nonzero(np.abs(without.effort_upper - effort)[0] > 1e-9)
        assert set(changed) <= {d for d, sites in enumerate(felt) if s in sites}
        assert len(changed)


def test_payload_phases_end_where_the_payload_is_let_go():
    payloads = {"box": {"link": "plate", "mass": 1.0, "com": [0, 0, 0]}}
    model = turntable().model
    model.addBodyFrame("plate", 1, pin.SE3.Identity(), 0)
    scene = pf.Scene(model=model, payloads=payloads)
    still = np.zeros((5, 1))
    attached = np.array([0, 1, 1, 0, 1], dtype=bool)[:, None]
    states = dict(t=np.arange(5.0), attached=attached)
    result = pf.inverse_dynamics(scene, still, still, still, **states)
    assert payload_phases(result) == {"box": [(1.0, 3.0), (4.0, 4.0)]}
    always = pf.inverse_dynamics(scene, still, still, still, t=np.arange(5.0))
    assert payload_phases(always) == {"box": [(0.0, 4.0)]}


def test_sample_without_a_solution_is_not_passed_over():
    v = np.ones((3, 1))
    result = pf.inverse_dynamics(turntable(**DRY), v, v, v, t=np.arange(3.0))
    unknown = result.effort_upper.copy()
    unknown[1] = np.nan
    (s,) = summarize(dataclasses.replace(result, effort_lower=unknown, effort_upper=unknown))
    assert all(math.isnan(x) for x in (s.peak, s.rms, s.friction_share, s.max_interval))


def test_without_times_there_is_no_summary():
    v = np.ones((2, 1))
    with pytest.raises(StateError, match="needs times"):
        summarize(pf.inverse_dynamics(turntable(), v, v, v))
