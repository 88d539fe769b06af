"""Duty: cycles with their shares or counts, as a period that repeats without end.

A period runs each cycle as often as asked, one kind after the other, then stands switched off. A
mean over it is one over the cycles, time stretched by their repetitions; what depends on the order
(windows, standstills, temperatures) is played.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pinfric.errors import SizingError
from pinfric.model.scene import Scene
from pinfric.motions.trajectory import Trajectory

#: s; between the last sample of one cycle and the first of the next, which are one instant.
_JOIN = 1e-9
#: How far shares may miss a sum of 1.
_SUM = 1e-6
#: (n,) shares of the time switched off that are samples, close at first: the housing warms on
#: while the winding cools, and is hottest some time after the current has gone.
_OFF = np.linspace(0.0, 1.0, 33) ** 3
#: Duration of an S3 duty period where nothing else is agreed, s (IEC 60034-1: 10 minutes).
PERIOD = 600.0


@dataclass(frozen=True)
class Schedule:
    """Which samples of a motion are which cycle of a period, and how often it is run.

    Attributes:
        starts: (K + 1,) first sample of each part, and the end.
        repeats: (K,) how often it is run in a period; 0: only its peaks count.
        names: (K,) of the cycles. off: the last part stands switched off.
    """

    starts: tuple[int, ...]
    repeats: tuple[float, ...]
    names: tuple[str, ...] = ("",)
    off: bool = False

    def parts(self) -> Iterator[tuple[str, slice]]:
        """Yield the name and samples of each cycle that is run."""
        for k in range(len(self.repeats) - self.off):
            if self.repeats[k]:
                yield self.names[k], slice(self.starts[k], self.starts[k + 1])

    def powered(self, samples: int) -> np.ndarray:
        """Return (T,) which samples are not switched off."""
        return np.arange(samples) < (self.starts[-2] if self.off else samples)

    def only(self, parts: Collection[int]) -> Schedule:
        """Return the schedule that runs these parts once and no other."""
        runs = tuple(float(k in parts) for k in range(len(self.repeats)))
        return replace(self, repeats=runs)

    def samples(self, parts: Collection[int]) -> tuple[np.ndarray, Schedule]:
        """Return (T,) which samples are of some parts, and the schedule of these alone."""
        some = sorted(parts)
        keep = np.zeros(self.starts[-1], dtype=bool)
        for k in some:
            keep[self.starts[k] : self.starts[k + 1]] = True
        sizes = [self.starts[k + 1] - self.starts[k] for k in some]
        last = len(self.repeats) - 1
        return keep, Schedule(
            starts=tuple(np.cumsum([0, *sizes]).tolist()),
            repeats=tuple(self.repeats[k] for k in some),
            names=tuple(self.names[k] for k in some if k < len(self.names)),
            off=self.off and last in some,
        )

    @cached_property
    def counts(self) -> np.ndarray:
        """(K,) how often each part is played: whole numbers."""
        counts = np.maximum(np.rint(self.repeats), 1) * (np.array(self.repeats) > 0)
        return counts.astype(np.int64)

    def stretched(self, t: np.ndarray) -> np.ndarray:
        """Return (T,) time in a period, s, of `t` with each cycle once."""
        if set(self.repeats) == {1.0}:
            return t
        steps = np.diff(t)
        for k, repeats in enumerate(self.repeats):
            steps[self.starts[k] : self.starts[k + 1] - 1] *= repeats
        return np.concatenate([t[:1], t[0] + np.cumsum(steps)])

    def played(self, t: np.ndarray, window: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples (indices) in the order of the period, and their times (s).

        Of equal repetitions no more are played than fill a window (s), and one more.
        """
        order, times, end = [], [], 0.0
        for k, count in enumerate(self.counts.tolist()):
            samples = np.arange(self.starts[k], self.starts[k + 1])
            own = t[samples] - t[samples[0]]
            for _ in range(min(count, 1 + int(np.ceil(min(window / own[-1], 1e9))))):
                order.append(samples)
                times.append(end + own)
                end = times[-1][-1] + _JOIN
        return np.concatenate(order), np.concatenate(times)


def once(samples: int) -> Schedule:
    """Return the schedule of a motion that is one cycle."""
    return Schedule((0, samples), (1.0,))


