"""First crossings of zero in a step."""

from __future__ import annotations

import numpy as np
import pytest

from pinfric.dynamics.simulation.crossing import first_crossing, root


@pytest.mark.parametrize(
    ("guard", "expected"),
    [
        (lambda t: 0.7 - t, 0.7),
        (lambda t: (t - 0.41) ** 2 + 1e-6, None),
        (lambda t: (t - 0.41) ** 2 - 1e-6, 0.409),
        (lambda t: t * (0.5 - t), 0.5),  # starts on zero
        (lambda t: t - 0.1, 0.0),  # below from the start
        (lambda t: t**3, None),  # starts on zero and leaves upwards
        (lambda t: -t, 0.0),  # fires where it starts
        (lambda t: -1e-12 * np.ones_like(t), None),  # rounding
        (lambda t: max(0.0, 0.3 - t) if t < 0.6 else 0.55 - t, 0.6),  # a jump
        (lambda t: 0.0 if t < 0.5 else 0.5 - t, 0.5),  # on zero for a while, then below
        (
            lambda t: 1.0 + np.cos(20 * t) - 0.02,
            (np.pi - np.arccos(0.98)) / 20,
        ),  # waves between looks
    ],
)
def test_first_crossing(guard, expected):
    times = np.linspace(0.0, 1.0, 6)
    found = first_crossing(guard, times, np.array([guard(t) for t in times]), 1e-11)
    if expected is None:
        assert found is None
    else:
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("before", "after"), [(1e-3, -1.0), (0.3, -0.3), (0.5, -1e-9), (2.0, -0.1)]
)
def test_the_root_of_a_jump_is_its_far_side(before, after):
    """There what fired is below zero; a stick or slip that is tried there goes on."""
    for place in np.random.default_rng(0).uniform(0.1, 0.9, 20):

        def guard(t, place=place):
            return before if t < place else after

        found = root(guard, 0.0, 1.0)
        assert guard(found) == after
        assert found - place < 1e-14
