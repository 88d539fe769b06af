"""Break lines of the solvers on purpose and count what no test notices.

    python tools/mutants.py                        100 lines each of `friction` and `dynamics`
    python tools/mutants.py --count 20 --seed 3 friction
    python tools/mutants.py --near friction        by the tests in `tests/friction/` alone
    python tools/mutants.py drives sizing          by the tests about these rooms

Each mutant changes one line in memory: a comparison, a sign, a product, a number, a condition, or
it leaves out a statement. Where a room has kernels, all run as plain Python, so nothing is
compiled; where it has none, they are compiled as ever, and tests take no longer than they do. Tests
are collected once; everything else happens in forked processes, so that no test sees what another
one left:

1. The tests of the mutant's own module run, then those of its folder that call its function. One
   that fails counts only if it fails alone, too, and passes alone unbroken. Where numba divides by
   zero, plain Python raises: such a failure alone proves nothing.
2. If none notices, all other tests run that call its function, one case of each first, until they
   have taken `--patience` seconds. What a test calls, and how long it takes, is found by one case
   of it, alone and unbroken; a test that takes long or fails as plain Python is left out.

What survives is printed with its line: it needs a test, or a reason. Reasons are in
`mutants_judged.txt`; a mutant with one is not run and counts apart. A mutant is chosen by the text
of its line and the name of its file: the same seed breaks the same lines after changes elsewhere.
"""

from __future__ import annotations

import argparse
import ast
import gc
import hashlib
import json
import os
import pickle
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

import pinfric  # isort: skip: before Pinocchio

import hypothesis
import numpy as np
import pytest
from _pytest.runner import runtestprotocol

from pinfric.kernels import compiled

ROOT = Path(__file__).parents[1]
#: The last has what calls `dynamics/inverse/superposed.py`.
ENGINE = (
    "tests/friction",
    "tests/dynamics",
    "tests/judges",
    "tests/sweeps/test_superposition.py",
)
DRIVES = (
    "tests/drives",
    "tests/sizing",
    "tests/stops",
    "tests/judges/test_drives_by_hand.py",
    "tests/judges/test_any_drives.py",
)
#: The tests that are about a room's functions.
TESTS = {
    "friction": ENGINE,
    "dynamics": ENGINE,
    "drives": DRIVES,
    "sizing": (*DRIVES, "tests/show/report/test_sizing.py"),
    "motions": ("tests/motions",),
    "identification": ("tests/identification", "tests/judges/test_identify_coupled.py"),
}
#: Mutants that no test can notice, or none should: `file function: line: change | reason`.
JUDGED = ROOT / "tools/mutants_judged.txt"
#: Tests that take longer are left out (s of processor time): kernels as plain Python, compiled.
LONGEST = {True: 6, False: 15}
#: Exceptions that plain Python raises where a compiled kernel computes inf or nan.
DIVISION = ("ZeroDivisionError", "OverflowError")
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


class Mutant(NamedTuple):
    """One change: the characters from start to end of a file become others."""

    file: Path
    function: int  # line of the outermost function (of its first decorator)
    name: str  # of that function, a method's with its class
    line: int
    start: int
    end: int
    text: str

    @property
    def place(self) -> str:
        """File and function."""
        return f"{self.file.relative_to(ROOT)} {self.name}"

    @property
    def key(self) -> str:
        """What is changed where; without the number of the line, which moves."""
        whole = self.file.read_bytes()
        before = whole[self.start : self.end].decode().strip()
        lines = [line.strip() for line in whole.decode().splitlines()]
        line = lines[self.line - 1]
        same = lines[self.function - 1 : self.line].count(line)
        again = f" (no. {same})" if same > 1 else ""
        return f"{self.place}: {line!r}{again}: {before[:40]!r} -> {self.text.strip()[:40]!r}"

    def __str__(self) -> str:
        return f"line {self.line} of {self.key}"

    def broken(self) -> bytes:
        """The source with the change."""
        whole = self.file.read_bytes()
        return whole[: self.start] + self.text.encode() + whole[self.end :]


def changes(node: ast.AST, source: bytes, at: list[int]) -> list[tuple[int, int, str]]:
    """Return what may be done to one node: start, end, new text.

    Args:
        source: of the file. at: (lines,) where each line starts in it (bytes).
    """

    def place(part: Any) -> tuple[int, int]:
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
            more = node.value + 1
            return [(*place(node), repr(more if more != node.value else 2.0 * node.value))]
        case ast.If():
            return [(*place(node.test), f"not ({ast.unparse(node.test)})")]
        case ast.AugAssign() | ast.Expr(value=ast.Call()) | ast.Break() | ast.Continue():
            return [(*place(node), "pass")]
        case _:
            return []


