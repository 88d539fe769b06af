"""What a robot's joints must stand: their effort limits where believable, else the weight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.model.twin import PRISMATIC, make_twin
from pinfric.study.trajectory.joint_columns import stated_range

#: An effort limit beyond so many times the static load is a placeholder (a gripper's force is
#: many times its fingers' weight).
_PLACEHOLDER, _PLACEHOLDER_SLIDING = 300.0, 3000.0
#: The same for a joint whose weight has no lever (N m, N).
_MOST_LOAD = 1e4
_GRAVITY = 9.81


@dataclass(frozen=True)
class JointLoad:
    """What a joint must stand, as far as a URDF says.

    Attributes:
        name: the joint's.
        sliding: True for a prismatic joint.
        degrees: 1, or more for a planar or floating joint.
        leader: of a mimic follower; None for others.
        lower, upper: rad or m, infinite without limits.
        load: what it must stand (N m or N).
        why: where that is taken from.
        remark: what is wrong with its effort limit, or "".
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


def joint_loads(model: pin.Model) -> list[JointLoad]:
    """Return what each joint must stand: its effort limit, or the weight it carries in q0."""
    twin, data = make_twin(model), model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    leaders = {
        int(twin.v_index[j - 1]): str(model.names[j])
        for j in range(1, model.njoints)
        if model.joints[j].nv == 1
    }
    found = []
    for j in range(1, model.njoints):
        kind, sliding = model.joints[j], bool(twin.kind[j - 1] == PRISMATIC)
        bodies = list(model.subtrees[j])
        masses = np.array([model.inertias[b].mass for b in bodies])
        centers = np.array([data.oMi[b].act(model.inertias[b].lever) for b in bodies])
        reach = np.linalg.norm(centers - data.oMi[j].translation, axis=1)
        weight = _GRAVITY * float(masses.sum() if sliding else masses @ reach)
        limit = float(model.effortLimit[kind.idx_v]) if kind.nv == 1 else 0.0
        load, why, remark = _load(limit, weight, float(masses.sum()), sliding)
        lower, upper = _limits(model, kind)
        follows = leaders[int(twin.v_index[j - 1])] if kind.nv == 0 else None
        found.append(
            JointLoad(
                str(model.names[j]),
                sliding,
                max(kind.nv, 1),
                follows,
                lower,
                upper,
                load,
                why,
                remark,
            )
        )
    return found


def _load(limit: float, weight: float, mass: float, sliding: bool) -> tuple[float, str, str]:
    """(what a joint must stand, why, remark): its limit if believable, else twice the weight."""
    unit = "N" if sliding else "N m"
    given = math.isfinite(limit) and limit > 0
    most = (_PLACEHOLDER_SLIDING if sliding else _PLACEHOLDER) * weight or _MOST_LOAD
    if given and limit <= most:
        return limit, f"its effort limit, {limit:.4g} {unit}", ""
    remark = f"its effort limit, {limit:.4g} {unit}, looks like a placeholder" if given else ""
    if weight > 0:
        what = f"{mass:.2g} kg" if sliding else f"{mass:.2g} kg held out level"
        return 2.0 * weight, f"twice {what}, {2.0 * weight:.2g} {unit}", remark
    return 1.0, f"1 {unit} (there is no weight to go by)", remark


def _limits(model: pin.Model, kind: Any) -> tuple[float, float]:
    if kind.nq != 1 or kind.nv != 1:
        return -math.inf, math.inf
    lower = float(model.lowerPositionLimit[kind.idx_q])
    upper = float(model.upperPositionLimit[kind.idx_q])
    lower, upper = stated_range(lower, upper)
    return (lower, upper) if upper - lower < 1e6 else (-math.inf, math.inf)
