"""Imports go one way, from model to the command line, without circles; the judge stands alone.

Which room may import which is in `pyproject.toml`, for import-linter.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib.util import find_spec
from pathlib import Path

import grimp
import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

PACKAGE = Path(__file__).parents[2] / "pinfric"
#: The files of `paper/` that are its formulation; the others set it beside ours.
JUDGE = {
    f"pinfric.paper.{name}"
    for name in ("bodies", "equations", "inverse", "forward", "simulate", "examples")
}
#: Where the command line begins: it imports what a command needs when that command runs, so that
#: `pinfric --help` and a bad option take no time.
FRONT = {"pinfric.__main__", "pinfric.cli", "pinfric.terminal"}
#: Third parties that few calls need: who needs a module of ours that begins with one may wait.
HEAVY = {"distributed"}


@cache
def graph() -> grimp.ImportGraph:
    """Imports that run, also those inside functions."""
    return grimp.build_graph(
        "pinfric",
        include_external_packages=True,
        exclude_type_checking_imports=True,
        cache_dir=None,
    )


def imported(by: set[str]) -> set[str]:
    return {name for module in by for name in graph().find_modules_directly_imported_by(module)}


def source(module: str) -> str:
    found = find_spec(module)
    return Path(str(found and found.origin)).read_text(encoding="utf-8")


def test_rooms_import_those_below():
    config = str(PACKAGE.parent / "pyproject.toml")
    assert lint_imports(config_filename=config, no_cache=True) == EXIT_STATUS_SUCCESS


def test_no_module_imports_itself_by_way_of_others():
    """Late imports count: they hide a circle from Python, not from a reader."""
    edges = {module: imported({module}) for module in graph().modules}
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        pytest.fail(str(error))
    assert sum(map(len, edges.values())) > 400


def test_no_modules_of_a_room_name_each_other():
    """Imports for types alone count: readers of one module of a circle have to read all."""
    every = grimp.build_graph("pinfric", cache_dir=None)
    rooms = {name.split(".")[1] for name in every.modules if "." in name}
    for room in rooms:
        inside = {m for m in every.modules if m.split(".")[1:2] == [room]}
        edges = {m: every.find_modules_directly_imported_by(m) & inside for m in inside}
        try:
            TopologicalSorter(edges).prepare()
        except CycleError as error:
            pytest.fail(str(error))


def test_of_the_package_as_a_whole_only_the_version_is_imported():
    """Its public names are functions of all rooms: importing one would import all rooms."""
    lines = {
        place["line_contents"]
        for by in graph().find_modules_that_directly_import("pinfric")
        for place in graph().get_import_details(importer=by, imported="pinfric")
    }
    assert lines == {"from pinfric import __version__"}


def test_no_function_imports_a_module_of_ours():
    late = set()
    for by in graph().find_descendants("pinfric") - FRONT:
        lines = source(by).splitlines()
        for name in imported({by}) & graph().find_descendants("pinfric"):
            places = graph().get_import_details(importer=by, imported=name)
            inside = any(lines[place["line_number"] - 1].startswith(" ") for place in places)
            if inside and not imported({name}) & HEAVY:
                late.add((by, name))
    assert late == set()


def test_the_judge_of_inverse_dynamics_reads_results_only():
    read = set()
    for name in ("verdict", "judged_sample", "friction_states", "plain_laws"):
        tree = ast.parse((PACKAGE.parent / f"tests/judges/{name}.py").read_text())
        read |= {node.module for node in tree.body if isinstance(node, ast.ImportFrom)}
    solvers = ("pinfric.dynamics", "pinfric.friction", "pinfric.kernels")
    assert {name for name in read if name.startswith(solvers)} == {
        "pinfric.dynamics.samples.outcome"
    }


def test_the_judge_of_the_paper_is_independent():
    """Numpy, SciPy and its own files: nothing of what it judges, and no Pinocchio."""
    known = {"numpy", "scipy", "pinfric.errors", *sys.stdlib_module_names}
    assert imported(JUDGE) <= JUDGE | known


def patched(tree):
    """What a module writes into others that it imports: `other.name = ...`, `setattr(other, ...)`.

    Also into modules that are looked up by name.
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


#: Modules looked up by a name: the tables of what the package and its commands have; an extra that
#: may not be installed. And the number that numba gives to a function next.
LOOKED_UP = {
    "pinfric.__main__": ["sys"],  # streams that the caller closed
    "pinfric": ["import_module((_PUBLIC | _INTERNAL)[name])"],
    "pinfric.cli": ["import_module(f'pinfric.{module}')"],
    # while numba, which holds its lock, compiles a kernel
    "pinfric.kernels.compiled": ["FunctionIdentity._unique_ids", "config.LOOP_VECTORIZE"],
    "pinfric.model.neighbours": [  # of a registry, in its folder
        "import_module(registry.rpartition('.')[0])",
        "import_module(f'{package.__name__}.{module.name}')",
    ],
    "pinfric.show.pages.page": ["import_module(module)"],
}


@pytest.mark.slow
def test_no_module_writes_into_another():
    """So nothing of a higher room enters a lower one but through `model/upward.py`."""
    for name in graph().find_descendants("pinfric") | {"pinfric"}:
        allowed = [*LOOKED_UP.get(name, []), "warnings.showwarning"]
        found = patched(ast.parse(source(name)))
        assert [one for one in found if one not in allowed] == [], name


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


@pytest.mark.slow
def test_nothing_is_loaded_before_it_is_used(tmp_path):
    """Not even the rest of the package, although its public names are there."""
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
