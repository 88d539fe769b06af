"""The profiles between way-points, in closed form (files: test_trajectory.py)."""

import numpy as np
import pytest

from pinfric.study.waypoints import quintic, trapezoidal


def test_quintic_closed_form_values():
    b, rate, curvature = quintic(np.array([0.0, 0.25, 0.5, 1.0]))
    np.testing.assert_allclose(b, [0, 0.103515625, 0.5, 1], atol=1e-15)
    np.testing.assert_allclose(rate, [0, 1.0546875, 1.875, 0], atol=1e-15)
    np.testing.assert_allclose(curvature, [0, 5.625, 0, 0], atol=1e-15)


def test_trapezoidal_closed_form_values():
    # ramp 1/4: peak 4/3, acceleration 16/3; at s = 1/4 the distance is 1/2 x 1/4 x 4/3 = 1/6
    b, rate, curvature = trapezoidal(np.array([0.0, 0.125, 0.25, 0.5, 0.75, 0.875, 1.0]), 0.25)
    np.testing.assert_allclose(b, [0, 1 / 24, 1 / 6, 0.5, 5 / 6, 23 / 24, 1], atol=1e-15)
    np.testing.assert_allclose(rate, [0, 2 / 3, 4 / 3, 4 / 3, 4 / 3, 2 / 3, 0], atol=1e-15)
    np.testing.assert_allclose(curvature, np.array([16, 16, 0, 0, -16, -16, -16]) / 3, atol=1e-14)


@pytest.mark.parametrize("profile", [quintic, lambda s: trapezoidal(s, 0.3)])
def test_profiles_are_integrals_of_their_derivatives(profile):
    s = np.linspace(0, 1, 20001)
    b, rate, curvature = profile(s)
    steps = np.diff(s)
    np.testing.assert_allclose(np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps), b[1:], atol=1e-8)
    np.testing.assert_allclose(
        np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * steps), rate[1:], atol=1e-3
    )
