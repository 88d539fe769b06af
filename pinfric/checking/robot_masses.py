"""Implausible masses of a robot as a whole: one finding for all links, with the unit it explains.

Thresholds are those of 484 public URDFs and the printed masses of about 100 robots: no rule
contradicts a maker's masses, but for some hands and legs. What needs no file is in
`model.total_mass`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from pinfric.checking.findings import Finding, Severity, error, note, warning
from pinfric.checking.joint_loads import held_out_level
from pinfric.checking.robot import LinkFacts, RobotFacts
from pinfric.model.total_mass import (
    MassDoubt,
    doubted_reach,
    doubted_total,
    is_usual,
    shown_density,
)

#: The links whose shapes are measured hold at least so much of the mass that moves.
_SHAPED = 0.7
#: Links with mass on one way from root to tip, and the share of them with the same mass.
_ON_ONE_WAY, _EQUAL = 5, 0.75
#: Parts with closed meshes, the share of one density, and how near: within 1 %. Two parts of one
#: volume within 2 % are one part, used twice.
_PARTS, _ONE_DENSITY, _NEAR, _COPY = 4, 0.75, 0.01, 0.02
#: Links with the same inertia about every axis, which hold so much of the moving mass.
_ISOTROPIC, _HELD, _SAME = 3, 0.5, 1e-6
#: Kinds of findings after which the masses of single links say nothing more.
WHOLE = ("no mass", "masses", "equal masses")


#: Of a robot without any mass.
NO_MASS = error(
    "no mass",
    "robot",
    "nothing in this robot has mass",
    "its efforts are those of friction alone, and no drive can be sized",
    excess=1e6,
)


def mass_findings(facts: RobotFacts, meshes: bool = True) -> Iterator[Finding]:
    """Yield at most one finding of each kind on all masses of a robot; see `link_findings`."""
    if not any(facts.masses.values()):
        yield NO_MASS
        return
    if doubt := _by_size(facts, meshes):
        yield doubted("masses", doubt)
    yield from _equal_masses(facts)
    if meshes:
        yield from _one_density(facts)
    yield from _equal_inertias(facts.links)


def believed_weight(facts: RobotFacts, model: pin.Model) -> float | None:
    """Return the torque (N m) that holds the robot level; None: its masses are doubtful."""
    total = sum(facts.masses.values())
    if total == 0.0 or doubted_reach(facts.reach) or _by_size(facts):
        return None
    return held_out_level(total, facts.reach, model)


def doubted(kind: str, doubt: MassDoubt) -> Finding:
    """Return a doubt of a whole robot as a finding; drives of a robot too light are not signed."""
    severity = Severity.ERROR if doubt.impossible else Severity.WARNING
    said = doubt.found, doubt.why, doubt.if_unit, doubt.excess
    return Finding(severity, kind, "robot", *said, unsigned=doubt.light)


def _by_size(facts: RobotFacts, meshes: bool = True) -> MassDoubt | None:
    """By the way along the joints, and by the shapes' convex hulls.

    Without meshes hulls can only be an error, where the way leaves the mass open.
    """
    moving = sum(link.mass for link in facts.links)
    total = moving + sum(facts.fixed_mass.values())
    given = moving, total, facts.reach, facts.moving_joints
    by_reach = doubted_total(*given)
    if not meshes and (is_usual(*given) or (by_reach and by_reach.impossible)):
        return by_reach
    shaped = [
        link
        for link in facts.links
        if link.has_shapes and link.extent.hull > 0 and not facts.oversized(link.extent)
    ]
    held, hulls = sum(x.mass for x in shaped), sum(x.extent.hull for x in shaped)
    density = held / hulls if hulls and held >= _SHAPED * moving > 0 else None
    doubt = doubted_total(*given, density)
    return doubt if meshes or (doubt and doubt.impossible) else by_reach


def _equal_masses(facts: RobotFacts) -> Iterator[Finding]:
    """On one way from root to tip: equal legs and fingers are on several."""
    masses = {link.name: link.mass for link in facts.links if link.mass > 0}
    for way in facts.ways:
        on_it = [masses[name] for name in way if name in masses]
        if len(on_it) < _ON_ONE_WAY:
            continue
        (mass, count), *_ = Counter(on_it).most_common(1)
        if count >= _EQUAL * len(on_it):
            yield warning(
                "equal masses",
                "robot",
                f"{count} of {len(on_it)} links on the way to {way[-1]} weigh {mass:g} kg",
                "placeholders, no masses of a robot",
                excess=float(count),
            )
            return


def _one_density(facts: RobotFacts) -> Iterator[Finding]:
    """Of all visuals, of all collision shapes, or of either of each link: they are drawings."""
    for kinds in ((0,), (1,), (0, 1)):
        solids, densities = list[tuple[float, ...]](), list[np.ndarray]()
        for link in facts.links:
            of = link.extent.solids if link.has_shapes and link.mass > 0 else (0.0, 0.0)
            own = tuple(of[kind] for kind in kinds)
            pairs = [pair for other in solids for pair in zip(own, other, strict=True)]
            if any(own) and not any(a and abs(b - a) <= _COPY * a for a, b in pairs):
                solids.append(own)
                densities.append(link.mass / np.array([volume for volume in own if volume]))
        if len(densities) < _PARTS:
            continue
        near, density = max(
            (_alike(one, densities) for one in np.concatenate(densities)), key=lambda x: x[0]
        )
        if near < _ONE_DENSITY * len(densities):
            continue
        whole = near == len(densities)
        each = "all links have" if whole else f"{near} of {len(densities)} links have"
        yield note(
            "one density",
            "robot",
            f"{each} {shown_density(density)} kg/m^3 of their meshes",
            "computed from the drawing, not weighed: real arms of such a kind weigh 1.5 to 2.3 "
            "times as much",
            excess=near / len(densities),
        )
        return


def _alike(density: float, densities: Sequence[np.ndarray]) -> tuple[int, float]:
    """How many links have a density (kg/m^3) as one of theirs, and the median of these."""
    of = [float(own[np.abs(own / density - 1.0).argmin()]) for own in densities]
    near = [x for x in of if abs(x / density - 1.0) <= _NEAR]
    return len(near), float(np.median(near))


def _equal_inertias(links: Sequence[LinkFacts]) -> Iterator[Finding]:
    by_moment: dict[float, list[LinkFacts]] = {}
    for link in links:
        moment = float(link.inertia[0, 0])
        if moment > 0 and np.abs(link.inertia - moment * np.eye(3)).max() <= _SAME * moment:
            key = next((m for m in by_moment if abs(m - moment) <= _SAME * m), moment)
            by_moment.setdefault(key, []).append(link)
    mass = sum(link.mass for link in links)
    for moment, alike in by_moment.items():
        if len(alike) >= _ISOTROPIC and sum(link.mass for link in alike) >= _HELD * mass > 0:
            yield warning(
                "equal inertias",
                "robot",
                f"{len(alike)} links have the inertia {moment:g} kg m^2 about every axis",
                "a placeholder",
                excess=float(len(alike)),
            )
