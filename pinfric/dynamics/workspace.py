"""From a state to its coupled friction problem: one batch on the wrench twin, M and h eliminated.

    M a + h - J_ext^T f_ext = u + D phi   gives   a = a_free + a_slope x,   x the friction

(design 2.1, 2.5). Forward dynamics, the integrators and a time step all start here.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import pinocchio as pin

from pinfric.dynamics.assembly import FREE, GIVEN, NOT_FINITE, assemble, finish, solve_instant
from pinfric.dynamics.consistency import ROUNDING
from pinfric.dynamics.modes import MOST_ENUMERATED, Found, Modes, only_candidate, pivot, search
from pinfric.dynamics.problem import Problem, empty_problem
from pinfric.dynamics.reactions import AppliedWrench, Batch, relieve
from pinfric.errors import (
    AccelerationError,
    AmbiguousAcceleration,
    NoConsistentAcceleration,
    RollMomentError,
    SceneError,
    StateError,
)
from pinfric.model.laws import Laws
from pinfric.model.scene import Scene, Site
from pinfric.model.twin import Twin, embed, project


@dataclass(frozen=True, eq=False)
class Tables:
    """What of a scene the assembly needs, as arrays, and nothing that changes.

    Attributes:
        coordinate: (ns,) friction coordinate of each site (`problem.py`).
        coordinate_v: (nc,) index in v of each coordinate.
        dry: (nc,) bool, whether anything on it can stick.
        stick_velocity: (nc,) at or below this speed it is at rest (rad/s or m/s).
        wrench_map, wrench_map_moved: (nt, 3, 6) of those `bearings.Contacts` whose site rubs.
        guides: sites whose bearing cannot resist a moment about its axis.
        displacement_q, displacement_ratio, displacement_shift: (ns,) how a site's displacement
            along its axis follows from q; ratio 0 where it does not matter.
    """

    joint: np.ndarray
    ratio: np.ndarray
    laws: Laws
    coordinate: np.ndarray
    coordinate_v: np.ndarray
    dry: np.ndarray
    stick_velocity: np.ndarray
    contact_site: np.ndarray
    wrench_map: np.ndarray
    wrench_map_moved: np.ndarray
    displacement_q: np.ndarray
    displacement_ratio: np.ndarray
    displacement_shift: np.ndarray
    constant: np.ndarray
    guides: tuple[int, ...]


def make_tables(scene: Scene) -> Tables:
    """Tabulate a scene's friction for `assemble`."""
    sites, t, twin = scene.sites, scene.site_tables, scene.twin()
    coordinate_v, coordinate = np.unique(t.velocity_index, return_inverse=True)
    dry, stick = np.zeros(len(coordinate_v), dtype=bool), np.full(len(coordinate_v), np.inf)
    for s, c in enumerate(coordinate):
        if t.laws.dry[s]:
            dry[c] = True
            stick[c] = min(stick[c], t.laws.stick_velocity[s] / abs(t.ratio[s]))
    rubs, moves = t.laws.loaded[t.contacts.site], t.contacts.moves
    return Tables(
        joint=t.joint,
        ratio=t.ratio,
        laws=t.laws,
        coordinate=coordinate.astype(np.int64),
        coordinate_v=coordinate_v.astype(np.int64),
        dry=dry,
        stick_velocity=stick,
        contact_site=t.contacts.site[rubs],
        wrench_map=t.contacts.map[rubs],
        wrench_map_moved=t.contacts.map_moved[rubs],
        displacement_q=np.where(moves, twin.q_index[t.joint], 0),
        displacement_ratio=np.where(moves, twin.ratio[t.joint], 0.0),
        displacement_shift=np.where(moves, twin.shift[t.joint], 0.0),
        constant=t.contacts.constant,
        guides=tuple(s for s, site in enumerate(sites) if cannot_resist_roll(site)),
    )


def cannot_resist_roll(site: Site) -> bool:
    """Return whether a site's bearing leaves the moment about its axis to others."""
    bearing = site.friction.bearing
    return bearing is not None and bearing.roll_lever() is not None


