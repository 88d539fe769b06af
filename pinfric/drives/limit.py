"""One limit of drives: what a cycle needs, what the maker gives, and where both come from.

A row holds for numbers and for arrays: of one drive it is a criterion of the report, or one over
each cycle of a sweep; over gears (rows) and motors (columns) of a catalogue, where needs are lower
bounds, it leaves out what cannot fit; rows whose need is one of `SIGNALS` bound every instant of a
retimed motion.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from pinfric.drives.bearing import BearingRatings
from pinfric.drives.criterion import Criterion, Status, compare
from pinfric.drives.demand import DriveCycle, GearDemand, largest
from pinfric.drives.policy import STAND_IN_WORDS, STAND_INS, Conditions, stated
from pinfric.drives.rest import RestDemand
from pinfric.drives.way import Way
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.model.springs import softest
from pinfric.motions.summary import ends_by_magnitude, rests

#: A number, or an array over gears and motors; NaN: not known.
Value = Any
#: A `drivetrain.Candidate`, its `Ratings`, the entry of its gear, and a class of `Kind`: above this
#: module, since a catalogue's entries come with rows of their own (`kinds`).
Drive = Any
DriveRatings = Any
GearEntry = Any
DriveKind = Any

#: Figures of gears and of motors (`Ratings`) that rows read.
GEAR_FIGURES = (
    *("average_torque", "repeated_peak_torque", "momentary_peak_torque", "momentary_peaks"),
    *("max_input_speed", "average_input_speed", "rated_speed", "rated_torque", "nominal_life"),
    *("stiffness", "backlash", "stroke"),
    *("rollers", "repeated_by_rating", "momentary_by_rating"),
)
MOTOR_FIGURES = (
    *("peak_torque", "stall_torque", "torque_constant", "resistance", "nominal_voltage"),
    *("no_load_speed", "rated_speed", "max_speed", "max_voltage", "peak_by_stall"),
)


class JointCase(NamedTuple):
    """The data by which a joint's candidates are checked.

    Attributes:
        load_inertia: largest inertia about it over the cycle, kg m^2 (kg); None: not known.
        hand: it is one of the hand axes, beyond the third joint.
        conditions: what is demanded. rest: what it asks of a brake; None: not known.
        swung: load inertia for rows on frequencies, without a rating's postures, of which makers'
            rules say nothing. 0: of none; None: the load inertia.
        stop_effort: that the gear must bear in stops of all joints together, N m or N; NaN: it is
            not known. stop_note: its source, in words.
        braking: braking under power from each sample, without payload and with.
        way: what a cylinder must cover; None: not known.
    """

    demand: GearDemand
    cycle: DriveCycle
    load_inertia: float | None
    hand: bool
    conditions: Conditions
    rest: RestDemand | None = None
    swung: float | None = None
    stop_effort: float = np.nan
    stop_note: str = ""
    braking: tuple[DriveCycle, ...] = ()
    way: Way | None = None


def idle(conditions: Conditions, hand: bool = False) -> JointCase:
    """Return the case of a joint that does nothing."""
    nothing, still = np.zeros(2), np.ones(2, dtype=bool)
    cycle = DriveCycle(
        np.arange(2.0), nothing, nothing, nothing, nothing, nothing, still, still, 0.0
    )
    demand = GearDemand("", "", 0.0, 0.0, 0.0, 0.0, bearing=None, travel=0.0, guide=None)
    return JointCase(demand, cycle, None, hand, conditions)


def number(value: Any) -> Any:
    """Return a figure, NaN where it is not known; or the figures of several."""
    return np.nan if value is None else value if isinstance(value, np.ndarray) else float(value)


class Figures(SimpleNamespace):
    """Figures by name: a number each of one entry, an array each of several; NaN: not known."""

    def each(self, change: Callable[[Value], Value]) -> Figures:
        """Return all of them changed alike."""
        return Figures(**{name: change(value) for name, value in vars(self).items()})


def columns(entries: Iterable[Any], figures: Iterable[str]) -> Figures:
    """Return the figures of entries, each an array."""
    there = list(entries)

    def column(name: str) -> np.ndarray:
        if name == "stiffness":
            return np.array([figure_of(entry, name) for entry in there])
        return np.array([getattr(entry, name, None) for entry in there], dtype=float)

    return Figures(**{name: column(name) for name in figures})


def figure_of(entry: Any, name: str) -> float:
    """Return a figure of an entry, NaN where it is not known; of a curve of stiffness its least."""
    value = getattr(entry, name, None)
    return softest(value) if name == "stiffness" and value is not None else number(value)


def first_known(side: Figures, figures: Iterable[str]) -> Value:
    """Return the first of these figures that is known."""
    value: Value = np.nan
    for name in figures:
        value = np.where(np.isnan(value), getattr(side, name), value)
    return value


@dataclass
class Candidates:
    """One drive at a joint, or gears (rows) and motors (columns) of many: what rows read.

    Attributes:
        gear, motor: figures. ratio: motor turns per joint turn.
        inertia: of rotor, brake and gear input, kg m^2.
        heat: continuous torque at the rated shaft and the ambient temperature, N m.
        at_output: motors are rated at the joint. linear: the joint slides.
        case: the joint. asked: of the motor (`MotorFigures`). one: the drive, where it is one.
        share: part of the bus voltage that the motor gets; of arrays the greatest.
        kind: of all of them (`kinds.kind.Kind`); None: motors.
    """

    gear: Figures
    motor: Figures
    ratio: Value
    inertia: Value
    heat: Value
    at_output: bool
    linear: bool
    case: JointCase
    asked: Figures = field(default_factory=Figures)
    one: Drive | None = None
    share: float = 1.0
    kind: DriveKind | None = None

    def of_gears(self, rows: np.ndarray) -> Candidates:
        """Return those with some of the gears."""

        def some(values: np.ndarray) -> np.ndarray:
            return values if len(values) == 1 else values[rows]

        arrays: dict[str, Any] = {x: some(getattr(self, x)) for x in ("ratio", "inertia", "heat")}
        return replace(self, gear=self.gear.each(some), motor=self.motor.each(some), **arrays)

    @property
    def replaced(self) -> Collection[str]:
        """Rows in whose place those of their kind stand."""
        return () if self.kind is None else self.kind.REPLACED

    @property
    def conditions(self) -> Conditions:
        """The conditions."""
        return self.case.conditions

    @property
    def demand(self) -> GearDemand:
        """Of the joint."""
        return self.case.demand

    @property
    def voltage(self) -> float:
        """Highest at the motor's terminals, V."""
        return self.share * self.case.conditions.bus_voltage

    @property
    def candidate(self) -> Drive:
        """The drive; rows that read it are not asked of arrays."""
        assert self.one is not None
        return self.one

    @property
    def entry(self) -> GearEntry:
        """The gear's entry, for rows of drives that have a gear."""
        assert self.candidate.gear is not None
        return self.candidate.gear

    @property
    def bearing(self) -> BearingRatings:
        """What carries the joint, for rows of drives whose ratings of it are known."""
        assert self.candidate.bearing is not None
        return self.candidate.bearing

    @property
    def guide(self) -> BearingRatings:
        """The guide of a sliding joint, for rows of drives whose ratings of it are known."""
        assert self.candidate.guide is not None
        return self.candidate.guide

    @property
    def ratings(self) -> DriveRatings:
        """Of the rated shaft."""
        return self.candidate.ratings

    @property
    def load(self) -> float:
        """Inertia about the joint; NaN: not known."""
        return number(self.case.load_inertia)

    @property
    def missing(self) -> str:
        """The figures that the motor's torque lacks, in words."""
        return ", ".join(self.candidate.missing)

    @property
    def output(self) -> str:
        """The rated shaft, in words."""
        return " at its output" if self.at_output else " at its shaft"


