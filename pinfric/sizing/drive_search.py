"""Motors and gears of a catalogue as arrays, and what of them may fit a joint.

Gears are left out by their own figures first. The others get a loss model without a rotor: torques
at the input between m - h and m + h. A rotor of inertia J adds J a, so that over the cycle

    worst torque = |m + J a| + h,
    RMS^2 >= <m^2> + 2 J <m a> + J^2 <a^2> + <h^2> + 2 |<h m> + J <h a>|:

six numbers of a gear for all motors; a few samples bound the peak. Drives that pass these lower
bounds are judged exactly, from the lightest on.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from pinfric.drives.brake import Stop, braking_torques, smallest_brake
from pinfric.drives.catalog import Brake, Catalog, Gear, GearMotor, Motor
from pinfric.drives.criterion import STEPS, Criterion, Status
from pinfric.drives.demand import largest, mean
from pinfric.drives.drivetrain import (
    Candidate,
    MotorFigures,
    Ratings,
    gearmotor_drive,
    input_torques,
    motor_cycle,
    motor_with_gear,
    ratings_of,
    voltage_share,
    with_brake,
)
from pinfric.drives.kinds.kind import Kind
from pinfric.drives.limit import (
    GEAR_FIGURES,
    MOTOR_FIGURES,
    Candidates,
    Figures,
    JointCase,
    Limit,
    columns,
    first_known,
    idle,
    number,
)
from pinfric.drives.limits import LIMITS, criteria
from pinfric.drives.policy import (
    BEARING,
    KIT,
    STAND_INS,
    Conditions,
    kind_of,
    lacks,
    outside,
    product_of,
)
from pinfric.drives.reading import read_drive
from pinfric.drives.thermal import COPPER
from pinfric.model.transmission import driven_efficiency

#: Numbers of an array over gears and motors at a time: of more, memory is slower than arithmetic.
_MOST = 100_000
#: So many gears at a time at most, where a search may end before their last.
_TOGETHER = 32
#: A catalogue of no more drives is shown in full.
_FEW = 12
#: Drives that are judged in full to find the one that misses by least.
_TRIED = 40


@dataclass(frozen=True)
class Assessment:
    """One drive at one joint with all its criteria.

    Attributes:
        drives: as rows read it, without samples.
        lacks: figures of the policy that are not known: it cannot be signed.
        would: of a provisional drive, what these must be; else empty.
        beside: the same drive in the joint's other cases, in which it has more in reserve.
    """

    drives: Candidates
    lacks: tuple[str, ...] = ()
    would: tuple[str, ...] = ()
    beside: tuple[Assessment, ...] = field(default=(), repr=False)

    def where(self, **case: Any) -> Assessment:
        """Return the same drive with other fields of its joint's case."""
        known = self.drives.case._replace(**case)
        return replace(self, drives=replace(self.drives, case=known))

    @cached_property
    def criteria(self) -> tuple[Criterion, ...]:
        """In the order of the table, in words; of several cases the worst of each row."""
        own = criteria(self.drives)
        if not self.beside:
            return own
        found: dict[str, list[Criterion]] = {limit.name: [] for limit in LIMITS}
        for row in (*own, *(row for other in self.beside for row in criteria(other.drives))):
            found.setdefault(row.name, []).append(row)
        return tuple(min(rows, key=_hardness) for rows in found.values() if rows)

    @cached_property
    def _margins(self) -> list[tuple[Limit, float]]:
        """Every row with its margin; NaN: not known, or not asked for."""
        asked = (x for x in LIMITS if x.verdict is not None or x.concerns(self.drives))
        return [(limit, _margin(limit, self.drives)) for limit in asked]

    def falls_short(self, allowed: Collection[str] = ()) -> bool:
        """Return whether it has failed rows but those `allowed`, in any case; without words."""
        return any(
            _margin(limit, judged.drives) < 0
            for judged in (self, *self.beside)
            for limit in LIMITS
            if limit.name not in allowed
        )

    @property
    def candidate(self) -> Candidate:
        """Motor and gear."""
        return self.drives.candidate

    @property
    def name(self) -> str:
        """Of motor and gear."""
        return self.candidate.name

    @property
    def mass(self) -> float | None:
        """In kg; None: not known."""
        return self.candidate.mass

    @property
    def kind(self) -> str:
        """Of its gear; of a gearmotor empty."""
        return self.candidate.gear.kind if self.candidate.gear is not None else ""

    @property
    def motor(self) -> MotorFigures | None:
        """Demand on the motor; None where figures are missing."""
        return self.drives.asked.figures

    @cached_property
    def failed(self) -> tuple[Criterion, ...]:
        """The criteria it fails, the worst first."""
        failed = [c for c in self.criteria if c.fails]
        return tuple(sorted(failed, key=lambda c: c.margin if c.margin is not None else 0.0))

    @cached_property
    def not_checked(self) -> tuple[Criterion, ...]:
        """The criteria that lack a figure."""
        return tuple(c for c in self.criteria if c.unchecked)

    @cached_property
    def fits(self) -> bool:
        """Whether it fails no criterion, and no necessary figure is missing."""
        known = not self.lacks and not self.unknown
        return known and not any(margin < 0 for _, margin in self._margins)

    @cached_property
    def unknown(self) -> tuple[str, ...]:
        """Missing figures that a condition asks for."""
        conditions = self.drives.conditions
        wanted = {"backlash", "continuous torque"}
        wanted |= (
            {"gear life L10", "bearing life L10", "screw life L10"} if conditions.life else set()
        )
        wanted |= {"back-driving"} if conditions.back_driving != "any" else set()
        names = {limit.name for limit, margin in self._margins if np.isnan(margin)} & wanted
        lacking = (c for c in self.criteria if c.name in names) if names else ()
        return tuple(c.lacks for c in lacking if c.unchecked)

    @cached_property
    def margin(self) -> float:
        """The least margin of what was checked and has a scale (`Criterion.scaled`)."""
        scaled = (
            margin
            for limit, margin in self._margins
            if not np.isnan(margin)
            and limit.name != "back-driving"
            and (limit.name not in STEPS or margin < 0)
        )
        return min(scaled, default=0.0)

    @property
    def why(self) -> str:
        """Why it is rejected; empty if it fits."""
        ask = [f"cannot be signed: ask for {', '.join((*self.lacks, *self.unknown))}"]
        return "; ".join([c.why for c in self.failed] or ask * (not self.fits))


