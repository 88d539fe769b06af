"""Sweeps: how peak and RMS of every drive vary with uncertain parameters.

Friction is known to two digits at best, payloads and mountings differ from machine to machine. A
sweep draws them from distributions and runs the cycle's inverse dynamics for every sample. It gives
percentiles of the motors' demand, the probability that given motors suffice, and the most
influential parameters.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from pinfric import __version__
from pinfric.errors import PinfricWarning, SweepError
from pinfric.model.scene import Scene, expect_scene
from pinfric.motions.summary import effort_unit, motor_unit
from pinfric.motions.trajectory import Trajectory
from pinfric.sweeps.cycle import ELASTIC_FIGURES, FIGURES, NOT_CHECKED, Block, Study, compute
from pinfric.sweeps.file import SweepFile, load_sweep
from pinfric.sweeps.motors import Trial, motors_on_trial
from pinfric.sweeps.parameters import draw, resolve
from pinfric.sweeps.result import SweepResult
from pinfric.sweeps.store import Store, booleans, identity
from pinfric.sweeps.workers import (
    check_scheduler,
    compute_here,
    compute_on_cluster,
    compute_on_processes,
)

#: Sweeps of this length are over before other processes have started (s).
_SHORT = 5.0
#: What one batch takes: long beside its transport, short beside what a lost worker loses (s).
_BATCH = 1.0
_MOST_PER_BATCH = 500
#: A cluster whose size is not known yet: batches for so many workers.
_OF_A_CLUSTER = 16


def sweep(
    scene: Scene,
    trajectory: Trajectory,
    sweep: SweepFile | Mapping[str, Any] | str | Path,
    *,
    out: str | Path | None = None,
    processes: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> SweepResult:
    """Return how the drives' peak and RMS vary with parameters drawn from distributions.

    Monte Carlo, Sobol (Saltelli) or grid over coefficients of friction, payload, speed and
    mounting (`parameters`). The samples depend on the seed only, and their results on the
    samples only: they are the same on any number of processes, even if workers are lost.

    Args:
        scene: the robot; drives of a catalogue that are checked add their masses to it, once.
        trajectory: one cycle.
        sweep: the sweep's file, or its content as a mapping.
        out: folder for the samples (Parquet). Every finished batch is written at once, and a
            sweep that finds its batches there computes only what is missing.
        processes: on this machine; 1 computes in this process, None chooses automatically.
        scheduler: address of a Dask scheduler whose workers compute instead (extra `cluster`).
        progress: called with the number of finished samples and of all.

    Raises:
        SweepError: the sweep has an unknown name or an impossible value, the folder holds
            another sweep or one is writing into it, the scheduler cannot be reached, or no sample
            could be computed.

    Warns:
        PinfricWarning: samples without a solution; speeds beyond the robot's limits.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> motion = pf.load_trajectory("pendulum", scene)
    >>> speed = {"uniform": {"low": 0.9, "high": 1.1}}
    >>> varied = {"pinfric_sweep": 1, "samples": 100, "parameters": {"speed": speed}}
    >>> found = pf.sweep(scene, motion, varied, processes=1)
    >>> found.quantiles("peak").round(1).ravel().tolist()
    [4.5, 5.5, 6.3, 6.4]
    """
    _check_given(scene, processes, scheduler)
    entries, source = load_sweep(sweep)
    targets = resolve(scene, entries, source)
    equipped, trials = motors_on_trial(scene, entries, source)
    study = Study(equipped, trajectory, targets)
    values = draw(targets, entries)
    store = _store(study, values, out)
    with store.held() if store else nullcontext():
        run = _Run(study, values, store, progress)
        used = run.compute(processes, scheduler)
    if all(run.problems):
        raise SweepError(f"{source}: no sample could be computed; the first: {run.problems[0]}")
    result = _result(scene, run, entries, source, trials, used)
    for note in result.notes:
        warnings.warn(note, PinfricWarning, stacklevel=2)
    return result


def _check_given(scene: Scene, processes: int | None, scheduler: str | None) -> None:
    expect_scene(scene, "sweep")
    if processes is not None and processes < 1:
        raise SweepError(f"processes = {processes}; should be at least 1")
    if processes is not None and scheduler is not None:
        raise SweepError("give either `scheduler` or `processes`: a cluster has its own processes")
    if scheduler is not None:
        check_scheduler(scheduler)


class _Run:
    """The samples' figures, as they fill up."""

    def __init__(
        self,
        study: Study,
        values: np.ndarray,
        store: Store | None,
        progress: Callable[[int, int], object] | None,
    ) -> None:
        n, na = len(values), len(study.scene.drives)
        self.study, self.values, self.store = study, values, store
        self.progress = progress or (lambda done, total: None)
        self.figures = np.full((n, na, len(FIGURES)), np.nan)
        self.verdicts = np.full((n, len(study.criteria)), NOT_CHECKED, dtype=np.int8)
        self.unsolved, self.problems = np.zeros(n, dtype=np.int64), [""] * n
        self.elastic = np.full((n, len(ELASTIC_FIGURES) * study.elastic), np.nan)
        self.done = np.zeros(n, dtype=bool)
        for block in store.read() if store else ():
            self._take(block)
        self.resumed = int(self.done.sum())

    def compute(self, processes: int | None, scheduler: str | None) -> int:
        """Compute what is missing; returns how many processes did (0: a cluster, or none)."""
        used = 0
        missing = np.flatnonzero(~self.done)
        self.progress(self.resumed, len(self.values))
        if missing.size:
            seconds = self._try_one(missing[0])
            if scheduler is None:
                used = processes or _worthwhile(seconds * missing.size)
            parts = _batches(missing, seconds, used or _OF_A_CLUSTER)
            given = self.study, parts, self.values
            if scheduler is not None:
                blocks = compute_on_cluster(*given, scheduler)
            elif used == 1:
                blocks = compute_here(*given)
            else:
                blocks = compute_on_processes(*given, used)
            for block in blocks:
                if self.store is not None:
                    self.store.write(block, self.values[block.rows])
                self._take(block)
                self.progress(int(self.done.sum()), len(self.values))
        if self.store is not None and (missing.size or not self.store.complete):
            everything = Block(
                np.arange(len(self.values)),
                self.figures,
                self.verdicts,
                self.unsolved,
                tuple(self.problems),
                self.elastic,
            )
            self.store.finish(everything, self.values)
        return used

    def _take(self, block: Block) -> None:
        self.figures[block.rows], self.unsolved[block.rows] = block.figures, block.unsolved
        self.verdicts[block.rows], self.elastic[block.rows] = block.verdicts, block.elastic
        self.done[block.rows] = True
        for row, problem in zip(block.rows, block.problems, strict=True):
            self.problems[row] = problem

    def _try_one(self, row: int) -> float:
        """Compute one sample twice (kernels are loaded by the first) and return its time in s."""
        rows = np.array([row])
        for _ in range(2):
            start = perf_counter()
            compute(self.study, rows, self.values[rows])
        return perf_counter() - start