def mutants_of(file: Path) -> dict[int, list[Mutant]]:
    """Return all mutants of a file by their lines; messages, types, defaults are left alone."""
    source = file.read_bytes()
    lines = source.splitlines(keepends=True)
    at = [sum(map(len, lines[:i])) for i in range(len(lines))]
    found: dict[int, list[Mutant]] = {}

    def visit(node: ast.AST, function: int, name: str) -> None:
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.arguments):
            return
        if not function and isinstance(node, ast.ClassDef | ast.FunctionDef):
            name = f"{name}.{node.name}" if name else node.name
        if not function and isinstance(node, ast.FunctionDef):
            function = min([node.lineno, *(one.lineno for one in node.decorator_list)])
        for start, end, new in changes(node, source, at) if function else ():
            line = source[:start].count(b"\n") + 1
            found.setdefault(line, []).append(Mutant(file, function, name, line, start, end, new))
        for field, value in ast.iter_fields(node):
            if field not in ("annotation", "returns", "decorator_list"):
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST):
                        visit(child, function, name)

    for statement in ast.parse(source).body:
        visit(statement, 0, "")
    return found


def chosen(room: str, count: int, seed: int, skip: int = 0) -> list[Mutant]:
    """Return mutants on as many lines of a room: those whose text has the smallest digests.

    Args:
        room: folder. count, seed: how many, and of which choice. skip: leave out the first ones.
    """

    def digest(mutant: Mutant, *more: object) -> bytes:
        line = mutant.file.read_text().splitlines()[mutant.line - 1].strip()
        key = (seed, mutant.file.name, line, *more)
        return hashlib.blake2b(repr(key).encode()).digest()

    files = sorted((ROOT / "pinfric" / room).rglob("*.py"))
    lines = [mutants for file in files for mutants in mutants_of(file).values()]
    lines.sort(key=lambda mutants: digest(mutants[0]))
    return [
        min(mutants, key=lambda mutant: digest(mutant, mutant.text))
        for mutants in lines[skip : skip + count]
    ]


def has_kernels(room: str) -> bool:
    """Whether a file of a room has kernels."""
    files = (ROOT / "pinfric" / room).rglob("*.py")
    return any("pinfric.kernels.compiled import" in file.read_text() for file in files)


def interpret_kernels() -> None:
    """Make kernels plain functions, before any module with one is imported."""
    np.seterr(all="ignore")

    def as_it_is(function: Any, *_: object, **__: object) -> Any:
        return function

    changed: Any = compiled
    changed._compiled = changed.inlined = as_it_is
    changed.record = lambda _: as_it_is
    changed.call_compiled = lambda made, *arguments: made(*arguments)
    changed.compile_for = lambda *_: None
    changed._is_kept = lambda _: False
    changed.is_small = lambda _: True
    changed.CLOCK.is_over = lambda: False


def in_child(work: Callable[..., Any], *arguments: Any) -> Any:
    """Return a function's result, computed in a fork of this process; None if that dies."""
    read, write = os.pipe()
    if not (child := os.fork()):
        status = 1
        try:
            os.close(read)
            with os.fdopen(write, "wb") as pipe:
                pickle.dump(work(*arguments), pipe)
            status = 0
        finally:
            os._exit(status)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        written = pipe.read()
    return pickle.loads(written) if os.waitpid(child, 0)[1] == 0 else None


class Failure(NamedTuple):
    """A test that failed, and the exception's type."""

    test: int
    kind: str


def failures(items: list[pytest.Item], tests: list[int], longest: float) -> Iterator[Failure]:
    """Run tests, given by their numbers, in this process; yield those that fail.

    Args:
        items: all tests. tests: their numbers. longest: processor time of each test (s).
    """

    def stop(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGPROF, stop)
    for test, following in zip(tests, [*tests[1:], None], strict=True):
        after = None if following is None else items[following]
        kinds: list[str] = []

        class Listen:
            """Keeps the types of exceptions."""

            @staticmethod
            def pytest_runtest_makereport(
                call: pytest.CallInfo[None], into: list[str] = kinds
            ) -> None:
                if call.excinfo is not None:
                    into.append(call.excinfo.typename)

        listener = Listen()
        items[test].config.pluginmanager.register(listener)
        signal.setitimer(signal.ITIMER_PROF, longest, 1.0)  # again: somebody may catch it
        try:
            reports = runtestprotocol(items[test], log=False, nextitem=after)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            items[test].config.pluginmanager.unregister(listener)
        if any(report.failed for report in reports):
            yield Failure(test, kinds[0] if kinds else "?")


class Known(NamedTuple):
    """What one test does unbroken: its time (s), inf if it fails or takes long; what it calls."""

    seconds: float
    calls: list[str]  # `Mutant.place`