def _margin(limit: Limit, d: Candidates) -> float:
    """The margin of a row; NaN: not known, or not asked for."""
    if limit.verdict is not None:
        return -1.0 if limit.verdict(d).fails else np.nan
    return float(limit.margin(d))


def _hardness(criterion: Criterion) -> tuple[int, float]:
    """Order of one row in several cases: what fails, the least reserve, what is not known."""
    order = (Status.FAILS, Status.PASSES, Status.NOT_CHECKED, Status.NOT_REQUIRED)
    margin = np.inf if criterion.margin is None else criterion.margin
    return order.index(criterion.status), margin


def _worst(judged: Sequence[Assessment]) -> Assessment:
    """The case in which a drive fits worst, the others beside it."""
    if len(judged) == 1:
        return judged[0]
    worst = min(judged, key=lambda a: (a.fits, a.margin))
    others = tuple(a for a in judged if a is not worst)
    return replace(worst, beside=others) if others else worst


def rank(assessment: Assessment) -> tuple[float, bool, float, str]:
    """Order by mass, printed before computed torques, then margin, then name."""
    computed = assessment.candidate.ratings.by_rule != ""
    return assessment.mass or 0.0, computed, -round(assessment.margin, 9), assessment.name


@dataclass(frozen=True)
class Ask:
    """A product that cannot be signed, and the figures to ask its maker for.

    `source`: of its other figures. `kind`: of a gear.
    """

    name: str
    figures: tuple[str, ...]
    mass: float | None
    source: str
    kind: str = ""


@dataclass
class _Group:
    """Gears (rows) with motors (columns), or gearmotors (rows) alone.

    Attributes:
        drives: as rows read them, without a joint; arrays have one row, or one for each gear.
        mass, fits: (ng, nm) kg; whether the two go together.
        names, entries, gear_lacks: of gears or gearmotors, and the figures that they lack.
        motor_names, motors, motor_lacks: the same of motors.
        make: drive of a gear and a motor by their numbers. bare: of a gear, without a motor.
        brake_group: (nm,) motors of one number go with the same `brakes` (`brakes_for`).
    """

    drives: Candidates
    mass: np.ndarray
    fits: np.ndarray
    names: list[str]
    gear_lacks: list[tuple[str, ...]]
    entries: list[Gear] | list[GearMotor]
    make: Callable[[int, int], Candidate]
    bare: Callable[[int], Candidate]
    motor_names: Sequence[str] = ("",)
    motor_lacks: Sequence[tuple[str, ...]] = ((),)
    motors: Sequence[Motor] = ()
    brake_group: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    brakes: list[dict[str, Brake]] = field(default_factory=list)

    @property
    def at_output(self) -> bool:
        return self.drives.at_output

    @cached_property
    def signable(self) -> np.ndarray:
        return np.array([not lacking for lacking in self.motor_lacks])

    @cached_property
    def by_lacks(self) -> dict[frozenset[str], np.ndarray]:
        """The motors' columns by the figures that they lack."""
        columns = dict[frozenset[str], list[int]]()
        for m, lacking in enumerate(self.motor_lacks):
            columns.setdefault(frozenset(lacking), []).append(m)
        return {lacking: np.array(own) for lacking, own in columns.items()}

    @cached_property
    def lightest(self) -> np.ndarray:
        """(ng,) kg of the lightest drive of each gear that can be signed; a brake only adds."""
        mass = np.where(self.fits & self.signable & np.isfinite(self.mass), self.mass, np.inf)
        return mass.min(axis=1)

    @cached_property
    def special(self) -> dict[type[Kind], dict[int, Kind]]:
        """Of each kind with rows of its own its motors' columns and figures."""
        kinds = dict[type[Kind], dict[int, Kind]]()
        for m, motor in enumerate(self.motors):
            if (own := motor.special) is not None:
                kinds.setdefault(type(own), {})[m] = own
        return kinds

    @cached_property
    def by_name(self) -> np.ndarray:
        """(nm,) rank of each motor by name and blank, as it begins the name of a drive."""
        return np.argsort(np.argsort(np.array([f"{name} " for name in self.motor_names])))

    def named(self, name: str) -> np.ndarray:
        """(ng, nm) whether a drive goes together and has a name."""
        named = np.zeros_like(self.fits)
        for g, m in np.argwhere(self.fits):
            begins = self.names[g] in name and name.startswith(self.motor_names[m])
            named[g, m] = begins and self.make(int(g), int(m)).name == name
        return named

    def braked(
        self, gears: np.ndarray, options: Sequence[Sequence[Sequence[Brake | None]]]
    ) -> Iterator[tuple[np.ndarray, ...]]:
        """Yield greatest inertia and mass (n, nm) of each brake on trial, 0 where there is none.

        Args:
            gears: (n,) rows. options: of each gear and brake group, as of `_GearAtJoint`.
        """
        brake_group = self.brake_group[gears][:, None] if self.at_output else self.brake_group
        for k in range(max(len(own) for row in options for own in row)):
            held = [[own[min(k, len(own) - 1)] for own in row] for row in options]
            figures = np.array(
                [
                    [(b.inertia_ends[1], b.mass_taken) if b else (0.0, 0.0) for b in row]
                    for row in held
                ]
            )
            yield tuple(np.moveaxis(figures[np.arange(len(gears))[:, None], brake_group], -1, 0))


