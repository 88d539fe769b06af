"""The command line as a shell sees it: exit codes, streams, JSON, files, what it imports."""

import hashlib
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import SCENE, refused, results_in, run, told
from envelopes import result_of, validated
from printed import assert_printed
from tables import table

from pinfric import cli


def test_table_is_printed_within_80_columns(files, capsys):
    out, err = told(capsys, "inverse", "arm.yaml", "way.yaml")
    assert err == ""
    assert max(map(len, out.splitlines())) <= 80
    assert_printed(__file__, "inverse", out)


def test_json_has_the_figures_of_every_joint(files, capsys):
    envelope = validated(told(capsys, "inverse", "arm.yaml", "way.yaml", "--json").out)
    answer = envelope["result"]
    assert (envelope["scene"], answer["trajectory"]) == ("arm.yaml", "way.yaml")
    assert {"arm.yaml", "way.yaml"} <= envelope["inputs"].keys()
    content = Path("arm.yaml").read_bytes()
    assert envelope["inputs"]["arm.yaml"] == hashlib.sha256(content).hexdigest()
    (joint,) = answer["joints"]
    assert {
        "name",
        "unit",
        "peak",
        "rms",
        "rms_least",
        "rms_frictionless",
        "peak_frictionless",
        "friction_share",
        "stick_time",
        "max_interval",
        "motor_peak",
    } <= joint.keys()
    # held out level: weight 2 kg x 9.81 at 0.5 m; pin 0.05 m, mu 0.2 under 19.62 N
    assert joint["max_interval"] == pytest.approx(2 * 0.2 * 0.05 * 19.62)
    assert joint["stick_time"] == pytest.approx(0.6)
    assert [(i["site"], i["start"], i["end"]) for i in answer["stick_intervals"]] == [
        ("shoulder", pytest.approx(0.0), pytest.approx(0.2)),
        ("shoulder", pytest.approx(1.2), pytest.approx(1.6)),
    ]
    assert envelope["warnings"] == []


def test_out_holds_efforts_figure_and_summary(files, capsys):
    out, err = told(capsys, "inverse", "arm.yaml", "way.yaml", "--json", "--out", "results/run1")
    folder = files / "results" / "run1"
    assert results_in(folder) == [
        "efforts.csv",
        "efforts.pdf",
        "efforts.png",
        "summary.json",
    ]
    assert json.loads((folder / "summary.json").read_text()) == json.loads(out)
    efforts = pd.read_csv(folder / "efforts.csv")
    peak = efforts[["shoulder.effort_lower", "shoulder.effort_upper"]].abs().to_numpy().max()
    assert result_of(out)["joints"][0]["peak"] == pytest.approx(peak)
    assert (folder / "efforts.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "efforts.pdf").read_bytes().startswith(b"%PDF")
    assert err.startswith("pinfric: wrote ")


def test_failure_while_writing_leaves_the_old_results_and_nothing_half(files, capsys, monkeypatch):
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "out") == 0
    before = {p.name: p.read_bytes() for p in (files / "out").iterdir()}
    listing = sorted(p.name for p in files.iterdir())
    from matplotlib.figure import Figure

    def full(self, path, **_):
        Path(path).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", full)
    capsys.readouterr()
    assert "out: cannot be written: No space left on device" in refused(
        capsys, "inverse", "arm.yaml", "way.yaml", "--out", "out"
    )
    assert {p.name: p.read_bytes() for p in (files / "out").iterdir()} == before
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "new/deep") == 2
    assert sorted(p.name for p in files.iterdir()) == listing


def test_out_that_is_a_file_is_refused_before_any_work(files, capsys, monkeypatch):
    monkeypatch.setattr(
        "pinfric.model.scene_file.load_scene", lambda _: pytest.fail("work was done")
    )
    error = refused(capsys, "inverse", "arm.yaml", "way.yaml", "--out", "arm.yaml")
    assert "arm.yaml: cannot be written" in error


def test_folder_in_the_place_of_a_result_leaves_the_old_results(files, capsys):
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "out") == 0
    (files / "out" / "efforts.png").unlink()
    (files / "out" / "efforts.png").mkdir()
    before = (files / "out" / "efforts.csv").stat()
    capsys.readouterr()
    error = refused(capsys, "inverse", "arm.yaml", "way.yaml", "--out", "out")
    assert "out: cannot be written: it contains a folder efforts.png" in error
    assert (files / "out" / "efforts.csv").stat() == before


@pytest.mark.parametrize("place", [0, 1, 3])
def test_name_no_file_system_takes_is_one_short_line(files, capsys, place):
    arguments = ["arm.yaml", "way.yaml", "--out", "out"]
    arguments[place] = "x" * 5000
    error = refused(capsys, "inverse", *arguments)
    assert "File name too long" in error
    assert len(error) < 300