@dataclass(frozen=True)
class Duty:
    """A duty: cycles with their shares of the time, or their counts.

    Whole numbers are counts: the period runs each cycle so often. Other numbers are shares of the
    time switched on, which add up to 1: the period is `period` long. While the robot is off, motors
    have no current and nothing moves.

    Args:
        cycles: pairs of a trajectory and its share or count.
        on: part of the period switched on, above 0 to 1.
        period: s, of shares; 10 minutes by default (IEC 60034-1, S3).
        beside: motions that a period does not run, of which only peaks count.
        elsewhere: the same robot mounted otherwise: a scene with another gravity, and the duty that
            it has there. The hardest of them counts, joint by joint.

    Raises:
        SizingError: shares that do not add up, a share or count that is not above 0, cycles of
            other robots, a cycle longer than its share, a part or period that cannot be.
    """

    cycles: tuple[tuple[Trajectory, float], ...]
    on: float = 1.0
    period: float = PERIOD
    beside: tuple[Trajectory, ...] = ()
    elsewhere: tuple[tuple[Scene, Duty], ...] = ()
    repeats: tuple[float, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cycles", tuple(self.cycles))
        if not self.cycles:
            raise SizingError("duty: no cycles; give trajectories with their shares or counts")
        if not 0 < self.on <= 1:
            raise SizingError(
                f"duty: switched on for {self.on:g} of the period; give a share above "
                "0, at most 1 (0.4: S3 40 %)"
            )
        if not 0 < self.period < np.inf:
            raise SizingError(f"duty: a period of {self.period:g} s; give seconds above 0")
        first = self.cycles[0][0]
        for cycle, weight in self.cycles:
            if not 0 < weight < np.inf:
                raise SizingError(
                    f"duty: {cycle.source}: share or count {weight:g}; give a share "
                    "of the time above 0, or how often it is run"
                )
            if cycle.joint_names != first.joint_names:
                raise SizingError(
                    f"duty: {cycle.source} moves {list(cycle.joint_names)}, {first.source} "
                    f"{list(first.joint_names)}; all cycles must be of one robot"
                )
            if len(cycle.t) < 2:
                raise SizingError(f"duty: {cycle.source}: one sample; a cycle needs two or more")
        object.__setattr__(self, "repeats", self._repeats())

    def _repeats(self) -> tuple[float, ...]:
        """How often a period runs each cycle."""
        weights = [float(weight) for _, weight in self.cycles]
        shares = abs(sum(weights) - 1) <= _SUM
        if all(weight.is_integer() for weight in weights) and not (shares and self.on < 1):
            if self.period != PERIOD:
                raise SizingError(
                    f"duty: counts set the period, but a period of {self.period:g} s is given too: "
                    "give shares of the time, or no period"
                )
            return tuple(weights)
        if not shares:
            raise SizingError(
                f"duty: the shares {', '.join(f'{w:g}' for w in weights)} add up to "
                f"{sum(weights):g}; shares of the time add up to 1, counts are whole numbers"
            )
        times = [weight * self.on * self.period for weight in weights]
        for (cycle, weight), time in zip(self.cycles, times, strict=True):
            if time < cycle.duration * (1 - _SUM):
                raise SizingError(
                    f"duty: {cycle.source} takes {cycle.duration:.4g} s, longer than its share "
                    f"{weight:g}, {time:.4g} s of a period of {self.period:g} s; give a longer "
                    "period, or counts"
                )
        return tuple(
            time / cycle.duration for (cycle, _), time in zip(self.cycles, times, strict=True)
        )

    @property
    def off(self) -> float:
        """Time switched off in a period, s."""
        run = sum(
            n * cycle.duration for n, (cycle, _) in zip(self.repeats, self.cycles, strict=True)
        )
        return run * (1 - self.on) / self.on

    @property
    def source(self) -> str:
        """The cycles and their repetitions, in words."""
        parts = [
            f"{Path(cycle.source).name} x {n:.4g}"
            for n, (cycle, _) in zip(self.repeats, self.cycles, strict=True)
        ]
        return ", ".join(parts + [f"{self.off:.4g} s off"] * (self.on < 1))

    def schedule(self) -> Schedule:
        """Return which samples of `motion` are which cycle, and how often each is run."""
        runs = [*(cycle for cycle, _ in self.cycles), *self.beside]
        sizes = [len(cycle.t) for cycle in runs] + [len(_OFF)] * (self.on < 1)
        return Schedule(
            starts=tuple(np.cumsum([0, *sizes]).tolist()),
            repeats=self.repeats + (0.0,) * len(self.beside) + (1.0,) * (self.on < 1),
            names=tuple(Path(cycle.source).name for cycle in runs),
            off=self.on < 1,
        )

    def motion(self) -> Trajectory:
        """Return every cycle once, one after the other, then the robot switched off."""
        runs = [*(cycle for cycle, _ in self.cycles), *self.beside]
        if len(runs) == 1 and self.on == 1:
            return runs[0]
        if self.on < 1:
            last, stay = self.cycles[-1][0], np.full(len(_OFF), -1)
            zero = np.zeros((len(_OFF), last.v.shape[1]))
            runs.append(
                replace(
                    last,
                    t=self.off * _OFF,
                    q=last.q[stay],
                    v=zero,
                    a=zero,
                    attached=last.attached[stay],
                    reading=None,
                )
            )
        ends = np.cumsum([0.0, *(cycle.duration + _JOIN for cycle in runs)])
        return replace(
            runs[0],
            t=np.concatenate(
                [start + cycle.t - cycle.t[0] for start, cycle in zip(ends, runs, strict=False)]
            ),
            q=np.concatenate([cycle.q for cycle in runs]),
            v=np.concatenate([cycle.v for cycle in runs]),
            a=np.concatenate([cycle.a for cycle in runs]),
            attached=np.concatenate([cycle.attached for cycle in runs]),
            source=self.source,
            reading=None,
            warnings=tuple(text for cycle in runs for text in cycle.warnings),
        )
