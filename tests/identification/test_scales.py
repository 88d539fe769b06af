"""A wrong factor on one joint's effort, with masses free."""

from dataclasses import replace

import numpy as np
import pytest
from identify_cases import NAMES, PLAIN, guess, log

import pinfric as pf
from pinfric.identification.normal import BlockProducts
from pinfric.identification.scales import _with_scale, effort_scales

ELBOW = 2


def scaled(factor):
    given = log(70, 40.0, 125.0)
    effort = np.array(given.effort)
    effort[:, ELBOW] *= factor
    return replace(given, effort=effort)


@pytest.mark.parametrize("factor", [0.75, pytest.param(1.3, marks=pytest.mark.slow)])
def test_a_factor_on_one_effort_shows_beside_free_masses(factor):
    """The other joints' efforts tell what the forearm weighs."""
    found = pf.identify(guess(70), scaled(factor))
    elbow = next(x for x in effort_scales(found.estimate) if x.joint == ELBOW)
    assert elbow.doubted
    assert elbow.value == pytest.approx(factor, rel=0.03)
    (said,) = (line for line in found.doubts if "do not fit one robot" in line)
    assert f"one robot: that of {NAMES[ELBOW]} {elbow.value:.2f}" in said


def test_right_efforts_kept_masses_and_stated_units_are_not_doubted(found):
    assert not any(scale.doubted for scale in effort_scales(found.estimate))
    kept = pf.identify(guess(70), scaled(1.0), laws=PLAIN, inertia="keep")
    assert effort_scales(kept.estimate) == []
    stated = pf.identify(guess(70), scaled(0.75), laws=PLAIN, gain=dict.fromkeys(NAMES, 1.0))
    assert not any("do not fit one robot" in line for line in stated.doubts)


def test_products_with_a_scale_are_those_of_scaled_columns():
    random = np.random.default_rng(1)
    rigid, others, theta = random.normal(size=(9, 4)), random.normal(size=(9, 3)), np.arange(4.0)
    columns, wanted = (
        np.hstack((rigid, others)),
        np.column_stack((0.7 * rigid, rigid @ theta, others)),
    )
    made = _with_scale(BlockProducts((columns.T @ columns)[None], np.ones(1)), 0.7, theta)
    assert made.products[0] == pytest.approx(wanted.T @ wanted)
