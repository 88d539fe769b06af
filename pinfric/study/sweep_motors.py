"""The motors a sweep puts on trial: ratings from the sweep's file or from a catalogue, by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinfric.errors import SweepError, choose_from
from pinfric.model.drives import Drive
from pinfric.model.scene import Scene
from pinfric.model.schema import Actuator, Transmission
from pinfric.study.catalog import Catalog, load_catalog
from pinfric.study.drivetrain import Candidate, Ratings, candidates
from pinfric.study.summary import effort_unit
from pinfric.study.sweep_cycle import FIGURES
from pinfric.study.sweep_file import MotorOnTrial, SweepFile


@dataclass(frozen=True)
class Trial:
    """A motor's ratings, all at the motor's shaft (of an ideal drive: at the joint).

    Attributes:
        drive: which drive it moves. actuator: its column.
        name: in the catalogue; empty where the sweep's file gives the ratings.
        continuous_torque, peak_torque: N m (N); None is not checked.
        max_speed: rad/s (m/s), or None.
        ratio: motor turns per joint turn, 1 for an ideal drive.
    """

    drive: str
    actuator: int
    name: str
    continuous_torque: float | None
    peak_torque: float | None
    max_speed: float | None
    ratio: float

    @property
    def not_checked(self) -> tuple[str, ...]:
        """The criteria for which there is no rating."""
        ratings = {"continuous": self.continuous_torque, "peak": self.peak_torque,
                   "speed": self.max_speed}  # fmt: skip
        return tuple(name for name, rating in ratings.items() if rating is None)

    def passes(self, figures: np.ndarray) -> dict[str, np.ndarray]:
        """Return for each criterion with a rating which samples meet it, (n,); NaN does not.

        max |T_m| <= peak_torque, RMS(T_m) <= continuous_torque, |ratio| max |v| <= max_speed.

        Args:
            figures: (n, na, number of `FIGURES`).
        """
        of = {name: figures[:, self.actuator, i] for i, name in enumerate(FIGURES)}
        met = {}
        if self.continuous_torque is not None:
            met["continuous"] = of["motor_rms"] <= self.continuous_torque
        if self.peak_torque is not None:
            met["peak"] = of["motor_peak"] <= self.peak_torque
        if self.max_speed is not None:
            met["speed"] = abs(self.ratio) * of["speed"] <= self.max_speed
        return met


def motors_on_trial(scene: Scene, sweep: SweepFile, source: str) -> tuple[Scene, tuple[Trial, ...]]:
    """Return the scene with the transmissions of the named drives, and the ratings to check.

    Raises:
        SweepError: a drive or a name that is not there, figures that are missing; all at once.
        CatalogError: the catalogue cannot be read.
    """
    named = any(entry.motor or entry.drive for entry in sweep.motors.values())
    catalog = load_catalog(sweep.catalog) if named else None
    problems, trials = [], []
    gears: dict[str, Transmission] = {}
    for name, entry in sweep.motors.items():
        try:
            trials.append(_trial(scene, catalog, name, entry, gears))
        except SweepError as problem:
            problems.append(f"`motors.{name}`: {problem}")
    if problems:
        raise SweepError(f"{source}: " + "; ".join(problems))
    return (_with_gears(scene, gears) if gears else scene), tuple(trials)


def _trial(
    scene: Scene,
    catalog: Catalog | None,
    name: str,
    entry: MotorOnTrial,
    gears: dict[str, Transmission],
) -> Trial:
    if name not in scene.actuator_names:
        raise SweepError(f"there is no such drive; {choose_from(name, scene.actuator_names)}")
    actuator = scene.actuator_names.index(name)
    drive = scene.drives[actuator]
    transmission = drive.transmission if isinstance(drive, Drive) else None
    ratings, scale = Ratings(), 1.0
    if entry.drive is not None:
        assert catalog is not None
        if not isinstance(drive, Drive) or not scene.model.existJointName(name):
            raise SweepError("takes no motor with a gear; give the ratings, or `motor`")
        candidate = _candidate(catalog, entry.drive, effort_unit(scene, actuator) == "N")
        if candidate.transmission is None:
            raise SweepError(f"{entry.drive}: not known: {', '.join(candidate.missing)}")
        transmission = gears[name] = candidate.transmission
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
    figures.update({k: getattr(entry, k) for k in figures if getattr(entry, k) is not None})
    if not any(figures.values()):
        raise SweepError(f"{entry.drive or entry.motor}: the catalogue has no figure to check")
    return Trial(name, actuator, entry.drive or entry.motor or "", **figures,
                 ratio=1.0 if transmission is None else transmission.ratio)  # fmt: skip


def _over(figure: float | None, scale: float) -> float | None:
    return None if figure is None else figure / scale


def _candidate(catalog: Catalog, name: str, linear: bool) -> Candidate:
    there = {candidate.name: candidate for candidate in candidates(catalog, linear)}
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


def _with_gears(scene: Scene, gears: Mapping[str, Transmission]) -> Scene:
    given = scene.actuators
    if given is None:
        given = [_actuator(drive.name, None) for drive in scene.drives]
    changed = [_actuator(a.joint, gears[a.joint]) if a.joint and a.joint in gears else a
               for a in given]  # fmt: skip
    return dataclasses.replace(scene, actuators=changed)


def _actuator(joint: str | None, transmission: Transmission | None) -> Actuator:
    values: dict[str, Any] = {"joint": joint, "transmission": transmission, "cylinder": None,
                              "force": None}  # fmt: skip
    return Actuator.model_construct(**values)
