"""Ways over which friction builds up after reversals, found together with the efforts' delay.

    y(t + delay) = Y theta + J a + k v + c+ max(z, 0) + c- min(z, 0),    z = z(d) of each joint

Given d and the delay all is linear. A wrong d looks like a delay and the reverse, so both are
searched together; then Gauss-Newton in the delay and log d. Friction that falls from rest to
motion looks like a shorter way and a later effort, so what falls is fitted beside them where it
shows. Each way must earn its place against a fit without it *at that fit's own best delay*
(`notebooks/theory/identification`, "Ways").
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pinfric.identification.columns import Prepared, passed, shares, unresting
from pinfric.identification.laws import INERTIA, PLAIN
from pinfric.identification.normal import Prior, beside, orthonormal, products_by_block
from pinfric.model.arrays import BoolArray, FloatArray, IntArray

#: rad or m that are tried, 0 first; s of delays.
TRIED = np.concatenate([[0.0], np.geomspace(4e-5, 3e-2, 15)])
_DELAYS = np.arange(-4, 31, 2) * 1e-3
#: Blocks that are samples; rows of all logs.
BLOCKS, _MOST = 12, 4000
#: A way earns its place by more than so many standard errors, and more than this share of squares.
_CLEAR, _WORTH = 2.0, 0.02
#: Standard deviations of positions that a way must exceed; share of a joint's usual stroke.
_ABOVE_NOISE, _OF_STROKE = 3.0, 0.125
#: Fewest reversals of a joint from which a way is looked for.
FEWEST = 6
#: Relative change of d for its derivative; rounds of Gauss-Newton, and of that of a fit without one
#: way.
_CHANGE, _ROUNDS, _RIVALS = 1.05, 6, 4
#: rad/s or m/s at which 1/e is left of what falls from rest to motion, as tried beside ways.
_FALLS = (0.03, 0.1)
#: Standard deviation of log d that the shape of the build-up leaves.
_OF_SHAPE = 0.08
#: s: standard deviation of the delay that a gradual shape leaves: of eight truths after Dahl it was
#: found 1.0 to 3.8 ms early. With one stop it is right to 0.5 ms.
_DELAY_OF_SHAPE = 2e-3


@dataclass(frozen=True)
class Way:
    """The way over which one joint's friction builds up.

    Attributes:
        value: d, rad or m. error: standard error of log d, by blocks and what its shape leaves.
        gradual: whether over three stops, else one.
        gain: share of the held-out square that it takes off.
    """

    value: float
    error: float
    gradual: bool
    gain: float


#: Joint, way -> why it cannot be told, or "".
Refusal = Callable[[int, float], str]


class Build(NamedTuple):
    """What was found: each joint's way, the delay (s) with its standard error, refused joints."""

    ways: tuple[Way | None, ...]
    delay: float
    error: float
    refused: dict[int, str]


def change_by_way(prepared: Sequence[Prepared], joint: int, way: Way) -> FloatArray:
    """Return (n, 2) by what a joint's columns c+, c- change with one standard error of log d."""
    parts = []
    for log in prepared:
        longer, own = (
            shares(log.recording, joint, d, way.gradual)
            for d in (way.value * np.exp(way.error), way.value)
        )
        ends = [cut(longer, 0.0) - cut(own, 0.0) for cut in (np.maximum, np.minimum)]
        columns = passed(np.column_stack(ends), log.recording.step)
        parts.append(columns[log.kept[log.slides[:, joint]]])
    return np.concatenate(parts)


def with_ways(prepared: Prepared, ways: Sequence[Way | None]) -> Prepared:
    """Return a log whose dry friction builds up, with the rows beside reversals of these joints."""
    share, slides = prepared.share.copy(), prepared.slides.copy()
    moves = unresting(prepared.recording)[prepared.kept]
    for j, way in enumerate(ways):
        if way is not None:
            share[:, j] = shares(prepared.recording, j, way.value, way.gradual)
            slides[:, j] = moves[:, j]
    return replace(prepared, share=share, slides=slides, turns=np.zeros_like(slides))


