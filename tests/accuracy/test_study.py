"""Work against precision: the three methods against the absolute formulation, failures as rows."""

import json

import numpy as np
import pytest
from accuracy_cases import of
from builders import sliding_block

import pinfric as pf
from pinfric.accuracy.study import (
    Accuracy,
    Contestant,
    Judge,
    JudgedTrack,
    accuracy,
    compete,
    contestants,
    judge_of,
    reference,
)
from pinfric.dynamics.inverse.result import StickInterval
from pinfric.errors import SceneError, SimulationError
from pinfric.model.described import in_json
from pinfric.paper.reproduction import EXAMPLES
from pinfric.paper.simulate import simulate
from pinfric.show.report.accuracy import accuracy_report


def test_json_has_the_runs_and_no_nan(pendulum):
    answer = json.loads(json.dumps(in_json(pendulum), allow_nan=False))
    assert {"method", "setting", "error", "stick_error", "wall_s", "rhs"} <= set(answer["runs"][0])
    errors = [run["error"] for run in answer["runs"] if run["method"] == "event"]
    assert max(errors) >= 1e-3
    assert min(errors) <= 1e-9


def test_a_failure_is_a_row():
    def fails():
        raise SimulationError("it cannot go on")

    still = np.zeros((3, 1))
    scene = sliding_block()
    judge = Judge("still", scene, lambda t: np.zeros((len(t), 1)), ())
    sound = JudgedTrack(np.arange(3.0), still, ((),), 7)
    lost = JudgedTrack(np.arange(3.0), np.full((3, 1), np.nan), ((),), 7)
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
    study = Accuracy(scene, runs)
    table, _, first, last, *_ = accuracy_report(study)
    assert len(table.rows) == 3
    assert "it cannot go on" in str(first)
    assert "diverges" in str(last)
    assert [run["error"] for run in in_json(study)["runs"]] == [None, 0.0, None]


def test_a_scene_without_a_simulation_is_an_error():
    with pytest.raises(SceneError, match="has no `simulation` section; give it one"):
        accuracy(pf.load_scene("ur5_pick_and_place"))


def absolute_judge(scene):
    """The paper's own formulation as a judge of its example."""
    example = next(one for one in EXAMPLES if one.name == "pendulum")
    judged = example.judge()
    t_end = scene.simulation.t_end
    motion = simulate(
        judged.mechanism,
        judged.position,
        judged.rate,
        judged.effort,
        t_end,
        rtol=1e-12,
        atol=1e-14,
        sample_step=t_end,
    )
    starts = np.array([phase.start for phase in motion.phases])

    def at(times):
        phases = np.maximum(starts.searchsorted(times, side="right") - 1, 0)
        states = [motion.phases[p].solution(t) for p, t in zip(phases, times, strict=True)]
        return np.array(states)[:, : scene.model.nq]

    sticks = tuple(
        StickInterval(example.site, start, end)
        for start, end in motion.stick_intervals(example.site)
    )
    return Judge("absolute coordinates", scene, at, sticks)


def test_event_spans_the_decades_and_absolute_coordinates_agree(pendulum):
    event = [run for run in of(pendulum.runs, "event") if run.setting != "defaults"]
    assert len(event) >= 5
    assert max(run.error for run in event) >= 1e-3
    assert min(run.error for run in event) <= 1e-9
    assert min(run.stick_error for run in event) <= 1e-9
    scene = pf.load_scene("pendulum")
    theirs, ours = absolute_judge(scene), judge_of(reference(scene))
    times = np.linspace(0.0, scene.simulation.t_end, 201)
    assert np.abs(theirs.at(times) - ours.at(times)).max() < 1e-11
    entries = [entry for entry in contestants(scene, ["event"]) if entry.setting != "defaults"]
    absolute = {run.setting: run for run in compete(entries, theirs, rounds=1)}
    for run in event:
        other = absolute[run.setting]
        assert other.error == pytest.approx(run.error, rel=0.05)
        assert other.stick_error == pytest.approx(run.stick_error, rel=0.05)
        assert run.wall_s > 0
        assert run.rhs > 100
    assert [run.rhs for run in event][-1] > event[0].rhs


def test_methods_of_first_order_gain_what_they_should(pendulum):
    coarse, fine = of(pendulum.runs, "timestepping")
    assert (coarse.rhs, fine.rhs) == (53, 503)  # steps, both ends, one look at the stop
    assert 4 < coarse.error / fine.error < 100  # ten times the steps
    rough, smooth = of(pendulum.runs, "regularized")
    assert rough.error > 3 * smooth.error


def test_every_method_has_five_settings_or_more():
    entries = contestants(pf.load_scene("pendulum"))
    for method in ("event", "timestepping", "regularized"):
        assert len({e.setting for e in entries if e.method == method}) >= 5


def test_errors_of_stick_ends_by_hand():
    true = (StickInterval("a", 1.0, 2.0), StickInterval("b", 3.0, 4.0))
    judge = Judge("hand", sliding_block(), lambda t: t, true)
    nothing = np.zeros(0)
    short = (StickInterval("a", 0.9, 1.1), StickInterval("a", 1.2, 2.3), StickInterval("b", 3, 4))
    assert judge.stick_errors(JudgedTrack(nothing, nothing, (short,), 0)) == pytest.approx(
        [0.3, 0.0]
    )
    missing = (StickInterval("a", 1.0, 2.5), StickInterval("b", 5.0, 6.0))
    errors = judge.stick_errors(JudgedTrack(nothing, nothing, (missing,), 0))
    assert errors[0] == pytest.approx(0.5)
    assert np.isnan(errors[1])
    best = judge.stick_errors(JudgedTrack(nothing, nothing, (missing, short), 0))
    assert best == pytest.approx([0.3, 0.0])
