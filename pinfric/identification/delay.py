"""Delay of the logged efforts behind the motion (`notebooks/theory/identification`, "The delay").

    y(t + d) = X(t) beta,    so  y(t + d0) = X beta - (d - d0) y'(t + d0)    near d0

Each joint's change of delay is one more coefficient. Each log has coefficients of its own, because
a warm robot must not look like a delay, and, where it shows presliding, columns of that.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pinfric.identification.columns import Prepared, Rows, joint_rows
from pinfric.identification.influence import influence
from pinfric.identification.normal import (
    BlockProducts,
    Fit,
    FrictionNormalEquations,
    Normal,
    Prior,
    above_zero,
    beside,
    orthonormal,
    residuals,
    weighted,
)
from pinfric.model.arrays import FloatArray

#: s: delays that can be, and their standard deviation before anything was logged.
_LEAST, _MOST, _USUAL = -0.03, 0.1, 0.02
#: A joint is named if its delay differs from the common one by more standard errors than this, and
#: by what would leave a delay undetermined.
_DIFFERS = 4.0
#: s: with a larger standard error, a delay is not determined.
_VAGUE = 2.5e-3
_ROUNDS = 4
#: Share of the residual's square from which a log shows presliding: 0.3 to 3 % without, 67 to 77 %
#: where it builds up over 5 mrad, 12 to 19 % with play or other laws. Share from which it is clear.
_SHOWS, _CLEAR = 0.1, 1.0 / 3.0
#: Huber's limit, in standard errors, and E[psi^2] of a normal variable with it; his steps.
_HUBER, _HUBER_SQUARE, _HUBER_ROUNDS = 1.345, 0.7102, 50


@dataclass(frozen=True)
class Delay:
    """Delay of the logged efforts, s.

    Attributes:
        value: taken for all logs; a guess, or 0, where it is not determined.
        standard_error: of all logs together, the spread of logs and joints included.
        logs: (value, standard error) of each log alone.
        joints: joint -> (value, standard error), of those that slide.
        builds_up: (logs,) whether each clearly shows presliding.
    """

    value: float
    standard_error: float
    logs: tuple[tuple[float, float], ...]
    joints: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    builds_up: tuple[bool, ...] = ()

    @property
    def determined(self) -> bool:
        """Whether the logs determine it."""
        return self.standard_error < _VAGUE

    @property
    def disputed(self) -> bool:
        """Whether it is not determined because well-known joints disagree."""
        known = sum(error**-2.0 for _, error in self.joints.values())
        return not self.determined and known > _VAGUE**-2.0

    def __str__(self) -> str:
        text = f"{1e3 * self.value:.1f} ms"
        if self.determined:
            return f"{text} (standard error {1e3 * self.standard_error:.1f})"
        return f"not determined, taken as {text}"


@dataclass(frozen=True)
class LogDelay:
    """Delay of one log's efforts, s.

    Attributes:
        value, standard_error: of the joints together, their spread included.
        joints: as in `Delay`. builds_up: whether it clearly shows presliding.
    """

    value: float
    standard_error: float
    joints: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    builds_up: bool = False


def common_delay(logs: Sequence[LogDelay]) -> Delay:
    """Return the delay of all logs, by `pooled`.

    Args:
        logs: a standard error is infinite where nothing slides, or where the search ended at a
            bound.
    """
    known = [(log.value, log.standard_error) for log in logs if np.isfinite(log.standard_error)]
    mean, error = pooled(known) if known else (0.0, np.inf)
    seen = sorted({j for log in logs for j in log.joints})
    joints = {j: pooled([log.joints[j] for log in logs if j in log.joints]) for j in seen}
    return Delay(
        mean,
        error,
        tuple((log.value, log.standard_error) for log in logs),
        joints,
        tuple(log.builds_up for log in logs),
    )


def pooled(estimates: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of values whose errors may be too small, and its standard error.

        r = (x - mean)/sqrt(e^2 + scatter^2),    sum of psi(r)/sqrt(e^2 + scatter^2) = 0
        scatter = the least with  sum of psi(r)^2 <= (n - 1) E[psi^2]
        error = 1/sqrt(sum of 1/(e^2 + scatter^2))

    psi(r) = r within 1.345, else 1.345 sign(r) (Huber, Robust statistics, 1981, ch. 6: proposal 2),
    so one value with a wrong error hardly biases the mean.

    Args:
        estimates: (value, standard error) of each.
    """
    values, errors = np.array(estimates).T

    def located(scatter: float) -> tuple[float, float]:
        size = np.hypot(errors, scatter)
        mean = float(np.average(values, weights=size**-2))
        for _ in range(_HUBER_ROUNDS):
            away = np.abs(values - mean) / size
            weights = np.minimum(1.0, _HUBER / np.maximum(away, _HUBER)) / size**2
            mean = float(np.average(values, weights=weights))
        clipped = np.minimum(np.abs(values - mean) / size, _HUBER)
        return mean, float(clipped @ clipped) - _HUBER_SQUARE * (len(values) - 1)

    mean, beyond = located(0.0)
    scatter = 0.0
    if beyond > 1e-9:
        tried = np.geomspace(1e-2 * errors.min(), 10.0 * np.ptp(values) + errors.max(), 100)
        at = bisect_left(tried, True, key=lambda s: located(float(s))[1] <= 0.0)
        scatter = float(tried[at])
        mean, _ = located(scatter)
    return mean, float(np.sum(np.hypot(errors, scatter) ** -2.0) ** -0.5)


