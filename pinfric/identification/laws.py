"""Candidate laws of one joint's friction: which columns of the linear model each of them takes.

    friction = c+ [v > 0] - c- [v < 0] + k |v|^p sign v + sign v mu c(w) + gear
    gear = sign v (g+ |x| [x v > 0] + g- |x| [x v < 0]),   g+ = 1/eta - 1,  g- = 1 - eta_b

c+, c- and mu may fall from rest to motion (Stribeck, see stribeck.py). c is the bearing's load,
without a bearing the torque that the joint delivers. x is the rigid effort t (friction on the
motor's side), or t + friction (on the joint's).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

#: Exponents of the speed. Below a half, Coulomb friction and its rest interval dissolve in the
#: speed's term unless slow sliding was logged.
EXPONENTS = (1.0, 0.8, 0.67, 0.5, 0.33)
#: Where a gear's losses are proportional to: load alone, or load with the joint's friction.
SIDES = ("motor", "joint")
DIRECTIONS = ("driving", "driven", "both")

#: Places of one joint's coefficients beside the links': rotor, Coulomb friction by direction,
INERTIA, FORWARD, BACKWARD = range(3)
#: powers of the speed (place -> exponent), the bearing, gears (by side and direction),
SPEEDS = dict(enumerate(EXPONENTS, 3))
BEARING = 3 + len(EXPONENTS)
GEARS = {key: BEARING + 1 + i for i, key in enumerate(product(SIDES, DIRECTIONS))}
#: by how much friction at rest exceeds friction in motion (c+, c-, mu), and the speed at which it
#: has fallen.
STRIBECK_FORWARD, STRIBECK_BACKWARD, STRIBECK_LOAD, STRIBECK_VELOCITY = range(
    BEARING + 7, BEARING + 11
)
SLOTS = range(STRIBECK_VELOCITY + 1)
K = len(SLOTS)
COULOMB, STRIBECK = [FORWARD, BACKWARD], [STRIBECK_FORWARD, STRIBECK_BACKWARD]
#: What each of them adds to at rest.
RESTS_ON = {STRIBECK_FORWARD: FORWARD, STRIBECK_BACKWARD: BACKWARD, STRIBECK_LOAD: BEARING}


@dataclass(frozen=True)
class Law:
    """One joint's friction.

    Attributes:
        coulomb: whether there is constant friction, with a coefficient for each direction.
        exponent: of the speed; None: no such term.
        load: "", "bearing" or "gear".
        side: of a gear's friction, and of a coupled drive's, "motor" or "joint".
        both_ways: whether a gear loses as much driven as driving (eta_b = 2 - 1/eta).
        stribeck: whether Coulomb friction falls from rest to motion.
        load_stribeck: whether the bearing's friction does.
    """

    coulomb: bool = True
    exponent: float | None = 1.0
    load: str = ""
    side: str = "joint"
    both_ways: bool = True
    stribeck: bool = False
    load_stribeck: bool = False

    @property
    def stribeck_slots(self) -> tuple[int, ...]:
        """Places of what falls from rest to motion."""
        return (*STRIBECK * self.stribeck, *[STRIBECK_LOAD] * self.load_stribeck)

    @cached_property
    def slots(self) -> tuple[int, ...]:
        """Its coefficients' places in `SLOTS`."""
        places = COULOMB * self.coulomb + [at for at, p in SPEEDS.items() if p == self.exponent]
        places += [*self.stribeck_slots, *[BEARING] * (self.load == "bearing")]
        if self.load == "gear":
            places += [
                GEARS[self.side, x] for x in (DIRECTIONS[2:] if self.both_ways else DIRECTIONS[:2])
            ]
        return tuple(places)

    @property
    def size(self) -> int:
        """Number of coefficients, the speed at which friction falls among them."""
        return len(self.slots) + bool(self.stribeck_slots)

    def __str__(self) -> str:
        parts = ["Coulomb"] if self.coulomb else []
        parts += ["Stribeck"] if self.stribeck else []
        if self.exponent is not None:
            parts.append("viscous" if self.exponent == 1.0 else f"speed^{self.exponent:g}")
        if self.load == "gear":
            parts.append(
                f"gear {'(one loss)' if self.both_ways else '(two losses)'}, friction on "
                f"the {self.side}'s side"
            )
        elif self.load:
            parts.append("load (falls from rest to motion)" if self.load_stribeck else self.load)
        return " + ".join(parts) or "none"


#: What everything is compared with.
PLAIN = Law()


def candidates(
    bearing: bool,
    gear: bool,
    both_directions: bool,
    stribeck: bool = False,
    load_stribeck: bool = False,
) -> tuple[Law, ...]:
    """Return the laws that a joint's data can distinguish.

    Args:
        bearing: the scene gives the joint a bearing.
        gear: the effort passes a gear, and load varies enough beside Coulomb friction.
        both_directions: the load both drives the motion and is driven by it often enough.
        stribeck: friction at low speed exceeds Coulomb and viscous friction, on the joint's side,
            where a scene can state it.
        load_stribeck: this excess grows with the load.
    """
    loads = [Law()]
    if bearing:
        loads.append(Law(load="bearing"))
    for side in SIDES if gear else ():
        loads.append(Law(load="gear", side=side))
        if both_directions:
            loads.append(Law(load="gear", side=side, both_ways=False))
    smooth = [replace(law, exponent=p) for law in loads for p in (None, *EXPONENTS)]
    stribeck_laws = [
        replace(law, exponent=p, stribeck=True)
        for law in loads
        for p in (None, 1.0)
        if stribeck and law.side == "joint"
    ]
    carried = [
        Law(exponent=p, load="bearing", stribeck=also, load_stribeck=True)
        for p in (None, 1.0)
        for also in (False, True)
        if load_stribeck
    ]
    return (*smooth, *stribeck_laws, *carried)
