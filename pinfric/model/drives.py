"""Drives: the degree of freedom that each actuator moves, and the losses of its transmission.

`effort` (t) is what the drive delivers at the joint, `motor_torque` (T_m) what its motor must
deliver at its shaft. With ratio r, no-load torque n at the motor and the loss g L due to the load
(`transmission`), r T_m is

    moving forward    upper(t) = t + g L(|t|) + n|r|
    moving backward   lower(t) = t - g L(|t|) - n|r|
    at standstill     anything from the least lower(t) to the greatest upper(t) over the efforts t

plus r^2 J_rotor a and the motor's viscous friction. At standstill n is the static no-load torque.
See `notebooks/theory/gears.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from pinfric.kernels.compiled import inlined_kernel, kernel, late_kernel
from pinfric.model.friction_terms import ViscousFriction
from pinfric.model.laws import power_of
from pinfric.model.springs import Spring, spring_of
from pinfric.model.transmission import Transmission


@dataclass(frozen=True)
class Drive:
    """One actuator on one joint.

    Attributes:
        name: the actuator's own name, else its joint's.
        velocity_index: the column of v it moves; -1 off the joints.
        slides: whether it pushes along a line (N, m), or turns about an axis (N m, rad).
        transmission: None for an ideal drive of ratio 1 (motor torque = effort).
        share: w in the sum of effort^2 / w, which redundant drives minimize; None: not given.
        couples: (column of v, factor) of other joints that turn it as well (`couples`).
        column: of a drive off the joints, its column among the actions; else -1.
        encoder: where the controller measures, at the motor or at the joint.
    """

    name: str
    velocity_index: int
    slides: bool = False
    transmission: Transmission | None = None
    share: float | None = None
    couples: tuple[tuple[int, float], ...] = ()
    column: int = -1
    encoder: Literal["motor", "joint"] = "motor"

    @property
    def unit(self) -> str:
        """The unit of its effort, N or N m."""
        return "N" if self.slides else "N m"

    @property
    def place_unit(self) -> str:
        """The unit of its way, m or rad."""
        return "m" if self.slides else "rad"

    @property
    def motor_unit(self) -> str:
        """The unit at its motor: N m behind a gear, else that of its effort.

        What slides with a ratio of 1 is a linear motor or a cylinder: no motor turns 1 rad in 1 m.
        """
        linear = self.slides and (self.transmission is None or self.transmission.ratio == 1.0)
        return "N" if linear else "N m"

    @property
    def spring(self) -> Spring | None:
        """The line from torque to wind-up of an elastic gear; None for a rigid one."""
        gear = self.transmission
        return None if gear is None or gear.stiffness is None else spring_of(gear.stiffness)

    @property
    def ratio(self) -> float:
        """Motor turns per turn of the joint (rad/rad or rad/m), negative where it turns back."""
        return 1.0 if self.transmission is None else self.transmission.ratio


class Gears(NamedTuple):
    """Transmissions as arrays for kernels; an ideal drive has ratio 1 and no losses.

    Attributes:
        ratio, rotor_inertia: (na,) motor turns per joint turn; at the motor's shaft (kg m^2).
        viscous, power: (na,) the motor's viscous friction, N m (s/rad)^power.
        stick_velocity: (na,) at or below this speed the joint stands still (rad/s or m/s).
        no_load, no_load_static: (na, 2) no-load torque at the joint, in motion and at rest, for
            forward and backward motion of the joint (N m or N).
        constant, rise, exponent: (na, 2) factor constant + rise w^exponent on the loss due to the
            load, where the motor drives and where the load drives; w the motor's speed (rad/s).
        first, last: (na, 2) the first line of each loss, and the one after the last.
        load, loss, slope: (nl,) load at which each line begins, the loss there (N m or N), slope.
    """

    ratio: np.ndarray
    rotor_inertia: np.ndarray
    viscous: np.ndarray
    power: np.ndarray
    stick_velocity: np.ndarray
    no_load: np.ndarray
    no_load_static: np.ndarray
    constant: np.ndarray
    rise: np.ndarray
    exponent: np.ndarray
    first: np.ndarray
    last: np.ndarray
    load: np.ndarray
    loss: np.ndarray
    slope: np.ndarray


def gear_table(
    transmissions: Sequence[Transmission | None],
    stick_velocity: Sequence[float],
    brakes: Sequence[float] = (),
) -> Gears:
    """Return drives' transmissions (None: ideal), and their joints' stick velocities, as arrays.

    `brakes` are torques of closed brakes at the shafts (N m), added to the no-load torques; empty:
    all are open.
    """
    gears = [_IDEAL if gear is None else gear for gear in transmissions]
    viscous = [gear.motor_viscous or _FRICTIONLESS for gear in gears]
    losses = [loss for gear in gears for loss in gear.losses()]
    ends = np.cumsum([0, *(len(loss.loads) for loss in losses)], dtype=np.int64)
    no_load = np.array([_no_load(gear) for gear in gears], dtype=float).reshape(-1, 2, 2)
    for d, torque in enumerate(brakes):
        no_load[d] += abs(gears[d].ratio) * torque
    return Gears(
        ratio=np.array([gear.ratio for gear in gears], dtype=float),
        rotor_inertia=np.array([gear.rotor_inertia for gear in gears], dtype=float),
        viscous=np.array([term.coefficient for term in viscous], dtype=float),
        power=np.array([term.exponent for term in viscous], dtype=float),
        stick_velocity=np.array(stick_velocity, dtype=float),
        no_load=no_load[:, 0].copy(),
        no_load_static=no_load[:, 1].copy(),
        constant=np.array([loss.constant for loss in losses], dtype=float).reshape(-1, 2),
        rise=np.array([loss.rise for loss in losses], dtype=float).reshape(-1, 2),
        exponent=np.array([loss.exponent for loss in losses], dtype=float).reshape(-1, 2),
        first=ends[:-1].reshape(-1, 2).copy(),
        last=ends[1:].reshape(-1, 2).copy(),
        load=np.array([x for loss in losses for x in loss.loads], dtype=float),
        loss=np.array([x for loss in losses for x in loss.losses], dtype=float),
        slope=np.array([x for loss in losses for x in loss.slopes], dtype=float),
    )


_IDEAL, _FRICTIONLESS = Transmission(ratio=1.0), ViscousFriction(coefficient=0.0)


def _no_load(gear: Transmission) -> np.ndarray:
    """No-load torque (2, 2) in motion and at rest, for forward and backward motion of the joint."""
    if gear.no_load_torque is None:
        return np.zeros((2, 2))
    size, step = abs(gear.ratio), 1 if gear.ratio > 0 else -1
    kinetic, static = gear.no_load_torque.rows(None)[0][1], gear.no_load_torque.at_rest()
    ways = np.array([kinetic[1:], static[1:]])[:, ::step]
    return size * ways


def lossy_gears(gears: Gears) -> np.ndarray:
    """Return which gears (na,) have a loss due to the load or a no-load torque."""
    lines = zip(gears.first[:, 0], gears.last[:, 1], strict=True)
    loss = np.array(
        [gears.slope[first:last].any() or gears.loss[first:last].any() for first, last in lines],
        dtype=bool,
    )
    return np.asarray(loss | (gears.no_load_static > 0.0).any(axis=1))


def most_lines(gears: Gears) -> int:
    """Return the most lines that any gear has in one direction, those of both losses together."""
    return int((gears.last - gears.first).sum(axis=1).max(initial=1))


@inlined_kernel
def gears_of_row(gears: Gears, row: int) -> Gears:
    """Return one row of gears whose varying fields have a leading axis of rows."""
    return Gears(
        gears.ratio,
        gears.rotor_inertia[row],
        gears.viscous[row],
        gears.power,
        gears.stick_velocity,
        gears.no_load[row],
        gears.no_load_static[row],
        gears.constant,
        gears.rise,
        gears.exponent,
        gears.first,
        gears.last,
        gears.load,
        gears.loss,
        gears.slope,
    )


@kernel
def gear_line(
    gears: Gears, d: int, direction: float, speed: float, static: bool, effort: float
) -> tuple[float, float, float, float]:
    """Return the line that a gear follows around an effort, and the efforts at which it is valid.

    The torque at the gear's input, seen from the joint, u = r (T_m - J_rotor r a) - drag, is F(t) =
    slope t + offset: upper(t) forward, lower(t) backward (see the module).

    Args:
        direction: of the joint's motion, 1 or -1.
        speed: of the joint (rad/s or m/s).
        static: True for the torque that is needed to leave rest.
        effort: t (N m or N); where two lines meet, the one of larger efforts is returned.

    Returns:
        (slope, offset, least, greatest): the line holds for efforts from least to greatest.
    """
    side, size = 0 if direction > 0.0 else 1, abs(effort)
    up = effort >= 0.0  # at 0, too, the line of larger efforts
    way = 0 if up == (direction > 0.0) else 1
    factor = gears.constant[d, way]
    if gears.rise[d, way] > 0.0:
        w = abs(gears.ratio[d]) * speed
        factor += gears.rise[d, way] * power_of(w, gears.exponent[d, way])
    k, end = gears.first[d, way], gears.last[d, way]
    while k + 1 < end and (size > gears.load[k + 1] or (up and size == gears.load[k + 1])):
        k += 1
    rise = factor * gears.slope[k]
    offset = factor * gears.loss[k] - rise * gears.load[k]
    offset += gears.no_load_static[d, side] if static else gears.no_load[d, side]
    slope = 1.0 + rise if way == 0 else 1.0 - rise
    beyond = gears.load[k + 1] if k + 1 < end else np.inf
    if up:
        return slope, direction * offset, gears.load[k], beyond
    return slope, direction * offset, -beyond, -gears.load[k]


@kernel
def gear_drag(gears: Gears, d: int, velocity: float) -> float:
    """Return the motor's viscous friction at the joint, |r| c |r v|^p, with the sign of v."""
    size = abs(gears.ratio[d])
    drag = size * gears.viscous[d] * power_of(size * abs(velocity), gears.power[d])
    return drag if velocity > 0.0 else -drag