def other_delays(delay: Delay) -> dict[int, tuple[float, float]]:
    """Return joint -> (value, standard error), s, where not the common delay."""
    if not delay.joints:
        return {}
    mean, _ = pooled(list(delay.joints.values()))
    return {
        j: (value, error)
        for j, (value, error) in delay.joints.items()
        if abs(value - mean) > max(_DIFFERS * error, _VAGUE)
    }


def log_delay(
    prepared: Prepared, slots: Sequence[Sequence[int]], prior: Prior, start: float
) -> LogDelay:
    """Return the delay of one log's efforts, near `start`, s; nothing slides: infinite error."""
    from scipy.special import stdtrit

    if not prepared.slides.any():
        return LogDelay(start, np.inf)
    none = [np.zeros((int(at.sum()), 0)) for at in prepared.slides.T]
    built_up = [orthonormal(prepared.presliding[at, j]) for j, at in enumerate(prepared.slides.T)]
    search, presliding = (_searched(prepared, slots, prior, start, own) for own in (none, built_up))
    shares = presliding.left / np.maximum(search.left, 1e-300)
    taken = 1.0 - float(np.average(shares, weights=prepared.slides.sum(axis=0)))
    bases, builds_up = none, taken > _CLEAR
    if taken > _SHOWS:
        search, bases = presliding, built_up
    delay, nj = search.delay, len(slots)
    if not _LEAST < delay < _MOST:
        return LogDelay(delay, np.inf, builds_up=builds_up)  # its search ended at a bound
    rows = _with_slopes(prepared, delay, search.slopes, bases, apart=True)
    known = _with_delays(prior, prepared, delay, nj)
    grams, normal = _normal(rows, search.row_weights, search.weights)
    fit = FrictionNormalEquations(normal, known).fit(slots)
    place = above_zero(fit, slots)
    place = place[normal.slots.diagonal()[place] > 0.0]  # of joints that slide in this log
    moved, samples = influence(grams, search.weights, known, fit, place)
    wider = float(stdtrit(max(samples - 1, 1), 0.975)) / 1.96  # of few blocks: Student's
    end = fit.theta.size
    errors = wider * np.linalg.norm(moved[:, end - nj : end], axis=0)
    values = delay + fit.theta[-nj:]
    joints = {j: (float(values[j]), float(errors[j])) for j in range(nj) if rows[j].effort.size}
    mean, error = pooled(list(joints.values()))
    if error >= _VAGUE:  # their scatter tells nothing of the delay: those that know it best may
        values, errors = np.array(list(joints.values())).T
        weights = errors**-2.0
        best = float(np.average(values, weights=weights))
        mean = best if weights.sum() > _VAGUE**-2.0 else 0.0
    return LogDelay(mean, error, joints, builds_up)


