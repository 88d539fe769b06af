"""Friction that builds up along a motion: its share z in [-1, 1] of each coordinate.

    z <- clip(z + dq/d, -1, 1)

exact for any step within which the motion is monotone. Where the history is not known, both ends
are carried, from -1 and 1: they meet after 2 d of travel.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.samples.motion_kernels import TreeSamples
from pinfric.dynamics.samples.states import States
from pinfric.errors import PinfricWarning, StateError
from pinfric.kernels.compiled import kernel
from pinfric.model.arrays import real_numbers
from pinfric.model.coordinates import one_number
from pinfric.model.drives import Gears, gear_drag, gear_range
from pinfric.model.laws import law_at
from pinfric.model.presliding import GRADUAL, Ways
from pinfric.model.scene import Scene, SiteTables

#: Share of the amplitude of its usual stroke above which a way is long.
_OF_AMPLITUDE = 0.25


@dataclass(frozen=True)
class BuiltUp:
    """Shares z of friction that has built up, in [-1, 1]; 1: in full against forward motion.

    Attributes:
        lower, upper: (T, ns) of the sites; equal where the history is known. Where nothing builds
            up, the sign of the velocity; at rest -1 and 1.
        drive_lower, drive_upper: (T, na) the same of the drives' gears.
    """

    lower: np.ndarray
    upper: np.ndarray
    drive_lower: np.ndarray
    drive_upper: np.ndarray

    def part(self, part: slice) -> BuiltUp:
        """Return the samples of one slice."""
        return BuiltUp(*(array[part] for array in vars(self).values()))


def built_up(scene: Scene, states: States, position_known: float | None) -> BuiltUp | None:
    """Return the shares of a motion; None where friction acts at once, or samples have no order.

    Args:
        position_known: how well positions at rest are known (rad or m); None: not to a way.

    Raises:
        StateError: a `position_known` that is no size, or has nothing to act on.
        PinfricWarning: a way that is long beside the motion's strokes.
    """
    ways = scene.ways
    if position_known is not None:
        _check_known(scene, states, position_known)
    if ways is None or states.t is None:
        return None
    angles, rates = _coordinates(scene, ways, states)
    stick = _stick_velocities(scene, ways)
    _warn_of_long_ways(scene, ways, angles, rates, stick)
    known = np.inf if position_known is None else float(position_known)
    low, high = np.empty(rates.shape), np.empty(rates.shape)
    elements = np.where(ways.gradual[:, None], GRADUAL, [1.0, np.nan, np.nan]) * ways.way[:, None]
    carry_shares(states.t, angles, rates, stick, elements, known, low, high)
    tables = scene.site_tables
    at, back = tables.velocity_index, tables.ratio < 0.0
    ends = low[:, at], high[:, at]
    lower, upper = np.where(back, -ends[1], ends[0]), np.where(back, -ends[0], ends[1])
    of_drives = low[:, ways.of_drive], high[:, ways.of_drive]
    return BuiltUp(lower, upper, *of_drives)


def _check_known(scene: Scene, states: States, position_known: float) -> None:
    known = real_numbers("position_known", position_known)
    if known.shape != () or not 0.0 <= known < np.inf:
        raise StateError(f"position_known: {position_known!r}; should be a size (rad or m)")
    if scene.ways is None or states.t is None:
        lacks = "no `presliding`" if scene.ways is None else "a motion without times"
        raise StateError(
            f"position_known: {scene.source} has {lacks}, so it does nothing: leave it out"
            if scene.ways is None
            else f"position_known: needs the order of the samples, and there is {lacks}: give `t`"
        )


def _coordinates(scene: Scene, ways: Ways, states: States) -> tuple[np.ndarray, np.ndarray]:
    """(T, nc) positions and velocities of the coordinates on which friction acts."""
    angles = np.zeros(states.v.shape)
    for joint in list(scene.model.joints)[1:]:
        if joint.nv == 1:
            angles[:, joint.idx_v] = one_number(joint, states.q)
    nv = states.v.shape[1]
    if len(ways.rate) == nv:
        return angles, states.v
    more = ways.rate[nv:].T
    return np.hstack([angles, angles @ more]), np.hstack([states.v, states.v @ more])


def _stick_velocities(scene: Scene, ways: Ways) -> np.ndarray:
    """(nc,) rad/s or m/s at or below which each coordinate rests."""
    stick = np.full(len(ways.way), scene.stick_velocity)
    for site in scene.sites:
        if site.ratio == 1.0:
            stick[site.velocity_index] = site.law.stick_velocity
    for drive, at in zip(scene.drives, ways.of_drive.tolist(), strict=True):
        if at >= scene.model.nv:
            stick[at] = scene.stick_velocity_of(drive)
    return stick


def _warn_of_long_ways(
    scene: Scene, ways: Ways, angles: np.ndarray, rates: np.ndarray, stick: np.ndarray
) -> None:
    """Warn of ways so long beside a motion's strokes that friction hardly ever acts in full.

    As in `identify`, above a quarter of the amplitude of the usual stroke. `angles`, `rates`: (T,
    nc) of the coordinates; `stick`: (nc,) velocities at or below which they rest.
    """
    long = []
    for c in np.flatnonzero(ways.way > 0.0).tolist():
        moves = np.flatnonzero(np.abs(rates[:, c]) > stick[c])
        if not moves.size:
            continue
        turned = moves[1:][np.diff(np.sign(rates[moves, c])) != 0.0]
        ends = angles[np.concatenate((moves[:1], turned, moves[-1:])), c]
        amplitudes = 0.5 * np.abs(np.diff(ends))
        usual = float(np.median(amplitudes))
        if ways.way[c] > _OF_AMPLITUDE * usual:
            long.append(
                f"{_name_of(scene, ways, c)} has a way of {ways.way[c]:.3g}, and its usual "
                f"amplitude between reversals is {usual:.3g} (smallest {amplitudes.min():.3g})"
            )
    if long:
        text = (
            f"{scene.source}: presliding: {'; '.join(long)}, rad or m: above a quarter of it "
            "friction hardly ever acts in full"
        )
        warnings.warn(text, PinfricWarning, stacklevel=4)


def _name_of(scene: Scene, ways: Ways, coordinate: int) -> str:
    """Name the joint, or the coupled drive, whose coordinate it is."""
    if coordinate < scene.model.nv:
        joints = zip(scene.model.names, scene.model.joints, strict=True)
        return next(str(n) for n, joint in joints if joint.nv == 1 and joint.idx_v == coordinate)
    of_drive = ways.of_drive.tolist()
    return next(d.name for d, at in zip(scene.drives, of_drive, strict=True) if at == coordinate)


@kernel
def _step(z: float, moved: float, way: float) -> float:
    """Return z after a monotone motion by `moved` (rad or m)."""
    return min(max(z + moved / way, -1.0), 1.0)


@kernel
def _to_turn(moved: float, before: float, after: float, duration: float) -> float:
    """Return the part of a motion until it turns, with a velocity that changes evenly.

    What the positions say beyond that is spread evenly in time.

    Args:
        moved: rad or m in all. before, after: velocities of opposite sign. duration: s.
    """
    share = before / (before - after)
    ahead, back = 0.5 * before * share * duration, 0.5 * after * (1.0 - share) * duration
    return ahead + (moved - ahead - back) * share


@kernel
def carry_shares(
    t: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    stick: np.ndarray,
    ways: np.ndarray,
    known: float,
    low: np.ndarray,
    high: np.ndarray,
) -> None:
    """Write both ends of the share z of each coordinate along a motion.

    A rest of two samples or more is a hold: the ends part by known/d when it begins to move again,
    and as long as it rests. A single sample at rest, a turning point, has the ends of a hold, too,
    but the motion goes on with what was known before.

    Args:
        t: (T,) s. position, velocity: (T, nc). stick: (nc,) velocity at or below which it rests.
        ways: (nc, 3) of the stops whose mean share counts; the first 0: none; NaN: no such stop.
        known: how well positions at rest are known (rad or m).
        low, high: (T, nc), overwritten.
    """
    least, greatest = np.empty(3), np.empty(3)
    for c in range(ways.shape[0]):
        if not ways[c, 0] > 0.0:
            for i in range(t.size):
                v = velocity[i, c]
                resting = abs(v) <= stick[c]
                low[i, c] = -1.0 if resting else np.sign(v)
                high[i, c] = 1.0 if resting else np.sign(v)
            continue
        count = 3 if ways[c, 1] == ways[c, 1] else 1
        least[:], greatest[:] = -1.0, 1.0
        stood = False
        for i in range(t.size):
            v = velocity[i, c]
            resting = abs(v) <= stick[c]
            if i > 0:
                before, moved = velocity[i - 1, c], position[i, c] - position[i - 1, c]
                rested = abs(before) <= stick[c]
                stood = (stood or rested) if resting else stood
                first = moved
                if not resting and not rested and (v > 0.0) != (before > 0.0):
                    first = _to_turn(moved, before, v, t[i] - t[i - 1])
                for k in range(count):
                    way = ways[c, k]
                    if stood and not resting:
                        least[k] = max(least[k] - known / way, -1.0)
                        greatest[k] = min(greatest[k] + known / way, 1.0)
                    least[k] = _step(_step(least[k], first, way), moved - first, way)
                    greatest[k] = _step(_step(greatest[k], first, way), moved - first, way)
                stood = stood and resting
            total_least = total_greatest = 0.0
            for k in range(count):
                apart = known / ways[c, k] if resting else 0.0
                total_least += max(least[k] - apart, -1.0)
                total_greatest += min(greatest[k] + apart, 1.0)
            low[i, c], high[i, c] = total_least / count, total_greatest / count


@kernel
def build_up_friction(
    sites: SiteTables,
    built: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    x: TreeSamples,
    ahead: np.ndarray,
    back: np.ndarray,
) -> None:
    """Replace the friction of sites that build it up, and write their joints' efforts at z = +-1.

    phi(z) = (1 + z)/2 phi_+ + (1 - z)/2 phi_-, the ends of today's law at the sample's speed, at
    rest its static ones. What has built up in full is left as it is.

    Args:
        sites: `Scene.site_tables`. built: (ns,) bool, whether the site has a way.
        low, high: (n, ns) ends of z.
        x: whose friction is known without ways.
        ahead, back: (n, nv), overwritten: efforts of the joints, their friction built up in full
            against forward, backward motion, where that of a site is not; else any.
    """
    ahead[:], back[:] = x.effort_frictionless, x.effort_frictionless
    for i in range(low.shape[0]):
        for s in range(low.shape[1]):
            v, c, r = x.velocity[i, s], x.normal_load[i, s], sites.ratio[s]
            at, least, most = (
                sites.velocity_index[s],
                x.friction_lower[i, s],
                x.friction_upper[i, s],
            )
            rests, lo, hi = x.sticking[i, s], low[i, s], high[i, s]
            if built[s] and not (rests and lo == -1.0 and hi == 1.0):
                if not rests:
                    if lo == hi == np.sign(v) and not x.reversal[i, s]:
                        continue
                    law = law_at(sites.laws, s, v)
                    drag = law.viscous * v + np.copysign(law.drag_mu * c + law.drag, v)
                    least = -(law.mu * c + law.forward) - drag
                    most = law.mu * c + law.backward - drag
                x.friction_lower[i, s] = 0.5 * (1.0 + hi) * least + 0.5 * (1.0 - hi) * most
                x.friction_upper[i, s] = 0.5 * (1.0 + lo) * least + 0.5 * (1.0 - lo) * most
            ahead[i, at] -= r * (least if r >= 0.0 else most)
            back[i, at] -= r * (most if r >= 0.0 else least)


@kernel
def build_up_torques(
    gears: Gears,
    built: np.ndarray,
    coupled: np.ndarray,
    shares: tuple[np.ndarray, np.ndarray],
    efforts: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    torques: tuple[np.ndarray, np.ndarray],
) -> None:
    """Replace the motor torques of drives whose losses build up, where they are not built up.

    T_m r = (1 + z)/2 F_+(t_+) + (1 - z)/2 F_-(t_-) + motor: the two ends are blended, never the
    load t, as in `notebooks/theory/compensation.md`.

    Args:
        gears: of the drives. built, coupled: (na,) bool, whether a drive has a way, whether it is
            coupled: then t is what its joints need, whatever its own direction.
        shares: (n, na) ends of z.
        efforts: (n, na) least, greatest, and with the joints' friction built up in full against
            forward, backward motion.
        motion: (n, na) velocities and accelerations of the drives, and whether they turn there.
        torques: (n, na) least and greatest, N m at the shafts, changed.
    """
    (low, high), (velocity, acceleration, turns), (lower, upper) = shares, motion, torques
    least_effort, greatest_effort, ahead, back = efforts
    for d in range(built.size):
        for i in range(low.shape[0] if built[d] else 0):
            v, lo, hi = velocity[i, d], low[i, d], high[i, d]
            rests = abs(v) <= gears.stick_velocity[d]
            known = lo == hi == np.sign(v) and not turns[i, d]
            if (lo == -1.0 and hi == 1.0) if rests else known:
                continue
            plus = (ahead[i, d], ahead[i, d])
            minus = (back[i, d], back[i, d])
            if coupled[d]:
                plus = minus = (least_effort[i, d], greatest_effort[i, d])
            forward = gear_range(gears, d, 1.0, abs(v), rests, plus[0], plus[1])
            backward = gear_range(gears, d, -1.0, abs(v), rests, minus[0], minus[1])
            least, greatest = np.inf, -np.inf
            for z in (lo, hi):
                up, down = 0.5 * (1.0 + z), 0.5 * (1.0 - z)
                least = min(least, up * forward[0] + down * backward[0])
                greatest = max(greatest, up * forward[1] + down * backward[1])
            r = gears.ratio[d]
            motor = r * gears.rotor_inertia[d] * acceleration[i, d] + gear_drag(gears, d, v) / r
            lower[i, d] = min(least / r, greatest / r) + motor
            upper[i, d] = max(least / r, greatest / r) + motor
