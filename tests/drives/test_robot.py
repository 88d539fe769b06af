"""Effects of a kilogram at each joint, against inverse dynamics with that kilogram in the model."""

import dataclasses

import numpy as np
import pytest
from builders import example
from cases import jamming_drawer, resting_four_bar
from numpy.testing import assert_allclose
from sizing_cases import GEAR, MOTOR, one_drive, sized_cycle

import pinfric as pf
from pinfric.drives.inertia import joint_inertias
from pinfric.drives.policy import Conditions
from pinfric.drives.robot import (
    DrivenRobot,
    added_masses,
    depth,
    equip,
    loads,
    tip_to_base,
    with_masses,
)
from pinfric.dynamics.inverse import interval_ends
from pinfric.dynamics.samples.reactions import state_wrenches
from pinfric.errors import SizingError


@pytest.fixture(scope="module")
def arm():
    a, b = {"link": "base_link", "xyz": [0, 0.2, 0]}, {"link": "forearm_link", "xyz": [0, 0, 0.1]}
    rod = {"kind": "tension", "name": "rod", "a": a, "b": b, "stiffness": 50, "free_length": 0.1}
    scene, motion = example("ur5_pick_and_place", masses="without_drives", springs=[rod])
    return scene, motion, DrivenRobot(scene, motion, None, Conditions())


@pytest.mark.parametrize("seed", range(3))
def test_efforts_wrenches_and_inertias_are_those_of_inverse_dynamics(arm, seed):
    """Without friction to rounding; with it nearly, as friction is that of the lighter robot."""
    scene, motion, robot = arm
    rng = np.random.default_rng(seed)
    masses = {i: float(rng.uniform(0.2, 3.0)) for i in range(6)}
    heavy = with_masses(scene, masses)
    exact = pf.inverse_dynamics(heavy, motion)
    inertias = joint_inertias(heavy, exact.states)
    at_rest = motion.q, 0 * motion.v, 0 * motion.a
    still, lost = (
        pf.inverse_dynamics(x, *at_rest, attached=exact.states.attached).effort_frictionless
        for x in (heavy, heavy.with_(springs=()))
    )
    still = np.where(np.abs(lost) > np.abs(still), lost, still)  # a brake holds without the rod
    top = np.abs(exact.effort_upper).max(axis=0)
    for i in range(6):
        case = robot.case(i, masses)
        cycle = case.cycle
        bare = exact.effort_frictionless[:, i]
        assert_allclose(cycle.effort_frictionless, bare, atol=1e-11 * top.max())
        assert_allclose(case.rest.load, still[:, i], atol=1e-4)
        assert case.load_inertia == pytest.approx(inertias[:, i].max(), rel=1e-12)
        assert np.abs(cycle.effort_upper - exact.effort_upper[:, i]).max() < 0.05 * top[i]
        row = state_wrenches(heavy, exact.states)[:, i]
        radial = np.hypot(row[:, 0], row[:, 1]).max()  # the joints' axes are z of their frames
        if case.demand.bearing is not None and np.allclose(scene.twin().axis[i][3:], [0, 0, 1]):
            assert case.demand.bearing.radial == pytest.approx(radial, rel=1e-9)
    robot.solve(masses)  # now exact, friction included
    for i in range(6):
        assert_allclose(
            robot.case(i, masses).cycle.effort_upper, exact.effort_upper[:, i], rtol=1e-12
        )
    robot.solve({})


def test_a_drive_loads_the_joints_nearer_to_the_base(arm):
    scene, _, _ = arm
    assert tip_to_base(scene) == [5, 4, 3, 2, 1, 0]
    assert [loads(scene, 3, i) for i in range(6)] == [True, True, True, False, False, False]
    assert not loads(scene, 0, 0)  # it stands on the ground


def test_the_scene_says_which_masses_are_added(arm):
    scene, _, _ = arm
    masses, conditions = dict.fromkeys(range(6), 2.0), Conditions()
    assert added_masses(scene, conditions, masses) == masses
    held = scene.with_(masses="with_drives")
    assert added_masses(held, conditions, masses) == {}
    some = scene.with_(masses={"elbow_joint": "without_drives", "others": "with_drives"})
    assert added_masses(some, conditions, masses) == {2: 2.0}
    exact = Conditions(mass_in_urdf={"elbow_joint": 1.5})  # replaces what the link holds
    assert added_masses(held, exact, masses) == {2: 0.5}
    assert added_masses(scene.with_(masses=None), conditions, masses) == masses


