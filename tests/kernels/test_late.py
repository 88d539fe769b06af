"""Late kernels are compiled when a caller first calls them, and found by cached callers."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from pinfric.errors import PinfricError
from pinfric.kernels.compiled import call_compiled, compiling
from pinfric.kernels.interpreted import plain
from pinfric.kernels.late import compile_late

ROOT = Path(__file__).parents[2]
LATE = """
from __future__ import annotations
import sys
import numpy as np
from pinfric.kernels import interpreted
from pinfric.kernels.compiled import kernel, late_kernel

@late_kernel("a part of a test")
def counted(x: np.ndarray, by: int) -> tuple[int, int]:
    return by, x.size

@late_kernel("a part of a test")
def rare(x: np.ndarray, factor: float, each: bool) -> float:
    if x[0] < 0.0:
        raise ValueError("negative")
    total = 0.0
    for i in range(x.size):
        total += x[i] if each else 0.0
    return factor * total + counted(x, 3)[0]

@late_kernel("a part of a test")
def clear(x: np.ndarray, pair: tuple) -> None:
    x[1] = pair[0][0]

@kernel
def inner(x, is_rare):
    if is_rare:
        clear(x, (x, 1.0))
        return rare(x, 2, True)
    return 1.0

@kernel
def root(x, is_rare):
    return inner(x, is_rare) + 1

@late_kernel("another part")
def odd(x: np.ndarray) -> int:
    return x[0]

@kernel
def calls_odd(x):
    return odd(x)

if __name__ == "__main__":
    interpreted.PATIENCE = 0.0
    for is_rare in False, True:
        print(root(np.arange(3.0), is_rare), sum(root._cache_hits.values()), len(rare.overloads))
"""


def python(folder, *arguments):
    """What a process prints that finds the kernels of the test and keeps them in the folder."""
    more = {"PYTHONPATH": f"{ROOT}:{folder}", "NUMBA_CACHE_DIR": str(folder / "cache")}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | more,
        capture_output=True,
        text=True,
        check=True,
    )


@pytest.fixture
def late(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr("pinfric.kernels.late._SLOTS", {})  # of the same kernels in another test
    module = ModuleType("late_of_a_test")
    module.__file__ = str(tmp_path / "late_of_a_test.py")
    (tmp_path / "late_of_a_test.py").write_text(LATE)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(LATE, module.__file__, "exec"), vars(module))
    return module


def test_a_late_kernel_is_compiled_when_it_is_called(late):
    x, late_ones = np.array([2.0, 3.0, 5.0]), (late.rare, late.clear, late.counted)
    assert call_compiled(late.root, x, False) == 2.0
    assert not any(each.overloads for each in late_ones)
    assert call_compiled(late.root, x, True) == 2.0 * (2.0 + 2.0 + 5.0) + 3 + 1
    assert [len(each.overloads) for each in late_ones] == [1, 1, 1]
    with pytest.raises(ValueError, match="negative"):
        late.root(-x, True)
    assert call_compiled(late.rare, x, 1.0, False) == 3.0  # from Python, as any kernel


def test_late_kernels_of_a_part_are_compiled_before_they_are_called(late):
    x = np.arange(3.0)
    call_compiled(late.root, x, False)
    compile_late("a part of a test")
    before = {each: list(each.overloads) for each in (late.rare, late.clear, late.counted)}
    assert all(before.values())  # also of what a late one calls
    assert call_compiled(late.root, x, True) == 8.0
    assert before == {each: list(each.overloads) for each in before}


def test_threads_without_pythons_lock_wait_for_a_late_kernel(late):
    rows = [np.arange(3.0) for _ in range(8)]
    with compiling(), ThreadPoolExecutor(8) as pool:
        assert list(pool.map(late.root, rows, [True] * 8)) == [8.0] * 8


def test_late_kernels_are_interpreted_like_others(late):
    assert plain(late.root)(np.arange(3.0), True) == 8.0
    assert not late.rare.overloads


def test_a_late_kernel_that_returns_something_else_than_it_says_is_refused(late):
    with pytest.raises(PinfricError, match="late kernel odd: it returns float64"):
        call_compiled(late.odd, np.ones(1))


@pytest.mark.slow
def test_a_late_kernel_that_does_not_compile_ends_the_call_not_the_process(tmp_path):
    (tmp_path / "late_of_a_test.py").write_text(LATE)
    code = """
import numpy as np
from late_of_a_test import calls_odd
from pinfric.kernels.compiled import call_compiled
try:
    call_compiled(calls_odd, np.ones(1))
except SystemError:
    print("went on")
"""
    done = python(tmp_path, "-c", code)
    assert done.stdout == "went on\n"
    assert "late kernel odd: it returns float64" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lost", "edit", "hits"),
    [
        ("none.*", ("", ""), 1),
        ("*rare*.nbc", ("", ""), 1),
        ("*counted*", ("", ""), 1),
        ("none.*", ("factor * total", "total"), 0),
    ],
    ids=["all kept", "a late one is lost", "one that a late one calls is lost", "edited"],
)
def test_a_cached_caller_finds_its_late_kernels(lost, edit, hits, tmp_path):
    (tmp_path / "late_of_a_test.py").write_text(LATE)
    assert python(tmp_path, "late_of_a_test.py").stdout == "2.0 0 0\n8.0 0 1\n"
    for file in (tmp_path / "cache/pinfric").glob(lost):
        file.unlink()
    (tmp_path / "late_of_a_test.py").write_text(LATE.replace(*edit))
    last = "6.0" if edit[0] else "8.0"
    for found in hits, 1:
        done = python(tmp_path, "late_of_a_test.py")
        assert done.stdout == f"2.0 {found} 0\n{last} {found} 1\n"
