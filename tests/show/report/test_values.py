"""Numbers as reports print them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from cli_cases import run


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
    assert run("inverse", "ur5_pick_and_place", "ur5_pick_and_place.csv") == 0
    lines = capsys.readouterr().out.splitlines()
    effort = next(line for line in lines if line.startswith("wrist_3"))
    assert " 0, 0 " in effort
    assert not any("e-" in line for line in lines)
