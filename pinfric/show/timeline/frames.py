"""Frames of a replay: where the joints are, what each friction site does, and when.

At rest friction is an interval in results of inverse dynamics, a number in simulated motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult, StickInterval
from pinfric.dynamics.samples.reactions import state_wrenches
from pinfric.dynamics.samples.states import States
from pinfric.dynamics.simulation.motion import FINISHED, Motion
from pinfric.errors import PinfricError, StateError
from pinfric.model.closure import loop_state
from pinfric.model.scene import Scene
from pinfric.motions.log.judged import JudgedLog
from pinfric.retiming.limits import DriveLimits
from pinfric.show.timeline.spans import (
    SiteTimes,
    Spans,
    carried_payloads,
    gear_holds,
    limit_use,
    limiting_drives,
    off_the_log,
    site_times,
)

#: Frames per second of a replay.
RATE = 60.0
#: Most frames; a longer motion gets fewer per second. As many again where sticking begins or ends
#: (a log whose noise passes zero at every other sample has more: some of them are left out then).
MOST_FRAMES = 20_000


@dataclass(frozen=True)
class Frames:
    """A motion cut into F frames, for nj joints and ns friction sites.

    Attributes:
        t: (F,) increasing, s; with every beginning and end of sticking, up to `MOST_FRAMES` of
            them.
        placement: (F, nj, 7) of each joint in the world: x, y, z in m, quaternion x, y, z, w.
        friction_lower, friction_upper: (F, ns) of the parent on the child along the joint's
            positive direction (N m or N).
        force: (F, ns, 3) of the parent on the child, in the child's joint frame (N).
        slip: (F, ns, 3) unit vector of friction in this frame: the site's axis; of a ball the
            direction of its slip (at rest: of its last slip).
        use: (F, ns) |friction| over its limit where a simulated site sticks, NaN elsewhere.
        sites: what each site does when.
        stick_intervals: in the order of the sites.
        carried: payload -> spans in which it is carried.
        gears: drive -> spans, if any, in which its gear holds the joint by itself: it stands still
            under an effort other than 0, and the motor's torque may be 0.
        off: drive -> spans in which its logged effort is off the computed one by more than 10 %,
            and more than 30 %, of its RMS; at rest the nearest value of the interval counts.
        limiting: drive -> limit of `drives.limits.instant_limits` -> spans, if any, in which the
            robot moves, this is the drive's most used limit, and more than 99.5 % of it, and more
            than 100.2 %, are used.
        simulated: whether the motion is simulated.
        ended: why a simulation ended early, or "".
    """

    t: np.ndarray
    placement: np.ndarray
    friction_lower: np.ndarray
    friction_upper: np.ndarray
    force: np.ndarray
    slip: np.ndarray
    use: np.ndarray
    sites: tuple[SiteTimes, ...]
    stick_intervals: tuple[StickInterval, ...]
    carried: dict[str, Spans]
    gears: dict[str, Spans]
    off: dict[str, tuple[Spans, Spans]]
    limiting: dict[str, dict[str, tuple[Spans, Spans]]]
    simulated: bool
    ended: str = ""

    @property
    def duration(self) -> float:
        """s, from the first frame to the last."""
        return float(self.t[-1] - self.t[0])


def make_frames(
    scene: Scene,
    motion: InverseResult | Motion,
    rate: float = RATE,
    log: JudgedLog | None = None,
    limits: Sequence[DriveLimits] | None = None,
) -> Frames:
    """Cut a motion into frames that lose no change between sliding and sticking.

    Args:
        motion: a result of inverse dynamics with times, or a simulated motion.
        rate: frames per second; fewer if they would exceed `MOST_FRAMES`.
        log: the motion's, compared with the result.
        limits: (na,) of the drives, for a result of inverse dynamics.

    Raises:
        StateError: no times, a rate that is not positive.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise StateError(f"replay: rate {rate}; give a positive number of frames per second")
    if isinstance(motion, Motion):
        states = States.of(scene, motion.q, motion.v, motion.a, motion.t, motion.attached)
    else:
        states = motion.states
    t = states.t
    if t is None:
        raise StateError("a replay needs times: give `t` to inverse_dynamics")
    intervals = motion.stick_intervals()
    rate = min(rate, MOST_FRAMES / max(float(t[-1] - t[0]), 1e-9))
    # Samples around every change of what a site does and of what is carried, the most evenly
    marks = [motion.modes] if isinstance(motion, Motion) else [motion.sticking, motion.reversal]
    if isinstance(motion, InverseResult):
        marks.append(motion.status[:, None])
    if states.attached is not None:
        marks.append(states.attached)
    change = np.flatnonzero(np.any([(x[1:] != x[:-1]).any(axis=1) for x in marks], axis=0))
    keys = np.sort(np.concatenate((change, change + 1)))
    if len(keys) > MOST_FRAMES:
        keys = keys[np.linspace(0, len(keys) - 1, MOST_FRAMES).astype(int)]
    times, index = frame_times(t, keys, rate)
    ended, off, limiting = "", {}, {}
    if isinstance(motion, Motion):
        lower, upper, use = motion.friction, motion.friction, limit_use(scene, motion)
        ended = "" if motion.status == FINISHED else motion.message
    else:
        lower, upper = motion.friction_lower, motion.friction_upper
        use = np.full(lower.shape, np.nan)
        off = {} if log is None else off_the_log(motion, log)
        limiting = {} if limits is None else limiting_drives(motion, limits)
    return Frames(
        t=times,
        placement=_placements(scene.model, states, times, index),
        friction_lower=lower[index],
        friction_upper=upper[index],
        force=_forces(scene, motion, states, index),
        slip=_slip_directions(scene, states.q[index], states.v[index]),
        use=use[index],
        sites=tuple(site_times(motion, s, intervals, use) for s in range(len(scene.sites))),
        stick_intervals=intervals,
        carried=carried_payloads(scene, states),
        gears=gear_holds(scene, motion, states),
        off=off,
        limiting=limiting,
        simulated=isinstance(motion, Motion),
        ended=ended,
    )


