"""Uncertainty of efforts due to a log's noise: simulated noise, real robots."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, example
from identify_cases import LOGS, needs_logs
from log_cases import ARM, LOADED, peaks, write_csv

import pinfric as pf
from pinfric.motions.log.judged import judge_log
from pinfric.motions.log.reading import ReadingOptions


@needs_logs
def test_a_real_ur10_beside_its_measured_efforts(tmp_path):
    urdf = "example-robot-data:ur_description/urdf/ur10_robot.urdf"
    (tmp_path / "ur10.yaml").write_text(f'pinfric: 1\nrobot: {{urdf: "{urdf}"}}\n')
    scene, motion = example(tmp_path / "ur10.yaml", LOGS / "ur10" / "ur10_exciting_trajectory.db3")
    assert (motion.reading.samples, motion.reading.dropped, motion.reading.resampled) == (
        3441,
        0,
        0,
    )
    assert max(motion.reading.noise.values()) < 1e-11
    assert not motion.reading.filtered
    measured = judge_log(pf.inverse_dynamics(scene, motion), motion.reading).measured
    for joint, plain in (("shoulder_lift_joint", 0.33), ("elbow_joint", 0.51)):
        assert measured[joint].relative_error == pytest.approx(plain, abs=0.02)


@pytest.mark.slow
@needs_logs
def test_a_real_panda_is_filtered_to_its_advantage(tmp_path):
    """Under the names of another release; its recorder repeated 14 rows of a slower source.

    The bars are what was left where these rows were taken as samples, and filtered harder for it.
    """
    names = {f"panda_joint{i}": f"fer_joint{i}" for i in range(1, 8)}
    (tmp_path / "names.yaml").write_text(f"joints: {names}")
    scene = pf.load_scene("panda_pick_and_place")
    bag, off = LOGS / "ur10" / "panda_exciting_trajectory.db3", {}
    for cutoff in (None, "none"):
        options = ReadingOptions(columns=tmp_path / "names.yaml", cutoff=cutoff)
        motion = pf.load_trajectory(bag, scene, options)
        measured = judge_log(pf.inverse_dynamics(scene, motion), motion.reading, "joint").measured
        assert motion.warnings[0].startswith("left out 14 rows that repeat the row before")
        off[cutoff] = np.array([measured[joint].relative_error for joint in motion.joint_names])
    assert (off[None] < [0.894, 0.1, 0.148, 0.141, 0.643, 0.459, 0.236]).all()
    assert (off[None][:6] < off["none"][:6]).all()  # joint 7 hardly accelerates
    assert (off[None][:2] < 0.75 * off["none"][:2]).all()


KINDS = (
    "sleep loop",
    "stalls",
    "1e-5",
    "2e-5",
    "20 bit",
    "16 bit",
    "wrapped",
    "stamps jitter",
    "samples jitter",
)


def judged(truth, rate, kind, tmp_path):
    t, q = truth.log(rate, kind)
    path = write_csv(tmp_path / "log.csv", t, truth.plans[rate].joint_names, q)
    motion = pf.load_trajectory(path, truth.scene)
    result = pf.inverse_dynamics(truth.scene, motion)
    uncertain = judge_log(result, motion.reading).peak_uncertainty
    return motion, peaks(result), np.array(list(uncertain.values()))


#: Fast tests try these at another rate and with jumps of acceleration; slow tests try all.
FEW = ("16 bit", "stalls", "stamps jitter")
#: Kind and rate: of these, only slow tests.
SLOWEST = {("stalls", 1000), ("stamps jitter", 1000)}


def kinds(rate, few):
    slow = {kind: (few and kind not in FEW) or (kind, rate) in SLOWEST for kind in KINDS}
    return [pytest.param(rate, k, marks=[pytest.mark.slow] * slow[k]) for k in KINDS]


@pytest.mark.parametrize(("rate", "kind"), kinds(500, False) + kinds(1000, True))
def test_peak_efforts_and_holds_of_a_noisy_pick_and_place(smooth, rate, kind, tmp_path):
    motion, peak, uncertain = judged(smooth, rate, kind, tmp_path)
    allowed = 0.015 if kind == "16 bit" or "jitter" in kind else 0.01
    off = np.abs(peak - smooth.peak)[LOADED]
    assert (off <= allowed * smooth.peak[LOADED]).all(), off / smooth.peak[LOADED]
    assert (off <= uncertain[LOADED]).all(), (off, uncertain[LOADED])
    found, true = motion.holds(), smooth.plans[rate].holds()
    if kind != "stalls":
        assert len(found) == len(true) == 4
        for here, there in zip(found, true, strict=True):
            assert here.start == pytest.approx(there.start, abs=2.5 / rate)
            assert here.end == pytest.approx(there.end, abs=2.5 / rate)


@pytest.mark.parametrize(("rate", "kind"), kinds(500, True))
def test_jumps_of_acceleration_are_blurred_but_not_silently(jerky, rate, kind, tmp_path):
    motion, peak, uncertain = judged(jerky, rate, kind, tmp_path)
    off = np.abs(peak - jerky.peak)[LOADED]
    assert (off <= 0.04 * jerky.peak[LOADED]).all(), off / jerky.peak[LOADED]
    assert (off <= uncertain[LOADED]).all(), (off, uncertain[LOADED])
    assert len(motion.holds()) == 4 or kind == "stalls"


def tones(t, *parts):
    """Sum of amplitude sin(2 pi f t), and its acceleration."""
    waves = [a * np.sin(2 * np.pi * f * t) for a, f in parts]
    curved = [-((2 * np.pi * f) ** 2) * x for (_, f), x in zip(parts, waves, strict=True)]
    return sum(waves), sum(curved)


def filtered(t, q, noise, folder, seed=0):
    """The motion of one turning joint of 0.1 kg m^2 by a log of it, and how its peak is known."""
    scene = pf.Scene(model=chain(("a", pin.JointModelRZ(), ARM)))
    q = q + noise * np.random.default_rng(seed).normal(size=t.size)
    motion = pf.load_trajectory(write_csv(folder / "a.csv", t, ["a"], q), scene)
    known = judge_log(pf.inverse_dynamics(scene, motion), motion.reading)
    return motion, known.peak_uncertainty["a"] / 0.1  # N m of 0.1 kg m^2


@pytest.mark.parametrize(
    ("rate", "tone", "noise", "allowed"),
    [
        (500, (2e-3, 30.0), 1e-5, 0.02),  # the peak was 93 % too small, and known to 0.01 N m
        (500, (2e-4, 30.0), 1e-5, 0.05),
        (1000, (1e-4, 90.0), 1e-5, 0.15),
        (125, (1e-3, 12.0), 1e-5, 0.01),
        (500, (2e-3, 30.0), 1e-4, 0.08),
        (500, (1e-4, 30.0), 1e-4, 0.5),  # not worth the noise: cut away, and said how much
    ],
)
def test_motion_above_a_gap_in_the_spectrum_stays_or_is_said(rate, tone, noise, allowed, tmp_path):
    t = np.arange(10 * rate) / rate
    motion, uncertain = filtered(t, tones(t, (0.5, 0.5), tone)[0], noise, tmp_path)
    truth = np.abs(tones(motion.t, (0.5, 0.5), tone)[1]).max()
    off = abs(np.abs(motion.a).max() - truth)
    assert off <= allowed * truth
    assert off <= uncertain


@pytest.mark.parametrize("seed", range(4))
def test_a_peak_does_not_stand_in_the_ends_of_a_log_in_motion(seed, tmp_path):
    """A low pass errs up to 50 times as much at the last samples as inside."""
    rng = np.random.default_rng(seed)
    t, parts = np.arange(0, 8, 0.002), [(0.1 / f, f) for f in rng.uniform(0.3, 8.0, 6)]
    motion, uncertain = filtered(t + 7.0 * seed, tones(t, *parts)[0], 3e-5, tmp_path, seed)
    truth = tones(motion.t - 7.0 * seed, *parts)[1]
    assert np.abs(motion.a[:, 0] - truth).max() < 0.05 * np.abs(truth).max()
    assert abs(np.abs(motion.a).max() - np.abs(truth).max()) <= uncertain
    assert "where joints move and the low pass has samples on one side only" in motion.warnings[-1]
    assert 7.8 < motion.duration < 8.0
