"""Stiffness and hysteresis as uncertain figures: closed forms, the store, what is refused."""

import warnings

import numpy as np
import pytest
from builders import example
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from sweep_cases import BOX, MASS, MU, G, pushed_block, run, steady, sweep_of, uniform

import pinfric as pf
from pinfric.errors import SweepError
from pinfric.model.described import in_json
from pinfric.sweeps.distributions import (
    LogNormal,
    Normal,
    OneOf,
    Steps,
    TruncatedNormal,
    Uniform,
)
from pinfric.sweeps.file import SweepFile, load_sweep
from pinfric.sweeps.parameters import apply, draw, resolve
from pinfric.sweeps.summary import sweep_summary


@pytest.fixture(scope="module")
def arm():
    return example("ur10_machine_tending")


def grid(**parameters):
    named = {key: {"choice": {"values": values}} for key, values in parameters.items()}
    return sweep_of(sampling="grid", **named)


def test_stiffness_scales_places_and_frequencies(arm):
    found = pf.sweep(*arm, grid(transmission__all__stiffness=[0.5, 1.0, 2.0]), processes=1)
    soft, usual, stiff = found.elastic
    assert_allclose(soft[1:], 2 * usual[1:], rtol=1e-9)
    assert_allclose(stiff[1:], 0.5 * usual[1:], rtol=1e-9)
    assert soft[0] == pytest.approx(usual[0] / np.sqrt(2), rel=1e-7)
    peaks = found.figure("motor_peak")
    assert_array_equal(peaks[0], peaks[2])  # efforts know nothing of it
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


@pytest.mark.filterwarnings("ignore:.*factors above .* change nothing")
def test_hysteresis_moves_friction_across_the_spring(arm):
    scene, motion = arm
    sweep = SweepFile.model_validate(grid(transmission__all__hysteresis=[0.5, 2.0]))
    targets = resolve(scene, sweep, "sweep")
    joint = "shoulder_pan_joint"
    for factor, behind in ((0.5, 2.25), (1.0, 4.5), (2.0, 9.0)):
        varied, _ = apply(scene, motion, targets, [factor])
        gear, coulomb = varied.actuators[0].transmission, varied.friction[joint].coulomb
        assert coulomb.static == pytest.approx(behind)
        assert coulomb.static + 101 * gear.no_load_torque.static == pytest.approx(16.72, abs=5e-3)
        assert gear.hysteresis == pytest.approx(factor * 2.909e-4)
    # an elbow with 6.7 N m before its spring gives no more
    varied, _ = apply(scene, motion, targets, [3.0])
    elbow = varied.actuators[2].transmission
    assert varied.friction["elbow_joint"].coulomb.static == pytest.approx(4.5 + 101 * 0.0668)
    assert elbow.no_load_torque.static == pytest.approx(0.0, abs=1e-15)


@pytest.mark.filterwarnings("ignore:.*factors above .* change nothing")
def test_factors_that_can_move_no_more_friction_are_said(arm):
    scene, _ = arm
    with pytest.warns(pf.PinfricWarning, match=r"factors above 2.5 change nothing at elbow"):
        resolve(scene, SweepFile.model_validate(grid(transmission__all__hysteresis=[3.0])), "s")
    usual = grid(transmission__elbow_joint__hysteresis=[0.5, 1.3])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        resolve(scene, SweepFile.model_validate(usual), "s")


def test_less_hysteresis_narrows_the_interval_and_leaves_the_motors(arm):
    given = grid(transmission__all__hysteresis=[0.25, 1.0])
    found = pf.sweep(*arm, given, processes=1)
    assert found.elastic[0, 2] < 0.35 * found.elastic[1, 2]
    assert found.elastic[0, 1] == pytest.approx(found.elastic[1, 1])
    assert_allclose(*found.figure("motor_peak"), rtol=0.03)


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
    with pytest.raises(SweepError, match=message):
        pf.sweep(*example(scene), grid(**{key: [1.0]}), processes=1)


