"""Keeps a state on its constraints: loops stay closed, sticking joints stay where they stopped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.problem.accelerations import is_exact, measure_rates, relate
from pinfric.dynamics.problem.machine import Machine, Pinocchio
from pinfric.kernels.compiled import KernelArgument
from pinfric.model.closure import RANK, close
from pinfric.model.loops import Linkage, no_linkage, stand_still
from pinfric.model.scene import Scene

#: A stop may change velocities by at most this many times the stick velocity.
_STOP = 100.0
#: A joint with a smaller share than this in every possible motion stands still, to rounding.
_MOVES_NOT = 1e-14


@dataclass(frozen=True, eq=False)
class Standing:
    """Coordinates at a standstill in a mechanism with loops.

    Attributes:
        coordinates: (nc,) bool.
        linkage: with those at loops' joints fixed.
    """

    coordinates: np.ndarray
    linkage: Linkage


class Constraints:
    """The constraints of a workspace's scene.

    Attributes:
        closed: see `Closure.dependent`.
        off_joints: see `Plan.off_joints`.
        standing: coordinates that `project` fixes, see `hold_position`; None in an open chain.
    """

    def __init__(
        self, scene: Scene, pinocchio: Pinocchio, argument: KernelArgument[Machine]
    ) -> None:
        self._plan = argument.given.plan
        self.closed, self.off_joints = bool(self._plan.closure.dependent), self._plan.off_joints
        self._pinocchio, self._argument = pinocchio, argument
        self._twin, self._nv = pinocchio.twin, pinocchio.twin.nv
        self._kinematics = argument.given.kinematics
        self.standing: Standing | None = None
        self._linkage = scene.linkage
        if self.closed:
            self._linkage = scene.linkage or no_linkage(scene.model)
            self.standing = Standing(
                np.zeros(len(self._plan.coordinates.dry), dtype=bool), self._linkage
            )
        #: The configuration closed last, and what stands still in it.
        self._last: tuple[np.ndarray, Standing | None] = np.zeros(0), None

    def rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the relative velocity of every coordinate (nc,) at q (nq,), v (nv,)."""
        if self.off_joints:
            v = np.ascontiguousarray(v)
            self._pinocchio.move(np.ascontiguousarray(q), v)
            measure_rates(self._argument.now, v)
            return self._kinematics.coordinate_rate.copy()
        return np.asarray(v[self._plan.coordinates.velocity_index])

    def is_exact(self, q: np.ndarray) -> bool:
        """Whether the state solved last is normalized and obeys its loops to 1e-8."""
        return bool(is_exact(self._argument.now, q))

    def project(
        self, q: np.ndarray, v: np.ndarray, stuck: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the state with loops closed exactly and sticking coordinates (nc,) at rest.

        Coordinates at a standstill keep their positions.
        """
        if not self.closed:
            return q, self._stopped(v, stuck)
        q = self._close(q, stuck)
        self._relate(q, v)
        return q, self._slowed(v, stuck)

    def hold_position(self, q: np.ndarray, stuck: np.ndarray) -> np.ndarray:
        """Let `project` fix sticking coordinates until they slip; return q (nq,), closed."""
        if self.standing is None or (self.standing.coordinates == stuck).all():
            return q
        q = self._close(q, stuck)
        self._pinocchio.move(q, np.zeros(self._nv))
        self._hold(stuck)
        self._last = self._last[0], self.standing
        return q

    def _hold(self, coordinates: np.ndarray) -> None:
        """Fix coordinates at their positions; those that are fixed already stay there."""
        assert self._linkage is not None
        assert self.standing is not None
        action = self._plan.coordinates.action[coordinates]
        linkage = stand_still(
            self._linkage, self.standing.linkage, action[action >= 0], self._pinocchio.data.oMi
        )
        self.standing = Standing(coordinates.copy(), linkage)

    def _close(self, q: np.ndarray, stuck: np.ndarray) -> np.ndarray:
        """The configuration near q that closes the loops with fixed coordinates unchanged."""
        assert self.standing is not None
        if (self.standing.coordinates & ~stuck).any():
            self._hold(self.standing.coordinates & stuck)
        last, standing = self._last
        if standing is self.standing and np.array_equal(q, last):
            return q
        velocity = self._plan.coordinates.velocity_index[self.standing.coordinates]
        held = np.zeros(self._nv, dtype=bool)
        held[velocity[velocity >= 0]] = True
        q = close(self._twin, self.standing.linkage, q, held)
        self._last = q, self.standing
        return q

    def _relate(self, q: np.ndarray, v: np.ndarray) -> None:
        """Write rates, J and D of a state."""
        q, v = np.ascontiguousarray(q), np.ascontiguousarray(v)
        self._pinocchio.move(q, v)
        relate(self._argument.now, v)

    def _stopped(self, v: np.ndarray, stopped: np.ndarray) -> np.ndarray:
        v = v.copy()
        velocity = self._plan.coordinates.velocity_index[stopped]
        v[velocity[velocity >= 0]] = 0.0
        return v

    def _slowed(self, v: np.ndarray, stopped: np.ndarray) -> np.ndarray:
        """The velocities nearest to v that obey the loops and are zero at stopped coordinates."""
        first, last = self._plan.closure.off_joint, self._plan.closure.solved
        rows = np.concatenate([self._kinematics.J[0, first:last], self._kinematics.D[stopped]])
        if not len(rows):
            return v.copy()
        _, size, right = np.linalg.svd(rows, full_matrices=False)
        rank = int((size > RANK * max(float(size[0]), 1e-300)).sum())
        if rank == self._nv:
            return np.zeros(self._nv)
        allowed = np.eye(self._nv) - right[:rank].T @ right[:rank]
        allowed[np.abs(allowed).max(axis=1) <= _MOVES_NOT] = 0.0  # no remaining motion moves it
        return self._stopped(allowed @ v, stopped)

    def stop(
        self, q: np.ndarray, v: np.ndarray, stopped: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return velocities with coordinates at rest, and all coordinates that are then at rest.

        Where the mechanism passes a dead centre of the joint, nothing stops and the velocities are
        unchanged. A ball that keeps turning is not at rest.

        Args:
            q, v: state.
            stopped: (nc,) bool.
        """
        t, D = self._plan.coordinates, self._kinematics.D
        if not self.closed:
            return self._stopped(v, stopped), stopped
        self._relate(q, v)
        slower = self._slowed(v, stopped)
        before, after = D @ v, D @ slower
        least = t.stick_velocity[stopped].min(initial=np.inf)
        allowed = _STOP * least if np.isfinite(least) else 0.0
        if np.abs(slower - v).max(initial=0.0) > allowed:
            return v, stopped & ~t.ball
        speed, change, lever = np.abs(after), np.abs(before - after), np.linalg.norm(D, axis=1)
        for first in np.unique(t.block[t.ball]):  # a ball stops about all its axes, or turns on
            axes = slice(first, first + 3)
            for sizes in (speed, change, lever):
                sizes[axes] = np.linalg.norm(sizes[axes])
        still = speed <= 1e-3 * np.minimum(t.stick_velocity, 1.0)
        moved, fixed = change > 0.0, lever == 0.0
        return slower, stopped | (still & moved & t.dry & ~fixed)
