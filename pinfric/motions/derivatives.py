"""Velocities and accelerations from sampled positions, with holds that stay exactly still.

A filter or spline over the whole motion disturbs holds. So these are found first, and only the
pieces between them are fitted. Arguments: t (T,) increasing, s; position (T,) of one joint, rad or
m; holds as `find_holds` returns them; resolution, the last digit printed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pinfric.dynamics.inverse.result import runs
from pinfric.model.arrays import FloatArray

#: Two equal samples also occur symmetrically about a turning point; three do not.
MIN_HOLD_SAMPLES = 3
#: Just outside a hold, within half its length, a joint has left it by more than this many
#: last digits. At constant velocity it is 1.5, about a turning point 4, where a motion passes
#: through v = a = 0 at most 8: what looks still there is only the rounding of the file.
HOLD_DEPARTURE = 10.0
_DEGREE = 5
#: Gains of the quintic spline's first and second derivative for white noise, times step and step
#: squared: the 2-norms of the cardinal spline's derivatives.
SPLINE_GAINS = 1.38, 4.8
#: Samples of a spline that are computed with at a time, and how many more on both sides: the
#: influence of a sample falls to 0.43 with each further one.
_PART, _BESIDE = 2**16, 200


def find_holds(position: ArrayLike, resolution: float = 0.0) -> list[tuple[int, int]]:
    """Return the runs of samples in which one joint stands still, as (first, last) inclusive.

    At least `MIN_HOLD_SAMPLES` positions agree, and the joint leaves them quickly at both ends
    (`HOLD_DEPARTURE`) unless the data end there. Positions agree within rounding in float64, or the
    last digit, but at most 1e-6 of the joint's travel: a coarse file must not turn motion into
    holds.
    """
    q = np.asarray(position, dtype=np.float64)
    travel = float(np.ptp(q))
    tolerance = max(
        8.0 * np.finfo(np.float64).eps * float(np.abs(q).max()), min(resolution, 1.0e-6 * travel)
    )
    # A file of short numbers (0, 0.5, 1) looks coarse without being so: trust 3 % of the travel.
    departure = HOLD_DEPARTURE * max(tolerance, min(resolution, 3.0e-2 * travel))
    holds = []
    for first, final in runs(np.abs(np.diff(q)) <= tolerance):
        last = final + 1  # of samples; runs are of the steps between them
        while first < last:
            end = _end_of_band(q, first, last, tolerance)
            if end - first + 1 >= MIN_HOLD_SAMPLES:
                level = 0.5 * (q[first : end + 1].min() + q[first : end + 1].max())
                half = (end - first) // 2
                sides = q[max(first - half, 0) : first], q[end + 1 : end + 1 + half]
                if all(x.size == 0 or np.abs(x - level).max() > departure for x in sides):
                    holds.append((first, end))
            first = end + 1
    return holds


def _end_of_band(q: FloatArray, first: int, last: int, tolerance: float) -> int:
    """Return the last sample up to which q[first:] stays in one band."""
    size = 64
    while True:
        window = q[first : min(first + size, last + 1)]
        spread = np.maximum.accumulate(window) - np.minimum.accumulate(window)
        within = int(np.searchsorted(spread, tolerance, side="right"))
        if within < window.size or first + size > last:
            return first + within - 1
        size *= 4


def position_derivatives(
    t: ArrayLike, position: ArrayLike, holds: Sequence[tuple[int, int]]
) -> tuple[FloatArray, FloatArray]:
    """Return velocity and acceleration of one joint from its positions.

    Each piece between two holds gets one quintic interpolating spline over t, with v = a = 0 where
    it meets a hold and not-a-knot ends elsewhere; in holds, ends included, v = a = 0 exactly.
    Errors fall with h^5 (v) and h^4 (a). Fewer than six conditions make one polynomial of the
    degree they allow (two free samples: a straight line).
    """
    times, q = np.asarray(t, dtype=np.float64), np.asarray(position, dtype=np.float64)
    v, a = np.zeros_like(q), np.zeros_like(q)
    for piece, left, right in _moving_pieces(q.size, holds):
        v[piece], a[piece] = _derivatives(times[piece], q[piece], 2 * left, 2 * right, (1, 2))
    for first, last in holds:
        v[first : last + 1] = a[first : last + 1] = 0.0
    return v, a


def velocity_derivative(
    t: ArrayLike, velocity: ArrayLike, holds: Sequence[tuple[int, int]]
) -> FloatArray:
    """Return one joint's acceleration from its velocities, by the same splines."""
    times, v = np.asarray(t, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
    a = np.zeros_like(v)
    for piece, left, right in _moving_pieces(v.size, holds):
        (a[piece],) = _derivatives(times[piece], v[piece], int(left), int(right), (1,))
    for first, last in holds:
        a[first : last + 1] = 0.0
    return a


def _moving_pieces(
    count: int, holds: Sequence[tuple[int, int]]
) -> Iterator[tuple[slice, bool, bool]]:
    """Yield the samples between holds, ends included, and which ends touch a hold."""
    start, left = 0, False
    for first, last in holds:
        if first > start:
            yield slice(start, first + 1), left, True
        start, left = last, True
    if start < count - 1:
        yield slice(start, count), left, False


def _derivatives(
    t: FloatArray, y: FloatArray, left: int, right: int, orders: Sequence[int]
) -> list[FloatArray]:
    """Return derivatives of the spline through (t, y), as `_interpolate` makes it.

    Long ones in parts, with samples beside that no longer matter to them: the equations of a whole
    log take 16 numbers a sample.
    """
    derivatives = [np.empty_like(y) for _ in orders]
    for first in range(0, y.size, _PART):
        last = min(first + _PART, y.size)
        before, after = max(first - _BESIDE, 0), min(last + _BESIDE, y.size)
        near, own = slice(before, after), slice(first, last)
        spline = _interpolate(
            t[near], y[near], left if before == 0 else 0, right if after == y.size else 0
        )
        for column, order in zip(derivatives, orders, strict=True):
            column[own] = spline(t[own], order)
    return derivatives


def _interpolate(t: FloatArray, y: FloatArray, left: int, right: int) -> Any:
    """Return the spline through (t, y) with `left` and `right` leading derivatives 0 at its ends.

    A clamped end adds its conditions; a free end drops up to (degree - 1)/2 interior knots
    (not-a-knot), so that knots = conditions + degree + 1.
    """
    from scipy.interpolate import make_interp_spline

    conditions = t.size + left + right
    degree = min(_DEGREE, conditions - 1)
    interior = t[1:-1]
    if degree < _DEGREE:
        interior = interior[:0]
    else:
        drop_left, drop_right = 2 - left, 2 - right
        interior = interior[drop_left : interior.size - drop_right]
    knots = np.concatenate((np.repeat(t[0], degree + 1), interior, np.repeat(t[-1], degree + 1)))
    clamps = tuple(
        [(order, 0.0) for order in range(1, number + 1)] or None for number in (left, right)
    )
    return make_interp_spline(t, y, k=degree, t=knots, bc_type=clamps)
