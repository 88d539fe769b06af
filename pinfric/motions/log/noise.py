"""Noise of logged positions: how much there is, where the signal ends, and the low pass between.

Differences of order k of white noise have an RMS of sigma sqrt(C(2k, k)); a smooth motion has
hardly any of order six, so sigma comes from the positions alone. The second difference has the
one-sided power spectral density 2 sigma^2 dt |2 sin(pi f dt)|^4.

Arguments: position (T,) of one joint, rad or m; t (T,) increasing, s, None: regular; step, s
between samples; cutoff of a low pass, Hz; seen, the joint's spectra.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pinfric.model.arrays import FloatArray
from pinfric.motions.derivatives import SPLINE_GAINS

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
#: s. Shorter segments blur slow motion into the noise. Longer ones give the middle of a log more
#: weight, which matters where noise changes with the speed.
_SEGMENT = 1.0
_SHORTEST_SEGMENT = 64
#: Segments whose spectra are computed at a time.
_SEGMENTS = 512
#: How many cutoffs are compared; the highest, as Hz times the step: above it nothing is filtered.
_CUTOFFS, _HIGHEST = 200, 0.4
#: Factor on the noise's density: noise of jittering samples and coarse encoders is not white.
_CAUTION = 4.0
#: An acceleration jumps if the frequency below which 95 % of its power lies is more than so many
#: times that of 80 %, and that of 90 % (3 to 4 and 2 times; smoother motions: below 2 and 1.5).
_HEAVY_TAIL, _NO_TONE = 2.5, 1.25
#: Chance with which white noise in one of a spectrum's bins is taken for motion.
_FALSE_ALARM = 1e-6
#: Below so many times the noise's density nothing is called motion: noise is not always white.
_UNCLEAR = 10.0
_BUTTERWORTH = 4
#: Degree of the polynomial by which a motion goes on beyond its ends, and periods of the cutoff
#: that it is fitted to.
_CONTINUED, _FITTED = 4, 1.0


def noise_level(position: FloatArray, t: FloatArray | None = None) -> float:
    """Return sigma = rms(diff^6 q) / sqrt(924) over the samples around which a joint moves.

    At irregular times divided differences replace diff^6, each over the standard deviation that
    white noise gives it. Where an encoder only flickers by a count, sigma is that of rounding to
    counts.
    """
    if (count := _flickers(position)) > 0.0:
        return count / math.sqrt(12.0)
    differences = _differences(position, _ORDER, t)
    return float(np.sqrt(np.mean(differences**2))) if differences.size else 0.0


def noise_differences(position: FloatArray, t: FloatArray) -> FloatArray:
    """Return the differences of which `noise_level` is the RMS; none if an encoder flickers."""
    return np.empty(0) if _flickers(position) > 0.0 else _differences(position, _ORDER, t)


def noise_floor(position: FloatArray, t: FloatArray | None = None) -> float:
    """Return the sigma of `noise_level` over all samples, for spectra."""
    if (count := _flickers(position)) > 0.0:
        return count / math.sqrt(12.0)
    return float(np.sqrt(np.mean(_normalized_differences(position, _ORDER, t) ** 2)))


def roughness(position: FloatArray, t: FloatArray | None = None) -> float:
    """Return the RMS of third differences over the given times, as sigma of the noise they make.

    High orders pass over bursts of rows and the pauses between them; this one does not.
    """
    return float(np.sqrt(np.mean(_normalized_differences(position, 3, t) ** 2)))


def noisy_joints(
    position: FloatArray, step: float, resolution: FloatArray, t: FloatArray | None = None
) -> list[bool]:
    """Return which joints carry noise, if any of it would spoil accelerations; else none.

    Noise spoils them if a spline turns it into more than 1 % of a joint's acceleration; 5 % where
    the file's digits (`resolution`, (nj,)) explain it, because a planned motion may be printed with
    few. Then every noisy joint is filtered: each acceleration moves the others.
    """
    noisy = [_is_noisy(q, t) for q in position.T]
    spoils = [
        _flickers(q) > 0.0 or (is_so and _spoils(q, step, float(last), t))
        for q, is_so, last in zip(position.T, noisy, resolution, strict=True)
    ]
    return noisy if any(spoils) else [False] * len(noisy)


def _is_noisy(position: FloatArray, t: FloatArray | None) -> bool:
    """Whether there is white noise beyond rounding; medians pass over kinks of plans."""
    six, eight = (typical_noise(position, t, order) for order in (_ORDER, _ORDER + 2))
    return _flickers(position) > 0.0 or (six > _LEAST_NOISE and eight > _WHITE_SHARE * six)


def _spoils(position: FloatArray, step: float, resolution: float, t: FloatArray | None) -> bool:
    """Whether a spline makes more of the noise than a small share of the acceleration."""
    curvature = np.abs(_normalized_differences(position, 2, t)) * math.sqrt(6.0) / step**2
    large = float(np.quantile(curvature[curvature > 0.0], 0.9))  # a glitch would be the peak
    noise = typical_noise(position, t)
    harmless = _ROUNDED_SHARE if noise < 0.5 * resolution else _HARMLESS_SHARE
    return SPLINE_GAINS[1] * noise / step**2 > harmless * large


def _flickers(position: FloatArray) -> float:
    """Return an encoder's count if it only moves by one now and then; else 0."""
    steps = np.diff(position)
    places = np.flatnonzero(steps)
    if places.size == 0 or float(np.ptp(np.abs(steps[places]))) > 0.01 * float(np.ptp(position)):
        return 0.0
    count = float(np.abs(steps[places]).max())
    flickers = np.ptp(position) < 3.0 * count and _LEAST_NOISE < count < _LARGEST_COUNT
    return count if flickers else 0.0


