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

from pinfric.study.identify.estimate import Estimate
from pinfric.study.identify.laws import INERTIA, SLOT, SLOTS
from pinfric.study.identify.normal import moves, places, residuals

FloatArray = NDArray[np.float64]

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

        H^-1 (sum over blocks of s s^T + P S P) H^-1

    H is the matrix of the normal equations of inertial parameters and coefficients together, s a
    block's part of the gradient, P the weight that draws links to the URDF, S the variance of that.

    Args:
        found: the estimate.
    """
    problem, fit = found.problem, found.fit
    place = places(problem.slots(found.choice.laws))
    place = place[fit.slots.ravel()[place] > 0.0]
    moved, count = moves(problem.grams, problem.weights, problem.prior, fit, place)
    moved = moved[:, moved.shape[1] - place.size :]
    within = moved.T @ moved
    spread = between_logs(found)
    between = np.zeros_like(within)
    values = fit.slots.ravel()[place] * (place % len(SLOTS) != SLOT[INERTIA])
    for j, share in enumerate(np.nan_to_num(spread)):
        own = values * (place // len(SLOTS) == j)
        between += share**2 * np.outer(own, own)
    return Uncertainty(place, within + between, count - 1, spread)


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