def test_factors_must_be_above_zero_and_friction_the_same_both_ways(arm):
    scene, motion = arm
    with pytest.raises(SweepError, match="a factor on stiffness must be above 0"):
        pf.sweep(scene, motion, grid(transmission__all__stiffness=[0.0, 1.0]), processes=1)
    one = {"static": 4.0, "kinetic": 4.0}
    friction = {**scene.friction, "elbow_joint": {"coulomb": {"positive": one, "negative": one}}}
    directed = scene.with_(friction=friction)
    with pytest.raises(SweepError, match="the hysteresis of elbow_joint moves friction between"):
        pf.sweep(directed, motion, grid(transmission__all__hysteresis=[1.0]), processes=1)


SCENE = pf.load_scene("panda_pick_and_place")


JOINT = "panda_joint2"


def swept(tmp_path, text: str, **more):
    (tmp_path / "rows.csv").write_text(text)
    content = {"pinfric_sweep": 1, "samples": 50, "table": str(tmp_path / "rows.csv"), **more}
    entries, source = load_sweep(content)
    targets = resolve(SCENE, entries, source)
    return targets, draw(targets, entries)


def test_rows_stay_together_beside_what_is_drawn_alone(tmp_path):
    text = (
        f"friction.{JOINT}.mu,friction.{JOINT}.viscous\n"
        if SCENE.friction[JOINT].viscous
        else (f"friction.{JOINT}.mu,friction.panda_joint1.mu\n")
    )
    targets, values = swept(
        tmp_path,
        text + "0.5,5\n1,10\n2,20\n",
        parameters={"speed": {"uniform": {"low": 0.5, "high": 1.0}}},
    )
    assert targets[0].name == "speed"
    assert (values[:, 2] == 10.0 * values[:, 1]).all()
    assert set(values[:, 1]) == {0.5, 1.0, 2.0}
    assert np.abs(np.corrcoef(values[:, 0], values[:, 1])[0, 1]) < 0.5


def test_one_direction_and_efficiencies_are_set(tmp_path):
    both = {"static": 2.0, "kinetic": 1.0}
    gear = {
        "ratio": 100,
        "efficiency": 0.9,
        "back_efficiency": 0.8,
        "rotor_inertia": 1e-4,
        "no_load_torque": {"positive": both, "negative": both},
    }
    scene = SCENE.with_(
        friction={JOINT: {"coulomb": {"positive": both, "negative": both}}},
        actuators=[
            {"joint": n, "transmission": gear if n == JOINT else None} for n in SCENE.joint_names
        ],
    )
    names = [
        f"friction.{JOINT}.coulomb.positive",
        f"transmission.{JOINT}.efficiency",
        f"transmission.{JOINT}.no_load_torque.negative",
        f"transmission.{JOINT}.rotor_inertia",
    ]
    (tmp_path / "rows.csv").write_text(",".join(names) + "\n3,0.7,4,5\n")
    entries, source = load_sweep(
        {"pinfric_sweep": 1, "samples": 1, "table": str(tmp_path / "rows.csv")}
    )
    targets = resolve(scene, entries, source)
    changed, _ = apply(scene, None, targets, draw(targets, entries)[0])
    coulomb = changed.friction[JOINT].coulomb
    assert (coulomb.positive.static, coulomb.negative.static) == (6.0, 2.0)
    found = next(d for d in changed.drives if d.name == JOINT).transmission
    assert (found.efficiency, found.back_efficiency, found.rotor_inertia) == (0.7, 0.8, 5e-4)
    assert (found.no_load_torque.positive.kinetic, found.no_load_torque.negative.kinetic) == (1, 4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("friction.elbow.mu\n1\n", "friction.elbow.mu: there is no joint"),
        (f"friction.{JOINT}.mu\n1\nx\n", "row 2 has no finite number"),
        (f"friction.{JOINT}.mu\n-1\n", "must be 0 or more"),
        (f"transmission.{JOINT}.efficiency\n1.2\n", "at most 1"),
        (f"friction.{JOINT}.mu\n", "has no rows"),
        ("", "cannot be read"),
    ],
)
def test_tables_that_cannot_be_are_refused(tmp_path, text, said):
    with pytest.raises(SweepError, match=said):
        swept(tmp_path, text)


