import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example, lump
from sweep_cases import sweep_of, swept_panda, uniform

import pinfric as pf
from pinfric.show.figure.sweep import sweep_figure


@pytest.mark.slow
def test_figure_shows_what_lies_beyond_the_rating():
    panda = swept_panda("Allied Motion HT02002 + Harmonic Drive CSF-17-100")  # scarcely enough
    figure = sweep_figure(panda)
    figure.draw_without_rendering()
    axes = figure.axes
    assert len(axes) == 3 * len(panda.actuator_names)
    rms = axes[4]  # second row: panda_joint2, second column
    rating = 0.374 * ((105 - 40) / (105 - 25)) ** 0.5  # the data sheet's, at 40 °C, class A
    beyond = panda.figure("motor_rms")[:, 1] > rating
    orange = [
        bar
        for bar in rms.patches
        if bar.get_facecolor()[:3] == pytest.approx((0.902, 0.624, 0), abs=1e-2)
    ]
    assert 0 < beyond.sum() < 40
    assert sum(bar.get_height() for bar in orange) == beyond.sum()
    assert any(f"{100 * (1 - beyond.mean()):.1f} % within 0.337" in t.get_text() for t in rms.texts)
    assert any("100.0 % within 1.50" in t.get_text() for t in axes[3].texts)  # far away: not drawn
    assert axes[3].get_xlim()[1] < 2.0
    said = [f"{p:g} %" for p in panda.percentiles]  # all of them, everywhere
    spreads = [a for k, a in enumerate(axes) if k % 3 < 2]
    assert all([t.get_text() for t in a.texts if t.get_text() in said] == said for a in spreads)


@pytest.mark.slow
def test_figure_survives_samples_without_solution():
    scene, motion = example("drawer")
    with pytest.warns(pf.PinfricWarning, match="no solution"):
        result = pf.sweep(
            scene,
            motion,
            sweep_of(
                sampling="grid",
                friction__slide__mu={"choice": {"values": [0.5, 1.0, 2.5]}},
            ),
            processes=1,
        )
    assert np.count_nonzero(result.solved) == 2
    figure = sweep_figure(result)
    figure.draw_without_rendering()
    assert "(1 without a solution)" in figure.get_suptitle()


@pytest.mark.slow
def test_figure_of_many_drives_has_the_largest_and_counts_the_rest():
    names = [f"slide_{i}" for i in range(20)]
    slides = ((n, pin.JointModelPX(), lump(1.0 + i, moment=0.1)) for i, n in enumerate(names))
    scene = pf.Scene(chain(*slides, beside=True), friction=dict.fromkeys(names, dry(1.0)))
    t = np.linspace(0.0, 1.0, 11)
    ones = np.ones((11, 20))
    motion = pf.Trajectory.from_arrays(scene, t, t[:, None] * ones, ones, ones)
    each = uniform(0.9, 1.1, each=True)
    found = pf.sweep(scene, motion, sweep_of(30, friction__all__coulomb=each), processes=1)
    figure = sweep_figure(found)
    labels = [axes.get_ylabel().split("\n")[0] for axes in figure.axes if axes.get_ylabel()]
    assert labels == [f"slide_{i}" for i in range(4, 20)]
    assert "4 more, not drawn, need at most" in figure.get_suptitle()
    drivers = [[text.get_text() for text in axes.get_yticklabels()] for axes in figure.axes[2::3]]
    assert [names[0] for names in drivers] == ["its coulomb"] * 16
