"""A rating in place of a cycle: a payload held in the worst postures, and lifted from there.

From its worst posture (`notebooks/theory/sizing`, "Rating") each joint alone moves against gravity,
by D, 90 degrees at most, in a quintic move whose largest acceleration is top speed/t_a,

    T = max(sqrt(10/sqrt(3) D t_a/v), 15 D/(8 v)),

returns, and rests as long as it moved. The last joint has the payload as far off its axis as it is
along it: a payload on the axis asks nothing of it. t_a = 1.5 s is an inference: the peak torques
that makers print leave 1.3 s at the shoulder of a UR10, 1.0 s at a UR5's, 0.4 s at a UR3's.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.tree import write_plain_efforts
from pinfric.errors import TrajectoryError, choose_from
from pinfric.model.arrays import FloatArray
from pinfric.model.entry import parse
from pinfric.model.mass_matrix import mass_matrices
from pinfric.model.robot import inertia_matrix, link_frame, plausible_distance
from pinfric.model.scene import Scene
from pinfric.model.schema import Payload
from pinfric.model.urdf import PLACEHOLDER_SPEED, implausible_body
from pinfric.model.yamlfile import yaml_line
from pinfric.motions.joint_columns import JointColumn, configurations, joint_columns
from pinfric.motions.trajectory import Trajectory
from pinfric.motions.waypoints import (
    Rating,
    WayPoint,
    WayPointFile,
    points_sum,
    sample_waypoints,
)

#: Random postures of a search, and how many of them are followed for each joint.
_TRIED, _FOLLOWED = 4000, 20
#: Steps of a search, of the joints' ranges: the first, and where it ends.
_COARSEST, _FINEST = 0.1, 1e-6
#: A step that gains less, of the largest value of all joints, gains nothing: ridges are long.
_GAIN = 1e-8
#: Values that differ by this part are alike.
_ALIKE = 1e-3
#: A joint whose gravity effort is less than this part of the largest takes its largest inertia.
_NO_GRAVITY = 0.02
#: A posture that reaches this part of another joint's worst serves it, too.
_NEARLY_WORST = 0.97
#: A payload is not heavier than so many times what moves; than links whose masses leave out drives.
_HEAVIEST, _HEAVIEST_OF_BARE = 2.0, 20.0
#: 90 degrees, rad; and the least way of a move: with less room before a limit it goes back.
_QUARTER, _LEAST_WAY = 0.5 * math.pi, 0.05
#: s that each posture is held; Hz of the samples.
_HOLD, _RATE = 2.0, 100.0
#: Part of the joints' top speeds on the way from one posture to the next.
_ON_THE_WAY = 0.25
#: max |b''| and max |b'| of a quintic move.
_PEAK_ACCELERATION, _PEAK_SPEED = 10.0 / math.sqrt(3.0), 15.0 / 8.0


@dataclass(frozen=True)
class Lift:
    """One joint's part of a rating.

    Attributes:
        drive: its column in efforts. column: its joint's in `Rated.columns`.
        posture: of `Rated.postures`, in which it is held and from which it moves.
        held: largest |effort| that holds the payload over all ranges, N m or N.
        to: (nj,) where the move ends. duration: of the move, s.
        speed, reached: the joint's top speed, and the move's, rad/s or m/s.
    """

    drive: int
    column: int
    posture: int
    held: float
    to: FloatArray
    speed: float
    duration: float
    reached: float


@dataclass(frozen=True)
class Rated:
    """A rating of one robot: its worst postures, and the moves from there.

    Attributes:
        scene: with the rated payload beside those of the `given` one. rating: as given.
        payload: its name in the scene. link: that carries it. reach: of its centre of mass from the
            second joint that carries it (the shoulder), m.
        columns: (nj,) the joints. postures: (P, nj) rad or m. lifts: of the joints before the link.
        across: the payload as it is in the last posture, across the last joint's axis; "": it is
            the same in all.
    """

    given: Scene
    scene: Scene
    rating: Rating
    payload: str
    link: str
    reach: float
    columns: tuple[JointColumn, ...]
    postures: FloatArray
    lifts: tuple[Lift, ...]
    across: str = ""

    def carried(self, posture: int) -> str:
        """Return the name of the payload in a posture."""
        last = posture == len(self.postures) - 1
        return self.across if self.across and last else self.payload

    def parts(self) -> Iterator[tuple[str, Lift | None, tuple[WayPoint, ...]]]:
        """Yield the payload, each posture's hold (None) or joint's move, and its way-points."""
        for k, posture in enumerate(self.postures):
            payload = self.carried(k)
            yield payload, None, (_point(posture, hold=_HOLD),)
            for lift in self.lifts:
                if lift.posture == k:
                    back = _point(posture, duration=lift.duration, hold=2 * lift.duration)
                    points = _point(posture), _point(lift.to, duration=lift.duration), back
                    yield payload, lift, points

    def carried_by(self, drive: int) -> str:
        """Return the name of the payload that a drive moves; of those behind the link the rated."""
        postures = (lift.posture for lift in self.lifts if lift.drive == drive)
        return self.carried(next(postures, 0))

    def motions(self) -> Iterator[tuple[str, Lift | None, Trajectory]]:
        """Yield the same parts, each as a motion of its own."""
        for payload, lift, points in self.parts():
            carried = {name: name == payload for name in self.scene.payloads}
            name = "hold" if lift is None else f"lift of {self.columns[lift.column].name}"
            file = WayPointFile(pinfric_trajectory=1, sample_rate=_RATE, points=points)
            table = sample_waypoints(file, self.columns, carried, name)
            q = configurations(self.columns, table.position, self.scene.model.nq)
            made = table.t, q, table.velocity, table.acceleration, carried, f"rating: {name}"
            yield payload, lift, Trajectory.from_arrays(self.scene, *made)

    def at_top_speed(self) -> Trajectory:
        """Return each joint alone at its top speed in its posture, against gravity: two samples."""
        rows = 2 * np.arange(len(self.lifts))
        position = np.repeat(self.postures[[lift.posture for lift in self.lifts]], 2, axis=0)
        velocity = np.zeros((len(position), self.scene.model.nv))
        for row, lift in zip(rows, self.lifts, strict=True):
            up = float(np.sign(lift.to[lift.column] - position[row, lift.column])) or 1.0
            velocity[row : row + 2, self.columns[lift.column].index_v] = up * lift.speed
        q = configurations(self.columns, position, self.scene.model.nq)
        loads = np.repeat([self.carried(lift.posture) for lift in self.lifts], 2)
        carried = {name: loads == name for name in self.scene.payloads}
        motion = np.arange(len(q)) / _RATE, q, velocity, 0.0 * velocity
        return Trajectory.from_arrays(self.scene, *motion, carried, "rating: top speeds")

    def waypoints(self) -> str:
        """Return the whole motion as the text of a way-point file, which says that it is one."""
        names = [column.name for column in self.columns]
        speeds = np.full(len(names), np.inf)
        speeds[[one.column for one in self.lifts]] = [one.speed for one in self.lifts]
        lines, written, posture = list[str](), list[WayPoint](), -1
        for payload, lift, points in self.parts():
            if lift is None:
                posture += 1
                of = [names[x.column] for x in self.lifts if x.posture == posture]
                way = np.abs(self.postures[posture] - self.postures[max(posture - 1, 0)])
                time = _whole(_PEAK_SPEED * float((way / speeds).max()) / _ON_THE_WAY)
                change: dict[str, Any] = {"duration": time or None}
                if payload != self.payload:
                    change |= {"attach": (payload,), "detach": (self.payload,)}
                points = (points[0].model_copy(update=change),)
                said = [f"worst posture of {', '.join(of)}"]
            else:
                points, said = points[1:], [f"{names[lift.column]} moves alone", "and back"]
            written += points
            for point, text in zip(points, said, strict=True):
                parts = [
                    f"name: {json.dumps(text)}",
                    f"q: [{', '.join(f'{x:g}' for x in point.q)}]",
                ]
                parts += [f"duration: {point.duration:g}"] if point.duration else []
                parts += [f"hold: {point.hold:g}"] if point.hold else []
                for key in ("attach", "detach"):
                    parts += [f"{key}: [{n}]" for n in getattr(point, key)]
                lines.append(f"  - {{{', '.join(parts)}}}")
        joints = ", ".join(yaml_line(name, within=True) for name in names)
        own = self.rating.model_dump(exclude_defaults=True) | {"points": points_sum(written)}
        head = ["pinfric_trajectory: 1", "profile: quintic", f"sample_rate: {_RATE:g}"]
        head += [f"rating: {yaml_line(own)}", f"joints: [{joints}]", "points:"]
        return "\n".join([*head, *lines, ""])


def parse_rating(keys: Rating | Mapping[str, Any]) -> Rating:
    """Return a rating of its keys.

    Raises:
        TrajectoryError: an unknown key, or a value that cannot be.
    """
    return keys if isinstance(keys, Rating) else parse(Rating, keys, "rating", TrajectoryError)


def rate(scene: Scene, given: Rating | Mapping[str, Any]) -> Rated:
    """Return the postures and moves of a robot that is rated for a payload; its own are put down.

    Raises:
        TrajectoryError: a rating that cannot be; closed loops; no link for the payload, or one that
            never moves; more than twice the mass that moves (20 times that of links without their
            drives); a joint without a range or top speed.
    """
    rating = parse_rating(given)
    _check_open(scene)
    link = rating.link or _last_link(scene)
    moving = sum(inertia.mass for inertia in tuple(scene.model.inertias)[1:])
    heaviest = _HEAVIEST_OF_BARE if False in scene.masses_hold else _HEAVIEST
    if rating.payload > heaviest * moving:
        raise TrajectoryError(
            f"rating.payload: {rating.payload:g} kg is more than {heaviest:g} times the "
            f"{moving:.4g} kg of {scene.source} that move: give kg"
        )
    mass, com = rating.payload, (0.0, 0.0, rating.payload_offset)
    load = Payload(link=link, mass=mass, com=com, inertia=rating.inertia)
    _check_inertia(scene, load)
    loaded, payload = _also_carried(scene, load, "rated")
    arm, across = Arm(loaded, payload), ""
    speeds, drives = arm.top_speeds(rating), range(len(arm.drives))
    # 1. Few postures that come near the worst of each joint
    postures, of, held, worst = arm.postures(drives)
    loads = [arm] * len(postures)
    # 2. Of the last joint one with the payload across its axis: holds and moves of others stay
    if (beside := arm.across(rating.payload_offset)) is not None:
        load = load.model_copy(update={"com": beside, "attached": False})
        loaded, across = _also_carried(loaded, load, "rated_across")
        own = Arm(loaded, across)
        farthest, _, held[-1:], _ = own.postures(drives[-1:], held.max())
        if of.count(of[-1]) == 1:
            del postures[of[-1]], loads[of[-1]]
            of = [p - (p > of[-1]) for p in of]
        of[-1] = len(postures)
        postures, loads = postures + farthest, [*loads, own]
    # 3. From there each joint alone, against gravity
    lifts = []
    for i in drives:
        k, p = arm.columns_of[i], of[i]
        turns, speed, here = arm.columns[k].unit == "rad", speeds[i], postures[p][k]
        room = arm.limits[k, 1] - here, here - arm.limits[k, 0]
        up = bool(loads[p].signed_efforts(postures[p][None])[0, i] >= 0.0)
        up = up if room[not up] >= _LEAST_WAY else not up  # a limit is in the way
        ramp = speed * rating.acceleration_time  # a slide goes as far as its top speed needs
        most = _QUARTER if turns else _PEAK_ACCELERATION / _PEAK_SPEED**2 * ramp
        way = min(most, room[not up])
        to = postures[p].copy()
        to[k] = _rounded(np.array(here + (way if up else -way)), arm.limits[k])
        slowest = _PEAK_ACCELERATION * way * rating.acceleration_time / speed
        time = _whole(max(math.sqrt(slowest), _PEAK_SPEED * way / speed))
        reached = _PEAK_SPEED * way / time
        lifts.append(Lift(arm.drives[i], k, p, float(held[i]), to, speed, time, reached))
    reach = arm.reach(worst)[1]
    found = arm.columns, np.array(postures), tuple(lifts)
    return Rated(scene, loaded, rating, payload, link, reach, *found, across)


def holding_efforts(
    scene: Scene, payload: str, above: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Return joint -> largest |effort| that holds one of the scene's payloads, N m or N.

    At rest, without friction, over the ranges of all joints before the payload's link.

    Args:
        above: joint -> effort; a joint that a bound keeps below it is left out, which takes no
            search.

    Raises:
        TrajectoryError: as `rate`.
    """
    arm = Arm(scene, payload)
    names = [arm.columns[k].name for k in arm.columns_of]
    least = [(above or {}).get(name, 0.0) for name in names]
    open_ = np.flatnonzero(~(arm.effort_bounds() < least)).tolist()
    if not open_:
        return {}
    held = arm.farthest(arm.efforts, open_)[1]
    return dict(zip([names[i] for i in open_], held.tolist(), strict=True))


