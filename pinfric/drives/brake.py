"""Joints that hold without power, and the brakes that hold and stop the others.

Power may fail anywhere along a cycle, with the payloads carried there. Friction in joints and gears
may help or oppose, as its history left it: a joint without a brake stays where friction alone bears
the load, and a brake at the motor's shaft must bear |load|/ratio without that help.

A brake that closes at speed takes the energy of a stop, friction left out and the load driving,

    E = J omega_1^2/2 T_b/(T_b - |T_load|),      omega_1 = |omega| + |T_load| t_engage/J,

with J of rotor, brake and load at the shaft: for t_engage the load accelerates, then T_b - |T_load|
slows it down.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pinfric.drives.catalog import Brake
from pinfric.drives.criterion import LEAST_MARGIN, Criterion, Status, compare
from pinfric.drives.demand import largest
from pinfric.drives.drivetrain import Candidate
from pinfric.drives.friction import own_friction
from pinfric.drives.inertia import joint_inertias
from pinfric.drives.policy import (
    Conditions,
    stated,
)
from pinfric.drives.rest import RestDemand
from pinfric.dynamics.forward.holds import holds
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import States
from pinfric.errors import PinfricError
from pinfric.model.described import EFFORT, derived, described, quantity
from pinfric.model.scene import Scene
from pinfric.model.transmission import driven_efficiency
from pinfric.motions.summary import ends_by_magnitude

_SOURCE = "Machine Design, Mechantronics Q & A: Hold it steady (2007): factor 1.5 to 3"
_NO_BRAKE = "the catalogue has no brake that goes with this motor"
_NO_SHAFT = "a linear motor has no shaft for a brake: the joint needs a clamp or a counterweight"
_STATICS = (
    "limits of static friction (pinfric.holds) at the worst pose; Harmonic "
    "Drive: do not rely on the back-driving torque to hold a load"
)
#: Of the robot's largest effort: what is smaller is rounding of its motion or of its masses.
_NOTHING = 1e-6
_HOLDING, BRAKE, _STOP = "holding without power", "holding brake", "brake stop energy"
_COIL, _WEAR = "brake coil voltage", "brake wear"
_BY_MAKER = "maker's figures"


@described
class Standstill:
    """Holding of a joint when power fails, worst case along the cycle.

    Attributes:
        criteria: holding without power, the brake's torque, its energy in a stop, its wear by many,
            and its coil.
    """

    effort: tuple[float, float] = quantity(
        "(smallest, largest) holding effort at the joint: with the full help of friction, or none",
        EFFORT,
        "at the\njoint",
    )
    shaft: tuple[float, float] | None = quantity(
        "the same at the motor's shaft, with gear losses; none without a transmission",
        "N m",
        "at the\nmotor",
    )
    use: float | None = quantity(
        "largest used part of the static friction limits of joint and gear, without power, all "
        "other joints held; none: it moves, or is not known",
        heading="without\nbrake",
    )
    held: bool | None = quantity("whether friction alone holds it there; none: not known")
    time: float = quantity("time of that pose in the cycle", "s")
    brake: str | None = quantity(
        "smallest brake of the catalogue that holds `shaft`, if any", heading="smallest brake"
    )
    fitted: bool = quantity(
        "whether the drive has that brake: its own friction does not hold it, or one is required"
    )
    criteria: tuple[Criterion, ...]

    @property
    def torque(self) -> Criterion:
        """The brake's torque against the load."""
        return next(c for c in self.criteria if c.name == BRAKE)

    @property
    @derived(heading="margin", cell="{margin:margin}")
    def margin(self) -> float | None:
        """What the brake has left of its torque; none: not known, or none is needed."""
        return self.torque.margin


