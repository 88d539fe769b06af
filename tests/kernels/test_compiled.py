"""Kernels survive a damaged cache; compiling is reported, cached kernels are not compiled."""

import ctypes
import os
import re
import runpy
import shutil
import subprocess
import sys
import time
import warnings
from collections import namedtuple
from contextlib import suppress
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numba
import numpy as np
import pytest
from builders import example

import pinfric as pf
from pinfric.errors import PinfricError, PinfricWarning
from pinfric.kernels import compiled
from pinfric.kernels.compiled import call_compiled, check_numba
from pinfric.kernels.progress import CompileProgress
from pinfric.kernels.records import RecordType

ROOT = Path(__file__).parents[2]
KERNEL = """
from pinfric.kernels import interpreted
from pinfric.kernels.compiled import kernel

interpreted.PATIENCE = 0.0

@kernel
def twice(x):
    return 2.0 * x

if __name__ == "__main__":
    print(twice(21.0))
"""
CONSTANTS = """
from numba import njit
from pinfric.kernels.compiled import kernel

@{0}
def chosen(k, twice, x):
    return 2.0 * x if twice else x + k

@{0}
def all_four(x):
    return chosen(0, True, x) + chosen(1, True, x) + chosen(1, False, x) + chosen(0, False, x)
"""
FIELDS = """
from fields_of_a_test import Pair
from pinfric.kernels.compiled import kernel
from pinfric.kernels.records import record

@kernel
def of_argument(pair):
    return pair.first[0] - pair.second[0]

@kernel
def of_several(pairs):
    return of_argument(pairs[1])

@kernel
def of_its_own(x):
    return Pair(x, x + 1).second - x

box = record(Pair)
"""
#: The first friction (N m) of a motion by `Solver.inverse`, without its other kernels.
FRICTION = """
import sys
import numpy as np
import pinfric as pf
from pinfric.dynamics.forward.solver import box_sample, finish_sample, make_sample
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.kernels.compiled import compiling

scene = pf.load_scene(sys.argv[1])
ws = Workspace(scene)
x = make_sample(ws, scene)
ws.pinocchio.balance(*np.ones((3, scene.model.nv)))
with compiling():
    finish_sample(box_sample(x), *np.ones((3, scene.model.nv)))
hits = sum(finish_sample._cache_hits.values())
print(scene.site_tables._fields[0], x.found.friction_lower[0, 0], hits)
"""
CHAIN = """
import sys
import numba
from pinfric.kernels import compiled, interpreted
from pinfric.kernels.compiled import kernel

interpreted.PATIENCE, compiled._COPIED = 0.0, 0  # called where they are, however small

@kernel
def half(x):
    return 0.5 * x

@kernel
def quarter(x):
    return half(half(x))

@kernel
def eighth(x):
    return half(quarter(x))

if sys.argv[1:]:
    numba.njit(lambda: 0)()  # counted, as all that numba compiles in a process
for each in [globals()[name] for name in sys.argv[1:]] or [eighth]:
    print(each(8.0), sum(eighth._cache_hits.values()), file=sys.stderr)
"""
#: A kernel that returns an array, which another calls.
ARRAY = """
import numpy as np
from pinfric.kernels import interpreted
from pinfric.kernels.compiled import kernel

interpreted.PATIENCE = 0.0

@kernel
def doubled(x):
    return 2.0 * x

@kernel
def total(x):
    return doubled(x).sum()
"""


def environment(folder, path=ROOT):
    return os.environ | {"PYTHONPATH": str(path), "NUMBA_CACHE_DIR": str(folder / "cache")}


def python(folder, *arguments, path=ROOT, **more):
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        env=environment(folder, path) | more,
        check=True,
        timeout=120,
    )


def run(folder):
    """(result, cache hits, warnings) of a kernel made anew, as in another process."""
    twice = runpy.run_path(folder / "kernel_of_a_test.py")["twice"]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        answer = twice(21.0)
    return answer, sum(twice._cache_hits.values()), "".join(str(w.message) for w in said)


