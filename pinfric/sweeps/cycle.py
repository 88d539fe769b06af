"""One sample of a sweep: inverse dynamics of one cycle, reduced to a few figures per drive.

This is what workers run. A sample depends on its own values only, so that neither the number of
processes nor a lost worker changes a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pinfric.drives.criterion import Status, least_margin
from pinfric.drives.demand import drive_cycle, gear_demand
from pinfric.drives.drivetrain import Candidate, motor_cycle
from pinfric.drives.inertia import load_inertias
from pinfric.drives.limit import Case
from pinfric.drives.limits import check
from pinfric.drives.policy import Conditions
from pinfric.drives.robot import holds
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.elastic.motion import elasticity
from pinfric.errors import PinfricError
from pinfric.model.drives import Drive
from pinfric.model.scene import Scene
from pinfric.model.schema import Transmission
from pinfric.motions.summary import column_rms, ends_by_magnitude
from pinfric.motions.trajectory import Trajectory
from pinfric.sweeps.parameters import ELASTIC, Target, apply
from pinfric.sweeps.superposition import Solved, Superposition

#: What a cycle takes of each drive.
DEMANDS = ("peak", "rms", "motor_peak", "motor_rms", "speed")
#: The figures of each drive, in the order of the last axis of `Block.figures`. `margin` is the
#: least of the criteria of a catalogue's drive on trial, 1 if none is on trial.
FIGURES = (*DEMANDS, "margin")
#: What a sample says of a criterion.
FAILS, MET, NOT_CHECKED = 0, 1, -1
_CODES = {Status.FAILS: FAILS, Status.NOT_CHECKED: NOT_CHECKED}
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
    ) -> tuple[float, list[int]]:
        """Return the least margin over one cycle, and the result of each of `criteria`.

        Args:
            result: of the cycle. actuator: the drive's column.
            holding: (T,) the samples of the holds.
            inertia: largest about the joint over the cycle, kg m^2 (kg); None: not known.
        """
        drive = result.scene.drives[actuator]
        assert isinstance(drive, Drive)
        candidate = self.candidate
        if vars(drive.transmission) != {**vars(candidate.transmission), "judge": self}:
            candidate = replace(candidate, transmission=drive.transmission)  # the sample's losses
        cycle = drive_cycle(result, actuator, holding)
        demand = gear_demand(result, actuator, cycle, carried=candidate.carried)
        motor = motor_cycle(candidate, cycle, self.conditions)
        case = Case(demand, cycle, inertia, self.hand, self.conditions)
        found = check(candidate, motor, case)
        codes = {c.name: _CODES.get(c.status, MET) for c in found}
        return least_margin(found), [codes[name] for name in self.criteria]


class JudgedTransmission(Transmission):
    """The transmission of a catalogue's drive on trial, with who judges it.

    The judge travels with the scene: to the workers, and into the store's hash of what the figures
    depend on.
    """

    judge: Judge


@dataclass(frozen=True)
class Study:
    """Data that all samples share.

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
    def criteria(self) -> tuple[tuple[int, str], ...]:
        """The columns of `Block.verdicts`: a drive on trial, and one of its criteria."""
        return tuple((i, name) for i, judge in self.judges.items() for name in judge.criteria)

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
        verdicts: (k, number of `Study.criteria`) MET, FAILS or NOT_CHECKED.
        unsolved: (k,) at how many instants of the cycle there is none.
        problems: (k,) why a sample could not be computed; empty where it could.
        elastic: (k, number of `ELASTIC_FIGURES`), (k, 0) where nothing elastic varies.
    """

    rows: np.ndarray
    figures: np.ndarray
    verdicts: np.ndarray
    unsolved: np.ndarray
    problems: tuple[str, ...]
    elastic: np.ndarray


class Cycle(NamedTuple):
    """One sample of a `Block`: (na, number of `FIGURES`), and the others' row."""

    figures: np.ndarray
    verdicts: np.ndarray
    unsolved: int
    elastic: tuple[float, ...]