def standstills(
    result: InverseResult,
    brakes: Mapping[str, Brake],
    conditions: Conditions,
    drives: Sequence[Candidate | None] = (),
) -> tuple[Standstill, ...]:
    """Return the holding of each drive's joint without power, in the order of the drives.

    Args:
        result: of the cycle; its scene has the gears.
        brakes: of the catalogue. conditions: whether a brake is required, and its reserve.
        drives: (na,) that were chosen: brakes that are built into other motors do not count; left
            out: what each joint would need, of brakes sold alone.
    """
    states = result.states
    still = at_rest(result.scene, states)
    loads = resting_loads(still, conditions)
    inertias = joint_inertias(result.scene, states)
    standing = []
    for i, drive in enumerate(result.scene.drives):
        own, taken = inertias[:, i], drives[i] if drives else None
        there = taken.brake if taken else "" if drives else None
        if there and drive.transmission is not None:
            inside = brakes[there].inertia_ends[1]  # each brake on trial adds its own
            own = own - drive.transmission.ratio**2 * inside
        of = (taken.motor, taken.integrated) if taken else ("",)
        fitting = {name: b for name, b in brakes.items() if b.goes_with(*of)}
        fitting = ranked(fitting, coil_supply(conditions))
        of_joint = still, loads[:, i]
        found = _standstill(result, of_joint, i, own, fitting, conditions, there)
        special = None if taken is None else taken.ratings.special
        standing.append(found if special is None else _unbraked(found, *special.unbraked))
    return tuple(standing)


def at_rest(scene: Scene, states: States) -> InverseResult:
    """Return the efforts that hold a robot in each of its postures."""
    zero = np.zeros_like(states.v)
    return inverse_dynamics(scene, states.q, zero, zero, attached=states.attached)


def resting_loads(still: InverseResult, conditions: Conditions) -> np.ndarray:
    """Return what brakes hold in each posture, (T, na) N m or N, without friction.

    With `lost_springs: one` the largest of what all springs, hoses and payloads leave, and what
    remains if any one spring or payload is lost: a counterweight, or the load that it balances.

    Args:
        still: of `at_rest`.
    """
    loads = still.effort_frictionless
    for fewer, states in _losses(still) if conditions.lost_springs == "one" else ():
        without = at_rest(fewer, states).effort_frictionless
        loads = np.where(np.abs(without) > np.abs(loads), without, loads)
    return loads


def _losses(still: InverseResult) -> Iterator[tuple[Scene, States]]:
    """Yield the scene without friction and one of its springs, or one of the payloads carried."""
    scene, states = still.scene, still.states
    bare = replace(scene, friction={})
    for lost in scene.springs:
        if lost.kind != "hose":
            fewer = tuple(s for s in scene.springs if s is not lost)
            yield replace(bare, springs=fewer), states
    carried = states.carried(scene)
    for k in range(len(scene.payloads)):
        if carried[:, k].any():
            rest = carried.copy()
            rest[:, k] = False
            yield bare, replace(states, attached=rest)


class _Rest(NamedTuple):
    """What a joint that stands still asks of a brake.

    Attributes:
        effort: (smallest, largest) that holds it, N m or N: with all help of friction, or none.
        shaft: the same at the motor's shaft, N m; None: it has none.
        stop: of a brake that closes at speed; None: no shaft, or its inertia is not known.
        demand, why: what else decides, and the reason for a brake; "": none is needed.
        no_shaft: whether it is moved by a linear motor.
        back: efficiency of the gear that the load drives.
    """

    effort: tuple[float, float]
    shaft: tuple[float, float] | None
    stop: Stop | None
    demand: RestDemand
    why: str
    no_shaft: bool
    back: float


def _standstill(
    result: InverseResult,
    of_joint: tuple[InverseResult, np.ndarray],
    i: int,
    inertia: np.ndarray,
    brakes: Mapping[str, Brake],
    conditions: Conditions,
    fitted: str | None,
) -> Standstill:
    """`of_joint`: at rest, and the (T,) load that a brake holds."""
    still, rest = of_joint[0], _at_joint(result, of_joint, i, inertia, conditions)
    own = _rounded(result, still.effort_frictionless[:, i])
    pose = _hardest(still, i)
    use, held = _use(still, i, pose, own[pose])
    name, rows = _braked(rest, brakes, conditions, fitted)
    return Standstill(
        effort=rest.effort,
        shaft=rest.shaft,
        use=use,
        held=held,
        time=float(result.times[pose]),
        brake=name,
        fitted=name is not None and bool(rest.why) if fitted is None else bool(fitted),
        criteria=(_unpowered(use, held), *rows),
    )