def test_a_table_is_no_design(tmp_path):
    with pytest.raises(SweepError, match="drawn at random"):
        swept(tmp_path, "speed\n1\n", sampling="sobol", samples=8)
    with pytest.raises(SweepError, match="`parameters` or `table` is missing"):
        load_sweep({"pinfric_sweep": 1, "samples": 3})


def test_effort_follows_friction_and_payload_as_worked_by_hand():
    scene = pushed_block(payloads={"box": BOX})
    found = run(
        scene,
        steady(scene),
        sweep_of(friction__all__mu=uniform(0.5, 1.5), payload__box__mass=uniform(0.5, 4.0)),
    )
    factor, box = found.values.T
    effort = factor * MU * (MASS + box) * G
    assert_allclose(found.figure("peak")[:, 0], effort, rtol=1e-12)
    assert_allclose(found.figure("rms")[:, 0], effort, rtol=1e-12)
    assert found.parameter_names == ("friction.*.mu", "payload.box.mass")
    assert factor.min() >= 0.5
    assert box.max() <= 4.0
    assert factor.mean() == pytest.approx(1.0, abs=0.06)  # 3 standard errors


def test_mounting_turns_gravity_and_speed_scales_time():
    scene = pushed_block()
    found = run(
        scene,
        steady(scene, 0.5, 0.8),
        sweep_of(
            20,
            mounting__pitch=uniform(-0.3, 0.1),
            mounting__roll=uniform(-0.2, 0.2),
            speed=uniform(0.5, 2.0),
        ),
    )
    pitch, roll, speed = found.values.T
    # the base's x axis points down for pitch > 0; roll tilts the plane sideways
    along = MASS * G * np.sin(pitch)
    across = MASS * G * np.cos(pitch)  # roll turns it within the plane the friction feels
    effort = MU * across + MASS * 0.8 * speed**2 - along
    assert_allclose(found.figure("peak")[:, 0], effort, rtol=1e-12)
    assert_allclose(found.figure("speed")[:, 0], 1.3 * speed, rtol=1e-12)
    assert np.ptp(roll) > 0.1


# Quantiles of distributions against SciPy.


U = (np.arange(4000) + 0.5) / 4000


@pytest.mark.parametrize(
    ("distribution", "reference"),
    [
        (Normal(mean=2.0, std=0.3), stats.norm(2.0, 0.3)),
        (Uniform(low=-1.0, high=3.0), stats.uniform(-1.0, 4.0)),
        (LogNormal(median=2.0, sigma=0.5), stats.lognorm(0.5, scale=2.0)),
        (TruncatedNormal(mean=1.0, std=0.5, low=0.2, high=1.7), stats.truncnorm(-1.6, 1.4, 1, 0.5)),
        (TruncatedNormal(mean=0.0, std=1.0, low=1.0), stats.truncnorm(1.0, np.inf)),
    ],
)
def test_quantiles_are_scipys(distribution, reference):
    assert_allclose(distribution.quantile(U), reference.ppf(U), rtol=1e-9, atol=1e-12)
    ends = distribution.quantile(np.array([0.0, 1 - 2.0**-53]))
    assert np.isfinite(ends).all()
    low, high = distribution.support
    assert low <= ends[0] <= ends[1] <= high


def test_choices_and_steps_come_as_often_as_each_other():
    values = OneOf(values=(3.0, 1.0)).quantile(U)
    assert_array_equal(values, np.repeat([3.0, 1.0], 2000))
    there, counts = np.unique(Steps(low=0.0, high=1.0, count=5).quantile(U), return_counts=True)
    assert_allclose(there, [0.0, 0.25, 0.5, 0.75, 1.0])
    assert set(counts) == {800}