#: What a sample of a motion asks, by name: the same need over a cycle. The motor's are at the rated
#: shaft.
SIGNALS: dict[str, Callable[[Candidates], Value]] = {
    "motor torque": lambda d: d.asked.peak,
    "motor RMS torque": lambda d: d.asked.rms,
    "motor speed": lambda d: (1.0 if d.at_output else d.ratio) * d.demand.speed,
    "voltage": lambda d: d.asked.voltage,
    "effort": lambda d: d.demand.peak,
    "input speed": lambda d: d.ratio * d.demand.speed,
    "speed": lambda d: d.demand.speed,
    "acceleration": lambda d: largest(d.case.cycle.acceleration),
}


def signals(
    result: InverseResult, line: np.ndarray | float = 0.0, needed: bool = False
) -> dict[str, np.ndarray]:
    """Return what each sample of a motion asks of each drive, (T, na), by the names of `SIGNALS`.

    Magnitudes, the worst of the interval; torque and speed at the motor's shaft.

    Args:
        line: (na,) stall torque/no-load speed, N m s/rad: `voltage` is |T_m + line omega|, to be
            held against the stall torque.
        needed: of a drive at rest only the least effort of its interval counts: it can hold.
    """
    torque = [result.motor_torque_lower, result.motor_torque_upper]
    effort = [result.effort_lower, result.effort_upper]
    v, drives = result.actuator_velocity, result.scene.drives
    if needed:
        still = np.stack([rests(result, d) for d in range(len(drives))], axis=1)
        for pair in (torque, effort):
            nearer = ends_by_magnitude(*pair)[1]
            pair[:] = [np.where(still, nearer, end) for end in pair]
    omega = v * [drive.ratio for drive in drives]
    return {
        "motor torque": np.maximum(*map(np.abs, torque)),
        "voltage": np.maximum(*(np.abs(end + omega * line) for end in torque)),
        "motor speed": np.abs(omega),
        "input speed": np.abs(omega),
        "effort": np.maximum(*map(np.abs, effort)),
        "speed": np.abs(v),
        "acceleration": np.abs(result.actuator_acceleration),
    }


