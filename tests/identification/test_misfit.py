"""Reports and widths of intervals where no candidate law describes a robot."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from identify_cases import (
    COULOMB,
    DELAY,
    NAMES,
    PLAIN,
    VISCOUS,
    fit_of,
    guess,
    rows_of,
    whole_friction,
)
from identify_wrong_models import found, hits, wrong_log

import pinfric as pf
from pinfric.identification.identify import Identified
from pinfric.identification.laws import FORWARD, Law
from pinfric.identification.misfit import _by_angle, _of_joint, _Track, _track, chance
from pinfric.identification.uncertainty import uncertainty


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


@pytest.mark.slow
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


def slider(n: int, **more: object) -> SimpleNamespace:
    """An estimate of a sliding joint with Coulomb friction of 1 N."""
    scene = pf.Scene(chain(("slide", pin.JointModelPX(), lump(1.0))))
    choice = SimpleNamespace(laws=[Law(exponent=None)])
    fit = fit_of({FORWARD: 1.0}, np.array([1.0] + [0.0] * 9))
    return SimpleNamespace(scene=scene, choice=choice, fit=fit, **more)


def test_what_shapes_are_made_of_are_derivatives_of_the_fitted_effort():
    """Of t by the links and t^3 by friction: 1 + 3 t^2 and 6 t."""
    t = np.linspace(0.0, 2.0, 21)
    q, v, a = (x[:, None] for x in (np.sin(t), np.cos(t), -np.sin(t)))
    rows, slides = rows_of(t, {FORWARD: t**3}, np.outer(t, np.eye(10)[0])), t > 0.5
    motion = SimpleNamespace(t=t, joint_positions=lambda: q)
    recording = SimpleNamespace(trajectory=motion, velocity=v, acceleration=a)
    one = SimpleNamespace(recording=recording, kept=np.arange(21), slides=slides[:, None])
    one.rigid, one.slots = rows.rigid[:, None], rows.slots[:, None]
    track = _track(slider(21, prepared=[one]), 0, [np.zeros((21, 1, 3))])
    exact = np.column_stack((q, 1.0 + 3.0 * t**2, 6.0 * t, t - 1.0))[slides]
    ours = np.column_stack((track.q, track.slope, track.bend, track.time))
    assert ours == pytest.approx(exact)


def drift(t: np.ndarray, noise: float = 1e-3) -> tuple[_Track, np.ndarray]:
    """A slider's motion to and fro, and a residual that grows with time."""
    rng, still = np.random.default_rng(0), np.zeros(t.size)
    track = _Track(
        0.1 * np.sin(t), 0.1 * np.cos(t), still, still, still, t / t[-1], np.zeros((t.size, 3))
    )
    return track, 0.5 * t / t[-1] + noise * rng.normal(size=t.size)


def test_shapes_of_a_sliding_joint_are_over_its_whole_travel():
    track, _ = drift(np.linspace(0.0, 60.0, 50))
    for (_, near), (_, far) in zip(
        _by_angle(slider(50), 0, track),
        _by_angle(slider(50), 0, replace(track, q=9.0 * track.q)),
        strict=True,
    ):
        assert near == pytest.approx(far)


def test_rows_without_weight_say_nothing_of_a_shape():
    t = np.linspace(-60.0, 60.0, 1200)
    track, off = drift(t)
    forward = np.sign(track.v)
    wild = np.arange(t.size) % 3 == 0  # as many outliers, which grow the other way
    off, weight = np.where(wild, -9.0 * off, off), np.where(wild, 1e-9, 1.0)
    rows = rows_of(forward + off, {FORWARD: forward}, time=t, velocity=track.v)
    found = slider(t.size, rows=[rows], row_weights=[weight])
    shape = next(_of_joint(found, 0, track))
    assert shape.over.startswith("time")
    # 0.5 x the RMS of -1 to 1, of all rows
    assert shape.size == pytest.approx(0.5 / np.sqrt(3.0) * np.sqrt(2.0 / 3.0), rel=0.02)
