"""Sweeps on processes and clusters: the same figures, whatever is lost on the way."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap
import threading
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest
from builders import example
from processes import workers
from sweep_cases import pushed_block, steady, sweep_of, uniform

import pinfric as pf
from pinfric.errors import PinfricWarning, SweepError

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning:distributed")

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


@pytest.fixture(scope="module")
def panda():
    return example("panda_pick_and_place", "panda_pick_and_place.csv")


@pytest.fixture(scope="module")
def undisturbed(panda):
    return pf.sweep(*panda, SWEEP, processes=1)


class KillOne:
    """Progress that kills one worker in the middle of the run."""

    def __init__(self, candidates):
        self.candidates, self.killed, self.counts = candidates, None, []

    def __call__(self, done, total):
        self.counts.append(done)
        if self.killed is None and 0 < done < total / 2:
            self.killed = self.candidates()[0]
            os.kill(self.killed, signal.SIGKILL)


def check_undisturbed(found, undisturbed, progress):
    assert progress.killed is not None
    assert progress.counts == sorted(set(progress.counts))  # every batch came once
    assert progress.counts[-1] == SAMPLES
    np.testing.assert_array_equal(found.figures, undisturbed.figures)
    np.testing.assert_array_equal(found.values, undisturbed.values)
    assert found.solved.all()


@pytest.mark.slow
def test_cluster_that_loses_a_worker_gives_the_undisturbed_result(panda, undisturbed):
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",
        silence_logs=50,
    ) as cluster:
        with distributed.Client(cluster, set_as_default=False) as client:
            pids = list(client.run(os.getpid).values())
        assert len(set(pids)) == 2
        assert os.getpid() not in pids
        progress = KillOne(lambda: pids)
        with pytest.warns(PinfricWarning, match=r"^worker tcp://\S+ was lost; others compute"):
            found = pf.sweep(*panda, SWEEP, scheduler=cluster.scheduler_address, progress=progress)
        with distributed.Client(cluster, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=30)
            now = set(client.run(os.getpid).values())
    assert progress.killed not in now  # it is gone; its nanny has started another
    assert len(now) == 2
    check_undisturbed(found, undisturbed, progress)
    assert found.processes == 0


@pytest.mark.slow
def test_own_processes_survive_a_lost_one(panda, undisturbed):
    progress = KillOne(lambda: workers(os.getpid()))
    found = pf.sweep(*panda, SWEEP, processes=2, progress=progress)
    check_undisturbed(found, undisturbed, progress)
    assert found.processes == 2


@pytest.mark.slow
def test_processes_that_are_killed_again_and_again_are_said(monkeypatch):
    monkeypatch.setattr("pinfric.sweeps.workers._compute_on_worker", _die)
    scene = pushed_block()
    with pytest.raises(SweepError, match=r"processes were killed 4 times.*fewer `processes`"):
        pf.sweep(scene, steady(scene), sweep_of(8, speed=uniform(1, 2)), processes=2)


def _die(*_):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.fixture
def scheduler(tmp_path):
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
def test_scheduler_lost_in_the_run_is_said(panda, scheduler, monkeypatch):
    monkeypatch.setattr("pinfric.sweeps.run._MOST_PER_BATCH", 1)  # so that many are under way
    sweep = {**SWEEP, "samples": 3000}
    counts = []

    def lose(done, total):
        counts.append(done)
        if len(counts) == 4:
            scheduler.kill()

    with pytest.raises(SweepError, match=r"connection to the scheduler is lost"):
        pf.sweep(*panda, sweep, scheduler=scheduler.address, progress=lose)


@pytest.mark.parametrize(
    ("address", "waits"),
    [
        *((x, 0.5) for x in ("closed", "silent", "nonsense", "nobody.invalid:8786", "http", "ssh")),
        pytest.param("silent", None, marks=pytest.mark.slow),  # for as long as users do
    ],
)
def test_scheduler_that_cannot_be_reached_is_said_within_ten_seconds(address, waits, monkeypatch):
    if waits is not None:
        monkeypatch.setattr("pinfric.sweeps.workers._CONNECT_TIMEOUT", waits)
    scene = pushed_block()
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port = listener.getsockname()[1]
        if address in ("silent", "ssh"):  # takes the connection and says nothing, or its own name
            listener.listen()
        if address == "ssh":
            threading.Thread(target=_greet_as_ssh, args=(listener,), daemon=True).start()
        here = f"tcp://127.0.0.1:{port}"
        named = {
            "closed": here,
            "silent": here,
            "ssh": here,
            "http": f"http://127.0.0.1:{port}",
        }.get(address, address)
        start = monotonic()
        with pytest.raises(SweepError, match="cannot be reached") as caught:
            pf.sweep(scene, steady(scene), sweep_of(speed=uniform(1, 2)), scheduler=named)
    assert monotonic() - start < 10
    assert named in str(caught.value)
    assert ("is not a Dask scheduler" in str(caught.value)) == (address == "ssh")


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
        sys.path.insert(0, {str(Path(__file__).parents[1])!r})
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
    """Both stand in `__main__`, as in a notebook; the processes have pinfric alone."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(f"""
        import sys
        from typing import Literal
        sys.path.insert(0, {str(Path(__file__).parents[1])!r})
        from pathlib import Path
        import numpy as np
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
        np.testing.assert_array_equal(one.figures, two.figures)
        (trial,) = two.trials
        met = trial.met(two)["coupling torque"]
        np.testing.assert_array_equal(met, two.figure("motor_peak")[:, 0] <= 0.3)
        print("both", 0 < met.sum() < 40)
        """)
    )
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["both True"]


def test_without_the_extra_a_cluster_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed.comm", None)
    scene = pushed_block()
    with pytest.raises(SweepError, match=r"pip install \"pinfric\[cluster\]\""):
        pf.sweep(scene, steady(scene), sweep_of(8, speed=uniform(1, 2)), scheduler="tcp://x:1")


@pytest.mark.slow
def test_long_sweeps_take_all_cores(monkeypatch):
    monkeypatch.setattr("pinfric.sweeps.run._SHORT", 0.0)
    monkeypatch.setattr("joblib.cpu_count", lambda: 2)
    scene = pushed_block()
    assert pf.sweep(scene, steady(scene), sweep_of(8, speed=uniform(1, 2))).processes == 2
