"""Small things that were wrong without a word: an input each, what came out before, what does now.

`before` is what the code gave when the row was written, as measured; a row fails where that is
what it gives again. The parts have tests of their own in their folders.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from builders import block, plane_friction, random_friction, random_states, random_tree
from cases import turning_four_bar

import pinfric as pf


class Row(NamedTuple):
    """What is asked, a function that runs it, and its outcome before and now."""

    what: str
    run: Callable[[], Any]
    before: Any
    now: Any


def intervals_among_random_states() -> float:
    """Share of samples with an interval among states at random speeds, none at rest."""
    model = random_tree(4)
    scene = pf.Scene(model=model, friction=random_friction(model, 4))
    result = pf.inverse_dynamics(scene, *random_states(model, 4, 1000))
    return float((result.effort_lower < result.effort_upper).mean())


def shuffled(chunks: int | None) -> float:
    """Largest change of an effort when the same states come in another order."""
    model = random_tree(4)
    scene = pf.Scene(model=model, friction=random_friction(model, 4))
    states = random_states(model, 4, 100)
    order = np.random.default_rng(0).permutation(100)

    def upper(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        parts = pf.inverse_dynamics(scene, q, v, a, chunks=chunks or 100)
        return np.concatenate([part.effort_upper for part in parts])

    change = upper(*states)[order] - upper(*(x[order] for x in states))
    return float(np.abs(change).max())


def four_bar_to_and_fro() -> int:
    """Intervals of a four-bar's states whose neighbour turns the other way."""
    case = turning_four_bar(40)
    sign = np.where(np.arange(40) % 2, -1.0, 1.0)[:, None]  # a v v' stays: the loop still closes
    result = pf.inverse_dynamics(case.scene, case.q, sign * case.v, case.a)
    return int((result.effort_lower < result.effort_upper).sum())


ROWS = [
    Row("states in no order: share with an interval", intervals_among_random_states, 0.409, 0.0),
    Row("the same in another order: change of efforts (N m)", lambda: shuffled(None), 2411.58, 0.0),
    Row("the same in chunks (N m)", lambda: shuffled(7), 2411.58, 0.0),
    Row("states of a loop in no order: intervals", four_bar_to_and_fro, 40, 0),
]


@pytest.mark.parametrize("row", ROWS, ids=[row.what for row in ROWS])
def test_what_was_wrong_without_a_word(row):
    found = row.run()
    if isinstance(row.now, float):
        assert found == pytest.approx(row.now, rel=1e-6, abs=1e-12)
    else:
        assert found == row.now
    assert row.now != row.before
