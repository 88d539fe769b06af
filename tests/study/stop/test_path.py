"""Stops along a path: constant speeds by hand, and a curved path against its own derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from stop_cases import arm, turntable

import pinfric as pf
from pinfric.study.stop.path import CyclePath


def at_constant_speed(scene, *speeds):
    t, v = np.linspace(0.0, 1.0, 11), np.tile(speeds, (11, 1))
    motion = pf.Trajectory.from_arrays(scene, t, v * t[:, None], v, np.zeros_like(v))
    return CyclePath(scene.model, motion)


# Sample, part of the speed, time and way: 1 rad/s at 4 rad/s^2 is 0.25 s and 0.125 rad.
BY_HAND = {
    "within the cycle": (3, 1.0, 0.25, 0.125),
    "at half its speed": (3, 0.5, 0.125, 0.03125),
    "past the end": (9, 1.0, 0.25, 0.125),
    "from the last sample": (10, 1.0, 0.25, 0.125),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_one_axis_at_constant_speed_stops_in_v_over_d(name):
    sample, speed, time, way = BY_HAND[name]
    found = at_constant_speed(turntable(), 1.0).slowed(sample, speed, np.array([4.0]))
    assert found.t[-1] == pytest.approx(time, rel=1e-12)
    assert found.q[-1] - found.q[0] == pytest.approx([way], rel=1e-12)
    assert found.a[:-1] == pytest.approx(-4.0, rel=1e-12)
    assert not found.v[-1].any()
    assert not found.a[-1].any()


def test_the_axis_that_needs_longest_decides():
    """2 rad/s at 4 rad/s^2 takes 0.5 s; -1 rad/s at 8 rad/s^2 would take 0.125 s."""
    found = at_constant_speed(arm(), 2.0, -1.0).slowed(0, 1.0, np.array([4.0, 8.0]))
    assert found.t[-1] == pytest.approx(0.5, rel=1e-12)
    assert found.q[-1] == pytest.approx([0.5, -0.25], rel=1e-12)
    assert found.a[:-1] == pytest.approx(np.tile([-4.0, 2.0], (len(found.t) - 1, 1)), rel=1e-12)


def test_a_curved_path_is_kept_and_no_axis_is_slowed_by_more():
    """p = (sin 2 tau, cos 2 tau) is a circle: q' = v, v' = a, and the rest of a is 4 sigma^2."""
    scene, d = arm(), np.array([3.0, 5.0])
    tau = np.linspace(0.0, 3.0, 601)
    sine, cosine = np.sin(2 * tau), np.cos(2 * tau)
    motion = pf.Trajectory.from_arrays(
        scene,
        tau,
        np.stack([sine, cosine], axis=1),
        2 * np.stack([cosine, -sine], axis=1),
        -4 * np.stack([sine, cosine], axis=1),
    )
    for sample in (40, 150, 333):
        found = CyclePath(scene.model, motion).slowed(sample, 1.0, d)
        assert np.linalg.norm(found.q, axis=1) == pytest.approx(1.0, abs=1e-8)
        for x, rate in ((found.q, found.v), (found.v, found.a)):
            mean = np.diff(x, axis=0) / np.diff(found.t)[:, None]
            assert mean[:-1] == pytest.approx((rate[1:-1] + rate[:-2]) / 2, abs=0.05)
        sigma = np.linalg.norm(found.v, axis=1) / 2
        slowing = np.abs(found.a + 4 * sigma[:, None] ** 2 * found.q)
        assert (slowing <= d * (1 + 1e-3)).all()
        assert ((slowing / d).max(axis=1)[:-1] > 0.98).all()  # one axis uses all that it has


def test_what_rests_stays():
    path = at_constant_speed(turntable(), 0.0)
    found = path.slowed(4, 1.0, np.array([4.0]))
    assert (found.t.tolist(), found.v.tolist()) == ([0.0], [[0.0]])


def test_a_motion_that_ends_at_rest_is_not_passed():
    """On a ramp p' = 1 - 8 tau, slowed by 4: sigma^2 = 1 + ln p', so it stops where p' is 1/e.

    The way is (1 - 1/e^2)/16, the time int_0^1 e^(x^2) dx/(4 e) = 1.4626517/(4 e).
    """
    t = np.linspace(0.0, 0.125, 126)
    t = np.append(t, [0.2, 0.3])
    v = np.maximum(1.0 - 8.0 * t, 0.0)[:, None]
    q = np.where(t <= 0.125, t - 4 * t**2, 0.0625)[:, None]
    a = np.where(t < 0.125, -8.0, 0.0)[:, None]
    scene = turntable()
    path = CyclePath(scene.model, pf.Trajectory.from_arrays(scene, t, q, v, a))
    with np.errstate(all="raise"):
        found = path.slowed(0, 1.0, np.array([4.0]))
    assert found.q[-1] == pytest.approx([(1 - np.exp(-2)) / 16], rel=0.01)
    assert found.t[-1] == pytest.approx(1.4626517 / 4 / np.e, rel=0.01)
    assert not found.v[-1].any()
