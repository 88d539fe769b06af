"""Paths: stops, far points, kinks, via points."""

import numpy as np
import pytest
from retime_cases import MOTORS, one_joint, planar
from scipy.interpolate import PPoly

import pinfric as pf
from pinfric.retiming.path import Path
from pinfric.retiming.retime import retime


def test_stops_that_are_left_at_once_the_other_way():
    """The sample beside such a stop is a reversal: friction at rest counts both ways there."""
    way = Path.from_waypoints([[0.0, 0.0], [1.0, 0.4], [0.2, -0.5], [0.7, 0.1], [0.1, 0.5]])
    assert retime(planar(), way, MOTORS).excess < 1e-3


@pytest.mark.slow
def test_far_points_that_miss_the_way_are_set_nearer():
    """A curved path on which a third of the requested points find no speed at one place."""
    points = np.random.default_rng(7).uniform(-1.6, 1.6, (3, 6, 2))[2]
    path = Path.spline(np.arange(6.0), points)
    motors = {"a": {"peak_torque": 0.6, "effort": 30.0}, "b": {"peak_torque": 0.25}}
    found = retime(planar(), path, motors)
    assert found.excess < 1e-3
    finest = retime(planar(), path, motors, points=3200)
    assert found.duration == pytest.approx(finest.duration, rel=3e-3)


ENDS, THREE = [[0.0], [1.0]], [[0.0], [0.5], [1.0]]
MIDDLE = [False, True, False]


@pytest.mark.parametrize(
    ("points", "more", "message"),
    [
        ([*ENDS, [1.0]], {}, r"points\[2\]: the same position as points\[1\]"),
        ([*ENDS, [0.5]], {"via": MIDDLE}, r"no joint moves with s at s = 0.875"),
        (ENDS, {"holds": [0.0, -1.0]}, r"stop 1: hold -1 s, should be 0 or more"),
        (
            THREE,
            {"via": MIDDLE, "holds": [0.0, 1.0, 0.0]},
            "a via point is passed without a stop and cannot",
        ),
        (ENDS, {"attached": [[True]]}, "attached need one entry for each of 2 points"),
        (THREE, {"attached": [True, True, False]}, r"attached: shape \(3,\)"),
        (ENDS, {"via": [True, False]}, r"points\[0\].via"),
    ],
)
def test_points_that_are_no_path_are_refused(points, more, message):
    with pytest.raises(pf.PinfricError, match=message):
        Path.from_waypoints(points, **more)


def test_corners_and_payloads_that_are_not_there_are_refused():
    bent = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [1.0, 0.0]]])
    with pytest.raises(pf.PinfricError, match="a corner at s = 1"):
        Path((PPoly(bent, np.arange(3.0)),))
    load = Path.from_waypoints(ENDS, attached=[[True], [True]])
    with pytest.raises(pf.RetimeError, match="1 columns for 0 payloads"):
        retime(one_joint(), load, {"j": {"peak_torque": 1.0}})


def test_a_motion_that_turns_back_between_samples_stops_there():
    scene = one_joint()
    t = np.linspace(0.0, 2.0, 402)
    swing = 1.0 - np.cos(np.pi * t)  # to 2 rad at 1 s, between two samples, and back
    move = pf.Trajectory.from_arrays(scene, t, swing[:, None])
    path = Path.from_trajectory(move)
    assert len(path.pieces) == 2
    assert path.stop(1) == pytest.approx([2.0], abs=1e-4)
    found = retime(scene, path, {"j": {"peak_torque": 8.0}})
    assert found.moves == pytest.approx([2.0 * np.sqrt(2.0 / 4.0)] * 2, rel=1e-3)


def test_via_points_are_passed_without_a_stop(tmp_path):
    scene = planar()
    text = """pinfric_trajectory: 1
points:
  - {q: [0.0, 0.0]}
  - {q: [0.6, 0.3], via: true}
  - {q: [1.0, -0.4], hold: 0.3}
"""
    file = tmp_path / "way.yaml"
    file.write_text(text)
    passing = retime(scene, str(file), MOTORS, points=100)
    file.write_text(text.replace(", via: true", ""))
    stopping = retime(scene, str(file), MOTORS, points=100)
    assert len(passing.moves) == 1
    assert passing.duration < 0.95 * stopping.duration
    file.write_text(text)
    with pytest.raises(pf.PinfricError, match=r"points\[1\].via: a point without a stop"):
        pf.load_trajectory(file, scene)
    file.write_text(text.replace("via: true", "via: true, hold: 1"))
    with pytest.raises(pf.PinfricError, match=r"points\[1\]: `via` passes it without a stop"):
        retime(scene, str(file), MOTORS)
