"""Implausible values of a scene: bearings, coefficients, payloads, drives, positions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pinocchio as pin

from pinfric.checking.findings import Finding, note, warning
from pinfric.checking.robot import BEYOND, RobotFacts
from pinfric.elastic.motion import unloaded_frequency
from pinfric.errors import PinfricError
from pinfric.model.coordinates import is_sliding
from pinfric.model.entry import USUALLY, place, questions_below
from pinfric.model.friction_terms import (
    Coefficients,
    CoulombFriction,
    DirectedCoulombFriction,
    FrictionTerm,
)
from pinfric.model.hysteresis import contradictions
from pinfric.model.massless import massless_joints
from pinfric.model.mistaken_units import (
    ANGLES,
    LENGTHS,
    MASSES,
    ROTOR_INERTIAS,
    in_unit,
    likely_unit,
)
from pinfric.model.mobility import loose_bodies
from pinfric.model.robot import length_of, link_frame, payload_inertia, plausible_distance
from pinfric.model.scene import Scene, Site
from pinfric.model.transmission import Transmission
from pinfric.motions.joint_columns import stated_limit
from pinfric.motions.rating import holding_efforts

#: A bearing's radius over half the diagonal of the larger of the links it joins.
_BEARING_OVER_LINK = 1.0
#: Coefficients of rolling bearings are near 0.002, of plain ones between 0.03 and 0.6.
_ROLLING, _PLAIN = 0.03, 1.0
#: A payload is rarely heavier than so many times the robot that carries it.
_PAYLOAD = 2.0
#: A rotor's inertia at its joint over the largest inertia that any joint moves.
_ROTOR = 30.0
#: What is said of joints that move no mass.
_NO_MASS = "friction there has no load, and no drive is sized; give the links an <inertial>"
#: Hz between which the lowest natural frequencies of robots lie.
_FREQUENCIES = 3.0, 200.0


def scene_findings(
    scene: Scene, facts: RobotFacts | None, meshes: bool = True
) -> Iterator[Finding]:
    """Yield findings on a scene without its robot.

    `facts`: its URDF, if it has one. Without `meshes` also what takes long to compute is left out.
    """
    findings: list[Finding] = []
    for site in scene.sites:
        findings += [*(_bearing(site, facts) if meshes else ()), *_coefficients(site, scene)]
    findings += [*payload_findings(scene), *_positions(scene, facts), *_drives(scene)]
    findings += _loose(scene)
    findings += [*_held(scene), *_elastic_gears(scene)] if meshes else ()
    yield from findings
    # The schema's own questions, but of places that are known already
    places = {finding.place for finding in findings}
    entries = {
        "friction": scene.friction,
        "robot.payloads": scene.payloads,
        "actuators": scene.actuators or (),
    }
    for section, below in entries.items():
        listed = dict(below) if isinstance(below, Mapping) else below
        for path, text in questions_below(listed, (section,)):
            key, sign, rest = text.partition(" = ")
            if sign and USUALLY in rest and (asked := f"{place(path)}.{key}") not in places:
                yield warning("question", asked, rest, "")


def _bearing(site: Site, facts: RobotFacts | None) -> Iterator[Finding]:
    """A bearing larger than the links it joins."""
    bearing = site.friction.bearing
    if bearing is None or facts is None or site.pair >= 0:
        return
    joint = next(j for j in facts.joints if j.name == site.name)
    links = {*facts.fixed_to(joint.parent), *facts.fixed_to(joint.child)}
    sizes = [facts.extents[link].diagonal for link in links if link in facts.extents]
    largest = max(sizes, default=2.0 * BEYOND * facts.length)
    for key in bearing.sizes:
        value = getattr(bearing, key)
        most = _BEARING_OVER_LINK * largest * (0.5 if "radius" in key else 1.0)
        if value is None or most <= 0 or value <= most:
            continue
        unit = likely_unit(LENGTHS, _below(value, most))
        yield warning(
            "bearing",
            f"friction.{site.name}.bearing.{key}",
            f"{value:g} m",
            f"the links it joins are {largest:.3g} m large",
            in_unit(unit, "m", value),
            value / most,
        )


def _coefficients(site: Site, scene: Scene) -> Iterator[Finding]:
    friction, place = site.friction, f"friction.{site.name}"
    rolling = friction.bearing is not None and friction.bearing.rolling
    if friction.mu is not None:
        most = _ROLLING if rolling else _PLAIN
        what = (
            "rolling bearings have 0.001 to 0.005"
            if rolling
            else ("plain bearings have 0.03 to 0.6")
        )
        if friction.mu.static > most:
            yield warning(
                "coefficient",
                f"{place}.mu.static",
                f"{friction.mu.static:g}",
                what,
                excess=friction.mu.static / most,
            )
    effort, speed = _limits_of(site, scene)
    unit = "N" if site.sliding else "N m"
    for key, coulomb in _ways(friction.coulomb).items():
        if coulomb.static > effort:
            yield warning(
                "coulomb",
                f"{place}.{key}",
                f"{coulomb.static:g} {unit}",
                f"the joint's effort limit is {effort:g} {unit}: it could not break away",
                excess=coulomb.static / effort,
            )
    if math.isfinite(speed) and (viscous := friction.viscous) is not None:
        drag = viscous.coefficient * speed**viscous.exponent
        if drag > effort:
            per = "s/m" if site.sliding else "s/rad"
            per = per if viscous.exponent == 1 else f"({per})^{viscous.exponent:g}"
            yield warning(
                "viscous",
                f"{place}.viscous",
                f"{viscous.coefficient:g} {unit} {per}",
                f"{drag:.3g} {unit} at the joint's speed limit, more than its effort limit "
                f"{effort:g} {unit}",
                excess=drag / effort,
            )
    if friction.stribeck is not None and friction.stribeck.velocity > speed:
        yield note(
            "stribeck",
            f"{place}.stribeck.velocity",
            f"{friction.stribeck.velocity:g}",
            f"above the joint's speed limit {speed:g}: friction never falls to the kinetic value",
        )


def _ways(coulomb: FrictionTerm | None) -> dict[str, Coefficients]:
    """Key of a dry friction, or of both its directions -> its coefficients."""
    if isinstance(coulomb, CoulombFriction):
        return {"coulomb": coulomb}
    if isinstance(coulomb, DirectedCoulombFriction):
        return {"coulomb.positive": coulomb.positive, "coulomb.negative": coulomb.negative}
    return {}


def _loose(scene: Scene) -> Iterator[Finding]:
    """Rods between two balls, which turn about their own axis as they like."""
    if scene.linkage is None or not scene.mobility.undriven:
        return
    of = scene.twin(), scene.linkage, scene.drives, scene.start_configuration, scene.source
    for name in loose_bodies(*of):
        yield note(
            "loose link",
            f"joint {name}",
            "what it moves turns freely",
            "no loop holds it and no drive moves it: a motion has to say its turn; a `universal` "
            "in place of one ball holds it",
        )


def _limits_of(site: Site, scene: Scene) -> tuple[float, float]:
    """Effort and speed limit of a site's joint, infinite without one."""
    if site.velocity_index < 0 or site.ratio != 1.0:
        return math.inf, math.inf
    effort = float(scene.model.effortLimit[site.velocity_index])
    speed = float(scene.model.velocityLimit[site.velocity_index])
    return effort if 0 < effort < 1e300 else math.inf, speed if 0 < speed < 1e300 else math.inf


