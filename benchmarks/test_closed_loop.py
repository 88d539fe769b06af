"""In closed loop knowing the load pays where the level of friction is true, and only there."""

from __future__ import annotations

import closed_loop
import numpy as np
import pytest


@pytest.fixture(scope="module")
def errors():
    """RMS errors (mrad) of joints 1-3 on the fast motion, by law."""
    scene, motion = closed_loop.arm(), closed_loop.desired("fast", 4.0)
    laws = closed_loop.laws(scene, *motion, closed_loop.tanh_of(scene, *motion))
    return {
        name: closed_loop.track(
            scene, *motion[:2], closed_loop.feed_forward(scene, *motion, friction)
        )[:3]
        for name, friction in laws.items()
    }


def test_the_load_halves_what_tanh_leaves(errors):
    assert (2.0 * errors["load-aware"] <= errors["tanh, fitted without load"]).all(), errors


def test_a_level_that_is_too_large_costs_what_the_load_brings(errors):
    wrong = errors["load-aware, 20 % too large"]
    assert (wrong > 0.9 * errors["tanh, 20 % too large"]).all(), errors
    assert (wrong > 5.0 * errors["load-aware"]).all(), errors
    assert (np.array(wrong) < errors["no friction compensation"]).all()
