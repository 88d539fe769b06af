"""Names, rows and figures in tables."""

import json
import re

import numpy as np
import pytest
from cli_cases import told
from described_cases import After
from report_cases import FINGERS, printed

from pinfric.model.described import (
    between,
    described,
    quantity,
)
from pinfric.show.report.names import affixes, least_room, said_short, short_names, shortened
from pinfric.show.report.rows import table_of, text_of
from pinfric.show.report.tables import Column, ColumnKind, Table

# Names: names cut so that each stands for one joint only.


def test_names_no_cut_tells_apart_are_folded_whole():
    names = [f"{'a' * 60}{i}{'z' * 60}" for i in range(3)]
    assert affixes(names) == ("", "")
    table = Table("", [Column("joint", ColumnKind.NAME), Column("x")], [(n, "1.5") for n in names])
    lines = printed([table], 40)
    assert max(map(len, lines)) <= 40
    assert "".join(line.split()[0] for line in lines[2:]) == "".join(names)


def test_affixes_end_at_separators_and_leave_something():
    assert affixes(["panda_joint1", "panda_joint2"]) == ("panda_", "")
    assert affixes(["arm_1_joint", "head_joint"]) == ("", "_joint")
    assert affixes(["ns/arm/q.pos", "ns/leg/q.pos"]) == ("ns/", "/q.pos")
    assert affixes(["arm_1_joint", "arm_2_joint"]) == ("", "_joint")  # "1" says too little
    assert affixes(["a_joint", "a_joint"]) == ("", "")
    assert affixes(["left", "lever"]) == ("", "")
    assert affixes(["abc_", "abc_d"]) == ("", "")


def test_a_name_cut_in_its_middle_is_one_name_only():
    room = least_room(FINGERS)
    for size in (room, room + 3, 40):
        for short, name in zip(shortened(FINGERS, size), FINGERS, strict=True):
            assert len(short) <= size
            pattern = re.escape(short).replace("…", ".+")
            assert [x for x in FINGERS if re.fullmatch(pattern, x)] == [name]
    assert any("…" in name for name in shortened(FINGERS, room))
    assert shortened(["short", "names"], 16) == ["short", "names"]
    assert len(shortened(["x" * 50], 10)[0]) == 10


def test_sentences_name_joints_as_tables_do_but_not_in_keys_files_and_quotes():
    short = short_names(["panda_joint1", "panda_joint10"])
    line = "panda_joint10, panda_joint1: mu.panda_joint1 of 'panda_joint1' in panda_joint1.csv."
    said = "joint10, joint1: mu.panda_joint1 of 'panda_joint1' in panda_joint1.csv."
    assert said_short(line, short) == said
    assert said_short(line, {}) == line
    assert said_short("at (panda_joint1).", short) == "at (joint1)."


def test_long_names_are_cut_around_what_tells_them_apart():
    names = [f"left_front_gripper_number_{i}_proximal_joint" for i in range(12)]
    cut = shortened(names, 16)
    assert len(set(cut)) == 12
    assert all(len(name) == 16 for name in cut)
    assert all(f"_{i}_" in name for i, name in enumerate(cut))
    assert shortened(["short", "names"], 16) == ["short", "names"]
    assert len(shortened(["x" * 50], 10)[0]) == 10


# Rows: rows of described results: units, ranges, what rounds to nothing.


def test_rows_of_both_kinds_have_their_unit_in_a_column():
    rows = [After("elbow", "N m", 1.0, None), After("slide", "N", 2.0, None)]
    table = table_of("", rows)
    assert [column.heading for column in table.columns] == ["joint", "unit", "peak", "twice"]
    assert table.rows == [("elbow", "N m", "1.00", "2.0"), ("slide", "N", "2.00", "4.0")]
    assert table_of("", []) is None


def test_rounding_squared_prints_as_nothing_and_small_errors_stay():
    rows = [After("elbow", "N m", 1.0, jerk) for jerk in (50.0, 3e-29, 3e-15)]
    assert [row[-1] for row in table_of("", rows, only=("jerk",)).rows] == ["50.0", "0", "3.00e-15"]


@pytest.mark.parametrize(
    ("least", "most", "text"), [(1.0, 2.0, "1.00\N{EN DASH}2.00"), (1.0, 1.0001, "1.00")]
)
def test_a_range_that_prints_alike_is_one_number(least, most, text):
    @described
    class Row:
        """A range."""

        name: str = quantity("of it", heading="name")
        low: float = quantity("least")
        high: float = quantity("most", heading="range", cell=between("low", "high"))

    assert table_of("", [Row("a", least, most)]).rows == [("a", text)]


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.124, "12 %"), (0.004, "0.4 %"), (0.0, "0 %"), (-0.0042, "-0.4 %"), (-1e-9, "-0.01 %")],
)
def test_a_margin_below_zero_never_prints_as_zero(share, text):
    assert text_of(share, "margin") == text


def test_what_is_not_known_is_never_printed_as_nan():
    assert text_of(float("nan"), ".2f") == "n/a"


# Values: numbers as reports print them.


def test_numbers_that_are_none_are_null():
    from pinfric.model.described import in_json

    given = {"a": np.array([1.0, np.nan]), "b": np.float64("inf"), "c": [np.int64(3), True, None]}
    assert json.dumps(in_json(given), allow_nan=False) == (
        '{"a": [1.0, null], "b": null, "c": [3, true, null]}'
    )


@pytest.mark.parametrize(
    ("x", "text"),
    [
        (0, "0"),
        (9.996, "10.0"),
        (0.0123456, "0.0123"),
        (-1234.5, "-1234"),
        (1.2e-7, "1.20e-7"),
        (float("nan"), "n/a"),
        (99.95, "100"),
        (3e9, "3.00e9"),
        (12345.6, "12346"),
        (99999.4, "1.00e5"),
        (123456.0, "1.23e5"),
        (-123456.0, "-1.23e5"),
    ],
)
def test_figures_have_three_digits(x, text):
    from pinfric.show.report.values import digits

    assert digits(x) == text


def test_rounding_is_printed_as_zero(capsys):
    # the UR5's last axis is upright all the way: what RNEA leaves there, 2e-12 N m, is rounding
    lines = told(capsys, "inverse", "ur5_pick_and_place", "ur5_pick_and_place.csv").out.splitlines()
    effort = next(line for line in lines if line.startswith("wrist_3"))
    assert " 0, 0 " in effort
    assert not any("e-" in line for line in lines)
