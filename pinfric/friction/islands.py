"""Independent parts of a problem: what neither rates nor loads couple is searched alone.

Their numbers of modes add up in place of being multiplied.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.problem import Modes, Problem
from pinfric.friction.rest import Mechanism, connected


class Island(NamedTuple):
    """An independent part of a problem, with arrays of its own.

    Attributes:
        coordinates, entries, gears: their numbers in the whole.
        problem, modes, mechanism: of these alone.
    """

    coordinates: np.ndarray
    entries: np.ndarray
    gears: np.ndarray
    problem: Problem
    modes: Modes
    mechanism: Mechanism

    def put_back(self, problem: Problem, modes: Modes, mechanism: Mechanism) -> None:
        """Write the island's modes, the solution in them and what its gears hold into the whole."""
        c, e, own = self.coordinates, self.entries, self.modes
        for name in _OF_COORDINATES:
            getattr(modes, name)[c] = getattr(own, name)
        modes.load[e], modes.effort[self.gears] = own.load, own.effort
        problem.coulomb_stick[e] = self.problem.coulomb_stick
        mechanism.way[c] = self.mechanism.way


def split(problem: Problem, modes: Modes, mechanism: Mechanism) -> list[Island]:
    """Return the islands of a problem with the modes as they are; none where it is one itself."""
    linked = problem.rate_slope != 0.0
    if linked.all():
        return []
    owner = problem.coordinate[problem.contact_entry]
    np.logical_or.at(linked, owner, (problem.contact[:, 1:] != 0.0).any(axis=2))
    linked |= np.equal.outer(mechanism.block, mechanism.block)
    parts = connected(linked)
    return [_part(problem, modes, mechanism, c) for c in parts] if len(parts) > 1 else []


def _part(problem: Problem, modes: Modes, mechanism: Mechanism, c: np.ndarray) -> Island:
    """The island of coordinates c, in ascending order."""
    place, entry = np.full((2, max(len(modes.stuck), len(modes.load))), -1)
    place[c] = np.arange(len(c))
    e = np.flatnonzero(place[problem.coordinate] >= 0)
    entry[e] = np.arange(len(e))
    t = np.flatnonzero(entry[problem.contact_entry] >= 0)
    g = np.flatnonzero(place[problem.gear_coordinate] >= 0)
    of = {"rate_free": c, "rate_scale": c, "gear_rotor": g, "gear_lines": g, "gear_held": g}
    taken = {name: getattr(problem, name)[of.get(name, e)] for name in (*of, *_OF_ENTRIES)}
    alone = problem._replace(
        **taken | {"coordinate": place[taken["coordinate"]]},
        rate_slope=problem.rate_slope[np.ix_(c, c)],
        contact=problem.contact[np.ix_(t, np.append(0, 1 + c))],
        contact_entry=entry[problem.contact_entry[t]],
    )
    own = Modes.of(len(c), len(e), len(g))
    for name in _OF_COORDINATES:
        getattr(own, name)[:] = getattr(modes, name)[c]
    own.load[:], own.effort[:] = modes.load[e], modes.effort[g]
    factor = mechanism.factor[:, c]
    return Island(
        c,
        e,
        g,
        alone,
        own,
        Mechanism(
            mechanism.closed,
            factor[factor.any(axis=1)],
            place[mechanism.block[c]],
            mechanism.ball[c],
            mechanism.idle[c],
            mechanism.way[c],
        ),
    )


#: Arrays of `Modes` with an element for each coordinate.
_OF_COORDINATES = "stuck", "direction", "at_rest", "friction", "rate", "verdict"
#: Arrays of a `Problem` with a row for each entry.
_OF_ENTRIES = (
    "constant",
    "coordinate",
    "ratio",
    "mu_slip",
    "mu_stick",
    "coulomb_slip",
    "coulomb_stick",
    "drag",
)
