"""Imports go one way, from model to the command line, without circles; the judge stands alone."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = Path(__file__).parents[2] / "pinfric"
LAYERS = [
    *("errors", "kernels", "model", "friction", "dynamics", "study", "show", "paper"),
    *("terminal", "cli", "__main__"),
]
#: Folders of `dynamics` in the order in which they may import.
DYNAMICS = ["samples", "problem", "judge", "inverse", "forward", "simulation"]
#: The files of `paper/` that are its formulation; the others set it beside ours.
JUDGE = ("bodies", "equations", "inverse", "forward", "simulate", "examples")
#: What a module may import from above, for type checkers: methods lead up through one module.
UPWARD = {("pinfric.model.upward", "pinfric.dynamics.forward.solver")}
#: Where the command line begins: it imports what a command needs when that command runs, so that
#: `pinfric --help` and a bad option take no time. Nothing imports these.
FRONT = {"pinfric.__main__", "pinfric.cli", "pinfric.terminal"}
#: Third parties that few calls need: who needs a module of ours that begins with one may wait.
HEAVY = {"distributed"}


class Import(NamedTuple):
    """One imported module: by whom, whether inside a function, whether for type checkers only."""

    by: str
    name: str
    late: bool
    typing: bool


def module_name(file: Path) -> str:
    parts = ("pinfric", *file.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


@cache
def trees() -> dict[str, ast.Module]:
    """The syntax of every module; when a test asks, not in each process that collects tests."""
    files = PACKAGE.rglob("*.py")
    return {module_name(f): ast.parse(f.read_text(encoding="utf-8")) for f in files}


def imports(module: str, node: ast.AST, late: bool, typing: bool) -> Iterator[Import]:
    """Every import below a node; `from package import module` is one of the module."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (Import(module, alias.name, late, typing) for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            for alias in child.names:
                inner = f"{child.module}.{alias.name}"
                if inner == "pinfric.__version__":
                    continue  # a text, not the package with all that is above
                yield Import(module, inner if inner in trees() else str(child.module), late, typing)
        else:
            inside = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)
            checked = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
            yield from imports(module, child, late or inside, typing or checked)


@cache
def all_imports() -> list[Import]:
    return [one for module, tree in trees().items() for one in imports(module, tree, False, False)]


def circle(edges: dict[str, set[str]]) -> list[str]:
    """The modules of one circle in the order in which they import each other, or none."""
    done: set[str] = set()

    def search(module: str, way: list[str]) -> list[str]:
        if module in way:
            return way[way.index(module) :]
        if module in done:
            return []
        for other in sorted(edges.get(module, ())):
            if found := search(other, [*way, module]):
                return found
        done.add(module)
        return []

    return next((found for module in sorted(edges) if (found := search(module, []))), [])


def test_no_module_imports_itself_by_way_of_others():
    """Late imports count: they hide a circle from Python, not from a reader."""
    edges: dict[str, set[str]] = {}
    for found in all_imports():
        if found.name in trees() and not found.typing:
            edges.setdefault(found.by, set()).add(found.name)
    assert circle(edges) == []
    assert sum(map(len, edges.values())) > 400  # the search has seen the package


def test_a_circle_is_found():
    assert circle({"a": {"b"}, "b": {"c", "d"}, "d": {"b"}}) == ["b", "d"]


def test_no_function_imports_a_module_of_ours():
    heavy = {i.by for i in all_imports() if not i.late and i.name.split(".")[0] in HEAVY}
    late = {
        (i.by, i.name)
        for i in all_imports()
        if i.late
        and i.name.split(".")[0] == "pinfric"
        and i.by not in FRONT
        and i.name not in heavy
    }
    assert late == set()


def test_nothing_imports_the_front():
    assert {i.by for i in all_imports() if i.name in FRONT} <= FRONT


def layer(module: str) -> int:
    parts = module.split(".")
    known = len(parts) > 1 and parts[1] in LAYERS
    return LAYERS.index(parts[1]) if known else len(LAYERS)  # a public name is of any room


def goes_up(found: list[Import]) -> set[tuple[str, str]]:
    """Imports from above the importer's own room."""
    return {
        (one.by, one.name)
        for one in found
        if one.name.split(".")[0] == "pinfric" and layer(one.name) > layer(one.by)
    }


def test_imports_go_down_the_list_only():
    assert goes_up([one for one in all_imports() if one.by != "pinfric"]) <= UPWARD


def test_the_rooms_of_dynamics_import_one_way():
    for one in all_imports():
        by, name = one.by.split(".")[1:3], one.name.split(".")[1:3]
        if by[:1] == name[:1] == ["dynamics"] and len(by) == 2:
            assert DYNAMICS.index(name[1]) <= DYNAMICS.index(by[1]), one


