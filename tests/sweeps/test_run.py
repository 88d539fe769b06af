"""Sweeps against closed forms and against single runs."""

import numpy as np
import pytest
import yaml
from builders import example
from numpy.testing import assert_allclose, assert_array_equal
from sweep_cases import MASS, MU, G, pushed_block, run, steady, steps, sweep_of, uniform

import pinfric as pf
from pinfric.errors import SweepError
from pinfric.sweeps.file import load_sweep

BUNDLED = "panda_pick_and_place.sweep.yaml"


def test_the_seed_decides_the_samples():
    scene = pushed_block()
    one, again, other = (
        run(scene, steady(scene), sweep_of(10, seed=seed, speed=uniform(0.5, 2.0)))
        for seed in (1, 1, 2)
    )
    assert_array_equal(one.values, again.values)
    assert_array_equal(one.figures, again.figures)
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
    assert_allclose(found.figure("peak")[::2, 0], MU * MASS * G * found.values[::2, 0])


@pytest.mark.slow
def test_samples_that_jam_are_counted_not_hidden():
    scene, motion = example("drawer")
    sweep = sweep_of(
        sampling="grid",
        friction__slide__mu={"choice": {"values": [0.5, 1.0, 2.5]}},  # jams beyond 1.5 to 1.9
    )
    with pytest.warns(pf.PinfricWarning, match="1 of 3 samples have no solution"):
        found = run(scene, motion, sweep)
    assert_array_equal(found.solved, [True, True, False])
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
    assert_array_equal(found.solved, [True, False])
    assert found.problems[0] == ""
    assert "width" in found.problems[1]
    with pytest.raises(SweepError, match=r"no sample could be computed.*width"):
        run(scene, steady(scene), sweep_of(5, mounting__roll=uniform(0.1, 0.2)))


def test_speeds_beyond_the_urdfs_limits_are_noticed():
    scene, motion = example("panda_pick_and_place", "panda_pick_and_place.csv")
    with pytest.warns(pf.PinfricWarning, match="in 1 of 2 samples a joint is faster"):
        run(scene, motion, sweep_of(sampling="grid", speed=steps(0.5, 20.0, 2)))


def test_bundled_sweep_fits_its_scene():
    scene, motion = example("panda_pick_and_place", "panda_pick_and_place.csv")
    entries, source = load_sweep("panda_pick_and_place")
    assert source.endswith(BUNDLED)
    with open(source, encoding="utf-8") as file:
        found = run(scene, motion, {**yaml.safe_load(file), "samples": 6})
    assert found.solved.all()
    assert len(found.trials) == len(entries.motors) > 0
    frame = found.to_dataframe()
    assert len(frame) == 6
    assert_array_equal(frame["panda_joint2.rms"], found.figure("rms")[:, 1])
    assert_array_equal(frame["speed"], found.values[:, -3])