@pytest.mark.parametrize(
    ("written", "hits", "damage"),
    [
        ("first.nbc", 0, lambda content: content[: len(content) // 2]),
        ("first.nbc", 0, lambda content: b""),
        ("first.nbi", 0, lambda content: content[:-5]),
        ("first.nbc", 0, lambda content: content[:700] + bytes([content[700] ^ 1]) + content[701:]),
        ("last.nbc", 1, lambda content: content[: len(content) // 2]),
    ],
    ids=["truncated", "empty", "truncated index", "one bit", "what Python calls"],
)
def test_a_damaged_cache_is_said_and_compiled_anew(written, hits, damage, tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "kernel_of_a_test.py").write_text(KERNEL)
    assert run(tmp_path) == (42.0, 0, "")
    assert run(tmp_path) == (42.0, 1, "")  # from the cache
    which, suffix = written.split(".")
    files = sorted(
        (tmp_path / "cache").rglob(f"*.{suffix}"), key=lambda file: file.stat().st_mtime_ns
    )
    assert len(files) == (2 if suffix == "nbc" else 1)
    file = files[0 if which == "first" else -1]
    file.write_bytes(damage(file.read_bytes()))
    answer, found, said = run(tmp_path)
    assert (answer, found) == (42.0, hits)
    assert f"{file}: a compiled kernel in numba's cache is damaged" in said
    assert run(tmp_path) == (42.0, 1, "")  # mended


def test_a_copy_with_its_cache_compiles_nothing(tmp_path, monkeypatch):
    """As an installation or a restored CI cache: other folder, other dates."""
    monkeypatch.setattr("numba.config.CACHE_DIR", "")  # beside the kernels, whatever the caller set
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    (first / "kernel_of_a_test.py").write_text(KERNEL)
    assert run(first) == (42.0, 0, "")
    shutil.copytree(first, second, copy_function=shutil.copyfile)
    assert run(second) == (42.0, 1, "")
    (second / "kernel_of_a_test.py").write_text(KERNEL.replace("2.0", "3.0"))
    assert run(second)[:2] == (63.0, 0)


def test_clones_share_a_cache_and_their_versions_stay_beside_each_other(tmp_path, monkeypatch):
    """In the folder of NUMBA_CACHE_DIR, which numba divides by the clones' paths."""
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    kept, clones = compiled._KEPT, [tmp_path / str(number) for number in range(10)]
    for clone in clones:
        clone.mkdir()
        (clone / "kernel_of_a_test.py").write_text(KERNEL)
    assert [run(clone)[:2] for clone in clones[:3]] == [(42.0, 0), (42.0, 1), (42.0, 1)]
    for factor, clone in enumerate(clones[1:], 3):
        (clone / "kernel_of_a_test.py").write_text(KERNEL.replace("2.0 *", f"{factor}.0 *"))
        assert run(clone)[:2] == (21.0 * factor, 0)
        assert run(clones[0])[:2] == (42.0, 1)  # used all the time, and so it stays
    assert kept == 8
    for suffix, each in ("nbi", 1), ("nbc", 2):  # the kernel, and what Python calls
        assert len(list((tmp_path / "cache/pinfric").glob(f"*.{suffix}"))) == each * kept
    assert run(clones[3])[1] == 1
    assert run(clones[2])[1] == 0  # of those used least recently


@pytest.mark.parametrize(("decorator", "count"), [("njit", 4), ("kernel", 1)])
def test_constants_of_a_type_share_one_kernel(decorator, count, tmp_path, monkeypatch):
    """Numba compiles a callee, and all below it, for each constant argument."""
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "constants_of_a_test.py").write_text(CONSTANTS.format(decorator))
    made = runpy.run_path(tmp_path / "constants_of_a_test.py")
    assert call_compiled(made["all_four"], 21.0) == 127.0
    assert len(made["chosen"].signatures) == count


def test_a_cache_that_names_a_class_gone_since_is_compiled_anew(tmp_path, monkeypatch):
    """Types of arguments are pickled; the file of their class may be none of a kernel's sources."""
    module = ModuleType("of_an_older_version")
    module.Gone = type("Gone", (), {"__module__": module.__name__})
    monkeypatch.setitem(sys.modules, module.__name__, module)
    file = compiled._CheckedFile(str(tmp_path), "kernel", ("sources",))
    file.save(module.Gone(), 42.0)
    assert file.load("key") is None
    del module.Gone
    assert file.load("key") is None
    file.save("key", 42.0)
    assert file.load("key") == 42.0


@pytest.mark.parametrize("how", ["argument", "record", "in a tuple", "of its own"])
def test_fields_in_another_order_are_another_kernel(how, tmp_path, monkeypatch):
    """Kernels read fields by their places; numba knows a NamedTuple by its class."""
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "kernels_of_a_test.py").write_text(FIELDS)
    module = ModuleType("fields_of_a_test")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    for order, hits in (("first", "second"), 0), (("second", "first"), 0), (("second", "first"), 1):
        module.Pair = namedtuple("Pair", order, module=module.__name__)
        module.__file__ = str(tmp_path / "kernels_of_a_test.py")
        kernels = ModuleType("kernels_of_a_test")
        kernels.__file__ = module.__file__
        monkeypatch.setitem(sys.modules, kernels.__name__, kernels)
        exec(compile(FIELDS, kernels.__file__, "exec"), vars(kernels))
        pair = module.Pair(first=np.array([5.0]), second=np.array([2.0]))
        if how == "of its own":
            called, answer = kernels.of_its_own, call_compiled(kernels.of_its_own, 1.0)
            assert answer == (1.0 if order[0] == "first" else 0.0)
        elif how == "in a tuple":
            called, answer = kernels.of_several, call_compiled(kernels.of_several, (pair, pair))
            assert answer == 3.0
        else:
            given = kernels.box(pair) if how == "record" else pair
            called, answer = kernels.of_argument, call_compiled(kernels.of_argument, given)
            assert answer == 3.0
        assert sum(called._cache_hits.values()) == hits


@pytest.mark.slow
def test_a_package_with_fields_in_another_order_does_not_read_the_kernels_of_this_one(tmp_path):
    """As after an update: one folder of kernels, `SiteTables` with two fields changed over."""
    shutil.copytree(
        ROOT / "pinfric", tmp_path / "pinfric", ignore=shutil.ignore_patterns("__pycache__")
    )
    said = []
    for swaps in (False, True):
        if swaps:
            file = tmp_path / "pinfric/model/scene.py"
            first, last = "    joint: np.ndarray\n", "    velocity_index: np.ndarray\n"
            text = file.read_text()
            begin, end = text.split("class SiteTables(NamedTuple):")
            end = end.replace(first, "\0", 1).replace(last, first, 1).replace("\0", last)
            file.write_text(f"{begin}class SiteTables(NamedTuple):{end}")
        for _ in range(2):
            run = python(tmp_path, "-c", FRICTION, str(ROOT / "robots/go2.yaml"), path=tmp_path)
            said.append(run.stdout.split())
    fields, friction, hits = zip(*said, strict=True)
    assert fields == ("joint", "joint", "velocity_index", "velocity_index")
    assert hits == ("0", "1", "0", "1")
    assert len(set(friction)) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lost", "compiled_before", "hit"),
    [
        ("none.*", [], 1),
        ("*half*", [], 0),
        ("*quarter*.nbc", [], 0),
        ("*half*.nbi", ["half"], 1),  # in another process, under the same symbol
        ("*", ["half", "quarter"], 0),
    ],
)
def test_a_kernel_is_read_with_those_that_it_calls(lost, compiled_before, hit, tmp_path):
    """LLVM ends a process that calls what is not there."""
    (tmp_path / "chain_of_a_test.py").write_text(CHAIN)
    assert "1.0 0" in python(tmp_path, "chain_of_a_test.py").stderr
    for file in (tmp_path / "cache/pinfric").glob(lost):
        file.unlink()
    if compiled_before:
        python(tmp_path, "chain_of_a_test.py", *compiled_before)
    assert f"1.0 {hit}" in python(tmp_path, "chain_of_a_test.py").stderr
    assert python(tmp_path, "chain_of_a_test.py").stderr == "1.0 1\n"


def test_python_gets_the_array_of_a_kernel_that_was_compiled_for_a_caller(tmp_path, monkeypatch):
    """The second process, which found it in the cache, crashed."""
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "array_of_a_test.py").write_text(ARRAY)
    x = np.arange(3.0)
    before = sys.getrefcount(x)
    assert runpy.run_path(tmp_path / "array_of_a_test.py")["total"](x) == 6.0
    for _ in range(2):  # what Python calls is written, then read
        doubled = runpy.run_path(tmp_path / "array_of_a_test.py")["doubled"]
        assert doubled(x).tolist() == [0.0, 2.0, 4.0]
        assert sum(doubled._cache_hits.values()) == 1
    assert sys.getrefcount(x) == before


