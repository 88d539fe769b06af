"""Bounds of forces in a sector of directions, against samples of it."""

from __future__ import annotations

import numpy as np
from friction_cases import resting_six_bar

from pinfric.friction.branching import bound_force


def test_a_force_is_below_its_bound_wherever_it_points_into_its_sector():
    rest, _ = resting_six_bar(0)
    rng, dz = np.random.default_rng(1), rest.N.shape[1]
    line, sides = np.empty(dz + 1), np.empty((2, dz + 1))
    inside = outside = 0
    for i in np.flatnonzero(~rest.on_a_line):
        for half in (-1.0, 0.25 * np.pi, 0.05):
            centre = rng.uniform(-np.pi, np.pi)
            count = bound_force(rest, i, centre, half, line, sides)
            assert count == (0 if half < 0.0 else 2)
            for z in rng.uniform(-1.0, 1.0, (200, dz)) * rest.reach:
                force = (rest.contact[i, 0] + z @ rest.contact[i, 1:])[:2]
                size, angle = np.hypot(*force), np.arctan2(force[1], force[0])
                off = abs((angle - centre + np.pi) % (2 * np.pi) - np.pi)
                within = bool((sides[:count, :-1] @ z + sides[:count, -1] <= 0.0).all())
                assert within == (half < 0.0 or off <= half)
                inside, outside = inside + within, outside + (not within)
                if half < 0.0 and ((force < rest.low[i, :2]) | (force > rest.high[i, :2])).any():
                    continue  # beyond the box, where that bound is made
                if within:
                    bound = line[:-1] @ z + line[-1]
                    assert size <= bound * (1 + 1e-12)
                    assert half < 0.0 or bound <= size / np.cos(half) * (1 + 1e-12)
    assert min(inside, outside) > 100
