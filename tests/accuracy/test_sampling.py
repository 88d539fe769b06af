"""Stick that too few samples miss, by hand."""

from __future__ import annotations

import pytest

import pinfric as pf
from pinfric.accuracy.sampling import missed_stick, sampling
from pinfric.dynamics.inverse.result import StickInterval


def test_missed_stick_time_by_hand():
    true = (StickInterval("a", 0.0, 1.0), StickInterval("b", 0.0, 1.0))
    found = (StickInterval("a", 0.25, 0.5), StickInterval("a", 0.75, 2.0))
    assert missed_stick(true, found) == pytest.approx((2.0, 1.5))


def test_fewer_samples_miss_more_stick():
    scene = pf.load_scene("pendulum")
    trajectory = pf.load_trajectory("pendulum.waypoints.yaml", scene)
    rows = [row for row in sampling(scene, trajectory) if row.given == "q, v, a"]
    assert rows[0].missed_stick == 0.0
    assert rows[0].stick == pytest.approx(1.0, abs=0.01)  # 0.2 + 0.5 + 0.3 s of holds
    assert rows[0].rate == pytest.approx(1000)
    for row in rows:  # each hold loses at most a sample at either end
        assert row.missed_stick <= 3 * 2 / row.rate + 1e-9
    assert rows[-1].peak_error > rows[1].peak_error
