"""The motors a sweep puts on trial: ratings from the sweep's file or from a catalogue, by name.

A catalogue's drive, motor and gear, is held against the criteria of `size`, each sample where it is
computed (`Trial.verdict`). A motor alone, or ratings given, are held against those rows of the same
table whose need is a figure of the motor.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinfric.drives.catalog import Catalog
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status, least_margin
from pinfric.drives.drivetrain import Candidate, Ratings, ratings_of
from pinfric.drives.limit import Drives, drive, idle
from pinfric.drives.limits import LIMITS, check
from pinfric.drives.parts import check_names, criteria_over, named_drive
from pinfric.drives.policy import BASE_AXES, Conditions, parse_conditions
from pinfric.drives.robot import depth, equip
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import CatalogError, SizingError, SweepError, choose_from, problems_line
from pinfric.model.drives import Drive
from pinfric.model.scene import Scene
from pinfric.sweeps.file import MotorOnTrial, SweepFile

if TYPE_CHECKING:
    import pandas as pd

    from pinfric.sweeps.result import SweepResult

#: What a sample says of a criterion.
FAILS, MET, NOT_CHECKED = 0, 1, -1
_CODES = {Status.FAILS: FAILS, Status.NOT_CHECKED: NOT_CHECKED}
#: Signal of the table (`limit.SIGNALS`) -> the figure of a sweep that is its need.
_NEEDS = {"motor torque": "motor_peak", "motor RMS torque": "motor_rms", "motor speed": "speed"}


class Bound(NamedTuple):
    """A row of the table for a motor by itself.

    Attributes:
        signal: one of `_NEEDS`. available: at the motor's shaft; None: not known.
        reserve: factor on the need.
    """

    signal: str
    available: float | None
    reserve: float


@dataclass(frozen=True)
class Trial:
    """A motor's ratings, all at the motor's shaft (of an ideal drive: at the joint).

    Attributes:
        drive: which drive it moves. actuator: its column.
        name: in the catalogue; empty where the sweep's file gives the ratings.
        candidate: motor and gear, as rated. conditions: what is demanded.
        continuous_torque, peak_torque: N m (N); None is not checked.
        max_speed: rad/s (m/s), or None.
        ratio: motor turns per joint turn, 1 for an ideal drive.
        checks: the criteria of `size` it is held against; empty where only ratings are compared.
        mass: kg of a catalogue's drive; None where not known.
        bounds: name -> the rows that a motor by itself is held against.
    """

    drive: str
    actuator: int
    name: str
    candidate: Candidate
    conditions: Conditions
    continuous_torque: float | None
    peak_torque: float | None
    max_speed: float | None
    ratio: float
    checks: tuple[str, ...] = ()
    mass: float | None = None
    bounds: Mapping[str, Bound] = field(default_factory=dict)

    def verdict(
        self, result: InverseResult, holding: np.ndarray, inertias: np.ndarray | None
    ) -> tuple[float, list[int]]:
        """Return the least margin over one cycle, and MET, FAILS or NOT_CHECKED of `checks`.

        NaN and NOT_CHECKED where there are instants without a solution.

        Args:
            result: of the cycle.
            holding: (T,) the samples of the holds.
            inertias: (na,) largest about each joint over the cycle, kg m^2 (kg); None: not known.
        """
        i, candidate = self.actuator, self.candidate
        if not np.isfinite(result.effort_lower[:, i] + result.effort_upper[:, i]).all():
            return np.nan, [NOT_CHECKED] * len(self.checks)
        drive = result.scene.drives[i]
        assert isinstance(drive, Drive)
        if drive.transmission != candidate.transmission:  # the sample's losses
            candidate = dataclasses.replace(candidate, transmission=drive.transmission)
        inertia = None if inertias is None else float(inertias[i])
        found = criteria_over(result, i, candidate, self.conditions, holding, inertia)
        codes = {c.name: _CODES.get(c.status, MET) for c in found}
        return least_margin(found), [codes[name] for name in self.checks]

    def passes(self, result: SweepResult) -> dict[str, np.ndarray]:
        """Return for each row of `bounds` which samples are within it, (n,); NaN is not.

        need <= available, without the reserve.
        """
        return self._within(result, reserve=False)

    def met(self, result: SweepResult) -> dict[str, np.ndarray]:
        """Return for each criterion that could be checked which samples meet it, (n,).

        Of a catalogue's drive all criteria of `size`; else its ratings, the peak with its reserve.
        A sample without a solution meets none.
        """
        if not self.checks:
            return self._within(result, reserve=True)
        solved = np.isfinite(result.figure("margin")[:, self.actuator])
        return {
            name: solved & verdict.fillna(True).to_numpy(dtype=bool)
            for name, verdict in self._verdicts(result).items()
            if not solved.any() or not verdict[solved].isna().all()
        }

    def not_checked(self, result: SweepResult) -> tuple[str, ...]:
        """Return the criteria for which a figure is missing, in any sample that has a solution."""
        if self.checks:
            solved = np.isfinite(result.figure("margin")[:, self.actuator])
            verdicts = self._verdicts(result).items()
            return tuple(name for name, verdict in verdicts if verdict[solved].isna().any())
        return tuple(name for name, bound in self.bounds.items() if bound.available is None)

    def _verdicts(self, result: SweepResult) -> dict[str, pd.Series]:
        return {name: result.verdicts[self.drive, name] for name in self.checks}

    def _within(self, result: SweepResult, reserve: bool) -> dict[str, np.ndarray]:
        met = {}
        for name, bound in self.bounds.items():
            if bound.available is not None:
                need = result.figure(_NEEDS[bound.signal])[:, self.actuator]
                need = need * (abs(self.ratio) if bound.signal == "motor speed" else 1.0)
                met[name] = (bound.reserve if reserve else 1.0) * need <= bound.available
        return met


def motors_on_trial(scene: Scene, sweep: SweepFile, source: str) -> tuple[Scene, tuple[Trial, ...]]:
    """Return the scene with the named drives, their masses and criteria, and the motors to check.

    Raises:
        SweepError: a drive or a name that is not there, figures that are missing; all at once.
        CatalogError: the catalogue cannot be read.
    """
    named = any(entry.motor or entry.drive for entry in sweep.motors.values())
    catalog = load_catalog(sweep.catalog) if named else None
    conditions = Conditions() if catalog is None else catalog.conditions
    problems, trials = [], []
    try:
        conditions = parse_conditions(sweep.conditions, conditions)
        check_names(scene, conditions)
    except CatalogError as problem:
        problems.append(str(problem))
    for name, entry in sweep.motors.items():
        try:
            trials.append(_trial(scene, catalog, conditions, name, entry))
        except SweepError as problem:
            problems.append(f"`motors.{name}`: {problem}")
    if problems:
        raise SweepError(problems_line(source, problems))
    try:
        judged = {trial.actuator: trial.candidate for trial in trials if trial.checks}
        return (equip(scene, judged, conditions) if judged else scene), tuple(trials)
    except SizingError as problem:
        raise SweepError(f"{source}: {problem}") from None


def _trial(
    scene: Scene,
    catalog: Catalog | None,
    conditions: Conditions,
    name: str,
    entry: MotorOnTrial,
) -> Trial:
    if name not in scene.actuator_names:
        raise SweepError(f"there is no such drive; {choose_from(name, scene.actuator_names)}")
    actuator = scene.actuator_names.index(name)
    hand = depth(scene, actuator) > BASE_AXES
    candidate = _rated(scene, catalog, conditions, actuator, entry)
    # a gearmotor is rated at its output; the sweep compares at the motor's shaft
    scale = candidate.ratio if candidate.at_output else 1.0
    per_shaft = {"continuous_torque": 1 / scale, "peak_torque": 1 / scale, "max_speed": scale}
    given = {k: getattr(entry, k) for k in per_shaft if getattr(entry, k) is not None}
    own = {k: x / per_shaft[k] for k, x in given.items()}
    if "continuous_torque" in own:
        own["continuous_curve"] = None
    ratings = dataclasses.replace(candidate.ratings, **own)
    judged = drive(dataclasses.replace(candidate, ratings=ratings), None, idle(conditions, hand))
    bounds = _bounds(judged, scale)
    transmission = candidate.transmission or getattr(scene.drives[actuator], "transmission", None)
    if entry.drive is None and all(bound.available is None for bound in bounds.values()):
        raise SweepError(f"{entry.motor}: the catalogue has no figure to check")
    return Trial(
        name,
        actuator,
        entry.drive or entry.motor or "",
        judged.candidate,
        conditions,
        **{
            k: None if (x := getattr(ratings, k)) is None else factor * x
            for k, factor in per_shaft.items()
        },
        ratio=1.0 if transmission is None else transmission.ratio,
        checks=() if entry.drive is None else _required(judged),
        mass=candidate.mass if entry.drive is not None else None,
        bounds=bounds,
    )


def _rated(
    scene: Scene,
    catalog: Catalog | None,
    conditions: Conditions,
    actuator: int,
    entry: MotorOnTrial,
) -> Candidate:
    """What the sweep's file names: a drive of the catalogue, a motor of it, or nothing rated."""
    drive = scene.drives[actuator]
    if entry.drive is not None:
        assert catalog is not None
        if not isinstance(drive, Drive) or not depth(scene, actuator):
            raise SweepError("cannot have a motor with a gear; give the ratings, or `motor`")
        try:
            found = named_drive(scene, actuator, entry.drive, catalog, conditions)
        except CatalogError as problem:
            raise SweepError(str(problem)) from None
        if found.transmission is None:
            raise SweepError(f"{entry.drive}: not known: {', '.join(found.missing)}")
        return found
    if entry.motor is None:
        return Candidate(drive.name, drive.name, None, 1.0, Ratings())
    assert catalog is not None
    if entry.motor not in catalog.motors:
        raise SweepError(
            f"the catalogue has no motor {entry.motor!r}; "
            f"{choose_from(entry.motor, catalog.motors)}"
        )
    ratings = ratings_of(catalog.motors[entry.motor])
    return Candidate(entry.motor, entry.motor, None, 1.0, ratings)


def _bounds(judged: Drives, scale: float) -> dict[str, Bound]:
    """The rows of the table that a motor by itself is held against, at the motor's shaft.

    Args:
        judged: the motor. scale: its turns per turn of the shaft where it is rated.
    """
    bounds = {}
    for limit in LIMITS:
        if isinstance(limit.need, str) and limit.need in _NEEDS and limit.applies(judged):
            factor = scale if limit.need == "motor speed" else 1 / scale
            there = factor * float(limit.available(judged))
            available = None if np.isnan(there) else there
            bounds[limit.name] = Bound(limit.need, available, limit.factor(judged.conditions))
    return bounds


def _required(judged: Drives) -> tuple[str, ...]:
    """The names of the criteria that are required of a drive, found on one that does nothing."""
    found = check(judged.candidate, None, judged.case)
    return tuple(c.name for c in found if c.status != Status.NOT_REQUIRED)
