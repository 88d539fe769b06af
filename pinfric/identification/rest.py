"""Friction at rest from logs: largest holding friction, and break-away friction.

A hold bounds static friction from below. Only a slow departure shows it, in which the effort rises
until the joint moves: else inertia acts before the first encoder count.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import runs
from pinfric.identification.columns import PART, Prepared
from pinfric.identification.estimate import Estimate
from pinfric.identification.laws import BACKWARD, FORWARD, GEARS
from pinfric.identification.recordings import PEAK_PASS, Recording
from pinfric.model.arrays import BoolArray
from pinfric.model.described import EFFORT, described, quantity
from pinfric.model.scene import Scene
from pinfric.motions.log.judged import measured_interval
from pinfric.motions.log.noise import low_pass

#: s: a hold from which a departure counts, what counts as before it and right before it, and what
#: comes after it.
_HELD, _BEFORE, _NEAR, _AFTER = 0.5, 0.3, 0.05, 0.15
#: s left out after a joint has stopped, for filters and presliding, and before it departs.
_SETTLES, _DEPARTS = 0.25, 0.1
#: By which share of its peak friction must have risen during the hold, and how much of it the
#: change of the rigid effort may be while the joint departs.
_RISE, _INERTIA = 0.3, 0.15
#: Departures in one direction from which static friction is taken.
_FEWEST = 3


@described
class RestBound:
    """Lower bound of a joint's static friction, from the time at rest."""

    seconds: float = quantity(
        "time at rest in all logs, in holds of 0.5 s or more that settled", "s"
    )
    largest: float = quantity(
        "the largest friction that held it", EFFORT, "at rest,\nlargest friction"
    )
    share: float = quantity(
        "`largest` / half the identified interval", heading="part of its\nlimit"
    )
    inside: float = quantity(
        "share of the time in which the effort was within the identified interval, but for the "
        "fit's error; NaN where it never rests"
    )
    outside: int = quantity("holds in which the effort was mostly outside the interval")


def rest_bounds(estimate: Estimate, scene: Scene) -> tuple[RestBound, ...]:
    """Return what each joint's holds show of the identified scene: lower bounds."""
    nj = scene.model.nv
    seconds, largest, share, inside, outside = np.zeros((5, nj))
    noise = np.maximum(estimate.problem.weights, 1e-300) ** -0.5  # what the fit leaves
    for prepared in estimate.prepared:
        motion, held = (
            prepared.recording.trajectory,
            _held(prepared.recording, scene.stick_velocity),
        )
        if not held.any():
            continue
        parts = [
            measured_interval(chunk, estimate.question.at)
            for chunk in inverse_dynamics(scene, motion, chunks=PART)
        ]
        lower, upper = (np.concatenate(ends) for ends in zip(*parts, strict=True))
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        off = np.abs(prepared.effort(motion.t) + prepared.payload + prepared.missing - middle)
        for j in range(nj):
            at = held[:, j] & np.isfinite(off[:, j])
            if at.any():
                seconds[j] += at.sum() * prepared.recording.step
                within = off[:, j] <= half[:, j] + noise[j]
                inside[j] += within[at].sum() * prepared.recording.step
                outside[j] += sum(within[a : b + 1].mean() < 0.5 for a, b in runs(at))
                largest[j] = max(largest[j], float(off[at, j].max()))
                wide = np.maximum(half[at, j], 1e-12)
                share[j] = max(share[j], float((off[at, j] / wide).max()))
    inside = np.where(seconds > 0.0, inside / np.maximum(seconds, 1e-12), np.nan)
    columns = np.column_stack((seconds, largest, share, inside)).tolist()
    return tuple(
        RestBound(a, b, c, d, round(holds))
        for (a, b, c, d), holds in zip(columns, outside.tolist(), strict=True)
    )


