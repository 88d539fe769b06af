"""Mechanisms at rest: which joints rest together, how they share friction, whether any moves."""

from __future__ import annotations

import numpy as np
import pytest
from friction_cases import (
    grid_use,
    plain_limits,
    plain_loads,
    random_problem,
    two_that_share,
)
from scipy.optimize import linprog

from pinfric.friction.problem import Modes, empty_problem
from pinfric.friction.rest import Mechanism, solve_modes


def test_what_rests_together_is_found_and_whether_anything_moves():
    """Coordinates 0 and 1 are one motion, 2 another; 3 cannot move at all."""
    factor = np.array([[1.0, -2.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0]])
    four = np.arange(4)
    mechanism = Mechanism(True, factor, four, np.zeros(4, bool), np.zeros(4, bool), np.zeros(4))
    everything = np.ones(4, dtype=bool)
    together = [set(group.members.tolist()) for group in mechanism.groups(everything)]
    assert {0, 1} in together
    assert {2} not in together
    assert mechanism.is_dependent(everything)
    assert not mechanism.is_dependent(np.array([True, False, True, False]))
    assert mechanism.is_locked(everything)
    assert not mechanism.is_locked(np.array([True, True, False, True]))
    assert mechanism.is_locked(np.array([False, True, True, False]))
    mechanism.factor = factor[:1]  # of another state: nothing is remembered that is not so
    assert mechanism.is_locked(np.array([True, False, False, False]))


@pytest.mark.usefixtures("interpreted_kernels")
@pytest.mark.parametrize("free", [0.02, -0.02, 6.0, -6.0])
@pytest.mark.parametrize("seed", range(6))
def test_joints_that_move_together_use_equal_shares_of_their_limits(seed, free):
    """0 and 1 are one motion: x_k = -t limit_k(x) sign(A_k). 2 is alone, 3 cannot move at all."""
    rng = np.random.default_rng(seed)
    p = random_problem(seed, nc=4, strength=0.05)
    A = np.array([[1.0, rng.choice([-2.0, 0.5]), 0.0, 0.0], [0.0, 0.0, 3.0, 0.0]])
    push = np.array([rng.choice([-0.3, 0.3, -9.0, 9.0]), free])
    p.rate_free[:], p.rate_slope[:] = A.T @ push, A.T @ A
    p.rate_scale[:] = np.abs(p.rate_free)
    m, none = Modes.of(4, 4), np.zeros(4, dtype=bool)
    m.at_rest[:] = m.stuck[:] = True
    mechanism = Mechanism(True, A, np.arange(4), none, none, np.zeros(4))
    found, obeying = solve_modes(p, m, mechanism)
    load = plain_loads(p, m.friction)
    lower, upper = plain_limits(p, load)
    np.testing.assert_allclose(m.load, load, rtol=1e-12)
    np.testing.assert_allclose(m.rate, 0.0, atol=1e-9)
    assert m.friction[2] == pytest.approx(-free / 3.0, rel=1e-9)
    assert m.friction[3] == 0.0
    use = np.abs(m.friction) / np.where(m.friction > 0.0, upper, -lower)
    assert use[0] == pytest.approx(use[1], rel=1e-5)
    np.testing.assert_array_equal(np.sign(m.friction[:2]), -np.sign(push[0] * A[0, :2]))
    breaks = use > 1.0
    assert (found, obeying) == (1, int(not breaks.any()))
    np.testing.assert_array_equal(m.verdict, np.where(breaks, np.sign(p.rate_free), 0.0))


@pytest.mark.usefixtures("interpreted_kernels")
def test_a_joint_that_cannot_move_needs_no_friction():
    p, A = random_problem(0, nc=2, strength=0.0), np.array([[1.0, 0.0]])
    p.rate_free[:], p.rate_slope[:] = [0.5, 0.0], A.T @ A
    m, none = Modes.of(2, 2), np.zeros(2, dtype=bool)
    m.stuck[:], m.at_rest[:], m.direction[:] = (False, True), (False, True), (1.0, 0.0)
    assert solve_modes(p, m, Mechanism(True, A, np.arange(2), none, none, np.zeros(2))) == (1, 1)
    assert m.friction[0] == pytest.approx(-p.coulomb_slip[0, 0])
    assert m.friction[1] == 0.0


@pytest.mark.usefixtures("interpreted_kernels")
def test_what_rests_together_sticks_where_any_friction_holds():
    """Two pins, one freedom: a grid finds the frictions that a search from one start misses."""
    rng, seen = np.random.default_rng(3), set()
    for _ in range(60):
        p, A = two_that_share(rng, contact=3.0)
        m, none = Modes.of(2, 2), np.zeros(2, dtype=bool)
        m.at_rest[:] = m.stuck[:] = True
        _, obeying = solve_modes(p, m, Mechanism(True, A, np.arange(2), none, none, np.zeros(2)))
        seen.add(obeying)
        if obeying:
            lower, upper = plain_limits(p, plain_loads(p, m.friction))
            np.testing.assert_allclose(p.rate_free + p.rate_slope @ m.friction, 0.0, atol=1e-9)
            assert (m.friction <= upper + 1e-9).all()
            assert (m.friction >= lower - 1e-9).all()
        else:
            assert grid_use(p, A, (0.2, 1.0, 30.0), 2001) > 1.0 - 1e-3
    assert seen == {0, 1}


