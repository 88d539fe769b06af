"""Friction where everything slips, against its law written out in NumPy."""

import numpy as np
import pytest

from pinfric.friction.given_modes import slide
from pinfric.friction.problem import Modes, empty_problem


def slipping(seed, mu=0.1, sites=7, coordinates=6):
    """A random problem whose last site has no load that counts, and modes in which all slips."""
    rng = np.random.default_rng(seed)
    on = np.concatenate([np.arange(coordinates), rng.integers(0, coordinates, sites)])[:sites]
    owner = np.sort(rng.integers(0, sites - 1, 11))
    problem = empty_problem(
        on, rng.choice([-1.0, 0.7, 1.0], sites), owner, rng.uniform(0, 2, sites)
    )
    A = rng.normal(size=(coordinates, coordinates))
    problem.rate_slope[:] = A @ A.T
    problem.rate_free[:], problem.contact[:] = (
        rng.normal(size=coordinates),
        rng.normal(size=(11, 7, 3)),
    )
    problem.contact[:, 1:] *= 0.3
    problem.mu_slip[:] = mu * rng.uniform(0.2, 1.0, sites)
    problem.coulomb_slip[:], problem.drag[:] = rng.uniform(0, 1, (sites, 2)), rng.normal(size=sites)
    modes = Modes.of(coordinates, sites)
    modes.direction[:] = rng.choice([-1.0, 1.0], coordinates)
    return problem, modes


@pytest.mark.parametrize("seed", range(20))
def test_friction_obeys_its_law_under_the_loads_it_causes(seed):
    problem, modes = slipping(seed)
    assert slide(problem, modes)
    assert 0.0 < modes.figures[0] < 0.9
    assert 1 <= modes.figures[1] <= 6  # passes of Newton's method
    x, law = modes.friction, np.zeros(6)
    force = problem.contact[:, 0] + np.einsum("tce,c->te", problem.contact[:, 1:], x)
    load = problem.constant.copy()
    np.add.at(load, problem.contact_entry, np.linalg.norm(force, axis=1))
    for s, (c, ratio) in enumerate(zip(problem.coordinate, problem.ratio, strict=True)):
        way = ratio * modes.direction[c]
        dry = problem.mu_slip[s] * load[s] + problem.coulomb_slip[s, 0 if way > 0 else 1]
        law[c] -= abs(ratio) * modes.direction[c] * dry + ratio * problem.drag[s]
    np.testing.assert_allclose(x, law, atol=1e-13)
    np.testing.assert_allclose(modes.load, load, rtol=1e-13)
    np.testing.assert_allclose(modes.rate, problem.rate_free + problem.rate_slope @ x, atol=1e-12)
    again = modes.friction.copy()
    assert slide(problem, modes)
    assert modes.figures[1] == 0.0  # it starts from the last solution
    np.testing.assert_array_equal(modes.friction, again)


def test_what_rests_or_may_have_several_answers_is_left_to_others():
    problem, modes = slipping(0)
    for which in (modes.stuck, modes.at_rest):
        which[2] = True
        assert not slide(problem, modes)
        which[2] = False
    strong, modes = slipping(0, mu=3.0)
    assert not slide(strong, modes)
