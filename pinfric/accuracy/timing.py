"""Timing what is compared: all contestants in every round, short motions repeated."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.model.scene import Scene

#: Seconds that a timing of one scene may take.
_PATIENCE = 0.2

_Key = TypeVar("_Key", bound=Hashable)


def interleaved(contestants: Mapping[_Key, Callable[[], object]], rounds: int) -> dict[_Key, float]:
    """Return median seconds of each, all timed in every round: a busy machine slows all alike."""
    times = all_rounds(contestants, rounds)
    return {name: statistics.median(values) for name, values in times.items()}


def all_rounds(
    contestants: Mapping[_Key, Callable[[], object]], rounds: int
) -> dict[_Key, list[float]]:
    """Return the seconds that each takes, round by round."""
    times: dict[_Key, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, run in contestants.items():
            start = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - start)
    return times


@dataclass(frozen=True)
class TimedMotion:
    """A motion whose inverse dynamics is timed, on one thread, for several scenes.

    Payload columns go with the scenes that have the payloads.

    Attributes:
        states: (T, nq), (T, nv), (T, nv) q, v, a.
        t: (T,) s; None: states without order.
        attached: (T, payloads) what is carried; None: all the time.
        payloads: names of these columns.
        repeats: how often the motion stands end to start in a timing; 0: once, in one round, for
            it takes long by itself.
    """

    states: tuple[np.ndarray, np.ndarray, np.ndarray]
    t: np.ndarray | None
    attached: np.ndarray | None
    payloads: tuple[str, ...]
    repeats: int = 0

    def repeated(self, scene: Scene, wanted: int) -> TimedMotion:
        """Return the motion repeated to `wanted` samples, within a fifth of a second for each."""
        repeats = timed_repeats(lambda: self.solve(scene), len(self.states[0]), wanted, _PATIENCE)
        return replace(self, repeats=repeats)

    def solve(self, scene: Scene) -> InverseResult:
        """Return inverse dynamics of the motion, once."""
        attached = self.attached if tuple(scene.payloads) == self.payloads else None
        return inverse_dynamics(scene, *self.states, t=self.t, attached=attached, threads=1)

    def times(self, scenes: Mapping[_Key, Scene], rounds: int) -> dict[_Key, np.ndarray]:
        """Return microseconds per sample that each scene takes, round by round."""
        runs = {name: self._run(scene) for name, scene in scenes.items()}
        for run in runs.values() if self.repeats else ():
            run()
        found = all_rounds(runs, rounds if self.repeats else 1)
        each = 1e6 / (max(self.repeats, 1) * len(self.states[0]))
        return {name: each * np.array(seconds) for name, seconds in found.items()}

    def _run(self, scene: Scene) -> Callable[[], object]:
        n = max(self.repeats, 1)
        attached = self.attached if tuple(scene.payloads) == self.payloads else None
        q, v, a = (np.tile(x, (n, 1)) for x in self.states)
        t = None if self.t is None else repeated_times(self.t, n)
        phases = None if attached is None else np.tile(attached, (n, 1))
        return lambda: inverse_dynamics(scene, q, v, a, t=t, attached=phases, threads=1)


def saved(whole: np.ndarray, without: np.ndarray) -> tuple[float, float]:
    """Return what one of two contestants takes less, and what the clock resolves of it.

    The medians of the differences in each round, and of their distances from that, times
    3/sqrt(rounds): some two standard errors. Of one round a twentieth of the whole time.

    Args:
        whole, without: (rounds,) times of both.
    """
    differences = whole - without
    middle = float(np.median(differences))
    if len(differences) == 1:
        return middle, 0.05 * float(whole[0])
    spread = float(np.median(np.abs(differences - middle)))
    return middle, 3.0 * spread / math.sqrt(len(differences))


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
