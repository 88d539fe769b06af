"""The judge of modes names what is wrong with them."""

from __future__ import annotations

import numpy as np
import pytest
from builders import random_friction, random_tree
from friction_cases import (
    a_tree,
    random_problem,
    solved,
)
from judges.plain_laws import plain_normal_load

import pinfric as pf
from pinfric.friction.given_modes import SHOULD_STICK
from pinfric.friction.law import entry_friction, stick_limits
from pinfric.friction.problem import Modes, empty_problem
from pinfric.friction.rest import solve_modes

pytestmark = pytest.mark.usefixtures("interpreted_kernels")


def test_judge_names_what_is_wrong():
    p = random_problem(1, nc=2, strength=0.0)
    p.coulomb_slip[:], p.coulomb_stick[:] = 1.0, 1.0
    p.rate_slope[:], p.rate_free[:] = np.eye(2), [5.0, -0.5]
    (_, obeying), m = solved(p, np.array([True, True]), np.zeros(2))
    assert obeying == 1  # nothing was open
    m.at_rest[:] = True
    assert solve_modes(p, m, a_tree(2)) == (1, 0)
    assert m.verdict.tolist() == [1, 0]  # pulled forward by 5, held by 1
    m.stuck[:], m.direction[:] = False, [1.0, 1.0]
    assert solve_modes(p, m, a_tree(2)) == (1, 0)
    assert m.verdict.tolist() == [0, SHOULD_STICK]


def test_what_nothing_acts_on_and_nothing_holds_sticks():
    """Zero friction is within limits of zero: without loads everything stays at rest."""
    p = random_problem(0, nc=2, strength=0.0)
    p.rate_free[:] = p.rate_scale[:] = 0.0
    p.coulomb_slip[:] = p.coulomb_stick[:] = 0.0
    (_, _), m = solved(p, np.array([True, True]), np.zeros(2))
    m.at_rest[:] = True
    assert solve_modes(p, m, a_tree(2)) == (1, 1)
    assert m.verdict.tolist() == [0, 0]


@pytest.mark.parametrize("seed", range(40))
def test_sites_of_which_some_hold_without_limit_share_what_one_coordinate_needs(seed):
    """Each stays within its limits, infinite ones included; their sum is what is needed."""
    rng = np.random.default_rng(seed)
    p = empty_problem(
        np.zeros(5, np.int64), rng.choice([-0.7, 1.0, 2.0], 5), np.arange(5), np.zeros(5)
    )
    p.coulomb_stick[:] = rng.uniform(-0.5, 2.0, (5, 1))  # below 0: it must add at least so much
    p.coulomb_stick[:, 1] += rng.uniform(0.0, 3.0, 5) - 2.0 * p.coulomb_stick[:, 0]
    p.coulomb_stick[rng.random((5, 2)) < 0.3] = np.inf
    p.coulomb_stick[0, seed % 2] = np.inf
    m, lower, upper, phi = Modes.of(1, 5), np.empty(1), np.empty(1), np.full(5, np.nan)
    stick_limits(p, m.load, lower, upper)
    m.stuck[:] = True
    m.friction[:] = np.clip(rng.normal(scale=5.0), lower, upper)
    entry_friction(p, m, lower, upper, phi)
    assert (phi >= -p.coulomb_stick[:, 0] - 1e-12).all()
    assert (phi <= p.coulomb_stick[:, 1] + 1e-12).all()
    assert p.ratio @ phi == pytest.approx(m.friction[0], rel=1e-12, abs=1e-12)


def test_what_one_coordinate_shares_leaves_the_sites_of_others_alone():
    """Sites 0 and 1 hold without limit, 4 together; site 2 of the other coordinate slips."""
    p = empty_problem(np.array([0, 0, 1]), np.ones(3), np.arange(3), np.zeros(3))
    p.coulomb_stick[:2], p.coulomb_slip[2] = np.inf, 0.7
    m, lower, upper, phi = Modes.of(2, 3), np.empty(2), np.empty(2), np.full(3, np.nan)
    stick_limits(p, m.load, lower, upper)
    m.stuck[:], m.direction[:], m.friction[:] = (True, False), (0.0, 1.0), (4.0, -0.7)
    entry_friction(p, m, lower, upper, phi)
    assert phi[2] == -0.7
    assert phi[:2].sum() == pytest.approx(4.0)


# Normal loads of contacts against the bearings' formulas in plain NumPy.


@pytest.mark.parametrize("seed", range(8))
def test_contact_maps_give_the_normal_load(seed):
    rng = np.random.default_rng(seed)
    model = random_tree(seed, 6, sliding=0.5)
    scene = pf.Scene(model=model, friction=random_friction(model, seed))
    contacts = scene.site_tables.contacts
    for k, site in enumerate(scene.sites):
        B, C = contacts.map[contacts.site == k], contacts.map_moved[contacts.site == k]
        wrench, s = rng.normal(size=6) * 10, float(rng.normal())
        load = contacts.constant[k] + np.linalg.norm((B + s * C) @ wrench, axis=1).sum()
        assert load == pytest.approx(plain_normal_load(site, wrench, s), rel=1e-13)
