"""Percentiles, odds and influences against analytic ones."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import spearmanr
from sweep_cases import BOX, MASS, MU, G, pushed_block, run, steady, sweep_of, uniform


def test_percentiles_and_odds_are_those_of_the_distribution():
    scene = pushed_block()
    found = run(scene, steady(scene), sweep_of(2000, friction__all__mu=uniform(0.5, 1.5)))
    expected = (0.5 + np.array([5, 50, 95, 99]) / 100) * MU * MASS * G
    assert_allclose(found.quantiles("peak")[:, 0], expected, rtol=0.05)
    # a factor up to 1.2 of 0.5 to 1.5: 70 %
    odds = found.probability(found.figure("peak")[:, 0] <= 1.2 * MU * MASS * G)
    assert odds.value == pytest.approx(0.7, abs=0.035)
    assert odds.low < odds.value < odds.high
    assert odds.high - odds.low == pytest.approx(2 * 1.96 * np.sqrt(0.21 / 2000), rel=0.01)


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


def test_what_is_computed_column_by_column_is_that_of_the_whole(tmp_path, monkeypatch):
    """Of samples with ties and one without a solution: SciPy, NumPy and pandas on whole tables."""
    scene = pushed_block()
    varied = {"friction__all__mu": uniform(0.5, 1.5), "speed": {"choice": {"values": [1.0, 2.0]}}}
    found = run(scene, steady(scene), sweep_of(40, **varied))
    figures = found.figures.copy()
    figures[7], problems = np.nan, tuple("it jams, so" * (k == 7) for k in range(40))
    lost = replace(found, figures=figures, problems=problems)
    told = []
    for one in found, lost:
        peak, there = one.figure("peak"), np.isfinite(one.figure("peak")[:, 0])
        assert_allclose(one.quantiles("peak"), np.percentile(peak[there], one.percentiles, axis=0))
        for row, values in zip(one.rank_correlation("peak"), one.values.T, strict=True):
            expected = spearmanr(values[there], peak[there, 0]).statistic
            assert row == pytest.approx(expected, abs=1e-12)
        monkeypatch.setattr("pinfric.sweeps.result._ROWS", 16)
        one.write_csv(tmp_path / "samples.csv", lambda *step: told.append(step))
        assert (tmp_path / "samples.csv").read_text() == one.to_dataframe().to_csv(index=False)
    assert told == 2 * [(16, 40), (32, 40), (40, 40)]


def test_sobol_shares_of_a_product_are_the_analytic_ones():
    # u = f mu (m + b) g with independent f, b: V = E(f^2) E(w^2) - E(f)^2 E(w)^2, w = m + b
    scene = pushed_block(payloads={"box": BOX})
    varied = {
        "friction__all__mu": uniform(0.2, 1.8),
        "payload__box__mass": uniform(0.5, 6.5),
        "speed": uniform(1.0, 2.0),
    }
    found = run(scene, steady(scene), sweep_of(512, "sobol", **varied))
    assert found.samples == 512 * 5
    var_f, var_w, mean_f, mean_w = 1.6**2 / 12, 3.0, 1.0, MASS + 3.5
    total = var_f * var_w + var_f * mean_w**2 + var_w * mean_f**2
    first = np.array([var_f * mean_w**2, var_w * mean_f**2, 0.0]) / total
    both = var_f * var_w / total
    (shares,) = found.sobol("rms")
    assert_allclose(shares.first, first, atol=0.008)
    assert_allclose(shares.total, np.add(first, [both, both, 0.0]), atol=0.008)
    for low, value, high in (
        (shares.first_low, shares.first, shares.first_high),
        (shares.total_low, shares.total, shares.total_high),
    ):
        assert (low <= value).all()
        assert (value <= high).all()
    assert np.array_equal(found.sobol("rms")[0].first_low, shares.first_low)
    assert np.isnan(
        run(scene, steady(scene), sweep_of(4, "sobol", speed=uniform(1.0, 2.0)))
        .sobol("rms")[0]
        .first
    ).all()