@pytest.mark.parametrize(
    ("scene", "trajectory"),
    [("ur5_pick_and_place", "ur5_pick_and_place.csv"), ("so101", "so101.waypoints.yaml")],
)
def test_bundled_robots_have_one_line_per_joint_at_80_columns(
    scene, trajectory, capsys, monkeypatch
):
    import pinfric as pf
    from pinfric.show.report.names import short_names

    monkeypatch.setenv("COLUMNS", "80")
    lines = told(capsys, "inverse", scene, trajectory).out.splitlines()
    assert max(map(len, lines)) <= 80
    firsts = [line.split()[0] for line in lines if line.strip()]
    for name in short_names(pf.load_scene(scene).actuator_names).values():
        assert firsts.count(name) == 2  # at the joint, at the motor's shaft


def test_warning_is_one_line_on_stderr_and_in_the_json(files, capsys):
    (files / "arm.yaml").write_text(SCENE.replace("0.05", "5"))  # cm for m
    out, err = told(capsys, "inverse", "arm.yaml", "way.yaml", "--json")
    assert err.startswith("pinfric: warning: ")
    assert err.count("\n") == 1
    assert "bearing.radius" in err
    assert validated(out)["warnings"] == [err.removeprefix("pinfric: warning: ").rstrip()]


@pytest.mark.slow
def test_size_prints_each_joints_demand_and_choice(capsys, tmp_path):
    given = "panda_pick_and_place", "panda_pick_and_place.csv", "--catalog", "default"
    said = told(capsys, "size", *given, "--json", "--out", tmp_path / "out")
    joints = result_of(said.out)["joints"]
    keys = {"peak", "rms", "breakaway", "holding", "speed", "choice", "installed", "candidates"}
    assert len(joints) == 7
    assert all(keys <= joint.keys() for joint in joints)
    assert all(len(joint["holding"]) == 2 for joint in joints)
    assert joints[1]["next_smaller"]["why"]
    assert set(results_in(tmp_path / "out")) == {
        "sizing.json",
        "report.html",
        "bom.csv",
        "sized.scene.yaml",
        "motors.yaml",
    }


def test_size_takes_conditions(capsys, tmp_path):
    size = ("size", "pendulum", "pendulum", "--catalog", "default", "--json")
    asked = ("--condition", "peak_factor=1.7", "--condition", "holding_brake=all")
    (joint,) = result_of(told(capsys, *size, *asked, "--out", str(tmp_path / "out")).out)["joints"]
    assert joint["installed"]["brake"]
    (peak,) = (c for c in joint["installed"]["criteria"] if c["name"] == "peak torque")
    (joint,) = result_of(told(capsys, *size).out)["joints"]
    (usual,) = (c for c in joint["installed"]["criteria"] if c["name"] == "peak torque")
    assert peak["required"] == pytest.approx(usual["required"] * 1.7 / 1.2)
    assert "--condition peak_factor=1.7" in (tmp_path / "out/report.html").read_text()
    assert "'peak_factor': should be NAME=VALUE" in refused(
        capsys, *size, "--condition", "peak_factor"
    )
    assert "conditions: unknown key `peak`" in refused(capsys, *size, "--condition", "peak=2")
    # a mapping as files have it
    named = refused(capsys, *size, "--condition", "bearings={elbow: THK RB 5013}")
    assert "conditions.bearings: there is no drive 'elbow'" in named
    assert "should be NAME=VALUE" in refused(capsys, *size, "--condition", "bearings={elbow: ")


def test_size_takes_several_cycles_and_refuses_shares_that_do_not_add_up(files, capsys):
    size = ("size", "arm.yaml", "--cycle", "way.yaml:0.7", "--cycle", "way.yaml:")
    found = result_of(
        told(capsys, *size[:-1], "way.yaml:0.3", "--period", "100", "--on", "0.5", "--json").out
    )
    assert found["cycle_time"] == pytest.approx(100.0)
    assert found["off"] == pytest.approx(50.0)
    times = [cycle["repeats"] for cycle in found["cycles"]]
    assert times[0] / times[1] == pytest.approx(7 / 3)
    assert run(*size[:-1], "way.yaml:0.2") == cli.BAD_INPUT
    error = "pinfric: error: duty: the shares 0.7, 0.2 add up to 0.9; "
    assert capsys.readouterr().err.startswith(error)
    assert "give one TRAJECTORY" in refused(capsys, "size", "arm.yaml")
    hung = (files / "arm.yaml").read_text().replace("arm.urdf", "arm.urdf, gravity: [0, 0, 9.81]")
    (files / "hung.yaml").write_text(hung)
    mounted = ("--cycle", "way.yaml", "--cycle", "hung.yaml:way.yaml")
    hardest = result_of(told(capsys, "size", "arm.yaml", *mounted, "--json").out)["mountings"]
    assert [one["rms_in"] in ("arm.yaml", "hung.yaml") for one in hardest] == [True]
    assert "give one of SCENE itself" in refused(capsys, "size", "arm.yaml", *mounted[2:])