class _Search(NamedTuple):
    """A log's delay, s, slopes of its efforts (n,), weights, and squared residuals (nj,)."""

    delay: float
    slopes: list[FloatArray]
    row_weights: tuple[FloatArray, ...]
    weights: FloatArray
    left: FloatArray


def _searched(
    prepared: Prepared,
    slots: Sequence[Sequence[int]],
    prior: Prior,
    delay: float,
    bases: Sequence[FloatArray],
) -> _Search:
    """Find the delay from one nearby, by fits beside what `bases` span."""
    slopes = [np.zeros(prepared.kept.size) for _ in slots]
    row_weights: tuple[FloatArray, ...] = ()
    weights = squares = np.ones(len(slots))
    for _ in range(_ROUNDS):
        rows = _with_slopes(prepared, delay, slopes, bases, apart=False)
        row_weights = row_weights or tuple(np.ones(own.effort.size) for own in rows)
        normal = _normal(rows, row_weights, weights)[1]
        fit = FrictionNormalEquations(normal, _with_delays(prior, prepared, delay, 1)).fit(slots)
        delay = float(np.clip(delay + fit.theta[-1], _LEAST, _MOST))
        row_weights, weights = weighted(rows, fit)
        squares = np.array([np.sum(residuals(own, fit, j) ** 2) for j, own in enumerate(rows)])
        slopes = [_slope(prepared, fit, j, prior.center.size) for j in range(len(slots))]
    return _Search(delay, slopes, row_weights, weights, squares)


def _normal(
    rows: Sequence[Rows], row_weights: Sequence[FloatArray], weights: FloatArray
) -> tuple[list[BlockProducts], Normal]:
    blocks = 1 + max(int(own.block.max(initial=0)) for own in rows)
    grams = [BlockProducts.of(own, w, blocks) for own, w in zip(rows, row_weights, strict=True)]
    return grams, Normal.of(grams, np.ones(blocks, dtype=bool), weights)


def _with_delays(links: Prior, prepared: Prepared, delay: float, count: int) -> Prior:
    """The links' prior, followed by that of `count` changes of the delay."""
    # what is known of delays counts like rows of unit variance
    strength = 1.0 / (_USUAL**2 * float(prepared.slides.sum()))
    known = np.full(count, -delay), np.full(count, strength), np.full(count, _USUAL)
    own = links.center, links.weight, links.deviation
    return Prior(*(np.append(x, last) for x, last in zip(own, known, strict=True)))


def _with_slopes(
    prepared: Prepared,
    delay: float,
    slopes: Sequence[FloatArray],
    bases: Sequence[FloatArray],
    apart: bool,
) -> list[Rows]:
    """Each joint's rows with -y' behind the links' columns: one column, or one for each joint.

    What each joint's basis spans is taken out of them.
    """
    result = []
    for j, slope in enumerate(slopes):
        rows = joint_rows([prepared], j, delay)
        own = -slope[prepared.slides[:, j]][:, None]
        if apart:
            own = own * (np.arange(len(slopes)) == j)
        columns = beside(bases[j], np.column_stack((rows.rigid, own, rows.slots, rows.effort)))
        rigid, slots = np.split(columns[:, :-1], [rows.rigid.shape[1] + own.shape[1]], axis=1)
        result.append(replace(rows, rigid=rigid, slots=slots, effort=columns[:, -1]))
    return result


def _slope(prepared: Prepared, fit: Fit, joint: int, links: int) -> FloatArray:
    """Derivative by time of one joint's fitted effort; the logged one's would be noise."""
    links_rate = prepared.rigid_rates[:, joint] @ fit.theta[:links]
    return np.asarray(links_rate + prepared.slot_rates[:, joint] @ fit.slots[joint])
