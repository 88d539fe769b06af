"""`pinfric accuracy` as a shell sees it: JSON, files, tables, pictures, and bad input."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from envelopes import result_of

import pinfric as pf
from pinfric import cli
from pinfric.accuracy import precision
from pinfric.accuracy.precision import Run
from pinfric.accuracy.study import Accuracy
from pinfric.show.accuracy.figure import accuracy_figure

ROBOTS = Path(__file__).parents[3] / "robots"


@pytest.fixture(autouse=True)
def few_settings(monkeypatch, tmp_path):
    """One or two settings of each method: what is printed is tested here, not what it says."""
    monkeypatch.setattr(precision, "TOLERANCES", (1e-3, 1e-6))
    monkeypatch.setattr(precision, "STEPS", (50,))
    monkeypatch.setattr(precision, "VELOCITIES", (1e-1,))
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)


def run(*arguments):
    """Exit code of `pinfric accuracy ARGUMENTS`, in this process."""
    with pytest.raises(SystemExit) as ended:
        cli.main(["accuracy", *arguments])
    return ended.value.code


def refuse(constant):
    raise AssertionError(f"{constant} is no JSON")


def test_json_has_every_study_and_nothing_else_is_printed(capsys):
    assert run("pendulum", "--json") == 0
    out, err = capsys.readouterr()
    assert err == ""
    json.loads(out, parse_constant=refuse)
    answer = result_of(out)
    assert answer.keys() == {
        "trajectory",
        "runs",
        "sampling",
        "ladder",
        "notes",
    }
    methods = [(r["method"], r["setting"]) for r in answer["runs"]]
    assert methods == [
        ("event", "rtol 1e-03"),
        ("event", "rtol 1e-06"),
        ("event", "defaults"),
        ("timestepping", "dt 4.00e-02 s"),
        ("regularized", "velocity 1e-01"),
    ]
    for row in answer["runs"]:
        assert {"error", "end_error", "stick_error", "wall_s", "rhs", "problem"} <= row.keys()
        assert 0 <= row["error"] < 1
        assert row["rhs"] > 10
    assert answer["trajectory"] == "its own simulation"
    assert {row["given"] for row in answer["sampling"]} == {"q, v, a", "q"}


@pytest.fixture
def drawer(tmp_path):
    """The drawer with nothing to simulate: studies of inverse dynamics take less time."""
    for name in ("drawer.urdf", "drawer.waypoints.yaml", "drawer.yaml"):
        text = (ROBOTS / name).read_text()
        (tmp_path / name).write_text(text.partition("\nsimulation:")[0] + "\n")
    return str(tmp_path / "drawer.yaml"), str(tmp_path / "drawer.waypoints.yaml")


def test_out_has_picture_csv_and_summary(drawer, tmp_path, capsys):
    assert run(*drawer, "--json", "--out", "results/a") == 0
    out, err = capsys.readouterr()
    folder = tmp_path / "results" / "a"
    assert sorted(p.name for p in folder.iterdir()) == [
        "accuracy.csv",
        "accuracy.png",
        "summary.json",
    ]
    assert "accuracy.png" in err
    assert (folder / "accuracy.png").read_bytes().startswith(b"\x89PNG")
    json.loads(out, parse_constant=refuse)
    answer = result_of(out)
    assert json.loads((folder / "summary.json").read_text())["result"] == answer
    frame = pd.read_csv(folder / "accuracy.csv")
    counts = frame["study"].value_counts()
    for study, key in (("sampling", "sampling"), ("ladder", "ladder")):
        assert counts[study] == len(answer[key])


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["no_such_scene"], "no_such_scene"),
        (["ur5_pick_and_place"], "`simulation`"),
        (["pendulum", "no_such_motion.csv"], "no_such_motion.csv"),
        (["pendulum", "ur5_pick_and_place.csv"], "shoulder_pan_joint"),
        (["pendulum", "--method", "event"], "--method"),
    ],
)
def test_bad_input_is_a_message_and_exit_code_2(arguments, expected, capsys):
    assert run(*arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("pinfric: error: ")
    assert expected in err
    assert len(err.splitlines()) == 1


def test_a_folder_that_cannot_be_written_is_a_message(monkeypatch, capsys):
    nothing = Accuracy(pf.load_scene("pendulum"), "none", (), (), (), ())
    monkeypatch.setattr("pinfric.accuracy.study.accuracy", lambda *_, **__: nothing)
    assert run("pendulum", "--out", "/proc/nowhere") == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert err.startswith("pinfric: error: ")
    assert "/proc/nowhere" in err


def test_no_legend_hides_a_point():
    """The points of every method lie below the legend, wherever they are in the plot."""
    corners = [(1e-3, 1e-12), (1.0, 1e-12), (1e-3, 1e-1), (1.0, 1e-1)]
    runs = tuple(
        Run(method, str(i), error=error, stick_error=error, wall_s=seconds)
        for method in ("event", "timestepping", "regularized")
        for i, (seconds, error) in enumerate(corners)
    )
    scene = pf.load_scene("pendulum")
    figure = accuracy_figure(Accuracy(scene, "none", runs, (), (), ()))
    figure.draw_without_rendering()
    for axes in figure.axes[:2]:
        legend = axes.get_legend().get_window_extent()
        points = axes.transData.transform([(1e3 * seconds, error) for seconds, error in corners])
        assert legend.y0 > points[:, 1].max() + 4
        assert axes.title.get_window_extent().y0 >= legend.y1
