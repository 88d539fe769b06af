"""What every command does the same way: errors, interrupts, pipes, help."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli_cases import ROOT, run

from pinfric import __version__, cli, terminal


def shell(*arguments, **options):
    code = "from pinfric.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        **options,
    )


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


@pytest.mark.slow
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


def test_quiet_leaves_verdicts_and_errors(capsys, tmp_path):
    command = ("inverse", "pendulum", "pendulum", "--out", str(tmp_path))
    assert run(*command) == 0
    loud = capsys.readouterr()
    assert "wrote" in loud.err
    verdict = "all 2801 samples solved; efforts are within the URDF's limits\n"
    assert loud.out.startswith(verdict)
    assert run("-q", *command) == 0
    assert capsys.readouterr() == (verdict, "")
    assert run(*command, "--quiet") == 0
    assert capsys.readouterr() == (verdict, "")
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