def _result(
    scene: Scene,
    run: _Run,
    entries: SweepFile,
    source: str,
    trials: tuple[Trial, ...],
    used: int,
) -> SweepResult:
    """The result of a finished run; its study's scene has the drives that are checked."""
    study = run.study
    equipped = study.scene
    return SweepResult(
        scene=scene.source,
        trajectory=study.trajectory.source,
        sweep=source,
        sampling=entries.sampling,
        seed=entries.seed,
        parameter_names=tuple(t.name for t in study.targets),
        actuator_names=scene.actuator_names,
        units=tuple(effort_unit(scene, i) for i in range(len(scene.drives))),
        motor_units=tuple(motor_unit(equipped, i) for i in range(len(scene.drives))),
        values=run.values,
        figures=run.figures,
        verdicts=_frame(study, run.verdicts),
        unsolved=run.unsolved,
        problems=tuple(run.problems),
        trials=trials,
        percentiles=entries.percentiles,
        processes=used,
        resumed=run.resumed,
        notes=_notes(run),
        elastic=run.elastic,
    )


def _store(study: Study, values: np.ndarray, out: str | Path | None) -> Store | None:
    if out is None:
        return None
    return Store(
        Path(out),
        identity(study, values, __version__),
        tuple(target.name for target in study.targets),
        study.scene.actuator_names,
        study.criteria,
    )


def _frame(study: Study, verdicts: np.ndarray) -> pd.DataFrame:
    """(n, number of criteria) of True, False and NA, columns (drive, criterion)."""
    names = [(study.scene.actuator_names[i], name) for i, name in study.criteria]
    columns = {name: booleans(verdicts[:, k]) for k, name in enumerate(names)}
    return pd.DataFrame(columns, index=range(len(verdicts)), dtype="boolean")


def _worthwhile(seconds: float) -> int:
    """Processes for a sweep that takes one of them so long."""
    if seconds < _SHORT:
        return 1
    from joblib import cpu_count

    return int(cpu_count())


def _batches(missing: np.ndarray, seconds: float, processes: int) -> Iterator[np.ndarray]:
    """Cut the missing samples into batches of about `_BATCH` s, some for every process."""
    size = int(np.clip(_BATCH / max(seconds, 1e-6), 1, _MOST_PER_BATCH))
    size = max(min(size, len(missing) // (4 * processes)), 1)
    return (missing[start : start + size] for start in range(0, len(missing), size))


def _notes(run: _Run) -> tuple[str, ...]:
    scene, trajectory = run.study.scene, run.study.trajectory
    notes = []
    failed = ~np.isfinite(run.figures).all(axis=(1, 2))
    if failed.any():
        first = next((text for text in run.problems if text), "")
        why = f"; the first error: {first}" if first else ""
        notes.append(
            f"{failed.sum()} of {len(failed)} samples have no solution: they are left out of "
            f"percentiles and correlations, and count as samples in which no motor suffices{why}"
        )
    speeds = np.array([t.section == "speed" for t in run.study.targets])
    if speeds.any():
        limit = np.asarray(scene.model.velocityLimit)
        fastest = np.abs(trajectory.v).max(axis=0)
        ratio = float((fastest / np.where(limit > 0, limit, np.inf)).max())
        beyond = run.values[:, speeds].prod(axis=1) * ratio > 1 + 1e-9
        if beyond.any():
            notes.append(
                f"in {beyond.sum()} of {len(beyond)} samples a joint is faster than the "
                "URDF's velocity limit"
            )
    return tuple(notes)