def survive(folder, kills):
    """Kill processes while they compile, each other sources; a second one reads what is left."""
    rng, took, stopped = np.random.default_rng(0), 1.0, 0
    for number in range(kills):
        text = CHAIN.replace("0.5 * x", f"(0.5 + {number} - {number}) * x")
        (folder / "chain_of_a_test.py").write_text(f"print('ready', flush=True)\n{text}")
        command = [sys.executable, "-u", "chain_of_a_test.py"]
        process = subprocess.Popen(
            command, cwd=folder, env=environment(folder), stdout=subprocess.PIPE, stderr=-3
        )
        process.stdout.readline()
        start = time.perf_counter()
        with suppress(subprocess.TimeoutExpired):
            process.wait(rng.uniform(0.0, took) if number else None)
            took = time.perf_counter() - start
        process.kill()
        stopped += process.wait() != 0
        process.stdout.close()
        read = python(folder, "chain_of_a_test.py").stderr
        assert read.splitlines()[-1] in ("1.0 0", "1.0 1"), read
        assert "damaged" not in read
        assert python(folder, "chain_of_a_test.py").stderr == "1.0 1\n"
    return stopped


@pytest.mark.slow
def test_processes_killed_while_they_compile_leave_a_cache_that_is_read(tmp_path):
    assert survive(tmp_path, 6) >= 2


