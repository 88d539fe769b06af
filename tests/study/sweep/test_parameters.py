"""Stiffness and hysteresis as uncertain figures: closed forms, the store, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from sweep_cases import sweep_of

import pinfric as pf
from pinfric.errors import SweepError
from pinfric.model.described import in_json
from pinfric.study.sweep.file import SweepFile
from pinfric.study.sweep.parameters import apply, resolve
from pinfric.study.sweep.summary import sweep_summary


@pytest.fixture(scope="module")
def arm():
    scene = pf.load_scene("ur10_machine_tending")
    return scene, pf.load_trajectory("ur10_machine_tending", scene)


def grid(**parameters):
    named = {key: {"choice": {"values": values}} for key, values in parameters.items()}
    return sweep_of(sampling="grid", **named)


def test_stiffness_scales_places_and_frequencies(arm):
    found = pf.sweep(*arm, grid(transmission__all__stiffness=[0.5, 1.0, 2.0]), processes=1)
    soft, usual, stiff = found.elastic
    np.testing.assert_allclose(soft[1:], 2 * usual[1:], rtol=1e-9)
    np.testing.assert_allclose(stiff[1:], 0.5 * usual[1:], rtol=1e-9)
    assert soft[0] == pytest.approx(usual[0] / np.sqrt(2), rel=1e-7)
    peaks = found.figure("motor_peak")
    np.testing.assert_array_equal(peaks[0], peaks[2])  # efforts know nothing of it
    rest = pf.elasticity(pf.inverse_dynamics(*arm))
    assert usual[0] == pytest.approx(rest.frequency.min())
    assert usual[2] == pytest.approx(rest.worst.tool.farthest)
    table = found.to_dataframe()
    assert table["tool_sag"].tolist() == found.elastic[:, 1].tolist()
    assert set(in_json(sweep_summary(found))["elastic"]) == {
        "lowest_frequency",
        "tool_sag",
        "tool_interval",
        "tool_reversal",
    }


def test_hysteresis_moves_friction_across_the_spring(arm):
    scene, motion = arm
    sweep = SweepFile.model_validate(grid(transmission__all__hysteresis=[0.5, 2.0]))
    targets = resolve(scene, sweep, "sweep")
    joint = "shoulder_pan_joint"
    for factor, behind in ((0.5, 2.25), (1.0, 4.5), (2.0, 9.0)):
        varied, _ = apply(scene, motion, targets, [factor])
        gear, coulomb = varied.actuators[0].transmission, varied.friction[joint].coulomb
        assert coulomb.static == pytest.approx(behind)
        assert coulomb.static + 101 * gear.no_load_torque.static == pytest.approx(15.0, abs=5e-3)
        assert gear.hysteresis == pytest.approx(factor * 2.909e-4)
    # an elbow with 1.5 N m before its spring gives no more
    varied, _ = apply(scene, motion, targets, [3.0])
    elbow = varied.actuators[2].transmission
    assert varied.friction["elbow_joint"].coulomb.static == pytest.approx(4.5 + 101 * 0.0149)
    assert elbow.no_load_torque.static == pytest.approx(0.0, abs=1e-15)


def test_less_hysteresis_narrows_the_interval_and_leaves_the_motors(arm, tmp_path):
    given = grid(transmission__all__hysteresis=[0.25, 1.0])
    found = pf.sweep(*arm, given, processes=1, out=tmp_path)
    assert found.elastic[0, 2] < 0.35 * found.elastic[1, 2]
    assert found.elastic[0, 1] == pytest.approx(found.elastic[1, 1])
    np.testing.assert_allclose(*found.figure("motor_peak"), rtol=0.03)
    again = pf.sweep(*arm, given, processes=1, out=tmp_path)
    assert again.resumed == 2
    np.testing.assert_array_equal(again.elastic, found.elastic)


def test_other_sweeps_of_an_elastic_arm_have_no_such_figures(arm):
    found = pf.sweep(*arm, grid(friction__all__viscous=[1.0]), processes=1)
    assert found.elastic.shape == (1, 0)
    assert found.elastic_quantiles() == {}
    assert sweep_summary(found).elastic == {}


@pytest.mark.parametrize(
    ("key", "scene", "message"),
    [
        ("transmission__all__stiffness", "panda_pick_and_place", "no drive with stiffness in this"),
        ("transmission__all__hysteresis", "panda_pick_and_place", "no drive with hysteresis"),
    ],
)
def test_rigid_gears_have_nothing_to_vary(key, scene, message):
    rigid = pf.load_scene(scene)
    with pytest.raises(SweepError, match=message):
        pf.sweep(rigid, pf.load_trajectory(scene, rigid), grid(**{key: [1.0]}), processes=1)


def test_factors_must_be_above_zero_and_friction_the_same_both_ways(arm):
    scene, motion = arm
    with pytest.raises(SweepError, match="a factor on stiffness must be above 0"):
        pf.sweep(scene, motion, grid(transmission__all__stiffness=[0.0, 1.0]), processes=1)
    one = {"static": 4.0, "kinetic": 4.0}
    friction = {**scene.friction, "elbow_joint": {"coulomb": {"positive": one, "negative": one}}}
    directed = scene.with_(friction=friction)
    with pytest.raises(SweepError, match="the hysteresis of elbow_joint moves friction between"):
        pf.sweep(directed, motion, grid(transmission__all__hysteresis=[1.0]), processes=1)
