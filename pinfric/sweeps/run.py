"""Sweeps: how peak and RMS of every drive vary with uncertain parameters."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from pinfric.errors import PinfricWarning, SweepError
from pinfric.model.brief import counted
from pinfric.model.scene import Scene, expect_scene
from pinfric.motions.sample_times import beyond_memory
from pinfric.motions.trajectory import Trajectory
from pinfric.sweeps.cycle import Samples, Study, compute
from pinfric.sweeps.file import SweepFile, load_sweep
from pinfric.sweeps.motors import MET, NOT_CHECKED, motors_on_trial
from pinfric.sweeps.parameters import count, draw, resolve
from pinfric.sweeps.result import SweepResult
from pinfric.sweeps.workers import compute_in_parallel

#: Sections that change no force on the robot: its motion is given.
_LOSSES = ("friction", "transmission")
#: Sweeps of this length are over before other processes have started (s).
_SHORT = 5.0
#: What one batch takes: long beside its transport (s).
_BATCH = 1.0
_MOST_PER_BATCH = 500
#: Samples by which the time of one is found: some, as a batch has a cost of its own.
_FEW = 5
#: Bytes of memory that a sample takes for each parameter and each drive: arrays held at once.
_PER_VALUE, _PER_DRIVE = 24, 120


def sweep(
    scene: Scene,
    trajectory: Trajectory,
    sweep: SweepFile | Mapping[str, Any] | str | Path,
    *,
    processes: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> SweepResult:
    """Return how the drives' peak and RMS vary with parameters drawn from distributions.

    Monte Carlo, Sobol (Saltelli) or grid over coefficients of friction, payload, speed and mounting
    (`parameters`). Samples depend on the seed only: results are the same on any number of
    processes, and on a cluster.

    Args:
        scene: the robot; drives of a catalogue that are checked add their masses to it, once.
        sweep: the sweep's file, or its content as a mapping.
        processes: on this machine; 1 computes in this process. None: as joblib's active backend
            (`joblib.parallel_config`), else chosen automatically.
        progress: called with the number of finished samples and of all.

    Raises:
        SweepError: the sweep has an unknown name or an impossible value, its samples do not fit
            the memory, none could be computed, or a process was killed.

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
    expect_scene(scene, "sweep")
    scene = scene.without_presliding
    if processes is not None and processes < 1:
        raise SweepError(f"processes = {processes}; should be at least 1")
    entries, source = load_sweep(sweep)
    targets = resolve(scene, entries, source)
    if trajectory.external and (moved := [x.name for x in targets if x.section not in _LOSSES]):
        raise SweepError(
            f"{source}: {', '.join(moved)}: the forces on {', '.join(trajectory.external)} were "
            "measured with one load, speed and mounting; vary friction and transmissions alone"
        )
    equipped, trials = motors_on_trial(scene, entries, source)
    study = Study(equipped, trajectory, targets, trials)
    n, drives = count(targets, entries), len(scene.actuator_names)
    if too_much := beyond_memory(n * (_PER_VALUE * len(targets) + _PER_DRIVE * drives)):
        raise SweepError(
            f"{source}: {n:,} samples of {counted(len(targets), 'parameter')} and "
            f"{counted(drives, 'drive')} {too_much}: take fewer samples"
        )
    values = draw(targets, entries)
    samples, used = _samples(study, values, progress, processes)
    problems = tuple(samples.problems)
    if all(problems):
        raise SweepError(f"{source}: no sample could be computed; the first: {problems[0]}")
    names = scene.actuator_names
    notes = _notes(study, values, samples.figures, problems)
    for note in notes:
        warnings.warn(note, PinfricWarning, stacklevel=2)
    return SweepResult(
        scene=scene.source,
        trajectory=trajectory.source,
        sweep=source,
        sampling=entries.sampling,
        seed=entries.seed,
        parameter_names=tuple(t.name for t in targets),
        actuator_names=names,
        units=tuple(scene.drives[i].unit for i in range(len(names))),
        motor_units=tuple(equipped.drives[i].motor_unit for i in range(len(names))),
        values=values,
        figures=samples.figures,
        verdicts=pd.DataFrame(
            {
                key: pd.arrays.BooleanArray(codes == MET, codes == NOT_CHECKED)
                for key, codes in zip(study.criteria, samples.verdicts.T, strict=True)
            },
            index=range(len(values)),
            dtype="boolean",
        ),
        unsolved=samples.unsolved,
        problems=problems,
        trials=trials,
        percentiles=entries.percentiles,
        processes=used,
        notes=notes,
        elastic=samples.elastic,
    )


def _samples(
    study: Study,
    values: np.ndarray,
    progress: Callable[[int, int], object] | None,
    processes: int | None,
) -> tuple[Samples, int]:
    """Return all samples as `compute` does, and the number of processes."""
    from joblib import cpu_count, effective_n_jobs

    n, done = len(values), 0
    whole = Samples.empty(study, n)
    tell = progress or (lambda done, total: None)
    tell(done, n)
    for few in (1, min(n, _FEW)):  # kernels are loaded by the first
        start = perf_counter()
        compute(study, values[:few])
        seconds = (perf_counter() - start) / few
    used = min(processes, int(cpu_count())) if processes else int(effective_n_jobs())
    if processes is None and used == 1 and seconds * n >= _SHORT:
        used = int(cpu_count())
    # batches of about `_BATCH` s, some for every process
    size = int(np.clip(_BATCH / max(seconds, 1e-6), 1, _MOST_PER_BATCH))
    size = max(min(size, n // (4 * used)), 1)
    used = min(used, -(-n // size))
    parts = (np.arange(start, min(start + size, n)) for start in range(0, n, size))
    batches: Iterable[tuple[np.ndarray, Samples]]
    if used == 1:
        batches = ((rows, compute(study, values[rows])) for rows in parts)
    else:
        batches = compute_in_parallel(study, parts, values, processes, used)
    for rows, batch in batches:
        whole.put(rows, batch)
        done += len(rows)
        tell(done, n)
    return whole, used


def _notes(
    study: Study, values: np.ndarray, figures: np.ndarray, problems: Sequence[str]
) -> tuple[str, ...]:
    scene, trajectory = study.scene, study.trajectory
    notes = []
    failed = ~np.isfinite(figures).all(axis=(1, 2))
    if failed.any():
        first = next((text for text in problems if text), "")
        why = f"; the first error: {first}" if first else ""
        notes.append(
            f"{failed.sum()} of {len(failed)} samples have no solution: they are left out of "
            f"percentiles and correlations, and count as samples in which no motor suffices{why}"
        )
    speeds = np.array([t.section == "speed" for t in study.targets])
    if speeds.any():
        limit = np.asarray(scene.model.velocityLimit)
        fastest = np.abs(trajectory.v).max(axis=0)
        ratio = float((fastest / np.where(limit > 0, limit, np.inf)).max())
        beyond = values[:, speeds].prod(axis=1) * ratio > 1 + 1e-9
        if beyond.any():
            notes.append(
                f"in {beyond.sum()} of {len(beyond)} samples a joint is faster than the "
                "URDF's velocity limit"
            )
    return tuple(notes)
