"""Limits of mimic followers: files have no column for them, and Pinocchio forgets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinfric.model.arrays import FloatArray
from pinfric.motions.joint_columns import (
    JointColumn,
    limit_problems,
    stated_limit,
    stated_range,
    velocity_warnings,
)


@dataclass(frozen=True)
class Follower:
    """A mimic joint at ratio * leader's position + shift; `column` has the URDF's limits."""

    column: JointColumn
    leader: JointColumn
    ratio: float
    shift: float

    @property
    def law(self) -> tuple[str, float, float]:
        """The leader's name, ratio and shift."""
        return self.leader.name, self.ratio, self.shift


def find_followers(scene: Any, columns: Sequence[JointColumn]) -> tuple[Follower, ...]:
    """Return the mimic followers; none without a URDF, which has their limits."""
    robot, model = getattr(scene, "robot", None), scene.model
    if robot is None or not len(model.mimicking_joints):
        return ()
    leaders = {column.name: column for column in columns}
    limits = {}
    for joint in robot.xml().findall("joint"):
        name, kind, limit = joint.get("name", ""), joint.get("type"), joint.find("limit")
        stated = {} if limit is None else limit.attrib
        lower, upper = stated_range(float(stated.get("lower", 0)), float(stated.get("upper", 0)))
        if kind == "continuous":
            lower, upper = -np.inf, np.inf
        speed = stated_limit(float(stated.get("velocity", 0)))
        unit = "m" if kind == "prismatic" else "rad"
        limits[name] = JointColumn(name, 0, 0, 1, unit, lower, upper, speed)
    followers: list[Follower] = []
    for follower, leader in zip(model.mimicking_joints, model.mimicked_joints, strict=True):
        mimic, of = model.joints[follower].extract(), model.names[leader]
        ratio, shift = float(mimic.scaling), float(mimic.offset)
        law = f"{ratio:g} x {of}" + (f" {shift:+g}" if shift else "")
        column = replace(limits[model.names[follower]], index_v=len(followers), follows=law)
        followers.append(Follower(column, leaders[of], ratio, shift))
    return tuple(followers)


def follower_problems(
    followers: Sequence[Follower],
    columns: Sequence[JointColumn],
    t: FloatArray,
    position: FloatArray,
) -> list[str]:
    """Return one line per follower and side on which it passes a position limit.

    `position`: (T, nj) rad or m of `columns` at t (T,) s.
    """
    led = position[:, [list(columns).index(follower.leader) for follower in followers]]
    moved = led * [f.ratio for f in followers] + [f.shift for f in followers]
    return limit_problems([follower.column for follower in followers], t, moved)


def follower_warnings(
    followers: Sequence[Follower], t: FloatArray, velocity: FloatArray
) -> list[str]:
    """Return one line per follower that is too fast; `velocity`: (T, nv)."""
    led = velocity[:, [follower.leader.index_v for follower in followers]]
    columns = [follower.column for follower in followers]
    return velocity_warnings(columns, t, led * [follower.ratio for follower in followers])
