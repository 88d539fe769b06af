"""The command line as a shell sees it: exit codes, streams, JSON, files, what it imports."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from envelopes import result_of, validated

from pinfric import __version__, cli, terminal

ROOT = Path(__file__).parents[1]
URDF = """<robot name="arm">
  <link name="base"/>
  <link name="link"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="link"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>"""
SCENE = """
pinfric: 1
robot: {urdf: arm.urdf}
friction: {shoulder: {bearing: {kind: pin, radius: 0.05}, mu: {static: 0.2, kinetic: 0.1}}}
"""
WAY = """
pinfric_trajectory: 1
sample_rate: 50
points:
  - {q: [0.0], hold: 0.2}
  - {q: [1.0], duration: 1.0, hold: 0.4}
"""


@pytest.fixture
def files(tmp_path, monkeypatch):
    for name, text in (("arm.urdf", URDF), ("arm.yaml", SCENE), ("way.yaml", WAY)):
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path


def run(*arguments):
    """Exit code of `pinfric ARGUMENTS`, in this process."""
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    return ended.value.code


def shell(*arguments, **options):
    code = "from pinfric.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        **options,
    )


def test_table_is_printed_within_80_columns(files, capsys):
    assert run("inverse", "arm.yaml", "way.yaml") == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "shoulder" in out
    assert "1 of 1 joint with friction stick, in 2 intervals" in out
    assert max(map(len, out.splitlines())) <= 80


def test_json_has_the_figures_of_every_joint(files, capsys):
    assert run("inverse", "arm.yaml", "way.yaml", "--json") == 0
    envelope = validated(capsys.readouterr().out)
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


def test_numbers_that_are_none_are_null():
    from pinfric.model.described import in_json

    given = {"a": np.array([1.0, np.nan]), "b": np.float64("inf"), "c": [np.int64(3), True, None]}
    assert json.dumps(in_json(given), allow_nan=False) == (
        '{"a": [1.0, null], "b": null, "c": [3, true, null]}'
    )


@pytest.mark.parametrize(
    ("x", "text"),
    [
        (0, "0"),
        (9.996, "10.0"),
        (0.0123456, "0.0123"),
        (-1234.5, "-1234"),
        (1.2e-7, "1.20e-7"),
        (float("nan"), "n/a"),
        (99.95, "100"),
        (3e9, "3.00e9"),
        (12345.6, "12346"),
        (99999.4, "1.00e5"),
        (123456.0, "1.23e5"),
        (-123456.0, "-1.23e5"),
    ],
)
def test_figures_have_three_digits(x, text):
    from pinfric.show.report.values import digits

    assert digits(x) == text


def test_out_holds_efforts_figure_and_summary(files, capsys):
    assert run("inverse", "arm.yaml", "way.yaml", "--json", "--out", "results/run1") == 0
    out, err = capsys.readouterr()
    folder = files / "results" / "run1"
    assert sorted(p.name for p in folder.iterdir()) == [
        "efforts.csv",
        "efforts.png",
        "summary.json",
    ]
    assert json.loads((folder / "summary.json").read_text()) == json.loads(out)
    efforts = pd.read_csv(folder / "efforts.csv")
    peak = efforts[["shoulder.effort_lower", "shoulder.effort_upper"]].abs().to_numpy().max()
    assert result_of(out)["joints"][0]["peak"] == pytest.approx(peak)
    assert (folder / "efforts.png").read_bytes().startswith(b"\x89PNG")
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
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "out") == 2
    assert "out: cannot be written: No space left on device" in capsys.readouterr().err
    assert {p.name: p.read_bytes() for p in (files / "out").iterdir()} == before
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "new/deep") == 2
    assert sorted(p.name for p in files.iterdir()) == listing


def test_out_that_is_a_file_is_refused_before_any_work(files, capsys, monkeypatch):
    monkeypatch.setattr(
        "pinfric.model.scene_file.load_scene", lambda _: pytest.fail("work was done")
    )
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "arm.yaml") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "arm.yaml: cannot be written" in error


def test_folder_in_the_place_of_a_result_leaves_the_old_results(files, capsys):
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "out") == 0
    (files / "out" / "efforts.png").unlink()
    (files / "out" / "efforts.png").mkdir()
    before = (files / "out" / "efforts.csv").stat()
    capsys.readouterr()
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "out") == 2
    error = capsys.readouterr().err
    assert "out: cannot be written: it contains a folder efforts.png" in error
    assert error.count("\n") == 1
    assert (files / "out" / "efforts.csv").stat() == before


@pytest.mark.parametrize("place", [0, 1, 3])
def test_name_no_file_system_takes_is_one_short_line(files, capsys, place):
    arguments = ["arm.yaml", "way.yaml", "--out", "out"]
    arguments[place] = "x" * 5000
    assert run("inverse", *arguments) == 2
    error = capsys.readouterr().err
    assert "File name too long" in error
    assert error.count("\n") == 1
    assert len(error) < 300


def test_defect_is_one_line_unless_a_traceback_is_asked_for(files, capsys, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("first line\nsecond line" + 999 * " long")

    monkeypatch.setattr("pinfric.dynamics.inverse.inverse.inverse_dynamics", broken)
    assert run("inverse", "arm.yaml", "way.yaml") == cli.INTERNAL_ERROR == 70
    error = capsys.readouterr().err
    assert error.startswith("pinfric: internal error: ZeroDivisionError: first line second line")
    assert error.endswith("; run with PINFRIC_TRACEBACK=1 to see where\n")
    assert error.count("\n") == 1
    assert len(error) < 350
    monkeypatch.setenv("PINFRIC_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        cli.main(["inverse", "arm.yaml", "way.yaml"])


def test_rounding_is_printed_as_zero(capsys):
    # the UR5's last axis is upright all the way: what RNEA leaves there, 2e-12 N m, is rounding
    assert run("inverse", "ur5_pick_and_place", "ur5_pick_and_place.csv") == 0
    lines = capsys.readouterr().out.splitlines()
    effort = next(line for line in lines if line.startswith("wrist_3"))
    assert " 0, 0 " in effort
    assert not any("e-" in line for line in lines)


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
    assert run("inverse", scene, trajectory) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    firsts = [line.split()[0] for line in lines if line.strip()]
    for name in short_names(pf.load_scene(scene).actuator_names).values():
        assert firsts.count(name) == 2  # at the joint, at the motor's shaft


def test_warning_is_one_line_on_stderr_and_in_the_json(files, capsys):
    (files / "arm.yaml").write_text(SCENE.replace("0.05", "50"))  # mm for m
    assert run("inverse", "arm.yaml", "way.yaml", "--json") == 0
    out, err = capsys.readouterr()
    assert err.startswith("pinfric: warning: ")
    assert err.count("\n") == 1
    assert "bearing.radius" in err
    assert validated(out)["warnings"] == [err.removeprefix("pinfric: warning: ").rstrip()]


@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        (["nope"], "nope"),
        (["inverse"], "SCENE"),
        (["inverse", "a", "b", "--jsn"], "--jsn"),
        (["inverse", "a", "b", "--threads", "0"], "--threads"),
    ],
)
def test_wrong_usage_is_one_line(arguments, culprit, capsys):
    assert run(*arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("pinfric: error: ")
    assert culprit in err
    assert err.count("\n") == 1


def test_help_and_version(capsys):
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    for arguments, expected in (
        ((), "inverse"),
        (("--help",), "inverse"),
        (("inverse", "--help"), "--threads"),
        (("--version",), declared),
    ):
        assert run(*arguments) == 0
        assert expected in capsys.readouterr().out


def test_importing_the_command_line_imports_nothing_heavy():
    heavy = "numpy", "pinocchio", "numba", "matplotlib", "pandas", "pydantic", "yaml", "scipy"
    code = f"import sys, pinfric.cli; print([m for m in {heavy} if m in sys.modules])"
    out = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert out.stdout.strip() == "[]"


@pytest.mark.parametrize("form", [["--json"], []])
def test_reader_that_leaves_early_sees_no_traceback(files, form):
    process = shell("inverse", "arm.yaml", "way.yaml", *form)
    process.stdout.close()  # before anything is printed
    assert process.stderr.read() == b""
    assert process.wait(60) == terminal.NO_READER


def test_interrupt_exits_130_with_one_line(files, capsys, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("pinfric.dynamics.inverse.inverse.inverse_dynamics", stopped)
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "out") == cli.INTERRUPTED == 130
    assert capsys.readouterr().err == "pinfric: error: interrupted\n"
    assert not (files / "out").exists()


def test_size_prints_each_joints_demand_and_choice(capsys, tmp_path):
    with pytest.raises(SystemExit) as stop:
        cli.main(
            [
                "size",
                "panda_pick_and_place",
                "panda_pick_and_place.csv",
                "--catalog",
                "default",
                "--json",
                "--out",
                str(tmp_path / "out"),
            ]
        )
    assert stop.value.code == 0
    joints = result_of(capsys.readouterr().out)["joints"]
    keys = {"peak", "rms", "breakaway", "holding", "speed", "choice", "installed", "rejected"}
    assert len(joints) == 7
    assert all(keys <= joint.keys() for joint in joints)
    assert all(len(joint["holding"]) == 2 for joint in joints)
    assert joints[1]["rejected"][0]["why"]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "sizing.json",
        "report.html",
        "bom.csv",
    }


def test_size_takes_several_cycles_and_refuses_shares_that_do_not_add_up(files, capsys):
    size = ("size", "arm.yaml", "--cycle", "way.yaml:0.7", "--cycle", "way.yaml:")
    assert run(*size[:-1], "way.yaml:0.3", "--period", "100", "--on", "0.5", "--json") == 0
    found = result_of(capsys.readouterr().out)
    assert found["cycle_time"] == pytest.approx(100.0)
    assert found["off"] == pytest.approx(50.0)
    times = [cycle["repeats"] for cycle in found["cycles"]]
    assert times[0] / times[1] == pytest.approx(7 / 3)
    assert run(*size[:-1], "way.yaml:0.2") == cli.BAD_INPUT
    error = "pinfric: error: duty: the shares 0.7, 0.2 add up to 0.9; "
    assert capsys.readouterr().err.startswith(error)
    assert run("size", "arm.yaml") == cli.BAD_INPUT
    assert "give one TRAJECTORY" in capsys.readouterr().err


SWEEP = """
pinfric_sweep: 1
samples: 20
seed: 1
parameters:
  friction.shoulder.mu: {lognormal: {median: 1.0, sigma: 0.3}}
  speed: {uniform: {low: 0.9, high: 1.1}}
