"""Where a recording rests: at the ends of one move."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain
from log_cases import ARM, write_csv
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.motions.log.still import find_noisy_holds, with_resting_ends


def quintic(t, duration):
    """A move from 0 to 1 at rest at both ends: position, velocity, acceleration."""
    u = t / duration
    return (
        10 * u**3 - 15 * u**4 + 6 * u**5,
        (30 * u**2 - 60 * u**3 + 30 * u**4) / duration,
        (60 * u - 180 * u**2 + 120 * u**3) / duration**2,
    )


@pytest.mark.parametrize("decimals", [4, 5, 6, 7, 8, 10])
def test_one_rounded_move_starts_and_ends_at_rest(tmp_path, decimals):
    """Its break-away torques are larger than those of the motion, and its ends stay."""
    scene = pf.load_scene("ur5_pick_and_place")
    t = np.arange(201) * 0.01
    way = np.array([-0.8, 0.12, 0.08, -0.2, 0.0, -0.8])
    start = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
    s, v, a = (np.outer(x, way) for x in quintic(t, 2.0))
    form = f"%.{decimals}f"
    file = write_csv(tmp_path / "move.csv", t, scene.joint_names, start + s, form)
    found = pf.load_trajectory(file, scene)
    assert len(found.t) == 201
    assert (found.v[[0, -1]] == 0).all()
    assert (found.a[[0, -1]] == 0).all()
    assert_allclose(found.v, v, atol=0.02 * np.abs(v).max())

    def peaks(*motion):
        result = pf.inverse_dynamics(scene, *motion, t=t)
        ends = np.abs([result.effort_lower, result.effort_upper])
        return ends.max(axis=(0, 1))

    exact = peaks(start + s, v, a)
    assert_allclose(peaks(found.q, found.v, found.a), exact, rtol=0.02, atol=0.1)


def swing(t):
    return 0.5 * np.cos(3.0 * t)


def ramp(t):
    return 0.3 * t + 0.05 * np.sin(2.0 * t)


@pytest.mark.parametrize("motion", [swing, ramp])
def test_a_turning_point_and_a_start_at_speed_are_no_rest(motion):
    t = np.arange(400) * 0.01
    noise = 1e-5 * np.random.default_rng(0).normal(size=400)
    position = (motion(t) + noise)[:, None]
    assert with_resting_ends(position, 0.01, [1e-5], [[]]) == [[]]


def test_a_joint_that_hardly_moves_follows_the_others():
    t, chance = np.arange(400) * 0.01, np.random.default_rng(1)
    s = quintic(t, t[-1])[0]
    position = np.outer(s, [1.0, 2e-4]) + 3e-5 * chance.normal(size=(400, 2))
    ends = [(0, 0), (399, 399)]
    assert with_resting_ends(position, 0.01, [3e-5, 3e-5], [[], []]) == [ends, ends]
    assert with_resting_ends(position[:, 1:], 0.01, [3e-5], [[]]) == [[]]
    assert with_resting_ends(position, 0.01, [3e-5, 0.0], [[], []]) == [ends, []]


def test_a_slow_motion_is_no_hold():
    t = np.arange(0, 4, 0.002)
    noise = 1e-5 * np.random.default_rng(3).normal(size=t.size)
    creeping, turning = 1e-3 * t, 0.05 * np.cos(t)
    for q in (creeping, turning):
        assert find_noisy_holds((q + noise)[:, None], 0.002, [1e-5]) == [[]]
    assert find_noisy_holds(noise[:, None], 0.002, [1e-5]) == [[(0, t.size - 1)]]


def test_a_joint_that_stands_still_in_a_noisy_log_is_held(tmp_path):
    model = chain(*((name, pin.JointModelRZ(), ARM) for name in ("moves", "stays", "fixed")))
    scene, rng, t = pf.Scene(model=model), np.random.default_rng(4), np.arange(0, 4, 0.002)
    q = np.column_stack((np.sin(2 * t), np.full(t.size, 0.7), np.full(t.size, -0.3)))
    q[:, :2] += 1e-5 * rng.normal(size=(t.size, 2))
    motion = pf.load_trajectory(write_csv(tmp_path / "a.csv", t, model.names[1:], q), scene)
    assert not motion.v[:, 1:].any()
    assert not motion.a[:, 1:].any()
    t = motion.t
    assert_allclose(motion.v[:, 0], 2 * np.cos(2 * t), atol=2e-3)
    assert_allclose(motion.a[:, 0], -4 * np.sin(2 * t), atol=0.1)  # also at the ends
    assert_allclose(motion.a[300:-300, 0], -4 * np.sin(2 * t)[300:-300], atol=0.02)


def test_a_hold_shorter_than_the_ramps_beside_it_has_its_own_ends():
    """It slows down by 0.2 rad/s^2, stands for 0.12 s and speeds up as slowly."""
    t = 0.002 * np.arange(2000)
    first, last = 1000, 1060
    q = 0.1 * (np.maximum(t - t[last], 0.0) ** 2 - np.maximum(t[first] - t, 0.0) ** 2)
    noise = 1e-5 * np.random.default_rng(1).normal(size=t.size)
    ((found,),) = find_noisy_holds((q + noise)[:, None], 0.002, [1e-5])
    assert found == pytest.approx((first, last), abs=5)
