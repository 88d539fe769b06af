"""Closing loops: configurations, velocities, accelerations, refusals."""

import numpy as np
import pinocchio as pin
import pytest
from cases import ball_tripod, turning_four_bar
from judges.planar_newton_euler import FourBar, bar_angles
from mechanisms import add_link, bar, four_bar, grounded_model
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.samples.closure import (
    complete_configurations,
    consistent_motion,
    first_closed,
    independent_joints,
)
from pinfric.errors import (
    ClosureError,
    LoopMotionError,
    SceneError,
    StateError,
)
from pinfric.model.closure import closure_jacobian


def test_independent_joints_by_full_pivoting():
    case = ball_tripod()
    J = closure_jacobian(case.scene.twin(), case.scene.linkage, case.q[:1])[0]
    chosen = independent_joints(case.scene, case.q[0])
    assert len(chosen) == 5 - np.linalg.matrix_rank(J)
    index = [case.scene.joint_names.index(name) for name in chosen]
    v, a = consistent_motion(case.scene, case.q, chosen, case.v[:, index], case.a[:, index])
    assert_allclose(v, case.v, atol=1e-12)
    assert_allclose(a, case.a, atol=1e-11)


@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
def test_a_trajectory_keeps_its_assembly_for_whole_turns(kind):
    scene, joints = four_bar("B", kind)
    angles = np.linspace(0.3, 0.3 + 4 * np.pi, 200)
    q = np.zeros((200, 3))
    q[:, 0] = angles
    closed = complete_configurations(scene, [0.3, 0.4, 1.4], ["O"], q)
    expected = joints(np.array([bar_angles(FourBar(), angle) for angle in angles]))
    assert_allclose(np.cos(closed), np.cos(expected), atol=1e-12)
    assert_allclose(np.sin(closed), np.sin(expected), atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, np.pi])
def test_bars_in_a_line_close_after_a_search(angle):
    scene, _ = four_bar("B", "planar_pin")
    q = np.array([angle, 0.0, 0.0])
    with pytest.raises(ClosureError):  # the rows of the line are singular
        complete_configurations(scene, np.zeros(3), ["O"], q[None])
    closed, searched = first_closed(scene, np.zeros(3), ["O"], q)
    assert searched
    # the closed form of one assembly or of its mirror image at the crank's other side
    joints = four_bar("B", "planar_pin")[1]
    ways = [joints(np.array([bar_angles(FourBar(), sign * angle)])) for sign in (1.0, -1.0)]
    apart = [
        np.abs(np.exp(1j * sign * way[0]) - np.exp(1j * closed)).max()
        for sign, way in zip((1.0, -1.0), ways, strict=True)
    ]
    assert min(apart) < 1e-9
    assert not first_closed(scene, closed, ["O"], closed)[1]


def test_independent_joints_that_do_not_determine_the_rest_are_refused():
    scene, joints = four_bar()
    # crank and coupler in line with each other: the rocker's rate says nothing of the crank's
    toggle = np.arccos((0.3**2 + 0.45**2 - 0.25**2) / (2 * 0.3 * 0.45))
    q = joints(np.array([bar_angles(FourBar(), angle) for angle in (0.5, toggle)]))
    one = np.ones((2, 1))
    consistent_motion(scene, q, ["O"], one, one)
    with pytest.raises(ClosureError, match="sample 1: the independent joints do not determine"):
        consistent_motion(scene, q, ["C"], one, one)


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


@pytest.mark.parametrize("speed", [1e-2, 1.0, 100.0])
def test_what_the_velocities_may_violate_grows_with_the_speed(speed):
    case = turning_four_bar(10)
    v, a = case.v * speed, case.a * speed**2
    v[3, 2] += 1e-7 * np.abs(v).max()
    pf.inverse_dynamics(case.scene, case.q, v, a)
    v[3, 2] += 1e-4 * np.abs(v).max()
    with pytest.raises(LoopMotionError, match="by the velocities at sample 3"):
        pf.inverse_dynamics(case.scene, case.q, v, a)


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
    with pytest.raises(SceneError, match=r"loops\[0\] \(ball\): the axes of its sides differ by"):
        pf.Scene(model=case.scene.model, loops=[loop], actuators=drives)


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
