"""Several solutions: all are found, or the search reports that it ended."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from friction_cases import (
    NO_GEARS,
    a_tree,
    plain_limits,
    plain_loads,
    plain_slip_friction,
    random_problem,
    solved,
    strong_problem,
)
from scipy.optimize import root

from pinfric.friction import search
from pinfric.friction.problem import Modes, SearchOutcome, empty_problem
from pinfric.friction.rest import Mechanism
from pinfric.friction.several import find_all

pytestmark = pytest.mark.usefixtures("interpreted_kernels")


def by_signs(p, direction):
    """All frictions of two coordinates whose contact forces lie on a line: |p| = +-p; 0 sticks."""
    weight = -direction[p.contact_entry] * p.mu_slip[p.contact_entry]
    found = []
    for signs in itertools.product((1.0, -1.0), repeat=len(weight)):
        A, b = np.eye(2), -direction * p.coulomb_slip[:, 0]
        for t, sign in enumerate(signs):
            A[p.contact_entry[t]] -= weight[t] * sign * p.contact[t, 1:, 0]
            b[p.contact_entry[t]] += weight[t] * sign * p.contact[t, 0, 0]
        sticks = direction == 0.0
        A[sticks], b[sticks] = p.rate_slope[sticks], -p.rate_free[sticks]
        x = np.linalg.solve(A, b)
        if (np.array(signs) * (p.contact[:, 0, 0] + p.contact[:, 1:, 0] @ x) >= 0.0).all():
            found.append(x)
    return found


@pytest.mark.parametrize("seed", [*range(12), 129, 220, 568, 628, 647, 1421])
def test_no_solution_is_left_out_where_forces_lie_on_a_line(seed):
    """Up to six: each sign of each force is one linear system, and all are solved."""
    p, direction = strong_problem(seed, along=1)
    expected = by_signs(p, direction)
    m = Modes.of(2, 2)
    m.direction[:] = direction
    found, parts, complete = find_all(p, m.stuck, m.direction, NO_GEARS)
    assert complete
    assert 0 < parts < 1000
    order = np.lexsort(np.array(expected).reshape(-1, 2).T)
    np.testing.assert_allclose(
        np.array(found).reshape(-1, 2)[np.lexsort(np.array(found).reshape(-1, 2).T)],
        np.array(expected).reshape(-1, 2)[order],
        rtol=1e-9,
    )
    if solved(p, m.stuck, direction)[1].figures[0] >= 1.0:
        status = search.search(p, m, a_tree(2))
        assert (
            status
            == (SearchOutcome.NONE, SearchOutcome.SOLVED, SearchOutcome.AMBIGUOUS)[
                min(len(expected), 2)
            ]
        )


def accelerations(p):
    """Distinct rates of two coordinates at rest, forces on lines, with the fewest that slip."""
    for level in range(3):
        rates: list[np.ndarray] = []
        for direction in itertools.product((0.0, 1.0, -1.0), repeat=2):
            way = np.array(direction)
            if np.count_nonzero(way) != level:
                continue
            for x in by_signs(p, way):
                rate = p.rate_free + p.rate_slope @ x
                lower, upper = plain_limits(p, plain_loads(p, x))
                sticks = (x >= lower - 1e-9) & (x <= upper + 1e-9)
                obeys = np.where(way == 0.0, sticks, way * rate >= -1e-9).all()
                if obeys and not any(np.allclose(rate, other, atol=1e-6) for other in rates):
                    rates.append(rate)
        if rates:
            return rates
    return []


@pytest.mark.parametrize("seed", [*range(12), 129, 220, 568, 628, 647, 1421])
def test_of_several_solutions_those_that_start_against_their_friction_count(seed):
    """Both coordinates rest: every sign of every force in every mode is one linear system."""
    p, _ = strong_problem(seed, along=1)
    p.rate_scale[:] = np.abs(p.rate_free)
    expected = accelerations(p)
    m = Modes.of(2, 2)
    m.at_rest[:] = True
    status = search.search(p, m, a_tree(2))
    assert (
        status
        == (SearchOutcome.NONE, SearchOutcome.SOLVED, SearchOutcome.AMBIGUOUS)[
            min(len(expected), 2)
        ]
    )
    if status == SearchOutcome.SOLVED:
        np.testing.assert_allclose(m.rate, expected[0], atol=1e-8)
        np.testing.assert_allclose(m.load, plain_loads(p, m.friction), rtol=1e-12)


def plane_problem(seed):
    """Two sliding sites whose forces lie in a plane."""
    rng = np.random.default_rng(seed)
    p = random_problem(seed, nc=2, strength=float(rng.uniform(0.1, 0.5)))
    p.constant[:], p.coulomb_slip[:] = 0.0, rng.uniform(0, 0.3) * (seed % 2)
    p.contact[:, 0, 2], p.contact[:, 1:, 2] = 0.0, 0.0
    return p, rng.choice([-1.0, 1.0], 2)


@pytest.mark.parametrize("seed", [644, 1039])
def test_a_second_solution_far_from_the_first_makes_it_ambiguous(seed):
    """Newton's method from rest, and from far out on every side, finds only one of the two."""
    p, direction = plane_problem(seed)
    (found, _), m = solved(p, np.zeros(2, bool), direction)
    assert found == 1
    assert m.figures[0] > 1.0
    every = find_all(p, m.stuck, m.direction, NO_GEARS).solutions
    assert len(every) == 2
    for x in every:
        np.testing.assert_allclose(
            x, plain_slip_friction(p, direction, plain_loads(p, x)), rtol=1e-10
        )
    m = Modes.of(2, 2)
    m.direction[:] = direction
    assert search.search(p, m, a_tree(2)) == SearchOutcome.AMBIGUOUS
    m = Modes.of(2, 2)  # a step of a motion goes on with the first that it finds
    m.direction[:] = direction
    assert search.search(p, m, a_tree(2), follow=True) == SearchOutcome.SOLVED