@pytest.mark.slow
def test_two_processes_fill_one_cache_at_the_same_time(tmp_path):
    (tmp_path / "chain_of_a_test.py").write_text(CHAIN)
    command, given = [sys.executable, "chain_of_a_test.py"], environment(tmp_path)
    both = [subprocess.Popen(command, cwd=tmp_path, env=given, stderr=-1) for _ in range(2)]
    said = [process.communicate()[1].decode() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert all("1.0 " in text and "damaged" not in text for text in said)
    assert python(tmp_path, "chain_of_a_test.py").stderr == "1.0 1\n"


@pytest.mark.slow
def test_each_processor_has_kernels_of_its_own_in_one_cache(tmp_path):
    (tmp_path / "chain_of_a_test.py").write_text(CHAIN)
    targets = [{}, {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}]
    for hit in "01":
        for target in targets:
            last = python(tmp_path, "chain_of_a_test.py", **target).stderr.splitlines()[-1]
            assert last == f"1.0 {hit}"


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_does_not_stop_a_command(tmp_path):
    """Its files cannot be made anew; they are read, or compiled in this run."""
    (tmp_path / "chain_of_a_test.py").write_text(CHAIN)
    python(tmp_path, "chain_of_a_test.py")
    shutil.move(tmp_path / "cache", tmp_path / "kept")
    (tmp_path / "cache").write_text("no folder")
    for _ in range(2):
        last = python(tmp_path, "chain_of_a_test.py").stderr.splitlines()[-1]
        assert last.startswith("1.0 ")


def bound_by_modes():
    """Let a child's root write no more than the modes of folders allow: no CAP_DAC_OVERRIDE."""
    ctypes.CDLL(None).prctl(24, 1, 0, 0, 0)  # PR_CAPBSET_DROP; others than root need it not


@pytest.mark.slow
def test_a_cache_that_may_only_be_read_stops_no_command(tmp_path):
    """As in a container's image: its kernels are read, and it stays as it is."""
    file = tmp_path / "chain_of_a_test.py"
    file.write_text(CHAIN)
    python(tmp_path, file.name)
    folder = tmp_path / "cache/pinfric"
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert before
    folder.chmod(0o555)
    probe = f"open({str(folder / 'probe')!r}, 'w')"
    given = {"cwd": tmp_path, "env": environment(tmp_path), "preexec_fn": bound_by_modes}
    assert subprocess.run([sys.executable, "-c", probe], stderr=-3, **given).returncode == 1
    command = [sys.executable, file.name]
    source = (tmp_path, tmp_path / "__pycache__", home := tmp_path / "home")
    home.mkdir()
    given["env"] |= {"HOME": str(home), "XDG_CACHE_HOME": str(home)}
    for writable in (True, False):  # the folder where numba would keep them instead
        for place in source:
            if place.is_dir():
                place.chmod(0o755 if writable else 0o555)
        done = subprocess.run(command, capture_output=True, text=True, **given)
        assert done.stderr == "1.0 1\n"
    for place in (*source, folder):
        place.chmod(0o755)
    assert {path.name: path.stat().st_mtime_ns for path in folder.iterdir()} == before


@pytest.mark.slow
def test_what_compiles_is_said_on_a_pipe(tmp_path):
    (tmp_path / "kernel_of_a_test.py").write_text(KERNEL)
    first, second = (python(tmp_path, "kernel_of_a_test.py") for _ in range(2))
    assert first.stderr.startswith(
        "pinfric: compiling kernels for this machine; they are kept for later runs\n"
    )
    assert second.stderr == ""
    assert first.stdout == second.stdout == "42.0\n"


@pytest.mark.slow
@pytest.mark.parametrize("quiet", [False, True])
def test_what_compiles_is_drawn_on_a_terminal_and_goes(quiet, tmp_path):
    code = f"from pinfric.kernels import progress\n{KERNEL}"
    before = f"progress._TICK, progress.NOTICES['compiling'] = 0.02, {not quiet}\n\n@kernel"
    (tmp_path / "kernel_of_a_test.py").write_text(code.replace("@kernel", before))
    terminal, end = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "kernel_of_a_test.py"],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=end,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": "cache"},
    )
    os.close(end)
    said = b""
    with suppress(OSError):  # the process has ended
        while part := os.read(terminal, 4096):
            said += part
    assert process.wait() == 0
    first, *drawn = said.decode().split("\r\x1b[K")
    if quiet:
        assert (first, drawn) == ("", [])
        return
    line = "pinfric: compiling kernels for this machine; they are kept for later runs"
    assert first.strip() == line
    assert drawn.pop() == ""
    assert drawn
    form = r"compiling kernels: [01] done in \d+ s, [01] to go in this step"
    assert [line for line in drawn if not re.fullmatch(form, line)] == []