def test_in_a_loop_a_drive_may_load_each_joint_but_for_one_on_the_ground():
    scene = resting_four_bar(2).scene.with_(actuators=[{"joint": "O"}, {"joint": "A"}])
    assert [[loads(scene, drive, i) for i in range(2)] for drive in range(2)] == [
        [False, False],  # the crank's stands on the ground
        [True, True],
    ]


@pytest.mark.parametrize("before", [None, "without_drives"])
def test_links_hold_the_drives_that_a_robot_is_equipped_with(arm, tmp_path, before):
    """And no other: a drive of unknown mass adds none."""
    scene = arm[0].with_(masses=before)
    known = sized_cycle(one_drive(tmp_path)).joints[0].choice.candidate
    drives = {
        2: known,
        3: dataclasses.replace(known, gear=known.gear.model_copy(update={"mass": None})),
    }
    found = equip(scene, drives, Conditions())
    words = {} if before is None else dict.fromkeys(scene.actuator_names, before)
    assert found.masses == words | {scene.actuator_names[2]: "with_drives"}
    more = [
        b.mass - a.mass for a, b in zip(scene.model.inertias, found.model.inertias, strict=True)
    ]
    assert more == pytest.approx([0, 0, MOTOR["mass"] + GEAR["mass"], 0, 0, 0, 0])
    del drives[2]
    assert equip(scene, drives, Conditions()).masses == (words or None)


def test_a_cycle_whose_intervals_may_be_too_narrow_is_refused(monkeypatch):
    case = resting_four_bar(5)
    motion = pf.Trajectory.from_arrays(
        case.scene, np.linspace(0, 1, 5), np.repeat(case.q[:1], 5, axis=0)
    )
    monkeypatch.setattr(interval_ends, "ENUMERATED", 1)
    monkeypatch.setattr(interval_ends, "NODES", 0)
    with (
        pytest.warns(pf.PinfricWarning, match="may be too narrow"),
        pytest.raises(SizingError, match=r"sample 0 of 5 has intervals .* may be too narrow"),
    ):
        DrivenRobot(case.scene, motion, None, Conditions())


def test_a_cycle_that_jams_is_refused():
    case = jamming_drawer(0.6, 1.0)
    t, q = np.array([0.0, 0.1]), np.array([[0.0], [0.105]])
    motion = pf.Trajectory.from_arrays(case.scene, t, q, q + 1.0, 0 * q + 1.0)
    with pytest.raises(SizingError, match=r"sample 0 of 2 has no efforts \(jammed\)"):
        DrivenRobot(case.scene, motion, None, Conditions())


def test_depth_counts_the_joints_from_the_ground(arm):
    scene, _, robot = arm
    assert [depth(scene, i) for i in range(6)] == [1, 2, 3, 4, 5, 6]
    # the base axes are the first three, as in the conditions of resonance
    assert [robot.case(i, {}).hand for i in range(6)] == [False] * 3 + [True] * 3


def test_masses_that_load_nothing_leave_the_scene_as_it_is(arm):
    scene, _, _ = arm
    assert with_masses(scene, {}) is scene
    assert with_masses(scene, {0: 5.0, 1: 0.0}) is scene  # on the ground; nothing
    assert with_masses(scene, {1: 5.0}) is not scene


def test_masses_on_a_linkage_are_computed_exactly():
    """A drive at the coupler's pin sits on the crank and is lifted by itself."""
    case = resting_four_bar(5)
    scene = case.scene.with_(actuators=[{"joint": "A"}])
    motion = pf.Trajectory.from_arrays(scene, np.linspace(0, 1, 5), case.q, case.v, case.a)
    wanted = pf.inverse_dynamics(with_masses(scene, {0: 2.0}), motion)
    light = pf.inverse_dynamics(scene, motion)
    assert np.abs(wanted.effort_upper - light.effort_upper).max() > 0.1
    found = DrivenRobot(scene, motion, None, Conditions()).case(0, {0: 2.0})
    assert_allclose(found.cycle.effort_upper, wanted.effort_upper[:, 0], rtol=1e-12)
