"""How the solution of one sample ended, and one state that obeys the laws."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class Status(IntEnum):
    """How the solution of one sample ended."""

    CONVERGED = 0
    #: No friction obeys the laws in this motion (moving), or friction holds against any effort (at
    #: rest): efforts are NaN.
    JAMMED = 1
    #: Several do: `solutions(sample)` returns them, the interval of the efforts encloses them.
    AMBIGUOUS = 2
    #: Undecided, efforts are NaN: rounding keeps the solver from a solution that is there, or the
    #: search for the ends of efforts came to its bound (then a warning says so).
    NOT_CONVERGED = 3
    #: The drives cannot balance the load here, or the closure changes its rank: a toggle, NaN.
    SINGULAR = 4


@dataclass(frozen=True)
class Solution:
    """One state of friction, efforts and reactions that obeys the laws at one sample.

    Attributes:
        effort: (na,). friction: (ns,), a ball's along its direction of slip.
        friction_coordinates: (nf,) the same, a ball's as three components in frame b.
        normal_load: (ns,). wrench: (ns, 6). multipliers: (number of loops, 6).
    """

    effort: np.ndarray
    friction: np.ndarray
    friction_coordinates: np.ndarray
    normal_load: np.ndarray
    wrench: np.ndarray
    multipliers: np.ndarray
