"""What the friction of each site can be at one sample, and a kernel that solves lists of choices.

A *candidate* is a sample with one choice for every site: what slides has its sliding friction,
what sticks is at one of its two limits or has none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.dynamics.inverse.effort_maps import Maps
from pinfric.dynamics.problem.layout import Layout
from pinfric.friction.given_modes import solve_given_modes
from pinfric.friction.problem import Problem
from pinfric.kernels.compiled import kernel
from pinfric.model.laws import Moving, frictions_at

#: What a site's friction is in a candidate.
SLIDES, LOWER, UPPER, NONE = range(4)


class Law(NamedTuple):
    """The friction of each site for each code, x = -way (mu load + coulomb).

    Attributes:
        choices: (n, ns) number of frictions a site may have: 1 where it slides or has no dry
            friction, 2 where it sticks, 3 beside a reversal.
        code: (n, ns) what it is in the state that wrenches are given for.
        direction: (n, ne) along which its friction acts: 1, or a ball's unit vector.
        way: (4, n, ns) sign of its velocity, 1 for a ball; 1 and -1 at the limits, else 0.
        mu, coulomb: (4, n, ns), with drag: what is viscous while it slides, at the limits that of
            creeping (`laws`).
        constant: (n, ns) part of its load that is constant: all of it where it cannot vary.
    """

    choices: np.ndarray
    code: np.ndarray
    direction: np.ndarray
    way: np.ndarray
    mu: np.ndarray
    coulomb: np.ndarray
    constant: np.ndarray


class Candidates(NamedTuple):
    """Samples with a choice of frictions each, and their solutions.

    Attributes:
        sample: (m,) which sample.
        code: (m, ns). direction: (m, ne).
        x: (m, MOST_SOLUTIONS, ns) friction of each site along its direction, of each solution.
        found: (m,) number of solutions, -1 where rounding defeats the solver.
        figures: (m, 2) contraction, passes.
    """

    sample: np.ndarray
    code: np.ndarray
    direction: np.ndarray
    x: np.ndarray
    found: np.ndarray
    figures: np.ndarray


def friction_laws(layout: Layout, maps: Maps, velocity: np.ndarray, at_rest: np.ndarray) -> Law:
    """Return what each site's friction can be (`laws`; paper eq. 20, 21).

    Args:
        layout, maps: see `effort_maps`.
        velocity: (n, ne) relative velocities along the friction coordinates.
        at_rest: (n, ns) bool, sites that pass through rest beside a sample.
    """
    n, ns = at_rest.shape
    laws, first = layout.laws, layout.first_entry
    v = velocity[:, first].copy() if ns else np.zeros((n, 0))
    direction = np.ones((n, len(layout.entry_v)))
    for s in np.flatnonzero(layout.entry_count == 3):
        part = slice(first[s], first[s] + 3)
        v[:, s] = np.linalg.norm(velocity[:, part], axis=1)
        direction[:, part] = np.where(
            v[:, s, None] > 0, velocity[:, part] / np.maximum(v[:, s, None], 1e-300), np.eye(3)[0]
        )
    speed, slip = np.abs(v), np.sign(v)
    sticks, dry, ahead = speed <= laws.stick_velocity, laws.dry, slip > 0
    numbers = np.empty((6, *speed.shape))
    frictions_at(laws, speed, numbers)
    moving = Moving(*numbers)
    drag = laws.viscous * speed + np.where(ahead, moving.drag_forward, moving.drag_backward)
    creeping, creeping_mu = np.where(sticks, (slip * drag, moving.drag_mu), 0.0)
    ball = layout.entry_count == 3  # its limit is a sphere about 0, whatever the direction
    against = np.where(ball, np.abs(creeping), np.maximum(creeping, 0.0))
    along = np.where(ball, np.abs(creeping), np.maximum(-creeping, 0.0))
    still = np.zeros(v.shape)
    constant = still + layout.constant
    for t in np.flatnonzero(~layout.varies[layout.contact_site]):
        constant[:, layout.contact_site[t]] += np.linalg.norm(maps.contact[:, t, 0], axis=1)
    return Law(
        choices=np.where(dry & sticks, 2, np.where(dry & at_rest, 3, 1)),
        code=np.where(sticks & dry, NONE, SLIDES),
        direction=direction,
        way=np.array([slip, still + 1.0, still - 1.0, still]),
        mu=np.array(
            [
                moving.mu + moving.drag_mu,
                laws.mu_static + np.where(ball | ahead, creeping_mu, 0.0),
                laws.mu_static + np.where(ball | ~ahead, creeping_mu, 0.0),
                still,
            ]
        ),
        coulomb=np.array(
            [
                np.where(ahead, moving.forward, moving.backward) + drag,
                against + laws.coulomb_static[:, 0],
                along + laws.coulomb_static[:, 1],
                still,
            ]
        ),
        constant=constant,
    )


@kernel
def solve_list(
    contact: np.ndarray,
    row: np.ndarray,
    entry_site: np.ndarray,
    base: Problem,
    law: Law,
    candidates: Candidates,
) -> None:
    """Solve a list of candidates.

    Args:
        contact: (n, nt, 1 + ne, 3), of `Maps`.
        row: (number of varying contact forces,) which of the nt.
        entry_site: of `Layout`.
        base: buffers; its sites and coordinates are set.
        law: of all samples.
        candidates: x, found, figures are overwritten.
    """
    ns, direction = base.constant.size, candidates.direction
    nobody, no_guess, way = np.zeros(ns, np.bool_), np.full(1, np.nan), np.empty(ns)
    for m in range(candidates.sample.size):
        i = candidates.sample[m]
        for s in range(ns):
            code = candidates.code[m, s]
            way[s], base.mu_slip[s] = law.way[code, i, s], law.mu[code, i, s]
            base.coulomb_slip[s] = law.coulomb[code, i, s]
            base.constant[s] = law.constant[i, s]
        base.contact_slope[:] = 0.0
        for r in range(row.size):
            t = row[r]
            for e in range(3):
                base.contact_free[r, e] = contact[i, t, 0, e]
                for k in range(entry_site.size):
                    along = direction[m, k] * contact[i, t, 1 + k, e]
                    base.contact_slope[r, entry_site[k], e] += along
        candidates.found[m] = solve_given_modes(
            base, nobody, way, no_guess, candidates.x[m], candidates.figures[m]
        )