@pytest.mark.parametrize("seed", [613, 644, 1039])
def test_of_two_solutions_in_the_same_modes_those_that_move_so_count(seed):
    """Efforts such that the first, then the second solution starts in the direction of its slip."""
    p, direction = plane_problem(seed)
    every = find_all(p, np.zeros(2, bool), direction, NO_GEARS).solutions
    for x in every:
        p.rate_free[:] = 0.1 * direction - p.rate_slope @ x
        p.rate_scale[:] = np.abs(p.rate_free)
        rates = [p.rate_free + p.rate_slope @ other for other in every]
        expected = [rate for rate in rates if (direction * rate >= 0.0).all()]
        m = Modes.of(2, 2)
        m.at_rest[:] = True
        status = search.search(p, m, a_tree(2), dict(enumerate(direction)))
        assert (
            status
            == (SearchOutcome.NONE, SearchOutcome.SOLVED, SearchOutcome.AMBIGUOUS)[len(expected)]
        )
        if status == SearchOutcome.SOLVED:
            np.testing.assert_allclose(m.rate, expected[0], rtol=1e-6)
            np.testing.assert_allclose(m.load, plain_loads(p, m.friction), rtol=1e-12)


@pytest.mark.parametrize("seed", [*range(8), 613, 644, 1039])
def test_no_solution_is_left_out_where_forces_turn_in_a_plane(seed):
    """Whatever SciPy finds from 60 starts on every scale is among them."""
    p, direction = plane_problem(seed)
    every = find_all(p, np.zeros(2, bool), direction, NO_GEARS)
    assert every.complete
    rng = np.random.default_rng(seed)

    def left(x):
        return x - plain_slip_friction(p, direction, plain_loads(p, x))

    for _ in range(60):
        found = root(left, rng.normal(size=2) * 10.0 ** rng.uniform(-1, 3), tol=1e-13)
        if np.abs(left(found.x)).max() < 1e-10 * np.abs(found.x).max():
            assert any(np.allclose(found.x, x, rtol=1e-6) for x in every.solutions)
    for x in every.solutions:
        np.testing.assert_allclose(left(x), 0.0, atol=1e-9 * np.abs(x).max())


