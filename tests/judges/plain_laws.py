"""The judge's loads and friction: the formulas of `bearings` and `laws` in plain NumPy."""

import numpy as np
import pinocchio as pin

from pinfric.model.bearings import Ball, Gear, Guide, Linear, LoadTerms, Pin, Seal
from pinfric.model.friction_terms import Coefficients, DirectedCoulombFriction
from pinfric.model.scene import Scene, Site
from pinfric.model.schema import Friction


def plain_displacement(scene: Scene, site: Site, q: np.ndarray) -> float:
    """Return the position of a site on the tree along its axis (rad or m) at q (nq,)."""
    twin = scene.twin()
    return float(twin.ratio[site.joint] * q[twin.q_index[site.joint]] + twin.shift[site.joint])


def plain_normal_load(site: Site, wrench: np.ndarray, displacement: float) -> float:
    """Return one site's normal load by the formulas of `bearings`, written out.

    Args:
        wrench: (6,), parent on child in the child's joint frame.
        displacement: of the child along the axis (m), for guides fixed to the parent.
    """
    forces, constant = _forces(site, wrench, displacement)
    return float(sum(map(np.linalg.norm, forces)) + constant)


def plain_load_terms(site: Site, displacement: float) -> tuple[list[np.ndarray], float]:
    """Return (3, 6) maps B and the constant of the load sum |B w| + constant."""
    columns, constant = _forces(site, np.eye(6), displacement)
    return [column.T for column in columns], float(constant)


#: Vectors linear in the wrench whose lengths add up to the load, and its constant part.
_Forces = tuple[list[np.ndarray], float]


def _forces(site: Site, wrench: np.ndarray, displacement: float) -> _Forces:
    """Weighted contact forces (..., 3) under wrenches (..., 6), and the load's constant."""
    bearing, k = site.friction.bearing, site.axis
    if bearing is None:
        return [], 0.0
    known = "pin", "guide", "linear", "gear", "ball", "seal"
    if bearing.kind not in known:  # that a class has added
        return _by_terms(bearing.terms(), k, wrench, displacement)
    on_parent = getattr(bearing, "on", "child") == "parent"
    middle = getattr(bearing, "offset", 0.0) - (displacement if on_parent else 0.0)
    F = wrench[..., :3]
    M = wrench[..., 3:] + middle * F @ pin.skew(k)  # F @ skew(k) is the cross product of F and k
    F_a, M_a = F @ np.outer(k, k), M @ np.outer(k, k)
    F_r, M_b = F - F_a, M - M_a
    length = getattr(bearing, "length", None)
    couple = np.zeros_like(F) if length is None else M_b @ pin.skew(k) / length
    ends = [F_r] if length is None else [F_r / 2 + couple, F_r / 2 - couple]
    match bearing:
        case Pin():
            radial = [bearing.radius * F for F in ends]
            return [*radial, bearing.thrust_radius * F_a], bearing.radius * bearing.preload
        case Guide():
            roll = [] if bearing.width is None else [2 * M_a / bearing.width]
            return [*ends, *roll], bearing.preload
        case Linear():
            forces = [bearing.radial * F_r, bearing.axial * F_a, bearing.moment * M_b]
            return forces, bearing.preload
        case Gear():
            return [M_a], 0.0
        case Ball():
            return [bearing.radius * F], bearing.radius * bearing.preload
    assert isinstance(bearing, Seal)
    return [F_a], bearing.preload


def _by_terms(terms: LoadTerms, k: np.ndarray, wrench: np.ndarray, displacement: float) -> _Forces:
    turn = pin.Quaternion.FromTwoVectors(k, np.array([0.0, 0.0, 1.0])).toRotationMatrix()
    w = np.concatenate([wrench[..., :3] @ turn.T, wrench[..., 3:] @ turn.T], axis=-1)
    moved = [*terms.moved, *np.zeros((len(terms.maps) - len(terms.moved), 3, 6))]
    forces = [w @ (B + displacement * C).T for B, C in zip(terms.maps, moved, strict=True)]
    return forces, terms.constant


def plain_friction(
    site: Site, velocity: float, load: float, at_rest: bool = False
) -> tuple[float, float]:
    """Return the least and greatest friction of one site (`laws`; paper eq. 20, 21).

    Args:
        velocity: child relative to parent (rad/s or m/s). load: normal load (N m or N).
        at_rest: the site passes through rest beside this sample.
    """
    friction, speed, sign = site.friction, abs(velocity), float(np.sign(velocity))
    rest = (-_dry(friction, load, 1.0, None), _dry(friction, load, -1.0, None))
    drag = sign * _added(friction, load, sign, speed, drags=True)
    if (viscous := friction.viscous) is not None:
        drag += sign * viscous.coefficient * _power(speed, viscous.exponent)
    if speed <= site.law.stick_velocity:
        if rest == (0.0, 0.0) and not any(any(term.at_rest()) for term in friction.terms):
            return -drag, -drag  # no dry friction, so it cannot stick
        return rest[0] - max(drag, 0.0), rest[1] - min(drag, 0.0)
    phi = -sign * _dry(friction, load, sign, speed) - drag
    return (min(rest[0], phi), max(rest[1], phi)) if at_rest else (phi, phi)


def _power(speed: float, power: float) -> float:
    """speed^power; at most 1e-6 (rad/s or m/s) along the chord where it is infinitely steep."""
    return float(speed * max(speed, 1e-6) ** (power - 1.0) if 0 < power < 1 else speed**power)


def _dry(friction: Friction, load: float, direction: float, speed: float | None) -> float:
    """Dry friction's magnitude at a speed; None: at rest, at its limit."""
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
    """Magnitude of drag, or of dry friction (see `_dry`), of terms that classes have added."""
    total = 0.0
    for name, term in friction.named_terms.items():
        if name in Friction.model_fields:
            continue
        parts = (
            [(1.0, term.at_rest())]
            if speed is None
            else [
                (_power(speed, power) * np.exp(-((speed / velocity) ** exponent)), strength)
                for (power, velocity, exponent), strength in term.rows(friction.stribeck)
                if (power > 0.0) == drags
            ]
        )
        for factor, (mu, forward, backward) in parts:
            total += factor * (mu * load + (forward if direction > 0 else backward))
    return float(total)
