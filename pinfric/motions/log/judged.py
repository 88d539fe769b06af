"""What a log's noise leaves uncertain in efforts, and how they compare with its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult, runs
from pinfric.errors import TrajectoryError
from pinfric.model.arrays import FloatArray
from pinfric.model.described import EFFORT, PLACE, described, quantity
from pinfric.motions.joint_columns import joint_columns
from pinfric.motions.log.effort_place import (
    EFFORT_PLACES,
    better_place,
    check_effort_place,
    factors_to_joint,
    place_note,
)
from pinfric.motions.log.reading import DerivativeNoise, Reading
from pinfric.motions.summary import ends_by_magnitude, rests, rms

#: Standard deviations of the efforts' noise that count as uncertain: a peak is the largest of many
#: noisy values, not one of them.
COVERAGE = 3.0
#: Peak over RMS of the motion that a low pass took away; a steady tone has sqrt(2).
_PEAK_OVER_RMS = 2.0
#: Samples at which the efforts' dependence on accelerations and velocities is computed.
_PLACES = 300


@described
class MeasuredEffort:
    """A measured effort beside the computed one, the nearest possible where a joint sticks."""

    name: str = quantity("the drive", heading="joint", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    rms: float = quantity("RMS of the measured effort over the log", EFFORT, "measured\nRMS")
    rms_error: float = quantity(
        "RMS of measured less computed over the log as it is: rest, noise and delay included",
        EFFORT,
        "off\nRMS",
    )
    relative_error: float = quantity("rms_error / rms", heading="off", cell="{relative_error:%}")
    rest: float = quantity("how long the drive sticks", "s", "sticks", default=0.0)
    coverage: float = quantity(
        "share of that time for which the measured effort is within its interval",
        heading="of it in\nthe band",
        cell="{coverage:%}",
        default=np.nan,
    )


@dataclass(frozen=True)
class JudgedLog:
    """How a log was read, how far its efforts are known, how they fit those in the log.

    Args:
        reading: of the log; its efforts are stated at the joints (shaft torques times ratios).
        bound: drive -> (T,) how far its effort may be off, N m or N; empty where nothing was
            filtered, or where loops close.
        peak_uncertainty: drive -> the same of its peak.
        measured: drive -> its logged effort, compared.
        at: one of `EFFORT_PLACES`. notes: what efforts were taken for.
    """

    reading: Reading
    bound: Mapping[str, FloatArray] = field(default_factory=dict)
    peak_uncertainty: Mapping[str, float] = field(default_factory=dict)
    measured: Mapping[str, MeasuredEffort] = field(default_factory=dict)
    at: str = "reflected"
    notes: tuple[str, ...] = ()


@described
class LogSummary:
    """How a log was read."""

    samples: int = quantity("number of samples")
    dropped: int = quantity("rows left out")
    resampled: int = quantity("samples interpolated between rows")
    jitter: float = quantity("RMS deviation of the time stamps from regular time", "s")
    noise: Mapping[str, float] = quantity("joint -> noise of its positions", PLACE)
    cutoff: Mapping[str, float | None] = quantity("joint -> low pass; none: not filtered", "Hz")
    peak_uncertainty: Mapping[str, float] = quantity(
        "drive -> uncertainty of its peak effort", EFFORT
    )
    measured: Mapping[str, MeasuredEffort] = quantity("drive -> comparison with its logged effort")
    notes: tuple[str, ...] = quantity("guesses, repairs and filters of the log")


def log_summary(log: JudgedLog) -> LogSummary:
    """Return how a log was read and how well its efforts fit."""
    reading = log.reading
    return LogSummary(
        reading.samples,
        reading.dropped,
        reading.resampled,
        reading.jitter,
        reading.noise,
        reading.cutoff,
        log.peak_uncertainty,
        log.measured,
        (*reading.notes, *log.notes),
    )


def judge_log(result: InverseResult, reading: Reading, at: str = "reflected") -> JudgedLog:
    """Return how far the efforts of a log are known and how they fit the log's own.

    Noise and low pass change an effort by du = sum_k du/da_k da_k + du/dv_k dv_k, with derivatives
    from inverse dynamics of disturbed motions. It may be off by three standard deviations of the
    noise's part, by what a cutoff lower by 1/sqrt(2) would change, and by twice the RMS of what is
    cut away. `at`: what the log's efforts are, one of `EFFORT_PLACES`.

    Raises:
        TrajectoryError: there is no such place.
    """
    check_effort_place(at, TrajectoryError)
    names = result.actuator_names
    places = {}  # of each drive the logged effort, taken for each, beside the computed one
    for place in EFFORT_PLACES:
        effort = _stated_at_joints(result, reading, place).effort
        places[place] = {
            name: compare_effort(result, i, effort[name], place)
            for i, name in enumerate(names)
            if name in effort
        }
    measured = places[at]
    reading = _stated_at_joints(result, reading, at)
    notes = _place_notes(result, at, places) if measured else ()
    if reading.uncertain is None or result.scene.linkage is not None:
        return JudgedLog(reading, measured=measured, at=at, notes=notes)
    bound = _effort_bound(result, reading.uncertain)
    worst = np.abs(ends_by_magnitude(result.effort_lower, result.effort_upper)[0])
    peak = worst.max(axis=0)
    above, below = (worst + bound).max(axis=0) - peak, peak - (worst - bound).max(axis=0)
    largest = np.maximum(above, below)
    return JudgedLog(
        reading,
        dict(zip(names, bound.T, strict=True)),
        dict(zip(names, largest.tolist(), strict=True)),
        measured,
        at,
        notes,
    )


def _stated_at_joints(result: InverseResult, reading: Reading, at: str) -> Reading:
    factors = zip(result.actuator_names, factors_to_joint(result.scene, at).tolist(), strict=True)
    stated = {name: x * reading.effort[name] for name, x in factors if name in reading.effort}
    return replace(reading, effort={**reading.effort, **stated})


def _place_notes(
    result: InverseResult, at: str, places: Mapping[str, Mapping[str, MeasuredEffort]]
) -> tuple[str, ...]:
    errors = {}
    for place, measured in places.items():
        known = [x.relative_error for x in measured.values() if np.isfinite(x.relative_error)]
        errors[place] = float(np.median(known)) if known else np.inf
    lines = place_note(result.scene, at), better_place(at, errors)
    return tuple(line for line in lines if line)


def measured_interval(result: InverseResult, at: str) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest effort (T, na) where it is measured, as seen at the joint.

    `at`: "joint": behind the gear; "motor" or "reflected": r times the motor's torque.
    """
    if at == "joint":
        return result.effort_lower, result.effort_upper
    return result.joint_effort_lower, result.joint_effort_upper


