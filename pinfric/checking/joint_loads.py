"""Loads of a robot's joints: plausible effort limits, otherwise the weight."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.model.twin import PRISMATIC, make_twin, twist
from pinfric.model.urdf import PLACEHOLDER_SPEED
from pinfric.motions.joint_columns import stated_range

#: An effort limit beyond so many times the whole robot held out level is a placeholder: the
#: strongest shoulder or leg made has 1.1 (hands 1.4).
_OVER_ROBOT = 3.0
#: It says so of robots with so many joints: a turntable's drive has inertia to turn, and no weight.
_ARM = 3
#: Limit times velocity limit over the robot's mass (W/kg): the strongest joint made has 88.
_POWER = 100.0
#: From so many joints on with one limit, above this part of the robot held out level, whose own
#: loads differ so much, the limit is no joint's own.
_ALIKE, _ALIKE_OVER, _LOADS_APART = 5, 0.5, 20.0
#: Postures within the ranges in which a joint's own weight is tried.
_POSTURES = 150
#: The same for a sliding joint, over its own load: a gripper's force is many times its fingers'
#: weight. And for a joint whose weight has no lever (N m, N).
_PLACEHOLDER_SLIDING, _MOST_LOAD = 3000.0, 1e4
_KGF_CM = 0.0980665
#: The largest float is Pinocchio's word for no limit.
_NONE = 1e300
_GRAVITY = 9.81
#: Effort limits over the weight that a joint carries: payload and acceleration come to it. UR10:
#: 2.5 at the base, 4.4 at the elbow.
_OVER_WEIGHT = 3.0
#: A turning joint without an effort limit bears at least this part of the largest load of a turning
#: joint before it in the same chain: of UR5, UR10, Panda and iiwa the least is 0.12.
_OF_CHAIN = 0.15


@dataclass(frozen=True)
class JointLoad:
    """Load of a joint according to the URDF, N m or N.

    Attributes:
        degrees: 1, or more for a planar or floating joint.
        leader: of a mimic follower; None for others.
        lower, upper: rad or m, infinite without limits.
        load, why: what it must stand, and where that is taken from.
        limit: its effort limit; 0 without one.
        held: what its own weight needs in the worst posture; 0 where that is not asked.
        remark: why its effort limit is a placeholder, or "".
        least, why_least: the lesser of `load` and of the weight's: no placeholder can raise it.
        fastest: its velocity limit, rad/s or m/s; 0 without a believable one.
    """

    name: str
    sliding: bool
    degrees: int
    leader: str | None
    lower: float
    upper: float
    load: float
    why: str
    limit: float
    held: float
    remark: str
    fastest: float
    least: float
    why_least: str


def joint_loads(model: pin.Model, held_out: float | None) -> list[JointLoad]:
    """Return the load of each joint: its effort limit, or the weight that it carries in q0.

    Without a limit, or with a placeholder, a turning joint stands at least 0.15 of the strongest
    one before it in its chain: an axis through the centre of mass carries no weight, but turns a
    payload. A chain ends where a link carries several.

    Args:
        held_out: `held_out_level`, N m; None: masses are not believed, and judge no limits.
    """
    twin, data = make_twin(model), model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    leaders = {
        int(twin.v_index[j - 1]): str(model.names[j])
        for j in range(1, model.njoints)
        if model.joints[j].nv == 1
    }
    remarks, own = limit_remarks(model, held_out)
    loads: list[JointLoad] = []
    turning: dict[int, JointLoad] = {}
    for j in range(1, model.njoints):
        kind, sliding = model.joints[j], bool(twin.kind[j - 1] == PRISMATIC)
        bodies = list(model.subtrees[j])
        masses = np.array([model.inertias[b].mass for b in bodies])
        centers = np.array([data.oMi[b].act(model.inertias[b].lever) for b in bodies])
        reach = np.linalg.norm(centers - data.oMi[j].translation, axis=1)
        weight = _GRAVITY * float(masses.sum() if sliding else masses @ reach)
        limit = _limit(model, kind)
        remark = remarks.get(j, "")
        if sliding and limit > (_PLACEHOLDER_SLIDING * weight or _MOST_LOAD):
            remark = f"its effort limit, {limit:.4g} N, looks like a placeholder"
        before = [] if sliding else [turning[p] for p in _chain(model, j) if p in turning]
        rule = _by_weight(weight, float(masses.sum()), sliding, before)
        unit = "N" if sliding else "N m"
        stated = limit > 0 and not remark
        load, why = (limit, f"its effort limit, {limit:.4g} {unit}") if stated else rule
        lower, upper = _limits(model, kind)
        follows = leaders[int(twin.v_index[j - 1])] if kind.nv == 0 else None
        speed = float(model.velocityLimit[kind.idx_v]) if kind.nv == 1 else 0.0
        joint = JointLoad(
            name=str(model.names[j]),
            sliding=sliding,
            degrees=max(kind.nv, 1),
            leader=follows,
            lower=lower,
            upper=upper,
            load=load,
            why=why,
            limit=limit,
            held=own.get(j, 0.0),
            remark=remark,
            fastest=speed if 0.0 < speed <= PLACEHOLDER_SPEED else 0.0,
            least=min(load, rule[0]),
            why_least=why if load <= rule[0] else rule[1],
        )
        loads.append(joint)
        if not sliding and joint.degrees == 1:
            turning[j] = joint
    return loads


def held_out_level(mass: float, way: float, model: pin.Model) -> float:
    """Return the torque (N m) that holds a whole robot out level: m g L.

    L is the way along the joints, m (`RobotFacts.way`); where it is 0, the distance of the farthest
    centre of mass from its joint.
    """
    far = max((float(np.linalg.norm(body.lever)) for body in list(model.inertias)[1:]), default=0.0)
    return _GRAVITY * mass * (way or far)


def limit_remarks(
    model: pin.Model, held_out: float | None
) -> tuple[dict[int, str], dict[int, float]]:
    """Return joint -> why its limit is a placeholder, and -> N m against its own weight.

    It is one beyond 3 m g L of a robot of three joints or more, where limit times velocity limit
    exceeds 100 W/kg of it, or where five turning joints or more have one limit beyond m g L.
    """
    # Turning joints with an effort limit -> it, N m, and the velocity limit, rad/s
    turning = {
        j: (limit, float(model.velocityLimit[kind.idx_v]))
        for j, kind in enumerate(model.joints)
        if j
        and kind.nv == 1
        and not twist(model, kind)[:3].any()
        and (limit := _limit(model, kind))
    }
    remarks: dict[int, str] = {}
    if not held_out:
        for j, (limit, _) in turning.items():
            if limit > _MOST_LOAD:
                remarks[j] = f"its effort limit, {limit:.4g} N m, looks like a placeholder"
        return remarks, {}
    mass = sum(body.mass for body in model.inertias)
    most = _OVER_ROBOT * held_out
    if model.njoints <= _ARM:
        most = max(most, _MOST_LOAD)
    for j, (limit, speed) in turning.items():
        said = f"its effort limit, {limit:.4g} N m, looks like a placeholder"
        if limit > most:
            remarks[j] = f"{said}: the whole robot held out level needs {held_out:.3g}"
        elif math.isfinite(speed) and limit * speed > _POWER * mass:
            remarks[j] = (
                f"its limits, {limit:.4g} N m and {speed:.4g} rad/s, are "
                f"{limit * speed / mass:.3g} W for each kg of the robot: one of both looks like a "
                "placeholder"
            )
    own = _own_weight(model, turning)
    if one_limit([limit for limit, _ in turning.values()], list(own.values()), held_out):
        for j, (limit, _) in turning.items():
            if limit > held_out and j not in remarks:
                remarks[j] = (
                    f"its effort limit, {limit:.4g} N m as everywhere, looks like a placeholder: "
                    f"the whole robot held out level needs {held_out:.3g}"
                )
    return remarks, own


def one_limit(limits: Sequence[float], own: Sequence[float], held_out: float) -> bool:
    """Return whether five joints or more have one limit, and own loads that differ 20 times.

    Args:
        limits, own: of the turning joints that have a limit, N m; what their own weight needs.
    """
    alike = len(limits) >= _ALIKE and len(set(limits)) == 1 and limits[0] > _ALIKE_OVER * held_out
    return alike and max(own) > _LOADS_APART * min(own)


def _own_weight(model: pin.Model, joints: Iterable[int]) -> dict[int, float]:
    """Largest torque (N m) of each joint against its own weight, over postures."""
    rng, data = np.random.default_rng(0), model.createData()
    standard = pin.Model(model)
    standard.gravity.linear = np.array([0.0, 0.0, -_GRAVITY])
    lower = np.maximum(model.lowerPositionLimit, -np.pi)
    upper = np.minimum(model.upperPositionLimit, np.pi)
    single = [kind.idx_q for kind in model.joints if kind.nq == kind.nv == 1]
    most = np.zeros(model.nv)
    still = np.zeros(model.nv)
    low, high = lower[single], np.maximum(lower, upper)[single]
    for posture in range(_POSTURES):
        away = rng.uniform(-np.pi, np.pi, model.nv) if posture else np.zeros(model.nv)
        q = pin.integrate(model, pin.neutral(model), away)
        q[single] = rng.uniform(low, high) if posture else np.clip(0.0, low, high)
        most = np.maximum(most, np.abs(pin.rnea(standard, data, q, still, still)))
    return {j: float(most[model.joints[j].idx_v]) for j in joints}


def in_kgf_cm(model: pin.Model, held_out: float | None) -> str:
    """Return the turning joints' limits in N m if they are plausible only in kgf cm, or ""."""
    smaller = pin.Model(model)
    smaller.effortLimit = _KGF_CM * np.asarray(model.effortLimit)
    remarks, own = limit_remarks(smaller, held_out)
    limits = {j: _limit(smaller, smaller.joints[j]) for j in own}
    if remarks or not own or any(own[j] > limits[j] for j in own):
        return ""
    return f"if they are in kgf cm: {', '.join(f'{limit:.3g}' for limit in limits.values())} N m"


