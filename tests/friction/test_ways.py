"""Ways to slip against linear programs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from friction_cases import random_problem
from scipy.optimize import linprog

from pinfric.friction.rest import Mechanism
from pinfric.friction.ways import PossibleWays

pytestmark = pytest.mark.usefixtures("interpreted_kernels")


def a_mechanism(A):
    """Coordinates whose rates are A^T w."""
    nc, none = A.shape[1], np.zeros(A.shape[1], dtype=bool)
    return Mechanism(True, A, np.arange(nc), none, none, np.zeros(nc))


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize(
    ("freedoms", "seed", "forced"),
    [
        (1, 0, {}),
        pytest.param(2, 1, {}, marks=pytest.mark.slow),
        (2, 2, {}),
        pytest.param(3, 3, {}, marks=pytest.mark.slow),
        (3, 4, {}),
        (1, 0, {3: -1.0}),
        (2, 1, {0: 1.0, 4: 1.0}),
        (3, 3, {3: -1.0}),
        (3, 3, {0: 1.0, 4: 1.0}),
        # one that must slip is locked by one that sticks, or by another that must slip
        (2, 2, {0: 1.0, 4: 1.0}),
        (3, 4, {0: 1.0, 4: 1.0}),
        (3, 4, {0: 1.0, 1: 1.0}),
        (3, 4, {0: -1.0, 1: 1.0, 2: 1.0}),
    ],
)
def test_the_ways_to_slip_are_those_that_linear_programs_allow(freedoms, seed, moves, forced):
    """All signs of r = c + A^T w by HiGHS; c where other joints move along; some slip anyhow."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(freedoms, 5))
    if seed in (2, 4):
        A[:, 1] = -2.0 * A[:, 0]  # two that move in proportion
    p = random_problem(seed, nc=5)
    c = rng.normal(size=5) * moves
    p.rate_free[:] = c + A.T @ rng.normal(size=freedoms)
    p.rate_scale[:] = np.abs(p.rate_free) + 1.0
    at_rest = np.ones(5, bool)
    kinematics = PossibleWays(p, a_mechanism(A), at_rest)
    weak = np.array([forced.get(i, 0.0) for i in range(5)])
    levels = list(kinematics.levels(forced))
    assert len(levels) == 6 - len(forced)
    assert list(kinematics.levels(forced, fewest=1)) == levels[1:]
    for level, all_ways in enumerate(levels):
        yielded = [
            tuple(0.0 if i in forced else ways.get(i, 0.0) for i in range(5)) for ways in all_ways
        ]
        assert len(set(yielded)) == len(yielded)
        for signs in itertools.product((0.0, 1.0, -1.0), repeat=5):
            if np.count_nonzero(signs) == level and not any(signs[i] for i in forced):
                assert (signs in yielded) == _is_a_way(A, c, np.array(signs), weak), signs


def _is_a_way(A, c, signs, weak):
    """Whether some w makes rates of a sign at least 1e-6, the weak ones 0 or more, others zero."""
    rate = np.column_stack([A.T, np.zeros(len(c))])
    slips, sticks = (signs + weak) != 0.0, (signs == 0.0) & (weak == 0.0)
    way = (signs + weak)[slips]
    upper = np.column_stack([-way[:, None] * A.T[slips], (signs != 0.0)[slips]])
    found = linprog(
        np.r_[np.zeros(len(A)), -1.0],
        upper,
        way * c[slips],
        rate[sticks],
        -c[sticks],
        bounds=[(-1e3, 1e3)] * len(A) + [(0.0, 1.0)],
    )
    return bool(found.status == 0 and (not signs.any() or found.x[-1] > 1e-6))
