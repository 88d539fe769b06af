"""Samples of a logged effort that were not measured: zeros of lost messages, and spikes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pinfric.dynamics.inverse.result import runs
from pinfric.model.brief import counted
from pinfric.motions.log.frame import BAD_SHARE, FEWEST

FloatArray = NDArray[np.float64]

#: Rows that a lost message or a spike lasts at most: longer ones may be the effort itself.
_LONGEST = 5
#: Typical changes from row to row within which an effort may pass through zero.
_NEAR_ZERO = 5.0
#: Spreads (of nine tenths of the rows) beyond these rows at which no effort is.
_BEYOND = 3.0


def mended_effort(
    joint: str, effort: FloatArray, lines: Sequence[int], problems: list[str], notes: list[str]
) -> FloatArray:
    """Return an effort with lost samples and spikes interpolated.

    Lost ones are exactly 0 amid values of one sign that are far from it; spikes are far beyond all
    other values. Both are short.

    Args:
        joint: its name.
        effort: (rows,) as logged, before any low pass.
        lines: (rows,) where they stand in the file.
        problems: more than 1 % of the rows are appended here.
        notes: else what was left out.
    """
    if effort.size < FEWEST or not np.isfinite(effort).all():
        return effort
    result = effort
    for found, what in ((_zeros(effort), "exactly 0 amid other values"), (_spikes(effort), "")):
        if not found.size:
            continue
        where = (
            f"{counted(found.size, 'row')} of {effort.size}, the first in line {lines[found[0]]}"
        )
        what = what or f"up to {np.abs(effort[found]).max():.4g}, far beyond all other values"
        if found.size > BAD_SHARE * effort.size:
            problems.append(
                f"joint {joint}: its effort is {what} in {where}: samples were lost; log it again, "
                "or leave these rows out of the file"
            )
            continue
        notes.append(f"joint {joint}: left out its effort, {what}, in {where}")
        result = result.copy() if result is effort else result
        kept = np.setdiff1d(np.arange(effort.size), found)
        result[found] = np.interp(found, kept, result[kept])
    return result


def _zeros(effort: FloatArray) -> NDArray[np.int64]:
    """Rows of short runs of zeros between values of one sign that are not near zero."""
    zero = effort == 0.0
    if not zero.any() or zero.all():
        return np.zeros(0, dtype=np.int64)
    steps = np.abs(np.diff(effort[~zero]))
    count = float(np.min(steps, where=steps > 0.0, initial=np.inf))
    near = _NEAR_ZERO * max(float(np.median(steps)), count) if np.isfinite(count) else 0.0
    return _short(zero, lambda a, b: min(abs(a), abs(b)) > near and a * b > 0.0, effort)


def _spikes(effort: FloatArray) -> NDArray[np.int64]:
    """Rows of short runs that are far beyond the others."""
    low, high = np.quantile(effort[:: max(1, effort.size // 20_000)], (0.05, 0.95))
    reach = _BEYOND * (high - low)
    beyond = (effort > high + reach) | (effort < low - reach)
    return _short(beyond, lambda a, b: True, effort) if reach > 0.0 else np.zeros(0, dtype=np.int64)


def _short(
    flags: NDArray[np.bool_], fits: Callable[[float, float], bool], effort: FloatArray
) -> NDArray[np.int64]:
    found = []
    for first, last in runs(flags):
        inside = first > 0 and last + 1 < flags.size and last - first < _LONGEST
        if inside and fits(float(effort[first - 1]), float(effort[last + 1])):
            found.append(np.arange(first, last + 1))
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)
