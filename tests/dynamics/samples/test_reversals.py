"""Reversals between samples, also between the parts of two threads."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.samples.reversals import reversals


def test_a_reversal_between_two_threads_parts_is_seen_once():
    """Four parts of two samples: the sign changes at every border, and each time slower behind."""
    velocity = np.array([3.0, 2.0, -1.0, -2.0, 1.0, 2.0, -1.0, -2.0])[:, None]
    expected = [False, False, True, False, True, False, True, False]
    for threads in (1, 2, 3, 4):
        found = reversals(velocity, np.zeros(1), threads)
        assert found[:, 0].tolist() == expected, threads
