"""Profiles and heat of a retimed motion."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from retime_cases import MOTORS, STOPS, WAVE, one_joint, planar, straight

import pinfric as pf
from pinfric.retiming.profile import Profile
from pinfric.retiming.retime import retime
from pinfric.retiming.thermal import _Barrier

# Profile: samples of a profile belong to one motion.


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


def test_an_interval_is_not_passed_where_its_speed_falls_to_zero():
    """x = 0.04 - 2 a h + 2 a h^2 on [0, 1]: 0.04 - a/2 in the middle."""
    grid, x = SimpleNamespace(step=np.ones(1), stop=np.array([True, True])), np.full(2, 0.04)
    for a, stalls in ((0.0799, []), (0.08, [0]), (-0.2, [])):
        profile = Profile(grid, x, np.array([[-a, a]]), np.zeros(2), np.zeros(1))
        assert profile.stalls().tolist() == stalls


# Thermal: continuous torques over a whole cycle, by closed forms.


def test_continuous_torque_of_a_pure_inertia():
    """The optimum sqrt(2 sqrt(3) D J/c) is 7 % faster than the whole motion slowed down."""
    D, c, J = 3.0, 1.0, 2.0
    limits = {"j": {"peak_torque": 50.0, "continuous_torque": c}}
    found = retime(one_joint(inertia=J), straight(D), limits, points=150)
    assert found.duration == pytest.approx(np.sqrt(2 * np.sqrt(3) * D * J / c), rel=1e-3)
    assert found.uniform == pytest.approx(2 * np.sqrt(D * J / c), rel=3e-3)
    assert found.rms == pytest.approx([1.0], abs=1e-3)
    assert found.limiting["j"]["continuous torque"] == 1.0
    once = retime(one_joint(inertia=J), straight(D), limits, heat=False, points=150)
    assert once.duration == pytest.approx(2 * np.sqrt(D * J / 50.0), rel=1e-3)
    assert once.rms is None
    unknown = retime(one_joint(), straight(D), {"j": {"peak_torque": 50.0}})
    assert unknown.rms is None


def test_continuous_torques_over_a_cycle_with_holds():
    found = retime(
        planar(),
        STOPS,
        {
            name: entry | {"continuous_torque": 0.6 * entry["peak_torque"]}
            for name, entry in MOTORS.items()
        },
    )
    fast = retime(planar(), STOPS, MOTORS)
    assert fast.duration < found.duration <= found.uniform
    assert found.rms.max() == pytest.approx(1.0, abs=2e-3)
    assert found.excess < 1e-3
    with pytest.raises(pf.RetimeError, match="'a' exceeds its continuous torque at any speed"):
        retime(planar(), STOPS, {"a": MOTORS["a"] | {"continuous_torque": 0.02}, "b": MOTORS["b"]})


def test_the_duration_of_an_interval_has_the_derivatives_that_the_barrier_takes():
    """2 ds/(sqrt x_0 + sqrt x_1) against differences; a stop has none."""
    step, x, h = np.array([0.1, 0.3]), np.array([0.5, 2.0, 0.7]), 1e-5
    moving = np.array([[True, True], [True, False]])
    times = partial(_Barrier.durations, SimpleNamespace(step=step, moving=moving))
    time, first, second = times(x)
    assert_allclose(time, 2.0 * step / (np.sqrt(x[:-1]) + np.sqrt(x[1:])))
    for i in range(2):
        for k in range(2):
            e = h * np.eye(3)[i + k]
            (up, slope_up, _), (down, slope_down, _) = times(x + e), times(x - e)
            numeric = (up - down)[i] / (2 * h) * moving[i, k]
            assert first[i, k] == pytest.approx(numeric, rel=1e-7)
            curved = (slope_up - slope_down)[i] / (2 * h) * moving[i, k]
            assert_allclose(second[i, k], curved, rtol=1e-7)
