"""Stribeck friction is found where it is and only there."""

from __future__ import annotations

import numpy as np
import pytest
from identify_cases import COULOMB, NAMES, guess
from identify_wrong_models import FALL, STATIC, found, hits, wrong_log

import pinfric as pf


@pytest.mark.slow
def test_stribeck_friction_is_identified_as_such():
    one = found("stribeck", stribeck=True)
    inside = hits(one, stribeck=True)
    assert len(inside) == 20 + 18
    assert np.mean(list(inside.values())) >= 0.85, inside
    entry = one.scene.friction[NAMES[0]]
    assert entry.stribeck.velocity == pytest.approx(FALL, rel=0.2)
    assert entry.coulomb.positive.static == pytest.approx(STATIC * COULOMB[0][0], rel=0.1)
    assert entry.coulomb.positive.kinetic == pytest.approx(COULOMB[0][0], rel=0.1)


@pytest.mark.slow
def test_intervals_contain_both_exponents_of_the_fall_that_fit():
    one = found("stribeck 1", stribeck=True, seed=704)
    inside = hits(one, stribeck=True)
    assert np.mean(list(inside.values())) >= 0.85, inside
    exponents = [one.scene.friction[name].stribeck.exponent for name in NAMES]
    assert exponents.count(1.0) >= 5, exponents
    open_ = [j for j, n in enumerate(exponents) if n != 1.0]
    for j in open_:  # where the wrong one fits, a note says that the other does as well
        assert any(NAMES[j] in line and "exponent 1 " in line for line in one.notes), one.notes


@pytest.mark.slow
def test_stribeck_friction_is_chosen_where_it_is_and_only_there():
    for case, stribeck in (("stribeck", True), ("true", False)):
        one = pf.identify(guess(22), wrong_log(case, 22))
        assert all(law.stribeck == stribeck for law in one.laws.values()), one.laws
