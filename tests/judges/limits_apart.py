"""Mechanisms whose static limits lie decades apart, and a judge of what holds: exact, then HiGHS.

The judge shares no code with pinfric: Pinocchio's rnea gives h, its Jacobians the ring's closure.
All else is in fractions until the program is written, every friction in its own limit.
"""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from builders import dry
from mechanisms import add_link, bar, grounded_model, shifted
from scipy.optimize import linprog

import pinfric as pf

#: A gear that no load moves; friction of its own it has none at rest but what its loss makes.
WORM = {"ratio": 50.0, "efficiency": 0.4, "back_efficiency": -0.2}

_SHARP = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


class Mechanism(NamedTuple):
    """A scene at rest.

    Attributes:
        scene, q, effort: as `pf.holds` takes them, the efforts of motors (ratio 1 or 50).
        limits: joint -> static limit (N m, N), infinite with a self-locking gear.
        ends: the two links and points that a pin joins.
    """

    scene: pf.Scene
    q: np.ndarray
    effort: np.ndarray
    limits: dict[str, float]
    ends: tuple[str, np.ndarray, str, np.ndarray]


def random_mechanism(seed: int, decades: float = 12.0) -> Mechanism:
    """A ring of four to six pins, an arm of three joints and a hoist, sizes and limits far apart.

    Some joints have self-locking gears. Loads of joints that move alone are about their limits.
    """
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-decades / 2, decades / 2, 3)  # kg
    model, q = grounded_model((1.0, -9.0, 2.0)), {}
    pins = int(rng.integers(4, 7))
    places = np.column_stack([0.3 * np.arange(pins), rng.uniform(-0.3, 0.4, pins)])
    parent, angle, at = 0, 0.0, places[0]
    for k in range(pins - 1):
        d = places[k + 1] - places[k]
        place = pin.SE3(np.eye(3), np.array([*at, 0.0]))
        link = bar(size[0] * rng.uniform(0.3, 2.0), np.hypot(*d))
        parent = add_link(model, parent, pin.JointModelRZ(), place, f"pin_{k}", link)
        q[f"pin_{k}"], angle = np.arctan2(d[1], d[0]) - angle, np.arctan2(d[1], d[0])
        at = np.array([np.hypot(*d), 0.0])
    ends = (f"pin_{pins - 2}", np.array([*at, 0.0]), "ground", np.array([*places[-1], 0.0]))
    parent = 0
    for k in range(3):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.3, size=3))
        mass = size[1] * 10.0 ** rng.uniform(-3, 0)
        parent = add_link(model, parent, pin.JointModelRY(), place, f"arm_{k}", bar(mass, 0.4))
        q[f"arm_{k}"] = rng.normal()
    add_link(model, 0, pin.JointModelPY(), shifted(2.0), "hoist", bar(size[2], 0.3))
    q["hoist"] = 0.0
    names = list(model.names)[1:]
    rings = [f"pin_{k}" for k in range(pins)]
    q = np.array([q[name] for name in names])
    h = pin.rnea(model, model.createData(), q, np.zeros(model.nv), np.zeros(model.nv))
    alone = {
        name: abs(h[i]) * rng.uniform(0.95, 4.0)
        for i, name in enumerate(names)
        if name not in rings
    }
    ring = np.abs(h[: pins - 1]).max() * 10.0 ** -rng.uniform(0.0, decades, pins)
    ring[rng.permutation(pins)[: pins - 2]] *= 10.0 ** rng.uniform(0.0, decades / 2, pins - 2)
    limits = alone | dict(zip(rings, np.minimum(ring, 1e11).tolist(), strict=True))
    driven = [name for name in names if name not in rings[pins - 3 : -1]]
    locks = [name for name in driven if rng.random() < 0.15]
    actuators = [
        {"joint": name, "transmission": WORM if name in locks else {"ratio": 1.0}}
        for name in driven
    ]
    loop = {
        "name": rings[-1],
        "kind": "planar_pin",
        **{
            side: {"link": link, "xyz": at.tolist()}
            for side, link, at in (("a", *ends[:2]), ("b", *ends[2:]))
        },
    }
    friction = {n: dry(x) for n, x in limits.items()}
    scene = pf.Scene(model=model, friction=friction, loops=[loop], actuators=actuators)
    effort = np.array(
        [
            0.0 if name in locks else 0.3 * rng.normal() * abs(h[names.index(name)])
            for name in driven
        ]
    )
    return Mechanism(scene, q, effort, limits | dict.fromkeys(locks, np.inf), ends)


