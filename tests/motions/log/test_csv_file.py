"""CSV files in the dialects of robots and their tools, parsed whole and in parts."""

import numpy as np
import pytest
from log_cases import DIALECTS, NAMES, PLAIN, Q, T, V, load, refused, table
from numpy.testing import assert_allclose

from pinfric.model.csv_text import number_of
from pinfric.motions.log.formats import csv_file


@pytest.mark.parametrize("dialect", DIALECTS)
def test_dialects_give_the_motion_of_the_plain_file(dialect, tmp_path):
    plain, motion = load(tmp_path, PLAIN), load(tmp_path, DIALECTS[dialect])
    assert_allclose(motion.t, plain.t, atol=1e-9)
    assert_allclose(motion.q, plain.q, atol=1e-11)
    assert_allclose(motion.v, plain.v, atol=1e-7)
    assert_allclose(motion.a, plain.a, atol=1e-4)


@pytest.mark.parametrize("row", ["0;0;1.000,5", "0;0;12.500"])
def test_points_where_commas_are_decimal_are_refused(row, tmp_path):
    text = DIALECTS["decimal commas"].replace("0;0;0,5", row)
    assert "line 2 has a point, but the file has decimal commas" in refused(tmp_path, text)


@pytest.mark.parametrize("first", ["0,00", "0"])
def test_decimal_commas_between_commas_are_named(first, tmp_path):
    """And rows with one whole number more than names are not taken for them."""
    rows = "".join(
        f"{first if k == 0 else f'0,{k:02d}'},1,5{k:02d},-0,2{k:02d}\n" for k in range(50)
    )
    text = refused(tmp_path, f"t,base_turn,arm_lift\n{rows}")
    assert "line 2: its numbers have decimal commas, and commas separate its columns" in text
    assert text.endswith("write decimal points, or separate the columns by semicolons")
    text = refused(tmp_path, "t,base_turn,arm_lift\n" + "".join(f"{k},1,2,3\n" for k in range(50)))
    assert "decimal commas" not in text
    assert "another number of cells: line 2 (4)" in text


