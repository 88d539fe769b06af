"""Stops along a path: constant speeds by hand, and a curved path against its own derivatives."""

import numpy as np
import pytest
from builders import example
from stop_cases import arm, turntable

import pinfric as pf
from pinfric.stops.path import CyclePath


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


def circle(scene):
    """p = (sin 2 tau, cos 2 tau), at constant speed: of a stop v = 2 sigma on the circle."""
    tau = np.linspace(0.0, 3.0, 601)
    sine, cosine = np.sin(2 * tau), np.cos(2 * tau)
    motion = pf.Trajectory.from_arrays(
        scene,
        tau,
        np.stack([sine, cosine], axis=1),
        2 * np.stack([cosine, -sine], axis=1),
        -4 * np.stack([sine, cosine], axis=1),
    )
    return CyclePath(scene.model, motion)


CIRCLE = [(sample, d) for sample in (40, 150, 333) for d in ((3.0, 5.0), (6.0, 9.0))]


@pytest.mark.parametrize(("sample", "d"), CIRCLE)
def test_a_curved_path_is_kept_and_no_axis_is_slowed_by_more(sample, d):
    """The bend 4 sigma^2 of the path counts; where it alone is more than d_j nothing is added."""
    scene, d = arm(), np.array(d)
    found = circle(scene).slowed(sample, 1.0, d)
    assert np.linalg.norm(found.q, axis=1) == pytest.approx(1.0, abs=1e-8)
    for x, rate in ((found.q, found.v), (found.v, found.a)):
        mean = np.diff(x, axis=0) / np.diff(found.t)[:, None]
        assert mean[:-2] == pytest.approx((rate[1:-2] + rate[:-3]) / 2, abs=0.15)
    sigma, forward = np.linalg.norm(found.v, axis=1) / 2, np.sign(found.v)
    slowing, own = -forward * found.a, forward * 4 * sigma[:, None] ** 2 * found.q
    assert (slowing <= np.maximum(d, own) * (1 + 1e-6)).all()
    as_much = (slowing / d).max(axis=1) > 1 - 1e-6  # one axis uses all that it has
    assert as_much[:-1].all()


@pytest.mark.parametrize(("sample", "d"), CIRCLE)
def test_a_curved_path_ends_where_small_steps_end(sample, d):
    """The same bound in steps of 1e-5 s: nothing is integrated but the speed's square."""
    tau, square, step = 0.005 * sample, 1.0, 1e-5
    way = time = 0.0
    while square > 0.0:
        angle = 2 * tau
        rate = 2 * np.cos(angle), -2 * np.sin(angle)
        bend = -4 * np.sin(angle), -4 * np.cos(angle)
        most = min((d[j] + np.sign(rate[j]) * bend[j] * square) / abs(rate[j]) for j in (0, 1))
        part = min(step, square / (2 * most)) if most > 0.0 else step  # the last one is shorter
        after = square - 2 * part * max(most, 0.0)
        time += 2 * part / (np.sqrt(square) + np.sqrt(after))
        tau, way, square = tau + part, way + part, after
    found = circle(arm()).slowed(sample, 1.0, np.array(d))
    assert found.t[-1] == pytest.approx(time, rel=1e-3)
    begun, ended = (np.arctan2(q[0], q[1]) / 2 for q in (found.q[0], found.q[-1]))
    assert (ended - begun) % np.pi == pytest.approx(way, rel=2e-3)


def test_no_axis_of_a_robot_is_slowed_by_more_than_it_may_be():
    """From everywhere on a cycle of a UR10, each axis as much as the cycle itself slows it."""
    scene, motion = example("ur10_machine_tending")
    path, d = CyclePath(scene.model, motion), 1.05 * np.abs(motion.a).max(axis=0)
    most = 0.0
    for sample in range(0, len(motion.t), 60):
        found = path.slowed(sample, 1.0, d)
        most = max(most, float((-np.sign(found.v) * found.a / d).max()))
    assert most == pytest.approx(1.0, abs=1e-9)


def test_what_rests_stays():
    path = at_constant_speed(turntable(), 0.0)
    found = path.slowed(4, 1.0, np.array([4.0]))
    assert (found.t.tolist(), found.v.tolist()) == ([0.0], [[0.0]])


#: Way and time of a stop from 1 rad/s, by the cycle's own acceleration and d: v^2/(2 d) and v/d,
#: unless the cycle by itself slows down by more.
RAMPS = {
    "speeding up": (8.0, 4.0, 1 / 8, 1 / 4),
    "slowing down": (-8.0, 16.0, 1 / 32, 1 / 16),
    "slowing down by more": (-8.0, 4.0, 1 / 16, 1 / 8),
}


@pytest.mark.parametrize("name", RAMPS)
def test_the_whole_deceleration_counts(name):
    """p'' sigma^2 is part of it: on a ramp, too, an axis stops as if it were slowed by d alone."""
    own, d, way, time = RAMPS[name]
    t = np.append(np.linspace(0.0, 0.125, 126), [0.2, 0.3])
    v = np.maximum(1.0 + own * t, 0.0)[:, None]
    q = (
        (t + own * t**2 / 2)[:, None]
        if own > 0
        else np.where(t <= 0.125, t - 4 * t**2, 1 / 16)[:, None]
    )
    a = np.where((t < 0.125) | (own > 0), own, 0.0)[:, None]
    scene = turntable()
    path = CyclePath(scene.model, pf.Trajectory.from_arrays(scene, t, q, v, a))
    with np.errstate(all="raise"):
        found = path.slowed(0, 1.0, np.array([d]))
    assert found.q[-1] == pytest.approx([way], rel=2e-3)
    assert found.t[-1] == pytest.approx(time, rel=0.01)
    assert not found.v[-1].any()
    assert -found.a[found.v[:, 0] > 0.02] == pytest.approx(max(d, -own), rel=1e-9)
