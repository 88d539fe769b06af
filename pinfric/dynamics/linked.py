"""Forward dynamics of scenes with loops or drives off the joints: their coupled problem at a state.

    M a + h - J_ext^T f_ext = S u + J_c^T lambda + D x,     J_c a + Jdot_c v = 0

(design 2.2, 2.5; paper eq. 2-7). The closure is eliminated with a basis Z of the motions it allows,
J_c Z = 0: a = a_closure + Z (Z^T M Z)^-1 Z^T (...). What is left is a `Problem` like an open
chain's, whose coordinates are tree joints and loop joints alike; they may depend on each other at
rest (`rest.py`). Multipliers follow from the balance, for redundant closures by design 2.2's rule.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinfric.dynamics import rest
from pinfric.dynamics.assembly import NOT_FINITE, SINGULAR, write_laws
from pinfric.dynamics.consistency import ROUNDING, site_friction, stick_limits
from pinfric.dynamics.constrained import make_layout
from pinfric.dynamics.linked_assembly import (
    balance,
    closure_basis,
    given_wrenches,
    reduce_dynamics,
    write_contacts,
)
from pinfric.dynamics.linked_tables import LinkedTables, make_linked_tables
from pinfric.dynamics.modes import MOST_ENUMERATED, Found, Modes
from pinfric.dynamics.problem import empty_problem
from pinfric.dynamics.reactions import AppliedWrench
from pinfric.dynamics.workspace import Workspace
from pinfric.errors import ToggleError
from pinfric.model.closure import RANK, actions_of, close, tree_tables
from pinfric.model.kinematics import act_on_joints, move_links, place_links, relate_pairs
from pinfric.model.loops import Linkage
from pinfric.model.scene import Scene
from pinfric.model.twin import embed

#: A stop may change velocities by this many times the stick velocity; more, and it is none.
_STOP = 100.0
#: A joint whose share in the mechanism's motion is this small stands at its dead centre.
_IDLE = 1e-4
#: So small a share is none.
_DEAD = 1e-13


class LinkedWorkspace(Workspace):
    """A workspace (see there) of a scene with loops, cylinders or forces.

    Attributes:
        linkage, layout, mechanism: what is linked, and how coordinates hang together.
        multipliers: (nl,) loop forces of side a on side b, in the order of the linkage's rows.
    """

    tables: LinkedTables  # type: ignore[assignment]

    def _make(self, scene: Scene) -> None:
        assert scene.linkage is not None
        self.linkage: Linkage = scene.linkage
        self.layout = make_layout(scene, self.linkage)
        self.tables, self.mechanism = make_linked_tables(scene, self.layout)
        t = self.tables
        constant = np.ascontiguousarray(scene.site_tables.weights[t.entry_site, 6])
        self.problem = empty_problem(t.entry_coordinate, t.entry_ratio, t.contact_site, constant)
        nv, ns, nc, ne = self.nv, len(t.coordinate), len(t.column), len(t.entry_site)
        self.out = np.zeros(nv + 8 * ns)
        self.a, self.phi = self.out[:nv], self.out[nv : nv + ns]
        self.load = self.out[nv + ns : nv + 2 * ns]
        self.wrench = self.out[nv + 2 * ns :].reshape(ns, 6)
        self.modes = Modes.of(nc, np.zeros(ne))
        self.site_modes = np.zeros(ns, dtype=np.int8)
        self.least, self.most = np.zeros(nc), np.zeros(nc)
        self.a_free, self.a_slope = np.zeros(nv), np.zeros((nv, nc))
        nl, nj = self.linkage.multipliers, self.layout.n_tree
        self.multipliers = np.zeros(nl)
        self._multipliers, self._free = np.zeros((nl, 1 + nc)), np.zeros((nl, nl))
        self._joint_wrenches = np.zeros((nj + len(self.linkage.loops), 6, 1 + nc))
        self._Z, self._a_closure = np.zeros((nv, nv)), np.zeros(nv)
        self._factor, self._bias = np.zeros((nv, nc)), np.zeros(nc)
        self._armature = np.diag(self.twin.armature)
        self._loops = np.flatnonzero(t.column >= 0)
        self._loop_columns = t.column[self._loops]
        self._D, self._S = np.zeros((nc, nv)), np.zeros((self.na, nv))
        on_tree = np.flatnonzero(t.coordinate_v >= 0)
        driven = np.flatnonzero(self.layout.drive_v >= 0)
        self._D[on_tree, t.coordinate_v[on_tree]] = 1.0
        slides = self.linkage.unit[self._loop_columns, :3].any(axis=1)
        # a loop that slides has levers for directions: all of them vanish at its dead centre
        self._direction_size = np.zeros(nc)
        self._direction_size[self._loops[slides]] = min(1.0, self.linkage.size)
        self._S[driven, self.layout.drive_v[driven]] = 1.0
        self._entry_phi = np.zeros(ne)
        self._numbers = np.arange(nc, dtype=np.int64)
        self._balls = np.unique(self.mechanism.block[self.mechanism.ball])
        self._make_batch()
        self._make_kinematics()

    # ------------------------------------------------------------ kinematics

    def _make_kinematics(self) -> None:
        """Buffers of one state's kinematics, and the kernels' arguments, in their order."""
        twin, link, nj = self.twin, self.linkage, self.twin.n_joints
        nx, pairs = len(link.column_pair), len(link.pair_kind)
        self._state = np.empty((1, 7 * nj)), np.empty((1, 6 * nj)), np.empty((1, 6 * nj))
        p, R = np.empty((1, nj, 3)), np.empty((1, nj, 3, 3))
        velocity, acceleration = np.empty((1, nj, 6)), np.empty((1, nj, 6))
        self._gap, self._rate, self._rate_derivative = (np.empty((1, nx)) for _ in range(3))
        self._X, self._J = np.empty((1, nj + len(link.loops), 6, nx)), np.empty((1, nx, self.nv))
        parents, placement_p, placement_R = tree_tables(twin)
        self._place = self._state[0], parents, placement_p, placement_R, p, R
        self._follow = *self._state[1:], parents, p, R, velocity, acceleration
        actions = actions_of(twin, link)
        self._relate = (
            p,
            R,
            velocity,
            acceleration,
            actions,
            self._gap,
            self._rate,
            self._rate_derivative,
            np.empty((1, pairs)),
            np.empty((1, pairs, 2)),
        )
        self._action = p, R, actions, self._X, self._J

    def _move(self, q: np.ndarray, v: np.ndarray) -> None:
        """Relate the frames of all pairs at one state, at a = 0: gaps and their two rates."""
        embed(q[None], v[None], self._no_acceleration, *self._embedding, *self._state)
        place_links(*self._place)
        move_links(*self._follow)
        relate_pairs(*self._relate)

    def _act(self) -> tuple[np.ndarray, np.ndarray]:
        """X (nj + loops, 6, nx) and J (nx, nv) of the state `_move` saw last."""
        act_on_joints(*self._action)
        return self._X[0], self._J[0]

    def _directions(self, J: np.ndarray) -> np.ndarray:
        """D^T (nc, nv): the rate of every coordinate per unit velocity, from all actions' J."""
        self._D[self._loops] = J[self._loop_columns]
        return self._D

    def _drives(self, J: np.ndarray) -> np.ndarray:
        """S^T (na, nv): the rate of every drive per unit velocity."""
        off = self.layout.drive_v < 0
        self._S[off] = J[self.layout.drive_column[off]]
        return self._S

    def rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the relative velocity of every coordinate (nc,)."""
        t = self.tables
        out = v[t.coordinate_v]
        if self._loop_columns.size:
            self._move(q, v)
            out[self._loops] = self._rate[0, self._loop_columns]
        return out

    def speeds(self, rates: np.ndarray) -> np.ndarray:
        """Return how fast each coordinate's joint moves (nc,): of a ball, its angular speed."""
        speed = np.abs(rates)
        for number in self._balls:
            here = self.mechanism.block == number
            speed[here] = np.linalg.norm(rates[here])
        return speed

    def obey(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the state with loops closed exactly and what sticks exactly at rest."""
        t, stuck = self.tables, self.modes.stuck
        held = np.zeros(self.nv, dtype=bool)
        held[t.coordinate_v[stuck & (t.coordinate_v >= 0)]] = True
        if self.linkage.multipliers:
            if held.any() and self._is_whole(held):
                held[:] = False
            q = close(self.twin, self.linkage, q, held)
        self._move(q, v)
        return q, self._slowed(self._act()[1], v, stuck)

    def _is_whole(self, held: np.ndarray) -> bool:
        """Whether too few joints are left free to close the loops."""
        return bool((~held).sum() < self.nv - self.na)

    def _slowed(self, J: np.ndarray, v: np.ndarray, stopped: np.ndarray) -> np.ndarray:
        """The velocities nearest to v that obey the loops and stop coordinates."""
        rows = np.concatenate([J[self.linkage.lambdas], self._directions(J)[stopped]])
        if not len(rows):
            return v.copy()
        _, size, right = np.linalg.svd(rows, full_matrices=False)
        rank = int((size > RANK * max(float(size[0]), 1e-300)).sum())
        if rank == self.nv:
            return np.zeros(self.nv)
        out = v - right[:rank].T @ (right[:rank] @ v)
        alone = self.tables.coordinate_v[stopped & (self.tables.coordinate_v >= 0)]
        out[alone] = 0.0
        return np.asarray(out)

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
        self._move(q, v)
        J = self._act()[1]
        slower = self._slowed(J, v, stopped)
        D = self._directions(J)
        before, after = D @ v, D @ slower
        least = self.tables.stick_velocity[stopped].min(initial=np.inf)
        allowed = _STOP * least if np.isfinite(least) else 0.0
        if np.abs(slower - v).max(initial=0.0) > allowed:
            return v, stopped & ~self.mechanism.ball
        still = np.abs(after) <= 1e-3 * np.minimum(self.tables.stick_velocity, 1.0)
        moved = np.abs(before - after) > 0.0
        fixed = np.linalg.norm(D, axis=1) == 0.0
        return slower, stopped | (still & moved & self.tables.dry & ~fixed)

    # ------------------------------------------------------------ the coupled problem

    def assemble(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None = None,
        step: float = 0.0,
    ) -> None:
        """Write the coupled problem at one state, unsolved; see `Workspace.assemble`.

        Raises:
            ToggleError: the loops leave more freedoms here than elsewhere.
        """
        if not (np.isfinite(q).all() and np.isfinite(v).all() and np.isfinite(effort).all()):
            self._refuse(NOT_FINITE, q, v, effort)
        self._given = q, v, effort, applied, step
        self.run_batch(q, v, applied)
        self._move(q, v)
        X, J = self._act()
        t, h, rows = self.tables, self._rows[0], self.linkage.lambdas
        D, S = self._directions(J), self._drives(J)
        M = self._rows[2:] - self._rows[1] + self._armature
        given = effort @ S
        if step > 0.0:  # viscous friction at the end of the step
            M = M + step * (D.T * t.viscous) @ D
            given = given - (D.T * t.viscous) @ (D @ v)
        target = -(J[rows] @ v) / step if step > 0.0 else -self._rate_derivative[0, rows]
        scale = min(1.0, self.linkage.size)
        rank = closure_basis(J[rows], target, scale, self._Z, self._a_closure)
        if rank < self.nv - self.na:
            raise ToggleError(self.linkage.loops[0].name, self.nv - rank, self.na)
        Z, factor = self._Z[:, : self.nv - rank], self._factor[: self.nv - rank]
        if not reduce_dynamics(M, given - h - M @ self._a_closure, Z, D, self._a_closure, factor,
                               self.a_free, self.a_slope):  # fmt: skip
            self._refuse(SINGULAR if np.isfinite(M).all() else NOT_FINITE, q, v, effort)
        self._write_rates(D, Z, v, factor, step, np.abs(given) + np.abs(h))
        self._write_laws(D @ v, step > 0.0)
        rank = balance(J[rows], M, h - given, D, self.a_free, self.a_slope, scale,
                       self._multipliers, self._free)  # fmt: skip
        self._write_loads(q, X, self._free[:, : self.linkage.multipliers - rank], effort)

    def _write_rates(
        self,
        D: np.ndarray,
        Z: np.ndarray,
        v: np.ndarray,
        factor: np.ndarray,
        step: float,
        terms: np.ndarray,
    ) -> None:
        """Write r = D^T a + Ddot^T v, or of a step D^T (v + step a), and its slope's factor."""
        p, m = self.problem, self.mechanism
        if step > 0.0:
            p.rate_free[:] = D @ (v + step * self.a_free)
            scale, offset = step, np.abs(D) @ np.abs(v)
        else:
            scale, offset = 1.0, self._bias
            offset[self._loops] = self._rate_derivative[0, self._loop_columns]
            p.rate_free[:] = D @ self.a_free + offset
        m.factor = np.sqrt(scale) * factor
        p.rate_slope[:] = m.factor.T @ m.factor
        p.rate_scale[:] = np.abs(offset) + scale * (terms @ np.abs(self.a_slope))
        # a joint that stands still while the mechanism moves is at its dead centre
        share = np.abs(D @ Z).max(axis=1, initial=0.0)
        size = np.maximum(np.abs(D).max(axis=1), self._direction_size) * np.abs(Z).max(initial=0.0)
        m.idle[:] = share <= _IDLE * size
        dead = share <= _DEAD * size
        m.factor[:, dead], p.rate_slope[dead], p.rate_slope[:, dead] = 0.0, 0.0, 0.0

    def _write_laws(self, rates: np.ndarray, implicit: bool) -> None:
        """Write every entry's coefficients; a ball's depend on its speed, its drag on its rates."""
        t = self.tables
        of_ball = self.mechanism.ball
        moving = np.where(of_ball, self.speeds(rates), rates) if self._balls.size else rates
        write_laws(moving, t.law, self._numbers, self.problem, implicit)  # fmt: skip
        if self._balls.size and not implicit:
            ball = self.mechanism.ball[t.entry_coordinate]
            self.problem.drag[ball] = t.law[ball, 6] * rates[t.entry_coordinate[ball]]

    def _write_loads(
        self, q: np.ndarray, X: np.ndarray, free: np.ndarray, effort: np.ndarray
    ) -> None:
        """Write wrenches of all joints and contact forces as [..., 0] + [..., 1:] x.

        Args:
            q: (nq,).
            X: (nj + loops, 6, nx), `kinematics.act_on_joints`.
            free: (nl, nf) what may be added to the multipliers (redundant closures).
            effort: (na,).
        """
        t, p, y = self.tables, self.problem, self._multipliers
        G, first = self._joint_wrenches, self.linkage.off_joint
        given_wrenches(self.batch.wrench, X, self.a_free, self.a_slope, self.layout.drive_column,
                       effort, t.column, G)  # fmt: skip
        if free.shape[1]:
            among = X[:, :, self.linkage.lambdas]
            y += free @ self._least(G + among @ y, among @ free)
        finite = write_contacts(
            X, first, y, q, t.contact_row, t.contact_map, t.contact_map_moved, t.displacement_q,
            t.displacement_ratio, t.displacement_shift, G, p.contact_free, p.contact_slope,
        )  # fmt: skip
        if not finite:
            self._refuse(NOT_FINITE, q, self._given[1], effort)

    def _least(self, G: np.ndarray, N: np.ndarray) -> np.ndarray:
        """Free multipliers with the least sum of |F|^2 + |M / l|^2 over all joints (design 2.2)."""
        weight = np.repeat([1.0, self.layout.inverse_length], 3)[None, :, None]
        A, B = (weight * array for array in (N, G))
        return -np.linalg.lstsq(A.reshape(-1, N.shape[2]), B.reshape(-1, G.shape[2]), rcond=None)[0]

    # ------------------------------------------------------------ solving

    def solve(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None = None,
    ) -> None:
        """Find modes, friction and accelerations at one state; see `Workspace.solve`."""
        self.assemble(q, v, effort, applied)
        m, rates = self.modes, self.rates(q, v)
        speed = self.speeds(rates)
        m.at_rest[:] = self.tables.dry & (speed <= self.tables.stick_velocity)
        m.stuck[:] = m.at_rest
        self._face(rates, speed, ~m.stuck)
        m.direction[m.stuck] = 0.0
        found = self.search()
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
        """Find friction and accelerations with the modes in `modes`; balls face their motion."""
        self.assemble(q, v, effort, applied)
        m = self.modes
        m.at_rest[:] = False
        if self._balls.size and self.turns_balls:
            rates = self.rates(q, v)
            self._face(rates, self.speeds(rates), ~m.stuck & self.mechanism.ball)
        solutions, obeying = rest.solve(self.problem, m, self.mechanism)
        if obeying != 1:
            raise self.failure(rest.only_candidate(solutions, obeying), q, v, effort)
        self.finish()

    def _face(self, rates: np.ndarray, speed: np.ndarray, which: np.ndarray) -> None:
        """Point directions along the velocities; at no speed at all they stay as they are."""
        which = which & (speed > 0.0)
        self.modes.direction[which] = rates[which] / speed[which]

    def facing(self, rates: np.ndarray) -> np.ndarray:
        """Return the direction (nc,) in which each coordinate slips; a ball has a vector."""
        out = self.modes.direction.copy()
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
        return self.mechanism.companions(self.modes.stuck, fired)

    def way_out(self) -> np.ndarray:
        """Return the direction (nc,) in which what sticks would break away."""
        return self.mechanism.way.copy()

    def search(
        self, forced: Mapping[int, float] | None = None, held: np.ndarray | None = None
    ) -> Found:
        """Search the modes of what is at rest; see `modes.search`, `rest.search`."""
        found = rest.search(self.problem, self.modes, self.mechanism, forced, held)
        if found == Found.SOLVED:
            self._leave_dead_centres()
        return found

    def _leave_dead_centres(self) -> None:
        """Let joints that rest at their dead centre slip the way the mechanism takes them.

        Their own rates are exactly zero and decide nothing: what they are a moment later, with the
        velocities v = a dt, has the sign of the rate at v = a.
        """
        m = self.modes
        dead = m.at_rest & m.stuck & ~self.mechanism.factor.any(axis=0)
        q, v, effort, applied, step = self._given
        a = self.a_free + self.a_slope @ m.friction
        if step > 0.0 or not dead.any() or np.abs(a).max(initial=0.0) <= 1e-12 * self._terms():
            return
        kept = m.copy()
        self.assemble(q, a, effort, applied)
        way = np.sign(self.problem.rate_free[dead])
        self.assemble(q, v, effort, applied)
        m.stuck[dead], m.direction[dead], m.at_rest[dead] = way == 0.0, way, False
        if rest.solve(self.problem, m, self.mechanism)[1] != 1:
            m.take(kept)

    def _terms(self) -> float:
        """Size of the accelerations that may cancel."""
        return float(np.abs(self.a_free).max(initial=0.0)) + 1e-300

    def search_step(self) -> Found:
        """Search the modes at the end of a time step, from those in `modes`."""
        m, dry = self.modes, self.tables.dry
        start = m.copy()
        found = rest.follow(self.problem, m, self.mechanism)
        if found == Found.SOLVED:
            return found
        m.take(start)
        m.at_rest[:] = dry
        m.stuck[dry], m.direction[dry] = True, 0.0
        found = rest.follow(self.problem, m, self.mechanism)
        if found != Found.SOLVED and int(dry.sum()) <= MOST_ENUMERATED:
            m.at_rest[:] = dry
            found = rest.search(self.problem, m, self.mechanism)
        return found

    def set_modes(self, modes: np.ndarray) -> None:
        """Write modes of sites (ns,) as modes of their coordinates; a ball's face its motion."""
        t, m = self.tables, self.modes
        m.direction[t.entry_coordinate] = (modes * np.sign(t.ratio))[t.entry_site]
        m.stuck[:] = (m.direction == 0.0) & t.dry

    def finish(self) -> None:
        """Write a, multipliers, wrenches and each site's friction from the solution in `modes`."""
        m, t = self.modes, self.tables
        self.a[:] = self.a_free + self.a_slope @ m.friction
        self.locked = False
        if m.stuck.any():
            self.a[t.coordinate_v[m.stuck & (t.coordinate_v >= 0)]] = 0.0
            factor = self.mechanism.factor
            size = np.linalg.svd(factor[:, m.stuck], compute_uv=False)
            if int((size > RANK * size[:1]).sum()) == len(factor):
                self.a[:] = 0.0  # nothing can move
                self.locked = True
        x = np.empty(1 + len(m.friction))
        x[0], x[1:] = 1.0, m.friction
        self.multipliers[:] = self._multipliers @ x
        self.wrench[:] = (self._joint_wrenches @ x)[t.joint]
        stick_limits(self.problem, m.load, self.least, self.most)
        site_friction(self.problem, m.stuck, m.direction, m.friction, m.load, self.least,
                      self.most, self._entry_phi)  # fmt: skip
        self.load[t.entry_site] = m.load
        self.phi[t.entry_site] = self._entry_phi
        self.site_modes[:] = np.sign(m.direction[t.coordinate] * t.ratio)
        if not self._balls.size:
            return
        for s in np.flatnonzero(self.mechanism.ball[t.coordinate]):
            here = t.entry_coordinate[t.entry_site == s]
            self.phi[s] = -np.linalg.norm(m.friction[here])
            self.site_modes[s] = 0 if m.stuck[here[0]] else 1

    def _site_of(self, row: int) -> int:
        return int(self.tables.entry_site[row])

    def friction_rounding(self) -> np.ndarray:
        """Return how far friction (nc,) may be off by rounding, of the loads that cancel, too."""
        slope = np.diag(self.problem.rate_slope)
        terms = self.problem.rate_scale / np.where(slope > 0.0, slope, np.inf)
        return np.asarray(ROUNDING * (self.most - self.least + terms))

    @property
    def guards(self) -> np.ndarray:
        """(nc,) distance of the friction of what sticks from its static limits (N m or N)."""
        m = self.modes
        out = np.minimum(m.friction - self.least, self.most - m.friction)
        for number in self._balls:
            here = self.mechanism.block == number
            out[here] = self.most[here] - np.linalg.norm(m.friction[here])
        return np.asarray(out)
