"""What is said, and how wide intervals are, where no candidate law describes a robot."""

from __future__ import annotations

import numpy as np
import pytest
from identify_cases import COULOMB, DELAY, NAMES, PLAIN, VISCOUS, guess, whole_friction
from identify_wrong_models import found, hits, wrong_log

import pinfric as pf
from pinfric.identification.identify import Identified
from pinfric.identification.laws import Law
from pinfric.identification.misfit import chance
from pinfric.identification.uncertainty import (
    uncertainty,
)


def lacks(one: Identified) -> list[str]:
    return [line for line in one.notes if line.startswith("lack of fit")]


@pytest.mark.slow
def test_the_true_model_lacks_nothing():
    assert lacks(found("true")) == []
    assert np.mean(list(hits(found("true")).values())) >= 0.85


@pytest.mark.parametrize(
    ("case", "named"),
    [
        ("position", "its angle"),
        pytest.param("offset", "an offset of", marks=pytest.mark.slow),
        pytest.param("stribeck", "the speed", marks=pytest.mark.slow),
        pytest.param("motor turn", "the motor's angle (once per turn)", marks=pytest.mark.slow),
        pytest.param("filter", "the rate of change of the effort", marks=pytest.mark.slow),
        pytest.param("play", "the rate of change of the effort", marks=pytest.mark.slow),
    ],
)
def test_a_wrong_model_is_named_and_widens_the_intervals(case, named):
    one = found(case)
    assert sum(named in line for line in lacks(one)) >= 3, one.notes
    assert np.mean(list(hits(one).values())) >= 0.7
    if one.misfits:  # blocks alone do not show it
        alone, wide = (uncertainty(one.estimate, shapes) for shapes in ((), one.misfits))
        assert np.trace(wide.within) > np.trace(alone.within)


def test_a_shape_is_as_large_in_the_model_as_beside_it():
    one = found("position")
    for shape in one.misfits:
        weight = one.estimate.row_weights[shape.joint]
        whole = np.sqrt(np.sum(shape.columns**2 * weight[:, None]) / weight.size)
        assert whole >= shape.size  # what shows, and what does not


@pytest.mark.slow
def test_an_unknown_payload_leaves_friction_in_its_intervals():
    assert np.mean(list(hits(found("payload")).values())) >= 0.85
    assert any("scene lacks a payload" in line for line in found("payload").notes)


@pytest.mark.slow
def test_a_bearing_that_the_scene_lacks_is_named():
    laws = PLAIN | {NAMES[1]: Law(load="gear")}
    one = pf.identify(guess(100, bearing=False), wrong_log("true", 100), laws=laws)
    (line,) = lacks(one)
    assert line.startswith(f"lack of fit: {NAMES[2]}: ")
    assert "the load on its bearing" in line
    inside = hits(one)
    assert inside[f"friction.{NAMES[2]}.coulomb.positive"]
    assert inside[f"friction.{NAMES[2]}.coulomb.negative"]


def test_an_offset_withholds_nothing_of_what_it_cannot_change():
    one = found("offset")
    # forward and backward together are known as well as without it
    up, down = (
        one.posterior[f"friction.{NAMES[3]}.coulomb.{way}"] for way in ("positive", "negative")
    )
    assert np.std(up + down) < 0.2 * np.std(up - down)


def test_the_chance_of_a_shape_is_uniform_where_there_is_none():
    rng = np.random.default_rng(0)
    mixing = rng.normal(size=(4, 4))
    every = [chance(rng.normal(size=(40, 4)) @ mixing) for _ in range(4000)]
    for level in (0.01, 0.05, 0.5):
        error = 4.0 * np.sqrt(level * (1.0 - level) / len(every))
        assert np.mean(np.array(every) < level) == pytest.approx(level, abs=error)


@pytest.mark.slow
def test_play_is_said_to_be_no_delay():
    assert any("delays of" in line for line in lacks(found("play")))
    assert found("true").delay == pytest.approx(DELAY, abs=1.5e-3)


def test_the_whole_friction_is_known_where_its_parts_are_not(ur10):
    for name in ur10.laws:  # the lift's was 73 %: hats over the speed sum up to Coulomb friction
        draws = whole_friction(ur10, name, 0.5)
        assert 0.004 < np.std(draws) / np.mean(draws) < 0.05, name


@pytest.mark.slow
def test_friction_that_a_law_lacks_is_within_what_the_whole_one_states():
    one, joints = found("stribeck"), []
    for name, ways, viscous in zip(NAMES, COULOMB, VISCOUS, strict=True):
        draws = whole_friction(one, name, 0.5)
        assert abs(np.mean(ways) + 0.5 * viscous - draws.mean()) < 3.0 * draws.std()
        assert draws.std() < 0.05 * draws.mean()  # 19 to 29 % with hats that sum up to Coulomb's
        joints.append(draws)
    # what one joint lacks says nothing of the others
    assert np.abs(np.corrcoef(joints) - np.eye(len(NAMES))).max() < 0.5
