"""Files of samples: columns, derivatives, holds, and every kind of bad file in one message."""

import re

import numpy as np
import pytest
from builders import pick_and_place
from log_cases import NAMES, Q, T, load, write_csv
from numpy.testing import assert_allclose, assert_array_equal
from trajectory_cases import arm_scene, message, one_joint_scene, write

from pinfric.errors import TrajectoryError
from pinfric.motions.log.reading import ReadingOptions
from pinfric.motions.trajectory import load_trajectory


def test_csv_without_derivatives(tmp_path):
    t = np.linspace(0, 2, 201)
    rows = np.column_stack((np.sin(t), 0.25 + 0.1 * np.cos(t), 3 * t))
    path = write_csv(tmp_path / "m.csv", t, (" a", " b", " c"), rows, "%.15g")
    motion = load_trajectory(path, arm_scene())
    assert motion.q.shape == (201, 4)
    assert_allclose(motion.q[:, 2], np.cos(3 * t), atol=1e-14)
    assert_allclose(motion.q[:, 3], np.sin(3 * t), atol=1e-14)
    assert_allclose(motion.v[:, 0], np.cos(t), atol=1e-9)
    assert_allclose(motion.v[:, 2], 3.0, atol=1e-9)
    assert_allclose(motion.a[:, 1], -0.1 * np.cos(t), atol=1e-6)
    assert_allclose(motion.joint_positions()[:, 2], 3 * t, atol=1e-14)
    assert motion.joint_nq == (1, 1, 2)


def test_csv_column_order_comments_blank_lines_and_bom(tmp_path):
    path = write(tmp_path, "m.csv", "\ufeff# a comment\nc,b,t,a\n\n0,0.1,0,1\n# more\n0,0.1,1,1\n")
    motion = load_trajectory(path, arm_scene())
    assert_array_equal(motion.t, [0, 1])
    assert_array_equal(motion.q, [[1, 0.1, 1, 0]] * 2)


def test_given_derivatives_are_kept(tmp_path):
    path = write(tmp_path, "m.csv", "t,a,a.v,a.a\n0,0,5,7\n1,0,6,8\n2,1,-1,9\n")
    motion = load_trajectory(path, one_joint_scene())
    assert_array_equal(motion.v[:, 0], [5, 6, -1])
    assert_array_equal(motion.a[:, 0], [7, 8, 9])
    assert motion.warnings == (
        "joint a: reaches 6 rad/s, above its velocity limit 1.5 (first at t = 0 s; "
        "samples beyond it: 2)",
    )


def test_acceleration_from_given_velocity_and_velocity_beside_given_acceleration(tmp_path):
    t = np.linspace(0, 1, 101)
    for column, values in (("a.v", np.cos(t)), ("a.a", np.full(101, 4.0))):
        rows = np.column_stack((np.sin(t), values))
        path = write_csv(tmp_path / "m.csv", t, ("a", column), rows, "%.15g")
        motion = load_trajectory(path, one_joint_scene())
        assert_allclose(motion.v[:, 0], np.cos(t), atol=1e-8)
        expected = -np.sin(t) if column == "a.v" else np.full(101, 4.0)
        assert_allclose(motion.a[:, 0], expected, atol=1e-8)


def test_csv_holds_are_exactly_still(tmp_path):
    t, q, v, _ = pick_and_place(17)
    path = write_csv(tmp_path / "m.csv", t, ["a"], q, "%.6f")
    motion = load_trajectory(path, one_joint_scene())
    assert len(motion.holds()) == 3
    for hold, start, end in zip(motion.holds(), (0, 2, 3.5), (1, 2.5, 4), strict=True):
        assert hold.start == pytest.approx(start, abs=0.01)
        assert hold.end == pytest.approx(end, abs=0.01)
    assert_allclose(motion.v[:, 0], v, atol=2e-3)


def test_coarse_positions_are_filtered_or_pointed_out(tmp_path):
    t, q, _, true = pick_and_place(17)
    scene, path = one_joint_scene(), tmp_path / "m.csv"
    for digits in (4, 9):
        write_csv(path, t, ["a"], q, f"%.{digits}f")
        motion = load_trajectory(path, scene)
        noisy = [w for w in motion.warnings if "noise" in w]
        assert [re.sub(r"at [\d.]+ Hz", "at x Hz", w) for w in noisy] == (
            [] if digits == 9 else ["filtered at x Hz, noise 2.9e-05 rad"]
        )
        assert np.abs(motion.a).max() == pytest.approx(np.abs(true).max(), rel=0.01)
        if digits == 4:
            plain = load_trajectory(path, scene, ReadingOptions(cutoff="none")).warnings[0]
            assert plain.startswith(
                "not filtered, noise 2.9e-05 rad, error left in accelerations 1.4e+02"
            )


def test_a_joint_that_stands_still_has_no_noise_to_warn_of(tmp_path):
    path = tmp_path / "still.csv"
    path.write_text("t,a\n" + "\n".join(f"{0.001 * i:.3f},0.123" for i in range(200)))
    motion = load_trajectory(path, one_joint_scene())
    assert motion.warnings == ()
    assert not motion.a.any()


def test_csv_payload_columns_and_defaults(tmp_path):
    path = write(tmp_path, "m.csv", "t,a,payload.box\n0,0,0\n1,0,1\n2,0,1\n3,0,0\n")
    motion = load_trajectory(path, one_joint_scene(tool=True, box=True))
    assert_array_equal(motion.attached, [[1, 0], [1, 1], [1, 1], [1, 0]])


