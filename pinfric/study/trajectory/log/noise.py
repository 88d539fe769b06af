"""Noise of logged positions: how much there is, where the signal ends, and the low pass between.

White noise of standard deviation sigma has differences of order k with RMS sigma sqrt(C(2k, k)); a
motion that is smooth over a few samples has hardly any of order six. So sigma comes from the
positions alone, and the frequency above which there is only noise from the power spectral density
of their second difference, which for white noise is 2 sigma^2 dt |2 sin(pi f dt)|^4 (one-sided).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pinfric.study.trajectory.derivatives import SPLINE_GAINS

FloatArray = NDArray[np.float64]

_ORDER = 6
#: rad or m. Encoders end at 27 bits (1e-8 rad); less noise is rounding, or what a filter left.
_LEAST_NOISE = 1e-8
#: rad or m. No encoder has larger counts (12 bit); a larger step is a motion.
_LARGEST_COUNT = 2e-3
#: Noise that a spline turns into less than this share of a joint's acceleration stays; where the
#: file's digits explain it, the second.
_HARMLESS_SHARE, _ROUNDED_SHARE = 0.01, 0.05
#: Differences of order eight show this share of the noise that those of order six do, or more, if
#: it is noise: for a motion of 0.3 periods a sample it is 0.66, for slower ones far less.
_WHITE_SHARE = 0.7
#: Differences below which nothing can be said about noise.
_FEWEST = 10
_SEGMENT = 512
#: How much farther than 80 % of its power 95 % reach, where an acceleration jumps (3 to 4 times;
#: smoother motions: less than 2).
_HEAVY_TAIL = 2.5
_BUTTERWORTH = 4


def noise_level(position: FloatArray) -> float:
    """Return sigma = rms(diff^6 q) / sqrt(924) over the samples around which a joint moves.

    Args:
        position: (T,) rad or m at regular times.
    """
    differences = _differences(position, _ORDER)
    if differences.size == 0:
        return 0.0
    return float(np.sqrt(np.mean(differences**2) / math.comb(2 * _ORDER, _ORDER)))


def noisy_joints(position: FloatArray, step: float, resolution: FloatArray) -> list[bool]:
    """Return which joints carry noise, if any of it would spoil accelerations; else none.

    What makes a log is noise that a spline turns into more than 1 % of a joint's acceleration; 5 %
    where a file's digits explain it, as a planned motion may be printed with few. In a log every
    noisy joint is filtered: each one's acceleration moves the others.

    Args:
        position: (T, nj) rad or m at regular times.
        step: s between samples.
        resolution: (nj,) the last digit printed, rad or m.
    """
    noisy = [_is_noisy(q) for q in position.T]
    spoils = [_flickers(q) or (is_so and _spoils(q, step, float(last)))
              for q, is_so, last in zip(position.T, noisy, resolution, strict=True)]  # fmt: skip
    return noisy if any(spoils) else [False] * len(noisy)


def _is_noisy(position: FloatArray) -> bool:
    """Whether there is white noise beyond rounding; medians pass over a planned motion's kinks."""
    six, eight = (typical_noise(position, order) for order in (_ORDER, _ORDER + 2))
    return _flickers(position) or (six > _LEAST_NOISE and eight > _WHITE_SHARE * six)


def _spoils(position: FloatArray, step: float, resolution: float) -> bool:
    """Whether a spline makes more of the noise than a small share of the joint's acceleration."""
    curvature = np.abs(np.diff(position, 2)) / step**2
    large = float(np.quantile(curvature[curvature > 0.0], 0.9))  # a glitch would be the peak
    noise = typical_noise(position)
    harmless = _ROUNDED_SHARE if noise < 0.5 * resolution else _HARMLESS_SHARE
    return SPLINE_GAINS[1] * noise / step**2 > harmless * large


def _flickers(position: FloatArray) -> bool:
    """Whether all that happens is that an encoder goes one count up or down now and then."""
    steps = np.diff(position)
    places = np.flatnonzero(steps)
    if places.size == 0 or float(np.ptp(np.abs(steps[places]))) > 0.01 * float(np.ptp(position)):
        return False
    count = float(np.abs(steps[places]).max())
    return bool(np.ptp(position) < 3.0 * count and _LEAST_NOISE < count < _LARGEST_COUNT)


def _differences(position: FloatArray, order: int) -> FloatArray:
    """Differences of an order, where the samples they take are not all the same."""
    changes = np.diff(position) != 0.0
    if changes.size < order:
        return np.empty(0)
    count = np.concatenate(([0], np.cumsum(changes)))
    return np.diff(position, order)[count[order:] > count[:-order]]


def typical_noise(position: FloatArray, order: int = _ORDER) -> float:
    """Return sigma from the median of differences: the few samples at a kink do not count.

    Args:
        position: (T,) rad or m at regular times.
        order: of the differences; the median of Gaussian ones is 0.6745 of their RMS.
    """
    differences = _differences(position, order)
    if differences.size < _FEWEST:
        return 0.0
    return float(np.median(np.abs(differences))) / 0.6745 / math.sqrt(math.comb(2 * order, order))