class Workspace:
    """Buffers of one scene for one thread: every solve overwrites them.

    Attributes:
        tables: `Tables`.
        problem, modes: the coupled problem and its solution.
        a_free, a_slope: (nv,), (nv, nc): a = a_free + a_slope x.
        a, phi, load, wrench: (nv,), (ns,), (ns,), (ns, 6) of the solution: accelerations,
            friction, normal load and wrench of each site.
        multipliers: (nl,) forces that close loops; none in an open chain.
        locked: whether what sticks lets nothing move (known where joints are linked).
        turns_balls: whether the friction of balls that slip is pointed against their motion.
        least, most: (nc,) static limits of the friction x.
        site_modes: (ns,) int8, -1, 0, 1.
    """

    def __init__(self, scene: Scene, attached: Iterable[str] | None = None) -> None:
        self.scene = scene
        self.twin: Twin = scene.twin(attached)
        self.nq, self.nv, self.na = scene.model.nq, self.twin.nv, len(scene.drives)
        self.multipliers = np.zeros(0)
        self.turns_balls, self.locked = True, False
        self._make(scene)

    def _make(self, scene: Scene) -> None:
        self.tables = t = make_tables(scene)
        nv, nc, ns = self.nv, len(t.coordinate_v), len(t.joint)
        self.problem: Problem = empty_problem(t.coordinate, t.ratio, t.contact_site, t.constant)
        self.out = np.zeros(nv + 8 * ns)  # one array, so that an `Instant` is one copy
        self.a, self.phi = self.out[:nv], self.out[nv : nv + ns]
        self.wrench = self.out[nv + 2 * ns :].reshape(ns, 6)
        self.load = self.out[nv + ns : nv + 2 * ns]
        self.modes = Modes.of(nc, self.load)
        self.site_modes = np.zeros(ns, dtype=np.int8)
        self.a_free, self.a_slope = np.zeros(nv), np.zeros((nv, nc))
        self.least, self.most = np.zeros(nc), np.zeros(nc)
        self._make_batch()
        # the kernels' arguments beside the state, in their order
        self._assembly = (
            self.batch.wrench, self._rows, self.twin.armature, t.joint, t.laws, t.coordinate_v,
            t.wrench_map, t.wrench_map_moved, t.displacement_q, t.displacement_ratio,
            t.displacement_shift, np.empty((nv, nv)), self.a_free, self.a_slope,
        )  # fmt: skip
        self._solving = (
            t.dry, t.stick_velocity, *self.modes.arrays(), self.least, self.most, self.phi,
            self.site_modes, self.a, self.wrench, *self.problem,
        )  # fmt: skip

    def _make_batch(self) -> None:
        """Samples of the batch: the state at a = 0; at rest with a = 0 and with unit a."""
        twin = self.twin
        nv = twin.nv
        self.batch = batch = Batch.of(twin, nv + 2)
        self._rows = np.empty((nv + 2, nv))
        self._embedding = (twin.kind, twin.q_index, twin.v_index, twin.ratio, twin.shift,
                           twin.axis, twin.components)  # fmt: skip
        unit = np.zeros((nv + 2, nv))
        unit[2:] = np.eye(nv)
        neutral = np.tile(pin.neutral(self.scene.model), (nv + 2, 1))
        embed(neutral, np.zeros_like(unit), unit, *self._embedding, batch.q, batch.v, batch.a)
        self._no_acceleration = np.zeros((1, nv))
        self._first = Batch(batch.q[:1], batch.v[:1], batch.a[:1], batch.wrench[:1])
        self._columns = batch.q.T, batch.v.T, batch.a.T, batch.wrench.reshape(nv + 2, -1).T
        self._projection = (batch.wrench, twin.v_index, twin.ratio, twin.axis, twin.components,
                            self._rows)  # fmt: skip
        self._pool = None if twin.opened is None else twin.pool(1)
        self._unit = unit

    def run_batch(
        self, q: np.ndarray, v: np.ndarray, applied: list[AppliedWrench] | None = None
    ) -> None:
        """Compute the batch's wrenches at one state (design 2.1).

        Args:
            q, v: (nq,), (nv,), C-ordered.
            applied: wrenches from outside, one sample each.
        """
        batch, first = self.batch, self._first
        embed(q[None], v[None], self._no_acceleration, *self._embedding, first.q, first.v, first.a)
        batch.q[1:] = batch.q[0]
        if self._pool is not None:
            pin.rneaInParallel(1, self._pool, *self._columns)
        else:
            self._run_large(q, v)
        if applied:
            relieve(self.twin, applied, slice(0, 1), first)
        project(*self._projection)

    def _run_large(self, q: np.ndarray, v: np.ndarray) -> None:
        """The batch of a robot too large to open, sample by sample (see `reactions`)."""
        data, forces = self.twin.joint_forces()
        for i, a in enumerate(self._unit):
            pin.rnea(self.twin.model, data, q, v if i == 0 else 0.0 * v, a)
            np.concatenate(forces, out=self.batch.wrench[i].reshape(-1))

    def solve(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None = None,
    ) -> None:
        """Find modes, friction and accelerations at one state (design 2.5).

        Args:
            q, v, effort: (nq,), (nv,), (na,), C-ordered.
            applied: wrenches from outside, one sample each.

        Raises:
            StateError: a value is not finite; SceneError: the mass matrix is singular.
            NoConsistentAcceleration, AmbiguousAcceleration: see there.
        """
        self.run_batch(q, v, applied)
        outcome, solutions, obeying, resting = solve_instant(
            q, v, effort, FREE, *self._assembly, *self._solving
        )
        if obeying == 1:
            return
        if outcome:
            self._refuse(outcome, q, v, effort)
        found = search(self.problem, self.modes) if resting else only_candidate(solutions, obeying)
        if found != Found.SOLVED:
            raise self.failure(found, q, v, effort)
        self.finish()

    def solve_given_modes(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None = None,
    ) -> None:
        """Find friction and accelerations with the modes in `modes`, whatever the velocities.

        Args, raises: see `solve`.
        """
        self.run_batch(q, v, applied)
        outcome, solutions, obeying, _ = solve_instant(
            q, v, effort, GIVEN, *self._assembly, *self._solving
        )
        if outcome:
            self._refuse(outcome, q, v, effort)
        if obeying != 1:
            raise self.failure(only_candidate(solutions, obeying), q, v, effort)

    def assemble(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None = None,
        step: float = 0.0,
    ) -> None:
        """Write the coupled problem at one state, unsolved.

        Args:
            q, v, effort, applied: see `solve`.
            step: 0: r is the relative acceleration; else the time step (s) of which r is the
                relative velocity at the end, with viscous friction implicit.

        Raises:
            StateError: a value is not finite; SceneError: the mass matrix is singular.
        """
        self.run_batch(q, v, applied)
        outcome = assemble(q, v, effort, step, *self._assembly, self.problem)
        if outcome:
            self._refuse(outcome, q, v, effort)

    def rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the relative velocity of every coordinate (nc,) at q (nq,), v (nv,)."""
        return np.asarray(v[self.tables.coordinate_v])

    def speeds(self, rates: np.ndarray) -> np.ndarray:
        """Return how fast each coordinate's joint moves (nc,)."""
        return np.abs(rates)

    def obey(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the state with what sticks exactly at rest (and loops closed exactly)."""
        v = v.copy()
        v[self.tables.coordinate_v[self.modes.stuck]] = 0.0
        return q, v

    def stop(
        self, q: np.ndarray, v: np.ndarray, stopped: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return velocities with coordinates (nc,) bool at rest, and all that are at rest then."""
        v = v.copy()
        v[self.tables.coordinate_v[stopped]] = 0.0
        return v, stopped

    def facing(self, rates: np.ndarray) -> np.ndarray:
        """Return the direction (nc,) in which each coordinate slips at these rates (nc,)."""
        return self.modes.direction.copy()

    def summed(self, parts: np.ndarray) -> np.ndarray:
        """Return parts (nc,) summed over the coordinates of each joint."""
        return parts

    def breaking_with(self, fired: np.ndarray) -> np.ndarray:
        """Return the coordinates that break away when those in `fired` do: they alone."""
        return fired

    def way_out(self) -> np.ndarray:
        """Return the direction (nc,) in which what sticks would break away: against friction."""
        x = self.modes.friction
        return np.where(self.most - x < x - self.least, -1.0, 1.0)

    def search(
        self, forced: Mapping[int, float] | None = None, held: np.ndarray | None = None
    ) -> Found:
        """Search the modes of what is at rest; see `modes.search`."""
        return search(self.problem, self.modes, forced, held)

    def search_step(self) -> Found:
        """Search the modes at the end of a time step, from those in `modes`, else all of them."""
        dry = self.tables.dry
        found = pivot(self.problem, self.modes)
        if found != Found.SOLVED and int(dry.sum()) <= MOST_ENUMERATED:
            self.modes.at_rest[:] = dry
            found = search(self.problem, self.modes)
        return found

    def set_modes(self, modes: np.ndarray) -> None:
        """Write modes of sites (ns,) as modes of their coordinates."""
        self.modes.direction[self.tables.coordinate] = modes * np.sign(self.tables.ratio)
        self.modes.stuck[:] = (self.modes.direction == 0.0) & self.tables.dry

    def friction_rounding(self) -> np.ndarray:
        """Return how far friction (nc,) may be off by rounding (N m or N)."""
        return np.asarray(ROUNDING * (self.most - self.least))

    @property
    def guards(self) -> np.ndarray:
        """(nc,) distance of the friction of what sticks from its static limits (N m or N)."""
        x = self.modes.friction
        return np.asarray(np.minimum(x - self.least, self.most - x))

    def finish(self) -> None:
        """Write a, wrenches and each site's friction from the solution in `modes`."""
        m = self.modes
        finish(self.problem, m.stuck, m.direction, m.friction, m.load, self.tables.coordinate_v,
               self.a_free, self.a_slope, self.batch.wrench, self.tables.joint, self.least,
               self.most, self.phi, self.site_modes, self.a, self.wrench)  # fmt: skip

    def check_roll_moments(self) -> None:
        """Refuse a moment about a guide's axis that nothing resists (beyond rounding).

        Raises:
            RollMomentError: see there.
        """
        for s in self.tables.guides:
            site = self.scene.sites[s]
            assert site.friction.bearing is not None  # that is what makes it one of these
            force, moment = self.wrench[s, :3], self.wrench[s, 3:]
            roll, length = float(moment @ site.axis), site.friction.bearing.roll_lever() or 0.0
            if abs(roll) > 1e-9 * (np.linalg.norm(moment) + length * np.linalg.norm(force)):
                raise RollMomentError(site.name, 0, roll)

    def _refuse(self, outcome: int, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> NoReturn:
        for name, array in (("q", q), ("v", v), ("effort", effort)):
            if not np.isfinite(array).all():
                i = int(np.flatnonzero(~np.isfinite(array))[0])
                raise StateError(f"{name}: column {i} is {array[i]}; should be finite")
        if outcome == NOT_FINITE:
            raise StateError("forward dynamics overflows at this state: values are too large")
        raise SceneError(
            f"{self.scene.source}: the mass matrix is not positive definite at this state: a joint "
            "moves no mass; give its link an inertia, or lock it"
        )

    def failure(
        self, found: Found, q: np.ndarray, v: np.ndarray, effort: np.ndarray
    ) -> AccelerationError:
        """Return the error that says why no single acceleration was found, and where."""
        contraction = self.modes.figures[0]
        site = self.scene.site_names[self._site_of(self._worst_site())]
        state = q.copy(), v.copy(), effort.copy()
        growth = (
            f"the loads grow with the friction they cause (contraction {contraction:.4g})"
            if contraction >= 1.0
            else "neither sticking nor slipping either way is consistent"
        )
        if found == Found.AMBIGUOUS:
            return AmbiguousAcceleration(*state, site, growth)
        if found == Found.NOT_CONVERGED:
            growth = f"the coupled solve does not reach its tolerance (contraction {contraction})"
        elif int(self.modes.at_rest.sum()) > MOST_ENUMERATED:
            growth += f"; more than {MOST_ENUMERATED} joints at rest: not every mode was tried"
        return NoConsistentAcceleration(*state, site, growth)

    def _site_of(self, row: int) -> int:
        """The site of a row of the problem's sites."""
        return row

    def _worst_site(self) -> int:
        """The row of the site whose load grows most with friction: there it is inconsistent."""
        p = self.problem
        growth = np.zeros(len(p.constant))
        norms = np.linalg.norm(p.contact_slope, axis=2).sum(axis=1)
        np.add.at(growth, p.contact_site, norms)
        open_ = ~self.modes.stuck | self.modes.at_rest
        return int(np.argmax(growth * p.mu_slip + np.where(open_[p.coordinate], 0.0, -np.inf)))


def make_workspace(scene: Scene, attached: Iterable[str] | None = None) -> Workspace:
    """Return buffers of a scene's own: linked ones where it has loops or drives off the joints."""
    if scene.linkage is None:
        return Workspace(scene, attached)
    from pinfric.dynamics.linked import LinkedWorkspace  # builds on this module

    return LinkedWorkspace(scene, attached)


class _Last(threading.local):
    """The scene this thread asked for last (a weak reference), and its workspace."""

    scene: Callable[[], Scene | None] = staticmethod(lambda: None)
    found: Workspace


_LAST = _Last()


def workspace(scene: Scene, attached: Iterable[str] | None = None) -> Workspace:
    """Return this thread's workspace of a scene, made at first; it lives in the scene's twin."""
    if attached is None and _LAST.scene() is scene:
        scene.check_unchanged()
        return _LAST.found
    twin = scene.twin(attached)
    key = "forward", threading.get_ident()
    if key not in twin.pools:
        twin.pools[key] = make_workspace(scene, attached)
    found: Workspace = twin.pools[key]
    if attached is None:
        _LAST.scene, _LAST.found = weakref.ref(scene), found
    return found
