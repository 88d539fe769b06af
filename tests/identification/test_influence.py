"""Influence of a shape in the residual on the coefficients."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from identify_cases import KEPT, fit_of, rows_of

from pinfric.identification.influence import influence
from pinfric.identification.laws import FORWARD
from pinfric.identification.misfit import Misfit
from pinfric.identification.normal import BlockProducts
from pinfric.identification.uncertainty import gradients


def test_a_shape_leaves_open_what_the_model_takes_of_it_for_its_own():
    """Of a shape with a wave and a constant, only the wave shows beside Coulomb friction."""
    rng, s, count = np.random.default_rng(4), 0.3, 80
    wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(count) / count)
    effort = 2.0 + s * wave + 1e-3 * rng.normal(size=count)
    rows = rows_of(effort, {FORWARD: 1.0}, block=np.arange(count) // 4)
    weight, place, fit = np.ones(count), np.array([FORWARD]), fit_of({FORWARD: effort.mean()})
    grams = [BlockProducts.of(rows, weight, 20)]
    given = SimpleNamespace(
        rows=[rows], row_weights=[weight], fit=fit, problem=SimpleNamespace(weights=np.ones(1))
    )
    shape = Misfit(0, "", s, 1.0, s * np.column_stack((wave, np.ones(count))), 1)
    alone, _ = influence(grams, np.ones(1), KEPT, fit, place)
    unknown = gradients(given, [shape], place)
    wide, _ = influence(grams, np.ones(1), KEPT, fit, place, unknown=unknown)
    assert np.sum(wide**2) == pytest.approx(np.sum(alone**2) + s**2, rel=1e-9)


def test_coefficients_that_one_block_alone_shows_together_are_as_uncertain_as_they_are_large():
    """Before, eleven short logs of a seven-axis arm ended in a singular matrix."""
    count, place = 40, np.array([FORWARD, 3])
    shown = 1.0 * (np.arange(count) < 4)  # at one speed, in one of ten blocks
    effort = 3.0 * shown + 1e-3 * np.random.default_rng(5).normal(size=count)
    rows = rows_of(effort, {FORWARD: shown, 3: shown}, block=np.arange(count) // 4)
    fit = fit_of({FORWARD: 1.5, 3: 1.5})
    grams = [BlockProducts.of(rows, np.ones(count), 10)]
    moved, _ = influence(grams, np.ones(1), KEPT, fit, place)
    assert np.linalg.norm(moved, axis=0) == pytest.approx([0.75, 0.75], rel=0.5)
    assert np.linalg.norm(moved.sum(axis=1)) < 0.1  # their sum is known
