"""Friction laws: friction of a site as a function of its velocity and normal load.

Sliding (paper eq. 20):     phi = -sign(v) (mu(|v|) c + coulomb(|v|) + drag(|v|))
Sticking (paper eq. 21):    -(mu_s c + coulomb_s+) <= phi <= mu_s c + coulomb_s-
Creeping:                   the same, plus anything from 0 to the drag

mu, coulomb and drag are the sums of rows of the site's terms (`friction_terms`). Forward (v > 0)
the positive Coulomb value acts, backward the negative one. A joint creeps if its speed is not 0 but
at or below the stick velocity; without dry friction it never sticks
(`notebooks/theory/bearings.md`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import NamedTuple

import numpy as np

from pinfric.errors import SceneError
from pinfric.kernels.compiled import inlined_kernel, kernel
from pinfric.model.friction_terms import (
    CONSTANT,
    LINEAR,
    STEEP,
    FrictionTerm,
    Row,
    Shape,
    Strength,
    Stribeck,
)
from pinfric.model.schema import Friction
from pinfric.model.yamlfile import brief


@dataclass(frozen=True)
class FrictionLaw:
    """The numbers of one site's friction law.

    Attributes:
        static: the limits at rest.
        kinetic: the constant part in motion.
        viscous: N m s/rad or N s/m; separate because time steps treat it implicitly.
        rows: the other parts of friction in motion, one row per shape.
        stick_velocity: at or below this speed the site sticks (rad/s or m/s).
    """

    static: Strength
    kinetic: Strength
    viscous: float
    rows: tuple[Row, ...]
    stick_velocity: float

    @property
    def dry(self) -> bool:
        """Whether it can stick: it has friction at rest."""
        return any(strength > 0.0 for strength in self.static)


def friction_law(friction: Friction, default_stick_velocity: float) -> FrictionLaw:
    """Return the law of one scene entry."""
    static, viscous, rows = Strength(), 0.0, {CONSTANT: Strength()}
    for term in friction.terms:
        static = _sum(static, term.at_rest())
        for shape, strength in term.rows(friction.stribeck):
            if shape == LINEAR and strength == (0.0, strength.forward, strength.forward):
                viscous += strength.forward
            else:
                rows[shape] = _sum(rows.get(shape, Strength()), strength)
    stick = friction.stick_velocity
    return FrictionLaw(
        static=static,
        kinetic=rows.pop(CONSTANT),
        viscous=viscous,
        rows=tuple((shape, strength) for shape, strength in rows.items() if any(strength)),
        stick_velocity=default_stick_velocity if stick is None else stick,
    )


def checked_law(friction: Friction, default_stick_velocity: float) -> FrictionLaw:
    """Return the law of one scene entry; refuse terms that return no valid friction."""
    for term in friction.terms:
        _check_term(term, friction.stribeck)
    return friction_law(friction, default_stick_velocity)


def _check_term(term: FrictionTerm, stribeck: Stribeck | None) -> None:
    at_rest, rows, name = term.at_rest(), term.rows(stribeck), type(term).__name__

    def holds(value: object, kind: type[tuple[float, ...]]) -> bool:
        return isinstance(value, kind) and all(isinstance(x, Real) and x >= 0.0 for x in value)

    if not (holds(at_rest, Strength) and max(at_rest) < math.inf):
        raise SceneError(
            f"{name}.at_rest: should return a Strength, finite and not negative; found "
            f"{brief(at_rest)}"
        )
    if not isinstance(rows, tuple | list) or not all(
        isinstance(row, tuple)
        and [*map(holds, row, (Shape, Strength))] == [True, True]
        and max(row[1]) < math.inf
        for row in rows
    ):
        raise SceneError(
            f"{name}.rows: should return pairs (Shape, Strength), finite and not negative; found "
            f"{brief(rows)}"
        )
    dry = Strength()
    for shape, strength in rows:
        dry = _sum(dry, strength) if shape.power == 0.0 else dry
    if any(least > (1.0 + 1e-9) * most for least, most in zip(dry, at_rest, strict=True)):
        raise SceneError(
            f"{name}.at_rest: {brief(at_rest)} is less than its rows without a power of the speed, "
            f"{brief(dry)}: return at least their sum, or a joint that slips could not stop"
        )


def _sum(a: Strength, b: Strength) -> Strength:
    return Strength(*(x + y for x, y in zip(a, b, strict=True)))


class Laws(NamedTuple):
    """The friction laws of all sites, as arrays for kernels.

    Attributes:
        mu_static, mu_kinetic: (ns,) factor of the load at rest, and its constant part in motion.
        coulomb_static, coulomb_kinetic: (ns, 2) the same for friction independent of the load,
            against forward and backward motion (N m or N).
        viscous: (ns,) N m s/rad or N s/m.
        stick_velocity: (ns,) rad/s or m/s.
        row_start, row_end: (ns,) range of the rows of each site.
        mu, coulomb: (nr,), (nr, 2) strength of each row.
        power, velocity, exponent: (nr,) its shape, s^power exp(-(s / velocity)^exponent).
    """

    mu_static: np.ndarray
    mu_kinetic: np.ndarray
    coulomb_static: np.ndarray
    coulomb_kinetic: np.ndarray
    viscous: np.ndarray
    stick_velocity: np.ndarray
    row_start: np.ndarray
    row_end: np.ndarray
    mu: np.ndarray
    coulomb: np.ndarray
    power: np.ndarray
    velocity: np.ndarray
    exponent: np.ndarray

    @property
    def dry(self) -> np.ndarray:
        """(ns,) bool, whether a site can stick."""
        return np.asarray((self.mu_static > 0.0) | (self.coulomb_static > 0.0).any(axis=1))

    @property
    def loaded(self) -> np.ndarray:
        """(ns,) bool, whether a site's friction depends on the load."""
        spans = zip(self.row_start, self.row_end, strict=True)
        more = np.array([self.mu[start:end].any() for start, end in spans], dtype=bool)
        return np.asarray((self.mu_static > 0.0) | (self.mu_kinetic > 0.0) | more)


