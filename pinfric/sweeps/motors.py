"""The drives of a catalogue that a sweep puts on trial by the criteria of `size`."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinfric.drives.catalog import Catalog
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status, least_margin
from pinfric.drives.cycles import judge_cycles, reads_samples
from pinfric.drives.demand import GearDemand
from pinfric.drives.drivetrain import Candidate
from pinfric.drives.installed import actuator_of, installed_drive
from pinfric.drives.limit import idle, number
from pinfric.drives.limits import check
from pinfric.drives.parts import check_names, criteria_over, named_drive
from pinfric.drives.policy import BASE_AXES, Conditions, parse_conditions
from pinfric.drives.reading import read_drive
from pinfric.drives.robot import depth, equip
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import CatalogError, SizingError, SweepError, choose_from, problems_line
from pinfric.model.drives import Drive
from pinfric.model.scene import Scene
from pinfric.sweeps.file import SweepFile

#: What a sample says of a criterion.
FAILS, MET, NOT_CHECKED = 0, 1, -1
_CODES = {Status.FAILS: FAILS, Status.NOT_CHECKED: NOT_CHECKED}


@dataclass(frozen=True)
class Trial:
    """A drive of the catalogue on trial.

    Attributes:
        drive: the drive it replaces. actuator: its column.
        candidate: motor and gear, as rated. conditions: what is demanded.
        continuous_torque, peak_torque: at the motor's shaft, N m, the first at the ambient
            temperature of the conditions; None: unknown.
        checks: the criteria of `size` to meet.
        unit: of its efforts. hand: it is one of the hand axes.
        by_figures: no criterion reads samples of a cycle.
    """

    drive: str
    actuator: int
    candidate: Candidate
    conditions: Conditions
    continuous_torque: float | None
    peak_torque: float | None
    checks: tuple[str, ...]
    unit: str
    hand: bool
    by_figures: bool

    def verdicts(
        self, demands: np.ndarray, asked: np.ndarray, inertia: np.ndarray, travel: float | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return `verdict` of n cycles, (n,) and (n, number of `checks`), if `by_figures`.

        Args:
            demands, asked: (n, ...) of `superposition_kernels.write_figures`. inertia: (n,).
            travel: of a sliding joint over the cycle, m; None: it turns.
        """
        peak, _, *torque, speed = demands.T
        demand = GearDemand(self.drive, self.unit, peak, speed, 0.0, 0.0, None, travel, None)
        known: Any = None if np.isnan(inertia).any() else inertia
        case = idle(self.conditions)._replace(demand=demand, hand=self.hand, load_inertia=known)
        least, margins = judge_cycles(self.candidate, case, np.array(torque), asked)
        checked = np.array([margins[name] for name in self.checks]).T.reshape(len(least), -1)
        return least, np.where(np.isnan(checked), NOT_CHECKED, np.where(checked < 0, FAILS, MET))

    def verdict(
        self, result: InverseResult, holding: np.ndarray, inertias: np.ndarray | None
    ) -> tuple[float, list[int]]:
        """Return the least margin over one cycle, and MET, FAILS or NOT_CHECKED of `checks`.

        NaN and NOT_CHECKED if an instant has no solution.

        Args:
            holding: (T,) the samples of the holds.
            inertias: (na,) largest about each joint over the cycle, kg m^2 (kg); None: unknown.
        """
        i, candidate = self.actuator, self.candidate
        if not np.isfinite(result.effort_lower[:, i] + result.effort_upper[:, i]).all():
            return np.nan, [NOT_CHECKED] * len(self.checks)
        drive = result.scene.drives[i]
        assert isinstance(drive, Drive)
        if drive.transmission != candidate.transmission:  # the sample's losses
            candidate = dataclasses.replace(candidate, transmission=drive.transmission)
        inertia = None if inertias is None or np.isnan(inertias[i]) else float(inertias[i])
        criteria = criteria_over(result, i, candidate, self.conditions, holding, inertia)
        codes = {c.name: _CODES.get(c.status, MET) for c in criteria}
        return least_margin(criteria), [codes[name] for name in self.checks]


def motors_on_trial(scene: Scene, sweep: SweepFile, source: str) -> tuple[Scene, tuple[Trial, ...]]:
    """Return the scene with the named drives and their masses, and these drives.

    Raises:
        SweepError: unknown drives or names, missing figures; all in one message.
        CatalogError: the catalogue cannot be read.
    """
    catalog = load_catalog(sweep.catalog) if sweep.motors else None
    conditions = Conditions() if catalog is None else catalog.conditions
    problems, trials = [], []
    try:
        conditions = parse_conditions(sweep.conditions, conditions)
        check_names(scene, conditions, catalog)
    except CatalogError as problem:
        problems.append(str(problem))
    for name, entry in sweep.motors.items():
        try:
            assert catalog is not None
            trials.append(_trial(scene, catalog, conditions, name, entry.drive))
        except (SweepError, CatalogError) as problem:
            problems.append(f"`motors.{name}`: {problem}")
    if problems:
        raise SweepError(problems_line(source, problems))
    try:
        judged = {trial.actuator: trial.candidate for trial in trials}
        return (equip(scene, judged, conditions) if judged else scene), tuple(trials)
    except SizingError as problem:
        raise SweepError(f"{source}: {problem}") from None


def _trial(scene: Scene, catalog: Catalog, conditions: Conditions, joint: str, name: str) -> Trial:
    if joint not in scene.actuator_names:
        raise SweepError(f"there is no such drive; {choose_from(joint, scene.actuator_names)}")
    actuator = scene.actuator_names.index(joint)
    if not isinstance(scene.drives[actuator], Drive) or not depth(scene, actuator):
        raise SweepError("cannot have a motor with a gear")
    candidate = named_drive(scene, actuator, name, catalog, conditions)
    product = actuator_of(scene, actuator).installed
    if product is not None and product.drive == candidate.name:  # on trial is what is there
        candidate = installed_drive(scene, actuator, candidate, catalog.brakes)
    if candidate.transmission is None:
        raise SweepError(f"{name}: not known: {', '.join(candidate.missing)}")
    hand = depth(scene, actuator) > BASE_AXES
    judged = read_drive(candidate, None, idle(conditions, hand))
    # a gearmotor is rated at its output; the sweep compares at the motor's shaft
    scale = candidate.ratio if candidate.at_output else 1.0
    torques = [float(x) / scale for x in (judged.heat, number(candidate.ratings.peak_torque))]
    continuous, peak = (None if np.isnan(x) else x for x in torques)
    # what is required is found on a drive that does nothing
    assessment = check(candidate, None, judged.case)
    checks = tuple(c.name for c in assessment if c.status != Status.NOT_REQUIRED)
    return Trial(
        joint,
        actuator,
        candidate,
        conditions,
        continuous,
        peak,
        checks,
        scene.drives[actuator].unit,
        hand,
        not reads_samples(candidate, conditions, hand),
    )
