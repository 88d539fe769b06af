"""From logged positions to a motion: unwrapped, filtered where it helps, holds kept."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, example, lump
from log_cases import (
    LOADED,
    NAMES,
    Q,
    T,
    load,
    noisy,
    peaks,
    table,
    write_csv,
)
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.motions.log.judged import judge_log
from pinfric.motions.log.motion import _stamps_are_better
from pinfric.motions.log.reading import ReadingOptions
from pinfric.motions.waypoints import quintic


def test_a_recording_of_few_rows_says_that_it_is_not_judged(tmp_path):
    motion = load(tmp_path, table(("t", *NAMES), T[:15], noisy(T)[:15]))
    assert motion.warnings == ("15 rows: too few to separate noise from motion, not filtered",)
    by_hand = Q[:1] + quintic(np.linspace(0.0, 1.0, 15))[0][:, None]  # from rest to rest
    assert not load(tmp_path, table(("t", *NAMES), T[:15] * 20, by_hand)).warnings


@pytest.mark.parametrize("joint", [pin.JointModelRZ, pin.JointModelRUBZ])
def test_wrapped_angles_take_no_effort(joint, tmp_path):
    """At constant speed about a vertical axis no effort is needed, also where the angle wraps."""
    model = chain(("wheel", joint(), lump(2.0, moment=0.5)))
    wrapped = np.angle(np.exp(1j * (2.0 + 1.5 * T)))
    motion = load(tmp_path, table(("t", "wheel"), T, wrapped), scene=pf.Scene(model=model))
    effort = pf.inverse_dynamics(pf.Scene(model=model), motion).effort_upper
    assert np.abs(effort).max() < 1e-3  # 12 digits are written
    assert motion.warnings[0] == "joint wheel: 1 jump of a whole turn removed"


def test_short_logs_are_judged_too(tmp_path):
    motion = load(tmp_path, table(("t", *NAMES), T[:25], noisy(T)[:25]))
    assert "filtered at" in motion.warnings[0]
    assert np.abs(motion.a).max() < 6.0  # 19 by a spline; 1.8 is true


def test_a_log_in_which_nothing_moves_is_a_hold(tmp_path):
    rows = 0.5 + 1e-5 * np.random.default_rng(0).normal(size=Q.shape)
    motion = load(tmp_path, table(("t", *NAMES), T, rows))
    assert motion.warnings == ("every joint is at rest, noise 1.0e-05 to 1.1e-05 rad",)
    assert [(hold.first, hold.last) for hold in motion.holds()] == [(0, 399)]


ROBOTS = Path(__file__).parents[3] / "robots"


def test_what_is_not_filtered_says_so(smooth, tmp_path):
    t, q = smooth.log(500, "2e-5")
    path = write_csv(tmp_path / "log.csv", t, smooth.plans[500].joint_names, q)
    motion = pf.load_trajectory(path, smooth.scene, ReadingOptions(cutoff="none"))
    assert motion.warnings[0].startswith(
        "not filtered, noise 1.9e-05 to 2.1e-05 rad, error left in"
    )
    assert "accelerations 25 rad/s^2" in motion.warnings[0]
    result = pf.inverse_dynamics(smooth.scene, motion)
    off = peaks(result) - smooth.peak
    assert off[1] > 4.0 * smooth.peak[1]
    assert off[1] <= 1.3 * judge_log(result, motion.reading).peak_uncertainty["shoulder_lift_joint"]


def test_a_given_cutoff_is_taken(smooth, tmp_path):
    t, q = smooth.log(500, "1e-5")
    path = write_csv(tmp_path / "log.csv", t, smooth.plans[500].joint_names, q)
    motion = pf.load_trajectory(path, smooth.scene, ReadingOptions(cutoff="2"))
    assert set(motion.reading.cutoff.values()) == {2.0, None}  # wrist 2 stands still
    assert motion.reading.noise_line == "filtered at 2 Hz, noise 9.7e-06 to 1.0e-05 rad"
    result = pf.inverse_dynamics(smooth.scene, motion)
    off = np.abs(peaks(result) - smooth.peak)[LOADED]
    uncertain = np.array(list(judge_log(result, motion.reading).peak_uncertainty.values()))
    assert (off > 0.02 * smooth.peak[LOADED]).any()
    assert (off <= uncertain[LOADED]).all()


@pytest.mark.parametrize("name", ["panda_pick_and_place", "ur5_pick_and_place"])
def test_bundled_files_pass_through_bit_for_bit(name, tmp_path):
    from pinfric.motions.derivatives import find_holds, position_derivatives

    scene, plan = example(ROBOTS / f"{name}.yaml", ROBOTS / f"{name}.csv")
    assert not plan.reading.notes
    cells = np.loadtxt(ROBOTS / f"{name}.csv", delimiter=",", skiprows=1)
    header = (ROBOTS / f"{name}.csv").read_text().splitlines()[0].split(",")
    q = cells[:, [header.index(joint) for joint in plan.joint_names]]
    bare = write_csv(tmp_path / "bare.csv", cells[:, 0], plan.joint_names, q, "%.17g")
    motion = pf.load_trajectory(bare, scene)
    assert not motion.reading.filtered
    assert_array_equal(motion.t, cells[:, 0])
    for i in range(q.shape[1]):
        v, a = position_derivatives(cells[:, 0], q[:, i], find_holds(q[:, i], 1e-16))
        assert_array_equal(motion.v[:, i], v)
        assert_array_equal(motion.a[:, i], a)
    for array, given in (("v", ".v"), ("a", ".a")):
        columns = [header.index(joint + given) for joint in plan.joint_names]
        assert_array_equal(getattr(plan, array), cells[:, columns])


def test_a_plan_printed_with_few_digits_stays_a_plan(jerky, tmp_path):
    plan = jerky.plans[500]
    path = write_csv(tmp_path / "a.csv", plan.t[::2], plan.joint_names, plan.q[::2], "%.7g")
    motion = pf.load_trajectory(path, jerky.scene)
    assert not motion.reading.filtered
    off = np.abs(peaks(pf.inverse_dynamics(jerky.scene, motion)) - jerky.peak)[LOADED]
    assert (off < 0.05 * jerky.peak[LOADED]).all()


@pytest.mark.parametrize("seed", [3, 6])
def test_a_motion_with_power_up_to_its_cutoff_keeps_its_peaks(smooth, seed, tmp_path):
    """Five sines up to 2 Hz, as identification uses them; a Gaussian low pass takes 3 %."""
    rng, t = np.random.default_rng(seed), np.arange(0, 10, 0.002)
    q, v, a = (np.zeros((t.size, 6)) for _ in range(3))
    q += [0.0, -1.2, 1.0, -1.5, -1.5, 0.0]
    for w in 2.0 * np.pi * np.linspace(0.4, 2.0, 5):
        phase = w * t[:, None] + rng.uniform(0, 6, size=6)
        q, v, a = q + 0.3 / w * np.sin(phase), v + 0.3 * np.cos(phase), a - 0.3 * w * np.sin(phase)
    truth = peaks(pf.inverse_dynamics(smooth.scene, q, v, a, t=t))[LOADED]
    path = write_csv(
        tmp_path / "log.csv", t, smooth.plans[500].joint_names, q + 2e-5 * rng.normal(size=q.shape)
    )
    motion = pf.load_trajectory(path, smooth.scene)
    found = peaks(pf.inverse_dynamics(smooth.scene, motion))[LOADED]
    assert_allclose(found, truth, rtol=0.015)  # also where the log ends in motion


@pytest.mark.parametrize("name", ["four_bar", pytest.param("slider_crank", marks=pytest.mark.slow)])
def test_noisy_logs_of_all_joints_of_a_loop_are_closed(name, tmp_path):
    scene, plan = example(ROBOTS / f"{name}.yaml", ROBOTS / f"{name}.waypoints.yaml")
    q = plan.joint_positions() + 1e-5 * np.random.default_rng(1).normal(size=(plan.t.size, 3))
    path = write_csv(tmp_path / "log.csv", plan.t, plan.joint_names, q)
    motion = pf.load_trajectory(path, scene)
    assert "loops closed by correcting joints, " in motion.warnings[-1]
    truth, found = (peaks(pf.inverse_dynamics(scene, m)) for m in (plan, motion))
    assert_allclose(found, truth, rtol=0.01)
    q[:, -1] += 0.05  # no noise: another zero
    open_loop = write_csv(tmp_path / "log.csv", plan.t[:300], plan.joint_names, q[:300])
    with pytest.raises(pf.PinfricError, match=r"is open at sample 0, by 0\.0"):
        pf.inverse_dynamics(scene, pf.load_trajectory(open_loop, scene))


def test_logged_velocities_tell_when_rows_were_taken():
    rng, regular = np.random.default_rng(3), np.arange(400) / 200.0
    stamps = regular + 1e-3 * rng.uniform(-1.0, 1.0, 400)
    for taken in (stamps, regular):
        q, v = np.sin(3.0 * taken)[:, None], 3.0 * np.cos(3.0 * taken)[:, None]
        noise = 5e-5 * rng.normal(size=q.shape)
        found = _stamps_are_better(q + noise, stamps, regular, v)
        assert found == (taken is stamps)
