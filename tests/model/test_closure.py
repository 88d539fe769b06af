"""Closing loops: configurations, Jacobians and their rates against trigonometry and differences."""

import numpy as np
import pinocchio as pin
import pytest
from cases import ball_tripod, turning_four_bar
from judges.planar_newton_euler import FourBar, bar_angles
from mechanisms import FOUR_BAR, add_link, bar, four_bar, grounded_model, shifted
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.errors import (
    ClosureError,
    SceneError,
)
from pinfric.model.closure import action_maps, full_pivot, loop_state


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


def test_a_planar_pin_across_its_mechanism_is_refused_with_what_its_axis_is():
    scene = pf.load_scene("four_bar")
    across = [{**scene.loops[0].model_dump(exclude={"axis_b"}), "axis": (1.0, 0.0, 0.0)}]
    with pytest.raises(
        SceneError, match="a planar_pin turns about the axis that all joints of its"
    ):
        scene.with_(loops=across)


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
    assert_allclose(np.einsum("txv,tv->tx", J, v), state.rate, atol=1e-12)

    def later(step):
        moved = np.array([pin.integrate(model, x, step * y) for x, y in zip(q, v, strict=True)])
        return loop_state(twin, linkage, moved, v + step * a, a)

    rows = linkage.lambdas
    ahead, behind = later(h), later(-h)
    gaps = (ahead.gap - behind.gap)[:, rows] / (2 * h)
    assert_allclose(gaps, state.rate[:, rows], atol=1e-7)
    derivative = (ahead.rate - behind.rate) / (2 * h)
    assert_allclose(derivative, state.rate_derivative, atol=2e-6)


def test_closing_keeps_the_joints_that_are_held():
    scene, joints = four_bar()
    q = joints(bar_angles(FourBar(), 0.7))
    closed = scene.close(q + np.array([0.0, 0.2, -0.15]), ["O"])
    assert_allclose(closed, q, atol=1e-13)
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


def test_full_pivoting_finds_rank_and_dependent_columns():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(5, 2)) @ rng.normal(size=(2, 7))
    rank, order = full_pivot(A)
    assert rank == 2
    assert sorted(order) == list(range(7))
    assert np.linalg.matrix_rank(A[:, order[:2]]) == 2
    assert full_pivot(np.zeros((3, 2)))[0] == 0


def test_shifted_frames_close_where_they_should():
    """`rpy` of a side turns its axis: a revolute loop with both frames upside down."""
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
