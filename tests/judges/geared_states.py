"""Random machines with gears at random states, as `every_line` judges them.

    python tests/judges/geared_states.py worms 1000
    python tests/judges/geared_states.py all 1000

The figures of every gear are chosen here and given to both sides; M, h, loops and rates of
cylinders are Pinocchio's, or written out.
"""

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from builders import chain, dry, lump
from mechanisms import shifted

if __name__ == "__main__":
    TESTS = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(TESTS), str(TESTS / "helpers")]
from builders import random_tree
from judges.every_line import Bearing, Gear, Loss, System, answers, the_answer
from judges.plain_laws import plain_normal_load
from mechanisms import _FIVE_PLACE, _PLACE, FIVE_BAR, FOUR_BAR, MASSES, ring_of_bars

import pinfric as pf
from pinfric.errors import AccelerationError

Rng = np.random.Generator
#: A scene, q, v, motor torques, and the same for the judge.
Case = tuple[pf.Scene, np.ndarray, np.ndarray, np.ndarray, System]


def constant_gear(rng: Rng, ratio: float, rotor: float, locks: bool, inertia: float) -> dict:
    """A gear of constant efficiencies, its rotor about this share of the joint's inertia.

    `locks`: whether the load alone never moves it.
    """
    size = rotor * inertia / ratio**2
    eta = float(rng.uniform(0.3, 0.9))
    return {
        "ratio": ratio,
        "efficiency": eta,
        "back_efficiency": float(-rng.uniform(0.02, 0.6) if locks else rng.uniform(0.05, 1.0)),
        "no_load_torque": {"static": 0.03, "kinetic": 0.02} if rng.random() < 0.7 else 0.01,
        "rotor_inertia": float(size * rng.uniform(0.3, 1.5)),
        "motor_viscous": 1e-4,
    }


def curved_gear(rng: Rng, ratio: float, inertia: float) -> dict:
    """A gear of a maker's curve over the load; where it loses more than it carries, it locks."""
    steps = rng.uniform(1.0, 20.0, size=int(rng.integers(2, 4)))
    loads = np.cumsum(steps)
    losses = np.cumsum(steps * rng.uniform(0.0, 2.5, size=len(steps)))
    eta = loads / (loads + losses)
    back: Any = "same_loss" if rng.random() < 0.6 else float(rng.uniform(-0.3, 0.9))
    return {
        "ratio": ratio,
        "efficiency": {
            "over_load": [[float(x), float(y)] for x, y in zip(loads, eta, strict=True)]
        },
        "back_efficiency": back,
        "rotor_inertia": float(10 ** rng.uniform(-1.5, 0.7) * inertia / ratio**2),
    }


def plain_gear(entry: dict) -> Gear:
    """The same gear for the judge, at its joint."""
    size = abs(entry["ratio"])
    term = entry.get("no_load_torque", 0.0)
    kinetic, static = (term["kinetic"], term["static"]) if isinstance(term, dict) else (term, term)
    eta, back = entry["efficiency"], entry["back_efficiency"]
    if isinstance(eta, dict):
        points = [(0.0, 0.0)]
        points += [(x, max(x * (1.0 / y - 1.0) - size * kinetic, 0.0)) for x, y in eta["over_load"]]
        driving = Loss(tuple(points), points[-1][1] / points[-1][0])
    else:
        driving = Loss(((0.0, 0.0),), 1.0 / eta - 1.0)
    driven = driving if back == "same_loss" else Loss(((0.0, 0.0),), 1.0 - back)
    return Gear(
        driving,
        driven,
        (size * kinetic, size * kinetic),
        (size * static, size * static),
        size**2 * entry.get("rotor_inertia", 0.0),
    )


