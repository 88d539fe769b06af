"""Friction terms, the parts of a joint's friction: each is a class with keys, checks and rows.

At rest a term is a limit, in motion a sum of rows. Each has a part in proportion to the normal load
c and a part independent of it, separate for forward and backward motion:

    at rest     mu c + (forward or backward)
    in motion   sum_i (mu_i c + (forward or backward)_i) s^power_i exp(-(s / velocity_i)^exponent_i)

with s = |speed|. Rows with a power above 0 vanish at rest and are called drag; the others are dry.
Below `STEEP` a power under 1 is replaced by a straight line, because its slope at rest is infinite.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from typing import Annotated, ClassVar, Literal, NamedTuple, Self, TypeVar

from pydantic import AfterValidator, model_validator

from pinfric.model.entry import Entry, Forms, NonNegative, Positive, key, register, unlikely


class Strength(NamedTuple):
    """Strength of friction: mu c + forward against forward motion, mu c + backward otherwise.

    `mu` is the factor of the normal load; the others are in N m or N.
    """

    mu: float = 0.0
    forward: float = 0.0
    backward: float = 0.0


class Shape(NamedTuple):
    """How a row depends on the speed s: s^power exp(-(s / velocity)^exponent).

    Attributes:
        power: 0 or more; strengths are per (rad/s)^power or (m/s)^power.
        velocity: rad/s or m/s; infinite without decay.
        exponent: 1.
    """

    power: float = 0.0
    velocity: float = math.inf
    exponent: float = 1.0


#: rad/s or m/s: below it a power of the speed less than 1 is replaced by a straight line.
STEEP = 1.0e-6

CONSTANT, LINEAR = Shape(), Shape(power=1.0)

#: A row: its strength, and its dependence on the speed.
Row = tuple[Shape, Strength]


class Stribeck(Entry):
    """The fall from static to kinetic: exp(-(|v|/velocity)^exponent), joint velocity."""

    velocity: Positive = key("at which 1/e of the difference remains", 0.02, "rad/s or m/s")
    exponent: Positive = key("2: Gaussian curve, 1: exponential curve", 2.0, "1", default=2.0)


class Presliding(Entry):
    """How friction builds up after a reversal, as contacts and gears yield before they slip.

        presliding: {way: 0.001, shape: gradual}

    After a full reversal 2 `way` = integral of (1 - z) dq, with z the share of the friction. With
    `sharp`, z rises evenly over twice the way; with `gradual`, over three stops in parallel, as in
    Dahl's law, but without its creep (`notebooks/theory/presliding.md`).
    """

    way: Positive = key("half of the way from full friction to full friction", 0.001, "rad or m")
    shape: Literal["sharp", "gradual"] = key("of the build-up", "gradual", default="sharp")

    def questions(self) -> Iterator[str]:
        """Yield a warning for a way over which no contact or gear yields."""
        yield from unlikely("way", self.way, 0.02, "rad or m")


class FrictionTerm(Entry):
    """One term of a joint's friction: the base class of all terms.

    A subclass with the decorator `friction_term(NAME)` is a key of `friction.<joint>`.

    Attributes:
        coefficients: fields that the term's strength is proportional to.
    """

    coefficients: ClassVar[tuple[str, ...]] = ("coefficient",)

    @abstractmethod
    def rows(self, stribeck: Stribeck | None) -> tuple[Row, ...]:
        """Return the term in motion; without a `stribeck` curve it falls to kinetic by a jump."""

    def at_rest(self) -> Strength:
        """Return the limit at rest, which is at least the sum of the dry rows."""
        return Strength()

    @property
    def directed(self) -> bool:
        """Whether it depends on the direction of motion."""
        strengths = (self.at_rest(), *(strength for _, strength in self.rows(None)))
        return any(strength.forward != strength.backward for strength in strengths)

    def scaled(self, factor: float) -> Self:
        """Return the term `factor` times as strong."""
        return self.model_copy(update={k: factor * getattr(self, k) for k in self.coefficients})

    def without_static(self) -> Self:
        """Return the term with no more friction at rest than in motion."""
        return self


#: The added classes of terms, which are not fields of `schema.Friction`, by their keys.
TERMS: dict[str, type[FrictionTerm]] = {}
_Term = TypeVar("_Term", bound=FrictionTerm)


def friction_term(name: str) -> Callable[[type[_Term]], type[_Term]]:
    """Decorate a class of terms: scene files can then use it as the key `name`.

    Raises:
        SceneError: another class has this name; a class that is run again replaces itself.
    """

    def add(cls: type[_Term]) -> type[_Term]:
        register(TERMS, name, cls)
        return cls

    return add


class Coefficients(Entry):
    """A static and a kinetic value of the same kind of friction."""

    static: NonNegative = key("largest friction of a joint at rest", 6.0, "N m or N")
    kinetic: NonNegative = key("friction in motion, at most `static`", 5.0, "N m or N")

    @model_validator(mode="after")
    def _static_is_the_larger(self) -> Self:
        if self.static < self.kinetic:
            raise ValueError(
                f"static {self.static:g} is less than kinetic {self.kinetic:g}; probably swapped "
                "(friction at rest is at least the friction in motion)"
            )
        return self

    def scaled(self, factor: float) -> Self:
        """Return both values times a factor."""
        both = {"static": factor * self.static, "kinetic": factor * self.kinetic}
        return self.model_copy(update=both)

    def without_static(self) -> Self:
        """Return the pair with the kinetic value also at rest."""
        return self.model_copy(update={"static": self.kinetic})


class LoadFriction(Coefficients, FrictionTerm):
    """Friction in proportion to the bearing's load, mu c (paper eq. 20, 21)."""

    static: NonNegative = key("coefficient of static friction", 0.15, "1")
    kinetic: NonNegative = key("coefficient in motion, at most `static`", 0.1, "1")

    def at_rest(self) -> Strength:
        """See `FrictionTerm.at_rest`."""
        return Strength(mu=self.static)

    def rows(self, stribeck: Stribeck | None) -> tuple[Row, ...]:
        """See `FrictionTerm.rows`."""
        return falling(self.at_rest(), Strength(mu=self.kinetic), stribeck)