@kernel
def held_efforts(gears: Gears, d: int, given: float, found: np.ndarray) -> int:
    """Write the intervals of efforts that a gear at rest holds, and return how many there are.

    lower(t) <= u <= upper(t) is one interval, unless the gear is self-locking at some loads: then
    it holds small and large efforts and slips between.

    Args:
        given: u = r T_m (N m or N at the joint).
        found: (n, 2), overwritten; n above the number of the gear's lines.
    """
    slips, count = np.empty((found.shape[0], 2)), 0
    for direction in (1.0, -1.0):
        start, before = -np.inf, count
        while start < np.inf:
            slope, offset, first, last = gear_line(gears, d, direction, 0.0, True, start)
            rise, spare = direction * slope, direction * (given - offset)
            low, high = first, last
            if rise > 0.0:
                high = min(last, spare / rise)
            elif rise < 0.0:
                low = max(first, spare / rise)
            elif spare <= 0.0:
                high = first
            start = last
            if low >= high:
                continue
            if count > before and slips[count - 1, 1] == low and spare > rise * low:
                slips[count - 1, 1] = high
                continue
            slips[count, 0], slips[count, 1] = low, high
            count += 1
    least, held = -np.inf, 0
    for _ in range(count):  # those of both directions in order
        k = np.argmin(slips[:count, 0])
        if slips[k, 0] >= least and slips[k, 0] > -np.inf:
            found[held, 0], found[held, 1] = least, slips[k, 0]
            held += 1
        least = slips[k, 1]
        slips[k, 0] = np.inf
    if least < np.inf:
        found[held, 0], found[held, 1] = least, np.inf
        held += 1
    return held


