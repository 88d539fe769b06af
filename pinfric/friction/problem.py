"""The coupled friction problem as arrays; it does not depend on the robot.

Friction acts on *coordinates*: relative velocities of one site each, or of a mimic joint's sites
together with those of its leader. With x the friction along each of them, all quantities that
depend on friction are affine in x (paper eq. 3, 16, 17):

    r = rate_free + rate_slope x            relative acceleration (time stepping: next velocity)
    p = contact (1, x)                      contact forces of the bearings; load c = sum |p| + const

    slipping    x = -sum |ratio| direction (mu c + coulomb) - drag                  (paper eq. 20)
    sticking    r = 0 and x within the two static limits                            (paper eq. 21)

A gear with losses has one more entry on the coordinate that it drives, see `gears.py`. What r is
says the module that writes the `Problem`: forward dynamics, a time step.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np


class Problem(NamedTuple):
    """One coupled friction problem: nc coordinates, ne entries, nt contact forces, ng gears.

    Entries are those of the plan: a ball has three, a gear with losses has one. The last ng are
    those of gears.

    Attributes:
        rate_free: (nc,) r without friction.
        rate_slope: (nc, nc) change of r per unit friction; symmetric, positive definite.
        rate_scale: (nc,) size of the terms whose sum is `rate_free`, the scale for rounding.
        contact: (nt, 1 + nc, 3) contact forces, weighted: without friction (N m or N), then their
            change per unit friction.
        contact_entry: (nt,) entry of each contact force.
        constant: (ne,) part of each load that does not change.
        coordinate: (ne,) coordinate on which each entry acts.
        ratio: (ne,) entry velocity per coordinate velocity; 1 but for mimic joints.
        mu_slip, mu_stick: (ne,) coefficients of the load at the state's speed, and at rest.
        coulomb_slip, coulomb_stick: (ne, 2) constant friction against forward, backward motion.
        drag: (ne,) viscous friction against the entry's velocity.
        gear_rotor: (ng, 2) what arrives at each at r = 0 (N m or N), and its rotor's inertia per r.
        gear_lines: (ng, 4, n, 3) slope, offset and least effort of the lines of each, in ascending
            order: in forward motion, in backward motion, then in both from rest. Lines that fill
            the table repeat the last slope and begin at inf.
        gear_held: (ng, m, 2) the intervals of efforts that each holds at rest; inf, -inf: none.
    """

    rate_free: np.ndarray
    rate_slope: np.ndarray
    rate_scale: np.ndarray
    contact: np.ndarray
    contact_entry: np.ndarray
    constant: np.ndarray
    coordinate: np.ndarray
    ratio: np.ndarray
    mu_slip: np.ndarray
    mu_stick: np.ndarray
    coulomb_slip: np.ndarray
    coulomb_stick: np.ndarray
    drag: np.ndarray
    gear_rotor: np.ndarray
    gear_lines: np.ndarray
    gear_held: np.ndarray

    @property
    def gear_coordinate(self) -> np.ndarray:
        """(ng,) coordinate of each gear."""
        return self.coordinate[len(self.coordinate) - len(self.gear_rotor) :]

    @property
    def grip(self) -> np.ndarray:
        """(ne,) increase of an entry's static limits on its coordinate per unit of its load."""
        return np.asarray(np.abs(self.ratio) * self.mu_stick)


def empty_problem(
    coordinate: np.ndarray,
    ratio: np.ndarray,
    contact_entry: np.ndarray,
    constant: np.ndarray,
    gears: int = 0,
    lines: int = 1,
) -> Problem:
    """Return a problem of the given structure whose numbers are still to be written.

    The last entries are those of the gears, each with at most `lines` lines each way.
    """
    ne, nt = len(coordinate), len(contact_entry)
    nc = int(coordinate.max()) + 1 if ne else 0
    return Problem(
        rate_free=np.zeros(nc),
        rate_slope=np.zeros((nc, nc)),
        rate_scale=np.zeros(nc),
        contact=np.zeros((nt, 1 + nc, 3)),
        contact_entry=contact_entry,
        constant=constant,
        coordinate=coordinate,
        ratio=ratio,
        mu_slip=np.zeros(ne),
        mu_stick=np.zeros(ne),
        coulomb_slip=np.zeros((ne, 2)),
        coulomb_stick=np.zeros((ne, 2)),
        drag=np.zeros(ne),
        gear_rotor=np.zeros((gears, 2)),
        gear_lines=np.zeros((gears, 4, lines, 3)),
        gear_held=np.zeros((gears, 2 * lines + 1, 2)),
    )


#: Limit in place of an infinite one, as a multiple of the largest needed friction.
_WHATEVER = 1e5


def bounded(problem: Problem) -> Problem:
    """Return the problem with finite static limits; a self-locking gear has infinite ones."""
    limits = problem.coulomb_stick
    finite = np.isfinite(limits)
    if finite.all():
        return problem
    slope = np.diag(problem.rate_slope)
    needed = np.abs(problem.rate_free) / np.where(slope > 0.0, slope, np.inf)
    most = _WHATEVER * (needed.max(initial=1e-300) + limits[finite].max(initial=0.0))
    return problem._replace(coulomb_stick=np.minimum(limits, most))


class SearchOutcome(IntEnum):
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
        at_rest: (nc,) bool, whether the search may change this mode and the judge checks it; else
            the speed or the caller fixes it.
        friction: (nc,) N m or N; the guess of the next solve, NaN in the first place: none.
        load: (ne,) N m or N.
        effort: (ng,) that gears deliver (N m or N), which says on which line each is.
        rate: (nc,) r of the problem.
        verdict: (nc,) int: 0 obeys its law; -1, 1 held beyond its static limit, the way it would
            slip; `given_modes.SHOULD_STICK` slips against its direction.
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
    def of(cls, nc: int, ne: int, ng: int = 0) -> Modes:
        """Make the arrays for nc coordinates, ne entries and ng gears."""
        modes = cls(
            np.zeros(nc, dtype=bool),
            np.zeros(nc),
            np.zeros(nc, dtype=bool),
            np.zeros(nc),
            np.zeros(ne),
            np.zeros(ng),
            np.zeros(nc),
            np.zeros(nc, dtype=np.int64),
            np.zeros(2),
        )
        modes.forget()
        return modes

    def forget(self) -> None:
        """Let friction be no guess for the next solve."""
        self.friction[:1] = np.nan

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
