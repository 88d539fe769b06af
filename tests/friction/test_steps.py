from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from friction_cases import grid_use, random_problem, resting_six_bar, two_that_share
from scipy.optimize import linprog

from pinfric.friction.balance import Balance
from pinfric.friction.holding import decide
from pinfric.friction.least_use import descend, friction_and_limits, make_rest
from pinfric.friction.minimax import _checked_bound, least_violation, write_vertex
from pinfric.friction.rest import anderson

# Anderson: extrapolation of fixed points: where plain passes run away.


@pytest.mark.parametrize("seed", range(6))
def test_extrapolation_finds_a_fixed_point_that_passes_alone_run_away_from(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(4, 4)), rng.normal(size=4)
    A *= (0.6 if seed % 2 else 1.5) / np.abs(np.linalg.eigvals(A)).max()
    x, passes = anderson(SimpleNamespace(image=lambda x: A @ x + b), np.zeros(4), 1e-12)
    np.testing.assert_allclose(x, np.linalg.solve(np.eye(4) - A, b), rtol=1e-8)
    assert passes < 60
    assert anderson(SimpleNamespace(image=lambda x: x + 1.0), np.zeros(2), 1e-12)[0] is None


# Least use: the least use of friction, against a search from many starts.


@pytest.mark.parametrize("seed", range(4))
def test_use_falls_to_where_no_friction_nearby_has_less(seed):
    rest, ws = resting_six_bar(seed)
    n, dz = rest.N.shape
    rng, out = np.random.default_rng(seed), (np.empty(n), np.empty(n), np.empty(n))
    start = 0.1 * rng.uniform(-1.0, 1.0, dz) * rest.reach
    z = start.copy()
    use = descend(rest, z)
    assert use == friction_and_limits(rest, z, *out) < friction_and_limits(rest, start, *out)
    x = rest.unit * (rest.x0 + rest.N @ z)
    rate = ws.problem.rate_free + ws.problem.rate_slope @ x
    assert np.abs(rate).max() < 1e-9 * ws.problem.rate_scale.max()  # in equilibrium
    for size in (1e-2, 1e-4):
        for step in rng.normal(size=(200, dz)) * size * np.linalg.norm(x / rest.unit):
            assert friction_and_limits(rest, z + step, *out) > use * (1 - 1e-8)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_forces_in_a_plane_are_told_from_those_in_space(axes):
    """Three joints share one freedom, so each force is a map of two; a proof needs planes."""
    rng, p = np.random.default_rng(axes), random_problem(axes, nc=3)
    factor = rng.normal(size=(1, 3))
    p.rate_slope[:], p.rate_free[:] = factor.T @ factor, 0.5 * factor[0]
    p.rate_scale[:] = np.abs(p.rate_free)
    p.contact[:, :, axes:] = 0.0
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    p.contact[:] = p.contact @ turn
    every = np.arange(3)
    narrow, wide, planar, _ = make_rest(p, every, Balance.of_rates(p, factor, every))
    assert planar == (axes <= 2)
    for rest in (narrow, wide):
        assert (rest.on_a_line == (axes == 1)).all()
        assert (rest.contact[:, :, axes:] == 0.0).all()


# Minimax: the small linear programs against HiGHS.


@pytest.mark.parametrize("seed", range(20))
def test_the_small_linear_programs_are_what_highs_finds(seed):
    rng = np.random.default_rng(seed)
    rows, dz, reach = int(rng.integers(4, 20)), int(rng.integers(1, 6)), 3.0
    A, h, s = rng.normal(size=(rows, dz)), rng.normal(size=rows), rng.uniform(0.1, 2.0, rows)
    z = np.empty(dz)
    bound = least_violation(A, h, s, rows, reach, z)
    best = linprog(
        np.r_[np.zeros(dz), 1.0],
        np.column_stack([A, -s]),
        -h,
        bounds=[(-reach, reach)] * dz + [(None, None)],
    )
    assert bound == pytest.approx(best.fun, abs=1e-9)
    assert ((A @ z + h) / s).max() == pytest.approx(best.fun, abs=1e-9)
    assert (np.abs(z) <= reach + 1e-12).all()