def _at_joint(
    result: InverseResult,
    of_joint: tuple[InverseResult, np.ndarray],
    i: int,
    inertia: np.ndarray,
    conditions: Conditions,
) -> _Rest:
    still, load = of_joint[0], _rounded(result, of_joint[1])
    least = ends_by_magnitude(still.effort_lower[:, i], still.effort_upper[:, i])[1]
    effort = largest(_rounded(result, least)), largest(load)
    drive, gear = still.scene.drives[i], still.scene.drives[i].transmission
    ends = result.effort_lower[:, i], result.effort_upper[:, i]
    speed, peak = largest(result.actuator_velocity[:, i]), max(map(largest, ends))
    demand = rest_of(result.scene, i, load, peak, speed, conditions)
    back = 1.0 if gear is None else driven_efficiency(gear)
    why = demand.why_brake(conditions, back <= 0)
    linear = gear is not None and drive.motor_unit == "N"
    if gear is None or linear:
        return _Rest(effort, None, None, demand, why, linear, back)
    shaft_least = ends_by_magnitude(still.motor_torque_lower[:, i], still.motor_torque_upper[:, i])[
        1
    ]
    shaft = largest(_rounded(result, shaft_least)), largest(load) / abs(gear.ratio)
    stop = None
    if not np.isnan(inertia).any():
        turning = np.abs(gear.ratio * result.actuator_velocity[:, i])
        at_shaft = inertia / gear.ratio**2 + gear.rotor_inertia
        within, stops = demand.within(conditions), conditions.brake_stops
        stop = Stop(at_shaft, turning, np.abs(load / gear.ratio), within, stops)
    return _Rest(effort, shaft, stop, demand, why, linear, back)


def _unpowered(use: float | None, held: bool | None) -> Criterion:
    """Whether friction alone holds a joint, all others held."""
    formula = "static friction needed / its limit <= 1, power off and all other joints held"
    found = compare(_HOLDING, use, 1.0, "", formula, _STATICS, "a unique static solution")
    if held is not False:
        return found
    note = "it moves: friction alone does not hold it"
    return replace(found, status=Status.NOT_REQUIRED, required=None, note=note, missing="")


def _braked(
    rest: _Rest, brakes: Mapping[str, Brake], conditions: Conditions, fitted: str | None
) -> tuple[str | None, tuple[Criterion, ...]]:
    """The brake that holds a joint, and what it must bear. `fitted`: of the drive; None: no drive.

    Its torque, its energy in a stop, its wear and its coil.
    """
    chosen, demand, stop = fitted is not None, rest.demand, rest.stop
    needed = bool(rest.why) and conditions.holding_brake != "any"
    torque = None if rest.shaft is None else demand.reserve(conditions) * rest.shaft[1]
    name = fitted or None
    if not fitted and torque is not None and (rest.why or torque != 0.0):
        name = smallest_brake(brakes, torque, stop)
    held_by = _torque(torque, stop, name, brakes, (demand, conditions), needed, chosen)
    said = stated(conditions, "holding_brake")
    if rest.no_shaft and needed and chosen:
        most = demand.reserve(conditions) * rest.effort[1]
        figures = most, 0.0, "N", LEAST_MARGIN
        held_by = Criterion(
            BRAKE, Status.FAILS, *figures, held_by.formula, _SOURCE, _NO_SHAFT, said
        )
    if fitted == "" and not rest.why:
        held_by = replace(held_by, note=demand.without_brake(rest.back))
    judged = name
    if needed and chosen and name is None and brakes:
        judged = list(brakes)[-1]  # each fails by its torque or its energy, the strongest too
    energy = _energy(stop, judged, brakes, said if needed else "")
    wear = _wear(stop, judged, brakes, conditions)
    return name, (held_by, energy, *wear, *_coil(name, brakes, conditions))


def _unbraked(found: Standstill, holds: bool, why: str) -> Standstill:
    """Say of a drive of a kind of its own whether and how it holds without a brake."""
    if not why or found.fitted:
        return found
    torque, rows = replace(found.torque, note=why), found.criteria
    if holds:
        torque = replace(torque, status=Status.NOT_REQUIRED, margin=None)
        rows = tuple(row for row in rows if row.name != _STOP)
    return replace(found, criteria=tuple(torque if row.name == BRAKE else row for row in rows))


