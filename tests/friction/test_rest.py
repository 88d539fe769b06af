"""Mechanisms at rest: what rests together, and whether anything moves."""

from __future__ import annotations

import numpy as np

from pinfric.friction.rest import Mechanism


def test_what_rests_together_is_found_and_whether_anything_moves():
    """Coordinates 0 and 1 are one motion, 2 another; 3 cannot move at all."""
    factor = np.array([[1.0, -2.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0]])
    four = np.arange(4)
    mechanism = Mechanism(True, factor, four, np.zeros(4, bool), np.zeros(4, bool), np.zeros(4))
    everything = np.ones(4, dtype=bool)
    together = [set(group.members.tolist()) for group in mechanism.groups(everything)]
    assert {0, 1} in together
    assert {2} not in together
    assert mechanism.is_dependent(everything)
    assert not mechanism.is_dependent(np.array([True, False, True, False]))
    assert mechanism.is_locked(everything)
    assert not mechanism.is_locked(np.array([True, True, False, True]))
    assert mechanism.is_locked(np.array([False, True, True, False]))
    mechanism.factor = factor[:1]  # of another state: nothing is remembered that is not so
    assert mechanism.is_locked(np.array([True, False, False, False]))
