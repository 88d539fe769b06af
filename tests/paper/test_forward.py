"""Forward dynamics in absolute coordinates: undone by the inverse, break-away, two solutions."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from paper_cases import (
    PENDULUM_LENGTH,
    PIN_RADIUS,
    SLIDING,
    push_in_closed_form,
    pushed_pendulum,
    random_motion,
    random_tree,
)

from pinfric.paper.bodies import (
    PinFriction,
)
from pinfric.paper.examples import pendulum, three_link
from pinfric.paper.forward import NoConsistentFriction, forward
from pinfric.paper.inverse import inverse


@pytest.mark.parametrize("seed", range(4))
def test_forward_dynamics_is_undone_by_inverse_dynamics(seed):
    mechanism = random_tree(seed, translational=SLIDING[seed])
    angle, rate, effort = (x[0] for x in random_motion(mechanism, seed))
    instant = forward(mechanism, angle, rate, effort)
    result = inverse(mechanism, angle, rate, instant.acceleration)
    assert_array_equal(instant.modes, np.sign(rate))
    assert_allclose(result.effort_lower[0], effort, atol=1e-11)
    assert_allclose(result.friction_upper[0], instant.friction, atol=1e-11)
    assert_allclose(result.wrench[0], instant.wrench, atol=1e-11)
    assert_allclose(result.multipliers[0], instant.multipliers, atol=1e-11)
    assert_allclose(result.body_acceleration[0], instant.body_acceleration, atol=1e-11)


def test_pushed_pendulum_forward_is_undone_by_inverse_dynamics():
    mechanism = pushed_pendulum()
    instant = forward(mechanism, [0.8], [2.0], [7.0])
    push = push_in_closed_form(0.8, 2.0, instant.acceleration[0], 0.30)
    assert push == pytest.approx(7.0, rel=1e-12)


@pytest.mark.parametrize("side", [-1, 1])
def test_pendulum_at_rest_breaks_away_at_the_static_limit(side):
    mechanism = pendulum().mechanism
    limit = 0.35 * PIN_RADIUS * 9.81  # at rest the pin carries the weight
    weight = PENDULUM_LENGTH * 9.81 * np.sin(0.524)
    held = forward(mechanism, [0.524], [0.0], [weight + side * limit * (1 - 1e-9)])
    assert held.modes == [0]
    assert held.friction[0] == pytest.approx(-side * limit, rel=1e-8)
    assert abs(held.acceleration[0]) < 1e-14
    gone = forward(mechanism, [0.524], [0.0], [weight + side * limit * (1 + 1e-9)])
    assert gone.modes == [side]
    assert gone.friction[0] == pytest.approx(-side * 0.30 * gone.normal_load[0], rel=1e-12)
    assert side * gone.acceleration[0] > 0.1


def test_joints_at_rest_stick_and_slip_each_for_itself():
    case = three_link()
    pin = PinFriction(0.08, 0.1, 0.35, 0.30)
    joints = tuple(replace(j, friction=pin) for j in case.mechanism.joints)
    mechanism = replace(case.mechanism, joints=joints)
    rest = inverse(mechanism, np.zeros(3), np.zeros(3), np.zeros(3))
    held = forward(mechanism, np.zeros(3), np.zeros(3), rest.effort_frictionless[0])
    assert_array_equal(held.modes, [0, 0, 0])
    assert_allclose(held.friction, 0, atol=1e-13)
    effort = rest.effort_frictionless[0] + [0, 0, 1.2 * 0.35 * rest.normal_load[0, 2]]
    slipping = forward(mechanism, np.zeros(3), np.zeros(3), effort)
    assert_array_equal(slipping.modes, [0, 0, 1])
    assert_allclose(slipping.acceleration[:2], 0, atol=1e-13)
    assert slipping.acceleration[2] > 0
    again = inverse(mechanism, np.zeros(3), [0, 0, 1e-5], slipping.acceleration)
    assert again.effort_lower[0, 2] == pytest.approx(effort[2], abs=1e-8)
    assert np.all(again.effort_lower[0, :2] < effort[:2])
    assert np.all(effort[:2] < again.effort_upper[0, :2])


def test_static_below_kinetic_leaves_no_consistent_mode():
    mechanism = pendulum("literal").mechanism
    effort = PENDULUM_LENGTH * 9.81 * np.sin(0.524) + 0.32 * PIN_RADIUS * 9.81
    with pytest.raises(NoConsistentFriction) as caught:
        forward(mechanism, [0.524], [0.0], [effort])
    assert caught.value.consistent == []
    assert caught.value.time is None


def test_two_consistent_choices_are_an_error_that_shows_both():
    """Heavy pins (0.8, 30 cm): either of two joints may stick while the other one slips."""
    mechanism = random_tree(1645, bodies=3)
    pin = PinFriction(0.3, None, 0.8, 0.7)
    mechanism = replace(mechanism, joints=tuple(replace(j, friction=pin) for j in mechanism.joints))
    angle, effort = [1.71, -0.715, 1.643], [2.022, -0.152, 1.618]
    with pytest.raises(NoConsistentFriction) as caught:
        forward(mechanism, angle, np.zeros(3), effort)
    both = [tuple(modes) for modes in caught.value.consistent]
    assert both == [(1, 0, 1), (1, 1, 0)]
    for modes in both:
        instant = forward(mechanism, angle, np.zeros(3), effort, modes)
        limit = np.where(np.array(modes) == 0, 0.8, 0.7) * instant.normal_load
        assert np.all(np.abs(instant.friction) <= limit * (1 + 1e-12))
        assert np.all(np.array(modes) * instant.acceleration >= -1e-12)