def _differences(position: FloatArray, order: int, t: FloatArray | None) -> FloatArray:
    """Normalized differences of samples that are not all the same."""
    changes = np.diff(position) != 0.0
    if changes.size < order:
        return np.empty(0)
    count = np.concatenate(([0], np.cumsum(changes)))
    return _normalized_differences(position, order, t)[count[order:] > count[:-order]]


def _normalized_differences(position: FloatArray, order: int, t: FloatArray | None) -> FloatArray:
    """Return divided differences over the deviation that white noise of sigma 1 gives them.

    sum_k w_k q_k / sqrt(sum_k w_k^2) with w_k = 1 / prod_(j != k) (t_k - t_j) over order + 1
    samples; at regular times diff^order / sqrt(C(2 order, order)).
    """
    if t is None:
        return np.diff(position, order) / math.sqrt(math.comb(2 * order, order))
    count = position.size - order
    place = (t - t[0]) / (t[-1] - t[0]) * (t.size - 1)  # of order 1 apart: no overflow
    total, squares = np.zeros(count), np.zeros(count)
    for k in range(order + 1):
        product = np.ones(count)
        for j in range(order + 1):
            if j != k:
                product *= place[k : k + count] - place[j : j + count]
        total += position[k : k + count] / product
        squares += 1.0 / product**2
    return np.asarray(total / np.sqrt(squares))


def typical_noise(position: FloatArray, t: FloatArray | None = None, order: int = _ORDER) -> float:
    """Return sigma from the median of differences, which passes over samples at kinks.

    The median of Gaussian differences is 0.6745 of their RMS.
    """
    differences = _differences(position, order, t)
    if differences.size < _FEWEST:
        return 0.0
    return float(np.median(np.abs(differences))) / 0.6745


