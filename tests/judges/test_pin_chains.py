"""Ends of intervals of chains and rings of many pins at rest, against every corner."""

import warnings

import numpy as np
import pytest
from judges.pin_chains import random_chain
from judges.verdict import judge
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.inverse import interval_ends

#: Pins of each loop, of nine to twelve and of thirteen to sixteen pins.
ENUMERATED = [(9,), (5, 4), (10,), (4, 3, 3), (6, 4), (11,), (5, 3, 3), (12,), (4, 4, 4), (6, 3, 3)]
BRANCHED = [(13,), (4, 4, 5), (5, 3, 3, 3), (6, 4, 4), (8, 4, 3), (4, 4, 4, 4)]


def at_rest(chain):
    scene = chain.scene()
    zero = np.zeros((1, scene.model.nv))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = pf.inverse_dynamics(scene, zero, zero, zero)
    return found, [str(w.message) for w in caught]


def too_narrow(found, chain):
    """By how much the ends are short of those of all corners, of the widest interval."""
    corners = chain.every_corner()
    low, high = corners.min(axis=0), corners.max(axis=0)
    apart = np.abs([found.effort_lower[0] - low, found.effort_upper[0] - high])
    return apart.max() / (high - low).max()


@pytest.mark.parametrize(
    "seed", [pytest.param(x, marks=[pytest.mark.slow] * (x % 2)) for x in range(40)]
)
def test_nine_to_twelve_pins_have_the_ends_of_every_corner(seed):
    mu = (0.4, 0.6, 0.8, 1.2)[seed // 10]
    chain = random_chain(seed, ENUMERATED[seed % 10], mu)
    found, said = at_rest(chain)
    assert found.interval_exact[0]
    assert not said
    assert too_narrow(found, chain) < 1e-12


def test_ten_pins_that_single_flips_leave_too_narrow():
    """Single flips found ends of this chain that were 1.1 % too narrow."""
    chain = random_chain(40, (4, 3, 3), 0.8, 0.99)
    found, _ = at_rest(chain)
    assert found.interval_exact[0]
    assert too_narrow(found, chain) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_branch_and_bound_finds_the_ends_of_every_corner(seed):
    chain = random_chain(seed, BRANCHED[seed % 6], (0.2, 0.35)[seed // 6])
    found, said = at_rest(chain)
    assert found.interval_exact[0]
    assert not said
    assert too_narrow(found, chain) < 1e-12
    assert judge(found).passed(1e-12)


@pytest.mark.slow
def test_a_search_that_may_miss_the_ends_says_so(monkeypatch):
    """Fourteen pins, and fewer corners and nodes of branch and bound than they need."""
    monkeypatch.setattr(interval_ends, "ENUMERATED", 2)
    monkeypatch.setattr(interval_ends, "NODES", 3)
    chain = random_chain(21, (6, 4, 4), 0.8)
    found, said = at_rest(chain)
    assert found.interval_searched[0]
    assert not found.interval_exact[0]
    (line,) = said
    assert "sample 0: the intervals of the efforts may be too narrow" in line


def test_the_range_of_each_friction_is_that_of_every_corner():
    chain = random_chain(1, (5, 3, 3, 3), 0.4)
    found, _ = at_rest(chain)
    low, high = chain.every_friction()
    bars = len(chain.parent)  # a loop's pin: of side a on side b here, on side a there
    low[bars:], high[bars:] = -high[bars:], -low[bars:]
    assert found.site_names == (*(f"p{b}" for b in range(bars)), "c0", "c1", "c2", "c3")
    assert_allclose(found.friction_lower[0], low, rtol=1e-10)
    assert_allclose(found.friction_upper[0], high, rtol=1e-10)
