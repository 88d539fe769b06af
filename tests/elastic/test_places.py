"""Zonotopes against a search over all their corners, and joints that answer drives."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import ConvexHull

from pinfric.elastic.places import (
    MOST_CORNERS,
    corners,
    extents,
    farthest,
    joint_answer,
    outline,
)


@pytest.mark.parametrize("k", [0, 1, 2, 5, 8])
def test_farthest_place_and_extents(k):
    g = np.random.default_rng(k).normal(size=(3, k))
    every = np.array([g @ signs for signs in product((-1.0, 1.0), repeat=k)]).reshape(-1, 3)
    assert farthest(g) == pytest.approx(np.linalg.norm(every, axis=1).max(initial=0.0))
    assert_allclose(extents(g), np.abs(every).max(axis=0, initial=0.0), atol=1e-15)
    assert len(corners(g)) == max(len(every) // 2, 1)


def test_many_intervals_have_a_bound():
    g = np.random.default_rng(0).normal(size=(3, MOST_CORNERS + 1))
    exact = max(np.linalg.norm(corners(g), axis=1))
    assert exact <= farthest(g) <= 2 * exact


@pytest.mark.parametrize("k", [1, 2, 3, 6])
def test_outline_is_the_convex_hull(k):
    g = np.random.default_rng(k).normal(size=(2, k))
    g = np.insert(g, 0, 0.0, axis=1)  # a joint that does not rest
    found = outline(g)
    assert_allclose(found[0], found[-1], atol=1e-14)
    assert len(found) == 2 * k + 1
    if k > 1:
        every = np.array([g @ signs for signs in product((-1.0, 1.0), repeat=k + 1)])
        x, y = found[:-1].T
        area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
        assert area == pytest.approx(ConvexHull(every).volume)
    assert outline(np.zeros((2, 3))).shape == (1, 2)


def test_joints_answer_their_drives():
    couples = np.array([[1.0, 0.0], [0.5, 1.0]])  # the second motor turns with the first joint
    Q = joint_answer(couples, np.zeros((0, 2)))
    assert_allclose(couples @ Q, np.eye(2), atol=1e-14)
    loop = np.array([[1.0, -2.0, 0.0], [0.0, 1.0, 3.0]])
    Q = joint_answer(np.array([[1.0, 0.0, 0.0]]), loop)
    assert_allclose(Q[:, 0], [1.0, 0.5, -0.5 / 3], atol=1e-14)


def test_nothing_follows_where_drives_do_not_fit_the_motions():
    assert joint_answer(np.eye(2)[:1], np.zeros((0, 2))) is None
    assert joint_answer(np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((0, 2))) is None
