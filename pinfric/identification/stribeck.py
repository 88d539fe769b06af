"""Stribeck friction of one joint: friction that falls from rest to motion, and at which speed.

    friction = ... + s(v) (e+ [v > 0] - e- [v < 0] + e c sign v)
    s = exp(-(|v|/v_s)^n),  1 <= n <= 2

c is the bearing's load. e+, e- and e are coefficients like all others; n and v_s are searched for
the least residual r, and the covariance has a column d/d(log v_s). Another n is admitted where it
fits worse by less than three standard errors, summed over blocks b:

    (|r'|^2 - |r|^2) |d|^2 <= 9 sum of (d_b^T r_b)^2,    d = r' - r
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinfric.identification.columns import FEWEST_ROWS, Prepared, Rows, passed, thinned
from pinfric.identification.laws import RESTS_ON, STRIBECK_VELOCITY
from pinfric.identification.normal import orthonormal
from pinfric.model.arrays import FloatArray

#: Share of a residual's mean square that Stribeck friction must explain to be a candidate.
_LEAST_GAIN = 0.04
#: Speeds that are tried, from the slowest logged sliding to half the fastest.
_TRIED = 12
#: n that are tried.
_EXPONENTS = (1.0, 1.5, 2.0)
#: Standard errors by which an exponent must fit worse to be left out.
_REJECTED = 3.0
#: Places of what may fall.
_PARTS = list(RESTS_ON)
#: How far log v_s is searched about the best speed tried.
_AROUND = 1.0


@dataclass(frozen=True)
class StribeckFit:
    """How one joint's friction falls from rest to motion.

    Attributes:
        velocity: v_s, at which 1/e of the excess is left, rad/s or m/s.
        exponent: n.
        forward, backward, load: the excess at rest (N m or N, and of the load's coefficient) about
            which d/d(log v_s) is taken.
        others: the best fit with each other exponent that is admitted.
    """

    velocity: float
    exponent: float
    forward: float
    backward: float
    load: float = 0.0
    others: tuple[StribeckFit, ...] = ()

    @property
    def excess(self) -> list[float]:
        """Forward, backward, and of the load's coefficient."""
        return [self.forward, self.backward, self.load]


def find_stribeck(
    prepared: Sequence[Prepared],
    joint: int,
    rows: Rows,
    weight: FloatArray,
    taken: Sequence[int],
    parts: Sequence[Sequence[int]],
) -> StribeckFit | None:
    """Return the fit that explains most of a joint's effort; None where it explains too little.

    Args:
        prepared: the logs. joint: its number. rows: of the joint. weight: (n,) of these.
        taken: slots of the joint's law without Stribeck friction.
        parts: choices of what may fall, of `STRIBECK` and `STRIBECK_LOAD`.
    """
    from scipy.optimize import minimize_scalar

    speed = np.abs(rows.velocity)
    if min((rows.velocity > 0.0).sum(), (rows.velocity < 0.0).sum()) < FEWEST_ROWS:
        return None
    root = np.sqrt(weight)[:, None]
    basis = orthonormal(np.column_stack((rows.rigid, rows.slots[:, list(taken)])) * root)
    residual = rows.effort * root[:, 0]
    residual = residual - basis @ (basis.T @ residual)

    choices = [[_PARTS.index(slot) for slot in part] for part in parts]

    def fitted(columns: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """How much the best choice reduces squares, its coefficients, what it fits."""
        own = columns * root
        own = own - basis @ (basis.T @ own)
        best = 0.0, np.zeros(len(_PARTS)), np.zeros(len(own))
        for at in choices:
            x: FloatArray = np.linalg.lstsq(own[:, at], residual, rcond=1e-8)[0].astype(float)
            fit = own[:, at] @ x
            if x.min() > 0.0 and (gain := float(fit @ fit)) > best[0]:
                values = np.zeros(len(_PARTS))
                values[at] = x
                best = gain, values, fit
        return best

    load = np.concatenate([one.bearing[one.kept[one.slides[:, joint]], joint] for one in prepared])
    low, high = np.log(np.quantile(speed, (0.01, 0.98)) * (1.0, 0.5))
    tried = np.linspace(low, high, _TRIED)
    fits: list[tuple[float, StribeckFit, FloatArray]] = []
    for n in _EXPONENTS:
        # first without the low pass, which changes little away from rest
        gains = [fitted(_ways(rows.velocity, load, float(np.exp(x)), n))[0] for x in tried]
        if max(gains) < _LEAST_GAIN * float(residual @ residual):
            continue
        middle = tried[int(np.argmax(gains))]
        ends = max(middle - _AROUND, low - _AROUND), min(middle + _AROUND, high)
        searched = minimize_scalar(
            lambda x, n=n: -fitted(_passed(prepared, joint, float(np.exp(x)), n))[0],
            bounds=ends,
            method="bounded",
            options={"xatol": 5e-3},
        )
        velocity = float(np.exp(searched.x))
        gain, values, fit = fitted(_passed(prepared, joint, velocity, n))
        if gain > 0.0:
            fits.append((gain, StribeckFit(velocity, n, *values.tolist()), fit))
    if not fits:
        return None
    gain, stribeck, best = max(fits, key=lambda one: one[0])
    admitted = []
    for own, other, fit in fits:
        apart = fit - best
        scores = np.bincount(rows.block, apart * (residual - best))
        if (gain - own) * float(apart @ apart) <= _REJECTED**2 * float(scores @ scores):
            admitted.append(other)
    return replace(stribeck, others=tuple(one for one in admitted if one is not stribeck))


def beside_other(
    prepared: Sequence[Prepared], joint: int, stribeck: StribeckFit, other: StribeckFit
) -> FloatArray:
    """Return (n,) how much more friction another exponent's fit gives at a joint's rows."""
    present, changed = (
        _passed(prepared, joint, fit.velocity, fit.exponent) @ fit.excess
        for fit in (stribeck, other)
    )
    return np.asarray(changed - present)


def with_stribeck(prepared: Prepared, fits: tuple[StribeckFit | None, ...]) -> Prepared:
    """Return a log's columns with those of Stribeck friction, by joint."""
    recording, kept = prepared.recording, prepared.kept
    slots, rates = prepared.slots.copy(), prepared.slot_rates.copy()
    at = [*_PARTS, STRIBECK_VELOCITY]
    for j, stribeck in enumerate(fits):
        if stribeck is None:
            slots[:, j, at] = rates[:, j, at] = 0.0
            continue
        v = recording.velocity[:, j]
        n = stribeck.exponent
        ways = _ways(v, prepared.bearing[:, j], stribeck.velocity, n)
        slope = n * np.abs(v / stribeck.velocity) ** n * (ways @ stribeck.excess)
        columns = passed(np.column_stack((ways, slope)), recording.step)
        slots[:, j, at], rates[:, j, at] = thinned(columns, kept, recording.step)
    return replace(prepared, slots=slots, slot_rates=rates)


def _ways(v: FloatArray, load: FloatArray, velocity: float, exponent: float) -> FloatArray:
    """Columns (n, 3) of the excess at v: forward, backward, of the load's coefficient."""
    decay = stribeck_decay(v, velocity, exponent)
    return np.column_stack((decay * (v > 0.0), -decay * (v < 0.0), decay * load * np.sign(v)))


def _passed(
    prepared: Sequence[Prepared], joint: int, velocity: float, exponent: float
) -> FloatArray:
    """The columns of `_ways` at a joint's rows in all logs, low-passed."""
    return np.concatenate(
        [
            passed(_ways(v, log.bearing[:, joint], velocity, exponent), log.recording.step)[
                log.kept[log.slides[:, joint]]
            ]
            for log in prepared
            for v in [log.recording.velocity[:, joint]]
        ]
    )


def stribeck_decay(v: FloatArray, velocity: float, exponent: float) -> FloatArray:
    """Return exp(-(|v|/v_s)^n), the share of the excess at rest; both speeds in rad/s or m/s."""
    return np.exp(-(np.abs(v / velocity) ** exponent))