def massless_findings(scene: Scene) -> Iterator[Finding]:
    """Yield one finding on all joints that move no mass, payloads and rotors included."""
    if names := massless_joints(scene, scene.payloads):
        whole = len(names) == scene.model.nv
        place, text = (
            ("robot", "nothing that moves has a mass")
            if whole
            else (f"joint {', '.join(names)}", "moves no mass")
        )
        yield warning("no mass", place, text, _NO_MASS)


def payload_findings(scene: Scene) -> Iterator[Finding]:
    """Yield payloads that are too heavy, far away or wide, or on a link that never moves."""
    moving = sum(inertia.mass for inertia in tuple(scene.model.inertias)[1:])
    length, farthest = length_of(scene.model), plausible_distance(scene.model)
    for name, payload in scene.payloads.items():
        place = f"robot.payloads.{name}"
        frame = scene.model.frames[link_frame(scene.model, payload.link)]
        if frame.parentJoint == 0:
            yield warning(
                "payload",
                f"{place}.link",
                payload.link,
                "this link never moves, so the payload changes no effort; name the tool's link",
            )
        if payload.mass > _PAYLOAD * moving > 0:
            unit = likely_unit(MASSES, _below(payload.mass, 0.5 * moving))
            yield warning(
                "payload",
                f"{place}.mass",
                f"{payload.mass:g} kg",
                f"{moving:.3g} kg of the robot move",
                in_unit(unit, "kg", payload.mass),
                payload.mass / (_PAYLOAD * moving),
            )
        away = float(np.linalg.norm(payload.com))
        if away > farthest:
            unit = likely_unit(LENGTHS, _below(away, 0.5 * length))
            yield warning(
                "payload",
                f"{place}.com",
                f"{away:.3g} m from its link",
                f"the robot is {length:.3g} m long",
                in_unit(unit, "m", away),
                away / length,
            )
        moment = float(np.linalg.eigvalsh(payload_inertia(payload).inertia)[2])
        radius = math.sqrt(max(moment, 0.0) / payload.mass)
        if radius > farthest:
            yield warning(
                "payload",
                f"{place}.inertia",
                f"{moment:.3g} kg m^2 for {payload.mass:g} kg",
                f"radius of gyration {radius:.3g} m; the robot is {length:.3g} m long",
                excess=radius / length,
            )


