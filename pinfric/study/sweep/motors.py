"""The motors a sweep puts on trial: ratings from the sweep's file or from a catalogue, by name.

A catalogue's drive, motor and gear, is held against the criteria of `size`, each sample where it is
computed (`cycle.Judge`). Of a motor alone, or of ratings given, only these are compared.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinfric.errors import CatalogError, SizingError, SweepError, choose_from, problems_line
from pinfric.model.drives import Drive
from pinfric.model.scene import Scene
from pinfric.model.schema import Transmission
from pinfric.study.sizing.assess import Assessment, own_bearing
from pinfric.study.sizing.bearing import BearingRatings
from pinfric.study.sizing.catalog import Catalog, Conditions, load_catalog
from pinfric.study.sizing.criteria import Case, check
from pinfric.study.sizing.criterion import Status
from pinfric.study.sizing.demand import DriveCycle, GearDemand
from pinfric.study.sizing.drivetrain import Candidate, Ratings, candidates
from pinfric.study.sizing.size import (
    BASE_AXES,
    check_names,
    depth,
    geared,
    with_masses,
    without_drives,
)
from pinfric.study.summary import effort_unit
from pinfric.study.sweep.cycle import FIGURES, Judge, JudgedTransmission
from pinfric.study.sweep.file import MotorOnTrial, SweepFile


@dataclass(frozen=True)
class Trial:
    """A motor's ratings, all at the motor's shaft (of an ideal drive: at the joint).

    Attributes:
        drive: which drive it moves. actuator: its column.
        name: in the catalogue; empty where the sweep's file gives the ratings.
        continuous_torque, peak_torque: N m (N); None is not checked.
        max_speed: rad/s (m/s), or None.
        ratio: motor turns per joint turn, 1 for an ideal drive.
        peak_factor: reserve on the peak torque.
        checks: the criteria of `size` it is held against; empty where only ratings are compared.
        mass: kg of a catalogue's drive, in the model; None where not known.
    """

    drive: str
    actuator: int
    name: str
    continuous_torque: float | None
    peak_torque: float | None
    max_speed: float | None
    ratio: float
    peak_factor: float = 1.0
    checks: tuple[str, ...] = ()
    mass: float | None = None

    def passes(self, figures: np.ndarray) -> dict[str, np.ndarray]:
        """Return for each rating which samples stay within it, (n,), no reserve; NaN does not.

        max |T_m| <= peak_torque, RMS(T_m) <= continuous_torque, |ratio| max |v| <= max_speed.

        Args:
            figures: (n, na, number of `FIGURES`).
        """
        return self._within(figures, 1.0)

    def met(self, figures: np.ndarray) -> dict[str, np.ndarray]:
        """Return for each criterion that could be checked which samples meet it, (n,).

        Of a catalogue's drive all criteria of `size`; else its ratings, the peak with its reserve.
        A sample without a solution meets none.

        Args:
            figures: (n, na, number of `FIGURES`).
        """
        if not self.checks:
            return self._within(figures, self.peak_factor)
        failed, unchecked = self._bits(figures, "failed"), self._bits(figures, "not_checked")
        solved = np.isfinite(self._of(figures, "failed"))
        return {
            name: solved & ~failed[:, k]
            for k, name in enumerate(self.checks)
            if not solved.any() or not unchecked[solved, k].all()
        }

    def not_checked(self, figures: np.ndarray) -> tuple[str, ...]:
        """Return the criteria for which a figure is missing, in any sample.

        Args:
            figures: (n, na, number of `FIGURES`).
        """
        if self.checks:
            unchecked = self._bits(figures, "not_checked")
            return tuple(name for k, name in enumerate(self.checks) if unchecked[:, k].any())
        ratings = {"continuous": self.continuous_torque, "peak": self.peak_torque,
                   "speed": self.max_speed}  # fmt: skip
        return tuple(name for name, rating in ratings.items() if rating is None)

    def _of(self, figures: np.ndarray, name: str) -> np.ndarray:
        return np.asarray(figures[:, self.actuator, FIGURES.index(name)])

    def _bits(self, figures: np.ndarray, name: str) -> np.ndarray:
        """(n, number of checks) of a sum of 2^k; none where there is no solution."""
        sums = np.nan_to_num(self._of(figures, name)).astype(np.int64)
        return (sums[:, None] >> np.arange(len(self.checks))) & 1 == 1

    def _within(self, figures: np.ndarray, peak_factor: float) -> dict[str, np.ndarray]:
        met = {}
        if self.continuous_torque is not None:
            met["continuous"] = self._of(figures, "motor_rms") <= self.continuous_torque
        if self.peak_torque is not None:
            met["peak"] = peak_factor * self._of(figures, "motor_peak") <= self.peak_torque
        if self.max_speed is not None:
            met["speed"] = abs(self.ratio) * self._of(figures, "speed") <= self.max_speed
        return met


def motors_on_trial(scene: Scene, sweep: SweepFile, source: str) -> tuple[Scene, tuple[Trial, ...]]:
    """Return the scene with the named drives, their masses and judges, and what is on trial.

    Raises:
        SweepError: a drive or a name that is not there, figures that are missing; all at once.
        CatalogError: the catalogue cannot be read.
    """
    named = any(entry.motor or entry.drive for entry in sweep.motors.values())
    catalog = load_catalog(sweep.catalog) if named else None
    conditions = Conditions() if catalog is None else catalog.conditions
    if sweep.conditions is not None:
        given = sweep.conditions
        conditions = conditions.model_copy(
            update={key: getattr(given, key) for key in given.model_fields_set}
        )
    problems, trials = [], []
    judges: dict[int, Judge] = {}
    try:
        check_names(scene, conditions)
    except CatalogError as problem:
        problems.append(str(problem))
    for name, entry in sweep.motors.items():
        try:
            trials.append(_trial(scene, catalog, conditions, name, entry, judges))
        except SweepError as problem:
            problems.append(f"`motors.{name}`: {problem}")
    if problems:
        raise SweepError(problems_line(source, problems))
    if judges:
        scene = _equipped(scene, judges, conditions, source)
    return scene, tuple(trials)


def _equipped(
    scene: Scene, judges: Mapping[int, Judge], conditions: Conditions, source: str
) -> Scene:
    """The scene with the drives' masses, as `size` puts them there, and their transmissions."""
    taken = {i: Assessment(judge.candidate, (), None) for i, judge in judges.items()}
    # a drive whose mass is not known changes nothing: what the URDF has may be as good
    weighed = {i: a for i, a in taken.items() if a.candidate.mass is not None}
    gears: dict[str, Transmission] = {}
    for i, judge in judges.items():
        transmission = judge.candidate.transmission
        assert transmission is not None  # `_trial` refuses it
        gears[scene.drives[i].name] = JudgedTransmission.model_construct(
            **dict(transmission), judge=judge
        )
    try:
        bare = without_drives(scene, gears)
        heavier = with_masses(bare, weighed, conditions, drives=False)
        return dataclasses.replace(heavier, actuators=geared(heavier, gears))
    except SizingError as problem:
        raise SweepError(f"{source}: {problem}") from None


