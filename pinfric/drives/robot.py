"""The robot with its drives' masses: what a kilogram at each joint adds to all others.

A drive is a point mass at its joint's origin, on the parent link; half a cylinder at each of its
pins. In an open chain efforts without friction, wrenches and mass matrices are linear in the
masses, so one motion of a robot of nothing but 1 kg there gives the exact change. Friction that
depends on the load is not linear: it is kept as at the last exact solution, and a choice is settled
only by one at its own masses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.drives.brake import at_rest, rest_of, resting_loads
from pinfric.drives.demand import (
    DriveCycle,
    drive_cycle,
    driven_joint,
    gear_demand,
    hold_samples,
)
from pinfric.drives.drivetrain import Candidate
from pinfric.drives.duty import Schedule
from pinfric.drives.friction import without_drives
from pinfric.drives.inertia import joint_inertias
from pinfric.drives.limit import JointCase
from pinfric.drives.policy import BASE_AXES, Conditions
from pinfric.drives.rated import RatedCycle
from pinfric.drives.way import Way, pins, way_of
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.outcome import Status
from pinfric.dynamics.samples.reactions import state_wrenches
from pinfric.dynamics.samples.states import MotionLike, States
from pinfric.errors import SizingError
from pinfric.model.loops import carriers
from pinfric.model.mass_matrix import mass_matrices
from pinfric.model.scene import Scene
from pinfric.model.schema import Actuator, Product
from pinfric.model.urdf import implausible_body
from pinfric.motions.trajectory import Trajectory

#: Motions with more samples are solved again rather than kept for each drive's influence.
_MOST_SAMPLES = 50_000

#: Masses (kg) that drives add to the links that carry them, by the drive's column.
Masses = Mapping[int, float]


@dataclass(frozen=True)
class _Point:
    """Of a robot of nothing but 1 kg at a drive: (T, na), (T, na), (T, na), (T, nj, 6)."""

    effort: np.ndarray
    rest: np.ndarray
    inertia: np.ndarray
    wrench: np.ndarray


class _Solved:
    def __init__(self, robot: DrivenRobot, masses: Masses) -> None:
        self.masses = dict(masses)
        self.scene = with_masses(robot.scene, masses)
        self.result = inverse_dynamics(self.scene, robot.motion)
        _check_known(self.result)
        states = self.result.states
        self.rest = resting_loads(at_rest(self.scene, states), robot.conditions)
        self.inertia = joint_inertias(self.scene, states)

    @cached_property
    def wrench(self) -> np.ndarray:
        """(T, nj, 6) of the joints."""
        return state_wrenches(self.scene, self.result.states, self.result.external)


def _check_known(result: InverseResult) -> None:
    """Refuse a cycle with samples of unknown efforts, or whose interval may be too narrow."""
    unknown = np.isnan(result.effort_lower).any(axis=1)
    samples = np.flatnonzero(unknown | result.interval_searched)
    if not len(samples):
        return
    i = int(samples[0])
    what = (
        f"has no efforts ({Status(int(result.status[i])).name.lower()}): change the motion there"
        if unknown[i]
        else "has intervals of efforts at rest that may be too narrow (so many joints load each "
        "other that the ends are the best of a search): remove friction from joints where it does "
        "not matter"
    )
    raise SizingError(f"{result.scene.source}: sample {i} of {len(unknown)} {what}")


class DrivenRobot:
    """A robot along its cycle, with any masses of its drives.

    Args:
        scene: the robot as given. duty: which samples are which cycle. rating: in the motion.
        like: the same robot and motion with other payloads; None: there is none.
    """

    def __init__(
        self,
        scene: Scene,
        motion: MotionLike,
        duty: Schedule | None,
        conditions: Conditions,
        rating: RatedCycle | None = None,
        like: DrivenRobot | None = None,
    ) -> None:
        self.rating = rating
        self.scene, self.motion, self.duty, self.conditions = scene, motion, duty, conditions
        self.base = self.last = _Solved(self, {})
        states = self.result.states
        self.holding = holds(scene, motion, states.v)
        self.exact = bool(scene.loops) or len(states.q) > _MOST_SAMPLES
        self._points: dict[int, _Point] = {} if like is None else like._points
        self._ways: dict[int, Way | None] = {}

    @property
    def result(self) -> InverseResult:
        """Inverse dynamics of the last exact solution."""
        return self.last.result

    def solve(self, masses: Masses) -> None:
        """Solve with these masses; changes are added to this solution."""
        carried_masses = {k: m for k, m in masses.items() if m and carried(self.scene, k)}
        if carried_masses != self.last.masses:
            self.last = _Solved(self, carried_masses) if carried_masses else self.base

    def cycle(self, i: int, means: Schedule | None = None) -> DriveCycle:
        """Return a drive's samples without the mass of any drive; see `case`."""
        return drive_cycle(self.base.result, i, self.holding, means or self.duty)

    def case(
        self, i: int, masses: Masses, means: Schedule | None = None, alone: str = ""
    ) -> JointCase:
        """Return a joint with the masses of the drives beyond it.

        Args:
            i: the drive's column. masses: of all drives; those that do not load it do not count.
            means: what its means are taken over; None: the duty.
            alone: "cycle" or "rating", as if the other one were not there; empty: both count.
        """
        beyond = {k: m for k, m in masses.items() if m and loads(self.scene, k, i)}
        there = {k: m for k, m in self.last.masses.items() if loads(self.scene, k, i)}
        if self.exact and beyond != there:
            self.solve(beyond)
            there = beyond
        more = {k: beyond.get(k, 0.0) - there.get(k, 0.0) for k in {**beyond, **there}}
        points = {k: self._point(k) for k, m in more.items() if m}
        cycle = drive_cycle(self.result, i, self.holding, means or self.duty)
        if self.rating is not None:
            cycle = self.rating.own_speed(cycle)
        own, resting = self.last.inertia[:, i], self.last.rest[:, i]
        joint, wrench = driven_joint(self.scene, i), None
        for k, point in points.items():
            effort = more[k] * point.effort[:, i] * cycle.powered
            if self.rating is not None:
                effort = np.where(self.rating.others_speed(cycle), 0.0, effort)
            resting, own = resting + more[k] * point.rest[:, i], own + more[k] * point.inertia[:, i]
            cycle = replace(
                cycle,
                effort_lower=cycle.effort_lower + effort,
                effort_upper=cycle.effort_upper + effort,
                effort_frictionless=cycle.effort_frictionless + effort,
            )
            if joint is not None:
                wrench = self.last.wrench[:, joint - 1] if wrench is None else wrench
                wrench = wrench + more[k] * point.wrench[:, joint - 1]
        rated = self.rating
        if rated is not None and alone:
            keep, duty = (means or rated.schedule).samples(rated.apart()[alone])
            cycle, resting, own = cycle.some(keep, duty), resting[keep], own[keep]
            if joint is not None:
                wrench = (self.last.wrench[:, joint - 1] if wrench is None else wrench)[keep]
        demand = gear_demand(self.result, i, cycle, wrench=wrench)
        inertia_max = None if np.isnan(own).any() else float(own.max())
        hand = depth(self.scene, i) > BASE_AXES
        swung = None
        if rated is not None and alone != "cycle" and inertia_max is not None:
            swung = 0.0 if alone else float(own[rated.own].max(initial=0.0))
        still = rest_of(self.scene, i, resting, demand.peak, demand.speed, self.conditions)
        known = demand, cycle, inertia_max, hand, self.conditions, still, swung
        return JointCase(*known, way=self._way(i))

    def _way(self, i: int) -> Way | None:
        if i not in self._ways:
            self._ways[i] = way_of(self.scene, i, self.base.result.states.q)
        return self._ways[i]

    def _point(self, k: int) -> _Point:
        if k not in self._points:
            model = self.scene.model.copy()
            for j in range(model.njoints):
                model.inertias[j] = pin.Inertia.Zero()
            model.armature = np.zeros(model.nv)
            scene = with_masses(
                replace(self.scene, model=model, friction={}, payloads={}, springs=()), {k: 1.0}
            )
            q, v, a = (getattr(self.base.result.states, x) for x in "qva")
            moving = inverse_dynamics(scene, q, v, a)
            still = inverse_dynamics(scene, q, 0 * v, 0 * a)
            states = States(q, v, a)
            self._points[k] = _Point(
                moving.effort_frictionless,
                still.effort_frictionless,
                joint_inertias(scene, states),
                state_wrenches(scene, states),
            )
        return self._points[k]

    def mass_matrices(self, masses: Masses, poses: np.ndarray) -> np.ndarray:
        """Return M(q) (n, nv, nv) with the drives' masses, at some samples (n,) of the motion."""
        scene, states = with_masses(self.scene, masses), self.base.result.states
        carried = None if states.attached is None else states.attached[poses]
        picked = States(states.q[poses], states.v[poses], states.a[poses], None, carried)
        parts = [
            mass_matrices(scene.twin(names), picked.q[start:stop])
            for start, stop, names in picked.phases(scene)
        ]
        return np.concatenate(parts)