def _held(scene: Scene) -> Iterator[Finding]:
    """Effort limits below what holds a payload in the joint's worst posture."""
    joints = dict(zip(scene.joint_names, scene.model.joints.tolist()[1:], strict=True))
    limits = {
        name: stated_limit(float(scene.model.effortLimit[joint.idx_v]))
        for name, joint in joints.items()
        if joint.nv == 1
    }
    said = set[str]()
    for payload in scene.payloads:
        try:
            held = holding_efforts(scene, payload, above=limits)
        except PinfricError:  # loops, floating joints, a payload that never moves
            continue
        for name, effort in held.items():
            if effort > (limit := limits[name]) and name not in said:
                said.add(name)
                unit = "N" if is_sliding(joints[name]) else "N m"
                yield warning(
                    "held payload",
                    f"joint {name}",
                    f"effort limit {limit:.4g} {unit}",
                    f"payload {payload} takes {effort:.4g} {unit} at rest in its worst posture, "
                    "without friction: the limit, the payload or a mass is wrong, or the robot "
                    "may not carry it there",
                    excess=effort / limit,
                )


def _positions(scene: Scene, facts: RobotFacts | None) -> Iterator[Finding]:
    """Locked and starting positions against the joints' limits."""
    if facts is None:
        return
    start = scene.simulation.start.q if scene.simulation is not None else {}
    locked = {} if scene.robot is None else scene.robot.locked
    joints = {joint.name: joint for joint in facts.joints}
    for section, positions in (("robot.locked", locked), ("simulation.start.q", start)):
        for name, position in positions.items():
            joint = joints.get(name)
            if joint is None or joint.type == "continuous" or joint.limit is None:
                continue
            low, high = joint.stated("lower"), joint.stated("upper")
            if low == high == 0.0 or low - 1e-6 <= position <= high + 1e-6:
                continue
            sliding = joint.type == "prismatic"
            far = abs(position) > 2.0 * max(abs(low), abs(high))
            units = (LENGTHS if sliding else ANGLES) if far else ()
            unit = likely_unit(units, _below(position, 1.01 * max(abs(low), abs(high))))
            si = "m" if sliding else "rad"
            yield warning(
                "position",
                f"{section}.{name}",
                f"{position:g} {si}",
                f"outside its limits {low:g} to {high:g} {si}",
                in_unit(unit, si, position),
            )


