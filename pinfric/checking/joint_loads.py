"""Loads of a robot's joints: plausible effort limits, otherwise the weight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.model.twin import PRISMATIC, make_twin
from pinfric.motions.joint_columns import stated_range

#: An effort limit beyond so many times the static load is a placeholder (a gripper's force is
#: many times its fingers' weight).
_PLACEHOLDER, _PLACEHOLDER_SLIDING = 300.0, 3000.0
#: The same for a joint whose weight has no lever (N m, N).
_MOST_LOAD = 1e4
_GRAVITY = 9.81
#: Effort limits over the weight that a joint carries: payload and acceleration come to it. UR10:
#: 2.5 at the base, 4.4 at the elbow.
_OVER_WEIGHT = 3.0
#: A velocity limit beyond is a placeholder (rad/s, m/s).
_FASTEST = 50.0
#: A turning joint without an effort limit bears at least this part of the largest load of a turning
#: joint before it in the same chain: of UR5, UR10, Panda and iiwa the least is 0.12.
_OF_CHAIN = 0.15


@dataclass(frozen=True)
class JointLoad:
    """Load of a joint according to the URDF.

    Attributes:
        name: the joint's.
        sliding: True for a prismatic joint.
        degrees: 1, or more for a planar or floating joint.
        leader: of a mimic follower; None for others.
        lower, upper: rad or m, infinite without limits.
        load: what it must stand (N m or N).
        why: where that is taken from.
        remark: what is wrong with its effort limit, or "".
        least, why_least: the lesser of that and of the weight's: a placeholder cannot raise it.
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
    remark: str
    fastest: float
    least: float
    why_least: str


def joint_loads(model: pin.Model) -> list[JointLoad]:
    """Return the load of each joint: its effort limit, or the weight that it carries in q0.

    Without a limit a turning joint stands at least 0.15 of what the strongest one before it in its
    chain does: an axis through the centre of mass carries no weight, and turns a payload all the
    same. A chain ends where a link carries several.
    """
    twin, data = make_twin(model), model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    leaders = {
        int(twin.v_index[j - 1]): str(model.names[j])
        for j in range(1, model.njoints)
        if model.joints[j].nv == 1
    }
    found: list[JointLoad] = []
    turning: dict[int, JointLoad] = {}
    for j in range(1, model.njoints):
        kind, sliding = model.joints[j], bool(twin.kind[j - 1] == PRISMATIC)
        bodies = list(model.subtrees[j])
        masses = np.array([model.inertias[b].mass for b in bodies])
        centers = np.array([data.oMi[b].act(model.inertias[b].lever) for b in bodies])
        reach = np.linalg.norm(centers - data.oMi[j].translation, axis=1)
        weight = _GRAVITY * float(masses.sum() if sliding else masses @ reach)
        limit = float(model.effortLimit[kind.idx_v]) if kind.nv == 1 else 0.0
        before = [] if sliding else [turning[p] for p in _chain(model, j) if p in turning]
        rule = _by_weight(weight, float(masses.sum()), sliding, before)
        load, why, remark = _load(limit, weight, sliding, rule)
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
            remark=remark,
            fastest=speed if 0.0 < speed <= _FASTEST else 0.0,
            least=min(load, rule[0]),
            why_least=why if load <= rule[0] else rule[1],
        )
        found.append(joint)
        if not sliding and joint.degrees == 1:
            turning[j] = joint
    return found


def _chain(model: pin.Model, joint: int) -> list[int]:
    """The joints before one, as far as each carries no other."""
    carried, found = list(model.parents)[1:], list[int]()
    parent = int(model.parents[joint])
    while parent and carried.count(parent) == 1:
        found.append(parent)
        parent = int(model.parents[parent])
    return found


def _load(
    limit: float, weight: float, sliding: bool, rule: tuple[float, str]
) -> tuple[float, str, str]:
    """(what a joint must stand, why, remark): its limit, else by its weight and its chain."""
    unit = "N" if sliding else "N m"
    given = math.isfinite(limit) and limit > 0
    most = (_PLACEHOLDER_SLIDING if sliding else _PLACEHOLDER) * weight or _MOST_LOAD
    if given and limit <= most:
        return limit, f"its effort limit, {limit:.4g} {unit}", ""
    return *rule, f"its effort limit, {limit:.4g} {unit}, looks like a placeholder" * given


def _by_weight(
    weight: float, mass: float, sliding: bool, before: Sequence[JointLoad]
) -> tuple[float, str]:
    """(what a joint must stand by its weight and its chain, why)."""
    unit = "N" if sliding else "N m"
    load, why = 1.0, f"1 {unit} (no weight to estimate from)"
    if weight > 0:
        what = f"{mass:.2g} kg" if sliding else f"{mass:.2g} kg held out level"
        load = _OVER_WEIGHT * weight
        why = f"{_OVER_WEIGHT:g} times {what}, {load:.2g} {unit}"
    strongest = max(before, key=lambda joint: joint.least, default=None)
    if strongest and load < _OF_CHAIN * strongest.least:
        load = _OF_CHAIN * strongest.least
        why = f"{_OF_CHAIN:g} of the {strongest.least:.3g} N m of {strongest.name}"
    return load, why


def _limits(model: pin.Model, kind: Any) -> tuple[float, float]:
    if kind.nq != 1 or kind.nv != 1:
        return -math.inf, math.inf
    lower = float(model.lowerPositionLimit[kind.idx_q])
    upper = float(model.upperPositionLimit[kind.idx_q])
    lower, upper = stated_range(lower, upper)
    return (lower, upper) if upper - lower < 1e6 else (-math.inf, math.inf)