class Arm:
    """The drives that carry one of a scene's payloads, and what they carry over all postures.

    Attributes:
        columns: (nj,) all joints. drives, columns_of: (k,) of the carriers: columns in efforts, and
            their joints'. limits, ranges: (nj, 2) rad or m; ranges of at most one turn.

    Raises:
        TrajectoryError: closed loops; a link that no drive moves; a slide without ends.
    """

    def __init__(self, scene: Scene, payload: str) -> None:
        _check_open(scene)
        load, model = scene.payloads[payload], scene.model
        self.scene = replace(
            scene,
            payloads={payload: load.model_copy(update={"attached": True})},
            friction={},
        )
        self.columns = joint_columns(model, scene.source)
        self.frame = link_frame(model, load.link)
        before = {
            model.joints[j].idx_v for j in model.supports[model.frames[self.frame].parentJoint]
        }
        moved = {drive.velocity_index: i for i, drive in enumerate(scene.drives)}
        carriers = [
            (moved[column.index_v], k)
            for k, column in enumerate(self.columns)
            if column.index_v in before and column.index_v in moved
        ]
        if not carriers:
            raise TrajectoryError(
                f"{scene.source}: no drive moves {load.link}; name the tool's link"
            )
        self._plain = self.scene.own_drives and not self.scene.springs
        self.drives, self.columns_of = ([pair[side] for pair in carriers] for side in (0, 1))
        self.com = np.array(load.com)
        self.joints = [model.getJointId(self.columns[k].name) for k in self.columns_of]
        limits = np.array([(column.lower, column.upper) for column in self.columns])
        turns = np.array([column.unit == "rad" for column in self.columns])
        for column, (low, high) in zip(self.columns, limits, strict=True):
            if column.unit == "m" and not math.isfinite(high - low):
                raise TrajectoryError(
                    f"{scene.source}: joint {column.name} slides without limits; state both"
                )
        # of whole turns one, about the middle
        endless = turns & ~np.isfinite(limits).all(axis=1)
        self.limits = np.where(endless[:, None], [-math.inf, math.inf], limits)
        inner = np.where(endless[:, None], 0.0, limits)
        whole = endless | (turns & (np.ptp(inner, axis=1) > 2 * math.pi))
        turn = inner.mean(axis=1, keepdims=True) + np.array([-math.pi, math.pi])
        self.ranges = np.where(whole[:, None], turn, limits)
        self.start = np.clip(0.0, *self.ranges.T)

    def across(self, offset: float) -> tuple[float, float, float] | None:
        """Return a centre of mass (m, in the link's axes) so far from the last joint's axis.

        None: it is as far already, or the last joint slides.
        """
        model, joint, last = self.scene.model, self.joints[-1], self.columns[self.columns_of[-1]]
        place = model.frames[self.frame].placement
        if last.unit != "rad" or model.frames[self.frame].parentJoint != joint:
            return None
        axis, com = self.scene.twin().axis[joint - 1, 3:], place.act(self.com)
        foot = axis * (axis @ com)
        if np.linalg.norm(com - foot) >= offset * (1 - _ALIKE):
            return None
        sides = [x - axis * (axis @ x) for x in place.rotation.T[:2]]
        side = max(sides, key=lambda x: float(np.linalg.norm(x).round(6)))
        there = place.actInv(foot + offset * side / np.linalg.norm(side)).round(9) + 0.0
        x, y, z = there.tolist()
        return x, y, z

    def top_speeds(self, rating: Rating) -> list[float]:
        """Return (k,) rad/s or m/s, of the rating, else of the URDF."""
        names = [self.columns[k].name for k in self.columns_of]
        for name in rating.speed:
            if name not in names:
                raise TrajectoryError(
                    f"rating.speed: unknown joint {name!r}; {choose_from(name, names)}"
                )
        speeds = [
            rating.speed.get(name, self.columns[k].velocity_limit)
            for name, k in zip(names, self.columns_of, strict=True)
        ]
        for name, speed in zip(names, speeds, strict=True):
            if not speed <= PLACEHOLDER_SPEED:
                stated = "" if math.isinf(speed) else f" that a joint can have ({speed:g})"
                raise TrajectoryError(
                    f"{self.scene.source}: joint {name} has no velocity limit{stated}; write it in "
                    f"the URDF, or rate the robot by `size` with rating.speed.{name}"
                )
        return speeds

    def signed_efforts(self, position: FloatArray) -> FloatArray:
        """Return (n, k) efforts at rest without friction, N m or N, of positions (n, nj)."""
        q = configurations(self.columns, position, self.scene.model.nq)
        still = np.zeros((len(q), self.scene.model.nv))
        if not self._plain:
            return inverse_dynamics(self.scene, q, still, still).effort_frictionless[:, self.drives]
        efforts = np.empty_like(still)
        write_plain_efforts(self.scene.twin(), q, still, still, 1, efforts)
        return efforts[:, [self.scene.drives[i].velocity_index for i in self.drives]]

    def efforts(self, position: FloatArray) -> FloatArray:
        """Return the magnitudes of `signed_efforts`."""
        return np.abs(self.signed_efforts(position))

    def effort_bounds(self) -> FloatArray:
        """Return (k,) bounds of `efforts` in all postures, inf where there is none.

        With s_j = m_j c_j + sum_i M_i p_i, of its body and of what the joints i on it carry, and
        S_j = |s_j| + sum_i S_i: |effort_j| <= g (|s_j across its axis| + sum_i S_i), or g M_j where
        it slides.
        """
        twin, n = self.scene.twin(), len(self.columns) + 1
        mass, moment, beyond = np.zeros(n), np.zeros((n, 3)), np.zeros(n)
        bound = np.full(n, math.inf)
        if n != twin.model.njoints or not self._plain:
            return bound[self.joints]
        for j in range(n - 1, 0, -1):
            body, placed = twin.model.inertias[j], twin.model.jointPlacements[j]
            mass[j] += body.mass
            moment[j] += body.mass * body.lever
            parent, axis = twin.model.parents[j], twin.axis[j - 1].reshape(2, 3).sum(axis=0)
            weight = placed.rotation.T @ twin.model.gravity.linear  # turns with the joints before
            slides, g = self.columns[j - 1].unit == "m", float(np.linalg.norm(weight))
            way = np.abs(self.ranges[j - 1]).max() if slides else 0.0
            if parent == 0:
                along = abs(weight @ axis) if slides else np.linalg.norm(np.cross(weight, axis))
                g = float(along)
            across = np.linalg.norm(np.cross(moment[j], axis)) + beyond[j]
            bound[j] = g * (mass[j] if slides else across)
            mass[parent] += mass[j]
            moment[parent] += mass[j] * placed.translation
            beyond[parent] += np.linalg.norm(moment[j]) + beyond[j] + mass[j] * way
        return bound[self.joints]

    def inertias(self, position: FloatArray) -> FloatArray:
        """Return (n, k) inertias about the joints, kg m^2 or kg, of positions (n, nj)."""
        q = configurations(self.columns, position, self.scene.model.nq)
        own = [self.columns[k].index_v for k in self.columns_of]
        return mass_matrices(self.scene.twin(tuple(self.scene.payloads)), q)[:, own, own]

    def farthest(
        self, value: Callable[[FloatArray], FloatArray], which: Sequence[int]
    ) -> tuple[FloatArray, FloatArray]:
        """Return (n, nj) positions in which some columns (n,) of a value are largest, and these.

        The best of random positions, then of ever smaller steps along single joints. Among equals
        the one that stays above the base and reaches farthest, which does not hit itself.
        """
        wanted = np.array(which)
        low, size = self.ranges[:, 0], np.ptp(self.ranges, axis=1)
        free = np.isin(np.arange(len(low)), self.columns_of)
        tried = low + size * np.random.default_rng(0).random((_TRIED, len(low)))
        tried = np.where(free, tried, self.start)
        groups = value(tried)[:, wanted].reshape(_FOLLOWED, -1, len(which))
        first = groups.argmax(axis=1) + _TRIED // _FOLLOWED * np.arange(_FOLLOWED)[:, None]
        x, column = tried[first.ravel()], np.tile(wanted, _FOLLOWED)
        step = np.full(len(x), _COARSEST)
        best = value(x)[np.arange(len(x)), column]
        least = _GAIN * best.max()
        ways = np.concatenate([np.eye(len(low))[free], -np.eye(len(low))[free]]) * size
        while (going := np.flatnonzero(step > _FINEST)).size:
            beside = x[going, None] + step[going, None, None] * ways
            beside = np.clip(beside, *self.ranges.T)
            values = value(beside.reshape(-1, len(low)))[:, column[going]]
            rows = np.arange(len(going))
            values = values.reshape(*beside.shape[:2], -1)[rows, :, rows]
            k = values.argmax(axis=1)
            reached = values[rows, k]
            better = reached > best[going] + least
            moved = going[better]
            x[moved], best[moved] = beside[better, k[better]], reached[better]
            step[going[~better]] /= 2
        values, x = best.reshape(_FOLLOWED, -1), x.reshape(_FOLLOWED, len(which), -1)
        winners = []
        for k, most in enumerate(values.max(axis=0)):
            alike = x[values[:, k] >= most * (1 - _ALIKE), k]
            winners.append(max(alike, key=self.reach))
        return np.array(winners), values.max(axis=0)

    def postures(
        self, which: Sequence[int], most: float = 0.0
    ) -> tuple[list[FloatArray], list[int], FloatArray, FloatArray]:
        """Return few postures in which some joints bear nearly their worst, by gravity or inertia.

        Args:
            which: carriers. most: effort beside which gravity may be nothing, beside their own.

        Returns:
            The postures (nj,); of each joint, which one; its largest |effort|; and the posture of
            the largest of these.
        """
        joints = list(which)
        worst, held = self.farthest(self.efforts, joints)
        weighs = held >= _NO_GRAVITY * max(held.max(), most)
        light = np.flatnonzero(~weighs)
        if light.size:
            worst[light] = self.farthest(self.inertias, [joints[k] for k in light])[0]

        def load_of(q: FloatArray) -> FloatArray:
            return np.where(weighs, self.efforts(q)[:, joints], self.inertias(q)[:, joints])

        numbers = np.arange(len(joints))
        best, of, found = load_of(worst)[numbers, numbers], [0] * len(joints), list[FloatArray]()
        waiting = sorted(numbers.tolist(), key=lambda i: (not weighs[i], -held[i]))
        while waiting:
            near = load_of(worst[waiting]) >= _NEARLY_WORST * best
            first = int(near[:, waiting].sum(axis=1).argmax())  # of equals what holds most
            served = [i for i in waiting if near[first, i] or i == waiting[first]]
            for i in served:
                of[i] = len(found)
            found.append(self.simplified(worst[waiting[first]], served, load_of, best))
            waiting = [i for i in waiting if i not in served]
        return found, of, held, worst[int(held.argmax())]

    def simplified(
        self,
        position: FloatArray,
        served: Sequence[int],
        value: Callable[[FloatArray], FloatArray],
        best: FloatArray,
    ) -> FloatArray:
        """Return a posture (nj,) to four digits, with 0 where a joint does not matter."""
        least = np.minimum(value(position[None])[0], best) * (1 - 1e-9)
        for k in range(len(position)):
            other = position.copy()
            other[k] = self.start[k]
            if (value(other[None])[0, served] >= least[served]).all():
                position = other
        return _rounded(position, self.ranges)

    def reach(self, position: FloatArray) -> tuple[float, float]:
        """Return the arm's lowest point below the base (m, 0 or less), and the payload's reach, m.

        The reach is measured from the second joint that carries it, the shoulder.
        """
        model, data = self.scene.model, self.scene.model.createData()
        pin.framesForwardKinematics(
            model, data, configurations(self.columns, position[None], model.nq)[0]
        )
        places = [data.oMi[j].translation for j in self.joints] + [
            data.oMf[self.frame].act(self.com)
        ]
        away = float(np.linalg.norm(places[-1] - places[min(1, len(self.joints) - 1)]))
        return min(0.0, round(min(float(place[2]) for place in places), 3)), away


