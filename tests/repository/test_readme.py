"""README and guide are true: their commands, examples, names and files."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer
import yaml
from cli_cases import told

import pinfric as pf
from pinfric import cli
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import States

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "notebooks/guide"
README = ROOT / "README.md"
PAGES = [README, *sorted(GUIDE.glob("*.md"))]


def blocks(language, page=README):
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


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
    printed = [line.rstrip() for line in told(capsys, *arguments).out.splitlines()]
    assert printed == blocks("text")[0].splitlines()
    assert blocks("text", GUIDE / "first_result.md") == blocks("text")


@pytest.mark.slow
def test_python_example_runs():
    (example,) = blocks("python")
    assert example in blocks("python", GUIDE / "python.md")
    assert len(example.splitlines()) == 10
    (compared,) = blocks("python", GUIDE / "first_result.md")
    code = f"import sys; sys.path.insert(0, '.')\n{example}\n{compared}"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "shoulder_pan_joint sticks from 0.00 s to 0.20 s" in run.stdout
    assert not re.search(r"from (\S+) s to \1 s", run.stdout)  # passages through rest
    assert "equilibrium  " in run.stdout
    peaks = [ast.literal_eval(line) for line in run.stdout.splitlines() if line.startswith("{")]
    said = [
        (which[joint], joint)
        for which in reversed(peaks)
        for joint in ("shoulder_pan_joint", "wrist_3_joint")
    ]
    text = (GUIDE / "first_result.md").read_text(encoding="utf-8")
    assert all(f"{figure:.3f} " in text or f"{figure:.3f}." in text for figure, _ in said)
    shares = [
        f"{100 * (1 - peaks[1][j] / peaks[0][j]):.0f} %"
        for j in ("shoulder_pan_joint", "wrist_3_joint")
    ]
    assert all(share in README.read_text(encoding="utf-8") for share in shares)


@pytest.mark.slow
def test_a_linkage_goes_from_the_guides_drawing_to_torques(monkeypatch, tmp_path, capsys):
    page = GUIDE / "your_linkage.md"
    scene, motion, start = blocks("yaml", page)
    (robot,) = blocks("xml", page)
    files = {"four_bar.urdf": robot, "four_bar.yaml": scene, "crank.waypoints.yaml": motion}
    monkeypatch.chdir(tmp_path)
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    inverse, replay = commands(page)[-2:]
    searched = told(capsys, *inverse)
    assert blocks("text", page)[0].strip() in searched.err
    told(capsys, *replay)
    unsigned = told(capsys, "size", *inverse[1:], "--catalog", "default", code=cli.BAD_INPUT)
    assert "0 of 1 joints can be signed" in unsigned.out
    (tmp_path / "four_bar.yaml").write_text(scene + start)
    started = told(capsys, *inverse)
    assert started.out == searched.out
    assert not started.err
    signed = told(capsys, "size", *inverse[1:], "--catalog", "default")
    assert "1 of 1 joints can be signed" in signed.out


def commands(page):
    """The commands on a page, without set-up and prompts."""
    joined = re.sub(r"\\\n\s*", "", "\n".join(blocks("bash", page)))
    return [line.split("pinfric ")[1].split() for line in joined.splitlines() if "pinfric " in line]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_are_understood(page):
    """Parsed, not run: `.ci/wheel` runs them without the repository."""
    program = typer.main.get_command(cli.app)
    for arguments in commands(page):
        if arguments[0].startswith("--"):
            continue
        command = program.commands[arguments[0]]
        command.make_context(arguments[0], list(arguments[1:]))
    table = set(re.findall(r"^\| `pinfric ([\w-]+)", page.read_text("utf-8"), re.MULTILINE))
    assert not table or table == set(program.commands)


def rows_of_commands(page):
    """Command -> its description in a page's table, without links."""
    rows = re.findall(r"^\| (`pinfric .*?) \| (.*) \|$", page.read_text("utf-8"), re.MULTILINE)
    return {command: re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", text) for command, text in rows}


def test_the_guide_says_of_each_command_what_the_readme_says_and_more():
    short, long = rows_of_commands(README), rows_of_commands(GUIDE / "commands.md")
    assert list(short) == list(long)
    for command, text in short.items():
        assert long[command].startswith(text), command


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_that_pages_print_are_files(page):
    for text in blocks("yaml", page):
        assert isinstance(yaml.safe_load(text), dict)


def test_docstrings_of_inverse_results_explain_all_that_is_in_them():
    """They are the reference of Python names."""
    for kind in (InverseResult, States):
        fields = {f.name for f in dataclasses.fields(kind)}
        assert fields <= set(re.findall(r"\w+", kind.__doc__.split("Attributes:")[1]))


def test_way_to_the_solver_exists():
    text = (ROOT / "notebooks/architecture.md").read_text(encoding="utf-8")
    hops = text.split("in four hops:")[1].split("## ")[0]
    files = re.findall(r"\[`(pinfric/[\w/]+\.py)`\]\(\.\./([\w/.]+)\)", hops)
    assert len(files) == 10
    assert all(shown == target and (ROOT / target).is_file() for shown, target in files)
    modules = [importlib.import_module(f[:-3].replace("/", ".")) for f, _ in files]
    named = {
        "load_scene",
        "inverse_dynamics",
        "solve_tree",
        "reactions",
        "make_twin",
        "embed",
        "friction_bounds",
        "forward_dynamics",
        "solve_instant",
    }
    for name in named:
        assert f"`{name}`" in hops
        assert any(hasattr(module, name) for module in modules)


def test_scene_in_the_guide_loads(tmp_path):
    scene_text, gear, loops, springs = blocks("yaml", GUIDE / "scene.md")
    (tmp_path / "scene.yaml").write_text(scene_text)
    scene = pf.load_scene(tmp_path / "scene.yaml")
    assert scene.site_names == ("shoulder_lift_joint", "elbow_joint")
    assert len(scene.drives) == 4
    (entry,) = yaml.safe_load(gear)["friction"].values()
    static = pf.load_scene("pendulum").with_(friction={"joint_1": entry}).sites[0].law.static
    assert static.mu * 10.0 + static.forward == pytest.approx(2.85)
    (loop,) = pf.load_scene("four_bar").with_(**yaml.safe_load(loops)).loops
    assert (loop.name, loop.kind, loop.b.link) == ("rocker_pin", "planar_pin", "rocker")
    sprung = scene.with_(**yaml.safe_load(springs))
    assert sprung.site_names == ("balancer",)
    assert [spring.kind for spring in sprung.springs] == ["torsion", "hose", "tension"]
