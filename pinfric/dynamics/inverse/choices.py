"""Possible frictions of each site at one sample.

A sliding site has its sliding friction, a sticking site is at one of its two limits or has no
friction; a site that reverses may have any of these.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.dynamics.inverse.effort_maps import LinkedSamples
from pinfric.dynamics.problem.plan import Plan
from pinfric.kernels.arrays import array, make
from pinfric.kernels.compiled import kernel
from pinfric.model.laws import Laws, is_dry, law_at

#: Codes of a site's friction.
SLIDES, LOWER, UPPER, NONE = range(4)


class SiteLaws(NamedTuple):
    """The friction of each site for each code, x = -way (mu load + coulomb).

    Attributes:
        options: (n, ns) number of frictions: 1 where a site slides or has no dry friction, 2 where
            it sticks, 3 beside a reversal; there 2 for a ball whose sliding friction is within its
            static limit.
        code: (n, ns) of the state that wrenches are given for.
        direction: (n, ne) along which friction acts: 1, or a ball's unit vector.
        way: (4, n, ns) sign of the velocity, 1 for a ball; 1 and -1 at the limits, else 0.
        mu, coulomb: (4, n, ns) with drag, at the limits that of creeping (`laws`).
        constant: (n, ns) constant part of the load: all of it where it cannot vary.
    """

    options: np.ndarray = array("n ns", np.int64, 1)
    code: np.ndarray = array("n ns", np.int64, SLIDES)
    direction: np.ndarray = array("n ne", fill=1.0)
    way: np.ndarray = array("4 n ns")
    mu: np.ndarray = array("4 n ns")
    coulomb: np.ndarray = array("4 n ns")
    constant: np.ndarray = array("n ns")


def friction_laws(plan: Plan, samples: LinkedSamples) -> SiteLaws:
    """Return the possible frictions of each site (`laws`; paper eq. 20, 21)."""
    velocity, at_rest = samples.velocity, samples.reversal
    n, ns = at_rest.shape
    law: SiteLaws = make(SiteLaws, n=n, ns=ns, ne=len(plan.entries.velocity_index))
    law.constant[:] = plan.sites.constant
    for t in np.flatnonzero(~plan.sites.varies[plan.contacts.site]):
        law.constant[:, plan.contacts.site[t]] += np.linalg.norm(samples.contact[:, t, 0], axis=1)
    ball = plan.sites.entry_count == 3
    _write_choices(plan.sites.laws, plan.sites.first_entry, ball, velocity, at_rest, law)
    return law


@kernel
def _write_choices(
    laws: Laws,
    first_entry: np.ndarray,
    ball: np.ndarray,
    velocity: np.ndarray,
    at_rest: np.ndarray,
    law: SiteLaws,
) -> None:
    """Write `friction_laws` without the loads."""
    for i in range(at_rest.shape[0]):
        for s in range(at_rest.shape[1]):
            first = first_entry[s]
            v = velocity[i, first]
            if ball[s]:
                w = velocity[i, first : first + 3]
                v = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
                for e in range(3):
                    law.direction[i, first + e] = w[e] / v if v > 0.0 else 1.0 if e == 0 else 0.0
            value = law_at(laws, s, v)
            sticks, dry = abs(v) <= laws.stick_velocity[s], is_dry(value)
            if dry and (sticks or at_rest[i, s]):
                law.options[i, s] = 2 if sticks else 3
                law.code[i, s] = NONE if sticks else SLIDES
            drag = value.viscous * abs(v) + value.drag
            law.way[SLIDES, i, s], law.mu[SLIDES, i, s] = np.sign(v), value.mu + value.drag_mu
            law.coulomb[SLIDES, i, s] = (value.forward if v > 0.0 else value.backward) + drag
            for code in (LOWER, UPPER):
                # a ball's limit is a sphere about 0, whatever the direction
                creeps = sticks and (ball[s] or (v > 0.0) == (code == LOWER))
                law.way[code, i, s] = 1.0 if code == LOWER else -1.0
                law.mu[code, i, s] = value.static_mu + (value.drag_mu if creeps else 0.0)
                static = value.static_forward if code == LOWER else value.static_backward
                law.coulomb[code, i, s] = static + (drag if creeps else 0.0)
            if ball[s] and law.options[i, s] == 3 and _is_within(law, i, s):
                law.options[i, s] = 2


@kernel
def _is_within(law: SiteLaws, i: int, s: int) -> bool:
    """Whether a ball's sliding friction is within its static limit, whatever the load."""
    return law.mu[SLIDES, i, s] <= law.mu[UPPER, i, s] and (
        law.coulomb[SLIDES, i, s] <= law.coulomb[UPPER, i, s]
    )
