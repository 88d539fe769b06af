"""The reduced, Pinocchio-based solution against the paper's formulation in absolute coordinates.

No code is shared: RNEA on the wrench twin, and eq. (1)-(17) with Euler parameters, full pivoting
and the fixed-point loop over (16) and (17).
"""

import numpy as np
import pytest
from paper_cases import three_pins

import pinfric as pf
from pinfric.paper.examples import pendulum, three_link
from pinfric.paper.inverse import inverse

STICK = 1e-6


def motions(degrees, seed):
    """(T, n) smooth motions through sliding, reversing and sticking states of every joint."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 3.0, 61)[:, None]
    frequency, phase = rng.uniform(1, 4, (2, degrees))
    amplitude = rng.uniform(0.3, 1.2, degrees)
    angle = amplitude * np.sin(frequency * t + phase)
    rate = amplitude * frequency * np.cos(frequency * t + phase)
    acceleration = -amplitude * frequency**2 * np.sin(frequency * t + phase)
    for joint in range(degrees):  # each joint stands still for a while, all at rest at the end
        rest = (t[:, 0] > 0.5 + joint * 0.4) & (t[:, 0] < 1.1 + joint * 0.4) | (t[:, 0] > 2.7)
        rate[rest, joint] = 0.0
        acceleration[rest, joint] = 0.0
    rate[5] = STICK * 0.999  # at the edge of sticking, from both sides
    rate[6] = STICK * 1.001
    return angle, rate, acceleration


def assert_equal_formulations(scene, mechanism, motion, friction_of):
    """Compare efforts (both ends), loads, friction and reactions, to 1e-9 of the largest effort."""
    judge = inverse(mechanism, *motion)
    result = pf.inverse_dynamics(scene, *motion)
    plain = ~result.reversal.any(axis=1)  # between samples: the paper knows single states only
    scale = np.abs(judge.effort_upper).max()
    assert result.sticking.any()
    assert not result.sticking.all()
    pairs = [
        (result.effort_lower, judge.effort_lower),
        (result.effort_upper, judge.effort_upper),
        (result.effort_frictionless, judge.effort_frictionless),
        (result.normal_load, judge.normal_load),
        (result.friction_lower, judge.friction_lower),
        (result.friction_upper, judge.friction_upper),
        (pf.joint_wrenches(scene, *motion), judge.wrench),
        (result.wrench, judge.wrench[:, friction_of]),
    ]
    for ours, theirs in pairs:
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours[plain], theirs[plain], rtol=0, atol=1e-9 * scale)
    np.testing.assert_array_equal(result.sticking, judge.sticking)
    assert (result.effort_upper - result.effort_lower)[plain].max() > 1e-3 * scale


@pytest.mark.parametrize("seed", range(4))
def test_pendulum(seed):
    example = pendulum()
    scene = pf.load_scene("pendulum")
    assert_equal_formulations(scene, example.mechanism, motions(1, seed), [0])


@pytest.mark.parametrize("seed", range(4))
def test_three_link_robot(seed):
    example = three_link()
    scene = pf.load_scene("three_link")
    assert_equal_formulations(scene, example.mechanism, motions(3, seed), [1])


@pytest.mark.parametrize("seed", range(3))
def test_three_link_robot_with_friction_in_every_joint(seed):
    scene, mechanism = three_pins()
    assert_equal_formulations(scene, mechanism, motions(3, 10 + seed), [0, 1, 2])
