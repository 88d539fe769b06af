"""Samples of a sweep: inverse dynamics of one cycle, reduced to a few figures per drive.

Workers run this. A sample depends on its own values only: neither the number of processes nor a
lost worker changes a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pinfric.drives.demand import travel
from pinfric.drives.inertia import load_inertias
from pinfric.drives.limit import signals
from pinfric.drives.robot import holds
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.elastic.motion import elasticity
from pinfric.errors import PinfricError
from pinfric.model.scene import Scene
from pinfric.motions.summary import column_rms
from pinfric.motions.trajectory import Trajectory
from pinfric.sweeps.motors import NOT_CHECKED, Trial
from pinfric.sweeps.parameters import ELASTIC, Target, apply
from pinfric.sweeps.superposition import Summed, Superposition

#: What a cycle takes of each drive.
DEMANDS = ("peak", "rms", "motor_peak", "motor_rms", "speed")
#: The figures of each drive. `margin` is the least of the criteria of a catalogue's drive on trial,
#: 1 if none is on trial.
FIGURES = (*DEMANDS, "margin")
#: What elastic gears do in a cycle, the worst of its rests: Hz, m, m, m; NaN where not known.
ELASTIC_FIGURES = ("lowest_frequency", "tool_sag", "tool_interval", "tool_reversal")


@dataclass(frozen=True)
class Study:
    """What all samples share; it is pickled for the workers.

    Attributes:
        scene, trajectory: without a sample's values.
        targets: what the values change.
        trials: the drives on trial.
    """

    scene: Scene
    trajectory: Trajectory
    targets: tuple[Target, ...]
    trials: tuple[Trial, ...] = ()
    _inertias: list[np.ndarray] = field(default_factory=list, repr=False, compare=False)

    @cached_property
    def superposition(self) -> Superposition | None:
        """The stored cycles of which samples are sums; None where they are not."""
        try:
            return Superposition.of(self.scene, self.trajectory, self.targets, self.trials)
        except PinfricError:  # each sample says what is wrong
            return None

    @property
    def criteria(self) -> tuple[tuple[str, str], ...]:
        """The columns of verdicts: (drive on trial, criterion)."""
        return tuple((trial.drive, name) for trial in self.trials for name in trial.checks)

    @property
    def elastic(self) -> tuple[str, ...]:
        """`ELASTIC_FIGURES` if stiffness or hysteresis varies, else none."""
        return ELASTIC_FIGURES if any(target.key in ELASTIC for target in self.targets) else ()

    def load_inertias(self, result: InverseResult) -> np.ndarray:
        """Return (na,) the largest inertia about each joint over a cycle, kg m^2 (kg)."""
        if any(target.section == "payload" for target in self.targets):
            return load_inertias(result)
        if not self._inertias:  # nothing else changes it: the path's configurations stay
            self._inertias.append(load_inertias(result))
        return self._inertias[0]

    def __getstate__(self) -> dict[str, Any]:
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}


class Samples(NamedTuple):
    """Figures of k samples.

    Attributes:
        figures: (k, na, number of `FIGURES`); NaN where there is no solution.
        verdicts: (k, number of `Study.criteria`) FAILS, MET or NOT_CHECKED.
        unsolved: (k,) number of instants without a solution.
        elastic: (k, number of `Study.elastic`).
        problems: (k,) why a sample could not be computed; empty if it could.
    """

    figures: np.ndarray
    verdicts: np.ndarray
    unsolved: np.ndarray
    elastic: np.ndarray
    problems: np.ndarray

    @classmethod
    def empty(cls, study: Study, k: int) -> Samples:
        """Return k samples without a figure."""
        return cls(
            np.full((k, len(study.scene.drives), len(FIGURES)), np.nan),
            np.full((k, len(study.criteria)), NOT_CHECKED, dtype=np.int8),
            np.zeros(k, dtype=int),
            np.full((k, len(study.elastic)), np.nan),
            np.full(k, "", dtype=object),
        )

    def put(self, rows: np.ndarray | int, others: Sequence[Any]) -> None:
        """Set some rows to those of others; fields that they lack stay."""
        for mine, theirs in zip(self, others, strict=False):
            mine[rows] = theirs


def compute(study: Study, values: np.ndarray) -> Samples:
    """Return the figures of some samples.

    Args:
        values: (k, number of targets).
    """
    n, sums = len(values), study.superposition
    samples, others = Samples.empty(study, n), np.arange(n)
    if sums is not None:
        summed = sums.cycles(values)
        some, others = np.flatnonzero(summed.fine), np.flatnonzero(~summed.fine)
        samples.put(some, _judged(study, summed, some))
    for k in map(int, others):
        try:
            samples.put(k, cycle_figures(study, values[k]))
        except PinfricError as problem:  # of this sample: the others go on
            samples.unsolved[k], samples.problems[k] = len(study.trajectory.t), str(problem)
    return samples


def _judged(study: Study, cycles: Summed, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The figures of some summed cycles, (n, na, number of `FIGURES`), and their verdicts."""
    demands, path = cycles.demands[some], study.trajectory.q
    margins, verdicts = np.ones(demands.shape[:2]), [np.empty((len(some), 0), dtype=int)]
    for k, trial in enumerate(study.trials):
        i = trial.actuator
        margins[:, i], codes = trial.verdicts(
            demands[:, i],
            cycles.asked[some, k],
            cycles.inertias[some, i],
            travel(study.scene, i, path),
        )
        verdicts.append(codes)
    return np.concatenate((demands, margins[:, :, None]), axis=2), np.hstack(verdicts)