def _rounded(result: InverseResult, effort: np.ndarray) -> np.ndarray:
    """Efforts with 0 in place of rounding errors."""
    most = max(largest(result.effort_lower), largest(result.effort_upper))
    return np.where(np.abs(effort) <= _NOTHING * most, 0.0, effort)


def rest_of(
    scene: Scene, i: int, load: np.ndarray, peak: float, speed: float, conditions: Conditions
) -> RestDemand:
    """Return what a joint that stands still asks of a brake.

    Args:
        i: the drive's column. load, peak: as of `RestDemand`. speed: largest, rad/s (m/s).
        conditions: whether a spring may be lost.
    """
    drive, guesses = scene.drives[i], () if scene.assumed is None else scene.assumed.values
    # an inertia weighs nothing
    weights = (place for place in guesses if not place.endswith(".inertia"))
    unsure = any(place.startswith(("robot.masses", "robot.payloads")) for place in weights)
    own = own_friction(scene, drive.name)
    moves = speed > scene.stick_velocity_of(drive)
    lost = bool(scene.payloads) or any(s.kind != "hose" for s in scene.springs)
    sprung = lost and conditions.lost_springs == "one"
    return RestDemand(load, peak, own, moves, scene.stops is not None, unsure, sprung)


class Stop(NamedTuple):
    """A brake that closes at speed: load and speed at the motor's shaft, sample by sample.

    It preselects a brake: each axis alone, without friction. `pinfric.stop` simulates all axes.

    Attributes:
        inertia: (T,) kg m^2. speed: (T,) rad/s. load: (T,) |T_load|, N m.
        within: time in which the brake must stop it, s; infinite: any.
        stops: as many as hard until it is worn; None: any.
    """

    inertia: np.ndarray
    speed: np.ndarray
    load: np.ndarray
    within: float = np.inf
    stops: float | None = None

    def torque(self, brake: Brake) -> float:
        """Return what it takes to stop in time, N m: |T_load| + (J + J_brake) omega/t, largest."""
        inertia = self.inertia.max() + brake.inertia_ends[1]
        return float(self.load.max() + inertia * self.speed.max() / self.within)

    def energy(self, brake: Brake) -> float:
        """Return the energy of the hardest stop, J; infinite if the brake cannot hold the load."""
        if not brake.torque > self.load.max():
            return np.inf
        inertia, delay = self.inertia + brake.inertia_ends[1], brake.engage_time or 0.0
        way = closing_way(inertia, self.speed, self.load, delay, brake.torque - self.load)
        return float(brake.torque * way.max())

    def wear(self, brake: Brake) -> float | None:
        """Return the energy of all stops, J; None: no number is demanded."""
        return None if self.stops is None else self.stops * self.energy(brake)

    def bears(self, brake: Brake) -> bool:
        """Return whether a brake bears one stop and all of them, as far as its maker says."""
        one, every, wear = brake.stop_energy, brake.wear_energy, self.wear(brake)
        single = one is None or self.energy(brake) <= one
        return single and (every is None or wear is None or wear <= every)


def braking_torques(brake: Brake, torque: float, stop: Stop | None) -> tuple[float, float]:
    """Return what a brake must have at the shaft, and has, N m, where least is left.

    At rest its static torque holds the load; in a stop its dynamic one counts.
    """
    pairs = [(torque, brake.holds), *([] if stop is None else [(stop.torque(brake), brake.torque)])]
    return max(pairs, key=lambda pair: pair[0] / pair[1])


def closing_way(
    inertia: np.ndarray,
    speed: np.ndarray,
    push: np.ndarray,
    delay: float | np.ndarray,
    left: np.ndarray,
) -> np.ndarray:
    """Return the way of one axis from when its brake closes: J w^2/(2 left), w = |v| + push t/J.

    Args:
        inertia: J, kg m^2 (kg). speed: |v| at power-off, rad/s (m/s).
        push: torque or force along v until then, N m (N); against v: 0.
        delay: t until it closes, s. left: what the brake has beyond the load, N m (N).
    """
    closing = speed + np.maximum(push, 0.0) * delay / inertia
    return inertia * closing**2 / (2.0 * left)


