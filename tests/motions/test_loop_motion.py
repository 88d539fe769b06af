"""Files of motions of closed loops: the joints they may leave out."""

from pathlib import Path

import numpy as np
import pytest
from builders import example
from cases import crank_motion
from log_cases import write_csv
from mechanisms import four_bar
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.errors import (
    TrajectoryError,
)

ROBOTS = Path(__file__).parents[2] / "robots"


def test_a_csv_names_only_the_independent_joint(tmp_path):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    t = np.linspace(0, 1, 400)
    angle = 0.5 + 2 * t
    names = "crank_pin", "crank_pin.v", "crank_pin.a"
    rows = np.column_stack([angle, 2 + 0 * t, 0 * t])
    path = write_csv(tmp_path / "turn.csv", t, names, rows, "%.17g")
    motion = pf.load_trajectory(path, scene)
    assert motion.joint_names == scene.joint_names
    _, joints = four_bar()
    q, v, a = crank_motion(joints, angle, 2.0, 0.0)
    order = [scene.joint_names.index(n) for n in ("crank_pin", "coupler_pin", "ground_pin")]
    position = motion.joint_positions()[:, order]
    assert_allclose(np.sin(position), np.sin(q), atol=1e-12)
    assert_allclose(motion.v[:, order], v, atol=1e-11)
    assert_allclose(motion.a[:, order], a, atol=1e-10)


def test_all_joints_named_without_derivatives_are_made_consistent(tmp_path):
    scene, whole = example(ROBOTS / "four_bar.yaml", ROBOTS / "four_bar.waypoints.yaml")
    t, position = whole.t[100:400], whole.joint_positions()[100:400]
    path = write_csv(tmp_path / "all.csv", t, scene.joint_names, position, "%.17g")
    motion = pf.load_trajectory(path, scene)
    pf.inverse_dynamics(scene, motion)  # refuses what violates the loop
    assert_allclose(motion.v[5:-5], whole.v[105:395], rtol=1e-4, atol=1e-4)
    write_csv(path, t, scene.joint_names, position, "%.6f")
    motion = pf.load_trajectory(path, scene)  # 5e-7 off, by rounding
    pf.inverse_dynamics(scene, motion)
    assert any("loops closed by correcting joints" in line for line in motion.warnings)


def test_a_file_with_a_wrong_number_of_joints_is_refused(tmp_path):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    path = tmp_path / "two.csv"
    path.write_text("t,crank_pin,ground_pin\n0,0.5,1.5\n1,0.6,1.5\n")
    with pytest.raises(TrajectoryError, match=r"names 2 joints .* leave 1 independent: name 1,"):
        pf.load_trajectory(path, scene)


def test_a_file_that_leaves_the_mechanisms_reach_says_at_which_sample(tmp_path):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    t = np.linspace(0, 1, 50)  # the rocker cannot lie down
    path = write_csv(tmp_path / "rocker.csv", t, ["ground_pin"], 1.5 - 1.5 * t, "%.17g")
    with pytest.raises(TrajectoryError, match=r"rocker.csv: loop 'rocker_pin' cannot close at sam"):
        pf.load_trajectory(path, scene)
