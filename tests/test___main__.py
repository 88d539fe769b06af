"""The start of a process: help without heavy imports."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib

from cli_cases import ROOT, run


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


def test_the_list_of_commands_is_whole_and_options_have_short_names(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert run("-h") == 0
    assert "..." not in capsys.readouterr().out.replace("[ARGS]...", "")
    assert run("-V") == run("--version") == 0
    assert len(set(capsys.readouterr().out.splitlines())) == 1
