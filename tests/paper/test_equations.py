"""The paper's equations: velocities, null spaces, efforts on relative motion."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from paper_cases import (
    SLIDING,
    random_motion,
    random_tree,
)

from pinfric.errors import PinfricError
from pinfric.paper.bodies import (
    Actuator,
)
from pinfric.paper.equations import (
    acceleration_bias,
    actuator_forces,
    body_speeds,
    full_pivoting,
    partial_velocity_matrix,
    place,
    relative_jacobian,
)
from pinfric.paper.examples import pendulum, three_link
from pinfric.paper.inverse import inverse


@pytest.mark.parametrize("seed", range(4))
def test_speeds_and_accelerations_are_the_derivatives_of_the_placement(seed):
    mechanism = random_tree(seed, translational=SLIDING[seed])
    angle, rate, acceleration = (x[0] for x in random_motion(mechanism, seed))
    h = 2e-3
    steps = h * np.arange(-3, 4)[:, None]
    q = place(mechanism, angle + rate * steps + acceleration * steps**2 / 2)
    r = q.position[:, :-1]
    first, second = (
        np.array([-1, 9, -45, 0, 45, -9, 1]) / 60,
        np.array([2, -27, 270, -490, 270, -27, 2]) / 180,
    )
    here = place(mechanism, angle[None])
    jacobian = relative_jacobian(mechanism, here)
    speed = body_speeds(jacobian, rate[None])
    bodies = speed.reshape(-1, 6)
    A = q.orientation[:, :-1]
    spin = np.einsum("bij,bik->bjk", A[3], np.tensordot(first, A, 1) / h)  # omega~ in body axes
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
    assert_allclose(bodies[:, :3], np.tensordot(first, r, 1) / h, atol=1e-9)
    assert_allclose(bodies[:, 3:], omega, atol=1e-9)
    result = inverse(mechanism, angle, rate, acceleration)
    accelerations = result.body_acceleration.reshape(-1, 6)
    assert_allclose(accelerations[:, :3], np.tensordot(second, r, 1) / h**2, atol=1e-7)
    gamma = acceleration_bias(mechanism, here, speed).constraint
    assert_allclose(
        np.einsum("tmn,tn->tm", jacobian.constraint, result.body_acceleration), gamma, atol=1e-12
    )


@pytest.mark.parametrize("seed", range(4))
def test_partial_velocity_matrix_is_a_basis_of_the_null_space(seed):
    mechanism = random_tree(seed, bodies=5, translational=SLIDING[seed])
    placement = place(mechanism, random_motion(mechanism, seed)[0])
    constraint = relative_jacobian(mechanism, placement).constraint
    dependent, independent = full_pivoting(constraint)
    B = partial_velocity_matrix(constraint, dependent, independent)
    assert np.abs(constraint @ B).max() < 1e-13
    for t in range(len(B)):
        assert sorted([*dependent[t], *independent[t]]) == list(range(30))
        assert_array_equal(B[t, independent[t]], np.eye(5))
    # a pivot is the largest entry left, so no entry of the basis is large
    assert np.abs(B).max() < 30


def test_actuators_work_on_the_relative_motion_of_what_they_act_on():
    """Power of a unit effort: g . (v_j - v_i) at the point + h . (omega_j - omega_i), (10)-(15)."""
    mechanism = random_tree(1, translational=(1,))
    point, g, h = np.array([0.2, -0.1, 0.3]), np.array([1.0, 2.0, -1.0]), np.array([0.5, 0.0, 2.0])
    between = Actuator("between", "body_1", "body_3", point, g, h)
    mechanism = replace(mechanism, actuators=(*mechanism.actuators[:3], between))
    angle, rate, _ = random_motion(mechanism, 1)
    q = place(mechanism, angle)
    speed = body_speeds(relative_jacobian(mechanism, q), rate)
    power = np.einsum("tna,tn->ta", actuator_forces(mechanism, q), speed)
    assert_allclose(power[:, :3], rate[:, :3], atol=1e-13)
    arm = point - np.asarray(mechanism.bodies[3].center_of_mass)
    for t in range(len(rate)):
        A_i, A_j = q.orientation[t, [1, 3]]
        v_i, w_i, v_j, w_j = speed[t].reshape(4, 2, 3)[[1, 3]].reshape(4, 3)
        at = q.position[t, 3] + A_j @ arm
        relative = v_j + np.cross(A_j @ w_j, at - q.position[t, 3])
        relative -= v_i + np.cross(A_i @ w_i, at - q.position[t, 1])
        expected = (A_j @ g) @ relative + (A_j @ h) @ (A_j @ w_j - A_i @ w_i)
        assert power[t, 3] == pytest.approx(expected, rel=1e-12)


def test_dependent_constraints_are_refused():
    placement = place(random_tree(0), np.zeros((1, 4)))
    constraint = relative_jacobian(random_tree(0), placement).constraint
    with pytest.raises(PinfricError, match="depend on each other"):
        full_pivoting(np.concatenate([constraint, constraint[:, 2:3] - constraint[:, 7:8]], axis=1))


# The paper's examples: their initial states and what cannot be an input.


def test_initial_state_is_the_papers_tables():
    case = three_link()
    q = place(case.mechanism, case.position[None])
    speed = body_speeds(relative_jacobian(case.mechanism, q), case.rate[None]).reshape(3, 6)
    table = [[-0.2, 0, 0, 0, 0, 1], [-0.4, -0.25, 0, -1, 0, 1], [-0.4, -0.35, -0.15, -1, 1, 1]]
    assert_allclose(speed, table, atol=1e-15)
    assert_array_equal(q.euler_parameters[0], np.tile([0, 0, 0, 1.0], (4, 1)))
    case = pendulum()
    q = place(case.mechanism, case.position[None])
    speed = body_speeds(relative_jacobian(case.mechanism, q), case.rate[None])[0]
    assert_allclose(q.position[0, 0, :2], [0.217, 0.125], atol=6e-4)  # as printed
    assert_allclose(speed[[0, 1, 5]], [-0.125, 0.217, 1.0], atol=6e-4)