Figure = Callable[[Candidates], Value]
Text = str | Callable[[Candidates], str]
#: Names of conditions, or what returns them.
Keys = tuple[str, ...] | Callable[[Candidates], tuple[str, ...]]


def _always(_: Candidates) -> bool:
    return True


@dataclass(frozen=True)
class Limit:
    """One limit of drives.

    Attributes:
        name: as reports, sweeps and retiming print it.
        need: one of `SIGNALS`, which `retime` bounds at every instant, or a function of the whole
            cycle; NaN where it is not known.
        gives: a figure of the drive, `gear.NAME` or `motor.NAME`, or one of its
            `policy.STAND_INS`; or a function; NaN where it is not known.
        unit: of both sides; `torque` and `speed` are the rated shaft's, `effort` and `place` the
            joint's.
        formula, source: of the comparison.
        missing: the figure that is missing if one is. note: of this case.
        stage: "gear": for arrays of gears; "pair": of gears and motors; "entry": for one gear;
            "drive": for one drive.
        reserve: a factor on the need, or the condition that is it.
        condition: the conditions that set one side; a criterion that fails names them.
        applies: to which drives; others have no such criterion.
        endless: what is said where an infinite figure is available; it passes without a number.
        key: of a motor file that gives it by number; empty: none does.
        optional: where the need is NaN it is not required.
        verdict: in place of the comparison, where there are no two numbers.
    """

    name: str
    need: str | Figure
    gives: str | Figure
    unit: str
    formula: Text
    source: Text
    missing: Text = ""
    note: Text = ""
    stage: str = "drive"
    reserve: str | float = 1.0
    condition: Keys = ()
    applies: Callable[[Candidates], Value] = _always
    endless: str = ""
    key: str = ""
    optional: bool = False
    verdict: Callable[[Candidates], Criterion] | None = None

    def concerns(self, d: Candidates) -> Value:
        """Return to which drives it applies: not where rows of their kind stand in its place."""
        return self.name not in d.replaced and self.applies(d)

    def factor(self, conditions: Conditions) -> float:
        """Return the reserve."""
        return getattr(conditions, self.reserve) if isinstance(self.reserve, str) else self.reserve

    def required(self, d: Candidates) -> Value:
        """Return the need of the cycle with its reserve."""
        need = SIGNALS[self.need] if isinstance(self.need, str) else self.need
        return self.factor(d.conditions) * need(d)

    def available(self, d: Candidates) -> Value:
        """Return what the maker gives."""
        if not isinstance(self.gives, str):
            return self.gives(d)
        side, _, figure = self.gives.partition(".")
        return first_known(getattr(d, side), STAND_INS.get(figure, (figure,)))

    def bound(self, d: Candidates) -> float:
        """Return the largest need within the limit; infinite if there is none."""
        available = float(self.available(d)) if self.concerns(d) else np.nan
        return np.inf if np.isnan(available) else available / self.factor(d.conditions)

    def margin(self, d: Candidates) -> Value:
        """Return 1 - need/have, no less than -1e9; NaN where one is not known."""
        if (applies := self.concerns(d)) is False:
            return np.nan
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            have, need = np.asarray(self.available(d)), np.asarray(self.required(d))
            if applies is True and (have > 0).all():  # of most: a third of the passes
                return np.maximum(1 - need / have, -1e9)
            margin = np.where(have > 0, 1 - need / have, np.where(need > 0, -np.inf, 0.0))
            known = ~np.isnan(need) & (~np.isnan(have) | (need == np.inf)) & applies
            margin = np.where(known, np.where(np.isnan(have), -np.inf, margin), np.nan)
        return np.maximum(margin, -1e9)

    def _stand_in(self, d: Candidates) -> str:
        if not isinstance(self.gives, str):
            return ""
        side, _, figure = self.gives.partition(".")
        for name in STAND_INS.get(figure, (figure,)):
            if not np.isnan(getattr(getattr(d, side), name)):
                words = name.replace("_", " ")
                said = STAND_IN_WORDS.get(name, f"the {words}: no higher limit is known")
                return "" if name == figure else said
        return ""

    def judge(self, d: Candidates) -> Criterion:
        """Return the criterion of one drive."""
        if self.verdict is not None:
            return self.verdict(d)
        required, available = (
            None if np.isnan(x) else x for x in map(float, (self.required(d), self.available(d)))
        )
        texts = (self.formula, self.source, self.missing, self.note)
        formula, source, missing, note = (x if isinstance(x, str) else x(d) for x in texts)
        torque, speed = d.candidate.units
        own = {"torque": torque, "speed": speed, "effort": d.demand.unit}
        own["place"] = "m" if d.linear else "rad"
        unit = own.get(self.unit, self.unit)
        keys = self.condition(d) if callable(self.condition) else self.condition
        reserve = [self.reserve] if isinstance(self.reserve, str) else []
        said, margin, status = stated(d.conditions, *reserve, *keys), None, None
        if self.optional and required is None:
            status = Status.NOT_REQUIRED
        elif self.endless and available == np.inf:
            available, margin, status, note = None, 1.0, Status.PASSES, self.endless
        if status is not None:
            figures = required, available, unit, margin
            return Criterion(self.name, status, *figures, formula, source, note, said)
        note = "; ".join(text for text in (note, self._stand_in(d)) if text)
        return compare(self.name, required, available, unit, formula, source, missing, note, said)


def never(_: Candidates) -> bool:
    """Apply to no drive: `size` has no figure for it."""
    return False


def nothing(_: Candidates) -> float:
    """Return no figure."""
    return np.nan
