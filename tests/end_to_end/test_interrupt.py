"""One Ctrl-C ends every command within 2 s, in one line, by exit code 130, at any time.

The signal goes to the whole group of processes, as a terminal sends it.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from processes import children, listening, workers

import pinfric.__main__
from pinfric import cli

ROOT = Path(__file__).parents[2]
PANDA = ["panda_pick_and_place", "panda_pick_and_place.csv"]
COMMANDS = {
    "simulate": ["simulate", "four_bar", "--t-end", "1000"],
    "inverse": ["inverse", *PANDA],
    "size": ["size", *PANDA, "--catalog", "default"],
    "paper": ["paper"],
    "replay": ["replay", "four_bar", "--html", "page.html"],
    "two processes": ["sweep", *PANDA, "panda_pick_and_place", "--processes", "2"],
}

COMMANDS["small sweep"] = [*COMMANDS["two processes"], "--out", "out"]

#: Other commands, at other moments of their imports.
LATER = (("size", 0.3), ("replay", 0.9), ("paper", 1.2))


def begin(name, folder, preexec=None, **environment):
    return subprocess.Popen(
        [sys.executable, "-m", "pinfric", *COMMANDS[name]],
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=preexec,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )


def expect_the_end(process, send=lambda pid: os.killpg(pid, signal.SIGINT), limit=2.0):
    """Ctrl-C once; the process and all below it end within 2 s, in one line."""
    below = children(process.pid)
    start = time.monotonic()
    send(process.pid)
    try:
        _, error = process.communicate(timeout=10)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    assert time.monotonic() - start < limit
    assert process.returncode == cli.INTERRUPTED, error
    lines = error.splitlines()
    assert lines[-1] == "pinfric: error: interrupted"
    assert all(line.startswith("pinfric: ") for line in lines), error
    expect_gone(below, 2.0)


def handles_signals(pid):
    """Whether the entry of the command line has set its handlers: Python itself takes no TERM."""
    caught = Path(f"/proc/{pid}/status").read_text().partition("SigCgt:")[2].split()[0]
    return int(caught, 16) >> (signal.SIGTERM - 1) & 1


def expect_gone(pids, seconds):
    until = time.monotonic() + seconds
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < until, "processes are left"
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("name", "delay"),
    [
        ("simulate", 0.1),
        ("inverse", 0.6),
        *(pytest.param(*c, marks=pytest.mark.slow) for c in LATER),
    ],
)
def test_ctrl_c_while_modules_are_imported(name, delay, tmp_path):
    process = begin(name, tmp_path)
    wait_for(process, lambda: handles_signals(process.pid))
    time.sleep(delay)
    assert process.poll() is None
    expect_the_end(process)


@pytest.mark.parametrize("delay", [2.0, pytest.param(4.0, marks=pytest.mark.slow)])
def test_ctrl_c_while_kernels_are_compiled(delay, tmp_path):
    process = begin("simulate", tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "empty"))
    time.sleep(delay)
    assert process.poll() is None
    expect_the_end(process)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_while_other_processes_work(number, tmp_path):
    process = begin("two processes", tmp_path)
    wait_for(process, lambda: len(workers(process.pid)) >= 2)
    assert not listening(process.pid)  # nobody else on the machine reaches them
    time.sleep(0.3)
    expect_the_end(process, lambda pid: os.killpg(pid, number), 3.0)


def terminate(pid):
    os.kill(pid, signal.SIGTERM)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3])
def test_ctrl_c_after_the_cycles_of_a_sweep(delay, tmp_path):
    """While its figure is drawn, its modules imported or its files written: before, for ever."""
    process = begin("small sweep", tmp_path)
    wait_for(process, lambda: any(tmp_path.glob("out/.unfinished-*/samples.csv")))
    time.sleep(delay)
    expect_the_end(process, limit=3.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_term_is_a_ctrl_c(tmp_path):
    process = begin("two processes", tmp_path)
    wait_for(process, lambda: len(workers(process.pid)) >= 2)
    expect_the_end(process, terminate, 3.0)


@pytest.mark.slow
def test_processes_end_with_the_one_that_started_them(tmp_path):
    """Also if that could not tell them."""
    process = begin("two processes", tmp_path)
    wait_for(process, lambda: len(workers(process.pid)) >= 2)
    below = children(process.pid)
    process.kill()
    process.communicate()
    expect_gone(below, 15.0)  # one that has only begun imports pinfric first


def wait_for(process, there):
    until = time.monotonic() + 60.0
    while not there():
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.slow
def test_ctrl_c_that_is_ignored_stays_ignored(tmp_path):
    """As `nohup` and a shell's `&` have it."""
    process = begin(
        "inverse", tmp_path, preexec=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)
    )
    time.sleep(0.8)
    os.killpg(process.pid, signal.SIGINT)
    out, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (0, "")
    assert "\njoint1 " in out


def test_the_code_is_one():
    assert pinfric.__main__.INTERRUPTED == cli.INTERRUPTED


@pytest.fixture
def handlers():
    """The command line's, with a Ctrl-C after 0.05 s."""
    before = {
        number: signal.signal(number, pinfric.__main__._interrupt)
        for number in (signal.SIGINT, signal.SIGALRM)
    }
    threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("handlers")
def test_ctrl_c_where_the_compiler_calls_back_is_kept_until_it_returns():
    """There an exception is printed and lost, and the compiler fails without its answer."""
    left = []
    text = "until = now() + 0.2\nwhile now() < until: pass\nleft.append(True)"
    code = compile(text, os.sep + os.path.join("llvmlite", "binding.py"), "exec")

    def compile_and_wait():
        exec(code, {"now": time.monotonic, "left": left})
        time.sleep(1.0)

    with pytest.raises(KeyboardInterrupt):
        compile_and_wait()
    assert left == [True]


@pytest.mark.usefixtures("handlers")
def test_ctrl_c_that_a_library_clears_is_raised_again():
    lost = []

    def call_back_and_wait():
        try:  # as C code does that takes any error for "not supported"
            time.sleep(0.2)
        except KeyboardInterrupt:
            lost.append(True)
        time.sleep(2.0)

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        call_back_and_wait()
    assert lost == [True]
    assert time.monotonic() - start < 1.5


@pytest.mark.usefixtures("handlers")
def test_ctrl_c_is_not_raised_again_while_it_is_handled():
    done = []

    def tidy_up():
        try:
            time.sleep(0.2)
        finally:
            time.sleep(0.8)
            done.append(True)

    with pytest.raises(KeyboardInterrupt):
        tidy_up()
    assert done == [True]
