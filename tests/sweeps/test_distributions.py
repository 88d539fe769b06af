"""Quantiles of distributions against SciPy."""

import numpy as np
import pytest
from scipy import stats

from pinfric.sweeps.distributions import (
    Choice,
    LogNormal,
    Normal,
    Steps,
    TruncatedNormal,
    Uniform,
)

U = (np.arange(4000) + 0.5) / 4000


@pytest.mark.parametrize(
    ("distribution", "reference"),
    [
        (Normal(mean=2.0, std=0.3), stats.norm(2.0, 0.3)),
        (Uniform(low=-1.0, high=3.0), stats.uniform(-1.0, 4.0)),
        (LogNormal(median=2.0, sigma=0.5), stats.lognorm(0.5, scale=2.0)),
        (TruncatedNormal(mean=1.0, std=0.5, low=0.2, high=1.7), stats.truncnorm(-1.6, 1.4, 1, 0.5)),
        (TruncatedNormal(mean=0.0, std=1.0, low=1.0), stats.truncnorm(1.0, np.inf)),
    ],
)
def test_quantiles_are_scipys(distribution, reference):
    np.testing.assert_allclose(distribution.quantile(U), reference.ppf(U), rtol=1e-9, atol=1e-12)
    ends = distribution.quantile(np.array([0.0, 1 - 2.0**-53]))
    assert np.isfinite(ends).all()
    low, high = distribution.support
    assert low <= ends[0] <= ends[1] <= high


def test_choices_and_steps_come_as_often_as_each_other():
    values = Choice(values=(3.0, 1.0)).quantile(U)
    np.testing.assert_array_equal(values, np.repeat([3.0, 1.0], 2000))
    there, counts = np.unique(Steps(low=0.0, high=1.0, count=5).quantile(U), return_counts=True)
    np.testing.assert_allclose(there, [0.0, 0.25, 0.5, 0.75, 1.0])
    assert set(counts) == {800}
