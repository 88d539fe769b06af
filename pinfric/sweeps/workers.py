"""Compute batches on processes of this machine, or on the workers of a Dask cluster.

joblib hands the batches out to processes that loky starts (no port is opened, a script needs no
`__main__` guard); a Dask scheduler that runs already hands them out itself. A worker that joins
late or takes the place of a lost one computes the same.
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import pickle
import signal
import warnings
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from threading import Thread
from time import perf_counter, sleep
from typing import Any

import numpy as np
import pandas as pd

from pinfric import __version__
from pinfric.drives.limits import LIMITS, OWN_LIMITS
from pinfric.errors import PinfricError, PinfricWarning, SweepError
from pinfric.sweeps.cycle import Study, compute

#: Connecting takes milliseconds; an address that does not answer is said within 10 s.
_CONNECT_TIMEOUT = 4
#: What Dask raises for an address that is none, that nobody answers, or that is no scheduler's.
_NOT_REACHED = (OSError, ValueError, ImportError, TypeError, MemoryError)
#: Without any finished batch for this long (s), workers are taken to be gone: a batch takes 1 s.
_PATIENCE = 300
#: How often one looks whether processes are still there (s).
_LOOK = 0.5
#: Processes of this machine are started again so often after one of them was killed.
_STARTS = 4
#: glibc's mallopt: M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, and how much is kept or reused (bytes; the
#: most that M_MMAP_THRESHOLD takes is 32 MiB).
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _KEPT = -1, -3, 32 * 2**20

#: The version that packed a study, and the study.
Packed = tuple[str, bytes]


def compute_on_processes(
    study: Study, batches: Iterable[np.ndarray], values: np.ndarray, processes: int
) -> Iterator[pd.DataFrame]:
    """Yield the batches' figures as they complete, in any order, from processes of this machine.

    A process that is killed takes the others' unfinished batches with it: they start again.

    Args:
        study: what the samples share.
        batches: (k,) rows of `values` each.
        values: (n, number of targets).
        processes: how many.

    Raises:
        SweepError: processes were killed again and again, or a batch failed.
    """
    unfinished = {int(rows[0]): rows for rows in batches}
    packed = _packed(study)
    for _ in range(_STARTS):
        try:
            for block in _finished(packed, list(unfinished.values()), values, processes):
                del unfinished[int(block["sample"].iloc[0])]
                yield block
            return
        except BrokenProcessPool:
            continue
    raise SweepError(
        f"processes were killed {_STARTS} times (too little memory for {processes} cycles at "
        "once?); take fewer `processes`"
    )


def compute_on_cluster(
    study: Study, batches: Iterable[np.ndarray], values: np.ndarray, scheduler: str
) -> Iterator[pd.DataFrame]:
    """Yield the batches' figures as they complete, in any order, from the workers of a cluster.

    Args:
        study, batches, values: as `compute_on_processes`.
        scheduler: address of a running Dask scheduler, for instance tcp://host:8786.

    Raises:
        SweepError: the extra `cluster` is missing, the scheduler cannot be reached or is lost, no
            worker finishes anything, or a batch fails.
    """
    from distributed import wait
    from distributed.comm import CommClosedError

    with _connected(scheduler) as client, _failures_said():
        # the result of a task, not scattered: the scheduler makes it again where it is lost
        shared = client.submit(tuple, _packed(study), pure=False)
        pending = {
            client.submit(_compute_on_worker, shared, rows, values[rows], pure=False)
            for rows in batches
        }
        seen, finished = set[str](), perf_counter()
        while pending:
            try:
                with client.as_current():
                    done, pending = wait(pending, _LOOK, "FIRST_COMPLETED")
            except TimeoutError:
                done = set()
                if perf_counter() - finished > _PATIENCE:
                    raise
            seen = _told_of_losses(client, seen)
            for batch in done:
                finished = perf_counter()
                try:
                    block = batch.result()
                except CommClosedError as problem:
                    raise CancelledError from problem
                yield block


def _told_of_losses(client: Any, before: set[str]) -> set[str]:
    """Return the addresses of the workers; warn of those that are no longer there."""
    try:
        now = set(client.nthreads())
    except OSError:  # the scheduler is lost, which its batches say
        return before
    for lost in sorted(before - now):
        text = f"worker {lost} was lost; others compute its batches again"
        warnings.warn(text, PinfricWarning, stacklevel=5)
    return now


def _finished(
    packed: Packed, batches: Iterable[np.ndarray], values: np.ndarray, processes: int
) -> Iterator[pd.DataFrame]:
    from joblib import Parallel, delayed

    one = delayed(_compute_on_worker)
    tasks = (one(packed, rows, values[rows]) for rows in batches)
    run = Parallel(
        processes,
        return_as="generator_unordered",
        batch_size=1,
        timeout=_PATIENCE,
        verbose=0,
        initializer=_end_with,
        initargs=(os.getpid(),),
    )
    with _failures_said():
        with _interrupts_ignored():  # by processes that start now: Ctrl-C is this one's
            blocks = run(tasks)
        yield from blocks


def _end_with(parent: int) -> None:
    """End this process as soon as the one that started it has ended, however that was."""

    def watch() -> None:
        while os.getppid() == parent:
            sleep(_LOOK)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def _failures_said() -> Iterator[None]:
    """Say what a worker or the way to it raises as a `SweepError`."""
    try:
        yield
    except (PinfricError, BrokenProcessPool):
        raise
    except TimeoutError:
        raise SweepError(f"no worker finished a batch in {_PATIENCE} s") from None
    except CancelledError:
        raise SweepError("the connection to the scheduler is lost") from None
    except Exception as problem:  # whatever a worker raises
        text = " ".join(f"{type(problem).__name__}: {problem}".split())[:300]
        raise SweepError(f"a worker failed: {text}") from problem


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not the main thread: it gets no signals
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _packed(study: Study) -> Packed:
    """The study, with classes and functions of a notebook or script, and rows of `add_limit`."""
    import cloudpickle

    return __version__, cloudpickle.dumps((study, LIMITS[OWN_LIMITS:]))


def _compute_on_worker(packed: Packed, rows: np.ndarray, values: np.ndarray) -> pd.DataFrame:
    """Return the figures of some samples (`cycle.compute`)."""
    version, study = packed
    if version != __version__:
        raise SweepError(f"a worker has pinfric {__version__}, this machine {version}")
    _keep_memory()
    return compute(_unpacked(study), rows, values)


@lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> Study:
    study: Study
    study, LIMITS[OWN_LIMITS:] = pickle.loads(packed)
    return study


@cache
def _keep_memory() -> None:
    """Have malloc keep what is freed.

    Dask's nannies make it give every freed page back (MALLOC_TRIM_THRESHOLD_=65536), and every
    cycle then faults its arrays in again: twice the time.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # another C library has another malloc
        return
    for parameter in _TRIM_THRESHOLD, _MMAP_THRESHOLD:
        mallopt(parameter, _KEPT)


