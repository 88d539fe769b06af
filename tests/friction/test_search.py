"""The search for modes against brute force, and its order of preference."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from friction_cases import (
    a_tree,
    plain_limits,
    plain_loads,
    plain_solve,
    random_problem,
)
from scipy.optimize import brentq, lsq_linear

from pinfric.friction import search
from pinfric.friction import tree as search_tree
from pinfric.friction.given_modes import judge
from pinfric.friction.law import evaluate
from pinfric.friction.problem import Modes, SearchOutcome
from pinfric.friction.rest import Mechanism, solve_modes
from pinfric.friction.search import PossibleWays
from pinfric.friction.tree import Tree

pytestmark = pytest.mark.usefixtures("interpreted_kernels")


def brute_force(p, at_rest):
    """Every mode of the coordinates at rest, by SciPy; the consistent ones with fewest slipping."""
    return next(filter(None, by_level(p, at_rest)), [])


def by_level(p, at_rest):
    """The consistent modes with 0, 1, ... slipping coordinates."""
    nc = len(at_rest)
    free = np.flatnonzero(at_rest)
    for level in range(len(free) + 1):
        found = []
        for choice in itertools.product((0.0, 1.0, -1.0), repeat=len(free)):
            if np.count_nonzero(choice) != level:
                continue
            direction = np.ones(nc)
            direction[free] = choice
            stuck = at_rest & (direction == 0)
            x = plain_solve(p, stuck, direction)
            if x is None:
                continue
            load = plain_loads(p, x)
            lower, upper = plain_limits(p, load)
            rate = p.rate_free + p.rate_slope @ x
            holds = (x >= lower - 1e-9) & (x <= upper + 1e-9)
            slips = direction * rate >= -1e-9
            if np.where(stuck, holds, slips | ~at_rest).all():
                found.append((direction, x))
        yield found


@pytest.mark.parametrize("seed", range(40))
def test_the_search_finds_what_brute_force_finds(seed):
    p = random_problem(seed, nc=4, strength=0.1, shared=bool(seed % 2), static=1 + 0.4 * (seed % 3))
    if seed % 4 == 0:
        p.rate_free[:] *= 0.1  # more of them stick
    at_rest = np.ones(4, bool)
    at_rest[0] = seed % 5 != 0
    expected = brute_force(p, at_rest)
    m = Modes.of(4, len(p.ratio))
    m.at_rest[:], m.direction[:] = at_rest, 1.0
    status = search.search(p, m, a_tree(len(m.stuck)))
    assert (
        status
        == (SearchOutcome.NONE, SearchOutcome.SOLVED, SearchOutcome.AMBIGUOUS)[
            min(len(expected), 2)
        ]
    )
    if status == SearchOutcome.SOLVED:
        np.testing.assert_array_equal(m.direction, expected[0][0])
        np.testing.assert_allclose(m.friction, expected[0][1], rtol=1e-7, atol=1e-8)


def test_the_random_problems_have_every_number_of_slipping_coordinates():
    """The test above covers all stick to all slip."""
    levels = set()
    for seed in range(40):
        p = random_problem(seed, strength=0.1, static=1 + 0.4 * (seed % 3))
        p.rate_free[:] *= 0.1 if seed % 4 == 0 else 1.0
        m = Modes.of(4, 4)
        m.at_rest[:] = True
        if search.search(p, m, a_tree(len(m.stuck))) == SearchOutcome.SOLVED:
            levels.add(int(np.count_nonzero(m.direction)))
    assert levels == {0, 1, 2, 3, 4}


@pytest.mark.parametrize("seed", range(15))
def test_pivoting_beyond_eight_finds_consistent_modes(seed):
    p = random_problem(seed, nc=10, strength=0.03, static=1.0)
    m = Modes.of(10, 10)
    m.at_rest[:] = True
    assert search.search(p, m, a_tree(len(m.stuck))) == SearchOutcome.SOLVED
    evaluate(p, m.friction, m.load, m.rate)
    assert judge(p, m) == 0
    if seed < 3:  # static = kinetic and weak coupling: the answer is the only one
        other = Modes.of(10, 10)
        other.at_rest[:] = True
        # enumeration of 3^10 is long: one level below where the pivoting ended
        level = int(np.count_nonzero(m.direction))
        kinematics = PossibleWays(p, a_tree(10), other.at_rest)
        for ways in kinematics.ways(list(range(10)), level - 1, {}) if 0 < level < 4 else ():
            search._stick(other, a_tree(10), ways)
            assert solve_modes(p, other, a_tree(10))[1] == 0


@pytest.mark.parametrize("seed", range(60))
def test_no_program_refutes_an_answer(seed):
    """Against all modes: weak, strong and such that feeds itself; with joints that move."""
    strength, static = (0.02, 0.1, 0.3, 0.8)[seed % 4], (1.0, 1.4)[seed % 2]
    p = random_problem(seed, nc=4, strength=strength, shared=bool(seed % 3), static=static)
    p.rate_free[:] *= (0.3, 1.0)[seed % 5 == 0]
    at_rest = np.arange(4) >= (seed % 7 == 0)
    tree = Tree(p, at_rest, np.ones(4))
    if not tree.ends:
        assert not at_rest.all()  # of what rests a box is always known
        return
    leaves = [ways for level in tree.levels({}) for ways in level]
    assert tree.complete
    answers = [
        {c: way for c, way in enumerate(direction.tolist()) if at_rest[c] and way}
        for found in by_level(p, at_rest)
        for direction, _ in found
    ]
    assert answers
    assert all(answer in leaves for answer in answers)
    assert [len(ways) for ways in leaves] == sorted(len(ways) for ways in leaves)


def test_programs_refute_most_modes():
    """Of 81 modes of four joints a few are left, or the tree would be no shorter."""
    left = []
    for seed in range(20):
        p = random_problem(seed, nc=4, strength=0.1)
        left.append(sum(map(len, Tree(p, np.ones(4, bool), np.ones(4)).levels({}))))
    assert np.median(left) <= 4


def test_joints_that_must_slip_do():
    p = random_problem(3, nc=4, strength=0.1)
    p.rate_free[:] *= 0.3
    for level in Tree(p, np.ones(4, bool), np.ones(4)).levels({1: -1.0}):
        assert all(ways[1] == -1.0 for ways in level)


def test_of_too_many_modes_some_are_not_looked_at(monkeypatch):
    monkeypatch.setattr(search_tree, "_MOST_PROGRAMS", 5)
    tree = Tree(random_problem(3, nc=4, strength=0.1), np.ones(4, bool), np.ones(4))
    assert not [ways for level in tree.levels({}) for ways in level]
    assert not tree.complete


@pytest.mark.parametrize("seed", range(4))  # alone, 1 and 2 would find what is no answer
def test_what_only_loads_couple_is_searched_together(seed, monkeypatch):
    """Two pairs with a rate each; loads depend on both frictions of a pair."""
    monkeypatch.setattr(search, "MOST_ENUMERATED", 2)
    p = random_problem(seed, strength=0.2, static=1.4)
    pair = np.arange(4) // 2
    p.rate_free[:] *= 2.0
    p.rate_slope[:] *= np.eye(4)
    p.contact[:, 1:] *= (pair[:, None] == pair[p.coordinate[p.contact_entry], None, None]) * 1.0
    expected = brute_force(p, np.ones(4, bool))
    m = Modes.of(4, 4)
    m.at_rest[:] = True
    status = search.search(p, m, a_tree(4))
    assert (
        status
        == (SearchOutcome.NONE, SearchOutcome.SOLVED, SearchOutcome.AMBIGUOUS)[
            min(len(expected), 2)
        ]
    )
    if status == SearchOutcome.SOLVED:
        np.testing.assert_allclose(m.friction, expected[0][1], rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("seed", [6, 47, 56, 66, 77, 85])
def test_where_changing_all_at_once_turns_in_a_circle_the_solution_is_found(seed):
    """Against the bounded least squares whose solution it is: constant limits, rates S x + r."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(10, 5))
    S, r = A @ A.T + 1e-3 * np.eye(10), 3.0 * rng.normal(size=10)
    p = random_problem(seed, nc=10, strength=0.0)
    limit = rng.uniform(0.05, 1.0, 10)
    p.rate_slope[:], p.rate_free[:], p.rate_scale[:] = S, r, np.abs(r)
    p.coulomb_stick[:] = p.coulomb_slip[:] = limit[:, None]
    m = Modes.of(10, 10)
    m.at_rest[:] = True
    assert search.search(p, m, a_tree(10)) == SearchOutcome.SOLVED
    L = np.linalg.cholesky(S)
    least = lsq_linear(L.T, -np.linalg.solve(L, r), (-limit, limit), method="bvls", tol=1e-14)
    np.testing.assert_allclose(m.friction, least.x, atol=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_a_ball_slips_against_the_effort_on_it(seed, monkeypatch):
    """Least 1/2 x S x + r x in the sphere |x| <= L: x = -(S + g 1)^-1 r, |x| = L or g = 0."""
    rng = np.random.default_rng(seed)
    A, r = rng.normal(size=(3, 3)) + 2.0 * np.eye(3), rng.normal(size=3)
    S = A.T @ A

    def beside(g):
        return -np.linalg.solve(S + g * np.eye(3), r)

    held, solves, plain = float(np.linalg.norm(beside(0.0))), [], search.solve_modes

    def counted(*given, **options):
        solves.append(1)
        return plain(*given, **options)

    monkeypatch.setattr(search, "solve_modes", counted)
    p = random_problem(seed, nc=3, strength=0.0)
    p.rate_slope[:], p.rate_free[:], p.rate_scale[:] = S, r, np.abs(r)
    ball, none = np.ones(3, bool), np.zeros(3, bool)
    for limit in (1.1 * held, 0.9 * held, 0.01 * held):
        p.coulomb_stick[:] = p.coulomb_slip[:] = limit
        m = Modes.of(3, 3)
        m.at_rest[:] = True
        mechanism = Mechanism(True, A, np.zeros(3, int), ball, none, np.zeros(3))
        assert search.search(p, m, mechanism) == SearchOutcome.SOLVED
        g = 0.0
        if limit < held:
            g = brentq(
                lambda g, limit: np.linalg.norm(beside(g)) - limit, 0.0, 1e9, (limit,), 1e-14
            )
        np.testing.assert_allclose(m.friction, beside(g), atol=1e-6 * limit)
        assert len(solves) < 30  # it stops where the ball turns no more
        solves.clear()


def test_what_is_forced_to_slip_slips_even_where_stick_is_admissible():
    p = random_problem(1, nc=1, strength=0.0)
    p.coulomb_slip[:], p.coulomb_stick[:] = 1.0, 1.0
    p.rate_slope[:], p.rate_free[:], p.rate_scale[:] = 1.0, 1.0, 1.0  # exactly at the limit
    m = Modes.of(1, 1)
    m.at_rest[:] = True
    assert search.search(p, m, a_tree(len(m.stuck))) == SearchOutcome.SOLVED
    assert m.stuck[0]
    assert search.search(p, m, a_tree(len(m.stuck)), {0: 1.0}) == SearchOutcome.SOLVED
    assert m.direction[0] == 1.0
    p.rate_free[:] = 0.5  # the slip would go backward
    assert search.search(p, m, a_tree(len(m.stuck)), {0: 1.0}) == SearchOutcome.NONE


def test_what_was_sticking_decides_between_equally_few_slipping():
    p = random_problem(14, nc=3, strength=0.1, static=1.8)
    at_rest = np.ones(3, bool)
    choices = [direction.tolist() for direction, _ in brute_force(p, at_rest)]
    assert choices == [[0, 0, -1], [0, 1, 0], [-1, 0, 0]]
    m = Modes.of(3, 3)
    m.at_rest[:] = True
    assert search.search(p, m, a_tree(len(m.stuck))) == SearchOutcome.AMBIGUOUS
    assert (
        search.search(p, m, a_tree(len(m.stuck)), held=np.array([True, True, False]))
        == SearchOutcome.SOLVED
    )
    assert m.direction.tolist() == [0, 0, -1]
    assert (
        search.search(p, m, a_tree(len(m.stuck)), held=np.array([True, False, False]))
        == SearchOutcome.AMBIGUOUS
    )
    assert (
        search.search(p, m, a_tree(len(m.stuck)), held=np.ones(3, bool)) == SearchOutcome.AMBIGUOUS
    )


def test_a_joint_at_its_dead_centre_moves_on_with_what_moves():
    """Its rate does not depend on any friction, so it does not rest, and nothing is tried."""
    p, c = random_problem(0, nc=2, strength=0.0), 0.4
    p.coulomb_slip[:] = p.coulomb_stick[:] = c
    A, none = np.array([[1.5, 0.0]]), np.zeros(2, bool)
    p.rate_slope[:], p.rate_free[:], p.rate_scale[:] = A.T @ A, (2.0, -0.5), (2.0, 0.5)
    m, count = Modes.of(2, 2), search.SearchStatistics()
    m.direction[0], m.at_rest[1] = 1.0, True
    crank = Mechanism(True, A, np.arange(2), none, np.array([False, True]), np.zeros(2))
    assert search.search(p, m, crank, count=count) == SearchOutcome.SOLVED
    assert count.tried == 1
    assert not m.at_rest.any()
    assert m.direction.tolist() == [1.0, -1.0]
    np.testing.assert_allclose(m.friction, [-c, c])
    np.testing.assert_allclose(m.rate, [2.0 - 1.5**2 * c, -0.5])


def test_a_search_that_runs_out_of_passes_is_followed_to_a_solution_or_undecided(monkeypatch):
    """Enumeration of 3^7 modes reaches its limit; block pivoting needs a few passes more."""
    p = random_problem(0, nc=7, strength=0.03, static=1.0)
    ended = []
    for passes in (1, 8, 10**6):
        monkeypatch.setattr(search, "MOST_PASSES", passes)
        m = Modes.of(7, 7)
        m.at_rest[:] = True
        ended.append((search.search(p, m, a_tree(7)), m.direction.tolist()))
    assert [found for found, _ in ended] == [
        SearchOutcome.UNDECIDED,
        SearchOutcome.SOLVED,
        SearchOutcome.SOLVED,
    ]
    assert ended[1][1] == ended[2][1]
    assert np.count_nonzero(ended[1][1]) > 1  # beyond what 8 passes enumerate


@pytest.mark.parametrize("worth", [(-1, 0), (0, 0)])
def test_an_answer_that_does_not_come_again_is_none(worth, monkeypatch):
    """The kept modes are solved again at the end, and that may fail."""
    p = random_problem(3, nc=2, strength=0.05, static=1.0)  # so few are tried
    m, mechanism = Modes.of(2, 2), a_tree(2)
    m.at_rest[:] = True
    tried = {}

    def settle(problem, modes, mechanism, chosen=False):
        key = m.direction.tobytes()
        tried[key] = tried.get(key, 0) + 1
        if tried[key] == 1:
            return solve_modes(problem, modes, mechanism, chosen)
        m.friction[:] = np.nan
        return worth

    monkeypatch.setattr(search, "solve_modes", settle)
    assert search.search(p, m, mechanism) == SearchOutcome.UNDECIDED


def test_what_is_not_a_number_obeys_no_law():
    p = random_problem(3, nc=2, strength=0.05)
    m = Modes.of(2, 2)
    m.at_rest[:], m.stuck[:], m.friction[:] = True, [True, False], np.nan
    evaluate(p, m.friction, m.load, m.rate)
    assert judge(p, m) == 2
