"""One sample of a sweep: inverse dynamics of one cycle, reduced to a few figures per drive.

This is what workers run. A sample depends on its own values only, so that neither the number of
processes nor a lost worker changes a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import PinfricError
from pinfric.model.drives import Drive
from pinfric.model.scene import Scene
from pinfric.model.schema import Transmission
from pinfric.study.elastic.motion import elasticity
from pinfric.study.sizing.assess import Assessment
from pinfric.study.sizing.catalog import Conditions
from pinfric.study.sizing.criteria import check
from pinfric.study.sizing.criterion import Status
from pinfric.study.sizing.demand import drive_cycle, gear_demand
from pinfric.study.sizing.drivetrain import Candidate, motor_cycle
from pinfric.study.sizing.inertia import load_inertias
from pinfric.study.sizing.limit import Case
from pinfric.study.sizing.size import holds, yielding
from pinfric.study.summary import ends_by_magnitude
from pinfric.study.sweep.parameters import ELASTIC, Target, apply
from pinfric.study.sweep.superposition import Solved, Superposition
from pinfric.study.trajectory.trajectory import Trajectory

#: What a cycle takes of each drive.
DEMANDS = ("peak", "rms", "motor_peak", "motor_rms", "speed")
#: What `size` says of the catalogue's drive on trial there: the criteria that fail and those not
#: checked (sums of 2^k, k the place in `Judge.criteria`), and the least margin. Where none is on
#: trial: 0, 0 and 1, since NaN would say that there is no solution.
VERDICT = ("failed", "not_checked", "margin")
_NO_TRIAL = (0.0, 0.0, 1.0)
#: The figures of each drive, in the order of the last axis of `Block.figures`.
FIGURES = (*DEMANDS, *VERDICT)


#: What elastic gears do in a cycle, the worst of its rests: Hz, m, m, m; NaN where not known.
ELASTIC_FIGURES = ("lowest_frequency", "tool_sag", "tool_interval", "tool_reversal")


@dataclass(frozen=True)
class Judge:
    """Holds a drive of a catalogue against the criteria of `size`.

    Attributes:
        candidate: motor and gear. conditions: what is demanded.
        hand: it moves one of the hand axes, beyond the third joint.
        criteria: names of those that are required, in the order of `check`.
    """

    candidate: Candidate
    conditions: Conditions
    hand: bool
    criteria: tuple[str, ...]

    def verdict(
        self,
        result: InverseResult,
        actuator: int,
        holding: np.ndarray,
        inertia: float | None,
        beyond: float,
    ) -> tuple[float, float, float]:
        """Return the figures of `VERDICT` for one cycle.

        Args:
            result: of the cycle. actuator: the drive's column.
            holding: (T,) the samples of the holds.
            inertia: largest about the joint over the cycle, kg m^2 (kg); None: not known.
            beyond: of the elastic drives beyond it, `size.yielding`.
        """
        drive = result.scene.drives[actuator]
        assert isinstance(drive, Drive)
        candidate = self.candidate
        if vars(drive.transmission) != {**vars(candidate.transmission), "judge": self}:
            candidate = replace(candidate, transmission=drive.transmission)  # the sample's losses
        cycle = drive_cycle(result, actuator, holding)
        demand = gear_demand(result, actuator, cycle, carried=candidate.bearing is not None)
        motor = motor_cycle(candidate, cycle, self.conditions)
        case = Case(demand, cycle, inertia, self.hand, self.conditions, beyond)
        found = check(candidate, motor, case)
        bits = {name: 2.0**k for k, name in enumerate(self.criteria)}
        failed, unchecked = (
            sum(bits[c.name] for c in found if c.status == status)
            for status in (Status.FAILS, Status.NOT_CHECKED)
        )
        return failed, unchecked, Assessment(candidate, found, motor.figures).margin


class JudgedTransmission(Transmission):
    """The transmission of a catalogue's drive on trial, with who judges it.

    The judge travels with the scene: to the workers, and into the store's hash of what the figures
    depend on.
    """

    judge: Judge


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
    _inertias: list[np.ndarray] = field(default_factory=list, repr=False, compare=False)

    @cached_property
    def superposition(self) -> Superposition | None:
        """The cycles that samples are sums of; None where they are not."""
        try:
            return Superposition.of(self.scene, self.trajectory, self.targets)
        except PinfricError:  # each sample says what is wrong
            return None

    @cached_property
    def judges(self) -> dict[int, Judge]:
        """Who judges the catalogue's drives on trial, by the drives' columns."""
        gears = {i: drive.transmission for i, drive in enumerate(self.scene.drives)}
        return {i: g.judge for i, g in gears.items() if isinstance(g, JudgedTransmission)}

    @property
    def elastic(self) -> bool:
        """Whether samples differ in stiffness or hysteresis: then `ELASTIC_FIGURES` are asked."""
        return any(target.key in ELASTIC for target in self.targets)

    def load_inertias(self, result: InverseResult) -> np.ndarray:
        """Return (na,) the largest inertia about each joint over one sample's cycle, kg m^2 (kg).

        Args:
            result: of the sample.
        """
        if any(target.section == "payload" for target in self.targets):
            return load_inertias(result)
        if not self._inertias:  # nothing else changes it: the path's configurations stay
            self._inertias.append(load_inertias(result))
        return self._inertias[0]

    def __getstate__(self) -> dict[str, Any]:
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}


@dataclass(frozen=True)
class Block:
    """The figures of some samples.

    Attributes:
        rows: (k,) which samples.
        figures: (k, na, number of `FIGURES`); NaN where there is no solution.
        unsolved: (k,) at how many instants of the cycle there is none.
        problems: (k,) why a sample could not be computed; empty where it could.
        elastic: (k, number of `ELASTIC_FIGURES`), (k, 0) where nothing elastic varies.
    """

    rows: np.ndarray
    figures: np.ndarray
    unsolved: np.ndarray
    problems: tuple[str, ...]
    elastic: np.ndarray


def compute(study: Study, rows: np.ndarray, values: np.ndarray) -> Block:
    """Return the figures of some samples, each by itself.

    Args:
        study: what they share.
        rows: (k,) which samples these are.
        values: (k, number of targets).
    """
    k, na = len(rows), len(study.scene.drives)
    figures, unsolved = np.full((k, na, len(FIGURES)), np.nan), np.zeros(k, dtype=np.int64)
    elastic = np.full((k, len(ELASTIC_FIGURES) * study.elastic), np.nan)
    problems = [""] * k
    if study.superposition is not None:
        _superposed_figures(study, study.superposition, values, figures)
    for i in np.flatnonzero(np.isnan(figures).any(axis=(1, 2))):
        try:
            figures[i], unsolved[i], elastic[i] = cycle_figures(study, values[i])
        except PinfricError as problem:  # of this sample: the others go on
            problems[i] = str(problem)
            unsolved[i] = len(study.trajectory.t)
    return Block(rows, figures, unsolved, tuple(problems), elastic)


def _superposed_figures(
    study: Study, sums: Superposition, values: np.ndarray, figures: np.ndarray
) -> None:
    """Write the figures of the samples that are sums of stored cycles; NaN stays for others."""
    figures[:, :, len(DEMANDS) :] = _NO_TRIAL
    demands, verdicts = figures[:, :, : len(DEMANDS)], figures[:, :, len(DEMANDS) :]

    def judge(i: int, cycle: Solved) -> None:
        verdicts[i] = _verdicts(study, *cycle)

    demands[:] = sums.figures(values, judge if study.judges else None)


def cycle_figures(
    study: Study, sample: Sequence[float] | np.ndarray
) -> tuple[np.ndarray, int, tuple[float, ...]]:
    """Return one cycle's figures (na, number of `FIGURES`), its instants without solution, and
    `ELASTIC_FIGURES` where they are asked.

    By inverse dynamics of the scene and the trajectory with the sample's values in them.
    """
    scene, trajectory = apply(study.scene, study.trajectory, study.targets, list(sample))
    # one thread: the processes share the cores already
    result = inverse_dynamics(scene, trajectory, threads=1)
    # loops couple the joints: none has an inertia of its own
    known = study.judges and not scene.loops
    verdicts = _verdicts(study, result, study.load_inertias(result) if known else None)
    figures = np.column_stack((reduce(result), verdicts))
    elastic = elastic_figures(result) if study.elastic else ()
    return figures, int(np.isnan(result.effort_lower).any(axis=1).sum()), elastic


def elastic_figures(result: InverseResult) -> tuple[float, ...]:
    """Return `ELASTIC_FIGURES` of one cycle."""
    found = elasticity(result)
    tools = [rest.tool for rest in found.rests if rest.tool is not None]
    reversal = [tool.reversal for tool in tools if tool.reversal is not None]
    return (
        float(np.nanmin(found.frequency)) if np.isfinite(found.frequency).any() else np.nan,
        max((tool.sag_distance for tool in tools), default=np.nan),
        max((tool.farthest for tool in tools), default=np.nan),
        max(reversal, default=np.nan),
    )


def _verdicts(study: Study, result: InverseResult, inertias: np.ndarray | None) -> np.ndarray:
    """(na, number of `VERDICT`); NaN where a drive on trial has instants without solution."""
    verdicts = np.tile(_NO_TRIAL, (len(result.scene.drives), 1))
    if not study.judges:
        return verdicts
    # a path at another speed holds where it held
    holding = holds(result.scene, study.trajectory, result.states.v)
    soft = {
        d: float(spring.stiffness[0])
        for d in result.scene.elastic
        if (spring := result.scene.drives[d].spring) is not None
    }
    for i, judge in study.judges.items():
        if np.isfinite(result.effort_lower[:, i] + result.effort_upper[:, i]).all():
            inertia = None if inertias is None else float(inertias[i])
            beyond = 0.0 if inertias is None else yielding(result.scene, i, soft, inertias)
            verdicts[i] = judge.verdict(result, i, holding, inertia, beyond)
        else:
            verdicts[i] = np.nan
    return verdicts


def reduce(result: InverseResult) -> np.ndarray:
    """Return (na, number of `DEMANDS`), as `summarize` has them; `speed` is max |v| of the drive.

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
