"""Buffers of one scene, and what forward dynamics and integrators ask at a state."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import hypot
from typing import Any, NoReturn, cast

import numpy as np

from pinfric.dynamics.forward.self_locking import LockingGears
from pinfric.dynamics.problem.buffers import Supplier, make_tables, make_work
from pinfric.dynamics.problem.gearing import FEW_PASSES, gear_margins, refit
from pinfric.dynamics.problem.gearing import MOST_PASSES as MOST_LINES
from pinfric.dynamics.problem.layout import make_layout
from pinfric.dynamics.problem.machine import (
    Machine,
    box_layout,
    box_machine,
    box_supply,
    box_tables,
    box_work,
)
from pinfric.dynamics.problem.maps import (
    FREE,
    GIVEN,
    NOT_FINITE,
    SETTLED,
    TOGGLE,
    TURNED,
    UNDECIDED,
    assemble,
    couple,
    finish,
    is_exact,
    measure_rates,
    relate,
    solve_instant,
    write_accelerations,
)
from pinfric.dynamics.problem.reactions import AppliedWrench
from pinfric.errors import (
    AccelerationError,
    AmbiguousAcceleration,
    ClosureError,
    GearJam,
    NoConsistentAcceleration,
    PinfricError,
    RollMomentError,
    SceneError,
    StateError,
    ToggleError,
    UndecidedAcceleration,
)
from pinfric.friction.consistency import ROUNDING, evaluate, judge, try_modes
from pinfric.friction.given_modes import reduce_problem
from pinfric.friction.law import add_load_slopes, stick_limits
from pinfric.friction.minimax import least_violation
from pinfric.friction.modes import Found, Modes
from pinfric.friction.problem import Problem
from pinfric.friction.rest import Mechanism, solve
from pinfric.friction.search import (
    MOST_ENUMERATED,
    MOST_PASSES,
    Lines,
    follow,
    outcome,
    search,
)
from pinfric.kernels.compiled import KernelArgument, compile_for, compiling, is_ready
from pinfric.model.closure import RANK, close, guesses
from pinfric.model.drives import gear_jam
from pinfric.model.loops import Linkage, no_linkage, stand_still
from pinfric.model.scene import Scene

#: A stop may change velocities by this many times the stick velocity; more, and it is none.
_STOP = 100.0
#: N m or N that no joint at rest holds.
_OVERWHELMING = 1e8
#: Eigenvalues of slopes are rounding below this many times the largest.
_ROUNDING = 1e-13
#: A joint whose largest share in all that may move is no more stands still: rounding.
_MOVES_NOT = 1e-14
#: In place of an infinite margin.
_MOST_MARGIN = 1e300


@dataclass(frozen=True, eq=False)
class Standing:
    """What stands still where loops close.

    Attributes:
        coordinates: (nc,) bool.
        linkage: in which loops' joints among them are fixed where they stopped.
    """

    coordinates: np.ndarray
    linkage: Linkage


class Workspace:
    """Buffers of one scene for one thread: every solve overwrites them.

    Attributes:
        tables: `Layout`.
        given: what drives are given: "effort", or "motor_torque"; then `effort` is r T_m of each.
        problem, modes: the coupled problem and its solution.
        mechanism: how its coordinates hang together.
        must_project: whether a configuration can be none: loops open, quaternions not of length 1.
        closed: whether coordinates may depend on each other, see `Tables.dependent`.
        a, effort, phi, load, wrench: (nv,), (na,), (ns,), (ns,), (ns, 6) of the solution:
            accelerations, what drives deliver, friction, normal load and wrench of each site.
        multipliers: (nl,) forces that close loops, of side a on side b, in the order of the
            linkage's rows; none in an open chain.
        locked: whether what sticks lets nothing move (known where loops close).
        standing: what `project` keeps where it is, see `hold_position`; None in an open chain.
        turns_balls: whether the friction of balls that slip is pointed against their motion.
        least, most: (nc,) static limits of the friction x.
        site_modes: (ns,) int8, -1, 0, 1; of a ball 0, 1.
        places: (name, coordinate, whether it is a ball) of all that sticks and slips: sites, then
            gears on joints without friction.
    """

    def __init__(
        self, scene: Scene, attached: Iterable[str] | None = None, motors: bool = False
    ) -> None:
        if motors:
            check_transmissions(scene)
        self.given = "motor_torque" if motors else "effort"
        self.scene, self.twin = scene, scene.twin(attached)
        self.nq, self.nv, self.na = scene.model.nq, self.twin.nv, len(scene.drives)
        self.tables = t = make_layout(scene, motors)
        self.linkage = scene.linkage
        self.turns_balls, self.locked = True, False
        self.must_project = scene.linkage is not None or self.nq != self.nv
        self.supplier = Supplier(self.twin)
        tables = make_tables(self.twin, scene.linkage, t)
        self.closed = tables.dependent
        self.work = w = make_work(self.twin, t, tables)
        ready = is_ready(box_work, (w,))
        self._argument = KernelArgument(Machine(tables, self.supplier.supply, w), _box, ready)
        self.problem, self.modes = w.problem, w.modes
        self.mechanism = Mechanism(
            self.closed, w.factor, t.block, t.ball, w.idle, np.zeros(len(t.dry))
        )
        self.a, self.effort, self.phi, self.load, self.wrench = (
            w.a,
            w.effort,
            w.phi,
            w.load,
            w.wrench,
        )
        self._geared = bool((t.gear_coordinate >= 0).any())
        self._locking = LockingGears(t, w, self.modes)
        self.least, self.most, self.site_modes = w.least, w.most, w.site_modes
        self.multipliers = w.multiplier
        names = zip(scene.site_names, t.coordinate.tolist(), strict=True)
        self.places = [(name, c, bool(t.ball[c])) for name, c in names]
        self._alone = np.setdiff1d(t.gear_coordinate[t.gear_coordinate >= 0], t.entry_coordinate)
        of = t.gear_coordinate.tolist()
        self.places += [(scene.drives[of.index(c)].name, c, False) for c in self._alone.tolist()]
        self._balls = np.unique(t.block[t.ball])
        self._off_joints = t.off_joints
        self._kept: tuple[object, ...] | None = None
        self._guides = [
            (int(s), scene.sites[s].axis.tolist(), float(t.roll_lever[s])) for s in t.guides
        ]
        self.standing: Standing | None = None
        if self.closed:
            self.linkage = scene.linkage or no_linkage(scene.model)
            self.standing = Standing(np.zeros(len(t.dry), dtype=bool), self.linkage)
        #: The configuration closed last, and what stands still in it.
        self._last: tuple[np.ndarray, Standing | None] = np.zeros(0), None

    @property
    def _machine(self) -> Machine:
        """Tables, supply and buffers: tuples while kernels are interpreted, then one record."""
        return self._argument.now

    @property
    def a_free(self) -> np.ndarray:
        """(nv,) accelerations without friction."""
        return self.work.a_map[:, 0]

    @property
    def a_slope(self) -> np.ndarray:
        """(nv, nc) their change per unit friction."""
        return self.work.a_map[:, 1:]

    def accelerations(self) -> np.ndarray:
        """Return accelerations (nv,) under the friction in `modes`, those of what sticks, too.

        At the end of a time step what sticks is at rest, and not at its beginning.
        """
        a = np.empty(self.nv)
        write_accelerations(self._machine, a)
        return a

    # ------------------------------------------------------------ kinematics

    def rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the relative velocity of every coordinate (nc,) at q (nq,), v (nv,)."""
        if self._off_joints:
            v = np.ascontiguousarray(v)
            self.supplier.move(np.ascontiguousarray(q), v)
            measure_rates(self._machine, v)
            return self.work.coordinate_rate.copy()
        return np.asarray(v[self.tables.coordinate_v])

    def is_exact(self, q: np.ndarray) -> bool:
        """Whether the state solved last is normalized and obeys its loops to the last digits."""
        return bool(is_exact(self._machine, q))

    def speeds(self, rates: np.ndarray) -> np.ndarray:
        """Return how fast each coordinate's joint moves (nc,): of a ball, its angular speed."""
        speed = np.abs(rates)
        for number in self._balls:
            here = self.mechanism.block == number
            speed[here] = np.linalg.norm(rates[here])
        return speed

    def project(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the state with loops closed exactly and what sticks exactly at rest.

        What stands still stays where it is, see `hold_position`.
        """
        stuck = self.modes.stuck
        if not self.closed:
            return q, self._stopped(v, stuck)
        q = self._close(q)
        self._relate(q, v)
        return q, self._slowed(v, stuck)

    def hold_position(self, q: np.ndarray) -> np.ndarray:
        """Let `obey` keep what sticks, until it slips, where it is at q; return q (nq,), closed."""
        stuck = self.modes.stuck
        if self.standing is None or (self.standing.coordinates == stuck).all():
            return q
        q = self._close(q)
        self.supplier.move(q, np.zeros(self.nv))
        self._hold(stuck)
        self._last = self._last[0], self.standing
        return q

    def _hold(self, coordinates: np.ndarray) -> None:
        """Hold coordinates: those that stand already where they do, others where they are."""
        assert self.linkage is not None
        assert self.standing is not None
        action = self.tables.coordinate_action[coordinates]
        linkage = stand_still(
            self.linkage, self.standing.linkage, action[action >= 0], self.supplier.data.oMi
        )
        self.standing = Standing(coordinates.copy(), linkage)

    def _close(self, q: np.ndarray) -> np.ndarray:
        """The configuration near q that closes the loops, what stands still left where it is."""
        assert self.standing is not None
        if (self.standing.coordinates & ~self.modes.stuck).any():
            self._hold(self.standing.coordinates & self.modes.stuck)
        last, standing = self._last
        if standing is self.standing and np.array_equal(q, last):
            return q
        velocity = self.tables.coordinate_v[self.standing.coordinates]
        held = np.zeros(self.nv, dtype=bool)
        held[velocity[velocity >= 0]] = True
        q = close(self.twin, self.standing.linkage, q, held)
        self._last = q, self.standing
        return q

    def _relate(self, q: np.ndarray, v: np.ndarray) -> None:
        """Write rates, J and D of a state."""
        q, v = np.ascontiguousarray(q), np.ascontiguousarray(v)
        self.supplier.move(q, v)
        relate(self._machine, v)

    def _stopped(self, v: np.ndarray, stopped: np.ndarray) -> np.ndarray:
        v = v.copy()
        velocity = self.tables.coordinate_v[stopped]
        v[velocity[velocity >= 0]] = 0.0
        return v

    def _slowed(self, v: np.ndarray, stopped: np.ndarray) -> np.ndarray:
        """The velocities nearest to v that obey the loops and stop coordinates."""
        first, last = self.tables.off_joint, self.tables.solved
        rows = np.concatenate([self.work.J[0, first:last], self.work.D[stopped]])
        if not len(rows):
            return v.copy()
        _, size, right = np.linalg.svd(rows, full_matrices=False)
        rank = int((size > RANK * max(float(size[0]), 1e-300)).sum())
        if rank == self.nv:
            return np.zeros(self.nv)
        left = np.eye(self.nv) - right[:rank].T @ right[:rank]
        left[np.abs(left).max(axis=1) <= _MOVES_NOT] = 0.0  # moves in no way that is left
        return self._stopped(left @ v, stopped)

    def stop(
        self, q: np.ndarray, v: np.ndarray, stopped: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return velocities with coordinates at rest, and all that are at rest then.

        A joint whose speed is zero because the mechanism passes its dead centre does not stop it:
        then velocities stay. A ball that merely turns on is not at rest at all.

        Args:
            q, v: state.
            stopped: (nc,) bool.
        """
        t, D = self.tables, self.work.D
        if not self.closed:
            return self._stopped(v, stopped), stopped
        self._relate(q, v)
        slower = self._slowed(v, stopped)
        before, after = D @ v, D @ slower
        least = t.stick_velocity[stopped].min(initial=np.inf)
        allowed = _STOP * least if np.isfinite(least) else 0.0
        if np.abs(slower - v).max(initial=0.0) > allowed:
            return v, stopped & ~t.ball
        still = np.abs(after) <= 1e-3 * np.minimum(t.stick_velocity, 1.0)
        moved = np.abs(before - after) > 0.0
        fixed = np.linalg.norm(D, axis=1) == 0.0
        return slower, stopped | (still & moved & t.dry & ~fixed)

    # ------------------------------------------------------------ solving

    def solve(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None = None,
    ) -> None:
        """Find modes, friction and accelerations at one state.

        Args:
            q, v, effort: (nq,), (nv,), (na,), C-ordered.
            applied: wrenches from outside, one sample each.

        Raises:
            StateError: a value is not finite; SceneError: the mass matrix is singular.
            ToggleError: the loops leave more freedoms here than elsewhere.
            NoConsistentAcceleration, AmbiguousAcceleration, UndecidedAcceleration: see there.
        """
        solutions, obeying, resting = self._try(q, v, effort, applied, FREE)
        several = self.modes.figures[0] >= 1.0  # one was found; there may be others
        if obeying == 1 and not several:
            self._check_jam()
            return
        found = self.search() if resting or several else outcome(solutions, obeying)
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
        """Find friction and accelerations with the modes in `modes`; balls face their motion.

        Args, raises: see `solve`.
        """
        if self._kept is not None and self._kept == self._key(q, v, effort, applied):
            return  # nothing moves and nothing has changed
        turned = TURNED if self._balls.size and self.turns_balls else GIVEN
        solutions, obeying, resting = self._try(q, v, effort, applied, turned)
        found = outcome(solutions, obeying)
        if resting < 0:
            found = outcome(*self._settle())
            if found == Found.SOLVED:
                self.finish()
        elif found == Found.SOLVED:
            self._check_jam()
        if found != Found.SOLVED:
            raise self.failure(found, q, v, effort)
        self._kept = self._key(q, v, effort, applied) if self.locked else None

    def _key(
        self, q: np.ndarray, v: np.ndarray, effort: np.ndarray, applied: list[AppliedWrench] | None
    ) -> tuple[object, ...]:
        """What the solution in `modes` belongs to."""
        modes = self.modes
        arrays = q, v, effort, modes.stuck, modes.direction, modes.friction
        return id(applied), *(array.tobytes() for array in arrays)

    def _try(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None,
        choice: int,
    ) -> tuple[int, int, int]:
        """(solutions, how many obey, how many rest); -1 rest: modes were given and not tried."""
        self._kept = None
        self._given = q, v, effort, applied, 0.0
        self.supplier.at(q, v, applied)
        outcome, solutions, obeying, resting = solve_instant(
            self._machine, q, v, effort, choice, 0.0
        )
        self.locked = False
        if outcome == 0:
            return solutions, obeying, resting
        if outcome != UNDECIDED:
            self._refuse(outcome, q, v, effort)
        self._take_factor()
        return solutions, obeying, resting if choice == FREE else -1

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
            StateError, SceneError, ToggleError: see `solve`.
        """
        self._kept = None
        self._given = q, v, effort, applied, step
        self.supplier.at(q, v, applied)
        outcome = assemble(self._machine, q, v, effort, step)
        if outcome:
            self._refuse(outcome, q, v, effort)
        self._take_factor()

    def _take_factor(self) -> None:
        """Let the mechanism have the factor of the slopes of what sticks or may stick."""
        self.mechanism.factor = self.work.factor[: self.work.freedoms[0]]
        if not self.closed or not self.work.locking[0]:
            return
        here = self.modes.stuck | self.modes.at_rest
        size, axes = np.linalg.eigh(self.problem.rate_slope[np.ix_(here, here)])
        size[size < _ROUNDING * size.max(initial=0.0)] = 0.0
        rows = min(len(size), len(self.mechanism.factor))  # as many as freedoms, the largest
        self.mechanism.factor = np.zeros_like(self.mechanism.factor)
        self.mechanism.factor[:rows, here] = (np.sqrt(size)[:, None] * axes.T)[len(size) - rows :]

    def slip_direction(self, rates: np.ndarray) -> np.ndarray:
        """Return the direction (nc,) in which each coordinate slips; a ball has a vector."""
        out = self.modes.direction.copy()
        if self._balls.size:
            speed = self.speeds(rates)
            moves = self.mechanism.ball & ~self.modes.stuck & (speed > 0.0)
            out[moves] = rates[moves] / speed[moves]
        return out

    def summed(self, parts: np.ndarray) -> np.ndarray:
        """Return parts (nc,) summed over the coordinates of each joint."""
        out = parts.copy()
        for number in self._balls:
            here = self.mechanism.block == number
            out[here] = parts[here].sum()
        return out

    def breaking_with(self, fired: np.ndarray) -> np.ndarray:
        """Return the coordinates that break away when those in `fired` do: one freedom's, all."""
        return self.mechanism.companions(self.modes.stuck, fired) if self.closed else fired

    def breakaway_direction(self) -> np.ndarray:
        """Return the direction (nc,) in which what sticks would break away: against friction."""
        if self.closed:
            return self.mechanism.way.copy()
        below, above = self.margins()
        return np.where(above < below, -1.0, 1.0)

    def search(
        self, forced: Mapping[int, float] | None = None, held: np.ndarray | None = None
    ) -> Found:
        """Search the modes of what is at rest; see `friction/search.py`."""
        found = self._try_lines(
            lambda lines: search(self.problem, self.modes, self.mechanism, forced, held, lines)
        )
        if found == Found.SOLVED and self.closed:
            self._leave_dead_centres()
        return found

    def _try_lines(self, attempt: Callable[[Lines | None], Found]) -> Found:
        """Search with gears on the lines that fit: where not all modes are tried, in turn."""
        if not self._geared:
            return attempt(None)
        m, gears, delivered = self.modes, self._locking, self.work.delivered.copy()
        if gears.gears.size:
            self._couple()
        start, found = m.copy(), attempt(self._lines(delivered))
        if len(self.mechanism.joints(start.at_rest)) > MOST_ENUMERATED:
            for loads in gears.let_fall(start, delivered):
                if found in (Found.SOLVED, Found.UNDECIDED):
                    break
                found = attempt(self._lines(loads))
                falls = start.at_rest & ~m.at_rest
                if (m.direction[falls] * m.rate[falls] < 0.0).any():
                    found = Found.NONE
        gears.take_fallen()
        return found

    def _lines(self, delivered: np.ndarray) -> Lines:
        """What gears do while modes are sought; first they hold around loads (na,)."""
        gears = self._locking
        return Lines(
            lambda falls: gears.settle(self._settle, delivered, falls),
            gears.may_slip(),
            len(gears.gears),
        )

    def _settle(self) -> tuple[int, int]:
        """Solve the modes as they are, every gear on the line that fits; see `rest.solve`."""
        if not self._geared:
            return solve(self.problem, self.modes, self.mechanism)
        q, v, effort, _, step = self._given
        if not self.closed:
            refused, found, obeying, _ = solve_instant(self._machine, q, v, effort, SETTLED, step)
            if refused:
                self._refuse(refused, q, v, effort)
            return found, obeying
        c = self.tables.gear_coordinate
        way = np.where(self.modes.stuck[c], 0.0, self.modes.direction[c])
        self.work.gear_way[c >= 0] = way[c >= 0]
        for passes in range(MOST_LINES):
            self._couple()
            found, obeying = solve(self.problem, self.modes, self.mechanism)
            if found <= 0 or not refit(self._machine, passes >= FEW_PASSES):
                return found, obeying
        return -1, 0

    def ways_to_hold(self) -> Iterator[bool]:
        """Let self-locking gears hold in one way after the other: `LockingGears.ways_to_hold`."""
        return self._locking.ways_to_hold(self._couple)

    def _couple(self) -> None:
        """Write the coupled problem of the present state once more, with other lines of gears."""
        q, v, effort, _, step = self._given
        outcome = couple(self._machine, q, v, effort, step)
        if outcome:
            self._refuse(outcome, q, v, effort)
        self._take_factor()

    def _leave_dead_centres(self) -> None:
        """Let joints that rest at their dead centre slip the way the mechanism takes them.

        Their own rates are exactly zero and decide nothing: what they are a moment later, with the
        velocities v = a dt, has the sign of the rate at v = a.
        """
        m = self.modes
        dead = m.at_rest & m.stuck & ~self.mechanism.factor.any(axis=0)
        q, v, effort, applied, step = self._given
        if step > 0.0 or not dead.any():
            return
        a = self.a_free + self.a_slope @ m.friction
        terms = float(np.abs(self.a_free).max(initial=0.0)) + 1e-300
        if np.abs(a).max(initial=0.0) <= 1e-12 * terms:
            return
        kept = m.copy()
        self.assemble(q, a, effort, applied)
        way = np.sign(self.problem.rate_free[dead])
        self.assemble(q, v, effort, applied)
        m.stuck[dead], m.direction[dead], m.at_rest[dead] = way == 0.0, way, False
        if self._settle()[1] != 1:
            m.take(kept)
            self._settle()

    def search_step(self) -> Found:
        """Search the modes at the end of a time step, from those in `modes`, else all of them."""
        return self._try_lines(self._search_step)

    def _search_step(self, lines: Lines | None) -> Found:
        p, m, mechanism, start = self.problem, self.modes, self.mechanism, self.modes.copy()
        found = follow(p, m, mechanism, lines)
        if found != Found.SOLVED and self.closed:
            m.take(start)
            m.stuck[m.at_rest], m.direction[m.at_rest] = True, 0.0
            found = follow(p, m, mechanism, lines)
        if found != Found.SOLVED and int(m.at_rest.sum()) <= MOST_ENUMERATED:
            return search(p, m, mechanism, lines=lines)
        return found

    @property
    def place_modes(self) -> np.ndarray:
        """(len(places),) int8, as `site_modes`."""
        gears = np.sign(self.modes.direction[self._alone]).astype(np.int8)
        return np.concatenate([self.site_modes, gears])

    def set_modes(self, modes: np.ndarray) -> None:
        """Write modes of places as modes of their coordinates; a ball's face its motion."""
        t, m = self.tables, self.modes
        m.direction[t.entry_coordinate] = modes[t.entry_site] * np.sign(t.entry_ratio)
        m.direction[self._alone] = modes[len(t.joint) :]
        m.stuck[:] = (m.direction == 0.0) & t.dry

    def finish(self) -> None:
        """Write a, multipliers, wrenches and each site's friction from the solution in `modes`."""
        finish(self._machine)
        self._check_jam()
        self.locked = self.closed and self.mechanism.is_locked(self.modes.stuck)
        if self.locked:
            self.a[:] = 0.0

    def margins(self) -> np.ndarray:
        """Return how far the friction of what sticks is from its two static limits (2, nc).

        In N m or N. Where a self-locking gear holds, whose limits may be infinite: how far what
        arrives at the gear is from where it slips, see `gear_margins`.
        """
        x = self.modes.friction
        out = np.array([x - self.least, self.most - x])
        for number in self._balls:
            here = self.mechanism.block == number
            size = np.linalg.norm(x[here])
            out[:, here] = self.most[here] + size, self.most[here] - size
        for gears in self._locking.by_coordinate(self.modes.stuck):
            ends = [gear_margins(self._machine, d) for d in gears]
            backward, forward = max(ends, key=min)
            out[:, self.tables.gear_coordinate[gears[0]]] = forward, backward
        return np.minimum(out, _MOST_MARGIN)

    def friction_rounding(self) -> np.ndarray:
        """Return how far margins (nc,) may be off by rounding, also of loads that cancel."""
        slope = np.diag(self.problem.rate_slope)
        terms = self.problem.rate_scale / np.where(slope > 0.0, slope, np.inf)
        return np.asarray(ROUNDING * (self.limit_width + terms))

    @property
    def limit_width(self) -> np.ndarray:
        """(nc,) between the two limits that `margins` are measured from; 0 of infinite ones."""
        margins = self.margins()
        return np.where((margins < _MOST_MARGIN).all(axis=0), margins.sum(axis=0), 0.0)

    @property
    def guards(self) -> np.ndarray:
        """(nc,) the smaller of each coordinate's `margins`."""
        return self.margins().min(axis=0)

    def rehearse(self) -> None:
        """Compile every kernel that a solve may call, so that none is compiled in a control loop.

        The kernels for joints at rest that share their friction are called with no effort and with
        one that nothing can hold. That overwrites the solutions: use a separate workspace.
        """
        if not self.nv:
            return
        q, v, effort = closed_configuration(self.scene), np.zeros(self.nv), np.zeros(self.na)
        m = self._machine
        state = m, q, v, effort
        for made, arguments in (
            (solve_instant, (*state, FREE, 0.0)),
            (assemble, (*state, 0.0)),
            (couple, (*state, 0.0)),
            (finish, (m,)),
            (write_accelerations, (m, self.a)),
            (refit, (m, True)),
            (relate, (m, v)),
            (measure_rates, (m, v)),
            (is_exact, (m, q)),
            (gear_margins, (m, 0)),
            *_kernels_of_search(self.problem, self.modes),
        ):
            compile_for(made, *arguments)
        with compiling():
            for push in (0.0, _OVERWHELMING):
                self.modes.stuck[:], self.modes.direction[:] = self.tables.dry, 0.0
                with suppress(PinfricError):
                    self.solve_given_modes(q, v, effort + push)

    # ------------------------------------------------------------ what cannot be

    def check_roll_moments(self, wrench: np.ndarray) -> None:
        """Do what `reactions.check_roll_moments` does, of one state: at a tenth of its cost.

        Args:
            wrench: (ns, 6) at the sites, N and N m.

        Raises:
            RollMomentError: see there.
        """
        for s, (x, y, z), lever in self._guides:
            fx, fy, fz, mx, my, mz = wrench[s].tolist()
            roll = mx * x + my * y + mz * z
            if abs(roll) > 1e-9 * (hypot(mx, my, mz) + lever * hypot(fx, fy, fz)):
                raise RollMomentError(self.scene.sites[s].name, 0, roll)

    def check_finite(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> None:
        """Refuse a state that holds what is no number.

        Raises:
            StateError: see there.
        """
        for name, array in (("q", q), ("v", v), (self.given, effort)):
            if not np.isfinite(array).all():
                i = int(np.flatnonzero(~np.isfinite(array))[0])
                raise StateError(f"{name}: column {i} is {array[i]}; should be finite")

    def _refuse(self, outcome: int, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> NoReturn:
        self.check_finite(q, v, effort)
        if outcome == NOT_FINITE:
            raise StateError("forward dynamics overflows at this state: values are too large")
        if outcome == TOGGLE:
            assert self.linkage is not None
            raise ToggleError(
                self.linkage.loops[0].name, int(self.work.freedoms[0]), self.tables.freedoms
            )
        raise SceneError(
            f"{self.scene.source}: the mass matrix is not positive definite at this state: a joint "
            "moves no mass; give its link an inertia, or lock it"
        )

    def failure(
        self, found: Found, q: np.ndarray, v: np.ndarray, effort: np.ndarray
    ) -> AccelerationError:
        """Return the error that says why no single acceleration was found, and where."""
        if jam := self._jam():
            return jam
        contraction, resting = self.modes.figures[0], int(self.modes.at_rest.sum())
        state = q.copy(), v.copy(), self._as_given(effort)
        finding: type[AccelerationError] = NoConsistentAcceleration
        reason = "neither sticking nor slipping either way is consistent"
        if contraction >= 1.0:
            reason = f"the loads grow with the friction they cause (contraction {contraction:.4g})"
        if found == Found.AMBIGUOUS:
            finding = AmbiguousAcceleration
            if not contraction >= 1.0:
                reason = (
                    "static friction is above kinetic, so one set of joints may break away "
                    "and the others hold, or another set of as many"
                )
        elif found == Found.NOT_CONVERGED:
            reason = f"the coupled solve does not reach its tolerance (contraction {contraction})"
        elif found == Found.UNDECIDED:
            finding = UndecidedAcceleration
            reason = (
                f"{resting} coordinates at rest, {MOST_PASSES} passes; remove friction from joints "
                "where it does not matter, or start from a state in motion"
            )
        elif resting > MOST_ENUMERATED:
            reason += f"; with more than {MOST_ENUMERATED} joints at rest not every mode is tried"
        return finding(*state, self._worst_site(), reason, given=self.given)

    def _as_given(self, effort: np.ndarray) -> np.ndarray:
        """Efforts, or torques of motors (na,), as they were given."""
        return effort / self.tables.gears.ratio if self.given == "motor_torque" else effort.copy()

    def _check_jam(self) -> None:
        """Refuse a solution in which a self-locking gear moves whose rotor is too light.

        Raises:
            GearJam: see `gear_jam`.
        """
        if self._locking.gears.size and (jam := self._jam()):
            raise jam

    def _jam(self) -> GearJam | None:
        """The error of a self-locking gear that moves, and may have no acceleration, or several."""
        t, w = self.tables, self.work
        moves = np.array([c < 0 or not w.modes.stuck[c] for c in t.gear_coordinate], dtype=bool)
        if not moves[self._locking.gears].any():
            return None
        inertia, J = np.array(w.M), w.J[0, t.off_joint : t.solved]
        rises = w.slope > 0.0
        rotors = np.where(rises, w.reflected / np.where(rises, w.slope, 1.0), 0.0)
        inertia -= (w.S * rotors[:, None]).T @ w.S
        q, v, effort, *_ = self._given
        fixed = np.concatenate([J, w.D[w.modes.stuck]])
        found = gear_jam(t.gears, moves, np.abs(w.S @ v), inertia, w.S, fixed)
        if found is None:
            return None
        d, eigenvalue, enough = found
        reason = (
            f"E + I^1/2 M^-1 I^1/2 has the eigenvalue {eigenvalue:.3g}: no acceleration "
            f"obeys the gear's law, or several do; a rotor inertia above {enough:.6g} kg m^2 "
            "would do, or a gear that does not lock"
        )
        state = q.copy(), v.copy(), self._as_given(effort)
        return GearJam(*state, self.scene.drives[d].name, reason, given=self.given)

    def _worst_site(self) -> str:
        """Name of the site whose load grows most with friction: there it is inconsistent."""
        p = self.problem
        growth = np.zeros(len(p.constant))
        norms = np.linalg.norm(p.contact[:, 1:], axis=2).sum(axis=1)
        np.add.at(growth, p.contact_site, norms)
        open_ = ~self.modes.stuck | self.modes.at_rest
        worst = np.argmax(growth * p.mu_slip + np.where(open_[p.coordinate], 0.0, -np.inf))
        if worst < len(self.tables.entry_site):
            return self.scene.site_names[self.tables.entry_site[worst]]
        geared = np.flatnonzero(self.tables.gear_entry == worst)
        return self.scene.drives[int(geared[0])].name


def _kernels_of_search(problem: Problem, modes: Modes) -> list[tuple[Any, tuple[Any, ...]]]:
    """Return the kernels that a search of modes calls by itself, with arguments of their types."""
    line, empty = np.empty(0), np.empty((0, 0))
    return [
        (try_modes, (problem, modes)),
        (judge, (problem, modes)),
        (evaluate, (problem, modes.friction, modes.load, modes.rate)),
        (stick_limits, (problem, modes.load, line, line)),
        (add_load_slopes, (problem.contact, problem.coordinate, line, line, empty)),
        (reduce_problem, (problem, modes.stuck, modes.direction)),
        (least_violation, (empty, line, line, 0, 0.0, line)),
    ]


def closed_configuration(scene: Scene) -> np.ndarray:
    """Return a configuration (nq,) in which all loops are closed, near the start if there is one.

    Where none is found, the start.
    """
    for guess in guesses(scene.model, scene.start_configuration):
        with suppress(ClosureError):
            return scene.close(guess)
    return scene.start_configuration


def check_transmissions(scene: Scene) -> None:
    """Refuse torques of motors where a drive has no transmission to take them.

    Raises:
        SceneError: names the drive.
    """
    for drive in scene.drives:
        if drive.transmission is None:
            raise SceneError(
                f"{scene.source}: motor_torque: drive {drive.name!r} has no transmission; give it "
                "one in `actuators` (a direct drive has ratio: 1), or give `effort`"
            )


def _box(machine: Machine) -> Machine:
    tables, supply, work = machine
    scene = box_tables(tables._replace(layout=box_layout(tables.layout)))
    return cast("Machine", box_machine(Machine(scene, box_supply(supply), box_work(work))))


class _Last(threading.local):
    """The scene this thread asked for last (a weak reference), what drove it, its workspace."""

    scene: Callable[[], Scene | None] = staticmethod(lambda: None)
    motors: bool
    found: Workspace


_LAST = _Last()


def workspace(
    scene: Scene, attached: Iterable[str] | None = None, motors: bool = False
) -> Workspace:
    """Return this thread's workspace of a scene, made at first; it lives in the scene's twin.

    Scenes that differ in friction alone may share a twin: the last one asked for has its workspace.
    """
    if attached is None and _LAST.scene() is scene and _LAST.motors == motors:
        scene.check_unchanged()
        return _LAST.found
    twin = scene.twin(attached)
    key = "motors" if motors else "forward", threading.get_ident()
    if key not in twin.pools or twin.pools[key].scene is not scene:
        twin.pools[key] = Workspace(scene, attached, motors)
    found: Workspace = twin.pools[key]
    if attached is None:
        _LAST.scene, _LAST.motors, _LAST.found = weakref.ref(scene), motors, found
    return found
