"""The paper's examples: a pendulum (Fig. 4, Table 1), a robot of three links (Fig. 7, Table 2).

Its equations also hold for a closed loop, which is added here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinfric.errors import PinfricError
from pinfric.paper.bodies import (
    GROUND,
    Actuator,
    Array,
    Body,
    GuideFriction,
    LoopPin,
    Mechanism,
    PinFriction,
    RevoluteJoint,
    TranslationalJoint,
)


@dataclass(frozen=True, eq=False)
class Case:
    """A mechanism with the paper's start and efforts."""

    mechanism: Mechanism
    position: Array  # (nj,) rad at t = 0
    rate: Array  # (nj,) rad/s at t = 0
    effort: Callable[[float], Array]  # time s -> (na,) N m
    t_end: float  # s


# The printed coefficients (static 0.3, kinetic 0.35) contradict the printed stick times; the
# consistent reading exchanges them and takes the pendulum's J about its centre of mass.
COEFFICIENTS = {
    "consistent": {"static": 0.35, "kinetic": 0.30},
    "literal": {"static": 0.30, "kinetic": 0.35},
}


def pendulum(reading: str = "consistent", gravity: float = 9.81) -> Case:
    """Example 1: a bar on a pin, gravity (m/s^2) along +X, angle from X about Z (Fig. 4, Table 1).

    J is about the centre of mass in the "consistent" reading, about the pin, as printed, in the
    "literal" one. The bar turns about Z only, so J stands for all three axes.
    """
    about_center = 0.400 if _known_reading(reading) == "consistent" else 0.400 - 1.00 * 0.25**2
    bar = Body("bar", 1.00, about_center * np.eye(3), (0.25, 0.0, 0.0))
    pin = PinFriction(radius=0.1, length=None, **COEFFICIENTS[reading])
    joint = RevoluteJoint("joint_1", GROUND, "bar", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), pin)
    return Case(
        mechanism=Mechanism((bar,), (joint,), (gravity, 0.0, 0.0)),
        position=np.array([0.524]),
        rate=np.array([1.00]),
        effort=lambda time: np.array([2 * np.sin(2 * time)]),
        t_end=1.5,
    )


def three_link(reading: str = "consistent", gravity: float = 9.81) -> Case:
    """Example 2: three links about Z, X and Y, friction in joint 1-2 (Fig. 7, Table 2).

    Gravity (m/s^2) is along -Y; the readings differ in the coefficients only.
    """
    coefficients = COEFFICIENTS[_known_reading(reading)]
    link_1 = Body("link_1", 4.00, np.diag([0.500, 0.200, 0.500]), (0.0, 0.2, 0.0))
    link_2 = Body("link_2", 3.00, np.diag([0.400, 0.400, 0.150]), (0.0, 0.4, -0.25))
    link_3 = Body("link_3", 1.00, np.diag([0.100, 0.200, 0.200]), (0.15, 0.4, -0.5))
    pin = PinFriction(radius=0.08, length=0.1, **coefficients)
    joints = (
        RevoluteJoint("joint_1", GROUND, "link_1", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        RevoluteJoint("joint_12", "link_1", "link_2", (0.0, 0.4, 0.0), (1.0, 0.0, 0.0), pin),
        RevoluteJoint("joint_23", "link_2", "link_3", (0.0, 0.4, -0.5), (0.0, 1.0, 0.0)),
    )
    return Case(
        mechanism=Mechanism((link_1, link_2, link_3), joints, (0.0, -gravity, 0.0)),
        position=np.zeros(3),
        rate=np.array([1.0, -1.0, 1.0]),
        effort=lambda time: 5 * np.sin(np.array([1.0, 2.0, 3.0]) * time),
        t_end=1.0,
    )


def _known_reading(reading: str) -> str:
    if reading not in COEFFICIENTS:
        raise PinfricError(f"reading must be one of {', '.join(COEFFICIENTS)}, not {reading!r}")
    return reading


def slider_crank() -> Mechanism:
    """A closed loop with a translational joint: the bundled scene `slider_crank`, number by number.

    Three moving bodies, 18 coordinates (1), 17 constraints (2), one degree of freedom; friction in
    all four joints, each of which loads the others.
    """

    def pin(radius: float) -> PinFriction:
        return PinFriction(radius, None, static=0.12, kinetic=0.08)

    z = (0.0, 0.0, 1.0)
    crank = Body("crank", 0.3, np.diag([2e-5, 6.25e-5, 6.25e-5]), (0.025, 0.0, 0.0))
    rod = Body("rod", 0.25, np.diag([1.666666667e-5, 4.6875e-4, 4.6875e-4]), (0.125, 0.0, 0.0))
    piston = Body("piston", 0.4, 2e-4 * np.eye(3), (0.0, 0.0, 0.0))
    guide = GuideFriction(0.06, static=0.20, kinetic=0.15)
    joints = (
        RevoluteJoint("crank_pin", GROUND, "crank", (0.0, 0.0, 0.0), z, pin(0.012)),
        RevoluteJoint("rod_pin", "crank", "rod", (0.05, 0.0, 0.0), z, pin(0.008)),
        TranslationalJoint("guide", GROUND, "piston", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), guide),
    )
    return Mechanism(
        bodies=(crank, rod, piston),
        joints=joints,
        gravity=(0.0, -9.81, 0.0),
        actuators=(
            Actuator("crank_pin", GROUND, "crank", (0, 0, 0), torque=z, through="crank_pin"),
        ),
        loops=(
            LoopPin("piston_pin", "rod", "piston", (0.2, 0.0, 0.0), (0.0, 0.0, 0.0), z, pin(0.006)),
        ),
    )
