"""Small models, built in Python so that every number is in sight."""

import itertools
from collections.abc import Iterable

import numpy as np
import pinocchio as pin

import pinfric as pf
from pinfric.motions.waypoints import quintic

_ALIGNED = [pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ]
_SLIDING = [pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ]


def example(
    name: object, motion: object = None, **changes: object
) -> tuple[pf.Scene, pf.Trajectory]:
    """A bundled scene, changed, and its motion or another one."""
    scene = pf.load_scene(name).with_(**changes) if changes else pf.load_scene(name)
    return scene, pf.load_trajectory(motion or name, scene)


def random_inertia(rng: np.random.Generator) -> pin.Inertia:
    """A body that can exist: a cloud of positive point masses."""
    points = rng.normal(scale=0.2, size=(8, 3)) + rng.normal(scale=0.1, size=3)
    masses = rng.uniform(0.05, 0.6, size=8)
    com = masses @ points / masses.sum()
    inertia = np.zeros((3, 3))
    for m, r in zip(masses, points - com, strict=True):
        inertia += m * (r @ r * np.eye(3) - np.outer(r, r))
    return pin.Inertia(masses.sum(), com, inertia)


def random_joint(rng: np.random.Generator, sliding: float = 0.25) -> pin.JointModel:
    """A one-degree joint: aligned or not, turning, continuous or sliding."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    if rng.random() < sliding:
        return (
            rng.choice(_SLIDING)() if rng.random() < 0.5 else pin.JointModelPrismaticUnaligned(axis)
        )
    pick = rng.random()
    if pick < 0.4:
        return rng.choice(_ALIGNED)()
    if pick < 0.7:
        return pin.JointModelRevoluteUnaligned(axis)
    return pin.JointModelRUBZ()


def random_tree(seed: int, joints: int = 6, sliding: float = 0.25) -> pin.Model:
    """A seeded random tree of one-degree joints."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    for j in range(joints):
        parent = int(rng.integers(0, j + 1))
        name = f"joint_{j + 1}"
        added = model.addJoint(parent, random_joint(rng, sliding), pin.SE3.Random(), name)
        placement = model.jointPlacements[added]
        placement.translation = rng.normal(scale=0.3, size=3)
        turn = pin.exp3(rng.normal(size=3))
        placement.rotation = turn
        model.appendBodyToJoint(added, random_inertia(rng), pin.SE3.Identity())
    model.gravity.linear = rng.normal(scale=6.0, size=3)
    return model