def compare_effort(
    result: InverseResult, drive: int, measured: FloatArray, at: str = "reflected"
) -> MeasuredEffort:
    """Compare a measured effort (T,) with a drive's, at rest with the nearest of its interval.

    It is stated at the joint, N m or N, measured where `at` says (`measured_interval`).
    """
    t, finite = result.times, np.isfinite(measured)
    name, unit = result.actuator_names[drive], result.scene.drives[drive].unit
    if not finite.any():
        return MeasuredEffort(name, unit, np.nan, np.nan, np.nan)
    lower, upper = (ends[:, drive] for ends in measured_interval(result, at))
    nearest = np.clip(measured, lower, upper)
    size, error = (rms(t[finite], x[finite]) for x in (measured, measured - nearest))
    held = rests(result, drive) & finite
    inside = float(np.mean(nearest[held] == measured[held])) if held.any() else np.nan
    rest = float(sum(t[last] - t[first] for first, last in runs(held)))
    share = error / size if size > 0.0 else np.nan
    return MeasuredEffort(name, unit, size, error, share, rest, inside)


def _effort_bound(result: InverseResult, noise: DerivativeNoise) -> FloatArray:
    """How far efforts may be off, (T, na) N m or N; see `judge_log`."""
    count = len(result.states.q)
    places = np.unique(np.linspace(0, count - 1, min(count, _PLACES)).astype(np.int64))
    scene, states = replace(result.scene, measured=None), result.states  # speeds are mentioned
    q, v, a = (np.ascontiguousarray(x[places]) for x in (states.q, states.v, states.a))
    attached = None if states.attached is None else states.attached[places]
    external: dict[str, FloatArray] = {}
    for one in result.external:
        if one.joint >= 0:  # on the ground they load no joint
            name, wrench = scene.joint_names[one.joint], one.wrench[places]
            external[name] = wrench + external.get(name, 0.0)

    def efforts(v: FloatArray, a: FloatArray) -> FloatArray:
        computed = inverse_dynamics(scene, q, v, a, external, attached=attached)
        return 0.5 * (computed.effort_lower + computed.effort_upper)

    plain, samples = efforts(v, a), np.arange(count)
    variance, shift, cut = (np.zeros_like(result.effort_upper) for _ in range(3))
    for k, column in enumerate(joint_columns(scene.model, free_base=True)):
        moving, index = noise.moving[:, k], column.index_v
        if not moving.any():
            continue
        faster, harder = v.copy(), a.copy()
        faster[:, index] += np.copysign(noise.velocity[k], v[:, index]) * moving[places]
        step = max(float(noise.acceleration[k]), 1e-3)
        harder[:, index] += step
        by_velocity = efforts(faster, a) - plain
        by_acceleration = (efforts(v, harder) - plain) / step
        for i in range(plain.shape[1]):
            gain = np.interp(samples, places, by_acceleration[:, i])
            by_speed = np.interp(samples, places, by_velocity[:, i])
            variance[:, i] += moving * ((gain * noise.acceleration[k]) ** 2 + by_speed**2)
            shift[:, i] += gain * noise.acceleration_shift[:, k]
            cut[:, i] += moving * (gain * noise.acceleration_cut[k]) ** 2
    return COVERAGE * np.sqrt(variance) + np.abs(shift) + _PEAK_OVER_RMS * np.sqrt(cut)
