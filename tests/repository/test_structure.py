"""How the package is built: no import circles, no late imports, no function beyond one screen."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = Path(__file__).parents[2] / "pinfric"
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


def functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    for child in ast.iter_child_nodes(node):
        named = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        name = f"{prefix}.{child.name}" if named else prefix
        if isinstance(child, ast.FunctionDef):
            yield name, child
        yield from functions(child, name)


def is_large(function: ast.FunctionDef) -> bool:
    """The example that ends a docstring is a test, and does not count."""
    given = function.args
    count = len([*given.posonlyargs, *given.args, *given.kwonlyargs])
    _, _, example = (ast.get_docstring(function) or "").partition("\n\n>>> ")
    lines = function.end_lineno - function.lineno + 1 - (example.count("\n") + 2) * bool(example)
    return lines >= 60 or count > 12


def test_functions_are_below_sixty_lines_and_thirteen_arguments():
    found = {
        name.removeprefix("pinfric.")
        for module, tree in trees().items()
        for name, function in functions(tree, module)
        if is_large(function)
    }
    assert found == set()


@pytest.mark.parametrize(
    ("text", "large"),
    [
        ("def f(a, b):\n" + "    a = b\n" * 58, False),
        ("def f(a, b):\n" + "    a = b\n" * 59, True),
        ("def f(a, b, c, d, e, f, *, g, h, i, j, k, l): pass", False),
        ("def f(a, b, c, d, e, f, *, g, h, i, j, k, l, m): pass", True),
    ],
)
def test_what_is_large(text, large):
    assert is_large(ast.parse(text).body[0]) == large