def _limit(model: pin.Model, kind: Any) -> float:
    limit = float(model.effortLimit[kind.idx_v]) if kind.nv == 1 else 0.0
    return limit if math.isfinite(limit) and limit < _NONE else 0.0


def _chain(model: pin.Model, joint: int) -> list[int]:
    """The joints before one, as far as each carries no other."""
    carried, before = list(model.parents)[1:], list[int]()
    parent = int(model.parents[joint])
    while parent and carried.count(parent) == 1:
        before.append(parent)
        parent = int(model.parents[parent])
    return before


def _by_weight(
    weight: float, mass: float, sliding: bool, before: Sequence[JointLoad]
) -> tuple[float, str]:
    """What a joint must stand by its weight and its chain, and why."""
    unit = "N" if sliding else "N m"
    load, why = 1.0, f"1 {unit} (no weight to estimate from)"
    if weight > 0:
        load, level = _OVER_WEIGHT * weight, "" if sliding else " held out level"
        what = f"{two_digits(mass)} kg{level}"
        why = f"{_OVER_WEIGHT:g} times {what}, {two_digits(load)} {unit}"
    strongest = max(before, key=lambda joint: joint.least, default=None)
    if strongest and load < _OF_CHAIN * strongest.least:
        load = _OF_CHAIN * strongest.least
        why = f"{_OF_CHAIN:g} of the {strongest.least:.3g} N m of {strongest.name}"
    return load, why


def two_digits(x: float) -> str:
    """Return a number with two digits, below a million without an exponent."""
    return f"{float(f'{x:.2g}'):g}"


def _limits(model: pin.Model, kind: Any) -> tuple[float, float]:
    if kind.nq != 1 or kind.nv != 1:
        return -math.inf, math.inf
    lower = float(model.lowerPositionLimit[kind.idx_q])
    upper = float(model.upperPositionLimit[kind.idx_q])
    lower, upper = stated_range(lower, upper)
    return (lower, upper) if upper - lower < 1e6 else (-math.inf, math.inf)
