"""Lack of fit: what a joint's residual still depends on (`notebooks/theory/identification`).

    r = Z b + noise,    Z: shapes over angle, speed, effort, time, and of the fitted effort's slope

The model's columns are taken out of Z and r first. b = 0 is tested with N spans of time:

    T = s^T (sum of s_i s_i^T)^-1 s,    s_i = Z_i^T W r_i,   s their sum

(N - m) T / (m (N - T)) follows F(m, N - m) where the model is right. A shape that is found joins
the model before the next is looked for, so that one cause is not named twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.samples.reactions import state_wrenches
from pinfric.dynamics.samples.states import States
from pinfric.identification.columns import PASS, Prepared
from pinfric.identification.estimate import Estimate, turns
from pinfric.identification.laws import COULOMB, INERTIA, STRIBECK_VELOCITY
from pinfric.identification.normal import orthonormal, residuals
from pinfric.model.arrays import FloatArray, IntArray

#: Probability of a shape found by chance, of each of the some 20 shapes of a joint.
_CHANCE = 1e-4
#: Share of a residual's mean square that a shape must explain to be named.
_LEAST_SHARE = 0.02
#: s: residuals further apart count as independent. Spans below which nothing is tested.
_SPAN, _FEWEST_SPANS = 1.5, 10
#: Shapes named at one joint at most.
_MOST = 3
#: Times per turn at which friction may change with the angle.
_HARMONICS = tuple(range(1, 13))
#: Coulomb friction forward and backward that differ by more than this share of their sum may well
#: be equal, and the effort's sensor off.
UNEVEN = 0.15
#: What friction depends on that changes while it is logged.
TIME = "time (warm-up, or sensor drift)"
#: Directions of a shape do not show if the model's columns leave less than this share of their
#: square. Hats over the speed make Coulomb friction, and their sum with it could be anything.
_DESCRIBED = 0.1


@dataclass(frozen=True)
class Misfit:
    """One shape of a joint's residual that its law does not have.

    Attributes:
        over: what the residual depends on, in words.
        size: RMS of the shape, N m or N.
        share: of the residual's mean square.
        columns: (n, m) the shape's, of the joint's rows, each of one standard deviation.
        shown: number of leading columns that differ enough from the model.
    """

    joint: int
    over: str
    size: float
    share: float
    columns: FloatArray
    shown: int


@dataclass(frozen=True)
class _Track:
    """What shapes depend on, (n,) each: of one joint's rows in all logs.

    Attributes:
        q, v, a: of the drive; q rad or m.
        slope, bend: first and second derivative of the fitted effort, by s.
        time: from -1 to 1 over each log.
        press: (n, 3) loads of the joint's bearing: force across and along its axis, moment.
    """

    q: FloatArray
    v: FloatArray
    a: FloatArray
    slope: FloatArray
    bend: FloatArray
    time: FloatArray
    press: FloatArray


def misfits(estimate: Estimate) -> tuple[Misfit, ...]:
    """Return the shapes of residuals, joint by joint, the largest of each first."""
    presses = [_presses(estimate, one) for one in estimate.prepared]
    return tuple(
        one for j in estimate.known for one in _of_joint(estimate, j, _track(estimate, j, presses))
    )


def uneven(estimate: Estimate) -> dict[int, float]:
    """Return joint -> half the difference of its Coulomb friction by direction, where it is large.

    An offset of the effort's sensor makes the same difference; no log distinguishes the two.
    """
    result = {}
    for j in estimate.known:
        up, down = estimate.fit.slots[j, COULOMB].tolist()
        if estimate.choice.laws[j].coulomb and abs(up - down) > UNEVEN * (up + down):
            result[j] = 0.5 * (up - down)
    return result


def _of_joint(estimate: Estimate, joint: int, track: _Track) -> Iterator[Misfit]:
    """Yield the shapes of one joint's residual, the largest first."""
    rows, weight = estimate.rows[joint], np.sqrt(estimate.row_weights[joint])
    key = np.column_stack((rows.log, np.floor(rows.time / _SPAN).astype(np.int64)))
    span = np.unique(key, axis=0, return_inverse=True)[1].ravel()  # of each row
    spans = int(span.max(initial=-1)) + 1
    if spans < _FEWEST_SPANS:
        return
    law = estimate.choice.laws[joint]
    active = [INERTIA, *law.slots, *([STRIBECK_VELOCITY] if law.stribeck_slots else [])]
    model = np.column_stack((rows.rigid, rows.slots[:, active])) * weight[:, None]
    residual = residuals(rows, estimate.fit, joint) * weight
    shapes = list(_shapes(estimate, joint, track))
    for _ in range(_MOST):
        basis = orthonormal(model)
        unexplained = residual - basis @ (basis.T @ residual)
        best: Misfit | None = None
        for over, columns in shapes:
            # the shape's principal directions, and, less the model, those of which it leaves much
            own = orthonormal(columns * weight[:, None])
            beside = own - basis @ (basis.T @ own)
            values, vectors = np.linalg.eigh(-beside.T @ beside)
            own, beside = own @ vectors, beside @ vectors[:, -values > _DESCRIBED]
            clear, m = beside / np.linalg.norm(beside, axis=0), beside.shape[1]
            if m == 0 or spans < 2 * m + 2:
                continue
            square = float(np.sum((clear.T @ unexplained) ** 2))
            share = square / float(unexplained @ unexplained)
            if share < max(_LEAST_SHARE, best.share if best else 0.0):
                continue
            sums = np.zeros((spans, m))
            np.add.at(sums, span, clear * unexplained[:, None])
            if chance(sums) < _CHANCE:
                spread = float(np.sqrt(square / np.sum(beside**2))) / weight[:, None]
                best = Misfit(
                    joint, over, float(np.sqrt(square / unexplained.size)), share, spread * own, m
                )
        if best is None:
            return
        yield best
        model = np.column_stack((model, best.columns * weight[:, None]))


