"""CSV files that would be misread: open quotes, huge cells, absurd times, velocities that lie."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain

from pinfric.errors import TrajectoryError
from pinfric.motions.joint_columns import joint_columns, limit_problems, listing, stated_range
from pinfric.motions.trajectory import Trajectory, load_trajectory
from pinfric.motions.waypoints import quintic


def scene(joint=None):
    model = chain(("a", joint or pin.JointModelRZ()))
    if joint is None:
        model.velocityLimit[:] = 9.0
        model.lowerPositionLimit[:], model.upperPositionLimit[:] = -4.0, 4.0
    return SimpleNamespace(model=model, payloads={})


def load(tmp_path, text, of=None):
    path = tmp_path / "m.csv"
    path.write_text(text, encoding="utf-8")
    return load_trajectory(path, of or scene())


def message(tmp_path, text):
    with pytest.raises(TrajectoryError) as caught:
        load(tmp_path, text)
    assert len(str(caught.value)) < 1000
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ('t,a\n0,0\n1,"0.1\n2,0.2\n3,0.3"\n', "line 3 (a quote is not closed)"),
        ('t,"a\n0,0\n1,0.1\n', "line 1 (a quote is not closed)"),
        ('t,a\n0,0\n1","0.1\n2,0.2\n', "line 3 (a quote is not closed)"),
        ('t,a\n0,0\n1,"0.1"2\n', "line 3 ("),
    ],
)
def test_open_quote_does_not_swallow_the_next_line(tmp_path, text, where):
    assert f"cannot be split at its commas: {where}" in message(tmp_path, text)


def test_closed_quotes_are_fine(tmp_path):
    motion = load(tmp_path, '"t","a"\n"0","0.5"\n"1","0.5"\n')
    np.testing.assert_array_equal(motion.q[:, 0], 0.5)


def test_cells_no_reader_takes(tmp_path):
    cell = "x" * 140_000
    assert "line 1 (field larger than field limit" in message(tmp_path, f"t,{cell}\n0,0\n")
    assert "line 3 (field larger than field limit" in message(tmp_path, f"t,a\n0,0\n1,{cell}\n")
    assert "no column is a joint" in message(tmp_path, f"t;{cell[:100_000]}\n0;0\n")
    (said,) = load(tmp_path, f"t,a,{cell[:100_000]}\n0,0,0\n1,0,0\n").warnings
    assert said.startswith("columns not used: 'xxx")
    assert len(said) < 200
    assert "not a number: line 2" in message(tmp_path, f"t,a\n0,{cell[:100_000]}\n1,0\n")


@pytest.mark.parametrize("t", [(-1e308, 1e308), (0, 1e300), (1.7e12, 1.7e12 + 1)])
def test_times_that_are_no_seconds(tmp_path, t):
    rows = "\n".join(f"{x},{0.1 * i}" for i, x in enumerate(t))
    assert "times beyond 1e+10 s are refused" in message(tmp_path, f"t,a\n{rows}\n")


def test_numbers_no_spline_takes_are_a_clear_error():
    t, wheel = np.arange(30) * 1e-3, scene(pin.JointModelRX())
    wheel.model.lowerPositionLimit[:], wheel.model.upperPositionLimit[:] = -np.inf, np.inf
    q = np.where(np.arange(30) % 2, 1e308, -1e308)[:, None]
    with pytest.raises(TrajectoryError, match=r"q is beyond 1e\+18"):
        Trajectory.from_arrays(wheel, t, q)


# --- velocities beside positions ------------------------------------------------------------------


def swing(samples=201):
    t = np.linspace(0, 2, samples)
    b, rate, _ = quintic(t / 2)
    return t, 2 * b - 1, rate


def with_velocity(tmp_path, t, q, v, of=None, digits=12):
    rows = np.column_stack((t, np.round(q, digits), v))
    np.savetxt(tmp_path / "v.csv", rows, delimiter=",", header="t,a,a.v", comments="", fmt="%.12g")
    return [w for w in load_trajectory(tmp_path / "v.csv", of or scene()).warnings if "fit" in w]


@pytest.mark.parametrize("factor", [0.5, -1.0, 0.0, 57.3, 0.7])
def test_velocities_that_do_not_fit_the_positions_are_pointed_out(tmp_path, factor):
    t, q, v = swing()
    (warning,) = with_velocity(tmp_path, t, q, factor * v)
    assert warning.startswith("joint a: the velocities given do not fit the positions: they differ")


def test_the_warning_has_the_figures(tmp_path):
    t, q, v = swing()
    # the quintic's peak is 15/8 of its mean 1 rad/s; its RMS is sqrt(10/7), half of it is missed
    assert (
        "differ by 0.598 rad/s (RMS) at speeds up to 1.87"
        in (with_velocity(tmp_path, t, q, 0.5 * v)[0])
    )


@pytest.mark.parametrize("digits", [2, 3, 4, 12])
def test_velocities_that_fit_are_not_however_coarse_the_positions(tmp_path, digits):
    for samples in (41, 2001):
        t, q, v = swing(samples)
        assert with_velocity(tmp_path, t, q, v, digits=digits) == []
        assert with_velocity(tmp_path, t, q, 0.95 * v, digits=digits) == []


def ramp(digits):
    """1 rad/s reached in 0.25 s: at 100 Hz no position has more than four digits."""
    t = np.arange(0.0, 3.0, 0.01)
    q = np.where(t < 0.25, 2.0 * t**2, t - 0.125)
    return "t,a\n" + "".join(f"{x:.4f},{y:.{digits}f}\n" for x, y in zip(t, q, strict=True))


def test_round_numbers_of_a_constant_speed_are_not_rounding(tmp_path):
    """Eight digits of which four are zeros; what is rounded is filtered, and said so."""
    assert load(tmp_path, ramp(8)).warnings == ()
    rounded = np.round(1.3 * np.sin(2.0 * np.arange(0.0, 3.0, 0.01)), 3)
    rows = (f"{0.01 * k:.2f},{q:.8f}\n" for k, q in enumerate(rounded))
    assert load(tmp_path, "t,a\n" + "".join(rows)).warnings[0].startswith("filtered at 2.99 Hz")


def test_angles_of_a_wheel_may_wrap(tmp_path):
    t = np.linspace(0, 4, 401)
    wrapped = np.angle(np.exp(4j * t))
    wheel = scene(pin.JointModelRUBZ())
    assert with_velocity(tmp_path, t, wrapped, np.full(401, 4.0), of=wheel) == []
    assert len(with_velocity(tmp_path, t, wrapped, np.full(401, 2.0), of=wheel)) == 1


def test_few_samples_say_little_about_velocities(tmp_path):
    t, q, v = swing(19)
    assert with_velocity(tmp_path, t, q, 1.4 * v) == []
    assert len(with_velocity(tmp_path, t, q, -v)) == 1


def rows_of(t, *positions):
    names = ["a"]
    rows = [",".join(f"{x:.12g}" for x in row) for row in np.column_stack([t, *positions])]
    return "\n".join([",".join(["t", *names]), *rows, ""])


@pytest.mark.parametrize(
    "positions",
    [
        [0.0, 0.6, 0.2, 0.9, -0.3, 0.4, 0.0],
        [0.0, 0.5, 1.0],  # a straight line, and no acceleration at all
        [0.0, 1.0],
        [0.0, 0.0, 1.0, 1.0, 0.2, 0.2, 0.0, 0.0],
    ],
)
def test_rows_that_are_way_points_are_refused_with_both_choices(tmp_path, positions):
    text = message(tmp_path, rows_of(np.arange(float(len(positions))), positions))
    assert "rows are too far apart" in text
    assert f"points: [{{q: [0]}}, {{q: [{positions[1]:.4g}], duration: 1}}, ...]`" in text
    assert "give more of them, or .v and .a" in text


def test_one_odd_time_stamp_is_named_and_not_taken_for_way_points(tmp_path):
    t = 0.01 * np.arange(500)
    position = np.sin(3.0 * t)
    load(tmp_path, rows_of(t, position))
    t[200] += 0.009
    text = message(tmp_path, rows_of(t, position))
    assert "sample 200 at 2.009 s comes 0.019 s after the one before, others 0.01 s (2 such" in text
    assert "way-point" not in text
    stops = [0.0, 0.6, 0.2, 0.9, -0.3, 0.4, 0.0]  # a longer way takes longer
    text = message(tmp_path, rows_of([0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 7.0], stops))
    assert "rows are too far apart" in text


@pytest.mark.parametrize("rows", [5, 9, 19])
@pytest.mark.parametrize("uneven", [0.0, 0.15])
def test_stops_at_nearly_equal_distances_are_refused_with_both_choices(tmp_path, rows, uneven):
    steps = 0.1 * (1.0 + uneven * (-1.0) ** np.arange(rows))
    text = message(tmp_path, rows_of(0.5 * np.arange(rows), np.cumsum(steps)))
    assert f"joint a moves over {rows} rows at 0." in text
    assert "`points: [{q: [0" in text
    assert "give more of them, or .v and .a" in text


@pytest.mark.parametrize(("rows", "step"), [(20, 0.5), (200, 0.5), (5, 0.1), (19, 0.008)])
def test_recordings_in_the_middle_of_a_motion_are_read(tmp_path, rows, step):
    t = step * np.arange(rows)
    found = load(tmp_path, rows_of(t, 0.3 * t / t[-1]))
    np.testing.assert_allclose(found.v[:, 0], 0.3 / t[-1], rtol=1e-6)


@pytest.mark.parametrize("rows", [9, 12, 30])
def test_moves_of_nine_rows_and_more_are_close_to_the_motion_they_sample(tmp_path, rows):
    t = np.linspace(0.0, 1.0, rows)
    q, v, a = quintic(t)
    found = load(tmp_path, rows_of(t, q))
    assert np.abs(found.v[:, 0] - v).max() < 0.05 * np.abs(v).max()
    assert np.abs(found.a[:, 0] - a).max() < 0.2 * np.abs(a).max()


def test_few_rows_with_their_derivatives_are_fine(tmp_path):
    text = "t,a,a.v,a.a\n0,0,0,1\n1,0.5,1,1\n2,2,2,1\n"
    assert load(tmp_path, text).t.size == 3


def test_stops_with_their_velocities_are_said_not_to_fit(tmp_path):
    text = "t,a,a.v\n0,0,0\n1,0.5,0\n2,1.2,0\n3,0,0\n"
    (warning,) = load(tmp_path, text).warnings
    assert "joint a: the velocities given do not fit the positions" in warning


# Ranges of joints: what counts as a limit.


@pytest.mark.parametrize(
    ("given", "stated"),
    [
        ((0.0, 0.0), (-np.inf, np.inf)),
        ((0.2, 0.2), (0.2, 0.2)),
        ((-1.0, 0.0), (-1.0, 0.0)),
        ((-np.inf, 1.0), (-np.inf, 1.0)),
        ((-1.7e308, 1.7e308), (-np.inf, np.inf)),
    ],
)
def test_only_zero_to_zero_is_no_limit(given, stated):
    assert stated_range(*given) == stated
    model = pin.Model()
    low, high = (np.array([x]) for x in given)
    model.addJoint(
        0, pin.JointModelRZ(), pin.SE3.Identity(), "a", np.ones(1), np.ones(1), low, high
    )
    (column,) = joint_columns(model)
    assert (column.lower, column.upper) == stated


def test_a_range_of_one_position_holds_the_joint_there():
    model = pin.Model()
    at = np.array([0.2])
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "a", np.ones(1), np.ones(1), at, at)
    columns, t = joint_columns(model), np.arange(2.0)
    assert limit_problems(columns, t, np.full((2, 1), 0.2)) == []
    (problem,) = limit_problems(columns, t, np.array([[0.2], [0.3]]))
    assert "joint a: 0.3 rad is above its upper limit 0.2" in problem


def test_a_long_listing_names_ten_and_says_how_many_there_are():
    assert listing(range(10)) == "0, 1, 2, 3, 4, 5, 6, 7, 8, 9"
    assert listing(range(11)) == "0, 1, 2, 3, 4, 5, 6, 7, 8, 9, ... (11 in all)"