def _held(recording: Recording, stick: float) -> BoolArray:
    """(T, nv) where a drive rests or creeps below `stick`, in settled holds."""
    held, end = np.zeros_like(recording.rests), len(recording.rests) - 1
    settles, departs = (round(span / recording.step) for span in (_SETTLES, _DEPARTS))
    for j, v in enumerate(recording.velocity.T):
        for first, last in runs(recording.rests[:, j] | (np.abs(v) <= stick)):
            if (last - first) * recording.step >= _HELD:
                here = first + settles * (first > 0), last + 1 - departs * (last < end)
                held[slice(*here), j] = True
    return held


@dataclass(frozen=True)
class BreakAway:
    """Friction at which a joint left rest in one direction, N m or N, with its 95 % interval."""

    mean: float
    low: float
    high: float
    standard_error: float


def break_aways(estimate: Estimate) -> dict[tuple[int, int], BreakAway]:
    """Return joint, FORWARD or BACKWARD -> static friction, where three departures or more show it.

    Not of joints with a bearing in their law: its load is part of what holds them.
    """
    from scipy.special import stdtrit

    result = {}
    for j, law in enumerate(estimate.choice.laws):
        peaks: dict[int, list[float]] = {FORWARD: [], BACKWARD: []}
        for prepared in estimate.prepared:
            if law.load != "bearing":
                for direction, peak in _peaks(estimate, prepared, j):
                    peaks[direction].append(peak)
        for direction, values in peaks.items():
            if len(values) >= _FEWEST:
                error = float(np.std(values, ddof=1) / np.sqrt(len(values)))
                mean, reach = float(np.mean(values)), float(stdtrit(len(values) - 1, 0.975)) * error
                result[j, direction] = BreakAway(mean, max(mean - reach, 0.0), mean + reach, error)
    return result


def _peaks(estimate: Estimate, prepared: Prepared, joint: int) -> Iterator[tuple[int, float]]:
    """Yield direction and largest friction of each slow departure."""
    recording, rigid = prepared.recording, prepared.load[:, joint]
    t, step, v = recording.trajectory.t, recording.step, recording.velocity[:, joint]
    effort = np.where(np.isfinite(recording.effort[:, joint]), recording.effort[:, joint], rigid)
    if step * PEAK_PASS < 0.45:
        effort = low_pass(effort, step, PEAK_PASS)
    effort = np.interp(t + estimate.delay.value, t, effort) + prepared.missing[:, joint]
    law, slots = estimate.choice.laws[joint], estimate.fit.slots[joint]
    driving, driven, both = (
        float(slots[GEARS[law.side, direction]]) for direction in ("driving", "driven", "both")
    )
    driving, driven = driving + both, driven + both
    before, near, after = (int(np.ceil(span / step)) for span in (_BEFORE, _NEAR, _AFTER))
    for first, last in runs(recording.rests[:, joint]):
        if (last - first) * step < _HELD or last + after >= t.size:
            continue
        sign = float(np.sign(v[last + 1 : last + after + 1].sum()))
        # what holds, sign (effort - load), the gear's losses taken out of the effort
        held, load = effort[first : last + 1], rigid[first : last + 1]
        if law.side == "joint":
            lossless = held / np.where(sign * held > 0.0, 1.0 + driving, 1.0 - driven)
            friction = sign * (lossless - load)
        else:
            losses = np.abs(load) * np.where(sign * load > 0.0, driving, driven)
            friction = sign * (held - load) - losses
        peak = float(friction[-before:].max())
        rises = peak - float(np.quantile(friction, 0.1)) > _RISE * peak
        # a jump at the last samples is cut where motion first shows, somewhere below what held
        gradual = float(friction[-2 * near : -near].mean()) > (1.0 - _RISE) * peak
        change = np.abs(rigid[last : last + after + 1] - rigid[last]).max()
        if peak > 0.0 and rises and gradual and change < _INERTIA * peak:
            yield FORWARD if sign > 0.0 else BACKWARD, peak