def law_table(laws: Sequence[FrictionLaw]) -> Laws:
    """Return the laws of all sites as arrays."""
    rows = [row for law in laws for row in law.rows]
    ends = np.cumsum([0, *(len(law.rows) for law in laws)], dtype=np.int64)
    static, kinetic, shapes, strengths = (
        np.array(list(numbers), dtype=float).reshape(-1, 3)
        for numbers in (
            (law.static for law in laws),
            (law.kinetic for law in laws),
            (shape for shape, _ in rows),
            (strength for _, strength in rows),
        )
    )
    return Laws(
        mu_static=static[:, 0].copy(),
        mu_kinetic=kinetic[:, 0].copy(),
        coulomb_static=static[:, 1:].copy(),
        coulomb_kinetic=kinetic[:, 1:].copy(),
        viscous=np.array([law.viscous for law in laws], dtype=float),
        stick_velocity=np.array([law.stick_velocity for law in laws], dtype=float),
        row_start=ends[:-1].copy(),
        row_end=ends[1:].copy(),
        mu=strengths[:, 0].copy(),
        coulomb=strengths[:, 1:].copy(),
        power=shapes[:, 0].copy(),
        velocity=shapes[:, 1].copy(),
        exponent=shapes[:, 2].copy(),
    )


class Law(NamedTuple):
    """A site's law of friction at one velocity; all figures are positive, against the motion.

    Attributes:
        static_mu, static_forward, static_backward: limits at rest: factor of the load, and N m or N
            against forward and backward motion.
        mu, forward, backward: the same in motion, for dry friction, which does not vanish at rest.
        drag_mu, drag: friction that vanishes at rest, against this velocity, without `viscous`.
        drag_mu_slope, drag_slope: their derivatives by the speed, valid above `STEEP`.
        viscous: N m s/rad or N s/m.
    """

    static_mu: float
    static_forward: float
    static_backward: float
    mu: float
    forward: float
    backward: float
    drag_mu: float
    drag: float
    drag_mu_slope: float
    drag_slope: float
    viscous: float


@inlined_kernel
def power_of(speed: float, power: float) -> float:
    """Return speed^power, for powers below 1 with a finite slope at rest (see `friction_terms`)."""
    if power == 1.0:  # twenty times as fast, bit for bit the same
        return speed
    if power < 1.0 and speed < STEEP:
        return speed * STEEP ** (power - 1.0)
    return speed**power