class CoulombFriction(Coefficients, FrictionTerm):
    """Friction that does not depend on the load, equal in both directions (N m or N).

    coulomb: 5.0                            # at rest and in motion
    coulomb: {static: 6.0, kinetic: 5.0}
    """

    def at_rest(self) -> Strength:
        """See `FrictionTerm.at_rest`."""
        return Strength(0.0, self.static, self.static)

    def rows(self, stribeck: Stribeck | None) -> tuple[Row, ...]:
        """See `FrictionTerm.rows`."""
        return falling(self.at_rest(), Strength(0.0, self.kinetic, self.kinetic), stribeck)


class DirectedCoulombFriction(FrictionTerm):
    """Coulomb friction that differs by the direction of motion (N m or N)."""

    positive: Coefficients = key(
        "against motion in the joint's positive direction", {"static": 6.0, "kinetic": 5.0}
    )
    negative: Coefficients = key(
        "against motion in the negative direction", {"static": 4.5, "kinetic": 4.0}
    )

    def at_rest(self) -> Strength:
        """See `FrictionTerm.at_rest`."""
        return Strength(0.0, self.positive.static, self.negative.static)

    def rows(self, stribeck: Stribeck | None) -> tuple[Row, ...]:
        """See `FrictionTerm.rows`."""
        kinetic = Strength(0.0, self.positive.kinetic, self.negative.kinetic)
        return falling(self.at_rest(), kinetic, stribeck)

    def scaled(self, factor: float) -> Self:
        """See `FrictionTerm.scaled`."""
        return self._both(self.positive.scaled(factor), self.negative.scaled(factor))

    def without_static(self) -> Self:
        """See `FrictionTerm.without_static`."""
        return self._both(self.positive.without_static(), self.negative.without_static())

    def _both(self, positive: Coefficients, negative: Coefficients) -> Self:
        return self.model_copy(update={"positive": positive, "negative": negative})


def constant_friction(size: float) -> CoulombFriction | None:
    """Return Coulomb friction (N m or N), equal at rest and in motion; None for 0."""
    return CoulombFriction(static=size, kinetic=size) if size > 0 else None


#: Forms of `coulomb` in a file: a number is both static and kinetic; None for 0.
Coulomb = (
    Annotated[
        CoulombFriction | DirectedCoulombFriction,
        Forms(
            CoulombFriction,
            DirectedCoulombFriction,
            Annotated[NonNegative, AfterValidator(constant_friction)],
        ),
    ]
    | None
)


class ViscousFriction(FrictionTerm):
    """Friction that grows with the speed, coefficient |v|^exponent; a number is its coefficient.

    viscous: 3.0                                    # N m s/rad or N s/m
    viscous: {coefficient: 0.4, exponent: 0.667}    # N m (s/rad)^exponent: grease, strain waves
    """

    coefficient: NonNegative = key(
        "friction at 1 rad/s or 1 m/s", 0.4, "N m or N at 1 rad/s or 1 m/s"
    )
    exponent: Positive = key("power of the speed, at most 4", 0.667, "1", le=4.0, default=1.0)

    def rows(self, stribeck: Stribeck | None) -> tuple[Row, ...]:
        """See `FrictionTerm.rows`."""
        return ((Shape(power=self.exponent), Strength(0.0, self.coefficient, self.coefficient)),)


def linear_drag(coefficient: float) -> ViscousFriction | None:
    """Return friction proportional to the speed (N m s/rad or N s/m); None for 0."""
    return ViscousFriction(coefficient=coefficient) if coefficient > 0 else None


#: `ViscousFriction`, also as a number; None for 0.
Viscous = (
    Annotated[
        ViscousFriction,
        Forms(Annotated[NonNegative, AfterValidator(linear_drag)], ViscousFriction),
    ]
    | None
)


def falling(static: Strength, kinetic: Strength, stribeck: Stribeck | None) -> tuple[Row, ...]:
    """Return rows that fall from static to kinetic: kinetic + (static - kinetic) exp(...).

    Without a `stribeck` curve the static strength acts at rest only.
    """
    if stribeck is None:
        return ((CONSTANT, kinetic),)
    excess = Strength(*(s - k for s, k in zip(static, kinetic, strict=True)))
    shape = Shape(0.0, stribeck.velocity, stribeck.exponent)
    return (CONSTANT, kinetic), (shape, excess)
