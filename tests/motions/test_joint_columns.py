"""Ranges of joints: what counts as a limit."""

import numpy as np
import pinocchio as pin
import pytest

from pinfric.motions.joint_columns import joint_columns, limit_problems, listing, stated_range


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