def known(items: list[pytest.Item], test: int, longest: float) -> Known:
    """Run one test, unbroken."""
    calls: set[CodeType] = set()

    def note(frame: Any, *_: object) -> None:
        calls.add(frame.f_code)

    threading.settrace(note)
    sys.settrace(note)
    try:
        failed = list(failures(items, [test], longest))
    finally:
        sys.settrace(None)
    if failed:
        return Known(np.inf, [])
    used = os.times()
    ours = {code for code in calls if code.co_filename.startswith(str(ROOT / "pinfric"))}
    places = {f"{Path(code.co_filename).relative_to(ROOT)} {code.co_qualname}" for code in ours}
    return Known(used.user + used.system, sorted(places))


def passes(items: list[pytest.Item], test: int, longest: float) -> bool:
    """Whether a test passes alone and unbroken."""
    return not list(failures(items, [test], 5.0 * longest))


def break_line(mutant: Mutant) -> None:
    """Give the function of a mutant its broken code."""

    def codes(code: CodeType) -> Iterator[CodeType]:
        yield code
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                yield from codes(constant)

    whole = compile(mutant.broken(), str(mutant.file), "exec", dont_inherit=True)
    found = [code for code in codes(whole) if code.co_firstlineno == mutant.function]
    place = str(mutant.file), mutant.function
    functions = [
        one
        for one in gc.get_objects()
        if isinstance(one, FunctionType)
        and (one.__code__.co_filename, one.__code__.co_firstlineno) == place
    ]
    assert functions
    for function in functions:
        function.__code__ = next(c for c in found if c.co_name == function.__code__.co_name)


def first_failure(
    items: list[pytest.Item], mutant: Mutant, tests: list[int], longest: float
) -> Failure | None:
    """Return the first of some tests that fails with a broken line, best not by a division."""
    break_line(mutant)
    last = None
    for last in failures(items, tests, longest):
        if last.kind not in DIVISION:
            break
    return last