@pytest.mark.parametrize("quantities", [1, 2, 3])
def test_what_ros2_topic_echo_writes_has_no_header(quantities, tmp_path):
    numbers = [Q, V, 7.0 * V][:quantities]
    rows = [
        [
            str(1_700_000_000 + k // 200),
            str(k % 200 * 5_000_000),
            "base",
            *NAMES,
            *(f"{x:.12g}" for part in numbers for x in part[k]),
        ]
        for k in range(400)
    ]
    motion = load(tmp_path, "\n".join(map(",".join, rows)) + "\n")
    assert_allclose(motion.t, T, atol=1e-9)
    assert_allclose(motion.q, Q, atol=1e-10)
    assert ("arm_lift" in motion.reading.effort) == (quantities == 3)
    assert motion.warnings[0].startswith("columns not used: 'header.frame_id'")
    assert "name_0" not in motion.warnings[0]


def test_what_ros2_topic_echo_writes_may_change_its_order(tmp_path):
    """Read by the first row's names, the joints changed places in mid-file."""
    rows = []
    for k in range(400):
        order = [0, 1] if k < 150 else [1, 0]
        names = [NAMES[i] for i in order] if k % 100 != 70 else ["left", "right"]
        numbers = (x for part in (Q[k], V[k], 7.0 * Q[k]) for x in part[order])
        rows.append(
            ",".join(
                [
                    str(1_700_000_000 + k // 200),
                    str(k % 200 * 5_000_000),
                    "base",
                    *names,
                    *(f"{x:.12g}" for x in numbers),
                ]
            )
        )
    motion = load(tmp_path, "\n".join(rows) + "\n")
    assert_allclose(motion.q, Q, atol=1e-6)  # four rows interpolated
    assert "or their order, change in 251 rows, first in line 71" in motion.warnings[0]
    assert_allclose(motion.reading.effort["arm_lift"], 7.0 * Q[:, 1], atol=1e-3)


def test_a_log_cut_off_while_it_was_written(tmp_path):
    motion = load(tmp_path, PLAIN.rstrip()[:-25])
    assert motion.reading.dropped == 1
    assert len(motion.t) == 399


def test_a_long_file_is_parsed_in_parts_to_the_same_numbers(tmp_path, monkeypatch):
    rng, rows = np.random.default_rng(0), 4000
    stamps = 1_700_000_000_000_000_000 + 2_000_001 * np.arange(rows)
    numbers = rng.normal(size=(rows, 2)).round(6)
    lines = [f"{t},{a:.6f},{b:.6f}" for t, (a, b) in zip(stamps, numbers, strict=True)]
    path = tmp_path / "long.csv"
    monkeypatch.setattr(csv_file, "_SMALL", 0)
    monkeypatch.setattr(csv_file, "_PART", 300)
    monkeypatch.setattr(csv_file, "_HEAD", 40)
    path.write_text("\n".join(["# made by a test", "stamp,a,b", *lines]))
    monkeypatch.setattr(csv_file, "_read_by_line", None)  # nothing is unusual in it
    found = csv_file.open_csv(path).read(("stamp", "b"), [], ())
    assert found.column("stamp").tolist() == (stamps - stamps[0]).tolist()  # no digit is lost
    assert found.origin == {"stamp": int(stamps[0])}
    assert found.column("b").tolist() == numbers[:, 1].tolist()
    assert (found.lines[0], found.lines[-1]) == (3, rows + 2)
    assert found.resolution["b"] == pytest.approx(1e-6)


def test_a_torn_first_row_of_a_long_file_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_file, "_SMALL", 0)
    header, *rows = PLAIN.rstrip().splitlines()
    motion = load(tmp_path, "\n".join([header, rows[0][:3], *rows[1:]]))
    assert (motion.reading.dropped, len(motion.t)) == (1, len(rows) - 1)


@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_both_ways_to_read_a_file_give_the_same(mark, tmp_path, monkeypatch):
    """In parts by pandas, and line by line."""
    path = tmp_path / "log.csv"
    path.write_text(table(("t", *NAMES), 1e15 + T, 1e3 * Q, mark=mark, form="%.17g"))
    by_line = csv_file.open_csv(path).read(("t", *NAMES), [], ())
    monkeypatch.setattr(csv_file, "_SMALL", 0)
    monkeypatch.setattr(csv_file, "_read_by_line", None)
    in_parts = csv_file.open_csv(path).read(("t", *NAMES), [], ())
    assert in_parts.values.tolist() == by_line.values.tolist()
    assert (in_parts.resolution, in_parts.origin) == (by_line.resolution, by_line.origin)
    assert list(in_parts.lines) == list(by_line.lines)


@pytest.mark.parametrize(
    ("row", "named"),
    [
        ("0.5,1", "the header has 3 columns; rows with another number of cells: line 1001 (2)"),
        ("0.5,1,2,3", "the header has 3 columns; rows with another number of cells: line 1001 (4)"),
        (
            "0.5,1,x",
            "not a number: line 1001, column b: 'x'; leave these rows out, or log them again",
        ),
        (
            "01.02.2026 8:00:01,1,2",
            "not a number: line 1001, column t: '01.02.2026 8:00:01'; times are seconds, or ISO "
            "8601 (2026-11-22T10:00:00.25)",
        ),
        ("0.5,1,nan", "column b: nan at sample 999 (line 1001); every value must be finite"),
        ("0.5,1,1e999", "column b: inf at sample 999 (line 1001); every value must be finite"),
    ],
)
def test_what_is_wrong_in_a_long_file_is_said_as_of_any_other(row, named, tmp_path, monkeypatch):
    monkeypatch.setattr(csv_file, "_SMALL", 0)
    monkeypatch.setattr(csv_file, "_PART", 300)
    lines = [f"{k},0,{k}" for k in range(4000)]
    lines[999] = row
    path = tmp_path / "long.csv"
    path.write_text("\n".join(["t,a,b", *lines]))
    found = csv_file.open_csv(path).read(("t", "b"), [], ())
    assert (found.dropped, found.why, len(found.values)) == (1, named, 3999)


@pytest.mark.parametrize("zone", ["", "Z", "+01:00"])
def test_stamps_of_iso_8601_are_times(zone, tmp_path):
    stamps = np.datetime64("2026-11-22T10:00:00", "ns") + np.rint(T * 1e9).astype(np.int64)
    rows = [
        f"{stamp}{zone}," + ",".join(f"{x:.12g}" for x in q)
        for stamp, q in zip(stamps, Q, strict=True)
    ]
    motion = load(tmp_path, "\n".join([",".join(("time", *NAMES)), *rows]) + "\n")
    assert_allclose(motion.t, T, atol=1e-9)
    assert_allclose(motion.q, Q, atol=1e-11)


@pytest.mark.parametrize("cell", ["0_0.3", "\uff10.\uff13", "\u0660.\u0663"])
def test_digits_are_those_of_ascii_as_in_a_urdf(tmp_path, cell):
    rows = table(("t", *NAMES), T, Q).splitlines()
    rows[8] = f"{T[7]:.12g},{cell},0.3"
    (note,) = load(tmp_path, "\n".join(rows) + "\n").reading.notes
    assert f"left out 1 row of 400: not a number: line 9, column base_turn: '{cell}'" in note
    with pytest.raises(ValueError, match="could not convert"):
        number_of(cell)