def _drives(scene: Scene) -> Iterator[Finding]:
    """Transmissions against the URDF's ratio, the joint's limit and what the joint moves."""
    model = scene.model
    M = pin.crba(model, model.createData(), scene.start_configuration)
    moved = float(M.diagonal().max())
    ratios = scene.robot.reductions if scene.robot is not None else {}
    for i, actuator in enumerate(scene.actuators or ()):
        transmission, joint = actuator.transmission, actuator.joint
        if transmission is None or joint not in scene.joint_names:
            continue
        if actuator.installed is not None:  # its figures were questioned in its catalogue
            continue
        place = f"actuators[{i}].transmission"
        stated = ratios.get(joint)
        if (
            stated is not None
            and abs(stated) not in (0.0, 1.0)
            and not math.isclose(abs(stated), abs(transmission.ratio), rel_tol=1e-3)
        ):
            yield warning(
                "ratio",
                f"{place}.ratio",
                f"{transmission.ratio:g} at joint {joint}",
                f"the URDF's <transmission> says {stated:g}",
            )
        index = model.joints[model.getJointId(joint)].idx_v
        yield from _losses(transmission, place, joint, float(model.effortLimit[index]))
        rotor = transmission.rotor_inertia * transmission.ratio**2
        if moved > 0 and rotor > _ROTOR * moved:
            unit = likely_unit(ROTOR_INERTIAS, _below(rotor, moved))
            yield warning(
                "rotor",
                f"{place}.rotor_inertia",
                f"{transmission.rotor_inertia:g} kg m^2 at joint {joint}",
                f"{rotor:.3g} kg m^2 at the joint; no joint moves more than {moved:.3g} kg m^2",
                in_unit(unit, "kg m^2", transmission.rotor_inertia),
                rotor / (_ROTOR * moved),
            )


def _elastic_gears(scene: Scene) -> Iterator[Finding]:
    """Hysteresis against friction, and a lowest frequency that no robot has."""
    for excess in contradictions(scene.friction, scene.actuators):
        yield warning(
            "hysteresis",
            excess.place,
            excess.text,
            "",
            excess=excess.implied / excess.stated,
        )
    if not scene.elastic:
        return
    frequency = unloaded_frequency(scene)
    low, high = _FREQUENCIES
    if np.isfinite(frequency) and not low <= frequency <= high:
        small = "too small: stiffness in N m/arcmin, or in N m/deg, entered as N m/rad?"
        large = (
            "too large: stiffness in N mm/rad entered as N m/rad, or converted from arcmin twice?"
        )
        yield warning(
            "frequency",
            "actuators[].transmission.stiffness",
            f"lowest natural frequency {frequency:.3g} Hz, motors held",
            f"robots have {low:g} to {high:g} Hz: {large if frequency > high else small}",
            excess=max(low / frequency, frequency / high),
        )


def _losses(transmission: Transmission, place: str, joint: str, effort: float) -> Iterator[Finding]:
    if (fit := transmission.losses()[0]).error > 0:
        yield note(
            "efficiency",
            f"{place}.efficiency.over_speed",
            f"fitted by a loss {fit.constant:.3g} + {fit.rise:.3g} w^{fit.exponent:.3g}",
            f"error of the efficiencies at most {100 * fit.error:.2g} percentage points",
        )
    if transmission.no_load_torque is None:
        return
    static = max(transmission.no_load_torque.at_rest())
    lost = static * abs(transmission.ratio)
    if 0 < effort < lost:
        yield warning(
            "no-load torque",
            f"{place}.no_load_torque",
            f"{static:g} N m",
            f"{lost:.3g} at joint {joint}, whose effort limit is {effort:.4g}",
            excess=lost / effort,
        )


def _below(value: float, most: float) -> Callable[[float], bool]:
    """Whether a value in a unit of some size stays below `most`."""
    return lambda size: size * abs(value) < most
