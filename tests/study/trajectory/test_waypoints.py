"""The profiles between way-points, in closed form, and moves too short to sample (files:
test_trajectory.py)."""

import numpy as np
import pytest

from pinfric.errors import TrajectoryError
from pinfric.study.trajectory.joint_columns import JointColumn
from pinfric.study.trajectory.waypoints import (
    WayPointFile,
    quintic,
    read_waypoints,
    sample_waypoints,
    trapezoidal,
)


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


# --- moves too short to be sampled ---------------------------------------------------------------


def sampled(*points, sample_rate=1000.0):
    """Samples of a one-joint way-point file; 1 rad/s at most."""
    waypoints = WayPointFile(pinfric_trajectory=1, sample_rate=sample_rate, points=points)
    joint = JointColumn("a", 0, 0, 1, "rad", -np.inf, np.inf, 1.0)
    return sample_waypoints(waypoints, [joint], {}, "file")


@pytest.mark.parametrize(
    ("rate", "duration"), [(1000, 1e-5), (1000, 3.9e-3), (1, 3.0), (0.001, 1.0)]
)
def test_a_move_shorter_than_a_few_samples_is_refused(rate, duration):
    with pytest.raises(TrajectoryError) as caught:
        sampled({"q": [0]}, {"q": [1], "duration": duration}, sample_rate=rate)
    problem = str(caught.value)
    assert problem.startswith(f"file: points[1].duration: {duration:g} s is too short for")
    assert f"at least 4 sample periods, {4 / rate:g} s" in problem


def test_a_move_of_four_samples_shows_its_velocity():
    motion = sampled({"q": [0]}, {"q": [1], "duration": 0.004})
    assert np.abs(motion.velocity).max() == pytest.approx(15 / 8 / 0.004)


def test_a_stay_may_be_as_short_as_it_likes():
    motion = sampled({"q": [1]}, {"q": [1], "duration": 1e-5, "hold": 0.01})
    assert (motion.velocity == 0).all()


def test_a_tiny_move_without_duration_takes_four_samples():
    motion = sampled({"q": [0]}, {"q": [1e-4]}, {"q": [1e-4], "hold": 0.01})
    assert motion.t[-1] == pytest.approx(0.014)
    assert np.abs(motion.velocity).max() > 0


@pytest.mark.parametrize("rate", ["1.0e-300", "1.0e+300", "0", "-5", "true"])
def test_sample_rates_that_cannot_be_meant(tmp_path, rate):
    path = tmp_path / "w.yaml"
    path.write_text(f"{{pinfric_trajectory: 1, sample_rate: {rate}, points: [{{q: [0]}}]}}")
    with pytest.raises(TrajectoryError, match="sample_rate"):
        read_waypoints(path)


def test_a_way_beyond_all_bounds_is_refused_for_its_samples():
    with pytest.raises(TrajectoryError, match="samples; at most"):
        sampled({"q": [0]}, {"q": [1e12]})


# --- angles in degrees ---------------------------------------------------------------------------


def two_joints():
    """A joint that turns, +-2 rad, and one that slides, +-300 m."""
    turning = JointColumn("a", 0, 0, 1, "rad", -2.0, 2.0, 1.0)
    return [turning, JointColumn("b", 1, 1, 1, "m", -300.0, 300.0, 1e3)]


def test_degrees_are_of_angles_only():
    points = [{"q": [0, 0]}, {"q": [90, 90], "duration": 1}]
    motions = [
        sample_waypoints(
            WayPointFile(pinfric_trajectory=1, unit=unit, points=q), two_joints(), {}, "file"
        )
        for unit, q in (("deg", points), ("rad", [points[0], points[1] | {"q": [np.pi / 2, 90]}]))
    ]
    np.testing.assert_allclose(motions[0].position, motions[1].position, atol=1e-14)
    np.testing.assert_allclose(motions[0].velocity, motions[1].velocity, atol=1e-13)


def test_points_that_fit_the_limits_only_in_degrees_are_asked_about():
    points = [{"q": [0, 0]}, {"q": [-90, 5], "duration": 1}]
    waypoints = WayPointFile(pinfric_trajectory=1, points=points)
    with pytest.raises(TrajectoryError, match=r"angles up to 90 .* add `unit: deg`"):
        sample_waypoints(waypoints, two_joints(), {}, "file")
