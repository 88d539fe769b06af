"""`pinfric export` as a shell sees it."""

from pathlib import Path

from cli_cases import refused, results_in, run, told
from envelopes import result_of
from export_cases import (
    rich,
)
from printed import assert_printed

import pinfric as pf
from pinfric.exporting.constants import TERMS
from pinfric.show.report.export import export_report

ROBOTS = Path(__file__).parents[3] / "robots"


def test_the_command_writes_and_says_what_it_costs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    given = "export", "ur5_pick_and_place", "--trajectory", "ur5_pick_and_place.csv"
    answer = result_of(told(capsys, *given, "--to", "mjcf", "--json").out)
    assert answer["file"] == "ur5_pick_and_place.mjcf.xml"
    assert {*TERMS, "error_rms", "worst_load", "rest_upper"} <= answer["joints"][0].keys()
    assert answer["joints"][4]["unmoved"]
    assert answer["joints"][4]["fitted_rms"] <= answer["joints"][4]["error_rms"]
    assert any("break-away friction" in line for line in answer["left_out"])
    out = told(capsys, *given, "--to", "urdf", "--out", "a/b").out
    assert_printed(__file__, "export_urdf", out)
    assert run(*given, "--to", "constants", "--out", "c/friction.json") == 0
    places = {
        ".": "ur5_pick_and_place.mjcf.xml",
        "a/b": "ur5_pick_and_place.constants.urdf",
        "c": "friction.json",
    }
    files = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert len(files) == 2 * len(places)  # each folder has its record
    assert all(results_in(folder)[-1] == file for folder, file in places.items())


def test_bad_input_is_one_line_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("three_link.yaml", "three_link.urdf"):
        (tmp_path / name).write_bytes((ROBOTS / name).read_bytes())
    before = (tmp_path / "three_link.urdf").read_bytes()
    same = "export", "three_link.yaml", "--to", "urdf", "--out", "three_link.urdf"
    assert "three_link.urdf: is an input of this command" in refused(capsys, *same)
    assert run("export", "four_bar", "--to", "mjcf") == 2
    assert run("export", "three_link.yaml", "--to", "stl") == 2
    assert sorted(p.name for p in tmp_path.iterdir()) == ["three_link.urdf", "three_link.yaml"]
    assert (tmp_path / "three_link.urdf").read_bytes() == before


def test_the_command_writes_a_header_and_its_test_and_says_what_constants_miss(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    given = "export", "ur10_machine_tending", "--trajectory", "ur10_machine_tending", "--to", "cpp"
    frames = "--frame", "tool0", "--frame", "wrist_1_link"
    out = told(capsys, *given, *frames, "--out", "made").out
    assert_printed(__file__, "export_cpp", out)
    name = "pinfric_ur10_machine_tending"
    assert results_in("made") == [f"{name}.hpp", f"{name}_test.cpp"]
    text = Path("made", f"{name}.hpp").read_text()
    assert 'frames[] = {"tool0", "wrist_1_link"}' in text
    answer = result_of(told(capsys, *given, "--json", "--out", "again").out)
    joints = {joint["joint"]: joint for joint in answer["joints"]}
    lift, wrist = joints["shoulder_lift_joint"], joints["wrist_3_joint"]
    assert lift["error_rms"] > 1.0 > 0.1 > wrist["error_rms"]  # the lift carries, the wrist not
    error = refused(capsys, "export", "four_bar", "--to", "cpp")
    assert "the loop 'rocker_pin'" in error
    assert run(*given, "--frame", "tol0", "--out", "none") == 2
    assert not Path("none").exists()
    assert run("export", "so101", "--to", "mjcf", "--frame", "gripper") == 2


def test_coupled_drives_are_exported_without_constants():
    made = pf.export(rich(7, couples=True), to="cpp")
    assert made.joints == ()
    assert "coupled" in str(export_report(made)[0])
    assert "Exported" in repr(made)
    assert len(made.summary()) == 0
