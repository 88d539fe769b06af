"""Least squares from summed normal equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify_cases import (
    NAMES,
    guess,
    short,
)

import pinfric as pf
from pinfric.identification.laws import Law
from pinfric.identification.normal import non_negative, residuals


def test_held_out_errors_count_outliers_in_full():
    bursts = np.zeros_like(short().effort)
    bursts[np.arange(len(bursts)) % 200 < 20, 5] = 2.0
    log = replace(short(), effort=short().effort + bursts)
    found = pf.identify(guess(0), log, laws=dict.fromkeys(NAMES, Law()))
    fitted = residuals(found.estimate.rows[5], found.estimate.fit, 5)
    assert found.errors[NAMES[5]].error > np.sqrt(np.mean(fitted**2))


def test_coefficients_are_the_least_squares_that_are_not_negative():
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(3)
    A, y = rng.normal(size=(12, 30, 6)), rng.normal(size=(12, 30))
    A[::2, :, 5] += 3.0 * A[::2, :, 4] - 2.0 * A[::2, :, 3]  # columns that hang together
    ours = non_negative(np.einsum("fni,fnj->fij", A, A), np.einsum("fni,fn->fi", A, y))
    for columns, effort, x in zip(A, y, ours, strict=True):
        judge = lsq_linear(columns, effort, (0.0, np.inf), method="bvls", tol=1e-12).x
        assert x == pytest.approx(judge, abs=1e-6)
