"""By how much logged efforts lag behind the motion, and how far that is known.

    y(t + d) = X(t) beta,    so  y(t + d0) = X beta - (d - d0) y'(t + d0)    near d0

The delay's change is one more coefficient beside the links' and friction's, with a standard error
from blocks as theirs. Each log has coefficients of its own: that it was warm shall not look like a
delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pinfric.study.identify.columns import Prepared, Rows, joint_rows
from pinfric.study.identify.normal import (
    Fit,
    Grams,
    Normal,
    Prior,
    Reduced,
    above_zero,
    moves,
    weighted,
)

FloatArray = NDArray[np.float64]

#: s: delays that can be, and their standard deviation before anything was logged.
_LEAST, _MOST, _USUAL = -0.02, 0.03, 0.02
#: s: with a larger standard error, a delay is not determined.
_VAGUE = 2.5e-3
_ROUNDS = 4


@dataclass(frozen=True)
class Delay:
    """By how much logged efforts lag, s.

    Attributes:
        value: taken for all logs; 0 where it is not determined.
        standard_error: of what the logs say together, their spread included.
        logs: (value, standard error) of each log alone.
    """

    value: float
    standard_error: float
    logs: tuple[tuple[float, float], ...]

    @property
    def determined(self) -> bool:
        """Whether the logs say it."""
        return self.standard_error < _VAGUE

    def __str__(self) -> str:
        text = f"{1e3 * self.value:.1f} ms (standard error {1e3 * self.standard_error:.1f})"
        return text if self.determined else "not determined, taken as 0"


def common_delay(logs: Sequence[tuple[float, float]]) -> Delay:
    """Return the mean of logs' delays weighted by their information.

    Args:
        logs: delay and standard error of each, s; the latter is infinite where nothing slides.
    """
    values, errors = np.array([log for log in logs if np.isfinite(log[1])]).T
    mean = float(np.average(values, weights=errors**-2))
    excess = float(np.sum(((values - mean) / errors) ** 2)) / max(len(values) - 1, 1)
    error = float(np.sqrt(max(excess, 1.0) / np.sum(errors**-2)))
    return Delay(mean if error < _VAGUE else 0.0, error, tuple(logs))


def log_delay(
    one: Prepared, slots: Sequence[Sequence[int]], prior: Prior, start: float
) -> tuple[float, float]:
    """Return by how much one log's efforts lag, and the standard error of that, s.

    A log in which nothing slides has no rows: its standard error is infinite.

    Args:
        one: the log's columns.
        slots: of each joint's law.
        prior: of the links' parameters.
        start: a delay nearby, s.
    """
    from scipy.special import stdtrit

    if not one.slides.any():
        return start, np.inf
    joints = range(len(slots))
    delay, error, slopes = start, _USUAL, [np.zeros(one.kept.size) for _ in joints]
    row_weights, weights = None, np.ones(len(slots))
    for _ in range(_ROUNDS):
        # what is known of delays counts as much as rows of unit variance that say it
        known = -delay, 1.0 / (_USUAL**2 * float(one.slides.sum())), _USUAL
        links = prior.center, prior.weight, prior.deviation
        now = Prior(*(np.append(own, last) for own, last in zip(links, known, strict=True)))
        rows = [_with_slope(joint_rows([one], j, delay), slopes[j][one.slides[:, j]])
                for j in joints]  # fmt: skip
        if row_weights is None:
            row_weights = tuple(np.ones(own.effort.size) for own in rows)
        blocks = 1 + max(int(own.block.max(initial=0)) for own in rows)
        grams = [Grams.of(own, w, blocks) for own, w in zip(rows, row_weights, strict=True)]
        normal = Normal.of(grams, np.ones(blocks, dtype=bool), weights)
        fit = Reduced(normal, now).fit(slots)
        place = above_zero(fit, slots)
        place = place[normal.slots.diagonal()[place] > 0.0]  # of joints that slide in this log
        moved, count = moves(grams, weights, now, fit, place)
        wider = float(stdtrit(max(count - 1, 1), 0.975)) / 1.96  # of few blocks: Student's
        error = wider * float(np.linalg.norm(moved[:, fit.theta.size - 1]))
        delay = float(np.clip(delay + fit.theta[-1], _LEAST, _MOST))
        row_weights, weights = weighted(rows, fit)
        slopes = [_slope(one, fit, j) for j in joints]
    return delay, error if _LEAST < delay < _MOST else _USUAL


def _with_slope(rows: Rows, slope: FloatArray) -> Rows:
    """Rows with -y' as the last column of the links' parameters."""
    return replace(rows, rigid=np.column_stack((rows.rigid, -slope)))


def _slope(one: Prepared, fit: Fit, joint: int) -> FloatArray:
    """Derivative by time of one joint's fitted effort: the logged one's would be that of noise."""
    from scipy.interpolate import CubicSpline

    fitted = one.rigid[:, joint] @ fit.theta[:-1] + one.slots[:, joint] @ fit.slots[joint]
    t = one.recording.trajectory.t[one.kept]
    return np.asarray(CubicSpline(t, fitted)(t, 1))
