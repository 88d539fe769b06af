"""Bounds of slopes of efforts against slopes at random frictions, by plain fixed-point passes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pinfric.dynamics.inverse.sign_bounds import Limits, Slopes, bound_slopes


def random_problem(seed, coupling):
    """Return contact (nt, 1 + ns, 3), owner, constant, limits and the effort's row of six sites."""
    rng = np.random.default_rng(seed)
    contact, owner = rng.normal(size=(8, 7, 3)), np.array([0, 0, 1, 2, 3, 4, 5, 5])
    contact[:, 1:] *= coupling
    contact[:, 0] *= 3.0
    most = rng.uniform(0.1, 0.5, 6)
    dry = rng.uniform(0.0, 0.2, 6)
    limits = Limits(-most, -dry, most.copy(), dry.copy())
    limits.a_low[2], limits.b_low[2] = limits.a_high[2], limits.b_high[2]  # one that slides
    return contact, owner, rng.uniform(0.0, 1.0, 6), limits, rng.normal(size=6)


def bounds(*given):
    """Return whether the friction contracts, and `Slopes`."""
    slopes = Slopes(*np.empty((3, 6)))
    return bound_slopes(*given, slopes), slopes


def friction(contact, owner, constant, limits, w):
    """x of limits mixed by w (n, 6), by 400 passes of the fixed point."""
    x, of_joint = np.zeros_like(w), np.eye(6)[owner]
    for _ in range(400):
        force = contact[:, 0] + np.einsum("tje,nj->nte", contact[:, 1:], x)
        load = constant + np.linalg.norm(force, axis=2) @ of_joint
        x = (limits.a_low * load + limits.b_low) * (1 - w)
        x += (limits.a_high * load + limits.b_high) * w
    return x


@pytest.mark.parametrize("coupling", [0.02, 0.1, 0.2])
@pytest.mark.parametrize(
    "seed", [pytest.param(x, marks=[pytest.mark.slow] * (x > 1)) for x in range(5)]
)
def test_efforts_between_two_frictions_differ_by_no_more_than_the_bounds(seed, coupling):
    contact, owner, constant, limits, U = random_problem(seed, coupling)
    contracts, (least, greatest, width) = bounds(contact, owner, constant, limits, U)
    assert contracts
    assert width[2] == 0.0
    rng, step = np.random.default_rng(seed), 1e-5
    w = rng.uniform(step, 1 - step, (50, 6))
    for s in (0, 1, 3, 4, 5):
        change = np.eye(6)[s] * step
        ahead, behind = (
            friction(contact, owner, constant, limits, w + sign * change) @ U
            for sign in (1.0, -1.0)
        )
        slope = (ahead - behind) / (2 * step)
        assert (min(least[s], 0.0) * width[s] - 1e-8 <= slope).all()
        assert (slope <= max(greatest[s], 0.0) * width[s] + 1e-8).all()


def test_without_coupling_the_bounds_are_the_efforts_own_slopes():
    contact, owner, constant, limits, U = random_problem(0, 0.0)
    _, (least, greatest, width) = bounds(contact, owner, constant, limits, U)
    assert_allclose(least, U, rtol=1e-14)
    assert_allclose(greatest, U, rtol=1e-14)
    load = constant + np.bincount(owner, np.linalg.norm(contact[:, 0], axis=1), 6)
    expected = (limits.a_high - limits.a_low) * load + limits.b_high - limits.b_low
    assert_allclose(width, expected, rtol=1e-14)


def test_loads_that_may_grow_without_bound_do_not_contract():
    assert not bounds(*random_problem(0, 5.0))[0]