class Search:
    """In place of pytest's own loop over the tests: break, count and print.

    Args:
        mutants: what to try.
        given: the command's options.
        interpreted: whether kernels run as plain Python.
    """

    def __init__(self, mutants: list[Mutant], given: argparse.Namespace, interpreted: bool) -> None:
        self.mutants, self.near, self.patience = mutants, given.near, given.patience
        self.interpreted, self.longest = interpreted, LONGEST[interpreted]
        self.before: dict[str, str] = {}
        for line in given.before.read_text().splitlines() if given.before else ():
            if " | " in line:
                mutant, by = line.partition(" | ")[2].rsplit(" | ", 1)
                self.before[mutant.partition(" of ")[2]] = by.rpartition("::")[2]
        self.judged = {} if given.all else judged()
        self.items: list[pytest.Item] = []
        self.map: Path | None = given.map
        self.known: dict[str, Known] = {}
        self.sound: dict[str, bool] = {}
        if self.map and self.map.exists():
            former, self.sound = json.loads(self.map.read_text())
            self.known = {name: Known(*one) for name, one in former.items()}

    def unbroken(self, test: int) -> Known:
        """What a test does unbroken, by the first of its cases; run once."""
        name = self.items[test].nodeid.partition("[")[0]
        if name not in self.known:
            died = Known(np.inf, [])
            self.known[name] = in_child(known, self.items, test, self.longest) or died
            self.keep()
        return self.known[name]

    def is_sound(self, test: int) -> bool:
        """Whether a test passes alone and unbroken; run once."""
        name = self.items[test].nodeid
        if name not in self.sound:
            self.sound[name] = bool(in_child(passes, self.items, test, self.longest))
            self.keep()
        return self.sound[name]

    def keep(self) -> None:
        """Write what is known of tests for the next run."""
        if self.map:
            self.map.write_text(json.dumps((self.known, self.sound)))

    def may_count(self, test: int) -> bool:
        """Whether a test is not known to fail alone and unbroken."""
        return self.sound.get(self.items[test].nodeid, True)

    def calling(self, tests: list[int], mutant: Mutant) -> list[int]:
        """Those tests that call a mutant's function, one case of each first, the fastest first."""
        cases: Counter[str] = Counter()
        order: dict[int, tuple[int, float]] = {}
        for i in tests:
            seconds, calls = self.unbroken(i)
            if mutant.place in calls:
                name = self.items[i].nodeid.partition("[")[0]
                order[i] = cases[name], seconds
                cases[name] += 1
        return sorted(order, key=lambda i: order[i])

    def groups(self, mutant: Mutant) -> Iterator[list[int]]:
        """Tests that may notice a mutant, those that probably do first."""
        former = self.before.get(mutant.key)
        numbers = range(len(self.items))
        yield [i for i in numbers if self.items[i].name == former]
        module = mutant.file.relative_to(ROOT / "pinfric")
        own = f"tests/{module.with_name(f'test_{module.name}')}::"
        mine = [i for i in numbers if self.items[i].nodeid.startswith(own)]
        first = self.calling(mine, mutant)
        yield first + [i for i in mine if i not in first]
        folder = f"tests/{module.parent}/"
        yield self.calling([i for i in numbers if self.items[i].nodeid.startswith(folder)], mutant)
        if not self.near:
            others, seconds = self.calling(list(numbers), mutant), 0.0
            for end, i in enumerate(others):
                if (seconds := seconds + self.unbroken(i).seconds) > self.patience:
                    others = others[:end]
                    break
            yield others

    def first(self, mutant: Mutant, tests: list[int]) -> Failure | None:
        """The first of some tests that fails with a broken line."""
        found: Failure | None = in_child(
            first_failure, self.items, mutant, tests, 5.0 * self.longest
        )
        return found

    def catcher(self, mutant: Mutant) -> str:
        """Return the test that notices a mutant and how, or that it survived how many tests."""
        tried, divided = set[int](), ""
        for group in self.groups(mutant):
            left = [i for i in group if i not in tried and self.may_count(i)]
            tried.update(left)
            while left:
                found = self.first(mutant, left)
                if found is None:
                    break
                alone = self.first(mutant, [found.test])
                if alone is not None and self.is_sound(found.test):
                    how = f"{alone.kind} in {self.items[found.test].nodeid}"
                    if not self.interpreted or alone.kind not in DIVISION:
                        return how
                    divided = f" but for {how}"
                left = left[left.index(found.test) + 1 :]
        return f"SURVIVED {len(tried)} tests{divided}"

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run the tests of every mutant; none of it in this process."""
        self.items, writer = session.items, session.config.get_terminal_writer()
        counts: dict[str, Counter[str]] = {}
        for number, mutant in enumerate(self.mutants, 1):
            room = mutant.file.relative_to(ROOT / "pinfric").parts[0]
            count = counts.setdefault(room, Counter())
            reason = self.judged.get(mutant.key)
            by = f"JUDGED {reason}" if reason else self.catcher(mutant)
            end = by.partition(" ")[0]
            count[end if end in ("JUDGED", "SURVIVED") else "CAUGHT"] += 1
            writer.line(f"{number} | {mutant} | {by}", flush=True)
        left = sum(np.isinf(one.seconds) for one in self.known.values())
        writer.line(f"{left} of {len(self.known)} tests left out: they fail unbroken or take long")
        for room, count in counts.items():
            tried, caught = count.total() - count["JUDGED"], count["CAUGHT"]
            share = f" ({100 * caught / tried:.0f} %)" if tried else ""
            apart = f"; {count['JUDGED']} judged by hand, not run" if count["JUDGED"] else ""
            writer.line(f"{room}: {caught} of {tried} caught{share}{apart}")
        return True


def judged() -> dict[str, str]:
    """Return the reasons why no test notices some mutants, by `Mutant.key`."""
    lines = JUDGED.read_text().splitlines()
    return dict(line.rsplit(" | ", 1) for line in lines if line and not line.startswith("#"))


def main() -> None:
    """Choose the lines, collect the tests, break and count."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("rooms", nargs="*", default=["friction", "dynamics"])
    parser.add_argument("--count", type=int, default=100, help="lines of each room")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--skip", type=int, default=0, help="leave out the first lines")
    parser.add_argument("--tests", nargs="*", help="in place of those about the rooms")
    parser.add_argument("--before", type=Path, help="log of an earlier run: its tests first")
    parser.add_argument("--near", action="store_true", help="only these and those of the folder")
    parser.add_argument("--patience", type=float, default=60, help="for all others (s)")
    parser.add_argument("--map", type=Path, help="file: what tests call, kept between runs")
    parser.add_argument("--all", action="store_true", help="run what was judged by hand, too")
    given = parser.parse_args()
    hypothesis.settings.register_profile(
        "mutants", database=None, deadline=None, derandomize=True, max_examples=20
    )
    hypothesis.settings.load_profile("mutants")
    if interpreted := any(map(has_kernels, given.rooms)):
        interpret_kernels()
    else:  # once, for all processes that are forked from this one
        pinfric.warm_up(pinfric.load_scene("ur10_machine_tending"))
    mutants = [
        one for room in given.rooms for one in chosen(room, given.count, given.seed, given.skip)
    ]
    os.chdir(ROOT)
    options = [
        "-q",
        "-n",
        "0",
        "-m",
        "not slow" if interpreted else "",
        "-W",
        "ignore::RuntimeWarning",
        "-p",
        "no:cacheprovider",
    ]
    about = (test for room in given.rooms for test in TESTS.get(room, (f"tests/{room}",)))
    tests = given.tests or list(dict.fromkeys(about))
    sys.exit(pytest.main([*options, *tests], plugins=[Search(mutants, given, interpreted)]))


if __name__ == "__main__":
    main()
