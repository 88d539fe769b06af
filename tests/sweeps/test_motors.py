"""Drives of a catalogue on trial in a sweep meet what `size` asks of them, sample by sample."""

import dataclasses
import pickle

import numpy as np
import pytest
from builders import example
from numpy.testing import assert_allclose, assert_array_equal
from sizing_cases import (
    GEAR,
    MOTOR,
    hour_with_a_stall,
    one_drive,
    trapezoid,
    turntable,
    write_catalog,
)
from sweep_cases import run, steps, sweep_of, uniform

import pinfric as pf
from pinfric.drives.catalog import Catalog
from pinfric.drives.catalog_file import load_catalog
from pinfric.errors import SweepError
from pinfric.model.described import in_json
from pinfric.motions.summary import summarize
from pinfric.sweeps.cycle import Study, compute
from pinfric.sweeps.file import load_sweep
from pinfric.sweeps.motors import motors_on_trial
from pinfric.sweeps.parameters import resolve
from pinfric.sweeps.summary import sweep_summary
from pinfric.terminal import as_text

TBM, CSF = "Kollmorgen TBM-6051-A", "Harmonic Drive CSG-17-100"


DRIVE = f"{TBM} + {CSF}"


@pytest.fixture(scope="module")
def panda():
    return example("panda_pick_and_place", "panda_pick_and_place.csv", masses="without_drives")


@pytest.fixture(scope="module")
def one_of_all():
    """The bundled catalogue's one drive: `size` takes it for every joint."""
    there = load_catalog()
    return Catalog("one drive", {TBM: there.motors[TBM]}, {CSF: there.gears[CSF]})


def table_sweep(tmp_path, motor=None, gear=None, **parameters):
    """A sweep of the turntable's one drive, from a catalogue with figures changed."""
    one_drive(tmp_path, motor, gear)
    motors = {"table": {"drive": "M + G"}}
    return {**sweep_of(motors=motors, **parameters), "catalog": str(tmp_path / "catalog.yaml")}


def agrees(found, row, assessment, name):
    """One sample's verdict is this assessment's."""
    trial = next(t for t in found.trials if t.drive == name)
    verdict = found.verdicts[name].loc[row]
    missing = set(verdict.index[verdict.isna()])
    failed = {c for c, mask in found.met(trial).items() if not mask[row]}
    assert failed == {c.name for c in assessment.failed}
    assert missing == {c.name for c in assessment.not_checked}
    margin = found.figure("margin")[row, trial.actuator]
    assert margin == pytest.approx(assessment.margin, rel=1e-12)
    assert found.sufficing(trial)[row] == (not assessment.failed)
    return failed


def test_what_size_rejects_does_not_suffice(panda):
    scene, motion = panda
    there, small = load_catalog(), "Harmonic Drive CSG-14-100"
    one_of_all = Catalog("one drive", {TBM: there.motors[TBM]}, {small: there.gears[small]})
    slow = {"resonance_base": 0.1}  # size takes all gears as elastic, the sweep the one on trial
    found = pf.sweep(
        scene,
        motion,
        sweep_of(
            sampling="grid",
            motors={"panda_joint2": {"drive": f"{TBM} + {small}"}},
            friction__all__coulomb={"choice": {"values": [1.0]}},
        )
        | {"conditions": slow},
        processes=1,
    )
    mass = 1.25 * (one_of_all.motors[TBM].mass + one_of_all.gears[small].mass)
    report = pf.size(
        scene,
        motion,
        one_of_all,
        on_miss="ignore",
        conditions={
            "mass_in_urdf": dict.fromkeys(scene.actuator_names, mass),  # no drive's mass at all
            **slow,
        },
    )
    (assessment,) = report.joint("panda_joint2").assessments
    failed = agrees(found, 0, assessment, "panda_joint2")
    assert {"gear repeated peak torque", "gear average torque"} <= failed
    worst = next(c for c in assessment.failed if c.name == "gear repeated peak torque")
    assert worst.required == pytest.approx(55.78, abs=0.005)
    assert worst.available == 36.0
    assert found.figure("peak")[0, 1] == pytest.approx(worst.required, rel=1e-12)
    assert found.figure("margin")[0, 0] == 1.0  # not on trial
    assert set(found.verdicts.columns.get_level_values(0)) == {"panda_joint2"}
    assert "amplifier currents" in in_json(sweep_summary(found))["motors"][0]["not_checked"]


@pytest.mark.slow
def test_masses_of_drives_and_payload_count_as_in_size(panda, one_of_all):
    scene, motion = panda
    found = pf.sweep(
        scene,
        motion,
        sweep_of(
            sampling="grid",
            motors={name: {"drive": DRIVE} for name in scene.actuator_names},
            payload__box__mass={"choice": {"values": [1.0, 3.0]}},
        )
        | {"conditions": {"life": 1_000.0, "inertia_ratio": 1e3}},
        processes=1,
    )
    failing = set()
    for row, mass in enumerate(found.values[:, 0]):
        box = scene.payloads["box"].model_dump()
        box["inertia"] = [x * mass / box["mass"] for x in box["inertia"]]
        box["mass"] = mass
        changed = dataclasses.replace(scene, payloads={"box": box})
        report = pf.size(
            changed,
            motion,
            one_of_all,
            conditions={"life": 1_000.0, "inertia_ratio": 1e3},
            on_miss="ignore",
        )
        for joint in report.joints:
            (assessment,) = joint.assessments
            failing |= agrees(found, row, assessment, joint.name)
        worst = found.figure("peak")[row]
        assert_allclose(worst, [j.demand.peak for j in report.joints], rtol=1e-12)
    assert {"gear repeated peak torque", "gear average torque"} <= failing


