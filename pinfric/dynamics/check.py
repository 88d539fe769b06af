"""The solver's judge: equilibrium and friction laws recomputed in another way, sample by sample.

Nothing here calls the twin or a compiled kernel: wrenches come from `data.f` of Pinocchio's RNEA
with external forces, loads and friction from the formulas written out in NumPy. Scenes with loops,
cylinders or forces are judged in `coupled_check`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinfric.model.bearings import Ball, Guide, Linear, LoadTerms, Pin
from pinfric.model.friction_terms import Coefficients, DirectedCoulombFriction
from pinfric.model.scene import Site
from pinfric.model.schema import Friction

if TYPE_CHECKING:
    from pinfric.dynamics.result import InverseResult


@dataclass(frozen=True)
class Check:
    """Largest residuals over all samples.

    Attributes:
        equilibrium: |M a + h - J^T f_ext - u - D phi| at both ends of every interval (N m or N).
        friction_law: |phi - law(v, c)| at both ends (N m or N).
        wrench: |w - data.f| (N or N m); 0 where no wrench was needed.
        scale: largest effort in the result, to compare the residuals with.
        sample: the sample of the largest equilibrium residual.
    """

    equilibrium: float
    friction_law: float
    wrench: float
    scale: float
    sample: int

    def passed(self, relative: float = 1e-9) -> bool:
        """Say whether every residual is below `relative` times the scale."""
        worst = max(self.equilibrium, self.friction_law, self.wrench)
        return bool(worst <= relative * max(self.scale, 1e-300))


def check(result: InverseResult) -> Check:
    """Recompute the residuals of a result (see `Check`)."""
    from pinfric.dynamics.coupled_check import coupled_residuals  # it needs this file

    states, scene = result.states, result.scene
    worst = np.zeros(3)
    worst_sample = 0
    every = (result.effort_lower, result.effort_upper, result.effort_frictionless)
    scale = max(float(np.abs(np.nan_to_num(efforts)).max(initial=0)) for efforts in every)
    for start, stop, carried in states.phases(scene):
        model = scene.loaded_model(carried)
        data = model.createData()
        for i in range(start, stop):
            total, wrenches = _plain_rnea(model, data, result, i)
            if scene.linkage is None:
                residuals = _residuals(result, i, total, wrenches)
            else:
                residuals, largest = coupled_residuals(result, model, data, i)
                scale = max(scale, largest)
            if residuals[0] > worst[0]:
                worst_sample = i
            worst = np.maximum(worst, residuals)
            scale = max(scale, float(np.abs(wrenches).max(initial=0)))
    equilibrium, friction_law, wrench = (float(w) for w in worst)
    return Check(equilibrium, friction_law, wrench, scale, worst_sample)


def _plain_rnea(
    model: pin.Model, data: pin.Data, result: InverseResult, i: int
) -> tuple[np.ndarray, np.ndarray]:
    """(nv,) tau_id and (nj, 6) joint wrenches of one sample, by the ordinary RNEA."""
    forces = pin.StdVec_Force()
    forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
    for applied in result.external:
        forces[applied.joint + 1] += pin.Force(applied.wrench[i])
    s = result.states
    total = pin.rnea(model, data, s.q[i], s.v[i], s.a[i], forces)
    return total, np.array([f.vector for f in data.f][1:]).reshape(-1, 6)


def _residuals(
    result: InverseResult, i: int, total: np.ndarray, wrenches: np.ndarray
) -> np.ndarray:
    sites = result.scene.sites
    states = result.states
    D = np.zeros((len(total), len(sites)))
    law = wrench = 0.0
    for s, site in enumerate(sites):
        D[site.velocity_index, s] = site.ratio
        w = wrenches[site.joint]
        if result.wrench is not None:
            wrench = max(wrench, float(np.abs(result.wrench[i, s] - w).max()))
        load = plain_normal_load(site, w, _displacement(result, site, i))
        v = site.ratio * states.v[i, site.velocity_index]
        least, greatest = plain_friction(site, v, load, bool(result.reversal[i, s]))
        law = max(law, abs(result.friction_lower[i, s] - least),
                  abs(result.friction_upper[i, s] - greatest),
                  abs(result.normal_load[i, s] - load))  # fmt: skip
    # the friction that gives each end of each effort, by the sign of its column
    phi_low, phi_high = result.friction_lower[i], result.friction_upper[i]
    most = np.where(D >= 0, D * phi_high, D * phi_low).sum(axis=1)
    least_d = np.where(D >= 0, D * phi_low, D * phi_high).sum(axis=1)
    equilibrium = max(
        float(np.abs(total - result.effort_lower[i] - most).max(initial=0)),
        float(np.abs(total - result.effort_upper[i] - least_d).max(initial=0)),
        float(np.abs(total - result.effort_frictionless[i]).max(initial=0)),
    )
    return np.array([equilibrium, law, wrench])


def _displacement(result: InverseResult, site: Site, i: int) -> float:
    twin = result.scene.twin()
    q = result.states.q[i, twin.q_index[site.joint]]
    return float(twin.ratio[site.joint] * q + twin.shift[site.joint])


def plain_normal_load(site: Site, wrench: np.ndarray, displacement: float) -> float:
    """Return one site's normal load by the formulas of `bearings`, written out.

    Args:
        site: the joint and its bearing.
        wrench: (6,), parent on child in the child's joint frame.
        displacement: position of the child along the axis (m), for guides fixed to the parent.
    """
    bearing, k = site.friction.bearing, site.axis
    if bearing is None:
        return 0.0
    if bearing.kind not in _LOADS:  # a kind that a class has added
        return _by_terms(bearing.terms(), k, wrench, displacement)
    on_parent = getattr(bearing, "on", "child") == "parent"
    middle = getattr(bearing, "offset", 0.0) - (displacement if on_parent else 0.0)
    F, M = wrench[:3], wrench[3:] - middle * np.cross(k, wrench[:3])
    F_a, M_a = F @ k, M @ k
    F_r, M_b = F - F_a * k, M - M_a * k
    return float(_LOADS[bearing.kind](bearing, k, F_r, F_a, M_b, M_a))


def _by_terms(terms: LoadTerms, k: np.ndarray, wrench: np.ndarray, displacement: float) -> float:
    turn = pin.Quaternion.FromTwoVectors(k, np.array([0.0, 0.0, 1.0])).toRotationMatrix()
    w = np.concatenate([turn @ wrench[:3], turn @ wrench[3:]])
    moved = [*terms.moved, *np.zeros((len(terms.maps) - len(terms.moved), 3, 6))]
    forces = [(B + displacement * C) @ w for B, C in zip(terms.maps, moved, strict=True)]
    return float(sum(map(np.linalg.norm, forces)) + terms.constant)


def _two_ends(length: float, k: np.ndarray, F_r: np.ndarray, M_b: np.ndarray) -> float:
    couple = np.cross(M_b, k) / length
    return float(np.linalg.norm(F_r / 2 + couple) + np.linalg.norm(F_r / 2 - couple))


def _pin(b: Pin, k: np.ndarray, F_r: np.ndarray, F_a: float, M_b: np.ndarray, _: float) -> float:
    radial = np.linalg.norm(F_r) if b.length is None else _two_ends(b.length, k, F_r, M_b)
    return float(b.radius * (radial + b.preload) + b.thrust_radius * abs(F_a))


def _guide(
    b: Guide, k: np.ndarray, F_r: np.ndarray, _: float, M_b: np.ndarray, M_a: float
) -> float:
    roll = 0.0 if b.width is None else 2 * abs(M_a) / b.width
    return _two_ends(b.length, k, F_r, M_b) + roll + b.preload


def _linear(
    b: Linear, k: np.ndarray, F_r: np.ndarray, F_a: float, M_b: np.ndarray, _: float
) -> float:
    radial, bending = np.linalg.norm(F_r), np.linalg.norm(M_b)
    return float(b.radial * radial + b.axial * abs(F_a) + b.moment * bending + b.preload)


def _ball(b: Ball, k: np.ndarray, F_r: np.ndarray, F_a: float, _: np.ndarray, __: float) -> float:
    return float(b.radius * (np.linalg.norm(F_r + F_a * k) + b.preload))


_LOADS: dict[str, Callable[..., float]] = {
    "pin": _pin, "guide": _guide, "linear": _linear, "ball": _ball,
}  # fmt: skip


def plain_friction(
    site: Site, velocity: float, load: float, at_rest: bool = False
) -> tuple[float, float]:
    """Return the least and greatest friction of one site (`laws`; paper eq. 20, 21).

    Args:
        site: the joint and its law.
        velocity: child relative to parent (rad/s or m/s).
        load: normal load (N m or N).
        at_rest: the site passes through rest beside this sample.
    """
    friction, speed, sign = site.friction, abs(velocity), float(np.sign(velocity))
    rest = (-_dry(friction, load, 1.0, None), _dry(friction, load, -1.0, None))
    drag = friction.viscous * velocity + sign * _added(friction, load, sign, speed, drags=True)
    if speed <= site.law.stick_velocity:
        if rest == (0.0, 0.0) and not any(any(term.at_rest()) for term in friction.terms):
            return -drag, -drag  # nothing can hold it
        return rest[0] - max(drag, 0.0), rest[1] - min(drag, 0.0)
    phi = -sign * _dry(friction, load, sign, speed) - drag
    return (min(rest[0], phi), max(rest[1], phi)) if at_rest else (phi, phi)


def _dry(friction: Friction, load: float, direction: float, speed: float | None) -> float:
    """Dry friction's magnitude at a speed; None: at rest, where it is at its limit."""
    blend, stribeck = float(speed is None), friction.stribeck
    if speed is not None and stribeck is not None:
        blend = float(np.exp(-((speed / stribeck.velocity) ** stribeck.exponent)))
    coulomb = friction.coulomb
    if isinstance(coulomb, DirectedCoulombFriction):
        pair: Coefficients | None = coulomb.positive if direction > 0 else coulomb.negative
    else:
        pair = coulomb
    total = _added(friction, load, direction, speed, drags=False)
    for given, factor in ((friction.mu, load), (pair, 1.0)):
        if given is not None:
            total += factor * (given.kinetic + (given.static - given.kinetic) * blend)
    return total


def _added(
    friction: Friction, load: float, direction: float, speed: float | None, drags: bool
) -> float:
    """Magnitude of the terms that classes have added: what drags, or what is dry (see `_dry`)."""
    total = 0.0
    for term in friction.terms:
        if term.key in Friction.model_fields:
            continue
        parts = [(1.0, term.at_rest())] if speed is None else [
            (speed**power * np.exp(-((speed / velocity) ** exponent)), strength)
            for (power, velocity, exponent), strength in term.rows(friction.stribeck)
            if (power > 0.0) == drags
        ]  # fmt: skip
        for factor, (mu, forward, backward) in parts:
            total += factor * (mu * load + (forward if direction > 0 else backward))
    return float(total)
