"""Places of a log's efforts: each against inverse dynamics, and the messages."""

import numpy as np
import pytest
from builders import example

import pinfric as pf
from pinfric.errors import TrajectoryError
from pinfric.motions.log.effort_place import EFFORT_PLACES
from pinfric.motions.log.judged import judge_log
from pinfric.motions.log.reading import Reading

JOINT = "panda_joint1"


@pytest.fixture(scope="module")
def result():
    return pf.inverse_dynamics(*example("panda_pick_and_place"))


def logged(result, at):
    """The first drive's torque or effort, the middle of its interval, as a log of that place."""
    ends = (
        (result.effort_lower, result.effort_upper)
        if at == "joint"
        else (result.motor_torque_lower, result.motor_torque_upper)
    )
    middle = 0.5 * (ends[0] + ends[1])[:, 0]
    factor = result.scene.drives[0].ratio if at == "reflected" else 1.0
    return Reading(len(middle), effort={JOINT: factor * middle})


@pytest.mark.parametrize("at", ["reflected", "motor", "joint"])
def test_efforts_fit_where_they_were_logged(result, at):
    found = judge_log(result, logged(result, at), at)
    assert found.measured[JOINT].relative_error < 1e-12
    (note,) = found.notes
    assert note.count("--effort-at ") == 2
    assert f"--effort-at {at} (" not in note
    assert "(ratio 100)" in note


@pytest.mark.parametrize("at", ["reflected", "motor", "joint"])
@pytest.mark.parametrize("right", ["reflected", "motor", "joint"])
def test_what_efforts_fit_better_is_said(result, at, right):
    found = judge_log(result, logged(result, right), at)
    if at == right:
        assert len(found.notes) == 1
    else:
        assert f"fit better as {EFFORT_PLACES[right]} (--effort-at {right})" in found.notes[-1]


def test_without_gears_all_places_are_one(result):
    scene = result.scene.with_(actuators=None)
    bare = pf.inverse_dynamics(scene, pf.load_trajectory("panda_pick_and_place", scene))
    reading = logged(bare, "joint")
    assert (
        np.ptp([judge_log(bare, reading, at).measured[JOINT].rms for at in ("joint", "motor")]) == 0
    )
    assert judge_log(bare, reading).notes == ()
    (note,) = judge_log(bare, reading, "motor").notes
    assert "the scene names no gear: ratio 1" in note


def test_an_unknown_place_names_those_there_are(result):
    with pytest.raises(TrajectoryError, match="--effort-at shaft: there are: reflected, motor, "):
        judge_log(result, logged(result, "motor"), "shaft")