def test_rows_that_meet_in_no_single_point_give_the_middle_of_the_box():
    """Rounding may let a row into a basis that depends on those in it."""
    G, h, s = np.array([[1.0, 2.0], [1.0, 2.0], [0.0, 1.0]]), np.array([3.0, 3.0, 1.0]), np.ones(3)
    z = np.full(2, np.nan)
    write_vertex(G, h, s, 3, 0.5, np.array([0, 1, 2]), z)
    assert z.tolist() == [0.0, 0.0]
    write_vertex(G, h, s, 3, 0.5, np.array([0, 2, 3]), z)  # z_0 = 0.5, G z + h = m twice
    np.testing.assert_allclose(z, [0.5, -2.5])


# Holding: against closed forms, an independent search, and its own thresholds.


def test_use_is_the_least_where_a_search_ends_above_it():
    """Two pins, one freedom, loads that fall before they rise: a grid finds the other valley."""
    rng, better = np.random.default_rng(3), 0
    for _ in range(60):
        p, factor = two_that_share(rng, contact=3.0)
        every = np.ones(2, dtype=bool)
        found, least = (
            decide(p, factor, every, least_below=np.inf),
            grid_use(p, factor, (0.2, 1.0), 2001),
        )
        assert found.least
        assert found.use <= least * (1 + 2e-6)
        better += decide(p, factor, every).use > found.use * (1 + 1e-4)
    assert better > 0


def test_a_verdict_says_what_is_proved():
    """One joint alone has one friction; rates that no friction changes cannot be held."""
    rng = np.random.default_rng(1)
    p, factor = two_that_share(rng)
    for first in (1e-2, 1e2):
        p.rate_free[:] = first * factor[0]
        x = -p.rate_free[0] / p.rate_slope[0, 0]
        limit = p.mu_stick[0] * np.linalg.norm(p.contact[0, 0] + x * p.contact[0, 1])
        alone = decide(p, factor, np.array([True, False]))
        np.testing.assert_allclose(alone.friction, [x, 0.0], rtol=1e-9)
        assert abs(alone.use * limit / abs(x) - 1.0) < 1e-9
        assert (alone.held, alone.proved, alone.least) == (abs(x) <= limit, True, True)
    p.rate_free[:] = [factor[0, 1], -factor[0, 0]]  # not a motion that the two share
    never = decide(p, factor, np.ones(2, dtype=bool))
    assert (never.held, never.use, never.proved, never.least) == (False, np.inf, True, True)


@pytest.mark.parametrize("one_way", [False, True])
def test_the_verdict_is_that_of_a_grid(one_way):
    """Two joints share one freedom: along the line of equilibria every friction is tried."""
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(40):
        p, factor = two_that_share(rng)
        if one_way:  # the first holds whatever pushes it in one of its ways
            p.coulomb_stick[0, int(rng.integers(2))] = np.inf
        answer = decide(p, factor, np.ones(2, dtype=bool))
        least = grid_use(p, factor, (1.0, 30.0, 1e3) if one_way else (1.0, 30.0))
        seen.add(answer.held)
        assert answer.held == (least <= 1.0) or abs(least - 1.0) < 1e-3
        if answer.held:
            assert answer.use <= least * (1 + 1e-3) or answer.use <= 1.0
    assert seen == {True, False}


def test_whatever_is_left_of_the_multipliers_their_bound_holds():
    """Pivots on nearly nothing wear them, so that they are no solution: any of them bound m."""
    rng = np.random.default_rng(0)
    for _ in range(100):
        dz, rows, reach = int(rng.integers(1, 6)), 12, rng.uniform(0.5, 2.0)
        G, h, s = rng.normal(size=(rows, dz)), rng.normal(size=rows), rng.uniform(0.5, 2.0, rows)
        basis = rng.permutation(rows + 2 * dz)[: dz + 1].astype(np.int64)
        bound = _checked_bound(G, h, s, rows, reach, basis, rng.uniform(0.0, 1.0, dz + 1))
        z = rng.uniform(-reach, reach, (200, dz))
        assert bound <= ((z @ G.T + h) / s).max(axis=1).min()
