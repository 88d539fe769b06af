"""Forward dynamics of scenes with loops or drives off the joints: their coupled problem at a state.

    M a + h - J_ext^T f_ext = S u + J_c^T lambda + D x,     J_c a + Jdot_c v = 0

(design 2.2, 2.5; paper eq. 2-7). The closure is eliminated with a basis Z of the motions it allows,
J_c Z = 0: a = a_closure + Z (Z^T M Z)^-1 Z^T (...). What is left is a `Problem` like an open
chain's, whose coordinates are tree joints and loop joints alike; they may depend on each other at
rest (`rest.py`). Multipliers follow from the balance, for redundant closures by design 2.2's rule.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pinfric.dynamics import rest
from pinfric.dynamics.assembly import NOT_FINITE, SINGULAR, write_laws
from pinfric.dynamics.consistency import site_friction, stick_limits
from pinfric.dynamics.constrained import make_layout
from pinfric.dynamics.linked_tables import LinkedTables, make_linked_tables
from pinfric.dynamics.modes import MOST_ENUMERATED, Found, Modes
from pinfric.dynamics.problem import empty_problem
from pinfric.dynamics.reactions import AppliedWrench
from pinfric.dynamics.workspace import Workspace
from pinfric.errors import StateError, ToggleError
from pinfric.model.closure import RANK, LoopState, action_maps, close, loop_state
from pinfric.model.loops import Linkage
from pinfric.model.scene import Scene

#: A stop may change velocities by this many times the stick velocity; more, and it is none.
_STOP = 100.0
#: A joint whose share in the mechanism's motion is this small stands at its dead centre.
_IDLE = 1e-4


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
        self.multipliers = np.zeros(self.linkage.multipliers)
        self._entry_phi = np.zeros(ne)
        self._numbers = np.arange(nc, dtype=np.int64)
        self._balls = np.unique(self.mechanism.block[self.mechanism.ball])
        self._make_batch()

    # ------------------------------------------------------------ kinematics

    def _relate(self, q: np.ndarray, v: np.ndarray) -> LoopState:
        """How the pairs of frames relate at one state, at a = 0."""
        return loop_state(self.twin, self.linkage, q[None], v[None], np.zeros((1, self.nv)))

    def _directions(self, J: np.ndarray) -> np.ndarray:
        """D^T (nc, nv): the rate of every coordinate per unit velocity, from all actions' J."""
        D = np.zeros((len(self.tables.column), self.nv))
        for c, (v, column) in enumerate(
            zip(self.tables.coordinate_v, self.tables.column, strict=True)
        ):
            if v >= 0:
                D[c, v] = 1.0
            else:
                D[c] = J[column]
        return D

    def rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the relative velocity of every coordinate (nc,)."""
        t = self.tables
        out = v[t.coordinate_v]
        loops = t.column >= 0
        if loops.any():
            out[loops] = self._relate(q, v).rate[0, t.column[loops]]
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
        state = self._relate(q, v)
        J = action_maps(self.twin, self.linkage, state.p, state.R)[1][0]
        return q, self._slowed(J, v, stuck)

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
        state = self._relate(q, v)
        J = action_maps(self.twin, self.linkage, state.p, state.R)[1][0]
        slower = self._slowed(J, v, stopped)
        before, after = (self._directions(J) @ x for x in (v, slower))
        least = self.tables.stick_velocity[stopped].min(initial=np.inf)
        allowed = _STOP * least if np.isfinite(least) else 0.0
        if np.abs(slower - v).max(initial=0.0) > allowed:
            return v, stopped & ~self.mechanism.ball
        D = self._directions(J)
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
        self.run_batch(q, v, applied)
        state = self._relate(q, v)
        X, J = (array[0] for array in action_maps(self.twin, self.linkage, state.p, state.R))
        t, h = self.tables, self._rows[0]
        D = self._directions(J)
        drives = np.array([
            np.eye(self.nv)[d] if d >= 0 else J[c]
            for d, c in zip(self.layout.drive_v, self.layout.drive_column, strict=True)
        ]).reshape(-1, self.nv)  # fmt: skip
        M = self._rows[2:] - self._rows[1] + np.diag(self.twin.armature)
        given = drives.T @ effort
        if step > 0.0:  # viscous friction at the end of the step
            M = M + step * (D.T * t.viscous) @ D
            given = given - (D.T * t.viscous) @ (D @ v)
        if not (np.isfinite(M).all() and np.isfinite(given).all() and np.isfinite(h).all()):
            self._refuse(NOT_FINITE, q, v, effort)
        Z, inverse, free = self._closure(J[self.linkage.lambdas])
        target = -state.rate_derivative[0, self.linkage.lambdas]
        if step > 0.0:
            target = -(J[self.linkage.lambdas] @ v) / step
        a_closure = inverse @ target
        try:
            L = np.linalg.cholesky(Z.T @ M @ Z)
        except np.linalg.LinAlgError:
            self._refuse(SINGULAR, q, v, effort)
        factor = np.linalg.solve(L, Z.T @ D.T)  # A of rate_slope = A^T A
        push = np.linalg.solve(L, Z.T @ (given - h - M @ a_closure))
        back = Z @ np.linalg.inv(L).T
        self.a_free[:], self.a_slope[:] = a_closure + back @ push, back @ factor
        self.mechanism.idle[:] = np.linalg.norm(D @ Z, axis=1) <= _IDLE * np.linalg.norm(D, axis=1)
        self._write_rates(D, state, v, factor, step, np.abs(given) + np.abs(h))
        self._write_laws(D @ v, step > 0.0)
        right = np.column_stack([M @ self.a_free + h - given, M @ self.a_slope - D.T])
        self._write_loads(q, X, inverse.T @ right, free, effort)

    def _closure(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Motions Z (nv, d) that the loops allow, J's pseudoinverse, and the free multipliers."""
        nv = self.nv
        if not len(J):
            return np.eye(nv), np.zeros((nv, 0)), np.zeros((0, 0))
        left, size, right = np.linalg.svd(J)
        least = RANK * max(float(size.max(initial=0.0)), min(1.0, self.linkage.size))
        rank = int((size > least).sum())
        if rank < nv - self.na:
            raise ToggleError(self.linkage.loops[0].name, nv - rank, self.na)
        inverse = (right[:rank].T / size[:rank]) @ left[:, :rank].T
        return right[rank:].T, inverse, left[:, rank:]

    def _write_rates(
        self,
        D: np.ndarray,
        state: LoopState,
        v: np.ndarray,
        factor: np.ndarray,
        step: float,
        terms: np.ndarray,
    ) -> None:
        """Write r = D^T a + Ddot^T v, or of a step D^T (v + step a), and the factor of its slope."""
        p, t = self.problem, self.tables
        loops = t.column >= 0
        if step > 0.0:
            p.rate_free[:] = D @ (v + step * self.a_free)
            scale, offset = step, np.abs(D) @ np.abs(v)
        else:
            p.rate_free[:] = D @ self.a_free
            offset = np.zeros(len(loops))
            offset[loops] = state.rate_derivative[0, t.column[loops]]
            p.rate_free[:] += offset
            scale = 1.0
        p.rate_slope[:] = scale * factor.T @ factor
        p.rate_scale[:] = np.abs(offset) + scale * np.abs(self.a_slope).T @ terms
        self.mechanism = replace(self.mechanism, factor=np.sqrt(scale) * factor)

    def _write_laws(self, rates: np.ndarray, implicit: bool) -> None:
        """Write every entry's coefficients; a ball's depend on its speed, its drag on its rates."""
        t = self.tables
        write_laws(self.speeds(rates) if self._balls.size else rates, t.law, self._numbers,
                   self.problem, implicit)  # fmt: skip
        if self._balls.size and not implicit:
            ball = self.mechanism.ball[t.entry_coordinate]
            self.problem.drag[ball] = t.law[ball, 6] * rates[t.entry_coordinate[ball]]

    def _write_loads(
        self, q: np.ndarray, X: np.ndarray, y: np.ndarray, free: np.ndarray, effort: np.ndarray
    ) -> None:
        """Write wrenches of all joints and contact forces as [..., 0] + [..., 1:] x.

        Args:
            q: (nq,).
            X: (nj + loops, 6, nx), `kinematics.act_on_joints`.
            y: (nl, 1 + nc) multipliers of least norm.
            free: (nl, nf) what may be added to them (redundant closures).
            effort: (na,).
        """
        t, layout, nj = self.tables, self.layout, self.layout.n_tree
        G = np.zeros((X.shape[0], 6, 1 + len(t.column)))
        a = np.column_stack([self.a_free, self.a_slope])
        slopes = (self.batch.wrench[2:] - self.batch.wrench[1]).reshape(self.nv, -1)
        G[:nj] = (slopes.T @ a).reshape(nj, 6, -1)
        G[:nj, :, 0] += self.batch.wrench[0]
        off = layout.drive_column >= 0
        G[:, :, 0] += X[:, :, layout.drive_column[off]] @ effort[off]
        loops = np.flatnonzero(t.column >= 0)
        G[:, :, 1 + loops] += X[:, :, t.column[loops]]
        among = X[:, :, self.linkage.lambdas]
        if free.shape[1]:
            y = y + free @ self._least(G + among @ y, among @ free)
        G += among @ y
        if not np.isfinite(G).all():
            raise StateError("forward dynamics overflows at this state: values are too large")
        self._joint_wrenches, self._multipliers = G, y
        moved = t.displacement_shift + t.displacement_ratio * q[t.displacement_q]
        maps = t.contact_map + moved[:, None, None] * t.contact_map_moved
        contact = maps @ G[t.contact_row]
        self.problem.contact_free[:] = contact[:, :, 0]
        self.problem.contact_slope[:] = contact[:, :, 1:].transpose(0, 2, 1)

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
        found = rest.search(self.problem, m, self.mechanism)
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

    def way_out(self) -> np.ndarray:
        """Return the direction (nc,) in which what sticks would break away."""
        return self.mechanism.way.copy()

    def search(
        self, forced: Mapping[int, float] | None = None, held: np.ndarray | None = None
    ) -> Found:
        """Search the modes of what is at rest; see `modes.search`, `rest.search`."""
        return rest.search(self.problem, self.modes, self.mechanism, forced, held)

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
        if m.stuck.any():
            self.a[t.coordinate_v[m.stuck & (t.coordinate_v >= 0)]] = 0.0
            factor = self.mechanism.factor
            size = np.linalg.svd(factor[:, m.stuck], compute_uv=False)
            if int((size > RANK * size[:1]).sum()) == len(factor):
                self.a[:] = 0.0  # nothing can move
        x = np.concatenate([[1.0], m.friction])
        self.multipliers[:] = self._multipliers @ x
        self.wrench[:] = (self._joint_wrenches @ x)[t.joint]
        stick_limits(self.problem, m.load, self.least, self.most)
        site_friction(self.problem, m.stuck, m.direction, m.friction, m.load, self.least,
                      self.most, self._entry_phi)  # fmt: skip
        self.load[t.entry_site] = m.load
        single = ~self.mechanism.ball[t.coordinate]
        self.phi[t.entry_site] = self._entry_phi
        self.site_modes[:] = np.sign(m.direction[t.coordinate] * t.ratio)
        for s in np.flatnonzero(~single):
            here = t.entry_coordinate[t.entry_site == s]
            self.phi[s] = -np.linalg.norm(m.friction[here])
            self.site_modes[s] = 0 if m.stuck[here[0]] else 1

    def _site_of(self, row: int) -> int:
        return int(self.tables.entry_site[row])

    @property
    def guards(self) -> np.ndarray:
        """(nc,) distance of the friction of what sticks from its static limits (N m or N)."""
        m = self.modes
        out = np.minimum(m.friction - self.least, self.most - m.friction)
        for number in self._balls:
            here = self.mechanism.block == number
            out[here] = self.most[here] - np.linalg.norm(m.friction[here])
        return np.asarray(out)
