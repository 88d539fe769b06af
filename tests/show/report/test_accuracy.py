"""`pinfric accuracy` as a shell sees it: JSON, files, tables, pictures, and bad input."""

import json

import pandas as pd
import pytest
from accuracy_cases import of, studied_pendulum
from cli_cases import refused, results_in, told
from envelopes import result_of

import pinfric as pf
from pinfric.accuracy import study
from pinfric.accuracy.study import Accuracy
from pinfric.show.figure.accuracy import accuracy_figure
from pinfric.show.report.accuracy import accuracy_report


@pytest.fixture(autouse=True)
def few_settings(monkeypatch, tmp_path):
    """One or two settings of each method: the print is tested here, not its content."""
    monkeypatch.setattr(study, "TOLERANCES", (1e-3, 1e-6))
    monkeypatch.setattr(study, "STEPS", (50,))
    monkeypatch.setattr(study, "VELOCITIES", (1e-1,))
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)


def refuse(constant):
    raise AssertionError(f"{constant} is no JSON")


def test_json_has_every_run_and_nothing_else_is_printed(capsys):
    out, err = told(capsys, "accuracy", "pendulum", "--json")
    assert all(line.endswith(" s so far") for line in err.splitlines())  # on a slow machine
    json.loads(out, parse_constant=refuse)
    answer = result_of(out)
    assert answer.keys() == {"runs"}
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


def test_out_has_picture_csv_and_summary(tmp_path, capsys):
    out, err = told(capsys, "accuracy", "pendulum", "--json", "--out", "results/a")
    folder = tmp_path / "results" / "a"
    assert results_in(folder) == [
        "accuracy.csv",
        "accuracy.pdf",
        "accuracy.png",
        "summary.json",
    ]
    assert "accuracy.png" in err
    assert (folder / "accuracy.png").read_bytes().startswith(b"\x89PNG")
    json.loads(out, parse_constant=refuse)
    answer = result_of(out)
    assert json.loads((folder / "summary.json").read_text())["result"] == answer
    frame = pd.read_csv(folder / "accuracy.csv")
    assert len(frame) == len(answer["runs"])


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["no_such_scene"], "no_such_scene"),
        (["ur5_pick_and_place"], "`simulation`"),
        (["pendulum", "motion.csv"], "motion.csv"),
        (["pendulum", "--method", "event"], "--method"),
    ],
)
def test_bad_input_is_a_message_and_exit_code_2(arguments, expected, capsys):
    assert expected in refused(capsys, "accuracy", *arguments)


def test_a_folder_that_cannot_be_written_is_a_message(monkeypatch, capsys):
    nothing = Accuracy(pf.load_scene("pendulum"), ())
    monkeypatch.setattr("pinfric.accuracy.study.accuracy", lambda *_, **__: nothing)
    assert "/proc/nowhere" in refused(capsys, "accuracy", "pendulum", "--out", "/proc/nowhere")


@pytest.mark.slow
def test_table_and_picture(tmp_path):
    from rich.console import Console

    pendulum = studied_pendulum()

    console = Console(width=100, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(*accuracy_report(pendulum), sep="\n")
    text = console.export_text()
    for expected in ("rtol 1e-06", "dt 4.00e-03 s", "velocity 1e-02"):
        assert expected in text
    figure = accuracy_figure(pendulum)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 2
    assert shown[0].get_xscale() == shown[0].get_yscale() == "log"
    drawn = {line.get_label(): line.get_ydata() for line in shown[0].lines}
    assert max(drawn["event"]) == max(run.error for run in of(pendulum.runs, "event"))
    figure.savefig(tmp_path / "accuracy.png")
    assert (tmp_path / "accuracy.png").read_bytes().startswith(b"\x89PNG")
