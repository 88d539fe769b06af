"""The small linear programs against HiGHS."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from pinfric.friction.minimax import least_violation


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
