"""Sweeps on processes and clusters: the same figures, and one line where something is lost."""

import contextlib
import json
import logging
import os
import random
import signal
import socket
import subprocess
import sys
import textwrap
import threading
from pathlib import Path
from time import monotonic, sleep

import pytest
from builders import example
from numpy.testing import assert_array_equal
from processes import children, workers
from sweep_cases import pushed_block, steady, sweep_of, uniform

import pinfric as pf
from pinfric.errors import SweepError
from pinfric.sweeps.cycle import compute
from pinfric.sweeps.workers import on_cluster

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning:distributed")

HELPERS = str(Path(__file__).parents[1] / "helpers")
#: No test may wait for longer (s): a stalled cluster must fail, not hang.
LIMIT = 90
SAMPLES = 120
SWEEP = sweep_of(
    SAMPLES,
    speed=uniform(0.8, 1.2),
    payload__box__mass=uniform(1.0, 3.0),
    friction__all__coulomb=uniform(0.5, 2.0, each=True),
    mounting__roll=uniform(-0.05, 0.05),
)


@pytest.fixture(autouse=True)
def _limit():
    def stop(*_):
        raise TimeoutError(f"not done after {LIMIT} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LIMIT)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def test_no_more_processes_than_cores_and_batches_are_started(monkeypatch):
    scene, sweep = pushed_block(), sweep_of(3, speed=uniform(0.8, 1.2))
    asked = []

    def compute_here(study, batches, values, processes, jobs):
        asked.append(jobs)
        return ((rows, compute(study, values[rows])) for rows in batches)

    monkeypatch.setattr("pinfric.sweeps.run.compute_in_parallel", compute_here)
    monkeypatch.setattr("joblib.cpu_count", lambda: 64)
    found = pf.sweep(scene, steady(scene), sweep, processes=5000)
    assert (asked, found.processes) == ([3], 3)
    monkeypatch.setattr("joblib.cpu_count", lambda: 2)
    assert pf.sweep(scene, steady(scene), sweep, processes=5000).processes == 2


@pytest.fixture(scope="module")
def panda():
    return example("panda_pick_and_place", "panda_pick_and_place.csv")


@pytest.fixture(scope="module")
def undisturbed(panda):
    return pf.sweep(*panda, SWEEP, processes=1)


class KillOne:
    """Progress that kills one process in the middle of the run."""

    def __init__(self, candidates):
        self.candidates, self.killed = candidates, None

    def __call__(self, done, total):
        if self.killed is None and 0 < done < total / 2:
            self.killed = next(iter(self.candidates()), None)
            if self.killed is not None:
                os.kill(self.killed, signal.SIGKILL)


@pytest.mark.slow
def test_lost_processes_are_said_in_one_line(panda, recwarn):
    progress = KillOne(lambda: workers(os.getpid()))
    with pytest.raises(SweepError, match=r"^one of 2 processes was killed .*fewer `processes`$"):
        pf.sweep(*panda, SWEEP, processes=2, progress=progress)
    assert progress.killed is not None
    assert not recwarn.list
    again = pf.sweep(*panda, SWEEP, processes=2)
    assert again.processes == 2


@pytest.fixture(scope="module")
def distributed():
    """Imported where a test needs it: all that collect tests would wait two seconds."""
    return pytest.importorskip("distributed")


@pytest.fixture
def scheduler(distributed, tmp_path):
    """A scheduler and two workers as on a cluster, each a process of its own; yields the first."""
    file = tmp_path / "scheduler.json"
    common = ["--scheduler-file", str(file), "--host", "127.0.0.1", "--no-dashboard"]
    with contextlib.ExitStack() as stack:
        running = []
        for kind, *more in (
            ["scheduler", "--port", "0"],
            ["worker", "--nworkers", "2", "--nthreads", "1", "--death-timeout", "5"],
        ):
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.dask_{kind}", *common, *more],
                cwd=tmp_path,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            stack.callback(_kill_all, process)
            running.append(process)
            until = monotonic() + LIMIT
            while not file.exists():
                assert monotonic() < until
                sleep(0.05)
        running[0].address = json.loads(file.read_text())["address"]
        with distributed.Client(running[0].address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield running[0]


def _kill_all(process):
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@pytest.mark.slow
def test_workers_that_finish_nothing_are_said(panda, monkeypatch):
    monkeypatch.setattr("pinfric.sweeps.workers._PATIENCE", 0.01)
    with pytest.raises(SweepError, match=r"^no worker finished a batch in 0.01 s$"):
        pf.sweep(*panda, SWEEP, processes=2)


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["nobody", "worker", "scheduler"])
def test_a_cluster_gives_the_figures_of_one_process(
    distributed, panda, undisturbed, scheduler, lost
):
    with distributed.Client(scheduler.address, set_as_default=False) as client:
        pids = list(client.run(os.getpid).values())
    progress = KillOne(lambda: {"nobody": [], "worker": pids, "scheduler": [scheduler.pid]}[lost])
    said = r"^the cluster at tcp://\S+ failed: "
    with pytest.raises(SweepError, match=said) if lost == "scheduler" else contextlib.nullcontext():
        with on_cluster(scheduler.address):
            found = pf.sweep(*panda, SWEEP, progress=progress)
        assert_array_equal(found.figures, undisturbed.figures)
        assert_array_equal(found.values, undisturbed.values)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["--processes=1", "--processes=2", "--cluster"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_sweep_and_leaves_nothing(scheduler, tmp_path, how, number):
    chance = random.Random(f"{how} {number}")
    how = f"--cluster={scheduler.address}" if how == "--cluster" else how
    folder = tmp_path / "here"
    folder.mkdir()
    panda = ["panda_pick_and_place", "panda_pick_and_place.csv", "panda_pick_and_place"]
    for _ in range(3):
        process = subprocess.Popen(
            [sys.executable, "-m", "pinfric", "sweep", *panda, how, "--out", "out"],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        sleep(chance.uniform(0.3, 6.0))
        below, start = children(process.pid), monotonic()
        os.killpg(process.pid, number)
        _, error = process.communicate(timeout=10)
        assert monotonic() - start < 3.0
        assert (process.returncode, error) == (130, "pinfric: error: interrupted\n")
        assert list(folder.iterdir()) == []
        until = monotonic() + 2.0
        while any(Path(f"/proc/{pid}").exists() for pid in below):
            assert monotonic() < until, "processes are left"
            sleep(0.02)


@pytest.mark.parametrize("address", ["closed", "nonsense", "nobody.invalid:8786", "http", "ssh"])
def test_a_scheduler_that_does_not_answer_is_said(distributed, address, monkeypatch):
    monkeypatch.setattr("pinfric.sweeps.workers._CONNECT_TIMEOUT", 0.5)
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        here = f"127.0.0.1:{listener.getsockname()[1]}"
        if address == "ssh":
            listener.listen()
            threading.Thread(target=_greet_as_ssh, args=(listener,), daemon=True).start()
        schemes = {"closed": "tcp", "ssh": "tcp", "http": "http"}
        named = f"{schemes[address]}://{here}" if address in schemes else address
        start = monotonic()
        said = f"no Dask scheduler answers at {named}: "
        with pytest.raises(SweepError, match=said), on_cluster(named):
            pass
    assert monotonic() - start < 10
    for logger in ("distributed", "distributed.client", "tornado.application"):  # of own levels
        assert not logging.getLogger(logger).isEnabledFor(logging.ERROR)


def _greet_as_ssh(listener):
    held = []
    with contextlib.suppress(OSError):  # the test closes the listener
        while True:
            held.append(listener.accept()[0])
            held[-1].sendall(b"SSH-2.0-OpenSSH_9.2p1\r\n")


@pytest.mark.slow
def test_script_without_a_main_guard_runs_on_processes(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(f"""
        import sys
        sys.path.insert(0, {HELPERS!r})
        from sweep_cases import pushed_block, steady, sweep_of, uniform
        import pinfric as pf
        scene = pushed_block()
        found = pf.sweep(scene, steady(scene), sweep_of(40, speed=uniform(1, 2)), processes=2)
        print("once", found.solved.sum(), found.processes)
    """)
    )
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["once 40 2"]
    assert [line for line in done.stderr.splitlines() if ": compiling kernels" not in line] == []


@pytest.mark.slow
def test_classes_and_limits_of_a_script_reach_the_processes(tmp_path):
    """Both are in `__main__`, as in a notebook; the processes have pinfric alone."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(f"""
        import sys
        from typing import Literal
        sys.path.insert(0, {HELPERS!r})
        from pathlib import Path
        from numpy.testing import assert_array_equal
        import pinfric as pf
        from pinfric.drives.limit import Limit
        from pinfric.drives.limits import add_limit
        from pinfric.model.bearings import FX, FY, Bearing, LoadTerms, bearing_kind, norm_of
        from sizing_cases import trapezoid, turntable, write_catalog
        from sweep_cases import sweep_of, uniform

        @bearing_kind
        class Sleeve(Bearing):
            fits = ("turning joint",)
            kind: Literal["sleeve"]
            def terms(self):
                return LoadTerms([0.02 * norm_of(FX, FY)])

        add_limit(Limit("coupling torque", need="motor torque", gives=lambda _: 0.3,
                        unit="torque", formula="max |T_m| <= T_c", source="data sheet"))
        scene = turntable()
        rubbing = {{"bearing": {{"kind": "sleeve"}}, "mu": {{"static": 0.3, "kinetic": 0.3}}}}
        scene = scene.with_(friction={{"table": rubbing}})
        catalog = str(write_catalog(Path({str(tmp_path)!r}) / "catalog.yaml"))
        given = {{**sweep_of(40, motors={{"table": {{"drive": "M + G"}}}}, speed=uniform(0.9, 1.3)),
                  "catalog": catalog}}
        one, two = (pf.sweep(scene, trapezoid(scene), given, processes=n) for n in (1, 2))
        assert_array_equal(one.figures, two.figures)
        (trial,) = two.trials
        met = two.met(trial)["coupling torque"]
        assert_array_equal(met, two.figure("motor_peak")[:, 0] <= 0.3)
        print("both", 0 < met.sum() < 40)
        """)
    )
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["both True"]


def test_without_the_extra_a_cluster_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    said = r"pip install \"pinfric\[cluster\]\""
    with pytest.raises(SweepError, match=said), on_cluster("tcp://x:1"):
        pass


@pytest.mark.slow
def test_long_sweeps_take_all_cores(monkeypatch):
    monkeypatch.setattr("pinfric.sweeps.run._SHORT", 0.0)
    monkeypatch.setattr("joblib.cpu_count", lambda: 2)
    scene = pushed_block()
    assert pf.sweep(scene, steady(scene), sweep_of(8, speed=uniform(1, 2))).processes == 2
