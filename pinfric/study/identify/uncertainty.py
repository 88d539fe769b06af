"""How far coefficients are known: by blocks within a log, by logs among each other.

Residuals of friction hang together over half a second and longer, so rows are no independent
samples: standard errors that take them so are 3 to 8 times too small. Here whole blocks are the
samples (cluster-robust sandwich). What no log tells apart (a rotor's inertia from that of its link)
follows the URDF the links are drawn to, so the URDF's own error counts, too. What differs between
logs is a factor of each joint's friction: temperature, for the most part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pinfric.dynamics.inverse import inverse_dynamics
from pinfric.study.identify.columns import Prepared, bearings_only
from pinfric.study.identify.estimate import Estimate
from pinfric.study.identify.inertias import with_parameters
from pinfric.study.identify.laws import BACKWARD, BEARING, FORWARD, INERTIA, SLOT, SLOTS, SPEEDS
from pinfric.study.identify.normal import above_zero, moves, residuals

FloatArray = NDArray[np.float64]

#: Share of a standard deviation by which a link's parameter is changed to see what its load does.
_STEP = 0.1
#: Logs from which a spread between them can be told.
_FEWEST_LOGS = 2


@dataclass(frozen=True)
class Uncertainty:
    """What is uncertain about the coefficients.

    Attributes:
        place: (n,) of the coefficients above zero among (nj K,).
        covariance: (n, n) within and between logs.
        freedom: blocks less one, for Student's quantiles.
        spread: (nj,) standard deviation of a log's factor on the joint's friction; NaN with one
            log, which cannot tell.
    """

    place: NDArray[np.int64]
    covariance: FloatArray
    freedom: int
    spread: FloatArray

    def quantile(self, level: float = 0.95) -> float:
        """Return how many standard errors the interval reaches to either side."""
        from scipy.special import stdtrit

        return float(stdtrit(self.freedom, 0.5 + 0.5 * level))

    def draws(self, values: FloatArray, count: int, seed: int) -> FloatArray:
        """Return (count, nj K) draws around the coefficients, correlated, none below zero.

        Args:
            values: (nj, K) the coefficients.
            count: how many.
            seed: of the draws.
        """
        rng = np.random.default_rng(seed)
        size, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(size, 0.0))
        wide = np.sqrt(self.freedom / rng.chisquare(self.freedom, count))
        rows = np.tile(values.ravel(), (count, 1))
        rows[:, self.place] += wide[:, None] * (rng.normal(size=(count, size.size)) @ root.T)
        return np.maximum(rows, 0.0)


def uncertainty(found: Estimate) -> Uncertainty:
    """Return the coefficients' covariance, within logs, by the URDF's errors, and between logs.

        (H + F)^-1 (sum over blocks of s s^T + P S P) (H + F)^-T

    H is the matrix of the normal equations of inertial parameters and coefficients together, F what
    they change by because columns of loads follow from the estimate, s a block's part of the
    gradient, P the weight that draws links to the URDF, S the variance of that.

    Args:
        found: the estimate.
    """
    problem, fit = found.problem, found.fit
    place = above_zero(fit, problem.slots(found.choice.laws))
    moved, count = moves(problem.grams, problem.weights, problem.prior, fit, place,
                         _feedback(found, place))  # fmt: skip
    moved = moved[:, moved.shape[1] - place.size :]
    within = moved.T @ moved
    spread = between_logs(found)
    between = np.zeros_like(within)
    values = fit.slots.ravel()[place] * (place % len(SLOTS) != SLOT[INERTIA])
    for j, share in enumerate(np.nan_to_num(spread)):
        own = values * (place // len(SLOTS) == j)
        between += share**2 * np.outer(own, own)
    return Uncertainty(place, within + between, count - 1, spread)


def _feedback(found: Estimate, place: NDArray[np.int64]) -> FloatArray:
    """What loads' columns add to H, (p + n, p + n), since they follow from the estimate.

    F = A^T W x dA/d(theta, coefficients), x: what multiplies the column
    """
    p = found.fit.theta.size
    result = np.zeros((p + place.size, p + place.size))
    for whole in place.tolist():
        j, slot = divmod(whole, len(SLOTS))
        slopes = _load_slopes(found, j, SLOTS[slot])
        if slopes is None:
            continue
        own, rows = np.flatnonzero(place // len(SLOTS) == j), found.rows[j]
        to = np.concatenate((np.arange(p), p + own))
        columns = np.concatenate((np.arange(p), p + place[own] % len(SLOTS)))
        weight = found.problem.weights[j] * found.row_weights[j] * found.fit.slots[j, slot]
        every = np.hstack((rows.rigid, rows.slots))[:, columns] * weight[:, None]
        result[np.ix_(to, to)] += every.T @ slopes[:, columns]
    return result


def _load_slopes(found: Estimate, joint: int, name: str) -> FloatArray | None:
    """Derivatives (rows, p + K) of a load's column by theta and slots; None: it has no load."""
    rows = found.rows[joint]
    none = np.zeros_like(rows.slots)
    if name == BEARING:
        slopes = [_bearing_slopes(found, one, joint) for one in found.prepared]
        return np.hstack((np.concatenate(slopes), none))
    if not name.startswith("gear"):
        return None
    way = np.sign(rows.velocity * rows.load)
    way *= (way < 0.0) if "driven" in name else (way > 0.0) if "driving" in name else 1.0
    inner = [name.endswith("joint side") and (slot in (FORWARD, BACKWARD) or slot in SPEEDS)
             for slot in SLOTS]  # fmt: skip
    return np.hstack((rows.rigid, rows.slots * inner)) * way[:, None]


