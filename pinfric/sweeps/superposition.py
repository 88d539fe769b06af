"""Cycles of a sweep as sums of stored ones, without inverse dynamics of each sample.

For each body b (the robot, a payload that varies) and each cause c (gravity's three components, the
motion) efforts tau_bc and wrenches w_bc along the path are computed once; a sample's are

    w = sum_bc k_b k_c w_bc,     k_c = (R^T g, s^2)

with speed factor s and base R, and likewise tau. Of wrenches the parts B w are stored whose norms
are the sites' loads. A payload's inertial parameters are quadratic in
its centre of mass, so they are interpolated exactly. See `notebooks/theory/sweeps.md`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.drives.cycles import Asked, Rated
from pinfric.drives.demand import driven_joint
from pinfric.drives.inertia import joint_inertias
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.reactions import state_wrenches
from pinfric.dynamics.samples.states import States, attached_columns
from pinfric.model.bearings import axes_along
from pinfric.model.drives import Gears
from pinfric.model.friction_terms import CONSTANT, FrictionTerm, Stribeck
from pinfric.model.laws import Laws, friction_law, law_table
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION
from pinfric.model.scene import Scene
from pinfric.model.transmission import MakersEfficiency, OwnTransmission
from pinfric.motions.trajectory import Trajectory
from pinfric.sweeps.motors import Trial
from pinfric.sweeps.parameters import ELASTIC, SET, Target, mounted_gravity
from pinfric.sweeps.superposition_kernels import Basis, Cycle, Path, Varied, write_figures

#: Between the places of a payload's centre of mass (m).
_STEP = 0.1
#: Numbers stored, at most: 160 MB.
_MOST = 2e7
#: Sections of targets that change coefficients, laws or gears only.
_SECTIONS = {"friction", "transmission", "payload", "speed", "mounting"}
#: Which components of a `Strength` a factor acts on, by the direction it names.
_WAYS = {"": slice(0, 3), "positive": slice(1, 2), "negative": slice(2, 3)}
#: Efforts whose squares are numbers; others are the general path's.
_LEAST_EFFORT, _LARGEST_EFFORT = 1e-150, 1e150


class Summed(NamedTuple):
    """Cycles of n samples.

    Attributes:
        demands: (n, na, 5) on each drive; asked: (n, k, ...) of drives on trial (`write_figures`).
        inertias: (n, na) largest about each joint, kg m^2 (kg); no rows without trials.
        fine: (n,) false where the general path must say what is wrong with a cycle.
    """

    demands: np.ndarray
    asked: np.ndarray
    inertias: np.ndarray
    fine: np.ndarray


@dataclass(frozen=True)
class Superposition:
    """The stored cycles of a sweep, and how its values scale them.

    Attributes:
        scene, trajectory, targets: as in `cycle.Study`.
        bodies: scenes of the robot with all that stays, and of each varied payload alone at each of
            its places.
        basis: each body run by each cause.
        path: what all samples share.
        tried: the drives on trial; None: there are none.
    """

    scene: Scene
    trajectory: Trajectory
    targets: tuple[Target, ...]
    bodies: tuple[Scene, ...]
    basis: Basis
    path: Path
    tried: Rated | None = None

    @classmethod
    def of(
        cls,
        scene: Scene,
        trajectory: Trajectory,
        targets: tuple[Target, ...],
        trials: Sequence[Trial] = (),
    ) -> Superposition | None:
        """Compute the stored cycles; None where samples are not sums of them (see `_is_linear`).

        Or where a drive on trial is not judged by figures of a cycle.
        """
        if not all(trial.by_figures for trial in trials) or (trials and len(trajectory.t) < 2):
            return None
        others = {k: p for k, p in scene.payloads.items() if k not in _varied_payloads(targets)}
        bodies = (scene.with_(payloads=others, actuators=None), *_places(scene, targets))
        needed, tried = _parts(scene, trials)
        causes, width = _causes(scene, targets), scene.model.nv + sum(len(x.still) for x in needed)
        numbers = len(bodies) * len(causes) * len(trajectory.t) * width
        if not _is_linear(scene, targets) or numbers > _MOST:
            return None
        states, efforts, parts = _states(scene, trajectory), [], []
        sites, away = scene.site_tables, np.zeros((len(states.q), len(scene.sites)))
        if sites.contacts.moves.any():
            away = scene.twin().displacements(sites.joint, states.q)
        for body, (gravity, moves) in product(bodies, causes):
            result = inverse_dynamics(
                body.with_(gravity=gravity),
                states.q,
                states.v * moves,
                states.a * moves,
                attached=_carrying(scene, body, states).attached,
                threads=1,
            )
            efforts.append(result.effort_frictionless.reshape(-1))
            there = [np.empty((len(states.q), 0))]
            if needed:
                wrench = _wrenches(result, {part.row for part in needed})
                there += [part.of(wrench[part.row], away) for part in needed]
            parts.append(np.concatenate(there, axis=1).reshape(-1))
        path = Path(  # the columns of v are the drives', one for each
            t=trajectory.t,
            v=states.v,
            a=states.a,
            weight=_weights(trajectory.t),
            sites=sites,
            stick_velocity=scene.gears().stick_velocity,
            geared=any(drive.transmission is not None for drive in scene.drives),
        )
        basis = Basis(np.stack(efforts), np.stack(parts))
        return cls(scene, trajectory, targets, bodies, basis, path, tried)

    def cycles(self, values: np.ndarray) -> Summed:
        """Return each sample's cycle as the sum of stored ones, reduced by `write_figures`.

        Args:
            values: (n, number of targets).
        """
        n, trials = len(values), 0 if self.tried is None else len(self.tried.column)
        figures = np.empty((n, len(self.scene.drives), 5))
        asked = np.empty((n, trials, len(Asked._fields)))
        cycle = Cycle.of(self.path, self.basis, trials)  # a thread's own
        speed, bodies, causes = self._coefficients(values)
        varied = Varied(
            (bodies[:, :, None] * causes[:, None, :]).reshape(n, -1),
            speed,
            laws_of_samples(self.scene, self.targets, values),
            gears_of_samples(self.scene, self.targets, values),
        )
        with np.errstate(all="ignore"):
            write_figures(*self.basis, self.path, varied, cycle, self.tried, figures, asked)
        size = figures[:, :, :4]
        fine = (size == 0.0) | ((size > _LEAST_EFFORT) & (size < _LARGEST_EFFORT))
        inertias = np.empty((0, len(self.scene.drives)))
        if trials:
            inertias = np.stack([np.tensordot(k, self._inertias, 1).max(axis=0) for k in bodies])
        return Summed(figures, asked, inertias, fine.all(axis=(1, 2)) & self._can_move(speed))

    @cached_property
    def _inertias(self) -> np.ndarray:
        """(bodies, T, na) inertia of each body about each joint."""
        states = _states(self.scene, self.trajectory)
        return np.stack(
            [joint_inertias(body, _carrying(self.scene, body, states)) for body in self.bodies]
        )

    def _coefficients(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Speed factors (n,), k_b (n, bodies) and k_c (n, causes) of each sample."""
        n = len(values)
        columns = values.T.copy()  # contiguous, like the default speed: one compiled kernel
        column_of = {
            (t.section, *t.names[:1], t.key): column
            for t, column in zip(self.targets, columns, strict=True)
        }
        speed = column_of.get(("speed", ""), np.ones(n))
        bodies = [np.ones((n, 1))]
        for name, keys in _varied_payloads(self.targets).items():
            payload = self.scene.payloads[name]
            mass = column_of.get(("payload", name, "mass"), np.full(n, payload.mass))
            away = [
                column_of["payload", name, key] - payload.com["xyz".index(key[-1])]
                for key in keys
                if key != "mass"
            ]
            # weights that give a quadratic at x from its values at `_offsets`; halves: exact
            x = np.array(away).reshape(-1, n) / _STEP
            inverse = np.round(2 * np.linalg.inv(_monomials(_offsets(len(x)).T))) / 2
            shares = np.einsum("nm,mp->np", _monomials(x), inverse)
            bodies.append((mass / payload.mass)[:, None] * shares)
        sections = {target.section for target in self.targets}
        causes = [np.ones((n, 1))]
        if "mounting" in sections:
            angles = (column_of.get(("mounting", key), np.zeros(n)) for key in ("roll", "pitch"))
            turned = zip(*angles, strict=True)
            causes = [np.array([mounted_gravity(self.scene.model, *both) for both in turned])]
        if sections & {"mounting", "speed"}:
            causes.append((speed * speed)[:, None])
        return speed, np.concatenate(bodies, axis=1), np.concatenate(causes, axis=1)

    def _can_move(self, speed: np.ndarray) -> np.ndarray:
        """(n,) whether `Trajectory` accepts these speed factors, with a margin."""
        t, s = self.trajectory.t, speed
        latest = abs(t[0]) + (t[-1] - t[0]) / s
        rates = (abs(x).max() for x in (self.trajectory.v, self.trajectory.a))
        largest = np.max([latest, next(rates) * s, next(rates) * s * s], axis=0)
        apart = np.diff(t).min(initial=np.inf) / s > 1e-12 * latest
        return apart & (largest < LARGEST_OF_A_MOTION / 2)