def test_the_judge_reads_results_only():
    judge = "pinfric.dynamics.judge."
    read = {one.name for one in all_imports() if one.by.startswith(judge)}
    others = {name for name in read if name.startswith("pinfric.dynamics")}
    assert {name for name in others if not name.startswith(judge)} == {
        "pinfric.dynamics.samples.outcome"
    }


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("import pinfric", {"pinfric"}),
        ("from pinfric import plot", {"pinfric"}),
        ("from pinfric import show", {"pinfric.show"}),
        ("from pinfric import __version__", set()),
        ("def f():\n    from pinfric.study import summary", {"pinfric.study.summary"}),
        ("from pinfric.errors import PinfricError", set()),
    ],
)
def test_the_package_as_a_whole_is_above_every_room(text, found):
    """Its public names are functions of all rooms: who imports it imports them."""
    read = list(imports("pinfric.model.brief", ast.parse(text), False, False))
    assert {name for _, name in goes_up(read)} == found


def patched(tree):
    """What a module writes into others that it imports: `other.name = ...`, `setattr(other, ...)`.

    And modules that are looked up by name.
    """
    imports = [n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom)]
    modules = {alias.asname or alias.name.split(".")[0] for node in imports for alias in node.names}
    for node in ast.walk(tree):
        targets = node.targets if isinstance(node, ast.Assign) else ()
        for target in targets:
            if isinstance(target, ast.Attribute) and ast.unparse(target.value) in modules:
                yield ast.unparse(target)
        if isinstance(node, ast.Call) and node.args:
            name, first = ast.unparse(node.func), ast.unparse(node.args[0])
            if name == "setattr" and first in modules:
                yield first
            elif name in ("import_module", "importlib.import_module", "__import__"):
                constant = isinstance(node.args[0], ast.Constant)
                if not constant or str(node.args[0].value).startswith("pinfric"):
                    yield f"{name}({first})"


#: Modules looked up by a name: the package's own table; an extra that may not be installed.
LOOKED_UP = {
    "pinfric": ["import_module(_PUBLIC[name])"],
    "pinfric.show.report.page": ["import_module(module)"],
}


def test_no_module_writes_into_another():
    """So that nothing of a room above comes into one below but through `model/upward.py`."""
    for name, tree in trees().items():
        allowed = [*LOOKED_UP.get(name, []), "warnings.showwarning"]
        assert [one for one in patched(tree) if one not in allowed] == [], name


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("from pinfric import model\nmodel.make_solver = 1", ["model.make_solver"]),
        ("import pinfric.model as m\nsetattr(m, 'x', 1)", ["m"]),
        (
            "from importlib import import_module\nimport_module('pinfric.show')",
            ["import_module('pinfric.show')"],
        ),
        ("import numpy as np\nx.shape = 1", []),
    ],
)
def test_what_is_written_into_another_module_is_seen(text, found):
    assert list(patched(ast.parse(text))) == found


def test_the_judge_is_independent():
    """Numpy, SciPy and its own files: nothing of what it judges, and no Pinocchio."""
    judge = {f"pinfric.paper.{name}" for name in JUDGE}
    for one in all_imports():
        if one.by in judge:
            known = one.name.split(".")[0] in {"numpy", "scipy", *sys.stdlib_module_names}
            assert known or one.name in judge | {"pinfric.errors"}, one


#: What is done in one process, one after the other -> what is not loaded by then.
STEPS = {
    "import pinfric as pf": {"numpy", "pinocchio", "numba", "scipy", "pandas"},
    "solver = pf.load_scene('pendulum').solver()\nassert type(solver) is pf.Solver": set(),
    "scene = pf.load_scene('panda_pick_and_place')\n"
    "motion = pf.load_trajectory('panda_pick_and_place.csv', scene)\n"
    "pf.inverse_dynamics(scene, motion)": {"trimesh", "scipy.optimize", "matplotlib", "pandas"},
    "scene = pf.load_scene('three_link')\n"
    "result = pf.inverse_dynamics(scene, pf.load_trajectory('three_link', scene))\n"
    "pf.replay(scene, result, html='page.html')": {"matplotlib.pyplot", "pinocchio.visualize"},
    "for name in pf.__all__: getattr(pf, name)\nassert 'inverse_dynamics' in dir(pf)": set(),
}


def test_nothing_is_loaded_before_it_is_used(tmp_path):
    """Not even the rest of the package: its public names are there all the same."""
    tell = "\nimport sys; print(*sys.modules)\n"
    done = subprocess.run(
        [sys.executable, "-c", tell.join([*STEPS, ""])],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    for absent, loaded in zip(STEPS.values(), done.stdout.splitlines(), strict=True):
        assert not absent & set(loaded.split()), absent
    assert "pinfric.show.replay.page" in loaded.split()