def _bearing_slopes(found: Estimate, one: Prepared, joint: int) -> FloatArray:
    """Derivatives (rows, p) of a bearing's column in one log by the links that it carries."""
    scene, motion = found.scene, one.recording.trajectory
    at = one.kept[one.slides[:, joint]]
    if not at.size:  # it stands still in this log
        return np.zeros((0, found.fit.theta.size))
    q, v, a = (np.ascontiguousarray(x[at]) for x in (motion.q, motion.v, motion.a))
    probe, theta = bearings_only(scene), found.fit.theta

    def load(theta: FloatArray) -> FloatArray:
        changed = probe.with_(model=with_parameters(scene.model, theta))
        result = inverse_dynamics(changed, q, v, a, attached=motion.attached[at])
        return result.normal_load[:, result.site_names.index(scene.joint_names[joint])]

    slopes, here = np.zeros((at.size, theta.size)), load(theta)
    carried = np.isin(np.arange(theta.size) // 10 + 1, scene.model.subtrees[joint + 1])
    for k in np.flatnonzero(carried & (found.problem.prior.deviation > 0.0)):
        step = _STEP * found.problem.prior.deviation[k]
        slopes[:, k] = (load(theta + step * (np.arange(theta.size) == k)) - here) / step
    return slopes * np.sign(v[:, [joint]])


def between_logs(found: Estimate) -> FloatArray:
    """Return (nj,) how much a joint's friction differs from log to log, as a standard deviation.

    Of each log's factor on the fitted friction, what blocks within a log scatter taken off.
    """
    logs = len(found.prepared)
    if logs < _FEWEST_LOGS:
        return np.full(len(found.rows), np.nan)
    result = []
    for j, rows in enumerate(found.rows):
        values = np.where(np.arange(len(SLOTS)) == SLOT[INERTIA], 0.0, found.fit.slots[j])
        friction, off = rows.slots @ values, residuals(rows, found.fit, j)
        factors, noise = [], []
        for log in range(logs):
            own = [_factor(friction[part], off[part]) for b in np.unique(rows.block)
                   if (part := (rows.block == b) & (rows.log == log)).any()]  # fmt: skip
            if len(own) > 1:
                factors.append(_factor(friction[rows.log == log], off[rows.log == log]))
                noise.append(np.var(own, ddof=1) / len(own))
        enough = len(factors) >= _FEWEST_LOGS
        variance = np.var(factors, ddof=1) - np.mean(noise) if enough else np.nan
        result.append(float(np.sqrt(max(variance, 0.0))) if enough else np.nan)
    return np.array(result)


def _factor(friction: FloatArray, off: FloatArray) -> float:
    size = float(friction @ friction)
    return 1.0 + float(friction @ off) / size if size > 0.0 else 1.0
