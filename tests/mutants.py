"""Break lines of the solvers on purpose and count what no test notices.

    python tests/mutants.py                        200 lines of `friction` and `dynamics`
    python tests/mutants.py --count 20 --seed 3 friction

Each mutant changes one line of a copy of the repository: a comparison, a sign, a product, a number,
a condition, or it leaves out a statement. The tests of friction and dynamics then run with kernels
as plain Python, so that nothing is compiled, the fastest first; the first that fails ends them.
What survives is printed with its line: it needs a test, or a reason.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
#: Beyond this (s) a mutant is caught: its loop does not end.
PATIENCE = 1200
SIGNS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
}
PLUGIN = """
import json, pathlib, pytest, signal
from pinfric.kernels import interpreted

FILE = pathlib.Path(__file__).with_name("tests.json")
known = json.loads(FILE.read_text()) if FILE.exists() else None
found = {}

def pytest_collection_modifyitems(items):
    if known is not None:  # the fastest first
        items[:] = sorted((i for i in items if i.nodeid in known), key=lambda i: known[i.nodeid])

@pytest.hookimpl(trylast=True)
def pytest_collection_finish(session):
    interpreted.PATIENCE = interpreted._FEW = float("inf")

def pytest_runtest_setup(item):
    def stop(*_):
        raise TimeoutError("a loop that does not end?")
    signal.signal(signal.SIGALRM, stop)
    signal.alarm(30)

def pytest_runtest_makereport(item, call):
    if call.when == "call":
        found[item.nodeid] = 1e9 if call.excinfo else call.duration

def pytest_sessionfinish(session):
    if known is None:
        FILE.write_text(json.dumps({k: t for k, t in found.items() if t < LONGEST}))
"""
#: Tests that take longer with kernels as plain Python are left out (s).
LONGEST = 3.0


class Mutant(NamedTuple):
    """One change: the characters from start to end of a file become others."""

    file: str
    line: int
    start: int
    end: int
    text: str


def changes(node: ast.AST, source: bytes, at: list[int]) -> list[tuple[int, int, str]]:
    """Return what may be done to one node: start, end, new text.

    Args:
        source: of the file. at: (lines,) where each line starts in it (bytes).
    """

    def place(part: ast.expr | ast.stmt) -> tuple[int, int]:
        assert part.end_lineno is not None
        assert part.end_col_offset is not None
        return (
            at[part.lineno - 1] + part.col_offset,
            at[part.end_lineno - 1] + part.end_col_offset,
        )

    def sign(left: ast.expr, right: ast.expr, kind: ast.AST) -> list[tuple[int, int, str]]:
        if type(kind) not in SIGNS:
            return []
        start, end = place(left)[1], place(right)[0]
        return [(start, end, source[start:end].decode().replace(*SIGNS[type(kind)]))]

    match node:
        case ast.Compare(ops=[kind], comparators=[right]):
            return sign(node.left, right, kind)
        case ast.BinOp():
            return sign(node.left, node.right, node.op)
        case ast.BoolOp(values=[left, right]):
            return sign(left, right, node.op)
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            start, end = place(node)[0], place(node.operand)[0]
            return [(start, end, source[start:end].decode().lstrip("not-"))]
        case ast.Constant(value=bool()):
            return [(*place(node), str(not node.value))]
        case ast.Constant(value=int() | float()):
            return [(*place(node), repr(node.value + 1))]
        case ast.If():
            return [(*place(node.test), f"not ({ast.unparse(node.test)})")]
        case ast.AugAssign() | ast.Expr(value=ast.Call()) | ast.Break() | ast.Continue():
            return [(*place(node), "pass")]
        case _:
            return []


def mutants_of(file: str) -> dict[int, list[Mutant]]:
    """Return all mutants of a file by their lines; messages and types are left alone."""
    source = (ROOT / file).read_bytes()
    lines = source.splitlines(keepends=True)
    at = [sum(map(len, lines[:i])) for i in range(len(lines))]
    found: dict[int, list[Mutant]] = {}

    def visit(node: ast.AST) -> None:
        if isinstance(node, (ast.Raise, ast.JoinedStr, ast.arg)):
            return
        for start, end, new in changes(node, source, at):
            mutant = Mutant(file, source[:start].count(b"\n") + 1, start, end, new)
            found.setdefault(mutant.line, []).append(mutant)
        for name, value in ast.iter_fields(node):
            if name not in ("annotation", "returns", "decorator_list"):
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST):
                        visit(child)

    for statement in ast.parse(source).body:
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            visit(statement)
    return found


def chosen(rooms: list[str], count: int, seed: int) -> list[Mutant]:
    """Return `count` mutants, on as many lines, by a seed."""
    files = [
        str(path.relative_to(ROOT))
        for room in rooms
        for path in sorted((ROOT / "pinfric" / room).rglob("*.py"))
    ]
    lines = [mutants for file in files for mutants in mutants_of(file).values()]
    chance = random.Random(seed)
    return [chance.choice(mutants) for mutants in chance.sample(lines, min(count, len(lines)))]


def run_tests(
    copy: Path, tests: list[str], *options: str, patience: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Run tests in a copy of the repository, for some time (s)."""
    environment = {**os.environ, "PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(copy / "cache")}
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "mutants_plugin"]
    command += [*options, "-m", "not slow", "--ignore", "tests/dynamics/test_threaded.py"]
    command += tests
    return subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, text=True, timeout=patience
    )


