"""Friction that builds up over a way before it acts in full (a stop element).

    dz/dt = w / d, kept in [-1, 1],     friction = -z L(|w|, load) - drag(w)

w is the velocity of the coordinate on which friction acts: a joint's, or of a drive that other
joints turn as well the drive's own. L is the law of the scene's entry for the direction of z, so
friction never exceeds it, and d -> 0 is that law itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pinfric.errors import SceneError
from pinfric.model.couples import rate_rows, taking_part
from pinfric.model.drives import Drive
from pinfric.model.friction_terms import Presliding
from pinfric.model.schema import Actuator, Friction

#: Ways of three equal stops of which a gradual build-up consists, their mean 1: the terciles'
#: means of a Gamma(2) distribution, which give the curve of Dahl's law without its creep.
GRADUAL = 0.354, 0.849, 1.797


class Ways(NamedTuple):
    """Ways over which friction builds up, for each coordinate on which it acts.

    Attributes:
        rate: (nc, nv) the coordinate's velocity per unit velocity: of all joints' velocities, then
            of the drives that take part in couples.
        way: (nc,) rad or m; 0: it acts at once.
        gradual: (nc,) bool, whether over three stops (`GRADUAL`).
        of_drive: (na,) coordinate of each drive's gear.
    """

    rate: np.ndarray
    way: np.ndarray
    gradual: np.ndarray
    of_drive: np.ndarray


def ways_of(
    friction: Mapping[str, Friction],
    actuators: Sequence[Actuator],
    drives: Sequence[Drive],
    coordinate: Mapping[str, int],
    nv: int,
    source: str,
) -> Ways:
    """Return the ways of an open chain.

    Args:
        friction, actuators: the scene's entries. drives: of `Scene.drives`.
        coordinate: column of v of each joint that is no follower.
        nv: of the model. source: for messages.

    Raises:
        SceneError: a joint without a coordinate of its own, or two ways of one coordinate.
    """
    coupled = taking_part(drives)
    named = {drive.name: d for d, drive in enumerate(drives)}
    of_drive = np.array([drive.velocity_index for drive in drives], dtype=np.int64)
    of_drive[coupled] = nv + np.arange(len(coupled))
    given: dict[int, tuple[str, Presliding]] = {}

    def give(place: str, at: int, entry: Presliding) -> None:
        before, other = given.setdefault(at, (place, entry))
        if other != entry or (before != place and before.startswith("friction.")):
            raise SceneError(
                f"{source}: {place}: is also given by {before}: friction and gear of one joint "
                "build up over one way; leave one of them out"
            )

    for name, entry in friction.items():
        if entry.presliding is None:
            continue
        place = f"friction.{name}.presliding"
        if name not in coordinate:
            raise SceneError(
                f"{source}: {place}: {name} follows another joint, whose way is its own; give it "
                "there"
            )
        give(place, coordinate[name], entry.presliding)
    for i, actuator in enumerate(actuators):
        gear = actuator.transmission
        if gear is not None and gear.presliding is not None:
            place = f"actuators[{i}].transmission.presliding"
            give(place, int(of_drive[named[actuator.drive_name]]), gear.presliding)
    rate = np.vstack([np.eye(nv), rate_rows(drives, nv)[coupled]])
    way, gradual = np.zeros(len(rate)), np.zeros(len(rate), dtype=bool)
    for at, (_, found) in given.items():
        way[at], gradual[at] = found.way, found.shape == "gradual"
    return Ways(rate, way, gradual, of_drive)


def refuse_presliding(
    friction: Mapping[str, Friction], actuators: Sequence[Actuator], source: str
) -> None:
    """Refuse ways in a mechanism, where friction and reactions are solved together.

    Raises:
        SceneError: names the key.
    """
    places = [f"friction.{name}" for name, entry in friction.items() if entry.presliding]
    places += [
        f"actuators[{i}].transmission"
        for i, actuator in enumerate(actuators)
        if actuator.transmission is not None and actuator.transmission.presliding
    ]
    if places:
        raise SceneError(
            f"{source}: {places[0]}.presliding: friction builds up over a way in open chains with "
            "drives at their joints only, not with loops, cylinders or forces; leave it out"
        )
