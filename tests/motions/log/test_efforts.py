"""Samples of efforts that were not measured are left out and said, or refused."""

import numpy as np
import pytest

from pinfric.motions.log.efforts import mended_effort

T = np.arange(2000) / 100.0
EFFORT = 20.0 + 5.0 * np.sin(T) + 3.0 * np.sign(np.cos(0.7 * T))


def mended(effort):
    problems, notes = [], []
    return mended_effort("elbow", effort, range(2, 2002), problems, notes), problems, notes


@pytest.mark.parametrize(("value", "said"), [(0.0, "exactly 0"), (9999.0, "up to 9999")])
def test_few_samples_that_were_not_measured_are_left_out_and_many_refused(value, said):
    """Before, 10 % of zeros made everything 10 % low, without a word."""
    rng = np.random.default_rng(0)
    few, many = EFFORT.copy(), EFFORT.copy()
    at = np.sort(rng.choice(np.arange(1, 1999), 16, replace=False))
    few[at] = value
    many[rng.random(2000) < (0.1 if value == 0.0 else 0.02)] = value
    result, problems, notes = mended(few)
    assert problems == []
    assert f"{said}" in notes[0]
    assert f"16 rows of 2000, the first in line {at[0] + 2}" in notes[0]
    assert np.abs(result - EFFORT).max() < 6.1  # of a step of friction at a lost sample
    assert np.median(np.abs(result - EFFORT)[at]) < 0.01
    _, problems, _ = mended(many)
    assert problems[0].startswith(f"joint elbow: its effort is {said}")


@pytest.mark.parametrize(
    "effort",
    [
        EFFORT,
        np.where(T < 10.0, 0.0, EFFORT),  # a brake that holds
        5.0 * np.sign(np.sin(T)),  # passes through zero with friction
        np.rint(5.0 * np.sin(0.1 * T)),  # coarse
        np.zeros(2000),
        np.where((T > 5.0) & (T < 5.2), 300.0, EFFORT),  # a push of 0.2 s
    ],
)
def test_efforts_that_may_be_real_stay_as_they_are(effort):
    result, problems, notes = mended(effort)
    assert result is effort
    assert (problems, notes) == ([], [])
