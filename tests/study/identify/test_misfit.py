"""What is said, and how wide intervals are, where no candidate law describes a robot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from identify_cases import BACK_EFFICIENCY, COULOMB, DELAY, EFFICIENCY, MU, VISCOUS, guess, truth
from identify_wrong_models import FALL, STATIC, wrong_log

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.study.identify.checks import check_efforts
from pinfric.study.identify.columns import Rows, joint_rows, prepare
from pinfric.study.identify.delay import Delay, disagreement, other_delays
from pinfric.study.identify.identify import Identified
from pinfric.study.identify.influence import influence
from pinfric.study.identify.laws import FORWARD, SLOT, SLOTS, Law
from pinfric.study.identify.misfit import Misfit, chance
from pinfric.study.identify.normal import BlockProducts, Fit, Prior, non_negative
from pinfric.study.identify.recordings import read_recordings
from pinfric.study.identify.uncertainty import (
    Uncertainty,
    for_a_further_log,
    gradients,
    uncertainty,
)
from pinfric.study.trajectory.log.reading import ReadingOptions

NAMES = truth().joint_names


@cache
def found(case: str, stribeck: bool = False, seed: int = 21) -> Identified:
    """A log of a case, with the truth's own laws."""
    loads = {1: "gear", 2: "bearing"}
    laws = {name: Law(load=loads.get(j, ""), stribeck=stribeck) for j, name in enumerate(NAMES)}
    scene = guess(seed)
    if case == "payload":  # with masses wrong as well it would be refused
        scene = scene.with_(model=truth().model)
    duration = 30.0 if case in ("true", "position", "offset") else 60.0
    rate = 250.0 if stribeck else 125.0  # where friction falls, a reversal takes 50 ms
    gain = dict.fromkeys(NAMES if case == "payload" else (), 1.0)
    return pf.identify(scene, wrong_log(case, seed, duration, rate), laws=laws, gain=gain)


def hits(one: Identified, stribeck: bool = False) -> dict[str, bool]:
    """Key -> whether its interval holds the true value."""
    least = 1.0 / (2.0 - BACK_EFFICIENCY)
    known = {
        f"friction.{NAMES[2]}.mu": (MU, MU),
        f"transmission.{NAMES[1]}.efficiency": (least, EFFICIENCY),
    }
    for name, ways, viscous in zip(NAMES, COULOMB, VISCOUS, strict=True):
        known[f"friction.{name}.viscous"] = viscous, viscous
        for way, value in zip(("positive", "negative"), ways, strict=True):
            known[f"friction.{name}.coulomb.{way}"] = value, value
            if stribeck:
                known[f"friction.{name}.coulomb.{way}.static"] = STATIC * value, STATIC * value
        if stribeck:
            known[f"friction.{name}.stribeck.velocity"] = FALL, FALL
    return {
        p.key: p.low <= known[p.key][1] and p.high >= known[p.key][0]
        for p in one.parameters
        if p.key in known
    }


def lacks(one: Identified) -> list[str]:
    return [line for line in one.notes if line.startswith("lack of fit")]


def test_the_true_model_lacks_nothing():
    assert lacks(found("true")) == []
    assert np.mean(list(hits(found("true")).values())) >= 0.85