def count_reliable(copy: Path, tests: list[str]) -> int:
    """Choose the tests to run: fast, and passed in the order of their times, too; count them."""
    chosen, known = copy / "tests.json", dict[str, float]()
    run_tests(copy, tests)
    while known != (known := json.loads(chosen.read_text())):
        wrong = failures(run_tests(copy, tests))
        chosen.write_text(json.dumps({k: t for k, t in known.items() if k not in wrong}))
    return len(known)


def failures(run: subprocess.CompletedProcess[str]) -> list[str]:
    """Return the tests that a run reports as failed."""
    lines = run.stdout.splitlines()
    return [line.split()[1] for line in lines if line.startswith(("FAILED", "ERROR"))]


def catcher(mutant: Mutant, copy: Path, tests: list[str]) -> str:
    """Return the test that notices a mutant; empty where none does."""
    path = copy / mutant.file
    whole = path.read_bytes()
    path.write_bytes(whole[: mutant.start] + mutant.text.encode() + whole[mutant.end :])
    try:
        run = run_tests(copy, tests, "-x", patience=PATIENCE)
    except subprocess.TimeoutExpired:
        return "it does not end"
    finally:
        path.write_bytes(whole)
    failed = failures(run)
    return failed[0] if failed else "" if run.returncode == 0 else "it does not start"


def shown(mutant: Mutant) -> str:
    """Return the mutant's line with what it changes."""
    whole = (ROOT / mutant.file).read_bytes()
    before = whole[mutant.start : mutant.end].decode().strip()
    line = whole.decode().splitlines()[mutant.line - 1].strip()
    return f"{mutant.file}:{mutant.line}: {line!r}: {before[:40]!r} -> {mutant.text.strip()[:40]!r}"


def main() -> None:
    """Break, count and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("rooms", nargs="*", default=["friction", "dynamics"])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", nargs="*", default=["tests/friction", "tests/dynamics"])
    given = parser.parse_args()
    caught: Counter[str] = Counter()
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "pinfric"
        ignored = shutil.ignore_patterns(".git", ".venv", "build", "__pycache__", ".*_cache")
        shutil.copytree(ROOT, copy, ignore=ignored)
        (copy / "mutants_plugin.py").write_text(PLUGIN.replace("LONGEST", str(LONGEST)))
        print(f"{count_reliable(copy, given.tests)} tests", flush=True)
        for number, mutant in enumerate(chosen(given.rooms, given.count, given.seed), 1):
            room = mutant.file.split("/")[1]
            by = catcher(mutant, copy, given.tests)
            total[room] += 1
            caught[room] += bool(by)
            print(number, shown(mutant), by or "SURVIVED", sep=" | ", flush=True)
    for room in total:
        share = 100 * caught[room] / total[room]
        print(f"{room}: {caught[room]} of {total[room]} caught ({share:.0f} %)")


if __name__ == "__main__":
    main()
