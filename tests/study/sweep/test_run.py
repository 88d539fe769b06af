"""Sweeps against closed forms, against single runs, and across interruptions."""

import dataclasses

import numpy as np
import pytest
import yaml
from sweep_cases import BOX, MASS, MU, G, pushed_block, steady, steps, sweep_of, uniform

import pinfric as pf
from pinfric.errors import SweepError
from pinfric.study.summary import summarize
from pinfric.study.sweep.cycle import FIGURES
from pinfric.study.sweep.file import load_sweep

BUNDLED = "panda_pick_and_place.sweep.yaml"


def run(scene, motion, sweep, **more):
    return pf.sweep(scene, motion, sweep, processes=1, **more)


def test_effort_follows_friction_and_payload_as_worked_by_hand():
    scene = pushed_block(payloads={"box": BOX})
    found = run(
        scene,
        steady(scene),
        sweep_of(friction__all__mu=uniform(0.5, 1.5), payload__box__mass=uniform(0.5, 4.0)),
    )
    factor, box = found.values.T
    effort = factor * MU * (MASS + box) * G
    np.testing.assert_allclose(found.figure("peak")[:, 0], effort, rtol=1e-12)
    np.testing.assert_allclose(found.figure("rms")[:, 0], effort, rtol=1e-12)
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
    np.testing.assert_allclose(found.figure("peak")[:, 0], effort, rtol=1e-12)
    np.testing.assert_allclose(found.figure("speed")[:, 0], 1.3 * speed, rtol=1e-12)
    assert np.ptp(roll) > 0.1


def test_samples_are_single_runs_of_the_changed_scene():
    scene = pf.load_scene("panda_pick_and_place")
    motion = pf.load_trajectory("panda_pick_and_place.csv", scene)
    found = run(
        scene,
        motion,
        sweep_of(
            3,
            friction__panda_joint2__viscous=uniform(0.0, 3.0),
            **{
                "friction.panda_joint[45].coulomb": uniform(0.5, 2.0, each=True),
                "transmission.*.no_load_torque": uniform(0.5, 2.0),
                "payload.box.com.z": uniform(0.0, 0.2),
                "payload.box.mass": uniform(1.0, 3.0),
            },
            speed=uniform(0.5, 1.0),
            mounting__roll=uniform(0.5, 1.0),
            mounting__pitch=uniform(-1.0, -0.5),
        ),
    )
    assert found.parameter_names == (
        "friction.panda_joint2.viscous",
        "friction.panda_joint4.coulomb",
        "friction.panda_joint5.coulomb",
        "transmission.*.no_load_torque",
        "payload.box.com.z",
        "payload.box.mass",
        "speed",
        "mounting.roll",
        "mounting.pitch",
    )
    for values, figures in zip(found.values, found.figures, strict=True):
        friction = {
            name: entry.model_dump(exclude_none=True, exclude_unset=True)
            for name, entry in scene.friction.items()
        }
        friction["panda_joint2"]["viscous"]["coefficient"] *= values[0]
        for name, factor in (("panda_joint4", values[1]), ("panda_joint5", values[2])):
            for key in ("static", "kinetic"):
                friction[name]["coulomb"][key] *= factor
        actuators = [a.model_dump(exclude_none=True) for a in scene.actuators]
        for actuator in actuators:
            for key in ("static", "kinetic"):
                actuator["transmission"]["no_load_torque"][key] *= values[3]
        box = scene.payloads["box"].model_dump()
        box["com"] = (0.0, 0.0, values[4])
        box["inertia"] = [x * values[5] / box["mass"] for x in box["inertia"]]
        box["mass"] = values[5]
        roll, pitch = values[7:]
        turned = scene.model.copy()
        down = [np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)]
        turned.gravity.linear = 9.81 * np.array(down)  # in the axes of the turned base
        changed = dataclasses.replace(
            scene, model=turned, friction=friction, actuators=actuators, payloads={"box": box}
        )
        scaled = motion.with_speed(values[6])
        for row, s in zip(
            figures, summarize(pf.inverse_dynamics(changed, scaled, threads=1)), strict=True
        ):
            by_name = dict(zip(FIGURES, row, strict=True))
            for name in ("peak", "rms", "motor_peak", "motor_rms"):
                assert by_name[name] == pytest.approx(getattr(s, name), rel=1e-12), name
    np.testing.assert_allclose(
        found.figure("speed"), np.abs(motion.v).max(axis=0) * found.values[:, [6]], rtol=1e-12
    )