@dataclass(frozen=True)
class Parts:
    """What a joint has of its own.

    Attributes:
        own: fields of a candidate that replace the drive's. banned: names that may not be taken.
        most: kg, that a drive may weigh.
    """

    own: Mapping[str, Any] = field(default_factory=dict)
    banned: frozenset[str] = frozenset()
    most: float = np.inf


class CatalogArrays:
    """The drives of a catalogue for turning, for sliding joints, or cylinders.

    Args:
        conditions: ambient temperature, for ratings. output: of `parts.output_of`.
        brakes: the smallest first.
    """

    def __init__(
        self, catalog: Catalog, conditions: Conditions, output: str, brakes: Mapping[str, Brake]
    ) -> None:
        self.output, self.conditions, self.brakes = output, conditions, brakes
        gears = [
            (name, gear, ratio)
            for name, gear in catalog.gears.items()
            if gear.output == output
            for ratio in gear.ratios
        ]
        alone = [(n, g) for n, g in catalog.whole() if g.serves == output]
        self.groups = []
        if gears and catalog.motors:
            self.groups.append(_of_gears(gears, catalog.motors, conditions))
        if alone:
            self.groups.append(_of_gearmotors(alone, conditions))
        inside = tuple({str(brake.sold) for brake in brakes.values()} - {"None", "alone"})
        for group in self.groups:
            names = group.names if group.at_output else group.motor_names
            brake_group = [
                tuple(w for w in inside if n.startswith(w)) if n.startswith(inside) else ()
                for n in names
            ]
            first = dict(zip(brake_group, names, strict=True))
            number_of = {words: k for k, words in enumerate(first)}
            in_gearmotor = group.at_output and not self.linear
            group.brakes = [self.brakes_for(name, in_gearmotor) for name in first.values()]
            if len(first) > 1 or group.at_output:
                group.brake_group = np.array([number_of[words] for words in brake_group])

    @property
    def linear(self) -> bool:
        """Whether they are for what slides."""
        return self.output != "rotary"

    def brakes_for(self, motor: str, integrated: bool = False) -> dict[str, Brake]:
        """Return the brakes that go with a motor, the smallest first."""
        return {n: brake for n, brake in self.brakes.items() if brake.goes_with(motor, integrated)}

    def only(self, *names: str) -> CatalogArrays:
        """Return the same with a few drives, named as `size` prints them."""
        few = copy(self)
        few.groups = [
            replace(group, fits=np.any([group.named(name) for name in names], axis=0))
            for group in self.groups
        ]
        return few

    def worst_efficiency(self, kind: str) -> float | None:
        """Return the worst known efficiency of a kind of gears; None: none is known."""
        gears = (entry for group in self.groups for entry in group.entries)
        known = (g.efficiency for g in gears if isinstance(g, Gear) and g.kind == kind)
        return min((eta for eta in known if isinstance(eta, float)), default=None)

    @property
    def count(self) -> int:
        """Number of drives whose parts go together."""
        return int(sum(group.fits.sum() for group in self.groups))


def _heat(ratings: Ratings, conditions: Conditions) -> float:
    """The continuous torque at the ambient temperature; of a curve over speed its greatest."""
    share, torque = ratings.derating(conditions)[0], ratings.continuous_torque
    if ratings.continuous_curve is not None:
        torque = max(at for _, at in ratings.continuous_curve)
    return number(None if share is None or torque is None else share * torque)


def _motors(ratings: Sequence[Ratings], conditions: Conditions) -> Figures:
    """Figures of motors, and as `hot` the least that R/R(25 C) of their windings may be."""
    cold = min(1.0, 1 + COPPER * (conditions.ambient - 25.0))
    figures = columns(ratings, MOTOR_FIGURES)
    figures.hot = np.array(
        [
            r.hottest(conditions)
            if r.thermal is None or r.torque_constant is None or r.resistance is None
            else cold
            for r in ratings
        ]
    )
    return figures


