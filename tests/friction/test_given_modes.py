"""The coupled friction problem: its kernels against plain NumPy, its search against brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from builders import random_friction, random_tree
from scipy.optimize import linprog, root

import pinfric as pf
from pinfric.dynamics.judge.plain_laws import plain_normal_load
from pinfric.friction import dense, search
from pinfric.friction import given_modes as coupling
from pinfric.friction.consistency import SHOULD_STICK, evaluate, judge, site_friction
from pinfric.friction.law import stick_limits
from pinfric.friction.modes import Found, Modes
from pinfric.friction.problem import Problem, empty_problem
from pinfric.friction.rest import Mechanism, solve
from pinfric.friction.several import find_all
from pinfric.friction.ways import Kinematics
from pinfric.kernels import interpreted


@pytest.fixture(autouse=True)
def _interpreted(monkeypatch):
    """For tuples of arrays they would be compiled anew, 30 s: forward dynamics takes records.

    That both forms agree is tested in `dynamics/problem/test_instant.py`.
    """
    monkeypatch.setattr(interpreted, "PATIENCE", np.inf)


def random_problem(seed, nc=4, strength=0.15, shared=False, static=1.2) -> Problem:
    """A coupled problem of the kind a robot makes; `shared`: two sites on coordinate 0."""
    rng = np.random.default_rng(seed)
    shared = int(shared)
    ns = nc + shared
    coordinate = np.r_[np.arange(nc), np.zeros(shared, dtype=int)].astype(np.int64)
    ratio = np.r_[np.ones(nc), -np.ones(shared) * 0.7]
    contact_site = np.sort(np.r_[np.arange(ns), rng.integers(0, ns, size=nc)]).astype(np.int64)
    p = empty_problem(coordinate, ratio, contact_site, rng.uniform(0, 0.5, ns))
    A = rng.normal(size=(nc, nc))
    p.rate_slope[:] = A @ A.T + 0.3 * np.eye(nc)
    p.rate_free[:] = rng.normal(scale=3.0, size=nc)
    p.rate_scale[:] = np.abs(p.rate_free)
    p.contact[:, 0] = rng.normal(size=p.contact[:, 0].shape) * 2
    p.contact[:, 1:] = rng.normal(size=p.contact[:, 1:].shape)
    p.mu_slip[:] = strength * rng.uniform(0.5, 1.0, ns)
    p.mu_stick[:] = static * p.mu_slip
    p.coulomb_slip[:] = rng.uniform(0, 0.3, (ns, 2))
    p.coulomb_stick[:] = static * p.coulomb_slip
    p.drag[:] = 0.0
    return p


def plain_loads(p, x):
    forces = p.contact[:, 0] + np.einsum("tce,c->te", p.contact[:, 1:], x)
    load = p.constant.copy()
    np.add.at(load, p.contact_site, np.linalg.norm(forces, axis=1))
    return load


def plain_slip_friction(p, direction, load):
    """The slip law, written out per site and summed."""
    x = np.zeros(len(direction))
    for s, c in enumerate(p.coordinate):
        along = np.sign(p.ratio[s]) * direction[c]
        dry = p.mu_slip[s] * load[s] + p.coulomb_slip[s, 0 if along > 0 else 1]
        x[c] += p.ratio[s] * (-along * dry - p.drag[s])
    return x


def plain_limits(p, load):
    lower, upper = np.zeros(len(p.rate_free)), np.zeros(len(p.rate_free))
    for s, c in enumerate(p.coordinate):
        ends = [
            p.ratio[s] * -(p.mu_stick[s] * load[s] + p.coulomb_stick[s, 0]),
            p.ratio[s] * (p.mu_stick[s] * load[s] + p.coulomb_stick[s, 1]),
        ]
        lower[c] += min(ends)
        upper[c] += max(ends)
    return lower, upper


def plain_solve(p, stuck, direction):
    """Friction in given modes by SciPy, all unknowns at once; None where it fails."""

    def equations(x):
        slip = x - plain_slip_friction(p, direction, plain_loads(p, x))
        return np.where(stuck, p.rate_free + p.rate_slope @ x, slip)

    found = root(equations, np.zeros(len(stuck)), method="hybr", options={"xtol": 1e-13})
    return found.x if np.abs(equations(found.x)).max() < 1e-9 else None


def a_tree(nc):
    """Coordinates that do not depend on each other."""
    none = np.zeros(nc, dtype=bool)
    return Mechanism(False, np.eye(nc), np.arange(nc), none, none, np.zeros(nc))


def solved(p, stuck, direction):
    m = Modes.of(len(stuck), len(p.ratio))
    m.stuck[:], m.direction[:] = stuck, direction
    return solve(p, m, a_tree(len(stuck))), m


@pytest.mark.parametrize("seed", range(8))
def test_contact_maps_give_the_normal_load(seed):
    rng = np.random.default_rng(seed)
    model = random_tree(seed, 6, sliding=0.5)
    scene = pf.Scene(model=model, friction=random_friction(model, seed))
    contacts = scene.site_tables.contacts
    for k, site in enumerate(scene.sites):
        B, C = contacts.map[contacts.site == k], contacts.map_moved[contacts.site == k]
        wrench, s = rng.normal(size=6) * 10, float(rng.normal())
        load = contacts.constant[k] + np.linalg.norm((B + s * C) @ wrench, axis=1).sum()
        assert load == pytest.approx(plain_normal_load(site, wrench, s), rel=1e-13)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_solve_dense_is_a_linear_solver(n):
    rng = np.random.default_rng(n)
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, 3))
    A[0, 0] = 0.0  # needs a pivot
    X = B.copy()
    if n == 1:
        assert not dense.solve_dense(A.copy(), X)
        return
    assert dense.solve_dense(A.copy(), X)
    np.testing.assert_allclose(X, np.linalg.solve(A, B), rtol=1e-11)


@pytest.mark.parametrize("seed", range(20))
def test_spectral_radius_bound_is_above_and_near(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 6
    A = rng.uniform(size=(n, n)) * (rng.random((n, n)) < 0.8)
    radius = np.abs(np.linalg.eigvals(A)).max()
    bound = dense.spectral_radius_bound(A, np.empty(n))
    assert radius * (1 - 1e-12) <= bound
    if (np.linalg.matrix_power(A + np.eye(n), n) > 0).all():  # irreducible: the bound is near
        assert bound <= 1.05 * radius + 1e-9


@pytest.mark.parametrize("seed", range(12))
def test_the_jacobian_is_the_derivative_of_the_residual(seed):
    p = random_problem(seed, shared=bool(seed % 2))
    nc = len(p.rate_free)
    stuck, direction = np.zeros(nc, bool), np.where(np.arange(nc) % 2, 1.0, -1.0)
    stuck[1], direction[1] = seed % 3 == 0, 0.0 if seed % 3 == 0 else 1.0
    nz, reduced = coupling.reduce_problem(p, stuck, direction)
    z = np.random.default_rng(seed).normal(size=nz)

    def at(z):
        rest, size, J = np.empty(nz), np.empty(nz), np.empty((nz, nz))
        coupling.residual(reduced, z, rest, size, np.empty(3))
        coupling.residual_slope(reduced, z, J)
        return rest, J

    step = 1e-6
    numeric = np.array(
        [(at(z + step * e)[0] - at(z - step * e)[0]) / (2 * step) for e in np.eye(nz)]
    ).T
    np.testing.assert_allclose(at(z)[1], numeric, atol=1e-8)
    x = reduced.X[:, 0] + reduced.X[:, 1:] @ z
    slip = x - plain_slip_friction(p, direction, plain_loads(p, x))
    np.testing.assert_allclose(at(z)[0], slip[~stuck], atol=1e-12)
    np.testing.assert_allclose((p.rate_free + p.rate_slope @ x)[stuck], 0, atol=1e-12)


@pytest.mark.parametrize("seed", range(25))
def test_given_modes_against_scipy(seed):
    p = random_problem(seed, shared=bool(seed % 2))
    p.drag[:] = np.random.default_rng(seed).normal(scale=0.1, size=p.drag.shape)
    rng = np.random.default_rng(seed)
    stuck = rng.random(4) < 0.3
    direction = np.where(stuck, 0.0, rng.choice([-1.0, 1.0], 4))
    (found, _), m = solved(p, stuck, direction)
    expected = plain_solve(p, stuck, direction)
    if m.figures[0] < 1:
        assert found == 1
        np.testing.assert_allclose(m.friction, expected, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(m.load, plain_loads(p, m.friction), rtol=1e-12)
        phi, lower, upper = np.empty(len(p.ratio)), np.empty(4), np.empty(4)
        stick_limits(p, m.load, lower, upper)
        np.testing.assert_allclose((lower, upper), plain_limits(p, m.load), rtol=1e-13)
        site_friction(p, m, lower, upper, phi)
        total = np.zeros(4)
        np.add.at(total, p.coordinate, p.ratio * phi)
        np.testing.assert_allclose(total, m.friction, rtol=1e-9, atol=1e-11)
    elif expected is not None and found == 0:
        pytest.fail("SciPy finds a solution where the search found none")


@pytest.mark.parametrize("seed", range(40))
def test_sites_of_which_some_hold_without_limit_share_what_one_coordinate_needs(seed):
    """Each stays within its limits, infinite ones included; together they are what is needed."""
    rng = np.random.default_rng(seed)
    p = empty_problem(
        np.zeros(5, np.int64), rng.choice([-0.7, 1.0, 2.0], 5), np.arange(5), np.zeros(5)
    )
    p.coulomb_stick[:] = rng.uniform(-0.5, 2.0, (5, 1))  # below 0: it must add at least so much
    p.coulomb_stick[:, 1] += rng.uniform(0.0, 3.0, 5) - 2.0 * p.coulomb_stick[:, 0]
    p.coulomb_stick[rng.random((5, 2)) < 0.3] = np.inf
    p.coulomb_stick[0, seed % 2] = np.inf
    m, lower, upper, phi = Modes.of(1, 5), np.empty(1), np.empty(1), np.full(5, np.nan)
    stick_limits(p, m.load, lower, upper)
    m.stuck[:] = True
    m.friction[:] = np.clip(rng.normal(scale=5.0), lower, upper)
    site_friction(p, m, lower, upper, phi)
    assert (phi >= -p.coulomb_stick[:, 0] - 1e-12).all()
    assert (phi <= p.coulomb_stick[:, 1] + 1e-12).all()
    assert p.ratio @ phi == pytest.approx(m.friction[0], rel=1e-12, abs=1e-12)


def test_fixed_point_and_newton_both_occur_and_agree():
    """Weak coupling ends by the fixed point, strong coupling needs Newton; both are verified."""
    passes = []
    for strength in (0.001, 0.01, 0.05, 0.1):
        p = random_problem(3, strength=strength)
        (found, _), m = solved(p, np.zeros(4, bool), np.ones(4))
        assert found == 1
        slip = plain_slip_friction(p, m.direction, plain_loads(p, m.friction))
        np.testing.assert_allclose(m.friction, slip, rtol=1e-12)
        passes.append((m.figures[0], int(m.figures[1])))
    assert passes[0][0] < 0.05 < 0.5 < passes[-1][0] < 1
    assert all(n <= 12 for _, n in passes)


def test_a_contact_without_load_has_no_direction_and_no_nan():
    p = random_problem(5)
    p.contact[:, 0] = 0.0
    p.constant[:] = 0.0
    p.coulomb_slip[:] = 0.0
    (found, _), m = solved(p, np.zeros(4, bool), np.ones(4))
    assert found == 1
    assert (m.friction == 0).all()


def brute_force(p, at_rest):
    """Every mode of the coordinates at rest, by SciPy; the consistent ones with fewest slipping."""
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
        if found:
            return found
    return []


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
    assert status == (Found.NONE, Found.SOLVED, Found.AMBIGUOUS)[min(len(expected), 2)]
    if status == Found.SOLVED:
        np.testing.assert_array_equal(m.direction, expected[0][0])
        np.testing.assert_allclose(m.friction, expected[0][1], rtol=1e-7, atol=1e-8)


def test_the_random_problems_have_every_number_of_slipping_coordinates():
    """What the test above covers: from all stick to all slip."""
    levels = set()
    for seed in range(40):
        p = random_problem(seed, strength=0.1, static=1 + 0.4 * (seed % 3))
        p.rate_free[:] *= 0.1 if seed % 4 == 0 else 1.0
        m = Modes.of(4, 4)
        m.at_rest[:] = True
        if search.search(p, m, a_tree(len(m.stuck))) == Found.SOLVED:
            levels.add(int(np.count_nonzero(m.direction)))
    assert levels == {0, 1, 2, 3, 4}


@pytest.mark.parametrize("seed", range(15))
def test_pivoting_beyond_eight_finds_consistent_modes(seed):
    p = random_problem(seed, nc=10, strength=0.03, static=1.0)
    m = Modes.of(10, 10)
    m.at_rest[:] = True
    assert search.search(p, m, a_tree(len(m.stuck))) == Found.SOLVED
    evaluate(p, m.friction, m.load, m.rate)
    assert judge(p, m) == 0
    if seed < 3:  # static = kinetic and weak coupling: the answer is the only one
        other = Modes.of(10, 10)
        other.at_rest[:] = True
        # enumeration of 3^10 is long: one level below where the pivoting ended
        level = int(np.count_nonzero(m.direction))
        kinematics = Kinematics(p, a_tree(10), other.at_rest)
        for ways in kinematics.ways(list(range(10)), level - 1, {}) if 0 < level < 4 else ():
            search._stick(other, a_tree(10), ways)
            assert solve(p, other, a_tree(10))[1] == 0


def test_judge_names_what_is_wrong():
    p = random_problem(1, nc=2, strength=0.0)
    p.coulomb_slip[:], p.coulomb_stick[:] = 1.0, 1.0
    p.rate_slope[:], p.rate_free[:] = np.eye(2), [5.0, -0.5]
    (_, obeying), m = solved(p, np.array([True, True]), np.zeros(2))
    assert obeying == 1  # nothing was open
    m.at_rest[:] = True
    assert solve(p, m, a_tree(2)) == (1, 0)
    assert m.verdict.tolist() == [1, 0]  # pulled forward by 5, held by 1
    m.stuck[:], m.direction[:] = False, [1.0, 1.0]
    assert solve(p, m, a_tree(2)) == (1, 0)
    assert m.verdict.tolist() == [0, SHOULD_STICK]


def test_what_is_forced_to_slip_slips_even_where_stick_is_admissible():
    p = random_problem(1, nc=1, strength=0.0)
    p.coulomb_slip[:], p.coulomb_stick[:] = 1.0, 1.0
    p.rate_slope[:], p.rate_free[:], p.rate_scale[:] = 1.0, 1.0, 1.0  # exactly at the limit
    m = Modes.of(1, 1)
    m.at_rest[:] = True
    assert search.search(p, m, a_tree(len(m.stuck))) == Found.SOLVED
    assert m.stuck[0]
    assert search.search(p, m, a_tree(len(m.stuck)), {0: 1.0}) == Found.SOLVED
    assert m.direction[0] == 1.0
    p.rate_free[:] = 0.5  # the slip would go backward
    assert search.search(p, m, a_tree(len(m.stuck)), {0: 1.0}) == Found.NONE


def test_what_was_sticking_decides_between_equally_few_slipping():
    p = random_problem(14, nc=3, strength=0.1, static=1.8)
    at_rest = np.ones(3, bool)
    choices = [direction.tolist() for direction, _ in brute_force(p, at_rest)]
    assert choices == [[0, 0, -1], [0, 1, 0], [-1, 0, 0]]
    m = Modes.of(3, 3)
    m.at_rest[:] = True
    assert search.search(p, m, a_tree(len(m.stuck))) == Found.AMBIGUOUS
    assert (
        search.search(p, m, a_tree(len(m.stuck)), held=np.array([True, True, False]))
        == Found.SOLVED
    )
    assert m.direction.tolist() == [0, 0, -1]
    assert (
        search.search(p, m, a_tree(len(m.stuck)), held=np.array([True, False, False]))
        == Found.AMBIGUOUS
    )
    assert search.search(p, m, a_tree(len(m.stuck)), held=np.ones(3, bool)) == Found.AMBIGUOUS


def strong_problem(seed, along=3, constant=0.0):
    """Friction strong enough for several solutions; contact forces along so many axes; directions.

    Args:
        constant: largest friction that no load makes.
    """
    rng = np.random.default_rng(seed)
    p = random_problem(seed, nc=2, strength=float(rng.uniform(0.3, 1.0)))
    p.constant[:], p.coulomb_slip[:] = 0.0, constant
    p.contact[:, 0, along:], p.contact[:, 1:, along:] = 0.0, 0.0
    return p, rng.choice([-1.0, 1.0], 2)


def by_signs(p, direction):
    """All frictions of two slipping coordinates whose contact forces lie on a line: |p| = +-p."""
    weight = -direction[p.contact_site] * p.mu_slip[p.contact_site]
    found = []
    for signs in itertools.product((1.0, -1.0), repeat=len(weight)):
        A, b = np.eye(2), -direction * p.coulomb_slip[:, 0]
        for t, sign in enumerate(signs):
            A[p.contact_site[t]] -= weight[t] * sign * p.contact[t, 1:, 0]
            b[p.contact_site[t]] += weight[t] * sign * p.contact[t, 0, 0]
        x = np.linalg.solve(A, b)
        if (np.array(signs) * (p.contact[:, 0, 0] + p.contact[:, 1:, 0] @ x) >= 0.0).all():
            found.append(x)
    return found


@pytest.mark.parametrize("seed", [*range(12), 129, 220, 568, 628, 647, 1421])
def test_no_solution_is_left_out_where_forces_lie_on_a_line(seed):
    """Up to six; each sign of each force is one linear system, all of which are solved."""
    p, direction = strong_problem(seed, along=1)
    expected = by_signs(p, direction)
    m = Modes.of(2, 2)
    m.direction[:] = direction
    found, parts, complete = find_all(p, m.stuck, m.direction)
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
        assert status == (Found.NONE, Found.SOLVED, Found.AMBIGUOUS)[min(len(expected), 2)]


def plane_problem(seed):
    """Two sliding sites whose forces lie in a plane."""
    rng = np.random.default_rng(seed)
    p = random_problem(seed, nc=2, strength=float(rng.uniform(0.1, 0.5)))
    p.constant[:], p.coulomb_slip[:] = 0.0, rng.uniform(0, 0.3) * (seed % 2)
    p.contact[:, 0, 2], p.contact[:, 1:, 2] = 0.0, 0.0
    return p, rng.choice([-1.0, 1.0], 2)


@pytest.mark.parametrize("seed", [644, 1039])
def test_a_second_solution_far_from_the_first_makes_it_ambiguous(seed):
    """Newton's method from rest, and from far out on every side, comes to one of the two only."""
    p, direction = plane_problem(seed)
    (found, _), m = solved(p, np.zeros(2, bool), direction)
    assert found == 1
    assert m.figures[0] > 1.0
    every = find_all(p, m.stuck, m.direction).solutions
    assert len(every) == 2
    for x in every:
        np.testing.assert_allclose(
            x, plain_slip_friction(p, direction, plain_loads(p, x)), rtol=1e-10
        )
    m = Modes.of(2, 2)
    m.direction[:] = direction
    assert search.search(p, m, a_tree(2)) == Found.AMBIGUOUS