class _Part(NamedTuple):
    """(B + s C) w of one joint's wrench: its row, the site of s, and B and C (rank, 6)."""

    row: int
    site: int
    still: np.ndarray
    moved: np.ndarray

    def of(self, wrench: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Return (T, rank) of a wrench (T, 6) and the displacements of all sites (T, ns)."""
        part = wrench @ self.still.T
        if self.moved.any():
            part = part + displacement[:, [self.site]] * (wrench @ self.moved.T)
        return part


def _parts(scene: Scene, trials: Sequence[Trial]) -> tuple[list[_Part], Rated | None]:
    """The parts of wrenches that loads and trials need (`Basis`), and the drives on trial."""
    sites = scene.site_tables
    terms = zip(*sites.contacts[:4], strict=True)
    parts = [
        _Part(int(sites.joint[s]), int(s), still[:rank], moved[:rank] * sites.contacts.moves[s])
        for s, rank, still, moved in terms
    ]
    if not trials:
        return parts, None
    width, carried = sum(len(part.still) for part in parts), []
    for trial in trials:
        joint = driven_joint(scene, trial.actuator) if trial.candidate.carried else None
        carried.append(-1 if joint is None else width)
        if joint is not None:
            axis = scene.twin().axis[joint - 1]
            turn = axes_along(axis[3:] if axis[3:].any() else axis[:3])
            parts.append(_Part(joint - 1, -1, np.kron(np.eye(2), turn), np.zeros((6, 6))))
            width += 6
    drives = [(trial.actuator, trial.candidate) for trial in trials]
    return parts, Rated.of(drives, carried, trials[0].conditions)


def _wrenches(result: InverseResult, rows: Collection[int]) -> Mapping[int, np.ndarray]:
    """Wrenches (T, 6) of joints by row: the result's if it has them all."""
    sites = [site.joint for site in result.scene.sites]
    if result.wrench is not None and set(rows) <= set(sites):
        return {row: result.wrench[:, k] for k, row in enumerate(sites)}
    wrench = state_wrenches(result.scene, result.states, threads=1)
    return {row: wrench[:, row] for row in rows}


def _is_linear(scene: Scene, targets: Sequence[Target]) -> bool:
    """Whether every sample is a sum of stored cycles, and only a number out of range is refused.

    Not with loops, drives off the joints or several on one (friction reacts on wrenches), springs
    (gravity's components do not scale them), bearings that refuse a moment, values that change a
    gear's loss or a term's shape, and sections unknown here.
    """
    varied = {(target.section, name) for target in targets for name in target.names}
    gears = [drive.transmission for drive in scene.drives if ("transmission", drive.name) in varied]
    rubbing = [site.friction for site in scene.sites if ("friction", site.name) in varied]
    bearings = [site.friction.bearing for site in scene.sites]
    return (
        scene.linkage is None
        and not scene.springs
        and scene.one_drive_each
        and {target.section for target in targets} <= _SECTIONS
        and not any(target.key in (*SET, *ELASTIC) for target in targets)
        and not any(
            gear is None
            or isinstance(gear, OwnTransmission)
            or isinstance(gear.efficiency, MakersEfficiency)
            for gear in gears
        )
        and all(proportional(term) for friction in rubbing for term in friction.terms)
        and all(bearing is None or bearing.roll_lever() is None for bearing in bearings)
    )


def _varied_payloads(targets: Sequence[Target]) -> dict[str, list[str]]:
    """Return the keys of each payload that vary, those of its centre of mass ordered x, y, z."""
    changes: dict[str, list[str]] = {}
    for name, key in sorted({(t.names[0], t.key) for t in targets if t.section == "payload"}):
        changes.setdefault(name, []).append(key)
    return changes


def _offsets(count: int) -> np.ndarray:
    """(places, count) points whose values determine a quadratic in so many variables."""
    unit = np.eye(count)
    pairs = [unit[i] + unit[j] for i, j in combinations(range(count), 2)]
    return np.array([np.zeros(count), *unit, *-unit, *pairs])


def _monomials(x: np.ndarray) -> np.ndarray:
    """(n, places) the terms of a quadratic in the rows of x (count, n)."""
    pairs = [x[i] * x[j] for i, j in combinations(range(len(x)), 2)]
    return np.stack([np.ones(x.shape[1]), *x, *x * x, *pairs], axis=1)


def _places(scene: Scene, targets: Sequence[Target]) -> Iterator[Scene]:
    """Yield each varied payload alone, its centre of mass at each place that it needs."""
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
    """Return gravity (3,), and whether the robot moves, of each part with an own coefficient."""
    sections, gravity = {target.section for target in targets}, scene.model.gravity.linear
    if "mounting" in sections:
        return [*((axis, False) for axis in np.eye(3)), (np.zeros(3), True)]
    if "speed" in sections:
        return [(gravity, False), (np.zeros(3), True)]
    return [(gravity, True)]


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
    """(T,) weights of samples in a mean over time by the trapezoidal rule."""
    if len(t) == 1:
        return np.ones(1)
    steps = np.diff(t, prepend=t[0], append=t[-1])
    return (steps[:-1] + steps[1:]) / (2 * (t[-1] - t[0]))


def laws_of_samples(scene: Scene, targets: Sequence[Target], values: np.ndarray) -> Laws:
    """Return `law_table` of each sample: strengths (n, ...), n = 1 where friction does not vary.

    Args:
        scene: without the values.
        targets, values: (n, number of targets).
    """
    # a site without any term keeps a row of zeros
    terms = [(site, key) for site in scene.sites for key in site.friction.named_terms or [""]]
    alone = [
        site.friction.model_copy(update={k: None for k in site.friction.named_terms if k != key})
        for site, key in terms
    ]
    table = law_table(
        [
            friction_law(entry, site.law.stick_velocity)
            for entry, (site, _) in zip(alone, terms, strict=True)
        ]
    )
    varied = [j for j, target in enumerate(targets) if target.section == "friction"]
    factor = np.ones((len(values) if varied else 1, len(terms), 3))
    for j in varied:
        key, _, way = targets[j].key.partition(".")
        for i, (site, of) in enumerate(terms):
            if site.name in targets[j].names and of == key:
                factor[:, i, _WAYS[way]] *= values[:, j, None]
    counts = np.array([len(site.friction.named_terms) or 1 for site in scene.sites], dtype=np.int64)
    last = np.cumsum(counts) - 1
    first = last + 1 - counts
    of_row = np.repeat(np.arange(len(terms)), table.row_end - table.row_start)

    def summed(strength: np.ndarray) -> np.ndarray:
        return np.add.reduceat(strength, first, axis=1) if len(first) else strength

    mu, forces = factor[:, :, 0], factor[:, :, 1:]
    laws = table._replace(
        mu_static=summed(mu * table.mu_static),
        mu_kinetic=summed(mu * table.mu_kinetic),
        coulomb_static=summed(forces * table.coulomb_static),
        coulomb_kinetic=summed(forces * table.coulomb_kinetic),
        viscous=summed(forces[:, :, 0] * table.viscous),
        stick_velocity=table.stick_velocity[first],
        row_start=table.row_start[first],
        row_end=table.row_end[last],
        mu=mu[:, of_row] * table.mu,
        coulomb=forces[:, of_row] * table.coulomb,
    )
    return Laws(*map(np.ascontiguousarray, laws))  # another layout is another kernel


def gears_of_samples(scene: Scene, targets: Sequence[Target], values: np.ndarray) -> Gears:
    """Return `gear_table` of each sample: what varies (n, ...), n = 1 where no gear does.

    Args: as `laws_of_samples`.
    """
    gears = scene.gears()
    varied = [j for j, target in enumerate(targets) if target.section == "transmission"]
    factor = {
        name: np.ones((len(values) if varied else 1, *getattr(gears, name).shape))
        for name in ("no_load", "viscous", "rotor_inertia")
    }
    for j in varied:
        key, _, way = targets[j].key.partition(".")
        name = {"no_load_torque": "no_load", "motor_viscous": "viscous"}.get(key, key)
        for d, drive in enumerate(scene.drives):
            if drive.name in targets[j].names:
                scale = factor[name][:, d]
                if way:  # the motor's: a ratio below 0 turns it round
                    scale = scale[:, int((way == "positive") != (gears.ratio[d] > 0))]
                scale *= values[:, j].reshape(-1, *[1] * (scale.ndim - 1))
    return gears._replace(
        no_load=factor["no_load"] * gears.no_load,
        no_load_static=factor["no_load"] * gears.no_load_static,
        viscous=factor["viscous"] * gears.viscous,
        rotor_inertia=factor["rotor_inertia"] * gears.rotor_inertia,
    )


def proportional(term: FrictionTerm) -> bool:
    """Whether a factor on a term multiplies its strengths and nothing else."""
    stribeck = Stribeck(velocity=1.0)
    once, twice = (((CONSTANT, t.at_rest()), *t.rows(stribeck)) for t in (term, term.scaled(2.0)))
    return twice == tuple((shape, tuple(2.0 * x for x in strength)) for shape, strength in once)