motors: {shoulder: {peak_torque: 40.0}}
"""


def test_sweep_prints_tables_and_writes_samples_figure_and_summary(files, capsys):
    (files / "s.yaml").write_text(SWEEP)
    assert run("sweep", "arm.yaml", "way.yaml", "s.yaml", "--out", "out") == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("arm · way.yaml: 20 random samples\n")
    assert "most influential parameters at the joints: rank correlation" in printed.out
    names = {"samples.parquet", "sweep.png", "summary.json"}
    assert {p.name for p in (files / "out").iterdir()} == names
    assert run("sweep", "arm.yaml", "way.yaml", "s.yaml", "--out", "out", "--json") == 0
    again = capsys.readouterr()
    assert "20 cycles, 20 of them from before" in again.err
    summary = validated(again.out)
    assert summary == json.loads((files / "out" / "summary.json").read_text())
    frame = pd.read_parquet(files / "out" / "samples.parquet")
    peak = summary["result"]["joints"][0]["peak"]["percentiles"]["95"]
    assert peak == pytest.approx(np.percentile(frame["shoulder.peak"], 95))


@pytest.mark.parametrize(
    ("change", "arguments", "words"),
    [
        (("speed:", "sped:"), [], "s.yaml: `parameters.sped`: unknown parameter; did you mean"),
        (("samples:", "sample:"), [], "did you mean 'samples'?"),
        (("low: 0.9", "low: -0.9"), [], "a speed factor must be above 0"),
        (("sigma: 0.3", "sigma: -0.3"), [], "lognormal.sigma"),
        (("", ""), ["--scheduler", "tcp://127.0.0.1:1"], "tcp://127.0.0.1:1 cannot be reached"),
        (("", ""), ["--scheduler", "tcp://h:1", "--processes", "2"], "either `scheduler` or"),
        (("", ""), ["--processes", "0"], "--processes"),
    ],
)
def test_sweep_that_cannot_be_is_one_line_and_exit_code_2(
    files, capsys, monkeypatch, change, arguments, words
):
    monkeypatch.setattr("pinfric.study.sweep.workers._CONNECT_TIMEOUT", 0.5)
    (files / "s.yaml").write_text(SWEEP.replace(*change, 1))
    assert run("sweep", "arm.yaml", "way.yaml", "s.yaml", *arguments) == cli.BAD_INPUT == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("pinfric: error: ")
    assert printed.err.count("\n") == 1
    assert words in printed.err


def test_sweep_into_the_folder_of_another_is_refused(files, capsys):
    (files / "s.yaml").write_text(SWEEP)
    assert run("sweep", "arm.yaml", "way.yaml", "s.yaml", "--out", "out") == 0
    (files / "s.yaml").write_text(SWEEP.replace("seed: 1", "seed: 2"))
    assert run("sweep", "arm.yaml", "way.yaml", "s.yaml", "--out", "out") == 2
    assert "holds samples of another sweep (different: sweep)" in capsys.readouterr().err


def test_the_list_of_commands_is_whole_and_options_have_short_names(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert run("-h") == 0
    assert "..." not in capsys.readouterr().out.replace("[ARGS]...", "")
    assert run("-V") == run("--version") == 0
    assert len(set(capsys.readouterr().out.splitlines())) == 1


def test_quiet_leaves_results_and_errors(capsys, tmp_path):
    command = ("inverse", "pendulum", "pendulum", "--out", str(tmp_path))
    assert run(*command) == 0
    loud = capsys.readouterr()
    assert "wrote" in loud.err
    assert run("-q", *command) == 0
    assert capsys.readouterr() == (loud.out, "")
    assert run(*command, "--quiet") == 0
    assert capsys.readouterr() == (loud.out, "")
    assert run("-q", "inverse", "pendulum", "nowhere.csv") == cli.BAD_INPUT
    assert "there is no file" in capsys.readouterr().err


def test_verbose_adds_files_versions_and_time(capsys):
    assert run("check", "pendulum", "-v") == 0
    lines = capsys.readouterr().err.splitlines()
    assert [Path(line).name for line in lines[:2]] == ["pendulum.yaml", "pendulum.urdf"]
    assert lines[2].startswith(f"pinfric: versions: pinfric {__version__}, Python 3.")
    assert lines[3].startswith("pinfric: took ")
    assert run("-v", "check", "nowhere.yaml") == cli.BAD_INPUT
    assert capsys.readouterr().err.splitlines()[-1].startswith("pinfric: error: there is no file")
