"""Times in which a robot was touched: efforts far from all others', for a while."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinfric.dynamics.inverse.result import runs
from pinfric.identification.columns import Prepared, Rows
from pinfric.identification.normal import Fit, residuals
from pinfric.identification.recordings import Recording

#: Times a joint's usual error, as a median over so many s, from which efforts are another's. A push
#: of 45 N made 38 to 57; friction of six kinds that no law describes at most 4.4.
_FAR, _LASTING = 8.0, 0.3
#: Share of a log beyond which it is the model that is wrong.
_MOST = 0.2
#: s left out beside it.
_BESIDE = 0.25


@dataclass(frozen=True)
class Contact:
    """A time in which a robot was touched.

    Attributes:
        log: its number. start, end: s. joint: the one that shows it most.
        effort: largest effort of this joint that the fit lacks, N m or N.
    """

    log: int
    start: float
    end: float
    joint: int
    effort: float


def contacts(logs: Sequence[Prepared], rows: Sequence[Rows], fit: Fit) -> tuple[Contact, ...]:
    """Return the times in which efforts are far from the fit, of logs that mostly are not."""
    from scipy.ndimage import median_filter

    found = []
    for number, log in enumerate(logs):
        t = log.recording.trajectory.t[log.kept]
        off, usual = np.zeros(log.slides.shape), np.ones(len(rows))
        for j, own in enumerate(rows):
            if own.effort.size:
                left = np.abs(residuals(own, fit, j))
                usual[j] = 1.4826 * max(float(np.median(left)), 1e-12)
                off[log.slides[:, j], j] = left[own.log == number]
        if t.size < 2:
            continue
        beside = round(_LASTING / float(np.median(np.diff(t)))) // 2
        far = median_filter((off / usual).max(axis=1), 2 * beside + 1, mode="nearest") > _FAR
        if far.mean() > _MOST:
            continue
        for first, last in runs(far):
            if t[last] - t[first] < _LASTING:  # a reversal, or a spike
                continue
            span = slice(first, last + 1)
            joint = int((off[span] / usual).max(axis=0).argmax())
            most = float(off[span, joint].max())
            found.append(Contact(number, float(t[first]), float(t[last]), joint, most))
    return tuple(found)


def without_contacts(
    recordings: Sequence[Recording], found: Sequence[Contact]
) -> tuple[Recording, ...]:
    """Return recordings that lack the efforts of these times."""
    result = list(recordings)
    for one in found:
        recording, effort = result[one.log], result[one.log].effort.copy()
        t = recording.trajectory.t
        effort[(t >= one.start - _BESIDE) & (t <= one.end + _BESIDE)] = np.nan
        result[one.log] = replace(recording, effort=effort)
    return tuple(result)
