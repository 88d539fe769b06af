"""Friction compensation for controllers, which uses the joints' present load and is passive.

With the load c(q, v, a) of the bearings, a gear must deliver in a direction s = +-1 of motion

    t(s) = tau + sum_k |r_k| s (mu_k c_k + coulomb_k) + drag(v)

and must receive F_s(t), `drives.gear_line`. The compensation at the reference velocity v is

    D(v) = (1+s)/2 F_+(P t(+)) + (1-s)/2 F_-(P t(-)) - P tau - P drag(v),     s = S(v / v_s)
    out  = scale D(v) + viscous_scale (P drag + drag of the motor)(v)

S(x) = x (3 - x^2)/2 within |x| < 1, the sign of x beyond. For a drive that is not coupled, out v
never exceeds the power that the model's friction dissipates, if that friction jumps. Where friction
builds up over a way (`presliding`), and at a measured velocity, s is z, which the way travelled
since the last call moves: z <- clip(z + dq/way, -1, 1) (`notebooks/theory/compensation`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from pinfric.dynamics.problem.accelerations import is_normalized
from pinfric.dynamics.problem.machine import ChainState, read_sites
from pinfric.errors import PinfricError, StateError
from pinfric.kernels.compiled import kernel
from pinfric.kernels.records import record
from pinfric.model.arrays import real_numbers
from pinfric.model.bearings import normal_loads
from pinfric.model.couples import delivery, rate_rows, taking_part
from pinfric.model.drives import Gears, gear_drag, gear_line
from pinfric.model.laws import law_at
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION
from pinfric.model.scene import Scene, SiteTables
from pinfric.model.twin import PRISMATIC

#: The default factor at a measured velocity: friction that is 25 % too large is passive, too.
MEASURED_SCALE = 0.8
#: rad (m), the default way there: the largest found of joints is 2.5 mrad, at a Panda's sensors.
MEASURED_WAY = 0.003


@dataclass(frozen=True)
class CompensationOptions:
    """Options of the compensation; each is one number, or one number per drive.

    Attributes:
        scale: factor on dry friction and gear losses, at a desired velocity.
        viscous_scale: factor on friction that vanishes at rest, there.
        switch_velocity: v_s, the desired velocity below which the compensation changes direction
            (rad/s or m/s); one without noise needs no wide band.
        hold_error: position error at which the full break-away friction acts (rad or m); 0: off.
        limit: largest compensation (N m or N).
        power: largest power beyond that of friction (W); infinite: no limit.
        measured_scale: factor on all of it at a measured velocity, at most 1, and at most 1/(1 + e)
            with e the relative error of the friction's level.
        measured_way: way over which the compensation changes direction at a measured velocity, at
            least that over which the joint yields before it slips, the upper end of its interval
            (rad or m); None: 0.003, or twice the scene's `presliding.way` if that is more.
        hold_velocity: v_h, desired and measured velocity below which the hold acts, in place of v_s
            (rad/s or m/s): wider than the measured one's noise.
    """

    scale: Any = 1.0
    viscous_scale: Any = 1.0
    switch_velocity: Any = 0.002
    hold_error: Any = 0.0
    limit: Any = np.inf
    power: Any = np.inf
    measured_scale: Any = MEASURED_SCALE
    measured_way: Any = None
    hold_velocity: Any = 0.02

    def table(self, scene: Scene) -> np.ndarray:
        """Return the options as rows (9, na).

        Raises:
            StateError: not numbers of the drives, or below 0.
        """
        rows = np.empty((9, len(scene.drives)))
        for row, entry in zip(rows, fields(self), strict=True):
            where = f"{scene.source}: CompensationOptions.{entry.name}"
            given = getattr(self, entry.name)
            if given is None and entry.name == "measured_way":
                given = measured_ways(scene)
            numbers = real_numbers(where, given)
            if numbers.shape not in ((), row.shape) or not (numbers >= 0.0).all():
                raise StateError(
                    f"{where}: should be one number, or {row.size} (one per drive), not below 0; "
                    f"found {np.array2string(numbers, threshold=9)}"
                )
            row[:] = numbers
        if (rows[6] > 1.0).any():
            raise StateError(
                f"{scene.source}: CompensationOptions.measured_scale: {rows[6].max():g} drives a "
                "joint that moves; at a measured velocity at most 1, and 1/(1 + e) with e the "
                "error of the friction's level"
            )
        if not (rows[7] > 0.0).all():
            raise StateError(
                f"{scene.source}: CompensationOptions.measured_way: 0 drives a joint that yields "
                "before it slips; give at least the way over which it yields (rad or m)"
            )
        stated = ways_of_drives(scene)
        if (rows[7] < stated).any():
            d = int(np.argmax(rows[7] < stated))
            raise StateError(
                f"{scene.source}: CompensationOptions.measured_way: {rows[7, d]:g} is less than "
                f"the {stated[d]:g} of {scene.drives[d].name!r}.presliding.way: the joint would "
                "not rest after a push; give at least that, better the upper end of its interval"
            )
        return rows

    def tables(self, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
        """Return the options as a kernel takes them, of a desired and of a measured velocity.

        Rows: scale, viscous scale, band, hold, limit, power, way (0: the band counts), the hold's
        band.
        """
        rows = self.table(scene)
        desired, measured = rows[[0, 1, 2, 3, 4, 5, 7, 8]], rows[[6, 6, 2, 3, 4, 5, 7, 8]]
        desired[6] = ways_of_drives(scene)
        return desired, measured


#: Noise that options may pass on: changes of the direction from peak to peak in the measured mode
#: and of a hold, and standard deviations of the velocity within the hold's band.
_MEASURED_NOISE, _HOLD_NOISE, _DEVIATIONS = 0.05, 0.2, 5.0
#: Fewest samples at rest.
_AT_REST = 100


def quiet_options(
    scene: Scene, moved: np.ndarray, v_now: np.ndarray, options: CompensationOptions
) -> CompensationOptions:
    """Return options whose bands are wide enough for the noise of a record at rest.

    measured_way >= ptp(q)/0.05, hold_error >= 2.25 ptp(q)/0.2, hold_velocity >= 5 sd(v): so noise
    moves the measured mode's direction by at most 5 %, a hold's by at most 20 % of friction from
    peak to peak, and takes 8 % of break-away away at one standard deviation.

    Args:
        scene: of the compensator.
        moved: (T, nv) measured positions less the first. v_now: (T, nv) measured velocities.
        options: others are kept; a wider band, too. A hold_error of 0 stays 0 (off).

    Raises:
        StateError: too few samples, not finite, or the robot moved.
    """
    if len(moved) < _AT_REST:
        raise StateError(
            f"options_at_rest: {len(moved)} samples; give a second at rest, at least {_AT_REST}"
        )
    names, tenth = freedom_names(scene), len(moved) // 10
    for what, values in (("q", moved), ("v_now", v_now)):
        if not (good := np.isfinite(values)).all():
            k, i = np.argwhere(~good)[0]
            raise StateError(f"options_at_rest: {what}: {names[i]!r}: not finite in sample {k}")
    drift = np.abs(moved[-tenth:].mean(axis=0) - moved[:tenth].mean(axis=0))
    counts = np.array([np.unique(column).size for column in moved.T])
    gone = (drift > 0.5 * np.ptp(moved, axis=0)) & (counts > 3)  # else two counts of an encoder
    if gone.any():
        i = int(np.argmax(gone))
        raise StateError(
            f"options_at_rest: {names[i]!r} moved by {drift[i]:.3g} rad or m from the first to the "
            "last tenth: record it at rest, with the brakes closed if it has any"
        )
    rate, table = rate_rows(scene.drives, scene.model.nv), options.table(scene)
    places, speeds = moved @ rate.T, v_now @ rate.T
    jumps = np.ptp(places, axis=0)
    hold = np.where(table[3] > 0.0, np.maximum(table[3], 2.25 * jumps / _HOLD_NOISE), 0.0)
    return replace(
        options,
        measured_way=np.maximum(table[7], jumps / _MEASURED_NOISE),
        hold_error=hold,
        hold_velocity=np.maximum(table[8], _DEVIATIONS * speeds.std(axis=0)),
    )


def ways_of_drives(scene: Scene) -> np.ndarray:
    """Return (na,) the ways over which the friction of drives and their joints builds up; 0: none.

    Raises:
        PinfricError: coupled drives, whose joints build up over other ways than they.
    """
    ways = scene.ways
    if ways is None:
        return np.zeros(len(scene.drives))
    of_drives, own = ways.way[ways.of_drive], [drive.velocity_index for drive in scene.drives]
    for drive, way, joint in zip(scene.drives, of_drives, ways.way[own], strict=True):
        if way != joint:
            raise PinfricError(
                f"{scene.source}: {drive.name}: a compensator takes one way for a coupled drive "
                f"and its joint; found {way:g} and {joint:g} (`presliding.way`)"
            )
    return of_drives


def measured_ways(scene: Scene) -> np.ndarray:
    """Return (na,) the default of `measured_way`; twice a stated way covers a gradual build-up."""
    return np.maximum(MEASURED_WAY, 2.0 * ways_of_drives(scene))


class Compensated(NamedTuple):
    """Constant tables of a scene for the kernels.

    Attributes:
        sites: `Scene.site_tables`, `joint` the row of the site itself. gears: of the scene.
        own: (na,) velocity of each drive's joint.
        rate, delivery: (na, nv), (na, na) of drives, see `couples`.
        together: (nv,) whether a drive's joint turns with other drives: its directions differ.
    """

    sites: SiteTables
    gears: Gears
    own: np.ndarray
    rate: np.ndarray
    delivery: np.ndarray
    together: np.ndarray


class Directions(NamedTuple):
    """Directions in [-1, 1] and shares of break-away in [0, 1].

    Attributes:
        joint, joint_leaving: (nv,). drive, drive_leaving: (na,).
    """

    joint: np.ndarray
    joint_leaving: np.ndarray
    drive: np.ndarray
    drive_leaving: np.ndarray


def check_compensated(scene: Scene, based: bool = False) -> None:
    """Refuse a scene whose compensation has no bound on its computing time, or is undetermined.

    Args:
        based: whether joints without drives may be in it, as the floating base of a legged robot.

    Raises:
        PinfricError: names the loop, drive off the joints, joint of several degrees of freedom,
            joint without a drive or with several, or guide without width.
    """
    if scene.closed_by:
        raise PinfricError(
            f"{scene.source}: {scene.closed_by}: there friction and reactions depend on each "
            "other, and solving that has no time limit; a compensator takes open chains with "
            "drives at their joints"
        )
    if not scene.joint_names:
        raise PinfricError(f"{scene.source}: has no joint that a compensator could act on")
    for name, components in zip(scene.joint_names, scene.twin().components, strict=True):
        if components[0] >= 0 and not based:
            raise PinfricError(
                f"{scene.source}: joint {name!r} has several degrees of freedom; a compensator "
                "needs joints of one degree, each with its drive; lock it (robot.locked), or of a "
                "legged robot give the scene of its fixed base"
            )
    own, names = [drive.velocity_index for drive in scene.drives], freedom_names(scene)
    for v, name in enumerate(names):
        if own.count(v) != 1 and not (based and own.count(v) == 0):
            raise PinfricError(
                f"{scene.source}: actuators: joint {name!r} has "
                f"{'several drives' if own.count(v) else 'no drive'}; a compensator needs one "
                "drive for each degree of freedom"
            )
    for site in scene.sites:
        if site.friction.bearing is not None and site.friction.bearing.roll_lever() is not None:
            raise PinfricError(
                f"{scene.source}: friction.{site.name}.bearing.width: missing; a compensator "
                "cannot stop at a moment about the axis, which a guide without width does not "
                "carry; give it"
            )


def freedom_names(scene: Scene) -> list[str]:
    """Return the joint of each velocity of an open chain of joints of one degree of freedom."""
    twin, names = scene.twin(), [""] * scene.model.nv
    for row, name in reversed(list(enumerate(scene.joint_names))):
        names[twin.v_index[row]] = name  # a joint comes before those that mimic it
    return names


def make_compensated(scene: Scene) -> Compensated:
    """Tabulate a scene.

    Raises:
        PinfricError: see `check_compensated`.
    """
    check_compensated(scene, based=True)
    tables, nv, drives = scene.site_tables, scene.model.nv, scene.drives
    P, coupled = delivery(drives, nv), taking_part(drives)
    own = np.array([drive.velocity_index for drive in drives], dtype=np.int64)
    return Compensated(
        sites=tables._replace(joint=np.arange(len(scene.sites))),
        gears=scene.gears(),
        own=own,
        rate=rate_rows(drives, nv),
        delivery=P if P.size else np.eye(len(drives)),
        together=np.isin(np.arange(nv), own[list(coupled)]),
    )


class Reach(NamedTuple):
    """Positions and speeds beyond which a state is no robot's: a wrong unit, a broken sensor.

    Attributes:
        least, greatest: (nv,) rad or m. fastest: (nv,) rad/s or m/s.
    """

    least: np.ndarray
    greatest: np.ndarray
    fastest: np.ndarray


class Travelled(NamedTuple):
    """What a controller's calls keep: [0] of desired positions, [1] of measured ones.

    Attributes:
        begun: (2,) whether `before` is known.
        before: (2, nq) positions of the last call.
        share: (2, 2, na) z in [-1, 1]: of each drive, and of the joint on which it acts.
    """

    begun: np.ndarray
    before: np.ndarray
    share: np.ndarray

    @classmethod
    def none(cls, nq: int, na: int) -> Travelled:
        """Return that of a controller that begins: no direction is known, so z is 0."""
        return cls(np.zeros(2, dtype=bool), np.zeros((2, nq)), np.zeros((2, 2, na)))


class CompensatedSample(NamedTuple):
    """What a kernel needs of a thread's solver beside the arguments of a call.

    Attributes:
        tables: of the scene.
        chain: of the last RNEA.
        reach: see `reach`. position: (nv,) index in q of a joint's one position, or -1.
        circle: (nv,) index in q of the cosine of a joint that turns without end, or -1.
        travelled: it is moved on by each call.
        wrench, displacement, load: (1, ns, 6), (1, ns), (1, ns) buffers.
    """

    tables: Compensated
    chain: ChainState
    reach: Reach
    position: np.ndarray
    circle: np.ndarray
    travelled: Travelled
    wrench: np.ndarray
    displacement: np.ndarray
    load: np.ndarray


box_compensated = record(CompensatedSample)


def check_used(scene: Scene, rows: np.ndarray, error: bool, v_now: bool, measured: bool) -> None:
    """Refuse options that could do nothing: `hold_error` and `power` need what is measured.

    Args:
        scene: for the message. rows: `CompensationOptions.tables`.
        error, v_now: whether they are given. measured: whether the velocity is.

    Raises:
        StateError: names the option.
    """
    holding = rows[3] > 0.0
    if measured and holding.any():
        raise StateError(
            f"{scene.source}: CompensationOptions.hold_error: needs a desired velocity; at a "
            "measured one it would drive the joint: give 0"
        )
    if (holding & (rows[6] > 0.0)).any():
        raise StateError(
            f"{scene.source}: CompensationOptions.hold_error: does nothing where friction builds "
            "up over a way (`presliding`): give 0"
        )
    if (holding & (rows[7] == 0.0)).any():
        raise StateError(f"{scene.source}: CompensationOptions.hold_error: needs a hold_velocity")
    if holding.any() and not (error and v_now):
        raise StateError(f"{scene.source}: CompensationOptions.hold_error: needs error and v_now")
    if not v_now and (rows[5] < np.inf).any():
        raise StateError(f"{scene.source}: CompensationOptions.power: needs v_now")


#: rad/s^2 (m/s^2); rad (m) of a position error; of positions and speeds without limits.
LARGEST_ACCELERATION = LARGEST_ERROR = 1e6


def reach(scene: Scene) -> Reach:
    """Return one turn (1 m) beyond each joint's limits, and ten times its greatest speed."""
    model, nv = scene.model, scene.model.nv
    bounds = Reach(np.full(nv, -1e6), np.full(nv, 1e6), np.full(nv, 1e6))
    for row, joint in enumerate(list(model.joints)[1:]):
        if joint.nv != 1:
            continue
        v, sliding = joint.idx_v, scene.twin().kind[row] == PRISMATIC
        spare = 1.0 if sliding else 2.0 * np.pi
        if joint.nq == 1:
            low, high = (
                x[joint.idx_q] for x in (model.lowerPositionLimit, model.upperPositionLimit)
            )
            bounds.least[v] = max(np.nan_to_num(low, nan=-1e6) - spare, -1e6)
            bounds.greatest[v] = min(np.nan_to_num(high, nan=1e6) + spare, 1e6)
        if model.velocityLimit[v] > 0.0:
            bounds.fastest[v] = 10.0 * min(model.velocityLimit[v], 1e5)
    return bounds


