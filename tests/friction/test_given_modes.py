"""The coupled friction problem: its kernels against plain NumPy, its search against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from friction_cases import (
    NO_GEARS,
    plain_limits,
    plain_loads,
    plain_slip_friction,
    plain_solve,
    random_problem,
    solved,
    strong_problem,
)

from pinfric.friction import given_modes as coupling
from pinfric.friction.law import entry_friction, stick_limits
from pinfric.kernels import interpreted

pytestmark = pytest.mark.usefixtures("interpreted_kernels")


@pytest.mark.parametrize("seed", range(12))
def test_the_jacobian_is_the_derivative_of_the_residual(seed):
    p = random_problem(seed, shared=bool(seed % 2))
    nc = len(p.rate_free)
    stuck, direction = np.zeros(nc, bool), np.where(np.arange(nc) % 2, 1.0, -1.0)
    stuck[1], direction[1] = seed % 3 == 0, 0.0 if seed % 3 == 0 else 1.0
    nz, reduced = coupling.reduce_problem(p, stuck, direction, NO_GEARS)
    z = np.random.default_rng(seed).normal(size=nz)

    def at(z):
        residual, J, length = np.empty(nz), np.empty((nz, nz)), np.empty(len(reduced.gain))
        coupling.write_residual(reduced, z, residual, J, length)
        return residual, J

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
        entry_friction(p, m, lower, upper, phi)
        total = np.zeros(4)
        np.add.at(total, p.coordinate, p.ratio * phi)
        np.testing.assert_allclose(total, m.friction, rtol=1e-9, atol=1e-11)
    elif expected is not None and found == 0:
        pytest.fail("SciPy finds a solution where the search found none")


def test_fixed_point_and_newton_both_occur_and_agree():
    """Weak coupling ends by the fixed point, strong coupling by Newton; both are verified."""
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


def as_python(kernel):
    """A kernel as a Python function, compiled or not."""
    return interpreted.plain(kernel) if hasattr(kernel, "py_func") else kernel


def solve_as_python(p, direction=1.0, **others):
    """Friction where all slip, with some functions replaced; figures; solutions."""
    function, figures, nc = as_python(coupling.solve_given_modes), np.zeros(2), len(p.rate_free)
    solutions, guess = np.zeros((coupling.MOST_SOLUTIONS, nc)), np.full(nc, np.nan)
    with pytest.MonkeyPatch.context() as patch:
        for name, other in others.items():
            patch.setitem(function.__globals__, name, other)
        way = direction * np.ones(nc)
        found = function(p, np.zeros(nc, bool), way, NO_GEARS, guess, solutions, figures)
    return solutions[:found], figures


@pytest.mark.parametrize("strength", [0.05, 0.8, 1.5, None])
@pytest.mark.parametrize("seed", range(6))
def test_passes_of_every_start_count(seed, strength):
    """Beyond a contraction of 1 there are nz + 2 starts far out, and one between two solutions."""
    passes, newton = [], as_python(coupling.newton)
    if strength is None:  # several solutions
        p, direction = strong_problem((129, 220, 568, 628, 647, 1421)[seed], along=1)
    else:
        p, direction = random_problem(seed, strength=strength), 1.0

    def counted(reduced, z, sure):
        passes.append(newton(reduced, z, sure))
        return passes[-1]

    found, figures = solve_as_python(p, direction, newton=counted)
    assert figures[1] == sum(number for _, number in passes) > 0
    if strength is None:
        assert len(passes) > 1 + 2 + 2
    elif figures[0] >= 1.0:
        assert len(passes) >= 1 + 4 + 2 + max(len(found) - 1, 0)


@pytest.mark.parametrize("times", [1e-3, 1e9])
@pytest.mark.parametrize("seed", [129, 220, 568, 628, 647, 1421])
def test_solutions_grow_with_the_loads(seed, times):
    """Forces 1e-3 or 1e9 times as large: as many solutions, each in proportion."""
    p, direction = strong_problem(seed, along=1)
    found, _ = solve_as_python(p, direction)
    p.contact[:, 0] *= times
    more, _ = solve_as_python(p, direction)
    order, other = np.lexsort(found.T), np.lexsort(more.T)
    np.testing.assert_allclose(more[other], times * found[order], rtol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_solution_is_refined_to_rounding_only_where_it_is_near(seed):
    """A part in 1e8 beside the solution is near enough; where loads double friction none is."""
    p = random_problem(seed, strength=0.05)
    (exact,), _ = solve_as_python(p)
    nz, reduced = coupling.reduce_problem(p, np.zeros(4, bool), np.ones(4), NO_GEARS)
    z = exact[np.argsort(reduced.unknown)] * (1.0 + 1e-8 * np.array([1.0, -1.0, 2.0, -0.5]))
    before = np.full((nz, nz), np.nan)
    del before  # what a new array of this size may hold
    assert coupling.settles(reduced, z)
    np.testing.assert_allclose(z, exact[np.argsort(reduced.unknown)], rtol=1e-13)
    # z = 1 + |z|: the difference is small beside its terms far out, and no solution exists
    p = random_problem(seed, nc=1)
    p.contact[:], p.mu_slip[:], p.coulomb_slip[:], p.constant[:] = 0.0, 1.0, 1.0, 0.0
    p.contact[0, 1, 0] = 1.0
    _, reduced = coupling.reduce_problem(p, np.zeros(1, bool), -np.ones(1), NO_GEARS)
    assert not coupling.settles(reduced, np.array([1e15]))


def test_where_newton_fails_the_fixed_point_finds_the_solution():
    p = random_problem(3, strength=0.05)
    expected, _ = solve_as_python(p)
    found, figures = solve_as_python(p, newton=lambda reduced, z, sure: (np.inf, 3))
    assert figures[1] > 3
    np.testing.assert_allclose(found, expected, rtol=1e-11)