def test_what_a_ball_s_coordinates_have_is_had_by_its_joint():
    """Coordinates 1 to 3 are a ball: its rates 3, 4, 12 are a speed of 13."""
    block, ball = np.array([0, 1, 1, 1]), np.array([False, True, True, True])
    mechanism = Mechanism(True, np.eye(4), block, ball, np.zeros(4, bool), np.zeros(4))
    np.testing.assert_allclose(mechanism.speeds(np.array([-2.0, 3.0, 4.0, -12.0])), [2, 13, 13, 13])
    parts = np.array([[5.0, 1.0, 2.0, 4.0], [6.0, 1.0, 1.0, 1.0]])
    np.testing.assert_array_equal(mechanism.summed(parts), [[5, 7, 7, 7], [6, 3, 3, 3]])
    np.testing.assert_array_equal(mechanism.summed(parts[0]), [5, 7, 7, 7])
    modes = Modes.of(4, 4)
    modes.direction[:] = [1.0, 0.5, 0.5, 0.5]
    slips = mechanism.slip_direction(modes, np.array([9.0, 3.0, 4.0, -12.0]))
    np.testing.assert_allclose(slips, [1.0, 3 / 13, 4 / 13, -12 / 13])


@pytest.mark.usefixtures("interpreted_kernels")
def test_a_gear_whose_line_cancels_its_rotor_has_no_solution_in_these_modes():
    """-x + 2 r = 10 with r = 1 + x/2 is 2 = 10: no x obeys it."""
    p = empty_problem(np.zeros(1, int), np.ones(1), np.zeros(0, int), np.zeros(1), gears=1)
    p.rate_free[:], p.rate_slope[:], p.rate_scale[:] = 1.0, 0.5, 1.0
    p.gear_rotor[:], p.gear_lines[..., 0], p.gear_lines[..., 2] = (5.0, 1.0), -1.0, -np.inf
    none = np.zeros(1, dtype=bool)
    for closed in (False, True):
        m = Modes.of(1, 1, 1)
        m.direction[:] = 1.0
        mechanism = Mechanism(closed, np.sqrt(p.rate_slope), np.arange(1), none, none, np.zeros(1))
        assert solve_modes(p, m, mechanism) == (0, 0)


@pytest.mark.parametrize("seed", [*range(30), 60, 66, 203, 241])
def test_beside_what_slips_friction_holds_where_a_linear_program_finds_some(seed):
    """Three coordinates at rest of two freedoms; limits differ by direction, one follows a load."""
    rng = np.random.default_rng(seed)
    A, push = rng.normal(size=(3, 4)), rng.normal(scale=3.0, size=3)
    A[2, :3] = 0.0
    p = empty_problem(np.arange(4), np.ones(4), np.array([1]), np.zeros(4))
    p.rate_slope[:], p.rate_free[:] = A.T @ A, A.T @ push
    p.rate_scale[:] = np.abs(p.rate_free)
    p.coulomb_slip[3], way = rng.uniform(0.5, 2.0), rng.choice([-1.0, 1.0])
    p.contact[0, 0, 0], p.contact[0, 4, 0], p.mu_stick[1] = 1.0, rng.uniform(0.5, 2.0), 0.8
    p.coulomb_stick[0], p.coulomb_stick[2] = rng.permutation([[1.0, np.inf], [np.inf, 0.5]])
    m = Modes.of(4, 4)
    m.stuck[:3] = m.at_rest[:3] = True
    m.direction[3] = way
    none = np.zeros(4, dtype=bool)
    mechanism = Mechanism(True, A, np.arange(4), none, none, np.zeros(4))
    slip = -way * p.coulomb_slip[3, 0]
    limit = 0.8 * abs(1.0 + p.contact[0, 4, 0] * slip)
    bounds = [(-p.coulomb_stick[0, 0], p.coulomb_stick[0, 1]), (-limit, limit)]
    bounds += [(-p.coulomb_stick[2, 0], p.coulomb_stick[2, 1])]
    there = linprog(np.zeros(3), A_eq=A[:2, :3], b_eq=-push[:2] - A[:2, 3] * slip, bounds=bounds)
    held = solve_modes(p, m, mechanism)[1] == 1
    assert held == (there.status == 0)
    if held:
        np.testing.assert_allclose(m.rate[:3], 0.0, atol=1e-11)
        assert m.friction[3] == pytest.approx(slip)
        for x, (low, high) in zip(m.friction, bounds, strict=False):
            assert low - 1e-9 <= x <= high + 1e-9
