"""Noisy logs: peak efforts, their uncertainty, holds; and plans that pass through unchanged."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain

import pinfric as pf
from pinfric.study.trajectory.log.judged import judge_log
from pinfric.study.trajectory.log.noise import (
    Spectra,
    acceleration_jumps,
    low_pass,
    noise_floor,
    noise_gain,
    noise_level,
    noisy_joints,
    signal_cutoff,
)
from pinfric.study.trajectory.log.reading import ReadingOptions
from pinfric.study.trajectory.log.still import find_noisy_holds

ROBOTS = Path(__file__).parents[4] / "robots"
SCENE = """pinfric: 1
robot: {urdf: "example-robot-data:ur_description/urdf/ur10_robot.urdf"}
friction:
  shoulder_lift_joint: {coulomb: {static: 12.0, kinetic: 10.0}, viscous: 8.0}
  elbow_joint: {coulomb: {static: 6.0, kinetic: 5.0}, viscous: 6.0}
"""
#: A UR10 takes a part at A and puts it down at B: stops with holds, and two that it passes.
WAY = """pinfric_trajectory: 1
profile: PROFILE
sample_rate: RATE
points:
  - {q: [0.0024, -1.893, 1.7908, -1.4686, -1.5708, 0.0024], hold: 0.2}
  - {q: [-0.7912, -1.451, 1.6533, -1.7731, -1.5708, -0.7912], duration: 1.0}
  - {q: [-0.7912, -1.2357, 1.9542, -2.2893, -1.5708, -0.7912], duration: 0.6, hold: 0.4}
  - {q: [-0.7912, -1.451, 1.6533, -1.7731, -1.5708, -0.7912], duration: 0.6}
  - {q: [0.7796, -1.451, 1.6533, -1.7731, -1.5708, 0.7796], duration: 1.4}
  - {q: [0.7796, -1.2357, 1.9542, -2.2893, -1.5708, 0.7796], duration: 0.6, hold: 0.4}
  - {q: [0.0024, -1.893, 1.7908, -1.4686, -1.5708, 0.0024], duration: 1.2, hold: 0.2}