def test_the_seed_decides_the_samples():
    scene = pushed_block()
    one, again, other = (
        run(scene, steady(scene), sweep_of(10, seed=seed, speed=uniform(0.5, 2.0)))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.values, again.values)
    np.testing.assert_array_equal(one.figures, again.figures)
    assert (one.values != other.values).all()


def test_grid_has_every_combination_once():
    scene = pushed_block()
    found = run(
        scene,
        steady(scene),
        sweep_of(
            sampling="grid",
            friction__all__mu=steps(0.5, 1.5, 3),
            mounting__pitch={"choice": {"values": [0.0, 0.1]}},
        ),
    )
    assert [tuple(v) for v in found.values] == [(f, p) for f in (0.5, 1.0, 1.5) for p in (0.0, 0.1)]
    np.testing.assert_allclose(found.figure("peak")[::2, 0], MU * MASS * G * found.values[::2, 0])


def test_percentiles_and_odds_are_those_of_the_distribution():
    scene = pushed_block()
    rating = 1.2 * MU * MASS * G  # a factor up to 1.2 of 0.5 to 1.5: 70 %
    motors = {"slide": {"continuous_torque": rating, "max_speed": 1.0}}
    found = run(
        scene, steady(scene), sweep_of(2000, motors=motors, friction__all__mu=uniform(0.5, 1.5))
    )
    expected = (0.5 + np.array([5, 50, 95, 99]) / 100) * MU * MASS * G
    np.testing.assert_allclose(found.quantiles("peak")[:, 0], expected, rtol=0.05)
    (trial,) = found.trials
    odds = found.probability(found.sufficing(trial))
    assert odds.value == pytest.approx(0.7, abs=0.035)
    assert odds.low < odds.value < odds.high
    assert odds.high - odds.low == pytest.approx(2 * 1.96 * np.sqrt(0.21 / 2000), rel=0.01)
    assert trial.not_checked(found) == ("peak torque",)
    assert trial.passes(found)["motor speed"].all()


def test_reserve_and_speed_count():
    scene = pushed_block()
    effort = MU * MASS * G
    for motor, suffices in (
        ({"peak_torque": 1.21 * effort}, True),
        ({"peak_torque": 1.19 * effort}, False),  # a reserve of 1.2, as `size` has it
        ({"max_speed": 0.4}, False),
        ({"continuous_torque": 1.1 * effort, "max_speed": 0.6}, True),
    ):
        sweep = sweep_of(motors={"slide": motor}, sampling="grid", friction__all__mu=steps(1, 2, 2))
        assert run(scene, steady(scene), sweep).sufficing()[0] == suffices, motor
    less = {
        **sweep_of(
            motors={"slide": {"peak_torque": 1.19 * effort}},
            sampling="grid",
            friction__all__mu=steps(1, 2, 2),
        ),
        "conditions": {"peak_factor": 1.1},
    }
    assert run(scene, steady(scene), less).sufficing()[0]


def test_correlation_names_what_drives_the_effort():
    scene = pushed_block(payloads={"box": BOX})
    found = run(
        scene,
        steady(scene),
        sweep_of(
            400,
            friction__all__mu=uniform(0.5, 1.5),
            payload__box__mass=uniform(0.9, 1.1),
            speed=uniform(1.0, 2.0),
            mounting__roll={"choice": {"values": [0.0]}},
        ),
    )
    friction, box, speed, roll = found.rank_correlation("peak")[:, 0]
    assert friction > 0.98
    assert abs(speed) < 1.5 * found.correlation_noise  # a steady push does not depend on it
    assert abs(box) < 0.2
    assert np.isnan(roll)
    assert found.rank_correlation("speed")[2, 0] == pytest.approx(1.0)


