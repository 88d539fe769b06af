"""Friction that is smooth through rest, for optimizers: efforts, accelerations, implicit steps.

    phi = -s(v/w) (mu c + coulomb) - drag,     s of `efforts`

At |v| >= w it is the exact law; below, it leaves the interval of an exact joint at rest by at most
`Smoothed.bound`. A load that static friction would hold creeps at less than w. There is no
break-away (static above kinetic friction).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.derivatives.derivatives import (
    Differentiator,
    ForwardDerivatives,
    Partials,
    partials,
)
from pinfric.dynamics.derivatives.efforts import smooth_sign
from pinfric.dynamics.samples.reactions import AppliedWrench
from pinfric.dynamics.samples.states import one_of, vector
from pinfric.errors import SceneError, StateError
from pinfric.model.arrays import real_numbers
from pinfric.model.laws import is_dry, law_at

#: A sum below these parts of its terms is 0, after one more pass and as it is; Newton's passes, and
#: halvings of one.
_BALANCED, _EXACT, _PASSES, _HALVINGS = 1e-12, 1e-15, 200, 40
External = Mapping[str, np.ndarray] | None


class SmoothInverse(NamedTuple):
    """Efforts of a motion with smooth friction, and their derivatives.

    Attributes:
        effort, joint_effort, motor_torque: (na,), see `InverseInstant`.
        of_effort, of_joint_effort, of_motor_torque: derivatives of each.
        kink: (na,) bool, see `InverseDerivatives`.
    """

    effort: np.ndarray
    joint_effort: np.ndarray
    motor_torque: np.ndarray
    of_effort: Partials
    of_joint_effort: Partials
    of_motor_torque: Partials
    kink: np.ndarray


class SmoothStep(NamedTuple):
    """State at the end of a time step, and derivatives of its velocity.

    Attributes:
        q, v: (nq,), (nv,) at the end; q is that of the beginning moved by dt v.
        dv_dq, dv_dv, dv_dtau: (nv, nv), (nv, nv), (nv, na) by the state at the beginning and the
            efforts, or motor torques.
    """

    q: np.ndarray
    v: np.ndarray
    dv_dq: np.ndarray
    dv_dv: np.ndarray
    dv_dtau: np.ndarray


class Smoothed:
    """Dynamics with smooth friction of one scene, one state at a time; for one thread.

    Attributes:
        width: w (rad/s or m/s), the speed up to which friction rises smoothly from 0.

    Args:
        derived: derivatives of the scene, whose buffers nothing else uses.
        width: see the attribute.
        held: velocities that move no mass (`model.massless`); `forward` lets them rest.

    Raises:
        StateError: a width of 0 or below.
    """

    def __init__(self, derived: Differentiator, width: float, held: np.ndarray) -> None:
        self.width = _positive("width", width, "rad/s or m/s")
        self._held = held
        self._derived, self._scene = derived, derived.scene

    def inverse(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, *, external: External = None
    ) -> SmoothInverse:
        """Return the efforts of a motion, u = tau_id - D phi, and their derivatives.

        Args, raises: see `Solver.inverse_derivatives`. The next call overwrites the arrays.
        """
        x = self._derived.tables
        applied, q, v, a = self._derived.checked(external, q, v, a)
        self._derived.at(applied, q, v, a, self.width)
        ends = x.effort_change, x.geared_change, x.motor_change
        values = x.effort[0], x.geared[0], x.motor[0]
        return SmoothInverse._make([*values, *(partials(end[0]) for end in ends), x.kink])

    def forward(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray | None = None,
        *,
        motor_torque: np.ndarray | None = None,
        external: External = None,
    ) -> ForwardDerivatives:
        """Return the accelerations that efforts, or motor torques, cause, and derivatives.

        U(q, v, a) = u by Newton's method from a = 0, with U the efforts of `inverse`.

        Args: see `Solver.forward`; arrays only.

        Raises:
            StateError: no acceleration is found.
            SceneError: motor torques with several drives on one joint.
        """
        applied, q, v = self._derived.checked(external, q, v)
        a, *by = self._solve(applied, q, v, (effort, motor_torque))
        x = self._derived.tables
        modes = np.sign(x.sites.ratio * v[x.sites.velocity_index]).astype(np.int8)
        return ForwardDerivatives._make([*by, a, modes, bool(x.kink.any())])

    def step(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray | None = None,
        *,
        dt: float,
        motor_torque: np.ndarray | None = None,
        external: External = None,
    ) -> SmoothStep:
        """Return the state after an implicit step, and the derivatives of its velocity.

        U(q, v+, (v+ - v)/dt) = u,  q+ = q + dt v+;  dv+ = (U_v + U_a/dt)^-1 (-U_q, U_a/dt, 1);
        stable at any dt and width.

        Args: see `forward`; dt: s.

        Raises: see `forward`.
        """
        dt = _positive("dt", dt, "s")
        applied, q, v = self._derived.checked(external, q, v)
        end, *by = self._solve(applied, q, v, (effort, motor_torque), dt)
        return SmoothStep(pin.integrate(self._scene.model, q, dt * end), end, *by)

    def bound(self, load: np.ndarray | None = None) -> np.ndarray:
        """Return how far efforts are at most beyond those of the exact joints at rest (N m or N).

        Of every site the max over 0 < |v| < w of s(v/w) (mu c + coulomb) + drag - (mu_s c +
        coulomb_s), or 0, as where drag within w is at most static less kinetic friction. Motor
        torques have the drag of the motor besides.

        Args:
            load: (ns,) loads c (N m or N); None: the least, which is the worst unless drag grows.

        Returns:
            (na,) of the drives' efforts.

        Raises:
            StateError: drag grows with the load, and no load is given.
        """
        tables, scene, per_joint = self._derived.tables, self._scene, np.zeros(self._scene.model.nv)
        c = tables.sites.contacts.constant if load is None else real_numbers("load", load)
        if c.shape != (len(scene.sites),):
            raise StateError(f"load: shape {c.shape}; should be ({len(scene.sites)},)")
        for s, site in enumerate(scene.sites):
            most = 0.0
            for way in (1.0, -1.0):
                speeds = np.linspace(0.0, self.width, 65)
                for _ in range(5):
                    beyond = np.array([self._beyond(s, way * speed) for speed in speeds])
                    if load is None and (beyond[:, 1] > 0.0).any():
                        raise StateError(
                            f"{scene.source}: bound: drag of {site.name!r} grows with its load; "
                            "give `load`"
                        )
                    sums = beyond @ (1.0, c[s])
                    k = int(np.argmax(sums))
                    most = max(most, float(sums[k]))
                    speeds = np.linspace(speeds[max(k - 1, 0)], speeds[min(k + 1, 64)], 65)
            per_joint[site.velocity_index] += abs(site.ratio) * most
        return np.asarray(np.abs(tables.delivery) @ per_joint)

    def _beyond(self, s: int, velocity: float) -> tuple[float, float]:
        """Smooth friction of a site beyond its static limit: at no load, per unit of load."""
        laws = self._derived.tables.sites.laws
        law, share = law_at(laws, s, velocity), abs(smooth_sign(velocity / self.width)[0])
        if not is_dry(law):
            return 0.0, 0.0
        ends = law.forward, law.static_forward
        if velocity < 0.0:
            ends = law.backward, law.static_backward
        fixed = share * ends[0] - ends[1] + law.drag + law.viscous * abs(velocity)
        return fixed, share * law.mu + law.drag_mu - law.static_mu

    def _solve(
        self,
        applied: Sequence[AppliedWrench],
        q: np.ndarray,
        v: np.ndarray,
        inputs: tuple[np.ndarray | None, np.ndarray | None],
        dt: float = 0.0,
    ) -> tuple[np.ndarray, ...]:
        """Return y with U = u, and its derivatives by q, v and u.

        y is the acceleration, or the velocity at the end of a step. Newton's steps are halved until
        U comes nearer to u: friction is steep within w.
        """
        scene, x, nv = self._scene, self._derived.tables, v.size
        effort, by_u, na = inputs[0], x.rate.T, len(scene.drives)
        name = "motor_torque" if effort is None else "effort"
        u = vector(name, one_of("Smoothed", *inputs), na, "na")
        if effort is None:  # rows of drives, then of joints without one
            by_u = np.zeros((nv, na))
            undriven = list(scene.mobility.undriven)
            if na + len(undriven) != nv:
                raise SceneError(f"{scene.source}: Smoothed: several drives move one joint")
            np.fill_diagonal(by_u, x.gears.ratio)
        target = by_u @ u

        def equations(y: np.ndarray) -> tuple[np.ndarray, Partials, np.ndarray]:
            """U - u, the derivatives of U, and that by y."""
            after, a = (y, (y - v) / dt) if dt else (v, y)
            self._derived.at(applied, q, after, a, self.width)
            value, changes = x.joint[0], x.joint_change[0]
            if effort is None:
                value = np.concatenate([x.geared[0], value[undriven]])
                changes = np.concatenate([x.geared_change[0], changes[undriven]])
            of = partials(changes)
            return value - target, of, of.dtau_dv + of.dtau_da / dt if dt else of.dtau_da

        y = v if dt else np.zeros(nv)
        value, of, slope = equations(y)
        terms = float(np.abs(target).max(initial=0.0) + np.abs(value).max(initial=0.0)) + 1e-300
        size = float(np.linalg.norm(value))
        for _ in range(_PASSES):
            last, step = size <= _BALANCED * terms, -self._divide(value, slope, dt)
            for _ in range(1 if last else _HALVINGS):
                ahead, of, slope = equations(y + step)
                if (near := float(np.linalg.norm(ahead))) < size:
                    break
                step *= 0.5
            else:
                value, of, slope = equations(y)
                break
            y, value, size = y + step, ahead, near
            if last or size <= _EXACT * terms:
                break
        if not size <= 1e-9 * terms:
            raise StateError(
                f"{scene.source}: Smoothed: no motion found that balances the efforts; take a "
                "larger width or a smaller dt"
            )
        by_v = of.dtau_da / dt if dt else -of.dtau_dv
        by = self._divide(np.hstack([-of.dtau_dq, by_v, by_u]), slope, dt)
        return y, by[:, :nv], by[:, nv : 2 * nv], by[:, 2 * nv :]

    def _divide(self, right: np.ndarray, slope: np.ndarray, dt: float) -> np.ndarray:
        """Return slope^-1 right, and 0 for accelerations that no effort depends on."""
        if dt or not self._held.size:
            with suppress(np.linalg.LinAlgError):
                return np.linalg.solve(slope, right)
            return np.full(right.shape, np.nan)
        found, moves = np.zeros(right.shape), np.ones(len(slope), dtype=bool)
        moves[self._held] = False  # one row each is 0, and lies outside what the others span
        found[moves] = np.linalg.lstsq(slope[:, moves], right)[0]
        return found


def _positive(name: str, value: float, unit: str) -> float:
    """Return one number above 0, or raise `StateError` naming it."""
    number = real_numbers(name, value)
    if number.shape != () or not 0.0 < number < np.inf:
        raise StateError(f"{name}: {value!r}; should be one number above 0 ({unit})")
    return float(number)
