"""Whether friction holds: against closed forms, an independent search, and its own thresholds."""

from __future__ import annotations

import numpy as np
import pytest
from friction_cases import grid_use, two_that_share

from pinfric.friction.holding import decide


def test_use_is_the_least_where_a_search_ends_above_it():
    """Two pins, one freedom, loads that fall before they rise: a grid finds the other valley."""
    rng, better = np.random.default_rng(3), 0
    for _ in range(60):
        p, factor = two_that_share(rng, contact=3.0)
        every = np.ones(2, dtype=bool)
        found, least = decide(p, factor, every, least=True), grid_use(p, factor, (0.2, 1.0), 2001)
        assert found.least
        assert found.use <= least * (1 + 2e-6)
        better += decide(p, factor, every).use > found.use * (1 + 1e-4)
    assert better > 0


def test_a_verdict_says_what_is_proved():
    """One joint alone has one friction; rates that no friction takes away cannot be held."""
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
