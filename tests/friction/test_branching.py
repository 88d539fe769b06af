"""Bounds of forces in a sector of directions, against samples of it."""

from __future__ import annotations

import numpy as np
import pytest
from friction_cases import resting_six_bar

from pinfric.friction.branching import Program, bound_force, write_program


def with_forces(rest, contact):
    """A rest with other contact forces (nf, 1 + dz, 3), bounded by their reach."""
    spread = rest.reach @ np.abs(contact[:, 1:])
    low, high = contact[:, 0] - spread, contact[:, 0] + spread
    return rest._replace(contact=contact, low=low, high=high)


@pytest.mark.parametrize("turns", [False, True])
def test_a_force_is_below_its_bound_wherever_it_points_into_its_sector(turns):
    """Forces of a six-bar with nearly constant directions, or such that turn all around."""
    rest, _ = resting_six_bar(0)
    rng, dz = np.random.default_rng(1), rest.N.shape[1]
    if turns:
        rest = with_forces(rest, rng.normal(size=rest.contact.shape) * [1.0, 1.0, 0.0])
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


def test_a_force_that_may_point_anywhere_has_a_bound_that_its_largest_meets():
    """Between -high and high the bound is the length of high, whatever the friction."""
    rest, _ = resting_six_bar(0)
    rng, dz = np.random.default_rng(2), rest.N.shape[1]
    contact = rng.normal(size=rest.contact.shape) * [1.0, 1.0, 0.0]
    contact[:, 0] = 0.0
    rest, line = with_forces(rest, contact), np.empty(dz + 1)
    for i in range(len(contact)):
        assert bound_force(rest, i, 0.0, -1.0, line, np.empty((2, dz + 1))) == 0
        np.testing.assert_allclose(line[:-1], 0.0, atol=1e-12)
        assert line[-1] == pytest.approx(np.linalg.norm(rest.high[i]), rel=1e-12)


def test_a_force_on_a_line_is_its_own_bound():
    rest, _ = resting_six_bar(0)
    rng, dz = np.random.default_rng(3), rest.N.shape[1]
    rest = with_forces(rest, rng.normal(size=rest.contact.shape) * [1.0, 0.0, 0.0])
    line, sides = np.empty(dz + 1), np.empty((2, dz + 1))
    for i, centre in ((0, 0.0), (1, np.pi), (2, 0.0), (3, np.pi)):
        assert bound_force(rest, i, centre, 0.0, line, sides) == 1
        for z in rng.uniform(-1.0, 1.0, (50, dz)) * rest.reach:
            force = rest.contact[i, 0, 0] + z @ rest.contact[i, 1:, 0]
            assert (sides[0, :-1] @ z + sides[0, -1] <= 0.0) == (force * np.cos(centre) >= 0.0)
            assert line[:-1] @ z + line[-1] == pytest.approx(force * np.cos(centre), abs=1e-9)


@pytest.mark.parametrize("side", [0, 1])
def test_a_limit_on_one_side_only_leaves_the_other_row_empty(side):
    """Self-locking gears have such limits; a joint's load counts on the side with a limit."""
    rest, _ = resting_six_bar(0)
    n, dz, nf = *rest.N.shape, len(rest.owner)
    limits = np.full((2, n), 2.0)
    limits[side, 0] = np.inf
    rest = rest._replace(above=limits[0], below=limits[1])
    assert (rest.owner == 0).any()
    rows = 4 * n + 2 * nf
    program = Program(
        np.full((rows, dz), np.nan),
        *np.zeros((2, rows)),
        np.zeros((nf, dz + 1)),
        np.ones(n),
        0.5,
        0.5,
    )
    write_program(rest, program, np.zeros(nf), np.full(nf, -1.0))
    assert (program.G[side] == 0.0).all()
    assert program.h[side] == -3.0  # m is at least -1.5
    loads = sum(program.bound[i] for i in np.flatnonzero(rest.owner == 0))
    sign = 2.0 * side - 1.0
    np.testing.assert_allclose(program.G[1 - side], sign * rest.N[0] - 0.5 * loads[:-1])