@pytest.mark.parametrize(
    ("case", "named"),
    [
        ("position", "its angle"),
        ("offset", "an offset of"),
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


def test_a_shape_leaves_open_what_the_model_takes_of_it_for_its_own():
    """Of a shape with a wave and a constant, only the wave shows beside Coulomb friction."""
    rng, s, count = np.random.default_rng(4), 0.3, 80
    slots, still = np.zeros((count, len(SLOTS))), np.zeros(count)
    slots[:, SLOT[FORWARD]] = 1.0
    wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(count) / count)
    effort = 2.0 + s * wave + 1e-3 * rng.normal(size=count)
    rows = Rows(
        np.zeros((count, 10)),
        slots,
        effort,
        np.arange(count) // 4,
        np.zeros(count, dtype=int),
        still,
        still,
        still,
    )
    weight, place = np.ones(count), np.array([SLOT[FORWARD]])
    fit = Fit(np.zeros(10), (np.arange(len(SLOTS)) == place[0])[None, :] * effort.mean())
    grams = [BlockProducts.of(rows, weight, 20)]
    prior = Prior(np.zeros(10), np.full(10, np.inf), np.zeros(10))
    given = SimpleNamespace(
        rows=[rows], row_weights=[weight], fit=fit, problem=SimpleNamespace(weights=np.ones(1))
    )
    shape = Misfit(0, "", s, 1.0, s * np.column_stack((np.ones(count), wave)))
    alone, _ = influence(grams, np.ones(1), prior, fit, place)
    unknown = gradients(given, [shape], place)
    wide, _ = influence(grams, np.ones(1), prior, fit, place, unknown=unknown)
    assert np.sum(wide**2) == pytest.approx(np.sum(alone**2) + s**2, rel=1e-9)


def test_a_shape_is_as_large_in_the_model_as_beside_it():
    one = found("position")
    for shape in one.misfits:
        weight = one.estimate.row_weights[shape.joint]
        whole = np.sqrt(np.sum(shape.columns**2 * weight[:, None]) / weight.size)
        assert whole >= shape.size  # what shows, and what does not


def test_an_unknown_payload_is_no_factor_on_efforts():
    """Both make joints' efforts larger; a factor is still asked about."""

    logs = {case: wrong_log(case, 200, 10.0, 125.0) for case in ("payload", "true")}

    def check(case: str, factor: np.ndarray | float) -> None:
        given = replace(logs[case], effort=logs[case].effort * factor)
        (one,) = read_recordings(truth(), [given], {}, {}, ReadingOptions())
        columns = prepare(truth(), one)
        check_efforts(truth(), [joint_rows([columns], j, 0.0) for j in range(6)], ())

    check("payload", 1.0)
    for joints in ([1], range(6)):
        with pytest.raises(IdentificationError, match="shoulder_lift_joint: its effort is 2"):
            check("true", np.where(np.isin(np.arange(6), joints), 2.0, 1.0))


@pytest.mark.slow
def test_an_unknown_payload_leaves_friction_in_its_intervals():
    assert np.mean(list(hits(found("payload")).values())) >= 0.85
    assert any("scene lacks a payload" in line for line in found("payload").notes)


def test_a_bearing_that_the_scene_lacks_is_named():
    laws = dict.fromkeys(NAMES, Law()) | {NAMES[1]: Law(load="gear")}
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
def test_stribeck_friction_is_chosen_where_it_is_and_only_there():
    for case, stribeck in (("stribeck", True), ("true", False)):
        one = pf.identify(guess(22), wrong_log(case, 22))
        assert all(law.stribeck == stribeck for law in one.laws.values()), one.laws


def test_the_chance_of_a_shape_is_uniform_where_there_is_none():
    rng = np.random.default_rng(0)
    mixing = rng.normal(size=(4, 4))
    every = [chance(rng.normal(size=(40, 4)) @ mixing) for _ in range(4000)]
    for level in (0.01, 0.05, 0.5):
        error = 4.0 * np.sqrt(level * (1.0 - level) / len(every))
        assert np.mean(np.array(every) < level) == pytest.approx(level, abs=error)


@pytest.mark.parametrize("logs", [2, 3, 5])
def test_an_interval_covers_a_further_log(logs):
    """Coulomb friction of 2 N m, times a factor that scatters by 5 % from log to log."""
    rng, slot, inside = np.random.default_rng(logs), SLOT[FORWARD], []
    fit = Fit(np.zeros(10), (np.arange(len(SLOTS)) == slot)[None, :] * 2.0)
    slots, still = np.zeros((4 * logs, len(SLOTS))), np.zeros(4 * logs)
    slots[:, slot] = 1.0
    for _ in range(600):
        factors = 1.0 + 0.05 * rng.normal(size=logs + 1)
        effort = 2.0 * np.repeat(factors[:-1] / factors[:-1].mean(), 4)
        rows = Rows(
            np.zeros((4 * logs, 10)),
            slots,
            effort,
            np.repeat(np.arange(2 * logs), 2),
            np.repeat(np.arange(logs), 4),
            still,
            still,
            still,
        )
        given = SimpleNamespace(rows=[rows], fit=fit, prepared=[None] * logs)
        between, count = for_a_further_log(given, np.array([slot]))
        known = Uncertainty(np.array([slot]), 1e-12 * np.eye(1), between, 20, count, np.zeros(1))
        _, reach = known.of([slot])
        inside.append(abs(2.0 * factors[-1] / factors[:-1].mean() - 2.0) <= reach)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)


def test_a_delay_of_its_own_is_named():
    alike = {0: (0.004, 1e-3), 1: (0.005, 1e-3), 2: (0.003, 2e-3)}
    assert other_delays(Delay(0.004, 1e-3, (), alike)) == {}
    apart = alike | {3: (-0.014, 1e-3)}
    assert 3 in other_delays(Delay(0.004, 1e-3, (), apart))


def test_a_delay_that_joints_do_not_agree_on_is_less_certain():
    alike = [(0.004, 1e-3), (0.005, 1e-3), (0.003, 2e-3)]
    assert disagreement(0.0042, alike) == 1.0
    # what position-dependent friction did: each joint is sure of another delay
    apart = [(-0.03, 1e-3), (-0.014, 1.5e-3), (0.006, 1e-3), (0.002, 1e-3)]
    assert 1.5e-3 * disagreement(-0.0144, apart) > 2.5e-3  # then it is not determined
    # a joint that knows little has little to say
    assert disagreement(0.0042, [*alike, (0.05, 1e-2)]) == 1.0


@pytest.mark.slow
def test_play_is_said_to_be_no_delay():
    assert any("delays of" in line for line in lacks(found("play")))
    assert found("true").delay == pytest.approx(DELAY, abs=1.5e-3)


def test_coefficients_are_the_least_squares_that_are_not_negative():
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(3)
    A, y = rng.normal(size=(12, 30, 6)), rng.normal(size=(12, 30))
    A[::2, :, 5] += 3.0 * A[::2, :, 4] - 2.0 * A[::2, :, 3]  # columns that hang together
    ours = non_negative(np.einsum("fni,fnj->fij", A, A), np.einsum("fni,fn->fi", A, y))
    for columns, effort, x in zip(A, y, ours, strict=True):
        judge = lsq_linear(columns, effort, (0.0, np.inf), method="bvls", tol=1e-12).x
        assert x == pytest.approx(judge, abs=1e-6)
