from dataclasses import replace

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import pinfric as pf
from pinfric.paper.bodies import (
    GROUND,
    Actuator,
    Body,
    GuideFriction,
    Mechanism,
    PinFriction,
    RevoluteJoint,
    TranslationalJoint,
)
from pinfric.paper.examples import pendulum, three_link

#: Which joints of a random tree are translational, by its seed.
SLIDING = ((), (1,), (0, 2), (0, 1, 2, 3), (0, 3, 4))


PENDULUM_LENGTH, PENDULUM_MASS, PENDULUM_J, PIN_RADIUS = 0.25, 1.0, 0.4, 0.1


def random_tree(seed: int, bodies: int = 4, translational: tuple[int, ...] = ()) -> Mechanism:
    """A random branching tree of joints, with pins of both kinds, and guides where they slide."""
    rng = np.random.default_rng(seed)
    parts, joints, names = [], [], [GROUND]
    for k in range(bodies):
        turn = Rotation.random(random_state=rng).as_matrix()
        inertia = turn @ np.diag(0.1 + rng.random() * np.array([1.0, 0.8, 0.6])) @ turn.T
        parts.append(Body(f"body_{k}", 0.5 + rng.random(), inertia, rng.normal(size=3) * 0.3))
        pin = PinFriction(0.02, 0.1 if k % 2 else None, 0.4, 0.3)
        parent = names[rng.integers(max(0, k - 1), k + 1)]
        place = f"joint_{k}", parent, f"body_{k}", rng.normal(size=3) * 0.3, rng.normal(size=3)
        if k in translational:
            joints.append(TranslationalJoint(*place, GuideFriction(0.2, 0.06, 0.04, width=0.3)))
        else:
            joints.append(RevoluteJoint(*place, pin))
        names.append(f"body_{k}")
    return Mechanism(tuple(parts), tuple(joints), (1.0, -2.0, -9.0))


def random_motion(mechanism: Mechanism, seed: int, samples: int = 5) -> np.ndarray:
    shape = (3, samples, len(mechanism.joints))
    return np.random.default_rng(seed).uniform(-2, 2, size=shape)


def pushed_pendulum(static: float = 0.35, kinetic: float = 0.30) -> Mechanism:
    """A pendulum of 0.5 m pushed at 0.3 m across by a force: its reaction depends on the push."""
    mechanism = pendulum().mechanism
    joint = replace(mechanism.joints[0], friction=PinFriction(0.1, None, static, kinetic))
    push = Actuator("push", GROUND, "bar", (0.3, 0.0, 0.0), force=(0.0, 1.0, 0.0))
    return replace(mechanism, joints=(joint,), actuators=(push,))


def push_in_closed_form(angle, rate, acceleration, coefficient) -> float:
    """P of 0.3 P = (J + m l^2) a + m g l sin + coefficient R |F|, where F depends on P too."""
    l, g = PENDULUM_LENGTH, 9.81  # noqa: E741
    across = l * acceleration + g * np.sin(angle)
    along = l * rate**2 + g * np.cos(angle)
    total = (PENDULUM_J + l**2) * acceleration + g * l * np.sin(angle)
    return brentq(
        lambda p: 0.3 * p - total - coefficient * PIN_RADIUS * np.hypot(across - p, along),
        -1e3,
        1e3,
        xtol=1e-14,
        rtol=1e-15,
    )


def three_pins(static=(0.4, 0.35, 0.2)):
    """The paper's robot with friction in every joint, for both."""
    mechanism = three_link().mechanism
    pins = [
        PinFriction(0.05, 0.12, static=static[0], kinetic=0.25),
        PinFriction(0.08, 0.10, static=static[1], kinetic=0.30),
        PinFriction(0.03, None, static=static[2], kinetic=0.2),
    ]
    joints = [replace(j, friction=f) for j, f in zip(mechanism.joints, pins, strict=True)]
    scene = pf.load_scene("three_link")
    friction = {}
    for name, f in zip(scene.joint_names, pins, strict=True):
        bearing = {"kind": "pin", "radius": f.radius}
        if f.length is not None:
            bearing["length"] = f.length
        friction[name] = {"bearing": bearing, "mu": {"static": f.static, "kinetic": f.kinetic}}
    scene = pf.Scene(model=scene.model, friction=friction)
    return scene, replace(mechanism, joints=tuple(joints))
