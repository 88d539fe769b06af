"""Samples of a sweep: inverse dynamics of one cycle, reduced to a few figures per drive.

Workers run this. A sample depends on its own values only: neither the number of processes nor a
lost worker changes a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

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
from pinfric.sweeps.motors import MET, NOT_CHECKED, Trial
from pinfric.sweeps.parameters import ELASTIC, Target, apply
from pinfric.sweeps.superposition import Summed, Superposition

if TYPE_CHECKING:
    import pandas as pd

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


class SampleFigures(NamedTuple):
    """One sample.

    Attributes:
        figures: (na, number of `FIGURES`); NaN where there is no solution.
        verdicts: (number of `Study.criteria`,) FAILS, MET or NOT_CHECKED.
        unsolved: number of instants without a solution.
        elastic: as `Study.elastic`.
    """

    figures: np.ndarray
    verdicts: Sequence[int]
    unsolved: int = 0
    elastic: Sequence[float] = ()


def compute(study: Study, rows: np.ndarray, values: np.ndarray) -> pd.DataFrame:
    """Return the figures of some samples, one per row.

    Columns: `sample`, the parameters, `<drive>.<figure>`, `<drive>.<criterion>` (true, false, or
    missing: not checked), `Study.elastic`, `unsolved`, `problem`.

    Args:
        rows: (k,) indices of the samples.
        values: (k, number of targets).
    """
    import pandas as pd

    n, sums = len(rows), study.superposition
    figures = np.full((n, len(study.scene.drives), len(FIGURES)), np.nan)
    codes = np.full((n, len(study.criteria)), NOT_CHECKED)
    elastic = np.full((n, len(study.elastic)), np.nan)
    unsolved, problems, others = np.zeros(n, dtype=int), [""] * n, np.arange(n)
    if sums is not None:
        summed = sums.cycles(values)
        some, others = np.flatnonzero(summed.fine), np.flatnonzero(~summed.fine)
        figures[some], codes[some] = _judged(study, summed, some)
    for k in map(int, others):
        try:
            one = cycle_figures(study, values[k])
            figures[k], codes[k], unsolved[k], elastic[k] = one
        except PinfricError as problem:  # of this sample: the others go on
            unsolved[k], problems[k] = len(study.trajectory.t), str(problem)
    table = figures.reshape(n, -1)
    drives = study.scene.actuator_names
    columns: dict[str, Any] = {"sample": rows}
    columns |= {target.name: values[:, j] for j, target in enumerate(study.targets)}
    named = [f"{drive}.{figure}" for drive in drives for figure in FIGURES]
    columns |= dict(zip(named, table.T, strict=True))
    for k, name in enumerate(map(".".join, study.criteria)):
        columns[name] = pd.arrays.BooleanArray(codes[:, k] == MET, codes[:, k] == NOT_CHECKED)
    columns |= {name: elastic[:, k] for k, name in enumerate(study.elastic)}
    return pd.DataFrame(columns | {"unsolved": unsolved, "problem": problems})


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


def cycle_figures(study: Study, sample: Sequence[float] | np.ndarray) -> SampleFigures:
    """Return the figures of one cycle by inverse dynamics with the sample's values."""
    scene, trajectory = apply(study.scene, study.trajectory, study.targets, list(sample))
    # one thread: the processes share the cores already
    result = inverse_dynamics(scene, trajectory, threads=1)
    inertias = study.load_inertias(result) if study.trials else None
    margins, verdicts = _verdicts(study, result, inertias)
    elastic = elastic_figures(result) if study.elastic else ()
    unsolved = int(np.isnan(result.effort_lower).any(axis=1).sum())
    return SampleFigures(np.column_stack((reduce(result), margins)), verdicts, unsolved, elastic)


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