"""
NO_DIGITS = np.zeros(6)
ARM = pin.Inertia(1.0, np.array([0.3, 0, 0]), 0.01 * np.eye(3))
#: Drives whose efforts are more than rounding beside the others'.
LOADED = slice(0, 4)


class Truth:
    """A planned pick-and-place, its peak efforts, and what encoders make of it."""

    def __init__(self, folder, profile):
        self.folder, self.profile = folder, profile
        (folder / "ur10.yaml").write_text(SCENE)
        self.scene = pf.load_scene(folder / "ur10.yaml")
        self.plans = {rate: self._plan(rate) for rate in (500, 1000, 4000)}
        result = pf.inverse_dynamics(self.scene, self.plans[4000])
        self.peak = peaks(result)

    def _plan(self, rate):
        path = self.folder / f"{self.profile}_{rate}.yaml"
        path.write_text(WAY.replace("PROFILE", self.profile).replace("RATE", str(rate)))
        return pf.load_trajectory(path, self.scene)

    def log(self, rate, kind):
        """The times and positions that an encoder and a logger make of the plan."""
        seeded, plan, fine = np.random.default_rng(7), self.plans[rate], self.plans[4000]
        t, q = plan.t, plan.q
        white = seeded.normal(size=q.shape)
        jitter = 3e-4 * seeded.normal(size=t.size)
        if kind in ("1e-5", "2e-5"):
            return t, q + float(kind) * white
        if kind in ("20 bit", "16 bit"):
            count = 2.0 * np.pi / 2 ** int(kind[:2])
            return t, np.round(q / count) * count
        if kind == "wrapped":
            wrapped = q + 1e-5 * white
            wrapped[:, 0] = np.angle(np.exp(1j * (wrapped[:, 0] + np.pi)))
            return t, wrapped
        if kind == "stamps jitter":
            return t + jitter, q + 1e-5 * white
        if kind in ("sleep loop", "stalls"):
            return self._wandering(seeded, rate, kind)
        assert kind == "samples jitter"
        at = np.clip(t + jitter, 0.0, t[-1])
        late = np.column_stack([np.interp(at, fine.t, x) for x in fine.q.T])
        return t, late + 1e-5 * white

    def _wandering(self, seeded, rate, kind):
        """What a loop logs that sleeps for a period and works for a while, or is held up."""
        fine, step = self.plans[4000], 1.0 / rate
        steps = step * (1.0 + 0.1 * seeded.exponential(size=round(fine.t[-1] / step)))
        if kind == "stalls":  # 3 to 8 periods late, and then two rows in a hurry
            late = np.flatnonzero(seeded.random(steps.size - 2) < 0.01)
            steps[late] = step * seeded.uniform(3.0, 8.0, late.size)
            steps[late + 1] = steps[late + 2] = 0.1 * step
        t = np.concatenate(([0.0], np.cumsum(steps)))
        t = t[t <= fine.t[-1]]
        q = np.column_stack([np.interp(t, fine.t, x) for x in fine.q.T])
        return t, q + 1e-5 * seeded.normal(size=q.shape)


def peaks(result):
    return np.maximum(np.abs(result.effort_lower), np.abs(result.effort_upper)).max(axis=0)


def write_csv(path, t, names, columns, form="%.12g"):
    np.savetxt(
        path,
        np.column_stack((t, columns)),
        delimiter=",",
        header=",".join(["t", *names]),
        comments="",
        fmt=form,
    )
    return path


@pytest.fixture(scope="module")
def smooth(tmp_path_factory):
    return Truth(tmp_path_factory.mktemp("smooth"), "quintic")


@pytest.fixture(scope="module")
def jerky(tmp_path_factory):
    return Truth(tmp_path_factory.mktemp("jerky"), "trapezoidal")


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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rate", [500, 1000])
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


@pytest.mark.parametrize("kind", KINDS)
def test_jumps_of_acceleration_are_blurred_but_not_silently(jerky, kind, tmp_path):
    motion, peak, uncertain = judged(jerky, 500, kind, tmp_path)
    off = np.abs(peak - jerky.peak)[LOADED]
    assert (off <= 0.04 * jerky.peak[LOADED]).all(), off / jerky.peak[LOADED]
    assert (off <= uncertain[LOADED]).all(), (off, uncertain[LOADED])
    assert len(motion.holds()) == 4 or kind == "stalls"


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


# --- the spectrum ---------------------------------------------------------------------------------


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


@pytest.mark.parametrize("kind", ["16 bit", "samples jitter", "2e-5"])
def test_noise_that_is_not_white_is_not_taken_for_motion(smooth, jerky, kind):
    for truth in (smooth, jerky):
        q = truth.log(1000, kind)[1][:, LOADED]
        found = [signal_cutoff(Spectra.of(x, 1e-3, noise_floor(x))) for x in q.T]
        assert max(found) < 60.0


@pytest.mark.parametrize("seed", range(4))
def test_a_peak_does_not_stand_in_the_ends_of_a_log_in_motion(seed, tmp_path):
    """What a low pass makes of the last samples was up to 50 times as wrong as what is inside."""
    rng = np.random.default_rng(seed)
    t, parts = np.arange(0, 8, 0.002), [(0.1 / f, f) for f in rng.uniform(0.3, 8.0, 6)]
    motion, uncertain = filtered(t + 7.0 * seed, tones(t, *parts)[0], 3e-5, tmp_path, seed)
    truth = tones(motion.t - 7.0 * seed, *parts)[1]
    assert np.abs(motion.a[:, 0] - truth).max() < 0.05 * np.abs(truth).max()
    assert abs(np.abs(motion.a).max() - np.abs(truth).max()) <= uncertain
    assert "where joints move and the low pass has samples on one side only" in motion.warnings[-1]
    assert 7.8 < motion.duration < 8.0


# --- plans pass through -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["panda_pick_and_place", "ur5_pick_and_place"])
def test_bundled_files_pass_through_bit_for_bit(name, tmp_path):
    from pinfric.study.trajectory.derivatives import find_holds, position_derivatives

    scene = pf.load_scene(ROBOTS / f"{name}.yaml")
    plan = pf.load_trajectory(ROBOTS / f"{name}.csv", scene)
    assert not plan.reading.notes
    cells = np.loadtxt(ROBOTS / f"{name}.csv", delimiter=",", skiprows=1)
    header = (ROBOTS / f"{name}.csv").read_text().splitlines()[0].split(",")
    q = cells[:, [header.index(joint) for joint in plan.joint_names]]
    bare = write_csv(tmp_path / "bare.csv", cells[:, 0], plan.joint_names, q, "%.17g")
    motion = pf.load_trajectory(bare, scene)
    assert not motion.reading.filtered
    np.testing.assert_array_equal(motion.t, cells[:, 0])
    for i in range(q.shape[1]):
        v, a = position_derivatives(cells[:, 0], q[:, i], find_holds(q[:, i], 1e-16))
        np.testing.assert_array_equal(motion.v[:, i], v)
        np.testing.assert_array_equal(motion.a[:, i], a)
    for array, given in (("v", ".v"), ("a", ".a")):
        columns = [header.index(joint + given) for joint in plan.joint_names]
        np.testing.assert_array_equal(getattr(plan, array), cells[:, columns])


def test_a_plan_printed_with_few_digits_stays_a_plan(jerky, tmp_path):
    plan = jerky.plans[500]
    path = write_csv(tmp_path / "a.csv", plan.t[::2], plan.joint_names, plan.q[::2], "%.7g")
    motion = pf.load_trajectory(path, jerky.scene)
    assert not motion.reading.filtered
    off = np.abs(peaks(pf.inverse_dynamics(jerky.scene, motion)) - jerky.peak)[LOADED]
    assert (off < 0.05 * jerky.peak[LOADED]).all()


@pytest.mark.parametrize("rate", [100, 1000])
@pytest.mark.parametrize("profile", ["quintic", "trapezoidal"])
def test_planned_positions_are_not_noisy(smooth, jerky, profile, rate):
    plan = (smooth if profile == "quintic" else jerky).plans[1000]
    q = plan.q[:: 1000 // rate]
    assert not any(noisy_joints(q, 1.0 / rate, NO_DIGITS))
    noisy = q + 2e-5 * np.random.default_rng(1).normal(size=q.shape)
    assert all(noisy_joints(noisy, 1.0 / rate, NO_DIGITS))


def test_fast_sines_sampled_coarsely_are_not_noise():
    t = np.arange(2000) / 100
    assert noisy_joints(np.sin(2 * np.pi * 12 * t)[:, None], 0.01, np.zeros(1)) == [False]


@pytest.mark.parametrize("gaussian", [False, True])
def test_noise_level_and_gain_are_those_of_white_noise(gaussian):
    rng, step, cutoff = np.random.default_rng(2), 2e-3, 20.0
    noise = 3e-5 * rng.normal(size=200_000)
    assert noise_level(noise) == pytest.approx(3e-5, rel=0.02)
    smooth = low_pass(noise, step, cutoff, gaussian)[1000:-1000]
    spectral = 2j * np.pi * np.fft.rfftfreq(smooth.size, step)  # derivatives by Fourier
    for order in (0, 1, 2):
        derivative = np.fft.irfft(np.fft.rfft(smooth) * spectral**order, smooth.size)
        assert derivative[1000:-1000].std() == pytest.approx(
            3e-5 * noise_gain(step, cutoff, order, gaussian), rel=0.05
        )


def test_an_encoder_that_flickers_by_one_count_does_not_accelerate(tmp_path):
    count, t = 2 * np.pi / 2**16, np.arange(0, 2, 0.002)
    q = np.full((t.size, 1), 0.3)
    q[400] += count  # one row
    q[700:] += count  # and from here on
    model = chain(("a", pin.JointModelRZ(), ARM))
    path = write_csv(tmp_path / "a.csv", t, ["a"], q, "%.17g")
    assert np.abs(pf.load_trajectory(path, pf.Scene(model=model)).a).max() < 0.5  # 24 by a spline


def test_a_gaussian_low_pass_does_not_overshoot_a_jump_and_halves_a_sine_at_its_cutoff():
    t = np.arange(0, 4, 0.002)
    jump = np.where(t < 2.0, 0.0, 1.0)
    assert low_pass(jump, 0.002, 10.0, gaussian=True).max() < 1.0 + 1e-9
    assert low_pass(jump, 0.002, 10.0).max() > 1.05
    sine = low_pass(np.sin(2 * np.pi * 10.0 * t), 0.002, 10.0, gaussian=True)
    assert np.abs(sine[500:-500]).max() == pytest.approx(0.5, rel=5e-3)


def test_only_profiles_whose_acceleration_jumps_are_filtered_by_a_gaussian(smooth, jerky):
    for kind in ("1e-5", "2e-5", "16 bit", "samples jitter"):
        for truth in (smooth, jerky):
            q = truth.log(500, kind)[1][:, LOADED]
            seen = [Spectra.of(x, 0.002, noise_floor(x)) for x in q.T]
            found = [acceleration_jumps(one, signal_cutoff(one)) for one in seen]
            assert found == [truth is jerky] * 4


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
    np.testing.assert_allclose(found, truth, rtol=0.015)  # also where the log ends in motion


@pytest.mark.parametrize("name", ["four_bar", "slider_crank"])
def test_noisy_logs_of_all_joints_of_a_loop_are_closed(name, tmp_path):
    scene = pf.load_scene(ROBOTS / f"{name}.yaml")
    plan = pf.load_trajectory(ROBOTS / f"{name}.waypoints.yaml", scene)
    q = plan.joint_positions() + 1e-5 * np.random.default_rng(1).normal(size=(plan.t.size, 3))
    path = write_csv(tmp_path / "log.csv", plan.t, plan.joint_names, q)
    motion = pf.load_trajectory(path, scene)
    assert "loops closed by correcting joints, " in motion.warnings[-1]
    truth, found = (peaks(pf.inverse_dynamics(scene, m)) for m in (plan, motion))
    np.testing.assert_allclose(found, truth, rtol=0.01)
    q[:, -1] += 0.05  # no noise: another zero
    open_loop = write_csv(tmp_path / "log.csv", plan.t[:300], plan.joint_names, q[:300])
    with pytest.raises(pf.PinfricError, match=r"is open at sample 0, by 0\.0"):
        pf.inverse_dynamics(scene, pf.load_trajectory(open_loop, scene))


# --- holds ----------------------------------------------------------------------------------------


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
    np.testing.assert_allclose(motion.v[:, 0], 2 * np.cos(2 * t), atol=2e-3)
    np.testing.assert_allclose(motion.a[:, 0], -4 * np.sin(2 * t), atol=0.1)  # also at the ends
    np.testing.assert_allclose(motion.a[300:-300, 0], -4 * np.sin(2 * t)[300:-300], atol=0.02)