def check_reach(
    scene: Scene, bounds: Reach, positions: Mapping[str, np.ndarray], motion: Mapping[str, Any]
) -> None:
    """Refuse a state that no robot has.

    Args:
        bounds: `reach`. positions: q, q_ref: (nq,) each.
        motion: v, a, v_ref, error, v_now: (nv,) each, or None.

    Raises:
        StateError: the joint, its figure and what is allowed.
    """
    place = [(joint.idx_q, joint.idx_v) for joint in list(scene.model.joints)[1:] if joint.nq == 1]
    at, of = np.array(place, dtype=int).reshape(-1, 2).T
    largest = {"a": LARGEST_ACCELERATION, "error": LARGEST_ERROR}
    checked = [
        (name, q[at], bounds.least[of], bounds.greatest[of], of) for name, q in positions.items()
    ]
    for name, values in motion.items():
        if values is not None:
            top = np.broadcast_to(largest.get(name, bounds.fastest), values.shape)
            checked.append((name, values, -top, top, np.arange(values.size)))
    for name, values, low, high, column in checked:
        inside = (values >= low) & (values <= high)
        if not inside.all():
            i = int(np.argmin(inside))
            raise StateError(
                f"{name}: {freedom_names(scene)[column[i]]!r}: {values[i]:g}: should be a number "
                f"from {low[i]:.4g} to {high[i]:.4g} (rad or m, s); in degrees?"
            )


