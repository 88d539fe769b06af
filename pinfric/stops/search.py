"""The worst stops of a cycle: candidates by an estimate, then a search around the worst of them.

The drives may react at any sample of a cycle, too many to simulate each. For each axis an estimate
orders the samples, as if the axis moved alone and without friction:

    |v| (t_react + t_engage) + I w^2/(2 (|r| T_b - F)),     w = |v| + F t_engage/I,

F what gravity pushes along v, I the inertia at the joint with the rotor; of a stated deceleration d
|v| (t_react + |v|/(2 d)), along the path with the longest |v|/d of all axes. Simulated are the
samples with the largest estimate, speed and load at rest of each axis, where the estimate comes
nearest to a limit of its joint, with the largest kinetic energy, and 40 spread evenly. Then, of
each measure, the three highest local maxima are refined, half-way to the neighbours on both sides,
until these are next to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinfric.drives.brake import closing_way
from pinfric.drives.demand import driven_joint
from pinfric.drives.inertia import drive_inertias
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.closure import working_rates
from pinfric.dynamics.samples.states import States
from pinfric.errors import StopError
from pinfric.model.scene import Scene
from pinfric.motions.summary import running_integral
from pinfric.motions.trajectory import Trajectory
from pinfric.stops.machines import UNLIMITED, MachineKind, Machines, carried_by
from pinfric.stops.motion import BrakedMachine, StopMotion, no_brake, stop_motion, tool_path
from pinfric.stops.path import CyclePath

#: Samples spread evenly over the cycle: which other axis still moves matters, and no estimate of
#: one axis finds that.
_SPREAD = 40
#: Hills that are refined of each measure; those below this part of the highest are not.
_HILLS, _LEAST_HILL = 3, 0.5
#: Part of the cycle to which the search comes.
_FINEST = 400
#: An estimate divides by at least this part of the brake's torque.
_LEAST_SHARE = 0.1
#: Part of its friction at rest that slows a joint without a brake: in motion it is less.
_SLIDES = 0.5
#: A torque this small beside the load is rounding.
_ROUNDING = 1e-9


class StopCase(NamedTuple):
    """One stop of a study.

    Attributes:
        sample: of the cycle, at which the drives react. speed: factor on the cycle's speed.
    """

    kind: MachineKind
    sample: int
    speed: float = 1.0


@dataclass(frozen=True, eq=False)
class Stopped:
    """Figures of one stop, from its command.

    Attributes:
        command: time of the cycle at which it was commanded (s).
        time: until everything is at rest (s). rest: (na,) until each drive's joint is.
        travel: (na,) largest distance of each drive's joint from where the command met it, rad, m.
        sag: (na,) with gravity, from power-off on; NaN where the joint moved at power-off.
        peak: (na,) largest effort that the gear delivers, N m or N.
        braking: (na,) the same until power goes off; in category 0 that at the start.
        energy: (na,) that the brake took, J.
        beyond: (na, 2) farthest past the lower and the upper limit of each drive's joint, rad or m;
            negative: what is left; minus infinity where there is no limit.
        path: way of the tool, m; None: the scene has no tool.
        stepped: a part of it is computed by time stepping, which passes what events cannot.
    """

    case: StopCase
    command: float
    time: float
    rest: np.ndarray
    travel: np.ndarray
    sag: np.ndarray
    peak: np.ndarray
    braking: np.ndarray
    energy: np.ndarray
    beyond: np.ndarray
    path: float | None
    stepped: bool


@dataclass(frozen=True, eq=False)
class StopCycle:
    """A cycle as stops need it.

    Attributes:
        reaction: until the drives react, s.
        rate: (T, na) of the drives' joints. way: (T, na) their way since the start, rad or m.
        path: (T,) the tool's way since the start; None without a tool.
        hold: (T, na) effort that holds each joint at rest, by full load or not. rubs: (T, na)
            least friction at rest of its gear and joint, N m or N, by full load or not.
        place: (na,) number in q of each drive's joint. limits: (na, 2) its lower and upper limit,
            rad or m; infinite where it has none, or no single number.
    """

    trajectory: Trajectory
    reaction: float
    rate: np.ndarray
    way: np.ndarray
    path: np.ndarray | None
    hold: dict[bool, np.ndarray]
    rubs: dict[bool, np.ndarray]
    place: np.ndarray
    limits: np.ndarray

    @classmethod
    def of(cls, machines: Machines, trajectory: Trajectory) -> StopCycle:
        """Return a cycle of a scene."""
        scene, (q, v) = machines.scene, (trajectory.q, trajectory.v)
        rate = working_rates(scene, q, v)[0]
        way = running_integral(trajectory.t, rate)
        path, zero, hold, rubs = tool_path(scene, (), q), np.zeros_like(v), {}, {}
        for full in {False, bool(machines.full)}:
            least = machines.of(MachineKind(False, float(full))).scene
            carried = carried_by(machines, float(full), len(q))
            still = inverse_dynamics(least, q, zero, zero, t=trajectory.t, attached=carried)
            _check_unbraked(still, "the full load" if full else "nothing", machines.products)
            hold[full] = still.effort_frictionless
            shaft = still.motor_torque_upper - still.motor_torque_lower
            rubs[full] = np.abs([drive.ratio for drive in scene.drives]) * shaft / 2.0
        reaction, limits = machines.settings.reaction_time, position_limits(scene)
        return cls(trajectory, reaction, rate, way, path, hold, rubs, *limits)

    def before(self, sample: int, speed: float) -> tuple[float, np.ndarray, float | None]:
        """Return time of the command (s), the joints' ways since then (na,), the tool's (m).

        Before the first sample the joints are taken to have moved as at it.
        """
        t = self.trajectory.t
        asked = float(t[sample]) - speed * self.reaction
        command = max(asked, float(t[0]))
        there = np.array([np.interp(command, t, column) for column in self.way.T])
        way = self.way[sample] - there + (command - asked) * self.rate[0]
        path = None
        if self.path is not None:
            path = float(self.path[sample] - np.interp(command, t, self.path))
            if command > asked:
                path += (command - asked) * float(self.path[1] - self.path[0]) / float(t[1] - t[0])
        return command, way, path


def position_limits(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return `StopCycle.place` and `StopCycle.limits` of a scene."""
    model, count = scene.model, len(scene.drives)
    place, limits = np.zeros(count, dtype=int), np.tile([-np.inf, np.inf], (count, 1))
    for d in range(count):
        joint = driven_joint(scene, d)
        if joint is not None and model.joints[joint].nq == 1:
            i = place[d] = model.joints[joint].idx_q
            ends = np.array([model.lowerPositionLimit[i], model.upperPositionLimit[i]])
            limits[d] = np.where(np.abs(ends) < UNLIMITED, ends, limits[d])
    return place, limits


