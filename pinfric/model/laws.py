"""Friction laws: from a site's velocity and normal load to the friction that opposes it.

Sliding (paper eq. 20):     phi = -sign(v) (mu(v) c + coulomb(v)) - viscous v
Sticking (paper eq. 21):    -(mu_s c + coulomb_s+) <= phi <= mu_s c + coulomb_s-
Creeping:                   the same, plus anything from 0 to -viscous v
Stribeck:                   x(v) = x_kinetic + (x_static - x_kinetic) exp(-(|v|/v_s)^exponent)

for x in mu and coulomb alike; without a Stribeck velocity static falls to kinetic in a jump.
Moving forward (v > 0) the positive Coulomb value acts, backwards the negative one. Creeping is at
or below the stick velocity but not at 0: whether the joint moves is not known, so neither is its
drag, and the sliding value just above the stick velocity lies in the interval just below it. A
joint without dry friction has nothing to stick by: its drag is -viscous v at any speed.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from pinfric.model.compiled import kernel
from pinfric.model.schema import Coefficients, Friction

#: Column of `law_table` that others read.
STICK_VELOCITY = 9


@dataclass(frozen=True)
class FrictionLaw:
    """The numbers of one site's friction law.

    Attributes:
        mu_static, mu_kinetic: coefficients of the normal load (1).
        static_positive, kinetic_positive: Coulomb friction against forward motion (N m or N).
        static_negative, kinetic_negative: the same against backward motion.
        viscous: N m s/rad or N s/m.
        stribeck_velocity: rad/s or m/s; 0 for a jump.
        stribeck_exponent: 1.
        stick_velocity: at or below this speed the site sticks (rad/s or m/s).
    """

    mu_static: float = 0.0
    mu_kinetic: float = 0.0
    static_positive: float = 0.0
    kinetic_positive: float = 0.0
    static_negative: float = 0.0
    kinetic_negative: float = 0.0
    viscous: float = 0.0
    stribeck_velocity: float = 0.0
    stribeck_exponent: float = 2.0
    stick_velocity: float = 1e-6


def friction_law(friction: Friction, default_stick_velocity: float) -> FrictionLaw:
    """Return the law of one scene entry."""
    mu, coulomb, stribeck = friction.mu, friction.coulomb, friction.stribeck
    none = Coefficients(static=0.0, kinetic=0.0)
    if coulomb is None or isinstance(coulomb, Coefficients):
        positive = negative = coulomb or none
    else:
        positive, negative = coulomb.positive, coulomb.negative
    stick = friction.stick_velocity
    return FrictionLaw(
        mu_static=mu.static if mu else 0.0,
        mu_kinetic=mu.kinetic if mu else 0.0,
        static_positive=positive.static,
        kinetic_positive=positive.kinetic,
        static_negative=negative.static,
        kinetic_negative=negative.kinetic,
        viscous=friction.viscous,
        stribeck_velocity=stribeck.velocity if stribeck else 0.0,
        stribeck_exponent=stribeck.exponent if stribeck else 2.0,
        stick_velocity=default_stick_velocity if stick is None else stick,
    )


def law_table(laws: list[FrictionLaw]) -> np.ndarray:
    """Return the laws of all sites as one (ns, 10) table for `friction_bounds`."""
    return np.array([astuple(law) for law in laws], dtype=float).reshape(-1, 10)


@kernel
def friction_bounds(
    velocity: np.ndarray,
    load: np.ndarray,
    law: np.ndarray,
    at_rest: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    sticking: np.ndarray,
) -> None:
    """Write the least and greatest friction of each site, and where it sticks.

    Args:
        velocity: (n, ns), child relative to parent (rad/s or m/s).
        load: (n, ns), normal load (N m or N).
        law: (ns, 10), `law_table`.
        at_rest: (n, ns), True where a velocity crosses zero between samples: the interval of
            standstill then encloses the sliding value.
        lower, upper: (n, ns), friction of the parent on the child along the joint's positive
            direction, overwritten; equal where the site slides.
        sticking: (n, ns), overwritten; |velocity| <= stick velocity.
    """
    for i in range(velocity.shape[0]):
        for s in range(law.shape[0]):
            v, c, speed = velocity[i, s], load[i, s], abs(velocity[i, s])
            sticks = speed <= law[s, STICK_VELOCITY]
            sticking[i, s] = sticks
            limit_forward = law[s, 0] * c + law[s, 2]
            limit_backward = law[s, 0] * c + law[s, 4]
            if sticks:
                drag = law[s, 6] * v
                dry = law[s, 0] > 0.0 or law[s, 2] > 0.0 or law[s, 4] > 0.0
                lower[i, s] = -limit_forward - (max(drag, 0.0) if dry else drag)
                upper[i, s] = limit_backward - (min(drag, 0.0) if dry else drag)
                continue
            blend = 0.0
            if law[s, 7] > 0.0:
                blend = np.exp(-((speed / law[s, 7]) ** law[s, 8]))
            mu = law[s, 1] + (law[s, 0] - law[s, 1]) * blend
            if v > 0.0:
                phi = -(mu * c + law[s, 3] + (law[s, 2] - law[s, 3]) * blend) - law[s, 6] * v
            else:
                phi = mu * c + law[s, 5] + (law[s, 4] - law[s, 5]) * blend - law[s, 6] * v
            if at_rest[i, s]:
                lower[i, s], upper[i, s] = min(-limit_forward, phi), max(limit_backward, phi)
            else:
                lower[i, s], upper[i, s] = phi, phi