def _also_carried(scene: Scene, load: Payload, name: str) -> tuple[Scene, str]:
    """The scene with a payload, and its name; `new --payload` writes the same."""
    while scene.payloads.get(name, load).model_copy(update={"attached": load.attached}) != load:
        name += "_"
    return replace(scene, payloads={**scene.payloads, name: load}), name


def _check_inertia(scene: Scene, load: Payload) -> None:
    matrix = inertia_matrix(load)
    if why := implausible_body(load.mass, matrix):
        raise TrajectoryError(f"rating.inertia: {why}")
    moment, most = float(np.linalg.eigvalsh(matrix)[2]), plausible_distance(scene.model)
    if (radius := math.sqrt(moment / load.mass)) > most:
        raise TrajectoryError(
            f"rating.inertia: {moment:g} kg m^2 of {load.mass:g} kg is a radius of gyration of "
            f"{radius:.3g} m; up to {most:.3g} m expected at this robot: give kg m^2"
        )


def _check_open(scene: Scene) -> None:
    if scene.loops:
        raise TrajectoryError(f"{scene.source}: a rating is for open chains; this one has loops")


def _last_link(scene: Scene) -> str:
    """The scene's tool; else the last link, or `tool0` of several that end the robot."""
    if scene.tool is not None:
        return scene.tool
    model = scene.model
    last = [j for j in range(1, model.njoints) if len(model.subtrees[j]) == 1]
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint in last]
    if len(last) != 1 or not bodies:
        raise TrajectoryError(
            f"rating: which link of {scene.source} carries the payload? It ends in "
            f"{', '.join(f.name for f in bodies) or 'no link'}; name it as `link`, or as the "
            "scene's `tool`"
        )
    return next((f.name for f in bodies if f.name == "tool0"), bodies[-1].name)


def _point(position: FloatArray, **more: Any) -> WayPoint:
    return WayPoint(q=tuple(position.tolist()), **more)


def _rounded(position: FloatArray, limits: FloatArray) -> FloatArray:
    """Positions (...,) to four digits that lie within limits (..., 2)."""
    inside = np.ceil(limits[..., 0] * 1e4) / 1e4, np.floor(limits[..., 1] * 1e4) / 1e4
    return np.clip(np.round(position, 4), *inside) + 0.0


def _whole(time: float) -> float:
    """A duration of whole sample periods."""
    return math.ceil(time * _RATE - 1e-9) / _RATE
