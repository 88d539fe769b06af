"""Closing loops: configurations, velocities, accelerations, and what must be refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from cases import ball_tripod, crank_motion, turning_four_bar
from judges.planar_newton_euler import FourBar, bar_angles
from mechanisms import FOUR_BAR, add_link, bar, four_bar, grounded_model, shifted

import pinfric as pf
from pinfric.dynamics.samples.closure import (
    complete_configurations,
    consistent_motion,
    independent_joints,
)
from pinfric.errors import (
    ClosureError,
    LoopMotionError,
    SceneError,
    StateError,
    TrajectoryError,
    UndrivenMotionError,
)
from pinfric.model.closure import action_maps, closure_jacobian, full_pivot, loop_state

ROBOTS = Path(__file__).parents[3] / "robots"


def relations(case):
    """(gap, J_c v, derivative of J_c v) along the multipliers of every sample."""
    linkage = case.scene.linkage
    state = loop_state(case.scene.twin(), linkage, case.q, case.v, case.a)
    rows = linkage.lambdas
    return state.gap[:, rows], state.rate[:, rows], state.rate_derivative[:, rows]


@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
@pytest.mark.parametrize("cut", list(FOUR_BAR))
def test_a_four_bar_is_closed_where_trigonometry_says_so(cut, kind):
    case = turning_four_bar(12, cut, kind)
    for relation, size in zip(relations(case), (0.3, 1.0, 10.0), strict=True):
        assert np.abs(relation).max() < 1e-14 * size * 10


def test_a_spherical_loop_is_closed_by_newton():
    for relation in relations(ball_tripod()):
        assert np.abs(relation).max() < 1e-13


@pytest.mark.parametrize("make", [turning_four_bar, ball_tripod])
def test_jacobian_rates_and_their_derivatives_agree_with_differences(make):
    case, h = make(), 1e-6
    model, linkage, twin = case.scene.model, case.scene.linkage, case.scene.twin()
    q, v, a = case.q[:3], case.v[:3], case.a[:3]
    state = loop_state(twin, linkage, q, v, a)
    _, J = action_maps(twin, linkage, state.p, state.R)
    np.testing.assert_allclose(np.einsum("txv,tv->tx", J, v), state.rate, atol=1e-12)

    def later(step):
        moved = np.array([pin.integrate(model, x, step * y) for x, y in zip(q, v, strict=True)])
        return loop_state(twin, linkage, moved, v + step * a, a)

    rows = linkage.lambdas
    ahead, behind = later(h), later(-h)
    gaps = (ahead.gap - behind.gap)[:, rows] / (2 * h)
    np.testing.assert_allclose(gaps, state.rate[:, rows], atol=1e-7)
    derivative = (ahead.rate - behind.rate) / (2 * h)
    np.testing.assert_allclose(derivative, state.rate_derivative, atol=2e-6)


def test_closing_keeps_the_joints_that_are_held():
    scene, joints = four_bar()
    q = joints(bar_angles(FourBar(), 0.7))
    closed = scene.close(q + np.array([0.0, 0.2, -0.15]), ["O"])
    np.testing.assert_allclose(closed, q, atol=1e-13)
    free = scene.close(q + np.array([0.05, 0.1, -0.1]))
    assert np.abs(free - q).max() > 1e-3  # another configuration, as closed
    state = loop_state(scene.twin(), scene.linkage, free[None], *np.zeros((2, 1, 3)))
    assert np.abs(state.gap[0, scene.linkage.lambdas]).max() < 1e-14


def test_a_loop_that_cannot_close_says_how_far_apart_it_stays():
    scene, _ = four_bar()
    # crank held at 0, rocker held upright: the coupler's end is 0.35 m from A, B is 0.32 away
    with pytest.raises(ClosureError, match=r"loop 'B' cannot close.*stay 0\.0298 m apart") as error:
        scene.close([0.0, 0.5, np.pi / 2], ["O", "C"])
    expected = 0.35 - np.hypot(0.2, 0.25)
    assert error.value.residual == pytest.approx(expected, rel=1e-6)


def test_a_scene_whose_loop_can_never_close_is_refused():
    scene, _ = four_bar()
    loop = scene.loops[0].model_copy(
        update={"a": scene.loops[0].a.model_copy(update={"xyz": (0.9, 0.0, 0.0)})}
    )
    with pytest.raises(
        SceneError, match=r"loops\[0\] \(B\): cannot close: .* at least 0\.25 m apart"
    ):
        pf.Scene(model=scene.model, loops=[loop], actuators=[{"joint": "O"}])


def test_independent_joints_by_full_pivoting():
    case = ball_tripod()
    J = closure_jacobian(case.scene.twin(), case.scene.linkage, case.q[:1])[0]
    chosen = independent_joints(case.scene, case.q[0])
    assert len(chosen) == 5 - np.linalg.matrix_rank(J)
    index = [case.scene.joint_names.index(name) for name in chosen]
    v, a = consistent_motion(case.scene, case.q, chosen, case.v[:, index], case.a[:, index])
    np.testing.assert_allclose(v, case.v, atol=1e-12)
    np.testing.assert_allclose(a, case.a, atol=1e-11)


def test_full_pivoting_finds_rank_and_dependent_columns():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(5, 2)) @ rng.normal(size=(2, 7))
    rank, order = full_pivot(A)
    assert rank == 2
    assert sorted(order) == list(range(7))
    assert np.linalg.matrix_rank(A[:, order[:2]]) == 2
    assert full_pivot(np.zeros((3, 2)))[0] == 0


@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
def test_a_trajectory_keeps_its_assembly_for_whole_turns(kind):
    scene, joints = four_bar("B", kind)
    angles = np.linspace(0.3, 0.3 + 4 * np.pi, 200)
    q = np.zeros((200, 3))
    q[:, 0] = angles
    closed = complete_configurations(scene, [0.3, 0.4, 1.4], ["O"], q)
    expected = joints(np.array([bar_angles(FourBar(), angle) for angle in angles]))
    np.testing.assert_allclose(np.cos(closed), np.cos(expected), atol=1e-12)
    np.testing.assert_allclose(np.sin(closed), np.sin(expected), atol=1e-12)


def test_independent_joints_that_do_not_determine_the_rest_are_refused():
    scene, joints = four_bar()
    # crank and coupler in line with each other: the rocker's rate says nothing of the crank's
    toggle = np.arccos((0.3**2 + 0.45**2 - 0.25**2) / (2 * 0.3 * 0.45))
    q = joints(np.array([bar_angles(FourBar(), angle) for angle in (0.5, toggle)]))
    one = np.ones((2, 1))
    consistent_motion(scene, q, ["O"], one, one)
    with pytest.raises(ClosureError, match="sample 1: the independent joints do not determine"):
        consistent_motion(scene, q, ["C"], one, one)


# ---------------------------------------------------------------- motions that loops do not allow


def test_an_open_loop_is_refused_with_its_gap():
    case = turning_four_bar(10)
    q = case.q.copy()
    q[6, 2] += 1e-3
    with pytest.raises(LoopMotionError, match=r"'B' is open at sample 6, by 0\.000") as error:
        pf.inverse_dynamics(case.scene, q, case.v, case.a)
    assert error.value.sample == 6
    assert error.value.amount < 0.25e-3 * 1.001


def test_velocities_and_accelerations_that_violate_a_loop_are_refused_with_the_amount():
    case = turning_four_bar(10)
    v, a = case.v.copy(), case.a.copy()
    v[3, 2] += 0.01
    with pytest.raises(LoopMotionError, match=r"by the velocities at sample 3, by .* m/s") as error:
        pf.inverse_dynamics(case.scene, case.q, v, case.a)
    assert error.value.amount == pytest.approx(0.25 * 0.01, rel=1e-9)  # the rocker's end
    a[4, 2] += 0.1
    with pytest.raises(LoopMotionError, match=r"by the accelerations at sample 4, by .* m/s\^2"):
        pf.inverse_dynamics(case.scene, case.q, case.v, a)
    # what float64 leaves is no violation
    pf.inverse_dynamics(case.scene, case.q, case.v * (1 + 1e-9), case.a)


def test_the_sample_named_is_that_of_the_whole_motion():
    case = turning_four_bar(1500)
    v = case.v.copy()
    v[1234, 1] += 0.01
    with pytest.raises(LoopMotionError, match="at sample 1234"):
        pf.inverse_dynamics(case.scene, case.q, v, case.a)


def test_a_cylinder_whose_ends_coincide_is_refused_with_the_sample():
    model = grounded_model()
    add_link(model, 0, pin.JointModelPX(), pin.SE3.Identity(), "slide", bar(1.0, 0.2))
    ends = {"a": {"link": "ground", "xyz": [0.1, 0, 0]}, "b": {"link": "slide"}}
    scene = pf.Scene(model=model, actuators=[{"cylinder": {"name": "ram", **ends}}])
    q = np.array([[0.3], [0.2], [0.1]])
    with pytest.raises(StateError, match="cylinder 'ram': its ends coincide at sample 2"):
        pf.inverse_dynamics(scene, q, 0 * q, 0 * q)


def test_a_planar_pin_outside_the_plane_is_refused():
    case = ball_tripod()
    loop = {**case.scene.loops[0].model_dump(), "kind": "planar_pin"}
    drives = [{"joint": name} for name in ("arm", "rod", "rocker")]
    scene = pf.Scene(model=case.scene.model, loops=[loop], actuators=drives)
    with pytest.raises(StateError, match=r"'ball': the axes of its sides differ by .* at sample 0"):
        pf.inverse_dynamics(scene, case.q, case.v, case.a)


# ---------------------------------------------------------------- actuators


def scene_with(actuators, **more):
    scene, _ = four_bar()
    return pf.Scene(model=scene.model, loops=scene.loops, actuators=actuators, **more)


@pytest.mark.parametrize(
    ("actuators", "says"),
    [
        ([], "0 for 1 degree of freedom; undriven: A, where this motion needs 0.389 .* sample 0"),
        ([{"joint": "O"}, {"joint": "A"}], "2 for 1 degree of freedom: .*keep only 1 of O, A"),
        (None, "3 for 1 degree of freedom: .*keep only 1 of O, A, C"),
        ([{"joint": "X"}], "joint 'X' is not there"),
        ([{"joint": "O"}, {"joint": "O"}], "'O' is listed twice"),
    ],
)
def test_actuators_are_counted_against_the_freedoms_that_loops_leave(actuators, says):
    q = four_bar()[0].close(np.full(3, 0.5))
    with pytest.raises((SceneError, UndrivenMotionError), match=says):
        pf.inverse_dynamics(scene_with(actuators), q, np.zeros(3), np.zeros(3))


def test_an_undriven_motion_is_named_even_where_the_count_is_right():
    model = grounded_model()
    for name in ("left", "right"):
        add_link(model, 0, pin.JointModelPX(), pin.SE3.Identity(), name, bar(1.0, 0.1))
    push = {"link": "left", "direction": [1, 0, 0]}
    twice = [{"force": {"name": n, **push}} for n in ("one", "two")]
    scene = pf.Scene(model=model, actuators=twice)
    assert (scene.mobility.undriven, scene.mobility.redundant) == ((1,), (0, 1))
    with pytest.raises(SceneError, match=r"2 for 2 degrees of freedom: .* keep only 1 of one, two"):
        pf.inverse_dynamics(scene, *np.zeros((3, 2)))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"a": {"link": "couplet"}},
            r"loops\[0\] \(B\)\.a\.link: there is no link 'couplet'; did you",
        ),
        ({"name": "A"}, "the name 'A' is taken"),
        ({"axis": [0, 0, 0]}, r"loops\[0\] \(B\)\.axis: .* has no direction"),
        ({"b": {"link": "coupler"}}, "both sides are on the same rigid body"),
        ({"kind": "hinge"}, "kind"),
        ({"c": 1}, r"unknown key `loops\[0\].c`"),
    ],
)
def test_bad_loops_are_refused(change, says):
    scene, _ = four_bar()
    loop = {**scene.loops[0].model_dump(), **change}
    with pytest.raises(SceneError, match=says):
        pf.Scene(model=scene.model, loops=[loop], actuators=[{"joint": "O"}])


@pytest.mark.parametrize(
    ("kind", "bearing", "says"),
    [
        ("planar_pin", {"kind": "ball", "radius": 0.01}, "a ball does not fit a planar_pin loop"),
        ("planar_pin", {"kind": "pin", "radius": 0.01, "length": 0.1}, "carries no bending moment"),
        ("revolute", {"kind": "guide", "length": 0.1}, "a guide does not fit a revolute loop"),
        ("fixed", {"kind": "pin", "radius": 0.01}, "cannot move"),
    ],
)
def test_bearings_that_do_not_fit_their_loop_are_refused(kind, bearing, says):
    scene, _ = four_bar()
    loop = {**scene.loops[0].model_dump(), "kind": kind}
    friction = {"B": {"bearing": bearing, "mu": {"static": 0.1, "kinetic": 0.1}}}
    with pytest.raises(SceneError, match=says):
        pf.Scene(model=scene.model, loops=[loop], actuators=[{"joint": "O"}], friction=friction)


# ---------------------------------------------------------------- trajectory files


def test_a_csv_names_only_the_independent_joint(tmp_path):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    t = np.linspace(0, 1, 400)
    angle = 0.5 + 2 * t
    path = tmp_path / "turn.csv"
    np.savetxt(
        path,
        np.column_stack([t, angle, 2 + 0 * t, 0 * t]),
        delimiter=",",
        comments="",
        header="t,crank_pin,crank_pin.v,crank_pin.a",
        fmt="%.17g",
    )
    motion = pf.load_trajectory(path, scene)
    assert motion.joint_names == scene.joint_names
    _, joints = four_bar()
    q, v, a = crank_motion(joints, angle, 2.0, 0.0)
    order = [scene.joint_names.index(n) for n in ("crank_pin", "coupler_pin", "ground_pin")]
    position = motion.joint_positions()[:, order]
    np.testing.assert_allclose(np.sin(position), np.sin(q), atol=1e-12)
    np.testing.assert_allclose(motion.v[:, order], v, atol=1e-11)
    np.testing.assert_allclose(motion.a[:, order], a, atol=1e-10)


def test_all_joints_named_without_derivatives_are_made_consistent(tmp_path):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    whole = pf.load_trajectory(ROBOTS / "four_bar.waypoints.yaml", scene)
    path = tmp_path / "all.csv"
    t, position = whole.t[100:400], whole.joint_positions()[100:400]
    np.savetxt(
        path,
        np.column_stack([t, position]),
        delimiter=",",
        comments="",
        fmt="%.17g",
        header=",".join(["t", *scene.joint_names]),
    )
    motion = pf.load_trajectory(path, scene)
    pf.inverse_dynamics(scene, motion)  # refuses what violates the loop
    np.testing.assert_allclose(motion.v[5:-5], whole.v[105:395], rtol=1e-4, atol=1e-4)


def test_a_file_with_a_wrong_number_of_joints_is_refused(tmp_path):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    path = tmp_path / "two.csv"
    path.write_text("t,crank_pin,ground_pin\n0,0.5,1.5\n1,0.6,1.5\n")
    with pytest.raises(TrajectoryError, match=r"names 2 joints .* leave 1 independent: name 1,"):
        pf.load_trajectory(path, scene)


def test_a_file_that_leaves_the_mechanisms_reach_says_at_which_sample(tmp_path):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    path = tmp_path / "rocker.csv"
    t = np.linspace(0, 1, 50)
    rows = np.column_stack([t, 1.5 - 1.5 * t])  # the rocker cannot lie down
    np.savetxt(path, rows, delimiter=",", comments="", header="t,ground_pin", fmt="%.17g")
    with pytest.raises(TrajectoryError, match=r"rocker.csv: loop 'rocker_pin' cannot close at sam"):
        pf.load_trajectory(path, scene)


def test_shifted_frames_close_where_they_should():
    """`rpy` of a side turns its axis: a revolute loop whose frames both lie on their backs."""
    model = grounded_model()
    first = add_link(model, 0, pin.JointModelRX(), pin.SE3.Identity(), "arm", bar(1.0, 0.2))
    add_link(model, first, pin.JointModelRX(), shifted(0.2), "hand", bar(1.0, 0.2))
    turned = [0.0, np.pi / 2, 0.0]  # frame z along the link's x
    loop = {
        "name": "ring",
        "kind": "revolute",
        "a": {"link": "ground", "xyz": [0.4, 0, 0], "rpy": turned},
        "b": {"link": "hand", "xyz": [0.2, 0, 0], "rpy": turned},
    }
    # the arms turn about their own axis: any angles are closed, two freedoms remain
    scene = pf.Scene(model=model, loops=[loop], actuators=[{"joint": "arm"}, {"joint": "hand"}])
    state = loop_state(scene.twin(), scene.linkage, np.array([[0.3, 1.1]]), *np.zeros((2, 1, 2)))
    assert np.abs(state.gap[0, scene.linkage.lambdas]).max() < 1e-15
