"""The least use of friction, against a search from many starts."""

from __future__ import annotations

import numpy as np
import pytest
from friction_cases import resting_six_bar

from pinfric.friction.least_use import descend, friction_and_limits


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
