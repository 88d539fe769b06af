"""A sweep's cycles without inverse dynamics: sums of stored ones, with coefficients of the sample.

The path stays. So of each body (the robot, a payload that varies) and each cause (gravity's three
components, the motion) efforts and wrenches are computed once, tau_bc and w_bc; a sample's are

    w = sum_bc k_b k_c w_bc,     k_c = (R^T g, s^2)

with speed factor s and base R. A payload's inertial parameters are quadratic in its centre of mass:
it is interpolated, exactly, between the same body at as many places as a quadratic has terms.
Friction factors and motor-side losses multiply numbers of the laws and of the gears.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import combinations, pairwise, product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.drives.inertia import joint_inertias
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.inverse.superposed import Basis, Cycle, Path, Varied, write_figures
from pinfric.dynamics.samples.motor_torques import scene_gears
from pinfric.dynamics.samples.states import States, attached_columns
from pinfric.errors import PinfricError
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION
from pinfric.model.scene import Scene
from pinfric.model.transmission import MakersEfficiency
from pinfric.motions.trajectory import Trajectory
from pinfric.sweeps.parameters import ELASTIC, SET, Target, apply, mounted_gravity
from pinfric.sweeps.tables import gears_of_samples, laws_of_samples, proportional

#: Between the places of a payload's centre of mass (m).
_STEP = 0.1
#: Numbers stored, at most: 160 MB.
_MOST = 2e7
#: Efforts whose squares are numbers; others are the general path's.
_LEAST_EFFORT, _LARGEST_EFFORT = 1e-150, 1e150


class Solved(NamedTuple):
    """One sample's cycle, and (na,) the largest inertia about each joint in it, kg m^2 (kg)."""

    result: InverseResult
    inertias: np.ndarray


