"""Imports go one way, from model to the command line; the judge stands alone."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "pinfric"
LAYERS = ["errors", "model", "friction", "dynamics", "study", "show", "paper", "terminal", "cli",
          "__main__"]  # fmt: skip
#: The files of `paper/` that are its formulation; the others set it beside ours.
JUDGE = ("bodies", "equations", "inverse", "forward", "simulate", "examples")
MODULES = sorted(PACKAGE.rglob("*.py"))


def imported(file):
    """Every module a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            yield node.module


def layer(module):
    parts = module.split(".")
    return LAYERS.index(parts[1]) if len(parts) > 1 and parts[1] in LAYERS else -1


@pytest.mark.parametrize("file", MODULES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_imports_go_down_the_list_only(file):
    if file.name == "__init__.py":
        return
    own = layer("pinfric." + ".".join(file.relative_to(PACKAGE).with_suffix("").parts))
    for module in imported(file):
        if module.split(".")[0] == "pinfric":
            assert layer(module) <= own, f"{file.name} imports {module}"


def test_the_judge_is_independent():
    """Numpy, SciPy and its own files: nothing of what it judges, and no Pinocchio."""
    judge = {f"pinfric.paper.{name}" for name in JUDGE}
    for name in JUDGE:
        for module in imported(PACKAGE / "paper" / f"{name}.py"):
            known = module.split(".")[0] in {"numpy", "scipy", *sys.stdlib_module_names}
            assert known or module in judge | {"pinfric.errors"}, f"{name} imports {module}"


def test_every_public_name_can_be_had():
    code = "import pinfric as pf; [getattr(pf, n) for n in pf.__all__]; print(*dir(pf))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "inverse_dynamics" in done.stdout.split()


def test_reading_a_robot_and_a_motion_loads_no_reader_of_meshes_and_no_optimiser():
    code = (
        "import sys, pinfric as pf; s = pf.load_scene('panda_pick_and_place')\n"
        "pf.inverse_dynamics(s, pf.load_trajectory('panda_pick_and_place.csv', s))\n"
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"trimesh", "scipy.optimize", "matplotlib", "pandas"} & set(done.stdout.split())


def test_importing_pinfric_loads_nothing_heavy():
    code = "import pinfric, sys; print(*{m.split('.')[0] for m in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "pinocchio", "numba", "scipy", "pandas"} & set(done.stdout.split())