@dataclass(frozen=True)
class Spectra:
    """One-sided densities of the second difference of one joint's positions.

    Args:
        step: s between samples. frequency: (n,) Hz.
        motion, white: (n,) of the motion and of white noise, (rad or m)^2/Hz.
        clear: factor on the noise's density beyond which a density is no noise by chance.
    """

    step: float
    frequency: FloatArray
    motion: FloatArray
    white: FloatArray
    clear: float

    @classmethod
    def of(cls, position: FloatArray, step: float, noise: float) -> Spectra:
        """Return the spectra of positions with white noise of sigma `noise`, rad or m."""
        from scipy.stats import chi2

        curvature = np.diff(position, 2)
        length = min(curvature.size, max(math.ceil(_SEGMENT / step), _SHORTEST_SEGMENT))
        frequency, density = _density(curvature, 1.0 / step, length)
        difference = np.abs(2.0 * np.sin(np.pi * frequency * step)) ** 4
        white = 2.0 * noise**2 * step * difference
        motion = density - white
        freedom = 2.0 * curvature.size / length  # overlapping halves: about two for each whole one
        count = _encoder_count(position)
        if noise < count:  # what moves by less than half a count cannot be told from rounding
            power = np.divide(motion, difference, out=np.zeros_like(motion), where=difference > 0.0)
            above = np.cumsum(power[::-1])[::-1] * frequency[1]
            motion[np.maximum.accumulate(above[::-1])[::-1] < count**2 / 8.0] = 0.0
        clear = float(chi2.isf(_FALSE_ALARM, freedom)) / freedom
        return cls(step, frequency, motion, white, clear)


def _density(x: FloatArray, rate: float, length: int) -> tuple[FloatArray, FloatArray]:
    """Welch's estimate of a density (frequencies in Hz), part by part."""
    from scipy.signal import welch

    beside, total = length // 2, 0.0
    count = (x.size - beside) // (length - beside)  # segments, which overlap by a half
    for first in range(0, count, _SEGMENTS):
        own, start = min(_SEGMENTS, count - first), first * (length - beside)
        series = x[start : start + own * (length - beside) + beside]
        frequency, density = welch(series, rate, nperseg=length, detrend=False)
        total = total + density * (own / count)
    return frequency, np.asarray(total)


def signal_cutoff(seen: Spectra, gaussian: bool = False) -> float | None:
    """Return the cutoff (Hz) that leaves the least error in the acceleration; None: no low pass.

    A gain G leaves an expected mean square error int (1 - G)^2 (D - N) + 4 G^2 N df: motion taken
    away, and noise let through, four times because it is not always white. D is Welch's estimate of
    the density of the second difference, N that of white noise.

    Source: Stein, Estimation of the Mean of a Multivariate Normal Distribution (1981): an unbiased
    estimate of the risk.
    """
    cutoffs = np.geomspace(seen.frequency[1], _HIGHEST / seen.step, _CUTOFFS)
    gain = _gain(seen.frequency, cutoffs[:, None], gaussian)
    error = (1.0 - gain) ** 2 @ seen.motion + _CAUTION * gain**2 @ seen.white
    best = int(np.argmin(error))
    return float(cutoffs[best]) if best < _CUTOFFS - 1 else None


def _encoder_count(position: FloatArray) -> float:
    """Return the count of which all steps are multiples, else 0."""
    steps = np.abs(np.diff(position))
    steps = steps[steps > 0.0]
    if steps.size == 0:
        return 0.0
    count = float(steps.min())
    whole = steps / count
    return count if float(np.abs(whole - np.rint(whole)).max()) < 0.01 else 0.0


def acceleration_jumps(seen: Spectra, cutoff: float) -> bool:
    """Return whether the acceleration jumps, as it does in trapezoidal profiles.

    The density of jumps falls as f^-2, so 95 % of the power reach 4 times as far as 80 % do and
    twice as far as 90 %. Where only the jerk jumps it is 4^(1/3) = 1.6 times; where one tone stands
    above the others, 95 % reach hardly farther than 90 %.
    """
    power = np.cumsum(np.maximum(seen.motion, 0.0) * (seen.frequency < cutoff))
    shares = power[-1] * np.array((0.8, 0.9, 0.95))
    most, more, nearly_all = np.interp(shares, power, seen.frequency)
    return bool(nearly_all > _HEAVY_TAIL * most and nearly_all > _NO_TONE * more)


