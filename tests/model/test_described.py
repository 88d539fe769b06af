"""A field of a result is described once, and JSON, table, page, reference and the rest have it."""

import dataclasses
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from described_cases import After, Before
from jsonschema import Draft202012Validator

from pinfric.cli import result_classes
from pinfric.model.described import (
    EFFORT,
    SPEED,
    Schema,
    described,
    in_json,
    unit_at,
)
from pinfric.show.report.html import html_of
from pinfric.show.report.rows import flat, table_of


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


def test_two_classes_of_one_name_are_refused():
    @described
    class After:
        """Another one."""

    schema = Schema()
    schema.of_class(Before)
    schema.of_class(After)
    with pytest.raises(AssertionError, match="After"):
        schema.of_class(globals()["After"])
