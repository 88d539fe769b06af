"""Whether links can hold the drives that a scene says, or leaves open, that they hold.

A URDF does not tell whether its masses are those of bare links. But no link is lighter than the
drives in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pinfric.drives.robot import carried, holders
from pinfric.model.scene import Scene

#: Parts of the mass of all moving links, and of those beyond a joint, that drives may have before
#: it is asked: the xArm7 has 0.60, UR3 0.65 beyond a joint, Kinova's j2s6s200 0.51 by its own.
_OF_ALL, _OF_BRANCH = 0.65, 0.75
#: Drives over the mass of all moving links, where these are bare: a light arm has 1 to 2.
_OF_BARE = 10.0


class Held(NamedTuple):
    """Drives that some links hold.

    Attributes:
        joint: the links are those beyond it; "": all that move.
        drives, links: masses, kg.
    """

    joint: str
    drives: float
    links: float

    @property
    def share(self) -> float:
        """Of the drives in the links' mass."""
        if self.drives == 0.0:
            return 0.0
        return self.drives / self.links if self.links > 0.0 else np.inf

    @property
    def where(self) -> str:
        """The links in words."""
        return f"the links beyond {self.joint}" if self.joint else "all moving links"


def held_drives(
    scene: Scene, masses: Mapping[int, float | None], known: Mapping[str, float]
) -> list[Held]:
    """Return the mass of drives in all moving links, then in those beyond each joint.

    A drive is held by its joint's parent link. Whole branches are compared: identified parameters
    move mass between neighbouring links.

    Args:
        scene: whose `masses` says which drives its links hold.
        masses: of drives, kg, by their columns; None: not known, counts as 0.
        known: drives of which is said what is there (`mass_in_urdf`), left out.
    """
    model = scene.model
    inside = [
        (link, share * (mass or 0.0))
        for i, mass in masses.items()
        if scene.masses_hold[i] and scene.actuator_names[i] not in known
        for link, _, share in holders(scene, i)
    ]
    branches = {str(model.names[j]): set(model.subtrees[j]) for j in range(1, model.njoints)}
    held = []
    for name, links in {"": set(range(1, model.njoints)), **branches}.items():
        drives = sum(mass for link, mass in inside if link in links)
        held.append(Held(name, drives, float(sum(model.inertias[j].mass for j in links))))
    return held


def doubted_masses(held: list[Held]) -> str:
    """Question links of whose mass the drives would be too much; else ""."""
    whole, worst = held[0], max(held, key=lambda one: one.share)
    doubted = worst if worst.share >= _OF_BRANCH else whole if whole.share >= _OF_ALL else None
    if doubted is None:
        return ""
    share = f"{doubted.share:.0%} of" if doubted.links > 0.0 else "more than"
    return (
        f"drives would be {share} the mass of {doubted.where}, {doubted.drives:.3g} of "
        f"{doubted.links:.3g} kg: do the links really hold them (`robot.masses`)?"
    )


def refuted_masses(
    scene: Scene, masses: Mapping[int, float | None], known: Mapping[str, float]
) -> str:
    """Say that moving links are too light for drives that they are not said to hold; else "".

    Where the scene leaves open whether the links hold drives that outweigh them, they would have to
    be bare, which is a guess. Bare links are doubted from ten times their mass on.

    Args:
        scene, masses, known: see `held_drives`.
    """
    names, holds = scene.actuator_names, scene.masses_hold
    added = [i for i in masses if not holds[i] and carried(scene, i) and names[i] not in known]
    drives = sum(masses[i] or 0.0 for i in added)
    links = float(sum(body.mass for body in tuple(scene.model.inertias)[1:]))
    if drives > _OF_BARE * links:
        return (
            f"robot.masses: moving links of {links:.3g} kg would carry {drives:.3g} kg of drives, "
            "as no robot does: correct the masses"
        )
    if drives > links and any(holds[i] is None for i in added):
        return (
            f"robot.masses is not written: moving links of {links:.3g} kg cannot hold "
            f"{drives:.3g} kg of drives: write `without_drives` if they are bare, else correct the "
            "masses"
        )
    return ""
