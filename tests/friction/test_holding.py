"""Whether friction holds: against closed forms, an independent search, and its own thresholds."""

from __future__ import annotations

import numpy as np
from mechanisms import (
    four_bar,
)

from pinfric.dynamics.forward.workspace import Workspace
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


def two_that_share(rng, contact=1.0):
    """Problem and factor of two joints that share one freedom, and load each other in planes."""
    ws = Workspace(four_bar()[0])
    p = ws.problem._replace(
        rate_free=np.zeros(2),
        rate_slope=np.zeros((2, 2)),
        rate_scale=np.ones(2),
        contact=np.concatenate(
            [rng.normal(size=(2, 1, 3)), contact * rng.normal(size=(2, 2, 3))], axis=1
        )
        * [1, 1, 0],
        contact_site=np.arange(2),
        constant=np.zeros(2),
        coordinate=np.arange(2),
        ratio=np.ones(2),
        mu_stick=rng.uniform(0.1, 0.6, 2),
        coulomb_stick=np.zeros((2, 2)),
        mu_slip=np.zeros(2),
        coulomb_slip=np.zeros((2, 2)),
        drag=np.zeros(2),
    )
    factor = rng.normal(size=(1, 2))
    p.rate_slope[:] = factor.T @ factor
    p.rate_free[:] = factor[0] * rng.uniform(0.0, 1.5)
    return p, factor


def grid_use(p, factor, reaches, count=20001):
    """The least use of two joints that share one freedom, along the line of equilibria."""
    x0 = -np.linalg.lstsq(p.rate_slope, p.rate_free, rcond=1e-9)[0]
    along, least = np.array([-factor[0, 1], factor[0, 0]]) / np.linalg.norm(factor), np.inf
    for reach in reaches:
        x = x0 + np.linspace(-reach, reach, count)[:, None] * along
        force = p.contact[:, 0] + np.einsum("nc,tce->nte", x, p.contact[:, 1:])
        limit = p.mu_stick * np.linalg.norm(force, axis=2)
        least = min(least, float((np.abs(x) / limit).max(axis=1).min()))
    return least


def test_the_verdict_is_that_of_a_grid():
    """Two joints share one freedom: along the line of equilibria every friction is tried."""
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(40):
        p, factor = two_that_share(rng)
        answer, least = decide(p, factor, np.ones(2, dtype=bool)), grid_use(p, factor, (1.0, 30.0))
        seen.add(answer.held)
        assert answer.held == (least <= 1.0) or abs(least - 1.0) < 1e-3
        if answer.held:
            assert answer.use <= least * (1 + 1e-3) or answer.use <= 1.0
    assert seen == {True, False}