def _of_gears(
    gears: list[tuple[str, Gear, float]],
    motors: Mapping[str, Motor],
    conditions: Conditions,
) -> _Group:
    entries, names = [gear for _, gear, _ in gears], list(motors)
    ratings = [ratings_of(motor) for motor in motors.values()]
    listed = list(motors.values())
    best = [_at_best(entry) for entry in entries]
    own = columns(best, ("mass", "input_inertia"))
    of_motors = columns(listed, ("mass_taken", "rotor_inertia"))
    kit = np.array([motor.frameless for motor in listed])
    blank = Motor.model_construct(source="", grade="R", rotor_inertia=0.0)
    cache: dict[tuple[str, tuple[str, ...]], np.ndarray] = {}

    def fitting(entry: Gear) -> np.ndarray:
        key = entry.kind, entry.motors
        if key not in cache:
            pairs = zip(names, listed, strict=True)
            cache[key] = np.array([entry.takes(name, motor) for name, motor in pairs])
        return cache[key]

    return _Group(
        drives=Candidates(
            gear=columns(entries, GEAR_FIGURES).each(_upright),
            motor=_motors(ratings, conditions).each(np.atleast_2d),
            ratio=_upright([ratio for _, _, ratio in gears]),
            inertia=own.input_inertia[:, None] + of_motors.rotor_inertia,
            heat=np.array([[_heat(r, conditions) for r in ratings]]),
            at_output=False,
            linear=entries[0].output == "linear",
            case=idle(conditions),
        ),
        mass=(own.mass[:, None] + of_motors.mass_taken) * (1 + KIT * kit),
        fits=np.array([fitting(entry) for entry in entries]),
        names=[name for name, _, _ in gears],
        motor_names=names,
        gear_lacks=[
            (*lacks(kind_of(entry), entry), *outside(entry.kind, conditions)) for entry in entries
        ],
        motor_lacks=[
            (
                *lacks("motor", r, m),
                *outside(product_of(m), conditions, r.rated_up_to),
            )
            for m, r in zip(listed, ratings, strict=True)
        ],
        entries=entries,
        motors=listed,
        make=lambda g, m: motor_with_gear(names[m], listed[m], *gears[g], conditions.ambient),
        bare=lambda g: motor_with_gear(
            "", blank, gears[g][0], best[g], gears[g][2], conditions.ambient
        ),
    )


def _upright(values: Sequence[float] | np.ndarray) -> np.ndarray:
    return np.asarray(values, dtype=float)[:, None]


def _at_best(gear: Gear) -> Gear:
    """A gear without loss and inertia where these are not known: a bound."""
    best = {"efficiency": 1.0, "input_inertia": 0.0}
    unknown = {figure: x for figure, x in best.items() if getattr(gear, figure) is None}
    return gear.model_copy(update=unknown) if unknown else gear


def _with_rotor(entry: GearMotor) -> GearMotor:
    """A gearmotor with next to no rotor where its inertia is not known: a bound."""
    known = entry.rotor_inertia is not None
    return entry if known else entry.model_copy(update={"rotor_inertia": 1e-12})


def _of_gearmotors(alone: list[tuple[str, GearMotor]], conditions: Conditions) -> _Group:
    entries = [entry for _, entry in alone]
    ratings = [ratings_of(entry) for entry in entries]
    own = columns(entries, ("mass", "rotor_inertia", "ratio")).each(_upright)
    return _Group(
        drives=Candidates(
            gear=columns(entries, GEAR_FIGURES).each(_upright),
            motor=_motors(ratings, conditions).each(_upright),
            ratio=own.ratio,
            inertia=own.rotor_inertia,
            heat=_upright([_heat(r, conditions) for r in ratings]),
            at_output=True,
            linear=entries[0].output == "linear",
            case=idle(conditions),
            kind=None if (own_kind := entries[0].special) is None else type(own_kind),
        ),
        mass=own.mass,
        fits=np.ones((len(alone), 1), dtype=bool),
        names=[name for name, _ in alone],
        gear_lacks=[
            (
                *lacks(kind_of(entry, gearmotor=True), entry),
                *outside(product_of(entry), conditions, r.rated_up_to),
            )
            for entry, r in zip(entries, ratings, strict=True)
        ],
        entries=entries,
        make=lambda g, _: gearmotor_drive(*alone[g]),
        bare=lambda g: gearmotor_drive(alone[g][0], _with_rotor(entries[g])),
    )


@dataclass
class _GearAtJoint:
    """A gear at a joint: its losses over the cycle, the brakes that its drives may get.

    Attributes:
        ends: (T,) twice, torques at the input without rotor.
        means: over the cycle of m^2, m a, a^2, h^2, h m and h a (see the module).
        samples: m, h, a and speed where |m| + h, |a| and the speed are largest.
        brakes: options of each brake group, the smallest first; None: no brake.
    """

    ends: tuple[np.ndarray, np.ndarray]
    means: tuple[float, ...]
    samples: list[tuple[float, float, float, float]]
    brakes: list[list[Brake | None]]


@dataclass
class Known:
    """What was found of drives at one load, whatever stops demand and whatever is banned.

    Attributes:
        rows: of group and gear. entries: the least margins of the rows of their entries.
        margins: `DriveSearch.margins` of these, and masses, of each motor.
        judged: of group, gear and motor.
    """

    rows: dict[tuple[int, int], _GearAtJoint] = field(default_factory=dict)
    entries: dict[tuple[int, int], float] = field(default_factory=dict)
    margins: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    judged: dict[tuple[int, int, int], Assessment] = field(default_factory=dict)


