"""Impossible options of reading are refused in one line."""

import pytest
from log_cases import NAMES, Q, T, arm, noisy, refused, table

import pinfric as pf
from pinfric.errors import TrajectoryError
from pinfric.motions.log.reading import ReadingOptions


@pytest.mark.parametrize("cutoff", ["100", "0.5"])
def test_cutoffs_that_cannot_be(cutoff, tmp_path):
    message = refused(tmp_path, table(("t", *NAMES), T, noisy(T)), cutoff=cutoff)
    assert f"--cutoff {cutoff}: this log can be filtered from 1 to 100 Hz" in message


@pytest.mark.parametrize("cutoff", ["1_0", "\N{FULLWIDTH DIGIT ONE}", "-1", "fast"])
def test_cutoffs_that_are_no_frequency(cutoff):
    with pytest.raises(TrajectoryError, match=f"--cutoff {cutoff}: give a frequency in Hz"):
        ReadingOptions(cutoff=cutoff)


@pytest.mark.parametrize(
    ("header", "columns", "parts"),
    [
        (
            NAMES,
            (Q,),
            ("there is no column t (time, s)", "there are: base_turn, arm_lift", "`time: NAME`"),
        ),
        (
            ("time", "timestamp", *NAMES),
            (T, T, Q),
            ("'time', 'timestamp' may all be the time", "`time: time`"),
        ),
        (
            ("t", "joint_a", "joint_b"),
            (T, Q),
            (
                "no column is a joint of the scene (base_turn, "
                "arm_lift); there are: t, joint_a, joint_b",
                "joints: {base_turn: COLUMN}",
            ),
        ),
        (
            ("t", "base_turn", "elbow"),
            (T, Q),
            ("joints without a column: arm_lift (columns not used: 'elbow')",),
        ),
        (
            ("t", "base_turn/effort", "arm_lift/effort"),
            (T, Q),
            ("has effort of the joints, but no positions",),
        ),
        (
            ("t", "a/base_turn/position", "b/base_turn/position", "arm_lift"),
            (T, Q, Q[:, 0]),
            (
                "'a/base_turn/position', 'b/base_turn/position' may all be the position of joint "
                "base_turn",
                "--columns",
            ),
        ),
    ],
)
def test_what_cannot_be_known_is_refused_in_one_line(header, columns, parts, tmp_path):
    message = refused(tmp_path, table(header, *columns))
    for part in parts:
        assert part in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "options", [{"unit": "grad"}, {"time_unit": "min"}, {"cutoff": "0"}, {"cutoff": "fast"}]
)
def test_options_that_say_nothing_are_refused(options):
    with pytest.raises(TrajectoryError, match=r"^--"):
        ReadingOptions(**options)


def test_a_log_without_rows_has_no_samples():
    with pytest.raises(TrajectoryError, match="log: there are no samples"):
        pf.load_trajectory(pf.Log([], Q[:0]), arm())