def _hardest(still: InverseResult, i: int) -> int:
    """The pose at which the ratio of load to friction's limit is greatest."""
    lower, upper = still.motor_torque_lower[:, i], still.motor_torque_upper[:, i]
    gear = still.scene.drives[i].transmission
    load = still.effort_frictionless[:, i] / (1.0 if gear is None else gear.ratio)
    limit = np.where(load > 0, load - lower, upper - load)
    return int(np.argmax(np.abs(load) / np.maximum(limit, 1e-12 * max(largest(load), 1.0))))


def _use(still: InverseResult, i: int, pose: int, load: float) -> tuple[float | None, bool | None]:
    """Return a joint's friction over its limit, the others held, and whether it holds."""
    ends = still.motor_torque_lower[pose, i], still.motor_torque_upper[pose, i]
    if not still.scene.loops:  # in an open chain each joint's statics is its own
        if load == 0.0:
            return 0.0, True
        if not ends[0] <= 0.0 <= ends[1]:
            return None, False
    scene, effort = still.scene, still.effort_frictionless[pose].copy()
    effort[i] = 0.0
    carried = still.states.attached
    attached = (
        None
        if carried is None
        else [name for name, on in zip(scene.payloads, carried[pose], strict=True) if on]
    )
    efforts = {"effort": effort}
    ratios = [None if d.transmission is None else d.transmission.ratio for d in scene.drives]
    if None not in ratios:
        efforts = {"motor_torque": effort / np.array(ratios, dtype=float)}
    try:
        hold = holds(scene, still.states.q[pose], attached=attached, **efforts)
    except PinfricError:
        return None, None
    return (hold.use if hold.held else None), hold.held


def coil_supply(conditions: Conditions) -> float:
    """Return the highest voltage that a machine has for the coils of brakes, V."""
    return max(conditions.coil_voltage, conditions.bus_voltage)


def ranked(brakes: Mapping[str, Brake], most: float = np.inf) -> dict[str, Brake]:
    """Return brakes by torque, then mass, power, name; those of a coil above `most`, V, last."""

    def order(one: tuple[str, Brake]) -> tuple[bool, float, float, float, str]:
        name, brake = one
        beyond = (brake.voltage or 0.0) > most
        return beyond, brake.torque, brake.mass_taken, brake.power or np.inf, name

    return dict(sorted(brakes.items(), key=order))


def smallest_brake(brakes: Mapping[str, Brake], torque: float, stop: Stop | None) -> str | None:
    """Return the first brake that bears a torque, a stop in time and, where printed, the energy.

    Args:
        brakes: in the order of `ranked`. torque: at the shaft, N m.
        stop: at the shaft, without the brake; None: not known.
    """
    for name, brake in brakes.items():
        wanted, has = braking_torques(brake, torque, stop)
        if has >= wanted and (stop is None or stop.bears(brake)):
            return name
    return None


def _torque(
    wanted: float | None,
    stop: Stop | None,
    name: str | None,
    brakes: Mapping[str, Brake],
    given: tuple[RestDemand, Conditions],
    needed: bool,
    chosen: bool,
) -> Criterion:
    """`needed`: the conditions ask for a brake. `chosen`: the drive is."""
    rest, conditions = given
    said = stated(conditions, "brake_factor", *["holding_brake"] * needed)
    factor = f"{rest.reserve(conditions):g}"
    if rest.unsure:
        factor += " (masses or payloads are guesses)"
    formula = f"{factor} max |load|/ratio at rest, without friction <= torque of the brake"
    if rest.sprung:
        formula = formula.replace("friction", "friction and any one spring or payload")
        said += f"; {stated(conditions, 'lost_springs')}"
    if stop is not None and stop.within < np.inf:
        formula += f", and max |load|/ratio + J max omega/{stop.within:g} s"
    torque = None
    if name is not None or brakes:
        taken = brakes[name or list(brakes)[-1]]
        torque = taken.holds
        if wanted is not None:
            wanted, torque = braking_torques(taken, wanted, stop)
    if name is not None:
        note = f"{name}: {_described(brakes[name])}"
        return compare(BRAKE, wanted, torque, "N m", formula, _SOURCE, "", note, said)
    strongest = torque
    missing = "brakes in the catalogue" if wanted is not None else "gear and motor"
    if needed and chosen and wanted is not None and not brakes:
        said, figures = stated(conditions, "holding_brake"), (wanted, 0.0, "N m", LEAST_MARGIN)
        return Criterion(BRAKE, Status.FAILS, *figures, formula, _SOURCE, _NO_BRAKE, said)
    if needed:
        note = "" if strongest is None else f"{list(brakes)[-1]}, the strongest"
        return compare(BRAKE, wanted, strongest, "N m", formula, _SOURCE, missing, note, said)
    note = "no brake of the catalogue holds it" if brakes and wanted else ""
    if chosen and wanted and not brakes:
        note = f"{_NO_BRAKE}: without power its load moves it"
    return Criterion(
        BRAKE, Status.NOT_REQUIRED, wanted, strongest, "N m", None, formula, _SOURCE, note
    )


