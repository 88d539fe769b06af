"""One limit of drives: need, maker's value, and the meaning of a missing value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pinfric.study.sizing.bearing import BearingRatings
from pinfric.study.sizing.catalog import Conditions, Gear
from pinfric.study.sizing.criterion import Criterion, Status, compare
from pinfric.study.sizing.demand import DriveCycle, GearDemand, largest
from pinfric.study.sizing.drivetrain import (
    Candidate,
    MotorCycle,
    MotorFigures,
    Ratings,
    line_voltage,
)


class Case(NamedTuple):
    """The data by which a joint's candidates are checked.

    Attributes:
        demand, cycle: of the joint.
        load_inertia: largest inertia about it over the cycle, kg m^2 (kg); None: not known.
        hand: it is one of the hand axes, beyond the third joint.
        conditions: what is demanded.
        beyond: sum of J/K_1 over the joints beyond it whose gears' stiffness is known, s^2.
    """

    demand: GearDemand
    cycle: DriveCycle
    load_inertia: float | None
    hand: bool
    conditions: Conditions
    beyond: float = 0.0


def idle(conditions: Conditions, hand: bool = False) -> Case:
    """Return the case of a joint that does nothing: what its drive must have is seen without."""
    nothing, still = np.zeros(2), np.ones(2, dtype=bool)
    cycle = DriveCycle(
        np.arange(2.0), nothing, nothing, nothing, nothing, nothing, still, still, 0.0
    )
    demand = GearDemand("", "", 0.0, 0.0, 0.0, 0.0, bearing=None, travel=0.0, guide=None)
    return Case(demand, cycle, None, hand, conditions)


class Judged(NamedTuple):
    """A candidate and the data by which it is checked.

    Attributes:
        candidate: motor and gear.
        motor: what the cycle asks of its motor; None where figures for its torque are missing.
        case: its joint.
    """

    candidate: Candidate
    motor: MotorCycle | None
    case: Case

    @property
    def ratings(self) -> Ratings:
        """Of the rated shaft."""
        return self.candidate.ratings

    @property
    def conditions(self) -> Conditions:
        """The conditions."""
        return self.case.conditions

    @property
    def demand(self) -> GearDemand:
        """Of the joint."""
        return self.case.demand

    @property
    def gear(self) -> Gear:
        """The gear's entry; rows of gears are for candidates that have one."""
        assert self.candidate.gear is not None
        return self.candidate.gear

    @property
    def bearing(self) -> BearingRatings:
        """What carries the joint; rows of bearings are for candidates whose ratings are known."""
        assert self.candidate.bearing is not None
        return self.candidate.bearing

    @property
    def guide(self) -> BearingRatings:
        """The guide of a sliding joint; its rows are for candidates whose ratings are known."""
        assert self.candidate.guide is not None
        return self.candidate.guide

    @property
    def figures(self) -> MotorFigures | None:
        """Demand of the cycle on the motor, or None."""
        return None if self.motor is None else self.motor.figures

    @property
    def mean_speed(self) -> float:
        """Of the rated shaft, rad/s; infinite where not known: a curve's last point counts."""
        return np.inf if self.figures is None else self.figures.mean_speed

    @property
    def missing(self) -> str:
        """The figures that the motor's torque lacks, in words."""
        return ", ".join(self.candidate.missing)

    @property
    def output(self) -> str:
        """The rated shaft, in words."""
        return " at its output" if self.candidate.at_output else " at its shaft"


def _line_voltage(d: Judged) -> float | None:
    needed = None if d.motor is None else line_voltage(d.ratings, d.motor)
    return None if needed is None else largest(needed)


def asked(figure: str) -> Callable[[Judged], float | None]:
    """Return the need that is a figure of what the cycle asks of the motor (`MotorFigures`)."""
    return lambda d: None if d.figures is None else getattr(d.figures, figure)


#: What a sample of a motion asks, by name: the same need over a cycle, of `Judged`. The motor's are
#: at the rated shaft.
SIGNALS: dict[str, Callable[[Judged], float | None]] = {
    "motor torque": asked("peak"),
    "motor RMS torque": asked("rms"),
    "motor speed": lambda d: (1.0 if d.candidate.at_output else d.candidate.ratio) * d.demand.speed,
    "voltage": _line_voltage,
    "effort": lambda d: d.demand.peak,
    "input speed": lambda d: d.candidate.ratio * d.demand.speed,
    "speed": lambda d: d.demand.speed,
    "acceleration": lambda d: largest(d.case.cycle.acceleration),
}


