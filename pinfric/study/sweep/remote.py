"""What runs on a Dask worker: it gets the study once, then computes one batch after another.

A plugin carries the study, not a task that batches depend on: a worker that joins later, or in
place of a lost one, gets it from the scheduler, and none ever asks another worker (one that has
just been lost is asked for 30 s).
"""

from __future__ import annotations

import ctypes
import pickle
from functools import cache
from typing import cast

import numpy as np
from distributed import Worker, WorkerPlugin, get_worker

from pinfric import __version__
from pinfric.errors import SweepError
from pinfric.study.sweep.cycle import Block, Study, compute

#: glibc's mallopt: M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, and how much is kept or reused (bytes; the
#: most that M_MMAP_THRESHOLD takes is 32 MiB).
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _KEPT = -1, -3, 32 * 2**20


class StudyOnWorker(WorkerPlugin):
    """Unpacks a study when a worker gets it.

    Args:
        name: of this sweep on the cluster.
        study: what its samples share.
    """

    def __init__(self, name: str, study: Study) -> None:
        self.name, self.version = name, __version__
        self._packed = pickle.dumps(study)
        self._study: Study | None = None

    def setup(self, worker: Worker) -> None:
        """Unpack it, and let the worker keep the memory of a cycle for the next."""
        if self.version != __version__:
            raise SweepError(f"it has pinfric {__version__}, this machine {self.version}")
        self._study = pickle.loads(self._packed)
        _keep_memory()

    def compute(self, rows: np.ndarray, values: np.ndarray) -> Block:
        """Return the figures of some samples (`cycle.compute`)."""
        assert self._study is not None  # Dask calls `setup` before any task
        return compute(self._study, rows, values)


def compute_batch(name: str, rows: np.ndarray, values: np.ndarray) -> Block:
    """Return the figures of some samples of the sweep of that name."""
    plugin = cast(StudyOnWorker, get_worker().plugins[name])
    return plugin.compute(rows, values)


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
