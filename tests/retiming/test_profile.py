"""Samples of a profile belong to one motion."""

from __future__ import annotations

import numpy as np
import pytest
from retime_cases import MOTORS, WAVE, planar

from pinfric.retiming.profile import Profile
from pinfric.retiming.retime import retime


def test_samples_are_of_one_motion():
    """Velocities and accelerations are the derivatives of the positions, at any rate."""
    found = retime(planar(), WAVE, MOTORS, points=100, sample_rate=20_000.0)
    t, q, v, a = (getattr(found.trajectory, name) for name in "tqva")
    h = t[1] - t[0]
    assert np.abs((q[2:] - q[:-2]) / (2 * h) - v[1:-1])[5:-5].max() < 1e-3 * np.abs(v).max()
    smooth = np.abs(np.diff(a, axis=0)).max(axis=1) < 0.02 * np.abs(a).max()
    rate = (v[1:] - v[:-1]) / h - 0.5 * (a[1:] + a[:-1])
    assert np.abs(rate[smooth]).max() < 0.02 * np.abs(a).max()
    assert found.trajectory.duration == pytest.approx(found.duration)


def test_a_slower_profile_is_the_same_in_another_time():
    found = retime(planar(), WAVE, MOTORS, points=60).profile
    slower = found.scaled(0.5)
    again = Profile.of(slower.grid, slower.x, slower.u)
    assert again.duration == pytest.approx(2.0 * found.duration)
