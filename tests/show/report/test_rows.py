"""Rows of described results: units, ranges, what rounds to nothing."""

from __future__ import annotations

import pytest
from described_cases import After

from pinfric.model.described import (
    between,
    described,
    quantity,
)
from pinfric.show.report.rows import table_of, text_of


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