def past(limits: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (..., 2) how far places (...) are past the lower and the upper of limits (..., 2)."""
    return np.stack([limits[..., 0] - q, q - limits[..., 1]], axis=-1)


def _check_unbraked(still: InverseResult, carries: str, products: Mapping[str, str]) -> None:
    """Refuse a drive without a brake whose joint gravity moves although friction holds it."""
    scene, t = still.scene, still.times
    for d, drive in enumerate(scene.drives):
        if drive.transmission is not None and drive.transmission.brake is not None:
            continue
        ends = still.motor_torque_lower[:, d], -still.motor_torque_upper[:, d]
        short = np.maximum(*ends)
        k = int(np.argmax(short))
        if short[k] > _ROUNDING * max(np.abs(still.effort_frictionless[:, d]).max(), 1.0):
            load = abs(float(still.effort_frictionless[k, d]))
            lacks = no_brake(products, drive.name, f"actuators ({drive.name}):")
            raise StopError(
                f"{scene.source}: {lacks}, and carrying {carries} "
                f"its load of {load:.3g} {scene.drives[d].unit} at {t[k]:.3g} s of the cycle is "
                "more than friction holds; give `transmission.brake: {torque: N m, engage_time: s}`"
            )


class Measured(NamedTuple):
    """Of which drives a search seeks the worst peak of the gear, energy of the brake, and place.

    Attributes: (na,) bool each.
    """

    peak: np.ndarray
    energy: np.ndarray
    beyond: np.ndarray


@dataclass(frozen=True, eq=False)
class StopSearch:
    """Stops of a cycle, each simulated once.

    Attributes:
        found: those simulated.
        progress: called after each with its number and an estimate of all.
        measured: None: all, and times and ways.
    """

    machines: Machines
    cycle: StopCycle
    progress: Callable[[int, int], None]
    found: dict[StopCase, Stopped] = field(default_factory=dict)
    measured: Measured | None = None

    def stop(self, case: StopCase) -> Stopped:
        """Return one stop."""
        if case not in self.found:
            self.found[case] = stopped(self.cycle, case, self.motion(case))
            self.progress(len(self.found), max(len(self.found), self._expected))
        return self.found[case]

    @property
    def _expected(self) -> int:
        return len(self.kinds) * (_SPREAD + 14 * len(self.machines.scene.drives))

    def motion(self, case: StopCase) -> StopMotion:
        """Return the motion of one stop, simulated anew."""
        trajectory, d = self.cycle.trajectory, self.machines.deceleration
        slowed = None
        if d is not None and self.machines.settings.along_path:
            slowed = self.path.slowed(case.sample, case.speed, d)
        machine, v = self.machines.of(case.kind), case.speed * trajectory.v[case.sample]
        return stop_motion(machine, trajectory.q[case.sample], v, slowed)

    @cached_property
    def path(self) -> CyclePath:
        """The cycle between its samples."""
        return CyclePath(self.machines.scene.model, self.cycle.trajectory)

    @property
    def kinds(self) -> tuple[MachineKind, ...]:
        """The machines at full speed: least and greatest friction, without load and with all."""
        loads, sought = (0.0, 1.0) if self.machines.full else (0.0,), self.measured
        frictions = [False, True]
        if sought is not None:  # least friction goes farthest; a strong brake leaves friction less
            least, greatest = sought.energy | sought.beyond, sought.energy | sought.peak
            frictions = [False] * bool(least.any()) + [True] * bool(greatest.any())
        return tuple(MachineKind(greatest, load) for greatest in frictions for load in loads)

    def run(self) -> None:
        """Simulate the candidates, then refine the highest local maxima of each measure."""
        self.progress(0, self._expected)  # the first stop of a long chain takes a while
        cases = {StopCase(kind, sample) for kind in self.kinds for sample in self.candidates(kind)}
        while cases:
            for case in sorted(cases):
                self.stop(case)
            cases = {case for measure in self.measures() for case in self._nearer(measure)}

    def candidates(self, kind: MachineKind) -> list[int]:
        """Return the samples that are simulated first."""
        t, rate = self.cycle.trajectory.t, self.cycle.rate
        chosen = set(np.linspace(0, len(t) - 1, _SPREAD).astype(int).tolist())
        inertia, score, _ = estimates(self.machines, self.cycle, kind)
        resting = np.where(rate == 0.0, np.abs(self.cycle.hold[kind.load > 0.0]), -1.0)
        for order in (score, np.abs(rate), resting):
            chosen |= set(np.argmax(order, axis=0).tolist())
        ends = self.cycle.trajectory.q[:, self.cycle.place] + np.sign(rate) * score
        nearest = past(self.cycle.limits, ends).max(axis=-1)
        chosen |= set(np.argmax(nearest, axis=0)[self.limited].tolist())
        chosen.add(int(np.argmax((inertia * rate**2).sum(axis=1))))
        return sorted(chosen)

    def measures(self) -> Iterator[Callable[[Stopped], float]]:
        """Yield what is to be largest: time and path, of each axis time, way and place."""
        powered, sought = self.machines.settings.category == 1, self.measured
        count, peaks = len(self.machines.scene.drives), ("peak", *["braking"] * powered)
        if sought is not None:
            for d in range(count):
                yield from (figure_of(name, d) for name in peaks if sought.peak[d])
                if sought.energy[d]:  # where the joint goes farthest its brake takes most, nearly
                    yield from (figure_of(name, d) for name in ("rest", "travel", "energy"))
                yield from [beyond_of(d)] * bool(sought.beyond[d])
            return
        for d in range(count):
            for name in ("rest", "travel", *peaks, "energy"):
                yield figure_of(name, d)
        for d in np.flatnonzero(self.limited).tolist():
            margin = -beyond_of(d)(self.nearest(d))
            if margin < self.farthest(d).travel[d]:  # else no stop comes near
                yield beyond_of(d)
        yield lambda stop: stop.time
        if self.cycle.path is not None:
            yield lambda stop: stop.path or 0.0

    def worst(self, measure: Callable[[Stopped], float]) -> Stopped:
        """Return the worst of the stops simulated."""
        return max(self.found.values(), key=measure)

    def farthest(self, drive: int) -> Stopped:
        """Return the stop in which a drive's joint goes farthest."""
        return self.worst(figure_of("travel", drive))

    def longest(self, drive: int) -> Stopped:
        """Return the stop after which a drive's joint comes to rest last."""
        return self.worst(figure_of("rest", drive))

    def nearest(self, drive: int) -> Stopped:
        """Return the stop in which a drive's joint comes nearest to a limit, or farthest past."""
        return self.worst(beyond_of(drive))

    @property
    def limited(self) -> np.ndarray:
        """(na,) which drives' joints have a limit."""
        return np.isfinite(self.cycle.limits).any(axis=1)

    def _nearer(self, measure: Callable[[Stopped], float]) -> Iterator[StopCase]:
        """Yield stops half-way between a measure's highest local maxima and their neighbours."""
        finest = max(len(self.cycle.trajectory.t) // _FINEST, 1)
        hills: list[tuple[float, StopCase, list[int]]] = []
        for kind in self.kinds:
            own = sorted((s for c, s in self.found.items() if c.kind == kind), key=_sample_of)
            height = np.pad([measure(stop) for stop in own], 1, constant_values=-np.inf)
            tops = (height[1:-1] >= height[:-2]) & (height[1:-1] >= height[2:])
            for i in np.flatnonzero(tops & (height[1:-1] != 0.0)).tolist():
                around = [_sample_of(stop) for stop in own[max(i - 1, 0) : i + 2]]
                hills.append((float(height[i + 1]), own[i].case, around))
        hills.sort(key=lambda hill: -hill[0])
        highest = hills[0][0] if hills else 0.0
        for top, case, around in hills[:_HILLS]:
            if top >= highest - (1.0 - _LEAST_HILL) * abs(highest):
                for other in around:
                    if abs(other - case.sample) > finest:
                        yield case._replace(sample=(other + case.sample) // 2)


def _sample_of(stop: Stopped) -> int:
    return stop.case.sample


def figure_of(name: str, drive: int) -> Callable[[Stopped], float]:
    """Return the function of a stop that gives one drive's value of a field of `Stopped`."""
    return lambda stop: float(getattr(stop, name)[drive])


def beyond_of(drive: int) -> Callable[[Stopped], float]:
    """Return the function of a stop that says how far a drive's joint is past its limits."""
    return lambda stop: float(stop.beyond[drive].max())


def stopped(cycle: StopCycle, case: StopCase, motion: StopMotion) -> Stopped:
    """Return the figures of a stop, of its motion from the drives' reaction on."""
    command, reaction, path = cycle.before(case.sample, case.speed)
    delay = cycle.reaction
    first = int(motion.t.searchsorted(motion.power_off))
    moved = motion.rate[first] != 0.0
    falls = -np.sign(cycle.hold[case.kind.load > 0.0][case.sample])
    if path is not None:
        stop = tool_path(motion.scene, (), motion.q)
        assert stop is not None  # the scene has a tool
        path += float(stop[-1])
    at_rest = (motion.rest_time == 0.0) & (reaction == 0.0)
    return Stopped(
        case=case,
        command=command,
        time=delay + float(motion.rest_time.max()),
        rest=np.where(at_rest, 0.0, delay + motion.rest_time),
        travel=np.maximum(np.abs(reaction), np.abs(reaction + motion.travel).max(axis=0)),
        sag=np.where(moved, np.nan, falls * motion.after_power_off),
        peak=np.abs(motion.effort).max(axis=0),
        braking=motion.braking,
        energy=motion.energy,
        beyond=past(cycle.limits, motion.q[:, cycle.place]).max(axis=0),
        path=path,
        stepped=any(phase.method == "timestepping" for phase in motion.parts),
    )


class Estimates(NamedTuple):
    """What of stops from each sample is estimated.

    Attributes:
        inertia: (T, na) at the joints, with rotors, kg m^2 or kg.
        way: (T, na) of each joint as if it moved alone (see the module), rad or m.
        most: (T, na) with what others' stops add, who may drag it along although it stands, and
            gravity: w = |v_i| + sum_k |M_ik| |v_k|/I_i in place of |v_i|, in either direction.
            Simulated ways are at most 1.03 of it. Infinite: nothing slows it.
    """

    inertia: np.ndarray
    way: np.ndarray
    most: np.ndarray


def estimates(machines: Machines, cycle: StopCycle, kind: MachineKind) -> Estimates:
    """Return what is estimated of stops from each sample.

    Args:
        kind: with which load, and whether brakes are greatest.
    """
    machine, trajectory, d = machines.of(kind), cycle.trajectory, machines.deceleration
    full = kind.load > 0.0
    carried = carried_by(machines, kind.load, len(trajectory.q))
    states = States(trajectory.q, trajectory.v, trajectory.a, None, carried)
    gears, masses = machine.scene.gears(), drive_inertias(machine.scene, states)
    ratio = np.abs(gears.ratio)
    inertia = np.einsum("tii->ti", masses) + ratio**2 * gears.rotor_inertia
    speed, delay = np.abs(cycle.rate), _per_drive(machine, machine.delay)
    push = -cycle.hold[full] * np.sign(cycle.rate)
    torque = ratio * _per_drive(machine, machine.drive_torque or machine.torque)
    # 1. By itself
    stops = np.where(torque > 0.0, torque, np.abs(push).max() + 1e-9)
    braking = np.maximum(stops - push, _LEAST_SHARE * stops)
    way = speed * (cycle.reaction + delay) + closing_way(inertia, speed, push, delay, braking)
    if d is not None:  # the drives impose the motion
        ramp = speed / np.array([d[drive.velocity_index] for drive in machine.scene.drives])
        if machines.settings.along_path:
            ramp = ramp.max(axis=1, keepdims=True)
        way = speed * (cycle.reaction + ramp / 2.0)
    # 2. With the others: braked until rest, then without power until the brakes have closed
    drag = np.einsum("tik,tk->ti", np.abs(masses), speed) / inertia
    drag -= np.einsum("tii->ti", masses) / inertia * speed
    most, load = way if d is not None else speed * cycle.reaction, np.abs(cycle.hold[full])
    if machine.drive_torque:
        most = most + _dragged(inertia, speed + drag, load, 0.0, torque)
    powered = d is not None or bool(machine.drive_torque)
    if not (powered and machine.holds):
        brake = ratio * _per_drive(machine, machine.torque)
        slows = np.where(brake > 0.0, brake, _SLIDES * cycle.rubs[full])
        start = 0.0 * speed if powered else speed + drag
        most = most + _dragged(inertia, start, load, delay, slows)
    return Estimates(inertia, way, np.where(np.isnan(most), np.inf, most))


def _dragged(
    inertia: np.ndarray,
    speed: np.ndarray,
    load: np.ndarray,
    delay: float | np.ndarray,
    torque: np.ndarray,
) -> np.ndarray:
    """Return the way (T, na) with a load along it, and a torque against it after a delay (s)."""
    left = np.maximum(torque - load, _LEAST_SHARE * torque)
    moves = (speed > 0.0) | (load * delay > 0.0)
    stops = np.where(left > 0.0, left, 1.0)
    way = (speed + load * delay / (2.0 * inertia)) * delay
    way += closing_way(inertia, speed, load, delay, stops)
    return np.where(moves & (left <= 0.0), np.inf, way)


def _per_drive(machine: BrakedMachine, figures: Mapping[str, float]) -> np.ndarray:
    return np.array([figures.get(drive.name, 0.0) for drive in machine.scene.drives])