@pytest.mark.slow
def test_what_cannot_be_kept_is_said(tmp_path):
    done = python(tmp_path, "-c", KERNEL)  # numba caches no code that is in no file
    assert done.stdout.split()[0] == "42.0"
    assert (
        "in every run (no folder to keep them in is writable; set NUMBA_CACHE_DIR)" in done.stderr
    )
    assert done.stderr.count("this machine") == 1


@pytest.mark.parametrize("version", ["0.61.0", "0.61.2", "0.68.1", "0.68.0rc1"])
def test_a_tested_numba_is_taken_without_a_word(version, recwarn):
    check_numba(version)
    assert not recwarn.list


@pytest.mark.parametrize("version", ["0.60.0", "0.69.0", "0.70.0dev0", "1.0.0"])
def test_another_numba_is_named_with_those_that_are_tested(version):
    with pytest.warns(PinfricWarning, match=f"numba {version}: .*numba>=0.61,<0.69"):
        check_numba(version)


def test_a_numba_without_what_the_cache_builds_on_is_refused(monkeypatch):
    monkeypatch.delattr("numba.core.caching.IndexDataCacheFile._load_index")
    monkeypatch.delattr("numba.core.dispatcher._DispatcherBase._compile_for_args")
    with pytest.raises(PinfricError) as caught:
        check_numba("0.75.0")
    text = str(caught.value)
    assert "Dispatcher._compile_for_args, IndexDataCacheFile._load_index" in text
    assert "numba>=0.61,<0.69" in text


def test_a_numba_that_compiles_nothing_is_refused(monkeypatch):
    monkeypatch.setattr("numba.config.DISABLE_JIT", 1)
    with pytest.raises(PinfricError, match="NUMBA_DISABLE_JIT=1"):
        check_numba("0.68.1")


