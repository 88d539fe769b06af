"""Implausible values of a robot's links: masses, centres of mass, inertias, shapes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from pinfric.checking.findings import Finding, Severity, note, warning
from pinfric.checking.robot import (
    BEYOND,
    COM_OVER_LENGTH,
    GYRATION_OVER_LENGTH,
    SHAPE_OVER_LENGTH,
    LinkFacts,
    RobotFacts,
)
from pinfric.checking.robot_masses import WHOLE, doubted, mass_findings
from pinfric.model.mistaken_units import INERTIAS, LENGTHS, MASSES, Unit, in_unit, likely_unit
from pinfric.model.total_mass import doubted_reach
from pinfric.model.urdf import implausible_body

#: The joints of a robot are no closer (m).
_NEAREST = 5e-3
_FEW = 3
#: One of three links or more that is so many times as heavy as all others: its unit is probably
#: wrong. Of the bundled robots the heaviest link is 1.2 times as heavy as all others.
_OUTWEIGHS = 100.0
#: Outside its shapes by this part of their diagonal, and by so many m: shapes are simplified.
_OUTSIDE, _LEAST_OUTSIDE = 0.25, 0.02
#: Radius of gyration over the distance to the farthest corner (1 if all mass were there), and
#: over the diagonal (0.2 to 0.35 for half of all links): less is a point, not a body.
_WIDE, _NARROW = 1.5, 0.02
#: From so many times that distance on the unit is asked.
_FAR_TOO_WIDE = 30.0
#: Between these a link's radius of gyration over its diagonal is as usual.
_USUAL, _NEARLY = (0.05, 0.8), 0.8
#: kg/m^3 of the box around the shapes: denser than solid tungsten, lighter than any foam.
_DENSEST, _LIGHTEST = 20000.0, 5.0
#: A link that is fixed to heavier ones matters from this part of them on; as a point of mass
#: it may be one of them.
_SHARE, _MAIN = 0.05, 0.5


def link_findings(facts: RobotFacts, meshes: bool = True) -> Iterator[Finding]:
    """Yield findings on the whole robot, then link by link.

    Without `meshes` only errors of links that have shapes.
    """
    whole = list(_whole_robot(facts, meshes))
    yield from whole
    if fixed := facts.fixed_mass:
        first, *others = fixed
        more = f" and {len(others)} more" if others else ""
        yield note(
            "fixed mass",
            "robot",
            f"{sum(fixed.values()):.3g} kg never move (link {first}{more})",
            "fixed to the ground, they load no joint",
        )
    if any(finding.kind == "lengths" for finding in whole):
        return  # every link's size would be judged by the wrong length
    said = any(finding.kind in WHOLE for finding in whole)
    unit = _inertia_unit(facts)
    for link in facts.links:
        if problem := implausible_body(link.mass, link.inertia):
            yield warning("impossible inertia", f"link {link.name}", problem, "", excess=3.0)
        drawn = link.name in facts.drawn
        if drawn and not (meshes or link.suspect):
            continue
        findings: list[Finding | None] = []
        if link.has_shapes and (finding := _shape(link, facts)):
            findings = [finding]
        elif link.mass > 0 and (link.has_shapes or facts.length > 0):
            findings = [_com(link), _large_inertia(link, unit), _small_inertia(link)]
            findings += [_density(link)] if link.has_shapes and not said else []
        for finding in findings:
            if finding and (meshes or not drawn or finding.severity == Severity.ERROR):
                yield finding


def _whole_robot(facts: RobotFacts, meshes: bool) -> Iterator[Finding]:
    if doubt := doubted_reach(facts.reach):
        yield doubted("lengths", doubt)
    elif 0.0 < facts.length < _NEAREST:
        yield warning(
            "lengths",
            "robot",
            f"it is {facts.length:.3g} m long, along its joints",
            "so small a robot is rare; are all lengths 1000 times too small?",
            excess=_NEAREST / facts.length,
        )
    if doubt is None:
        yield from mass_findings(facts, meshes)


def outweighing(masses: Mapping[str, float]) -> Iterator[Finding]:
    """Yield the one body beside which all others count nothing, if there is one.

    `masses`: name -> kg of what moves.
    """
    *others, (name, mass) = sorted(masses.items(), key=lambda item: item[1]) or [("", 0.0)]
    others_mass = sum(other for _, other in others)
    if sum(other > 0.0 for _, other in others) < _FEW - 1 or mass <= _OUTWEIGHS * others_mass:
        return
    unit = likely_unit(MASSES, lambda size: size * mass < 0.1 * _OUTWEIGHS * others_mass)
    yield warning(
        "one heavy link",
        name,
        f"{mass:.4g} kg, all others that move together {others_mass:.3g} kg",
        "such a robot is rare",
        in_unit(unit, "kg", mass),
        mass / (_OUTWEIGHS * others_mass),
    )


def _shape(link: LinkFacts, facts: RobotFacts) -> Finding | None:
    """A mesh in millimetres, as CAD systems export them."""
    size, length = link.extent.diagonal, facts.length
    if length <= 0 or not facts.oversized(link.extent):
        return None
    unit = likely_unit(LENGTHS, lambda factor: factor * size < 3.0 * length)
    hint = f"in {unit.name} (scale {unit.size:g}) {unit.size * size:.3g} m" if unit else ""
    return warning(
        "shape",
        f"link {link.name}",
        f"its shapes are {size:.3g} m large",
        f"the whole robot is {length:.3g} m long",
        hint,
        size / (SHAPE_OVER_LENGTH * length),
    )


def _com(link: LinkFacts) -> Finding | None:
    box = link.extent
    outside, allowed = box.distance(link.com), max(_OUTSIDE * box.diagonal, _LEAST_OUTSIDE)
    if outside <= allowed or link.mass_share < _SHARE:
        return None
    unit = likely_unit(LENGTHS, lambda size: box.distance(size * link.com) <= 0.1 * allowed)
    away = float(np.linalg.norm(link.com))
    if outside <= 3.0 * box.diagonal or away <= COM_OVER_LENGTH * link.robot.length:
        unit = None
    where = f"{away:.3g} m from the link's origin" if away else "at the link's origin"
    where += "" if link.com_given else ", as no <origin> is given"
    size = (
        f"its shapes are {box.diagonal:.3g} m large"
        if link.has_shapes
        else (f"{box.high[0]:.3g} m are {BEYOND:g} times the robot's length")
    )
    return Finding(
        Severity.ERROR if unit else Severity.WARNING,
        "centre of mass",
        f"link {link.name}",
        f"centre of mass {where}",
        f"{outside:.3g} m outside: {size}",
        in_unit(unit, "m", away),
        outside / allowed,
    )


def _inertia_unit(facts: RobotFacts) -> Unit:
    """The likeliest unit that makes about the most of the far too large inertias usual."""
    ratios = [
        radius / link.extent.diagonal
        for link in facts.links
        if link.mass > 0 and link.radius > GYRATION_OVER_LENGTH * facts.length and link.has_shapes
        for _, radius, farthest in [_gyration(link)]
        if radius > _FAR_TOO_WIDE * farthest
    ]
    usual = {unit: sum(_is_usual(ratio, unit) for ratio in ratios) for unit in INERTIAS}
    return next(unit for unit in INERTIAS if usual[unit] >= _NEARLY * max(usual.values()))


def _is_usual(ratio: float, unit: Unit) -> bool:
    """Whether a radius of gyration over a diagonal is usual if the inertia is in a unit."""
    return _USUAL[0] < ratio * math.sqrt(unit.size) < _USUAL[1]


def _large_inertia(link: LinkFacts, common: Unit) -> Finding | None:
    """Radius of gyration sqrt(J/m) against the distance to the farthest corner."""
    moment, radius, farthest = _gyration(link)
    if radius <= _WIDE * farthest or link.inertia_share < _SHARE:
        return None
    far = link.has_shapes and radius > _FAR_TOO_WIDE * farthest
    far = far and radius > GYRATION_OVER_LENGTH * link.robot.length
    unit = common if far and _is_usual(radius / link.extent.diagonal, common) else None
    return Finding(
        Severity.ERROR if unit else Severity.WARNING,
        "large inertia",
        f"link {link.name}",
        f"inertia {moment:.3g} kg m^2 for {link.mass:.3g} kg",
        f"radius of gyration {radius:.3g} m, but {_extends(link, farthest)}",
        in_unit(unit, "kg m^2", moment),
        radius / (_WIDE * farthest),
    )


def _small_inertia(link: LinkFacts) -> Finding | None:
    moment, radius, farthest = _gyration(link)
    least = _NARROW * link.extent.diagonal
    if not link.has_shapes or radius >= least or link.mass_share < _MAIN:
        return None
    return warning(
        "small inertia",
        f"link {link.name}",
        f"inertia {moment if moment > 1e-12 else 0:.3g} kg m^2 for {link.mass:.3g} kg",
        f"a point mass, but {_extends(link, farthest)}",
        excess=min(least / (radius + 1e-9), 10),
    )


def _gyration(link: LinkFacts) -> tuple[float, float, float]:
    """Largest moment (kg m^2), its radius of gyration, and the link's extent (m)."""
    inside = np.clip(link.com, link.extent.low, link.extent.high)
    return link.mass * link.radius**2, link.radius, link.extent.farthest(inside)


def _extends(link: LinkFacts, farthest: float) -> str:
    if link.has_shapes:
        return f"its shapes end {farthest:.3g} m from there"
    return f"the robot is {link.robot.length:.3g} m long"


def _density(link: LinkFacts) -> Finding | None:
    # mass over the volume of the shapes' box (kg/m^3): less than the material's
    density = float(link.mass / np.prod(np.maximum(link.extent.size, 1e-3)))
    density_text = f"{link.mass:.3g} kg in a box of {1e6 * link.mass / density:.3g} cm^3"
    if link.mass_share < _SHARE:
        return None
    if density > _DENSEST:
        unit = likely_unit(MASSES, lambda g: 50.0 < g * density < 3000.0)
        return warning(
            "dense",
            f"link {link.name}",
            density_text,
            f"{density:.3g} kg/m^3 (tungsten: 19300, steel: 7850)",
            in_unit(unit, "kg", link.mass),
            density / _DENSEST,
        )
    if density < _LIGHTEST:
        return warning(
            "light",
            f"link {link.name}",
            density_text,
            f"{density:.2g} kg/m^3 (water: 1000, air: 1.2)",
            excess=_LIGHTEST / density,
        )
    return None
