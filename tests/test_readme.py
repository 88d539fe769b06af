"""The README says what is true: its commands, its example, its names and its scene."""

from __future__ import annotations

import dataclasses
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import pinfric as pf
from pinfric import cli
from pinfric.dynamics.result import InverseResult
from pinfric.dynamics.states import States

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)


def test_set_up_is_two_commands_of_one_line():
    commands = blocks("bash")[:2]
    assert [command.count("\n") for command in commands] == [1, 1]
    install = 'python3 -m venv .venv && .venv/bin/pip install -q -e ".[test]" && '
    assert all(command.startswith(install) for command in commands)
    job, tests = (command.removeprefix(install).split() for command in commands)
    assert job[:2] == [".venv/bin/pinfric", "inverse"]
    assert all((ROOT / file).is_file() for file in job[2:])
    assert tests == [".venv/bin/python", "-m", "pytest"]


def test_sample_is_what_the_first_command_prints(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "80")
    arguments = blocks("bash")[0].split("pinfric ")[1].split()
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 0
    printed = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert printed == blocks("text")[0].splitlines()


def test_python_example_runs():
    (example,) = blocks("python")
    assert len(example.splitlines()) == 10
    run = subprocess.run([sys.executable, "-c", f"import sys; sys.path.insert(0, '.')\n{example}"],
                         cwd=ROOT, capture_output=True, text=True)  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert "panda_joint2 sticks from 0.00 s to 0.20 s" in run.stdout
    assert not re.search(r"from (\S+) s to \1 s", run.stdout)  # passages through rest
    assert "Check(equilibrium=" in run.stdout


def test_symbols_are_the_names_in_the_code():
    table = README.split("## Symbols")[1].split("## ")[0]
    rows = [line for line in table.splitlines() if line.startswith("| `")]
    names = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    fields = {f.name for kind in (InverseResult, States) for f in dataclasses.fields(kind)}
    assert set(names) <= fields
    results = {f.name for f in dataclasses.fields(InverseResult)} - {"scene", "states", "external"}
    assert results <= set(names)


def test_way_to_the_solver_exists():
    hops = README.split("in four hops:")[1].split("## ")[0]
    files = re.findall(r"\[`(pinfric/[\w/]+\.py)`\]\(([\w/.]+)\)", hops)
    assert len(files) == 10
    assert all(shown == target and (ROOT / target).is_file() for shown, target in files)
    modules = [importlib.import_module(f[:-3].replace("/", ".")) for f, _ in files]
    named = {"load_scene", "inverse_dynamics", "solve_tree", "reactions", "make_twin", "embed",
             "friction_bounds", "forward_dynamics", "solve_instant"}  # fmt: skip
    for name in named:
        assert f"`{name}`" in hops
        assert any(hasattr(module, name) for module in modules)


def test_scene_in_the_readme_loads(tmp_path):
    (scene_text,) = blocks("yaml")
    (tmp_path / "scene.yaml").write_text(scene_text)
    scene = pf.load_scene(tmp_path / "scene.yaml")
    assert scene.site_names == ("shoulder_lift_joint", "elbow_joint")
    assert len(scene.drives) == 4