@pytest.mark.parametrize("own", [{}, {"bearings": {"table": "own"}}])
def test_what_bearings_carry_counts_as_in_size(tmp_path, own):
    asked, scene = own | {"life": 10_000.0}, turntable()
    motion = trapezoid(scene)
    small = {
        "kind": "crossed roller",
        "pitch_diameter": 0.05,
        "dynamic_rating": 6.0,
        "static_rating": 30.0,
        "max_axial": 12.0,
        "max_moment": 1.0,
    }
    bearings = {"own": {"source": "invented", "grade": "R", "ratings": {**small, "max_axial": 9.0}}}
    catalog = one_drive(tmp_path, gear={"bearing": small}, bearings=bearings)
    sweep = sweep_of(
        sampling="grid",
        motors={"table": {"drive": "M + G"}},
        speed={"choice": {"values": [0.8, 1.0]}},
    )
    sweep |= {"catalog": str(tmp_path / "catalog.yaml"), "conditions": asked}
    found = pf.sweep(scene, motion, sweep, processes=1)
    for row, (speed,) in enumerate(found.values):
        report = pf.size(
            scene, motion.with_speed(speed), catalog, on_miss="ignore", conditions=asked
        )
        failed = agrees(found, row, report.joints[0].assessments[0], "table")
        assert ("bearing axial force" in failed) == bool(own)
        assert "bearing life L10" in failed


def test_a_stall_within_an_hour_does_not_suffice_either(tmp_path):
    """The motor of `test_overload`, on trial: the mean over the hour would do."""
    scene, hour, drive = hour_with_a_stall()
    conditions = drive.pop("conditions")
    drive["motor"]["thermal"] = None
    sweep = table_sweep(tmp_path, **drive, sampling="grid", speed={"choice": {"values": [1.0]}})
    found = pf.sweep(scene, hour, sweep | {"conditions": conditions}, processes=1)
    (trial,) = found.trials
    failed = {name for name, mask in found.met(trial).items() if not mask[0]}
    assert failed == {"short-term torque", "overloaded standstill"}


def test_every_sample_is_judged_as_size_judges_it(tmp_path):
    scene = turntable()
    motion = trapezoid(scene)
    gear = {"repeated_peak_torque": 22.0, "rated_torque": 10.0, "average_torque": 10.0}
    motor = {"peak_torque": 0.5}
    found = pf.sweep(
        scene,
        motion,
        table_sweep(
            tmp_path,
            motor=motor,
            gear=gear,
            samples=12,
            speed=uniform(0.7, 1.6),
            friction__table__coulomb=uniform(0.5, 4.0),
        ),
        processes=1,
    )
    catalog = one_drive(tmp_path, motor, gear)
    failing, fits = set(), []
    for row, (speed, factor) in enumerate(found.values):
        pair = {key: 3.0 * factor for key in ("static", "kinetic")}
        changed = dataclasses.replace(scene, friction={"table": {"coulomb": pair}})
        report = pf.size(changed, motion.with_speed(speed), catalog, on_miss="ignore")
        (assessment,) = report.joints[0].assessments
        failing |= agrees(found, row, assessment, "table")
        fits.append(assessment.fits)
    (trial,) = found.trials
    assert 0 < np.mean(fits) < 1
    assert found.probability(found.sufficing(trial)).value == np.mean(fits)
    assert "gear repeated peak torque" in failing
    assert len(failing) > 1
    frame = found.to_dataframe()
    assert_array_equal(frame["table.suffices"], fits)
    met = frame[[f"table.{name}" for name in found.met(found.trials[0])]]
    assert "table.gear repeated peak torque" in met
    assert_array_equal(met.all(axis=1), fits)
    as_text(in_json(sweep_summary(found)))


def test_losses_that_vary_are_those_judged(tmp_path):
    scene = turntable(
        actuators=[{"joint": "table", "transmission": {"ratio": 50.0, "no_load_torque": 0.01}}]
    )
    motion = trapezoid(scene)

    def swept(peak_torque):
        return pf.sweep(
            scene,
            motion,
            table_sweep(
                tmp_path,
                motor={"continuous_torque": None, "peak_torque": peak_torque},
                gear={"no_load_running_torque": 0.02},
                sampling="grid",
                **{"transmission.table.no_load_torque": {"choice": {"values": [1.0, 3.0]}}},
            ),
            processes=1,
        )

    # 0.02 N m of the candidate's gear, not of the scene's, and three times as much
    peaks = swept(2.0).figure("motor_peak")[:, 0]
    assert np.diff(peaks)[0] == pytest.approx(2 * 0.02, rel=1e-9)
    found = swept(1.2 * float(peaks[0]) + 1e-9)
    assert_array_equal(found.met(found.trials[0])["peak torque"], [True, False])


