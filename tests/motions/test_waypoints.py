"""Profiles between way-points, in closed form, and moves too short to sample."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from trajectory_cases import arm_scene, message, one_joint_scene, write

from pinfric.errors import TrajectoryError
from pinfric.motions.joint_columns import JointColumn
from pinfric.motions.log.reading import ReadingOptions
from pinfric.motions.trajectory import load_trajectory
from pinfric.motions.waypoints import (
    WayPointFile,
    quintic,
    read_waypoints,
    sample_waypoints,
    trapezoidal,
    waypoints_text,
)


def test_quintic_closed_form_values():
    b, rate, curvature = quintic(np.array([0.0, 0.25, 0.5, 1.0]))
    assert_allclose(b, [0, 0.103515625, 0.5, 1], atol=1e-15)
    assert_allclose(rate, [0, 1.0546875, 1.875, 0], atol=1e-15)
    assert_allclose(curvature, [0, 5.625, 0, 0], atol=1e-15)


def test_trapezoidal_closed_form_values():
    # ramp 1/4: peak 4/3, acceleration 16/3; at s = 1/4 the distance is 1/2 x 1/4 x 4/3 = 1/6
    b, rate, curvature = trapezoidal(np.array([0.0, 0.125, 0.25, 0.5, 0.75, 0.875, 1.0]), 0.25)
    assert_allclose(b, [0, 1 / 24, 1 / 6, 0.5, 5 / 6, 23 / 24, 1], atol=1e-15)
    assert_allclose(rate, [0, 2 / 3, 4 / 3, 4 / 3, 4 / 3, 2 / 3, 0], atol=1e-15)
    assert_allclose(curvature, np.array([16, 16, 0, 0, -16, -16, -16]) / 3, atol=1e-14)


@pytest.mark.parametrize("profile", [quintic, lambda s: trapezoidal(s, 0.3)])
def test_profiles_are_integrals_of_their_derivatives(profile):
    s = np.linspace(0, 1, 20001)
    b, rate, curvature = profile(s)
    steps = np.diff(s)
    assert_allclose(np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps), b[1:], atol=1e-8)
    assert_allclose(np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * steps), rate[1:], atol=1e-3)


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


def test_more_points_than_a_person_writes_are_a_log(tmp_path):
    """Before they are parsed, which takes 0.3 ms each."""
    way = tmp_path / "long.yaml"
    way.write_text("pinfric_trajectory: 1\npoints: [" + "{q: [0.1]}, " * 10_001 + "]\n")
    with pytest.raises(TrajectoryError, match=r"long.yaml: has 10001 points; .* as a CSV table"):
        load_trajectory(way, arm_scene())


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
    assert_allclose(motions[0].position, motions[1].position, atol=1e-14)
    assert_allclose(motions[0].velocity, motions[1].velocity, atol=1e-13)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"unit": "deg"}, "write `unit: deg` in the file in place of --unit"),
        ({"columns": "names.yaml"}, "--columns says which column of a log is what, .*: leave it"),
    ],
)
def test_what_is_said_of_a_log_does_not_apply_to_waypoints(option, words, tmp_path):
    path = write(tmp_path, "move.yaml", "pinfric_trajectory: 1\npoints: [{q: [0]}, {q: [1]}]\n")
    with pytest.raises(TrajectoryError, match=words):
        load_trajectory(path, one_joint_scene(), ReadingOptions(**option))


def test_points_that_fit_the_limits_only_in_degrees_are_asked_about():
    points = [{"q": [0, 0]}, {"q": [-90, 5], "duration": 1}]
    waypoints = WayPointFile(pinfric_trajectory=1, points=points)
    with pytest.raises(TrajectoryError, match=r"angles up to 90 .* add `unit: deg`"):
        sample_waypoints(waypoints, two_joints(), {}, "file")


def test_waypoints_make_the_closed_form_motion(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
sample_rate: 100
points:
  - {q: [0.0, 0.1, 0.0], hold: 0.5}
  - {q: [1.0, 0.3, -4.0], duration: 2.0, hold: 0.25}
""",
    )
    motion = load_trajectory(path, arm_scene())
    assert motion.duration == pytest.approx(2.75)
    assert motion.t.size == 276
    middle = np.searchsorted(motion.t, 1.5 - 1e-9)
    assert_allclose(motion.v[middle], 1.875 / 2 * np.array([1.0, 0.2, -4.0]), rtol=1e-12)
    quarter = np.searchsorted(motion.t, 1.0 - 1e-9)
    assert_allclose(motion.a[quarter], 5.625 / 4 * np.array([1.0, 0.2, -4.0]), rtol=1e-12)
    assert_allclose(motion.q[quarter, 0], 0.103515625, rtol=1e-12)
    assert_allclose(motion.q[-1], [1.0, 0.3, np.cos(-4.0), np.sin(-4.0)], rtol=1e-12)


