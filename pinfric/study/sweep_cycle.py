"""One sample of a sweep: inverse dynamics of one cycle, reduced to a few figures per drive.

This is what workers run. A sample depends on its own values only, so that neither the number of
processes nor a lost worker changes a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse import inverse_dynamics
from pinfric.dynamics.result import InverseResult
from pinfric.errors import PinfricError
from pinfric.model.scene import Scene
from pinfric.study.summary import ends_by_magnitude
from pinfric.study.sweep_parameters import Target, apply
from pinfric.study.trajectory import Trajectory

#: The figures of each drive, in the order of the last axis of `Block.figures`.
FIGURES = ("peak", "rms", "motor_peak", "motor_rms", "speed")


@dataclass(frozen=True)
class Study:
    """What all samples share.

    Attributes:
        scene, trajectory: before a sample's values are put in.
        targets: what the values change.
    """

    scene: Scene
    trajectory: Trajectory
    targets: tuple[Target, ...]


@dataclass(frozen=True)
class Block:
    """The figures of some samples.

    Attributes:
        rows: (k,) which samples.
        figures: (k, na, number of `FIGURES`); NaN where there is no solution.
        unsolved: (k,) at how many instants of the cycle there is none.
        problems: (k,) why a sample could not be computed; empty where it could.
    """

    rows: np.ndarray
    figures: np.ndarray
    unsolved: np.ndarray
    problems: tuple[str, ...]


def compute(study: Study, rows: np.ndarray, values: np.ndarray) -> Block:
    """Return the figures of some samples, each by itself.

    Args:
        study: what they share.
        rows: (k,) which samples these are.
        values: (k, number of targets).
    """
    k, na = len(rows), len(study.scene.drives)
    figures, unsolved = np.full((k, na, len(FIGURES)), np.nan), np.zeros(k, dtype=np.int64)
    problems = []
    for i, sample in enumerate(values):
        try:
            figures[i], unsolved[i] = cycle_figures(study, sample)
            problems.append("")
        except PinfricError as problem:  # of this sample: the others go on
            problems.append(str(problem))
            unsolved[i] = len(study.trajectory.t)
    return Block(rows, figures, unsolved, tuple(problems))


def cycle_figures(study: Study, sample: Sequence[float] | np.ndarray) -> tuple[np.ndarray, int]:
    """Return one cycle's figures (na, number of `FIGURES`) and its instants without solution."""
    scene, trajectory = apply(study.scene, study.trajectory, study.targets, list(sample))
    # one thread: the processes share the cores already
    result = inverse_dynamics(scene, trajectory, threads=1)
    return reduce(result), int(np.isnan(result.effort_lower).any(axis=1).sum())


def reduce(result: InverseResult) -> np.ndarray:
    """Return (na, number of `FIGURES`), as `summarize` has them; `speed` is max |v| of the drive.

    Args:
        result: with times.
    """
    assert result.t is not None  # a trajectory has them
    worst, _ = ends_by_magnitude(result.effort_lower, result.effort_upper)
    motor, _ = ends_by_magnitude(result.motor_torque_lower, result.motor_torque_upper)
    return np.column_stack((
        np.abs(worst).max(axis=0), _rms(result.t, worst),
        np.abs(motor).max(axis=0), _rms(result.t, motor),
        np.abs(result.actuator_velocity).max(axis=0),
    ))  # fmt: skip


def _rms(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """`summary.rms` of every column of x (T, na) at once."""
    largest = np.abs(x).max(axis=0)
    if len(t) == 1:
        return largest
    scale = np.where(largest > 0, largest, 1.0)  # NaN, too, is not above 0
    mean_square = np.trapezoid((x / scale) ** 2, t, axis=0) / (t[-1] - t[0])
    return np.where(largest > 0, scale * np.sqrt(mean_square), largest)