@kernel
def smooth_sign(x: float) -> float:
    """Return S(x) = x (3 - x^2)/2 within |x| < 1, the sign of x beyond."""
    return min(max(0.5 * x * (3.0 - x * x), -1.0), 1.0) if abs(x) < 1.0 else np.sign(x)


@kernel
def _bell(x: float) -> float:
    """(1 - x^2)^2 within |x| < 1, 0 beyond."""
    return max(1.0 - x * x, 0.0) ** 2


@kernel
def _direct(
    v_ref: float, band: float, error: float, hold: float, v_now: float, slow: float
) -> tuple[float, float]:
    """Return a direction and its share of break-away, which fades as the joint slips.

    Args:
        v_ref, band: reference velocity, v_s. error, hold: position error, `hold_error` or 0.
        v_now, slow: measured velocity, v_h.
    """
    if hold > 0.0:
        x = v_ref / slow
        direction = smooth_sign(x + _bell(x) * smooth_sign(error / hold))
        return direction, _bell(v_now / slow) * abs(direction)
    return (smooth_sign(v_ref / band) if band > 0.0 else np.sign(v_ref)), 0.0


@kernel
def friction_of(
    t: Compensated,
    effort: np.ndarray,
    load: np.ndarray,
    v: np.ndarray,
    to: Directions,
    dry: np.ndarray,
    drag: np.ndarray,
) -> None:
    """Write D of each drive, and the part of its friction that vanishes at rest, at velocities v.

    Args:
        t: `make_compensated`. effort: (nv,) tau. load: (ns,) normal loads. v: (nv,).
        to: directions.
        dry, drag: (na,) N m or N, overwritten.
    """
    ahead, back, rest, slow = np.zeros((4, v.size))
    for s in range(load.size):
        i, r = t.sites.velocity_index[s], t.sites.ratio[s]
        rate, size, leaving, c = r * v[i], abs(r), to.joint_leaving[i], load[s]
        now = law_at(t.sites.laws, s, rate)
        mu = (1.0 - leaving) * now.mu + leaving * now.static_mu
        forward = (1.0 - leaving) * now.forward + leaving * now.static_forward
        backward = (1.0 - leaving) * now.backward + leaving * now.static_backward
        ahead[i] += size * (mu * c + (forward if r >= 0.0 else backward))
        back[i] += size * (mu * c + (backward if r >= 0.0 else forward))
        slow[i] += r * (now.viscous * rate + np.copysign(now.drag_mu * c + now.drag, rate))
    for i in range(v.size):
        s = to.joint[i]
        rest[i] = effort[i] + slow[i]
        if t.together[i]:  # its gears' directions are not the joint's
            blend = 0.5 * (1.0 + s) * ahead[i] - 0.5 * (1.0 - s) * back[i]
            ahead[i], back[i] = blend, -blend
    for d in range(dry.size):
        s, leaving, rate = to.drive[d], to.drive_leaving[d], 0.0
        plus = minus = without = damping = 0.0
        for i in range(v.size):
            rate += t.rate[d, i] * v[i]
        for e in range(dry.size):
            P, i = t.delivery[d, e], t.own[e]
            plus += P * (rest[i] + ahead[i])
            minus += P * (rest[i] - back[i])
            without += P * rest[i]
            damping += P * slow[i]
        forward = 0.5 * (1.0 + s) * _arriving(t.gears, d, 1.0, abs(rate), leaving, plus)
        backward = 0.5 * (1.0 - s) * _arriving(t.gears, d, -1.0, abs(rate), leaving, minus)
        dry[d] = forward + backward - without
        drag[d] = damping + gear_drag(t.gears, d, rate)


