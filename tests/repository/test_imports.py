"""Imports go one way, from model to the command line; the judge stands alone."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

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
MODULES = sorted(PACKAGE.rglob("*.py"))
#: The one module below that names a class above, for type checkers: methods lead up through it.
UPWARD = PACKAGE / "model" / "upward.py"


def imported(file):
    """Every module of ours or others' that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            names = {alias.name for alias in node.names}
            if node.module != "pinfric":
                yield node.module
            elif names != {"__version__"}:  # else the whole package, with all that is above
                yield from (f"pinfric.{name}" for name in sorted(names))


def layer(module):
    parts = module.split(".")
    known = len(parts) > 1 and parts[1] in LAYERS
    return LAYERS.index(parts[1]) if known else len(LAYERS)  # a public name is of any room


def goes_up(file):
    """The modules that a file imports from above its own room."""
    own = layer("pinfric." + ".".join(file.relative_to(PACKAGE).with_suffix("").parts))
    for module in imported(file):
        if module.split(".")[0] == "pinfric" and layer(module) > own:
            yield module


@pytest.mark.parametrize("file", MODULES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_imports_go_down_the_list_only(file):
    if file != PACKAGE / "__init__.py":  # the package stands above all
        allowed = {"pinfric.dynamics.forward.solver"} if file == UPWARD else set()
        assert set(goes_up(file)) <= allowed


def test_the_rooms_of_dynamics_import_one_way():
    for file in (PACKAGE / "dynamics").glob("*/*.py"):
        own = DYNAMICS.index(file.parent.name)
        for module in imported(file):
            parts = module.split(".")
            if parts[:2] == ["pinfric", "dynamics"]:
                assert DYNAMICS.index(parts[2]) <= own, (file, module)


def test_the_judge_reads_results_only():
    read = {
        module
        for file in (PACKAGE / "dynamics" / "judge").glob("*.py")
        for module in imported(file)
        if module.startswith("pinfric.dynamics")
    }
    others = {module for module in read if ".judge." not in module}
    assert others == {"pinfric.dynamics.samples.outcome"}


def test_the_package_as_a_whole_is_above_every_room(tmp_path, monkeypatch):
    """Its public names are functions of all rooms: who imports it imports them."""
    monkeypatch.setattr(f"{__name__}.PACKAGE", tmp_path)
    (tmp_path / "model").mkdir()
    file = tmp_path / "model" / "brief.py"
    for text, found in (
        ("import pinfric", ["pinfric"]),
        ("from pinfric import plot", ["pinfric.plot"]),
        ("from pinfric import show", ["pinfric.show"]),
        ("from pinfric import __version__", []),
        ("from pinfric.dynamics.forward.solver import Solver", ["pinfric.dynamics.forward.solver"]),
        ("from pinfric.errors import PinfricError", []),
    ):
        file.write_text(text)
        assert list(goes_up(file)) == found, text


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
    "__init__.py": ["import_module(_PUBLIC[name])"],
    "show/sizing_page/page.py": ["import_module(module)"],
}


@pytest.mark.parametrize("file", MODULES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_no_module_writes_into_another(file):
    """So that nothing of a room above comes into one below but through `model/upward.py`."""
    found = list(patched(ast.parse(file.read_text())))
    allowed = [*LOOKED_UP.get(str(file.relative_to(PACKAGE)), []), "warnings.showwarning"]
    assert [one for one in found if one not in allowed] == []


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
