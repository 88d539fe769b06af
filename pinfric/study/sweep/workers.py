"""Compute batches on processes: of this machine, or of a Dask cluster, by the same code.

Workers of this machine are started as `python -m distributed.cli.dask_worker`, as on a cluster: no
fork (Pinocchio's threads would hang in the child), and no import of the caller's script (which
would need a `__main__` guard). Each has a nanny that starts it anew when it is lost; the scheduler
then gives its unfinished batches to others. Finished ones have reached the caller already.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from time import monotonic
from typing import Any
from uuid import uuid4

import numpy as np

from pinfric.errors import PinfricError, SweepError
from pinfric.study.sweep.cycle import Block, Study, compute

#: Connecting takes milliseconds; an address that does not answer is said within 10 s.
_CONNECT_TIMEOUT = 4
#: What Dask raises for an address that is none, that nobody answers, or that is no scheduler's.
_NOT_REACHED = (OSError, ValueError, ImportError, TypeError, MemoryError)
#: Starting workers of this machine: imports on a slow disk.
_START_TIMEOUT = 120
#: Without any worker for this long, a cluster is taken to be gone.
_NO_WORKERS = 60
_POLL = 1.0
#: Batches handed out per worker thread: one that it computes, others that wait beside it.
_AHEAD = 3
#: Where processes of this machine listen: who reaches a Dask worker runs code as its user.
_HERE = "127.0.0.1"
#: Where tracebacks of messages that were under way are logged when a sweep is stopped.
_LOGS_OF_MESSAGES = ("asyncio", "tornado.application")
#: Where connections are logged that close while workers are ended: after the cluster's own silence.
_LOG_OF_CONNECTIONS = "distributed.batched"


def installed() -> bool:
    """Say whether the extra `cluster` is there."""
    from importlib.util import find_spec

    return find_spec("distributed") is not None


def _require_extra() -> None:
    if not installed():
        raise SweepError("several processes and clusters need the extra `cluster`: "
                         'pip install "pinfric[cluster]"; or take one process')  # fmt: skip


def check_scheduler(address: str) -> None:
    """Try whether a scheduler answers, before any work.

    `Client` does not do: it waits for ever where a server takes the connection and says nothing.

    Raises:
        SweepError: it does not answer in time, or the extra `cluster` is missing.
    """
    _require_extra()
    from distributed.comm import connect

    async def shake_hands() -> None:
        comm = await asyncio.wait_for(connect(address, timeout=_CONNECT_TIMEOUT), _CONNECT_TIMEOUT)
        comm.abort()

    with ThreadPoolExecutor(1) as thread:  # this one may run a loop already: a notebook's
        try:
            thread.submit(asyncio.run, shake_hands()).result()
        except _NOT_REACHED as problem:
            raise _not_reached(address, problem) from None


def compute_here(
    study: Study, batches: Iterator[np.ndarray], values: np.ndarray
) -> Iterator[Block]:
    """Yield the batches' figures, computed in this process.

    Args:
        study: what the samples share.
        batches: (k,) rows of `values` each.
        values: (n, number of targets).
    """
    for rows in batches:
        yield compute(study, rows, values[rows])


def compute_on_cluster(
    study: Study,
    batches: Iterator[np.ndarray],
    values: np.ndarray,
    *,
    processes: int = 1,
    scheduler: str | None = None,
) -> Iterator[Block]:
    """Yield the batches' figures as they complete, in any order, computed by Dask workers.

    Args:
        study, batches, values: as `compute_here`.
        processes: workers to start on this machine, where no scheduler is named.
        scheduler: address of a running one, for instance tcp://host:8786.

    Raises:
        SweepError: the extra `cluster` is missing, the scheduler cannot be reached, all workers
            are lost, or a batch kills its workers again and again.
    """
    _require_extra()
    with ExitStack() as stack:
        address = scheduler or stack.enter_context(_local_scheduler(processes))
        client = stack.enter_context(_connected(address))
        name = stack.enter_context(_shared(client, study))
        yield from _gather(client, name, batches, values)


@contextmanager
def _shared(client: Any, study: Study) -> Iterator[str]:
    """Give every worker the study, now or when it joins; yields its name there."""
    from pinfric.study.sweep.remote import StudyOnWorker

    name = f"pinfric-{uuid4().hex}"
    try:
        client.register_plugin(StudyOnWorker(name, study), name=name)
    except Exception as problem:  # whatever a worker raises, for instance without pinfric there
        raise _worker_failed(problem) from problem
    try:
        yield name
    finally:
        with suppress(Exception):  # the scheduler may be gone, or stand still
            forget = client.scheduler.unregister_worker_plugin
            client.sync(forget, name=name, callback_timeout=_CONNECT_TIMEOUT)


def _gather(
    client: Any, name: str, batches: Iterator[np.ndarray], values: np.ndarray
) -> Iterator[Block]:
    from pinfric.study.sweep.remote import compute_batch

    waiting: set[Any] = set()
    seen = monotonic()
    while True:
        threads = _threads(client)
        seen = monotonic() if threads else seen
        while len(waiting) < _AHEAD * max(threads, 1):
            rows = next(batches, None)
            if rows is None:
                break
            waiting.add(client.submit(compute_batch, name, rows, values[rows], pure=False))
        if not waiting:
            return
        for future in _finished(client, waiting):
            waiting.remove(future)
            yield _result(future)
            seen = monotonic()
        if monotonic() - seen > _NO_WORKERS:
            raise SweepError(f"no worker for {_NO_WORKERS} s; what is finished is kept where a "
                             "folder was named: run again to go on")  # fmt: skip


def _finished(client: Any, waiting: set[Any]) -> list[Any]:
    from concurrent.futures import CancelledError

    from distributed import TimeoutError as DaskTimeoutError
    from distributed import wait

    try:
        with client.as_current():
            wait(list(waiting), timeout=_POLL, return_when="FIRST_COMPLETED")
    except (DaskTimeoutError, TimeoutError):
        return []
    except CancelledError:
        pass  # told by `_result`
    return [future for future in waiting if future.done()]


def _result(future: Any) -> Block:
    from concurrent.futures import CancelledError

    from distributed import KilledWorker

    try:
        block: Block = future.result()
        return block
    except PinfricError:
        raise
    except KilledWorker as problem:
        raise SweepError(
            "a batch of samples has killed every worker that took it (too little memory for one "
            f"cycle?): {' '.join(str(problem).split())[:200]}"
        ) from None
    except CancelledError:
        raise SweepError("the connection to the scheduler is lost; what is finished is kept where "
                         "a folder was named: run again to go on") from None  # fmt: skip
    except Exception as problem:  # whatever a worker raises
        raise _worker_failed(problem) from problem


def _worker_failed(problem: Exception) -> SweepError:
    text = " ".join(f"{type(problem).__name__}: {problem}".split())[:300]
    return SweepError(f"a worker failed: {text}")


def _threads(client: Any) -> int:
    """How many batches the cluster computes at once; 0 where the scheduler does not answer."""
    try:
        workers = client.sync(client.scheduler.ncores, callback_timeout=_CONNECT_TIMEOUT)
    except (TimeoutError, OSError):
        return 0
    return sum(workers.values())


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    from distributed import Client

    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except _NOT_REACHED as problem:
        raise _not_reached(address, problem) from None
    log = logging.getLogger("distributed.client")
    before = log.level
    log.setLevel(logging.CRITICAL)  # what goes wrong is said by an error, not by tracebacks
    try:
        yield client
    finally:
        client.close()
        log.setLevel(before)


def _not_reached(address: str, problem: BaseException) -> SweepError:
    reason = " ".join(str(problem).split())[:200] or f"no answer in {_CONNECT_TIMEOUT} s"
    if isinstance(problem, MemoryError):  # its first bytes are read as the length of a message
        reason = "what answers there is no Dask scheduler"
    return SweepError(f"the scheduler at {address} cannot be reached: {reason}")


@contextmanager
def _local_scheduler(processes: int) -> Iterator[str]:
    """Start a scheduler here and its workers beside it; yields its address."""
    from distributed import LocalCluster

    logging.getLogger(_LOG_OF_CONNECTIONS).setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        folder = stack.enter_context(
            tempfile.TemporaryDirectory(prefix="pinfric-", ignore_cleanup_errors=True)
        )
        cluster = stack.enter_context(LocalCluster(
            n_workers=0, host=_HERE, protocol="tcp://", silence_logs=50,
            dashboard_address=f"{_HERE}:0",  # None takes port 8787, and warns where it is taken
            scheduler_kwargs={"dashboard": False, "host": _HERE},
        ))  # fmt: skip
        log = stack.enter_context((Path(folder) / "workers.log").open("w+b"))
        workers = _start_workers(cluster.scheduler_address, processes, folder, log)
        stack.callback(_end, workers)
        try:
            _await_workers(cluster, workers, processes, log)
            yield cluster.scheduler_address
        except BaseException:  # the error says what went wrong
            for name in _LOGS_OF_MESSAGES:
                logging.getLogger(name).setLevel(logging.CRITICAL)
            raise


def _start_workers(address: str, processes: int, folder: str, log: Any) -> subprocess.Popen[bytes]:
    command: Sequence[str] = (
        sys.executable, "-m", "distributed.cli.dask_worker", address,
        "--nworkers", str(processes), "--nthreads", "1", "--host", _HERE,
        "--no-dashboard", "--dashboard-address", f"{_HERE}:0",  # its page of health stays
        "--local-directory", folder, "--death-timeout", "20",
    )  # fmt: skip
    root = str(Path(__file__).parents[3])  # where pinfric is imported from, installed or not
    paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    # a session of its own: Ctrl-C reaches this process only, which then ends its workers
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                            env=environment, start_new_session=True)  # fmt: skip


def _await_workers(cluster: Any, workers: subprocess.Popen[bytes], count: int, log: Any) -> None:
    from time import sleep

    until = monotonic() + _START_TIMEOUT
    while len(cluster.scheduler_info["workers"]) < count:
        if workers.poll() is not None or monotonic() > until:
            log.seek(0)
            said = log.read().decode(errors="replace").strip().splitlines()
            raise SweepError(f"the {count} processes did not start: {said[-1] if said else ''}")
        sleep(0.05)


def _end(workers: subprocess.Popen[bytes]) -> None:
    """End nannies and workers at once: what they still compute is not wanted any more."""
    with suppress(ProcessLookupError):
        os.killpg(workers.pid, signal.SIGKILL)  # the session is theirs alone
    workers.wait(timeout=10)