def reversals(prepared: Prepared, joint: int) -> FloatArray:
    """Return the strokes of a joint (rad or m) between its reversals in a log."""
    v, q = prepared.recording.velocity[:, joint], prepared.recording.position
    moves = np.flatnonzero(np.abs(v) > prepared.recording.slowest[joint])
    turned = moves[1:][np.diff(np.sign(v[moves])) != 0.0]
    return np.abs(np.diff(q[turned, joint]))


@dataclass
class _Logs:
    """Rows of all joints in all logs: what a fit of ways needs.

    Attributes:
        logs: prepared. prior: of the links. weights: (nj,) 1/standard deviation of the residual.
        falls: joint -> speed over which its friction falls (rad/s or m/s), where it does.
        bases: (n, m) of each joint, orthonormal: what is taken out of its columns and effort.
    """

    logs: Sequence[Prepared]
    prior: Prior
    gradual: bool
    weights: FloatArray = field(init=False)
    rows: list[list[IntArray]] = field(init=False)
    block: list[IntArray] = field(init=False)
    known: dict[tuple[int, tuple[float, ...]], FloatArray] = field(default_factory=dict)
    falls: dict[int, float] = field(default_factory=dict)
    bases: list[FloatArray | None] = field(init=False)

    def __post_init__(self) -> None:
        nj = self.logs[0].slots.shape[1]
        total = sum(log.kept.size for log in self.logs)
        stride = max(1, total // _MOST)
        self.weights, self.rows = np.ones(nj), [[] for _ in range(nj)]
        self.bases = [None] * nj
        moves = [unresting(log.recording)[log.kept] for log in self.logs]
        place, first = [], 0
        for log in self.logs:
            place.append(np.arange(first, first + log.kept.size) * BLOCKS // total)
            first += log.kept.size
        for j in range(nj):
            for own in moves:
                use = np.flatnonzero(own[:, j])
                self.rows[j].append(use[use % stride == 0])
        self.block = [
            np.concatenate([at[use] for at, use in zip(place, self.rows[j], strict=True)])
            for j in range(nj)
        ]

    @property
    def joints(self) -> int:
        return len(self.rows)

    def take_out(self, ways: FloatArray) -> None:
        """Take what falls from rest to motion, over ways (nj,), out of all that follows."""
        self.bases = [
            self._falling(j, float(ways[j])) if j in self.falls else None
            for j in range(self.joints)
        ]

    def _falling(self, j: int, way: float) -> FloatArray:
        """(n, m) base of c+ max(z, 0) exp(-|v|/speed), c- min(z, 0) exp(-|v|/speed)."""
        parts = []
        for log, use in zip(self.logs, self.rows[j], strict=True):
            z = shares(log.recording, j, way, self.gradual)
            left = np.exp(-np.abs(log.recording.velocity[:, j]) / self.falls[j])
            both = np.column_stack((np.maximum(z, 0.0) * left, np.minimum(z, 0.0) * left))
            parts.append(passed(both, log.recording.step)[log.kept[use]])
        return orthonormal(np.concatenate(parts))

    def _beside(self, j: int, columns: FloatArray) -> FloatArray:
        basis = self.bases[j]
        return columns if basis is None else beside(basis, columns)

    def fixed(self, j: int) -> FloatArray:
        """(n, p + 2) columns of a joint that do not depend on ways."""
        parts = [
            np.hstack((log.rigid[use, j], log.slots[use, j][:, [INERTIA, PLAIN.slots[2]]]))
            for log, use in zip(self.logs, self.rows[j], strict=True)
        ]
        return self._beside(j, np.concatenate(parts))

    def dry(self, j: int, ways: Sequence[float]) -> FloatArray:
        """(n, 2 len(ways)) columns c+, c- of each way."""
        if (j, tuple(ways)) in self.known:
            return self._beside(j, self.known[j, tuple(ways)])
        parts = []
        for log, use in zip(self.logs, self.rows[j], strict=True):
            z = [shares(log.recording, j, way, self.gradual) for way in ways]
            both = np.column_stack([np.maximum(x, 0.0) if s else np.minimum(x, 0.0)
                                    for x in z for s in (True, False)])  # fmt: skip
            parts.append(passed(both, log.recording.step)[log.kept[use]])
        self.known[j, tuple(ways)] = np.concatenate(parts)
        return self._beside(j, self.known[j, tuple(ways)])

    def effort(self, j: int, delay: float, slope: bool = False) -> FloatArray:
        """(n,) of a joint at a delay (s), or its derivative by the delay."""
        parts = []
        for log, use in zip(self.logs, self.rows[j], strict=True):
            times = log.recording.trajectory.t[log.kept[use]] + delay
            parts.append((log.effort.derivative() if slope else log.effort)(times)[:, [j]])
        return self._beside(j, np.concatenate(parts))[:, 0]

    def free(self, left: FloatArray) -> BoolArray:
        """(m,) which unknowns a fit has: the links', whatever the rows say, and those with rows."""
        return (np.diag(left) > 0.0) | (np.arange(len(left)) < self.prior.center.size)

    def solved(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Solve normal equations (..., m, m) whose first unknowns are the links'."""
        p, count = self.prior.center.size, sum(block.size for block in self.block)
        strength = count * self.prior.weight
        left, right = left.copy(), right.copy()
        left[..., range(p), range(p)] += strength
        right[..., :p] += strength * self.prior.center
        diagonal = np.diagonal(left, axis1=-2, axis2=-1)
        size = np.sqrt(np.maximum(diagonal, 1e-12))
        scaled = left / (size[..., :, None] * size[..., None, :]) + 1e-9 * np.eye(size.shape[-1])
        return np.asarray(np.linalg.solve(scaled, (right / size)[..., None])[..., 0] / size)


class _Fit(NamedTuple):
    """A fit at a delay and ways (nj,): squares (blocks, nj), and held out; errors of log d."""

    delay: float
    ways: FloatArray
    square: float
    products: list[FloatArray]
    theta: FloatArray


def _search(logs: _Logs) -> tuple[float, float, FloatArray]:
    """Return the delay without ways, and delay and ways that fit best among those tried."""
    nj, p, nh = logs.joints, logs.prior.center.size, len(TRIED)
    grams = []
    for j in range(nj):
        efforts = np.column_stack([logs.effort(j, delay) for delay in _DELAYS])
        columns = np.hstack((logs.fixed(j), logs.dry(j, TRIED.tolist()), efforts))
        columns *= logs.weights[j]
        grams.append(columns.T @ columns)
    size, first = p + 4 * nj, p + 2 + 2 * nh
    places = [np.array([*range(p), *range(p + 4 * j, p + 4 * j + 4)]) for j in range(nj)]
    columns_of = [np.array([*range(p + 2), p + 2 + 2 * k, p + 3 + 2 * k]) for k in range(nh)]

    def squares(chosen: Sequence[int], i: int, joint: int) -> FloatArray:
        """(nh,) squares at a delay with each way of one joint, those of the others chosen."""
        left, right, whole = np.zeros((nh, size, size)), np.zeros((nh, size)), 0.0
        for j, own in enumerate(chosen):
            to = places[j]
            for k in range(nh) if j == joint else [own]:
                here, which = columns_of[k], k if j == joint else slice(None)
                left[which, to[:, None], to] += grams[j][np.ix_(here, here)]
                right[which, to] += grams[j][here, first + i]
            whole += grams[j][first + i, first + i]
        x = logs.solved(left, right)
        fitted = np.einsum("ki,kij,kj->k", x, left, x)
        return np.asarray(whole - 2.0 * np.sum(x * right, axis=1) + fitted)

    none = [0] * nj
    without = [float(squares(none, i, 0)[0]) for i in range(len(_DELAYS))]
    plain = int(np.argmin(without))
    best, at, kept = without[plain], plain, none
    for i in range(len(_DELAYS)):
        chosen, rounds = list(kept), 2 if kept == none else 1
        for _ in range(rounds):
            for j in range(nj):
                tried = squares(chosen, i, j)
                chosen[j] = int(np.argmin(tried))
        if (own := float(tried.min())) < best:
            best, at, kept = own, i, list(chosen)
    return float(_DELAYS[plain]), float(_DELAYS[at]), TRIED[kept]


def _polished(
    logs: _Logs, delay: float, ways: FloatArray, rounds: int = _ROUNDS
) -> tuple[_Fit, FloatArray, FloatArray]:
    """Gauss-Newton in the delay and log d; return the best fit, its residuals' scores, its matrix.

    The scores are (blocks, m) gradients of each block, the matrix (m, m) of the normal equations,
    of theta, the delay, and J, k, c+, c-, log d of each joint.
    """
    nj, p = logs.joints, logs.prior.center.size
    logs.take_out(ways)
    ways, best = ways.copy(), None
    m = p + 1 + 5 * nj
    fixed = [logs.fixed(j) for j in range(nj)]
    for _ in range(rounds):
        parts, products, theta_left, theta_right = [], [], np.zeros((m, m)), np.zeros(m)
        for j in range(nj):
            near = (1.0, _CHANGE, 1.0 / _CHANGE) if ways[j] > 0.0 else (1.0,)
            dry = logs.dry(j, [float(ways[j]) * x for x in near])
            y = logs.effort(j, delay)
            linear = np.hstack((fixed[j], dry[:, :2], y[:, None])) * logs.weights[j]
            products.append(products_by_block(linear, np.ones(len(y)), logs.block[j], BLOCKS))
            to = [*range(p), *range(p + 1 + 5 * j, p + 5 + 5 * j)]
            whole = products[-1].sum(axis=0)
            theta_left[np.ix_(to, to)] += whole[:-1, :-1]
            theta_right[to] += whole[:-1, -1]
            parts.append((dry, y, to))
        free = logs.free(theta_left)
        x = np.zeros(m)
        x[free] = logs.solved(theta_left[np.ix_(free, free)], theta_right[free])
        square = 0.0
        for j, own in enumerate(products):
            z = np.append(-x[parts[j][2]], 1.0)
            square += float(z @ own.sum(axis=0) @ z)
        if best is None or square < best.square:
            best = _Fit(delay, ways.copy(), square, products, x)
        left, right = np.zeros((m, m)), np.zeros(m)
        scores, wide = np.zeros((BLOCKS, m)), []
        for j, (dry, y, to) in enumerate(parts):
            columns = [fixed[j], dry[:, :2], -logs.effort(j, delay, slope=True)[:, None]]
            here = [*to, p]
            if ways[j] > 0.0:
                slope = (dry[:, 2:4] - dry[:, 4:6]) / (2.0 * np.log(_CHANGE))
                columns.append((slope @ x[p + 3 + 5 * j : p + 5 + 5 * j])[:, None])
                here.append(p + 5 + 5 * j)
            own = np.hstack(columns) * logs.weights[j]
            left[np.ix_(here, here)] += own.T @ own
            right[here] += own.T @ (y * logs.weights[j])
            wide.append((own, y * logs.weights[j], here))
        free = logs.free(left)
        step = np.zeros(m)
        step[free] = logs.solved(left[np.ix_(free, free)], right[free])
        for j, (own, y, here) in enumerate(wide):
            off = (y - own @ step[here])[:, None] * own
            sums = np.zeros((BLOCKS, len(here)))
            np.add.at(sums, logs.block[j], off)
            scores[:, here] += sums
        logs_of_ways = step[p + 5 + 5 * np.arange(nj)]
        delay += float(np.clip(step[p], -4e-3, 4e-3))
        ways = np.where(ways > 0.0, ways * np.exp(np.clip(logs_of_ways, -0.4, 0.4)), 0.0)
        ways = np.where(ways > 0.0, np.clip(ways, 5e-6, 0.2), 0.0)
        if abs(step[p]) < 2e-5 and np.abs(logs_of_ways).max(initial=0.0) < 3e-3:
            break
    assert best is not None
    return best, scores, left


def _held_out(logs: _Logs, fit: _Fit, joint: int | None = None) -> FloatArray:
    """(blocks,) squared errors on held-out blocks, of a joint or of all; delay and ways stay."""
    nj, p = logs.joints, logs.prior.center.size
    size, errors = p + 4 * nj, np.zeros(BLOCKS)
    places = [[*range(p), *range(p + 4 * j, p + 4 * j + 4)] for j in range(nj)]
    left, right = np.zeros((BLOCKS, size, size)), np.zeros((BLOCKS, size))
    for own, to in zip(fit.products, places, strict=True):
        left[:, np.array(to)[:, None], to] += own[:, :-1, :-1]
        right[:, to] += own[:, :-1, -1]
    for b in range(BLOCKS):
        others_left, others_right = left.sum(axis=0) - left[b], right.sum(axis=0) - right[b]
        free = logs.free(others_left)
        x = np.zeros(size)
        x[free] = logs.solved(others_left[np.ix_(free, free)], others_right[free])
        for j in range(nj) if joint is None else [joint]:
            z = np.append(-x[places[j]], 1.0)
            errors[b] += z @ fit.products[j][b] @ z
    return errors


def _with_falling(logs: _Logs, fit: _Fit) -> _Fit:
    """Return the fit beside what falls from rest to motion, at the joints where it shows."""
    for j in range(logs.joints):
        kept, tried = logs.falls, []
        for speed in _FALLS:
            logs.falls = kept | {j: speed}
            tried.append((_polished(logs, fit.delay, fit.ways, _RIVALS)[0], logs.falls))
        own, logs.falls = min(tried, key=lambda one: one[0].square)
        gain, of_joint = _held_out(logs, fit) - _held_out(logs, own), _held_out(logs, fit, j)
        if gain.sum() > max(_CLEAR * _error(gain), _WORTH * float(of_joint.sum())):
            fit = own
        else:
            logs.falls = kept
    return fit


def _error(of_blocks: FloatArray) -> float:
    """Standard error of a sum over blocks."""
    return float(of_blocks.std(ddof=1) * np.sqrt(BLOCKS))


def _admitted(
    logs: _Logs, fit: _Fit, plain: float, refusal: Refusal, refused: dict[int, str]
) -> _Fit:
    """Return the fit without the ways that cannot be told, which are noted in `refused`."""
    while bad := {
        j: why for j in np.flatnonzero(fit.ways).tolist() if (why := refusal(j, float(fit.ways[j])))
    }:
        # a way too small for the grid is none: friction that jumps has such
        refused |= {j: why for j, why in bad.items() if fit.ways[j] >= TRIED[1]}
        ways = fit.ways.copy()
        ways[list(bad)] = 0.0
        fits = [_polished(logs, delay, ways)[0] for delay in (fit.delay, plain)]
        fit = min(fits, key=lambda one: one.square)
    return fit


def _earned(
    logs: _Logs, start: _Fit, plain: float, refusal: Refusal, refused: dict[int, str]
) -> tuple[_Fit, FloatArray]:
    """Return the fit with those ways that earn their place, and what each gains (nj,).

    Args:
        start: with all ways. plain: delay of the fit without any, s.
        refusal: why a joint's way cannot be told, or nothing. refused: where that is noted.
    """
    best = _admitted(logs, start, plain, refusal, refused)
    gains = np.zeros(best.ways.size)
    for j in np.argsort(best.ways):
        if best.ways[j] == 0.0:
            continue
        without = best.ways.copy()
        without[j] = 0.0
        rivals = [_polished(logs, delay, without, _RIVALS)[0] for delay in (best.delay, plain)]
        rival = min(rivals, key=lambda fit: fit.square)
        own, other = _held_out(logs, best, j), _held_out(logs, rival, j)
        gain = other - own
        share = float(gain.sum() / other.sum())
        error = _error(gain) / float(other.sum())
        gains[j] = share
        if not (share > _CLEAR * error and share > _WORTH):
            best = _admitted(logs, rival, plain, refusal, refused)
    return best, gains


def find_ways(prepared: Sequence[Prepared], prior: Prior, offered: BoolArray) -> Build | None:
    """Return the ways of the joints `offered` (nj,) that earn their place; None: of no joint."""
    found: list[tuple[_Logs, _Fit, FloatArray, FloatArray]] = []
    refused: dict[int, str] = {}
    strokes = [np.concatenate([reversals(log, j) for log in prepared]) for j in range(offered.size)]
    noise = np.max([log.recording.position_noise for log in prepared], axis=0)

    def refusal(joint: int, way: float) -> str:
        return _refusal(way, noise[joint], strokes[joint])

    for gradual in (False, True):
        logs = _Logs(prepared, prior, gradual)
        nj = logs.joints
        if found:
            logs.weights = found[0][0].weights
        else:
            plain = _polished(logs, 0.0, np.zeros(nj), 4)[0]
        for _ in range(1 if found else 2):
            if not found:
                logs.weights = _weights(logs, plain)
            without, start, ways = _search(logs)
            ways = np.where(offered, ways, 0.0)
            plain = _polished(logs, start, ways)[0]
        plain = _with_falling(logs, plain) if plain.ways.any() else plain
        best, gains = _earned(logs, plain, without, refusal, refused)
        found.append((logs, best, gains, _held_out(logs, best)))
        if not best.ways.any() and not gradual:
            return Build((None,) * nj, 0.0, np.inf, refused) if refused else None
    logs, best, gains, errors = found[0]
    if len(found) > 1 and found[1][1].ways.any():
        better = errors - found[1][3]
        if better.sum() > _error(better):
            logs, best, gains, errors = found[1]
    refused = {j: why for j, why in refused.items() if best.ways[j] == 0.0}
    fit, scores, left = _polished(logs, best.delay, best.ways)
    deviation = _deviations(logs, scores, left)
    p = prior.center.size
    result = tuple(
        Way(
            float(fit.ways[j]),
            float(np.hypot(deviation[p + 5 + 5 * j], _OF_SHAPE)),
            logs.gradual,
            float(gains[j]),
        )
        if fit.ways[j] > 0.0
        else None
        for j in range(logs.joints)
    )
    error = float(np.hypot(deviation[p], _DELAY_OF_SHAPE * logs.gradual))
    return Build(result, fit.delay, error, refused)


def _weights(logs: _Logs, fit: _Fit) -> FloatArray:
    """(nj,) 1/standard deviation of each joint's residual."""
    p, result = logs.prior.center.size, logs.weights.copy()
    for j, own in enumerate(fit.products):
        z = np.append(-fit.theta[[*range(p), *range(p + 1 + 5 * j, p + 5 + 5 * j)]], 1.0)
        mean = float(z @ own.sum(axis=0) @ z) / max(logs.block[j].size, 1)
        result[j] = logs.weights[j] / np.sqrt(mean) if mean > 0.0 else 0.0
    return result


def _refusal(way: float, noise: float, strokes: FloatArray) -> str:
    """Why a way cannot be told, or nothing."""
    if way < _ABOVE_NOISE * noise:
        return f"{way:.2g} is below three times the noise of its positions, {noise:.2g}"
    if way < TRIED[1]:
        return f"{way:.2g} is below {TRIED[1]:.2g}, which no log tells from a delay"
    if way > 0.95 * TRIED[-1]:
        return f"{way:.2g} or more: that is no yielding of contacts and gears"
    if strokes.size and way > _OF_STROKE * float(np.median(strokes)):
        usual = 0.5 * float(np.median(strokes))
        return f"{way:.2g} is more than a quarter of the amplitude of its motion, {usual:.2g}"
    return ""


def _deviations(logs: _Logs, scores: FloatArray, left: FloatArray) -> FloatArray:
    """(m,) standard errors by the blocks' sandwich."""
    p, count = logs.prior.center.size, sum(block.size for block in logs.block)
    left = left.copy()
    left[:p, :p] += np.diag(count * logs.prior.weight)
    free = np.diag(left) > 0.0
    size = np.sqrt(np.diag(left)[free])
    inverse = np.linalg.inv(
        left[np.ix_(free, free)] / np.outer(size, size) + 1e-9 * np.eye(size.size)
    )
    moved = (scores[:, free] / size) @ inverse / size
    result = np.zeros(left.shape[0])
    result[free] = np.sqrt((moved**2).sum(axis=0) * BLOCKS / (BLOCKS - 1))
    return result
