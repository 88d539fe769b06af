"""A field of a result is described once: JSON, table, page, reference and the rest have it."""

from __future__ import annotations

import dataclasses
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from pinfric.cli import result_classes
from pinfric.model.described import (
    EFFORT,
    SPEED,
    Schema,
    between,
    derived,
    described,
    in_json,
    quantity,
    unit_at,
)
from pinfric.show.report.html import html_of
from pinfric.show.report.rows import flat, table_of


@described
class Before:
    """What one drive did."""

    name: str = quantity("the drive's", heading="joint", name=True)
    unit: str = quantity("of its effort", heading="unit")
    peak: float = quantity("largest effort", EFFORT, "peak")

    @property
    @derived(heading="twice", cell="{double:.1f}")
    def double(self) -> float:
        """Two times the peak."""
        return 2.0 * self.peak


@described
class After(Before):
    """The same with one line more."""

    jerk: float | None = quantity("largest jerk", "rad/s^3 or m/s^3", "jerk", default=1234.5)


@pytest.fixture(params=["N m", "N"])
def row(request):
    return After("elbow", request.param, 12.0)


def test_a_field_of_one_line_is_in_json_schema_docstring_table_page_and_dataframe(row):
    before = Before("elbow", row.unit, 12.0)
    unit = {"N m": "rad/s^3", "N": "m/s^3"}[row.unit]
    assert in_json(row) == {**in_json(before), "jerk": 1234.5}
    schema = Schema()
    key = schema.defs[schema.of_class(After)["$ref"].rpartition("/")[2]]["properties"]["jerk"]
    assert (key["description"], key["unit"]) == ("largest jerk", "rad/s^3 or m/s^3")
    assert "jerk: largest jerk (rad/s^3 or m/s^3)." in After.__doc__
    assert "jerk" not in Before.__doc__
    assert f"jerk\n{unit}" in [column.heading for column in table_of("", [row]).columns]
    assert f"jerk<br>{unit}" in html_of(table_of("", [row]))
    assert "<td>1234" in html_of(table_of("", [row]))
    assert flat(row)["jerk"] == 1234.5
    assert not {"jerk"} & flat(before).keys()


def test_the_reference_has_every_field_of_every_command(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "notebooks")
    lines = import_module("result_keys").result_lines
    assert "| `jerk` | rad/s^3 or m/s^3 | largest jerk |" in lines({"after": [After]})
    whole = "\n".join(lines())
    assert all(f"## pinfric {command}" in whole for command in result_classes())


def test_json_is_valid_against_the_schema_and_nothing_else_is(row):
    schema = Schema()
    validator = Draft202012Validator(schema.whole(schema.of_class(After)))
    assert validator.is_valid(in_json(dataclasses.replace(row, jerk=np.nan)))
    assert not validator.is_valid(in_json(Before("elbow", row.unit, 1.0)))
    assert not validator.is_valid({**in_json(row), "more": 1})
    assert not validator.is_valid({**in_json(row), "peak": "much"})


def test_the_unit_of_a_joint_is_decided_by_its_effort():
    assert [unit_at(EFFORT, effort) for effort in ("N m", "N", "")] == ["N m", "N", EFFORT]
    assert [unit_at(SPEED, effort) for effort in ("N m", "N")] == ["rad/s", "m/s"]
    assert unit_at("Hz", "N") == "Hz"


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


def test_two_classes_of_one_name_are_refused():
    @described
    class After:
        """Another one."""

    schema = Schema()
    schema.of_class(Before)
    schema.of_class(After)
    with pytest.raises(AssertionError, match="After"):
        schema.of_class(globals()["After"])