def holds(scene: Scene, trajectory: MotionLike, v: np.ndarray) -> np.ndarray:
    """Return (T,) which samples hold: those the trajectory knows (v = a = 0), else by velocity."""
    mask = np.zeros(len(v), dtype=bool)
    for hold in trajectory.holds() if isinstance(trajectory, Trajectory) else ():
        mask[hold.first : hold.last + 1] = True
    return mask if mask.any() else hold_samples(scene, v)  # a log is never at rest exactly


def with_masses(scene: Scene, masses: Masses) -> Scene:
    """Return the scene with masses (kg) at drives' joints, on the links that carry them.

    Raises:
        SizingError: a mass below 0 (a drive lighter than the one in the URDF) leaves a link that is
            not a possible body.
    """
    model, changed = scene.model.copy(), False
    there = ((i, mass, *at) for i, mass in masses.items() if mass for at in holders(scene, i))
    for i, whole, link, place, share in there:
        mass = share * whole
        point = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
        before = implausible_body(model.inertias[link].mass, model.inertias[link].inertia)
        model.appendBodyToJoint(link, point, pin.SE3(np.eye(3), place))
        body = model.inertias[link]
        problem = implausible_body(body.mass, body.inertia)
        if problem and (body.mass < 0 or not before):  # else the URDF's own, warned of on loading
            raise SizingError(
                f"conditions.mass_in_urdf.{scene.drives[i].name}: without {-mass:g} kg, the link "
                f"that carries this drive is not a possible body: {problem}"
            )
        changed = True
    return replace(scene, model=model) if changed else scene