def test_the_package_asks_for_the_versions_that_are_tested():
    (line,) = re.findall(r'"(numba>[^"]*)"', (ROOT / "pyproject.toml").read_text())
    with pytest.warns(PinfricWarning) as said:
        check_numba("1.0.0")
    assert line in str(said[0].message)


def test_what_is_left_to_compile_is_what_a_root_reaches_and_the_cache_lacks(monkeypatch):
    monkeypatch.setattr("pinfric.kernels.progress.event.register", lambda *_: None)
    monkeypatch.setattr("pinfric.kernels.progress.time", SimpleNamespace(monotonic=lambda: 100.0))
    said = CompileProgress()
    said._watching = True
    names = {f"k{i}": numba.njit(lambda x: x) for i in range(7)}
    inline = numba.njit(inline="always")(lambda x: x)
    code = f"def root(x):\n    return {'+'.join(f'{n}(x)' for n in names)} + inline(x) + 1"
    exec(code, here := {**names, "inline": inline})
    said.begin(here["root"], "")
    said.on_start(None)
    said._began -= 8.0
    assert re.fullmatch(r"compiling kernels: 0 done in 8 s, 8 to go in this step", said.line())
    said.end(names["k0"].py_func, compiled=False)  # found in the cache
    said.end(names["k1"].py_func, compiled=True)
    left = len(here["root"].__code__.co_code) / len(names["k1"].py_func.__code__.co_code) + 5
    went = "compiling kernels: 1 done in 8 s, 6 to go in this step"
    assert said.line() == f"{went}, about {8 * left:.0f} s"
    said.on_end(None)
    assert "0 to go" in said.line()


LENDS = """
from typing import NamedTuple
import numpy as np
from pinfric.kernels.compiled import kernel
from pinfric.kernels.records import record

class Held(NamedTuple):
    x: np.ndarray
    count: int

box = record(Held)

@kernel
def lends(held):
    return held.x[1:]

@kernel
def lends_beside(held):
    return held.count, (held.x, 1.0)

@kernel
def adds(held, out):
    out[:] = held.x
    return held.count + out.sum()
"""


def test_a_kernel_that_returns_an_array_of_a_record_is_refused(tmp_path, monkeypatch):
    """The array would have no owner: a record counts no references."""
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    module = ModuleType("lends_of_a_test")
    module.__file__ = str(tmp_path / "lends_of_a_test.py")
    Path(module.__file__).write_text(LENDS)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(LENDS, module.__file__, "exec"), vars(module))
    held = module.box(module.Held(np.array([1.0, 2.0]), 3))
    for name in "lends", "lends_beside":
        with pytest.raises(PinfricError, match=f"kernel {name}: takes a record and returns an arr"):
            getattr(module, name)(held)
        assert not getattr(module, name).overloads
    out = np.zeros(2)
    assert module.adds(held, out) == 6.0
    assert (out == [1.0, 2.0]).all()


def test_the_type_of_a_record_is_made_once(monkeypatch):
    """Loops make several records for each 512 samples; its name is a hash of all fields."""
    scene, motion = example("four_bar", "four_bar.waypoints.yaml")
    q, v, a = (np.tile(x, (3, 1)) for x in (motion.q, motion.v, motion.a))
    pf.inverse_dynamics(scene, q[:600], v[:600], a[:600])

    def made_anew(self, fields):
        raise AssertionError(f"{type(self).__name__} is made again")

    monkeypatch.setattr(RecordType, "__init__", made_anew)
    assert len(pf.inverse_dynamics(scene, q, v, a).effort_upper) > 1024