@dataclass(frozen=True)
class Superposition:
    """The stored cycles of a sweep, and what its values do to them.

    Attributes:
        scene, trajectory, targets: as `cycle.Study` has them.
        bodies: the robot and each place of each payload that varies: scenes without all else.
        basis: each body run by each cause.
        path: what all samples share.
    """

    scene: Scene
    trajectory: Trajectory
    targets: tuple[Target, ...]
    bodies: tuple[Scene, ...]
    basis: Basis
    path: Path

    @classmethod
    def of(
        cls, scene: Scene, trajectory: Trajectory, targets: tuple[Target, ...]
    ) -> Superposition | None:
        """Compute the stored cycles; None where a sample is no sum of them (see `_is_linear`)."""
        bodies = (_without(scene, _varied_payloads(targets)), *_places(scene, targets))
        causes = _causes(scene, targets)
        width = scene.model.nv + 6 * len(scene.sites)
        if (
            not _is_linear(scene, targets)
            or len(bodies) * len(causes) * len(trajectory.t) * width > _MOST
        ):
            return None
        states = _states(scene, trajectory)
        basis = _basis(scene, states, bodies, causes)
        return cls(scene, trajectory, targets, bodies, basis, _path(scene, states))

    def figures(
        self, values: np.ndarray, each: Callable[[int, Solved], None] | None = None
    ) -> np.ndarray:
        """Return (n, na, 5) what each cycle takes of each drive (`superposed.write_figures`).

        NaN where the general path has to say what is wrong with a cycle.

        Args:
            values: (n, number of targets).
            each: called with each sample's number and its cycle, which the next one overwrites.
        """
        n = len(values)
        found = np.empty((n, len(self.scene.drives), 5))
        now = Cycle.of(self.path, whole=each is not None)  # a thread's own
        speed, bodies, causes = self._coefficients(values)
        varied = Varied(
            (bodies[:, :, None] * causes[:, None, :]).reshape(n, -1),
            speed,
            laws_of_samples(self.scene, self.targets, values),
            gears_of_samples(self.scene, self.targets, values),
        )
        movable = self._can_move(speed)
        for start, stop in [(0, n)] if each is None else pairwise(range(n + 1)):
            with np.errstate(all="ignore"):
                write_figures(*self.basis, self.path, varied, now, found, start, stop)
            size = found[start:stop, :, :4]
            fine = (size == 0.0) | ((size > _LEAST_EFFORT) & (size < _LARGEST_EFFORT))
            plain = fine.all(axis=(1, 2)) & movable[start:stop]
            found[start:stop][~plain] = np.nan
            if each is not None and plain.all():
                try:
                    inertias = np.tensordot(bodies[start], self._inertias, 1).max(axis=0)
                    each(start, Solved(self._result(now, values[start], speed[start]), inertias))
                except PinfricError:
                    found[start] = np.nan
        return found

    def _result(self, now: Cycle, sample: np.ndarray, speed: float) -> InverseResult:
        """The result of the cycle in the buffers, as far as the criteria of `size` ask for it."""
        like, t = self._like, self.trajectory.t
        # of the friction they ask nothing, of what is carried nothing where wrenches are known
        known = like.wrench is not None and len(self.scene.sites) == len(self.scene.joint_names)
        asked = ("transmission",) if known else ("transmission", "payload", "mounting")
        some = [j for j, target in enumerate(self.targets) if target.section in asked]
        scene, _ = apply(
            self.scene, self.trajectory, [self.targets[j] for j in some], sample[some].tolist()
        )
        here = now.samples._asdict() | now._asdict()
        found = {entry.name: here[entry.name] for entry in fields(like) if entry.name in here}
        if not self.path.geared:
            ends = now.samples.effort_lower, now.samples.effort_upper
            found |= dict(zip(("motor_torque_lower", "motor_torque_upper"), ends, strict=True))
        found["wrench"] = None if like.wrench is None else now.wrench
        moved = replace(
            like.states, v=now.velocity, a=now.acceleration, t=t[0] + (t - t[0]) / speed
        )
        return replace(
            like,
            scene=scene,
            states=moved,
            actuator_velocity=now.velocity,
            actuator_acceleration=now.acceleration,
            **found,
        )

    @cached_property
    def _like(self) -> InverseResult:
        """A result of the path, for what no sample changes."""
        return inverse_dynamics(self.scene, self.trajectory, threads=1)

    @cached_property
    def _inertias(self) -> np.ndarray:
        """(bodies, T, na) the inertia of each body about each joint."""
        states = _states(self.scene, self.trajectory)
        return np.stack(
            [joint_inertias(body, _carrying(self.scene, body, states)) for body in self.bodies]
        )

    def _coefficients(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n,) speed factors; k_b (n, bodies) and k_c (n, causes) of each sample."""
        n = len(values)
        given = {(t.section, *t.names[:1], t.key): values[:, j] for j, t in enumerate(self.targets)}
        speed = given.get(("speed", ""), np.ones(n))
        bodies = [np.ones((n, 1))]
        for name, keys in _varied_payloads(self.targets).items():
            payload = self.scene.payloads[name]
            mass = given.get(("payload", name, "mass"), np.full(n, payload.mass))
            bodies.append(
                (mass / payload.mass)[:, None]
                * _shares(
                    np.array(
                        [
                            (given["payload", name, key] - payload.com["xyz".index(key[-1])])
                            / _STEP
                            for key in keys
                            if key != "mass"
                        ]
                    ).reshape(-1, n)
                )
            )
        sections = {target.section for target in self.targets}
        causes = [np.ones((n, 1))]
        if "mounting" in sections:
            angles = (given.get(("mounting", key), np.zeros(n)) for key in ("roll", "pitch"))
            causes = [
                np.array(
                    [mounted_gravity(self.scene.model, *both) for both in zip(*angles, strict=True)]
                )
            ]
        if sections & {"mounting", "speed"}:
            causes.append((speed * speed)[:, None])
        return speed, np.concatenate(bodies, axis=1), np.concatenate(causes, axis=1)

    def _can_move(self, speed: np.ndarray) -> np.ndarray:
        """(n,) whether `Trajectory` takes the motion at these speed factors, with a margin."""
        t, s = self.trajectory.t, speed
        latest = abs(t[0]) + (t[-1] - t[0]) / s
        rates = (abs(x).max() for x in (self.trajectory.v, self.trajectory.a))
        largest = np.max([latest, next(rates) * s, next(rates) * s * s], axis=0)
        apart = np.diff(t).min(initial=np.inf) / s > 1e-12 * latest
        return np.asarray(apart & (largest < LARGEST_OF_A_MOTION / 2))


def _is_linear(scene: Scene, targets: Sequence[Target]) -> bool:
    """Whether every sample is a sum of stored cycles, and only a number out of range is refused.

    Not with loops, drives off the joints or several on one (friction reacts on wrenches), where a
    bearing refuses a moment, and for values that change a gear's loss or a term's shape.
    """
    varied = {
        (section, name): key
        for section, key, name in ((t.section, t.key, name) for t in targets for name in t.names)
    }
    gears = [drive.transmission for drive in scene.drives if ("transmission", drive.name) in varied]
    terms = [
        term
        for site in scene.sites
        for term in site.friction.terms
        if ("friction", site.name) in varied
    ]
    return (
        scene.linkage is None
        and scene.one_drive_each
        and not any(target.key in (*SET, *ELASTIC) for target in targets)
        and not any(gear is None or isinstance(gear.efficiency, MakersEfficiency) for gear in gears)
        and all(map(proportional, terms))
        and all(
            site.friction.bearing is None or site.friction.bearing.roll_lever() is None
            for site in scene.sites
        )
    )


def _varied_payloads(targets: Sequence[Target]) -> dict[str, list[str]]:
    """What varies of each payload: its keys, those of the centre of mass in the order x, y, z."""
    found: dict[str, list[str]] = {}
    for name, key in sorted({(t.names[0], t.key) for t in targets if t.section == "payload"}):
        found.setdefault(name, []).append(key)
    return found


def _offsets(count: int) -> np.ndarray:
    """(places, count) at which a quadratic in so many variables is given by its values."""
    unit = np.eye(count)
    pairs = [unit[i] + unit[j] for i, j in combinations(range(count), 2)]
    return np.array([np.zeros(count), *unit, *-unit, *pairs])


def _monomials(x: np.ndarray) -> np.ndarray:
    """(n, places) the terms of a quadratic in the rows of x (count, n)."""
    pairs = [x[i] * x[j] for i, j in combinations(range(len(x)), 2)]
    return np.stack([np.ones(x.shape[1]), *x, *x * x, *pairs], axis=1)


def _shares(x: np.ndarray) -> np.ndarray:
    """(n, places) by which a quadratic at x (count, n) is the sum of its values at `_offsets`."""
    inverse = np.round(2 * np.linalg.inv(_monomials(_offsets(len(x)).T))) / 2  # halves: exact
    return np.einsum("nm,mp->np", _monomials(x), inverse)


def _without(scene: Scene, left_out: Iterable[str]) -> Scene:
    """The scene without some payloads, with ideal drives."""
    payloads = {name: p for name, p in scene.payloads.items() if name not in left_out}
    return scene.with_(payloads=payloads, actuators=None)


def _places(scene: Scene, targets: Sequence[Target]) -> Iterator[Scene]:
    """Each payload that varies alone, its centre of mass at each of the places it needs."""
    massless = scene.model.copy()
    massless.armature = np.zeros(scene.model.nv)
    for joint in range(1, massless.njoints):
        massless.inertias[joint] = pin.Inertia.Zero()
    for name, keys in _varied_payloads(targets).items():
        moves = ["xyz".index(key[-1]) for key in keys if key != "mass"]
        for offset in _offsets(len(moves)):
            com = np.array(scene.payloads[name].com)
            com[moves] += _STEP * offset
            placed = scene.payloads[name].model_copy(update={"com": tuple(com.tolist())})
            yield scene.with_(model=massless, payloads={name: placed}, actuators=None)


def _causes(scene: Scene, targets: Sequence[Target]) -> list[tuple[np.ndarray, bool]]:
    """Gravity (3,), and whether the path is run, of each part that has a coefficient of its own."""
    sections, gravity = {target.section for target in targets}, scene.model.gravity.linear
    if "mounting" in sections:
        return [*((axis, False) for axis in np.eye(3)), (np.zeros(3), True)]
    if "speed" in sections:
        return [(gravity, False), (np.zeros(3), True)]
    return [(gravity, True)]


def _basis(
    scene: Scene,
    states: States,
    bodies: Sequence[Scene],
    causes: Sequence[tuple[np.ndarray, bool]],
) -> Basis:
    """Run each body by each cause."""
    efforts, wrenches = [], []
    for body, (gravity, moves) in product(bodies, causes):
        attached = _carrying(scene, body, states).attached
        found = inverse_dynamics(
            body.with_(gravity=gravity),
            states.q,
            states.v * moves,
            states.a * moves,
            attached=attached,
            threads=1,
        )
        efforts.append(found.effort_frictionless.reshape(-1))
        wrenches.append(np.empty(0) if found.wrench is None else found.wrench.reshape(-1))
    return Basis(np.stack(efforts), np.stack(wrenches))


def _path(scene: Scene, states: States) -> Path:
    """What all samples share; the columns of v are the drives', one for each."""
    assert states.t is not None  # a trajectory has them
    sites, moving = scene.site_tables, scene.site_tables.contacts.moves.any()
    positions = scene.twin().displacements(sites.joint, states.q) if moving else np.empty((0, 0))
    return Path(
        v=states.v,
        a=states.a,
        weight=_weights(states.t),
        displacement=positions,
        sites=sites._replace(joint=np.arange(len(scene.sites))),
        stick_velocity=scene_gears(scene).stick_velocity,
        geared=any(drive.transmission is not None for drive in scene.drives),
    )


def _states(scene: Scene, trajectory: Trajectory) -> States:
    attached = attached_columns(scene, trajectory)
    return States.of(scene, trajectory.q, trajectory.v, trajectory.a, trajectory.t, attached)


def _carrying(scene: Scene, body: Scene, states: States) -> States:
    """The states with the columns of a body's payloads."""
    if states.attached is None:
        return states
    columns = [list(scene.payloads).index(name) for name in body.payloads]
    return replace(states, attached=states.attached[:, columns])


def _weights(t: np.ndarray) -> np.ndarray:
    """(T,) of samples in a mean over time by the trapezoidal rule."""
    if len(t) == 1:
        return np.ones(1)
    steps = np.diff(t, prepend=t[0], append=t[-1])
    return np.asarray((steps[:-1] + steps[1:]) / (2 * (t[-1] - t[0])))