def cycle_figures(
    study: Study, sample: Sequence[float] | np.ndarray
) -> tuple[np.ndarray, Sequence[int], int, Sequence[float]]:
    """Return one cycle's row of `Samples`, by inverse dynamics with the sample's values."""
    scene, trajectory = apply(study.scene, study.trajectory, study.targets, list(sample))
    # one thread: the processes share the cores already
    result = inverse_dynamics(scene, trajectory, threads=1)
    inertias = study.load_inertias(result) if study.trials else None
    margins, verdicts = _verdicts(study, result, inertias)
    elastic = elastic_figures(result) if study.elastic else ()
    unsolved = int(np.isnan(result.effort_lower).any(axis=1).sum())
    return np.column_stack((reduce(result), margins)), verdicts, unsolved, elastic


def elastic_figures(result: InverseResult) -> tuple[float, ...]:
    """Return `ELASTIC_FIGURES` of one cycle."""
    effects = elasticity(result)
    tools = [rest.tool for rest in effects.rests if rest.tool is not None]
    reversal = [tool.reversal for tool in tools if tool.reversal is not None]
    return (
        float(np.nanmin(effects.frequency)) if np.isfinite(effects.frequency).any() else np.nan,
        max((tool.sag_distance for tool in tools), default=np.nan),
        max((tool.farthest for tool in tools), default=np.nan),
        max(reversal, default=np.nan),
    )


def _verdicts(
    study: Study, result: InverseResult, inertias: np.ndarray | None
) -> tuple[np.ndarray, list[int]]:
    """(na,) least margins, 1 without a drive on trial; the verdicts of `Study.criteria`."""
    margins, verdicts = np.ones(len(result.scene.drives)), list[int]()
    if study.trials:
        # a path at another speed holds where it held
        holding = holds(result.scene, study.trajectory, result.states.v)
        for trial in study.trials:
            margins[trial.actuator], codes = trial.verdict(result, holding, inertias)
            verdicts += codes
    return margins, verdicts


def reduce(result: InverseResult) -> np.ndarray:
    """Return (na, number of `DEMANDS`), as `summarize` has them; `speed` is the drive's max |v|.

    Args:
        result: with times.
    """
    asked = signals(result)
    forces = asked["effort"], asked["motor torque"]
    demands = [x for force in forces for x in (force.max(axis=0), column_rms(result.times, force))]
    return np.column_stack((*demands, asked["speed"].max(axis=0)))
