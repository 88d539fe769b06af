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
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.scene import Scene
from pinfric.motions.log.judged import measured_interval


def held_out_errors(estimate: Estimate, scene: Scene) -> dict[str, HeldOut]:
    """Return each joint's errors on blocks of the fitted logs that were held out.

    Rows beside turning points are in no fit: the identified `scene` predicts them.
    """
    return _errors(estimate, scene, estimate.prepared, *estimate.errors)


def unseen_errors(estimate: Estimate, scene: Scene, recording: Recording) -> dict[str, HeldOut]:
    """Return each joint's errors in a log that was held out as a whole."""
    question, thin = estimate.question, thinning([recording])
    log = reloaded(estimate, prepare(question.scene, recording, thin, question.no_gravity))
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
        efforts, off = [own], [np.full(own.size, error)]
        for log, (left, where) in zip(logs, others, strict=True):
            times = log.recording.trajectory.t[log.kept[where[:, j]]]
            efforts.append(log.effort(times + delay)[:, j])
            off.append(left[where[:, j], j])
        result[name] = HeldOut(_rms([own]), float(error), float(coulomb), _rms(efforts), _rms(off))
    return result


def _unfitted(estimate: Estimate, scene: Scene, log: Prepared) -> tuple[FloatArray, BoolArray]:
    """Return measured less predicted effort (n, nj), and where a joint moves in no fitted row.

    Where a joint sticks, the nearest effort of its interval is the predicted one.
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
    return off, moves & ~log.slides


def _rms(parts: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
