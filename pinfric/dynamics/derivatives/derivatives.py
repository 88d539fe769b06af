"""Derivatives of inverse and forward dynamics of one state.

By q in the tangent space (of a floating base its twist in its own axes), v and a, with names as of
`pin.computeRNEADerivatives` and `pin.computeABADerivatives`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.derivatives.efforts import differentiate_accelerations, differentiate_efforts
from pinfric.dynamics.derivatives.tables import Tables, make_tables, record_tables
from pinfric.dynamics.inverse.undriven import check_shares
from pinfric.dynamics.problem.machine import Machine, Pinocchio
from pinfric.dynamics.samples.reactions import (
    AppliedWrench,
    applied_wrenches,
    check_roll_moments,
)
from pinfric.dynamics.samples.states import States, vector
from pinfric.errors import SceneError, StateError
from pinfric.kernels.compiled import compile_for
from pinfric.model.scene import Scene


class Partials(NamedTuple):
    """Derivatives of efforts or motor torques, (na, nv) each, by q (tangent space), v and a."""

    dtau_dq: np.ndarray
    dtau_dv: np.ndarray
    dtau_da: np.ndarray


def partials(changes: np.ndarray) -> Partials:
    """Return views of (na, 3 nv) `changes`, see `Tables`."""
    nv = changes.shape[1] // 3
    return Partials(changes[:, :nv], changes[:, nv : 2 * nv], changes[:, 2 * nv :])


class InverseDerivatives(NamedTuple):
    """Derivatives of the efforts and motor torques of a motion, as in `InverseInstant`.

    Attributes:
        effort_lower ... motor_torque_upper: of each end; equal where everything slides.
        kink: (na,) bool, drives whose derivatives are one-sided: at a contact force of 0, a corner
            of a gear's loss, or where a power of the speed below 1 begins.
    """

    effort_lower: Partials
    effort_upper: Partials
    joint_effort_lower: Partials
    joint_effort_upper: Partials
    motor_torque_lower: Partials
    motor_torque_upper: Partials
    kink: np.ndarray


class ForwardDerivatives(NamedTuple):
    """Derivatives of the accelerations that efforts cause, in the modes of the solution.

    Attributes:
        ddq_dq, ddq_dv: (nv, nv); what sticks has rows of 0.
        ddq_dtau: (nv, na) by the efforts, or by the motor torques where those are given.
        a, modes: (nv,), (ns,) as in `Instant`.
        kink: whether they are one-sided, see `InverseDerivatives`.
    """

    ddq_dq: np.ndarray
    ddq_dv: np.ndarray
    ddq_dtau: np.ndarray
    a: np.ndarray
    modes: np.ndarray
    kink: bool


def check_differentiable(scene: Scene) -> None:
    """Refuse a scene that is no open chain with drives on its joints, or has springs.

    Raises:
        SceneError: names the loop, drive or ball.
    """
    what = scene.closed_by or "a spring acts on its links"
    if not scene.closed_by and scene.twin().springs is None:
        return
    raise SceneError(
        f"{scene.source}: derivatives: {what}; should be an open chain with drives on its joints, "
        "without springs; of others take differences of `inverse` or `forward`"
    )


class Differentiator:
    """Derivatives of one scene.

    Attributes:
        tables: the results of the last call.

    Args:
        scene: an open chain.
        pinocchio, machine: of a workspace of it; argument: the machine as kernels take it.
    """

    def __init__(
        self, scene: Scene, pinocchio: Pinocchio, machine: Machine, argument: Machine
    ) -> None:
        check_differentiable(scene)
        check_shares(scene)
        self.scene, self.pinocchio, self._machine = scene, pinocchio, argument
        self._modes = machine.results.site_modes
        self.tables: Tables = make_tables(scene, pinocchio.twin, machine)
        self._record = record_tables(self.tables)
        x, nv = self.tables, pinocchio.twin.nv
        state = np.empty(scene.model.nq), np.empty(nv), np.empty(nv)
        compile_for(differentiate_efforts, self._machine, self._record, *state, 0.0)
        self._forward_is_compiled = False
        self._guides = bool(machine.plan.sites.guides.size)
        ends = map(partials, (*x.effort_change, *x.geared_change, *x.motor_change))
        self._inverse = InverseDerivatives._make([*ends, x.kink])
        self._forward = x.answer[:nv, :nv], x.answer[:nv, nv : 2 * nv], x.answer[:nv, 2 * nv :]

    def checked(
        self, external: Mapping[str, np.ndarray] | None, q: np.ndarray, *rates: np.ndarray
    ) -> list[Any]:
        """Return wrenches on links, q and rates as kernels take them.

        Raises:
            StateError, SceneError: see `vector`, `applied_wrenches`.
        """
        model = self.scene.model
        applied = [] if external is None else applied_wrenches(self.scene, external, 1)
        state = [applied, vector("q", q, model.nq, "nq", model)]
        for name, rate in zip("va", rates, strict=False):
            state.append(vector(name, rate, model.nv, "nv"))
        return state

    def at(
        self,
        applied: Sequence[AppliedWrench],
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        width: float = 0.0,
    ) -> InverseDerivatives:
        """Compute the efforts of a motion and their derivatives, see `Solver.inverse_derivatives`.

        Args:
            applied, q, v, a: see `checked`.
            width: speed (rad/s or m/s) below which friction is smooth (`efforts`).
        """
        self._balance(applied, q, v, a)
        state = self._machine, self._record
        if not differentiate_efforts(*state, q, v, a, width):  # raises, or q has to be normalized
            q = States.of(self.scene, q, v, a).q[0]
            self._balance(applied, q, v, a)
            differentiate_efforts(*state, q, v, a, width)
        if self._guides:
            joints = self.tables.sites.joint
            check_roll_moments(self.scene, self.pinocchio.views.force[None, 1 + joints], 0)
        return self._inverse

    def of_solution(
        self,
        applied: Sequence[AppliedWrench],
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        held: np.ndarray,
        motors: bool,
    ) -> ForwardDerivatives:
        """Compute the derivatives of accelerations in the machine's modes.

        Args:
            applied, q, v, a: the state that was solved, and its accelerations.
            held, motors: see `efforts.differentiate_accelerations`.

        Raises:
            StateError: the derivative is infinite, as at a jam.
        """
        self._balance(applied, q, v, a)
        state = self._machine, self._record, q, v, a, held, motors
        if not self._forward_is_compiled:  # at the first call: a cold solver has no need of it
            compile_for(differentiate_accelerations, *state)
            self._forward_is_compiled = True
        solved, kink = differentiate_accelerations(*state)
        if not solved:
            raise StateError(
                f"{self.scene.source}: accelerations have no derivative at this state: friction "
                "grows as fast as the load that it causes; change the state"
            )
        return ForwardDerivatives(*self._forward, a, self._modes, bool(kink))

    def _balance(
        self, applied: Sequence[AppliedWrench], q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> None:
        """Compute poses, composite inertias and wrenches."""
        pinocchio = self.pinocchio
        pin.crba(pinocchio.model, pinocchio.data, q, pin.Convention.WORLD)
        pinocchio.balance(q, v, a, applied)