def test_waypoint_holds_are_exactly_still(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
profile: trapezoidal
sample_rate: 100
points:
  - {q: [0.1], hold: 0.3}
  - {q: [0.7], duration: 0.7, hold: 0.2}
  - {q: [-0.3], duration: 1.0}
""",
    )
    motion = load_trajectory(path, one_joint_scene())
    holds = motion.holds()
    assert [(h.start, h.end) for h in holds] == [(0.0, 0.3), (1.0, 1.2)]
    for hold in holds:
        inside = slice(hold.first, hold.last + 1)
        assert (motion.v[inside] == 0).all()
        assert (motion.a[inside] == 0).all()
        assert np.ptp(motion.q[inside]) == 0
    # elsewhere it moves, except where it arrives
    still = (motion.v[:, 0] == 0) & (motion.a[:, 0] == 0)
    assert still.sum() == 31 + 21 + 1
    assert still[-1]


def test_a_point_without_hold_takes_the_next_moves_acceleration(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
profile: trapezoidal
ramp: 0.5
sample_rate: 100
points: [{q: [0.0]}, {q: [1.0], duration: 1.0}, {q: [0.5], duration: 1.0}]
""",
    )
    motion = load_trajectory(path, one_joint_scene())
    assert motion.a[0, 0] == pytest.approx(4.0)
    assert motion.v[100, 0] == 0.0
    assert motion.a[100, 0] == pytest.approx(-2.0)  # -0.5 x 4 / 1 s^2
    assert motion.holds() == ()


@pytest.mark.parametrize(
    ("profile", "factor"), [("quintic", 15 / 8), ("trapezoidal", 1.5), ("ramp", 1 / 0.8)]
)
def test_missing_duration_uses_the_slowest_joints_velocity_limit(tmp_path, profile, factor):
    kind = "{profile: trapezoidal, ramp: 0.2" if profile == "ramp" else f"{{profile: {profile}"
    path = write(
        tmp_path,
        "move.yaml",
        f"""{kind}, pinfric_trajectory: 1, speed: 0.5,
sample_rate: 1000, points: [{{q: [0, 0, 0]}}, {{q: [1.0, 0.1, 0.0]}}]}}""",
    )
    motion = load_trajectory(path, arm_scene())
    needed = factor * 1.0 / (0.5 * 1.0)
    assert needed <= motion.duration + 1e-12 < needed + 0.001 + 1e-9
    assert np.abs(motion.v[:, 0]).max() == pytest.approx(0.5, rel=1e-3)
    assert motion.warnings == ()


def test_missing_duration_without_limits_is_an_error(tmp_path):
    path = write(
        tmp_path, "move.yaml", "{pinfric_trajectory: 1, points: [{q: [0,0,0]}, {q: [0,0,1]}]}"
    )
    assert "points[1]: needs a `duration`" in message(path, arm_scene())
    assert message(path, arm_scene()).endswith("for c")


def test_end_off_the_sample_grid_is_a_sample(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
{pinfric_trajectory: 1, sample_rate: 10, points: [{q: [0.0]}, {q: [1.0], duration: 0.95}]}
""",
    )
    motion = load_trajectory(path, one_joint_scene())
    assert_allclose(motion.t[-2:], [0.9, 0.95])
    assert motion.q[-1, 0] == 1.0
    assert motion.v[-1, 0] == 0.0


def test_waypoint_joint_order_is_free(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
{pinfric_trajectory: 1, joints: [c, a, b], points: [{q: [0.3, 1.0, 0.2], hold: 0.01}]}
""",
    )
    motion = load_trajectory(path, arm_scene())
    assert_allclose(motion.joint_positions()[0], [1.0, 0.2, 0.3])
    assert motion.joint_names == ("a", "b", "c")