def chance(sums: FloatArray) -> float:
    """Return the probability of sums (N, m) so far from zero if their mean is zero."""
    from scipy.special import fdtrc

    (count, m), total = sums.shape, sums.sum(axis=0)
    T = float(total @ np.linalg.lstsq(sums.T @ sums, total, rcond=1e-10)[0])
    return float(fdtrc(m, count - m, T * (count - m) / (m * max(count - T, 1e-9))))


def _presses(estimate: Estimate, prepared: Prepared) -> FloatArray:
    """Loads of each joint's bearing in one log, (n, nj, 3): N across and along its axis, N m.

    The moment is the part that does not act about the axis.
    """
    motion, model = prepared.recording.trajectory, estimate.scene.model
    q, v, a, attached = (
        np.ascontiguousarray(x[prepared.kept])
        for x in (motion.q, motion.v, motion.a, motion.attached)
    )
    wrench = state_wrenches(estimate.scene, States.of(estimate.scene, q, v, a, None, attached))
    loads = np.empty((len(q), model.nv, 3))
    for j in range(model.nv):
        axes = np.asarray(model.joints[j + 1].createData().S).reshape(6)
        axis = axes[3:] if axes[3:].any() else axes[:3]
        force, moment = wrench[:, j, :3], wrench[:, j, 3:]
        along, about = force @ axis, moment @ axis
        loads[:, j, 0] = np.linalg.norm(force - along[:, None] * axis, axis=1)
        loads[:, j, 1] = np.abs(along)
        loads[:, j, 2] = np.linalg.norm(moment - about[:, None] * axis, axis=1)
    return loads


