"""Splines through sampled positions, and the holds found in them."""

import numpy as np
import pytest
from builders import pick_and_place
from numpy.testing import assert_allclose

from pinfric.motions.derivatives import (
    SPLINE_GAINS,
    find_holds,
    position_derivatives,
    velocity_derivative,
)


def test_spline_orders_on_a_sine():
    errors = []
    for count in (41, 81, 161):
        t = np.linspace(0, 2, count)
        v, a = position_derivatives(t, np.sin(3 * t), [])
        from_v = velocity_derivative(t, 3 * np.cos(3 * t), [])
        exact_a = -9 * np.sin(3 * t)
        errors.append(
            [
                np.abs(v - 3 * np.cos(3 * t)).max(),
                np.abs(a - exact_a).max(),
                np.abs(from_v - exact_a).max(),
            ]
        )
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert (orders > [4.8, 3.8, 4.8]).all()
    assert errors[-1][0] < 1e-8
    assert errors[-1][1] < 4e-6


def test_short_pieces_are_the_polynomial_their_conditions_allow():
    t = np.array([0.0, 0.3, 1.0, 1.2])
    v, a = position_derivatives(t, t**3, [])
    assert_allclose(v, 3 * t**2, atol=1e-12)
    assert_allclose(a, 6 * t, atol=1e-11)
    # between two holds, two samples and six conditions: the quintic from rest to rest
    t = np.arange(6.0)
    v, a = position_derivatives(t, np.array([0, 0, 0, 1, 1, 1.0]), [(0, 2), (3, 5)])
    assert (v == 0).all()
    assert (a == 0).all()


@pytest.mark.parametrize("digits", [3, 4, 6, 9, 17])
def test_holds_are_found_from_rounded_positions(digits):
    t, q, v, _ = pick_and_place(digits)
    resolution = 10.0**-digits
    found = find_holds(q, resolution)
    assert len(found) == 3
    # a cubic start 10 D s^3 stays within the last digit this long
    slack = (resolution / (10 * 0.7)) ** (1 / 3) + 0.001
    for (first, last), (start, end) in zip(found, [(0, 1), (2, 2.5), (3.5, 4)], strict=True):
        assert start - slack <= t[first] <= start
        assert end <= t[last] <= end + slack
    fitted, _ = position_derivatives(t, q, found)
    assert np.abs(fitted - v).max() < 3 * 1.4 * resolution / 0.001 + 1e-9


def test_holds_of_a_precise_file_are_exact():
    t, q, v, a = pick_and_place(12)
    fitted_v, fitted_a = position_derivatives(t, q, find_holds(q, 1e-12))
    still = (t <= 1) | ((t >= 2) & (t <= 2.5)) | (t >= 3.5)
    assert (fitted_v[still] == 0).all()
    assert (fitted_a[still] == 0).all()
    assert ((fitted_v != 0) & (fitted_a != 0)).sum() > 0.99 * (~still).sum()
    assert_allclose(fitted_v, v, atol=1e-8)
    assert_allclose(fitted_a, a, atol=2e-4)


@pytest.mark.parametrize("digits", [3, 4, 6])
def test_rounding_alone_makes_no_holds(digits):
    t = np.arange(0, 3, 0.001)
    for q in (np.cos(t), 0.002 * t, np.cos(5 * t) + 0.1 * t):
        assert find_holds(np.round(q, digits), 10.0**-digits) == []


@pytest.mark.parametrize(
    ("q", "resolution", "expected"),
    [
        (np.zeros(10), 0.0, [(0, 9)]),
        ([0, 0, 0, 1, 1, 1], 1.0, [(0, 2), (3, 5)]),
        ([0, 1, 1, 0], 0.0, []),  # two equal samples: a turning point would look the same
        ([0, 0, 0, 0.2, 0, 0, 0], 0.0, [(0, 2), (4, 6)]),
        (0.1 + np.array([0, 1e-17, 0, 0.5, 1]), 0.0, [(0, 2)]),
    ],
)
def test_hold_cases(q, resolution, expected):
    assert find_holds(q, resolution) == expected


def test_staircase_longer_than_one_window():
    q = np.floor(np.arange(5000) / 500) * 1e-9  # steps of one digit, then a jump
    q = np.concatenate((q, q[-1:] + 1.0, np.full(400, q[-1] + 1.0)))
    assert find_holds(q, 1e-9)[-1] == (5000, 5400)


def test_the_gain_of_noise_in_accelerations_is_the_measured_one():
    rng = np.random.default_rng(1)
    t = np.arange(4000) * 0.002
    noise = rng.uniform(-0.5e-4, 0.5e-4, t.size)
    _, a = position_derivatives(t, noise, [])
    assert a[10:-10].std() == pytest.approx(SPLINE_GAINS[1] * noise.std() / 0.002**2, rel=0.1)