def random_states(
    model: pin.Model, seed: int, samples: int = 20
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seeded (q, v, a), q on its manifold."""
    rng = np.random.default_rng(seed)
    q = np.array(
        [
            pin.integrate(model, pin.neutral(model), rng.normal(scale=1.0, size=model.nv))
            for _ in range(samples)
        ]
    )
    return q, rng.normal(size=(samples, model.nv)), rng.normal(size=(samples, model.nv))


def random_friction(model: pin.Model, seed: int) -> dict[str, dict]:
    """Seeded friction of every kind for every one-degree joint of a model."""
    rng = np.random.default_rng(seed)
    friction = {}
    for index in range(1, model.njoints):
        slides = model.joints[index].shortname().startswith(("JointModelP",))
        kinetic = float(rng.uniform(0.05, 0.4))
        entry: dict = {
            "bearing": _random_bearing(rng, slides),
            "mu": {"static": 1.3 * kinetic, "kinetic": kinetic},
            "viscous": float(rng.uniform(0, 0.3)),
        }
        if rng.random() < 0.5:
            entry["stribeck"] = {"velocity": float(rng.uniform(0.05, 0.5)), "exponent": 1.5}
        pick = rng.random()
        if pick < 0.4:
            entry["coulomb"] = {"static": 0.6, "kinetic": 0.5}
        elif pick < 0.7:
            entry["coulomb"] = {
                "positive": {"static": 0.6, "kinetic": 0.5},
                "negative": {"static": 0.9, "kinetic": 0.3},
            }
        friction[model.names[index]] = entry
    return friction


def scene_of(seed: int, joints: int = 6, **more: object) -> pf.Scene:
    """A seeded random tree with seeded friction in every joint."""
    model = random_tree(seed, joints)
    return pf.Scene(model=model, friction=random_friction(model, seed), **more)


def _random_bearing(rng: np.random.Generator, slides: bool) -> dict:
    if slides:
        return {
            "kind": "guide",
            "length": float(rng.uniform(0.1, 0.4)),
            "width": 0.1,
            "preload": 2.0,
            "offset": float(rng.normal(scale=0.1)),
            "on": str(rng.choice(["child", "parent"])),
        }
    pick = rng.random()
    if pick < 0.5:
        return {
            "kind": "pin",
            "radius": 0.05,
            "length": float(rng.uniform(0.05, 0.2)),
            "thrust_radius": 0.04,
            "preload": 1.0,
            "offset": float(rng.normal(scale=0.05)),
        }
    if pick < 0.7:
        return {"kind": "pin", "radius": 0.05}
    return {
        "kind": "linear",
        "radial": 0.1,
        "axial": 0.05,
        "moment": 0.2,
        "preload": 0.3,
        "offset": 0.02,
    }


def lump(mass: float, place: object = (0.0, 0.0, 0.0), moment: float = 0.01) -> pin.Inertia:
    """A body of that mass (kg), its centre at `place` (m); the same moment (kg m^2) every way."""
    return pin.Inertia(mass, np.array(place, dtype=float), moment * np.eye(3))


def dry(static: float, kinetic: float | None = None, **more: object) -> dict:
    """Friction entry of a joint without load; kinetic as static by default."""
    kinetic = static if kinetic is None else kinetic
    return {"coulomb": {"static": static, "kinetic": kinetic}, **more}


def chain(*links: tuple, gravity: float = 9.81, beside: bool = False) -> pin.Model:
    """A chain of joints: name, joint, body, (3,) m from the one before; without limits.

    Body and place may be left out. Or all of them beside each other, on the ground.
    """
    model = pin.Model()
    for before, (name, joint, *rest) in enumerate(links):
        place = np.array(rest[1] if len(rest) > 1 else [0.0, 0.0, 0.0])
        model.addJoint(0 if beside else before, joint, pin.SE3(np.eye(3), place), name)
        if rest:
            model.appendBodyToJoint(before + 1, rest[0], pin.SE3.Identity())
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    return model


def still(scene: pf.Scene, duration: float = 1.0) -> pf.Trajectory:
    """A motion that stands still, stretched out."""
    zero = np.zeros((2, scene.model.nv))
    return pf.Trajectory.from_arrays(scene, np.array([0.0, duration]), zero, zero, zero)


def row(names: Iterable[str], body: pin.Inertia, step: float) -> pin.Model:
    """Equal links along x that turn about y, `step` (m) from one joint to the next."""
    first = [0.0, 0.0, 0.0]
    places = itertools.chain([first], itertools.repeat([step, 0.0, 0.0]))
    return chain(*((name, pin.JointModelRY(), body, x) for name, x in zip(names, places)))  # noqa: B905


def block(angle: float = 0.0, mass: float = 2.0) -> pin.Model:
    """A block sliding along x of a plane tilted by `angle` about y, downhill for angle > 0."""
    model = pin.Model()
    tilted = pin.SE3(pin.rpy.rpyToMatrix(0.0, angle, 0.0), np.zeros(3))
    joint = model.addJoint(0, pin.JointModelPX(), tilted, "slide")
    model.appendBodyToJoint(
        joint, pin.Inertia(mass, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity()
    )
    return model


def sliding_block(
    friction: dict | None = None, angle: float = 0.0, mass: float = 2.0, **scene: object
) -> pf.Scene:
    """The `block` as a scene, with that friction at its slide."""
    entries = {} if friction is None else {"slide": friction}
    return pf.Scene(model=block(angle, mass), friction=entries, **scene)


def guided(offset: float, angle: float = 0.3) -> pf.Scene:
    """A block on a guide that has a length and no width; its mass is `offset` (m) beside it."""
    model = block(angle)
    model.inertias[1] = pin.Inertia(2.0, np.array([0, offset, 0]), 0.01 * np.eye(3))
    guide = {"bearing": {"kind": "guide", "length": 0.2}, "mu": {"static": 0.1, "kinetic": 0.1}}
    return pf.Scene(model=model, friction={"slide": guide})


#: Friction of a block on a plane: mu |N|, N m or N independent of where the load acts.
def plane_friction(static: float, kinetic: float, **more: object) -> dict:
    """Friction entry whose load is the force across the joint."""
    return {
        "bearing": {"kind": "linear", "radial": 1.0},
        "mu": {"static": static, "kinetic": kinetic},
        **more,
    }


def gantry(turned: bool, gear: dict) -> tuple[pin.Model, list[dict]]:
    """A carriage of 4 kg on two belts (CoreXY) in a vertical plane, or slides along the belts.

    The belts' ways q_x - q_z and q_z + q_x are sqrt(2) times those along axes turned by 45 degrees.
    """
    model, angle = pin.Model(), np.pi / 4 if turned else 0.0
    turn = pin.SE3(pin.rpy.rpyToMatrix(0.0, angle, 0.0), np.zeros(3))
    first = model.addJoint(0, pin.JointModelPX(), turn, "x")
    model.appendBodyToJoint(first, pin.Inertia.Zero(), pin.SE3.Identity())
    second = model.addJoint(first, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    body = pin.Inertia(4.0, np.zeros(3), 0.01 * np.eye(3))
    model.appendBodyToJoint(second, body, pin.SE3.Identity())
    gear = gear | {"ratio": gear["ratio"] * (np.sqrt(2.0) if turned else 1.0)}
    couples = [{}, {}] if turned else [{"z": -1.0}, {"x": 1.0}]
    return model, [
        {"joint": joint, "couples": other, "transmission": gear}
        for joint, other in zip("xz", couples, strict=True)
    ]


def pick_and_place(digits: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Hold 1 s, quintic 1.1 rad in 1 s, hold 0.5 s, back 0.7 rad in 1 s, hold; at 1 kHz."""
    t = np.arange(4001) / 1000
    first, second = (quintic(np.clip(t - start, 0, 1)) for start in (1.0, 2.5))
    q, v, a = (1.1 * x - 0.7 * y for x, y in zip(first, second, strict=True))
    return t, np.round(q + 0.3, digits), v, a


def geared_arm(
    seed: int, mimic: bool = False, locks: float = 0.15
) -> tuple[pf.Scene, np.random.Generator]:
    """A random arm with a random gear on every joint, a share of them self-locking."""
    rng = np.random.default_rng(seed)
    model = random_tree(seed, int(rng.integers(2, 8)), sliding=0.2)
    names = tuple(model.names)[1:]
    mimic = mimic and model.joints[1].nq == model.joints[len(names)].nq == 1
    if mimic:
        model = pin.transformJointIntoMimic(model, 1, len(names), -0.7, 0.1)
    actuators, friction = [], {}
    for name in names[: len(names) - mimic]:
        locking = rng.random() < locks
        actuators.append(
            {
                "joint": name,
                "transmission": {
                    "ratio": float(rng.choice([-1, 1]) * rng.uniform(20, 120)),
                    "efficiency": float(rng.uniform(0.3, 1.0)),
                    "back_efficiency": float(
                        -rng.uniform(0, 0.3) if locking else rng.uniform(0.05, 1.0)
                    ),
                    "no_load_torque": float(rng.uniform(0, 0.05)),
                    "motor_viscous": 1e-4,
                    "rotor_inertia": float(rng.uniform(0, 5e-4) + 3e-3 * locking),
                },
            }
        )
    for name in names:
        if rng.random() < 0.6:
            static = float(rng.uniform(0.5, 1.5))
            friction[name] = {"coulomb": {"static": static, "kinetic": 0.7 * static}}
        if name in friction and rng.random() < 0.4 and not mimic:
            friction[name]["viscous"] = 0.2
    return pf.Scene(model=model, friction=friction, actuators=actuators), rng
