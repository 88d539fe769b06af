"""How the package is built: no function beyond one screen, and a test file for every module."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pinfric"
#: Modules that only pass on or hold data, and steps of one computation that have no result of
#: their own: the file that tests the whole -> the modules.
TESTED_WITH = {
    "dynamics/forward/test_forward.py": "dynamics/forward: failures",
    "judges/test_gears.py": "dynamics/forward: self_locking margins",
    "dynamics/problem/test_instant.py": "dynamics/problem: accelerations affine gearing machine "
    "plan rates supply wrenches",
    "dynamics/inverse/test_linkage.py": "dynamics/inverse: effort_maps linkage_batch solutions",
    "dynamics/inverse/test_interval_ends.py": "dynamics/inverse: choices",
    "judges/test_any_drives.py": "dynamics/inverse: undriven",
    "study/sweep/test_superposition.py": "dynamics/inverse: superposed; study/sweep: tables",
    "dynamics/judge/test_check.py": "dynamics/judge: balance linkage pairs plain_laws",
    "dynamics/inverse/test_inverse.py": "dynamics/samples: motion_kernels motor_torques outcome",
    "dynamics/simulation/test_simulate.py": "dynamics/simulation: integration",
    "dynamics/simulation/test_system.py": "dynamics/forward: efforts",
    "friction/test_holding.py": "friction: balance",
    "friction/test_given_modes.py": "friction: modes problem",
    "model/test_scene.py": "model: arrays magnitudes upward",
    "model/test_closure.py": "model: coordinates kinematics",
    "judges/test_couples.py": "model: couples",
    "paper/test_inverse.py": "paper: bodies",
    "paper/test_reproduction.py": "paper: figures report",
    "study/identify/test_identify.py": "study/identify: columns summary; show/report: identify",
    "show/identification_page/test_page.py": "show/identification_page: figures",
    "show/figure/test_efforts.py": "show/figure: style",
    "show/report/test_retime.py": "show/figure: retime; study/retime: summary",
    "show/report/test_sizing.py": "show/report: bill drives page; show/sizing_page: figures page",
    "show/report/test_elastic.py": "study/elastic: summary",
    "show/report/test_motion.py": "study: motion_summary",
    "show/report/test_sweep.py": "study/sweep: summary",
    "show/replay/test_page.py": "show/replay: drawn",
    "model/test_described.py": "show/report: envelope html",
    "end_to_end/test_robots.py": "show/report: robots",
    "study/test_explain.py": "show/report: explain; study: timing variants",
    "test_cli.py": "show/report: inverse; study: inverse_summary",
    "study/check/test_plausibility.py": "study/check: findings joint_loads joints",
    "study/export/test_newton.py": "study/export: python_text",
    "study/export/test_mjcf.py": "study/export: tree",
    "study/export/test_constants.py": "study: random_states",
    "study/timeline/test_frames.py": "study/timeline: spans",
    "study/trajectory/log/test_columns.py": "study/trajectory/log: frame",
    "study/identify/test_recordings.py": "study/trajectory/log: arrays thinning",
    "kernels/test_interpreted.py": "study: warm_up",
    "study/sizing/test_criteria.py": "study/sizing: criterion drivetrain limit limits",
    "study/sizing/test_sizing.py": "study/sizing: caveats demand inertia size summary",
    "study/sizing/test_catalog.py": "study/sizing: catalog_file doubts",
    "study/sizing/test_catalog_table.py": "study/sizing: table units",
    "study/sizing/test_stop_limits.py": "study/sizing: stopping",
    "study/stop/test_motion.py": "model: brakes",
    "study/stop/test_study.py": "study/stop: machines search summary; show/report: stop; "
    "show/figure: stop; show/stop_page: page",
}


def functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    for child in ast.iter_child_nodes(node):
        named = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        name = f"{prefix}.{child.name}" if named else prefix
        if isinstance(child, ast.FunctionDef):
            yield name, child
        yield from functions(child, name)


def is_large(function: ast.FunctionDef) -> bool:
    """The example that ends a docstring is a test, and does not count."""
    _, _, example = (ast.get_docstring(function) or "").partition("\n\n>>> ")
    lines = function.end_lineno - function.lineno + 1 - (example.count("\n") + 2) * bool(example)
    return lines >= 60


def test_functions_are_below_sixty_lines():
    found = {
        f"{file.relative_to(ROOT)}:{name}"
        for file in PACKAGE.rglob("*.py")
        for name, function in functions(ast.parse(file.read_text(encoding="utf-8")), "")
        if is_large(function)
    }
    assert found == set()


@pytest.mark.parametrize(("lines", "large"), [(58, False), (59, True)])
def test_what_is_large(lines, large):
    function = ast.parse("def f(a, b):\n" + "    a = b\n" * lines).body[0]
    assert is_large(function) == large


def found_elsewhere() -> set[str]:
    found = set()
    for place, modules in TESTED_WITH.items():
        assert (ROOT / "tests" / place).exists(), place
        for group in modules.split(";"):
            folder, names = group.split(":")
            found |= {f"{folder.strip()}/{name}.py" for name in names.split()}
    return found


def test_the_tests_of_a_module_are_found_by_its_name():
    """`pinfric/friction/search.py` -> `tests/friction/test_search.py`, or the table says where."""
    modules = [f.relative_to(PACKAGE) for f in PACKAGE.rglob("*.py") if f.name != "__init__.py"]
    missing = {
        str(module)
        for module in modules
        if not (ROOT / "tests" / module.with_name(f"test_{module.name}")).exists()
    }
    assert missing == found_elsewhere()


def test_the_smoke_set_names_tests_that_exist():
    for line in (ROOT / "tests/smoke.txt").read_text().splitlines():
        file, _, name = line.partition("::")
        assert f"def {name}" in (ROOT / file).read_text(encoding="utf-8"), line