def _energy(
    stop: Stop | None, name: str | None, brakes: Mapping[str, Brake], needed: str
) -> Criterion:
    """`needed`: the condition that asks for a brake; empty: none does."""
    formula = "max J omega_1^2/2 T_b/(T_b - |T_load|), omega_1 = |omega| + |T_load| t_engage/J"
    source = "energy balance of a stop under constant load; friction would help"
    brake = None if name is None else brakes[name]
    energy = None if stop is None or brake is None else stop.energy(brake)
    allowed = None if brake is None else brake.stop_energy
    if needed or allowed is not None:
        missing = (
            "inertia at the shaft, or a brake" if energy is None else "stop energy of the brake"
        )
        note = "" if brake is None or brake.engage_time else "assumed to close at once"
        return compare(_STOP, energy, allowed, "J", formula, source, missing, note, needed)
    return Criterion(_STOP, Status.NOT_REQUIRED, energy, None, "J", None, formula, source, "")


def _wear(
    stop: Stop | None, name: str | None, brakes: Mapping[str, Brake], conditions: Conditions
) -> tuple[Criterion, ...]:
    if name is None:
        return ()
    rule = "number of stops x energy of the hardest <= energy until the brake is worn", _BY_MAKER
    brake, said = brakes[name], stated(conditions, "brake_stops")
    if conditions.brake_stops is not None:
        missing = "inertia at the shaft" if stop is None else "energy until the brake is worn"
        wear = None if stop is None else stop.wear(brake)
        return (compare(_WEAR, wear, brake.wear_energy, "J", *rule, missing, "", said),)
    energy = None if stop is None else stop.energy(brake)
    note = "its maker prints no energy until it is worn"
    if brake.wear_energy is not None:
        hardest = f"{brake.wear_energy / energy:.3g} of the hardest" if energy else "any number of"
        note = f"it bears {hardest} stops"
    figures = None, brake.wear_energy, "J", None
    return (Criterion(_WEAR, Status.NOT_REQUIRED, *figures, *rule, f"{note}; {said}"),)


def _coil(
    name: str | None, brakes: Mapping[str, Brake], conditions: Conditions
) -> tuple[Criterion, ...]:
    if name is None:
        return ()
    most = coil_supply(conditions)
    said = stated(conditions, "coil_voltage", "bus_voltage")
    rule = "voltage of the coil <= the higher of coil supply and bus", _BY_MAKER
    coil = compare(_COIL, brakes[name].voltage, most, "V", *rule, "voltage of the brake", "", said)
    # a voltage that passes is no tighter the nearer it is
    return (coil if coil.fails else replace(coil, margin=None),)


def _described(brake: Brake) -> str:
    parts = [f"{brake.torque:g} N m"]
    for value, text in (
        (brake.static_torque, "{:g} N m at rest"),
        (brake.voltage, "{:g} V"),
        (brake.power, "{:g} W"),
        (brake.release_time, "opens in {:g} s"),
        (brake.engage_time, "closes in {:g} s"),
        (brake.stop_energy, "{:g} J a stop"),
    ):
        parts += [text.format(value)] if value is not None else []
    return ", ".join(parts) + f" ({brake.grade}: {brake.source})"
