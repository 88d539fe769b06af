"""Ways to slip against linear programs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from friction_cases import (
    random_problem,
)
from scipy.optimize import linprog

from pinfric.friction.rest import Mechanism
from pinfric.friction.ways import Kinematics

pytestmark = pytest.mark.usefixtures("interpreted_kernels")


def a_mechanism(A):
    """Coordinates whose rates are A^T w."""
    nc, none = A.shape[1], np.zeros(A.shape[1], dtype=bool)
    return Mechanism(True, A, np.arange(nc), none, none, np.zeros(nc))


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize(("freedoms", "seed"), [(1, 0), (2, 1), (2, 2), (3, 3), (3, 4)])
def test_the_ways_to_slip_are_those_that_linear_programs_allow(freedoms, seed, moves):
    """All 3^5 signs of r = c + A^T w by HiGHS; c where other joints move along."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(freedoms, 5))
    if seed in (2, 4):
        A[:, 1] = -2.0 * A[:, 0]  # two that move in proportion
    p = random_problem(seed, nc=5)
    c = rng.normal(size=5) * moves
    p.rate_free[:] = c + A.T @ rng.normal(size=freedoms)
    p.rate_scale[:] = np.abs(p.rate_free) + 1.0
    at_rest = np.ones(5, bool)
    kinematics = Kinematics(p, a_mechanism(A), at_rest)
    for level in range(6):
        yielded = [
            tuple(ways.get(i, 0.0) for i in range(5))
            for ways in kinematics.ways(list(range(5)), level, {})
        ]
        assert len(set(yielded)) == len(yielded)
        for signs in itertools.product((0.0, 1.0, -1.0), repeat=5):
            if np.count_nonzero(signs) == level:
                assert (signs in yielded) == _is_a_way(A, c, np.array(signs)), signs


def _is_a_way(A, c, signs):
    """Whether some w makes every rate of a sign at least 1e-6, and the others zero."""
    rate = np.column_stack([A.T, np.zeros(len(c))])
    slips, sticks = signs != 0.0, signs == 0.0
    upper = np.column_stack([-signs[slips, None] * A.T[slips], np.ones(slips.sum())])
    found = linprog(
        np.r_[np.zeros(len(A)), -1.0],
        upper,
        (signs * c)[slips],
        rate[sticks],
        -c[sticks],
        bounds=[(-1e3, 1e3)] * len(A) + [(0.0, 1.0)],
    )
    return bool(found.status == 0 and (not slips.any() or found.x[-1] > 1e-6))