def compute(study: Study, rows: np.ndarray, values: np.ndarray) -> Block:
    """Return the figures of some samples, each by itself.

    Args:
        study: what they share.
        rows: (k,) which samples these are.
        values: (k, number of targets).
    """
    k, na = len(rows), len(study.scene.drives)
    figures, unsolved = np.full((k, na, len(FIGURES)), np.nan), np.zeros(k, dtype=np.int64)
    verdicts = np.full((k, len(study.criteria)), NOT_CHECKED, dtype=np.int8)
    elastic = np.full((k, len(ELASTIC_FIGURES) * study.elastic), np.nan)
    problems = [""] * k
    if study.superposition is not None:
        _superposed_figures(study, study.superposition, values, figures, verdicts)
    for i in np.flatnonzero(np.isnan(figures).any(axis=(1, 2))):
        try:
            figures[i], verdicts[i], unsolved[i], elastic[i] = cycle_figures(study, values[i])
        except PinfricError as problem:  # of this sample: the others go on
            problems[i] = str(problem)
            unsolved[i] = len(study.trajectory.t)
    return Block(rows, figures, verdicts, unsolved, tuple(problems), elastic)


def _superposed_figures(
    study: Study, sums: Superposition, values: np.ndarray, figures: np.ndarray, verdicts: np.ndarray
) -> None:
    """Write the figures of the samples that are sums of stored cycles; NaN stays for others."""
    demands, margins = figures[:, :, :-1], figures[:, :, -1]
    margins[:] = 1.0

    def judge(i: int, cycle: Solved) -> None:
        margins[i], verdicts[i] = _verdicts(study, *cycle)

    demands[:] = sums.figures(values, judge if study.judges else None)


def cycle_figures(study: Study, sample: Sequence[float] | np.ndarray) -> Cycle:
    """Return the figures of one cycle.

    By inverse dynamics of the scene and the trajectory with the sample's values in them.
    """
    scene, trajectory = apply(study.scene, study.trajectory, study.targets, list(sample))
    # one thread: the processes share the cores already
    result = inverse_dynamics(scene, trajectory, threads=1)
    # loops couple the joints: none has an inertia of its own
    known = study.judges and not scene.loops
    margins, verdicts = _verdicts(study, result, study.load_inertias(result) if known else None)
    elastic = elastic_figures(result) if study.elastic else ()
    unsolved = int(np.isnan(result.effort_lower).any(axis=1).sum())
    return Cycle(np.column_stack((reduce(result), margins)), verdicts, unsolved, elastic)


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


def _verdicts(
    study: Study, result: InverseResult, inertias: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """(na,) least margins, NaN where a drive on trial has instants without solution; verdicts."""
    margins, verdicts = np.ones(len(result.scene.drives)), list[int]()
    # a path at another speed holds where it held
    holding = holds(result.scene, study.trajectory, result.states.v) if study.judges else None
    for i, judge in study.judges.items():
        assert holding is not None
        margin, codes = np.nan, [NOT_CHECKED] * len(judge.criteria)
        if np.isfinite(result.effort_lower[:, i] + result.effort_upper[:, i]).all():
            inertia = None if inertias is None else float(inertias[i])
            margin, codes = judge.verdict(result, i, holding, inertia)
        margins[i] = margin
        verdicts += codes
    return margins, np.array(verdicts, dtype=np.int8)


def reduce(result: InverseResult) -> np.ndarray:
    """Return (na, number of `DEMANDS`), as `summarize` has them; `speed` is max |v| of the drive.

    Args:
        result: with times.
    """
    assert result.t is not None  # a trajectory has them
    worst, _ = ends_by_magnitude(result.effort_lower, result.effort_upper)
    motor, _ = ends_by_magnitude(result.motor_torque_lower, result.motor_torque_upper)
    return np.column_stack(
        (
            np.abs(worst).max(axis=0),
            column_rms(result.t, worst),
            np.abs(motor).max(axis=0),
            column_rms(result.t, motor),
            np.abs(result.actuator_velocity).max(axis=0),
        )
    )
