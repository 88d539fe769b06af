"""Modes (stick or slip) of coordinates, with the solution in these modes, for the kernels."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np


class Found(IntEnum):
    """How a search for modes ended."""

    SOLVED = 0
    NONE = 1
    AMBIGUOUS = 2
    NOT_CONVERGED = 3
    #: The search has reached its limit.
    UNDECIDED = 4
    #: There is one, which a shaft with a little compliance would leave.
    UNSTABLE = 5


class Modes(NamedTuple):
    """Modes of all coordinates and the solution in them; every array is overwritten by a search.

    Attributes:
        stuck: (nc,) bool.
        direction: (nc,) of the slip, -1 or 1; 0 where it sticks or does not move.
        at_rest: (nc,) bool. True: the search may change this mode, and the judge checks it. False:
            the speed or the caller fixes it, and the judge ignores it.
        friction: (nc,) N m or N; the guess of the next solve, NaN in the first place: none.
        load: (ns,) N m or N.
        effort: (ng,) that gears deliver (N m or N), which says on which line each is.
        rate: (nc,) relative acceleration, or what the problem says.
        verdict: (nc,) int: 0 obeys its law; -1, 1 held beyond its static limit, the way it would
            slip; `consistency.SHOULD_STICK` slips against its direction.
        figures: (2,) contraction and passes of the solve.
    """

    stuck: np.ndarray
    direction: np.ndarray
    at_rest: np.ndarray
    friction: np.ndarray
    load: np.ndarray
    effort: np.ndarray
    rate: np.ndarray
    verdict: np.ndarray
    figures: np.ndarray

    @classmethod
    def of(cls, nc: int, ns: int, ng: int = 0) -> Modes:
        """Make the arrays for nc coordinates, ns sites and ng gears."""
        friction = np.zeros(nc)
        friction[:1] = np.nan
        return cls(
            np.zeros(nc, dtype=bool),
            np.zeros(nc),
            np.zeros(nc, dtype=bool),
            friction,
            np.zeros(ns),
            np.zeros(ng),
            np.zeros(nc),
            np.zeros(nc, dtype=np.int64),
            np.zeros(2),
        )

    def copy(self) -> Modes:
        """Return modes with arrays of their own."""
        return Modes(*(array.copy() for array in self))

    def kept(self) -> GivenModes:
        """Return which coordinates stick and the directions of the others, as copies."""
        return GivenModes(self.stuck.copy(), self.direction.copy())

    def take(self, other: Modes) -> None:
        """Overwrite these arrays with another's."""
        for mine, theirs in zip(self, other, strict=True):
            mine[:] = theirs


@dataclass(frozen=True, eq=False)
class GivenModes:
    """Modes that a simulation keeps from one event to the next and passes with each state.

    Attributes:
        stuck: (nc,) bool.
        direction: (nc,) of the slip of others, as in `Modes`.
        balls_turn: whether balls that slip face their motion instead.
    """

    stuck: np.ndarray
    direction: np.ndarray
    balls_turn: bool = True