def motion_taken_away(seen: Spectra, cutoff: float, gaussian: bool) -> float:
    """Return the RMS acceleration that a low pass takes from the motion, rad/s^2 or m/s^2.

    Only frequencies count at which the density is far above that of the noise.
    """
    clear = seen.motion > (max(seen.clear, _UNCLEAR) - 1.0) * seen.white
    lost = (1.0 - _gain(seen.frequency, cutoff, gaussian)) ** 2 * np.maximum(seen.motion, 0.0)
    return float(np.sqrt(np.sum(lost[clear]) * seen.frequency[1])) / seen.step**2


def _gain(frequency: FloatArray, cutoff: float | FloatArray, gaussian: bool) -> FloatArray:
    ratio = frequency / cutoff
    return np.asarray(2.0 ** -(ratio**2) if gaussian else 1.0 / (1.0 + ratio ** (2 * _BUTTERWORTH)))


def low_pass(
    position: FloatArray, step: float, cutoff: float, gaussian: bool = False
) -> FloatArray:
    """Return positions (T,) or (T, n) at regular times after a low pass without a shift in time.

    Its gain is 1 / (1 + (f / cutoff)^8), a Butterworth low pass of order four forward and backward.
    It overshoots a jump by a tenth; a Gaussian one, 2^-(f / cutoff)^2, does not, but takes more
    from a motion just below the cutoff. Beyond both ends the motion goes on as a polynomial of
    degree four through its last period of the cutoff: a reflection would set velocity or
    acceleration to zero there.
    """
    from scipy.ndimage import gaussian_filter1d
    from scipy.signal import butter, sosfiltfilt

    count = len(position)
    span = min(count, max(math.ceil(2.0 / (cutoff * step)), 8))
    fitted = min(count, max(math.ceil(_FITTED / (cutoff * step)), 8))
    before = _continued(position[::-1], span, fitted)[::-1]
    longer = np.concatenate((before, position, _continued(position, span, fitted)))
    if gaussian:
        width = np.sqrt(2.0 * np.log(2.0)) / (2.0 * np.pi * cutoff * step)
        smooth = gaussian_filter1d(longer, width, axis=0, mode="nearest", truncate=6.0)
    else:
        sections = butter(_BUTTERWORTH, cutoff, fs=1.0 / step, output="sos")
        smooth = sosfiltfilt(sections, longer, axis=0, padlen=span)
    return np.asarray(smooth[len(before) : len(before) + count])


def _continued(position: FloatArray, span: int, fitted: int) -> FloatArray:
    """Return `span` samples after the last, on a polynomial through `fitted`."""
    last, degree = position[-fitted:], _CONTINUED if fitted > 2 * _CONTINUED else 1
    place = np.linspace(-1.0, 1.0, len(last))  # where Legendre's polynomials are of one size
    ahead = 1.0 + (place[1] - place[0]) * np.arange(1, span + 1)
    basis, beyond = (np.polynomial.legendre.legvander(x, degree) for x in (place, ahead))
    return np.asarray(beyond @ np.linalg.lstsq(basis, last, rcond=None)[0])


def noise_gain(step: float, cutoff: float, order: int, gaussian: bool = False) -> float:
    """Return the standard deviation of a derivative, of this order, of low-passed white noise.

    The noise has sigma 1, and gain(f) is that of `low_pass`:

        sqrt(2 dt int (2 pi f)^(2 order) gain(f)^2 df)    up to half the sampling rate.
    """
    frequency = np.linspace(0.0, 0.5 / step, 4001)
    gain = _gain(frequency, cutoff, gaussian) * (2.0 * np.pi * frequency) ** order
    return float(np.sqrt(2.0 * step * np.trapezoid(gain**2, frequency)))