@kernel
def slope_range(gears: Gears, d: int, speed: float) -> tuple[float, float]:
    """Return the least and the greatest slope of a gear's lines at a speed (rad/s or m/s).

    The gear is self-locking if the least slope is at most 0.
    """
    least, greatest = np.inf, -np.inf
    for way in (0, 1):
        factor = gears.constant[d, way]
        if gears.rise[d, way] > 0.0:
            w = abs(gears.ratio[d]) * speed
            factor += gears.rise[d, way] * power_of(w, gears.exponent[d, way])
        for k in range(gears.first[d, way], gears.last[d, way]):
            slope = 1.0 + (factor if way == 0 else -factor) * gears.slope[k]
            least, greatest = min(least, slope), max(greatest, slope)
    return least, greatest


@inlined_kernel
def gear_range(
    gears: Gears, d: int, direction: float, speed: float, static: bool, low: float, high: float
) -> tuple[float, float]:
    """Return least and greatest F(t) (`gear_line`) of finite efforts t from low to high.

    They lie at ends of the gear's lines.
    """
    slope, offset, _, last = gear_line(gears, d, direction, speed, static, low)
    least = greatest = slope * low + offset
    while last < high:
        value = slope * last + offset
        least, greatest = min(least, value), max(greatest, value)
        slope, offset, _, last = gear_line(gears, d, direction, speed, static, last)
    value = slope * high + offset
    return min(least, value), max(greatest, value)


