"""Fewer samples of a long recording: while it is read, so that it never stands in memory whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pinfric.motions.log.noise import low_pass

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Thinning:
    """Which samples of a recording are kept.

    Args:
        rate: Hz, down to which samples are left out.
        cutoff: Hz of the low pass on accelerations and efforts before: what is above it shall not
            come back below it.
    """

    rate: float
    cutoff: float

    def every(self, step: float) -> int:
        """Return of how many samples one is kept.

        Args:
            step: s between samples.
        """
        return max(1, int((1.0 + 1e-6) / (self.rate * step)))

    def acceleration(self, column: FloatArray, step: float) -> FloatArray:
        """Return one joint's accelerations low-passed; where it is held, it is held.

        Args:
            column: (T,) rad/s^2 or m/s^2.
            step: s between samples.
        """
        return np.where(column != 0.0, low_pass(column, step, self.cutoff), 0.0)

    def effort(self, column: FloatArray, step: float) -> FloatArray:
        """Return one joint's efforts low-passed, NaN where there is none.

        Args:
            column: (T,) N m or N.
            step: s between samples.
        """
        known = np.isfinite(column)
        if not known.any():
            return column
        place = np.arange(column.size)
        whole = column if known.all() else np.interp(place, place[known], column[known])
        return np.where(known, low_pass(whole, step, self.cutoff), np.nan)