def test_sobol_shares_of_a_product_are_the_analytic_ones():
    # u = f mu (m + b) g with independent f, b: V = E(f^2) E(w^2) - E(f)^2 E(w)^2, w = m + b
    scene = pushed_block(payloads={"box": BOX})
    found = run(
        scene,
        steady(scene),
        sweep_of(
            512,
            "sobol",
            friction__all__mu=uniform(0.2, 1.8),
            payload__box__mass=uniform(0.5, 6.5),
            speed=uniform(1.0, 2.0),
        ),
    )
    assert found.samples == 512 * 5
    var_f, var_w, mean_f, mean_w = 1.6**2 / 12, 3.0, 1.0, MASS + 3.5
    total = var_f * var_w + var_f * mean_w**2 + var_w * mean_f**2
    first = np.array([var_f * mean_w**2, var_w * mean_f**2, 0.0]) / total
    both = var_f * var_w / total
    (shares,) = found.sobol("rms")
    np.testing.assert_allclose(shares.first, first, atol=0.008)
    np.testing.assert_allclose(shares.total, np.add(first, [both, both, 0.0]), atol=0.008)
    for low, value, high in (
        (shares.first_low, shares.first, shares.first_high),
        (shares.total_low, shares.total, shares.total_high),
    ):
        assert (low <= value).all()
        assert (value <= high).all()
    assert np.isnan(
        run(scene, steady(scene), sweep_of(4, "sobol", speed=uniform(1.0, 2.0)))
        .sobol("rms")[0]
        .first
    ).all()


def test_samples_that_jam_are_counted_not_hidden():
    scene = pf.load_scene("drawer")
    motion = pf.load_trajectory("drawer", scene)
    sweep = sweep_of(
        sampling="grid",
        motors={"push": {"peak_torque": 1e6}},
        friction__slide__mu={"choice": {"values": [0.5, 1.0, 2.5]}},  # jams beyond 1.5 to 1.9
    )
    with pytest.warns(pf.PinfricWarning, match="1 of 3 samples have no solution"):
        found = run(scene, motion, sweep)
    np.testing.assert_array_equal(found.solved, [True, True, False])
    np.testing.assert_array_equal(found.sufficing(), [True, True, False])
    assert found.unsolved[2] > 0
    assert np.isfinite(found.quantiles("peak")).all()


def test_sample_that_is_refused_says_why():
    # level, no moment acts about the guide's axis; rolled, one does, and it has no width
    model = pushed_block().model.copy()
    model.inertias[1].lever = np.array([0.0, 0.0, 0.1])
    guide = {"bearing": {"kind": "guide", "length": 0.2}, "mu": {"static": 0.1, "kinetic": 0.1}}
    scene = pf.Scene(model=model, friction={"slide": guide})
    sweep = sweep_of(sampling="grid", mounting__roll={"choice": {"values": [0.0, 0.1]}})
    with pytest.warns(pf.PinfricWarning, match="give `width`"):
        found = run(scene, steady(scene), sweep)
    np.testing.assert_array_equal(found.solved, [True, False])
    assert found.problems[0] == ""
    assert "width" in found.problems[1]
    with pytest.raises(SweepError, match=r"no sample could be computed.*width"):
        run(scene, steady(scene), sweep_of(5, mounting__roll=uniform(0.1, 0.2)))


def test_speeds_beyond_the_urdfs_limits_are_noticed():
    scene = pf.load_scene("panda_pick_and_place")
    motion = pf.load_trajectory("panda_pick_and_place.csv", scene)
    with pytest.warns(pf.PinfricWarning, match="in 1 of 2 samples a joint is faster"):
        run(scene, motion, sweep_of(sampling="grid", speed=steps(0.5, 20.0, 2)))


def test_named_drive_brings_its_gear_and_a_named_motor_its_ratings(tmp_path):
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
    assert trial.ratio == GEAR["ratio"]
    assert trial.continuous_torque == MOTOR["continuous_torque"]
    chosen = dataclasses.replace(
        scene, actuators=[{"joint": name, "transmission": drive.transmission.model_dump()}]
    )
    expected = summarize(pf.inverse_dynamics(chosen, motion))[0].motor_peak
    assert geared.figure("motor_peak")[0, 0] == pytest.approx(expected, rel=1e-12)
    bare = run(
        scene,
        motion,
        {
            **sweep_of(sampling="grid", motors={name: {"motor": "M", "max_speed": 0.5}}, **varied),
            "catalog": catalog,
        },
    )
    assert bare.trials[0].peak_torque == MOTOR["peak_torque"]
    assert bare.figure("motor_peak")[0, 0] == bare.figure("peak")[0, 0]
    assert not bare.sufficing().any()  # 1 rad/s is beyond what the sweep says