def equip(scene: Scene, drives: Mapping[int, Candidate], conditions: Conditions) -> Scene:
    """Return the scene with drives of a catalogue: their masses and gears in place of its own.

    Its `masses` says then that its links hold them, `installed` which they are. A drive whose mass
    is not known adds none.

    Args:
        drives: by their columns. conditions: `mass_in_urdf`.

    Raises:
        SizingError: as `with_masses`.
    """
    names = scene.actuator_names
    bare = without_drives(scene, [names[i] for i in drives])
    heavier = with_masses(
        bare, added_masses(bare, conditions, {i: drive.mass for i, drive in drives.items()})
    )
    fitted = {names[i]: _fitted(drive) for i, drive in drives.items()}
    actuators = scene.actuators
    if actuators is None:
        actuators = [Actuator(joint=drive.name) for drive in scene.drives]
    changed = [a.model_copy(update=fitted.get(a.drive_name, {})) for a in actuators]
    words = {True: "with_drives", False: "without_drives"}
    held = {
        n: words[hold] for n, hold in zip(names, scene.masses_hold, strict=True) if hold is not None
    }
    held |= {names[i]: "with_drives" for i, drive in drives.items() if drive.mass is not None}
    return replace(heavier, actuators=changed, masses=held or scene.masses, sized=None)


def _fitted(drive: Candidate) -> dict[str, Any]:
    """The entries of an actuator that are a drive's."""
    gear = drive.transmission
    product = None if gear is None else Product(drive=drive.name, brake=drive.brake or None)
    return {"transmission": gear, "installed": product}


def holders(scene: Scene, drive: int) -> list[tuple[int, np.ndarray, float]]:
    """Return where moving links carry a drive: joint, place (3,) in its frame, share of the mass.

    A drive on a joint is at its origin, on the parent link; half a cylinder at each of its pins.
    """
    model, joint = scene.model, driven_joint(scene, drive)
    if joint is not None:
        found = [(int(model.parents[joint]), model.jointPlacements[joint].translation, 1.0)]
    else:
        found = [(row + 1, place, 0.5) for row, place in pins(scene, drive)]
    return [one for one in found if one[0]]


def loads(scene: Scene, drive: int, actuator: int) -> bool:
    """Whether a drive's mass acts on a joint: a link hangs on it, or a loop may move it."""
    held, joint = holders(scene, drive), driven_joint(scene, actuator)
    if not held or scene.loops or joint is None:
        return bool(held)
    return any(joint - 1 in carriers(scene.model, link - 1) for link, _, _ in held)


def added_masses(
    scene: Scene, conditions: Conditions, masses: Mapping[int, float | None]
) -> dict[int, float]:
    """Return what drives add to the robot's links, kg, by the drive's column.

    Args:
        scene: its `masses` says which drives the links hold already; where it does not, none.
        conditions: `mass_in_urdf`, which is taken off. masses: of the drives; None: not known.
    """
    inside, names = conditions.mass_in_urdf, scene.actuator_names
    return {
        i: mass - inside.get(names[i], 0.0)
        for i, mass in masses.items()
        if mass is not None and (not scene.masses_hold[i] or names[i] in inside)
    }


def carried(scene: Scene, drive: int) -> bool:
    """Whether a moving link of the robot carries a drive: not the ground alone."""
    return bool(holders(scene, drive))


def depth(scene: Scene, actuator: int) -> int:
    """Return how many joints lie between the ground and what it moves, its own included."""
    joint = driven_joint(scene, actuator) or 0
    rows = [row for row, _ in pins(scene, actuator)] or [joint - 1]
    return max(len(carriers(scene.model, row)) for row in rows)


def tip_to_base(scene: Scene) -> list[int]:
    """Return the drives' columns, those farthest from the ground first."""
    return sorted(range(len(scene.drives)), key=lambda i: -depth(scene, i))
