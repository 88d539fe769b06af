"""Pinocchio's figures at one state, as views for the kernels.

Pinocchio stores poses, velocities and wrenches of all joints contiguously. Views of these arrays
stay valid, so nothing is copied from one state to the next. If a build of Pinocchio has another
memory layout, they are copied after every call.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.dynamics.problem.machine import Supply
from pinfric.dynamics.samples.reactions import AppliedWrench
from pinfric.model.twin import Twin

_WORLD = pin.Convention.WORLD


class Supplier:
    """Pinocchio's figures of one robot at the last state.

    Attributes:
        model, data: of Pinocchio.
        supply: live views of the data, the ground first.
    """

    def __init__(self, twin: Twin) -> None:
        self.twin, self.model, self.data = twin, twin.model, twin.model.createData()
        self._zero = np.zeros(twin.nv)
        self._copies: list[tuple[np.ndarray, Sequence[np.ndarray]]] = []
        data, joints = self.data, range(twin.model.njoints)
        pin.crba(self.model, data, pin.neutral(self.model), _WORLD)
        lever = self._rows([data.oYcrb[j].lever for j in joints])
        self.supply = Supply(
            R=self._rows([data.oMi[j].rotation for j in joints]),
            p=self._rows([data.oMi[j].translation for j in joints]),
            velocity=self._rows([data.v[j].vector for j in joints]),
            acceleration=self._rows([data.a_gf[j].vector for j in joints]),
            force=self._rows([data.f[j].vector for j in joints]),
            lever=lever,
            inertia=self._inertias(lever),
            h=data.tau,
        )

    def at(self, q: np.ndarray, v: np.ndarray, applied: Sequence[AppliedWrench] | None) -> None:
        """Compute everything at one state (nq,), (nv,), under wrenches from outside."""
        pin.crba(self.model, self.data, q, _WORLD)
        pin.rnea(self.model, self.data, q, v, self._zero)
        if self._copies:
            self._copy()
        for wrench in applied or ():
            self._subtract(wrench.joint, wrench.wrench[0])

    def balance(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, applied: Sequence[AppliedWrench] = ()
    ) -> None:
        """Compute the wrenches and, in `h`, the efforts of a motion without friction."""
        pin.rnea(self.model, self.data, q, v, a)
        if self._copies:
            self._copy()
        for wrench in applied:
            self._subtract(wrench.joint, wrench.wrench[0])

    def move(self, q: np.ndarray, v: np.ndarray) -> None:
        """Compute poses and velocities only."""
        pin.forwardKinematics(self.model, self.data, q, v)
        self._copy()

    def _subtract(self, row: int, wrench: np.ndarray) -> None:
        """Let a wrench on a link, in its joint's frame, relieve the joints that carry it."""
        twin, h, force = self.twin, self.supply.h, pin.Force(wrench)
        while row >= 0:
            f = force.vector
            self.supply.force[row + 1] -= f
            first = twin.v_index[row]
            if twin.components[row, 0] < 0:
                h[first] -= twin.ratio[row] * (twin.axis[row] @ f)
            else:
                moved = twin.components[row][twin.components[row] >= 0]
                h[first : first + len(moved)] -= f[moved]
            force = self.data.liMi[row + 1].act(force)
            row = self.model.parents[row + 1] - 1

    def _rows(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """One array whose rows are the given ones of Pinocchio's memory, or follow them."""
        places = np.diff([x.__array_interface__["data"][0] for x in arrays])
        first = arrays[0]
        if (places == places[:1]).all() and (places > 0).all():
            strides = (int(places[0]) if places.size else first.nbytes, *first.strides)
            return np.lib.stride_tricks.as_strided(first, (len(arrays), *first.shape), strides)
        # of the same layout as the view would have: other types are other kernels
        wider = np.zeros((len(arrays), 2 * first.size))
        out = wider[:, : first.size] if first.size != 6 else np.zeros((len(arrays), 6))
        out = np.lib.stride_tricks.as_strided(
            out, (len(arrays), *first.shape), (out.strides[0], *first.strides)
        )
        self._copies.append((out, arrays))
        return out

    def _inertias(self, lever: np.ndarray) -> np.ndarray:
        """(1 + nj, 6) rotational inertias: they stand behind the levers, which is tested."""
        rows, columns = np.array([0, 1, 1, 2, 2, 2]), np.array([0, 0, 1, 0, 1, 2])
        given = np.array([y.inertia[rows, columns] for y in self.data.oYcrb])
        if not self._copies:
            behind = np.lib.stride_tricks.as_strided(lever, (len(given), 9), lever.strides)[:, 3:]
            if np.array_equal(behind, given):
                return behind
        out = np.zeros((len(given), 9))[:, 3:]
        self._copies.append((out, _Inertias(self.data, rows, columns)))
        return out

    def _copy(self) -> None:
        for target, sources in self._copies:
            for row, source in enumerate(sources):
                target[row] = source


class _Inertias(Sequence[np.ndarray]):
    """Rotational inertias of a `Data`, read anew each time: they are no views."""

    def __init__(self, data: pin.Data, rows: np.ndarray, columns: np.ndarray) -> None:
        self.data, self.rows, self.columns = data, rows, columns

    def __len__(self) -> int:
        return len(self.data.oYcrb)

    def __getitem__(self, i: Any) -> Any:
        return self.data.oYcrb[i].inertia[self.rows, self.columns]