def tree_dynamics(model: pin.Model, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M and h by RNEA."""
    data, n = model.createData(), model.nv
    h = pin.rnea(model, data, q, v, np.zeros(n)).copy()
    columns = [pin.rnea(model, data, q, v, a) - h for a in np.eye(n)]
    return np.transpose(columns), h


def torques(rng: Rng, S: np.ndarray, h: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Torques about gravity's: with it, against it, or of any size."""
    needed = np.linalg.lstsq(S.T, h, rcond=None)[0]
    push = rng.choice([-1.0, -0.3, 0.3, 1.0, 2.0], size=len(ratio)) * needed
    push += 0.4 * (np.abs(h).max() + 1.0) * rng.normal(size=len(ratio)) * (rng.random() < 0.7)
    return np.asarray(push / ratio)


def some_velocities(rng: Rng, n: int) -> np.ndarray:
    return np.asarray(rng.normal(size=n) * (rng.random(n) < rng.choice([0.0, 0.5, 1.0])))


def _system(
    rng: Rng,
    parts: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    v: np.ndarray,
    gears: list[dict],
    S: np.ndarray,
    bearings: list[Bearing],
    D: np.ndarray,
    bend: np.ndarray | None = None,
    turn: np.ndarray | None = None,
    motions: np.ndarray | None = None,
) -> tuple[np.ndarray, System]:
    """Motor torques, and the judge's system.

    Args:
        parts: M, h, J, gamma.
        motions: (n, d) that loops allow; None: all.
    """
    M, h, J, gamma = parts
    ratio = np.array([gear["ratio"] for gear in gears])
    free = h if motions is None else motions.T @ h
    torque = torques(rng, S if motions is None else S @ motions, free, ratio)
    drag = ratio**2 * np.array([gear.get("motor_viscous", 0.0) for gear in gears]) * (S @ v)
    bend = np.zeros(len(S)) if bend is None else bend
    return torque, System(
        M,
        h,
        J,
        gamma,
        S,
        bend,
        S @ v,
        ratio * torque - drag,
        [plain_gear(gear) for gear in gears],
        D,
        np.zeros(len(D)) if turn is None else turn,
        D @ v,
        bearings,
    )


def _no_loops(n: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((0, n)), np.zeros(0)


def worm(rng: Rng) -> Case:
    """A load on a vertical slide behind a worm, with a light or a heavy rotor."""
    mass = float(rng.uniform(2.0, 30.0))
    body = lump(mass)
    model = chain(("lift", pin.JointModelPZ(), body))
    ratio = float(rng.choice([-1.0, 1.0]) * rng.uniform(20, 80))
    gear = constant_gear(rng, ratio, float(10 ** rng.uniform(-1.5, 0.5)), True, mass)
    friction, bearings = {}, []
    if rng.random() < 0.5:
        friction = {"lift": dry(8.0, 6.0)}
        bearings = [Bearing(6.0, 8.0)]
    q, v = np.zeros(1), np.array([rng.choice([0.0, 0.0, 0.3, -0.3])])
    parts = np.array([[mass]]), np.array([mass * 9.81]), *_no_loops(1)
    torque, system = _system(
        rng, parts, v, [gear], np.eye(1), bearings, np.ones((len(bearings), 1))
    )
    actuators = [{"joint": "lift", "transmission": gear}]
    return pf.Scene(model=model, friction=friction, actuators=actuators), q, v, torque, system


def arm(
    rng: Rng,
    locks: float = 0.5,
    rotor: tuple[float, float] = (-1.5, 0.5),
    curves: bool = False,
    mu: bool = False,
    coupled: bool = False,
    most: int = 4,
) -> Case:
    """A random arm, a gear on every joint.

    Args:
        locks: share of self-locking gears.
        rotor: decades of what rotors reflect, beside the joints' inertia.
        curves: whether gears have makers' curves.
        mu: whether bearings have friction by their loads.
        coupled: whether some drives move with two joints.
    """
    n = int(rng.integers(2, most + 1))
    model = random_tree(int(rng.integers(1 << 30)), n, sliding=0.0 if mu else 0.2)
    names, n = tuple(model.names)[1:], model.nv
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=n))
    v = some_velocities(rng, n)
    M, h = tree_dynamics(model, q, v)
    gears, friction, bearings, D = [], {}, [], []
    for j, name in enumerate(names):
        ratio = float(rng.choice([-1.0, 1.0]) * rng.uniform(20, 120))
        if curves:
            gears.append(curved_gear(rng, ratio, float(M[j, j])))
        else:
            share = float(10 ** rng.uniform(*rotor))
            gears.append(constant_gear(rng, ratio, share, rng.random() < locks, float(M[j, j])))
        if rng.random() < 0.5:
            static = float(rng.uniform(0.3, 3.0))
            friction[name] = dry(static, 0.7 * static)
            bearings.append(Bearing(0.7 * static, static))
            D.append(np.eye(n)[j])
            if mu:
                friction[name]["bearing"] = {"kind": "pin", "radius": 0.03}
                friction[name]["mu"] = {"static": 0.12, "kinetic": 0.1}
    S, couples = np.eye(n), [{} for _ in names]
    if coupled:
        for j in range(1, n):
            if rng.random() < 0.7:
                factor = float(rng.uniform(0.3, 1.2) * rng.choice([-1.0, 1.0]))
                S[j, j - 1], couples[j] = factor, {names[j - 1]: factor}
        if rng.random() < 0.5:  # some drives at rest
            v = np.linalg.solve(S, (S @ v) * (rng.random(n) < 0.5))
            v[np.abs(v) < 1e-12] = 0.0
            M, h = tree_dynamics(model, q, v)
    parts = M, h, *_no_loops(n)
    torque, system = _system(rng, parts, v, gears, S, bearings, np.array(D).reshape(-1, n))
    actuators = [
        {"joint": name, "transmission": gear, **({"couples": couple} if couple else {})}
        for name, gear, couple in zip(names, gears, couples, strict=True)
    ]
    scene = pf.Scene(model=model, friction=friction, actuators=actuators)
    if mu and friction:
        system = system._replace(loads=_loads(scene, model, q, v))
    return scene, q, v, torque, system


