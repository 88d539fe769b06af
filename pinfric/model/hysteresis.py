"""Comparison of a joint's friction with the hysteresis on the data sheet of its gear.

Friction b behind the spring f causes H = f(b_forward) + f(b_backward) at the output, with the motor
held; friction beyond that acts before the spring, in the gear (`notebooks/theory/elastic.md`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pinfric.model.friction_terms import Strength
from pinfric.model.schema import Actuator, Friction
from pinfric.model.springs import Spring, largest_friction, spring_of

_ARCMIN = np.pi / 180.0 / 60.0
#: Allowed relative difference of rounded figures.
_ROUNDED = 1e-3


class Excess(NamedTuple):
    """A joint whose friction implies more hysteresis than its gear's maker states.

    Attributes:
        place: of the stated figure in the scene file.
        friction: at rest without load behind the spring, the mean of both directions (N m or N).
        most: friction that the stated hysteresis allows.
        implied, stated: full width at zero torque, rad (m).
    """

    place: str
    joint: str
    friction: float
    most: float
    implied: float
    stated: float

    @property
    def text(self) -> str:
        """Both figures and the remedy."""
        implied, stated = self.implied / _ARCMIN, self.stated / _ARCMIN
        return (
            f"{self.stated:.3g} rad ({stated:.2g} arcmin) stated, {self.implied:.3g} rad "
            f"({implied:.2g} arcmin) implied by {self.friction:.4g} N m of friction.{self.joint}: "
            f"at most {self.most:.3g} N m of it can be behind the spring; the rest belongs in "
            "transmission.no_load_torque"
        )


class LongWay(NamedTuple):
    """A way over which friction builds up that exceeds the hysteresis that its gear's maker states.

    Attributes:
        place: of the way in the scene file.
        implied, stated: full width, 2 way, and of the maker, rad (m).
    """

    place: str
    implied: float
    stated: float

    @property
    def text(self) -> str:
        """Both figures and what to look at."""
        implied, stated = self.implied / _ARCMIN, self.stated / _ARCMIN
        return (
            f"friction builds up over {self.implied:.3g} rad ({implied:.2g} arcmin), twice the "
            f"way; the gear's hysteresis is {self.stated:.3g} rad ({stated:.2g} arcmin): part of "
            "the way is play, or the sensor's, or one of them is wrong"
        )


def load_free_friction(friction: Friction | None) -> Strength:
    """Return the friction at rest without load, in both directions (N m or N)."""
    terms = [] if friction is None else [term.at_rest() for term in friction.terms]
    return Strength(0.0, sum(x.forward for x in terms), sum(x.backward for x in terms))


def joint_hysteresis(spring: Spring, friction: Friction | None) -> float:
    """Return f(b_forward) + f(b_backward), rad (m): hysteresis due to friction at zero torque."""
    rubs = load_free_friction(friction)
    return float(spring.wind_up(rubs.forward) + spring.wind_up(rubs.backward))


def contradictions(
    friction: Mapping[str, Friction], actuators: Sequence[Actuator] | None
) -> Iterator[Excess | LongWay]:
    """Yield what contradicts the hysteresis of gears: friction, and ways of its build-up."""
    yield from excessive_friction(friction, actuators)
    for i, actuator in enumerate(actuators or ()):
        gear, entry = actuator.transmission, friction.get(actuator.joint or "")
        if gear is None or gear.hysteresis is None:
            continue
        places = {f"actuators[{i}].transmission": gear.presliding}
        if entry is not None:
            places[f"friction.{actuator.joint}"] = entry.presliding
        for place, found in places.items():
            if found is not None and 2.0 * found.way > (1.0 + _ROUNDED) * gear.hysteresis:
                yield LongWay(f"{place}.presliding.way", 2.0 * found.way, gear.hysteresis)


def excessive_friction(
    friction: Mapping[str, Friction], actuators: Sequence[Actuator] | None
) -> Iterator[Excess]:
    """Yield the joints whose friction contradicts the hysteresis of their gear.

    Coupled drives are left out, because the friction of several joints acts on their springs.
    """
    coupled = {name for a in actuators or () for name in (a.couples and {*a.couples, a.joint})}
    for i, actuator in enumerate(actuators or ()):
        gear, joint = actuator.transmission, actuator.joint
        if gear is None or gear.stiffness is None or gear.hysteresis is None:
            continue
        if joint is None or joint in coupled:
            continue
        spring = spring_of(gear.stiffness)
        implied = joint_hysteresis(spring, friction.get(joint))
        if implied > (1.0 + _ROUNDED) * gear.hysteresis:
            rubs = load_free_friction(friction.get(joint))
            most = largest_friction(spring, gear.hysteresis)
            mean = 0.5 * (rubs.forward + rubs.backward)
            place = f"actuators[{i}].transmission.hysteresis"
            yield Excess(place, joint, mean, most, implied, gear.hysteresis)