SWEEP = """
pinfric_sweep: 1
samples: 20
seed: 1
parameters:
  friction.shoulder.mu: {lognormal: {median: 1.0, sigma: 0.3}}
  speed: {uniform: {low: 0.9, high: 1.1}}
motors: {shoulder: {drive: Kollmorgen TBM-6051-A + Harmonic Drive CSF-17-100}}
"""


def test_sweep_prints_tables_and_writes_samples_figure_and_summary(files, capsys):
    (files / "s.yaml").write_text(SWEEP)
    printed = told(capsys, "sweep", "arm.yaml", "way.yaml", "s.yaml", "--out", "out")
    assert_printed(__file__, "sweep", printed.out)
    names = {"samples.csv", "sweep.pdf", "sweep.png", "summary.json"}
    assert set(results_in(files / "out")) == names
    again = told(capsys, "sweep", "arm.yaml", "way.yaml", "s.yaml", "--out", "out", "--json")
    summary = validated(again.out)
    assert summary == json.loads((files / "out" / "summary.json").read_text())
    frame = pd.read_csv(files / "out" / "samples.csv")
    peak = summary["result"]["joints"][0]["peak"]["percentiles"]["95"]
    assert peak == pytest.approx(np.percentile(frame["shoulder.peak"], 95))


SWEPT = """
speed:      sped:        -q  s.yaml: `parameters.sped`: unknown parameter
samples:    sample:      -q  'samples'?
low: 0.9    low: -0.9    -q  a speed factor must be above 0
sigma: 0.3  sigma: -0.3  -q  lognormal.sigma
speed:      speed:  --cluster tcp://127.0.0.1:1          no Dask scheduler answers at tcp://127.0.0.1:1
speed:      speed:  --cluster tcp://h:1 --processes 2    has its own processes
speed:      speed:  --processes 0                        --processes
"""


@pytest.mark.parametrize(("old", "new", "arguments", "words"), table(SWEPT))
def test_sweep_that_cannot_be_is_one_line_and_exit_code_2(
    files, capsys, monkeypatch, old, new, arguments, words
):
    monkeypatch.setattr("pinfric.sweeps.workers._CONNECT_TIMEOUT", 0.5)
    (files / "s.yaml").write_text(SWEEP.replace(old, new, 1))
    assert run("sweep", "arm.yaml", "way.yaml", "s.yaml", *arguments.split()) == cli.BAD_INPUT == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("pinfric: error: ")
    assert printed.err.count("\n") == 1
    assert words in printed.err


def test_names_that_are_not_utf_8_hold_results(files, capsys):
    """Of JSON, tables and pictures; before, JSON ended in an internal error."""
    folder = files / os.fsdecode(b"robot \xff")
    folder.mkdir()
    for name in ("arm.urdf", "arm.yaml", "way.yaml"):
        shutil.copy(files / name, folder)
    scene, way = str(folder / "arm.yaml"), str(folder / "way.yaml")
    assert run("inverse", scene, way, "--out", str(folder / "found")) == 0
    written = json.loads((folder / "found/summary.json").read_text(encoding="utf-8"))
    assert written["scene"] == scene
    (files / "vary.yaml").write_text(SWEEP)
    assert run("sweep", "arm.yaml", "way.yaml", "vary.yaml", "--out", str(folder / "vary")) == 0
    assert (folder / "vary/samples.csv").stat().st_size > 0
    assert "internal" not in capsys.readouterr().err


def test_a_name_without_letters_in_any_font_is_one_line(files, capsys):
    for name in ("arm.urdf", "arm.yaml"):
        text = (files / name).read_text().replace("shoulder", "\U00012000\U00012001")
        (files / name).write_text(text)
    said = told(capsys, "inverse", "arm.yaml", "way.yaml", "--out", "found").err
    assert "Glyph" not in said
    assert said.count("the pictures show boxes for letters of names that no font here has") == 1


@pytest.mark.parametrize("arguments", [(), ("pendulum", "--all")])
def test_warm_up_takes_a_scene_or_all(capsys, arguments):
    assert "give a scene, or --all" in told(capsys, "warm-up", *arguments, code=2).err


@pytest.mark.slow
def test_after_warm_up_of_all_nothing_is_compiled(capsys):
    told(capsys, "warm-up", "--all")
    assert "compiling" not in told(capsys, "retime", *["panda_pick_and_place"] * 2).err
