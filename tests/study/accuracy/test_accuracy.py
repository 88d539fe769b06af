"""Accuracy against time: errors that are what they say, failures that stay rows.

Wall times are never asserted; errors, counts and orders of convergence are.
"""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from builders import block, plane_friction

import pinfric as pf
from pinfric.dynamics.inverse.result import StickInterval
from pinfric.errors import SceneError, SimulationError
from pinfric.model.described import in_json
from pinfric.paper.reproduction import EXAMPLES
from pinfric.paper.simulate import simulate
from pinfric.show.accuracy.figure import accuracy_figure
from pinfric.show.accuracy.report import accuracy_frame, accuracy_report
from pinfric.study.accuracy import precision
from pinfric.study.accuracy import study as accuracy_module
from pinfric.study.accuracy.ladder import fitted_constants, ladder, solve
from pinfric.study.accuracy.precision import (
    Contestant,
    Judge,
    Track,
    compete,
    contestants,
    judge_of,
    reference,
)
from pinfric.study.accuracy.sampling import missed_stick, sampling
from pinfric.study.accuracy.study import accuracy
from pinfric.study.trajectory.trajectory import Trajectory

_FEW_STEPS = (50, 500)


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


@pytest.fixture(scope="module")
def pendulum():
    """The whole study of the paper's pendulum; of the slow methods two settings each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(precision, "STEPS", _FEW_STEPS)
        patch.setattr(precision, "VELOCITIES", (1e-1, 1e-2))
        scene = pf.load_scene("pendulum")
        return accuracy(scene, rounds=1)


def of(runs, method):
    return [run for run in runs if run.method == method]


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


def test_json_has_the_runs_and_no_nan(pendulum):
    answer = json.loads(json.dumps(in_json(pendulum), allow_nan=False))
    assert {"method", "setting", "error", "stick_error", "wall_s", "rhs"} <= set(answer["runs"][0])
    errors = [run["error"] for run in answer["runs"] if run["method"] == "event"]
    assert max(errors) >= 1e-3
    assert min(errors) <= 1e-9
    assert answer["ladder"][0]["peak_change"] is None


def test_table_and_picture(pendulum, tmp_path):
    from rich.console import Console

    console = Console(width=100, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(*accuracy_report(pendulum), sep="\n")
    text = console.export_text()
    for expected in ("rtol 1e-10", "dt 4.00e-03 s", "velocity 1e-02", "frictionless", "+ static"):
        assert expected in text
    frame = accuracy_frame(pendulum)
    assert set(frame["study"]) == {"simulation", "sampling", "ladder"}
    assert (frame["study"] == "simulation").sum() == len(pendulum.runs)
    figure = accuracy_figure(pendulum)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 4
    assert shown[0].get_xscale() == shown[0].get_yscale() == "log"
    drawn = {line.get_label(): line.get_ydata() for line in shown[0].lines}
    assert max(drawn["event"]) == max(run.error for run in of(pendulum.runs, "event"))
    figure.savefig(tmp_path / "accuracy.png")
    assert (tmp_path / "accuracy.png").read_bytes().startswith(b"\x89PNG")


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


def test_errors_of_stick_ends_by_hand():
    true = (StickInterval("a", 1.0, 2.0), StickInterval("b", 3.0, 4.0))
    judge = Judge("hand", pf.Scene(model=block()), lambda t: t, true)
    nothing = np.zeros(0)
    short = (StickInterval("a", 0.9, 1.1), StickInterval("a", 1.2, 2.3), StickInterval("b", 3, 4))
    assert judge.stick_errors(Track(nothing, nothing, (short,), 0)) == pytest.approx([0.3, 0.0])
    missing = (StickInterval("a", 1.0, 2.5), StickInterval("b", 5.0, 6.0))
    errors = judge.stick_errors(Track(nothing, nothing, (missing,), 0))
    assert errors[0] == pytest.approx(0.5)
    assert np.isnan(errors[1])
    best = judge.stick_errors(Track(nothing, nothing, (missing, short), 0))
    assert best == pytest.approx([0.3, 0.0])


def test_missed_stick_time_by_hand():
    true = (StickInterval("a", 0.0, 1.0), StickInterval("b", 0.0, 1.0))
    found = (StickInterval("a", 0.25, 0.5), StickInterval("a", 0.75, 2.0))
    assert missed_stick(true, found) == pytest.approx((2.0, 1.5))


def test_fewer_samples_miss_more_stick():
    scene = pf.load_scene("pendulum")
    trajectory = pf.load_trajectory("pendulum.waypoints.yaml", scene)
    rows = [row for row in sampling(scene, trajectory) if row.given == "q, v, a"]
    assert rows[0].missed_stick == 0.0
    assert rows[0].stick == pytest.approx(1.0, abs=0.01)  # 0.2 + 0.5 + 0.3 s of holds
    assert rows[0].rate == pytest.approx(1000)
    for row in rows:  # each hold loses at most a sample at either end
        assert row.missed_stick <= 3 * 2 / row.rate + 1e-9
    assert rows[-1].peak_error > rows[1].peak_error


def sliding(scene):
    """0.5 m/s forth, then back: friction is all there is."""
    t = np.linspace(0.0, 1.0, 101)
    v = np.where(t < 0.5, 0.5, -0.5)[:, None]
    q = np.minimum(t, 1.0 - t)[:, None] * 0.5
    return Trajectory.from_arrays(scene, t, q, v, np.zeros((101, 1)))


def test_rungs_by_hand():
    entry = plane_friction(0.4, 0.3, coulomb={"static": 3.0, "kinetic": 3.0}, viscous=2.0)
    scene = pf.Scene(model=block(mass=2.0), friction={"slide": entry})
    motion = sliding(scene)
    weight = 0.3 * 2.0 * 9.81
    constants = fitted_constants(solve(scene, motion))
    assert constants["slide"] == pytest.approx(weight + 3.0 + 1.0)
    rungs = {rung.name: rung for rung in ladder(scene, motion, rounds=1)}
    assert rungs["frictionless"].us > 0
    assert rungs["constant"].rms_change == pytest.approx(weight + 4.0)
    # the reversal between two samples is an interval of standstill there: its ends differ
    assert rungs["radial load"].rms_change == pytest.approx(-4.0, rel=0.01)
    assert rungs["+ coulomb"].rms_change == pytest.approx(3.0, rel=0.02)
    assert rungs["+ viscous"].rms_change == pytest.approx(1.0, rel=0.03)
    assert rungs["+ viscous"].distance == 0.0
    assert rungs["+ viscous"].drive == "slide"
    assert not rungs["+ bending"].on
    assert not rungs["+ coupling"].on
    assert rungs["frictionless"].distance == pytest.approx(1.0)


def test_coupling_is_what_one_pass_misses():
    scene = pf.load_scene("four_bar")
    motion = pf.load_trajectory("four_bar.waypoints.yaml", scene)
    thin = slice(200, 600, 10)
    short = dataclasses.replace(
        motion,
        t=motion.t[thin],
        q=motion.q[thin],
        v=motion.v[thin],
        a=motion.a[thin],
        attached=motion.attached[thin],
    )
    rungs = {rung.name: rung for rung in ladder(scene, short, rounds=1)}
    assert rungs["+ coupling"].on
    assert np.isnan(rungs["radial load"].us)
    assert 0 < rungs["+ coupling"].distance < rungs["radial load"].distance
    # what one pass misses is of second order in the coefficients
    gentle = {
        name: entry.model_copy(update={"mu": type(entry.mu)(static=0.03, kinetic=0.03)})
        for name, entry in scene.friction.items()
    }
    rungs = ladder(dataclasses.replace(scene, friction=gentle), short, rounds=1)
    one_pass = next(rung for rung in rungs if rung.name == "radial load")
    bare = next(rung for rung in rungs if rung.name == "frictionless")
    assert one_pass.distance < 0.1 * bare.distance


def test_neither_simulation_nor_trajectory_is_an_error():
    with pytest.raises(SceneError, match="simulation"):
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