def least_use(m: Mechanism) -> float:
    """The least t with |x_k| <= t limit_k of all frictions x in equilibrium, by HiGHS.

    D^T x + J^T f = h - u in fractions; the forces f that close the ring, and all x but the free
    ones, are eliminated, the largest limits first, so that no row of the program mixes decades.
    """
    model, data = m.scene.model, m.scene.model.createData()
    h = pin.rnea(model, data, m.q, np.zeros(model.nv), np.zeros(model.nv))
    u = np.zeros(model.nv)
    for drive, value in zip(m.scene.drives, m.effort, strict=True):
        u[model.joints[model.getJointId(drive.name)].idx_v] = value
    pin.computeJointJacobians(model, data, m.q)
    joint = model.getJointId(m.ends[0])
    at = np.array(pin.SE3(np.eye(3), m.ends[1]).translation)
    full = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    arm = data.oMi[joint].rotation @ at
    J = full[:2] + np.array([[-arm[1]], [arm[0]]]) * full[5]  # v of the point, about z only
    limits = [m.limits[name] for name in list(model.names)[1:]] + [m.limits[m.scene.loops[0].name]]
    columns = np.column_stack([np.eye(model.nv), full[5], J.T])
    T = [[Fraction(float(x)) for x in row] for row in np.column_stack([columns, h - u])]
    n = len(limits)
    order = [n, n + 1, *sorted(range(n), key=lambda k: -limits[k])]
    pivots = _reduce(T, order)
    free = [k for k in range(n) if k not in pivots]
    rows, right = [], []
    for k in range(n):
        if limits[k] == np.inf:
            continue
        limit = Fraction(limits[k])
        if k in pivots:
            line = [-T[pivots[k]][f] * Fraction(limits[f]) / limit for f in free]
            offset = T[pivots[k]][-1] / limit
        else:
            line, offset = [Fraction(int(f == k)) for f in free], Fraction(0)
        for sign in (1, -1):
            rows.append([float(sign * x) for x in line] + [-1.0])
            right.append(float(-sign * offset))
    unit = max(np.abs(right), default=0.0)
    for _ in range(3 if unit > 0.0 else 0):  # frictions and t in this unit: last, in t itself
        ranges = [(None, None)] * len(free) + [(0, None)]
        found = linprog(
            [0.0] * len(free) + [1.0],
            rows,
            np.array(right) / unit,
            bounds=ranges,
            method="highs",
            options=_SHARP,
        )
        assert found.status == 0
        if found.fun == 0.0:
            return 0.0
        unit *= found.fun
    return float(unit)


def _reduce(T: list[list[Fraction]], order: list[int]) -> dict[int, int]:
    """Bring T to reduced echelon form, columns in an order; return column -> row of its pivot."""
    pivots: dict[int, int] = {}
    for c in order:
        rows = [r for r in range(len(T)) if r not in pivots.values() and T[r][c]]
        if not rows:
            continue
        r = max(rows, key=lambda r: abs(T[r][c]))
        T[r] = [x / T[r][c] for x in T[r]]
        for other in range(len(T)):
            if other != r and T[other][c]:
                T[other] = [x - T[other][c] * y for x, y in zip(T[other], T[r], strict=True)]
        pivots[c] = r
    return pivots
