"""Figures are looked at by their parts: bands, shading, panels, thinning, and the file written."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry

import pinfric as pf
from pinfric.errors import PinfricError
from pinfric.motions.summary import summarize
from pinfric.show.figure.efforts import brief_ticks, effort_figure, thinned
from pinfric.show.report.values import digits

DRY = dry(3.0, 2.0)


def result(n_joints=2, samples=101, friction=DRY, payload_phase=False):
    """Upright axes: joint 0 turns, and rests from 4 to 6 s; the others turn all the time."""
    links = ((f"joint_{i}", pin.JointModelRZ(), pin.Inertia.Random()) for i in range(n_joints))
    model = chain(*links)
    model.addBodyFrame("tool", n_joints, pin.SE3.Identity(), 0)
    t = np.linspace(0, 10, samples)
    v = np.ones((samples, n_joints))
    v[(t >= 4) & (t <= 6), 0] = 0.0
    scene = pf.Scene(
        model=model,
        friction={name: friction for name in list(model.names)[1:]} if friction else {},
        payloads={"box": {"link": "tool", "mass": 1.0, "com": [0.1, 0, 0]}},
        source="folder/upright.yaml",
    )
    attached = ((t > 2) & (t < 7))[:, None] if payload_phase else None
    return pf.inverse_dynamics(scene, 0 * v, v, 0 * v, t=t, attached=attached)


def panels(figure):
    """The axes of the drives, without the strip of payloads."""
    return [axes for axes in figure.axes if axes.axison]


def part(axes, name):
    (found,) = [artist for artist in axes.get_children() if artist.get_gid() == name]
    return found


def texts(figure):
    titles = [a.get_title(loc=side) for a in figure.axes for side in ("left", "right")]
    drawn = [*figure.texts, *(text for a in figure.axes for text in a.texts)]
    below = [legend.get_title() for legend in figure.legends]
    return titles + [text.get_text() for text in (*drawn, *below)]


@pytest.mark.parametrize("count", [1, 8, 9, 17, pytest.param(30, marks=pytest.mark.slow)])
def test_one_panel_per_drive_on_one_time_axis(count):
    drawn = panels(effort_figure(result(count, 20)))
    assert len(drawn) == count
    assert {axes.get_xlim() for axes in drawn} == {(0.0, 10.0)}


def test_band_and_shading_where_the_joint_sticks():
    resting, turning = panels(effort_figure(result()))
    (outline,) = part(resting, "interval").get_paths()
    assert outline.get_extents().extents == pytest.approx([4, -3, 6, 3])
    (shade,) = part(resting, "sticking").get_paths()
    assert shade.get_extents().extents == pytest.approx([4, 0, 6, 1])
    assert part(turning, "interval").get_paths() == []
    assert part(turning, "sticking").get_paths() == []


def test_sliding_line_breaks_where_the_joint_sticks_and_frictionless_goes_on():
    resting = panels(effort_figure(result()))[0]
    t, sliding = part(resting, "sliding").get_data()
    assert np.isnan(sliding[(t >= 4) & (t <= 6)]).all()
    assert sliding[(t < 4) | (t > 6)] == pytest.approx(2.0)
    frictionless = part(resting, "frictionless").get_ydata()
    assert np.isfinite(frictionless).all()
    for over in ("interval", "sliding"):
        assert part(resting, "frictionless").get_zorder() < part(resting, over).get_zorder()


def test_stick_of_one_sample_is_a_line_not_nothing():
    alone = result(1, 6)  # samples at 0, 2, 4, 6, 8, 10 s
    alone.sticking[3] = False
    alone.effort_lower[3] = alone.effort_upper[3] = 2.0
    (axes,) = panels(effort_figure(alone))
    (line,) = part(axes, "instants").get_segments()
    assert np.asarray(line) == pytest.approx(np.array([[4, -3], [4, 3]]))
    assert part(axes, "passages").get_xdata() == pytest.approx([4])
    assert part(axes, "interval").get_paths() == []


def test_reversals_and_sticks_too_short_to_see_are_ticked_each_once():
    moving = result(1, 1001)  # every 0.01 s; at rest from 4 to 6 s
    moving.sticking[402:600] = False  # of that rest two samples are left, and one
    moving.reversal[800] = moving.reversal[801] = True
    (axes,) = panels(effort_figure(moving))
    assert part(axes, "passages").get_xdata() == pytest.approx([4, 6, 8])


def test_noise_about_rest_makes_no_more_ticks_than_can_be_told_apart():
    noisy = result(1, 100_001)
    noisy.reversal[::2] = True
    (axes,) = panels(effort_figure(noisy))
    ticks = part(axes, "passages").get_xdata()
    assert 150 < len(ticks) <= 500
    assert max(np.diff(ticks)[np.diff(ticks) < 1]) < 0.05


def test_payload_phase_is_named_and_marked_in_every_panel():
    figure = effort_figure(result(payload_phase=True))
    assert any("box" in text for text in texts(figure))
    (strip,) = [axes for axes in figure.axes if not axes.axison]
    (bar,) = part(strip, "carried").get_paths()
    assert bar.get_extents().x0 == pytest.approx(2.1)
    assert bar.get_extents().x1 == pytest.approx(7.0)
    whole_way = effort_figure(result())
    assert len(whole_way.axes) == 2
    assert any("carries box all the way" in text for text in texts(whole_way))


def test_title_names_scene_and_trajectory_and_labels_name_drives_and_units():
    found = texts(effort_figure(result(), "motion.csv"))
    assert "upright · motion.csv" in found
    assert "joint_0" in found
    assert any("peak 3.00" in text and text.endswith("N m") for text in found)
    assert any("RMS 1.78–2.25   RMS without friction 0  N m" in text for text in found)  # noqa: RUF001


def test_rounding_is_labelled_as_zero():
    rounded = result()
    rounded.effort_frictionless[:] = 1e-12
    assert any("RMS without friction 0  N m" in text for text in texts(effort_figure(rounded)))


def test_key_names_only_what_is_there():
    def key(figure):
        return [text.get_text() for text in figure.legends[0].get_texts()]

    plain = key(effort_figure(result(friction=None)))
    assert not any("sticks" in text or "friction" in text for text in plain)
    assert sum("sticks" in text for text in key(effort_figure(result()))) == 1
    assert "passes through rest" not in key(effort_figure(result()))
    passing = result()
    passing.reversal[20, 0] = True
    assert "passes through rest" in key(effort_figure(passing))


def test_effort_that_is_rounding_is_not_blown_up_to_a_curve():
    figure = effort_figure(result(friction=None))
    assert panels(figure)[0].get_ylim()[1] > 1.0


@pytest.mark.parametrize("count", [1, 2, 10, 79, 4001, 100_003])
def test_thinning_keeps_every_piece_and_its_extremes(count):
    x = np.random.default_rng(count).normal(size=count)
    pieces = 50
    kept = thinned([x, -x], pieces)
    assert (np.diff(kept) > 0).all()
    assert kept[0] == 0
    assert kept[-1] == count - 1
    assert len(kept) <= 6 * pieces + 2
    size = -(-count // pieces)
    for start in range(0, count, size):
        part_of, all_of = x[kept[(kept >= start) & (kept < start + size)]], x[start : start + size]
        assert (part_of.min(), part_of.max()) == (all_of.min(), all_of.max())


@pytest.mark.parametrize("missing", [[5001], [5000, 5001, 5002, 5004], range(4990, 5003)])
def test_thinning_keeps_a_peak_beside_what_is_missing_and_the_gap(missing):
    x = np.zeros(10_000)
    x[5003], x[5005] = 100.0, -50.0
    x[list(missing)] = np.nan
    drawn = x[thinned([x], 100)]
    assert (np.nanmax(drawn), np.nanmin(drawn)) == (100.0, -50.0)
    assert np.isnan(drawn).any()


def test_long_motion_is_thinned_but_its_spike_and_its_stick_are_drawn():
    long = result(1, 100_001)
    long.effort_lower[77_777] = long.effort_upper[77_777] = 123.0
    (axes,) = panels(effort_figure(long))
    line = part(axes, "sliding")
    assert len(line.get_xdata()) < 20_000
    assert np.nanmax(line.get_ydata()) == 123.0
    (outline,) = part(axes, "interval").get_paths()
    assert outline.get_extents().extents == pytest.approx([4, -3, 6, 3])


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_few_samples_can_be_drawn(samples, tmp_path):
    effort_figure(result(2, samples)).savefig(tmp_path / "few.png")
    assert (tmp_path / "few.png").stat().st_size > 5000


def test_written_image_has_the_colours_it_should_have(tmp_path):
    from matplotlib.image import imread

    path = tmp_path / "effort.png"
    effort_figure(result()).savefig(path)
    pixels = (imread(path)[..., :3] * 255).round().astype(int)
    blue, band = np.array([0x00, 0x72, 0xB2]), np.array([0xA9, 0xCF, 0xE8])
    for colour, at_least in ((blue, 1000), (band, 10_000)):
        assert (np.abs(pixels - colour).max(axis=2) < 3).sum() > at_least


@pytest.mark.slow
def test_of_more_than_30_drives_those_with_the_largest_efforts_are_drawn():
    many = result(40, 20)
    figure = effort_figure(many)
    assert len(panels(figure)) == 30
    assert figure.get_size_inches()[1] * figure.dpi < 2500
    peaks = sorted(summary.peak for summary in summarize(many))
    (line,) = [text for text in texts(figure) if "not drawn" in text]
    assert f"10 more, not drawn, need at most {digits(peaks[9])} N m" in line
    assert len(panels(effort_figure(many, drives=[many.actuator_names[7]]))) == 1
    with pytest.raises(PinfricError, match="there is no drive 'elbow'"):
        effort_figure(many, drives=["elbow"])


def test_ticks_take_little_room():
    assert [brief_ticks(x) for x in (0.0, 0.25, -5.0, 2.5e-4, -1.25e-5, 1e6)] == [
        text.replace("-", "\N{MINUS SIGN}")
        for text in ("0", "0.25", "-5", "2.5e-4", "-1.25e-5", "1e6")
    ]