def test_missing_figures_are_named(tmp_path):
    scene = turntable()
    motion = trapezoid(scene)
    one = {"sampling": "grid", "friction__table__coulomb": {"choice": {"values": [1.0]}}}
    found = pf.sweep(
        scene,
        motion,
        table_sweep(tmp_path, motor={"continuous_torque": 0.01}, **one)
        | {"conditions": {"life": 100.0}},
        processes=1,
    )
    (trial,) = found.trials
    assert "bearing static safety" in found.not_checked(trial)
    met = found.met(trial)
    assert "bearing static safety" not in met
    assert not met["continuous torque"][0]
    assert met["gear life L10"][0]
    assert "back-driving" not in met  # nobody asked for it
    asked = {**table_sweep(tmp_path, **one), "conditions": {"back_driving": "forbidden"}}
    found = pf.sweep(scene, motion, asked, processes=1)
    assert not found.met(found.trials[0])["back-driving"][0]


def test_conditions_that_cannot_be_are_refused(tmp_path, panda):
    scene, motion = panda
    write_catalog(tmp_path / "catalog.yaml", {"M": MOTOR}, {"G": GEAR})
    sweep = {
        **sweep_of(2, motors={"panda_joint4": {"drive": "M + G"}}, speed=uniform(0.5, 1.0)),
        "catalog": str(tmp_path / "catalog.yaml"),
    }
    for conditions, words in (
        ({"peak_factor": 0.5}, "conditions: `peak_factor`"),
        ({"collision_effort": {"panda_joint9": 1.0}}, "no drive 'panda_joint9'"),
        ({"mass_in_urdf": {"panda_joint4": 100.0}}, "is not a possible body"),
    ):
        with pytest.raises(SweepError, match=words):
            pf.sweep(scene, motion, {**sweep, "conditions": conditions}, processes=1)


def test_conditions_replace_those_of_the_catalogue_one_by_one(tmp_path):
    """30 V is above the catalogue's 24 V, not above the default of 48 V."""
    scene = turntable()
    asked = table_sweep(tmp_path, speed=uniform(0.5, 1.0))
    drive = one_drive(tmp_path, conditions={"bus_voltage": 24.0, "ambient": 31.0})
    assert drive.conditions.bus_voltage == 24.0
    higher = load_sweep(asked | {"conditions": {"bus_limit": 30.0}})[0]
    conditions = motors_on_trial(scene, higher, "x")[1][0].conditions
    assert (conditions.bus_voltage, conditions.bus_limit, conditions.ambient) == (24.0, 30.0, 31.0)
    with pytest.raises(SweepError, match="bus_limit 20 V is not above bus_voltage 24 V"):
        motors_on_trial(scene, load_sweep(asked | {"conditions": {"bus_limit": 20.0}})[0], "x")


def test_verdicts_travel(tmp_path):
    scene = turntable()
    motion = trapezoid(scene)
    sweep = table_sweep(
        tmp_path,
        gear={"repeated_peak_torque": 19.0, "rated_torque": 10.0},
        samples=6,
        friction__table__coulomb=uniform(0.5, 4.0),
    )
    found = pf.sweep(scene, motion, sweep, processes=1)
    entries, source = load_sweep(sweep)
    equipped, trials = motors_on_trial(scene, entries, source)
    study = Study(equipped, motion, resolve(scene, entries, source), trials)
    block = compute(pickle.loads(pickle.dumps(study)), found.values)
    assert_array_equal(block.figures, found.figures)
    assert 0 < found.sufficing().sum() < 6


def test_named_drive_brings_its_gear(tmp_path):
    from sizing_cases import GEAR, MOTOR, turntable, write_catalog

    scene = turntable()
    t = np.linspace(0, 1, 11)
    motion = pf.Trajectory.from_arrays(scene, t, t[:, None], np.ones((11, 1)), np.zeros((11, 1)))
    catalog = str(write_catalog(tmp_path / "catalog.yaml"))
    (name,) = scene.actuator_names
    (drive,) = (a.candidate for a in pf.size(scene, motion, catalog).joints[0].assessments)
    varied = {f"friction.{name}.coulomb": steps(1.0, 2.0, 2)}
    geared = run(
        scene,
        motion,
        {
            **sweep_of(sampling="grid", motors={name: {"drive": drive.name}}, **varied),
            "catalog": catalog,
        },
    )
    trial = geared.trials[0]
    assert trial.candidate.ratio == GEAR["ratio"]
    assert trial.continuous_torque == MOTOR["continuous_torque"]
    chosen = dataclasses.replace(
        scene, actuators=[{"joint": name, "transmission": drive.transmission.model_dump()}]
    )
    expected = summarize(pf.inverse_dynamics(chosen, motion))[0].motor_peak
    assert geared.figure("motor_peak")[0, 0] == pytest.approx(expected, rel=1e-12)
