"""How far predicted efforts are from measured ones: on the rows that are fitted, on all that move.

Both are read behind the low pass of the fit, at the identified delay.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.identification.columns import (
    PART,
    Prepared,
    joint_rows,
    passed,
    prepare,
    settled,
    thinning,
)
from pinfric.identification.estimate import Estimate, reloaded
from pinfric.identification.findings import HeldOut
from pinfric.identification.normal import residuals
from pinfric.identification.recordings import Recording
from pinfric.identification.ways import with_ways
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.scene import Scene
from pinfric.motions.log.judged import measured_interval

#: s after a reversal within which friction may still build up.
_SOON = 0.3


def held_out_errors(estimate: Estimate, scene: Scene) -> dict[str, HeldOut]:
    """Return each joint's errors on blocks of the fitted logs that were held out.

    Rows beside turning points are in no fit: the identified `scene` predicts them.
    """
    return _errors(estimate, scene, estimate.prepared, *estimate.errors)


def unseen_errors(estimate: Estimate, scene: Scene, recording: Recording) -> dict[str, HeldOut]:
    """Return each joint's errors in a log that was held out as a whole."""
    question, thin = estimate.question, thinning([recording])
    log = prepare(question.scene, recording, thin, question.no_gravity)
    if estimate.build is not None and estimate.builds_up:
        log = with_ways(log, estimate.build.ways)
    log = reloaded(estimate, log)
    log = settled(log) if any(estimate.delay.builds_up) else log
    rows = [joint_rows([log], j, estimate.delay.value) for j in range(len(estimate.rows))]
    sliding = [_rms([residuals(own, estimate.fit, j)]) for j, own in enumerate(rows)]
    return _errors(estimate, scene, [log], sliding, [np.nan] * len(rows))


def _errors(
    estimate: Estimate,
    scene: Scene,
    logs: Sequence[Prepared],
    sliding: Iterable[float],
    plain: Iterable[float],
) -> dict[str, HeldOut]:
    """Return the errors of the joints that slide in `logs`; `sliding`, `plain`: on fitted rows."""
    delay, others = estimate.delay.value, [_unfitted(estimate, scene, log) for log in logs]
    result = {}
    for j, (name, error, coulomb) in enumerate(zip(scene.joint_names, sliding, plain, strict=True)):
        own = joint_rows(logs, j, delay).effort
        if not own.size:
            continue
        efforts, off, turned = [own], [np.full(own.size, error)], [np.zeros((2, 0))]
        for log, (left, moves, soon) in zip(logs, others, strict=True):
            whole = log.effort(log.recording.trajectory.t[log.kept] + delay)[:, j]
            where, after = (moves & ~log.slides)[:, j], soon[:, j]
            efforts.append(whole[where])
            off.append(left[where, j])
            turned.append(np.array([whole[after], left[after, j]]))
        at_turns = np.concatenate(turned, axis=1)
        rms = [_rms([row]) if row.size else np.nan for row in at_turns]
        result[name] = HeldOut(
            _rms([own]), float(error), float(coulomb), _rms(efforts), _rms(off), *rms
        )
    return result


def _unfitted(
    estimate: Estimate, scene: Scene, log: Prepared
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Return measured less predicted effort, where joints move, and where they just turned.

    (n, nj) each. Where a joint sticks, the nearest effort of its interval is the predicted one.
    """
    recording, at = log.recording, estimate.question.at
    motion = recording.trajectory
    later, whole = motion.t + estimate.delay.value, recording.effort + log.missing
    measured = np.column_stack([np.interp(later, motion.t, column) for column in whole.T])
    parts = inverse_dynamics(scene, motion, chunks=PART)
    ends = zip(*(measured_interval(part, at) for part in parts), strict=True)
    off = measured - np.clip(measured, *(np.concatenate(end) for end in ends))
    known = np.isfinite(off)
    moves = (known & (np.abs(recording.velocity) > recording.slowest))[log.kept]
    off = passed(np.where(known, off, 0.0), recording.step)[log.kept]
    return off, moves, moves & after_reversals(recording)[log.kept]


def after_reversals(recording: Recording) -> BoolArray:
    """Return (T, nj) whether a joint has reversed in the last 0.3 s."""
    v, soon = recording.velocity, np.zeros(recording.velocity.shape, dtype=bool)
    reach = int(np.ceil(_SOON / recording.step))
    for j in range(v.shape[1]):
        moves = np.flatnonzero(np.abs(v[:, j]) > recording.slowest[j])
        turned = np.flatnonzero(np.diff(np.sign(v[moves, j])) != 0.0)
        for last, first in zip(moves[turned], moves[turned + 1], strict=True):
            soon[last + 1 : first + reach, j] = True
    return soon


def _rms(parts: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
