"""When a logged joint stands still, found in noisy positions before any filter smears them.

In a hold, slopes over a window and trend and bend over the whole are noise, and it lasts several
windows. Noise hides where it ends, t0, so that comes from the motion: c (t - t0)^2 (acceleration
jumps) and c (t - t0)^3 (1 + b (t - t0)) (jerk jumps) are fitted to where the joint has left its
level. Joints that may have started at one instant get the one that fits all of them best.

Arguments: position (T, nj) rad or m at regular times; step, s; noise (nj,), standard deviations of
the positions, 0 for joints that are left as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse.result import runs
from pinfric.model.arrays import FloatArray

#: Standard deviations beyond which a slope, a trend or a bend is no longer noise.
_SIGNIFICANT = 5.0
#: s; samples of the window that slopes are taken over: as long, but neither few nor very many.
_WINDOW = 0.05
_FEWEST, _MOST = 12, 100
#: Windows that a hold lasts at least.
_SHORTEST = 2
#: The onset is fitted from the hold to where the joint is this many sigma away, but no farther than
#: this share of its travel: about there a planned motion stops speeding up.
_FAR, _FAR_SHARE = 300.0, 0.03
_LONGEST = 400
#: Sum of squares (in sigma^2) that one more coefficient, or one instant fewer, must be worth.
_WORTH = 9.0
#: Samples at the start of a recording through which a polynomial of this degree is laid, if it fits
#: to so many times the noise's square.
_START_SAMPLES, _START_DEGREE, _FITS = (200, 100, 50, 25), 5, 2.0
#: Standard errors of the first velocity and acceleration that tell rest, as parts of the largest.
_START_ERRORS = 0.02, 0.25
#: Samples within which the joints of an arm may start together.
_NEAR = 25.0


@dataclass(frozen=True)
class _Edge:
    """An end of a hold: the joint's way off its level, in sigma, over sample numbers.

    `direction` is 1 where a hold ends and -1 where it begins (time runs backward).
    """

    direction: int
    place: FloatArray
    away: FloatArray
    coarse: float

    def cost(self, onset: float) -> float:
        """Least sum of squares (sigma^2) of motions that start at a sample number."""
        x = np.maximum(self.direction * (self.place - onset), 0.0)
        x /= max(float(x.max()), 1.0)
        square, cube = x * x, x * x * x
        jump = _rest(self.away, np.column_stack((square, np.ones_like(x))))
        smooth = _rest(self.away, np.column_stack((cube, cube * x, np.ones_like(x))))
        return min(jump, smooth + _WORTH)

    def best(self, candidates: FloatArray) -> float:
        """The onset of least cost among candidates."""
        return float(candidates[int(np.argmin([self.cost(x) for x in candidates]))])

    def onset(self) -> float:
        """The onset of least cost, on ever finer grids."""
        low, high = float(self.place.min()), float(self.place.max())
        step = (high - low) / 40.0
        best = self.best(np.arange(low, high, step))
        while step > 0.02:
            best = self.best(best + step * np.linspace(-1.0, 1.0, 11))
            step /= 5.0
        return best


def _rest(y: FloatArray, basis: FloatArray) -> float:
    normal = basis.T @ basis
    normal.flat[:: len(normal) + 1] *= 1.0 + 1e-12
    coefficients = np.linalg.lstsq(normal, basis.T @ y, rcond=None)[0]
    residual = y - basis @ coefficients
    return float(residual @ residual)


def find_noisy_holds(
    position: FloatArray, step: float, noise: Sequence[float]
) -> list[list[tuple[int, int]]]:
    """Return for each joint the runs of samples in which it stands still, (first, last)."""
    count, joints = position.shape
    width = int(np.clip(round(_WINDOW / step), _FEWEST, _MOST))
    rough = [
        []
        if noise[j] == 0.0 or count < _SHORTEST * width
        else list(_levels(position[:, j], width, noise[j]))
        for j in range(joints)
    ]
    edges: dict[tuple[int, int, int], _Edge] = {}
    for j, levels in enumerate(rough):
        for i, (first, last) in enumerate(levels):
            if first > 0:
                edges[j, i, 0] = _edge(position[:, j], last, first, noise[j])
            if last < count - 1:
                edges[j, i, 1] = _edge(position[:, j], first, last, noise[j])
    onsets = _together(edges)
    holds: list[list[tuple[int, int]]] = []
    for j, levels in enumerate(rough):
        own: list[tuple[int, int]] = []
        for i, (first, last) in enumerate(levels):
            begin = int(np.ceil(onsets.get((j, i, 0), first)))
            end = int(np.floor(onsets.get((j, i, 1), last)))
            if end - begin >= width // 2 and (not own or begin > own[-1][1]):
                own.append((begin, end))
        holds.append(own)
    return holds


def with_resting_ends(
    position: FloatArray,
    step: float,
    noise: Sequence[float],
    holds: Sequence[Sequence[tuple[int, int]]],
) -> list[list[tuple[int, int]]]:
    """Return the holds of all joints, with the first and the last sample if the robot rests there.

    It rests if velocity and acceleration of a polynomial through the first samples are zero within
    three standard errors, and these are small beside the largest velocity and acceleration. Joints
    that move little do not count; all of an arm start together.
    """
    result, last = [list(own) for own in holds], len(position) - 1
    for end, at, positions in ((0, 0, position), (last, -1, position[::-1])):
        moving = [
            j
            for j, own in enumerate(result)
            if noise[j] > 0.0 and (not own or own[at][0 if at == 0 else 1] != end)
        ]
        rests = [_starts_at_rest(positions[:, j], step, noise[j]) for j in moving]
        if True in rests and False not in rests:
            for j in moving:
                result[j].insert(0 if at == 0 else len(result[j]), (end, end))
    return result


def _starts_at_rest(q: FloatArray, step: float, noise: float) -> bool | None:
    """Whether a joint starts at rest; None if its motion is too small."""
    for count in _START_SAMPLES:
        if 2 * count > q.size:
            continue
        x = np.arange(count) / (count - 1)
        powers = np.vander(x, _START_DEGREE + 1, increasing=True)
        fit, *_ = np.linalg.lstsq(powers, q[:count] - q[0], rcond=None)
        residual = q[:count] - q[0] - powers @ fit
        if float(residual @ residual) > _FITS * noise**2 * count:
            continue
        lag = (count - 1) * step
        spread = noise * np.sqrt(np.diag(np.linalg.inv(powers.T @ powers)))
        if abs(fit[1]) > 3.0 * spread[1] or abs(fit[2]) > 3.0 * spread[2]:
            return False
        apart = max(q.size // 8, 2)  # samples: over so many the largest rates are seen
        moves = q[apart:] - q[:-apart]
        bends = moves[apart:] - moves[:-apart]
        fastest = float(np.abs(moves).max()) / (apart * step)
        strongest = float(np.abs(bends).max()) / (apart * step) ** 2
        error_v, error_a = spread[1] / lag, 2.0 * spread[2] / lag**2
        small = error_v < _START_ERRORS[0] * fastest and error_a < _START_ERRORS[1] * strongest
        return True if small else None
    return False


def _levels(q: FloatArray, width: int, noise: float) -> Iterator[tuple[int, int]]:
    """Yield the runs on one level; a motion may start within their ends."""
    # Windows whose slope is noise
    place, margin = np.arange(width) - 0.5 * (width - 1), width // 2
    slope = np.convolve(q - q[0], place[::-1], mode="valid") / float(place @ place)
    flat = np.abs(slope) <= _SIGNIFICANT * noise / np.sqrt(float(place @ place))
    for first, final in runs(flat):
        if final - first < margin - 1:
            continue
        last = final + width - 1  # of samples
        inner = q[
            first + (margin if first else 0) : last + 1 - (margin if last < q.size - 1 else 0)
        ]
        if inner.size >= width and _is_level(inner, noise):
            yield first, last


def _is_level(q: FloatArray, noise: float) -> bool:
    """Whether trend and bend over the run are noise."""
    x = np.linspace(-1.0, 1.0, q.size)
    for shape in (x, 1.5 * x**2 - 0.5):  # Legendre: orthogonal, at most 1
        shape = shape - shape.mean()
        share = float(q @ shape) / float(shape @ shape)
        if abs(share) > max(_SIGNIFICANT / np.sqrt(float(shape @ shape)), 1.0) * noise:
            return False
    return True


def _edge(q: FloatArray, inside: int, border: int, noise: float) -> _Edge:
    """Return the samples about the border of a hold, as a fit needs them.

    Of a coarse encoder only the changes of its count, where the joint is half-way between two.
    """
    direction = 1 if border > inside else -1
    level = float(np.mean(q[min(inside, border) : max(inside, border) + 1]))
    ahead = q[border::direction][:_LONGEST]
    far = max(min(_FAR * noise, _FAR_SHARE * float(np.ptp(q))), 20.0 * noise)
    away = np.abs(ahead - level) > far
    reach = max(int(np.argmax(away)) if away.any() else ahead.size, 8)
    back = min(abs(border - inside), reach + 20)
    ends = sorted((border - direction * back, border + direction * reach))
    low, high = max(ends[0], 0), min(ends[1], q.size - 1)
    positions, place = q[low : high + 1], np.arange(low, high + 1, dtype=np.float64)
    changes = np.flatnonzero(np.diff(positions))
    if changes.size >= 6 and changes.size < 0.9 * (positions.size - 1):
        positions = 0.5 * (positions[changes] + positions[changes + 1])
        place = place[changes] + 0.5
        place, positions = np.append(place, border - direction * back), np.append(positions, level)
    return _Edge(direction, place, (positions - level) / noise, float(border))


def _together(edges: dict[tuple[int, int, int], _Edge]) -> dict[tuple[int, int, int], float]:
    """Return the onsets of all edges; one for those that one instant fits as well."""
    own = {key: edge.onset() for key, edge in edges.items()}
    onsets = dict(own)
    for direction in (1, -1):
        waiting = sorted(
            (key for key in edges if edges[key].direction == direction), key=own.__getitem__
        )
        while waiting:
            near = [key for key in waiting if own[key] - own[waiting[0]] <= _NEAR]
            waiting = [key for key in waiting if key not in near]
            costs = {key: edges[key].cost(own[key]) for key in near}
            candidates = np.arange(own[near[0]] - 0.5, own[near[-1]] + 0.6, 0.1)
            sums = [[edges[key].cost(x) - costs[key] for key in near] for x in candidates]
            best = int(np.argmin(np.sum(sums, axis=1)))
            if max(sums[best]) <= _WORTH:
                onsets.update(dict.fromkeys(near, float(candidates[best])))
    return onsets
