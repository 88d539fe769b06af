"""Kernels of inverse dynamics on several threads, each with a part of the samples.

Results are those of one thread to the last bit. numba's loops run in the same OpenMP as Pinocchio's
batch, whose threads do not survive a fork: a process forked after its parent used several works on
one.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numba
import numpy as np

from pinfric.dynamics.samples.motion_kernels import (
    TreeSamples,
    bound_within,
    mark_reversals,
    part_of,
)
from pinfric.kernels.compiled import parallel_kernel
from pinfric.model.arrays import whole_number
from pinfric.model.bearings import Contacts
from pinfric.model.laws import Laws
from pinfric.model.recursion import Links, write_reactions
from pinfric.model.scene import SiteTables
from pinfric.model.twin import Embedding, project

#: Below this many samples a second thread costs more than it brings (Pinocchio's barrier spins).
_FEW = 4096


class _Threads:
    """The process that owns OpenMP's threads, `owner`; None: there are none yet."""

    owner: int | None = None

    def allowed(self, wanted: int) -> int:
        """Return how many threads this process may use."""
        if wanted > 1 and self.owner is None:
            self.owner = os.getpid()
        return wanted if self.owner in (None, os.getpid()) else 1


_THREADS = _Threads()


def threads_for(samples: int, threads: int | None) -> int:
    """Choose Pinocchio's threads: one for small batches, all cores but one for large ones."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    cores = cores or 1
    if threads is None:
        return _THREADS.allowed(1 if samples < _FEW else max(1, cores - 1))
    return _THREADS.allowed(min(whole_number("threads", threads), cores))


@contextmanager
def team(threads: int) -> Iterator[int]:
    """Let numba's loops run on up to so many threads; yield their number."""
    before = numba.get_num_threads()
    threads = min(threads, int(numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    numba.set_num_threads(threads)
    try:
        yield threads
    finally:
        numba.set_num_threads(before)


@parallel_kernel
def reactions_in_parts(
    parts: int,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    joints: Embedding,
    tree: Links,
    wrench: np.ndarray,
) -> None:
    """`recursion.write_reactions`, a part of the samples on each thread."""
    n = q.shape[0]
    for thread in numba.prange(parts):
        i, j = thread * n // parts, (thread + 1) * n // parts
        write_reactions(q[i:j], v[i:j], a[i:j], joints, tree, wrench[i:j])


@parallel_kernel
def bound_in_parts(  # noqa: PLR0913 - one for each table
    parts: int,
    wrench: np.ndarray,
    x: TreeSamples,
    joints: Embedding,
    armature: np.ndarray,
    a: np.ndarray,
    joint: np.ndarray,
    axis: np.ndarray,
    contacts: Contacts,
    laws: Laws,
    velocity_index: np.ndarray,
    ratio: np.ndarray,
) -> None:
    """`twin.project`, then `motion_kernels.bound_efforts`, a part of the samples on each thread.

    Where wrench is (n, nj, 0), `effort_frictionless` is known already.
    """
    n = wrench.shape[0]
    for thread in numba.prange(parts):
        i, j = thread * n // parts, (thread + 1) * n // parts
        here = part_of(x, i, j)
        if wrench.shape[2] > 0:
            project(wrench[i:j], joints, armature, a[i:j], here.effort_frictionless)
        # numba's loops on several threads take no tuple of tuples
        sites = SiteTables(joint, axis, contacts, laws, velocity_index, ratio)
        bound_within(sites, wrench[i:j], here)


@parallel_kernel
def reversals_in_parts(
    parts: int, velocity: np.ndarray, stick_velocity: np.ndarray, marked: np.ndarray
) -> None:
    """`motion_kernels.mark_reversals`; each part sees the first sample of the next one."""
    n = velocity.shape[0]
    for thread in numba.prange(parts):
        i, j = thread * n // parts, min((thread + 1) * n // parts + 1, n)
        mark_reversals(velocity[i:j], stick_velocity, marked[i:j])
