"""Masses of a robot whose URDF has none, estimated from what the whole robot weighs.

Torques of nine arms with known masses (Panda, UR3, UR5, UR10, Z1, xArm7, Kinova, SO-100, SO-101) in
the worst posture become 0.73 to 1.81 times as large by hulls, 0.56 to 1.25 times by lengths; the
rms factor is 1.3 in both. Legs and torsos do not share mass like this.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinfric.checking.robot import RobotFacts
from pinfric.errors import RobotError
from pinfric.model.total_mass import DENSE, THIN

#: A branch with so many joints is an arm or a leg.
_LIMB = 3
#: What a link without length and shapes takes of the way along the joints.
_STUB = 0.05


def estimated_masses(facts: RobotFacts, mass: float) -> tuple[dict[str, pin.Inertia], str]:
    """Return link -> its part of a robot's mass (kg), and by what it is shared.

    By the convex hulls of the shapes, with com and inertia of their box. Where shapes are missing
    or hold no such mass, by the length to the next joint: mass per length falls linearly to nothing
    at the tip, m_i = (2 m/L) int (1 - s/L) ds.

    Raises:
        RobotError: links have masses; several arms or legs; nothing has a size.
    """
    if weighed := [name for name, own in facts.masses.items() if own > 0]:
        raise RobotError(
            f"{facts.urdf}: link {weighed[0]} has a mass; only that of a robot without any is "
            "estimated"
        )
    _limbs(facts, facts.root_link)
    shaped = {
        name: extent
        for name, extent in facts.shapes.items()
        if extent.hull > 0 and not facts.oversized(extent)
    }
    moved = [joint.child for joint in facts.joints if joint.type != "fixed"]
    hulls = sum(extent.hull for extent in shaped.values())
    known = sum(any(link in shaped for link in facts.fixed_to(name)) for name in moved)
    if hulls and 2 * known >= len(moved) and THIN <= mass / hulls <= DENSE:
        inertias = {}
        for name, extent in shaped.items():
            mass_of_part, squares = mass * extent.hull / hulls, extent.size**2
            moments = np.diag(mass_of_part / 12 * (squares.sum() - squares))
            inertias[name] = pin.Inertia(mass_of_part, 0.5 * (extent.low + extent.high), moments)
        return inertias, "the hulls of its links' shapes"
    return _by_length(facts, mass), "the lengths of its links, lighter towards the tip"


def _limbs(facts: RobotFacts, link: str) -> list[int]:
    """Number of joints of each branch that leaves a body; refuses several limbs on one body."""
    counts: list[int] = []
    for joint in facts.joints:
        if joint.parent == link:
            beyond = _limbs(facts, joint.child)
            counts += beyond if joint.type == "fixed" else [1 + max(beyond, default=0)]
    if sum(count >= _LIMB for count in counts) > 1:
        raise RobotError(
            f"{facts.urdf}: {link} carries several arms or legs, and the mass of such a robot is "
            "not estimated; give its links an <inertial>"
        )
    return counts


def _by_length(facts: RobotFacts, mass: float) -> dict[str, pin.Inertia]:
    """By lengths along the longest way behind the first joint that moves."""
    steps = {joint.child: joint for joint in facts.joints}

    def length(way: list[str]) -> float:
        return sum(float(np.linalg.norm(steps[x].place[:3, 3])) for x in way)

    ways = [[link for link in way if link not in facts.still] for way in facts.ways]
    way = max(ways, key=lambda links: length(links[1:]))
    steps_to = [steps[link].place[:3, 3] for link in way[1:]]
    total = length(way[1:])
    if total == 0.0:
        raise RobotError(
            f"{facts.urdf}: no link has a length or a shape; its mass is not estimated"
        )
    middles = [0.5 * step for step in steps_to] + [np.zeros(3)]
    lengths = [float(np.linalg.norm(step)) for step in steps_to] + [_STUB * total]
    ends = np.cumsum([0.0, *lengths])
    reach = ends[-1]
    shares = np.diff(2 * ends / reach - (ends / reach) ** 2)
    return {
        link: pin.Inertia(mass * part, com, np.eye(3) * mass * part / 12 * (own**2))
        for link, part, com, own in zip(way, shares, middles, lengths, strict=True)
        if part > 0
    }