def test_bundled_sweep_fits_its_scene():
    scene = pf.load_scene("panda_pick_and_place")
    motion = pf.load_trajectory("panda_pick_and_place.csv", scene)
    entries, source = load_sweep("panda_pick_and_place")
    assert source.endswith(BUNDLED)
    with open(source, encoding="utf-8") as file:
        found = run(scene, motion, {**yaml.safe_load(file), "samples": 30})
    assert found.solved.all()
    assert len(found.trials) == len(entries.motors) > 0
    frame = found.to_dataframe()
    assert len(frame) == 30
    np.testing.assert_array_equal(frame["panda_joint2.rms"], found.figure("rms")[:, 1])
    np.testing.assert_array_equal(frame["speed"], found.values[:, -3])


class Stopped(Exception):  # noqa: N818 - a person who stops it, no error
    pass


def stop_after(count):
    calls = []

    def progress(done, total):
        calls.append(done)
        if len(calls) > count:
            raise Stopped

    return progress


def test_interrupted_sweep_goes_on_from_what_is_on_disk(tmp_path):
    pytest.importorskip("pyarrow")
    scene = pushed_block()
    sweep = sweep_of(600, speed=uniform(0.5, 2.0), friction__all__mu=uniform(0.5, 2.0))
    whole = run(scene, steady(scene), sweep)
    with pytest.raises(Stopped):
        run(scene, steady(scene), sweep, out=tmp_path, progress=stop_after(2))
    batches = sorted((tmp_path / "batches").glob("*.parquet"))
    assert len(batches) == 2
    before = [batch.stat().st_mtime_ns for batch in batches]
    (tmp_path / "batches" / ".half.parquet.part").write_bytes(b"half a batch")
    done = []
    with pytest.raises(Stopped):  # and once more
        run(scene, steady(scene), sweep, out=tmp_path, progress=stop_after(1))
    assert [batch.stat().st_mtime_ns for batch in batches] == before  # not computed again
    resumed = run(
        scene, steady(scene), sweep, out=tmp_path, progress=lambda now, total: done.append(now)
    )
    assert resumed.resumed == done[0] > 0
    assert done == sorted(done)
    assert done[-1] == 600
    np.testing.assert_array_equal(resumed.figures, whole.figures)
    assert [path.name for path in tmp_path.iterdir()] == ["samples.parquet"]
    finished = run(scene, steady(scene), sweep, out=tmp_path)
    assert finished.resumed == 600
    np.testing.assert_array_equal(finished.figures, whole.figures)


def test_folder_of_another_sweep_is_refused(tmp_path):
    pytest.importorskip("pyarrow")
    scene = pushed_block()
    sweep = sweep_of(8, speed=uniform(0.5, 2.0))
    run(scene, steady(scene), sweep, out=tmp_path)
    heavier = pushed_block(friction={"slide": {"viscous": 1.0}})
    for other, motion, given, part in (
        (scene, steady(scene), {**sweep, "seed": 4}, "sweep"),
        (scene, steady(scene, 0.6), sweep, "trajectory"),
        (heavier, steady(heavier), sweep, "scene"),
    ):
        with pytest.raises(SweepError, match=rf"another sweep \(different: {part}\)"):
            run(other, motion, given, out=tmp_path)
    (tmp_path / "samples.parquet").write_bytes(b"no parquet")
    with pytest.raises(SweepError, match=r"samples\.parquet: cannot be read"):
        run(scene, steady(scene), sweep, out=tmp_path)


def test_samples_can_be_read_by_others(tmp_path):
    pytest.importorskip("pyarrow")
    import pandas as pd

    scene = pushed_block()
    found = run(scene, steady(scene), sweep_of(8, speed=uniform(0.5, 2.0)), out=tmp_path)
    frame = pd.read_parquet(tmp_path / "samples.parquet")
    np.testing.assert_array_equal(frame["speed"], found.values[:, 0])
    np.testing.assert_array_equal(frame["slide.peak"], found.figure("peak")[:, 0])
    assert list(frame["problem"]) == [""] * 8


def test_folder_that_cannot_be_written_is_said(tmp_path):
    pytest.importorskip("pyarrow")
    (tmp_path / "file").write_text("x")
    scene = pushed_block()
    with pytest.raises(SweepError, match="cannot be written"):
        run(scene, steady(scene), sweep_of(2, speed=uniform(1, 2)), out=tmp_path / "file")