def signal_cutoff(position: FloatArray, step: float) -> float | None:
    """Return the frequency (Hz) above which a motion drowns in its noise; None: there is none.

    The first one at which Welch's estimate of the power spectral density of the second difference
    is below twice that of white noise.

    Args:
        position: (T,) rad or m at regular times.
        step: s between samples.
    """
    frequency, density, white = _spectra(position, step)
    buried = np.flatnonzero((density < 2.0 * white) & (frequency > 0.0))
    found = float(frequency[buried[0]]) if buried.size else np.inf
    return found if found < 0.4 / step else None


def _spectra(position: FloatArray, step: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frequencies, Welch's density of the second difference, and that of its white noise."""
    from scipy.signal import welch

    level = float(np.sqrt(np.mean(np.diff(position, _ORDER) ** 2) / math.comb(2 * _ORDER, _ORDER)))
    curvature = np.diff(position, 2)
    frequency, density = welch(curvature, 1.0 / step, nperseg=min(_SEGMENT, curvature.size),
                               detrend=False)  # fmt: skip
    white = 2.0 * level**2 * step * np.abs(2.0 * np.sin(np.pi * frequency * step)) ** 4
    return frequency, density, white


def acceleration_jumps(position: FloatArray, step: float, cutoff: float) -> bool:
    """Return whether the acceleration jumps, as it does in trapezoidal profiles.

    The density of jumps falls as f^-2, so a share beyond f as f^-1: 95 % of the power reach 4 times
    as far as 80 % do. Where only the jerk jumps it is 4^(1/3) = 1.6 times.

    Args:
        position: (T,) rad or m at regular times.
        step: s between samples.
        cutoff: Hz, where the motion drowns in its noise.
    """
    frequency, density, white = _spectra(position, step)
    power = np.cumsum(np.maximum(density - white, 0.0) * (frequency < cutoff))
    most, nearly_all = np.interp((0.8 * power[-1], 0.95 * power[-1]), power, frequency)
    return bool(nearly_all > _HEAVY_TAIL * most)


def low_pass(position: FloatArray, step: float, cutoff: float, gentle: bool = False) -> FloatArray:
    """Return positions after a low pass without a shift in time.

    Its gain is 1 / (1 + (f / cutoff)^8), a Butterworth low pass of order four forward and backward.
    That rings at a jump and makes a tenth more of it; a gentle one, 2^-(f / cutoff)^2 (Gaussian),
    does not, but takes more from a motion with much power just below the cutoff. Beyond both ends
    the motion goes on as the polynomial of degree six through its last two periods of the cutoff
    does, with the noise mirrored: a reflection would set velocity or acceleration to zero there, a
    cubic bends too little.

    Args:
        position: (T,) or (T, n) at regular times, rad or m, or anything else.
        step: s between samples.
        cutoff: Hz, where the gain is a half.
        gentle: the Gaussian one.
    """
    from scipy.ndimage import gaussian_filter1d
    from scipy.signal import butter, sosfiltfilt

    count = len(position)
    span = min(count, max(math.ceil(2.0 / (cutoff * step)), 8))
    before = _continued(position[::-1], span)[::-1]
    longer = np.concatenate((before, position, _continued(position, span)))
    if gentle:
        width = np.sqrt(2.0 * np.log(2.0)) / (2.0 * np.pi * cutoff * step)
        smooth = gaussian_filter1d(longer, width, axis=0, mode="nearest", truncate=6.0)
    else:
        sections = butter(_BUTTERWORTH, cutoff, fs=1.0 / step, output="sos")
        smooth = sosfiltfilt(sections, longer, axis=0, padlen=min(len(longer) - 1, span))
    return np.asarray(smooth[len(before) : len(before) + count])


def _continued(position: FloatArray, span: int) -> FloatArray:
    """Return `span` samples after the last: a polynomial of the last `span`, residuals mirrored."""
    last, degree = position[-span:], 6 if span > 16 else 1
    place = np.linspace(-1.0, 1.0, span)  # where Legendre's polynomials are of one size
    basis, ahead = (np.polynomial.legendre.legvander(x, degree) for x in (place, place[1:] + 2.0))
    motion = np.linalg.lstsq(basis, last, rcond=None)[0]
    return np.asarray(ahead @ motion + (last - basis @ motion)[::-1][1:])


def noise_gain(step: float, cutoff: float, order: int, gentle: bool = False) -> float:
    """Return the standard deviation of a derivative of low-passed white noise of sigma 1.

    sqrt(2 dt int (2 pi f)^(2 order) gain(f)^2 df) up to half the sampling rate, with the gain of
    `low_pass`.

    Args:
        step: s between samples.
        cutoff, gentle: of the low pass.
        order: of the derivative.
    """
    frequency = np.linspace(0.0, 0.5 / step, 4001)
    ratio = frequency / cutoff
    gain = 2.0 ** -(ratio**2) if gentle else 1.0 / (1.0 + ratio**8)
    gain *= (2.0 * np.pi * frequency) ** order
    return float(np.sqrt(2.0 * step * np.trapezoid(gain**2, frequency)))