@pytest.mark.parametrize("seed", [644, 1039])
def test_a_search_for_all_solutions_that_ends_at_its_bound_is_undecided(seed, monkeypatch):
    p, direction = plane_problem(seed)
    m = Modes.of(2, 2)
    m.direction[:] = direction
    monkeypatch.setattr("pinfric.friction.several.MOST_PARTS", 2)
    found = find_all(p, m.stuck, m.direction)
    assert found.complete is False
    assert search.search(p, m, a_tree(2)) == Found.UNDECIDED


def a_mechanism(A):
    """Coordinates whose rates are A^T w."""
    nc, none = A.shape[1], np.zeros(A.shape[1], dtype=bool)
    return Mechanism(True, A, np.arange(nc), none, none, np.zeros(nc))


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize(("freedoms", "seed"), [(1, 0), (2, 1), (2, 2), (3, 3), (3, 4)])
def test_the_ways_to_slip_are_those_that_linear_programs_allow(freedoms, seed, moves):
    """All 3^5 signs of r = c + A^T w by HiGHS; c where other joints move along."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(freedoms, 5))
    if seed in (2, 4):
        A[:, 1] = -2.0 * A[:, 0]  # two that move in proportion
    p = random_problem(seed, nc=5)
    c = rng.normal(size=5) * moves
    p.rate_free[:] = c + A.T @ rng.normal(size=freedoms)
    p.rate_scale[:] = np.abs(p.rate_free) + 1.0
    at_rest = np.ones(5, bool)
    kinematics = Kinematics(p, a_mechanism(A), at_rest)
    for level in range(6):
        yielded = [
            tuple(ways.get(i, 0.0) for i in range(5))
            for ways in kinematics.ways(list(range(5)), level, {})
        ]
        assert len(set(yielded)) == len(yielded)
        for signs in itertools.product((0.0, 1.0, -1.0), repeat=5):
            if np.count_nonzero(signs) == level:
                assert (signs in yielded) == _is_a_way(A, c, np.array(signs)), signs


def _is_a_way(A, c, signs):
    """Whether some w makes every rate of a sign at least 1e-6, and the others zero."""
    rate = np.column_stack([A.T, np.zeros(len(c))])
    slips, sticks = signs != 0.0, signs == 0.0
    upper = np.column_stack([-signs[slips, None] * A.T[slips], np.ones(slips.sum())])
    found = linprog(
        np.r_[np.zeros(len(A)), -1.0],
        upper,
        (signs * c)[slips],
        rate[sticks],
        -c[sticks],
        bounds=[(-1e3, 1e3)] * len(A) + [(0.0, 1.0)],
    )
    return bool(found.status == 0 and (not slips.any() or found.x[-1] > 1e-6))