def _track(estimate: Estimate, joint: int, presses: Sequence[FloatArray]) -> _Track:
    from scipy.interpolate import CubicSpline

    parts = []
    for prepared, press in zip(estimate.prepared, presses, strict=True):
        at = prepared.kept[prepared.slides[:, joint]]
        recording, own = prepared.recording, prepared.slides[:, joint]
        t = recording.trajectory.t
        fitted = (
            prepared.rigid[:, joint] @ estimate.fit.theta
            + prepared.slots[:, joint] @ estimate.fit.slots[joint]
        )
        curve = CubicSpline(t[prepared.kept], fitted)
        q = recording.trajectory.joint_positions()[at, joint]
        parts.append(
            (
                q,
                recording.velocity[at, joint],
                recording.acceleration[at, joint],
                curve(t[prepared.kept], 1)[own],
                curve(t[prepared.kept], 2)[own],
                _in_log(t, at),
                press[own, joint],
            )
        )
    return _Track(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def in_log(estimate: Estimate, joint: int) -> FloatArray:
    """Return (n,) the times of a joint's rows, from -1 to 1 over each log."""
    parts = [
        _in_log(log.recording.trajectory.t, log.kept[log.slides[:, joint]])
        for log in estimate.prepared
    ]
    return np.concatenate(parts)


def _in_log(t: FloatArray, at: IntArray) -> FloatArray:
    middle, half = 0.5 * (t[0] + t[-1]), 0.5 * (t[-1] - t[0])
    return np.asarray((t[at] - middle) / half)


def _shapes(estimate: Estimate, joint: int, track: _Track) -> Iterator[tuple[str, FloatArray]]:
    """Yield what a residual may depend on, in words, and its columns."""
    v, load, sign = track.v, estimate.rows[joint].load, np.sign(track.v)
    speed = np.abs(v)
    yield from _by_angle(estimate, joint, track)
    hats = _hats(speed, (0.02, 0.1, 0.25, 0.5, 0.8))
    yield "the speed", hats * sign[:, None]
    yield (
        "the sign of its acceleration (play, a soft drive, or filtered efforts)",
        _hats(speed, (0.1, 0.5, 0.9)) * np.sign(track.a)[:, None],
    )
    yield (
        "the effort that it transmits",
        np.column_stack((sign * np.abs(load), sign * load, load * np.abs(load), load**2 * sign)),
    )
    yield (
        "the load on its bearing (add the bearing to the scene to make it a candidate)",
        track.press * sign[:, None],
    )
    yield (
        TIME,
        np.column_stack((track.time, sign * track.time, v * track.time, sign * track.time**2)),
    )
    yield (
        "the rate of change of the effort (filtered efforts, or another delay)",
        np.column_stack((track.slope, track.bend)),
    )


def _by_angle(estimate: Estimate, joint: int, track: _Track) -> Iterator[tuple[str, FloatArray]]:
    """Yield shapes over the angle or travel of a joint, and over its motor's angle."""
    drive, sign = estimate.scene.drives[joint], np.sign(track.v)
    turning = turns(estimate.scene, estimate.scene.joint_names[joint])
    low, high = float(track.q.min()), float(track.q.max())
    angle = track.q if turning else np.pi * (track.q - low) / max(high - low, 1e-12)
    for k in _HARMONICS:
        waves = np.column_stack((np.sin(k * angle), np.cos(k * angle)))
        often = "once" if k == 1 else "twice" if k == 2 else f"{k} times"
        where = f"its angle ({often} per turn)" if turning else "its position"
        yield where, np.hstack((waves, waves * sign[:, None]))
    ratio = abs(drive.ratio)
    for k in (1, 2) if turning and ratio > 1.5 * _HARMONICS[-1] else ():
        # what the low pass on all columns leaves of a ripple of that frequency
        frequency = k * ratio * np.abs(track.v) / (2.0 * np.pi)
        gain = 1.0 / (1.0 + (frequency / PASS) ** 8)
        waves = gain[:, None] * np.column_stack(
            (np.sin(k * ratio * track.q), np.cos(k * ratio * track.q))
        )
        often = "once" if k == 1 else "twice"
        yield f"the motor's angle ({often} per turn)", np.hstack((waves, waves * sign[:, None]))


def _hats(x: FloatArray, quantiles: Sequence[float]) -> FloatArray:
    """Piecewise linear functions with knots at quantiles, whose sum is one."""
    knots = np.unique(np.quantile(x, quantiles))
    return np.column_stack([np.interp(x, knots, row) for row in np.eye(knots.size)])
