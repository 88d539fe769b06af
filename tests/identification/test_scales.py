"""A wrong factor on one joint's effort, with masses free."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from identify_cases import (
    COULOMB,
    NAMES,
    PLAIN,
    RATIO,
    ROTOR,
    VISCOUS,
    excitation,
    guess,
    log,
    logged,
    motor_effort,
    truth,
)

import pinfric as pf
from pinfric.identification.inertias import mass_changes
from pinfric.identification.misfit import Misfit
from pinfric.identification.normal import BlockProducts, FrictionNormalEquations, Normal, Prior
from pinfric.identification.notes import _scales
from pinfric.identification.scales import (
    MOVED,
    EffortScale,
    _with_factor,
    _with_scale,
    doubted,
    effort_scales,
    moved_masses,
    noted,
)

ELBOW = 2


def scaled(factor, seed=70):
    given = log(seed, 40.0, 125.0)
    effort = np.array(given.effort)
    effort[:, ELBOW] *= factor
    return replace(given, effort=effort)


def geared(seed):
    """The arm with gears at all joints that lose 4 to 30 %, driven up to 10 % more than driving."""
    random, friction, actuators = np.random.default_rng(seed), {}, []
    for name, (up, down), viscous, rotor in zip(NAMES, COULOMB, VISCOUS, ROTOR, strict=True):
        forward, backward = ({"static": size, "kinetic": size} for size in (up, down))
        friction[name] = {
            "coulomb": {"positive": forward, "negative": backward},
            "viscous": viscous,
        }
        efficiency = random.uniform(0.8, 0.96)
        lost = {"efficiency": efficiency, "back_efficiency": efficiency - random.uniform(0.0, 0.1)}
        actuators.append(
            {"joint": name, "transmission": {"ratio": RATIO, "rotor_inertia": rotor} | lost}
        )
    return truth().with_(friction=friction, actuators=actuators)


def elbow_of(found):
    return next(x for x in effort_scales(found.estimate) if x.joint == ELBOW)


def test_a_small_factor_on_one_effort_is_noted_beside_free_masses():
    """The other joints' efforts tell what the forearm weighs; losses of gears look the same."""
    found = pf.identify(guess(70), scaled(0.75))
    elbow, motor = elbow_of(found), found.estimate.question.motor
    assert elbow.value == pytest.approx(0.75, rel=0.03)
    assert motor
    assert elbow in noted([elbow], motor)
    (said,) = (line for line in found.notes if "effort's scale" in line)
    assert f"that of {NAMES[ELBOW]} {elbow.value:.2f} +-" in said
    assert not any("do not fit one robot" in line for line in found.doubts)
    # nothing where a shape of its residual explains more, and a smaller one hides nothing
    for share, hides in ((1.01 * elbow.gain, True), (0.99 * elbow.gain, False)):
        shape = Misfit(ELBOW, "time", 1.0, share, np.ones((1, 1)), 1)
        assert (NAMES[ELBOW] in str(_scales(found.estimate, [shape])[1])) is not hides


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "factor"), [(71, 0.6), (70, 1.5)])
def test_a_large_factor_on_one_effort_is_doubted_beside_free_masses(seed, factor):
    """The URDF's forearm is wrong by 20 % so that its effort alone is not refused."""
    found = pf.identify(guess(seed), scaled(factor, seed))
    elbow = elbow_of(found)
    assert elbow.value == pytest.approx(factor, rel=0.03)
    (said,) = (line for line in found.doubts if "do not fit one robot" in line)
    assert f"one robot: that of {NAMES[ELBOW]} {elbow.value:.2f}" in said


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 7))
def test_losses_of_gears_are_no_other_unit(seed):
    motion = excitation(seed, 40.0, 125.0)
    found = pf.identify(
        guess(seed, bearing=False), logged(seed, motion, motor_effort(geared(seed), motion))
    )
    assert not any("do not fit one robot" in line for line in found.doubts)


def test_behind_the_gears_a_smaller_factor_is_doubted():
    small, large, vague, idle = (
        EffortScale(0, 0.75, 0.01, 0.5),
        EffortScale(1, 1.45, 0.02, 0.4),
        EffortScale(2, 0.3, 0.26, 0.5),
        EffortScale(3, 0.16, 0.09, 0.09),
    )
    scales = [vague, idle, large, small, EffortScale(4, 0.9, 0.01, 0.5)]
    assert doubted(scales, motor=True) == [large]
    # explains too little for a doubt, but is clearly not 1
    assert noted(scales, motor=True) == [small, idle]
    assert doubted(scales, motor=False) == [small, large]
    assert noted(scales, motor=False) == []


def test_right_efforts_kept_masses_and_stated_units_are_not_doubted(found):
    scales = effort_scales(found.estimate)
    assert len(scales) == len(NAMES)
    assert doubted(scales, motor=True) == []
    kept = pf.identify(guess(70), scaled(1.0), laws=PLAIN, inertia="keep")
    assert effort_scales(kept.estimate) == []
    stated = pf.identify(guess(70), scaled(0.75), laws=PLAIN, gain=dict.fromkeys(NAMES, 1.0))
    said = "do not fit one robot", "effort's scale"
    assert not any(what in line for line in stated.notes for what in said)


def test_products_with_a_scale_are_those_of_scaled_columns():
    random = np.random.default_rng(1)
    rigid, others, theta = random.normal(size=(9, 4)), random.normal(size=(9, 3)), np.arange(4.0)
    columns, wanted = (
        np.hstack((rigid, others)),
        np.column_stack((0.7 * rigid, rigid @ theta, others)),
    )
    made = _with_scale(BlockProducts((columns.T @ columns)[None], np.ones(1)), 0.7, theta)
    assert made.products[0] == pytest.approx(wanted.T @ wanted)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_factor_that_no_row_determines_stays(size):
    """That of one joint multiplies the only column there is; rounding made its matrix singular."""
    both, none = size * np.ones((2, 2)), np.zeros(0)
    normal = Normal(both, np.zeros((2, 0)), np.zeros((0, 0)), 3.0 * both[0], none, 1e3)
    links = Prior(np.zeros(1), np.zeros(1), np.zeros(1))
    start = FrictionNormalEquations(normal, _with_factor(links, size / 1e3)).start
    assert start == pytest.approx([3.0, 0.0], abs=1e-4)


def test_a_mass_that_moves_is_doubted_where_rows_ask_for_it(found):
    """The URDF's upper arm weighs a third; what stands under the first axis shows in no row."""
    scene = guess(70)
    model = scene.model.copy()
    light = model.inertias[ELBOW]
    model.inertias[ELBOW] = pin.Inertia(light.mass / 3.0, light.lever, light.inertia)
    gains = dict.fromkeys(NAMES, 1.0)
    wrong = pf.identify(scene.with_(model=model), scaled(1.0), laws=PLAIN, gain=gains)
    changes = mass_changes(model, wrong.estimate.fit.theta)
    assert moved_masses(wrong.estimate) == {ELBOW: pytest.approx(changes[ELBOW])}
    (said,) = (line for line in wrong.doubts if line.startswith("masses that differ"))
    assert said.endswith(f": {NAMES[ELBOW]}")
    theta = found.estimate.fit.theta.copy()
    theta[0] *= 1.0 + 2.0 * MOVED
    heavy = replace(found.estimate, fit=replace(found.estimate.fit, theta=theta))
    assert mass_changes(guess(0).model, theta)[0] > MOVED
    assert moved_masses(heavy) == {}
