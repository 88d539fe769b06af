"""Accelerations of trees and linkages of pins, at rest and in motion, against every mode.

Five thousand states: `python tests/judges/planar_states.py 0 2500`.
"""

import numpy as np
import pytest
from judges.planar_states import Moving, compare, loop_state, tree_state


@pytest.mark.parametrize("kind", ["tree", "loop"])
@pytest.mark.parametrize("seeds", [range(10), pytest.param(range(10, 120), marks=pytest.mark.slow)])
def test_the_acceleration_is_the_one_that_obeys_the_laws(kind, seeds):
    assert {compare(kind, seed) for seed in seeds} == {"same"}


@pytest.mark.slow
def test_states_have_up_to_eleven_pins_at_rest_or_sliding():
    trees = [tree_state(seed)[0] for seed in range(60)]
    loops = [loop_state(seed)[0] for seed in range(60)]
    pins = {len(state.rate) for state in trees + loops}
    assert {2, 3, 4, 5, 6, 7, 10, 13} <= pins
    resting = [np.count_nonzero(state.rate == 0) for state in trees]
    assert max(resting) >= 9
    assert sum(0 < n < len(s.rate) for n, s in zip(resting, trees, strict=True)) > 5
    assert sum(bool(state.rate.any()) for state in loops) > 10


def test_the_judge_is_right_of_one_bar_that_slides():
    """(m l^2 + I) a = u - m g l cos - mu R |F|, F = m (a_c - g), of a bar that hangs level."""
    state, _ = tree_state(0)
    chain = state.chain
    assert chain.parent[0] == -1
    one = type(chain)(
        chain.parent[:1], chain.place[:1], chain.close, chain.close_at, chain.mass[:1],
        chain.place[:1] + np.array([0.2, 0.0]), (0,), chain.mu, chain.radius[:1], chain.dry[:1],
    )  # fmt: skip
    moving = Moving(one, np.array([2.0]), np.array([0.5]))
    phi = moving.solve(np.array([[1]]))
    a = float(moving.acceleration(phi)[0, 0])
    m, g, r = one.mass[0], 9.81, 0.2
    force = m * np.array([-(2.0**2) * r, a * r + g])
    friction = one.mu * one.radius[0] * np.linalg.norm(force) + one.dry[0]
    assert (m * r**2 + 1e-2 * m) * a == pytest.approx(0.5 - m * g * r - friction, rel=1e-12)