@pytest.mark.parametrize("seed", [644, 1039])
def test_a_search_for_all_solutions_that_ends_at_its_bound_is_undecided(seed, monkeypatch):
    p, direction = plane_problem(seed)
    m = Modes.of(2, 2)
    m.direction[:] = direction
    monkeypatch.setattr("pinfric.friction.several.MOST_PARTS", 2)
    found = find_all(p, m.stuck, m.direction, NO_GEARS)
    assert found.complete is False
    assert search.search(p, m, a_tree(2)) == SearchOutcome.UNDECIDED


@pytest.mark.parametrize("seed", [644, 1039])
def test_a_step_that_lets_all_stick_goes_on_with_the_first_of_several_too(seed):
    """Beside two that slide, a third rests; x = -|1 - 2 x|, as it would slip forward, has no root.

    So the step begins anew with it at rest, where 0.1 + x = 0.
    """
    two, direction = plane_problem(seed)
    p = empty_problem(np.arange(3), np.ones(3), np.r_[two.contact_entry, 2], np.zeros(3))
    for whole, part in (
        (p.rate_slope[:2, :2], two.rate_slope),
        (p.rate_free[:2], two.rate_free),
        (p.contact[:-1, :3], two.contact),
        (p.mu_slip[:2], two.mu_slip),
        (p.coulomb_slip[:2], two.coulomb_slip),
    ):
        whole[:] = part
    p.rate_slope[2, 2], p.rate_free[2], p.rate_scale[:] = 1.0, 0.1, np.abs(p.rate_free)
    p.contact[-1, 0, 0], p.contact[-1, 3, 0] = 1.0, -2.0
    p.mu_slip[2] = p.mu_stick[2] = 1.0
    none, A = np.zeros(3, bool), np.linalg.cholesky(p.rate_slope).T
    m, count = Modes.of(3, 3), search.SearchStatistics()
    m.direction[:], m.at_rest[2] = [*direction, 1.0], True
    loop = Mechanism(True, A, np.arange(3), none, none, np.zeros(3))
    assert search.search(p, m, loop, count=count, follow=True) == SearchOutcome.SOLVED
    assert m.stuck.tolist() == [False, False, True]
    assert m.friction[2] == pytest.approx(-0.1)
    every = find_all(two, np.zeros(2, bool), direction, NO_GEARS).solutions
    assert len(every) == 2
    assert any(np.allclose(m.friction[:2], x, rtol=1e-9) for x in every)


def test_what_has_to_obey_its_law_is_found_in_fewer_parts():
    """All solutions, those that obey by plain formulas, and the search for these alone."""
    every_parts, parts, obeying = 0, 0, 0
    for seed in range(40):
        rng = np.random.default_rng([8, seed])
        p = random_problem(seed, nc=3, strength=float(rng.uniform(0.1, 0.4)), static=1.3)
        way = rng.choice([-1.0, 0.0, 1.0], 3, p=[0.4, 0.2, 0.4])
        every = find_all(p, way == 0.0, way, NO_GEARS)
        if every.solutions and way.all():  # efforts under which one of them moves as it slips
            x = every.solutions[seed % len(every.solutions)]
            p.rate_free[:] = way * rng.uniform(0.0, 3.0, 3) - p.rate_slope @ x
            p.rate_scale[:] = np.abs(p.rate_free)
        some = find_all(p, way == 0.0, way, NO_GEARS, np.ones(3, dtype=bool))
        if every.complete is not True:
            continue
        assert some.complete
        every_parts, parts = every_parts + every.parts, parts + some.parts
        for x in every.solutions:
            least, most = plain_limits(p, plain_loads(p, x))
            rate = p.rate_free + p.rate_slope @ x
            holds = (least <= x) & (x <= most)
            if np.where(way == 0.0, holds, way * rate >= 0.0).all():
                obeying += 1
                assert any(np.allclose(x, other, rtol=1e-9) for other in some.solutions)
    assert parts < 0.9 * every_parts
    assert obeying > 5