@inlined_kernel
def law_at(laws: Laws, site: int, velocity: float, slopes: bool = False) -> Law:
    """Return a site's law at a velocity: the sums of its rows, s^power exp(-(s / v)^exponent).

    Args:
        velocity: rad/s or m/s; drag acts against it.
        slopes: whether to compute the slopes of drag; else they are 0.
    """
    speed, against = abs(velocity), 0 if velocity > 0.0 else 1
    mu = laws.mu_kinetic[site]
    forward, backward = laws.coulomb_kinetic[site, 0], laws.coulomb_kinetic[site, 1]
    drag_mu, drag, drag_mu_slope, drag_slope = 0.0, 0.0, 0.0, 0.0
    for r in range(laws.row_start[site], laws.row_end[site]):
        shape, decay = 1.0, 0.0
        if laws.velocity[r] < np.inf:
            decay = (speed / laws.velocity[r]) ** laws.exponent[r]
            shape = np.exp(-decay)
        power = laws.power[r]
        if power > 0.0:
            shape *= power_of(speed, power)
            drag_mu += laws.mu[r] * shape
            drag += laws.coulomb[r, against] * shape
            if slopes and speed > 0.0:
                slope = shape * (power - laws.exponent[r] * decay) / speed
                drag_mu_slope += laws.mu[r] * slope
                drag_slope += laws.coulomb[r, against] * slope
        else:
            mu += laws.mu[r] * shape
            forward += laws.coulomb[r, 0] * shape
            backward += laws.coulomb[r, 1] * shape
    return Law(
        laws.mu_static[site],
        laws.coulomb_static[site, 0],
        laws.coulomb_static[site, 1],
        mu,
        forward,
        backward,
        drag_mu,
        drag,
        drag_mu_slope,
        drag_slope,
        laws.viscous[site],
    )


@inlined_kernel
def is_dry(law: Law) -> bool:
    """Whether a site can stick."""
    return law.static_mu > 0.0 or law.static_forward > 0.0 or law.static_backward > 0.0


@inlined_kernel
def laws_of_row(laws: Laws, row: int) -> Laws:
    """Return one row of laws whose strengths have a leading axis: (n, ns) in place of (ns,)."""
    return Laws(
        laws.mu_static[row],
        laws.mu_kinetic[row],
        laws.coulomb_static[row],
        laws.coulomb_kinetic[row],
        laws.viscous[row],
        laws.stick_velocity,
        laws.row_start,
        laws.row_end,
        laws.mu[row],
        laws.coulomb[row],
        laws.power,
        laws.velocity,
        laws.exponent,
    )


@kernel
def friction_bounds(
    velocity: np.ndarray,
    load: np.ndarray,
    laws: Laws,
    at_rest: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    sticking: np.ndarray,
) -> None:
    """Write the least and greatest friction of each site, and whether it sticks.

    Args:
        velocity: (n, ns), child relative to parent (rad/s or m/s).
        load: (n, ns), normal load (N m or N).
        at_rest: (n, ns), True where a velocity crosses zero between samples: the interval at rest
            is then extended to contain the sliding value.
        lower, upper: (n, ns), overwritten: friction of the parent on the child along the joint's
            positive direction; equal where the site slides.
        sticking: (n, ns), overwritten: |velocity| <= stick velocity.
    """
    for i in range(velocity.shape[0]):
        for s in range(laws.viscous.size):
            v, c = velocity[i, s], load[i, s]
            sticks = abs(v) <= laws.stick_velocity[s]
            sticking[i, s] = sticks
            law = law_at(laws, s, v)
            limit_forward = law.static_mu * c + law.static_forward
            limit_backward = law.static_mu * c + law.static_backward
            drag = law.viscous * v + np.copysign(law.drag_mu * c + law.drag, v)
            if sticks:
                dry = is_dry(law)  # else it cannot stick
                lower[i, s] = -limit_forward - (max(drag, 0.0) if dry else drag)
                upper[i, s] = limit_backward - (min(drag, 0.0) if dry else drag)
                continue
            phi = -(law.mu * c + law.forward) if v > 0.0 else law.mu * c + law.backward
            lower[i, s] = upper[i, s] = phi - drag
            if at_rest[i, s]:
                lower[i, s] = min(-limit_forward, phi - drag)
                upper[i, s] = max(limit_backward, phi - drag)