def test_payload_phases_begin_on_arrival(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
sample_rate: 10
points:
  - {q: [0.0], detach: tool}
  - {q: [1.0], duration: 1.0, hold: 0.5, attach: [box]}
  - {q: [0.0], duration: 1.0, hold: 0.2, detach: box}
""",
    )
    motion = load_trajectory(path, one_joint_scene(box=False, tool=True, cable=True))
    assert motion.payload_names == ("box", "tool", "cable")
    carried = motion.t[motion.attached[:, 0]]
    assert carried[0] == pytest.approx(1.0)
    assert carried[-1] == pytest.approx(2.4)
    assert not motion.attached[:, 1].any()
    assert motion.attached[:, 2].all()


def test_bad_waypoints_are_listed_together(tmp_path, monkeypatch):
    monkeypatch.setattr("pinfric.errors._MOST_PROBLEMS", 99)
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
ramp: 0.2
joints: [a, bb, c]
points:
  - {q: [0, 0, 0], duration: 1.0, attach: box}
  - {q: [0, 0], duration: 1.0, attach: bax}
""",
    )
    text = message(path, arm_scene(box=True))
    for part in (
        "7 problems",
        "unknown joint 'bb'",
        "missing b",
        "points[0].duration",
        "'box' is attached already",
        "unknown payload 'bax'",
        "points[1].q: 2 numbers for 3 joints",
        "ramp: belongs to profile: trapezoidal",
    ):
        assert part in text, part


def test_unknown_waypoint_keys_name_the_nearest(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
{pinfric_trajectory: 1, sample_rat: 100, points: [{q: [0.0], hlod: 1.0}, {q: [.nan]}]}
""",
    )
    text = message(path, one_joint_scene())
    assert "unknown key `sample_rat`" in text
    assert "unknown key `points[0].hlod`" in text
    assert "points[1].q[0]" in text


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("points: [{q: [0.0]}]", "`pinfric_trajectory` is missing"),
        ("{pinfric_trajectory: 1, points: []}", "points"),
        ("[1, 2]", "should be a mapping"),
        ("", "the file is empty"),
        ("{points: [", "not valid YAML"),
        ("{pinfric_trajectory: 1, points: [{q: [true]}]}", "points[0].q[0]"),
        ("{pinfric_trajectory: 1, points: [{q: [0.0]}, {q: [1.0], duration: 1.0e+9}]}", "samples"),
        (
            "{pinfric_trajectory: 1, points: [{q: [0.0]}, {q: [2.5]}]}",
            "joint a: 2.5 rad is above its upper limit 2 (first at t = ",
        ),
    ],
)
def test_bad_waypoint_files(tmp_path, text, part):
    assert part in message(write(tmp_path, "move.yaml", text), one_joint_scene())


def test_a_misspelt_payload_is_not_said_to_be_let_go_twice(tmp_path):
    points = "[{q: [0.0], attach: bx}, {q: [1.0], duration: 1.0, detach: box}]"
    text = f"pinfric_trajectory: 1\nsample_rate: 10\npoints: {points}\n"
    path = write(tmp_path, "move.yaml", text)
    said = message(path, one_joint_scene(box=False))
    assert "unknown payload 'bx'" in said
    assert "detached already" not in said


def test_a_file_that_fails_while_it_is_read_is_refused(tmp_path):
    way = tmp_path / "broken.yaml"
    way.symlink_to("/proc/self/mem")  # a regular file, whose first byte is an I/O error
    with pytest.raises(TrajectoryError, match=r"broken.yaml: cannot be read: Input/output error"):
        load_trajectory(way, arm_scene())


def test_what_is_written_is_read_back_whatever_joints_are_called(tmp_path):
    names = ("yes", "1.5", "a: b, [c]", "# d")
    file = WayPointFile(
        pinfric_trajectory=1,
        profile="trapezoidal",
        ramp=0.25,
        sample_rate=250,
        joints=names,
        points=(
            {"q": [0.0, -0.5, 1.25, 1e-6], "hold": 0.5},
            {"q": [1.0, 2.0, -3.0, 0.0], "duration": 1.5},
            {"q": [0.0, 0.0, 0.0, 0.0], "hold": 0.25},
        ),
    )
    path = write(tmp_path, "motion.yaml", waypoints_text(file, ["Of joints", "", "  with names"]))
    assert path.read_text().startswith("# Of joints\n#\n#   with names\n")
    assert read_waypoints(path) == file