#: What must be settled of a drive before it is offered: of the rows that settle the same thing at
#: least one must have been checked, or the drive cannot be judged.
SETTLES = (
    *("heat", "motor's peak", "motor's speed"),
    *("gear's load", "gear's speed", "screw's buckling"),
    # of what the conditions ask for
    *("gear's life", "bearing's life", "gear's backlash", "back-driving"),
)


Figure = Callable[[Judged], float | None]


Text = str | Callable[[Judged], str]


def _always(_: Judged) -> bool:
    return True


def _one(_: Conditions) -> float:
    return 1.0


@dataclass(frozen=True)
class Limit:
    """One limit of drives.

    Attributes:
        name: as reports, sweeps and retiming print it.
        need: what the cycle asks: one of `SIGNALS`, which `retime` bounds at every instant, or a
            function of the whole cycle; None where it is not known.
        gives: figures of the candidate, `ratings.`, `gear.` or `bearing.` before an entry's key, in
            order of preference; or a function; None where it is not known.
        formula, source: of the comparison. unit: of both sides; `torque` and `speed` are the rated
            shaft's, `effort` and `place` the joint's.
        missing: the figure that is missing if one is. note: of this case.
        reserve: factor on the need.
        applies: to which candidates; to others it says nothing.
        endless: what is said where an infinite figure is available; it passes without a number.
        settles: what of the drive it settles, of `SETTLES`.
        key: the key of a motor file that gives it by number; empty: none does.
        optional: it is judged where the conditions ask for it only: where the need is None it is
            not required.
        verdict: in place of the comparison, where there are no two numbers.
    """

    name: str
    need: str | Figure
    gives: tuple[str, ...] | Figure
    unit: str
    formula: Text
    source: Text
    missing: Text = ""
    note: Text = ""
    reserve: Callable[[Conditions], float] = _one
    applies: Callable[[Judged], bool] = _always
    endless: str = ""
    settles: tuple[str, ...] = ()
    key: str = ""
    optional: bool = False
    verdict: Callable[[Judged], Criterion] | None = None

    def required(self, d: Judged) -> float | None:
        """Return the need of the cycle with its reserve; None if it is not known."""
        need = (SIGNALS[self.need] if isinstance(self.need, str) else self.need)(d)
        return None if need is None else self.reserve(d.conditions) * need

    def available(self, d: Judged) -> tuple[float | None, str]:
        """Return what the maker gives, or None, and which figure stands in for the first one."""
        if not isinstance(self.gives, tuple):
            return self.gives(d), ""
        for place, path in enumerate(self.gives):
            part, _, figure = path.partition(".")
            value = getattr(getattr(d, part), figure)
            if value is not None:
                words = figure.replace("_", " ")
                return value, f"the {words}: no higher limit is known" if place else ""
        return None, ""

    def bound(self, d: Judged) -> float:
        """Return the largest need within the limit; infinite if there is none."""
        available = self.available(d)[0] if self.applies(d) else None
        return np.inf if available is None else available / self.reserve(d.conditions)

    def exceeded(self, d: Judged) -> bool:
        """Return whether the need is known to be above what is given: `judge` says it in words."""
        if not self.applies(d) or self.verdict is not None:
            return False
        required, available = self.required(d), self.available(d)[0]
        return required is not None and (np.inf if available is None else available) < required

    def judge(self, d: Judged) -> Criterion:
        """Return the criterion of a candidate."""
        if self.verdict is not None:
            return self.verdict(d)
        found, stand_in = self.available(d)
        texts = (self.formula, self.source, self.missing, self.note)
        formula, source, missing, note = (x if isinstance(x, str) else x(d) for x in texts)
        torque, speed = d.candidate.units
        own = {"torque": torque, "speed": speed, "effort": d.demand.unit}
        own["place"] = "m" if d.candidate.linear else "rad"
        unit = own.get(self.unit, self.unit)
        required = self.required(d)
        if self.optional and required is None:
            status = Status.NOT_REQUIRED
            return Criterion(self.name, status, None, found, unit, None, formula, source, note)
        if self.endless and found is not None and np.isinf(found):
            passes = Status.PASSES
            return Criterion(
                self.name, passes, required, None, unit, 1.0, formula, source, self.endless
            )
        note = "; ".join(text for text in (note, stand_in) if text)
        return compare(self.name, required, found, unit, formula, source, missing, note)


def never(_: Judged) -> bool:
    """Apply to no candidate: `size` has no figure for it."""
    return False


def nothing(_: Judged) -> float | None:
    """Return no figure."""
    return None
