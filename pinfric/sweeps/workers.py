"""Batches of a sweep on joblib's active backend: processes, threads or a cluster."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import TimeoutError as NotInTime
from multiprocessing import resource_tracker
from threading import Thread
from time import sleep

import numpy as np

from pinfric import __version__
from pinfric.drives.limits import LIMITS, OWN_LIMITS
from pinfric.errors import SweepError
from pinfric.sweeps.cycle import Samples, Study, compute

#: How often a process looks whether the one that started it is still there (s).
_LOOK = 0.5
#: Of a batch, which takes 1 s: then its worker is lost, and joblib does not say it (s).
_PATIENCE = 300
#: An address where nobody answers is said after so long (s).
_CONNECT_TIMEOUT = 4
#: What Dask raises for an address that is none, that nobody answers, or that is no scheduler's.
_NO_SCHEDULER = (OSError, ValueError, ImportError, TypeError, MemoryError)


def compute_in_parallel(
    study: Study,
    batches: Iterable[np.ndarray],
    values: np.ndarray,
    processes: int | None,
    jobs: int,
) -> Iterator[tuple[np.ndarray, Samples]]:
    """Yield the batches and their figures as they complete, in any order.

    Args:
        batches: (k,) rows of `values` each.
        values: (n, number of targets).
        processes: of this machine; None takes the active backend.
        jobs: how many the backend should run at once; a cluster has its own number.

    Raises:
        SweepError: a process was killed, or none finishes a batch.
    """
    import cloudpickle
    from joblib import Parallel, delayed

    # cloudpickle also takes classes and functions of a script; rows of `add_limit` go along
    packed = __version__, cloudpickle.dumps((study, LIMITS[OWN_LIMITS:]))
    task = delayed(_compute_packed)
    backend = None if processes is None else "loky"
    run = Parallel(
        jobs,
        backend,
        return_as="generator_unordered",
        batch_size=1,
        timeout=_PATIENCE,
        initializer=_end_with,  # of processes
        initargs=(os.getpid(),),
    )
    try:
        with _signals_kept():
            # in a tuple: arrays by themselves are put on one worker of Dask, and lost with it
            blocks = run(task(packed, (rows, values[rows])) for rows in batches)
        yield from blocks
    except BrokenProcessPool:
        raise SweepError(
            f"one of {jobs} processes was killed (too little memory for {jobs} cycles at once?); "
            "take fewer `processes`"
        ) from None
    except NotInTime:
        raise SweepError(f"no worker finished a batch in {_PATIENCE} s") from None


def _end_with(parent: int) -> None:
    """End this process as soon as its parent has ended in any way."""

    def watch() -> None:
        while os.getppid() == parent:
            sleep(_LOOK)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Within, Ctrl-C and TERM wait; processes started within never receive them."""
    from joblib.externals.loky.backend import resource_tracker as of_loky

    # joblib's own process outlives a `kill -9` of this one, tidies up, and should say nothing
    sys.warnoptions.append(f"ignore::UserWarning:{of_loky.__name__}")
    for tracker in resource_tracker, of_loky:  # where they start, they let signals through again
        tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _compute_packed(
    packed: tuple[str, bytes], batch: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, Samples]:
    version, study = packed  # which packed it
    if version != __version__:
        raise SweepError(f"a worker has pinfric {__version__}, this machine {version}")
    rows, values = batch
    return rows, compute(_unpacked(study), values)


@lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> Study:
    study: Study
    study, LIMITS[OWN_LIMITS:] = pickle.loads(packed)
    return study


@contextmanager
def on_cluster(address: str) -> Iterator[None]:
    """Within, joblib's active backend is a running Dask cluster.

    Raises:
        SweepError: the extra `cluster` is missing, or the cluster fails.
    """
    from joblib import parallel_config

    try:
        from distributed import Client
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise SweepError('--cluster: needs Dask: pip install "pinfric[cluster]"') from None
    # an error says it, in one line; Dask gives these levels of their own
    for name in ("distributed", "distributed.client", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT)
    except _NO_SCHEDULER as problem:
        raise SweepError(f"no Dask scheduler answers at {address}: {_brief(problem)}") from None
    try:
        with client, parallel_config("dask", client=client):
            yield
    except (OSError, CancelledError, KilledWorker) as problem:
        raise SweepError(f"the cluster at {address} failed: {_brief(problem)}") from None


def _brief(problem: BaseException) -> str:
    return " ".join(f"{type(problem).__name__}: {problem}".split())[:200]