def test_all_problems_of_a_csv_in_one_error(tmp_path, monkeypatch):
    monkeypatch.setattr("pinfric.errors._MOST_PROBLEMS", 99)
    path = write(
        tmp_path,
        "m.csv",
        "\n".join(
            [
                "t,a,bb,c,payload.bax,a.w,c",
                "0,0,0,0,0,0,0",
                "1,nan,0,0,0,0,0",
                "1,3.5,0,0,0,0,0",
                "2,-4,0,0,0,0",
                "3,inf,0,oops,0,0,0",
                "2.5,-2.5,0,,0,0,0",
            ]
        ),
    )
    text = message(path, arm_scene(box=True))
    for part in (
        "unknown payload in column 'payload.bax'",
        "column 'c' occurs 2 times",
        "joints without a column: b (columns not used: 'bb', 'a.w')",
        "the header has 7 columns; rows with another number of cells: line 5 (6)",
        "not a number: line 6, column c: 'oops', line 7, column c: ''",
        "column a: nan at sample 1 (line 3), inf at sample 3 (line 6)",
        "time must increase; it does not at line 4 (t = 1 after 1), line 7 (t = 2.5 after 3)",
        "joint a: 3.5 rad is above its upper limit 2 (first at t = 1 s",
        "joint a: -2.5 rad is below its lower limit -2 (first at t = 2.5 s",
    ):
        assert part in text, part
    assert ": 9 problems:" in text


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "is empty"),
        ("# only a comment\n", "is empty"),
        ("t,a\n", "no samples below"),
        ("0,1\n1,1\n", "has no header: its first line holds numbers"),
        ("s,a\n0,1\n1,1\n", "there is no column t (time, s), nor time, timestamp or __time"),
        ("t,a\n0,1\n", "one sample has no derivatives: give .v and .a for a"),
        ("t,a,a.v\n0,1,0\n", "one sample has no derivatives: give .v and .a for a"),
        ("t,a,payload.box\n0,1,0.5\n1,1,1\n", "column payload.box: 1 (carried) or 0, found 0.5"),
        ("t,a\n0,1,2\n1,2,3\n", "rows with another number of cells: line 2 (3), line 3 (3)"),
        ("t,a\nx,1\n", "not a number: line 2, column t: 'x'"),
        ("t,a\n0,\n1,\n", "column a is empty: name another by --columns FILE; a joint"),
    ],
)
def test_bad_csv_files(tmp_path, text, part):
    assert part in message(write(tmp_path, "m.csv", text), one_joint_scene(box=True))


def test_long_lists_of_problems_are_cut_and_counted(tmp_path):
    rows = "\n".join(f"{i},nan" for i in range(5000))
    text = message(write(tmp_path, "m.csv", f"t,a\n{rows}\n"), one_joint_scene())
    assert "(5000 in all)" in text
    assert len(text) < 1000


def test_moving_across_a_gap_is_an_error_and_holding_across_it_is_not(tmp_path):
    scene = one_joint_scene()
    moving = "\n".join(f"{t},{0.1 * t}" for t in [*np.arange(0, 1, 0.01), *np.arange(5, 6, 0.01)])
    text = message(write(tmp_path, "m.csv", "t,a\n" + moving), scene)
    assert "joint a: moves across gaps in time (0.99 to 5 s)" in text
    held = "\n".join(f"{t},0.5" for t in [*np.arange(0, 1, 0.01), *np.arange(5, 6, 0.01)])
    assert (load_trajectory(write(tmp_path, "h.csv", "t,a\n" + held), scene).v == 0).all()


def test_files_that_cannot_be_read(tmp_path):
    scene = one_joint_scene()
    assert "there is no file" in message(tmp_path / "none.csv", scene)
    assert "there is no file" in message(tmp_path / "none.yaml", scene)
    assert "ends in .csv, .yaml or .yml" in message(write(tmp_path, "m.doc", "t,a"), scene)
    for ending, kind, conversion in (
        (".h5", "HDF5", "numpy.savez('log.npz', **d)"),
        (".HDF5", "HDF5", "import h5py"),
        (".feather", "Arrow", "to_parquet"),
        (".xlsx", "a spreadsheet", "as CSV"),
        (".npy", "an array without names", "t=TIMES"),
    ):
        said = message(write(tmp_path, f"m{ending}", "x"), scene)
        assert f"m{ending}: is {kind}, which is not read; convert it: " in said
        assert conversion in said
        assert "\n" not in said
    binary = tmp_path / "b.csv"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    assert "not a text file" in message(binary, scene)


def test_a_missing_effort_is_no_missing_motion(tmp_path):
    """Empty cells and nan of one effort leave its rows; most of them, or words, do not."""
    lift = np.where(T > 1.5, np.nan, 1.0 + T)
    header = ("t", *NAMES, *(f"{name}.effort" for name in NAMES))

    def read(cells):
        rows = [f"{t:.9g},{a:.9g},{b:.9g},1,{c}" for t, (a, b), c in zip(T, Q, cells, strict=True)]
        return load(tmp_path, "\n".join([",".join(header), *rows]))

    whole = read(1.0 + T)
    for cells in (np.where(np.isnan(lift), "", lift.astype(str)), lift):
        motion = read(cells)
        assert_array_equal(motion.q, whole.q)
        assert_array_equal(motion.v, whole.v)
        assert_array_equal(np.isnan(motion.reading.effort["arm_lift"]), np.isnan(lift))
        assert "joint arm_lift: no effort in 99 rows" in motion.reading.notes
    for cells in (np.where(T > 0.9, np.nan, 1.0), np.where(T > 1.5, "lost", "1")):
        with pytest.raises(TrajectoryError, match=r"arm_lift\.effort"):
            read(cells)
