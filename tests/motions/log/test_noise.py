"""Noisy logs: peak efforts, their uncertainty, holds; and plans that pass through unchanged."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain
from log_cases import ARM, LOADED, write_csv

import pinfric as pf
from pinfric.motions.log.motion import _LOWER
from pinfric.motions.log.noise import (
    Spectra,
    acceleration_jumps,
    low_pass,
    noise_floor,
    noise_gain,
    noise_level,
    noisy_joints,
    signal_cutoff,
)

NO_DIGITS = np.zeros(6)


@pytest.mark.parametrize("kind", ["16 bit", "samples jitter", "2e-5"])
def test_noise_that_is_not_white_is_not_taken_for_motion(smooth, jerky, kind):
    for truth in (smooth, jerky):
        q = truth.log(1000, kind)[1][:, LOADED]
        found = [signal_cutoff(Spectra.of(x, 1e-3, noise_floor(x))) for x in q.T]
        assert max(found) < 60.0


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
    for sigma in (noise_level, noise_floor):
        assert sigma(q[:, 0]) == pytest.approx(count / np.sqrt(12.0), rel=1e-6)
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


def test_the_shift_is_what_a_lower_cutoff_takes_from_a_sine_more(tmp_path):
    """a (g_lower - g): gains of a Butterworth of order four that runs forth and back."""
    t, frequency, cutoff = np.arange(0, 6, 0.002), 5.0, 12.0
    rate = 2 * np.pi * frequency
    q = 0.5 * np.sin(rate * t) + 2e-5 * np.random.default_rng(4).normal(size=t.size)
    path = write_csv(tmp_path / "a.csv", t, ["a"], q[:, None], "%.17g")
    scene = pf.Scene(model=chain(("a", pin.JointModelRZ(), ARM)))
    motion = pf.load_trajectory(path, scene, pf.ReadingOptions(cutoff=cutoff))
    tangent = np.tan(np.pi * np.array([_LOWER, 1.0]) * cutoff * 0.002)
    lower, own = 1.0 / (1.0 + (np.tan(np.pi * frequency * 0.002) / tangent) ** 8)
    wanted = -(rate**2) * 0.5 * np.sin(rate * motion.t) * (lower - own)
    found = motion.reading.uncertain.acceleration_shift[:, 0]
    inside = (motion.t > 1.0) & (motion.t < 5.0)
    np.testing.assert_allclose(found[inside], wanted[inside], atol=0.05 * np.abs(wanted).max())