# ---------------------------------------------------------------- clusters


def check_scheduler(address: str) -> None:
    """Check that a scheduler answers, before any work.

    `Client` does not do: it waits for ever where a server takes the connection and says nothing.

    Raises:
        SweepError: it does not answer in time, or the extra `cluster` is missing.
    """
    try:
        from distributed.comm import connect
    except ImportError:
        raise SweepError(
            'clusters need the extra `cluster`: pip install "pinfric[cluster]"; or take `processes`'
        ) from None

    async def shake_hands() -> None:
        comm = await asyncio.wait_for(connect(address, timeout=_CONNECT_TIMEOUT), _CONNECT_TIMEOUT)
        comm.abort()

    with ThreadPoolExecutor(1) as thread:  # this one may run a loop already: a notebook's
        try:
            thread.submit(asyncio.run, shake_hands()).result()
        except _NOT_REACHED as problem:
            raise _not_reached(address, problem) from None


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    import logging

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
        with suppress(Exception):  # the scheduler may be gone
            client.close(timeout=_CONNECT_TIMEOUT)
        log.setLevel(before)


def _not_reached(address: str, problem: BaseException) -> SweepError:
    reason = " ".join(str(problem).split())[:200] or f"no answer in {_CONNECT_TIMEOUT} s"
    if isinstance(problem, MemoryError):  # its first bytes are read as the length of a message
        reason = "the program at this address is not a Dask scheduler"
    return SweepError(f"the scheduler at {address} cannot be reached: {reason}")
