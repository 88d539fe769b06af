"""The least use of friction, against a search from many starts."""

from __future__ import annotations

import numpy as np
import pytest
from friction_cases import random_problem, resting_six_bar

from pinfric.friction.balance import Balance
from pinfric.friction.least_use import descend, friction_and_limits, make_rest


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
