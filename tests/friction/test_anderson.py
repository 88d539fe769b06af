"""Extrapolation of fixed points: where plain passes run away."""

from __future__ import annotations

import numpy as np
import pytest

from pinfric.friction.anderson import anderson


@pytest.mark.parametrize("seed", range(6))
def test_extrapolation_finds_a_fixed_point_that_passes_alone_run_away_from(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(4, 4)), rng.normal(size=4)
    A *= (0.6 if seed % 2 else 1.5) / np.abs(np.linalg.eigvals(A)).max()
    x, passes = anderson(lambda x: A @ x + b, np.zeros(4), 1e-12)
    np.testing.assert_allclose(x, np.linalg.solve(np.eye(4) - A, b), rtol=1e-8)
    assert passes < 60
    assert anderson(lambda x: x + 1.0, np.zeros(2), 1e-12)[0] is None