@kernel
def _arriving(
    gears: Gears, d: int, direction: float, speed: float, leaving: float, effort: float
) -> float:
    """Return F(t), blended by the share `leaving` with the torque needed to leave rest."""
    slope, offset, _, _ = gear_line(gears, d, direction, speed, False, effort)
    if leaving > 0.0:
        _, static, _, _ = gear_line(gears, d, direction, speed, True, effort)
        offset = (1.0 - leaving) * offset + leaving * static
    return slope * effort + offset


@kernel
def compensate(
    t: Compensated,
    effort: np.ndarray,
    load: np.ndarray,
    v_ref: np.ndarray,
    error: np.ndarray,
    v_now: np.ndarray,
    given: np.ndarray,
    options: np.ndarray,
    share: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the compensation of each drive; see the module's text.

    Args:
        t, effort, load: see `friction_of`.
        v_ref, error, v_now: (nv,).
        given: (2,) bool: whether `error` is given for a hold; whether v_now is given.
        options: (8, na), see `CompensationOptions.tables`.
        share: (2, na) z of each drive and of its own joint, used where it has a way.
        out: (na,) N m or N at the joints, overwritten.
    """
    nv, na = v_ref.size, out.size
    dry, drag, now = np.empty(na), np.empty(na), np.zeros(na)
    to = Directions(np.zeros(nv), np.zeros(nv), np.empty(na), np.empty(na))
    for d in range(na):
        band, slow, hold = options[2, d], options[7, d], options[3, d] if given[0] else 0.0
        rate = wrong = 0.0
        for i in range(nv):
            rate += t.rate[d, i] * v_ref[i]
            wrong += t.rate[d, i] * error[i]
            now[d] += t.rate[d, i] * v_now[i]
        i = t.own[d]
        if options[6, d] > 0.0:
            to.drive[d], to.joint[i] = share[0, d], share[1, d]
            to.drive_leaving[d] = 0.0
            continue
        to.joint[i], to.joint_leaving[i] = _direct(v_ref[i], band, error[i], hold, v_now[i], slow)
        to.drive[d], to.drive_leaving[d] = _direct(rate, band, wrong, hold, now[d], slow)
    friction_of(t, effort, load, v_ref, to, dry, drag)
    for d in range(na):
        total = options[0, d] * dry[d] + options[1, d] * drag[d]
        out[d] = min(max(total, -options[4, d]), options[4, d])
    if not (given[1] and options[5].min() < np.inf):
        return
    for d in range(na):
        i = t.own[d]
        to.joint[i], to.drive[d] = np.sign(v_now[i]), np.sign(now[d])
        to.joint_leaving[i] = to.drive_leaving[d] = 0.0
    friction_of(t, effort, load, v_now, to, dry, drag)
    for d in range(na):
        lost = dry[d] + drag[d]
        if out[d] * now[d] > lost * now[d] + options[5, d]:
            out[d] = lost + options[5, d] / now[d]


@kernel
def _travel(
    x: CompensatedSample, whose: int, q: np.ndarray, v: np.ndarray, options: np.ndarray
) -> None:
    """Move the shares of drives with a way on to positions q (nq,).

    Args:
        x: of the solver; `travelled` changes. whose: 0 of desired positions, 1 of measured ones.
        v: (nv,), its length only. options: see `compensate`.
    """
    t, before, moved = x.tables, x.travelled.before[whose], np.zeros(v.size)
    if x.travelled.begun[whose]:
        for i in range(v.size):
            k, c = x.position[i], x.circle[i]
            if k >= 0:
                moved[i] = q[k] - before[k]
            elif c >= 0:
                across = q[c + 1] * before[c] - q[c] * before[c + 1]
                moved[i] = np.arctan2(across, q[c] * before[c] + q[c + 1] * before[c + 1])
            if abs(moved[i]) > np.pi:  # an angle that was counted from the other side
                moved[i] -= np.copysign(2.0 * np.pi, moved[i])
    share = x.travelled.share[whose]
    for d in range(options.shape[1]):
        if options[6, d] > 0.0:
            rate = 0.0
            for i in range(v.size):
                rate += t.rate[d, i] * moved[i]
            share[0, d] = min(max(share[0, d] + rate / options[6, d], -1.0), 1.0)
            own = moved[t.own[d]]
            share[1, d] = min(max(share[1, d] + own / options[6, d], -1.0), 1.0)
    before[:] = q
    x.travelled.begun[whose] = True


@kernel
def compensate_sample(
    x: CompensatedSample,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    v_ref: np.ndarray,
    error: np.ndarray,
    v_now: np.ndarray,
    q_ref: np.ndarray,
    given: np.ndarray,
    options: np.ndarray,
    out: np.ndarray,
) -> bool:
    """Write the compensation at the last state that RNEA computed, or all of `joint_effort`.

    Args:
        x: of the solver. q, q_ref: (nq,), that of the load, and that which moves z on.
        v, a, v_ref, error, v_now: (nv,).
        given: (4,) bool: see `compensate`; whether rigid body and rotors are in it; whether the
            velocity is measured.
        options, out: see `compensate`.

    Returns:
        False: a state beyond `reach`, not normalized, or a result that is not finite.
    """
    for i in range(v.size):
        k, fastest = x.position[i], x.reach.fastest[i]
        if k >= 0:
            least, greatest = x.reach.least[i], x.reach.greatest[i]
            if not (least <= q[k] <= greatest and least <= q_ref[k] <= greatest):
                return False
        if not (abs(v[i]) <= fastest and abs(v_ref[i]) <= fastest and abs(v_now[i]) <= fastest):
            return False
        if not (abs(a[i]) <= LARGEST_ACCELERATION and abs(error[i]) <= LARGEST_ERROR):
            return False
    for i in range(q.size):
        if not (abs(q[i]) <= LARGEST_OF_A_MOTION and abs(q_ref[i]) <= LARGEST_OF_A_MOTION):
            return False
    t, chain, wrench, displacement, load = x.tables, x.chain, x.wrench, x.displacement, x.load
    if not is_normalized(chain.unit_first, chain.unit_count, q):
        return False
    read_sites(chain, q, wrench[0], displacement[0])
    normal_loads(wrench, t.sites.joint, t.sites.contacts, displacement, load)
    whose = 1 if given[3] else 0
    if options[6].max() > 0.0:
        _travel(x, whose, q_ref, v, options)
    share = x.travelled.share[whose]
    compensate(t, chain.h, load[0], v_ref, error, v_now, given, options, share, out)
    finite = True
    for d in range(out.size):
        if given[2]:
            change = 0.0
            for i in range(v.size):
                change += t.rate[d, i] * a[i]
            for e in range(out.size):
                out[d] += t.delivery[d, e] * chain.h[t.own[e]]
            out[d] += t.gears.ratio[d] ** 2 * t.gears.rotor_inertia[d] * change
        finite &= abs(out[d]) < np.inf
    return finite
