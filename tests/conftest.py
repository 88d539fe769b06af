"""pinfric first: it sets OMP_WAIT_POLICY, which counts only if set before Pinocchio loads."""

import gc
import os
import signal
import sys
from pathlib import Path

if sys.dont_write_bytecode:  # each process, and each that a test starts, would read all source anew
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = str(Path(__file__).parents[1] / ".pytest_cache/bytecode")
    sys.dont_write_bytecode, sys.pycache_prefix = False, os.environ["PYTHONPYCACHEPREFIX"]

if "PYTEST_XDIST_WORKER" in os.environ:  # a process per core: threads of BLAS only wait there
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pinfric  # noqa: F401  # isort: skip

import pytest
from cli_cases import SCENE, URDF, WAY
from judges import verdict
from judges.enumeration import enumerate_states
from xdist.scheduler import LoadScopeScheduling

from pinfric.kernels import compiled, interpreted

# A collection of garbage visits all objects of all modules: collect more seldom.
gc.set_threshold(20_000)

# `nohup` and a shell's `&` ignore Ctrl-C, and what tests start would, too.
signal.signal(signal.SIGINT, signal.default_int_handler)

# What a command prints is compared word for word, be the kernels compiled already or not.
compiled.PROGRESS.begin = lambda *_: None


#: What compiles most comes first. Files that share kernels or costly fixtures run in one process,
#: those whose path begins alike under one name; the others find the kernels in the cache. While one
#: process compiles for forward dynamics, the other identifies: that needs few of the same kernels.
FIRST = {
    "dynamics/forward/test_forward.py": "forward dynamics",
    "identification/": "identification",
    "show/pages/test_identification": "identification",
    "show/figure/test_steps.py": "identification",
    "retiming/": "retiming",
    "show/report/test_retime.py": "retiming",
    "dynamics/samples/": "inverse dynamics",
    "dynamics/inverse/": "inverse dynamics",
    "judges/test_cases_inverse.py": "inverse dynamics",
    "friction/": "holding",
    "judges/test_linked_forward.py": "holding",
    "dynamics/forward/test_solver.py": "holding",
    "sweeps/test_superposition.py": "sweeps",
    "show/report/test_sweep.py": "sweeps",
    "show/figure/test_sweep.py": "sweeps",
    "judges/test_coupled_solvers.py": "accuracy",
    "accuracy/": "accuracy",
    "exporting/": "exports",
    "show/report/test_export.py": "exports",
    "dynamics/forward/test_compensation.py": "exports",
    "show/timeline/": "replays",
    "show/replay/": "replays",
    "motions/log/": "logs",
}


#: Files of long tests that share nothing: one by one, so that all processes end together.
LAST = (
    *("judges/test_stuck_loops.py", "judges/test_rounding.py", "judges/test_seams.py"),
    "end_to_end/test_notebooks.py",
)


def place(nodeid):
    """A test's file as the tables name it."""
    return nodeid.partition("::")[0].removeprefix("tests/")


def together(file):
    """The name under which a file's tests run in one process, and when that is."""
    for rank, (start, name) in enumerate(FIRST.items()):
        if file.startswith(start):
            return rank, name
    return len(FIRST) + (file in LAST), file


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: together(place(item.nodeid))[0])
    for item in items:  # what readers of logs have done is in `motion.warnings`, which is tested
        if place(item.nodeid).startswith("motions/"):
            item.add_marker(pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning"))


def pytest_collection_finish():
    """Let tests use compiled kernels; interpreted ones have their own (`test_interpreted.py`)."""
    interpreted.PATIENCE = 0.0


class Scheduling(LoadScopeScheduling):
    """A file's tests in one process: it compiles their kernels and makes their fixtures once."""

    def _split_scope(self, nodeid):
        file = place(nodeid)
        return nodeid if file in LAST else together(file)[1]


def pytest_xdist_make_scheduler(config, log):
    return Scheduling(config, log)


@pytest.fixture(autouse=True)
def proved_states(request, monkeypatch):
    """Let the judge prove states by intervals where inverse dynamics is tested."""
    folder, file = request.path.parent.name, request.path.name
    if folder in ("inverse", "judges") and file != "test_verdict.py":
        monkeypatch.setattr(verdict, "find_states", enumerate_states)


@pytest.fixture
def files(tmp_path, monkeypatch):
    for name, text in (("arm.urdf", URDF), ("arm.yaml", SCENE), ("way.yaml", WAY)):
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path
