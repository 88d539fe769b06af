"""pinfric first: it sets OMP_WAIT_POLICY, which counts only if set before Pinocchio loads."""

import pinfric  # noqa: F401  # isort: skip

from xdist.scheduler import LoadScopeScheduling

from pinfric.kernels import compiled, interpreted

# What a command prints is compared word for word, be the kernels compiled already or not.
compiled.say_compiling = lambda again="": None

#: What compiles most comes first, each kernel in one process, that of files of one name; the others
#: find it in the cache.
FIRST = {
    "dynamics/forward/test_forward.py": "forward dynamics",
    "dynamics/samples/test_threaded.py": "inverse dynamics",
    "dynamics/inverse/test_inverse.py": "inverse dynamics",
    "judges/test_cases_inverse.py": "inverse dynamics",
    "dynamics/inverse/test_interval_ends.py": "inverse dynamics",
    "dynamics/inverse/test_linkage.py": "inverse dynamics",
    "friction/test_holding.py": "holding",
    "judges/test_linked_forward.py": "holding",
    "dynamics/forward/test_solver.py": "holding",
    "study/retime/test_retime.py": "retiming",
    "study/retime/test_fastest.py": "retiming",
    "study/sweep/test_superposition.py": "sweeps",
    "show/report/test_sweep.py": "sweeps",
    "judges/test_coupled_solvers.py": "accuracy",
    "show/accuracy/test_report.py": "accuracy",
}
#: Files of long tests that share nothing: one by one, so that all processes end together.
LAST = ("judges/test_stuck_loops.py", "judges/test_rounding.py", "end_to_end/test_notebooks.py")


def place(nodeid):
    """A test's file as the tables name it."""
    return nodeid.partition("::")[0].removeprefix("tests/")


def pytest_collection_modifyitems(items):
    names = list(FIRST)

    def rank(item):
        file = place(item.nodeid)
        return names.index(file) if file in FIRST else len(names) + (file in LAST)

    items.sort(key=rank)


def pytest_collection_finish():
    """Tests are of compiled kernels; what is interpreted has its own (`test_interpreted.py`)."""
    interpreted.PATIENCE = 0.0


class Scheduling(LoadScopeScheduling):
    """A file's tests in one process: it compiles their kernels and makes their fixtures once."""

    def _split_scope(self, nodeid):
        file = place(nodeid)
        return nodeid if file in LAST else FIRST.get(file, file)


def pytest_xdist_make_scheduler(config, log):
    return Scheduling(config, log)