def _loads(
    scene: pf.Scene, model: pin.Model, q: np.ndarray, v: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    data = model.createData()

    def loads(a: np.ndarray) -> np.ndarray:
        pin.rnea(model, data, q, v, a)
        load = [
            plain_normal_load(site, data.f[site.joint + 1].vector.copy(), 0.0)
            for site in scene.sites
        ]
        return np.array([[0.1], [0.12]]) * np.array(load)

    return loads


def bars(rng: Rng, five: bool = False) -> Case:
    """A four-bar with 1 to 3 gears on its pins, or a five-bar with 2 to 4."""
    pins, place = (FIVE_BAR, _FIVE_PLACE) if five else (FOUR_BAR, _PLACE)
    masses = {"left": 0.6, "upper_left": 0.4, "upper_right": 0.5, "right": 0.7} if five else MASSES
    model, loop, joints = ring_of_bars(pins, place, masses, "B", "planar_pin", (0.0, -9.81, 0.0))
    names, n = tuple(model.names)[1:], model.nv
    count = int(rng.integers(2, 5)) if five else int(rng.integers(1, 4))
    driven = ["O", "D"] if five else ["O"]
    driven += [name for name in rng.permutation(names).tolist() if name not in driven]
    driven = driven[:count]
    scene = pf.Scene(model=model, friction={}, actuators=[{"joint": "O"}], loops=[loop])
    while True:
        guess = (
            joints([2.0 + 0.5 * rng.normal(), 0.8, 2.3, np.pi - 2.0 + 0.5 * rng.normal()])
            if five
            else joints(rng.uniform(-np.pi, np.pi, 3))
        )
        try:
            q = scene.close(guess)
        except pf.errors.PinfricError:
            continue
        J, _ = _ring_rows(model, loop, q, np.zeros(n))
        if np.linalg.svd(J)[1].min() > 0.02:
            break
    Z = np.linalg.svd(J)[2][2:].T
    rows = [np.eye(n)[names.index(name)] for name in driven]
    v = Z @ rng.normal(size=Z.shape[1]) * (rng.random() < 0.6)
    if five and rng.random() < 0.4:  # the drive at O rests
        left = np.linalg.svd((rows[0] @ Z)[None])[2][1:].T
        v = Z @ left[:, 0]
        v[names.index("O")] = 0.0
    J, gamma = _ring_rows(model, loop, q, v)
    M, h = tree_dynamics(model, q, v)
    effective = float(np.linalg.eigvalsh(Z.T @ M @ Z).mean())
    gears, friction, bearings, D = [], {}, [], []
    for _ in driven:
        ratio = float(rng.choice([-1.0, 1.0]) * rng.uniform(20, 120))
        share = float(10 ** rng.uniform(-1.5, 0.7))
        gear = constant_gear(rng, ratio, share, rng.random() < 0.6, effective)
        gear["no_load_torque"] = 1e-3
        gears.append(gear)
    for name in names:
        if rng.random() < 0.4:
            friction[name] = dry(0.06, 0.05)
            bearings.append(Bearing(0.05, 0.06))
            D.append(np.eye(n)[names.index(name)])
    torque, system = _system(
        rng,
        (M, h, J, gamma),
        v,
        gears,
        np.array(rows),
        bearings,
        np.array(D).reshape(-1, n),
        motions=Z,
    )
    actuators = [
        {"joint": name, "transmission": gear, "share": 1.0}
        for name, gear in zip(driven, gears, strict=True)
    ]
    scene = pf.Scene(model=model, friction=friction, actuators=actuators, loops=[loop])
    return scene, q, v, torque, system


def _ring_rows(
    model: pin.Model, loop: dict, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """J (2, n) of the relative velocity of both sides of a planar pin, and gamma = -dJ/dt v."""
    J, bias = np.zeros((2, model.nv)), np.zeros(2)
    for side, sign in (("a", 1.0), ("b", -1.0)):
        rows, acceleration, _ = _point(model, loop[side]["link"], loop[side]["xyz"], q, v)
        J += sign * rows[:2]
        bias += sign * acceleration[:2]
    return J, -bias


def _point(
    model: pin.Model, link: str, xyz: list, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobian (3, n) of a point of a link, its acceleration at a = 0, and its place."""
    frame = model.frames[model.getFrameId(link)]
    place = frame.placement.act(np.array(xyz, dtype=float))
    joint, data = frame.parentJoint, model.createData()
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q)
    R = data.oMi[joint].rotation
    lever = R @ place
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    rows = np.zeros((6, model.nv))
    if joint > 0:
        rows = pin.getJointJacobian(model, data, joint, world).reshape(6, -1)
    J = rows[:3] - pin.skew(lever) @ rows[3:]
    if joint == 0:
        return J, np.zeros(3), lever
    w = R @ data.v[joint].angular
    alpha = R @ data.a[joint].angular
    a0 = pin.getClassicalAcceleration(model, data, joint, world).linear
    acceleration = a0 + np.cross(alpha, lever) + np.cross(w, np.cross(w, lever))
    return J, acceleration, data.oMi[joint].translation + lever


def crane(rng: Rng) -> Case:
    """A boom and an arm, each on a lead screw between links; pins and seals have friction."""
    model, parent = pin.Model(), 0
    links = [("boom", 1.0, 40.0), ("arm", 0.7, 20.0)]
    model.addBodyFrame("ground", 0, pin.SE3.Identity(), 0)
    for k, (name, length, mass) in enumerate(links[: int(rng.integers(1, 3))]):
        place = shifted(1.0 if k else 0.0)
        parent = model.addJoint(parent, pin.JointModelRY(), place, f"pivot_{name}")
        body = pin.Inertia(mass, np.array([0.5 * length, 0, 0]), np.diag([0.1, 3.0, 3.0]))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        model.addBodyFrame(name, parent, pin.SE3.Identity(), 0)
    n = model.nv
    points = [
        ("ground", [0.1, 0, -0.5], "boom", [0.6, 0, 0.0]),
        ("boom", [0.4, 0, 0.4], "arm", [0.3, 0, 0.05]),
    ]
    q, v = rng.uniform(-0.4, 0.4, n), some_velocities(rng, n)
    M, h = tree_dynamics(model, q, v)
    S, bend, gears, actuators, friction, bearings, D, turn = [], [], [], [], {}, [], [], []
    for k, (a, at, b, on) in enumerate(points[:n]):
        (Ja, aa, pa), (Jb, ab, pb) = (
            _point(model, link, x, q, v) for link, x in ((a, at), (b, on))
        )
        length = np.linalg.norm(pb - pa)
        e = (pb - pa) / length
        across = (Jb - Ja) @ v - e * (e @ (Jb - Ja) @ v)
        S.append(e @ (Jb - Ja))
        bend.append(e @ (ab - aa) + across @ across / length)
        ratio = 2 * np.pi / float(rng.uniform(0.005, 0.02))
        mass = 1.0 / float(S[k] @ np.linalg.solve(M, S[k]))
        gear = constant_gear(
            rng, ratio, float(10 ** rng.uniform(-1.5, 0.7)), rng.random() < 0.7, mass
        )
        gears.append(gear)
        name = f"ram_{k}"
        ends = {"a": {"link": a, "xyz": at}, "b": {"link": b, "xyz": on}}
        actuators.append({"cylinder": {"name": name, **ends}, "transmission": gear})
        if rng.random() < 0.4:
            friction[name] = dry(60.0, 50.0)
            bearings.append(Bearing(50.0, 60.0))
            D.append(S[k])
            turn.append(bend[k])
        if rng.random() < 0.4:
            friction[model.names[k + 1]] = dry(6.0, 5.0)
            bearings.append(Bearing(5.0, 6.0))
            D.append(np.eye(n)[k])
            turn.append(0.0)
    torque, system = _system(
        rng,
        (M, h, *_no_loops(n)),
        v,
        gears,
        np.array(S),
        bearings,
        np.array(D).reshape(-1, n),
        np.array(bend),
        np.array(turn),
    )
    scene = pf.Scene(model=model, friction=friction, actuators=actuators)
    return scene, q, v, torque, system


KINDS: dict[str, Callable[[Rng], Case]] = {
    "worms": worm,
    "arms 15": lambda rng: arm(rng, 0.15, (-0.5, 0.5)),
    "arms 60 light": lambda rng: arm(rng, 0.6, (-2.5, -0.5)),
    "arms 80": lambda rng: arm(rng, 0.8, (0.0, 1.0)),
    "curves": lambda rng: arm(rng, curves=True, most=3),
    "bearings": lambda rng: arm(rng, 0.5, mu=True, most=3),
    "four-bars": bars,
    "five-bars": lambda rng: bars(rng, five=True),
    "couples": lambda rng: arm(rng, 0.6, coupled=True, most=3),
    "cylinders": crane,
}


def compare(kind: str, seed: int) -> tuple[str, Any]:
    """How forward dynamics and the judge compare at one random state; and what each says."""
    number = list(KINDS).index(kind)
    scene, q, v, torque, system = KINDS[kind](np.random.default_rng([number, seed]))
    found = answers(system)
    wanted = the_answer(found)
    stable = sum(answer.stable for answer in found)
    many = f"{len(found)} answers, {stable} stable"
    try:
        a = pf.forward_dynamics(scene, q, v, motor_torque=torque).a
    except AccelerationError as error:
        if wanted is None:
            return f"refused: {many}", error
        return f"WRONG refusal {type(error).__name__}: {many}", (wanted, error)
    if wanted is None:
        return f"WRONG answer: {many}", (a, found)
    near = np.abs(a - wanted).max() <= 1e-6 * np.abs(wanted).max() + 1e-8
    return (f"same: {many}" if near else f"WRONG a: {many}"), (a, wanted)


def study(kind: str, seeds: range) -> tuple[Counter[str], dict[str, list[int]]]:
    """Count the outcomes of many states, and print the seeds of the wrong ones."""
    count: Counter[str] = Counter()
    wrong: dict[str, list[int]] = {}
    for seed in seeds:
        outcome, _ = compare(kind, seed)
        count[outcome] += 1
        if outcome.startswith("WRONG"):
            wrong.setdefault(outcome, []).append(seed)
    return count, wrong


if __name__ == "__main__":
    for kind in KINDS if sys.argv[1] == "all" else [sys.argv[1]]:
        count, wrong = study(kind, range(int(sys.argv[2])))
        print(kind, flush=True)
        for outcome, number in sorted(count.items()):
            print(f"  {number:5d}  {outcome}  {wrong.get(outcome, [])[:12]}", flush=True)
