"""Figures by their parts: bands, shading, panels, thinning, and the file written."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry
from printed import assert_printed, figure_text, part_of

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


@pytest.mark.parametrize("count", [1, 8, 9, 17, pytest.param(30, marks=pytest.mark.slow)])
def test_one_panel_per_drive_on_one_time_axis(count):
    drawn = panels(effort_figure(result(count, 20)))
    assert len(drawn) == count
    assert {axes.get_xlim() for axes in drawn} == {(0.0, 10.0)}


def one_stick_of_a_sample():
    alone = result(1, 6)  # samples at 0, 2, 4, 6, 8, 10 s
    alone.sticking[3] = False
    alone.effort_lower[3] = alone.effort_upper[3] = 2.0
    return alone


def short_sticks():
    moving = result(1, 1001)  # every 0.01 s; at rest from 4 to 6 s
    moving.sticking[402:600] = False  # of that rest two samples are left, and one
    moving.reversal[800] = moving.reversal[801] = True
    return moving


def rounded():
    moving = result()
    moving.effort_frictionless[:] = 1e-12
    return moving


@pytest.mark.parametrize(
    "moving",
    [
        lambda: result(payload_phase=True),
        lambda: result(friction=None),
        one_stick_of_a_sample,
        short_sticks,
        rounded,
    ],
    ids=["phase", "frictionless", "one_sample", "short_sticks", "rounded"],
)
def test_what_is_drawn(moving, request):
    """3 N m hold joint 0 from 4 to 6 s, else friction takes 2 N m; a payload from 2.1 to 7 s."""
    figure = effort_figure(moving(), "motion.csv")
    name = request.node.callspec.id
    assert_printed(__file__, f"efforts_{name}", figure_text(figure))
    first = panels(figure)[0]
    assert first.get_ylim()[1] > 1.0  # rounding is not blown up to a curve
    if name == "phase":
        for over in ("interval", "sliding"):
            assert part_of(first, "frictionless").get_zorder() < part_of(first, over).get_zorder()


def test_noise_about_rest_makes_no_more_ticks_than_can_be_told_apart():
    noisy = result(1, 100_001)
    noisy.reversal[::2] = True
    (axes,) = panels(effort_figure(noisy))
    ticks = part_of(axes, "passages").get_xdata()
    assert 150 < len(ticks) <= 500
    assert max(np.diff(ticks)[np.diff(ticks) < 1]) < 0.05


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
    line = part_of(axes, "sliding")
    assert len(line.get_xdata()) < 20_000
    assert np.nanmax(line.get_ydata()) == 123.0
    (outline,) = part_of(axes, "interval").get_paths()
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
    line = f"10 more, not drawn, need at most {digits(peaks[9])} N m"
    assert line in figure_text(figure)
    assert len(panels(effort_figure(many, joints=[many.actuator_names[7]]))) == 1
    with pytest.raises(PinfricError, match="there is no drive 'elbow'"):
        effort_figure(many, joints=["elbow"])


def test_ticks_take_little_room():
    assert [brief_ticks(x) for x in (0.0, 0.25, -5.0, 2.5e-4, -1.25e-5, 1e6)] == [
        text.replace("-", "\N{MINUS SIGN}")
        for text in ("0", "0.25", "-5", "2.5e-4", "-1.25e-5", "1e6")
    ]
