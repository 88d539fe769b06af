"""MJCF, MuJoCo's format, from a robot's bodies; written without MuJoCo."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.errors import one_line
from pinfric.exporting.tree import MovedBody
from pinfric.model.spring_entries import TensionSpring
from pinfric.model.spring_forces import Springs

#: Dry friction of joints as hard and as quick as a step of 1 ms lets MuJoCo have it. By default it
#: follows a + 100 v, not v: of the wrong sign while a joint brakes.
HARD_FRICTION = {"solreffriction": "0.002 1", "solimpfriction": "0.9999 0.9999"}
#: Of these: b = 2/(d_max x time constant), 1/s, and (1 - d)/d of the constraint's impedance d.
_PULL, _YIELD = 2.0 / (0.9999 * 0.002), (1.0 - 0.9999) / 0.9999
TIMESTEP = 1e-3
#: How hard and quick a follower's equation is: at a step of 1 ms its gap stays within 1e-6 rad.
_FOLLOWS = {"solref": "0.004 1", "solimp": "0.9999 0.9999 0.001"}
#: Least mass (kg) and moments of inertia (kg m^2) of a body: MuJoCo refuses links without any.
_LEAST_MASS, _LEAST_INERTIA = 1e-9, 1e-12
#: Radius (m) of the capsules that stand for the links.
_RADIUS = 0.02


@dataclass(frozen=True)
class MjcfJoint:
    """One joint in MuJoCo.

    Attributes:
        frictionloss: dry friction (N m or N).
        damping: N m s/rad or N s/m.
        armature: kg m^2 or kg.
        gear: motor turns per turn of the joint; None: no actuator.
        comment: written beside the joint; empty for none.
        fixed: the body has no joint, and stands where the joint is at 0.
    """

    frictionloss: float
    damping: float
    armature: float
    gear: float | None = None
    comment: str = ""
    fixed: bool = False


def soft(
    velocity: np.ndarray, acceleration: np.ndarray, frictionloss: float, mobility: float
) -> np.ndarray:
    """Return (T,) where MuJoCo's dry friction is not f sign(v).

    It is a soft constraint and follows a + b v in place of v: it is not whole where
    |a + b v| < (1 - d)/d f A, and against -v where v and a have opposite signs and |v| < |a|/b.

    Args:
        velocity, acceleration: (T,) of the joint. frictionloss: f.
        mobility: A, the joint's diagonal entry of (M + armature)^-1 at q = 0.

    Source: MuJoCo documentation, Computation: constraint model, solref and solimp.
    """
    pull = acceleration + _PULL * velocity
    reached: np.ndarray = np.abs(pull) < _YIELD * frictionloss * mobility
    return reached | (pull * velocity < 0.0)


def creep_velocity(frictionloss: float, mobility: float) -> float:
    """Return the speed v (rad/s or m/s) at which a joint yields to its frictionloss.

    b v = (1 - d)/d f A, see `soft`.
    """
    return _YIELD * frictionloss * mobility / _PULL


def mjcf(
    name: str,
    bodies: Sequence[MovedBody],
    joints: Sequence[MjcfJoint],
    gravity: np.ndarray,
    *,
    timestep: float = TIMESTEP,
    friction: Mapping[str, str] = HARD_FRICTION,
    limits: bool = True,
    comment: Sequence[str] = (),
    springs: Springs | None = None,
) -> str:
    """Return a robot as MJCF: bodies with their masses, joints with limits, frames, motors.

    Springs in joints are their `stiffness` and `springref`, tension springs are spatial tendons.

    Args:
        bodies: parents before children.
        joints: one per body.
        gravity: (3,) m/s^2.
        timestep: s.
        friction: attributes of all joints that set the solver of MuJoCo's friction constraint.
        springs: of the scene; those that MuJoCo cannot hold exactly are left out.
    """
    root = ElementTree.Element("mujoco", model=name)
    root.extend(xml_comment(line) for line in comment)
    _add(
        root,
        "compiler",
        angle="radian",
        autolimits="true",
        inertiafromgeom="false",
        boundmass=_number(_LEAST_MASS),
        boundinertia=_number(_LEAST_INERTIA),
    )
    option = _add(
        root,
        "option",
        gravity=numbers(gravity),
        timestep=_number(timestep),
        integrator="implicitfast",
    )
    if not limits:
        _add(option, "flag", limit="disable")
    default = _add(root, "default")
    _add(default, "joint", **friction)
    world = _add(root, "worldbody")
    elements = {-1: world}
    for row, (body, joint) in enumerate(zip(bodies, joints, strict=True)):
        elements[row] = _add_body(elements[body.parent], body, joint)
        element = elements[row].find("joint")
        if element is not None and springs is not None and (coil := springs.in_joint(row)):
            element.set("stiffness", _number(coil[0]))
            element.set("springref", _number(coil[1]))
        if body.parent >= 0:
            _add_capsule(elements[body.parent], body.placement.translation)
    pairs = zip(bodies, joints, strict=True)
    following = {b.joint.name: b.follows for b, j in pairs if b.follows is not None and not j.fixed}
    equations = _add(root, "equality") if following else root
    for follower, (leader, ratio, shift) in following.items():
        law = numbers([shift, ratio, 0.0, 0.0, 0.0])
        _add(equations, "joint", joint1=follower, joint2=leader, polycoef=law, **_FOLLOWS)
    if springs is not None:
        _add_tendons(root, elements, springs)
    motors = [(b.joint.name, j.gear) for b, j in zip(bodies, joints, strict=True)]
    if any(gear is not None for _, gear in motors):
        actuator = _add(root, "actuator")
        for joint_name, gear in motors:
            if gear is not None:
                _add(actuator, "motor", name=joint_name, joint=joint_name, gear=_number(gear))
    return xml_text(root)


def _add_body(
    parent: ElementTree.Element, body: MovedBody, joint: MjcfJoint
) -> ElementTree.Element:
    element = _add(parent, "body", name=body.link, **_place(body.placement))
    # Raised until it obeys the triangle inequality despite rounding
    inertia = body.inertia.inertia
    principal = np.linalg.eigvalsh(inertia)
    lacking = max(principal[2] - principal[0] - principal[1], _LEAST_INERTIA - principal[0], 0.0)
    rounding = 1e-12 * principal[2]
    if principal[2] - principal[0] - principal[1] >= -rounding:
        inertia = inertia + (lacking + rounding) * np.eye(3)
    moments = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    _add(
        element,
        "inertial",
        pos=numbers(body.inertia.lever),
        mass=_number(body.inertia.mass),
        fullinertia=numbers(moments),
    )
    if joint.comment:
        element.append(xml_comment(joint.comment))
    if joint.fixed:
        return _with_sites(element, body)
    limits = {}
    if np.isfinite([body.joint.lower, body.joint.upper]).all():
        limits["range"] = numbers([body.joint.lower, body.joint.upper])
    if np.isfinite(body.effort_limit):
        limits["actuatorfrcrange"] = numbers([-body.effort_limit, body.effort_limit])
    _add(
        element,
        "joint",
        name=body.joint.name,
        axis=numbers(body.axis),
        type="slide" if body.joint.unit == "m" else "hinge",
        frictionloss=_number(joint.frictionloss),
        damping=_number(joint.damping),
        armature=_number(joint.armature),
        **limits,
    )
    return _with_sites(element, body)


def _add_tendons(
    root: ElementTree.Element, elements: Mapping[int, ElementTree.Element], springs: Springs
) -> None:
    """Tension springs as tendons between sites; slack ones without force below the free length."""
    tensions = [
        (line, ends, points)
        for line, ends, points in zip(springs.lines, springs.ends, springs.points, strict=True)
        if isinstance(line, TensionSpring) and not line.initial_tension
    ]
    tendons = _add(root, "tendon") if tensions else root
    for line, ends, points in tensions:
        length = _number(line.free_length)
        spring_length = length if line.pushes else f"0 {length}"
        stiffness = _number(line.stiffness)
        tendon = _add(
            tendons, "spatial", name=line.name, stiffness=stiffness, springlength=spring_length
        )
        for side, end, point in zip("ab", ends, points, strict=True):
            site = f"{line.name}_{side}"
            _add(elements[int(end)], "site", name=site, pos=numbers(point))
            _add(tendon, "site", site=site)


def _with_sites(element: ElementTree.Element, body: MovedBody) -> ElementTree.Element:
    for name, placement in body.frames.items():
        _add(element, "site", name=name, **_place(placement))
    return element


def _add_capsule(element: ElementTree.Element, to: np.ndarray) -> None:
    """Draw from a body's joint to the next, without mass and contact."""
    if np.linalg.norm(to) > _RADIUS:
        _add(
            element,
            "geom",
            type="capsule",
            size=_number(_RADIUS),
            fromto=numbers([0, 0, 0, *to]),
            mass="0",
            contype="0",
            conaffinity="0",
            group="1",
        )


def _add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _place(placement: pin.SE3) -> dict[str, str]:
    x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
    return {"pos": numbers(placement.translation), "quat": numbers([w, x, y, z])}


def _number(x: float) -> str:
    return repr(float(x))  # as it is: MuJoCo reads all digits


def numbers(values: Iterable[float]) -> str:
    """Return numbers as XML has them; -0 is 0."""
    return " ".join(_number(x + 0.0) for x in values)


def xml_comment(text: str) -> ElementTree.Element[Any]:
    """Return a comment; "--", which XML forbids there, becomes "- -"."""
    return ElementTree.Comment(f" {re.sub('-(?=-)', '- ', one_line(text))} ")


def xml_text(root: ElementTree.Element) -> str:
    """Return an XML file, indented."""
    ElementTree.indent(root)
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        + ElementTree.tostring(root, encoding="unicode")
        + "\n"
    )