@late_kernel("gears")
def write_motor_torques(
    gears: Gears,
    effort_lower: np.ndarray,
    effort_upper: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    at_rest: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> None:
    """Write the least and greatest motor torque (n, na) of each drive; see the module.

    Extremes are taken over the whole interval of efforts, because F(t) of a self-locking gear is
    not monotone.

    Args:
        effort_lower ... at_rest: (n, na), see `motor_torque_bounds`.
        lower, upper: (n, na), overwritten; NaN where the efforts are.
    """
    for i in range(lower.shape[0]):
        for d in range(lower.shape[1]):
            low, high, v = effort_lower[i, d], effort_upper[i, d], velocity[i, d]
            if low != low or high != high:
                lower[i, d] = upper[i, d] = np.nan
                continue
            if at_rest[i, d] or abs(v) <= gears.stick_velocity[d]:
                least, _ = gear_range(gears, d, -1.0, abs(v), True, low, high)
                _, greatest = gear_range(gears, d, 1.0, abs(v), True, low, high)
            else:
                way = 1.0 if v > 0.0 else -1.0
                least, greatest = gear_range(gears, d, way, abs(v), False, low, high)
            r = gears.ratio[d]
            motor_side = r * gears.rotor_inertia[d] * acceleration[i, d]
            motor_side += gear_drag(gears, d, v) / r
            ends = least / r + motor_side, greatest / r + motor_side
            lower[i, d], upper[i, d] = min(ends[0], ends[1]), max(ends[0], ends[1])


def joint_effort_ends(
    ratio: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and greatest `joint_effort`, r T_m (N m or N): the command at the joint.

    It contains the rigid body, rotors, friction and the losses of gears. `ratio` (na,) is negative
    where the motor turns back; `lower` and `upper` (..., na) are at the motors' shafts (N m).
    """
    ends = ratio * lower, ratio * upper
    return np.minimum(*ends), np.maximum(*ends)


def motor_torque_bounds(
    transmission: Transmission,
    effort_lower: np.ndarray,
    effort_upper: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    at_rest: np.ndarray,
    stick_velocity: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and greatest motor torque (N m at the motor's shaft) of each sample.

    T_m = [lower(t) or upper(t)]/r + viscous + r J_rotor a (see the module).

    Args:
        effort_lower, effort_upper: (T,) N m or N at the joint.
        velocity, acceleration: (T,) of the joint (rad/s or m/s, and per second).
        at_rest: (T,) True where the joint comes to rest between two samples.
        stick_velocity: at or below this speed the joint stands still (rad/s or m/s).
    """
    samples = effort_lower, effort_upper, velocity, acceleration, at_rest
    return gear_torque_bounds(gear_table([transmission], [stick_velocity]), *samples)


def gear_torque_bounds(
    gears: Gears,
    effort_lower: np.ndarray,
    effort_upper: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    at_rest: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return `motor_torque_bounds` of one drive, from its `gear_table`."""
    samples = effort_lower, effort_upper, velocity, acceleration, at_rest
    lower, upper = np.empty((2, len(effort_lower), 1))
    columns = (np.ascontiguousarray(sample)[:, None] for sample in samples)
    write_motor_torques(gears, *columns, lower, upper)
    return lower[:, 0], upper[:, 0]