EDITED = {
    "constants_of_a_test": """
FACTOR, BESIDE, TABLE = 2.0, 1.0, (1.0, 2.0)
WEIGHT = 1.0
""",
    "callees_of_a_test": '''
from typing import NamedTuple
from constants_of_a_test import BESIDE, TABLE, WEIGHT
from pinfric.kernels.compiled import kernel
from pinfric.kernels.lanes import on_lanes

class Two(NamedTuple):
    """Built in a kernel."""
    one: float
    other: float

@kernel
def swapped(x):
    """One sentence."""
    return Two(1.0, x)

@kernel
def beside(x):
    return x + BESIDE

def weighted(x):
    """Run by the compiler."""
    return [WEIGHT * each for each in (x, x)]

@on_lanes
def weigh(rows):
    rows[0] = 0.5 * weighted(rows[0])[0] + 0.5 * rows[0]
''',
    "kernels_of_a_test": '''
import numpy as np
from callees_of_a_test import beside, swapped, weigh
from constants_of_a_test import FACTOR, TABLE
from pinfric.kernels.compiled import kernel

def in_python(x):
    return x + 1

@kernel
def whole(x):
    """A docstring."""
    rows = np.full((1, 8), x)
    weigh(rows)
    return FACTOR * swapped(rows[0, 7]).other + TABLE[0] + LATER

@kernel
def apart(x):
    return beside(x)

LATER = 0.5
''',
}


@pytest.mark.parametrize(
    ("of", "old", "new", "answer", "hit"),
    [
        ("kernels", "A docstring", "Another one, longer", 7.5, 1),
        ("kernels", "@kernel\ndef whole", "# a comment\n\n\n@kernel\ndef whole", 7.5, 1),
        ("kernels", "return x + 1", "return x + 2", 7.5, 1),
        ("kernels", "return beside(x)", "return beside(x) + 1", 7.5, 1),
        ("callees", "One sentence", "Two of them", 7.5, 1),
        ("callees", "x + BESIDE", "x - BESIDE", 7.5, 1),
        ("callees", "Run by the", "Run by numba's", 7.5, 1),
        ("constants", "BESIDE, TABLE = 2.0, 1.0", "BESIDE, TABLE = 2.0, 3.0", 7.5, 1),
        ("constants", "FACTOR, BESIDE, TABLE = 2.0", "FACTOR, BESIDE, TABLE = 3.0", 10.5, 0),
        ("constants", "(1.0, 2.0)", "(4.0, 2.0)", 10.5, 0),
        ("kernels", "LATER = 0.5", "LATER = 1.5", 8.5, 0),
        ("kernels", "FACTOR * ", "FACTOR + ", 6.5, 0),
        ("callees", "WEIGHT * each", "WEIGHT + each", 8.5, 0),
        ("callees", "0.5 * rows", "0.25 * rows", 6.0, 0),
        ("constants", "WEIGHT = 1.0", "WEIGHT = 2.0", 10.5, 0),
        ("callees", "Two(1.0, x)", "Two(x, 1.0)", 3.5, 0),
        ("callees", "one: float\n    other", "other: float\n    one", 3.5, 0),
    ],
)
def test_only_edits_that_change_what_a_kernel_computes_compile_it(
    of, old, new, answer, hit, tmp_path, monkeypatch
):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    found = []
    for edited in False, True:
        for name, text in EDITED.items():
            if edited and name.startswith(of):
                assert text.count(old) == 1
                text = text.replace(old, new)
            module = ModuleType(name)
            module.__file__ = str(tmp_path / f"{name}.py")
            Path(module.__file__).write_text(text)
            monkeypatch.setitem(sys.modules, name, module)
            exec(compile(text, module.__file__, "exec"), vars(module))
        result = call_compiled(module.whole, 3.0)
        found.append((result, sum(module.whole._cache_hits.values())))
    assert found == [(7.5, 0), (answer, hit)]


def test_a_kernel_that_another_process_saves_at_the_same_time_is_not_taken_for_it(tmp_path):
    """Both have read the same index, and each writes its own."""
    one, other = (compiled._CheckedFile(str(tmp_path), "kernel", ("sources",)) for _ in range(2))
    write = one._save_data
    one._load_index = other._load_index = dict

    def meanwhile(name, data):
        other.save("integers", 2)
        write(name, data)

    one._save_data = meanwhile
    one.save("floats", 1.0)
    third = compiled._CheckedFile(str(tmp_path), "kernel", ("sources",))
    assert third.load("floats") in (1.0, None)
    assert third.load("integers") in (2, None)
    assert {third.load("floats"), third.load("integers")} != {None}
    third.save("integers", 2)
    third.save("floats", 1.0)
    assert (third.load("floats"), third.load("integers")) == (1.0, 2)
