"""Spans of time of a motion's friction sites, gears, drives and payloads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.drives.limits import instant_limits
from pinfric.dynamics.inverse.result import InverseResult, StickInterval, runs
from pinfric.dynamics.samples.closure import working_rates
from pinfric.dynamics.samples.motor_torques import motor_torques
from pinfric.dynamics.samples.outcome import Status
from pinfric.dynamics.samples.states import States
from pinfric.dynamics.simulation.motion import Motion
from pinfric.model.scene import Scene
from pinfric.motions.log.judged import JudgedLog, measured_interval
from pinfric.retiming.limits import DriveLimits
from pinfric.retiming.problem import usage

#: A simulated site this near its stick limit is about to break away.
NEAR = 0.9
#: In inverse dynamics break-away is certain only where motion resumes: the end of the interval is
#: marked, this many seconds of it, at most this part.
BEFORE, BEFORE_PART = 0.1, 0.25

#: Shares of a logged effort's RMS by which it is off, and far off, the computed one.
OFF = 0.1, 0.3

#: Part of a limit from which on it holds a motion back, and from which on it is exceeded.
AT_LIMIT = 0.995, 1.002

Spans = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class SiteTimes:
    """When one friction site does not slide: spans (start, end) in s, in order.

    Attributes:
        sticking: at rest, friction anywhere up to its limit.
        near: at rest and about to break away.
        reversal: passes through rest between two samples.
        jammed: the friction laws leave no effort or acceleration, or several.
    """

    sticking: Spans
    near: Spans
    reversal: Spans
    jammed: Spans


def limit_use(scene: Scene, motion: Motion) -> np.ndarray:
    """Return (T, ns) friction over its limit where a simulated site sticks, NaN elsewhere."""
    load, friction, laws = motion.normal_load, motion.friction, scene.site_tables.laws
    forward, backward = laws.coulomb_static.T
    limit = laws.mu_static * load + np.where(friction < 0, forward, backward)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(motion.modes == 0, np.abs(friction) / limit, np.nan)


def site_times(
    motion: InverseResult | Motion, s: int, intervals: Sequence[StickInterval], use: np.ndarray
) -> SiteTimes:
    """Return what one friction site does when.

    Args:
        motion: with times.
        s: number of the site.
        intervals: of all sites, from `motion.stick_intervals`.
        use: (T, ns) of `limit_use`, for simulated motions.
    """
    t, name = motion.t, motion.site_names[s]
    assert t is not None  # make_frames refuses a motion without
    sticking = tuple((i.start, i.end) for i in intervals if i.site == name)
    if isinstance(motion, Motion):
        turns = tuple(
            (e.time, e.time) for e in motion.events if e.name == name and e.kind == "reversal"
        )
        return SiteTimes(sticking, _spans(t, use[:, s] >= NEAR), turns, ())
    end = float(t[-1])
    near = tuple(
        (stop - min(BEFORE, BEFORE_PART * (stop - start)), stop)
        for start, stop in sticking
        if start < stop < end
    )
    failed = motion.status != Status.CONVERGED
    return SiteTimes(sticking, near, _spans(t, motion.reversal[:, s], half=True), _spans(t, failed))


def _spans(t: np.ndarray, mask: np.ndarray, half: bool = False) -> Spans:
    """Return times of the runs of a mask; with `half`, half a sample longer at both ends."""
    spans = []
    for first, last in runs(mask):
        start, end = t[first], t[last]
        if half:
            start = 0.5 * (start + t[max(first - 1, 0)])
            end = 0.5 * (end + t[min(last + 1, len(t) - 1)])
        spans.append((float(start), float(end)))
    return tuple(spans)


def gear_holds(scene: Scene, motion: InverseResult | Motion, states: States) -> dict[str, Spans]:
    """Return when gears hold by themselves: `Frames.gears`."""
    rates, _ = working_rates(scene, states.q, states.v)
    if isinstance(motion, Motion):
        effort = motion.effort, motion.effort
        still = np.zeros_like(rates)  # of interest at rest only, where nothing accelerates
        torque = motor_torques(scene, states, slice(0, len(rates)), effort, rates, still)
    else:
        effort = motion.effort_lower, motion.effort_upper
        torque = motion.motor_torque_lower, motion.motor_torque_upper
    loaded = (effort[0] > 0.0) | (effort[1] < 0.0)
    free = (torque[0] <= 0.0) & (torque[1] >= 0.0)
    held = {}
    for d, drive in enumerate(scene.drives):
        rests = np.abs(rates[:, d]) <= scene.stick_velocity_of(drive)
        holds = rests & loaded[:, d] & free[:, d]
        if drive.transmission is not None and holds.any():
            held[drive.name] = _spans(states.times, holds)
    return held


def off_the_log(result: InverseResult, log: JudgedLog) -> dict[str, tuple[Spans, Spans]]:
    """Return when logged efforts differ from the computed ones: `Frames.off`."""
    missed, (lower, upper) = {}, measured_interval(result, log.at)
    for name, compared in log.measured.items():
        i, effort = result.actuator_names.index(name), log.reading.effort[name]
        gap = np.abs(effort - np.clip(effort, lower[:, i], upper[:, i]))
        mild, strong = (_spans(result.times, gap > share * compared.rms) for share in OFF)
        missed[name] = mild, strong
    return missed


def limiting_drives(
    result: InverseResult, limits: Sequence[DriveLimits]
) -> dict[str, dict[str, tuple[Spans, Spans]]]:
    """Return when limits of drives hold the motion back: `Frames.limiting`."""
    t, use = result.times, usage(result, limits)
    moving = (result.actuator_velocity != 0.0).any(axis=1)
    nearest = use.argmax(axis=2)
    limited: dict[str, dict[str, tuple[Spans, Spans]]] = {}
    for d, name in enumerate(result.actuator_names):
        for k, limit in enumerate(instant_limits()):
            mine = moving & (nearest[:, d] == k)
            near, over = (_spans(t, mine & (use[:, d, k] > share), half=True) for share in AT_LIMIT)
            if near:
                limited.setdefault(name, {})[limit.name] = near, over
    return limited


def carried_payloads(scene: Scene, states: States) -> dict[str, Spans]:
    """Return when each payload is carried: `Frames.carried`."""
    t = states.times
    spans: dict[str, list[tuple[float, float]]] = {name: [] for name in scene.payloads}
    for start, stop, names in states.phases(scene):
        if names is None:
            names = tuple(name for name, payload in scene.payloads.items() if payload.attached)
        for name in names:
            there = spans[name]
            end = float(t[min(stop, len(t) - 1)])
            if there and there[-1][1] == float(t[start]):
                there[-1] = there[-1][0], end
            else:
                there.append((float(t[start]), end))
    return {name: tuple(there) for name, there in spans.items()}