def site_rates(scene: Scene, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the relative velocity (n, ns, 3) of every friction site, child to parent or b to a.

    In the frame of the site's wrench, rad/s or m/s: along the site's axis, of a ball the whole
    angular velocity; at a loop's joint from the bodies that it joins.

    Args:
        q: (n, nq).
        v: (n, nv).
    """
    sites, linkage = scene.site_tables, scene.linkage
    along = v[:, sites.velocity_index] * sites.ratio if scene.model.nv else v[:, :0]
    rates = along[:, :, None] * sites.axis
    loops = [(s, site) for s, site in enumerate(scene.sites) if site.pair >= 0]
    if loops and linkage is not None:
        action = loop_state(scene.twin(), linkage, q, v, np.zeros_like(v)).rate
        for s, site in loops:
            first = linkage.friction_column[site.pair]
            rate = action[:, first : first + (3 if site.ball else 1)]
            rates[:, s] = rate if site.ball else rate * site.axis
    return np.asarray(rates)


def frame_times(t: np.ndarray, keys: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the times of the frames and, for each, the sample at or before it.

    Frames are samples where these are closer; else frames are added between them. The keys and the
    last sample are always frames.

    Args:
        t: (T,) increasing times of the samples, s.
        keys: indices of samples that must be frames.
        rate: frames per second.
    """
    count = max(int(np.ceil((t[-1] - t[0]) * rate)), 1)
    grid = np.linspace(t[0], t[-1], count + 1)
    before = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 1)
    after = np.minimum(before + 1, len(t) - 1)
    wide = t[after] - t[before] > 1.5 / rate
    nearest = np.where(t[after] - grid < grid - t[before], after, before)
    ends = [0, len(t) - 1]
    chosen = np.concatenate((nearest[~wide], before[wide], after[wide], keys, ends))
    chosen = np.unique(chosen.astype(int))
    between = np.setdiff1d(grid[wide], t)
    times = np.concatenate((t[chosen], between))
    order = np.argsort(times, kind="stable")
    times = times[order]
    return times, np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 1)


def _forces(
    scene: Scene, motion: InverseResult | Motion, states: States, index: np.ndarray
) -> np.ndarray:
    """(F, ns, 3) force of the parent on the child in the frames' samples.

    For a simulated motion by inverse dynamics; NaN where it has no solution or refuses a sample
    (loops that the integrator leaves slightly open).
    """
    if isinstance(motion, Motion):
        attached = None if states.attached is None else states.attached[index]
        try:
            result = inverse_dynamics(
                scene, states.q[index], states.v[index], states.a[index], attached=attached
            )
        except PinfricError:
            return np.full((len(index), len(scene.sites), 3), np.nan)
        return _wrenches(scene, result)[:, :, :3]
    return _wrenches(scene, motion)[index, :, :3]


def _slip_directions(scene: Scene, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(F, ns, 3) see `Frames.slip`; a ball that never slips has its axis."""
    out = np.tile(scene.site_tables.axis, (len(q), 1, 1))
    balls = [s for s, site in enumerate(scene.sites) if site.ball]
    if not balls:
        return out
    rates = site_rates(scene, q, v)
    for s in balls:
        speed = np.linalg.norm(rates[:, s], axis=1)
        moves = np.flatnonzero(speed > scene.site_tables.laws.stick_velocity[s])
        if len(moves):  # at rest: as it slipped last; before the first slip: as it will
            last = np.searchsorted(moves, np.arange(len(q)), side="right") - 1
            frame = moves[np.maximum(last, 0)]
            out[:, s] = rates[frame, s] / speed[frame, None]
    return out


def _wrenches(scene: Scene, result: InverseResult) -> np.ndarray:
    """(T, ns, 6); NaN with loops if no friction depends on reactions."""
    if result.wrench is not None:
        return result.wrench
    rows = scene.site_tables.joint
    if scene.linkage is not None:
        return np.full((len(result.states.q), len(rows), 6), np.nan)
    return state_wrenches(scene, result.states, result.external, threads=1)[:, rows]


def _placements(
    model: pin.Model, states: States, times: np.ndarray, index: np.ndarray
) -> np.ndarray:
    """(F, nj, 7) at the samples, between them on the cubic with their q and v."""
    q, v, t, data = states.q, states.v, states.times, model.createData()
    out = np.empty((len(index), model.njoints - 1, 7))
    for f, i in enumerate(index):
        row = q[i]
        if times[f] > t[i]:
            h = t[i + 1] - t[i]
            s = (times[f] - t[i]) / h
            step = (s**3 - 2 * s**2 + s) * h * v[i] + (s**3 - s**2) * h * v[i + 1]
            step += (3 * s**2 - 2 * s**3) * pin.difference(model, row, q[i + 1])
            row = pin.integrate(model, row, step)
        pin.forwardKinematics(model, data, row)
        out[f] = [pin.SE3ToXYZQUAT(data.oMi[j]) for j in range(1, model.njoints)]
    return out
