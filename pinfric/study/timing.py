"""Timing what is compared: all contestants in every round, short motions repeated."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Hashable, Mapping
from typing import TypeVar

import numpy as np

_Key = TypeVar("_Key", bound=Hashable)


def interleaved(contestants: Mapping[_Key, Callable[[], object]], rounds: int) -> dict[_Key, float]:
    """Return median seconds of each, all timed in every round: a busy machine slows all alike."""
    times: dict[_Key, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, run in contestants.items():
            start = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in times.items()}


def timed_repeats(run: Callable[[], object], samples: int, wanted: int, patience: float) -> int:
    """Return how often a motion is repeated in a timing: to `wanted` samples, within `patience` s.

    0 where the motion once takes longer than `patience`: then once is enough, and one round.
    """
    run()  # kernels are read from disk, or compiled
    start = time.perf_counter()
    run()
    seconds = time.perf_counter() - start
    return min(-(-wanted // samples), int(patience / seconds))


def repeated_times(t: np.ndarray, repeats: int) -> np.ndarray:
    """Return the times (s) of a motion repeated end to start, the mean step between two runs."""
    period = (t[-1] - t[0]) * len(t) / (len(t) - 1) if len(t) > 1 else 1.0
    return np.asarray(np.tile(t, repeats) + np.repeat(np.arange(repeats) * period, len(t)))