class DriveSearch:
    """The drives of a catalogue at one joint.

    Args:
        beside: searches of the same arrays for other cases: a drive is judged where it fits worst.
        known: by searches at the same load; None: nothing.
    """

    def __init__(
        self,
        arrays: CatalogArrays,
        case: JointCase,
        parts: Parts,
        beside: Sequence[DriveSearch] = (),
        known: Known | None = None,
    ) -> None:
        self.arrays, self.case, self.parts, self.beside = arrays, case, parts, beside
        self._known = Known() if known is None else known
        self._source, self._found = self._offers(), list[tuple[float, float, int, int, int]]()
        self._judged: dict[tuple[int, int, int], Assessment] = {}

    @property
    def cases(self) -> tuple[JointCase, ...]:
        """The joint's cases, that of the largest RMS effort first."""
        return self.case, *(search.case for search in self.beside)

    def gear_lacks(self, group: _Group, g: int) -> tuple[str, ...]:
        """Return the figures that a gear lacks, beside what the joint has of its own."""
        own = self.parts.own
        figures = [
            figure
            for figure in group.gear_lacks[g]
            if figure != BEARING or own.get("bearing") is None
        ]
        if own.get("amplifier") is not None:
            asked = outside("amplifier", self.case.conditions)
            figures += [f"{figure}, of its amplifier" for figure in asked]
        return tuple(figures)

    def _of_gears(self, group: _Group) -> np.ndarray:
        """(ng,) the least margin of the rows of gears; infinite: none is known."""
        d = replace(group.drives, case=self.case)
        least = np.full((len(group.names), 1), np.inf)
        for limit in LIMITS:
            if limit.stage == "gear":
                least = np.fmin(least, limit.margin(d))
        return least[:, 0]

    def _of_entry(self, b: int, g: int) -> float:
        """The least margin of the rows of a gear's entry; infinite: none is known."""
        if (b, g) not in self._known.entries:
            bare = replace(self.arrays.groups[b].bare(g), **self.parts.own)
            d = read_drive(bare, None, self.case)
            margins = (limit.margin(d) for limit in LIMITS if limit.stage == "entry")
            known = (float(x) for x in margins if not np.isnan(x))
            self._known.entries[b, g] = min(known, default=np.inf)
        return self._known.entries[b, g]

    def _row(self, b: int, g: int) -> _GearAtJoint:
        if (b, g) in self._known.rows:
            return self._known.rows[b, g]
        group, case = self.arrays.groups[b], self.case
        bare = replace(group.bare(g), **self.parts.own)
        cycle, scale = case.cycle, bare.ratio if bare.at_output else 1.0
        lower, upper = ends = input_torques(bare, cycle)
        t, on = cycle.stretched, cycle.powered
        m, h = 0.5 * scale * (lower + upper) * on, 0.5 * scale * (upper - lower) * on
        a = scale * bare.ratio * cycle.acceleration * on
        x, y = int(np.argmax(np.abs(m) + h)), int(np.argmax(np.abs(a)))
        z = int(np.argmax(np.abs(cycle.velocity)))
        speed = (1.0 if bare.at_output else bare.ratio) * cycle.velocity
        row = _GearAtJoint(
            ends,
            tuple(mean(t, p * q) for p, q in ((m, m), (m, a), (a, a), (h, h), (h, m), (h, a))),
            [(m[k], h[k], a[k], speed[k]) for k in (x, y, z)],
            self._brakes(group, g, bare),
        )
        self._known.rows[b, g] = row
        return row

    def _brakes(self, group: _Group, g: int, bare: Candidate) -> list[list[Brake | None]]:
        """Return the brakes that drives may get, of each brake group; more than one by stop energy.

        That energy, T_b (J omega^2 + 2 omega T t + T^2 t^2/J)/2/(T_b - T) with the load T, is
        convex in J: what the lightest and the heaviest rotor bear, all between them do.
        """
        needed, rotors = self.holding_torque(bare), group.drives.inertia[g][group.fits[g]]
        known = rotors[np.isfinite(rotors)]
        if needed is None:
            return [[None] for _ in group.brakes]
        known = known if len(known) else np.zeros(1)
        stops, by_group = [self._stop(bare, J) for J in (known.min(), known.max())], []
        for brakes in group.brakes:
            options: list[Brake | None] = []
            for name, brake in brakes.items():
                borne = [smallest_brake({name: brake}, needed, stop) for stop in stops]
                wanted, has = braking_torques(brake, needed, stops[0])
                options += [brake] * (has >= wanted)
                if None not in borne:
                    break
            by_group.append(options or [None])  # without the brake that it needs none is signed
        return by_group

    def _stop(self, candidate: Candidate, inertia: float) -> Stop | None:
        """The hardest stop by a brake at a drive's shaft; None: the load's inertia is not known.

        `inertia`: of rotor and gear input, kg m^2.
        """
        load, demand = self.case.load_inertia, self.case.rest
        if load is None or demand is None:
            return None
        speed = np.abs(candidate.ratio * self.case.cycle.velocity)
        at_shaft = np.full(len(speed), load / candidate.ratio**2 + inertia)
        conditions = self.case.conditions
        asked = demand.within(conditions), conditions.brake_stops
        return Stop(at_shaft, speed, np.abs(demand.load / candidate.ratio), *asked)

    def holding_torque(self, drive_: Candidate) -> float | None:
        """Return what a brake at the shaft must hold, N m; None where none is needed.

        brake_factor max |load|/ratio at rest, friction left out (`brake.RestDemand`).
        """
        demand, conditions, gear = self.case.rest, self.case.conditions, drive_.transmission
        if demand is None or (drive_.linear and drive_.at_output):
            return None  # a linear motor has no shaft
        locks = gear is not None and driven_efficiency(gear) <= 0
        if not demand.why_brake(conditions, locks):
            return None
        return demand.reserve(conditions) * largest(demand.load) / abs(drive_.ratio)

    def margins(self, b: int, gears: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (n, nm) upper bounds of some gears' margins with every motor, and their masses."""
        known = self._known.margins
        if new := [int(g) for g in gears if (b, int(g)) not in known]:
            for g, *found in zip(new, *self._margins(b, np.array(new)), strict=True):
                known[b, g] = found[0], found[1]
        least, mass = zip(*(known[b, int(g)] for g in gears), strict=True)
        return np.array(least), np.array(mass)

    def _margins(self, b: int, gears: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        group, conditions = self.arrays.groups[b], self.case.conditions
        rows = [self._row(b, int(g)) for g in gears]
        mm, ma, aa, hh, hm, ha = np.array([row.means for row in rows]).T[:, :, None]
        samples = np.transpose([row.samples for row in rows], (1, 2, 0))[..., None]
        share = 1.0  # a bound of gearmotors, of which some have electronics of their own
        if not group.at_output:
            share = voltage_share(None, self.parts.own.get("amplifier"), conditions)
        d = replace(group.drives.of_gears(gears), case=self.case, share=share)
        own = np.array([self._of_entry(b, int(g)) for g in gears])[:, None]
        best, lightest = np.array(-np.inf), np.array(np.inf)
        # least inertia that the inertia ratio permits: of rotors of which none is known
        permitted = d.ratio**2 * conditions.inertia_ratio * (1 - 1e-9)
        least_rotor = (self.case.load_inertia or 0.0) / permitted
        for more, heavier in group.braked(gears, [row.brakes for row in rows]):
            J = group.drives.inertia[gears] + more
            unknown, J = np.isnan(J), np.where(np.isnan(J), least_rotor, J)
            # of an inertia that is not known the one that heats least
            turning = np.where(unknown, np.maximum(J, -ma / np.maximum(aa, 1e-300)), J)
            square = mm + 2 * turning * ma + turning**2 * aa + hh + 2 * np.abs(hm + turning * ha)
            ends = [(m + J * a, h, speed) for m, h, a, speed in samples]
            asked = Figures(
                rms=np.sqrt(np.maximum(square, 0.0)) * (1 - 1e-9),
                peak=np.maximum.reduce([np.abs(m) + h for m, h, _ in ends]) * (1 - 1e-9),
                voltage=np.maximum.reduce([_least_voltage(d.motor, *end) for end in ends]),
                pull_out=self._least_pull_out(group, ends),
            )
            best = np.maximum(best, _least_of_pairs(replace(d, inertia=J, asked=asked), own))
            lightest = np.minimum(lightest, group.mass[gears] + heavier)
        return best, lightest

    def any_inertia(self, b: int, gears: np.ndarray) -> np.ndarray:
        """Return (n, nm) upper bounds of gears' margins with every motor and any inertia.

        <m^2> + 2 J <m a> + J^2 <a^2> + <h^2> is least at some J, if not at the one that is known.
        """
        rows = [self._row(b, int(g)) for g in gears]
        mm, ma, aa, hh = np.array([row.means[:4] for row in rows]).T[:, :, None]
        d = replace(self.arrays.groups[b].drives.of_gears(gears), case=self.case)
        J = np.maximum(np.nan_to_num(d.inertia), -ma / np.maximum(aa, 1e-300))
        square, unknown = mm + 2 * J * ma + J**2 * aa + hh, np.full(J.shape, np.nan)
        rms = np.sqrt(np.maximum(square, 0.0)) * (1 - 1e-9)
        asked = Figures(rms=rms, peak=unknown, voltage=unknown, pull_out=unknown)
        own = np.array([self._of_entry(b, int(g)) for g in gears])[:, None]
        return _least_of_pairs(replace(d, inertia=unknown, asked=asked), own)

    def _least_pull_out(self, group: _Group, ends: Sequence[tuple[np.ndarray, ...]]) -> np.ndarray:
        """(n, nm) lower bounds of the shares of a torque of their own; NaN: they have none."""
        shares, slow = np.full(ends[0][0].shape, np.nan), 1e3 * self.case.cycle.stick_velocity
        half, speed = (np.stack([np.abs(end[k][:, 0]) for end in ends]) for k in (1, 2))
        for kind, motors in group.special.items():
            at = list(motors)
            torque = np.stack([np.abs(end[0][:, at]) for end in ends]) + half[..., None]
            own = torque, speed, slow, self.case.conditions
            shares[:, at] = kind.least_shares(list(motors.values()), *own)
        return shares

    def _step(self, b: int) -> int:
        """Number of gears at a time of a group."""
        return max(1, _MOST // max(len(self.arrays.groups[b].motor_lacks), 1))

    def some_at_a_time(self, b: int, gears: np.ndarray) -> Iterator[np.ndarray]:
        """Yield gears of a group, so many at a time as memory allows for `margins`."""
        step = self._step(b)
        for k in range(0, len(gears), step):
            yield gears[k : k + step]

    def bounds(
        self, b: int, gears: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Yield gears, some at a time, with their `margins`."""
        for some in self.some_at_a_time(b, gears):
            yield some, *self.margins(b, some)

    @cached_property
    def _complete(self) -> list[np.ndarray]:
        """Of each group the gears of which every figure is known."""
        return [
            np.flatnonzero([not self.gear_lacks(group, g) for g in range(len(group.names))])
            for group in self.arrays.groups
        ]

    @cached_property
    def gear_margins(self) -> list[np.ndarray]:
        """Of each group (ng,) the least margins of the rows of gears alone."""
        return [self._of_gears(group) for group in self.arrays.groups]

    def _offers(self) -> Iterator[tuple[float, float, int, int, int]]:
        """Yield (mass, margin, group, gear, motor) of drives that fail by no bound.

        The lightest first; of equal masses that of the greatest margin, which is an upper bound.
        """
        gears: list[tuple[float, int, int]] = []
        for b, group in enumerate(self.arrays.groups):
            light = np.isfinite(group.lightest) & (group.lightest <= self.parts.most)
            known = self._complete[b]
            passing = known[(light & (self.gear_margins[b] >= 0))[known]]
            gears += [(float(group.lightest[g]), b, g) for g in passing.tolist()]
        gears.sort()
        ready: list[tuple[float, float, str, int, int, int, Iterator[Any]]] = []
        together = 1
        for k, (_, b, g) in enumerate(gears):
            if self._of_entry(b, g) >= 0:
                if (b, g) not in self._known.margins:  # with more and more of those that follow
                    self._ahead(gears[k : k + together])
                    together = min(2 * together, _TOGETHER)
                own = self._of_one(b, g)
                ready += [(*first, own) for first in [next(own, None)] if first]
                heapq.heapify(ready)
            horizon = gears[k + 1][0] if k + 1 < len(gears) else np.inf
            while ready and ready[0][0] < horizon:
                lightest, short, _, *where, own = ready[0]
                if following := next(own, None):
                    heapq.heapreplace(ready, (*following, own))
                else:
                    heapq.heappop(ready)
                yield lightest, -short, where[0], where[1], where[2]

    def _ahead(self, gears: Sequence[tuple[float, int, int]]) -> None:
        """Bound the margins of the first gear (mass, group, number), and of others of its group."""
        b = gears[0][1]
        of_group = [g for _, c, g in gears if c == b][: self._step(b)]
        able = [g for g in of_group if self._of_entry(b, g) >= 0]
        self.margins(b, np.array(able))

    def _of_one(self, b: int, g: int) -> Iterator[tuple[float, float, str, int, int, int]]:
        """Yield mass, minus margin, name and numbers of a gear's drives, in order."""
        group, (least, mass) = self.arrays.groups[b], self.margins(b, np.array([g]))
        short, mass = -np.minimum(least[0], self.gear_margins[b][g]), mass[0]
        able = group.fits[g] & group.signable & np.isfinite(mass) & (mass <= self.parts.most)
        ok = np.flatnonzero((least[0] >= 0) & able)
        for m in ok[np.lexsort((group.by_name[ok], short[ok], mass[ok]))].tolist():
            name = f"{group.motor_names[m]} {group.names[g]}"
            yield float(mass[m]), float(short[m]), name, b, g, m

    def offers(self) -> Iterator[tuple[float, float, int, int, int]]:
        """Yield the same; what an earlier call reached is not searched again."""
        k = 0
        while True:
            if k == len(self._found):
                if (offer := next(self._source, None)) is None:
                    return
                self._found.append(offer)
            yield self._found[k]
            k += 1

    def judge(self, b: int, g: int, m: int) -> Assessment:
        """Return one drive of the arrays, judged exactly."""
        if (b, g, m) not in self._judged:
            group = self.arrays.groups[b]
            candidate = replace(group.make(g, m), **self.parts.own)
            missing = (*self.gear_lacks(group, g), *group.motor_lacks[m])
            row = self._row(b, g) if candidate.transmission is not None else None
            own = self._known.judged.get((b, g, m))
            if own is None or self.case.braking:  # the motor must brake, too
                own = self.assess(candidate, missing, row)
            if not self.case.braking:
                self._known.judged[b, g, m] = own
            case = self.case
            own = own.where(stop_effort=case.stop_effort, stop_note=case.stop_note)
            judged = (own, *(search.judge(b, g, m) for search in self.beside))
            self._judged[b, g, m] = _worst(judged)
        return self._judged[b, g, m]

    def assess_each(self, candidate: Candidate, missing: tuple[str, ...]) -> Assessment:
        """Return a drive judged exactly in all cases of the joint, the worst of them."""
        searches = (self, *self.beside)
        return _worst([search.assess(candidate, missing) for search in searches])

    def assess(
        self, candidate: Candidate, missing: tuple[str, ...] = (), row: _GearAtJoint | None = None
    ) -> Assessment:
        """Return a drive judged exactly, with the brake that it needs."""
        motor, needed = None, self.holding_torque(candidate)
        if (gear := candidate.transmission) is not None:
            ends = row.ends if row else input_torques(candidate, self.case.cycle)
            if needed is not None:
                brakes = self.arrays.brakes_for(candidate.motor, candidate.integrated)
                name = smallest_brake(brakes, needed, self._stop(candidate, gear.rotor_inertia))
                candidate = candidate if name is None else with_brake(candidate, name, brakes[name])
            motor = motor_cycle(candidate, self.case.cycle, self.case.conditions, ends)
        return Assessment(read_drive(candidate, motor, self.case), missing)

    def lightest(self) -> Assessment | None:
        """Return the first drive that fits, by `rank`."""
        return next(iter(self.fitting(1)), None)

    def fitting(self, count: int) -> list[Assessment]:
        """Return the lightest drives that fit, by `rank`."""
        fitting: list[Assessment] = []
        for mass, margin, b, g, m in self.offers():
            if len(fitting) == count:
                heaviest = fitting[-1].mass or 0.0
                if mass > heaviest * (1 + 1e-12):
                    break
                printed = not fitting[-1].candidate.ratings.by_rule
                if mass >= heaviest and printed and margin < fitting[-1].margin - 1e-8:
                    continue  # of equal masses the greater margin comes first
            judged = self.judge(b, g, m)
            name, heavy = judged.name, judged.mass or 0.0
            if judged.fits and name not in self.parts.banned and heavy <= self.parts.most:
                fitting = sorted([*fitting, judged], key=rank)[:count]
        return fitting

    def front(self) -> list[Assessment]:
        """Return the drives that fit of which no lighter one has as stiff a gear, by mass."""
        front: list[Assessment] = []
        stiffest, alike = 0.0, list[Assessment]()
        offers = list(self.offers())
        for k, (mass, _, b, g, m) in enumerate(offers):
            stiffness = float(self.arrays.groups[b].drives.gear.stiffness[g, 0])
            if stiffness > stiffest:
                judged = self.judge(b, g, m)
                if judged.fits and judged.name not in self.parts.banned:
                    alike.append(judged)
            last = k + 1 == len(offers) or offers[k + 1][0] > mass
            if last and alike:
                front.append(min(alike, key=lambda a: (-stiffness_of(a), rank(a))))
                stiffest, alike = stiffness_of(front[-1]), []
        return front

    def all_of_few(self) -> list[Assessment]:
        """Return all drives of a small catalogue, judged; of a larger one none."""
        if self.arrays.count > _FEW:
            return []
        pairs = (
            (b, g, m) for b, x in enumerate(self.arrays.groups) for g, m in np.argwhere(x.fits)
        )
        return [self.judge(b, int(g), int(m)) for b, g, m in pairs]

    def nearest(self, below: float = np.inf, worst: float = -10.0) -> Assessment | None:
        """Return the drive below a mass (kg) of the greatest margin, which exceeds `worst`."""
        options: list[tuple[float, float, int, int, int]] = []
        for b, group in enumerate(self.arrays.groups):
            known = self._complete[b]
            for gears, least, mass in self.bounds(b, known[self.gear_margins[b][known] > worst]):
                least = np.fmin(least, self.gear_margins[b][gears][:, None])
                ok = (least > worst) & group.fits[gears] & group.signable & (mass < below)
                if ok.sum() > _TRIED:
                    ok &= least >= -np.partition(-least[ok], _TRIED - 1)[_TRIED - 1]
                options += [
                    (-float(least[k, m]), float(mass[k, m]), b, int(gears[k]), int(m))
                    for k, m in np.argwhere(ok)
                ]
        options.sort()
        best: Assessment | None = None
        for bound, _, b, g, m in options[:_TRIED]:
            if best is not None and best.margin >= -bound:
                break
            judged = self.judge(b, g, m)
            if judged.fits or judged.unknown or judged.name in self.parts.banned:
                continue
            if judged.margin > worst and (best is None or judged.margin > best.margin):
                best = judged
        return best

    def ask(self, below: float = np.inf) -> tuple[Ask, ...]:
        """Return the gears and motors that might do but lack figures, by fewest missing, mass.

        Each has a complete partner with which it fails by no bound and, where the masses are known,
        is lighter than `below` (kg), brake included.
        """
        asks: dict[str, Ask] = {}
        for b, group in enumerate(self.arrays.groups):
            might_do = np.flatnonzero(self.gear_margins[b] >= 0)
            for gears, least, masses in self.bounds(b, np.setdiff1d(might_do, self._complete[b])):
                might = group.fits[gears] & group.signable  # NaN: not known
                might &= ~(least < 0) & ~(masses >= below)
                lightest = np.where(might & np.isfinite(masses), masses, np.inf).min(axis=1)
                for k in np.flatnonzero(might.any(axis=1)).tolist():
                    name, entry = group.names[gears[k]], group.entries[gears[k]]
                    mass = float(lightest[k]) if np.isfinite(lightest[k]) else None
                    figures, kind = self.gear_lacks(group, gears[k]), getattr(entry, "kind", "")
                    asks.setdefault(name, Ask(name, figures, mass, entry.source, kind))
            if group.at_output:
                continue
            known, might = self._complete[b], np.zeros(len(group.motor_lacks), dtype=bool)
            for gears, least, heavy in self.bounds(b, known[self.gear_margins[b][known] >= 0]):
                might |= ((least >= 0) & group.fits[gears] & ~(heavy >= below)).any(axis=0)
            for m in np.flatnonzero(might).tolist():
                if figures := group.motor_lacks[m]:
                    name = group.motor_names[m]
                    asks.setdefault(name, Ask(name, figures, None, group.motors[m].source))
        return tuple(sorted(asks.values(), key=lambda a: (len(a.figures), a.mass or 0.0, a.name)))


def stiffness_of(assessment: Assessment) -> float:
    """Return K_1 of a drive, N m/rad; NaN: not known."""
    return float(assessment.drives.gear.stiffness)


def momentary_peak(assessment: Assessment) -> float:
    """Return what the gear bears for a moment, N m or N; NaN: not known."""
    return float(first_known(assessment.drives.gear, STAND_INS["momentary_peak_torque"]))


def _least_of_pairs(d: Candidates, own: np.ndarray) -> np.ndarray:
    """(n, nm) the least of margins (n, 1) of gears and of the rows of pairs that are known."""
    least = np.broadcast_to(own, d.inertia.shape).copy()
    for limit in LIMITS:
        if limit.stage == "pair":
            margin = limit.margin(d)
            if limit.name in STEPS:  # no measure where it passes
                margin = np.where(margin >= 0, np.inf, margin)
            least = np.fmin(least, margin)
    return least


def _least_voltage(
    motor: Figures, middle: np.ndarray, half: np.ndarray, speed: np.ndarray
) -> np.ndarray:
    """A lower bound of the voltage that a torque between two ends takes."""
    per_torque = motor.resistance / motor.torque_constant
    back = motor.torque_constant
    other = motor.nominal_voltage / motor.stall_torque, motor.nominal_voltage / motor.no_load_speed
    per_torque = np.where(np.isnan(per_torque), other[0], per_torque)
    back = np.where(np.isnan(motor.resistance / motor.torque_constant), other[1], back)
    driving = np.where(speed >= 0, middle, -middle) + half
    taken = (motor.hot * per_torque * driving + back * np.abs(speed)) * (1 - 1e-9)
    return np.where(driving > 0, taken, 0.0)  # a braking torque takes less