def _trial(
    scene: Scene,
    catalog: Catalog | None,
    conditions: Conditions,
    name: str,
    entry: MotorOnTrial,
    judges: dict[int, Judge],
) -> Trial:
    if name not in scene.actuator_names:
        raise SweepError(f"there is no such drive; {choose_from(name, scene.actuator_names)}")
    actuator = scene.actuator_names.index(name)
    drive = scene.drives[actuator]
    transmission = drive.transmission if isinstance(drive, Drive) else None
    ratings, scale, candidate = Ratings(), 1.0, None
    if entry.drive is not None:
        assert catalog is not None
        if not isinstance(drive, Drive) or not depth(scene, actuator):
            raise SweepError("takes no motor with a gear; give the ratings, or `motor`")
        linear = effort_unit(scene, actuator) == "N"
        bearing = own_bearing(catalog, conditions, name, linear)
        candidate = _candidate(catalog, entry.drive, linear, bearing)
        if candidate.transmission is None:
            raise SweepError(f"{entry.drive}: not known: {', '.join(candidate.missing)}")
        transmission = candidate.transmission
        # a gearmotor is rated at its output; the sweep compares at the motor's shaft
        ratings, scale = candidate.ratings, candidate.ratio if candidate.at_output else 1.0
    elif entry.motor is not None:
        assert catalog is not None
        if entry.motor not in catalog.motors:
            raise SweepError(f"the catalogue has no motor {entry.motor!r}; "
                             f"{choose_from(entry.motor, catalog.motors)}")  # fmt: skip
        ratings = _bare_ratings(catalog, entry.motor)
    figures = {
        "continuous_torque": _over(ratings.continuous_torque, scale),
        "peak_torque": _over(ratings.peak_torque, scale),
        "max_speed": _over(ratings.max_speed, 1 / scale),
    }
    given = {k: getattr(entry, k) for k in figures if getattr(entry, k) is not None}
    figures.update(given)
    checks: tuple[str, ...] = ()
    if candidate is not None:
        own = {k: x / scale if k == "max_speed" else x * scale for k, x in given.items()}
        candidate = dataclasses.replace(candidate, ratings=dataclasses.replace(ratings, **own))
        hand = depth(scene, actuator) > BASE_AXES
        checks = _required(candidate, conditions, hand)
        judges[actuator] = Judge(candidate, conditions, hand, checks)
    elif not any(figures.values()):
        raise SweepError(f"{entry.motor}: the catalogue has no figure to check")
    return Trial(name, actuator, entry.drive or entry.motor or "", **figures,
                 ratio=1.0 if transmission is None else transmission.ratio,
                 peak_factor=conditions.peak_factor, checks=checks,
                 mass=None if candidate is None else candidate.mass)  # fmt: skip


def _required(candidate: Candidate, conditions: Conditions, hand: bool) -> tuple[str, ...]:
    """The names of the criteria that are required of a drive, found on one that does nothing."""
    nothing, still = np.zeros(2), np.ones(2, dtype=bool)
    cycle = DriveCycle(
        np.arange(2.0), nothing, nothing, nothing, nothing, nothing, still, still, 0.0
    )
    demand = GearDemand("", "", 0.0, 0.0, 0.0, 0.0, bearing=None, travel=0.0)
    found = check(candidate, None, Case(demand, cycle, None, hand, conditions))
    return tuple(c.name for c in found if c.status != Status.NOT_REQUIRED)


def _over(figure: float | None, scale: float) -> float | None:
    return None if figure is None else figure / scale


def _candidate(
    catalog: Catalog, name: str, linear: bool, bearing: BearingRatings | None
) -> Candidate:
    there = {candidate.name: candidate for candidate in candidates(catalog, linear, bearing)}
    if name not in there:
        raise SweepError(f"the catalogue has no drive {name!r}; {choose_from(name, there)}")
    return there[name]


def _bare_ratings(catalog: Catalog, name: str) -> Ratings:
    """Ratings of a motor alone: the continuous torque may follow from current and constant."""
    motor = catalog.motors[name]
    continuous = motor.continuous_torque
    if continuous is None and motor.continuous_current and motor.torque_constant:
        continuous = motor.torque_constant * motor.continuous_current
    return Ratings(continuous_torque=continuous, peak_torque=motor.peak_torque,
                   max_speed=motor.max_speed)  # fmt: skip
