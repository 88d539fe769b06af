"""A study of accuracy: what it needs, JSON, failures that stay rows."""

from __future__ import annotations

import json

import numpy as np
import pytest
from builders import block

import pinfric as pf
from pinfric.accuracy import study as accuracy_module
from pinfric.accuracy.precision import (
    Contestant,
    Judge,
    Track,
    compete,
)
from pinfric.accuracy.study import accuracy
from pinfric.errors import SceneError, SimulationError
from pinfric.model.described import in_json
from pinfric.show.accuracy.report import accuracy_report


def test_json_has_the_runs_and_no_nan(pendulum):
    answer = json.loads(json.dumps(in_json(pendulum), allow_nan=False))
    assert {"method", "setting", "error", "stick_error", "wall_s", "rhs"} <= set(answer["runs"][0])
    errors = [run["error"] for run in answer["runs"] if run["method"] == "event"]
    assert max(errors) >= 1e-3
    assert min(errors) <= 1e-9
    assert answer["ladder"][0]["peak_change"] is None


def test_a_failure_is_a_row():
    def fails():
        raise SimulationError("it cannot go on")

    still = np.zeros((3, 1))
    scene = pf.Scene(model=block())
    judge = Judge("still", scene, lambda t: np.zeros((len(t), 1)), ())
    sound = Track(np.arange(3.0), still, ((),), 7)
    lost = Track(np.arange(3.0), np.full((3, 1), np.nan), ((),), 7)
    runs = compete(
        [
            Contestant("a", "1", fails, fails),
            Contestant("b", "2", lambda: None, lambda: sound),
            Contestant("c", "3", lambda: None, lambda: lost),
        ],
        judge,
        rounds=1,
    )
    assert runs[0].problem == "it cannot go on"
    assert np.isnan(runs[0].error)
    assert (runs[1].problem, runs[1].error, runs[1].stick_error, runs[1].rhs) == ("", 0.0, 0.0, 7)
    assert "diverges" in runs[2].problem
    study = accuracy_module.Accuracy(scene, "none", runs, (), (), ())
    table, _, first, last, *_ = accuracy_report(study)
    assert len(table.rows) == 3
    assert "it cannot go on" in str(first)
    assert "diverges" in str(last)
    assert [run["error"] for run in in_json(study)["runs"]] == [None, 0.0, None]


def test_neither_simulation_nor_trajectory_is_an_error():
    with pytest.raises(
        SceneError, match="has no `simulation` section; give it one, or name a trajectory"
    ):
        accuracy(pf.load_scene("ur5_pick_and_place"))


def test_a_trajectory_alone_is_studied():
    scene = pf.load_scene("ur5_pick_and_place")
    trajectory = pf.load_trajectory("ur5_pick_and_place.csv", scene)
    found = accuracy(scene, trajectory, rounds=1)
    assert found.runs == ()
    assert "no `simulation` section" in found.notes[0]
    rungs = {rung.name: rung for rung in found.ladder}
    assert rungs["+ transmission"].motor_side
    assert rungs["+ viscous"].distance < rungs["frictionless"].distance
    assert "ur5_pick_and_place.csv" in in_json(found)["trajectory"]
